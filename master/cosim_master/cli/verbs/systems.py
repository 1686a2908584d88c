"""Verbs that look at systems without running them: `check`, `explain`, `graph`."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim_master.cli.terminal.console import errors, notes, print_json, print_tables, say, usage
from cosim_master.cli.terminal.options import (
    Json,
    PartitionFile,
    Partitions,
    Settings,
    Step,
    Strict,
    System,
    Until,
    Variant,
    overrides,
)
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb
from cosim_master.cli.terminal.verdict import show_findings, summary
from cosim_master.cli.views.partitioning import partition_document, partition_tables
from cosim_master.diagnostics.errors import counted

BROUGHT_ALONG = "brought along"
"""The value of --reference without a file."""
TOLERANCE = 1e-3
"""The value of --tolerance where it is not given."""

if TYPE_CHECKING:
    from cosim_master.execution.preparation.prepare import Prepared
    from cosim_master.execution.reference_results import Verdict
    from cosim_master.system.flatten.flat import CheckedSystem
    from cosim_master.system.settings.time_grid import TimeGrid
    from cosim_master.verdict.findings import Judgement


_Init = Annotated[
    bool, typer.Option("--init", help="Load and initialize the FMUs too, and stop there.", show_default=False)
]
_Reference = Annotated[
    str | None,
    typer.Option(
        metavar="[FILE.csv]",
        help="Of an FMU: run it and compare it with a CSV file, or with the results that it brings along.",
    ),
]
_Tolerance = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        help="Of --reference: allowed difference, in parts of the largest value of a column.",
        show_default=f"{TOLERANCE:g}",
    ),
]


@verb(
    "check line5",
    "check line5 --init --set drone3.vehicle.mass=2",
    "check line5 --partitions 2",
)
def check(
    system: System,
    variant: Variant = None,
    until: Until = None,
    step: Step = None,
    settings: Settings = None,
    init: _Init = False,
    strict: Strict = False,
    reference: _Reference = None,
    tolerance: _Tolerance = None,
    partitions: Partitions = None,
    partition_file: PartitionFile = None,
    as_json: Json = False,
) -> None:
    """Read a system and its FMUs and report every problem, without running anything."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.execution.preparation.prepare import prepare
        from cosim_master.stepping.layout import make_layout
        from cosim_master.system.flatten.check import check as check_system
        from cosim_master.system.reading.read import read_system
        from cosim_master.system.reading.single_fmu import full_names

        doing.stage(f"checking {system}")
        if Path(system).suffix.lower() == ".fmu" and Path(system).is_file():
            _check_fmu(Path(system))
        elif reference is not None:
            raise usage(f"--reference: {system} is not an FMU")
        if partition_file is not None and partitions is None:
            raise usage("--partition-file belongs to --partitions, which is not given")
        if tolerance is not None and reference is None:
            raise usage("--tolerance belongs to --reference, which is not given")
        if tolerance is not None and not math.isfinite(tolerance):
            raise usage(f"--tolerance {tolerance:g}: give a finite number")
        if reference is not None:
            from cosim_master.execution.reference_results import against_reference

            doing.stage(f"running {system}")
            file = None if reference == BROUGHT_ALONG else Path(reference)
            verdict = against_reference(
                Path(system),
                file,
                tolerance=TOLERANCE if tolerance is None else tolerance,
                until=until,
                step=step,
                overrides=overrides(settings),
            )
            doing.end()
            _report_reference(verdict, as_json=as_json)
            return
        with read_system(system, variant) as structure:
            checked = check_system(structure, full_names(structure, overrides(settings)))
            ready = prepare(checked, until=until, step=step, strict=strict)
            make_layout(ready.checked, ready.network, ready.recording.signals, ready.master)
            notes(ready.notes)
            known = ready.verdict()
            parts = None if partitions is None else _partitioned(ready, partitions, partition_file)
            loops = None
            if init:
                doing.stage(f"initializing {len(ready.checked.instances)} FMU instances")
                loops = _try_out(ready.checked, ready.clock)
            doing.end()
            if as_json:
                print_json({**_document(ready, known, loops), **({} if parts is None else {"partitions": parts})})
            else:
                _report(ready, known, loops)
                if parts is not None:
                    print_tables(partition_tables(parts))
            _exit_if(strict and not known.good)


def _partitioned(ready: Prepared, parts: int, file: Path | None) -> dict[str, Any]:
    """Returns the description of a cut. Raises SystemDescriptionError if the system cannot be cut."""
    from cosim_master.execution.partitions.cut import cut as cut_into
    from cosim_master.execution.partitions.cut import read_assignment

    found = cut_into(ready, parts, None if file is None else read_assignment(file, parts))
    return partition_document(found, ready)


