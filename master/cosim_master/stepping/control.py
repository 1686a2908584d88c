"""Requests of a user to a run while it goes on: pause, single steps, speed, and new values.

Only new values change the results of the run, as the same values of `--at` do at the times in `made`.
"""

from __future__ import annotations

import math
from threading import Condition

from cosim_master.system.settings.changes import Change

__all__ = ["Control"]


class Control:
    """Any thread may make requests; the run reads them between two calls of the stepping loop.

    Args:
        factor: largest multiple of real time; None: as fast as possible.

    Attributes:
        made: the values set at the user's request, with their times [s]; None: the run ends before.
    """

    def __init__(self, factor: float | None = None) -> None:
        self._changed = Condition()
        self._factor, self._paused, self._steps = factor, False, 0
        self._wanted: list[Change] = []
        self.made: list[tuple[float | None, Change]] = []

    @property
    def factor(self) -> float | None:
        """The largest multiple of real time; None: as fast as possible."""
        return self._factor

    @property
    def paused(self) -> bool:
        """True while the run is to stand still, except for single steps."""
        return self._paused

    def pause(self) -> None:
        """Lets the run stand still before its next step."""
        with self._changed:
            self._paused = True

    def resume(self) -> None:
        """Lets the run go on; single steps that it has not made yet are dropped."""
        with self._changed:
            self._paused, self._steps = False, 0
            self._changed.notify_all()

    def step(self) -> None:
        """Pauses the run after its next communication interval."""
        with self._changed:
            self._paused = True
            self._steps += 1
            self._changed.notify_all()

    def set_speed(self, factor: float | None) -> None:
        """Sets the largest multiple of real time; None: as fast as possible.

        Raises:
            ValueError: the factor is not a positive finite number.
        """
        if factor is not None and not 0.0 < factor < math.inf:
            raise ValueError(f"speed {factor}: give a positive factor of real time")
        with self._changed:
            self._factor = factor
            self._changed.notify_all()

    def change(self, change: Change) -> None:
        """Requests a value at the next communication point; `Change.k` has no meaning yet."""
        with self._changed:
            self._wanted.append(change)

    def take_changes(self) -> list[Change]:
        """Returns the values requested since the last call."""
        with self._changed:
            wanted, self._wanted = self._wanted, []
        return wanted

    def take_step(self) -> bool:
        """Returns whether a single step was requested, and takes it from the requests."""
        with self._changed:
            if self._steps == 0:
                return False
            self._steps -= 1
            return True

    def wait(self, seconds: float) -> None:
        """Waits for so many seconds of wall-clock time, or until the run is to go on in another way."""
        with self._changed:
            if not self._paused or self._steps == 0:
                self._changed.wait(seconds)
