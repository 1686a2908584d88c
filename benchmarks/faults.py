"""Provokes faults in every function of FMI that a run calls, and says what remains of the run and its recording.

    python -m benchmarks.faults [--json FILE]

FMUs of FMI 2 and of FMI 3 (with Clocks, events, Strings and Binaries) crash, overflow their stack, end their process,
do not return, or fill their memory, at the first call of each function that a run with checkpoints makes. Each time,

- named: the error names instance and function, and the exit code is 1; of a process that was killed or has called
  _exit(), `repair` names the last call; one that does not return is named before two signals end it;
- readable: the recording can be read, and its rows are the first ones of a run without faults; if the FMU is isolated,
  none is missing of the steps that all instances have made;
- clean: no process, descriptor or temporary folder remains, after the next run if the process was killed or has called
  _exit().

Faults in the process of the run happen in a process of their own, whose memory is limited. --only chooses faults.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import resource
import signal
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from benchmarks.report import machine, show, write
from cosim_master import RunOptions, simulate
from cosim_master.files import temporary
from cosim_master.fmi.description.read import platform
from cosim_master.fmi.isolation.child import Limits
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.results.reading.read import signals
from cosim_master.results.repair import repair
from tests.master.conftest import SUFFIX, Workshop
from tests.master.fmi.test_faults_of_functions import CLOCKS, FLAGS
from tests.master.fmi.test_isolation import SOURCE, Faulties, leftovers
from tests.master.fmus.clocked import clocked, description
from tests.master.fmus.faulting import faulting
from tests.master.fmus.strict3 import Stricts3

ISOLATED = ("segv", "overflow", "exit", "sleep", "memory")
HERE = ("segv", "overflow", "exit", "memory", "sleep", "_exit", "kill")
_ROOM = 256 << 20
"""Memory that a process of the run may fill, bytes."""
_PATIENCE = 120.0
LIMITS = Limits(seconds=0.5, memory=64 << 20)
PATIENT = Limits(memory=64 << 20)
CLOCKED = SOURCE.with_name("clocked.c")
COLUMNS = ("tried", "named", "readable", "clean")


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """The environment with some variables, for a time."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def with_faults(fmu: Path, source: Path, fmi: int, folder: Path) -> None:
    """Replaces the binary of an FMU by one whose functions fail as FAULT says."""
    with zipfile.ZipFile(fmu) as archive:
        text = archive.read("modelDescription.xml")
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{platform(fmi)}/Unit{SUFFIX[platform()]}", faulting(source, folder))


def systems(folder: Path) -> Mapping[int, Path]:
    """Systems of two FMUs by version of FMI; the functions of `bad` fail."""
    found = {}
    for fmi in (2, 3):
        (folder / str(fmi)).mkdir()
    two = Faulties(Workshop(folder / "2"), folder)
    found[2] = two.system("none none 0")
    with_faults(folder / "2" / "bad.fmu", SOURCE, 2, folder)
    log = folder / "complaints"
    three = Stricts3(Workshop(folder / "3"), folder, log, folder / "calls")
    clocked(three, "good.fmu", "go", "fire", flags=FLAGS)
    with zipfile.ZipFile(folder / "3" / "bad.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description(*CLOCKS, flags=FLAGS))
    with_faults(folder / "3" / "bad.fmu", CLOCKED, 3, folder)
    ports = "text_out:output bytes_out:output ticks_fire:output"
    parts = three.component("bad", "bad.fmu", ports=f"{ports} fire:output", rule=1, text_in="here")
    parts += three.component("good", "good.fmu", ports=f"{ports} go:input text_in:input bytes_in:input")
    found[3] = three.ssd(parts, "bad/fire good/go", "bad/text_out good/text_in", "bad/bytes_out good/bytes_in")
    return found


def recorded(folder: Path) -> Any:
    """The signals of a complete run."""
    return pq.read_table(io.BytesIO((folder / "signals.parquet").read_bytes()))


def try_isolated(system: Path, out: Path, fault: str, function: str, whole: Any) -> list[bool]:
    """Whether the error is named, the recording complete, and nothing left over."""
    before = leftovers()
    limits = LIMITS if fault == "sleep" else PATIENT
    with environment(FAULT=f"{fault} {function} 1"):
        options = RunOptions(out=out, isolation=Isolation("foreign", limits), checkpoint_every=1.0)
        result = simulate(system, options)
    clean = leftovers() <= before
    named = result.outcome == "failed" and bool(re.match(rf"bad: {function} failed", str(result.error)))
    if not (out / "signals.parquet").is_file():  # the FMU failed before the first row
        return [named, result.simulated_s == 0.0, clean]
    rows = recorded(out)
    steps = sum(time <= result.simulated_s + 1e-9 for time in whole["time"].to_pylist())
    complete = rows.equals(whole.slice(0, rows.num_rows)) and (rows.num_rows == steps or result.simulated_s == 0.0)
    return [named, complete, clean]


def try_here(system: Path, out: Path, fault: str, function: str, whole: Any) -> list[bool]:
    """The same for a fault in the process of the run, which is a process of its own."""
    before, said = leftovers(), out.with_suffix(".said")
    child = os.fork()
    if child == 0:
        with environment(FAULT=f"{fault} {function} 1"):
            os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT, 0o600), 2)
            if fault == "memory":
                used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                resource.setrlimit(resource.RLIMIT_AS, (used + _ROOM, used + _ROOM))
            simulate(system, RunOptions(out=out, isolation=Isolation("none", LIMITS), checkpoint_every=1.0))
        os._exit(0)
    if fault == "sleep":
        end_by_signals(child, said)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    named = is_named(fault, function, code, said.read_text(encoding="utf-8"), out)
    temporary.remove(temporary.made())  # as the next run does
    clean = leftovers() <= before
    try:
        rows = signals(out)
    except Exception:
        return [named, not (out / "manifest.json").is_file(), clean]
    times = rows["time"].to_pylist()
    return [named, times == whole["time"].to_pylist()[: len(times)], clean]


