"""Profiles: what was counted, and that looking changes nothing. No time is compared with a clock."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.stepping import profiling
from cosim_master.stepping.profiling import Profiler
from tests.master.fmus.probe import model

pytestmark = [
    pytest.mark.usefixtures("own_cache"),
    pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="profiles need compiled kernels"),
]


def test_steps_are_counted_and_times_belong_to_their_fmu(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    stricts.fmu("slow.fmu")
    parts = stricts.component("a", u=1.0) + stricts.component("b") + stricts.component("c", "slow.fmu", step=1.0)
    system = stricts.ssd(parts, "a/y b/u", "b/y c/u", stop=4.0)
    result = simulate(system, RunOptions(out=tmp_path / "with", profile=True))
    assert (result.outcome, stricts.complaints) == ("done", [])
    assert result.profile is not None
    found = {one.fmu: one for one in result.profile.fmus}
    assert {name: (one.instances, one.steps) for name, one in found.items()} == {
        "strict.fmu": (2, 16),
        "slow.fmu": (1, 4),
    }
    assert all(one.do_step > 0.0 and one.set > 0.0 and one.get > 0.0 for one in found.values())
    assert all(one.total == one.set + one.do_step + one.get for one in found.values())
    assert [one.total for one in result.profile.fmus] == sorted((one.total for one in found.values()), reverse=True)
    phases = result.profile.phases
    assert set(phases) == {"load and instantiate", "initialize", "write results", "stepping"}
    # The first outputs are got before the first step.
    assert sum(one.total for one in found.values()) <= phases["initialize"] + phases["stepping"]
    written = json.loads((tmp_path / "with" / "manifest.json").read_text())["profile"]
    assert written["fmus"][0]["fmu"] == result.profile.fmus[0].fmu

    assert simulate(system, RunOptions(out=tmp_path / "without")).profile is None
    assert "profile" not in json.loads((tmp_path / "without" / "manifest.json").read_text())
    one, other = (pq.read_table(tmp_path / name / "signals.parquet") for name in ("with", "without"))
    assert one.equals(other)


def test_failures_come_through(stricts: Any) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", mode=5, when=1.0))
    result = simulate(system, RunOptions(profile=True))
    assert str(result.error) == "a: fmi2DoStep failed at t = 1 s: fmi2Error; its inputs: u = 0, b = 0"
    assert result.profile is not None and result.profile.fmus[0].steps == 3


COUNTER = """
from cosim import Model, Output, kernel

@kernel
def start(m):
    return 0

@kernel
def advance(m, t, h):
    m.y += h
    return 0

class ProfiledCounter(Model):
    \"\"\"Counts.\"\"\"
    step_size = 0.5
    variables = (Output("y", unit="1"),)
    kernels = (start, advance)
"""


def test_with_several_threads_every_step_is_counted_once(tmp_path: Path, probes: Any) -> None:
    model(tmp_path, "profiled_counter.py", COUNTER)
    parts = "".join(probes.workshop.component(f"c{i}", "ProfiledCounter.fmu", "y:output") for i in range(8))
    result = simulate(probes.ssd(parts, stop=500.0), RunOptions(profile=True, threads=2))
    assert result.outcome == "done", result.error
    assert result.profile is not None
    assert [(one.instances, one.steps) for one in result.profile.fmus] == [(8, 8000)]


def test_the_table(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a"))
    done = CliRunner().invoke(app, ["run", str(system), "--profile", "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.output.splitlines()]
    (row,) = [line for line in lines if line[:1] == ["strict.fmu"]]
    assert row[1:3] == ["1", "4"] and row[-2:] == ["100.0", "%"]
    assert [line[0] for line in lines if line[:1] in (["initialize"], ["stepping"])] == ["initialize", "stepping"]


def test_plain_python_has_no_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(profiling, "PLAIN", True)
    with pytest.raises(RuntimeError, match="NUMBA_DISABLE_JIT is set"):
        Profiler()
