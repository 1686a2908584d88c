"""Messages on where the autopilot is going and what it measures, intervals and time synchronisation."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, Copter


@pytest.fixture(scope="module")
def under_way() -> Copter:
    """Two seconds on the way from 5 m over home to a place 12 m east and 3 m higher."""
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(0.0, 12.0, -8.0)
    copter.run(2.0)
    copter.heard.clear()
    for message in (62, 87, 85, 27, 164, 147, 125, 42):
        copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message)
    copter.tick()
    return copter


def test_the_destination(under_way: Copter) -> None:
    (target,) = under_way.messages("POSITION_TARGET_GLOBAL_INT")
    scale = 0.011131884502145034 * math.cos(math.radians(-35.363262))
    assert (target.coordinate_frame, target.type_mask, target.lat_int) == (0, 65016, -353632620)
    assert target.lon_int == pytest.approx(1491652370 + 12.0 / scale, abs=2)
    assert target.alt == pytest.approx(592.0, abs=0.02)
    (local,) = under_way.messages("POSITION_TARGET_LOCAL_NED")
    assert (local.x, local.y, local.z) == pytest.approx((0.0, 12.0, -8.0))


def test_the_way_there(under_way: Copter) -> None:
    (way,) = under_way.messages("NAV_CONTROLLER_OUTPUT")
    left = 12.0 - under_way.v["position"][1]
    assert way.wp_dist == pytest.approx(left, abs=1.0)
    assert way.target_bearing == pytest.approx(90, abs=2)
    assert way.alt_error == pytest.approx(8.0 + under_way.v["position"][2], abs=0.05)
    assert math.hypot(way.nav_roll, way.nav_pitch) > 2.0


def test_what_is_measured(under_way: Copter) -> None:
    (imu,), (true,) = under_way.messages("RAW_IMU"), under_way.messages("SIMSTATE")
    assert imu.zacc == pytest.approx(under_way.m["specific_force"][2] / 9.80665 * 1000.0, abs=1.5)
    assert imu.zgyro == pytest.approx(under_way.m["gyro"][2] * 1000.0, abs=1.5)
    assert (true.xacc, true.zacc) == pytest.approx(
        (under_way.m["specific_force"][0], under_way.m["specific_force"][2]), rel=1e-5
    )
    assert true.xgyro == pytest.approx(under_way.m["angular_velocity"][0], rel=1e-5)


def test_battery_board_and_mission(under_way: Copter) -> None:
    (battery,), (power,) = under_way.messages("BATTERY_STATUS"), under_way.messages("POWER_STATUS")
    assert battery.voltages == [12600] + [65535] * 9
    assert power.Vcc == 5000
    (mission,) = under_way.messages("MISSION_CURRENT")
    assert (mission.seq, mission.total, mission.mission_state) == (0, 0, 1)


def test_without_a_destination_none_is_told() -> None:
    copter = Copter()
    copter.run(2.1)
    copter.answers()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT)
    copter.tick()
    assert copter.messages("POSITION_TARGET_GLOBAL_INT") == []
    assert copter.answers() == [("ACK", mavlink.MAV_CMD_REQUEST_MESSAGE, ACCEPTED)]


def test_intervals_are_told() -> None:
    copter = Copter()
    copter.run(0.1)
    copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 250000)
    for question in ((510, 33), (512, 244, 33)):
        copter.command(*question)
    copter.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE)
    copter.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 9999)
    copter.tick()
    told = [(m.message_id, m.interval_us) for m in copter.messages("MESSAGE_INTERVAL")]
    assert told == [(33, 250000), (33, 250000), (30, -1), (9999, 0)]
    assert copter.ask(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, -1.0) == [
        ("ACK", mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, FAILED)
    ]


def test_timesync_is_answered_and_answers_are_not() -> None:
    copter = Copter()
    copter.run(0.5)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_timesync_message(0, 123456789012))
    copter.send(mavlink.MAVLink_timesync_message(5, 99))
    copter.tick()
    (answer,) = copter.messages("TIMESYNC")
    assert answer.ts1 == 123456789012
    assert answer.tc1 == pytest.approx(0.5e9, abs=1e6)


def test_attitude_sensors_and_memory_on_request(under_way: Copter) -> None:
    under_way.heard.clear()
    for message in (178, 163, 241, 152, 26, 29, 30, 33):
        under_way.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message)
    under_way.tick()
    (second,), (first,) = under_way.messages("AHRS2"), under_way.messages("ATTITUDE")
    assert (second.roll, second.pitch, second.yaw) == (first.roll, first.pitch, first.yaw)
    (place,) = under_way.messages("GLOBAL_POSITION_INT")
    assert (second.lat, second.lng) == (place.lat, place.lon)
    assert second.altitude == pytest.approx(place.alt * 1e-3, abs=2e-3)
    (imu,), (pressure,) = under_way.messages("SCALED_IMU"), under_way.messages("SCALED_PRESSURE")
    assert imu.zacc == pytest.approx(under_way.m["specific_force"][2] / 9.80665 * 1000.0, abs=1.5)
    # 11.3 Pa per metre there; ArduCopter's own barometer says 945.028 hPa at 584.08 m
    assert pressure.press_abs == pytest.approx(945.032 + 0.1126 * under_way.v["position"][2], abs=0.02)
    (vibration,), (memory,) = under_way.messages("VIBRATION"), under_way.messages("MEMINFO")
    assert 0.0 <= vibration.vibration_z < 1.0
    assert memory.freemem32 > 0
    (ahrs,) = under_way.messages("AHRS")
    assert (ahrs.omegaIx, ahrs.error_rp) == (0.0, 0.0)


def test_the_streams_hold_what_arducopter_streams() -> None:
    """Recorded from ArduCopter under REQUEST_DATA_STREAM 0 at 4 Hz, without TERRAIN_REQUEST."""
    recorded = {
        *("AHRS", "AHRS2", "ATTITUDE", "BATTERY_STATUS", "EKF_STATUS_REPORT", "GLOBAL_POSITION_INT", "GPS_RAW_INT"),
        *("LOCAL_POSITION_NED", "MEMINFO", "MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT", "POWER_STATUS", "RAW_IMU"),
        *("RC_CHANNELS", "SCALED_PRESSURE", "SERVO_OUTPUT_RAW", "SIMSTATE", "SYSTEM_TIME", "SYS_STATUS", "VFR_HUD"),
        *("VIBRATION", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE2", "WIND", "TERRAIN_REPORT"),
    }
    copter = Copter()
    copter.run(2.1)
    copter.heard.clear()
    copter.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    copter.run(2.01)
    counts = {kind: len(copter.messages(kind)) for kind in recorded}
    assert set(counts.values()) == {8}, counts
    others = {m.get_type() for _, m in copter.heard} - recorded
    assert others <= {"HEARTBEAT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN", "STATUSTEXT"}
