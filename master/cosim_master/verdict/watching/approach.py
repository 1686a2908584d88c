"""Closest approaches of bodies: the nearest pair of a run, and all pairs nearer than a given distance.

Positions are known at instants. Between two instants, a body is assumed to move on a straight line at constant speed.
For instants dt apart and a relative acceleration a, the error of the distance is less than a dt^2 / 8: 1.3 cm for 10
m/s2 and 0.1 s.

If there are few bodies, all pairs are compared. If there are many, only those pairs are compared that can have come
closer than the closest pair so far: bodies are sorted into cells as wide as this distance plus their own motion, and
are compared with the bodies in adjacent cells. The cost grows with the number of bodies as that of sorting does. The
pairs found are kept with a margin, as in molecular dynamics (Verlet 1967), until bodies have moved so far apart from
each other that others can have come near.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any, TypeAlias

import numpy as np

__all__ = ["FEW", "Approach", "box", "closest", "pairs_within"]

Array: TypeAlias = np.ndarray[Any, Any]

FEW = 32
"""Largest number of bodies for which all pairs are compared."""
_PIECE = 1 << 15
"""Pairs that are processed at once."""
_MARGIN = 0.5
"""How much farther apart than necessary the bodies of kept pairs are at most, as a fraction."""
_FAR = 1 << 20
"""Largest number of cells from the middle to the outermost cell."""
_AROUND = [offset for offset in product((-1, 0, 1), repeat=3) if offset > (0, 0, 0)]
"""One of each two opposite neighbours of a cell."""


@dataclass(slots=True)
class Contact:
    """Two bodies within the contact distance: start of the contact [s], least distance [m] and its time [s]."""

    since: float
    distance: float
    time: float


@dataclass(slots=True)
class _Kept:
    """Pairs of bodies whose boxes were within `reach` [m] of each other: all others were farther apart.

    first, second: (pairs,) the bodies, in ascending order. middle, half: the boxes of all bodies at that time.
    wanted: the distance for which the pairs were looked up [m].
    """

    first: Array
    second: Array
    middle: Array
    half: Array
    reach: float
    wanted: float

    def hold(self, middle: Array, half: Array, reach: float) -> bool:
        """Returns whether all pairs whose boxes are now within `reach` are among these pairs."""
        moved = middle - self.middle
        apart = np.abs(moved - moved.mean(axis=0)).max(axis=1) + half - self.half
        return bool(2.0 * apart.max() <= self.reach - reach)


@dataclass(slots=True)
class Approach:
    """The closest pair of `count` bodies, and all pairs that come closer than `contact` [m].

    Of several pairs that come equally close, the first in ascending order counts.
    """

    count: int
    contact: float
    distance: float = np.inf
    pair: tuple[int, int] = (-1, -1)
    time: float = np.nan
    contacts: dict[tuple[int, int], Contact] = field(default_factory=dict)
    _kept: _Kept | None = None

    def look(self, times: Array, points: Array) -> None:
        """Follows the bodies over further instants.

        Args:
            times: (n,) s, rising.
            points: (n, bodies, 3) m.
        """
        if self.count < 2 or len(times) < 1:
            return
        if len(times) == 1:
            times, points = np.repeat(times, 2), np.repeat(points, 2, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):  # bodies farther away than a float can square
            first, second = self._candidates(points)
            for begin in range(0, len(first), _PIECE):
                self._compare(times, points, first[begin : begin + _PIECE], second[begin : begin + _PIECE])

    def _compare(self, times: Array, points: Array, first: Array, second: Array) -> None:
        distance, part = closest(points[:, first], points[:, second])
        distance[np.isnan(distance)] = np.inf
        least = distance.min(axis=0)
        p = int(least.argmin())
        if least[p] < self.distance:
            row = int(distance[:, p].argmin())
            self.distance = float(least[p])
            self.pair = int(first[p]), int(second[p])
            self.time = float(times[row] + part[row, p] * (times[row + 1] - times[row]))
        for p in map(int, np.flatnonzero(least < self.contact)):
            row = int(distance[:, p].argmin())
            self._touch(
                (int(first[p]), int(second[p])),
                float(times[int((distance[:, p] < self.contact).argmax())]),
                float(least[p]),
                float(times[row] + part[row, p] * (times[row + 1] - times[row])),
            )

    def _touch(self, pair: tuple[int, int], since: float, distance: float, time: float) -> None:
        known = self.contacts.setdefault(pair, Contact(since, distance, time))
        if distance < known.distance:
            known.distance, known.time = distance, time

    # ---- who can have come near whom -------------------------------------------------------------------------------

    def _candidates(self, points: Array) -> tuple[Array, Array]:
        """Returns pairs of bodies, the lower number first, each at most once, in ascending order."""
        if self.count <= FEW:
            return np.triu_indices(self.count, 1)
        middle, half = box(points)
        kept = self._kept
        reach = max(self.contact, min(self.distance, np.inf if kept is None else kept.wanted))
        if kept is None or not kept.hold(middle, half, reach):
            reach = max(self.contact, min(self.distance, _some_distance(points[0])))
            self._kept = kept = _pairs_to_keep(middle, half, reach)
        return _near(kept.first, kept.second, middle, half, reach)


def _pairs_to_keep(middle: Array, half: Array, wanted: float) -> _Kept:
    reach = (1.0 + _MARGIN) * wanted
    found = [*pairs_within(middle, half, reach)]
    first, second = (np.concatenate(some) for some in zip(*found, strict=True))
    order = np.lexsort((second, first))
    return _Kept(first[order], second[order], middle, half, reach, wanted)


def closest(first: Array, second: Array) -> tuple[Array, Array]:
    """Returns the least distances of pairs that move straight from each instant to the next, and where they are.

    Args:
        first, second: (n, pairs, 3) m.

    Returns:
        (n - 1, pairs) m, and (n - 1, pairs) fractions of the way from one instant to the next.
    """
    apart = first - second
    begin, moved = apart[:-1], np.diff(apart, axis=0)
    square, along = _product(moved, moved), -_product(begin, moved)
    part = np.clip(np.divide(along, square, out=np.zeros_like(square), where=square > 0.0), 0.0, 1.0)
    nearest = begin + part[:, :, None] * moved
    return np.sqrt(_product(nearest, nearest)), part


def _product(first: Array, second: Array) -> Array:
    """Returns the scalar products of vectors; the bits of each do not depend on the others, as those of einsum do."""
    product: Array = first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1] + first[..., 2] * second[..., 2]
    return product


def box(points: Array) -> tuple[Array, Array]:
    """Returns the middle (bodies, 3) and half the greatest extent (bodies,) of the motions (n, bodies, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return 0.5 * (low + high), 0.5 * (high - low).max(axis=1)


def pairs_within(middle: Array, half: Array, reach: float) -> Iterator[tuple[Array, Array]]:
    """Returns pairs of bodies whose boxes come within `reach` of each other: the lower number first, each pair once."""
    slow = half <= max(4.0 * float(np.median(half)), reach)
    numbers = np.flatnonzero(slow)
    for fast in map(int, np.flatnonzero(~slow)):  # few bodies, which would make the cells of all bodies wide
        others = np.flatnonzero(slow | (np.arange(len(middle)) > fast))
        yield _in_order(*_near(np.full(len(others), fast), others, middle, half, reach))
    for first, second in _in_cells(middle[numbers], reach + 2.0 * float(half[numbers].max(initial=0.0))):
        yield _in_order(*_near(numbers[first], numbers[second], middle, half, reach))


def _some_distance(points: Array) -> float:
    """Returns the distance of two bodies that are close to each other, but not necessarily the closest pair."""
    found = np.inf
    for axis in range(3):
        steps = np.diff(points[np.argsort(points[:, axis], kind="stable")], axis=0)
        found = min(found, float(np.sqrt((steps * steps).sum(axis=1).min())))
    return found


def _near(first: Array, second: Array, middle: Array, half: Array, reach: float) -> tuple[Array, Array]:
    """Returns the pairs whose boxes come within `reach` of each other."""
    gap = np.abs(middle[first] - middle[second]).max(axis=1) - half[first] - half[second]
    near = gap <= reach
    return first[near], second[near]


def _in_order(first: Array, second: Array) -> tuple[Array, Array]:
    return np.minimum(first, second), np.maximum(first, second)


def _in_cells(points: Array, width: float) -> Iterator[tuple[Array, Array]]:
    """Returns the pairs of points in one cell of this width, or in two adjacent cells."""
    if len(points) < 2:
        return
    scaled = (points - np.median(points, axis=0)) / max(width, 1e-9)
    cells = np.clip(np.floor(scaled), -_FAR, _FAR).astype(np.int64) + _FAR + 1
    factors = np.array([(2 * _FAR + 4) ** 2, 2 * _FAR + 4, 1], dtype=np.int64)
    keys = cells @ factors
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    ends = np.searchsorted(sorted_keys, sorted_keys, side="right")
    yield _pairs(order, np.arange(1, len(order) + 1), ends)
    for offset in _AROUND:
        wanted = sorted_keys + int(np.array(offset, dtype=np.int64) @ factors)
        yield _pairs(order, np.searchsorted(sorted_keys, wanted), np.searchsorted(sorted_keys, wanted, side="right"))


def _pairs(order: Array, begins: Array, ends: Array) -> tuple[Array, Array]:
    """Pairs point number n in `order` with the points from begins[n] to ends[n] - 1."""
    counts = ends - begins
    total = int(counts.sum())
    first = np.repeat(np.arange(len(order)), counts)
    within = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
    return order[first], order[begins[first] + within]
