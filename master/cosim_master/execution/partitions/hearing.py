"""Who can hear whom, as far as a part knows it: what keeps packets from parts that cannot hear them.

A packet beyond the reach of a radio has no effect on its receivers but an entry of its loss. So a part keeps it from
another part all of whose nodes are out of reach, and makes these entries itself.

A part does not know where the nodes of another one are while its window lasts. Each part therefore gives all others, at
the end of each window, boxes that its nodes promise not to leave during the next two windows. A sender beyond the reach
of all boxes of a part is heard by none of its nodes. At the end of a window, a part compares its nodes with its
promises. If one was broken, it says so, and gets the packets that were kept from it before anybody steps on: a promise
too narrow costs a message, and never a packet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim_master.execution.partitions.nearest import Crowd
from cosim_master.system.settings.network import Network

__all__ = ["FAR", "NEAR", "Promise", "Promises", "carries_positions", "out_of_reach", "reach_of"]

_Array = NDArray[np.float64]

FAR = 1e30
"""The coordinates, m, of nodes that are out of reach: no reach is a tenth of it."""
NEAR = 10.0
"""A reach, m, for the promises of nodes of which the nearest hear each other."""
_SAFE = 1.0 + 1e-9
"""Rounding makes distances and signals differ by less than this factor."""
_DEVIATIONS = math.sqrt(2.0 * 53.0 * math.log(2.0))
"""The radio's random numbers have 53 bits: no normally distributed one is larger,"""
_GAIN = 10.0 * math.log10(53.0 * math.log(2.0))
"""and no fading makes a packet stronger, dB."""
_GROUPS = 8
"""Boxes of a part. A part that is a stripe of a grid needs one, other shapes more."""
_FASTER = 2.0
"""Nodes may become so many times faster than in the present window."""
_FROM_REST = 0.01
"""Nodes may move this part of the reach, however slow they have been."""
_REGROUPED = 100
"""Windows after which the nodes that share a box are chosen again."""


def carries_positions(network: Network) -> bool:
    """Returns whether a packet carries its sender's position to other parts, instead of the positions of all nodes."""
    needs = network.range < math.inf or network.sensitivity > -math.inf or network.jamming
    return bool(needs and network.topology != "nearest")


def reach_of(network: Network) -> float:
    """Returns the distance [m] beyond which no packet is received; infinity if there is none, or packets matter there.

    With a medium, packets occupy it wherever they are heard. With signals and jamming, the place of a receiver decides
    which of the two loses a packet.
    """
    reach = math.inf
    if network.medium != "none" or not carries_positions(network):
        return reach
    if network.range < math.inf:
        reach = network.range
    elif network.sensitivity > -math.inf and not network.jamming and network.exponent > 0.0:
        best = network.power - network.path_loss + _DEVIATIONS * network.shadowing + (_GAIN if network.rayleigh else 0)
        decades = (best - network.sensitivity) / (10.0 * network.exponent) * _SAFE
        reach = max(1.0, 10.0**decades) * _SAFE if decades < 300 else math.inf
    return reach if reach < 0.1 * FAR else math.inf


@dataclass(frozen=True, slots=True)
class Promise:
    """Boxes that the nodes of a part do not leave during the next two windows.

    Attributes:
        boxes: (boxes, 2, 3) least and greatest coordinates, m.
        group: of each node, its box.
    """

    boxes: _Array
    group: NDArray[np.int64]

    def kept(self, positions: _Array) -> bool:
        """Returns whether nodes, (instants, nodes, 3) m, are where they have promised to be."""
        low, high = self.boxes[self.group, 0], self.boxes[self.group, 1]
        return bool(((positions >= low) & (positions <= high)).all())


def out_of_reach(reach: float, places: _Array, boxes: _Array) -> NDArray[np.bool_]:
    """Returns which places [m], (places, 3), are certainly beyond the reach of all nodes in boxes, (boxes, 2, 3)."""
    at = places[:, None, :]
    with np.errstate(invalid="ignore", over="ignore"):
        gap = np.maximum(np.maximum(boxes[:, 0] - at, at - boxes[:, 1]), 0.0)
        beyond = (gap * gap).sum(axis=2) > reach * reach * _SAFE
    return np.asarray(beyond.all(axis=1) & np.isfinite(places).all(axis=1))


class Promises:
    """The promises of a part.

    Args:
        reach: of its radio, m.
        window: base steps between two exchanges.
    """

    def __init__(self, reach: float, window: int) -> None:
        self._reach, self._window = reach, window
        self._made: list[Promise] = []
        self._group: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._count = 0

    def broken(self, positions: _Array) -> bool:
        """Returns whether nodes were elsewhere than promised in a window; (instants, nodes, 3), m."""
        return not all(one.kept(positions) for one in self._made)

    def make(self, steps: NDArray[np.int64], positions: _Array) -> Crowd:
        """Returns where the nodes are during the two windows after these instants.

        Args:
            steps: the base steps of some instants, the end of the window last.
            positions: of the nodes then, (instants, nodes, 3), m.
        """
        now = positions[-1]
        if not np.isfinite(now).all():
            self._group, self._count = np.zeros(len(now), dtype=np.int64), 0
            boxes = np.array([[[-np.inf] * 3, [np.inf] * 3]])
        else:
            if self._count % _REGROUPED == 0:
                self._group = _groups(now)
            self._count += 1
            boxes = _boxes(now, self._group, self._margin(steps, positions))
        self._made = [*self._made[-1:], Promise(boxes, self._group)]
        return Crowd(boxes, self._group.astype(np.int8))

    def _margin(self, steps: NDArray[np.int64], positions: _Array) -> float:
        speed = 0.0
        if len(steps) > 1 and positions.shape[1]:
            moved = np.abs(np.diff(positions, axis=0)).max(axis=(1, 2)) / np.maximum(np.diff(steps), 1)
            most = float(moved.max())
            speed = most if math.isfinite(most) else 0.0
        return 2.0 * self._window * _FASTER * speed + _FROM_REST * self._reach


def _groups(now: _Array) -> NDArray[np.int64]:
    """Returns the group of each node: halves along the widest axis, of halves, until there are enough."""
    groups = [np.arange(len(now))]
    while len(groups) < _GROUPS and max(len(one) for one in groups) > 1:
        groups = [half for one in groups for half in _halves(now, one)]
    found = np.zeros(len(now), dtype=np.int64)
    for g, one in enumerate(groups):
        found[one] = g
    return found


def _halves(now: _Array, nodes: NDArray[np.int64]) -> list[NDArray[Any]]:
    if len(nodes) < 2:
        return [nodes]
    axis = int(np.ptp(now[nodes], axis=0).argmax())
    order = nodes[np.argsort(now[nodes, axis], kind="stable")]
    return [order[: len(order) // 2], order[len(order) // 2 :]]


def _boxes(now: _Array, group: NDArray[np.int64], margin: float) -> _Array:
    boxes = np.zeros((int(group.max()) + 1 if group.size else 0, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    np.minimum.at(boxes[:, 0], group, now)
    np.maximum.at(boxes[:, 1], group, now)
    boxes[:, 0] -= margin
    boxes[:, 1] += margin
    return boxes
