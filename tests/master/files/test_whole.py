"""Files that are written as a whole: what is left of one for which there is no room, or that cannot be opened."""

from __future__ import annotations

import os
import stat
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from cosim_master.files.whole import replacing, write_whole
from tests.master.full_disk import room_of


def test_a_file_is_written_with_the_folders_above_it(tmp_path: Path) -> None:
    write_whole(tmp_path / "a" / "b" / "c.txt", b"first, longer")
    write_whole(tmp_path / "a" / "b" / "c.txt", b"second")
    assert (tmp_path / "a" / "b" / "c.txt").read_bytes() == b"second"


def test_a_file_without_room_leaves_the_one_before(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"before")
    with room_of(100), pytest.raises(OSError, match="File too large"):
        write_whole(tmp_path / "a.txt", bytes(101))
    assert (tmp_path / "a.txt").read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [tmp_path / "a.txt"]


def test_a_new_file_has_the_mode_of_the_one_before_and_others_that_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "any.txt").write_bytes(b"")
    write_whole(tmp_path / "a.txt", b"first")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "any.txt").stat().st_mode
    (tmp_path / "a.txt").chmod(0o640)
    write_whole(tmp_path / "a.txt", b"second")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_the_target_of_a_link_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "a.txt").symlink_to("there/b.txt")
    for text in (b"first", b"second"):
        write_whole(tmp_path / "a.txt", text)
        assert (tmp_path / "a.txt").is_symlink()
        assert (tmp_path / "there" / "b.txt").read_bytes() == text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with ThreadPoolExecutor() as pool:
        read = pool.submit((tmp_path / "pipe").read_bytes)
        write_whole(tmp_path / "pipe", b"through")
        assert read.result() == b"through"


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="descriptors as files")
def test_a_file_that_is_open_as_a_descriptor_is_written_to(tmp_path: Path) -> None:
    """As `-o /dev/stdout >> a.txt`: another file of this name would not be the one that the shell has opened."""
    (tmp_path / "a.txt").write_bytes(b"before ")
    with (tmp_path / "a.txt").open("ab") as opened:
        number = (tmp_path / "a.txt").stat().st_ino
        write_whole(Path(f"/dev/fd/{opened.fileno()}"), b"after")
    assert (tmp_path / "a.txt").stat().st_ino == number
    assert (tmp_path / "a.txt").read_bytes() == b"after"


def test_what_fails_meanwhile_leaves_the_file_before(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "a.txt") as part:
        part.write_bytes(b"half")
        raise KeyboardInterrupt
    assert (tmp_path / "a.txt").read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [tmp_path / "a.txt"]


@pytest.mark.parametrize("size", [0, 100, 20000])
def test_no_part_is_left_of_a_file_without_room(tmp_path: Path, size: int) -> None:
    with room_of(size), pytest.raises(OSError, match="File too large"):
        write_whole(tmp_path / "a.txt", bytes(20001))
    assert list(tmp_path.iterdir()) == []
    with room_of(20001):
        write_whole(tmp_path / "a.txt", bytes(20001))
    assert (tmp_path / "a.txt").stat().st_size == 20001


def test_what_cannot_be_opened_or_is_no_file_stays(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path / "folder", b"x")
    assert (tmp_path / "folder").is_dir()
    if Path("/dev/full").exists():
        (tmp_path / "full").symlink_to("/dev/full")
        with pytest.raises(OSError, match="No space left on device"):
            write_whole(tmp_path / "full", b"x")
        assert (tmp_path / "full").is_symlink()


def test_a_full_disk_of_tests_keeps_no_beginning_of_bytecode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise, nobody could import the module again."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "long_module.py").write_text(f"TEXT = {'x' * 1000!r}\n")
    with room_of(100):
        assert len(import_module("long_module").TEXT) == 1000
    assert not sys.dont_write_bytecode
    assert [file.name for file in tmp_path.iterdir()] == ["long_module.py"]
    del sys.modules["long_module"]
