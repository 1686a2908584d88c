"""The conformance corpus: small systems in tests/data/ssp, each with literal values or literal problems.

A case is a folder with a case.toml: `section` and `rule` of the standard it stands for, and what must come out:

    values   outputs after the last step
    errors   all problems, without the path of the case; or none
    notes    parts of what must be said to the user
    strict   with values: all problems of the same case with --strict; [] for none
    pack     the folder is given as an .ssp;  variant, steps (default 3, of 0.5 s), end: of the run

Folders named *.ssp inside of a case are packed; folders named *.fmu hold what an FMU has besides a probe (probe.c);
three.fmu and sized.fmu (strict3.c), ticking.fmu and ticked.fmu (clocked.c) are of FMI 3. FMUs are put into resources/
of every package that has none of that name.
"""

from __future__ import annotations

import shutil
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import platform
from tests.master.conftest import SUFFIX, Workshop, variable
from tests.master.fmus import clocked, strict3
from tests.master.fmus.probe import LEVEL, compiled, probe_library

CORPUS = Path(__file__).parents[3] / "data/ssp"
CASES = sorted(path.parent.name for path in CORPUS.glob("*/case.toml"))
SPEED = LEVEL.replace("Level", "Speed").replace('"low" value="1"', '"fast" value="1"')
SPEED = SPEED.replace('"high" value="5"/>', '"slow" value="5"/><Item name="off" value="0"/>')
# What each FMU has that the probe has not.
FMUS: dict[str, dict[str, str]] = {
    "probe": {},
    "tuned": {},
    "kelvin": {"unit": "K"},
    "celsius": {"unit": "degC"},
    "second": {"unit": "s"},
    "km": {"unit": "km"},
    "speed": {"enumeration": "Speed"},
    "calculated": {"y": "calculatedParameter"},
    "local": {"y": "local"},
    "constant": {"m": "constant"},
}

SIZES = "".join(
    f'<UInt64 name="{name}" valueReference="{reference}" causality="structuralParameter" variability="fixed" '
    f'start="{n}"/>'
    for name, reference, n in (("n", 90, 2), ("other", 91, 3))
)
SIZES += '<Int32 name="two" valueReference="92" causality="local" variability="constant" start="2"/>'
OF_FMI3 = {
    "three": ("strict3.c", strict3.description()),
    "sized": (
        "strict3.c",
        strict3.description(extra=SIZES).replace('<Dimension start="2"/>', '<Dimension valueReference="90"/>'),
    ),
    "ticking": ("clocked.c", clocked.description("constant", "fire", period=0.25)),
    "ticked": ("clocked.c", clocked.description("go")),
}
"""FMUs of FMI 3, by name: source and description. The size of all arrays of "sized" is its structural parameter n."""


