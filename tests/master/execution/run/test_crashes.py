"""FMUs in the process of the run that crash it or end it: the message names instance, function and time.

Two instances share a file, so that the stack alone does not tell which of them it is. Each run is a process of its own.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cosim_master.results.reading.read import signals
from tests.master import processes
from tests.master.conftest import Workshop
from tests.master.fmi.test_isolation import Faulties, _folder
from tests.master.forks import Forks

Run = Callable[..., subprocess.CompletedProcess[str]]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="crashes are caught on Linux")
NAMES = ("bad1", "bad2")
CAUSES = {
    "segv": "crashed (SIGSEGV) and takes the process with it",
    "overflow": "crashed (SIGSEGV) and takes the process with it",
    "abort": "crashed (SIGABRT) and takes the process with it",
    "divide": "crashed (SIGFPE) and takes the process with it",
    "exit": "has called exit(0), which ends the process of the run",
    "exit3": "has called exit(3), which ends the process of the run",
}
FUNCTIONS = {
    "fmi2Instantiate": None,
    "fmi2SetupExperiment": None,
    "fmi2EnterInitializationMode": None,
    "fmi2ExitInitializationMode": None,
    "fmi2Terminate": 2.0,
    "fmi2FreeInstance": 2.0,
}
"""The functions that Python calls, with the time of the error."""


@pytest.fixture
def run(workshop: Workshop, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, forks: Forks) -> Run:
    """Runs two instances of a faulty file; the variable of instance `bad1` is that of the file."""
    faulties = Faulties(workshop, _folder(tmp_path_factory))
    (tmp_path / "temporary").mkdir()
    environment = {key: value for key, value in os.environ.items() if key != "XDG_CACHE_HOME"}
    environment |= {"TMPDIR": str(tmp_path / "temporary"), "FAULTY_NAME": str(tmp_path / "name")}

    def runs(fault: str, *options: str) -> subprocess.CompletedProcess[str]:
        system = faulties.system(fault, same_file=True, names=NAMES)
        return forks.run(["run", str(system), "-o", "out", "--isolate", "none", *options], tmp_path, environment)

    return runs


@pytest.mark.parametrize("fault", CAUSES)
def test_a_step_that_ends_the_process(run: Run, tmp_path: Path, fault: str) -> None:
    """Each instance counts its own calls, and the first one is the first to fail."""
    done = run(f"{fault} fmi2DoStep 3")
    assert done.returncode == 1
    text = f"bad1: fmi2DoStep failed at t = 1 s: bad.fmu {CAUSES[fault]}"
    assert f"error: {text}" in done.stderr
    assert signals(tmp_path / "out")["time"].to_pylist() == [0.0, 0.5, 1.0]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["simulated_s"]) == ("failed", 1.0)
    assert manifest["error"].startswith(text)
    assert not list((tmp_path / "temporary").iterdir())


def test_exit_after_the_journal_was_written(run: Run, tmp_path: Path) -> None:
    """Whatever was used for the first time meanwhile may have registered a handler of exit() that precedes ours."""
    done = run("exit fmi2DoStep 4", "--pace", "1")
    assert (done.returncode, CAUSES["exit"] in done.stderr) == (1, True)
    assert signals(tmp_path / "out")["time"].to_pylist() == [0.0, 0.5, 1.0, 1.5]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "failed"


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2GetReal"])
@pytest.mark.parametrize("fault", ["segv", "overflow", "exit"])
def test_calls_of_the_loop(run: Run, tmp_path: Path, fault: str, function: str) -> None:
    """The FMU itself says which instance it is: not the first one, if another's output is read more often."""
    done = run(f"{fault} {function} 4")
    assert done.returncode == 1
    assert f"error: {(tmp_path / 'name').read_text()}: {function} failed at t = " in done.stderr
    assert CAUSES[fault] in done.stderr


@pytest.mark.parametrize("fault", ["segv", "overflow", "exit"])
@pytest.mark.parametrize("function", FUNCTIONS)
def test_calls_of_python(run: Run, tmp_path: Path, fault: str, function: str) -> None:
    done = run(f"{fault} {function} 1")
    assert done.returncode == 1
    time = "" if FUNCTIONS[function] is None else f" at t = {FUNCTIONS[function]:g} s"
    assert f"error: bad1: {function} failed{time}: bad.fmu {CAUSES[fault]}" in done.stderr
    if FUNCTIONS[function] is not None:  # the recording was complete
        manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
        assert (manifest["outcome"], manifest["simulated_s"]) == ("done", 2.0)
        assert signals(tmp_path / "out")["time"].to_pylist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert not list((tmp_path / "temporary").iterdir())


def test_a_hang_names_the_instance(
    workshop: Workshop, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The stack tells the file only; the watchdog tells the instance, too."""
    system = Faulties(workshop, _folder(tmp_path_factory)).system("sleep fmi2DoStep 3", same_file=True, names=NAMES)
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", str(system)]
    command += ["-o", "out", "--isolate", "none", "--step-timeout", "0.5"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        said = next(line for line in process.stderr if "has not returned" in line)
        for number in (signal.SIGINT, signal.SIGTERM):  # of one kind, they would need a pause
            processes.signalled(process, number)
        process.wait(300)
    assert said.startswith("note: bad1: fmi2DoStep failed at t = 1 s: bad.fmu has not returned")
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["error"].startswith("bad1: fmi2DoStep failed at t = 1 s: bad.fmu has not returned")


def test_exit_outside_of_a_run_is_left_alone(run: Run, tmp_path: Path) -> None:
    """The handler stays registered after a run, and does nothing then."""
    done = run("none none 0")
    assert done.returncode == 0, done.stderr
    script = "from cosim_master import simulate; import ctypes; simulate('system.ssd'); ctypes.CDLL(None).exit(7)"
    after = subprocess.run(
        [sys.executable, "-c", script], cwd=workshop_root(tmp_path), capture_output=True, text=True, check=False
    )
    assert (after.returncode, after.stderr) == (7, "")


def workshop_root(tmp_path: Path) -> Path:
    """The folder of system.ssd."""
    return next(tmp_path.rglob("system.ssd")).parent
