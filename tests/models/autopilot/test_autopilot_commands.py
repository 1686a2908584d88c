"""Commands that ArduCopter has besides modes and targets: packets made and read by pymavlink, ArduCopter's answers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.frames import geodetic_from_local
from tests.models.copter import (
    ACCEPTED,
    DENIED,
    FAILED,
    GUIDED,
    LAND,
    LOITER,
    ONLY_POSITION,
    RECORDED_AUTOPILOT,
    RTL,
    UNSUPPORTED,
    Copter,
)

REJECTED = 1
BRAKE, CIRCLE, AUTO = 17, 7, 3
ORIGIN = math.radians(-35.363262), math.radians(149.165237), 584.0
BY_ATTITUDE = 0b111
"""Ignores angular velocities."""
BY_RATES = 128
"""Ignores the attitude."""


def at(n: float, e: float) -> tuple[int, int]:
    """Latitude and longitude [degE7] of a place, by PyMAVLink's units."""
    lat, lon, _ = geodetic_from_local(n, e, 0.0, *ORIGIN)
    return round(math.degrees(lat) * 1e7), round(math.degrees(lon) * 1e7)


def attitude(
    copter: Copter,
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
    thrust: float = 0.5,
    mask: int = BY_ATTITUDE,
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
    scale: float = 1.0,
) -> None:
    """SET_ATTITUDE_TARGET with angles in degrees."""
    r, p, y = (0.5 * math.radians(angle) for angle in (roll, pitch, yaw))
    cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    copter.send(
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, [scale * part for part in q], *rates, thrust)
    )


def keep(copter: Copter, duration: float, **target: Any) -> None:
    """Repeats an attitude five times a second."""
    for _ in range(round(5 * duration)):
        attitude(copter, **target)
        copter.run(0.2)


def angles(copter: Copter) -> tuple[float, float, float]:
    """Roll, pitch and yaw [deg]."""
    w, x, y, z = copter.v["attitude"]
    return (
        math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
        math.degrees(math.asin(2 * (w * y - z * x))),
        math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
    )


def command_int(copter: Copter, number: int, *p: float, frame: int = 3, x: int = 0, y: int = 0, z: float = 0.0) -> Any:
    """The answers to a COMMAND_INT."""
    copter.answers()
    values = [*p, *[0.0] * (4 - len(p))]
    copter.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *values, x, y, z))
    copter.tick()
    copter.tick()
    return copter.answers()


def result(answers: list[Any]) -> int:
    (found,) = [answer[2] for answer in answers if answer[0] == "ACK"]
    return int(found)


def texts(answers: list[Any]) -> list[tuple[int, str]]:
    return [(severity, words) for what, severity, words in answers if what == "TEXT"]


def upload(copter: Copter, items: list[tuple[int, int, int, float]], kind: int = 0) -> int:
    """Uploads items (command, frame, and a place north of the origin with a height); returns the MISSION_ACK."""
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for sequence, (command, frame, north, z) in enumerate(items):
        copter.run(0.01)
        lat, lon = at(north, 0.0)
        copter.send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, sequence, frame, command, 0, 1, 0, 0, 0, 0, lat, lon, z, kind
            )
        )
    copter.run(0.01)
    (ack,) = copter.messages("MISSION_ACK")
    return int(ack.type)


# ---- SET_ATTITUDE_TARGET -------------------------------------------------------------------------------------------


def test_an_attitude_is_flown_at_constant_height_and_ends_after_the_timeout() -> None:
    copter = Copter(autopilot=RECORDED_AUTOPILOT).in_the_air(10.0)
    keep(copter, 2.0, pitch=-5.7, yaw=30.0)
    assert angles(copter) == pytest.approx((0.0, -5.7, 30.0), abs=1.0)
    target = copter.m["attitude_target"]
    assert math.degrees(2.0 * math.atan2(target[3], target[0])) == pytest.approx(30.0, abs=0.1)
    # Nose down by 5.7 degrees: g * tan(5.7 deg) = 0.98 m/s2 forward, less the drag.
    assert 1.0 < math.hypot(*copter.v["velocity"][:2]) < 2.0
    assert copter.v["position"][2] == pytest.approx(-10.0, abs=0.2)
    copter.run(3.1)  # GUID_TIMEOUT is 3 s
    copter.run(1.0)
    assert angles(copter)[:2] == pytest.approx((0.0, 0.0), abs=0.5)


