"""Drones against real time: swarms of 5 to 10,000, as `uav-cosim new` writes them, run by `uav-cosim run`.

Three FMUs per drone (vehicle and autopilot at 400 Hz), agents that exchange positions at 4 Hz over the radio, positions
recorded at 10 Hz, packets recorded. For each size two fresh processes:

    run      the whole command: start-up (from the command to the first step), peak memory, simulated per wall time
    phases   the same system on one thread without files: time per drone and base step in exchange, each FMU, packets,
             if all instances make each base step together

`--scenario` is one of

    line      six degrees of freedom, each hears its two neighbours
    flocking  the shipped system with its drones on a grid; each hears those within 20 m; no packets are recorded
    points    a line of point masses with ideal autopilots, of 80 Hz, agents as in line; no packets are recorded
    whole     a line of point masses in one FMU each, of 80 Hz; no packets are recorded

    python benchmarks/swarm.py [--scenario line] [--drones 5 50 500 1000 2500] [--seconds 20] [--step H] [--threads N]
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from report import machine, show, write
from timed.phases import timed_steps

from cosim_master.execution.execution import Execution
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.run.opening import Setup
from cosim_master.execution.simulate import simulate
from cosim_master.network.radio.build import grown
from cosim_master.results.recording.packet_log import PacketLog
from cosim_master.results.recording.signals import SignalRecorder
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.observation import Progress
from cosim_master.system.authoring.swarm.new import fleet_of, new_system
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid

ROOT = Path(__file__).resolve().parents[1]
RECORDED = ("*.vehicle.position*",)


class Scenario(NamedTuple):
    """How `new` writes a swarm, and what its runs set; `drones`: the default sizes."""

    name: str
    drones: Sequence[int]
    fleet: dict[str, str]
    overrides: dict[str, str]
    spacing: float = 10.0
    layout: str | None = None


SCENARIOS = {
    "line": Scenario("line", (5, 50, 500, 1000, 2500), {}, {}),
    "flocking": Scenario(
        "flocking", (5, 100, 1000), {}, {"network.range": "20", "recording.packets": "false"}, spacing=8.0
    ),
    "points": Scenario(
        "line",
        (1000, 10_000),
        {"vehicle": "PointMass", "autopilot": "IdealAutopilot"},
        {"recording.packets": "false"},
    ),
    "whole": Scenario("line5-points", (10_000, 50_000), {}, {"recording.packets": "false"}, layout="line"),
}
PHASE_SECONDS = 1.0
"""Simulated time over which phases are timed, after all drones have taken off."""
AIRBORNE = 12.0
"""Simulated time in s by which they have."""


# ---- in a process of its own: the whole command -------------------------------------------------------------------


def run_once(
    folder: Path, scenario: str, seconds: float, step: float | None, threads: int | None, began: float
) -> dict[str, Any]:
    """What `uav-cosim run FOLDER -o OUT --record '*.vehicle.position*'` does; `began` is when it was started."""
    gc.set_threshold(200_000, 20, 50)  # as the command does
    first: list[float] = []
    base_step = processor = 0.0
    recording = 0.0

    def prepared(ready: Prepared) -> None:
        nonlocal base_step
        base_step = ready.clock.seconds(1)

    def progress(seen: Progress) -> None:
        nonlocal processor
        if not first:
            processor = time.process_time()
            first.append(time.time() - seen.wall - began)

    def timed(method: Any) -> Any:
        def call(*arguments: Any, **options: Any) -> Any:
            nonlocal recording
            before = time.perf_counter()
            try:
                return method(*arguments, **options)
            finally:
                recording += time.perf_counter() - before

        return call

    SignalRecorder.rows = timed(SignalRecorder.rows)  # type: ignore[method-assign]
    PacketLog.packets = timed(PacketLog.packets)  # type: ignore[method-assign]
    with tempfile.TemporaryDirectory(prefix="uav-cosim-swarm-") as out:
        result = simulate(
            folder,
            RunOptions(
                out=Path(out),
                until=seconds,
                step=step,
                record=RECORDED,
                threads=threads,
                overrides=SCENARIOS[scenario].overrides,
            ),
            listener=Listener(prepared=prepared, progress=progress),
        )
        if result.outcome != "done":
            raise RuntimeError(f"{folder}: {result.outcome}: {result.error}")
        size = sum(file.stat().st_size for file in Path(out).rglob("*") if file.is_file())
    return {
        "base_step": base_step,
        "start_up_s": first[0],
        "processor_s": time.process_time() - processor,
        "wall_s": result.wall_s,
        "real_time_factor": result.real_time_factor,
        "recording_s": recording,
        "written_bytes": size,
        "packets": dict(result.packets),
    }


# ---- in a process of its own: time per phase ----------------------------------------------------------------------


def phases(folder: Path) -> dict[str, float]:
    """Time in us per drone and base step: exchange, packets, and each FMU by name.

    All instances make each base step together, as in small swarms, so that FMUs can be told apart: the command lets
    groups of large swarms make several on their own, which is faster.
    """
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
        clock = time_grid(checked, AIRBORNE + PHASE_SECONDS)
        layout = make_layout(checked, network, RECORDED)
        with Execution(checked, clock, layout, network, Setup(every=clock.steps, threads=1)) as execution:
            models = [instance.fmu.model_name for instance in checked.instances]
            names = list(dict.fromkeys(models))
            groups = [[i for i, model in enumerate(models) if model == name] for name in names]
            grouped = np.array([i for group in groups for i in group], dtype=np.int64)
            ends = np.cumsum([len(group) for group in groups])
            execution.advance(clock.steps - round(PHASE_SECONDS * 1e9 / clock.base))
            spent = np.zeros(2 + len(names) + 3, dtype=np.int64)
            plan = execution.plan._replace(groups=execution.plan.groups[:0])
            execution.state.radio = grown(execution.state.radio, 64 * len(network.nodes) * 16)
            # the first call compiles; the second is the one that counts
            before = execution.k
            for stop in (before, clock.steps - 1):
                if (reason := timed_steps(plan, execution.state.radio, stop, grouped, ends, spent)) != 0:
                    raise RuntimeError(f"the loop wants something ({reason}) in a timed step")
            per = 1e-3 / (clock.steps - 1 - before) / len(network.nodes)
            return dict(zip(("exchange", "packets", *names), (spent[:-3] * per).tolist(), strict=True))


# ---- the benchmark ------------------------------------------------------------------------------------------------


def child(*words: str) -> tuple[dict[str, Any], float]:
    """Run this file in a fresh process; returns the JSON it prints and its peak memory in MiB."""
    with subprocess.Popen([sys.executable, __file__, *words], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        text = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"swarm.py {' '.join(words)} ended with exit code {process.returncode}")
    return json.loads(text.splitlines()[-1]), usage.ru_maxrss / 1024


def measure(
    scenario: str, drones: int, seconds: float, step: float | None, threads: int | None, fmus: Path, folder: Path
) -> dict[str, Any]:
    """One row: the command, then, for a line, its phases."""
    chosen = SCENARIOS[scenario]
    system = new_system(
        chosen.name,
        drones,
        folder / f"{scenario}{drones}",
        fmus=fmus if chosen.name == "line" else None,
        fleet={part: fleet_of(text) for part, text in chosen.fleet.items()},
        layout=chosen.layout,
        spacing=chosen.spacing,
        until=max(seconds, AIRBORNE + PHASE_SECONDS),
    )
    words = ["--scenario", scenario, "--seconds", str(seconds)]
    words += [] if threads is None else ["--threads", str(threads)]
    words += [] if step is None else ["--step", str(step)]
    row, memory = child("--run", str(system), *words, "--began", repr(time.time()))
    parts, _ = child("--phases", str(system)) if scenario == "line" else ({}, 0.0)
    row |= {"drones": drones, "seconds": seconds, "peak_MiB": memory, "phases_us": parts}
    row["ms_per_drone_second"] = 1e3 * row["wall_s"] / seconds / drones
    row["processor_ms_per_drone_second"] = 1e3 * row["processor_s"] / seconds / drones
    return row


def _cells(row: dict[str, Any], names: Sequence[str]) -> list[str]:
    cells = [str(row["drones"]), f"{row['start_up_s']:.1f}", f"{row['peak_MiB']:.0f}", f"{row['real_time_factor']:.2f}"]
    cells += [f"{row['ms_per_drone_second']:.3f}", f"{row['processor_ms_per_drone_second']:.3f}"]
    cells += [f"{row['phases_us'][name]:.2f}" for name in names]
    return [*cells, f"{100 * row['recording_s'] / row['wall_s']:.1f} %"]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", choices=SCENARIOS, default="line")
    parser.add_argument("--drones", type=int, nargs="+", metavar="N", help="default: those of the scenario")
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated")
    parser.add_argument("--step", type=float, default=None, help="base step, s")
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--fmus", type=Path, default=ROOT / "fmus", help="folder that `uav-cosim build` has filled")
    parser.add_argument("--json", type=Path, metavar="FILE")
    for name in ("--run", "--phases"):
        parser.add_argument(name, type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--began", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.run is not None:
        given = options.run, options.scenario, options.seconds, options.step, options.threads, options.began
        print(json.dumps(run_once(*given)))
        return
    if options.phases is not None:
        print(json.dumps(phases(options.phases)))
        return
    host = machine("pyarrow")
    with tempfile.TemporaryDirectory(prefix="uav-cosim-swarm-") as temporary:
        fmus = options.fmus.resolve()
        sizes = options.drones or SCENARIOS[options.scenario].drones
        given = options.seconds, options.step, options.threads, fmus, Path(temporary)
        rows = [measure(options.scenario, n, *given) for n in sizes]
    names = list(rows[0]["phases_us"])
    columns = [
        "drones",
        "start-up s",
        "peak MiB",
        "x real time",
        "ms/drone s",
        "processor",
        *(f"{n} us" for n in names),
        "recording",
    ]
    note = (
        "x real time, ms per drone and simulated second, and the same in processor time (all threads, from the first "
        "step to the end; other programs hardly change it): the whole command, radio on, positions recorded at 10 Hz"
        f"{', all packets recorded' if options.scenario == 'line' else ''}. "
        "us: per drone and base step (400 Hz), one thread, no files. recording: of the wall time. "
        "The first start-up after a change of the sources compiles."
    )
    show(f"Drones against real time, {options.seconds:g} s", host, columns, [_cells(row, names) for row in rows], note)
    write(options.json, host, {"benchmark": "swarm", "threads": options.threads, "rows": rows})


if __name__ == "__main__":
    main()
