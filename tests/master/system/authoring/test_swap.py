"""Swapping an FMU: one source changes, everything else stays byte for byte, and it still leads to the same files."""

from __future__ import annotations

import difflib
import re
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim_master.diagnostics.errors import SystemDescriptionError, WriteFailed
from cosim_master.system import shipped
from cosim_master.system.authoring.swap import swap
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import read_system

SSD_TYPE = "application/x-ssp-definition"


@pytest.fixture
def system(workshop: Any, variable: Any) -> Path:
    """system/: five drones that share drone.ssd, whose vehicle and autopilot are outside, in fmus/."""
    ports = (variable("motor"), variable("position", "output", unit="m"), variable("mass", "parameter", start="1"))
    workshop.fmu("fmus/Quadrotor.fmu", *ports)
    workshop.fmu("fmus/Hexarotor.fmu", *ports, variable("arms", "parameter"))
    workshop.fmu("fmus/Autopilot.fmu", variable("estimate", unit="m"), variable("motor", "output"))
    vehicle = workshop.component(
        "vehicle", "../../fmus/Quadrotor.fmu", "motor:input position:output", workshop.bindings({"mass": 1.5})
    )
    autopilot = workshop.component("autopilot", "../../fmus/Autopilot.fmu", "estimate:input motor:output")
    wires = workshop.connection("vehicle/position", "autopilot/estimate")
    wires += workshop.connection("autopilot/motor", "vehicle/motor")
    inside = workshop.system(vehicle + "<!-- a comment\n  stays --> " + autopilot, wires, name="drone")
    workshop.ssd("system/parts/drone.ssd", inside)
    drones = "".join(workshop.component(f"drone{i}", "parts/drone.ssd", type=SSD_TYPE) for i in range(1, 6))
    drones += workshop.component("spare", "../fmus/Quadrotor.fmu")
    values = '<ssd:ParameterBindings><ssd:ParameterBinding source="values.ssv"/></ssd:ParameterBindings>'
    workshop.ssd("system/SystemStructure.ssd", workshop.system(drones, bindings=values))
    (workshop.root / "system/values.ssv").write_text(workshop.parameter_set({"drone3.vehicle.mass": 2.0}))
    (workshop.root / "system/readme.txt").write_text("not part of the system")
    made: Path = workshop.root / "system"
    return made


def sources(path: Path) -> dict[str, str]:
    """FMU file name of every instance of a system that checks."""
    with read_system(path) as structure:
        return {instance.name: instance.fmu.path.name for instance in check(structure).instances}