@pytest.mark.parametrize(("thrust", "climb"), [(1.0, 2.5), (0.75, 1.25), (0.5, 0.0), (0.25, -0.75), (0.0, -1.5)])
def test_the_thrust_of_an_attitude_is_a_climb_rate(thrust: float, climb: float) -> None:
    copter = Copter().in_the_air(15.0, 16.0)
    keep(copter, 4.0, thrust=thrust)
    assert -copter.v["velocity"][2] == pytest.approx(climb, abs=0.1)


def test_the_thrust_of_an_attitude_can_be_a_throttle() -> None:
    copter = Copter(autopilot={"GUID_OPTIONS": 8}).in_the_air(10.0)
    hover = float(copter.m["throttle_out"])
    keep(copter, 1.0, thrust=hover)
    assert abs(copter.v["velocity"][2]) < 0.5
    keep(copter, 1.0, thrust=1.2 * hover)
    assert copter.m["throttle_in"] == pytest.approx(1.2 * hover, rel=1e-6)
    assert -copter.v["velocity"][2] > 1.0
    copter.run(3.5)  # without targets it holds its height again
    assert not copter.m["angle_thrust"]


def test_angular_velocities_alone_are_flown() -> None:
    copter = Copter(autopilot=RECORDED_AUTOPILOT).in_the_air(10.0)
    keep(copter, 2.0, mask=BY_RATES, rates=(0.0, 0.0, 0.5))
    assert copter.v["angular_velocity"][2] == pytest.approx(0.5, abs=0.05)
    assert copter.m["rate_target"] == pytest.approx([0.0, 0.0, 0.5], abs=1e-6)
    # It turned for 2 s at 0.5 rad/s, which it reached with 4.7 rad/s2.
    assert angles(copter)[2] == pytest.approx(math.degrees(1.0), abs=5.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"mask": BY_ATTITUDE | 64},
        {"scale": 1.1},
        {"mask": 0b011},
        {"thrust": float("nan")},
        {"mask": 0, "rates": (float("nan"), 0.0, 0.0)},
    ],
)
def test_an_attitude_that_is_not_defined_stops_the_vehicle(wrong: dict[str, Any]) -> None:
    copter = Copter().in_the_air(10.0)
    keep(copter, 1.0, pitch=-10.0)
    attitude(copter, **{"pitch": -10.0, **wrong})
    copter.run(0.01)
    assert copter.m["submode"] == 2  # velocity, as after entering GUIDED
    copter.run(5.0)
    assert np.linalg.norm(copter.v["velocity"]) < 0.1


def test_an_attitude_with_a_climb_lifts_off_and_one_without_does_not() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    keep(copter, 4.0, thrust=0.5)
    assert copter.m["on_ground"]
    keep(copter, 6.0, thrust=0.8)
    assert not copter.m["on_ground"]
    assert -copter.v["position"][2] > 1.0


def test_attitudes_count_in_guided_only() -> None:
    copter = Copter().in_the_air(10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    keep(copter, 1.0, pitch=-10.0)
    assert angles(copter)[:2] == pytest.approx((0.0, 0.0), abs=0.5)


# ---- home ----------------------------------------------------------------------------------------------------------


def test_home_can_be_set_here_and_rtl_returns_there() -> None:
    copter = Copter(autopilot={"RTL_ALT": 500, "RTL_LOIT_TIME": 0}).in_the_air(10.0)
    copter.go(10.0, 0.0, -10.0)
    copter.run(8.0)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_HOME, 1)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_HOME, ACCEPTED)
    assert copter.m["home_neu"] == pytest.approx(copter.m["position_neu"], abs=0.1)
    copter.go(0.0, 0.0, -10.0)
    copter.run(8.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, RTL)
    copter.run(30.0)
    assert copter.v["position"][0] == pytest.approx(10.0, abs=1.0)


