"""A long run, and many runs in one process: memory, descriptors, threads and temporary folders must not grow.

    python -m benchmarks.soak [--hours 24] [--runs 300] [--json FILE]

The long run is one FMU of this project (PointMass); every simulated hour, the process is measured.
Of the many runs, every second one isolates its FMU. After a tenth of each, which loads and compiles, nothing may grow:
descriptors, threads (but the two that write journal and file), processes and temporary folders not at all, memory by
5 % or 20 MiB at most. The last time of the long run must be exact. Exits 1 if anything of this is not so.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cosim_master import RunOptions, simulate
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.results.reading.read import signals
from cosim_master.stepping.observation import Seen, View

FMU = Path(__file__).parents[1] / "fmus" / "PointMass.fmu"
MEMORY = 20 << 20


@dataclass(frozen=True, slots=True)
class Size:
    """What this process has in use: bytes of memory, and numbers of other things."""

    memory: int
    descriptors: int
    threads: int
    processes: int
    temporary: int


def size(temporary: Path) -> Size:
    """Returns the present size of this process, whose temporary folders are in `temporary`."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    children = [one for task in Path("/proc/self/task").iterdir() for one in _children(task)]
    return Size(
        pages * os.sysconf("SC_PAGE_SIZE"),
        len(list(Path("/proc/self/fd").iterdir())),
        threading.active_count(),
        len(children),
        len(list(temporary.iterdir())),
    )


def _children(task: Path) -> list[str]:
    try:
        return (task / "children").read_text().split()
    except FileNotFoundError:  # the thread has ended
        return []


class Hourly:
    """An observer that measures the process at equal intervals of simulated time."""

    def __init__(self, view: View, hours: float, temporary: Path, found: list[Size]) -> None:
        self.every = view.steps(3600.0 * min(1.0, hours / 24))
        self._temporary, self._found = temporary, found

    def initialised(self, seen: Seen) -> None: ...

    def stepped(self, seen: Seen) -> None:  # noqa: ARG002
        self._found.append(size(self._temporary))

    def closed(self) -> None: ...


def grown(sizes: list[Size], writers: int = 0) -> list[str]:
    """Returns what has grown after the first tenth; so many threads begin when there are rows to write."""
    first, last = sizes[len(sizes) // 10], sizes[-1]
    first = replace(first, threads=first.threads + writers)
    wrong = []
    if last.memory > max(1.05 * first.memory, first.memory + MEMORY):
        wrong.append(f"memory has grown from {first.memory >> 20} to {last.memory >> 20} MiB")
    for name in ("descriptors", "threads", "processes", "temporary"):
        if getattr(last, name) > getattr(first, name):
            wrong.append(f"{name} have grown from {getattr(first, name)} to {getattr(last, name)}")
    return wrong


def soak(hours: float, runs: int, fmu: Path = FMU) -> dict[str, Any]:
    """Makes the long run and the many runs; returns what was measured, and `wrong`."""
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="uav-cosim-soak-") as folder:
        temporary, out = Path(folder) / "temporary", Path(folder) / "out"
        temporary.mkdir()
        before, tempfile.tempdir = tempfile.tempdir, str(temporary)
        try:
            long, until, began = [], 3600.0 * hours, time.perf_counter()
            options = RunOptions(out=out, until=until, record=["*.position[1]"])
            result = simulate(fmu, options, observers=[lambda view: Hourly(view, hours, temporary, long)])
            seconds = time.perf_counter() - began
            last = signals(out)["time"].to_pylist()[-1]
            if (result.outcome, result.simulated_s, last) != ("done", until, until):
                wrong.append(f"the long run: {result.outcome} at {result.simulated_s!r} s, its last row {last!r} s")
            many, began = [], time.perf_counter()
            for number in range(runs):
                isolation = Isolation("all" if number % 2 else "none")
                result = simulate(fmu, RunOptions(out=out, until=1.0, isolation=isolation))
                if result.outcome != "done":
                    wrong.append(f"run {number}: {result.error}")
                gc.collect()
                many.append(size(temporary))
        finally:
            tempfile.tempdir = before
    wrong += [f"the long run: {text}" for text in grown(long, writers=2)] + [
        f"many runs: {text}" for text in grown(many)
    ]
    return {
        "hours": hours,
        "long run, s": seconds,
        "last time, s": last,
        "long run": [asdict(one) for one in (long[len(long) // 10], long[-1])],
        "runs": runs,
        "many runs, s": time.perf_counter() - began,
        "many runs": [asdict(one) for one in (many[len(many) // 10], many[-1])],
        "wrong": wrong,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = soak(given.hours, given.runs)
    print(json.dumps(found, indent=1))
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(bool(found["wrong"]))


if __name__ == "__main__":
    sys.exit(main())
