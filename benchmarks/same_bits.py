"""Whether a change of the code changes a bit of what is recorded: digests of every column, every packet, every log.

    python benchmarks/same_bits.py before.json                  before the change
    python benchmarks/same_bits.py after.json --than before.json    after it; exits 1 and names what differs
    python benchmarks/same_bits.py all.json --isolate all --than before.json    each FMU in a process of its own
    python benchmarks/same_bits.py none.json --isolate none --also fmus reference-fmus     other files, too
    python benchmarks/same_bits.py none.json --isolate none --only corpus                  other files only

Runs the shipped systems, one of them with other settings and a bad radio, with other masters, by steps of another size,
and one that goes on from a checkpoint. FMUs are those of the tree, as `make fmus` leaves them. `--also` and `--only`
name further systems (of all kinds that are read) and FMUs, or folders with them. An FMU runs alone; files with the same
bytes run once. Each file has a process of its own, which may crash. If a file is refused, its error stands for its
digests.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, get_args

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master import RunOptions, simulate
from cosim_master.diagnostics.errors import CosimError
from cosim_master.fmi.slaves.isolated import Isolation, Scope

SYSTEMS = Path(__file__).parents[1] / "master" / "systems"
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "line5": ("line5", {}),
    "ends": ("line5-ends", {}),
    "hexa": ("line5-hexa", {}),
    "estimated": ("line5-estimated", {"until": 40.0}),
    "script": ("line5-script", {"until": 5.0}),
    "bad radio": (
        "line5",
        {"seed": 7, "overrides": {"network.loss": "0.3", "network.jitter": "0.02", "drone3.agent.epsilon": "0.5"}},
    ),
    "two threads": ("line5", {"until": 20.0, "threads": 2}),
    "steps of 5 ms": ("line5", {"until": 20.0, "step": 0.005, "overrides": {"recording.interval": "0.01"}}),
    "changed": ("line5", {"until": 40.0, "at": [(20.0, "drone3.vehicle.wind[2]", "3")]}),
    "going on": ("line5", {"until": 30.0, "checkpoint_every": 10.0}),
    "rendezvous": ("rendezvous", {"until": 30.0}),
    "formation": ("formation", {"until": 30.0, "overrides": {"network.loss": "0.2"}}),
    "flocking": ("flocking", {"until": 20.0}),
    "coverage": ("coverage", {"until": 30.0}),
    "guarded": ("guarded", {"until": 30.0, "overrides": {"network.loss": "0.2"}}),
    "sweep": ("sweep", {"until": 30.0}),
    "tracking": ("tracking", {"until": 30.0}),
    "windy": ("windy", {"until": 50.0}),
    "follower": ("follower", {"until": 30.0, "overrides": {"network.jitter": "0.05"}}),
}


_SUFFIXES = (".fmu", ".ssp", ".ssd", ".msim", ".mm.json")
_OSP = "OspSystemStructure"
_SECONDS = 5.0
"""Simulated time of a file of `--also`, unless it begins later."""
_LIMIT = 300.0
"""Wall-clock time of such a file, s."""


def digests(folder: Path) -> dict[str, str]:
    """Of each column of the recorded tables and each log, by name."""
    found: dict[str, str] = {}
    for file in ("signals", "packets"):
        if not (folder / f"{file}.parquet").is_file():
            continue
        table = pq.read_table(folder / f"{file}.parquet")
        for name in table.column_names:
            column: pa.Array = table.column(name).combine_chunks()
            digest = hashlib.sha256(str(column.type).encode())
            for buffer in column.buffers():
                digest.update(b"" if buffer is None else buffer)
            found[f"{file}:{name}"] = digest.hexdigest()[:16]
    for path in sorted(folder.rglob("*.tlog")):
        found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return found


def files_in(places: Sequence[Path]) -> list[Path]:
    """The systems and FMUs among files and folders; not the FMUs of a folder that has an SSD."""
    found: dict[object, Path] = {}
    for place in places:
        within = sorted(file for file in place.rglob("*") if is_input(file)) if place.is_dir() else [place]
        of_systems = {file.parent for file in within if file.suffix == ".ssd"}
        for file in within:
            if file.suffix != ".fmu":
                found[file] = file
            elif file.parent not in of_systems:
                found.setdefault(hashlib.sha256(file.read_bytes()).digest(), file)
    return sorted(found.values())


def is_input(file: Path) -> bool:
    """Whether it is a system or an FMU."""
    osp = file.name.startswith(_OSP) and file.suffix == ".xml"
    return file.is_file() and (file.name.endswith(_SUFFIXES) or file.name == "mm.json" or osp)


def of_file(file: Path, out: Path, isolation: Isolation | None) -> dict[str, str]:
    """The digests of a file's run in a process of its own; how that has ended, if it gives none."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["cosim_master"])
    receiving, sending = processes.Pipe(duplex=False)
    process = processes.Process(target=tell_digests, args=(sending, file, out, isolation))
    process.start()
    sending.close()
    try:
        if receiving.poll(_LIMIT):
            return dict(receiving.recv())
        process.kill()
        return {"ended": f"not within {_LIMIT:g} s"}
    except EOFError:
        process.join()
        return {"ended": f"with exit code {process.exitcode}"}
    finally:
        process.join()


