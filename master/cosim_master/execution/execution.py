"""One run: instances of a checked system are initialized, stepped, observed and freed.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, any number of times
    ...                                             instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. `Observers` records a run: it steps an `Execution`, and hands
the contents of its `blocks` over to the recorders. Close it before the instances are freed, since some FMUs crash the
process when they are freed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cosim_master.diagnostics.errors import FmuError, Problem, RunFailed, SystemDescriptionError
from cosim_master.diagnostics.limitations import CHECKPOINT
from cosim_master.execution.algorithms.algorithm import Algorithm
from cosim_master.execution.algorithms.choice import algorithm_for
from cosim_master.execution.preparation.stimuli import Agenda, Stimuli
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.checkpoint import cannot_be_serialised, restore, save
from cosim_master.execution.run.gateway_port import GatewayPort
from cosim_master.execution.run.instances import Instances
from cosim_master.execution.run.opening import open_run
from cosim_master.execution.run.workers import Workers
from cosim_master.execution.startup.initialize import answers
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.network.radio.build import packet_counts
from cosim_master.network.radio.tables import Radio
from cosim_master.results.checkpoint_folder import Checkpoint, Position
from cosim_master.stepping.failures import raise_failures
from cosim_master.stepping.kernels.instances import collect_all
from cosim_master.stepping.kernels.macro_step import record
from cosim_master.stepping.kernels.tables import EVERY, ROWS, K
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.profiling import Profiler
from cosim_master.stepping.strings import failing
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.master import MasterSettings
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Execution"]


class Execution:
    """A system during a run. It must not be used from two threads at once.

    Args:
        checked: the system; its structure must stay open.
        clock: start, base step and periods.
        layout: the places of all values.
        network: nodes and radio.
        every: base steps between two rows.
        keep_packets: collect packet events and logs for the observers of the run.
        threads: number of threads that step native instances; None selects it automatically. Only FMUs built by this
            project are stepped by threads other than the main one: many other FMUs store state in globals, whatever
            they declare.
        changes: values to be set during the run, in the order of time.
        stimuli: inputs from a file, sampled.
        profiler: measures the time profile.
        checkpoint: the checkpoint to resume from.
        master: the master algorithm; None is Jacobi.
        grid: rows at every base step, even if no step of an instance ends there.
        isolation: selects the FMUs that run in processes of their own; None: none does.
        on_stage: called with a description of each stage, until the first step.
        on_library: called with each library that is loaded.

    Attributes:
        parameters: of each instance, as its FMU answered after initialization.
        blocks: rows and packets that have not been handed over to observers.
        requested: the values that `request` has set.

    Raises:
        SystemDescriptionError: interpreted FMUs are incompatible with each other.
        RunFailed: an FMU refused during start-up; all instances are freed.
    """

    def __init__(
        self,
        checked: CheckedSystem,
        clock: TimeGrid,
        layout: Layout,
        network: Network,
        *,
        every: int = 1,
        keep_packets: bool = False,
        threads: int | None = None,
        changes: Sequence[Change] = (),
        stimuli: Stimuli | None = None,
        profiler: Profiler | None = None,
        checkpoint: Checkpoint | None = None,
        master: MasterSettings | None = None,
        grid: bool = False,
        isolation: Isolation | None = None,
        on_stage: Callable[[str], None] | None = None,
        on_library: Callable[[Library], None] | None = None,
    ) -> None:
        self.checked, self.clock, self.layout, self.network = checked, clock, layout, network
        master = master or MasterSettings()
        phase: Callable[[str], AbstractContextManager[Any]] = profiler.phase if profiler else nullcontext
        self._agenda = Agenda(changes, stimuli, checkpoint.k if checkpoint is not None else 0)
        self.requested: list[Change] = []
        self._instances, self._workers = Instances(isolation, on_library), Workers()
        self._algorithm: Algorithm | None = None
        try:
            self._state, self.threads = open_run(
                self._instances,
                checked,
                clock,
                layout,
                network,
                master,
                every=every,
                keep_packets=keep_packets,
                grid=grid,
                threads=threads,
                phase=phase,
                tell=on_stage or (lambda _: None),
            )
            self.slaves, self.plan = self._state.slaves, self._state.plan
            self.parameters, self._notes = answers(checked, self.slaves)
            if profiler is not None:
                profiler.attach(self.plan, self.slaves)
            self.blocks = Blocks(self._state, phase)
            self._algorithm = algorithm_for(master, self._state, self.blocks, self._agenda, self._change, every)
            collect_all(self.plan)
            raise_failures(self.plan, layout, self.slaves)
            self._state.event_mode.attach(self.plan, self._state.texts)
            self._begin(checkpoint)
        except BaseException as error:
            self.end()
            if isinstance(error, FmuError):
                raise RunFailed([error]) from None
            raise

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        """Proceeds from the outputs at the start to the first communication point, or to that of a checkpoint."""
        assert self._algorithm is not None
        if checkpoint is not None:
            self.refuse_checkpoints()
            restore(checkpoint, self._state)
        self._algorithm.prepare()
        port = GatewayPort(self._state, self.blocks)
        self.admit, self.take, self.waiting = port.admit, port.take, port.waiting
        if self.network.gateways:
            port.compile()
        self._workers.start(self.plan, self.threads)
        if checkpoint is None:
            # One call up to k = 0 routes the packets that the instances send at the start, and records the first row.
            self.advance(0)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on parameters that differ from the values set, on the steps made, and on restarts."""
        assert self._algorithm is not None
        return (*self._notes, *self._algorithm.notes, *self.restarts)

    @property
    def restarts(self) -> tuple[str, ...]:
        """What happened when processes of FMUs were started anew."""
        return self._instances.restarts

    @property
    def k(self) -> int:
        """The number of base steps completed, in the system's own grid."""
        assert self._algorithm is not None
        return self._algorithm.k

    @property
    def time(self) -> float:
        """Simulation time reached, s."""
        return self._state.time

    @property
    def radio(self) -> Radio:
        """The arrays of the radio, which are replaced when they become too small."""
        return self._state.radio

    @radio.setter
    def radio(self, radio: Radio) -> None:
        self._state.radio = radio

    def advance(self, k_stop: int) -> None:
        """Makes macro steps until base step `k_stop`; with error control, at least until the next row.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, and the recording ends at its start.
            RunTerminated: an FMU requests the end of the simulation; the same applies.
        """
        assert self._algorithm is not None
        self._algorithm.advance(min(k_stop, self.clock.steps))

    def _change(self, k: int) -> bool:
        """Sets the values that are due at base step `k`; returns whether any were due."""
        changed = False
        for change in self._agenda.take(k):
            with failing(self.plan, self.slaves[change.instance]):
                self._state.event_mode.change(change)
            changed = True
        return changed

    def request(self, change: Change) -> float | None:
        """Sets a value before the next step of its instance, as a change known from the beginning would at that time.

        Returns:
            The time of that step, s; None if the run ends before.
        """
        period = self.clock.periods[change.instance]
        due = replace(change, k=-(-self.k // period) * period)
        if due.k >= self.clock.steps:
            return None
        self._agenda.add(due)
        self.requested.append(due)
        return self.clock.time(due.k)

    def record_end(self) -> None:
        """Records a row of the current communication point, with which the run ends, unless it has one."""
        plan = self.plan
        if int(plan.counters[K]) % int(plan.counters[EVERY]):
            if int(plan.counters[ROWS]) == plan.ticks.size:
                self.blocks.rows()
            record(plan)
            if self._state.texts:
                self.blocks.read_texts(recorded=True)

    def refuse_checkpoints(self) -> None:
        """Raises SystemDescriptionError, with the reason, if this system cannot have checkpoints."""
        reason = "what has passed a gateway cannot be taken back" if self.network.gateways else ""
        if reason := reason or cannot_be_serialised(self.slaves):
            raise SystemDescriptionError([Problem(self.checked.structure.where, CHECKPOINT.text(reason))])

    def save_checkpoint(
        self, folder: Path, about: Mapping[str, Any], recorded: Callable[[], tuple[Position, Sequence[Path]]]
    ) -> Path:
        """Writes a checkpoint of the current communication point, or of the next one on the system's own grid.

        Args:
            about: what the checkpoint tells of the run.
            recorded: returns the position of the recording, and its segments since the last checkpoint; called when
                the blocks are empty.

        Raises:
            SystemDescriptionError: the run has gateways, or FMUs that cannot serialise their state.
            RunFailed: an FMU fails to serialise its state, or a step up to that communication point fails.
        """
        assert self._algorithm is not None
        self.refuse_checkpoints()
        self._algorithm.settle()
        self.blocks.rows()
        self.blocks.packets()
        position, segments = recorded()
        try:
            return save(folder, self._state, self.k, position=position, segments=segments, about=about)
        except FmuError as error:
            raise RunFailed([error]) from None

    def packet_counts(self) -> dict[str, int]:
        """Returns the numbers of packets by radio, as the radio's `packet_counts` does."""
        return packet_counts(self._state.radio)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        failures = self.end()
        if failures and kind is None:
            raise RunFailed(failures)

    def end(self) -> list[FmuError]:
        """Terminates and frees all instances, each once, even if others fail; returns the errors."""
        self._workers.stop()
        if self._algorithm is not None:
            self._algorithm.close()
        return self._instances.end()
