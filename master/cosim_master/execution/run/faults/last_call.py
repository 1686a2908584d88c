"""Keeps the function of an FMU that is being called where it can be read after the process has been killed.

    with kept(folder, scene): ...     FMUs are called; if the process ends within, `last_call` of `results` knows which

`_exit()` and SIGKILL cannot be caught. The loop notes its calls in a page of memory (`plan.page_of`), and the calls of
Python are written there, too. During a run, this page is that of a file. The loop makes the same stores as without it.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cosim_master.execution.run.faults.scene import Scene
from cosim_master.results.storage.last_call import NAME, TEXT, TEXT_BYTES, explained, text_of
from cosim_master.stepping.kernels.tables import BASE, PER_NS, RUNNING, START, K
from cosim_master.stepping.plan import page_of

__all__ = ["kept"]

_OVERWRITING = (0xEF53, 0x58465342, 0x01021994, 0x794C7630)
"""Kinds of file systems (statfs(2)): ext4, XFS, tmpfs, overlay. They have space for what replaces written data, also if
the disk is full; elsewhere, a store to the page could fail, which would end the run.
"""
_SHARED_AT_THIS_ADDRESS = mmap.MAP_SHARED | 0x10 if sys.platform == "linux" else 0


@contextmanager
def kept(folder: Path, scene: Scene) -> Iterator[None]:
    """Keeps the last call in a file of the folder, if FMUs of others are in the process of the run.

    Left out where the file cannot be written, or would not be safe; the run is the same without it.
    """
    file = folder / NAME
    libraries = [one for one in scene.libraries if one.file and not one.isolated and not one.own]
    if scene.plan is None or not libraries or not _overwrites(folder):
        yield
        return
    plan, page = scene.plan, page_of(scene.plan)
    running = (plan.shared.ctypes.data - plan.counters.ctypes.data) // 8 + RUNNING
    words = {"running": running, "k": K, "start": START, "base": BASE, "per_ns": PER_NS}
    try:
        _map(file, page, explained(len(page), words, scene.functions()))
    except OSError:
        file.unlink(missing_ok=True)
        yield
        return

    def called(instance: str, function: str) -> None:
        page[TEXT : TEXT + TEXT_BYTES] = text_of(instance, function, int(plan.counters[K]))

    for library in libraries:
        library.on_call = called
    try:
        yield
    finally:
        for library in libraries:
            library.on_call = None
        file.unlink(missing_ok=True)


def _map(file: Path, page: mmap.mmap, explanation: bytes) -> None:
    """Makes the page that of a file with the same contents, at the same address. Raises OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long)
    address = ctypes.addressof(ctypes.c_char.from_buffer(page))
    with file.open("x+b") as opened:
        opened.write(bytes(page) + explanation)
        opened.flush()
        access = mmap.PROT_READ | mmap.PROT_WRITE
        if libc.mmap(address, len(page), access, _SHARED_AT_THIS_ADDRESS, opened.fileno(), 0) != address:
            raise OSError(ctypes.get_errno(), "mmap", str(file))


def _overwrites(folder: Path) -> bool:
    """Returns whether stores to written pages of the folder's files always succeed."""
    if sys.platform != "linux":
        return False
    found = (ctypes.c_long * 32)()
    return ctypes.CDLL(None).statfs(os.fsencode(folder), found) == 0 and found[0] in _OVERWRITING
