"""Systems by name, in a source tree and from an installed wheel."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cosim_master import shipped
from cosim_master.edit import swap
from cosim_master.errors import SystemDescriptionError
from cosim_master.ssp import read_system
from cosim_master.system import Component

ROOT = Path(__file__).parents[2]


def test_a_system_has_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with read_system("line5") as structure:
        assert structure.name == "line5"
        assert structure.path == ROOT / "master" / "systems" / "line5"
    assert shipped.names() == (
        "line5",
        "line5-ardupilot",
        "line5-ends",
        "line5-estimated",
        "line5-hexa",
        "line5-script",
    )


def test_a_folder_of_this_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line5").mkdir()
    with pytest.raises(SystemDescriptionError, match=r"line5/SystemStructure\.ssd: no such file"):
        read_system("line5")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lin5", r'lin5: no such file or folder; give .* a shipped system \(did you mean "line5"\?\)'),
        ("tanks", r'shipped system \(valid: "line5", "line5-ardupilot", "line5-ends", '),
    ],
)
def test_a_name_that_is_not_there(name: str, said: str) -> None:
    with pytest.raises(SystemDescriptionError, match=said):
        read_system(name)


def test_an_fmu_has_the_name_of_its_model(fmus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert shipped.fmu("Hexarotor") == fmus / "Hexarotor.fmu"
    assert shipped.fmu("../fmus/Hexarotor") is None
    assert shipped.fmu("Helicopter") is None
    swap("line5", "drone3.vehicle", "Hexarotor", "swapped")
    with read_system("swapped") as structure:
        (drone3,) = [element for element in structure.system.elements if element.name == "drone3"]
        assert isinstance(drone3, Component) and drone3.content is not None
        (vehicle,) = [element for element in drone3.content.elements if element.name == "vehicle"]
        assert isinstance(vehicle, Component) and vehicle.source is not None
        assert vehicle.source == fmus / "Hexarotor.fmu"


def test_a_shipped_system_is_not_changed_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemDescriptionError, match="line5: a shipped system is not changed in place; give a path"):
        swap("line5", "drone3.vehicle", "Hexarotor")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what a pure Python wheel of this tree installs."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for path in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "cosim", "models", "master"):
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(["cp", "-r", ROOT / path, source / path], check=True)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run(
        [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", folder, source], check=True, capture_output=True
    )
    (wheel,) = folder.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_the_wheel_has_these_packages_and_nothing_else(installed: Path) -> None:
    assert sorted(path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")) == [
        "cosim",
        "cosim_master",
        "cosim_models",
    ]
    for package in ("cosim", "cosim_models", "cosim_master"):
        assert (installed / package / "py.typed").is_file()
    assert (installed / "cosim" / "build" / "fmi2.c").is_file()
    assert (installed / "cosim_models" / "presets" / "px4_iris.ssv").is_file()
    systems = installed / "cosim_master" / "shipped" / "master" / "systems"
    here = ROOT / "master" / "systems"
    assert sorted(p.relative_to(systems) for p in systems.rglob("*.ss?")) == sorted(
        p.relative_to(here) for p in here.rglob("*.ss?")
    )


def test_every_python_file_of_the_tree_is_in_the_wheel(installed: Path) -> None:
    for folder in ("cosim", "models/cosim_models", "master/cosim_master"):
        package = ROOT / folder
        for file in package.rglob("*.py"):
            assert (installed / package.name / file.relative_to(package)).is_file(), file
