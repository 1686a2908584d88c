"""Relays against a simulation in plain Python and hand-counted topologies: routes, duplicates, loops, hops, counts."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.network.radio.air import serve_medium
from cosim_master.network.radio.build import grown, packet_counts
from cosim_master.network.radio.tables import AIRBORNE, FREE_PLACES, IN_FLIGHT, USED_EVENTS, WAITING
from cosim_master.network.radio.topology import copies
from tests.master.network.test_radio import SECOND, Air, packet, split

LATENCY = SECOND // 100
LINE = [(i, i + 1) for i in range(4)]
RING = [(i, (i + 1) % 6) for i in range(6)]
TREE = [(0, 1), (0, 2), (1, 3), (1, 4), (2, 5), (2, 6)]


class Relays(Air):
    """Air between nodes n0, n1, ... (systems 1, 2, ...), whose `serve` does what the loop does before it delivers."""

    def __init__(self, n: int, links: Iterable[tuple[int, int]] | None, relays: Iterable[int], **network: Any) -> None:
        pairs = [*(links or ())]
        both = frozenset((f"n{a}", f"n{b}") for pair in pairs for a, b in (pair, pair[::-1]))
        given: dict[str, Any] = {"latency": LATENCY / SECOND}
        given |= {"topology": "listed", "links": both} if links is not None else {}
        super().__init__(
            {f"n{i}": [f"n{i}"] for i in range(n)}, relays=tuple(f"n{i}" for i in relays), **given, **network
        )

    def serve(self, t: int) -> None:
        while True:
            waiting = self.radio.counters[WAITING] - self.radio.counters[AIRBORNE] + 1
            need = int(waiting) * copies(self.radio)
            if self.radio.counters[FREE_PLACES] < need:
                self.radio = grown(self.radio, need)
            if self.radio.counters[USED_EVENTS] + need > self.radio.events.size:
                events = np.zeros(2 * (self.radio.events.size + need), self.radio.events.dtype)
                events[: self.radio.events.size] = self.radio.events
                self.radio = self.radio._replace(events=events)
            if serve_medium(self.radio, self.reals, t):
                return

    def say(self, t: int, node: int, to: int | None = None, sequence: int = 0) -> bytes:
        """Sends a HEARTBEAT, or a COMMAND_LONG to system `to`, and lets it travel for a second; returns it."""
        sent = packet(node + 1, sequence, to)
        self.send(t, f"n{node}", sent)
        self.serve(t + SECOND)
        return sent

    def heard(self, sent: bytes) -> dict[int, list[int]]:
        """When each node received a packet, in ms since the start of its second."""
        found: dict[int, list[int]] = {}
        for n, name in enumerate(self.nodes):
            times = [arrival % SECOND // 1_000_000 for arrival, data, _ in self.queue(name) if data == sent]
            if times:
                found[n] = times
        return found

    def counts(self) -> dict[str, int]:
        found = packet_counts(self.radio)
        return {name: found.get(name, 0) for name in ("sent", "relayed", "repeated")}


# ---- hand-counted topologies --------------------------------------------------------------------------------------


def test_a_line_of_five_whose_nodes_hear_their_neighbours_only() -> None:
    """A broadcast of an end arrives everywhere, 10 ms per hop; each of 3 relays sends it on, to one node."""
    air = Relays(5, LINE, range(5))
    sent = air.say(0, 0)
    assert air.heard(sent) == {1: [10], 2: [20], 3: [30], 4: [40]}
    # n4 relays, too, but has nobody to send to but n3, from which the packet came.
    assert air.counts() == {"sent": 4, "relayed": 3, "repeated": 0}
    without = Relays(5, LINE, ())
    assert without.heard(without.say(0, 0)) == {1: [10]}
    assert without.radio.relayed.size == without.radio.seen.size == without.radio.routes.size == 0


def test_a_ring_takes_each_packet_once() -> None:
    """Both ways round reach n3 at the same time: 5 nodes hear it, n3 twice, and its first copy only counts."""
    air = Relays(6, RING, range(6))
    sent = air.say(0, 0)
    assert air.heard(sent) == {1: [10], 5: [10], 2: [20], 4: [20], 3: [30]}
    # 2 by n0, and one each by n1, n2, n4, n5 and n3, whose copy n4 drops (it came from n2, so it goes on to n4).
    assert air.counts() == {"sent": 7, "relayed": 5, "repeated": 2}


def test_a_tree() -> None:
    air = Relays(7, TREE, (0, 1, 2))
    sent = air.say(0, 3)
    assert air.heard(sent) == {1: [10], 0: [20], 4: [20], 2: [30], 5: [40], 6: [40]}
    assert air.counts() == {"sent": 6, "relayed": 3, "repeated": 0}


def test_a_node_that_does_not_relay_ends_the_journey() -> None:
    air = Relays(5, LINE, (0, 1, 3, 4))
    assert air.heard(air.say(0, 0)) == {1: [10], 2: [20]}


@pytest.mark.parametrize("hops", [1, 2, 3, 8])
def test_a_packet_passes_a_limited_number_of_relays(hops: int) -> None:
    air = Relays(12, [(i, i + 1) for i in range(11)], range(12), hops=hops)
    assert {*air.heard(air.say(0, 0))} == {*range(1, min(hops + 2, 12))}
    assert air.counts()["relayed"] == hops


def test_a_learned_route_is_used_and_an_unknown_target_is_searched() -> None:
    air = Relays(7, TREE, (0, 1, 2))
    for n in range(7):
        if n != 6:
            air.say(n * 2 * SECOND, n)
    before = air.counts()["sent"]
    command = air.say(20 * SECOND, 3, to=6)  # system 6 is n5, which all relays have heard
    assert air.heard(command) == {5: [40]}
    assert air.counts()["sent"] - before == 4
    way = [(air.nodes[e["target"]]) for e in air.events[-4:]]
    assert way == ["n1", "n0", "n2", "n5"]
    before = air.counts()["sent"]
    unknown = air.say(30 * SECOND, 3, to=99)  # nobody has sent as system 99: all relays search, no endpoint takes it
    assert air.heard(unknown) == {}
    assert air.counts()["sent"] - before == 3  # to the relays n1, n0, n2, which nobody behind them wants


def test_a_target_beside_the_sender_is_not_searched_elsewhere() -> None:
    """n1 relays between n0 and n2; n0 heard n2 by n1 only, but a packet for n1 itself stays there."""
    air = Relays(3, [(0, 1), (1, 2)], range(3))
    for n in range(3):
        air.say(n * 2 * SECOND, n)
    before = air.counts()
    assert air.heard(air.say(10 * SECOND, 0, to=2)) == {1: [10]}
    assert air.counts()["sent"] - before["sent"] == 1 and air.counts()["relayed"] == before["relayed"]


def test_a_route_follows_a_system_that_moves() -> None:
    """A relay in the middle hears n3 by n1, then by n2 after n3 has moved."""
    air = Relays(4, None, (0, 1, 2), range=15.0)
    for n, place in enumerate(((0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (20.0, 0.0))):
        air.at(f"n{n}", *place, 0.0)
    air.say(0, 3)
    air.say(2 * SECOND, 0)
    first = air.say(4 * SECOND, 0, to=4)
    assert {air.nodes[e["target"]] for e in air.events[-2:]} == {"n1", "n3"} and air.heard(first) == {3: [20]}
    air.at("n3", 0.0, 20.0, 0.0)
    lost = air.say(6 * SECOND, 0, to=4, sequence=5)  # by n1, which does not reach n3 any more
    assert air.heard(lost) == {} and air.outcomes()["lost: range"] > 0
    air.say(8 * SECOND, 3, sequence=1)
    assert air.heard(air.say(10 * SECOND, 0, to=4, sequence=1)) == {3: [20]}


def test_bytes_and_sequence_numbers_do_not_change() -> None:
    """pymavlink reads the relayed packets of two senders at the end of a line without a gap."""
    air = Relays(5, LINE, range(5))
    for i in range(300):
        air.say(2 * i * SECOND, 0, sequence=i % 256)
        air.say((2 * i + 1) * SECOND, 1, sequence=i % 256)
    link = mavlink.MAVLink(None)
    read = [link.parse_buffer(data)[0] for _, data, _ in air.queue("n4")]
    for system in (1, 2):
        sequences = [one.get_seq() for one in read if one.get_srcSystem() == system]
        assert sequences == [i % 256 for i in range(300)]
    assert len(read) == 600 and {one.get_type() for one in read} == {"HEARTBEAT"}


def test_a_storm_is_impossible_among_nodes_that_all_hear_each_other() -> None:
    """n - 1 nodes send each packet on once: (n - 1) + (n - 1)(n - 2) copies, and then it is quiet."""
    n = 12
    air = Relays(n, itertools.combinations(range(n), 2), range(n), hops=255)
    sent = air.say(0, 0)
    assert air.heard(sent) == {i: [10] for i in range(1, n)}
    assert air.counts() == {"sent": (n - 1) ** 2, "relayed": n - 1, "repeated": (n - 1) * (n - 2)}
    assert air.radio.counters[AIRBORNE] == air.radio.counters[WAITING] == 0
    assert packet_counts(air.radio)["in flight"] == n - 1  # delivered to nobody yet: `deliver` was not called
    for i in range(1, n):
        assert split(air.deliver(SECOND, f"n{i}")) == [sent]
    assert packet_counts(air.radio)["in flight"] == 0 and air.radio.counters[IN_FLIGHT] == 0


def test_late_copies_are_recognised() -> None:
    """A node remembers the last 62 packets of a sender before the latest, in any order of arrival."""
    from cosim_master.network.radio.relays import first_time

    air = Relays(2, [(0, 1)], (0,))
    order = np.random.default_rng(3).permutation(60)
    for number in order:
        assert first_time(air.radio, 1, 0, int(number))
        assert not first_time(air.radio, 1, 0, int(number))
    assert first_time(air.radio, 1, 0, 200) and first_time(air.radio, 1, 0, 138)
    assert not first_time(air.radio, 1, 0, 137) and not first_time(air.radio, 1, 0, 138)
    assert first_time(air.radio, 1, 1, 0) and first_time(air.radio, 0, 0, 7)


# ---- with other effects ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("medium", ["own", "shared", "aloha", "csma"])
def test_relays_share_the_medium(medium: str) -> None:
    """One packet alone is not disturbed by itself: each hop waits for the medium, and nothing collides on a line."""
    more = {"slot": 0.01} if medium == "aloha" else {"rate": 57_600.0}
    air = Relays(5, LINE, range(5), medium=medium, backoff=0.01 if medium == "csma" else 0.0, **more)
    sent = air.say(0, 0)
    times = [time for n in range(1, 5) for time in air.heard(sent)[n]]
    assert len(times) == 4 and all(b - a >= 10 + 3 for a, b in itertools.pairwise(times))
    assert air.counts() == {"sent": 4, "relayed": 3, "repeated": 0}
    assert air.radio.counters[WAITING] == 0


def test_damaged_packets_are_not_relayed() -> None:
    air = Relays(3, [(0, 1), (1, 2)], (1,), bit_errors=0.002, seed=1)
    for i in range(200):
        air.say(2 * i * SECOND, 0, sequence=i % 256)
    first = [data for _, data, _ in air.queue("n1")]
    whole = [data for _, data, counted in air.queue("n1") if counted]
    assert 0 < len(whole) < len(first) == 200
    assert air.counts()["relayed"] == len(whole) == len(air.queue("n2"))


def test_losses_of_a_relay_are_its_own() -> None:
    """Two hops with a loss of 0.3 each let 0.49 of the packets through; the same seed gives the same ones."""

    def fly(seed: int) -> list[tuple[int, bytes, bool]]:
        air = Relays(3, [(0, 1), (1, 2)], (1,), loss=0.3, seed=seed)
        for i in range(4000):
            air.say(2 * i * SECOND, 0, sequence=i % 256)
        return air.queue("n2")

    assert len(fly(1)) / 4000 == pytest.approx(0.49, abs=5.0 * (0.25 / 4000) ** 0.5)
    assert fly(1) == fly(1) != fly(2)


# ---- against a simulation -------------------------------------------------------------------------------------------


@dataclass
class Simulation:
    """Relays by sets and dictionaries: a packet is (its sender, its number there)."""

    links: dict[int, list[int]]
    relays: set[int]
    hops: int
    events: list[tuple[int, int, tuple[int, ...]]] = field(default_factory=list)
    count: Any = field(default_factory=itertools.count)
    had: set[tuple[int, int, int]] = field(default_factory=set)
    routes: dict[tuple[int, int], int] = field(default_factory=dict)
    spoken: set[int] = field(default_factory=set)
    received: list[tuple[int, int, int, int]] = field(default_factory=list)
    sent: list[tuple[int, int, int]] = field(default_factory=list)
    relayed: int = 0
    repeated: int = 0

    def say(self, t: int, node: int, number: int, to: int) -> None:
        self.spoken.add(node)
        self.had.add((node, node, number))
        if to != node + 1:
            self._on_air(t, node, node, number, to, came=None, passed=0)

    def _on_air(self, t: int, n: int, sender: int, number: int, to: int, *, came: int | None, passed: int) -> bool:
        known = self.routes.get((n, to)) if to and n in self.relays else None
        hearers = [o for o in self.links[n] if o != came]
        if known is not None:
            hearers = [o for o in hearers if o == known]
        else:
            hearers = [o for o in hearers if o in self.relays or not to or (to == o + 1 and o in self.spoken)]
        for o in hearers:
            self.sent.append((t, n, o))
            heapq.heappush(self.events, (t + LATENCY, next(self.count), (n, o, sender, number, to, passed)))
        return bool(hearers)

    def until(self, t: int) -> None:
        while self.events and self.events[0][0] <= t:
            now, _, (n, o, sender, number, to, passed) = heapq.heappop(self.events)
            if (o, sender, number) in self.had:
                self.repeated += 1
                continue
            self.had.add((o, sender, number))
            here = to == o + 1 and o in self.spoken
            if not to or here:
                self.received.append((now, o, sender, number))
            if o in self.relays:
                self.routes[o, sender + 1] = n
                if not here and passed < self.hops:
                    self.relayed += self._on_air(now, o, sender, number, to, came=n, passed=passed + 1)


@settings(deadline=None, max_examples=150)
@given(
    st.integers(2, 7).flatmap(
        lambda n: st.tuples(
            st.just(n),
            st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda p: p[0] < p[1])),
            st.sets(st.integers(0, n - 1), min_size=1),
            st.lists(st.tuples(st.integers(0, 4), st.integers(0, n - 1), st.integers(0, n)), max_size=25),
        )
    ),
    st.integers(1, 5),
    st.integers(1, 7),
)
def test_any_topology_as_in_a_simulation(
    drawn: tuple[int, set[tuple[int, int]], set[int], Sequence[tuple[int, int, int]]], hops: int, step: int
) -> None:
    n, links, relays, sends = drawn
    air = Relays(n, links, sorted(relays), hops=hops)
    neighbours = {i: sorted({b for p in links for a, b in (p, p[::-1]) if a == i}) for i in range(n)}
    other = Simulation(neighbours, relays, hops)
    made: dict[bytes, tuple[int, int]] = {}
    numbers, t = Counter[int](), 0
    for pause, node, to in sends:
        for _ in range(pause):
            t += step * LATENCY // 4
            air.serve(t)
            other.until(t)
        if to != node + 1:
            made[packet(node + 1, numbers[node], to or None)] = (node, numbers[node])
        air.send(t, f"n{node}", packet(node + 1, numbers[node], to or None))
        other.say(t, node, numbers[node], to)
        numbers[node] += to != node + 1
    air.serve(t + 10 * SECOND)
    other.until(t + 10 * SECOND)
    received = [(arrival, i, *made[data]) for i in range(n) for arrival, data, _ in air.queue(f"n{i}")]
    assert sorted(received) == sorted(other.received)
    radio = [e for e in air.events if e["outcome"] == 1]
    senders = [*range(n), *sorted(relays)]
    assert Counter((int(e["sent"]), senders[e["source"]], int(e["target"])) for e in radio) == Counter(other.sent)
    assert air.counts() == {"sent": len(other.sent) + air.outcomes().get("lost: no route", 0)} | {
        "relayed": other.relayed,
        "repeated": other.repeated,
    }
