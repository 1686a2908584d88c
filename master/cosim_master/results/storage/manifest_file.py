"""manifest.json in a run's folder: written as a whole, and updated in place during the run."""

from __future__ import annotations

import json
from collections import ChainMap
from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any

__all__ = ["CAMPAIGN", "NAME", "UNWRITTEN", "RunningManifest", "no_run", "write_manifest"]

NAME = "manifest.json"
CAMPAIGN = "study.json"
"""The file that a campaign has in its folder instead."""
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
    elif (folder / CAMPAIGN).is_file():
        reason = f"it holds a campaign; try uav-cosim report {folder}"
    else:
        reason = f"it has no {missing} (`uav-cosim run -o` writes it)"
    return f"not the folder of a run: {reason}"


def write_manifest(folder: Path, content: Mapping[str, Any]) -> None:
    """Writes the manifest. An earlier one is replaced only when the new one is complete."""
    _replace(folder, _pieces(content, {}))


def _pieces(
    content: Mapping[str, Any], places: dict[str, tuple[int, int]], changing: Collection[str] = ()
) -> Iterator[bytes]:
    """Yields the manifest as JSON, whose first levels are divided into lines.

    In pieces, because the text of some thousand drones takes several times as much memory as their values.

    Args:
        places: receives the place of each of the values `changing`, and its number of characters.
    """
    text, written, before = _Text(), 0, "{"
    for name, value in content.items():
        head = _bytes(f"{before}\n {_json(name)}: ")
        before = ","
        if name in changing:
            room = _room(value)
            places[name] = (written + len(head), room)
            pieces: Iterable[str] = [f"{json.dumps(value):<{room}}"]
        else:
            pieces = text.entries(value)
        for piece in chain([head], map(_bytes, pieces)):
            written += len(piece)
            yield piece
    yield b"\n}\n"


class _Text:
    """The text of the values of one manifest."""

    def __init__(self) -> None:
        self._layers: dict[int, dict[str, str]] = {}
        """The entries of the last layer of each `ChainMap`, by its id."""

    def entries(self, value: Any) -> Iterator[str]:
        """Yields a value of the manifest entry by entry."""
        if not value or not isinstance(value, (Mapping, list, tuple)):
            yield self._whole(value, 0, 1)
            return
        opening, closing = "{}" if isinstance(value, Mapping) else "[]"
        for entry in self._lines(value, _LINES - 2, 2):
            yield f"{opening}\n  {entry}"
            opening = ","
        yield f"\n {closing}"

    def _lines(self, value: Any, levels: int, indent: int) -> Iterator[str]:
        """Yields the entries of a mapping or a list, with so many levels of each divided into lines."""
        if isinstance(value, Mapping):
            return (f"{_json(str(name))}: {self._whole(one, levels, indent)}" for name, one in value.items())
        return (self._whole(one, levels, indent) for one in value)

    def _whole(self, value: Any, levels: int, indent: int) -> str:
        """Returns the text of a value with so many levels divided into lines."""
        if levels and value and isinstance(value, (Mapping, list, tuple)):
            opening, closing = "{}" if isinstance(value, Mapping) else "[]"
            between = f"\n{' ' * (indent + 1)}"
            lines = f",{between}".join(self._lines(value, levels - 1, indent + 1))
            return f"{opening}{between}{lines}\n{' ' * indent}{closing}"
        return self._layered(value) if isinstance(value, ChainMap) else _json(value)

    def _layered(self, value: ChainMap[str, Any]) -> str:
        """Returns the text of a mapping in layers; that of the last one, which others share, is made once."""
        *own, shared = value.maps
        if id(shared) not in self._layers:
            self._layers[id(shared)] = _by_name(shared)
        entries = self._layers[id(shared)].copy()
        for layer in reversed(own):
            entries |= _by_name(layer)
        return f"{{{', '.join(entries.values())}}}"


def _by_name(values: Mapping[str, Any]) -> dict[str, str]:
    """Returns the text of each entry of a mapping."""
    return {name: f"{_json(name)}: {_json(value)}" for name, value in values.items()}


_encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
"""Returns a value as JSON in one line. One encoder for all, since each takes as long as a short value."""


def _json(value: Any) -> str:
    """Returns a value as JSON in one line; of a plain number, which most are, in a tenth of the encoder's time."""
    kind = type(value)
    if kind is int or (kind is float and isfinite(value)):
        return repr(value)
    return _encode(value)


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
        _replace(folder, _pieces(content, self._places, changing))
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
