"""Packets by radio: from a sender through medium and channel to the nodes of the topology, and on by relays.

A packet that waits for the medium, or is in the air on its way to a node, is in the queue of an endpoint without a
node; `serve_medium` routes it when its time has come.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.packets import system
from cosim_master.network.radio.link.chances import DUPLICATE as OF_DUPLICATE
from cosim_master.network.radio.link.chances import DUPLICATE_JITTER, chance
from cosim_master.network.radio.link.channel import over_link, over_radio
from cosim_master.network.radio.link.effects import damage, first_error
from cosim_master.network.radio.medium import (
    collided,
    departure,
    listen_to_slot,
    on_air,
    sense,
    wait_for_medium,
)
from cosim_master.network.radio.queues import put, record_event, take_out
from cosim_master.network.radio.relays import (
    continue_trip,
    first_time,
    is_relay,
    learn,
    next_hop,
    resume_trip,
    save_trip,
    trace_back,
)
from cosim_master.network.radio.tables import (
    AIRBORNE,
    ALOHA,
    BY_RADIO,
    COUNTED,
    CSMA,
    DELIVERED,
    DUPLICATE,
    FREE_PLACES,
    LOGGED,
    LOST_COLLISION,
    LOST_ERRORS,
    LOST_QUEUE,
    NO_ROUTE,
    OWN,
    REPEATED,
    SENT_ON,
    SHARED,
    SWARM,
    TURN,
    USED_EVENTS,
    WAITING,
    Radio,
)
from cosim_master.network.radio.topology import copies, find_hearers, missing_before

__all__ = ["addressed", "by_radio", "serve_medium", "transmit"]


@kernel
def addressed(r: Radio, endpoint: int, to_system: int) -> bool:
    """Returns whether a packet goes to an endpoint: it is a broadcast, or its target system was heard there."""
    return bool(to_system == 0 or r.endpoints[endpoint].heard == to_system)


@kernel
def _hears(r: Radio, endpoint: int, to_system: int) -> bool:
    """Returns whether an endpoint accepts packets that another node sends to `to_system`."""
    e = r.endpoints[endpoint]
    return bool(e.capacity > 0 and e.reach <= SWARM and addressed(r, endpoint, to_system))


@kernel
def _wanted(r: Radio, other: int, to_system: int) -> bool:
    """Returns whether an endpoint of a node accepts packets that another node sends to `to_system`."""
    wanted = False
    for j in range(r.nodes[other].first, r.nodes[other].last):
        wanted = wanted or _hears(r, j, to_system)
    return wanted


@kernel
def _goes_to(r: Radio, n: int, other: int, to_system: int) -> bool:
    """Returns whether the packet that node `n` sends is for a node that hears it."""
    if r.trip.size == 0:
        return _wanted(r, other, to_system)
    if other == r.trip[0].via:
        return False
    hop = next_hop(r, n, to_system)
    if hop >= 0:
        return bool(other == hop)
    return bool(is_relay(r, other) or _wanted(r, other, to_system))


@kernel
def by_radio(
    r: Radio,
    reals: NDArray[np.float64],
    t: int,
    e: int,
    to_system: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> bool:
    """Sends a packet by radio to the nodes of the topology, through medium and channel."""
    n = r.endpoints[e].node
    number = r.endpoints[e].number
    r.endpoints[e].number = number + 1
    if r.settings[0].medium < ALOHA:
        return transmit(r, reals, t, t, e, number, -1, to_system, buf, start, stop)
    taken = False
    waits = True
    for i in range(find_hearers(r, reals, n)):
        if _goes_to(r, n, r.hearers[i], to_system):
            if not taken:
                waits = wait_for_medium(r, t, e, number, to_system, buf, start, stop)
            taken = True
            if not waits:
                record_event(r, t, -1, e, r.hearers[i], buf, start, stop, LOST_QUEUE)
    return taken


@kernel
def transmit(
    r: Radio,
    reals: NDArray[np.float64],
    sent: int,
    t: int,
    e: int,
    number: int,
    place: int,
    to_system: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> bool:
    """Sends a packet of endpoint `e`, which is on the air at t, through the channel to the nodes of the topology.

    `place`: where it waited for the medium; -1 if it did not. A packet with a negative t has waited too long.
    """
    s, n = r.settings[0], r.endpoints[e].node
    hearers = find_hearers(r, reals, n)
    first = r.counters[TURN] + 1 + (missing_before(r, n) if r.outbox.size > 0 else 0)
    taken = False
    for i in range(hearers):
        other = r.hearers[i]
        if not _goes_to(r, n, other, to_system):
            continue
        if not taken and s.medium in (OWN, SHARED):
            t = departure(r, t, n, stop - start)
        taken = True
        r.counters[TURN] = first + i
        if r.nodes[other].elsewhere == 1:
            continue
        if t < 0:
            record_event(r, sent, -1, e, other, buf, start, stop, LOST_QUEUE)
            continue
        if place >= 0 and collided(r, other, place):
            record_event(r, sent, -1, e, other, buf, start, stop, LOST_COLLISION)
            continue
        arrival, outcome = over_radio(r, reals, t, e, other, number, buf, start, stop)
        if outcome == BY_RADIO:
            wrong = s.bit_errors > 0.0 and first_error(r, e, other, number, stop - start) >= 0
            logged = 0 if wrong else COUNTED
            if r.trip.size > 0:
                copy = _take_off(r, e, other, arrival, to_system, logged, buf, start, stop)
                if wrong:
                    damage(r, copy, e, other, number)
            else:
                for j in range(r.nodes[other].first, r.nodes[other].last):
                    if _hears(r, j, to_system):
                        copy = put(r, j, arrival, buf, start, stop, logged, -1)
                        if wrong:
                            damage(r, copy, e, other, number)
                        logged = 0
            if wrong:
                arrival, outcome = -1, LOST_ERRORS
        record_event(r, sent, arrival, e, other, buf, start, stop, outcome)
        if r.trip.size > 0:
            trace_back(r)
        if outcome == BY_RADIO and s.duplicates > 0.0:
            _duplicate(r, sent, arrival, e, other, number, to_system, buf, start, stop)
    return taken


@kernel
def _take_off(
    r: Radio,
    e: int,
    other: int,
    arrival: int,
    to_system: int,
    logged: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> int:
    """Puts a packet of endpoint `e` on its way to node `other`, which takes it at `arrival`; returns its place."""
    place = put(r, r.settings[0].air, arrival, buf, start, stop, logged, -1)
    r.places[place].sender = e
    r.places[place].addressee = to_system
    save_trip(r, place, other)
    r.counters[WAITING] += 1
    r.counters[AIRBORNE] += 1
    return place


@kernel
def _duplicate(
    r: Radio,
    sent: int,
    arrival: int,
    e: int,
    other: int,
    number: int,
    to_system: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> None:
    """Sends, at random, a second copy of a packet that reaches node `other` at `arrival`, up to the jitter later."""
    s, source, sink = r.settings[0], r.endpoints[e].identity, r.nodes[other].identity
    if chance(s.seed, source, sink, number, OF_DUPLICATE) >= s.duplicates:
        return
    again = arrival + int(np.int64(s.jitter * chance(s.seed, source, sink, number, DUPLICATE_JITTER)))
    logged = LOGGED
    for j in range(r.nodes[other].first, r.nodes[other].last):
        if _hears(r, j, to_system):
            put(r, j, again, buf, start, stop, logged, -1)
            logged = 0
    record_event(r, sent, again, e, other, buf, start, stop, DUPLICATE)
    if r.trip.size > 0:
        trace_back(r)


@kernel
def _land(r: Radio, reals: NDArray[np.float64]) -> None:
    """Lets a node take the first packet in the air, pass it on to its endpoints, and send it on if it relays."""
    air = r.settings[0].air
    place = r.endpoints[air].first
    row, n = r.places[place], r.relayed[place].node
    t, to_system, length, logged = row.arrival, row.addressee, row.length, row.logged
    whole = logged != 0
    if whole and not first_time(r, n, r.relayed[place].origin, r.relayed[place].number):
        r.counters[REPEATED] += 1
        r.counters[DELIVERED] += 1
    else:
        here = is_aboard(r, n, to_system)
        for j in range(r.nodes[n].first, r.nodes[n].last):
            if _hears(r, j, to_system):
                put(r, j, t, r.data[place], 0, length, logged, -1)
                logged = 0
        if whole and logged != 0:
            r.counters[DELIVERED] += 1  # to the relay alone
        if whole and is_relay(r, n):
            here = _to_cables(r, t, n, to_system, place) or here
            learn(r, n, system(r.data[place], 0), r.endpoints[row.sender].node)
            if not here and r.relayed[place].hops < r.settings[0].hops:
                continue_trip(r, place)
                send_on(r, reals, t, n, to_system, r.data[place], 0, length)
    take_out(r, air)
    r.counters[WAITING] -= 1
    r.counters[AIRBORNE] -= 1


@kernel
def is_aboard(r: Radio, n: int, to_system: int) -> bool:
    """Returns whether a system has been heard on board of node `n`; False for 0, all systems."""
    found = False
    for j in range(r.nodes[n].first, r.nodes[n].last):
        found = found or (to_system != 0 and r.endpoints[j].heard == to_system)
    return found


@kernel
def _to_cables(r: Radio, t: int, n: int, to_system: int, place: int) -> bool:
    """Sends the packet in `place`, which relay `n` takes at t, to the gateways at its cables, as its router selects.

    Returns:
        Whether its target is behind one of them.
    """
    found = False
    for g in range(r.gateways.size):
        w = r.gateways[g]
        if w.wired < 0 or r.endpoints[w.wired].node != n:
            continue
        if (to_system != 0 or w.quiet != 0) and w.systems[to_system] == 0:
            continue
        found = found or to_system != 0
        relay, sink, length = r.nodes[n].relay, r.endpoints[w.endpoint].node, r.places[place].length
        arrival, outcome = over_link(r, t, g, relay, sink, n)
        if arrival >= 0:
            put(r, w.endpoint, arrival, r.data[place], 0, length, LOGGED, -1)
        record_event(r, t, arrival, relay, sink, r.data[place], 0, length, outcome)
    return found


@kernel
def send_on(
    r: Radio,
    reals: NDArray[np.float64],
    t: int,
    n: int,
    to_system: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> bool:
    """Sends the packet buf[start:stop], which relay `n` has received at t, to the nodes that its router selects."""
    relay = r.nodes[n].relay
    sent = by_radio(r, reals, t, relay, to_system, buf, start, stop)
    if sent:
        r.counters[SENT_ON] += 1
    elif to_system != 0 and next_hop(r, n, to_system) not in (-1, r.trip[0].via):
        record_event(r, t, -1, relay, -1, buf, start, stop, NO_ROUTE)
    return sent


@kernel
def serve_medium(r: Radio, reals: NDArray[np.float64], t: int) -> bool:
    """Routes the packets whose slots, or whose times on the air, have ended by time t [ns], and those at relays.

    Returns:
        False if relays need more free places or rows of events; then some packets remain.
    """
    if r.trip.size > 0:
        return _in_order(r, reals, t)
    place = r.endpoints[r.endpoints.size - 1].first
    while place >= 0 and r.places[place].arrival <= t:
        if r.settings[0].medium == CSMA:
            _take_turn(r, reals)
        else:
            _end_slot(r, reals, r.places[place].arrival)
        place = r.endpoints[r.endpoints.size - 1].first
    return True


@kernel
def _in_order(r: Radio, reals: NDArray[np.float64], t: int) -> bool:
    """Lets packets leave the medium and reach nodes in the order of time, up to t [ns]; False if it needs more room."""
    s, medium = r.settings[0], r.endpoints.size - 1
    while True:
        room = (r.counters[WAITING] - r.counters[AIRBORNE] + 1) * copies(r)
        if r.counters[FREE_PLACES] < room or (s.keep != 0 and r.counters[USED_EVENTS] + room > r.events.size):
            return False
        landing, leaving = r.endpoints[s.air].first, -1 if s.medium < ALOHA else r.endpoints[medium].first
        lands = landing >= 0 and r.places[landing].arrival <= t
        leaves = leaving >= 0 and r.places[leaving].arrival <= t
        if leaves and (not lands or r.places[leaving].arrival <= r.places[landing].arrival):
            if s.medium == CSMA:
                _take_turn(r, reals)
            else:
                _end_slot(r, reals, r.places[leaving].arrival)
        elif lands:
            _land(r, reals)
        else:
            return True


@kernel
def _route_first(r: Radio, reals: NDArray[np.float64], t: int) -> None:
    """Routes the first packet at the medium, which was on the air until t [ns]; loses it if t is negative."""
    medium = r.endpoints.size - 1
    place = r.endpoints[medium].first
    row = r.places[place]
    if r.trip.size > 0:
        resume_trip(r, place)
    transmit(r, reals, row.sent, t, row.sender, row.number, place, row.addressee, r.data[place], 0, row.length)
    take_out(r, medium)
    r.counters[WAITING] -= 1


@kernel
def _take_turn(r: Radio, reals: NDArray[np.float64]) -> None:
    """Lets the first packet at the medium sense it, or routes it if it has left the medium."""
    place = r.endpoints[r.endpoints.size - 1].first
    if on_air(r, place):
        _route_first(r, reals, r.places[place].arrival)
    elif not sense(r, reals, place):
        _route_first(r, reals, -1)


@kernel
def _end_slot(r: Radio, reals: NDArray[np.float64], end: int) -> None:
    """Routes the packets of the slot that has ended at `end`."""
    medium = r.endpoints.size - 1
    listen_to_slot(r, reals, end)
    place = r.endpoints[medium].first
    while place >= 0 and r.places[place].arrival == end:
        _route_first(r, reals, end)
        place = r.endpoints[medium].first