def tell_digests(sending: Connection, file: Path, out: Path, isolation: Isolation | None) -> None:
    """Runs a file and sends its digests."""
    sending.send(digests_of_file(file, out, isolation))


def digests_of_file(file: Path, out: Path, isolation: Isolation | None) -> dict[str, str]:
    """Of the run of a file; the error, if it is refused."""
    for options in ({"until": _SECONDS}, {}):
        try:
            result = simulate(file, RunOptions(out=out, isolation=isolation, **options))
        except CosimError as error:
            found = {"refused": str(error)}
            continue
        return {**digests(out), "outcome": str(result.outcome), "error": str(result.error)}
    return found


def of_cases(root: Path, isolation: Isolation | None) -> dict[str, dict[str, str]]:
    """The digests of the shipped systems, by the names of their cases."""
    found: dict[str, dict[str, str]] = {}
    for name, (system, options) in CASES.items():
        result = simulate(SYSTEMS / system, RunOptions(out=root / name, isolation=isolation, **options))
        found[name] = {**digests(root / name), "outcome": str(result.outcome)}
        print(f"{name}: {len(found[name])} digests", flush=True)
    resumed = root / "resumed"
    simulate(SYSTEMS / "line5", RunOptions(out=resumed, origin=f"{root / 'going on'}@10", isolation=isolation))
    found["going on"] |= {f"resumed {key}": value for key, value in digests(resumed).items()}
    return found


def all_digests(isolation: Isolation | None, files: Sequence[Path], *, shipped: bool) -> dict[str, dict[str, str]]:
    """Of the shipped systems and further files, by their names."""
    with tempfile.TemporaryDirectory(prefix="uav-cosim-bits-") as temporary:
        root = Path(temporary)
        found = of_cases(root, isolation) if shipped else {}
        for n, file in enumerate(files_in(files)):
            one = found[str(file)] = of_file(file, root / f"also{n}", isolation)
            print(f"{file}: {one.get('refused') or one.get('ended') or len(one)}", flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("file", type=Path, help="where to write the digests")
    parser.add_argument("--than", type=Path, help="digests to compare them with")
    parser.add_argument("--isolate", choices=get_args(Scope), help="as for run; default: as run chooses")
    parser.add_argument("--also", type=Path, nargs="*", default=[], metavar="FILE", help="systems, FMUs, folders")
    parser.add_argument("--only", type=Path, nargs="*", default=[], metavar="FILE", help="the same, and nothing else")
    given = parser.parse_args()
    isolation = None if given.isolate is None else Isolation(given.isolate)
    found = all_digests(isolation, [*given.also, *given.only], shipped=not given.only)
    given.file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if given.than is None:
        return 0
    before = json.loads(given.than.read_text(encoding="utf-8"))
    flat = [
        {(case, key): digest for case, all_ in one.items() for key, digest in all_.items()} for one in (before, found)
    ]
    differing = sorted(key for key in {*flat[0], *flat[1]} if flat[0].get(key) != flat[1].get(key))
    for case, key in differing[:20]:
        print(f"differs: {case}: {key}")
    ran = sum("outcome" in one for one in found.values())
    print(f"{len(found)} runs, {len(found) - ran} refused or ended; {len(flat[1])} digests, {len(differing)} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
