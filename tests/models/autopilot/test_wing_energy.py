"""What planes and quadplanes do with heights and speeds for which the engine or the wing is too weak."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.models.autopilot.test_quadplane_autopilot import GUIDED, QRTL, hovering
from tests.models.autopilot.test_small_autopilots import SET_MODE, SPEED, started
from tests.models.pair import ACCEPTED, Pair

TAKEOFF, LOITER = 13, 12


def circling(height: float, **pilot: float) -> Pair:
    """A quadplane on its wing around a place, after 45 s there."""
    p = hovering(pilot={"Q_GUIDED_MODE": 0, **pilot})
    assert p.reposition(100.0, 0.0, height) == ACCEPTED
    p.until(80.0)
    return p


def plane_at(height: float, **pilot: float) -> Pair:
    """A plane on the circle of GUIDED."""
    p = started("plane", pilot=pilot)
    assert p.ask(SET_MODE, 1, TAKEOFF) == ACCEPTED
    p.until(20.0)
    assert p.ask(SET_MODE, 1, GUIDED) == ACCEPTED
    assert p.reposition(100.0, 0.0, height, 1.0) == ACCEPTED
    p.until(100.0)
    return p


def speed(p: Pair) -> float:
    return float(np.linalg.norm(p.v.velocity))


def flown(p: Pair, seconds: float) -> Any:
    """Heights and speeds, ten a second."""
    rows = []
    for _ in range(round(10 * seconds)):
        p.until(p.time + 0.1)
        rows.append((-p.place[2], speed(p)))
    return np.array(rows)


def test_a_cruise_above_airspeed_max_is_flown_with_airspeed_max() -> None:
    """With full throttle, the quadplane flies 23.4 m/s: it cannot reach 25 m/s."""
    p = circling(20.0, AIRSPEED_CRUISE=25.0)  # AIRSPEED_MAX 20
    assert p.ask(SET_MODE, 1, LOITER) == ACCEPTED
    rows = flown(p, 40.0)
    assert np.abs(rows[:, 0] - 20.0).max() < 0.8
    assert rows[:, 1].mean() == pytest.approx(20.0, abs=0.2)


def test_a_cruise_beyond_the_engine_costs_the_height_that_its_energy_is_worth() -> None:
    p = circling(30.0, AIRSPEED_CRUISE=25.0, AIRSPEED_MAX=35.0)
    rows = flown(p, 60.0)
    assert p.v.motor[2] == 1.0
    assert rows[-1, 1] == pytest.approx(23.4, abs=0.2)
    assert rows[-1, 0] == pytest.approx(30.0 - (25.0**2 - 23.4**2) / 2.0 / 9.80665, abs=0.3)  # 26.1 m
    p.m.TECS_SPDWEIGHT = 0.0  # the pitch is for the height alone
    assert flown(p, 30.0)[-1, 0] == pytest.approx(30.0, abs=0.1)


def test_a_change_of_speed_beyond_the_engine_is_forgotten_while_the_throttle_is_at_its_limit() -> None:
    p = circling(30.0, AIRSPEED_MAX=35.0)
    assert p.ask(SPEED, 0, 30.0) == ACCEPTED
    rows = flown(p, 80.0)
    assert rows[:, 0].min() > 19.0
    # AIRSPEED_MAX sinks by TECS_SINK_MIN g / 2 v = 0.42 m/s2, from 35 to 23.4 m/s within 28 s
    assert rows[-1] == pytest.approx([30.0, 23.4], abs=0.4)


def test_a_weak_engine_climbs_slowly_and_does_not_stall() -> None:
    p = circling(30.0, THR_MAX=78.0)
    assert p.reposition(100.0, 0.0, 130.0) == ACCEPTED
    rows = flown(p, 40.0)
    assert rows[:, 1].min() > 13.5  # AIRSPEED_CRUISE 16, AIRSPEED_MIN 12
    assert (rows[-1, 0] - rows[100, 0]) / 30.0 == pytest.approx(1.6, abs=0.2)  # TECS_CLMB_MAX 5 m/s is asked for
    rows = flown(p, 60.0)
    assert rows[:, 0].max() < 131.0 and rows[-1] == pytest.approx([130.0, 16.0], abs=0.3)


def test_without_an_engine_it_glides_and_does_not_stall() -> None:
    p = plane_at(200.0)
    p.v.motor_speed = 12.0  # m/s: the propeller brakes
    flown(p, 10.0)
    rows = flown(p, 20.0)
    assert rows[:, 1].min() > 15.0 and rows[:, 1].max() < 20.0  # AIRSPEED_MIN 18
    assert (rows[0, 0] - rows[-1, 0]) / 19.9 == pytest.approx(4.6, abs=0.3)


@pytest.mark.parametrize(("prevention", "expected"), [(1, 18.87), (0, 18.0)])
def test_in_a_turn_the_least_speed_is_that_of_the_load(prevention: int, expected: float) -> None:
    """18 m/s on a circle of 80 m: 24.2 degrees for 18.87 m/s, with which the wing needs 18 / sqrt(cos 24.4)."""
    p = plane_at(100.0, STALL_PREVENTION=prevention)
    assert p.ask(SPEED, 0, 18.0) == ACCEPTED
    assert flown(p, 60.0)[-100:, 1].mean() == pytest.approx(expected, abs=0.1)


def test_a_return_that_begins_away_from_home_walks_there_with_its_nose_ahead() -> None:
    p = circling(20.0, AIRSPEED_CRUISE=25.0)
    while not (p.v.velocity[0] > 0.9 * speed(p) and p.place[0] > 50.0):  # away from home
        p.one_step()
        assert p.time < 130.0
    began = math.hypot(*p.place[:2])
    p.heard.clear()
    assert p.ask(SET_MODE, 1, QRTL) == ACCEPTED
    lowest, fastest = math.inf, 0.0
    said: list[str] = []
    while "Land descend started" not in said:
        p.until(p.time + 0.25)
        said = [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
        lowest = min(lowest, -p.place[2])
        homewards = -float(np.dot(p.v.velocity[:2], p.place[:2])) / math.hypot(*p.place[:2])
        fastest = max(fastest, homewards)
        assert p.time < 250.0
    (overshot,) = [text for text in said if text.startswith("VTOL Overshoot d=")]
    assert " cs=-" in overshot and " yerr=" in overshot
    assert lowest > 13.0  # Q_RTL_ALT 15; it went down to the ground
    assert fastest < 5.8  # Q_WP_SPEED 5 m/s; it was 11 m/s
    assert began > 50.0
    while p.m.armed:
        p.one_step()
    assert p.place == pytest.approx([0.0, 0.0, 0.0], abs=0.3)
