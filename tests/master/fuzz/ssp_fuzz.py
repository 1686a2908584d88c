"""Wrong input on purpose: systems of the conformance corpus, mutated, must give our own errors, each within a second.

    python -m tests.master.fuzz.ssp_fuzz [--inputs 100000] [--seed 1] [--keep FOLDER]

Mutations are of bytes, of the XML tree (elements removed, doubled, moved to other places and files, attributes set to
values that somebody will write one day) and of archives. Input number i of a seed is always the same; findings are
kept in a folder. Every input is read and checked; nothing is loaded.
"""

from __future__ import annotations

import argparse
import io
import random
import shutil
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from lxml import etree

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.fmi.description.read import FmuDescription, platform
from cosim_master.system.flatten import descriptions
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.structure import SystemStructure
from tests.master.conftest import SUFFIX, Workshop
from tests.master.system.flatten.test_conformance import CORPUS, FMUS, OF_FMI3, description

LIMIT = 1.0
"""Seconds of processor time that one input may take."""
VALUES = (
    *("", " ", "0", "-1", "1", "2", "1.0", "2.0", "9.9", "1e400", "-INF", "NaN", "2147483648", "-99999999999999999999"),
    *("true", "TRUE", "yes", "input", "output", "inout", "local", "constant", "unspecified", "structuralParameter"),
    *(
        "u",
        "y",
        "a",
        "b",
        "a.y",
        ".",
        "..",
        "a..b",
        "[1]",
        "in[1]",
        "in[1,2]",
        "é",
        "\u2028",
        "x" * 5000,
        "%s%n",
        "{0}",
    ),
    *("#", "#a", "#adder", "##", "?", "../x", "resources/../resources/probe.fmu", "resources/probe.fmu", "a.ssv", "."),
    *("file:///etc/passwd", "//host/x", "resources", "SystemStructure.ssd", "SystemStructure.ssd#x", "%2e%2e/x", "%00"),
    *(
        "application/x-ssp-definition",
        "application/x-ssp-package",
        "application/x-fmu-sharedlibrary",
        "text/x-modelica",
    ),
    *("1 2", "1 1 1 1", "0 0", "99999999999", "component", "SSD", "m", "K", "degC", "Level", "Speed", "high", "off"),
)
NAMES = ("MetaData", "Clock", "Float32", "Int8", "Dimension", "Annotations", "Connector", "Value", "nonsense")


def make_fmus(folder: Path) -> None:
    """FMUs as the corpus needs them, with an empty library: none is loaded."""
    folder.mkdir(parents=True)
    for name, options in FMUS.items():
        with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", description(Workshop(folder), **options))
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", b"")
    for name, (_, text) in OF_FMI3.items():
        with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", text)
            archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", b"")


@lru_cache(maxsize=1)
def seeds() -> tuple[dict[str, bytes], ...]:
    """The text files of every case of the corpus, by relative path."""
    found = []
    for case in sorted(CORPUS.glob("*/case.toml")):
        files = [path for path in case.parent.rglob("*") if path.is_file() and path != case]
        found.append({path.relative_to(case.parent).as_posix(): path.read_bytes() for path in files})
    return tuple(found)


