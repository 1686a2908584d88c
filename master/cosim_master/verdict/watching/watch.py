"""The observer that monitors a swarm: agents, vehicles, autopilots, bounds, distances, system ids.

Ten times per second of simulated time, it copies the outputs that FMUs have declared (`cosim.verdict`). After every few
dozen of these looks, it evaluates the copies. It does not depend on the names of models.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, TypeAlias

import numpy as np

from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Seen
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.verdict.earshot import depends_on_places, repeated, system_ids, twice
from cosim_master.verdict.findings import Finding
from cosim_master.verdict.prior import same_id
from cosim_master.verdict.watching.approach import FEW, Approach
from cosim_master.verdict.watching.limits import Limits
from cosim_master.verdict.watching.spells import Spells
from cosim_master.verdict.watching.subjects import Subjects

__all__ = ["Watch"]

Array: TypeAlias = np.ndarray[Any, Any]

_INTERVAL = 0.1
"""s of simulated time between two looks."""
_LOOKS = {False: 64, True: 10}
"""Looks that are evaluated together, for few vehicles and for many (`approach.FEW`)."""
_MOVED = 0.5
"""m from the start beyond which a vehicle that is not on the ground has flown."""
_LOW = 1.0
"""m by which the desired height of an autopilot must exceed that of a vehicle that has come down."""


class Watch:
    """Watches one run.

    Args:
        checked, network, layout, clock: the system.
        limits: the distances that are too near and too far.
    """

    def __init__(
        self, checked: CheckedSystem, network: Network, layout: Layout, clock: TimeGrid, limits: Limits
    ) -> None:
        self._network, self.limits = network, limits
        self._subjects = subjects = Subjects(checked, layout)
        self.bodies, self.pilots = subjects.bodies, subjects.pilots
        self.agents, self.limited = subjects.agents, subjects.limited
        columns = subjects.columns
        self._ids = system_ids(checked, network)
        self._nodes: list[int] = []
        if repeated(self._ids) and depends_on_places(network) and all(node.position for node in network.nodes):
            places_of = [(i, v.name) for node in network.nodes for i, v in node.position]
            self._nodes = [columns.of(instance, name)[1] for instance, name in places_of]
        self.double: dict[int, Finding] = {}
        wanted = columns.reals or columns.integers
        self.every = max(1, round(_INTERVAL / clock.seconds(1))) if wanted else 0
        self.approach = Approach(len(self.bodies), limits.contact)
        self.away, self.down = Spells(len(self.pilots)), Spells(len(self.bodies))
        self.outside = Spells(len(self.limited))
        self._rows = _LOOKS[len(self.bodies) > FEW]
        self._states, self._armed = _places(subjects.states), _places(subjects.armed)
        self._positions, self._desired = _places(subjects.positions), _places(subjects.desired)
        self._ground, self._driven = _places(subjects.ground), _places([pilot.body for pilot in self.pilots])
        self._has_ground = np.array([body.has_ground for body in self.bodies], dtype=bool)
        self._has_desired = np.array([pilot.has_desired for pilot in self.pilots], dtype=bool)
        self._has_armed = np.array([pilot.has_armed for pilot in self.pilots], dtype=bool)
        self._unarmed = self._has_armed.copy()  # those that have not been seen armed
        self._known: Array | None = None  # the last states of agents
        self._bounds = [_Bounds(subjects, is_real) for is_real in (True, False)]
        self._real_places = np.array(columns.reals, dtype=np.intp)
        self._integer_places = np.array(columns.integers, dtype=np.intp)
        self._times = np.zeros(self._rows)
        # One column at least: what a vehicle or an autopilot lacks has the place 0, and is not used.
        self._reals = np.zeros((self._rows, max(1, len(self._real_places))))
        self._integers = np.zeros((self._rows, max(1, len(self._integer_places))), dtype=np.int32)
        self._used = 0
        self.start: Array | None = None
        self.recalled = False  # whether it continues from the findings before a checkpoint
        self.begin = self.end = clock.time(0)

    def initialised(self, seen: Seen) -> None:
        """Handles the first look of a run, or of a resumed run."""
        if not self.recalled:
            self.begin = seen.time
        self.stepped(seen)

    def stepped(self, seen: Seen) -> None:
        """Copies the watched values."""
        row = self._used
        self._times[row] = self.end = seen.time
        np.take(seen.reals, self._real_places, out=self._reals[row, : len(self._real_places)])
        np.take(seen.integers, self._integer_places, out=self._integers[row, : len(self._integer_places)])
        self._used += 1
        if self._used == self._rows:
            self.settle()

    def closed(self) -> None:
        """Evaluates the remaining instants."""
        if self._used:
            self._look()
            self._used = 0

    def settle(self) -> None:
        """Evaluates the copied values. The last look is kept, since the next motions begin there."""
        if self._used:
            self._look()
            for kept in (self._times, self._reals, self._integers):
                kept[0] = kept[self._used - 1]
            self._used = 1

    def _look(self) -> None:
        n = self._used
        times, reals, integers = self._times[:n], self._reals[:n], self._integers[:n]
        self._look_at_agents(times, integers)
        positions = reals[:, self._positions].reshape(n, -1, 3)
        higher = None
        if self.bodies:
            flown = self._look_at_bodies(positions, integers)
            self.approach.look(times, positions)
        if self.pilots:
            higher = self._look_at_pilots(times, positions, reals, integers)
        if self.bodies:
            down = (integers[:, self._ground] != 0) & flown & self._has_ground
            if down.any():
                down &= self._wanted(integers, higher)
            self.down.look(times, down, down)
        if self.limited:
            self._look_at_limits(times, reals, integers)
        if self._nodes:
            self._listen(float(times[0]), reals[0, self._nodes].reshape(-1, 3))

    def _look_at_agents(self, times: Array, integers: Array) -> None:
        all_states = integers[:, self._states]
        if self._known is None:
            self._known = np.array([agent.last for agent in self.agents], dtype=np.int32)
        for a in map(int, np.flatnonzero((all_states != self._known).any(axis=0))):
            agent, states = self.agents[a], all_states[:, a].tolist()
            agent.last = states[-1]
            for values, what in ((agent.condition.failed, "failed"), (agent.condition.working, "began")):
                row = _first(states, values)
                if row >= 0 and math.isnan(getattr(agent, what)):
                    setattr(agent, what, float(times[row]))
                    if what == "failed" and self._subjects.reasons[a] >= 0:
                        agent.reason = int(integers[row, self._subjects.reasons[a]])
            row = _first(states, agent.condition.commanding)
            if agent.body >= 0 and row >= 0:
                self._command(agent.body, float(times[row]), agent.instance.name)
        self._known = all_states[-1].copy()

    def _command(self, body: int, time: float, by: str) -> None:
        if math.isnan(self.bodies[body].commanded):
            self.bodies[body].commanded, self.bodies[body].by = time, by

    def _look_at_bodies(self, positions: Array, integers: Array) -> Array:
        """Evaluates the vehicles. Returns for each look which of them have flown by then."""
        if self.start is None:
            self.start = positions[0].copy()
        flown = np.tile(np.array([body.flew for body in self.bodies], dtype=bool), (len(positions), 1))
        waiting = np.flatnonzero(~flown[0])
        if not waiting.size:
            return flown
        aloft = _length(positions[:, waiting] - self.start[waiting]) > _MOVED
        has_ground = np.flatnonzero(self._has_ground[waiting])
        aloft[:, has_ground] &= integers[:, np.array(self._subjects.ground)[waiting[has_ground]]] == 0
        for b in waiting[aloft.any(axis=0)]:
            self.bodies[b].flew = True
        flown[:, waiting] = np.maximum.accumulate(aloft, axis=0)
        return flown

    def _look_at_pilots(self, times: Array, positions: Array, reals: Array, integers: Array) -> Array:
        """Evaluates the autopilots. Returns for each look which of them are armed and want to be higher."""
        armed = (integers[:, self._armed] != 0) | ~self._has_armed
        seen = armed.any(axis=0) & self._unarmed
        for p in map(int, np.flatnonzero(seen)):
            self._command(self.pilots[p].body, float(times[int(armed[:, p].argmax())]), self.pilots[p].instance)
        self._unarmed &= ~seen
        desired = reals[:, self._desired].reshape(len(times), -1, 3)
        actual = positions[:, self._driven]
        away = _length(desired - actual)
        away[:, ~self._has_desired] = 0.0
        self.away.look(times, armed & (away > self.limits.deviation), away)
        higher: Array = armed & (away > 0.0) & (actual[:, :, 2] - desired[:, :, 2] > _LOW)
        return higher

    def _wanted(self, integers: Array, higher: Array | None) -> Array:
        """Returns for each look which vehicles are expected to be in the air.

        Args:
            higher: for each look, which autopilots are armed and want to be higher; None if there are none.
        """
        wanted = np.zeros((len(integers), len(self.bodies)), dtype=bool)
        for values in {agent.condition.commanding for agent in self.agents if agent.body >= 0} - {()}:
            of = [a for a, one in enumerate(self.agents) if one.body >= 0 and one.condition.commanding == values]
            commanding = np.isin(integers[:, np.array(self._subjects.states)[of]], values)
            np.logical_or.at(wanted.T, [self.agents[a].body for a in of], commanding.T)  # several may have one body
        if higher is not None:
            for p in map(int, np.flatnonzero(higher.any(axis=0))):
                wanted[:, self.pilots[p].body] |= higher[:, p]
        return wanted

    def _look_at_limits(self, times: Array, reals: Array, integers: Array) -> None:
        of_kind = [bounds.excess(values) for bounds, values in zip(self._bounds, (reals, integers), strict=True)]
        if not any((excess > 0.0).any() for excess in of_kind) and not self.outside.open.any():
            return
        excess = np.zeros((len(times), len(self.limited)))
        for bounds, found in zip(self._bounds, of_kind, strict=True):
            excess[:, bounds.numbers] = found
        outside = excess > 0.0
        tied = [n for n, one in enumerate(self.limited) if one.agent >= 0]
        if tied:
            outside[:, tied] &= self._working(integers)[:, [self.limited[n].agent for n in tied]]
        self.outside.look(times, outside, excess)

    def _working(self, integers: Array) -> Array:
        """Returns whether each agent is active at each look; an agent without a declaration is always active."""
        working = np.ones((len(integers), len(self.agents)), dtype=bool)
        for values in {agent.condition.working for agent in self.agents} - {()}:
            of = [a for a, agent in enumerate(self.agents) if agent.condition.working == values]
            working[:, of] = np.isin(integers[:, [self._subjects.states[a] for a in of]], values)
        return working

    def _listen(self, time: float, places: Array) -> None:
        for one in twice(self._network, self._ids, places):
            if one.system_id not in self.double:
                self.double[one.system_id] = same_id(one.system_id, one.nodes, one.listener, time)

    # ---- results -------------------------------------------------------------------------------------------------

    @property
    def hears_by_place(self) -> bool:
        """True if the watch has checked the reachability of nodes with the same system id."""
        return bool(self._nodes)


class _Bounds:
    """The bounds of values of one kind: their numbers among all bounds, and what they apply to."""

    def __init__(self, subjects: Subjects, is_real: bool) -> None:
        of_kind = [(n, column) for n, (real, column) in enumerate(subjects.values) if real == is_real]
        self.numbers = np.array([n for n, _ in of_kind], dtype=np.intp)
        self._columns = _places([column for _, column in of_kind])
        self._least = np.array([subjects.limited[n].least for n in self.numbers])
        self._most = np.array([subjects.limited[n].most for n in self.numbers])

    def excess(self, values: Array) -> Array:
        """Returns by how much each value is outside its bounds at each look; not positive inside."""
        mine = values[:, self._columns]
        with np.errstate(invalid="ignore"):  # an infinite value with an infinite bound
            excess: Array = np.maximum(mine - self._most, self._least - mine)
        return excess


def _places(indices: Sequence[int]) -> Any:
    """Returns an index that selects these columns: a slice, which copies nothing, if they are evenly spaced."""
    if len(indices) < 2:
        return np.array(indices, dtype=np.intp)
    steps = np.diff(indices)
    if steps[0] > 0 and (steps == steps[0]).all():
        return slice(indices[0], indices[-1] + 1, int(steps[0]))
    return np.array(indices, dtype=np.intp)


def _length(vectors: Array) -> Array:
    """Returns the lengths of vectors (..., 3)."""
    length: Array = np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2 + vectors[..., 2] ** 2)
    return length


def _first(states: Sequence[int], values: Collection[int]) -> int:
    """Returns the index of the first state that is among the values, -1 without one; numpy takes ten times as long."""
    return next((row for row, state in enumerate(states) if state in values), -1)
