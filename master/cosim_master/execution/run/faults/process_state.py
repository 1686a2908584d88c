"""The parts of the state of this process that an FMU in it can change for all others, compared before and after calls.

    before = ProcessState.present()
    ...                                   calls of FMUs
    told(before, slaves, "steps")         a note for FMUs that have changed something

`WatchedCalls` compares before and after each call that Python makes, and so names function and instance. The calls of
the loop are too many and too short for that: a state takes 0.05 ms. `WatchedSteps` compares four times a second of
wall-clock time, and so names the interval of simulated time.

Isolated FMUs change their own process only.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import stat
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Self

from cosim_master.execution.run.faults.requests import behind
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.observation import Progress, Seen

__all__ = ["ProcessState", "WatchedCalls", "WatchedSteps", "told"]

log = logging.getLogger(__name__)

_INTERVAL = 0.25
"""Wall-clock time between two comparisons during the steps, s."""
_LC_ALL = 6
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT", "SIGALRM", "SIGPIPE")
_NUMBERS = tuple(int(getattr(signal, name, 0)) for name in _SIGNALS)  # 0 where there is no such signal: not compared
_NO_FUNCTIONS = (None, 1)  # SIG_DFL and SIG_IGN
_FILES = "/proc/self/fd"


@cache
def _libc() -> Any:
    libc = ctypes.CDLL(None)
    libc.setlocale.restype = ctypes.c_char_p
    return libc


@cache
def _libm() -> Any:
    return ctypes.CDLL("libm.so.6")


@dataclass(frozen=True, slots=True)
class ProcessState:
    """The state of this process at one moment.

    Attributes:
        folder: the working directory.
        locale: of all categories.
        rounding: the mode in which this thread rounds floating-point numbers.
        mask: permissions that new files do not get.
        handlers: addresses of signal handlers.
        files: open descriptors of files, without sockets.
    """

    folder: str
    locale: str
    rounding: int
    mask: int
    handlers: tuple[int | None, ...]
    files: frozenset[tuple[int, str]]

    @classmethod
    def present(cls, before: ProcessState | None = None) -> Self | None:
        """Returns the present state; None on systems other than Linux.

        Args:
            before: an earlier state: of the open files, those are looked for that were open then.
        """
        if sys.platform != "linux":
            return None
        libc = _libc()
        os.umask(mask := os.umask(0o077))
        return cls(
            _folder(),
            (libc.setlocale(_LC_ALL, None) or b"").decode("utf-8", "replace"),
            int(_libm().fegetround()),
            mask,
            tuple(_handlers(libc)),
            frozenset(_files(_descriptors() if before is None else [number for number, _ in before.files])),
        )

    def changes(self, after: ProcessState) -> list[str]:
        """Returns the changes from this state to a later one; files that have been opened are none."""
        found = []
        if self.folder != after.folder:
            found.append(f"the working directory (now {after.folder})")
        if self.locale != after.locale:
            found.append(f"the locale (now {after.locale})")
        if self.rounding != after.rounding:
            found.append("the rounding mode of floating-point numbers")
        if self.mask != after.mask:
            found.append(f"the permissions of new files (umask {after.mask:03o})")
        pairs = zip(_SIGNALS, self.handlers, after.handlers, strict=True)
        if names := [name for name, was, now in pairs if was != now]:
            found.append(f"the handling of {', '.join(names)}")
        if closed := sorted(self.files - after.files):
            names = [f"{number} ({file})" for number, file in closed[:3]]
            found.append(f"open files: descriptors {', '.join(names)}{' ...' if len(closed) > 3 else ''} were closed")
        return found


def _folder() -> str:
    try:
        return os.getcwd()  # noqa: PTH109
    except OSError:
        return "a folder that does not exist"


def _descriptors() -> list[int]:
    return list(map(int, os.listdir(_FILES)))  # noqa: PTH208 - before each call of FMI: pathlib takes longer


class _Action(ctypes.Structure):
    """The first member of struct sigaction, and room for the others."""

    _fields_ = (("handler", ctypes.c_void_p), ("others", ctypes.c_ubyte * 248))


@cache
def _actions() -> list[tuple[int, _Action, Any]]:
    """Returns the signals, and where the system tells what becomes of them: the same for all threads."""
    return [(number, action := _Action(), ctypes.byref(action)) for number in _NUMBERS]


def _handlers(libc: Any) -> list[int | None]:
    """Returns the handlers of signals. That of `requests` is none of an FMU."""
    found: list[int | None] = []
    for number, action, address in _actions():
        libc.sigaction(number, None, address)
        handler = action.handler
        found.append(handler if handler in _NO_FUNCTIONS else behind(number, handler))
    return found


_names: dict[int, tuple[tuple[int, int, int, int], str | None]] = {}
"""By descriptors: device, number, links and time of change of the files that they had, and their names."""


def _files(numbers: Sequence[int]) -> list[tuple[int, str]]:
    """Returns those of some descriptors that are files, with the names of these."""
    found = []
    for number in numbers:
        try:
            status = os.fstat(number)
            which = status.st_dev, status.st_ino, status.st_nlink, status.st_ctime_ns
            known = _names.get(number)
            if known is None or known[0] != which:
                known = _names[number] = which, _name(number, status)
        except OSError:  # that of the listing itself, or one that another thread has closed
            continue
        if known[1] is not None:
            found.append((number, known[1]))
            if known[1].startswith("anon_inode:"):  # all of them are one
                _names.pop(number, None)
    return found


def _name(number: int, status: os.stat_result) -> str | None:
    """Returns the name of a file; None for those that are not compared."""
    # Sockets may be closed by their other ends, and recorders close the Parquet files of each checkpoint.
    if stat.S_ISSOCK(status.st_mode):
        return None
    name = os.readlink(f"{_FILES}/{number}")  # noqa: PTH115
    return None if name.startswith(("socket:", "/proc/")) or name.endswith(".parquet") else name


class WatchedCalls:
    """Finds the calls of FMI functions that change this process, during the start of a run.

    Attributes:
        after: the state after the last such call; None if there was none.
    """

    def __init__(self) -> None:
        self.after: ProcessState | None = None
        self._notes: list[str] = []
        self._libraries: list[Library] = []

    def watch(self, library: Library) -> None:
        """Watches the functions of a library that is not ours and runs in this process."""
        if library.file and not library.own and not library.isolated and ProcessState.present() is not None:
            self._libraries.append(library)
            library.watch = partial(_Watched, self._compared, library)

    def _compared(self, before: ProcessState | None, library: Library, function: str, first: Any) -> None:
        if before is None or (after := ProcessState.present(before)) is None or not (changes := before.changes(after)):
            return
        value = getattr(first, "value", first)  # the handle, or the name in calls that instantiate
        who = value.decode("utf-8", "replace") if isinstance(value, bytes) else library.handles.get(value or 0)
        text = f"{who or library.fmu.path.name} has changed the process of the run in {function}: {'; '.join(changes)}"
        self.after = ProcessState.present()
        self._notes.append(f"{text} (--isolate instance prevents it)")
        log.warning("note: %s", self._notes[-1])

    def end(self) -> tuple[str, ...]:
        """Ends the watch, and returns its notes."""
        for library in self._libraries:
            library.watch = None
        return tuple(self._notes)


class _Watched:
    """A function of a library, with a comparison of this process before and after it; `restype` can be set."""

    def __init__(self, compared: Callable[..., None], library: Library, name: str, function: Any) -> None:
        object.__setattr__(self, "_parts", (compared, library, name, function))

    _parts: tuple[Callable[..., None], Library, str, Any]

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._parts[3], name, value)

    def __call__(self, *arguments: Any) -> Any:
        compared, library, name, function = self._parts
        before = ProcessState.present()
        try:
            return function(*arguments)
        finally:
            compared(before, library, name, arguments[0] if arguments else None)


class WatchedSteps:
    """The observer that finds the steps in which FMUs change this process.

    Args:
        slaves: the instances of the run.

    Attributes:
        notes: the changes found.
    """

    every = 0

    def __init__(self, slaves: Sequence[Slave]) -> None:
        self.notes: tuple[str, ...] = ()
        self._slaves = slaves
        self._interrupted: Callable[[], bool] = lambda: False
        self._before: ProcessState | None = None
        self._time, self._compared = 0.0, 0.0

    def begin(self, time: float, interrupted: Callable[[], bool]) -> None:
        """Begins at a time, s; `interrupted` returns whether the user ends the run, which changes signal handlers."""
        self._interrupted = interrupted
        self._before = ProcessState.present() if _suspects(self._slaves) else None
        self._time = time

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...

    def progressed(self, progress: Progress) -> None:
        """Compares, if the last comparison was long ago."""
        if self._before is not None and abs(progress.wall - self._compared) >= _INTERVAL:
            self._compared = progress.wall
            self.compare(progress.time)

    def compare(self, time: float) -> None:
        """Compares this process with its state at the last comparison, at a later time, s."""
        if self._before is None or self._interrupted():
            return
        after = ProcessState.present()
        if after is None or self._interrupted():
            return
        if self._before.changes(after):
            where = f"between t = {self._time:.9g} s and t = {time:.9g} s"
            when = f"a step {where} (doStep, or a function that sets or gets values)"
            self.notes += told(self._before, self._slaves, when)
            self._before = replace(after, files=self._before.files & after.files)  # others may open and close theirs
        self._time = time


def _suspects(slaves: Sequence[Slave]) -> list[Slave]:
    """Returns the instances of this process that this project has not built."""
    return [one for one in slaves if one.library.file and not one.library.own and not one.library.isolated]


def told(before: ProcessState | None, slaves: Sequence[Slave], when: str) -> tuple[str, ...]:
    """Returns and logs a note if the state of this process has changed in calls of FMUs that are not isolated.

    Args:
        when: the FMI functions that were called.
    """
    suspects = _suspects(slaves)
    after = ProcessState.present() if suspects and before is not None else None
    if before is None or after is None or not (changes := before.changes(after)):
        return ()
    names = [one.name for one in suspects]
    who = names[0] if len(names) == 1 else f"one of {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}"
    text = f"{who} has changed the process of the run in {when}: {'; '.join(changes)} (--isolate instance prevents it)"
    log.warning("note: %s", text)
    return (text,)
