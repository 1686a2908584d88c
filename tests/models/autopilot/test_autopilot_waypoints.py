"""Waypoints in AUTO and RTL: durations, corners, speeds that change on the way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_auto import flying, reached
from tests.models.autopilot.test_autopilot_missions import item
from tests.models.copter import ACCEPTED, Copter

WAYPOINT, SPEED = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_CHANGE_SPEED


def when(copter: Copter, sequence: int) -> float:
    """When an item was reached."""
    return next(t for t, m in copter.heard if m.get_type() == "MISSION_ITEM_REACHED" and m.seq == sequence)


def test_a_leg_of_20_m_takes_as_long_as_recorded() -> None:
    """ArduCopter 4.7-dev: 9.3 s. The top speed of the path is 4.43 m/s; the vehicle lags behind."""
    copter = flying(item(1, WAYPOINT, north=20.0, z=6.0))
    begun = copter.time
    flight = copter.run(12.0)
    assert when(copter, 1) - begun == pytest.approx(9.3, rel=0.05)
    assert 4.0 < flight[:, 4].max() < 4.5
    assert flight[:, 1].max() < 20.5


def test_corners_are_passed_without_a_stop_within_the_radius() -> None:
    copter = flying(
        item(1, WAYPOINT, north=30.0, z=6.0),
        item(2, WAYPOINT, north=30.0, east=30.0, z=6.0),
        item(3, WAYPOINT, north=60.0, east=30.0, z=6.0),
    )
    flight = copter.run(30.0)
    assert reached(copter) == [1, 2, 3]
    for north, east in ((30.0, 0.0), (30.0, 30.0)):
        away = np.hypot(flight[:, 7] - north, flight[:, 8] - east)
        nearest = int(away.argmin())
        assert 0.3 < away[nearest] < 2.05
        assert np.hypot(flight[nearest, 4], flight[nearest, 5]) > 1.0
    moved = flight[:, 0] < when(copter, 3)
    assert np.abs(np.diff(flight[moved, 7:9], axis=0)).max() < 0.03  # the path is continuous: at most 10 m/s
    assert np.hypot(flight[-1, 1] - 60.0, flight[-1, 2] - 30.0) < 0.6


def test_a_waypoint_with_a_delay_is_a_stop() -> None:
    copter = flying(item(1, WAYPOINT, 1.0, north=15.0, z=6.0), item(2, WAYPOINT, north=30.0, z=6.0))
    flight = copter.run(24.0)
    near = np.abs(flight[:, 1] - 15.0) < 0.4
    assert flight[near, 4].min() < 0.15
    assert reached(copter) == [1, 2]


@pytest.mark.parametrize(("first", "then"), [(2.0, 6.0), (6.0, 2.0)])
def test_a_new_speed_is_flown_on_the_way(first: float, then: float) -> None:
    copter = flying(item(1, SPEED, 1, first), item(2, WAYPOINT, north=110.0, z=6.0))
    copter.run(9.0)
    assert copter.v["velocity"][0] == pytest.approx(first, rel=0.05)
    assert copter.ask(SPEED, 1, then, -1)[0] == ("ACK", SPEED, ACCEPTED)
    flight = copter.run(6.0)
    assert np.abs(np.diff(flight[:, 4])).max() < 0.012  # 4 m/s2: no jerk of the path
    assert flight[-1, 4] == pytest.approx(then, rel=0.06)
    flight = copter.run(48.0)
    assert flight[:, 1].max() < 110.8
    assert flight[-1, 1] == pytest.approx(110.0, abs=0.6)
    assert reached(copter)[-1] == 2


def test_a_pause_on_the_way_stops_and_goes_on() -> None:
    copter = flying(item(1, WAYPOINT, north=60.0, z=6.0))
    copter.run(8.0)
    assert copter.v["velocity"][0] > 3.5
    pause = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
    assert copter.ask(pause, 0)[0] == ("ACK", pause, ACCEPTED)
    copter.run(7.0)
    assert abs(copter.v["velocity"][0]) < 0.1
    held = float(copter.v["position"][0])
    copter.run(1.0)
    assert copter.v["position"][0] == pytest.approx(held, abs=0.1)
    assert copter.ask(pause, 1)[0] == ("ACK", pause, ACCEPTED)
    copter.run(18.0)
    assert reached(copter) == [1]


def test_the_vehicle_is_waited_for() -> None:
    """Against 12 m/s of wind, its lean allows 2 m/s: time along the leg goes as slowly."""
    copter = flying(item(1, WAYPOINT, north=20.0, z=6.0))
    copter.v["wind"][0] = -12.0
    flight: Any = copter.run(24.0)
    assert np.abs(flight[:, 7] - flight[:, 1]).max() < 4.0
    assert flight[:, 4].max() < 2.5
    assert reached(copter) == [1]
