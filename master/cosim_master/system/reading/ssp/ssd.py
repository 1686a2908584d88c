"""Reads one system structure description (.ssd) with all files that it refers to: SSP 2.0, section 5.

No FMU is opened, except for parameter sets inside it (sourceBase="component").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import TypeVar

from lxml import etree

from cosim_master.diagnostics.errors import Finding, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import DEEP, IMPLEMENTATION, MODELICA, NO_SOURCE, OTHER_SSD
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import Reader, line_of, local_name, whole
from cosim_master.system.reading.ssp.grammar import ANNOTATIONS, GRAMMAR, KINDS, KINDS_2, SSB, SSC, SSD, SSM, SSV
from cosim_master.system.reading.ssp.references import File, Files, is_file, parsed, read_reference, read_source
from cosim_master.system.reading.ssp.schema import validate
from cosim_master.system.reading.ssp.ssc import (
    Definitions,
    note_ignored,
    read_connector,
    read_transformation,
    read_version,
    without_names,
)
from cosim_master.system.reading.ssp.ssv import read_parameter_mapping, read_parameter_set, read_signal_dictionary
from cosim_master.system.structure import (
    MAX_DEPTH,
    Annotation,
    Component,
    Connection,
    Connector,
    Element,
    MappingEntry,
    Parameter,
    ParameterBinding,
    SignalDictionary,
    SignalDictionaryReference,
    System,
)

__all__ = ["COMPONENT_TYPES", "FMU_TYPE", "ROOT_DOCUMENT", "SSD_TYPE", "SSP_TYPE", "TABLE_TYPES", "Document"]

ROOT_DOCUMENT = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
SSD_TYPE = "application/x-ssp-definition"
SSP_TYPE = "application/x-ssp-package"
TABLE_TYPES = ("text/csv", "application/vnd.apache.parquet")
COMPONENT_TYPES = (FMU_TYPE, SSD_TYPE, SSP_TYPE, *TABLE_TYPES)
_SET, _MAPPING, _DICTIONARY = (
    f"application/x-ssp-{kind}" for kind in ("parameter-set", "parameter-mapping", "signal-dictionary")
)
_T = TypeVar("_T")


class Document:
    """One .ssd file being read.

    Args:
        file: the file.
        files: the files read so far.
        stack: the surrounding systems that are being read (document and id), to detect recursion.

    Raises:
        SystemDescriptionError: the file is not an .ssd; all other errors go to `files.problems`.
    """

    def __init__(self, file: File, files: Files, stack: tuple[tuple[Path, str], ...]) -> None:
        self.file = file
        self.files = files
        self.stack = stack
        self.path = file.path.resolve()
        self.reader = Reader(file.shown, files.problems)
        self.root = _rooted(file, SSD + "SystemStructureDescription")
        read_version(self.reader, self.root)
        note_ignored(self.root, self.reader, files.notes)
        self._held(self.root)
        self.defined = Definitions(self.reader, self.root, SSD)
        self.by_id = {item.get("id", ""): item for item in self.root.iter(SSD + "System") if item.get("id")}

    def validate(self) -> None:
        """Validates the document against the schema, after all other checks."""
        _validate(self.root, self.file, self.files, self.reader.version)

    def system(self) -> System:
        """Returns the root system of the document."""
        found = self.root.find(SSD + "System")
        if found is None:
            where = self.reader.where(self.root)
            return System("", (), (), (), (), (), self.path, where)
        return self._system(found)

    def experiment(self) -> tuple[float | None, float | None]:
        """Returns start and stop time of the DefaultExperiment, s."""
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
        """Returns the annotations of an element."""
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

    # ---- elements ----------------------------------------------------------------------------------------------------

    def _system(self, element: etree._Element) -> System:
        if self.files.depth >= MAX_DEPTH:
            self.reader.problem(element, DEEP.text(MAX_DEPTH))
            return System(element.get("name", ""), (), (), (), (), (), self.path, self.reader.where(element))
        self.files.depth += 1
        try:
            return self._read_system(element)
        finally:
            self.files.depth -= 1

    def _read_system(self, element: etree._Element) -> System:
        self._held(element)
        elements: list[Element] = []
        for child in self._grandchildren(element, "Elements"):
            if child.tag == SSD + "System":
                elements.append(self._system(child))
            elif child.tag == SSD + "Component":
                elements.append(self._component(child))
            else:
                elements.append(self._dictionary_reference(child))
        self._unique(element, "Elements", [item.name for item in elements], [item.where for item in elements])
        dictionaries = [self._dictionary(item) for item in self._grandchildren(element, "SignalDictionaries")]
        names, places = [item.name for item in dictionaries], [item.where for item in dictionaries]
        self._unique(element, "SignalDictionaries", names, places)
        return System(
            name=self.reader.name(element),
            connectors=self._connectors(element),
            parameter_bindings=self._bindings(element, None),
            elements=tuple(elements),
            connections=tuple(self._connection(item) for item in self._grandchildren(element, "Connections")),
            annotations=self.annotations(element),
            document=self.path,
            where=self.reader.where(element),
            signal_dictionaries=tuple(dictionaries),
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
        kind = self._component_type(element)
        valid = ("any", "CoSimulation", "ModelExchange", "ScheduledExecution")
        implementation = self.reader.choice(element, "implementation", valid, "any")
        if implementation not in ("any", "CoSimulation", "ModelExchange"):
            self.reader.problem(element, IMPLEMENTATION.text(implementation))
        connectors = self._connectors(element)
        source, content, fragment = self._source(element, kind, connectors)
        return Component(
            name=self.reader.name(element),
            type=kind,
            source=None if source is None else source.path,
            implementation=implementation,
            connectors=connectors,
            parameter_bindings=self._bindings(element, source if kind == FMU_TYPE else None, content),
            annotations=self.annotations(element),
            where=self.reader.where(element),
            content=content,
            fragment=fragment,
        )

    def _component_type(self, element: etree._Element) -> str:
        kind = element.get("type", FMU_TYPE)
        if kind.split(";")[0].strip() == "text/x-modelica":
            listed = ", ".join(f'"{item}"' for item in COMPONENT_TYPES)
            self.reader.problem(element, f"{MODELICA.text(kind)}; valid: {listed}")
            return FMU_TYPE
        if (table := kind.partition(";"))[0].strip() in TABLE_TYPES:
            if table[1] and table[2].strip() not in ("interpolation=hold", "interpolation=linear"):
                text = f'type "{kind}": after ";" valid is: interpolation=linear, interpolation=hold'
                self.reader.problem(element, text)
            return kind
        return self.reader.choice(element, "type", COMPONENT_TYPES, FMU_TYPE)

    def _source(
        self, element: etree._Element, kind: str, connectors: tuple[Connector, ...]
    ) -> tuple[File | None, System | None, str | None]:
        """Returns the file of a component, the system inside it, and the fragment of its URI."""
        uri, where = element.get("source"), self.reader.where(element)
        if uri is None:
            if self.reader.version < 2:
                self.reader.problem(element, '<Component> needs the attribute "source" (SSP 2.0 can do without)')
            name = element.get("name", "")
            self.files.notes.append(f"{where}: {NO_SOURCE.text(name)}")
            return None, System(name, connectors, (), (), (), (), self.path, where), None
        if uri.partition(":")[0] in ("proxyfmu", "proxy-fmu") and kind == FMU_TYPE:
            trouble, source, note = read_source(self.file, uri)
            if trouble is not None or source is None:
                self.reader.problem(element, f'source "{uri}" {trouble}')
                return None, None, None
            self.files.notes.append(f"{where}: {note}")
            return source, None, None
        trouble, target = read_reference(uri)
        fits = kind == (SSD_TYPE if target.path == "" else SSP_TYPE)
        if trouble is None and target.fragment is not None and not fits:
            needed = SSD_TYPE if target.path == "" else SSP_TYPE
            trouble = f'selects a part of its target; that is only for type="{needed}"'
            if kind == SSD_TYPE:
                trouble += f"; {OTHER_SSD.text()}"
        if trouble is None and target.path == "" and target.fragment is not None:
            return self.file, self._embedded(element, target.fragment), target.fragment
        if trouble is None:
            trouble, file = self.files.resolved(self.file, target)
        if trouble is not None:
            self.reader.problem(element, f'source "{uri}" {trouble}')
            return None, None, None
        if kind.partition(";")[0].strip() in TABLE_TYPES:
            return file, None, None
        if kind != FMU_TYPE:
            return file, self._content(element, file, kind, target.fragment), target.fragment
        if file.path.suffix.lower() in (".ssd", ".ssp"):
            needed = SSD_TYPE if file.path.suffix.lower() == ".ssd" else SSP_TYPE
            self.reader.problem(element, f'"{file.shown}" is not an FMU; say type="{needed}"')
            return None, None, None
        return file, None, None

    def _embedded(self, element: etree._Element, name: str) -> System | None:
        """Returns the system of this document with the given id (section 5.4, "source")."""
        found = self.by_id.get(name)
        if found is None:
            text = f'source "#{name}": no system of this file has the id "{name}"; {near(name, self.by_id)}'
            self.reader.problem(element, text)
            return None
        if (self.path, name) in self.stack or found in element.iterancestors():
            self.reader.problem(element, f'"#{name}" contains itself')
            return None

        def read() -> System:
            outer, self.stack = self.stack, (*self.stack, (self.path, name))
            try:
                return self._system(found)
            finally:
                self.stack = outer

        return self.files.once((self.path, name), read, None)

    def _content(self, element: etree._Element, source: File, kind: str, variant: str | None) -> System | None:
        try:
            file = source
            if kind == SSP_TYPE:
                folder = self.files.unpacked(source)
                file = self._variant(element, folder, variant)
        except SystemDescriptionError as error:
            self.files.problems += error.problems
            return None
        key = (self.files.real(file), "")
        if key in self.stack:
            self.reader.problem(element, f'"{source.shown}" contains itself')
            return None

        def read() -> System:
            document = Document(file, self.files, (*self.stack, key))
            system = document.system()
            document.validate()
            outer = document.annotations(document.root)
            return replace(system, annotations=(*system.annotations, *outer)) if outer else system

        return self.files.once(key, read, None)

    def _variant(self, element: etree._Element, folder: File, variant: str | None) -> File:
        """Returns the .ssd at the root of an unpacked archive: the default one, or the one that the fragment names."""
        name = ROOT_DOCUMENT if variant is None else variant
        file = File(folder.path / name, f"{folder.shown}/{name}", folder.path)
        if variant is not None and (PurePosixPath(name).name != name or not is_file(file.path)):
            known = sorted(path.name for path in folder.path.glob("*.ssd"))
            text = f'source: "{folder.shown}" has no variant "{variant}"; {near(variant, known)}'
            raise SystemDescriptionError([Problem(self.reader.where(element), text)])
        return file

    def _dictionary_reference(self, element: etree._Element) -> SignalDictionaryReference:
        self._held(element)
        return SignalDictionaryReference(
            name=self.reader.name(element),
            dictionary=self.reader.name(element, "dictionary"),
            connectors=self._connectors(element),
            parameter_bindings=self._bindings(element, None),
            annotations=self.annotations(element),
            where=self.reader.where(element),
        )

    def _dictionary(self, element: etree._Element) -> SignalDictionary:
        inline = [child for child in self._held(element) if child.tag == SSB + "SignalDictionary"]
        self.reader.choice(element, "type", (_DICTIONARY,), _DICTIONARY)
        found = self._loaded(element, inline, SSB + "SignalDictionary", None, read_signal_dictionary)
        return SignalDictionary(self.reader.name(element), found or {}, self.reader.where(element))

    # ---- connectors and connections ----------------------------------------------------------------------------------

    def _connectors(self, element: etree._Element) -> tuple[Connector, ...]:
        found = [self._connector(item) for item in self._grandchildren(element, "Connectors")]
        self._unique(element, "Connectors", [item.name for item in found], [item.where for item in found])
        return tuple(found)

    def _connector(self, element: etree._Element) -> Connector:
        kinds = KINDS if self.reader.version < 2 else (*KINDS, *KINDS_2)
        if element.get("kind") in KINDS_2 and self.reader.version < 2:
            self.reader.problem(
                element, f'connector kind "{element.get("kind")}" is of SSP 2.0; valid: {", ".join(KINDS)}'
            )
            kind = element.get("kind", "")
        else:
            kind = self.reader.choice(element, "kind", kinds, "input")
        children = self._held(element)
        self.files.notes += without_names(self.reader, children)
        return read_connector(self.reader, element, children, kind, self.defined)

    def _connection(self, element: etree._Element) -> Connection:
        children = self._held(element)
        return Connection(
            start_element=self._owner(element, "startElement"),
            start_connector=self.reader.name(element, "startConnector"),
            end_element=self._owner(element, "endElement"),
            end_connector=self.reader.name(element, "endConnector"),
            where=self.reader.where(element),
            suppress_unit_conversion=self.reader.boolean(element, "suppressUnitConversion"),
            transformation=read_transformation(self.reader, children),
            start_indices=self._indices(element, "startIndices"),
            end_indices=self._indices(element, "endIndices"),
        )

    def _owner(self, element: etree._Element, attribute: str) -> str | None:
        """Returns the element that an end of a connection names; None for the system itself.

        Names of elements must not be empty (section 5.2), so "" can only represent the system.
        """
        name = element.get(attribute)
        if name != "":
            return name
        text = f'{attribute}="" is read as if it were absent: this end belongs to the system itself'
        self.files.notes.append(Finding(self.reader.where(element), text, 'startElement="" or endElement=""'))
        return None

    def _indices(self, element: etree._Element, attribute: str) -> tuple[int, ...]:
        text = element.get(attribute)
        if text is None:
            return ()
        numbers = [whole(part, 1, 2**32) for part in text.split()]
        if not numbers or None in numbers:
            self.reader.problem(
                element, f'attribute "{attribute}" is "{text[:60]}"; it must be indices, counting from 1'
            )
            return ()
        return tuple(number for number in numbers if number is not None)

    # ---- parameters --------------------------------------------------------------------------------------------------

    def _bindings(
        self, element: etree._Element, fmu: File | None, content: System | None = None
    ) -> tuple[ParameterBinding, ...]:
        if not (bindings := self._grandchildren(element, "ParameterBindings")):
            return ()
        base = fmu
        if content is not None and element.get("source") is not None:
            base = File(content.document, content.where.path, self._boundary_of(content.document))
        return tuple(self._binding(item, base) for item in bindings)

    def _boundary_of(self, document: Path) -> Path | None:
        return next((file.path for file in self.files.folders.values() if document.is_relative_to(file.path)), None)

    def _binding(self, element: etree._Element, component: File | None) -> ParameterBinding:
        held = self._held(element)
        self.reader.choice(element, "type", (_SET,), _SET)
        values = [child for child in held if child.tag == SSD + "ParameterValues"]
        inline = [child for item in values for child in self._held(item)]
        if (element.get("source") is None) == (not values):
            what = "neither" if element.get("source") is None else "both"
            self.reader.problem(
                element, f"<ParameterBinding> has {what} a source and <ParameterValues>; it needs exactly one of them"
            )
            parameters: tuple[Parameter, ...] = ()
        elif values and not inline:
            parameters = ()
        else:

            def read(reader: Reader, root: etree._Element) -> tuple[Parameter, ...]:
                return read_parameter_set(reader, root, self.defined if root in inline else None)

            parameters = self._loaded(element, inline, SSV + "ParameterSet", component, read) or ()
        mapping: tuple[MappingEntry, ...] | None = None
        for child in held:
            if child.tag == SSD + "ParameterMapping":
                mapping = self._mapping(child, component)
        return ParameterBinding(parameters, element.get("prefix", ""), self.reader.where(element), mapping)

    def _mapping(self, element: etree._Element, component: File | None) -> tuple[MappingEntry, ...]:
        inline = [child for child in self._held(element) if child.tag == SSM + "ParameterMapping"]
        self.reader.choice(element, "type", (_MAPPING,), _MAPPING)
        return self._loaded(element, inline, SSM + "ParameterMapping", component, read_parameter_mapping) or ()

    def _loaded(
        self,
        element: etree._Element,
        inline: Sequence[etree._Element],
        tag: str,
        component: File | None,
        read: Callable[[Reader, etree._Element], _T],
    ) -> _T | None:
        """Returns the content of an element's `source`, or of its only child; None after a problem."""
        uri = element.get("source")
        if (uri is None) == (not inline):
            what = "neither" if uri is None else "both"
            name = tag.partition("}")[2]
            self.reader.problem(
                element, f"<{local_name(element)}> has {what} a source and <{name}>; it needs exactly one"
            )
            return None
        if uri is None:
            self._versioned(inline[0])
            return read(self.reader, inline[0])
        file = self._file(element, uri, component)
        if file is None:
            return None

        def load() -> _T:
            root = _rooted(file, tag)
            reader = Reader(file.shown, self.files.problems)
            found = read(reader, root)
            read_version(probe := Reader(file.shown, []), root)
            note_ignored(root, reader, self.files.notes)
            _validate(root, file, self.files, probe.version)
            return found

        return self.files.once((self.files.real(file), file.member, tag), load, None)

    def _versioned(self, element: etree._Element) -> None:
        """Gives an inline element without a version the version of the file, as OMSimulator does."""
        version = self.root.get("version", "")
        if element.get("version") is None and version:
            text = f"<{local_name(element)}> has no version: read as {version}, that of the file"
            self.files.notes.append(Finding(self.reader.where(element), text, "inline elements without version"))
            element.set("version", version)

    def _file(self, element: etree._Element, uri: str, component: File | None) -> File | None:
        """Returns the file that `source` of a binding, mapping or dictionary names, by its `sourceBase`."""
        base = self.reader.choice(element, "sourceBase", ("SSD", "component"), "SSD")
        trouble, target = read_reference(uri)
        found = None
        if trouble is None and target.fragment is not None:
            trouble = "selects a part of its target (#...), which no file of this type has"
        elif trouble is None and base == "SSD":
            trouble, found = self.files.resolved(self.file, target)
        elif trouble is None and component is None:
            trouble = 'has sourceBase="component", but there is no component with a source here'
        elif trouble is None and component is not None and component.path.suffix.lower() != ".ssd":
            member = normpath(target.path)
            if member.startswith(".."):
                trouble = f'leads out of "{component.shown}"'
            found = File(component.path, f"{component.shown}/{member}", None, member)
        elif trouble is None and component is not None:
            trouble, found = self.files.resolved(component, target)
        if trouble is not None:
            self.reader.problem(element, f'source "{uri}" {trouble}')
            return None
        return found


def _rooted(file: File, tag: str) -> etree._Element:
    root = parsed(file)
    if root.tag != tag:
        message = f"the root element is <{root.tag}>; it must be <{tag}>"
        raise SystemDescriptionError([Problem(Where(file.shown, line_of(root)), message)])
    return root


def _validate(root: etree._Element, file: File, files: Files, version: int) -> None:
    """Validates a file against the schema of its version, or of the latest version of its inline contents."""
    inner = root.iter(SSV + "ParameterSet", SSM + "ParameterMapping", SSB + "SignalDictionary")
    newest = max([version, *(2 for item in inner if item.get("version", "").startswith("2"))])
    files.problems += validate(root, newest, file.shown, files.problems)
