"""The radio's memory: a few flat arrays, the types of their rows, and the codes used in them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim_master.network.roles import declared

__all__ = [
    "AIRBORNE",
    "ALOHA",
    "BROADCAST",
    "BY_RADIO",
    "CABLE",
    "CHANNEL",
    "COUNTED",
    "COUNTERS",
    "CSMA",
    "DEFERRED",
    "DEFINITION",
    "DELIVERED",
    "DUPLICATE",
    "ENDPOINT",
    "EVENT",
    "FREE_PLACE",
    "FREE_PLACES",
    "GATEWAY",
    "GROUND",
    "IN_FLIGHT",
    "LISTED",
    "LOGGED",
    "LOST_BURST",
    "LOST_CHANNEL",
    "LOST_COLLISION",
    "LOST_ERRORS",
    "LOST_JAMMED",
    "LOST_OWN",
    "LOST_OUTAGE",
    "LOST_PARTITION",
    "LOST_QUEUE",
    "LOST_RANGE",
    "LOST_SIGNAL",
    "LOST_TRACE",
    "MALFORMED",
    "NEAREST",
    "NEAREST_ON_AXIS",
    "NODE",
    "NO_ROUTE",
    "ON_AIR",
    "ON_BOARD",
    "OUTCOMES",
    "OWN",
    "PLACE",
    "POST",
    "POSTED",
    "RELAYED",
    "REPEATED",
    "ROLES",
    "SENT_ON",
    "Radio",
    "SETTINGS",
    "SHARED",
    "SWARM",
    "TRACED",
    "TURN",
    "USED_EVENTS",
    "USED_LOG",
    "WAITING",
]

BROADCAST, NEAREST, NEAREST_ON_AXIS, LISTED = 0, 1, 2, 3
"""Topologies."""


OWN, SHARED, ALOHA, CSMA = 1, 2, 3, 4
"""Media; 0: packets take no time on the air."""


OUTCOMES = (
    "on board",
    "radio",
    "lost: channel",
    "lost: range",
    "lost: outage",
    "lost: no route",
    "malformed",
    "lost: burst",
    "lost: signal",
    "lost: jammed",
    "lost: partition",
    "lost: errors",
    "lost: queue",
    "lost: collision",
    "duplicate",
    "lost: trace",
    "lost: own channel",
)


ON_BOARD, BY_RADIO, LOST_CHANNEL, LOST_RANGE, LOST_OUTAGE, NO_ROUTE, MALFORMED = range(7)
LOST_BURST, LOST_SIGNAL, LOST_JAMMED, LOST_PARTITION, LOST_ERRORS, LOST_QUEUE, LOST_COLLISION, DUPLICATE = range(7, 15)
LOST_TRACE, LOST_OWN = 15, 16


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
        ("origin", "i8"),
        ("born", "i8"),
        ("order", "i8"),
    ]
)
"""One packet on its way to one node: times in ns (arrival -1 if it is lost), endpoint, node, header, outcome.

`origin` and `born` are the endpoint that sent it first, and when: not `source` and `sent` if a relay sends it on.
`order`: among the events of one endpoint at one time, see TURN.
"""


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
"""The endpoints that an endpoint hears and reaches: bus, other nodes and gateways on the air; the same without
gateways; only gateways on the air; only the gateway that is wired to it.
"""


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
        ("relay", "i8"),  # the endpoint by which it sends packets on, -1: it does not relay
        ("elsewhere", "i8"),  # 1: its instances are in another part of the run; 2: and it is out of reach
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
        ("effects", "u1"),  # 1: an own channel, or one of the effects up to bit_errors, is on for some link
        ("burst_start", "f8"),
        ("burst_end", "f8"),
        ("burst_loss", "f8"),
        ("power", "f8"),  # dBm
        ("sensitivity", "f8"),  # dBm; -inf: signals have no strength
        ("path_loss", "f8"),  # dB at 1 m
        ("exponent", "f8"),
        ("shadowing", "f8"),  # dB
        ("rayleigh", "u1"),
        ("bit_errors", "f8"),
        ("duplicates", "f8"),
        ("medium", "u1"),  # OWN, SHARED, ALOHA, CSMA or 0
        ("rate", "f8"),  # baud
        ("queue", "i8"),
        ("slot", "i8"),
        ("window", "f8"),  # slots
        ("backoff", "i8"),
        ("sensing", "i8"),
        ("seed", "u8"),
        ("own", "u8"),  # address of the function of an own channel, 0: none
        ("air", "i8"),  # the endpoint of packets on their way, if there are relays; -1
        ("hops", "i8"),  # relays that a packet passes at most
        ("keep", "i8"),  # write events and logs
    ]
)


CHANNEL = np.dtype(
    [
        ("kind", "i8"),  # of its hearers
        ("latency", "i8"),  # as in SETTINGS
        ("jitter", "i8"),
        ("loss", "f8"),
        ("burst_start", "f8"),
        ("burst_end", "f8"),
        ("burst_loss", "f8"),
    ]
)
"""The channel from nodes of one kind to nodes of another, if it differs from SETTINGS."""


PLACE = np.dtype(
    [
        ("arrival", "i8"),
        ("length", "i8"),
        ("logged", "i8"),  # this copy is written to the receiving node's log; COUNTED: it is also counted
        ("following", "i8"),  # linked lists: the next place
        ("gateway", "i8"),  # by which it entered, -1: none
        ("sender", "i8"),  # of a packet that waits for the medium, or is on the way to a relay: the endpoint,
        ("number", "i8"),  # its number there,
        ("sent", "i8"),  # when,
        ("addressee", "i8"),  # and the system that it is for
    ]
)
"""One packet in flight; its bytes are the same row of `Radio.data`. The last four columns are for the medium and
for relays only.
"""


RELAYED = np.dtype(
    [
        ("origin", "i8"),  # the endpoint that sent it first
        ("born", "i8"),  # when, ns
        ("number", "i8"),  # of the packet there
        ("via", "i8"),  # the node from which its sender received it, -1: none
        ("hops", "i8"),  # relays that it has passed
        ("node", "i8"),  # for which it is on its way
    ]
)
"""The journey of a packet in flight, if there are relays: see `relays`."""


POST = np.dtype(
    [
        ("time", "i8"),
        ("endpoint", "i8"),
        ("number", "i8"),  # at its sender, -1: it does not go by radio
        ("turn", "i8"),  # see TURN
        ("addressee", "i8"),
        ("system", "i8"),  # that sent it
        ("taken", "i8"),  # 1: another endpoint of the same node has taken it
        ("length", "i8"),
    ]
)
"""A packet that a part of a run has sent, for all parts; its bytes are the same row of `Radio.posted`."""


COUNTED, LOGGED = 1, 2
"""Values of PLACE.logged other than 0: a packet by radio counts as delivered, a packet by wire is only logged. With
CSMA, LOGGED marks a packet at the medium that is on the air.
"""


TRACED = np.dtype([("sender", "i8"), ("hearer", "i8"), ("time", "i8"), ("delay", "i8"), ("delivered", "f8")])
"""A row of the trace file: nodes, times in ns, probability of delivery."""


DEFINITION = np.dtype([("message", "i8"), ("crc_extra", "i8"), ("target_system", "i8")])
"""A message of the system's own dialect, as required for routing; offset of its target_system in the payload, or -1."""


