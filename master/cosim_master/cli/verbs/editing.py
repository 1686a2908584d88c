"""Verbs that write systems: `new`, `convert`, `swap`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim_master.cli.terminal.console import command, errors, note, print_json, say, usage
from cosim_master.cli.terminal.options import Json, System, positive
from cosim_master.cli.terminal.progress import activity
from cosim_master.cli.terminal.registry import verb

NewFolder = Annotated[
    Path, typer.Option("-o", "--out", metavar="FOLDER", help="Folder of the new system; must not exist.")
]


_FLEET = "one FMU (a file or a model), or several in turn: 4xQuadrotor,1xHexarotor"


@verb(
    "new line --drones 50 -o swarm",
    "new grid --drones 100 --spacing 20 --until 120 -o field",
    "new line5 --drones 12 --layout ring --vehicle 2xQuadrotor,1xHexarotor -o ring",
    "new agent my_law.py",
    "new channel my_channel.py",
)
def new(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="line|grid|SYSTEM|agent|model|channel",
            help="line, grid, or a system whose first drone is the template of all drones. "
            "With FILE: agent, model or channel.",
        ),
    ],
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="The Python file of an agent, a model or an effect of the radio; it works as it is."
        ),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FOLDER", help="Folder of the new system; must not exist.")
    ] = None,
    drones: Annotated[
        int | None,
        typer.Option(metavar="N", help="How many.", show_default="the rows of poses, else the FMUs of --vehicle"),
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="line|grid|ring|v|random|POSES.csv",
            help="Where they start; a CSV file has the columns north and east (m), and may have down and name.",
            show_default="line for line, else grid",
        ),
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(metavar="FMUS", help=f"Other vehicles: {_FLEET}.", show_default="the scenario's")
    ] = None,
    autopilot: Annotated[
        str | None, typer.Option(metavar="FMUS", help="Other autopilots, likewise.", show_default="the scenario's")
    ] = None,
    agent: Annotated[
        str | None, typer.Option(metavar="FMUS", help="Other agents, likewise.", show_default="the scenario's")
    ] = None,
    fmus: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder with the FMUs of vehicle, autopilot and agent; models given by name are searched here first.",
            show_default="fmus where it holds all three, else the FMUs that come with uav-cosim",
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Metres between neighbours at the start; in line and grid twice as much before a drone that stays.",
            show_default="10",
            callback=positive("--spacing", "a distance in m"),
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="Of the layout random.", min=0, show_default="1")
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Stop time of the new system in s.",
            show_default="when a line has spread, else the scenario's",
            callback=positive("--until", "a stop time in s"),
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a system of many drones, or a starting point for an agent, a model or an effect of the radio."""
    from cosim_master.system.authoring.swarm.new import SHAPES, fleet_of, new_system, number_of_drones

    if file is not None:
        own: dict[str, object] = {
            "-o": folder,
            "--drones": drones,
            "--layout": layout,
            "--vehicle": vehicle,
            "--autopilot": autopilot,
        }
        own |= {"--agent": agent, "--fmus": fmus, "--until": until, "--spacing": spacing, "--seed": seed}
        if given_too := [name for name, value in own.items() if value is not None]:
            raise usage(f"new: {given_too[0]} belongs to a new system; with FILE ({file}), leave it out")
        _new_model(scenario, file, as_json=as_json)
        return
    if folder is None:
        raise usage("new: give -o FOLDER for the new system, or the FILE of an agent, a model or a channel")
    if seed is not None and layout != "random":
        raise usage("--seed belongs to --layout random, which is not given")
    if spacing is not None and layout is not None and Path(layout).is_file():
        raise usage(f"--spacing: {layout} has the positions themselves; leave it out")
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"writing {folder}")
        given = {"vehicle": vehicle, "autopilot": autopilot, "agent": agent}
        fleet = {part: fleet_of(text) for part, text in given.items() if text is not None}
        number = number_of_drones(drones, layout, fleet)
        written = new_system(
            scenario,
            number,
            folder,
            fmus=_own_fmus() if fmus is None and scenario in SHAPES else fmus,
            layout=layout,
            fleet=fleet,
            spacing=10.0 if spacing is None else spacing,
            seed=1 if seed is None else seed,
            until=until,
            note=note,
        )
        doing.end()
        if as_json:
            print_json({"files": [str(written)]})
        else:
            shape = f"{scenario}, {layout}" if layout is not None else scenario
            say(f"{written}: {shape} of {number} drones; {command('run', written)}")


def _new_model(kind: str, file: Path, *, as_json: bool) -> None:
    from cosim_master.system.authoring.scaffold import commands_of, new_model

    with errors(as_json=as_json):
        name = new_model(kind, file)
        if as_json:
            print_json({"files": [str(file)]})
            return
        say(f"{file}: {name}")
        for command in commands_of(file):
            say(f"    {command}")


def _own_fmus() -> Path | None:
    """Returns the folder fmus, if it contains all parts of a drone."""
    from cosim_master.system.authoring.swarm.new import parts

    return Path("fmus") if all(Path("fmus", file).is_file() for file in parts().values()) else None


@verb("convert mm.json -o tanks", "convert tanks --for libcosim -o tanks-osp")
def convert(
    system: Annotated[
        str,
        typer.Argument(
            metavar="SYSTEM",
            help="A multi-model (.json), an OspSystemStructure.xml or a project of MasterSim (.msim); "
            "with --for any system.",
        ),
    ],
    folder: NewFolder,
    engine: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="omsimulator|libcosim|ecos|fmpy",
            help="Write what this engine reads.",
            show_default="uav-cosim",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a multi-model, a structure of OSP or a project of MasterSim as an SSP, or any system for another engine."""
    from cosim_master.system.authoring.convert import ENGINES
    from cosim_master.system.authoring.convert import convert as convert_system

    if engine is not None and engine not in ENGINES:
        raise usage(f"--for {engine}: valid: {', '.join(ENGINES)}")
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"converting {system}")
        written = convert_system(system, folder, engine)
        doing.end()
        if as_json:
            print_json({"files": [str(written.file)], "notes": list(written.notes)})
            return
        for text in written.notes:
            note(text)
        say(f"{folder}: {command('run', folder)}" if engine is None else f"{written.file}: for {engine}")


@verb("swap line5 drone3.vehicle Hexarotor -o swapped")
def swap(
    system: System,
    component: Annotated[
        str,
        typer.Argument(
            metavar="COMPONENT", help="Hierarchical name or pattern, e.g. drone3.vehicle or 'drone*.vehicle'."
        ),
    ],
    fmu: Annotated[
        Path,
        typer.Argument(metavar="FMU", help="The FMU it gets: a file, or a model in the folder fmus or of uav-cosim."),
    ],
    new: Annotated[Path | None, typer.Option("-o", "--out", metavar="SYSTEM", help="The new system.")] = None,
    in_place: Annotated[bool, typer.Option("--in-place", help="Change the system itself.", show_default=False)] = False,
    as_json: Json = False,
) -> None:
    """Give a component another FMU; parts that do not accept it are swapped too, nothing else changes."""
    from cosim_master.system.authoring.swap import swap as swap_component

    if (new is None) != in_place:
        raise usage("swap: give either -o SYSTEM for a new system, or --in-place to change this one")
    with errors(as_json=as_json), activity() as doing:
        doing.stage(f"checking {system}")
        notes: list[str] = []
        written = swap_component(system, component, fmu, new, notes.append)
        doing.end()
        if as_json:
            print_json({"files": [str(written)], "notes": notes})
        else:
            for text in notes:
                note(text)
            say(f"{written}: {component} is now {fmu}")
