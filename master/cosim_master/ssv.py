"""Reads what SSP's files share: parameter sets (.ssv, and inline in an .ssd), units, enumerations, versions."""

from __future__ import annotations

import math
import re

from lxml import etree

from cosim_master.document import Reader, local_name, near
from cosim_master.ssp_grammar import GRAMMAR, PARAMETER_TYPES, SSC, SSV, TYPES
from cosim_master.system import Enumeration, Parameter
from cosim_master.units import BASE_UNITS, BaseUnit, Unit

__all__ = ["check_version", "read_enumerations", "read_parameter_set", "read_units"]


def check_version(reader: Reader, root: etree._Element) -> None:
    """Report a version of SSP that is not 1.x or 2.x."""
    version = root.get("version", "1.0")
    if not re.fullmatch(r"[12][.][0-9]+(-.*)?", version.strip()):
        reader.problem(root, f'version "{version}" of SSP is not supported; valid: "1.0", "2.0"')


def read_units(reader: Reader, root: etree._Element, namespace: str) -> dict[str, Unit]:
    """The unit definitions of a file, by name; `namespace` is that of its <Units>."""
    units: dict[str, Unit] = {}
    for holder in root.iterfind(namespace + "Units"):
        for item in reader.children(holder, GRAMMAR[namespace + "Units"]):
            name = reader.name(item)
            if name in units:
                reader.problem(item, f'unit "{name}" is already defined')
            for child in reader.children(item, GRAMMAR[SSC + "Unit"]):
                if child.tag != SSC + "BaseUnit":
                    continue
                reader.children(child, GRAMMAR[SSC + "BaseUnit"])
                factor, offset = reader.real(child, "factor", 1.0), reader.real(child, "offset", 0.0)
                if not (math.isfinite(factor) and math.isfinite(offset)) or factor == 0.0:
                    reader.problem(child, f'unit "{name}": factor must be finite and not 0, offset finite')
                    factor, offset = 1.0, 0.0
                exponents = tuple(reader.integer(child, base) for base in BASE_UNITS)
                units[name] = Unit(name, BaseUnit(exponents, factor, offset))
    return units


def read_enumerations(reader: Reader, root: etree._Element, namespace: str) -> dict[str, Enumeration]:
    """The enumerations of a file, by name; `namespace` is that of its <Enumerations>."""
    found: dict[str, Enumeration] = {}
    for holder in root.iterfind(namespace + "Enumerations"):
        for element in reader.children(holder, GRAMMAR[namespace + "Enumerations"]):
            name = reader.name(element)
            if name in found:
                reader.problem(element, f'enumeration "{name}" is already defined, at {found[name].where}')
            items: dict[str, int] = {}
            for item in reader.children(element, GRAMMAR[SSC + "Enumeration type"]):
                if item.tag != SSC + "Item":
                    continue
                reader.children(item, GRAMMAR[SSC + "Item"])
                if (label := item.get("name", "")) in items:
                    reader.problem(item, f'item "{label}" of enumeration "{name}" is already defined')
                items[label] = reader.integer(item, "value")
            found[name] = Enumeration(name, items, reader.where(element))
    return found


def read_parameter_set(reader: Reader, root: etree._Element, outer: dict[str, Unit]) -> tuple[Parameter, ...]:
    """The parameters of an ssv:ParameterSet; `outer` are the units of the .ssd around an inline one."""
    reader.children(root, GRAMMAR[SSV + "ParameterSet"])
    check_version(reader, root)
    units = {**outer, **read_units(reader, root, SSV)}
    read_enumerations(reader, root, SSV)
    parameters: dict[str, Parameter] = {}
    for holder in root.iterfind(SSV + "Parameters"):
        for element in reader.children(holder, GRAMMAR[SSV + "Parameters"]):
            parameter = _parameter(reader, element, units)
            if parameter is None:
                continue
            if parameter.name in parameters:
                first = parameters[parameter.name].where
                reader.problem(element, f'parameter "{parameter.name}" is already in this set, at {first}')
            parameters[parameter.name] = parameter
    return tuple(parameters.values())


def _parameter(reader: Reader, element: etree._Element, units: dict[str, Unit]) -> Parameter | None:
    name = reader.name(element)
    children = [child for child in reader.children(element, GRAMMAR[SSV + "Parameter"]) if child.tag in PARAMETER_TYPES]
    if not children:
        if not any(child.tag in GRAMMAR[SSV + "Parameter"].unsupported for child in element):
            reader.problem(element, f'parameter "{name}" has no value; {near("", TYPES)}')
        return None
    child = children[0]
    kind = local_name(child)
    if kind == "Binary":
        reader.problem(child, "<Binary> parameters are not supported yet")
        return None
    reader.children(child, GRAMMAR[str(child.tag)])
    value: float | int | bool | str
    unit = None
    if kind == "Real":
        value = reader.real(child, "value")
        if (symbol := child.get("unit")) is not None:
            unit = units.get(symbol, Unit(symbol))
    elif kind == "Integer":
        value = reader.integer(child, "value")
    elif kind == "Boolean":
        value = reader.boolean(child, "value")
    else:
        value = reader.text(child, "value")
    return Parameter(name, kind, value, reader.where(element), unit)
