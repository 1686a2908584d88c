"""The part that algorithms with steps of any size share: their steps are tried, and end at rows and changes."""

from __future__ import annotations

from collections.abc import Callable

from cosim_master.execution.algorithms.trial import Trial
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.driver import Driver
from cosim_master.execution.run.state import RunState
from cosim_master.stepping.kernels.macro_step import record
from cosim_master.stepping.kernels.tables import ROWS, K

__all__ = ["TriedSteps"]


class TriedSteps:
    """An `Algorithm` that tries its steps. A subclass makes them in `proceed`.

    Args:
        every: base steps between two rows.
        agenda: values to be set during the run.
        change: sets the values that are due at a base step.
    """

    texts_between_rows = False
    """Whether Strings are also read where `proceed` ends between two rows."""

    def __init__(
        self, state: RunState, blocks: Blocks, agenda: Agenda, change: Callable[[int], bool], every: int
    ) -> None:
        self.state, self.agenda, self.every = state, agenda, every
        self.trial = Trial(state, blocks)
        self._blocks, self._change = blocks, change

    @property
    def k(self) -> int:
        state = self.state
        if state.plan.counters[K] < 0:
            return int(state.plan.counters[K])
        return (state.now - state.clock.start) // state.clock.base

    @property
    def notes(self) -> tuple[str, ...]:
        return ()

    def prepare(self) -> None:
        pass

    def advance(self, k_stop: int) -> None:
        state, blocks = self.state, self._blocks
        if state.plan.counters[K] < 0:
            Driver(state, blocks, self.trial.on_failure).to(0)
        while (k := self.k) < k_stop:
            self._change(k)
            recorded = self.proceed(k)
            if recorded:
                record(state.plan)
            if state.texts and (recorded or self.texts_between_rows):
                blocks.read_texts(recorded=recorded)
            if state.plan.counters[ROWS] == state.plan.ticks.size:
                blocks.rows()

    def proceed(self, k: int) -> bool:
        """Makes accepted steps from base step `k`, at most to the next row or change; returns whether a row is due."""
        raise NotImplementedError

    def settle(self) -> None:
        pass

    def close(self) -> None:
        self.trial.close()
