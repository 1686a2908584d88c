"""Reads the common parts of SSP's files (SSP 2.0, section 4): versions, units, enumerations, types, transformations.

Systems and parameter sets are read by `ssd` and `ssv`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import cast

from lxml import etree

from cosim_master.diagnostics.errors import Finding
from cosim_master.diagnostics.limitations import ANNOTATION, CLOCK, LONG_ARRAY, META_DATA
from cosim_master.files.xml import Reader, double, local_name, whole
from cosim_master.fmi.description.units import BASE_UNITS, BaseUnit, Unit
from cosim_master.fmi.description.variables import INTEGER_RANGES
from cosim_master.system.reading.ssp.grammar import ANY_TYPE, GRAMMAR, META, SAME_TYPE, SSC, SSD, TRANSFORMATIONS
from cosim_master.system.structure import (
    Connector,
    Dimension,
    Enumeration,
    Kind,
    LinearTransformation,
    MappingTransformation,
    Transformation,
    Value,
)

__all__ = [
    "Definitions",
    "note_ignored",
    "read_connector",
    "read_dimensions",
    "read_transformation",
    "read_version",
    "typed_value",
    "without_names",
]

_MAX_ELEMENTS = 1 << 16
_ANNOTATED = tuple(SSD + name for name in ("SystemStructureDescription", "System", "Component"))


def read_version(reader: Reader, root: etree._Element) -> None:
    """Stores the SSP version of a file; versions other than 1.x and 2.x are a problem."""
    version = root.get("version", "1.0").strip()
    if not re.fullmatch(r"[12][.][0-9]+(-.*)?", version):
        reader.problem(root, f'version "{version}" of SSP is not supported; valid: "1.0", "2.0"')
        return
    reader.version = int(version[0])


def note_ignored(root: etree._Element, reader: Reader, notes: list[str]) -> None:
    """Adds notes on legal contents without effect: meta data, signatures, and annotations in unexpected places.

    Annotations of systems, components and the file itself are examined later, by `check`.
    """
    for element in root.iter(SSC + "Annotation", *META):
        if element.tag in META:
            notes.append(f"{reader.where(element)}: {META_DATA.text(local_name(element))}")
            continue
        holder = element.getparent()
        owner = None if holder is None else holder.getparent()
        if owner is None or owner.tag in _ANNOTATED:
            continue
        kind = element.get("type", "")
        if kind.startswith("org.uav-cosim"):
            reader.problem(
                element, f'annotation "{kind}" belongs to a system or component, not to a {local_name(owner)}'
            )
        else:
            notes.append(f"{reader.where(element)}: {ANNOTATION.text(kind)}")


class Definitions:
    """The units and enumerations of one file; `namespace` is that of its <Units> and <Enumerations>."""

    def __init__(self, reader: Reader, root: etree._Element, namespace: str, outer: Definitions | None = None) -> None:
        self.units: dict[str, Unit] = {} if outer is None else dict(outer.units)
        self.enumerations: dict[str, Enumeration] = {}
        self._reader = reader
        self._units(root, namespace)
        self._enumerations(root, namespace)

    def unit(self, element: etree._Element) -> Unit | None:
        """Returns the unit that the attribute `unit` names; without definition if the file has none."""
        name = element.get("unit")
        return None if name is None else self.units.get(name, Unit(name))

    def _units(self, root: etree._Element, namespace: str) -> None:
        reader, found = self._reader, set[str]()
        for holder in root.iterfind(namespace + "Units"):
            for item in reader.children(holder, GRAMMAR[namespace + "Units"]):
                name = reader.name(item)
                if name in found:
                    reader.problem(item, f'unit "{name}" is already defined')
                found.add(name)
                for child in reader.children(item, GRAMMAR[SSC + "Unit"]):
                    if child.tag == SSC + "BaseUnit":
                        self.units[name] = self._unit(name, child)

    def _unit(self, name: str, element: etree._Element) -> Unit:
        reader = self._reader
        reader.children(element, GRAMMAR[SSC + "BaseUnit"])
        factor, offset = reader.real(element, "factor", 1.0), reader.real(element, "offset", 0.0)
        if not (math.isfinite(factor) and math.isfinite(offset)) or factor == 0.0:
            reader.problem(element, f'unit "{name}": factor must be finite and not 0, offset finite')
            factor, offset = 1.0, 0.0
        return Unit(name, BaseUnit(tuple(reader.integer(element, base) for base in BASE_UNITS), factor, offset))

    def _enumerations(self, root: etree._Element, namespace: str) -> None:
        reader = self._reader
        # The values have 64 bits since SSP 2.0.1, whose files state version 2.0.
        low, high = INTEGER_RANGES["Integer" if reader.version < 2 else "Int64"]
        for holder in root.iterfind(namespace + "Enumerations"):
            for element in reader.children(holder, GRAMMAR[namespace + "Enumerations"]):
                name = reader.name(element)
                if name in self.enumerations:
                    where = self.enumerations[name].where
                    reader.problem(element, f'enumeration "{name}" is already defined, at {where}')
                items: dict[str, int] = {}
                for item in reader.children(element, GRAMMAR[SSC + "Enumeration type"]):
                    if item.tag != SSC + "Item":
                        continue
                    reader.children(item, GRAMMAR[SSC + "Item"])
                    if (label := item.get("name", "")) in items:
                        reader.problem(item, f'item "{label}" of enumeration "{name}" is already defined')
                    items[label] = reader.integer(item, "value", low=low, high=high)
                self.enumerations[name] = Enumeration(name, items, reader.where(element))


def without_names(reader: Reader, children: Sequence[etree._Element]) -> list[Finding]:
    """Removes names of types other than Enumeration, where OMSimulator writes the FMU's type; returns findings."""
    found = []
    for child in children:
        if child.tag in ANY_TYPE and child.tag != SSC + "Enumeration" and "name" in child.attrib:
            text = f'name="{child.get("name")}" of <{local_name(child)}> is ignored: only an Enumeration has a name'
            found.append(Finding(reader.where(child), text, "types with a name"))
            del child.attrib["name"]
    return found


