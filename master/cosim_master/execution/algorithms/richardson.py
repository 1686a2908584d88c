"""Steps with error control: one step of H is compared with two of H/2 from the same state (Richardson extrapolation).

    control = StepControl(plan, layout, master, clock)
    control.to(t, target, world)    steps to `target`; the last step ends there exactly

The exchange is Jacobi's, of order 1: the error of two half steps is about as large as their difference to the whole
step. A step is accepted if this error is at most the tolerance times its duration in s, so the error grows by at most
the tolerance per second. Times are whole nanoseconds.

The control does not step or copy instances: the world does. `Richardson` is the algorithm, with the run as the world.
The next step size is in `Plan.step_sizes`, and is therefore part of checkpoints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import StepTooSmall
from cosim_master.execution.algorithms.trial import Rejected
from cosim_master.execution.algorithms.tried_steps import TriedSteps
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.state import RunState
from cosim_master.stepping.kernels.tables import Plan
from cosim_master.stepping.layout import Layout, shows_error
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Richardson", "StepControl", "World"]

_SAFETY, _SMALLEST_CHANGE, _LARGEST_CHANGE = 0.8, 0.1, 2.0


class World(Protocol):
    """The system that is stepped."""

    def save(self) -> None:
        """Saves the current state."""

    def restore(self) -> None:
        """Restores the saved state."""

    def step(self, t: int, h: int) -> None:
        """Makes a macro step of all instances; times in ns. Raises Rejected."""

    def next_event(self) -> float:
        """Returns the time of the next event that an FMU has announced, s."""


class StepControl:
    """The step control of one run.

    Attributes:
        accepted, rejected: numbers of accepted and of rejected steps (of two halves) so far.
    """

    def __init__(self, plan: Plan, layout: Layout, master: MasterSettings, clock: TimeGrid) -> None:
        reals = layout.ports["Real"]
        chosen = [(i, ".".join(name)) for name, i in reals.index.items() if shows_error(reals.outputs[i][1])]
        self._plan = plan
        self._watched: NDArray[np.int64] = np.array([i for i, _ in chosen], dtype=np.int64)
        self._names = [name for _, name in chosen]
        self._tolerance = master.tolerance
        self._least = master.minimum_step or max(2, clock.base // 1024)
        self._most = master.maximum_step or clock.steps * clock.base
        self.h = min(max(clock.base, self._least), self._most)
        self.accepted = self.rejected = 0

    @property
    def h(self) -> int:
        """The size of the next step, ns."""
        return int(self._plan.step_sizes[0])

    @h.setter
    def h(self, h: int) -> None:
        self._plan.step_sizes[0] = h

    def to(self, t: int, target: int, world: World) -> None:
        """Steps from `t` to `target`, ns.

        Raises:
            StepTooSmall: the tolerance cannot be met.
        """
        while t < target:
            t += self._step(t, target, world)

    def _step(self, t: int, target: int, world: World) -> int:
        """Makes one accepted step; returns its size."""
        world.save()
        forced: int | None = None
        while True:
            wanted = self.h
            h = forced if forced is not None else self._size(t, target, world)
            try:
                error = self._try(t, h, world)
            except Rejected as rejected:
                world.restore()
                self.rejected += 1
                if rejected.end is not None and rejected.end - t < h:
                    forced = rejected.end - t
                    continue
                forced = None
                self._shrink(t, h, 0.5, [])
                continue
            allowed = self._tolerance * h / 1e9
            worst = float(error.max(initial=0.0))
            factor = _LARGEST_CHANGE if worst == 0.0 else _SAFETY * allowed / worst
            if worst <= allowed:
                self.accepted += 1
                grown = int(h * min(max(factor, _SMALLEST_CHANGE), _LARGEST_CHANGE))
                self.h = min(max(grown, wanted if h < wanted else 0, self._least), self._most)
                return h
            world.restore()
            self.rejected += 1
            forced = None
            off = sorted(zip(self._names, error, strict=True), key=lambda pair: -pair[1])
            self._shrink(t, h, factor, [(name, float(e)) for name, e in off if e > allowed])

    def _shrink(self, t: int, h: int, factor: float, off: Sequence[tuple[str, float]]) -> None:
        if h <= self._least:
            raise StepTooSmall(t / 1e9, h / 1e9, off, self._tolerance)
        factor = factor if math.isfinite(factor) else 0.0
        self.h = max(int(h * min(max(factor, _SMALLEST_CHANGE), 0.9)), self._least)

    def _size(self, t: int, target: int, world: World) -> int:
        """Returns the size of the next step: the remaining time in equal parts, or less if an event ends the step."""
        rest = target - t
        h = -(-rest // max(1, -(-rest // self.h)))
        event = world.next_event()
        if event < (t + h) / 1e9:
            h = min(h, max(math.ceil(event * 1e9) - t, 1))
        return h

    def _try(self, t: int, h: int, world: World) -> NDArray[np.float64]:
        """Makes a whole step and then two half steps; returns the difference of each watched output."""
        world.step(t, h)
        whole = self._plan.real_out[self._watched].copy()
        if h == 1:
            return np.zeros(whole.size)
        world.restore()
        half = h // 2
        world.step(t, half)
        world.step(t + half, h - half)
        parts = self._plan.real_out[self._watched]
        error: NDArray[np.float64] = np.abs(parts - whole) / np.maximum(1.0, np.abs(parts))
        return error


class Richardson(TriedSteps):
    """The `Algorithm` with error control: steps end at rows, changes and the end of the run."""

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
        self._control = StepControl(state.plan, state.layout, master, state.clock)

    def proceed(self, k: int) -> bool:
        state, clock = self.state, self.state.clock
        target = min((k // self.every + 1) * self.every, clock.steps, int(min(self.agenda.next, 2**62)))
        self._control.to(state.now, clock.start + target * clock.base, self.trial)
        return target % self.every == 0 or target == clock.steps
