"""A swarm as SSP: its root system, the documents of its drones, its parameters and annotations."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.system.authoring.swarm.drone import Declared, Drone, component, exposed, wired
from cosim_master.system.authoring.swarm.scenario import MONITORS, NAMESPACE, NETWORK, RECORDING, Ways
from cosim_master.system.authoring.text.documents import system_document
from cosim_master.system.reading.read import ROOT_DOCUMENT, SSD_TYPE
from cosim_master.system.structure import Annotation, Component, Connection, Parameter, ParameterBinding, System

__all__ = [
    "HERE",
    "PARAMETERS",
    "Member",
    "SwarmDescription",
    "attribute",
    "monitor_element",
    "own_parameters",
    "wrong",
]

HERE = Where("")
PARAMETERS = "drones.ssv"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_OURS: dict[str, str] = {None: NAMESPACE}  # type: ignore[dict-item]  # lxml's way to name the default namespace


def wrong(about: str, text: str) -> SystemDescriptionError:
    """Returns the error about a part of a swarm."""
    return SystemDescriptionError([Problem(Where(about), text)])


@dataclass(slots=True)
class Member:
    """A drone, or an FMU of the root.

    `parts`: its FMUs by name of part; one FMU has the name "". `drone`: None for one FMU. `place`: one or more
    coordinates. `numbered`: parameters that tell drones apart. `exposed`: ports (part, element) that are connected to
    others. `inner`: sources (part, element) of inputs (part, element), which are connected inside the drone.
    """

    name: str
    parts: Mapping[str, FmuDescription]
    drone: Drone | None
    declared: Declared
    place: tuple[float, ...]
    id: int
    stays: bool
    numbered: Mapping[str, int]
    values: tuple[Parameter, ...]
    neighbours: list[Member | None] = field(default_factory=lambda: [None, None])
    exposed: list[tuple[str, str]] = field(default_factory=list)
    inner: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SwarmDescription:
    """The contents of a swarm, from which its documents follow.

    Attributes:
        links: pairs of drones with a radio link.
        network: attributes of the annotation of the network.
        topology: the topology that the user has given, None without one.
        ways: the radio links of the scenario, if it lists them.
        annotations: further annotations of the root.
        monitors: elements of monitors beside those of `annotations`.
        stop_time: s.
        recorded_every: s.
    """

    name: str
    members: Sequence[Member]
    links: Sequence[tuple[str, str]]
    connections: Sequence[Connection]
    network: Mapping[str, str]
    topology: float | str | None
    ways: Ways | None
    annotations: Sequence[Annotation]
    stop_time: float | None
    recorded_every: float
    monitors: Sequence[etree._Element] = ()

    def root(self, folder: Path) -> tuple[System, dict[str, Drone]]:
        """Returns the root system as it is in a folder, and the drones by the file that describes them."""
        kinds: dict[str, Drone] = {}
        files: dict[tuple[Any, ...], str] = {}
        elements = []
        for member in self.members:
            if member.drone is None:
                elements.append(component(member.name, member.parts[""], member.exposed))
                continue
            ports = tuple(sorted(member.exposed))
            wires = tuple(sorted((source, target) for target, source in member.inner.items()))
            key = (id(member.drone), ports, wires)
            if key not in files:
                files[key] = self._file(member.drone, kinds)
                kinds[files[key]] = exposed(wired(member.drone, wires), ports)
            inside = kinds[files[key]].system
            place = folder / files[key]
            elements.append(Component(member.name, SSD_TYPE, place, "any", (), (), (), HERE, inside))
        parameters = tuple(one for member in self.members for one in parameters_in(member))
        bindings = (ParameterBinding(parameters, "", HERE),) if parameters else ()
        root = System(
            name=self.name,
            connectors=(),
            parameter_bindings=bindings,
            elements=tuple(elements),
            connections=tuple(self.connections),
            annotations=tuple(self._all_annotations(folder)),
            document=folder / ROOT_DOCUMENT,
            where=HERE,
        )
        return root, kinds

    def _file(self, drone: Drone, kinds: Mapping[str, Drone]) -> str:
        """Returns a name for a drone's document: the first is drone.ssd, others are named after differing parts."""
        if not kinds:
            return "drone.ssd"
        first = next(iter(kinds.values()))
        others = [fmu.path.stem for part, fmu in drone.fmus.items() if first.fmus.get(part) is not fmu]
        stem = "-".join(["drone", *others])
        name, number = f"{stem}.ssd", 1
        while name in kinds:
            number += 1
            name = f"{stem}-{number}.ssd"
        return name

    def document(self, root: System, folder: Path) -> bytes:
        times = {"startTime": "0"}
        if self.stop_time is not None:
            times["stopTime"] = repr(float(self.stop_time))
        source = PARAMETERS if root.parameter_bindings else ""
        return system_document(replace(root, parameter_bindings=()), folder, parameters=source, times=times)

    def _all_annotations(self, folder: Path) -> Iterator[Annotation]:
        attributes, links = dict(self.network), list(self.links)
        if links and self.topology is None:
            attributes = {"topology": "listed", **attributes} | {"topology": "listed"}
        topology = attributes.get("topology", "broadcast")
        if topology == "listed" and not links and self.ways is not None:
            drones = [one.name for one in self.members if one.drone is not None]
            links = [(drones[i], drones[j]) for i, j in self.ways.between(len(drones))]
        if topology == "listed" and not links:
            text = "its radio has the topology listed, and no two drones are connected: connect() them, or give another"
            raise wrong(self.name, text)
        if topology != "nearest":
            attributes = {name: text for name, text in attributes.items() if name not in ("axis", "neighbours")}
        for name in ("dialect", "trace", "channel"):
            if Path(attributes.get(name, "")).is_absolute():
                attributes[name] = Path(os.path.relpath(attributes[name], folder.resolve())).as_posix()
        network = _annotation(NETWORK, "network", attributes)
        for first, second in links if topology == "listed" else ():
            etree.SubElement(network.element[0], f"{{{NAMESPACE}}}link", between=f"{first} {second}")
        yield network
        yield _annotation(RECORDING, "recording", {"interval": attribute("recorded_every", self.recorded_every)})
        yield from (one for one in self.annotations if one.type != MONITORS or not self.monitors)
        if self.monitors:
            given = [one.element[0] for one in self.annotations if one.type == MONITORS]
            known = {str(name): str(text) for one in given for name, text in one.attrib.items()}
            monitors = _annotation(MONITORS, "monitors", known)
            monitors.element[0].extend(deepcopy(one) for some in (*given, self.monitors) for one in some)
            yield monitors


