"""Steps that an FMU does not do: repeated shorter, stopped, ended. The FMUs check every call (strict.c)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate

pytestmark = pytest.mark.usefixtures("own_cache")


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def ran(stricts: Any, system: Path, **options: Any) -> RunResult:
    result = simulate(system, RunOptions(**options))
    assert stricts.complaints == []
    return result


def failed(stricts: Any, system: Path, **options: Any) -> str:
    result = ran(stricts, system, **options)
    assert result.outcome == "failed"
    return str(result.error)


# ---- discarded steps that are repeated --------------------------------------------------------


def test_a_discarded_step_is_repeated_in_shorter_ones_by_all(stricts: Any, tmp_path: Path) -> None:
    """b follows a with one step of delay; while a takes steps of a quarter, so does b, with exchange in between."""
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.125, u=1.0) + stricts.component("b")
    result = ran(stricts, stricts.ssd(parts, "a/y b/u", stop=1.5), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert got["time"] == [0.0, 0.5, 1.0, 1.5]
    assert got["a.y"] == [0.0, 0.5, 1.0, 1.5]
    quarter = [0.125 * sum(t + 0.125 * i for i in range(4)) for t in (0.5, 1.0)]
    assert got["b.y"] == [0.0, 0.0, quarter[0], quarter[0] + quarter[1]]
    assert got["a.n"] == [0, 1, 5, 9] and got["b.n"] == [0, 1, 5, 9]
    steps = stricts.steps
    assert [step for step in steps if step.startswith("a")][:8] == [
        *("a 0 + 0.5", "a 0.5 + 0.5", "a 0 + 0.5", "a 0.5 + 0.25", "a 0.5 + 0.125"),
        *("a 0.625 + 0.125", "a 0.75 + 0.125", "a 0.875 + 0.125"),
    ]


def test_the_last_successful_time_says_how_short(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=2, when=0.5, longest=0.1, u=1.0)
    result = ran(stricts, stricts.ssd(parts, stop=1.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    assert (
        stricts.steps[-6:]
        == [
            *("a 0.5 + 0.5", "a 0 + 0.5"),  # back to the copy made at the start, and again
            *("a 0.5 + 0.1", "a 0.6 + 0.1", "a 0.7 + 0.1", "a 0.8 + 0.1", "a 0.9 + 0.1"),
        ][-6:]
    )
    assert signals(tmp_path / "out")["a.y"][-1] == pytest.approx(1.0, abs=1e-15)


def test_slow_instances_keep_their_rate_while_others_repeat(stricts: Any, tmp_path: Path) -> None:
    """The slow one is in the middle of its step when the fast one discards."""
    stricts.fmu(step=0.5)
    parts = stricts.component("a", mode=1, when=0.5, longest=0.25, u=1.0) + stricts.component("slow", step=1.5)
    result = ran(stricts, stricts.ssd(parts, "a/y slow/u", stop=3.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert got["time"] == [k / 2 for k in range(7)]
    assert got["a.n"] == [0, 1, 3, 5, 7, 9, 11]
    assert got["slow.n"] == [0, 0, 0, 1, 1, 2, 3]  # at 1.5 s both begin a step, and both halve it


def test_a_slow_instance_that_discards_ends_on_its_own_grid(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu(step=0.5)
    parts = stricts.component("fast", u=2.0) + stricts.component("slow", step=1.0, mode=1, longest=0.5, u=1.0)
    result = ran(stricts, stricts.ssd(parts, stop=3.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert got["time"] == [k / 2 for k in range(7)]
    assert got["slow.y"] == got["time"]
    assert got["fast.y"] == [2 * t for t in got["time"]]
    assert got["slow.n"] == [0, 1, 2, 3, 4, 5, 6]


def test_strings_and_booleans_are_exchanged_in_repeated_steps_too(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.25, s="x") + stricts.component("b")
    result = ran(stricts, stricts.ssd(parts, "a/r b/s", "a/c b/b", "b/r a/s", stop=1.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    assert got["a.n"] == [0, 1, 3]
    # "x!!" and "!!" after initialization; then one more at every exchange, of which the second step has two
    assert got["b.r"] == ["x!!", "!!!", "!!!!!"]


def test_an_fmu_that_discards_whatever_is_tried(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=7, when=1.0) + stricts.component("b")
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert message == (
        "a: fmi2DoStep failed at t = 1 s: fmi2Discard: it could not step from 1 s to 1.00195312 s, only to 1 s; "
        "shorter steps down to 0.001953125 s did not help"
    )
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    assert len(stricts.steps) < 60


def test_a_repetition_that_fails_loses_nothing(stricts: Any, tmp_path: Path) -> None:
    """Having gone back, the FMU discards a step that it had done: rows of the steps that were done stay."""
    stricts.fmu()
    parts = stricts.component("a", mode=13, when=1.0, u=1.0, s="x") + stricts.component("b")
    message = failed(stricts, stricts.ssd(parts, "a/y b/u", "a/r b/s"), out=tmp_path / "out")
    assert message.endswith(
        "to repeat it, the run went back to a copy of its state and did not come again to this step"
    )
    assert "did not help" not in message and "at t = 1 s" in message
    got = signals(tmp_path / "out")
    assert got["time"] == [0.0, 0.5, 1.0] and got["a.y"] == [0.0, 0.5, 1.0] and got["a.n"] == [0, 1, 2]
    assert got["b.r"] == ["x!!", "x!!", "x!!"]
    steps = [step for step in stricts.steps if step.startswith("a")]
    assert steps == ["a 0 + 0.5", "a 0.5 + 0.5", "a 1 + 0.5", "a 0 + 0.5", "a 0.5 + 0.5"]


def test_an_fmu_whose_state_is_not_restored(stricts: Any, tmp_path: Path) -> None:
    """It says that it can; what it does when stepped again shows that it cannot."""
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=0.5, longest=0.125) + stricts.component("b", mode=10, u=1.0)
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert message.splitlines()[-1] == (
        "b: fmi2SetFMUstate failed at t = 0.5 s: the step cannot be repeated: "
        "after fmi2SetFMUstate, b.y went another way"
    )


# ---- discarded steps that are not -------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        ('canHandleVariableCommunicationStepSize="true"', "canGetAndSetFMUstate of b is false"),
        ('canGetAndSetFMUstate="true"', "canHandleVariableCommunicationStepSize of b is false"),
    ],
)
def test_one_that_cannot_go_back_stops_all(stricts: Any, tmp_path: Path, flags: str, reason: str) -> None:
    stricts.fmu()
    stricts.fmu("other.fmu", flags=flags)
    parts = stricts.component("a", mode=2, when=1.0, longest=0.2) + stricts.component("b", "other.fmu")
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert message == (
        f"a: fmi2DoStep failed at t = 1 s: fmi2Discard: it could not step from 1 s to 1.5 s, only to 1.2 s; {reason}"
    )
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    assert not [call for call in stricts.calls if "FMUstate" in call]


def test_an_fmu_that_wants_to_end(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", mode=3, when=1.25) + stricts.component("b")
    result = ran(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert (result.outcome, result.simulated_s) == ("terminated", 1.0)
    assert str(result.error) == "a: it requested the end of the run at t = 1.25 s (fmi2Terminated)"
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["verdict"]["good"]) == ("terminated", True)
    assert stricts.calls[-4:] == [
        *("a: fmi2Terminate", "b: fmi2Terminate", "a: fmi2FreeInstance", "b: fmi2FreeInstance"),
    ]


def test_an_fmu_that_wants_to_end_with_its_step(stricts: Any, tmp_path: Path) -> None:
    """All have done the step, so it is recorded."""
    stricts.fmu()
    parts = stricts.component("a", mode=12, when=0.75, u=1.0) + stricts.component("b", u=2.0)
    result = simulate(stricts.ssd(parts), RunOptions(out=tmp_path / "out", record=["*.y"]))
    assert (result.outcome, result.simulated_s, stricts.complaints) == ("terminated", 1.0, [])
    assert signals(tmp_path / "out") == {"time": [0.0, 0.5, 1.0], "a.y": [0.0, 0.5, 1.0], "b.y": [0.0, 1.0, 2.0]}


def test_a_pending_step_is_cancelled_and_refused(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu(flags='canRunAsynchronuously="true"')
    parts = stricts.component("a", mode=4, when=1.0) + stricts.component("b")
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert message == (
        "a: fmi2DoStep failed at t = 1 s: fmi2Pending: it goes on in the background, which is not supported"
    )
    assert stricts.calls[-4:] == [
        *("a: fmi2CancelStep", "b: fmi2Terminate", "a: fmi2FreeInstance", "b: fmi2FreeInstance"),
    ]


def test_after_fatal_no_instance_of_that_fmu_is_called(stricts: Any, tmp_path: Path) -> None:
    """FMI 2.0.5, section 2.1.3: it is corrupted for all of them. Instances of other FMUs finish the step."""
    stricts.fmu()
    stricts.fmu("other.fmu")
    parts = stricts.component("a", mode=6, when=1.0) + stricts.component("b") + stricts.component("c", "other.fmu")
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert message == "a: fmi2DoStep failed at t = 1 s: fmi2Fatal; its inputs: u = 0, b = 0"
    calls = stricts.calls
    after = calls[calls.index("a: step 1 + 0.5") + 1 :]
    assert {call[0] for call in after} == {"c"}
    assert after[-2:] == ["c: fmi2Terminate", "c: fmi2FreeInstance"]


def test_a_value_that_is_rejected(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    parts = stricts.component("a", u=400.0) + stricts.component("b", mode=8)
    message = failed(stricts, stricts.ssd(parts, "a/y b/u"), out=tmp_path / "out")
    assert message == ("b: fmi2SetReal failed at t = 0.5 s: fmi2Discard: it rejected one of these values: u = 200")


@pytest.mark.parametrize("mode", [0, 11])
def test_a_run_without_trouble_and_one_full_of_warnings(stricts: Any, mode: int) -> None:
    stricts.fmu()
    fixed = stricts.fmu("fixed.fmu", flags="", guid="fixed")
    assert fixed.exists()
    parts = stricts.component("a", mode=mode, u=1.0) + stricts.component("b", "fixed.fmu", mode=mode)
    wires = ("a/y b/u", "a/r b/s", "a/c b/b", "b/r a/s")
    assert ran(stricts, stricts.ssd(parts, *wires)).outcome == "done"


def test_terminate_that_fails_leaves_a_complete_recording(stricts: Any, tmp_path: Path) -> None:
    """The run has failed, and says so; all of it was simulated and recorded."""
    stricts.fmu()
    parts = stricts.component("a", mode=9) + stricts.component("b")
    result = ran(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert (result.outcome, result.simulated_s) == ("failed", 2.0)
    assert str(result.error) == "a: fmi2Terminate failed at t = 2 s: fmi2Error"
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"]) == ("failed", str(result.error))
    assert manifest["simulated_s"] == 2.0
    assert stricts.calls[-4:] == [
        *("a: fmi2Terminate", "b: fmi2Terminate", "a: fmi2FreeInstance", "b: fmi2FreeInstance"),
    ]


def test_terminate_that_fails_after_a_failed_step(stricts: Any, tmp_path: Path) -> None:
    """Both are reported."""
    stricts.fmu()
    stricts.fmu("other.fmu")
    parts = stricts.component("a", mode=5, when=1.0) + stricts.component("b", "other.fmu", mode=9)
    result = ran(stricts, stricts.ssd(parts), out=tmp_path / "out")
    expected = [
        "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 0, b = 0",
        "b: fmi2Terminate failed at t = 1 s: fmi2Error",
    ]
    assert (result.outcome, str(result.error).splitlines()) == ("failed", expected)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["error"].splitlines() == expected


def test_terminate_that_fails_on_the_command_line(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", mode=9))
    done = CliRunner().invoke(app, ["run", str(system), "-o", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert "error: a: fmi2Terminate failed at t = 2 s: fmi2Error" in done.output
    assert "failed: 2 s simulated" in done.output


# ---- steps that some discard while others fail or end ------------------------------------------


@pytest.mark.parametrize(
    ("mode", "word"),
    [(5, "fmi2Error"), (6, "fmi2Fatal")],
)
def test_a_step_in_which_another_fmu_fails_is_not_repeated(stricts: Any, tmp_path: Path, mode: int, word: str) -> None:
    """Both are reported, the one that only discarded with how far it got; after fmi2Fatal nobody is asked for that."""
    stricts.fmu()
    # b is stepped before z: after fmi2Fatal it would not be stepped at all.
    parts = stricts.component("b", mode=2, when=1.0, longest=0.25) + stricts.component("z", mode=mode, when=1.0)
    message = failed(stricts, stricts.ssd(parts), out=tmp_path / "out")
    reached = ", only to 1.25 s" if mode == 5 else ""
    assert message.splitlines() == [
        f"b: fmi2DoStep failed at t = 1 s: fmi2Discard: it could not step from 1 s to 1.5 s{reached}; "
        "it is not repeated, since z failed in the same step",
        f"z: fmi2DoStep failed at t = 1 s: {word}; its inputs: u = 0, b = 0",
    ]
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    assert [step for step in stricts.steps if step.startswith("b 1")] == ["b 1 + 0.5"]


def test_an_fmu_wants_to_end_while_another_discards(stricts: Any, tmp_path: Path) -> None:
    """The end of the run is no failure; the other's step is not repeated for it."""
    stricts.fmu()
    parts = stricts.component("a", mode=3, when=1.25) + stricts.component("b", mode=1, when=1.0, longest=0.25)
    result = ran(stricts, stricts.ssd(parts), out=tmp_path / "out")
    assert (result.outcome, result.simulated_s) == ("terminated", 1.0)
    assert str(result.error) == "a: it requested the end of the run at t = 1.25 s (fmi2Terminated)"
