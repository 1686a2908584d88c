"""The command `uav-cosim`. It alone prints; heavy modules are imported by the commands that need them.

Exit codes: 0 done, 1 a run failed, 2 a bad description or bad usage.
"""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from cosim_master.errors import CosimError, SystemDescriptionError

if TYPE_CHECKING:
    from rich.table import Table

    from cosim_master.check import CheckedSystem
    from cosim_master.simulation import Prepared, Progress, RunResult
    from cosim_master.timing import Timing

__all__ = ["main"]

app = typer.Typer(
    name="uav-cosim",
    help="Co-simulation of cooperating UAVs: FMUs, SSP systems, MAVLink packets over a simulated radio.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)

System = Annotated[
    str, typer.Argument(help="An .ssd, .ssp, multi-model (.json), or folder with a SystemStructure.ssd.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="COMPONENT.PARAMETER=VALUE", help="Override a start value; may be repeated."),
]
Until = Annotated[float | None, typer.Option(help="Stop time in s; default: the system's DefaultExperiment.")]
Variant = Annotated[
    str | None, typer.Option(help="Which .ssd of an archive or folder: its name. Default: SystemStructure.ssd.")
]
Step = Annotated[float | None, typer.Option(help="Step size in s where neither system nor FMU names one.")]


@contextmanager
def _errors() -> Iterator[None]:
    """Our own errors become a message and an exit code; everything else is a bug and keeps its traceback."""
    try:
        yield
    except SystemDescriptionError as error:
        for problem in error.problems:
            err.print(f"error: {problem}", markup=False)
        raise typer.Exit(2) from None
    except CosimError as error:
        err.print(f"error: {error}", markup=False)
        raise typer.Exit(1) from None


def _usage(message: str) -> typer.Exit:
    err.print(f"error: {message}", markup=False)
    return typer.Exit(2)


def _overrides(settings: list[str] | None) -> dict[str, str]:
    overrides = {}
    for setting in settings or []:
        name, equals, value = setting.partition("=")
        if not equals or not name.strip():
            raise _usage(f"--set {setting}: write COMPONENT.PARAMETER=VALUE")
        overrides[name.strip()] = value.strip()
    return overrides


def _changes(settings: list[str] | None) -> list[tuple[float, str, str]]:
    found = []
    for setting in settings or []:
        time, _, rest = setting.strip().partition(" ")
        name, equals, value = rest.partition("=")
        try:
            if not equals or not name.strip():
                raise ValueError
            found.append((float(time), name.strip(), value.strip()))
        except ValueError:
            raise _usage(f"--at {setting}: write --at TIME COMPONENT.PARAMETER=VALUE") from None
    return found


@app.command()
def build(
    models: Annotated[
        list[str] | None,
        typer.Argument(help="Model names (Quadrotor), modules or .py files; default: every model of cosim_models."),
    ] = None,
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the FMUs.")] = Path("fmus"),
    interpreted: Annotated[
        bool, typer.Option("--interpreted", help="Pack the Python sources (pythonfmu) instead of compiling them.")
    ] = False,
    target: Annotated[
        list[str] | None, typer.Option(help="Platform to build for; may be repeated. Default: this one.")
    ] = None,
    fmi: Annotated[int, typer.Option(help="2 writes NAME.fmu, 3 writes NAME.fmi3.fmu; both may be in one system.")] = 2,
) -> None:
    """Build FMUs from models, only those that changed."""
    from cosim.build import HOST, CannotCompile, build_all, load_models, models_of_package

    try:
        chosen = []
        for name in models or [model.__name__ for model in models_of_package("cosim_models")]:
            if "." in name:
                chosen += load_models(name)
                continue
            known = models_of_package("cosim_models")
            matching = [model for model in known if model.__name__ == name]
            if not matching:
                names = ", ".join(model.__name__ for model in known)
                raise ValueError(f"no model called {name}: there are {names}; or give a module or a .py file")
            chosen += matching
        for built in build_all(chosen, folder, interpreted=interpreted, targets=target or [HOST], fmi=fmi):
            state = "up to date" if built.fresh else "compiled" if built.compiled else "interpreted"
            out.print(f"{built.file}: {state}", markup=False)
            if built.note:
                out.print(f"  {built.note}", markup=False)
    except (ValueError, ImportError, SyntaxError, CannotCompile) as error:
        raise _usage(str(error)) from None
    except RuntimeError as error:
        err.print(f"error: {error}", markup=False)
        raise typer.Exit(1) from None


@app.command()
def run(
    system: System,
    folder: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for the results.")] = None,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    pace: Annotated[float | None, typer.Option(help="Hold at most this many times real time.")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**53, help="Seed of the radio; default: the system's.")
    ] = None,
    settings: Settings = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIME COMPONENT.PARAMETER=VALUE",
            help="Set a tunable parameter or an open input at a time in s; may be repeated.",
        ),
    ] = None,
    record: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Signals to record, e.g. '*.position*'; default: all outputs."),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="Threads that step native FMUs; default: all cores for large systems.")
    ] = None,
    gcs: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="A ground station, e.g. udpout:127.0.0.1:14550; may be repeated."),
    ] = None,
    ports: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Serial ports of the autopilots, e.g. tcp:5760+10 for 5760, 5770, ..."),
    ] = None,
    profile: Annotated[bool, typer.Option("--profile", help="Tell where the time went, by FMU and phase.")] = False,
    checkpoint_every: Annotated[
        float | None, typer.Option(metavar="S", help="Write a checkpoint every so many simulated seconds.")
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option("--from", metavar="RUN@TIME", help="Go on from a checkpoint; --set then changes values there."),
    ] = None,
) -> None:
    """Run a system."""
    from cosim_master.calls import PLAIN
    from cosim_master.simulation import simulate

    if profile and PLAIN:
        raise _usage("--profile needs compiled kernels; NUMBA_DISABLE_JIT is set")
    if threads is not None and threads < 1:
        raise _usage(f"--threads {threads}: give a positive number")
    if pace is not None and not 0 < pace < math.inf:
        raise _usage(f"--pace {pace:g}: give a positive factor of real time")
    folder = folder or Path("out") / Path(system).resolve().stem
    with _errors(), _progress() as show:
        result = simulate(
            system,
            variant=variant,
            out=folder,
            until=until,
            step=step,
            pace=pace,
            seed=seed,
            overrides=_overrides(settings),
            record=record or (),
            at=_changes(at),
            threads=threads,
            profile=profile,
            on_start=_print_notes,
            on_progress=show,
            gcs=gcs or (),
            ports=ports,
            on_gateway=_note,
            checkpoint_every=checkpoint_every,
            origin=origin,
        )
    _report(result, folder)


