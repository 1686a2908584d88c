"""The ports of an FMU that all drones share, such as their wind: which of their elements belong to which drone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cosim.verdict import Role
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription

__all__ = ["Shared", "body_of", "missing", "shared_ports"]

Shared = tuple[tuple[str, ...], str, tuple[str, ...], str]
"""Elements and causality of a port of the shared FMU, and of the port of a drone's body."""
_OPPOSITE = {"input": "output", "output": "input"}


def body_of(parts: Mapping[str, FmuDescription]) -> str | None:
    """Returns the name of the part that declares a position (`Role.POSITION`), None if there is none."""
    return next((part for part, fmu in parts.items() if Role.POSITION in fmu.verdicts.values()), None)


def _ports(fmu: FmuDescription) -> dict[str, str]:
    """Returns the causalities of inputs and outputs by name, arrays by the name without an index."""
    return {v.name.partition("[")[0]: v.causality for v in fmu.variables.values() if v.causality in _OPPOSITE}


def missing(shared: FmuDescription, body: FmuDescription) -> list[str]:
    """Returns the ports of the shared FMU for which a body has no port of this name and the opposite causality."""
    known = _ports(body)
    return [name for name, causality in _ports(shared).items() if known.get(name) != _OPPOSITE[causality]]


def shared_ports(shared: FmuDescription, body: FmuDescription, number: int) -> Iterator[Shared]:
    """Yields the ports that the shared FMU and the body of drone `number` (from 0) have in common.

    A port of the body with n elements belongs to n elements of the port with the same name: those of the first drone
    come first.

    Raises:
        ValueError: the shared FMU has no elements for this drone; the text tells how many drones it can have.
    """
    without = missing(shared, body)
    for name, causality in _ports(shared).items():
        if name in without:
            continue
        every, own = elements_of(name, shared.variables), elements_of(name, body.variables)
        theirs = every[len(own) * number : len(own) * (number + 1)]
        if len(theirs) < len(own):
            raise ValueError(f"has {len(every)} elements of {name}, for at most {len(every) // len(own)} drones")
        yield theirs, causality, own, _OPPOSITE[causality]
