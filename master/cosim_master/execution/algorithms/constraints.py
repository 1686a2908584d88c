"""Step sizes chosen by constraints: the rules of Maestro's variable-step algorithm, as pure arithmetic.

    control = StepSizes(constraints, memory, first=h, shortest=a, longest=b)
    h = control.proposed(t, values, room)      the next step, ns: at most `room`
    names = control.violated(values)           constraints whose tolerance the values at its end violate
    h = control.tightened()                    the shorter size for its repetition

`values` are the values of all ports, constraint by constraint. Sizes are stored in s as computed, and rounded to
nanoseconds for the step. `memory` contains all data that the future depends on. It belongs to the caller, who can copy
it in order to go back. A call of `proposed` accepts the previous step.

docs/masters.md describes each constraint. Sums of differences, factors and bounds are those of Maestro, including
the order in which they are computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim_master.system.settings.constraints import DIFFERENCE, SAMPLING, ZEROCROSSING, Constraint

__all__ = ["StepSizes"]

_RELAX_STRONGLY, _RELAX, _TIGHTEN, _TIGHTEN_STRONGLY, _REPEAT = 3.0, 1.2, 0.5, 0.01, 0.25
"""Factors of step sizes."""
_WELL_WITHIN = 0.5
"""Fraction of the tolerance of a zero crossing."""
_CLOSE, _NEAR, _FAR = 1.8, 3.0, 30.0
"""Steps to a zero crossing: up to the first, steps are tightened; beyond the others, relaxed and strongly relaxed."""
_BINS = ((0.2, _RELAX_STRONGLY), (0.4, _RELAX), (0.6, 1.0))
"""Fractions of the tolerance of a difference, divided by 1 + safety, and the step factors up to each of them."""
_PAST_WEIGHT = 0.7
"""Weight of the previous error of extrapolation, while the error decreases."""
_LEAST = 5e-324

_SIZE, _CONTINUOUS, _CUT, _POINTS = range(4)
"""Places in the memory: the current step, and the last one that no instant cut short, s; the cause that cut the current
one short; the number of points so far, up to 3.
"""
_HEAD = 4
_BY_NOTHING, _BY_SAMPLING, _BY_RUN = 0.0, 1.0, 2.0
"""Causes that cut a step short: none, a sampling instant, or the run (a row, a change, an event, its end, an FMU)."""
_X, _X1, _X2, _D1, _D2, _ERROR, _H1 = range(7)
"""Places of a port: its value now, one and two steps ago, its derivatives, its extrapolation error, the step before."""
_PORT = 7
_RULE = 1
"""Place of a constraint: the state of a zero crossing, or the step factor chosen for a difference."""
_APPROACHING, _DISTANCING, _CROSSED = 1.0, 2.0, 3.0


@dataclass(frozen=True, slots=True)
class _Past:
    """The last step: its size, the size of the last step that was not cut short, s, and the constraint that cut it.

    `points` is the number of known values of each port, including the current ones, up to 3.
    """

    size: float
    continuous: float
    cut: float
    points: int


@dataclass(frozen=True, slots=True)
class _Range:
    least: float
    most: float

    def held(self, size: float) -> float:
        return min(self.most, max(self.least, size))


class StepSizes:
    """The step sizes of one run.

    Args:
        memory: the memory of the constraints, of the size given by `memory_of`: zeros at the start of a run, the saved
            numbers when a run is resumed.
        first, shortest, longest: step sizes, ns.
    """

    def __init__(
        self, constraints: Sequence[Constraint], memory: NDArray[np.float64], *, first: int, shortest: int, longest: int
    ) -> None:
        self._memory = memory
        self._range = _Range(shortest / 1e9, longest / 1e9)
        self._first = self._tried = self._range.held(first / 1e9)
        self._rules: list[_ZeroCrossing | _Difference] = []
        self._samplings = [one for one in constraints if one.type == SAMPLING]
        place = _HEAD
        for one in constraints:
            own = memory[place : place + _RULE + _PORT * len(one.ports)]
            place += own.size
            if one.type == ZEROCROSSING:
                self._rules.append(_ZeroCrossing(one, own, self._range))
            elif one.type == DIFFERENCE:
                self._rules.append(_Difference(one, own, self._range))

    def proposed(self, t: int, values: Sequence[float], room: int) -> int:
        """Returns the next step [ns] from `t` [ns], at which the ports have these values; at most `room`."""
        memory = self._memory
        points = min(int(memory[_POINTS]) + 1, 3)
        if points == 1:
            memory[[_SIZE, _CONTINUOUS]] = self._first
        elif memory[_CUT] == _BY_NOTHING:
            memory[_CONTINUOUS] = memory[_SIZE]
        past = _Past(float(memory[_SIZE]), float(memory[_CONTINUOUS]), float(memory[_CUT]), points)
        memory[_POINTS] = points
        for rule, own in self._with_values(values):
            rule.advance(own, past)
        cut = _BY_NOTHING
        if points > 1:
            free = min((rule.suggested(past) for rule in self._rules), default=self._range.most)
            sampled = min((_to_sample(one, t) for one in self._samplings), default=math.inf)
            cut = _BY_SAMPLING if sampled < min(free, self._range.most) else _BY_NOTHING
            memory[_SIZE] = min(free, sampled, self._range.most)
        memory[_CUT] = cut
        self._tried = float(memory[_SIZE])
        h = max(1, round(1e9 * self._tried))
        return self.cut(room) if h > room else h

    def cut(self, h: int) -> int:
        """Records that the run cuts the step short to `h` ns; returns `h`."""
        self._tried = h / 1e9
        self._memory[_SIZE], self._memory[_CUT] = self._tried, _BY_RUN
        return h

    def violated(self, values: Sequence[float]) -> list[str]:
        """Returns the names of the constraints that a step violates if the ports have these values at its end."""
        return [rule.constraint.name for rule, own in self._with_values(values) if not rule.valid(own)]

    def tightened(self) -> int:
        """Returns the size [ns] that replaces the step tried last, which must not be the shortest.

        Except for the sizes, the memory may be as before that step was tried.
        """
        self._tried = max(self._tried * _REPEAT, self._range.least)
        self._memory[_SIZE] = self._tried
        if self._memory[_CUT] == _BY_RUN:
            self._memory[_CUT] = _BY_NOTHING
        return max(1, round(1e9 * self._tried))

    def _with_values(self, values: Sequence[float]) -> list[tuple[_ZeroCrossing | _Difference, Sequence[float]]]:
        found, place = [], 0
        for rule in self._rules:
            count = len(rule.constraint.ports)
            found.append((rule, values[place : place + count]))
            place += count
        return found


def _to_sample(one: Constraint, t: int) -> float:
    """Returns the time to the next sampling instant, s."""
    instant = one.first if t < one.first else one.first + ((t - one.first) // one.interval + 1) * one.interval
    return (instant - t) / 1e9


def _advance(port: NDArray[np.float64], x: float, past: _Past, order: int) -> None:
    """Adds a new value of a port: estimates its derivatives, and the accuracy of their prediction of this value."""
    h, before = past.size, float(port[_X])
    if past.points == 1:
        port[:] = 0.0
        port[_X] = x
        return
    foretold = before + float(port[_D1]) * h + (0.5 * float(port[_D2]) * h * h if order == 2 else 0.0)
    error, filtered = abs((x - foretold) / max(abs(x), _LEAST)), float(port[_ERROR])
    port[_ERROR] = error if error >= filtered else _PAST_WEIGHT * filtered + (1.0 - _PAST_WEIGHT) * error
    slope = (x - before) / h
    if past.points == 2:
        port[_D1], port[_D2] = slope, 0.0
    else:
        h1 = float(port[_H1])
        back = (float(port[_X1]) - before) / h1
        half = (slope + back) / (h + h1)
        port[_D1], port[_D2] = 2.0 * half * (h + h1) + (-back - half * h1), 2.0 * half
    port[_X2], port[_X1], port[_X], port[_H1] = port[_X1], before, x, h


class _ZeroCrossing:
    """A zero crossing of a port, or of the difference of two ports: steps end near it, within a tolerance."""

    def __init__(self, constraint: Constraint, memory: NDArray[np.float64], range: _Range) -> None:
        self.constraint, self._memory, self._range = constraint, memory, range
        self._ports = memory[_RULE:].reshape(-1, _PORT)

    def _of(self, column: int) -> float:
        ports = self._ports
        return float(ports[0, column] - ports[1, column]) if len(ports) == 2 else float(ports[0, column])

    def advance(self, values: Sequence[float], past: _Past) -> None:
        for port, value in zip(self._ports, values, strict=True):
            _advance(port, value, past, self.constraint.order)

    def valid(self, values: Sequence[float]) -> bool:
        now = self._of(_X)
        after = values[0] - values[1] if len(values) == 2 else values[0]
        if now * after <= 0.0:
            self._memory[0] = _CROSSED
            return not min(abs(now), abs(after)) > self.constraint.abstol
        self._memory[0] = _APPROACHING if abs(after) < abs(now) else _DISTANCING
        return True

    def suggested(self, past: _Past) -> float:
        """Returns the next step, s."""
        held, h, tolerance = self._range.held, past.continuous, self.constraint.abstol
        if self._memory[0] == _DISTANCING:
            return held(h * _RELAX_STRONGLY)
        distance = abs(self._of(_X))
        within = 2 if distance < tolerance * _WELL_WITHIN else 1 if distance < tolerance else 0
        if self._memory[0] == _CROSSED and self._oscillates(past):
            return (self._range.least, held(h * _TIGHTEN), h)[within]
        if within:
            return (h, held(h * _RELAX))[within - 1]
        if self._memory[0] == _CROSSED:
            return held(h * _TIGHTEN)
        steps = self._steps_to(past)
        if steps <= 1.0:
            return held(h * steps)
        if _NEAR >= steps > _CLOSE:
            return h
        return held(h * (_TIGHTEN if steps <= _CLOSE else _RELAX if steps <= _FAR else _RELAX_STRONGLY))

    def _oscillates(self, past: _Past) -> bool:
        """Returns whether the value has changed its sign twice and grows."""
        now, before, earlier = self._of(_X), self._of(_X1), self._of(_X2)
        return (
            past.points == 3 and now * before < 0.0 and now * earlier >= 0.0 and abs(earlier) < abs(before) < abs(now)
        )

    def _steps_to(self, past: _Past) -> float:
        """Returns the extrapolated number of steps of the last size until the value is zero."""
        cautious = 1.0 + self._of(_ERROR) + self.constraint.safety
        steps = self._parabola(past) if self.constraint.order == 2 and self._of(_D2) != 0.0 else self._line(past)
        return steps / cautious if cautious else math.inf

    def _line(self, past: _Past) -> float:
        steps = abs(self._of(_X)) / max(_LEAST, abs(self._of(_X) - self._of(_X1)))
        return steps * past.size / past.continuous if past.cut == _BY_RUN else steps

    def _parabola(self, past: _Past) -> float:
        p, q = 2.0 * self._of(_D1) / self._of(_D2), 2.0 * self._of(_X) / self._of(_D2)
        if not (under := p * p / 4.0 - q) >= 0.0:
            return math.inf
        if not math.isfinite(under):
            return self._line(past)
        roots = [root for root in (-p / 2.0 - math.sqrt(under), -p / 2.0 + math.sqrt(under)) if root > 0.0]
        return roots[0] / past.continuous if roots else math.inf


class _Difference:
    """A bounded difference of a port between two steps, or between several ports."""

    def __init__(self, constraint: Constraint, memory: NDArray[np.float64], range: _Range) -> None:
        self.constraint, self._memory, self._range = constraint, memory, range
        self._ports = memory[_RULE:].reshape(-1, _PORT)

    def advance(self, values: Sequence[float], past: _Past) -> None:
        for port, value in zip(self._ports, values, strict=True):
            port[_X1] = port[_X] if past.points > 1 else value
            port[_X] = value

    def valid(self, values: Sequence[float]) -> bool:
        absolute, relative = _spread([float(self._ports[0, _X]), values[0]] if len(values) == 1 else values)
        return not (absolute > self.constraint.abstol or relative > self.constraint.reltol)

    def suggested(self, past: _Past) -> float:
        """Returns the next step, s."""
        own, one = self.constraint, len(self._ports) == 1
        absolute, relative = _spread(self._ports[0, [_X, _X1]].tolist() if one else self._ports[:, _X].tolist())
        factor = min(_factor(absolute, own.abstol, own.safety), _factor(relative, own.reltol, own.safety))
        size = self._times(past.size, factor)
        if own.skip_discrete and past.cut != _BY_NOTHING:
            again = min(float(self._memory[0]) or 1.0, 1.0)
            if (repeated := self._times(past.continuous, again)) > size:
                size, factor = repeated, again
        self._memory[0] = factor
        return size

    def _times(self, size: float, factor: float) -> float:
        return size if factor == 1.0 else self._range.held(size * factor)


def _spread(values: Sequence[float]) -> tuple[float, float]:
    """Returns the span of the values, absolute and relative to their largest magnitude."""
    low, high = min(values), max(values)
    return high - low, (high - low) / max(abs(low), abs(high), _LEAST)


def _factor(difference: float, tolerance: float, safety: float) -> float:
    """Returns the factor for the next step size, given the part of the tolerance that a difference has reached."""
    for part, factor in _BINS:
        if difference <= tolerance * part * (1.0 / (1.0 + safety)):
            return factor
    return _TIGHTEN if difference <= tolerance else _TIGHTEN_STRONGLY
