"""Fixtures that every test may use."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

from cosim.build import build_all, models_of_package
from cosim_master.fmi.slaves.isolated import Isolation
from tests.cosim.shipped import models_with_kernels
from tests.master.forks import Forks, forking

ROOT = Path(__file__).parents[1]
FMUS = ROOT / "fmus"

_ZIG = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "zig"
os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(_ZIG))
"""zig compiles the C runtime into its cache: tests with another cache folder take it from there."""

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""As in the command; otherwise, each process of a test waits for matrices with 60 ms of processor time."""

settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("project", settings.get_profile("search"), derandomize=True)
settings.load_profile("project")
"""The same examples in every run (`--hypothesis-profile=search` takes others each time), and none fails for the time
it takes: kernels are compiled when they are first called, and machines are busy."""


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
"""Tests interrupt processes, which inherit this: shells without job control start `make test &` with SIGINT ignored."""

gc.set_threshold(50_000, 20, 50)
"""Collecting thousands of tests makes a million objects that stay: with Python's own limits, looking through them again
and again took two fifths of the time of the first collection of tests and a tenth of that of the tests."""


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """FMUs run in the process of the test unless it says otherwise: many write their calls to a file of the test."""
    monkeypatch.setattr("cosim_master.execution.preparation.isolating.DEFAULT", Isolation("none"))


LONGEST = (
    "test_readme.py",
    "scenarios/test_builds_agree.py",
    "test_benchmarks.py",
    "master/campaigns/test_campaigns.py",
    "scenarios/test_parts_on_mpi.py",
    "scenarios/test_parts_that_hear.py",
    "scenarios/test_run_in_parts.py",
    "cosim/build/test_build.py",
    "test_tutorial.py",
    "master/fmi/test_serving.py",
    "master/cli/test_cli.py",
    "scenarios/test_drones_follow_their_laws.py",
    "master/fmi/test_isolation.py",
    "scenarios/test_federation.py",
    "cosim/test_lowering.py",
    "master/cli/test_terminal.py",
    "test_site.py",
    "cosim/test_messages.py",
    "cosim/build/test_compiled_fmu.py",
    "test_contributing.py",
    "scenarios/test_pymavlink_flies.py",
    "cosim/build/test_wrong_models.py",
    "master/view/test_ros2.py",
    "master/fmi/test_runner.py",
    "scenarios/test_isolated_fmus_give_the_same_bits.py",
    "cosim/test_packets.py",
    "master/results/test_figures.py",
    "master/results/test_journal.py",
    "scenarios/test_run_is_resumed.py",
    "models/agents/test_agents_page.py",
    "scenarios/test_the_line_flies_in_wind.py",
    "scenarios/test_process_is_killed.py",
    "models/agents/test_kit.py",
    "master/results/test_recorder.py",
    "scenarios/test_drones_in_one_fmu.py",
    "scenarios/test_every_vehicle_flies.py",
    "scenarios/test_surroundings_act.py",
    "master/cli/test_launching.py",
    "master/system/test_shipped.py",
)
"""Files that take longest, in order: where tests run side by side, one of them that began last would run alone."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; `--no-loadscope-reorder` keeps this order for xdist."""
    order = {ROOT / "tests" / name: place for place, name in enumerate(LONGEST)}
    if missing := [str(file) for file in order if not file.is_file()]:
        raise pytest.UsageError(f"LONGEST in tests/conftest.py names {', '.join(missing)}: no such file")
    items.sort(key=lambda item: order.get(item.path, len(order)))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish() -> None:
    """Leave few objects to pytest, which looks five times through all that are left for errors in their finalizers."""
    gc.collect()
    gc.freeze()


def _of_all_workers(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The folder of this run that its workers share."""
    own = tmp_path_factory.getbasetemp()
    return own if worker_id == "master" else own.parent


def _folder_of_all(tmp_path_factory: pytest.TempPathFactory, worker_id: str, fmi: int) -> Path:
    shared = _of_all_workers(tmp_path_factory, worker_id)
    built = shared / f"fmi{fmi}.built"  # to find out again that all are up to date takes a worker more than a second
    with FileLock(shared / f"fmi{fmi}.lock"):
        if not built.exists():
            models = models_of_package("cosim_models") if fmi == 2 else models_with_kernels().values()
            for _ in build_all(list(models), FMUS, fmi=fmi):
                pass
            built.touch()
    return FMUS


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The repository's folder of FMUs, with every model of cosim_models compiled and up to date."""
    return _folder_of_all(tmp_path_factory, worker_id, 2)


@pytest.fixture(scope="session")
def fmi3_fmus(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The same folder, with the models that tests of builds go through also built as FMI 3.0: NAME.fmi3.fmu."""
    return _folder_of_all(tmp_path_factory, worker_id, 3)


@pytest.fixture(scope="session")
def forks() -> Iterator[Forks]:
    """Runs of `uav-cosim` in processes of their own, which are forked."""
    with forking() as started:
        yield started


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder with what a pure Python wheel of this tree installs; one for all workers, so nobody writes there."""
    shared = _of_all_workers(tmp_path_factory, worker_id)
    site = shared / "wheel" / "site"
    with FileLock(shared / "wheel.lock"):
        if not site.is_dir():
            _install(shared / "wheel", site)
    return site


def _install(folder: Path, site: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    source = folder / "source"
    for path in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "cosim", "models", "master"):
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(["cp", "-r", ROOT / path, source / path], check=True)
    build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"  # as pip does
    subprocess.run([sys.executable, "-c", build, folder], cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "unpacked")
    (folder / "unpacked").rename(site)
