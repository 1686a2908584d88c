"""PREFLIGHT_REBOOT_SHUTDOWN: the autopilot starts anew in the middle of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.models.copter import ACCEPTED, FAILED, GUIDED, STABILIZE, UNSUPPORTED, Copter

REBOOT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
FORCED = 20190226.0


def texts(copter: Copter) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in copter.messages("STATUSTEXT")]


def boot_times(copter: Copter, name: str) -> list[tuple[float, int]]:
    """When messages were heard [s], and their time_boot_ms."""
    return [(t, m.time_boot_ms) for t, m in copter.heard if m.get_type() == name]


def upload(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    copter.run(0.1)
    for i in range(2):
        copter.send(mavlink.MAVLink_mission_item_int_message(1, 1, i, 3, 16, 0, 1, 0, 0, 0, 0, 1, 2, 9.0, 0))
        copter.run(0.1)
    assert copter.messages("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ACCEPTED


def test_it_starts_anew_with_its_parameters_and_plans() -> None:
    copter = Copter()
    copter.run(3.0)
    upload(copter)
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 777.0, 9))
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert copter.ask(interval, mavlink.MAVLINK_MSG_ID_ATTITUDE, 100_000)[0][2] == ACCEPTED
    assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0][2] == ACCEPTED
    copter.run(1.0)
    copter.heard.clear()
    began = copter.time
    copter.command(REBOOT, 1)
    copter.run(0.0025)
    assert copter.answers() == [("ACK", REBOOT, ACCEPTED)]
    copter.run(8.0)
    attitudes = boot_times(copter, "ATTITUDE")
    assert attitudes[-1][0] == pytest.approx(began + 0.2, abs=0.11)  # the stream has ended
    assert copter.m["mode"] == STABILIZE
    # It is silent for a second, and says what ArduCopter says then.
    spoken = [t for t, _ in copter.heard if t > began + 0.21]
    assert spoken[0] == pytest.approx(began + 0.2 + 1.0, abs=0.006)
    assert texts(copter) == [
        (6, "Barometer 1 calibration complete"),
        (6, "Barometer 2 calibration complete"),
        (6, "ArduPilot Ready"),
        (6, "Field Elevation Set: 584m"),
    ]
    beats = [t for t, m in copter.heard if m.get_type() == "HEARTBEAT" and t > began + 0.3]
    assert np.diff(beats) == pytest.approx(1.0)
    # Its clock has begun again.
    assert copter.ask(interval, mavlink.MAVLINK_MSG_ID_ATTITUDE, 100_000)[0][2] == ACCEPTED
    copter.run(0.5)
    heard, clock = boot_times(copter, "ATTITUDE")[-1]
    assert clock == pytest.approx(1000.0 * (heard - began - 0.2), abs=4.0)
    # Parameters and plans are kept.
    copter.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    copter.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    copter.run(0.1)
    assert copter.messages("PARAM_VALUE")[-1].param_value == 777.0
    assert copter.messages("MISSION_COUNT")[-1].count == 2


def test_it_flies_as_if_nothing_had_been() -> None:
    """A flight after a reboot is that of a fresh autopilot, that much later."""
    once, twice = Copter(), Copter()
    twice.run(2.0)
    twice.command(REBOOT, 1)
    twice.run(0.2 + 0.0025)  # the command arrives with the next step
    assert twice.m["booted_at"] == pytest.approx(2.2)
    flown = []
    for copter in (once, twice):
        copter.run(2.5)
        assert copter.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0][2] == ACCEPTED
        assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0][2] == ACCEPTED
        assert copter.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)[0][2] == ACCEPTED
        flown.append(copter.run(12.0))
    assert flown[0][-1, 3] == pytest.approx(-10.0, abs=0.2)
    assert np.abs(flown[0][:, 1:] - flown[1][:, 1:]).max() < 0.02


def test_it_is_deaf_while_it_boots() -> None:
    copter = Copter()
    copter.run(3.0)
    copter.command(REBOOT, 3)
    copter.run(0.5)
    copter.answers()
    for line in ("mavlink", "serial", "telemetry"):
        message = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
        copter.send(message, line=line)
        copter.run(0.05)
    copter.run(1.0)
    assert not [a for a in copter.answers() if a[0] == "ACK"]
    assert copter.m["mode"] == STABILIZE


def test_armed_it_reboots_by_force_only() -> None:
    copter = Copter().in_the_air(5.0)
    assert copter.ask(REBOOT, 1) == [("ACK", REBOOT, FAILED)]
    assert copter.ask(REBOOT, 2) == [("ACK", REBOOT, FAILED)]
    copter.run(1.5)
    assert copter.m["armed"] and copter.m["mode"] == GUIDED
    position: Any = copter.v["position"]
    assert position[2] == pytest.approx(-5.0, abs=0.2)
    assert copter.ask(REBOOT, 1, 0, 0, 0, 0, FORCED)[0] == ("ACK", REBOOT, ACCEPTED)
    copter.run(0.3)
    assert not copter.m["armed"] and copter.m["motor"].max() == 0.0
    copter.run(2.0)
    assert position[2] == pytest.approx(0.0, abs=0.1)  # it has fallen


def test_other_values_are_no_reboot() -> None:
    copter = Copter()
    copter.run(3.0)
    for kind in (0, 2, 4):
        assert copter.ask(REBOOT, kind) == [("ACK", REBOOT, UNSUPPORTED)]
    assert not copter.m["rebooting"]
