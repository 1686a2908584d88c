"""The radio against brute force in Python: who hears what, when, in which order, and that nothing gets lost unseen."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.fmi.description.read import Variable
from cosim_master.network.radio.build import _hash, grown, make_radio
from cosim_master.network.radio.link.chances import _mix, chance
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import send
from cosim_master.network.radio.tables import (
    DEFERRED,
    DELIVERED,
    FREE_PLACES,
    IN_FLIGHT,
    NEAREST_ON_AXIS,
    OUTCOMES,
    USED_EVENTS,
    USED_LOG,
    Radio,
)
from cosim_master.network.radio.topology import copies, sort_along
from cosim_master.system.settings.network import Channel, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from tests.master.fmus.scripted import variable

RX = variable("mavlink_rx", "input", "String", 8, capacity=2048)
TX = variable("mavlink_tx", "output", "String", 9, capacity=2048)
POSITION = tuple(variable(f"position[{i}]", "output", "Real", i) for i in (1, 2, 3))
SECOND = 1_000_000_000


def packet(system: int, sequence: int = 0, to: int | None = None, component: int = 1, version: int = 2) -> bytes:
    """A HEARTBEAT, or a COMMAND_LONG to system `to`."""
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    link.seq = sequence
    if to is None:
        message = link.heartbeat_encode(2, 3, 0, 0, 3)
    else:
        message = link.command_long_encode(to, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(link, force_mavlink1=version == 1))


def split(block: bytes) -> list[bytes]:
    """The packets of a block, read by pymavlink."""
    messages = mavlink.MAVLink(None).parse_buffer(block) or []
    return [bytes(message.get_msgbuf()) for message in messages]


class Air:
    """A radio between nodes of given endpoints, and the loop's part: room for what is sent, sorted nodes."""

    def __init__(self, nodes: dict[str, Sequence[str]], *, keep: bool = True, **network: Any) -> None:
        self.names = [endpoint for endpoints in nodes.values() for endpoint in endpoints]
        self.nodes = list(nodes)
        index: dict[tuple[str, str], int] = {}
        made = []
        for name, endpoints in nodes.items():
            position: tuple[tuple[str, Variable], ...] = tuple((name, v) for v in POSITION)
            for _, v in position:
                index[name, v.name] = len(index)
            made.append(Node(name, tuple(Endpoint(e, RX, TX) for e in endpoints), position))
        places: Any = SimpleNamespace(ports={"Real": SimpleNamespace(index=index)})
        self.radio: Radio = make_radio(Network(nodes=tuple(made), **network), places.ports["Real"].index, keep=keep)
        self.reals = np.zeros(len(index))
        self._buffer = np.zeros(4096, np.uint8)

    def at(self, node: str, *position: float) -> None:
        n = 3 * self.nodes.index(node)
        self.reals[n : n + 3] = position

    def send(self, t: int, endpoint: str, packets: bytes) -> None:
        buf = np.frombuffer(packets, np.uint8).copy()
        need = (len(packets) // 8 + 2) * copies(self.radio)
        if self.radio.counters[FREE_PLACES] < need:
            self.radio = grown(self.radio, need)
        if self.radio.counters[USED_EVENTS] + need > self.radio.events.size:
            events = np.zeros(2 * (self.radio.events.size + need), self.radio.events.dtype)
            events[: self.radio.events.size] = self.radio.events
            self.radio = self.radio._replace(events=events)
        if self.radio.counters[USED_LOG] + 3 * len(packets) + 4096 > self.radio.log.size:
            self.radio.counters[USED_LOG] = 0
        if self.radio.settings[0]["topology"] == NEAREST_ON_AXIS:
            sort_along(self.radio, self.reals)
        send(self.radio, self.reals, t, self.names.index(endpoint), buf, len(packets))

    def deliver(self, t: int, endpoint: str) -> bytes:
        n = deliver(self.radio, t, self.names.index(endpoint), self._buffer)
        return self._buffer[:n].tobytes()

    @property
    def events(self) -> Any:
        return self.radio.events[: self.radio.counters[USED_EVENTS]]

    def outcomes(self) -> dict[str, int]:
        return {name: int(self.radio.counters[i]) for i, name in enumerate(OUTCOMES) if self.radio.counters[i]}

    def queue(self, endpoint: str) -> list[tuple[int, bytes, bool]]:
        """What is in flight to an endpoint: arrival, packet, and whether this copy is the one that counts."""
        found = []
        place = int(self.radio.endpoints[self.names.index(endpoint)]["first"])
        while place >= 0:
            row = self.radio.places[place]
            data = self.radio.data[place, : row["length"]].tobytes()
            found.append((int(row["arrival"]), data, bool(row["logged"])))
            place = int(row["following"])
        return found

    def hearers(self, node: str) -> set[str]:
        """Nodes that a broadcast of `node` is for."""
        before = int(self.radio.counters[USED_EVENTS])
        self.send(0, node, packet(1))
        return {self.nodes[event["target"]] for event in self.events[before:]}


def each_alone(n: int, **network: Any) -> Air:
    return Air({f"n{i}": [f"n{i}"] for i in range(n)}, **network)


# ---- random numbers ---------------------------------------------------------------------------------------------


def test_finaliser_of_splitmix64() -> None:
    """The published sequences of splitmix64 for the seeds 1234567 and 0."""
    golden = 0x9E3779B97F4A7C15
    for seed, published in (
        (1234567, [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]),
        (0, [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F, 0xF88BB8A8724C81EC]),
    ):
        states = [(seed + (i + 1) * golden) % 2**64 for i in range(4)]
        assert [int(_mix(np.uint64(state))) for state in states] == published


@settings(deadline=None)
@given(*[st.integers(0, 2**64 - 1)] * 3, st.integers(0, 2**40), st.integers(0, 1))
def test_a_chance_is_the_same_compiled_and_computed_with_pythons_integers(
    seed: int, source: int, sink: int, number: int, which: int
) -> None:
    def mix(x: int) -> int:
        x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9 % 2**64
        x = (x ^ x >> 27) * 0x94D049BB133111EB % 2**64
        return x ^ x >> 31

    golden = 0x9E3779B97F4A7C15
    x = mix((seed + golden) % 2**64)
    x = mix(x ^ source)
    for part in (sink, number, which):
        x = mix((x + golden) % 2**64 ^ part)
    expected = (x >> 11) / 2**53
    assert 0.0 <= expected < 1.0
    assert chance(np.uint64(seed), np.uint64(source), np.uint64(sink), number, which) == expected


# ---- topologies -------------------------------------------------------------------------------------------------

grid = st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=1, max_size=9)
"""Positions on a coarse grid: many ties."""