def read_connector(
    reader: Reader, element: etree._Element, children: Sequence[etree._Element], kind: str, defined: Definitions
) -> Connector:
    """Returns a connector or an entry of a signal dictionary; `children` are its legal children."""
    unit, enumeration, items, type_name, mime_type = None, None, None, None, None
    dimensions: tuple[Dimension, ...] = ()
    in_dictionary, variability, clocks = kind == "inout" and element.get("kind") is None, None, []
    for child in children:
        name = local_name(child)
        if child.tag in ANY_TYPE:
            reader.children(child, GRAMMAR[str(child.tag)])
            type_name = SAME_TYPE.get(name, name)
            unit = defined.unit(child)
            if type_name == "Enumeration":
                enumeration = child.get("name", "")
                known = defined.enumerations.get(enumeration)
                items = None if known is None else known.items
            elif type_name == "Binary":
                mime_type = child.get("mime-type", "application/octet-stream")
        elif name == "Clock" and in_dictionary:
            reader.problem(child, CLOCK.text(element.get("name", "")))
        elif name == "Clock":
            reader.children(child, GRAMMAR[str(child.tag)])
            if child.tag == SSC + "Clock":
                type_name, variability = name, child.get("intervalVariability")
            else:
                clocks.append(child.get("name", ""))
    dimensions = read_dimensions(reader, children, sizes_only=in_dictionary)
    return Connector(
        name=reader.name(element),
        kind=cast(Kind, kind),
        where=reader.where(element),
        type=type_name,
        unit=unit,
        enumeration=enumeration,
        items=items,
        mime_type=mime_type,
        dimensions=dimensions,
        interval_variability=variability,
        clocks=tuple(clocks),
    )


