"""FMUs for Model Exchange, integrated by us: against closed forms, against FMPy's CVODE, and with other FMUs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.solvers import Choice

REMEDY = (
    ' while CVODE integrates it, which remembers its last steps (take --solver rk4, --solver euler, or restart="true" '
    "in its solver annotation)"
)
BOTH = pytest.mark.parametrize("fmi", [2, 3])


def alone(fmu: Path, name: str = "out", **options: Any) -> tuple[RunResult, dict[str, Any]]:
    out = fmu.parent / name
    result = simulate(fmu, RunOptions(out=out, **options))
    assert result.outcome in ("done", "terminated"), result.error
    return result, pq.read_table(out / "signals.parquet").to_pydict()


def by_fmpy(fmu: Path, stop: float, interval: float, **options: Any) -> Any:
    return fmpy.simulate_fmu(
        str(fmu), fmi_type="ModelExchange", solver="CVode", stop_time=stop, output_interval=interval,
        relative_tolerance=1e-8, record_events=False, **options,
    )  # fmt: skip


@BOTH
def test_what_a_solver_needs_to_know(dynamics: Any, fmi: int) -> None:
    exchange = describe(dynamics.fmu("VANDERPOL", fmi)).model_exchange
    assert exchange is not None
    assert (exchange.states, exchange.derivatives, exchange.event_indicators) == ((0, 1), (2, 3), 0)
    assert exchange.directional_derivatives and exchange.completed_step == (fmi == 2)
    assert describe(dynamics.fmu("VANDERPOL", fmi, "CS")).model_exchange is None
    assert describe(dynamics.fmu("VANDERPOL", fmi, "ME CS")).model_exchange is None
    ball = describe(dynamics.fmu("BALL", fmi)).model_exchange
    assert ball is not None and ball.event_indicators == 1 and not ball.directional_derivatives


@BOTH
@pytest.mark.parametrize(("solver", "error"), [("cvode:1e-9", 1e-7), ("rk4:0.1", 1e-5), ("euler:0.001", 1e-3)])
def test_decay(dynamics: Any, fmi: int, solver: str, error: float) -> None:
    file = dynamics.fmu("DAHLQUIST", fmi, stop=2.0, step=0.1)
    _, got = alone(file, solver=solver, overrides={"k": "1.5"})
    exact = np.exp(-1.5 * np.array(got["time"]))
    np.testing.assert_allclose(got["Dahlquist.x"], exact, rtol=0, atol=error)
    manifest = json.loads((file.parent / "out" / "manifest.json").read_text())
    assert manifest["instances"]["Dahlquist"]["solver"]["name"] == solver.partition(":")[0]


@pytest.mark.parametrize(("solver", "order"), [("euler", 1), ("rk4", 4)])
def test_the_order_of_fixed_step_methods(dynamics: Any, solver: str, order: int) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, stop=1.0, step=0.5)
    errors = []
    for h in (0.1, 0.05, 0.025):
        _, got = alone(file, solver=f"{solver}:{h}", step=0.5)
        errors.append(abs(got["Dahlquist.x"][-1] - math.exp(-1.0)))
    rates = [math.log2(errors[i] / errors[i + 1]) for i in (0, 1)]
    assert all(abs(rate - order) < 0.1 for rate in rates), rates


@BOTH
def test_a_stiff_oscillator_as_fmpy_integrates_it(dynamics: Any, fmi: int) -> None:
    """By directional derivatives, which the FMU counts."""
    file = dynamics.fmu("VANDERPOL", fmi, stop=8.0, step=0.5)
    _, got = alone(file, solver="cvode:1e-8", overrides={"mu": "10"})
    expected = by_fmpy(file, 8.0, 0.5, start_values={"mu": 10.0})
    for name in ("x", "y"):
        np.testing.assert_allclose(got[f"Vanderpol.{name}"], expected[name], rtol=0, atol=2e-5)
    assert got["Vanderpol.asked"][-1] > 4


@BOTH
@pytest.mark.parametrize("solver", ["cvode:1e-9", "rk4:0.01", "euler:0.0005"])
def test_a_ball_bounces_when_it_reaches_the_ground(dynamics: Any, fmi: int, solver: str) -> None:
    """In closed form: impacts at sqrt(2 h / g) (1 + 2 e + 2 e^2 + ...)."""
    file = dynamics.fmu("BALL", fmi, stop=2.0, step=0.01)
    _, got = alone(file, solver=solver)
    first = math.sqrt(2 / 9.81)
    impacts = [first, first * (1 + 2 * 0.7), first * (1 + 2 * 0.7 + 2 * 0.49)]
    bounces = [next(t for t, n in zip(got["time"], got["Ball.bounces"], strict=True) if n > k) for k in range(3)]
    for seen, impact in zip(bounces, impacts, strict=True):
        assert 0 <= seen - impact + (1e-3 if solver.startswith("euler") else 1e-6) <= 0.0111
    if not solver.startswith("euler"):
        expected = by_fmpy(file, 2.0, 0.01, output=["h", "v", "bounces"])
        assert got["Ball.bounces"] == list(expected["bounces"])
        np.testing.assert_allclose(got["Ball.h"], expected["h"], rtol=0, atol=1e-6)
        t = np.array(got["time"])
        flight = (t > impacts[0]) & (t < impacts[1])
        v = 0.7 * 9.81 * first
        exact = v * (t - first) - 9.81 / 2 * (t - first) ** 2
        np.testing.assert_allclose(np.array(got["Ball.h"])[flight], exact[flight], rtol=0, atol=1e-6)


@BOTH
@pytest.mark.parametrize("step", [0.25, 0.3])
def test_time_events_and_the_end_that_an_fmu_wants(dynamics: Any, fmi: int, step: float) -> None:
    file = dynamics.fmu("STAIR", fmi, stop=12.0, step=step)
    result, got = alone(file)
    assert result.outcome == "terminated"
    assert "at t = 10 s" in str(result.error) or fmi == 3
    for t, counter in zip(got["time"], got["Stair.counter"], strict=True):
        assert counter == min(math.floor(t + 1e-9), 10)
    assert got["time"][-1] >= 9.6


@BOTH
def test_step_events_inputs_and_changes(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    """x' = gain u + 10 on + m: every communication point begins in Event Mode, where discrete inputs may be set."""
    file = dynamics.fmu("DRIVE", fmi, stop=2.0, step=0.25)
    (tmp_path / "in.csv").write_text("time,u,on,m\n0,1,0,0\n0.5,1,1,0\n1,1,0,-2\n")
    _, got = alone(file, inputs=tmp_path / "in.csv", at=[(1.5, "gain", "4")])
    expected = [0, 0.25, 0.5, 3.25, 6, 5.75, 5.5, 6.0, 6.5]
    np.testing.assert_allclose(got["Drive.x"], expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(got["Drive.y"], np.array(expected) + 1.0, rtol=0, atol=1e-9)
    assert got["Drive.latched"] == [0, 0, 0, 100, 100, -2, -2, -2, -2]
    assert got["Drive.passed"][-1] >= 2 and got["Drive.t"][-1] == "a!"


def test_model_exchange_and_co_simulation_in_one_system(dynamics: Any, workshop: Any, tmp_path: Path) -> None:
    """A decay by RK4, FMI 3, drives an integrator by CVODE, FMI 2, that drives one that steps itself."""
    dynamics.fmu("DAHLQUIST", 3, "ME CS", name="a.fmu")
    dynamics.fmu("DRIVE", 2, "ME", name="b.fmu")
    dynamics.fmu("DRIVE", 2, "CS", name="c.fmu")
    solver = '<solver xmlns="https://uav-cosim.org/ns/1" name="rk4" step="0.05"/>'
    stepping = '<stepping xmlns="https://uav-cosim.org/ns/1" stepSize="0.1"/>'
    parts = workshop.component(
        "a",
        "a.fmu",
        "x:output",
        after=workshop.annotation("org.uav-cosim.solver", solver),
        implementation="ModelExchange",
    )
    parts += workshop.component("b", "b.fmu", "u:input x:output")
    parts += workshop.component("c", "c.fmu", "u:input x:output", implementation="CoSimulation")
    wires = workshop.connection("a/x", "b/u") + workshop.connection("b/x", "c/u")
    after = workshop.annotation("org.uav-cosim.stepping", stepping)
    file = workshop.ssd("s.ssd", workshop.system(parts, wires, after=after))
    result = simulate(file, RunOptions(out=tmp_path / "out", until=1.0))
    assert result.outcome == "done", result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    t = np.arange(11) * 0.1
    a = np.exp(-t)
    b = np.concatenate([[0], np.cumsum(a[:-1]) * 0.1])
    c = np.concatenate([[0], np.cumsum(b[:-1]) * 0.1])
    for name, exact in (("a", a), ("b", b), ("c", c)):
        np.testing.assert_allclose(got[f"{name}.x"], exact, rtol=0, atol=1e-6)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["instances"]["a"]["solver"] == {"name": "rk4", "step": 0.05, "tolerance": None, "restart": False}
    assert manifest["instances"]["b"]["solver"]["name"] == "cvode" and "solver" not in manifest["instances"]["c"]


@BOTH
@pytest.mark.parametrize("model", ["VANDERPOL", "STAIR"])
def test_runs_repeat_and_go_on_bit_for_bit(dynamics: Any, tmp_path: Path, fmi: int, model: str) -> None:
    file = dynamics.fmu(model, fmi, stop=4.0, step=0.25)
    first, second = tmp_path / "first", tmp_path / "second"
    with pytest.raises(SystemDescriptionError, match="has no checkpoints: canGetAndSetFMUstate of") as caught:
        simulate(file, RunOptions(out=first, checkpoint_every=1.5))
    assert REMEDY in str(caught.value)
    simulate(file, RunOptions(out=first, checkpoint_every=1.5, solver="rk4:0.01"))
    simulate(file, RunOptions(out=second, origin=f"{first}@1.5", solver="rk4:0.01"))
    tables = [pq.read_table(folder / "signals.parquet") for folder in (first, second)]
    assert tables[0].num_rows == 17
    assert tables[0] == tables[1]


@BOTH
def test_an_iterated_loop_goes_back(dynamics: Any, workshop: Any, tmp_path: Path, fmi: int) -> None:
    """x' = u both ways, every step made again until both agree: with inputs held at their values at the end of the step
    it is implicit Euler. CVODE that begins anew at every communication point can go back."""
    dynamics.fmu("DRIVE", fmi, "ME", name="d.fmu", step=0.1)
    master = '<master xmlns="https://uav-cosim.org/ns/1" algorithm="fixed-point" tolerance="1e-12" iterations="60"/>'
    parts = workshop.component("a", "d.fmu", "u:input x:output") + workshop.component(
        "b", "d.fmu", "u:input x:output m:input"
    )
    wires = workshop.connection("a/x", "b/u") + workshop.connection("b/x", "a/u")
    solver = '<solver xmlns="https://uav-cosim.org/ns/1" name="cvode" tolerance="1e-9" restart="true"/>'
    listed = f'<ssc:Annotation type="org.uav-cosim.master">{master}</ssc:Annotation>'
    listed += f'<ssc:Annotation type="org.uav-cosim.solver">{solver}</ssc:Annotation>'
    after = f"<ssd:Annotations>{listed}</ssd:Annotations>"
    file = workshop.ssd("s.ssd", workshop.system(parts, wires, after=after))
    result = simulate(file, RunOptions(out=tmp_path / "out", until=1.0, overrides={"b.m": "1"}))
    assert result.outcome == "done", result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    a, b, h = 0.0, 0.0, 0.1
    for k in range(11):
        assert got["a.x"][k] == pytest.approx(a, abs=1e-8) and got["b.x"][k] == pytest.approx(b, abs=1e-8)
        b_next = (b + h * 1 + h * a) / (1 - h * h)
        a, b = a + h * b_next, b_next


@pytest.mark.parametrize("algorithm", ["fixed-point", "richardson"])
def test_what_goes_back_names_the_solvers_that_do(dynamics: Any, workshop: Any, algorithm: str) -> None:
    dynamics.fmu("DRIVE", 2, "ME", name="d.fmu", step=0.1)
    master = f'<master xmlns="https://uav-cosim.org/ns/1" algorithm="{algorithm}" tolerance="1e-6"/>'
    parts = workshop.component("a", "d.fmu", "u:input x:output") + workshop.component("b", "d.fmu", "u:input x:output")
    wires = workshop.connection("a/x", "b/u") + workshop.connection("b/x", "a/u")
    after = workshop.annotation("org.uav-cosim.master", master)
    file = workshop.ssd("s.ssd", workshop.system(parts, wires, after=after))
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(file, RunOptions(until=1.0))
    assert len(caught.value.problems) == 2
    assert all(f"is false{REMEDY}" in str(problem) for problem in caught.value.problems)


def test_choices_of_solvers() -> None:
    assert Choice.parsed("cvode:1e-4") == Choice("cvode", tolerance=1e-4)
    assert Choice.parsed("rk4:0.01") == Choice("rk4", step=0.01)
    for text, expected in (
        ("heun", 'there is no solver "heun"; valid: cvode, euler, rk4'),
        ("euler:-1", '"-1" is not a positive step in s'),
        ("cvode:x", '"x" is not a positive tolerance'),
    ):
        with pytest.raises(ValueError, match=expected):
            Choice.parsed(text)


def test_what_is_refused(dynamics: Any, workshop: Any, tmp_path: Path) -> None:
    slave = dynamics.fmu("DAHLQUIST", 2, "CS", step=0.5, name="slave.fmu")
    with pytest.raises(SystemDescriptionError, match="has no <ModelExchange>; it has CoSimulation"):
        simulate(slave, RunOptions(solver="rk4"))
    parts = workshop.component("a", "slave.fmu", "x:output")
    file = workshop.ssd("s.ssd", workshop.system(parts))
    with pytest.raises(SystemDescriptionError, match="--solver rk4: no FMU of this system is for Model Exchange"):
        simulate(file, RunOptions(solver="rk4", until=1.0))
    exchange = dynamics.fmu("DAHLQUIST", 2, "ME", step=0.5, name="exchange.fmu")
    with pytest.raises(SystemDescriptionError, match='--solver heun: there is no solver "heun"'):
        simulate(exchange, RunOptions(solver="heun"))
    head = '<solver xmlns="https://uav-cosim.org/ns/1"'
    wrong = {
        f'{head} name="heun"/>': 'there is no solver "heun"; valid: cvode, euler, rk4',
        f'{head} step="0"/>': 'step "0" of <solver> must be a positive number',
        f'{head} size="1"/>': '<solver> has no attribute "size"',
        "<solver/>": "annotation org.uav-cosim.solver needs one element",
    }
    for inner, text in wrong.items():
        after = workshop.annotation("org.uav-cosim.solver", inner)
        parts = workshop.component("a", "exchange.fmu", "x:output", after=after)
        with pytest.raises(SystemDescriptionError) as caught:
            simulate(workshop.ssd("s.ssd", workshop.system(parts)), RunOptions(until=1.0))
        assert text in str(caught.value) and "s.ssd:" in str(caught.value)


def test_a_solver_that_cannot_go_on(dynamics: Any) -> None:
    """mu is not a number: the FMU discards its derivatives."""
    file = dynamics.fmu("VANDERPOL", 2, stop=1.0, step=0.5)
    for solver, function in (("cvode", "solver cvode"), ("rk4", "solver rk4")):
        result = simulate(file, RunOptions(out=file.parent / "out", solver=solver, overrides={"mu": "inf"}))
        assert result.outcome == "failed"
        assert function in str(result.error) or "GetDerivatives" in str(result.error)