@settings(max_examples=60, deadline=None)
@given(grid, st.integers(1, 4))
def test_nearest(positions: list[tuple[int, int, int]], neighbours: int) -> None:
    air = each_alone(len(positions), topology="nearest", neighbours=neighbours)
    for node, position in zip(air.nodes, positions, strict=True):
        air.at(node, *position)
    for n, node in enumerate(air.nodes):
        others = [o for o in range(len(positions)) if o != n]
        others.sort(key=lambda o, n=n: (math.dist(positions[o], positions[n]) ** 2, o))
        assert air.hearers(node) == {air.nodes[o] for o in others[:neighbours]}


@settings(max_examples=60, deadline=None)
@given(st.data(), st.integers(1, 8), st.integers(1, 3))
def test_nearest_on_an_axis_while_nodes_move(data: st.DataObject, n: int, neighbours: int) -> None:
    axis = data.draw(st.sampled_from([(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.6, 0.8, 0.0)]))
    air = each_alone(n, topology="nearest", axis=axis, neighbours=neighbours)
    for _ in range(4):
        positions = data.draw(st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=n, max_size=n))
        for node, position in zip(air.nodes, positions, strict=True):
            air.at(node, *position)
        along = [sum(a * float(x) for a, x in zip(axis, position, strict=True)) for position in positions]
        order = sorted(range(n), key=lambda i: (along[i], i))
        for i, node in enumerate(air.nodes):
            rank = order.index(i)
            near = order[max(0, rank - neighbours) : rank] + order[rank + 1 : rank + 1 + neighbours]
            assert air.hearers(node) == {air.nodes[o] for o in near}


@settings(deadline=None)
@given(st.integers(1, 6))
def test_broadcast(n: int) -> None:
    air = each_alone(n)
    for node in air.nodes:
        assert air.hearers(node) == set(air.nodes) - {node}


