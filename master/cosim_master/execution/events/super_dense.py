"""Events of FMI 3.0 co-simulation FMUs: Event Mode, with super-dense iteration across connected FMUs (FMI 3.0.2, 4.2).

    events = Events(checked, slaves, start)
    events.begin()                         in initialization mode: intervals of Clocks
    events.settle(now, numbers)            the instances are in Event Mode: iterate, and out of it into Step Mode
    at_end = events.finish(members, t, end, ...)
                                           the rest of a step with an event: these FMUs alone, up to `end`
    events.settle(now, events.enter(at_end), others)
                                           events at the communication point, together

Between communication points, an FMU handles its events with its current inputs, alone or together with the FMUs that
Clocks connect it to (`clock_groups.lockstep`). Other FMUs see its outputs at the next communication point. There, all
FMUs in Event Mode exchange values until no value changes. Discrete inputs change in Event Mode only (2.4.7): an FMU
enters it at the beginning of a step when one of them gets a new value from an FMU without an event.

At each super-dense instant, Clocks that are due are set. Then, until no value changes, ticks are passed on to connected
Clocks, and values to inputs; an input that belongs to a Clock is set only while this Clock ticks. Finally, discrete
states are updated, which deactivates all Clocks. The value of an output at the last tick of its Clock is stored here,
since it must not be read from the FMU between ticks.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import CosimError, FmuError
from cosim_master.diagnostics.limitations import MISSED_TICK, UNSETTLED
from cosim_master.execution.events.clocks import Schedule, seconds
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.slaves.slave import EventSlave, Slave, has_event_mode
from cosim_master.system.flatten.clock_groups import lockstep
from cosim_master.system.flatten.flat import CheckedSystem, FlatConnection

__all__ = ["EndedByEvent", "Events"]

_MOST_ITERATIONS = 100
_MOST_STEPS = 10_000
"""Largest number of steps within one communication step."""
_KEPT = object()
"""Replaces a value: the input keeps its value."""


class EndedByEvent(CosimError):
    """An FMU requests the end of the simulation at an event.

    Attributes:
        number: number of the instance.
        time: time of the event, s.
    """

    def __init__(self, number: int, time: float) -> None:
        self.number, self.time = number, time
        super().__init__(f"instance {number} ends the run at {time:.9g} s")


class _Instant:
    """One time at which events happen.

    Attributes:
        now: the time, ns.
        active: instances in Event Mode.
        waiting: instances in Step Mode that may enter Event Mode.
        reached: the instances whose outputs belong to this time.
        again: the instances in Event Mode whose discrete states must be updated.
        ticking: the active Clocks of each instance.
        given: the last values of each input of an instance at this time.
        held: the values of inputs whose source has not reached this time.
    """

    def __init__(self, now: int, active: Sequence[int], waiting: Iterable[int], reached: Iterable[int]) -> None:
        self.now = now
        self.active, self.waiting = list(active), [i for i in waiting if i not in active]
        self.reached = {*self.active, *self.waiting, *reached}
        self.again = set(self.active)
        self.ticking: dict[int, set[str]] = {}
        self.given: dict[int, list[Any]] = {}
        self.held: Callable[[FlatConnection], Any] = lambda _: _KEPT


class Events:
    """The instances of a system that use Event Mode, and the connections to them.

    Args:
        checked: the system.
        slaves: its instances.
        start: start time of the run, ns.
        delayed: inputs (instance, name) of delayed connections; events do not change their delay.

    Attributes:
        numbers: the numbers of the instances that use Event Mode.
        groups: for each of them, the instances that step together with it, including itself.
        kept: values of outputs that belong to Clocks at their last tick, by instance and name; it has an entry for each
            output to be kept.
    """

    def __init__(
        self,
        checked: CheckedSystem,
        slaves: Sequence[Slave],
        start: int,
        delayed: Collection[tuple[str, str]] = (),
    ) -> None:
        self._slaves, self._delayed = slaves, delayed
        self.numbers = [i for i, one in enumerate(slaves) if has_event_mode(one)]
        self.groups: dict[int, tuple[int, ...]] = {i: (i,) for i in self.numbers}
        for members in lockstep(checked):
            self.groups |= dict.fromkeys(members, members)
        self._schedules: dict[int, Schedule] = {}
        self._outgoing: dict[int, list[Variable]] = {}
        for i in self.numbers:
            clocks = [v for v in slaves[i].fmu.variables.values() if v.clock is not None]
            if clocks:
                self._schedules[i] = Schedule(self._one(i), start, checked.instances[i].clock_intervals())
                self._outgoing[i] = [v for v in clocks if v.causality == "output"]
        self._announced = dict.fromkeys(self.numbers, math.inf)
        number = {one.name: i for i, one in enumerate(slaves)}
        self._links: dict[int, list[tuple[int, FlatConnection]]] = {i: [] for i in self.numbers}
        self._ticks: dict[tuple[int, str], list[tuple[int, Variable]]] = {}
        self._fired: dict[int, list[tuple[int, list[str]]]] = {}
        self.kept: dict[tuple[int, str], Any] = {}
        for link in checked.links:
            source, target = number[link.source[0]], number[link.target[0]]
            variable = slaves[source].fmu.variables[link.source[1]]
            if variable.clock is not None:
                end = slaves[target].fmu.variables[link.target[1]]
                self._ticks.setdefault((source, variable.name), []).append((target, end))
            elif target in self._links and not link.initial_only:
                self._links[target].append((source, link))
                of = slaves[source].fmu.variables
                if own := [name for name in variable.clocks if of[name].causality == "output"]:
                    self._fired.setdefault(target, []).append((source, own))
            if variable.clocks:
                self.keep(source, variable)
        self._by_event: dict[int, list[tuple[FlatConnection, Variable]]] = {}

    def set_inputs_by_event(self) -> None:
        """Leaves discrete inputs that are connected to this object, and not to the loop."""
        for i in self.numbers:
            ends = [(link, self._slaves[i].fmu.variables[link.target[1]]) for _, link in self._links[i]]
            if found := [(link, end) for link, end in ends if end.by_event]:
                self._by_event[i] = found
        for members in {self.groups[i] for i in self._by_event}:
            for i in members:
                self._one(i).inputs_by_event = True

    def _has_new_inputs(self, i: int, held: Callable[[FlatConnection], Any]) -> bool:
        """Returns whether a discrete input of an instance in Step Mode is to get another value than it has."""
        if not (ends := self._by_event.get(i)):
            return False
        values = self._one(i).get([end for _, end in ends])
        return any(not _same(_as(end, held(link)), value) for (link, end), value in zip(ends, values, strict=True))

    def _one(self, i: int) -> EventSlave:
        one = self._slaves[i]
        assert has_event_mode(one)
        return one

    def keep(self, i: int, variable: Variable) -> None:
        """Keeps the value of an output that belongs to a Clock, from now on."""
        missing: Mapping[str, Any] = {"String": "", "Binary": "", "Boolean": False}
        start = variable.start if variable.start is not None else missing.get(variable.type, 0)
        self.kept.setdefault((i, variable.name), start)

    def begin(self) -> None:
        """Starts the schedules of Clocks and gets the outputs that belong to them, in initialization mode.

        Raises:
            FmuError: an FMU refused.
        """
        for schedule in self._schedules.values():
            schedule.begin()
        for i, name in self.kept:
            variable = self._slaves[i].fmu.variables[name]
            if name in self._slaves[i].fmu.initial_unknowns:
                (self.kept[i, name],) = self._slaves[i].get([variable])

    def saved(self) -> Any:
        """Returns all data that the future of events depends on, for `restore`; next events are in the plan."""
        schedules = {i: schedule.saved() for i, schedule in self._schedules.items()}
        return copy.deepcopy((schedules, self.kept, self._announced))

    def restore(self, saved: Any) -> None:
        schedules, self.kept, self._announced = copy.deepcopy(saved)
        for i, schedule in self._schedules.items():
            schedule.restore(schedules[i])

    def as_json(self) -> Any:
        """Returns the content of `saved` as plain data, for `from_json` of another run."""
        return {
            "schedules": {str(i): schedule.as_json() for i, schedule in self._schedules.items()},
            "kept": [[i, name, value] for (i, name), value in self.kept.items()],
            "announced": {str(i): time for i, time in self._announced.items()},
        }

    def from_json(self, content: Any) -> None:
        """Restores the data; raises KeyError, ValueError or TypeError if they do not belong to these instances."""
        for i, schedule in self._schedules.items():
            schedule.from_json(content["schedules"][str(i)])
        self.kept |= {(i, name): value for i, name, value in content["kept"]}
        self._announced = {i: float(content["announced"][str(i)]) for i in self._announced}

    # ---- at one time -------------------------------------------------------------------------------------------------

    def enter(self, numbers: Iterable[int]) -> list[int]:
        """Puts instances from Step Mode into Event Mode; returns them.

        Raises:
            FmuError: one refused.
        """
        entered = list(numbers)
        for i in entered:
            self._one(i).enter_event_mode()
        return entered

    def change(
        self, i: int, variable: Variable, value: Any, now: int, held: Callable[[FlatConnection], Any]
    ) -> list[int]:
        """Sets a variable or the interval of a tunable Clock, at a communication point; returns instances with events.

        Raises:
            FmuError: an FMU refused.
            EndedByEvent: an FMU requests the end of the simulation.
        """
        clock = variable.clock is not None
        # FMI 3.0.2, 2.4.7: discrete inputs and tunable parameters change in Event Mode only, where it is used.
        by_event = i in self._links and variable.variability != "continuous"
        if not clock and not by_event:
            self._slaves[i].set([variable], [value])
            if not (i in self._schedules and self._schedules[i].depends):
                return []
        self.enter([i])
        if clock:
            self._schedules[i].retune(variable, float(value), now)
        elif by_event:
            self._slaves[i].set([variable], [value])
        return self.settle(now, [i], self.groups[i], held=held)

    def settle(
        self,
        now: int,
        numbers: Sequence[int],
        others: Iterable[int] = (),
        reached: Iterable[int] = (),
        held: Callable[[FlatConnection], Any] | None = None,
    ) -> list[int]:
        """Iterates at one time until no discrete state and no exchanged value changes; then all are in Step Mode.

        Args:
            now: the time, ns.
            numbers: the instances that are in Event Mode.
            others: instances at the same time that enter Event Mode when one of their inputs or Clocks changes.
            reached: instances without Event Mode at the same time.
            held: returns the value of a connection from an instance that is at another time; None if it has none.

        Returns:
            All instances that have been in Event Mode.

        Raises:
            FmuError: an FMU refused, or the events do not end.
            EndedByEvent: an FMU requests the end of the simulation.
        """
        at = _Instant(now, numbers, others, reached)
        if held is not None:
            at.held = held
        at.given = {i: self._inputs(i, at) for i in at.waiting}
        for _ in range(_MOST_ITERATIONS):
            at.ticking = {}
            for i in list(at.active):
                if due := (self._schedules[i].due(now) if i in self._schedules else []):
                    self._activate(i, due, at)
            self._spread(at)
            if not at.again:
                for i in at.active:
                    self._one(i).enter_step_mode()
                self._announce(at.active)
                return at.active
            self._update(at)
        raise self._endless(at, "fmi3UpdateDiscreteStates", "the discrete states of {}")

    def _endless(self, at: _Instant, function: str, what: str) -> FmuError:
        names = ", ".join(self._slaves[i].name for i in sorted(at.again))
        one = self._one(min(at.again, default=at.active[0]))
        text = UNSETTLED.text(what.format(names or one.name), _MOST_ITERATIONS)
        return FmuError(one.name, function, text, one.time, one.lines)

    def _activate(self, i: int, clocks: Sequence[Variable], at: _Instant) -> None:
        """Sets Clocks of an instance, which is then in Event Mode."""
        if i in at.waiting:
            at.waiting.remove(i)
            at.active += self.enter([i])
        self._one(i).set_clocks(clocks)
        at.ticking.setdefault(i, set()).update(v.name for v in clocks)
        at.again.add(i)
        for clock in clocks:
            if i in self._schedules and clock.clock is not None and clock.clock.kind != "triggered":
                self._schedules[i].ticked(clock)
                self._drive(i, clock.name, at)

    def _drive(self, i: int, clock: str, at: _Instant) -> None:
        """Sets the Clocks that are connected to a ticking Clock."""
        for target, end in self._ticks.get((i, clock), ()):
            if end.name not in at.ticking.get(target, ()):
                self._activate(target, [end], at)

    def _spread(self, at: _Instant) -> None:
        """Passes on Clocks and values until no value changes."""
        for given in at.given.items():
            # Inputs that belong to a Clock are set again at each of its ticks.
            self._forget_clocked(*given)
        for _ in range(_MOST_ITERATIONS):
            moved = False
            while sum(self._pass_on(i, at) for i in sorted(at.again)):
                moved = True
            for i in sorted(at.active, key=lambda i: not self._gets_fired(i, at)):
                if (set_now := self._exchange(i, at)) is not None:
                    moved = True
                    if set_now:
                        at.again.add(i)
            for i in [i for i in at.waiting if not _all_same(self._inputs(i, at), at.given[i])]:
                at.waiting.remove(i)
                at.active += self.enter([i])
                self._exchange(i, at)
                at.again.add(i)
                moved = True
            if not moved:
                break
        else:
            raise self._endless(at, "fmi3EnterEventMode", "the values that {} exchange")
        for i, name in self.kept:
            variable = self._slaves[i].fmu.variables[name]
            if not at.ticking.get(i, set()).isdisjoint(variable.clocks):
                (self.kept[i, name],) = self._one(i).get([variable])

    def _gets_fired(self, i: int, at: _Instant) -> bool:
        """Returns whether an input of an instance receives a value that belongs to a ticking output Clock.

        Such a value already exists, whereas a value that belongs to an input Clock may still have to be computed. In
        some FMUs (buses of FMI-LS-BUS), no input can be set at an instant at which an output has been read.
        """
        return any(not at.ticking.get(source, set()).isdisjoint(clocks) for source, clocks in self._fired.get(i, ()))

    def _pass_on(self, i: int, at: _Instant) -> bool:
        """Passes output Clocks of an instance that have begun to tick on to all connected Clocks."""
        ticking = at.ticking.get(i, set())
        asked = [
            v
            for v in self._outgoing.get(i, ())
            if v.name not in ticking and (not v.clocks or not ticking.isdisjoint(v.clocks))
        ]
        if not asked:
            return False
        moved = False
        for clock, active in zip(asked, self._one(i).get_clocks(asked), strict=True):
            if not active:
                continue
            moved = True
            at.ticking.setdefault(i, set()).add(clock.name)
            self._drive(i, clock.name, at)
        return moved

    def _update(self, at: _Instant) -> None:
        """Ends the super-dense instant; instances that must be updated again remain in `again`."""
        for i in sorted(at.again):
            one = self._one(i)
            more, ends, self._announced[i] = one.update_discrete_states()
            if ends:
                raise EndedByEvent(i, one.time or 0.0)
            if i in self._schedules:
                self._schedules[i].update(at.now, at.ticking.get(i, ()))
            if not more:
                at.again.discard(i)

    def _announce(self, numbers: Iterable[int]) -> None:
        """Sets the next event of instances, and of all instances that step together with them, in the stepping loop."""
        for members in {self.groups[i] for i in numbers}:
            time = min(self._next(i) for i in members)
            for i in members:
                self._one(i).next_event = time

    def _next(self, i: int) -> float:
        """Returns the time of the next event of an instance, including its Clocks' ticks, s."""
        tick = seconds(self._schedules[i].next) if i in self._schedules else math.inf
        return min(self._announced[i], tick)

    # ---- values ------------------------------------------------------------------------------------------------------

    def _value(self, source: int, link: FlatConnection, at: _Instant) -> Any:
        one = self._slaves[source]
        variable = one.fmu.variables[link.source[1]]
        if source not in at.reached or link.target in self._delayed:
            return at.held(link)
        if variable.clocks and at.ticking.get(source, set()).isdisjoint(variable.clocks):
            return link.converted(self.kept[source, variable.name])
        (value,) = one.get([variable])
        return link.converted(value)

    def _inputs(self, i: int, at: _Instant) -> list[Any]:
        """Returns the values that the connections of an instance would set now."""
        ticking, variables = at.ticking.get(i, set()), self._slaves[i].fmu.variables
        return [
            self._value(source, link, at)
            if not (clocks := variables[link.target[1]].clocks) or not ticking.isdisjoint(clocks)
            else _KEPT
            for source, link in self._links[i]
        ]

    def _forget_clocked(self, i: int, given: list[Any]) -> None:
        variables = self._slaves[i].fmu.variables
        for j, (_, link) in enumerate(self._links[i]):
            if variables[link.target[1]].clocks:
                given[j] = _KEPT

    def _exchange(self, i: int, at: _Instant) -> bool | None:
        """Sets an instance's changed inputs; returns whether any was set before at this time; None if none changed."""
        new, before = self._inputs(i, at), at.given.get(i)
        if not new:
            return None
        changed = [
            j for j, value in enumerate(new) if value is not _KEPT and (before is None or not _same(value, before[j]))
        ]
        if not changed:
            return None
        one = self._one(i)
        known = [(link, value) for (_, link), value in zip(self._links[i], new, strict=True) if value is not _KEPT]
        one.set([one.fmu.variables[link.target[1]] for link, _ in known], [value for _, value in known])
        at.given[i] = new if before is None else [b if v is _KEPT else v for v, b in zip(new, before, strict=True)]
        return before is not None and any(before[j] is not _KEPT for j in changed)

    # ---- steps with events in them -----------------------------------------------------------------------------------

    def finish(
        self,
        members: Sequence[int],
        t: float,
        end: float,
        *,
        begun: bool,
        held: Callable[[FlatConnection], Any] | None = None,
        near: float = 0.0,
    ) -> list[int]:
        """Makes the remaining part of a step from `t` to `end`, in several parts if events occur before `end`.

        Args:
            members: instances that step together.
            begun: fmi3DoStep has already been called for this step, and `EventSlave.answers` returns its answers.
            held: as for `settle`.
            near: times within this distance of `end` count as `end`, s. Times of events are whole nanoseconds, ends of
                steps may not be.

        Returns:
            The instances that have an event at `end`.

        Raises:
            FmuError: the FMU refused, or does not make progress.
            EndedByEvent: an FMU requests the end of the simulation.
        """
        rounded, near = near > 0.0, max(1e-9 * max(end - t, abs(end) * 1e-3), near)
        if not begun and held is not None and (new := [i for i in members if self._has_new_inputs(i, held)]):
            for i in members:
                self._one(i).time = t
            self.settle(round(t * 1e9), self.enter(new), members, held=held)
        for _ in range(_MOST_STEPS):
            until = min(end, max(min(self._one(i).next_event for i in members), t))
            until = end if rounded and until > end - near else until
            needed: set[int] = set()
            if not begun and until > t + near:
                for i in members:
                    self._part(i, t, until, end)
                begun = True
            if begun:
                at = until
                for i in members:
                    event, ends, early, last = self._one(i).answers
                    if ends:
                        raise EndedByEvent(i, last if early else until)
                    if early and not self._one(i).early_return:
                        text = f"it has returned early, at {last:.9g} s, though that is not allowed"
                        raise FmuError(self._one(i).name, "fmi3DoStep", text, t, self._one(i).lines)
                    at = last if early else at
                    needed |= {i} if event else set()
                t, begun = at, False
            else:
                needed = {i for i in members if self._next(i) <= t + near}  # the event is already reached
            for i in members:
                self._one(i).time = t
            needed |= {i for i in members if self._next(i) <= t + near}
            if t >= end - near:
                return sorted(needed)
            if needed:
                self.settle(round(t * 1e9), self.enter(sorted(needed)), members, held=held)
        one = self._one(members[0])
        text = f"it does not get from {t:.9g} s to {end:.9g} s in {_MOST_STEPS} steps"
        raise FmuError(one.name, "fmi3DoStep", text, one.time, one.lines)

    def _part(self, i: int, t: float, until: float, end: float) -> None:
        one = self._one(i)
        one.time = t
        variable = one.fmu.capabilities.canHandleVariableCommunicationStepSize
        if until < end and not variable:
            text = f"{MISSED_TICK.text(f'{until:.9g}')} (canHandleVariableCommunicationStepSize is false); "
            text += "give it a step size that divides " + (
                "interval and shift" if i in self._schedules else "the times of its events"
            )
            raise FmuError(one.name, "fmi3DoStep", text, t, one.lines)
        one.do_step(t, until - t)


def _as(variable: Variable, value: Any) -> Any:
    """Returns a value as its input has it."""
    return np.float32(value).item() if variable.fmi_type == "Float32" else value


def _same(a: Any, b: Any) -> bool:
    """Returns whether two values are equal; two NaNs are equal."""
    return a is b or bool(a == b) or (a != a and b != b)


def _all_same(a: Sequence[Any], b: Sequence[Any]) -> bool:
    return all(map(_same, a, b))
