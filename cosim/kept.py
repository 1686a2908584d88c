"""Code that is kept in a file for other processes, with a digest that is checked before it is loaded."""

from __future__ import annotations

import hashlib
import logging
import os
import threading
from pathlib import Path

__all__ = ["read_kept", "write_kept"]

log = logging.getLogger(__name__)

_DIGEST_BYTES = hashlib.sha256().digest_size


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