@settings(deadline=None)
@given(st.sets(st.sampled_from(list(itertools.combinations(["n0", "n1", "n2", "n3"], 2)))))
def test_listed(pairs: set[tuple[str, str]]) -> None:
    links = frozenset(pairs) | frozenset((b, a) for a, b in pairs)
    air = each_alone(4, topology="listed", links=links)
    for node in air.nodes:
        assert air.hearers(node) == {b for a, b in links if a == node}


# ---- routing ----------------------------------------------------------------------------------------------------


def test_a_broadcast_reaches_the_own_node_and_all_others() -> None:
    air = Air({"a": ["a.agent", "a.pilot"], "b": ["b.agent", "b.pilot"], "c": ["c"]})
    sent = packet(1)
    air.send(0, "a.agent", sent)
    assert [air.deliver(0, e) for e in air.names] == [b"", sent, sent, sent, sent]
    assert air.outcomes() == {"on board": 1, "radio": 2}


def test_what_is_addressed_to_the_own_system_stays_on_board() -> None:
    air = Air({"a": ["a.agent", "a.pilot"], "b": ["b"]})
    air.send(0, "b", packet(1))  # the same system id elsewhere changes nothing
    assert len(air.deliver(0, "a.agent")) == len(air.deliver(0, "a.pilot")) == len(packet(1))
    own = packet(1, to=1)
    air.send(0, "a.agent", own)
    assert [air.deliver(0, e) for e in air.names] == [b"", own, b""]
    assert air.outcomes() == {"on board": 1, "radio": 1}


def test_an_addressed_packet_goes_only_where_its_system_has_been_heard() -> None:
    air = Air({"a": ["a"], "b": ["b"], "c": ["c"]})
    to_2 = packet(1, to=2)
    air.send(0, "a", to_2)
    assert air.outcomes() == {"lost: no route": 1}
    assert air.events[0]["target"] == -1
    for name, system in (("b", 2), ("c", 3)):
        air.send(0, name, packet(system))
        for other in air.names:
            air.deliver(0, other)
    air.send(0, "a", to_2)
    assert [air.deliver(0, e) for e in air.names] == [b"", to_2, b""]


def test_on_board_the_bus_is_shared_until_a_component_is_heard() -> None:
    air = Air({"a": ["a.agent", "a.camera", "a.pilot"]})
    to_7 = packet(1, to=7)
    air.send(0, "a.agent", to_7)
    assert [air.deliver(0, e) for e in air.names] == [b"", to_7, to_7]
    air.send(0, "a.camera", packet(7))
    air.send(0, "a.pilot", packet(1))
    for endpoint in air.names:
        air.deliver(0, endpoint)
    air.send(0, "a.agent", to_7)
    assert [air.deliver(0, e) for e in air.names] == [b"", to_7, b""]


def test_nobody_hears_what_it_said_itself() -> None:
    air = Air({"a": ["a"]})
    air.send(0, "a", packet(1))
    assert air.deliver(SECOND, "a") == b""
    assert air.outcomes() == {}


traffic = st.lists(
    st.tuples(st.integers(0, 5), st.integers(1, 3), st.sampled_from([None, 0, 1, 2, 3]), st.sampled_from([1, 2])),
    max_size=25,
)


@settings(max_examples=80, deadline=None)
@given(traffic, st.sampled_from([(1, 1, 1, 1, 1, 1), (2, 2, 2), (3, 1, 2), (6,)]))
def test_routing_against_brute_force(packets: list[tuple[int, int, int | None, int]], sizes: tuple[int, ...]) -> None:
    """Random traffic of six endpoints on one to six nodes; every endpoint may speak for every system."""
    numbers = iter(range(6))
    nodes = {f"n{i}": [f"n{i}.e{next(numbers)}" for _ in range(size)] for i, size in enumerate(sizes)}
    air = Air(nodes)
    node_of = {endpoint: node for node, endpoints in nodes.items() for endpoint in endpoints}
    speaks_for: dict[str, int] = {}
    expected: dict[str, list[bytes]] = {endpoint: [] for endpoint in air.names}
    for sequence, (number, system, to, version) in enumerate(packets):
        sender = air.names[number]
        one = packet(system, sequence, to, version=version)
        air.send(0, sender, one)
        speaks_for[sender] = system
        for other in air.names:
            on_board, last = node_of[other] == node_of[sender], speaks_for.get(other)
            if other == sender:
                continue
            if not to:
                takes = True
            elif on_board:
                takes = last in (None, to)
            else:
                takes = last == to and to != system
            if takes:
                expected[other].append(one)
    for endpoint in air.names:
        assert split(air.deliver(0, endpoint)) == expected[endpoint]
    assert air.radio.counters[IN_FLIGHT] == 0


