"""The beginning that runs share: simulated once, up to a checkpoint from which each of them goes on.

Runs share a beginning if they have the same seed and the same values until a time from which on their factors act
("NAME@30"). A factor that acts from the start, and a seed, leave nothing to share. Settings of the radio can only
change at a checkpoint; with such a factor, every run goes on from one.
"""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from cosim_master.campaigns.metrics.measured import Collector
from cosim_master.campaigns.refusal import refusal
from cosim_master.campaigns.running.options import options_of
from cosim_master.campaigns.running.place import Disagreement, Place, agree, is_setting
from cosim_master.campaigns.study.study import Planned, Study
from cosim_master.diagnostics.errors import CosimError
from cosim_master.execution.options import Listener
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.observation import MakeObserver, Packets, Rows, Seen, View

__all__ = ["Prefix", "groups", "make_prefix", "unpacked"]


@dataclass(frozen=True, slots=True)
class Prefix:
    """A beginning: its checkpoint as an archive, its time [s], and the rows recorded up to then, if any are needed."""

    checkpoint: bytes
    time: float
    rows: Rows | None


def branch_time(study: Study) -> float | None:
    """Returns the time from which runs may differ that were the same before, s; None: they differ from the start.

    Raises:
        SystemDescriptionError: settings change at several times, or one that cannot change.
    """
    later = {one.label: one for one in study.factors if one.time is not None}
    settings = [one for one in later.values() if is_setting(one.name)]
    if wrong := [one.label for one in settings if one.name.startswith("recording.")]:
        raise refusal(f"factor {wrong[0]}", "a recording does not change during a run; leave out the time")
    times = {one.time for one in settings if one.time is not None}
    if len(times) > 1:
        text = "settings of the radio change at one time only; give all of these factors the same time"
        raise refusal(f"factor {settings[0].label}", text)
    return min(times or {one.time for one in later.values() if one.time is not None}, default=None)


def groups(study: Study, runs: Sequence[Planned]) -> list[tuple[bool, list[Planned]]]:
    """Returns the runs in groups with a common beginning, each with whether this is to be simulated once."""
    time = branch_time(study)
    if time is None:
        return [(False, [run]) for run in runs]
    forced = any(one.time is not None and is_setting(one.name) for one in study.factors)
    before = [one.label for one in study.factors if one.time is None or one.time < time]
    found: dict[tuple[object, ...], list[Planned]] = {}
    for run in runs:
        found.setdefault((run.seed, *(run.values[label] for label in before)), []).append(run)
    return [(forced or len(group) > 1, group) for group in found.values()]


class _Ends:
    """A `PointObserver` that ends a run as soon as it has written a checkpoint."""

    every = 2**40
    periods = (every,)
    prompt = False

    def __init__(self, checkpoint: Path) -> None:
        self._checkpoint = checkpoint

    @property
    def over(self) -> bool:
        return self._checkpoint.is_dir()

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def packets(self, packets: Packets, *, complete: bool) -> None: ...
    def closed(self) -> None: ...


def make_prefix(study: Study, place: Place, run: Planned) -> Prefix | str:
    """Simulates the beginning of a run; returns the reason if that fails, so that each run can tell its own.

    Raises:
        CosimError: this process has another system, other FMUs or another version than the client.
    """
    time = branch_time(study)
    assert time is not None
    collected: list[Collector] = []

    def collector(view: View) -> Collector:
        collected.append(Collector(view))
        return collected[0]

    with tempfile.TemporaryDirectory(prefix="uav-cosim-prefix-") as folder:
        checkpoint = Path(folder) / "checkpoints" / f"{time:.9g}"
        every = time - place.begin
        options = replace(options_of(study, place, run, before=time), out=Path(folder), checkpoint_every=every)
        observers: list[MakeObserver] = [lambda _: _Ends(checkpoint), *([collector] if place.measured else [])]
        try:
            result = simulate(
                study.system,
                options,
                observers=observers,
                listener=Listener(prepared=lambda ready: agree(place, ready)),
            )
        except Disagreement:
            raise
        except CosimError as error:
            return str(error)
        if not checkpoint.is_dir():
            return str(result.error or f"the run ended before {time:g} s")
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for file in sorted(checkpoint.rglob("*")):
                archive.write(file, Path("checkpoints", file.relative_to(checkpoint.parent)))
        return Prefix(packed.getvalue(), time, collected[0].until(time) if collected else None)


@contextmanager
def unpacked(prefix: Prefix | None) -> Iterator[str | None]:
    """Yields RUN@TIME of an unpacked prefix, as of `--from`; None without one."""
    if prefix is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="uav-cosim-prefix-") as folder:
        with zipfile.ZipFile(io.BytesIO(prefix.checkpoint)) as archive:
            archive.extractall(folder)
        yield f"{folder}@{prefix.time:.9g}"
