"""Gauss-Seidel and delayed connections: what is set when, in which order, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.network.radio.build import make_radio
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.instances import collect_all
from cosim_master.stepping.kernels.macro_step import run
from cosim_master.stepping.kernels.tables import DONE
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.plan import make_plan
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.master import Delay, MasterSettings, master_settings_of
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import time_grid
from tests.master.fmus.scripted import HERE, Scripted, system_of, variable

pytestmark = pytest.mark.usefixtures("own_cache")

U, Y = variable("u", "input"), variable("y", "output", reference=1)


class Loop:
    """Scripted instances in the stepping loop, coupled as is said."""

    def __init__(self, instances: list[Scripted], links: list[Any], until: float, master: MasterSettings) -> None:
        self.slaves = sorted(instances, key=lambda one: one.name)
        checked = system_of(instances, links)
        network = Network()
        layout = make_layout(checked, network, (), master)
        clock = time_grid(checked, until)
        self.plan = make_plan(layout, clock, network, self.slaves, 1, master=master)  # type: ignore[arg-type]
        self.radio = make_radio(network, layout.ports["Real"].index, keep=True)
        collect_all(self.plan)
        assert run(self.plan, self.radio, NO_FRAMES, 0) == DONE

    def to(self, k: int) -> int:
        return int(run(self.plan, self.radio, NO_FRAMES, k))


def through(name: str, log: list[str], size: float = 1.0) -> Scripted:
    def step(self: Scripted, t: float, h: float) -> None:
        self.values["y"] = self.values["u"]

    return Scripted(name, [U, Y], step, {"u": 0.0, "y": 0.0}, log, size)


def clock(name: str, log: list[str], size: float = 1.0) -> Scripted:
    """y is the time at the end of its step."""

    def step(self: Scripted, t: float, h: float) -> None:
        self.values["y"] = t + h

    return Scripted(name, [Y], step, {"y": 0.0}, log, size)


# ---- Gauss-Seidel -----------------------------------------------------------------------------


def test_each_takes_what_the_one_before_it_has_just_put_out() -> None:
    log: list[str] = []
    loop = Loop(
        [through("a", log), clock("b", log)], [("b.y", "a.u")], 2.0, MasterSettings("gauss-seidel", ((1,), (0,)))
    )
    log.clear()
    loop.to(1)
    assert log == ["b: doStep 0 + 1", "b: get y", "a: set u = 1.0", "a: doStep 0 + 1", "a: get y"]


def test_a_chain_of_feed_throughs_has_no_delay() -> None:
    """Jacobi would be one step late for each of them."""
    log: list[str] = []
    instances = [clock("a", log), *(through(name, log) for name in "bcd")]
    links = [("a.y", "b.u"), ("b.y", "c.u"), ("c.y", "d.u")]
    loop = Loop(instances, links, 10.0, MasterSettings("gauss-seidel", ((0,), (1,), (2,), (3,))))
    loop.to(10)
    assert [one.values["y"] for one in loop.slaves] == [10.0] * 4


def test_a_slow_one_is_seen_from_the_end_of_its_step_on() -> None:
    """It takes what the fast one had put out by the end of that one's first step."""
    log: list[str] = []
    slow, fast = through("a", log, size=2.0), clock("b", log)
    reader = through("c", log)
    loop = Loop(
        [slow, fast, reader], [("b.y", "a.u"), ("a.y", "c.u")], 4.0, MasterSettings("gauss-seidel", ((1,), (0,), (2,)))
    )
    seen = []
    for k in range(1, 5):
        loop.to(k)
        seen.append(reader.values["y"])
    assert seen == [0.0, 1.0, 1.0, 3.0]


def test_after_a_fatal_one_no_other_of_its_fmu_is_stepped() -> None:
    log: list[str] = []
    broken = Scripted("a", [U, Y], lambda *_: 4, {"u": 0.0, "y": 0.0}, log)
    same, other = through("b", log), through("c", log)
    loop = Loop(
        [broken, same, other], [("a.y", "b.u"), ("b.y", "c.u")], 2.0, MasterSettings("gauss-seidel", ((0,), (1,), (2,)))
    )
    loop.plan.instances["library"][1] = loop.plan.instances["library"][0]
    log.clear()
    loop.to(1)
    assert [line for line in log if "doStep" in line] == ["a: doStep 0 + 1", "c: doStep 0 + 1"]


def annotated(workshop: Any, parts: str, wires: list[str], inner: str, *, stop: float = 2.0, tail: str = "") -> Path:
    """A system with a master: its attributes, a line for each child."""
    connections = "".join(workshop.connection(*wire.split()) for wire in wires)
    element = f'<master xmlns="https://uav-cosim.org/ns/1" {inner}'
    after = workshop.annotation("org.uav-cosim.master", element)
    experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
    return Path(workshop.ssd("master.ssd", workshop.system(parts, connections, after=after), experiment + tail))