def test_home_can_be_set_to_a_place_and_is_told_and_outlasts_arming() -> None:
    copter = Copter()
    copter.run(2.1)
    lat, lon = at(30.0, -20.0)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_command_int_message(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, lat, lon, 590.0))
    copter.run(0.02)
    (home,) = copter.messages("HOME_POSITION")
    assert (home.latitude, home.longitude) == pytest.approx((lat, lon), abs=1)
    assert home.altitude == pytest.approx(590000, abs=2)
    assert result(copter.answers()) == ACCEPTED
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert copter.m["home_neu"] == pytest.approx([30.0, -20.0, 6.0], abs=0.02)


def test_home_by_command_long_is_in_degrees_and_above_the_sea() -> None:
    copter = Copter()
    copter.run(2.1)
    lat, lon = at(5.0, 5.0)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, lat * 1e-7, lon * 1e-7, 584.0)) == ACCEPTED
    # float32 degrees: a grid of 0.4 m to the north and 1.4 m to the east
    assert copter.m["home_neu"] == pytest.approx([5.0, 5.0, 0.0], abs=1.5)


@pytest.mark.parametrize(
    ("p1", "frame", "x", "y", "z", "expected"),
    [
        (0.0, 0, 0, 0, 600.0, ACCEPTED),  # no place: here
        (2.0, 0, 100, 100, 0.0, FAILED),
        (0.0, 21, 100, 100, 0.0, DENIED),
        (0.0, 0, 910000000, 100, 0.0, FAILED),
        (0.0, 0, 100, 100, 60000.0, FAILED),
        (0.0, 0, 100, 100, float("nan"), DENIED),
    ],
)
def test_forms_of_home(p1: float, frame: int, x: int, y: int, z: float, expected: int) -> None:
    copter = Copter()
    copter.run(2.1)
    before = copter.m["home_neu"].copy()
    assert result(command_int(copter, 179, p1, frame=frame, x=x, y=y, z=z)) == expected
    assert bool(copter.m["home_locked"]) == (expected == ACCEPTED)
    assert copter.m["home_neu"] == pytest.approx(before, abs=1e-6)


def test_home_cannot_be_set_before_it_is_known() -> None:
    copter = Copter()
    copter.run(0.3)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_HOME, 1)) == FAILED


# ---- pause, region of interest, yaw ----------------------------------------------------------------------------------


def test_a_flight_in_guided_pauses_and_continues() -> None:
    copter = Copter().in_the_air(10.0)
    copter.go(40.0, 0.0, -10.0)
    copter.run(4.0)
    assert copter.v["velocity"][0] > 4.0
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)) == ACCEPTED
    copter.run(10.0)
    assert abs(copter.v["velocity"][0]) < 0.1
    assert copter.v["position"][0] < 35.0
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)) == ACCEPTED
    copter.run(10.0)
    assert copter.v["position"][0] == pytest.approx(40.0, abs=0.3)


def test_a_mission_pauses_between_waypoints_only() -> None:
    copter = Copter()
    copter.run(2.1)
    assert upload(copter, [(16, 0, 0, 584.0), (22, 3, 0, 10.0), (16, 3, 60, 10.0), (16, 3, 60, 10.0)]) == 0
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.ask(mavlink.MAV_CMD_MISSION_START)
    copter.run(5.0)
    answers = copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    assert (result(answers), texts(answers)) == (FAILED, [(6, "Failed to pause")])
    copter.run(12.0)
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)) == ACCEPTED
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    copter.run(0.01)
    assert copter.messages("MISSION_CURRENT")[0].mission_state == mavlink.MISSION_STATE_PAUSED
    copter.run(10.0)
    north = float(copter.v["position"][0])
    assert north < 55.0
    assert np.linalg.norm(copter.v["velocity"]) < 0.1
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)) == FAILED
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)) == ACCEPTED
    copter.run(20.0)
    assert copter.v["position"][0] == pytest.approx(60.0, abs=1.0)


