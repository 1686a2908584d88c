"""Each kind of monitor on values made by hand: violated, kept, exactly at the limit, and not a number."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_master.network.radio.tables import BY_RADIO, EVENT, LOST_CHANNEL
from cosim_master.verdict.monitors.ages import AgeRule
from cosim_master.verdict.monitors.declared import (
    Age,
    Convergence,
    Fence,
    FormulaMonitor,
    Limit,
    Order,
    Quantity,
    Separation,
    Signal,
)
from cosim_master.verdict.monitors.formations import OrderRule, SeparationRule
from cosim_master.verdict.monitors.formula import parse
from cosim_master.verdict.monitors.rules import ConvergenceRule, FenceRule, FormulaRule, LimitRule, Rule, Samples
from cosim_master.verdict.monitors.violations import MOST, Violations

NAN, INF = math.nan, math.inf


def signals(count: int, elements: int = 1, quantity: Quantity = "value", unit: str = "m") -> tuple[Signal, ...]:
    return tuple(
        Signal(f"{'abcdefgh'[i]}.v", tuple((f"{i}", f"{j}") for j in range(elements)), unit, quantity)
        for i in range(count)
    )


def place(elements: int = 1) -> Callable[[tuple[str, str]], int]:
    return lambda variable: int(variable[0]) * elements + int(variable[1])


def feed(rule: Rule, values: Any, cuts: Sequence[int] = (), step: float = 1.0) -> Any:
    """Gives a rule rows, one per `step` seconds, in chunks that end before the rows `cuts`; returns its violations."""
    rows = np.asarray(values, float).reshape(len(values), -1)
    borders = [0, *cuts, len(rows)]
    for begin, end in pairwise(borders):
        first = max(begin - 1, 0)
        steps = np.arange(first, end)
        rule.look(Samples(steps, steps * step, rows[first:end], begin - first))
    return told(rule.violations)


def told(violations: Violations) -> list[tuple[int, float, float | None, float, float]]:
    """Subject, begin, end, worst value and its time."""
    return [(one.subject, one.begin, one.end, one.worst, one.worst_time) for one in violations.kept]


# ---- limits --------------------------------------------------------------------------------------------------------


def test_limits_of_a_signal() -> None:
    rule = LimitRule(Limit("speed", "limit", signals=signals(2), least=-1.0, most=5.0), place())
    rows = [(5, -1), (5.5, 0), (7, -1), (6, -1.5), (5, -1), (5, NAN)]
    found = feed(rule, rows)
    assert found[:2] == [(0, 1.0, 4.0, 7.0, 2.0), (1, 3.0, 4.0, -1.5, 3.0)]
    subject, begin, end, worst, _ = found[2]
    assert (subject, begin, end) == (1, 5.0, None) and math.isnan(worst)
    assert rule.who(0) == ("a.v",)
    assert rule.told(0, 7.0) == "a.v was 7 m, more than 5 m"
    assert rule.told(1, -1.5) == "b.v was -1.5 m, less than -1 m"
    assert rule.told(1, NAN) == "b.v was not a number"
    assert rule.violations.lasting(1, 8.0) == 1.0 + 3.0


def test_a_value_on_the_limit_is_allowed_to_the_last_bit() -> None:
    one = Limit("x", "limit", signals=signals(1), most=0.3)
    assert feed(LimitRule(one, place()), [[0.3], [0.29]]) == []
    assert feed(LimitRule(one, place()), [[math.nextafter(0.3, 1.0)]]) == [
        (0, 0.0, None, math.nextafter(0.3, 1.0), 0.0)
    ]


def test_magnitude_and_tilt() -> None:
    speed = LimitRule(Limit("v", "limit", signals=signals(1, 3, "magnitude"), most=5.0), place(3))
    assert feed(speed, [[3, 4, 0], [-3, 4, 0.1]]) == [(0, 1.0, None, pytest.approx(math.sqrt(25.01)), 1.0)]
    half = math.radians(30.0) / 2
    leaning = [math.cos(half), math.sin(half) * 0.6, math.sin(half) * 0.8, 0.0]
    turned = [math.cos(1.0), 0.0, 0.0, math.sin(1.0)]  # about the vertical: no tilt
    upside = [0.0, 2.0, 0.0, 0.0]  # not normalised
    tilt = LimitRule(Limit("t", "limit", signals=signals(1, 4, "tilt"), most=math.radians(29.0)), place(4))
    assert feed(tilt, [turned, leaning, turned, upside]) == [
        (0, 1.0, 2.0, pytest.approx(math.radians(30.0)), 1.0),
        (0, 3.0, None, pytest.approx(math.pi), 3.0),
    ]
    assert tilt.told(0, math.pi).startswith("a.v was tilted by 3.142")


def test_arrays_of_different_lengths() -> None:
    both = (Signal("a", (("0", "0"), ("0", "1")), "", "magnitude"), Signal("b", (("0", "2"),), "", "magnitude"))
    assert feed(LimitRule(Limit("n", "limit", signals=both, most=4.9), place()), [[3, 4, -4.95]]) == [
        (0, 0.0, None, 5.0, 0.0), (1, 0.0, None, 4.95, 0.0),
    ]  # fmt: skip


def test_a_monitor_judges_between_start_and_stop() -> None:
    one = Limit("x", "limit", start=0.3, stop=0.6, signals=signals(1), most=0.0)
    rows = [[1]] * 10
    assert feed(LimitRule(one, place()), rows, step=0.1) == [(0, pytest.approx(0.3), 0.6, 1.0, pytest.approx(0.3))]
    assert feed(LimitRule(one, place()), rows[:5], step=0.1)[0][2] is None


# ---- order ---------------------------------------------------------------------------------------------------------


def order(least: float = 0.0, start: float = -INF) -> OrderRule:
    return OrderRule(
        Order("order", "order", start=start, vehicles=signals(3, 3), axis=(0.0, 1.0, 0.0), least=least), place(3)
    )


def east(*places: float) -> list[float]:
    return [number for one in places for number in (7.0, one, -10.0)]


def test_vehicles_keep_their_order() -> None:
    rule = order()
    found = feed(rule, [east(5, 1, 9), east(5, 5, 9), east(5, 6, 9), east(10, 6, 9), east(5, 4, 9)])
    assert found == [(0, 2.0, 3.0, -1.0, 2.0), (1, 3.0, 4.0, -1.0, 3.0)]
    assert rule.who(0) == ("b.v", "a.v")
    assert rule.told(0, -1.0) == "a.v was 1 m before b.v, which it was to follow"


def test_order_with_a_distance() -> None:
    rule = order(2.0)
    assert feed(rule, [east(0, 3, 6), east(0, 2, 4), east(0, 1.5, 4)]) == [(0, 2.0, None, 1.5, 2.0)]
    assert rule.told(0, 1.5) == "b.v was only 1.5 m after a.v, less than 2 m"


def test_the_order_is_that_at_the_start_of_the_monitor() -> None:
    rows = [east(9, 5, 1), east(1, 5, 9), east(1, 5, 4.5)]
    assert feed(order(start=1.0), rows) == [(1, 2.0, None, -0.5, 2.0)]
    rule = order(start=1.0)
    feed(rule, rows[:2])
    again = order(start=1.0)
    again.recall(json.loads(json.dumps(rule.memory())))
    assert again.who(1) == ("b.v", "c.v")
    assert feed(order(), [east(1, 2, 3), east(1, NAN, 3)])[0][:3] == (0, 1.0, None)


# ---- separation ----------------------------------------------------------------------------------------------------


def separation(count: int, least: float) -> SeparationRule:
    vehicles = tuple(Signal(f"d{i}", tuple((f"{i}", f"{j}") for j in range(3)), "m") for i in range(count))
    return SeparationRule(Separation("far", "separation", vehicles=vehicles, least=least), place(3))


def test_separation_of_two() -> None:
    rule = separation(3, 2.0)
    rows = [(0, 0, 0, second, 0, 0, 9, 9, 9) for second in (2, 1.5, 2, 3)]
    assert feed(rule, rows) == [(1, 1.0, 3.0, 1.5, 1.0)]  # at 2 s the way from 1.5 m on is judged
    assert rule.who(1) == ("d0", "d1")
    assert rule.told(1, 1.5) == "d0 and d1 were 1.5 m apart, less than 2 m"
    assert feed(separation(2, 2.0), [(0, 0, 0, 2, 0, 0)] * 3) == []


def test_vehicles_that_pass_each_other_between_two_looks() -> None:
    rule = separation(2, 2.0)
    assert feed(rule, [(-10, 1, 0, 10, 0, 0), (10, 1, 0, -10, 0, 0)]) == [(1, 1.0, None, 1.0, 1.0)]


def test_a_position_that_is_not_a_number() -> None:
    for count in (3, 40):
        rule = separation(count, 2.0)
        points = np.zeros((3, count, 3))
        points[:, :, 0] = 10.0 * np.arange(count)
        points[1, 1, 2] = NAN
        found = feed(rule, points)
        assert [one[:3] for one in found] == [(count * count + 1, 1.0, 2.0)]
        assert rule.who(count * count + 1) == ("d1",)


@settings(max_examples=12)
@given(
    count=st.sampled_from([5, 40]),
    seed=st.integers(0, 1000),
    speed=st.sampled_from([0.02, 0.3, 3.0]),
    cuts=st.sets(st.integers(1, 29), max_size=5),
)
def test_all_pairs_that_come_too_near_are_found(count: int, seed: int, speed: float, cuts: set[int]) -> None:
    """Against all pairs, sampled finely between two looks; some are fast, and the chunks have any size."""
    chance = np.random.default_rng(seed)
    points = chance.uniform(0.0, 12.0, (1, count, 3)) + np.cumsum(chance.normal(0.0, speed, (30, count, 3)), axis=0)
    points[:, 0] += 4.0 * np.arange(30)[:, None]
    found = feed(separation(count, 1.2), points, sorted(cuts))
    first, second = np.triu_indices(count, 1)
    apart = points[:, first] - points[:, second]
    before = np.concatenate([apart[:1], apart[:-1]])
    near = np.full(before.shape[:2], np.inf)
    for part in np.linspace(0.0, 1.0, 101):
        near = np.minimum(near, np.linalg.norm(before + part * (apart - before), axis=2))
    number = {int(a * count + b): n for n, (a, b) in enumerate(zip(first, second, strict=True))}
    for pair, n in number.items():
        spells = [one for one in found if one[0] == pair]
        covered = [k for k in range(30) if any(b <= k and (e is None or k < e) for _, b, e, *_ in spells)]
        rows, close = np.flatnonzero(near[:, n] < 1.2), np.flatnonzero(np.abs(near[:, n] - 1.2) < 0.04 * (1.0 + speed))
        assert {*rows} - {*close} <= {*covered} <= {*rows} | {*close}


def test_results_do_not_depend_on_chunks() -> None:
    chance = np.random.default_rng(5)
    points = chance.uniform(0.0, 8.0, (1, 50, 3)) + np.cumsum(chance.normal(0.0, 0.2, (60, 50, 3)), axis=0)
    whole = feed(separation(50, 1.0), points)
    assert whole
    assert sorted(feed(separation(50, 1.0), points, range(1, 60))) == sorted(whole)


# ---- fences --------------------------------------------------------------------------------------------------------


def fence(**settings: Any) -> FenceRule:
    return FenceRule(Fence("fence", "fence", vehicles=signals(1, 3), **settings), place(3))


@pytest.mark.parametrize(
    ("settings", "inside", "border", "outside", "by"),
    [
        ({"radius": 5.0, "centre": (10.0, 0.0)}, (12, 1, 0), (15, 0, 0), (10, -7, 0), 2.0),
        ({"polygon": ((0.0, 0.0), (0.0, 10.0), (10.0, 10.0), (10.0, 0.0))}, (5, 5, 0), (10, 4, 0), (13, 14, 0), 5.0),
        ({"polygon": ((0.0, 0.0), (0.0, 9.0), (3.0, 9.0), (3.0, 3.0), (9.0, 3.0), (9.0, 0.0))},  # an L
         (1, 8, 0), (3, 5, 0), (5, 5, 0), 2.0),
        ({"polygon": ((0.0, 0.0), (10.0, 0.0), (5.0, 10.0))}, (5, 5, 0), (5, 10, 0), (5, 12, 0), 2.0),
        ({"ceiling": 30.0}, (1e4, 0, -29), (0, 0, -30), (0, 0, -31.5), 1.5),
        ({"floor": 2.0}, (1e4, 0, -3), (0, 0, -2), (0, 0, -1.5), 0.5),
        ({"radius": 5.0, "ceiling": 30.0}, (0, 4, 0), (5, 0, -30), (9, 0, -31), 4.0),
    ],
)  # fmt: skip
def test_fences(settings: Any, inside: Any, border: Any, outside: Any, by: float) -> None:
    rule = fence(**settings)
    assert feed(rule, [inside, border, outside, inside]) == [(0, 2.0, 3.0, pytest.approx(by), 2.0)]
    assert rule.told(0, by) == f"a.v was {by:g} m outside"
    found = feed(fence(**settings), [inside, (NAN, 0, NAN)])
    assert found[0][:3] == (0, 1.0, None)


@settings(max_examples=200)
@given(north=st.floats(-20, 20), east=st.floats(-20, 20))
def test_the_distance_to_a_convex_polygon(north: float, east: float) -> None:
    """A square, by its closed form."""
    rule = fence(polygon=((-5.0, -5.0), (-5.0, 5.0), (5.0, 5.0), (5.0, -5.0)))
    found = feed(rule, [(north, east, 0.0)])
    beyond = math.hypot(max(abs(north) - 5.0, 0.0), max(abs(east) - 5.0, 0.0))
    assert found == ([(0, 0.0, None, pytest.approx(beyond), 0.0)] if beyond > 0.0 else [])


# ---- convergence ---------------------------------------------------------------------------------------------------


def test_convergence() -> None:
    one = Convergence(
        "c", "convergence", start=1.0, signals=signals(2), goals=(10.0, -10.0), amplitude=8.0, time=2.0, floor=0.5
    )
    rule = ConvergenceRule(one, place())
    allowed = [8.0 * math.exp(-max(t - 1.0, 0.0) / 2.0) + 0.5 for t in range(4)]
    rows = [(99, 99), (10 - allowed[1] * 0.999, -10), (10 + allowed[2] * 1.001, -10), (10, -10 - 3)]
    assert feed(rule, rows) == [(0, 2.0, 3.0, pytest.approx(allowed[2] * 1.001), 2.0)]
    assert rule.told(0, 5.0) == "a.v was 5 m from its goal 10 m, more than its envelope allows"
    assert feed(ConvergenceRule(one, place()), [(1, 1), (1.5, -18.5)]) == []  # exactly amplitude + floor at the start
    assert feed(ConvergenceRule(one, place()), [(1, 1), (NAN, -10)])[0][:2] == (0, 1.0)


# ---- formulas ------------------------------------------------------------------------------------------------------


def formula(text: str, **of: int) -> FormulaRule:
    """`of`: numbers of columns by name of signal; all signals share the same columns."""
    made = {name: signals(count) for name, count in of.items()}
    return FormulaRule(
        FormulaMonitor("f", "formula", formula=parse(text), signals=made), place(), 1.0, lambda k: k * 1.0
    )


def test_a_formula_holds_for_each_column() -> None:
    rule = formula("x > 1 -> eventually[0,2] x <= 1", x=2)
    rows = [(0, 0), (2, 0), (3, 2), (2, 1), (0, 0), (0, 0), (2, 2), (2, 2)]
    assert feed(rule, rows) == [(0, 1.0, 2.0, -1.0, 1.0)]  # what depends on the time after the end is not judged
    assert rule.who(0) == ("a.v",)
    assert rule.told(0, -1.0) == "x > 1 -> eventually[0,2] x <= 1 was false for a.v, by 1"
    assert feed(formula("x > 1 -> eventually[0,2] x <= 1", x=2), rows, range(1, 8)) == [(0, 1.0, 2.0, -1.0, 1.0)]


def test_conjuncts_tell_which_of_them_was_violated() -> None:
    rule = formula("x >= 0 and y <= 2", x=1, y=2)
    assert feed(rule, [(0, 0), (1, 3)]) == [(3, 1.0, None, -1.0, 1.0)]
    assert rule.told(3, -1.0) == "y <= 2 was false for a.v, b.v, by 1"


def test_equal_is_judged_by_truth_and_not_by_robustness() -> None:
    rows = [[6], [5], [6], [6]]
    assert feed(formula("x != 6", x=1), rows) == [(0, 0.0, 1.0, 0.0, 0.0), (0, 2.0, None, 0.0, 2.0)]
    assert feed(formula("x == 6", x=1), rows) == [(0, 1.0, 2.0, -1.0, 1.0)]
    assert feed(formula("x < 6", x=1), [[6]]) == [(0, 0.0, None, 0.0, 0.0)]


def test_a_signal_that_is_not_a_number_violates_any_formula() -> None:
    rule = formula("not x > 1", x=2)
    found = feed(rule, [(0, 0), (0, NAN), (0, 0)])
    assert [one[:3] for one in found] == [(3, 1.0, 2.0)]
    assert rule.told(3, NAN) == "a signal was not a number: b.v"


def test_a_formula_of_time_alone() -> None:
    rule = formula("time < 2")
    assert feed(rule, np.zeros((4, 0))) == [(0, 2.0, None, -1.0, 3.0)]
    assert (rule.who(0), rule.told(0, -1.0)) == (("f",), "time < 2 was false")


# ---- ages ----------------------------------------------------------------------------------------------------------


def events(*rows: tuple[float, int, int, int], way: float = 0.0, relay: int | None = None) -> Any:
    """Arrival [s], endpoint of the origin, node of the receiver, outcome; `way`: s from the origin, by a relay."""
    made = np.zeros(len(rows), EVENT)
    for row, (arrival, origin, target, outcome) in zip(made, rows, strict=True):
        row["arrival"] = -1 if outcome != BY_RADIO else round(arrival * 1e9)
        row["source"], row["target"], row["outcome"] = origin if relay is None else relay, target, outcome
        row["origin"], row["born"] = origin, round((arrival - way) * 1e9)
        row["sent"] = round(arrival * 1e9)
    return made


def age(most: float = 1.0, **settings: Any) -> AgeRule:
    """Nodes a, b and c; a has the endpoints 0 and 1; a gateway has endpoint 4."""
    one = Age("age", "age", pairs=((0, 1), (2, 1)), nodes=("a", "b", "c"), most=most, **settings)
    return AgeRule(one, np.array([0, 0, 1, 2, 3]), 0.0)


def until(rule: AgeRule, *times: float) -> Any:
    for time in times:
        rule.look(Samples(np.zeros(1, np.int64), np.array([time]), np.zeros((1, 0)), 0))
    return told(rule.violations)


def test_age_of_the_last_packet() -> None:
    rule = age()
    sent = events((0.5, 0, 1, BY_RADIO), (1.5, 1, 1, BY_RADIO), (0.7, 3, 1, BY_RADIO), (1.6, 3, 1, LOST_CHANNEL))
    rule.packets(sent)
    rule.packets(events((1.6, 4, 1, BY_RADIO), (1.6, 2, 0, BY_RADIO), (2.9, 3, 1, BY_RADIO), (2.5, 0, 3, BY_RADIO)))
    assert until(rule, 1.7) == []  # exactly 1 s after the packet of c
    assert until(rule, 1.9) == [(1, 1.7, None, pytest.approx(1.2), 1.9)]
    assert until(rule, 2.5)[1:] == []  # exactly 1 s after that of a
    assert until(rule, 3.0) == [(1, 1.7, 2.9, pytest.approx(2.2), 2.9), (0, 2.5, None, pytest.approx(1.5), 3.0)]
    assert (rule.who(1), rule.told(1, 2.2)) == (("b", "c"), "b heard nothing newer than 2.2 s from c; the limit is 1 s")


def test_age_counts_from_the_origin_of_a_relayed_packet() -> None:
    """a's packets reach b by c's relay, endpoint 3, 0.75 s after they were sent: an old one ends no violation."""
    rule = age()
    rule.packets(events((0.5, 0, 1, BY_RADIO), (3.0, 3, 1, BY_RADIO)))
    rule.packets(events((1.0, 0, 1, BY_RADIO), (2.0, 0, 1, BY_RADIO), way=0.75, relay=3))
    assert until(rule, 1.5) == [(1, 1.0, None, pytest.approx(0.5 + 1.0), 1.5)]  # c itself has not been heard
    assert [one for one in until(rule, 2.5) if one[0] == 0] == [
        (0, 1.5, 2.0, pytest.approx(1.5), 2.0),  # that of 0.25 s is older than the one of 0.5 s
        (0, 2.25, None, pytest.approx(1.25), 2.5),  # that of 1.25 s arrived at 2 s
    ]
    late = age()
    late.packets(events((1.6, 0, 1, BY_RADIO), way=1.4, relay=3))  # heard when it is 1.4 s old: no end
    assert [one for one in until(late, 2.0) if one[0] == 0] == [(0, 1.0, None, pytest.approx(1.8), 2.0)]


def test_packets_in_flight_are_not_heard_yet_and_are_remembered() -> None:
    rule = age()
    rule.packets(events((0.9, 0, 1, BY_RADIO), (1.8, 0, 1, BY_RADIO), (0.9, 3, 1, BY_RADIO), (4.0, 3, 1, BY_RADIO)))
    until(rule, 1.0)
    again = age()
    again.recall(json.loads(json.dumps(rule.memory())))
    for one in (rule, again):
        assert sorted(until(one, 5.0)) == [
            (0, 2.8, None, pytest.approx(3.2), 5.0),
            (1, 1.9, 4.0, pytest.approx(3.1), 4.0),
        ]


def test_ages_count_from_the_start_of_the_monitor() -> None:
    assert until(age(start=3.0), 3.5, 4.0) == []
    assert until(age(start=3.0, stop=4.5), 6.0) == [(0, 4.0, 4.5, 1.5, 4.5), (1, 4.0, 4.5, 1.5, 4.5)]


# ---- records -------------------------------------------------------------------------------------------------------


def test_violations_beyond_the_limit_are_counted() -> None:
    rule = LimitRule(Limit("x", "limit", signals=signals(1), most=0.0), place())
    feed(rule, [[k % 2] for k in range(2 * MOST + 10)])
    assert len(rule.violations.kept) == MOST
    assert (rule.violations.count, rule.violations.lasting(0, 2.0 * MOST + 9.0)) == (MOST + 5, MOST + 4.0)


@given(cut=st.integers(1, 11), rows=st.lists(st.sampled_from([0.0, 1.0, 2.0, NAN]), min_size=12, max_size=12))
def test_violations_go_on_after_a_checkpoint(cut: int, rows: list[float]) -> None:
    one = Limit("x", "limit", signals=signals(1), most=0.5)
    whole, first, second = (LimitRule(one, place()) for _ in range(3))
    values = [[row] for row in rows]
    feed(whole, values)
    feed(first, values[:cut])
    second.violations.recall(json.loads(json.dumps(first.violations.memory())))
    steps = np.arange(cut - 1, 12)
    second.look(Samples(steps, steps * 1.0, np.array(values[cut - 1 :]), 1))
    assert repr(second.violations.memory()) == repr(whole.violations.memory())
