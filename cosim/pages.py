"""Large pages of memory, on Linux with glibc; elsewhere, nothing here has an effect.

A processor keeps the places of a few thousand pages at hand. Large swarms and compilers have memory in a million pages
of 4 KiB, whose places are then mostly in tables that are in no cache. Pages of 2 MiB are few.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["large_pages", "variables"]

_PAGE = 2 << 20
_WORTH_IT = 32 << 20

# mallopt's parameters (malloc.h), and the value that glibc begins with.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _MMAP_MAX, _MMAPS = -1, -3, -4, 65536
# The largest blocks that glibc makes parts of the heap: its threshold grows up to this, unless one is set.
_MMAP_FROM = 32 << 20


@contextmanager
def large_pages(size: int) -> Iterator[None]:
    """Has the next memory that malloc hands out, within and in the main thread, lie in pages of 2 MiB.

    The heap grows by memory that nobody has touched, which the kernel is advised to have in large pages (``madvise``);
    what is left of it at the end is returned. Where this cannot be done, memory comes in small pages, as in other
    threads, which have heaps of their own.

    Args:
        size: of that memory, bytes. What is not asked for is never touched; less than 32 MiB is not worth it.
    """
    if size < _WORTH_IT or not _has_glibc():
        yield
        return
    size = -(-size // _PAGE) * _PAGE
    libc = ctypes.CDLL(None)
    libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
    libc.free.restype, libc.free.argtypes = None, [ctypes.c_void_p]
    libc.madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    libc.mallopt(_MMAP_THRESHOLD, _MMAP_FROM)
    libc.mallopt(_TRIM_THRESHOLD, -1)  # what is free at the heap's end stays there
    try:
        if block := _in_the_heap(libc, size + _PAGE):
            libc.madvise(-(-block // _PAGE) * _PAGE, size, mmap.MADV_HUGEPAGE)
            libc.free(block)
        yield
    finally:
        libc.mallopt(_TRIM_THRESHOLD, 2 * _MMAP_FROM)
        libc.free(_in_the_heap(libc, _MMAP_FROM))  # looks what is free at the heap's end, and returns it


def _in_the_heap(libc: ctypes.CDLL, size: int) -> int | None:
    """Returns the address of a new block that is a part of the heap, whatever its size; None if there is no memory."""
    libc.mallopt(_MMAP_MAX, 0)
    block: int | None = libc.malloc(size)
    libc.mallopt(_MMAP_MAX, _MMAPS)
    return block


def variables() -> dict[str, str]:
    """Returns environment variables for a new Python process whose memory is to lie in large pages from its start.

    Python's own allocator, which asks for memory in small pieces, gives way to malloc. Where the user has set either of
    the two, there are none.
    """
    wanted = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1", "PYTHONMALLOC": "malloc"}
    return wanted if _has_glibc() and not wanted.keys() & os.environ.keys() else {}


def _has_glibc() -> bool:
    try:
        return bool(os.confstr("CS_GNU_LIBC_VERSION"))
    except (AttributeError, ValueError, OSError):  # Windows; another C library
        return False
