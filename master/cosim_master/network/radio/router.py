"""The radio: who hears a packet (router), and if and when (channel). Kernels over arrays, called by the stepping loop.

An *endpoint* is a pair of packet ports of one instance (an autopilot, an agent, a ground station); a *node* is what
shares an antenna: the endpoints of one vehicle. Endpoints of a node are wired on board, without loss or delay. Over
the radio a packet goes to the nodes the topology names; MAVLink addresses decide which endpoints there get it.

A *gateway* is a node of its own behind all others: packets cross there between the simulated network and a socket.
It is heard by, and hears, every node whatever the topology, or, wired, one endpoint alone; by a link of its own. The
other nodes notice nothing of a gateway but the packets that come from it. An instance may have endpoints for gateways
alone, for those on the air or for the one that is wired to it; they are on no bus, and other nodes do not hear them.

Every chance is a function of (seed, sending endpoint, receiving node, number of the packet at its sender) and of
nothing else, so results depend neither on the step size nor on the order in which instances step.

This module knows packets only as bytes with a header; what they mean is not its business.
"""

from __future__ import annotations

from typing import Any, NamedTuple

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
    component,
    find,
    get_u8,
    has_crc,
    message_id,
    payload_length,
    payload_start,
    sequence,
    system,
    target,
)
from cosim_master.network.roles import declared

__all__ = [
    "BROADCAST",
    "CABLE",
    "CHANNEL",
    "COUNTERS",
    "DEFERRED",
    "DEFINITION",
    "DELIVERED",
    "ENDPOINT",
    "EVENT",
    "FREE_PLACE",
    "FREE_PLACES",
    "GATEWAY",
    "GROUND",
    "IN_FLIGHT",
    "LISTED",
    "NEAREST",
    "NEAREST_ON_AXIS",
    "NODE",
    "ON_AIR",
    "OUTCOMES",
    "ROLES",
    "PLACE",
    "SETTINGS",
    "SWARM",
    "USED_EVENTS",
    "USED_LOG",
    "Radio",
    "admit",
    "arrived",
    "copies",
    "deliver",
    "send",
    "sort_along",
]

BROADCAST, NEAREST, NEAREST_ON_AXIS, LISTED = 0, 1, 2, 3
"""Topologies."""

OUTCOMES = ("on board", "radio", "lost: channel", "lost: range", "lost: outage", "lost: no route", "malformed")
ON_BOARD, BY_RADIO, LOST_CHANNEL, LOST_RANGE, LOST_OUTAGE, NO_ROUTE, MALFORMED = range(7)

EVENT = np.dtype(
    [
        ("sent", "i8"),
        ("arrival", "i8"),
        ("source", "i4"),
        ("target", "i4"),
        ("message", "i4"),
        ("system", "i4"),
        ("component", "i4"),
        ("sequence", "i4"),
        ("length", "i4"),
        ("outcome", "i4"),
    ]
)
"""One packet on its way to one node: times in ns (arrival -1 where it is lost), endpoint, node, header, outcome."""


ENDPOINT = np.dtype(
    [
        ("node", "i8"),
        ("identity", "u8"),  # hash of its instance's name
        ("number", "i8"),  # packets it has sent by radio
        ("capacity", "i8"),  # bytes its rx port holds, 0: it has none
        ("heard", "i8"),  # system id of its last packet, 0 before
        ("first", "i8"),  # first and last place in flight to it, -1
        ("last", "i8"),
        ("reach", "i8"),  # ON_AIR, SWARM, GROUND or CABLE
    ]
)
ON_AIR, SWARM, GROUND, CABLE = range(4)
"""Whom an endpoint hears and reaches: bus, other nodes and gateways on the air; the same without gateways; gateways on
the air alone; the gateway that is wired to it alone."""
NODE = np.dtype(
    [
        ("place", "i8", (3,)),  # indices of its position among the real outputs, -1 without one
        ("identity", "u8"),  # hash of its name
        ("first", "i8"),  # its endpoints are first to last - 1
        ("last", "i8"),
        ("listed", "i8"),  # topology LISTED: it sends to the nodes links[listed:unlisted]
        ("unlisted", "i8"),
        ("kind", "i8"),  # as a hearer; nodes of one kind are heard by the same channels
        ("channel", "i8"),  # it sends by channels[channel:unchannelled], and by SETTINGS to hearers of other kinds
        ("unchannelled", "i8"),
    ]
)
SETTINGS = np.dtype(
    [
        ("topology", "i8"),
        ("per_side", "i8"),  # how many nearest nodes (on each side of an axis)
        ("axis", "f8", (3,)),
        ("latency", "i8"),
        ("jitter", "i8"),
        ("loss", "f8"),
        ("range", "f8"),
        ("seed", "u8"),
        ("keep", "i8"),  # write events and logs
    ]
)
CHANNEL = np.dtype(
    [
        ("kind", "i8"),  # of its hearers
        ("latency", "i8"),  # as in SETTINGS
        ("jitter", "i8"),
        ("loss", "f8"),
    ]
)
"""What happens to packets on their way from nodes of one kind to nodes of another, where it is not as in SETTINGS."""
PLACE = np.dtype(
    [
        ("arrival", "i8"),
        ("length", "i8"),
        ("logged", "i8"),  # this copy goes into the receiving node's log; COUNTED: and is the one that is counted
        ("following", "i8"),  # linked lists: the next place
        ("gateway", "i8"),  # by which it came in, -1: by none
    ]
)
"""One packet in flight; its bytes are the same row of `Radio.data`."""

