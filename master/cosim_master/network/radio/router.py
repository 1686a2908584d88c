"""Routing of packets to their receivers: kernels over arrays, called by the stepping loop.

An *endpoint* is a pair of packet ports of one instance (an autopilot, an agent, a ground station); a *node* is the set
of endpoints that share an antenna: those of one vehicle. Endpoints of a node are wired on board, without loss or delay.
By radio, a packet is sent to the nodes that the topology selects; MAVLink addresses determine the receiving endpoints
there.

A *gateway* is a separate node, numbered after all others, at which packets cross between the simulated network and a
socket. It has its own link. By this link, it exchanges packets with every node whatever the topology, or, if wired,
with a single endpoint. Apart from its packets, a gateway does not affect other nodes. An instance may have endpoints
for gateways only, either for gateways on the air or for a wired one. Such endpoints are not on a bus, and other nodes
do not hear them.

Every random number is a function of (seed, sending endpoint, receiving node, number of the packet at its sender) only,
so results depend neither on the step size nor on the order in which instances step.

This module interprets only the headers of packets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim.packets import (
    BAD_CRC,
    GOOD,
    INCOMPATIBLE,
    NOTHING,
    TRUNCATED,
    UNKNOWN,
    find,
    get_u8,
    has_crc,
    message_id,
    payload_length,
    payload_start,
    system,
    target,
)
from cosim_master.network.radio.chances import DUPLICATE as OF_DUPLICATE
from cosim_master.network.radio.chances import DUPLICATE_JITTER, chance
from cosim_master.network.radio.channel import over_link, over_radio
from cosim_master.network.radio.effects import damage, first_error
from cosim_master.network.radio.medium import (
    collided,
    departure,
    listen_to_slot,
    next_slot_over,
    on_air,
    sense,
    wait_for_medium,
)
from cosim_master.network.radio.queues import log_packet, put, record_event, take_out
from cosim_master.network.radio.tables import (
    ALOHA,
    BY_RADIO,
    COUNTED,
    CSMA,
    DUPLICATE,
    GROUND,
    LOGGED,
    LOST_COLLISION,
    LOST_ERRORS,
    LOST_QUEUE,
    MALFORMED,
    NO_ROUTE,
    ON_AIR,
    ON_BOARD,
    OWN,
    SHARED,
    SWARM,
    WAITING,
    Radio,
)
from cosim_master.network.radio.topology import find_hearers

__all__ = ["admit", "send", "serve_medium"]


@kernel
def _addressed(r: Radio, endpoint: int, to_system: int) -> bool:
    """Returns whether a packet goes to an endpoint: it is a broadcast, or its target system was heard there."""
    return bool(to_system == 0 or r.endpoints[endpoint].heard == to_system)


@kernel
def _hears(r: Radio, endpoint: int, to_system: int) -> bool:
    """Returns whether an endpoint accepts packets that another node sends to `to_system`."""
    e = r.endpoints[endpoint]
    return bool(e.capacity > 0 and e.reach <= SWARM and _addressed(r, endpoint, to_system))


@kernel
def _on_board(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """Sends a packet to those of the node's other endpoints that it addresses or that have not been heard yet."""
    n = r.endpoints[e].node
    taken = False
    for other in range(r.nodes[n].first, r.nodes[n].last):
        if (
            other != e
            and r.endpoints[other].capacity > 0
            and r.endpoints[other].reach <= SWARM
            and (_addressed(r, other, to_system) or r.endpoints[other].heard == 0)
        ):
            put(r, other, t, buf, start, stop, 0, -1)
            taken = True
    if taken:
        record_event(r, t, t, e, n, buf, start, stop, ON_BOARD)
    return taken


@kernel
def _wanted(r: Radio, other: int, to_system: int) -> bool:
    """Returns whether an endpoint of a node accepts packets that another node sends to `to_system`."""
    wanted = False
    for j in range(r.nodes[other].first, r.nodes[other].last):
        wanted = wanted or _hears(r, j, to_system)
    return wanted


