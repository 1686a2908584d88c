"""Memory in large pages: as the system itself tells it, and with the same contents."""

from __future__ import annotations

import ctypes
import mmap
import re
import sys
from pathlib import Path

import pytest

from cosim_master.execution.startup.pages import heap, use_large_pages

MIB = 1 << 20


def in_large_pages(address: int) -> int:
    """The bytes in large pages of the mapping that holds an address: AnonHugePages of /proc/self/smaps."""
    here = False
    for line in Path("/proc/self/smaps").read_text(encoding="utf-8", errors="replace").splitlines():
        if found := re.match(r"([0-9a-f]+)-([0-9a-f]+) ", line):
            here = int(found[1], 16) <= address < int(found[2], 16)
        elif here and line.startswith("AnonHugePages:"):
            return int(line.split()[1]) * 1024
    raise AssertionError(f"no mapping holds {address:#x}")


@pytest.mark.skipif(sys.platform != "linux", reason="large pages are asked for on Linux")
def test_memory_moves_into_large_pages_and_keeps_its_contents() -> None:
    with mmap.mmap(-1, 16 * MIB, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as memory:
        memory.madvise(mmap.MADV_NOHUGEPAGE)
        text = bytes(range(256)) * (16 * MIB // 256)
        memory[:] = text
        memory.madvise(mmap.MADV_HUGEPAGE)
        anchor = ctypes.c_char.from_buffer(memory)
        first = ctypes.addressof(anchor)
        before = in_large_pages(first)
        if not use_large_pages(first, first + 16 * MIB):
            pytest.skip("this system has no large pages, or moves nothing into them on request")
        assert before == 0
        assert in_large_pages(first) >= 14 * MIB
        assert memory[:] == text
        del anchor


def test_less_than_a_large_page_stays_where_it_is() -> None:
    assert not use_large_pages(4096, 2 * MIB)
    assert not use_large_pages(0, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="the heap is found on Linux")
def test_the_heap_ends_where_the_system_says() -> None:
    libc = ctypes.CDLL(None)
    libc.sbrk.restype = ctypes.c_void_p
    first, last = heap()
    assert first < last == libc.sbrk(ctypes.c_ssize_t(0))
