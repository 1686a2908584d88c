"""One FMU alone: as a system of one component, with inputs from a CSV file, against FMPy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pyarrow.parquet as pq
import pytest
from fmpy.simulation import Input
from hypothesis import given
from hypothesis import strategies as st

from cosim.build import build, load_models
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.interpolation import interpolated
from cosim_master.system.reading.single_fmu import output_interval


def columns(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def alone(fmu: Path, **options: Any) -> tuple[RunResult, dict[str, Any]]:
    out = fmu.parent / "out"
    result = simulate(fmu, RunOptions(out=out, **options))
    return result, columns(out)


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_alone_runs_as_fmpy_runs_it(dynamics: Any, fmi: int) -> None:
    file = dynamics.fmu("VANDERPOL", fmi, "CS", step=0.25)
    result, got = alone(file, overrides={"mu": "1.5", "Vanderpol.x": "1.25"})
    assert (result.outcome, result.simulated_s) == ("done", 10.0)
    expected = fmpy.simulate_fmu(
        str(file), fmi_type="CoSimulation", stop_time=10.0, output_interval=0.25, start_values={"mu": 1.5, "x": 1.25}
    )
    assert list(got) == ["time", "Vanderpol.x", "Vanderpol.y", "Vanderpol.asked"]
    for name in ("x", "y"):
        np.testing.assert_array_equal(got[f"Vanderpol.{name}"], expected[name])
    manifest = json.loads((file.parent / "out" / "manifest.json").read_text())
    assert manifest["instances"]["Vanderpol"]["parameters"] == {"mu": 1.5}
    assert manifest["system"]["path"] == str(file)


CLOCK = """from cosim import Model, Output, kernel


@kernel
def start(m):
    return 0


@kernel
def advance(m, t, h):
    m.t = t + h
    return 0


class Clock(Model):
    '''The time.'''

    step_size = 0.5
    variables = (Output("t", unit="s", start=0.0),)
    kernels = (start, advance)
"""


def test_an_fmu_whose_model_has_changed_since_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the file lies beside the FMU, above it, or in the working directory; another file of the name is none."""
    (tmp_path / "clock.py").write_text(CLOCK)
    (model,) = load_models(str(tmp_path / "clock.py"))
    fmu = build(model, tmp_path / "fmus").file
    elsewhere = tmp_path / "elsewhere" / "deep" / "er"
    elsewhere.mkdir(parents=True)

    def notes(file: Path) -> list[str]:
        return [one for one in simulate(file, RunOptions(until=0.5)).notes if "was built from" in one]

    assert notes(fmu) == []
    (tmp_path / "clock.py").write_text(CLOCK.replace("t + h", "t - h"))
    moved = fmu.rename(elsewhere / "Clock.fmu")
    assert notes(moved) == []
    monkeypatch.chdir(tmp_path)
    found = "elsewhere/deep/er/Clock.fmu was built from another clock.py than is there now; "
    assert notes(moved) == [f"{found}uav-cosim build clock.py builds it anew"]
    (elsewhere.parent / "clock.py").write_text(CLOCK)  # the one that it was built from
    assert notes(moved) == []
    (elsewhere.parent / "clock.py").unlink()
    (tmp_path / "clock.py").write_text("class Other:\n    pass\n")
    assert notes(moved) == []


def test_signals_are_recorded_by_the_names_of_variables(dynamics: Any) -> None:
    """As they are set, with the name of the component or without."""
    file = dynamics.fmu("VANDERPOL", 2, "CS", stop=0.5, step=0.25)
    for patterns, expected in (
        (["x"], ["x"]), (["Vanderpol.y"], ["y"]), (["x", "a*"], ["x", "asked"]), (["*.x"], ["x"]), (["*"], None)
    ):  # fmt: skip
        _, got = alone(file, record=patterns)
        assert expected is None or list(got) == ["time", *(f"Vanderpol.{name}" for name in expected)]
        assert len(got) > 1
    with pytest.raises(SystemDescriptionError, match=r'"Vanderpol\.z" matches no output or local variable'):
        alone(file, record=["z"])


