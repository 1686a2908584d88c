"""What processes of FMUs cost: time per FMU step in the process of the run, with a process per file, and per instance.

    python benchmarks/isolation.py [--instances 1 10 100] [--fmus Relay Quadrotor] [--hosted] [--json FILE]

With processes, all instances begin their steps before the results of any are awaited. "in turn" is the same without.
With --hosted, the processes are also those of `uav-cosim serve`, over TCP of this machine (one process per file). The
bare round trip of one byte over TCP between two processes of Python is measured, too.

With --ecos, Ecos takes part too, in its process and with its proxyfmu (one process per instance). With --proxyfmu FILE,
libcosim does, in its process and with its proxyfmu (one process per instance), a program that no package has: it is
compiled from github.com/open-simulation-platform/proxy-fmu. Both read connected outputs only.

A ring of N instances of one compiled FMU, as in overhead.py, which counts as a foreign one because it does not list its
sources. A step sets the inputs, calls doStep and gets the outputs. All take turns in one run, and must compute
the same outputs bit by bit; figures are of the best turn of each, and medians.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Sequence
from contextlib import ExitStack, chdir
from importlib import import_module
from pathlib import Path
from secrets import token_urlsafe
from typing import Any, cast

from overhead import COMPARED, RINGS, STEP, Ecos, Libcosim, Ours, load_tbb, write_ring
from report import machine, show, write

from cosim.build import build, load_models
from cosim_master.fmi.isolation.child import TOKEN
from cosim_master.fmi.isolation.remote import Address
from cosim_master.fmi.slaves.isolated import Isolation, Scope

IN_TURN = ", in turn"
SCOPES = ["none", *(scope + turn for scope in ("foreign", "instance") for turn in ("", IN_TURN))]
STEPS = {scope: 200_000 if scope == "none" else 20_000 for scope in SCOPES}
"""Steps of FMUs in a turn."""


def foreign(fmu: Path, folder: Path) -> Path:
    """A copy of an FMU without the list of its sources."""
    folder.mkdir(exist_ok=True)
    copy = folder / fmu.name
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(copy, "w") as new:
        for name in old.namelist():
            if name != "resources/build.json":
                new.writestr(name, old.read(name))
    return copy


ECOS = ("Ecos", "Ecos, proxyfmu")
LIBCOSIM = ("libcosim", "libcosim, proxyfmu")
PROXYFMU = "of-libcosim"
"""The folder with libcosim's proxyfmu, in that of this program."""
OTHERS_STEPS = 2_000


class LibcosimProxied(Libcosim):
    """libcosim with its proxyfmu, which it looks for in the working directory. Ecos would take that one, too."""

    def __init__(self, ours: Ours, folder: Path) -> None:
        silent = import_module("libcosimpy.CosimLogging")
        silent.log_output_level(silent.CosimLogLevel.ERROR)
        fmu = ours.execution.slaves[0].library.fmu
        n = len(ours.execution.slaves)
        source = f"proxyfmu://localhost?file={os.path.relpath(fmu.path, folder)}"
        simulators = "".join(f'<Simulator name="n{i}" source="{source}" stepSize="{STEP}"/>' for i in range(n))
        connections = "".join(
            f'<VariableConnection><Variable simulator="n{i}" name="{source}"/>'
            f'<Variable simulator="n{(i + 1) % n}" name="{target}"/></VariableConnection>'
            for i in range(n)
            for source, target in RINGS[fmu.model_name][1]
        )
        structure = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
        (folder / "OspSystemStructure.xml").write_text(
            f'<OspSystemStructure xmlns="{structure}" version="0.1"><StartTime>0.0</StartTime>'
            f"<BaseStepSize>{STEP}</BaseStepSize><Algorithm>fixedStep</Algorithm><Simulators>{simulators}</Simulators>"
            f"<Connections>{connections}</Connections></OspSystemStructure>\n",
            encoding="utf-8",
        )
        cosim = import_module("libcosimpy.CosimExecution").CosimExecution
        with chdir(PROXYFMU):
            self._execution = cosim.from_osp_config_file(str(folder))


def offer_proxyfmu(folder: Path) -> None:
    """Puts the program of ecospy into PATH; its wheel has it without the permission to be executed."""
    binaries = Path(str(import_module("ecospy").__file__)).parent / "binaries"
    (folder / "bin").mkdir()
    shutil.copyfile(binaries / "proxyfmu", folder / "bin" / "proxyfmu")
    (folder / "bin" / "proxyfmu").chmod(0o755)
    os.environ["PATH"] = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"


HOSTED = ("hosted", f"hosted{IN_TURN}")


def served(stack: ExitStack) -> Address:
    """The address of a server in a process of its own, and its token in the environment."""
    os.environ[TOKEN] = token_urlsafe(24)
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "serve", "--port", "0"]
    process = stack.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
    stack.callback(process.terminate)
    assert process.stderr is not None
    found = re.search(r"127\.0\.0\.1:(\d+)", process.stderr.readline())
    if found is None:
        raise RuntimeError("the server did not start")
    return Address("127.0.0.1", int(found[1]))


