"""The time profile of a run: the time to set, step and get each FMU, and the time of each phase of the run.

The stepping loop calls FMI functions by address with a handle. A profiler replaces these functions by its own, and the
handle by a row with the original function, the original handle, and the time spent so far. The loop is therefore the
same with and without a profiler, and a run without one has no overhead.

Times are wall-clock times; with several threads, the time of an FMU is the sum over the threads.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.kernel import PLAIN, compiler
from cosim_master.fmi.calls import WIDTHS
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.kernels.fmi_calls import (
    atomic_add,
    atomic_load,
    do_step2,
    do_step3,
    get_or_set,
    get_or_set3,
    get_or_set_binary,
    nanoseconds,
)
from cosim_master.stepping.kernels.tables import Plan

__all__ = ["FmuTime", "Profile", "Profiler"]

_TIMED = np.dtype([("function", "u8"), ("handle", "u8"), ("ns", "i8"), ("calls", "i8")])


@dataclass(frozen=True, slots=True)
class FmuTime:
    """The time [s] that the instances of one FMU took to set, step and get; `steps` is the sum of their steps."""

    fmu: str
    instances: int
    steps: int
    set: float
    do_step: float
    get: float

    @property
    def total(self) -> float:
        return self.set + self.do_step + self.get


@dataclass(frozen=True, slots=True)
class Profile:
    """The time profile of a run.

    Attributes:
        fmus: the times of the FMUs, the slowest first.
        phases: s, by phase: of start-up, of writing results, and of stepping, of which `fmus` are part.
    """

    fmus: tuple[FmuTime, ...]
    phases: Mapping[str, float] = field(default_factory=dict)


class Profiler:
    """Measures one run. `attach` it to the plan before the first step.

    Raises:
        RuntimeError: the kernels are not compiled, so no addresses exist that could be replaced.
    """

    def __init__(self) -> None:
        if PLAIN:
            raise RuntimeError("a profile needs compiled kernels; NUMBA_DISABLE_JIT is set")
        self.phases: dict[str, float] = {}
        self._slaves: Sequence[Slave] = ()
        self._steps = np.zeros(0, dtype=_TIMED)
        self._calls = np.zeros(0, dtype=_TIMED)
        self._kinds: np.ndarray[Any, Any] = np.zeros(0, dtype=np.int64)
        self._owners: np.ndarray[Any, Any] = np.zeros(0, dtype=np.int64)
        self._functions = _functions()

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Adds the time of a block to a phase."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.phases[name] = self.phases.get(name, 0.0) + time.perf_counter() - began

    def attach(self, plan: Plan, slaves: Sequence[Slave]) -> None:
        """Replaces the calls of the plan by timed ones."""
        step, access, step3, access3, binary = (function.address for function in self._functions)
        rows = plan.instances
        plan.ahead["begin"] = 0  # the functions measured make whole steps
        rows["expect"] = 0  # its argument is a handle of the FMU
        rows["whole"] = 0  # its parts are measured one by one
        self._slaves = slaves
        self._steps, self._calls = np.zeros(len(rows), dtype=_TIMED), np.zeros(len(plan.calls), dtype=_TIMED)
        self._steps["function"], self._steps["handle"] = rows["do_step"], rows["handle"]
        rows["do_step"] = np.where(rows["answers"] != 0, step3, step)
        rows["handle"] = self._addresses(self._steps)
        self._calls["function"], self._calls["handle"] = plan.calls["function"], plan.calls["handle"]
        width = plan.calls["width"]
        plan.calls["function"] = np.where(width == 0, access, np.where(width == WIDTHS["Binary"], binary, access3))
        plan.calls["handle"] = self._addresses(self._calls)
        self._owners = np.zeros(len(plan.calls), dtype=np.int64)
        self._kinds = np.zeros(len(plan.calls), dtype=np.int64)
        ends = [*rows["first_set"][1:], len(plan.calls)]
        for i, (row, end) in enumerate(zip(rows, ends, strict=True)):
            self._owners[row["first_set"] : end] = i
            self._kinds[row["last_set"] : end] = 1

    @staticmethod
    def _addresses(table: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return table.ctypes.data + _TIMED.itemsize * np.arange(len(table), dtype=np.uint64)

    def profile(self) -> Profile:
        """Returns the times measured so far."""
        groups: dict[str, list[int]] = {}
        for i, one in enumerate(self._slaves):
            groups.setdefault(one.fmu.path.name, []).append(i)
        spent = [np.zeros(len(self._slaves)) for _ in range(2)]
        for kind in range(2):
            chosen = self._kinds == kind
            np.add.at(spent[kind], self._owners[chosen], self._calls["ns"][chosen] / 1e9)
        found = [
            FmuTime(
                name,
                len(members),
                int(self._steps["calls"][members].sum()),
                float(spent[0][members].sum()),
                float(self._steps["ns"][members].sum() / 1e9),
                float(spent[1][members].sum()),
            )
            for name, members in groups.items()
        ]
        return Profile(tuple(sorted(found, key=lambda one: -one.total)), dict(self.phases))


def _functions() -> tuple[Any, ...]:
    """Returns functions that take the address of a row as their handle.

    fmi2DoStep, fmi2GetXXX or fmi2SetXXX; fmi3DoStep, fmi3GetXXX or fmi3SetXXX, fmi3GetBinary or fmi3SetBinary.
    """
    numba = compiler()
    types = numba.types

    @numba.cfunc(types.int32(types.uintp, types.double, types.double, types.int32), nogil=True)
    def step(row: int, t: float, h: float, final: int) -> int:
        function, handle = np.uintp(atomic_load(row)), np.uintp(atomic_load(np.uintp(row + np.uintp(8))))
        began = nanoseconds()
        status = do_step2(function, handle, t, h, final)
        atomic_add(np.uintp(row + np.uintp(16)), nanoseconds() - began)
        atomic_add(np.uintp(row + np.uintp(24)), 1)
        return int(status)

    @numba.cfunc(types.int32(*[types.uintp] * 4), nogil=True)
    def access(row: int, references: int, n: int, values: int) -> int:
        function, handle = np.uintp(atomic_load(row)), np.uintp(atomic_load(np.uintp(row + np.uintp(8))))
        began = nanoseconds()
        status = get_or_set(function, handle, references, n, values)
        atomic_add(np.uintp(row + np.uintp(16)), nanoseconds() - began)
        atomic_add(np.uintp(row + np.uintp(24)), 1)
        return int(status)

    @numba.cfunc(types.int32(types.uintp, types.double, types.double, types.int32, *[types.uintp] * 4), nogil=True)
    def step3(row: int, t: float, h: float, final: int, answers: int, _1: int, _2: int, _3: int) -> int:
        function, handle = np.uintp(atomic_load(row)), np.uintp(atomic_load(np.uintp(row + np.uintp(8))))
        began = nanoseconds()
        status = do_step3(function, handle, t, h, final, answers)
        atomic_add(np.uintp(row + np.uintp(16)), nanoseconds() - began)
        atomic_add(np.uintp(row + np.uintp(24)), 1)
        return int(status)

    @numba.cfunc(types.int32(*[types.uintp] * 5), nogil=True)
    def access3(row: int, references: int, n: int, values: int, n_values: int) -> int:
        function, handle = np.uintp(atomic_load(row)), np.uintp(atomic_load(np.uintp(row + np.uintp(8))))
        began = nanoseconds()
        status = get_or_set3(function, handle, references, n, values, n_values)
        atomic_add(np.uintp(row + np.uintp(16)), nanoseconds() - began)
        atomic_add(np.uintp(row + np.uintp(24)), 1)
        return int(status)

    @numba.cfunc(types.int32(*[types.uintp] * 6), nogil=True)
    def binary(row: int, references: int, n: int, sizes: int, values: int, n_values: int) -> int:
        function, handle = np.uintp(atomic_load(row)), np.uintp(atomic_load(np.uintp(row + np.uintp(8))))
        began = nanoseconds()
        status = get_or_set_binary(function, handle, references, n, sizes, values, n_values)
        atomic_add(np.uintp(row + np.uintp(16)), nanoseconds() - began)
        atomic_add(np.uintp(row + np.uintp(24)), 1)
        return int(status)

    return step, access, step3, access3, binary
