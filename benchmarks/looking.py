"""What it costs to record a run, and to export it: processor time, so that other work on the machine counts little.

Another thread sorts and compresses a recording. The time of the run's own thread is that of a machine with a free core,
the time of all threads that of a machine without one; wall-clock time is beside them.

    python benchmarks/looking.py [--drones 1000] [--turns 5] [--seconds 40] [--no-formats]

Each turn runs `line5` for 850 s without a recording and with a recording of everything, and a swarm of a thousand
without one and with positions, one after the other; the medians of the turns are compared. Then each format is written
once, for `line5` (85 s) and for the swarm.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.export.formats import FORMATS

SYSTEMS = Path(__file__).parents[1] / "master" / "systems"
COMMAND = str(Path(sys.executable).with_name("uav-cosim"))
POSITIONS = ("*.vehicle.position*", "*.vehicle.attitude*")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drones", type=int, default=1000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--no-formats", action="store_true", help="only recordings")
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        record(Path(folder), given.drones, given.turns, given.seconds)
        if not given.no_formats:
            export_all(Path(folder))


def record(folder: Path, drones: int, turns: int, seconds: float) -> None:
    """Prints what recordings cost.

    Args:
        folder: for the swarm, its recordings and the files of the formats.
        drones: number of drones of the swarm.
        turns: runs of each kind.
        seconds: simulated time of the swarm, s.
    """
    swarm = folder / "swarm"
    subprocess.run(
        [COMMAND, "new", "line5", "--drones", str(drones), "-o", str(swarm)], check=True, capture_output=True
    )
    small = [(None, ()), (folder / "small", ())]
    compare("line5, everything", [lambda o=o: flown(SYSTEMS / "line5", 850.0, *o) for o in small], turns)
    many = [(None, ()), (folder / "many", POSITIONS)]
    compare(f"{drones} drones, positions", [lambda o=o: flown(swarm, seconds, *o) for o in many], turns)


def export_all(folder: Path) -> None:
    """Prints what each format costs."""
    flown(SYSTEMS / "line5", 85.0, folder / "line5", ())
    for name in ("line5", "many"):
        for one in FORMATS:
            export(folder / name, one.option, folder / f"{name}-{one.name}{one.suffix}")


CLOCKS = {"processor": time.process_time, "run's own thread": time.thread_time, "wall clock": time.perf_counter}


def flown(system: Path, until: float, out: Path | None, record: tuple[str, ...]) -> list[float]:
    """Returns the time of a run by each of `CLOCKS`, s."""
    before = [clock() for clock in CLOCKS.values()]
    result = simulate(system, RunOptions(until=until, out=out, record=record, threads=1))
    assert result.error is None, result.error
    return [clock() - at for clock, at in zip(CLOCKS.values(), before, strict=True)]


def compare(name: str, both: list[Callable[[], list[float]]], turns: int) -> None:
    """Prints the medians of two kinds of runs, made in turns after one of each, and their ratio."""
    found = [[one() for one in both] for _ in range(turns + 1)][1:]
    for i, clock in enumerate(CLOCKS):
        plain, recorded = (statistics.median(row[kind][i] for row in found) for kind in range(2))
        ratios = sorted(row[1][i] / row[0][i] for row in found)
        print(
            f"{name}, {clock}: {plain:.2f} s without, {recorded:.2f} s with a recording: "
            f"{100 * (recorded / plain - 1):+.1f} % "
            f"(turns {100 * (ratios[0] - 1):+.1f} to {100 * (ratios[-1] - 1):+.1f} %)",
            flush=True,
        )


def export(run: Path, option: str, file: Path) -> None:
    """Prints processor time, memory and size of an export."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([COMMAND, "export", str(run), option, str(file)], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        print(f"{run.name} {option}: {done.stderr.strip().splitlines()[-1]}", flush=True)
        return
    spent = sum(getattr(after, name) - getattr(before, name) for name in ("ru_utime", "ru_stime"))
    size = sum(one.stat().st_size for one in ([file] if file.is_file() else file.rglob("*")) if one.is_file())
    print(f"{run.name} {option}: {spent:.1f} s, {size / 1e6:.1f} MB", flush=True)


if __name__ == "__main__":
    main()
