"""Media that packets share, against queues computed by hand and the throughputs of slotted ALOHA and of CSMA."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.network.radio.air import serve_medium
from cosim_master.network.radio.build import grown, packet_counts
from cosim_master.network.radio.tables import BY_RADIO, FREE_PLACES, LOST_COLLISION, LOST_QUEUE, USED_EVENTS, WAITING
from cosim_master.network.radio.topology import copies
from tests.master.network.test_radio import SECOND, Air, each_alone, packet, spread

LENGTH = len(packet(1))
AIRTIME = -(-LENGTH * 10 * SECOND // 57_600)
"""ns that a heartbeat takes at 57,600 baud."""
SLOT = 10_000_000


class Slots(Air):
    """Air with slots: `end(t)` does at the beginning of a macro step what the loop does there."""

    def end(self, t: int) -> None:
        need = int(self.radio.counters[WAITING]) * copies(self.radio)
        if self.radio.counters[FREE_PLACES] < need:
            self.radio = grown(self.radio, need)
        if self.radio.counters[USED_EVENTS] + need > self.radio.events.size:
            events = np.zeros(2 * (self.radio.events.size + need), self.radio.events.dtype)
            events[: self.radio.events.size] = self.radio.events
            self.radio = self.radio._replace(events=events)
        serve_medium(self.radio, self.reals, t)


def slotted(nodes: int, **network: Any) -> Slots:
    return Slots({f"n{i}": [f"n{i}"] for i in range(nodes)}, medium="aloha", slot=SLOT / SECOND, **network)


# ---- a rate and a queue -----------------------------------------------------------------------------------------


def test_packets_of_a_node_follow_each_other_on_its_own_medium() -> None:
    air = each_alone(3, medium="own", rate=57_600.0, latency=0.001)
    for name in ("n0", "n0", "n1"):
        air.send(1000, name, packet(1))
    arrivals = [int(e["arrival"]) for e in air.events if air.nodes[e["target"]] == "n2"]
    begin = 1000 + SECOND // 1000
    assert arrivals == [begin + AIRTIME, begin + 2 * AIRTIME, begin + AIRTIME]
    assert set(air.events["sent"]) == {1000}


def test_on_a_shared_medium_nobody_talks_over_another() -> None:
    air = each_alone(3, medium="shared", rate=57_600.0)
    for name in ("n0", "n1", "n2", "n0"):
        air.send(0, name, packet(1))
    per_packet = [int(e["arrival"]) for e in air.events][::2]
    assert per_packet == [AIRTIME, 2 * AIRTIME, 3 * AIRTIME, 4 * AIRTIME]
    air.send(SECOND, "n1", packet(1))
    assert int(air.events[-1]["arrival"]) == SECOND + AIRTIME


def test_who_would_wait_too_long_is_lost_for_all_that_would_hear() -> None:
    air = each_alone(3, medium="shared", rate=57_600.0, queue=2.5 * AIRTIME / SECOND)
    for _ in range(6):
        air.send(0, "n0", packet(1))
    assert air.outcomes() == {"radio": 6, "lost: queue": 6}
    assert [int(o) for o in air.events["outcome"]] == [BY_RADIO] * 6 + [LOST_QUEUE] * 6


def test_what_nobody_hears_takes_no_time() -> None:
    air = each_alone(2, medium="shared", rate=57_600.0)
    air.send(0, "n0", packet(1, to=77))
    air.send(0, "n0", packet(1))
    assert air.outcomes() == {"lost: no route": 1, "radio": 1}
    assert int(air.events[-1]["arrival"]) == AIRTIME


def sensing(nodes: int, **network: Any) -> Slots:
    """Nodes with CSMA; unless given, a packet waits for at most a microsecond, and is lost if the medium is busy."""
    settings = {"rate": 57_600.0, "backoff": 1e-6, "queue": 0.0} | network
    return Slots({f"n{i}": [f"n{i}"] for i in range(nodes)}, medium="csma", **settings)


def position() -> bytes:
    """A GLOBAL_POSITION_INT: 40 bytes."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(mavlink.MAVLink_global_position_int_message(*[1] * 8, 36_000).pack(link))


