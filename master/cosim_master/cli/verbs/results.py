"""Verbs that look at FMUs, systems and results of runs (`info`, `plot`, `view`, `export`), and `repair`."""

from __future__ import annotations

import functools
import inspect
import webbrowser
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim_master.cli.terminal.console import announce, errors, note, notes, print_json, print_tables, say, usage
from cosim_master.cli.terminal.options import Json, Variant
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb
from cosim_master.files.whole import is_special, named
from cosim_master.results.export.formats import FORMATS

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run's results.")]


@verb("info Quadrotor", "info line5", "info out/line5", "info out/line5 --signals")
def info(
    path: Annotated[
        str,
        typer.Argument(
            metavar="PATH",
            help="An FMU or its model, a system or a shipped system (line5), or the folder of a run's results.",
        ),
    ],
    variant: Variant = None,
    variables: Annotated[
        bool, typer.Option("--variables", help="List all variables of an FMU.", show_default=False)
    ] = False,
    signals: Annotated[
        bool, typer.Option("--signals", help="List all signals of a run instead.", show_default=False)
    ] = False,
    as_json: Json = False,
) -> None:
    """Show the contents of an FMU or a system, or the outcome of a run."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.cli.views import inspection
        from cosim_master.cli.views.overview import overview, overview_tables, signal_table

        doing.stage(f"reading {path}")
        target = _meant(path)
        if signals and not (target / "manifest.json").is_file():
            raise usage(f"--signals: {path} is not the folder of a run's results")
        if variables and not _is_fmu(target):
            raise usage(f"--variables: {path} is not an FMU")
        if (target / "manifest.json").is_file():
            document = overview(target)
            tables = signal_table(document) if signals else overview_tables(document)
        elif as_json:
            document = inspection.fmu_document(target) if _is_fmu(target) else inspection.system_document(path, variant)
            tables = iter(())
        else:
            document = {}
            tables = (
                inspection.fmu_tables(target, every=variables)
                if _is_fmu(target)
                else inspection.system_tables(path, variant)
            )
        shown = list(tables)
        doing.end()
        if as_json:
            print_json(document)
        else:
            print_tables(shown)


def _meant(text: str) -> Path:
    """Returns a path; for the name of a model that comes with uav-cosim, that of its FMU."""
    from cosim_master.system import shipped

    path = Path(text)
    if path.exists() or text in shipped.names():
        return path
    try:
        return shipped.fmu(text) or path
    except (RuntimeError, ValueError, ImportError) as error:
        raise usage(f"{text}: its FMU cannot be built: {error}") from None


def _is_fmu(path: Path) -> bool:
    return path.suffix.lower() == ".fmu"


@verb(
    "plot out/line5", "plot out/line5 -o figures --format pdf", "plot out/line5 --signal 'drone*.vehicle.position[3]'"
)
def plot(
    run: Run,
    folder: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FOLDER", help="Folder for the figures.", show_default="the run's"),
    ] = None,
    signal: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            metavar="PATTERN",
            help="Draw the signals that match instead; each further pattern is a further panel.",
            show_default=False,
        ),
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format", metavar="png|svg|pdf", help="Kind of files; may be repeated.", show_default="png, svg"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Draw the figures of a run."""
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"plotting {run}")
        from cosim_master.results.figures.draw import FORMATS as KINDS
        from cosim_master.results.figures.draw import USUAL, figures

        if wrong := [one for one in formats or () if one not in KINDS]:
            raise usage(f"--format {wrong[0]}: there are {', '.join(KINDS)}")
        files = figures(run, folder, signals=signal or (), formats=formats or USUAL)
        doing.end()
        if as_json:
            print_json({"files": [str(file) for file in files]})
            return
        for file in files:
            say(str(file))


@verb("view out/line5", "view out/line5 -o line5.html --no-open", "view out/line5 --rerun")
def view(
    run: Run,
    file: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="File to write.", show_default="view.html in the run's"),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option("--rerun", help="Write view.rrd and serve it to Rerun's viewer until Ctrl-C.", show_default=False),
    ] = False,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Write the file only; do not open a browser.", show_default=False)
    ] = False,
    as_json: Json = False,
) -> None:
    """Show a run in a browser: one HTML page with its motion, packets, signals, messages and findings."""
    with errors(as_json=as_json), activity() as doing:
        if file is not None and not rerun and file.suffix.lower() not in (".html", ".htm") and not is_special(file):
            raise usage(f"-o {file}: a view is an HTML page; name it {named(file, '.html')}")
        doing.stage(f"reading {run}")
        if rerun:
            written = _write_rrd(run, file or run / "view.rrd")
        else:
            from cosim_master.view.page import write_page

            written = write_page(run, file)
        doing.end()
        if as_json:
            print_json({"files": [str(written)]})
        else:
            say(str(written))
        if rerun and not no_open:
            _serve_rerun(written)
        elif not no_open and not webbrowser.open(written.resolve().as_uri()):
            note(f"no browser was found here; open {written} in one")


def _write_rrd(run: Path, file: Path) -> Path:
    from cosim_master.results.export.formats import export_run, format_of
    from cosim_master.results.export.options import Options

    if file.suffix.lower() != ".rrd":
        raise usage(f"-o {file}: with --rerun, the end of the name must be .rrd")
    notes(export_run(run, format_of(file), file, Options()))
    return file