def mutated_bytes(data: bytes, choose: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(choose.randint(1, 6)):
        at = choose.randrange(len(changed) + 1)
        kind = choose.randrange(4)
        if kind == 0 and at < len(changed):
            changed[at] = choose.randrange(256)
        elif kind == 1:
            del changed[at : at + choose.choice((1, 2, 30, 500))]
        elif kind == 2:
            changed[at:at] = choose.choice(
                (b"<", b">", b'"', b"&", b"\0", b"&#0;", b"<!--", b"]]>", b"<?x", b"\xff\xfe")
            )
        else:
            changed[at:at] = changed[at : at + choose.choice((5, 50, 500))]
    return bytes(changed)


def _tree(root: etree._Element, others: list[etree._Element], choose: random.Random) -> None:
    """One change to a tree."""
    elements = [element for element in root.iter() if isinstance(element.tag, str)]
    element = choose.choice(elements)
    kind = choose.randrange(9)
    parent = element.getparent()
    attributes = list(map(str, element.attrib))
    if kind <= 2 and attributes:
        known = [str(value) for item in elements for value in item.attrib.values()]
        value = choose.choice(VALUES) if choose.random() < 0.6 else choose.choice(known)
        try:
            element.set(choose.choice(attributes), value)
        except ValueError:
            element.set(choose.choice(attributes), "")
    elif kind == 3 and attributes:
        del element.attrib[choose.choice(attributes)]
    elif kind == 4 and attributes:
        element.set(
            choose.choice(("unit", "kind", "id", "source", "startIndices", "prefix", "type", "x")),
            choose.choice(VALUES[:20]),
        )
    elif kind == 5 and parent is not None:
        parent.remove(element)
    elif kind == 6 and parent is not None:
        parent.insert(choose.randrange(len(parent) + 1), etree.fromstring(etree.tostring(element, with_tail=False)))
    elif kind == 7:
        given = choose.choice([item for other in (root, *others) for item in other.iter() if isinstance(item.tag, str)])
        element.insert(choose.randrange(len(element) + 1), etree.fromstring(etree.tostring(given, with_tail=False)))
    elif kind == 8:
        names = [etree.QName(item).localname for item in elements]
        spaces = [etree.QName(item).namespace for item in elements]
        name = choose.choice(NAMES) if choose.random() < 0.3 else choose.choice(names)
        space = choose.choice(spaces)
        element.tag = f"{{{space}}}{name}" if space else name


def _trees(files: dict[str, bytes], choose: random.Random) -> dict[str, bytes]:
    roots = {name: etree.fromstring(data) for name, data in files.items()}
    extra = choose.choice(seeds())
    others = [etree.fromstring(data) for data in extra.values()]
    for _ in range(choose.choice((1, 1, 2, 4, 12))):
        name = choose.choice(sorted(roots))
        _tree(roots[name], [*roots.values(), *others], choose)
    return {name: etree.tostring(root, xml_declaration=True, encoding="utf-8") for name, root in roots.items()}


def _archive(files: dict[str, bytes], choose: random.Random) -> bytes:
    """An .ssp of the files, possibly with entries that nobody should unpack, possibly damaged."""
    buffer = io.BytesIO()
    warnings.filterwarnings("ignore", message="Duplicate name", category=UserWarning)
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data, zipfile.ZIP_DEFLATED if choose.random() < 0.5 else zipfile.ZIP_STORED)
        for _ in range(choose.choice((0, 0, 1, 3))):
            name = choose.choice(
                ("../x", "/x", "a\\b", "C:x", "a/../../x", "SystemStructure.ssd/x", "resources", "x" * 300)
            )
            entry = zipfile.ZipInfo(name)
            entry.external_attr = choose.choice((0, 0o120777 << 16, 0o100644 << 16, 0o040755 << 16))
            archive.writestr(entry, b"x")
    data = bytearray(buffer.getvalue())
    for _ in range(choose.choice((0, 0, 1, 4))):
        data[choose.randrange(len(data))] = choose.randrange(256)
    return bytes(data[: choose.randrange(len(data))]) if choose.random() < 0.05 else bytes(data)


def write_input(folder: Path, seed: int, number: int) -> Path:
    """Write input `number` into `folder` (which has resources/ with the FMUs); returns what to read."""
    choose = random.Random(f"{seed} {number}")
    files = dict(choose.choice(seeds()))
    kind = choose.random()
    if kind < 0.25:
        name = choose.choice(sorted(files))
        files[name] = mutated_bytes(files[name], choose)
    else:
        files = _trees(files, choose)
    if kind > 0.85:
        target = folder / "input.ssp"
        target.write_bytes(_archive(files, choose))
        return target
    for name, data in files.items():
        if name.split("/")[0].endswith((".ssp", ".fmu")) or ".ssp/" in name or ".fmu/" in name:
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    for top in {name.split(".ssp/")[0] + ".ssp" for name in files if ".ssp/" in name}:
        inside = {name[len(top) + 1 :]: data for name, data in files.items() if name.startswith(top + "/")}
        (folder / top).parent.mkdir(parents=True, exist_ok=True)
        (folder / top).write_bytes(_archive(inside, choose))
    return folder


