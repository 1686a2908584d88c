"""Runs a system in one call: reads, checks, steps and records it, and returns the outcome."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from cosim.pages import large_pages
from cosim_master.diagnostics.errors import (
    CosimError,
    FmuError,
    Problem,
    RecordingFailed,
    SystemDescriptionError,
    Where,
)
from cosim_master.execution.execution import Execution
from cosim_master.execution.options import Listener, Reporting, RunOptions, going_on
from cosim_master.execution.outcome.manifest import as_changes, manifest, settings_before
from cosim_master.execution.outcome.result import Outcome, RunResult, failing, unrecorded
from cosim_master.execution.pacing import interrupts, run
from cosim_master.execution.partitions.cut import Cut, cut, read_assignment
from cosim_master.execution.partitions.opening import (
    failing_openly,
    periods_of,
    refuse_options,
    started,
    told_others,
    told_parts,
)
from cosim_master.execution.partitions.part import PartExecution
from cosim_master.execution.partitions.starting import agree_to_run, who
from cosim_master.execution.partitions.transport import Transport
from cosim_master.execution.partitions.whole import WholeExecution
from cosim_master.execution.planning import Planned, planned
from cosim_master.execution.preparation.fingerprint import digest_of_changes, with_packets
from cosim_master.execution.preparation.isolating import isolation_for
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.preparation.replay import as_json
from cosim_master.execution.run.checkpoint import refuse_checkpoints
from cosim_master.execution.run.faults.crashes import reported
from cosim_master.execution.run.faults.hangs import reported_hangs, reported_start
from cosim_master.execution.run.faults.last_call import kept
from cosim_master.execution.run.faults.process_state import ProcessState, WatchedCalls, WatchedSteps, told
from cosim_master.execution.run.faults.scene import Scene
from cosim_master.execution.run.opening import Setup
from cosim_master.execution.startup.collecting import no_collections
from cosim_master.files.kept import private_cache
from cosim_master.fmi.slaves.fmi2 import Library
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.network.gateways.gateways import Gateways
from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.results.reading.links import Links
from cosim_master.results.recording.recording import Recording
from cosim_master.results.storage.checkpoint_folder import find
from cosim_master.results.storage.journal import FOLDER
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import MakeObserver, Observer, Observers, View
from cosim_master.stepping.profiling import Profiler
from cosim_master.system.reading.read import read_system
from cosim_master.verdict.judging import Interim, judgement
from cosim_master.verdict.monitors.monitoring import Monitoring
from cosim_master.verdict.watching.memory import recall
from cosim_master.verdict.watching.watch import Watch

__all__ = ["simulate", "take_part"]

_REPEATS = "this run takes no packets: its FMUs may discard steps, and what has passed a gateway cannot be taken back"


def simulate(
    system: str | PathLike[str],
    options: RunOptions | None = None,
    *,
    observers: Sequence[MakeObserver] = (),
    listener: Listener | None = None,
    control: Control | None = None,
    mailbox: Mailbox | None = None,
    transport: Transport | None = None,
) -> RunResult:
    """Runs the system in a file and records its results.

    Args:
        system: an .ssd, .ssp, .fmu, multi-model or folder, or a `Swarm` that has been saved.
        options: None runs the system as it is described and records nothing.
        observers: functions that return an observer for a `View` of the run, such as a recording in another format.
        listener: callbacks for the progress.
        control: pauses, steps and paces the run, and sets values, from another thread, instead of `RunOptions.pace`.
        mailbox: takes packets that enter the network as those of a ground station; the recording is the same without
            it until it receives one. Its `refusal` says whether this run takes any.
        transport: of part 0 of a run in several processes, whose other parts call `take_part`; None: one process.

    Returns:
        The outcome. The failure of an FMU is also an outcome, and the recording up to it is kept.

    Raises:
        SystemDescriptionError: the description is invalid, the folder cannot be written to, or a socket cannot be
            opened.
    """
    options, listener = options or RunOptions(), listener or Listener()
    with suppress(OSError):  # a home that cannot be written to: nothing is kept there
        private_cache()  # before code is loaded from it
    with ExitStack() as opened:
        with told_others(transport), no_collections():
            checkpoint = None if options.origin is None else find(options.origin)
            structure = opened.enter_context(read_system(system, options.variant))
            if checkpoint is not None:
                options = going_on(options, checkpoint, structure)
            plan = planned(structure, options, checkpoint, mailbox)
            one = _Run(plan, listener, control or Control(options.pace), Profiler() if options.profile else None)
            one = one.in_parts(transport)
        looking = [make(one.view()) for make in observers]
        listener.prepared(one.plan.ready)
        if one.plan.out is not None:
            _make_folder(one.plan.out)
        scene = Scene()
        if one.plan.federation is not None:
            opened.enter_context(one.plan.federation)
        opened.enter_context(large_pages(one.memory))
        with Gateways(one.plan.asked, listener.gateway, one.plan.ready.network.dialect) as gateways, reported(scene):
            began, before, calls = time.perf_counter(), ProcessState.present(), WatchedCalls()
            try:
                seconds = (options.isolation or Isolation()).limits.of_calls[1]
                with reported_start(scene, seconds) as watch, no_collections():
                    execution = one.opened(calls, scene, watch)
                    started, noted = time.perf_counter() - began, calls.end()
                    # Within the watch, whose descriptors belong to both states.
                    noted += told(
                        calls.after or before, execution.slaves, "functions of its start, up to initialization"
                    )
            except SystemDescriptionError:
                raise
            except CosimError as error:
                return RunResult(Outcome.FAILED, error, notes=one.plan.ready.notes)
            scene.begin(execution.slaves, execution.plan, lambda: execution.state.time)
            return one.driven(execution, gateways, looking, started, noted, scene)


@dataclass(frozen=True, slots=True)
class _Run:
    """A planned run, and those who look at it and pace it; no FMU is loaded."""

    plan: Planned
    listener: Listener
    control: Control
    profiler: Profiler | None
    transport: Transport | None = None
    cut: Cut | None = None
    parts: tuple[Mapping[str, Any], ...] = ()

    def in_parts(self, transport: Transport | None) -> _Run:
        """Returns the run as one part of several, which all have agreed on it; without a transport, the same run.

        Raises:
            SystemDescriptionError: the system cannot be cut, or the parts do not agree.
        """
        if transport is None:
            return self
        refuse_options(self.plan.options, replayed=self.plan.replayed)
        found = self.plan.options.assignment
        assignment = None if found is None else read_assignment(found, transport.parts)
        chosen = cut(self.plan.ready, transport.parts, assignment)
        fmus = {instance.fmu.path.name: instance.fmu.digest for instance in self.plan.ready.checked.instances}
        own = who(transport, self.plan.fingerprint, fmus, chosen)
        parts, packets = agree_to_run(transport, own, packets=self.plan.packets)
        told = tuple(told_parts(parts, self.plan.ready, chosen))
        plan = replace(self.plan, packets=packets)
        return replace(self, plan=plan, transport=transport, cut=chosen, parts=told)

    @property
    def memory(self) -> int:
        """Returns roughly the memory that the instances of this process take, with their share of all else, bytes."""
        everywhere = self.plan.ready.checked.instances
        own = len(everywhere) if self.cut is None or self.transport is None else self.cut.count(self.transport.part)
        return own * 100_000

    def view(self) -> View:
        return View(self.plan.layout, self.plan.ready.every, self.plan.ready.clock.seconds(1))

    def opened(self, calls: WatchedCalls, scene: Scene, watch: Callable[[Library], None] = lambda _: None) -> Execution:
        """Returns the run at its start, with initialized FMUs; `calls` and `watch` get the libraries loaded."""
        ready, options = self.plan.ready, self.plan.options

        def loaded(library: Library) -> None:
            scene.libraries.append(library)
            calls.watch(library)
            watch(library)

        setup = Setup(
            master=ready.master,
            every=ready.every,
            grid=ready.recording.interval is not None and ready.every == 1,
            keep_packets=self.plan.packets,
            threads=options.threads,
            changes=ready.changes,
            stimuli=ready.stimuli,
            profiler=self.profiler,
            checkpoint=self.plan.checkpoint,
            isolation=isolation_for(options.isolation, ready.checked),
            on_stage=self.listener.stage,
            on_library=loaded,
        )
        if self.transport is None or self.cut is None:
            return Execution(ready.checked, ready.clock, self.plan.layout, ready.network, setup)
        kind = WholeExecution if self.transport.part == 0 else PartExecution
        return started(kind, self.transport, self.cut, ready, self.plan.layout, setup)

    def recording(self, execution: Execution, start_up: float) -> Recording | None:
        """Opens the recording of the run; `start_up` is the wall-clock time for which FMUs were loaded, s."""
        if self.plan.out is None:
            return None
        beginning = RunResult(Outcome.RUNNING, None, packets=execution.packet_counts(), notes=self.plan.ready.notes)
        return Recording(
            self.plan.out,
            self.plan.ready.checked,
            self.plan.layout,
            self.plan.ready.network,
            packets=self.plan.ready.recording.packets,
            manifest=self._manifest(self.plan.ready, beginning, start_up, execution, self.plan.fingerprint),
            checkpoint=self.plan.checkpoint,
            in_segments=self.plan.options.checkpoint_every is not None,
        )

    def driven(
        self,
        execution: Execution,
        gateways: Gateways,
        observers: Sequence[Observer],
        start_up: float,
        noted: tuple[str, ...],
        scene: Scene,
    ) -> RunResult:
        """Steps the run to its end and completes its results; `noted` are notes on its start."""
        ready, complete = self.plan.ready, threading.Event()

        def document(result: RunResult) -> dict[str, Any]:
            changed, fingerprint = self._changed(execution)
            found = self._manifest(changed, result, start_up, execution, fingerprint)
            return {**found, "posted": as_json(self._admitted, ready.clock)} if self._admitted else found

        def rescue(error: FmuError) -> None:
            if complete.is_set():
                return
            simulated, counts = execution.time - ready.clock.time(0), execution.packet_counts()
            crashed = RunResult(Outcome.FAILED, error, simulated_s=simulated, packets=counts, notes=ready.notes)
            with suppress(Exception):
                observed.close()
            if recording is not None:
                recording.finish(lambda _: document(crashed))

        with ExitStack() as opened:
            opened.enter_context(execution)
            if (recording := self.recording(execution, start_up)) is not None:
                opened.enter_context(recording)
                opened.enter_context(kept(recording.folder / FOLDER, scene))
            watch = self._watch(execution, recording)
            recorders = [] if recording is None else recording.observers
            monitoring = self._monitoring()
            changes = WatchedSteps(execution.slaves)
            looking = [watch, *observers, Reporting(self.listener), *recorders, *([monitoring] if monitoring else [])]
            looking.append(changes)
            if self.listener.judged is not None:
                judged = self.listener.judged
                looking.append(Interim(ready.verdict(), watch, ready.network, monitoring, judged))
            observed = Observers(execution, looking, ready.clock.steps, execution.blocks)
            opened.enter_context(observed)
            if isinstance(execution, PartExecution):
                execution.agree(periods_of(looking), self.plan.saving.every)
            scene.rescue = rescue
            scene.on_recording()
            if recording is not None and self.plan.options.dataflash:
                gateways.serve_logs(partial(_log_of, recording.folder))
            interrupted = opened.enter_context(interrupts())
            seconds = (self.plan.options.isolation or Isolation()).limits.seconds
            opened.enter_context(reported_hangs(scene, seconds))
            result = self._stepped(execution, gateways, observed, interrupted, changes)
            result = replace(result, notes=(*result.notes, *noted, *changes.notes))
            links = None if recording is None else recording.links()
            result = self._judged(result, execution, watch, monitoring, links)
            if recording is not None:
                self.listener.stage(f"writing {self.plan.out}")
                result = unrecorded(result, recording.finish(lambda failure: document(unrecorded(result, failure))))
            complete.set()
            # If an FMU crashes the process when it is freed, the recording and its manifest are already complete.
            failures = execution.end()
            late = execution.restarts[result.restarts :]
            result = replace(result, notes=(*result.notes, *late), restarts=result.restarts + len(late))
            if (failures or late) and recording is not None:
                with suppress(RecordingFailed):  # the manifest written by `finish` remains
                    recording.write_manifest(document(failing(result, failures)))
        return failing(result, failures)

    def _manifest(
        self,
        ready: Prepared,
        result: RunResult,
        start_up: float,
        execution: Execution,
        fingerprint: Mapping[str, str],
    ) -> dict[str, Any]:
        found = manifest(ready, result, start_up, execution.parameters, fingerprint)
        given = {"variant": self.plan.options.variant, "solver": self.plan.options.solver}
        found |= {name: text for name, text in given.items() if text is not None}
        if self.plan.checkpoint is not None:
            found["checkpoint_time"] = self.plan.checkpoint.time
            if before := settings_before(ready, self.plan.checkpoint):
                found["settings_before"] = before
            found["changes"] = [*as_changes(ready, self.plan.checkpoint.changes), *found["changes"]]
        return {**found, "parts": [dict(one) for one in self.parts]} if self.parts else found

    @property
    def _admitted(self) -> Sequence[tuple[int, bytes]]:
        """The packets of the mailbox that have entered the network, with their base steps."""
        return () if self.plan.mailbox is None else self.plan.mailbox.admitted

    def _changed(self, execution: Execution) -> tuple[Prepared, dict[str, str]]:
        """Returns the run and its fingerprint as if values and packets had been known from the beginning."""
        fingerprint = with_packets(self.plan.fingerprint, self._admitted)
        if not execution.agenda.requested:
            return self.plan.ready, fingerprint
        changes = tuple(sorted([*self.plan.ready.changes, *execution.agenda.requested], key=lambda change: change.k))
        digest = digest_of_changes(self.plan.ready.checked, changes)
        return replace(self.plan.ready, changes=changes), {**fingerprint, "changes": digest}

    def _watch(self, execution: Execution, recording: Recording | None) -> Watch:
        ready = self.plan.ready
        if self.plan.options.checkpoint_every is not None:
            refuse_checkpoints(execution.state)
        watch = Watch(ready.checked, ready.network, self.plan.layout, ready.clock, ready.limits)
        self.plan.saving.watch, self.plan.saving.recording = watch, recording
        if self.plan.checkpoint is not None:
            recall(watch, self.plan.checkpoint.verdict)
        return watch

    def _monitoring(self) -> Monitoring | None:
        """Returns the observer of the system's monitors; None if it has none."""
        ready = self.plan.ready
        if not ready.monitors.every:
            return None
        gridless = ready.master.constrained
        made = Monitoring(
            ready.monitors, self.plan.layout, ready.network, ready.clock, every=ready.every, gridless=gridless
        )
        self.plan.saving.monitoring = made
        if self.plan.checkpoint is not None and "monitors" in self.plan.checkpoint.verdict:
            made.recall(self.plan.checkpoint.verdict["monitors"])
        return made

    def _stepped(
        self,
        execution: Execution,
        gateways: Gateways,
        observed: Observers,
        interrupted: Callable[[], bool],
        changes: WatchedSteps,
    ) -> RunResult:
        gateways.start()
        if self.plan.mailbox is not None and self.plan.asked and self.plan.asked[-1][1] is self.plan.mailbox:
            self.plan.mailbox.refusal = _REPEATS if execution.repeats else ""
            if execution.repeats and self.plan.replayed:
                raise SystemDescriptionError([Problem(Where("--replay"), _REPEATS)])
        changes.begin(execution.time, interrupted)
        result = run(
            execution,
            self.plan.ready,
            gateways,
            observed,
            control=self.control,
            interrupted=interrupted,
            checkpoints=self.plan.saving if self.plan.options.checkpoint_every is not None else None,
            federation=self.plan.federation,
        )
        if self.plan.federation is not None:
            self.plan.federation.error = result.error
        changes.compare(execution.time)
        return unrecorded(result, observed.close())

    def _judged(
        self,
        result: RunResult,
        execution: Execution,
        watch: Watch,
        monitoring: Monitoring | None,
        links: Links | None,
    ) -> RunResult:
        """Returns the result with the verdict on the run, its notes and its profile."""
        ready = self.plan.ready
        if not watch.every:  # there is nothing to watch: it was not told the time
            watch.end = execution.time
        verdict = judgement(ready.verdict(), watch, ready.network, result.packets, result.gateways, monitoring, links)
        notes = (*result.notes, *execution.notes)
        result = replace(result, notes=notes, restarts=len(execution.restarts), verdict=verdict, folder=self.plan.out)
        if self.profiler is not None:
            self.profiler.phases["stepping"] = result.wall_s
            result = replace(result, profile=self.profiler.profile())
        return result


