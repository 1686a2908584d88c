"""Macro steps of fixed size: Jacobi and Gauss-Seidel in the compiled loop, other algorithms through `Steps`.

If FMUs may discard steps, it keeps a snapshot, goes back to it, and divides the steps: see `discarded_steps`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed, RunTerminated
from cosim_master.execution.algorithms.discarded_steps import Discarded, Grid, cannot_be_repeated, judge_failures
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.driver import Driver, Steps
from cosim_master.execution.run.snapshot import Snapshot
from cosim_master.execution.run.state import RunState
from cosim_master.stepping.kernels.tables import FINAL, K

__all__ = ["FixedStep"]

_SNAPSHOT_EVERY = 0.2
"""Wall-clock seconds."""


class FixedStep:
    """The `Algorithm` with macro steps of fixed size.

    Args:
        agenda: values to be set during the run.
        change: sets the values that are due at a base step of the system's own grid; returns whether any were due.
        steps: makes the steps that the compiled loop does not make.
    """

    def __init__(
        self,
        state: RunState,
        blocks: Blocks,
        agenda: Agenda,
        change: Callable[[int], bool],
        steps: Steps | None = None,
    ) -> None:
        self._state, self._blocks, self._agenda, self._change = state, blocks, agenda, change
        self._steps = steps
        self._driver = Driver(state, blocks, self._on_failure, steps)
        self._grid = Grid(state.plan, state.clock.periods)
        self._unrepeatable = cannot_be_repeated(state)
        self._snapshot: Snapshot | None = None
        self._saved_at, self._emptied = -math.inf, 0

    @property
    def k(self) -> int:
        return int(self._state.plan.counters[K]) // self._grid.factor

    @property
    def repeats(self) -> bool:
        """Whether steps may be repeated: FMUs may discard them."""
        return self._snapshot is not None

    @property
    def notes(self) -> tuple[str, ...]:
        return () if self._steps is None else self._steps.notes

    def prepare(self) -> None:
        # FMUs compiled by this project never discard a step, so swarms of them need no copies of their states.
        if not self._unrepeatable and not all(one.library.own for one in self._state.slaves):
            self._state.plan.counters[FINAL] = 0
            for one in self._state.slaves:
                one.final = False
            self._snapshot = Snapshot(self._state)
            self._driver.on_room = self._save
            self._save()

    def advance(self, k_stop: int) -> None:
        if self._emptied != self._blocks.emptied or time.perf_counter() - self._saved_at > _SNAPSHOT_EVERY:
            self._save()
        grid = self._grid
        while self.k < k_stop:
            if int(self._state.plan.counters[K]) % grid.factor == 0 and self._change(self.k):
                self._save()
            target = int(min(k_stop, self._agenda.next))
            if grid.until:
                target = min(target, grid.until)
            try:
                self._driver.to(target * grid.factor)
            except Discarded as discarded:
                self._repeat(discarded)
            if grid.until and self.k >= grid.until:
                grid.coarsen()
                self._save()

    def settle(self) -> None:
        while self._grid.until:
            self.advance(self._grid.until)

    def close(self) -> None:
        if self._snapshot is not None:
            self._snapshot.close()
            self._snapshot = None
        if self._steps is not None:
            self._steps.close()

    def _on_failure(self) -> None:
        reason = self._unrepeatable or ("it cannot be repeated" if self._snapshot is None else "")
        judge_failures(self._state, reason, can_end_here=self._grid.factor == 1)

    def _save(self) -> None:
        """Copies the state; the blocks keep their rows, whose groups in files must not depend on the wall clock."""
        if self._snapshot is None:
            return
        self._snapshot.save()
        self._saved_at, self._emptied = time.perf_counter(), self._blocks.emptied

    def _repeat(self, discarded: Discarded) -> None:
        """Goes back to the start of the discarded step, and divides the steps that begin there."""
        assert self._snapshot is not None
        state, blocks = self._state, self._blocks
        rows, reached = blocks.by_signal(), int(state.plan.counters[K])
        done = blocks.recorded()
        step = float(np.max(state.plan.instances["h"]))
        try:
            self._snapshot.restore()
            blocks.take_back()
            self._driver.to(reached)
        except (FmuError, RunFailed, RunTerminated, Discarded) as error:
            blocks.put_back(done)
            reason = "to repeat it, the run went back to a copy of its state and did not come again to this step"
            raise RunFailed([*discarded.failures(reason), *_failures_of(error)]) from None
        again = blocks.by_signal()
        if changed := [name for name in rows if not np.array_equal(rows[name], again[name], equal_nan=True)]:
            blocks.put_back(done)
            text = f"the step cannot be repeated: after fmi2SetFMUstate, {', '.join(changed[:3])} went another way"
            owner = next(one.name for one in reversed(state.slaves) if changed[0].startswith(f"{one.name}."))
            reason = "to repeat it, the run went back to a copy of its state"
            raise RunFailed([*discarded.failures(reason), FmuError(owner, "fmi2SetFMUstate", text, state.time)])
        if self._grid.refine(discarded.shrink) == 0:
            tried = f"shorter steps down to {step:.9g} s did not help"
            raise RunFailed(discarded.failures(tried if self._grid.factor > 1 else f"{step:.9g} s cannot be divided"))
        self._save()


def _failures_of(error: Exception) -> list[FmuError]:
    """Returns the failures of a repetition other than another discarded step."""
    if isinstance(error, FmuError):
        return [error]
    return list(error.failures) if isinstance(error, RunFailed) else []