def test_other_modes_do_not_pause() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LAND)
    answers = copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    assert (result(answers), texts(answers)) == (FAILED, [(6, "Failed to pause")])
    answers = copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1)
    assert (result(answers), texts(answers)) == (FAILED, [(6, "Failed to resume")])
    assert result(copter.ask(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 2)) == DENIED


@pytest.mark.parametrize("number", [mavlink.MAV_CMD_DO_SET_ROI, mavlink.MAV_CMD_DO_SET_ROI_LOCATION])
def test_the_nose_points_to_a_region_of_interest(number: int) -> None:
    copter = Copter(autopilot=RECORDED_AUTOPILOT).in_the_air(10.0)
    lat, lon = at(0.0, 20.0)
    assert result(command_int(copter, number, x=lat, y=lon)) == ACCEPTED
    copter.run(8.0)
    assert angles(copter)[2] == pytest.approx(90.0, abs=1.0)
    copter.go(20.0, 0.0, -10.0, mask=ONLY_POSITION)  # a new target selects its own heading
    copter.run(8.0)
    assert angles(copter)[2] == pytest.approx(0.0, abs=2.0)


def test_a_region_of_interest_ends() -> None:
    copter = Copter().in_the_air(10.0)
    lat, lon = at(0.0, 20.0)
    command_int(copter, 195, x=lat, y=lon)
    copter.run(0.5)
    assert result(command_int(copter, 197)) == ACCEPTED
    copter.run(4.0)
    assert abs(angles(copter)[2]) < 45.0
    assert result(command_int(copter, 195, frame=21, x=lat, y=lon)) == DENIED
    assert result(command_int(copter, 195, x=910000000, y=lon)) == FAILED


def test_a_yaw_rate_beside_a_position_ends_with_the_timeout() -> None:
    copter = Copter().in_the_air(10.0)
    copter.go(0.0, 0.0, -10.0, mask=0x5F8, yaw_rate=0.5)
    copter.run(8.0)
    # 3 s at 0.5 rad/s: 86 degrees, as ArduCopter turned.
    assert angles(copter)[2] == pytest.approx(86.0, abs=6.0)


def test_a_yaw_rate_is_limited_by_the_slew_rate() -> None:
    copter = Copter(autopilot=RECORDED_AUTOPILOT).in_the_air(10.0)
    copter.go(0.0, 0.0, 0.0, mask=0x5C7, yaw_rate=3.0)
    copter.run(2.0)
    assert copter.m["rate_target"][2] == pytest.approx(math.radians(60.0), abs=1e-6)
    assert copter.v["angular_velocity"][2] == pytest.approx(math.radians(60.0), abs=0.1)


def test_a_heading_that_turns() -> None:
    copter = Copter().in_the_air(10.0)
    copter.go(0.0, 0.0, -10.0, mask=0x1F8, yaw=0.5, yaw_rate=0.2)
    copter.run(2.5)
    assert angles(copter)[2] == pytest.approx(math.degrees(0.5 + 0.5), abs=4.0)


# ---- targets beyond a fence, and their frames ------------------------------------------------------------------------


