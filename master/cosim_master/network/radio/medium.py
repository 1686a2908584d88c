"""The medium that packets share: the time on the air, the waiting for a free medium, and collisions.

A byte takes ten bits, as on the serial line of a modem. Four media:

    own      each node has a medium of its own; its packets follow each other
    shared   one medium for all; a packet waits until it is free, so that packets never collide
    aloha    one medium for all in slots of equal length (Roberts 1975): a packet goes in one of the next `window`
             slots; packets of one slot that a node hears are lost there, and a node that sends hears nothing
    csma     one medium for all: non-persistent carrier sense multiple access (Kleinrock and Tobagi 1975). After a
             random part of `backoff`, a node senses the medium. If it hears nobody, it sends; otherwise it waits again.
             It hears the beginning and the end of a transmission late, by `sensing`, so packets can overlap; they are
             lost where both are heard, and a node that sends hears nothing.

A packet that would wait longer than `queue` is lost. With `aloha` and `csma`, the receivers of a packet are determined
at the end of its slot or of its time on the air. Until then, the packet is in flight to the medium, which is the last
endpoint: with `csma`, its arrival is the time of the next sensing, and later the end of its time on the air.

The rows of `Radio.media` with `csma` are named below. Transmissions that a node hears and that overlap form a busy
time. No packet is shorter than `sensing`, so at most one busy time began within `sensing` of any moment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.link.chances import BACKOFF, SLOT, chance
from cosim_master.network.radio.link.effects import distance2
from cosim_master.network.radio.queues import put, take_out
from cosim_master.network.radio.relays import resume_trip, save_trip
from cosim_master.network.radio.tables import CSMA, LOGGED, OWN, WAITING, Radio
from cosim_master.network.radio.topology import find_hearers

__all__ = ["collided", "departure", "listen_to_slot", "on_air", "sense", "wait_for_medium"]

_SENDS = 1 << 32
"""Added for a node that sends in a slot, in addition to 1 for each sender that it hears."""

_BEGIN, _END, _BEFORE, _SENDS_UNTIL, _RECEIVES = range(5)
"""Rows of `Radio.media` with `csma`: beginning and end of the latest busy time of a node, end of the one before it;
the end [ns] of its own last packet; the place of the packet that it receives undisturbed, -1 for none.
"""


@kernel
def _airtime(r: Radio, length: int) -> int:
    """Returns the time of `length` bytes on the air, ns."""
    return int(np.ceil(length * 1e10 / r.settings[0].rate))


@kernel
def departure(r: Radio, t: int, n: int, length: int) -> int:
    """Returns when a packet that node `n` sends at t [ns] has left; -1 if it would wait too long. Not for slots."""
    s = r.settings[0]
    medium = n if s.medium == OWN else 0
    begin = max(t, r.media[medium])
    if begin - t > s.queue:
        return -1
    end = begin + _airtime(r, length)
    r.media[medium] = end
    return int(end)


@kernel
def wait_for_medium(
    r: Radio, t: int, e: int, number: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int
) -> bool:
    """Lets a packet that endpoint `e` sends at t [ns] wait for its slot, or until it first senses the medium.

    Returns False if it would wait too long for its slot.
    """
    arrival = t + _backoff(r, t, e, number) if r.settings[0].medium == CSMA else _slot_over(r, t, e, number)
    if arrival < 0:
        return False
    place = put(r, r.endpoints.size - 1, arrival, buf, start, stop, 0, -1)
    r.places[place].sender, r.places[place].number, r.places[place].sent = e, number, t
    r.places[place].addressee = to_system
    if r.trip.size > 0:
        save_trip(r, place, -1)
    r.counters[WAITING] += 1
    return True


@kernel
def _slot_over(r: Radio, t: int, e: int, number: int) -> int:
    """Assigns a slot to a packet that endpoint `e` sends at t [ns]; returns its end, or -1 if the wait is too long."""
    s, n = r.settings[0], r.endpoints[e].node
    slot = -(-t // s.slot)
    if s.window > 1:
        slot += int(s.window * chance(s.seed, r.endpoints[e].identity, r.nodes[n].identity, number, SLOT))
    slot = max(slot, r.media[n] + 1)
    if slot * s.slot - t > s.queue:
        return -1
    r.media[n] = slot
    return int((slot + 1) * s.slot)


@kernel
def listen_to_slot(r: Radio, reals: NDArray[np.float64], end: int) -> None:
    """Counts, for each node, the packets that it sends and that it hears in the slot that ends at `end`."""
    nodes = r.along.size
    r.media[nodes:] = 0
    place = r.endpoints[r.endpoints.size - 1].first
    while place >= 0 and r.places[place].arrival == end:
        n = r.endpoints[r.places[place].sender].node
        r.media[nodes + n] += _SENDS
        for i in range(find_hearers(r, reals, n)):
            other = r.hearers[i]
            within = r.settings[0].range
            if within == np.inf or distance2(r, reals, n, other) <= within * within:
                r.media[nodes + other] += 1
        place = r.places[place].following


@kernel
def _backoff(r: Radio, t: int, e: int, number: int) -> int:
    """Returns the time from t [ns] until a packet of endpoint `e` senses the medium, ns; the key contains t."""
    s = r.settings[0]
    return int(np.int64(s.backoff * chance(s.seed, r.endpoints[e].identity, np.uint64(t), number, BACKOFF)))


@kernel
def _busy(r: Radio, n: int, t: int) -> bool:
    """Returns whether node `n` sends at t, or senses somebody who sends."""
    nodes, heard = r.along.size, t - r.settings[0].sensing
    if r.media[_SENDS_UNTIL * nodes + n] >= t:
        return True
    end = _END if r.media[_BEGIN * nodes + n] < heard else _BEFORE
    return bool(0 <= heard <= r.media[end * nodes + n])


@kernel
def _occupy(r: Radio, reals: NDArray[np.float64], place: int, n: int, t: int, end: int) -> None:
    """Lets the packet at `place` be heard from t to `end`, by the nodes that hear node `n`."""
    nodes, within = r.along.size, r.settings[0].range
    r.media[_SENDS_UNTIL * nodes + n] = end
    r.media[_RECEIVES * nodes + n] = -1
    for i in range(find_hearers(r, reals, n)):
        other = r.hearers[i]
        if within < np.inf and distance2(r, reals, n, other) > within * within:
            continue
        last = r.media[_END * nodes + other]
        disturbed = last >= t or r.media[_SENDS_UNTIL * nodes + other] >= t
        r.media[_RECEIVES * nodes + other] = -1 if disturbed else place
        if last < t:
            r.media[_BEFORE * nodes + other] = last
            r.media[_BEGIN * nodes + other] = t
        r.media[_END * nodes + other] = max(last, end)


@kernel
def on_air(r: Radio, place: int) -> bool:
    """Returns whether the packet of a place at the medium `csma` is on the air."""
    return bool(r.places[place].logged != 0)


@kernel
def sense(r: Radio, reals: NDArray[np.float64], place: int) -> bool:
    """Lets the first packet at the medium sense it, and send or wait again; returns False if it must give up."""
    medium, row = r.endpoints.size - 1, r.places[place]
    t, e, number, sent, addressee, length = row.arrival, row.sender, row.number, row.sent, row.addressee, row.length
    n = r.endpoints[e].node
    free = not _busy(r, n, t)
    then = t + _airtime(r, length) if free else t + 1 + _backoff(r, t, e, number)
    if not free and then - sent > r.settings[0].queue:
        return False
    again = put(r, medium, then, r.data[place], 0, length, LOGGED if free else 0, -1)
    r.places[again].sender, r.places[again].number, r.places[again].sent = e, number, sent
    r.places[again].addressee = addressee
    if r.trip.size > 0:
        resume_trip(r, place)
        save_trip(r, again, -1)
    take_out(r, medium)
    if free:
        _occupy(r, reals, again, n, t, then)
    return True


@kernel
def collided(r: Radio, other: int, place: int) -> bool:
    """Returns whether node `other` cannot receive the packet at `place`, whose slot or time on the air is over."""
    if r.settings[0].medium == CSMA:
        return bool(r.media[_RECEIVES * r.along.size + other] != place)
    return bool(r.media[r.along.size + other] > 1)
