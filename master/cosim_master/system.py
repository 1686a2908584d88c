"""A system as it is described: what a system structure says, hierarchically, and where it says it.

Plain data: nothing here has been compared with an FMU, and nothing is executed. `ssp.read_system` makes it,
`check.check` compares it with the FMUs and flattens it. Everything carries the place it was read from.
"""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeAlias

from lxml import etree

from cosim_master.errors import Problem, Where
from cosim_master.units import Unit

__all__ = [
    "Annotation",
    "Component",
    "Connection",
    "Connector",
    "Element",
    "Enumeration",
    "ExtractedArchive",
    "Kind",
    "Parameter",
    "ParameterBinding",
    "System",
    "SystemStructure",
    "Value",
]

Kind: TypeAlias = Literal["input", "output", "parameter", "calculatedParameter"]
Value: TypeAlias = float | int | bool | str


@dataclass(frozen=True, slots=True)
class Annotation:
    """What a tool wrote for itself: its reverse-domain type and the `ssc:Annotation` element, as it is."""

    type: str
    element: etree._Element
    where: Where


@dataclass(frozen=True, slots=True)
class Enumeration:
    """An enumeration type: item names and their values."""

    name: str
    items: Mapping[str, int]
    where: Where


@dataclass(frozen=True, slots=True)
class Connector:
    """A port of a component or system.

    Attributes:
        type: "Real", "Integer", "Boolean", "String", "Enumeration", "Binary", or None where the file is silent.
        unit: of a Real, None where the file is silent.
        enumeration: name of its enumeration type.
        items: that type's items, None if the file does not define it.
    """

    name: str
    kind: Kind
    where: Where
    type: str | None = None
    unit: Unit | None = None
    enumeration: str | None = None
    items: Mapping[str, int] | None = None


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection between two connectors of a system or its direct elements; an element of None is the system.

    Start and end say nothing about the direction; owner and kind of the connectors do (SSP 2.0, section 5.3.2).
    `value = factor * value + offset` is applied after unit conversion; `linear` says that the file has one.
    """

    start_element: str | None
    start_connector: str
    end_element: str | None
    end_connector: str
    where: Where
    suppress_unit_conversion: bool = False
    linear: bool = False
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value for a variable, of type "Real", "Integer", "Boolean", "String" or "Enumeration" (an item's name)."""

    name: str
    type: str
    value: Value
    where: Where
    unit: Unit | None = None


@dataclass(frozen=True, slots=True)
class ParameterBinding:
    """A parameter set applied to a component or system; `prefix` goes before every name in it."""

    parameters: tuple[Parameter, ...]
    prefix: str
    where: Where


@dataclass(frozen=True, slots=True)
class Component:
    """A part of a system that has its own file.

    Attributes:
        type: MIME type of the source.
        source: the file, resolved; None if it could not be resolved (which is a problem of the structure).
        content: the system inside, if the source is an .ssd or .ssp; one object per file, however often it is used.
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


@dataclass(frozen=True, slots=True)
class System:
    """A system: elements, the connections between them, and its own connectors.

    Attributes:
        document: the .ssd file it is part of.
    """

    name: str
    connectors: tuple[Connector, ...]
    parameter_bindings: tuple[ParameterBinding, ...]
    elements: tuple[Element, ...]
    connections: tuple[Connection, ...]
    annotations: tuple[Annotation, ...]
    document: Path
    where: Where


Element: TypeAlias = Component | System


class ExtractedArchive:
    """The temporary folder an .ssp was unpacked into. It goes when closed, or with the last reference to it."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._remove = weakref.finalize(self, shutil.rmtree, directory, ignore_errors=True)

    def close(self) -> None:
        self._remove()


@dataclass(frozen=True, slots=True)
class SystemStructure:
    """A system structure description with everything it refers to, except the inside of its FMUs.

    Use it as a context manager: the files of an .ssp live until it is closed (or until nobody refers to it).

    Attributes:
        name: the description's name.
        version: of SSP, as the file says.
        path: what was read (.ssd, .ssp or folder).
        document: the root .ssd file (inside the unpacked archive for an .ssp).
        system: the root system.
        start_time, stop_time: of the DefaultExperiment in s; None where the file is silent.
        units, enumerations: those of the root .ssd, by name.
        annotations: of the description itself (those of the root system are in `system`).
        problems: what is wrong with the files. A structure with problems is only good for finding more of them:
            `check` raises these together with its own.
        notes: what was assumed or left out, for the user.
        archives: unpacked archives that must live as long as the structure is used.
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

    def close(self) -> None:
        """Remove the unpacked archives; the paths inside them are no longer valid."""
        for archive in self.archives:
            archive.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
