"""manifest.json in a run's folder: written as a whole, and updated in place during the run."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

__all__ = ["NAME", "UNWRITTEN", "RunningManifest", "no_run", "write_manifest"]

NAME = "manifest.json"
UNWRITTEN = "its results could not be written to their end, as on a full disk"
"""The error of a failed run whose manifest has none, since there was no room for it."""
_OUTCOME, _NUMBER, _COUNT = 16, 25, 20
"""Characters that an outcome, a number and a count take at most."""
_LINES = 3
"""Levels of the manifest that are divided into lines. Python writes the others six times as fast: 1,000 drones have a
million of values."""


def no_run(folder: Path, missing: str) -> str:
    """Returns why a folder is not that of a run, where it lacks a file that each run writes."""
    if not folder.is_dir():
        reason = "there is no such folder; a run prints its own at its end (results: out/line5)"
    elif (folder / "study.json").is_file():
        reason = f"it holds a campaign; try uav-cosim report {folder}"
    else:
        reason = f"it has no {missing} (`uav-cosim run -o` writes it)"
    return f"not the folder of a run: {reason}"


def write_manifest(folder: Path, content: Mapping[str, Any]) -> None:
    """Writes the manifest. An earlier one is replaced only when the new one is complete."""
    _replace(folder, (_bytes(text) for text in (*_text(content, _LINES), "\n")))


def _text(value: Any, levels: int, indent: int = 0) -> Iterator[str]:
    """Yields the pieces of a value as JSON, with so many levels divided into lines.

    In pieces, because the text of some thousand drones takes several times as much memory as their values.
    """
    if levels and value and isinstance(value, (Mapping, list, tuple)):
        named = isinstance(value, Mapping)
        opening, closing = "{}" if named else "[]"
        between = f"{opening}\n{' ' * (indent + 1)}"
        for one in value.items() if isinstance(value, Mapping) else value:
            yield f"{between}{_json(str(one[0]))}: " if named else between
            yield from _text(one[1] if named else one, levels - 1, indent + 1)
            between = f",\n{' ' * (indent + 1)}"
        yield f"\n{' ' * indent}{closing}"
    else:
        yield _json(value)


_json = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
"""Returns a value as JSON in one line. One encoder for all, since each takes as long as a short value."""


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", errors="backslashreplace")  # half characters, as JSON escapes them


def _replace(folder: Path, pieces: Iterable[bytes]) -> None:
    part = folder / f"{NAME}.part"
    try:
        with part.open("wb") as file:
            file.writelines(pieces)
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
        self._places: dict[str, tuple[int, int]] = {}
        _replace(folder, self._pieces(content, changing))
        self._file = (folder / NAME).open("r+b", buffering=0)

    def _pieces(self, content: Mapping[str, Any], changing: Collection[str]) -> Iterator[bytes]:
        """Yields the file piece by piece, and notes the places of the values that change."""
        written, before = 0, "{"
        for name, value in content.items():
            head = _bytes(f"{before}\n {json.dumps(name)}: ")
            before = ","
            if name in changing:
                room = _room(value)
                self._places[name] = (written + len(head), room)
                pieces = [f"{json.dumps(value):<{room}}"]
            else:
                pieces = [*_text(value, _LINES - 1, 1)]
            for piece in (head, *map(_bytes, pieces)):
                written += len(piece)
                yield piece
        yield _bytes("\n}\n")

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
