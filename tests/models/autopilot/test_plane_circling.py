"""Circles of planes: the law beside figures worked out by hand, and radius, bank and capture beside ArduPlane's."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cosim_models.autopilot.plane_autopilot import PlaneAutopilot
from cosim_models.autopilot.wing.circling import is_on_circle, leave_circle, towards_circle
from tests.models.autopilot.test_plane_legs import SIMULATED
from tests.models.autopilot.test_plane_pilot import FBWA, GRAVITY, angles, high, speed
from tests.models.autopilot.test_small_autopilots import SET_MODE, started
from tests.models.copter import preset
from tests.models.pair import ACCEPTED, Pair

TAKEOFF, GUIDED = 13, 15


def moving(n: float, e: float, north: float, east: float, nose: float = 0.0) -> Any:
    """An autopilot's record there, with a velocity [m/s] and a heading [rad]."""
    m = PlaneAutopilot.record()
    m["position"][:] = n, e, -100.0
    m["velocity"][:] = north, east, 0.0
    m["attitude"][:] = math.cos(0.5 * nose), 0.0, 0.0, math.sin(0.5 * nose)
    return m


@pytest.mark.parametrize(
    ("place", "velocity", "radius", "expected"),
    [
        ((80.0, 0.0), (0.0, 20.0), 80.0, 5.0),  # 20^2 / 80
        ((80.0, 0.0), (0.0, -20.0), -80.0, -5.0),
        ((90.0, 0.0), (0.0, 20.0), 80.0, 5.8104),  # and 10 m (2 pi / 17 s)^2, on 90 m
        ((90.0, 0.0), (0.0, -20.0), -80.0, -5.8104),
        ((80.0, 0.0), (2.0, 20.0), 80.0, 6.1088),  # and 2 m/s 2 0.75 2 pi / 17 s
        ((30.0, 0.0), (0.0, 20.0), 80.0, 3.1699),  # 20^2 / 40, half of the radius, less 50 m (2 pi / 17 s)^2
        ((400.0, 0.0), (-17.3205, 10.0), 80.0, 5.5440),  # from afar, 30 degrees off: 2 0.75 2 pi / 17 s 10 m/s
        ((400.0, 0.0), (-17.3205, -10.0), 80.0, -5.5440),
        ((400.0, 0.0), (17.3205, 10.0), 80.0, 11.0880),  # away from it: as much as at a right angle
        ((60.0, 0.0), (1.0, -17.3205), 80.0, 5.0),  # the wrong way round and outwards: 300 / 60 without 2.2 less
    ],
)
def test_the_law_asks_for_what_its_source_says(
    place: tuple[float, float], velocity: tuple[float, float], radius: float, expected: float
) -> None:
    m = moving(*place, *velocity)
    assert towards_circle(m, 0.0, 0.0, radius) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("nose", "expected"), [(0.0, 1.0), (math.pi, -1.0)])
def test_with_the_centre_behind_it_keeps_its_turn(nose: float, expected: float) -> None:
    """Unless its nose looks towards the centre, as in a gale."""
    m = moving(400.0, 0.0, 20.0, 1.0, nose)
    assert towards_circle(m, 0.0, 0.0, 80.0) > 0.0
    m["velocity"][1] = -1.0
    assert math.copysign(1.0, towards_circle(m, 0.0, 0.0, 80.0)) == expected
    m["velocity"][:2] = 0.0, -20.0
    assert towards_circle(m, 0.0, 0.0, 80.0) < 0.0


def test_it_stays_on_a_circle_in_a_gust_until_it_leaves_or_gets_another() -> None:
    m = moving(400.0, 0.0, -20.0, 0.0)
    towards_circle(m, 0.0, 0.0, 80.0)
    assert not is_on_circle(m, 0.0, 0.0)
    m["position"][0] = 80.0
    towards_circle(m, 0.0, 0.0, 80.0)
    assert is_on_circle(m, 0.0, 0.0) and not is_on_circle(m, 0.0, 1.0)
    m["position"][0] = 400.0
    towards_circle(m, 0.0, 0.0, 80.0)
    assert is_on_circle(m, 0.0, 0.0)
    towards_circle(m, 0.0, 0.0, 90.0)
    assert not is_on_circle(m, 0.0, 0.0)
    m["position"][0] = 80.0
    towards_circle(m, 0.0, 0.0, 80.0)
    leave_circle(m)
    assert not is_on_circle(m, 0.0, 0.0)


def steady(p: Pair, n: float, e: float) -> tuple[float, float]:
    """Radius [m], and how much it changes, in 20 s."""
    found = []
    for _ in range(100):
        p.until(p.time + 0.2)
        found.append(math.hypot(p.place[0] - n, p.place[1] - e))
    return float(np.mean(found)), max(found) - min(found)


@pytest.mark.parametrize(("period", "damping"), [(17.0, 0.75), (20.0, 0.75), (14.0, 0.85)])
def test_a_steady_circle_has_the_bank_of_the_law(period: float, damping: float) -> None:
    p = high(GUIDED)
    p.m.NAVL1_PERIOD, p.m.NAVL1_DAMPING = period, damping
    p.until(p.time + 60.0)
    radius, change = steady(p, *(float(x) for x in p.m.guided_position[:2]))
    assert change < 0.1
    _, pitch, _ = angles(p)
    expected = (2.0 * math.pi / period) ** 2 * (radius - 80.0) + speed(p) ** 2 / radius
    asked = math.tan(p.m.asked_bank) * GRAVITY * math.cos(math.radians(pitch))
    assert asked == pytest.approx(expected, rel=2e-3)


def test_the_circle_of_arduplane_s_own_plane_is_as_wide_as_there() -> None:
    """ArduPlane at sea level: radius, least distance, time from 200 m on until it is within 5 m of the radius, bank."""
    p = started("plane", values=preset("ardupilot_plane"), pilot=SIMULATED | {"NAVL1_PERIOD": 15.0})
    assert p.ask(SET_MODE, 1, TAKEOFF) == ACCEPTED
    p.until(35.0)
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert p.reposition(400.0, 500.0, 80.0) == ACCEPTED
    rows = []
    while p.time < 110.0:
        p.until(p.time + 0.1)
        rows.append((p.time, math.hypot(p.place[0] - 400.0, p.place[1] - 500.0)))
    found = np.array(rows)
    radius = found[-200:, 1].mean()
    near = found[found[:, 1] < 200.0][0, 0]
    captured = found[np.abs(found[:, 1] - radius) > 5.0][-1, 0]
    assert radius == pytest.approx(92.1, abs=1.0)
    assert found[:, 1].min() == pytest.approx(67.6, abs=1.5)
    assert captured - near == pytest.approx(12.8, abs=0.5)
    assert math.degrees(p.m.asked_bank) == pytest.approx(36.6, abs=0.3)
    assert angles(p)[0] == pytest.approx(36.6, abs=1.0)


def test_a_pilot_s_mode_leaves_the_circle() -> None:
    p = high(GUIDED)
    p.until(p.time + 30.0)
    n, e = (float(x) for x in p.m.guided_position[:2])
    assert is_on_circle(p.m, n, e)
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    p.until(p.time + 1.0)
    assert not is_on_circle(p.m, n, e)
