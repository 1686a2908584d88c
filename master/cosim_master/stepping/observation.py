"""Observers of a run: they receive the values of all fetched outputs at instants of simulated time.

    observer = make(view)          once, when the system has been checked and no FMU is loaded yet
    observer.initialised(seen)     once, at the start of the run, or at the checkpoint that it resumes from
    observer.stepped(seen)         at every multiple of `observer.every` base steps, and at the end of the run
    observer.closed()              once after `initialised`, when the run has ended, however it did

The instants depend only on the system, not on the speed of the run. Observers do not change a run: the arrays that they
receive are read-only, and the next step overwrites them. The compiled loop returns to Python at each of these instants;
without observers, it does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim_master.fmi.description.variables import Variable
from cosim_master.stepping.kernels.tables import Plan
from cosim_master.stepping.layout import KINDS, Layout

__all__ = ["MakeObserver", "Observed", "Observer", "Observers", "Seen", "View"]


@dataclass(frozen=True, slots=True)
class Seen:
    """Values at a communication point.

    Attributes:
        time: s.
        reals, integers: values of all fetched outputs, in the layout of `Plan.real_out` and `Plan.int_out`.
    """

    time: float
    reals: NDArray[np.float64]
    integers: NDArray[np.int32]


class Observer(Protocol):
    """An observer of a run."""

    every: int
    """Base steps between two looks; 0: this observer has no values to observe in this system."""

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...


class View:
    """The run that an observer is made for.

    Args:
        every: base steps between two rows of the recording.
        step: length of a base step, s.

    Attributes:
        every: as the argument.
        names: the recorded signals, "component.variable", in the order of the recording, without Strings.
    """

    def __init__(self, layout: Layout, every: int, step: float) -> None:
        self.every = every
        self._step = step
        known: dict[str, tuple[str, int, Variable]] = {}
        for kind in KINDS:
            first = len(layout.ports["Integer"].outputs) if kind == "Boolean" else 0
            at = iter(layout.ports[kind].recorded)
            for name, variable in layout.signals[kind]:
                known[name] = (kind, first + next(at), variable)
                if variable.wide:
                    next(at)
        names = (f"{one.name}.{name}" for one in layout.instances for name in one.fmu.variables)
        self._columns = [(name, *known[name]) for name in names if name in known]
        self.names = tuple(name for name, *_ in self._columns)

    def steps(self, interval: float) -> int:
        """Returns the number of base steps in an interval [s], for `Observer.every`.

        Raises:
            ValueError: the interval is not a multiple of the base step.
        """
        steps = interval / self._step
        if not 1 <= round(steps) < 2**62 or not math.isclose(steps, round(steps), rel_tol=1e-9):
            raise ValueError(f"{interval:g} s is not a multiple of the base step {self._step:.9g} s")
        return round(steps)

    def row(self, seen: Seen) -> list[float | int | bool]:
        """Returns the values of `names`."""
        return [_value(seen, kind, place, variable) for _, kind, place, variable in self._columns]


def _value(seen: Seen, kind: str, place: int, variable: Variable) -> float | int | bool:
    if kind == "Real":
        return float(seen.reals[place])
    if variable.wide:
        halves = seen.integers[place : place + 2]
        return int(halves.view(np.uint64 if variable.fmi_type == "UInt64" else np.int64)[0])
    return bool(seen.integers[place]) if kind == "Boolean" else int(seen.integers[place])


MakeObserver = Callable[[View], Observer]
"""A function that returns an observer of a run; its class, if its only argument is a `View`."""


class Observed(Protocol):
    """The run that is observed, such as an `Execution`."""

    plan: Plan

    @property
    def k(self) -> int: ...
    @property
    def time(self) -> float: ...
    def advance(self, k_stop: int) -> None: ...


class Observers:
    """Steps a run and calls each of its observers at its instants.

    Args:
        run: the run, initialized and with all outputs collected.
        observers: the observers of the run.
        last: the base step at which the run ends.
    """

    def __init__(self, run: Observed, observers: Sequence[Observer], last: int) -> None:
        self._run, self._last = run, last
        self._observers = [observer for observer in observers if observer.every > 0]
        self._reals, self._integers = run.plan.real_out.view(), run.plan.int_out.view()
        self._reals.flags.writeable = self._integers.flags.writeable = False
        self._next = {id(one): self._after(one) for one in self._observers}
        with ExitStack() as begun:
            for observer in self._observers:
                observer.initialised(self._seen())
                begun.callback(observer.closed)
            self._begun = begun.pop_all()

    def _after(self, observer: Observer) -> int:
        return (self._run.k // observer.every + 1) * observer.every

    def _seen(self) -> Seen:
        return Seen(self._run.time, self._reals, self._integers)

    def advance(self, k_stop: int) -> None:
        """Steps like `Execution.advance`, and calls the observers at their instants."""
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
        """Reports the end of the run to all observers, even if one of them raises an exception."""
        self._begun.close()
