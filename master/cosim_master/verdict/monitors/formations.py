"""Monitors of vehicles in relation to each other: their order along an axis, and their distances."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from cosim_master.verdict.monitors.declared import NEAR, Order, Separation
from cosim_master.verdict.monitors.rules import Place, Samples, judge
from cosim_master.verdict.monitors.violations import Violations
from cosim_master.verdict.watching.approach import FEW, box, closest, pairs_within

__all__ = ["OrderRule", "SeparationRule"]

Array: TypeAlias = np.ndarray[Any, Any]

_MARGIN = 1.0
"""m beyond the least separation within which pairs of vehicles are looked at again without a new search."""
_AWAY = 1e9
"""m between vehicles whose positions are not numbers, and from all others."""


class OrderRule:
    """Vehicles in the order along an axis that they have at the first instant judged.

    Its subjects are the vehicles next to each other in this order: if all of these keep it, then all vehicles do.
    """

    def __init__(self, monitor: Order, place: Place) -> None:
        self.monitor, self.violations = monitor, Violations()
        self._columns = np.array([[place(one) for one in vehicle.variables] for vehicle in monitor.vehicles])
        self._axis = np.array(monitor.axis)
        self._order: Array | None = None

    def look(self, samples: Samples) -> None:
        one, times = self.monitor, samples.times[samples.new :]
        judged = np.flatnonzero(times >= one.start - NEAR)
        if not judged.size:
            return
        places = samples.values[samples.new :][:, self._columns]
        along = sum(places[:, :, axis] * part for axis, part in enumerate(self._axis))
        if self._order is None:
            self._order = np.argsort(along[judged[0]], kind="stable")
        apart = np.diff(along[:, self._order], axis=1)
        judge(one, self.violations, times, one.least - apart, apart)

    def who(self, subject: int) -> tuple[str, ...]:
        assert self._order is not None
        return tuple(self.monitor.vehicles[i].name for i in self._order[subject : subject + 2])

    def told(self, subject: int, worst: float) -> str:
        first, second = self.who(subject)
        if np.isnan(worst):
            return f"the position of {first} or {second} was not a number"
        if worst < 0.0:
            return f"{second} was {-worst:.4g} m before {first}, which it was to follow"
        return f"{second} was only {worst:.4g} m after {first}, less than {self.monitor.least:g} m"

    def memory(self) -> Any:
        return None if self._order is None else [self.monitor.vehicles[i].name for i in self._order]

    def recall(self, memory: Any) -> None:
        if memory is not None:
            number = {vehicle.name: n for n, vehicle in enumerate(self.monitor.vehicles)}
            self._order = np.array([number[name] for name in memory])


class SeparationRule:
    """The distances of all pairs of vehicles; between two instants, a vehicle is assumed to fly straight.

    Only pairs that can have come too near are looked at (`verdict.watching.approach`), so that the cost grows as
    the number of vehicles does. They are searched anew when a vehicle has moved by more than half of a margin.
    A subject is a pair of vehicles, first * count + second; count * count + i stands for a vehicle whose position is
    not a number.
    """

    def __init__(self, monitor: Separation, place: Place) -> None:
        self.monitor, self.violations = monitor, Violations()
        self._columns = np.array([[place(one) for one in vehicle.variables] for vehicle in monitor.vehicles])
        self._count = len(monitor.vehicles)
        self._pairs: tuple[Array, Array] = np.triu_indices(self._count, 1)
        self._boxes: tuple[Array, Array] | None = None

    def look(self, samples: Samples) -> None:
        one, points = self.monitor, samples.values[:, self._columns]
        times = samples.times[samples.new :]
        if not samples.new:
            points = np.concatenate([points[:1], points])
        missing = np.asarray(np.isnan(points).any(axis=2))
        judge(one, self.violations, times, np.where(missing, np.nan, 0.0)[1:], np.where(missing, np.nan, 0.0)[1:],
              numbers=range(self._count**2, self._count**2 + self._count))  # fmt: skip
        if missing.any():
            points = np.where(missing[:, :, None], _AWAY * (1.0 + np.arange(self._count))[:, None], points)
        first, second = self._near(points)
        distance, _ = closest(points[:, first], points[:, second])
        low = np.flatnonzero((distance < one.least).any(axis=0))
        numbers = [*map(int, first[low] * self._count + second[low])]
        ended = [n for n in self.violations.open if n < self._count**2 and n not in numbers]
        if numbers or ended:
            apart = np.concatenate([distance[:, low], np.full((len(times), len(ended)), np.inf)], axis=1)
            judge(one, self.violations, times, one.least - apart, apart, numbers=[*numbers, *ended])

    def who(self, subject: int) -> tuple[str, ...]:
        names = [vehicle.name for vehicle in self.monitor.vehicles]
        if subject >= self._count**2:
            return (names[subject - self._count**2],)
        return names[subject // self._count], names[subject % self._count]

    def told(self, subject: int, worst: float) -> str:
        who = self.who(subject)
        if len(who) == 1:
            return f"the position of {who[0]} was not a number"
        return f"{who[0]} and {who[1]} were {worst:.4g} m apart, less than {self.monitor.least:g} m"

    def memory(self) -> Any:
        return None

    def recall(self, memory: Any) -> None: ...

    def _near(self, points: Array) -> tuple[Array, Array]:
        """Returns the pairs that may have come too near; all pairs of few vehicles."""
        if self._count <= FEW:
            return self._pairs
        middle, half = box(points)
        if self._boxes is not None:
            moved = np.abs(middle - self._boxes[0]).max(axis=1) + half - self._boxes[1]
            if float(moved.max()) <= 0.5 * _MARGIN:
                return self._pairs
        found = [*pairs_within(middle, half, self.monitor.least + _MARGIN)]
        self._pairs = np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])
        self._boxes = middle, half
        return self._pairs
