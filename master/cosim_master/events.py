"""Events of FMI 3.0 co-simulation FMUs: Event Mode, with super-dense iteration across connected FMUs (FMI 3.0.2, 4.2).

    events = Events(checked, living)
    events.settle(numbers)                 the instances are in Event Mode: iterate, and out of it into Step Mode
    at_end = events.finish(i, t, end, ...) the rest of a step in which there is an event: the FMU alone, up to `end`
    events.settle(events.enter(at_end))    events at the communication point, together

Between communication points an FMU handles its events alone, with the inputs that it has: others see its outputs at
the next one. At a communication point all FMUs in Event Mode exchange values until nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from cosim_master.check import CheckedSystem, Link
from cosim_master.errors import CosimError, FmuError
from cosim_master.fmi3 import Instance3
from cosim_master.living import Living

__all__ = ["EndedByEvent", "Events"]

_MOST_ITERATIONS = 100
_MOST_STEPS = 10_000
"""In one communication step."""


class EndedByEvent(CosimError):
    """An FMU wants the simulation to end, at an event.

    Attributes:
        number: of the instance.
        time: s.
    """

    def __init__(self, number: int, time: float) -> None:
        self.number, self.time = number, time
        super().__init__(f"instance {number} ends the run at {time:.9g} s")


class Events:
    """The instances of a system that use Event Mode, and the connections to them."""

    def __init__(self, checked: CheckedSystem, living: Sequence[Living]) -> None:
        self._living = living
        self.numbers = [i for i, one in enumerate(living) if isinstance(one, Instance3) and one.event_mode]
        number = {one.name: i for i, one in enumerate(living)}
        self._links: dict[int, list[tuple[int, Link]]] = {i: [] for i in self.numbers}
        for link in checked.links:
            target = number[link.target[0]]
            if target in self._links and not link.initial_only:
                self._links[target].append((number[link.source[0]], link))

    def _one(self, i: int) -> Instance3:
        one = self._living[i]
        assert isinstance(one, Instance3)
        return one

    def enter(self, numbers: Iterable[int]) -> list[int]:
        """Put instances from Step Mode into Event Mode; returns them.

        Raises:
            FmuError: one refused.
        """
        entered = list(numbers)
        for i in entered:
            self._one(i).enter_event_mode()
        return entered

    def settle(self, numbers: Sequence[int], others: Sequence[int] = ()) -> list[int]:
        """Iterate at one time until no discrete state and no exchanged value changes; then all are in Step Mode.

        Args:
            numbers: the instances that are in Event Mode.
            others: instances at the same time that may enter it, when an input of theirs changes.

        Returns:
            All that have been in Event Mode.

        Raises:
            FmuError: an FMU refused, or they do not come to an end.
            EndedByEvent: an FMU wants the simulation to end.
        """
        active, waiting = list(numbers), [i for i in others if i not in numbers]
        seen: dict[int, list[Any]] = {i: self._inputs(i) for i in waiting}
        again = set(active)
        for _ in range(_MOST_ITERATIONS):
            for i in active:
                if self._exchange(i, seen):
                    again.add(i)
            for i in [i for i in waiting if self._inputs(i) != seen[i]]:
                waiting.remove(i)
                active += self.enter([i])
                self._exchange(i, seen)
                again.add(i)
            if not again:
                for i in active:
                    self._one(i).enter_step_mode()
                return active
            for i in sorted(again):
                one = self._one(i)
                more, ends = one.update_discrete_states()
                if ends:
                    raise EndedByEvent(i, one.time or 0.0)
                if not more:
                    again.discard(i)
        names = ", ".join(self._living[i].name for i in sorted(again))
        one = self._one(min(again, default=active[0]))
        text = f"the discrete states of {names or one.name} do not settle in {_MOST_ITERATIONS} iterations at one time"
        raise FmuError(one.name, "fmi3UpdateDiscreteStates", text, one.time, one.lines)

    def _inputs(self, i: int) -> list[Any]:
        """What the connections of an instance would set now."""
        values = []
        for source, link in self._links[i]:
            one = self._living[source]
            (value,) = one.get([one.library.fmu.variables[link.source[1]]])
            values.append(link.converted(value))
        return values

    def _exchange(self, i: int, seen: dict[int, list[Any]]) -> bool:
        """Set the inputs of an instance; whether one of them has changed since this was last done."""
        new = self._inputs(i)
        if not new or seen.get(i) == new:
            return False
        one = self._one(i)
        one.set([one.library.fmu.variables[link.target[1]] for _, link in self._links[i]], new)
        changed = i in seen
        seen[i] = new
        return changed

    def finish(self, i: int, t: float, end: float, *, begun: bool) -> bool:
        """The rest of a step from `t` to `end`, in parts if there are events between them.

        Args:
            begun: fmi3DoStep has been called for this step already, and `Instance3.answers` has what it answered.

        Returns:
            Whether there is an event at `end`.

        Raises:
            FmuError: the FMU refused, or does not get on.
            EndedByEvent: it wants the simulation to end.
        """
        one = self._one(i)
        near = 1e-9 * max(end - t, abs(end) * 1e-3)
        for _ in range(_MOST_STEPS):
            until = min(end, max(one.next_event, t))
            if not begun and until > t + near:
                one.time = t
                one.do_step(t, until - t)
                begun = True
            if begun:
                event, ends, early, last = one.answers
                t = last if early else until
                if ends:
                    raise EndedByEvent(i, t)
                begun = False
            else:
                event = True  # the event is here already
            one.time = t
            event = event or one.next_event <= t + near
            if t >= end - near:
                return event
            if event:
                self.settle(self.enter([i]))
        text = f"it does not get from {t:.9g} s to {end:.9g} s in {_MOST_STEPS} steps"
        raise FmuError(one.name, "fmi3DoStep", text, one.time, one.lines)
