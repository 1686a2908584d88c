"""Steps that an FMU discards are repeated as several shorter ones: the copies that takes, and the finer grid of time.

fmi2Discard from fmi2DoStep says: not this step, maybe a shorter one (FMI 2.0.5, section 4.2.2). All instances then go
back to the communication point where the step began, and take shorter steps with exchange between them until all are
on the system's own grid again. Copying the state of every instance before every step would cost more than many steps
do. So a copy is made now and then; after a discard the run goes back to it and comes again to the same point, where
everything that was recorded since must be the same again, bit for bit. An FMU that says it can restore its state and
does not is found out that way.

Nothing here steps or decides; see `execution`.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim_master.execution.startup.rollback_test import STATE_FUNCTIONS
from cosim_master.fmi.slaves.slave import Living
from cosim_master.network.radio.router import Radio
from cosim_master.stepping.kernels.tables import BASE, EVERY, FAULTS, FINER, LAST, PER_NS, K, Plan

__all__ = ["FINEST", "Grid", "Snapshot", "cannot_be_repeated"]

FINEST = 1000
"""A step is divided into at most so many. An FMU that discards even those will never do it."""

_UNCHANGED = {"real_block", "int_block", "ticks", "shared", "scratch", "calls", "feeds", "runs", "sources", "wires"}
"""Arrays of the plan that a run does not change, or that are empty when a snapshot is made."""


def cannot_be_repeated(living: Sequence[Living]) -> str:
    """Why discarded steps of a system cannot be repeated; empty if they can."""
    lacking, remedies = {}, {}
    for one in living:
        flags = one.fmu.capabilities
        if not flags.canGetAndSetFMUstate or not one.library.has(*STATE_FUNCTIONS[one.fmu.fmi_version[:1]]):
            lacking[one.name] = "canGetAndSetFMUstate"
            remedies[one.name] = one.fmu.remedy("canGetAndSetFMUstate")
        elif not flags.canHandleVariableCommunicationStepSize:
            lacking[one.name] = "canHandleVariableCommunicationStepSize"
    if not lacking:
        return ""
    named = [f"{flag} of {name} is false{remedies.get(name, '')}" for name, flag in list(lacking.items())[:3]]
    return ", ".join(named) + (f", and of {len(lacking) - 3} more" if len(lacking) > 3 else "")


class Snapshot:
    """A copy of everything that the future of a run depends on: FMU states, the plan's arrays, the radio's.

    Rows and packet logs must have been written out before `save`: they are not part of it. `close` frees the FMU
    states; call it before the instances are freed.
    """

    def __init__(self, living: Sequence[Living]) -> None:
        self._living = living
        self._states = [ctypes.c_void_p() for _ in living]
        self._arrays: dict[str, np.ndarray[Any, Any]] = {}
        self._radio: Radio | None = None

    def save(self, plan: Plan, radio: Radio) -> None:
        """Take a copy, in place of an earlier one.

        Raises:
            FmuError: an FMU cannot save its state after all.
        """
        for one, state in zip(self._living, self._states, strict=True):
            one.save_state(state)
        self._arrays = {name: getattr(plan, name).copy() for name in plan._fields if name not in _UNCHANGED}
        self._radio = _copy(radio)

    def restore(self, plan: Plan) -> Radio:
        """Go back to the copy; returns the radio as it was.

        Raises:
            FmuError: an FMU cannot restore its state after all.
        """
        assert self._radio is not None
        for one, state in zip(self._living, self._states, strict=True):
            one.restore_state(state)
        for name, array in self._arrays.items():
            getattr(plan, name)[...] = array
        plan.shared[FAULTS] = 0
        return _copy(self._radio)

    def close(self) -> None:
        for one, state in zip(self._living, self._states, strict=True):
            one.free_state(state)


def _copy(radio: Radio) -> Radio:
    return radio._replace(**{n: getattr(radio, n).copy() for n in radio._fields if n not in ("events", "log")})


class Grid:
    """The base step of a plan, `factor` times finer than the system's own while steps are being repeated.

    Only instances that were about to step when it was refined take shorter steps, until `until`, a base step of the
    system's own grid at which all of them would have ended a step.
    """

    def __init__(self, plan: Plan, periods: Sequence[int]) -> None:
        self._plan = plan
        self._periods = np.array(periods, dtype=np.int64)
        self._shorter = np.zeros(len(periods), dtype=bool)
        self.factor = 1
        self.until = 0

    def refine(self, at_least: float) -> int:
        """Divide the base step by the least possible number that is not less than `at_least`.

        Returns:
            The number; 0, and nothing is changed, if steps would be finer than `FINEST` or than a nanosecond.
        """
        clock, rows = self._plan.clock, self._plan.instances
        n = max(2, math.ceil(at_least * (1 - 1e-9)))
        while clock[BASE] % n and n * self.factor <= FINEST:
            n += 1
        if n * self.factor > FINEST:
            return 0
        self._scale(n)
        due = clock[K] % np.where(self._shorter, rows["period"], rows["period"] * n) == 0
        rows["length"] *= n
        rows["period"] = np.where(self._shorter | due, rows["period"], rows["period"] * n)
        self._shorter |= due
        self._begin(due)
        span = math.lcm(*(int(p) for p in self._periods[self._shorter]))
        self.until = min(max(self.until, (int(clock[K]) // self.factor // span + 1) * span), self._last())
        return n

    def coarsen(self) -> None:
        """Back to the system's own grid, at `until`."""
        clock, rows = self._plan.clock, self._plan.instances
        factor = self.factor
        clock[[K, LAST, EVERY]] //= factor
        clock[BASE] *= factor
        rows["length"] //= factor
        rows["period"] = self._periods
        self._shorter[:] = False
        self._begin(clock[K] % self._periods == 0)
        self.factor, self.until = 1, 0
        clock[FINER] = 1

    def _scale(self, n: int) -> None:
        clock = self._plan.clock
        clock[[K, LAST, EVERY]] *= n
        clock[BASE] //= n
        self.factor *= n
        clock[FINER] = self.factor

    def _last(self) -> int:
        return int(self._plan.clock[LAST]) // self.factor

    def _begin(self, due: np.ndarray[Any, Any]) -> None:
        """Set the length of the steps that are about to begin."""
        clock, rows = self._plan.clock, self._plan.instances
        lengths = np.minimum(rows["period"], clock[LAST] - clock[K])
        rows["length"] = np.where(due, lengths, rows["length"])
        rows["h"] = np.where(due, lengths * clock[BASE] / (1e9 * clock[PER_NS]), rows["h"])
