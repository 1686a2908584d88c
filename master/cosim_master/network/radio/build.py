"""The radio's tables of nodes, endpoints, links, gateways and packets in flight, built from a checked network."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.channel import PACKET
from cosim.entry import forget_tables
from cosim.kernel import table
from cosim.packets import MAX_PACKET
from cosim_master.network.radio import tables
from cosim_master.network.radio.link.own import address_of
from cosim_master.network.radio.tables import (
    BY_RADIO,
    CHANNEL,
    COUNTERS,
    DEFERRED,
    DEFINITION,
    DELIVERED,
    DUPLICATE,
    ENDPOINT,
    EVENT,
    FREE_PLACE,
    FREE_PLACES,
    GATEWAY,
    LOST_CHANNEL,
    MALFORMED,
    NO_ROUTE,
    NODE,
    ON_BOARD,
    OUTCOMES,
    PLACE,
    POST,
    RELAYED,
    REPEATED,
    SENT_ON,
    SETTINGS,
    TRACED,
    Radio,
)
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.nodes import TELEMETRY, Endpoint, Node
from cosim_master.system.settings.radio.obstacles import Obstacle

if TYPE_CHECKING:
    from cosim.build.messages import Message

__all__ = ["GATEWAY_BYTES", "grown", "make_radio", "packet_counts"]

_NANO = 1_000_000_000
_MEDIA = {"none": 0, "own": tables.OWN, "shared": tables.SHARED, "aloha": tables.ALOHA, "csma": tables.CSMA}
_COMPUTED = {"topology", "per_side", "axis", "keep", "effects", "medium", "own", "air", "hops"}
"""Columns of SETTINGS that are not plain numbers or times of a network."""
GATEWAY_BYTES = 1 << 16
"""Bytes that can be taken out of a gateway at once."""


def _hash(name: str) -> int:
    """Returns the FNV-1a hash (64 bit): the identity of a node or an endpoint, for the random numbers of its links."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def _topology(network: Network) -> int:
    if network.topology == "nearest":
        return tables.NEAREST if network.axis is None else tables.NEAREST_ON_AXIS
    return tables.LISTED if network.topology == "listed" else tables.BROADCAST


def _nanoseconds(seconds: float) -> int:
    return 2**62 if seconds > 9e9 else round(seconds * _NANO)


def _number(name: str, value: float) -> float:
    """Returns the value of a column of SETTINGS or CHANNEL: times [s] become whole ns, other values are unchanged."""
    return _nanoseconds(value) if SETTINGS[name].kind == "i" else value


def _reach(endpoint: Endpoint, node: Node) -> int:
    """Returns the reach of an endpoint: the ports that it hears and can send to."""
    if endpoint.line:
        return tables.GROUND if endpoint.line == TELEMETRY else tables.CABLE
    apart = any(e.instance == endpoint.instance and e.line == TELEMETRY for e in node.endpoints)
    return tables.SWARM if apart else tables.ON_AIR


def _gateways(network: Network) -> np.ndarray[Any, Any]:
    """Returns the GATEWAY table. The endpoints of gateways are the last ones."""
    endpoints = [e.name for node in network.nodes for e in node.endpoints]
    table = np.zeros(len(network.gateways), dtype=GATEWAY)
    for g, gateway in enumerate(network.gateways):
        table[g]["endpoint"] = len(endpoints) + g
        table[g]["wired"] = -1 if gateway.wired is None else endpoints.index(gateway.wired)
        table[g]["latency"], table[g]["jitter"] = _nanoseconds(gateway.latency), _nanoseconds(gateway.jitter)
        table[g]["loss"], table[g]["quiet"] = gateway.loss, gateway.quiet
    return table


