"""Requests to end a run: Ctrl-C, SIGTERM and SIGHUP, of which a second one ends a process that runs no Python code.

    handled(number, handler)        from then on; to be called again in `handler`, for the next request

While an FMU does not return, Python notes a signal, and its handler does not run. A function in C (`signals.c` of
`fmi.isolation`) then lets the second request end the process. It knows that signals of one kind within `TOGETHER` are
one request: timeout(1) sends each to the process and, microseconds later, to its group. Where it is not compiled, the
operating system removes the handler at the first signal, and such a pair ends the process.
"""

from __future__ import annotations

import ctypes
import signal
import sys
from collections.abc import Callable
from functools import cache
from types import FrameType

from cosim_master.fmi.isolation.building import LIBRARY, CannotIsolate, binaries

__all__ = ["TOGETHER", "behind", "expected", "handled"]

TOGETHER = 0.1
"""Wall-clock time within which signals of one kind are one request, s; REQUEST_NS of signals.c."""


def handled(number: int, handler: Callable[[int, FrameType | None], None]) -> None:
    """Sets the handler of the next request, after which another one ends the process while Python code cannot run."""
    signal.signal(number, handler)
    if expected(number) or sys.platform != "linux":
        return
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "sysv_signal"):
        return
    for function in (libc.signal, libc.sysv_signal):
        function.restype, function.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
    libc.sysv_signal(number, libc.signal(number, None))  # with the values set by Python


def expected(number: int) -> bool:
    """Lets the next request go to the handler that is set; False: there is none, or the function is not compiled."""
    functions = _functions()
    return functions is not None and functions.signals_expect(int(number)) == 0


def behind(number: int, address: int | None) -> int | None:
    """Returns the handler that is called for a signal whose handler the system has at `address`."""
    functions = _functions()
    found: int | None = address if functions is None else functions.signals_behind(number, address)
    return found


@cache
def _functions() -> ctypes.CDLL | None:
    try:
        functions = ctypes.CDLL(str(binaries() / LIBRARY))
    except (CannotIsolate, OSError):
        return None
    functions.signals_behind.restype, functions.signals_behind.argtypes = (
        ctypes.c_void_p,
        (ctypes.c_int, ctypes.c_void_p),
    )
    return functions
