"""What the autopilots of rover, plane and quadplane tell a ground station, as heard from ArduRover and ArduPlane."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_small_autopilots import RTL, SET_MODE, WAYPOINT, started, upload
from tests.models.pair import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Pair, degrees_of

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
    expected = [(INFO, "Reached waypoint #2"), (INFO, "Reached waypoint #3"), (NOTICE, "Mission Complete")]
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
    assert p.m.home[:2].tolist() == pytest.approx(p.place[:2], abs=1e-6)


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
    assert ask(mavlink.MAVLINK_MSG_ID_RAW_IMU) == (FAILED, [])
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
