"""One call from a system file to its results: read, check, run, record, and say how it ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from cosim_master.diagnostics.errors import (
    CosimError,
    FmuError,
    Problem,
    SystemDescriptionError,
    Where,
)
from cosim_master.execution.execution import Execution
from cosim_master.execution.fingerprint import fingerprint_of
from cosim_master.execution.manifest import digest_of_system, manifest
from cosim_master.execution.pacing import Checkpoints, interrupts, run
from cosim_master.execution.prepare import Prepared, prepare
from cosim_master.execution.result import Outcome, Progress, RunResult, failing
from cosim_master.execution.run.crashes import reported
from cosim_master.execution.stimuli import read_stimuli
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.network.gateways.gateways import Gateways, gateways_of
from cosim_master.results.checkpoint_folder import Checkpoint, find
from cosim_master.results.recorder import Recorder
from cosim_master.results.run_folder import RunFolder
from cosim_master.stepping.layout import layout
from cosim_master.stepping.observation import MakeObserver, Observers, View
from cosim_master.stepping.profiling import Profiler
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.overrides import apart
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.single_fmu import as_model_exchange, full_names
from cosim_master.system.settings.network import with_gateways
from cosim_master.verdict.judging import judgement
from cosim_master.verdict.memory import recall
from cosim_master.verdict.watch import Watch, watched

__all__ = ["simulate"]


def simulate(
    system: str | Path,
    *,
    variant: str | None = None,
    out: Path | RunFolder | None = None,
    until: float | None = None,
    step: float | None = None,
    pace: float | None = None,
    seed: int | None = None,
    overrides: Mapping[str, str] | None = None,
    record: Sequence[str] = (),
    at: Sequence[tuple[float, str, str]] = (),
    strict: bool = False,
    threads: int | None = None,
    profile: bool = False,
    on_start: Callable[[Prepared], None] | None = None,
    on_stage: Callable[[str], None] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    gcs: Sequence[str] = (),
    ports: str | None = None,
    on_gateway: Callable[[str], None] | None = None,
    checkpoint_every: float | None = None,
    origin: str | None = None,
    inputs: Path | None = None,
    solver: str | None = None,
    observers: Sequence[MakeObserver] = (),
) -> RunResult:
    """Run a system from its file to its results.

    Args:
        system: an .ssd, .ssp, .fmu or folder.
        variant: which of several .ssd in it.
        out: folder for the results, whatever it holds, or a `RunFolder`, which says what may be overwritten; None
            records nothing.
        until: stop time in s; the system's DefaultExperiment if None.
        step: step size in s of all FMUs, whatever the system and they themselves name.
        pace: times real time to hold at most; None runs as fast as it can.
        seed: of the radio's random numbers; the system's if None.
        overrides: start values by hierarchical name or pattern, and settings of radio and recording ("network.loss"),
            as text: see `check`.
        record: patterns of signals to record; the system's, else all outputs.
        at: (time in s, hierarchical name, text): tunable parameters and open inputs to be set while it runs.
        strict: notes that are a `Finding` are errors.
        threads: how many step native instances; None chooses.
        profile: measure where the time goes.
        on_start: called when everything is checked and nothing loaded yet.
        on_stage: is told, in words, what is done next: "loading 15 FMU instances".
        on_progress: called about twenty times a second, with gateways fifty times.
        gcs: addresses of ground stations, each on the air to all vehicles: see `gateways`.
        ports: address of the first vehicle's serial port, and by how much the others differ.
        on_gateway: is told, in words, what happens to sockets.
        checkpoint_every: s of simulated time between checkpoints in `out`.
        origin: RUN@TIME, a checkpoint to go on from; `overrides` are then changes at that time, settings of the radio
            hold from then on, and what is not given (seed, stop time, patterns) is what it was.
        inputs: a CSV file with values of open inputs, see `stimuli`.
        solver: of FMUs for Model Exchange, as `solvers.Choice.parsed` reads it; one FMU alone then is one of these.
        observers: make observers of the run, each given a `View` of it: recordings in other formats, for example.

    Raises:
        SystemDescriptionError: the description is wrong, `out` cannot be written to, or a socket not be opened.

    Returns:
        How it ended; a failing FMU is an outcome, and what was recorded until then is kept.
    """
    checkpoint = None if origin is None else find(origin)
    with read_system(system, variant) as structure:
        if checkpoint is not None:
            was = checkpoint.identity
            now, settings = apart(overrides or {}, structure)
            at = [*((checkpoint.time, name, value) for name, value in now.items()), *at]
            new = {f"{tag}.{name}": text for tag, given in settings.items() for name, text in given.items()}
            overrides, record = {**checkpoint.overrides, **new}, record or checkpoint.record
            until = (was.start + was.steps * was.base) / (1e9 * was.per_ns) if until is None else until
            seed = was.seed if seed is None and "network.seed" not in new else seed
        if solver is not None:
            structure = as_model_exchange(structure)
        overrides = full_names(structure, overrides or {})
        at = [(time, *named) for time, name, text in at for named in full_names(structure, {name: text}).items()]
        checked = check(structure, overrides)
        if solver is not None:
            checked = _with_solver(checked, solver)
        stimuli = None if inputs is None else read_stimuli(inputs, checked, [*overrides])
        ready = prepare(
            checked, until=until, step=step, seed=seed, record=record, at=at, strict=strict, stimuli=stimuli
        )
        checked = ready.checked
        asked = gateways_of(ready.network, gcs, ports)
        fingerprint = _fingerprint(ready, [f"{gateway} {address}" for gateway, address in asked], checkpoint)
        if isinstance(out, RunFolder):
            out = out.choose(fingerprint, repeatable=not asked)
        saving = Checkpoints(ready, out, checkpoint_every, overrides or {}, record)
        if checkpoint is not None:
            checkpoint.check(saving.identity)
            if out is not None and out.resolve() == checkpoint.run.resolve():
                raise SystemDescriptionError(
                    [Problem(Where(str(out)), "give another folder than that of the run it goes on from")]
                )
            ready = replace(ready, changes=tuple(c for c in ready.changes if c.k >= checkpoint.k))
        ready = replace(ready, network=with_gateways(ready.network, [gateway for gateway, _ in asked]))
        places = layout(checked, ready.network, ready.recording.signals, ready.coupling, watched(checked))
        view = View(places, ready.every, ready.clock.seconds(1))
        looking = [make(view) for make in observers]
        if on_start is not None:
            on_start(ready)

        def recorder() -> Recorder:
            assert out is not None
            return Recorder(
                out,
                checked,
                places,
                ready.network,
                keep=ready.recording.packets,
                checkpoint=checkpoint,
                in_segments=checkpoint_every is not None,
            )

        if out is not None:
            _make_folder(out)
        profiler = Profiler() if profile else None
        with Gateways(asked, on_gateway or (lambda _: None), ready.network.dialect) as gateways:
            began = time.perf_counter()
            try:
                execution = Execution(
                    checked,
                    ready.clock,
                    places,
                    ready.network,
                    recorder_for=None if out is None else recorder,
                    every=ready.every,
                    keep_packets=ready.recording.packets,
                    threads=threads,
                    changes=ready.changes,
                    stimuli=ready.stimuli,
                    profiler=profiler,
                    checkpoint=checkpoint,
                    coupling=ready.coupling,
                    grid=ready.recording.interval is not None and ready.every == 1,
                    on_stage=on_stage,
                )
            except SystemDescriptionError:
                raise
            except CosimError as error:
                return RunResult(Outcome.FAILED, error, 0.0, 0.0, 0.0, {}, ready.notes)
            start_up = time.perf_counter() - began

            complete = threading.Event()

            def rescue(error: FmuError) -> None:
                if complete.is_set():
                    return
                simulated, counts = execution.time - ready.clock.time(0), execution.packet_counts()
                crashed = RunResult(Outcome.FAILED, error, simulated, 0.0, 0.0, counts, ready.notes)
                execution.finish(lambda: manifest(ready, crashed, start_up, execution.parameters, fingerprint))

            with execution, reported(execution.living, lambda: execution.time, rescue), interrupts() as interrupted:
                if checkpoint_every is not None:
                    execution.refuse_checkpoints()
                gateways.start()
                watch = Watch(checked, ready.network, places, ready.clock, ready.limits)
                saving.watch = watch
                if checkpoint is not None:
                    recall(watch, checkpoint.verdict)
                with closing(Observers(execution, [watch, *looking], ready.clock.steps)) as observed:
                    result = run(
                        execution,
                        ready,
                        pace,
                        on_progress,
                        interrupted,
                        gateways,
                        saving if checkpoint_every is not None else None,
                        observed,
                    )
                verdict = judgement(ready.verdict(), watch, ready.network, result.packets, result.gateways)
                result = replace(result, notes=(*result.notes, *execution.notes), verdict=verdict)
                if profiler is not None:
                    profiler.phases["stepping"] = result.wall_s
                    result = replace(result, profile=profiler.profile())
                if on_stage is not None and out is not None:
                    on_stage(f"writing {out}")
                result = replace(result, folder=out)
                about = (start_up, execution.parameters, fingerprint)
                execution.finish(lambda: manifest(ready, result, *about))
                complete.set()
                # An FMU that takes the process with it when it ends leaves a complete recording, and its manifest.
                failures = execution.end(lambda errors: manifest(ready, failing(result, errors), *about))
            return failing(result, failures)


def _with_solver(checked: CheckedSystem, text: str) -> CheckedSystem:
    """The system with this solver for all its instances of Model Exchange.

    Raises:
        SystemDescriptionError: there is no such solver, or no such instance.
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
        ready.coupling,
        system=digest_of_system(ready.checked),
        changes=ready.changes,
        stimuli="" if ready.stimuli is None else ready.stimuli.digest,
        recording=(ready.every, ready.recording.signals, ready.recording.packets),
        gateways=gateways,
        checkpoint=checkpoint,
    )
