"""One call from a system file to its results: read, check, run, record, and say how it ended."""

from __future__ import annotations

import hashlib
import math
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from fractions import Fraction
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Any

from cosim_master.diagnostics.errors import CosimError, Finding, FmuError, Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import RECORDING_INTERVAL
from cosim_master.execution.execution import Execution, RunFailed, RunTerminated
from cosim_master.execution.fingerprint import fingerprint_of
from cosim_master.execution.run.crashes import reported
from cosim_master.execution.stimuli import Stimuli, read_stimuli
from cosim_master.fmi.description.read import Start
from cosim_master.fmi.slaves.solvers import Choice
from cosim_master.network.gateways.gateways import Gateways, gateways_of
from cosim_master.results.checkpoint_folder import Checkpoint, Identity, find
from cosim_master.results.recorder import Recorder
from cosim_master.results.run_folder import RunFolder
from cosim_master.stepping.layout import layout
from cosim_master.stepping.profiling import Profile, Profiler
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.overrides import apart
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.single_fmu import as_model_exchange, full_names, output_interval
from cosim_master.system.settings.annotation import root_annotation
from cosim_master.system.settings.changes import Change, changes
from cosim_master.system.settings.master import Coupling, connected, coupling_of
from cosim_master.system.settings.network import Channel, Network, network_of, with_gateways
from cosim_master.system.settings.time_grid import Timing, exact, timing
from cosim_master.system.structure import Component, System
from cosim_master.verdict.findings import Judgement
from cosim_master.verdict.judging import judgement
from cosim_master.verdict.limits import Limits, limits_of
from cosim_master.verdict.memory import recall, remember
from cosim_master.verdict.observation import Observers
from cosim_master.verdict.prior import known_before
from cosim_master.verdict.watch import Watch, watched

__all__ = ["RECORDING", "Progress", "Prepared", "Recording", "RunResult", "prepare", "simulate"]

RECORDING = "org.uav-cosim.recording"
_SLICE = 0.05
"""Wall-clock seconds between looks at progress and pacing."""
_SHORT_SLICE = 0.02
"""The same where something has to be exchanged with real programs."""


@dataclass(frozen=True, slots=True)
class Recording:
    """What is recorded: rows every `interval` s (None: every base step), signals that match, packets or not.

    <recording xmlns="https://uav-cosim.org/ns/1" interval="0.0125" signals="*.position* *.target" packets="true"/>
    """

    interval: float | None = None
    signals: tuple[str, ...] = ()
    packets: bool = True


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is: simulated time and wall-clock time since the first step, s; packets sent by radio."""

    time: float
    start: float
    stop: float
    wall: float
    packets: int


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended.

    Attributes:
        outcome: "done", "interrupted" (Ctrl-C), "terminated" (an FMU wants the simulation to end) or "failed"; that
            too if all was simulated and an FMU could then not be terminated.
        error: what failed, or who ended the run; None otherwise.
        simulated_s, wall_s, real_time_factor: of the stepping alone.
        packets: see `Execution.packet_counts`.
        notes: what was assumed.
        overruns: paced runs: how often and by how much (s, at worst) the pace could not be held.
        gateways: see `Gateways.counts`.
        profile: where the time went, if that was asked for.
        folder: of the results; None if nothing was recorded.
        verdict: how the swarm did; None if the run did not begin.
    """

    outcome: str
    error: CosimError | None
    simulated_s: float
    wall_s: float
    real_time_factor: float
    packets: Mapping[str, int]
    notes: tuple[str, ...]
    overruns: tuple[int, float] = (0, 0.0)
    gateways: Mapping[str, Mapping[str, int | str]] = field(default_factory=dict)
    profile: Profile | None = None
    folder: Path | None = None
    verdict: Judgement | None = None


