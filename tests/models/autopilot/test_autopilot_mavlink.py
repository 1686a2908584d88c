"""Conversations with the autopilot: packets made and read by pymavlink, answers as recorded from ArduCopter."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.autopilot import Autopilot
from tests.models.copter import (
    ACCEPTED,
    DENIED,
    FAILED,
    GUIDED,
    LAND,
    LOITER,
    ONLY_POSITION,
    RTL,
    STABILIZE,
    UNSUPPORTED,
    Copter,
    Decoder,
    H,
)
from tests.models.shipped_kernels import kernels

NAN = float("nan")
LAT, LON = -353632620, 1491652370
EARLY = 0.5
"""Before the pre-arm checks pass, attitude estimated; the estimate is ready at 2 s."""
CHECKED = 1.3
"""Pre-arm checks pass in STABILIZE, no position yet."""


def ack(command: int, result: int) -> tuple[str, int, int]:
    return ("ACK", command, result)


def text(severity: int, words: str) -> tuple[str, int, str]:
    return ("TEXT", severity, words)


def copter_at(time: float, **options: Any) -> Copter:
    copter = Copter(**options)
    copter.run(time)
    return copter


def reposition(
    copter: Copter, flags: float, frame: int = 6, lat: int = LAT, lon: int = LON, z: float = 10.0
) -> list[Any]:
    copter.answers()
    copter.send(mavlink.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, flags, 0, NAN, lat, lon, z))
    copter.tick()
    copter.tick()
    return copter.answers()


# ---- arming and modes: the recorded probes -----------------------------------------------------------------------


def test_arming_before_the_attitude_is_estimated() -> None:
    assert copter_at(0.1).ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        text(2, "Arm: Accels inconsistent"),
        text(2, "Arm: EKF attitude is bad"),
        text(2, "Arm: AHRS: not using configured AHRS type"),
    ]


def test_arming_before_home_is_known() -> None:
    assert copter_at(EARLY).ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        text(2, "Arm: AHRS: waiting for home"),
    ]


def test_the_recorded_probes_before_the_position_estimate() -> None:
    copter = copter_at(CHECKED)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED),
        text(6, "Arming motors"),
    ]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == [
        ack(mavlink.MAV_CMD_DO_SET_MODE, FAILED),
        text(4, "Mode change to GUIDED failed: requires position"),
    ]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED),
        text(6, "Disarming motors"),
    ]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == [
        ack(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED),
        text(2, "PreArm: Need Position Estimate"),
    ]
    assert copter.m["mode"] == GUIDED
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        text(2, "Arm: Need Position Estimate"),
    ]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, STABILIZE) == [ack(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]


def test_the_recorded_probes_with_a_position_estimate() -> None:
    copter = copter_at(2.1)
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    assert reposition(copter, 0) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED),
        text(6, "Arming motors"),
    ]
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    assert reposition(copter, 0) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert copter.m["mode"] == STABILIZE
    assert reposition(copter, 1) == [ack(mavlink.MAV_CMD_DO_REPOSITION, ACCEPTED)]
    assert copter.m["mode"] == GUIDED
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED)]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED),
        text(6, "Disarming motors"),
    ]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED)]


@pytest.mark.parametrize(("mode", "name"), [(LOITER, "LOITER"), (RTL, "RTL")])
def test_modes_that_need_a_position_are_refused_while_armed_without(mode: int, name: str) -> None:
    copter = copter_at(CHECKED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    expected = [ack(mavlink.MAV_CMD_DO_SET_MODE, FAILED), text(4, f"Mode change to {name} failed: requires position")]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, mode) == expected


def test_mode_commands() -> None:
    copter = copter_at(2.1)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 99) == [
        ack(mavlink.MAV_CMD_DO_SET_MODE, FAILED),
        text(4, "No such mode 99"),
    ]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 0, GUIDED) == [ack(mavlink.MAV_CMD_DO_SET_MODE, DENIED)]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, NAN, GUIDED) == [ack(mavlink.MAV_CMD_DO_SET_MODE, DENIED)]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, NAN) == [ack(mavlink.MAV_CMD_DO_SET_MODE, DENIED)]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 81, GUIDED) == [ack(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 129, GUIDED) == [ack(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
    assert copter.ask(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [ack(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, ACCEPTED)]
    assert copter.m["mode"] == RTL
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED),
        text(2, "Arm: RTL mode not armable"),
    ]
    assert copter.ask(mavlink.MAV_CMD_NAV_LAND) == [ack(mavlink.MAV_CMD_NAV_LAND, ACCEPTED)]
    assert copter.m["mode"] == LAND


@pytest.mark.parametrize("version", [1, 2])
def test_set_mode_is_obeyed_and_not_acknowledged(version: int) -> None:
    copter = copter_at(2.1)
    copter.answers()
    copter.send(mavlink.MAVLink_set_mode_message(1, 1, LOITER), version=version)
    copter.send(mavlink.MAVLink_set_mode_message(1, 0, GUIDED), version=version)
    copter.send(mavlink.MAVLink_set_mode_message(1, 1, 4294967295), version=version)
    copter.run(2 * H)
    assert copter.answers() == [text(4, "No such mode 4294967295")]
    assert copter.m["mode"] == LOITER


def test_arming_can_be_forced_and_disarming_in_flight_must_be() -> None:
    copter = copter_at(EARLY)
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196)[0] == ack(
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED
    )
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 2) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, UNSUPPORTED)
    ]
    copter = Copter().in_the_air(5.0, 10.0)
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, FAILED)]
    assert copter.m["armed"]
    assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == [
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, ACCEPTED),
        text(6, "Disarming motors"),
    ]
    assert not copter.m["armed"]
    copter.run(0.05)
    assert (copter.m["motor"] == 0.0).all()


def test_takeoff_needs_a_height_above_the_ground() -> None:
    copter = copter_at(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, NAN) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, ACCEPTED)]
    copter.run(6.0)
    assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ack(mavlink.MAV_CMD_NAV_TAKEOFF, FAILED)]


# ---- other commands ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [519, 192, 16, 31000, 65535])
def test_unknown_commands_are_unsupported(command: int) -> None:
    assert copter_at(2.1).ask(command, 1) == [ack(command, UNSUPPORTED)]


def test_reposition_refuses_what_is_no_place() -> None:
    copter = copter_at(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    told = ("TEXT", 6, "Unknown mavlink coordinate frame 21")
    assert reposition(copter, 0, frame=21) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED), told]
    assert reposition(copter, 0, lat=900000001) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert reposition(copter, 0, lon=-1800000001) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert reposition(copter, 0, lat=0, lon=0) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert reposition(copter, 0, z=NAN) == [ack(mavlink.MAV_CMD_DO_REPOSITION, DENIED)]
    assert reposition(copter, NAN) == [ack(mavlink.MAV_CMD_DO_REPOSITION, ACCEPTED)]
    for frame in (0, 3, 5, 6):
        assert reposition(copter, 0, frame=frame) == [ack(mavlink.MAV_CMD_DO_REPOSITION, ACCEPTED)]


def test_reposition_flies_there() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert reposition(copter, 1, frame=6, lat=LAT + 900, lon=LON, z=6.0) == [
        ack(mavlink.MAV_CMD_DO_REPOSITION, ACCEPTED)
    ]
    copter.run(9.0)
    assert copter.v["position"] == pytest.approx((900 * 0.011131884502145034, 0.0, -6.0), abs=0.1)


def test_command_int_is_as_good_as_command_long() -> None:
    copter = copter_at(2.1)
    copter.answers()
    copter.send(mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, GUIDED, 0, 0, 0, 0, 0))
    copter.send(mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0))
    copter.send(mavlink.MAVLink_command_int_message(1, 1, 3, 22, 0, 0, 0, 0, 0, 0, 0, 0, 4.0))
    copter.run(2 * H)
    assert [a for a in copter.answers() if a[0] == "ACK"] == [
        ack(mavlink.MAV_CMD_DO_SET_MODE, 0),
        ack(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0),
        ack(mavlink.MAV_CMD_NAV_TAKEOFF, 0),
    ]
    assert copter.m["takeoff_to"] == 4.0


def test_speed_changes() -> None:
    copter = copter_at(2.1)
    assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3) == [
        ack(mavlink.MAV_CMD_DO_CHANGE_SPEED, FAILED)
    ]  # STABILIZE has no speed
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    for kind, name in ((0, "speed_max"), (1, "speed_max"), (2, "speed_up"), (3, "speed_down")):
        assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, kind, 1.5 + kind) == [
            ack(mavlink.MAV_CMD_DO_CHANGE_SPEED, ACCEPTED)
        ]
        assert copter.m[name] == 1.5 + kind
    for wrong in (0.0, -1.0, NAN, math.inf):
        assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, wrong) == [ack(mavlink.MAV_CMD_DO_CHANGE_SPEED, DENIED)]
    assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, 4, 3.0) == [ack(mavlink.MAV_CMD_DO_CHANGE_SPEED, DENIED)]
    for unknown in (-1, 5, NAN):
        assert copter.ask(mavlink.MAV_CMD_DO_CHANGE_SPEED, unknown, 3.0) == [
            ack(mavlink.MAV_CMD_DO_CHANGE_SPEED, FAILED)
        ]


def test_the_nose_can_be_turned() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, 90, 0, 0, 0) == [ack(mavlink.MAV_CMD_CONDITION_YAW, ACCEPTED)]
    copter.run(4.0)
    assert copter.messages("ATTITUDE") == []
    assert copter.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_ATTITUDE)[0] == ack(
        mavlink.MAV_CMD_REQUEST_MESSAGE, ACCEPTED
    )
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_ATTITUDE)
    copter.run(2 * H)
    assert copter.messages("ATTITUDE")[-1].yaw == pytest.approx(math.pi / 2, abs=0.05)
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, 45, 0, -1, 1) == [ack(mavlink.MAV_CMD_CONDITION_YAW, ACCEPTED)]
    copter.run(4.0)
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_ATTITUDE)
    copter.run(2 * H)
    assert copter.messages("ATTITUDE")[-1].yaw == pytest.approx(math.pi / 4, abs=0.08)
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, 400) == [ack(mavlink.MAV_CMD_CONDITION_YAW, FAILED)]
    assert copter.ask(mavlink.MAV_CMD_CONDITION_YAW, NAN) == [ack(mavlink.MAV_CMD_CONDITION_YAW, FAILED)]


def test_a_position_target_can_carry_a_heading_or_a_turn_rate() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(4.0, 0.0, -5.0, ONLY_POSITION & ~0x400, yaw=1.0)
    copter.run(5.0)
    assert copter.m["yaw_fixed"] == 1.0
    copter.go(4.0, 0.0, -5.0, ONLY_POSITION & ~0x800, yaw_rate=0.3)
    copter.run(1.5)
    assert copter.v["angular_velocity"][2] == pytest.approx(0.3, abs=0.1)
    copter.go(4.0, 0.0, -5.0, ONLY_POSITION & ~0x400, yaw=NAN)
    copter.run(1.0)
    assert np.isfinite(copter.v["attitude"]).all()


# ---- who is meant ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", [(0, 0), (7, 0), (7, 1), (0, 1)])
def test_commands_to_this_system_or_to_all_are_answered(target: tuple[int, int]) -> None:
    assert copter_at(2.1, system=7).ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED, target=target) == [
        ack(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
    ]


@pytest.mark.parametrize("target", [(2, 1), (255, 0), (0, 2)])
def test_commands_to_others_are_not_answered(target: tuple[int, int]) -> None:
    copter = copter_at(2.1, system=7)
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED, target=target) == []
    assert copter.m["mode"] == STABILIZE


def test_targets_outside_guided_are_ignored_and_never_answered() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, LOITER)
    copter.go(30.0, 0.0, -5.0)
    copter.run(2.0)
    assert abs(copter.v["position"][0]) < 0.1
    assert copter.answers() == []


@pytest.mark.parametrize(
    ("mask", "frame", "x"),
    [(ONLY_POSITION, 2, 9.0), (0xFFF, 1, 9.0), (0xC38, 1, 9.0), (ONLY_POSITION, 1, NAN), (0x3C7, 1, 0)],
)
def test_targets_that_mean_nothing_stop_the_vehicle(mask: int, frame: int, x: float) -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.go(20.0, 0.0, -5.0)
    copter.run(2.0)
    assert copter.v["velocity"][0] > 2.0
    copter.go(x, 0.0, -5.0, mask, frame)
    copter.run(8.0)  # the integral keeps the acceleration at first, as in ArduCopter
    assert np.linalg.norm(copter.v["velocity"]) < 0.2
    assert copter.v["position"][0] < 15.0


def test_a_global_target_in_an_unknown_frame_stops() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    copter.send(
        mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 21, 0xDF8, LAT + 9000, LON, 5.0, *[0.0] * 8)
    )
    copter.run(3.0)
    assert np.linalg.norm(copter.v["position"][:2]) < 0.1


# ---- what it says ------------------------------------------------------------------------------------------------


def test_a_fresh_link_hears_heartbeats_and_home_only() -> None:
    copter = copter_at(4.2)
    beats = copter.messages("HEARTBEAT")
    assert [t for t, m in copter.heard if m.get_type() == "HEARTBEAT"] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    assert (beats[0].type, beats[0].autopilot, beats[0].mavlink_version) == (2, 3, 3)
    assert [b.base_mode for b in beats] == [81] * 5
    assert [b.system_status for b in beats] == [1, 3, 3, 3, 3]
    others = [m.get_type() for _, m in copter.heard if m.get_type() != "HEARTBEAT"]
    assert others == ["GPS_GLOBAL_ORIGIN", "HOME_POSITION"]
    home = copter.messages("HOME_POSITION")[0]
    assert (home.latitude, home.longitude, home.altitude) == (LAT, LON, 584000)
    assert all(math.isnan(q) for q in home.q)


def test_heartbeats_tell_of_changes_at_once() -> None:
    copter = copter_at(2.1)
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.tick()
    (beat,) = copter.messages("HEARTBEAT")
    assert (beat.base_mode, beat.custom_mode, beat.system_status) == (217, GUIDED, 3)
    copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5)
    copter.run(6.0)
    assert copter.messages("HEARTBEAT")[-1].system_status == 4


def test_the_start_up_is_arducopters() -> None:
    """Times scaled to `estimate_ready_time`; at 41.5 s they are those of a simulated ArduCopter."""
    copter = Copter(autopilot={"estimate_ready_time": 41.5})
    for message in (1, 24, 193, 32, 33):
        copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, 100000)
    copter.run(43.0)

    def changes(name: str, pick: Any) -> list[tuple[float, Any]]:
        found: list[tuple[float, Any]] = []
        for t, m in copter.heard:
            if m.get_type() == name and (not found or found[-1][1] != pick(m)):
                found.append((round(t, 1), pick(m)))
        return found

    flags = changes("EKF_STATUS_REPORT", lambda m: m.flags)
    assert flags == [(0.1, 1024), (5.4, 0), (5.9, 167), (41.5, 831)]
    assert changes("GPS_RAW_INT", lambda m: m.fix_type) == [(0.1, 0), (9.8, 6)]
    health = changes("SYS_STATUS", lambda m: m.onboard_control_sensors_health)
    assert health == [(0.1, 0x47519C0F), (9.8, 0x47519C2F), (22.4, 0x47719C2F), (23.4, 0x57719C2F)]
    assert changes("LOCAL_POSITION_NED", lambda m: 1)[0][0] == 41.5
    assert changes("GLOBAL_POSITION_INT", lambda m: m.lat) == [(0.1, 0), (19.8, LAT)]
    assert [round(t, 1) for t, m in copter.heard if m.get_type() == "HOME_POSITION"] == [19.8]


def test_sensor_bits_when_armed() -> None:
    copter = Copter().in_the_air(5.0, 8.0)
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    copter.run(2 * H)
    status = copter.messages("SYS_STATUS")[-1]
    assert status.onboard_control_sensors_present == 0x5371FC2F
    assert status.onboard_control_sensors_enabled == 0x5361FC2F
    assert status.onboard_control_sensors_health == 0x5771FC2F


def test_streams_are_asked_for_by_interval() -> None:
    copter = copter_at(2.1)
    assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 250000) == [
        ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ACCEPTED)
    ]
    begin = copter.time
    copter.run(2.0)
    times = [t for t, m in copter.heard if m.get_type() == "GLOBAL_POSITION_INT"]
    assert len(times) == 8
    assert np.diff(times) == pytest.approx(0.25)
    assert times[0] - begin == pytest.approx(0.25, abs=3 * H)
    assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, -5) == [
        ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, DENIED)
    ]
    assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, -1) == [
        ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ACCEPTED)
    ]
    copter.run(1.0)
    assert copter.messages("GLOBAL_POSITION_INT") == []
    assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 100) == [
        ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ACCEPTED)
    ]  # 1 ms at the fastest, and every step is slower
    copter.run(0.1)
    assert len(copter.messages("GLOBAL_POSITION_INT")) == 40
    copter.ask(
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 0
    )  # back to the parameters: off
    copter.run(0.5)
    assert copter.messages("GLOBAL_POSITION_INT") == []
    for wrong in (12345, -3, NAN, 1e30):
        number = 12345 if wrong == 12345 else 0
        assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, wrong, 1e6) == [
            ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, DENIED),
            text(6, f"No ap_message for mavlink id ({number})"),
        ]
    assert copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, math.inf) == [
        ack(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ACCEPTED)
    ]


def test_parameters_set_the_rates_of_a_fresh_link() -> None:
    copter = copter_at(4.0, autopilot={"SR2_POSITION": 4, "SR2_EXTRA1": 10, "SR2_EXT_STAT": 2, "SR2_EXTRA3": 1})
    counts = {
        n: len(copter.messages(n)) for n in ("GLOBAL_POSITION_INT", "ATTITUDE", "SYS_STATUS", "EKF_STATUS_REPORT")
    }
    assert counts == {"GLOBAL_POSITION_INT": 15, "ATTITUDE": 39, "SYS_STATUS": 7, "EKF_STATUS_REPORT": 3}


def test_streams_are_asked_for_by_group() -> None:
    copter = copter_at(2.1)
    copter.send(mavlink.MAVLink_request_data_stream_message(1, 1, 6, 10, 1))
    copter.run(1.0)
    assert len(copter.messages("GLOBAL_POSITION_INT")) == 9
    assert len(copter.messages("LOCAL_POSITION_NED")) == 9
    assert copter.messages("ATTITUDE") == []
    copter.send(mavlink.MAVLink_request_data_stream_message(0, 0, 0, 4, 1))
    copter.heard.clear()
    copter.run(1.3)
    for name in (
        "ATTITUDE",
        "SYS_STATUS",
        "GPS_RAW_INT",
        "VFR_HUD",
        "EKF_STATUS_REPORT",
        "SYSTEM_TIME",
        "SERVO_OUTPUT_RAW",
    ):
        assert len(copter.messages(name)) == 5, name
    copter.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    copter.tick()
    copter.heard.clear()
    copter.run(1.0)
    assert {m.get_type() for _, m in copter.heard} == {"HEARTBEAT"}


@pytest.mark.parametrize(
    ("number", "name"),
    [(242, "HOME_POSITION"), (148, "AUTOPILOT_VERSION"), (245, "EXTENDED_SYS_STATE"), (0, "HEARTBEAT")],
)
def test_messages_on_request(number: int, name: str) -> None:
    copter = copter_at(2.5)
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number)
    copter.tick()
    assert len(copter.messages(name)) == 1
    assert copter.answers() == [ack(mavlink.MAV_CMD_REQUEST_MESSAGE, ACCEPTED)]


def test_other_requests() -> None:
    copter = copter_at(2.1)
    assert copter.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == [ack(mavlink.MAV_CMD_REQUEST_MESSAGE, FAILED)]
    assert copter.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, NAN) == [ack(mavlink.MAV_CMD_REQUEST_MESSAGE, FAILED)]
    copter.command(mavlink.MAV_CMD_GET_HOME_POSITION)
    copter.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    copter.tick()
    assert len(copter.messages("HOME_POSITION")) == len(copter.messages("GPS_GLOBAL_ORIGIN")) == 1
    (version,) = copter.messages("AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    assert copter_at(0.3).ask(mavlink.MAV_CMD_GET_HOME_POSITION) == [ack(mavlink.MAV_CMD_GET_HOME_POSITION, FAILED)]


def test_telemetry_is_the_motion_of_the_vehicle() -> None:
    copter = Copter(vehicle={"position_start[1]": 3.0, "position_start[2]": -20.0}).in_the_air(5.0, 10.0)
    copter.go(13.0, -10.0, -8.0)
    copter.run(2.0)
    for message in (33, 32, 30, 74, 24, 36, 245):
        copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message)
    p, v = copter.v["position"].copy(), copter.v["velocity"].copy()
    motor = copter.m["motor"].copy()
    rates = copter.v["angular_velocity"].copy()
    copter.tick()
    (g,), (local,), (att,) = (copter.messages(n) for n in ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ATTITUDE"))
    assert (local.x, local.y, local.z) == pytest.approx(p, rel=1e-5)
    assert (local.vx, local.vy, local.vz) == pytest.approx(v, abs=1e-5)
    scale = 0.011131884502145034
    assert g.lat == pytest.approx(LAT + p[0] / scale, abs=1)
    assert g.lon == pytest.approx(LON + p[1] / (scale * math.cos(math.radians(-35.363262))), abs=2)
    assert g.alt == pytest.approx(584000 - 1000 * p[2], abs=1)
    assert g.relative_alt == pytest.approx(-1000 * p[2], abs=8)  # home is where the feet stood
    assert (g.vx, g.vy, g.vz) == pytest.approx(100 * v, abs=1)
    assert g.hdg == pytest.approx(math.degrees(att.yaw) % 360 * 100, abs=1)
    assert (att.rollspeed, att.pitchspeed, att.yawspeed) == pytest.approx(rates, abs=0.3)  # filtered at 20 Hz
    assert g.time_boot_ms == local.time_boot_ms == att.time_boot_ms == round((copter.time - H) * 1000 - 0.49)
    (hud,), (gps,), (servo,) = (copter.messages(n) for n in ("VFR_HUD", "GPS_RAW_INT", "SERVO_OUTPUT_RAW"))
    assert hud.groundspeed == pytest.approx(np.hypot(v[0], v[1]), rel=1e-5)
    assert (gps.lat, gps.lon, gps.alt, gps.fix_type) == (g.lat, g.lon, g.alt, 6)
    assert gps.cog == pytest.approx(math.degrees(math.atan2(v[1], v[0])) % 360 * 100, abs=1)
    assert servo.servo1_raw == pytest.approx(1000 + 1000 * motor[0], abs=15)
    assert servo.servo5_raw == 0
    assert copter.messages("EXTENDED_SYS_STATE")[0].landed_state == 2


def test_landed_state_through_a_flight() -> None:
    copter = copter_at(2.1)
    copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    copter.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 100000)
    copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3)
    copter.run(12.0)
    copter.command(mavlink.MAV_CMD_NAV_LAND)
    copter.run(14.0)
    states = [m.landed_state for m in copter.messages("EXTENDED_SYS_STATE")]
    assert [s for i, s in enumerate(states) if i == 0 or states[i - 1] != s] == [1, 3, 2, 4, 1]


# ---- the link ----------------------------------------------------------------------------------------------------


def test_answers_come_in_the_version_last_heard() -> None:
    copter = copter_at(2.1)
    assert copter.sent[0] == 0xFD
    for version, magic in ((1, 0xFE), (2, 0xFD), (1, 0xFE)):
        copter.sent.clear()
        assert copter.ask(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, version=version) == [
            ack(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, FAILED)
        ]
        assert copter.ask(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1, version=version) == [
            ack(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, ACCEPTED)
        ]
        assert copter.sent[0] == magic


def test_one_sequence_without_gaps() -> None:
    copter = copter_at(2.1)
    copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 2500)
    copter.run(2.0)
    sequence, p = [], 0
    while p < len(copter.sent):
        sequence.append(copter.sent[p + 4])
        p += 12 + copter.sent[p + 1]
    assert len(sequence) > 600
    assert (np.diff(sequence) % 256 == 1).all()


def test_packets_that_are_not_for_an_autopilot_change_nothing() -> None:
    copter = copter_at(2.1)
    before = copter.m.tobytes()
    other = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
    copter.waiting = mavlink.MAVLink_global_position_int_message(0, 1, 2, 3, 4, 5, 6, 7, 8).pack(other)
    copter.tick()
    assert [m.get_type() for _, m in copter.heard if _ > 2.1] == []
    assert copter.m["mode"] == STABILIZE
    assert len(before) == len(copter.m.tobytes())


def test_its_own_packets_coming_back_are_ignored() -> None:
    copter = copter_at(2.1)
    echo = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    copter.waiting = mavlink.MAVLink_command_long_message(0, 0, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0).pack(echo)
    copter.run(2 * H)
    assert copter.m["mode"] == STABILIZE
    assert copter.messages("COMMAND_ACK") == []


def test_a_bad_checksum_is_no_command() -> None:
    copter = copter_at(2.1)
    packet = bytearray(
        mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0).pack(copter.station)
    )
    packet[-1] ^= 0x10
    copter.waiting = bytes(packet)
    copter.run(2 * H)
    assert copter.m["mode"] == STABILIZE
    assert copter.messages("COMMAND_ACK") == []


@pytest.mark.parametrize("shortest", [True, False])
def test_every_command_of_a_full_buffer_is_acknowledged(shortest: bool) -> None:
    """The send buffer cannot overflow: texts and streams wait, acknowledgements do not."""
    copter = copter_at(
        2.1, autopilot={f"SR2_{n}": 400 for n in ("EXT_STAT", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3", "RC_CHAN")}
    )
    copter.heard.clear()
    message: Any = mavlink.MAVLink_command_long_message(0, 0, 0, 0, *[0.0] * 7)
    if not shortest:
        message = mavlink.MAVLink_command_long_message(0, 0, 176, 0, 1, 99, 0, 0, 0, 0, 0)
    packet = message.pack(copter.station)
    count = 2048 // len(packet)
    copter.waiting = packet * count
    copter.run(0.1)
    assert len(copter.messages("COMMAND_ACK")) == count
    if not shortest:
        assert len(copter.messages("STATUSTEXT")) == 12
    assert len(copter.messages("ATTITUDE")) >= 38


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=300), st.integers(0, 2**32 - 1), st.lists(st.floats(width=32), min_size=7, max_size=7))
def test_no_packet_breaks_it(noise: bytes, seed: int, values: list[float]) -> None:
    """Random commands, parameters and bytes: motor commands stay within 0 and 1, and what is said is well-formed."""
    rng = np.random.default_rng(seed)
    m = Autopilot.record()
    start, advance = kernels(Autopilot)
    assert start(m) == 0
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    command = int(rng.choice([20, 21, 22, 115, 176, 178, 192, 400, 410, 511, 512, 520, int(rng.integers(65536))]))
    mask, frame = int(rng.integers(65536)), int(rng.integers(256))
    ints = [int(x) for x in rng.integers(-(2**31), 2**31, 2)]
    p = values
    packets = [
        mavlink.MAVLink_command_long_message(0, 0, command, 0, *p),
        mavlink.MAVLink_command_int_message(0, 0, frame, command, 0, 0, *p[:4], *ints, p[6]),
        mavlink.MAVLink_set_position_target_local_ned_message(0, 0, 0, frame % 12, mask, *p, *p[:4]),
        mavlink.MAVLink_set_position_target_global_int_message(0, 0, 0, frame % 12, mask, *ints, *p, *p[:2]),
        mavlink.MAVLink_request_data_stream_message(0, 0, frame, mask, 1),
    ]
    flight = [
        mavlink.MAVLink_set_mode_message(0, 1, GUIDED),
        mavlink.MAVLink_command_long_message(0, 0, 400, 0, 1, 21196, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(0, 0, 22, 0, 0, 0, 0, 0, 0, 0, 5.0),
    ]
    data = b"".join(x.pack(station) for x in flight)
    decode = Decoder()
    m["on_ground"] = False
    m["auto_armed"] = True
    for k in range(60):
        if k == 10:
            data = b"".join(packets[i].pack(station) for i in rng.permutation(len(packets))) + noise
        m["mavlink_rx"][: len(data)] = np.frombuffer(data, dtype=np.uint8)
        m["mavlink_rx_len"] = len(data)
        data = b""
        assert advance(m, 3.0 + k * H, H) == 0
        decode(m["mavlink_tx"][: int(m["mavlink_tx_len"])].tobytes())
        motor = m["motor"]
        assert ((motor >= 0.0) & (motor <= 1.0)).all()


def test_errors_of_start() -> None:
    start = kernels(Autopilot)[0]
    for field, value, word in (
        ("airframe", 42, "airframe"),
        ("SYSID_THISMAV", 0, "SYSID_THISMAV"),
        ("SYSID_THISMAV", 256, "SYSID_THISMAV"),
        ("PSC_POSXY_P", 0.0, "PSC_POSXY_P"),
        ("WPNAV_ACCEL_Z", -1.0, "WPNAV_ACCEL_Z"),
        ("ANGLE_MAX", 30.0, "ANGLE_MAX"),
    ):
        m = Autopilot.record()
        m[field] = value
        assert word in Autopilot.errors[start(m)]
    m = Autopilot.record()
    m["attitude"][:] = 0.0
    assert "attitude" in Autopilot.errors[start(m)]


@pytest.mark.parametrize("bad", [NAN, math.inf])
def test_a_motion_that_is_no_number_is_an_error(bad: float) -> None:
    start, advance = kernels(Autopilot)
    m = Autopilot.record()
    assert start(m) == 0
    m["velocity"][1] = bad
    assert "finite" in Autopilot.errors[advance(m, 0.0, H)]


def test_start_may_run_again() -> None:
    start = kernels(Autopilot)[0]
    once, twice = Autopilot.record(), Autopilot.record()
    start(once)
    start(twice)
    assert start(twice) == 0
    assert once.tobytes() == twice.tobytes()
    assert struct.calcsize("d") == 8
