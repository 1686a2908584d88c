"""Effects of the radio against closed forms: bursts, weak signals, jamming, partitions, wrong bits, duplicates."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.packets import GOOD, find
from cosim_master.network.radio.build import packet_counts
from cosim_master.network.radio.tables import BY_RADIO, DUPLICATE
from cosim_master.system.settings.network import Channel, Jamming, Partition
from cosim_master.system.settings.radio.obstacles import Obstacle
from cosim_master.system.settings.radio.trace import Trace
from tests.master.network.test_radio import SECOND, Air, each_alone, fates, packet, spread

FIVE_SIGMA = 5.0


def lost_of(air: Air, hearer: str = "n1") -> np.ndarray[Any, Any]:
    """Whether each packet was lost on its way to a node, in the order of sending."""
    mine = air.events[air.events["target"] == air.nodes.index(hearer)]
    return np.asarray(mine["outcome"] != BY_RADIO)


def runs(lost: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Lengths of the bursts that begin and end within a record."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    return np.diff(edges)[::2]


# ---- bursts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("start", "end"), [(0.02, 0.2), (0.05, 0.5), (0.3, 0.7)])
def test_bursts_of_gilbert_and_elliott(start: float, end: float) -> None:
    """Stationary loss p / (p + r), mean burst 1 / r, and the transitions themselves."""
    air, count = each_alone(3, burst_start=start, burst_end=end, seed=5), 20_000
    spread(air, "n0", count)
    lost = lost_of(air)
    share, memory = start / (start + end), 1.0 - start - end
    sigma = math.sqrt(share * (1.0 - share) / count * (1.0 + memory) / (1.0 - memory))
    assert lost.mean() == pytest.approx(share, abs=FIVE_SIGMA * sigma)
    lengths = runs(lost)
    sigma = math.sqrt(1.0 - end) / end / math.sqrt(lengths.size)
    assert lengths.mean() == pytest.approx(1.0 / end, abs=max(FIVE_SIGMA * sigma, 1e-12))
    for state, leaves in ((False, start), (True, end)):
        after = lost[1:][lost[:-1] == state] != state
        sigma = math.sqrt(leaves * (1.0 - leaves) / after.size)
        assert after.mean() == pytest.approx(leaves, abs=FIVE_SIGMA * sigma)
    other = lost_of(air, "n2")
    both = (lost & other).mean()  # two hearers know nothing of each other
    assert both == pytest.approx(share**2, abs=FIVE_SIGMA * math.sqrt(share**2 / count * (1 + memory) / (1 - memory)))
    assert air.outcomes() == {
        "radio": int((~lost).sum() + (~other).sum()),
        "lost: burst": int(lost.sum() + other.sum()),
    }


def test_a_burst_may_let_some_through_and_has_loss_beside_it() -> None:
    air = each_alone(2, burst_start=0.1, burst_end=0.4, burst_loss=0.5, loss=0.1, seed=2)
    spread(air, "n0", 20_000)
    counts = air.outcomes()
    assert counts["lost: burst"] / 20_000 == pytest.approx(0.5 * 0.2, abs=0.015)
    assert counts["lost: channel"] / 20_000 == pytest.approx(0.9 * 0.1, abs=0.012)


def test_bursts_depend_on_seed_sender_hearer_and_number_only() -> None:
    def fly(names: str, together: int, seed: int = 3) -> dict[Any, Any]:
        air = Air({name: [name] for name in names}, burst_start=0.1, burst_end=0.3, seed=seed)
        for first in range(0, 120, together):
            for i, name in enumerate(names):
                air.send(first, name, b"".join(packet(i + 1, j) for j in range(first, first + together)))
        return {key: fate for key, fate in fates(air).items() if set(key[:2]) <= {"a", "b"}}

    assert fly("ab", 1) == fly("ba", 12) == fly("cbda", 5)
    assert fly("ab", 1) != fly("ab", 1, seed=4)


def test_a_link_has_bursts_of_its_own() -> None:
    channel = Channel("n0", "n1", ("n0",), ("n1",), burst_start=0.2, burst_end=0.3)
    air = each_alone(3, channels=(channel,))
    spread(air, "n0", 4000)
    spread(air, "n1", 500)
    assert lost_of(air).mean() == pytest.approx(0.4, abs=0.06)
    assert not lost_of(air, "n2").any() and not lost_of(air, "n0").any()


# ---- signals ----------------------------------------------------------------------------------------------------


def test_the_range_of_a_log_distance_path_loss() -> None:
    """20 dBm - 31.7 dB - 10 * 2.7 * lg(d) = -95 dBm at 10^(83.3 / 27) m."""
    air = each_alone(2, power=20.0, path_loss=31.7, exponent=2.7, sensitivity=-95.0)
    reach = 10.0 ** (83.3 / 27.0)
    for distance, outcome in ((0.0, "radio"), (reach * 0.9999, "radio"), (reach * 1.0001, "lost: signal")):
        air.at("n1", 0.6 * distance, 0.0, -0.8 * distance)
        before = Counter(air.outcomes())
        air.send(0, "n0", packet(1))
        assert Counter(air.outcomes()) - before == {outcome: 1}


@pytest.mark.parametrize("distance", [50.0, 100.0, 150.0])
def test_rayleigh_fading(distance: float) -> None:
    """The power is exponentially distributed: 1 - exp(-(least power) / (mean power)) is lost."""
    air = each_alone(2, power=20.0, path_loss=40.0, exponent=2.0, sensitivity=-60.0, rayleigh=True, seed=8)
    air.at("n1", distance, 0.0, 0.0)
    spread(air, "n0", 10_000)
    expected = 1.0 - math.exp(-((distance / 100.0) ** 2))  # at 100 m the mean is just enough
    assert lost_of(air).mean() == pytest.approx(expected, abs=FIVE_SIGMA * math.sqrt(0.25 / 10_000))


def test_shadowing_is_normal_the_same_both_ways_and_at_all_times() -> None:
    """All nodes at one place: 20 - 75 dBm against -60 dBm, with 6 dB of shadowing; Phi(5 / 6) of the pairs hear."""
    n = 50
    air = each_alone(n, power=20.0, path_loss=75.0, sensitivity=-60.0, shadowing=6.0, seed=4)
    heard = np.zeros((n, n), dtype=bool)
    for turn in range(2):
        for i in range(n):
            before = len(air.events)
            air.send(turn, f"n{i}", packet(1))
            row = np.zeros(n, dtype=bool)
            new = air.events[before:]
            row[new["target"][new["outcome"] == BY_RADIO]] = True
            if turn:
                assert (row == heard[i]).all()
            heard[i] = row
    assert (heard == heard.T).all()
    share = 0.5 * (1.0 + math.erf(5.0 / 6.0 / math.sqrt(2.0)))
    pairs = n * (n - 1)
    assert heard.sum() / pairs == pytest.approx(share, abs=FIVE_SIGMA * math.sqrt(share * (1 - share) / (pairs / 2)))


BOX = Obstacle(50.0, 0.0, 10.0, 40.0, 0.0, 30.0, 0.0, loss=10.0, attenuation=0.0)
POST = Obstacle(50.0, 0.0, 0.0, 0.0, 6.0, 30.0, 5.0, loss=10.0, attenuation=0.0)


@pytest.mark.parametrize(
    ("obstacle", "way", "inside"),
    [
        # Ways from (north, east, down) to (north, east, down), and the length inside, m.
        (BOX, (0, 0, -10, 100, 0, -10), 10.0),
        (BOX, (100, 0, -10, 0, 0, -10), 10.0),
        (BOX, (0, 0, -10, 50, 0, -10), 5.0),  # ends in it
        (BOX, (48, 0, -10, 52, 3, -10), 5.0),  # within it
        (BOX, (0, 0, -10, 40, 0, -10), 0.0),  # ends before it
        (BOX, (60, 0, -10, 100, 0, -10), 0.0),  # begins behind it
        (BOX, (0, 21, -10, 100, 21, -10), 0.0),  # passes by
        (BOX, (0, 0, -31, 100, 0, -31), 0.0),  # over it
        (BOX, (50, 0, -40, 50, 0, -5), 25.0),  # straight down into it
        (BOX, (20, 0, 0, 80, 0, -80), 0.0),  # rises by 4 m for each 3 m: 33 m high where it comes to the box
        (BOX, (30, 0, 0, 90, 0, -80), 12.5),  # comes in 20 m high, and leaves by the roof
        (POST, (0, 0, -10, 100, 0, -10), 12.0),
        (POST, (50, -50, -10, 50, 50, -10), 12.0),
        (POST, (0, 3.6, -10, 100, 3.6, -10), 9.6),  # a chord of the circle
        (POST, (0, 6.1, -10, 100, 6.1, -10), 0.0),
        (POST, (50, 0, -10, 100, 0, -10), 6.0),
        (POST, (50, 1, 0, 50, 1, -100), 30.0),  # along its axis
        (POST, (50, 7, 0, 50, 7, -100), 0.0),
        (POST, (0, 0, -4, 100, 0, -4), 0.0),  # under it
        (POST, (0, 0, -36, 100, 0, -36), 0.0),
    ],
)
def test_obstacles_in_the_way(obstacle: Obstacle, way: tuple[float, ...], inside: float) -> None:
    """Received at the least power that just suffices: the losses of distance and obstacle in closed form."""
    distance = max(math.dist(way[:3], way[3:]), 1.0)
    for loss, attenuation in ((10.0, 0.0), (0.0, 0.7), (3.0, 0.5)):
        behind = (loss if inside > 0.0 else 0.0) + attenuation * inside
        power = 20.0 - 31.7 - 20.0 * math.log10(distance) - behind
        one = replace(obstacle, loss=loss, attenuation=attenuation)
        for margin, outcome in ((-1e-6, "radio"), (1e-6, "lost: signal")):
            air = each_alone(2, sensitivity=power + margin, obstacles=(one,))
            air.at("n0", *way[:3])
            air.at("n1", *way[3:])
            air.send(0, "n0", packet(1))
            assert air.outcomes() == {outcome: 1}


def test_losses_of_several_obstacles_add_up() -> None:
    air = each_alone(3, sensitivity=20.0 - 31.7 - 40.0 - 20.0 - 1e-6, obstacles=(BOX, POST))
    air.at("n0", 0.0, 0.0, -10.0)
    air.at("n1", 100.0, 0.0, -10.0)
    air.at("n2", 0.0, 100.1, -10.0)
    air.send(0, "n0", packet(1))
    assert air.outcomes() == {"radio": 2}
    air = each_alone(2, sensitivity=20.0 - 31.7 - 40.0 - 20.0 + 1e-6, obstacles=(BOX, POST))
    air.at("n0", 0.0, 0.0, -10.0)
    air.at("n1", 100.0, 0.0, -10.0)
    air.send(0, "n0", packet(1))
    assert air.outcomes() == {"lost: signal": 1}


# ---- traces -----------------------------------------------------------------------------------------------------


def test_a_trace_is_replayed() -> None:
    """Literal rows; before the first row of a link it applies, and the last applies to the end."""
    rows = (
        (2.0, "n0", "n1", 0.0, 0.0),
        (1.0, "n0", "n1", 1.0, 0.25),
        (3.0, "n0", "n1", 1.0, 0.5),
        (0.0, "n2", "n1", 0.0, 0.0),
        (5.0, "n1", "n0", 0.0, 0.0),
    )
    air = each_alone(3, latency=0.125, jitter=0.0, loss=0.0, trace=Trace("x.csv", "", rows))
    for t in (0.5, 1.0, 1.999, 2.0, 2.999, 3.0, 99.0):
        for name in ("n0", "n1", "n2"):
            air.send(int(t * SECOND), name, packet(1))
    found = {
        (air.nodes[e["source"]], air.nodes[e["target"]], e["sent"] / SECOND): (e["arrival"] - e["sent"]) / SECOND
        for e in air.events
        if e["outcome"] == BY_RADIO
    }
    times = (0.5, 1.0, 1.999, 2.0, 2.999, 3.0, 99.0)
    delays = {0.5: 0.25, 1.0: 0.25, 1.999: 0.25, 3.0: 0.5, 99.0: 0.5}
    expected = {("n0", "n1", t): delay for t, delay in delays.items()}
    for way in (("n0", "n2"), ("n1", "n2"), ("n2", "n0")):  # not in the trace
        expected |= {(*way, t): 0.125 for t in times}
    assert found == expected
    assert air.outcomes() == {"radio": 5 + 3 * 7, "lost: trace": 2 + 7 + 7}


def test_a_trace_may_have_probabilities() -> None:
    air = each_alone(2, loss=1.0, trace=Trace("x.csv", "", ((0.0, "n0", "n1", 0.8, 0.01),)), seed=3)
    spread(air, "n0", 10_000)
    assert lost_of(air).mean() == pytest.approx(0.2, abs=FIVE_SIGMA * math.sqrt(0.16 / 10_000))
    assert {*air.outcomes()} == {"radio", "lost: trace"}


# ---- areas and partitions ---------------------------------------------------------------------------------------


def test_who_is_jammed_hears_nothing_and_is_heard() -> None:
    area = Jamming(north=10.0, east=0.0, radius=5.0, start=1.0, stop=2.0)
    air = each_alone(2, latency=0.5, jamming=(area,))
    air.at("n1", 10.0, 5.0, -80.0)  # at any height
    for sent, outcome in ((0.4, "radio"), (0.5, "lost: jammed"), (1.4, "lost: jammed"), (1.5, "radio")):
        before = Counter(air.outcomes())
        air.send(int(sent * SECOND), "n0", packet(1))
        assert Counter(air.outcomes()) - before == {outcome: 1}
    air.send(SECOND, "n1", packet(2))
    air.at("n1", 10.0, 5.001, 0.0)
    air.send(SECOND, "n0", packet(1))
    assert air.outcomes() == {"radio": 4, "lost: jammed": 2}


def test_a_partition_cuts_off_both_ways_and_nobody_within_a_side() -> None:
    air = each_alone(4, partitions=(Partition(("n0", "n2"), 1.0, 2.0),))
    for t in (0.999, 1.0, 1.999, 2.0):
        cut = 1.0 <= t < 2.0
        for i in range(4):
            before = len(air.events)
            air.send(int(t * SECOND), f"n{i}", packet(1))
            reached = {int(e["target"]) for e in air.events[before:] if e["outcome"] == BY_RADIO}
            assert reached == ({(i + 2) % 4} if cut else {0, 1, 2, 3} - {i})
    assert air.outcomes() == {"radio": 12 + 4 + 4 + 12, "lost: partition": 16}


# ---- wrong bits and duplicates ----------------------------------------------------------------------------------


def test_wrong_bits_arrive_and_break_the_crc() -> None:
    """Of packets of L bytes 1 - (1 - b)^(8 L) have an error; no receiver takes one of them for a packet."""
    errors, count = 0.002, 4000
    air = each_alone(2, bit_errors=errors, seed=6)
    wrong_bits = good = 0
    length = len(packet(1))
    share = 1.0 - (1.0 - errors) ** (8 * length)
    for i in range(count):
        sent = packet(1, i % 256)
        air.send(i, "n0", sent)
        got = air.deliver(i, "n1")
        assert len(got) == length
        different = np.bitwise_xor(np.frombuffer(got, np.uint8), np.frombuffer(sent, np.uint8))
        bits = int(np.unpackbits(different).sum())
        wrong_bits += bits
        *_, status = find(np.frombuffer(got, np.uint8).copy(), 0, length)
        assert (status == GOOD) == (bits == 0)
        try:
            parsed = mavlink.MAVLink(None).parse_buffer(got)
        except mavlink.MAVError:
            parsed = None
        understood = [one for one in parsed or () if one.get_type() == "HEARTBEAT"]
        good += len(understood)
        assert len(understood) == (bits == 0)
    counts = packet_counts(air.radio)
    assert counts["delivered"] == good and counts["lost: errors"] == count - good and counts["in flight"] == 0
    assert (count - good) / count == pytest.approx(share, abs=FIVE_SIGMA * math.sqrt(share * (1 - share) / count))
    mean = 8 * length * count * errors
    assert wrong_bits == pytest.approx(mean, abs=FIVE_SIGMA * math.sqrt(mean))


def test_duplicates_come_up_to_the_jitter_later_and_are_counted_apart() -> None:
    air = Air({"a": ["a"], "b": ["b.x", "b.y"]}, duplicates=0.25, latency=0.01, jitter=0.04, seed=9)
    spread(air, "a", 4000)
    first = {int(i): e for i, e in enumerate(air.events) if e["outcome"] == BY_RADIO}
    twice = [(air.events[i - 1], e) for i, e in enumerate(air.events) if e["outcome"] == DUPLICATE]
    assert len(first) == 4000
    assert len(twice) == pytest.approx(1000, abs=FIVE_SIGMA * math.sqrt(4000 * 0.25 * 0.75))
    delays = np.array([after["arrival"] - before["arrival"] for before, after in twice]) / 1e9
    assert delays.min() >= 0.0 and delays.max() < 0.04
    assert delays.mean() == pytest.approx(0.02, abs=FIVE_SIGMA * 0.04 / math.sqrt(12 * len(twice)))
    for endpoint in ("b.x", "b.y"):
        assert len(air.queue(endpoint)) == 4000 + len(twice)
    while air.deliver(SECOND, "b.x"):
        pass
    while air.deliver(SECOND, "b.y"):
        pass
    counts = packet_counts(air.radio)
    assert (counts["sent"], counts["delivered"], counts["duplicates"]) == (4000, 4000, len(twice))


@pytest.mark.parametrize("spacing", [0.005, 0.02, 0.04])
def test_jitter_reorders(spacing: float) -> None:
    """Of two packets `d` apart the second is first with (1 - d / J)^2 / 2, if both have a uniform delay up to J."""
    air = each_alone(2, latency=0.1, jitter=0.04, seed=12)
    for i in range(10_000):
        air.send(int(i * spacing * SECOND), "n0", packet(1, i % 256))
    overtaken = (np.diff(air.events["arrival"][::1])[::2] < 0).mean()
    expected = (1.0 - spacing / 0.04) ** 2 / 2.0
    assert overtaken == pytest.approx(expected, abs=FIVE_SIGMA * math.sqrt(0.25 / 5000) * (expected > 0))


def test_causes_that_did_not_occur_are_not_counted() -> None:
    air = each_alone(2, loss=0.5)
    spread(air, "n0", 50)
    assert [name for name in packet_counts(air.radio) if ":" in name] == [
        "lost: channel",
        "lost: range",
        "lost: outage",
        "lost: no route",
    ]