def recorded(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def test_a_system_steps_in_the_order_of_its_dependencies(stricts: Any, tmp_path: Path) -> None:
    """c has u = 1, and y = t; b integrates the y that c has at the end of the step, a that of b."""
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b") + stricts.component("c", u=1.0)
    system = annotated(stricts.workshop, parts, ["c/y b/u", "b/y a/u"], 'algorithm="gauss-seidel"/>')
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert stricts.complaints == []
    got = recorded(tmp_path / "out")
    assert got["c.y"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert got["b.y"] == [0.0, 0.25, 0.75, 1.5, 2.5]
    assert got["a.y"] == [0.0, 0.125, 0.5, 1.25, 2.5]
    assert [step.split()[0] for step in stricts.steps][:3] == ["c", "b", "a"]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["master"]["algorithm"] == "gauss-seidel"


def test_a_declared_order_decides_among_those_that_depend_on_each_other(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b") + stricts.component("c")
    wires = ["a/y b/u", "b/y a/u", "b/y c/u"]
    for order, expected in (("", ["a", "b", "c"]), ("b", ["b", "a", "c"]), ("c b a", ["b", "a", "c"])):
        system = annotated(stricts.workshop, parts, wires, f'algorithm="gauss-seidel" order="{order}"/>')
        result = simulate(system, RunOptions(until=0.5))
        assert [step.split()[0] for step in stricts.steps] == expected
        assert f"these depend on each other, and step in this order: {', '.join(expected[:2])}" in result.notes


def test_a_discarded_step_is_repeated_in_order(stricts: Any, tmp_path: Path) -> None:
    """a divides its step from 0.5 s on; b, which follows it, integrates what a has at the end of each part."""
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.125, u=1.0) + stricts.component("b")
    system = annotated(stricts.workshop, parts, ["a/y b/u"], 'algorithm="gauss-seidel"/>', stop=1.5)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    quarter = [0.125 * sum(t + 0.125 * i for i in range(1, 5)) for t in (0.5, 1.0)]
    got = recorded(tmp_path / "out")
    assert got["b.y"] == [0.0, 0.25, 0.25 + quarter[0], 0.25 + quarter[0] + quarter[1]]


# ---- the order of dependencies ----------------------------------------------------------------


@given(
    st.integers(1, 8).flatmap(
        lambda n: st.tuples(
            st.just(n),
            st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=20),
            st.permutations(range(n)),
        )
    )
)
def test_groups_are_those_that_reach_each_other(drawn: tuple[int, set[tuple[int, int]], list[int]]) -> None:
    """Against the definition: reachability by Warshall's algorithm."""
    n, edges, declared = drawn
    inputs = [variable(f"u{i}", "input", reference=i) for i in range(n)]
    instances = [Scripted(f"x{i}", [*inputs, Y], lambda *_: None, {}, []) for i in range(n)]
    checked = system_of(instances, [(f"x{a}.y", f"x{b}.u{a}") for a, b in edges])
    reach = [[i == j or (i, j) in edges for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            for j in range(n):
                reach[i][j] = reach[i][j] or (reach[i][k] and reach[k][j])
    groups = coupled(checked, declared).groups
    assert sorted(i for group in groups for i in group) == list(range(n))
    for group in groups:
        assert set(group) == {j for j in range(n) if reach[group[0]][j] and reach[j][group[0]]}
        assert [declared.index(i) for i in group] == sorted(declared.index(i) for i in group)
    place = {i: g for g, group in enumerate(groups) for i in group}
    assert all(place[a] <= place[b] for a, b in edges)


def coupled(checked: CheckedSystem, declared: list[int]) -> MasterSettings:
    from dataclasses import replace

    from lxml import etree

    from cosim_master.system.flatten.flat import OwnedAnnotation
    from cosim_master.system.structure import Annotation

    order = " ".join(f"x{i}" for i in declared)
    text = f'<a><master xmlns="https://uav-cosim.org/ns/1" algorithm="gauss-seidel" order="{order}"/></a>'
    owned = OwnedAnnotation("", Annotation("org.uav-cosim.master", etree.fromstring(text), HERE))
    return master_settings_of(replace(checked, annotations=(owned,)))


# ---- delays -----------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_delayed_input_is_an_earlier_output(steps: int) -> None:
    log: list[str] = []
    delay = Delay(steps * 10**9, -7.0, HERE)
    links = [("a.y", "b.u", 2.0, 1.0)]
    loop = Loop([clock("a", log), through("b", log)], links, 6.0, MasterSettings(delays={("b", "u"): delay}))
    seen = []
    for k in range(1, 7):
        loop.to(k)
        seen.append(loop.slaves[1].values["y"])
    assert seen == [-7.0 if k < steps else 2.0 * (k - steps) + 1.0 for k in range(6)]


def test_integers_booleans_and_mapped_values_are_delayed() -> None:
    log: list[str] = []
    outputs = [variable("i", "output", "Integer", 0), variable("b", "output", "Boolean", 1)]
    inputs = [
        variable("x", "input", "Real", 0),
        variable("k", "input", "Integer", 1),
        variable("f", "input", "Boolean", 2),
    ]

    def count(self: Scripted, t: float, h: float) -> None:
        self.values["i"] += 1
        self.values["b"] = self.values["i"] % 2

    source = Scripted("s", outputs, count, {"i": 0, "b": 0}, log)
    sink = Scripted("t", inputs, lambda *_: None, {}, log)
    links = [
        ("s.i", "t.x", 10.0, 0.5),
        ("s.i", "t.k", 1.0, 0.0, ((2, 200),)),
        ("s.b", "t.f", 1.0, 0.0, ((0, 1), (1, 0))),
    ]
    delays = {
        ("t", "x"): Delay(10**9, 9.0, HERE),
        ("t", "k"): Delay(2 * 10**9, 8, HERE),
        ("t", "f"): Delay(10**9, True, HERE),
    }
    loop = Loop([source, sink], links, 6.0, MasterSettings(delays=delays))
    seen = []
    for k in range(1, 6):
        loop.to(k)
        seen.append((sink.values["x"], sink.values["k"], sink.values["f"]))
    assert seen == [(9.0, 8, 1), (0.5, 8, 1), (10.5, 0, 0), (20.5, 1, 1), (30.5, 200, 0)]


def test_a_delay_breaks_a_loop_and_its_order(stricts: Any, tmp_path: Path) -> None:
    """b -> a is of the step's start: a steps first, and there is no loop at initialization either."""
    stricts.fmu()
    parts = stricts.component("a", u=5.0) + stricts.component("b")
    inner = 'algorithm="gauss-seidel"><connection to="a.u" delay="0.5" start="4"/></master>'
    system = annotated(stricts.workshop, parts, ["a/y b/u", "b/y a/u"], inner, stop=1.5)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert stricts.complaints == []
    a, b, before = 0.0, 0.0, 4.0
    expected = [(a, b)]
    for _ in range(3):
        a, before = a + 0.5 * before, b
        b += 0.5 * a
        expected.append((a, b))
    got = recorded(tmp_path / "out")
    assert list(zip(got["a.y"], got["b.y"], strict=True)) == expected


def test_a_delay_without_a_start_begins_with_that_of_the_input(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", u=1.0) + stricts.component("b", u=3.0)
    inner = '><connection to="b.u" delay="1"/></master>'
    system = annotated(stricts.workshop, parts, ["a/y b/u"], inner, stop=2.0)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    assert recorded(tmp_path / "out")["b.y"] == [0.0, 1.5, 3.0, 3.0, 3.25]


def test_a_delay_is_the_same_while_steps_are_repeated_shorter(stricts: Any, tmp_path: Path) -> None:
    """Values enter it on the system's own grid, whatever is between."""
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.25, u=1.0) + stricts.component("b")
    inner = '><connection to="b.u" delay="0.5" start="2"/></master>'
    assert (
        simulate(annotated(stricts.workshop, parts, ["a/y b/u"], inner), RunOptions(out=tmp_path / "out")).outcome
        == "done"
    )
    assert recorded(tmp_path / "out")["b.y"] == [0.0, 1.0, 1.0, 1.25, 1.75]


def test_integers_of_64_bits_are_delayed_whole(stricts3: Any, tmp_path: Path) -> None:
    """One element of an array; the other keeps what it starts with."""
    stricts3.fmu()
    ports = "i64_in[1]:input i64_in[2]:input i64_out[1]:output i64_out[2]:output"
    parts = stricts3.component("a", ports=ports) + stricts3.component("b", ports=ports)
    inner = f'><connection to="b.i64_in[1]" delay="0.5" start="{-(2**50)}"/></master>'
    system = annotated(stricts3.workshop, parts, ["a/i64_out[1] b/i64_in[1]"], inner)
    starts = {"a.i64_in[1]": str(2**40), "b.i64_in[2]": "-9"}
    result = simulate(system, RunOptions(out=tmp_path / "out", overrides=starts))
    assert result.outcome == "done", result.error
    got = recorded(tmp_path / "out")
    assert got["b.i64_out[1]"] == [1 - 2**50, 1 - 2**50, 2**40 + 2, 2**40 + 2, 2**40 + 2]
    assert got["b.i64_out[2]"] == [-8] * 5


# ---- extrapolated inputs ----------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_a_ramp_is_followed_exactly_from_the_second_step_on(linears: Any, tmp_path: Path, algorithm: str) -> None:
    """y = u at the end of a step; u is a ramp that another one makes, y = 2 t.

    Without extrapolation y is u at the beginning. A slower one divides by its own, longer steps.
    """
    linears.fmu()
    ramp = {"x0": 0.0, "v0": 2.0, "w2": 1e-12, "step": 0.1}
    parts = linears.component("ramp", **ramp) + linears.component("y", gain=1.0, rate=-1.0, step=0.1)
    parts += linears.component("z", gain=1.0, rate=-1.0, step=0.2) + linears.component(
        "held", gain=1.0, rate=-1.0, step=0.1
    )
    inner = f'algorithm="{algorithm}" extrapolation="1"><connection to="held.u" extrapolation="0"/></master>'
    system = linears.ssd(parts, "ramp/y y/u", "ramp/y z/u", "ramp/y held/u", master=inner, stop=1.0)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    got = recorded(tmp_path / "out")
    late = 0.0 if algorithm == "jacobi" else 0.2
    wanted = [0.0, late, *(0.2 * k + late for k in range(2, 11))]
    assert got["held.y"] == pytest.approx([0.0, *(0.2 * k + late - 0.2 for k in range(1, 11))], abs=1e-9)
    assert got["y.y"] == pytest.approx(wanted, abs=1e-9)
    ends = [0.0, 0.0, late, late, *(0.2 * k + late for k in (4, 4, 6, 6, 8, 8, 10))]
    assert got["z.y"] == pytest.approx(ends, abs=1e-9)


@pytest.mark.parametrize(
    ("flags", "inner", "said"),
    [
        ("", 'extrapolation="1"/>', "b.u cannot be extrapolated: canInterpolateInputs of b is false"),
        ("", '><connection to="b.u" extrapolation="1"/></master>', "canInterpolateInputs of b is false"),
        (None, 'extrapolation="2"/>', 'extrapolation="2" must be a whole number from 0 to 1'),
        (None, '><connection to="b.u" start="1"/></master>', "start is for connections with a delay"),
        (
            None,
            'algorithm="quasi-newton" extrapolation="1"/>',
            "b.u cannot be extrapolated: it is for jacobi and gauss-seidel, this is quasi-newton",
        ),
    ],
)
def test_what_cannot_be_extrapolated(linears: Any, flags: str | None, inner: str, said: str) -> None:
    if flags is None:
        linears.fmu()
    else:
        linears.fmu(flags=flags)
    parts = linears.component("a", step=0.1) + linears.component("b", step=0.1)
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(linears.ssd(parts, "a/y b/u", master=inner))
    assert said in str(caught.value)


def test_fmi_3_has_no_derivatives_of_inputs(stricts3: Any) -> None:
    workshop = stricts3.workshop
    stricts3.fmu()
    ports = "f64_in[1]:input f64_out[1]:output"
    parts = workshop.component("a", "strict3.fmu", ports) + workshop.component("b", "strict3.fmu", ports)
    system = annotated(workshop, parts, ["a/f64_out[1] b/f64_in[1]"], 'extrapolation="1"/>')
    with pytest.raises(SystemDescriptionError, match="cannot be extrapolated: FMI 3 has no derivatives of inputs"):
        simulate(system)


# ---- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inner", "said"),
    [
        ('algorithm="newton"/>', 'algorithm="newton": valid are jacobi, gauss-seidel, fixed-point'),
        ('order="a"/>', 'order is for algorithm="gauss-seidel or fixed-point or quasi-newton", this is "jacobi"'),
        ('algorithm="gauss-seidel" order="a x"/>', 'order names "x", which is not an instance'),
        ('steps="2"/>', "attribute steps: valid are"),
        ("><link/></master>", "<link> is unknown here: valid are connection"),
        ('><connection to="a.u" delay="0.5"/></master>', 'to="a.u": no connection leads there; did you mean "b.u"'),
        ('><connection to="b.s" delay="0.5"/></master>', 'to="b.s": it is a String'),
        ('><connection to="b.u" delay="x"/></master>', 'delay="x" must be a number from 0 to 1e+06'),
        ('><connection to="b.u" delay="0.3"/></master>', "delay 0.3 s of b.u is not a multiple of the base step 0.5 s"),
        ('><connection to="b.u" delay="0.5" start="hot"/></master>', 'start="hot" of b.u: valid: a number'),
        (
            '><connection to="b.u" delay="0.5"/><connection to="b.u" delay="1"/></master>',
            'to="b.u": a second <connection> for it',
        ),
    ],
)
def test_annotations_that_are_wrong(stricts: Any, inner: str, said: str) -> None:
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b")
    system = annotated(stricts.workshop, parts, ["a/y b/u", "a/r b/s"], inner)
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system)
    assert said in str(caught.value)
    assert "master.ssd:" in str(caught.value)
