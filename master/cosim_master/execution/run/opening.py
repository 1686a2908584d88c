"""The start of a run from a checked system: it initializes the instances, and makes the plan and the radio."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from cosim_master.execution.events.event_mode import EventMode
from cosim_master.execution.run.instances import Instances
from cosim_master.execution.run.state import RunState
from cosim_master.execution.run.workers import threads_for
from cosim_master.execution.startup.initialize import initialize
from cosim_master.network.radio.build import make_radio
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.plan import make_plan
from cosim_master.stepping.strings import Texts
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["open_run"]


def open_run(
    instances: Instances,
    checked: CheckedSystem,
    clock: TimeGrid,
    layout: Layout,
    network: Network,
    master: MasterSettings,
    *,
    every: int,
    keep_packets: bool,
    grid: bool,
    threads: int | None,
    phase: Callable[[str], AbstractContextManager[Any]],
    tell: Callable[[str], None],
) -> tuple[RunState, int]:
    """Loads and initializes all FMU instances; returns the run at its start, and the number of threads that step it.

    Args:
        instances: receives the instances, and ends them even after an error here.
        every, keep_packets, grid, threads: as for `Execution`.
        phase: measures the time of a phase.
        tell: called with a description of each stage.

    Raises:
        SystemDescriptionError: interpreted FMUs are incompatible with each other, or an own channel cannot be compiled.
        FmuError: an FMU refuses.
        LoopError: outputs depend on each other at the start, and no consistent values were found.
    """
    radio = make_radio(network, layout.ports["Real"].index, keep=keep_packets)
    tell(f"loading {len(checked.instances)} FMU instances")
    with phase("load and instantiate"):
        instances.make(checked)
    slaves = instances.slaves
    tell(f"initializing {len(checked.instances)} FMU instances")
    with phase("initialize"):
        event_mode = EventMode(checked, layout, slaves, clock.start_ns, master.delays)
        initialize(checked, slaves, clock.time(0), clock.time(clock.steps), event_mode.events)
    free = [i for i, one in enumerate(slaves) if one.library.thread_safe and not master.sequence]
    used = threads_for(len(free), threads)
    plan = make_plan(
        layout,
        clock,
        network,
        slaves,
        every,
        free=free,
        threads=used,
        master=master,
        grid=grid or master.variable,
    )
    return RunState(checked, clock, layout, network, slaves, plan, radio, event_mode, Texts(layout, slaves)), used