def _serve_rerun(file: Path) -> None:
    from cosim_master.cli.terminal.live import show_in_browser
    from cosim_master.view.programs.rerun_viewer import RerunViewer

    with RerunViewer(file) as viewer, suppress(KeyboardInterrupt):
        announce(f"Rerun viewer: {viewer.address}")
        show_in_browser(viewer.address)
        viewer.wait()


@verb("report out/line5", "report out/line5 out/line5-2 -o comparison.html", "report out/study")
def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Folder of a run's results, or of a campaign; several runs are compared."
        ),
    ],
    file: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="FILE", help="HTML file to write.", show_default="report.html in the first run's"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a report on a run or a campaign, or a comparison of several runs: one HTML page with figures and tables."""
    with errors(as_json=as_json), activity() as doing:
        if file is not None and file.suffix.lower() not in (".html", ".htm"):
            raise usage(f"-o {file}: a report is an HTML page; name it {named(file, '.html')}")
        doing.stage(f"reading {', '.join(map(str, runs[:3]))}")
        from cosim_master.campaigns.dataset.folder import is_campaign

        if any(map(is_campaign, runs)):
            if len(runs) > 1:
                raise usage("report: campaigns are not compared; give the folder of one campaign, or folders of runs")
            from cosim_master.campaigns.report.page import write_campaign_report

            written = write_campaign_report(runs[0], file)
        else:
            from cosim_master.report.page import write_report

            written = write_report(runs, file)
        doing.end()
        if as_json:
            print_json({"files": [str(written)]})
        else:
            say(str(written))


def _with_formats(function: Callable[..., None]) -> Callable[..., None]:
    """Gives a verb an option for each format; the verb receives the files in `files`, by name of the format."""

    @functools.wraps(function)
    def call(**given: Any) -> None:
        files = {one.name: given.pop(one.name) for one in FORMATS}
        function(files=files, **given)

    own = [one for one in inspect.signature(function, eval_str=True).parameters.values() if one.name != "files"]
    options = [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[
                Path | None, typer.Option(one.option, metavar="FOLDER" if one.is_folder else "FILE", help=one.text)
            ],
        )
        for one in FORMATS
    ]
    call.__signature__ = inspect.Signature([*own[:2], *options, *own[2:]])  # type: ignore[attr-defined]
    return call


@verb(
    "export out/line5 -o line5.csv",
    "export out/line5 --mcap line5.mcap --kml line5.kml",
    "export out/line5 -o - | head",
)
@_with_formats
def export(
    *,
    run: Run,
    file: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="FILE", help="File to write; the end of its name chooses the format. - writes CSV."
        ),
    ] = None,
    files: Mapping[str, Path | None],
    numbers: Annotated[
        bool,
        typer.Option("--numbers", help="Leave out text, which readers of numbers (FMPy) refuse.", show_default=False),
    ] = False,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,ALT",
            help="Local origin on Earth, degrees and m above mean sea level.",
            show_default="that which the models declare",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a run in the formats of other tools: tables, logs, tracks."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.results.export.formats import check_place, export_run, format_of
        from cosim_master.results.export.options import Options, origin_of_text

        wanted = [(one, path) for one in FORMATS if (path := files[one.name]) is not None]
        if file is not None:
            wanted.append((format_of(file), file))
        if not wanted:
            raise usage(f"export: no file to write; give -o FILE, or one of {', '.join(f.option for f in FORMATS)}")
        if others := [one.option for one, path in wanted if str(path) == "-" and one.name != "csv"]:
            raise usage(f"{others[0]} -: only CSV can be written to standard output; give a file")
        if as_json and any(str(path) == "-" for _, path in wanted):
            raise usage("export: --json and -o - both want standard output; leave out one")
        if twice := [path for n, (_, path) in enumerate(wanted) if path in [other for _, other in wanted[:n]]]:
            raise usage(f"export: {twice[0]} is given twice; give each format a file of its own")
        for option, field, given in (("--numbers", "numbers_only", numbers), ("--origin", "origin", origin)):
            if given and all(one.uses != field for one, _ in wanted):
                those = ", ".join(one.option for one in FORMATS if one.uses == field)
                raise usage(f"export: {option} belongs to {those}; none of these is written, so leave it out")
        for one, path in wanted:  # before any is written
            check_place(run, one, path)
        options = Options(numbers, origin_of_text(origin) if origin else None)
        said: list[str] = []
        written: list[str] = []
        for one, path in wanted:
            doing.end() if str(path) == "-" else doing.stage(f"writing {path}")
            said += export_run(run, one, path, options)
            if str(path) != "-":
                written.append(str(path))
                if not as_json:
                    doing.end()
                    say(str(path))
        doing.end()
        notes(said)
        if as_json:
            print_json({"files": written, "notes": said})


@verb("repair out/line5")
def repair(run: Run, as_json: Json = False) -> None:
    """Complete the recording of a run that was killed."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.results.repair import repair as repaired

        doing.stage(f"completing {run}")
        manifest = repaired(run)
        doing.end()
        if as_json:
            told = ("outcome", "error", "simulated_s", "wall_s", "packets")
            print_json({"folder": str(run), **{name: manifest[name] for name in told}})
        else:
            say(f"{run}: {manifest['outcome']}, {manifest['simulated_s']:g} s simulated")
            if manifest["outcome"] == "killed":
                say(f"error: {manifest['error']}")
