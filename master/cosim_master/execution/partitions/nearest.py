"""The parts that packets and positions can concern if each node is heard by those nearest to it.

Who is nearest depends on the positions of all nodes. A part does not need all of them: if k nodes are certainly nearer
to a sender than all nodes of a box, the box does not hear it, wherever in their boxes its nodes are. The boxes are
those of `hearing.Promises`, with the number of nodes in each. A pair of boxes is *relevant* if a node of the second may
be among the nearest of a node of the first.

A part gets the exact positions of the boxes that are relevant for one of its own, in either direction, and, unless
nodes are counted along an axis, of all boxes whose nodes may be as near. All other nodes are taken to be in the middle
of their boxes: that changes the order of nodes that do not hear each other only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim_master.system.settings.network import Network

__all__ = ["Concerned", "Crowd", "concerned", "counts_nearest"]

_Array = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_SAFE = 1.0 + 1e-9
"""Rounding makes distances, and places along an axis, differ by less than this factor."""


@dataclass(frozen=True, slots=True)
class Crowd:
    """The nodes of a part, as other parts know them.

    Attributes:
        boxes: (boxes, 2, 3) least and greatest coordinates, m.
        group: of each node with a position, its box.
    """

    boxes: _Array
    group: NDArray[Any]

    @property
    def counts(self) -> NDArray[np.int64]:
        """The number of nodes in each box."""
        return np.bincount(self.group, minlength=len(self.boxes))

    @property
    def middles(self) -> _Array:
        """The middle of the box of each node, (nodes, 3), m."""
        return np.asarray((0.5 * self.boxes[:, 0] + 0.5 * self.boxes[:, 1])[self.group])


@dataclass(frozen=True, slots=True)
class Concerned:
    """The parts that the boxes of one part concern.

    Attributes:
        heard: (boxes, parts) whether a node of the part may hear a node of the box.
        seen: (boxes, parts) whether the part needs the positions of the box.
    """

    heard: _Mask
    seen: _Mask


def counts_nearest(network: Network) -> bool:
    """Returns whether packets go only to parts that may have one of the nodes nearest to their sender.

    With a medium, packets occupy it wherever they are sent.
    """
    return network.topology == "nearest" and network.medium == "none"


def concerned(network: Network, crowds: Sequence[Crowd], part: int) -> Concerned:
    """Returns the parts that the boxes of a part concern.

    Args:
        crowds: of all parts.
    """
    boxes = np.concatenate([one.boxes for one in crowds])
    counts = np.concatenate([one.counts for one in crowds])
    of = np.repeat(np.arange(len(crowds)), [len(one.boxes) for one in crowds])
    with np.errstate(invalid="ignore", over="ignore"):
        if network.axis is not None:
            relevant = _along(boxes, counts, np.array(network.axis), network.neighbours)
            near = np.zeros_like(relevant)
        else:
            least, most = _distances(boxes)
            near = relevant = least <= _bounds(most, counts, network.neighbours)[:, None]
    member = of[:, None] == np.arange(len(crowds))
    to, by = _any_of(relevant, member), _any_of(relevant.T, member)  # (boxes, parts) relevant for a box of the part
    pairs = member & np.asarray(relevant.any(axis=1))[:, None] | to
    needed = pairs | member & np.asarray(relevant.any(axis=0))[:, None] | by
    if near.any():
        needed |= _any_of(near.T, pairs)
    own = of == part
    return Concerned(to[own], needed[own])


def _any_of(one: _Mask, other: _Mask) -> _Mask:
    """Returns the product of two matrices of truth values: whether a term of the sum is true."""
    return np.asarray(one.astype(np.float32) @ other.astype(np.float32) > 0.0)


def _along(boxes: _Array, counts: NDArray[np.int64], axis: _Array, nearest: int) -> _Mask:
    """Returns which pairs of boxes have fewer than `nearest` nodes that are certainly between them on an axis."""
    ends = boxes * axis
    slack = (_SAFE - 1.0) * (1.0 + np.abs(ends).max(axis=1).sum(axis=1))
    low, high = ends.min(axis=1).sum(axis=1) - slack, ends.max(axis=1).sum(axis=1) + slack
    before = high[:, None] < low[None, :]  # nothing is before or after what is not a number
    between = before.astype(float) * counts @ before.astype(float)
    apart = before & (between >= nearest)
    return np.asarray(~(apart | apart.T))


def _distances(boxes: _Array) -> tuple[_Array, _Array]:
    """Returns least and greatest distances of the nodes in pairs of boxes, m."""
    low, high = boxes[:, 0], boxes[:, 1]
    apart = np.maximum(np.maximum(low[None] - high[:, None], low[:, None] - high[None]), 0.0)
    reach = np.maximum(high[None] - low[:, None], high[:, None] - low[None])
    least, most = np.sqrt((apart**2).sum(axis=2)), np.sqrt((reach**2).sum(axis=2))
    return np.where(np.isfinite(most), least, 0.0), np.where(np.isfinite(most), most, np.inf)


def _bounds(most: _Array, counts: NDArray[np.int64], nearest: int) -> _Array:
    """Returns, for each box, a distance [m] within which its nodes certainly have as many others; infinity if none."""
    found = np.full(len(most), np.inf)
    for a in range(len(most)):
        order = np.argsort(most[a], kind="stable")
        others = counts - (np.arange(len(counts)) == a)  # a sender does not hear itself
        at = int(np.searchsorted(np.cumsum(others[order]), nearest))
        if at < len(order):
            found[a] = most[a, order[at]] * _SAFE
    return found
