"""Prepares every recorded signal for the page's plots; signals with more points than a plot can show are thinned out.

Real signals are divided into many short intervals, and the least and the greatest value of each interval are kept, so
that no peak is lost. For discrete signals, the changes are kept. Every point kept is a recorded one.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.results.storage.arrays import values_of
from cosim_master.view.block import Array, Block, steps_between

__all__ = ["Curves", "thinned"]

_POINTS = 3_000_000
_LEAST, _MOST = 40, 6000


class Curves:
    """Collects the recorded columns: `take` them one after the other; `document` then returns them for the page."""

    def __init__(self, fields: Sequence[pa.Field], block: Block) -> None:
        self._block = block
        self._points = min(_MOST, max(_LEAST, _POINTS // max(1, len(fields))))
        self.document: list[dict[str, Any]] = []
        self.all_kept = True

    def take(self, field: pa.Field, column: pa.ChunkedArray) -> None:
        """Adds a column."""
        metadata = {key.decode(): value.decode("utf-8", "replace") for key, value in (field.metadata or {}).items()}
        told: dict[str, Any] = {"name": field.name, "unit": metadata.get("unit", "")}
        if metadata.get("description"):
            told["description"] = metadata["description"]
        if "items" in metadata:
            told["items"] = list(json.loads(metadata["items"]).items())
        kind = field.type
        if pa.types.is_string(kind):
            coded = column.combine_chunks().dictionary_encode()
            told |= {"texts": coded.dictionary.to_pylist(), "discrete": True}
            self._add(told, values_of(coded.indices).astype(np.int64), "i4")
        elif pa.types.is_floating(kind):
            self._add(told, values_of(column), "f4")
        else:
            if pa.types.is_boolean(kind):
                told["boolean"] = True
            values = values_of(column)
            small = not len(values) or (values.min() >= -(2**31) and values.max() < 2**31)
            told["discrete"] = True
            self._add(told, values, "i4" if small else "f8")

    def _add(self, told: dict[str, Any], values: Array, kind: str) -> None:
        rows = thinned(values, self._points, discrete="discrete" in told)
        kept = values[rows]
        self.all_kept &= len(rows) <= 1 or len(rows) == len(values) or "discrete" in told
        if kind == "f4":
            finite = kept[np.isfinite(kept)]
            least, most = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
            told["spread"] = min(most - least, 1e300)
            if told["spread"] < 1e38:
                told["origin"] = float(finite[0]) if len(finite) else 0.0
                kept = kept - told["origin"]
            else:
                kind = "f8"
        if len(rows) != 1 or rows[0] != 0:
            told["rows"] = self._block.add(steps_between(rows), "u4")
        told["values"] = self._block.add(kept, kind)
        self.document.append(told)


def thinned(values: Array, points: int, *, discrete: bool) -> Array:
    """Returns the rows of a column to keep, in ascending order: at most about `points`, and one for a constant."""
    n = len(values)
    if n == 0:
        return np.empty(0, np.int64)
    same = values[1:] == values[:-1]
    if not discrete:
        same |= np.isnan(values[1:]) & np.isnan(values[:-1])
    changed = np.flatnonzero(~same) + 1
    if len(changed) == 0:
        return np.zeros(1, np.int64)
    if discrete and len(changed) <= 4 * points:
        return np.append(0, changed)
    if n <= points:
        return np.arange(n)
    size = -(-n // (points // 2))
    whole = n - n % size
    numbers = values if discrete else np.where(np.isnan(values), -np.inf, values)
    blocks = numbers[:whole].reshape(-1, size)
    begins = np.arange(0, whole, size)
    kept = [np.array([0, n - 1]), begins + blocks.argmin(1), begins + blocks.argmax(1)]
    if whole < n:
        kept.append(whole + np.array([numbers[whole:].argmin(), numbers[whole:].argmax()]))
    if not discrete:
        gaps = np.flatnonzero(np.isnan(values[1:]) != np.isnan(values[:-1]))
        kept += [gaps, gaps + 1]
    return np.unique(np.concatenate(kept))
