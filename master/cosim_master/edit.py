"""Changes a system in its files: `swap` gives one component another FMU and leaves every other byte as it is.

Only `source` attributes are touched, in the bytes of the file: comments, layout, geometry and everything foreign
stay. A system is never written that `check` would refuse.
"""

from __future__ import annotations

import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from urllib.parse import quote, unquote, urlsplit
from xml.parsers import expat

from cosim_master import archive, shipped
from cosim_master.check import check
from cosim_master.document import near
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.limitations import ENCODING
from cosim_master.ssp import FMU_TYPE, ROOT_DOCUMENT, SSP_TYPE, read_system
from cosim_master.system import Component, Element, System, SystemStructure

__all__ = ["documents", "rebased", "swap"]

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription "
_REFERRING = {_SSD + name for name in ("Component", "ParameterBinding", "ParameterMapping", "SignalDictionary")}
_TAG = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


def swap(system: str | Path, component: str, fmu: str | Path, out: str | Path | None = None) -> Path:
    """Give one component of a system another FMU.

    An .ssd that several components share is copied for the one that changes, and only its reference is redirected.
    Sources that lead out of the system's folder are rewritten to lead to the same files from the new place.

    Args:
        system: .ssd, .ssp or folder.
        component: hierarchical name of the component ("drone3.vehicle").
        fmu: the FMU it gets, or the name of a model whose FMU comes with this project; an .ssp takes a copy of it into
            resources/.
        out: the new system: an .ssp or a folder, which must not exist. None changes `system` itself.

    Returns:
        What was written: `out`, or `system`.

    Raises:
        SystemDescriptionError: the system is wrong, there is no such component, or the FMU does not fit its
            connectors and parameters; every mismatch at once. Nothing has been written then.
    """
    with read_system(system) as structure:
        chain = _chain(structure, component)
        path = Path(fmu)
        if not path.is_file():
            found = shipped.fmu(str(fmu))
            if found is None:
                raise _refusal(str(path), "no such file; give the FMU that the component is to have")
            path = found
        if out is None and not Path(system).exists():
            raise _refusal(str(system), "a shipped system is not changed in place; give a path for the new one")
        path = path.parent.resolve() / path.name
        _check_fit(structure, component, chain, path)
        target = Path(system) if out is None else Path(out)
        if out is not None and target.exists():
            raise _refusal(str(target), "exists already; give a path that does not")
        edition = _Edition(structure, chain, path, target, in_place=out is None)
        edition.write()
        return target


def _refusal(shown: str, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(shown), message)])


def _inside(element: Element) -> System | None:
    if isinstance(element, System):
        return element
    return element.content if isinstance(element, Component) else None


def _walk(system: System, name: str, chain: tuple[Element, ...]) -> Iterator[tuple[str, tuple[Element, ...]]]:
    for element in system.elements:
        full = f"{name}.{element.name}" if name else element.name
        inner = (*chain, element)
        yield full, inner
        content = _inside(element)
        if content is not None:
            yield from _walk(content, full, inner)


def _chain(structure: SystemStructure, component: str) -> tuple[Element, ...]:
    """The elements from the root system (excluded) to the component (included)."""
    everything = list(_walk(structure.system, "", ()))
    fmus = {name: chain for name, chain in everything if isinstance(chain[-1], Component) and _is_fmu(chain[-1])}
    found = [chain for name, chain in everything if name == component]
    if not found:
        raise _refusal(str(structure.path), f'there is no component "{component}"; {near(component, fmus)}')
    if len(found) > 1:
        raise _refusal(str(structure.path), f'"{component}" names {len(found)} elements; rename all but one')
    (chain,) = found
    if not (isinstance(chain[-1], Component) and _is_fmu(chain[-1])):
        inner = [name for name in fmus if name.startswith(component + ".")]
        raise _refusal(str(structure.path), f'"{component}" is a system, not an FMU; {near(component, inner)}')
    shared = [element for element in chain if isinstance(element, Component) and element.type != SSP_TYPE]
    for element in shared:
        if element.fragment is not None:
            text = f'"{component}" is inside "#{element.fragment}", which other components share'
            raise SystemDescriptionError([Problem(element.where, text)])
    packed = [element for element in chain if isinstance(element, Component) and element.type == SSP_TYPE]
    if packed:
        text = f'"{component}" is inside the archive of "{packed[0].name}"; unpack it to a folder to change it'
        raise SystemDescriptionError([Problem(packed[0].where, text)])
    return chain


