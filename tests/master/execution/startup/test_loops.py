"""Loops of connections at initialization: the numbers against closed forms, then with FMUs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import LoopError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.execution.startup.loops import TOLERANCE, settle


def settled(function: Any, first: list[Any]) -> list[Any]:
    """The values at the last call: what the inputs of FMUs are left with."""
    last: list[list[Any]] = []

    def go_round(values: list[Any]) -> list[Any]:
        last.append(list(values))
        new: list[Any] = function(values)
        return new

    rounds = settle(go_round, first, [f"x{i}" for i in range(len(first))])
    assert rounds == len(last)
    return last[-1]


def test_a_loop_that_is_none_settles_at_once() -> None:
    assert settled(lambda values: [3.0, "text", 7], [3.0, "text", 7]) == [3.0, "text", 7]


def test_a_damped_loop_by_going_round() -> None:
    """The fixed point of the cosine (Dottie's number)."""
    assert settled(lambda x: [math.cos(x[0])], [1.0])[0] == pytest.approx(0.7390851332151607, abs=1e-9)


@pytest.mark.parametrize("slope", [-3.0, -1.0, 0.999, 2.0, 1e6])
def test_a_line_whatever_its_slope(slope: float) -> None:
    """x = slope * x + 1"""
    assert settled(lambda x: [slope * x[0] + 1.0], [0.5])[0] == pytest.approx(1.0 / (1.0 - slope), rel=1e-6, abs=1e-9)


def test_a_parabola_from_where_going_round_leaves_all_bounds() -> None:
    """x = x^2 - 2 has the solutions 2 and -1; going round from 2.5 overflows."""
    (x,) = settled(lambda v: [min(v[0] ** 2, 1e308) - 2.0 if abs(v[0]) < 1e150 else math.inf], [2.5])
    assert min(abs(x - 2.0), abs(x + 1.0)) < 1e-8


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_linear_loops_against_a_linear_solver(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    a, b = random.uniform(-3.0, 3.0, (n, n)), random.uniform(-10.0, 10.0, n)
    exact = np.linalg.solve(np.eye(n) - a, b)
    if np.linalg.cond(np.eye(n) - a) > 1e4:
        return
    found = settled(lambda x: list(map(float, a @ np.array(x) + b)), [0.0] * n)
    assert np.abs(found - exact).max() <= 1e-6 * max(1.0, np.abs(exact).max())


def test_integers_and_texts_go_round() -> None:
    """A minimum travels around a ring of five."""
    ring = settled(lambda v: [min(v[i - 1], 10 + i) for i in range(5)], [99] * 5)
    assert ring == [10] * 5


def test_integers_and_reals_together() -> None:
    """A real loop that going round does not settle, and a switch that it throws."""
    found = settled(lambda v: [-2.0 * v[0] + (3.0 if v[1] else 6.0), v[0] < 1.5], [0.0, False])
    assert found == [pytest.approx(2.0), False] or found == [pytest.approx(1.0), True]


@pytest.mark.parametrize(
    ("function", "first", "residuals"),
    [
        (lambda v: [v[0] + 1.0], [0.0], {"x0": 1.0}),
        (lambda v: [not v[0]], [True], {"x0": 1.0}),
        (lambda v: [v[0] + "!"], [""], {"x0": 1.0}),
        (lambda v: [math.nan], [0.0], None),
        (lambda v: [v[0] * v[0] + 1.0], [0.0], None),
    ],
)
def test_loops_without_a_solution(function: Any, first: list[Any], residuals: dict[str, float] | None) -> None:
    with pytest.raises(LoopError, match=r"do not settle in [0-9]+ rounds:\n    x0 = .*, residual ") as caught:
        settle(function, first, ["x0"])
    assert caught.value.rounds < 1500
    if residuals is not None:
        assert caught.value.residuals == residuals


# ---- with FMUs --------------------------------------------------------------------------------


def ring(probes: Any, factor: float, p: float = 1.0) -> Path:
    """a.y = a.u + p, b.y = b.u + 0; a.u = factor * b.y, b.u = a.y: y = factor * y + p"""
    probes.fmu()
    parts = probes.component("a", p=p) + probes.component("b", p=0.0) + probes.component("c", p=0.5)
    connection = probes.workshop.connection
    back = connection("b/y", "a/u", f'<ssc:LinearTransformation factor="{factor}"/>')
    wires = connection("a/y", "b/u") + back + connection("b/y", "c/u")
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>'
    made: Path = probes.workshop.ssd("ring.ssd", probes.workshop.system(parts, wires), experiment)
    return made


@pytest.mark.parametrize("factor", [0.25, -4.0])
def test_a_loop_of_fmus(probes: Any, tmp_path: Path, factor: float) -> None:
    result = simulate(ring(probes, factor), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    first = {
        name: values[0] for name, values in pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict().items()
    }
    y = 1.0 / (1.0 - factor)
    tolerance = 10 * TOLERANCE * max(1.0, abs(factor))
    assert first["a.y"] == pytest.approx(y, abs=tolerance)
    assert first["b.y"] == pytest.approx(y, abs=tolerance)
    assert first["c.y"] == pytest.approx(y + 0.5, abs=tolerance)  # behind the loop, with its settled value


def test_a_loop_of_fmus_without_a_solution(probes: Any, tmp_path: Path) -> None:
    result = simulate(ring(probes, 1.0), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    lines = str(result.error).splitlines()
    assert lines[0].startswith("these outputs depend on each other at initialization, and do not settle in ")
    assert {line.split(" = ")[0].strip() for line in lines[1:]} == {"a.y", "b.y"}
    assert probes.calls[-3:] == ["a: free", "b: free", "c: free"]


def test_the_command_stops_after_initialization(probes: Any) -> None:
    done = CliRunner().invoke(app, ["check", str(ring(probes, -4.0)), "--init"])
    assert done.exit_code == 0, done.output
    assert "a loop at initialization, settled in " in done.output and ": a.y, b.y" in done.output.replace(
        "b.y, a.y", "a.y, b.y"
    )
    assert "3 instances initialized" in done.output
    calls = probes.calls
    assert not [call for call in calls if "step" in call]
    assert calls[-6:] == [f"{name}: {verb}" for verb in ("terminate", "free") for name in "abc"]


def test_the_command_says_why_initialization_fails(probes: Any) -> None:
    done = CliRunner().invoke(app, ["check", str(ring(probes, 1.0)), "--init"])
    assert done.exit_code == 1
    assert "do not settle" in done.output
    assert probes.calls[-3:] == ["a: free", "b: free", "c: free"]


def test_without_the_option_nothing_is_loaded(probes: Any) -> None:
    assert CliRunner().invoke(app, ["check", str(ring(probes, 1.0))]).exit_code == 0
    assert probes.calls == []