# ---- channel ----------------------------------------------------------------------------------------------------


def spread(air: Air, sender: str, count: int, system: int = 1, step: int = 0) -> None:
    """`count` heartbeats, 50 at a time, `step` ns apart; sequence numbers as they go through a byte."""
    for first in range(0, count, 50):
        block = b"".join(packet(system, i % 256) for i in range(first, min(first + 50, count)))
        air.send(first // 50 * step, sender, block)


def test_latency() -> None:
    air = each_alone(2, latency=0.02)
    air.send(5, "n0", packet(1))
    assert air.deliver(20_000_004, "n1") == b""
    assert air.deliver(20_000_005, "n1") == packet(1)
    assert air.events["arrival"].tolist() == [20_000_005]


def test_jitter_is_uniform() -> None:
    air = each_alone(3, latency=0.1, jitter=0.04, seed=7)
    spread(air, "n0", 5000)
    delay = (air.events["arrival"] - air.events["sent"]) / 1e9 - 0.1
    assert delay.size == 10_000
    assert delay.min() >= 0.0 and delay.max() < 0.04
    sigma = 0.04 / math.sqrt(12.0)
    assert delay.mean() == pytest.approx(0.02, abs=5.0 * sigma / math.sqrt(delay.size))
    assert np.histogram(delay, bins=10, range=(0.0, 0.04))[0] == pytest.approx(1000, abs=5.0 * math.sqrt(900.0))
    first, second = delay.reshape(-1, 2).T  # the hearers of each packet
    assert abs(np.corrcoef(first, second)[0, 1]) < 5.0 / math.sqrt(5000.0)


def test_loss_is_binomial_and_independent_per_hearer() -> None:
    air = each_alone(3, loss=0.3, seed=11)
    spread(air, "n0", 10_000)
    lost = (air.events["arrival"] < 0).reshape(-1, 2)
    for hearer in (0, 1):
        assert lost[:, hearer].sum() == pytest.approx(3000, abs=5.0 * math.sqrt(10_000 * 0.3 * 0.7))
    assert lost.all(axis=1).sum() == pytest.approx(900, abs=5.0 * math.sqrt(10_000 * 0.09 * 0.91))
    assert air.outcomes() == {"radio": int((~lost).sum()), "lost: channel": int(lost.sum())}
    runs = np.diff(np.flatnonzero(np.diff(lost[:, 0].astype(int))))  # no bursts: lengths of runs are geometric
    assert runs.max() < 60


@pytest.mark.parametrize(("loss", "outcome"), [(0.0, "radio"), (1.0, "lost: channel")])
def test_no_loss_and_nothing_but_loss(loss: float, outcome: str) -> None:
    air = each_alone(2, loss=loss)
    spread(air, "n0", 500)
    assert air.outcomes() == {outcome: 500}


def fates(air: Air) -> dict[tuple[str, str, int], tuple[int, int]]:
    """(sender, hearer, sequence) -> (outcome, delay)."""
    return {
        (air.names[e["source"]], air.nodes[e["target"]], int(e["sequence"])): (
            int(e["outcome"]),
            int(e["arrival"] - e["sent"]) if e["arrival"] >= 0 else -1,
        )
        for e in air.events
    }


def test_fates_depend_on_seed_sender_hearer_and_number_only() -> None:
    channel: dict[str, Any] = {"loss": 0.4, "jitter": 0.01, "seed": 3}

    def fly(names: Sequence[str], step: int, together: int, **changes: Any) -> dict[Any, Any]:
        air = Air({name: [name] for name in names}, **{**channel, **changes})
        for first in range(0, 240, together):
            for i, name in enumerate(names):
                block = b"".join(packet(i + 1, j) for j in range(first, first + together))
                air.send(step * first, name, block)
        return {key: fate for key, fate in fates(air).items() if set(key[:2]) <= {"a", "b", "c"}}

    reference = fly("abc", 1000, 1)
    assert len(reference) == 3 * 2 * 240
    assert fly("cab", 1000, 1) == reference  # other node order
    assert fly("abc", 77, 12) == reference  # other step size
    assert fly("dacbe", 1000, 1) == reference  # additional nodes
    assert fly("abc", 1000, 1, seed=4) != reference


def test_fates_do_not_depend_on_how_the_endpoints_of_a_node_take_turns() -> None:
    def fly(turns: str) -> dict[Any, Any]:
        air = Air({"a": ["a.x", "a.y"], "b": ["b"]}, loss=0.5, seed=1)
        number = Counter[str]()
        for turn in turns:
            air.send(0, f"a.{turn}", packet(1, number[turn]))
            number[turn] += 1
        return {key: fate for key, fate in fates(air).items() if key[1] == "b"}

    assert fly("xy" * 40) == fly("x" * 40 + "y" * 40) == fly("yyxx" * 20)


def test_range_is_inclusive_and_uses_positions_of_the_moment() -> None:
    air = each_alone(2, range=50.0)
    for east, outcome in ((40.0, "radio"), (40.001, "lost: range"), (-40.0, "radio")):
        air.at("n1", 30.0, east, 0.0)
        air.send(0, "n0", packet(1))
        assert OUTCOMES[air.events[-1]["outcome"]] == outcome


def test_an_outage_silences_its_sender_and_deafens_it_when_packets_arrive() -> None:
    air = each_alone(3, latency=0.5, outages=(("n1", 1.0, 2.0),))

    def outcome(t: float, sender: str, hearer: str) -> str:
        before = len(air.events)
        air.send(round(t * 1e9), sender, packet(1))
        (event,) = (e for e in air.events[before:] if air.nodes[e["target"]] == hearer)
        return OUTCOMES[event["outcome"]]

    sends = {t: outcome(t, "n1", "n0") for t in (0.9, 1.0, 1.999999999, 2.0)}
    assert sends == {0.9: "radio", 1.0: "lost: outage", 1.999999999: "lost: outage", 2.0: "radio"}
    hears = {t: outcome(t, "n0", "n1") for t in (0.499999999, 0.5, 1.499999999, 1.5)}
    assert hears == {0.499999999: "radio", 0.5: "lost: outage", 1.499999999: "lost: outage", 1.5: "radio"}
    assert outcome(1.2, "n0", "n2") == "radio"


def test_an_outage_without_end() -> None:
    air = each_alone(2, outages=(("n0", 1.0, math.inf),))
    air.send(SECOND - 1, "n0", packet(1))
    air.send(10**17, "n0", packet(1))
    assert air.outcomes() == {"radio": 1, "lost: outage": 1}


# ---- links that differ -------------------------------------------------------------------------------------------

some_nodes = st.lists(st.sampled_from(["n0", "n1", "n2", "n3"]), min_size=1, unique=True).map(tuple)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.builds(
            Channel,
            st.just("*"),
            st.just("*"),
            some_nodes,
            some_nodes,
            st.sampled_from([None, 0.0, 0.25]),
            st.sampled_from([None, 0.0, 0.5]),
            st.sampled_from([None, 0.0, 0.5, 1.0]),
        ),
        max_size=5,
    ),
    st.sampled_from(["broadcast", "nearest"]),
)
def test_what_packets_meet_is_what_the_last_link_says(channels: list[Channel], topology: str) -> None:
    """Against the links looked through one by one, and the chances computed for each packet."""
    default = {"latency": 0.1, "jitter": 0.0, "loss": 0.2}
    air = each_alone(4, topology=topology, neighbours=3, seed=8, channels=tuple(channels), **default)
    for i in range(30):
        for n in range(4):
            air.send(i * 1000, f"n{n}", packet(n + 1, i))
    assert len(air.events) == 30 * 4 * 3
    for event in air.events:
        a, b, number = air.names[event["source"]], air.nodes[event["target"]], int(event["sequence"])
        meets = dict(default)
        for channel in channels:
            if a in channel.senders and b in channel.hearers:
                said = {name: getattr(channel, name) for name in meets}
                meets |= {name: value for name, value in said.items() if value is not None}
        key = np.uint64(8), np.uint64(_hash(a)), np.uint64(_hash(b)), number
        lost = chance(*key, 0) < meets["loss"]
        delay = round(meets["latency"] * SECOND) + int(meets["jitter"] * SECOND * chance(*key, 1))
        assert OUTCOMES[event["outcome"]] == ("lost: channel" if lost else "radio")
        assert event["arrival"] == (-1 if lost else event["sent"] + delay)


