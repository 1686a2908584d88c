"""Loops that are iterated within a step, by going back; and what is refused. The solutions are closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master.diagnostics.errors import NotConverged, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.fmus.linear import exact, signals

pytestmark = pytest.mark.usefixtures("own_cache")

FIXED = 'algorithm="fixed-point" '
NEWTON = 'algorithm="quasi-newton" '


def stiff(linears: Any, master: str, *, stop: float = 1.0, step: float = 0.1) -> Path:
    """x1' = 1000 (x2 - x1), x2' = 1000 (-4 x1 - x2): stable, and far too fast for these steps."""
    linears.fmu()
    a = linears.component("a", x0=1.0, gain=1.0, rate=1000.0, step=step)
    b = linears.component("b", x0=1.0, gain=-4.0, rate=1000.0, step=step)
    return Path(linears.ssd(a + b, "b/y a/u", "a/y b/u", master=master, stop=stop))


def gains(linears: Any, master: str, a: float = -3.0, b: float = 2.0) -> Path:
    """y1 = 1 + a y2, y2 = 1 + b y1, at the end of every step."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, gain=a, rate=-1.0, step=0.1)
    parts += linears.component("b", x0=1.0, gain=b, rate=-1.0, step=0.1)
    return Path(linears.ssd(parts, "b/y a/u", "a/y b/u", master=master, stop=0.3))


# ---- what comes out ---------------------------------------------------------------------------


def test_an_algebraic_loop_is_solved_in_every_step(linears: Any, tmp_path: Path) -> None:
    """y1 = 1 + a (1 + b y1): for a = -3, b = 2 it is -2/7; going round would never find it."""
    for n, master in enumerate((NEWTON + "/>", FIXED + 'relaxation="0.14" iterations="500"/>')):
        result = simulate(gains(linears, master), RunOptions(out=tmp_path / str(n)))
        assert result.outcome == "done", result.error
        got = signals(tmp_path / str(n))
        np.testing.assert_allclose(got["a.y"][1:], -2.0 / 7.0, rtol=1e-7)
        np.testing.assert_allclose(got["b.y"][1:], 3.0 / 7.0, rtol=1e-7)


def test_quasi_newton_solves_a_linear_loop_in_as_many_tries_as_it_has_unknowns(linears: Any, tmp_path: Path) -> None:
    """Two unknowns: one try, one more for each of them, and one that shows it. FMUs count the steps that were kept."""
    assert simulate(gains(linears, NEWTON + 'iterations="4"/>'), RunOptions(out=tmp_path / "out")).outcome == "done"
    assert list(signals(tmp_path / "out")["a.n"]) == [0, 1, 2, 3]
    result = simulate(gains(linears, NEWTON + 'iterations="2"/>'))
    assert isinstance(result.error, NotConverged)