def _is_fmu(component: Component) -> bool:
    return component.content is None and component.type == FMU_TYPE


def _check_fit(structure: SystemStructure, name: str, chain: Sequence[Element], fmu: Path) -> None:
    """Check the system as it would be. A parameter that the new FMU has not is a mismatch here, not a note."""
    component = chain[-1]
    assert isinstance(component, Component)
    # That the old FMU is missing may be why it is swapped.
    problems = [
        problem
        for problem in structure.problems
        if not (component.source is None and problem.where == component.where and problem.message.startswith("source "))
    ]
    changed: Element = replace(component, source=fmu)
    for element in reversed(chain[:-1]):
        inside = _inside(element)
        assert inside is not None
        grown = _exchanged(inside, changed)
        changed = replace(element, content=grown) if isinstance(element, Component) else grown
    system = _exchanged(structure.system, changed)
    checked = check(replace(structure, system=system, problems=tuple(problems)))
    lost = [item for item in checked.unmatched if item.name.startswith(name + ".")]
    if lost:
        raise SystemDescriptionError(
            Problem(item.where, f'{fmu.name} has no parameter for "{item.name}"; {item.hint}') for item in lost
        )


def _exchanged(system: System, element: Element) -> System:
    return replace(system, elements=tuple(element if item.name == element.name else item for item in system.elements))


@dataclass(frozen=True, slots=True)
class _Reference:
    """A `source` attribute of a document.

    Attributes:
        elements: names from the root system (excluded) to the component; empty for other references.
        start, stop: where its value is in the bytes of the file.
        target: the file it leads to, absolute; None if its value is no relative path.
        fragment: what comes after "#" in it.
    """

    elements: tuple[str, ...]
    start: int
    stop: int
    target: Path | None
    fragment: str = ""


