"""Steps a run from beginning to end: with pace, pauses, interruption by Ctrl-C, gateways, checkpoints and progress."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from types import FrameType

from cosim_master.diagnostics.errors import (
    CosimError,
    FmuError,
    Problem,
    RecordingFailed,
    RunFailed,
    RunTerminated,
    SystemDescriptionError,
    Where,
)
from cosim_master.execution.execution import Execution
from cosim_master.execution.federation import Federation
from cosim_master.execution.outcome.manifest import digest_of_system
from cosim_master.execution.outcome.result import Outcome, Overruns, RunResult
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.run.checkpoint import save
from cosim_master.execution.run.faults.requests import TOGETHER, handled
from cosim_master.network.gateways.gateways import Gateways
from cosim_master.results.recording.recording import Recording
from cosim_master.results.storage.checkpoint_folder import Identity
from cosim_master.stepping.control import Control
from cosim_master.stepping.observation import Observers, Progress
from cosim_master.system.settings.changes import told
from cosim_master.system.settings.time_grid import TimeGrid
from cosim_master.verdict.monitors.monitoring import Monitoring
from cosim_master.verdict.watching.memory import remember
from cosim_master.verdict.watching.watch import Watch

__all__ = ["Checkpoints", "interrupts", "run"]

_SLICE = 0.05
"""Wall-clock seconds between updates of progress and pace."""
_SHORT_SLICE = 0.02
"""The same, if packets are exchanged with real programs."""
_KEEP = 0.5
"""Wall-clock seconds after which new rows and packets are made readable."""
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a run."""


