"""The subjects of a watch: the outputs that FMUs have declared (`cosim.verdict`), and the instances that they describe.

A vehicle is an instance with a position. Its autopilot is the instance that drives it. If no instance drives a vehicle
directly, the autopilot and the agent belong to the only vehicle in the same system.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from cosim.verdict import Bound, Condition, Logged, Reason, Role, Rotors
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.stepping.layout import Layout
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance

__all__ = ["Agent", "Body", "Limit", "Pilot", "Subjects", "watched"]

_UNWATCHED = (
    *(Role.SYSTEM_ID, Role.OPTIONAL, Role.ATTITUDE),
    *(Role.JAMMED_RADIUS, Role.JAMMED_NORTH, Role.JAMMED_EAST, Role.JAMMED_FROM, Role.JAMMED_UNTIL),
)


def watched(checked: CheckedSystem) -> frozenset[tuple[str, str]]:
    """Returns all outputs that the watch needs, as pairs of instance and variable."""
    files = {id(instance.fmu): instance.fmu for instance in checked.instances}
    elements = {
        key: [
            element
            for name, verdict in fmu.verdicts.items()
            if not isinstance(verdict, (Rotors, Logged)) and verdict not in _UNWATCHED
            for element in elements_of(name, fmu.variables)
        ]
        for key, fmu in files.items()
    }
    return frozenset((one.name, element) for one in checked.instances for element in elements[id(one.fmu)])


@dataclass(slots=True)
class Agent:
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
class Body:
    """A vehicle."""

    instance: str
    group: str
    has_ground: bool
    commanded: float = math.nan
    by: str = ""
    flew: bool = False


@dataclass(slots=True)
class Pilot:
    """An instance that outputs whether it is armed, the desired position of its vehicle, or both."""

    instance: str
    body: int
    has_armed: bool
    has_desired: bool


@dataclass(slots=True)
class Limit:
    """A bound that applies in this system."""

    instance: str
    variable: str
    least: float
    most: float
    bound: Bound
    agent: int
    unit: str


class Columns:
    """Indices of the watched values among the outputs, by kind; the copies have one column for each of them."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.reals: list[int] = []
        self.integers: list[int] = []

    def of(self, instance: str, name: str) -> tuple[bool, int]:
        """Returns whether the variable is a real, and its column."""
        for kind in ("Real", "Integer", "Boolean"):
            index = self._layout.ports[kind].index.get((instance, name))
            if index is None:
                continue
            if kind == "Real":
                self.reals.append(index)
                return True, len(self.reals) - 1
            self.integers.append(index + (len(self._layout.ports["Integer"].outputs) if kind == "Boolean" else 0))
            return False, len(self.integers) - 1
        raise KeyError(f"{instance}.{name} is not fetched")


class Subjects:
    """The subjects of one run.

    Attributes:
        bodies, pilots, agents, limited: what is watched.
        columns: the places of the watched values.
        positions, ground: of each body, columns of its position (three) and of whether it is on the ground.
        armed, desired: of each pilot, columns of whether it is armed and of its desired position (three).
        states, reasons: of each agent, columns of its state and of its reason to give up; -1: it has none.
        values: of each limit, whether the value is a real, and its column.
    """

    def __init__(self, checked: CheckedSystem, layout: Layout) -> None:
        self.columns = Columns(layout)
        self.bodies: list[Body] = []
        self.pilots: list[Pilot] = []
        self.agents: list[Agent] = []
        self.limited: list[Limit] = []
        self.positions: list[int] = []
        self.ground: list[int] = []
        self.armed: list[int] = []
        self.desired: list[int] = []
        self.states: list[int] = []
        self.reasons: list[int] = []
        self.values: list[tuple[bool, int]] = []
        for instance in checked.instances:
            for name, verdict in instance.fmu.verdicts.items():
                if verdict is Role.POSITION:
                    self._add_body(instance, name)
        self._of_instance: dict[str, list[int]] = defaultdict(list)
        self._of_group: dict[str, list[int]] = defaultdict(list)
        for b, body in enumerate(self.bodies):
            self._of_instance[body.instance].append(b)
            self._of_group[body.group].append(b)
        drives: dict[str, set[str]] = defaultdict(set)
        for link in checked.links:
            drives[link.source[0]].add(link.target[0])
        for instance in checked.instances:
            self._add_agent(instance)
            self._add_pilot(instance, drives[instance.name])
        self._agent_of = {one.instance.name: a for a, one in reversed([*enumerate(self.agents)])}
        for instance in checked.instances:
            self._add_limits(instance)

    def _add_body(self, instance: ComponentInstance, name: str) -> None:
        verdicts = instance.fmu.verdicts
        ground = next((v for v, verdict in verdicts.items() if verdict is Role.ON_GROUND), "")
        elements = elements_of(name, instance.fmu.variables)
        self.positions += [self.columns.of(instance.name, element)[1] for element in elements]
        self.ground.append(self.columns.of(instance.name, ground)[1] if ground else 0)
        self.bodies.append(Body(instance.name, _group(instance.name), bool(ground)))

    def _add_agent(self, instance: ComponentInstance) -> None:
        for name, verdict in instance.fmu.verdicts.items():
            if not isinstance(verdict, Condition):
                continue
            by = _number(instance, verdict.by) if verdict.by else math.inf
            self.states.append(self.columns.of(instance.name, name)[1])
            self.reasons.append(self.columns.of(instance.name, verdict.reason)[1] if verdict.reason else -1)
            self.agents.append(Agent(instance, name, verdict, self._beside(instance.name), by))

    def _add_pilot(self, instance: ComponentInstance, drives: Iterable[str]) -> None:
        named = {verdict: name for name, verdict in instance.fmu.verdicts.items() if isinstance(verdict, Role)}
        armed, desired = named.get(Role.ARMED, ""), named.get(Role.DESIRED_POSITION, "")
        if not armed and not desired:
            return
        driven = [b for name in drives if name in self._of_instance for b in self._of_instance[name]]
        body = driven[0] if len(driven) == 1 else self._beside(instance.name)
        if body < 0:
            return
        self.armed.append(self.columns.of(instance.name, armed)[1] if armed else 0)
        elements = elements_of(desired, instance.fmu.variables) if desired else ()
        self.desired += [self.columns.of(instance.name, element)[1] for element in elements] or [0, 0, 0]
        self.pilots.append(Pilot(instance.name, body, bool(armed), bool(desired)))

    def _add_limits(self, instance: ComponentInstance) -> None:
        bounds = {name: verdict for name, verdict in instance.fmu.verdicts.items() if isinstance(verdict, Bound)}
        if not bounds:
            return
        agent = self._agent_of.get(instance.name, -1)
        for name, bound in bounds.items():
            if bound.of and not instance.effective_value(bound.of):
                continue
            most = _number(instance, bound.most) if isinstance(bound.most, str) else bound.most
            unit = instance.fmu.variables[name].unit
            self.values.append(self.columns.of(instance.name, name))
            self.limited.append(
                Limit(instance.name, name, bound.least, most, bound, agent, "" if unit is None else unit.name)
            )

    def _beside(self, name: str) -> int:
        """Returns the only vehicle in the system of an instance; -1 if none or several exist."""
        found = self._of_group.get(_group(name), [])
        return found[0] if len(found) == 1 else -1


def _number(instance: ComponentInstance, name: str) -> float:
    """Returns the effective value of a parameter."""
    value = instance.effective_value(name)
    assert value is not None
    return float(value)


def _group(name: str) -> str:
    """Returns the system that contains an instance; for an instance of the root system, its own name."""
    return name.rpartition(".")[0] or name
