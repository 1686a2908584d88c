"""A started ArduPilot ends with the process that started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cosim_models.ardupilot.program import Program

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc")

_STARTING = """
import sys, time
from pathlib import Path
from cosim_models.ardupilot.program import Program
folder = Path(sys.argv[1])
print(Program(["/bin/sh", "-c", "sleep 600 & echo $!; wait"], folder, folder / "log").pid, flush=True)
while True:
    time.sleep(0.05)  # one that begins just after SIGINT has come is slept to its end
"""


def _lives(pid: int) -> bool:
    """A process that has ended remains a zombie until its parent asks for it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_it_ends_with_the_process_that_started_it(number: signal.Signals, tmp_path: Path) -> None:
    """And so do those that it has started."""
    command = [sys.executable, "-c", _STARTING, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        while not (tmp_path / "log").read_text().endswith("\n"):
            time.sleep(0.01)
        pids = [pid, int((tmp_path / "log").read_text())]
        assert all(map(_lives, pids))
        process.send_signal(number)
    while any(map(_lives, pids)):
        time.sleep(0.01)


def test_its_guard_ends_with_it(tmp_path: Path) -> None:
    before = set(_children())
    program = Program(["/bin/sleep", "600"], tmp_path, tmp_path / "log")
    assert len(set(_children()) - before) == 2 and not program.ended()
    program.end()
    assert set(_children()) <= before


def test_one_that_ends_by_itself_is_told_with_its_last_lines(tmp_path: Path) -> None:
    script = "for i in 1 2 3 4 5 6; do echo line $i; done; exit 3"
    program = Program(["/bin/sh", "-c", script], tmp_path, tmp_path / "log")
    while not program.ended():
        time.sleep(0.01)
    assert program.ended() == "code 3; its last output: line 2 / line 3 / line 4 / line 5 / line 6"
    program.end()


def test_no_program(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Program([str(tmp_path / "none")], tmp_path, tmp_path / "log")


def _children() -> list[str]:
    return [
        pid for task in Path(f"/proc/{os.getpid()}/task").iterdir() for pid in (task / "children").read_text().split()
    ]
