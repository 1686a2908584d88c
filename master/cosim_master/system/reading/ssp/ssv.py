"""Reads parameter sets (SSV), parameter mappings (SSM) and signal dictionaries (SSB), each a file or inline in an SSD.

It implements SSP 2.0, sections 6 to 8. The targets of parameters are determined elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from lxml import etree

from cosim_master.diagnostics.names import near
from cosim_master.files.xml import Reader, local_name
from cosim_master.system.reading.ssp.grammar import GRAMMAR, SAME_TYPE, SSB, SSM, SSV, TYPES, VALUE_TYPES
from cosim_master.system.reading.ssp.ssc import (
    Definitions,
    read_connector,
    read_dimensions,
    read_transformation,
    read_version,
    typed_value,
)
from cosim_master.system.structure import Connector, MappingEntry, Parameter, Value

__all__ = ["read_parameter_mapping", "read_parameter_set", "read_signal_dictionary"]

_BY_CHILDREN = ("String", "Enumeration", "Binary")
"""Types whose arrays are written as <Value> children."""


def _within(reader: Reader, root: etree._Element) -> Reader:
    """Returns a reader of the same file for an element that specifies its own version."""
    inner = Reader(reader.shown, reader.problems, reader.version)
    read_version(inner, root)
    return inner


def read_parameter_set(reader: Reader, root: etree._Element, outer: Definitions | None = None) -> tuple[Parameter, ...]:
    """Returns the parameters of an ssv:ParameterSet; `outer` has the definitions of the .ssd around an inline one."""
    reader = _within(reader, root)
    reader.children(root, GRAMMAR[SSV + "ParameterSet"])
    defined = Definitions(reader, root, SSV, outer)
    parameters: dict[str, Parameter] = {}
    for holder in root.iterfind(SSV + "Parameters"):
        for element in reader.children(holder, GRAMMAR[SSV + "Parameters"]):
            parameter = _parameter(reader, element, defined)
            if parameter is None:
                continue
            if (before := parameters.get(parameter.name)) is not None:
                parameter = replace(parameter, first=before.first or before.where)
            parameters[parameter.name] = parameter
    return tuple(parameters.values())


def _parameter(reader: Reader, element: etree._Element, defined: Definitions) -> Parameter | None:
    name = reader.name(element)
    held = reader.children(element, GRAMMAR[SSV + "Parameter"])
    children = [child for child in held if child.tag in VALUE_TYPES]
    if not children:
        if not any(child.tag in VALUE_TYPES for child in element):
            reader.problem(element, f'parameter "{name}" has no value; {near("", TYPES)}')
        return None
    child = children[0]
    kind = SAME_TYPE.get(local_name(child), local_name(child))
    shape = tuple(item.size or 0 for item in read_dimensions(reader, held, sizes_only=True))
    values = _values(reader, child, kind, shape)
    if values is None:
        return None
    unit = defined.unit(child)
    where = reader.where(element)
    if not shape:
        return Parameter(name, kind, values[0], where, unit)
    first: Value = values[0] if values else 0
    return Parameter(name, kind, first, where, unit, shape, tuple(values))


def _values(reader: Reader, element: etree._Element, kind: str, shape: tuple[int, ...]) -> list[Value] | None:
    """Returns the values of a parameter, last index fastest; None after a problem."""
    texts: list[tuple[etree._Element, str]]
    held = reader.children(element, GRAMMAR[str(element.tag)])
    name, text = local_name(element), element.get("value")
    if held:
        if text is not None:
            reader.problem(element, f'<{name}> has both the attribute "value" and <Value>; only one is allowed')
        for child in held:
            reader.children(child, GRAMMAR[SSV + "Value"])
        texts = [(child, child.get("value", "")) for child in held]
    elif text is None:
        if kind in _BY_CHILDREN:
            reader.problem(element, f'<{name}> needs the attribute "value"')
        return None
    elif shape and kind not in _BY_CHILDREN:
        texts = [(element, part) for part in text.split()]
    else:
        texts = [(element, text)]
    expected = math.prod(shape) if shape else 1
    if len(texts) != expected:
        reader.problem(element, f"<{name}> has {len(texts)} values; by its dimensions it must have {expected}")
        return None
    return [typed_value(reader, child, kind, part) for child, part in texts]


def read_parameter_mapping(reader: Reader, root: etree._Element) -> tuple[MappingEntry, ...]:
    """Returns the entries of an ssm:ParameterMapping."""
    reader = _within(reader, root)
    entries: dict[str, MappingEntry] = {}
    held = reader.children(root, GRAMMAR[SSM + "ParameterMapping"])
    for element in held:
        if element.tag != SSM + "MappingEntry":
            continue
        children = reader.children(element, GRAMMAR[SSM + "MappingEntry"])
        entry = MappingEntry(
            source=reader.text(element, "source"),
            target=reader.name(element, "target"),
            where=reader.where(element),
            suppress_unit_conversion=reader.boolean(element, "suppressUnitConversion"),
            transformation=read_transformation(reader, children),
        )
        if entry.target in entries:
            first = entries[entry.target].where
            reader.problem(element, f'two entries have the target "{entry.target}"; the other is at {first}')
        entries[entry.target] = entry
    return tuple(entries.values())


def read_signal_dictionary(reader: Reader, root: etree._Element) -> dict[str, Connector]:
    """Returns the entries of an ssb:SignalDictionary, by name."""
    reader = _within(reader, root)
    held: Sequence[etree._Element] = reader.children(root, GRAMMAR[SSB + "SignalDictionary"])
    defined = Definitions(reader, root, SSB)
    entries: dict[str, Connector] = {}
    for element in held:
        if element.tag != SSB + "DictionaryEntry":
            continue
        children = reader.children(element, GRAMMAR[SSB + "DictionaryEntry"])
        entry = read_connector(reader, element, children, "inout", defined)
        if entry.type is None and not any(local_name(child) == "Clock" for child in children):
            reader.problem(element, f'entry "{entry.name}" has no type; {near("", TYPES)}')
        if entry.name in entries:
            reader.problem(
                element, f'entry "{entry.name}" is already in this dictionary, at {entries[entry.name].where}'
            )
        entries[entry.name] = entry
    return entries
