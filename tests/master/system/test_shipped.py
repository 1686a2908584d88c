"""Systems by name, in a source tree and from an installed wheel."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cosim import Model
from cosim.build import models_of_package
from cosim.build.messages import read_dialect
from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.system import shipped
from cosim_master.system.authoring.swap import swap
from cosim_master.system.authoring.swarm.new import new_system
from cosim_master.system.reading.read import read_system
from cosim_master.system.structure import Component
from tests.master.results.test_figures import consensus_run

ROOT = Path(__file__).parents[3]


def test_a_system_has_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with read_system("line5") as structure:
        assert structure.name == "line5"
        assert structure.path == ROOT / "master" / "systems" / "line5"
    assert shipped.names() == (
        "coverage",
        "flocking",
        "flocking-points",
        "follower",
        "formation",
        "guarded",
        "line5",
        "line5-ardupilot",
        "line5-ends",
        "line5-estimated",
        "line5-hexa",
        "line5-points",
        "line5-script",
        "rendezvous",
        "sweep",
        "tracking",
        "windy",
    )


def test_a_folder_of_this_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line5").mkdir()
    with pytest.raises(
        SystemDescriptionError, match=r"line5/SystemStructure\.ssd: no such file; the folder line5 hides"
    ):
        read_system("line5")


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("manifest.json", "no such file; there is the folder of a run: give the system that was run"),
        ("study.json", "no such file; there holds a campaign: try uav-cosim report there"),
        ("own.ssd", "no such file; give one of these: there/own.ssd"),
        ("one/manifest.json", "no such file; there holds results of runs: one"),
        ("other", "no such file"),
    ],
)
def test_a_folder_that_is_no_system(file: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there" / file).parent.mkdir(parents=True)
    (tmp_path / "there" / file).write_text("")
    with pytest.raises(SystemDescriptionError) as caught:
        read_system("there")
    assert str(caught.value) == f"there/SystemStructure.ssd: {said}"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lin5", r'lin5: no such file or folder; give .* a shipped system \(did you mean "line5"\?\)'),
        ("LINE5", r'shipped system \(did you mean "line5"\?\)'),
        ("fmus/Own.fmu", r"^fmus/Own\.fmu: no such file; uav-cosim build makes FMUs"),
        ("tanks", r'shipped system \(valid: "coverage", "flocking", "flocking-points", '),
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


def test_missing_fmus_are_built_when_they_are_needed(
    tmp_path: Path, fmus: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A source tree with the FMUs of line5 alone, as `make demo` leaves it."""
    (tmp_path / "master").mkdir()
    (tmp_path / "master" / "systems").symlink_to(ROOT / "master" / "systems")
    (tmp_path / "fmus").mkdir()
    for model in shipped.models("line5"):
        shutil.copyfile(fmus / f"{model}.fmu", tmp_path / "fmus" / f"{model}.fmu")
    monkeypatch.setattr(shipped, "_root", lambda: tmp_path)
    assert shipped.find("line5") == tmp_path / "master" / "systems" / "line5"
    assert caplog.messages == []
    assert shipped.find("line5-ardupilot") == tmp_path / "master" / "systems" / "line5-ardupilot"
    assert caplog.messages == ["building ArduPilotSITL (once)"]
    assert (tmp_path / "fmus" / "ArduPilotSITL.fmu").is_file()
    assert shipped.fmu("Helicopter") is None
    assert shipped.fmu("Hexarotor") == tmp_path / "fmus" / "Hexarotor.fmu"
    assert caplog.messages == ["building ArduPilotSITL (once)", "building Hexarotor (once)"]


