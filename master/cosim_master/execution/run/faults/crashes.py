"""Rescues the recording when an FMU crashes the process by abort() or an invalid memory access.

    with reported(slaves, now, rescue): ...    steps; on a crash, rescue(error) is called, and the process then ends

The signal arrives in the FMU's own code, in the thread that stepped it. A Python function may run there, but the run
cannot continue after it. The function identifies the FMU from the stack, reports it, and completes the recording; then
the signal ends the process as usual. This is best effort: the crash may have damaged the heap, so the function has a
time limit of a few seconds.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.slave import Slave

__all__ = ["FRAMES", "culprit", "reported", "symbols"]

_SIGNALS = ("SIGABRT", "SIGSEGV", "SIGFPE", "SIGILL", "SIGBUS")
_SECONDS = 10
FRAMES = 512
"""Most frames of a stack that are examined."""
_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int)


class _Symbol(ctypes.Structure):
    """Dl_info of dladdr."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("base", ctypes.c_void_p),
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
    )


@contextmanager
def reported(slaves: Sequence[Slave], now: Callable[[], float], rescue: Callable[[FmuError], None]) -> Iterator[None]:
    """Reports crashes of FMUs in the main thread and completes the files that they would leave incomplete.

    Args:
        slaves: the instances, examined when one crashes.
        now: returns the time that all instances have reached, s.
        rescue: called with the error before the process ends.
    """
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():
        yield
        return
    libc = ctypes.CDLL(None)
    libc.signal.restype, libc.signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
    numbers = [int(getattr(signal, name)) for name in _SIGNALS]

    def crashed(number: int) -> None:
        for other in numbers:
            libc.signal(other, None)  # SIG_DFL: a second crash, in this handler, ends the process
        libc.alarm(_SECONDS)
        with suppress(BaseException):
            error = _error(libc, slaves, number, now())
            os.write(2, f"error: {error}\n".encode())
            rescue(error)
        os.kill(os.getpid(), number)

    handler = _HANDLER(crashed)
    libc.backtrace((ctypes.c_void_p * 2)(), 2)  # imports its modules now, not in the handler
    before = {number: libc.signal(number, ctypes.cast(handler, ctypes.c_void_p)) for number in numbers}
    for number, was in before.items():
        if was:  # another handler, such as faulthandler's, remains
            libc.signal(number, was)
    try:
        yield
    finally:
        own = ctypes.cast(handler, ctypes.c_void_p).value
        for number, was in before.items():
            if (now_there := libc.signal(number, was)) != own:
                libc.signal(number, now_there)  # an FMU has since set its own handler


def _error(libc: Any, slaves: Sequence[Slave], number: int, time: float) -> FmuError:
    """Returns the error that names the crashed instance, found by the libraries on the stack, and the FMI function."""
    frames = (ctypes.c_void_p * FRAMES)()
    library, who, function = culprit(frames[: libc.backtrace(frames, FRAMES)], slaves)
    what = "it crashed" if library is None else f"{library.fmu.path.name} crashed"
    text = f"{what} ({signal.Signals(number).name}) and takes the process with it"
    return FmuError(who, function or "a function of the FMU", text, time)


def symbols(frames: Sequence[int | None]) -> Iterator[tuple[str, str]]:
    """Yields the file and the function of each return address that belongs to a library."""
    libc = ctypes.CDLL(None)
    for at in frames:
        symbol = _Symbol()
        # A return address may lie after the end of the function that called abort() as its last instruction.
        if libc.dladdr(ctypes.c_void_p((at or 1) - 1), ctypes.byref(symbol)) and symbol.file:
            yield os.path.realpath(os.fsdecode(symbol.file)), (symbol.name or b"").decode("ascii", "replace")


def culprit(frames: Sequence[int | None], slaves: Sequence[Slave]) -> tuple[Library | None, str, str]:
    """Returns the innermost FMU on a stack, the name of its instance, and the FMI function, as far as they are known.

    Args:
        frames: return addresses, the innermost first.
        slaves: the instances.
    """
    files = {os.path.realpath(one.library.file): one.library for one in slaves if one.library.file}
    library, function = None, ""
    for file, name in symbols(frames):
        found = files.get(file)
        if library is None:
            library = found
        if found is not None and found is library and "fmi" in name:
            function = name
            break
    names = [one.name for one in slaves if library is None or one.library is library]
    who = names[0] if len(names) == 1 else f"one of {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}"
    return library, who, function
