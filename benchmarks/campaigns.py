"""Campaigns: runs per second of `uav-cosim sweep` beside a shell loop over `uav-cosim run`, and their processor time.

The study is line5 for 60 s: epsilon x loss x seeds, with the error to the law, the settling time and the packets lost.
The shell loop makes a few of the same runs one after the other, each twice before (warm), and writes recordings as the
command does. Processor time is that of all processes together.

    python benchmarks/campaigns.py [--seeds 20] [--loop 5] [--workers N] [--docs docs/scale.md]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from report import machine, show, write

from cosim_master.campaigns.dataset.folder import read_runs
from cosim_master.campaigns.dataset.table import digest_of

COMMAND = str(Path(sys.executable).with_name("uav-cosim"))
EPSILON, LOSS = "0.1:0.55:10", "0,0.05,0.1,0.2,0.3"
POINTS = 50
BEGIN, END = "<!-- campaigns: written by benchmarks/campaigns.py -->", "<!-- end of campaigns -->"


def timed(*words: str) -> tuple[float, float, str]:
    """Run a command; returns its wall-clock time, the processor time of all its processes [s], and what it printed."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([COMMAND, *words], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, spent, done.stdout


def loop(runs: int, until: str, folder: Path) -> dict[str, float]:
    """The same runs by the command, one after the other."""
    walls, spent = [], []
    for number in range(-2, runs):
        values = ("--set", f"drone*.agent.epsilon={0.1 + 0.05 * (number % 10):g}", "--set", "network.loss=0.1")
        wall, processor, _ = timed("run", "line5", *values, "--until", until, "--force", "-o", str(folder / "run"))
        if number >= 0:
            walls.append(wall)
            spent.append(processor)
    return {"runs": runs, "s_per_run": sorted(walls)[runs // 2], "processor_s_per_run": sorted(spent)[runs // 2]}


def campaign(seeds: int, workers: int, until: str, folder: Path) -> dict[str, Any]:
    """The study by one call of `sweep`."""
    words = ["sweep", "line5", "--vary", f"drone*.agent.epsilon={EPSILON}", "--vary", f"network.loss={LOSS}"]
    words += [
        "--seeds",
        str(seeds),
        "--metric",
        "error_to_law",
        "--metric",
        "settling_time",
        "--metric",
        "packets_lost",
    ]
    words += ["--until", until, "--workers", str(workers), "-o", str(folder / "study"), "--json"]
    wall, processor, told = timed(*words)
    runs = POINTS * seeds
    table = read_runs(folder / "study")
    assert json.loads(told)["outcomes"] == {"done": runs}
    assert table.num_rows == runs
    return {
        "runs": runs, "workers": workers, "wall_s": wall, "processor_s": processor, "s_per_run": wall / runs,
        "processor_s_per_run": processor / runs, "digest": digest_of(table),
    }  # fmt: skip


def document(file: Path, host: dict[str, Any], one: dict[str, float], many: dict[str, Any]) -> None:
    """Replace the section of the figures in a document."""
    text = file.read_text(encoding="utf-8") if file.is_file() else f"# Scale\n\n{BEGIN}\n{END}\n"
    if BEGIN not in text:
        text += f"\n{BEGIN}\n{END}\n"
    ratio = one["s_per_run"] / many["s_per_run"]
    lines = [
        BEGIN,
        "## Campaigns",
        "",
        "`python benchmarks/campaigns.py`: `line5`, epsilon x loss x seeds, with three metrics.",
        f"{host['processor']}, {host['cores']} cores, load at the start {host['load']:.1f}; other programs ran, too.",
        "",
        "| | runs | s per run, wall clock | s per run, processor | runs per hour |",
        "|---|---|---|---|---|",
        f"| `uav-cosim run`, one after the other, warm | {one['runs']:.0f} | {one['s_per_run']:.2f} | "
        f"{one['processor_s_per_run']:.2f} | {3600.0 / one['s_per_run']:,.0f} |",
        f"| `uav-cosim sweep`, {many['workers']} workers, with their start | {many['runs']} | "
        f"{many['s_per_run']:.3f} | {many['processor_s_per_run']:.3f} | {3600.0 / many['s_per_run']:,.0f} |",
        "",
        f"The campaign took {many['wall_s']:.0f} s: {ratio:.1f} times the rate of the loop.",
        END,
    ]
    head, rest = text.split(BEGIN)[0], text.split(END, 1)[1]
    file.write_text(head + "\n".join(lines) + rest, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--loop", type=int, default=5)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--until", default="60", help="simulated time of a run, s")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    host = machine("dask", "distributed")
    with tempfile.TemporaryDirectory() as made:
        one = loop(options.loop, options.until, Path(made))
        many = campaign(options.seeds, options.workers, options.until, Path(made))
    rows = [
        ("run, one after the other", f"{one['runs']}", f"{one['s_per_run']:.3f}", f"{one['processor_s_per_run']:.3f}"),
        ("sweep", f"{many['runs']}", f"{many['s_per_run']:.3f}", f"{many['processor_s_per_run']:.3f}"),
    ]
    note = f"The campaign: {many['wall_s']:.1f} s with the start of {many['workers']} workers, {many['digest'][:16]}"
    show("line5, 60 s", host, ("", "runs", "s per run", "processor s per run"), rows, note)
    write(options.json, host, {"benchmark": "campaigns", "loop": one, "campaign": many})
    if options.docs is not None:
        document(options.docs, host, one, many)


if __name__ == "__main__":
    main()