def test_a_damped_loop_settles_by_going_round(linears: Any, tmp_path: Path) -> None:
    result = simulate(gains(linears, FIXED + "/>", a=0.5, b=-0.5), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    np.testing.assert_allclose(signals(tmp_path / "out")["a.y"][1:], 1.2, rtol=1e-8)


def test_a_stiff_pair_diverges_without_iteration_and_not_with_it(linears: Any, tmp_path: Path) -> None:
    """Jacobi makes x2 <- -4 x1 <- -4 x2 of it, every two steps; an iterated step is like implicit Euler."""
    outs = {}
    for name, master in {
        "jacobi": "",
        "seidel": 'algorithm="gauss-seidel"/>',
        "newton": NEWTON + "/>",
        "fixed": FIXED + 'relaxation="0.2" iterations="500"/>',
    }.items():
        result = simulate(stiff(linears, master), RunOptions(out=tmp_path / name))
        assert result.outcome == "done", result.error
        outs[name] = signals(tmp_path / name)
    times = outs["jacobi"]["time"]
    solution = exact([[-1000.0, 1000.0], [-4000.0, -1000.0]], [1.0, 1.0], times)
    assert abs(solution[1:]).max() < 1e-30
    assert abs(outs["jacobi"]["a.y"][-1]) == pytest.approx(4.0**5, rel=1e-6)
    assert abs(outs["seidel"]["a.y"][-1]) > 1e5
    for name in ("newton", "fixed"):
        assert abs(outs[name]["a.y"][-1]) < 1e-6
        assert abs(outs[name]["b.y"][-1]) < 1e-6


def test_what_is_in_no_loop_steps_once_and_in_order(linears: Any, tmp_path: Path) -> None:
    """A gain before the loop and one behind it; the first may not go back at all."""
    linears.fmu()
    linears.fmu("simple.fmu", flags="")
    parts = linears.component("a", x0=1.0, gain=0.5, rate=-1.0, step=0.1)
    parts += linears.component("b", x0=0.0, gain=1.0, rate=-1.0, step=0.1)
    parts += linears.component("c", "simple.fmu", x0=2.0, gain=10.0, rate=-1.0, step=0.1)
    system = linears.ssd(parts, "a/y a/u", "a/y b/u", "b/y c/u", master=NEWTON + "/>", stop=0.2)
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    got = signals(tmp_path / "out")
    np.testing.assert_allclose(got["a.y"][1:], 2.0)
    np.testing.assert_allclose(got["b.y"][1:], 2.0)
    np.testing.assert_allclose(got["c.y"][1:], 22.0)


def coupled(stricts: Any, parts: str, wires: str, master: str) -> Path:
    after = stricts.workshop.annotation(
        "org.uav-cosim.master", f'<master xmlns="https://uav-cosim.org/ns/1" {master}/>'
    )
    ends = [wire.split("-") for wire in wires.split()]
    connections = "".join(stricts.workshop.connection(*wire) for wire in ends)
    return Path(stricts.workshop.ssd("strict.ssd", stricts.workshop.system(parts, connections, after=after)))


def test_integers_and_booleans_go_round_too(stricts: Any, tmp_path: Path) -> None:
    """a takes how many steps b has done by the end of this one; b takes whether a is (it is not) told to be."""
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b")
    system = coupled(stricts, parts, "b/n-a/u a/c-b/b", FIXED)
    assert simulate(system, RunOptions(until=2.0, out=tmp_path / "out")).outcome == "done"
    assert stricts.complaints == []
    got = signals(tmp_path / "out")
    assert list(got["a.y"]) == [0.0, 0.5, 1.5, 3.0, 5.0]
    assert list(got["b.c"]) == [False] * 5
    assert list(got["a.n"]) == [0, 1, 2, 3, 4]


def test_every_call_of_every_try_is_legal(stricts: Any, tmp_path: Path) -> None:
    """a' = 3 b + 1, b' = -n: the FMUs check every call; a tunable parameter is set on the way."""
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b", p=-1.0) + stricts.component("c", u=1.0)
    system = coupled(stricts, parts, "b/y-a/u a/n-b/u", NEWTON)
    result = simulate(system, RunOptions(until=2.0, out=tmp_path / "out", at=[(1.0, "a.p", "3")]))
    assert result.outcome == "done", result.error
    assert stricts.complaints == []
    got = signals(tmp_path / "out")
    assert list(got["a.n"]) == [0, 1, 2, 3, 4]
    assert list(got["b.y"]) == [0.0, -0.5, -1.5, -3.0, -5.0]
    np.testing.assert_allclose(got["a.y"], [0.0, -0.25, -1.0, -5.5, -13.0], rtol=1e-12)
    assert list(got["c.y"]) == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_a_discarded_step_is_repeated_in_shorter_ones_each_iterated(
    linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    halves = signals(_ran(stiff(linears, NEWTON + "/>", step=0.05), tmp_path / "halves"))
    monkeypatch.setenv("LINEAR_LIMIT", "0.05")
    repeated = signals(_ran(stiff(linears, NEWTON + "/>", step=0.1), tmp_path / "repeated"))
    assert repeated["a.n"][-1] == 20
    np.testing.assert_array_equal(repeated["a.y"], halves["a.y"][::2])


def _ran(system: Path, out: Path) -> Path:
    result = simulate(system, RunOptions(out=out))
    assert result.outcome == "done", result.error
    return out


# ---- Gauss-Seidel with iterations ----------------------------------------------------------------


SWEEPS = 'algorithm="gauss-seidel" iterations="{}" '


def lags(linears: Any, master: str, *, gain: float = 3.0) -> Path:
    """x1' = gain x2 - x1, x2' = -2 x1 - x2; each FMU makes its step exactly, with a held input."""
    linears.fmu()
    a = linears.component("a", x0=1.0, gain=gain, rate=1.0, step=0.5)
    b = linears.component("b", x0=2.0, gain=-2.0, rate=1.0, step=0.5)
    return Path(linears.ssd(a + b, "b/y a/u", "a/y b/u", master=master, stop=3.0))


def swept(tries: int, first: str = "a") -> tuple[list[float], list[float]]:
    """The same by hand: in each try, each of both uses the newest value of the other."""
    rest, y = math.exp(-0.5), {"a": 1.0, "b": 2.0}
    gain, other = {"a": 3.0, "b": -2.0}, {"a": "b", "b": "a"}
    rows = [dict(y)]
    for _ in range(6):
        start = dict(y)
        for _ in range(tries):
            for one in (first, other[first]):
                target = gain[one] * y[other[one]]
                y[one] = target + (start[one] - target) * rest
        rows.append(dict(y))
    return [row["a"] for row in rows], [row["b"] for row in rows]


@pytest.mark.parametrize("tries", [1, 2, 3, 7])
@pytest.mark.parametrize("order", ["a b", "b a"])
def test_gauss_seidel_makes_so_many_tries_and_goes_on(linears: Any, tmp_path: Path, tries: int, order: str) -> None:
    result = simulate(lags(linears, SWEEPS.format(tries) + f'order="{order}"/>'), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got, (a, b) = signals(tmp_path / "out"), swept(tries, order[0])
    np.testing.assert_allclose(got["a.y"], a, rtol=1e-12)
    np.testing.assert_allclose(got["b.y"], b, rtol=1e-12)
    assert list(got["a.n"]) == list(range(7))  # the FMUs count the steps that were kept
    text = f"6 steps of {order.replace(' ', ', ')} count although their outputs still change after {tries} tries"
    found = [note for note in result.notes if note == f"gauss-seidel: {text}, the first from t = 0 s"]
    assert len(found) == (tries > 1)


def test_tries_of_gauss_seidel_end_where_nothing_changes(linears: Any, tmp_path: Path) -> None:
    """With a factor of 0.31 per try, 1e-6 is reached long before 100 tries; then it is the solution of each step."""
    system = lags(linears, SWEEPS.format(100) + 'tolerance="1e-6"/>', gain=1.0)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert not [note for note in result.notes if "still change" in note]
    part, got = 1.0 - math.exp(-0.5), signals(tmp_path / "out")
    matrix = np.array([[1.0, -part], [2.0 * part, 1.0]])
    for k in range(6):
        before = math.exp(-0.5) * np.array([got["a.y"][k], got["b.y"][k]])
        solved = np.linalg.solve(matrix, before)
        np.testing.assert_allclose([got["a.y"][k + 1], got["b.y"][k + 1]], solved, atol=2e-6)


def test_groups_of_a_strict_order_are_repeated_alone(linears: Any, tmp_path: Path) -> None:
    """c needs b and is a group of its own that steps first: it gets the value of the beginning, and steps once."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, gain=3.0, rate=1.0, step=0.5)
    parts += linears.component("b", x0=2.0, gain=-2.0, rate=1.0, step=0.5)
    parts += linears.component("c", x0=0.0, gain=1.0, rate=-1.0, step=0.5)
    wires = ("b/y a/u", "a/y b/u", "b/y c/u")
    master = SWEEPS.format(3) + 'strictOrder="true" order="{}"/>'
    for n, (order, lag) in enumerate((("c | a b", 1), ("a b | c", 0))):
        system = linears.ssd(parts, *wires, master=master.format(order), stop=3.0)
        result = simulate(system, RunOptions(out=tmp_path / str(n)))
        assert result.outcome == "done", result.error
        got, (_, b) = signals(tmp_path / str(n)), swept(3)
        np.testing.assert_allclose(got["b.y"], b, rtol=1e-12)
        np.testing.assert_allclose(got["c.y"][1:], b[1 - lag : 7 - lag], rtol=1e-12)
    text = refused(linears.ssd(parts, *wires, master=master.format("a b | d"), stop=3.0))
    assert 'order names "d"' in text and "missing: c" in text


def test_gauss_seidel_with_iterations_needs_states_and_no_slopes(linears: Any) -> None:
    linears.fmu()
    linears.fmu("simple.fmu", flags='canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true"')
    wires = ("b/y a/u", "a/y b/u")
    parts = linears.component("a", step=0.1) + linears.component("b", "simple.fmu", step=0.1)
    text = refused(linears.ssd(parts, *wires, master=SWEEPS.format(2) + "/>"))
    assert "gauss-seidel: b is part of a loop, and canGetAndSetFMUstate of its FMU is false" in text
    parts = linears.component("a", step=0.1) + linears.component("b", step=0.1)
    text = refused(linears.ssd(parts, *wires, master=SWEEPS.format(2) + 'extrapolation="1"/>'))
    assert "this is gauss-seidel with iterations" in text
    text = refused(linears.ssd(parts, *wires, master='algorithm="gauss-seidel" tolerance="1e-3"/>'))
    assert "tolerance: gauss-seidel uses it with iterations above 1 only" in text
    text = refused(linears.ssd(parts, *wires, master='algorithm="gauss-seidel" strictOrder="true" order="a | b"/>'))
    assert 'order names "|"' in text


# ---- what is said when it does not ------------------------------------------------------------


def test_what_does_not_settle_is_named_with_its_residual_and_the_time(linears: Any, tmp_path: Path) -> None:
    result = simulate(gains(linears, FIXED + 'iterations="5"/>'), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert isinstance(result.error, NotConverged)
    assert result.error.time == 0.0
    assert set(result.error.residuals) == {"a.y", "b.y"}
    first, second, third = str(result.error).splitlines()
    assert first == (
        "fixed-point: in the step from t = 0 s these outputs depend on each other, and do not settle in 5 iterations:"
    )
    assert second.startswith("    ") and "residual" in third
    assert list(signals(tmp_path / "out")["time"]) == [0.0]


def test_the_residual_is_that_of_the_last_try(linears: Any) -> None:
    """y <- 1 + 2 y from 1: 3, 7, 15; the third try makes 15 of 7."""
    linears.fmu()
    parts = linears.component("a", x0=1.0, gain=2.0, rate=-1.0, step=0.1)
    system = linears.ssd(parts, "a/y a/u", master=FIXED + 'iterations="3"/>', stop=0.3)
    error = simulate(system).error
    assert isinstance(error, NotConverged)
    assert error.residuals == {"a.y": pytest.approx(8.0)}


# ---- what is refused --------------------------------------------------------------------------


def test_an_fmu_whose_state_is_not_restored_is_found_out_before_the_first_step(stricts: Any) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=10, u=1.0) + stricts.component("b")
    result = simulate(coupled(stricts, parts, "a/y-b/u b/c-a/b", NEWTON), RunOptions(until=1.0))
    assert result.outcome == "failed"
    assert str(result.error) == (
        "a: fmi2SetFMUstate failed at t = 0 s: its state cannot be trusted, and quasi-newton needs it: saved, stepped, "
        "restored and stepped again, y is 2.0 instead of 1.0"
    )
    assert stricts.complaints == []
    assert stricts.steps == ["a 0 + 0.5", "a 0.5 + 0.5"] * 2 + ["b 0 + 0.5", "b 0.5 + 0.5"] * 2


def refused(system: Path, **options: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system, RunOptions(**options))
    return str(caught.value)


def test_members_of_a_loop_that_cannot_go_back(linears: Any) -> None:
    linears.fmu()
    linears.fmu("simple.fmu", flags='canHandleVariableCommunicationStepSize="true"')
    parts = linears.component("a", step=0.1) + linears.component("b", "simple.fmu", step=0.1)
    text = refused(linears.ssd(parts, "b/y a/u", "a/y b/u", master=NEWTON + "/>"))
    assert "quasi-newton: b is part of a loop, and canGetAndSetFMUstate of its FMU is false" in text
    assert "linear.ssd:" in text


def test_members_of_a_loop_with_other_steps(linears: Any) -> None:
    linears.fmu()
    parts = linears.component("a", step=0.1) + linears.component("b", step=0.2)
    text = refused(linears.ssd(parts, "b/y a/u", "a/y b/u", master=FIXED + "/>"))
    assert "fixed-point: b is part of a loop and steps by 0.2 s" in text and "here 0.1 s" in text


@pytest.mark.parametrize("option", ['tolerance="1e-6"', 'iterations="5"', 'relaxation="0.5"'])
def test_options_of_iteration_without_it(linears: Any, option: str) -> None:
    linears.fmu()
    text = refused(linears.ssd(linears.component("a", step=0.1), master=f'algorithm="jacobi" {option}/>'))
    assert "or quasi-newton" in text and 'this is "jacobi"' in text


def test_a_loop_that_is_broken_by_a_delay_is_none(linears: Any, tmp_path: Path) -> None:
    """Then nobody has to go back."""
    linears.fmu("simple.fmu", flags="")
    parts = linears.component("a", "simple.fmu", x0=1.0, gain=0.5, rate=-1.0, step=0.1)
    inner = NEWTON + '><connection to="a.u" delay="0.1" start="4"/></master>'
    assert (
        simulate(linears.ssd(parts, "a/y a/u", master=inner, stop=0.3), RunOptions(out=tmp_path / "out")).outcome
        == "done"
    )
    assert list(signals(tmp_path / "out")["a.y"]) == [1.0, 3.0, 1.5, 2.5]


def test_order_of_iteration_does_not_matter(linears: Any, tmp_path: Path) -> None:
    """Members of a loop are stepped together: an order that is declared changes no bit."""
    rows = []
    for n, order in enumerate(("", "b a")):
        out = _ran(stiff(linears, NEWTON + f'order="{order}"/>'), tmp_path / str(n))
        rows.append(signals(out)["a.y"])
    assert math.isfinite(rows[0][-1])
    assert np.array_equal(rows[0], rows[1])
