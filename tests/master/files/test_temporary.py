"""Temporary folders, also those of processes that were killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from cosim_master.files import temporary

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="locks of files")
HOLDING = """
import sys
from cosim_master.files import temporary
(temporary.made() / "file").write_text("x")
print(temporary.made(), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def holding(place: Path) -> subprocess.Popen[str]:
    """A process with two folders."""
    started = subprocess.Popen(
        [sys.executable, "-c", HOLDING],
        env={**os.environ, "TMPDIR": str(place)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert started.stdout is not None and started.stdout.readline()
    return started


def test_folders_of_a_process_that_was_killed_are_removed_by_the_next_one(place: Path) -> None:
    """Those of a process that lives remain, and so do folders of others."""
    (place / "uav-cosim-other").mkdir()
    killed, alive = holding(place), holding(place)
    assert len([*place.iterdir()]) == 1 + 2 * 3
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    own = temporary.made()
    try:
        left = [*place.iterdir()]
        assert len(left) == 1 + 3 + 2 and own in left and place / "uav-cosim-other" in left
    finally:
        temporary.remove(own)
        alive.kill()
        alive.communicate()
    temporary.remove(temporary.made())
    assert [*place.iterdir()] == [place / "uav-cosim-other"]


def descriptors() -> int:
    """How many this process has, on Linux."""
    return len([*Path("/proc/self/fd").iterdir()]) if sys.platform == "linux" else 0


def test_nothing_remains_without_folders(place: Path) -> None:
    """Neither a lock nor its descriptor; a child that was forked leaves those of its parent alone."""
    before = descriptors()
    one, two = temporary.made(), temporary.made()
    child = os.fork()
    if child == 0:
        temporary.remove(temporary.made())
        temporary.remove_all()
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert one.is_dir() and two.is_dir() and len([*place.iterdir()]) == 3
    temporary.remove(one)
    assert len([*place.iterdir()]) == 2
    temporary.remove_all()
    assert [*place.iterdir()] == []
    assert descriptors() == before


def test_links_are_not_followed(place: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    precious = tmp_path_factory.mktemp("precious")
    (precious / "file").write_text("x")
    (place / "uav-cosim-abc.lock").symlink_to(precious / "file")
    (place / "uav-cosim-xyz.lock").write_text("")
    (place / "uav-cosim-xyz-1").symlink_to(precious)
    temporary.remove(temporary.made())
    assert (precious / "file").read_text() == "x" and (place / "uav-cosim-abc.lock").is_symlink()