def own_parameters(member: Member) -> Iterator[tuple[str, str, float | int | bool]]:
    """Returns path, type and value of the parameters that depend on a member's place in the swarm."""
    for path, coordinate in zip(member.declared.start, member.place, strict=False):
        yield path, "Real", coordinate
    for path in member.declared.system_ids:
        yield path, "Integer", member.id
    for path, number in member.numbered.items():
        yield path, "Integer", number
    law = member.declared.formation
    if law is not None:
        head = f"{member.declared.part}." if member.declared.part else ""
        for neighbour, other in zip(law.neighbours, member.neighbours, strict=True):
            yield head + neighbour.id, "Integer", 0 if other is None else other.id
        if law.stays:
            yield head + law.stays, "Boolean", member.stays


def parameters_in(member: Member) -> Iterator[Parameter]:
    for path, kind, value in own_parameters(member):
        yield Parameter(f"{member.name}.{path}", kind, value, HERE)
    for one in member.values:
        yield Parameter(f"{member.name}.{one.name}", one.type, one.value, HERE)


def _annotation(kind: str, tag: str, attributes: Mapping[str, str]) -> Annotation:
    element = etree.Element(f"{{{_SSC}}}Annotation", {"type": kind}, nsmap={"ssc": _SSC})
    etree.SubElement(element, f"{{{NAMESPACE}}}{tag}", dict(attributes), nsmap=_OURS)
    return Annotation(kind, element, HERE)


def attribute(name: str, value: Any) -> str:
    """Returns a value of Python as the text of an attribute; the parts of a sequence are separated by spaces.

    Args:
        name: of the attribute, for errors.

    Raises:
        SystemDescriptionError: the value is no number, text or sequence of these.
    """
    if isinstance(value, str | os.PathLike):
        return os.fspath(value)
    if isinstance(value, bool | np.bool_):
        return str(value).lower()
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return repr(float(value)).replace("inf", "INF")
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, bytes):
        parts = np.atleast_1d(value) if isinstance(value, np.ndarray) else value
        return " ".join(attribute(name, one) for one in parts)
    raise wrong(name, f"is {value!r}; give a number, a text, or a sequence of these")


def monitor_element(kind: str, signals: Any, attributes: Mapping[str, Any]) -> etree._Element:
    """Returns the element of a monitor; see `Swarm.monitor`."""
    written = {name.rstrip("_"): attribute(f"{kind}: {name}", value) for name, value in attributes.items()}
    element = etree.Element(f"{{{NAMESPACE}}}{kind}", nsmap=_OURS)
    if isinstance(signals, Mapping):
        for name, of in signals.items():
            its = {"of": of} if isinstance(of, str) else dict(of)
            etree.SubElement(element, f"{{{NAMESPACE}}}signal", {"name": name, **its})
    elif text := attribute(f"{kind}: signals", signals):
        written["signals"] = text
    for name, text in written.items():
        element.set(name, text)
    return element
