"""One run: instances from a checked system, initialized, stepped, observed, and freed again.

    with Execution(checked, ...) as execution:      instantiate, initialize, collect outputs at t0
        execution.advance(k)                        macro steps up to base step k, as often as wanted
    ...                                             recordings completed, instances terminated and freed

The order of calls is that of FMI 2.0.5, section 4.2.4. If an FMU fails, the recording stays: files are
completed before anything is freed, since some FMUs take the process with them when they go.
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
    """A system that is being run. Not to be used from two threads at once.

    Args:
        checked: the system; its structure must stay open.
        clock: start, base step and periods.
        layout: where values live.
        network: nodes and radio.
        recorder_for: makes the recorder of a run that begins with these packet counts and parameters, once everything
            has been loaded; None records nothing.
        every: rows every so many base steps.
        keep_packets: record packet events and logs.
        threads: how many step native instances; None chooses. Only FMUs built by this project are stepped by
            other threads than the main one: many others keep state in globals, whatever they declare.
        changes: values to be set while it runs, in the order of time.
        stimuli: inputs from a file, sampled.
        profiler: measures where the time goes.
        checkpoint: go on from there.
        master: the master; None is Jacobi.
        grid: rows at every base step, also where no step of an instance ends.
        on_stage: called with the next stage in words, until the first step.

    Attributes:
        parameters: of each instance, as its FMU answered after initialization.

    Raises:
        SystemDescriptionError: interpreted FMUs that do not fit together.
        RunFailed: an FMU refused during start-up; everything is freed.
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
            # One call up to k = 0 sends what the instances have to send at the start and records the first row.
            self.advance(0)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on parameters that differ from the values set, and on the steps made."""
        assert self._algorithm is not None
        return (*self._notes, *self._algorithm.notes)

    @property
    def k(self) -> int:
        """Base steps done, of the system's own grid."""
        assert self._algorithm is not None
        return self._algorithm.k

    @property
    def time(self) -> float:
        """Simulation time reached, s."""
        return self._state.time

    @property
    def radio(self) -> Radio:
        """The arrays of the radio; they are replaced where they become too small."""
        return self._state.radio

    @radio.setter
    def radio(self, radio: Radio) -> None:
        self._state.radio = radio

    def advance(self, k_stop: int) -> None:
        """Macro steps until base step `k_stop`; if the error decides their size, until the next row at least.

        Raises:
            RunFailed: instances failed; the others have finished this macro step, recorded data reaches its start.
            RunTerminated: an FMU wants the simulation to end; the same is true.
        """
        assert self._algorithm is not None
        self._algorithm.advance(min(k_stop, self.clock.steps))

    def _change(self, k: int) -> bool:
        """Sets the values that are due at base step `k`; returns whether there were any."""
        changed = False
        for change in self._agenda.take(k):
            with failing(self.plan, self.slaves[change.instance]):
                self._state.event_mode.change(change)
            changed = True
        return changed

    def refuse_checkpoints(self) -> None:
        """Raises SystemDescriptionError if this system can have none, and says why."""
        reason = "what has passed a gateway cannot be taken back" if self.network.gateways else ""
        if reason := reason or cannot_be_serialised(self.slaves):
            raise SystemDescriptionError([Problem(self.checked.structure.where, CHECKPOINT.text(reason))])

    def save_checkpoint(self, folder: Path, about: Mapping[str, Any]) -> Path:
        """Writes a checkpoint of the present communication point, or of the next one on the system's own grid.

        Raises:
            SystemDescriptionError: there are gateways, or FMUs that cannot serialise their state.
            RunFailed: an FMU cannot after all, or steps up to that communication point fail.
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
        """Packets by radio, as `packet_counts`."""
        return packet_counts(self._state.radio)

    def keep(self, wall: float) -> None:
        """Makes readable what has been recorded so far, whatever ends the process.

        Args:
            wall: wall-clock time since the first step, s, for the manifest.

        Raises:
            RecordingFailed: it cannot be written.
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
            manifest: makes the manifest; its argument is the reason for which the recording cannot be completed.

        Returns:
            That reason; None if all is complete.
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
        """Terminates and frees all instances; returns how that failed. Call once, after `finish`.

        Args:
            manifest: makes a new manifest, if it did: it takes the place of the one that `finish` wrote.
        """
        failures = tuple(self._free())
        if failures and self._writing is not None:
            with suppress(RecordingFailed):  # the one that `finish` wrote is there
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