def _channels(network: Network) -> tuple[list[int], list[int], np.ndarray[Any, Any]]:
    """Returns each node's kind as a sender and as a receiver, and the CHANNEL tables of all kinds of senders in one.

    Nodes are of the same kind if the same channels refer to them. A pattern over a thousand nodes thus yields few
    kinds, and a thousand channels between two nodes each yield few rows. The rows of sender kind k are those with
    `sender` k.
    """
    sending: dict[str, list[int]] = {node.name: [] for node in network.nodes}
    hearing: dict[str, list[int]] = {node.name: [] for node in network.nodes}
    for number, channel in enumerate(network.channels):
        for name in channel.senders:
            sending[name].append(number)
        for name in channel.hearers:
            hearing[name].append(number)
    sender_kinds: dict[tuple[int, ...], int] = {}
    hearer_kinds: dict[tuple[int, ...], int] = {}
    senders = [sender_kinds.setdefault(tuple(numbers), len(sender_kinds)) for numbers in sending.values()]
    hearers = [hearer_kinds.setdefault(tuple(numbers), len(hearer_kinds)) for numbers in hearing.values()]
    ends: list[tuple[list[int], list[int]]] = [([], []) for _ in network.channels]
    for side, kinds in enumerate((sender_kinds, hearer_kinds)):
        for numbers, kind in kinds.items():
            for number in numbers:
                ends[number][side].append(kind)
    columns = [name for name in CHANNEL.names or () if name != "kind"]
    described: dict[tuple[int, int], tuple[float, ...]] = {}
    for channel, (froms, tos) in zip(network.channels, ends, strict=True):
        for pair in product(froms, tos):
            earlier = described.get(pair) or tuple(getattr(network, name) for name in columns)
            own = [getattr(channel, name) for name in columns]
            described[pair] = tuple(a if b is None else b for a, b in zip(earlier, own, strict=True))
    rows = np.zeros(len(described), dtype=[("sender", "i8"), ("row", CHANNEL)])
    for i, ((sender, hearer), values) in enumerate(sorted(described.items())):
        converted = (_number(name, value) for name, value in zip(columns, values, strict=True))
        rows[i] = (sender, (hearer, *converted))
    return senders, hearers, rows


def _definition(message: Message) -> tuple[int, int, int]:
    return message.id, message.crc_extra, next((f.offset for f in message.fields if f.name == "target_system"), -1)


def _settings(network: Network, *, keep: bool) -> np.ndarray[Any, Any]:
    """Returns the row of SETTINGS. Unless set here, a column has the value of the network's attribute of that name."""
    row = np.zeros(1, dtype=SETTINGS)
    row["topology"] = _topology(network)
    row["per_side"] = min(network.neighbours, max(len(network.nodes) - 1, 1))
    row["axis"] = network.axis or (0.0, 0.0, 0.0)
    row["keep"] = keep
    row["effects"] = bool(
        network.own
        or network.partitions
        or network.jamming
        or network.sensitivity > -math.inf
        or network.burst_start > 0.0
        or any(channel.burst_start for channel in network.channels)
    )
    row["medium"] = _MEDIA[network.medium]
    row["own"] = 0 if network.own is None else address_of(network.own)
    row["hops"] = network.hops
    row["air"] = sum(1 for _ in network.senders()) if network.relays else -1
    for name in {*(SETTINGS.names or ())} - _COMPUTED:
        row[name] = _number(name, getattr(network, name))
    return row


def _partitions(network: Network) -> np.ndarray[Any, Any]:
    """Returns rows (from, until, side of each node)."""
    rows = [
        (_nanoseconds(one.start), _nanoseconds(one.stop), *(node.name in one.nodes for node in network.nodes))
        for one in network.partitions
    ]
    return np.array(rows, dtype=np.int64).reshape(-1, 2 + len(network.nodes))


