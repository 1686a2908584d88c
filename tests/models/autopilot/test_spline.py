"""Curves between places against scipy's cubic Hermite splines, and splines in missions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.interpolate import CubicHermiteSpline

from cosim_models.autopilot.control.spline import AT, FIRST_SPEED, LAST_SPEED, SPLINE, follow_spline, plan_spline
from tests.models.autopilot.test_autopilot_auto import flying, reached, texts
from tests.models.autopilot.test_autopilot_missions import item
from tests.models.copter import ACCEPTED

CURVE, WAYPOINT, SPEED = (
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT,
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
)
LIMITS = (10.0, 2.5, 1.5, 2.5, 1.0)
STEP = 0.0025
Vector = NDArray[np.float64]


def followed(row: Vector, speed: float) -> tuple[Vector, Vector]:
    """Places and velocities along a curve, until its end."""
    target, places, velocities = np.zeros((3, 3)), [], []
    for _ in range(100000):
        ended = follow_spline(row, target, speed, STEP, LIMITS)
        places.append(target[0].copy())
        velocities.append(target[1].copy())
        assert not target[2].any()
        speed = float(np.linalg.norm(target[1]))
        if ended:
            return np.array(places), np.array(velocities)
    raise AssertionError("the curve does not end")


@pytest.mark.parametrize(
    ("end", "directions", "last"),
    [
        ((20.0, 30.0, 0.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 0.0),
        ((40.0, 0.0, 10.0), ((30.0, 30.0, 0.0), (20.0, -40.0, 5.0)), 3.0),
        ((1.0, 0.0, 0.0), ((40.0, 0.0, 0.0), (0.0, 40.0, 0.0)), 1.0),  # directions too long for so short a way
        ((0.0, 0.0, 25.0), ((0.0, 0.0, 0.0), (0.0, 30.0, 30.0)), 2.0),
    ],
)
def test_curves_are_hermites_and_are_flown_within_limits(end: Any, directions: Any, last: float) -> None:
    origin = np.array((5.0, -3.0, 10.0))
    place, (first, then) = origin + end, (np.array(d) for d in directions)
    row = np.zeros(SPLINE)
    row[LAST_SPEED] = last
    plan_spline(row, origin, first, place, then, LIMITS)
    longest, length = np.linalg.norm(first) + np.linalg.norm(then), float(np.linalg.norm(end))
    scale = min(1.0, 4.0 * length / longest) if longest else 1.0
    exact = CubicHermiteSpline([0.0, 1.0], [origin, place], [scale * first, scale * then])
    curve = exact(np.linspace(0.0, 1.0, 20001))
    places, velocities = followed(row, min(float(row[FIRST_SPEED]), 1.0))
    gaps = np.array([np.linalg.norm(curve - p, axis=1).min() for p in places[::7]])
    assert gaps.max() < 1e-2
    assert np.linalg.norm(places[-1] - place) < 0.05
    speeds = np.linalg.norm(velocities, axis=1)
    assert np.hypot(velocities[:, 0], velocities[:, 1]).max() <= 10.0 * (1 + 1e-9)
    assert velocities[:, 2].max() <= 2.5 * (1 + 1e-9)
    assert velocities[:, 2].min() >= -1.5 * (1 + 1e-9)
    steepest = float(np.max(np.hypot(1.0, velocities[:, 2] / np.maximum(np.hypot(*velocities[:, :2].T), 1e-9))))
    assert np.abs(np.diff(speeds)).max() <= 0.5 * 2.5 * min(steepest, 2.0) * STEP * (1 + 1e-6)
    assert speeds[-1] <= last + 0.25  # the last step before the end passes it
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps[9:-1] == pytest.approx(speeds[8:-3] * STEP, rel=0.05, abs=1e-4)  # the target moves at its speed


def test_the_speeds_at_the_ends_leave_half_of_the_acceleration_to_corners() -> None:
    """With derivatives of 20 m, the curvature at the begin is |c' x c''| / |c'|**3."""
    origin, place = np.zeros(3), np.array((20.0, 20.0, 0.0))
    first, then = np.array((20.0, 0.0, 0.0)), np.array((20.0, 0.0, 0.0))
    row = np.zeros(SPLINE)
    plan_spline(row, origin, first, place, then, LIMITS)
    bend = CubicHermiteSpline([0.0, 1.0], [origin, place], [first, then]).derivative(2)(0.0)
    curvature = np.linalg.norm(np.cross(first, bend)) / 20.0**3
    assert row[FIRST_SPEED] == pytest.approx(math.sqrt(1.25 / curvature))
    assert row[LAST_SPEED] == 0.0  # as ArduCopter's first spline, which nothing has given a speed
    row[LAST_SPEED] = 1.5
    plan_spline(row, origin, first, place, then, LIMITS)
    assert row[LAST_SPEED] == 1.5
    row[LAST_SPEED] = 50.0
    plan_spline(row, origin, first, place, then, LIMITS)
    assert row[LAST_SPEED] == pytest.approx(math.sqrt(1.25 / curvature))  # the curve is symmetric


def test_a_curve_of_no_length_has_ended() -> None:
    row, here, target = np.zeros(SPLINE), np.array((1.0, 2.0, 3.0)), np.zeros((3, 3))
    plan_spline(row, here, here, here, here, LIMITS)
    assert (row[AT], row[LAST_SPEED]) == (1.0, 0.0)
    assert follow_spline(row, target, 2.0, STEP, LIMITS)
    assert target.tolist() == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_splines_are_passed_and_the_last_is_held() -> None:
    copter = flying(
        item(1, WAYPOINT, north=20.0, z=6.0),
        item(2, CURVE, north=35.0, east=15.0, z=8.0),
        item(3, CURVE, north=20.0, east=30.0, z=8.0),
        item(4, CURVE, 2.0, north=5.0, east=30.0, z=6.0),
        item(5, WAYPOINT, north=5.0, east=20.0, z=6.0),
    )
    flight = copter.run(33.0)
    assert reached(copter)[:3] == [1, 2, 3]
    for north, east in ((20.0, 0.0), (35.0, 15.0), (20.0, 30.0)):
        away = np.hypot(flight[:, 7] - north, flight[:, 8] - east)
        nearest = int(away.argmin())
        assert away[nearest] < 0.05  # the target; waypoints of straight legs are passed at a distance
        assert np.hypot(flight[nearest, 4], flight[nearest, 5]) > 2.0
    assert np.abs(np.diff(flight[:, 7:9], axis=0)).max() < 0.03
    said = texts(copter)
    assert said[:4] == ["Reached command #1", "Mission: 2 SplineWP", "Reached command #2", "Mission: 3 SplineWP"]
    copter.run(14.0)
    times = {m.seq: t for t, m in copter.heard if m.get_type() == "MISSION_ITEM_REACHED"}
    assert list(times) == [1, 2, 3, 4, 5]
    assert times[4] - times[3] > 2.0


def test_a_spline_can_be_paused_and_slowed() -> None:
    copter = flying(item(1, CURVE, north=70.0, east=70.0, z=6.0), item(2, WAYPOINT, north=1.0, east=70.0, z=6.0))
    copter.run(9.0)
    speed = float(np.hypot(*copter.v["velocity"][:2]))
    assert speed > 4.0
    assert copter.ask(SPEED, 1, 2.0, -1)[0] == ("ACK", SPEED, ACCEPTED)
    copter.run(9.0)
    assert np.hypot(*copter.v["velocity"][:2]) == pytest.approx(2.0, rel=0.06)
    pause = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
    assert copter.ask(pause, 0)[0] == ("ACK", pause, ACCEPTED)
    copter.run(6.0)
    assert np.hypot(*copter.v["velocity"][:2]) < 0.1
    assert copter.ask(pause, 1)[0] == ("ACK", pause, ACCEPTED)
    copter.run(13.0)
    assert np.hypot(*copter.v["velocity"][:2]) == pytest.approx(2.0, rel=0.06)
