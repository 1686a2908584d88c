"""The sample models, built both ways once per session."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from cosim.build import build, load_models

SAMPLES = Path(__file__).with_name("sample_models.py")
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
