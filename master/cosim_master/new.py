"""Systems written for the user: a line or a grid of N drones, each described once.

What is written is an ordinary system folder: `drone.ssd` (vehicle, autopilot, agent and their connections), to which
every drone's component refers, a root SSD with the network, and one .ssv with what differs between drones. Edit it,
swap parts of it; nothing remembers that it was generated.

A system id of MAVLink has one byte, so ids repeat every 250 drones. The topologies written here are local: nobody
hears two drones of one id.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmu import FmuDescription, describe

__all__ = ["SHAPES", "new_system"]

SHAPES = ("line", "grid")
_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_OURS = "https://uav-cosim.org/ns/1"
_RECORDED_EVERY = "0.1"
"""s; every base step of thousands of drones would be a flood."""
_IDS = 250
_MODELS = {"vehicle": "Quadrotor", "autopilot": "Autopilot", "agent": "LineAgent"}


def new_system(
    shape: str, drones: int, folder: Path, *, fmus: Path, spacing: float = 10.0, until: float = 60.0
) -> Path:
    """Write a system of `drones` drones.

    Args:
        shape: "line" (west to east; the ends stay, the others spread evenly by consensus) or "grid" (rows of a square,
            each a line of its own, `spacing` m apart).
        drones: how many; at least 3.
        folder: where; must not exist.
        fmus: folder with Quadrotor.fmu, Autopilot.fmu and LineAgent.fmu.
        spacing: m between neighbours at the start; on a line, the first half of the drones starts at half of it, so
            that there is something to spread.
        until: stop time of the DefaultExperiment, s.

    Returns:
        The folder.

    Raises:
        SystemDescriptionError: too few drones, the folder exists, or an FMU is missing or lacks a port.
    """
    problems = []
    if shape not in SHAPES:
        problems.append(Problem(Where(shape), f"is no shape: there are {', '.join(SHAPES)}"))
    if drones < 3:
        problems.append(Problem(Where("--drones"), f"{drones}: two that stay and one that moves are the least"))
    if folder.exists():
        problems.append(Problem(Where(str(folder)), "exists already"))
    if not spacing > 0.0:
        problems.append(Problem(Where("--spacing"), f"{spacing:g} m: must be positive"))
    described: dict[str, FmuDescription] = {}
    for role, model in _MODELS.items():
        try:
            described[role] = describe(fmus / f"{model}.fmu")
        except (SystemDescriptionError, OSError) as error:
            problems.append(Problem(Where(str(fmus / f"{model}.fmu")), f"{error} (build FMUs with `uav-cosim build`)"))
    if problems:
        raise SystemDescriptionError(problems)
    folder.mkdir(parents=True)
    name = folder.name
    (folder / "drone.ssd").write_bytes(_drone(described, folder, fmus))
    rows = _line(drones, spacing) if shape == "line" else _grid(drones, spacing)
    (folder / "drones.ssv").write_bytes(_parameters(name, rows))
    (folder / "SystemStructure.ssd").write_bytes(_root(name, drones, rows, until))
    return folder


# ---- who stands where, and who listens to whom --------------------------------------------------------------------


class _Drone:
    """One row of the table: number from 1, start (north, east, m), neighbours' numbers (0: none), whether it stays."""

    __slots__ = ("east", "left", "north", "number", "right", "stubborn")

    def __init__(self, number: int, north: float, east: float, left: int, right: int) -> None:
        self.number, self.north, self.east, self.left, self.right = number, north, east, left, right
        self.stubborn = left == 0 or right == 0


def _line(drones: int, spacing: float, first: int = 1, north: float = 0.0) -> list[_Drone]:
    """`drones` on a line: the ends where they belong, the western half of the others bunched up."""
    rows = []
    for i in range(drones):
        end = i in (0, drones - 1)
        east = spacing * i if end or i > drones // 2 else 0.5 * spacing * i
        left = 0 if i == 0 else first + i - 1
        right = 0 if i == drones - 1 else first + i + 1
        rows.append(_Drone(first + i, north, east, left, right))
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


def _system_id(number: int) -> int:
    return (number - 1) % _IDS + 1 if number else 0


# ---- documents ----------------------------------------------------------------------------------------------------


def _document(root: etree._Element) -> bytes:
    etree.indent(root)
    return etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _ports(fmu: FmuDescription, causality: str) -> list[str]:
    return [v.name for v in fmu.variables.values() if v.causality == causality and v.packet_capacity is None]


def _drone(fmus: dict[str, FmuDescription], folder: Path, where: Path) -> bytes:
    """drone.ssd: connects every input of vehicle and autopilot to the other's output of the same name."""
    root = etree.Element(f"{{{_SSD}}}SystemStructureDescription", nsmap={"ssd": _SSD}, name="drone", version="1.0")
    system = etree.SubElement(root, f"{{{_SSD}}}System", name="drone")
    elements = etree.SubElement(system, f"{{{_SSD}}}Elements")
    wires: list[tuple[str, str, str]] = []
    for role, other in (("vehicle", "autopilot"), ("autopilot", "vehicle")):
        offered = set(_ports(fmus[other], "output"))
        wires += [(other, role, name) for name in _ports(fmus[role], "input") if name in offered]
    for role, model in _MODELS.items():
        file = os.path.relpath(where.resolve() / f"{model}.fmu", folder.resolve())
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
                etree.SubElement(connectors, f"{{{_SSD}}}Connector", name=name, kind=kind)
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
    return _document(root)


def _parameters(name: str, rows: Iterable[_Drone]) -> bytes:
    root = etree.Element(f"{{{_SSV}}}ParameterSet", nsmap={"ssv": _SSV}, name=name, version="1.0")
    parameters = etree.SubElement(root, f"{{{_SSV}}}Parameters")

    def put(path: str, kind: str, value: str) -> None:
        parameter = etree.SubElement(parameters, f"{{{_SSV}}}Parameter", name=path)
        etree.SubElement(parameter, f"{{{_SSV}}}{kind}", value=value)

    for row in rows:
        drone = f"drone{row.number}"
        put(f"{drone}.vehicle.position_start[1]", "Real", repr(row.north))
        put(f"{drone}.vehicle.position_start[2]", "Real", repr(row.east))
        put(f"{drone}.autopilot.SYSID_THISMAV", "Integer", str(_system_id(row.number)))
        put(f"{drone}.agent.sysid", "Integer", str(_system_id(row.number)))
        put(f"{drone}.agent.left_sysid", "Integer", str(_system_id(row.left)))
        put(f"{drone}.agent.right_sysid", "Integer", str(_system_id(row.right)))
        put(f"{drone}.agent.stubborn", "Boolean", str(row.stubborn).lower())
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
