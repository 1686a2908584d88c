"""Generated systems: what is written checks, is linear in the number of drones, and flies."""

from __future__ import annotations

import gc
import itertools
import re
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from lxml import etree

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.execution.simulate import simulate
from cosim_master.stepping.layout import make_layout
from cosim_master.system.authoring.swap import swap
from cosim_master.system.authoring.swarm.new import fleet_of, new_system, number_of_drones
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from tests.master.system.reading.test_osp import needs_libcosim

ROOT = Path(__file__).parents[4]


def test_a_line_is_wired_and_numbered(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 5, tmp_path / "line", fmus=fmus, spacing=10.0)
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
    assert [i.name for i in checked.instances][:3] == ["drone1.agent", "drone1.autopilot", "drone1.vehicle"]
    assert len(checked.instances) == 15
    starts = {i.name: i.start_values for i in checked.instances}
    east = [starts[f"drone{n}.vehicle"]["position_start[2]"] for n in range(1, 6)]
    assert east == [0.0, 10.0, 20.0, 30.0, 50.0]
    assert [starts[f"drone{n}.agent"]["stubborn"] for n in range(1, 6)] == [True, False, False, False, True]
    neighbours = [
        (starts[f"drone{n}.agent"]["left_sysid"], starts[f"drone{n}.agent"]["right_sysid"]) for n in range(1, 6)
    ]
    assert neighbours == [(0, 2), (1, 3), (2, 4), (3, 5), (4, 0)]
    assert ("drone2", "drone3") in network.links
    assert ("drone1", "drone3") not in network.links


def test_what_a_line_of_three_is_to_the_byte(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 3, tmp_path / "three", fmus=fmus)
    assert sorted(file.name for file in folder.iterdir()) == ["SystemStructure.ssd", "drone.ssd", "drones.ssv"]
    assert (folder / "SystemStructure.ssd").read_text(encoding="utf-8") == _THREE
    values = (folder / "drones.ssv").read_text(encoding="utf-8")
    assert values.startswith(_VALUES)
    assert [line.strip() for line in values.splitlines() if "drone2" in line] == [
        f'<ssv:Parameter name="drone2.{name}">'
        for name in (
            "vehicle.position_start[1]",
            "vehicle.position_start[2]",
            "autopilot.SYSID_THISMAV",
            "agent.sysid",
            "agent.left_sysid",
            "agent.right_sysid",
            "agent.stubborn",
        )
    ]


_THREE = """\
<?xml version='1.0' encoding='UTF-8'?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" \
xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="three" version="1.0">
  <ssd:System name="three">
    <ssd:ParameterBindings>
      <ssd:ParameterBinding source="drones.ssv"/>
    </ssd:ParameterBindings>
    <ssd:Elements>
      <ssd:Component name="drone1" type="application/x-ssp-definition" source="drone.ssd"/>
      <ssd:Component name="drone2" type="application/x-ssp-definition" source="drone.ssd"/>
      <ssd:Component name="drone3" type="application/x-ssp-definition" source="drone.ssd"/>
    </ssd:Elements>
    <ssd:Annotations>
      <ssc:Annotation type="org.uav-cosim.network">
        <network xmlns="https://uav-cosim.org/ns/1" topology="listed" latency="0.02" seed="1">
          <link between="drone1 drone2"/>
          <link between="drone2 drone3"/>
        </network>
      </ssc:Annotation>
      <ssc:Annotation type="org.uav-cosim.recording">
        <recording xmlns="https://uav-cosim.org/ns/1" interval="0.1"/>
      </ssc:Annotation>
    </ssd:Annotations>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="40.0"/>
</ssd:SystemStructureDescription>
"""
_VALUES = """\
<?xml version='1.0' encoding='UTF-8'?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="three" version="1.0">
  <ssv:Parameters>
    <ssv:Parameter name="drone1.vehicle.position_start[1]">
      <ssv:Real value="0.0"/>
    </ssv:Parameter>
"""