def _references(data: bytes, document: Path, shown: str) -> list[_Reference]:
    """Every reference of a document to another file, in order."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
        raise _refusal(shown, ENCODING.text())
    found: list[_Reference] = []
    names: list[str | None] = []
    parser = expat.ParserCreate(namespace_separator=" ")

    def started(tag: str, attributes: dict[str, str]) -> None:
        named = tag in (_SSD + "System", _SSD + "Component")
        names.append(attributes.get("name", "") if named else None)
        uri = attributes.get("source")
        if uri is None or tag not in _REFERRING or attributes.get("sourceBase") == "component":
            return
        elements = tuple(name for name in names if name is not None)[1:] if named else ()
        start, stop = _span(data, parser.CurrentByteIndex, shown)
        found.append(_Reference(elements, start, stop, _target(document, uri), unquote(urlsplit(uri).fragment)))

    def ended(_: str) -> None:
        names.pop()

    parser.StartElementHandler = started
    parser.EndElementHandler = ended
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise _refusal(shown, f"cannot be changed: {error}") from error
    return found


def _target(document: Path, uri: str) -> Path | None:
    parts = urlsplit(uri)
    if parts.scheme or parts.netloc or not parts.path:
        return None
    return Path(os.path.normpath(document.parent / unquote(parts.path)))


def _span(data: bytes, index: int, shown: str) -> tuple[int, int]:
    """Where the value of `source` is in the start tag that begins at `index`."""
    tag = _TAG.match(data, index)
    at = len(data) if tag is None else tag.end()
    while (match := _ATTRIBUTE.match(data, at)) is not None:
        if match.group(1) == b"source":
            return match.span(2 if match.group(2) is not None else 3)
        at = match.end()
    raise _refusal(shown, "has a start tag that cannot be changed; save it as UTF-8")


def documents(structure: SystemStructure) -> Iterator[Path]:
    """The .ssd files of a system: its root, those of components, and the variants beside the root."""
    yield structure.document
    if structure.path.suffix.lower() != ".ssd":
        yield from structure.document.parent.glob("*.ssd")
    for _, chain in _walk(structure.system, "", ()):
        element = chain[-1]
        packed = any(isinstance(outer, Component) and outer.type == SSP_TYPE for outer in chain)
        if not packed and isinstance(element, Component) and element.content is not None:
            yield element.content.document


def rebased(data: bytes, old: Path, new: Path, base: Path) -> bytes:
    """The bytes of a document that moves from `old` to `new`: sources that lead out of the folder `base`, which moves
    with it, are rewritten to lead to the same files."""
    pieces, at = [], 0
    for reference in _references(data, old, str(old)):
        if reference.target is None or reference.target.is_relative_to(base):
            continue
        uri = quote(Path(os.path.relpath(reference.target, new.parent)).as_posix())
        if reference.fragment:
            uri += f"#{quote(reference.fragment)}"
        pieces += [data[at : reference.start], uri.encode("ascii")]
        at = reference.stop
    return b"".join([*pieces, data[at:]])


class _Edition:
    """A changed system: which files it has, and what is in those that change."""

    def __init__(
        self, structure: SystemStructure, chain: Sequence[Element], fmu: Path, target: Path, *, in_place: bool
    ) -> None:
        self.structure = structure
        self.fmu = fmu
        self.in_place = in_place
        self.target = target
        self.base = structure.document.parent
        self.packing = target.suffix.lower() == ".ssp"
        self.root = self.base if in_place and not self.packing else target.parent.resolve() / target.name
        self.files: dict[PurePosixPath, Path | bytes] = {}
        """Content by path in the new system: a file to copy, or the bytes themselves."""
        self.places: dict[Path, PurePosixPath] = {}
        """Where files of the old system are in the new one."""
        self.documents = set(documents(structure))
        """The documents that may have to change; those in archives of their own never do."""
        self.done: set[tuple[Path, tuple[str, ...]]] = set()
        """The components whose source has been written, by document and names."""
        self._take_over()
        self._rewrite(chain)

    def _relative(self, path: Path) -> PurePosixPath | None:
        return PurePosixPath(path.relative_to(self.base).as_posix()) if path.is_relative_to(self.base) else None

    def _take_over(self) -> None:
        """The files of the old system that the new one has too, unchanged at first."""
        given = self.structure.path
        if given.is_dir() or given.suffix.lower() == ".ssp":
            members = [path for path in sorted(self.base.rglob("*")) if path.is_file()]
        else:
            members = sorted(path for path in self._reachable() if self._relative(path) is not None)
        for path in members:
            relative = self._relative(path)
            if relative is None or (path.resolve().is_relative_to(self.root) and not self.in_place):
                continue
            if path == self.structure.document and not self.in_place:
                relative = PurePosixPath(ROOT_DOCUMENT)
            self.files[relative] = path
            self.places[path] = relative

    def _reachable(self) -> set[Path]:
        """The documents of the system and every existing file they lead to."""
        found = set(self.documents)
        for document in self.documents:
            references = _references(document.read_bytes(), document, str(document))
            targets = (reference.target for reference in references)
            found.update(target for target in targets if target is not None and target.is_file())
        return found

    def _rewrite(self, chain: Sequence[Element]) -> None:
        documents = self._split(chain)
        redirected: dict[tuple[Path, tuple[str, ...]], PurePosixPath | Path] = {}
        copies: dict[Path, PurePosixPath] = {}
        used = self._uses()
        for (document, names), (inner, _) in pairwise(documents):
            if used[inner] > 1 or inner not in self.places:
                copies[inner] = self._copy_name(inner, ".".join(element.name for element in chain[:-1]))
                redirected[(document, names)] = copies[inner]
        last, names = documents[-1]
        redirected[(last, names)] = self._packed(self.fmu) if self.packing else self.fmu
        changing = {document for document, _ in documents}
        for document in [path for path in self.places if path in self.documents]:
            if not self.in_place or self.packing or document in changing:
                relevant = {} if document in copies else redirected
                self._place_document(document, self.places[document], relevant)
        for document, place in copies.items():
            self._place_document(document, place, redirected)
        for document, _ in redirected.keys() - self.done:
            raise _refusal(str(document), "has a source that cannot be found to be changed")

    def _split(self, chain: Sequence[Element]) -> list[tuple[Path, tuple[str, ...]]]:
        """The documents on the way to the component, each with the names that lead on from it."""
        documents = []
        document, names = self.structure.document, []
        for element in chain:
            names.append(element.name)
            if isinstance(element, Component):
                documents.append((document, tuple(names)))
                names = []
                if element.content is not None:
                    document = element.content.document
        return documents

    def _uses(self) -> Counter[Path]:
        """How many components of the running system each document serves."""
        uses: Counter[Path] = Counter()
        for _, chain in _walk(self.structure.system, "", ()):
            element = chain[-1]
            if isinstance(element, Component) and element.content is not None:
                uses[element.content.document] += 1
        return uses

    def _copy_name(self, document: Path, owner: str) -> PurePosixPath:
        relative = self._relative(document)
        folder = PurePosixPath() if relative is None else relative.parent
        stem = f"{document.stem}-{re.sub(r'[^A-Za-z0-9_.-]', '_', owner)}"
        return self._free(folder, stem, document.suffix)

    def _free(self, folder: PurePosixPath, stem: str, suffix: str) -> PurePosixPath:
        candidate, number = folder / f"{stem}{suffix}", 1
        while candidate in self.files or (self.in_place and not self.packing and (self.base / candidate).exists()):
            number += 1
            candidate = folder / f"{stem}-{number}{suffix}"
        return candidate

    def _packed(self, path: Path) -> PurePosixPath:
        """The place in the archive of a file from outside; it is taken in on first use."""
        if path not in self.places:
            folder = PurePosixPath("resources")
            same = folder / path.name
            content = self.files.get(same)
            if isinstance(content, Path) and content.read_bytes() == path.read_bytes():
                self.places[path] = same
                return same
            place = self._free(folder, path.stem, path.suffix)
            self.files[place], self.places[path] = path, place
            if path in self.documents:
                self._place_document(path, place, {})
        return self.places[path]

    def _place_document(
        self,
        document: Path,
        place: PurePosixPath,
        redirected: dict[tuple[Path, tuple[str, ...]], PurePosixPath | Path],
    ) -> None:
        """Put a document into the new system, with the sources changed that need it."""
        data = document.read_bytes()
        folder = self.root / place.parent
        pieces, at = [], 0
        for reference in _references(data, document, str(document)):
            old, wanted = reference.target, None
            if reference.elements:
                wanted = redirected.get((document, reference.elements))
                self.done.add((document, reference.elements))
            if wanted is None:
                if old is None:
                    continue
                wanted = self.places.get(old, old)
                if self.packing and isinstance(wanted, Path) and wanted.is_file():
                    wanted = self._packed(wanted)
            location = self.root / wanted
            if old is not None and location == Path(os.path.normpath(folder / os.path.relpath(old, document.parent))):
                continue
            uri = quote(Path(os.path.relpath(location, folder)).as_posix())
            if reference.fragment and wanted not in redirected.values():
                uri += f"#{quote(reference.fragment)}"
            pieces += [data[at : reference.start], uri.encode("ascii")]
            at = reference.stop
        self.files[place] = b"".join([*pieces, data[at:]]) if pieces else document
        self.places.setdefault(document, place)

    def write(self) -> None:
        """Write the new system: all of it beside its place first, so that a failure leaves nothing half done."""
        if self.in_place and not self.packing:
            self._write_changed()
            return
        self.root.parent.mkdir(parents=True, exist_ok=True)
        part = self.root.with_name(self.root.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            for place, content in self.files.items():
                path = part / place
                path.parent.mkdir(parents=True, exist_ok=True)
                if isinstance(content, bytes):
                    path.write_bytes(content)
                else:
                    shutil.copyfile(content, path)
            if self.packing:
                members = {str(place): part / place for place in self.files}
                archive.pack(members, part / "packed.ssp")
                (part / "packed.ssp").replace(self.root)
            else:
                part.replace(self.root)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _write_changed(self) -> None:
        # Copies first: the document that refers to them is replaced last, when everything it needs is there.
        changed = [
            (self.base / place, content if isinstance(content, bytes) else content.read_bytes())
            for place, content in self.files.items()
            if content != self.base / place
        ]
        for path, content in sorted(changed, key=lambda item: item[0].exists()):
            part = path.with_name(path.name + ".part")
            part.write_bytes(content)
            part.replace(path)
