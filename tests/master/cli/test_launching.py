"""Processes of a run in parts, with a stand-in for mpirun: signals that are lost or sent twice, and files."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

LIMIT = 120.0

MPIRUN = f"""#!{sys.executable}
import json, os, signal, subprocess, sys, time
from pathlib import Path
if sys.argv[1:] == ["--version"]:
    print("mpirun (Open MPI) 5.0")
    sys.exit()
folder, lost = Path(os.environ["PLACE"]), int(os.environ["LOST"])
heard = 0
def hear(*_):
    global heard
    heard += 1
    with (folder / "heard").open("a") as file:
        file.write(".")
    for _ in range(int(os.environ["COPIES"]) if heard > lost else 0):
        part.send_signal(signal.SIGUSR1)
        time.sleep(0.2)
signal.signal(signal.SIGUSR1, hear)
(folder / "environment").write_text(json.dumps(dict(os.environ)))
part = subprocess.Popen([sys.executable, "-c", sys.argv[-1]], process_group=0)  # as mpirun does
sys.exit(part.wait())
"""

PART = """
import os, signal, time
from pathlib import Path
from cosim_master.cli.terminal.launching import _asked_to_end, exit_code_told
signal.signal(signal.SIGUSR1, _asked_to_end)
pressed = 0
def press(*_):
    global pressed
    pressed += 1
signal.signal(signal.SIGINT, press)
folder = Path(os.environ["PLACE"])
(folder / "ready").touch()
end = time.monotonic() + 60
while not pressed and time.monotonic() < end:
    time.sleep(0.01)
time.sleep(1.5)  # further signals would arrive now
(folder / "pressed").write_text(str(pressed))
with exit_code_told():
    raise SystemExit(130)
"""

COMMAND = """
import os, shutil, sys
from cosim_master.cli.terminal import launching
shutil.which = lambda *_, **__: os.path.join(os.environ["PLACE"], "mpirun")
launching._COMMAND = ()
sys.exit(launching.start_parts(2, [os.environ.get("PART", "")]))
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a stand-in for mpirun, in which it and a part tell of themselves."""
    launcher = tmp_path / "mpirun"
    launcher.write_text(MPIRUN)
    launcher.chmod(0o755)
    for name, value in {"PLACE": str(tmp_path), "PART": PART, "LOST": "0", "COPIES": "1"}.items():
        monkeypatch.setenv(name, value)
    for name in ("PRTE_MCA_prte_tmpdir_base", "OMPI_MCA_btl"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def environment(place: Path) -> dict[str, str]:
    """The environment of mpirun."""
    found: dict[str, str] = json.loads((place / "environment").read_text())
    return found


def appears(file: Path, process: subprocess.Popen[Any]) -> None:
    end = time.monotonic() + LIMIT
    while not file.exists():
        assert process.poll() is None and time.monotonic() < end, f"{file} is missing"
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("number", "lost", "copies"), [(signal.SIGINT, 0, 1), (signal.SIGINT, 0, 3), (signal.SIGTERM, 2, 1)]
)
def test_ctrl_c_arrives_once_whatever_the_launcher_loses_or_repeats(
    place: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, lost: int, copies: int
) -> None:
    monkeypatch.setenv("LOST", str(lost))
    monkeypatch.setenv("COPIES", str(copies))
    process = subprocess.Popen([sys.executable, "-c", COMMAND])
    try:
        appears(place / "ready", process)
        process.send_signal(number)
        assert process.wait(timeout=LIMIT) == 130
    finally:
        process.kill()
        process.wait()
    assert (place / "pressed").read_text() == "1"
    assert len((place / "heard").read_text()) >= lost + 1
    assert not Path(environment(place)["PRTE_MCA_prte_tmpdir_base"]).exists()


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes do not show their environments")
def test_parts_end_when_ctrl_c_ends_their_launcher_alone(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As mpirun does if the signal comes between the start of its processes and that of its own handler."""
    waits = """
import os, time
from pathlib import Path
place = Path(os.environ["PLACE"])
(place / "part").write_text(str(os.getpid()))
(place / "part").rename(place / "ready")
time.sleep(100)
"""
    monkeypatch.setenv("PART", waits)
    (place / "mpirun").write_text(MPIRUN.replace("signal.signal(signal.SIGUSR1, hear)", ""))
    command = [sys.executable, "-c", COMMAND]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        appears(place / "ready", process)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=LIMIT)  # a part that is left keeps this pipe open
    finally:
        process.kill()
        process.wait()
    assert (process.returncode, said) == (130, "error: interrupted\n")
    end = time.monotonic() + 10.0
    while (alive := _runs(int((place / "ready").read_text()))) and time.monotonic() < end:
        time.sleep(0.02)
    assert not alive


def _runs(process: int) -> bool:
    """Whether it exists and is no zombie, which nobody may have waited for."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_sighup_stays_ignored_under_nohup(place: Path) -> None:
    process = subprocess.Popen(["nohup", sys.executable, "-c", COMMAND], stdin=subprocess.DEVNULL)
    try:
        appears(place / "ready", process)
        process.send_signal(signal.SIGHUP)
        time.sleep(0.5)
        assert not (place / "heard").exists()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=LIMIT) == 130
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("own", [{}, {"OMPI_MCA_btl": "self,tcp", "PRTE_MCA_prte_tmpdir_base": "/somewhere"}])
def test_open_mpi_looks_for_no_network_unless_the_user_has_it_do_so(
    place: Path, monkeypatch: pytest.MonkeyPatch, own: dict[str, str]
) -> None:
    """Looking takes a second."""
    for name, value in {"PART": "raise SystemExit", **own}.items():
        monkeypatch.setenv(name, value)
    done = subprocess.run([sys.executable, "-c", COMMAND], capture_output=True, text=True, check=False, timeout=LIMIT)
    assert done.returncode == 1
    assert "part 0 has ended without a result (mpirun with exit code 0)" in done.stderr
    told = environment(place)
    assert told["OMPI_MCA_btl"] == own.get("OMPI_MCA_btl", "^ofi")
    assert own.items() <= told.items()
