"""Waypoints in AUTO and RTL: durations, corners, speeds that change on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import EARTH_RADIUS_ARDUPILOT
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.control.scurve import CLOCK, CONSTANT, LEG, RISE
from cosim_models.autopilot.flight.avoidance import avoid_fences, slow_at_fences
from tests.models.autopilot.test_autopilot_auto import flying, reached
from tests.models.autopilot.test_autopilot_missions import item
from tests.models.copter import ACCEPTED, RTL, Copter, H

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


# ---- as ArduCopter's ------------------------------------------------------------------------------------------------


def watched(copter: Copter, duration: float, *names: str) -> np.ndarray[Any, Any]:
    """Rows of time and variables of the autopilot, each step."""
    rows = []
    for _ in range(round(duration / H)):
        copter.tick()
        rows.append([copter.time, *(float(part) for name in names for part in np.ravel(copter.m[name]))])
    return np.array(rows)


def test_a_take_off_is_complete_within_its_stopping_distance() -> None:
    """It is 0.5 (0.1 * 2.5 m/s)**2 / (1 m/s2) = 0.03125 m; ArduCopter of 2024 took 90 % of the way."""
    copter = Copter().in_the_air(6.0, 0.0)
    rows = watched(copter, 9.0, "takeoff_done", "desired_position_neu", "desired_velocity_neu")
    done = int(np.argmax(rows[:, 1]))
    assert 5.96875 <= rows[done, 4] < 5.96875 + 0.25 * 2.0 * H
    assert 0.0 < rows[done, 7] < 0.25
    slow = int(np.argmax((rows[:, 7] < 0.25) & (rows[:, 4] > 3.0)))
    assert slow < done  # the climb rate was low enough before


def test_the_corner_above_a_climb_begins_when_the_climb_rate_falls_by_less_than_its_limit() -> None:
    """RTL from 10 m to 15 m: the middle of the corner is on the plateau of -1 m/s2 for the first 0.37 s of the fall.

    The plateau is the limit, to a digit of ArduCopter's 32-bit numbers: 31 of its 44 recorded corners began after it.
    """
    copter = Copter().in_the_air(10.0, 14.0)
    copter.go(20.0, 0.0, -10.0)
    copter.run(14.0)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    rows = watched(copter, 5.0, "legs")
    this = rows[:, 1:].reshape(len(rows), 3, LEG)[:, 1]
    following = rows[:, 1:].reshape(len(rows), 3, LEG)[:, 2]
    fall = rows[np.argmax((this[:, CLOCK] > 0.0) & (this[:, CLOCK] >= this[:, RISE] + this[:, CONSTANT])), 0]
    corner = rows[np.argmax(following[:, CLOCK] > 0.0), 0]
    assert corner - fall == pytest.approx(0.38, abs=0.03)


def test_a_landing_after_a_way_keeps_the_desired_motion() -> None:
    """ArduCopter begins its controllers anew only where they do not run."""
    copter = flying(item(1, mavlink.MAV_CMD_NAV_LAND, north=6.0, z=0.0))
    rows = watched(copter, 12.0, "auto_stage", "desired_position_neu")
    lands = int(np.argmax(rows[:, 1]))
    assert rows[lands, 1] == 1.0
    assert rows[lands, 2:4] == pytest.approx(rows[lands - 1, 2:4], abs=1e-5)
    assert abs(rows[lands, 2] - 6.0) < 0.01


def test_the_lean_stays_when_a_way_begins() -> None:
    """Hovering in wind: the demanded acceleration goes on where it was, although the vehicle's is noise."""
    copter = Copter(vehicle={"wind": (4.0, 0.0, 0.0)}).in_the_air(10.0, 20.0)
    before = float(copter.m["target_acceleration_neu"][0])
    assert before < -0.1
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    rows = watched(copter, 0.05, "target_acceleration_neu", "desired_acceleration_neu")
    assert np.abs(rows[:, 1] - before).max() < 0.005
    assert rows[:2, 4:6] == pytest.approx(0.0, abs=1e-6)


def test_rtl_plans_in_whole_units_of_a_location() -> None:
    """Home and the climb are on the grid of 1e-7 degrees, cut off; the climb begins a step after the mode."""
    copter = Copter().in_the_air(10.0, 14.0)
    copter.go(20.0, 10.0, -10.0)
    copter.run(14.0)
    copter.m["home_neu"][:2] = 1.5 * 0.0111319491, -2.7 * 0.0111319491 * math.cos(float(copter.m["origin_latitude"]))
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    rows = watched(copter, 0.1, "rtl_stage", "rtl_place", "guided_position_neu")
    planned = int(np.argmax((rows[:, 1] == 0.0) & (np.arange(len(rows)) > 0)))
    step = math.radians(1e-7) * EARTH_RADIUS_ARDUPILOT
    east = step * math.cos(float(copter.m["origin_latitude"]))
    assert rows[planned, 2:4] == pytest.approx((step, -2.0 * east), rel=1e-6)
    climb = rows[planned, 4:6] / (step, east)
    assert climb == pytest.approx(np.round(climb), abs=2e-3)
    assert rows[planned, 4] == pytest.approx(20.0, abs=step + 5e-3)
    assert rows[planned, 6] == pytest.approx(15.0, abs=0.01)


# ---- fences --------------------------------------------------------------------------------------------------------


def test_a_velocity_that_a_fence_reduces_stays_so_until_the_next_command() -> None:
    """ArduCopter changes the command itself, by at most 3 m/s2: one step of 2.5 ms for each command that asks more."""
    m = Autopilot.record()
    for name, value in {"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 40.0, "FENCE_MARGIN": 2.0}.items():
        m[name] = value
    m["position_neu"][:] = 37.75, 0.0, 10.0
    v = np.array([0.1, 0.0, 0.0])
    avoid_fences(m, v, H)
    assert v[0] == 0.1  # slow enough: 0.25 m/s is permitted
    v[:] = 6.0, 0.0, 0.0
    avoid_fences(m, v, H)
    assert v[0] == pytest.approx(6.0 - 0.0075)
    for _ in range(800):
        avoid_fences(m, v, H)
    assert v[0] == pytest.approx(0.25, abs=0.001)
    m["position_neu"][0] = 37.5  # 0.5 m/s would be permitted
    for command in (1, 2, 3):
        v[:] = 6.0, 0.0, 0.0
        for _ in range(40):
            avoid_fences(m, v, H)
        assert v[0] == pytest.approx(0.25 + 0.0075 * command, abs=0.001)
    for _ in range(81):
        avoid_fences(m, v, H)
    v[:] = 6.0, 0.0, 0.0
    avoid_fences(m, v, H)
    assert v[0] == pytest.approx(6.0 - 0.0075)  # 0.2 s later, it begins anew


def test_a_vehicle_beyond_the_margin_of_a_fence_goes_back() -> None:
    """By the proportional gain of the position, 1/s, at most at 0.75 m/s, unless more is wanted."""
    m = Autopilot.record()
    for name, value in {"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 40.0, "FENCE_MARGIN": 2.0}.items():
        m[name] = value
    for place, wanted, expected in (
        ((38.1, 0.0), (0.0, 0.02), (-0.1, None)),
        ((0.0, -38.2), (0.01, 0.0), (None, 0.2)),
        ((38.1, 0.0), (-2.0, 0.0), (-2.0, None)),
        ((39.9, 0.0), (0.0, 0.01), (-0.75, None)),
    ):
        m["position_neu"][:] = *place, 10.0
        found = slow_at_fences(m, *wanted, H)
        for part, value in zip(found, expected, strict=True):
            assert value is None or part == pytest.approx(value, abs=0.005), place
