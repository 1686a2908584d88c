"""Files that are written as a whole, or not at all."""

from __future__ import annotations

from pathlib import Path

__all__ = ["write_whole"]


def write_whole(file: Path, data: bytes) -> None:
    """Writes a file and the folders above it. If there is no room for it, as on a full disk, no part of it is left.

    Raises:
        OSError: it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    opened = file.open("wb")  # outside: a file that cannot be opened is left as it is
    try:
        with opened:
            opened.write(data)
    except OSError:
        if file.is_file():  # not a device, or a pipe
            file.unlink()
        raise
