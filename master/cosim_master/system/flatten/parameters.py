"""Applies parameter bindings: determines the start value of each variable of each FMU, and its origin.

Precedence (SSP 2.0, section 5.2.3): a higher level of the hierarchy overrides a lower one, and at one level the later
binding takes precedence. A component that is an .ssd counts as its root system, with the component's bindings after the
system's. A name applies to all its matches, and is ignored, with a note, if it has none. Within one set of parameters,
which the standard does not define, a connector of a system overrides the variables that it is connected to, as the
connection itself does. With a parameter mapping, only the named parameters are applied, under their new names.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace

from cosim_master.diagnostics.errors import Finding, Problem, Where
from cosim_master.diagnostics.limitations import MAPPED_BACK, SIGNAL_START
from cosim_master.diagnostics.names import alike, did_you_mean, is_pattern, matching, near, near_pattern
from cosim_master.files.xml import plain_number, whole
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.description.units import UndefinedUnit, Unit, UnitError, conversion
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.system.flatten.topology.components import Part, Port, element_name, indices_of
from cosim_master.system.flatten.topology.wiring import SENDING, Route, Way, Wiring
from cosim_master.system.flatten.typed_values import converted, kind_of, of_type, unsettable
from cosim_master.system.reading.ssp.grammar import SAME_TYPE
from cosim_master.system.structure import (
    MAX_DEPTH,
    Connection,
    Parameter,
    ParameterBinding,
    SignalDictionaryReference,
    Value,
)

__all__ = ["OPTION", "Assignment", "Bindings", "Unmatched"]

_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
_FLOATS = ("Real", "Float32")
OPTION = Where("--set")
_NAMED = 5
"""Number of variables that a message names."""


@dataclass(frozen=True, slots=True)
class Unmatched:
    """A parameter without a match: its hierarchical name, and a suggestion."""

    name: str
    where: Where
    hint: str


@dataclass(frozen=True, slots=True)
class Assignment:
    """A start value assigned to a variable, and its origin.

    Attributes:
        where: the parameter in its file.
        owner: hierarchical name of the system or component with the binding; empty for the root.
        name: the name by which it was applied there.
        text: the value as written, with its unit.
        value: the value for the variable, in its own unit and type.
    """

    where: Where
    owner: str
    name: str
    text: str
    value: Value


class Bindings:
    """Start values by instance name and variable name, after `apply` and then `override`.

    Attributes:
        values: values in unit and type of the variable; enumerations as integers.
        unmatched: parameters that do not set any variable.
        history: all values given to a variable, by instance and variable name; the last one applies.
    """

    def __init__(self, wiring: Wiring, problems: list[Problem], notes: list[str]) -> None:
        self.values: dict[str, dict[str, Value]] = {}
        self.unmatched: list[Unmatched] = []
        self.history: dict[tuple[str, str], list[Assignment]] = {}
        self._applied: tuple[Part, str, Parameter] | None = None
        self._one_set: dict[tuple[str, str], tuple[str, Value]] | None = None
        self._wiring = wiring
        self._problems = problems
        self._notes = notes

    def apply(self, part: Part) -> None:
        """Applies all bindings in `part`, inner bindings first so that outer ones override them."""
        for child in part.children.values():
            self.apply(child)
        bindings: tuple[ParameterBinding, ...] = part.element.parameter_bindings
        if part.system is not None and part.system is not part.element:
            bindings = part.system.parameter_bindings + bindings
        for binding in bindings:
            if isinstance(part.element, SignalDictionaryReference):
                self._notes.append(f"{binding.where}: a reference to a signal dictionary has no parameters to bind")
                continue
            # A set of parameters has no order: values from connections take precedence, whatever their positions in the
            # set.
            self._one_set = {}
            for name, parameter in sorted(self._mapped(part, binding), key=lambda item: _place(part, item[0])):
                self._set(part, name, parameter)
            self._one_set = None

    def _mapped(self, part: Part, binding: ParameterBinding) -> Iterator[tuple[str, Parameter]]:
        """Returns the parameters that a binding applies, with the transformations of its mapping."""
        named = {binding.prefix + parameter.name: parameter for parameter in binding.parameters}
        if binding.mapping is None:
            yield from named.items()
            return
        used = set()
        for entry in binding.mapping:
            if not entry.source:
                continue
            if (parameter := named.get(entry.source)) is None:
                self._notes.append(
                    f'{entry.where}: there is no parameter "{entry.source}"; {near(entry.source, named)}'
                )
                continue
            used.add(entry.source)
            yield (
                entry.target,
                replace(
                    parameter,
                    transformation=entry.transformation,
                    suppress_unit_conversion=entry.suppress_unit_conversion,
                ),
            )
        if empty := [entry.where for entry in binding.mapping if not entry.source]:
            self._notes.append(
                f'{empty[0]}: source="" names no parameter: {len(empty)} entries of the mapping map nothing'
            )
        for name in (one for one in named if one not in used):
            full = f"{part.name}.{name}" if part.name else name
            hint = "the parameter mapping of its binding does not name it"
            self.unmatched.append(Unmatched(full, named[name].where, hint))

    def take_constants(self) -> None:
        """Sets structural parameters to the values of the constants connected to them, which override all other values.

        Structural parameters determine the sizes of arrays, which must be known before any FMU is loaded. The values of
        constants are therefore taken from descriptions.
        """
        for port, (connection, _) in self._wiring.incoming.items():
            variable = port.form.variable
            if variable is None or variable.causality != "structuralParameter":
                continue
            route = self._wiring.route(port)
            if route.source is None:
                continue
            constant = route.source.variable
            if constant is None or constant.start is None:
                self._problems.append(Problem(connection.where, f"{route.source}: its FMU does not say its value"))
                continue
            value: Value = constant.start
            if not isinstance(value, str):
                way = route.way
                value = type(value)(way.mapping[int(value)]) if value in way.mapping else value
                value = value if (way.factor, way.offset) == (1.0, 0.0) else way.factor * value + way.offset
            parameter = Parameter(constant.name, constant.type, value, connection.where)
            self._applied = route.source.part, constant.name, parameter
            self._store_value(port.part, variable, value, parameter)

    def override(self, values: Mapping[str, str], hidden: Container[str] = ()) -> None:
        """Sets values by hierarchical name or pattern, which override all others; here, a name must have a match.

        Args:
            hidden: names of elements of the root system that hide settings of the run (see `reading.overrides`).
        """
        root = self._wiring.root
        for name, text in values.items():
            matches = list(_matches(root, name))
            if not matches and is_pattern(name):
                matches = self._matched(name)
            elif not matches:
                tag = name.partition(".")[0]
                remark = f'; "{tag}" is an element of this system here, not the annotation' if tag in hidden else ""
                close = alike(name, self._settable())
                hint = did_you_mean(close) if close else _hint(root, name)
                message = f'there is no variable "{name}"; {hint}{remark}'
                self._problems.append(Problem(OPTION, message))
            for part, target in matches:
                if target is None:
                    continue
                kind, items = target.type, target.items
                kind = "Real" if kind == "Clock" else kind
                if isinstance(target, Port):
                    kind = kind or next((item.type for _, item, _ in self._driven(target)), None)
                parameter = self._from_text(name, text, kind, items, OPTION)
                if parameter is not None:
                    self._applied = root, name, parameter
                    self._assign(part, target, parameter)

    def _settable(self) -> Iterator[str]:
        """Yields the hierarchical names of all variables of FMUs that can be set, and of all connectors of systems."""
        for part in self._wiring.root.walk():
            prefix = f"{part.name}." if part.name else ""
            if part.fmu is None:
                yield from (prefix + name for name in part.ports)
            else:
                yield from (prefix + name for name, one in part.fmu.variables.items() if one.settable)

    def _matched(self, pattern: str) -> list[tuple[Part, Variable | Port | None]]:
        """Returns the matches of a pattern that can be set: variables of FMUs, and connectors of systems."""
        named: dict[str, tuple[Part, Variable | Port | None]] = {}
        broken = False
        for part in self._wiring.root.walk():
            broken = broken or part.broken
            targets: Mapping[str, Variable | Port] = part.ports if part.fmu is None else part.fmu.variables
            prefix = f"{part.name}." if part.name else ""
            named |= {prefix + name: (part, target) for name, target in targets.items()}
        found = matching(pattern, named)
        if not found and not broken:
            text = f'"{pattern}" matches no variable; {near_pattern(pattern, named)}'
            self._problems.append(Problem(OPTION, text))
        refused: dict[str, list[str]] = {}
        for name in found:
            target = named[name][1]
            if isinstance(target, Variable) and (trouble := unsettable(target, "each")) is not None:
                refused.setdefault(trouble, []).append(name)
        for trouble, names in refused.items():
            some = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
            text = f'"{pattern}" matches {len(found)} variables, and {len(names)} of them {trouble}: {some}'
            self._problems.append(Problem(OPTION, text))
        return [] if refused else [named[name] for name in found]

    def _from_text(
        self, name: str, text: str, kind: str | None, items: Mapping[str, int] | None, where: Where
    ) -> Parameter | None:
        value: Value
        try:
            kind = SAME_TYPE.get(kind or "", kind)
            if kind in _FLOATS:
                value = plain_number(text)
            elif kind == "Boolean":
                value = _BOOLEANS[text.strip().lower()]
            elif kind in INTEGER_RANGES or (kind == "Enumeration" and text.strip() not in (items or {})):
                if (found := whole(text, -(2**63), 2**64 - 1)) is None:
                    raise ValueError(f"{text} is no integer")
                kind, value = "Integer", found
            else:
                kind, value = kind or "String", text.strip() if kind == "Enumeration" else text
        except (ValueError, KeyError):
            expected = {"Boolean": "true or false", "Real": "a number", "Integer": "an integer"}
            valid = expected.get(kind or "", "one of " + ", ".join(items or ()))
            self._problems.append(Problem(where, f'{name}: "{text}" is not of its type; valid: {valid}'))
            return None
        return Parameter(name, kind, value, where)

    def _set(self, part: Part, name: str, parameter: Parameter) -> None:
        self._applied = part, name, parameter
        if parameter.shape:
            self._set_array(part, name, parameter)
            return
        matches = list(_matches(part, name)) or self._named_from_outside(part, name, parameter)
        if matches and parameter.first is not None:
            text = f'parameter "{parameter.name}" is already in this set, at {parameter.first}'
            self._problems.append(Problem(parameter.where, text))
        for owner, target in matches:
            if target is not None:
                self._assign(owner, target, parameter)
        if not matches:
            self._unmatched(part, name, parameter, _hint(part, name))

    def _named_from_outside(
        self, part: Part, name: str, parameter: Parameter
    ) -> list[tuple[Part, Variable | Port | None]]:
        """Returns the matches of a name that begins with the component's own name, as OMSimulator writes them."""
        head = f"{part.element.name}."
        matches = list(_matches(part, name.removeprefix(head))) if name.startswith(head) else []
        if matches:
            text = f'"{name}" in a binding of "{part.element.name}" itself is read as "{name.removeprefix(head)}"'
            self._notes.append(Finding(parameter.where, text, "names in bindings of components"))
        return matches

    def _unmatched(self, part: Part, name: str, parameter: Parameter, hint: str) -> None:
        full = f"{part.name}.{name}" if part.name else name
        self.unmatched.append(Unmatched(full, parameter.where, hint))

    def _set_array(self, part: Part, name: str, parameter: Parameter) -> None:
        """Sets all elements of the arrays that a name matches: connectors of systems, and variables of FMI 3."""
        found = False
        for owner, rest in _owners(part, name):
            shapes = owner.shapes if owner.fmu is None else owner.fmu.shapes
            if rest in shapes:
                found = True
                if shapes[rest] != parameter.shape:
                    sizes = ["x".join(map(str, shape)) for shape in (parameter.shape, shapes[rest])]
                    text = f'"{parameter.name}" has {sizes[0]} values, but its target has {sizes[1]} elements'
                    self._problems.append(Problem(parameter.where, text))
                    continue
                targets: Mapping[str, Variable | Port] = owner.ports if owner.fmu is None else owner.fmu.variables
                for indices, value in zip(indices_of(parameter.shape), parameter.elements, strict=True):
                    one = replace(parameter, value=value, shape=(), elements=())
                    self._assign(owner, targets[element_name(rest, indices)], one)
            elif owner.fmu is not None and rest in owner.fmu.variables:
                found = True
                text = f'"{parameter.name}" is an array, but {owner.fmu.path.name} has it as a scalar'
                self._problems.append(Problem(parameter.where, text))
        if not found:
            hint = "an array sets arrays only; name the elements one by one to set scalars"
            self._unmatched(part, name, parameter, hint)

    def _assign(self, part: Part, target: Variable | Port, parameter: Parameter) -> None:
        if isinstance(target, Variable):
            self._store(part, target, parameter)
            return
        if target.entry is not None:
            self._notes.append(f"{parameter.where}: {SIGNAL_START.text(parameter.name)}")
            return
        unit = target.unit or parameter.unit
        kind = target.type or SAME_TYPE.get(parameter.type, parameter.type)
        trouble, value = converted(parameter, kind, unit, target.items)
        self._look_at_units(parameter, kind, unit)
        if trouble is not None:
            self._problems.append(Problem(parameter.where, f'"{parameter.name}" {trouble}'))
            return
        start = Route(None, Way(1.0, 0.0, unit, kind, target.items))
        if target.kind in SENDING:
            self._backwards(target, value, start, parameter)
            return
        driven = list(self._driven(target))
        if not driven:
            self._notes.append(f'{parameter.where}: "{parameter.name}" sets nothing: {target} is not connected inside')
        for inner, variable, connections in driven:
            route = start
            for connection, port in connections:
                route = self._wiring.hop(route, connection, port)
            way = route.way
            number = way.mapping.get(value, value) if isinstance(value, int) else value
            if isinstance(number, bool) and (variable.type in _FLOATS or variable.type in INTEGER_RANGES):
                number = int(number)
            if variable.type in _FLOATS and not isinstance(number, str | bool):
                number = way.factor * float(number) + way.offset
            self._store_value(inner, variable, number, parameter)

    def _look_at_units(self, parameter: Parameter, kind: str, unit: Unit | None) -> None:
        """Adds a note that a value is not converted because a unit has no definition."""
        if kind not in _FLOATS or parameter.unit is None or unit is None or parameter.suppress_unit_conversion:
            return
        try:
            conversion(parameter.unit, unit)
        except UndefinedUnit as error:
            text = f'"{parameter.name}" is not converted: {error}'
            self._notes.append(Finding(parameter.where, text, "unit without definition"))
        except UnitError:
            return  # a problem, reported where the value is converted

    def _backwards(self, port: Port, value: Value, start: Route, parameter: Parameter) -> None:
        """Sets the variable that drives a connector of a system, so that the connector has the given value."""
        route = self._wiring.route(port)
        if route.source is None or route.source.variable is None:
            self._notes.append(f'{parameter.where}: "{parameter.name}" sets nothing: nothing drives {port}')
            return
        way = route.way
        if way.mapping:
            text = MAPPED_BACK.text(parameter.name, port)
            self._problems.append(Problem(parameter.where, text))
            return
        if start.way.type in _FLOATS and not isinstance(value, str | bool):
            if way.factor == 0.0:
                text = f'"{parameter.name}" cannot be set: what leads to {port} has the factor 0'
                self._problems.append(Problem(parameter.where, text))
                return
            value = (float(value) - way.offset) / way.factor
        self._store_value(route.source.part, route.source.variable, value, parameter)

    def _driven(self, port: Port) -> Iterator[tuple[Part, Variable, tuple[tuple[Connection, Port], ...]]]:
        """Returns the FMU variables that a connector of a system drives, with the connections that lead to them."""
        open_paths: list[tuple[Port, tuple[tuple[Connection, Port], ...]]] = [(port, ())]
        seen = {port}
        while open_paths:
            at, path = open_paths.pop()
            for connection, target in self._wiring.outgoing.get(at, ()):
                if target in seen:
                    continue
                seen.add(target)
                if target.variable is not None:
                    yield target.part, target.variable, (*path, (connection, target))
                elif target.kind in ("input", "parameter"):
                    open_paths.append((target, (*path, (connection, target))))

    def _store(self, part: Part, variable: Variable, parameter: Parameter) -> None:
        kind = kind_of(variable)
        trouble, value = unsettable(variable), parameter.value
        unit = variable.unit
        if unit is None and (port := part.ports.get(variable.name)) is not None:
            unit = port.unit  # that of its connector if the FMU has none, as for connections
        if trouble is None:
            trouble, value = converted(parameter, kind, unit, variable.items)
            self._look_at_units(parameter, kind, variable.unit)
        if trouble is not None:
            self._problems.append(Problem(parameter.where, f'"{parameter.name}" {trouble}'))
            return
        self._store_value(part, variable, value, parameter)

    def _store_value(self, part: Part, variable: Variable, value: Value, parameter: Parameter) -> None:
        """Gives a variable a start value that is already in its own unit."""
        trouble = unsettable(variable)
        if trouble is None:
            trouble, value = of_type(variable, value)
        if trouble is not None:
            self._problems.append(Problem(parameter.where, f'"{parameter.name}" {trouble}'))
            return
        self.values.setdefault(part.name, {})[variable.name] = value
        if self._applied is not None:
            owner, name, given = self._applied
            self._look_at_set(part, variable, name, value, given.where)
            made = Assignment(given.where, owner.name, name, _shown(parameter), value)
            self.history.setdefault((part.name, variable.name), []).append(made)

    def _look_at_set(self, part: Part, variable: Variable, name: str, value: Value, where: Where) -> None:
        """Adds a note that a set of parameters gives one variable two values, under two names."""
        if self._one_set is None:
            return
        before, first = self._one_set.setdefault((part.name, variable.name), (name, value))
        if before != name and first != value:
            text = f'"{before}" and "{name}" set one variable, {part.name}.{variable.name}, in one set of parameters'
            self._notes.append(f'{where}: {text}: "{name}" counts, since connections decide, not the order in the set')
        self._one_set[part.name, variable.name] = (name, value)