def take_part(system: str | PathLike[str], options: RunOptions, transport: Transport, *, mailbox: bool = False) -> None:
    """Runs a part of a system other than part 0, whose `simulate` has the same system and options.

    Args:
        mailbox: whether that `simulate` has a mailbox.

    Raises:
        Refused: the run does not begin; part 0 says why.
        PartLost: another part has ended, or does not answer.
    """
    options = replace(options, out=None, checkpoint_every=None, pace=None)
    with suppress(OSError):
        private_cache()
    scene = Scene()
    with failing_openly(transport), reported(scene), ExitStack() as opened:
        with told_others(transport), no_collections():
            checkpoint = None if options.origin is None else find(options.origin)
            structure = opened.enter_context(read_system(system, options.variant))
            if checkpoint is not None:
                options = going_on(options, checkpoint, structure)
            plan = planned(structure, options, checkpoint, Mailbox() if mailbox else None)
            one = _Run(plan, Listener(), Control(), None)
            one = one.in_parts(transport)
        opened.enter_context(large_pages(one.memory))
        execution = one.opened(WatchedCalls(), scene)
        assert isinstance(execution, PartExecution)
        scene.begin(execution.slaves, execution.plan, lambda: execution.state.time)
        scene.rescue = lambda error: _crashed(transport, error)
        with execution:
            execution.agree(())
            execution.serve()


def _crashed(transport: Transport, error: FmuError) -> None:
    """Tells part 0 which FMU has crashed this part, and waits until it has completed its files and ends all parts."""
    with suppress(Exception):
        transport.fail(str(error))
        while True:
            transport.receive(0, patient=True)


def _log_of(run: Path, system: int) -> tuple[bytes, int]:
    """Returns what `log_of` does. Only ground stations that ask for a log need it, and messages of MAVLink with it."""
    from cosim_master.results.export.dataflash import log_of

    return log_of(run, system)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot hold the results of a run: {error.strerror}"
        raise SystemDescriptionError([Problem(Where(str(out)), text)]) from None
