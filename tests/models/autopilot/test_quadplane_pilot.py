"""Modes of a quadplane that a pilot flies: on the rotors, on the wing, and from one to the other."""

from __future__ import annotations

import math
from functools import cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import euler_from_quaternion
from cosim_models.autopilot.quadplane_autopilot import QuadplaneAutopilot
from cosim_models.vehicles.quadplane import Quadplane
from tests.models.autopilot.test_quadplane_autopilot import hovering, started, state
from tests.models.autopilot.test_small_autopilots import SET_MODE
from tests.models.pair import ACCEPTED, FAILED, Pair

FBWA, CRUISE, QSTABILIZE, QHOVER, QLOITER, QLAND, QACRO, LOITER_ALT_QLAND = 5, 7, 17, 18, 19, 20, 23, 25
FULL = 2000


@cache
def _hovering() -> Pair:
    return hovering()


def aloft(mode: int) -> Pair:
    """A quadplane that hovered at 10 m, in a mode."""
    before, p = _hovering(), Pair(Quadplane, QuadplaneAutopilot)
    p.go_on_from(before)
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    return p


def sticks(
    p: Pair, duration: float, roll: int = 1500, pitch: int = 1500, throttle: int = 1500, yaw: int = 1500
) -> None:
    """Overrides the four channels, twice a second."""
    p.hold(duration, (roll, pitch, throttle, yaw), 0.5)


def share(pulse: int) -> float:
    return math.copysign(max(abs(pulse - 1500) - 30.0, 0.0) / 470.0, pulse - 1500)


def angles(p: Pair) -> tuple[float, float, float]:
    """Roll, pitch, heading [deg]."""
    roll, pitch, yaw = euler_from_quaternion(tuple(map(float, p.v.attitude)))
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def test_qhover_leans_and_climbs_as_the_sticks_say() -> None:
    p = aloft(QHOVER)
    sticks(p, 6.0, throttle=FULL)
    assert float(p.v.velocity[2]) == pytest.approx(-2.5, abs=0.1)  # Q_PILOT_SPD_UP
    top = -p.place[2]
    sticks(p, 5.0)
    assert -p.place[2] == pytest.approx(top, abs=1.0)
    assert float(p.v.velocity[2]) == pytest.approx(0.0, abs=0.2)
    sticks(p, 3.0, roll=1700)
    assert angles(p)[0] == pytest.approx(30.0 * share(1700), abs=1.0)  # Q_ANGLE_MAX
    p.m.Q_PILOT_SPD_DN = 1.0
    sticks(p, 5.0, throttle=1300)
    assert float(p.v.velocity[2]) == pytest.approx(-share(1300), abs=0.15)


def test_qloiter_moves_with_its_speed_brakes_and_stays() -> None:
    p = aloft(QLOITER)
    sticks(p, 12.0, pitch=1300)
    north, east = map(float, p.v.velocity[:2])
    assert math.hypot(north, east) == pytest.approx(5.0 * share(1700), rel=0.06)  # Q_LOIT_SPEED, forwards
    assert math.atan2(east, north) == pytest.approx(math.radians(angles(p)[2]), abs=0.1)
    sticks(p, 7.0)
    place = p.place
    sticks(p, 4.0)
    assert math.dist(p.place, place) < 0.3
    sticks(p, 2.0, yaw=1600)
    assert float(p.v.angular_velocity[2]) > 0.1
    p.until(p.time + 8.0)
    held = angles(p)[2]
    p.until(p.time + 2.0)
    assert angles(p)[2] == pytest.approx(held, abs=2.0)
    assert math.dist(p.place[:2], place[:2]) < 1.0


def test_a_pilot_takes_off_and_lands_in_qloiter() -> None:
    p = started()
    assert p.ask(SET_MODE, 1, QLOITER) == ACCEPTED
    p.until(p.time + 1.0)
    assert not p.m.motor[4:].any()
    sticks(p, 4.0, throttle=FULL)
    assert -p.place[2] > 4.0
    sticks(p, 14.0, throttle=1300)
    assert -p.place[2] < 0.2 and abs(angles(p)[0]) < 2.0
    sticks(p, 3.0, throttle=1000)
    assert not p.m.motor[4:].any() and p.m.armed


