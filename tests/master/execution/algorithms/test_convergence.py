"""Every master against closed-form solutions: orders, tolerances, stability, and the times of events.

Coupled oscillators y1'' = w1 (g y2 - y1), y2'' = w2 (g y1 - y2); each FMU solves its own equation exactly, so that all
error is that of the coupling.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master.diagnostics.errors import StepTooSmall, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.fmus.clocked import clocked
from tests.master.fmus.linear import BALL_PORTS, ball, exact, impacts, signals
from tests.master.fmus.strict3 import ABLE

pytestmark = pytest.mark.usefixtures("own_cache")

W1, W2, GAIN = 4.0, 9.0, 0.6
MATRIX = [[0, 1, 0, 0], [-W1, 0, W1 * GAIN, 0], [0, 0, 0, 1], [W2 * GAIN, 0, -W2, 0]]
START = [1.0, 0.0, -0.5, 1.0]
RICHARDSON = 'algorithm="richardson" '


def oscillators(linears: Any, step: float, master: str, *, stop: float = 2.0, interval: float | None = None) -> Path:
    linears.fmu()
    parts = linears.component("a", x0=START[0], v0=START[1], w2=W1, gain=GAIN, step=step)
    parts += linears.component("b", x0=START[2], v0=START[3], w2=W2, gain=GAIN, step=step)
    return Path(linears.ssd(parts, "b/y a/u", "a/y b/u", master=master, stop=stop, interval=interval))


def error(system: Path, out: Path) -> float:
    """The largest error of both positions, over all rows."""
    result = simulate(system, RunOptions(out=out))
    assert result.outcome == "done", result.error
    got = signals(out)
    wanted = exact(MATRIX, START, got["time"])
    return float(max(abs(got["a.y"] - wanted[:, 0]).max(), abs(got["b.y"] - wanted[:, 2]).max()))


@pytest.mark.parametrize(
    ("master", "order"),
    [
        ("", 1.0),
        ('algorithm="gauss-seidel"/>', 1.0),
        ('algorithm="fixed-point"/>', 1.0),
        ('algorithm="quasi-newton"/>', 1.0),
        ('extrapolation="1"/>', 2.0),
        ('algorithm="gauss-seidel" extrapolation="0"><connection to="a.u" extrapolation="1"/></master>', 1.0),
    ],
    ids=["jacobi", "gauss-seidel", "fixed-point", "quasi-newton", "jacobi-extrapolated", "one-extrapolated"],
)
def test_the_order_of_a_master_is_what_theory_says(linears: Any, tmp_path: Path, master: str, order: float) -> None:
    steps = [0.01 / 2**n for n in range(3)]
    errors = [error(oscillators(linears, step, master, interval=0.01), tmp_path / f"{step}") for step in steps]
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    assert orders == pytest.approx([order] * 2, abs=0.1), errors


# ---- Richardson -------------------------------------------------------------------------------


def test_the_tolerance_is_met_and_decides_the_effort(linears: Any, tmp_path: Path) -> None:
    """The error may grow by the tolerance in each second; these oscillators amplify an error a little."""
    steps = []
    for tolerance in (1e-1, 1e-2, 1e-3):
        out = tmp_path / f"{tolerance}"
        system = oscillators(linears, 0.01, f'{RICHARDSON} tolerance="{tolerance!r}"/>', interval=0.5)
        assert error(system, out) <= 2.0 * tolerance * 2.0
        got = signals(out)
        assert list(got["time"]) == [0.0, 0.5, 1.0, 1.5, 2.0]
        steps.append(int(got["a.n"][-1]))
    assert steps[0] < steps[1] < steps[2]
    assert 5.0 < steps[2] / steps[1] < 15.0  # of order 1: ten times the accuracy, ten times the steps


def test_steps_grow_where_nothing_happens(linears: Any, tmp_path: Path) -> None:
    """A fast start, then rest: x' = 50 (0.5 u - x) and the other way round decays within half a second."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, gain=0.5, rate=50.0, step=0.001)
    parts += linears.component("b", x0=-1.0, gain=0.5, rate=50.0, step=0.001)
    system = linears.ssd(parts, "b/y a/u", "a/y b/u", master=RICHARDSON + 'tolerance="0.01"/>', stop=4.0, interval=1.0)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    counts = np.diff(signals(tmp_path / "out")["a.n"])
    assert counts[0] > 20 * counts[3]


def test_minimum_and_maximum(linears: Any, tmp_path: Path) -> None:
    """Two halves of at most 0.05 s; and a minimum at which the tolerance cannot be met."""
    system = oscillators(linears, 0.01, RICHARDSON + 'tolerance="1" maximumStep="0.05"/>', interval=1.0)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    assert signals(tmp_path / "out")["a.n"][-1] >= 80
    system = oscillators(linears, 0.01, RICHARDSON + 'tolerance="1e-6" minimumStep="0.005"/>', interval=1.0)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert isinstance(result.error, StepTooSmall)
    assert result.error.errors and max(result.error.errors.values()) > 1e-6 * 0.005
    assert "richardson: a step from t = 0 s of the minimum, 0.005 s, is off by more than 1e-06 per second" in str(
        result.error
    )
    assert list(signals(tmp_path / "out")["time"]) == [0.0]


