"""Optional effects of the radio, set by its annotation: bursts, weak signals, jamming, partitions, bit errors.

**Bursts** (Gilbert 1960, Elliott 1963): the link from a sender to a receiver is good or bad for each packet of the
sender. It changes from good to bad with probability p, and back with probability r. Only the packets' numbers are known
here, so the state of the Markov chain is computed, not stored: each step discards the previous state with probability p
+ r, and is then bad with probability p / (p + r); otherwise it keeps the state. These transitions are equivalent, and
the state of packet k follows from the last number up to k at which the state was discarded.

**Signals**: the received power is the transmitted power minus the loss at 1 m, minus 10 n lg(d / 1 m), plus shadowing
of the pair of nodes (normally distributed in dB, constant, and equal in both directions), plus Rayleigh fading of the
packet (its power is exponentially distributed), minus the losses of the obstacles between them (`obstacles`). A packet
weaker than the receiver's sensitivity is lost (Rappaport 2002, chapters 4 and 5).

**Errors**: each bit is inverted with the same probability. The packet arrives with these errors, and its CRC does not
match.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.link.chances import (
    BURST,
    ERROR,
    FADING,
    IN_BURST,
    SHADOW,
    chance,
    exponential,
    normal,
)
from cosim_master.network.radio.link.obstacles import loss_behind
from cosim_master.network.radio.tables import (
    BY_RADIO,
    LOST_BURST,
    LOST_JAMMED,
    LOST_PARTITION,
    LOST_SIGNAL,
    Radio,
)

__all__ = ["damage", "distance2", "effect", "first_error"]

_FORGOTTEN = 60.0
"""A chain whose state would have been kept for this many mean times is assumed to be good: exp(-60) of all cases."""


@kernel
def distance2(r: Radio, reals: NDArray[np.float64], a: int, b: int) -> float:
    total = 0.0
    for i in range(3):
        d = reals[r.nodes[a].place[i]] - reals[r.nodes[b].place[i]]
        total += d * d
    return total


@kernel
def in_burst(seed: np.uint64, source: np.uint64, sink: np.uint64, number: int, start: float, end: float) -> bool:
    """Returns whether the link of a packet is bad; `start`, `end`: probabilities that a burst begins and ends."""
    forgets = start + end
    for k in range(number, number - int(_FORGOTTEN / forgets), -1):
        u = chance(seed, source, sink, k, BURST)
        if u < forgets:
            return u < start
    return False


@kernel
def too_weak(r: Radio, reals: NDArray[np.float64], e: int, other: int, number: int) -> bool:
    """Returns whether the signal of a packet of endpoint `e` is below the sensitivity of node `other`."""
    s, n = r.settings[0], r.endpoints[e].node
    distance = np.sqrt(distance2(r, reals, n, other))
    power = s.power - s.path_loss - 10.0 * s.exponent * np.log10(max(distance, 1.0))
    if r.obstacles.shape[0] > 0:
        power -= loss_behind(r, reals, n, other, distance)
    if s.shadowing > 0.0:
        a, b = r.nodes[n].identity, r.nodes[other].identity
        power += s.shadowing * normal(s.seed, min(a, b), max(a, b), 0, SHADOW)
    if s.rayleigh != 0:
        gain = exponential(s.seed, r.endpoints[e].identity, r.nodes[other].identity, number, FADING)
        if gain <= 0.0:
            return True
        power += 10.0 * np.log10(gain)
    return bool(power < s.sensitivity)


@kernel
def jammed(r: Radio, reals: NDArray[np.float64], n: int, t: int) -> bool:
    """Returns whether node `n` is in an area that is jammed at t."""
    for j in range(r.jamming.shape[0]):
        north = reals[r.nodes[n].place[0]] - r.jamming[j, 0]
        east = reals[r.nodes[n].place[1]] - r.jamming[j, 1]
        inside = north * north + east * east <= r.jamming[j, 2] * r.jamming[j, 2]
        if inside and r.jamming[j, 3] <= t < r.jamming[j, 4]:
            return True
    return False


@kernel
def parted(r: Radio, n: int, other: int, t: int) -> bool:
    """Returns whether two nodes are on different sides of a partition at t."""
    for j in range(r.partitions.shape[0]):
        if r.partitions[j, 0] <= t < r.partitions[j, 1] and r.partitions[j, 2 + n] != r.partitions[j, 2 + other]:
            return True
    return False


@kernel
def effect(
    r: Radio, reals: NDArray[np.float64], t: int, arrival: int, e: int, other: int, number: int, channel: int
) -> int:
    """Returns the reason why a packet of endpoint `e` does not reach node `other`; BY_RADIO if it does.

    `channel`: the row of `channels` that describes the link, -1 if none does.
    """
    s, n = r.settings[0], r.endpoints[e].node
    if parted(r, n, other, t):
        return LOST_PARTITION
    if jammed(r, reals, other, arrival):
        return LOST_JAMMED
    if s.sensitivity > -np.inf and too_weak(r, reals, e, other, number):
        return LOST_SIGNAL
    start, end, loss = s.burst_start, s.burst_end, s.burst_loss
    if channel >= 0:
        c = r.channels[channel]
        start, end, loss = c.burst_start, c.burst_end, c.burst_loss
    if start > 0.0:
        identity, hearer = r.endpoints[e].identity, r.nodes[other].identity
        if in_burst(s.seed, identity, hearer, number, start, end) and (
            loss >= 1.0 or chance(s.seed, identity, hearer, number, IN_BURST) < loss
        ):
            return LOST_BURST
    return BY_RADIO


@kernel
def _next_error(r: Radio, e: int, other: int, number: int, which: int) -> float:
    """Returns the number of correct bits before the next bit error, which is geometrically distributed."""
    s = r.settings[0]
    gap = exponential(s.seed, r.endpoints[e].identity, r.nodes[other].identity, number, ERROR + which)
    return float(np.floor(gap / -np.log1p(-s.bit_errors)))


@kernel
def first_error(r: Radio, e: int, other: int, number: int, length: int) -> int:
    """Returns the index of the first wrong bit of a packet of `length` bytes at node `other`; -1 if all are correct."""
    gap = _next_error(r, e, other, number, 0)
    return int(gap) if gap < 8.0 * length else -1


@kernel
def damage(r: Radio, place: int, e: int, other: int, number: int) -> None:
    """Inverts the bits that are wrong at node `other`, in the copy of the packet that is in flight in `place`."""
    bits = 8.0 * r.places[place].length
    at = _next_error(r, e, other, number, 0)
    errors = 1
    while at < bits:
        bit = int(at)
        r.data[place, bit // 8] ^= np.uint8(1 << (bit % 8))
        at += 1.0 + _next_error(r, e, other, number, errors)
        errors += 1
