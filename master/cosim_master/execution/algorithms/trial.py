"""Macro steps of any size that can be tried and undone: the run as seen by step size control."""

from __future__ import annotations

import math

import numpy as np

from cosim_master.execution.algorithms.discarded_steps import Discarded, cannot_be_repeated, judge_failures
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.snapshot import Snapshot
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.build import grown
from cosim_master.network.radio.tables import USED_EVENTS, USED_LOG
from cosim_master.stepping.failures import raise_failures
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.macro_step import places_needed, run
from cosim_master.stepping.kernels.tables import (
    BASE,
    DELIVER,
    DONE,
    EVENTS_DUE,
    EVERY,
    LAST,
    NEED_LOG,
    NEED_PLACES,
    PHASE,
    START,
    K,
)

__all__ = ["Rejected", "Trial"]

_NEVER = 1 << 60


class Rejected(Exception):
    """A step that must be changed: it must end at `end` [ns] because of an event, or otherwise be shorter.

    Args:
        reached: the time that the FMUs that discard the step name as their last successful one, ns; None if none does.
    """

    def __init__(self, end: int | None = None, *, reached: int | None = None) -> None:
        self.end, self.reached = end, reached


class Trial:
    """A run whose steps can be tried: `save`, then `step` and `restore` until one is accepted."""

    def __init__(self, state: RunState, blocks: Blocks) -> None:
        self._state, self._blocks = state, blocks
        self._snapshot = Snapshot(state)
        self._unrepeatable = cannot_be_repeated(state)

    def on_failure(self, last: str = "") -> None:
        """Raises the error for instances that discard their steps; `last` is the reason why no shorter step follows."""
        judge_failures(self._state, self._unrepeatable or last)

    def save(self) -> None:
        self.begin()
        self._snapshot.save()

    def begin(self) -> None:
        """Prepares a step, whether or not it can be undone: exchanges Strings and makes room for packets."""
        state = self._state
        if state.texts:
            state.plan.instances["period"] = 1
            state.plan.counters[START], state.plan.counters[K] = state.now, 0
            state.texts.set_inputs(state.plan)
        counters, radio = state.radio.counters, state.radio
        if 2 * counters[USED_EVENTS] > radio.events.size or 2 * counters[USED_LOG] > radio.log.size:
            self._blocks.packets()

    def restore(self) -> None:
        self._snapshot.restore()

    def next_event(self) -> float:
        return self._state.event_mode.next_event()

    def step(self, t: int, h: int, last: str = "") -> None:
        """Makes a macro step from `t` with the length `h`, ns.

        Args:
            last: the reason why no shorter step follows if an FMU discards this one; empty if one follows.

        Raises:
            Rejected: an FMU discards the step, or an event ends it earlier.
            RunFailed, RunTerminated: as for `Algorithm.advance`.
        """
        state = self._state
        counters, rows = state.plan.counters, state.plan.instances
        for place, value in ((START, t), (K, 0), (BASE, h), (LAST, 2), (EVERY, _NEVER), (PHASE, DELIVER)):
            counters[place] = value
        rows["period"] = rows["length"] = 1
        rows["h"] = h / 1e9
        while (reason := run(state.plan, state.radio, NO_FRAMES, 1)) != DONE:
            if reason == NEED_PLACES:
                state.radio = grown(state.radio, int(places_needed(state.plan, state.radio)))
            elif reason == NEED_LOG:
                events, log = np.zeros(2 * state.radio.events.size, state.radio.events.dtype), state.radio.log
                events[: state.radio.events.size] = state.radio.events
                state.radio = state.radio._replace(events=events, log=np.concatenate([log, np.zeros_like(log)]))
            elif reason == EVENTS_DUE:
                first = state.event_mode.returned_early()
                if first < (t + h - 1) / 1e9:
                    raise Rejected(max(t + 1, math.ceil(first * 1e9)))
                state.event_mode.handle()
            else:
                try:
                    self.on_failure(last)
                except Discarded as discarded:
                    reached = None if discarded.reached is None else round(discarded.reached * 1e9)
                    raise Rejected(reached=reached) from None
                raise_failures(state.plan, state.layout, state.slaves)

    def close(self) -> None:
        """Frees the copies of FMU states."""
        self._snapshot.close()
