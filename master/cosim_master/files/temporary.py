"""Temporary folders of this process, which can all be removed before a crash ends it."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

__all__ = ["made", "remove", "remove_all"]

_FOLDERS: dict[Path, int] = {}


def made(prefix: str = "uav-cosim-") -> Path:
    """Returns a new empty folder that only this user can read; `remove` must follow."""
    folder = Path(tempfile.mkdtemp(prefix=prefix))
    _FOLDERS[folder] = os.getpid()
    return folder


def remove(folder: Path) -> None:
    """Removes a folder that `made` has returned, with its contents."""
    _FOLDERS.pop(folder, None)
    shutil.rmtree(folder, ignore_errors=True)


def remove_all() -> None:
    """Removes all folders that this process has made, not those of its parent."""
    for folder in [folder for folder, process in _FOLDERS.items() if process == os.getpid()]:
        remove(folder)
