"""Prepares a run as far as possible without loading an FMU."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import (
    Finding,
    Problem,
    SystemDescriptionError,
)
from cosim_master.diagnostics.limitations import RECORDING_INTERVAL
from cosim_master.execution.preparation.stimuli import Stimuli
from cosim_master.fmi.slaves.isolated import changed_source
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.single_fmu import output_interval
from cosim_master.system.settings.changes import Change, changes
from cosim_master.system.settings.master import MasterSettings, connected, master_settings_of
from cosim_master.system.settings.network import Network, network_of
from cosim_master.system.settings.receivers import with_jamming
from cosim_master.system.settings.recording import Recording, recording_of
from cosim_master.system.settings.time_grid import DEFAULT_DURATION, TimeGrid, exact, time_grid
from cosim_master.verdict.findings import Judgement
from cosim_master.verdict.monitors.declared import Monitors, monitors_of
from cosim_master.verdict.prior import known_before
from cosim_master.verdict.watching.limits import Limits, limits_of

__all__ = ["Prepared", "prepare"]


@dataclass(frozen=True, slots=True)
class Prepared:
    """A checked system with its clock, network and recording: ready to run, with no FMU loaded."""

    checked: CheckedSystem
    clock: TimeGrid
    network: Network
    recording: Recording
    every: int
    changes: tuple[Change, ...] = ()
    master: MasterSettings = field(default_factory=MasterSettings)
    stimuli: Stimuli | None = None
    limits: Limits = field(default_factory=Limits)
    monitors: Monitors = field(default_factory=Monitors)

    def verdict(self) -> Judgement:
        """Returns the findings about the swarm that are known before the run."""
        set_later = [(self.checked.instances[c.instance].name, c.variable, c.value) for c in self.changes]
        clock = self.clock
        span = (clock.time(0), clock.time(clock.steps))
        return Judgement.of(known_before(self.checked, self.network, set_later, span), *span)

    @property
    def notes(self) -> tuple[str, ...]:
        stimuli = () if self.stimuli is None else self.stimuli.notes
        return (
            *self.checked.notes,
            *self.clock.notes,
            *self.network.notes,
            *self.master.notes,
            *self.monitors.notes,
            *stimuli,
        )


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
    """Prepares a run as far as possible without loading an FMU.

    Args:
        strict: notes of the type `Finding` are errors.

    Raises:
        SystemDescriptionError: clock, network or recording are invalid; all problems are reported at once.
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
    recording = gathered(lambda: recording_of(checked, record))
    master = gathered(lambda: master_settings_of(checked))
    gridless = master is not None and master.constrained
    clock = gathered(lambda: time_grid(checked, until, step, gridless=gridless))
    network = gathered(lambda: network_of(checked, seed))
    if network is not None:
        checked = gathered(lambda: with_jamming(checked, network)) or checked
    limits = gathered(lambda: limits_of(checked))
    monitors = gathered(lambda: monitors_of(checked, network, clock, gridless=gridless))
    if clock is not None and master is not None:
        gathered(lambda: master.check(checked, clock.base, clock.periods, clock.per_ns))
    if problems:
        raise SystemDescriptionError(problems)
    late = [*_unused_times(network, clock.time(0), clock.time(clock.steps)), *_outdated(checked)]
    if late:
        checked = replace(checked, notes=(*checked.notes, *late))
    every = 1
    if recording.interval is not None:
        interval = exact(recording.interval) or Fraction(0)
        every = round(interval * clock.per_ns / clock.base)
        if every < 1 or not math.isclose(every * clock.base, interval * clock.per_ns, rel_tol=1e-9):
            base = clock.seconds(1)
            near = clock.seconds(max(1, every))
            text = RECORDING_INTERVAL.text(f"{recording.interval:g}", f"{base:.9g}", f"{near:.9g}")
            raise SystemDescriptionError([Problem(checked.structure.where, text)])
    checked = connected(checked, master)
    if stimuli is not None:
        checked = stimuli.initialize(checked, clock.time(0))
        stimuli.sample(clock)
    ready = Prepared(
        checked, clock, network, recording, every, changes(checked, clock, at), master, stimuli, limits, monitors
    )
    if strict and (findings := [note.problem for note in ready.notes if isinstance(note, Finding)]):
        raise SystemDescriptionError(findings)
    return ready


def _outdated(checked: CheckedSystem) -> Iterator[str]:
    """Yields notes on FMUs whose models have changed since they were built."""
    for fmu in {id(one.fmu): one.fmu for one in checked.instances}.values():
        if (file := changed_source(fmu)) is not None:
            of, source = (_shown(one) for one in (fmu.path, file))
            yield f"{of} was built from another {source} than is there now; uav-cosim build {source} builds it anew"


def _shown(file: Path) -> Path:
    """Returns a path as a user would write it: relative to the working directory, if the file is below it."""
    absolute = file.absolute()
    return absolute.relative_to(Path.cwd()) if absolute.is_relative_to(Path.cwd()) else absolute


def _default_step(checked: CheckedSystem, until: float | None) -> float | None:
    """Returns a step size for an FMU alone that proposes none."""
    stop = until if until is not None else checked.stop_time
    stop = checked.start_time + DEFAULT_DURATION if stop is None else stop
    is_alone = checked.structure.path.suffix.lower() == ".fmu"
    if not is_alone or stop <= checked.start_time or checked.instances[0].step_size is not None:
        return None
    return output_interval(stop - checked.start_time)


def _unused_times(network: Network, begin: float, end: float) -> Iterator[str]:
    """Yields notes on disturbances of the radio that begin after a run, or end before it."""
    times = [(f"the outage of {name}", start, stop) for name, start, stop in network.outages]
    times += [(f"the partition of {', '.join(one.nodes[:3])}", one.start, one.stop) for one in network.partitions]
    times += [("the jamming", one.start, one.stop) for one in network.jamming]
    for what, start, stop in times:
        if start >= end or stop <= begin:
            span = f"from {start:g} s to {stop:g} s" if stop < math.inf else f"from {start:g} s on"
            yield f"{what} {span} has no effect: the run goes from {begin:g} s to {end:g} s"
