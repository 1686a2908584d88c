"""Wrong files on purpose: FMUs, models' dialects, checkpoints, results of runs and keys, mutated, give our own errors.

    python -m tests.master.fuzz.file_fuzz [--inputs 100000] [--seed 1] [--keep FOLDER]

    description   modelDescription.xml of FMI 2 and 3 (bytes, tree), read by `describe`, `info` and `check`
    fmu           the archive around it (names that nobody should unpack, links, damaged bytes), unpacked as for a run
    system        systems of the conformance corpus, as `ssp_fuzz` mutates them
    dialect       MAVLink XML: the generated module must define functions and numbers only
    checkpoint    checkpoint.json, its arrays and its recording: `run --from` of the run of a shipped system
    results       manifest.json, Parquet files, journals: `signals`, `packets`, and what verbs read of them
    key           files with the key of a gateway

Limits for each input: no exception but our own errors, no more than 10 s of processor time, no more than 1 GiB more
memory, and no file outside of its folder. Inputs run in forked processes, 250 in each, whose end is a finding, too.
Input number i of a seed is always the same; findings are kept in a folder.
"""

from __future__ import annotations

import ast
import io
import json
import mmap
import os
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from cosim.build.dialects import module_source, read_xml
from cosim_master import RunOptions, simulate
from cosim_master.cli.views.overview import overview, overview_tables, signal_table
from cosim_master.diagnostics.errors import CosimError
from cosim_master.fmi.description.datasheet import datasheet, findings
from cosim_master.fmi.description.read import describe, extract, platform
from cosim_master.network.gateways.signing import read_key
from cosim_master.report.contents import read_run
from cosim_master.results.reading.comparison import compare
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.repair import repair
from cosim_master.results.storage.checkpoint_folder import sealed
from cosim_master.results.storage.journal import Journal
from cosim_master.view.replay import replay
from tests.master.conftest import SUFFIX, Workshop
from tests.master.fuzz import ssp_fuzz
from tests.master.fuzz.multimodel_fuzz import _places, _value
from tests.master.fuzz.ssp_fuzz import Finding, command, make_fmus, mutated_bytes
from tests.master.system.flatten.test_conformance import FMUS, OF_FMI3
from tests.master.system.flatten.test_conformance import description as described

SECONDS, MEMORY = 10, 1 << 30
"""Limits of one input: processor time, and memory beyond that of the process before it."""
BATCH = 250
SYSTEM = Path(__file__).parents[3] / "master" / "systems" / "line5"
DIALECT = """<?xml version="1.0"?>
<mavlink>
  <include>common.xml</include>
  <enums><enum name="SWARM_STATE"><entry value="0" name="SWARM_STATE_IDLE"/></enum></enums>
  <messages>
    <message id="24150" name="SWARM_HELLO">
      <description>One of a swarm.</description>
      <field type="uint64_t" name="time_usec" units="us">time</field>
      <field type="float[4]" name="q">attitude</field>
      <field type="char[16]" name="label">name</field>
      <field type="uint8_t_mavlink_version" name="version">version</field>
      <extensions/>
      <field type="int16_t" name="more" units="cm/s">more</field>
    </message>
    <message id="24151" name="SWARM_BID"><field type="double" name="bid" units="m">bid</field></message>
  </messages>
</mavlink>
"""
NAMES = ("", "x", "class", "import os", "__import__", "a b", "\u2028", "x" * 400, "q", "SWARM_BID", "é", "1a", "a;b")
KINDS = ("description", "fmu", "system", "dialect", "checkpoint", "results", "key")
SHARES = (300, 200, 200, 200, 10, 60, 30)


class TooLong(BaseException):
    """An input has used up its processor time."""


@cache
def descriptions() -> tuple[str, ...]:
    """Model descriptions of FMI 2 and 3."""
    of_fmi2 = [described(Workshop(Path()), **options) for options in FMUS.values()]
    return (*of_fmi2, *(text for _, text in OF_FMI3.values()))


def mutated_xml(text: bytes, choose: random.Random) -> bytes:
    """An XML text with changes of its bytes, or of its tree."""
    if choose.random() < 0.3:
        return mutated_bytes(text, choose)
    return ssp_fuzz._trees({"x": text}, choose)["x"]