def test_targets_beyond_a_fence_are_refused() -> None:
    copter = Copter(autopilot={"FENCE_ENABLE": 1, "FENCE_RADIUS": 30.0, "FENCE_ALT_MAX": 20.0}).in_the_air(10.0)
    lat, lon = at(60.0, 0.0)
    assert result(command_int(copter, 192, -1, x=lat, y=lon, z=10.0)) == FAILED
    copter.go(60.0, 0.0, -10.0)
    copter.go(0.0, 0.0, -25.0)
    copter.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, 6, ONLY_POSITION, lat, lon, 10.0, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )
    copter.run(4.0)
    assert copter.m["mode"] == GUIDED
    assert copter.v["position"] == pytest.approx([0.0, 0.0, -10.0], abs=0.3)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, lat, lon, 10.0))
    copter.run(0.01)
    assert copter.messages("MISSION_ACK")[0].type != 0
    lat, lon = at(20.0, 0.0)
    assert result(command_int(copter, 192, -1, x=lat, y=lon, z=10.0)) == ACCEPTED


def test_heights_above_terrain_are_above_the_plane_of_the_origin() -> None:
    copter = Copter().in_the_air(10.0)
    lat, lon = at(0.0, 0.0)
    assert result(command_int(copter, 192, -1, frame=10, x=lat, y=lon, z=14.0)) == ACCEPTED
    copter.run(6.0)
    assert copter.v["position"][2] == pytest.approx(-14.0, abs=0.2)


@pytest.mark.parametrize(("frame", "expected"), [(0, DENIED), (5, DENIED), (10, DENIED), (3, ACCEPTED)])
def test_the_frame_of_a_take_off(frame: int, expected: int) -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert result(command_int(copter, 22, frame=frame, z=10.0)) == expected


def test_a_take_off_in_loiter() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    assert result(copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5)) == FAILED  # disarmed
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert result(copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5)) == ACCEPTED
    copter.run(14.0)
    assert copter.v["position"][2] == pytest.approx(-5.0, abs=0.3)
    assert result(copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 8)) == FAILED  # flies already


# ---- outputs -------------------------------------------------------------------------------------------------------


def servos(copter: Copter) -> Any:
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    copter.tick()
    copter.tick()
    return copter.messages("SERVO_OUTPUT_RAW")[0]


def test_servos_are_set_except_those_of_motors() -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_SERVO, 9, 1700)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_SERVO, 5, 1300)) == ACCEPTED
    found = servos(copter)
    assert (found.servo5_raw, found.servo9_raw, found.servo10_raw) == (1300, 1700, 0)
    answers = copter.ask(mavlink.MAV_CMD_DO_SET_SERVO, 4, 1700)
    assert (result(answers), texts(answers)) == (FAILED, [(6, "ServoRelayEvent: Channel 4 is already in use")])
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_SERVO, 33, 1700)) == FAILED
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_SERVO, 0, 1700)) == FAILED


def test_servos_repeat() -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_DO_REPEAT_SERVO, 9, 1900, 2, 1.0)) == ACCEPTED
    seen = []
    for _ in range(5):
        copter.run(0.45)
        seen.append(int(copter.m["servo"][8]))
        copter.run(0.05)
    assert seen == [1900, 1500, 1900, 1500, 1500]
    assert not copter.m["outputs_busy"]
    assert result(copter.ask(mavlink.MAV_CMD_DO_REPEAT_SERVO, 2, 1900, 2, 1.0)) == FAILED


def test_the_one_relay() -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_RELAY, 0, 1)) == ACCEPTED
    assert copter.m["relay_on"]
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_RELAY, 1, 1)) == FAILED
    assert result(copter.ask(mavlink.MAV_CMD_DO_REPEAT_RELAY, 0, 1, 1.0)) == ACCEPTED
    copter.run(0.1)
    assert not copter.m["relay_on"]
    copter.run(0.6)
    assert copter.m["relay_on"]
    assert result(copter.ask(mavlink.MAV_CMD_DO_REPEAT_RELAY, 3, 1, 1.0)) == FAILED


