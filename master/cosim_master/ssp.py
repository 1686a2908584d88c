"""Reads SSP files (.ssd, .ssv, .ssp) into a `SystemStructure`. The only module that knows SSP's XML.

Supported: SSP 1.0, and files that say 2.0 as far as they use what 1.0 has: nested systems, components that are FMUs,
.ssd or .ssp files, connectors and connections with linear transformations, units, enumerations, inline and external
parameter sets with prefix, annotations. Whatever else the standard has is reported as not supported yet, whatever the
standard has not is reported with what would be valid; geometry is drawing only and passed over. No FMU is opened.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast
from urllib.parse import unquote, urlsplit

from lxml import etree

from cosim_master import archive
from cosim_master.document import Reader, local_name, parse
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.ssp_grammar import (
    ANNOTATIONS,
    ANY_TYPE,
    GRAMMAR,
    KINDS,
    KINDS_LATER,
    SSC,
    SSD,
    SSV,
)
from cosim_master.ssv import check_version, read_enumerations, read_parameter_set, read_units
from cosim_master.system import (
    Annotation,
    Component,
    Connection,
    Connector,
    Element,
    ExtractedArchive,
    Kind,
    Parameter,
    ParameterBinding,
    System,
    SystemStructure,
)
from cosim_master.units import Unit

__all__ = ["COMPONENT_TYPES", "FMU_TYPE", "ROOT_DOCUMENT", "SSD_TYPE", "SSP_TYPE", "read_system"]

ROOT_DOCUMENT = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
SSD_TYPE = "application/x-ssp-definition"
SSP_TYPE = "application/x-ssp-package"
COMPONENT_TYPES = (FMU_TYPE, SSD_TYPE, SSP_TYPE)

_MAX_DOCUMENT_BYTES = 256 << 20


def read_system(path: str | Path) -> SystemStructure:
    """Read a system structure and everything it refers to, except the inside of FMUs.

    Args:
        path: an .ssd file, an .ssp archive, or a folder with a SystemStructure.ssd.

    Returns:
        The structure. What is wrong with its files is in `problems`, so that `check` can report it together with
        what is wrong with the FMUs and connections; close it to remove an unpacked archive.

    Raises:
        SystemDescriptionError: there is no readable root document at all.
    """
    given = Path(path)
    place = given.absolute()
    files = _Files()
    if not given.exists():
        message = f"no such file or folder; give an .ssd, an .ssp or a folder with {ROOT_DOCUMENT}"
        raise SystemDescriptionError([Problem(Where(str(given)), message)])
    try:
        if given.is_dir():
            root = _File(place / ROOT_DOCUMENT, str(given / ROOT_DOCUMENT), None)
        elif given.suffix.lower() == ".ssp":
            root = files.unpacked(_File(place, str(given), None))
        elif given.suffix.lower() == ".ssd":
            root = _File(place, str(given), None)
        else:
            message = f"is neither an .ssd, an .ssp nor a folder with {ROOT_DOCUMENT}"
            raise SystemDescriptionError([Problem(Where(str(given)), message)])
        return _structure(given, root, files)
    except BaseException:
        for opened in files.archives:
            opened.close()
        raise


def _structure(given: Path, file: _File, files: _Files) -> SystemStructure:
    if not file.path.is_file():
        raise SystemDescriptionError([Problem(Where(file.shown), "no such file")])
    document = _Document(file, files, (file.path.resolve(),))
    root = document.root
    system = document.system()
    start, stop = document.experiment()
    return SystemStructure(
        name=root.get("name", ""),
        version=root.get("version", ""),
        path=given,
        document=file.path.resolve(),
        system=system,
        where=document.reader.where(root),
        start_time=start,
        stop_time=stop,
        units=document.units,
        enumerations=document.enumerations,
        annotations=document.annotations(root),
        problems=tuple(files.problems),
        notes=tuple(files.notes),
        archives=tuple(files.archives),
    )


@dataclass(frozen=True, slots=True)
class _File:
    path: Path
    shown: str
    boundary: Path | None
    """The unpacked archive the file is in and must not lead out of; None for files of the user's own."""