def read_dimensions(
    reader: Reader, children: Sequence[etree._Element], *, sizes_only: bool = False
) -> tuple[Dimension, ...]:
    """Returns the <Dimension> elements among `children` (section 4.5.3); with `sizes_only`, a size must be a number."""
    found = []
    total = 1
    for child in children:
        if child.tag != SSC + "Dimension":
            continue
        reader.children(child, GRAMMAR[SSC + "Dimension"])
        size, connector = child.get("size"), child.get("sizeConnector")
        if sizes_only and connector is not None:
            text = "<Dimension> has a sizeConnector, which is for connectors only; give its size here, and nothing else"
            reader.problem(child, text)
        elif size is not None and connector is not None:
            reader.problem(child, "<Dimension> has both size and sizeConnector; only one of them is allowed")
        elif sizes_only and size is None:
            reader.problem(child, '<Dimension> needs the attribute "size" here')
        number = None if size is None else reader.integer(child, "size", 1, low=0, high=_MAX_ELEMENTS)
        total *= 1 if number is None else number
        found.append(Dimension(number, connector))
    if total > _MAX_ELEMENTS:
        reader.problem(children[0], LONG_ARRAY.text(total, _MAX_ELEMENTS))
        return ()
    return tuple(found)


def read_transformation(reader: Reader, children: Sequence[etree._Element]) -> Transformation | None:
    """Returns the transformation among the children of a connection or mapping entry (section 4.5.2)."""
    for child in children:
        if child.tag not in TRANSFORMATIONS:
            continue
        held = reader.children(child, GRAMMAR[str(child.tag)])
        if child.tag == TRANSFORMATIONS[0]:
            factor, offset = reader.real(child, "factor", 1.0), reader.real(child, "offset", 0.0)
            if not (math.isfinite(factor) and math.isfinite(offset)):
                reader.problem(child, "factor and offset of <LinearTransformation> must be finite")
                factor, offset = 1.0, 0.0
            return LinearTransformation(factor, offset, reader.where(child))
        return _mapping(reader, child, held)
    return None


def _mapping(reader: Reader, element: etree._Element, held: Sequence[etree._Element]) -> MappingTransformation:
    kind = local_name(element).removesuffix("MappingTransformation")
    entries: dict[Value, Value] = {}
    for entry in held:
        reader.children(entry, GRAMMAR[SSC + "MapEntry"])
        pair: list[Value] = []
        for attribute in ("source", "target"):
            if kind == "Boolean":
                pair.append(reader.boolean(entry, attribute))
            elif kind == "Integer":
                pair.append(reader.integer(entry, attribute, low=-(2**63), high=2**64 - 1))
            else:
                pair.append(reader.text(entry, attribute))
        if pair[0] in entries:
            shown = str(pair[0]).lower() if kind == "Boolean" else pair[0]
            reader.problem(entry, f'two entries map the source "{shown}"; one value can have one target only')
        entries[pair[0]] = pair[1]
    return MappingTransformation(kind, tuple(entries.items()), reader.where(element))


def typed_value(reader: Reader, element: etree._Element, kind: str, text: str) -> Value:
    """Returns a value of an SSP type from an attribute; after a problem, it returns any value of the type."""
    wanted: str
    if kind in ("Real", "Float32"):
        if (number := double(text)) is not None:
            return number
        number, wanted = math.nan, "a number (xs:double)"
    elif kind in INTEGER_RANGES:
        low, high = INTEGER_RANGES[kind]
        if (integer := whole(text, low, high)) is not None:
            return integer
        number = 0
        wanted = "an integer of 32 bits (xs:int)" if kind == "Integer" else f"an integer from {low} to {high}"
    elif kind == "Boolean":
        if text.strip() in ("true", "false", "1", "0"):
            return text.strip() in ("true", "1")
        number, wanted = False, '"true" or "false"'
    elif kind == "Binary":
        if re.fullmatch(r"([0-9A-Fa-f]{2})*", text.strip()):
            return text.strip().upper()
        number, wanted = False, "bytes in hexadecimal (xs:hexBinary)"
    else:
        return text
    reader.malformed(element, "value", text, wanted)
    return "" if kind == "Binary" else number
