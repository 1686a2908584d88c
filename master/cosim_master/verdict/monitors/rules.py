"""Monitors over sampled signals: limits, fences, convergence envelopes and formulas.

Each rule computes by how much each of its subjects exceeds its limit, for all instants of a chunk at once. A value on
the limit is allowed; a value that is not a number (NaN) exceeds every limit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from cosim_master.verdict.monitors.declared import NEAR, Convergence, Fence, FormulaMonitor, Limit, Monitor, Signal
from cosim_master.verdict.monitors.formula import TIME
from cosim_master.verdict.monitors.temporal import Evaluation
from cosim_master.verdict.monitors.violations import Violations

__all__ = ["ConvergenceRule", "FenceRule", "FormulaRule", "LimitRule", "NEAR", "Place", "Rule", "Samples", "judge"]

Array: TypeAlias = np.ndarray[Any, Any]
Place: TypeAlias = Callable[[tuple[str, str]], int]
"""The column of a variable (instance, variable) in `Samples.values`."""


class Samples:
    """A chunk of instants.

    Attributes:
        steps: (n,) numbers of base steps.
        times: (n,) s.
        values: (n, columns) of all variables that monitors need.
        new: the first instant that is new; those before it are the last ones of the chunk before.
    """

    def __init__(self, steps: Array, times: Array, values: Array, new: int) -> None:
        self.steps, self.times, self.values, self.new = steps, times, values, new


class Rule(Protocol):
    """The evaluation of one monitor.

    Attributes:
        violations: those found so far, by number of subject.
    """

    violations: Violations

    @property
    def monitor(self) -> Monitor:
        """The monitor that is evaluated."""

    def look(self, samples: Samples) -> None:
        """Evaluates further instants."""

    def who(self, subject: int) -> tuple[str, ...]:
        """Returns the names of a subject."""

    def told(self, subject: int, worst: float) -> str:
        """Returns the violation of a subject in words, without its times; `worst` is the measured value."""

    def memory(self) -> Any:
        """Returns plain values for a checkpoint, beside those of `violations`."""

    def recall(self, memory: Any) -> None:
        """Restores `memory`."""


def judge(
    monitor: Monitor,
    violations: Violations,
    times: Array,
    excess: Array,
    values: Array,
    outside: Array | None = None,
    numbers: Sequence[int] = (),
) -> None:
    """Adds instants to the violations, as far as the monitor judges them.

    Args:
        times: (n,) s.
        excess: (n, subjects) by how much a subject exceeds its limit; NaN counts as infinitely much.
        values: (n, subjects) the measured values.
        outside: (n, subjects) whether a subject is in violation; None: if its excess is positive.
        numbers: (subjects,) numbers of the subjects; empty: from 0 on.
    """
    excess = np.where(np.isnan(excess), np.inf, excess)
    outside = excess > 0.0 if outside is None else outside
    numbers = numbers or range(excess.shape[1])
    within = (times >= monitor.start - NEAR) & (times <= monitor.stop + NEAR)
    if within.all():
        violations.look(times, numbers, outside, excess, values)
        return
    violations.look(times[within], numbers, outside[within], excess[within], values[within])
    if times[-1] > monitor.stop + NEAR:
        violations.close(monitor.stop, numbers)


def values_of(signals: tuple[Signal, ...], place: Place) -> Callable[[Array], Array]:
    """Returns a function that computes signals: from (n, columns) to (n, signals)."""
    quantity, sizes = signals[0].quantity, {len(one.variables) for one in signals}
    columns = [[place(variable) for variable in one.variables] for one in signals]
    if quantity == "value":
        flat = np.array(columns)[:, 0]
        return lambda values: values[:, flat]
    if quantity == "tilt":
        w, x, y, z = np.array(columns).T
        return lambda values: (
            2.0 * np.arctan2(np.hypot(values[:, x], values[:, y]), np.hypot(values[:, w], values[:, z]))
        )
    if len(sizes) == 1:
        some = np.array(columns)
        return lambda values: np.sqrt((values[:, some] ** 2).sum(axis=2))
    each = [np.array(one) for one in columns]
    return lambda values: np.stack([np.sqrt((values[:, one] ** 2).sum(axis=1)) for one in each], axis=1)


class _Sampled:
    """A rule whose subjects are the signals of a monitor."""

    def __init__(self, signals: tuple[Signal, ...], place: Place) -> None:
        self.violations = Violations()
        self._signals, self._values = signals, values_of(signals, place)

    def who(self, subject: int) -> tuple[str, ...]:
        return (self._signals[subject].name,)

    def memory(self) -> Any:
        return None

    def recall(self, memory: Any) -> None: ...


class LimitRule(_Sampled):
    """Signals between two limits."""

    def __init__(self, monitor: Limit, place: Place) -> None:
        super().__init__(monitor.signals, place)
        self.monitor = monitor

    def look(self, samples: Samples) -> None:
        values = self._values(samples.values[samples.new :])
        excess = np.maximum(values - self.monitor.most, self.monitor.least - values)
        judge(self.monitor, self.violations, samples.times[samples.new :], excess, values)

    def told(self, subject: int, worst: float) -> str:
        signal, one = self._signals[subject], self.monitor
        unit = f" {signal.unit}" if signal.unit else ""
        what = {"value": "was", "magnitude": "had the magnitude", "tilt": "was tilted by"}[signal.quantity]
        if np.isnan(worst):
            return f"{signal.name} was not a number"
        side = f"less than {one.least:g}" if worst < one.least else f"more than {one.most:g}"
        return f"{signal.name} {what} {worst:.4g}{unit}, {side}{unit}"


class ConvergenceRule(_Sampled):
    """Signals within an exponential envelope around their goals."""

    def __init__(self, monitor: Convergence, place: Place) -> None:
        super().__init__(monitor.signals, place)
        self.monitor = monitor
        self._goals = np.array(monitor.goals)

    def look(self, samples: Samples) -> None:
        one, times = self.monitor, samples.times[samples.new :]
        values = self._values(samples.values[samples.new :])
        since = np.maximum(times - one.start, 0.0)
        allowed = one.amplitude * np.exp(-since / one.time) + one.floor
        away = np.abs(values - self._goals)
        judge(one, self.violations, times, away - allowed[:, None], away)

    def told(self, subject: int, worst: float) -> str:
        signal, goal = self._signals[subject], self._goals[subject]
        unit = f" {signal.unit}" if signal.unit else ""
        if np.isnan(worst):
            return f"{signal.name} was not a number"
        return f"{signal.name} was {worst:.4g}{unit} from its goal {goal:g}{unit}, more than its envelope allows"


class FenceRule:
    """Vehicles inside of a circle or polygon, and between two heights."""

    def __init__(self, monitor: Fence, place: Place) -> None:
        self.monitor, self.violations = monitor, Violations()
        self._columns = np.array([[place(one) for one in vehicle.variables] for vehicle in monitor.vehicles])
        self._corners = np.array(monitor.polygon).reshape(-1, 2)

    def look(self, samples: Samples) -> None:
        one, places = self.monitor, samples.values[samples.new :][:, self._columns]
        north, east, height = places[:, :, 0], places[:, :, 1], -places[:, :, 2]
        if len(self._corners):
            beyond = _beyond(north, east, self._corners)
        else:
            beyond = np.hypot(north - one.centre[0], east - one.centre[1]) - one.radius
        excess = np.maximum(beyond, np.maximum(height - one.ceiling, one.floor - height))
        judge(one, self.violations, samples.times[samples.new :], excess, excess)

    def who(self, subject: int) -> tuple[str, ...]:
        return (self.monitor.vehicles[subject].name,)

    def told(self, subject: int, worst: float) -> str:
        name = self.monitor.vehicles[subject].name
        return f"the position of {name} was not a number" if np.isnan(worst) else f"{name} was {worst:.4g} m outside"

    def memory(self) -> Any:
        return None

    def recall(self, memory: Any) -> None: ...


def _beyond(north: Array, east: Array, corners: Array) -> Array:
    """Returns the distance to the border of a polygon [m]: positive outside, negative inside (even-odd rule)."""
    inside = np.zeros(north.shape, bool)
    square = np.full(north.shape, np.inf)
    for (n0, e0), (n1, e1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        dn, de = n1 - n0, e1 - e0
        length = dn * dn + de * de
        part = np.clip(((north - n0) * dn + (east - e0) * de) / length, 0.0, 1.0) if length > 0.0 else 0.0
        square = np.minimum(square, (n0 + part * dn - north) ** 2 + (e0 + part * de - east) ** 2)
        if dn != 0.0:
            crosses = (n0 > north) != (n1 > north)
            inside ^= crosses & (east < e0 + (north - n0) * (de / dn))
    distance = np.sqrt(square)
    return np.where(np.isnan(north + east), np.nan, np.where(inside, -distance, distance))


class FormulaRule:
    """A formula of temporal logic.

    Its subjects are the conjuncts of the formula for each column of its signals, and these columns themselves: an
    instant at which a signal is not a number is a violation.

    Args:
        base: length of a base step, s.
        at: returns the times of base steps, s.
    """

    def __init__(self, monitor: FormulaMonitor, place: Place, base: float, at: Callable[[Array], Array]) -> None:
        self.monitor, self.violations, self._at = monitor, Violations(), at
        self._values = {name: values_of(signals, place) for name, signals in monitor.signals.items()}
        self._width = max((len(signals) for signals in monitor.signals.values()), default=1)
        self._evaluations = [Evaluation(node, base) for _, node in monitor.formula.conjuncts]

    def look(self, samples: Samples) -> None:
        new = slice(samples.new, None)
        times = samples.times[new]
        signals: dict[str, Array] = {name: of(samples.values[new]) for name, of in self._values.items()}
        given = {**signals, TIME: times[:, None]}
        for n, evaluation in enumerate(self._evaluations):
            steps, holds, robustness = evaluation.push(samples.steps[new], given)
            self._judge(n, self._at(steps), ~holds, robustness)
        if signals:
            invalid = np.zeros((len(times), self._width), bool)
            for values in signals.values():
                invalid |= np.isnan(values)
            self._judge(len(self._evaluations), times, invalid, np.where(invalid, np.nan, 0.0))

    def _judge(self, part: int, times: Array, outside: Array, robustness: Array) -> None:
        if not len(times):
            return
        shape = (len(times), self._width)
        outside, robustness = np.broadcast_to(outside, shape), np.broadcast_to(robustness, shape)
        numbers = range(part * self._width, (part + 1) * self._width)
        judge(self.monitor, self.violations, times, -robustness, robustness, outside, numbers)

    def who(self, subject: int) -> tuple[str, ...]:
        column = subject % self._width
        names = {of[column if len(of) > 1 else 0].name: None for of in self.monitor.signals.values()}
        return tuple(names) or (self.monitor.name,)

    def told(self, subject: int, worst: float) -> str:
        part, whole = subject // self._width, ", ".join(self.who(subject))
        if part == len(self._evaluations):
            return f"a signal was not a number: {whole}"
        text, _ = self.monitor.formula.conjuncts[part]
        return f"{text} was false for {whole}, by {abs(worst):.4g}" if self.monitor.signals else f"{text} was false"

    def memory(self) -> Any:
        return [evaluation.memory() for evaluation in self._evaluations]

    def recall(self, memory: Any) -> None:
        for evaluation, values in zip(self._evaluations, memory, strict=True):
            evaluation.recall(values)
