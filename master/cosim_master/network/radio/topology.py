"""Topologies: the nodes that hear each other by radio."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim_master.network.radio.link.effects import distance2
from cosim_master.network.radio.tables import LISTED, NEAREST, NEAREST_ON_AXIS, Radio

__all__ = ["copies", "find_hearers", "missing_before", "sort_along"]


@kernel
def sort_along(r: Radio, reals: NDArray[np.float64]) -> None:
    """Sorts `order` by position along the axis, ties by node number. The previous order is nearly sorted."""
    for n in range(r.along.size):
        s = 0.0
        for i in range(3):
            s += r.settings[0].axis[i] * reals[r.nodes[n].place[i]]
        r.along[n] = s
    order, rank = r.order[0], r.order[1]
    for i in range(1, order.size):
        n = order[i]
        j = i - 1
        while j >= 0 and (r.along[order[j]] > r.along[n] or (r.along[order[j]] == r.along[n] and order[j] > n)):
            order[j + 1] = order[j]
            rank[order[j + 1]] = j + 1
            j -= 1
        if j + 1 < i:
            order[j + 1] = n
            rank[n] = j + 1


@kernel
def _nearest(r: Radio, reals: NDArray[np.float64], n: int) -> int:
    """Writes the nodes nearest to `n` into `hearers`, nearest first, ties by node number; returns their number."""
    per_side = r.settings[0].per_side
    found = 0
    for other in range(r.along.size):
        if other == n:
            continue
        d = distance2(r, reals, n, other)
        j = found
        while j > 0 and r.along[r.hearers[j - 1]] > d:
            if j < per_side:
                r.hearers[j] = r.hearers[j - 1]
            j -= 1
        if j < per_side:
            r.hearers[j] = other
            r.along[other] = d
            found = min(found + 1, per_side)
    return found


@kernel
def find_hearers(r: Radio, reals: NDArray[np.float64], n: int) -> int:
    """Writes the nodes that hear node `n` by the topology into `hearers`; returns their number."""
    topology, per_side = r.settings[0].topology, r.settings[0].per_side
    found = 0
    if topology == LISTED:
        for j in range(r.nodes[n].listed, r.nodes[n].unlisted):
            r.hearers[found] = r.links[j]
            found += 1
    elif topology == NEAREST:
        found = _nearest(r, reals, n)
    elif topology == NEAREST_ON_AXIS:
        at = r.order[1, n]
        for j in range(max(0, at - per_side), min(r.order.shape[1], at + per_side + 1)):
            if j != at:
                r.hearers[found] = r.order[0, j]
                found += 1
    else:
        for other in range(r.along.size):
            if other != n:
                r.hearers[found] = other
                found += 1
    return found


@kernel
def missing_before(r: Radio, n: int) -> int:
    """Returns the places before the first hearer of node `n` that are empty, since `n` is near an end of the axis.

    With them, the place of a hearer among `hearers` follows from the nodes between it and `n` alone.
    """
    if r.settings[0].topology != NEAREST_ON_AXIS:
        return 0
    return int(max(0, r.settings[0].per_side - r.order[1, n]))


@entry
def copies(r: Radio) -> int:
    """Returns an upper bound of a packet's places in flight, and of its events and those of the garbage before it."""
    topology, per_side = r.settings[0].topology, r.settings[0].per_side
    reach = r.along.size
    if topology == NEAREST:
        reach = min(reach, per_side)
    elif topology == NEAREST_ON_AXIS:
        reach = min(reach, 2 * per_side)
    elif topology == LISTED:
        reach = 0
        for n in range(r.along.size):
            reach = max(reach, r.nodes[n].unlisted - r.nodes[n].listed)
    widest = 1
    for n in range(r.nodes.size):
        widest = max(widest, r.nodes[n].last - r.nodes[n].first)
    twice = 2 if r.settings[0].duplicates > 0.0 else 1
    return int((max(reach, 1) + 1) * widest * twice + r.gateways.size)
