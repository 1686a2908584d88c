"""Packs typed arrays into one compressed block, which the page unpacks (page/src/data.js).

An array is stored as the first bytes of all numbers, then their second bytes, and so on. The high bytes of neighbouring
numbers are similar and therefore compress better together.
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
    """Collects arrays: `add` each of them, then read `text`."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Array, kind: str) -> Place:
        """Adds an array, whose values must fit into the type, and returns its position in the block."""
        if kind not in _TYPES:
            raise ValueError(f"{kind}: the page reads {', '.join(_TYPES)}")
        if kind.startswith("u") and values.size and values.min() < 0:
            raise ValueError(f"{kind}: {values.min()} is negative")
        array = np.ascontiguousarray(values, dtype=f"<{kind}").reshape(-1)
        place = (self._size, kind, len(array))
        part = array.view(np.uint8).reshape(len(array), array.itemsize).T.tobytes()
        self._parts.append(part)
        self._size += len(part)
        return place

    def text(self) -> str:
        """Returns all arrays as one compressed text."""
        return compressed(b"".join(self._parts))


def compressed(data: bytes) -> str:
    """Returns bytes that are deflated (RFC 1950) and encoded as base64."""
    return b64encode(zlib.compress(data, 6)).decode("ascii")


def steps_between(ticks: Array) -> Array:
    """Returns the first of ascending numbers, then the difference of each number to the previous one."""
    return np.diff(ticks, prepend=0)
