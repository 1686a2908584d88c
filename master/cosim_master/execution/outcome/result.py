"""The outcome of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from enum import StrEnum
from pathlib import Path

from cosim_master.diagnostics.errors import (
    CosimError,
    FmuError,
    RecordingFailed,
    RunFailed,
)
from cosim_master.stepping.profiling import Profile
from cosim_master.verdict.findings import Judgement

__all__ = ["Outcome", "Overruns", "RunResult", "failing", "unrecorded"]


class Outcome(StrEnum):
    """The outcome of a run."""

    RUNNING = "running"
    """The run has not ended, according to its manifest. If no process records it any more, the process was killed."""
    DONE = "done"
    INTERRUPTED = "interrupted"
    """The run was ended by Ctrl-C, SIGTERM or SIGHUP."""
    TERMINATED = "terminated"
    """An FMU requested the end of the simulation."""
    VIOLATED = "violated"
    """A monitor of the system ended the run at a violation (docs/monitors.md)."""
    FAILED = "failed"
    """An FMU failed, perhaps only during its termination after a complete simulation; or the recording failed."""
    KILLED = "killed"
    """The process was killed, according to a manifest that `uav-cosim repair` has completed."""


@dataclass(frozen=True, slots=True)
class Overruns:
    """The number of times that a paced run was late, and its largest delay, s."""

    count: int = 0
    worst_s: float = 0.0


@dataclass(frozen=True, slots=True)
class RunResult:
    """The outcome of a run and its figures.

    Attributes:
        outcome: equal to its word ("done").
        error: the failure, or the request that ended the run; None otherwise.
        simulated_s, wall_s, real_time_factor: of the stepping alone.
        packets: see `Execution.packet_counts`.
        notes: the assumptions made.
        overruns: number and largest delay of the overruns of a paced run.
        gateways: see `Gateways.counts`.
        profile: the time profile, if it was requested.
        folder: the folder of the results; None if nothing was recorded.
        restarts: how often processes of FMUs were started anew after a crash; `notes` tells each.
        verdict: the verdict on the swarm; None if the run did not begin.
    """

    outcome: Outcome
    error: CosimError | None
    _: KW_ONLY
    simulated_s: float = 0.0
    wall_s: float = 0.0
    real_time_factor: float = 0.0
    packets: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    overruns: Overruns = field(default_factory=Overruns)
    gateways: Mapping[str, Mapping[str, int | str]] = field(default_factory=dict)
    profile: Profile | None = None
    restarts: int = 0
    folder: Path | None = None
    verdict: Judgement | None = None


def failing(result: RunResult, failures: Sequence[FmuError]) -> RunResult:
    """Returns the result of a run with a complete recording, but FMUs that could not be terminated: it has failed."""
    if not failures:
        return result
    before = result.error.failures if isinstance(result.error, RunFailed) else ()
    return replace(result, outcome=Outcome.FAILED, error=RunFailed([*before, *failures]))


def unrecorded(result: RunResult, failure: RecordingFailed | None) -> RunResult:
    """Returns the result of a run whose recording could not be completed: it has failed, if it had not before."""
    return result if failure is None else replace(result, outcome=Outcome.FAILED, error=result.error or failure)
