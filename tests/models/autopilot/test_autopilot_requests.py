"""Messages on request, mission items that are replaced, and old requests: packets made and read by pymavlink."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_autopilot_commands import angles, at, keep, result, texts, upload
from tests.models.copter import ACCEPTED, DENIED, FAILED, GUIDED, RECORDED_AUTOPILOT, Copter

AUTO = 3
NAN = math.nan


def asked(copter: Copter, number: int) -> tuple[int, list[Any]]:
    """The result of REQUEST_MESSAGE, and the messages with that id."""
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
    copter.tick()
    copter.tick()
    found = [message for _, message in copter.heard if message.get_msgId() == number]
    return result(copter.answers()), found


@pytest.fixture(scope="module")
def flying() -> Copter:
    copter = Copter(autopilot=RECORDED_AUTOPILOT).in_the_air(10.0)
    keep(copter, 2.0, pitch=-5.0, yaw=40.0)
    return copter


@pytest.mark.parametrize("number", [31, 83, 105, 116, 129, 136, 137, 165, 168, 235, 264, 286, 376])
def test_messages_on_request(flying: Copter, number: int) -> None:
    accepted, found = asked(flying, number)
    assert (accepted, len(found)) == (ACCEPTED, 1)


@pytest.mark.parametrize("number", [35, 100, 143, 180, 194, 226, 246, 260, 262, 269, 271, 295, 373])
def test_messages_of_sensors_that_are_not_on_board(flying: Copter, number: int) -> None:
    assert asked(flying, number) == (ACCEPTED, [])
    assert result(flying.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e5)) == ACCEPTED
    flying.heard.clear()
    flying.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, number)
    flying.run(0.01)
    assert flying.messages("MESSAGE_INTERVAL")[0].interval_us == -1


@pytest.mark.parametrize("number", [111, 436, 9999, 50000])
def test_messages_that_nobody_knows(flying: Copter, number: int) -> None:
    assert asked(flying, number) == (FAILED, [])
    answers = flying.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e5)
    assert (result(answers), texts(answers)) == (DENIED, [(6, f"No ap_message for mavlink id ({number})")])


def test_attitude_messages_agree_with_the_vehicle(flying: Copter) -> None:
    keep(flying, 1.0, pitch=-5.0, yaw=40.0)
    (quaternion,) = asked(flying, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)[1]
    given = (quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4)
    assert given == pytest.approx(tuple(flying.v["attitude"]), abs=5e-3)
    assert angles(flying)[1] == pytest.approx(-5.0, abs=1.0)
    (target,) = asked(flying, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET)[1]
    assert target.q == pytest.approx(
        [  # pitch -5 and yaw 40 degrees
            math.cos(math.radians(2.5)) * math.cos(math.radians(20.0)),
            math.sin(math.radians(2.5)) * math.sin(math.radians(20.0)),
            -math.sin(math.radians(2.5)) * math.cos(math.radians(20.0)),
            math.cos(math.radians(2.5)) * math.sin(math.radians(20.0)),
        ],
        abs=1e-3,
    )
    assert target.thrust == pytest.approx(float(flying.m["throttle_in"]), abs=1e-3)
    (state,) = asked(flying, mavlink.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE)[1]
    assert state.q == pytest.approx(list(flying.v["attitude"]), abs=5e-3)
    assert state.landed_state == 2


def test_inertial_messages_agree(flying: Copter) -> None:
    (imu,) = asked(flying, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU)[1]
    assert imu.zacc == pytest.approx(-9.8, abs=0.5)
    # ISO 2533 at 594 m: 944.2 hPa, 11.1 degrees C
    assert (imu.abs_pressure, imu.temperature) == pytest.approx((943.8, 11.1), abs=1.0)
    (second,) = asked(flying, mavlink.MAVLINK_MSG_ID_SCALED_IMU2)[1]
    assert second.zacc == pytest.approx(-1000, abs=50)
    (baro,) = asked(flying, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2)[1]
    assert baro.press_abs == pytest.approx(imu.abs_pressure, abs=0.1)


def test_summaries(flying: Copter) -> None:
    (summary,) = asked(flying, mavlink.MAVLINK_MSG_ID_HIGH_LATENCY2)[1]
    assert (summary.type, summary.autopilot, summary.custom_mode) == (2, 3, GUIDED)
    assert summary.altitude == pytest.approx(594, abs=2)
    assert 2 * summary.heading == pytest.approx(angles(flying)[2] % 360.0, abs=3.0)
    (flight,) = asked(flying, mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION)[1]
    assert flight.arming_time_utc == pytest.approx(1e6 * flying.m["armed_at"], abs=1)
    assert 2.1e6 < flight.takeoff_time_utc < 8e6
    assert flight.flight_uuid == 1


def test_wind_is_the_one_told(flying: Copter) -> None:
    assert asked(flying, mavlink.MAVLINK_MSG_ID_WIND)[1][0].speed == 0.0
    flying.ask(43004, 5, 0, 90)
    wind = asked(flying, mavlink.MAVLINK_MSG_ID_WIND)[1][0]
    assert (wind.direction, wind.speed) == pytest.approx((90.0, 5.0), abs=1e-4)


def test_terrain_is_a_plane(flying: Copter) -> None:
    (report,) = asked(flying, mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT)[1]
    assert (report.terrain_height, report.current_height) == pytest.approx((584.0, 10.0), abs=0.5)
    flying.heard.clear()
    lat, lon = at(100.0, 50.0)
    flying.send(mavlink.MAVLink_terrain_check_message(lat, lon))
    flying.run(0.01)
    (report,) = flying.messages("TERRAIN_REPORT")
    assert (report.lat, report.lon, report.terrain_height) == (lat, lon, 584.0)


def test_the_streams_of_sensors_have_the_second_ones() -> None:
    copter = Copter(autopilot={"SR2_RAW_SENS": 10, "SR2_EXTRA3": 10})
    copter.run(3.0)
    for name in ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2", "WIND"):
        assert len(copter.messages(name)) == pytest.approx(29, abs=2), name


def test_an_enabled_fence_is_in_sys_status() -> None:
    copter = Copter(
        autopilot={"FENCE_ENABLE": 1, "FENCE_RADIUS": 10.0, "FENCE_ACTION": 0, "AVOID_ENABLE": 0}
    ).in_the_air(5.0, 10.0)
    fence = mavlink.MAV_SYS_STATUS_GEOFENCE
    (status,) = asked(copter, mavlink.MAVLINK_MSG_ID_SYS_STATUS)[1]
    assert status.onboard_control_sensors_enabled & fence
    assert status.onboard_control_sensors_health & fence
    for north in (4.0, 4.0, -4.0, -4.0, -4.0, -4.0):
        copter.go(0.0, 0.0, 0.0, 0xDC7, vx=north)
        copter.run(2.9)
        if north > 0.0:
            (status,) = asked(copter, mavlink.MAVLINK_MSG_ID_SYS_STATUS)[1]
    assert not status.onboard_control_sensors_health & fence
    assert (4, "Fence breach cleared") in texts(copter.answers())


# ---- whom a packet is for ------------------------------------------------------------------------------------------


def test_packets_to_components_that_nobody_has_heard_are_for_the_autopilot() -> None:
    copter = Copter()
    copter.run(2.1)
    for component, heard in ((190, True), (7, True)):
        copter.heard.clear()
        copter.send(mavlink.MAVLink_mission_request_list_message(1, component, 0))
        copter.run(0.01)
        assert bool(copter.messages("MISSION_COUNT")) == heard
    companion = mavlink.MAVLink(None, srcSystem=1, srcComponent=7)
    copter.waiting = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(companion)
    copter.run(0.01)
    for component, heard in ((190, True), (7, False)):
        copter.heard.clear()
        copter.send(mavlink.MAVLink_mission_request_list_message(1, component, 0))
        copter.run(0.01)
        assert bool(copter.messages("MISSION_COUNT")) == heard
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_request_list_message(2, 190, 0))
    copter.run(0.01)
    assert copter.messages("MISSION_COUNT") == []


def test_old_requests_are_answered_with_warnings() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.answers()
    copter.send(mavlink.MAVLink_fence_fetch_point_message(1, 1, 0), mavlink.MAVLink_rally_fetch_point_message(1, 1, 0))
    copter.run(0.01)
    assert texts(copter.answers()) == [
        (6, "Received message (FENCE_FETCH_POINT) is deprecated"),
        (4, "Invalid fence point, index past total(0 >= 0)"),
        (6, "Received message (RALLY_FETCH_POINT) is deprecated"),
        (4, "Failed to get rally point"),
    ]
    for _ in range(2):
        copter.send(mavlink.MAVLink_mission_request_message(1, 1, 0, 0))
        copter.run(0.01)
    assert texts(copter.answers()) == [(4, "got MISSION_REQUEST; use MISSION_REQUEST_INT!")]


def test_there_are_no_logs() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    copter.run(0.01)
    (entry,) = copter.messages("LOG_ENTRY")
    assert (entry.id, entry.num_logs, entry.size) == (0, 0, 0)
    copter.heard.clear()
    for message in (
        mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90),
        mavlink.MAVLink_log_erase_message(1, 1),
        mavlink.MAVLink_log_request_end_message(1, 1),
        mavlink.MAVLink_log_data_message(1, 0, 0, [0] * 90),  # of another vehicle, which is sent to all
    ):
        copter.send(message)
        copter.run(0.01)
    assert copter.heard == []


def test_logs_are_for_disarmed_vehicles_which_is_told_once() -> None:
    copter = Copter()
    copter.run(3.0)
    assert copter.ask(400, 1)[0] == ("ACK", 400, ACCEPTED)
    for _ in range(2):
        copter.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
        copter.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90))
        copter.send(mavlink.MAVLink_log_data_message(1, 0, 0, [0] * 90))
        copter.run(0.1)
    assert [text for text in texts(copter.answers()) if "log" in text[1]] == [(3, "Disarm for log download")]
    assert copter.messages("LOG_ENTRY") == []


def test_an_item_beyond_the_end_is_answered_with_the_number_of_items() -> None:
    """In both forms of the request; only that of MISSION_REQUEST_INT tells the number."""
    copter = Copter()
    copter.run(2.1)
    for request, kinds in (
        (mavlink.MAVLink_mission_request_int_message, ["MISSION_COUNT", "MISSION_ACK"]),
        (mavlink.MAVLink_mission_request_message, ["MISSION_ACK"]),
    ):
        copter.heard.clear()
        copter.send(request(1, 1, 9, 0))
        copter.run(0.01)
        heard = [message.get_type() for _, message in copter.heard if message.get_type() != "STATUSTEXT"]
        assert heard == kinds
        assert copter.messages("MISSION_ACK")[0].type == mavlink.MAV_MISSION_INVALID_SEQUENCE


def test_calibrations_say_and_refuse_as_arducopter() -> None:
    """The accelerometer's at most once in 5 s (also after the start); the barometer's with its two texts."""
    copter = Copter()
    copter.run(6.0)
    busy = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert copter.ask(241, 0, 0, 0, 0, 4) == [("ACK", 241, ACCEPTED)]
    assert copter.ask(241, 0, 0, 0, 0, 2) == [("ACK", 241, busy)]
    copter.run(5.0)
    assert copter.ask(241, 0, 0, 0, 0, 2) == [("ACK", 241, ACCEPTED)]
    told = [("TEXT", 6, "Updating barometer calibration"), ("TEXT", 6, "Barometer calibration complete")]
    assert copter.ask(241, 0, 0, 1) == [("ACK", 241, ACCEPTED), *told]


def test_a_parachute_is_not_released_on_the_ground() -> None:
    copter = Copter()
    copter.run(2.1)
    release = mavlink.MAV_CMD_DO_PARACHUTE
    assert copter.ask(release, 2) == [("ACK", release, ACCEPTED)]
    assert copter.ask(release, 1) == [("ACK", release, ACCEPTED)]
    assert copter.ask(release, 2) == [("ACK", release, ACCEPTED), ("TEXT", 6, "Parachute: Landed")]
    copter.run(1.0)
    assert copter.ask(400, 1) == [("ACK", 400, FAILED), ("TEXT", 2, "Arm: Chute has no relay")]
    assert copter.ask(release, 0) == copter.ask(release, 2) == [("ACK", release, ACCEPTED)]


@pytest.mark.parametrize(
    ("command", "parameters", "result"),
    [
        (mavlink.MAV_CMD_SCRIPTING, (0,), DENIED),
        (mavlink.MAV_CMD_SCRIPTING, (2,), ACCEPTED),
        (mavlink.MAV_CMD_SCRIPTING, (3,), ACCEPTED),
        (mavlink.MAV_CMD_SCRIPTING, (4,), mavlink.MAV_RESULT_UNSUPPORTED),
        (mavlink.MAV_CMD_STORAGE_FORMAT, (1, 1), FAILED),
        (mavlink.MAV_CMD_STORAGE_FORMAT, (1, 0), mavlink.MAV_RESULT_UNSUPPORTED),
        (mavlink.MAV_CMD_AIRFRAME_CONFIGURATION, (-1, 1), ACCEPTED),
    ],
)
def test_scripts_cards_and_gears(command: int, parameters: tuple[int, ...], result: int) -> None:
    copter = Copter()
    copter.run(2.1)
    assert copter.ask(command, *parameters) == [("ACK", command, result)]


def test_unknown_frames_are_named() -> None:
    copter = Copter()
    copter.run(2.1)
    for command in (mavlink.MAV_CMD_DO_SET_HOME, mavlink.MAV_CMD_DO_SET_ROI_LOCATION):
        copter.answers()
        copter.send(mavlink.MAVLink_command_int_message(1, 1, 21, command, 0, 0, 0, 0, 0, 0, 10, 10, 5))
        copter.run(0.01)
        assert copter.answers() == [("ACK", command, DENIED), ("TEXT", 6, "Unknown mavlink coordinate frame 21")]


# ---- missions ------------------------------------------------------------------------------------------------------

FLIGHT = [(16, 0, 0, 584.0), (22, 3, 0, 10.0), (16, 3, 30, 10.0), (16, 3, 60, 10.0)]


def item_int(copter: Copter, sequence: int, command: int, north: float, z: float, *p: float) -> None:
    lat, lon = at(north, 0.0)
    values = [*p, *[0.0] * (4 - len(p))]
    copter.send(mavlink.MAVLink_mission_item_int_message(1, 1, sequence, 3, command, 0, 1, *values, lat, lon, z, 0))
    copter.run(0.01)


def test_a_part_of_a_mission_is_replaced() -> None:
    copter = Copter()
    copter.run(2.1)
    assert upload(copter, FLIGHT) == 0
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 2, 0))
    copter.run(0.01)
    assert [m.seq for m in copter.messages("MISSION_REQUEST")] == [2]
    item_int(copter, 2, 16, 30.0, 11.0)
    assert copter.messages("MISSION_ACK")[0].type == 0
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    for sequence in range(4):
        copter.send(mavlink.MAVLink_mission_request_int_message(1, 1, sequence, 0))
    copter.run(0.01)
    assert copter.messages("MISSION_COUNT")[0].count == 4
    assert [m.z for m in copter.messages("MISSION_ITEM_INT")][1:] == [10.0, 11.0, 10.0]


@pytest.mark.parametrize(("first", "last"), [(-1, 2), (3, 2), (2, 5), (5, 5)])
def test_a_part_that_the_mission_does_not_have(first: int, last: int) -> None:
    copter = Copter()
    copter.run(2.1)
    upload(copter, FLIGHT)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, 0))
    copter.run(0.02)
    assert copter.messages("MISSION_ACK")[0].type == mavlink.MAV_MISSION_ERROR
    assert texts(copter.answers()) == [(4, "Flight plan update rejected")]


@pytest.mark.parametrize(
    ("command", "parameters", "z", "expected"),
    [
        (178, (0, 5, -1, 0), NAN, 0),  # as MAVSDK uploads a speed
        (178, (0, 5, -1, NAN), 0.0, 9),
        (178, (0, 5, NAN, 0), 0.0, 8),
        (16, (0, 0, 0, NAN), 10.0, 0),
        (16, (0, 0, NAN, 0), 10.0, 8),
        (16, (0, 0, 0, 0), NAN, 12),
        (16, (0, math.inf, 0, 0), 10.0, 7),
        (20, (0, 0, 0, 0), NAN, 0),
        (20, (NAN, 0, 0, 0), 0.0, 6),
        (22, (0, 0, 0, NAN), 10.0, 0),
        (22, (NAN, 0, 0, 0), 10.0, 6),
        (21, (NAN, NAN, NAN, NAN), 0.0, 0),
        (93, (1, 0, 0, 0), NAN, 0),
        (115, (90, 0, 0, 0), NAN, 0),
    ],
)
def test_nan_in_mission_items(command: int, parameters: tuple[float, ...], z: float, expected: int) -> None:
    copter = Copter()
    copter.run(2.1)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    copter.run(0.01)
    item_int(copter, 0, 16, 0.0, 584.0)
    item_int(copter, 1, command, 10.0, z, *parameters)
    assert [m.type for m in copter.messages("MISSION_ACK")] == [expected]


def begin(copter: Copter) -> None:
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert result(copter.ask(mavlink.MAV_CMD_MISSION_START)) == ACCEPTED


def test_after_disarming_a_mission_begins_again() -> None:
    copter = Copter()
    copter.run(2.1)
    assert upload(copter, [*FLIGHT[:2], (21, 3, 0, 0.0)]) == 0
    begin(copter)
    copter.run(50.0)
    assert (copter.m["armed"], copter.m["mission_current"]) == (False, 0)
    copter.heard.clear()
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.answers()
    copter.command(mavlink.MAV_CMD_MISSION_START)
    copter.run(12.0)
    assert (6, "Mission: 1 Takeoff") in texts(copter.answers())
    assert copter.v["position"][2] < -5.0


def test_a_mission_that_is_replaced_in_flight_goes_on_at_the_same_item() -> None:
    copter = Copter()
    copter.run(2.1)
    upload(copter, FLIGHT)
    begin(copter)
    copter.run(16.0)
    assert copter.m["mission_current"] == 2
    copter.answers()
    assert upload(copter, [*FLIGHT[:2], (16, 3, 40, 10.0), (16, 3, 60, 10.0)]) == 0
    copter.run(0.1)
    assert (copter.m["mode"], copter.m["mission_current"]) == (AUTO, 2)
    assert copter.m["guided_position_neu"][0] == pytest.approx(40.0, abs=0.1)
    assert (6, "Auto mission changed, restarted command") in texts(copter.answers())


def test_a_mission_that_is_flown_is_not_cleared() -> None:
    copter = Copter()
    copter.run(2.1)
    upload(copter, FLIGHT)
    begin(copter)
    copter.run(6.0)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    copter.run(0.01)
    assert [m.type for m in copter.messages("MISSION_ACK")] == [mavlink.MAV_MISSION_ERROR]
    assert copter.m["mission_count"] == len(FLIGHT)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mavlink.COPTER_MODE_GUIDED)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    copter.run(0.01)
    assert [m.type for m in copter.messages("MISSION_ACK")] == [mavlink.MAV_MISSION_ACCEPTED]
    assert copter.m["mission_count"] == 0
