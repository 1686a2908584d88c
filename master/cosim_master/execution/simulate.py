"""Runs a system in one call: reads, checks, steps and records it, and returns the outcome."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import CosimError, FmuError, Problem, SystemDescriptionError, Where
from cosim_master.execution.execution import Execution
from cosim_master.execution.fingerprint import fingerprint_of
from cosim_master.execution.manifest import digest_of_system, manifest
from cosim_master.execution.options import Listener, RunOptions, going_on
from cosim_master.execution.pacing import Checkpoints, interrupts, run
from cosim_master.execution.prepare import Prepared, prepare
from cosim_master.execution.result import Outcome, RunResult, failing, unrecorded
from cosim_master.execution.run.crashes import reported
from cosim_master.execution.stimuli import read_stimuli
from cosim_master.fmi.description.read import Start
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.network.gateways.gateways import Address, Gateways, gateways_of
from cosim_master.results.checkpoint_folder import Checkpoint, find
from cosim_master.results.recorder import Recorder
from cosim_master.results.run_folder import RunFolder
from cosim_master.stepping.layout import Layout, make_layout
from cosim_master.stepping.observation import MakeObserver, Observer, Observers, View
from cosim_master.stepping.profiling import Profiler
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.single_fmu import as_model_exchange, full_names
from cosim_master.system.settings.network import Gateway, with_gateways
from cosim_master.system.structure import SystemStructure
from cosim_master.verdict.judging import judgement
from cosim_master.verdict.memory import recall
from cosim_master.verdict.watch import Watch, watched

__all__ = ["simulate"]


def simulate(
    system: str | PathLike[str],
    options: RunOptions | None = None,
    *,
    observers: Sequence[MakeObserver] = (),
    listener: Listener | None = None,
) -> RunResult:
    """Runs the system in a file and records its results.

    Args:
        system: an .ssd, .ssp, .fmu, multi-model or folder, or a `Swarm` that has been saved.
        options: None runs the system as it is described and records nothing.
        observers: functions that return an observer for a `View` of the run, such as a recording in another format.
        listener: callbacks for the progress.

    Returns:
        The outcome. The failure of an FMU is also an outcome, and the recording up to it is kept.

    Raises:
        SystemDescriptionError: the description is invalid, the folder cannot be written to, or a socket cannot be
            opened.
    """
    options, listener = options or RunOptions(), listener or Listener()
    checkpoint = None if options.origin is None else find(options.origin)
    with read_system(system, options.variant) as structure:
        if checkpoint is not None:
            options = going_on(options, checkpoint, structure)
        one = _planned(structure, options, checkpoint, listener)
        looking = [make(one.view()) for make in observers]
        listener.prepared(one.ready)
        if one.out is not None:
            _make_folder(one.out)
        with Gateways(one.asked, listener.gateway, one.ready.network.dialect) as gateways:
            began = time.perf_counter()
            try:
                execution = one.opened(began)
            except SystemDescriptionError:
                raise
            except CosimError as error:
                return RunResult(Outcome.FAILED, error, notes=one.ready.notes)
            return one.driven(execution, gateways, looking, time.perf_counter() - began)


@dataclass(frozen=True, slots=True)
class _Run:
    """A planned run: the system is checked, and no FMU is loaded."""

    ready: Prepared
    options: RunOptions
    listener: Listener
    checkpoint: Checkpoint | None
    asked: Sequence[tuple[Gateway, Address]]
    fingerprint: dict[str, str]
    out: Path | None
    saving: Checkpoints
    layout: Layout
    profiler: Profiler | None

    def view(self) -> View:
        return View(self.layout, self.ready.every, self.ready.clock.seconds(1))

    def opened(self, began: float) -> Execution:
        """Returns the run at its start, with initialized FMUs; `began` is the time at which loading them began."""
        ready, options = self.ready, self.options
        return Execution(
            ready.checked,
            ready.clock,
            self.layout,
            ready.network,
            recorder_for=None if self.out is None else partial(self._recorder, began),
            every=ready.every,
            keep_packets=ready.recording.packets,
            threads=options.threads,
            changes=ready.changes,
            stimuli=ready.stimuli,
            profiler=self.profiler,
            checkpoint=self.checkpoint,
            master=ready.master,
            grid=ready.recording.interval is not None and ready.every == 1,
            on_stage=self.listener.stage,
        )

    def _recorder(
        self, began: float, packets: Mapping[str, int], parameters: Mapping[str, Mapping[str, Start]]
    ) -> Recorder:
        assert self.out is not None
        beginning = RunResult(Outcome.RUNNING, None, packets=packets, notes=self.ready.notes)
        return Recorder(
            self.out,
            self.ready.checked,
            self.layout,
            self.ready.network,
            keep=self.ready.recording.packets,
            manifest=manifest(self.ready, beginning, time.perf_counter() - began, parameters, self.fingerprint),
            checkpoint=self.checkpoint,
            in_segments=self.options.checkpoint_every is not None,
        )

    def driven(
        self, execution: Execution, gateways: Gateways, observers: Sequence[Observer], start_up: float
    ) -> RunResult:
        """Steps the run to its end and completes its results."""
        ready, complete = self.ready, threading.Event()

        def document(result: RunResult) -> dict[str, Any]:
            return manifest(ready, result, start_up, execution.parameters, self.fingerprint)

        def rescue(error: FmuError) -> None:
            if complete.is_set():
                return
            simulated, counts = execution.time - ready.clock.time(0), execution.packet_counts()
            crashed = RunResult(Outcome.FAILED, error, simulated_s=simulated, packets=counts, notes=ready.notes)
            execution.finish(lambda _: document(crashed))

        with execution, reported(execution.slaves, lambda: execution.time, rescue), interrupts() as interrupted:
            result = self._stepped(execution, gateways, observers, interrupted)
            if self.out is not None:
                self.listener.stage(f"writing {self.out}")
            incomplete = execution.finish(lambda failure: document(unrecorded(result, failure)))
            complete.set()
            result = unrecorded(result, incomplete)
            # If an FMU crashes the process when it is freed, the recording and its manifest are already complete.
            failures = execution.end(lambda errors: document(failing(result, errors)))
        return failing(result, failures)

    def _stepped(
        self,
        execution: Execution,
        gateways: Gateways,
        observers: Sequence[Observer],
        interrupted: Callable[[], bool],
    ) -> RunResult:
        ready, options = self.ready, self.options
        if options.checkpoint_every is not None:
            execution.refuse_checkpoints()
        gateways.start()
        watch = Watch(ready.checked, ready.network, self.layout, ready.clock, ready.limits)
        self.saving.watch = watch
        if self.checkpoint is not None:
            recall(watch, self.checkpoint.verdict)
        with closing(Observers(execution, [watch, *observers], ready.clock.steps)) as observed:
            result = run(
                execution,
                ready,
                gateways,
                observed.advance,
                pace=options.pace,
                interrupted=interrupted,
                tell=self.listener.progress,
                checkpoints=self.saving if options.checkpoint_every is not None else None,
            )
        verdict = judgement(ready.verdict(), watch, ready.network, result.packets, result.gateways)
        result = replace(result, notes=(*result.notes, *execution.notes), verdict=verdict, folder=self.out)
        if self.profiler is not None:
            self.profiler.phases["stepping"] = result.wall_s
            result = replace(result, profile=self.profiler.profile())
        return result


def _planned(
    structure: SystemStructure, options: RunOptions, checkpoint: Checkpoint | None, listener: Listener
) -> _Run:
    """Plans a run as far as possible without loading an FMU.

    Raises:
        SystemDescriptionError: the description is invalid, or the run cannot have its folder or its checkpoints.
    """
    ready, overrides = _prepared(structure, options)
    asked = gateways_of(ready.network, options.gcs, options.ports)
    fingerprint = _fingerprint(ready, [f"{gateway} {address}" for gateway, address in asked], checkpoint)
    out = options.out
    if isinstance(out, RunFolder):
        out = out.choose(fingerprint, repeatable=not asked)
    saving = Checkpoints(ready, out, options.checkpoint_every, overrides, options.record)
    if checkpoint is not None:
        checkpoint.check(saving.identity)
        if out is not None and out.resolve() == checkpoint.run.resolve():
            text = "this is the folder of the run that it goes on from; give another folder"
            raise SystemDescriptionError([Problem(Where(str(out)), text)])
        ready = replace(ready, changes=tuple(c for c in ready.changes if c.k >= checkpoint.k))
    ready = replace(ready, network=with_gateways(ready.network, [gateway for gateway, _ in asked]))
    return _Run(
        ready=ready,
        options=options,
        listener=listener,
        checkpoint=checkpoint,
        asked=asked,
        fingerprint=fingerprint,
        out=out,
        saving=saving,
        layout=make_layout(ready.checked, ready.network, ready.recording.signals, ready.master, watched(ready.checked)),
        profiler=Profiler() if options.profile else None,
    )


def _prepared(structure: SystemStructure, options: RunOptions) -> tuple[Prepared, dict[str, str]]:
    """Returns the prepared system, and the overrides with full names."""
    if options.solver is not None:
        structure = as_model_exchange(structure)
    overrides = full_names(structure, options.overrides)
    at = [(when, *named) for when, name, text in options.at for named in full_names(structure, {name: text}).items()]
    checked = check(structure, overrides)
    if options.solver is not None:
        checked = _with_solver(checked, options.solver)
    ready = prepare(
        checked,
        until=options.until,
        step=options.step,
        seed=options.seed,
        record=options.record,
        at=at,
        strict=options.strict,
        stimuli=None if options.inputs is None else read_stimuli(options.inputs, checked, [*overrides]),
    )
    return ready, overrides


def _with_solver(checked: CheckedSystem, text: str) -> CheckedSystem:
    """Returns the system with this solver for all its instances of Model Exchange.

    Raises:
        SystemDescriptionError: the solver does not exist, or the system has no instance for it.
    """
    try:
        choice = Choice.parsed(text)
        if all(instance.solver is None for instance in checked.instances):
            raise ValueError("no FMU of this system is for Model Exchange: all have solvers of their own")
    except ValueError as error:
        raise SystemDescriptionError([Problem(Where(f"--solver {text}"), str(error))]) from None
    instances = [one.integrated(choice) if one.solver is not None else one for one in checked.instances]
    return replace(checked, instances=tuple(instances))


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot hold the results of a run: {error.strerror}"
        raise SystemDescriptionError([Problem(Where(str(out)), text)]) from None


def _fingerprint(ready: Prepared, gateways: Sequence[str], checkpoint: Checkpoint | None) -> dict[str, str]:
    return fingerprint_of(
        ready.checked,
        ready.clock,
        ready.network,
        ready.master,
        system=digest_of_system(ready.checked),
        changes=ready.changes,
        stimuli="" if ready.stimuli is None else ready.stimuli.digest,
        recording=(ready.every, ready.recording.signals, ready.recording.packets),
        gateways=gateways,
        checkpoint=checkpoint,
    )