@pytest.mark.parametrize("drones", [30, 36, 50, 100])
def test_57600_baud_saturate_below_fifty_drones(drones: int) -> None:
    """Positions, 4 times a second, are 160 N byte/s; the medium carries 5760: enough for 36 drones, 72 % for fifty."""
    links = frozenset({*((f"n{i}", "n0") for i in range(1, drones)), ("n0", "n1")})
    air = each_alone(drones, topology="listed", medium="shared", rate=57_600.0, links=links)
    seconds = 20
    sent = position()
    assert len(sent) == 40
    for quarter in range(4 * seconds):
        for i in range(drones):
            air.send(quarter * SECOND // 4, f"n{i}", sent)
    lost = air.outcomes().get("lost: queue", 0) / (4 * seconds * drones)
    kept = 5760.0 / (160.0 * drones)
    assert lost == pytest.approx(max(0.0, 1.0 - kept), abs=1.25 * kept / seconds)  # a queue of 1 s fills first
    assert (lost > 0.0) == (drones > 36)


# ---- slotted ALOHA ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [0.25, 0.5, 1.0, 2.0, 3.0])
def test_the_throughput_of_slotted_aloha(load: float) -> None:
    """S = G exp(-G): 0.368 of the slots at a load of one packet per slot (Roberts 1975)."""
    nodes, slots = 200, 4000
    links = frozenset((f"n{i}", "n0") for i in range(1, nodes))
    air = slotted(nodes, topology="listed", links=links)
    chance = np.random.default_rng(int(100 * load))
    sent = packet(1)
    for slot in range(slots):
        for node in chance.choice(nodes - 1, size=min(chance.poisson(load), nodes - 1), replace=False):
            air.send(slot * SLOT - int(chance.integers(0, SLOT)), f"n{node + 1}", sent)
        air.end(slot * SLOT)
    air.end((slots + 100) * SLOT)
    throughput = air.outcomes()["radio"] / slots
    expected = load * math.exp(-load)
    assert throughput == pytest.approx(expected, abs=4.0 * math.sqrt(expected * (1.0 - expected) / slots))
    assert air.radio.counters[WAITING] == 0


def test_a_packet_is_on_the_air_in_the_slot_behind_it() -> None:
    air = slotted(2, latency=0.001)
    air.send(3 * SLOT - 1, "n0", packet(1))
    air.end(4 * SLOT - 1)
    assert len(air.events) == 0 and air.radio.counters[WAITING] == 1
    air.end(4 * SLOT)
    (event,) = air.events
    assert (int(event["sent"]), int(event["arrival"])) == (3 * SLOT - 1, 4 * SLOT + SECOND // 1000)
    assert air.deliver(SECOND, "n1") == packet(1)
    air.send(5 * SLOT, "n0", packet(1))  # at the beginning of a slot: in it
    air.end(6 * SLOT)
    assert int(air.events[-1]["arrival"]) == 6 * SLOT + SECOND // 1000


def test_a_node_has_one_packet_in_a_slot_and_waits_no_longer_than_its_queue() -> None:
    air = slotted(2, queue=2.0 * SLOT / SECOND)
    for _ in range(4):
        air.send(0, "n0", packet(1))
    air.end(SECOND)
    assert sorted(int(e["arrival"]) for e in air.events) == [-1, SLOT, 2 * SLOT, 3 * SLOT]
    assert air.outcomes() == {"radio": 3, "lost: queue": 1}


def test_packets_collide_where_both_are_heard_and_senders_hear_nothing() -> None:
    """a - b - c - d in a row: a and c collide at b; d hears c alone; c, which sends, does not hear b."""
    row = frozenset(pair for a, b in ("ab", "bc", "cd") for pair in ((a, b), (b, a)))
    air = Slots({n: [n] for n in "abcd"}, medium="aloha", slot=SLOT / SECOND, topology="listed", links=row)
    air.send(0, "a", packet(1))
    air.send(1, "c", packet(3))  # slot 1; that of a is slot 0
    air.send(SLOT, "a", packet(1))
    air.end(2 * SLOT)
    fate = {(air.nodes[e["source"]], air.nodes[e["target"]], int(e["sent"])): int(e["outcome"]) for e in air.events}
    assert fate == {
        ("a", "b", 0): BY_RADIO,
        ("c", "b", 1): LOST_COLLISION,
        ("a", "b", SLOT): LOST_COLLISION,
        ("c", "d", 1): BY_RADIO,
    }
    air.send(5 * SLOT, "b", packet(2))
    air.send(5 * SLOT, "c", packet(3))
    air.end(6 * SLOT)
    last = {(air.nodes[e["source"]], air.nodes[e["target"]]): int(e["outcome"]) for e in air.events[-4:]}
    assert last == {
        ("b", "a"): BY_RADIO,
        ("b", "c"): LOST_COLLISION,
        ("c", "b"): LOST_COLLISION,
        ("c", "d"): BY_RADIO,
    }


def test_a_sender_out_of_range_disturbs_nobody() -> None:
    air = slotted(3, range=100.0)
    air.at("n2", 0.0, 150.0, 0.0)
    air.at("n1", 0.0, 50.0, 0.0)
    air.send(0, "n0", packet(1))
    air.send(0, "n1", packet(2))
    air.end(SECOND)
    fate = {(int(e["source"]), int(e["target"])): e["outcome"] for e in air.events}
    assert fate[1, 2] == BY_RADIO  # n0 is 150 m away
    assert fate[0, 1] == fate[1, 0] == LOST_COLLISION


@pytest.mark.parametrize("window", [4, 16])
def test_a_window_spreads_what_is_sent_at_once(window: int) -> None:
    """Two nodes that always send at once meet in one slot with 1 / window."""
    air = slotted(3, topology="listed", links=frozenset({("n0", "n2"), ("n1", "n2")}), window=window, seed=3)
    count = 2000
    for i in range(count):
        for name in ("n0", "n1"):
            air.send(i * (window + 2) * SLOT, name, packet(1))
        air.end(i * (window + 2) * SLOT)
    air.end(count * (window + 4) * SLOT)
    collided = air.outcomes()["lost: collision"] / (2 * count)
    sigma = math.sqrt(1.0 / window / count)
    assert collided == pytest.approx(1.0 / window, abs=5.0 * sigma)


def test_what_happens_in_slots_does_not_depend_on_the_order_or_the_steps() -> None:
    def fly(names: str, step: int) -> Counter[Any]:
        air = Slots(
            {name: [name] for name in names},
            medium="aloha",
            slot=SLOT / SECOND,
            window=3,
            loss=0.2,
            jitter=0.01,
            seed=5,
        )
        chance = np.random.default_rng(1)
        times = np.sort(chance.integers(0, 400 * SLOT, 300))
        senders = chance.choice(list("abcd"), 300)
        now = 0
        for t, name in zip(times, senders, strict=True):
            while now + step <= t:
                now += step
                air.end(now)
            air.send(int(t), name, packet(1, 0))
        air.end(500 * SLOT)
        return Counter(
            (air.nodes[e["source"]], air.nodes[e["target"]], int(e["sent"]), int(e["arrival"]), int(e["outcome"]))
            for e in air.events
        )

    assert fly("abcd", SLOT // 4) == fly("dcba", 7 * SLOT)


# ---- CSMA ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("delay", "load"), [(0.01, 1.0), (0.1, 0.5), (0.1, 2.0), (0.3, 2.0), (0.01, 6.0)])
def test_the_throughput_of_csma(delay: float, load: float) -> None:
    """Kleinrock and Tobagi (1975), non-persistent: S = G exp(-aG) / (G (1 + 2a) + exp(-aG)).

    S and G are packets received and sensings per time T of a packet on the air; a T is the time of sensing. Packets
    that find the medium busy are lost, so that the sensings form a Poisson process, as in the paper. Busy and idle
    times alternate with at most one success each, so the number of successes varies less than that of a Poisson
    process; its four standard deviations are allowed.
    """
    nodes, times = 40, 2500
    chance = np.random.default_rng(int(100 * load))
    sent = packet(1, to=200)
    scale = len(sent) * AIRTIME / LENGTH
    air = sensing(nodes, sensing=delay * scale / SECOND)
    air.radio.endpoints["heard"][0] = 200  # all packets are for n0
    count = chance.poisson(load * times)
    for t in np.sort(chance.uniform(0.0, times * scale, count)):
        air.end(int(t))
        air.send(int(t), f"n{chance.integers(1, nodes)}", sent)
    air.end(int(2 * times * scale))
    counts = air.outcomes()
    throughput = counts["radio"] / times
    alone = math.exp(-delay * load)
    expected = load * alone / (load * (1.0 + 2.0 * delay) + alone)
    assert throughput == pytest.approx(expected, abs=4.0 * math.sqrt(expected / times))
    assert sum(counts.values()) == count and air.radio.counters[WAITING] == 0


def test_who_hears_another_waits_and_who_begins_too_soon_collides() -> None:
    air = sensing(4, sensing=0.001)
    for t, name in ((0, "n0"), (2_000_000, "n1")):  # n1 hears n0, and gives up
        air.send(t, name, packet(1))
    air.end(SECOND)
    assert air.outcomes() == {"radio": 3, "lost: queue": 3}
    assert {int(e["arrival"]) - AIRTIME < 1000 for e in air.events[3:]} == {True}
    air = sensing(4, sensing=0.001)
    for t, name in ((0, "n0"), (900_000, "n1")):  # n1 does not hear it yet
        air.send(t, name, packet(1))
    air.end(SECOND)
    assert air.outcomes() == {"lost: collision": 6}


def test_a_busy_medium_is_sensed_again_until_it_is_free() -> None:
    """Three packets at once: each goes alone, and arrives after whole times on the air."""
    air = sensing(3, backoff=0.05, queue=1.0, seed=1)
    for name in ("n0", "n1", "n2"):
        air.send(0, name, packet(1))
    assert air.radio.counters[WAITING] == 3
    air.end(2 * SECOND)
    assert air.outcomes() == {"radio": 6}
    arrivals = sorted({int(e["arrival"]) for e in air.events})
    assert len(arrivals) == 3 and min(np.diff(arrivals)) >= AIRTIME
    assert set(air.events["sent"]) == {0}


def test_a_hidden_sender_is_not_sensed() -> None:
    """a - b - c: a and c do not hear each other, so c begins while a sends, and b receives neither; d receives c."""
    row = frozenset(pair for a, b in ("ab", "bc", "cd") for pair in ((a, b), (b, a)))
    air = Slots({n: [n] for n in "abcd"}, medium="csma", rate=57_600.0, backoff=1e-6, topology="listed", links=row)
    air.send(0, "a", packet(1))
    air.send(AIRTIME // 2, "c", packet(3))
    air.end(SECOND)
    fate = {(air.nodes[e["source"]], air.nodes[e["target"]]): int(e["outcome"]) for e in air.events}
    assert fate == {("a", "b"): LOST_COLLISION, ("c", "b"): LOST_COLLISION, ("c", "d"): BY_RADIO}


def test_csma_does_not_depend_on_the_order_or_the_steps() -> None:
    def fly(names: str, step: int) -> Counter[Any]:
        air = Slots(
            {name: [name] for name in names},
            medium="csma",
            rate=57_600.0,
            backoff=0.02,
            sensing=0.0005,
            queue=0.05,
            loss=0.2,
            seed=5,
        )
        chance = np.random.default_rng(1)
        now = 0
        for t, name in zip(np.sort(chance.integers(0, 2 * SECOND, 400)), chance.choice(list("abcd"), 400), strict=True):
            while now + step <= t:
                now += step
                air.end(now)
            air.send(int(t), name, packet(1, 0))
        air.end(5 * SECOND)
        counts = air.outcomes()
        assert min(counts[name] for name in ("radio", "lost: queue", "lost: collision", "lost: channel")) > 0
        return Counter(
            (air.nodes[e["source"]], air.nodes[e["target"]], int(e["sent"]), int(e["arrival"]), int(e["outcome"]))
            for e in air.events
        )

    assert fly("abcd", SECOND // 400) == fly("dcba", SECOND // 7)


def test_nothing_is_lost_unseen() -> None:
    air = slotted(4, window=2, loss=0.1, duplicates=0.2, seed=1)
    for n in range(4):
        spread(air, f"n{n}", 200, system=n + 1)
    air.end(1000 * SLOT)
    for name in air.names:
        while air.deliver(1000 * SECOND, name):
            pass
    counts = packet_counts(air.radio)
    assert counts["sent"] == 4 * 200 * 3 == counts["delivered"] + counts["lost"]
    assert counts["in flight"] == 0 and counts["lost: collision"] > 0
