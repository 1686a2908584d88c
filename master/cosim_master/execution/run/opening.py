"""The start of a run from a checked system: it initializes the instances, and makes the plan and the radio."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

from cosim_master.execution.events.event_mode import EventMode
from cosim_master.execution.preparation.stimuli import Stimuli
from cosim_master.execution.run.instances import Instances
from cosim_master.execution.run.state import RunState
from cosim_master.execution.run.workers import threads_for
from cosim_master.execution.startup.initialize import initialize
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.network.radio.build import make_radio
from cosim_master.network.radio.confining import confined_radio
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.stepping.confining import confined
from cosim_master.stepping.grouping import grouped
from cosim_master.stepping.kernels.frames import NO_FRAMES, frames_of
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.plan import make_plan
from cosim_master.stepping.profiling import Profiler
from cosim_master.stepping.strings import Texts
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Setup", "Share", "open_run"]


def _nothing(_: str) -> None:
    """Ignores a description of a stage."""


@dataclass(frozen=True, slots=True)
class Share:
    """The part of a system that one process of several runs.

    Attributes:
        elsewhere: numbers of the instances that other processes run.
        nodes: numbers of the radio nodes of the other processes.
        reals, ints: places of the values that it passes on, in `Plan.real_out` and `Plan.int_out`.
        window: the largest number of base steps between two exchanges.
    """

    elsewhere: frozenset[int]
    nodes: frozenset[int]
    reals: tuple[int, ...]
    ints: tuple[int, ...]
    window: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """How a checked system runs: master algorithm, threads, processes, changes, and the data to be collected."""

    master: MasterSettings = field(default_factory=MasterSettings)
    """The master algorithm."""
    every: int = 1
    """Base steps between two rows."""
    grid: bool = False
    """Rows at every base step, even if no step of an instance ends there."""
    keep_packets: bool = False
    """Collect packet events and logs for the observers of the run."""
    threads: int | None = None
    """Number of threads that step native instances; None selects it automatically. Only FMUs built by this project are
    stepped by threads other than the main one: many other FMUs store state in globals, whatever they declare."""
    changes: Sequence[Change] = ()
    """Values to be set during the run, in the order of time."""
    stimuli: Stimuli | None = None
    """Inputs from a file, sampled."""
    profiler: Profiler | None = None
    """Measures the time profile."""
    checkpoint: Checkpoint | None = None
    """The checkpoint to resume from."""
    isolation: Isolation | None = None
    """Selects the FMUs that run in processes of their own; None: none does."""
    on_stage: Callable[[str], None] = _nothing
    """Called with a description of each stage, until the first step."""
    on_library: Callable[[Library], None] | None = None
    """Called with each library that is loaded."""

    share: Share | None = None
    """The part of the system that this process runs; None: all of it."""

    def phase(self, name: str) -> AbstractContextManager[Any]:
        """Measures the time of a phase of this name."""
        return self.profiler.phase(name) if self.profiler is not None else nullcontext()


def open_run(
    instances: Instances,
    checked: CheckedSystem,
    clock: TimeGrid,
    layout: Layout,
    network: Network,
    setup: Setup,
) -> tuple[RunState, int]:
    """Loads and initializes all FMU instances; returns the run at its start, and the number of threads that step it.

    Args:
        instances: receives the instances, and ends them even after an error here.

    Raises:
        SystemDescriptionError: interpreted FMUs are incompatible with each other, or an own channel cannot be compiled.
        FmuError: an FMU refuses.
        LoopError: outputs depend on each other at the start, and no consistent values were found.
    """
    tell, phase, master = setup.on_stage, setup.phase, setup.master
    radio = make_radio(network, layout.ports["Real"].index, keep=setup.keep_packets)
    share = setup.share
    elsewhere: frozenset[int] = frozenset() if share is None else share.elsewhere
    here = len(checked.instances) - len(elsewhere)
    tell(f"loading {here} FMU instances")
    with phase("load and instantiate"):
        instances.make(checked, elsewhere)
    slaves = instances.slaves
    tell(f"initializing {here} FMU instances")
    with phase("initialize"):
        event_mode = EventMode(checked, layout, slaves, clock.start_ns, master.delays)
        if master.sets_inputs_by_event:
            event_mode.events.set_inputs_by_event()
        begun = checked if share is None else _without(checked, elsewhere)
        initialize(begun, slaves, clock.time(0), clock.time(clock.steps), event_mode.events)
    free = [i for i, one in enumerate(slaves) if one.library.thread_safe and not master.sequence]
    used = threads_for(len(free), setup.threads)
    plan = make_plan(
        layout,
        clock,
        network,
        slaves,
        setup.every,
        free=free,
        threads=used,
        master=master,
        grid=setup.grid or master.variable,
    )
    frames = NO_FRAMES
    if share is not None:
        plan = confined(plan, layout, clock.periods, elsewhere)
        radio = confined_radio(radio, share.nodes)
        frames = frames_of(share.reals, share.ints, share.window + 1)
    texts = Texts(layout, slaves)
    if share is None and not texts:
        plan, radio = grouped(plan, radio, clock.periods, used)
    return RunState(checked, clock, layout, network, slaves, plan, radio, event_mode, texts, frames), used


def _without(checked: CheckedSystem, elsewhere: Collection[int]) -> CheckedSystem:
    """Returns the system for initialization without the links of instances that are elsewhere."""
    away = {checked.instances[i].name for i in elsewhere}
    ends = [{link.source[0], link.target[0]} for link in checked.links]
    stages = (replace(stage, links=tuple(i for i in stage.links if not ends[i] & away)) for stage in checked.init_order)
    return replace(checked, init_order=tuple(stage for stage in stages if stage.links))
