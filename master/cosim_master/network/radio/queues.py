"""Packets in flight and their records: queued at their receivers, delivered, logged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.entry import entry
from cosim.kernel import kernel
from cosim.packets import component, copy, message_id, sequence, system
from cosim_master.network.radio.prefetching import expect_place
from cosim_master.network.radio.tables import (
    COUNTED,
    DEFERRED,
    DELIVERED,
    FREE_PLACE,
    FREE_PLACES,
    IN_FLIGHT,
    MALFORMED,
    SWARM,
    TURN,
    USED_EVENTS,
    USED_LOG,
    Radio,
)

__all__ = ["arrived", "deliver", "log_packet", "put", "record_event", "take_delivered", "take_out"]

LOG_HEAD = 16
"""Bytes before a packet in the log block: time in ns (8), 2*node + 1 if the node sent it (4), length (4). Packets to a
gateway by its own line are not in the log of any vehicle: their node is the number of nodes.
"""


@kernel
def put(
    r: Radio, endpoint: int, arrival: int, buf: NDArray[np.uint8], start: int, stop: int, logged: int, gateway: int
) -> int:
    """Inserts a packet into the queue of `endpoint`, after all packets that do not arrive later; returns its place."""
    place = r.counters[FREE_PLACE]
    r.counters[FREE_PLACE] = r.places[place].following
    expect_place(r, r.counters[FREE_PLACE])
    r.counters[FREE_PLACES] -= 1
    r.counters[IN_FLIGHT] += 1
    copy(buf, start, stop, r.data[place], 0)
    r.places[place].length = stop - start
    r.places[place].arrival = arrival
    r.places[place].logged = logged
    r.places[place].gateway = gateway
    last = r.endpoints[endpoint].last
    if last >= 0 and r.places[last].arrival <= arrival:
        r.places[place].following = -1
        r.places[last].following = place
        r.endpoints[endpoint].last = place
        return int(place)
    before, after = -1, r.endpoints[endpoint].first
    while after >= 0 and r.places[after].arrival <= arrival:
        before, after = after, r.places[after].following
    r.places[place].following = after
    if before < 0:
        r.endpoints[endpoint].first = place
    else:
        r.places[before].following = place
    if after < 0:
        r.endpoints[endpoint].last = place
    return int(place)


@kernel
def take_out(r: Radio, endpoint: int) -> None:
    """Frees the first place in the queue of `endpoint`."""
    place = r.endpoints[endpoint].first
    r.endpoints[endpoint].first = r.places[place].following
    if r.endpoints[endpoint].first < 0:
        r.endpoints[endpoint].last = -1
    r.places[place].following = r.counters[FREE_PLACE]
    r.counters[FREE_PLACE] = place
    r.counters[FREE_PLACES] += 1
    r.counters[IN_FLIGHT] -= 1


@kernel
def log_packet(r: Radio, t: int, n: int, sent: int, buf: NDArray[np.uint8], start: int, stop: int) -> None:
    if r.settings[0].keep == 0:
        return
    p = r.counters[USED_LOG]
    entry = 2 * n + sent
    for i in range(8):
        r.log[p + i] = (t >> 8 * i) & 0xFF
    for i in range(4):
        r.log[p + 8 + i] = (entry >> 8 * i) & 0xFF
        r.log[p + 12 + i] = ((stop - start) >> 8 * i) & 0xFF
    copy(buf, start, stop, r.log, p + LOG_HEAD)
    r.counters[USED_LOG] = p + LOG_HEAD + stop - start


@kernel
def record_event(
    r: Radio, t: int, arrival: int, e: int, n: int, buf: NDArray[np.uint8], start: int, stop: int, outcome: int
) -> None:
    r.counters[outcome] += 1
    if r.settings[0].keep == 0:
        return
    row = r.events[r.counters[USED_EVENTS]]
    row["sent"] = t
    row["arrival"] = arrival
    row["source"] = e
    row["target"] = n
    row["message"] = -1 if outcome == MALFORMED else message_id(buf, start)
    row["system"] = 0 if outcome == MALFORMED else system(buf, start)
    row["component"] = 0 if outcome == MALFORMED else component(buf, start)
    row["sequence"] = 0 if outcome == MALFORMED else sequence(buf, start)
    row["length"] = stop - start
    row["outcome"] = outcome
    row["origin"] = e
    row["born"] = t
    row["order"] = r.counters[TURN]
    r.counters[USED_EVENTS] += 1


@entry
def deliver(r: Radio, t: int, e: int, buf: NDArray[np.uint8]) -> int:
    """Copies packets that reached endpoint `e` by time t [ns] into `buf`; returns the bytes. Excess packets wait."""
    n = 0
    while r.endpoints[e].first >= 0 and r.places[r.endpoints[e].first].arrival <= t:
        place = r.endpoints[e].first
        length = r.places[place].length
        if n + length > r.endpoints[e].capacity:
            r.counters[DEFERRED] += 1
            break
        copy(r.data[place], 0, length, buf, n)
        n += length
        _account(r, t, e, place)
    return n


@kernel
def _account(r: Radio, t: int, e: int, place: int) -> None:
    """Logs and counts the first packet in the queue of endpoint `e`, received at t [ns], and frees its place."""
    row = r.places[place]
    if row.logged != 0:
        if r.endpoints[e].reach <= SWARM:
            log_packet(r, t, r.endpoints[e].node, 0, r.data[place], 0, row.length)
        if row.logged == COUNTED:
            r.counters[DELIVERED] += 1
    if row.gateway >= 0:
        r.gateways[row.gateway].waiting -= 1
    take_out(r, e)


@kernel
def take_delivered(r: Radio, t: int, e: int) -> None:
    """Does all that `deliver` does, except that somebody else has copied the packets."""
    n = 0
    while r.endpoints[e].first >= 0 and r.places[r.endpoints[e].first].arrival <= t:
        place = r.endpoints[e].first
        n += r.places[place].length
        if n > r.endpoints[e].capacity:
            r.counters[DEFERRED] += 1
            break
        _account(r, t, e, place)


@kernel
def arrived(endpoints: NDArray[Any], places: NDArray[Any], t: int, e: int) -> bool:
    """Returns whether a packet has reached endpoint `e` by time t [ns]. Called for every endpoint in every step."""
    first = endpoints[e].first
    return bool(first >= 0 and places[first].arrival <= t)
