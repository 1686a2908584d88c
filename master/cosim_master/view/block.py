"""Typed arrays as one compressed block, which the page takes apart again (page/src/data.js).

The bytes of an array lie there as all first bytes, then all second bytes, ...: the high bytes of neighbouring numbers
are alike, so that they compress better.
"""

from __future__ import annotations

import zlib
from base64 import b64encode
from typing import Any, TypeAlias

import numpy as np

__all__ = ["Array", "Block", "Place", "compressed", "steps_between"]

Array: TypeAlias = np.ndarray[Any, Any]
Place: TypeAlias = tuple[int, str, int]
"""Offset in bytes, type (numpy's, without the byte order) and number of elements."""

_TYPES = ("f4", "f8", "u1", "u2", "u4", "i2", "i4")


class Block:
    """Collects arrays: `add` each of them, then ask for the `text`."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Array, kind: str) -> Place:
        """Adds an array, whose values must fit into the type, and returns its place."""
        if kind not in _TYPES:
            raise ValueError(f"{kind}: the page reads {', '.join(_TYPES)}")
        array = np.ascontiguousarray(values, dtype=f"<{kind}").reshape(-1)
        place = (self._size, kind, len(array))
        part = array.view(np.uint8).reshape(len(array), array.itemsize).T.tobytes()
        self._parts.append(part)
        self._size += len(part)
        return place

    def text(self) -> str:
        """Returns all of them, compressed."""
        return compressed(b"".join(self._parts))


def compressed(data: bytes) -> str:
    """Returns bytes deflated (RFC 1950) and as base64."""
    return b64encode(zlib.compress(data, 6)).decode("ascii")


def steps_between(ticks: Array) -> Array:
    """Returns the first of ascending numbers, then the difference of each to the one before."""
    return np.diff(ticks, prepend=0)