def test_a_link_changes_its_own_packets_only() -> None:
    def fly(*channels: Channel) -> dict[Any, Any]:
        air = each_alone(3, loss=0.3, jitter=0.01, seed=3, channels=channels)
        for i in range(200):
            for n in range(3):
                air.send(i * 1000, f"n{n}", packet(n + 1, i))
        return fates(air)

    plain = fly()
    lossy = fly(Channel("n1", "*", ("n1",), ("n0", "n1", "n2"), loss=0.9))
    assert {key: fate for key, fate in lossy.items() if key[0] != "n1"} == {
        key: fate for key, fate in plain.items() if key[0] != "n1"
    }
    assert (
        sum(outcome == OUTCOMES.index("lost: channel") for (a, _, _), (outcome, _) in lossy.items() if a == "n1") > 330
    )
    assert all(lossy[key] == fate or key[0] == "n1" for key, fate in plain.items())
    # Who is lost at 30 % is lost at 90 %, too.
    gone = {key for key, (outcome, _) in plain.items() if outcome == OUTCOMES.index("lost: channel")}
    assert gone <= {key for key, (outcome, _) in lossy.items() if outcome == OUTCOMES.index("lost: channel")}


def test_a_thousand_links_make_a_table_of_their_own_size_only() -> None:
    """Patterns make few kinds of nodes, links between two nodes few rows."""
    names = [f"n{i}" for i in range(1000)]
    every = tuple(names)
    pairs = [Channel(a, b, (a,), (b,), loss=0.5) for a, b in itertools.pairwise(names[:300])]
    air = each_alone(1000, channels=(Channel("*", "*", every, every, latency=0.1), Channel("n7", "*", ("n7",), every)))
    assert air.radio.channels.size == 2
    assert each_alone(1000, channels=tuple(pairs)).radio.channels.size == 299


