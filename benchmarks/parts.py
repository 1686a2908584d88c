"""Runs in parts on this machine: what a window costs with each MPI library, and the speed of large swarms.

    windows  messages as those of a window, from each part to each, without stepping: wall-clock time of an exchange
    swarms   `uav-cosim run` of lines of drones in 1, 2 and 4 processes: start-up, speed, processor time of all

Open MPI is that of the environment. Another library is measured with `--mpi NAME=PREFIX`, where PREFIX contains
bin/mpiexec and lib/libmpi.so.12 (a virtual environment in which the package mpich is installed has both).

Each part has a section of its own in the document, which is written after each row: what is interrupted keeps its rows.

    python benchmarks/parts.py [--only windows|swarms] [--parts 1 2 4] [--drones 1000 2500] [--points 10000]
                               [--seconds 2] [--mpi mpich=VENV] [--docs FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from report import machine, section, show, write

from cosim_master.execution.partitions.mpi import MpiTransport
from cosim_master.stepping.warming import EVERY_RUN, IN_PARTS, compile_loop
from cosim_master.system.authoring.swarm.new import fleet_of, new_system

ROOT = Path(__file__).resolve().parents[1]
COMMAND = str(Path(sys.executable).with_name("uav-cosim"))
WINDOWS = 1000
SIZES = (300, 30_000)
"""Bytes of a message: of line5, and of 300 drones with positions of four base steps."""


def done(command: Sequence[str], environment: Mapping[str, str]) -> None:
    """Runs a command; one that fails ends the benchmark with its own messages."""
    ran = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit code {ran.returncode}\n{ran.stdout}{ran.stderr}")


# ---- windows: in the processes of a launcher ---------------------------------------------------------------------


def exchange(file: Path) -> None:
    """Exchanges messages as the parts of a run do; part 0 writes the median time for each size, us."""
    transport = MpiTransport(600.0)
    found = {}
    for size in SIZES:
        message, spans = bytes(size), []
        for _ in range(WINDOWS):
            began = time.perf_counter()
            for other in range(transport.parts):
                if other != transport.part:
                    transport.send(other, message)
            for other in range(transport.parts):
                if other != transport.part:
                    transport.receive(other)
            spans.append(time.perf_counter() - began)
        found[str(size)] = 1e6 * statistics.median(spans[WINDOWS // 10 :])
    if transport.part == 0:
        file.write_text(json.dumps(found))
    transport.close(abort=False)


def launchers(more: Sequence[str]) -> dict[str, tuple[list[str], dict[str, str]]]:
    """The command and the environment that start processes, by name of the library."""
    own = [str(Path(sys.executable).with_name("mpirun")), "--host", "localhost:64", "--bind-to", "none"]
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    found = {
        "Open MPI, shared memory, ULFM": ([*own, "--with-ft", "ulfm"], root),
        "Open MPI, shared memory": (own, root),
        "Open MPI, shared memory, --oversubscribe": ([own[0], "--oversubscribe", *own[3:]], root),
        "Open MPI, TCP on loopback": ([*own, "--mca", "btl", "self,tcp", "--mca", "pml", "ob1"], root),
    }
    for one in more:
        name, _, prefix = one.partition("=")
        libraries = {"MPI4PY_LIBMPI": str(Path(prefix, "lib", "libmpi.so.12").resolve())}
        found[name] = ([str(Path(prefix, "bin", "mpiexec"))], libraries)
    return found


def windows(parts: Sequence[int], more: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    rows = []
    for name, (launcher, environment) in launchers(more).items():
        for n in parts:
            file = folder / "windows.json"
            command = [*launcher, "-n", str(n), sys.executable, __file__, "--exchange", str(file)]
            done(command, environment)
            rows.append({"library": name, "parts": n, "us": json.loads(file.read_text())})
    return rows


# ---- swarms --------------------------------------------------------------------------------------------------------


def flown(system: Path, parts: int, seconds: float, out: Path) -> dict[str, float]:
    """One run: real time factor, start-up [s], and processor time of all processes [s]."""
    words = [COMMAND, "run", str(system), "--until", str(seconds), "--force", "-o", str(out)]
    words += ["--record", "*.vehicle.position*"]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done([*words, *(("--partitions", str(parts)) if parts > 1 else ())], {})
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    told: Mapping[str, Any] = json.loads((out / "manifest.json").read_text())
    return {
        "real_time_factor": told["real_time_factor"],
        "start_up_s": wall - told["wall_s"],
        "processor_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
    }


def swarms(
    drones: Sequence[int], fleet: dict[str, str], parts: Sequence[int], seconds: float, folder: Path
) -> Iterator[dict[str, Any]]:
    """Rows for swarms of these sizes; `fleet`: vehicle and autopilot, as `uav-cosim new` has them."""
    chosen = {part: fleet_of(text) for part, text in fleet.items()}
    for n in drones:
        made = folder / f"line{n}{''.join(fleet.values())}"
        system = new_system("line", n, made, fmus=ROOT / "fmus", until=seconds, fleet=chosen)
        for p in parts:
            load = os.getloadavg()[0]
            one = {"drones": n, "vehicle": fleet.get("vehicle", "Quadrotor"), "parts": p, "load": load}
            yield {**one, **flown(system, p, seconds, folder / "out")}


def document_windows(file: Path, host: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Replaces the section of windows in a document."""
    parts = sorted({one["parts"] for one in rows})
    lines = [
        "## Parts of a run",
        "",
        "`python benchmarks/parts.py`: the exchange of a window between all parts without stepping, median in us,",
        f"for messages of {SIZES[0]} / {SIZES[1]:,} bytes.",
        f"{host['processor']}, {host['cores']} cores, load at the start {host['load']:.1f}.",
        "",
        "| library | " + " | ".join(f"{n} parts" for n in parts) + " |",
        "|---" * (1 + len(parts)) + "|",
    ]
    for name in dict.fromkeys(one["library"] for one in rows):
        own = {one["parts"]: one["us"] for one in rows if one["library"] == name}
        cells = (" / ".join(f"{own[n][str(size)]:.0f}" for size in SIZES) for n in parts)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    section(file, "parts", "parts", lines)


