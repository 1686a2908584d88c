"""What a comparison of two states of a process says about its open files."""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from pathlib import Path

import pytest

from cosim_master.execution.run.faults.process_state import ProcessState

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs Linux")


def opened(file: Path) -> int:
    return os.open(file, os.O_RDWR | os.O_CREAT)


def changes(descriptor: int, change: Callable[[], None]) -> list[str]:
    """What has changed of a descriptor, as seen twice before."""
    before = ProcessState.present()
    assert before == ProcessState.present()
    change()
    after = ProcessState.present()
    assert before is not None and after is not None
    return [text for text in before.changes(after) if f"descriptors {descriptor} " in text]


def test_another_file_in_place_of_one_is_noticed(tmp_path: Path) -> None:
    descriptor = opened(tmp_path / "one")

    def exchange() -> None:
        os.close(descriptor)
        (tmp_path / "one").unlink()  # its inode may be used again at once
        other = opened(tmp_path / "two")
        if other != descriptor:
            os.dup2(other, descriptor)
            os.close(other)

    assert changes(descriptor, exchange) == [f"open files: descriptors {descriptor} ({tmp_path}/one) were closed"]
    os.close(descriptor)


def test_nameless_files_are_told_apart() -> None:
    """Those of the kernel have one inode for all."""
    descriptor = os.eventfd(0)

    def exchange() -> None:
        other = select.epoll()
        os.dup2(other.fileno(), descriptor)
        other.close()

    (text,) = changes(descriptor, exchange)
    assert "anon_inode:[eventfd]" in text
    os.close(descriptor)


def test_the_same_file_opened_anew_is_no_change(tmp_path: Path) -> None:
    descriptor = opened(tmp_path / "one")

    def reopen() -> None:
        os.close(descriptor)
        again = opened(tmp_path / "one")
        if again != descriptor:
            os.dup2(again, descriptor)
            os.close(again)

    assert changes(descriptor, reopen) == []
    os.close(descriptor)
