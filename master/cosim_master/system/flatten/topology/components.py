"""The parts of a running system and their ports: an .ssd used by five drones is one `System` and five parts.

Properties that a connector does not specify (type, unit, items) are taken from the FMU; a contradiction to the FMU is a
problem. Array connectors of systems become one port per element. Connections are not handled here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, cast

from cosim_master.diagnostics.errors import Finding, Problem, Where
from cosim_master.diagnostics.limitations import DEEP, LARGE, OPEN_SIZE
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.description.units import UndefinedUnit, Unit, UnitError, conversion
from cosim_master.system.flatten.topology.conversions import listed
from cosim_master.system.reading.ssp.grammar import SAME_TYPE
from cosim_master.system.structure import (
    MAX_DEPTH,
    MAX_PARTS,
    Connector,
    Dimension,
    Element,
    Kind,
    SignalDictionaryReference,
    System,
)

__all__ = ["Form", "Part", "Port", "assemble", "element_name", "indices_of", "measure"]


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """A connector, with properties missing in its file taken from the FMU. It is compared by identity.

    Parts that use one connector with one FMU share it: a thousand drones have sixty thousand ports of as many forms as
    one drone.

    Attributes:
        variable: the FMU's variable, for a connector of an FMU.
        interval_variability: of a Clock; None if neither file declares it.
    """

    name: str
    kind: Kind
    where: Where
    type: str | None
    unit: Unit | None
    items: Mapping[str, int] | None
    variable: Variable | None = None
    mime_type: str | None = None
    interval_variability: str | None = None

    @property
    def ticks(self) -> bool:
        """True for a Clock that ticks by itself: an input of its FMU that drives others (SSP 2.0, 5.3.2.1)."""
        return self.interval_variability not in (None, "triggered")


@dataclass(slots=True, eq=False)
class Port:
    """A connector of a part. It is compared by identity.

    Attributes:
        entry: the signal that it represents, for a connector of a reference to a signal dictionary.
    """

    part: Part
    form: Form
    entry: Port | None = None

    @property
    def name(self) -> str:
        return self.form.name

    @property
    def kind(self) -> Kind:
        return self.form.kind

    @property
    def type(self) -> str | None:
        return self.form.type

    @property
    def unit(self) -> Unit | None:
        return self.form.unit

    @property
    def items(self) -> Mapping[str, int] | None:
        return self.form.items

    @property
    def variable(self) -> Variable | None:
        return self.form.variable

    def __str__(self) -> str:
        owner = self.part.element.name
        return f"{owner}.{self.form.name}" if owner else self.form.name


@dataclass(slots=True, eq=False)
class Part:
    """An element of the running system.

    Attributes:
        name: hierarchical name ("drone1.vehicle"); empty for the root system.
        system: the contents of a system, or of a component that contains a system; None for an FMU.
        fmu: None for systems, and for a component whose FMU could not be described.
        broken: its file could not be read; further problems of it are not reported.
        ports: by name; the elements of an array connector "A" are "A[1]", "A[1,2]".
        shapes: the shapes of its array connectors.
        open: array connectors of a system without a size in its file, until a connection determines the size.
        dictionaries: the signals of the dictionaries that it defines.
    """

    name: str
    element: Element
    parent: Part | None
    system: System | None = None
    fmu: FmuDescription | None = None
    broken: bool = False
    children: dict[str, Part] = field(default_factory=dict)
    ports: dict[str, Port] = field(default_factory=dict)
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    open: dict[str, tuple[Connector, Port]] = field(default_factory=dict)
    dictionaries: dict[str, Part] = field(default_factory=dict)

    def walk(self) -> Iterator[Part]:
        """Yields this part and all parts in it, outer before inner."""
        yield self
        for child in self.children.values():
            yield from child.walk()


def measure(root: System, problems: list[Problem]) -> bool:
    """Returns whether a system is small enough to be expanded; a few "#id" can represent billions of components.

    Args:
        root: the root system.
        problems: appended to.
    """
    sizes: dict[int, tuple[int, int]] = {}

    def extent(system: System, level: int) -> tuple[int, int]:
        """Returns the number of parts in a system, and the depth of their nesting."""
        if level > MAX_DEPTH:
            return 1, MAX_DEPTH + 1
        if id(system) not in sizes:
            parts, depth = 1, 1
            for element in system.elements:
                inner = element if isinstance(element, System) else getattr(element, "content", None)
                size, height = (1, 1) if inner is None else extent(inner, level + 1)
                parts, depth = parts + size, max(depth, height + 1)
            sizes[id(system)] = parts, depth
        return sizes[id(system)]

    parts, depth = extent(root, 1)
    if depth > MAX_DEPTH:
        problems.append(Problem(root.where, DEEP.text(MAX_DEPTH)))
    elif parts > MAX_PARTS:
        problems.append(Problem(root.where, LARGE.text(parts, MAX_PARTS)))
    return depth <= MAX_DEPTH and parts <= MAX_PARTS


def assemble(
    root: System,
    fmus: Mapping[Path, FmuDescription | None],
    problems: list[Problem],
    notes: list[str],
    sized: Mapping[str, FmuDescription] | None = None,
) -> Part:
    """Returns the tree of parts of a system.

    Args:
        root: the root system.
        fmus: descriptions by source path; None for a file that could not be described.
        problems, notes: appended to.
        sized: descriptions by hierarchical name, which override those by source path.
    """
    assembly = _Assembly(fmus, problems, notes, sized or {})
    part = assembly.part(root, None)
    assembly.settle(part)
    return part


class _Assembly:
    def __init__(
        self,
        fmus: Mapping[Path, FmuDescription | None],
        problems: list[Problem],
        notes: list[str],
        sized: Mapping[str, FmuDescription],
    ) -> None:
        self.fmus = fmus
        self.sized = sized
        self.problems = problems
        self.notes = notes
        self._alike: dict[tuple[int, int], Part] = {}
        """A part without findings, by the ids of its element and of its FMU."""

    def part(self, element: Element, parent: Part | None) -> Part:
        if parent is None:
            name = ""
        else:
            name = f"{parent.name}.{element.name}" if parent.name else element.name
        part = Part(name, element, parent)
        if isinstance(element, SignalDictionaryReference):
            self._reference(part, element)
            return part
        if isinstance(element, System):
            part.system = element
        elif element.content is not None:
            part.system = element.content
        else:
            part.fmu = self.sized.get(name) or (None if element.source is None else self.fmus.get(element.source))
            part.broken = part.fmu is None
        if part.system is None:
            self._fmu_ports(part)
            return part
        self._dictionaries(part, part.system)
        own = {connector.name: connector for connector in element.connectors} if element is not part.system else {}
        for connector in part.system.connectors:
            self._system_port(part, connector, own.pop(connector.name, None))
        for connector in own.values():
            text = f'"{element.name}" has no connector "{connector.name}" inside; {near(connector.name, part.ports)}'
            self.problems.append(Problem(connector.where, text))
        for child in part.system.elements:
            part.children.setdefault(child.name, self.part(child, part))
        return part

    def _dictionaries(self, part: Part, system: System) -> None:
        for dictionary in system.signal_dictionaries:
            holder = Part(f"{part.name}.{dictionary.name}" if part.name else dictionary.name, system, part)
            for entry in dictionary.entries.values():
                form = Form(entry.name, "inout", entry.where, *_described(entry))
                self._ports(holder, entry, Port(holder, form))
            part.dictionaries.setdefault(dictionary.name, holder)

    def _reference(self, part: Part, element: SignalDictionaryReference) -> None:
        """Returns the ports of a reference; the dictionary is searched from its system outwards (SSP 2.0, 5.5)."""
        around, known = part.parent, list[str]()
        while around is not None and element.dictionary not in around.dictionaries:
            known += around.dictionaries
            around = around.parent
        if around is None:
            hint = near(element.dictionary, known)
            text = f'there is no signal dictionary "{element.dictionary}" here or around; {hint}'
            self.problems.append(Problem(element.where, text))
            part.broken = True
            return
        holder = around.dictionaries[element.dictionary]
        for connector in element.connectors:
            whole = holder.ports.get(connector.name)
            shape = holder.shapes.get(connector.name)
            if whole is None and shape is None:
                names = [entry for entry in holder.ports if "[" not in entry] + list(holder.shapes)
                hint = near(connector.name, names)
                text = f'the signal dictionary "{element.dictionary}" has no "{connector.name}"; {hint}'
                self.problems.append(Problem(connector.where, text))
                continue
            if connector.dimensions and tuple(one.size for one in connector.dimensions) != (shape or ()):
                text = f'connector "{connector.name}" has other dimensions than its signal'
                self.problems.append(Problem(connector.where, text))
            for indices in indices_of(shape or ()):
                entry = holder.ports[element_name(connector.name, indices)]
                signal = entry.form
                if None not in (connector.type, signal.type) and connector.type != signal.type:
                    text = f'"{connector.name}" is {connector.type}, but its signal is {signal.type}, at {signal.where}'
                    self.problems.append(Problem(connector.where, text))
                form = Form(
                    name=signal.name,
                    kind=connector.kind,
                    where=connector.where,
                    type=connector.type or signal.type,
                    unit=connector.unit or signal.unit,
                    items=connector.items or signal.items,
                    mime_type=connector.mime_type or signal.mime_type,
                )
                part.ports[signal.name] = Port(part, form, entry)
            if shape is not None:
                part.shapes[connector.name] = shape

    def _ports(self, part: Part, connector: Connector, port: Port) -> None:
        """Adds a connector's port to a part, or one port for each element of an array."""
        if not connector.dimensions:
            part.ports[connector.name] = port
            return
        if any(dimension.size is None for dimension in connector.dimensions):
            part.open[connector.name] = connector, port
            return
        sizes = [1 if dimension.size is None else dimension.size for dimension in connector.dimensions]
        part.shapes[connector.name] = tuple(sizes)
        for indices in indices_of(tuple(sizes)):
            name = element_name(connector.name, indices)
            if name in part.ports:
                text = f'element "{name}" of an array connector is a connector of its own as well'
                self.problems.append(Problem(connector.where, text))
            part.ports[name] = replace(port, form=replace(port.form, name=name))

    def settle(self, root: Part) -> None:
        """Gives array connectors of open size the size of the connectors at the other end, through all systems."""
        waiting = [(part, name) for part in root.walk() for name in part.open]
        joined = _joined(root) if waiting else {}
        known = [(end, (part, name)) for part, name in waiting for end in joined.get((id(part), name), ())]
        while known:
            (part, name), (target, open_name) = known.pop()
            shape = part.shapes.get(name)
            if shape is None or open_name in target.shapes or not self._fits(target, open_name, shape):
                continue
            self._resize(target, open_name, shape)
            ends = joined.get((id(target), open_name), ())
            known += [((target, open_name), end) for end in ends if end[1] in end[0].open]
        for part, name in waiting:
            if name not in part.shapes:
                self.problems.append(Problem(part.open[name][1].form.where, OPEN_SIZE.text(name)))
                self._resize(part, name, (1,) * len(part.open[name][0].dimensions))

    @staticmethod
    def _fits(part: Part, name: str, shape: tuple[int, ...]) -> bool:
        return _agree([dimension.size for dimension in part.open[name][0].dimensions], shape)

    def _resize(self, part: Part, name: str, shape: tuple[int, ...]) -> None:
        connector, port = part.open[name]
        self._ports(part, replace(connector, dimensions=tuple(Dimension(size) for size in shape)), port)

    def _system_port(self, part: Part, inner: Connector, outer: Connector | None) -> None:
        """Adds a connector of a system; `outer` is its declaration at the component that represents the system."""
        if outer is not None:
            if outer.kind != inner.kind:
                text = f'connector "{inner.name}" is {outer.kind} here and {inner.kind} inside, at {inner.where}'
                self.problems.append(Problem(outer.where, text))
            if None not in (outer.type, inner.type) and outer.type != inner.type:
                text = f'connector "{inner.name}" is {outer.type} here and {inner.type} inside, at {inner.where}'
                self.problems.append(Problem(outer.where, text))
            sizes = [one.size for one in outer.dimensions]
            if outer.dimensions and not _agree(sizes, [one.size for one in inner.dimensions]):
                text = f'connector "{inner.name}" has other dimensions here than inside, at {inner.where}'
                self.problems.append(Problem(outer.where, text))
            self._same_unit(outer, inner.unit, f"inside, at {inner.where}")
        form = Form(
            name=inner.name,
            kind=inner.kind,
            where=inner.where if outer is None else outer.where,
            type=inner.type or (outer.type if outer is not None else None),
            unit=_said(inner.unit, outer.unit if outer is not None else None),
            items=inner.items or (outer.items if outer is not None else None),
            mime_type=inner.mime_type or (outer.mime_type if outer is not None else None),
            interval_variability=inner.interval_variability or (outer.interval_variability if outer else None),
        )
        if outer is not None and outer.dimensions:
            said = zip(inner.dimensions, outer.dimensions, strict=False)
            inner = replace(inner, dimensions=tuple(a if a.size is not None else Dimension(b.size) for a, b in said))
        self._ports(part, inner, Port(part, form))

    def _fmu_ports(self, part: Part) -> None:
        """Adds the connectors of an FMU; without findings, they are the same for all parts that use its file."""
        key = id(part.element), id(part.fmu)
        if (alike := self._alike.get(key)) is not None:
            part.ports = {name: Port(part, port.form) for name, port in alike.ports.items()}
            part.shapes = alike.shapes.copy()
            return
        findings = len(self.problems), len(self.notes)
        for connector in part.element.connectors:
            self._fmu_port(part, connector)
        if findings == (len(self.problems), len(self.notes)):
            self._alike[key] = part

    def _fmu_port(self, part: Part, connector: Connector) -> None:
        variable = None if part.fmu is None else part.fmu.variables.get(connector.name)
        if part.fmu is not None and connector.name in part.fmu.shapes:
            self._fmu_array(part, connector, part.fmu)
            return
        if part.fmu is None or variable is None:
            form = Form(connector.name, connector.kind, connector.where, *_described(connector))
            part.ports[connector.name] = Port(part, form)
        if part.fmu is None:
            return
        file = part.fmu.path.name
        if variable is None:
            known = [item.name for item in part.fmu.variables.values() if item.causality == connector.kind]
            text = f'{file} has no variable "{connector.name}"; {near(connector.name, known)}'
            self.problems.append(Problem(connector.where, text))
            return
        if connector.dimensions:
            text = f'connector "{connector.name}" is an array, but {file} has it as a scalar (as all of FMI 2)'
            self.problems.append(Problem(connector.where, text))
        kind = connector.kind
        if kind == "unspecified" or (kind == "constant" and variable.variability == "constant"):
            kind = cast(Kind, "constant" if variable.variability == "constant" else variable.causality)
        elif variable.causality != kind:
            text = f'connector "{connector.name}" is {kind}, but {file} has it as {variable.causality}'
            self.problems.append(Problem(connector.where, text))
        if connector.type is not None and connector.type not in _types(variable):
            text = f'connector "{connector.name}" is {connector.type}, but {file} has it as {variable.type}'
            self.problems.append(Problem(connector.where, text))
        self._same_clocks(connector, variable, file)
        self._same_unit(connector, variable.unit, f"in {part.fmu.path.name}")
        if connector.type == "Enumeration" and variable.type == "Enumeration":
            self._same_items(connector, variable, part.fmu)
        form = Form(
            name=connector.name,
            kind=kind,
            where=connector.where,
            type=_exact(variable),
            unit=_said(connector.unit, variable.unit),
            items=variable.items or connector.items,
            variable=variable,
            mime_type=connector.mime_type or variable.mime_type,
            interval_variability=variable.clock.kind if variable.clock is not None else None,
        )
        part.ports[connector.name] = Port(part, form)

    def _fmu_array(self, part: Part, connector: Connector, fmu: FmuDescription) -> None:
        """Returns an array of FMI 3 as one connector, with one port per element."""
        shape = fmu.shapes[connector.name]
        sizes = tuple(dimension.size for dimension in connector.dimensions)
        if (connector.dimensions and any(s not in (None, n) for s, n in zip(sizes, shape, strict=False))) or (
            sizes and len(sizes) != len(shape)
        ):
            text = f'connector "{connector.name}" has other dimensions than in {fmu.path.name}: {_by(shape)}'
            self.problems.append(Problem(connector.where, text))
        for indices in indices_of(shape):
            self._fmu_port(part, replace(connector, name=element_name(connector.name, indices), dimensions=()))
        part.shapes[connector.name] = shape

    def _same_clocks(self, connector: Connector, variable: Variable, file: str) -> None:
        """Checks that the connector's declarations of Clocks, if any, agree with the FMU's."""
        said, kind = connector.interval_variability, variable.clock.kind if variable.clock is not None else None
        if said is not None and kind is not None and said != kind:
            text = f'connector "{connector.name}" is a {said} Clock, but {file} has it as {kind}'
            self.problems.append(Problem(connector.where, text))
        for name in connector.clocks:
            if name not in variable.clocks:
                belongs = f"it belongs to {', '.join(variable.clocks)}" if variable.clocks else "it belongs to none"
                text = f'connector "{connector.name}" does not belong to a Clock "{name}" in {file}; {belongs}'
                self.problems.append(Problem(connector.where, text))

    def _same_unit(self, connector: Connector, other: Unit | None, place: str) -> None:
        if connector.unit is None or other is None:
            return
        text = f'connector "{connector.name}" has the unit "{connector.unit.name}" and "{other.name}" {place}'
        try:
            if conversion(connector.unit, other) == (1.0, 0.0):
                return
        except UndefinedUnit as error:
            self.notes.append(Finding(connector.where, f"{text}: not converted ({error})", "unit without definition"))
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
        elif variable.items and not connector.items.items() <= variable.items.items():  # an older file may list fewer
            text = (
                f'enumeration "{connector.enumeration}" of connector "{connector.name}" has other items than '
                f"{fmu.path.name}: {listed(connector.items)} instead of {listed(variable.items)}"
            )
            self.problems.append(Problem(connector.where, text))


