"""Legs with S-curves: limits, ends and durations, against numerical integration and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from cosim_models.autopilot.control.scurve import (
    BEGIN,
    DURATION,
    EARLY,
    END,
    LEG,
    along_leg,
    begin_leg_at,
    end_leg_at,
    plan_leg,
    top_speed,
)

JERK, SNAP = 1.0, 0.25 * math.pi / 0.15
SPEEDS, ACCELS = (10.0, 2.5, 1.5), (2.5, 1.0)
TJ = JERK * math.pi / (2.0 * SNAP)


def leg(
    n: float, e: float, u: float, jerk: float = JERK, snap: float = SNAP, accels: tuple[float, float] = ACCELS
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    row = np.full(LEG, np.nan)
    plan_leg(row, n, e, u, SPEEDS, accels, jerk, snap)
    return row


def farthest(
    values: np.ndarray[tuple[int], np.dtype[np.float64]], others: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> float:
    """The greatest difference; `pytest.approx` takes a hundred times as long for thousands of numbers."""
    return float(np.abs(values - others).max())


@pytest.mark.parametrize("length", [0.02, 0.3, 1.0, 2.0, 5.0, 20.0, 40.0, 80.0, 200.0, 1000.0])
@pytest.mark.parametrize(("jerk", "snap"), [(JERK, SNAP), (5.0, 20.0), (20.0, 100.0)])
def test_motion_keeps_its_limits_and_ends_at_rest(length: float, jerk: float, snap: float) -> None:
    row = leg(0.6 * length, 0.8 * length, 0.0, jerk, snap)
    t = np.linspace(0.0, row[DURATION], 4001)
    a, v, s = np.array([along_leg(row, float(x)) for x in t]).T
    assert (s[0], v[0], a[0]) == (0.0, 0.0, 0.0)
    assert along_leg(row, row[DURATION] - 1e-9) == pytest.approx((0.0, 0.0, length), abs=1e-6)
    scale = max(float(np.abs(a).max()), 1e-6)
    assert farthest(cumulative_trapezoid(a, t, initial=0.0), v) <= 1e-5 * scale * t[-1]
    assert farthest(cumulative_trapezoid(v, t, initial=0.0), s) <= 1e-5 * max(length, 0.1)
    js = np.gradient(a, t)
    assert v.max() <= 10.0 * (1 + 1e-9)
    assert np.abs(a).max() <= 2.5 * (1 + 1e-9)
    assert np.abs(js).max() <= jerk * (1 + 1e-6)
    assert np.abs(np.gradient(js, t)).max() <= snap * 1.02
    assert farthest(a[::-1], -a) <= 1e-6


@pytest.mark.parametrize("length", [200.0, 1000.0])
def test_a_long_leg_takes_its_closed_form(length: float) -> None:
    """All limits are reached: way by speed, speed by acceleration, acceleration by jerk, and the raised cosine."""
    assert leg(length, 0.0, 0.0)[DURATION] == pytest.approx(length / 10.0 + 10.0 / 2.5 + 2.5 / JERK + TJ, rel=1e-9)


def test_a_leg_of_20_m_takes_as_long_as_arducopters() -> None:
    """Neither speed nor acceleration is reached: accel (accel / jerk + tj)**2 is half of the way. ArduCopter: 9.3 s."""
    top = brentq(lambda a: a * (a / JERK + TJ) ** 2 - 10.0, 0.1, 2.5, xtol=1e-13)
    duration = leg(20.0, 0.0, 0.0)[DURATION]
    assert duration == pytest.approx(4.0 * (top / JERK + TJ), rel=1e-9)
    assert duration == pytest.approx(9.3, rel=0.05)


@pytest.mark.parametrize(("length", "early"), [(5.0, 0.088), (10.0, 0.101), (30.0, 0.126), (60.0, 0.145)])
def test_a_leg_has_ended_where_32_bits_cannot_tell(length: float, early: float) -> None:
    """ArduCopter's: 0.065 s on a climb of 5 m, 0.10 s on 10 m, 0.13 s on 30 m, by numpy's float32 on its formulas."""
    row = leg(length, 0.0, 0.0)
    left = 4.0 * np.spacing(np.float32(1.0)) * length
    by_search = brentq(lambda t: length - along_leg(row, row[DURATION] - t)[2] - left, 1e-3, TJ, xtol=1e-12)
    assert row[EARLY] == pytest.approx(by_search, rel=0.02)
    assert row[EARLY] == pytest.approx(early, abs=0.001)


def test_a_leg_that_does_not_end_at_rest_ends_on_time() -> None:
    row = leg(30.0, 0.0, 0.0)
    end_leg_at(row, 2.0)
    assert row[EARLY] == 0.0
    begin_leg_at(row, 1.0)
    assert row[END] == pytest.approx(0.0, abs=1e-12)
    assert row[EARLY] == pytest.approx(leg(30.0, 0.0, 0.0)[EARLY], rel=1e-9)


def test_limits_belong_to_directions() -> None:
    row = leg(0.0, 0.0, 30.0)
    assert max(along_leg(row, float(t))[1] for t in np.linspace(0, row[DURATION], 200)) == pytest.approx(2.5, rel=1e-3)
    down = leg(0.0, 0.0, -30.0)
    assert along_leg(down, 0.5 * down[DURATION])[1] == pytest.approx(1.5)
    slope = leg(30.0, 0.0, 40.0)
    assert along_leg(slope, 0.5 * slope[DURATION])[1] == pytest.approx(2.5 / 0.8)  # climbs at 2.5 m/s
    assert leg(0.0, 0.0, 0.0)[DURATION] == 0.0
    assert along_leg(leg(0.0, 0.0, 0.0), 1.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("length", [0.5, 5.0, 20.0, 80.0, 400.0])
@pytest.mark.parametrize(("begin", "end"), [(0.0, 3.0), (2.0, 0.0), (3.0, 3.0), (0.05, 9.0), (50.0, 50.0)])
def test_legs_begin_and_end_at_speeds(length: float, begin: float, end: float) -> None:
    """Acceleration, speed and way belong together, and no limit is exceeded."""
    row = leg(0.6 * length, 0.8 * length, 0.0)
    fastest = top_speed(row)
    assert begin_leg_at(row, begin) == pytest.approx(min(begin, fastest))
    end_leg_at(row, end)
    t = np.linspace(0.0, row[DURATION], 8001)
    a, v, s = np.array([along_leg(row, float(x)) for x in t]).T
    assert v[0] == row[BEGIN] == pytest.approx(min(begin, fastest))
    assert (v[-1], s[-1]) == (row[END], pytest.approx(length))
    assert farthest(cumulative_trapezoid(a, t, initial=0.0) + v[0], v) <= 1e-5 * max(float(v.max()), 1.0)
    assert farthest(cumulative_trapezoid(v, t, initial=0.0), s) <= 1e-5 * max(length, 1.0)
    assert v.max() <= fastest * (1 + 1e-9)
    assert np.abs(a).max() <= 2.5 * (1 + 1e-9)
    assert np.abs(np.gradient(a, t)).max() <= JERK * (1 + 1e-6)
    if length >= 80.0:  # half of the leg is enough for each change
        assert v[-1] == pytest.approx(min(end, fastest))


def test_a_change_of_speed_on_a_long_leg_takes_its_closed_form() -> None:
    """From 1 to 10 m/s and on to 2 m/s: change / accel + accel / jerk + tj each, and the rest at 10 m/s."""
    row = leg(400.0, 0.0, 0.0)
    begin_leg_at(row, 1.0)
    end_leg_at(row, 2.0)
    rise, fall = (change / 2.5 + 2.5 / JERK + TJ for change in (9.0, 8.0))
    rest = (400.0 - 5.5 * rise - 6.0 * fall) / 10.0
    assert row[DURATION] == pytest.approx(rise + rest + fall, rel=1e-9)


def test_a_leg_of_no_length_has_no_speeds() -> None:
    row = leg(0.0, 0.0, 0.0)
    assert begin_leg_at(row, 3.0) == 0.0
    end_leg_at(row, 3.0)
    assert along_leg(row, 0.0) == (0.0, 0.0, 0.0)
