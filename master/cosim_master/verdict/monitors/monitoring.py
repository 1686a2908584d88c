"""The observer of a run that evaluates its monitors.

It copies the monitored values at every communication point. Monitors that may end the run evaluate each copy at once,
the others some dozens together. The results do not depend on how copies are grouped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Packets, Seen
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.verdict.monitors.ages import AgeRule
from cosim_master.verdict.monitors.declared import (
    Age,
    Convergence,
    Fence,
    FormulaMonitor,
    Limit,
    Monitor,
    Monitors,
    Order,
    Separation,
    monitored,
)
from cosim_master.verdict.monitors.formations import OrderRule, SeparationRule
from cosim_master.verdict.monitors.rules import ConvergenceRule, FenceRule, FormulaRule, LimitRule, Rule, Samples

__all__ = ["Monitoring", "hears_packets"]

Array: TypeAlias = np.ndarray[Any, Any]

_LOOKS = 64
"""Instants that are evaluated together."""


def hears_packets(monitors: Monitors) -> bool:
    """Returns whether monitors need the events of the radio."""
    return any(isinstance(one, Age) for one in monitors.every)


class _Columns:
    """The monitored variables among the outputs, and the columns of their copies.

    64-bit integers occupy two places; their copies are floating-point numbers, as those of all others.
    """

    def __init__(self, layout: Layout, wanted: frozenset[tuple[str, str]]) -> None:
        reals, integers = layout.ports["Real"], layout.ports["Integer"]
        first = len(integers.outputs)
        self.of: dict[tuple[str, str], int] = {}
        self.reals = np.array([reals.index[one] for one in sorted(wanted & reals.index.keys())], np.int64)
        self.of |= {one: n for n, one in enumerate(sorted(wanted & reals.index.keys()))}
        places: list[int] = []
        wide = []
        for kind, ports in (("Integer", integers), ("Boolean", layout.ports["Boolean"])):
            for one in sorted(wanted & ports.index.keys()):
                place = ports.index[one]
                self.of[one] = len(self.reals) + len(places)
                places.append(place + (first if kind == "Boolean" else 0))
                wide.append(ports.outputs[place][1])
        self.integers = np.array(places, np.int64)
        self._wide = [(n, v.fmi_type) for n, v in enumerate(wide) if v.wide]

    @property
    def count(self) -> int:
        return len(self.of)

    def copy(self, seen: Seen, row: Array) -> None:
        """Copies the values."""
        reals = len(self.reals)
        if reals:
            np.take(seen.reals, self.reals, out=row[:reals])
        if len(self.integers):
            row[reals:] = seen.integers[self.integers]
            for n, kind in self._wide:
                place = self.integers[n]
                halves = seen.integers[place : place + 2]
                row[reals + n] = float(halves.view(np.uint64 if kind == "UInt64" else np.int64)[0])


class Monitoring:
    """Evaluates the monitors of a run.

    Args:
        monitors: those of the system; at least one.
        layout, network, clock: of the run.
        every: base steps between two rows of the recording.
        gridless: the master chooses its communication points; monitors then see the rows of the recording.

    Attributes:
        every, periods: the instants that it sees, see `observation.PointObserver`.
        prompt: whether it needs packets at each instant.
        rules: the evaluation of each monitor.
        end: the last instant seen, s.
    """

    def __init__(
        self,
        monitors: Monitors,
        layout: Layout,
        network: Network,
        clock: TimeGrid,
        *,
        every: int = 1,
        gridless: bool = False,
    ) -> None:
        self._clock = clock
        if monitors.interval is not None:
            self.periods: tuple[int, ...] = (max(1, round(monitors.interval / clock.seconds(1))),)
        else:
            self.periods = (every,) if gridless else clock.grids or (1,)
        self.every = min(self.periods)
        self.prompt = hears_packets(monitors)
        self._columns = _Columns(layout, monitored(monitors))
        nodes = [min(n, len(network.nodes)) for _, n in network.senders()]
        self._nodes = np.array(nodes, np.int64)
        self.rules: list[Rule] = [self._rule(one) for one in monitors.every]
        self._ending = [rule for rule in self.rules if rule.monitor.ends]
        self._waiting = [rule for rule in self.rules if not rule.monitor.ends]
        self._steps = np.zeros(_LOOKS + 1, np.int64)
        self._values = np.zeros((_LOOKS + 1, self._columns.count))
        self._used = self._new = 0
        self._seen_events = 0
        self.end = clock.time(0)

    def _rule(self, one: Monitor) -> Rule:
        place = self._columns.of.__getitem__
        if isinstance(one, Order):
            return OrderRule(one, place)
        if isinstance(one, Separation):
            return SeparationRule(one, place)
        if isinstance(one, Limit):
            return LimitRule(one, place)
        if isinstance(one, Fence):
            return FenceRule(one, place)
        if isinstance(one, Convergence):
            return ConvergenceRule(one, place)
        if isinstance(one, Age):
            return AgeRule(one, self._nodes, self._clock.time(0))
        assert isinstance(one, FormulaMonitor)
        return FormulaRule(one, place, self._clock.seconds(1), self._times)

    def _times(self, steps: Array) -> Array:
        times: Array = (self._clock.start + steps * self._clock.base) / (1e9 * self._clock.per_ns)
        return times

    # ---- the run -------------------------------------------------------------------------------------------------

    @property
    def over(self) -> bool:
        """True if a violation ends the run."""
        return any(rule.violations.subjects for rule in self._ending)

    def initialised(self, seen: Seen) -> None:
        """Handles the first instant of a run; a resumed one has seen the last instant before its checkpoint."""
        if self._used:
            self.end = seen.time
            return
        self._add(seen)
        self._look(self._ending, 0)

    def stepped(self, seen: Seen) -> None:
        """Copies the monitored values; monitors that may end the run are evaluated."""
        self._add(seen)
        self._look(self._ending, self._used - 1)
        if self._used - self._new >= _LOOKS:
            self._evaluate()

    def _add(self, seen: Seen) -> None:
        row, clock = self._used, self._clock
        self.end = seen.time
        self._steps[row] = round((seen.time * 1e9 * clock.per_ns - clock.start) / clock.base)
        self._columns.copy(seen, self._values[row])
        self._used += 1

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Notes the packets that were sent since the last call."""
        events = packets.events[self._seen_events :]
        self._seen_events = 0 if complete else len(packets.events)
        for rule in self.rules:
            if isinstance(rule, AgeRule) and len(events):
                rule.packets(events)

    def settle(self) -> None:
        """Evaluates all instants seen so far."""
        if self._used > self._new:
            self._evaluate()

    def _evaluate(self) -> None:
        """Evaluates the copied values. The last instant is kept, since motions go on from there."""
        self._look(self._waiting, self._new)
        last = self._used - 1
        self._steps[0], self._values[0] = self._steps[last], self._values[last]
        self._used = self._new = 1

    def _look(self, rules: Sequence[Rule], new: int) -> None:
        """Has rules look at the copied values from row `new` on, and at the one before."""
        if not rules:
            return
        first = max(0, new - 1)
        steps = self._steps[first : self._used]
        samples = Samples(steps, self._times(steps), self._values[first : self._used], new - first)
        for rule in rules:
            rule.look(samples)

    def closed(self) -> None:
        """Evaluates the remaining instants."""
        self.settle()

    # ---- checkpoints ---------------------------------------------------------------------------------------------

    def memory(self) -> dict[str, Any]:
        """Returns plain values for a checkpoint: the last instant seen, and those of each monitor by its name."""
        self.settle()
        return {
            "last": [int(self._steps[0]), self._values[0].tolist()],
            "rules": {rule.monitor.name: [rule.violations.memory(), rule.memory()] for rule in self.rules},
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Restores `memory`, before the first instant."""
        self._steps[0], self._values[0] = memory["last"]
        self._used = self._new = 1
        for rule in self.rules:
            violations, own = memory["rules"][rule.monitor.name]
            rule.violations.recall(violations)
            rule.recall(own)
