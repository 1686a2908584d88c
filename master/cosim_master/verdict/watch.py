"""The observer that monitors a swarm: agents, vehicles, autopilots, bounds, distances, system ids.

Ten times per second of simulated time, it copies the outputs that FMUs have declared (`cosim.verdict`). After every few
dozen of these looks, it evaluates the copies. It does not depend on the names of models.

A vehicle is an instance with a position. Its autopilot is the instance that drives it. If no instance drives a vehicle
directly, the autopilot and the agent belong to the only vehicle in the same system.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from cosim.verdict import Bound, Condition, Reason, Role, Rotors
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Seen
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.verdict.approach import FEW, Approach
from cosim_master.verdict.earshot import depends_on_places, repeated, system_ids, twice
from cosim_master.verdict.findings import Finding, Number
from cosim_master.verdict.limits import Limits
from cosim_master.verdict.prior import same_id
from cosim_master.verdict.spells import Spells

__all__ = ["Watch", "watched"]

Array: TypeAlias = np.ndarray[Any, Any]

_INTERVAL = 0.1
"""s of simulated time between two looks."""
_LOOKS = {False: 64, True: 10}
"""Looks that are evaluated together, for few vehicles and for many (`approach.FEW`)."""
_PATIENCE = 10.0
"""s for which a vehicle may remain at its place after a command."""
_MOVED = 0.5
"""m from the start beyond which a vehicle that is not on the ground has flown."""
_AWAY = 3.0
"""s for which a vehicle may be farther than `Limits.deviation` from its desired position, or on the ground."""
_LOW = 1.0
"""m by which the desired height of an autopilot must exceed that of a vehicle that has come down."""
_LATE = 1.0
"""s by which an agent may begin its work late."""


def watched(checked: CheckedSystem) -> frozenset[tuple[str, str]]:
    """Returns all outputs that the watch needs, as pairs of instance and variable."""
    return frozenset(
        (instance.name, element)
        for instance in checked.instances
        for name, verdict in instance.fmu.verdicts.items()
        if not isinstance(verdict, Rotors) and verdict not in (Role.SYSTEM_ID, Role.OPTIONAL, Role.ATTITUDE)
        for element in elements_of(name, instance.fmu.variables)
    )


@dataclass(slots=True)
class _Agent:
    """An instance that declares its activity."""

    instance: ComponentInstance
    variable: str
    condition: Condition
    body: int
    by: float
    failed: float = math.nan
    reason: int = 0
    began: float = math.nan
    last: int = -(2**31)
    """The last state observed; no valid state before the first look."""

    def text_of(self, value: int) -> str:
        items = self.instance.fmu.variables[self.variable].items or {}
        return next((name for name, number in items.items() if number == value), str(value))

    def why(self) -> str:
        """Returns the reason in the words of the declaration, or otherwise the name of the enumeration item."""
        name = self.condition.reason
        if not name:
            return ""
        verdict = self.instance.fmu.verdicts.get(name)
        texts = dict(verdict.texts) if isinstance(verdict, Reason) else {}
        items = {number: item for item, number in (self.instance.fmu.variables[name].items or {}).items()}
        item = items.get(self.reason, str(self.reason))
        return f"{texts[self.reason]} ({name}: {item})" if self.reason in texts else f"{name}: {item}"


@dataclass(slots=True)
class _Body:
    """A vehicle."""

    instance: str
    group: str
    has_ground: bool
    commanded: float = math.nan
    by: str = ""
    flew: bool = False


@dataclass(slots=True)
class _Pilot:
    """An instance that outputs whether it is armed, the desired position of its vehicle, or both."""

    instance: str
    body: int
    has_armed: bool
    has_desired: bool


@dataclass(slots=True)
class _Limit:
    """A bound that applies in this system."""

    instance: str
    variable: str
    least: float
    most: float
    bound: Bound
    agent: int
    unit: str


@dataclass(slots=True)
class _Columns:
    """Indices of the watched values among the outputs, by kind; the copies have one column for each of them."""

    reals: list[int] = field(default_factory=list)
    integers: list[int] = field(default_factory=list)

    def of(self, places: Layout, instance: str, name: str) -> tuple[bool, int]:
        """Returns whether the variable is a real, and its column."""
        for kind in ("Real", "Integer", "Boolean"):
            index = places.ports[kind].index.get((instance, name))
            if index is None:
                continue
            if kind == "Real":
                self.reals.append(index)
                return True, len(self.reals) - 1
            self.integers.append(index + (len(places.ports["Integer"].outputs) if kind == "Boolean" else 0))
            return False, len(self.integers) - 1
        raise KeyError(f"{instance}.{name} is not fetched")


class Watch:
    """Watches one run.

    Args:
        checked, network, clock: the system.
        limits: the distances that are too near and too far.
    """

    def __init__(
        self, checked: CheckedSystem, network: Network, places: Layout, clock: TimeGrid, limits: Limits
    ) -> None:
        self._network, self._limits = network, limits
        self._columns = _Columns()
        self.bodies: list[_Body] = []
        self.pilots: list[_Pilot] = []
        self.agents: list[_Agent] = []
        self.limited: list[_Limit] = []
        self._positions: list[int] = []
        self._ground: list[int] = []
        self._armed: list[int] = []
        self._desired: list[int] = []
        self._states: list[int] = []
        self._reasons: list[int] = []
        self._values: list[tuple[bool, int]] = []
        self._find(checked, places)
        self._ids = system_ids(checked, network)
        self._nodes: list[int] = []
        if repeated(self._ids) and depends_on_places(network) and all(node.position for node in network.nodes):
            places_of = [(i, v.name) for node in network.nodes for i, v in node.position]
            self._nodes = [self._columns.of(places, instance, name)[1] for instance, name in places_of]
        self.double: dict[int, Finding] = {}
        wanted = self._columns.reals or self._columns.integers
        self.every = max(1, round(_INTERVAL / clock.seconds(1))) if wanted else 0
        self.approach = Approach(len(self.bodies), limits.contact)
        self.away, self.down = Spells(len(self.pilots)), Spells(len(self.bodies))
        self.outside = Spells(len(self.limited))
        self._rows = _LOOKS[len(self.bodies) > FEW]
        self._real_places = np.array(self._columns.reals, dtype=np.intp)
        self._integer_places = np.array(self._columns.integers, dtype=np.intp)
        self._times = np.zeros(self._rows)
        self._reals = np.zeros((self._rows, len(self._real_places)))
        self._integers = np.zeros((self._rows, len(self._integer_places)), dtype=np.int32)
        self._used = 0
        self.start: Array | None = None
        self.recalled = False  # whether it continues from the findings before a checkpoint
        self.begin = self.end = clock.time(0)

    # ---- the outputs to watch ------------------------------------------------------------------------------------

    def _find(self, checked: CheckedSystem, places: Layout) -> None:
        for instance in checked.instances:
            for name, verdict in instance.fmu.verdicts.items():
                if verdict is Role.POSITION:
                    self._add_body(instance, name, places)
        driven_by = {(link.source[0], link.target[0]) for link in checked.links}
        for instance in checked.instances:
            self._add_agent(instance, places)
            self._add_pilot(instance, places, driven_by)
        for instance in checked.instances:
            self._add_limits(instance, places)

    def _add_body(self, instance: ComponentInstance, name: str, places: Layout) -> None:
        verdicts = instance.fmu.verdicts
        ground = next((v for v, verdict in verdicts.items() if verdict is Role.ON_GROUND), "")
        elements = elements_of(name, instance.fmu.variables)
        self._positions += [self._columns.of(places, instance.name, element)[1] for element in elements]
        self._ground.append(self._columns.of(places, instance.name, ground)[1] if ground else 0)
        self.bodies.append(_Body(instance.name, _group(instance.name), bool(ground)))

    def _add_agent(self, instance: ComponentInstance, places: Layout) -> None:
        for name, verdict in instance.fmu.verdicts.items():
            if not isinstance(verdict, Condition):
                continue
            by = float(instance.effective_values()[verdict.by]) if verdict.by else math.inf
            self._states.append(self._columns.of(places, instance.name, name)[1])
            self._reasons.append(self._columns.of(places, instance.name, verdict.reason)[1] if verdict.reason else -1)
            self.agents.append(_Agent(instance, name, verdict, self._beside(instance.name), by))

    def _add_pilot(self, instance: ComponentInstance, places: Layout, driven_by: set[tuple[str, str]]) -> None:
        named = {verdict: name for name, verdict in instance.fmu.verdicts.items() if isinstance(verdict, Role)}
        armed, desired = named.get(Role.ARMED, ""), named.get(Role.DESIRED_POSITION, "")
        if not armed and not desired:
            return
        driven = [b for b, body in enumerate(self.bodies) if (instance.name, body.instance) in driven_by]
        body = driven[0] if len(driven) == 1 else self._beside(instance.name)
        if body < 0:
            return
        self._armed.append(self._columns.of(places, instance.name, armed)[1] if armed else 0)
        elements = elements_of(desired, instance.fmu.variables) if desired else ()
        self._desired += [self._columns.of(places, instance.name, element)[1] for element in elements] or [0, 0, 0]
        self.pilots.append(_Pilot(instance.name, body, bool(armed), bool(desired)))

    def _add_limits(self, instance: ComponentInstance, places: Layout) -> None:
        bounds = {name: verdict for name, verdict in instance.fmu.verdicts.items() if isinstance(verdict, Bound)}
        if not bounds:
            return
        values = instance.effective_values()
        agent = next((a for a, one in enumerate(self.agents) if one.instance is instance), -1)
        for name, bound in bounds.items():
            if bound.of and not values.get(bound.of):
                continue
            most = float(values[bound.most]) if isinstance(bound.most, str) else bound.most
            unit = instance.fmu.variables[name].unit
            self._values.append(self._columns.of(places, instance.name, name))
            self.limited.append(
                _Limit(instance.name, name, bound.least, most, bound, agent, "" if unit is None else unit.name)
            )

    def _beside(self, name: str) -> int:
        """Returns the only vehicle in the system of an instance; -1 if none or several exist."""
        found = [b for b, body in enumerate(self.bodies) if body.group == _group(name)]
        return found[0] if len(found) == 1 else -1

    # ---- looking -------------------------------------------------------------------------------------------------

    def initialised(self, seen: Seen) -> None:
        """Handles the first look of a run, or of a resumed run."""
        if not self.recalled:
            self.begin = seen.time
        self.stepped(seen)

    def stepped(self, seen: Seen) -> None:
        """Copies the watched values."""
        row = self._used
        self._times[row] = self.end = seen.time
        np.take(seen.reals, self._real_places, out=self._reals[row])
        np.take(seen.integers, self._integer_places, out=self._integers[row])
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
        wanted = np.zeros((n, len(self.bodies)), dtype=bool)
        self._look_at_agents(times, integers, wanted)
        positions = reals[:, self._positions].reshape(n, -1, 3)
        if self.bodies:
            self._look_at_bodies(positions, integers)
            self.approach.look(times, positions)
        if self.pilots:
            self._look_at_pilots(times, positions, reals, integers, wanted)
        if self.bodies:
            on_ground = integers[:, self._ground] != 0
            on_ground &= wanted & np.array([body.flew and body.has_ground for body in self.bodies])
            self.down.look(times, on_ground, on_ground)
        if self.limited:
            self._look_at_limits(times, reals, integers)
        if self._nodes:
            self._listen(float(times[0]), reals[0, self._nodes].reshape(-1, 3))

    def _look_at_agents(self, times: Array, integers: Array, wanted: Array) -> None:
        """Evaluates the agents. In `wanted`, it notes for each look which vehicles are expected to be in the air."""
        all_states = integers[:, self._states]
        for values in {agent.condition.commanding for agent in self.agents if agent.body >= 0} - {()}:
            of = [a for a, one in enumerate(self.agents) if one.body >= 0 and one.condition.commanding == values]
            wanted[:, [self.agents[a].body for a in of]] |= np.isin(all_states[:, of], values)
        last = np.array([agent.last for agent in self.agents], dtype=np.int32)
        for a in map(int, np.flatnonzero((all_states != last).any(axis=0))):
            agent, states = self.agents[a], all_states[:, a]
            agent.last = int(states[-1])
            for values, what in ((agent.condition.failed, "failed"), (agent.condition.working, "began")):
                now = np.isin(states, values)
                if now.any() and math.isnan(getattr(agent, what)):
                    row = int(now.argmax())
                    setattr(agent, what, float(times[row]))
                    if what == "failed" and self._reasons[a] >= 0:
                        agent.reason = int(integers[row, self._reasons[a]])
            now = np.isin(states, agent.condition.commanding)
            if agent.body >= 0 and now.any():
                self._command(agent.body, float(times[int(now.argmax())]), agent.instance.name)

    def _command(self, body: int, time: float, by: str) -> None:
        if math.isnan(self.bodies[body].commanded):
            self.bodies[body].commanded, self.bodies[body].by = time, by

    def _look_at_bodies(self, positions: Array, integers: Array) -> None:
        if self.start is None:
            self.start = positions[0].copy()
        waiting = np.flatnonzero([not body.flew for body in self.bodies])
        if not waiting.size:
            return
        aloft = np.linalg.norm(positions[:, waiting] - self.start[waiting], axis=2) > _MOVED
        has_ground = [b for b, body in enumerate(waiting) if self.bodies[body].has_ground]
        aloft[:, has_ground] &= integers[:, [self._ground[waiting[b]] for b in has_ground]] == 0
        for b in waiting[aloft.any(axis=0)]:
            self.bodies[b].flew = True

    def _look_at_pilots(self, times: Array, positions: Array, reals: Array, integers: Array, wanted: Array) -> None:
        armed = integers[:, self._armed] != 0
        armed[:, [not pilot.has_armed for pilot in self.pilots]] = True
        for p in map(int, np.flatnonzero(armed.any(axis=0))):
            if self.pilots[p].has_armed:
                self._command(self.pilots[p].body, float(times[int(armed[:, p].argmax())]), self.pilots[p].instance)
        desired = reals[:, self._desired].reshape(len(times), -1, 3)
        actual = positions[:, [pilot.body for pilot in self.pilots]]
        away = np.linalg.norm(desired - actual, axis=2)
        away[:, [not pilot.has_desired for pilot in self.pilots]] = 0.0
        self.away.look(times, armed & (away > self._limits.deviation), away)
        higher = armed & (away > 0.0) & (actual[:, :, 2] - desired[:, :, 2] > _LOW)
        for p in map(int, np.flatnonzero(higher.any(axis=0))):
            wanted[:, self.pilots[p].body] |= higher[:, p]

    def _look_at_limits(self, times: Array, reals: Array, integers: Array) -> None:
        values = np.zeros((len(times), len(self.limited)))
        of_reals = np.array([real for real, _ in self._values])
        columns = np.array([column for _, column in self._values])
        values[:, of_reals], values[:, ~of_reals] = reals[:, columns[of_reals]], integers[:, columns[~of_reals]]
        least = np.array([one.least for one in self.limited])
        most = np.array([one.most for one in self.limited])
        outside = (values < least) | (values > most)
        if not outside.any() and not self.outside.open.any():
            return
        tied = [n for n, one in enumerate(self.limited) if one.agent >= 0]
        if tied:
            outside[:, tied] &= self._working(integers)[:, [self.limited[n].agent for n in tied]]
        self.outside.look(times, outside, np.maximum(values - most, least - values))

    def _working(self, integers: Array) -> Array:
        """Returns whether each agent is active at each look; an agent without a declaration is always active."""
        working = np.ones((len(integers), len(self.agents)), dtype=bool)
        for values in {agent.condition.working for agent in self.agents} - {()}:
            of = [a for a, agent in enumerate(self.agents) if agent.condition.working == values]
            working[:, of] = np.isin(integers[:, [self._states[a] for a in of]], values)
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

    def findings(self) -> list[Finding]:
        """Returns all findings of a run that has ended."""
        return [
            *self._of_agents(),
            *self._of_bodies(),
            *self._of_ground(),
            *self._of_contacts(),
            *self._of_pilots(),
            *self._of_limits(),
            *self.double.values(),
        ]

    def nearest(self) -> Mapping[str, Any]:
        """The closest approach of two vehicles, as `Judgement.nearest`."""
        if not math.isfinite(self.approach.distance):
            return {}
        who = [self.bodies[b].instance for b in self.approach.pair]
        return {"who": who, "distance": self.approach.distance, "time": self.approach.time}

    def _of_agents(self) -> Iterator[Finding]:
        for agent in self.agents:
            name, state = agent.instance.name, agent.text_of(agent.last)
            if not math.isnan(agent.failed):
                why = agent.why()
                text = f"{name} has given up at {agent.failed:.1f} s{': ' if why else ''}{why}"
                numbers: dict[str, Number] = {"state": state, "reason": agent.reason}
                yield Finding("agent failed", "failure", (name,), text, agent.failed, numbers)
            elif self.end > agent.by + _LATE and not agent.began <= max(agent.by + _LATE, self.begin):
                wanted = f"it was to work from {agent.by:g} s on ({agent.condition.by})"
                if math.isnan(agent.began):
                    text = f"{name} is still in state {state} at {self.end:.1f} s; {wanted}"
                else:
                    text = f"{name} has begun at {agent.began:.1f} s; {wanted}"
                yield Finding("agent late", "warning", (name,), text, agent.by, {"state": state, "by": agent.by})

    def _of_bodies(self) -> Iterator[Finding]:
        for body in self.bodies:
            if not body.flew and self.end - body.commanded >= _PATIENCE:
                text = f"{body.instance} has never left the ground, though {body.by} wanted it to"
                text += f" from {body.commanded:.1f} s on: is it armed, and are its motors strong enough for its mass?"
                yield Finding("never flew", "failure", (body.instance,), text, body.commanded)

    def _of_ground(self) -> Iterator[Finding]:
        down = self.down
        for b, body in enumerate(self.bodies):
            if down.longest[b] < _AWAY:
                continue
            text = f"{body.instance} stands on the ground {self._how_long(down, b)}, though it had flown and"
            text += f" {body.by} wants it in the air: are its motors too weak?"
            numbers: dict[str, Number] = {"total": float(down.total[b])}
            yield Finding("came down", "failure", (body.instance,), text, float(down.first[b]), numbers)

    def _of_contacts(self) -> Iterator[Finding]:
        for (a, b), contact in sorted(self.approach.contacts.items()):
            one, other = self.bodies[a].instance, self.bodies[b].instance
            text = f"{one} and {other} came within {contact.distance:.2f} m of each other at {contact.time:.1f} s"
            text += f"; nearer than {self._limits.contact:g} m counts as contact"
            numbers = {"distance": contact.distance, "nearest at": contact.time, "contact": self._limits.contact}
            yield Finding("contact", "failure", (one, other), text, contact.since, numbers)

    def _of_pilots(self) -> Iterator[Finding]:
        away = self.away
        for p, pilot in enumerate(self.pilots):
            if away.longest[p] < _AWAY:
                continue
            body = self.bodies[pilot.body].instance
            numbers = {"distance": float(away.worst[p]), "farthest at": float(away.worst_time[p])}
            text = f"{body} was up to {away.worst[p]:.1f} m from where {pilot.instance} wanted it"
            text += f", more than {self._limits.deviation:g} m {self._how_long(away, p)}"
            text += ": is the wind too strong, or are the motors too weak?"
            yield Finding("off course", "failure", (body,), text, float(away.first[p]), numbers)

    def _of_limits(self) -> Iterator[Finding]:
        outside = self.outside
        for n, one in enumerate(self.limited):
            if math.isnan(outside.first[n]):
                continue
            above = one.most + outside.worst[n]
            held = isinstance(one.bound.most, str)
            most = f"{one.bound.most} = {one.most:g}" if held else f"{one.most:g}"
            unit = f" {one.unit}" if one.unit else ""
            text = f"{one.instance}: {one.bound.text or f'{one.variable} is outside of its bounds'}"
            text += f" ({one.variable} outside of {one.least:g} to {most}{unit} {self._how_long(outside, n)})"
            numbers = {"total": float(outside.total[n]), "longest": float(outside.longest[n])}
            if one.least == -math.inf:
                numbers["greatest"] = float(above)
            yield Finding("out of bounds", "warning", (one.instance,), text, float(outside.first[n]), numbers)

    def _how_long(self, spells: Spells, n: int) -> str:
        since = f"from {spells.first[n]:.1f} s on"
        return (
            since
            if spells.open[n] and spells.total[n] >= self.end - spells.first[n] - 1e-6
            else (f"for {spells.total[n]:.1f} s in all, first at {spells.first[n]:.1f} s")
        )


def _group(name: str) -> str:
    """Returns the system that contains an instance; for an instance of the root system, its own name."""
    return name.rpartition(".")[0] or name
