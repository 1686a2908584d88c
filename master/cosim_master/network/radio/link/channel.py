"""The effects of a link on a packet: latency, jitter, loss, range and outages, with the link's own random numbers.

A trace file replaces latency, jitter and loss of the links that it contains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.link.chances import JITTER, LOSS, chance
from cosim_master.network.radio.link.effects import distance2, effect
from cosim_master.network.radio.link.own import over_own
from cosim_master.network.radio.tables import (
    BY_RADIO,
    LOST_CHANNEL,
    LOST_OUTAGE,
    LOST_OWN,
    LOST_RANGE,
    LOST_TRACE,
    ON_BOARD,
    Radio,
)

__all__ = ["over_link", "over_radio"]


@kernel
def _channel(r: Radio, n: int, other: int) -> int:
    """Returns the row of `channels` for the link from node `n` to node `other`; -1 if none exists."""
    kind = r.nodes[other].kind
    first, last = r.nodes[n].channel, r.nodes[n].unchannelled
    while first < last:
        middle = (first + last) // 2
        if r.channels[middle].kind < kind:
            first = middle + 1
        else:
            last = middle
    return int(first) if first < r.nodes[n].unchannelled and r.channels[first].kind == kind else -1


@kernel
def _traced(r: Radio, n: int, other: int, t: int) -> int:
    """Returns the row of `trace` for a packet from node `n` to node `other` at t [ns]; -1 if they are not in it.

    It is the last row of this link up to t, or the first one.
    """
    first, last = 0, r.trace.size
    while first < last:
        middle = (first + last) // 2
        sender, hearer = r.trace[middle].sender, r.trace[middle].hearer
        if sender < n or (sender == n and (hearer < other or (hearer == other and r.trace[middle].time <= t))):
            first = middle + 1
        else:
            last = middle
    for row in (first - 1, first):
        if 0 <= row < r.trace.size and r.trace[row].sender == n and r.trace[row].hearer == other:
            return int(row)
    return -1


@kernel
def in_outage(r: Radio, n: int, t: int) -> bool:
    for j in range(r.outages.shape[0]):  # noqa: SIM110 (numba has no generators)
        if r.outages[j, 0] == n and r.outages[j, 1] <= t < r.outages[j, 2]:
            return True
    return False


@kernel
def over_radio(
    r: Radio,
    reals: NDArray[np.float64],
    t: int,
    e: int,
    other: int,
    number: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> tuple[int, int]:
    """Returns arrival time (-1 if lost) and outcome of the packet buf[start:stop] from endpoint `e` to node `other`.

    It is sent by radio at t. `number` is the number of the packet at its sender. With the identities of sender and
    receiver, it is the key of the random numbers.
    """
    s, n = r.settings[0], r.endpoints[e].node
    identity, hearer = r.endpoints[e].identity, r.nodes[other].identity
    latency, jitter, loss = s.latency, s.jitter, s.loss
    channel = _channel(r, n, other) if r.channels.size > 0 else -1
    if channel >= 0:
        latency, jitter, loss = r.channels[channel].latency, r.channels[channel].jitter, r.channels[channel].loss
    row = _traced(r, n, other, t) if r.trace.size > 0 else -1
    if row >= 0:
        latency, jitter, loss = r.trace[row].delay, 0, 0.0
    arrival = t + latency
    if jitter > 0:
        arrival += int(np.int64(jitter * chance(s.seed, identity, hearer, number, JITTER)))
    if s.effects != 0 and s.own != 0:
        arrival = over_own(r, reals, t, arrival, e, other, number, buf, start, stop)
        if arrival < 0:
            return -1, LOST_OWN
    if in_outage(r, n, t) or in_outage(r, other, arrival):
        return -1, LOST_OUTAGE
    if s.range < np.inf and distance2(r, reals, n, other) > s.range * s.range:
        return -1, LOST_RANGE
    if row >= 0 and chance(s.seed, identity, hearer, number, LOSS) >= r.trace[row].delivered:
        return -1, LOST_TRACE
    if s.effects != 0:
        cause = effect(r, reals, t, arrival, e, other, number, channel)
        if cause != BY_RADIO:
            return -1, cause
    if loss > 0.0 and chance(s.seed, identity, hearer, number, LOSS) < loss:
        return -1, LOST_CHANNEL
    return arrival, BY_RADIO


@kernel
def over_link(r: Radio, t: int, g: int, source: int, sink: int, n: int) -> tuple[int, int]:
    """Returns arrival time (-1 if lost) and outcome of a packet from endpoint `source` to node `sink` by g's link.

    The packet is sent at t. `n` is the node at the far end of the link; its outages apply unless the gateway is wired.
    """
    w = r.gateways[g]
    number = w.number
    w.number = number + 1
    seed, identity, hearer = r.settings[0].seed, r.endpoints[source].identity, r.nodes[sink].identity
    arrival = t + w.latency
    if w.jitter > 0:
        arrival += int(np.int64(w.jitter * chance(seed, identity, hearer, number, JITTER)))
    if w.wired < 0 and in_outage(r, n, t if sink != n else arrival):
        return -1, LOST_OUTAGE
    if w.loss > 0.0 and chance(seed, identity, hearer, number, LOSS) < w.loss:
        return -1, LOST_CHANNEL
    return arrival, ON_BOARD if w.wired >= 0 else BY_RADIO
