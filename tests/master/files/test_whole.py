"""Files that are written as a whole: what is left of one for which there is no room, or that cannot be opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim_master.files.whole import write_whole
from tests.master.full_disk import room_of


def test_a_file_is_written_with_the_folders_above_it(tmp_path: Path) -> None:
    write_whole(tmp_path / "a" / "b" / "c.txt", b"first, longer")
    write_whole(tmp_path / "a" / "b" / "c.txt", b"second")
    assert (tmp_path / "a" / "b" / "c.txt").read_bytes() == b"second"


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
