"""Options of a run, and callbacks for its progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.results.storage.run_folder import RunFolder
from cosim_master.stepping.observation import Progress, Seen
from cosim_master.system.reading.overrides import apart
from cosim_master.system.settings.changes import FromSet
from cosim_master.system.structure import SystemStructure
from cosim_master.verdict.findings import Judgement

__all__ = ["Listener", "Reporting", "RunOptions", "going_on", "number", "seed_number", "text_of", "whole"]

_GREATEST_SEED = 2**53
"""The greatest seed that a system and `--seed` may give."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options of a run. The defaults run a system as it is described and record nothing.

    Paths may be given as text, and values as numbers.

    Attributes:
        variant: selects one of several .ssd in an archive or folder.
        overrides: start values by hierarchical name or pattern, and settings of radio, recording and master
            ("network.loss"), as text: see `check`.
        at: (time in s, hierarchical name, text): tunable parameters and open inputs to be set during the run.
        inputs: a CSV file with values of open inputs over time: see `stimuli`.
        solver: solver of FMUs for Model Exchange, in the notation of `solvers.Choice.parsed`; an FMU that runs alone is
            then run by its Model Exchange interface.
        strict: notes of the type `Finding` are errors.
        until: stop time in s; None uses the system's DefaultExperiment.
        step: step size in s of all FMUs; None uses those of the system and the FMUs.
        seed: seed of the radio's random numbers; None uses the system's.
        out: folder for the results, overwritten in any case, or a `RunFolder`, which defines the results that may be
            overwritten; None records nothing.
        record: patterns of signals to record; if empty, those of the system, or else all outputs.
        checkpoint_every: simulated time in s between checkpoints in `out`; None writes none.
        origin: RUN@TIME, a checkpoint to resume from: see `going_on`.
        pace: largest multiple of real time; None runs as fast as possible.
        threads: number of threads that step native instances; None selects it automatically.
        isolation: the FMUs that run in processes of their own, and the limits of these; None: those that this project
            has not built, where processes are available.
        profile: measure the time profile.
        gcs: addresses of ground stations, each within radio reach of all vehicles: see `gateways`.
        dataflash: answer requests for logs that come through gateways from the recording, for autopilots whose inner
            values are recorded.
        ports: address of the first vehicle's serial port, and the difference between consecutive ports.
        replay: folder of an earlier run, of which values set and packets of the live page or ROS are repeated.
        assignment: a file that says which part of a run in parts runs what: see `partitions.cut.read_assignment`.
    """

    variant: str | None = None
    overrides: Mapping[str, str] = field(default_factory=dict)
    at: Sequence[tuple[float, str, str]] = ()
    inputs: Path | None = None
    solver: str | None = None
    strict: bool = False
    until: float | None = None
    step: float | None = None
    seed: int | None = None
    out: Path | RunFolder | None = None
    record: Sequence[str] = ()
    checkpoint_every: float | None = None
    origin: str | None = None
    pace: float | None = None
    threads: int | None = None
    isolation: Isolation | None = None
    profile: bool = False
    gcs: Sequence[str] = ()
    ports: str | None = None
    dataflash: bool = False
    replay: Path | None = None
    assignment: Path | None = None
    helics: str | None = None
    helics_publish: Sequence[str] = ()
    helics_subscribe: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Takes paths as text, values as numbers, and numbers and arrays of numpy, too.

        Raises:
            TypeError: one text is given instead of a sequence of texts, or a change is not (time, name, value).
            SystemDescriptionError: a number is of another kind, or `overrides` are no mapping.
        """
        for name in ("out", "inputs", "replay", "assignment"):
            if isinstance(path := getattr(self, name), str):
                object.__setattr__(self, name, Path(path))
        for name in ("record", "gcs", "helics_publish", "helics_subscribe"):
            if isinstance(text := getattr(self, name), str):
                raise TypeError(f"{name} is one text; give a sequence of texts: {name}=({text!r},)")
            if isinstance(text, np.ndarray):
                object.__setattr__(self, name, tuple(map(str, text)))
        for name in ("until", "step", "checkpoint_every", "pace"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        object.__setattr__(self, "seed", seed_number("seed", self.seed))
        object.__setattr__(self, "threads", whole("threads", self.threads))
        if not isinstance(self.overrides, Mapping):
            text = f'is {self.overrides!r}, not a mapping; give values by name: {{"network.loss": 0.1}}'
            raise SystemDescriptionError([Problem(Where("overrides"), text)])
        object.__setattr__(self, "overrides", {name: text_of(value) for name, value in self.overrides.items()})
        object.__setattr__(self, "at", tuple(map(_change, self.at)))


def text_of(value: Any) -> str:
    """Returns the text of a value."""
    return str(value).lower() if isinstance(value, bool | np.bool_) else str(value)


def number(name: str, value: Any) -> float | None:
    """Returns the number that an argument of this name gives, in a type of Python; None stays None.

    Raises:
        SystemDescriptionError: it is no number.
    """
    found = value.item() if isinstance(value, np.generic | np.ndarray) and value.ndim == 0 else value
    if found is None or (isinstance(found, int | float) and not isinstance(found, bool)):
        return found
    raise SystemDescriptionError([Problem(Where(name), f"is {value!r}; give a number")])


def whole(name: str, value: Any, least: int = 0, greatest: float = np.inf) -> int | None:
    """Returns the integer that an argument of this name gives; None stays None.

    Raises:
        SystemDescriptionError: it is no integer from `least` to `greatest`.
    """
    try:
        found = None if value is None or isinstance(value, bool | np.bool_) else index(value)
    except TypeError:
        found = None
    if value is None or (found is not None and least <= found <= greatest):
        return found
    valid = f"of {least} or more" if greatest == np.inf else f"from {least} to {greatest:.0f}"
    raise SystemDescriptionError([Problem(Where(name), f"is {value!r}; give a whole number {valid}")])


def seed_number(name: str, value: Any) -> int | None:
    """Returns the seed of the radio that an argument of this name gives; None stays None.

    Raises:
        SystemDescriptionError: it is none.
    """
    return whole(name, value, 0, _GREATEST_SEED)


def _change(given: Any) -> tuple[float, str, str]:
    """Returns a change during a run. Raises TypeError if it is none."""
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 3:
        raise TypeError(f"at contains {given!r}; give a sequence of (time in s, name, value)")
    time, name, value = given
    return float(time), name, value if isinstance(value, FromSet) else text_of(value)


def _ignore(_: Any) -> None:
    pass


@dataclass(frozen=True, slots=True, kw_only=True)
class Listener:
    """Callbacks for the progress of a run, called in the thread that runs it.

    Attributes:
        prepared: called when the system is checked and no FMU is loaded yet.
        stage: called with a description of each stage ("loading 15 FMU instances"), until the first step.
        progress: called about twenty times a second of wall-clock time, with gateways fifty times.
        gateway: called with messages about sockets.
        judged: called with the judgement so far when it has changed, at most once a second of wall-clock time; None:
            a run is judged at its end only.
    """

    prepared: Callable[[Prepared], None] = _ignore
    stage: Callable[[str], None] = _ignore
    progress: Callable[[Progress], None] = _ignore
    gateway: Callable[[str], None] = _ignore
    judged: Callable[[Judgement], None] | None = None


class Reporting:
    """The observer that reports the progress of a run to its listener."""

    every = 0

    def __init__(self, listener: Listener) -> None:
        self.progressed = listener.progress

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...


def going_on(options: RunOptions, checkpoint: Checkpoint, structure: SystemStructure) -> RunOptions:
    """Returns the options of a run that is resumed from a checkpoint.

    `overrides` become changes at the time of the checkpoint; settings of the radio apply from then on. A seed, stop
    time or patterns missing in `options` are those of the run that wrote the checkpoint.
    """
    was = checkpoint.identity
    variables, settings = apart(options.overrides, structure)
    new = {f"{tag}.{name}": text for tag, given in settings.items() for name, text in given.items()}
    stop = (was.start + was.steps * was.base) / (1e9 * was.per_ns)
    return replace(
        options,
        at=[*((checkpoint.time, name, FromSet(value)) for name, value in variables.items()), *options.at],
        overrides={**checkpoint.overrides, **new},
        record=options.record or checkpoint.record,
        until=stop if options.until is None else options.until,
        seed=was.seed if options.seed is None and "network.seed" not in new else options.seed,
    )
