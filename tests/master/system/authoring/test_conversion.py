"""Systems written for other engines: read back by us, and run by the engine where it is installed."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from lxml import etree

from cosim_master.diagnostics.errors import SystemDescriptionError, WriteFailed
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import ENGINES, convert
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from tests.master.full_disk import room_of
from tests.master.system.reading.test_osp import _LIBCOSIM, needs_libcosim

pytestmark = pytest.mark.usefixtures("own_cache")
_ECOS = """
import ctypes, os, sys
ctypes.CDLL(sys.prefix + "/lib/libtbb.so.12", mode=ctypes.RTLD_GLOBAL)  # where the loader does not look
from ecospy import EcosSimulation
path, steps, *names = sys.argv[1:]
with EcosSimulation(ssp_path=path, step_size=0.25) as simulation:
    simulation.init(parameter_set="initialValues")
    for _ in range(int(steps)):
        simulation.step(1)
        print("ROW", *(repr(simulation.get_real(name)) for name in names), flush=True)
    os._exit(0)
"""
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"


def signals(system: Path, out: Path, until: float = 3.0) -> dict[str, list[Any]]:
    result = simulate(system, RunOptions(out=out, until=until))
    assert result.outcome == "done", result.error
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def zipped(folder: Path) -> Path:
    """The folder as an .ssp beside it."""
    path = folder.with_suffix(".ssp")
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder).as_posix())
    return path


def run_by(program: str, *arguments: str | Path) -> list[list[float]]:
    """Runs a program of another engine in a process of its own; returns its rows."""
    command = [sys.executable, "-c", program, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    rows = [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("ROW ")]
    assert rows, done.stderr
    return rows


@pytest.fixture
def nested(stricts: Any) -> Path:
    """Two integrators, the second in a system of its own, with a linear transformation and a binding from outside."""
    stricts.fmu(complete=True)
    work = stricts.workshop
    inner = work.system(
        stricts.component("deep one", step=0.25),
        work.connection("in", "deep one/u"),
        name="in side",
        connectors="in:input",
    )
    wire = work.connection("a/y", "in side/in", '<ssc:LinearTransformation factor="2" offset="0.5"/>')
    parts = stricts.component("a", step=0.25, u=1.5, p=2.0) + inner
    root = work.system(parts, wire, bindings=work.bindings({"in side.deep one.p": 0.5}))
    made: Path = work.ssd("nested.ssd", root, '<ssd:DefaultExperiment startTime="0" stopTime="3"/>')
    return made


def test_sources_are_paths_without_escapes(stricts: Any, tmp_path: Path) -> None:
    """Other engines take them as they are; two files whose names would become equal stay two."""
    work = stricts.workshop
    for name in ("my fmu.fmu", "my#fmu.fmu", "plain.fmu"):
        stricts.fmu(complete=True)
        (work.root / "strict.fmu").rename(work.root / name)
    parts = "".join(
        work.component(name, source)
        for name, source in (("a", "my%20fmu.fmu"), ("b", "my%23fmu.fmu"), ("c", "plain.fmu"))
    )
    system = work.ssd("s.ssd", work.system(parts), '<ssd:DefaultExperiment startTime="0" stopTime="1"/>')
    for engine in ("fmpy", "omsimulator"):
        made = convert(system, tmp_path / engine, engine)
        root = etree.parse(tmp_path / engine / "SystemStructure.ssd").getroot()
        sources = [one.get("source") for one in root.iter(f"{SSD}Component")]
        assert sources == ["resources/my_fmu.fmu", "resources/my_fmu_2.fmu", "resources/plain.fmu"], made
        assert all((tmp_path / engine / str(source)).is_file() for source in sources)


def test_connectors_and_values_have_the_types_of_the_fmu(stricts: Any, tmp_path: Path) -> None:
    """A multi-model's 2 for a Real is written as a Real; every connector has a type."""
    stricts.fmu(complete=True)
    content = {
        "fmus": {"{A}": "strict.fmu"},
        "connections": {"{A}.one.y": ["{A}.two.u"]},
        "parameters": {"{A}.one.p": 2, "{A}.one.mode": 0, "{A}.one.u": 1},
        "algorithm": {"type": "fixed-step", "size": 0.25},
        "endTime": 3.0,
    }
    mm = stricts.workshop.root / "mm.json"
    mm.write_text(json.dumps(content))
    made = convert(mm, tmp_path / "made")
    root = etree.parse(str(made.file)).getroot()
    types = {
        (one.getparent().getparent().get("name"), one.get("name")): etree.QName(one[0]).localname
        for one in root.iter(SSD + "Connector")
    }
    assert types["{A}.one", "p"] == types["{A}.one", "y"] == types["{A}.two", "u"] == "Real"
    assert (types["{A}.one", "mode"], types["{A}.one", "r"], types["{A}.one", "c"]) == ("Integer", "String", "Boolean")
    values = {
        one.get("name"): (etree.QName(one[0]).localname, one[0].get("value")) for one in root.iter(SSV + "Parameter")
    }
    assert values == {"p": ("Real", "2.0"), "u": ("Real", "1.0"), "mode": ("Integer", "0")}
    assert signals(made.file.parent, tmp_path / "one") == signals(mm, tmp_path / "two")


