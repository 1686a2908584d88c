"""Files that are written as a whole: after an error, what was there before is still there, and nothing else."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cosim_master.diagnostics.errors import WriteFailed

__all__ = ["is_special", "named", "replacing", "write_whole", "writing"]

_OPEN = (Path("/dev/stdout"), Path("/dev/stderr"))


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yields the path of a part, to be written beside `file`, which takes its place at the end.

    After an exception, the part is removed and `file` is as it was. A new file has the mode of the one before. The
    target of a symbolic link is replaced, not the link. The part's name has the same end. Devices and pipes are not
    replaced, but yielded themselves.

    Raises:
        OSError: the part cannot be written, or `file` is a folder.
    """
    if is_special(file):
        yield file
        return
    target = file.resolve()
    part = target.with_name(f".{os.getpid()}.{threading.get_ident()}.part{target.suffix}")
    try:
        yield part
        if target.is_file():
            shutil.copymode(target, part)
        part.replace(target)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def write_whole(file: Path, data: bytes) -> None:
    """Writes a file and the folders above it, or nothing at all.

    Raises:
        OSError: it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as part:
        part.write_bytes(data)


def named(file: Path, suffix: str) -> Path:
    """Returns the name of a file with another suffix; of a folder without a name ("." or ".."), a file in it."""
    return file / f"NAME{suffix}" if file.name in ("", "..") else file.with_suffix(suffix)


def is_special(file: Path) -> bool:
    """Returns whether this is a device or a pipe, such as /dev/stdout."""
    if file in _OPEN or file.is_relative_to("/dev/fd"):  # also where it leads to a file
        return True
    return file.exists() and not file.is_file() and not file.is_dir()


@contextmanager
def writing(file: Path | str, what: str = "") -> Iterator[None]:
    """Turns an OSError into a WriteFailed for `file`, as the user named it, or for something within it ("the page")."""
    try:
        yield
    except OSError as error:
        raise WriteFailed(str(file), error.strerror or str(error), what) from error
