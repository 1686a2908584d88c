"""The flow of values through a system: sources of FMU variables, and the conversions between them.

This module contains all rules about connections: the allowed kinds, one writer per port, shapes, types, units,
transformations, and the signals of dictionaries. It does not set values or determine an order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

from cosim_master.diagnostics.errors import Finding, Problem, Where
from cosim_master.diagnostics.limitations import DIRECTION, NARROWING
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.units import UndefinedUnit, Unit, UnitError, conversion
from cosim_master.system.flatten.topology.components import Form, Part, Port, element_name, indices_of
from cosim_master.system.flatten.topology.conversions import (
    MappedEnd,
    compatible,
    listed,
    mapping_entries,
    mime_types_differ,
)
from cosim_master.system.structure import (
    Connection,
    LinearTransformation,
    MappingTransformation,
    SignalDictionaryReference,
    System,
)

__all__ = ["SENDING", "Route", "Way", "Wiring"]

# Which connectors may be joined: owner and kind of the source, owner and kind of the destination
# (SSP 2.0, section 5.3.2.1 "Allowed Connections"; what SSP 1.0 allows is a part of it).
_ROWS = """
system structuralParameter system calculatedParameter output local
system parameter system calculatedParameter output local
system input system output local
system structuralParameter element structuralParameter parameter input inout
system parameter element parameter input inout
system input element input inout
element constant element structuralParameter parameter input inout
element calculatedParameter element parameter input inout
element output element input inout
element local element input inout
element inout element input
element constant system constant calculatedParameter output local
element calculatedParameter system calculatedParameter output local
element output system output local
element local system output local
element inout system output local
"""
_ALLOWED = frozenset(
    (owner, kind, to_owner, to_kind)
    for owner, kind, to_owner, *to_kinds in map(str.split, _ROWS.strip().splitlines())
    for to_kind in to_kinds
)
_KINDS = tuple(dict.fromkeys(kind for row in _ALLOWED for kind in (row[1], row[3])))
_USUAL = ("input", "output", "parameter", "calculatedParameter")
SENDING = ("output", "calculatedParameter", "constant", "local")
"""Kinds of an FMU's connectors that may be sources."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """What becomes of a value on its way to a port: factor * mapped(value) + offset, in `unit`, as `type`.

    `mapping` contains integers and booleans that are replaced by others. It is compared by identity.
    """

    factor: float = 1.0
    offset: float = 0.0
    unit: Unit | None = None
    type: str | None = None
    items: Mapping[str, int] | None = None
    mapping: Mapping[int, int] = field(default_factory=dict)
    mime_type: str | None = None


@dataclass(slots=True, eq=False)
class Route:
    """The source of a port's value, and the way from it.

    `source` is None while nothing drives the port; type and unit of the way are then its own.
    """

    source: Port | None
    way: Way


def _packets(route: Route, target: Port) -> bool:
    """Returns whether a route carries packets between FMUs of different FMI versions.

    Packets are base64 text in a String of FMI 2, bytes in a Binary of FMI 3.
    """
    ends = [port.variable for port in (route.source, target) if port is not None]
    both = {route.way.type, target.type} == {"String", "Binary"}
    return both and route.source is not None and all(v is None or v.packet_capacity is not None for v in ends)


@cache
def _is_allowed(owner: str, kinds: tuple[str, ...], to_owner: str, to_kinds: tuple[str, ...]) -> bool:
    return any((owner, kind, to_owner, to_kind) in _ALLOWED for kind in kinds for to_kind in to_kinds)


class Wiring:
    """The connections of a system by the flow of values: the source and the targets of each port.

    Attributes:
        incoming: the connection into a port and its source.
        outgoing: the connections out of a port and their destinations.
        further: the additional connections into a port whose value is a sum.
        unit_gaps: connections between a port with a unit and one without.
        truths: connections between a Boolean and a number.
        findings: connections between units of which one has no definition.
    """

    def __init__(self, root: Part, problems: list[Problem]) -> None:
        self.root = root
        self.incoming: dict[Port, tuple[Connection, Port]] = {}
        self.outgoing: dict[Port, list[tuple[Connection, Port]]] = {}
        self.further: dict[Port, list[tuple[Connection, Port]]] = {}
        self.unit_gaps: list[Connection] = []
        self.truths: list[Connection] = []
        self.findings: list[Finding] = []
        self._problems = problems
        self._routes: dict[Port, Route] = {}
        self._directions: dict[int, tuple[Form, Form, bool]] = {}
        """Of a connection without problems, by its id: the forms of its ends, and whether it leads from the first."""
        self._hops: dict[int, tuple[Way, Form, Way]] = {}
        """Of a connection without remarks, by its id: a way to it, the form at its end, and the way to there."""
        self._starts: dict[Form, Way] = {}
        for part in root.walk():
            if part.system is not None:
                for connection in part.system.connections:
                    self._connect(part, connection)
        self._share_signals()
        for target in tuple(self.incoming):
            self.route(target)

    def _share_signals(self) -> None:
        """Connects the signals of dictionaries: from the only reference that is written to all others."""
        ports = [
            port
            for part in self.root.walk()
            for port in (part.ports.values() if isinstance(part.element, SignalDictionaryReference) else ())
        ]
        for port in ports:
            if port in self.incoming and port.entry is not None:
                self._flow(Connection(None, port.name, None, port.name, port.form.where), port, port.entry)
        for port in ports:
            if port not in self.incoming and port.entry is not None:
                self._flow(Connection(None, port.name, None, port.name, port.form.where), port.entry, port)

    def _problem(self, where: Where, text: str) -> None:
        self._problems.append(Problem(where, text))

    def _connect(self, part: Part, connection: Connection) -> None:
        if self._connect_alike(part, connection):
            return
        where = connection.where
        start = self._ports(part, connection.start_element, connection.start_connector, connection.start_indices, where)
        end = self._ports(part, connection.end_element, connection.end_connector, connection.end_indices, where)
        if start is None or end is None:
            return
        if start[0] != end[0] and not len(start[1]) == len(end[1]) == 1:
            shapes = [f"{'x'.join(map(str, shape))} elements" if shape else "one element" for shape, _ in (start, end)]
            text = f"cannot connect {shapes[0]} with {shapes[1]}; valid: equal dimensions, or one element of an array"
            self._problem(where, text)
            return
        problems = len(self._problems)
        for one, other in zip(start[1], end[1], strict=True):
            if (ends := self._directed(part, connection, one, other)) is None:
                return
            if len(self._problems) == problems:
                self._directions[id(connection)] = one.form, other.form, ends[0] is one
            self._flow(connection, *ends)

    def _connect_alike(self, part: Part, connection: Connection) -> bool:
        """Connects a part as an earlier one of the same contents, if both ends are single ports of the same forms."""
        if (known := self._directions.get(id(connection))) is None:
            return False
        start = part if connection.start_element is None else part.children.get(connection.start_element)
        end = part if connection.end_element is None else part.children.get(connection.end_element)
        one = None if start is None else start.ports.get(connection.start_connector)
        other = None if end is None else end.ports.get(connection.end_connector)
        if one is None or other is None or one.form is not known[0] or other.form is not known[1]:
            return False
        self._flow(connection, *((one, other) if known[2] else (other, one)))
        return True

    def _directed(self, part: Part, connection: Connection, start: Port, end: Port) -> tuple[Port, Port] | None:
        """Returns source and target of a connection, by owner and kind."""
        ports = (start, end)
        owners = ["system" if port.part is part else "element" for port in ports]
        kinds = [_KINDS if port.kind == "unspecified" else (port.kind,) for port in ports]
        kinds = [("output",) if port.form.ticks else kind for port, kind in zip(ports, kinds, strict=True)]

        forward = _is_allowed(owners[0], kinds[0], owners[1], kinds[1])
        backward = _is_allowed(owners[1], kinds[1], owners[0], kinds[0])
        if forward != backward:
            self._same_variability(connection, start, end)
            return (start, end) if forward else (end, start)
        for port, other in (ports, ports[::-1]):
            if port.form.ticks and other.type in ("Clock", None):
                what = f"{port} is a {port.form.interval_variability} Clock, which ticks by itself"
                text = f"{what}: it can drive a triggered input Clock, but {other} is none"
                self._problem(connection.where, text)
                return None
        shown = [
            f"{port.kind} {port} of {'the system' if owner == 'system' else 'an element'}"
            for port, owner in zip(ports, owners, strict=True)
        ]
        if forward:
            self._problem(connection.where, DIRECTION.text(*shown))
            return None
        valid = sorted(
            f"{owner} {kind} -> {to_owner} {to_kind}"
            for owner, kind, to_owner, to_kind in _ALLOWED
            if (owner, to_owner) in {(owners[0], owners[1]), (owners[1], owners[0])}
            and {kind, to_kind} <= {*_USUAL, start.kind, end.kind}
        )
        text = f"{shown[0]} and {shown[1]} cannot be connected; valid: {', '.join(valid)}"
        self._problem(connection.where, text)
        return None

    def _same_variability(self, connection: Connection, start: Port, end: Port) -> None:
        """Checks that a Clock of an element and one of the system tick in the same way (SSP 2.0, 5.3.2.1)."""
        kinds = start.form.interval_variability, end.form.interval_variability
        of_system = connection.start_element is None or connection.end_element is None
        if of_system and None not in kinds and kinds[0] != kinds[1]:
            text = f"{start} is a {kinds[0]} Clock and {end} a {kinds[1]} one; both must have one intervalVariability"
            self._problem(connection.where, text)

    def _flow(self, connection: Connection, source: Port, target: Port) -> None:
        if target in self.incoming and connection.summed and self.incoming[target][0].summed:
            self.further.setdefault(target, []).append((connection, source))
            return
        if target in self.incoming:
            first = self.incoming[target][0].where
            holder = target.part.system is None and isinstance(target.part.element, System)
            what = f'signal "{target.name}" of a dictionary' if holder else ""
            self._problem(
                connection.where, f"{what or f'{target.kind} {target}'} has two writers; the other is at {first}"
            )
            return
        self.incoming[target] = (connection, source)
        self.outgoing.setdefault(source, []).append((connection, target))

    def _ports(
        self, part: Part, element: str | None, connector: str, indices: tuple[int, ...], where: Where
    ) -> tuple[tuple[int, ...], list[Port]] | None:
        """Returns one end of a connection: its shape, and the ports of all its elements."""
        owner: Part | None = part
        if element is not None:
            owner = part.children.get(element)
        if owner is None:
            self._problem(where, f'there is no element "{element}" in the system; {near(element or "", part.children)}')
            return None
        if owner.broken and connector not in owner.ports:
            return None
        shape = owner.shapes.get(connector)
        port = owner.ports.get(connector)
        if shape is not None:
            if not indices:
                return shape, [owner.ports[element_name(connector, item)] for item in indices_of(shape)]
            port = owner.ports.get(element_name(connector, indices))
            if port is None:
                sizes = "x".join(map(str, shape))
                self._problem(where, f'"{connector}" has {sizes} elements, but not [{",".join(map(str, indices))}]')
                return None
        elif port is not None and indices:
            self._problem(where, f'"{connector}" is a scalar: it has no element [{",".join(map(str, indices))}]')
            return None
        if port is None:
            name = f'"{owner.element.name}"' if element is not None else "the system"
            variable = None if owner.fmu is None else owner.fmu.variables.get(connector)
            hint = near(connector, owner.ports)
            if variable is not None:
                hint = f"its FMU has the {variable.causality}, so declare it in <Connectors>"
            self._problem(where, f'{name} has no connector "{connector}"; {hint}')
            return None
        return (), [port]

    def route(self, port: Port) -> Route:
        """Returns the source of a port, which may be connected through several systems."""
        if (route := self._routes.get(port)) is not None:
            return route
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
            form = port.form
            source = port if form.variable is not None and (form.kind in SENDING or form.ticks) else None
            if (start := self._starts.get(form)) is None:
                start = self._starts[form] = Way(1.0, 0.0, form.unit, form.type, form.items, {}, form.mime_type)
            route = self._routes[port] = Route(source, start)
        for target in reversed(chain):
            if target not in self._routes:
                self._routes[target] = self.hop(route, self.incoming[target][0], target)
            route = self._routes[target]
        return route

    def hop(self, route: Route, connection: Connection, target: Port) -> Route:
        """Returns a route with one more connection: unit conversion first, then the transformation (SSP 2.0, 4.5.2)."""
        known = self._hops.get(id(connection))
        if known is not None and known[0] is route.way and known[1] is target.form:
            return Route(route.source, known[2])
        remarks = self._remarks()
        way = self._further(route, connection, target)
        if self._remarks() == remarks:
            self._hops[id(connection)] = route.way, target.form, way
        return Route(route.source, way)

    def _remarks(self) -> int:
        return len(self._problems) + len(self.truths) + len(self.unit_gaps) + len(self.findings)

    def _further(self, route: Route, connection: Connection, target: Port) -> Way:
        """Returns the way of a route with one more connection."""
        way = route.way
        if not compatible(way.type, target.type) and not _packets(route, target):
            source = self.incoming[target][1]
            self._problem(connection.where, NARROWING.text(source, way.type, target, target.type))
            return Way(1.0, 0.0, target.unit, target.type, target.items)
        if way.type == "Boolean" and target.type not in (None, "Boolean", "String", "Binary"):
            self.truths.append(connection)
        kind = target.type or way.type
        table = connection.transformation
        mapping = way.mapping
        if isinstance(table, MappingTransformation):
            ends = (
                MappedEnd("what drives it", way.type, way.items),
                MappedEnd(str(target), target.type, target.items),
            )
            entries = mapping_entries(table, *ends, self._problems)
            keys = {*mapping, *entries}
            mapping = {key: entries.get(mapping.get(key, key), mapping.get(key, key)) for key in keys}
        elif way.items and target.items and not (way.items.items() <= target.items.items()):
            given, wanted = listed(way.items), listed(target.items)
            self._problem(connection.where, f"{target} has the enumeration items {wanted}; what drives it has {given}")
        mime_type = target.form.mime_type
        if mime_types_differ(way.mime_type, mime_type):
            text = f"{target} takes {mime_type}; what drives it is {way.mime_type}"
            self._problem(connection.where, text)
        factor, offset, unit = self._converted(way.unit, connection, target)
        if isinstance(table, LinearTransformation):
            if kind not in (None, "Real", "Float32"):
                text = f"a LinearTransformation needs a Real, but {target} is {kind}"
                self._problem(connection.where, text)
            factor, offset = table.factor * factor, table.factor * offset + table.offset
        return Way(
            factor=factor * way.factor,
            offset=factor * way.offset + offset,
            unit=unit,
            type=kind,
            items=target.items or (None if isinstance(table, MappingTransformation) else way.items),
            mapping=mapping,
            mime_type=mime_type or way.mime_type,
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
        except UndefinedUnit as error:
            text = f"{self.incoming[target][1]} to {target}: not converted: {error}"
            self.findings.append(Finding(connection.where, text, "unit without definition"))
            return 1.0, 0.0, unit if target.unit.base is None else target.unit
        except UnitError as error:
            self._problem(connection.where, f"{self.incoming[target][1]} to {target}: {error}")
            return 1.0, 0.0, target.unit
        return factor, offset, target.unit
