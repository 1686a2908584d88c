"""manifest.json in a run's folder: written as a whole, and updated in place during the run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["NAME", "RunningManifest", "write_manifest"]

NAME = "manifest.json"
_OUTCOME, _NUMBER, _COUNT = 16, 25, 20
"""Characters that an outcome, a number and a count take at most."""
_LINES = 3
"""Levels of the manifest that are divided into lines. Python writes the others six times as fast: 1,000 drones have a
million of values."""


def write_manifest(folder: Path, content: Mapping[str, Any]) -> None:
    """Writes the manifest. An earlier one is replaced only when the new one is complete."""
    _replace(folder, _text(content, _LINES) + "\n")


def _text(value: Any, levels: int) -> str:
    """Returns a value as JSON, with so many levels divided into lines."""
    if levels and value and isinstance(value, (Mapping, list, tuple)):
        opening, closing = "{}" if isinstance(value, Mapping) else "[]"
        if isinstance(value, Mapping):
            lines = [f"{_text(str(name), 0)}: {_text(one, levels - 1)}" for name, one in value.items()]
        else:
            lines = [_text(one, levels - 1) for one in value]
        content = ",\n".join(lines).replace("\n", "\n ")
        return f"{opening}\n {content}\n{closing}"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _replace(folder: Path, text: str) -> None:
    part = folder / f"{NAME}.part"
    try:
        part.write_text(text, encoding="utf-8", errors="backslashreplace")  # half characters, as JSON escapes them
        part.replace(folder / NAME)
    except OSError:
        part.unlink(missing_ok=True)
        raise


class RunningManifest:
    """The manifest of a run in progress.

    Values that change are padded with spaces, so that an update overwrites a few bytes of the file. It does not need
    free space on the disk, and its cost does not depend on the length of the manifest.

    Args:
        content: the manifest as it is at the start; `changing` are those of its keys that change.
    """

    def __init__(self, folder: Path, content: Mapping[str, Any], *changing: str) -> None:
        text = "{"
        self._places: dict[str, tuple[int, int]] = {}
        for name, value in content.items():
            text += f"{',' if len(text) > 1 else ''}\n {json.dumps(name)}: "
            if name in changing:
                room = _room(value)
                self._places[name] = (len(text.encode()), room)
                text += f"{json.dumps(value):<{room}}"
            else:
                text += _text(value, _LINES - 1).replace("\n", "\n ")
        _replace(folder, text + "\n}\n")
        self._file = (folder / NAME).open("r+b", buffering=0)

    def update(self, values: Mapping[str, Any]) -> None:
        """Writes the current values.

        Raises:
            OSError: the file cannot be written.
        """
        for name, value in values.items():
            place, room = self._places[name]
            text = f"{json.dumps(value):<{room}}"
            assert len(text) == room, text
            self._file.seek(place)
            self._file.write(text.encode())

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def _room(value: Any) -> int:
    """Returns the number of characters of the longest value of this kind."""
    if isinstance(value, Mapping):
        return len(json.dumps(dict.fromkeys(value, 10**_COUNT)))
    return _OUTCOME if isinstance(value, str) else _NUMBER
