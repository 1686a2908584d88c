"""The sample models, built both ways once per session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from cosim.build import build, load_models
from tests.cosim.forked import Forked, forking_after

SAMPLES = Path(__file__).with_name("sample_models.py")
LOAD = """
from cosim.fields import get_real  # any kernel
get_real.targetctx.refresh()
get_real.typingctx.refresh()
"""
"""Loads numba's own declarations, as the first compilation of a process does."""
_loaded: dict[str, object] = {}


def sample_models() -> SimpleNamespace:
    """The classes of sample_models.py by name."""
    if not _loaded:
        _loaded.update({model.__name__: model for model in load_models(str(SAMPLES))})
    return SimpleNamespace(**_loaded)


@pytest.fixture(scope="session")
def samples() -> SimpleNamespace:
    return sample_models()


@pytest.fixture(scope="session")
def compiled_plant(samples: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = build(samples.Plant, tmp_path_factory.mktemp("compiled"))
    assert built.compiled
    return built.file


@pytest.fixture(scope="session")
def plant3(samples: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(samples.Plant, tmp_path_factory.mktemp("fmi3"), fmi=3).file


@pytest.fixture(scope="session")
def interpreted_plant(samples: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = build(samples.Plant, tmp_path_factory.mktemp("interpreted"), interpreted=True)
    assert not built.compiled
    return built.file


@pytest.fixture(params=["compiled", "interpreted"])
def plant(request: pytest.FixtureRequest) -> Path:
    """The Plant FMU, in both builds."""
    return request.getfixturevalue(f"{request.param}_plant")


@pytest.fixture(scope="session")
def forked_builder() -> Iterator[Forked]:
    """Programs in processes of their own that have imported what builds and compiles, but compiled nothing."""
    with forking_after("import cosim.build, fmpy.fmi2, fmpy.simulation\n" + LOAD) as forked:
        yield forked


@pytest.fixture(scope="session")
def forked_importer() -> Iterator[Forked]:
    """Programs in processes of their own that have imported FMPy, but nothing of this project."""
    with forking_after("import fmpy.fmi2, fmpy.simulation") as forked:
        yield forked
