"""Fixtures that every test may use."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

from cosim.build import build_all, models_of_package

ROOT = Path(__file__).parents[1]
FMUS = ROOT / "fmus"


settings.register_profile("project", deadline=None)
settings.load_profile("project")
"""No example may fail for the time it takes: kernels are compiled when they are first called."""


LONGEST = (
    "scenarios/test_builds_agree.py",
    "test_readme.py",
    "models/autopilot/test_autopilot_mavlink.py",
    "master/cli/test_terminal.py",
    "test_benchmarks.py",
    "cosim/test_fmi3_build.py",
    "models/autopilot/test_autopilot_builds.py",
    "master/system/test_ssp_fuzz.py",
    "scenarios/test_pymavlink_flies.py",
    "models/autopilot/test_client_replays.py",
)
"""Files that take longest, in order: where tests run side by side, one of them that began last would run alone."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; `--no-loadscope-reorder` keeps this order for xdist."""
    order = {ROOT / "tests" / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path, len(order)))


def _folder_of_all(tmp_path_factory: pytest.TempPathFactory, worker_id: str, fmi: int) -> Path:
    shared = tmp_path_factory.getbasetemp()
    if worker_id != "master":
        shared = shared.parent  # of all workers of this run
    with FileLock(shared / f"fmi{fmi}.lock"):
        models = models_of_package("cosim_models")
        for _ in build_all([m for m in models if fmi == 2 or m.kernels is not None], FMUS, fmi=fmi):
            pass
    return FMUS


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The repository's folder of FMUs, with every model of cosim_models compiled and up to date."""
    return _folder_of_all(tmp_path_factory, worker_id, 2)


@pytest.fixture(scope="session")
def fmi3_fmus(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The same folder, with every model that has kernels also built as FMI 3.0: NAME.fmi3.fmu."""
    return _folder_of_all(tmp_path_factory, worker_id, 3)


@pytest.fixture(scope="session")
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