def _shown(parameter: Parameter) -> str:
    value = str(parameter.value).lower() if isinstance(parameter.value, bool) else str(parameter.value)
    return value if parameter.unit is None else f"{value} {parameter.unit.name}"


def _owners(part: Part, name: str) -> Iterator[tuple[Part, str]]:
    """Yields every component in which a hierarchical name may end, with the remaining part of the name."""
    yield part, name
    # Names of elements may contain dots, so every dot may separate an element from the remaining name.
    dot = name.find(".")
    while dot >= 0:
        if (child := part.children.get(name[:dot])) is not None:
            yield from _owners(child, name[dot + 1 :])
        dot = name.find(".", dot + 1)


def _place(part: Part, name: str) -> int:
    """Returns the rank of a name in the flow of values: driven names first, then their sources, outer systems last."""
    for owner, rest in _owners(part, name):
        if owner.fmu is not None:
            continue
        port = owner.ports.get(rest) or owner.ports.get(element_name(rest, (1,) * len(owner.shapes.get(rest, ()))))
        if port is not None:
            depth, above = MAX_DEPTH + 1, owner.parent
            while above is not None:
                depth, above = depth - 1, above.parent
            return -depth if port.kind in SENDING else depth
    return 0


def _matches(part: Part, name: str) -> Iterator[tuple[Part, Variable | Port | None]]:
    """Returns all matches of a hierarchical name in `part`; None for a name that leads into a broken part."""
    for owner, rest in _owners(part, name):
        if owner.broken:
            yield owner, None
        elif owner.fmu is not None:
            if (variable := owner.fmu.variables.get(rest)) is not None:
                yield owner, variable
        elif (port := owner.ports.get(rest)) is not None:
            yield owner, port


def _hint(part: Part, name: str) -> str:
    """Returns a suggestion for a name without a match: similar names at the level at which it fails."""
    rest, prefix = name, ""
    while part.fmu is None and part.system is not None:
        dots = [index for index, character in enumerate(rest) if character == "."]
        child = next((part.children[rest[:dot]] for dot in dots if rest[:dot] in part.children), None)
        if child is None:
            break
        prefix += child.element.name + "."
        rest = rest[len(child.element.name) + 1 :]
        part = child
    if part.fmu is not None:
        known = [variable.name for variable in part.fmu.variables.values() if variable.settable]
    else:
        known = [*part.ports, *(f"{child}." for child in part.children)]
    return near(prefix + rest, (prefix + item for item in known))
