"""Parts of the verdict: declarations, findings known before, distances, spells, earshot, limits, observers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.verdict import Bound, Condition, Formation, Logged, Neighbour, Role, Rotors
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.fmi.description.declarations import verdicts_as_json, verdicts_of_json
from cosim_master.fmi.description.read import describe
from cosim_master.stepping.observation import Observers, Seen
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import Network, network_of
from cosim_master.system.settings.radio.nodes import Node
from cosim_master.verdict import watching
from cosim_master.verdict.earshot import repeated, twice
from cosim_master.verdict.findings import Finding, Judgement
from cosim_master.verdict.prior import known_before
from cosim_master.verdict.watching.approach import Approach
from cosim_master.verdict.watching.limits import Limits, limits_of
from cosim_master.verdict.watching.spells import Spells
from tests.master.conftest import Workshop, variable

# ---- declarations --------------------------------------------------------------------------------------------------


def verdict_tool(inner: str) -> str:
    return (
        f'<VendorAnnotations><Tool name="org.uav-cosim.verdict"><Verdicts>{inner}</Verdicts></Tool></VendorAnnotations>'
    )


def test_verdicts_of_an_fmu_of_any_tool_are_read(workshop: Workshop) -> None:
    inner = (
        '<Position variable="p"/><Optional variable="u"/>'
        '<Condition variable="n" failed="9 10" by="t"/><Bound variable="y" least="-1" most="t" of="t">too much</Bound>'
    )
    place = [variable(f"p[{i}]", "output") for i in (1, 2, 3)]
    others = [variable("u"), variable("t", "parameter"), variable("n", "output", "Integer"), variable("y", "output")]
    fmu = describe(workshop.fmu("a.fmu", *place, *others, extra=verdict_tool(inner)))
    assert fmu.verdicts == {
        "p": Role.POSITION,
        "u": Role.OPTIONAL,
        "n": Condition(failed=(9, 10), by="t"),
        "y": Bound("t", -1.0, "t", "too much"),
    }
    assert not any("verdict" in note for note in fmu.notes)


@pytest.mark.parametrize(
    ("inner", "note"),
    [
        ('<Position variable="y"/>', 'its verdict <Position> of "y" is ignored: it must be of causality output and'),
        ('<Armed variable="z"/>', 'its verdict <Armed> of "z" is ignored: there is no such variable'),
        ('<Optional variable="r"/>', "it is of causality parameter, only inputs and outputs are optional"),
        (
            '<Great variable="y"/>',
            "there are Condition, Reason, Bound, Values, Formation, Rotors, Logged, Position, Attitude, Velocity",
        ),
        ('<Bound variable="y" most="limit"/>', 'there is no parameter "limit"'),
        ('<Bound variable="y" least="low"/>', 'least="low" must be a number'),
        ('<Bound variable="y" most="NaN"/>', "a number must not be NaN"),
        ('<Condition variable="n" failed="x"/>', "invalid literal for int()"),
        ('<Attitude variable="y"/>', "it must be of causality output and type Real, with 4 elements"),
        ('<Rotors variable="n"/>', "it must be of causality output and type Real"),
        ('<Rotors variable="y" count="k"/>', 'there is no parameter "k" of type Integer with 1 elements'),
        (
            '<Logged variable="y"><Value of="ATT" variable="q"/></Logged>',
            '<Value of="ATT"> needs a place in the log, and a variable: there is no "q"',
        ),
        ('<Serial variable="y"/>', 'its verdict <Serial> of "y" is ignored: it is of type Real and not a packet port'),
        ('<Formation variable="y"/>', "it needs the attribute step, an output"),
        ('<Formation variable="y" step="y"/>', 'output "y" is of type Real, it must be Integer'),
        ('<Formation variable="y" step="n" stays="still"/>', 'there is no parameter "still"'),
        ('<Formation variable="y" step="n"><Neighbour id="p"/></Formation>', "<Neighbour> needs the attributes id"),
        ('<Formation variable="y" step="n"><Neighbour id="p" gain="NaN"/></Formation>', "must not be NaN"),
    ],
)
def test_verdict_that_cannot_be_is_a_note(inner: str, note: str, workshop: Workshop) -> None:
    outputs = [variable("y", "output"), variable("n", "output", "Integer"), variable("r", "parameter")]
    fmu = describe(workshop.fmu("a.fmu", *outputs, extra=verdict_tool(inner)))
    assert fmu.verdicts == {}
    assert sum(note in text for text in fmu.notes) == 1


def test_formations_and_lines_of_an_fmu_of_any_tool_are_read(workshop: Workshop) -> None:
    inner = (
        '<Formation variable="y" step="n" stays="b" period="t"><Neighbour id="i" gain="t"/>'
        '<Neighbour id="i" gain="0.5"/></Formation><Telemetry variable="sky"/><StartPosition variable="p"/>'
    )
    place = [variable(f"p[{i}]", "parameter") for i in (1, 2, 3)]
    outputs = [variable("y", "output"), variable("n", "output", "Integer"), variable("sky", kind="String")]
    others = [variable("t", "parameter"), variable("i", "parameter", "Integer"), variable("b", "parameter", "Boolean")]
    port = '<Tool name="uav-cosim"><PacketPorts><PacketPort variable="sky" maxSize="300"/></PacketPorts></Tool>'
    extra = verdict_tool(inner).replace("<VendorAnnotations>", f"<VendorAnnotations>{port}")
    fmu = describe(workshop.fmu("a.fmu", *place, *outputs, *others, extra=extra))
    assert fmu.verdicts == {
        "y": Formation("n", "b", (Neighbour("i", "t"), Neighbour("i", 0.5)), period="t"),
        "sky": Role.TELEMETRY,
        "p": Role.START_POSITION,
    }
    assert verdicts_of_json(json.loads(json.dumps(verdicts_as_json(fmu.verdicts)))) == fmu.verdicts


def test_attitude_and_rotors_of_an_fmu_of_any_tool_are_read(workshop: Workshop) -> None:
    inner = '<Attitude variable="q"/><Rotors variable="w" count="n" forward="x" right="y" down="z" direction="d"/>'
    inner += '<Logged variable="shown"><Value of="ATT" variable="q"/><Value of="RATE.Out" variable="shown"/></Logged>'
    outputs = [variable("shown", "output"), *(variable(f"q[{i}]", "output") for i in (1, 2, 3, 4))]
    outputs += [variable(f"w[{i}]", "output") for i in (1, 2)]
    hubs = [variable(f"{name}[{i}]", "parameter") for name in "xyzd" for i in (1, 2)]
    count = variable("n", "parameter", "Integer")
    fmu = describe(workshop.fmu("a.fmu", *outputs, *hubs, count, extra=verdict_tool(inner)))
    assert fmu.verdicts == {
        "q": Role.ATTITUDE,
        "w": Rotors("n", "x", "y", "z", "d"),
        "shown": Logged((("ATT", "q"), ("RATE.Out", "shown"))),
    }
    assert verdicts_of_json(json.loads(json.dumps(verdicts_as_json(fmu.verdicts)))) == fmu.verdicts
    short = describe(workshop.fmu("b.fmu", *outputs, *hubs[:-1], count, extra=verdict_tool(inner)))
    assert "w" not in short.verdicts
    assert any('there is no parameter "d" of type Real with 2 elements' in note for note in short.notes)


# ---- known before --------------------------------------------------------------------------------------------------


def before(path: Path, overrides: dict[str, str] | None = None) -> list[Finding]:
    with read_system(path) as structure:
        checked = check(structure, overrides)
        return known_before(checked, network_of(checked))


def test_open_inputs_have_their_own_names(workshop: Workshop) -> None:
    """Only an index at the end is that of an element."""
    inputs = [variable(name, start=start) for name, start in (("body[1].f", "1"), ("body[2].t", "2"), ("m[1,1]", "3"))]
    inputs += [variable("m[1,2]", start="4"), variable("body[3].k[1]", start="5"), variable("body[3].k[2]", start="5")]
    workshop.fmu("a.fmu", *inputs, step=0.1)
    root = workshop.system(workshop.component("a", "a.fmu") + workshop.component("b", "a.fmu"))
    texts = [one.text.partition(";")[0] for one in before(workshop.ssd("s.ssd", root))]
    sets = "and the system does not set it: it stays at its start value"
    assert texts == [
        f"nothing drives a.body[1].f, b.body[1].f, {sets} 1",
        f"nothing drives a.body[2].t, b.body[2].t, {sets} 2",
        "nothing drives a.m, b.m (2 elements), and the system does not set it: they stay at their start values 3, 4",
        f"nothing drives a.body[3].k, b.body[3].k (2 elements), {sets} 5",
    ]


def test_open_inputs_are_told_once_for_all_instances(workshop: Workshop) -> None:
    """Of an FMU of another tool it is a note; connected, set, optional ones and packets are silent."""
    inputs = [variable(name) for name in ("u", "v", "wind[1]", "wind[2]")]
    extra = verdict_tool('<Optional variable="wind"/>')
    workshop.fmu("a.fmu", *inputs, variable("y", "output"), extra=extra, step=0.1)
    set_v = workshop.bindings({"b.v": 2.0})
    parts = workshop.component("a", "a.fmu", "u:input v:input y:output")
    parts += workshop.component("b", "a.fmu", "u:input v:input y:output") + workshop.component("c", "a.fmu")
    root = workshop.system(parts, workshop.connection("a/y", "b/u"), bindings=set_v)
    found = before(workshop.ssd("s.ssd", root))
    assert [(one.kind, one.severity, one.who) for one in found] == [
        ("open input", "note", ("a.u", "c.u")),
        ("open input", "note", ("a.v", "c.v")),
    ]
    assert found[0].text == (
        "nothing drives a.u, c.u, and the system does not set it: it stays at its start value 0; "
        "connect it or set a value"
    )


def test_one_fmu_alone_may_have_open_inputs(workshop: Workshop) -> None:
    workshop.fmu("a.fmu", variable("u"), step=0.1)
    assert before(workshop.ssd("s.ssd", workshop.system(workshop.component("a", "a.fmu")))) == []


def test_angles_that_can_only_be_degrees(workshop: Workshop) -> None:
    """A full turn and more than 360 are not taken for degrees, nor are angles in deg or angular velocities."""
    names = ("a", "b", "c", "d")
    workshop.fmu("a.fmu", *[variable(name, "parameter", unit="rad") for name in names], step=0.1)
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("x", "a.fmu")))
    given = {"x.a": "-35.36", "x.b": "6.28", "x.c": "361", "x.d": "360"}
    found = before(path, given)
    assert [one.text for one in found] == [
        "--set: x.a is -35.36 rad, more than a full turn; did you mean -0.617148 (= -35.36 degrees)?",
        "--set: x.d is 360 rad, more than a full turn; did you mean 6.28319 (= 360 degrees)?",
    ]
    assert {one.kind for one in found} == {"degrees for radians"}


def test_misspelt_parameter_is_a_warning(workshop: Workshop) -> None:
    """One of a component that is not there may belong to another system that shares the parameter set."""
    workshop.fmu("a.fmu", variable("mass", "parameter"), step=0.1)
    given = workshop.bindings({"x.mas": 2.0, "drone7.engine.power": 1.0})
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("x", "a.fmu"), bindings=given))
    (found,) = before(path)
    assert (found.kind, found.severity, found.who) == ("sets nothing", "warning", ("x.mas",))
    assert found.text.endswith('parameter "x.mas" sets nothing; did you mean "x.mass"?')
    assert re.match(r".*s\.ssd:\d+: ", found.text)


def test_own_start_value_out_of_range_is_a_note(workshop: Workshop) -> None:
    workshop.fmu("a.fmu", variable("p", "parameter", min="1", max="2", start="5"), step=0.1)
    found = before(workshop.ssd("s.ssd", workshop.system(workshop.component("x", "a.fmu"))))
    assert [(one.kind, one.severity, one.text) for one in found] == [
        ("out of range", "note", "x.p is 5, outside of its range; valid: 1 to 2")
    ]
    path = workshop.root / "s.ssd"
    assert before(path, {"x.p": "1.5"}) == []


# ---- limits --------------------------------------------------------------------------------------------------------


def limits(workshop: Workshop, content: str) -> Limits:
    workshop.fmu("a.fmu", variable("y", "output"), step=0.1)
    after = workshop.annotation("org.uav-cosim.verdict", content) if content else ""
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("a", "a.fmu"), after=after))
    with read_system(path) as structure:
        return limits_of(check(structure))


def test_limits_of_a_system(workshop: Workshop) -> None:
    space = 'xmlns="https://uav-cosim.org/ns/1"'
    assert limits(workshop, "") == Limits(contact=0.5, deviation=5.0)
    assert limits(workshop, f'<verdict {space} contact="2" deviation="INF"/>') == Limits(2.0, float("inf"))
    with pytest.raises(SystemDescriptionError) as caught:
        limits(workshop, f'<verdict {space} contact="-1" near="2"><x/></verdict>')
    assert 'contact="-1" must be a number from 0 to 1e+06' in str(caught.value)
    assert "attribute near: valid are contact, deviation" in str(caught.value)


# ---- distances -----------------------------------------------------------------------------------------------------


def brute_force(times: Any, points: Any) -> dict[tuple[int, int], float]:
    """The least distance of each pair, between looks on straight lines: minimum of a parabola, sampled finely too."""
    found, fine = {}, np.linspace(0.0, 1.0, 201)[:, None]
    for a, b in combinations(range(points.shape[1]), 2):
        apart = points[:, a] - points[:, b]
        between = apart[:-1, None] + fine * np.diff(apart, axis=0)[:, None]
        found[a, b] = float(np.sqrt(np.einsum("ijk,ijk->ij", between, between).min()))
    return found


@pytest.mark.parametrize("count", [2, 5, 60])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nearest_approach_and_contacts_are_those_of_all_pairs(count: int, seed: int) -> None:
    """Some of them far away and fast; looked at in pieces, of which each begins where the last one ended."""
    chance = np.random.default_rng(seed)
    times = np.arange(31) * 0.1
    points = chance.uniform(0.0, 20.0, (1, count, 3)) + np.cumsum(chance.normal(0.0, 0.4, (31, count, 3)), axis=0)
    points[:, 0] += 30.0 * times[:, None]
    approach = Approach(count, 1.5)
    for begin in (0, 10, 20):
        approach.look(times[begin : begin + 11], points[begin : begin + 11])
    wanted = brute_force(times, points)
    least = min(wanted, key=wanted.__getitem__)
    assert approach.pair == least
    assert approach.distance == pytest.approx(wanted[least], abs=0.01)
    assert approach.distance <= wanted[least] + 1e-12
    sure = {pair for pair, distance in wanted.items() if distance < 1.49}
    assert sure <= approach.contacts.keys() <= {pair for pair, distance in wanted.items() if distance < 1.51}
    for pair, contact in approach.contacts.items():
        assert contact.distance == pytest.approx(wanted[pair], abs=0.01)


@pytest.mark.parametrize("count", [4, 40])
@pytest.mark.parametrize("far", [1e155, 1e300, -1.7e308])
def test_bodies_too_far_away_for_their_squares_hide_no_others(count: int, far: float) -> None:
    """A difference of two infinite squares is no number, and the least of numbers with one that is none is that one."""
    points = np.zeros((2, count, 3))
    points[:, :, 0] = 10.0 * np.arange(count)
    points[1, 2, 0] = 11.0  # from 20 m, to 1 m from the second
    points[:, 0, 1], points[:, 3, 1] = (far, -far), (far, 0.0)
    approach = Approach(count, 1.5)
    approach.look(np.array([0.0, 1.0]), points)
    assert (approach.distance, approach.pair, approach.time) == (1.0, (1, 2), 1.0)
    assert [*approach.contacts] == [(1, 2)]


def test_two_that_pass_between_two_looks_meet_there() -> None:
    approach = Approach(2, 0.5)
    approach.look(np.array([4.0, 4.1]), np.array([[[0.0, 0, 0], [1.0, 0, 0]], [[1.0, 0, 0], [0.0, 0, 0]]]))
    assert (approach.distance, approach.time) == (0.0, pytest.approx(4.05))
    assert approach.contacts[0, 1].since == 4.0


def test_one_look_is_enough_for_those_that_stand() -> None:
    approach = Approach(2, 0.5)
    approach.look(np.array([0.0]), np.array([[[0.0, 0, 0], [3.0, 4.0, 0]]]))
    assert (approach.distance, approach.pair, approach.contacts) == (5.0, (0, 1), {})


def compared(count: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """Pairs that are compared in ten looks at a square of vehicles that move at 5 m/s, 10 m apart."""
    side = int(count**0.5)
    places = np.stack([*np.meshgrid(np.arange(side) * 10.0, np.arange(side) * 10.0), np.zeros((side, side))], axis=-1)
    chance = np.random.default_rng(4)
    speeds = chance.uniform(-5.0, 5.0, (1, side * side, 3))
    points = places.reshape(1, -1, 3) + speeds * (np.arange(11) * 0.1)[:, None, None]
    total = 0
    approach = Approach(side * side, 0.5)

    def count_them(self: Approach, times: Any, points: Any, first: Any, second: Any) -> None:
        nonlocal total
        total += len(first)
        real(self, times, points, first, second)

    real = Approach._compare
    monkeypatch.setattr(Approach, "_compare", count_them)
    approach.look(np.arange(11) * 0.1, points)
    monkeypatch.setattr(Approach, "_compare", real)
    return total


def test_work_grows_linearly_with_the_number_of_vehicles(monkeypatch: pytest.MonkeyPatch) -> None:
    few, many = compared(100, monkeypatch), compared(1600, monkeypatch)
    assert few < 100 * 12
    assert many < 1600 * 12


def test_one_that_flies_away_fast_does_not_make_all_be_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.zeros((2, 400, 3))
    points[:, :, 0] = np.arange(400) * 10.0
    points[1, 7] = (1e9, -1e9, 0.0)
    total = 0

    def count_them(self: Approach, times: Any, points: Any, first: Any, second: Any) -> None:
        nonlocal total
        total += len(first)

    monkeypatch.setattr(Approach, "_compare", count_them)
    Approach(400, 0.5).look(np.array([0.0, 0.1]), points)
    assert total < 400 * 4


def test_pairs_are_looked_up_again_only_when_bodies_move_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line of 60 that flies along together; then the last one crosses it and comes within 0.2 m of number 20."""
    looked_up = 0

    def count_them(*arguments: Any) -> Any:
        nonlocal looked_up
        looked_up += 1
        return real(*arguments)

    real = watching.approach.pairs_within
    monkeypatch.setattr(watching.approach, "pairs_within", count_them)
    approach = Approach(60, 0.5)
    times = np.arange(11) * 0.1
    line = np.zeros((60, 3))
    line[:, 0] = np.arange(60) * 10.0
    for second in range(10):
        along = (second + times)[:, None] * np.array([7.0, -3.0, 0.0])
        approach.look(second + times, line + along[:, None])
    assert looked_up == 1
    assert (approach.distance, approach.contacts) == (pytest.approx(10.0), {})
    for second in range(10, 60):
        points = line + (second + times)[:, None, None] * np.array([7.0, -3.0, 0.0])
        points[:, 59] += (second - 10 + times)[:, None] * np.array([-7.8, 0.0, 0.0]) + np.array([0.0, 0.2, 0.0])
        approach.look(second + times, points)
    assert (20, 59) in approach.contacts
    assert approach.distance == pytest.approx(0.2)
    assert approach.contacts.keys() == {(n, 59) for n in range(20, 59)}
    assert 2 < looked_up < 55