@pytest.mark.parametrize("layout", ["ring", "v", "random"])
def test_drones_of_a_layout_spread_from_west_to_east(fmus: Path, tmp_path: Path, layout: str) -> None:
    """The next drones to west and east are neighbours, and have links; every fifth or so stays."""
    notes: list[str] = []
    folder = new_system("line5", 8, tmp_path / layout, layout=layout, spacing=10.0, note=notes.append)
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
    starts = {one.name: one.start_values for one in checked.instances}
    numbers = sorted(range(1, 9), key=lambda n: (starts[f"drone{n}.vehicle"]["position_start[2]"], n))
    agents = [starts[f"drone{n}.agent"] for n in numbers]
    assert [agent["left_sysid"] for agent in agents] == [0, *numbers[:-1]]
    assert [agent["right_sysid"] for agent in agents] == [*numbers[1:], 0]
    assert [agent["stubborn"] for agent in agents] == [True, False, False, False, True, False, False, True]
    pairs = {(f"drone{a}", f"drone{b}") for a, b in itertools.pairwise(numbers)}
    assert network.links == pairs | {(b, a) for a, b in pairs}
    assert notes[0].startswith("drones spread evenly from west to east between those that stay: a step of 3.1875 s")


def test_a_fleet_takes_turns(fmus: Path, tmp_path: Path) -> None:
    fleet = {"vehicle": fleet_of("2xQuadrotor, 1xHexarotor")}
    folder = new_system("line5-estimated", 6, tmp_path / "fleet", fleet=fleet)
    with read_system(folder) as structure:
        checked = check(structure)
    vehicles = [one.fmu.path.stem for one in checked.instances if one.name.endswith(".vehicle")]
    assert vehicles == ["Quadrotor", "Quadrotor", "Hexarotor"] * 2
    assert [one.start_values["identity"] for one in checked.instances if one.name.endswith(".estimator")] == [
        *range(1, 7)
    ]
    assert sorted(file.name for file in folder.glob("*.ssd")) == [
        "SystemStructure.ssd",
        "drone-Hexarotor.ssd",
        "drone.ssd",
    ]


