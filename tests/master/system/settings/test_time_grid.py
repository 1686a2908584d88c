"""Step sizes: fractions of a second are exact, --step acts, and nothing is recorded where nothing changes."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.settings.time_grid import exact
from tests.master.fmus.linear import BALL_PORTS, ball, signals


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [
        (0.0025, Fraction(2_500_000)),
        (0.033333333, Fraction(33_333_333)),
        (0.03333333333333333, Fraction(10**9, 30)),
        (0.0333333333333, Fraction(10**9, 30)),
        (0.03333333333, Fraction(10**9, 30)),
        (1 / 60, Fraction(10**9, 60)),
        (1 / 3, Fraction(10**9, 3)),
        (1 / 120, Fraction(10**9, 120)),
        (1e-10, Fraction(1, 10)),
        (0.1234567891, Fraction(1234567891, 10)),
        (0.0, None),
        (-0.1, None),
        (float("nan"), None),
        (float("inf"), None),
    ],
)
def test_a_decimal_step_size_is_a_fraction(seconds: float, nanoseconds: Fraction | None) -> None:
    assert exact(seconds) == nanoseconds


@pytest.mark.parametrize("n", [3, 30, 60, 120])
def test_steps_of_a_fraction_of_a_second_are_those_of_fmpy(foreigners: Any, tmp_path: Path, n: int) -> None:
    fmu = foreigners.fmu(step=1 / n)
    system = foreigners.ssd(foreigners.component("a"), stop=7.0)
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    ours = signals(tmp_path / "out")
    assert list(ours["time"]) == [k / n for k in range(7 * n + 1)]
    assert list(ours["a.n"]) == list(range(7 * n + 1))
    assert set(ours["a.h"][1:]) == {1 / n}
    theirs = fmpy.simulate_fmu(
        str(fmu), stop_time=7.0, output_interval=1 / n, output=["t", "h", "n"], validate=False, step_size=1 / n
    )
    assert len(theirs) == len(ours["time"])
    assert np.max(np.abs(ours["a.t"] - theirs["t"])) < 1e-12
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["base_step"] == 1 / n and manifest["instances"]["a"] == {
        **manifest["instances"]["a"],
        "step": 1 / n,
        "step_by": "FMU",
    }
    assert any(note.endswith(f"is taken as 1/{n} s: time is counted in exact fractions") for note in result.notes)
    assert any(note.startswith("foreign.fmu: it steps by ") for note in result.notes)


def test_fractions_mix_with_decimals_and_drift_never(foreigners: Any, tmp_path: Path) -> None:
    """1/30 s and 0.01 s: the common base step is 1/300 s, and rows are where one of them ends a step."""
    foreigners.fmu()
    parts = foreigners.component("a", step=1 / 30) + foreigners.component("b", step=0.01, u=1.0)
    system = foreigners.ssd(parts, "b/t a/u", stop=100.0)
    simulate(system, RunOptions(out=tmp_path / "out"))
    got = signals(tmp_path / "out")
    points = sorted({Fraction(k, 30) for k in range(3001)} | {Fraction(k, 100) for k in range(10001)})
    assert list(got["time"]) == [float(point) for point in points]
    assert got["a.n"][-1] == 3000 and got["b.n"][-1] == 10000
    assert set(got["a.h"][1:]) - {0.0} == {1 / 30} and set(got["b.h"][1:]) == {0.01}
    # a's input at k/30 is the time of b's last step that ended by then
    held = [float(Fraction(k, 30) // Fraction(1, 100) / 100) for k in range(3000)]
    assert got["a.x"][-1] == pytest.approx(sum(value / 30 for value in held), rel=1e-12)


def test_a_base_step_far_below_all_steps_is_passed_over(foreigners: Any, tmp_path: Path) -> None:
    """0.033333333 s and 0.01 s have 1 ns in common: a row for each end of a step, not for each nanosecond."""
    foreigners.fmu()
    parts = foreigners.component("a", step=0.033333333) + foreigners.component("b", step=0.01)
    result = simulate(foreigners.ssd(parts, "b/t a/u", stop=2.0), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    points = sorted({k * 33_333_333 for k in range(61)} | {k * 10_000_000 for k in range(201)})
    assert list(got["time"]) == [point / 1e9 for point in points if point <= 2_000_000_000]
    assert got["b.n"][-1] == 200
    assert got["a.n"][-1] == 61 and got["a.h"][-1] == pytest.approx(2e-8)
    assert "the base step is 1e-09 s, that of no instance: rows are recorded where a step ends" in result.notes


def test_rows_at_an_interval_are_where_it_says(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu()
    parts = foreigners.component("a", step=0.03) + foreigners.component("b", step=0.02)
    for interval, rows in ((0.01, 13), (0.04, 4)):
        note = f'<recording xmlns="https://uav-cosim.org/ns/1" interval="{interval}"/>'
        annotation = f'<ssc:Annotation type="org.uav-cosim.recording">{note}</ssc:Annotation>'
        simulate(foreigners.ssd(parts, stop=0.12, annotations=annotation), RunOptions(out=tmp_path / "out"))
        times = signals(tmp_path / "out")["time"]
        assert list(times) == [pytest.approx(k * interval) for k in range(rows)]


def test_a_run_with_strings_passes_over_base_steps_too(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    parts = probes.component("a", after=probes.step(0.033333333), s="x")
    parts += probes.component("b", after=probes.step(0.01))
    result = simulate(probes.ssd(parts, "a/r b/s", stop=0.1), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert len(got["time"]) == 14 and list(got["b.r"])[-1] == "x!!"


@pytest.mark.parametrize(("step", "steps"), [(0.1, 10), (0.001, 1000), (0.0001, 10000)])
def test_the_step_of_the_command_line_acts(foreigners: Any, tmp_path: Path, step: float, steps: int) -> None:
    """Over the proposal of the FMU, and over what the system says."""
    foreigners.fmu(step=0.002)
    parts = foreigners.component("a") + foreigners.component("b", step=0.05)
    result = simulate(foreigners.ssd(parts), RunOptions(out=tmp_path / "out", step=step))
    got = signals(tmp_path / "out")
    assert (got["a.n"][-1], got["b.n"][-1]) == (steps, steps)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert {one["step_by"] for one in manifest["instances"].values()} == {"--step"}
    assert f"--step {step:g}: it takes the place of the step sizes that the system gives b" in result.notes


def test_without_it_the_system_is_before_the_fmu(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu(step=0.002)
    result = simulate(
        foreigners.ssd(foreigners.component("a") + foreigners.component("b", step=0.05)),
        RunOptions(out=tmp_path / "out"),
    )
    got = signals(tmp_path / "out")
    assert (got["a.n"][-1], got["b.n"][-1]) == (500, 20)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert {name: one["step_by"] for name, one in manifest["instances"].items()} == {"a": "FMU", "b": "system"}
    text = "foreign.fmu: it steps by 0.002 s, which the FMU proposes (DefaultExperiment); --step gives another"
    assert [note for note in result.notes if "proposes" in note] == [text]


def test_an_fmu_whose_steps_have_one_size_may_be_given_it(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu(step=0.002, flags="")
    system = foreigners.ssd(foreigners.component("a"))
    assert simulate(system, RunOptions(out=tmp_path / "out", step=0.25)).outcome == "done"
    assert list(signals(tmp_path / "out")["a.h"][1:]) == [0.25] * 4


@pytest.mark.parametrize("step", [0.0, -0.1, float("nan")])
def test_steps_that_are_not_positive(foreigners: Any, step: float) -> None:
    foreigners.fmu()
    with pytest.raises(SystemDescriptionError, match="must be a positive number of seconds"):
        simulate(foreigners.ssd(foreigners.component("a")), RunOptions(step=step))


def test_steps_that_cannot_be_counted(foreigners: Any) -> None:
    foreigners.fmu()
    with pytest.raises(SystemDescriptionError, match=r"takes more than 62 bits; try 0\.031415927"):
        simulate(foreigners.ssd(foreigners.component("a"), stop=100.0), RunOptions(step=0.031415926535897934))


def test_events_at_ends_of_steps_that_are_fractions(workshop: Any, foreigners: Any, tmp_path: Path) -> None:
    """A ball of FMI 3 with Event Mode bounces as in steps of whole nanoseconds, and its steps end at k/30 s."""
    ball(workshop, foreigners._folder)
    system = foreigners.ssd(workshop.component("m", "ball.fmu", BALL_PORTS), stop=2.0)
    for step, name in ((1 / 30, "thirds"), (0.001, "whole")):
        result = simulate(system, RunOptions(out=tmp_path / name, step=step))
        assert result.outcome == "done", result.error
    thirds, whole = signals(tmp_path / "thirds"), signals(tmp_path / "whole")
    assert list(thirds["time"]) == [k / 30 for k in range(61)]
    assert thirds["m.bounces"][-1] == whole["m.bounces"][-1] > 3
    assert thirds["m.last"][-1] == pytest.approx(whole["m.last"][-1], abs=1e-8)
    assert thirds["m.height"][-1] == pytest.approx(whole["m.height"][-1], abs=1e-6)


def test_nan_is_an_error_unless_it_is_allowed(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu()
    parts = foreigners.component("a", step=0.25, silent=0.5)
    result = simulate(foreigners.ssd(parts), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert (
        'y is not a number; where that is meant, allow it: --set master.nan=allow, or nan="allow" of <master>'
        in str(result.error)
    )
    note = '<master xmlns="https://uav-cosim.org/ns/1" nan="allow"/>'
    annotation = f'<ssc:Annotation type="org.uav-cosim.master">{note}</ssc:Annotation>'
    result = simulate(foreigners.ssd(parts, annotations=annotation), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert [bool(np.isnan(y)) for y in got["a.y"]] == [False, False, True, True, True]
    assert list(got["a.n"]) == [0, 1, 2, 3, 4]
