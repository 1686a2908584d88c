"""Large pages for the memory of many instances.

With thousands of drones, a step of an instance reads memory in pages that the processor has not used for long. It has
to look up where they are, in tables that are not cached either. With pages of 2 MiB instead of 4 KiB, these tables are
small enough. The data stays the same, and a system without large pages runs as before.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

__all__ = ["heap", "use_large_pages"]

_LARGE = 2 << 20
"""Size of a large page, bytes."""
_COLLAPSE = 25
"""MADV_COLLAPSE, from Linux 6.1 on: what is in small pages is moved into large ones at once."""


def heap() -> tuple[int, int]:
    """Returns the first address of the heap of this process, and that after it; equal if the system does not tell.

    The system lists parts of the heap that it treats differently one after the other.
    """
    ends: list[int] = []
    if sys.platform == "linux":
        for line in Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.endswith("[heap]"):
                ends += [int(end, 16) for end in line.split()[0].split("-")]
    return (min(ends), max(ends)) if ends else (0, 0)


def use_large_pages(first: int, last: int) -> bool:
    """Moves the memory between two addresses into large pages; returns whether all of it is in large pages now.

    The parts of large pages at both ends stay where they are.
    """
    begin, end = -(-first // _LARGE) * _LARGE, last // _LARGE * _LARGE
    if end <= begin:
        return False
    advise = ctypes.CDLL(None).madvise
    advise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    return bool(advise(begin, end - begin, _COLLAPSE) == 0)
