"""Faults in all functions of FMI 3 that a run calls, and in the states of FMI 2: the message names the function.

Where a process may be started anew, such a fault changes nothing.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import platform
from cosim_master.fmi.isolation.child import Limits
from cosim_master.fmi.slaves.isolated import Isolation
from tests.master import processes
from tests.master.conftest import SUFFIX, Workshop
from tests.master.fmi.test_isolation import Faulties, _folder, leftovers
from tests.master.fmus.clocked import clocked, description
from tests.master.fmus.faulting import faulting
from tests.master.fmus.strict3 import ABLE as ABLE3
from tests.master.fmus.strict3 import Stricts3

CLOCKED = Path(__file__).parents[1] / "fmus" / "clocked.c"
CLOCKS = ("constant", "countdown", "changing", "asked", "retuned", "fire")
FLAGS = f'{ABLE3} canSerializeFMUState="true" hasEventMode="true"'
LIMITS = Limits(memory=64 << 20)
SHORT = Limits(seconds=0.5, memory=64 << 20)
Run = Callable[..., RunResult]

CALLED = {
    *("fmi3SetFloat64", "fmi3GetFloat64", "fmi3SetInt32", "fmi3GetInt32", "fmi3SetString", "fmi3GetString"),
    *("fmi3SetBinary", "fmi3GetBinary", "fmi3SetClock", "fmi3GetClock", "fmi3GetIntervalDecimal"),
    *("fmi3EnterInitializationMode", "fmi3ExitInitializationMode", "fmi3EnterEventMode", "fmi3EnterStepMode"),
    *("fmi3UpdateDiscreteStates", "fmi3DoStep", "fmi3Terminate", "fmi3GetShiftDecimal"),
    *("fmi3GetFMUState", "fmi3SerializedFMUStateSize", "fmi3SerializeFMUState", "fmi3FreeFMUState"),
}
"""The functions of FMI 3 in a run with Clocks, events, Strings, Binaries and checkpoints."""


@pytest.fixture
def run3(stricts3: Stricts3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs two FMUs with Clocks, of which `bad` fails."""
    folder = stricts3.folder
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    clocked(stricts3, "good.fmu", "go", "fire", flags=FLAGS)
    with zipfile.ZipFile(stricts3.workshop.root / "bad.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description(*CLOCKS, flags=FLAGS))
        archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", _library(folder))
    ports = "text_out:output bytes_out:output ticks_fire:output"
    parts = stricts3.component("bad", "bad.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += stricts3.component("good", "good.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    system = stricts3.ssd(parts, "bad/fire good/go", "bad/text_out good/text_in", "bad/bytes_out good/bytes_in")

    def runs(fault: str, limits: Limits = LIMITS) -> RunResult:
        monkeypatch.setenv("FAULT", fault)
        isolation = Isolation("foreign", limits)
        return simulate(system, RunOptions(out=tmp_path / "out", isolation=isolation, checkpoint_every=1.0))

    return runs


_LIBRARY: list[bytes] = []


def _library(folder: Path) -> bytes:
    if not _LIBRARY:
        _LIBRARY.append(faulting(CLOCKED, folder))
    return _LIBRARY[0]


def test_the_functions_of_fmi_3_that_a_run_calls(run3: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAULT_CALLS", str(tmp_path / "calls.txt"))
    assert run3("list", Limits(memory=64 << 20, restricted=False)).outcome == "done"
    assert {*(tmp_path / "calls.txt").read_text().split()} == CALLED


@pytest.mark.parametrize(
    ("fault", "function"),
    [
        *((fault, name) for fault in ("segv", "overflow") for name in sorted(CALLED)),
        *(("exit", name) for name in ("fmi3UpdateDiscreteStates", "fmi3GetBinary", "fmi3SerializeFMUState")),
        *(("sleep", name) for name in ("fmi3DoStep", "fmi3SetClock")),
    ],
)
def test_a_fault_in_a_function_of_fmi_3(run3: Run, fault: str, function: str) -> None:
    """Nothing stays behind, and the message names instance, function and cause."""
    before = leftovers()
    result = run3(f"{fault} {function} 1", SHORT if fault == "sleep" else LIMITS)
    assert leftovers() <= before
    assert result.outcome == "failed"
    signal = r"ended by signal 11 \(SIGSEGV\)"
    cause = {"segv": signal, "overflow": signal, "exit": "exit code 3", "sleep": r"did not return within"}[fault]
    assert re.match(rf"bad: {function} failed at t = [\d.]+ s: .*{cause}", str(result.error)), str(result.error)


def test_clocks_events_and_texts_after_a_restart(run3: Run, tmp_path: Path) -> None:
    """States are kept at every other request, also with a state that the master holds; Event Mode is replayed."""
    assert run3("none", LIMITS).outcome == "done"
    reference = pq.read_table(tmp_path / "out" / "signals.parquet")
    limits = Limits(memory=64 << 20, restarts=1, requests=2)
    for place in ("fmi3DoStep 5", "fmi3UpdateDiscreteStates 6", "fmi3GetBinary 7", "fmi3SerializeFMUState 4"):
        result = run3(f"once {place}", limits)
        assert (result.outcome, result.restarts) == ("done", 1), str(result.error)
        assert pq.read_table(tmp_path / "out" / "signals.parquet").equals(reference), place


@pytest.mark.parametrize("function", ["fmi2GetFMUstate", "fmi2SerializedFMUstateSize", "fmi2SerializeFMUstate"])
def test_a_fault_in_the_states_of_fmi_2(
    workshop: object, function: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Rows up to the checkpoint that failed are complete."""
    faulties = Faulties(workshop, _folder(tmp_path_factory))  # type: ignore[arg-type]
    options = RunOptions(out=tmp_path / "out", isolation=Isolation("foreign", LIMITS), checkpoint_every=1.0)
    text = str(simulate(faulties.system(f"segv {function} 1"), options).error)
    if function == "fmi2GetFMUstate":  # which is called before the first step, in case a step is discarded
        return
    assert text.startswith(f"bad: {function} failed at t = "), text
    assert "its process was ended by signal 11 (SIGSEGV)" in text
    assert pq.read_table(tmp_path / "out" / "signals.parquet")["time"].to_pylist() == [0.0, 0.5, 1.0]


def test_a_c_plus_plus_exception(workshop: object, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The C++ runtime says so and aborts; the message says it too."""
    faulties = Faulties(workshop, _folder(tmp_path_factory))  # type: ignore[arg-type]
    options = RunOptions(out=tmp_path / "out", isolation=Isolation("foreign", LIMITS))
    text = str(simulate(faulties.system("throw fmi2DoStep 3"), options).error)
    assert text.startswith(
        "bad: fmi2DoStep failed at t = 1 s: it has thrown a C++ exception, which nobody catches: "
        "its process was ended by signal 6 (SIGABRT)"
    )
    assert "terminate called after throwing an instance of 'int'" in text


def test_ctrl_c_ends_a_start_that_hangs(workshop: Workshop, tmp_path: Path) -> None:
    """In the process of the run, where the handler of the first one has no chance; the second one says who hangs."""
    (tmp_path / "temporary").mkdir()
    system = Faulties(workshop, tmp_path).system("sleep fmi2EnterInitializationMode 1")
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", str(system)]
    command += ["-o", str(tmp_path / "out"), "--isolate", "none", "--step-timeout", "0.1"]
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    running = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    said = "bad: fmi2EnterInitializationMode failed: bad.fmu has not returned; this call takes "
    assert any(line.startswith(f"note: {said}") for line in running.stderr)  # reads until it is said
    for _ in range(2):
        processes.signalled(running, signal.SIGINT)
        time.sleep(1.0)
    _, errors = running.communicate(timeout=300)
    assert (running.returncode, f"error: {said}" in errors) == (-signal.SIGINT, True), errors
    assert [*(tmp_path / "temporary").iterdir()] == []