def _jamming(network: Network) -> np.ndarray[Any, Any]:
    """Returns rows (north, east, radius, from, until)."""
    rows = [
        (one.north, one.east, one.radius, _nanoseconds(one.start), _nanoseconds(one.stop)) for one in network.jamming
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _obstacles(network: Network) -> np.ndarray[Any, Any]:
    """Returns the rows that `obstacles` describes."""
    rows = [
        (
            one.radius > 0.0,
            one.north,
            one.east,
            *_half(one),
            -one.base - one.height,
            -one.base,
            one.loss,
            one.attenuation,
        )
        for one in network.obstacles
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 9)


def _half(one: Obstacle) -> tuple[float, float]:
    return (one.radius, one.radius) if one.radius > 0.0 else (one.length / 2.0, one.width / 2.0)


def _trace(network: Network, nodes: Mapping[str, int]) -> np.ndarray[Any, Any]:
    """Returns rows of TRACED, sorted by sender, hearer and time."""
    rows = () if network.trace is None else network.trace.rows
    found = [(nodes[a], nodes[b], _nanoseconds(t), _nanoseconds(delay), got) for t, a, b, got, delay in rows]
    return np.sort(np.array(found, dtype=TRACED), order=["sender", "hearer", "time"])


_EVENTS, _LOGGED = 32, 2048
"""Events, and bytes of the log, for each node: whenever they are full, the logs of all nodes are written."""


def make_radio(network: Network, reals: Mapping[tuple[str, str], int], *, keep: bool) -> Radio:
    """Returns the radio's memory.

    Args:
        reals: index of every Real output that is fetched, by instance and variable; these include the nodes' positions.
        keep: write packet events and logs.

    Raises:
        SystemDescriptionError: the own channel cannot be compiled.
    """
    nodes = network.nodes
    names = {node.name: n for n, node in enumerate(nodes)}
    hearers: list[list[int]] = [[] for _ in nodes]
    for a, b in sorted((names[a], names[b]) for a, b in network.links):
        hearers[a].append(b)
    listed = np.cumsum([0, *(len(row) for row in hearers)])
    members = np.cumsum([0, *(len(node.endpoints) for node in nodes)])
    node_table = np.zeros(len(nodes) + len(network.gateways), dtype=NODE)
    senders, kinds, channels = _channels(network)
    for n, node in enumerate(nodes):
        place = [reals[instance, variable.name] for instance, variable in node.position] or [-1, -1, -1]
        own = np.searchsorted(channels["sender"], (senders[n], senders[n] + 1))
        spans = (members[n], members[n + 1], listed[n], listed[n + 1])
        node_table[n] = (place, _hash(node.name), *spans, kinds[n], *own, -1, 0)
    waits = network.medium in ("aloha", "csma")
    relays, behind = network.relays, int(members[-1]) + len(network.gateways)
    endpoints = np.zeros(behind + len(relays) + bool(relays) + waits, dtype=ENDPOINT)
    for i, name in enumerate(relays):
        node_table[names[name]]["relay"] = behind + i
        endpoints[behind + i] = (names[name], _hash(f"{name}.relay"), 0, 0, 0, -1, -1, tables.SWARM)
    if relays:
        endpoints[behind + len(relays)] = (-1, 0, 0, 0, 0, -1, -1, tables.CABLE)  # the air
    if waits:
        endpoints[-1] = (-1, 0, 0, 0, 0, -1, -1, tables.CABLE)  # the medium, in whose queue packets wait
    for i, (n, e) in enumerate((n, e) for n, node in enumerate(nodes) for e in node.endpoints):
        capacity = e.rx.packet_capacity if e.rx else 0
        endpoints[i] = (n, _hash(e.name), 0, capacity, 0, -1, -1, _reach(e, nodes[n]))
    for g, gateway in enumerate(network.gateways):
        behind = int(members[-1]) + g
        node_table[len(nodes) + g] = ([-1, -1, -1], _hash(gateway.name), behind, behind + 1, 0, 0, 0, 0, 0, -1, 0)
        endpoints[behind] = (len(nodes) + g, _hash(gateway.name), 0, GATEWAY_BYTES, 0, -1, -1, tables.ON_AIR)
    outages = [(names[n], _nanoseconds(a), _nanoseconds(b)) for n, a, b in network.outages]
    empty = Radio(
        settings=table(_settings(network, keep=keep)),
        endpoints=table(endpoints),
        nodes=table(node_table),
        links=np.array([b for row in hearers for b in row], dtype=np.int64),
        channels=table(channels["row"].copy()),
        outages=np.array(outages, dtype=np.int64).reshape(-1, 3),
        partitions=_partitions(network),
        jamming=_jamming(network),
        obstacles=_obstacles(network),
        trace=table(_trace(network, names)),
        packet=table(np.zeros(0 if network.own is None else 1, dtype=PACKET)),
        media=np.full({"none": 0, "csma": 5}.get(network.medium, 2) * len(nodes), -1, dtype=np.int64),
        places=table(np.zeros(0, dtype=PLACE)),
        data=np.zeros((0, MAX_PACKET), dtype=np.uint8),
        relayed=table(np.zeros(0, dtype=RELAYED)),
        trip=table(np.zeros(1 if relays else 0, dtype=RELAYED)),
        routes=np.zeros((len(nodes) if relays else 0, 256), dtype=np.int64),
        seen=np.zeros((len(nodes) * (int(members[-1]) + len(network.gateways)) if relays else 0, 2), dtype=np.int64),
        order=np.tile(np.arange(len(nodes), dtype=np.int64), (2, 1)),
        along=np.zeros(len(nodes)),
        hearers=np.zeros(len(nodes) + 1, dtype=np.int64),
        counters=np.zeros(COUNTERS, dtype=np.int64),
        events=table(np.zeros(max(4096, _EVENTS * len(nodes) if keep else 0), dtype=EVENT)),
        log=np.zeros(max(1 << 20, _LOGGED * len(nodes) if keep else 0), dtype=np.uint8),
        outbox=table(np.zeros(0, dtype=POST)),
        posted=np.zeros((0, MAX_PACKET), dtype=np.uint8),
        gateways=table(_gateways(network)),
        dialect=table(np.array([_definition(message) for message in network.dialect], dtype=DEFINITION)),
    )
    empty.counters[FREE_PLACE] = -1
    return grown(empty, 256)


def grown(radio: Radio, need: int) -> Radio:
    """Returns the same radio with at least `need` more free places in flight."""
    old = radio.places.size
    new = max(2 * old, old + need)
    places = np.zeros(new, dtype=PLACE)
    places[:old] = radio.places
    places["following"][old:] = np.arange(old + 1, new + 1)
    places["following"][-1] = radio.counters[FREE_PLACE]
    data = np.zeros((new, MAX_PACKET), dtype=np.uint8)
    used = np.flatnonzero(radio.places["length"])  # the others have no memory yet, and need none
    data[used] = radio.data[used]
    radio.counters[FREE_PLACE] = old
    radio.counters[FREE_PLACES] += new - old
    relayed = np.zeros(new * radio.trip.size, dtype=RELAYED)
    relayed[: radio.relayed.size] = radio.relayed
    forget_tables()  # the memory of this radio can be released
    return radio._replace(places=table(places), data=data, relayed=table(relayed))


def packet_counts(radio: Radio) -> dict[str, int]:
    """Returns the numbers of packets by radio: sent = delivered + lost + in flight, each counted once per receiver.

    Packets on board are counted separately. Duplicates, packets that relays send on, and causes of loss that most
    systems do not use, are included only if their number is not zero. A relayed packet is sent several times; copies
    that a node drops, because it has received the packet before, are "repeated" and count as delivered.
    """
    count = radio.counters
    always = range(LOST_CHANNEL, NO_ROUTE + 1)
    seldom = [i for i, outcome in enumerate(OUTCOMES) if outcome.startswith("lost: ") and i not in always and count[i]]
    lost = {OUTCOMES[i].removeprefix("lost: "): int(count[i]) for i in (*always, *seldom)}
    by_radio, delivered = int(count[BY_RADIO]), int(count[DELIVERED])
    others = {"duplicates": DUPLICATE, "relayed": SENT_ON, "repeated": REPEATED}
    return {
        "sent": by_radio + sum(lost.values()),
        "delivered": delivered,
        "lost": sum(lost.values()),
        "in flight": by_radio - delivered,
        **{f"lost: {cause}": n for cause, n in lost.items()},
        **{what: int(count[i]) for what, i in others.items() if count[i]},
        "malformed": int(count[MALFORMED]),
        "on board": int(count[ON_BOARD]),
        "deferred": int(count[DEFERRED]),
    }