def tree(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def changes(old: bytes, new: bytes) -> list[str]:
    """Added and removed lines."""
    lines = difflib.unified_diff(old.decode().splitlines(), new.decode().splitlines(), n=0, lineterm="")
    return [line for line in lines if line[0] in "+-" and not line.startswith(("+++", "---"))]


_LINE5 = Path(__file__).parents[4] / "master" / "systems" / "line5"


def refusal(*arguments: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        swap(*arguments)
    return str(caught.value)


class TestIntoANewFolder:
    def test_one_drone_of_five(self, system: Path, workshop: Any) -> None:
        before = tree(system)
        out = workshop.root / "new" / "deep" / "swapped"
        assert swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", out) == out
        assert tree(system) == before
        found = sources(out)
        assert found["drone3.vehicle"] == "Hexarotor.fmu"
        assert [found[f"drone{i}.vehicle"] for i in (1, 2, 4, 5)] == ["Quadrotor.fmu"] * 4
        assert set(found.values()) == {"Hexarotor.fmu", "Quadrotor.fmu", "Autopilot.fmu"}
        with read_system(out) as structure:
            values = {i.name: i.start_values for i in check(structure).instances}
        assert values["drone3.vehicle"] == {"mass": 2.0} and values["drone1.vehicle"] == {"mass": 1.5}

    def test_nothing_else_changes(self, system: Path, workshop: Any) -> None:
        out = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "swapped")
        old, new = tree(system), tree(out)
        assert set(new) == {*old, "parts/drone-drone3.ssd"}
        assert {name for name in old if new[name] != old[name]} == {"SystemStructure.ssd"}
        root = changes(old["SystemStructure.ssd"], new["SystemStructure.ssd"])
        assert [re.sub(r'source="[^"]*"', 'source=""', line[1:]) for line in root] == [
            f'<ssd:Component name="drone3" source="" type="{SSD_TYPE}">'
        ] * 2
        copy = changes(old["parts/drone.ssd"], new["parts/drone-drone3.ssd"])
        assert len(copy) == 2 and "../../fmus/Hexarotor.fmu" in copy[1]

    def test_sources_that_lead_out_are_rebased(self, system: Path, workshop: Any) -> None:
        out = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "a/b/c")
        assert b'source="../../../../fmus/Autopilot.fmu"' in (out / "parts/drone.ssd").read_bytes()
        assert b'source="../../../fmus/Quadrotor.fmu"' in (out / "SystemStructure.ssd").read_bytes()

    def test_a_component_at_the_top(self, system: Path, workshop: Any) -> None:
        out = swap(system, "spare", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "swapped")
        assert sources(out)["spare"] == "Hexarotor.fmu"
        assert set(tree(out)) == set(tree(system))
        assert tree(out)["parts/drone.ssd"] == tree(system)["parts/drone.ssd"]

    def test_of_a_single_ssd_only_what_it_needs(self, system: Path, workshop: Any) -> None:
        (system / "SystemStructure.ssd").rename(system / "mine.ssd")
        out = swap(system / "mine.ssd", "drone1.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "x/y")
        assert set(tree(out)) == {"SystemStructure.ssd", "parts/drone.ssd", "parts/drone-drone1.ssd", "values.ssv"}
        assert sources(out)["drone1.vehicle"] == "Hexarotor.fmu"

    def test_a_shared_ssd_outside_of_the_folder_is_not_touched(self, system: Path, workshop: Any) -> None:
        (system / "parts").rename(workshop.root / "parts")
        outside = workshop.root / "parts/drone.ssd"
        outside.write_text(outside.read_text().replace("../../fmus", "../fmus"))
        root = system / "SystemStructure.ssd"
        root.write_text(root.read_text().replace('"parts/', '"../parts/'))
        before = outside.read_bytes()
        out = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "a/swapped")
        assert outside.read_bytes() == before
        assert sources(out)["drone3.vehicle"] == "Hexarotor.fmu" and sources(out)["drone2.vehicle"] == "Quadrotor.fmu"
        assert (out / "drone-drone3.ssd").is_file()

    def test_twice(self, system: Path, workshop: Any) -> None:
        once = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "once")
        twice = swap(once, "drone3.vehicle", workshop.root / "fmus/Quadrotor.fmu", workshop.root / "twice")
        assert set(tree(twice)) == set(tree(once))
        assert sources(twice) == sources(system)

    def test_names_that_need_escapes(self, system: Path, workshop: Any) -> None:
        odd = workshop.root / "fmus/a b&'ä%.fmu"
        (workshop.root / "fmus/Hexarotor.fmu").rename(odd)
        out = swap(system, "drone3.vehicle", odd, workshop.root / "new <one>")
        assert sources(out)["drone3.vehicle"] == odd.name