@dataclass(slots=True)
class _Files:
    """What has been read for one structure: every file once, however many components refer to it."""

    problems: list[Problem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    archives: list[ExtractedArchive] = field(default_factory=list)
    roots: dict[Path, _File] = field(default_factory=dict)
    systems: dict[Path, System | None] = field(default_factory=dict)
    sets: dict[Path, tuple[Parameter, ...]] = field(default_factory=dict)

    def unpacked(self, file: _File) -> _File:
        """The root document of an .ssp, unpacked on first use."""
        key = file.path.resolve()
        if key not in self.roots:
            opened = ExtractedArchive(Path(tempfile.mkdtemp(prefix="ssp-")).resolve())
            self.archives.append(opened)
            archive.unpack(file.path, opened.directory, file.shown)
            variants = sorted(path.name for path in opened.directory.glob("*.ssd") if path.name != ROOT_DOCUMENT)
            if variants:
                self.notes.append(f"{file.shown}: variants {', '.join(variants)} are left out; {ROOT_DOCUMENT} is used")
            root = opened.directory / ROOT_DOCUMENT
            self.roots[key] = _File(root, f"{file.shown}/{ROOT_DOCUMENT}", opened.directory)
        return self.roots[key]


class _Document:
    """One .ssd file being read. `stack` holds the documents that are being read around it, against recursion."""

    def __init__(self, file: _File, files: _Files, stack: tuple[Path, ...]) -> None:
        self.file = file
        self.files = files
        self.stack = stack
        self.path = file.path.resolve()
        self.reader = Reader(file.shown, files.problems)
        self.root = _parsed(file)
        expected = SSD + "SystemStructureDescription"
        if self.root.tag != expected:
            message = f"the root element is <{self.root.tag}>; it must be <{expected}>"
            raise SystemDescriptionError([Problem(self.reader.where(self.root), message)])
        self.reader.children(self.root, GRAMMAR[expected])
        check_version(self.reader, self.root)
        self.units = read_units(self.reader, self.root, SSD)
        self.enumerations = read_enumerations(self.reader, self.root, SSD)
        _check_annotations(self.reader, self.root)

    def system(self) -> System:
        """The root system of the document."""
        found = self.root.find(SSD + "System")
        if found is None:
            where = self.reader.where(self.root)
            return System("", (), (), (), (), (), self.path, where)
        return self._system(found)

    def experiment(self) -> tuple[float | None, float | None]:
        found = self.root.find(SSD + "DefaultExperiment")
        if found is None:
            return None, None
        self._held(found)
        times = []
        for attribute in ("startTime", "stopTime"):
            value = self.reader.real(found, attribute)
            if found.get(attribute) is not None and not math.isfinite(value):
                self.reader.problem(found, f'attribute "{attribute}" of <DefaultExperiment> must be a finite time in s')
            times.append(value if math.isfinite(value) else None)
        if times[0] is not None and times[1] is not None and times[1] <= times[0]:
            self.reader.problem(found, f"stopTime {times[1]:g} s is not after startTime {times[0]:g} s")
        return times[0], times[1]

    def annotations(self, element: etree._Element) -> tuple[Annotation, ...]:
        return tuple(
            Annotation(item.get("type", ""), item, self.reader.where(item))
            for item in element.iterfind(f"{ANNOTATIONS}/{SSC}Annotation")
        )

    def _held(self, element: etree._Element) -> Sequence[etree._Element]:
        children = self.reader.children(element, GRAMMAR[str(element.tag)])
        for child in children:
            if child.tag == ANNOTATIONS:
                for item in self.reader.children(child, GRAMMAR[ANNOTATIONS]):
                    self.reader.children(item, GRAMMAR[SSC + "Annotation"])
        return children

    def _grandchildren(self, element: etree._Element, plural: str) -> Sequence[etree._Element]:
        found = element.find(SSD + plural)
        return () if found is None else self._held(found)

    def _system(self, element: etree._Element) -> System:
        self._held(element)
        elements: list[Element] = []
        for child in self._grandchildren(element, "Elements"):
            elements.append(self._system(child) if child.tag == SSD + "System" else self._component(child))
        self._unique(element, "Elements", [item.name for item in elements], [item.where for item in elements])
        return System(
            name=self.reader.name(element),
            connectors=self._connectors(element),
            parameter_bindings=self._bindings(element),
            elements=tuple(elements),
            connections=tuple(self._connection(item) for item in self._grandchildren(element, "Connections")),
            annotations=self.annotations(element),
            document=self.path,
            where=self.reader.where(element),
        )

    def _unique(self, owner: etree._Element, what: str, names: list[str], places: list[Where]) -> None:
        first: dict[str, Where] = {}
        for name, where in zip(names, places, strict=True):
            if name in first:
                message = f'"{name}" is already in <{what}> of "{owner.get("name", "")}", at {first[name]}'
                self.files.problems.append(Problem(where, message))
            first.setdefault(name, where)

    def _component(self, element: etree._Element) -> Component:
        self._held(element)
        kind = self.reader.choice(element, "type", COMPONENT_TYPES, FMU_TYPE)
        valid = ("any", "CoSimulation", "ModelExchange", "ScheduledExecution")
        implementation = self.reader.choice(element, "implementation", valid, "any")
        if implementation not in ("any", "CoSimulation"):
            self.reader.problem(
                element, f'implementation="{implementation}" is not supported; valid: any, CoSimulation'
            )
        source = self._resolved(element, "source") if element.get("source") is not None else None
        content = None
        if source is not None and kind != FMU_TYPE:
            content = self._content(element, source, kind)
        elif source is not None and source.path.suffix.lower() in (".ssd", ".ssp"):
            needed = SSD_TYPE if source.path.suffix.lower() == ".ssd" else SSP_TYPE
            self.reader.problem(element, f'"{source.shown}" is not an FMU; say type="{needed}"')
            source = None
        return Component(
            name=self.reader.name(element),
            type=kind,
            source=None if source is None else source.path,
            implementation=implementation,
            connectors=self._connectors(element),
            parameter_bindings=self._bindings(element),
            annotations=self.annotations(element),
            where=self.reader.where(element),
            content=content,
        )

    def _content(self, element: etree._Element, source: _File, kind: str) -> System | None:
        try:
            file = self.files.unpacked(source) if kind == SSP_TYPE else source
            key = file.path.resolve()
            if key in self.stack:
                self.reader.problem(element, f'"{source.shown}" contains itself')
                return None
            if key not in self.files.systems:
                self.files.systems[key] = None
                document = _Document(file, self.files, (*self.stack, key))
                system = document.system()
                outer = document.annotations(document.root)
                if outer:
                    system = replace(system, annotations=(*system.annotations, *outer))
                self.files.systems[key] = system
            return self.files.systems[key]
        except SystemDescriptionError as error:
            self.files.problems += error.problems
            return None

    def _resolved(self, element: etree._Element, attribute: str) -> _File | None:
        """The existing file a URI reference points to, or None after a problem."""
        uri = element.get(attribute, "")
        trouble, relative = _relative_path(uri)
        if trouble is None:
            path = Path(os.path.normpath(self.file.path.parent / relative))
            shown = os.path.normpath(Path(self.file.shown).parent / relative)
            boundary = self.file.boundary
            if boundary is not None and not path.is_relative_to(boundary):
                trouble = "leads out of the .ssp archive"
            elif not path.is_file():
                trouble = f'does not exist: no file "{shown}"'
            else:
                return _File(path, shown, boundary)
        self.reader.problem(element, f'{attribute} "{uri}" {trouble}')
        return None

    def _connectors(self, element: etree._Element) -> tuple[Connector, ...]:
        found = [self._connector(item) for item in self._grandchildren(element, "Connectors")]
        self._unique(element, "Connectors", [item.name for item in found], [item.where for item in found])
        return tuple(found)

    def _connector(self, element: etree._Element) -> Connector:
        kind, unit, enumeration, items, type_name = element.get("kind", "input"), None, None, None, None
        if kind in KINDS_LATER:
            self.reader.problem(element, f'connector kind "{kind}" is not supported yet; valid: {", ".join(KINDS)}')
            kind = "input"
        kind = self.reader.choice(element, "kind", KINDS, "input") if kind not in KINDS else kind
        for child in self._held(element):
            if child.tag not in ANY_TYPE:
                continue
            self.reader.children(child, GRAMMAR[str(child.tag)])
            type_name = local_name(child)
            if type_name == "Real" and (name := child.get("unit")) is not None:
                unit = self.units.get(name, Unit(name))
            elif type_name == "Enumeration":
                enumeration = child.get("name", "")
                known = self.enumerations.get(enumeration)
                items = None if known is None else known.items
        return Connector(
            name=self.reader.name(element),
            kind=cast(Kind, kind),
            where=self.reader.where(element),
            type=type_name,
            unit=unit,
            enumeration=enumeration,
            items=items,
        )

    def _connection(self, element: etree._Element) -> Connection:
        linear, factor, offset = False, 1.0, 0.0
        for child in self._held(element):
            if child.tag != SSC + "LinearTransformation":
                continue
            self.reader.children(child, GRAMMAR[str(child.tag)])
            linear = True
            factor = self.reader.real(child, "factor", 1.0)
            offset = self.reader.real(child, "offset", 0.0)
            if not (math.isfinite(factor) and math.isfinite(offset)):
                self.reader.problem(child, "factor and offset of <LinearTransformation> must be finite")
        return Connection(
            start_element=element.get("startElement"),
            start_connector=self.reader.name(element, "startConnector"),
            end_element=element.get("endElement"),
            end_connector=self.reader.name(element, "endConnector"),
            where=self.reader.where(element),
            suppress_unit_conversion=self.reader.boolean(element, "suppressUnitConversion"),
            linear=linear,
            factor=factor,
            offset=offset,
        )

    def _bindings(self, element: etree._Element) -> tuple[ParameterBinding, ...]:
        return tuple(self._binding(item) for item in self._grandchildren(element, "ParameterBindings"))

    def _binding(self, element: etree._Element) -> ParameterBinding:
        self.reader.choice(element, "type", ("application/x-ssp-parameter-set",), "application/x-ssp-parameter-set")
        base = self.reader.choice(element, "sourceBase", ("SSD", "component"), "SSD")
        inline = [child for child in self._held(element) if child.tag == SSD + "ParameterValues"]
        source = element.get("source")
        parameters: tuple[Parameter, ...] = ()
        if base == "component":
            self.reader.problem(element, 'sourceBase="component" is not supported yet; valid: SSD')
        elif (source is None) == (not inline):
            what = "neither" if source is None else "both"
            self.reader.problem(
                element, f"<ParameterBinding> has {what} a source and <ParameterValues>; it needs exactly one of them"
            )
        elif source is not None:
            file = self._resolved(element, "source")
            parameters = () if file is None else self._external_set(file)
        else:
            for values in inline:
                for child in self._held(values):
                    parameters += read_parameter_set(self.reader, child, self.units)
        return ParameterBinding(parameters, element.get("prefix", ""), self.reader.where(element))

    def _external_set(self, file: _File) -> tuple[Parameter, ...]:
        key = file.path.resolve()
        if key not in self.files.sets:
            self.files.sets[key] = ()
            try:
                root = _parsed(file)
            except SystemDescriptionError as error:
                self.files.problems += error.problems
                return ()
            reader = Reader(file.shown, self.files.problems)
            if root.tag != SSV + "ParameterSet":
                reader.problem(root, f"the root element is <{root.tag}>; it must be <{SSV}ParameterSet>")
                return ()
            self.files.sets[key] = read_parameter_set(reader, root, {})
        return self.files.sets[key]


def _parsed(file: _File) -> etree._Element:
    try:
        if file.path.stat().st_size > _MAX_DOCUMENT_BYTES:
            raise SystemDescriptionError([Problem(Where(file.shown), f"is larger than {_MAX_DOCUMENT_BYTES} bytes")])
        data = file.path.read_bytes()
    except OSError as error:
        raise SystemDescriptionError([Problem(Where(file.shown), f"cannot be read: {error.strerror}")]) from error
    return parse(data, file.shown)


def _relative_path(uri: str) -> tuple[str | None, str]:
    """What is wrong with a URI reference, or None and the file path it stands for (RFC 3986, relative only)."""
    try:
        parts = urlsplit(uri)
        path = unquote(parts.path, errors="strict")
    except (ValueError, UnicodeDecodeError):
        return "is not a URI reference; write a relative path with / and %-escapes", ""
    if parts.fragment:
        return "selects a part of its target (#...), which is not supported yet", ""
    if parts.scheme or parts.netloc or path.startswith("/"):
        return "is an absolute URI; only paths relative to the .ssd are supported", ""
    if parts.query or "\\" in path or any(ord(character) < 32 for character in path):
        return "is not a relative path; write / between folders and escape ? as %3F", ""
    if not path:
        return "is empty", ""
    return None, path


def _check_annotations(reader: Reader, root: etree._Element) -> None:
    for holder in root.iterfind(ANNOTATIONS):
        for item in reader.children(holder, GRAMMAR[ANNOTATIONS]):
            reader.children(item, GRAMMAR[SSC + "Annotation"])
