"""Kills a run at random instants and says how much of its recording was lost.

    python -m benchmarks.kill [--times 300] [--seed 1] [--checkpoint-every S] [--json FILE]

The run is line5 with a bad radio, held at about a second of wall-clock time. Each time a process of its own runs it,
and gets SIGKILL at a random moment between its start and half a second after its usual end. Then, in another process:

- signals and packets must be readable, before any repair, and equal to the first rows of a run that nobody killed;
- `repair` must make Parquet files with the same rows, and logs that are the beginning of that run's logs;
- of the rows that the run had stepped through, as it noted in shared memory, some may be missing. `lost` is how long
  before the signal the first of them was made, in seconds of wall-clock time.

With --checkpoint-every, the run writes checkpoints as often, in s of simulated time. A run that was killed goes on
from the last one, and must then leave the same bytes as a run that nobody killed; `in a checkpoint` counts the kills
that have left an incomplete one.

Exits 1 if anything was wrong, or more than a second was lost.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import random
import shutil
import signal
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from cosim_master import RunOptions, simulate
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.repair import repair
from cosim_master.stepping.observation import Seen, View

SYSTEM = Path(__file__).parents[1] / "master" / "systems" / "line5"
UNTIL, WALL = 10.0, 1.2
"""Simulated time, and wall-clock time that it is held at, s."""
OPTIONS = RunOptions(until=UNTIL, threads=1, overrides={"network.loss": "0.3", "network.jitter": "0.02"})


@dataclass(frozen=True, slots=True)
class Killed:
    """One run that was killed.

    Attributes:
        after: when, in s since its process began.
        state: "not begun", "running" or "ended".
        rows: how many were read.
        made: how many the run had stepped through.
        lost: s.
        wrong: what must not be.
        resumed: whether it went on from a checkpoint.
        within: whether it was writing one.
    """

    after: float
    state: str
    rows: int
    made: int
    lost: float
    wrong: tuple[str, ...]
    resumed: bool = False
    within: bool = False


class Stamps:
    """An observer that notes in shared memory when each row was made: s, of the monotonic clock."""

    def __init__(self, view: View, memory: Any) -> None:
        self.every = view.every
        self._stamps = np.frombuffer(memory, dtype=np.float64)
        self._n = 0

    def initialised(self, seen: Seen) -> None:
        self.stepped(seen)

    def stepped(self, seen: Seen) -> None:  # noqa: ARG002
        self._stamps[self._n] = time.monotonic()
        self._n += 1

    def closed(self) -> None: ...


def kill_once(after: float, out: Path, whole: Path, every: float | None) -> Killed:
    """Runs the system in a child of this process, which must have no threads, and kills it."""
    memory = mmap.mmap(-1, 8 * 4096)
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)
        options = replace(OPTIONS, out=out, pace=UNTIL / WALL, checkpoint_every=every)
        simulate(SYSTEM, options, observers=[lambda v: Stamps(v, memory)])
        os._exit(0)
    time.sleep(max(0.0, began + after - time.monotonic()))
    os.kill(child, signal.SIGKILL)
    at = time.monotonic()
    os.waitpid(child, 0)
    stamps = np.frombuffer(memory, dtype=np.float64)
    made = int(np.count_nonzero(stamps))
    if not (out / "manifest.json").is_file():
        return Killed(
            after, "not begun", 0, made, 0.0, ("steps were made before there was a manifest",) if made else ()
        )
    wrong: list[str] = []
    state = json.loads((out / "manifest.json").read_text())["outcome"]
    rows = _same(out, whole, wrong, "before the repair")
    repair(out)
    _same(out, whole, wrong, "after the repair")
    wrong += [
        f"{log.relative_to(out)} is not the beginning of what it should be"
        for log in (out / "packets.tlog", *out.glob("packets/*.tlog"))
        if not (whole / log.relative_to(out)).read_bytes().startswith(log.read_bytes())
    ]
    if pq.read_table(out / "signals.parquet").num_rows != rows:
        wrong.append("the repair has changed the number of rows")
    lost = float(at - stamps[rows]) if rows < made else 0.0
    within = any(out.glob("checkpoints/*.part"))
    resumed = every is not None and go_on(out, whole, every, wrong)
    return Killed(after, "ended" if state == "done" else state, rows, made, lost, tuple(wrong), resumed, within)


def go_on(out: Path, whole: Path, every: float, wrong: list[str]) -> bool:
    """Goes on from the last checkpoint before the end; returns whether there is one."""
    times = [float(file.parent.name) for file in out.glob("checkpoints/*/checkpoint.json")]
    if not (times := [time for time in times if time < UNTIL]):
        return False
    again = out.with_name("again")
    shutil.rmtree(again, ignore_errors=True)
    result = simulate(SYSTEM, RunOptions(out=again, origin=f"{out}@{max(times):g}", checkpoint_every=every, threads=1))
    if result.outcome != "done":
        wrong.append(f"it does not go on: {result.error}")
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        if (again / name).read_bytes() != (whole / name).read_bytes():
            wrong.append(f"{name} of the run that went on from {max(times):g} s has other bytes")
    return True


def _same(out: Path, whole: Path, wrong: list[str], when: str) -> int:
    """Whether what is read are the first rows of the whole run; returns how many of signals."""
    counts = []
    for what, read in (("signals", signals), ("packets", packets)):
        got, wanted = read(out), pq.read_table(whole / f"{what}.parquet")
        counts.append(got.num_rows)
        if not got.equals(wanted.slice(0, got.num_rows)):
            wrong.append(f"{what} are not those of the whole run, {when}")
    return counts[0]


def kill(times: int, seed: int, every: float | None) -> list[Killed]:
    """Kills as often."""
    instants = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, out = Path(folder) / "whole", Path(folder) / "out"
        # This also compiles and loads all code.
        result = simulate(SYSTEM, replace(OPTIONS, out=whole, checkpoint_every=every))
        assert result.outcome == "done", result.error
        found = []
        for _ in range(times):
            shutil.rmtree(out, ignore_errors=True)
            found.append(kill_once(instants.uniform(0.0, WALL + 1.2), out, whole, every))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--times", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--checkpoint-every", type=float, metavar="S")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = kill(given.times, given.seed, given.checkpoint_every)
    states = {state: sum(one.state == state for one in found) for state in ("not begun", "running", "ended")}
    wrong = [text for one in found for text in one.wrong]
    lost = [one.lost for one in found if one.state == "running"]
    summary = {
        "killed": len(found),
        **states,
        "in a checkpoint": sum(one.within for one in found),
        "went on from a checkpoint": sum(one.resumed for one in found),
        "wrong": wrong,
        "rows read": sum(one.rows for one in found),
        "rows missing": sum(max(0, one.made - one.rows) for one in found),
        "lost at most, s": max(lost, default=0.0),
        "lost in the median, s": statistics.median(lost) if lost else 0.0,
    }
    for name, value in summary.items():
        print(f"{name}: {value:.3g}" if isinstance(value, float) else f"{name}: {value}")
    if given.json:
        given.json.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return int(bool(wrong) or max(lost, default=0.0) > 1.0)


if __name__ == "__main__":
    sys.exit(main())