def bare_round_trip(count: int = 20_000) -> float:
    """The best of three mean times of a round trip of one byte over TCP to another process, us."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        child = os.fork()
        if child == 0:
            other, _ = listening.accept()
            other.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := other.recv(1):
                other.send(data)
            os._exit(0)
        with socket.create_connection(listening.getsockname()) as one:
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            times = []
            for _ in range(3):
                began = time.perf_counter()
                for _ in range(count):
                    one.send(b"x")
                    one.recv(1)
                times.append(1e6 * (time.perf_counter() - began) / count)
        os.waitpid(child, 0)
    return min(times)


def measure(
    fmu: Path, n: int, rounds: int, scale: float, others: Sequence[str], *, host: Address | None = None
) -> dict[str, Any]:
    """The best and the median over `rounds` turns of the time per FMU step in us, for a ring of `n` instances."""
    steps = {scope: max(1, round(count * scale / n)) for scope, count in STEPS.items()}
    until = (rounds * max(steps.values()) + COMPARED) * STEP
    times: dict[str, list[float]] = {scope: [] for scope in SCOPES}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="uav-cosim-isolation-"))).resolve()
        write_ring(folder, fmu, n)
        runs = {}
        for scope in SCOPES:
            isolation = Isolation(cast(Scope, scope.removesuffix(IN_TURN)))
            runs[scope] = Ours(folder, until, stack, isolation)
            if scope.endswith(IN_TURN):
                runs[scope].execution.plan.ahead["begin"] = 0
        for name in HOSTED if host is not None else ():
            hosts = {one.name: host for one in runs["none"].execution.slaves if host is not None}
            runs[name] = Ours(folder, until, stack, Isolation("foreign", hosts=hosts, token=os.environ[TOKEN]))
            if name.endswith(IN_TURN):
                runs[name].execution.plan.ahead["begin"] = 0
            steps[name], times[name] = steps["foreign"], []
        for one in runs.values():
            one.run(COMPARED)
        if any(one.values() != runs["none"].values() for one in runs.values()):
            raise RuntimeError("the outputs of isolated FMUs are not those of the FMUs in this process")
        contenders: dict[str, Any] = dict(runs)
        for name in others:
            contenders[name] = contender(name, runs["none"], folder, stack)
            steps[name], times[name] = max(1, round(OTHERS_STEPS * scale / n)), []
        for _ in range(rounds):
            for name, one in contenders.items():
                times[name].append(1e6 * one.run(steps[name]) / (n * steps[name]))
    return {
        "fmu": fmu.stem,
        "instances": n,
        "us_per_fmu_step": {scope: min(measured) for scope, measured in times.items()},
        "median_us": {scope: statistics.median(measured) for scope, measured in times.items()},
    }


def contender(name: str, ours: Ours, folder: Path, stack: ExitStack) -> Any:
    """Another engine, with the same ring."""
    if name in ECOS:
        return Ecos(ours, stack, proxy=name != ECOS[0])
    return Libcosim(ours) if name == LIBCOSIM[0] else LibcosimProxied(ours, folder)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instances", type=int, nargs="+", default=[1, 10, 100], metavar="N")
    parser.add_argument("--fmus", nargs="+", choices=list(RINGS), default=list(RINGS))
    parser.add_argument("--rounds", type=int, default=15, help="turns of each")
    parser.add_argument("--scale", type=float, default=1.0, help="times the steps of a turn")
    parser.add_argument("--ecos", action="store_true", help="compare with Ecos and its proxy (ecospy)")
    parser.add_argument("--proxyfmu", type=Path, metavar="FILE", help="compare with libcosim and this proxy of it")
    parser.add_argument("--hosted", action="store_true", help="compare with processes behind TCP (uav-cosim serve)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    options.json = options.json and options.json.absolute()
    host, rows = machine("ziglang"), []
    others = (*(ECOS if options.ecos else ()), *(LIBCOSIM if options.proxyfmu else ()))
    more = (*(HOSTED if options.hosted else ()), *others)
    with ExitStack() as stack:
        temporary = stack.enter_context(tempfile.TemporaryDirectory(prefix="uav-cosim-isolation-"))
        folder = Path(temporary).resolve()
        place = served(stack) if options.hosted else None
        if options.ecos:
            load_tbb()
            offer_proxyfmu(folder)
        if options.proxyfmu:
            (folder / PROXYFMU).mkdir()
            shutil.copy(options.proxyfmu, folder / PROXYFMU / "proxyfmu")
        os.chdir(folder)  # programs of others write their logs there
        for name in options.fmus:
            (model,) = load_models(RINGS[name][0])
            fmu = foreign(build(model, folder).file, folder / "foreign")
            rows += [measure(fmu, n, options.rounds, options.scale, others, host=place) for n in options.instances]
    bare = f"a bare round trip over TCP: {bare_round_trip():.1f} us" if options.hosted else ""
    cells = []
    for row in rows:
        best, median = row["us_per_fmu_step"], row["median_us"]
        cells.append(
            [f"{row['fmu']} x {row['instances']}"]
            + [f"{best[scope]:.2f} ({median[scope]:.2f})" for scope in (*SCOPES, *more)]
            + [f"{best['foreign'] - best['none']:.2f}"]
        )
    columns = [
        "us per FMU step: best (median)",
        "in process",
        "a process per file",
        "in turn",
        "per instance",
        "in turn",
    ]
    columns += [*more, "added by one per file"]
    show("Cost of isolation: rings of compiled FMUs, no recording", host, columns, cells, bare)
    write(options.json, host, {"benchmark": "isolation", "rows": rows})


if __name__ == "__main__":
    main()
