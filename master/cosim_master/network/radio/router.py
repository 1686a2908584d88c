"""Routing of packets to their receivers: kernels over arrays, called by the stepping loop.

An *endpoint* is a pair of packet ports of one instance (an autopilot, an agent, a ground station); a *node* is the set
of endpoints that share an antenna: those of one vehicle. Endpoints of a node are wired on board, without loss or delay.
By radio (`air`), a packet is sent to the nodes that the topology selects; MAVLink addresses determine the receiving
endpoints there.

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

from cosim.entry import entry
from cosim.kernel import kernel
from cosim.packets import (
    BAD_CRC,
    GOOD,
    INCOMPATIBLE,
    NOTHING,
    TRUNCATED,
    UNKNOWN,
    copy,
    find,
    get_u8,
    has_crc,
    message_id,
    payload_length,
    payload_start,
    system,
    target,
)
from cosim_master.network.radio.air import addressed, by_radio, is_aboard, send_on
from cosim_master.network.radio.link.channel import over_link
from cosim_master.network.radio.queues import log_packet, put, record_event
from cosim_master.network.radio.relays import (
    begin_trip,
    begin_trip_at,
    is_relay,
)
from cosim_master.network.radio.tables import (
    COUNTED,
    GROUND,
    LOGGED,
    MALFORMED,
    NO_ROUTE,
    ON_AIR,
    ON_BOARD,
    POSTED,
    SWARM,
    TURN,
    Radio,
)

__all__ = ["admit", "goes_on_board", "next_packet", "send"]

_HEARERS = 20
"""Bits of TURN that count the nodes to which one packet goes."""


@kernel
def goes_on_board(r: Radio, other: int, heard: int, to_system: int) -> bool:
    """Returns whether an endpoint takes packets for `to_system` from another one of its node; it has heard `heard`."""
    e = r.endpoints[other]
    return bool(e.capacity > 0 and e.reach <= SWARM and (to_system == 0 or heard == to_system or heard == 0))


@kernel
def next_packet(r: Radio, buf: NDArray[np.uint8], p: int, n: int) -> tuple[int, int, int, int]:
    """Returns start and end of the first packet in buf[p:n], its status as `find` does, and its target system."""
    start, stop, status = find(buf, p, n)
    if status in (NOTHING, TRUNCATED):
        return start, stop, status, 0
    to_system, _ = target(buf, start)
    if status == UNKNOWN and r.dialect.size > 0:
        status, to_system = _own_message(r, buf, start)
    return start, stop, status, to_system


@kernel
def _on_board(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """Sends a packet to those of the node's other endpoints that it addresses or that have not been heard yet."""
    n = r.endpoints[e].node
    taken = False
    for other in range(r.nodes[n].first, r.nodes[n].last):
        if other != e and goes_on_board(r, other, r.endpoints[other].heard, to_system):
            put(r, other, t, buf, start, stop, 0, -1)
            taken = True
    if taken:
        record_event(r, t, t, e, n, buf, start, stop, ON_BOARD)
    return taken


