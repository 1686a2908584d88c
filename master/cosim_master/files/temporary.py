"""Temporary folders of this process, removed before a crash ends it, or by a later process if it was killed.

While a process has folders, it holds a lock on a file beside them, whose name begins like theirs:

    uav-cosim-TOKEN.lock, uav-cosim-TOKEN-NAME/

The system releases the lock of a process however it ends. The first folder of a process is the occasion to remove those
of processes that have ended; only files and folders of the same user are touched.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ["made", "remove", "remove_all"]

_PREFIX, _SUFFIX = "uav-cosim-", ".lock"
_FOLDERS: dict[Path, int] = {}
_LOCKS: dict[int, tuple[int, Path]] = {}
"""The descriptor and the file of the lock of a process, while it has folders; also of its parents."""


def made() -> Path:
    """Returns a new empty folder that only this user can read; `remove` must follow."""
    process = os.getpid()
    if process not in _LOCKS:
        _remove_abandoned()
        _lock()
    prefix = f"{_LOCKS[process][1].name.removesuffix(_SUFFIX)}-" if process in _LOCKS else _PREFIX
    folder = Path(tempfile.mkdtemp(prefix=prefix))
    _FOLDERS[folder] = process
    return folder


def remove(folder: Path) -> None:
    """Removes a folder that `made` has returned, with its contents."""
    shutil.rmtree(folder, ignore_errors=True)
    _FOLDERS.pop(folder, None)
    if os.getpid() not in _FOLDERS.values():
        _unlock()


def remove_all() -> None:
    """Removes all folders that this process has made, not those of its parent."""
    for folder in [folder for folder, process in _FOLDERS.items() if process == os.getpid()]:
        remove(folder)


def _lock() -> None:
    """Takes the lock of this process, unless the system has none."""
    if fcntl is None:
        return
    descriptor, name = tempfile.mkstemp(prefix=_PREFIX, suffix=_SUFFIX)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        Path(name).stat()  # another process may have taken it for abandoned before it was locked
    except OSError:
        os.close(descriptor)
        Path(name).unlink(missing_ok=True)
        return
    _LOCKS[os.getpid()] = descriptor, Path(name)


def _unlock() -> None:
    """Gives the lock of this process up."""
    if (held := _LOCKS.pop(os.getpid(), None)) is not None:
        held[1].unlink(missing_ok=True)
        os.close(held[0])


def _remove_abandoned() -> None:
    """Removes the folders of processes of this user that have ended without doing so."""
    if fcntl is None:
        return
    place = Path(tempfile.gettempdir())
    with suppress(OSError):
        for file in place.iterdir():  # not by a pattern, which takes 2 ms for a thousand files of others
            if file.name.startswith(_PREFIX) and file.name.endswith(_SUFFIX):
                with suppress(OSError):
                    _remove_if_abandoned(file)


def _remove_if_abandoned(file: Path) -> None:
    descriptor = os.open(file, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if os.fstat(descriptor).st_uid != os.getuid():
            return
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for folder in file.parent.glob(f"{file.name.removesuffix(_SUFFIX)}-*"):
            if folder.lstat().st_uid == os.getuid() and folder.is_dir() and not folder.is_symlink():
                shutil.rmtree(folder, ignore_errors=True)
        file.unlink(missing_ok=True)
    finally:
        os.close(descriptor)