def test_motors_are_tested_one_after_the_other() -> None:
    copter = Copter()
    copter.run(2.1)
    answers = copter.ask(mavlink.MAV_CMD_DO_MOTOR_TEST, 1, 0, 10, 1.0, 3)
    assert (result(answers), texts(answers)) == (ACCEPTED, [(6, "starting motor test")])
    turning = []
    for _ in range(3):
        copter.run(0.5)
        turning.append([i for i in range(4) if copter.m["motor"][i] > 0.0])
        assert max(copter.m["motor"]) == pytest.approx(0.1)
        copter.run(1.0)
    assert turning == [[0], [3], [1]]  # front right, then clockwise: rear right, rear left
    copter.run(0.1)
    assert (6, "finished motor test") in texts(copter.answers())
    assert (copter.m["motor"] == 0.0).all()


def test_motors_are_not_tested_in_flight_or_beyond_their_range() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_MOTOR_TEST, 1, 1, 2300, 1.0)
    copter.run(0.1)
    assert (copter.m["motor"] == 0.0).all()
    assert not copter.m["outputs_busy"]
    copter = Copter().in_the_air(5.0, 10.0)
    answers = copter.ask(mavlink.MAV_CMD_DO_MOTOR_TEST, 1, 1, 1500, 1.0)
    assert (result(answers), texts(answers)) == (FAILED, [(2, "Motor Test: vehicle not landed")])


# ---- switches, checks, texts ---------------------------------------------------------------------------------------


def test_auxiliary_functions() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 33, 2)) == ACCEPTED
    assert copter.m["mode"] == BRAKE
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 56, 0)) == ACCEPTED
    assert copter.m["mode"] == BRAKE
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 56, 3)) == DENIED
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 28, 2)) == ACCEPTED
    assert copter.m["relay_on"]
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 11, 2)) == ACCEPTED
    assert copter.m["FENCE_ENABLE"] == 1
    answers = copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 9999, 2)
    assert (result(answers), texts(answers)) == (FAILED, [(6, "Invalid channel option (9999)")])
    assert result(copter.ask(mavlink.MAV_CMD_DO_AUX_FUNCTION, 81, 2)) == ACCEPTED
    assert not copter.m["armed"]


def test_a_flight_is_terminated() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert result(copter.ask(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0)) == FAILED
    assert copter.m["armed"]
    assert result(copter.ask(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)) == ACCEPTED
    assert not copter.m["armed"]


def test_the_checks_before_arming_run_on_request() -> None:
    copter = Copter()
    copter.run(0.1)
    answers = copter.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS)
    assert (result(answers), texts(answers)) == (
        ACCEPTED,
        [
            (2, "PreArm: Accels inconsistent"),
            (2, "PreArm: EKF attitude is bad"),
            (2, "PreArm: AHRS: not using configured AHRS type"),
        ],
    )
    copter.run(2.0)
    assert copter.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [("ACK", mavlink.MAV_CMD_RUN_PREARM_CHECKS, ACCEPTED)]
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert result(copter.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS)) == REJECTED


@pytest.mark.parametrize(("mode", "name"), [(LAND, "LAND"), (RTL, "RTL"), (BRAKE, "BRAKE"), (CIRCLE, "CIRCLE")])
def test_modes_that_cannot_be_armed_in_are_named(mode: int, name: str) -> None:
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    answers = copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert (result(answers), texts(answers)) == (FAILED, [(2, f"Arm: {name} mode not armable")])
    assert result(copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 2989)) == ACCEPTED


def test_auto_without_a_mission_is_entered_disarmed_and_not_armed() -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_MISSION_START)) == ACCEPTED
    assert copter.m["mode"] == AUTO
    assert result(copter.ask(mavlink.MAV_CMD_MISSION_START, 1)) == DENIED
    answers = copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert (result(answers), texts(answers)) == (FAILED, [(2, "Arm: Mode requires mission")])
    copter = Copter().in_the_air(5.0, 10.0)
    answers = copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    assert (result(answers), texts(answers)) == (FAILED, [(4, "Mode change to AUTO failed: init failed")])


