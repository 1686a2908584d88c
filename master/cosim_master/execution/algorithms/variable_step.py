"""Steps with sizes chosen by constraints: Maestro's variable-step algorithm.

The exchange is Jacobi's. After every step, the constraints determine the length of the next one. If all FMUs can go
back, a step that violates a constraint is repeated from the same state with a quarter of its length. See `constraints`
for the rules.

Times are whole nanoseconds, and so is the base step of the run. The recording has a row for every accepted step or, if
it has an `interval`, a row every interval. Steps end at these rows, at changes, at events and at the end of the run.
The data that determine the next size are in `Plan.step_sizes`, and are therefore part of snapshots and checkpoints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from cosim_master.execution.algorithms.constraints import StepSizes
from cosim_master.execution.algorithms.trial import Rejected
from cosim_master.execution.algorithms.tried_steps import TriedSteps
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.state import RunState
from cosim_master.stepping.layout import Layout
from cosim_master.system.settings.constraints import LIMIT
from cosim_master.system.settings.master import MasterSettings

__all__ = ["VariableStep"]

_SHORTEST, _LONGEST = 1_000, 1_000_000_000
"""Bounds of steps, ns, if the system specifies none: those of Maestro."""


class VariableStep(TriedSteps):
    """The `Algorithm` with step sizes chosen by constraints.

    The base step is 1 ns, so `every` is in nanoseconds; 1 means a row at the end of every step.
    """

    texts_between_rows = True

    def __init__(
        self,
        state: RunState,
        blocks: Blocks,
        master: MasterSettings,
        agenda: Agenda,
        change: Callable[[int], bool],
        every: int,
    ) -> None:
        super().__init__(state, blocks, agenda, change, every)
        self._can_return = not master.irreversible
        self._shortest = master.minimum_step or min(_SHORTEST, master.maximum_step or _SHORTEST)
        self._longest = master.maximum_step or max(_LONGEST, self._shortest)
        self._sizes = StepSizes(
            master.constraints,
            state.plan.step_sizes,
            first=min(state.clock.periods),
            shortest=self._shortest,
            longest=self._longest,
        )
        self._ports = _places(state.layout, [port for one in master.constraints for port in one.ports])
        limited = any(one.type == LIMIT for one in master.constraints)
        self._limiting = state.slaves if limited else []
        self._violations: dict[str, tuple[int, float]] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for each constraint on the number of steps accepted although they violate it."""
        why = "FMUs cannot go back" if not self._can_return else f"{self._shortest / 1e9:g} s is the shortest step"
        return tuple(
            f'var-step: {count} steps count although they violate constraint "{name}", '
            f"the first from t = {time:.9g} s: {why}"
            for name, (count, time) in self._violations.items()
        )

    def proceed(self, k: int) -> bool:
        state, clock, every = self.state, self.state.clock, self.every
        row = (k // every + 1) * every if every > 1 else clock.steps
        self._step(state.now, clock.start + int(min(row, clock.steps, self.agenda.next)))
        return every == 1 or self.k % every == 0 or self.k == clock.steps

    def _step(self, t: int, target: int) -> None:
        """Makes one accepted step, from `t` to at most `target`, ns."""
        trial, sizes = self.trial, self._sizes
        h = sizes.proposed(t, self._values(), min(target - t, self._limit()))
        if (announced := trial.next_event()) < (t + h) / 1e9:
            h = sizes.cut(max(math.ceil(announced * 1e9) - t, 1))
        if self._can_return:
            trial.save()
        else:
            trial.begin()
        violated: list[str] = []
        while True:
            last = f"{h / 1e9:.9g} s is the shortest step" if h <= self._shortest else ""
            try:
                trial.step(t, h, last)
                violated = sizes.violated(self._values())
            except Rejected as rejected:
                trial.restore()
                h = self._shorter(rejected, t, h)
                continue
            if not violated or not self._can_return or h <= self._shortest:
                break
            trial.restore()
            h = sizes.tightened()
        for name in violated:
            count, first = self._violations.get(name, (0, t / 1e9))
            self._violations[name] = (count + 1, first)

    def _shorter(self, rejected: Rejected, t: int, h: int) -> int:
        """Returns the size in place of `h`, ns: to the event or the time reached, a quarter where neither is named."""
        if rejected.end is not None and rejected.end - t < h:
            return self._sizes.cut(rejected.end - t)
        if rejected.reached is not None and self._shortest <= rejected.reached - t < h:
            return self._sizes.cut(rejected.reached - t)
        return self._sizes.tightened()

    def _values(self) -> list[float]:
        """Returns the values of the ports of all constraints."""
        plan = self.state.plan
        return [float((plan.real_out if real else plan.int_out)[place]) for real, place in self._ports]

    def _limit(self) -> int:
        """Returns the longest step that all FMUs accept, as far as they report it, within the bounds of steps; ns."""
        asked = [size for one in self._limiting if (size := one.longest_step()) is not None]
        if not asked:
            return self._longest
        size = min(asked) * 1e9
        return int(min(max(size, self._shortest), self._longest)) if math.isfinite(size) else self._longest


def _places(layout: Layout, ports: Sequence[tuple[str, str]]) -> list[tuple[bool, int]]:
    """Returns, for each port, whether it is a real, and its index."""
    real, integer = layout.ports["Real"].index, layout.ports["Integer"].index
    return [(port in real, real[port] if port in real else integer[port]) for port in ports]