@pytest.mark.parametrize("engine", ENGINES)
def test_written_for_an_engine_it_gives_the_same_with_us(nested: Path, tmp_path: Path, engine: str) -> None:
    if engine == "fmpy":
        text = nested.read_text()
        nested.write_text(text.replace('<ssc:LinearTransformation factor="2" offset="0.5"/>', ""))
    made = convert(nested, tmp_path / "made", engine)
    got, expected = signals(made.file.parent, tmp_path / "one"), signals(nested, tmp_path / "two")
    assert got["in_side_deep_one.y"] == expected["in side.deep one.y"]
    assert got["in_side_deep_one.y"][-1] > 1.0
    assert any("in side.deep one is in_side_deep_one" in note for note in made.notes)
    assert any("the step is 0.25 s" in note for note in made.notes)


def test_the_annotation_of_omsimulator(nested: Path, tmp_path: Path) -> None:
    made = convert(nested, tmp_path / "made", "omsimulator")
    root = etree.parse(str(made.file)).getroot()
    (master,) = root.iter("{*}FixedStepMaster")
    assert "the step is 0.25 s; in Python: setFixedStepSize(0.25)" in made.notes
    assert dict(master.attrib) == {"description": "oms-ma", "stepSize": "0.25"}
    assert [one.get("type") for one in root.iter(SSC + "Annotation")] == ["org.openmodelica", "org.uav-cosim.stepping"]


def test_omsimulator_gets_neither_texts_nor_annotations_of_components(stricts: Any, tmp_path: Path) -> None:
    """OMSimulator 3 refuses connectors of texts, annotations of components, and names that are not identifiers."""
    stricts.fmu()
    path = stricts.ssd(stricts.component("a", step=0.25) + stricts.component("b", step=0.5), "a/y b/u")
    path = path.rename(path.with_name("two parts.ssd"))
    path.write_text(re.sub('(<ssd:SystemStructureDescription[^>]* name=")[^"]*', "\\1two-parts", path.read_text()))
    root = etree.parse(str(convert(path, tmp_path / "made", "omsimulator").file)).getroot()
    assert root.get("name") == "two_parts"
    assert {one.get("name") for one in root.iter(SSD + "Connector")} == {"u", "y", "n", "c"}
    assert [one.getparent().getparent().tag for one in root.iter(SSC + "Annotation")] == [SSD + "System"]
    joined = stricts.ssd(stricts.component("a") + stricts.component("b"), "a/r b/s")
    with pytest.raises(
        SystemDescriptionError, match=r"b\.s is a text and driven by a text, which omsimulator does not"
    ):
        convert(joined, tmp_path / "again", "omsimulator")


@needs_libcosim
def test_libcosim_runs_what_is_written_for_it(nested: Path, tmp_path: Path) -> None:
    made = convert(nested, tmp_path / "made", "libcosim")
    rows = run_by(_LIBCOSIM, made.file.parent, "12", "a.y", "in_side_deep_one.y")
    expected = signals(nested, tmp_path / "out")
    assert rows == [list(row) for row in zip(expected["a.y"], expected["in side.deep one.y"], strict=True)][1:]


@needs_libcosim
def test_ecos_runs_what_is_written_for_it(nested: Path, tmp_path: Path) -> None:
    folder = convert(nested, tmp_path / "made", "ecos").file.parent
    rows = run_by(_ECOS, zipped(folder), "12", "a::y", "in_side_deep_one::y")
    expected = signals(nested, tmp_path / "out")
    assert rows == [list(row) for row in zip(expected["a.y"], expected["in side.deep one.y"], strict=True)][1:]


