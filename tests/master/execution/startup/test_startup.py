"""Parameters reach FMUs that initialize themselves during start-up, and the manifest says what they answer."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import fmpy
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.execution.startup.initialize import answers, initialize, instantiate
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.fmi2 import set_kind
from cosim_master.fmi.slaves.libraries import Libraries
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.conftest import Workshop
from tests.master.fmus.linear import signals

SHIPPED = sorted((Path(__file__).parents[4] / "fmus").glob("*.fmu"))


@pytest.mark.parametrize(("habit", "tool"), [("plain", ""), ("setup", ""), ("setup", "20-sim"), ("enter", "20-sim")])
def test_parameters_survive_start_up(foreigners: Any, tmp_path: Path, habit: str, tool: str) -> None:
    foreigners.fmu(habit=habit, tool=tool)
    system = foreigners.ssd(foreigners.component("a", step=0.5, p=69.0))
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert list(signals(tmp_path / "out")["a.y"]) == [69.0, 69.0, 69.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["instances"]["a"]["parameters"] == {"p": 69.0, "silent": 1e9}
    assert not [note for note in manifest["notes"] if note.startswith("parameter ")]


def test_the_manifest_says_what_an_fmu_answers_that_takes_no_parameters(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu(habit="deaf")
    system = foreigners.ssd(foreigners.component("a", step=0.5, p=69.0))
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done"
    assert list(signals(tmp_path / "out")["a.y"]) == [5.0, 5.0, 5.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["instances"]["a"]["parameters"]["p"] == 5.0
    note = "parameter a.p: set to 69.0, but after initialization its FMU answers 5.0"
    assert note in manifest["notes"] and note in result.notes


def test_an_fmu_that_does_not_say_its_parameters_runs_with_a_note(foreigners: Any, tmp_path: Path) -> None:
    foreigners.fmu(habit="mute")
    system = foreigners.ssd(foreigners.component("a", step=0.5, p=69.0))
    result = simulate(system, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert list(signals(tmp_path / "out")["a.y"]) == [69.0, 69.0, 69.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["instances"]["a"]["parameters"]["p"] == 69.0
    assert "parameters of a: the values that were set; fmi2GetReal does not say them (fmi2Error)" in manifest["notes"]


def test_parameters_that_nobody_sets_are_not_asked_for(foreigners: Any, tmp_path: Path) -> None:
    """The FlexRay nodes of FMI-LS-BUS refuse to be asked, and fail from then on."""
    foreigners.fmu(habit="stern")
    result = simulate(foreigners.ssd(foreigners.component("a", step=0.5)), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["instances"]["a"]["parameters"] == {"p": 5.0, "silent": 1e9}
    asked = simulate(foreigners.ssd(foreigners.component("a", step=0.5, p=5.0)), RunOptions(out=tmp_path / "asked"))
    assert asked.outcome == "failed" and "fmi2DoStep" in str(asked.error)


def test_fmpy_has_the_same_parameters_in_effect(foreigners: Any, tmp_path: Path) -> None:
    fmu = foreigners.fmu(habit="setup", step=0.5)
    system = foreigners.ssd(foreigners.component("a", p=-2.5))
    simulate(system, RunOptions(out=tmp_path / "out"))
    theirs = fmpy.simulate_fmu(
        str(fmu), stop_time=1.0, output_interval=0.5, start_values={"p": -2.5}, output=["y", "t"], validate=False
    )
    ours = signals(tmp_path / "out")
    assert list(ours["a.y"]) == list(theirs["y"]) == [-2.5, -2.5, -2.5]
    assert list(ours["a.t"]) == list(theirs["t"])


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_fmus_compiled_here_answer_the_parameters_that_were_set(workshop: Workshop, path: Path) -> None:
    """They are not asked in a run: this is why."""
    fmu = describe(path)
    if fmu.generation_tool != "uav-cosim" or fmu.capabilities.needsExecutionTool:
        pytest.skip("interpreted: it is asked in every run")
    values: dict[str, Any] = {}
    for v in fmu.variables.values():
        if v.causality != "parameter" or v.start is None or v.name == "fence_corners":  # a fence of one is refused
            continue
        low = -1e3 if v.minimum is None else v.minimum
        high = 1e3 if v.maximum is None else v.maximum
        if v.type == "Real":
            values[v.name] = math.nextafter(float(v.start), high if float(v.start) < high else low)
        elif v.type == "Integer":
            values[v.name] = int(v.start) + 1 if int(v.start) + 1 <= high else int(max(v.start - 1, low))
        elif v.type == "Boolean":
            values[v.name] = not v.start
    component = workshop.component("a", str(path.name), "", workshop.bindings(values))
    (workshop.root / path.name).write_bytes(path.read_bytes())
    system = workshop.ssd("own.ssd", workshop.system(component), '<ssd:DefaultExperiment stopTime="1"/>')
    with read_system(system) as structure, Libraries() as libraries:
        checked = check(structure)
        slaves: list[Slave] = []
        try:
            instantiate(checked, libraries, slaves)
            initialize(checked, slaves, 0.0, 1.0)
            (one,) = slaves
            assert one.library.thread_safe
            for kind in ("Real", "Integer", "Boolean"):
                some = [fmu.variables[name] for name in values if set_kind(fmu.variables[name]) == kind]
                assert one.get(some) == [values[v.name] for v in some]
            taken, notes = answers(checked, slaves)
            assert values.items() <= taken["a"].items() and not notes
        finally:
            for one in slaves:
                one.free()
