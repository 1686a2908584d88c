"""What processes of FMUs cost: time per FMU step in the process of the run, with a process per file, and per instance.

    python benchmarks/isolation.py [--instances 1 10 100] [--fmus Relay Quadrotor] [--json FILE]

With processes, all instances begin their steps before the results of any are awaited. "in turn" is the same without.
With --ecos, Ecos takes part too, in its process and with its proxyfmu (one process per instance); it reads connected
outputs only.

A ring of N instances of one compiled FMU, as in overhead.py, which counts as a foreign one because it does not list its
sources. A step sets the inputs, calls doStep and gets the outputs. All take turns in one run, and must compute
the same outputs bit by bit; figures are of the best turn of each, and medians.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import tempfile
import zipfile
from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from overhead import COMPARED, RINGS, STEP, Ecos, Ours, load_tbb, write_ring
from report import machine, show, write

from cosim.build import build, load_models
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
ECOS_STEPS = 2_000


def offer_proxyfmu(folder: Path) -> None:
    """Puts the program of ecospy into PATH; its wheel has it without the permission to be executed."""
    binaries = Path(str(import_module("ecospy").__file__)).parent / "binaries"
    (folder / "bin").mkdir()
    shutil.copyfile(binaries / "proxyfmu", folder / "bin" / "proxyfmu")
    (folder / "bin" / "proxyfmu").chmod(0o755)
    os.environ["PATH"] = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"


def measure(fmu: Path, n: int, rounds: int, scale: float, *, ecos: bool = False) -> dict[str, Any]:
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
        for one in runs.values():
            one.run(COMPARED)
        if any(one.values() != runs["none"].values() for one in runs.values()):
            raise RuntimeError("the outputs of isolated FMUs are not those of the FMUs in this process")
        contenders: dict[str, Any] = dict(runs)
        for name in ECOS if ecos else ():
            contenders[name] = Ecos(runs["none"], stack, proxy=name != "Ecos")
            steps[name], times[name] = max(1, round(ECOS_STEPS * scale / n)), []
        for _ in range(rounds):
            for name, one in contenders.items():
                times[name].append(1e6 * one.run(steps[name]) / (n * steps[name]))
    return {
        "fmu": fmu.stem,
        "instances": n,
        "us_per_fmu_step": {scope: min(measured) for scope, measured in times.items()},
        "median_us": {scope: statistics.median(measured) for scope, measured in times.items()},
    }


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instances", type=int, nargs="+", default=[1, 10, 100], metavar="N")
    parser.add_argument("--fmus", nargs="+", choices=list(RINGS), default=list(RINGS))
    parser.add_argument("--rounds", type=int, default=15, help="turns of each")
    parser.add_argument("--scale", type=float, default=1.0, help="times the steps of a turn")
    parser.add_argument("--ecos", action="store_true", help="compare with Ecos and its proxy (ecospy)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    options.json = options.json and options.json.absolute()
    host, rows = machine("ziglang"), []
    with tempfile.TemporaryDirectory(prefix="uav-cosim-isolation-") as temporary:
        folder = Path(temporary).resolve()
        if options.ecos:
            load_tbb()
            offer_proxyfmu(folder)
            os.chdir(folder)  # proxyfmu writes its logs there
        for name in options.fmus:
            (model,) = load_models(RINGS[name][0])
            fmu = foreign(build(model, folder).file, folder / "foreign")
            rows += [measure(fmu, n, options.rounds, options.scale, ecos=options.ecos) for n in options.instances]
    cells = []
    for row in rows:
        best, median = row["us_per_fmu_step"], row["median_us"]
        cells.append(
            [f"{row['fmu']} x {row['instances']}"]
            + [f"{best[scope]:.2f} ({median[scope]:.2f})" for scope in (*SCOPES, *(ECOS if options.ecos else ()))]
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
    columns += [*(ECOS if options.ecos else ()), "added by one per file"]
    show("Cost of isolation: rings of compiled FMUs, no recording", host, columns, cells, "")
    write(options.json, host, {"benchmark": "isolation", "rows": rows})


if __name__ == "__main__":
    main()
