"""What a link does to a packet: latency, jitter, loss, range and outages, with random numbers of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.tables import BY_RADIO, LOST_CHANNEL, LOST_OUTAGE, LOST_RANGE, ON_BOARD, Radio

__all__ = ["distance2", "over_link", "over_radio"]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


@kernel
def _mix(x: np.uint64) -> np.uint64:
    """The finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection that spreads every bit."""
    x = (x ^ (x >> np.uint64(30))) * _MIX1
    x = (x ^ (x >> np.uint64(27))) * _MIX2
    return x ^ (x >> np.uint64(31))


@kernel
def chance(seed: np.uint64, source: np.uint64, sink: np.uint64, number: int, which: int) -> float:
    """A number in [0, 1) that depends on its arguments only."""
    x = _mix(seed + _GOLDEN)
    x = _mix(x ^ source)
    x = _mix((x + _GOLDEN) ^ sink)
    x = _mix((x + _GOLDEN) ^ np.uint64(number))
    x = _mix((x + _GOLDEN) ^ np.uint64(which))
    return float(np.float64(np.int64(x >> np.uint64(11))) * 2.0**-53)


@kernel
def distance2(r: Radio, reals: NDArray[np.float64], a: int, b: int) -> float:
    total = 0.0
    for i in range(3):
        d = reals[r.nodes[a].place[i]] - reals[r.nodes[b].place[i]]
        total += d * d
    return total


@kernel
def _channel(r: Radio, n: int, other: int) -> tuple[int, int, float]:
    """Latency, jitter and loss of packets from node `n` to node `other`."""
    kind = r.nodes[other].kind
    first, last = r.nodes[n].channel, r.nodes[n].unchannelled
    while first < last:
        middle = (first + last) // 2
        if r.channels[middle].kind < kind:
            first = middle + 1
        else:
            last = middle
    if first < r.nodes[n].unchannelled and r.channels[first].kind == kind:
        c = r.channels[first]
        return c.latency, c.jitter, c.loss
    s = r.settings[0]
    return s.latency, s.jitter, s.loss


@kernel
def in_outage(r: Radio, n: int, t: int) -> bool:
    for j in range(r.outages.shape[0]):  # noqa: SIM110 (numba has no generators)
        if r.outages[j, 0] == n and r.outages[j, 1] <= t < r.outages[j, 2]:
            return True
    return False


@kernel
def over_radio(r: Radio, reals: NDArray[np.float64], t: int, e: int, other: int, number: int) -> tuple[int, int]:
    """When a packet that endpoint `e` sends by radio at t reaches the node `other`, -1 if never, and the outcome.

    `number` is that of the packet at its sender: with the identities of both it keys the random numbers.
    """
    s, n = r.settings[0], r.endpoints[e].node
    identity, hearer = r.endpoints[e].identity, r.nodes[other].identity
    latency, jitter, loss = s.latency, s.jitter, s.loss
    if r.channels.size > 0:
        latency, jitter, loss = _channel(r, n, other)
    arrival = t + latency
    if jitter > 0:
        arrival += int(np.int64(jitter * chance(s.seed, identity, hearer, number, 1)))
    if in_outage(r, n, t) or in_outage(r, other, arrival):
        return -1, LOST_OUTAGE
    if s.range < np.inf and distance2(r, reals, n, other) > s.range * s.range:
        return -1, LOST_RANGE
    if loss > 0.0 and chance(s.seed, identity, hearer, number, 0) < loss:
        return -1, LOST_CHANNEL
    return arrival, BY_RADIO


@kernel
def over_link(r: Radio, t: int, g: int, source: int, sink: int, n: int) -> tuple[int, int]:
    """When a packet that leaves endpoint `source` at t reaches node `sink` by the link of gateway g, and the outcome.

    `n` is the node at the far end of the link, whose outages count unless a wire leads to it.
    """
    w = r.gateways[g]
    number = w.number
    w.number = number + 1
    seed, identity, hearer = r.settings[0].seed, r.endpoints[source].identity, r.nodes[sink].identity
    arrival = t + w.latency
    if w.jitter > 0:
        arrival += int(np.int64(w.jitter * chance(seed, identity, hearer, number, 1)))
    if w.wired < 0 and in_outage(r, n, t if sink != n else arrival):
        return -1, LOST_OUTAGE
    if w.loss > 0.0 and chance(seed, identity, hearer, number, 0) < w.loss:
        return -1, LOST_CHANNEL
    return arrival, ON_BOARD if w.wired >= 0 else BY_RADIO
