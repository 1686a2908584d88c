"""The hierarchical description of a system, with the place of every item in its files.

The description is plain data, which has not been compared with FMUs. `reading.read.read_system` creates it, and
`check.check` compares it with the FMUs and flattens it. Every item has its place in the files.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeAlias

from lxml import etree

from cosim_master.diagnostics.errors import Problem, Where
from cosim_master.files import temporary
from cosim_master.fmi.description.units import Unit

__all__ = [
    "MAX_DEPTH",
    "MAX_PARTS",
    "Annotation",
    "Component",
    "Connection",
    "Connector",
    "Dimension",
    "Element",
    "Enumeration",
    "ExtractedArchive",
    "Kind",
    "LinearTransformation",
    "MappingEntry",
    "MappingTransformation",
    "Parameter",
    "ParameterBinding",
    "SignalDictionary",
    "SignalDictionaryReference",
    "System",
    "SystemStructure",
    "Transformation",
    "Value",
    "annotation",
]

Kind: TypeAlias = Literal[
    "input",
    "output",
    "parameter",
    "calculatedParameter",
    "structuralParameter",
    "constant",
    "local",
    "inout",
    "unspecified",
]
Value: TypeAlias = float | int | bool | str
MAX_DEPTH = 60
MAX_PARTS = 400_000
"""The deepest nesting of systems, and the largest number of elements and connectors of a system."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """An annotation of another tool: its reverse-domain type and the `ssc:Annotation` element, unchanged."""

    type: str
    element: etree._Element
    where: Where


def annotation(kind: str, name: str, attributes: Mapping[str, str], where: Where) -> Annotation:
    """Returns an annotation of ours, as in an .ssd, with one element and its attributes."""
    element = etree.Element("{http://ssp-standard.org/SSP1/SystemStructureCommon}Annotation", {"type": kind})
    etree.SubElement(element, f"{{https://uav-cosim.org/ns/1}}{name}", dict(attributes))
    return Annotation(kind, element, where)


@dataclass(frozen=True, slots=True)
class Enumeration:
    """An enumeration type: item names and their values."""

    name: str
    items: Mapping[str, int]
    where: Where


@dataclass(frozen=True, slots=True)
class Dimension:
    """One dimension of an array connector: a size, or the connector with the size; it is open if both are missing."""

    size: int | None = None
    connector: str | None = None


@dataclass(frozen=True, slots=True)
class Connector:
    """A port of a component, system or signal dictionary.

    Attributes:
        type: "Real", "Integer", "Boolean", "String", "Enumeration", "Binary", a type of SSP 2.0 that FMI 2 lacks
            ("Float32", "Int8", "Clock", ...), or None if not specified. Float64 is Real here, Int32 is Integer.
        unit: unit of a Real, None if not specified.
        enumeration: name of its enumeration type.
        items: items of this type, None if the file does not define it.
        mime_type: MIME type of a Binary, None if not specified.
        dimensions: of an array; empty for a scalar.
        interval_variability: of a Clock, None if not specified.
        clocks: connectors of the same element for the Clocks that it belongs to, if the file names them.
    """

    name: str
    kind: Kind
    where: Where
    type: str | None = None
    unit: Unit | None = None
    enumeration: str | None = None
    items: Mapping[str, int] | None = None
    mime_type: str | None = None
    dimensions: tuple[Dimension, ...] = ()
    interval_variability: str | None = None
    clocks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LinearTransformation:
    """target = factor * source + offset, after unit conversion."""

    factor: float
    offset: float
    where: Where


@dataclass(frozen=True, slots=True)
class MappingTransformation:
    """A table of values; values that it does not contain stay unchanged.

    Attributes:
        type: "Boolean", "Integer" or "Enumeration".
        entries: source and target values; item names for "Enumeration".
    """

    type: str
    entries: tuple[tuple[Value, Value], ...]
    where: Where


Transformation: TypeAlias = LinearTransformation | MappingTransformation


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection between two connectors of a system or its direct elements; an element of None is the system.

    Start and end do not determine the direction; owner and kind of the connectors do (SSP 2.0, section 5.3.2). Indices
    select one element of an array connector, counting from 1; empty for the whole connector. The value of an input with
    `summed` connections is their sum, which SSP cannot express (OspSystemStructure.xml can).
    """

    start_element: str | None
    start_connector: str
    end_element: str | None
    end_connector: str
    where: Where
    suppress_unit_conversion: bool = False
    transformation: Transformation | None = None
    start_indices: tuple[int, ...] = ()
    end_indices: tuple[int, ...] = ()
    summed: bool = False


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value for a variable, of a `Connector`'s types; an "Enumeration" is an item's name, a "Binary" is hexadecimal.

    Attributes:
        shape: shape of an array, empty for a scalar.
        elements: the values of an array, last index fastest; `value` is then the first one.
        transformation: applied by a parameter mapping to the value, after unit conversion.
        suppress_unit_conversion: the value is used unchanged, whatever its unit.
        first: earlier place of this name in the same set; an error if the name has a match.
    """

    name: str
    type: str
    value: Value
    where: Where
    unit: Unit | None = None
    shape: tuple[int, ...] = ()
    elements: tuple[Value, ...] = ()
    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False
    first: Where | None = None


@dataclass(frozen=True, slots=True)
class MappingEntry:
    """An entry of a parameter mapping: the parameter `source` of the set is applied to `target`."""

    source: str
    target: str
    where: Where
    suppress_unit_conversion: bool = False
    transformation: Transformation | None = None


@dataclass(frozen=True, slots=True)
class ParameterBinding:
    """A parameter set applied to a component or system.

    Attributes:
        prefix: prepended to every name in the set, before any other processing.
        mapping: if not None, only the named parameters are applied, under their new names.
    """

    parameters: tuple[Parameter, ...]
    prefix: str
    where: Where
    mapping: tuple[MappingEntry, ...] | None = None


@dataclass(frozen=True, slots=True)
class Component:
    """A part of a system that has its own file.

    Attributes:
        type: MIME type of the source.
        source: the file, resolved; None if it could not be resolved (which is a problem of the structure).
        content: the system inside, if the source is an .ssd, an .ssp or a system of the same file; all uses share one
            object. A component without a source (SSP 2.0) has an empty system inside.
        fragment: the part after "#" in the source: the id of a system in the same file, or the variant of an .ssp.
    """

    name: str
    type: str
    source: Path | None
    implementation: str
    connectors: tuple[Connector, ...]
    parameter_bindings: tuple[ParameterBinding, ...]
    annotations: tuple[Annotation, ...]
    where: Where
    content: System | None = None
    fragment: str | None = None


@dataclass(frozen=True, slots=True)
class SignalDictionary:
    """Signals that any system below may share by name; `entries` have the kind "inout"."""

    name: str
    entries: Mapping[str, Connector]
    where: Where


@dataclass(frozen=True, slots=True)
class SignalDictionaryReference:
    """An element with the connectors through which a system accesses the signals of a surrounding dictionary."""

    name: str
    dictionary: str
    connectors: tuple[Connector, ...]
    parameter_bindings: tuple[ParameterBinding, ...]
    annotations: tuple[Annotation, ...]
    where: Where


@dataclass(frozen=True, slots=True)
class System:
    """A system: elements, the connections between them, and its own connectors.

    Attributes:
        document: the .ssd file that contains it.
        signal_dictionaries: the signal dictionaries that it defines.
    """

    name: str
    connectors: tuple[Connector, ...]
    parameter_bindings: tuple[ParameterBinding, ...]
    elements: tuple[Element, ...]
    connections: tuple[Connection, ...]
    annotations: tuple[Annotation, ...]
    document: Path
    where: Where
    signal_dictionaries: tuple[SignalDictionary, ...] = ()


Element: TypeAlias = Component | System | SignalDictionaryReference


class ExtractedArchive:
    """The temporary folder with an unpacked .ssp. It is removed when closed, or with the last reference to it."""

    def __init__(self) -> None:
        made = temporary.made()
        self.directory = made.resolve()
        self._remove = weakref.finalize(self, temporary.remove, made)

    def close(self) -> None:
        self._remove()


@dataclass(frozen=True, slots=True)
class SystemStructure:
    """A system structure description with all files that it refers to, except the contents of its FMUs.

    Use it as a context manager: the files of an .ssp exist until it is closed (or until the last reference to it
    disappears).

    Attributes:
        name: the description's name.
        version: the version of SSP, as stated in the file.
        path: the file or folder read (.ssd, .ssp or folder).
        document: the root .ssd file (inside the unpacked archive for an .ssp).
        system: the root system.
        start_time, stop_time: of the DefaultExperiment in s; None if not specified.
        units, enumerations: those of the root .ssd, by name.
        annotations: of the description itself (those of the root system are in `system`).
        problems: errors in the files. A structure with problems can only be used to find further problems: `check`
            raises these together with its own.
        notes: assumptions and ignored contents, for the user.
        archives: unpacked archives that must live as long as the structure is used.
        generation_tool: the tool that wrote it, as stated.
    """

    name: str
    version: str
    path: Path
    document: Path
    system: System
    where: Where
    start_time: float | None = None
    stop_time: float | None = None
    units: Mapping[str, Unit] = field(default_factory=dict)
    enumerations: Mapping[str, Enumeration] = field(default_factory=dict)
    annotations: tuple[Annotation, ...] = ()
    problems: tuple[Problem, ...] = ()
    notes: tuple[str, ...] = ()
    archives: tuple[ExtractedArchive, ...] = ()
    generation_tool: str = ""

    def close(self) -> None:
        """Removes the unpacked archives; the paths inside them are no longer valid."""
        for archive in self.archives:
            archive.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
