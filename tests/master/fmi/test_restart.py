"""Isolated FMUs that crash and are started anew: the recording is that of an FMU that does not crash."""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.cli.verbs.run import _report
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.preparation.isolating import chosen_isolation, isolation_for
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.isolation.child import End, Limits, Restart
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.conftest import Workshop
from tests.master.fmi.test_isolation import ABLE, Faulties, _folder, leftovers, rows

Run = Callable[..., RunResult]
SEGV = "its process was ended by signal 11 (SIGSEGV)"


@pytest.fixture
def faulties(workshop: Workshop, tmp_path_factory: pytest.TempPathFactory) -> Faulties:
    return Faulties(workshop, _folder(tmp_path_factory))


@pytest.fixture
def run(faulties: Faulties, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))

    def runs(fault: str, restarts: int, requests: int = 256, out: str = "out", **how: Any) -> RunResult:
        limits = Limits(memory=64 << 20, restarts=restarts, requests=requests)
        options = RunOptions(out=tmp_path / out, isolation=Isolation("foreign", limits), checkpoint_every=1.0)
        before = leftovers()
        result = simulate(faulties.system(fault, **how), options)
        assert leftovers() <= before
        return result

    return runs


@pytest.fixture
def reference(run: Run, tmp_path: Path) -> Any:
    assert run("none none 0", 0, out="reference").outcome == "done"
    return pq.read_table(tmp_path / "reference" / "signals.parquet")


@pytest.mark.parametrize("requests", [1, 2, 256])
@pytest.mark.parametrize("function", ["fmi2DoStep 3", "fmi2SetReal 4", "fmi2GetReal 3", "fmi2SerializeFMUstate 2"])
def test_one_crash_changes_nothing(run: Run, reference: Any, tmp_path: Path, function: str, requests: int) -> None:
    """States are kept before every step, before every other one, or before the first one only: inputs are replayed."""
    result = run(f"crash1 {function}", 1, requests)
    assert (result.outcome, result.simulated_s, result.restarts) == ("done", 2.0, 1), str(result.error)
    assert pq.read_table(tmp_path / "out" / "signals.parquet").equals(reference)
    name = function.split()[0]
    (note,) = (text for text in result.notes if "anew" in text)
    assert note.startswith(f"bad: {name} "), note
    assert note.endswith(f"{SEGV}; it was started anew (1 of 1)"), note
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["notes"] == list(result.notes)


