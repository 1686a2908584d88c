"""The interface of a master algorithm, and how FMUs prove that one may take them back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from cosim_master.diagnostics.errors import RunFailed
from cosim_master.execution.run.state import RunState
from cosim_master.execution.startup.rollback_test import self_test
from cosim_master.stepping.kernels.tables import FINAL

__all__ = ["Algorithm", "verify_rollback"]


class Algorithm(Protocol):
    """Steps a run.

    algorithm.prepare()           once, when all outputs have been collected at the start, or restored
    algorithm.advance(k_stop)     as often as wanted
    algorithm.settle()            before a checkpoint
    algorithm.close()             before the instances are freed, also where `prepare` was never called
    """

    @property
    def k(self) -> int:
        """Base steps done, of the system's own grid."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the steps made, for the end of the run."""

    def prepare(self) -> None:
        """Takes the copies it needs of the state before the first step.

        Raises:
            RunFailed: an FMU refuses.
        """

    def advance(self, k_stop: int) -> None:
        """Macro steps until base step `k_stop`, or a little further where communication points are its own.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, recorded data reaches its start.
            RunTerminated: an FMU wants the simulation to end; the same is true.
        """

    def settle(self) -> None:
        """Goes on to a communication point of the system's own grid. Raises as `advance`."""

    def close(self) -> None:
        """Frees copies of FMU states."""


def verify_rollback(state: RunState, numbers: Sequence[int], why: str) -> None:
    """Lets instances prove that they can go back to an earlier state.

    Raises:
        RunFailed: they cannot.
    """
    clock = state.clock
    sizes = []
    for i in numbers:
        period = clock.periods[i]
        sizes.append([clock.seconds(period)] * max(1, min(2, clock.steps // period)))
        one = state.slaves[i]
        if state.plan.clock[FINAL] == 0:
            one.final = False
    if failures := self_test([state.slaves[i] for i in numbers], clock.time(0), sizes, why):
        raise RunFailed(failures)
