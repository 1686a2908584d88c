"""A grid of square cells by which each vehicle finds those near it, in a time that grows linearly with their number.

Cells are hashed into the lists of `m.head`, whose number is a power of two. A list has its vehicles in the order of
their numbers, so that sums over neighbours are the same in every run.
"""

from __future__ import annotations

from math import floor
from typing import Any

import numpy as np

from cosim.kernel import kernel

__all__ = ["fill", "first_in", "next_in"]

_LARGEST = 1e6  # cells from the origin; places beyond share the outermost cell


@kernel
def _cell(x: float, size: float) -> int:
    return floor(min(max(x / size, -_LARGEST), _LARGEST))


@kernel
def _list_of(m: Any, north: int, east: int) -> int:
    return int((np.int64(north) * 73856093 ^ np.int64(east) * 19349663) & (len(m.head) - 1))


@kernel
def fill(m: Any, size: float) -> None:
    """Sorts the first m.count vehicles into cells of `size` [m] by their horizontal positions."""
    for i in range(len(m.head)):
        m.head[i] = -1
    for i in range(m.count - 1, -1, -1):
        m.cell_north[i] = _cell(m.position[3 * i], size)
        m.cell_east[i] = _cell(m.position[3 * i + 1], size)
        place = _list_of(m, m.cell_north[i], m.cell_east[i])
        m.next[i] = m.head[place]
        m.head[place] = i


@kernel
def _in_cell(m: Any, i: int, north: int, east: int) -> int:
    while i >= 0 and (m.cell_north[i] != north or m.cell_east[i] != east):
        i = m.next[i]
    return i


@kernel
def first_in(m: Any, north: int, east: int) -> int:
    """Returns the first vehicle in a cell, or -1."""
    return _in_cell(m, int(m.head[_list_of(m, north, east)]), north, east)


@kernel
def next_in(m: Any, i: int, north: int, east: int) -> int:
    """Returns the vehicle after `i` in a cell, or -1."""
    return _in_cell(m, int(m.next[i]), north, east)
