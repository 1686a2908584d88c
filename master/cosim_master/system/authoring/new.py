"""Systems written for the user: a line or a grid of N drones, each described once.

What is written is an ordinary system folder: `drone.ssd` (vehicle, autopilot, agent and their connections), to which
every drone's component refers, a root SSD with the network, and one .ssv with what differs between drones. Edit it,
swap parts of it; nothing remembers that it was generated.

The parts of a drone are those of the shipped system `line5`. Which of their parameters say where a drone starts, which
system ids it and its neighbours have, and whether it stays, the FMUs declare (`cosim.verdict`).

Drones start `spacing` apart, but those that stay are twice as far from their western neighbour; the others spread
evenly between them. News passes one neighbour per step: with a gain g of the law, the error of a section with m gaps
between two drones that stay shrinks by 1 - 2 g (1 - cos(pi / m)) per step, and fifty drones in one section would take
thousands of steps. Long lines therefore consist of sections with at most five gaps.

A system id of MAVLink has one byte, so ids repeat every 250 drones. The topologies written here are local: nobody
hears two drones of one id.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, permutations
from pathlib import Path, PurePosixPath
from urllib.parse import quote, unquote

from lxml import etree

from cosim.verdict import Formation, Role
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription, Variable, describe
from cosim_master.fmi.description.units import BASE_UNITS
from cosim_master.system import shipped
from cosim_master.system.formation import Member, formation_of, rate

__all__ = ["SHAPES", "new_system", "parts"]

SHAPES = ("line", "grid")
_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_OURS = "https://uav-cosim.org/ns/1"
_RECORDED_EVERY = "0.1"
"""s; every base step of thousands of drones would be a flood."""
_IDS = 250
_SECTION = 5
"""Gaps between two drones that stay, at most."""
_SETTLED = 0.05
_DRONE = ("line5", "drone.ssd")
"""The shipped system and its document from which the parts of a drone are taken."""


def parts() -> dict[str, str]:
    """Returns the components of a drone, and the names of their FMU files."""
    components = etree.parse(str(shipped.document(*_DRONE))).iter("{*}Component")
    return {one.get("name", ""): PurePosixPath(unquote(one.get("source", ""))).name for one in components}


def new_system(
    shape: str,
    drones: int,
    folder: Path,
    *,
    fmus: Path,
    spacing: float = 10.0,
    until: float | None = None,
    note: Callable[[str], None] | None = None,
) -> Path:
    """Write a system of `drones` drones.

    Args:
        shape: "line" (west to east; the ends and in long lines every fifth drone or so stay, the others spread evenly
            by consensus) or "grid" (rows of a square, each a line of its own, `spacing` m apart).
        drones: how many; at least 3.
        folder: where; must not exist.
        fmus: folder with the FMUs of `parts`.
        spacing: m between neighbours at the start; before a drone that stays, twice as much, so that there is
            something to spread.
        until: stop time of the DefaultExperiment, s; None: when errors have come down to 5 %.
        note: is told, in words, how fast the law converges.

    Returns:
        The folder.

    Raises:
        SystemDescriptionError: too few drones, the folder exists, or an FMU is missing or declares too little.
    """
    problems = []
    if shape not in SHAPES:
        problems.append(Problem(Where(shape), f"is not a shape; valid: {', '.join(SHAPES)}"))
    if drones < 3:
        problems.append(
            Problem(
                Where("--drones"), f"{drones} drones are too few: give 3 or more, two that stay and one between them"
            )
        )
    if folder.exists():
        problems.append(Problem(Where(str(folder)), "exists already"))
    if not spacing > 0.0:
        problems.append(Problem(Where("--spacing"), f"{spacing:g} m: must be positive"))
    described: dict[str, FmuDescription] = {}
    for part, file in parts().items():
        try:
            described[part] = describe(fmus / file)
        except SystemDescriptionError as error:
            if (fmus / file).exists():
                problems += error.problems
            else:
                text = f"no such file; try uav-cosim build {PurePosixPath(file).stem}"
                problems.append(Problem(Where(str(fmus / file)), text))
    if problems:
        raise SystemDescriptionError(problems)
    declared = _declared(described, fmus)
    folder.mkdir(parents=True)
    name = folder.name
    (folder / "drone.ssd").write_bytes(_drone(described, folder, fmus))
    rows = _line(drones, spacing) if shape == "line" else _grid(drones, spacing)
    law = _law(declared, rows)
    if note is not None:
        note(_told(law, spacing))
    until = math.ceil(law.settled / 10.0) * 10.0 if until is None else until
    (folder / "drones.ssv").write_bytes(_parameters(name, declared, rows))
    (folder / "SystemStructure.ssd").write_bytes(_root(name, drones, rows, until))
    return folder


# ---- who stands where, and who listens to whom --------------------------------------------------------------------


class _Drone:
    """One row of the table: number from 1, start (north, east, m), neighbours' numbers (0: none), whether it stays."""

    __slots__ = ("east", "left", "north", "number", "right", "stays")

    def __init__(self, number: int, north: float, east: float, left: int, right: int, *, stays: bool) -> None:
        self.number, self.north, self.east, self.left, self.right = number, north, east, left, right
        self.stays = stays


