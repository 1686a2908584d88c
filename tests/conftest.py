"""Fixtures that every test may use."""

from __future__ import annotations

from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

from cosim.build import build_all, models_of_package

FMUS = Path(__file__).parents[1] / "fmus"


settings.register_profile("project", deadline=None)
settings.load_profile("project")
"""No example may fail for the time it takes: kernels are compiled when they are first called."""


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
