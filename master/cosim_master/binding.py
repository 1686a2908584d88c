"""Applies parameter bindings: which start value each variable of each FMU gets, and from whom.

Precedence (SSP 2.0, section 5.3.1.3): a higher level of the hierarchy wins over a lower one, at one level the later
binding wins; a component that is an .ssd counts as its root system with its own bindings after the system's. A name
applies to everything it matches, and is ignored, with a note, if it matches nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cosim_master.document import near
from cosim_master.errors import Problem, Where
from cosim_master.fmu import Variable
from cosim_master.system import Connection, Parameter, ParameterBinding, Value
from cosim_master.units import Unit, UnitError, conversion
from cosim_master.wiring import Part, Port, Route, Wiring

__all__ = ["Bindings", "Unmatched"]

_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, slots=True)
class Unmatched:
    """A parameter that matches nothing: its hierarchical name, and what may have been meant."""

    name: str
    where: Where
    hint: str


class Bindings:
    """Start values by instance name and variable name, after `apply` and then `override`.

    Attributes:
        values: converted to unit and type of the variable; enumerations as integers.
        unmatched: parameters that set nothing.
    """

    def __init__(self, wiring: Wiring, problems: list[Problem], notes: list[str]) -> None:
        self.values: dict[str, dict[str, Value]] = {}
        self.unmatched: list[Unmatched] = []
        self._wiring = wiring
        self._problems = problems
        self._notes = notes

    def apply(self, part: Part) -> None:
        """Apply all bindings in `part`, inner ones first so that outer ones win."""
        for child in part.children.values():
            self.apply(child)
        bindings: tuple[ParameterBinding, ...] = part.element.parameter_bindings
        if part.system is not None and part.system is not part.element:
            bindings = part.system.parameter_bindings + bindings
        for binding in bindings:
            for parameter in binding.parameters:
                self._set(part, binding.prefix + parameter.name, parameter)

    def override(self, values: Mapping[str, str]) -> None:
        """Set by hierarchical name, over everything else; here a name that matches nothing is a problem."""
        root = self._wiring.root
        for name, text in values.items():
            where = Where("--set")
            matches = list(_matches(root, name))
            if not matches:
                self._problems.append(Problem(where, f'there is no variable "{name}"; {_hint(root, name)}'))
            for part, target in matches:
                if target is None:
                    continue
                kind, items = target.type, target.items
                if isinstance(target, Port):
                    kind = kind or next((item.type for _, item, _ in self._driven(target)), None)
                parameter = self._from_text(name, text, kind, items, where)
                if parameter is not None:
                    self._assign(part, target, parameter)

    def _from_text(
        self, name: str, text: str, kind: str | None, items: Mapping[str, int] | None, where: Where
    ) -> Parameter | None:
        value: Value
        try:
            if kind == "Real":
                value = float(text)
            elif kind == "Boolean":
                value = _BOOLEANS[text.strip().lower()]
            elif kind == "Integer" or (kind == "Enumeration" and text.strip() not in (items or {})):
                kind, value = "Integer", int(text)
            else:
                kind, value = kind or "String", text.strip() if kind == "Enumeration" else text
        except (ValueError, KeyError):
            expected = {"Boolean": "true or false", "Real": "a number", "Integer": "an integer"}
            valid = expected.get(kind or "", "one of " + ", ".join(items or ()))
            self._problems.append(Problem(where, f'{name}: "{text}" is not of its type; valid: {valid}'))
            return None
        return Parameter(name, kind, value, where)

    def _set(self, part: Part, name: str, parameter: Parameter) -> None:
        matches = list(_matches(part, name))
        for owner, target in matches:
            if target is not None:
                self._assign(owner, target, parameter)
        if not matches:
            full = f"{part.name}.{name}" if part.name else name
            self.unmatched.append(Unmatched(full, parameter.where, _hint(part, name)))

    def _assign(self, part: Part, target: Variable | Port, parameter: Parameter) -> None:
        if isinstance(target, Variable):
            self._store(part, target, parameter, parameter.unit)
            return
        if target.kind in ("output", "calculatedParameter"):
            text = f'"{parameter.name}" sets the {target.kind} {target} of a system, which is not supported yet'
            self._problems.append(Problem(parameter.where, text))
            return
        driven = list(self._driven(target))
        if not driven:
            self._notes.append(f'{parameter.where}: "{parameter.name}" sets nothing: {target} is not connected inside')
        for inner, variable, connections in driven:
            self._through(inner, variable, connections, target, parameter)

    def _driven(self, port: Port) -> Iterator[tuple[Part, Variable, tuple[tuple[Connection, Port], ...]]]:
        """The FMU variables behind a connector of a system, with the connections that lead there."""
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

    def _through(
        self,
        part: Part,
        variable: Variable,
        connections: tuple[tuple[Connection, Port], ...],
        port: Port,
        parameter: Parameter,
    ) -> None:
        """Set a variable by the value of a system's connector, as the connections between them convert it."""
        unit = port.unit or parameter.unit
        route = Route(None, 1.0, 0.0, unit, port.type or parameter.type, port.items)
        for connection, target in connections:
            route = self._wiring.hop(route, connection, target)
        if variable.type != "Real" or isinstance(parameter.value, bool | str):
            self._store(part, variable, parameter, None)
            return
        value = float(parameter.value)
        if unit is not None and parameter.unit is not None:
            try:
                factor, offset = conversion(parameter.unit, unit)
            except UnitError as error:
                self._problems.append(Problem(parameter.where, f'"{parameter.name}": {error}'))
                return
            value = factor * value + offset
        converted = Parameter(parameter.name, "Real", route.factor * value + route.offset, parameter.where)
        self._store(part, variable, converted, None)

    def _store(self, part: Part, variable: Variable, parameter: Parameter, unit: Unit | None) -> None:
        trouble, value = _start_value(variable, parameter, unit)
        if trouble is not None:
            self._problems.append(Problem(parameter.where, f'"{parameter.name}" {trouble}'))
        else:
            self.values.setdefault(part.name, {})[variable.name] = value