def mutated_json(content: Any, choose: random.Random) -> bytes:
    """A JSON text with changes of its bytes, or of its tree."""
    for _ in range(choose.choice((1, 1, 2, 5))):
        places = _places(content)
        holder, key = choose.choice(places)
        kind = choose.randrange(4)
        if kind == 0:
            del holder[key]
        elif kind == 1:
            other, source = choose.choice(places)
            holder[key] = json.loads(json.dumps(other[source])) if isinstance(other, dict) else _value(choose)
        else:
            holder[key] = _value(choose)
    text = json.dumps(content).encode("utf-8", "surrogatepass")
    return mutated_bytes(text, choose) if choose.random() < 0.2 else text


def mutated_arrays(data: bytes, choose: random.Random) -> bytes:
    """An archive of arrays, some of other shapes, types and contents, or with damaged bytes."""
    if choose.random() < 0.4:
        return mutated_bytes(data, choose)
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files}
    for _ in range(choose.choice((1, 1, 3))):
        name = choose.choice(sorted(arrays))
        array, kind = arrays[name], choose.randrange(6)
        if kind == 0:
            del arrays[name]
        elif kind == 1:
            arrays[name] = array.ravel()[: choose.randrange(array.size + 1)]
        elif kind == 2:
            arrays[name] = np.full(array.shape, choose.choice((-1, 0, 2**62, 3)), np.int64)
        elif kind == 3:
            arrays[name] = np.array([[1.5, float("nan")]])
        elif kind == 4:
            arrays[name] = np.array(["text"])
        elif array.dtype.kind in "iuf":
            flat = array.copy().ravel()
            for _ in range(min(flat.size, 5)):
                flat[choose.randrange(flat.size)] = choose.choice((0, 1, 100))
            arrays[name] = flat.reshape(array.shape)
        if not arrays:
            break
    made = io.BytesIO()
    np.savez(made, **arrays)  # type: ignore[arg-type]
    content = made.getvalue()
    return content.replace(b"'descr': '<f8'", b"'descr': '|O' ") if choose.random() < 0.1 else content


def archive(folder: Path, choose: random.Random, text: bytes) -> Path:
    """An FMU with a library of zero bytes."""
    file = folder / "input.fmu"
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", text)
        for version in (2, 3):
            made.writestr(f"binaries/{platform(version)}/Unit{SUFFIX[platform()]}", b"")
    return file


# ---- one input of each kind: written into its folder, then read ------------------------------------------------------


def try_description(folder: Path, choose: random.Random) -> None:
    fmu = archive(folder, choose, mutated_xml(choose.choice(descriptions()).encode(), choose))
    describe(fmu)
    datasheet(fmu)
    findings(fmu)


def try_fmu(folder: Path, choose: random.Random) -> None:
    fmu = folder / "input.fmu"
    files = {"modelDescription.xml": choose.choice(descriptions()).encode(), "resources/a.txt": b"x"}
    files |= {f"binaries/{platform(version)}/Unit{SUFFIX[platform()]}": b"" for version in (2, 3)}
    if choose.random() < 0.3:
        files["terminalsAndIcons/terminalsAndIcons.xml"] = mutated_bytes(b"<fmiTerminalsAndIcons/>", choose)
    fmu.write_bytes(ssp_fuzz._archive(files, choose))
    description = describe(fmu)
    extract(description, folder / "unpacked")


def try_system(folder: Path, choose: random.Random) -> None:
    (folder / "resources").mkdir()
    for fmu in _fmus().iterdir():
        (folder / "resources" / fmu.name).symlink_to(fmu)
    _, _, finding = ssp_fuzz.attempt(ssp_fuzz.write_input(folder, 7, choose.randrange(2**40)), 0)
    if finding is not None and not finding.text.startswith("took "):
        raise AssertionError(finding.text)


def try_dialect(folder: Path, choose: random.Random) -> None:
    text = DIALECT
    for _ in range(choose.choice((0, 1, 2))):
        label = choose.choice(("SWARM_HELLO", "time_usec", "label", "us", "cm/s", "24150", "float[4]"))
        value = choose.choice((*NAMES, "ms]&#10;import os; os.abort()", '"""&#10;import os', "&quot;", "&#27;[31m"))
        text = text.replace(label, value)
    data = text.encode()
    if choose.random() < 0.5:
        data = mutated_bytes(data, choose)
    elif choose.random() < 0.1:
        bomb = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
        bomb += "".join(f'<!ENTITY {one} "{f"&{before};" * 10}">' for before, one in pairwise("abcdefghij"))
        data = text.replace("<mavlink>", bomb + "]><mavlink>").replace(">bid<", ">&j;<").encode()
    (folder / "swarm.xml").write_bytes(data)
    try:
        messages = read_xml(folder / "swarm.xml")
    except ValueError:
        return
    module = ast.parse(module_source(messages, "swarm.xml"))
    for node in ast.walk(module):
        if isinstance(node, ast.Import) and [name.name for name in node.names] != ["numpy"]:
            raise AssertionError(f"the module imports {ast.dump(node)}")
        if isinstance(node, ast.ImportFrom) and node.module not in _MODULES:
            raise AssertionError(f"the module imports {ast.dump(node)}")
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("eval", "exec", "__import__"):
            raise AssertionError(ast.dump(node))


