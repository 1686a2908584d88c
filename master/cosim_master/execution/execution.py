"""One run: instances of a checked system are initialized, stepped, observed and freed.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, any number of times
    ...                                             recordings completed, instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. If an FMU fails, the recording remains: files are completed
before instances are freed, since some FMUs crash the process when they are freed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cosim_master.diagnostics.errors import FmuError, Problem, RecordingFailed, RunFailed, SystemDescriptionError
from cosim_master.diagnostics.limitations import CHECKPOINT
from cosim_master.execution.algorithms.algorithm import Algorithm
from cosim_master.execution.algorithms.choice import algorithm_for
from cosim_master.execution.run.checkpoint import cannot_be_serialised, restore, save
from cosim_master.execution.run.gateway_port import GatewayPort
from cosim_master.execution.run.instances import Instances
from cosim_master.execution.run.opening import open_run
from cosim_master.execution.run.workers import Workers
from cosim_master.execution.run.writing import Writing
from cosim_master.execution.startup.initialize import answers
from cosim_master.execution.stimuli import Agenda, Stimuli
from cosim_master.fmi.description.read import Start
from cosim_master.network.radio.build import packet_counts
from cosim_master.network.radio.tables import Radio
from cosim_master.results.checkpoint_folder import Checkpoint
from cosim_master.results.recorder import Recorder
from cosim_master.stepping.failures import raise_failures
from cosim_master.stepping.kernels.instances import collect_all
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
        recorder_for: returns the recorder of a run that begins with these packet counts and parameters; called when all
            FMUs have been loaded. None records nothing.
        every: base steps between two rows.
        keep_packets: record packet events and logs.
        threads: number of threads that step native instances; None selects it automatically. Only FMUs built by this
            project are stepped by threads other than the main one: many other FMUs store state in globals, whatever
            they declare.
        changes: values to be set during the run, in the order of time.
        stimuli: inputs from a file, sampled.
        profiler: measures the time profile.
        checkpoint: the checkpoint to resume from.
        master: the master algorithm; None is Jacobi.
        grid: rows at every base step, even if no step of an instance ends there.
        on_stage: called with a description of each stage, until the first step.

    Attributes:
        parameters: of each instance, as its FMU answered after initialization.

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
        recorder_for: Callable[[Mapping[str, int], Mapping[str, Mapping[str, Start]]], Recorder] | None = None,
        every: int = 1,
        keep_packets: bool = True,
        threads: int | None = None,
        changes: Sequence[Change] = (),
        stimuli: Stimuli | None = None,
        profiler: Profiler | None = None,
        checkpoint: Checkpoint | None = None,
        master: MasterSettings | None = None,
        grid: bool = False,
        on_stage: Callable[[str], None] | None = None,
    ) -> None:
        self.checked, self.clock, self.layout, self.network = checked, clock, layout, network
        master = master or MasterSettings()
        phase: Callable[[str], AbstractContextManager[Any]] = profiler.phase if profiler else nullcontext
        self._agenda = Agenda(changes, stimuli, checkpoint.k if checkpoint is not None else 0)
        self._instances, self._workers = Instances(), Workers()
        self._algorithm: Algorithm | None = None
        self._writing: Writing | None = None
        try:
            self._state, self.threads = open_run(
                self._instances,
                checked,
                clock,
                layout,
                network,
                master,
                every=every,
                keep_packets=recorder_for is not None and keep_packets,
                grid=grid,
                threads=threads,
                phase=phase,
                tell=on_stage or (lambda _: None),
            )
            self.slaves, self.plan = self._state.slaves, self._state.plan
            self.parameters, self._notes = answers(checked, self.slaves)
            if profiler is not None:
                profiler.attach(self.plan, self.slaves)
            self._writing = Writing(self._state, phase)
            self._algorithm = algorithm_for(master, self._state, self._writing, self._agenda, self._change, every)
            collect_all(self.plan)
            raise_failures(self.plan, layout, self.slaves)
            if recorder_for is not None:
                self._writing.open(recorder_for(self.packet_counts(), self.parameters))
            self._state.event_mode.attach(self.plan, self._state.texts)
            self._begin(checkpoint)
            self._start = self.time
        except BaseException as error:
            self._free()
            if self._writing is not None:
                self._writing.abandon()
            if isinstance(error, FmuError):
                raise RunFailed([error]) from None
            raise

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        """Proceeds from the outputs at the start to the first communication point, or to that of a checkpoint."""
        assert self._algorithm is not None and self._writing is not None
        if checkpoint is not None:
            self.refuse_checkpoints()
            restore(checkpoint, self._state)
        self._algorithm.prepare()
        port = GatewayPort(self._state, self._writing)
        self.admit, self.take, self.waiting = port.admit, port.take, port.waiting
        if self.network.gateways:
            port.compile()
        self._workers.start(self.plan, self.threads)
        if checkpoint is None:
            # One call up to k = 0 routes the packets that the instances send at the start, and records the first row.
            self.advance(0)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on parameters that differ from the values set, and on the steps made."""
        assert self._algorithm is not None
        return (*self._notes, *self._algorithm.notes)

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

    def refuse_checkpoints(self) -> None:
        """Raises SystemDescriptionError, with the reason, if this system cannot have checkpoints."""
        reason = "what has passed a gateway cannot be taken back" if self.network.gateways else ""
        if reason := reason or cannot_be_serialised(self.slaves):
            raise SystemDescriptionError([Problem(self.checked.structure.where, CHECKPOINT.text(reason))])

    def save_checkpoint(self, folder: Path, about: Mapping[str, Any]) -> Path:
        """Writes a checkpoint of the current communication point, or of the next one on the system's own grid.

        Raises:
            SystemDescriptionError: the run has gateways, or FMUs that cannot serialise their state.
            RunFailed: an FMU fails to serialise its state, or a step up to that communication point fails.
        """
        assert self._algorithm is not None and self._writing is not None
        self.refuse_checkpoints()
        self._algorithm.settle()
        self._writing.rows()
        self._writing.packets()
        position, segments = self._writing.position(), self._writing.segments()
        try:
            return save(folder, self._state, self.k, position=position, segments=segments, about=about)
        except FmuError as error:
            raise RunFailed([error]) from None

    def packet_counts(self) -> dict[str, int]:
        """Returns the numbers of packets by radio, as the radio's `packet_counts` does."""
        return packet_counts(self._state.radio)

    def keep(self, wall: float) -> None:
        """Makes all values recorded so far readable, even if the process is killed.

        Args:
            wall: wall-clock time since the first step, s, for the manifest.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        assert self._writing is not None
        progress = self._progress()
        factor = progress["simulated_s"] / wall if wall > 0 else 0.0
        self._writing.keep({**progress, "wall_s": wall, "real_time_factor": factor})

    def _progress(self) -> dict[str, Any]:
        return {"simulated_s": self.time - self._start, "packets": self.packet_counts()}

    def finish(self, manifest: Callable[[RecordingFailed | None], Mapping[str, Any]]) -> RecordingFailed | None:
        """Completes the recording, with its manifest; call once, before leaving the context.

        Args:
            manifest: returns the manifest; its argument is the reason why the recording cannot be completed.

        Returns:
            The reason why the recording is incomplete; None if it is complete.
        """
        assert self._writing is not None
        failure = None
        try:
            self._writing.finish()
        except RecordingFailed as error:
            failure = error
        try:
            self._writing.write_manifest(lambda: manifest(failure))
        except RecordingFailed as error:
            failure = failure or error
        return failure

    def end(self, manifest: Callable[[Sequence[FmuError]], Mapping[str, Any]]) -> tuple[FmuError, ...]:
        """Terminates and frees all instances; returns the errors. Call it once, after `finish`.

        Args:
            manifest: returns a new manifest after such errors, which replaces the one written by `finish`.
        """
        failures = tuple(self._free())
        if failures and self._writing is not None:
            with suppress(RecordingFailed):  # the manifest written by `finish` remains
                self._writing.write_manifest(lambda: manifest(failures))
        return failures

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and self._writing is not None:
            self._writing.break_off(self._progress())
        failures = self._free()
        if failures and kind is None:
            raise RunFailed(failures)

    def _free(self) -> list[FmuError]:
        """Terminates and frees all instances, each once, even if others fail."""
        self._workers.stop()
        if self._algorithm is not None:
            self._algorithm.close()
        return self._instances.end()