def _note(text: str) -> None:
    err.print(f"note: {text}", markup=False)


def _print_notes(ready: Prepared) -> None:
    for note in ready.notes:
        _note(note)


@contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """A bar with simulated time, speed and time left; nothing where the output is no terminal."""
    from rich import progress as rich

    columns = (
        rich.BarColumn(),
        rich.TextColumn("{task.completed:.1f}/{task.total:.1f} s"),
        rich.TextColumn("{task.fields[speed]:.1f} x real time"),
        rich.TimeRemainingColumn(),
    )
    with rich.Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("run", total=None, speed=0.0)

        def show(progress: Progress) -> None:
            done = progress.time - progress.start
            speed = done / progress.wall if progress.wall else 0.0
            bar.update(task, total=progress.stop - progress.start, completed=done, speed=speed)

        yield show


def _report(result: RunResult, folder: Path) -> None:
    if result.error is not None:
        word = "note" if result.outcome == "terminated" else "error"
        err.print(f"{word}: {result.error}", markup=False)
    packets = result.packets
    if result.outcome != "failed" or packets:
        counts = ", ".join(f"{packets.get(name, 0)} {name}" for name in ("sent", "delivered", "lost"))
        out.print(
            f"{result.outcome}: {result.simulated_s:g} s simulated in {result.wall_s:.2f} s "
            f"({result.real_time_factor:.1f} times real time), packets {counts}; {folder}",
            markup=False,
        )
    for gateway, crossed in result.gateways.items():
        text = ", ".join(f"{n} {what}" for what, n in crossed.items() if what != "address")
        _note(f"{gateway} ({crossed['address']}): {text or 'nothing has crossed'}")
    if result.profile is not None:
        from cosim_master.inspection import profile_tables

        _print_tables(profile_tables(result.profile))
    if result.overruns[0]:
        err.print(f"note: the pace was missed {result.overruns[0]} times, by {result.overruns[1]:.3f} s at worst")
    if result.outcome == "failed":
        raise typer.Exit(1)
    if result.outcome == "interrupted":
        raise typer.Exit(130)