def test_start_and_stop_are_those_of_the_default_experiment(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, "CS", start=1.0, stop=3.5, step=0.5)
    result, got = alone(file)
    assert got["time"] == [1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
    assert not [note for note in result.notes if "start time" in note]


def test_an_fmu_without_a_step_gets_one(dynamics: Any) -> None:
    result, got = alone(dynamics.fmu("DAHLQUIST", 2, "CS", stop=2.0))
    assert len(got["time"]) == 1001
    assert "the FMU names no step size: 0.002 s are taken" in result.notes


def test_an_fmu_without_a_stop_time_runs_for_a_second(dynamics: Any) -> None:
    result, got = alone(dynamics.fmu("DAHLQUIST", 2, "CS", start=2.0, stop=None, step=0.5, name="endless.fmu"))
    assert got["time"] == [2.0, 2.5, 3.0]
    assert "nothing names a stop time: the run ends at 3 s; --until gives another" in result.notes
    result, got = alone(dynamics.fmu("DAHLQUIST", 2, "CS", stop=None, name="nothing.fmu"))
    assert len(got["time"]) == 501
    assert "the FMU names no step size: 0.002 s are taken" in result.notes


@pytest.mark.parametrize(
    ("span", "step"),
    [
        (1.0, 0.002),
        (10.0, 0.02),
        (7.0, 0.01),
        (3.3, 0.005),
        (1e-6, 2e-9),
        (12.345, 0.005),
        (86400.0, 100.0),
        (1e8 - 1e-5, 199999.99999998),
        (1e-7, 1e-9),
    ],
)
def test_the_step_of_an_fmu_that_proposes_none(span: float, step: float) -> None:
    assert output_interval(span) == step


CSV = """"time","u","on","m"
0,0,0,0
0.3,3,0,0
0.3,-1,1,0
1,-1,1,7
1.5,2,0,7
"""


@pytest.mark.parametrize("fmi", [2, 3])
def test_inputs_from_a_file_as_fmpy_reads_them(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    file = dynamics.fmu("DRIVE", fmi, "CS", stop=2.0, step=0.1)
    stimuli = tmp_path / "in.csv"
    stimuli.write_text(CSV)
    result, got = alone(file, inputs=stimuli, at=[(0.5, "gain", "2")])
    assert result.outcome == "done", result.error

    def gain(time: float, recorder: Any) -> bool:
        if abs(time - 0.5) < 1e-9:
            reference = (recorder.fmu.fmi3SetFloat64 if fmi == 3 else recorder.fmu.setReal, [3], [2.0])
            recorder.fmu.setFloat64([3], [2.0]) if fmi == 3 else reference[0](*reference[1:])
        return True

    expected = fmpy.simulate_fmu(
        str(file), fmi_type="CoSimulation", stop_time=2.0, output_interval=0.1, input=fmpy.read_csv(stimuli),
        output=["x", "y", "latched"], step_finished=gain,
    )  # fmt: skip
    np.testing.assert_allclose(got["time"], expected["time"], rtol=0, atol=1e-12)
    for name in ("x", "y", "latched"):
        np.testing.assert_allclose(got[f"Drive.{name}"], expected[name], rtol=1e-12, atol=1e-12)
    assert got["Drive.latched"][:4] == [0, 0, 0, 0] and got["Drive.latched"][5] == 100 and got["Drive.latched"][-1] == 7
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["input"]["path"] == str(stimuli) and len(manifest["input"]["sha256"]) == 64


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_jump_in_the_first_row_counts_behind_it_as_in_fmpy(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    file = dynamics.fmu("DRIVE", fmi, "CS", stop=0.5, step=0.1)
    stimuli = tmp_path / "in.csv"
    stimuli.write_text("time,u,on,m\n0,1,0,3\n0,5,1,4\n1,5,1,4\n")
    _, got = alone(file, inputs=stimuli)
    expected = fmpy.simulate_fmu(
        str(file), fmi_type="CoSimulation", stop_time=0.5, output_interval=0.1, input=fmpy.read_csv(stimuli),
        output=["x", "latched"],
    )  # fmt: skip
    np.testing.assert_allclose(got["Drive.x"], expected["x"], rtol=1e-12)
    np.testing.assert_allclose(got["Drive.x"], [0, 0.4, 2.3, 4.2, 6.1, 8.0], rtol=1e-12)
    assert got["Drive.latched"] == list(expected["latched"]) == [3, 3, 104, 104, 104, 104]


def test_inputs_without_a_column_keep_their_start_values(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("DRIVE", 2, "CS", stop=1.0, step=0.5)
    (tmp_path / "in.csv").write_text("time, Drive.on, s\n0,true,x\n0.5,false,y\n")
    result, got = alone(file, inputs=tmp_path / "in.csv", overrides={"m": "3"})
    assert got["Drive.t"] == ["x!", "x!", "y!"]
    assert got["Drive.latched"] == [103, 103, 3]
    assert f"{tmp_path / 'in.csv'} has no column for Drive.m, Drive.u: start values hold" in result.notes


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        (
            "100,1,8\n101,1,5\n",
            "starts at 100 s, and the run stops at 1 s: the values of its first row hold all the time",
        ),
        ("-5,1,8\n-1,1,5\n", "ends at -1 s: the values of its last row hold all the time"),
        ("0,1,8\n", ""),
        ("0.5,1,8\n7,1,9\n", ""),
        ("-5,1,8\n0.5,1,9\n", ""),
    ],
)
def test_a_file_of_inputs_for_another_time_is_noted(dynamics: Any, tmp_path: Path, rows: str, note: str) -> None:
    file = dynamics.fmu("DRIVE", 2, "CS", stop=1.0, step=0.5)
    (tmp_path / "in.csv").write_text(f"time,on,m\n{rows}")
    result, _ = alone(file, inputs=tmp_path / "in.csv")
    found = [one for one in result.notes if "hold all the time" in one]
    assert found == ([f"{tmp_path / 'in.csv'} {note}"] if note else [])


MASS = """
from cosim import Model, Output
from cosim.verdict import Role

def start(m):
    return 0

def advance(m, t, h):
    m.position[0] = t + h
    return 0

class OnlyAPosition(Model):
    '''A vehicle that moves north.'''

    step_size = 0.25
    variables = (Output("position", shape=3, unit="m", verdict=Role.POSITION),)
    kernels = (start, advance)
"""


def test_a_vehicle_whose_only_output_is_its_position(tmp_path: Path) -> None:
    """Without an integer, a Boolean or an enumeration that the verdict could watch."""
    (tmp_path / "only_a_position.py").write_text(MASS)
    (model,) = load_models(str(tmp_path / "only_a_position.py"))
    result, got = alone(build(model, tmp_path, interpreted=True).file, until=1.0)
    assert result.outcome == "done" and result.verdict is not None
    assert got["OnlyAPosition.position[1]"] == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_everything_wrong_with_a_file_of_inputs(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("DRIVE", 2, "CS", stop=1.0, step=0.5)
    stimuli = tmp_path / "in.csv"

    def problems(text: str, **options: Any) -> list[str]:
        stimuli.write_text(text)
        with pytest.raises(SystemDescriptionError) as caught:
            simulate(file, RunOptions(inputs=stimuli, **options))
        return [str(problem) for problem in caught.value.problems]

    at = f"{stimuli}:"
    assert problems("time,u,w,u,x\n0,1,1,1,1\n", overrides={"u": "1"}) == [
        f'{at}1: column "u": the input is set by --set too; leave out one of them',
        f'{at}1: column "w" is not an open input; valid: "m", "on", "s", "u"',
        f'{at}1: column "u": the input is set by --set too; leave out one of them',
        f'{at}1: column "u" is there twice',
        f'{at}1: column "x" is not an open input; valid: "m", "on", "s", "u"',
    ]
    assert problems("t,u\n0,1\n") == [f'{at}1: its first column is "t"; it must be "time"']
    assert problems("time,u,m\n0,1,1\n1,zwei,1.5\n\n0.5,1\n0.5,nan,1\nx,1,1\n") == [
        f'{at}3: u = "zwei": valid: a finite number',
        f'{at}3: m = "1.5": valid: an integer',
        f"{at}5: has 2 cells; the row of names has 3",
        f"{at}6: time 0.5 s lies before that of the row above, 1 s",
        f'{at}6: u = "nan": valid: a finite number',
        f'{at}7: time "x" is not a number',
    ]
    assert problems("time,u\n0,5_0\n") == [f'{at}2: u = "5_0": valid: a finite number']
    text = "it has only the column time, and so sets nothing; add a column for each input"
    assert problems("time\n0\n") == [f"{at}1: {text}"]
    assert problems("time,u\n")[0].startswith(f"{stimuli}: needs a row of names")
    many = problems("time,u\n" + "0,x\n" * 50)
    assert len(many) == 21 and many[-1] == f"{stimuli}: and 30 more problems"
    with pytest.raises(SystemDescriptionError, match=r"none\.csv: cannot be read: No such file"):
        simulate(file, RunOptions(inputs=tmp_path / "none.csv"))


def test_a_run_with_inputs_goes_on_from_a_checkpoint(dynamics: Any, tmp_path: Path) -> None:
    file = dynamics.fmu("DRIVE", 3, "CS", stop=2.0, step=0.1)
    (tmp_path / "in.csv").write_text(CSV)
    first, second, other = (tmp_path / name for name in ("first", "second", "other"))
    simulate(file, RunOptions(out=first, inputs=tmp_path / "in.csv", checkpoint_every=0.4))
    simulate(file, RunOptions(out=second, inputs=tmp_path / "in.csv", origin=f"{first}@0.8"))
    assert columns(first) == columns(second)
    with pytest.raises(SystemDescriptionError, match="the file of --input must be what it was"):
        simulate(file, RunOptions(out=other, origin=f"{first}@0.8"))


@given(
    rows=st.lists(st.tuples(st.integers(0, 12), st.floats(-1e3, 1e3)), min_size=2, max_size=8),
    at=st.lists(st.floats(-1, 13), min_size=1, max_size=5),
    held=st.booleans(),
)
def test_interpolation_is_that_of_fmpy(rows: list[tuple[int, float]], at: list[float], held: bool) -> None:
    """But for a jump at the very first row, where FMPy holds the value before it for one more step."""
    rows.sort(key=lambda row: row[0])
    times, values = np.array([float(t) for t, _ in rows]), np.array([x for _, x in rows])
    points = np.array([t for t in [*at, *times] if t != times[0]])
    got = interpolated(times, values, points, held=held)
    for t, x in zip(points, got, strict=True):
        near = np.abs(times - t)
        if ((near > 0) & (near < 1e-6)).any():
            continue  # FMPy takes for equal what differs by 1e-9
        expected, _ = Input.interpolate(float(t), times, values[np.newaxis, :], discrete=held, after_event=True)
        assert x == pytest.approx(float(expected[0]), rel=1e-12, abs=1e-9)
