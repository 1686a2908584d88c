"""Systems of the laws with drones of 6 degrees of freedom, each once, and once more over a radio that loses 20 %."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.scenarios.flights import SYSTEMS, Flight, fly

Array = NDArray[np.float64]
BEGIN = 20.0


@pytest.fixture(scope="module", params=["0", "0.2"], ids=["no loss", "20 % lost"])
def flown(request: pytest.FixtureRequest, fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Flies a system, once for each loss."""
    flights: dict[str, Flight] = {}

    def flight(system: str) -> Flight:
        if system not in flights:
            out = tmp_path_factory.mktemp(system) / "run"
            flights[system] = fly(SYSTEMS / system, out, overrides={"network.loss": request.param})
            assert json.loads((out / "manifest.json").read_text())["verdict"]["good"] is True
        return flights[system]

    return flight


def places(flight: Flight) -> Array:
    """Time, drone, north and east [m]."""
    drones = sum(name.endswith("vehicle.position[1]") for name in flight.signals)
    axes = [[flight[f"drone{i}.vehicle.position[{k}]"] for k in (1, 2)] for i in range(1, drones + 1)]
    return np.moveaxis(np.array(axes), 2, 0)


def separation(way: Array) -> Array:
    """The smallest distance of any two at every time [m]."""
    away = np.linalg.norm(way[:, :, None] - way[:, None], axis=3)
    away[:, np.arange(way.shape[1]), np.arange(way.shape[1])] = np.inf
    return np.asarray(away.min(axis=(1, 2)))


def test_five_fly_in_a_v(flown: Callable[[str], Flight]) -> None:
    way = places(flown("formation"))
    s = 12.0 * np.sqrt(0.5)
    wanted = np.array([[0, 0], [-s, -s], [-s, s], [-2 * s, -2 * s], [-2 * s, 2 * s]])
    assert way[-1] - way[-1, 0] == pytest.approx(wanted, abs=0.5)
    assert way[-1, 0] == pytest.approx((2.0 * 40.0, 0.0), abs=2.0)
    assert separation(way).min() > 8.0


def test_six_cover_a_field(flown: Callable[[str], Flight]) -> None:
    """The cost of all cells together decreases, and everybody ends in the middle of a third of a half."""
    flight = flown("coverage")
    cost = sum(flight[f"drone{i}.agent.cost"] for i in range(1, 7))
    during = flight["time"] > BEGIN + 1.0
    assert np.diff(cost[during]).max() < 0.002 * cost[during][0]
    sixth = 100.0**2 / 6.0
    best = 6.0 * sixth * (50.0**2 + (100.0 / 3.0) ** 2) / 12.0
    assert best * 0.999 < cost[-1] < 1.02 * best
    assert np.sort(places(flight)[-1, :, 1]) == pytest.approx([-100 / 3, -100 / 3, 0, 0, 100 / 3, 100 / 3], abs=1.0)


def test_five_flock_past_a_cylinder(flown: Callable[[str], Flight]) -> None:
    flight = flown("flocking")
    way = places(flight)
    assert separation(way).min() > 6.0
    assert (np.linalg.norm(way - (35.0, 14.0), axis=2) - 5.0).min() > 1.0
    velocity = (way[-1] - way[-101]) / 10.0
    assert velocity == pytest.approx(np.tile((1.5, 0.0), (5, 1)), abs=0.4)
    assert separation(way)[-1] == pytest.approx(10.0, abs=0.3)
    assert (way[-1, :, 0] > 40.0).all()


def test_three_follow_as_arducopter_does(flown: Callable[[str], Flight]) -> None:
    """10 m behind and 2.225 m more at 2 m/s: v^2 / 2 a + a / 2 P^2 with a = 1.25 m/s2, P = 1 /s."""
    way = places(flown("follower"))[-1]
    assert way[1:3] - way[0] == pytest.approx(np.array([[6.0, -12.2], [-6.0, -12.2]]), abs=0.35)
    assert way[3] - way[2] == pytest.approx((0.0, -12.2), abs=0.35)