def test_the_landing_sequence_is_missing() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    answers = copter.ask(mavlink.MAV_CMD_DO_LAND_START)
    assert (result(answers), texts(answers)) == (
        FAILED,
        [
            (4, "Unable to start landing sequence"),
            (4, "Mode change to AUTO RTL failed: No landing sequenc"),
            (4, "e found"),
        ],
    )


def test_a_long_text_comes_in_chunks() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_DO_LAND_START)
    copter.run(0.01)
    chunks = [(m.id, m.chunk_seq) for m in copter.messages("STATUSTEXT")]
    assert chunks == [(0, 0), (1, 0), (1, 1)]


def test_the_banner() -> None:
    copter = Copter()
    copter.run(2.1)
    answers = copter.ask(mavlink.MAV_CMD_DO_SEND_BANNER)
    assert (result(answers), texts(answers)) == (
        ACCEPTED,
        [(6, "ArduCopter V4.7.0-dev (90700977)"), (6, "Frame: QUAD/X")],
    )
    copter.send(mavlink.MAVLink_param_request_list_message(1, 0))
    copter.run(0.05)
    assert (6, "Frame: QUAD/X") in texts(copter.answers())


def test_high_latency_is_switched() -> None:
    copter = Copter()
    copter.run(2.1)
    assert texts(copter.ask(mavlink.MAV_CMD_CONTROL_HIGH_LATENCY, 1)) == [(5, "High Latency enabled")]
    assert texts(copter.ask(mavlink.MAV_CMD_CONTROL_HIGH_LATENCY, 0)) == [(5, "High Latency disabled")]


def test_the_battery_is_reset_and_after_an_alarm_nothing_arms() -> None:
    copter = Copter(autopilot={"BATT_LOW_MAH": 3000.0, "BATT_CAPACITY": 3300.0})
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_BATTERY_RESET, 1, 80)) == ACCEPTED
    assert copter.m["battery_used"] == pytest.approx(0.2 * 3300.0)
    answers = copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert (result(answers), texts(answers)) == (FAILED, [(2, "Arm: Battery failsafe")])
    assert result(copter.ask(mavlink.MAV_CMD_BATTERY_RESET, 2, 100)) == ACCEPTED  # not this battery
    assert copter.m["battery_used"] == pytest.approx(0.2 * 3300.0)
    assert result(copter.ask(mavlink.MAV_CMD_BATTERY_RESET, -1, 101)) == FAILED
    assert result(copter.ask(mavlink.MAV_CMD_BATTERY_RESET, -1, 100)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)) == ACCEPTED


def test_calibrations_are_answered_on_the_ground_only() -> None:
    copter = Copter()
    copter.run(2.1)
    answers = copter.ask(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1)
    assert (result(answers), texts(answers)) == (ACCEPTED, [(6, "Initialising ArduPilot")])
    assert result(copter.ask(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 0, 0, 1)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION)) == UNSUPPORTED
    assert result(copter.ask(mavlink.MAV_CMD_DO_START_MAG_CAL)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_DO_CANCEL_MAG_CAL)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_DO_ACCEPT_MAG_CAL)) == FAILED
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    answers = copter.ask(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1)
    assert (result(answers), texts(answers)) == (FAILED, [(5, "Disarm to allow calibration")])
    answers = copter.ask(mavlink.MAV_CMD_DO_START_MAG_CAL)
    assert (result(answers), texts(answers)) == (FAILED, [(5, "Disarm to allow compass calibration")])


