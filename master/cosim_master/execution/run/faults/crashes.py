"""Says which FMU crashes the process or ends it by exit(), and completes the recording.

    with reported(scene): ...     FMUs are called; on a crash, scene.rescue(error) is called, and the process then ends

A signal arrives in the FMU's own code, in the thread that called it; it is caught on a stack of its own (`crash.c` of
`fmi.isolation`), so that the overflow of a stack is caught, too. A Python function may run there, but the run cannot
continue after it. This is best effort: the crash may have damaged the heap, so the function has a time limit of a
minute. The exit code is 1. `_exit()` and SIGKILL cannot be caught; the journal then has the rows.

This needs Linux, and is left out where the C part is not compiled.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from cosim_master.execution.run.faults.scene import Scene
from cosim_master.files.temporary import remove_all
from cosim_master.fmi.isolation.building import LIBRARY, CannotIsolate, binaries

__all__ = ["reported"]

_SECONDS = 60
_TOLD = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_int)


@contextmanager
def reported(scene: Scene) -> Iterator[None]:
    """Reports crashes of FMUs in the main thread and completes the files that they would leave incomplete."""
    functions = _functions()
    if functions is None:
        yield
        return

    def told(number: int, code: int, frames: int, n: int) -> None:
        with suppress(BaseException):
            _report(scene, number, code, (ctypes.c_void_p * n).from_address(frames)[:] if n else [])

    handler = _TOLD(told)
    functions.crash_catch.argtypes = (_TOLD, ctypes.c_uint)
    functions.crash_catch(handler, _SECONDS)
    functions.crash_catch_exit()
    scene.on_recording = functions.crash_catch_exit
    try:
        yield
    finally:
        functions.crash_release()


def _functions() -> Any:
    """Returns the C part; None if crashes are not caught here."""
    if sys.platform != "linux" or threading.current_thread() is not threading.main_thread():
        return None
    try:
        return ctypes.CDLL(str(binaries() / LIBRARY))
    except (CannotIsolate, OSError):
        return None


def _report(scene: Scene, number: int, code: int, frames: list[int | None]) -> None:
    """Says what has happened, removes the temporary folders of this process, and completes the recording."""
    if number:
        cause = f"crashed ({signal.Signals(number).name}) and takes the process with it"
    else:
        cause = f"has called exit({code}), which ends the process of the run"
    error = scene.error(frames, lambda file: f"{file} {cause}")
    if error is None:
        os.write(2, f"error: the process of the run {cause if number else f'was ended by exit({code})'}\n".encode())
    else:
        os.write(2, f"error: {error}\n".encode())
    remove_all()
    if error is not None:
        scene.rescue(error)