_MODULES = ("__future__", "collections.abc", "typing", "numpy.typing", "cosim.kernel", "cosim.fields", "cosim.packets")


def try_checkpoint(folder: Path, choose: random.Random) -> None:
    run = folder / "run"
    shutil.copytree(_run(), run)
    own = run / "checkpoints" / "0.2"
    kind = choose.random()
    if kind < 0.9:  # most are refused when it is read
        file = own / "checkpoint.json"
        file.write_bytes(mutated_json(json.loads(file.read_text()), choose))
    if kind > 0.8:
        file = choose.choice((own / "state.npz", own / "state.npz", own / "signals.parquet"))
        mutate = mutated_arrays if file.suffix == ".npz" else mutated_bytes
        file.write_bytes(mutate(file.read_bytes(), choose))
        if kind > 0.9 and file.name == "state.npz":  # with the digest that it should have
            content = json.loads((own / "checkpoint.json").read_text())
            del content["digest"], content["files"]
            (own / "checkpoint.json").unlink()
            (own / "checkpoint.json").write_text(json.dumps(sealed(own, content)))
    result = simulate(SYSTEM, RunOptions(origin=f"{run}@0.2", until=0.3, threads=1, out=folder / "out"))
    assert result.outcome in ("done", "failed")


def try_results(folder: Path, choose: random.Random) -> None:
    run = folder / "run"
    shutil.copytree(_killed() if choose.random() < 0.5 else _run(), run)
    shutil.rmtree(run / "checkpoints", ignore_errors=True)
    for _ in range(choose.choice((1, 1, 2))):
        tables = (*run.glob("*.parquet"), *run.glob("unfinished/*.arrows"))
        file = choose.choice([path for path in sorted(tables) if path.stat().st_size] or [run / "manifest.json"])
        if file.name == "manifest.json" or choose.random() < 0.4:
            file = run / "manifest.json"
            file.write_bytes(mutated_json(json.loads((_run() / "manifest.json").read_text()), choose))
        else:
            file.write_bytes(mutated_bytes(file.read_bytes(), choose))

    def shown() -> None:
        document = overview(run)
        list(overview_tables(document)), list(signal_table(document))

    readers: tuple[Callable[[], object], ...] = (
        lambda: signals(run).to_pydict(),
        lambda: packets(run).to_pydict(),
        shown,
        lambda: compare(run, _run()),
        lambda: repair(run),
        lambda: replay(run),
        lambda: read_run(run),
    )
    for read in choose.sample(readers, 3):
        try:
            read()
        except CosimError:
            continue


def try_key(folder: Path, choose: random.Random) -> None:
    size = choose.choice((0, 1, 31, 32, 33, 64, 65, 70, 10_000))
    digits = "".join(choose.choices("0123456789abcdefABCDEF xyz\0é", k=size)).encode()
    (folder / "key").write_bytes(choose.choice((choose.randbytes(size), digits, digits[:64] + b"\n")))
    try:
        assert len(read_key(folder / "key")) == 32
    except ValueError as error:
        assert "64 hexadecimal digits" in str(error)


# ---- originals -------------------------------------------------------------------------------------------------------

_ORIGINALS: dict[str, Path] = {}


def _fmus() -> Path:
    return _ORIGINALS["fmus"]


def _run() -> Path:
    return _ORIGINALS["run"]


def _killed() -> Path:
    return _ORIGINALS["killed"]