def document_swarms(file: Path, host: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], seconds: float) -> None:
    """Replaces the section of swarms in a document."""
    lines = [
        "## Large swarms in one, two and four processes",
        "",
        f"`python benchmarks/parts.py`: lines of drones for the first {seconds:g} simulated seconds, positions and",
        f"packets recorded. {host['processor']}, {host['cores']} cores for all processes together. Processor time is",
        "that of all processes, with their start; load is that of the minute before.",
        "",
        "| drones | vehicle | processes | times real time | start-up, s | processor, s | load |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {one['drones']:,} | {one['vehicle']} | {one['parts']} | {one['real_time_factor']:.2f} | "
        f"{one['start_up_s']:.0f} | {one['processor_s']:.0f} | {one['load']:.1f} |"
        for one in rows
    ]
    section(file, "swarms in parts", "parts", lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--drones", type=int, nargs="*", default=[1000, 2500], help="quadrotors in a line")
    parser.add_argument("--points", type=int, nargs="*", default=[10_000], help="point masses in a line")
    parser.add_argument("--only", choices=("windows", "swarms"))
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--mpi", nargs="+", default=[], metavar="NAME=PREFIX")
    parser.add_argument("--docs", type=Path)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--exchange", type=Path, help=argparse.SUPPRESS)
    o = parser.parse_args(arguments)
    if o.exchange is not None:
        exchange(o.exchange)
        return
    host = machine("mpi4py", "openmpi")
    exchanged: list[dict[str, Any]] = []
    speeds: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as made:
        if o.only != "swarms":
            exchanged = windows([n for n in o.parts if n > 1], o.mpi, Path(made))
            if o.docs is not None:
                document_windows(o.docs, host, exchanged)
        if o.only != "windows":
            compile_loop((*EVERY_RUN, *IN_PARTS))  # so that no run compiles
        points = {"vehicle": "PointMass", "autopilot": "IdealAutopilot"}
        for sizes, fleet in () if o.only == "windows" else ((o.drones, {}), (o.points, points)):
            for row in swarms(sizes, fleet, o.parts, o.seconds, Path(made)):
                speeds.append(row)
                print(row, file=sys.stderr, flush=True)
                if o.docs is not None:
                    document_swarms(o.docs, host, speeds, o.seconds)
    if exchanged:
        cells = [
            [f"{one['library']}, {one['parts']} parts", *(f"{us:.0f}" for us in one["us"].values())]
            for one in exchanged
        ]
        show("A window's messages, us", host, ["", *(f"{size} B" for size in SIZES)], cells, "median; without stepping")
    if speeds:
        names = ("real_time_factor", "start_up_s", "processor_s", "load")
        cells = [
            [f"{one['drones']} {one['vehicle']} in {one['parts']}", *(f"{one[name]:.2f}" for name in names)]
            for one in speeds
        ]
        show("Swarms in parts", host, ["drones, processes", *names], cells, f"the first {o.seconds:g} s")
    write(o.json, host, {"benchmark": "parts", "windows": exchanged, "swarms": speeds})


if __name__ == "__main__":
    main()