class Checkpoints:
    """Checkpoints at equal intervals of simulated time; none if `every` is None.

    Raises:
        SystemDescriptionError: the interval is not a multiple of the base step, or the run has no folder for results
            (-o).
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
            system=digest_of_system(checked),
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
        self.changes: Sequence[tuple[int, str, str]] = [told(checked, change) for change in ready.changes]
        """Those of the run and of the ones that it goes on from, see `Checkpoint.changes`."""
        self._every = self._next = 0
        self._last = clock.steps
        self.watch: Watch | None = None
        """The watch of the run, once it begins."""
        self.monitoring: Monitoring | None = None
        """The observer of the system's monitors, if it has any, once the run begins."""
        self.recording: Recording | None = None
        """The recording of the run, once it begins."""
        if every is None:
            return
        if out is None:
            raise SystemDescriptionError([Problem(Where("checkpoints"), "they need a folder for results (-o)")])
        self._folder = out / "checkpoints"
        steps = every * 1e9 * clock.per_ns / clock.base
        if not 1 <= steps < 2**62 or not math.isclose(steps, round(steps), rel_tol=1e-9):
            text = f"every {every:g} s is not a multiple of the base step {clock.seconds(1):.9g} s"
            if steps < 2**62:
                text += f"; try {clock.seconds(max(1, round(steps))):.9g}"
            raise SystemDescriptionError([Problem(Where("checkpoints"), text)])
        self._every = round(steps)

    @property
    def every(self) -> int:
        """The interval in base steps; 0: there are no checkpoints."""
        return self._every

    def none_from(self, k: int) -> bool:
        """Returns whether a run that begins at base step `k` and was to have checkpoints ends before the first."""
        return bool(self._every) and (k // self._every + 1) * self._every >= self._last

    def before(self, k: int, chunk: int) -> int:
        """Returns the next base step to stop at: at most `chunk` after `k`, and not after the next checkpoint."""
        self._next = (k // self._every + 1) * self._every
        return min(k + chunk, self._next)

    def save(self, execution: Execution) -> None:
        """Writes a checkpoint if it is due. The end of a run has none."""
        if self._next <= execution.k < self._last:
            assert self.watch is not None and self.recording is not None
            recording = self.recording
            try:
                saved = execution.settle()  # first: observers get the packets that have been sent until now
            except FmuError as error:
                raise RunFailed([error]) from None
            seen = remember(self.watch)
            if self.monitoring is not None:
                seen["monitors"] = self.monitoring.memory()
            save(
                self._folder,
                saved,
                execution.k,
                position=recording.position(),
                segments=recording.segments(),
                about={
                    **self._about,
                    "verdict": seen,
                    "changes": [change for change in self.changes if change[0] < execution.k],
                },
            )


@contextmanager
def interrupts() -> Iterator[Callable[[], bool]]:
    """Yields a function that returns whether Ctrl-C, SIGTERM or SIGHUP was received; a second one interrupts at once.

    A KeyboardInterrupt within a step could break the Python code of an FMU, or leave a file half written. While an FMU
    hangs, no Python code runs: the second signal then ends the process. Two of one kind at almost the same time, as
    timeout(1) sends them, are one. A signal that is already ignored, as SIGHUP under nohup, remains ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    pressed = threading.Event()
    seen: dict[int, float] = {}

    def press(number: int, frame: FrameType | None) -> None:
        handled(number, press)
        before, seen[number] = seen.get(number, -math.inf), time.monotonic()
        if pressed.is_set() and seen[number] - before > TOGETHER:
            signal.default_int_handler(number, frame)
        pressed.set()

    numbers = [signal.Signals[name] for name in _ENDING if name in signal.Signals.__members__]
    found = {number: signal.getsignal(number) for number in numbers}
    before = {n: was for n, was in found.items() if n == signal.SIGINT or was not in (signal.SIG_IGN, None)}
    for number in before:
        handled(number, press)
    try:
        yield pressed.is_set
    finally:
        for number, was in before.items():
            signal.signal(number, was)


class _Pace:
    """Limits a run to a multiple of real time, stops it while it is paused, and chooses the steps made at once.

    Args:
        control: requests of the user; its first factor is the pace whose overruns are counted.
        clock: the time grid of the run.
        slice: intended wall-clock time of the base steps made at once, s.
    """

    def __init__(self, control: Control, clock: TimeGrid, slice: float) -> None:
        self._control, self._asked = control, control.factor
        self._base, self._steps, self._slice = clock.seconds(1), clock.steps, slice
        self._periods = {period for period in clock.periods if period > 0}
        self._began = time.perf_counter()
        self._factor = control.factor
        self._since = (0.0, 0.0)
        """Wall-clock time and simulated time from which the factor holds, s."""
        self._chunk, self._single = 1, False
        self.overruns = Overruns()

    @property
    def wall(self) -> float:
        """Wall-clock seconds since the run began."""
        return time.perf_counter() - self._began

    def after(self, k: int) -> int:
        """Returns the base step up to which the run may go on from base step `k`."""
        if self._single:
            return min(((k // period + 1) * period for period in self._periods), default=k + 1)
        return k + self._chunk

    def wait(self, simulated: float, interrupted: Callable[[], bool], meanwhile: Callable[[], object]) -> None:
        """Waits until `simulated` seconds are due, and while the run is paused; then calls `meanwhile` now and then."""
        self._single, first = False, True
        while not interrupted():
            if self._control.paused:
                if self._control.take_step():
                    self._single = True
                    return
                self._restart(simulated)
                meanwhile()
                self._control.wait(_SLICE)
                continue
            if self._control.factor != self._factor:
                self._factor = self._control.factor
                self._restart(simulated)
            if self._factor is None:
                return
            due = (simulated - self._since[1]) / self._factor - (self.wall - self._since[0])
            if first and due < -0.05 and self._factor == self._asked:
                self.overruns = Overruns(self.overruns.count + 1, max(self.overruns.worst_s, -due))
            first = False
            if due <= 1e-6:
                return
            meanwhile()
            self._control.wait(min(due, _SLICE))

    def _restart(self, simulated: float) -> None:
        self._since, self._chunk = (self.wall, simulated), 1

    def spent(self, seconds: float) -> None:
        """Chooses the size of the next chunk, given the wall-clock time of the last one, `seconds`."""
        slice, most = self._slice, self._steps
        if self._factor is not None:  # a chunk is shorter if the pace cannot be held
            slice, most = _SLICE, int(_SLICE * 0.4 * self._factor / self._base)
        self._chunk = max(1, min(4 * self._chunk, int(self._chunk * slice / max(seconds, 1e-6)), most))


class _Telling:
    """Reports the progress of a run to its observers."""

    def __init__(self, execution: Execution, observed: Observers, held: _Pace, stop: float) -> None:
        self._execution, self._observed, self._held = execution, observed, held
        self._start, self._stop, self._kept = execution.time, stop, 0.0

    def report(self, *, keep: bool) -> None:
        one, wall = self._execution, self._held.wall
        self._observed.progressed(Progress(one.time, self._start, self._stop, wall, one.packet_counts(), kept=keep))

    def keep(self) -> bool:
        """Reports the progress for which new rows and packets are made readable, if it is due; returns whether."""
        due = self._held.wall - self._kept >= _KEEP
        if due:
            self.report(keep=True)
            self._kept = self._held.wall
        return due


def run(
    execution: Execution,
    ready: Prepared,
    gateways: Gateways,
    observed: Observers,
    *,
    control: Control | None = None,
    interrupted: Callable[[], bool] = lambda: False,
    checkpoints: Checkpoints | None = None,
    federation: Federation | None = None,
) -> RunResult:
    """Steps a run to its end, successful or not; never raises a `CosimError`.

    Args:
        observed: the observers of the execution, which step it.
        control: pace, pauses, single steps and values that the user requests; None runs as fast as possible.
        interrupted: returns whether the user has requested the end of the run.
        federation: meets other simulators.
    """
    clock = ready.clock
    start, stop = execution.time, clock.time(clock.steps)
    outcome = Outcome.DONE
    failure: CosimError | None = None
    control = control or Control()
    held = _Pace(control, clock, _SHORT_SLICE if gateways.to_programs else _SLICE)
    telling = _Telling(execution, observed, held, stop)
    try:
        while execution.k < clock.steps:
            before = held.wall
            held.wait(execution.time - start, interrupted, telling.keep)
            if federation is not None:
                federation.meet(execution, gateways, control, interrupted)
            if interrupted():
                outcome = Outcome.INTERRUPTED
                execution.conclude()
                break
            for change in control.take_changes():
                control.made.append((execution.request(change), change))
            if gateways:
                gateways.exchange(execution)
            stop_at = gateways.before(held.after(execution.k))
            if federation is not None:
                stop_at = federation.before(execution.k, stop_at)
            if checkpoints is None:
                observed.advance(stop_at)
            else:
                observed.advance(checkpoints.before(execution.k, stop_at - execution.k))
                if not observed.over:
                    checkpoints.save(execution)
            if observed.over:
                execution.blocks.record_end()
                outcome = Outcome.VIOLATED
                break
            if not telling.keep():
                telling.report(keep=False)
            held.spent(held.wall - before)
        if federation is not None and execution.k == clock.steps:
            federation.meet(execution, gateways, control, interrupted)
        if gateways:
            gateways.exchange(execution)
    except KeyboardInterrupt:
        outcome = Outcome.INTERRUPTED
    except RunTerminated as error:
        outcome, failure = Outcome.TERMINATED, error
    except CosimError as error:
        outcome, failure = Outcome.FAILED, error
    except Exception:
        with suppress(RecordingFailed):
            telling.report(keep=True)
        raise
    return _result(execution, ready, gateways, held, start, outcome, failure)


def _result(
    execution: Execution,
    ready: Prepared,
    gateways: Gateways,
    held: _Pace,
    start: float,
    outcome: Outcome,
    failure: CosimError | None,
) -> RunResult:
    wall, simulated = held.wall, execution.time - start
    return RunResult(
        outcome,
        failure,
        simulated_s=simulated,
        wall_s=wall,
        real_time_factor=simulated / wall if wall > 0 else 0.0,
        packets=execution.packet_counts(),
        notes=ready.notes,
        overruns=held.overruns,
        gateways=gateways.counts(),
    )