# ---- spells --------------------------------------------------------------------------------------------------------


def test_spells() -> None:
    spells = Spells(3)
    holds = np.array([[0, 0, 1], [1, 0, 1], [1, 0, 0], [0, 0, 0], [1, 0, 0]], dtype=bool)
    values = np.array([[9, 9, 1], [2, 9, 3], [4, 9, 9], [9, 9, 9], [1, 9, 9]], dtype=float)
    spells.look(np.array([0.0, 1.0, 2.0]), holds[:3], values[:3])
    spells.look(np.array([3.0, 5.0]), holds[3:], values[3:])
    np.testing.assert_array_equal(spells.first, [1.0, np.nan, 0.0])
    np.testing.assert_array_equal(spells.longest, [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(spells.total, [1.0, 0.0, 1.0])
    np.testing.assert_array_equal(spells.open, [True, False, False])
    np.testing.assert_array_equal(spells.worst, [4.0, -np.inf, 3.0])
    np.testing.assert_array_equal(spells.worst_time, [2.0, np.nan, 1.0])


# ---- earshot -------------------------------------------------------------------------------------------------------


def network(count: int, **settings: Any) -> Network:
    return Network(nodes=tuple(Node(f"n{i}", ()) for i in range(count)), **settings)


def ids(*values: int) -> Sequence[dict[str, int]]:
    return [{"sysid": value} for value in values]


ON_A_LINE = np.array([[0.0, 10.0 * i, 0.0] for i in range(5)])


def test_in_a_broadcast_everybody_hears_everybody() -> None:
    found = twice(network(4), ids(1, 2, 3, 1))
    assert [(one.system_id, one.nodes, one.listener) for one in found] == [(1, ("n0", "n3"), "n0")]
    assert twice(network(4), ids(1, 2, 3, 4)) == []
    assert repeated(ids(1, 2, 1)) == {1: [0, 2]}


def test_listed_links_decide_who_hears_two_of_one_id() -> None:
    links = {(f"n{i}", f"n{i + 1}") for i in range(4)}
    line = network(5, topology="listed", links=frozenset(links | {(b, a) for a, b in links}))
    assert [one.listener for one in twice(line, ids(1, 2, 1, 4, 5))] == ["n1"]
    assert twice(line, ids(1, 2, 3, 1, 5)) == []
    assert [one.nodes for one in twice(line, ids(1, 1, 3, 4, 5))] == [("n0", "n1")]
    one_way = network(2, topology="listed", links=frozenset({("n0", "n1")}))
    assert [one.listener for one in twice(one_way, ids(1, 1))] == ["n1"]


def test_places_decide_where_the_range_is_limited_or_the_nearest_hear() -> None:
    near = network(5, range=15.0)
    assert twice(near, ids(1, 2, 3, 1, 5), ON_A_LINE) == []
    assert [one.listener for one in twice(near, ids(1, 2, 1, 4, 5), ON_A_LINE)] == ["n1"]
    for own in ({"axis": (0.0, 1.0, 0.0), "neighbours": 1}, {"neighbours": 1}):
        nearest = network(5, topology="nearest", **own)
        assert [one.listener for one in twice(nearest, ids(1, 2, 1, 4, 5), ON_A_LINE)] == ["n1"]
        assert twice(nearest, ids(1, 2, 3, 4, 1), ON_A_LINE) == []


@settings(max_examples=60)
@given(data=st.data())
def test_the_same_ids_are_found_as_from_all_pairs(data: st.DataObject) -> None:
    """The definition, of all pairs of nodes, against the search near each node."""
    count = data.draw(st.integers(2, 14))
    at = st.tuples(*[st.floats(-40.0, 40.0) | st.sampled_from([0.0, 10.0, 20.0, math.nan, 1e20])] * 3)
    places = np.array(data.draw(st.lists(at, min_size=count, max_size=count)))
    names = [f"n{i}" for i in range(count)]
    pairs = st.tuples(st.sampled_from(names), st.sampled_from(names)).filter(lambda p: p[0] != p[1])
    topology = data.draw(st.sampled_from(["broadcast", "listed", "nearest"]))
    chosen = network(
        count,
        topology=topology,
        range=data.draw(st.sampled_from([math.inf, 0.0, 10.0, 25.0, 1e30])),
        neighbours=data.draw(st.integers(1, 4)),
        axis=data.draw(st.sampled_from([None, (0.0, 1.0, 0.0)])) if topology == "nearest" else None,
        links=data.draw(st.frozensets(pairs)) if topology == "listed" else frozenset(),
    )
    own = data.draw(st.lists(st.integers(1, 3), min_size=count, max_size=count))
    found = {one.system_id: one for one in twice(chosen, ids(*own), places)}
    for value in set(own):
        of = [n for n in range(count) if own[n] == value]
        hears = [sum(heard(chosen, places, a, b) for a in of) for b in range(count)]
        best = hears.index(max(hears))
        if len(of) < 2 or max(hears) < 2:
            assert value not in found
        else:
            assert found[value].listener == f"n{best}"
            assert found[value].nodes == tuple(f"n{a}" for a in of if heard(chosen, places, a, best))


def heard(one: Network, places: Any, a: int, b: int) -> bool:
    """Returns whether node b is node a, or hears it: the definition."""
    if a == b:
        return True
    apart = np.linalg.norm(places - places[a], axis=1)
    if one.range < math.inf and not apart[b] <= one.range:
        return False
    if one.topology == "listed":
        return (f"n{a}", f"n{b}") in one.links
    if one.topology == "nearest" and one.axis is not None:
        order = list(np.argsort(places @ np.array(one.axis), kind="stable"))
        return abs(order.index(a) - order.index(b)) <= one.neighbours
    if one.topology == "nearest":
        apart[a] = math.inf
        return b in list(np.argsort(apart, kind="stable")[: min(one.neighbours, len(places) - 1)])
    return True


# ---- observers -----------------------------------------------------------------------------------------------------


class Run:
    """Stands in for an execution: its values are its base step."""

    def __init__(self) -> None:
        self.k = 0
        self.plan: Any = SimpleNamespace(real_out=np.zeros(1), int_out=np.zeros(1, np.int32))

    @property
    def time(self) -> float:
        return 0.5 * self.k

    def advance(self, k_stop: int) -> None:
        self.k = min(k_stop, 10)
        self.plan.real_out[0] = self.k


class Diary:
    """Notes its looks."""

    def __init__(self, every: int) -> None:
        self.every, self.looks = every, list[Any]()

    def initialised(self, seen: Seen) -> None:
        self.looks.append(("initialised", seen.time))

    def stepped(self, seen: Seen) -> None:
        self.looks.append((seen.time, float(seen.reals[0])))
        with pytest.raises(ValueError, match="read-only"):
            seen.reals[0] = 1.0

    def closed(self) -> None:
        self.looks.append("closed")


@pytest.mark.parametrize("chunk", [1, 2, 3, 7, 100])
def test_looks_come_at_the_same_instants_however_a_run_is_cut(chunk: int) -> None:
    run, often, seldom, never = Run(), Diary(2), Diary(4), Diary(0)
    observers = Observers(run, [often, seldom, never], 10)
    while run.k < 10:
        observers.advance(run.k + chunk)
    observers.close()
    begin = ("initialised", 0.0)
    assert often.looks == [begin, (1.0, 2.0), (2.0, 4.0), (3.0, 6.0), (4.0, 8.0), (5.0, 10.0), "closed"]
    assert seldom.looks == [begin, (2.0, 4.0), (4.0, 8.0), (5.0, 10.0), "closed"]  # the last one at the end
    assert never.looks == []


# ---- judgements ----------------------------------------------------------------------------------------------------


def test_judgement_is_in_order_and_as_json() -> None:
    found = [
        Finding("note", "note", (), "n"),
        Finding("late", "warning", ("b",), "w", 3.0),
        Finding("fell", "failure", ("a",), "f", 2.0, {"height": 1.5}),
        Finding("open", "warning", ("c",), "o"),
    ]
    verdict = Judgement.of(found, 0.0, 5.0)
    assert [one.text for one in verdict.findings] == ["f", "o", "w", "n"]
    assert not verdict.good
    assert Judgement.of(found[:1], 0.0, 5.0).good
    written = verdict.as_json()
    counts = {name: written.pop(name) for name in ("failures", "warnings", "notes")}
    assert counts == {"failures": 1, "warnings": 2, "notes": 1}
    assert written.pop("findings")[0] == {
        "kind": "fell",
        "severity": "failure",
        "who": ["a"],
        "time": 2.0,
        "text": "f",
        "numbers": {"height": 1.5},
    }
    assert written == {"good": False, "from": 0.0, "to": 5.0, "nearest": None}
