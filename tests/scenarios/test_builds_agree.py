"""The interpreted and the compiled build of every model fly the same line, and mix in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim import Model
from cosim.build import build, build_all, models_of_package
from cosim_master.fmi.description.read import describe
from cosim_master.system import shipped
from tests.scenarios.flights import SYSTEMS, Flight, copy_of, fly

CHECKED = ("line5", "line5-estimated", "line5-hexa", "line5-points", "flocking-points", "rendezvous")


def models_of(*systems: str) -> list[type[Model]]:
    names = {name for system in systems for name in shipped.models(system)}
    return [model for model in models_of_package("cosim_models") if model.__name__ in names]


@pytest.fixture(scope="module")
def compiled(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly(SYSTEMS / "line5", tmp_path_factory.mktemp("compiled"), until=60.0)


@pytest.fixture(scope="module")
def interpreted_fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("interpreted") / "fmus"
    for model in models_of("line5"):
        built = build(model, folder, interpreted=True)
        assert not built.compiled
    return folder


def worst(a: Flight, b: Flight) -> dict[str, float]:
    """Largest difference of every signal, as far as `a` goes."""
    assert a.signals.keys() == b.signals.keys()
    return {
        name: float(np.abs(a[name].astype(float) - b[name][: a[name].size].astype(float)).max()) for name in a.signals
    }


@pytest.mark.slow
def test_interpreted_and_compiled_agree(compiled: Flight, interpreted_fmus: Path, tmp_path: Path) -> None:
    """For as long as plain Python, a thousand times slower, has time for."""
    flight = fly(copy_of("line5", tmp_path, interpreted_fmus), tmp_path / "out", until=0.3)
    apart = worst(flight, compiled)
    assert len(apart) > 200
    assert max(apart.values()) < 1e-9, sorted(apart.items(), key=lambda item: -item[1])[:5]
    assert sum(flight.result.packets.values()) > 0


@pytest.fixture(scope="module")
def checked_fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checked") / "fmus"
    assert all(built.compiled for built in build_all(models_of(*CHECKED), folder, checked=True))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("system", CHECKED)
def test_checks_find_nothing_and_change_no_bit(
    system: str, compiled: Flight, checked_fmus: Path, tmp_path: Path
) -> None:
    """No index of the shipped models lies outside its array in these flights."""
    plain = compiled if system == "line5" else fly(SYSTEMS / system, tmp_path / "plain", until=60.0)
    flight = fly(copy_of(system, tmp_path, checked_fmus), tmp_path / "out", until=60.0)
    assert set(worst(flight, plain).values()) == {0.0}
    assert dict(flight.result.packets) == dict(plain.result.packets)


@pytest.mark.slow
def test_builds_mix(compiled: Flight, fmus: Path, interpreted_fmus: Path, tmp_path: Path) -> None:
    """Vehicles and agents compiled, autopilots interpreted."""
    mixed = tmp_path / "fmus"
    mixed.mkdir()
    for file in fmus.glob("*.fmu"):
        source = interpreted_fmus if file.stem == "Autopilot" else fmus
        (mixed / file.name).symlink_to(source / file.name)
    flight = fly(copy_of("line5", tmp_path / "system", mixed), tmp_path / "out", until=0.5)
    assert max(worst(flight, compiled).values()) < 1e-9


@pytest.mark.slow
def test_fmi_2_and_3_give_the_same_bits(compiled: Flight, fmi3_fmus: Path, tmp_path: Path) -> None:
    """All as FMI 3, and vehicles as FMI 3 with the rest as FMI 2."""
    for name, as_fmi3 in (("all", ("Quadrotor", "Autopilot", "LineAgent")), ("mixed", ("Quadrotor", "LineAgent"))):
        folder = tmp_path / name / "fmus"
        folder.mkdir(parents=True)
        for model in ("Quadrotor", "Autopilot", "LineAgent"):
            file = f"{model}.fmi3.fmu" if model in as_fmi3 else f"{model}.fmu"
            (folder / f"{model}.fmu").symlink_to(fmi3_fmus / file)
            assert describe(folder / f"{model}.fmu").fmi_version[0] == ("3" if model in as_fmi3 else "2")
        flight = fly(copy_of("line5", tmp_path / name, folder), tmp_path / name / "out", until=60.0)
        assert max(worst(flight, compiled).values()) == 0.0
        assert dict(flight.result.packets) == dict(compiled.result.packets)
