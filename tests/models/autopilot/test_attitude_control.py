"""The attitude controller's geometry against rotation matrices, and its behaviour on a body without dynamics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.frames import euler_from_quaternion, multiply, quaternion_from_euler, rotate
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.control.attitude import (
    attitude_from_thrust,
    follow_heading,
    relax_yaw,
    tilt_and_heading_error,
)

H = 0.0025
angles = st.floats(-3.0, 3.0)
leans = st.floats(-1.2, 1.2)


@settings(deadline=None)
@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), angles)
def test_thrust_points_where_it_is_wanted(n: float, e: float, heading: float) -> None:
    q = attitude_from_thrust(n, e, -9.8, heading)
    length = math.sqrt(n * n + e * e + 9.8 * 9.8)
    assert rotate(q, (0.0, 0.0, -1.0)) == pytest.approx((n / length, e / length, -9.8 / length), abs=1e-12)


@settings(deadline=None)
@given(angles)
def test_level_thrust_leaves_the_heading(heading: float) -> None:
    assert euler_from_quaternion(attitude_from_thrust(0.0, 0.0, -2.0, heading)) == pytest.approx((0.0, 0.0, heading))
    assert euler_from_quaternion(attitude_from_thrust(0.0, 0.0, 0.0, heading)) == pytest.approx((0.0, 0.0, heading))


def test_thrust_straight_down_is_still_an_attitude() -> None:
    q = attitude_from_thrust(0.0, 0.0, 1.0, 0.3)
    assert rotate(q, (0.0, 0.0, -1.0)) == pytest.approx((0.0, 0.0, 1.0))


def turn(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    angle = math.sqrt(x * x + y * y + z * z)
    s = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.0
    return (math.cos(0.5 * angle), x * s, y * s, z * s)


@settings(deadline=None)
@given(leans, leans, angles, leans, leans, angles)
def test_tilt_then_heading_leads_from_body_to_target(
    r1: float, p1: float, y1: float, r2: float, p2: float, y2: float
) -> None:
    body, target = quaternion_from_euler(r1, p1, y1), quaternion_from_euler(r2, p2, y2)
    x, y, z, size = tilt_and_heading_error(target, body)
    assert size == pytest.approx(math.hypot(x, y), abs=1e-9)
    up_body, up_target = rotate(body, (0.0, 0.0, -1.0)), rotate(target, (0.0, 0.0, -1.0))
    assert math.cos(size) == pytest.approx(float(np.dot(up_body, up_target)), abs=1e-9)
    reached = multiply(multiply(body, turn(x, y, 0.0)), turn(0.0, 0.0, z))
    assert abs(float(np.dot(reached, target))) == pytest.approx(1.0, abs=1e-9)


def test_the_error_of_a_body_upside_down_is_half_a_turn() -> None:
    x, y, z, size = tilt_and_heading_error((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    assert (math.hypot(x, y), z, size) == pytest.approx((math.pi, 0.0, math.pi))


class Perfect:
    """A body that turns exactly as the attitude controller wants."""

    def __init__(self) -> None:
        self.m = Autopilot.record()
        self.m["attitude_target"][0] = 1.0
        self.m["q"][0] = 1.0

    def follow(self, n: float, e: float, heading: float, duration: float) -> np.ndarray:
        rows = []
        for _ in range(round(duration / H)):
            follow_heading(self.m, n, e, -9.80665, heading, 0.0, H)
            w = [float(x) for x in self.m["rate_wanted"]]
            q = multiply(tuple(float(x) for x in self.m["q"]), turn(w[0] * H, w[1] * H, w[2] * H))
            self.m["q"][:] = np.array(q) / np.linalg.norm(q)
            self.m["gyro"][:] = w
            rows.append((*w, *euler_from_quaternion(tuple(float(x) for x in self.m["q"])), *self.m["rate_target"]))
        return np.array(rows)


def test_a_lean_is_reached_with_limited_angular_acceleration() -> None:
    flight = Perfect().follow(9.80665 * math.tan(0.3), 0.0, 0.0, 3.0)
    assert flight[-1, 4] == pytest.approx(-0.3, abs=1e-3)
    assert flight[:, 4].min() > -0.31
    shaped = np.diff(flight[:, 7]) / H
    assert np.abs(shaped).max() <= math.radians(1100.0) + 1e-6
    reached = np.argmax(flight[:, 4] < -0.27) * H
    assert 0.1 < reached < 0.6  # time constant of 0.15 s


def test_the_nose_turns_no_faster_than_its_slew_rate() -> None:
    flight = Perfect().follow(0.0, 0.0, 2.5, 8.0)
    assert flight[-1, 5] == pytest.approx(2.5, abs=1e-3)
    assert np.abs(flight[:, 8]).max() <= math.radians(60.0) + 1e-9
    assert np.abs(np.diff(flight[:, 8]) / H).max() <= math.radians(270.0) + 1e-6


def test_the_nose_takes_the_shorter_way() -> None:
    body = Perfect()
    body.follow(0.0, 0.0, 3.0, 8.0)
    flight = body.follow(0.0, 0.0, -3.0, 3.0)
    assert np.abs(flight[:, 5]).min() > 2.9


def test_a_nose_that_cannot_follow_does_not_drag_the_target_away() -> None:
    """The target stays within reach of the yaw controller: 45 degrees at most."""
    body = Perfect()
    for _ in range(round(4.0 / H)):
        follow_heading(body.m, 0.0, 0.0, -9.80665, 3.0, 0.0, H)
    yaw = euler_from_quaternion(tuple(float(x) for x in body.m["attitude_target"]))[2]
    assert 0.1 < yaw <= math.radians(45.0) + 1e-3


def test_relaxing_takes_the_heading_of_the_body_and_keeps_the_lean() -> None:
    m = Autopilot.record()
    m["attitude_target"][:] = quaternion_from_euler(0.1, 0.2, 0.3)
    m["q"][:] = quaternion_from_euler(0.0, 0.0, -1.0)
    m["rate_target"][2] = 0.7
    relax_yaw(m)
    assert euler_from_quaternion(tuple(float(x) for x in m["attitude_target"])) == pytest.approx((0.1, 0.2, -1.0))
    assert m["rate_target"][2] == 0.0
