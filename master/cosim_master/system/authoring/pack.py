"""Packs a system into one self-contained .ssp with documents, parameters, mappings, dictionaries and FMUs.

    SystemStructure.ssd    the system (and *.ssd, its variants)
    resources/             all files that these refer to, directly or indirectly

Sources are rewritten to refer to the files in the archive. Nothing else in a document changes, so runs of the archive
and of the system record the same values, bit for bit. The bytes of the archive depend only on the names and contents of
its files. Files without references to them are omitted. An .ssp that a component refers to is included unchanged.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where, WriteFailed
from cosim_master.files import archive
from cosim_master.system.authoring.text.sources import Reference, references
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import ROOT_DOCUMENT, SSD_TYPE, SSP_TYPE, read_system

__all__ = ["Packed", "pack"]

_RESOURCES = PurePosixPath("resources")
_UNSAFE = re.compile(r"[^A-Za-z0-9._~-]")


@dataclass(frozen=True, slots=True)
class Packed:
    """The result of packing: the archive, its members by name, and its variants."""

    path: Path
    members: tuple[str, ...]
    variants: tuple[str, ...]


def pack(
    system: str | Path,
    out: Path,
    *,
    variant: str | None = None,
    overwrite: bool = False,
    settings: Sequence[Callable[[CheckedSystem], object]] = (),
) -> Packed:
    """Writes a system as one self-contained .ssp.

    Args:
        system: .ssd, .ssp or folder. The variants of an .ssp or a folder are included: the .ssd files in the folder of
            the root document that no other document refers to.
        out: the archive to write; its folder is created if necessary.
        variant: the only .ssd to be packed, as the archive's system.
        overwrite: whether `out` may exist.
        settings: functions that read the system's settings, such as `network_of`: what they refuse is not packed.

    Raises:
        SystemDescriptionError: the system is invalid, it is a multi-model or an FMU, or `out` exists.
        WriteFailed: `out` cannot be written. In both cases, nothing has been written.
    """
    given = Path(system)
    _refuse(given, out, overwrite=overwrite)
    with read_system(system, variant) as structure:
        checked = check(structure)
        _check_settings(checked, settings)
        whole = variant is None and given.suffix.lower() != ".ssd"
        variants = _variants(structure.document) if whole else []
        for one in variants:
            with read_system(system, one.name) as other:
                _check_settings(check(other), settings)
        packing = _Packing(structure.document, variants)
        _write(packing, checked, out)
        members = tuple(sorted(map(str, packing.files)))
        return Packed(out, members, tuple(one.name for one in variants))


def _refuse(given: Path, out: Path, *, overwrite: bool) -> None:
    problems = []
    if given.suffix.lower() == ".json":
        text = f"is a multi-model: write it as an SSP first: uav-cosim convert {given} -o FOLDER"
        problems.append(Problem(Where(str(given)), text))
    if given.suffix.lower() == ".fmu":
        problems.append(Problem(Where(str(given)), "is one FMU, which has all that it needs; give a system"))
    if out.suffix.lower() != ".ssp":
        problems.append(Problem(Where(str(out)), "is not the name of an archive; give one that ends in .ssp"))
    elif out.exists() and not overwrite:
        problems.append(Problem(Where(str(out)), "exists; give another name, or --force to overwrite it"))
    elif out.exists() and given.exists() and out.samefile(given):
        problems.append(Problem(Where(str(out)), "is the system itself; give another name"))
    if problems:
        raise SystemDescriptionError(problems)


def _check_settings(checked: CheckedSystem, settings: Sequence[Callable[[CheckedSystem], object]]) -> None:
    """Raises SystemDescriptionError with all problems of the settings."""
    problems: list[Problem] = []
    for read in settings:
        try:
            read(checked)
        except SystemDescriptionError as error:
            problems += error.problems
    if problems:
        raise SystemDescriptionError(problems)


def _variants(root: Path) -> list[Path]:
    """Returns the .ssd files in the folder of the root document that no document refers to."""
    documents = sorted(path for path in root.parent.glob("*.ssd") if path.is_file())
    parts = {
        reference.target
        for document in documents
        for reference in references(document.read_bytes(), document, str(document))
        if reference.target != document
    }
    return [document for document in documents if document != root and document not in parts]


def _write(packing: _Packing, checked: CheckedSystem, out: Path) -> None:
    """Writes the archive to a temporary file, checks that it describes the same system, and moves it to its place."""
    part = out.with_name(f".{out.stem}.part.ssp")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="uav-cosim-pack-") as folder:
            members: dict[str, Path] = {}
            for number, (place, content) in enumerate(packing.files.items()):
                if isinstance(content, bytes):
                    file = Path(folder) / str(number)
                    file.write_bytes(content)
                    content = file
                members[str(place)] = content
            archive.pack(members, part)
        with read_system(part) as structure:
            again = check(structure)
        names = [(one.name, one.fmu.digest, dict(one.start_values)) for one in checked.instances]
        if names != [(one.name, one.fmu.digest, dict(one.start_values)) for one in again.instances]:
            raise SystemDescriptionError([Problem(Where(str(out)), "would be another system: please report this")])
        part.replace(out)
    except OSError as error:
        raise WriteFailed(str(out), error.strerror or str(error)) from error
    finally:
        with suppress(OSError):
            part.unlink()


class _Packing:
    """The place of every file of a system in the archive.

    Attributes:
        files: a file to copy, or its new bytes, by place.
    """

    def __init__(self, root: Path, variants: list[Path]) -> None:
        self.files: dict[PurePosixPath, Path | bytes] = {}
        self._base = root.parent
        self._places: dict[Path, PurePosixPath] = {}
        self._done: set[Path] = set()
        self._take(root, PurePosixPath(ROOT_DOCUMENT))
        for variant in variants:
            self._take(variant, self._free(PurePosixPath(variant.name)))
        for document in (root, *variants):
            self._rewrite(document)

    def _take(self, path: Path, place: PurePosixPath) -> PurePosixPath:
        self._places[path] = place
        self.files[place] = path
        return place

    def _free(self, place: PurePosixPath) -> PurePosixPath:
        candidate, number = place, 1
        while any(candidate == other or candidate in other.parents for other in self.files):
            number += 1
            candidate = place.with_name(f"{place.stem}-{number}{place.suffix}")
        return candidate

    def _place(self, path: Path, *, document: bool) -> PurePosixPath:
        """Returns the place of a file, which is added on first use; files with the same content and name share one."""
        if path in self._places:
            return self._places[path]
        place = _RESOURCES / path.name
        if path.is_relative_to(self._base):
            inside = PurePosixPath(path.relative_to(self._base).as_posix())
            place = inside if inside.parts[0] == _RESOURCES.name else _RESOURCES / inside
        # Not every tool decodes the escapes of a URI, so names must not require any.
        place = PurePosixPath(*(_UNSAFE.sub("_", part) for part in place.parts))
        there = self.files.get(place)
        if not document and isinstance(there, Path) and there.read_bytes() == path.read_bytes():
            self._places[path] = place
            return place
        return self._take(path, self._free(place))

    def _rewrite(self, document: Path) -> None:
        """Redirects the sources of a document, and of the documents it refers to, to the files in the archive."""
        if document in self._done:
            return
        self._done.add(document)
        place = self._places[document]
        data = document.read_bytes()
        pieces, at = [], 0
        for reference in references(data, document, str(document)):
            target = reference.target
            if target is None:
                continue
            if not target.is_file():
                text = f"refers to {target}, which does not exist"
                raise SystemDescriptionError([Problem(Where(str(document)), text)])
            inner = _is_document(reference, target)
            there = self._dialect(target) if reference.network == "dialect" else self._place(target, document=inner)
            pieces += [data[at : reference.start], reference.written(os.path.relpath(there, place.parent))]
            at = reference.stop
            if inner:
                self._rewrite(target)
        if pieces:
            self.files[place] = b"".join([*pieces, data[at:]])

    def _dialect(self, path: Path) -> PurePosixPath:
        """Returns the place of a MAVLink dialect; the files that it includes are placed in the same folder."""
        if path not in self._places:
            files = list(dict.fromkeys(_included(path, set())))
            top = Path(os.path.commonpath([file.parent for file in files]))
            folder = self._free(_RESOURCES / path.stem)
            for file in files:
                self._take(file, folder / file.relative_to(top).as_posix())
        return self._places[path]


def _is_document(reference: Reference, target: Path) -> bool:
    """Returns whether a reference leads to another .ssd."""
    if reference.network or not reference.elements:
        return False
    return reference.type == SSD_TYPE or (reference.type != SSP_TYPE and target.suffix.lower() == ".ssd")


def _included(path: Path, seen: set[Path]) -> Iterator[Path]:
    """Returns a dialect and all files that it includes; built-in files need not exist."""
    if path in seen:
        return
    seen.add(path)
    yield path
    for include in etree.parse(path).getroot().findall("include"):
        other = Path(os.path.normpath(path.parent / str(include.text).strip()))
        if other.is_file():
            yield from _included(other, seen)
