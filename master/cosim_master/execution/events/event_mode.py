"""Event Mode within a run: steps that the loop leaves to Python because events occur in them.

`super_dense` implements the behaviour of FMUs and Clocks at an event; this module connects it to the plan's values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed, RunTerminated
from cosim_master.execution.events.super_dense import EndedByEvent, Events
from cosim_master.fmi.calls import KINDS
from cosim_master.fmi.description.read import Variable
from cosim_master.fmi.slaves.slave import EventSlave, Slave, has_event_mode
from cosim_master.stepping.failures import raise_failures, reached
from cosim_master.stepping.kernels.instances import collect_again
from cosim_master.stepping.kernels.macro_step import end_here
from cosim_master.stepping.kernels.tables import BASE, BEGIN, END, FINER, PER_NS, SHOW, START, K, Plan
from cosim_master.stepping.layout import Layout, halves_of
from cosim_master.stepping.strings import Texts
from cosim_master.system.flatten.flat import CheckedSystem, FlatConnection
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.master import Delay

__all__ = ["EventMode"]


class EventMode:
    """The events of a run.

    Args:
        checked: the system.
        layout: the places of all values.
        slaves: instances, in the order of `layout.instances`; not yet initialized.
        start: start time of the run in ns.
        delayed: delays of connections, by target.

    Attributes:
        events: the events of the FMUs. Call `attach` before the first step.
    """

    def __init__(
        self,
        checked: CheckedSystem,
        layout: Layout,
        slaves: Sequence[Slave],
        start: int,
        delayed: Mapping[tuple[str, str], Delay],
    ) -> None:
        self._checked, self._layout, self._slaves, self._delayed = checked, layout, slaves, delayed
        self.events = Events(checked, slaves, start, delayed)
        self._keep_clocked()

    def attach(self, plan: Plan, texts: Texts) -> None:
        """Connects the plan of the initialized instances and their Strings; writes clocked outputs to them."""
        self._plan, self._texts = plan, texts
        self.show(self.events.numbers)

    @property
    def _ns(self) -> int:
        return self._at(max(int(self._plan.counters[K]), 0))

    def _at(self, k: int) -> int:
        """Returns the time of base step k, ns."""
        counters = self._plan.counters
        per_ns = int(counters[PER_NS])
        return (int(counters[START]) + k * int(counters[BASE]) + per_ns // 2) // per_ns

    @property
    def pending(self) -> bool:
        """True if an instance waits for `handle`."""
        return any(self._one(i).pending for i in self.events.numbers)

    def next_event(self) -> float:
        """Returns the time of the next event that an FMU has announced, s; infinity if none exists."""
        return min((self._one(i).next_event for i in self.events.numbers), default=math.inf)

    def returned_early(self) -> float:
        """Returns the earliest time at which an FMU returned early because of an event, s; infinity if none did."""
        early = [self._one(i).answers for i in self.events.numbers if self._one(i).pending == END]
        return min((last for _, ends, is_early, last in early if is_early and not ends), default=math.inf)

    def change(self, change: Change) -> None:
        """Sets a variable, or the interval of a Clock, and handles the events that follow.

        Raises:
            FmuError: the instance refuses the value.
            RunTerminated: an event ends the run.
        """
        try:
            given = (change.instance, change.variable, change.value)
            touched = self.events.change(*given, self._ns, self._held_outputs)
        except EndedByEvent as ended:
            raise self._ended(ended) from None
        self.show(touched)

    def _ended(self, ended: EndedByEvent) -> RunTerminated:
        return RunTerminated(self._slaves[ended.number].name, ended.time, said="terminateSimulation")

    def handle(self) -> None:
        """Completes steps with events: their remaining part, the events at their end, and then their outputs."""
        rows, k = self._plan.instances, int(self._plan.counters[K])
        # Outputs are known at the end of a step, which for a slow instance may be several base steps ahead.
        here = [i for i in range(rows.size) if k % int(rows[i]["period"]) + 1 == int(rows[i]["length"])]
        ends = [i for i in self.events.numbers if i in here]
        pending = {i: self._one(i).pending for i in self.events.numbers if self._one(i).pending in (BEGIN, END)}
        try:
            at_end = self._finish(pending)
            together = [i for i in at_end if i in ends]
            touched = {*pending}
            for members in {self.events.groups[i] for i in at_end if i not in ends}:
                now = self._ns + round(1e9 * float(rows[members[0]]["h"]))
                own = [i for i in members if i in at_end]
                touched |= {*self.events.settle(now, self.events.enter(own), members, held=self._held_inputs)}
            if together:
                now = self._at(k + 1)
                entered = self.events.enter(together)
                try:
                    touched |= {*self.events.settle(now, entered, ends, here, self._held_outputs)}
                except EndedByEvent:
                    self._end_here(ends)
                    raise
        except FmuError as error:
            raise RunFailed([error]) from None
        except EndedByEvent as ended:
            raise self._ended(ended) from None
        for i in touched - {*ends}:
            self._one(i).pending = SHOW
        self.show(ends)
        collect_again(self._plan, np.array(sorted(touched & set(ends)), dtype=np.int64))
        raise_failures(self._plan, self._layout, self._slaves)

    def _end_here(self, ends: Sequence[int]) -> None:
        """Ends the run for an FMU in Event Mode: all instances have made the macro step, so a row is added."""
        counters = self._plan.counters
        if counters[FINER] > 1:
            return
        self.show(ends)
        collect_again(self._plan, np.array(ends, dtype=np.int64))
        raise_failures(self._plan, self._layout, self._slaves)
        end_here(self._plan, np.zeros(0, dtype=np.int64))

    def _finish(self, pending: Mapping[int, int]) -> list[int]:
        """Completes the steps that the loop has left to events; returns the instances with an event at their end."""
        at_end: list[int] = []
        near = 0.0 if self._plan.counters[PER_NS] == 1 else 6e-10
        for i in pending:
            # Instances connected by Clocks have a common next event, so either all of them have begun their step, or
            # none has.
            begun = pending[i] == END
            members = (i,) if begun else self.events.groups[i]
            if self._one(i).pending == 0:
                continue
            for one in members:
                self._one(one).pending = 0
            end = reached(self._plan) + float(self._plan.instances[i]["h"])
            at_end += self.events.finish(
                members, reached(self._plan), end, begun=begun, held=self._held_inputs, near=near
            )
        return at_end

    def _held_inputs(self, link: FlatConnection) -> Any:
        """Returns the value that an input received at the beginning of the present step of its instance."""
        number, name = self._number[link.target[0]], link.target[1]
        for kind, word in enumerate(KINDS):
            if (j := self._input_places[word].get((number, name))) is not None:
                j += int(self._plan.feeds[number]["first_in"][kind])
                variable = self._slaves[number].fmu.variables[name]
                return (
                    self._plan.real_in[j].item()
                    if kind == 0
                    else _whole(self._plan.int_in, j - self._plan.real_in.size, variable)
                )
        return link.converted(self._texts.outputs[self._number[link.source[0]], link.source[1]])

    def _held_outputs(self, link: FlatConnection) -> Any:
        """Returns an output at the end of its instance's last step; for a delayed connection, its earlier value."""
        if link.target in self._delayed:
            return self._held_inputs(link)
        for word in KINDS:
            if (j := self._layout.ports[word].index.get(link.source)) is not None:
                if word == "Boolean":
                    j += len(self._layout.ports["Integer"].outputs)
                variable = self._slaves[self._number[link.source[0]]].fmu.variables[link.source[1]]
                real = word == "Real"
                return link.converted(
                    self._plan.real_out[j].item() if real else _whole(self._plan.int_out, j, variable)
                )
        return link.converted(self._texts.outputs[self._number[link.source[0]], link.source[1]])

    def _keep_clocked(self) -> None:
        """Makes `events` keep all outputs that belong to Clocks and are in the plan or among the recorded Strings."""
        self._number = {one.name: i for i, one in enumerate(self._checked.instances)}
        self._input_places: dict[str, dict[tuple[int, str], int]] = {word: {} for word in KINDS}
        for word in KINDS:
            ports = self._layout.ports[word]
            for i, (first, last) in enumerate(pairwise(ports.first_in)):
                for j, v in enumerate(ports.inputs[first:last]):
                    self._input_places[word].setdefault((i, v.name), j)
            for instance, name in ports.index:
                self._keep(instance, name)
        for _, owner, variable in self._layout.string_signals:
            self._keep(owner.name, variable.name)

    def _keep(self, instance: str, name: str) -> None:
        i = self._number[instance]
        variable = self._checked.instances[i].fmu.variables[name]
        if variable.clocks:
            self.events.keep(i, variable)

    def show(self, numbers: Sequence[int]) -> None:
        """Copies the outputs that belong to Clocks, as of their last tick, to their places in the loop."""
        integers = len(self._layout.ports["Integer"].outputs)
        for (i, name), value in self.events.kept.items():
            if i not in numbers:
                continue
            key = (self._slaves[i].name, name)
            for word in KINDS:
                if (j := self._layout.ports[word].index.get(key)) is not None:
                    values = self._plan.real_out if word == "Real" else self._plan.int_out
                    j += integers if word == "Boolean" else 0
                    halves = halves_of(value) if self._slaves[i].fmu.variables[name].wide else [value]
                    values[j : j + len(halves)] = halves
            if (i, name) in self._texts.outputs:
                self._texts.outputs[i, name] = value
        for i in numbers:
            if self._one(i).pending == SHOW:
                self._one(i).pending = 0

    def _one(self, i: int) -> EventSlave:
        one = self._slaves[i]
        assert has_event_mode(one)
        return one


def _whole(places: np.ndarray[Any, Any], j: int, variable: Variable) -> int:
    """Returns an integer from its place, or its two places, in the plan."""
    if not variable.wide:
        return int(places[j])
    return int(places[j : j + 2].copy().view(np.uint64 if variable.fmi_type == "UInt64" else np.int64)[0])