def _document(ready: Prepared, known: Judgement, loops: list[dict[str, Any]] | None) -> dict[str, Any]:
    """Returns the JSON document of a check; `loops` is None if nothing was initialized."""
    return {
        "system": str(ready.checked.structure.path),
        "instances": len(ready.checked.instances),
        "connections": len(ready.checked.links),
        "radio_nodes": len(ready.network.nodes),
        "steps": ready.clock.steps,
        "base_step": ready.clock.seconds(1),
        "initialized": loops is not None,
        "loops": loops or [],
        "notes": list(ready.notes),
        "errors": [],
        "verdict": known.as_json(),
    }


def _report(ready: Prepared, known: Judgement, loops: list[dict[str, Any]] | None) -> None:
    checked, clock = ready.checked, ready.clock
    for loop in loops or ():
        say(f"a loop at initialization, settled in {loop['rounds']} rounds: {_shortened(loop['outputs'])}")
    if loops is not None:
        say(f"{counted(len(checked.instances), 'instance')} initialized")
    show_findings(known)
    steps = f"{counted(clock.steps, 'step')} of {clock.seconds(1):.9g} s"
    if ready.master.constrained:
        steps = "steps of sizes that constraints decide"
    say(
        f"{checked.structure.path}: {counted(len(checked.instances), 'instance')}, "
        f"{counted(len(checked.links), 'connection')}, {counted(len(ready.network.nodes), 'radio node')}, {steps}: "
        f"no problems{summary(known)}"
    )


def _exit_if(failed: bool) -> None:
    if failed:
        raise typer.Exit(1)


def _check_fmu(path: Path) -> None:
    """Raises an error that lists all problems of an FMU."""
    from cosim_master.diagnostics.errors import SystemDescriptionError
    from cosim_master.fmi.description.datasheet import findings

    if problems := findings(path):
        raise SystemDescriptionError(problems)


def _report_reference(verdict: Verdict, *, as_json: bool) -> None:
    if as_json:
        print_json({**asdict(verdict), "agrees": verdict.agrees})
    else:
        for one in verdict.differences:
            word = "agrees" if one.agrees else "DIFFERS"
            apart = f"{one.largest:.3g} at t = {one.time:.9g} s, allowed {one.allowed:.3g}"
            print_tables([f"{one.name}: {word}, by {apart}"])
        if verdict.left_out:
            notes([f"not compared, since they are not outputs: {_shortened(list(verdict.left_out))}"])
        say(f"{verdict.rows} rows of {verdict.source}")
    if not verdict.agrees:
        raise typer.Exit(1)


def _try_out(checked: CheckedSystem, clock: TimeGrid) -> list[dict[str, Any]]:
    from cosim_master.execution.preparation.isolating import isolation_for
    from cosim_master.execution.startup.initialize import try_out

    found = try_out(checked, clock.time(0), clock.time(clock.steps), isolation_for(None, checked))
    return [{"rounds": loop.rounds, "outputs": list(loop.outputs)} for loop in found]


def _shortened(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


@verb("explain line5 'drone3.vehicle.position_start[2]'", "explain line5 'drone*.agent.epsilon'")
def explain(
    system: System,
    name: Annotated[
        str, typer.Argument(metavar="COMPONENT.VARIABLE", help="Hierarchical name of a variable, or a pattern.")
    ],
    variant: Variant = None,
    settings: Settings = None,
    as_json: Json = False,
) -> None:
    """Tell where the value of a variable comes from: who sets it, who is overridden, and what was ignored."""
    from cosim_master.cli.views.explanation import explain as explained
    from cosim_master.system.flatten.check import check as check_system
    from cosim_master.system.reading.read import read_system
    from cosim_master.system.reading.single_fmu import full_names
    from cosim_master.system.settings.network import network_of
    from cosim_master.system.settings.receivers import with_jamming

    with errors(as_json=as_json), activity() as doing, read_system(system, variant) as structure:
        doing.stage(f"checking {system}")
        checked = check_system(structure, full_names(structure, overrides(settings)))
        checked = with_jamming(checked, network_of(checked))
        lines = explained(checked, *full_names(structure, {name: name}))
        doing.end()
        if as_json:
            print_json({"variable": name, "explanation": [line.strip() for line in lines]})
            return
        print_tables(lines)


@verb("graph line5 -o line5.svg")
def graph(
    system: System,
    variant: Variant = None,
    file: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="SVG file to write.", show_default="SYSTEM'S NAME.svg"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Draw a system: components, connectors and connections, as SVG."""
    with errors(as_json=as_json), activity() as doing:
        doing.starting()
        from cosim_master.files.whole import write_whole, writing
        from cosim_master.system.authoring.draw import graph as drawing
        from cosim_master.system.reading.read import read_system

        if file is not None and file.suffix.lower() != ".svg":
            raise usage(f"{file}: graph writes SVG; give the file a name that ends in .svg")
        doing.stage(f"drawing {system}")
        with read_system(system, variant) as structure:
            target = file or Path(f"{structure.name}.svg".replace("/", "_"))
            data = drawing(structure)
        doing.end()
        with writing(target):
            write_whole(target, data)
        if as_json:
            print_json({"files": [str(target)]})
        else:
            say(str(target))