@dataclass(frozen=True, slots=True)
class Prepared:
    """A checked system with its clock, network and recording: ready to be run, nothing loaded."""

    checked: CheckedSystem
    clock: Timing
    network: Network
    recording: Recording
    every: int
    changes: tuple[Change, ...] = ()
    coupling: Coupling = field(default_factory=Coupling)
    stimuli: Stimuli | None = None
    limits: Limits = field(default_factory=Limits)

    def verdict(self) -> Judgement:
        """What can be known before the run about how the swarm will do."""
        set_later = [(self.checked.instances[c.instance].name, c.variable, c.value) for c in self.changes]
        clock = self.clock
        span = (clock.time(0), clock.time(clock.steps))
        return Judgement.of(known_before(self.checked, self.network, set_later, span), *span)

    @property
    def notes(self) -> tuple[str, ...]:
        stimuli = () if self.stimuli is None else self.stimuli.notes
        return (*self.checked.notes, *self.clock.notes, *self.network.notes, *self.coupling.notes, *stimuli)


def prepare(
    checked: CheckedSystem,
    *,
    until: float | None = None,
    step: float | None = None,
    seed: int | None = None,
    record: Sequence[str] = (),
    at: Sequence[tuple[float, str, str]] = (),
    strict: bool = False,
    stimuli: Stimuli | None = None,
) -> Prepared:
    """Settle everything that can be settled without loading an FMU.

    Args:
        strict: notes that are a `Finding` are errors.

    Raises:
        SystemDescriptionError: clock, network or recording are not as they should be; all problems at once.
    """
    problems: list[Problem] = []

    def gathered(make: Callable[[], Any]) -> Any:
        try:
            return make()
        except SystemDescriptionError as error:
            problems.extend(error.problems)
            return None

    if step is None and (step := _default_step(checked, until)) is not None:
        text = f"the FMU names no step size: {step:g} s are taken"
        checked = replace(checked, notes=(*checked.notes, text))
    recording = gathered(lambda: _recording(checked, record))
    clock = gathered(lambda: timing(checked, until, step))
    network = gathered(lambda: network_of(checked, seed))
    coupling = gathered(lambda: coupling_of(checked))
    limits = gathered(lambda: limits_of(checked))
    if clock is not None and coupling is not None:
        gathered(lambda: coupling.check(checked, clock.base, clock.periods, clock.per_ns))
    if problems:
        raise SystemDescriptionError(problems)
    every = 1
    if recording.interval is not None:
        interval = exact(recording.interval) or Fraction(0)
        every = round(interval * clock.per_ns / clock.base)
        if every < 1 or not math.isclose(every * clock.base, interval * clock.per_ns, rel_tol=1e-9):
            base = clock.seconds(1)
            near = clock.seconds(max(1, every))
            text = RECORDING_INTERVAL.text(f"{recording.interval:g}", f"{base:.9g}", f"{near:.9g}")
            raise SystemDescriptionError([Problem(checked.structure.where, text)])
    checked = connected(checked, coupling)
    if stimuli is not None:
        checked = stimuli.initialize(checked, clock.time(0))
        stimuli.sample(clock)
    ready = Prepared(checked, clock, network, recording, every, changes(checked, clock, at), coupling, stimuli, limits)
    if strict and (findings := [note.problem for note in ready.notes if isinstance(note, Finding)]):
        raise SystemDescriptionError(findings)
    return ready


def _default_step(checked: CheckedSystem, until: float | None) -> float | None:
    """The step of an FMU alone that names none, if it is known how long it runs."""
    stop = until if until is not None else checked.stop_time
    is_alone = checked.structure.path.suffix.lower() == ".fmu"
    if not is_alone or stop is None or stop <= checked.start_time or checked.instances[0].step_size is not None:
        return None
    return output_interval(stop - checked.start_time)


