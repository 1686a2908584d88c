"""Sizes of array connectors that are given by other connectors: sizeConnector (SSP 2.0, section 4.5.3).

The size of an FMU's array is determined by the FMU, that of a system's array connector by its connections
(`components`). This module checks sizes when all connections are known: the other connector must be, or be connected
through systems to, a structural parameter or a constant of an FMU with the same value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cosim_master.diagnostics.errors import Problem
from cosim_master.diagnostics.limitations import SIZE_CONNECTOR
from cosim_master.diagnostics.names import near
from cosim_master.system.flatten.topology.components import Part, Port
from cosim_master.system.flatten.topology.wiring import Wiring
from cosim_master.system.structure import Connector, System, Value

__all__ = ["check_sizes"]


def check_sizes(wiring: Wiring, values: Mapping[str, Mapping[str, Value]], problems: list[Problem]) -> None:
    """Compares declared sizes with those of the connectors.

    Args:
        wiring: all connections.
        values: the values set, by instance and variable.
        problems: appended to.
    """
    for part in wiring.root.walk():
        for connector in _connectors(part):
            for i, dimension in enumerate(connector.dimensions):
                shape = part.shapes.get(connector.name)
                if dimension.connector is not None and shape is not None and not part.broken:
                    text = _wrong(wiring, values, part, connector.name, dimension.connector, shape[i : i + 1])
                    if text:
                        problems.append(Problem(connector.where, text))


def _connectors(part: Part) -> Iterator[Connector]:
    """Returns the declarations of a component's connectors, where it is used and in its own document."""
    if isinstance(part.element, System):
        yield from part.element.connectors
    else:
        yield from part.element.connectors
        if part.system is not None:
            yield from part.system.connectors


def _wrong(
    wiring: Wiring,
    values: Mapping[str, Mapping[str, Value]],
    part: Part,
    name: str,
    size_connector: str,
    size: tuple[int, ...],
) -> str:
    """Returns the problem with the declared size of a connector; empty if none exists."""
    port = part.ports.get(size_connector)
    if port is None:
        hint = near(
            size_connector, [p.name for p in part.ports.values() if p.kind in ("structuralParameter", "constant")]
        )
        return f'array connector "{name}": there is no connector "{size_connector}" that has its size; {hint}'
    found = _value(wiring, values, port)
    if found is None:
        return SIZE_CONNECTOR.text(name, size_connector)
    if size and size[0] != found:
        return f'array connector "{name}" has the size {size[0]}, but "{size_connector}", which says it, is {found}'
    return ""


def _value(wiring: Wiring, values: Mapping[str, Mapping[str, Value]], port: Port) -> Value | None:
    """Returns the value of the structural parameter or constant of an FMU that a port is, drives or is driven by."""
    pending, seen = [port], set[Port]()
    while pending:
        one = pending.pop()
        seen.add(one)
        v = one.variable
        if v is not None and (v.causality == "structuralParameter" or v.variability == "constant"):
            return values.get(one.part.name, {}).get(v.name, v.start)
        around = [target for _, target in wiring.outgoing.get(one, ())]
        if one in wiring.incoming:
            around.append(wiring.incoming[one][1])
        pending += [other for other in around if other not in seen]
    return None
