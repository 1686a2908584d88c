"""The paper's experiment: drones at 0, 10, 20, 50, 100 m spread to 0, 25, 50, 75, 100 m."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.flights import Flight, plain_line

EAST_AT_STEP = {1: (10.0, 20.0, 50.0), 9: (21.4, 44.9, 71.4), 17: (24.4, 49.1, 74.4)}


@pytest.fixture(scope="module")
def flight(fmus: Path) -> Flight:
    return plain_line()


@pytest.mark.parametrize(("step", "tolerance"), [(1, 0.5), (9, 1.0), (17, 0.5)])
def test_positions_at_the_snapshots(flight: Flight, step: int, tolerance: float) -> None:
    row = flight.end_of_step(step)
    east = [flight.east(drone)[row] for drone in (2, 3, 4)]
    assert east == pytest.approx(EAST_AT_STEP[step], abs=tolerance)


def test_the_end_is_even(flight: Flight) -> None:
    assert [flight.east(drone)[-1] for drone in (1, 2, 3, 4, 5)] == pytest.approx([0, 25, 50, 75, 100], abs=1.0)


def test_all_take_off_and_stay_at_ten_metres(flight: Flight) -> None:
    first = flight.row_of_step(1)
    for drone in range(1, 6):
        assert flight[f"drone{drone}.autopilot.armed"][first]
        assert flight.up(drone)[0] == pytest.approx(0.0, abs=0.05)
        assert np.abs(flight.up(drone)[first:] - 10.0).max() < 0.3


def test_the_ends_stay_where_they_are(flight: Flight) -> None:
    assert np.abs(flight.east(1)).max() < 0.5
    assert np.abs(flight.east(5) - 100.0).max() < 0.5
    for drone in range(1, 6):
        assert np.abs(flight[f"drone{drone}.vehicle.position[1]"]).max() < 0.5


def test_nobody_overtakes(flight: Flight) -> None:
    east = np.array([flight.east(drone) for drone in range(1, 6)])
    assert np.diff(east, axis=0).min() > 5.0


def test_steps_are_synchronous_and_follow_the_period(flight: Flight) -> None:
    time = flight["time"]
    for drone in (2, 3, 4):
        begins = [time[flight.row_of_step(step, f"drone{drone}.agent")] for step in range(1, 18)]
        assert np.diff(begins) == pytest.approx([3.1875] * 16, abs=1e-9)
        assert begins[0] == time[flight.row_of_step(1, "drone1.agent")]


def test_targets_are_those_of_the_law_on_measured_positions(flight: Flight) -> None:
    """At each step the target is x + (left - 2x + right)/3 of what was measured up to half a second before."""
    time = flight["time"]
    for step in range(2, 18):
        row = flight.row_of_step(step)
        earlier = int(np.searchsorted(time, time[row] - 0.3))
        x = [flight.east(drone)[earlier] for drone in range(1, 6)]
        for drone in (2, 3, 4):
            law = x[drone - 1] + (x[drone - 2] - 2 * x[drone - 1] + x[drone]) / 3
            assert flight[f"drone{drone}.agent.target"][row] == pytest.approx(law, abs=0.35)


def test_the_radio_carries_positions_both_ways(flight: Flight) -> None:
    packets = flight.result.packets
    assert packets["sent"] == packets["delivered"] + packets["lost"] + packets["in flight"]
    assert packets["lost"] == 0
    assert packets["malformed"] == 0
    assert packets["delivered"] > 8 * 4 * 60  # eight directed links, four positions a second
    for drone in (2, 3, 4):
        ages = [flight[f"drone{drone}.agent.{side}_age"][-1] for side in ("left", "right")]
        assert max(ages) < 0.3


def test_the_manifest_says_what_was_run(flight: Flight) -> None:
    manifest = json.loads((flight.folder / "manifest.json").read_text())
    assert manifest["outcome"] == "done"
    assert manifest["simulated_s"] == 85.0
    assert manifest["seed"] == 1
    assert manifest["instances"]["drone3.agent"]["parameters"]["left_sysid"] == 2
    assert manifest["instances"]["drone3.vehicle"]["parameters"]["mass"] == 1.545
    assert len(manifest["instances"]) == 15
