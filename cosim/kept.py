"""Code that is kept in a file for other processes, with a digest that is checked before it is loaded."""

from __future__ import annotations

import hashlib
import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["made_once", "read_kept", "write_kept"]

log = logging.getLogger(__name__)

_DIGEST_BYTES = hashlib.sha256().digest_size
_PATIENCE = 180.0
"""Seconds for which a process waits for code that another one makes, which may have been suspended."""


def write_kept(file: Path, code: bytes) -> None:
    """Writes code that other processes load, preceded by its digest (SHA-256).

    The file is complete or does not exist.

    Raises:
        OSError: the disk is full, or the folder is not writable.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}.{threading.get_ident()}.part")
    try:
        part.write_bytes(hashlib.sha256(code).digest() + code)
        part.replace(file)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def read_kept(file: Path) -> bytes | None:
    """Returns code that `write_kept` has written; None if there is none, or, with a note, if it was changed since."""
    try:
        content = file.read_bytes()
    except OSError:  # missing, or not readable by this user
        return None
    code = content[_DIGEST_BYTES:]
    if hashlib.sha256(code).digest() == content[:_DIGEST_BYTES]:
        return code
    log.warning("note: %s has been changed since it was made: its code is not loaded, but made anew", file)
    return None


@contextmanager
def made_once(file: Path) -> Iterator[None]:
    """Lets one process at a time make the code of `file`; the others wait, and should then look for it again.

    Waiting ends after three minutes, and there is none where files cannot be locked (Windows, some network drives).
    """
    lock = _locked(file.with_suffix(".lock"))
    try:
        yield
    finally:
        if lock is not None:
            file.with_suffix(".lock").unlink(missing_ok=True)
            os.close(lock)


def _locked(file: Path) -> int | None:
    """Returns the descriptor of a file that this process has locked, or None."""
    try:
        import fcntl

        file.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
    except (ImportError, OSError):  # Windows, disk full, or folder not writable
        return None
    end = time.monotonic() + _PATIENCE
    try:
        while time.monotonic() < end:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return lock
            except BlockingIOError:
                time.sleep(0.02)
    except OSError:  # no locks on this drive
        pass
    except BaseException:  # Ctrl-C
        os.close(lock)
        raise
    os.close(lock)
    return None
