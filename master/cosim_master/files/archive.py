"""ZIP archives from untrusted sources (.ssp, .fmu): read a member, unpack all members, pack a folder.

Some archives are refused, each with its own message: names that lead out of the folder (zip slip), absolute names,
backslashes, links, encrypted entries, one name for several files, compression other than stored and deflated (SSP 2.0,
section 3), and archives that unpack to more than `MAX_BYTES` or `MAX_ENTRIES`. This module does not interpret the
members.
"""

from __future__ import annotations

import shutil
import stat
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ARCHIVE, COMPRESSION, ENCRYPTED, ENTRIES, LARGE_DESCRIPTION, LINK
from cosim_master.files.whole import replacing

__all__ = ["MAX_BYTES", "MAX_ENTRIES", "member_names", "pack", "read_member", "unpack"]

MAX_BYTES = 2 << 30
MAX_ENTRIES = 50_000

_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError)


def _refuse(shown: str, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(shown), message)])


def _entry_problem(entry: zipfile.ZipInfo) -> str | None:
    name = entry.filename
    if entry.flag_bits & 0x1:
        return ENCRYPTED.text(name)
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return COMPRESSION.text(name, entry.compress_type)
    if "\\" in entry.orig_filename or "\0" in entry.orig_filename:
        return f'entry "{name}" has a backslash or a NUL in its name; folders are separated by "/"'
    pure = PurePosixPath(name)
    if pure.is_absolute() or ".." in pure.parts or ":" in name.split("/")[0]:
        return f'entry "{name}" would be written outside of the folder'
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return LINK.text(name)
    return None


def _ambiguous(entries: Sequence[zipfile.ZipInfo]) -> list[str]:
    """Returns names that stand for several files, of which different readers would choose different ones."""
    first: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        first.setdefault(entry.filename, entry)
    different = {entry.filename for entry in entries if entry.CRC != first[entry.filename].CRC}
    return [f'entry "{name}" is there twice, with different contents' for name in sorted(different)]


@contextmanager
def _opened(path: Path, shown: str) -> Iterator[zipfile.ZipFile]:
    if not path.is_file():
        raise _refuse(shown, "no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            problems = [Problem(Where(shown), text) for text in map(_entry_problem, entries) if text is not None]
            if len(entries) > MAX_ENTRIES:
                problems.append(Problem(Where(shown), ENTRIES.text(MAX_ENTRIES)))
            problems += [Problem(Where(shown), text) for text in _ambiguous(entries)]
            if sum(entry.file_size for entry in entries) > MAX_BYTES:
                problems.append(Problem(Where(shown), ARCHIVE.text(MAX_BYTES)))
            if problems:
                raise SystemDescriptionError(problems)
            yield archive
    except _BROKEN as error:
        raise _refuse(shown, f"not a readable ZIP archive ({error})") from error


def member_names(path: Path, shown: str) -> tuple[str, ...]:
    """Returns the names of all files in the archive at `path`.

    Raises:
        SystemDescriptionError: the file is not a ZIP archive, or the archive is refused (reported at `shown`).
    """
    with _opened(path, shown) as archive:
        return tuple(entry.filename for entry in archive.infolist() if not entry.is_dir())


def read_member(path: Path, name: str, shown: str, *, limit: int) -> bytes | None:
    """Returns the content of the file `name` in the archive, or None if it does not exist.

    Raises:
        SystemDescriptionError: the file is not a ZIP archive, the archive is refused, or the member is larger than
            `limit` bytes.
    """
    with _opened(path, shown) as archive:
        if name not in archive.NameToInfo:
            return None
        with archive.open(name) as member:
            data = member.read(limit + 1)
        if len(data) > limit:
            raise _refuse(shown, LARGE_DESCRIPTION.text(name, limit))
        return data


def unpack(path: Path, directory: Path, shown: str, *, limit: int | None = None) -> int:
    """Writes every file of the archive into `directory`, which may exist.

    Args:
        limit: largest total size of the unpacked files in bytes; `MAX_BYTES` by default.

    Raises:
        SystemDescriptionError: the file is not a ZIP archive, the archive is refused, or there is no room for its
            files. The contents of `directory` are then not usable.

    Returns:
        The number of bytes written.
    """
    limit = MAX_BYTES if limit is None else limit
    with _opened(path, shown) as archive:
        try:
            return _unpack(archive, directory, shown, limit)
        except OSError as error:  # a full disk, a limit of file sizes
            raise _refuse(shown, f"cannot be unpacked to {directory}: {error.strerror or error}") from error


def _unpack(archive: zipfile.ZipFile, directory: Path, shown: str, limit: int) -> int:
    left = limit
    for entry in archive.infolist():
        target = directory.joinpath(*PurePosixPath(entry.filename).parts)
        if entry.is_dir():
            target.mkdir(parents=True, exist_ok=True)
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as source, target.open("wb") as sink:
            # The size in the directory of an archive may be wrong, so the bytes written are counted.
            while chunk := source.read(min(1 << 20, left + 1)):
                left -= len(chunk)
                if left < 0:
                    raise _refuse(shown, ARCHIVE.text(limit))
                sink.write(chunk)
        if entry.external_attr >> 16 & stat.S_IXUSR:
            target.chmod(0o755)
    return limit - left


def pack(files: Mapping[str, Path], path: Path) -> None:
    """Writes an archive of files by member name. Its bytes depend only on the names and contents."""
    with replacing(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            with files[name].open("rb") as source, archive.open(entry, "w", force_zip64=False) as sink:
                shutil.copyfileobj(source, sink)