def test_a_change_is_made_exactly_when_it_is_asked_for(linears: Any, tmp_path: Path) -> None:
    """u = 0 until 0.3 s, then 1: x' = u - x has x(1) = 1 - exp(-0.7)."""
    linears.fmu()
    system = linears.ssd(
        linears.component("a", gain=1.0, rate=1.0, step=0.1), master=RICHARDSON + "/>", stop=1.0, interval=1.0
    )
    assert simulate(system, RunOptions(out=tmp_path / "out", at=[(0.3, "a.u", "1")])).outcome == "done"
    assert signals(tmp_path / "out")["a.y"][-1] == pytest.approx(1.0 - math.exp(-0.7), abs=1e-12)


def test_a_discarded_step_is_tried_shorter(linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LINEAR_LIMIT", "0.02")
    system = oscillators(linears, 0.1, RICHARDSON + 'tolerance="1" minimumStep="0.001"/>', interval=1.0)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    assert signals(tmp_path / "out")["a.n"][-1] >= 100
    system = oscillators(linears, 0.1, RICHARDSON + 'tolerance="1" minimumStep="0.05"/>', interval=1.0)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert "an FMU has discarded it" in str(result.error)


def test_every_call_of_every_trial_is_legal(stricts: Any, tmp_path: Path) -> None:
    """The FMUs hold every call against the state table, strings and booleans on the way; a' = 1, b' = a."""
    stricts.fmu()
    parts = stricts.component("a", u=1.0) + stricts.component("b", s="x")
    master = f'<master xmlns="https://uav-cosim.org/ns/1" {RICHARDSON} tolerance="0.02"/>'
    after = stricts.workshop.annotation("org.uav-cosim.master", master)
    ends = (("a/y", "b/u"), ("b/r", "a/s"), ("a/c", "b/b"))
    wires = "".join(stricts.workshop.connection(*wire) for wire in ends)
    system = stricts.workshop.ssd("strict.ssd", stricts.workshop.system(parts, wires, after=after))
    result = simulate(system, RunOptions(until=1.0, out=tmp_path / "out", at=[(0.5, "b.p", "2")]))
    assert result.outcome == "done", result.error
    assert stricts.complaints == []
    got = signals(tmp_path / "out")
    assert list(got["time"]) == [0.0, 0.5, 1.0]
    np.testing.assert_allclose(got["a.y"], [0.0, 0.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(got["b.y"], [0.0, 0.125, 0.875], atol=0.03)
    assert list(got["a.r"])[-1] == "x!!"


def test_chunks_of_wall_clock_time_make_no_difference(linears: Any, tmp_path: Path) -> None:
    """Steps end at rows, not where the run looks at the clock."""
    rows = []
    for n, pace in enumerate((None, 100.0)):
        system = oscillators(linears, 0.01, RICHARDSON + 'tolerance="0.01"/>', interval=0.25)
        assert simulate(system, RunOptions(out=tmp_path / str(n), pace=pace)).outcome == "done"
        rows.append(signals(tmp_path / str(n)))
    for name in rows[0]:
        np.testing.assert_array_equal(rows[0][name], rows[1][name])


# ---- events -----------------------------------------------------------------------------------


@pytest.mark.parametrize("announced", [1, 0])
@pytest.mark.parametrize("master", ["", RICHARDSON + 'tolerance="0.01"/>'], ids=["jacobi", "richardson"])
def test_a_bouncing_ball_bounces_on_time(
    linears: Any, stricts: Any, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, master: str, announced: int
) -> None:
    """To 1e-9 s, five impacts; with Richardson all others stop there too, and see the speed that it has afterwards."""
    workshop = linears.workshop
    ball(workshop, tmp_path_factory.getbasetemp())
    stricts.fmu()
    inner = '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.1"/>'
    after = workshop.annotation("org.uav-cosim.stepping", inner)
    parts = workshop.component("ball", "ball.fmu", BALL_PORTS, workshop.bindings({"announced": announced}), after)
    parts += stricts.component("seen", step=0.1)
    system = linears.ssd(parts, "ball/speed seen/u", master=master, stop=2.0)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert stricts.complaints == []
    times = impacts(5)
    assert times[3] < 2.0 < times[4]
    got = signals(tmp_path / "out")
    assert list(got["ball.bounces"]) == [sum(t <= now for t in times) for now in got["time"]]
    for now, last in zip(got["time"], got["ball.last"], strict=True):
        assert last == pytest.approx(max([0.0, *(t for t in times if t <= now)]), abs=1e-9)
    if master:
        ends = [float(step.split()[1]) for step in stricts.steps]
        for t in times[:4]:
            assert min(abs(end - t) for end in ends) <= 1e-9
        # the integral of the speed is the height
        np.testing.assert_allclose(got["seen.y"], got["ball.height"] - 1.0, atol=0.05)


def by_error(stricts3: Any, parts: str, *wires: str, stop: float) -> Path:
    element = f'<master xmlns="https://uav-cosim.org/ns/1" {RICHARDSON} tolerance="0.1"/>'
    after = stricts3.workshop.annotation("org.uav-cosim.master", element)
    connections = "".join(stricts3.workshop.connection(*wire.split()) for wire in wires)
    experiment = f'<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/>'
    system = stricts3.workshop.system(parts, connections, after=after)
    return Path(stricts3.workshop.ssd("strict3.ssd", system, experiment))


@pytest.mark.parametrize("mode", [10, 11, 12])
def test_trials_with_events_are_legal(stricts3: Any, tmp_path: Path, mode: int) -> None:
    """A state event within a step, events that are announced, one at the end of a step; FMUs check every call."""
    stricts3.fmu(flags=f'{ABLE} hasEventMode="true"')
    parts = stricts3.component("a", mode=mode, when=0.6, longest=0.2, ports="f64_out:output events:output")
    parts += stricts3.component("b", ports="f64_in:input f64_out:output")
    system = by_error(stricts3, parts, "a/f64_out b/f64_in", stop=1.5)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert stricts3.complaints == []
    got = signals(tmp_path / "out")
    assert list(got["time"]) == [0.0, 0.5, 1.0, 1.5]
    assert got["a.events"][-1] > got["a.events"][0]


def test_clocks_tick_on_time_in_trials_too(stricts3: Any, tmp_path: Path) -> None:
    """Each at its own times, the one that is connected with the other; the FMUs complain of every other time."""
    clocked(stricts3, "a.fmu", "constant", "fire", period=0.3, shift=0.1)
    clocked(stricts3, "b.fmu", "go")
    parts = stricts3.component("a", "a.fmu", ports="fire:output y:output", rule=1, u=10.0)
    parts += stricts3.component("b", "b.fmu", ports="go:input u:input y:output")
    result = simulate(by_error(stricts3, parts, "a/fire b/go", "a/y b/u", stop=1.5), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert stricts3.complaints == []
    lines = [line.split() for line in stricts3.calls]
    times = {name: {line[2] for line in lines if line[:2] == name.split()} for name in ("a: constant", "b: go")}
    assert times["a: constant"] == times["b: go"] == {"0.1", "0.4", "0.7", "1", "1.3"}
    assert list(signals(tmp_path / "out")["b.ticks_go"]) == [0, 2, 4, 5]


# ---- what is refused --------------------------------------------------------------------------


def refused(system: Path) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system)
    return str(caught.value)


@pytest.mark.parametrize("flag", ["canGetAndSetFMUstate", "canHandleVariableCommunicationStepSize"])
def test_fmus_that_cannot(linears: Any, flag: str) -> None:
    flags = {"canGetAndSetFMUstate", "canHandleVariableCommunicationStepSize"} - {flag}
    linears.fmu("simple.fmu", flags=f'{flags.pop()}="true"')
    system = linears.ssd(linears.component("a", "simple.fmu", step=0.1), master=RICHARDSON + "/>")
    assert f"richardson: {flag} of a is false" in refused(system)


@pytest.mark.parametrize(
    ("inner", "said"),
    [
        ('order="a"/>', 'order is for algorithm="gauss-seidel or fixed-point or quasi-newton", this is "richardson"'),
        ('minimumStep="0.2" maximumStep="0.1"/>', "minimumStep is larger than maximumStep"),
        ('><connection to="b.u" delay="0.1"/></master>', "richardson: the connection to b.u is delayed"),
    ],
)
def test_settings_that_do_not_fit(linears: Any, inner: str, said: str) -> None:
    linears.fmu()
    parts = linears.component("a", step=0.1) + linears.component("b", step=0.1)
    assert said in refused(linears.ssd(parts, "a/y b/u", master=RICHARDSON + inner))


def test_an_fmu_that_does_not_go_back_is_found_out(stricts: Any) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=10, u=1.0)
    master = f'<master xmlns="https://uav-cosim.org/ns/1" {RICHARDSON}/>'
    after = stricts.workshop.annotation("org.uav-cosim.master", master)
    result = simulate(
        stricts.workshop.ssd("strict.ssd", stricts.workshop.system(parts, after=after)), RunOptions(until=1.0)
    )
    assert result.outcome == "failed"
    assert "a: fmi2SetFMUstate failed at t = 0 s: its state cannot be trusted, and richardson needs it" in str(
        result.error
    )