@dataclass
class Finding:
    """What went wrong with one input."""

    number: int
    text: str


@contextmanager
def described_once() -> Any:
    """FMUs are described once per file; what is fuzzed are systems."""
    original: Callable[..., FmuDescription] = descriptions.describe
    known: dict[Any, FmuDescription] = {}

    def describe(
        path: Path, sizes: Mapping[str, int] | None = None, implementation: str = "any", runs: str = ""
    ) -> FmuDescription:
        if not path.is_file():
            return original(path, sizes, implementation, runs)
        key = path.resolve(), path.stat().st_size, tuple(sorted((sizes or {}).items())), implementation, runs
        if key not in known:
            known[key] = original(path, sizes, implementation, runs)
        return known[key]

    descriptions.describe = describe  # type: ignore[assignment]
    try:
        yield
    finally:
        descriptions.describe = original  # type: ignore[assignment]


def attempt(
    given: Path, number: int, read: Callable[[Path], SystemStructure] = read_system
) -> tuple[str, float, Finding | None]:
    """Read and check one input: how it ended, processor time, and what must not have happened."""
    began = time.process_time()
    outcome, finding = "accepted", None
    try:
        with read(given) as structure:
            check(structure)
    except SystemDescriptionError as error:
        outcome = "refused"
        if any(not problem.message.strip() for problem in error.problems):
            finding = Finding(number, "an empty problem")
        try:
            str(error).encode()
        except UnicodeEncodeError:
            finding = Finding(number, "a problem that cannot be printed")
    except Exception:
        outcome, finding = "crashed", Finding(number, traceback.format_exc()[-1500:])
    spent = time.process_time() - began
    if finding is None and spent > LIMIT:
        finding = Finding(number, f"took {spent:.2f} s")
    return outcome, spent, finding


def fuzz(inputs: int, seed: int, keep: Path | None = None, first: int = 0) -> tuple[Counter[str], float, list[Finding]]:
    """Try inputs; returns how they ended, the longest processor time, and the findings."""
    counts: Counter[str] = Counter()
    longest, findings = 0.0, []
    with tempfile.TemporaryDirectory(prefix="fuzz-") as root, described_once():
        fmus = Path(root) / "fmus"
        make_fmus(fmus)
        for number in range(first, first + inputs):
            folder = Path(root) / "work"
            folder.mkdir()
            (folder / "resources").mkdir()
            for fmu in fmus.iterdir():
                (folder / "resources" / fmu.name).symlink_to(fmu)
            given = write_input(folder, seed, number)
            outcome, spent, finding = attempt(given, number)
            counts[outcome] += 1
            longest = max(longest, spent)
            if finding is not None:
                findings.append(finding)
                if keep is not None:
                    shutil.copytree(folder, keep / str(number), dirs_exist_ok=True)
            shutil.rmtree(folder)
    return counts, longest, findings


def command(
    description: str | None, fuzz: Callable[[int, int, Path | None, int], tuple[Counter[str], float, list[Finding]]]
) -> None:
    """The command of a module that has a `fuzz`."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=None, help="folder for inputs with findings")
    words = parser.parse_args()
    began = time.perf_counter()
    counts, longest, findings = fuzz(words.inputs, words.seed, words.keep, words.first)
    shown = ", ".join(f"{count} {outcome}" for outcome, count in sorted(counts.items()))
    print(f"{words.inputs} inputs in {time.perf_counter() - began:.0f} s: {shown}; the slowest took {longest:.2f} s")
    for finding in findings[:20]:
        print(f"input {finding.number} of seed {words.seed}: {finding.text}")
    sys.exit(bool(findings))


if __name__ == "__main__":
    command(__doc__, fuzz)
