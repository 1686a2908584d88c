"""What the autopilots of rover, plane and quadplane tell a ground station, as heard from ArduRover and ArduPlane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_plane_pilot import high
from tests.models.autopilot.test_small_autopilots import RTL, SET_MODE, WAYPOINT, started, upload
from tests.models.pair import ACCEPTED, ALTITUDE, DENIED, FAILED, UNSUPPORTED, Pair, degrees_of

ARM, HOME, CURRENT = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_SET_HOME,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
)
REQUEST, INTERVAL, ASK_INTERVAL = (
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
)
WARNING, NOTICE, INFO = mavlink.MAV_SEVERITY_WARNING, mavlink.MAV_SEVERITY_NOTICE, mavlink.MAV_SEVERITY_INFO
KINDS = ("rover", "plane", "quadplane")


def told(p: Pair) -> list[tuple[int, str]]:
    """Texts since the last call."""
    found = [(m.severity, m.text) for m in p.heard if m.get_type() == "STATUSTEXT"]
    p.heard.clear()
    return found


def set_home(p: Pair, north: float, east: float, frame: int = 0, mode: float = 0.0, height: float = 584.0) -> int:
    lat, lon = degrees_of(north, east)
    p.send(mavlink.MAVLink_command_int_message(1, 1, frame, HOME, 0, 0, mode, 0, 0, 0, lat, lon, height))
    return p._answer(HOME)


@pytest.mark.parametrize("kind", KINDS)
def test_arming_and_modes_are_told(kind: str) -> None:
    p = started(kind)
    assert (INFO, "Throttle armed") in told(p)
    assert p.ask(SET_MODE, 1, 99) == FAILED
    assert told(p) == [(WARNING, "No such mode 99")]
    assert p.ask(SET_MODE, 1, 16) == FAILED  # INITIALISING
    assert told(p) == [(WARNING, "Flight mode change failed")]
    if kind == "plane":
        assert p.ask(SET_MODE, 1, 19) == FAILED
        assert told(p) == [(WARNING, "Q_ENABLE 0")]
    assert p.ask(ARM, 2) == UNSUPPORTED
    assert p.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert p.ask(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1) == FAILED
    assert told(p) == [(NOTICE, "Disarm to allow calibration")]
    assert p.ask(mavlink.MAV_CMD_DO_START_MAG_CAL) == FAILED
    assert told(p) == [(NOTICE, "Disarm to allow compass calibration")]
    assert p.ask(mavlink.MAV_CMD_DO_SEND_BANNER) == ACCEPTED
    name = "ArduRover" if kind == "rover" else "ArduPlane"
    assert told(p) == [(INFO, f"{name} V4.7.0-dev (90700977)")]
    for absent in (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, mavlink.MAV_CMD_IMAGE_START_CAPTURE):
        assert p.ask(absent) == FAILED
    assert p.ask(ARM, 0) == ACCEPTED
    assert told(p) == [(INFO, "Throttle disarmed")]
    assert p.ask(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == ACCEPTED


def test_a_rover_without_a_mission_stays_in_its_mode() -> None:
    p = started("rover")
    told(p)
    assert p.ask(SET_MODE, 1, 10) == FAILED
    assert told(p) == [(NOTICE, "No Mission. Can't set AUTO."), (WARNING, "Flight mode change failed")]
    assert p.ask(mavlink.MAV_CMD_MISSION_START, 1) == DENIED
    assert p.m.mode == 15


@pytest.mark.parametrize("kind", ["plane", "quadplane"])
def test_a_plane_without_a_mission_returns(kind: str) -> None:
    p = started(kind)
    told(p)
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    assert told(p) == [(INFO, "Mission complete, changing mode to RTL")]
    assert p.m.mode == 11


def test_a_rover_tells_how_far_its_mission_is() -> None:
    p = started("rover")
    places = [(20.0, 0.0), (20.0, 10.0), (10.0, 10.0)]
    assert upload(p, [(WAYPOINT, n, e, 0.0, (0.0, 0.0)) for n, e in places]) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    assert p.ask(CURRENT, 4) == FAILED
    assert p.ask(CURRENT, 2) == ACCEPTED
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT) == ACCEPTED
    current = p.last("MISSION_CURRENT")
    assert (current.seq, current.total, current.mission_state) == (2, 3, mavlink.MISSION_STATE_ACTIVE)
    told(p)
    p.until(p.time + 40.0)
    expected = [(INFO, "Reached waypoint #2"), (INFO, "Mission: 3 WP"), (INFO, "Reached waypoint #3")]
    expected += [(NOTICE, "Mission Complete")]
    assert told(p) == expected
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT) == ACCEPTED
    assert p.last("MISSION_CURRENT").mission_state == mavlink.MISSION_STATE_COMPLETE


def test_a_plane_returns_after_its_mission() -> None:
    p = started("plane")
    mission = [(22, 0, 0, 30.0, (0, 0)), (16, 200.0, 0.0, 40.0, (0, 0))]
    assert upload(p, mission) == mavlink.MAV_MISSION_ACCEPTED
    assert p.ask(SET_MODE, 1, 10) == ACCEPTED
    while p.m.mode == 10:
        p.one_step()
        assert p.time < 90.0
    p.one_step()
    assert (INFO, "Mission complete, changing mode to RTL") in told(p)
    assert p.m.mode == 11
    p.until(p.time + 60.0)
    assert math.dist(p.place[:2], (0.0, 0.0)) == pytest.approx(80.0, abs=5.0)


def test_a_rover_returns_to_the_home_that_was_set() -> None:
    p = started("rover")
    assert set_home(p, 30.0, 10.0, mode=2.0) == FAILED
    assert set_home(p, 1.5e7, 0.0) == FAILED  # off the globe
    told(p)
    assert set_home(p, 30.0, 10.0, frame=21) == DENIED
    assert told(p) == [(INFO, "Unknown mavlink coordinate frame 21")]
    assert p.m.home[:2].tolist() == [0.0, 0.0]
    assert set_home(p, 30.0, 10.0) == ACCEPTED
    lat, lon = degrees_of(30.0, 10.0)
    p.one_step()
    assert (p.last("HOME_POSITION").latitude, p.last("HOME_POSITION").longitude) == pytest.approx((lat, lon), abs=3)
    assert p.last("GPS_GLOBAL_ORIGIN").altitude == 584000
    assert p.ask(RTL) == ACCEPTED
    p.until(p.time + 25.0)
    assert math.dist(p.place[:2], (30.0, 10.0)) < 2.0
    assert p.ask(ARM, 0) == ACCEPTED
    p.one_step()
    assert p.m.home[:2].tolist() == pytest.approx([30.0, 10.0], abs=0.1)  # it stays
    assert p.ask(HOME, 1) == ACCEPTED
    assert p.m.home[:2].tolist() == pytest.approx(p.place[:2], abs=1e-4)  # it still rolls
    told(p)
    assert set_home(p, 0.0, 0.0) == ACCEPTED
    assert told(p) == [(INFO, "Set HOME to -35.363262 149.165237 at 584.00m")]


def test_a_higher_home_does_not_lift_a_plane_off_the_ground() -> None:
    p = started("plane")
    assert set_home(p, 0.0, 0.0, height=604.0) == ACCEPTED
    p.one_step()
    assert p.m.home[2] == pytest.approx(-20.0)
    assert p.m.on_ground
    p.until(p.time + 2.0)
    assert p.m.on_ground and p.m.armed


def test_messages_on_request() -> None:
    p = started("quadplane")

    def ask(number: int) -> tuple[int, list[Any]]:
        p.heard.clear()
        result = p.ask(REQUEST, number)
        return result, [m for m in p.heard if m.get_msgId() == number]

    result, (quaternion,) = ask(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
    assert result == ACCEPTED
    assert [quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4] == pytest.approx(p.v.attitude, abs=1e-3)
    _, (servos,) = ask(mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    assert (servos.servo1_raw, servos.servo3_raw, servos.servo5_raw) == (1500, 1000, 1000)
    assert ask(mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION) == (ACCEPTED, [])
    assert ask(mavlink.MAVLINK_MSG_ID_ODOMETRY) == (FAILED, [])
    assert p.ask(INTERVAL, 9999, 1e6) == DENIED
    assert (INFO, "No ap_message for mavlink id (9999)") in told(p)
    assert p.ask(INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 250e3) == ACCEPTED
    for number, result, interval in ((30, ACCEPTED, 250000), (33, ACCEPTED, -1), (9999, FAILED, 0)):
        assert p.ask(ASK_INTERVAL, number) == result
        assert (p.last("MESSAGE_INTERVAL").message_id, p.last("MESSAGE_INTERVAL").interval_us) == (number, interval)


def test_lists_and_items_of_missions() -> None:
    p = started("rover")
    for kind, count in ((0, 1), (1, 0), (2, 0)):
        p.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        p.one_step()
        assert (p.last("MISSION_COUNT").count, p.last("MISSION_COUNT").mission_type) == (count, kind)
    p.send(mavlink.MAVLink_mission_request_list_message(1, 1, 3))
    p.one_step()
    assert p.last("MISSION_ACK").type == mavlink.MAV_MISSION_UNSUPPORTED
    assert upload(p, [(WAYPOINT, 40.0, -30.0, 5.0, (1.0, 0.0))]) == mavlink.MAV_MISSION_ACCEPTED
    told(p)
    p.send(mavlink.MAVLink_mission_request_message(1, 1, 1))
    p.one_step()
    item, (lat, lon) = p.last("MISSION_ITEM"), degrees_of(40.0, -30.0)
    assert (item.x, item.y, item.z) == pytest.approx((1e-7 * lat, 1e-7 * lon, 5.0), abs=1e-5)
    assert told(p) == [(WARNING, "got MISSION_REQUEST; use MISSION_REQUEST_INT!")]


def test_heights_above_the_terrain() -> None:
    """The terrain is a plane at the altitude of the local origin."""
    p = started("plane")
    lat, lon = degrees_of(100.0, 50.0)
    for frame, down in ((10, -40.0), (0, 544.0), (3, -40.0)):
        command = mavlink.MAV_CMD_DO_REPOSITION
        p.send(mavlink.MAVLink_command_int_message(1, 1, frame, command, 0, 0, -1, 1, 0, 0, lat, lon, 40.0))
        assert p._answer(command) == ACCEPTED
        assert p.m.guided_position.tolist() == pytest.approx([100.0, 50.0, down], abs=0.02)


# ---- sensors, outputs, and parts that are not on board -------------------------------------------------------------

AIR = ("plane", "quadplane")


def asked(p: Pair, command: int, *values: float) -> tuple[int, list[tuple[int, str]]]:
    """The result of a command, and the texts beside it."""
    p.heard.clear()
    result = p.ask(command, *values)
    return result, told(p)


def requested(p: Pair, message: int) -> Any:
    """A message on request."""
    p.heard.clear()
    assert p.ask(REQUEST, message) == ACCEPTED
    return p.heard[0]


@pytest.mark.parametrize("kind", KINDS)
def test_sensors_are_told_on_request(kind: str) -> None:
    p = started(kind)
    p.until(p.time + 0.5)
    force, rates = p.v["specific_force"], p.v["angular_velocity"]
    milli = [math.trunc(1000.0 * x / 9.80665) for x in force] + [math.trunc(1000.0 * x) for x in rates]
    for number in (26, 27, 116, 129):
        raw = requested(p, number)
        assert raw.get_msgId() == number
        found = [raw.xacc, raw.yacc, raw.zacc, raw.xgyro, raw.ygyro, raw.zgyro]
        assert found == pytest.approx(milli, abs=25)
    fine = requested(p, 105)
    assert [fine.xacc, fine.yacc, fine.zacc] == pytest.approx([float(x) for x in force], abs=0.25)
    height = 584.0 - float(p.v["position"][2])
    hectopascal = 1013.25 * (1.0 - 0.0065 * height / 288.15) ** 5.25588
    for number in (29, 137):
        assert requested(p, number).press_abs == pytest.approx(hectopascal, abs=0.05)
    assert fine.abs_pressure == pytest.approx(hectopascal, abs=0.05)
    place = requested(p, 178)
    assert (place.lat, place.lng) == pytest.approx(degrees_of(*map(float, p.v["position"][:2])), abs=20)
    assert requested(p, 164).lat == pytest.approx(place.lat, abs=20)
    summary = requested(p, 235)
    assert (summary.custom_mode, summary.autopilot) == (15, 3)
    assert summary.altitude == pytest.approx(height, abs=1.0)
    left = requested(p, 147).battery_remaining
    assert left == 100 if kind == "rover" else 95 < left <= 100
    assert requested(p, 65).chancount == 8
    assert requested(p, 264).arming_time_utc > 0
    for number in (62, 125, 152, 163, 165, 241, 286, 376):
        assert requested(p, number).get_msgId() == number
    assert p.ask(INTERVAL, 105, 100000.0) == ACCEPTED
    p.heard.clear()
    p.until(p.time + 1.05)
    assert len([m for m in p.heard if m.get_type() == "HIGHRES_IMU"]) == 10


def test_a_plane_knows_the_terrain_and_a_rover_does_not() -> None:
    lat, lon = degrees_of(30.0, 40.0)
    for kind in AIR:
        p = started(kind)
        assert requested(p, 136).terrain_height == 584.0
        p.heard.clear()
        p.send(mavlink.MAVLink_terrain_check_message(lat, lon))
        p.one_step()
        report = p.last("TERRAIN_REPORT")
        assert (report.lat, report.lon, report.terrain_height) == (lat, lon, 584.0)
    rover = started("rover")
    assert requested(rover, 136).get_type() == "COMMAND_ACK"
    rover.heard.clear()
    rover.send(mavlink.MAVLink_terrain_check_message(lat, lon))
    rover.one_step()
    assert not rover.heard


@pytest.mark.parametrize(
    ("kind", "used", "free"), [("rover", (1, 3), 2), ("plane", (1, 4), 5), ("quadplane", (5, 8), 9)]
)
def test_servos_without_a_function_and_the_relay_can_be_set(kind: str, used: tuple[int, ...], free: int) -> None:
    p = started(kind)
    servo, relay = mavlink.MAV_CMD_DO_SET_SERVO, mavlink.MAV_CMD_DO_SET_RELAY
    for output in used:
        assert asked(p, servo, output, 1700) == (
            FAILED,
            [(INFO, f"ServoRelayEvent: Channel {output} is already in use")],
        )
    assert asked(p, servo, 33, 1700) == (FAILED, [])
    assert asked(p, servo, free, 1700) == (ACCEPTED, [])
    outputs = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
    assert getattr(requested(p, outputs), f"servo{free}_raw") == 1700
    assert asked(p, mavlink.MAV_CMD_DO_REPEAT_SERVO, free, 1300, 2, 0.5) == (ACCEPTED, [])
    seen = []
    end = p.time + 1.5
    while p.time < end:
        p.one_step()
        seen.append(int(p.m["servo"][free - 1]))
    changes = [b for a, b in zip([0, *seen], seen, strict=False) if a != b]
    assert changes == [1300, 1500, 1300, 1500]
    assert asked(p, relay, 0, 1) == (ACCEPTED, [])
    assert requested(p, 376).on == 1
    assert asked(p, relay, 5, 1) == (FAILED, [])
    assert asked(p, mavlink.MAV_CMD_DO_REPEAT_RELAY, 0, 1, 0.2) == (ACCEPTED, [])
    p.until(p.time + 0.5)
    assert requested(p, 376).on == 1  # off and on again
    assert asked(p, mavlink.MAV_CMD_DO_REPEAT_RELAY, 5, 1, 1) == (FAILED, [])


@pytest.mark.parametrize("kind", KINDS)
def test_parts_that_are_not_on_board(kind: str) -> None:
    m, p = mavlink, started(kind)
    wings = kind != "rover"
    for accepted in (m.MAV_CMD_DO_SET_ROI_NONE, m.MAV_CMD_DO_DIGICAM_CONTROL, m.MAV_CMD_START_RX_PAIR, 42651):
        assert asked(p, accepted) == (ACCEPTED, [])
    for command, values, result in (
        (m.MAV_CMD_DO_AUX_FUNCTION, (9, 0), ACCEPTED),
        (m.MAV_CMD_DO_AUX_FUNCTION, (9, 3), DENIED),
        (m.MAV_CMD_DO_FOLLOW, (1,), ACCEPTED),
        (m.MAV_CMD_DO_FOLLOW, (0,), DENIED),
        (m.MAV_CMD_SET_EKF_SOURCE_SET, (1,), ACCEPTED),
        (m.MAV_CMD_SET_EKF_SOURCE_SET, (4,), DENIED),
        (43004, (5, 1, 90, 1), ACCEPTED),
        (43004, (-1, 1, 90, 1), DENIED),
        (m.MAV_CMD_DO_SPRAYER, (1,), FAILED if wings else ACCEPTED),
        (m.MAV_CMD_DO_FENCE_ENABLE, (1,), FAILED if wings else ACCEPTED),
        (m.MAV_CMD_DO_FENCE_ENABLE, (0,), ACCEPTED),
        (m.MAV_CMD_DO_PARACHUTE, (1,), ACCEPTED if wings else UNSUPPORTED),
        (m.MAV_CMD_DO_PARACHUTE, (3,), FAILED if wings else UNSUPPORTED),
        (m.MAV_CMD_DO_GO_AROUND, (), FAILED if wings else UNSUPPORTED),
        (m.MAV_CMD_DO_SET_REVERSE, (0,), UNSUPPORTED if wings else ACCEPTED),
        (m.MAV_CMD_CONTROL_HIGH_LATENCY, (2,), FAILED),
    ):
        assert asked(p, command, *values) == (result, []), (command, values)
    for command, values, result, text in (
        (m.MAV_CMD_CONTROL_HIGH_LATENCY, (1,), ACCEPTED, (NOTICE, "High Latency enabled")),
        (m.MAV_CMD_CONTROL_HIGH_LATENCY, (0,), ACCEPTED, (NOTICE, "High Latency disabled")),
        (m.MAV_CMD_PREFLIGHT_STORAGE, (2,), ACCEPTED, (WARNING, "All parameters reset, reboot board")),
    ):
        assert asked(p, command, *values) == (result, [text])
    landing, ending = asked(p, m.MAV_CMD_DO_LAND_START), asked(p, m.MAV_CMD_DO_FLIGHTTERMINATION)
    if wings:
        assert landing == (FAILED, [(WARNING, "Unable to start landing sequence")])
        assert ending == (FAILED, [(INFO, "AFS not enabled, can't terminate the vehicle")])
    else:
        assert landing == ending == (UNSUPPORTED, [])
    assert asked(p, ARM, 0)[0] == ACCEPTED
    calibration = m.MAV_CMD_PREFLIGHT_CALIBRATION
    assert asked(p, calibration, 1)[1][-1] == (INFO, "Initialising ArduPilot")
    assert asked(p, calibration) == (UNSUPPORTED, [])
    assert asked(p, m.MAV_CMD_FIXED_MAG_CAL_YAW, 90) == (ACCEPTED, [])


def test_regions_of_interest_have_places() -> None:
    p = started("plane")
    region = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    for frame, lat, result in ((3, -353632620, ACCEPTED), (21, -353632620, DENIED), (3, 910000000, FAILED)):
        p.heard.clear()
        p.send(mavlink.MAVLink_command_int_message(1, 1, frame, region, 0, 0, 0, 0, 0, 0, lat, 1491652370, 10))
        assert p._answer(region) == result
        assert told(p) == ([(INFO, "Unknown mavlink coordinate frame 21")] if frame == 21 else [])


@pytest.mark.parametrize("kind", AIR)
def test_take_offs_refer_to_home(kind: str) -> None:
    p = started(kind)
    for frame, result in ((0, DENIED), (10, DENIED)):
        p.send(mavlink.MAVLink_command_int_message(1, 1, frame, 22, 0, 0, 0, 0, 0, 0, 0, 0, 10))
        assert p._answer(22) == result


@pytest.mark.parametrize("kind", KINDS)
def test_deprecated_requests_and_logs(kind: str) -> None:
    p = started(kind)
    told(p)
    p.send(mavlink.MAVLink_fence_fetch_point_message(1, 1, 2), mavlink.MAVLink_rally_fetch_point_message(1, 1, 0))
    p.one_step()
    assert told(p) == [
        (INFO, "Received message (FENCE_FETCH_POINT) is deprecated"),
        (WARNING, "Invalid fence point, index past total(2 >= 0)"),
        (INFO, "Received message (RALLY_FETCH_POINT) is deprecated"),
        (WARNING, "Failed to get rally point"),
    ]
    logs = mavlink.MAVLink_log_request_list_message(1, 1, 0, 9)
    p.send(logs)
    p.send(logs)
    p.one_step()
    assert told(p) == [(mavlink.MAV_SEVERITY_ERROR, "Disarm for log download")]
    assert p.ask(ARM, 0) == ACCEPTED
    p.send(logs)
    p.one_step()
    assert p.last("LOG_ENTRY").num_logs == 0
    p.heard.clear()
    p.send(mavlink.MAVLink_mission_request_int_message(1, 1, 9))
    p.one_step()
    assert [m.get_type() for m in p.heard][:2] == ["MISSION_COUNT", "MISSION_ACK"]


def test_packets_to_components_that_are_not_there_are_for_the_autopilot() -> None:
    p = started("rover")
    for before in (True, False):
        p.heard.clear()
        p.send(mavlink.MAVLink_mission_request_list_message(1, 190))
        p.one_step()
        assert any(m.get_type() == "MISSION_COUNT" for m in p.heard) is before
        component = mavlink.MAVLink(None, srcSystem=1, srcComponent=190)
        p.waiting += mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(component)
        p.one_step()


@pytest.mark.parametrize("mode", [1, 3, 7])
def test_modes_of_a_rovers_pilot_brake(mode: int) -> None:
    """With the sticks in the middle, ACRO, STEERING and SIMPLE stop."""
    p = started("rover")
    p.go(200.0, 0.0, 0.0)
    p.until(p.time + 6.0)
    assert p.v["velocity"][0] > 3.0
    assert p.ask(SET_MODE, 1, mode) == ACCEPTED
    p.until(p.time + 8.0)
    assert abs(p.v["velocity"][0]) < 0.05
    assert p.m.mode == mode


@pytest.mark.parametrize("kind", AIR)
def test_the_speed_over_ground_has_a_least_value(kind: str) -> None:
    p = started(kind)
    speed = mavlink.MAV_CMD_DO_CHANGE_SPEED
    assert asked(p, speed, 1, 5) == (ACCEPTED, [(INFO, "Set groundspeed 5")])
    assert asked(p, speed, 1, math.nan) == (DENIED, [])
    assert asked(p, speed, 4, 5) == (FAILED, [])
    assert p.m.least_speed == 5.0


def test_a_plane_flies_as_fast_over_ground_as_was_asked() -> None:
    p = started("plane")
    assert p.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 26.0) == ACCEPTED
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    p.until(p.time + 50.0)
    assert math.hypot(*p.v["velocity"][:2]) == pytest.approx(26.0, rel=0.05)


def test_what_a_quadplane_does_not_do_now() -> None:
    p = started("quadplane")
    assert asked(p, mavlink.MAV_CMD_DO_VTOL_TRANSITION, 4) == (FAILED, [(NOTICE, "VTOL transition only in AUTO")])
    assert p.ask(mavlink.MAV_CMD_DO_MOTOR_TEST, 1, 0, 10, 1) == FAILED
    assert told(p)[-1] == (INFO, "Must be disarmed for motor test")
    assert p.ask(SET_MODE, 1, 0) == ACCEPTED
    assert asked(p, mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == (
        FAILED,
        [(INFO, "User Takeoff only in GUIDED mode")],
    )


def test_a_plane_in_the_air_says_how_it_takes_off() -> None:
    p = started("plane")
    assert p.ask(SET_MODE, 1, 13) == ACCEPTED
    p.until(p.time + 15.0)
    assert p.ask(SET_MODE, 1, 12) == ACCEPTED
    assert not p.m.on_ground
    assert asked(p, SET_MODE, 1, 13) == (ACCEPTED, [(INFO, "Climbing to TKOFF alt then loitering")])


@pytest.mark.parametrize("kind", ["rover", "plane"])
def test_a_part_of_a_mission_is_written(kind: str) -> None:
    p = started(kind)
    places = [(20.0, 0.0), (20.0, 10.0), (10.0, 10.0)]
    assert upload(p, [(WAYPOINT, n, e, 30.0, (0.0, 0.0)) for n, e in places]) == mavlink.MAV_MISSION_ACCEPTED

    def write(first: int, last: int, kind: int = 0) -> Any:
        p.heard.clear()
        p.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind))
        p.one_step()
        return p.heard[-1]

    for first, last in ((-1, 2), (2, 1), (3, 5)):
        assert write(first, last).type == mavlink.MAV_MISSION_ERROR
    assert write(1, 2, 1).type == mavlink.MAV_MISSION_UNSUPPORTED
    assert write(2, 2).seq == 2
    lat, lon = degrees_of(70.0, 5.0)
    p.send(mavlink.MAVLink_mission_item_int_message(1, 1, 2, 6, WAYPOINT, 0, 1, 0, 0, 0, 0, lat, lon, 30.0))
    p.one_step()
    assert p.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    p.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    expected = [(20.0, 0.0), (70.0, 5.0), (10.0, 10.0)]
    for number, (north, east) in enumerate(expected, 1):
        p.send(mavlink.MAVLink_mission_request_int_message(1, 1, number))
        p.one_step()
        item = p.last("MISSION_ITEM_INT")
        assert (item.seq, item.x, item.y) == (number, *degrees_of(north, east))
    assert p.last("MISSION_COUNT").count == 4


@pytest.mark.parametrize("kind", KINDS)
def test_airspeed_is_that_of_a_sensor_calibrated_for_the_sea_level(kind: str) -> None:
    """The sensor takes the dynamic pressure for that of air at the sea."""
    p = high(15) if kind == "plane" else started(kind)
    p.heard.clear()
    assert p.ask(REQUEST, mavlink.MAVLINK_MSG_ID_AIRSPEED) == ACCEPTED
    assert p.ask(INTERVAL, mavlink.MAVLINK_MSG_ID_AIRSPEED, 1e6) == ACCEPTED
    p.until(p.time + 2.5)
    sent = [m for m in p.heard if m.get_type() == "AIRSPEED"]
    assert len(sent) == (0 if kind == "rover" else 3)
    height = ALTITUDE - p.place[2]
    density = (1.0 - 2.25577e-5 * height) ** 4.25588  # of the standard atmosphere, over that at the sea
    for message in sent:
        assert (message.id, message.flags) == (0, mavlink.AIRSPEED_SENSOR_USING)
        assert message.temperature == pytest.approx(1500.0 - 0.65 * height, abs=3.0)
        air = float(np.linalg.norm(p.m.velocity - p.m.wind_estimate))
        assert message.airspeed == pytest.approx(math.sqrt(density) * air, abs=0.3)
        assert message.raw_press == pytest.approx(0.01 * message.airspeed**2 / 1.9936, rel=1e-5)