@app.command()
def check(
    system: System,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    settings: Settings = None,
    init: Annotated[bool, typer.Option("--init", help="Load and initialize the FMUs too, and stop there.")] = False,
) -> None:
    """Read a system and its FMUs and report every problem, without running anything."""
    from cosim_master.check import check as check_system
    from cosim_master.layout import layout
    from cosim_master.simulation import prepare
    from cosim_master.ssp import read_system

    with _errors(), read_system(system, variant) as structure:
        checked = check_system(structure, _overrides(settings))
        ready = prepare(checked, until=until, step=step)
        checked = ready.checked
        layout(checked, ready.network, ready.recording.signals, ready.coupling)
        _print_notes(ready)
        n = ready.clock.steps
        if init:
            _try_out(checked, ready.clock)
        out.print(
            f"{structure.path}: {len(checked.instances)} instances, {len(checked.links)} connections, "
            f"{len(ready.network.nodes)} radio nodes, {n} steps of {ready.clock.base / 1e9:g} s: no problems",
            markup=False,
        )


def _try_out(checked: CheckedSystem, clock: Timing) -> None:
    from cosim_master.startup import try_out

    for loop in try_out(checked, clock.start / 1e9, (clock.start + clock.steps * clock.base) / 1e9):
        names = ", ".join(loop.outputs[:5]) + (f" and {len(loop.outputs) - 5} more" if len(loop.outputs) > 5 else "")
        out.print(f"a loop at initialization, settled in {loop.rounds} rounds: {names}", markup=False)
    out.print(f"{len(checked.instances)} instances initialized", markup=False)


@app.command()
def explain(
    system: System,
    name: Annotated[str, typer.Argument(metavar="COMPONENT.VARIABLE", help="Hierarchical name of a variable.")],
    variant: Variant = None,
    settings: Settings = None,
) -> None:
    """Tell where the value of a variable comes from: who sets it, who is overridden, and what was ignored."""
    from cosim_master.check import check as check_system
    from cosim_master.explanation import explain as explained
    from cosim_master.ssp import read_system

    with _errors(), read_system(system, variant) as structure:
        for line in explained(check_system(structure, _overrides(settings)), name):
            out.print(line, markup=False)


@app.command()
def info(
    path: Annotated[str, typer.Argument(help="An FMU, a system, or the results of a run.")], variant: Variant = None
) -> None:
    """Show what an FMU, a system or a run consists of."""
    from cosim_master import inspection

    with _errors():
        target = Path(path)
        if target.suffix == ".fmu":
            _print_tables(inspection.fmu_tables(target))
        elif (target / "manifest.json").is_file():
            _print_tables(inspection.run_tables(target))
        else:
            _print_tables(inspection.system_tables(path, variant))


def _print_tables(tables: Iterator[Table | str]) -> None:
    if not out.is_terminal:
        out.width = 10_000  # a file or a pipe has no width: one line per row
    for table in tables:
        out.print(table, markup=False) if isinstance(table, str) else out.print(table)


@app.command()
def new(
    shape: Annotated[str, typer.Argument(help="line or grid.")],
    drones: Annotated[int, typer.Option(help="How many.")],
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder of the new system; must not exist.")],
    fmus: Annotated[Path, typer.Option(help="Folder with the FMUs of vehicle, autopilot and agent.")] = Path("fmus"),
    spacing: Annotated[float, typer.Option(help="Metres between neighbours at the start.")] = 10.0,
    until: Annotated[float, typer.Option(help="Stop time of the new system in s.")] = 60.0,
) -> None:
    """Write a system of many drones."""
    from cosim_master.new import new_system

    with _errors():
        written = new_system(shape, drones, folder, fmus=fmus, spacing=spacing, until=until)
        out.print(f"{written}: {shape} of {drones} drones; uav-cosim run {written}", markup=False)


