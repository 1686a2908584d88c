"""Writes swarms of any size: drones like those of a scenario, in a layout, with one description per kind of drone.

The result is an ordinary system folder (`swarm`). It can be edited, and its parts can be swapped; it contains
no trace of being generated. The scenarios "line" and "grid" take the parts of a drone from the shipped system `line5`;
any other scenario is a system, whose first drone is the pattern (`scenario`).

Agents that follow a law on a line which runs east (`cosim.verdict.Formation`) have the next drones to west and east as
neighbours: on the line, in each row of the grid, or otherwise among all drones. Information passes one neighbour per
step. With a gain g of the law, the error of a section with m gaps between two stationary drones shrinks by 1 - 2 g (1 -
cos(pi / m)) per step, so fifty drones in one section would take thousands of steps. Long lines therefore consist of
sections with at most five gaps. In lines and grids, drones start `spacing` apart, but stationary drones are twice as
far from their western neighbour; the other drones spread evenly between them.

A system id of MAVLink has one byte, so ids repeat every 250 drones. The topologies for laws on a line are local: drones
with equal ids are never in reach of the same node.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias
from urllib.parse import unquote

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi.description.read import FmuDescription, describe
from cosim_master.system import shipped
from cosim_master.system.authoring.fitting import OWN, own_start
from cosim_master.system.authoring.swarm.drone import Declared, Drone, declared, described, found_fmu, wired_by_name
from cosim_master.system.authoring.swarm.layouts import LAYOUTS, Pose, laid_out, poses_of_file
from cosim_master.system.authoring.swarm.scenario import Scenario, scenario_of
from cosim_master.system.authoring.swarm.swarm import Swarm
from cosim_master.system.formation import Member, rate

__all__ = ["SHAPES", "Fleet", "fleet_of", "new_system", "number_of_drones", "parts"]

SHAPES = ("line", "grid")
"""Scenarios that are not systems: layouts of drones with the parts of `_DRONE`."""
_SECTION = 5
"""Largest number of gaps between two stationary drones."""
_SETTLED = 0.05
_DRONE = ("line5", "drone.ssd")
"""The shipped system, and its document, that provide the parts of a drone."""
_NETWORK = {"latency": "0.02", "seed": "1"}
Fleet: TypeAlias = Mapping[str, Sequence[str]]
"""FMUs by name of the part that they replace: the first drone uses the first one, and so on, cyclically."""


def parts() -> dict[str, str]:
    """Returns the components of a drone, and the names of their FMU files."""
    components = etree.parse(str(shipped.document(*_DRONE))).iter("{*}Component")
    return {one.get("name", ""): PurePosixPath(unquote(one.get("source", ""))).name for one in components}


def fleet_of(text: str) -> tuple[str, ...]:
    """Returns the FMUs of a text such as "4xFIRST,1xSECOND": four times the first, then the second.

    Raises:
        SystemDescriptionError: the text is not such a list.
    """
    found: list[str] = []
    for item in text.split(","):
        match = re.fullmatch(r"\s*(?:([1-9][0-9]{0,5})x)?(\S(?:.*\S)?)\s*", item)
        if match is None:
            raise _refusal(text, "is not a list of FMUs, files or models, such as 4xFIRST,1xSECOND")
        found += [match[2]] * int(match[1] or 1)
    return tuple(found)


def number_of_drones(drones: int | None, layout: str | None, fleet: Fleet) -> int:
    """Returns the number of drones: `drones`, or the rows of a file of poses, or the longest list of FMUs.

    Raises:
        SystemDescriptionError: nothing specifies the number, the file does not exist, or has another number of rows.
    """
    if drones is None and layout is not None and not _is_layout(layout):
        raise _refusal(layout, _no_layout(layout))
    is_file = layout is not None and layout not in LAYOUTS and Path(layout).is_file()
    rows = len(poses_of_file(Path(str(layout)))) if is_file else None
    if rows is not None and drones not in (None, rows):
        raise _refusal(str(layout), f"has {rows} rows, and --drones says {drones}: leave it out")
    longest = max((len(files) for files in fleet.values() if len(files) > 1), default=None)
    number = drones if drones is not None else rows if rows is not None else longest
    if number is None:
        raise _refusal("--drones", "is missing: say how many drones the system is to have")
    return number


def new_system(
    scenario: str,
    drones: int,
    folder: Path,
    *,
    fmus: Path | None = None,
    layout: str | None = None,
    fleet: Fleet | None = None,
    spacing: float = 10.0,
    seed: int = 1,
    until: float | None = None,
    note: Callable[[str], None] | None = None,
) -> Path:
    """Writes a system of `drones` drones.

    Args:
        scenario: "line" (west to east; the ends and in long lines every fifth drone or so stay, the others spread
            evenly by consensus), "grid" (rows of a square, each a line of its own, `spacing` m apart), or a system
            whose first drone is the pattern: a file, a folder or the name of a shipped one.
        drones: number of drones; at least 3 if their law is one on a line.
        folder: the folder to write, which must not exist.
        fmus: folder with the FMUs of `parts` and of models; None: the FMUs of the scenario.
        layout: one of `LAYOUTS`, or a CSV file in the format of `poses_of_file`; None: that of the scenario, or "grid".
        fleet: FMUs that replace parts of the drones.
        spacing: distance between neighbours at the start, m; in lines and grids of a law on a line, it is doubled
            before a stationary drone, so that the drones have to spread.
        seed: seed of the layout "random".
        until: stop time of the DefaultExperiment, s; None: the time at which the errors of a law on a line have
            decreased to 5 %, or otherwise the scenario's.
        note: called with the convergence of the law, with the omitted parts of the scenario, and with its values that
            FMUs of the drones lack.

    Returns:
        The folder.

    Raises:
        SystemDescriptionError: too few drones are requested, the folder exists, or an FMU or `fmus` is missing, or
            an FMU lacks declarations.
    """
    problems = _problems(scenario, drones, folder, spacing, layout)
    if scenario not in SHAPES and fmus is not None and not fmus.is_dir():  # of a shape, each file is missed by name
        problems.append(Problem(Where(str(fmus)), "no such folder; --fmus is the folder of the FMUs of models"))
    pattern = _pattern(scenario, fmus, problems)
    given: list[dict[str, Any]] = [
        {part: files[i % len(files)] for part, files in (fleet or {}).items()} for i in range(drones)
    ]
    kinds = _kinds(pattern.drone, given, fmus or OWN)
    shape = layout or (scenario if scenario in SHAPES else "grid")
    on_a_line = [kind.formation is not None for kind in kinds]
    if any(on_a_line) and sum(on_a_line) < 3:
        raise _refusal("--drones", _TOO_FEW.format(sum(on_a_line)))
    rows = _rows(shape, drones, spacing, seed, on_a_line)
    steered = next((kind for kind in kinds if kind.formation is not None), None)
    if steered is not None:
        law = _law(steered, pattern.drone, rows)
        if note is not None:
            note(_told(law, spacing if shape in SHAPES and all(on_a_line) else None))
        if until is None:
            until = math.ceil(law.settled / 10.0) * 10.0
    swarm = Swarm(folder.name, like=pattern, stop_time=until, fmus=fmus or OWN)
    names = {
        row.number: swarm.add(row.pose.name, position=row.position(), stays=row.stays, **own)
        for row, own in zip(rows, given, strict=True)
    }
    for row in rows:
        if row.right:
            swarm.connect(names[row.number], names[row.right])
    for text in (*swarm.notes, *_kept(scenario, pattern.drone, fleet or {}, fmus or OWN)):
        if note is not None:
            note(text)
    return swarm.save(folder)


_TOO_FEW = "{} drones are too few: give 3 or more, two that stay and one between them"


def _refusal(about: str, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(about), text)])


def _problems(scenario: str, drones: int, folder: Path, spacing: float, layout: str | None) -> list[Problem]:
    """Returns the problems of a request that do not depend on the FMUs."""
    problems = []
    if scenario not in SHAPES and not Path(scenario).exists() and scenario not in shipped.names():
        valid = ", ".join((*SHAPES, *shipped.names()))
        problems.append(Problem(Where(scenario), f"is not a scenario; valid: {valid}, or a system of your own"))
    least = 3 if scenario in SHAPES else 1
    if drones < least:
        text = _TOO_FEW.format(drones) if least == 3 else f"{drones} drones are too few: give 1 or more"
        problems.append(Problem(Where("--drones"), text))
    if folder.exists():
        problems.append(Problem(Where(str(folder)), "exists already"))
    if not spacing > 0.0:
        problems.append(Problem(Where("--spacing"), f"{spacing:g} m: must be positive"))
    if layout is not None and not _is_layout(layout):
        problems.append(Problem(Where(layout), _no_layout(layout)))
    return problems


def _is_layout(layout: str) -> bool:
    return layout in LAYOUTS or Path(layout).is_file()


def _no_layout(layout: str) -> str:
    what = "no such file" if Path(layout).suffix else "is not a layout"
    return f"{what}; valid: {', '.join(LAYOUTS)}, or a CSV file with the columns north and east"


# ---- the pattern of a drone ---------------------------------------------------------------------------------------


def _pattern(scenario: str, fmus: Path | None, problems: list[Problem]) -> Scenario:
    """Returns the scenario whose drone is the pattern of all others.

    Raises:
        SystemDescriptionError: `problems` is not empty, or FMUs are missing or lack declarations.
    """
    if scenario not in SHAPES:
        if problems:
            raise SystemDescriptionError(problems)
        return scenario_of(scenario)
    if fmus is None:
        for file in parts().values():
            shipped.fmu(PurePosixPath(file).stem)  # built, if it was not yet
    folder = shipped.fmus() if fmus is None else fmus
    found: dict[str, FmuDescription] = {}
    for part, file in parts().items():
        try:
            found[part] = describe(folder / file)
        except SystemDescriptionError as error:
            if (folder / file).exists():
                problems += error.problems
            else:
                text = f"no such file; try uav-cosim build {PurePosixPath(file).stem}"
                problems.append(Problem(Where(str(folder / file)), text))
    if problems:
        raise SystemDescriptionError(problems)
    _check_declared(found, folder)
    return Scenario(wired_by_name(found), _NETWORK, (), None)


def _check_declared(fmus: Mapping[str, FmuDescription], folder: Path) -> None:
    """Raises SystemDescriptionError if the FMUs lack declarations of parameters that a new system sets."""
    has = declared(fmus)
    law = has.formation
    missing = [
        what
        for what, there in (
            ("StartPosition", bool(has.start)),
            ("SystemId", bool(has.system_ids)),
            (
                "Formation (with two neighbours, stays, begin and period)",
                law is not None and bool(law.stays and law.begin and law.period),
            ),
        )
        if not there
    ]
    if missing:
        names = ", ".join(fmu.path.name for fmu in fmus.values())
        text = f"{names} must declare one {' and one '.join(missing)} (docs/verdict.md); build them anew"
        raise SystemDescriptionError([Problem(Where(str(folder)), text)])


def _kinds(drone: Drone, given: Sequence[Mapping[str, str]], folder: Path) -> list[Declared]:
    """Returns the declarations of each drone, with the FMUs that replace those of the pattern."""
    files = {name: found_fmu(name, folder) for own in given for name in own.values()}
    fmus = described(files)
    known: dict[tuple[tuple[str, str], ...], Declared] = {}
    found = []
    for own in given:
        key = tuple(own.items())
        if key not in known:
            known[key] = declared({**drone.fmus, **{part: fmus[name] for part, name in own.items()}})
        found.append(known[key])
    return found


def _kept(scenario: str, drone: Drone, fleet: Fleet, folder: Path) -> Iterator[str]:
    """Yields notes on values that the scenario has for its own FMUs, which the replacing ones would have otherwise."""
    new = described({name: found_fmu(name, folder) for files in fleet.values() for name in files})
    parameters = [(b.prefix + p.name, p.value) for b in drone.system.parameter_bindings for p in b.parameters]
    for part, files in fleet.items():
        for path, value in parameters:
            owner, _, name = path.partition(".")
            for file in dict.fromkeys(files if owner == part and part in drone.fmus else ()):
                if (own := own_start(name, value, drone.fmus[part], new[file])) is not None:
                    yield f"{path} stays {value}, as {scenario} has it; {new[file].path.name} alone has {own}"


# ---- positions and neighbours -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Row:
    """One drone: its number (from 1), start position, neighbours' numbers (0: none), and whether it is stationary."""

    number: int
    pose: Pose
    left: int = 0
    right: int = 0
    stays: bool = False

    def position(self) -> tuple[float, ...]:
        """North, east and, unless it is 0, down."""
        horizontal = (self.pose.north, self.pose.east)
        return (*horizontal, self.pose.down) if self.pose.down else horizontal