def end_by_signals(child: int, said: Path) -> None:
    """Sends two signals as soon as a process has said that an FMU does not return."""
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until and "has not returned" not in (said.read_text() if said.exists() else ""):
        time.sleep(0.05)
    for _ in range(2):
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGINT)
        time.sleep(0.3)


def is_named(fault: str, function: str, code: int, said: str, out: Path) -> bool:
    """Whether something says which function of `bad` was called."""
    if fault == "sleep":
        return code == -signal.SIGINT and bool(re.search(f"bad: {function} failed.*has not returned", said))
    if fault not in ("_exit", "kill"):
        return code == 1 and f"error: bad: {function} failed" in said
    if code != (3 if fault == "_exit" else -signal.SIGKILL) or not (out / "manifest.json").is_file():
        return False
    repair(out)
    error = json.loads((out / "manifest.json").read_text(encoding="utf-8"))["error"]
    return f"the last call of an FMU in it was {function} of bad" in str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--only", nargs="+", choices=sorted({*ISOLATED, *HERE}), default=[*ISOLATED, *HERE])
    options = parser.parse_args()
    ways = {
        "isolated": [fault for fault in ISOLATED if fault in options.only],
        "in the process of the run": [fault for fault in HERE if fault in options.only],
    }
    host, counts, failures = machine("ziglang"), Counter[tuple[str, str, str]](), []
    with tempfile.TemporaryDirectory(prefix="faults-") as temporary:
        folder = Path(temporary)
        (folder / "own").mkdir()
        tempfile.tempdir = str(folder / "own")
        os.environ |= {"STRICT3_LOG": str(folder / "complaints"), "STRICT3_CALLS": str(folder / "calls")}
        n = 0
        for fmi, system in systems(folder).items():
            calls = folder / f"functions{fmi}"
            with environment(FAULT="list", FAULT_CALLS=str(calls)):
                free = Isolation("foreign", Limits(restricted=False))
                options_of = RunOptions(out=folder / f"whole{fmi}", isolation=free, checkpoint_every=1.0)
                if simulate(system, options_of).outcome != "done":
                    raise RuntimeError("the run without faults failed")
            whole = recorded(folder / f"whole{fmi}")
            for function in sorted({*calls.read_text().split()}):
                for where, faults in ways.items():
                    for fault in faults:
                        n += 1
                        attempt = try_isolated if where == "isolated" else try_here
                        found = attempt(system, folder / f"out{n}", fault, function, whole)
                        for name, good in zip(COLUMNS, [True, *found], strict=False):
                            counts[where, fault, name] += int(good)
                        if not all(found):
                            lacking = dict(zip(COLUMNS[1:], found, strict=True))
                            failures.append(f"{where}: {fault} in {function}: {lacking}")
    cells = [
        [f"{where}: {fault}", *(str(counts.get((where, fault, name), "-")) for name in COLUMNS)]
        for where, faults in ways.items()
        for fault in faults
    ]
    show("Faults in every function that a run calls", host, ["", *COLUMNS], cells, "\n".join(failures))
    write(options.json, host, {"benchmark": "faults", "rows": cells, "failures": failures})


if __name__ == "__main__":
    main()
