"""PREFLIGHT_REBOOT_SHUTDOWN of rover, plane and quadplane, as ArduRover and ArduPlane were heard to answer it."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.autopilot.test_small_autopilots import ARM, SET_MODE, WAYPOINT, made, started, upload
from tests.models.pair import ACCEPTED, FAILED, UNSUPPORTED, Pair

REBOOT, INTERVAL = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
FORCED = 20190226
PLANE = [
    "Barometer 1 calibration complete",
    "Barometer 2 calibration complete",
    "Airspeed 1 calibration started",
    "ArduPilot Ready",
]
TEXTS = {"rover": [*PLANE[:2], "Beginning INS calibration. Do not move vehicle", PLANE[3]], "plane": PLANE}
TEXTS["quadplane"] = PLANE


def texts(p: Pair) -> list[str]:
    return [m.text for m in p.heard if m.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize("kind", TEXTS)
def test_it_starts_anew_with_its_parameters_and_mission(kind: str) -> None:
    p = made(kind, pilot={"estimate_ready_time": 0.0})
    assert upload(p, [(WAYPOINT, 30.0, 0.0, 20.0, (0.0, 0.0))]) == mavlink.MAV_MISSION_ACCEPTED
    p.send(mavlink.MAVLink_param_set_message(1, 1, b"WP_RADIUS", 7.0, 9))
    assert p.ask(SET_MODE, 1, 15) == ACCEPTED
    assert p.ask(INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 100_000) == ACCEPTED
    for other in (0, 2, 4):
        assert p.ask(REBOOT, other) == UNSUPPORTED
    p.until(3.0)
    p.heard.clear()
    began = p.time
    assert p.ask(REBOOT, 1) == ACCEPTED
    p.until(began + 0.5)
    p.heard.clear()
    p.until(began + 1.15)
    assert not p.heard  # neither streams nor HEARTBEAT
    p.send(mavlink.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, 15, 0, 0, 0, 0, 0))
    p.one_step()
    assert not p.heard  # and deaf
    p.until(began + 3.5)
    assert texts(p) == TEXTS[kind]
    assert [m.custom_mode for m in p.heard if m.get_type() == "HEARTBEAT"] == [0, 0, 0]
    assert not [m for m in p.heard if m.get_type() == "ATTITUDE"]  # the streams have ended
    # Its clock has begun again; parameters and the mission are there.
    assert p.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_ATTITUDE) == ACCEPTED
    assert p.last("ATTITUDE").time_boot_ms == pytest.approx(1000.0 * (p.time - began - 0.2), abs=30.0)
    p.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WP_RADIUS", -1))
    p.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    p.one_step()
    assert p.last("MISSION_COUNT").count == 2
    assert p.last("PARAM_VALUE").param_value == 7.0


@pytest.mark.parametrize("kind", TEXTS)
def test_armed_it_reboots_by_force_only(kind: str) -> None:
    p = started(kind)
    assert p.ask(REBOOT, 1) == FAILED
    p.until(p.time + 1.0)
    assert p.m.armed
    p.send(mavlink.MAVLink_command_int_message(1, 1, 0, REBOOT, 0, 0, 1, 0, 0, 0, 0, FORCED, 0))
    p.until(p.time + 0.5)
    assert not p.m.armed and p.m.mode == 0
    assert not p.m.motor[4:].any()


def test_a_drive_after_a_reboot_is_that_of_a_fresh_autopilot() -> None:
    driven = []
    for reboots in (False, True):
        p = made("rover")
        p.until(2.0)
        if reboots:
            assert p.ask(REBOOT, 3) == ACCEPTED
            while p.m.restart_at >= 0.0:
                p.one_step()
        begin = p.step
        while p.step - begin < 300:
            p.one_step()
        assert p.ask(SET_MODE, 1, 15) == ACCEPTED
        assert p.ask(ARM, 1) == ACCEPTED
        p.go(20.0, 10.0, 0.0)
        places = []
        for _ in range(500):
            p.one_step()
            places.append(p.place)
        driven.append(np.array(places))
    assert np.abs(driven[0]).max() > 9.0
    assert np.abs(driven[0] - driven[1]).max() < 1e-9