# ---- malformed packets --------------------------------------------------------------------------------------------


def damaged(one: bytes) -> bytes:
    return one[:-1] + bytes([one[-1] ^ 1])


@pytest.mark.parametrize(
    ("block", "good", "bad"),
    [
        (b"xyz" + packet(1, 1), [packet(1, 1)], 1),
        (packet(1, 1) + b"xyz", [packet(1, 1)], 1),
        (damaged(packet(1, 1)) + packet(1, 2), [packet(1, 2)], 1),
        (packet(1, 1)[:-3], [], 1),
        (packet(1, 1) + packet(1, 2)[:2], [packet(1, 1)], 1),
        (packet(1, 1)[:2] + b"\x80" + packet(1, 1)[3:] + packet(1, 2), [packet(1, 2)], 1),  # unknown incompat flag
        (b"x" + packet(1, 1) + b"y" + damaged(packet(1, 2)) + b"z", [packet(1, 1)], 4),
        (b"", [], 0),
    ],
    ids=["before", "behind", "crc", "cut", "cut in its header", "incompatible", "all at once", "empty"],
)
def test_malformed_packets_are_counted_and_the_others_get_through(block: bytes, good: list[bytes], bad: int) -> None:
    air = each_alone(2)
    air.send(0, "n0", block)
    assert split(air.deliver(0, "n1")) == good
    assert air.outcomes().get("malformed", 0) == bad
    malformed = air.events[air.events["outcome"] == OUTCOMES.index("malformed")]
    assert malformed["message"].tolist() == [-1] * bad
    assert sum(malformed["length"].tolist()) == len(block) - sum(map(len, good))


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.sampled_from([b"x", b"\xfe\x00\x00\x01\x01\x00\x00\x00", packet(1), packet(1, to=9), damaged(packet(1))])
    ),
    st.sampled_from(["listed", "broadcast", "nearest"]),
    st.booleans(),
)
def test_the_loop_always_has_made_enough_room(parts: list[bytes], topology: str, crowd: bool) -> None:
    """Places and events used never exceed what `copies` promises, even for garbage between shortest packets."""
    block = b"".join(parts)
    air = Air({"a": ["a.x", "a.y"] if crowd else ["a"], "b": ["b"]}, topology=topology)
    air.send(0, air.names[0], block)
    room = (len(block) // 8 + 2) * copies(air.radio)
    assert air.radio.counters[USED_EVENTS] <= room
    assert air.radio.counters[IN_FLIGHT] <= room
    assert air.radio.counters[USED_LOG] <= 3 * len(block)


# ---- order and conservation -----------------------------------------------------------------------------------------


def test_delivery_is_in_the_order_of_arrival_and_of_sending_where_that_is_equal() -> None:
    air = each_alone(3, jitter=0.05, seed=5)
    for i in range(90):
        air.send(i * 1_000_000, f"n{i % 2}", packet(1 + i % 2, i))
    rows = [(int(e["arrival"]), n, int(e["sequence"])) for n, e in enumerate(air.events) if e["target"] == 2]
    got = [one[4] for one in split(air.deliver(SECOND, "n2"))]
    assert got == [sequence for _, _, sequence in sorted(rows)]
    assert got != sorted(got)
    same = each_alone(2)
    same.send(0, "n0", packet(1, 1) + packet(1, 2))
    same.send(0, "n0", packet(1, 3))
    assert [one[4] for one in split(same.deliver(0, "n1"))] == [1, 2, 3]


def test_what_does_not_fit_waits_and_keeps_its_place() -> None:
    air = each_alone(2)
    one, two, three = packet(1, 1), packet(1, 2, to=None), packet(1, 3)
    air.radio.endpoints[1]["capacity"] = len(one) + len(two)
    air.send(0, "n0", one + two + three)
    assert air.deliver(0, "n1") == one + two
    assert air.radio.counters[DEFERRED] == 1
    air.send(0, "n0", packet(1, 4))
    assert air.deliver(0, "n1") == three + packet(1, 4)
    assert air.radio.counters[DEFERRED] == 1


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_nothing_is_lost_unseen_and_nothing_arrives_twice(data: st.DataObject) -> None:
    """Random traffic over a bad channel with small ports and a radio that grows in between."""
    channel: dict[str, Any] = {
        "loss": data.draw(st.sampled_from([0.0, 0.3])),
        "latency": data.draw(st.sampled_from([0.0, 0.03])),
        "jitter": data.draw(st.sampled_from([0.0, 0.1])),
        "range": data.draw(st.sampled_from([math.inf, 10.0])),
        "seed": data.draw(st.integers(0, 5)),
        "outages": data.draw(st.sampled_from([(), (("b", 0.05, 0.1),)])),
    }
    air = Air({"a": ["a.x", "a.y"], "b": ["b"], "c": ["c"]}, **channel)
    air.at("c", 0.0, 0.0, 20.0)
    air.radio.endpoints["capacity"] = data.draw(st.sampled_from([64, 2048]))
    got: dict[str, list[bytes]] = {endpoint: [] for endpoint in air.names}
    for k in range(data.draw(st.integers(1, 30))):
        t = k * 10_000_000
        if k in (3, 7) and data.draw(st.booleans()):
            air.radio = grown(air.radio, data.draw(st.integers(1, 400)))
        for endpoint in air.names:
            got[endpoint] += split(air.deliver(t, endpoint))
        for i in range(data.draw(st.integers(0, 4))):
            sender = data.draw(st.integers(0, 3))
            to = data.draw(st.sampled_from([None, None, 1, 2, 4]))
            system = (1, 1, 2, 3)[sender]
            air.send(t, air.names[sender], packet(system, (4 * k + i) % 256, to, component=1 + k))
        queues = {endpoint: air.queue(endpoint) for endpoint in air.names}
        waiting = sum(len(queue) for queue in queues.values())
        counters = air.radio.counters
        assert counters[IN_FLIGHT] == waiting
        assert counters[IN_FLIGHT] + counters[FREE_PLACES] == air.radio.places.size
        counting = sum(logged for queue in queues.values() for _, _, logged in queue)
        assert air.outcomes().get("radio", 0) == counters[DELIVERED] + counting
        assert all(queue == sorted(queue, key=lambda item: item[0]) for queue in queues.values())
    for endpoint in air.names:
        everything = got[endpoint] + [one for _, one, _ in air.queue(endpoint)]
        assert len(set(everything)) == len(everything)
    for endpoint in air.names:
        while air.queue(endpoint):
            assert air.deliver(2**61, endpoint)
    assert air.radio.counters[IN_FLIGHT] == 0
    assert air.outcomes().get("radio", 0) == air.radio.counters[DELIVERED]


def test_without_a_record_only_counters_move() -> None:
    air = each_alone(2, keep=False)
    air.send(0, "n0", packet(1))
    assert air.deliver(0, "n1") == packet(1)
    assert air.radio.counters[USED_EVENTS] == air.radio.counters[USED_LOG] == 0
    assert air.outcomes() == {"radio": 1}
    assert air.radio.counters[DELIVERED] == 1
