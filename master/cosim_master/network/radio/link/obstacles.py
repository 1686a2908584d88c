"""Obstacles in the way of radio signals: boxes with sides to the north and east, and upright cylinders.

A row of `Radio.obstacles` has these columns: 1 for a cylinder, else 0; centre (north, east); half the extents to the
north and east, or the radius of a cylinder; its top and bottom (down); the loss [dB] of a signal that passes
through it, and the loss per metre inside it [dB/m]. Lengths are in m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.tables import Radio

__all__ = ["loss_behind"]


@kernel
def _disc(r: Radio, j: int, north: float, east: float, to_north: float, to_east: float) -> tuple[float, float]:
    """Returns the parts of a path at which it enters and leaves an upright cylinder of infinite height.

    `north`, `east`: the beginning of the path; `to_north`, `to_east`: its extents.
    """
    p, q, radius = north - r.obstacles[j, 1], east - r.obstacles[j, 2], r.obstacles[j, 3]
    a, b, c = to_north * to_north + to_east * to_east, p * to_north + q * to_east, p * p + q * q - radius * radius
    if a == 0.0:
        return (0.0, 1.0) if c < 0.0 else (1.0, 0.0)
    root = b * b - a * c
    if root <= 0.0:
        return 1.0, 0.0
    return (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a


@kernel
def _between(start: float, extent: float, low: float, high: float) -> tuple[float, float]:
    """Returns the parts of a path at which one coordinate, `start` + part * `extent`, comes into and out of a range."""
    if extent == 0.0:
        return (0.0, 1.0) if low < start < high else (1.0, 0.0)
    first, last = (low - start) / extent, (high - start) / extent
    return min(first, last), max(first, last)


@kernel
def _part_inside(r: Radio, reals: NDArray[np.float64], j: int, a: int, b: int) -> float:
    """Returns the part of the straight path from node `a` to node `b` that is in obstacle `j`."""
    o = r.obstacles
    north, east, down = (reals[r.nodes[a].place[0]], reals[r.nodes[a].place[1]], reals[r.nodes[a].place[2]])
    to_north = reals[r.nodes[b].place[0]] - north
    to_east = reals[r.nodes[b].place[1]] - east
    first, last = _between(down, reals[r.nodes[b].place[2]] - down, o[j, 5], o[j, 6])
    if o[j, 0] != 0.0:
        enters, leaves = _disc(r, j, north, east, to_north, to_east)
    else:
        enters, leaves = _between(north, to_north, o[j, 1] - o[j, 3], o[j, 1] + o[j, 3])
        first, last = max(first, enters), min(last, leaves)
        enters, leaves = _between(east, to_east, o[j, 2] - o[j, 4], o[j, 2] + o[j, 4])
    first, last = max(first, enters), min(last, leaves)
    return max(0.0, min(last, 1.0) - max(first, 0.0))


@kernel
def loss_behind(r: Radio, reals: NDArray[np.float64], a: int, b: int, distance: float) -> float:
    """Returns the loss [dB] of the obstacles between nodes `a` and `b`, which are `distance` apart."""
    total = 0.0
    for j in range(r.obstacles.shape[0]):
        part = _part_inside(r, reals, j, a, b)
        if part > 0.0:
            total += r.obstacles[j, 7] + r.obstacles[j, 8] * part * distance
    return total