def test_qstabilize_thrusts_as_the_throttle_says() -> None:
    p = aloft(QSTABILIZE)
    sticks(p, 2.0, roll=1600, throttle=1515)  # half of its way is the thrust of the hover
    assert angles(p)[0] == pytest.approx(30.0 * share(1600), abs=1.0)
    assert abs(float(p.v.velocity[2])) < 0.5
    sticks(p, 0.2, throttle=FULL)
    assert float(p.v.velocity[2]) < -0.5
    sticks(p, 0.2, throttle=1000)
    assert not p.m.motor[4:].any()


def test_qacro_asks_for_rates() -> None:
    p = aloft(QACRO)
    sticks(p, 0.5, pitch=1560, throttle=1515)
    first = angles(p)[1]
    sticks(p, 0.5, pitch=1560, throttle=1515)
    rate = 180.0 * share(1560)  # Q_ACRO_PIT_RATE
    assert (angles(p)[1] - first) / 0.5 == pytest.approx(rate, rel=0.3)


def test_from_the_rotors_to_the_wing_in_fbwa_and_down_again() -> None:
    p = aloft(QHOVER)
    sticks(p, 12.0, throttle=FULL)
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    sticks(p, 1.0, throttle=1700)
    assert state(p) == mavlink.MAV_VTOL_STATE_TRANSITION_TO_FW
    sticks(p, 14.0, throttle=1700)
    assert state(p) == mavlink.MAV_VTOL_STATE_FW
    assert not p.m.motor[4:].any()
    assert p.m.motor[2] == pytest.approx((1700.0 - 1030.0) / 970.0)  # the pilot's
    sticks(p, 4.0, roll=1700, throttle=1700)
    assert angles(p)[0] == pytest.approx(18.0, abs=1.5)
    while not p.m.motor[4:].any():  # too slow for the wing: the rotors help
        sticks(p, 0.5, pitch=1800, throttle=1000)
        assert p.time < 80.0
    assert p.ask(SET_MODE, 1, LOITER_ALT_QLAND) == ACCEPTED
    while p.m.mode == LOITER_ALT_QLAND:
        p.one_step()
        assert p.time < 250.0
    assert p.m.mode == QLAND
    assert -p.place[2] == pytest.approx(15.0, abs=4.0)  # Q_RTL_ALT
    while p.m.armed:
        p.one_step()
        assert p.time < 350.0
    assert abs(p.place[2]) < 0.3


@pytest.mark.parametrize("mode", [0, 3, 4])
def test_without_assistance_the_rotors_stop(mode: int) -> None:
    p = aloft(QHOVER)
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    p.until(p.time + 0.1)
    assert not p.m.motor[4:].any()


def test_transitions_are_told() -> None:
    p = aloft(QHOVER)
    sticks(p, 6.0, throttle=FULL)
    p.heard.clear()
    assert p.ask(SET_MODE, 1, CRUISE) == ACCEPTED
    sticks(p, 14.0)
    told = [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    start, reached, done = told
    assert start.startswith("Transition started airspeed ") and float(start.split()[-1]) < 1.0
    assert reached.startswith("Transition airspeed reached ")
    assert float(reached.split()[-1]) == pytest.approx(12.0, abs=0.2)  # AIRSPEED_MIN
    assert done == "Transition done"


def test_in_a_mode_of_the_rotors_it_lands_at_once() -> None:
    p = aloft(QLOITER)
    assert p.ask(SET_MODE, 1, LOITER_ALT_QLAND) == ACCEPTED
    assert p.m.mode == QLAND


def test_avoid_adsb_circles_on_the_wing() -> None:
    p = aloft(15)
    assert p.ask(SET_MODE, 1, 14) == ACCEPTED
    assert p.last("MISSION_ITEM_REACHED").seq == 0
    p.until(p.time + 20.0)
    assert state(p) == mavlink.MAV_VTOL_STATE_FW


@pytest.mark.parametrize("mode", [22, 24, 26])
def test_modes_that_it_does_not_have_are_refused(mode: int) -> None:
    p = aloft(QHOVER)
    assert p.ask(SET_MODE, 1, mode) == FAILED
    p.one_step()
    assert "Flight mode change failed" in [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    assert p.m.mode == QHOVER
