"""Nothing is overwritten in silence: where a run's results go, and what of an earlier run is removed."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.figures.draw import FORMATS, figures
from cosim_master.results.storage.run_folder import RunFolder, clear, held_fingerprint, is_figure
from tests.master.results.test_figures import consensus_run

INPUTS = {"system": "1", "seed": "2"}


def holding(folder: Path, inputs: dict[str, str] | None) -> Path:
    folder.mkdir(parents=True)
    manifest = {"outcome": "done"} | ({} if inputs is None else {"fingerprint": inputs})
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def refusal(folder: RunFolder, **options: bool) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        folder.choose(INPUTS, **options)
    (problem,) = caught.value.problems
    assert str(problem.where) == str(folder.path)
    return problem.message


def test_a_folder_without_a_run_is_taken(tmp_path: Path) -> None:
    assert RunFolder(tmp_path / "new").choose(INPUTS) == tmp_path / "new"
    (tmp_path / "notes.txt").write_text("mine")
    assert RunFolder(tmp_path).choose(INPUTS) == tmp_path


def test_the_same_inputs_may_overwrite(tmp_path: Path) -> None:
    folder = holding(tmp_path / "a", INPUTS)
    assert RunFolder(folder).choose(INPUTS) == folder
    assert RunFolder(folder, numbered=True).choose(INPUTS) == folder


def test_other_inputs_are_refused_and_named(tmp_path: Path) -> None:
    folder = holding(tmp_path / "a", INPUTS | {"seed": "3", "recording": "9"})
    text = "holds the results of a run with other inputs (seed, recording); "
    assert refusal(RunFolder(folder)) == text + "give another folder, or --force to overwrite it"
    assert RunFolder(folder, force=True).choose(INPUTS) == folder


def test_results_of_unknown_inputs_are_refused(tmp_path: Path) -> None:
    text = "holds the results of a run whose inputs are not known (it was cut short, or is of an older version); "
    text += "give another folder, or --force to overwrite it"
    assert refusal(RunFolder(holding(tmp_path / "old", None))) == text
    killed = tmp_path / "killed"
    killed.mkdir()
    (killed / "signals.parquet").write_bytes(b"PAR1")
    assert refusal(RunFolder(killed)) == text
    broken = holding(tmp_path / "broken", INPUTS)
    (broken / "manifest.json").write_text("[1]")
    assert refusal(RunFolder(broken)) == text


def test_a_campaign_is_never_overwritten(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    (folder / "runs").mkdir(parents=True)
    (folder / "study.json").write_text("{}")
    for force in (False, True):
        assert refusal(RunFolder(folder, force=force)) == "holds a campaign; give another folder"
        assert RunFolder(folder, numbered=True, force=force).choose(INPUTS) == tmp_path / "study-2"


def test_a_run_with_real_programs_repeats_none(tmp_path: Path) -> None:
    folder = holding(tmp_path / "a", INPUTS)
    text = "holds the results of a run with packets from outside, of programs or a person; "
    assert refusal(RunFolder(folder), repeatable=False) == text + "give another folder, or --force to overwrite it"


def test_numbers_follow_until_a_folder_is_free_or_of_the_same_inputs(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "line", numbered=True)
    holding(tmp_path / "line", INPUTS | {"seed": "3"})
    assert folder.choose(INPUTS) == tmp_path / "line-2"
    holding(tmp_path / "line-2", INPUTS | {"seed": "4"})
    assert folder.choose(INPUTS) == tmp_path / "line-3"
    holding(tmp_path / "line-3", INPUTS)
    assert folder.choose(INPUTS) == tmp_path / "line-3"
    assert RunFolder(tmp_path / "line", numbered=True, force=True).choose(INPUTS) == tmp_path / "line"


@pytest.fixture
def system(probes: Any) -> Path:
    probes.fmu()
    made: Path = probes.ssd(probes.component("a", u=1.0) + probes.component("b"), "a/y b/u")
    return made


def test_each_kind_of_input_is_told_apart(system: Path, tmp_path: Path, probes: Any) -> None:
    """Two equal runs have equal inputs; each change is seen, and under its name."""

    def inputs(**options: Any) -> dict[str, str]:
        out = tmp_path / "out"
        assert simulate(system, RunOptions(out=out, **options)).outcome == "done"
        held = held_fingerprint(out)
        assert held
        return held

    first = inputs()
    assert inputs(threads=1, pace=1e6, profile=False) == first

    def different(**options: Any) -> list[str]:
        other = inputs(**options)
        return [name for name in first if first[name] != other[name]]

    assert different(seed=5) == ["seed"]
    assert different(until=1.0) == ["time"]
    assert different(overrides={"a.u": "2"}) == ["start values"]
    assert different(record=("a.y",)) == ["recording"]
    assert different(at=[(1.0, "a.u", "4")]) == ["changes"]
    text = system.read_text()
    system.write_text(text.replace("</ssd:SystemStructureDescription>", "<!-- --></ssd:SystemStructureDescription>"))
    assert different() == ["system"]
    system.write_text(text)
    probes.fmu(guid="another")
    assert different() == ["FMUs"]


def test_a_run_removes_the_one_before_and_its_figures_only(tmp_path: Path) -> None:
    run = consensus_run(tmp_path / "run", last_step=1)
    drawn = [*figures(run, signals=["drone1.agent.step"], formats=FORMATS)]
    assert {file.suffix for file in drawn} == {".png", ".svg", ".pdf"}
    digest = hashlib.sha256((run / "signals.parquet").read_bytes()).hexdigest()
    for file in drawn:
        assert f"uav-cosim, signals.parquet sha256 {digest}".encode() in file.read_bytes()
        assert is_figure(file)
    (run / "errors.svg").write_text("<svg>my own</svg>")
    (run / "photo.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (run / "notes.txt").write_text("uav-cosim, signals.parquet sha256 ")
    (run / "packets").mkdir(exist_ok=True)
    (run / "packets" / "drone9.tlog").write_bytes(b"")
    (run / "checkpoints" / "3").mkdir(parents=True)
    clear(run)
    left = sorted(str(file.relative_to(run)) for file in run.rglob("*") if file.is_file())
    assert left == ["errors.svg", "notes.txt", "photo.png"]
    assert not (run / "checkpoints").exists()