@app.command()
def graph(
    system: System,
    variant: Variant = None,
    file: Annotated[
        Path | None, typer.Option("-o", "--out", help="SVG file to write; default: the system's name.")
    ] = None,
) -> None:
    """Draw a system: components, connectors and connections, as SVG."""
    from cosim_master.graph import graph as drawing
    from cosim_master.ssp import read_system

    with _errors(), read_system(system, variant) as structure:
        target = file or Path(f"{structure.name}.svg".replace("/", "_"))
        data = drawing(structure)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        except OSError as error:
            raise _usage(f"{target}: cannot be written: {error.strerror}") from None
        out.print(str(target), markup=False)


@app.command()
def convert(
    multimodel: Annotated[
        Path, typer.Argument(help="A multi-model of INTO-CPS or the configuration of a run (.json).")
    ],
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder of the new system; must not exist.")],
) -> None:
    """Write a multi-model as an SSP."""
    from cosim_master.conversion import convert as convert_multimodel

    with _errors():
        out.print(f"{convert_multimodel(multimodel, folder)}: uav-cosim run {folder}", markup=False)


@app.command()
def swap(
    system: System,
    component: Annotated[str, typer.Argument(help="Hierarchical name, e.g. drone3.vehicle.")],
    fmu: Annotated[Path, typer.Argument(help="The FMU it gets.")],
    new: Annotated[
        Path | None, typer.Option("-o", "--out", help="The new system; default: change it in place.")
    ] = None,
) -> None:
    """Give a component another FMU; nothing else changes."""
    from cosim_master.edit import swap as swap_component

    with _errors():
        written = swap_component(system, component, fmu, new)
        out.print(f"{written}: {component} is now {fmu}", markup=False)


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(help="Folder of a run's results.")],
    folder: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for the figures; default: the run's.")
    ] = None,
) -> None:
    """Draw the figures of a run."""
    from cosim_master.figures import figures

    with _errors():
        for file in figures(run, folder):
            out.print(str(file), markup=False)


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="Folder of a run's results.")],
    csv: Annotated[Path, typer.Option("--csv", help="CSV file to write, as FMPy writes its results.")],
) -> None:
    """Write the signals of a run in another format."""
    from cosim_master.export import export_csv

    with _errors():
        for name in export_csv(run, csv):
            err.print(f"note: {name} is text, which this format has no place for: left out", markup=False)
        out.print(str(csv), markup=False)


@app.command()
def dialect(
    xml: Annotated[Path, typer.Argument(help="A MAVLink XML file with messages of your own.")],
    module: Annotated[Path, typer.Option("-o", "--out", help="Python module to write.")],
) -> None:
    """Write a module with which models read and send messages of your own."""
    from cosim.build.dialects import module_source, read_xml

    try:
        messages = read_xml(xml)
        module.write_text(module_source(messages, xml.name), encoding="utf-8")
    except ValueError as error:
        raise _usage(str(error)) from None
    except OSError as error:
        raise _usage(f"{error.filename}: {error.strerror}") from None
    out.print(f"{module}: {', '.join(messages) or 'no messages that ardupilotmega does not have'}", markup=False)


@app.callback()
def options(
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show what FMUs log.")] = False,
) -> None:
    """Co-simulation of cooperating UAVs: FMUs, SSP systems, MAVLink packets over a simulated radio."""
    logging.basicConfig(level=logging.DEBUG if verbose else logging.WARNING, stream=sys.stderr, format="%(message)s")
    for noisy in ("numba", "matplotlib", "fmpy", "pythonfmu"):
        logging.getLogger(noisy).setLevel(logging.WARNING)


def main() -> None:
    """Entry point of the command."""
    app(_joined(sys.argv[1:]))


def _joined(arguments: list[str]) -> list[str]:
    """The two words after --at as one: Typer has no options that may be repeated and take two."""
    joined: list[str] = []
    for argument in arguments:
        if len(joined) > 1 and joined[-2] == "--at" and " " not in joined[-1]:
            joined[-1] += f" {argument}"
        else:
            joined.append(argument)
    return joined
