"""The interface of a master algorithm, and the test of FMUs that must be able to go back."""

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

    algorithm.prepare()           once, when all initial outputs have been collected, or restored
    algorithm.advance(k_stop)     any number of times
    algorithm.settle()            before a checkpoint
    algorithm.close()             before the instances are freed, even if `prepare` was never called
    """

    @property
    def k(self) -> int:
        """The number of base steps completed, in the system's own grid."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the steps made, to be reported at the end of the run."""

    def prepare(self) -> None:
        """Copies the state before the first step, if the algorithm requires it.

        Raises:
            RunFailed: an FMU refuses.
        """

    def advance(self, k_stop: int) -> None:
        """Makes macro steps until base step `k_stop`, or slightly further if it chooses its own communication points.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, and the recording ends at its start.
            RunTerminated: an FMU requests the end of the simulation; the same applies.
        """

    def settle(self) -> None:
        """Continues to a communication point of the system's own grid. Raises the same errors as `advance`."""

    def close(self) -> None:
        """Frees the copies of FMU states."""


def verify_rollback(state: RunState, numbers: Sequence[int], why: str) -> None:
    """Verifies that instances can go back to an earlier state.

    Raises:
        RunFailed: they cannot.
    """
    clock = state.clock
    sizes = []
    for i in numbers:
        period = clock.periods[i]
        sizes.append([clock.seconds(period)] * max(1, min(2, clock.steps // period)))
        one = state.slaves[i]
        if state.plan.counters[FINAL] == 0:
            one.final = False
    if failures := self_test([state.slaves[i] for i in numbers], clock.time(0), sizes, why):
        raise RunFailed(failures)
