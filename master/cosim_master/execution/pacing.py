"""A run from its first step to its last: paced, interrupted by Ctrl-C, with gateways, checkpoints and progress."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import FrameType

from cosim_master.diagnostics.errors import (
    CosimError,
    Problem,
    RunTerminated,
    SystemDescriptionError,
    Where,
)
from cosim_master.execution.execution import Execution
from cosim_master.execution.manifest import digest_of_system
from cosim_master.execution.prepare import Prepared
from cosim_master.execution.result import Outcome, Progress, RunResult
from cosim_master.network.gateways.gateways import Gateways
from cosim_master.results.checkpoint_folder import Identity
from cosim_master.stepping.observation import Observers
from cosim_master.verdict.memory import remember
from cosim_master.verdict.watch import Watch

__all__ = ["Checkpoints", "interrupts", "run"]

_SLICE = 0.05
"""Wall-clock seconds between looks at progress and pacing."""
_SHORT_SLICE = 0.02
"""The same where something has to be exchanged with real programs."""


class Checkpoints:
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


@contextmanager
def interrupts() -> Iterator[Callable[[], bool]]:
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


def run(
    execution: Execution,
    ready: Prepared,
    pace: float | None,
    on_progress: Callable[[Progress], None] | None,
    interrupted: Callable[[], bool],
    gateways: Gateways,
    checkpoints: Checkpoints | None = None,
    observers: Observers | None = None,
) -> RunResult:
    """Steps a run to its end, whatever it is; never raises a `CosimError`.

    Args:
        pace: times real time to hold at most; None runs as fast as it can.
        interrupted: whether the user wants the run to end.
    """
    clock = ready.clock
    start = execution.time
    stop = clock.time(clock.steps)
    outcome = Outcome.DONE
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
                outcome = Outcome.INTERRUPTED
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
        outcome = Outcome.INTERRUPTED
    except RunTerminated as error:
        outcome, failure = Outcome.TERMINATED, error
    except CosimError as error:
        outcome, failure = Outcome.FAILED, error
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
