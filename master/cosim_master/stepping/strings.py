"""Strings other than packets: since they are rare and slow to exchange, Python exchanges them between macro steps."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager

from cosim_master.diagnostics.errors import FmuError, RunFailed
from cosim_master.fmi.slaves.slave import Slave, has_event_mode
from cosim_master.stepping.failures import reached
from cosim_master.stepping.kernels.tables import LAST, K, Plan
from cosim_master.stepping.layout import Layout

__all__ = ["Texts", "failing"]


@contextmanager
def failing(plan: Plan, slave: Slave) -> Iterator[Slave]:
    """Adds the current time to the errors of calls of one instance, and raises them as RunFailed."""
    slave.time = reached(plan)
    try:
        yield slave
    except FmuError as error:
        raise RunFailed([error]) from None


class Texts:
    """The Strings of a run.

    Args:
        layout: of all values.
        slaves: instances, in the order of `layout.instances`.

    Attributes:
        outputs: the value of every connected or recorded String output (number of its instance, name). Values of
            outputs that belong to Clocks are set by the code that handles events.
    """

    def __init__(self, layout: Layout, slaves: Sequence[Slave]) -> None:
        self._slaves = slaves
        number = {one.name: i for i, one in enumerate(slaves)}
        self.outputs: dict[tuple[int, str], str] = {}
        self._links = []
        for link in layout.strings:
            source, target = (number[link.source[0]], link.source[1]), number[link.target[0]]
            variable = slaves[target].fmu.variables[link.target[1]]
            slave = slaves[target]
            if not variable.clocks and not (has_event_mode(slave) and slave.inputs_by_event):
                self._links.append((source, target, variable, link))
            self.outputs[source] = ""
        self._recorded = [(number[instance.name], variable.name) for _, instance, variable in layout.string_signals]
        self.outputs |= dict.fromkeys(self._recorded, "")

    def __bool__(self) -> bool:
        return bool(self.outputs)

    def set_inputs(self, plan: Plan) -> None:
        """Sets the inputs of the instances that are due, from the outputs fetched by `get_outputs`."""
        k, periods = plan.counters[K], plan.instances["period"]
        for source, target, variable, link in self._links:
            if k >= 0 and k % periods[target] == 0:
                with failing(plan, self._slaves[target]) as slave:
                    slave.set([variable], [link.converted(self.outputs[source])])

    def get_outputs(self, plan: Plan, kept: Collection[tuple[int, str]]) -> None:
        """Fetches the outputs of the instances whose step has just ended; other instances are in the middle of a step.

        Args:
            kept: outputs that belong to Clocks, which must not be fetched.
        """
        k, periods = plan.counters[K], plan.instances["period"]
        for i, name in self.outputs:
            if (i, name) not in kept and (k % periods[i] == 0 or k == plan.counters[LAST]):
                with failing(plan, self._slaves[i]) as slave:
                    (self.outputs[i, name],) = slave.get([slave.fmu.variables[name]])

    @property
    def row(self) -> list[str]:
        """Returns the values to be recorded, in the order of `Layout.string_signals`."""
        return [self.outputs[key] for key in self._recorded]
