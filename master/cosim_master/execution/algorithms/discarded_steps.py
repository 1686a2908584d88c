"""Repeats steps that FMUs discard as several shorter ones, on a finer time grid.

fmi2Discard from fmi2DoStep means that this step is refused, but a shorter one may succeed (FMI 2.0.5, section 4.2.2).
All instances then go back to the communication point where the step began, and make shorter steps with exchange between
them until all are on the system's own grid again. Copying the state of every instance before every step would often
cost more than the step itself, so a copy is made only occasionally. After a discard, the run goes back to this copy and
repeats the steps up to the same point. All values recorded since must be the same again, bit for bit. This detects an
FMU that declares that it can restore its state, but does not.

This module makes no steps; see `fixed_step`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed, RunTerminated
from cosim_master.execution.run.state import RunState
from cosim_master.fmi.slaves.fmi2 import STATUS
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.stepping.failures import DISCARD, discard_failure
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.macro_step import end_here
from cosim_master.stepping.kernels.tables import BASE, ENDED, EVERY, FINER, LAST, PER_NS, START, K, Plan

__all__ = ["FINEST", "Discarded", "Grid", "cannot_be_repeated", "judge_failures"]

FINEST = 1000
"""A step is divided into at most this number of steps. An FMU that discards even these will discard any."""

_FORGETFUL = "(a Python FMU says this when do_step forgets to return True)"


def cannot_be_repeated(state: RunState) -> str:
    """Returns the reason why discarded steps of a run cannot be repeated; empty if they can."""
    if state.frames is not NO_FRAMES:
        return "a run in parts cannot go back: the other parts have its packets already"
    return _incapable(state.slaves) or (
        "what has passed a gateway cannot be taken back"
        if any(not gateway.quiet for gateway in state.network.gateways)
        else ""
    )


def _incapable(slaves: Sequence[Slave]) -> str:
    lacking, remedies = {}, {}
    for one in slaves:
        flags = one.fmu.capabilities
        if not flags.canGetAndSetFMUstate or not one.library.has(*one.state_functions):
            lacking[one.name] = "canGetAndSetFMUstate"
            remedies[one.name] = one.fmu.remedy("canGetAndSetFMUstate")
        elif not flags.canHandleVariableCommunicationStepSize:
            lacking[one.name] = "canHandleVariableCommunicationStepSize"
    if not lacking:
        return ""
    named = [f"{flag} of {name} is false{remedies.get(name, '')}" for name, flag in list(lacking.items())[:3]]
    return ", ".join(named) + (f", and of {len(lacking) - 3} more" if len(lacking) > 3 else "")


class Discarded(Exception):
    """Steps were discarded, and can be repeated with steps shorter by a factor of at least `shrink`.

    Args:
        failures: returns the errors, given the reason why the steps are not repeated.
        reached: the first of the times that the instances name as their last successful one, s; None if none does.
    """

    def __init__(self, failures: Callable[[str], list[FmuError]], shrink: float, reached: float | None = None) -> None:
        self.failures, self.shrink, self.reached = failures, shrink, reached


def judge_failures(state: RunState, unrepeatable: str, *, can_end_here: bool = True) -> None:
    """Raises the error that follows from instances that only discarded their steps or ended the run.

    If an instance failed otherwise, it returns, and the caller raises the error.

    Args:
        unrepeatable: the reason why discarded steps are not repeated; empty if they can be.
        can_end_here: whether the current macro step may be the last one.

    Raises:
        RunTerminated: instances request the end of the run.
        RunFailed: steps were discarded and cannot be repeated.
        Discarded: steps were discarded and can be repeated.
    """
    rows, slaves, time = state.plan.instances, state.slaves, state.time
    failed = [int(i) for i in np.flatnonzero(rows["failed"][:, 0])]
    ended = [i for i in failed if rows["failed"][i][1] == ENDED]
    discarded = [i for i in failed if tuple(rows["failed"][i][:2]) == DISCARD]
    if len(ended) + len(discarded) < len(failed):
        return
    waiting: list[tuple[int, float | None]] = []
    shrink = 2.0
    ends = [(i, time + float(rows["h"][i])) for i in ended]
    for i in discarded:
        h = float(rows["h"][i])
        slaves[i].time = time
        last = slaves[i].last_successful_time()
        if slaves[i].ended():
            ends.append((i, time if last is None else last))
            continue
        if last is not None and last > time:
            shrink = max(shrink, h / (last - time))
        waiting.append((i, last))

    def failures(reason: str) -> list[FmuError]:
        for i, _ in waiting:
            slaves[i].time = state.time
        return [discard_failure(state.plan, slaves[i], i, last, reason) for i, last in waiting]

    if ends:
        _terminate(state, sorted(ends), can_end_here=can_end_here and len(ends) == len(failed))
    if unrepeatable:
        raise RunFailed(failures(unrepeatable))
    named = [last for _, last in waiting if last is not None and time < last < math.inf]
    raise Discarded(failures, shrink, min(named, default=None))


def _terminate(state: RunState, ends: Sequence[tuple[int, float]], *, can_end_here: bool) -> None:
    """Ends the run for instances (number, time) that request it. If they made this step, it is the last one."""
    slaves, rows, counters = state.slaves, state.plan.instances, state.plan.counters
    first = slaves[ends[0][0]]
    python = any(slaves[i].library.python for i, _ in ends)
    if python and counters[K] == 0:
        text = f"fmi2Discard: it requested the end of the run in its first step {_FORGETFUL}"
        raise RunFailed([first.failure("fmi2DoStep", STATUS.index("fmi2Discard"), text)])
    end = (counters[START] + (counters[K] + 1) * counters[BASE]) / (1e9 * counters[PER_NS])
    stepped = all(rows[i]["length"] == 1 and time >= end - 1e-9 for i, time in ends)
    if can_end_here and stepped and not state.texts and counters[K] + 1 <= counters[LAST]:
        end_here(state.plan, np.array([i for i, _ in ends]))
    hint = _FORGETFUL if python else ""
    raise RunTerminated(first.name, min(time for _, time in ends), said=first.end_word, hint=hint)


class Grid:
    """The base step of a plan, which is `factor` times finer than the system's own during the repetition of steps.

    Only the instances that were due when it was refined make shorter steps. They do so until `until`, a base step of
    the system's own grid at which all of them would have ended a step.
    """

    def __init__(self, plan: Plan, periods: Sequence[int]) -> None:
        self._plan = plan
        self._periods = np.array(periods, dtype=np.int64)
        self._shorter = np.zeros(len(periods), dtype=bool)
        self.factor = 1
        self.until = 0

    def refine(self, at_least: float) -> int:
        """Divides the base step by the least possible integer that is not less than `at_least`.

        Returns:
            The integer; 0 without any change, if steps would be finer than `FINEST` or than a nanosecond.
        """
        counters, rows = self._plan.counters, self._plan.instances
        n = max(2, math.ceil(at_least * (1 - 1e-9)))
        while counters[BASE] % n and n * self.factor <= FINEST:
            n += 1
        if n * self.factor > FINEST:
            return 0
        self._scale(n)
        due = counters[K] % np.where(self._shorter, rows["period"], rows["period"] * n) == 0
        rows["length"] *= n
        rows["period"] = np.where(self._shorter | due, rows["period"], rows["period"] * n)
        self._shorter |= due
        self._begin(due)
        span = math.lcm(*(int(p) for p in self._periods[self._shorter]))
        self.until = min(max(self.until, (int(counters[K]) // self.factor // span + 1) * span), self._last())
        return n

    def coarsen(self) -> None:
        """Returns to the system's own grid, at `until`."""
        counters, rows = self._plan.counters, self._plan.instances
        factor = self.factor
        counters[[K, LAST, EVERY]] //= factor
        counters[BASE] *= factor
        rows["length"] //= factor
        rows["period"] = self._periods
        self._shorter[:] = False
        self._begin(counters[K] % self._periods == 0)
        self.factor, self.until = 1, 0
        counters[FINER] = 1

    def _scale(self, n: int) -> None:
        counters = self._plan.counters
        counters[[K, LAST, EVERY]] *= n
        counters[BASE] //= n
        self.factor *= n
        counters[FINER] = self.factor

    def _last(self) -> int:
        return int(self._plan.counters[LAST]) // self.factor

    def _begin(self, due: np.ndarray[Any, Any]) -> None:
        """Sets the length of the steps that are about to begin."""
        counters: Any = self._plan.counters
        rows: Any = self._plan.instances
        lengths = np.minimum(rows["period"], counters[LAST] - counters[K])
        rows["length"] = np.where(due, lengths, rows["length"])
        rows["h"] = np.where(due, lengths * counters[BASE] / (1e9 * counters[PER_NS]), rows["h"])
