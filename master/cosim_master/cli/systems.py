"""Verbs over systems: `check`, `explain`, `new`, `graph`, `convert`, `swap`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim_master.cli.console import (
    Settings,
    Step,
    System,
    Until,
    Variant,
    app,
    errors,
    out,
    overrides,
    print_notes,
    usage,
)

if TYPE_CHECKING:
    from cosim_master.check import CheckedSystem
    from cosim_master.timing import Timing


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

    with errors(), read_system(system, variant) as structure:
        checked = check_system(structure, overrides(settings))
        ready = prepare(checked, until=until, step=step)
        checked = ready.checked
        layout(checked, ready.network, ready.recording.signals, ready.coupling)
        print_notes(ready)
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

    with errors(), read_system(system, variant) as structure:
        for line in explained(check_system(structure, overrides(settings)), name):
            out.print(line, markup=False)


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

    with errors():
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

    with errors(), read_system(system, variant) as structure:
        target = file or Path(f"{structure.name}.svg".replace("/", "_"))
        data = drawing(structure)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        except OSError as error:
            raise usage(f"{target}: cannot be written: {error.strerror}") from None
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

    with errors():
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

    with errors():
        written = swap_component(system, component, fmu, new)
        out.print(f"{written}: {component} is now {fmu}", markup=False)
