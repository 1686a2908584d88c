"""Code kept in files: written by several threads and processes, changed by others."""

from __future__ import annotations

import logging
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cosim.kept import made_once, read_kept, write_kept
from cosim.kernel import forget_unused


def test_threads_may_write_the_same_code_at_the_same_time(tmp_path: Path) -> None:
    """Two models with the same kernels, which are built side by side, write the same file."""
    file, code = tmp_path / "objects" / "one", bytes(range(256)) * 4096
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as pool:
            for _ in pool.map(lambda _: write_kept(file, code), range(400)):
                assert read_kept(file) == code
    finally:
        sys.setswitchinterval(interval)
    assert [one.name for one in file.parent.iterdir()] == ["one"]


def test_changed_code_is_not_loaded(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "one"
    write_kept(file, b"code")
    assert read_kept(file) == b"code"
    file.write_bytes(file.read_bytes()[:-1] + b"E")
    with caplog.at_level(logging.WARNING):
        assert read_kept(file) is None
    assert "has been changed since it was made" in caplog.text
    assert read_kept(tmp_path / "another") is None


def test_unused_code_is_forgotten_while_others_make_code_in_the_same_folder(tmp_path: Path) -> None:
    """Locks of others may go between the listing of the folder and the look at their age."""
    write_kept(tmp_path / "new.o", b"code")
    for old in (tmp_path / "old.o", tmp_path / "folder"):
        write_kept(old / "part" if old.name == "folder" else old, b"code")
        os.utime(old, (time.time() - 15 * 86400,) * 2)
    (tmp_path / "gone.lock").symlink_to(tmp_path / "nothing")  # listed, but cannot be looked at: as if just removed

    def make(number: int) -> None:
        with made_once(tmp_path / f"{number}.o"):
            forget_unused(tmp_path)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(make, range(400)))
    assert sorted(one.name for one in tmp_path.iterdir()) == ["gone.lock", "new.o"]
