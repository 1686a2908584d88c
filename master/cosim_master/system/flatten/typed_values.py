"""Values of parameters in the type and unit of a variable: conversion, mapping, and checks of type and range."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.description.units import UndefinedUnit, Unit, UnitError, conversion
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.system.reading.ssp.grammar import SAME_TYPE
from cosim_master.system.structure import LinearTransformation, Parameter, Value

__all__ = ["converted", "kind_of", "of_type", "unsettable"]

_FLOATS = ("Real", "Float32")


def unsettable(variable: Variable, subject: str = "it") -> str | None:
    """Returns the reason why a variable, the `subject` of the sentence, cannot be set; None if it can."""
    if variable.settable:
        return None
    if variable.clock is not None:
        what = f"{subject} is a {variable.clock.kind} Clock"
        return f"cannot be set: {what}; only the interval of fixed and tunable ones with an intervalDecimal can be"
    initial = f' (initial="{variable.initial}")' if variable.initial else ""
    what = f"{variable.variability} {variable.causality}{initial}"
    return f"cannot be set: {subject} is a {what}; only inputs and variables with a start value can be"


def converted(
    parameter: Parameter, kind: str, unit: Unit | None, items: Mapping[str, int] | None
) -> tuple[str | None, Value]:
    """Returns the problem with a parameter for a variable of type `kind`; or None, and the converted value.

    First the unit is converted, then the transformation of a parameter mapping is applied (SSP 2.0, section 7.1.1).
    The value of an Enumeration remains the name of an item if the items are not known.
    """
    value, given = parameter.value, SAME_TYPE.get(parameter.type, parameter.type)
    if kind in _FLOATS and (given in _FLOATS or given in INTEGER_RANGES):
        number = float(value)
        if unit is not None and parameter.unit is not None and not parameter.suppress_unit_conversion:
            try:
                factor, offset = conversion(parameter.unit, unit)
            except UndefinedUnit:
                factor, offset = 1.0, 0.0
            except UnitError as error:
                return f"cannot be set: {error}", value
            number = factor * number + offset
        table = parameter.transformation
        if isinstance(table, LinearTransformation):
            return None, table.factor * number + table.offset
        return (None, number) if table is None else (f"cannot be transformed by <{table.type}Mapping...>", value)
    if kind != given and not (kind in (*INTEGER_RANGES, "Enumeration") and given in (*INTEGER_RANGES, "Enumeration")):
        return f"is given as {given}, but its variable is {kind}", value
    if kind in INTEGER_RANGES and given == "Enumeration":
        return f"is given as {given}, but its variable is {kind}", value
    return _by_table(parameter, kind, items)


def _by_table(parameter: Parameter, kind: str, items: Mapping[str, int] | None) -> tuple[str | None, Value]:
    """Returns a value other than a Real after the mapping transformation of a parameter mapping, if one exists."""
    value, table = parameter.value, parameter.transformation
    if isinstance(table, LinearTransformation):
        return f"cannot be transformed: a LinearTransformation needs a Real, but it is {kind}", value
    if table is not None:
        valid = {"Boolean": ("Boolean",), "Enumeration": ("Enumeration",)}.get(
            table.type, (*INTEGER_RANGES, "Enumeration")
        )
        if kind not in valid or (table.type == "Enumeration" and not isinstance(value, str)):
            return f"cannot be transformed: <{table.type}MappingTransformation> is not for {parameter.type}", value
        if table.type == "Integer" and isinstance(value, str):
            value = (items or {}).get(value, value)
        value = dict(table.entries).get(value, value)
    if kind == "Enumeration" and isinstance(value, str) and items is not None:
        if value not in items:
            return f'is set to "{value}", which its enumeration does not have; {near(value, items)}', value
        value = items[value]
    return None, value


def of_type(variable: Variable, value: Value) -> tuple[str | None, Value]:
    """Returns the problem with a value for a variable; or None, and the value in the variable's type."""
    kind, items = kind_of(variable), variable.items or {}
    if kind == "Enumeration" and isinstance(value, str):
        if value not in items:
            return f'is set to "{value}", which its enumeration does not have; {near(value, items)}', value
        value = items[value]
    elif kind == "Enumeration" and items and value not in items.values():
        listed = ", ".join(f"{item} = {number}" for item, number in items.items())
        return f"is set to {value}, which its enumeration does not have; valid: {listed}", value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    whole = number and isinstance(value, int)
    fits = {"Boolean": isinstance(value, bool), "String": isinstance(value, str), "Binary": isinstance(value, str)}
    if not fits.get(kind, number if kind in _FLOATS else whole):
        return f"is set to {value!r}, but its variable is {kind}", value
    return _out_of_range(variable, value), value


def kind_of(variable: Variable) -> str:
    """Returns the type of the value that a variable is set to: of a Clock, its interval."""
    return "Real" if variable.type == "Clock" else SAME_TYPE.get(variable.type, variable.type)


def _out_of_range(variable: Variable, value: Value) -> str | None:
    if isinstance(value, bool | str) or variable.type == "Enumeration":
        return None
    if isinstance(value, float) and math.isnan(value):
        return "is set to NaN, which is not a start value"
    kind = SAME_TYPE.get(variable.fmi_type or variable.type, variable.fmi_type or variable.type)
    kind = "Real" if kind == "Clock" else kind
    smallest, largest = INTEGER_RANGES.get(kind, (-math.inf, math.inf))
    if not smallest <= value <= largest:
        return f"is set to {value}, which does not fit into {variable.fmi_type or '32 bits'}"
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    if not low <= value <= high:
        return f"is set to {value:g}, which is outside of its range; valid: {low:g} to {high:g}"
    return None
