"""Observers of a run: they are shown the values of all outputs that are fetched, at instants of simulated time.

    observer.initialised(seen)     once, at the start of the run, or at the checkpoint that it goes on from
    observer.stepped(seen)         at every multiple of `observer.every` base steps, and at the end of the run
    observer.closed()              once, when the run has ended, however it did

The instants depend on the system alone, never on how fast it runs. Observers look, they do not touch: the arrays that
they are shown are read-only, and are overwritten by the next step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim_master.stepping.kernels.tables import Plan

__all__ = ["Observed", "Observer", "Observers", "Seen"]


@dataclass(frozen=True, slots=True)
class Seen:
    """Values at a communication point.

    Attributes:
        time: s.
        reals, integers: of all outputs that are fetched, in the places of `Plan.real_out` and `Plan.int_out`.
    """

    time: float
    reals: NDArray[np.float64]
    integers: NDArray[np.int32]


class Observer(Protocol):
    """Who looks at a run."""

    every: int
    """Base steps between two looks; 0: this observer has nothing to look at in this system."""

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...


class Observed(Protocol):
    """The run that is looked at: an `Execution`."""

    plan: Plan

    @property
    def k(self) -> int: ...
    @property
    def time(self) -> float: ...
    def advance(self, k_stop: int) -> None: ...


class Observers:
    """Steps a run so that each of its observers gets its looks.

    Args:
        run: initialized, all outputs collected.
        observers: those that have something to look at.
        last: the base step at which the run ends.
    """

    def __init__(self, run: Observed, observers: Sequence[Observer], last: int) -> None:
        self._run, self._last = run, last
        self._observers = [observer for observer in observers if observer.every > 0]
        self._reals, self._integers = run.plan.real_out.view(), run.plan.int_out.view()
        self._reals.flags.writeable = self._integers.flags.writeable = False
        self._next = {id(one): self._after(one) for one in self._observers}
        for observer in self._observers:
            observer.initialised(self._seen())

    def _after(self, observer: Observer) -> int:
        return (self._run.k // observer.every + 1) * observer.every

    def _seen(self) -> Seen:
        return Seen(self._run.time, self._reals, self._integers)

    def advance(self, k_stop: int) -> None:
        """As `Execution.advance`, with looks on the way."""
        stop = min(k_stop, self._last)
        while self._run.k < stop:
            self._run.advance(min([stop, *self._next.values()]))
            seen = None
            for observer in self._observers:
                if self._run.k >= min(self._next[id(observer)], self._last):
                    seen = seen or self._seen()
                    observer.stepped(seen)
                    self._next[id(observer)] = self._after(observer)

    def close(self) -> None:
        """Tell all observers that the run has ended."""
        for observer in self._observers:
            observer.closed()
