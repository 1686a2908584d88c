"""One file for a whole system: it has everything, is legal SSP, runs anywhere, and gives the same recording."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest
from fmpy.ssp.ssd import read_ssd
from lxml import etree
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError, WriteFailed
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.pack import pack
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.ssp.schema import schema_folder
from cosim_master.system.settings.network import network_of
from tests.scenarios.flights import SYSTEMS

pytestmark = pytest.mark.usefixtures("own_cache")

SSD_TYPE, SSP_TYPE = "application/x-ssp-definition", "application/x-ssp-package"
BINDING = '<ssd:ParameterBindings><ssd:ParameterBinding source="{}"/></ssd:ParameterBindings>'


@pytest.fixture
def system(workshop: Any, variable: Any) -> Path:
    """system/: two drones that share parts/drone.ssd, with values outside, FMUs inside and outside of one name."""
    ports = (variable("u"), variable("y", "output"), variable("p", "parameter"))
    workshop.fmu("fmus/plant.fmu", *ports, step="0.1")
    workshop.fmu("system/plant.fmu", *ports, variable("more", "parameter"), step="0.1")
    plant = workshop.component("plant", "../../fmus/plant.fmu", "u:input y:output")
    workshop.ssd("system/parts/drone.ssd", workshop.system(plant, workshop.connection("plant/y", "plant/u")))
    drones = "".join(workshop.component(f"d{i}", "parts/drone.ssd", type=SSD_TYPE) for i in (1, 2))
    drones += workshop.component("mast", "plant.fmu")
    values = BINDING.format("../values/set%201.ssv")
    workshop.ssd("system/SystemStructure.ssd", workshop.system(drones, bindings=values))
    (workshop.root / "values").mkdir()
    (workshop.root / "values/set 1.ssv").write_text(workshop.parameter_set({"d1.plant.p": 2.5, "mast.more": 1.0}))
    (workshop.root / "system/readme.txt").write_text("nothing refers to it")
    made: Path = workshop.root / "system"
    return made


def starts(path: Path, variant: str | None = None) -> dict[str, Any]:
    with read_system(path, variant) as structure:
        return {one.name: (one.fmu.digest, dict(one.start_values)) for one in check(structure).instances}


def refusal(*arguments: Any, **options: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        pack(*arguments, **options)
    return str(caught.value)


def members(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as file:
        return file.namelist()


def test_everything_is_in_and_leads_there(system: Path, tmp_path: Path) -> None:
    before = starts(system)
    packed = pack(system, tmp_path / "far" / "away.ssp")
    assert packed.path == tmp_path / "far" / "away.ssp"
    assert members(packed.path) == [
        "SystemStructure.ssd",
        "resources/parts/drone.ssd",
        "resources/plant-2.fmu",
        "resources/plant.fmu",
        "resources/set_1.ssv",
    ]
    assert list(packed.members) == members(packed.path)
    for name in ("system", "fmus", "values"):
        shutil.rmtree(tmp_path / name)
    assert starts(packed.path) == before
    assert before["d1.plant"][1] == {"p": 2.5} and before["d1.plant"][0] != before["mast"][0]
    assert {path.name for path in (tmp_path / "far").iterdir()} == {"away.ssp"}


def test_the_same_bytes_wherever_it_was(system: Path, tmp_path: Path) -> None:
    first = pack(system, tmp_path / "1.ssp").path.read_bytes()
    (tmp_path / "moved").mkdir()
    for name in ("system", "fmus", "values"):
        shutil.move(tmp_path / name, tmp_path / "moved" / name)
    again = pack(tmp_path / "moved" / "system", tmp_path / "2.ssp").path
    assert again.read_bytes() == first
    assert pack(again, tmp_path / "3.ssp").path.read_bytes() == first  # what is packed is packed already


def test_a_single_ssd_becomes_the_root(system: Path, tmp_path: Path) -> None:
    (system / "SystemStructure.ssd").rename(system / "mine.ssd")
    shutil.copy(system / "mine.ssd", system / "other.ssd")
    packed = pack(system / "mine.ssd", tmp_path / "x.ssp")
    assert packed.variants == ()
    assert [name for name in packed.members if "/" not in name] == ["SystemStructure.ssd"]


def test_variants_come_along_and_parts_do_not_look_like_them(system: Path, workshop: Any, tmp_path: Path) -> None:
    one = workshop.component("d", "parts/drone.ssd", type=SSD_TYPE) + workshop.component("w", "wing.ssd", type=SSD_TYPE)
    workshop.ssd("system/small.ssd", workshop.system(one))
    workshop.ssd("system/wing.ssd", workshop.system(workshop.component("p", "plant.fmu")))
    packed = pack(system, tmp_path / "x.ssp")
    assert packed.variants == ("small.ssd",)
    assert [name for name in members(packed.path) if "/" not in name] == ["SystemStructure.ssd", "small.ssd"]
    assert starts(packed.path, "small.ssd").keys() == {"d.plant", "w.p"}
    alone = pack(system, tmp_path / "y.ssp", variant="small.ssd")
    assert alone.variants == ()
    assert starts(alone.path) == starts(packed.path, "small.ssd")
    (system / "wing.ssd").write_text("<broken")
    assert "wing.ssd" in refusal(system, tmp_path / "z.ssp")


def test_settings_that_a_run_refuses_are_not_packed(workshop: Any, tmp_path: Path) -> None:
    workshop.fmu("plant.fmu")
    wrong = {"network": 'loss="7"', "verdict": 'contact="-1"'}
    space = 'xmlns="https://uav-cosim.org/ns/1"'
    each = "".join(
        f'<ssc:Annotation type="org.uav-cosim.{kind}"><{kind} {space} {setting}/></ssc:Annotation>'
        for kind, setting in wrong.items()
    )
    one, annotations = workshop.component("p", "plant.fmu"), f"<ssd:Annotations>{each}</ssd:Annotations>"
    workshop.ssd("s.ssd", workshop.system(one, after=annotations))
    done = CliRunner().invoke(app, ["pack", str(tmp_path / "s.ssd"), "-o", str(tmp_path / "s.ssp")])
    assert done.exit_code == 2
    assert 'loss="7" must be a number from 0 to 1' in done.stderr and 'contact="-1"' in done.stderr
    assert not (tmp_path / "s.ssp").exists()


def test_an_archive_inside_is_taken_as_it_is(system: Path, workshop: Any, tmp_path: Path) -> None:
    inner = pack(system, tmp_path / "inner.ssp").path
    outer = workshop.ssd("outer.ssd", workshop.system(workshop.component("all", "inner.ssp", type=SSP_TYPE)))
    packed = pack(outer, tmp_path / "outer.ssp").path
    assert members(packed) == ["SystemStructure.ssd", "resources/inner.ssp"]
    expected = {f"all.{name}" for name in starts(inner)}
    inner.unlink()
    assert starts(packed).keys() == expected


def test_a_dialect_comes_along_with_what_it_includes(system: Path, workshop: Any, tmp_path: Path) -> None:
    (tmp_path / "mav/base").mkdir(parents=True)
    message = '<message id="{}" name="{}"><description/><field type="uint8_t" name="n"/></message>'
    text = "<mavlink>{}<messages>{}</messages></mavlink>"
    included = "<include>base/more.xml</include><include>common.xml</include>"
    (tmp_path / "mav/own.xml").write_text(text.format(included, message.format(50001, "BID")))
    (tmp_path / "mav/base/more.xml").write_text(text.format("", message.format(50002, "ASK")))
    network = '<network xmlns="https://uav-cosim.org/ns/1" dialect="../mav/own.xml"/>'
    annotation = workshop.annotation("org.uav-cosim.network", network)
    parts = workshop.component("mast", "plant.fmu")
    workshop.ssd("system/SystemStructure.ssd", workshop.system(parts, after=annotation))
    packed = pack(system, tmp_path / "x.ssp").path
    assert [name for name in members(packed) if name.endswith("xml")] == [
        "resources/own/base/more.xml",
        "resources/own/own.xml",
    ]
    with zipfile.ZipFile(packed) as file:
        assert b'dialect="resources/own/own.xml"' in file.read("SystemStructure.ssd")


def test_a_trace_of_the_radio_comes_along(system: Path, workshop: Any, tmp_path: Path) -> None:
    (tmp_path / "traces").mkdir()
    (tmp_path / "traces/my flight.csv").write_text("time,from,to,delivered,delay\n")
    network = '<network xmlns="https://uav-cosim.org/ns/1" trace="../traces/my flight.csv"/>'
    annotation = workshop.annotation("org.uav-cosim.network", network)
    workshop.ssd(
        "system/SystemStructure.ssd", workshop.system(workshop.component("mast", "plant.fmu"), after=annotation)
    )
    packed = pack(system, tmp_path / "x.ssp").path
    assert "resources/my_flight.csv" in members(packed)
    with zipfile.ZipFile(packed) as file:
        assert b'trace="resources/my_flight.csv"' in file.read("SystemStructure.ssd")


def test_an_own_channel_of_the_radio_comes_along(system: Path, workshop: Any, tmp_path: Path) -> None:
    (tmp_path / "system/rain.py").write_text("def channel(packet):\n    return packet.delay\n")
    network = '<network xmlns="https://uav-cosim.org/ns/1" channel="rain.py"/>'
    annotation = workshop.annotation("org.uav-cosim.network", network)
    workshop.ssd(
        "system/SystemStructure.ssd", workshop.system(workshop.component("mast", "plant.fmu"), after=annotation)
    )
    packed = pack(system, tmp_path / "x.ssp").path
    assert "resources/rain.py" in members(packed)
    with read_system(packed) as structure:
        assert network_of(check(structure)).own is not None


def test_the_official_schema_and_fmpy_read_it(system: Path, tmp_path: Path) -> None:
    packed = pack(system, tmp_path / "x.ssp").path
    schema = etree.XMLSchema(file=str(schema_folder(1) / "SystemStructureDescription.xsd"))
    with zipfile.ZipFile(packed) as file:
        for name in members(packed):
            if name.endswith(".ssd"):
                schema.assertValid(etree.fromstring(file.read(name)))
    root = read_ssd(str(packed)).system
    assert [component.name for component in root.elements] == ["d1", "d2", "mast"]
    assert root.elements[0].source == "resources/parts/drone.ssd"


def test_what_is_refused(system: Path, tmp_path: Path) -> None:
    (tmp_path / "mm.json").write_text("{}")
    assert "uav-cosim convert" in refusal(tmp_path / "mm.json", tmp_path / "x.ssp")
    assert "is one FMU" in refusal(tmp_path / "fmus/plant.fmu", tmp_path / "x.ssp")
    assert "give one that ends in .ssp" in refusal(system, tmp_path / "x.zip")
    there = pack(system, tmp_path / "x.ssp").path
    before = there.read_bytes()
    assert "exists; give another name, or --force" in refusal(system, there)
    assert "is the system itself" in refusal(there, there, overwrite=True)
    assert pack(system, there, overwrite=True).path.read_bytes() == before
    with pytest.raises(WriteFailed, match=r"x\.ssp: cannot be written: Not a directory"):
        pack(system, tmp_path / "mm.json" / "in" / "x.ssp")
    (tmp_path / "fmus/plant.fmu").unlink()
    assert "does not exist" in refusal(system, there, overwrite=True)
    assert there.read_bytes() == before


def test_the_command(system: Path, tmp_path: Path) -> None:
    file = str(tmp_path / "x.ssp")
    result = CliRunner().invoke(app, ["pack", str(system), "-o", file])
    assert (result.exit_code, result.stdout) == (0, f"{file}: 5 files, 0.0 MB; uav-cosim run {file}\n")
    assert CliRunner().invoke(app, ["pack", str(system), "-o", file]).exit_code == 2
    result = CliRunner().invoke(app, ["pack", str(system), "-o", file, "--force", "--json"])
    assert json.loads(result.stdout) == {"files": [file], "members": members(Path(file)), "variants": []}


def test_a_flight_of_the_archive_is_the_flight_of_the_system(fmus: Path, tmp_path: Path) -> None:
    assert fmus.is_dir()
    packed = pack(SYSTEMS / "line5", tmp_path / "line5.ssp").path
    for system, out in ((SYSTEMS / "line5", "one"), (packed, "two")):
        assert simulate(system, RunOptions(out=tmp_path / out, until=8.0)).outcome == "done"
    for name in ("signals.parquet", "packets.parquet", "packets.tlog"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