def test_a_package_without_fmus_builds_those_that_are_needed(
    tmp_path: Path, fmus: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Into a folder of the user's; those of `line5` are those of a new line, too."""
    built: list[str] = []

    def copied(models: list[type[Model]], folder: Path) -> Iterator[None]:
        for model in models:
            built.append(model.__name__)
            shutil.copyfile(fmus / f"{model.__name__}.fmu", folder / f"{model.__name__}.fmu")
            yield

    shutil.copytree(ROOT / "master" / "systems", tmp_path / "installed" / "master" / "systems")
    monkeypatch.setattr(shipped, "_INSTALLED", tmp_path / "installed")
    monkeypatch.setattr("cosim.build.build_all", copied)
    for cache, first, then in (("one", "run", "new"), ("two", "new", "run")):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / cache))
        for what in (first, then):
            if what == "run":
                found = shipped.find("line5")
                assert found is not None and found.is_relative_to(tmp_path / cache)
                with read_system(found) as structure:
                    assert structure.name == "line5"
            else:
                new_system("line", 3, tmp_path / f"{cache}-{what}")
            assert sorted(built) == ["Autopilot", "LineAgent", "Quadrotor"]
        assert {file.stem for file in shipped.fmus().iterdir()} == {*built}
        assert shipped.fmu("Hexarotor") == shipped.fmus() / "Hexarotor.fmu"
        assert built[3:] == ["Hexarotor"]
        built.clear()
    assert not (tmp_path / "installed" / "fmus").exists()


def test_models_of_systems() -> None:
    assert shipped.models("line5") == ("Autopilot", "LineAgent", "Quadrotor")
    assert shipped.models("line5-hexa") == ("Autopilot", "Hexarotor", "LineAgent", "Quadrotor")
    assert {model for name in shipped.names() for model in shipped.models(name)} <= {
        model.__name__ for model in models_of_package("cosim_models")
    }


def test_a_shipped_system_is_not_changed_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemDescriptionError, match="line5: a shipped system is not changed in place; give a path"):
        swap("line5", "drone3.vehicle", "Hexarotor")


def test_the_wheel_has_these_packages_and_nothing_else(installed: Path) -> None:
    assert sorted(path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")) == [
        "cosim",
        "cosim_master",
        "cosim_models",
    ]
    for package in ("cosim", "cosim_models", "cosim_master"):
        assert (installed / package / "py.typed").is_file()
    assert (installed / "cosim" / "build" / "native" / "fmi2.c").is_file()
    assert (installed / "cosim_models" / "vehicles" / "presets" / "px4_iris.ssv").is_file()
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


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone: git does not say which files there are")
def test_the_sdist_has_every_file_of_the_repository(tmp_path: Path) -> None:
    """Files in folders are empty: only their names matter, and they are neither copied nor compressed."""
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, text=True, check=True).stdout
    files = {name for name in listed.split("\0") if name and (ROOT / name).is_file()}
    for name in files:
        copy = tmp_path / "tree" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if "/" in name:
            copy.touch()
        else:
            shutil.copyfile(ROOT / name, copy)
    build = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, tmp_path], cwd=tmp_path / "tree", check=True, capture_output=True)
    (made,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(made) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    assert files - packed == {".gitignore"}


@pytest.mark.slow
def test_an_installed_package_flies_line5_in_an_empty_folder(installed: Path, fmus: Path, tmp_path: Path) -> None:
    """The FMUs are built when they are first needed; object code that this tree's FMUs were made of is taken again."""
    environment = {**os.environ, "PYTHONPATH": str(installed), "COLUMNS": "200"}
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", "line5", "--until", "0.1"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "done: 0.1 s simulated" in done.stdout
    assert (tmp_path / "out" / "line5" / "signals.parquet").is_file()
    again = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert "building" not in again.stderr


@pytest.mark.parametrize(
    ("package", "command", "extra"),
    [("matplotlib", ["plot", "run"], "plot"), ("pymavlink", ["dialect", "own.xml", "-o", "own.py"], "build")],
)
def test_an_extra_that_is_missing_is_named(
    package: str, command: list[str], extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    consensus_run(tmp_path / "run")
    (tmp_path / "own.xml").write_text("<mavlink><messages/></mavlink>")
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    read_dialect.cache_clear()  # what pymavlink said before is kept
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1] == (
        f"error: {package} is not installed; try pip install 'uav-cosim[{extra}]'"
    )


def test_a_build_without_a_compiler_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *of: None if name == "ziglang" else found(name, *of))
    monkeypatch.delenv("CC", raising=False)
    result = CliRunner().invoke(app, ["build", "Quadrotor", "-o", str(tmp_path)])
    assert result.exit_code == 2
    assert "a compiled FMU needs a C compiler; try pip install 'uav-cosim[build]', or set CC" in result.stderr