def description(
    workshop: Workshop, unit: str = "m", enumeration: str = "Level", y: str = "output", m: str = "output"
) -> str:
    constant = {"variability": "constant", "start": "1", "initial": "exact"} if m == "constant" else {}
    variables = [
        variable("u", unit=unit),
        variable("n", kind="Integer"),
        variable("b", kind="Boolean"),
        variable("s", kind="String"),
        variable("e", kind="Enumeration", declaredType=enumeration),
        variable("p", "parameter", unit=unit, start="0.25"),
        variable("mode", "parameter", kind="Integer"),
        variable("when", "parameter", unit="s"),
        variable("y", y, unit=unit, initial="calculated" if y == "local" else None),
        variable("m", "output", kind="Integer", **constant),
        variable("c", "output", kind="Boolean"),
        variable("r", "output", kind="String"),
        variable("f", "output", kind="Enumeration", declaredType=enumeration),
    ]
    outputs: dict[int, str | None] = {9: "1", 10: "2", 11: "3", 12: "4", 13: "5"}
    initial: dict[int, str | None] = {9: "1 6", 11: "3", 12: "4", 13: "5"}
    if m != "constant":
        initial[10] = "2"
    else:
        outputs[10] = ""
    if y != "output":
        del outputs[9]
    if y == "local":
        del initial[9]
    initial = dict(sorted(initial.items()))
    return workshop.description(variables, outputs=outputs, initial=initial, step=0.5, types=LEVEL + SPEED)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the FMUs of the corpus."""
    folder = tmp_path_factory.mktemp("fmus")
    library = probe_library(tmp_path_factory.getbasetemp())
    for name, options in FMUS.items():
        with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", description(Workshop(folder), **options))
            archive.writestr(f"binaries/{platform()}/Unit{SUFFIX[platform()]}", library)
    for name, (source, text) in OF_FMI3.items():
        library = compiled(Path(__file__).parents[2] / "fmus" / source, tmp_path_factory.getbasetemp())
        with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", text)
            archive.writestr(f"binaries/{platform(3)}/Unit{SUFFIX[platform()]}", library)
    return folder


def packed(folder: Path, target: Path) -> None:
    with zipfile.ZipFile(target, "w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(folder).as_posix())


def package(folder: Path, fmus: Path) -> None:
    """Make the folder of a package what a tool would have written: inner packages packed, FMUs in place."""
    for inner in sorted(folder.rglob("*.ssp"), reverse=True):
        if inner.is_dir():
            package(inner, fmus)
            moved = inner.rename(inner.with_suffix(".folder"))
            packed(moved, inner)
            shutil.rmtree(moved)
    (folder / "resources").mkdir(exist_ok=True)
    for fmu in fmus.iterdir():
        target = folder / "resources" / fmu.name
        extra = [path for path in target.rglob("*") if path.is_file()] if target.is_dir() else []
        members = {path.relative_to(target).as_posix(): path.read_bytes() for path in extra}
        shutil.rmtree(target, ignore_errors=True)
        shutil.copyfile(fmu, target)
        with zipfile.ZipFile(target, "a") as archive:
            for name, data in members.items():
                archive.writestr(name, data)
    for inner in [path for path in folder.rglob("*.ssd") if path.parent not in (folder, folder / "resources")]:
        if not (inner.parent / "resources").exists():
            shutil.copytree(folder / "resources", inner.parent / "resources")


def outcome(
    name: str, root: Path, fmus: Path, strict: bool = False
) -> tuple[dict[str, Any], dict[str, Any], list[str], list[str], float]:
    """A case's expectations, and what came out: values, problems, notes, and the end of the run."""
    folder = root / name
    shutil.copytree(CORPUS / name, folder)
    case = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    (folder / "case.toml").unlink()
    package(folder, fmus)
    given = folder
    if case.get("pack"):
        given = root / f"{name}.ssp"
        packed(folder, given)
    steps = case.get("steps", 3)
    until = 0.5 * steps if steps else None
    try:
        result = simulate(given, RunOptions(variant=case.get("variant"), out=root / "out", until=until, strict=strict))
    except SystemDescriptionError as error:
        return (
            case,
            {},
            [str(problem).replace(f"{given}/", "").replace(str(given), name) for problem in error.problems],
            [],
            0.0,
        )
    assert result.outcome == "done", result.error
    table = pq.read_table(root / "out/signals.parquet")
    values = {column: table[column][-1].as_py() for column in table.column_names}
    return case, values, [], list(result.notes), values["time"]


@pytest.mark.parametrize("name", CASES)
def test_case(name: str, tmp_path: Path, fmus: Path) -> None:
    case, values, errors, notes, end = outcome(name, tmp_path, fmus)
    assert errors == case.get("errors", [])
    for column, expected in case.get("values", {}).items():
        assert values[column] == (pytest.approx(expected, rel=1e-12) if isinstance(expected, float) else expected), (
            column
        )
    for text in case.get("notes", []):
        assert any(text in note for note in notes), notes
    if "end" in case:
        assert end == case["end"]


STRICT = [name for name in CASES if "strict =" in (CORPUS / name / "case.toml").read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", STRICT)
def test_case_taken_strictly(name: str, tmp_path: Path, fmus: Path) -> None:
    case, values, errors, _, _ = outcome(name, tmp_path, fmus, strict=True)
    assert errors == case["strict"]
    assert bool(values) != bool(errors)


def test_every_case_says_what_it_is_for() -> None:
    assert len(CASES) >= 40
    for name in CASES:
        case = tomllib.loads((CORPUS / name / "case.toml").read_text(encoding="utf-8"))
        assert case["section"].startswith(("SSP 1.0, section ", "SSP 2.0, section ")), name
        assert case["rule"], name
        assert bool(case.get("values")) != bool(case.get("errors")), name
