"""Caches of object code: which models share an object."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import pytest

from cosim.build.native.compiled import HOST, build_compiled
from cosim.build.native.objects import object_code
from cosim.build.sources import sources_of
from cosim.model import Model, record_layout
from cosim_models.agents.coverage import Coverage
from cosim_models.agents.flocking import Flocking
from cosim_models.vehicles.hexarotor import Hexarotor
from cosim_models.vehicles.point_mass import PointMass
from cosim_models.vehicles.quadrotor import Quadrotor


@pytest.fixture
def code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Model], bytes, str], bytes]:
    """Object code of a model by the cache, where `made` is what a compiler would make of it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def of(model: type[Model], made: bytes, how: str = "linux-x86_64 unchecked") -> bytes:
        dtype, _ = record_layout(model.variables)
        return object_code(model, sources_of(model), dtype, how, lambda: made)

    return of


def test_the_second_call_makes_nothing(code: Callable[..., bytes]) -> None:
    assert code(Quadrotor, b"first") == b"first"
    assert code(Quadrotor, b"second") == b"first"
    assert code(Quadrotor, b"third", "linux-x86_64 checked") == b"third"


@pytest.mark.parametrize("damage", ["flipped", "truncated"])
def test_an_object_that_was_changed_is_made_anew(
    code: Callable[..., bytes], tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert code(Quadrotor, b"of yesterday") == b"of yesterday"
    (file,) = (tmp_path / "uav-cosim/objects").iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:-1] if damage == "truncated" else whole[:-1] + b"i")
    with caplog.at_level(logging.WARNING):
        assert code(Quadrotor, b"of today") == b"of today"
    assert f"{file} has been changed since it was made" in caplog.text
    assert code(Quadrotor, b"of tomorrow") == b"of today"


def test_models_that_differ_in_start_values_share_it(code: Callable[..., bytes]) -> None:
    assert code(Quadrotor, b"of both") == b"of both"
    assert code(Hexarotor, b"another") == b"of both"


def test_models_with_other_kernels_or_variables_do_not(code: Callable[..., bytes]) -> None:
    assert code(Quadrotor, b"six degrees") == b"six degrees"
    assert code(PointMass, b"three degrees") == b"three degrees"


def test_agents_share_a_kit_and_differ_by_the_law_that_its_kernels_close_over(code: Callable[..., bytes]) -> None:
    assert code(Flocking, b"flock") == b"flock"
    assert code(Coverage, b"cover") == b"cover"
    assert code(Flocking, b"again") == b"flock"


@pytest.mark.parametrize("fmi", [2, 3])
def test_code_that_is_the_same_for_all_models_is_compiled_once(
    fmi: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "zig"))
    monkeypatch.delenv("CC", raising=False)
    for model in (PointMass, Quadrotor):
        build_compiled(model, sources_of(model), {}, tmp_path / "a.fmu", [HOST], fmi, checked=False)
    compiled = sorted(file.name for file in tmp_path.rglob("*.o") if file.stem in ("model", f"fmi{fmi}"))
    assert compiled == [f"fmi{fmi}.o", "model.o", "model.o"]