@pytest.mark.parametrize(
    ("number", "parameters", "expected"),
    [
        (32, (1,), ACCEPTED),
        (32, (0,), DENIED),
        (185, (0,), FAILED),
        (198, (2,), ACCEPTED),
        (203, (), ACCEPTED),
        (204, (), FAILED),
        (205, (), FAILED),
        (206, (5,), ACCEPTED),
        (208, (2,), ACCEPTED),
        (208, (3,), FAILED),
        (211, (1, 0), FAILED),
        (216, (1,), ACCEPTED),
        (216, (2,), FAILED),
        (224, (0,), FAILED),
        (245, (2,), ACCEPTED),
        (500, (), ACCEPTED),
        (601, (7,), FAILED),
        (1000, (), FAILED),
        (1001, (), FAILED),
        (2000, (), FAILED),
        (2500, (), FAILED),
        (42006, (), ACCEPTED),
        (42007, (1,), ACCEPTED),
        (42007, (4,), DENIED),
        (42600, (), FAILED),
        (43004, (5, 0, 90), ACCEPTED),
        (43004, (-1, 0, 90), DENIED),
        (519, (1,), UNSUPPORTED),
        (31010, (), UNSUPPORTED),
    ],
)
def test_results_of_commands_without_their_devices(number: int, parameters: tuple[float, ...], expected: int) -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(number, *parameters)) == expected


def test_the_buttons_of_the_solo() -> None:
    copter = Copter()
    copter.run(2.1)
    assert result(copter.ask(mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD, 5)) == ACCEPTED
    assert copter.m["armed"]
    assert result(copter.ask(mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD, 5)) == ACCEPTED
    copter.run(14.0)
    assert (copter.m["mode"], copter.v["position"][2]) == (LOITER, pytest.approx(-5.0, abs=0.3))
    copter.ask(mavlink.MAV_CMD_SOLO_BTN_PAUSE_CLICK)
    assert copter.m["mode"] == BRAKE
    copter.ask(mavlink.MAV_CMD_SOLO_BTN_FLY_CLICK)
    assert copter.m["mode"] == LOITER
    copter.ask(mavlink.MAV_CMD_SOLO_BTN_FLY_HOLD, 5)
    assert copter.m["mode"] == LAND


# ---- modes ---------------------------------------------------------------------------------------------------------


def test_guided_without_gps_flies_attitudes_only_and_needs_no_position() -> None:
    copter = Copter(autopilot={**RECORDED_AUTOPILOT, "estimate_ready_time": 60.0})
    copter.run(40.0)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 20)) == ACCEPTED
    assert result(copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)) == ACCEPTED
    keep(copter, 7.0, thrust=0.8)
    assert copter.v["position"][2] < -2.0
    keep(copter, 2.0, roll=6.0)
    assert angles(copter)[0] == pytest.approx(6.0, abs=1.0)
    copter.go(0.0, 0.0, -20.0)  # no positions in this mode
    attitude(copter, roll=6.0, scale=2.0)  # nor attitudes that are none: it levels
    copter.run(1.0)
    assert angles(copter)[0] == pytest.approx(0.0, abs=1.0)
    assert copter.m["mode"] == 20


def test_avoid_adsb_stops_as_guided_does() -> None:
    copter = Copter().in_the_air(10.0)
    copter.go(0.0, 0.0, 0.0, 0xDC7, vx=4.0)
    copter.run(2.5)
    assert result(copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 19)) == ACCEPTED
    copter.run(10.0)
    assert np.linalg.norm(copter.v["velocity"]) < 0.1
    copter = Copter()
    copter.run(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 19)
    answers = copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert texts(answers) == [(2, "Arm: AVOID_ADSB mode not armable")]


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        (13, "No such mode 13"),
        (14, "Mode change to FLIP failed: init failed"),
        (15, "Mode change to AUTOTUNE failed: init failed"),
        (18, "Mode change to THROW failed: init failed"),
    ],
)
def test_modes_that_are_refused_in_the_air(mode: int, words: str) -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    answers = copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)
    assert (result(answers), texts(answers)) == (FAILED, [(4, words)])
    assert copter.m["mode"] == GUIDED