COUNTED, LOGGED = 1, 2
"""Values of PLACE.logged besides 0: a packet by radio counts as delivered, one by wire is logged only."""

DEFINITION = np.dtype([("message", "i8"), ("crc_extra", "i8"), ("target_system", "i8")])
"""What routing a message of the system's own dialect needs; offset of its target_system in the payload, -1."""

GATEWAY = np.dtype(
    [
        ("endpoint", "i8"),  # its own
        ("wired", "i8"),  # the endpoint it is wired to, -1: it is on the air and reaches every node
        ("latency", "i8"),  # of its link, as in SETTINGS
        ("jitter", "i8"),
        ("loss", "f8"),
        ("number", "i8"),  # packets that have gone by its link, either way
        ("waiting", "i8"),  # places in flight that came in by it
        ("systems", "u1", (256,)),  # 1: this system has been heard behind it
    ]
)
"""A node behind which real programs are."""


class Radio(NamedTuple):
    """All of the radio's memory, in few arrays: numba's time to compile grows with their number. Times in ns."""

    settings: NDArray[Any]  # SETTINGS, one row
    endpoints: NDArray[Any]  # ENDPOINT, node by node
    nodes: NDArray[Any]  # NODE
    links: NDArray[np.int64]
    channels: NDArray[Any]  # CHANNEL, by kind of sender, then sorted by kind of hearer
    outages: NDArray[np.int64]  # rows (node, from, until)
    places: NDArray[Any]  # PLACE
    data: NDArray[np.uint8]  # (places, MAX_PACKET)
    order: NDArray[np.int64]  # nodes along the axis, kept sorted
    along: NDArray[np.float64]
    hearers: NDArray[np.int64]  # scratch
    gateways: NDArray[Any]  # GATEWAY
    dialect: NDArray[Any]  # DEFINITION, of the messages that only this system knows
    counters: NDArray[np.int64]  # per outcome, then as named below
    events: NDArray[Any]  # EVENT
    log: NDArray[np.uint8]


ROLES = declared(
    CONSTANT="settings nodes links channels outages dialect",
    STATE="endpoints places data order along counters",
    PASSING="gateways",  # a run with gateways has no checkpoints
    BUFFER="hearers events log",
)
"""Of each array of `Radio`, tables as a whole."""

DELIVERED, DEFERRED, FREE_PLACE, FREE_PLACES, IN_FLIGHT, USED_EVENTS, USED_LOG = range(len(OUTCOMES), len(OUTCOMES) + 7)
"""Places in `Radio.counters`: packets delivered; put off since a port was full; first free place and how many there
are; places in use; rows of events and bytes of log in use."""
COUNTERS = len(OUTCOMES) + 7

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_HEAD = 16
"""Bytes before a packet in the log block: time in ns (8), 2*node + 1 if the node sent it (4), length (4). What goes to
a gateway by a line of its own is in no vehicle's log: its node is one more than there are."""


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
def sort_along(r: Radio, reals: NDArray[np.float64]) -> None:
    """Sort `order` by position along the axis; nearly sorted from the last time, ties by node number."""
    for n in range(r.along.size):
        s = 0.0
        for i in range(3):
            s += r.settings[0].axis[i] * reals[r.nodes[n].place[i]]
        r.along[n] = s
    for i in range(1, r.order.size):
        n = r.order[i]
        j = i - 1
        while j >= 0 and (r.along[r.order[j]] > r.along[n] or (r.along[r.order[j]] == r.along[n] and r.order[j] > n)):
            r.order[j + 1] = r.order[j]
            j -= 1
        r.order[j + 1] = n


