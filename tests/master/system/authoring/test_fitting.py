"""FMUs that declare their values fit others or do not; those of a folder that fit are found."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cosim.verdict import Values
from cosim_master.fmi.description.read import describe, mentions
from cosim_master.system import shipped
from cosim_master.system.authoring import fitting
from cosim_master.system.authoring.fitting import companions, misfits
from cosim_master.system.authoring.swap import swap
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.verdict.prior import known_before
from tests.scenarios.flights import SYSTEMS


def fmu(causality: str, *values: int) -> Any:
    """The description of an FMU with the port `kind`; without values it declares none."""
    verdicts = {"kind": Values(values)} if values else {}
    return SimpleNamespace(verdicts=verdicts, variables={"kind": SimpleNamespace(causality=causality)})


def system(*ends: tuple[str, str]) -> Any:
    return SimpleNamespace(
        connections=[
            SimpleNamespace(start_element=a, start_connector="kind", end_element=b, end_connector="kind")
            for a, b in ends
        ]
    )


@pytest.mark.parametrize("ends", [("body", "brain"), ("brain", "body")])  # a connection may be written from either end
@pytest.mark.parametrize(
    ("offered", "accepted", "fits"),
    [((6,), (6, 7), True), ((6,), (1, 2), False), ((1, 6), (6,), False), ((), (1,), True), ((6,), (), True)],
)
def test_an_input_fits_if_it_accepts_every_value(
    ends: tuple[str, str], offered: tuple[int, ...], accepted: tuple[int, ...], fits: bool
) -> None:
    fmus = {"body": fmu("output", *offered), "brain": fmu("input", *accepted)}
    expected = [] if fits else [("brain", "kind", offered, "body")]
    assert list(misfits(system(ends), fmus)) == expected


def test_what_has_no_fmu_is_not_considered() -> None:
    assert list(misfits(system(("body", "brain")), {"body": fmu("output", 6)})) == []


def test_without_an_fmu_that_fits_everything_stays(tmp_path: Path) -> None:
    fmus = {"body": fmu("output", 6), "brain": fmu("input", 1)}
    (tmp_path / "Broken.fmu").write_bytes(b"not an archive")
    assert companions(system(("body", "brain")), fmus, ["body"], [tmp_path]) == {}


def test_those_that_were_given_stay() -> None:
    fmus = {"body": fmu("output", 6), "brain": fmu("input", 1)}
    assert companions(system(("body", "brain")), fmus, ["body", "brain"], []) == {}
    assert companions(system(("body", "brain")), fmus, ["brain"], []) == {}


def test_the_fmu_that_accepts_a_vehicle_is_found(fmus: Path) -> None:
    port = SimpleNamespace(start_element="body", start_connector="airframe")
    port.end_element, port.end_connector = "brain", "airframe"
    parts: dict[str, Any] = {"body": fmu("output"), "brain": fmu("input")}
    for one, causality, value in ((parts["body"], "output", 6), (parts["brain"], "input", 1)):
        one.verdicts, one.variables = {"airframe": Values((value,))}, {"airframe": SimpleNamespace(causality=causality)}
    found = companions(SimpleNamespace(connections=[port]), parts, ["body"], [fmus])
    assert {name: one.path.name for name, one in found.items()} == {"brain": "RoverAutopilot.fmu"}


def test_only_fmus_that_mention_the_input_are_read(fmus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names that may be escaped in a description are no reason to leave an FMU out."""
    read: list[str] = []
    monkeypatch.setattr(fitting, "describe", lambda file: read.append(file.stem) or describe(file))
    found = fitting._fitting("airframe", {6}, {"airframe"}, [fmus])
    assert found is not None and found.path.stem == "RoverAutopilot"
    assert "RoverAutopilot" in read and "Rover" in read
    assert not {"Airspace", "LargeAirspace", "LineAgent"} & {*read}
    assert mentions(fmus / "LineAgent.fmu", "target<1>") and not mentions(fmus / "LineAgent.fmu", "airframe")


@pytest.mark.parametrize(
    ("name", "text", "there"),
    [
        ("body", '<ScalarVariable name="body"/>', True),
        ("body", "<ScalarVariable\n\tname = 'body'/>", True),
        ("body", '<ScalarVariable quantityname="body" name="other"/>', False),
        ("body", "<ScalarVariable name=\"body'/>", False),
        ("body", '<ScalarVariable name="bodyname" description="body"/>', False),
        ("body", '<A displayname="body"/><B name="body"/>', True),
        ("body", 'name="body"', False),
        # An element is one of its array.
        ("body[1]", '<ScalarVariable name="body[1]"/>', True),
        ("body[1]", "<Float64 name='body'/>", True),
        ("body[1]", '<ScalarVariable name="bodyname[1]"/>', False),
        ("body[1]", '<ScalarVariable name="other[1]" description="body[1]"/>', False),
    ],
)
def test_a_name_is_an_attribute(name: str, text: str, there: bool, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "one.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
    assert mentions(tmp_path / "one.fmu", name) is there


def test_a_shipped_model_that_accepts_a_vehicle_is_built(
    fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clone in which only line5's FMUs exist, as after `make demo`."""
    (tmp_path / "fmus").mkdir()
    for name in (*shipped.models("line5"), "Rover"):
        shutil.copyfile(fmus / f"{name}.fmu", tmp_path / "fmus" / f"{name}.fmu")
    (tmp_path / "master").mkdir()
    (tmp_path / "master" / "systems").symlink_to(SYSTEMS)
    monkeypatch.setattr(shipped, "_root", lambda: tmp_path)
    monkeypatch.chdir(tmp_path)  # its folder fmus is searched, too
    told: list[str] = []
    swap("line5", "drone3.vehicle", "Rover", tmp_path / "swapped", told.append)
    assert told == ["drone3.autopilot is now RoverAutopilot: Autopilot does not accept Rover"]
    assert (tmp_path / "fmus" / "RoverAutopilot.fmu").is_file()


def test_without_an_fmu_that_accepts_it_swap_and_check_say_so(fmus: Path, tmp_path: Path) -> None:
    """A rover's autopilot under a quadrotor that stays: the autopilot was the one that was given."""
    told: list[str] = []
    system = swap(SYSTEMS / "line5", "drone3.autopilot", fmus / "RoverAutopilot.fmu", tmp_path / "swapped", told.append)
    assert told == ["drone3.autopilot does not accept Quadrotor, and no FMU that does is found"]
    with read_system(system) as structure:
        checked = check(structure)
        (found,) = [one for one in known_before(checked, network_of(checked)) if one.kind == "not accepted"]
    assert found.severity == "warning"
    assert found.who == ("drone3.autopilot.airframe", "drone3.vehicle.airframe")
    assert found.text == (
        "drone3.autopilot.airframe accepts rover, boat, and drone3.vehicle.airframe is quad_x: swap one of the two FMUs"
    )
