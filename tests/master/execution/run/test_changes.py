"""Values set while a run is going on. The FMUs check every call (strict.c)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.forks import Forks

pytestmark = pytest.mark.usefixtures("own_cache")


def test_a_tunable_parameter_and_an_open_input_change(stricts: Any, tmp_path: Path) -> None:
    """y integrates p * u; what is set at a time counts for the step that begins then."""
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", p=2.0, u=1.0, s="x"), stop=2.5)
    at = [(1.0, "a.p", "4"), (0.0, "a.p", "1"), (1.5, "a.u", "-0.5"), (1.0, "a.p", "3"), (0.5, "a.s", "new ")]
    result = simulate(system, RunOptions(out=tmp_path / "out", at=at))
    assert (result.outcome, stricts.complaints) == ("done", [])
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert got["a.y"] == [0.0, 0.5, 1.0, 2.5, 1.75, 1.0]  # p = 1, 1, 3, 3, 3 and u = 1, 1, 1, -0.5, -0.5
    assert got["a.r"] == ["x!", "x!", *["new !"] * 4]
    changes = json.loads((tmp_path / "out" / "manifest.json").read_text())["changes"]
    assert [(c["time"], c["variable"], c["value"]) for c in changes] == [
        *((0.0, "a.p", 1.0), (0.5, "a.s", "new "), (1.0, "a.p", 4.0), (1.0, "a.p", 3.0), (1.5, "a.u", -0.5)),
    ]


def test_a_change_is_not_lost_when_steps_are_repeated(stricts: Any, tmp_path: Path) -> None:
    """a discards the step in which the change comes, and later ones."""
    stricts.fmu()
    parts = stricts.component("a", mode=1, when=1.0, longest=0.25) + stricts.component("b", u=1.0)
    result = simulate(stricts.ssd(parts), RunOptions(out=tmp_path / "out", at=[(0.5, "b.p", "2"), (1.0, "b.p", "10")]))
    assert (result.outcome, stricts.complaints) == ("done", [])
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert got["b.y"] == [0.0, 0.5, 1.5, 6.5, 11.5]
    assert got["a.n"] == [0, 1, 2, 4, 6]


def test_a_rejected_change(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    result = simulate(
        stricts.ssd(stricts.component("a", mode=8)), RunOptions(out=tmp_path / "out", at=[(1.0, "a.u", "101")])
    )
    assert str(result.error) == "a: fmi2SetReal failed at t = 1 s: fmi2Discard"
    assert stricts.complaints == []
    assert pq.read_table(tmp_path / "out" / "signals.parquet")["time"].to_pylist() == [0.0, 0.5, 1.0]


def test_everything_wrong_with_changes_at_once(stricts: Any) -> None:
    stricts.fmu()
    parts = stricts.component("a") + stricts.component("b", step=1.0)
    wrong = {
        (1.0, "a.q", "1"): "there is no such variable; ",
        (1.0, "a.y", "1"): "it is a continuous output; only tunable parameters and inputs can be changed during a run",
        (1.0, "a.when", "1"): "it is a fixed parameter; only tunable",
        (1.0, "b.u", "1"): "it is connected, and gets its value from there",
        (1.0, "a.p", "x"): "valid: a number",
        (1.0, "a.p", "1001"): "valid: -inf to 1000",
        (1.0, "a.b", "yes"): "valid: true or false",
        (0.7, "a.p", "1"): "no step of a begins then; its steps begin every 0.5 s from 0 to 1.5 s",
        (0.5, "b.p", "1"): "no step of b begins then; its steps begin every 1 s from 0 to 1 s",
        (2.0, "a.p", "1"): "no step of a begins then; its steps begin every 0.5 s from 0 to 1.5 s",
        (-0.5, "a.p", "1"): "no step of a begins then; ",
        (float("nan"), "a.p", "1"): "no step of a begins then; ",
    }
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(stricts.ssd(parts, "a/y b/u"), RunOptions(at=list(wrong)))
    messages = [str(problem) for problem in caught.value.problems]
    for (time, name, text), expected in wrong.items():
        assert any(m.startswith(f"--at {time:g} {name}={text}: {expected}") for m in messages), (name, messages)
    assert len(messages) == len(wrong)


def test_what_a_resumed_run_cannot_set_is_refused_by_the_name_of_its_option(
    linears: Any, tmp_path: Path, forks: Forks
) -> None:
    linears.fmu()
    system = linears.ssd(linears.component("a", x0=1.0, w2=1.0, step=0.1))
    words = ["run", str(system), "--checkpoint-every", "1", "--until", "2", "-o", "run"]
    assert forks.run(words, tmp_path, os.environ).returncode == 0
    done = forks.run(["run", str(system), "--from", "run@1", "--set", "a.y=1", "-o", "on"], tmp_path, os.environ)
    refused = "it is a continuous output; only tunable parameters and inputs can be changed during a run"
    assert (done.returncode, done.stderr.splitlines()[-1]) == (2, f"error: --set a.y=1: {refused}")
    assert not (tmp_path / "on").exists()


def test_the_option_takes_two_words(stricts: Any, tmp_path: Path, forks: Forks) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", u=1.0))
    words = ["run", str(system), "-o", "out"]
    done = forks.run([*words, "--at", "1", "a.p=3", "--at", "1.5", "a.p=5"], tmp_path, os.environ)
    assert done.returncode == 0, done.stderr
    assert pq.read_table(tmp_path / "out" / "signals.parquet")["a.y"].to_pylist() == [0.0, 0.5, 1.0, 2.5, 5.0]
    done = forks.run([*words, "--at", "1", "a.p"], tmp_path, os.environ)
    *stages, said = done.stderr.splitlines()
    assert (done.returncode, said) == (2, "error: --at 1 a.p: write --at TIME COMPONENT.PARAMETER=VALUE")
    assert all(stage.endswith(" ...") for stage in stages), stages  # of stages that took longer than a second
    done = forks.run([*words, "--at", "1", "--until", "1"], tmp_path, os.environ)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (
        2,
        "error: --at 1: write --at TIME COMPONENT.PARAMETER=VALUE",
    )
