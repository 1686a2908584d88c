"""Handles the files that SSP files refer to: resolves URIs, unpacks archives, and caches the contents.

A relative URI is resolved against the file that contains it (RFC 3986), and must not lead out of the archive of this
file. The contents of the files are not interpreted here.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import parse_qsl, unquote, urlsplit

from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ABSOLUTE_URI, LARGE_DOCUMENT
from cosim_master.files import archive
from cosim_master.files.xml import parse
from cosim_master.system.structure import ExtractedArchive

__all__ = ["File", "Files", "Target", "is_file", "parsed", "read_reference", "read_source"]

_MAX_DOCUMENT_BYTES = 256 << 20
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class File:
    """A file, or a member of an archive.

    Attributes:
        path: the file, or the archive that contains it.
        shown: the name that the user would use.
        boundary: the unpacked archive that contains the file, and that references must not leave; None for the user's
            own files.
        member: its name in the archive, empty for a file.
    """

    path: Path
    shown: str
    boundary: Path | None = None
    member: str = ""


@dataclass(frozen=True, slots=True)
class Target:
    """The target of a URI reference: a file path relative to the referring file, and a fragment.

    Attributes:
        path: empty for a reference into the same document.
        fragment: None without "#".
    """

    path: str
    fragment: str | None


@dataclass(slots=True)
class Files:
    """The files read for one structure. Each file is read once, however many components refer to it."""

    problems: list[Problem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    archives: list[ExtractedArchive] = field(default_factory=list)
    folders: dict[Path, File] = field(default_factory=dict)
    read: dict[Any, Any] = field(default_factory=dict)
    found: dict[tuple[File, Target], tuple[str | None, File]] = field(default_factory=dict)
    """Results of `resolved`: the components of a swarm refer to a few files."""
    real_paths: dict[Path, Path] = field(default_factory=dict)
    unpacked_bytes: int = 0
    depth: int = 0
    """Nesting depth of the system that is being read."""

    def unpacked(self, file: File) -> File:
        """Returns the folder with the members of an archive, which is unpacked on first use.

        Raises:
            SystemDescriptionError: the file is not an archive, or the archive is refused.
        """
        key = self.real(file)
        if key not in self.folders:
            opened = ExtractedArchive()
            self.archives.append(opened)
            left = archive.MAX_BYTES - self.unpacked_bytes
            self.unpacked_bytes += archive.unpack(file.path, opened.directory, file.shown, limit=left)
            self.folders[key] = File(opened.directory, file.shown, opened.directory)
        return self.folders[key]

    def once(self, key: Any, make: Callable[[], _T], failed: _T) -> _T:
        """Returns the result of `make`, called once per key; `failed` if it raises, with its problems added to ours."""
        if key not in self.read:
            self.read[key] = failed
            try:
                self.read[key] = make()
            except SystemDescriptionError as error:
                self.problems += error.problems
        found: _T = self.read[key]
        return found

    def real(self, file: File) -> Path:
        """Returns the path of a file without symbolic links."""
        if file.path not in self.real_paths:
            self.real_paths[file.path] = file.path.resolve()
        return self.real_paths[file.path]

    def resolved(self, base: File, target: Target) -> tuple[str | None, File]:
        """Returns the problem with a reference in the file `base`; or None, and the existing file that it names."""
        if (base, target) not in self.found:
            self.found[base, target] = self._resolved(base, target)
        return self.found[base, target]

    @staticmethod
    def _resolved(base: File, target: Target) -> tuple[str | None, File]:
        path = Path(os.path.normpath(base.path.parent / target.path))
        shown = os.path.normpath(Path(base.shown).parent / target.path)
        found = File(path, shown, base.boundary)
        if base.boundary is not None and not path.is_relative_to(base.boundary):
            return "leads out of the .ssp archive", found
        if not is_file(path):
            leaves = os.path.normpath(target.path).startswith(os.pardir)
            moved = "; to move a system, make one file of it where it runs: uav-cosim pack" if leaves else ""
            return f'does not exist: no file "{shown}"{moved}', found
        return None, found


def is_file(path: Path) -> bool:
    """Returns whether such a file exists; False for names that the operating system rejects."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


@lru_cache
def read_reference(uri: str) -> tuple[str | None, Target]:
    """Returns the problem with a URI reference; or None, and its target (RFC 3986, relative only)."""
    nowhere = Target("", None)
    try:
        parts = urlsplit(uri)
        path, fragment = unquote(parts.path, errors="strict"), unquote(parts.fragment, errors="strict")
    except (ValueError, UnicodeDecodeError):
        return "is not a URI reference; write a relative path with / and %-escapes", nowhere
    if parts.scheme or parts.netloc or path.startswith("/"):
        return ABSOLUTE_URI.text(), nowhere
    if parts.query or any("\\" in text or any(ord(c) < 32 for c in text) for text in (path, fragment)):
        return "is not a relative path; write / between folders and escape ? as %3F", nowhere
    if not path and not fragment:
        return "is empty", nowhere
    return None, Target(path, fragment or None)


def read_source(base: File, uri: str) -> tuple[str | None, File | None, str]:
    """Returns the problem with the URI of an FMU, or None; its file; and a note if the URI is not used literally.

    The file is relative to `base`, absolute (file:), or one that a server of proxyfmu would run
    (proxyfmu://HOST?file=PATH); the latter is run here. An FMU that a server identifies only by its GUID has no file.
    """
    nowhere = "write the path of a file, or proxyfmu://localhost?file=PATH"
    try:
        parts = urlsplit(uri.replace("\\", "/"))
        path = unquote(parts.path, errors="strict")
    except (ValueError, UnicodeDecodeError):
        return f"is not a URI; {nowhere}", None, ""
    note = ""
    if parts.scheme in ("proxyfmu", "proxy-fmu"):
        found = dict(parse_qsl(parts.query)).get("file")
        if not found:
            return f"names no file (?file=PATH); {nowhere}", None, ""
        path, note = found.removeprefix("file:///"), f"{uri}: the FMU is run here, in this process, not by proxyfmu"
    elif parts.scheme not in ("", "file"):
        return f'has the scheme "{parts.scheme}"; {nowhere}', None, ""
    if not path:
        return f"is empty; {nowhere}", None, ""
    trouble, found_file = Files().resolved(base, Target(path, None))
    return trouble, None if trouble else found_file, note


def parsed(file: File) -> etree._Element:
    """Returns the root element of an XML file.

    Raises:
        SystemDescriptionError: the file cannot be read, is too large or is not well-formed.
    """
    if file.member:
        data = archive.read_member(file.path, file.member, file.shown, limit=_MAX_DOCUMENT_BYTES)
        if data is None:
            raise SystemDescriptionError([Problem(Where(file.shown), "no such file in the archive")])
        return parse(data, file.shown)
    try:
        if file.path.stat().st_size > _MAX_DOCUMENT_BYTES:
            raise SystemDescriptionError([Problem(Where(file.shown), LARGE_DOCUMENT.text(_MAX_DOCUMENT_BYTES))])
        data = file.path.read_bytes()
    except OSError as error:
        raise SystemDescriptionError([Problem(Where(file.shown), f"cannot be read: {error.strerror}")]) from error
    return parse(data, file.shown)