@pytest.mark.skipif("OMSIMULATOR" not in os.environ, reason="OMSIMULATOR names no executable")
def test_omsimulator_runs_what_is_written_for_it(dynamics: Any, workshop: Any, tmp_path: Path) -> None:
    """x' = gain u, each driven by the other's x: their outputs do not depend directly on inputs, so nothing lags."""
    dynamics.fmu("DRIVE", 2, "CS", name="d.fmu", step=0.25)
    parts = workshop.component("a", "d.fmu", "u:input x:output gain:parameter", workshop.bindings({"gain": -0.5}))
    inner = workshop.system(
        workshop.component("b", "d.fmu", "u:input x:output m:input", workshop.bindings({"m": 1})),
        workshop.connection("in", "b/u") + workshop.connection("b/x", "out"),
        name="in side",
        connectors="in:input out:output",
    )
    wires = workshop.connection("a/x", "in side/in") + workshop.connection("in side/out", "a/u")
    system = workshop.ssd("s.ssd", workshop.system(parts + inner, wires))
    folder, result = convert(system, tmp_path / "made", "omsimulator").file.parent, tmp_path / "result.csv"
    options = [f"--resultFile={result}", "--stopTime=3", f"--tempDir={tmp_path}", str(zipped(folder))]
    done = subprocess.run([os.environ["OMSIMULATOR"], *options], capture_output=True, check=False, timeout=600)
    assert result.exists(), done.stdout
    with result.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    expected = signals(system, tmp_path / "out")
    for name, ours in (("a.x", "a.x"), ("in_side_b.x", "in side.b.x")):
        (column,) = (one for one in rows[0] if one.endswith(f".{name}"))
        found = {round(float(row["time"]) / 0.25): float(row[column]) for row in rows}
        assert [found[k] for k in range(13)] == pytest.approx(expected[ours], rel=1e-9), done.stdout
        assert len({*expected[ours]}) > 10


def test_factors_for_omsimulator_are_told(nested: Path, tmp_path: Path) -> None:
    notes = convert(nested, tmp_path / "made", "omsimulator").notes
    text = "1 connections have a factor or an offset (in side.deep one.u), which OMSimulator applies since March 2026"
    assert any(note.startswith(text) for note in notes), notes


def test_fmpy_runs_what_is_written_for_it(stricts: Any, tmp_path: Path) -> None:
    """The integral of p times the number of steps; FMPy applies the parameter set that it is given."""
    stricts.fmu(complete=True)
    system = stricts.ssd(stricts.component("a") + stricts.component("ab", p=2.0), "a/n ab/u")
    made = convert(system, tmp_path / "made", "fmpy")
    folder = made.file.parent
    program = (
        "import sys\nfrom fmpy.ssp.simulation import simulate_ssp\nfrom fmpy.ssp.ssd import read_ssv\n"
        "r = simulate_ssp(sys.argv[1], stop_time=3.0, step_size=0.5, parameter_set=read_ssv(sys.argv[2]))\n"
        "print('ROW', float(r['ab.y'][-1]))\n"
    )
    rows = run_by(program, zipped(folder), str(folder / "initialValues.ssv"))
    assert rows == [[0.5 * 2.0 * sum(range(6))]]
    assert signals(system, tmp_path / "out")["ab.y"][-1] == 15.0
    assert "a is a_" in made.notes[0] and "FMPy makes its first step with 0 at all connected inputs" in made.notes


def test_an_ssp_is_written_for_others_only(nested: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError, match="is an SSP already; for another engine: --for omsimulator"):
        convert(nested, tmp_path / "made")
    convert(nested, tmp_path / "made", "ecos")
    with pytest.raises(SystemDescriptionError, match="exists already"):
        convert(nested, tmp_path / "made", "ecos")
    with read_system(tmp_path / "made") as structure:
        assert not structure.problems


def test_a_full_disk_leaves_no_folder(nested: Path, tmp_path: Path) -> None:
    with room_of(100), pytest.raises(WriteFailed, match="made: cannot be written: File too large"):
        convert(nested, tmp_path / "made", "ecos")
    assert not (tmp_path / "made").exists()


LEVEL = '<SimpleType name="Level"><Enumeration><Item name="low" value="1"/><Item name="high" value="5"/></Enumeration>'


