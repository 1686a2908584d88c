"""A campaign from beginning to end: the runs that are left to do, given to workers as these become free."""

from __future__ import annotations

import queue
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa

from cosim_master.campaigns.dataset.folder import Folder, read_runs
from cosim_master.campaigns.refusal import refusal
from cosim_master.campaigns.running.cluster import Cluster, cluster
from cosim_master.campaigns.running.place import Place, look_at
from cosim_master.campaigns.running.prefix import groups, make_prefix
from cosim_master.campaigns.running.task import BAD, CRASHED, perform, row_without_run
from cosim_master.campaigns.search import batches
from cosim_master.campaigns.study.study import Planned, Study
from cosim_master.diagnostics.errors import CosimError
from cosim_master.execution.pacing import interrupts

__all__ = ["Campaign", "Standing", "sweep"]

_AHEAD = 3
"""Runs given to each worker at once: the next one is there when a run ends."""
_LOOK = 0.2
"""Wall-clock seconds between looks at an interruption, and at the progress."""
_COUNT = 5.0
"""Wall-clock seconds between counts of the workers."""


@dataclass(frozen=True, slots=True)
class Standing:
    """The progress of a campaign.

    Attributes:
        runs: number of runs of the study.
        before: runs that had ended before.
        made: runs that have ended since.
        bad: runs that failed, in all.
        wall: wall-clock seconds since the first run was given to a worker.
        workers: workers at this moment.
    """

    runs: int
    before: int
    made: int
    bad: int
    wall: float
    workers: int

    @property
    def rate(self) -> float:
        """Runs per second of wall-clock time."""
        return self.made / self.wall if self.wall > 0.0 else 0.0

    @property
    def left(self) -> float | None:
        """Wall-clock seconds left, if the rate stays the same; None before the first run has ended."""
        return (self.runs - self.before - self.made) / self.rate if self.made else None


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign that has ended, or was interrupted.

    Attributes:
        folder: its results.
        runs: number of runs of the study.
        before: runs that had ended before this call.
        made: runs that have ended since.
        outcomes: number of runs by outcome, in all.
        interrupted: whether the user ended it.
        shared: beginnings that were simulated once for several runs.
        wall_s: wall-clock time, with the start of the workers.
    """

    folder: Path
    runs: int
    before: int
    made: int
    outcomes: Mapping[str, int]
    interrupted: bool
    shared: int
    wall_s: float

    @property
    def complete(self) -> bool:
        return self.before + self.made == self.runs

    @property
    def bad(self) -> int:
        """The number of runs that failed, were refused, or crashed their worker."""
        return sum(n for outcome, n in self.outcomes.items() if outcome in BAD)

    def table(self) -> pa.Table:
        """Returns the dataset, a row for each run."""
        return read_runs(self.folder)


def _ignore(_: Any) -> None:
    pass


def sweep(
    study: Study,
    out: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    force: bool = False,
    started: Callable[[Cluster], None] = _ignore,
    progress: Callable[[Standing], None] = _ignore,
) -> Campaign:
    """Makes the runs of a study that have no row in a folder yet.

    Args:
        study: the study.
        out: folder of the dataset; made if necessary. With the same study in it, the campaign goes on.
        workers: processes on this machine; None: one for each core.
        scheduler: address of a Dask scheduler that makes the runs instead.
        force: remove a campaign of another study from the folder.
        started: called when the workers are there.
        progress: called several times a second.

    Raises:
        SystemDescriptionError: the study contradicts its system, the folder holds something else, or no scheduler
            answers. All of this is found before any run.
        CosimError: the connection to the scheduler is lost, a worker has another system than this process, or the
            dataset cannot be written. What has been written remains, and the same call goes on from there.
    """
    began = time.monotonic()
    if scheduler is not None and workers is not None:
        raise refusal("--workers", "belongs to the cluster of this machine; the scheduler has its own workers")
    first = _first(study)
    place = look_at(study, first)
    groups(study, [first])  # before anything is written: it may refuse the study
    with Folder(Path(out), study, place.inputs, begin=place.begin, force=force) as folder:
        before = len(folder.done)
        made = _Made(study, place, folder, study.count, before, progress)
        if before < study.count:
            with interrupts() as interrupted, cluster(scheduler, workers) as found:
                started(found)
                for batch in _batches(study, folder):
                    made.all(found, _left(study, folder, batch), interrupted)
                    if made.interrupted:
                        break
        campaign = Campaign(
            Path(out), study.count, before, made.count, Counter(folder.outcomes.values()), made.interrupted,
            made.shared, time.monotonic() - began,
        )  # fmt: skip
        folder.write_json("summary.json", _summary(campaign))
    return campaign


def _first(study: Study) -> Planned:
    """Returns a run with which the study is checked."""
    if study.search is None:
        return study.runs()[0]
    values = {one.label: one.at(0.5) for one in study.factors}
    return Planned(0, 0, values, study.seeds[0] if study.seeds else None)


def _batches(study: Study, folder: Folder) -> Iterator[Sequence[Planned]]:
    """Yields the runs that are known; those of a search depend on the runs before them."""
    if study.search is None:
        yield study.runs()
    else:
        yield from batches(study, study.search, lambda run: folder.sought(run.run))


def _left(study: Study, folder: Folder, runs: Sequence[Planned]) -> list[tuple[bool, list[Planned]]]:
    """Returns the runs that have no row, in groups with a common beginning."""
    left = [(one, [run for run in group if run.run not in folder.done]) for one, group in groups(study, runs)]
    return [(shared, group) for shared, group in left if group]


def _summary(campaign: Campaign) -> dict[str, Any]:
    return {
        "runs": campaign.runs,
        "done": campaign.before + campaign.made,
        "outcomes": dict(sorted(campaign.outcomes.items())),
        "interrupted": campaign.interrupted,
    }


@dataclass(slots=True)
class _Made:
    """The runs of one call: gives them to workers, and writes the rows of those that have ended."""

    study: Study
    place: Place
    folder: Folder
    runs: int
    before: int
    progress: Callable[[Standing], None]
    count: int = 0
    shared: int = 0
    interrupted: bool = False
    _ended: queue.SimpleQueue[Any] = field(default_factory=queue.SimpleQueue)
    _flying: dict[str, tuple[tuple[Planned, Any], Any]] = field(default_factory=dict)
    _suspects: list[tuple[Planned, Any]] = field(default_factory=list)
    _alone: bool = False
    _interrupted: Callable[[], bool] = lambda: False
    _began: float = field(default_factory=time.monotonic)

    def all(
        self, found: Cluster, todo: Sequence[tuple[bool, Sequence[Planned]]], interrupted: Callable[[], bool]
    ) -> None:
        """Makes all runs; returns early if they are interrupted.

        Raises:
            CosimError: the scheduler is lost, or a row cannot be written.
        """
        self._interrupted, self._alone, self._suspects = interrupted, False, []
        self._fly(found, self._given(found.client, todo), _AHEAD)
        # A worker whose process ends takes others with it: those runs are made again, each alone.
        self._alone, suspects = True, self._suspects
        for one in suspects:
            self._fly(found, iter([one]), 1)

    def _fly(self, found: Cluster, waiting: Iterator[tuple[Planned, Any]], ahead: int) -> None:
        """Gives runs to the workers, `ahead` to each of them, and takes those that have ended."""
        counted = time.monotonic()
        workers = max(1, found.workers())
        more = not self.interrupted
        while more or self._flying:
            while more and len(self._flying) < ahead * workers:
                more = self._give(found.client, next(waiting, None))
            if self._interrupted():
                self.interrupted = True
                found.client.cancel([future for _, future in self._flying.values()])
                self._flying.clear()
                return
            with suppress(queue.Empty):
                self._take(self._ended.get(timeout=_LOOK))
            now = time.monotonic()
            if now - counted > _COUNT:
                workers, counted = max(1, found.workers()), now
            standing = Standing(self.runs, self.before, self.count, self._bad(), now - self._began, workers)
            self.progress(standing)

    def _bad(self) -> int:
        return sum(one in BAD for one in self.folder.outcomes.values())

    def _given(self, client: Any, todo: Sequence[tuple[bool, Sequence[Planned]]]) -> Iterator[tuple[Planned, Any]]:
        """Yields each run with its beginning, which is given to the workers when its first run is."""
        for shared, group in todo:
            prefix = None
            if shared:
                prefix = client.submit(make_prefix, self.study, self.place, group[0], pure=False)
                self.shared += 1
            for run in group:
                yield run, prefix

    def _give(self, client: Any, one: tuple[Planned, Any] | None) -> bool:
        if one is None:
            return False
        run, prefix = one
        future = client.submit(perform, self.study, self.place, run, prefix, pure=False)
        self._flying[future.key] = (one, future)
        future.add_done_callback(self._ended.put)
        return True

    def _take(self, future: Any) -> None:
        """Writes the row of a run that has ended."""
        from distributed import KilledWorker

        one, _ = self._flying.pop(future.key)
        run = one[0]
        if future.status in ("cancelled", "lost"):
            raise CosimError(
                f"the connection to the scheduler is lost; the {len(self.folder.done)} runs that have ended are in "
                f"{self.folder.path}, and the same command goes on from there"
            )
        error = future.exception()
        if error is None:
            ended = future.result()
            self.folder.add(ended.row, ended.signals)
        elif isinstance(error, KilledWorker) and not self._alone:
            self._suspects.append(one)
            return
        elif isinstance(error, KilledWorker):
            text = "the process of the worker ended each time it made this run, also without any other run"
            self.folder.add(row_without_run(self.study, self.place, run, CRASHED, text))
        elif isinstance(error, CosimError):
            raise error
        else:
            text = f"{type(error).__name__}: {error}"
            self.folder.add(row_without_run(self.study, self.place, run, "failed", text))
        self.count += 1
