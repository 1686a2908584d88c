"""Ticks of the time-based Clocks of FMI 3.0 (FMI 3.0.2, sections 2.2.8, 2.3).

    schedule = Schedule(one, start, intervals)
    schedule.begin()                     in initialization mode: get or set the intervals
    schedule.due(now), schedule.next     Clocks that tick at a time; the time of the next tick
    schedule.update(now, ticked)         in Event Mode, after fmi3UpdateDiscreteStates: get values that may have changed

Times are whole nanoseconds. Tick n of a periodic Clock is at the nanosecond next to start + shift + n*interval, which
is computed with fractions and never accumulated. `super_dense` sets Clocks and handles the consequences.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.slaves.fmi3 import INTERVAL_CHANGED, INTERVAL_NOT_YET_KNOWN, whole_nanoseconds
from cosim_master.fmi.slaves.slave import EventSlave

__all__ = ["Schedule", "seconds"]

_PERIODIC = ("constant", "fixed", "tunable")


@dataclass(slots=True)
class _Ticks:
    """The ticks of one Clock, in ns. Periodic: tick n is at first + n*interval; `when` is the next tick, if known."""

    interval: Fraction | None = None
    first: Fraction = Fraction(0)
    n: int = 0
    when: int | None = None

    def restart(self, first: Fraction, interval: Fraction) -> None:
        self.first, self.interval, self.n = first, interval, 0
        self.when = round(first)

    def advance(self) -> None:
        assert self.interval is not None
        self.n += 1
        self.when = round(self.first + self.n * self.interval)


class Schedule:
    """The time-based Clocks of one instance.

    Args:
        one: the instance.
        start: start time of the run, ns.
        intervals: the intervals of fixed and tunable Clocks that the system sets, s; others are the FMU's.
    """

    def __init__(self, one: EventSlave, start: int, intervals: Mapping[str, float]) -> None:
        self._one, self._start = one, start
        self._given = {name: whole_nanoseconds(value) for name, value in intervals.items()}
        variables = [v for v in one.fmu.variables.values() if v.clock is not None]
        self._clocks = [v for v in variables if v.clock is not None and v.clock.kind != "triggered"]
        self._ticks = {v.name: _Ticks() for v in self._clocks}

    @property
    def depends(self) -> bool:
        """True if an interval depends on tunable parameters: after a change of one, the FMU must be queried again."""
        return any(v.clock is not None and v.clock.kind == "tunable" and v.clock.interval is None for v in self._clocks)

    @property
    def next(self) -> int | None:
        """Time of the next tick, ns; None if none is known."""
        times = [ticks.when for ticks in self._ticks.values() if ticks.when is not None]
        return min(times, default=None)

    def due(self, now: int) -> list[Variable]:
        """Returns the Clocks that tick at a time."""
        return [v for v in self._clocks if (when := self._ticks[v.name].when) is not None and when <= now]

    def ticked(self, clock: Variable) -> None:
        """Handles the tick of a Clock: computes its next tick, if it is known."""
        if _kind(clock) in _PERIODIC:
            self._ticks[clock.name].advance()
        else:
            self._ticks[clock.name].when = None

    def begin(self) -> None:
        """Gets intervals and shifts from the system, the description or the FMU, in initialization mode.

        Raises:
            FmuError: the FMU refused, or its answer is not an interval.
        """
        for v in self._clocks:
            kind, ticks, described = _kind(v), self._ticks[v.name], v.clock
            assert described is not None
            if kind in ("changing", "countdown"):
                self._ask(v, self._start)
                continue
            interval = self._given.get(v.name)
            if interval is None and described.interval is not None:
                interval = described.interval * 10**9
            shift = described.shift * 10**9
            if interval is None:
                shift = self._one.get_shift(v)
                interval, _ = self._one.get_interval(v)
            elif kind != "constant":
                self._one.set_interval(v, interval / 10**9)
            ticks.restart(self._start + shift, self._checked(v, interval))

    def update(self, now: int, ticked: Collection[str]) -> None:
        """Gets new intervals in Event Mode, after the discrete states were updated.

        Args:
            now: ns.
            ticked: names of the Clocks that were active.

        Raises:
            FmuError: the FMU refused, or its answer is not an interval.
        """
        for v in self._clocks:
            kind = _kind(v)
            if kind == "countdown" or (kind == "changing" and v.name in ticked):
                self._ask(v, now, ticked=v.name in ticked)
            elif kind == "tunable" and v.clock is not None and v.clock.interval is None:
                interval, qualifier = self._one.get_interval(v)
                if qualifier == INTERVAL_CHANGED:
                    self._from_now(v, now, interval)

    def retune(self, clock: Variable, interval: float, now: int) -> None:
        """Sets the interval of a tunable Clock, in s, in Event Mode, from the current time on."""
        new = self._checked(clock, whole_nanoseconds(interval))
        self._one.set_interval(clock, new / 10**9)
        self._from_now(clock, now, new)

    def _from_now(self, clock: Variable, now: int, interval: Fraction) -> None:
        self._ticks[clock.name].restart(now + self._checked(clock, interval), interval)

    def _ask(self, v: Variable, now: int, *, ticked: bool = False) -> None:
        """Queries the next tick of an aperiodic Clock; the schedule changes if the FMU reports a new one."""
        interval, qualifier = self._one.get_interval(v)
        if qualifier == INTERVAL_CHANGED or (ticked and _kind(v) == "changing"):
            self._ticks[v.name].when = round(now + self._checked(v, interval, zero=True))
        elif qualifier == INTERVAL_NOT_YET_KNOWN:
            self._ticks[v.name].when = None

    def _checked(self, v: Variable, interval: Fraction, *, zero: bool = False) -> Fraction:
        if interval < (0 if zero else 1):
            text = f"the interval of its Clock {v.name} is {float(interval) / 1e9:g} s; "
            text += "it must not be negative" if zero else "it must be at least 1 ns"
            raise FmuError(self._one.name, "fmi3GetIntervalDecimal", text, self._one.time, self._one.lines)
        return interval

    def saved(self) -> tuple[_Ticks, ...]:
        """Returns all data that the future of the schedule depends on, for `restore`."""
        return tuple(_Ticks(t.interval, t.first, t.n, t.when) for t in self._ticks.values())

    def restore(self, saved: tuple[_Ticks, ...]) -> None:
        for name, t in zip(self._ticks, saved, strict=True):
            self._ticks[name] = _Ticks(t.interval, t.first, t.n, t.when)

    def as_json(self) -> list[Any]:
        """Returns the same data as plain values, for `from_json` in another run."""
        return [[None if t.interval is None else str(t.interval), str(t.first), t.n, t.when] for t in self.saved()]

    def from_json(self, content: Sequence[Sequence[Any]]) -> None:
        self.restore(
            tuple(_Ticks(None if i is None else Fraction(i), Fraction(first), n, when) for i, first, n, when in content)
        )


def _kind(clock: Variable) -> str:
    assert clock.clock is not None
    return clock.clock.kind


def seconds(ticks: int | None) -> float:
    """Returns a time in ns as s; infinity for none."""
    return math.inf if ticks is None else ticks / 1e9