@pytest.fixture
def valued(workshop: Any, variable: Any) -> Callable[..., Path]:
    """A component with a value for an Enumeration e (1 without it), a String s ("own") and a Boolean b (true)."""

    def made(**values: Any) -> Path:
        level = variable("e", kind="Enumeration", declaredType="Level", start="1")
        others = variable("s", kind="String", start="own"), variable("b", kind="Boolean", start="true")
        workshop.fmu("v.fmu", level, *others, types=f"{LEVEL}</SimpleType>", step=0.1)
        sets = [(values, None)] if "e" not in values else [({"e": values.pop("e")}, "Enumeration"), (values, None)]
        bound = "".join(str(workshop.bindings(one, kind=kind)) for one, kind in sets if one)
        bound = bound.replace("</ssd:ParameterBindings>\n<ssd:ParameterBindings>", "")
        parts = workshop.component("a", "v.fmu", "e:input s:input b:input", bound)
        return Path(workshop.ssd("v.ssd", workshop.system(parts)))

    return made


@pytest.mark.parametrize(
    ("engine", "values", "text"),
    [
        ("libcosim", {"e": "high"}, "a.e is an Enumeration, which libcosim does not set"),
        ("ecos", {"e": "high"}, "a.e is an Enumeration, which ecos does not set"),
        ("fmpy", {"s": "other"}, "a.s is a text, which fmpy does not set"),
        ("fmpy", {"b": False}, "a.b is false, which fmpy does not set"),
    ],
)
def test_values_that_an_engine_does_not_set(valued: Any, tmp_path: Path, engine: str, values: Any, text: str) -> None:
    """Each was tried with the engine: an error at the start of the run or, for false in FMPy, the value true."""
    with pytest.raises(SystemDescriptionError, match=text):
        convert(valued(**values), tmp_path / "made", engine)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("engine", ["fmpy", "omsimulator"])
def test_values_of_enumerations_are_written_as_integers(valued: Any, tmp_path: Path, engine: str) -> None:
    """FMPy and OMSimulator read no names of items (benchmarks/engines.py); both take these."""
    folder = convert(valued(e="high", s="own", b=True), tmp_path / "made", engine).file.parent
    for file in folder.glob("*.ss?"):
        values = {one.get("name"): one[0] for one in etree.parse(str(file)).getroot().iter(SSV + "Parameter")}
        written = {name.removeprefix("a."): (one.tag, one.get("value")) for name, one in values.items()}
        assert written["e"] == (SSV + "Integer", "5") and written["b"] == (SSV + "Boolean", "true")
    with read_system(folder) as structure:
        (one,) = check(structure).instances
    assert one.effective_values()["e"] == 5


def test_connections_for_fmpy_begin_with_0(workshop: Any, variable: Any, tmp_path: Path) -> None:
    """FMPy sets every connected input to 0 before the first step."""
    level = {"kind": "Enumeration", "declaredType": "Level"}
    workshop.fmu(
        "e.fmu", variable("e", start="1", **level), variable("ye", "output", **level), types=f"{LEVEL}</SimpleType>"
    )
    parts = workshop.component("a", "e.fmu", "e:input ye:output") + workshop.component("b", "e.fmu", "e:input")
    system = workshop.ssd("e.ssd", workshop.system(parts, workshop.connection("a/ye", "b/e")))
    with pytest.raises(
        SystemDescriptionError, match=r"b\.e is an Enumeration without an item of value 0, which FMPy sets"
    ):
        convert(system, tmp_path / "made", "fmpy")
    convert(system, tmp_path / "made", "omsimulator")


@pytest.mark.parametrize("engine", ["libcosim", "ecos"])
def test_enumerations_are_not_connected(workshop: Any, variable: Any, tmp_path: Path, engine: str) -> None:
    """libcosim and Ecos do not know such a variable: they would refuse the whole file."""
    types = '<SimpleType name="Mode"><Enumeration><Item name="off" value="0"/></Enumeration></SimpleType>'
    mode = {"kind": "Enumeration", "declaredType": "Mode"}
    ports = (variable("e", start="0", **mode), variable("ye", "output", **mode))
    workshop.fmu("enum.fmu", *ports, types=types, step=0.1)
    parts = workshop.component("a", "enum.fmu", "e:input ye:output") + workshop.component("b", "enum.fmu", "e:input")
    system = workshop.ssd("enum.ssd", workshop.system(parts, workshop.connection("a/ye", "b/e")))
    with pytest.raises(SystemDescriptionError, match=rf"b\.e is Enumeration and driven by Enumeration, which {engine}"):
        convert(system, tmp_path / "made", engine)
    assert not (tmp_path / "made").exists()
    convert(system, tmp_path / "made", "fmpy")
