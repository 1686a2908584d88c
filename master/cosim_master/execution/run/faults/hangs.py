"""Names an FMU of this process that does not return, and completes the recording if the user then ends the process.

    with reported_hangs(scene, seconds): ...   steps; a second signal during a hang calls scene.rescue(error)

While an FMU does not return, the main thread runs no Python code, and no handler of a signal. A watchdog thread notices
that the simulation time stands still, and identifies FMU and function from the main thread's stack. It learns of
signals by Python's wake-up descriptor. After the second one, it completes the recording and lets the signal end the
process.

This needs a function in C (`stack.c` of `fmi.isolation`), and is left out where that is not compiled.
"""

from __future__ import annotations

import ctypes
import logging
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from cosim_master.diagnostics.errors import FmuError
from cosim_master.execution.run.faults.scene import FRAMES, Scene, symbols
from cosim_master.fmi.isolation.building import LIBRARY, CannotIsolate, binaries

__all__ = ["reported_hangs"]

log = logging.getLogger(__name__)

_TICK = 0.25
_GRACE = 0.5
"""Wall-clock time in which the main thread reacts to a second signal if it can, s."""


@contextmanager
def reported_hangs(scene: Scene, seconds: float) -> Iterator[None]:
    """Watches the main thread while it steps FMUs that this project has not built, or that are isolated.

    Args:
        scene: the instances; its `rescue` completes the recording before the process ends.
        seconds: wall-clock time after which a step is reported; 0: never.
    """
    here = [one for one in scene.slaves if one.library.file and (one.library.isolated or not one.library.own)]
    main = threading.current_thread() is threading.main_thread()
    if not here or sys.platform != "linux" or not main:
        yield
        return
    try:
        functions = ctypes.CDLL(str(binaries() / LIBRARY))
    except (CannotIsolate, OSError):
        yield
        return
    reading, writing = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    if before != -1:  # of an event loop
        signal.set_wakeup_fd(before)
        os.close(reading)
        os.close(writing)
        yield
        return
    watchdog = _Watchdog(functions, scene, seconds, reading)
    watchdog.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        watchdog.stop(writing)
        os.close(writing)
        os.close(reading)


class _Watchdog(threading.Thread):
    def __init__(self, functions: ctypes.CDLL, scene: Scene, seconds: float, signals: int) -> None:
        super().__init__(name="uav-cosim-watchdog", daemon=True)
        self._functions, self._scene, self._now = functions, scene, scene.now
        self._seconds, self._signals = seconds, signals
        self._main = threading.main_thread().ident or 0
        self._number = signal.SIGRTMIN + 7
        self._ended = threading.Event()
        self._proxy = os.path.realpath(functions._name)
        self._libc = ctypes.CDLL(None)
        for name in ("signal", "sysv_signal"):
            function = getattr(self._libc, name)
            function.restype, function.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
        functions.stack_of.argtypes = (ctypes.c_ulong, ctypes.c_int, ctypes.c_void_p, ctypes.c_int)
        functions.stack_prepare(int(self._number))
        self._handlers: dict[int, int | None] = {}
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._handlers[number] = self._libc.signal(number, None)
            self._libc.sysv_signal(number, self._handlers[number])

    def stop(self, writing: int) -> None:
        """Ends the thread at once: a byte at the end `writing` of its pipe, which is no signal's number, wakes it."""
        self._ended.set()
        with suppress(BlockingIOError):  # the pipe is full of signals, which wake it too
            os.write(writing, b"\0")
        self.join()

    def run(self) -> None:
        time_reached, since, told, received = self._now(), time.monotonic(), 0.0, 0
        while not self._ended.is_set():
            ready, _, _ = select.select([self._signals], [], [], _TICK)
            if ready:
                with suppress(BlockingIOError):
                    for number in os.read(self._signals, 64):
                        if number in self._handlers:
                            received += 1
                            # The signal has removed its handler: without it, the next one ends the process.
                            self._libc.sysv_signal(number, self._handlers[number])
                            if received > 1 and not self._ended.wait(_GRACE):
                                self._end(number, time.monotonic() - since)
            if (now := self._now()) != time_reached:
                time_reached, since, told = now, time.monotonic(), 0.0
            waited = time.monotonic() - since
            if self._seconds and waited > self._seconds + told and (found := self._error(waited)) is not None:
                told = waited
                log.warning("note: %s; a second Ctrl-C ends the process with its recording complete", found)

    def _stack(self) -> Sequence[int | None]:
        frames = (ctypes.c_void_p * FRAMES)()
        return frames[: self._functions.stack_of(self._main, int(self._number), frames, FRAMES)]

    def _error(self, waited: float) -> FmuError | None:
        """Returns the error of the FMU of this process in which the main thread is; None if it is in none."""
        frames = self._stack()
        if not self._scene.inside(frames):
            return None
        text = f"has not returned; this step takes {waited:.0f} s already"
        return self._scene.error(frames, lambda file: f"{file} {text}")

    def _end(self, number: int, waited: float) -> None:
        """Ends the process after completing the recording, if an FMU does not return.

        If it is an isolated FMU, only its own process ends, and the run goes on to its failure.
        """
        # The handler that samples the stack is in the same library.
        waits = [name for file, name in symbols(self._stack()) if file == self._proxy]
        if any(name.startswith(("fmi", "isolated_fmi")) for name in waits):
            for library in {one.library for one in self._scene.slaves}:
                library.kill()
            return
        error = self._error(waited)
        if error is None:
            return
        with suppress(BaseException):
            os.write(2, f"error: {error}\n".encode())
            self._scene.rescue(error)
        self._libc.signal(number, None)
        os.kill(os.getpid(), number)
