"""Saves a changed system into its files; unchanged parts keep every byte.

    with read_system(path) as structure:
        system = replace(structure.system, connections=(*structure.system.connections, Connection(...)))
        save(structure, system)

Elements, connectors, connections, parameter bindings, parameters and annotations can be added, removed and changed.
Comments, layout, geometry and the contents written by other tools are preserved. The files are read back and checked: a
system is saved only if it is read as intended and `check` accepts it. Files of components (.ssd, .ssp) are separate
systems, which must be changed separately.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote, urlsplit

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import INNER_FILE
from cosim_master.files import archive
from cosim_master.files.whole import write_whole
from cosim_master.files.xml_edit import Document, Edit, Node, applied, tag_text
from cosim_master.system import shipped
from cosim_master.system.authoring.swap import documents, rebased
from cosim_master.system.authoring.text.difference import difference
from cosim_master.system.authoring.text.ssp_text import (
    Scope,
    binding_text,
    connection_attributes,
    connection_text,
    connector_text,
    listed,
    parameter_text,
    transformation_text,
    type_text,
    value_text,
)
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import FMU_TYPE, read_system
from cosim_master.system.reading.ssp.grammar import (
    ANNOTATIONS,
    ANY_TYPE,
    GRAMMAR,
    SSC,
    SSD,
    SSV,
    TRANSFORMATIONS,
    VALUE_TYPES,
)
from cosim_master.system.structure import (
    Component,
    Connection,
    Connector,
    Element,
    Parameter,
    ParameterBinding,
    SignalDictionaryReference,
    System,
    SystemStructure,
)

__all__ = ["save"]

_T = TypeVar("_T")


def save(structure: SystemStructure, system: System, out: str | Path | None = None) -> Path:
    """Writes a changed system.

    Args:
        structure: the result of `read_system`, without problems and still open.
        system: its new root system, made from `structure.system` with `dataclasses.replace`.
        out: the target, which must not exist yet. A folder for a folder, an .ssp for an .ssp, and for an .ssd another
            one in the same folder. None: `structure.path` itself. Sources that lead out of a folder are rewritten to
            refer to the same files from the new one.

    Raises:
        SystemDescriptionError: `check` refuses the new system, or it contains data that cannot be written; the files
            are then unchanged.
        ValueError: `out` is not suitable, or missing for a shipped system.

    Returns:
        The file or folder written.
    """
    if structure.problems:
        raise SystemDescriptionError(structure.problems)
    given, target = structure.path, structure.path if out is None else Path(out)
    if out is None and shipped.is_shipped(given):
        raise ValueError(f"{given} is shipped, and is not changed in place; give a path for the new system")
    if out is not None:
        if target.exists():
            raise ValueError(f"{target} exists already; give a path that does not")
        if given.suffix.lower() == ".ssd" and target.parent.resolve() != structure.document.parent:
            raise ValueError(f"{target}: a single .ssd can be saved in its own folder only, since its files are there")
    changed = _Changes(structure, system).texts
    if given.is_dir() and out is not None:
        shutil.copytree(given, target)
        _into_copy(structure, system, changed, target)
    elif given.suffix.lower() == ".ssd" and out is not None:
        shutil.copyfile(structure.document, target)
        _into_copy(structure, system, changed, target)
    else:
        before = {path: path.read_bytes() for path in changed}
        _replace(changed, structure, system, structure.document)
        if given.suffix.lower() == ".ssp":
            folder = structure.document.parent
            members = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
            archive.pack(members, target)
            if out is not None:
                _write(before)
    return target


def _into_copy(structure: SystemStructure, system: System, changed: Mapping[Path, bytes], target: Path) -> None:
    """Changes a copy of the folder or document, or removes it again after an error."""
    base, place = structure.document.parent, target.resolve()
    try:
        if target.is_dir():
            moved = {place / os.path.relpath(path, base): text for path, text in changed.items()}
            for document in {path for path in documents(structure) if path.is_relative_to(base)}:
                new = place / document.relative_to(base)
                moved[new] = rebased(moved.get(new, document.read_bytes()), document, new, base)
            _replace(moved, structure, system, target / structure.document.name)
        else:
            moved = {place if path == structure.document else path: text for path, text in changed.items()}
            _replace(moved, structure, system, target)
    except BaseException:
        shutil.rmtree(target) if target.is_dir() else target.unlink()
        raise


def _write(texts: Mapping[Path, bytes]) -> None:
    for path, text in texts.items():
        write_whole(path, text)


def _replace(texts: Mapping[Path, bytes], structure: SystemStructure, system: System, document: Path) -> None:
    """Writes files, reads the system back, and restores the files if the system differs from the intended one."""
    before = {path: path.read_bytes() for path in texts}
    try:
        _write(texts)
        with read_system(document) as written:
            if written.problems:
                raise SystemDescriptionError(written.problems)
            if (text := difference(system, written.system, "the system")) is not None:
                raise _refusal(structure.where, f"cannot be saved as it is: {text}")
            check(written)
    except BaseException:
        _write(before)
        raise


def _refusal(where: Where, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(where, message)])


@dataclass(slots=True)
class _File:
    """A file to be changed."""

    document: Document
    edits: list[Edit] = field(default_factory=list)


class _Changes:
    """The changes to be written, as `texts`: the new bytes of every file that changes."""

    def __init__(self, structure: SystemStructure, system: System) -> None:
        self.structure = structure
        self.files: dict[Path, _File] = {}
        root = self._file(structure.document, structure.where)
        node = root.document.root.first(SSD + "System")
        assert node is not None
        self._system(root, node, structure.system, system)
        self.texts: dict[Path, bytes] = {}
        for path, file in self.files.items():
            try:
                text = applied(file.document.data, file.edits)
            except ValueError as error:
                raise _refusal(structure.where, str(error)) from error
            if text != file.document.data:
                self.texts[path] = text

    def _file(self, path: Path, where: Where) -> _File:
        if path not in self.files:
            try:
                self.files[path] = _File(Document(path.read_bytes()))
            except ValueError as error:
                raise _refusal(Where(where.path), str(error)) from error
        return self.files[path]

    # ---- lists of children -------------------------------------------------------------------------------------------

    def _list(
        self,
        file: _File,
        parent: Node,
        holder: str,
        tags: tuple[str, ...],
        old: Sequence[_T],
        new: Sequence[_T],
        key: Callable[[_T], Any],
        change: Callable[[_File, Node, _T, _T], None],
        text: Callable[[Scope, _T], str],
    ) -> list[tuple[str, str]]:
        """Changes the children of a list such as <Connections> from `old` to `new`.

        Returns:
            The list itself as (tag, text), if it does not exist yet.
        """
        node = parent.first(holder)
        nodes = [] if node is None else [child for child in node.children if child.tag in tags]
        if old == new:
            return []
        if node is None:
            return [(holder, tag_text(parent.scope, holder, {}, [text(parent.scope, item) for item in new]))]
        if not new:
            file.edits += file.document.removed(node)
            return []
        places = {key(item): (item, place) for item, place in zip(old, nodes, strict=True)}
        fresh: dict[Node | None, list[str]] = {}
        after: Node | None = None
        kept = set()
        for item in new:
            if key(item) in places and key(item) not in kept:
                kept.add(key(item))
                before, after = places[key(item)]
                if before != item:
                    change(file, after, before, item)
            else:
                fresh.setdefault(after, []).append(text(node.scope, item))
        for name, (_, place) in places.items():
            if name not in kept:
                file.edits += file.document.removed(place)
        for anchor, made in fresh.items():
            file.edits += file.document.inserted(node, made, anchor)
        return []

    def _holders(self, file: _File, parent: Node, made: list[tuple[str, str]]) -> None:
        """Inserts new lists at the position that the standard requires."""
        order = GRAMMAR[parent.tag].children
        anchored: dict[Node | None, list[str]] = {}
        for tag, text in sorted(made, key=lambda one: order.index(one[0])):
            earlier = [c for c in parent.children if c.tag in order and order.index(c.tag) < order.index(tag)]
            anchored.setdefault(earlier[-1] if earlier else None, []).append(text)
        for anchor, texts in anchored.items():
            file.edits += file.document.inserted(parent, texts, anchor)

    def _attributes(self, file: _File, node: Node, pairs: Mapping[str, tuple[str | None, str | None]]) -> None:
        """Sets the attributes whose (old, new) values differ."""
        for name, (old, new) in pairs.items():
            if old != new:
                file.edits += file.document.attribute(node, name, new)

    def _child(self, file: _File, node: Node, tags: Sequence[str], text: str | None) -> None:
        """Sets, replaces or removes the only child that an element may have among some tags."""
        found = next((child for child in node.children if child.tag in tags), None)
        if found is not None and text is not None:
            file.edits.append(Edit(found.start, found.end, text.encode("ascii", "xmlcharrefreplace")))
        elif found is not None:
            file.edits += file.document.removed(found)
        elif text is not None:
            file.edits += file.document.inserted(node, [text], None)

    # ---- elements ----------------------------------------------------------------------------------------------------

    def _system(self, file: _File, node: Node, old: System, new: System) -> None:
        self._attributes(file, node, {"name": (old.name, new.name)})
        made = self._common(file, node, old, new)
        made += self._list(
            file,
            node,
            SSD + "Elements",
            tuple(SSD + name for name in ("Component", "SignalDictionaryReference", "System")),
            old.elements,
            new.elements,
            lambda item: item.name,
            self._element,
            self._element_text,
        )
        made += self._list(
            file,
            node,
            SSD + "Connections",
            (SSD + "Connection",),
            old.connections,
            new.connections,
            _connection_key(old.connections),
            self._connection,
            connection_text,
        )
        self._holders(file, node, made)

    def _common(self, file: _File, node: Node, old: Any, new: Any) -> list[tuple[str, str]]:
        """Handles connectors, parameter bindings and annotations, which all kinds of elements have."""
        made = self._list(
            file,
            node,
            SSD + "Connectors",
            (SSD + "Connector",),
            old.connectors,
            new.connectors,
            lambda item: item.name,
            self._connector,
            connector_text,
        )
        made += self._list(
            file,
            node,
            SSD + "ParameterBindings",
            (SSD + "ParameterBinding",),
            old.parameter_bindings,
            new.parameter_bindings,
            lambda item: item.where,
            self._binding,
            binding_text,
        )
        own = tuple(item for item in old.annotations if item.element.getparent() is not None)
        return made + self._list(
            file,
            node,
            ANNOTATIONS,
            (SSC + "Annotation",),
            own,
            new.annotations,
            lambda item: id(item.element),
            lambda *_: None,
            lambda _, item: etree.tostring(item.element, encoding="unicode", with_tail=False),
        )

    def _element(self, file: _File, node: Node, old: Element, new: Element) -> None:
        if type(old) is not type(new):
            file.edits.append(
                Edit(node.start, node.end, self._element_text(node.scope, new).encode("ascii", "xmlcharrefreplace"))
            )
        elif isinstance(old, System) and isinstance(new, System):
            self._system(file, node, old, new)
        else:
            if isinstance(old, Component) and isinstance(new, Component):
                if old.content != new.content and old.source == new.source:
                    where = old.where if old.content is None else old.content.where
                    raise _refusal(where, INNER_FILE.text(old.name))
                uris = (self._uri(old), self._uri(new)) if old.source != new.source else ("", "")
                kinds = old.implementation, new.implementation
                self._attributes(file, node, {"source": uris, "type": (old.type, new.type), "implementation": kinds})
            if isinstance(old, SignalDictionaryReference) and isinstance(new, SignalDictionaryReference):
                self._attributes(file, node, {"dictionary": (old.dictionary, new.dictionary)})
            self._holders(file, node, self._common(file, node, old, new))

    def _uri(self, component: Component) -> str | None:
        if component.source is None:
            return None
        path = quote(Path(os.path.relpath(component.source, self.structure.document.parent)).as_posix())
        if component.source == self.structure.document and component.fragment is not None:
            path = ""
        return path if component.fragment is None else f"{path}#{quote(component.fragment)}"

    def _element_text(self, scope: Scope, item: Element) -> str:
        attributes: dict[str, str | None] = {"name": item.name}
        if isinstance(item, Component):
            attributes["type"] = None if item.type == FMU_TYPE else item.type
            attributes["source"] = self._uri(item)
            attributes["implementation"] = None if item.implementation == "any" else item.implementation
        elif isinstance(item, SignalDictionaryReference):
            attributes["dictionary"] = item.dictionary
        children = listed(scope, "Connectors", [connector_text(scope, one) for one in item.connectors])
        children += listed(scope, "ParameterBindings", [binding_text(scope, one) for one in item.parameter_bindings])
        if isinstance(item, System):
            children += listed(scope, "Elements", [self._element_text(scope, one) for one in item.elements])
            children += listed(scope, "Connections", [connection_text(scope, one) for one in item.connections])
        return tag_text(scope, SSD + type(item).__name__, attributes, children)

    def _connector(self, file: _File, node: Node, old: Connector, new: Connector) -> None:
        self._attributes(file, node, {"kind": (old.kind, new.kind)})
        if type_text(node.scope, old) != type_text(node.scope, new):
            self._child(file, node, tuple(ANY_TYPE), type_text(node.scope, new))

    def _connection(self, file: _File, node: Node, old: Connection, new: Connection) -> None:
        before, after = connection_attributes(old), connection_attributes(new)
        self._attributes(file, node, {name: (before[name], after[name]) for name in before})
        if old.transformation != new.transformation:
            self._child(file, node, TRANSFORMATIONS, transformation_text(node.scope, new.transformation))

    # ---- parameters --------------------------------------------------------------------------------------------------

    def _binding(self, file: _File, node: Node, old: ParameterBinding, new: ParameterBinding) -> None:
        self._attributes(file, node, {"prefix": (old.prefix or None, new.prefix or None)})
        if old.parameters == new.parameters:
            return
        values = node.first(SSD + "ParameterValues")
        inner = None if values is None else values.first(SSV + "ParameterSet")
        if inner is None:
            uri = self._source(file.document, node)
            if uri is None:
                raise _refusal(old.where, "the parameters of this binding are inside of a component: change them there")
            file = self._file(Path(os.path.normpath(self.structure.document.parent / uri)), old.where)
            inner = file.document.root
        parameters = inner.first(SSV + "Parameters")
        assert parameters is not None
        if not parameters.children:
            texts = [parameter_text(parameters.scope, one) for one in new.parameters]
            file.edits += file.document.inserted(parameters, texts, None)
            return
        self._list(
            file,
            inner,
            SSV + "Parameters",
            (SSV + "Parameter",),
            old.parameters,
            new.parameters,
            lambda item: item.name,
            self._parameter,
            parameter_text,
        )

    @staticmethod
    def _source(document: Document, node: Node) -> str | None:
        element = etree.fromstring(document.data[node.start : node.head].rstrip(b"/>").strip() + b"/>", _Lenient())
        if element.get("sourceBase") == "component":
            return None
        return unquote(urlsplit(element.get("source", "")).path)

    def _parameter(self, file: _File, node: Node, old: Parameter, new: Parameter) -> None:
        if (text := value_text(node.scope, new)) != value_text(node.scope, old):
            self._child(file, node, VALUE_TYPES, text)


def _Lenient() -> etree.XMLParser:
    """Returns a parser for a start tag whose prefixes are declared in outer elements."""
    return etree.XMLParser(recover=True, no_network=True, resolve_entities=False)


def _connection_key(old: Sequence[Connection]) -> Callable[[Connection], Any]:
    """Returns a key for a connection, which has no name: its ends, or else its place in the file, identify it."""
    ends = {_ends(item): item.where for item in old}
    counts: dict[Where, int] = {}
    for item in old:
        counts[item.where] = counts.get(item.where, 0) + 1

    def key(item: Connection) -> Any:
        if _ends(item) in ends:
            return _ends(item)
        # If one line contains several connections, only their ends distinguish them.
        same = [known for known, where in ends.items() if where == item.where]
        return same[0] if len(same) == 1 and counts[item.where] == 1 else _ends(item)

    return key


def _ends(item: Connection) -> tuple[Any, ...]:
    start = (item.start_element, item.start_connector, item.start_indices)
    return (*start, item.end_element, item.end_connector, item.end_indices)
