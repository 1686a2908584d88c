"""Extracts the pattern of a swarm from a system: its first drone, the values common to all drones, its annotations.

A drone of a system is an element of the root that consists of FMUs. Its system id, position and neighbours belong to
the drone; start values common to all drones belong to the scenario. The settings of the radio are kept, except links
and outages, which name drones. However, links that follow the same pattern for all drones, as in a ring, are created
for any number of drones, and a start value that rises evenly from drone to drone continues to rise. FMUs beside the
drones are kept if every drone is connected with them, as with the air around it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.system.authoring.swarm.drone import Drone, bound, declared, parameters_of
from cosim_master.system.authoring.swarm.surroundings import Surroundings, surroundings_of
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import FMU_TYPE, SSP_TYPE, read_system
from cosim_master.system.structure import Annotation, Component, Element, System, SystemStructure, Value

__all__ = ["MONITORS", "NAMESPACE", "NETWORK", "RECORDING", "Scenario", "Ways", "scenario_of"]

NAMESPACE = "https://uav-cosim.org/ns/1"
MONITORS, NETWORK, RECORDING = "org.uav-cosim.monitors", "org.uav-cosim.network", "org.uav-cosim.recording"
"""Types of annotations that a new swarm writes itself."""


@dataclass(frozen=True, slots=True)
class Ways:
    """Links in the same pattern for all drones: each drone is linked to those `steps` places after it.

    `closed`: the first drone follows the last one.
    """

    steps: tuple[int, ...]
    closed: bool

    def between(self, drones: int) -> list[tuple[int, int]]:
        """Returns the links of this number of drones, as pairs of places counted from 0."""
        found: dict[tuple[int, int], None] = {}
        for i in range(drones):
            for step in self.steps:
                j = (i + step) % drones if self.closed else i + step
                if j < drones and j != i and (j, i) not in found:
                    found[i, j] = None
        return list(found)


@dataclass(frozen=True, slots=True)
class Scenario:
    """The parts of a system that a swarm takes over.

    Attributes:
        drone: the first drone, with the start values that all drones of the system have.
        network: attributes of the annotation of the network.
        annotations: annotations of the root system, without network and recording.
        stop_time: s; None if the system names none.
        numbered: paths below a drone of parameters that equal its system id in every drone, without being declared as
            such, since they distinguish drones.
        rising: start values that rise evenly: path below a drone, value of the first drone, rise from drone to drone.
        ways: the links of a listed topology; None if they do not follow the same pattern for all drones.
        notes: the omitted parts, for the user.
        surroundings: the FMUs that all drones share.
    """

    drone: Drone
    network: Mapping[str, str]
    annotations: tuple[Annotation, ...]
    stop_time: float | None
    numbered: tuple[str, ...] = ()
    rising: tuple[tuple[str, float, float], ...] = ()
    ways: Ways | None = None
    notes: tuple[str, ...] = ()
    surroundings: tuple[Surroundings, ...] = ()


def scenario_of(system: str | Path) -> Scenario:
    """Reads a system as a scenario.

    Raises:
        SystemDescriptionError: the system is invalid, has no drones, or has parts that do not belong to a drone.
    """
    with read_system(system) as structure:
        if structure.archives:
            raise SystemDescriptionError([Problem(structure.where, "is an archive: unpack it to a folder first")])
        checked = check(structure)
    drones = [one for one in structure.system.elements if isinstance(_inside(one), System)]
    surroundings = _around(structure, checked, [one.name for one in drones])
    first = drones[0]
    inside = _inside(first)
    assert inside is not None
    bare_inside = _without_ports(inside) if surroundings else inside
    _refuse_what_cannot_be_repeated(first, bare_inside)
    fmus = {
        one.name.removeprefix(f"{first.name}."): one.fmu
        for one in checked.instances
        if one.name.startswith(f"{first.name}.")
    }
    alike = [one.name for one in drones if _inside(one) == inside]
    values, own = _shared(checked, alike, fmus.keys(), _of_each(fmus))
    numbered = tuple(path for path in own if _holds_the_id(checked, alike, fmus, path))
    own = [path for path in own if path not in numbered]
    rising = tuple(one for path in own if (one := _rising(checked, alike, path)) is not None)
    own = [path for path in own if path not in [one[0] for one in rising]]
    bindings = bound(p for path, value in values.items() for p in parameters_of(fmus, path, value))
    bare = [replace(one, parameter_bindings=()) for one in bare_inside.elements]
    drone = Drone(replace(bare_inside, name="drone", elements=tuple(bare), parameter_bindings=bindings), fmus)
    notes = (
        [f"{system}: its drones differ in {', '.join(own)}: the new ones have what their FMUs start with"]
        if own
        else []
    )
    notes += [f"{system}: {path} goes on rising by {step:g} from drone to drone" for path, _, step in rising]
    network, ways, dropped = _network(structure.system, [one.name for one in drones])
    notes += [f"{system}: {dropped} of its network are left out, since they name its drones"] if dropped else []
    kept = tuple(one for one in structure.system.annotations if one.type not in (NETWORK, RECORDING))
    return Scenario(drone, network, kept, structure.stop_time, numbered, rising, ways, tuple(notes), surroundings)


def _around(structure: SystemStructure, checked: CheckedSystem, drones: Sequence[str]) -> tuple[Surroundings, ...]:
    """Returns the FMUs that the drones share.

    Raises:
        SystemDescriptionError: there are no drones, or parts beside them that are no surroundings.
    """
    try:
        if drones:
            return surroundings_of(structure.system, checked, drones)
        lack = "has no drones, systems made of FMUs,"
    except ValueError as error:
        lack = f"has parts beside its drones ({error}) that are not connected as Swarm.environment connects them,"
    text = f"{lack} so that it is not the pattern of a swarm; give a system whose root holds drones alone"
    raise SystemDescriptionError([Problem(structure.where, text)])


def _without_ports(inside: System) -> System:
    """Returns the system of a drone without its own connectors, which lead to its surroundings."""
    outer = [one for one in inside.connections if one.start_element is None or one.end_element is None]
    ends = {(one.start_element, one.start_connector) for one in outer}
    ends |= {(one.end_element, one.end_connector) for one in outer}
    inner = tuple(one for one in inside.connections if one not in outer)
    ends -= {(one.start_element, one.start_connector) for one in inner}
    elements = tuple(
        replace(part, connectors=tuple(one for one in part.connectors if (part.name, one.name) not in ends))
        for part in inside.elements
    )
    return replace(inside, connectors=(), connections=inner, elements=elements)


def _inside(element: Element) -> System | None:
    """Returns the system of a drone; None for an FMU or a dictionary."""
    if isinstance(element, Component):
        return element.content
    return element if isinstance(element, System) else None


def _refuse_what_cannot_be_repeated(first: Element, inside: System) -> None:
    """Raises SystemDescriptionError unless a drone consists of FMUs in separate files that are connected inside it."""
    packed = isinstance(first, Component) and first.type == SSP_TYPE
    parts = [one for one in inside.elements if isinstance(one, Component) and one.type == FMU_TYPE]
    if packed or len(parts) != len(inside.elements) or inside.connectors or inside.signal_dictionaries:
        text = (
            f'"{first.name}" is not the pattern of a drone: it must consist of FMUs alone, without connectors of its '
            "own, and not be an archive"
        )
        raise SystemDescriptionError([Problem(first.where, text)])


def _of_each(fmus: Mapping[str, FmuDescription]) -> set[str]:
    """Returns paths below a drone of parameters that `Swarm` sets for each drone, since their meanings are declared."""
    has = declared(fmus)
    own = {*has.start, *has.system_ids}
    if has.formation is not None:
        names = [one.id for one in has.formation.neighbours] + [has.formation.stays]
        own |= {f"{has.part}.{name}" for name in names}
    return own


def _shared(
    checked: CheckedSystem, drones: Sequence[str], parts: Collection[str], own: Collection[str]
) -> tuple[dict[str, Value], list[str]]:
    """Returns start values common to all these drones, by path below the drone, and the paths of differing ones."""
    starts = {one.name: one.start_values for one in checked.instances}
    tables = [
        {f"{part}.{name}": value for part in parts for name, value in starts[f"{drone}.{part}"].items()}
        for drone in drones
    ]
    paths = dict.fromkeys(path for table in tables for path in table if path not in own)
    shared = {
        path: tables[0][path] for path in paths if all(table.get(path) == tables[0].get(path) for table in tables)
    }
    return shared, [path for path in paths if path not in shared]


def _holds_the_id(checked: CheckedSystem, drones: Sequence[str], fmus: Mapping[str, FmuDescription], path: str) -> bool:
    """Returns whether a parameter is the system id in all these drones."""
    starts = {one.name: one.effective_values() for one in checked.instances}

    def of(drone: str, path: str) -> object:
        part, _, name = path.rpartition(".")
        return starts[f"{drone}.{part}"].get(name)

    ids = declared(fmus).system_ids
    return bool(ids) and len(drones) > 1 and all(of(drone, path) == of(drone, ids[0]) for drone in drones)


def _rising(checked: CheckedSystem, drones: Sequence[str], path: str) -> tuple[str, float, float] | None:
    """Returns path, first value and rise of a Real start value that rises evenly over three drones or more."""
    part, _, name = path.rpartition(".")
    instances = {one.name: one for one in checked.instances}
    values = [instances[f"{drone}.{part}"].start_values.get(name) for drone in drones]
    is_real = instances[f"{drones[0]}.{part}"].fmu.variables[name].type == "Real"
    if len(values) < 3 or not is_real or any(value is None for value in values):
        return None
    numbers = [float(value) for value in values if value is not None]
    rise = numbers[1] - numbers[0]
    even = all(math.isclose(value, numbers[0] + i * rise, abs_tol=1e-9) for i, value in enumerate(numbers))
    return (path, numbers[0], rise) if even else None


def _network(system: System, drones: Sequence[str]) -> tuple[dict[str, str], Ways | None, str]:
    """Returns the network's attributes, with full paths of its files, its links, and its other contents in words."""
    for one in system.annotations:
        if one.type == NETWORK:
            element = one.element.find(f"{{{NAMESPACE}}}network")
            assert element is not None
            children = [child for child in element if isinstance(child.tag, str)]
            links = [child for child in children if child.tag == f"{{{NAMESPACE}}}link"]
            others = len(children) - len(links)
            ways = _ways([dict(link.attrib) for link in links], drones)  # type: ignore[arg-type]
            left = 0 if ways is not None else len(links)
            kinds = [f"{n} {what}" for n, what in ((left, "links"), (others, "other elements")) if n]
            attributes = {str(name): str(value) for name, value in element.attrib.items()}
            for name in {"dialect", "trace", "channel"} & attributes.keys():
                attributes[name] = str((system.document.parent / attributes[name]).resolve())
            return attributes, ways, " and ".join(kinds)
    return {}, None, ""


def _ways(links: Sequence[Mapping[str, str]], drones: Sequence[str]) -> Ways | None:
    """Returns links if they are two-way, set no properties, and follow the same pattern for all drones."""
    place = {name: i for i, name in enumerate(drones)}
    pairs: set[frozenset[int]] = set()
    for link in links:
        ends = link.get("between", "").split()
        if {*link} != {"between"} or not {*ends} <= place.keys():
            return None
        pairs.add(frozenset(place[end] for end in ends))
    found = []
    for closed in (False, True):
        apart = [max(pair) - min(pair) for pair in pairs]
        steps = sorted({min(k, len(drones) - k) if closed else k for k in apart})
        ways = Ways(tuple(steps), closed)
        if pairs and {frozenset(pair) for pair in ways.between(len(drones))} == pairs:
            found.append(ways)
    return min(found, key=lambda ways: len(ways.steps), default=None)
