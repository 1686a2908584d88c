"""Files that are kept between runs and loaded as code: in a folder that only the user can write to, with digests.

    folder = private_cache() / "sources"           refused if others can write to it
    seal(file)                                      writes file.sha256 beside it
    if intact(file): ...                            loads it

A digest finds damaged and replaced files; it is the folder that keeps other users away.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
import sys
import threading
import zipfile
from contextlib import suppress
from pathlib import Path, PurePosixPath

from cosim.kernel import cache_folder
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["intact", "intact_copy", "private_cache", "seal"]

log = logging.getLogger(__name__)

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def private_cache() -> Path:
    """Returns the user's cache folder, into which nobody else can write; it is made if it does not exist.

    Raises:
        SystemDescriptionError: it belongs to another user, or others can write to it.
        OSError: it cannot be made.
    """
    folder = cache_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform == "win32":
        return folder
    status = folder.stat()
    mode, own = stat.S_IMODE(status.st_mode), status.st_uid == os.geteuid()
    if own and mode & 0o077:
        folder.chmod(0o700)
    elif not own and (status.st_uid != 0 or mode & _OTHERS_WRITE):
        text = f"code is loaded from this folder, and user {status.st_uid} or others can write to it"
        fix = "set XDG_CACHE_HOME to a folder of your own, or remove it"
        raise SystemDescriptionError([Problem(Where(str(folder)), f"{text}; {fix}")])
    return folder


def seal(file: Path) -> None:
    """Writes the digest of a file beside it."""
    part = _digest_of(file).with_suffix(f".{os.getpid()}.{threading.get_ident()}.part")
    part.write_text(hashlib.sha256(file.read_bytes()).hexdigest(), encoding="ascii")
    part.replace(_digest_of(file))


def intact(file: Path) -> bool:
    """Returns whether a file is as it was sealed; if it has been changed since, a note says so."""
    try:
        content, digest = file.read_bytes(), _digest_of(file).read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return False
    if hashlib.sha256(content).hexdigest() == digest:
        return True
    log.warning("note: %s has been changed since it was made: it is made anew", file)
    return False


def intact_copy(archive: Path, folder: Path) -> bool:
    """Returns whether a folder has all files of an archive, unchanged; other files do not count."""
    with zipfile.ZipFile(archive) as content, suppress(OSError):
        for info in content.infolist():
            if info.is_dir():
                continue
            file = folder.joinpath(*PurePosixPath(info.filename).parts)
            if file.stat().st_size != info.file_size or file.read_bytes() != content.read(info):
                log.warning("note: %s differs from %s: the archive is unpacked anew", file, archive.name)
                return False
        return True
    return False


def _digest_of(file: Path) -> Path:
    return file.with_name(f"{file.name}.sha256")
