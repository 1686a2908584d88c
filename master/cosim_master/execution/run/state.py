"""The complete state of a run: instances, the arrays of the plan and of the radio, Strings.

The future of the run depends on nothing else. The roles of the arrays are declared with them (`tables.ROLES` of both
packages) and determine the contents of a snapshot in memory and of a checkpoint in files (`changing`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim_master.execution.events.event_mode import EventMode
from cosim_master.fmi.slaves.slave import Slave
from cosim_master.network.radio.tables import Radio
from cosim_master.stepping.failures import reached
from cosim_master.stepping.kernels.frames import NO_FRAMES, Frames
from cosim_master.stepping.kernels.tables import BASE, PER_NS, START, K, Plan
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.strings import Texts, failing
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["RunState", "changing"]


@dataclass(slots=True)
class RunState:
    """A run between two steps.

    Attributes:
        checked, clock, layout, network: the system, which does not change.
        slaves: the FMU instances, in the order of `layout.instances`.
        plan: arrays of the compiled loop.
        radio: arrays of the radio, which are replaced by larger ones when they become too small.
        event_mode: events and Clocks of FMI 3.
        texts: Strings that are not packets.
        frames: of a part of a run, the values that it passes on; `NO_FRAMES` in a run in one process.
    """

    checked: CheckedSystem
    clock: TimeGrid
    layout: Layout
    network: Network
    slaves: list[Slave]
    plan: Plan
    radio: Radio
    event_mode: EventMode
    texts: Texts
    frames: Frames = NO_FRAMES

    @property
    def time(self) -> float:
        """Simulation time of the current communication point, s."""
        return reached(self.plan)

    @property
    def now(self) -> int:
        """Simulation time reached, ns."""
        counters = self.plan.counters
        ticks, per_ns = int(counters[START] + max(counters[K], 0) * counters[BASE]), int(counters[PER_NS])
        return (ticks + per_ns // 2) // per_ns

    def change(self, changes: Iterable[Change]) -> bool:
        """Sets values in the instances; returns whether there were any.

        Raises:
            RunFailed: an instance refuses.
        """
        changed = False
        for change in changes:
            with failing(self.plan, self.slaves[change.instance]):
                self.event_mode.change(change)
            self.slaves[change.instance].changed[change.variable.name] = change.value
            changed = True
        return changed


def changing(
    arrays: Plan | Radio, roles: Mapping[str, str], wanted: Collection[str]
) -> dict[str, np.ndarray[Any, Any]]:
    """Returns views of the arrays, and of the columns of tables ("ports.filled"), that have one of the given roles.

    Raises:
        KeyError: an array, or a column of a table, has no declared role.
    """
    found: dict[str, np.ndarray[Any, Any]] = {}
    for name in arrays._fields:
        array = getattr(arrays, name)
        if array.dtype.names is None or name in roles:
            if roles[name] in wanted:
                found[name] = array
            continue
        for column in array.dtype.names:
            if roles[f"{name}.{column}"] in wanted:
                found[f"{name}.{column}"] = array[column]
    return found
