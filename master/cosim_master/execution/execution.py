"""One run: instances of a checked system are initialized, stepped, observed and freed.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, any number of times
    ...                                             instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. `Observers` records a run: it steps an `Execution`, and hands
the contents of its `blocks` over to the recorders. Close it before the instances are freed, since some FMUs crash the
process when they are freed.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import Self

from cosim.entry import forget_tables
from cosim_master.diagnostics.errors import FmuError, RunFailed
from cosim_master.execution.algorithms.choice import algorithm_for
from cosim_master.execution.algorithms.fixed_step import FixedStep
from cosim_master.execution.preparation.stimuli import Agenda
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.checkpoint import Saved, captured, refuse_checkpoints, restore
from cosim_master.execution.run.gateway_port import GatewayPort
from cosim_master.execution.run.instances import Instances
from cosim_master.execution.run.opening import Setup, open_run
from cosim_master.execution.run.workers import Workers
from cosim_master.execution.startup.initialize import answers
from cosim_master.network.radio.build import packet_counts
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.stepping.failures import raise_failures
from cosim_master.stepping.kernels.instances import collect_all
from cosim_master.stepping.kernels.tables import RUNNING
from cosim_master.stepping.layout import Layout
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
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
        setup: how it runs; None is the default of each of its attributes.

    Attributes:
        agenda: the values that are set during the run, to which more can be added.
        state: everything that changes during the run.
        parameters: of each instance, as its FMU answered after initialization.
        blocks: rows and packets that have not been handed over to observers.

    Raises:
        SystemDescriptionError: interpreted FMUs are incompatible with each other.
        RunFailed: an FMU refused during start-up; all instances are freed.
    """

    def __init__(
        self, checked: CheckedSystem, clock: TimeGrid, layout: Layout, network: Network, setup: Setup | None = None
    ) -> None:
        setup = setup or Setup()
        self.checked, self.clock, self.layout, self.network = checked, clock, layout, network
        self.agenda = Agenda(setup.changes, setup.stimuli, setup.checkpoint.k if setup.checkpoint is not None else 0)
        self._instances, self._workers = Instances(setup.isolation, setup.on_library), Workers()
        self._opened = ExitStack()
        try:
            self.state, self.threads = open_run(self._instances, checked, clock, layout, network, setup)
            self.slaves, self.plan = self.state.slaves, self.state.plan
            self.parameters, self._notes = answers(checked, self.slaves)
            if setup.profiler is not None:
                setup.profiler.attach(self.plan, self.slaves)
            self.blocks = Blocks(self.state, setup.phase)
            self._algorithm = algorithm_for(setup.master, self.state, self.blocks, self.agenda, self._set, setup.every)
            self._opened.callback(self._algorithm.close)
            with setup.phase("initialize"):
                collect_all(self.plan)
                self.plan.shared[RUNNING] = 0
            raise_failures(self.plan, layout, self.slaves)
            self.state.event_mode.attach(self.plan, self.state.texts)
            self._begin(setup.checkpoint)
        except BaseException as error:
            self.end()
            if isinstance(error, FmuError):
                raise RunFailed([error]) from None
            raise

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        """Proceeds from the outputs at the start to the first communication point, or to that of a checkpoint."""
        if checkpoint is not None:
            self._resume(checkpoint)
        self._algorithm.prepare()
        self._port = port = GatewayPort(self.state, self.blocks)
        self.admit, self.take, self.waiting = port.admit, port.take, port.waiting
        if self.network.gateways:
            port.compile()
        self._workers.start(self.state, self.threads)
        if checkpoint is None:
            # One call up to k = 0 routes the packets that the instances send at the start, and records the first row.
            self.advance(0)

    def _resume(self, checkpoint: Checkpoint) -> None:
        """Sets the run to the state of a checkpoint."""
        refuse_checkpoints(self.state)
        restore(checkpoint, self.state)
        for change in self.agenda.before(checkpoint.k):
            self.slaves[change.instance].changed[change.variable.name] = change.value

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on parameters that differ from the values set, on the steps made, and on restarts."""
        return (*self._notes, *self._algorithm.notes, *self.restarts)

    @property
    def restarts(self) -> tuple[str, ...]:
        """What happened when processes of FMUs were started anew."""
        return self._instances.restarts

    @property
    def repeats(self) -> bool:
        """Whether steps may be repeated, so that packets from outside the network could be lost or doubled."""
        return not isinstance(self._algorithm, FixedStep) or self._algorithm.repeats

    @property
    def k(self) -> int:
        """The number of base steps completed, in the system's own grid."""
        return self._algorithm.k

    @property
    def entry(self) -> int:
        """The base step before which packets that are admitted now enter the network."""
        return self.k

    @property
    def time(self) -> float:
        """Simulation time reached, s."""
        return self.state.time

    def advance(self, k_stop: int) -> None:
        """Makes macro steps until base step `k_stop`; with error control, at least until the next row.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, and the recording ends at its start.
            RunTerminated: an FMU requests the end of the simulation; the same applies.
        """
        self._algorithm.advance(min(k_stop, self.clock.steps))

    def _set(self, k: int) -> bool:
        return self.state.change(self.agenda.take(k))

    def request(self, change: Change) -> float | None:
        """Adds a value to be set as soon as possible; see `Agenda.request`."""
        return self.agenda.request(change, self.k, self.clock)

    def settle(self) -> Saved:
        """Steps to the next communication point of the system's own grid, if the run is between two; returns its state.

        All rows and packets up to then are handed over to the observers, so that a checkpoint can be saved.

        Raises:
            RunFailed: a step up to that communication point fails.
            FmuError: an FMU fails to save its state.
        """
        self._algorithm.settle()
        self.blocks.rows()
        self.blocks.packets()
        return captured(self.state)

    def conclude(self) -> None:
        """Prepares for the end of the run at the present communication point, when the user ends it."""

    def packet_counts(self) -> dict[str, int]:
        """Returns the numbers of packets by radio, as the radio's `packet_counts` does."""
        return packet_counts(self.state.radio)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        failures = self.end()
        if failures and kind is None:
            raise RunFailed(failures)

    def end(self) -> list[FmuError]:
        """Terminates and frees all instances, each once, even if others fail; returns the errors."""
        self._workers.stop()
        self._opened.close()
        forget_tables()
        return self._instances.end()