@kernel
def _distance2(r: Radio, reals: NDArray[np.float64], a: int, b: int) -> float:
    total = 0.0
    for i in range(3):
        d = reals[r.nodes[a].place[i]] - reals[r.nodes[b].place[i]]
        total += d * d
    return total


@kernel
def _nearest(r: Radio, reals: NDArray[np.float64], n: int) -> int:
    """The nodes nearest to `n` into `hearers`, nearest first, ties by node number; returns how many."""
    per_side = r.settings[0].per_side
    found = 0
    for other in range(r.along.size):
        if other == n:
            continue
        d = _distance2(r, reals, n, other)
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
def _hearers(r: Radio, reals: NDArray[np.float64], n: int) -> int:
    """Nodes that the topology lets hear node `n`, into `hearers`; returns how many."""
    topology, per_side = r.settings[0].topology, r.settings[0].per_side
    found = 0
    if topology == LISTED:
        for j in range(r.nodes[n].listed, r.nodes[n].unlisted):
            r.hearers[found] = r.links[j]
            found += 1
    elif topology == NEAREST:
        found = _nearest(r, reals, n)
    elif topology == NEAREST_ON_AXIS:
        at = 0
        while r.order[at] != n:
            at += 1
        for j in range(max(0, at - per_side), min(r.order.size, at + per_side + 1)):
            if j != at:
                r.hearers[found] = r.order[j]
                found += 1
    else:
        for other in range(r.along.size):
            if other != n:
                r.hearers[found] = other
                found += 1
    return found


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
def _out(r: Radio, n: int, t: int) -> bool:
    for j in range(r.outages.shape[0]):  # noqa: SIM110 (numba has no generators)
        if r.outages[j, 0] == n and r.outages[j, 1] <= t < r.outages[j, 2]:
            return True
    return False


@kernel
def _put(
    r: Radio, endpoint: int, arrival: int, buf: NDArray[np.uint8], start: int, stop: int, logged: int, gateway: int
) -> None:
    """Into the queue of `endpoint`, behind everything that arrives no later."""
    place = r.counters[FREE_PLACE]
    r.counters[FREE_PLACE] = r.places[place].following
    r.counters[FREE_PLACES] -= 1
    r.counters[IN_FLIGHT] += 1
    for i in range(start, stop):
        r.data[place, i - start] = buf[i]
    r.places[place].length = stop - start
    r.places[place].arrival = arrival
    r.places[place].logged = logged
    r.places[place].gateway = gateway
    last = r.endpoints[endpoint].last
    if last >= 0 and r.places[last].arrival <= arrival:
        r.places[place].following = -1
        r.places[last].following = place
        r.endpoints[endpoint].last = place
        return
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


@kernel
def _log_packet(r: Radio, t: int, n: int, sent: int, buf: NDArray[np.uint8], start: int, stop: int) -> None:
    if r.settings[0].keep == 0:
        return
    p = r.counters[USED_LOG]
    entry = 2 * n + sent
    for i in range(8):
        r.log[p + i] = (t >> 8 * i) & 0xFF
    for i in range(4):
        r.log[p + 8 + i] = (entry >> 8 * i) & 0xFF
        r.log[p + 12 + i] = ((stop - start) >> 8 * i) & 0xFF
    for i in range(start, stop):
        r.log[p + _HEAD + i - start] = buf[i]
    r.counters[USED_LOG] = p + _HEAD + stop - start