def _agree(sizes: Sequence[int | None], others: Sequence[int | None]) -> bool:
    """Returns whether two sizes may be the dimensions of one array; None is an unknown size."""
    return len(sizes) == len(others) and all(None in (a, b) or a == b for a, b in zip(sizes, others, strict=True))


def _joined(root: Part) -> dict[tuple[int, str], list[tuple[Part, str]]]:
    """Returns, for each connector (by its part's id and its name), the connectors connected to it as a whole."""
    joined: dict[tuple[int, str], list[tuple[Part, str]]] = {}
    for part in root.walk():
        for one in () if part.system is None else part.system.connections:
            if one.start_indices or one.end_indices:
                continue
            start = part if one.start_element is None else part.children.get(one.start_element)
            end = part if one.end_element is None else part.children.get(one.end_element)
            if start is not None and end is not None:
                joined.setdefault((id(start), one.start_connector), []).append((end, one.end_connector))
                joined.setdefault((id(end), one.end_connector), []).append((start, one.start_connector))
    return joined


def _said(own: Unit | None, other: Unit | None) -> Unit | None:
    """Returns the unit of a connector: its own, or the other side's if its own is missing or has no definition."""
    return own if own is not None and (own.base is not None or other is None) else other


def _described(connector: Connector) -> tuple[Any, ...]:
    """Returns type, unit, items, no variable, and MIME type, as in `Form`."""
    return connector.type, connector.unit, connector.items, None, connector.mime_type


def indices_of(shape: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yields the indices of all elements of an array, last index fastest; one empty tuple for a scalar."""
    return product(*(range(1, size + 1) for size in shape))


def element_name(name: str, indices: tuple[int, ...]) -> str:
    """Returns the name of an element of an array connector, such as "A[1,2]"; for a scalar, its own name."""
    return f"{name}[{','.join(map(str, indices))}]" if indices else name


def _by(shape: tuple[int, ...]) -> str:
    return "x".join(map(str, shape))


def _exact(variable: Variable) -> str:
    """Returns the type of a variable in SSP's terms: "UInt8" for such a variable of FMI 3, "Integer" for Int32."""
    own = variable.fmi_type if variable.type in ("Real", "Integer") and variable.fmi_type else variable.type
    return SAME_TYPE.get(own, own)


def _types(variable: Variable) -> set[str]:
    """Returns the types that a connector of a variable may declare."""
    names = {variable.type, _exact(variable)}
    return names | {"String", "Binary"} if variable.packet_capacity is not None else names
