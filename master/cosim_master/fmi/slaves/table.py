"""Tables of values over time as instances of FMI 2.0, whose functions are implemented here.

The outputs of a table are the values of its columns at the time reached; its state is that time.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.fmi.description.interpolation import interpolated
from cosim_master.fmi.description.variables import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import Instance2, Library

__all__ = ["TableInstance", "TableLibrary"]

_OK, _ERROR = 0, 3
_SLACK = 1e-12
"""Relative tolerance of times: the sum of steps differs slightly from the time of a row."""
_ACCESS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
_GOT: dict[str, type[Any]] = {
    "fmi2GetReal": ctypes.c_double,
    "fmi2GetInteger": ctypes.c_int,
    "fmi2GetBoolean": ctypes.c_int,
}


class TableLibrary(Library):
    """A stand-in for the binary of an FMU."""

    def __init__(self, fmu: FmuDescription, folder: Path) -> None:
        assert fmu.table is not None
        self.fmu, self.resources, self.table, self.file = fmu, folder, fmu.table, ""
        self.handles: dict[int, str] = {}
        self.corrupted = self.python = self.own = self.isolated = self.thread_safe = False
        self.times: dict[int, float] = {}
        self._columns = list(self.table.columns.values())
        self._functions: dict[str, Any] = {name: _ACCESS(self._getter(kind)) for name, kind in _GOT.items()}
        self._functions["fmi2DoStep"] = _STEP(self._step)
        self._next = count(1)

    def _getter(self, kind: type[Any]) -> Callable[[int, int, int, int], int]:
        def get(handle: int, references: int, n: int, values: int) -> int:
            try:
                if not n:
                    return _OK
                asked = (ctypes.c_uint * n).from_address(references)
                into = (kind * n).from_address(values)
                for i, reference in enumerate(asked):
                    into[i] = kind(self.value(reference, self.times[handle])).value
            except Exception:  # no exception may leave a function that C calls
                return _ERROR
            return _OK

        return get

    def _step(self, handle: int, t: float, h: float, _final: int) -> int:
        self.times[handle] = self._on_row(t + h)
        return _OK

    def _on_row(self, time: float) -> float:
        """Returns a time, or the time of the row that it equals up to rounding."""
        times = self.table.times
        i = int(np.searchsorted(times, time))
        for near in times[max(0, i - 1) : i + 1]:
            if abs(time - near) <= _SLACK * max(1.0, abs(time)):
                return float(near)
        return time

    def value(self, reference: int, time: float) -> Any:
        """Returns the value of a column at a time in s."""
        column = self._columns[reference]
        return interpolated(self.table.times, column.values, np.array([time]), held=column.held)[0].item()

    def begin(self, handle: int, time: float) -> None:
        self.times[handle] = self._on_row(time)

    def function(self, name: str, instance: str) -> Any:  # noqa: ARG002
        return self._functions[name]

    def address(self, function: str) -> int:
        return ctypes.cast(self._functions[function], ctypes.c_void_p).value or 0

    def has(self, *functions: str) -> bool:  # noqa: ARG002
        return True  # an instance implements the functions that it does not call

    def new_handle(self) -> int:
        return next(self._next)

    def instantiate(self, name: str) -> TableInstance:
        return TableInstance(self, name, None, None)


class TableInstance(Instance2):
    """An instance of a table."""

    library: TableLibrary

    def _instantiate(self, allocate: Any, free: Any) -> int:  # noqa: ARG002 (it takes no memory)
        return self.library.new_handle()

    def setup_experiment(self, start: float, stop: float) -> None:  # noqa: ARG002
        self.time = start
        self.library.begin(self.handle, start)

    def enter_initialization_mode(self) -> None:
        """Does nothing."""

    def exit_initialization_mode(self) -> None:
        self.stepping = True

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        now = self.library.times[self.handle]
        values = [self.library.value(v.value_reference, now) for v in variables]
        return [bool(x) if v.type == "Boolean" else x for v, x in zip(variables, values, strict=True)]

    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Does nothing: a table has only outputs."""

    def longest_step(self) -> None:
        """Returns None: a table has a value at every time."""

    def save_state(self, state: ctypes.c_void_p) -> None:
        (bits,) = struct.unpack("<Q", struct.pack("<d", self.library.times[self.handle]))
        state.value = bits

    def restore_state(self, state: ctypes.c_void_p) -> None:
        (self.library.times[self.handle],) = struct.unpack("<d", struct.pack("<Q", state.value or 0))

    def free_state(self, state: ctypes.c_void_p) -> None:
        """Does nothing: a state is the bits of a time."""

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        return struct.pack("<Q", state.value or 0)

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        return ctypes.c_void_p(struct.unpack("<Q", content)[0])

    def terminate(self) -> None:
        self.stepping = False

    def free(self) -> None:
        if self.alive:
            self.alive = False
            del self.library.handles[self.handle]
