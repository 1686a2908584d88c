"""Flattens a hierarchical system: its parts, their ports, and which FMU variable drives which.

`Part` is one element of the running system: the same .ssd used by five drones is one `System` and five parts. Every
rule about connections is here: the allowed kinds, one writer per port, types, units, transformations. It sets no
values and orders nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cosim_master.document import near
from cosim_master.errors import Problem, Where
from cosim_master.fmu import FmuDescription, Variable
from cosim_master.system import Component, Connection, Connector, Element, Kind, System
from cosim_master.units import Unit, UnitError, conversion

__all__ = ["Part", "Port", "Route", "Wiring", "assemble", "compatible"]

# Which connectors may be joined: owner and kind of the source, owner and kind of the destination
# (SSP 2.0, section 5.3.2.1 "Allowed Connections", the rows of the kinds that SSP 1.0 has).
_ALLOWED: frozenset[tuple[str, Kind, str, Kind]] = frozenset(
    {
        ("system", "parameter", "system", "calculatedParameter"),
        ("system", "parameter", "system", "output"),
        ("system", "input", "system", "output"),
        ("system", "parameter", "element", "parameter"),
        ("system", "parameter", "element", "input"),
        ("system", "input", "element", "input"),
        ("element", "calculatedParameter", "element", "parameter"),
        ("element", "calculatedParameter", "element", "input"),
        ("element", "output", "element", "input"),
        ("element", "calculatedParameter", "system", "calculatedParameter"),
        ("element", "calculatedParameter", "system", "output"),
        ("element", "output", "system", "output"),
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class Port:
    """A connector of a part, with what its file leaves out taken from the FMU. Compared by identity.

    Attributes:
        variable: the FMU's variable, for a connector of an FMU.
    """

    part: Part
    name: str
    kind: Kind
    where: Where
    type: str | None
    unit: Unit | None
    items: Mapping[str, int] | None
    variable: Variable | None = None

    def __str__(self) -> str:
        owner = self.part.element.name
        return f"{owner}.{self.name}" if owner else self.name


@dataclass(slots=True, eq=False)
class Part:
    """An element of the running system.

    Attributes:
        name: hierarchical name ("drone1.vehicle"); empty for the root system.
        system: what is inside, for a system or a component that is one; None for an FMU.
        fmu: None for systems, and for a component whose FMU could not be described.
        broken: its file could not be read; nothing more is said about it.
    """

    name: str
    element: Element
    parent: Part | None
    system: System | None = None
    fmu: FmuDescription | None = None
    broken: bool = False
    children: dict[str, Part] = field(default_factory=dict)
    ports: dict[str, Port] = field(default_factory=dict)

    def walk(self) -> Iterator[Part]:
        """This part and all parts in it, outer before inner."""
        yield self
        for child in self.children.values():
            yield from child.walk()


@dataclass(frozen=True, slots=True)
class Route:
    """How the value of a port comes about: value = factor * source + offset, in `unit`, as `type`.

    `source` is None while nothing drives the port; type and unit are then its own.
    """

    source: Port | None
    factor: float = 1.0
    offset: float = 0.0
    unit: Unit | None = None
    type: str | None = None
    items: Mapping[str, int] | None = None


def assemble(
    root: System, fmus: Mapping[Path, FmuDescription | None], problems: list[Problem], notes: list[str]
) -> Part:
    """The tree of parts of a system.

    Args:
        root: the root system.
        fmus: descriptions by source path; None for a file that could not be described.
        problems, notes: appended to.
    """
    return _Assembly(fmus, problems, notes).part(root, None)


class _Assembly:
    def __init__(self, fmus: Mapping[Path, FmuDescription | None], problems: list[Problem], notes: list[str]) -> None:
        self.fmus = fmus
        self.problems = problems
        self.notes = notes

    def part(self, element: Element, parent: Part | None) -> Part:
        if parent is None:
            name = ""
        else:
            name = f"{parent.name}.{element.name}" if parent.name else element.name
        part = Part(name, element, parent)
        if isinstance(element, System):
            part.system = element
        elif element.content is not None:
            part.system = element.content
        else:
            part.fmu = None if element.source is None else self.fmus.get(element.source)
            part.broken = part.fmu is None
        if part.system is not None:
            own = {connector.name: connector for connector in element.connectors} if element is not part.system else {}
            for connector in part.system.connectors:
                part.ports[connector.name] = self._system_port(part, connector, own.pop(connector.name, None))
            for connector in own.values():
                text = (
                    f'"{element.name}" has no connector "{connector.name}" inside; {near(connector.name, part.ports)}'
                )
                self.problems.append(Problem(connector.where, text))
            for child in part.system.elements:
                part.children.setdefault(child.name, self.part(child, part))
        else:
            for connector in element.connectors:
                part.ports[connector.name] = self._fmu_port(part, connector)
        return part

    def _system_port(self, part: Part, inner: Connector, outer: Connector | None) -> Port:
        """A connector of a system; `outer` is what the component that stands for the system says about it."""
        if outer is not None:
            if outer.kind != inner.kind:
                text = f'connector "{inner.name}" is {outer.kind} here and {inner.kind} inside, at {inner.where}'
                self.problems.append(Problem(outer.where, text))
            if None not in (outer.type, inner.type) and outer.type != inner.type:
                text = f'connector "{inner.name}" is {outer.type} here and {inner.type} inside, at {inner.where}'
                self.problems.append(Problem(outer.where, text))
            self._same_unit(outer, inner.unit, f"inside, at {inner.where}")
        return Port(
            part=part,
            name=inner.name,
            kind=inner.kind,
            where=inner.where if outer is None else outer.where,
            type=inner.type or (outer.type if outer is not None else None),
            unit=inner.unit or (outer.unit if outer is not None else None),
            items=inner.items or (outer.items if outer is not None else None),
        )

    def _fmu_port(self, part: Part, connector: Connector) -> Port:
        variable = None if part.fmu is None else part.fmu.variables.get(connector.name)
        port = Port(
            part, connector.name, connector.kind, connector.where, connector.type, connector.unit, connector.items
        )
        if part.fmu is None:
            return port
        if variable is None:
            known = [item.name for item in part.fmu.variables.values() if item.causality == connector.kind]
            text = f'{part.fmu.path.name} has no variable "{connector.name}"; {near(connector.name, known)}'
            self.problems.append(Problem(connector.where, text))
            return port
        file = part.fmu.path.name
        if variable.causality != connector.kind:
            text = f'connector "{connector.name}" is {connector.kind}, but {file} has it as {variable.causality}'
            self.problems.append(Problem(connector.where, text))
        if connector.type is not None and connector.type != variable.type:
            text = f'connector "{connector.name}" is {connector.type}, but {file} has it as {variable.type}'
            self.problems.append(Problem(connector.where, text))
        self._same_unit(connector, variable.unit, f"in {part.fmu.path.name}")
        if connector.type == "Enumeration" and variable.type == "Enumeration":
            self._same_items(connector, variable, part.fmu)
        return replace(
            port,
            type=variable.type,
            unit=connector.unit or variable.unit,
            items=variable.items or connector.items,
            variable=variable,
        )

    def _same_unit(self, connector: Connector, other: Unit | None, place: str) -> None:
        if connector.unit is None or other is None:
            return
        text = f'connector "{connector.name}" has the unit "{connector.unit.name}" and "{other.name}" {place}'
        try:
            if conversion(connector.unit, other) == (1.0, 0.0):
                return
        except UnitError as error:
            text += f" ({error})"
        self.problems.append(Problem(connector.where, f"{text}; write the same unit or leave it out"))

    def _same_items(self, connector: Connector, variable: Variable, fmu: FmuDescription) -> None:
        if connector.items is None:
            self.notes.append(
                f'{connector.where}: enumeration "{connector.enumeration}" is not defined in the file; '
                f"the items of {fmu.path.name} are used"
            )
        elif variable.items and dict(connector.items) != dict(variable.items):
            text = (
                f'enumeration "{connector.enumeration}" of connector "{connector.name}" has other items than '
                f"{fmu.path.name}: {_listed(connector.items)} instead of {_listed(variable.items)}"
            )
            self.problems.append(Problem(connector.where, text))


def _listed(items: Mapping[str, int]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in items.items())


def compatible(source: str | None, target: str | None) -> bool:
    """Whether a value of type `source` may go to `target`: the same, widening, or unknown."""
    return (
        source is None
        or target is None
        or source == target
        or (source, target) in {("Integer", "Real"), ("Integer", "Enumeration"), ("Enumeration", "Integer")}
    )


class Wiring:
    """The connections of a system as they flow: per port what drives it, and what it drives.

    Attributes:
        incoming: the connection into a port and its source.
        outgoing: the connections out of a port and their destinations.
        unit_gaps: connections that join a port with a unit to one without.
    """

    def __init__(self, root: Part, problems: list[Problem]) -> None:
        self.root = root
        self.incoming: dict[Port, tuple[Connection, Port]] = {}
        self.outgoing: dict[Port, list[tuple[Connection, Port]]] = {}
        self.unit_gaps: list[Connection] = []
        self._problems = problems
        self._routes: dict[Port, Route] = {}
        for part in root.walk():
            if part.system is not None:
                for connection in part.system.connections:
                    self._connect(part, connection)

    def _problem(self, where: Where, text: str) -> None:
        self._problems.append(Problem(where, text))

    def _connect(self, part: Part, connection: Connection) -> None:
        start = self._port(part, connection.start_element, connection.start_connector, connection.where)
        end = self._port(part, connection.end_element, connection.end_connector, connection.where)
        if start is None or end is None:
            return
        owners = ["system" if port.part is part else "element" for port in (start, end)]
        if (owners[0], start.kind, owners[1], end.kind) in _ALLOWED:
            source, target = start, end
        elif (owners[1], end.kind, owners[0], start.kind) in _ALLOWED:
            source, target = end, start
        else:
            ends = [
                f"{port.kind} {port} of {'the system' if owner == 'system' else 'an element'}"
                for port, owner in zip((start, end), owners, strict=True)
            ]
            valid = sorted(
                f"{owner} {kind} -> {to_owner} {to_kind}"
                for owner, kind, to_owner, to_kind in _ALLOWED
                if (owner, to_owner) in {(owners[0], owners[1]), (owners[1], owners[0])}
            )
            text = f"{ends[0]} and {ends[1]} cannot be connected; valid: {', '.join(valid)}"
            self._problem(connection.where, text)
            return
        if target in self.incoming:
            first = self.incoming[target][0].where
            self._problem(connection.where, f"{target.kind} {target} has two writers; the other is at {first}")
            return
        self.incoming[target] = (connection, source)
        self.outgoing.setdefault(source, []).append((connection, target))

    def _port(self, part: Part, element: str | None, connector: str, where: Where) -> Port | None:
        owner: Part | None = part
        if element is not None:
            owner = part.children.get(element)
        if owner is None:
            self._problem(where, f'there is no element "{element}" in the system; {near(element or "", part.children)}')
            return None
        if owner.broken and isinstance(owner.element, Component) and connector not in owner.ports:
            return None
        port = owner.ports.get(connector)
        if port is None:
            name = f'"{owner.element.name}"' if element is not None else "the system"
            variable = None if owner.fmu is None else owner.fmu.variables.get(connector)
            hint = near(connector, owner.ports)
            if variable is not None:
                hint = f"its FMU has the {variable.causality}, so declare it in <Connectors>"
            self._problem(where, f'{name} has no connector "{connector}"; {hint}')
        return port

    def route(self, port: Port) -> Route:
        """What drives a port, through however many systems."""
        chain: list[Port] = []
        while port not in self._routes and (found := self.incoming.get(port)) is not None:
            if port in chain:
                names = " -> ".join(str(item) for item in reversed(chain[chain.index(port) :]))
                self._problem(found[0].where, f"connections form a loop without any component in it: {names}")
                break
            chain.append(port)
            port = found[1]
        route = self._routes.get(port)
        if route is None:
            source = port if port.variable is not None and port.kind in ("output", "calculatedParameter") else None
            route = Route(source, 1.0, 0.0, port.unit, port.type, port.items)
            self._routes[port] = route
        for target in reversed(chain):
            if target not in self._routes:
                self._routes[target] = self.hop(route, self.incoming[target][0], target)
            route = self._routes[target]
        return route

    def hop(self, route: Route, connection: Connection, target: Port) -> Route:
        """A route extended by one connection: unit conversion first, then the linear transformation."""
        if not compatible(route.type, target.type):
            source = self.incoming[target][1]
            text = f"{source} is {route.type} and {target} is {target.type}; types must be equal (or Integer to Real)"
            self._problem(connection.where, text)
            return Route(route.source, 1.0, 0.0, target.unit, target.type, target.items)
        kind = target.type or route.type
        if route.items and target.items and not (route.items.items() <= target.items.items()):
            given, wanted = _listed(route.items), _listed(target.items)
            self._problem(connection.where, f"{target} has the enumeration items {wanted}; what drives it has {given}")
        factor, offset, unit = self._converted(route.unit, connection, target)
        if connection.linear:
            if kind not in (None, "Real"):
                text = f"a LinearTransformation needs a Real, but {target} is {kind}"
                self._problem(connection.where, text)
            factor, offset = connection.factor * factor, connection.factor * offset + connection.offset
        return Route(
            source=route.source,
            factor=factor * route.factor,
            offset=factor * route.offset + offset,
            unit=unit,
            type=kind,
            items=target.items or route.items,
        )

    def _converted(self, unit: Unit | None, connection: Connection, target: Port) -> tuple[float, float, Unit | None]:
        if connection.suppress_unit_conversion:
            return 1.0, 0.0, target.unit
        if unit is None or target.unit is None:
            if target.variable is not None and unit is not target.unit:
                self.unit_gaps.append(connection)
            return 1.0, 0.0, target.unit or unit
        try:
            factor, offset = conversion(unit, target.unit)
        except UnitError as error:
            self._problem(connection.where, f"{self.incoming[target][1]} to {target}: {error}")
            return 1.0, 0.0, target.unit
        return factor, offset, target.unit
