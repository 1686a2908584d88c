"""Interpolation of columns of values over time, constant or linear between rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Column", "Table", "interpolated"]


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """The values of a column: doubles, 32-bit integers, or booleans; `held` until the next row, otherwise linear."""

    values: Any
    held: bool


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A table of values over time: ascending times of rows in s, and its columns in the order of value references."""

    times: Any
    columns: Mapping[str, Column]


def interpolated(rows: Any, values: Any, at: Any, *, held: bool, before: bool = False) -> Any:
    """Returns the values of a column at given times.

    Args:
        rows: times of its rows, ascending; of rows at the same time, the first one applies at that time, and the last
            one after it.
        values: the values of the rows, numbers or (if `held`) any objects.
        at: the times.
        held: a value is constant until the next row; otherwise values are interpolated linearly.
        before: at a row's time, return the value held until then.
    """
    last = len(rows) - 1
    i = np.clip(np.searchsorted(rows, at, side="left" if before else "right") - 1, 0, last)
    i = np.where(at <= rows[0], 0, i)
    if held:
        return values[i]
    after = np.minimum(i + 1, last)
    between = (rows[i] < at) & (i < last)
    span = np.where(between, rows[after] - rows[i], 1.0)
    weight = np.where(between, (rows[after] - at) / span, 1.0)
    with np.errstate(invalid="ignore"):
        mixed = weight * values[i] + (1.0 - weight) * values[after]
    return np.where(between, mixed, values[i])