def _rows(shape: str, drones: int, spacing: float, seed: int, steered: Sequence[bool]) -> list[_Row]:
    """Returns the drones of a layout; `steered`: whether each of them follows a law on a line."""
    if shape in SHAPES and all(steered):
        return list(_line(drones, spacing) if shape == "line" else _grid(drones, spacing))
    poses = laid_out(shape, drones, spacing, seed) if shape in LAYOUTS else poses_of_file(Path(shape))
    rows = [_Row(i + 1, pose) for i, pose in enumerate(poses)]
    chain = sorted((i for i in range(drones) if steered[i]), key=lambda i: (poses[i].east, i))
    stays = {0, *accumulate(_sections(len(chain)))} if chain else set()
    for place, i in enumerate(chain):
        left = chain[place - 1] + 1 if place else 0
        right = chain[place + 1] + 1 if place + 1 < len(chain) else 0
        rows[i] = replace(rows[i], left=left, right=right, stays=place in stays)
    return rows


def _sections(drones: int) -> list[int]:
    """Returns the number of gaps between each stationary drone of a line and the next."""
    gaps = drones - 1
    sections = max(1, -(-gaps // _SECTION))
    return [gaps // sections + (i < gaps % sections) for i in range(sections)]


def _line(drones: int, spacing: float, first: int = 1, north: float = 0.0) -> Iterator[_Row]:
    """Returns `drones` drones on a line, from west to east."""
    stays = {0, *accumulate(_sections(drones))}
    east = 0.0
    for i in range(drones):
        left = 0 if i == 0 else first + i - 1
        right = 0 if i == drones - 1 else first + i + 1
        east += 0.0 if i == 0 else 2.0 * spacing if i in stays else spacing
        yield _Row(first + i, Pose(north, east), left, right, i in stays)


def _grid(drones: int, spacing: float) -> Iterator[_Row]:
    """Returns lines of about the square root of `drones`, from south to north, each with at least three drones."""
    side = max(3, round(drones**0.5))
    sizes = [side] * (drones // side)
    rest = drones - sum(sizes)
    for i in range(rest):
        sizes[i % len(sizes)] += 1
    for i, size in enumerate(sizes):
        yield from _line(size, spacing, first=sum(sizes[:i]) + 1, north=spacing * i)


# ---- convergence --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Law:
    """The convergence of the slowest section of a line: factor per step, and the time [s] at which its error is 5 %."""

    gaps: int
    rate: float
    steps: int
    period: float
    settled: float


def _law(kind: Declared, drone: Drone, rows: Sequence[_Row]) -> _Law:
    """Returns the expected convergence of the declared law, with parameters of the agents and of the pattern."""
    law, agent = kind.formation, drone.fmus[kind.part]
    assert law is not None
    set_ = {one.name: one.value for binding in drone.system.parameter_bindings for one in binding.parameters}

    def start(of: float | str) -> float:
        if not isinstance(of, str):
            return of
        variable = agent.variables.get(of)
        own = None if variable is None else variable.start
        return float(set_.get(f"{kind.part}.{of}", own) or 0.0)

    period, first = start(law.period), start(law.begin)
    gaps = longest = 0
    for row in rows:
        gaps = 0 if row.left == 0 else gaps + 1
        longest = max(longest, gaps)
        gaps = 0 if row.stays else gaps
    west, east = (float(start(one.gain)) for one in law.neighbours)
    members = [Member(row.number, ((row.left, west), (row.right, east)), row.stays) for row in rows]
    left_by_a_step = rate(members)
    steps = math.ceil(math.log(_SETTLED) / math.log(left_by_a_step)) if 0.0 < left_by_a_step < 1.0 else 1
    return _Law(longest, left_by_a_step, steps, period, first + steps * period)


def _told(law: _Law, spacing: float | None) -> str:
    """Returns the expected convergence in words; `spacing` is None in layouts that are not lines."""
    how_fast = (
        f"a step of {law.period:g} s leaves at most {law.rate:.3f} of the error, {law.steps} steps leave 5 % "
        f"(at {law.settled:.0f} s)"
    )
    if spacing is None:
        return f"drones spread evenly from west to east between those that stay: {how_fast}"
    even = spacing * (law.gaps + 1) / law.gaps
    return (
        f"drones start {spacing:g} m apart, {2 * spacing:g} m before one that stays, and spread to {even:.4g} m where "
        f"{law.gaps} gaps lie between two that stay: {how_fast}"
    )
