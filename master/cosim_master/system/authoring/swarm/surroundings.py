"""The ports of an FMU that all drones share, such as their wind: which of their elements belong to which drone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.verdict import Role
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import FMU_TYPE
from cosim_master.system.structure import Component, System, Value

__all__ = ["COUNT", "Shared", "SharedPorts", "Surroundings", "body_of", "surroundings_of"]

COUNT = "count"
"""Parameter of an FMU that all drones share: the number of drones."""

Shared = tuple[tuple[str, ...], str, tuple[str, ...], str]
"""Elements and causality of a port of the shared FMU, and of the port of a drone's body."""
_OPPOSITE = {"input": "output", "output": "input"}


@dataclass(frozen=True, slots=True)
class Surroundings:
    """An FMU that all drones share: its name, its file, and its start values except the number of drones."""

    name: str
    fmu: Path
    values: Mapping[str, Value]


def body_of(parts: Mapping[str, FmuDescription]) -> str | None:
    """Returns the name of the part that declares a position (`Role.POSITION`), None if there is none."""
    return next((part for part, fmu in parts.items() if Role.POSITION in fmu.verdicts.values()), None)


def _ports(fmu: FmuDescription) -> dict[str, str]:
    """Returns the causalities of inputs and outputs by name, arrays by the name without an index."""
    return {v.name.partition("[")[0]: v.causality for v in fmu.variables.values() if v.causality in _OPPOSITE}


class SharedPorts:
    """The ports of an FMU that all drones share, found once: it has elements for each of thousands of drones."""

    def __init__(self, shared: FmuDescription) -> None:
        self._ports = _ports(shared)
        self._elements = {name: elements_of(name, shared.variables) for name in self._ports}

    def missing(self, body: FmuDescription) -> list[str]:
        """Returns the ports of the shared FMU for which a body has no port of this name and the opposite causality."""
        known = _ports(body)
        return [name for name, causality in self._ports.items() if known.get(name) != _OPPOSITE[causality]]

    def of(self, body: FmuDescription, number: int) -> Iterator[Shared]:
        """Yields the ports that the shared FMU and the body of drone `number` (from 0) have in common.

        A port of the body with n elements belongs to n elements of the port with the same name: those of the first
        drone come first.

        Raises:
            ValueError: the shared FMU has no elements for this drone; the text tells how many drones it can have.
        """
        without = self.missing(body)
        for name, causality in self._ports.items():
            if name in without:
                continue
            every, own = self._elements[name], elements_of(name, body.variables)
            theirs = every[len(own) * number : len(own) * (number + 1)]
            if len(theirs) < len(own):
                most = len(every) // len(own)
                raise ValueError(
                    f"has {len(every)} elements of {name}, for at most {most} drones; take an FMU with more elements"
                )
            yield theirs, causality, own, _OPPOSITE[causality]


def surroundings_of(system: System, checked: CheckedSystem, drones: Sequence[str]) -> tuple[Surroundings, ...]:
    """Returns the FMUs beside the drones, if their connections are those that `Swarm.environment` makes.

    Args:
        system: the root system.
        drones: names of its drones, the first of the shared FMU's elements first.

    Raises:
        ValueError: the root has other parts or connections beside its drones.
    """
    others = [one for one in system.elements if one.name not in drones]
    instances = {one.name: one for one in checked.instances}
    wanted: set[frozenset[tuple[str, str]]] = set()
    found = []
    for one in others:
        if not isinstance(one, Component) or one.type != FMU_TYPE:
            raise ValueError(one.name)
        shared = instances[one.name].fmu
        common = SharedPorts(shared)
        for number, drone in enumerate(drones):
            parts = {
                name.removeprefix(f"{drone}."): instance.fmu
                for name, instance in instances.items()
                if name.startswith(f"{drone}.")
            }
            part = body_of(parts)
            ports = [*common.of(parts[part], number)] if part is not None else []
            if not ports:
                raise ValueError(one.name)
            wanted |= {
                frozenset(((one.name, element), (drone, f"{part}_{own}")))
                for elements, _, owns, _ in ports
                for element, own in zip(elements, owns, strict=True)
            }
        values = {name: value for name, value in instances[one.name].start_values.items() if name != COUNT}
        found.append(Surroundings(one.name, shared.path, values))
    has = {
        frozenset(((one.start_element or "", one.start_connector), (one.end_element or "", one.end_connector)))
        for one in system.connections
    }
    if others and has != wanted:
        raise ValueError(", ".join(one.name for one in others))
    return tuple(found)