GATEWAY = np.dtype(
    [
        ("endpoint", "i8"),  # its own
        ("wired", "i8"),  # the endpoint it is wired to, -1: it is on the air and reaches every node
        ("latency", "i8"),  # of its link, as in SETTINGS
        ("jitter", "i8"),
        ("loss", "f8"),
        ("number", "i8"),  # packets that have gone by its link, either way
        ("waiting", "i8"),  # packets in flight that entered by it
        ("quiet", "u1"),  # 1: it hears only packets addressed to the systems behind it
        ("systems", "u1", (256,)),  # 1: this system has been heard behind it
    ]
)
"""A node that represents real programs."""


class Radio(NamedTuple):
    """The radio's memory in a few arrays, since numba's compile time grows with their number. Times in ns.

    Tables, whose comments name the type of their rows, are Any, as in `Plan`.
    """

    settings: Any  # SETTINGS, one row
    endpoints: Any  # ENDPOINT, node by node
    nodes: Any  # NODE
    links: NDArray[np.int64]
    channels: Any  # CHANNEL, by kind of sender, then sorted by kind of hearer
    outages: NDArray[np.int64]  # rows (node, from, until)
    partitions: NDArray[np.int64]  # rows (from, until, side of each node)
    jamming: NDArray[np.float64]  # rows (north, east, radius [m], from, until)
    obstacles: NDArray[np.float64]  # rows: see `obstacles`
    trace: Any  # TRACED, sorted by sender, hearer and time
    packet: Any  # PACKET (`cosim.channel`), one row if there is an own channel
    media: NDArray[np.int64]  # none, or rows of one number per node: see `medium`
    places: Any  # PLACE
    data: NDArray[np.uint8]  # (places, MAX_PACKET)
    relayed: Any  # RELAYED, one row per place if there are relays, as are the next three
    trip: Any  # RELAYED, one row: the packet that is being sent
    routes: NDArray[np.int64]  # (nodes, 256), the neighbour from which a node last heard a system, plus 1
    seen: NDArray[np.int64]  # for each node and endpoint: latest packet plus 1, and the set of packets before it
    order: NDArray[np.int64]  # nodes along the axis, kept sorted; then the place of each node among these
    along: NDArray[np.float64]
    hearers: NDArray[np.int64]  # scratch
    gateways: Any  # GATEWAY
    dialect: Any  # DEFINITION, of the messages that only this system defines
    counters: NDArray[np.int64]  # per outcome, then as named below
    events: Any  # EVENT
    log: NDArray[np.uint8]
    outbox: Any  # POST, only in a part of a run: packets wait there for `replay`
    posted: NDArray[np.uint8]  # (outbox, MAX_PACKET)


ROLES = declared(
    CONSTANT="settings nodes links channels outages partitions jamming obstacles trace dialect",
    STATE="endpoints places data relayed routes seen order along counters media",
    PASSING="gateways",  # a run with gateways has no checkpoints
    BUFFER="hearers packet trip events log outbox posted",
)
"""The role of each array of `Radio`; tables have a single role."""


_FIRST = len(OUTCOMES)
DELIVERED, DEFERRED, FREE_PLACE, FREE_PLACES, IN_FLIGHT, USED_EVENTS, USED_LOG, WAITING = range(_FIRST, _FIRST + 8)
AIRBORNE, SENT_ON, REPEATED, TURN, POSTED = range(_FIRST + 8, _FIRST + 13)
"""Places in `Radio.counters`: packets delivered; packets deferred because a port was full; first free place and number
of free places; places in use; rows of events and bytes of log in use; packets that wait for the medium or
are in the air; those in the air (if there are relays); packets that relays have sent on; copies of packets that their
receiver had taken before; the order of the present event among those of its sender at this time; packets in the outbox.
"""


COUNTERS = _FIRST + 13
