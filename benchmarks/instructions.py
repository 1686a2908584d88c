"""Instructions per base step of the compiled loop, counted by valgrind: the cost of features that are off.

A count of instructions repeats to a few in a million on any machine, however busy. It counts the machine code of the
loop (exchange, radio, calls), and that of the FMUs, apart. Packets are not kept, as with `recording packets="false"`.

    python benchmarks/instructions.py [--than CHECKOUT ...] [--system line5] [--from 15] [--steps 2000] [--json FILE]

`--than` measures other checkouts of this project with their own systems and FMUs (`make fmus` there first). For
example, `git worktree add --detach ../before 8ce2a05^` is the last version whose radio had none of the optional
effects. Needs valgrind (Debian: valgrind). Takes a minute per checkout, the first time three.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def run_child(system: str, begin: float, steps: int, *, count: bool) -> None:
    """Steps the system to `begin` [s] and then `steps` base steps, which callgrind counts."""
    from cosim_master.execution.execution import Execution
    from cosim_master.stepping.layout import make_layout
    from cosim_master.system import shipped
    from cosim_master.system.flatten.check import check
    from cosim_master.system.reading.read import read_system
    from cosim_master.system.settings.network import network_of
    from cosim_master.system.settings.time_grid import time_grid

    with read_system(shipped.find(system) or system) as structure:
        checked = check(structure)
        network, clock = network_of(checked), time_grid(checked, begin + 10.0)
        layout = make_layout(checked, network, ("*.vehicle.position*",))
        given: dict[str, Any] = {"every": clock.steps, "keep_packets": False, "threads": 1}
        try:
            from cosim_master.execution.run.opening import Setup
        except ModuleNotFoundError:  # checkouts from before `Setup`
            execution = Execution(checked, clock, layout, network, **given)
        else:
            execution = Execution(checked, clock, layout, network, Setup(**given))
        with execution:
            first = round(begin * 1e9 / clock.base)
            execution.advance(first)
            _switch("on", count)
            execution.advance(first + steps)
            _switch("off", count)


def _switch(state: str, count: bool) -> None:
    if count:
        subprocess.run(["callgrind_control", "-i", state, str(os.getpid())], check=True, capture_output=True)


def measure(checkout: Path, system: str, begin: float, steps: int) -> dict[str, float]:
    """Instructions per base step in the loop and in the FMUs of a checkout."""
    folders = [checkout, checkout / "models", checkout / "master"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders)), "PYTHONHASHSEED": "0"}
    child = [sys.executable, __file__, "--child", system, "--from", str(begin), "--steps", str(steps)]
    subprocess.run(child, check=True, env=environment, cwd=checkout)  # compiles what is missing
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "counts"
        valgrind = ["valgrind", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={out}", "-q"]
        subprocess.run([*valgrind, *child, "--count"], check=True, env=environment, cwd=checkout, capture_output=True)
        files = [out, *sorted(out.parent.glob("counts.*"))]
        found = sum((by_object(file.read_text(encoding="utf-8")) for file in files if file.exists()), Counter[str]())
    fmus = sum(count for name, count in found.items() if "/binaries/" in name or "/objects/" in name)
    return {"loop": found["???"] / steps, "FMUs": fmus / steps, "all": sum(found.values()) / steps}


def by_object(text: str) -> Counter[str]:
    """Instructions by object file, of a file of callgrind; code made at run time is "???"."""
    names: dict[str, str] = {}
    found: Counter[str] = Counter()
    here, skip = "???", False
    for line in text.splitlines():
        if named := re.match(r"ob=\((\d+)\)(?: (.*))?$", line):
            here = names.setdefault(named[1], named[2] or "???")
        elif named := re.match(r"cob=\((\d+)\)(?: (.*))?$", line):
            names.setdefault(named[1], named[2] or "???")
        elif line.startswith("calls="):
            skip = True
        elif re.match(r"[+*\d-]", line):
            if not skip:
                found[here] += int([*line.split(), "0"][1])
            skip = False
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--than", type=Path, nargs="*", default=[], metavar="CHECKOUT")
    parser.add_argument("--system", default="line5")
    parser.add_argument("--from", type=float, default=15.0, dest="begin", help="simulated time, s")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--count", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child is not None:
        run_child(options.child, options.begin, options.steps, count=options.count)
        return
    if shutil.which("valgrind") is None:
        sys.exit("instructions.py needs valgrind; install it, on Debian: apt install valgrind")
    from report import machine, show, write

    checkouts = [ROOT, *(folder.resolve() for folder in options.than)]
    rows = [measure(folder, options.system, options.begin, options.steps) for folder in checkouts]
    cells = [
        [folder.name, *(f"{row[name]:.0f}" for name in row), f"{100.0 * (rows[0]['loop'] / row['loop'] - 1.0):+.2f} %"]
        for folder, row in zip(checkouts, rows, strict=True)
    ]
    host, note = (
        machine(),
        f"instructions per base step of {options.system}; last: the loop of {ROOT.name} beside this one",
    )
    show("Instructions", host, ["checkout", "loop", "FMUs", "all", "loop here"], cells, note)
    write(options.json, host, {"rows": dict(zip(map(str, checkouts), rows, strict=True))})


if __name__ == "__main__":
    main()
