"""Fixtures that every test may use."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.build import build, models_of_package

FMUS = Path(__file__).parents[1] / "fmus"


@pytest.fixture(scope="session")
def fmus() -> Path:
    """The repository's folder of FMUs, with every model of cosim_models compiled and up to date."""
    for model in models_of_package("cosim_models"):
        build(model, FMUS)
    return FMUS


@pytest.fixture(scope="session")
def fmi3_fmus() -> Path:
    """The same folder, with every model that has kernels also built as FMI 3.0: NAME.fmi3.fmu."""
    for model in models_of_package("cosim_models"):
        if model.kernels is not None:
            build(model, FMUS, fmi=3)
    return FMUS