def make_originals(folder: Path, kinds: tuple[str, ...]) -> None:
    """Makes the FMUs and the runs of which inputs are mutations."""
    make_fmus(folder / "fmus")
    _ORIGINALS["fmus"] = folder / "fmus"
    if not {"checkpoint", "results"} & {*kinds}:
        return
    options = RunOptions(until=0.3, threads=1, checkpoint_every=0.2, out=folder / "run")
    result = simulate(SYSTEM, options)
    assert result.outcome == "done", result.error
    _ORIGINALS["run"], _ORIGINALS["killed"] = folder / "run", folder / "killed"
    child = os.fork()
    if child == 0:  # is killed by itself before its recording is complete
        Journal.close = lambda _: os.kill(os.getpid(), signal.SIGKILL)  # type: ignore[method-assign]
        simulate(SYSTEM, RunOptions(until=0.3, threads=1, out=folder / "killed"))
        os._exit(0)
    os.waitpid(child, 0)
    assert (folder / "killed" / "unfinished").is_dir()


# ---- the runs of inputs ----------------------------------------------------------------------------------------------


def _too_long(_number: int, _frame: FrameType | None) -> None:
    raise TooLong(f"more than {SECONDS} s of processor time")


def attempt(root: Path, kind: str, seed: int, number: int) -> tuple[str, str]:
    """Tries one input in root/work; returns how it ended and what must not have happened."""
    folder, choose = root / "work", random.Random(f"{seed} {number}")
    folder.mkdir()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcome, text = "accepted", ""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        globals()[f"try_{kind}"](folder, choose)
    except CosimError as error:
        outcome = "refused"
        if not str(error).strip():
            text = "an empty message"
    except (Exception, TooLong):
        outcome, text = "crashed", traceback.format_exc()[-1500:]
    signal.setitimer(signal.ITIMER_PROF, 0)
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
    if not text and more > MEMORY:
        text = f"{more >> 20} MiB of memory"
    outside = sorted(path.name for place in (root, root / "home", root / "tmp") for path in place.iterdir())
    if outside != ["home", "tmp", "work"]:
        text = text or f"files outside of its folder: {outside}"
    return f"{kind}: {outcome}", text


def _batch(root: Path, todo: range, seed: int, kinds: tuple[str, ...], shared: mmap.mmap, results: Path) -> None:
    """Tries inputs in this forked process, and announces the number of each in shared memory."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    for name in ("home", "tmp"):
        (root / name).mkdir()
    os.chdir(root / "home")
    tempfile.tempdir = str(root / "tmp")
    signal.signal(signal.SIGPROF, _too_long)
    found = []
    for number in todo:
        shared[:8] = struct.pack("q", number)
        kind = random.Random(f"kind {seed} {number}").choices(
            kinds, [share for name, share in zip(KINDS, SHARES, strict=True) if name in kinds]
        )[0]
        began = time.process_time()
        outcome, text = attempt(root, kind, seed, number)
        found.append((number, outcome, text, time.process_time() - began))
        if text and (keep := os.environ.get("FUZZ_KEEP")):
            shutil.copytree(root / "work", Path(keep) / str(number), dirs_exist_ok=True, symlinks=True)
        shutil.rmtree(root / "work", ignore_errors=True)
    results.write_text(json.dumps(found))


def fuzz(
    inputs: int, seed: int, keep: Path | None = None, first: int = 0, kinds: tuple[str, ...] = KINDS
) -> tuple[Counter[str], float, list[Finding]]:
    """Tries inputs; returns how they ended, the longest processor time, and the findings."""
    counts: Counter[str] = Counter()
    longest, found = 0.0, []
    if keep is not None:
        os.environ["FUZZ_KEEP"] = str(keep.absolute())
    shared = mmap.mmap(-1, 4096)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
        make_originals(Path(place), kinds)
        at = first
        while at < first + inputs:
            todo = range(at, min(at + BATCH, first + inputs))
            root, results = Path(place) / "root", Path(place) / "results.json"
            shutil.rmtree(root, ignore_errors=True)
            results.unlink(missing_ok=True)
            root.mkdir()
            sys.stdout.flush()
            child = os.fork()
            if child == 0:
                status = 1
                try:
                    _batch(root, todo, seed, kinds, shared, results)
                    status = 0
                finally:
                    os._exit(status)
            _, status = os.waitpid(child, 0)
            done = json.loads(results.read_text()) if results.is_file() else []
            for number, outcome, text, spent in done:
                counts[outcome] += 1
                longest = max(longest, spent)
                if text:
                    found.append(Finding(number, text))
            at = todo.stop
            if not done:
                (number,) = struct.unpack("q", shared[:8])
                found.append(Finding(number, f"its process has ended: {os.waitstatus_to_exitcode(status)}"))
                counts["ended the process"] += 1
                at = number + 1
    return counts, longest, found


if __name__ == "__main__":
    command(__doc__, fuzz)