def _recording(checked: CheckedSystem, record: Sequence[str]) -> Recording:
    problems: list[Problem] = []
    reader = root_annotation(checked, RECORDING, "recording", problems)
    interval = reader.number("interval", 0.0, 0.0, 1e6)
    written = tuple(reader.text("signals", "").split())
    recording = Recording(
        interval=interval or None,
        signals=tuple(record) or written,
        packets=reader.choice("packets", "true", ("true", "false")) == "true",
    )
    reader.finish()
    reader.children()
    if problems:
        raise SystemDescriptionError(problems)
    return recording


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
        saving = _Checkpoints(ready, out, checkpoint_every, overrides or {}, record)
        if checkpoint is not None:
            checkpoint.check(saving.identity)
            if out is not None and out.resolve() == checkpoint.run.resolve():
                raise SystemDescriptionError(
                    [Problem(Where(str(out)), "give another folder than that of the run it goes on from")]
                )
            ready = replace(ready, changes=tuple(c for c in ready.changes if c.k >= checkpoint.k))
        ready = replace(ready, network=with_gateways(ready.network, [gateway for gateway, _ in asked]))
        places = layout(checked, ready.network, ready.recording.signals, ready.coupling, watched(checked))
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
                return RunResult("failed", error, 0.0, 0.0, 0.0, {}, ready.notes)
            start_up = time.perf_counter() - began

            complete = threading.Event()

            def rescue(error: FmuError) -> None:
                if complete.is_set():
                    return
                simulated, counts = execution.time - ready.clock.time(0), execution.packet_counts()
                crashed = RunResult("failed", error, simulated, 0.0, 0.0, counts, ready.notes)
                execution.finish(lambda: _manifest(ready, crashed, start_up, execution.parameters, fingerprint))

            with execution, reported(execution.living, lambda: execution.time, rescue), _interrupts() as interrupted:
                if checkpoint_every is not None:
                    execution.refuse_checkpoints()
                gateways.start()
                watch = Watch(checked, ready.network, places, ready.clock, ready.limits)
                saving.watch = watch
                if checkpoint is not None:
                    recall(watch, checkpoint.verdict)
                observers = Observers(execution, [watch], ready.clock.steps)
                result = _run(
                    execution,
                    ready,
                    pace,
                    on_progress,
                    interrupted,
                    gateways,
                    saving if checkpoint_every is not None else None,
                    observers,
                )
                observers.close()
                verdict = judgement(ready.verdict(), watch, ready.network, result.packets, result.gateways)
                result = replace(result, notes=(*result.notes, *execution.notes), verdict=verdict)
                if profiler is not None:
                    profiler.phases["stepping"] = result.wall_s
                    result = replace(result, profile=profiler.profile())
                if on_stage is not None and out is not None:
                    on_stage(f"writing {out}")
                result = replace(result, folder=out)
                about = (start_up, execution.parameters, fingerprint)
                execution.finish(lambda: _manifest(ready, result, *about))
                complete.set()
                # An FMU that takes the process with it when it ends leaves a complete recording, and its manifest.
                failures = execution.end(lambda errors: _manifest(ready, _failing(result, errors), *about))
            return _failing(result, failures)


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


def _failing(result: RunResult, failures: Sequence[FmuError]) -> RunResult:
    """The result of a run whose recording is complete, with FMUs that could not be terminated: it has failed."""
    if not failures:
        return result
    before = result.error.failures if isinstance(result.error, RunFailed) else ()
    return replace(result, outcome="failed", error=RunFailed([*before, *failures]))


