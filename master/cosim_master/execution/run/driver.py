"""Runs the compiled loop, and handles the reasons for which it returns to Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from cosim_master.diagnostics.errors import FmuError, RunFailed, RunTerminated
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.build import grown
from cosim_master.network.radio.confining import roomier
from cosim_master.stepping.failures import raise_failures
from cosim_master.stepping.kernels.macro_step import next_point, outbox_needed, places_needed, run
from cosim_master.stepping.kernels.tables import (
    BLOCK_FULL,
    DONE,
    EVENTS_DUE,
    FAILED,
    FAILURES,
    NEED_LOG,
    NEED_OUTBOX,
    NEED_PLACES,
    PHASE,
    ROWS,
    RUNNING,
    SEND,
    STEPS_DUE,
    K,
)

__all__ = ["Driver", "Steps"]


class Steps(Protocol):
    """Makes the steps of a macro step in place of the compiled loop."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the steps made, to be reported at the end of the run."""

    def step(self, time: float) -> None:
        """Exchanges and steps all instances, beginning at `time` [s]; failures are in the plan.

        Raises:
            FmuError: an FMU fails to save or restore its state.
        """

    def close(self) -> None:
        """Frees the saved states, before the instances are freed."""


class Driver:
    """Macro steps of fixed size.

    Args:
        on_failure: called when instances have failed, before the error is raised; it may raise another one.
        steps: makes the steps that the loop does not make.
    """

    def __init__(
        self, state: RunState, blocks: Blocks, on_failure: Callable[[], None], steps: Steps | None = None
    ) -> None:
        self._state, self._blocks, self._on_failure, self._steps = state, blocks, on_failure, steps
        self.on_room: Callable[[], None] = lambda: None
        """Called after room was made: blocks may have been handed over, and then cannot be taken back."""
        self._served = {
            BLOCK_FULL: self._block_full,
            NEED_PLACES: self._need_places,
            NEED_OUTBOX: self._need_outbox,
            NEED_LOG: blocks.make_room_for_a_step,
            FAILED: self._failed,
        }

    def to(self, stop: int) -> None:
        """Makes macro steps until base step `stop` of the plan's grid.

        Raises:
            RunFailed, RunTerminated, or what `on_failure` raises.
        """
        state = self._state
        if not state.texts:
            self._run(stop)
            return
        # Strings that are not packets are rare and slow to exchange: Python exchanges them, one macro step at a time.
        while state.plan.counters[K] < stop:
            state.texts.set_inputs(state.plan)
            self._run(int(next_point(state.plan, stop)))

    def _run(self, stop: int) -> None:
        state = self._state
        counters = state.plan.counters
        rows = int(counters[ROWS])
        while (reason := self._loop(stop)) != DONE:
            state.plan.shared[RUNNING] = 0
            if reason == EVENTS_DUE:
                self._handle_events()
            elif reason == STEPS_DUE:
                self._step()
            else:
                self._served[reason]()
                self.on_room()
                rows = int(counters[ROWS])
        state.plan.shared[RUNNING] = 0
        if state.texts:
            self._blocks.read_texts(recorded=int(counters[ROWS]) != rows)

    def _loop(self, stop: int) -> int:
        state = self._state
        return int(run(state.plan, state.radio, state.frames, stop))

    def _need_outbox(self) -> None:
        self._state.radio = roomier(self._state.radio, int(outbox_needed(self._state.plan)))

    def _block_full(self) -> None:
        if self._state.texts:
            self._blocks.read_texts(recorded=True)
        self._blocks.rows()

    def _need_places(self) -> None:
        state = self._state
        state.radio = grown(state.radio, int(places_needed(state.plan, state.radio)))

    def _failed(self) -> None:
        self._on_failure()
        raise_failures(self._state.plan, self._state.layout, self._state.slaves)

    def _handle_events(self) -> None:
        state = self._state
        rows = int(state.plan.counters[ROWS])
        try:
            state.event_mode.handle()
        except RunTerminated:
            if state.texts and state.plan.counters[ROWS] > rows:
                self._blocks.read_texts(recorded=True)
            raise

    def _step(self) -> None:
        state, counters = self._state, self._state.plan.counters
        assert self._steps is not None
        try:
            self._steps.step(state.time)
        except FmuError as error:
            raise RunFailed([error]) from None
        state.plan.shared[RUNNING] = 0
        if counters[FAILURES] > 0:
            self._failed()
        counters[PHASE] = SEND
        if state.event_mode.pending:
            state.event_mode.handle()