def test_the_note_tells_the_time(
    run: Run, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    with caplog.at_level(logging.WARNING):
        result = run("crash1 fmi2DoStep 3", 2)
    text = f"bad: fmi2DoStep at t = 1 s: {SEGV}; it was started anew (1 of 2)"
    assert text in result.notes
    assert f"note: {text}" in [record.getMessage() for record in caplog.records]
    _report(result)
    assert "done, after 1 restart of FMUs that crashed: 2 s simulated in " in capsys.readouterr().out


def test_repeated_crashes(run: Run, reference: Any, tmp_path: Path) -> None:
    """Three crashes need three restarts; with two, the run fails as without any."""
    result = run("crash3 fmi2DoStep 3", 3)
    assert (result.outcome, result.restarts) == ("done", 3), str(result.error)
    assert pq.read_table(tmp_path / "out" / "signals.parquet").equals(reference)
    assert [text[-8:] for text in result.notes if "anew" in text] == ["(1 of 3)", "(2 of 3)", "(3 of 3)"]
    failed = run("crash3 fmi2DoStep 3", 2)
    assert (failed.outcome, failed.simulated_s, failed.restarts) == ("failed", 1.0, 2)
    assert str(failed.error).startswith(
        f"bad: fmi2DoStep failed at t = 1 s: {SEGV}, after 2 restarts of the process; its inputs: u = 1"
    )
    assert rows(tmp_path / "out") == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("function", ["fmi2EnterInitializationMode", "fmi2Terminate", "fmi2FreeInstance"])
def test_a_crash_before_and_after_all_steps(run: Run, reference: Any, tmp_path: Path, function: str) -> None:
    result = run(f"crash1 {function} 1", 1)
    assert (result.outcome, result.restarts) == ("done", 1), str(result.error)
    assert pq.read_table(tmp_path / "out" / "signals.parquet").equals(reference)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert sum(f"bad: {function} " in text for text in manifest["notes"]) == 1


def test_instances_that_share_a_process_are_all_brought_back(run: Run, tmp_path: Path) -> None:
    assert run("none none 0", 0, out="both", same_file=True).outcome == "done"
    result = run("crash1 fmi2DoStep 3", 1, same_file=True)
    assert (result.outcome, result.restarts) == ("done", 1), str(result.error)
    both = pq.read_table(tmp_path / "both" / "signals.parquet")
    assert pq.read_table(tmp_path / "out" / "signals.parquet").equals(both)


def test_an_incomplete_state_is_found(run: Run, tmp_path: Path) -> None:
    """This FMU steps differently after its crash, and so its replayed steps do not give the values they gave before."""
    result = run("crash1-differ fmi2DoStep 3", 1)
    assert (result.outcome, result.simulated_s) == ("failed", 1.0)
    assert "after a restart it does not answer as before: the state that it has serialised is incomplete" in str(
        result.error
    )


def test_a_state_that_cannot_be_serialised_ends_the_protection_only(run: Run, reference: Any, tmp_path: Path) -> None:
    """The first state is refused; the run has checkpoints, which fail with the error of the FMU."""
    result = run("error fmi2SerializeFMUstate 1", 1)
    assert "bad.fmu: its state could not be kept: its process is not started anew after a crash" in result.notes


def _isolation(faulties: Faulties, chosen: Isolation | None, system: Path) -> Isolation:
    with read_system(system) as structure:
        return isolation_for(chosen, check(structure))


def test_fmus_without_states_are_refused(faulties: Faulties) -> None:
    system = faulties.system("none none 0")
    faulties.fmu("bad.fmu", "none none 0", ABLE.replace('canSerializeFMUstate="true"', ""))
    with pytest.raises(SystemDescriptionError) as caught:
        _isolation(faulties, chosen_isolation("foreign", None, None, 1), system)
    (problem,) = caught.value.problems
    assert "bad cannot be started anew after a crash (--restart-crashed): canSerializeFMUstate is false" in str(problem)


def test_restarts_need_a_process(faulties: Faulties) -> None:
    with pytest.raises(SystemDescriptionError, match="no FMU of this system runs in a process of its own"):
        _isolation(faulties, chosen_isolation("none", None, None, 1), faulties.system("none none 0"))


def _annotated(system: Path, attributes: str) -> Path:
    text = system.read_text(encoding="utf-8")
    annotation = (
        '<ssd:Annotations><ssc:Annotation type="org.uav-cosim.isolation">'
        f'<isolation xmlns="https://uav-cosim.org/ns/1" {attributes}/></ssc:Annotation></ssd:Annotations>'
    )
    at = text.index("</ssd:Component>")
    system.write_text(text[:at] + annotation + text[at:], encoding="utf-8")
    return system


def test_a_system_sets_restarts(faulties: Faulties) -> None:
    """The first component is `bad`; those that share its process have the same, and the command line precedes."""
    system = _annotated(faulties.system("none none 0"), 'process="instance" restarts="2"')
    found = _isolation(faulties, None, system)
    assert [found.limits_of(name).restarts for name in ("bad", "good")] == [2, 0]
    chosen = _isolation(faulties, chosen_isolation("foreign", None, None, 5), system)
    assert [chosen.limits_of(name).restarts for name in ("bad", "good")] == [5, 5]
    shared = _annotated(faulties.system("none none 0", same_file=True), 'process="file" restarts="3"')
    assert [_isolation(faulties, None, shared).limits_of(name).restarts for name in ("bad", "good")] == [3, 3]


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ('process="file" restarts="-1"', 'restarts "-1" of <isolation>; valid: an integer from 0 to 999999'),
        ('process="here" restarts="1"', 'an FMU of process "here" is not started anew'),
    ],
)
def test_wrong_restarts_of_a_system(faulties: Faulties, attributes: str, message: str) -> None:
    with pytest.raises(SystemDescriptionError, match=message):
        _isolation(faulties, None, _annotated(faulties.system("none none 0"), attributes))


def test_a_process_that_ends_between_two_calls() -> None:
    """Nothing was called then, so that the binary is named."""
    end = End(SEGV, "", "")
    text = f"Hull: between two calls at t = 1.5 s: {SEGV}; it was started anew (2 of 3)"
    assert str(Restart(end, "Hull", 1.5, 2, 3)) == text
    assert "Hull: between two calls before its first step: " in str(Restart(end, "Hull", float("nan"), 1, 3))
