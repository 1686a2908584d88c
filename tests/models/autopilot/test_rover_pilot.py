"""Modes of a rover that a pilot drives, and LOITER, CIRCLE and SMART_RTL, beside closed forms of its motion."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial import cKDTree

from tests.models.autopilot.test_small_autopilots import ARM, REQUEST, SET_MODE, made, started
from tests.models.pair import ACCEPTED, FAILED, Pair

MANUAL, ACRO, STEERING, HOLD, LOITER, SIMPLE, CIRCLE, SMART_RTL = 0, 1, 3, 4, 5, 7, 9, 12
GRAVITY = 9.80665
FASTEST = 20.0
"""m/s: CRUISE_SPEED 5 over CRUISE_THROTTLE 25 %."""


def sticks(p: Pair, duration: float, steer: int = 1500, throttle: int = 1500, system: int = 255) -> None:
    """Overrides two channels, twice a second."""
    end, station = p.time + duration, mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    while p.time < end - 1e-9:
        message = mavlink.MAVLink_rc_channels_override_message(1, 1, steer, 65535, throttle, 65535, 0, 0, 0, 0)
        p.waiting += message.pack(station)
        p.until(min(p.time + 0.5, end))


def share(pulse: int) -> float:
    """Deflection of a stick with 1000, 1500 and 2000 us and a dead zone of 30 us."""
    return math.copysign(max(abs(pulse - 1500) - 30.0, 0.0) / 470.0, pulse - 1500)


def driving(mode: int, **more: Any) -> Pair:
    p = started("rover", **more)
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    return p


def turn(p: Pair) -> tuple[float, float]:
    """Speed ahead [m/s] and turn rate [rad/s]."""
    return float(p.v.speed), float(p.v.angular_velocity[2])


def texts(p: Pair) -> list[str]:
    return [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]


def test_manual_passes_the_sticks_on_to_the_wheels() -> None:
    p = driving(MANUAL)
    sticks(p, 12.0, 1700, 1580)
    speed, rate = turn(p)
    lock = float(p.v.wheel_angle_max)
    radius = float(p.v.turning_radius) * math.sin(lock) / math.sin(share(1700) * lock)  # of the Ackermann steering
    assert speed / rate == pytest.approx(radius, rel=1e-3)
    assert p.m.motor[1] == pytest.approx(0.5 + 0.5 * share(1580), abs=1e-9)
    before = float(p.m.motor[1])
    sticks(p, 0.25, 1700, 2000)  # MOT_SLEWRATE: 100 % in a second
    assert p.m.motor[1] - before == pytest.approx(0.125, abs=0.01)
    sticks(p, 8.0, 1700, 1400)
    assert turn(p)[0] < 0.0 and turn(p)[1] * turn(p)[0] < 0.0  # backwards, the wheels stand as the stick says
    p.until(p.time + 5.0)  # the override has ended
    assert p.m.motor[:2].tolist() == [0.5, 0.5]


def test_acro_turns_at_the_rate_of_the_stick() -> None:
    p = driving(ACRO)
    sticks(p, 10.0, 1700, 1570)
    speed, rate = turn(p)
    assert speed == pytest.approx(share(1570) * FASTEST, rel=0.02)
    assert rate == pytest.approx(math.radians(180.0) * share(1700), rel=0.02)
    sticks(p, 10.0, 2000, 1590)
    assert turn(p)[1] == pytest.approx(math.radians(120.0), rel=0.03)  # ATC_STR_RAT_MAX
    sticks(p, 15.0, 2000, 1750)
    speed, rate = turn(p)
    assert speed * rate == pytest.approx(0.6 * GRAVITY, rel=0.03)  # ATC_TURN_MAX_G
    sticks(p, 11.0, 1500, 1500)  # by ATC_ACCEL_MAX
    assert turn(p) == pytest.approx((0.0, 0.0), abs=0.06)


def test_steering_asks_for_a_lateral_acceleration() -> None:
    p = driving(STEERING)
    sticks(p, 12.0, 1650, 1600)
    speed, rate = turn(p)
    assert speed == pytest.approx(share(1600) * FASTEST, rel=0.02)
    assert speed / rate == pytest.approx(speed**2 / (share(1650) * 0.6 * GRAVITY), rel=0.02)
    p.m.ATC_TURN_MAX_G = 3.0  # then the turn of TURN_RADIUS is the limit
    p.m.TURN_RADIUS = 4.0
    sticks(p, 14.0, 1650, 1575)
    speed, rate = turn(p)
    assert speed / rate == pytest.approx(4.0 / share(1650), rel=0.05)


def test_simple_drives_where_the_sticks_point_from_the_first_heading() -> None:
    p = driving(SIMPLE, values={"yaw_start": 0.6})
    sticks(p, 10.0, 1600, 1600)
    north, east = p.v.velocity[:2]
    assert math.atan2(east, north) == pytest.approx(0.6 + math.pi / 4.0, abs=0.02)
    assert math.hypot(north, east) == pytest.approx(math.sqrt(2.0) * share(1600) * FASTEST, rel=0.03)
    sticks(p, 10.0, 1500, 1400)
    assert math.atan2(p.v.velocity[1], p.v.velocity[0]) == pytest.approx(0.6 - math.pi, abs=0.05)


def test_sticks_of_others_are_not_obeyed_and_manual_control_is() -> None:
    p = driving(MANUAL)
    sticks(p, 2.0, 1700, 1700, system=254)
    assert p.m.motor[:2].tolist() == [0.5, 0.5]
    for target, throttle in ((2, 0.0), (1, 0.4)):
        p.send(mavlink.MAVLink_manual_control_message(target, 0, -500, 400, 0, 0))
        p.until(p.time + 1.0)
        pulse = 1500.0 + 500.0 * throttle
        assert p.m.motor[1] == pytest.approx(0.5 + 0.5 * share(int(pulse)), abs=1e-6)
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_RC_CHANNELS) == ACCEPTED
    channels = p.last("RC_CHANNELS")
    assert (channels.chan1_raw, channels.chan2_raw, channels.chan3_raw) == (1250, 1500, 1700)
    p.send(mavlink.MAVLink_manual_control_message(1, 0, 32767, 32767, 0, 0))  # releases both
    p.one_step()
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_RC_CHANNELS) == ACCEPTED
    assert (p.last("RC_CHANNELS").chan1_raw, p.last("RC_CHANNELS").chan3_raw) == (1500, 1500)
    p.m.RC_OVERRIDE_TIME = 0.0
    sticks(p, 1.0, 1700, 1700)
    assert p.m.motor[0] == 0.5


def test_hold_commands_nothing() -> None:
    p = driving(ACRO)
    sticks(p, 6.0, 1500, 1600)
    assert p.ask(SET_MODE, 1, HOLD) == ACCEPTED
    p.until(p.time + 1.0)
    assert p.m.motor[:2].tolist() == [0.5, 0.5]
    before = float(p.v.speed)
    p.until(p.time + 1.0)
    lag = float(p.v.speed_max / p.v.acceleration_max)
    assert p.v.speed == pytest.approx(before * math.exp(-1.0 / lag), rel=1e-3)  # it coasts


def test_loiter_stops_where_it_can_and_comes_back() -> None:
    p = driving(ACRO)
    sticks(p, 8.0, 1500, 1600)
    speed, north = float(p.v.speed), p.place[0]
    assert p.ask(SET_MODE, 1, LOITER) == ACCEPTED
    stop = north + 0.5 * speed**2  # ATC_ACCEL_MAX 1 m/s2
    assert p.m.guided_position[0] == pytest.approx(stop, abs=0.1)
    p.until(p.time + 15.0)
    assert abs(p.place[0] - stop) < 2.2  # LOIT_RADIUS
    assert p.v.speed == pytest.approx(0.0, abs=0.05)
    p.v.position[0] += 10.0  # carried away: it comes back, backwards
    p.until(p.time + 2.0)
    assert p.v.speed < 0.0
    p.until(p.time + 15.0)
    assert abs(p.place[0] - stop) < 2.2


@pytest.mark.parametrize("direction", [0, 1])
def test_it_circles_the_place_where_it_was(direction: int) -> None:
    p = driving(CIRCLE, pilot={"CIRC_RADIUS": 12.0, "CIRC_SPEED": 3.0, "CIRC_DIR": direction})
    p.until(p.time + 25.0)
    away, begin = [], math.atan2(p.place[1], p.place[0])
    turned, last = 0.0, begin
    for _ in range(800):
        p.one_step()
        away.append(math.hypot(*p.place[:2]))
        now = math.atan2(p.place[1], p.place[0])
        turned += (now - last + math.pi) % (2.0 * math.pi) - math.pi
        last = now
    assert (min(away), max(away)) == pytest.approx((12.0, 12.0), abs=0.6)
    assert turned == pytest.approx((1.0 - 2.0 * direction) * 3.0 * 10.0 / 12.0, rel=0.03)


def test_smart_rtl_goes_back_the_way_it_came() -> None:
    p = driving(MANUAL)
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    corners = ((20.0, 0.0), (20.0, 25.0))
    came = []
    for n, e in corners:
        p.go(n, e, 0.0)
        for _ in range(140):
            p.until(p.time + 0.1)
            came.append(p.place[:2])
    assert p.ask(SET_MODE, 1, SMART_RTL) == ACCEPTED
    back = []
    while "Reached destination" not in texts(p):
        p.one_step()
        back.append(p.place[:2])
        assert p.time < 90.0
    assert cKDTree(came).query(back)[0].max() < 4.0  # the direct way is up to 12 m from this one
    p.until(p.time + 6.0)
    assert math.hypot(*p.place[:2]) < 2.0
    assert p.m.mode == SMART_RTL and float(p.v.speed) == pytest.approx(0.0, abs=0.05)


def test_smart_rtl_is_refused_without_a_path() -> None:
    p = made("rover")
    p.until(2.5)
    assert p.ask(SET_MODE, 1, SMART_RTL) == FAILED
    assert texts(p) == ["Flight mode change failed"]
    p.m.SRTL_POINTS = 3
    assert p.ask(SET_MODE, 1, MANUAL) == ACCEPTED
    assert p.ask(ARM, 1) == ACCEPTED
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    for n, e in ((8.0, 0.0), (8.0, 8.0), (0.0, 16.0), (16.0, 16.0), (16.0, 0.0)):
        p.go(n, e, 0.0)
        p.until(p.time + 8.0)
    assert "SmartRTL deactivated: buffer full" in texts(p)
    assert p.ask(SET_MODE, 1, SMART_RTL) == FAILED
    for unknown in (2, 13, 17):
        assert p.ask(SET_MODE, 1, unknown) == FAILED
        p.one_step()
        assert f"No such mode {unknown}" in texts(p)