class _Checkpoints:
    """Checkpoints at equal intervals of simulated time; none if `every` is None.

    Raises:
        SystemDescriptionError: the interval is not a multiple of the base step, or there is no folder for them.
    """

    def __init__(
        self,
        ready: Prepared,
        out: Path | None,
        every: float | None,
        overrides: Mapping[str, str],
        record: Sequence[str],
    ) -> None:
        clock, checked = ready.clock, ready.checked
        self.identity = Identity(
            system=_digest_of_system(checked),
            fmus={instance.name: instance.fmu.digest for instance in checked.instances},
            start=clock.start,
            base=clock.base,
            per_ns=clock.per_ns,
            steps=clock.steps,
            every=ready.every,
            seed=ready.network.seed,
            input=ready.stimuli.digest if ready.stimuli is not None else "",
        )
        self._about = {"identity": asdict(self.identity), "overrides": dict(overrides), "record": list(record)}
        self._every = self._next = 0
        self._last = clock.steps
        self.watch: Watch | None = None
        """Who watches the run, once it begins."""
        if every is None:
            return
        if out is None:
            raise SystemDescriptionError([Problem(Where("checkpoints"), "there is no folder for them")])
        self._folder = out / "checkpoints"
        steps = every * 1e9 * clock.per_ns / clock.base
        if not 1 <= steps < 2**62 or not math.isclose(steps, round(steps), rel_tol=1e-9):
            text = f"every {every:g} s is not a multiple of the base step {clock.seconds(1):.9g} s"
            raise SystemDescriptionError([Problem(Where("checkpoints"), text)])
        self._every = round(steps)

    def before(self, k: int, chunk: int) -> int:
        """The base step to go to from `k`: at most `chunk` further, and not beyond the next checkpoint."""
        self._next = (k // self._every + 1) * self._every
        return min(k + chunk, self._next)

    def save(self, execution: Execution) -> None:
        """Write a checkpoint if its time has come; the end of a run has none."""
        if self._next <= execution.k < self._last:
            seen = {} if self.watch is None else remember(self.watch)
            execution.save_checkpoint(self._folder, {**self._about, "verdict": seen})


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot hold the results of a run: {error.strerror}"
        raise SystemDescriptionError([Problem(Where(str(out)), text)]) from None


@contextmanager
def _interrupts() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C has been pressed; pressed again, it interrupts whatever is going on.

    A KeyboardInterrupt anywhere in a step would strike the Python code of an FMU, which is then lost, or leave a
    file half written.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    pressed = threading.Event()
    before = signal.getsignal(signal.SIGINT)

    def press(number: int, frame: FrameType | None) -> None:
        if pressed.is_set():
            signal.default_int_handler(number, frame)
        pressed.set()

    signal.signal(signal.SIGINT, press)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def _run(
    execution: Execution,
    ready: Prepared,
    pace: float | None,
    on_progress: Callable[[Progress], None] | None,
    interrupted: Callable[[], bool],
    gateways: Gateways,
    checkpoints: _Checkpoints | None = None,
    observers: Observers | None = None,
) -> RunResult:
    clock = ready.clock
    start = execution.time
    stop = clock.time(clock.steps)
    outcome = "done"
    failure: CosimError | None = None
    began = time.perf_counter()
    chunk, overruns, worst = 1, 0, 0.0
    advance = execution.advance if observers is None else observers.advance
    slice_ = _SHORT_SLICE if gateways else _SLICE
    try:
        while execution.k < clock.steps:
            before = time.perf_counter()
            if pace is not None:
                due = (execution.time - start) / pace - (before - began)
                if due < -0.05:
                    overruns, worst = overruns + 1, max(worst, -due)
                while due > 1e-6 and not interrupted():
                    time.sleep(min(due, _SLICE))
                    due = (execution.time - start) / pace - (time.perf_counter() - began)
            if interrupted():
                outcome = "interrupted"
                break
            if gateways:
                gateways.exchange(execution)
            advance(execution.k + chunk if checkpoints is None else checkpoints.before(execution.k, chunk))
            if checkpoints is not None:
                checkpoints.save(execution)
            if on_progress is not None:
                wall, packets = time.perf_counter() - began, execution.packet_counts()["sent"]
                on_progress(Progress(execution.time, start, stop, wall, packets))
            spent = max(time.perf_counter() - before, 1e-6)
            if pace is not None:
                chunk = max(1, min(int(_SLICE * 0.4 * pace / clock.seconds(1)), clock.steps))
            else:
                chunk = max(1, min(4 * chunk, int(chunk * slice_ / spent) or 1))
        if gateways:
            gateways.exchange(execution)
    except KeyboardInterrupt:
        outcome = "interrupted"
    except RunTerminated as error:
        outcome, failure = "terminated", error
    except CosimError as error:
        outcome, failure = "failed", error
    wall = time.perf_counter() - began
    simulated = execution.time - start
    factor = simulated / wall if wall > 0 else 0.0
    return RunResult(
        outcome,
        failure,
        simulated,
        wall,
        factor,
        execution.packet_counts(),
        ready.notes,
        (overruns, worst),
        gateways.counts(),
    )


def _fingerprint(ready: Prepared, gateways: Sequence[str], checkpoint: Checkpoint | None) -> dict[str, str]:
    return fingerprint_of(
        ready.checked,
        ready.clock,
        ready.network,
        ready.coupling,
        system=_digest_of_system(ready.checked),
        changes=ready.changes,
        stimuli="" if ready.stimuli is None else ready.stimuli.digest,
        recording=(ready.every, ready.recording.signals, ready.recording.packets),
        gateways=gateways,
        checkpoint=checkpoint,
    )


def _manifest(
    ready: Prepared,
    result: RunResult,
    start_up: float,
    parameters: Mapping[str, Mapping[str, Start]],
    fingerprint: Mapping[str, str],
) -> dict[str, Any]:
    checked = ready.checked
    network = {
        f.name: getattr(ready.network, f.name)
        for f in fields(ready.network)
        if f.name not in ("nodes", "gateways", "dialect", "notes")
    }
    if math.isinf(ready.network.range):
        network["range"] = "INF"
    network["channels"] = [_channel_in_json(channel) for channel in ready.network.channels]
    network["dialect"] = [message.name for message in ready.network.dialect]
    network["links"] = sorted(map(list, ready.network.links))
    network["outages"] = [[n, a, b if math.isfinite(b) else "INF"] for n, a, b in ready.network.outages]
    fmus = {str(i.fmu.path): i.fmu for i in checked.instances}
    return {
        "outcome": result.outcome,
        "error": None if result.error is None else str(result.error),
        "verdict": None if result.verdict is None else result.verdict.as_json(),
        "simulated_s": result.simulated_s,
        "wall_s": result.wall_s,
        "start_up_s": start_up,
        "real_time_factor": result.real_time_factor,
        "system": {
            "name": checked.structure.name,
            "path": str(checked.structure.path),
            "sha256": _digest_of_system(checked),
        },
        **(
            {}
            if ready.stimuli is None
            else {"input": {"path": str(ready.stimuli.path), "sha256": ready.stimuli.digest}}
        ),
        "fingerprint": dict(fingerprint),
        "start_time": ready.clock.time(0),
        "base_step": ready.clock.seconds(1),
        "changes": [
            {
                "time": ready.clock.time(change.k),
                "variable": f"{checked.instances[change.instance].name}.{change.variable.name}",
                "value": _in_json(change.value),
            }
            for change in ready.changes
        ],
        "master": {
            "algorithm": ready.coupling.algorithm,
            "extrapolated": sorted(".".join(target) for target in ready.coupling.extrapolated),
            "tolerance": ready.coupling.tolerance,
            "iterations": ready.coupling.iterations,
            "relaxation": ready.coupling.relaxation,
            "minimum_step": ready.coupling.minimum_step / 1e9,
            "maximum_step": ready.coupling.maximum_step / 1e9,
            "delays": {".".join(target): delay.ns / 1e9 for target, delay in ready.coupling.delays.items()},
        },
        "seed": ready.network.seed,
        "settings": {tag: dict(given) for tag, given in checked.settings.items()},
        "network": network,
        "recording": asdict(ready.recording),
        "packets": dict(result.packets),
        "gateways": {name: dict(counts) for name, counts in result.gateways.items()},
        "instances": {
            instance.name: {
                "fmu": str(instance.fmu.path),
                "step": ready.clock.seconds(period),
                "step_by": source,
                **({} if instance.solver is None else {"solver": asdict(instance.solver)}),
                "parameters": {name: _in_json(value) for name, value in parameters[instance.name].items()},
            }
            for instance, period, source in zip(
                checked.instances, ready.clock.periods, ready.clock.sources, strict=True
            )
        },
        "fmus": {
            path: {"sha256": fmu.digest, "guid": fmu.guid, "model": fmu.model_name}
            for path, fmu in sorted(fmus.items())
        },
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("uav-cosim", "numba", "numpy", "pyarrow", "fmpy")},
        },
        "notes": list(result.notes),
        **({} if result.profile is None else {"profile": asdict(result.profile)}),
    }


def _channel_in_json(channel: Channel) -> dict[str, Any]:
    numbers = {name: getattr(channel, name) for name in ("latency", "jitter", "loss")}
    given = {name: value for name, value in numbers.items() if value is not None}
    return {"from": channel.source, "to": channel.target, **given}


def _in_json(value: Start) -> Start:
    """JSON has no infinity: it is written as XML Schema does."""
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"


def _digest_of_system(checked: CheckedSystem) -> str:
    """Of the root document and every document below it, in the order of their paths."""
    documents: set[Path] = {checked.structure.document}

    def visit(system: System) -> None:
        documents.add(system.document)
        for element in system.elements:
            if isinstance(element, Component):
                if element.content is not None:
                    visit(element.content)
            elif isinstance(element, System):
                visit(element)

    visit(checked.structure.system)
    digest = hashlib.sha256()
    for document in sorted(documents):
        digest.update(document.read_bytes())
    return digest.hexdigest()