def _matches(part: Part, name: str) -> Iterator[tuple[Part, Variable | Port | None]]:
    """Everything a hierarchical name stands for in `part`; None for a name that leads into a broken part."""
    if part.broken:
        yield part, None
        return
    if part.fmu is not None:
        if (variable := part.fmu.variables.get(name)) is not None:
            yield part, variable
        return
    if (port := part.ports.get(name)) is not None:
        yield part, port
    # Names of elements may contain dots, so every dot may be the one between an element and the rest.
    dot = name.find(".")
    while dot >= 0:
        if (child := part.children.get(name[:dot])) is not None:
            yield from _matches(child, name[dot + 1 :])
        dot = name.find(".", dot + 1)


def _hint(part: Part, name: str) -> str:
    """What may have been meant by a name that matches nothing: names at the level where it goes wrong."""
    rest, prefix = name, ""
    while part.fmu is None:
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


def _start_value(variable: Variable, parameter: Parameter, unit: Unit | None) -> tuple[str | None, Value]:
    """What is wrong with setting a variable to a value, or None and the value in the variable's type and unit."""
    value = parameter.value
    if not variable.settable:
        initial = f", initial {variable.initial}" if variable.initial else ""
        what = f"{variable.causality}, {variable.variability}{initial}"
        return f"cannot be set: it is {what}; only inputs and variables with a start value can be", value
    if variable.type == "Real" and parameter.type in ("Real", "Integer"):
        number = float(value)
        if unit is not None and variable.unit is not None:
            try:
                factor, offset = conversion(unit, variable.unit)
            except UnitError as error:
                return f"cannot be set: {error}", value
            number = factor * number + offset
        value = number
    elif variable.type == "Enumeration" and parameter.type == "Enumeration":
        items = variable.items or {}
        if value not in items:
            return f'is set to "{value}", which its enumeration does not have; {near(str(value), items)}', value
        value = items[str(value)]
    elif variable.type == "Enumeration" and parameter.type == "Integer":
        if variable.items and value not in variable.items.values():
            listed = ", ".join(f"{item} = {number}" for item, number in variable.items.items())
            return f"is set to {value}, which its enumeration does not have; valid: {listed}", value
    elif variable.type != parameter.type:
        return f"is given as {parameter.type}, but its variable is {variable.type}", value
    return _out_of_range(variable, value), value


def _out_of_range(variable: Variable, value: Value) -> str | None:
    if isinstance(value, bool | str) or variable.type == "Enumeration":
        return None
    if isinstance(value, float) and math.isnan(value):
        return "is set to NaN, which is no start value"
    if variable.type == "Integer" and not -(2**31) <= value < 2**31:
        return f"is set to {value}, which does not fit into 32 bits"
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    if not low <= value <= high:
        return f"is set to {value:g}, which is outside of its range; valid: {low:g} to {high:g}"
    return None
