"""The FMUs of this process, and the one that it was calling when it crashed or hung.

Python notes each function that it calls in `Library.calling`, and the loop in `Plan.shared` (RUNNING), which costs one
store per call. The stack shows in which library, and in most cases in which function, the process is.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.calls import FUNCTIONS
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.tables import RUNNING, Plan

__all__ = ["FRAMES", "Scene", "symbols"]

FRAMES = 512
"""Most frames of a stack that are examined."""
_STEP = "fmi2DoStep"


class _Symbol(ctypes.Structure):
    """Dl_info of dladdr."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("base", ctypes.c_void_p),
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
    )


class Scene:
    """What a run is doing, as far as it is known.

    Attributes:
        libraries: the FMU files that are loaded.
        slaves: the instances; empty during the start-up.
        plan: of the loop; None during the start-up.
        now: returns the time that all instances have reached, s; None during the start-up.
        rescue: called with the error before the process ends.
        on_recording: called when all that `rescue` needs has been opened.
    """

    def __init__(self) -> None:
        self.libraries: list[Library] = []
        self.slaves: Sequence[Slave] = ()
        self.plan: Plan | None = None
        self.now: Callable[[], float | None] = lambda: None
        self.rescue: Callable[[FmuError], None] = lambda _: None
        self.on_recording: Callable[[], None] = lambda: None

    def begin(self, slaves: Sequence[Slave], plan: Plan, now: Callable[[], float]) -> None:
        """Takes the instances of a run that has started up."""
        self.slaves, self.plan, self.now = slaves, plan, now

    def calling(self) -> tuple[tuple[str, str], ...]:
        """Returns the instances and functions that Python code has called last, of all libraries."""
        return tuple(one.calling for one in self.libraries)

    def error(self, frames: Sequence[int | None], said: Callable[[str], str]) -> FmuError | None:
        """Returns the error of the FMU in which this thread is, or was last; None if it has called none.

        Args:
            frames: return addresses of its stack, the innermost first.
            said: returns the text of the error from the name of the FMU file.
        """
        library, function = self._on_stack(frames)
        running = self._running()
        if running is not None and library in (None, running[0].library):
            one, called = running
            # A solver of Model Exchange is itself the step, and makes further calls.
            library, who, called = one.library, one.name, _inner(one.library, one.name, function) or called
            lines = list(one.lines)
        else:
            library = library or next((one for one in reversed(self.libraries) if any(one.calling)), None)
            if library is None:
                return None
            who, called = library.calling
            lines = next((list(one.lines) for one in self.slaves if one.name == who), [])
        names = [one.name for one in self.slaves if one.library is library]
        if not who:
            several = f"one of {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}"
            who = names[0] if len(names) == 1 else several if names else library.fmu.model_name
        called = called or function or "a function of the FMU"
        return FmuError(who, called, said(library.fmu.path.name), self.now(), lines)

    def inside(self, frames: Sequence[int | None]) -> bool:
        """Returns whether a stack is that of a call of an FMU in this process."""
        return self._on_stack(frames)[0] is not None

    def _on_stack(self, frames: Sequence[int | None]) -> tuple[Library | None, str]:
        """Returns the innermost FMU on a stack and its innermost FMI function, as far as they are known."""
        files = {os.path.realpath(one.file): one for one in self.libraries if one.file and not one.isolated}
        library = None
        for file, name in symbols(frames):
            found = files.get(file)
            library = library or found
            if found is not None and found is library and "fmi" in name:
                return library, name
        return library, ""

    def functions(self) -> dict[int, tuple[str, str]]:
        """Returns the values of RUNNING for FMUs of others in this process: instance and function."""
        plan, found = self.plan, {}
        if plan is None:
            return {}
        for i, one in enumerate(self.slaves):
            if one.library.isolated or one.library.own:
                continue
            found[_address(plan.instances, i)] = one.name, one.function_name(_STEP)
            first, last = plan.instances[["first_set", "last_get"]][i]
            for row in range(first, last):
                called = FUNCTIONS[int(plan.calls["number"][row])]
                found[_address(plan.calls, row)] = one.name, one.function_name(called)
        return found

    def _running(self) -> tuple[Slave, str] | None:
        """Returns the instance that the loop has called, and the function; None if the loop does not run."""
        plan = self.plan
        if plan is None or (at := int(plan.shared[RUNNING])) == 0:
            return None
        if (step := _row(plan.instances, at)) is not None:
            one = self.slaves[step]
            return one, one.function_name(_STEP)
        if (row := _row(plan.calls, at)) is None:
            return None
        owners = np.flatnonzero((plan.instances["first_set"] <= row) & (row < plan.instances["last_get"]))
        one = self.slaves[int(owners[0])]
        return one, one.function_name(FUNCTIONS[int(plan.calls["number"][row])])


def _address(table: NDArray[Any], row: int) -> int:
    """Returns the address of a row of a table."""
    return int(table.ctypes.data) + row * table.itemsize


def _row(table: NDArray[Any], at: int) -> int | None:
    """Returns the row of a table that is at an address; None if it has none there."""
    row = (at - table.ctypes.data) // table.itemsize
    return row if 0 <= row < table.size else None


def _inner(library: Library, name: str, function: str) -> str:
    """Returns the function of a stack if Python has called it for an instance of this name, else an empty text."""
    return function if function and library.calling == (name, function) else ""


def symbols(frames: Sequence[int | None]) -> Iterator[tuple[str, str]]:
    """Yields the file and the function of each return address that belongs to a library."""
    libc = ctypes.CDLL(None)
    for at in frames:
        symbol = _Symbol()
        # A return address may lie after the end of the function that called abort() as its last instruction.
        if libc.dladdr(ctypes.c_void_p((at or 1) - 1), ctypes.byref(symbol)) and symbol.file:
            yield os.path.realpath(os.fsdecode(symbol.file)), (symbol.name or b"").decode("ascii", "replace")