def _sections(drones: int) -> list[int]:
    """How many gaps there are between one drone of a line that stays and the next."""
    gaps = drones - 1
    sections = -(-gaps // _SECTION)
    return [gaps // sections + (i < gaps % sections) for i in range(sections)]


def _line(drones: int, spacing: float, first: int = 1, north: float = 0.0) -> list[_Drone]:
    """`drones` on a line, west to east."""
    stays = {0, *accumulate(_sections(drones))}
    rows = []
    east = 0.0
    for i in range(drones):
        left = 0 if i == 0 else first + i - 1
        right = 0 if i == drones - 1 else first + i + 1
        east += 0.0 if i == 0 else 2.0 * spacing if i in stays else spacing
        rows.append(_Drone(first + i, north, east, left, right, stays=i in stays))
    return rows


def _grid(drones: int, spacing: float) -> list[_Drone]:
    """Lines of about the square root of `drones`, one north of the other; none shorter than three."""
    side = max(3, round(drones**0.5))
    sizes = [side] * (drones // side)
    rest = drones - sum(sizes)
    for i in range(rest):
        sizes[i % len(sizes)] += 1
    rows: list[_Drone] = []
    for i, size in enumerate(sizes):
        rows += _line(size, spacing, first=len(rows) + 1, north=spacing * i)
    return rows


@dataclass(frozen=True, slots=True)
class _Declared:
    """What the parts of a drone declare: paths below a drone of where it starts (north, east, down), and of its id.

    `part`, `agent`: the part that steers by a law on a line; `formation`: its declaration.
    """

    start: tuple[str, ...]
    system_ids: tuple[str, ...]
    part: str
    agent: FmuDescription
    formation: Formation


def _declared(fmus: Mapping[str, FmuDescription], folder: Path) -> _Declared:
    """Raises SystemDescriptionError if the FMUs do not declare all that a new system sets."""
    start: list[str] = []
    ids: list[str] = []
    found: list[tuple[str, FmuDescription, Formation]] = []
    for part, fmu in fmus.items():
        for name, verdict in fmu.verdicts.items():
            if verdict is Role.START_POSITION:
                start += [f"{part}.{element}" for element in elements_of(name, fmu.variables)]
            elif verdict is Role.SYSTEM_ID:
                ids.append(f"{part}.{name}")
        formation = formation_of(fmu.verdicts)
        if formation is not None and len(formation[1].neighbours) == 2 and _is_whole(formation[1]):
            found.append((part, fmu, formation[1]))
    missing = [
        what
        for what, there in (
            ("StartPosition", len(start) == 3),
            ("SystemId", bool(ids)),
            ("Formation (with two neighbours, stays, begin and period)", len(found) == 1),
        )
        if not there
    ]
    if missing:
        names = ", ".join(fmu.path.name for fmu in fmus.values())
        text = f"{names} must declare one {' and one '.join(missing)} (docs/verdict.md); build them anew"
        raise SystemDescriptionError([Problem(Where(str(folder)), text)])
    return _Declared(tuple(start), tuple(ids), *found[0])


def _is_whole(formation: Formation) -> bool:
    return bool(formation.stays and formation.begin and formation.period)


@dataclass(frozen=True, slots=True)
class _Law:
    """How the slowest section of a line converges: per step, and at which time [s] its error is down to 5 %."""

    gaps: int
    rate: float
    steps: int
    period: float
    settled: float


def _law(declared: _Declared, rows: Sequence[_Drone]) -> _Law:
    """What to expect of the law that the agent declares, with its own parameters."""

    def start(of: float | str) -> float:
        return float(declared.agent.variables[of].start or 0.0) if isinstance(of, str) else of

    period, first = start(declared.formation.period), start(declared.formation.begin)
    gaps = longest = 0
    for row in rows:
        gaps = 0 if row.left == 0 else gaps + 1
        longest = max(longest, gaps)
        gaps = 0 if row.stays else gaps
    west, east = (float(start(one.gain)) for one in declared.formation.neighbours)
    members = [Member(row.number, ((row.left, west), (row.right, east)), row.stays) for row in rows]
    left_by_a_step = rate(members)
    steps = math.ceil(math.log(_SETTLED) / math.log(left_by_a_step)) if 0.0 < left_by_a_step < 1.0 else 1
    return _Law(longest, left_by_a_step, steps, period, first + steps * period)


def _told(law: _Law, spacing: float) -> str:
    even = spacing * (law.gaps + 1) / law.gaps
    return (
        f"drones start {spacing:g} m apart, {2 * spacing:g} m before one that stays, and spread to {even:.4g} m where "
        f"{law.gaps} gaps lie between two that stay: a step of {law.period:g} s leaves at most {law.rate:.3f} of the "
        f"error, {law.steps} steps leave 5 % (at {law.settled:.0f} s)"
    )


def _system_id(number: int) -> int:
    return (number - 1) % _IDS + 1 if number else 0


# ---- documents ----------------------------------------------------------------------------------------------------


def _document(root: etree._Element) -> bytes:
    etree.indent(root)
    return etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _ports(fmu: FmuDescription, causality: str) -> list[str]:
    return [v.name for v in fmu.variables.values() if v.causality == causality and v.packet_capacity is None]


def _drone(fmus: dict[str, FmuDescription], folder: Path, where: Path) -> bytes:
    """drone.ssd: connects every input of a part to another part's output of the same name."""
    root = etree.Element(
        f"{{{_SSD}}}SystemStructureDescription", nsmap={"ssd": _SSD, "ssc": _SSC}, name="drone", version="1.0"
    )
    system = etree.SubElement(root, f"{{{_SSD}}}System", name="drone")
    elements = etree.SubElement(system, f"{{{_SSD}}}Elements")
    wires: list[tuple[str, str, str]] = []
    typed: list[Variable] = []
    for role, other in permutations(fmus, 2):
        offered = set(_ports(fmus[other], "output"))
        wires += [(other, role, name) for name in _ports(fmus[role], "input") if name in offered]
    for role, name in parts().items():
        file = os.path.relpath(where.resolve() / name, folder.resolve())
        component = etree.SubElement(
            elements,
            f"{{{_SSD}}}Component",
            name=role,
            type="application/x-fmu-sharedlibrary",
            source=quote(Path(file).as_posix()),
        )
        named = [(name, "output") for source, _, name in wires if source == role]
        named += [(name, "input") for _, target, name in wires if target == role]
        if named:
            connectors = etree.SubElement(component, f"{{{_SSD}}}Connectors")
            for name, kind in named:
                connector = etree.SubElement(connectors, f"{{{_SSD}}}Connector", name=name, kind=kind)
                _type(connector, fmus[role].variables[name])
                typed.append(fmus[role].variables[name])
    connections = etree.SubElement(system, f"{{{_SSD}}}Connections")
    for source, target, name in wires:
        etree.SubElement(
            connections,
            f"{{{_SSD}}}Connection",
            startElement=source,
            startConnector=name,
            endElement=target,
            endConnector=name,
        )
    _definitions(root, typed)
    return _document(root)


def _type(connector: etree._Element, variable: Variable) -> None:
    """The type and unit of a connector as its FMU has them, so that engines that need them can read the file."""
    made = etree.SubElement(connector, f"{{{_SSC}}}{variable.type}")
    if variable.unit is not None:
        made.set("unit", variable.unit.name)
    if variable.type == "Enumeration":
        made.set("name", variable.name)


def _definitions(root: etree._Element, variables: Iterable[Variable]) -> None:
    """What connectors refer to: enumerations, which have the names of their connectors, and units."""
    enumerations = {v.name: v.items for v in variables if v.type == "Enumeration"}
    units = {v.unit.name: v.unit.base for v in variables if v.unit is not None}
    if enumerations:
        holder = etree.SubElement(root, f"{{{_SSD}}}Enumerations")
        for name, items in enumerations.items():
            made = etree.SubElement(holder, f"{{{_SSC}}}Enumeration", name=name)
            for item, value in (items or {}).items():
                etree.SubElement(made, f"{{{_SSC}}}Item", name=item, value=str(value))
    if units:
        holder = etree.SubElement(root, f"{{{_SSD}}}Units")
        for name, base in sorted(units.items()):
            made = etree.SubElement(holder, f"{{{_SSC}}}Unit", name=name)
            if base is None:
                continue
            powers = {one: str(n) for one, n in zip(BASE_UNITS, base.exponents, strict=True) if n}
            numbers = {"factor": repr(base.factor), "offset": repr(base.offset)}
            etree.SubElement(made, f"{{{_SSC}}}BaseUnit", {**powers, **numbers})


def _parameters(name: str, declared: _Declared, rows: Iterable[_Drone]) -> bytes:
    root = etree.Element(f"{{{_SSV}}}ParameterSet", nsmap={"ssv": _SSV}, name=name, version="1.0")
    parameters = etree.SubElement(root, f"{{{_SSV}}}Parameters")

    def put(path: str, kind: str, value: str) -> None:
        parameter = etree.SubElement(parameters, f"{{{_SSV}}}Parameter", name=path)
        etree.SubElement(parameter, f"{{{_SSV}}}{kind}", value=value)

    for row in rows:
        drone = f"drone{row.number}"
        for path, start in zip(declared.start, (row.north, row.east), strict=False):
            put(f"{drone}.{path}", "Real", repr(start))
        for path in declared.system_ids:
            put(f"{drone}.{path}", "Integer", str(_system_id(row.number)))
        for neighbour, number in zip(declared.formation.neighbours, (row.left, row.right), strict=True):
            put(f"{drone}.{declared.part}.{neighbour.id}", "Integer", str(_system_id(number)))
        put(f"{drone}.{declared.part}.{declared.formation.stays}", "Boolean", str(row.stays).lower())
    return _document(root)


def _root(name: str, drones: int, rows: Sequence[_Drone], until: float) -> bytes:
    root = etree.Element(
        f"{{{_SSD}}}SystemStructureDescription", nsmap={"ssd": _SSD, "ssc": _SSC}, name=name, version="1.0"
    )
    system = etree.SubElement(root, f"{{{_SSD}}}System", name=name)
    bindings = etree.SubElement(system, f"{{{_SSD}}}ParameterBindings")
    etree.SubElement(bindings, f"{{{_SSD}}}ParameterBinding", source="drones.ssv")
    elements = etree.SubElement(system, f"{{{_SSD}}}Elements")
    for i in range(1, drones + 1):
        etree.SubElement(
            elements,
            f"{{{_SSD}}}Component",
            name=f"drone{i}",
            type="application/x-ssp-definition",
            source="drone.ssd",
        )
    annotations = etree.SubElement(system, f"{{{_SSD}}}Annotations")
    annotation = etree.SubElement(annotations, f"{{{_SSC}}}Annotation", type="org.uav-cosim.network")
    ours: dict[str, str] = {None: _OURS}  # type: ignore[dict-item]  # lxml's way to name the default namespace
    network = etree.SubElement(
        annotation, f"{{{_OURS}}}network", nsmap=ours, topology="listed", latency="0.02", seed="1"
    )
    for row in rows:
        if row.right:
            etree.SubElement(network, f"{{{_OURS}}}link", between=f"drone{row.number} drone{row.right}")
    annotation = etree.SubElement(annotations, f"{{{_SSC}}}Annotation", type="org.uav-cosim.recording")
    etree.SubElement(annotation, f"{{{_OURS}}}recording", nsmap=ours, interval=_RECORDED_EVERY)
    etree.SubElement(root, f"{{{_SSD}}}DefaultExperiment", startTime="0", stopTime=repr(until))
    return _document(root)