@kernel
def _event(
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
    r.counters[USED_EVENTS] += 1


@kernel
def _addressed(r: Radio, endpoint: int, to_system: int) -> bool:
    """MAVLink routing: broadcasts to everybody, the rest to where the system has been heard."""
    return bool(to_system == 0 or r.endpoints[endpoint].heard == to_system)


@kernel
def _hears(r: Radio, endpoint: int, to_system: int) -> bool:
    """Whether an endpoint takes what another node sends to `to_system`."""
    e = r.endpoints[endpoint]
    return bool(e.capacity > 0 and e.reach <= SWARM and _addressed(r, endpoint, to_system))


@kernel
def _on_board(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """To the other endpoints of the node. An endpoint not heard yet gets what is addressed: the bus is shared."""
    n = r.endpoints[e].node
    taken = False
    for other in range(r.nodes[n].first, r.nodes[n].last):
        if (
            other != e
            and r.endpoints[other].capacity > 0
            and r.endpoints[other].reach <= SWARM
            and (_addressed(r, other, to_system) or r.endpoints[other].heard == 0)
        ):
            _put(r, other, t, buf, start, stop, 0, -1)
            taken = True
    if taken:
        _event(r, t, t, e, n, buf, start, stop, ON_BOARD)
    return taken


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
    """To the nodes of the topology, through the channel."""
    s = r.settings[0]
    n = r.endpoints[e].node
    hearers = _hearers(r, reals, n)
    number = r.endpoints[e].number
    r.endpoints[e].number = number + 1
    identity = r.endpoints[e].identity
    latency, jitter, loss = s.latency, s.jitter, s.loss
    taken = False
    for i in range(hearers):
        other = r.hearers[i]
        wanted = False
        for j in range(r.nodes[other].first, r.nodes[other].last):
            wanted = wanted or _hears(r, j, to_system)
        if not wanted:
            continue
        taken = True
        if r.channels.size > 0:
            latency, jitter, loss = _channel(r, n, other)
        arrival = t + latency
        if jitter > 0:
            arrival += int(np.int64(jitter * chance(s.seed, identity, r.nodes[other].identity, number, 1)))
        if _out(r, n, t) or _out(r, other, arrival):
            _event(r, t, -1, e, other, buf, start, stop, LOST_OUTAGE)
        elif s.range < np.inf and _distance2(r, reals, n, other) > s.range * s.range:
            _event(r, t, -1, e, other, buf, start, stop, LOST_RANGE)
        elif loss > 0.0 and chance(s.seed, identity, r.nodes[other].identity, number, 0) < loss:
            _event(r, t, -1, e, other, buf, start, stop, LOST_CHANNEL)
        else:
            logged = COUNTED
            for j in range(r.nodes[other].first, r.nodes[other].last):
                if _hears(r, j, to_system):
                    _put(r, j, arrival, buf, start, stop, logged, -1)
                    logged = 0
            _event(r, t, arrival, e, other, buf, start, stop, BY_RADIO)
    return taken


@kernel
def _over_link(r: Radio, t: int, g: int, source: int, sink: int, n: int) -> tuple[int, int]:
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
    if w.wired < 0 and _out(r, n, t if sink != n else arrival):
        return -1, LOST_OUTAGE
    if w.loss > 0.0 and chance(seed, identity, hearer, number, 0) < w.loss:
        return -1, LOST_CHANNEL
    return arrival, ON_BOARD if w.wired >= 0 else BY_RADIO


@kernel
def _to_gateways(r: Radio, t: int, e: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int) -> bool:
    """From endpoint e to the gateways that hear it, of an addressed packet to those behind which its system is."""
    taken = False
    reach = r.endpoints[e].reach
    for g in range(r.gateways.size):
        w = r.gateways[g]
        meant = w.wired == e or (w.wired < 0 and reach in (ON_AIR, GROUND))
        if not meant or (to_system != 0 and w.systems[to_system] == 0):
            continue
        taken = True
        sink = r.endpoints[w.endpoint].node
        arrival, outcome = _over_link(r, t, g, e, sink, r.endpoints[e].node)
        if arrival >= 0:
            _put(r, w.endpoint, arrival, buf, start, stop, LOGGED if outcome == ON_BOARD else COUNTED, -1)
        _event(r, t, arrival, e, sink, buf, start, stop, outcome)
    return taken


@kernel
def _from_gateway(
    r: Radio, t: int, g: int, n: int, to_system: int, buf: NDArray[np.uint8], start: int, stop: int
) -> bool:
    """To the endpoints of node n that its address means, or to the one that gateway g is wired to."""
    w = r.gateways[g]
    wanted = False
    for j in range(r.nodes[n].first, r.nodes[n].last):
        wanted = wanted or _wants(r, g, j, to_system)
    if not wanted:
        return False
    arrival, outcome = _over_link(r, t, g, w.endpoint, n, n)
    _event(r, t, arrival, w.endpoint, n, buf, start, stop, outcome)
    logged = 0 if outcome == ON_BOARD else COUNTED
    for j in range(r.nodes[n].first, r.nodes[n].last):
        if arrival >= 0 and _wants(r, g, j, to_system):
            _put(r, j, arrival, buf, start, stop, logged, g)
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
    """Status of a packet that `find` calls UNKNOWN, and whom it is for: known if it is of the system's own dialect."""
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
    """Route what has come in by gateway g: the packets in buf[:n], complete and with a right CRC, at time t [ns]."""
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
        _log_packet(r, t, r.endpoints[e].node, 1, buf, start, stop)
        taken = False
        if w.wired >= 0:
            taken = _from_gateway(r, t, g, r.endpoints[w.wired].node, to_system, buf, start, stop)
        else:
            for other in range(r.along.size):
                taken = _from_gateway(r, t, g, other, to_system, buf, start, stop) or taken
        if not taken and to_system != 0:
            _event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)


@kernel
def send(r: Radio, reals: NDArray[np.float64], t: int, e: int, buf: NDArray[np.uint8], n: int) -> None:
    """Route what endpoint `e` has sent: the packets in buf[:n], at time t [ns]."""
    p = 0
    while p < n:
        start, stop, status = find(buf, p, n)
        if start > p and status != NOTHING:
            _event(r, t, -1, e, r.endpoints[e].node, buf, p, start, MALFORMED)
        if status in (NOTHING, TRUNCATED):
            _event(r, t, -1, e, r.endpoints[e].node, buf, p if status == NOTHING else start, n, MALFORMED)
            return
        p = stop
        to_system, _ = target(buf, start)
        if status == UNKNOWN and r.dialect.size > 0:
            status, to_system = _own_message(r, buf, start)
        if status in (BAD_CRC, INCOMPATIBLE):
            _event(r, t, -1, e, r.endpoints[e].node, buf, start, stop, MALFORMED)
            continue
        r.endpoints[e].heard = system(buf, start)
        taken = False
        common = r.endpoints[e].reach <= SWARM
        _log_packet(r, t, r.endpoints[e].node if common else r.nodes.size, 1, buf, start, stop)
        if common:
            taken = _on_board(r, t, e, to_system, buf, start, stop)
        if common and (to_system == 0 or to_system != r.endpoints[e].heard):
            taken = _by_radio(r, reals, t, e, to_system, buf, start, stop) or taken
        if r.gateways.size > 0:
            taken = _to_gateways(r, t, e, to_system, buf, start, stop) or taken
        if not taken and to_system != 0:
            _event(r, t, -1, e, -1, buf, start, stop, NO_ROUTE)


@kernel
def deliver(r: Radio, t: int, e: int, buf: NDArray[np.uint8]) -> int:
    """Take what has reached endpoint `e` by time t [ns] into `buf`; returns the bytes. What does not fit waits."""
    n = 0
    while r.endpoints[e].first >= 0 and r.places[r.endpoints[e].first].arrival <= t:
        place = r.endpoints[e].first
        length = r.places[place].length
        if n + length > r.endpoints[e].capacity:
            r.counters[DEFERRED] += 1
            break
        for i in range(length):
            buf[n + i] = r.data[place, i]
        if r.places[place].logged != 0:
            if r.endpoints[e].reach <= SWARM:
                _log_packet(r, t, r.endpoints[e].node, 0, buf, n, n + length)
            if r.places[place].logged == COUNTED:
                r.counters[DELIVERED] += 1
        if r.places[place].gateway >= 0:
            r.gateways[r.places[place].gateway].waiting -= 1
        n += length
        r.endpoints[e].first = r.places[place].following
        if r.endpoints[e].first < 0:
            r.endpoints[e].last = -1
        r.places[place].following = r.counters[FREE_PLACE]
        r.counters[FREE_PLACE] = place
        r.counters[FREE_PLACES] += 1
        r.counters[IN_FLIGHT] -= 1
    return n


@kernel
def arrived(endpoints: NDArray[Any], places: NDArray[Any], t: int, e: int) -> bool:
    """Whether something has reached endpoint `e` by time t [ns]. Asked of every endpoint in every step."""
    first = endpoints[e].first
    return bool(first >= 0 and places[first].arrival <= t)


@kernel
def copies(r: Radio) -> int:
    """No packet takes more places in flight than this, or makes more events together with the garbage before it."""
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
    return int((max(reach, 1) + 1) * widest + r.gateways.size)
