"""Verbs that look at FMUs, systems and results of runs (`info`, `plot`, `view`, `export`), and `repair`."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.terminal.console import errors, note, notes, print_json, print_tables, say, usage
from cosim_master.cli.terminal.options import Json, Variant
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run's results.")]


@verb("info fmus/Quadrotor.fmu", "info master/systems/line5", "info out/line5", "info out/line5 --signals")
def info(
    path: Annotated[str, typer.Argument(metavar="PATH", help="An FMU, a system, or the folder of a run's results.")],
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
        target = Path(path)
        if signals and not (target / "manifest.json").is_file():
            raise usage(f"--signals: {path} is not the folder of a run's results")
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


def _is_fmu(path: Path) -> bool:
    return path.suffix == ".fmu"


@verb("plot out/line5", "plot out/line5 -o figures")
def plot(
    run: Run,
    folder: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FOLDER", help="Folder for the figures.", show_default="the run's"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Draw the figures of a run."""
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"plotting {run}")
        from cosim_master.results.figures import figures

        files = figures(run, folder)
        doing.end()
        if as_json:
            print_json({"files": [str(file) for file in files]})
            return
        for file in files:
            say(str(file))


@verb("view out/line5", "view out/line5 -o line5.html --no-open")
def view(
    run: Run,
    file: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="HTML file to write.", show_default="view.html in the run's"),
    ] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Write the page only; do not open a browser.", show_default=False)
    ] = False,
    as_json: Json = False,
) -> None:
    """Show a run in a browser: one HTML page with its motion, packets, signals, messages and findings."""
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"reading {run}")
        from cosim_master.view.page import write_page

        written = write_page(run, file)
        doing.end()
        if as_json:
            print_json({"files": [str(written)]})
        else:
            say(str(written))
        if not no_open and not webbrowser.open(written.resolve().as_uri()):
            note(f"no browser was found here; open {written} in one")


@verb("export out/line5 -o line5.csv", "export out/line5 -o - | head -3")
def export(
    run: Run,
    csv: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            "--csv",
            metavar="FILE",
            help="CSV file to write, as FMPy writes its results; - is standard output.",
        ),
    ],
    numbers: Annotated[
        bool,
        typer.Option("--numbers", help="Leave out text, which readers of numbers (FMPy) refuse.", show_default=False),
    ] = False,
    as_json: Json = False,
) -> None:
    """Write the signals of a run in another format."""
    to_stdout = str(csv) == "-"
    if as_json and to_stdout:
        raise usage("export: --json and -o - both want standard output; leave out one")
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.results.export import export_csv

        if not to_stdout:
            doing.stage(f"writing {csv}")
        else:
            doing.end()
        texts = export_csv(run, sys.stdout if to_stdout else csv, numbers_only=numbers)
        doing.end()
        if texts and not numbers:
            some = ", ".join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")
            notes([f"written as text in quotes: {some}; FMPy reads numbers only, which --numbers writes"])
        if as_json:
            print_json({"files": [str(csv)], "left_out": list(texts) if numbers else []})
        elif not to_stdout:
            say(str(csv))


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