@kernel
def _by_radio(
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
        return _transmit(r, reals, t, t, e, number, -1, to_system, buf, start, stop)
    taken = False
    waits = True
    for i in range(find_hearers(r, reals, n)):
        if _wanted(r, r.hearers[i], to_system):
            if not taken:
                waits = wait_for_medium(r, t, e, number, to_system, buf, start, stop)
            taken = True
            if not waits:
                record_event(r, t, -1, e, r.hearers[i], buf, start, stop, LOST_QUEUE)
    return taken


@kernel
def _transmit(
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
    taken = False
    for i in range(hearers):
        other = r.hearers[i]
        if not _wanted(r, other, to_system):
            continue
        if not taken and s.medium in (OWN, SHARED):
            t = departure(r, t, n, stop - start)
        taken = True
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
            for j in range(r.nodes[other].first, r.nodes[other].last):
                if _hears(r, j, to_system):
                    copy = put(r, j, arrival, buf, start, stop, logged, -1)
                    if wrong:
                        damage(r, copy, e, other, number)
                    logged = 0
            if wrong:
                arrival, outcome = -1, LOST_ERRORS
        record_event(r, sent, arrival, e, other, buf, start, stop, outcome)
        if outcome == BY_RADIO and s.duplicates > 0.0:
            _duplicate(r, sent, arrival, e, other, number, to_system, buf, start, stop)
    return taken


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


@kernel
def serve_medium(r: Radio, reals: NDArray[np.float64], t: int) -> None:
    """Routes the packets whose slots, or whose times on the air, have ended by time t [ns]."""
    if r.settings[0].medium == CSMA:
        _take_turns(r, reals, t)
    else:
        _end_slots(r, reals, t)


@kernel
def _route_first(r: Radio, reals: NDArray[np.float64], t: int) -> None:
    """Routes the first packet at the medium, which was on the air until t [ns]; loses it if t is negative."""
    medium = r.endpoints.size - 1
    place = r.endpoints[medium].first
    row = r.places[place]
    _transmit(r, reals, row.sent, t, row.sender, row.number, place, row.addressee, r.data[place], 0, row.length)
    take_out(r, medium)
    r.counters[WAITING] -= 1


@kernel
def _take_turns(r: Radio, reals: NDArray[np.float64], t: int) -> None:
    """Lets packets sense the medium, and routes those that have left it, in the order of time up to t [ns]."""
    medium = r.endpoints.size - 1
    place = r.endpoints[medium].first
    while place >= 0 and r.places[place].arrival <= t:
        if on_air(r, place):
            _route_first(r, reals, r.places[place].arrival)
        elif not sense(r, reals, place):
            _route_first(r, reals, -1)
        place = r.endpoints[medium].first


@kernel
def _end_slots(r: Radio, reals: NDArray[np.float64], t: int) -> None:
    """Routes the packets of slots that have ended by time t [ns]."""
    medium = r.endpoints.size - 1
    end = next_slot_over(r, t)
    while end >= 0:
        listen_to_slot(r, reals, end)
        place = r.endpoints[medium].first
        while place >= 0 and r.places[place].arrival == end:
            _route_first(r, reals, end)
            place = r.endpoints[medium].first
        end = next_slot_over(r, t)


@kernel
def _to_gateways(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """Sends a packet to the gateways that hear endpoint e; an addressed one only where its target was heard."""
    taken = False
    reach = r.endpoints[e].reach
    for g in range(r.gateways.size):
        w = r.gateways[g]
        meant = w.wired == e or (w.wired < 0 and reach in (ON_AIR, GROUND))
        if not meant or (to_system != 0 and w.systems[to_system] == 0):
            continue
        taken = True
        sink = r.endpoints[w.endpoint].node
        arrival, outcome = over_link(r, t, g, e, sink, r.endpoints[e].node)
        if arrival >= 0:
            put(r, w.endpoint, arrival, buf, start, stop, LOGGED if outcome == ON_BOARD else COUNTED, -1)
        record_event(r, t, arrival, e, sink, buf, start, stop, outcome)
    return taken


@kernel
def _from_gateway(
    r: Radio, t: int, g: int, n: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int
) -> bool:
    """Sends a packet of gateway g to the addressed endpoints of node n, or to the endpoint that g is wired to."""
    w = r.gateways[g]
    wanted = False
    for j in range(r.nodes[n].first, r.nodes[n].last):
        wanted = wanted or _wants(r, g, j, to_system)
    if not wanted:
        return False
    arrival, outcome = over_link(r, t, g, w.endpoint, n, n)
    record_event(r, t, arrival, w.endpoint, n, buf, start, stop, outcome)
    logged = 0 if outcome == ON_BOARD else COUNTED
    for j in range(r.nodes[n].first, r.nodes[n].last):
        if arrival >= 0 and _wants(r, g, j, to_system):
            put(r, j, arrival, buf, start, stop, logged, g)
            w.waiting += 1
            logged = 0
    return True


@kernel
def _wants(r: Radio, g: int, endpoint: int, to_system: int) -> bool:
    wired = r.gateways[g].wired
    reach = r.endpoints[endpoint].reach
    meant = wired == endpoint or (wired < 0 and reach in (ON_AIR, GROUND))
    if r.endpoints[endpoint].capacity == 0 or not meant:
        return False
    return bool(_addressed(r, endpoint, to_system) or (wired >= 0 and r.endpoints[endpoint].heard == 0))


@kernel
def _own_message(r: Radio, buf: NDArray[np.uint8], start: int) -> tuple[int, int]:
    """Returns status and target system of a packet that `find` calls UNKNOWN but the system's dialect may define."""
    message = message_id(buf, start)
    for d in range(r.dialect.size):
        if r.dialect[d].message != message:
            continue
        if not has_crc(buf, start, r.dialect[d].crc_extra):
            return BAD_CRC, 0
        offset = r.dialect[d].target_system
        if 0 <= offset < payload_length(buf, start):
            return GOOD, get_u8(buf, payload_start(buf, start) + offset)
        return GOOD, 0
    return UNKNOWN, 0


@kernel
def admit(r: Radio, t: int, g: int, buf: NDArray[np.uint8], n: int) -> None:
    """Routes the packets in buf[:n] that gateway g received by time t [ns]. They are complete and have correct CRCs."""
    w = r.gateways[g]
    e = w.endpoint
    p = 0
    while p < n:
        start, stop, status = find(buf, p, n)
        p = stop
        to_system, _ = target(buf, start)
        if status == UNKNOWN:
            _, to_system = _own_message(r, buf, start)
        r.endpoints[e].heard = system(buf, start)
        w.systems[system(buf, start)] = 1
        log_packet(r, t, r.endpoints[e].node, 1, buf, start, stop)
        taken = False
        if w.wired >= 0:
            taken = _from_gateway(r, t, g, r.endpoints[w.wired].node, to_system, buf, start, stop)
        else:
            for other in range(r.along.size):
                taken = _from_gateway(r, t, g, other, to_system, buf, start, stop) or taken
        if not taken and to_system != 0:
            record_event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)


@kernel
def send(r: Radio, reals: NDArray[np.float64], t: int, e: int, buf: NDArray[np.uint8], n: int) -> None:
    """Routes the packets in buf[:n] that endpoint `e` has sent at time t [ns]."""
    p = 0
    while p < n:
        start, stop, status = find(buf, p, n)
        if start > p and status != NOTHING:
            record_event(r, t, -1, e, r.endpoints[e].node, buf, p, start, MALFORMED)
        if status in (NOTHING, TRUNCATED):
            record_event(r, t, -1, e, r.endpoints[e].node, buf, p if status == NOTHING else start, n, MALFORMED)
            return
        p = stop
        to_system, _ = target(buf, start)
        if status == UNKNOWN and r.dialect.size > 0:
            status, to_system = _own_message(r, buf, start)
        if status in (BAD_CRC, INCOMPATIBLE):
            record_event(r, t, -1, e, r.endpoints[e].node, buf, start, stop, MALFORMED)
            continue
        r.endpoints[e].heard = system(buf, start)
        taken = False
        common = r.endpoints[e].reach <= SWARM
        log_packet(r, t, r.endpoints[e].node if common else r.nodes.size, 1, buf, start, stop)
        if common:
            taken = _on_board(r, t, e, to_system, buf, start, stop)
        if common and (to_system == 0 or to_system != r.endpoints[e].heard):
            taken = _by_radio(r, reals, t, e, to_system, buf, start, stop) or taken
        if r.gateways.size > 0:
            taken = _to_gateways(r, t, e, to_system, buf, start, stop) or taken
        if not taken and to_system != 0:
            record_event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)