@kernel
def _to_gateways(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """Sends a packet to the gateways that hear endpoint e; an addressed one only where its target was heard."""
    taken = False
    reach = r.endpoints[e].reach
    for g in range(r.gateways.size):
        w = r.gateways[g]
        meant = w.wired == e or (w.wired < 0 and reach in (ON_AIR, GROUND))
        if not meant or ((to_system != 0 or w.quiet != 0) and w.systems[to_system] == 0):
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
    if r.nodes[n].elsewhere != 0:
        return True
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
    return bool(addressed(r, endpoint, to_system) or (wired >= 0 and r.endpoints[endpoint].heard == 0))


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


@entry
def admit(r: Radio, reals: NDArray[np.float64], t: int, g: int, buf: NDArray[np.uint8], n: int) -> None:
    """Routes the packets in buf[:n] that gateway g received by time t [ns]. They are complete and have correct CRCs."""
    w = r.gateways[g]
    e = w.endpoint
    p = 0
    turn = 0
    here = r.nodes[r.endpoints[e].node].elsewhere == 0
    while p < n:
        start, stop, status = find(buf, p, n)
        p = stop
        to_system, _ = target(buf, start)
        if status == UNKNOWN:
            _, to_system = _own_message(r, buf, start)
        r.endpoints[e].heard = system(buf, start)
        w.systems[system(buf, start)] = 1
        if here:
            log_packet(r, t, r.endpoints[e].node, 1, buf, start, stop)
        taken = False
        if w.wired >= 0:
            node = r.endpoints[w.wired].node
            taken = _from_gateway(r, t, g, node, to_system, buf, start, stop)
            if r.trip.size > 0 and is_relay(r, node) and not is_aboard(r, node, to_system):
                begin_trip_at(r, e, node, t)
                taken = send_on(r, reals, t, node, to_system, buf, start, stop) or taken
        else:
            for other in range(r.along.size):
                r.counters[TURN] = (turn << _HEARERS) + other
                taken = _from_gateway(r, t, g, other, to_system, buf, start, stop) or taken
        turn += 1
        if not taken and to_system != 0 and here:
            record_event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)


@kernel
def _post(
    r: Radio,
    t: int,
    e: int,
    to_system: int,
    taken: bool,
    by_radio_too: bool,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> bool:
    """Puts a packet into the outbox; returns whether it goes by radio, so that `replay` decides who takes it."""
    n = r.counters[POSTED]
    r.counters[POSTED] = n + 1
    row = r.outbox[n]
    row.time, row.endpoint, row.turn, row.number = t, e, r.counters[TURN], -1
    row.addressee, row.system, row.taken, row.length = to_system, r.endpoints[e].heard, int(taken), stop - start
    if by_radio_too:
        row.number = r.endpoints[e].number
        r.endpoints[e].number += 1
    copy(buf, start, stop, r.posted[n], 0)
    return by_radio_too


@kernel
def send(r: Radio, reals: NDArray[np.float64], t: int, e: int, buf: NDArray[np.uint8], n: int) -> None:
    """Routes the packets in buf[:n] that endpoint `e` has sent at time t [ns]."""
    p = 0
    turn = 0
    while p < n:
        r.counters[TURN] = turn << _HEARERS
        turn += 1
        start, stop, status, to_system = next_packet(r, buf, p, n)
        if start > p and status != NOTHING:
            record_event(r, t, -1, e, r.endpoints[e].node, buf, p, start, MALFORMED)
        if status in (NOTHING, TRUNCATED):
            record_event(r, t, -1, e, r.endpoints[e].node, buf, p if status == NOTHING else start, n, MALFORMED)
            return
        p = stop
        if status in (BAD_CRC, INCOMPATIBLE):
            record_event(r, t, -1, e, r.endpoints[e].node, buf, start, stop, MALFORMED)
            continue
        news = r.endpoints[e].heard != system(buf, start)
        r.endpoints[e].heard = system(buf, start)
        taken = False
        common = r.endpoints[e].reach <= SWARM
        log_packet(r, t, r.endpoints[e].node if common else r.nodes.size, 1, buf, start, stop)
        if common:
            taken = _on_board(r, t, e, to_system, buf, start, stop)
        radio = common and (to_system == 0 or to_system != r.endpoints[e].heard)
        if r.outbox.size > 0:
            if common or news:
                taken = _post(r, t, e, to_system, taken, radio, buf, start, stop if common else start) or taken
        elif radio:
            if r.trip.size > 0:
                begin_trip(r, e, t)
            taken = by_radio(r, reals, t, e, to_system, buf, start, stop) or taken
        if r.gateways.size > 0:
            if r.outbox.size > 0:
                r.counters[TURN] += 1 << (_HEARERS - 1)  # after those to nodes, which `replay` finds
            if _to_gateways(r, t, e, to_system, buf, start, stop):
                if radio and r.outbox.size > 0:
                    r.outbox[r.counters[POSTED] - 1].taken = 1
                taken = True
        if not taken and to_system != 0:
            record_event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)
