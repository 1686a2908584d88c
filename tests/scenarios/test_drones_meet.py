"""Five drones of 6 degrees of freedom meet by the rendezvous law; also over a bad radio, while one of them leaves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_models.agents.kit import Task
from tests.scenarios.flights import SYSTEMS, Flight, fly

BEGIN = 20.0
RATE = 0.1 * (2.0 - 2.0 * np.cos(2.0 * np.pi / 5.0))
"""Gain times the second eigenvalue of the Laplacian of a ring of five [1/s]."""


@pytest.fixture(scope="module")
def flight(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly(SYSTEMS / "rendezvous", tmp_path_factory.mktemp("rendezvous"))


def places(flight: Flight) -> np.ndarray:
    """Time, drone, north and east [m]."""
    axes = [[flight[f"drone{i}.vehicle.position[{k}]"] for k in (1, 2)] for i in range(1, 6)]
    return np.moveaxis(np.array(axes), 2, 0)


def test_they_meet_in_the_middle(flight: Flight) -> None:
    end = places(flight)[-1]
    assert np.linalg.norm(end, axis=1).max() < 1.0
    for i in range(1, 6):
        assert flight[f"drone{i}.agent.state"][-1] == Task.flying
        assert flight.up(i)[-1] == pytest.approx(8.0 + 2.0 * i, abs=0.3)


def test_the_rate_is_that_of_the_graph(flight: Flight) -> None:
    """Neighbours are taken to fly on straight, vehicles follow with a lag: together that is a few per cent."""
    away = np.linalg.norm(places(flight), axis=2).max(axis=1)
    during = (flight["time"] > BEGIN + 6.0) & (away > 2.0)
    assert np.polyfit(flight["time"][during], np.log(away[during]), 1)[0] == pytest.approx(-RATE, rel=0.12)


def test_the_swarm_did_well(flight: Flight) -> None:
    assert json.loads((flight.folder / "manifest.json").read_text())["verdict"]["good"] is True


def test_over_a_bad_radio_while_one_lands_on_the_way(fmus: Path, tmp_path: Path) -> None:
    """Drone 1 leaves at 21 s: what it leaves is the path 2-3-4-5, and these four meet. Landing takes half a minute."""
    overrides = {"network.loss": "0.2", "drone1.agent.land_time": "21"}
    flight = fly(SYSTEMS / "rendezvous", tmp_path / "a", overrides=overrides, until=60.0)
    assert flight["drone1.agent.state"][-1] == Task.landed
    assert flight.up(1)[-1] == pytest.approx(0.0, abs=0.1)
    assert [flight[f"drone{i}.agent.neighbours"][-1] for i in range(2, 6)] == [1, 2, 2, 1]
    four = places(flight)[:, 1:]
    begin = int(np.searchsorted(flight["time"], 21.0))
    assert np.ptp(four[-1], axis=0).max() < 0.1 * np.ptp(four[begin], axis=0).max()
    middle = places(flight)[begin].mean(axis=0)
    assert np.linalg.norm(four[-1].mean(axis=0) - middle) < np.linalg.norm(places(flight)[begin, 0] - middle)

    again = fly(SYSTEMS / "rendezvous", tmp_path / "b", overrides=overrides, until=60.0, threads=2)
    for file in ("signals", "packets"):
        first, second = (pq.read_table(one.folder / f"{file}.parquet") for one in (flight, again))
        assert first.equals(second)
