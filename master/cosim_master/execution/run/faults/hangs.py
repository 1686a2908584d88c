"""Names an FMU of this process that does not return, and completes the recording if the user then ends the process.

    with reported_hangs(scene, seconds): ...   steps; a second signal during a hang calls scene.rescue(error)
    with reported_start(scene, limits) as watch: watch(library)      when it is loaded; from then on to the first step

While an FMU does not return, the main thread runs no Python code, and no handler of a signal. A watchdog thread notices
that the simulation time (at the start: the function called) stands still, and identifies FMU and function from the main
thread's stack. It learns of signals by Python's wake-up descriptor. After the second one, it completes the recording
and lets the signal end the process.

This needs a function in C (`stack.c` of `fmi.isolation`), and is left out where that is not compiled.
"""

from __future__ import annotations

import ctypes
import logging
import math
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

from cosim_master.diagnostics.errors import FmuError
from cosim_master.execution.run.faults.requests import TOGETHER, expected
from cosim_master.execution.run.faults.scene import FRAMES, Scene, symbols
from cosim_master.files.temporary import remove_all
from cosim_master.fmi.isolation.building import LIBRARY, CannotIsolate, binaries
from cosim_master.fmi.slaves.fmi2 import Library

__all__ = ["reported_hangs", "reported_start"]

log = logging.getLogger(__name__)

_TICK = 0.25
_SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
_GRACE = 0.5
"""Wall-clock time in which the main thread reacts to a second signal if it can, s."""


def _may_hang(library: Library) -> bool:
    return bool(library.file) and (library.isolated or not library.own)


@contextmanager
def reported_start(scene: Scene, seconds: float) -> Iterator[Callable[[Library], None]]:
    """Yields a function that takes each library when it is loaded, and watches the main thread if that may hang.

    Args:
        scene: has the libraries.
        seconds: wall-clock time after which a call is reported; 0: never.
    """
    with ExitStack() as watching:
        begun: list[Library] = []

        def watch(library: Library) -> None:
            if not begun and _may_hang(library):
                begun.append(library)
                watching.callback(_set_again)
                watching.enter_context(_watched(scene, seconds, scene.calling, "this call takes"))

        yield watch


def _set_again() -> None:
    """Sets Python's handlers of signals again, without the function in C that ends a process at the second one."""
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if callable(handler := signal.getsignal(number)):
                signal.signal(number, handler)


@contextmanager
def reported_hangs(scene: Scene, seconds: float) -> Iterator[None]:
    """Watches the main thread while it steps FMUs that this project has not built, or that are isolated.

    Args:
        scene: the instances; its `rescue` completes the recording before the process ends.
        seconds: wall-clock time after which a step is reported; 0: never.
    """
    if not any(_may_hang(one.library) for one in scene.slaves):
        yield
        return
    with _watched(scene, seconds, scene.now, "this step takes"):
        yield


@contextmanager
def _watched(scene: Scene, seconds: float, progress: Callable[[], Hashable], words: str) -> Iterator[None]:
    """Watches the main thread; `progress` returns a value that stays the same during a hang."""
    main = threading.current_thread() is threading.main_thread()
    if sys.platform != "linux" or not main:
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
    watchdog = _Watchdog(functions, scene, seconds, reading, progress, words)
    watchdog.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        watchdog.stop(writing)
        for descriptor in (writing, reading):
            with suppress(OSError):  # an FMU may have closed it
                os.close(descriptor)


class _Watchdog(threading.Thread):
    def __init__(
        self,
        functions: ctypes.CDLL,
        scene: Scene,
        seconds: float,
        signals: int,
        progress: Callable[[], Hashable],
        words: str,
    ) -> None:
        super().__init__(name="uav-cosim-watchdog", daemon=True)
        self._functions, self._scene, self._now = functions, scene, progress
        self._seconds, self._signals, self._words = seconds, signals, words
        self._main = threading.main_thread().ident or 0
        self._number = signal.SIGRTMIN + 7
        self._ended = threading.Event()
        self._proxy = os.path.realpath(functions._name)
        self._libc = ctypes.CDLL(None)
        self._libc.signal.restype, self._libc.signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
        functions.stack_of.argtypes = (ctypes.c_ulong, ctypes.c_int, ctypes.c_void_p, ctypes.c_int)
        functions.stack_prepare(int(self._number))
        self._expected: dict[int, float] = {number: -math.inf for number in _SIGNALS if expected(number)}
        """The signals that have handlers: when each was received last."""

    def stop(self, writing: int) -> None:
        """Ends the thread at once: a byte at the end `writing` of its pipe, which is no signal's number, wakes it."""
        self._ended.set()
        with suppress(OSError):  # the pipe is full of signals, which wake it too, or an FMU has closed it
            os.write(writing, b"\0")
        self.join()

    def run(self) -> None:
        time_reached, since, told, received = self._now(), time.monotonic(), 0.0, 0
        while not self._ended.is_set():
            try:
                ready, _, _ = select.select([self._signals], [], [], _TICK)
            except OSError:  # an FMU has closed it
                return
            if ready:
                with suppress(BlockingIOError):
                    for number in os.read(self._signals, 64):
                        if number in self._expected:
                            at, before = time.monotonic(), self._expected[number]
                            expected(number)  # or the next one ends the process
                            self._expected[number] = at
                            received += at - before > TOGETHER
                            if received > 1 and not self._ended.wait(_GRACE):
                                self._end(number, time.monotonic() - since)
            if (now := self._now()) != time_reached:
                time_reached, since, told = now, time.monotonic(), 0.0
            waited = time.monotonic() - since
            if self._seconds and waited > self._seconds + told and (found := self._error(waited)) is not None:
                told = waited
                kept = "" if self._scene.plan is None else " with its recording complete"
                log.warning("note: %s; a second Ctrl-C ends the process%s", found, kept)

    def _stack(self) -> Sequence[int | None]:
        frames = (ctypes.c_void_p * FRAMES)()
        return frames[: self._functions.stack_of(self._main, int(self._number), frames, FRAMES)]

    def _error(self, waited: float) -> FmuError | None:
        """Returns the error of the FMU of this process in which the main thread is; None if it is in none."""
        frames = self._stack()
        if not self._scene.inside(frames):
            return None
        text = f"has not returned; {self._words} {waited:.0f} s already"
        return self._scene.error(frames, lambda file: f"{file} {text}")

    def _end(self, number: int, waited: float) -> None:
        """Ends the process after completing the recording, if an FMU does not return.

        If it is an isolated FMU, only its own process ends, and the run goes on to its failure.
        """
        # The handler that samples the stack is in the same library.
        waits = [name for file, name in symbols(self._stack()) if file == self._proxy]
        if any(name.startswith(("fmi", "isolated_fmi")) for name in waits):
            for library in {*self._scene.libraries}:
                library.kill()
            return
        error = self._error(waited)
        if error is None:
            return
        with suppress(BaseException):
            os.write(2, f"error: {error}\n".encode())
            remove_all()
            self._scene.rescue(error)
        self._libc.signal(number, None)
        os.kill(os.getpid(), number)
