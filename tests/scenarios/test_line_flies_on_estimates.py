"""line5-estimated: the paper's line with noisy sensors and an estimator between every vehicle and its autopilot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.flights import SYSTEMS, Flight, fly, plain_line


@pytest.fixture(scope="module")
def flight(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return fly(SYSTEMS / "line5-estimated", tmp_path_factory.mktemp("estimated"))


def test_it_spreads_within_what_the_sensors_allow(flight: Flight) -> None:
    east = [flight.east(drone)[-1] for drone in range(1, 6)]
    assert east == pytest.approx([0, 25, 50, 75, 100], abs=2.5)
    for drone in range(1, 6):
        error = flight[f"drone{drone}.estimator.position_error"]
        assert 0.02 < error.max() < 2.0
        assert np.degrees(flight[f"drone{drone}.estimator.attitude_error"].max()) < 3.0


def test_nobody_overtakes_and_all_keep_their_height(flight: Flight) -> None:
    east = np.array([flight.east(drone) for drone in range(1, 6)])
    assert np.diff(east, axis=0).min() > 3.0
    first = flight.row_of_step(1)
    for drone in range(1, 6):
        assert np.abs(flight.up(drone)[first:] - 10.0).max() < 1.5


def test_every_drone_has_noise_of_its_own(flight: Flight) -> None:
    errors = np.array([flight[f"drone{drone}.estimator.position_error"] for drone in range(1, 6)])
    apart = np.corrcoef(errors) - np.eye(5)
    assert apart.max() < 0.95


def test_a_run_is_repeated_bit_for_bit(flight: Flight, tmp_path: Path) -> None:
    again = fly(SYSTEMS / "line5-estimated", tmp_path / "again", until=20.0)
    for name in again.signals:
        assert again[name].tobytes() == flight[name][: again[name].size].tobytes(), name


def test_the_true_motion_can_be_chosen(flight: Flight, tmp_path: Path) -> None:
    chosen = {f"drone{drone}.estimator.use_truth": "true" for drone in range(1, 6)}
    true = fly(SYSTEMS / "line5-estimated", tmp_path / "true", until=25.0, overrides=chosen)
    plain = plain_line()
    for drone in range(1, 6):
        assert true[f"drone{drone}.estimator.position_error"].max() == 0.0
        assert true.east(drone) == pytest.approx(plain.east(drone)[: true.east(drone).size], abs=0.1)
        assert not np.array_equal(flight.east(drone)[: true.east(drone).size], true.east(drone))
