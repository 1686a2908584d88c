"""Modes of a plane that a pilot flies: what sticks ask for, its limits, and steady turns beside their closed form."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import euler_from_quaternion
from tests.models.autopilot.test_small_autopilots import SET_MODE, made, started
from tests.models.pair import ACCEPTED, FAILED, Pair

MANUAL, CIRCLE, STABILIZE, TRAINING, ACRO, FBWA, FBWB, CRUISE = range(8)
GRAVITY = 9.80665


@cache
def _high() -> Pair:
    p = started("plane", pilot={"TKOFF_ALT": 100.0})
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    p.until(50.0)
    assert -p.place[2] > 90.0
    return p


def high(mode: int) -> Pair:
    """A plane that circles at 100 m, in a mode."""
    before, p = _high(), made("plane")
    p.go_on_from(before)
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    return p


def sticks(
    p: Pair, duration: float, roll: int = 1500, pitch: int = 1500, throttle: int = 1400, yaw: int = 1500
) -> None:
    """Overrides the four channels, four times a second."""
    p.hold(duration, (roll, pitch, throttle, yaw), 0.25)


def angles(p: Pair) -> tuple[float, float, float]:
    """Roll, pitch, heading [deg]."""
    roll, pitch, yaw = euler_from_quaternion(tuple(map(float, p.v.attitude)))
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def speed(p: Pair) -> float:
    return float(np.linalg.norm(p.v.velocity))


def course_rate(p: Pair, seconds: float, **held: int) -> float:
    """Mean rate of turn of the velocity [rad/s]."""
    before = math.atan2(p.v.velocity[1], p.v.velocity[0])
    sticks(p, seconds, **held)
    after = math.atan2(p.v.velocity[1], p.v.velocity[0])
    return ((after - before + math.pi) % (2.0 * math.pi) - math.pi) / seconds


def opened(pulse: int) -> float:
    return (pulse - 1030.0) / 970.0


def test_manual_passes_the_sticks_on() -> None:
    p = high(MANUAL)
    sticks(p, 0.5, 1600, 1520, 2000, 1400)
    expected = [0.6, 0.52, 1.0, 0.5 - 0.5 * 70.0 / 470.0]  # the stick of yaw has a dead zone
    assert p.m.motor[:4].tolist() == pytest.approx(expected)
    p.until(p.time + 3.0)  # the override has ended
    assert p.m.motor[:4].tolist() == [0.5, 0.5, 0.0, 0.5]


def test_fbwa_banks_and_pitches_as_the_sticks_say() -> None:
    p = high(FBWA)
    held = {"roll": 1700, "throttle": 1400, "pitch": 1550}
    sticks(p, 12.0, **held)
    roll, pitch, _ = angles(p)
    assert roll == pytest.approx(0.4 * 45.0, abs=0.5)
    down = 2.0 * (1.0 - 100.0 * opened(1400) / 40.0)  # STAB_PITCH_DOWN, TRIM_THROTTLE
    assert pitch == pytest.approx(0.1 * 20.0 - down, abs=0.5)
    assert p.m.motor[2] == pytest.approx(opened(1400))
    fast = speed(p)
    rate = course_rate(p, 2.0, **held)
    assert rate == pytest.approx(GRAVITY * math.tan(math.radians(roll)) / fast, rel=0.06)
    p.m.THR_MAX = 30.0
    sticks(p, 0.5, **held)
    assert p.m.motor[2] == pytest.approx(0.3)


def test_fbwa_glides_without_a_pilot() -> None:
    p = high(FBWA)
    p.until(p.time + 8.0)
    assert angles(p)[:2] == pytest.approx((0.0, -2.0), abs=1.0)
    assert p.m.motor[2] == 0.0 and p.v.velocity[2] > 0.5


def test_the_bank_stays_within_the_load_that_the_wing_carries() -> None:
    p = high(FBWB)
    p.m.AIRSPEED_MIN = 21.0
    sticks(p, 2.5, roll=2000, throttle=1120)
    assert angles(p)[0] == pytest.approx(math.degrees(math.acos((21.0 / speed(p)) ** 2)), abs=1.5)
    assert 26.0 < angles(p)[0] < 42.0
    sticks(p, 12.0, roll=2000, throttle=1120)
    assert angles(p)[0] > 43.0  # there it flies as fast as the bank needs
    p.m.AIRSPEED_MIN = 40.0
    sticks(p, 5.0, roll=2000, throttle=1120)
    assert angles(p)[0] == pytest.approx(25.0, abs=0.7)
    p.m.STALL_PREVENTION = 0
    sticks(p, 4.0, roll=2000, throttle=1400)
    assert angles(p)[0] == pytest.approx(45.0, abs=1.0)


def test_stabilize_levels_the_wings() -> None:
    p = high(STABILIZE)
    sticks(p, 8.0)
    assert angles(p)[:2] == pytest.approx((0.0, 0.0), abs=0.5)
    sticks(p, 8.0, roll=1600)
    banked = angles(p)[0]
    assert 5.0 < banked < 40.0  # it holds against a part of the stick
    sticks(p, 0.05, roll=2000)
    assert p.m.motor[0] == 1.0  # and against nothing of a full one


def test_training_keeps_within_its_limits() -> None:
    p = high(TRAINING)
    for _ in range(20):
        sticks(p, 0.25, roll=1650, pitch=1560)
        if angles(p)[0] > 44.0:
            break
    tops = []
    for _ in range(12):
        sticks(p, 0.25, roll=2000, pitch=2000)
        tops.append(angles(p)[:2])
    assert 43.0 < max(roll for roll, _ in tops) < 55.0
    assert max(pitch for _, pitch in tops) < 27.0
    sticks(p, 1.0, roll=1300, pitch=1540)  # back, at once
    assert angles(p)[0] < 20.0


def test_acro_asks_for_rates_and_keeps_the_attitude() -> None:
    p = high(ACRO)
    sticks(p, 1.0, pitch=1500)
    sticks(p, 1.0, roll=1600)
    assert float(p.v.angular_velocity[0]) == pytest.approx(math.radians(180.0 * 70.0 / 470.0), rel=0.12)
    sticks(p, 0.8)
    before = angles(p)
    sticks(p, 1.0)
    assert angles(p)[0] == pytest.approx(before[0], abs=3.0)
    assert abs(before[0]) > 20.0  # it is not levelled
    sticks(p, 1.0, pitch=1560)
    assert float(p.v.angular_velocity[1]) == pytest.approx(math.radians(180.0 * 30.0 / 470.0), rel=0.15)


def test_fbwb_climbs_at_a_rate_and_keeps_height_and_speed() -> None:
    p = high(FBWB)
    sticks(p, 14.0, pitch=2000, throttle=1300)
    assert float(p.v.velocity[2]) == pytest.approx(-2.0, abs=0.1)  # FBWB_CLIMB_RATE
    assert speed(p) == pytest.approx(18.0 + 17.0 * opened(1300), abs=0.4)  # AIRSPEED_MIN to AIRSPEED_MAX
    height = -p.place[2]
    sticks(p, 10.0, throttle=1300)
    assert -p.place[2] == pytest.approx(height, abs=1.5)
    sticks(p, 12.0, pitch=1315, throttle=1300)
    assert float(p.v.velocity[2]) == pytest.approx(2.0 * 155.0 / 470.0, abs=0.1)


def test_cruise_holds_the_line_on_which_the_stick_was_centred() -> None:
    p = high(CRUISE)
    sticks(p, 4.0, roll=1600)
    assert angles(p)[0] == pytest.approx(0.2 * 45.0, abs=1.5)
    sticks(p, 6.0)
    course = math.atan2(p.v.velocity[1], p.v.velocity[0])
    right = np.array([-math.sin(course), math.cos(course)])
    begin = np.array(p.place[:2])
    p.v["wind"][:] = 3.0 * right[0], 3.0 * right[1], 0.0
    sticks(p, 20.0)
    assert abs((np.array(p.place[:2]) - begin) @ right) < 8.0  # 60 m without a line
    assert math.atan2(p.v.velocity[1], p.v.velocity[0]) == pytest.approx(course, abs=0.02)
    assert abs(angles(p)[2] - math.degrees(course)) > 4.0  # its nose is in the wind
    sticks(p, 2.0, yaw=1600)
    assert not p.m.on_line


def test_circle_banks_by_a_third_of_its_limit() -> None:
    p = high(CIRCLE)
    p.until(p.time + 12.0)
    rate = course_rate(p, 4.0)
    assert angles(p)[0] == pytest.approx(15.0, abs=0.5)
    radius = speed(p) ** 2 / (GRAVITY * math.tan(math.radians(15.0)))
    assert speed(p) / rate == pytest.approx(radius, rel=0.06)
    assert -p.place[2] == pytest.approx(-p.m.guided_position[2], abs=1.0)


def test_a_pilot_takes_off_by_hand() -> None:
    p = started("plane")
    assert p.ask(SET_MODE, 1, FBWB) == ACCEPTED
    sticks(p, 2.0, throttle=2000)
    assert p.v.on_ground and speed(p) < 0.1  # on the ground, it waits
    assert p.ask(SET_MODE, 1, FBWA) == ACCEPTED
    sticks(p, 12.0, pitch=1800, throttle=1450)
    assert -p.place[2] > 15.0 and not p.m.on_ground
    assert abs(angles(p)[0]) < 3.0


def test_manual_control_is_obeyed() -> None:
    p = high(MANUAL)
    p.send(mavlink.MAVLink_manual_control_message(1, 200, -400, 600, 100, 0))
    p.until(p.time + 0.1)
    expected = [0.5 - 0.2, 0.5 - 0.1, opened(1600), 0.5 + 0.5 * 20.0 / 470.0]
    assert p.m.motor[:4].tolist() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("mode", "text"), [(24, "Flight mode change failed"), (9, "No such mode 9"), (17, "Q_ENABLE 0")]
)
def test_modes_that_it_does_not_have_are_refused(mode: int, text: str) -> None:
    p = high(FBWA)
    assert p.ask(SET_MODE, 1, mode) == FAILED
    p.one_step()
    assert text in [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]
    assert p.m.mode == FBWA
    assert p.last("HEARTBEAT").base_mode & 64  # flown by the sticks


def test_turns_tell_the_wind() -> None:
    p = high(12)
    p.v["wind"][:] = -3.0, 2.0, 0.0
    p.until(p.time + 75.0)
    assert p.ask(512, mavlink.MAVLINK_MSG_ID_WIND) == ACCEPTED
    wind = p.last("WIND")
    assert wind.speed == pytest.approx(math.hypot(3.0, 2.0), abs=0.6)
    assert wind.direction == pytest.approx(math.degrees(math.atan2(-2.0, 3.0)), abs=10.0)  # where it comes from


def test_without_a_turn_no_wind_is_known() -> None:
    p = started("plane")
    assert p.ask(512, mavlink.MAVLINK_MSG_ID_WIND) == ACCEPTED
    assert (p.last("WIND").speed, p.last("WIND").speed_z) == (0.0, 0.0)


def test_avoid_adsb_circles_where_it_is() -> None:
    p = high(15)
    p.until(p.time + 20.0)
    assert p.ask(SET_MODE, 1, 14) == ACCEPTED
    assert p.last("MISSION_ITEM_REACHED").seq == 0  # it was on its circle
    place = p.place[:2]
    p.until(p.time + 40.0)
    assert math.dist(p.place[:2], place) == pytest.approx(80.0, abs=4.0)


def test_without_rotors_loiter_alt_qland_stays_low_and_says_why() -> None:
    p = high(25)
    while -p.place[2] > 16.0:
        p.one_step()
        assert p.time < 120.0
    p.until(p.time + 30.0)
    assert -p.place[2] == pytest.approx(15.0, abs=1.0)
    assert [m.text for m in p.heard if m.get_type() == "STATUSTEXT"].count("Q_ENABLE 0") == 1
    assert p.m.mode == 25


# ---- sticks in modes that fly by themselves: ArduPlane's stick mixing ------------------------------------------------

LOITER, GUIDED = 12, 15


@pytest.mark.parametrize("mode", [LOITER, GUIDED])
def test_a_full_stick_banks_to_the_limit_either_way(mode: int) -> None:
    """Beyond a half, a stick counts up to twice: to the other side of a turn, too."""
    for stick, bank in ((2000, 45.0), (1000, -45.0)):
        p = high(mode)
        sticks(p, 4.0, roll=stick)
        assert angles(p)[0] == pytest.approx(bank, abs=4.0)
    p.until(p.time + 60.0)  # the override has ended: it circles its place again
    assert math.dist(p.place[:2], p.m.guided_position[:2]) == pytest.approx(80.0, abs=8.0)
    assert not p.m.sticks_known and not p.m.mixes


def test_sticks_are_added_to_bank_pitch_and_rudder() -> None:
    p, q = high(LOITER), high(LOITER)
    sticks(p, 1.0)  # centred sticks change nothing
    q.until(p.time)
    assert p.m.motor.tolist() == q.m.motor.tolist()
    sticks(p, 0.2, roll=1600, pitch=1450, yaw=1700)
    dead, room = 30.0, 470.0
    asked = math.radians(45.0) * (100.0 - dead) / room, -math.radians(25.0) * (50.0 - dead) / room
    assert p.m.mixed[:2].tolist() == pytest.approx(asked)
    assert p.m.mixed[2] == pytest.approx((200.0 - dead) / room)
    q.until(p.time)
    assert p.m.motor[3] - q.m.motor[3] == pytest.approx(0.5 * p.m.mixed[2], abs=0.05)


@pytest.mark.parametrize(
    ("mixing", "mode", "bank", "pitch"), [(0, 12, 0, 0), (3, 12, 0, 0), (4, 12, 1, 0), (0, 1, 1, 1)]
)
def test_sticks_are_mixed_as_the_parameter_says(mixing: int, mode: int, bank: int, pitch: int) -> None:
    """In CIRCLE always, as in ArduPlane."""
    p, q = high(mode), high(mode)
    p.m.STICK_MIXING = mixing
    sticks(p, 1.5, roll=1300, pitch=1700)
    sticks(q, 1.5)
    assert (p.m.mixes, p.m.mixed[0] < 0.0, p.m.mixed[1] > 0.0) == (bool(bank), bool(bank), bool(pitch))
    assert (angles(p)[0] < angles(q)[0] - 10.0) == bool(bank)
    if bank == pitch:
        assert (angles(p)[1] > angles(q)[1] + 1.0) == bool(pitch)