class TestInPlace:
    def test_a_folder(self, system: Path, workshop: Any) -> None:
        before = tree(system)
        assert swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu") == system
        after = tree(system)
        assert set(after) == {*before, "parts/drone-drone3.ssd"}
        assert after["parts/drone.ssd"] == before["parts/drone.ssd"]
        assert sources(system)["drone3.vehicle"] == "Hexarotor.fmu"

    def test_an_ssd_that_is_not_shared(self, system: Path, workshop: Any) -> None:
        root = system / "SystemStructure.ssd"
        kept = re.sub(r'<ssd:Component name="drone[1245]".*?</ssd:Component>\n', "", root.read_text(), flags=re.S)
        root.write_text(kept)
        before = tree(system)
        swap(system / "SystemStructure.ssd", "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        after = tree(system)
        assert {name for name in after if after[name] != before.get(name)} == {"parts/drone.ssd"}

    def test_a_second_copy_gets_another_name(self, system: Path, workshop: Any) -> None:
        (system / "parts/drone-drone3.ssd").write_text("taken")
        swap(system / "SystemStructure.ssd", "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        assert (system / "parts/drone-drone3.ssd").read_text() == "taken"
        assert sources(system)["drone3.vehicle"] == "Hexarotor.fmu"

    def test_the_fmu_it_has_already(self, system: Path, workshop: Any) -> None:
        swap(system, "drone3.vehicle", workshop.root / "fmus/Quadrotor.fmu")
        assert set(sources(system).values()) == {"Quadrotor.fmu", "Autopilot.fmu"}

    def test_an_old_fmu_that_is_gone(self, system: Path, workshop: Any, variable: Any) -> None:
        ports = (variable("motor"), variable("position", "output", unit="m"))
        workshop.fmu("fmus/Spare.fmu", *ports)
        root = system / "SystemStructure.ssd"
        root.write_text(root.read_text().replace("../fmus/Quadrotor.fmu", "../fmus/Gone.fmu"))
        swap(system, "spare", workshop.root / "fmus/Spare.fmu")
        assert sources(system)["spare"] == "Spare.fmu"

    def test_latin_1_and_single_quotes(self, system: Path, workshop: Any) -> None:
        text = (
            (system / "SystemStructure.ssd")
            .read_text()
            .replace("UTF-8", "ISO-8859-1")
            .replace('name="test"', 'name="t\xe4st"')
            .replace(
                'source="../fmus/Quadrotor.fmu"', "description = '>source=\"x\"'\n\tsource\n=\n '../fmus/Quadrotor.fmu'"
            )
        )
        (system / "SystemStructure.ssd").write_bytes(text.encode("latin-1"))
        swap(system, "spare", workshop.root / "fmus/Hexarotor.fmu")
        expected = text.replace("'../fmus/Quadrotor.fmu'", "'../fmus/Hexarotor.fmu'").encode("latin-1")
        assert (system / "SystemStructure.ssd").read_bytes() == expected


class TestPatterns:
    def test_all_users_of_a_document_change_it_itself(self, system: Path, workshop: Any) -> None:
        out = swap(system, "drone*.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "swapped")
        old, new = tree(system), tree(out)
        assert set(new) == set(old)
        assert [name for name in old if new[name] != old[name]] == ["parts/drone.ssd"]
        assert len(changes(old["parts/drone.ssd"], new["parts/drone.ssd"])) == 2
        found = sources(out)
        assert [found[f"drone{i}.vehicle"] for i in range(1, 6)] == ["Hexarotor.fmu"] * 5
        assert found["spare"] == "Quadrotor.fmu"

    def test_some_users_share_one_copy(self, system: Path, workshop: Any) -> None:
        root = system / "SystemStructure.ssd"
        root.write_text(
            root.read_text().replace('name="drone2"', 'name="big2"').replace('name="drone4"', 'name="big4"')
        )
        before = tree(system)
        assert swap(system, "big?.vehicle", workshop.root / "fmus/Hexarotor.fmu") == system
        after = tree(system)
        assert set(after) == {*before, "parts/drone-big2.ssd"}
        assert after["parts/drone.ssd"] == before["parts/drone.ssd"]
        assert len(changes(before["SystemStructure.ssd"], after["SystemStructure.ssd"])) == 4
        found = sources(system)
        assert {name for name, fmu in found.items() if fmu == "Hexarotor.fmu"} == {"big2.vehicle", "big4.vehicle"}

    def test_two_levels(self, system: Path, workshop: Any) -> None:
        """Two wings of two drones each: wing.ssd refers to drone.ssd twice."""
        pair = "".join(workshop.component(f"d{i}", "parts/drone.ssd", type=SSD_TYPE) for i in (1, 2))
        workshop.ssd("system/wing.ssd", workshop.system(pair, name="wing"))
        wings = "".join(workshop.component(name, "wing.ssd", type=SSD_TYPE) for name in ("left", "right"))
        workshop.ssd("system/SystemStructure.ssd", workshop.system(wings))
        hexarotor = workshop.root / "fmus/Hexarotor.fmu"
        before = set(tree(system))

        def new(name: str, pattern: str) -> tuple[set[str], set[str]]:
            out = swap(system, pattern, hexarotor, workshop.root / name)
            swapped = {one for one, fmu in sources(out).items() if fmu == "Hexarotor.fmu"}
            return set(tree(out)) - before, swapped

        assert new("all", "*.vehicle") == (
            set(),
            {f"{wing}.d{i}.vehicle" for wing in ("left", "right") for i in (1, 2)},
        )
        assert new("firsts", "*.d1.vehicle") == ({"parts/drone-left.d1.ssd"}, {"left.d1.vehicle", "right.d1.vehicle"})
        assert new("left", "left.*.vehicle") == (
            {"parts/drone-left.d1.ssd", "wing-left.d1.ssd"},
            {"left.d1.vehicle", "left.d2.vehicle"},
        )

    def test_a_pattern_that_matches_nothing(self, system: Path, workshop: Any) -> None:
        text = refusal(system, "drone*.vehicel", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "x")
        assert '"drone*.vehicel" matches no component that is an FMU; did you mean "drone*.vehicle"?' in text
        assert not (workshop.root / "x").exists()

    def test_a_pattern_whose_components_do_not_all_fit(self, system: Path, workshop: Any) -> None:
        text = refusal(system, "drone1.*", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "x")
        assert "estimate" in text and "Hexarotor.fmu" in text


class TestArchives:
    def test_a_folder_into_an_ssp_takes_everything_in(self, system: Path, workshop: Any) -> None:
        out = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "out/s.ssp")
        with zipfile.ZipFile(out) as archive:
            names = set(archive.namelist())
        assert names == {
            "SystemStructure.ssd",
            "parts/drone.ssd",
            "parts/drone-drone3.ssd",
            "values.ssv",
            "readme.txt",
            "resources/Quadrotor.fmu",
            "resources/Hexarotor.fmu",
            "resources/Autopilot.fmu",
        }
        for fmu in (workshop.root / "fmus").iterdir():
            fmu.unlink()
        assert sources(out)["drone3.vehicle"] == "Hexarotor.fmu" and sources(out)["drone4.vehicle"] == "Quadrotor.fmu"

    def test_documents_from_outside_are_taken_in_too(self, system: Path, workshop: Any) -> None:
        (system / "parts").rename(workshop.root / "parts")
        outside = workshop.root / "parts/drone.ssd"
        outside.write_text(outside.read_text().replace("../../fmus", "../fmus"))
        root = system / "SystemStructure.ssd"
        root.write_text(root.read_text().replace('"parts/', '"../parts/'))
        out = swap(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "out.ssp")
        for path in (outside, *(workshop.root / "fmus").iterdir()):
            path.unlink()
        found = sources(out)
        assert found["drone3.vehicle"] == "Hexarotor.fmu" and found["drone1.vehicle"] == "Quadrotor.fmu"

    def test_an_fmu_that_is_in_the_archive_already(self, system: Path, workshop: Any) -> None:
        path = self.packed(system, workshop)
        swap(path, "drone3.vehicle", workshop.root / "fmus/Quadrotor.fmu")
        with zipfile.ZipFile(path) as archive:
            assert sum("Quadrotor" in name for name in archive.namelist()) == 1

    def packed(self, system: Path, workshop: Any) -> Path:
        return swap(system, "spare", workshop.root / "fmus/Quadrotor.fmu", workshop.root / "packed.ssp")

    def test_an_ssp_in_place(self, system: Path, workshop: Any) -> None:
        path = self.packed(system, workshop)
        with zipfile.ZipFile(path) as archive:
            before = {name: archive.read(name) for name in archive.namelist()}
        swap(path, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        with zipfile.ZipFile(path) as archive:
            after = {name: archive.read(name) for name in archive.namelist()}
        assert set(after) == {*before, "resources/Hexarotor.fmu", "parts/drone-drone3.ssd"}
        assert {name for name in before if after[name] != before[name]} == {"SystemStructure.ssd"}
        assert sources(path)["drone3.vehicle"] == "Hexarotor.fmu"

    def test_an_ssp_into_a_folder(self, system: Path, workshop: Any) -> None:
        path = self.packed(system, workshop)
        out = swap(path, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "folder")
        assert sources(out)["drone3.vehicle"] == "Hexarotor.fmu"
        assert (out / "resources/Quadrotor.fmu").is_file() and not (out / "resources/Hexarotor.fmu").exists()

    def test_another_fmu_of_the_same_name_does_not_replace_the_first(self, system: Path, workshop: Any) -> None:
        path = self.packed(system, workshop)
        other = workshop.root / "other"
        other.mkdir()
        (workshop.root / "fmus/Hexarotor.fmu").rename(other / "Quadrotor.fmu")
        swap(path, "drone3.vehicle", other / "Quadrotor.fmu")
        assert sources(path)["drone3.vehicle"] == "Quadrotor-2.fmu" and sources(path)["spare"] == "Quadrotor.fmu"

    def test_an_ssp_inside(self, system: Path, workshop: Any) -> None:
        self.packed(system, workshop)
        component = workshop.component("swarm", "packed.ssp", type="application/x-ssp-package")
        path = workshop.ssd("outer.ssd", workshop.system(component))
        text = refusal(path, "swarm.drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        assert '"swarm.drone3.vehicle" is inside the archive of "swarm"; unpack it to a folder' in text

    def test_the_same_bytes_again(self, system: Path, workshop: Any) -> None:
        made = [
            swap(system, "spare", workshop.root / "fmus/Hexarotor.fmu", workshop.root / f"{i}/s.ssp").read_bytes()
            for i in range(2)
        ]
        assert made[0] == made[1]


class TestWhatIsRefused:
    def test_unknown_component(self, system: Path, workshop: Any) -> None:
        text = refusal(system, "drone3.vehicel", workshop.root / "fmus/Hexarotor.fmu")
        assert 'there is no component "drone3.vehicel"; did you mean "drone3.vehicle"' in text

    def test_a_system(self, system: Path, workshop: Any) -> None:
        text = refusal(system, "drone3", workshop.root / "fmus/Hexarotor.fmu")
        assert '"drone3" is a system, not an FMU; ' in text and '"drone3.vehicle"' in text

    def test_a_missing_fmu(self, system: Path, workshop: Any) -> None:
        assert "Octo.fmu: no such file" in refusal(system, "drone3.vehicle", workshop.root / "Octo.fmu")

    def test_a_model_that_is_written_in_another_way(self, system: Path, workshop: Any, fmus: Path) -> None:
        assert fmus.is_dir()
        text = refusal(system, "drone3.vehicle", "hexarotor", workshop.root / "swapped")
        assert text == 'hexarotor: no such file; did you mean "Hexarotor"?'

    def test_a_place_that_is_taken(self, system: Path, workshop: Any) -> None:
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "fmus")
        assert "fmus: exists already" in text

    def test_a_place_that_cannot_be_written(self, system: Path, workshop: Any) -> None:
        hexarotor = workshop.root / "fmus/Hexarotor.fmu"
        with pytest.raises(WriteFailed, match=r"Hexarotor\.fmu/in/swapped: cannot be written: Not a directory$"):
            swap(system, "drone3.vehicle", hexarotor, hexarotor / "in" / "swapped")

    def test_an_fmu_that_does_not_fit_names_every_mismatch(self, system: Path, workshop: Any, variable: Any) -> None:
        workshop.fmu("fmus/Bad.fmu", variable("motor", kind="Boolean"), variable("position", "output", unit="s"))
        before = tree(system)
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Bad.fmu", workshop.root / "swapped")
        assert (
            "drone3" not in tree(workshop.root) and tree(system) == before and not (workshop.root / "swapped").exists()
        )
        assert "autopilot.motor is Real and vehicle.motor is Boolean" in text
        assert 'vehicle.position to autopilot.estimate: unit "s" (s) cannot be converted to "m" (m)' in text

    def test_an_fmu_of_another_kind_is_refused_in_one_sentence(self, fmus: Path, tmp_path: Path) -> None:
        """Of the 25 connectors of a vehicle, an agent has none."""
        text = refusal(_LINE5, "drone3.vehicle", fmus / "LineAgent.fmu", tmp_path / "swapped")
        assert re.fullmatch(
            r".*drone\.ssd:\d+: LineAgent\.fmu lacks 25 of the 25 connectors of this component: motor, position, "
            r"velocity, attitude, angular_velocity, specific_force, airframe; FMUs that have all: (.*)",
            text,
        )
        assert text.rpartition(": ")[2].split(", ") == [
            *("Boat", "FixedWing", "Hexarotor", "LinearQuadrotor", "Octorotor", "PointMass", "Quadplane"),
            *("Quadrotor", "Rover", "Y6"),
        ]
        assert not (tmp_path / "swapped").exists()

    def test_a_missing_port_and_a_missing_parameter(self, system: Path, workshop: Any, variable: Any) -> None:
        workshop.fmu("fmus/Short.fmu", variable("motors"), variable("position", "output", unit="m"))
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Short.fmu")
        assert 'Short.fmu has no variable "motor"; did you mean "motors"?' in text
        workshop.fmu("fmus/Light.fmu", variable("motor"), variable("position", "output", unit="m"))
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Light.fmu")
        assert text.count('Light.fmu has no parameter for "drone3.vehicle.mass"') == 2
        assert re.search(r"values\.ssv:\d+: Light", text) and re.search(r"drone\.ssd:\d+: Light", text)

    def test_a_system_that_is_wrong_elsewhere(self, system: Path, workshop: Any) -> None:
        (workshop.root / "fmus/Autopilot.fmu").unlink()
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "swapped")
        assert "Autopilot.fmu" in text and not (workshop.root / "swapped").exists()

    def test_a_source_that_is_no_path(self, system: Path, workshop: Any) -> None:
        root = system / "SystemStructure.ssd"
        root.write_text(root.read_text().replace("../fmus/Quadrotor.fmu", "#drone1"))
        assert "selects a part of its target" in refusal(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        swap(system, "spare", workshop.root / "fmus/Hexarotor.fmu")
        assert sources(system)["spare"] == "Hexarotor.fmu"

    def test_utf_16(self, system: Path, workshop: Any) -> None:
        root = system / "SystemStructure.ssd"
        root.write_bytes(root.read_text().replace("UTF-8", "UTF-16").encode("utf-16"))
        assert "is not encoded in UTF-8" in refusal(system, "spare", workshop.root / "fmus/Hexarotor.fmu")

    def test_two_elements_of_one_hierarchical_name(self, system: Path, workshop: Any) -> None:
        root = system / "SystemStructure.ssd"
        root.write_text(root.read_text().replace('name="spare"', 'name="drone3.vehicle"'))
        text = refusal(system, "drone3.vehicle", workshop.root / "fmus/Hexarotor.fmu")
        assert '"drone3.vehicle" names 2 elements' in text


def shape(checked: CheckedSystem) -> Any:
    """Everything a run depends on but the FMU files."""
    return (
        [(i.name, dict(i.start_values), i.step_size) for i in checked.instances],
        [(link.source, link.target, link.factor, link.offset) for link in checked.links],
        checked.init_order,
    )


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_swap_and_back_is_the_same_system(system: Path, workshop: Any, data: st.DataObject) -> None:
    number = len(list(workshop.root.glob("run*")))
    places = [workshop.root / f"run{number}" / name for name in ("a", "b/c.ssp", "d/e/f")]
    current = system
    names = [f"drone{i}.vehicle" for i in range(1, 6)] + ["spare"]
    expected = sources(system)
    with read_system(system) as structure:
        before = shape(check(structure))
    for place in places:
        name = data.draw(st.sampled_from(names))
        file = data.draw(st.sampled_from(["Quadrotor.fmu", "Hexarotor.fmu"]))
        current = swap(current, name, workshop.root / "fmus" / file, place)
        expected[name] = file
        assert sources(current) == expected
    with read_system(current) as structure:
        assert shape(check(structure)) == before


def test_mappings_dictionaries_and_fragments_are_rebased(system: Path, workshop: Any) -> None:
    inside = workshop.ssd("inside.ssd", workshop.system(name="in"))
    packed = workshop.ssp("packed.ssp", {"SystemStructure.ssd": inside, "B.ssd": inside})
    (system.parent / "bus.ssb").write_text(
        '<b:SignalDictionary xmlns:b="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary" version="1.0"/>'
    )
    (system.parent / "map.ssm").write_text(
        '<m:ParameterMapping xmlns:m="http://ssp-standard.org/SSP1/SystemStructureParameterMapping" version="1.0"/>'
    )
    file = system / "SystemStructure.ssd"
    text = file.read_text().replace(
        '<ssd:ParameterBinding source="values.ssv"/>',
        '<ssd:ParameterBinding source="values.ssv"><ssd:ParameterMapping source="../map.ssm"/></ssd:ParameterBinding>',
    )
    more = workshop.component("packed", "../packed.ssp#B.ssd", type="application/x-ssp-package")
    text = text.replace("</ssd:Elements>", more + "</ssd:Elements>")
    bus = '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus" source="../bus.ssb"/></ssd:SignalDictionaries>'
    file.write_text(text.replace("</ssd:System>", bus + "</ssd:System>"))
    written = swap(system, "spare", workshop.root / "fmus/Hexarotor.fmu", workshop.root / "far/away/out")
    assert sources(written)["spare"] == "Hexarotor.fmu" and packed.is_file()
    found = (written / "SystemStructure.ssd").read_text()
    for source in ("../../../map.ssm", "../../../bus.ssb", "../../../packed.ssp#B.ssd", "values.ssv"):
        assert f'source="{source}"' in found


def test_a_system_that_components_share_by_its_id(workshop: Any, variable: Any) -> None:
    workshop.fmu("a.fmu", variable("u"))
    inner = workshop.system(workshop.component("part", "a.fmu"), name="one").replace(
        "<ssd:System ", '<ssd:System id="x" '
    )
    path = workshop.ssd("s.ssd", workshop.system(inner + workshop.component("two", "#x", type=SSD_TYPE)))
    with pytest.raises(SystemDescriptionError, match=r'"two\.part" is inside "#x", which other components share'):
        swap(path, "two.part", workshop.root / "a.fmu")


def test_a_moved_system_says_how_it_is_moved(system: Path, tmp_path: Path) -> None:
    moved = tmp_path / "far" / "away" / "system"
    shutil.copytree(system, moved)
    with pytest.raises(SystemDescriptionError) as caught, read_system(moved) as structure:
        check(structure)
    first = str(caught.value).splitlines()[0]
    assert re.search(r'Quadrotor\.fmu" does not exist: no file ".*Quadrotor\.fmu"; to move a system, make one ', first)
    assert first.endswith("file of it where it runs: uav-cosim pack")
    (system / "values.ssv").unlink()
    with pytest.raises(SystemDescriptionError) as caught, read_system(system) as structure:
        check(structure)
    assert str(caught.value).endswith('no file "' + f'{system / "values.ssv"}"')  # it lies in the system


def test_a_value_that_was_for_the_old_fmu_is_told(fmus: Path, tmp_path: Path) -> None:
    """The laws have a parameter of the same name, and another gain of their own; for others, nothing is said."""
    notes: list[str] = []
    swap("rendezvous", "drone*.agent", fmus / "Coverage.fmu", tmp_path / "covers", notes.append)
    (told,) = [one for one in notes if " stays " in one]
    start, end = "drone1.agent.gain stays 0.1, as ", "rendezvous.ssv:10 has it; Coverage.fmu alone has 0.5"
    assert told.startswith(start) and told.endswith(end)
    notes.clear()
    swap("line5", "drone3.vehicle", fmus / "Hexarotor.fmu", tmp_path / "hexa", notes.append)
    assert not [one for one in notes if " stays " in one]


def test_a_model_is_searched_where_new_searches_it(
    fmus: Path, system: Path, workshop: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the folder fmus, and then among those of the project: of two with one name, the note tells which it is."""
    monkeypatch.chdir(workshop.root)
    monkeypatch.setattr(shipped, "fmus", lambda: fmus)
    shutil.copyfile("fmus/Hexarotor.fmu", "fmus/Blimp.fmu")
    notes: list[str] = []
    assert (
        sources(swap(system, "drone3.vehicle", "Blimp", workshop.root / "one", notes.append))["drone3.vehicle"]
        == "Blimp.fmu"
    )
    assert notes == []
    swapped = swap(system, "drone3.vehicle", "Hexarotor", workshop.root / "other", notes.append)
    with read_system(swapped) as structure:
        used = {one.name: one.fmu.path for one in check(structure).instances}["drone3.vehicle"]
    assert used.samefile(workshop.root / "fmus/Hexarotor.fmu")
    text = "Hexarotor is fmus/Hexarotor.fmu, not the model of this name that comes with uav-cosim"
    assert notes == [f"{text}; give {fmus / 'Hexarotor.fmu'} for it"]
    assert 'did you mean "Blimp"?' in refusal(system, "drone3.vehicle", "Blimb", workshop.root / "third")