def test_poses_of_a_file_and_drones_without_agents(fmus: Path, tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("name,north,east,down\nscout,1,2,-3\n,4,5,0\n", encoding="utf-8")
    assert number_of_drones(None, str(file), {}) == 2
    with read_system(new_system("line5-script", 2, tmp_path / "posed", layout=str(file))) as structure:
        starts = {one.name: one.start_values for one in check(structure).instances}
    places = [
        [starts[f"{name}.vehicle"].get(f"position_start[{i}]") for i in (1, 2, 3)] for name in ("scout", "drone2")
    ]
    assert places == [[1.0, 2.0, -3.0], [4.0, 5.0, None]]


def test_how_many_drones_are_meant(tmp_path: Path) -> None:
    assert fleet_of("4xA,1xB") == ("A", "A", "A", "A", "B")
    assert fleet_of("fmus/A.fmu") == ("fmus/A.fmu",)
    assert number_of_drones(7, None, {"vehicle": ("A", "B")}) == 7
    assert number_of_drones(None, None, {"vehicle": ("A", "B"), "agent": ("C",)}) == 2
    for wrong, what in (("poses.csv", "no such file"), ("rign", "is not a layout")):
        with pytest.raises(
            SystemDescriptionError, match=rf"^{wrong}: {what}; valid: line, grid, ring, v, random, or a"
        ):
            number_of_drones(None, wrong, {})
    with pytest.raises(SystemDescriptionError, match="--drones: is missing: say how many drones"):
        number_of_drones(None, "ring", {"vehicle": ("A",)})
    with pytest.raises(SystemDescriptionError, match="A,: is not a list of FMUs, files or models, such as 4xFIRST"):
        fleet_of("A,")
    file = tmp_path / "poses.csv"
    file.write_text("north,east\n1,2\n", encoding="utf-8")
    with pytest.raises(SystemDescriptionError, match=r"poses.csv: has 1 rows, and --drones says 2: leave it out"):
        number_of_drones(2, str(file), {})
    with pytest.raises(SystemDescriptionError, match="--drones: 0 drones are too few: give 1 or more"):
        new_system("line5", 0, tmp_path / "none")
    with pytest.raises(SystemDescriptionError, match="--drones: 2 drones are too few: give 3 or more, two that stay"):
        new_system("line5", 2, tmp_path / "two")


def _rows(folder: Path, drones: int) -> tuple[list[float], list[bool]]:
    with read_system(folder) as structure:
        starts = {one.name: one.start_values for one in check(structure).instances}
    numbers = range(1, drones + 1)
    east = [float(starts[f"drone{n}.vehicle"]["position_start[2]"]) for n in numbers]
    return east, [bool(starts[f"drone{n}.agent"]["stubborn"]) for n in numbers]


def test_neighbours_start_as_far_apart_as_asked(fmus: Path, tmp_path: Path) -> None:
    east, stays = _rows(new_system("line", 50, tmp_path / "line", fmus=fmus, spacing=10.0), 50)
    gaps = np.diff(east)
    assert set(gaps) == {10.0, 20.0}
    assert [i for i, gap in enumerate(gaps) if gap == 20.0] == [i - 1 for i in range(1, 50) if stays[i]]
    sections = np.diff(np.flatnonzero(stays))
    assert stays[0] and stays[-1] and (sections.min(), sections.max(), sections.sum()) == (4, 5, 49)


@pytest.mark.parametrize("drones", [3, 4, 6, 7, 11, 50])
def test_the_note_tells_the_rate_of_the_law(fmus: Path, tmp_path: Path, drones: int) -> None:
    """Against the law carried out step by step on the positions that were written."""
    notes: list[str] = []
    folder = new_system("line", drones, tmp_path / "line", fmus=fmus, spacing=10.0, note=notes.append)
    (text,) = notes
    east, stays = _rows(folder, drones)
    x, error = np.array(east), []
    held = np.flatnonzero(stays)
    even = np.interp(np.arange(drones), held, x[held])
    for _ in range(200):
        error.append(float(np.linalg.norm(x - even)))
        moved = x[1:-1] + (x[:-2] + x[2:] - 2 * x[1:-1]) / 3.0
        x[1:-1] = np.where(stays[1:-1], x[1:-1], moved)
    told = re.search(r"leaves at most ([0-9.]+) of the error, ([0-9]+) steps leave 5 % \(at ([0-9]+) s\)", text)
    assert told is not None, text
    ratios = [after / before for before, after in itertools.pairwise(error) if before > 1e-9]
    assert max(ratios) <= float(told[1]) + 6e-4
    assert ratios[-1] == pytest.approx(float(told[1]), abs=1e-3)
    steps = int(told[2])
    assert error[steps] <= 0.05 * error[0]
    assert int(told[3]) == round(25.0 + steps * 3.1875)
    with read_system(folder) as structure:
        assert structure.stop_time == -(-(25.0 + steps * 3.1875) // 10) * 10
    assert text.startswith("drones start 10 m apart, 20 m before one that stays, and spread to ")


def test_a_grid_is_lines_beside_each_other(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("grid", 11, tmp_path / "grid", fmus=fmus, spacing=20.0)
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
    starts = {i.name: i.start_values for i in checked.instances}
    north = [starts[f"drone{n}.vehicle"]["position_start[1]"] for n in range(1, 12)]
    assert north == [0.0] * 4 + [20.0] * 4 + [40.0] * 3
    stubborn = [n for n in range(1, 12) if starts[f"drone{n}.agent"]["stubborn"]]
    assert stubborn == [1, 4, 5, 8, 9, 11]
    assert ("drone4", "drone5") not in network.links


def test_ids_repeat_where_mavlink_has_no_more_and_neighbours_still_differ(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 252, tmp_path / "long", fmus=fmus)
    with read_system(folder) as structure:
        checked = check(structure)
    agents = [i.start_values for i in checked.instances if i.name.endswith(".agent")]
    assert [a["sysid"] for a in agents[248:]] == [249, 250, 1, 2]
    assert (agents[249]["left_sysid"], agents[249]["right_sysid"]) == (249, 1)
    assert len(checked.instances) == 756


def _processor_time_to_check(folder: Path) -> float:
    began = time.process_time()
    with read_system(folder) as structure:
        ready = prepare(check(structure))
        make_layout(ready.checked, ready.network, ready.recording.signals, ready.master)
    return time.process_time() - began


def test_checking_is_linear_in_the_number_of_drones(fmus: Path, tmp_path: Path) -> None:
    """Eight times the drones take about eight times the work; with one pass over all per instance, 34 times."""
    few = new_system("line", 40, tmp_path / "few", fmus=fmus)
    many = new_system("line", 320, tmp_path / "many", fmus=fmus)
    gc.collect()
    gc.freeze()  # what other tests have left is not looked through for garbage again and again meanwhile
    try:
        small = min(_processor_time_to_check(few) for _ in range(3))
        large = min(_processor_time_to_check(many) for _ in range(2))
    finally:
        gc.unfreeze()
    assert large / small < 16.0


def test_a_new_line_flies_and_spreads(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 4, tmp_path / "line", fmus=fmus, spacing=12.0)
    result = simulate(folder, RunOptions(out=tmp_path / "out", until=60.0, record=["*.vehicle.position*"]))
    assert result.outcome == "done"
    table = pq.read_table(tmp_path / "out" / "signals.parquet")
    assert table.num_columns == 1 + 4 * 3
    east = np.array([table[f"drone{n}.vehicle.position[2]"].to_numpy()[-1] for n in range(1, 5)])
    assert east == pytest.approx([0.0, 16.0, 32.0, 48.0], abs=0.6)


def test_all_problems_of_a_request_at_once(tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        new_system("line", 2, tmp_path, fmus=tmp_path / "nowhere", spacing=0.0, layout="star")
    text = str(caught.value)
    assert "--drones: 2 drones are too few: give 3 or more" in text
    assert "exists already" in text
    assert "--spacing: 0 m: must be positive" in text
    assert "star: is not a layout; valid: line, grid, ring, v, random, or a CSV file" in text
    for name in ("Quadrotor", "Autopilot", "LineAgent"):
        assert text.count(f"{name}.fmu") == 1
        assert f"{name}.fmu: no such file; try uav-cosim build {name}" in text
    with pytest.raises(SystemDescriptionError, match=r"^rings: is not a scenario; valid: line, grid, .*line5, "):
        new_system("rings", 2, tmp_path / "new")
    with pytest.raises(SystemDescriptionError) as caught:  # of a scenario with FMUs of its own
        new_system("line5", 0, tmp_path / "new", fmus=tmp_path / "nowhere")
    few, folder = str(caught.value).splitlines()
    assert few == "--drones: 0 drones are too few: give 1 or more"
    assert folder == f"{tmp_path / 'nowhere'}: no such folder; --fmus is the folder of the FMUs of models"


def test_fmus_must_declare_what_a_new_system_sets(fmus: Path, tmp_path: Path) -> None:
    folder = tmp_path / "fmus"
    folder.mkdir()
    for model in ("Quadrotor", "Autopilot", "LineAgent"):
        with zipfile.ZipFile(fmus / f"{model}.fmu") as old, zipfile.ZipFile(folder / f"{model}.fmu", "w") as new:
            for item in old.namelist():
                text = old.read(item)
                if item == "modelDescription.xml":
                    text = re.sub(rb"<(/?)(StartPosition|Formation)\b", rb"<\1Unknown", text)
                new.writestr(item, text)
    with pytest.raises(SystemDescriptionError) as caught:
        new_system("line", 3, tmp_path / "line", fmus=folder)
    assert (
        str(caught.value)
        .splitlines()[-1]
        .endswith(
            "Quadrotor.fmu, Autopilot.fmu, LineAgent.fmu must declare one StartPosition and one Formation (with two "
            "neighbours, stays, begin and period) (docs/verdict.md); build them anew"
        )
    )
    assert not (tmp_path / "line").exists()


_LIBCOSIM = """
import os
import sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
execution = CosimExecution.from_ssp_file(sys.argv[1], 2_500_000)
observer = CosimObserver.create_last_value()
assert execution.add_observer(observer)
for _ in range(4):
    assert execution.step()
for simulator in ("vehicle", "autopilot"):
    slave = execution.slave_index_from_instance_name(simulator)
    (found,) = [v.reference for v in execution.slave_variables(slave) if v.name.decode() == "specific_force[3]"]
    print("VALUE", repr(float(observer.last_real_values(slave, [found])[0])), flush=True)
os._exit(0)
"""


def test_connectors_have_the_types_and_units_of_the_fmus(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 3, tmp_path / "line", fmus=fmus)
    root = etree.parse(str(folder / "drone.ssd")).getroot()
    found = {one.get("name"): one[0] for one in root.iter("{*}Connector")}
    typed = {name: (etree.QName(one).localname, one.get("unit"), one.get("name")) for name, one in found.items()}
    assert typed["motor[1]"] == ("Real", None, None)
    assert typed["velocity[2]"] == ("Real", "m/s", None)
    assert typed["airframe"] == ("Enumeration", None, "airframe")
    assert {one.get("name") for one in root.iter("{*}Unit")} == {"m", "m/s", "m/s2", "rad/s"}
    airframes = ["quad_x", "hexa_x", "octa_x", "y6", "point_mass", "rover", "boat", "plane", "quad_plus", "quadplane"]
    assert [one.get("name") for one in root.iter("{*}Item")] == airframes
    assert typed["adds_wind"] == ("Boolean", None, None)
    for name in ("adds_wind", "added_wind[1]", "added_wind[2]", "added_wind[3]"):  # line5 does without
        del found[name]
    shipped = etree.parse(str(ROOT / "master/systems/line5/drone.ssd")).getroot()
    assert {one.get("name"): etree.tostring(one[0], method="c14n") for one in shipped.iter("{*}Connector")} == {
        name: etree.tostring(one, method="c14n") for name, one in found.items()
    }


@needs_libcosim
def test_libcosim_reads_a_drone(fmus: Path, tmp_path: Path) -> None:
    """Without the one Enumeration, a type of connectors that libcosim has not."""
    text = (new_system("line", 3, tmp_path / "line", fmus=fmus) / "drone.ssd").read_text()
    (tmp_path / "resources").mkdir()
    for model in ("Quadrotor", "Autopilot", "LineAgent"):
        shutil.copyfile(fmus / f"{model}.fmu", tmp_path / "resources" / f"{model}.fmu")
        text = re.sub(rf'source="[^"]*/{model}\.fmu"', f'source="resources/{model}.fmu"', text)
    text = re.sub(r'<ssd:Connector name="airframe".*?</ssd:Connector>', "", text, flags=re.DOTALL)
    text = re.sub(r'<ssd:Connection [^>]*"airframe"/>', "", text)
    (tmp_path / "SystemStructure.ssd").write_text(text)
    done = subprocess.run([sys.executable, "-c", _LIBCOSIM, str(tmp_path)], capture_output=True, text=True, check=False)
    values = [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("VALUE ")]
    assert len(values) == 2, done.stdout + done.stderr
    sent, received = values  # the input is that of the step before; the drone stands
    assert sent == pytest.approx(received, rel=1e-14)
    assert sent == pytest.approx(-9.81, abs=0.02)


def test_a_value_that_was_for_another_law_is_told(fmus: Path, tmp_path: Path) -> None:
    notes: list[str] = []
    fleet = {"agent": ("Coverage",), "vehicle": ("Hexarotor",)}
    new_system("rendezvous", 5, tmp_path / "covers", fmus=fmus, fleet=fleet, note=notes.append)
    text = "agent.gain stays 0.1, as rendezvous has it; Coverage.fmu alone has 0.5"
    assert [one for one in notes if " stays " in one] == [text]


def test_values_that_another_law_lacks_are_left_out_and_told(fmus: Path, tmp_path: Path) -> None:
    """As an own law without the parameters of the scenario's: its system is without findings, and so is each kind."""
    notes: list[str] = []
    law = tmp_path / "Plain.fmu"
    with zipfile.ZipFile(fmus / "Rendezvous.fmu") as old, zipfile.ZipFile(law, "w") as new:
        for item in old.infolist():
            data = old.read(item)
            if item.filename == "modelDescription.xml":
                data = data.replace(b'name="gain"', b'name="boldness"')
            new.writestr(item, data)
    fleet = {"agent": (str(law), "Rendezvous")}
    folder = new_system("rendezvous", 4, tmp_path / "plain", fmus=fmus, fleet=fleet, note=notes.append)
    text = "agent.gain of the template is left out: Plain.fmu has no such parameter"
    assert [one for one in notes if "left out" in one] == [text]
    with read_system(folder) as structure:
        checked = check(structure)
    assert not checked.unmatched
    starts = {one.name: one.start_values for one in checked.instances}
    assert ["gain" in starts[f"drone{n}.agent"] for n in (1, 2, 3, 4)] == [False, True, False, True]
    assert starts["drone1.agent"].keys() == starts["drone2.agent"].keys() - {"gain"}
    with pytest.raises(SystemDescriptionError) as caught:
        swap("rendezvous", "drone*.agent", law, tmp_path / "swapped")
    told = str(caught.value).splitlines()
    assert 'Plain.fmu has no parameter for "drone1.agent.gain"' in told[0]
    assert re.fullmatch(
        r".*rendezvous: take these values out of the system, or write a new one, which leaves them out: "
        rf"uav-cosim new \S*rendezvous --drones [0-9]+ --agent {re.escape(str(law))} -o FOLDER",
        told[-1],
    )
