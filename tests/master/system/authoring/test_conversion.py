"""Systems written for other engines: read back by us, and run by the engine where it is installed."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from lxml import etree

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import ENGINES, convert
from cosim_master.system.reading.read import read_system
from tests.master.system.reading.test_osp import _LIBCOSIM, needs_libcosim

pytestmark = pytest.mark.usefixtures("own_cache")
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"


def signals(system: Path, out: Path, until: float = 3.0) -> dict[str, list[Any]]:
    result = simulate(system, RunOptions(out=out, until=until))
    assert result.outcome == "done", result.error
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


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
    assert dict(master.attrib) == {"description": "oms-ma", "stepSize": "0.25"}
    assert [one.get("type") for one in root.iter(SSC + "Annotation")] == ["org.uav-cosim.stepping", "org.openmodelica"]


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
    names = ["a.y", "in_side_deep_one.y"]
    command = [sys.executable, "-c", _LIBCOSIM, str(made.file.parent), "12", *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    rows = [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("ROW ")]
    expected = signals(nested, tmp_path / "out")
    ours = list(zip(expected["a.y"], expected["in side.deep one.y"], strict=True))
    assert rows == [list(row) for row in ours[1:]], done.stderr


def test_fmpy_runs_what_is_written_for_it(stricts: Any, tmp_path: Path) -> None:
    """The integral of p times the number of steps; FMPy applies the parameter set that it is given."""
    stricts.fmu(complete=True)
    system = stricts.ssd(stricts.component("a") + stricts.component("ab", p=2.0), "a/n ab/u")
    made = convert(system, tmp_path / "made", "fmpy")
    folder = made.file.parent
    with zipfile.ZipFile(tmp_path / "made.ssp", "w") as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder).as_posix())
    program = (
        "import sys\nfrom fmpy.ssp.simulation import simulate_ssp\nfrom fmpy.ssp.ssd import read_ssv\n"
        "r = simulate_ssp(sys.argv[1], stop_time=3.0, step_size=0.5, parameter_set=read_ssv(sys.argv[2]))\n"
        "print('ROW', float(r['ab.y'][-1]))\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "made.ssp"), str(folder / "initialValues.ssv")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    (row,) = [line for line in done.stdout.splitlines() if line.startswith("ROW")] or [done.stderr]
    assert row == f"ROW {0.5 * 2.0 * sum(range(6))}"
    assert signals(system, tmp_path / "out")["ab.y"][-1] == 15.0
    assert "a is a_" in made.notes[0]


def test_an_ssp_is_written_for_others_only(nested: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError, match="is an SSP already; for another engine: --for omsimulator"):
        convert(nested, tmp_path / "made")
    convert(nested, tmp_path / "made", "ecos")
    with pytest.raises(SystemDescriptionError, match="exists already"):
        convert(nested, tmp_path / "made", "ecos")
    with read_system(tmp_path / "made") as structure:
        assert not structure.problems


def test_enumerations_are_not_connected_for_libcosim(workshop: Any, variable: Any, tmp_path: Path) -> None:
    """libcosim does not know such a variable: it would refuse the whole file."""
    types = '<SimpleType name="Mode"><Enumeration><Item name="off" value="0"/></Enumeration></SimpleType>'
    mode = {"kind": "Enumeration", "declaredType": "Mode"}
    ports = (variable("e", start="0", **mode), variable("ye", "output", **mode))
    workshop.fmu("enum.fmu", *ports, types=types, step=0.1)
    parts = workshop.component("a", "enum.fmu", "e:input ye:output") + workshop.component("b", "enum.fmu", "e:input")
    system = workshop.ssd("enum.ssd", workshop.system(parts, workshop.connection("a/ye", "b/e")))
    with pytest.raises(SystemDescriptionError, match=r"b\.e is Enumeration and driven by Enumeration, which libcosim"):
        convert(system, tmp_path / "made", "libcosim")
    assert not (tmp_path / "made").exists()
    convert(system, tmp_path / "made", "ecos")
