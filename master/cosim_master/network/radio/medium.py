"""The medium that packets share: the time on the air, the waiting for a free medium, and collisions.

A byte takes ten bits, as on the serial line of a modem. Three media:

    own      each node has a medium of its own; its packets follow each other
    shared   one medium for all; a packet waits until it is free, so that packets never collide
    aloha    one medium for all in slots of equal length (Roberts 1975): a packet goes in one of the next `window`
             slots; packets of one slot that a node hears are lost there, and a node that sends hears nothing

A packet that would wait longer than `queue` is lost. With slots, the receivers of packets are determined at the end of
the slot. Until then, the packets are in flight to the medium, which is the last endpoint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.network.radio.chances import SLOT, chance
from cosim_master.network.radio.effects import distance2
from cosim_master.network.radio.queues import put
from cosim_master.network.radio.tables import OWN, WAITING, Radio
from cosim_master.network.radio.topology import find_hearers

__all__ = ["collided", "departure", "listen_to_slot", "next_slot_over", "put_into_slot"]

_SENDS = 1 << 32
"""Added for a node that sends in a slot, in addition to 1 for each sender that it hears."""


@kernel
def departure(r: Radio, t: int, n: int, length: int) -> int:
    """Returns when a packet that node `n` sends at t [ns] has left; -1 if it would wait too long. Not for slots."""
    s = r.settings[0]
    medium = n if s.medium == OWN else 0
    begin = max(t, r.media[medium])
    if begin - t > s.queue:
        return -1
    end = begin + int(np.ceil(length * 1e10 / s.rate))
    r.media[medium] = end
    return int(end)


@kernel
def put_into_slot(
    r: Radio, t: int, e: int, number: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int
) -> bool:
    """Assigns a slot to a packet that endpoint `e` sends at t [ns]; returns False if the packet would wait too long."""
    s, n = r.settings[0], r.endpoints[e].node
    slot = -(-t // s.slot)
    if s.window > 1:
        slot += int(s.window * chance(s.seed, r.endpoints[e].identity, r.nodes[n].identity, number, SLOT))
    slot = max(slot, r.media[n] + 1)
    if slot * s.slot - t > s.queue:
        return False
    r.media[n] = slot
    place = put(r, r.endpoints.size - 1, (slot + 1) * s.slot, buf, start, stop, to_system, -1)
    r.places[place].sender, r.places[place].number, r.places[place].sent = e, number, t
    r.counters[WAITING] += 1
    return True


@kernel
def next_slot_over(r: Radio, t: int) -> int:
    """Returns the end of the next slot with packets if it is at most t [ns], otherwise -1."""
    first = r.endpoints[r.endpoints.size - 1].first
    return int(r.places[first].arrival) if first >= 0 and r.places[first].arrival <= t else -1


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
def collided(r: Radio, other: int) -> bool:
    """Returns whether node `other` cannot receive any packet in the slot last evaluated."""
    return bool(r.media[r.along.size + other] > 1)
