"""The parameter protocol: lists, reading and setting, with pymavlink as the ground station."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import cosim_models
from cosim_models.autopilot.mavlink.parameters import PARAMETER_COUNT, PARAMETER_NAMES
from tests.models.copter import ACCEPTED, FAILED, GUIDED, ONLY_VELOCITY, RECORDED_AUTOPILOT, RECORDINGS, RTL, Copter

RENAMED = ("SYSID_THISMAV", "SYSID_MYGCS", "SR0_", "SR1_", "SR2_")
"""ArduCopter 4.6's names: MAV_SYSID, MAV_GCS_SYSID and MAV1_ to MAV3_ in 4.7."""


def values(copter: Copter) -> list[Any]:
    found = copter.messages("PARAM_VALUE")
    copter.heard.clear()
    return found


def read(copter: Copter, name: str, index: int = -1) -> list[Any]:
    copter.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), index))
    copter.tick()
    return values(copter)


def write(copter: Copter, name: str, value: float, kind: int = 9) -> list[Any]:
    copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    copter.tick()
    return values(copter)


@pytest.fixture
def copter() -> Copter:
    copter = Copter()
    copter.run(0.1)
    copter.heard.clear()
    return copter


def test_the_list_is_complete_and_comes_at_a_limited_rate(copter: Copter) -> None:
    copter.send(mavlink.MAVLink_param_request_list_message(1, 0))
    copter.run(0.1)
    assert 15 <= len(copter.messages("PARAM_VALUE")) <= 21
    copter.run(PARAMETER_COUNT * 0.005)
    found = values(copter)
    assert [v.param_id for v in found] == list(PARAMETER_NAMES)
    assert [v.param_index for v in found] == list(range(PARAMETER_COUNT))
    assert {v.param_count for v in found} == {PARAMETER_COUNT}
    copter.run(0.5)
    assert values(copter) == []


def test_a_list_asked_for_again_starts_again(copter: Copter) -> None:
    for _ in range(2):
        copter.send(mavlink.MAVLink_param_request_list_message(1, 0))
        copter.run(0.05)
    assert [v.param_index for v in values(copter)].count(0) == 2


def test_values_are_arducopters() -> None:
    lines = (RECORDINGS / "parameters.parm").read_text().split("\n")
    real = {name: float(value) for name, value in (line.split() for line in lines if line.strip())}
    real |= {"RNGFND1_MIN": 0.2, "RNGFND1_MAX": 7.0}  # not listed without a rangefinder; by the documentation
    copter = Copter(autopilot=RECORDED_AUTOPILOT)
    copter.send(mavlink.MAVLink_param_request_list_message(1, 0))
    copter.run(0.1 + PARAMETER_COUNT * 0.005)
    for v in values(copter):
        if not v.param_id.startswith(RENAMED):
            assert v.param_value == pytest.approx(real[v.param_id], rel=1e-6), v.param_id


def test_reading_by_name_and_by_index(copter: Copter) -> None:
    (by_name,) = read(copter, "WPNAV_SPEED")
    assert (by_name.param_id, by_name.param_value, by_name.param_type) == ("WPNAV_SPEED", 1000.0, 9)
    assert PARAMETER_NAMES[by_name.param_index] == "WPNAV_SPEED"
    (by_index,) = read(copter, "", by_name.param_index)
    assert by_index.param_id == "WPNAV_SPEED"
    for name, index in (("NO_SUCH_NAME", -1), ("WPNAV_SPEE", -1), ("", PARAMETER_COUNT), ("", 32767)):
        assert read(copter, name, index) == []


@pytest.mark.parametrize(
    ("name", "value", "kept"), [("RTL_ALT", 2000.7, 2000.0), ("RTL_ALT", 1999.995, 2000.0), ("ATC_ANG_RLL_P", 5.5, 5.5)]
)
def test_setting_is_told(copter: Copter, name: str, value: float, kept: float) -> None:
    (told,) = write(copter, name, value)
    assert (told.param_id, told.param_value, told.param_index) == (name, kept, 65535)
    assert copter.m[name] == kept


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_or_no_name_is_not_answered(copter: Copter, value: float) -> None:
    before = copter.m["WPNAV_SPEED"]
    assert write(copter, "WPNAV_SPEED", value) == []
    assert copter.m["WPNAV_SPEED"] == before
    assert write(copter, "NOT_KNOWN", 1.0) == []


@pytest.mark.parametrize(("name", "value"), [("PSC_POSXY_P", 0.0), ("ANGLE_MAX", 1e5), ("SYSID_THISMAV", 0.0)])
def test_values_the_laws_cannot_work_with_are_denied(copter: Copter, name: str, value: float) -> None:
    before = copter.m[name]
    copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    copter.tick()
    assert copter.m[name] == before
    (text,) = copter.messages("STATUSTEXT")
    assert (text.severity, text.text) == (4, f"Param write denied ({name})")
    assert values(copter)[0].param_value == before


def test_a_parameter_that_is_set_acts() -> None:
    copter = Copter().in_the_air(5.0, 10.0)
    write(copter, "WPNAV_SPEED", 200.0)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5)
    copter.run(0.1)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    copter.go(30.0, 0.0, -5.0)
    assert copter.run(6.0)[:, 4].max() < 2.2


def test_every_parameter_is_read_by_the_laws() -> None:
    """None is listed that does nothing. Calibrations and functions of channels, modes and rates are read by place."""
    folder = Path(cosim_models.__file__).parent
    sources = "".join(file.read_text() for file in folder.rglob("*.py") if file.name != "parameters.py")
    for name in PARAMETER_NAMES:
        if not re.fullmatch(r"RC\d+_(MIN|TRIM|MAX|DZ|REVERSED|OPTION)|FLTMODE\d|SR\d_\w+", name):
            assert f"m.{name}" in sources, name


def test_there_are_a_few_hundred() -> None:
    assert PARAMETER_COUNT >= 200


def test_pulses_of_the_motors_are_told_in_their_range() -> None:
    copter = Copter(autopilot={"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}).in_the_air(5.0, 10.0)
    copter.heard.clear()
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    copter.tick()
    (servos,) = copter.messages("SERVO_OUTPUT_RAW")
    assert servos.servo1_raw == pytest.approx(1100 + 800 * copter.m["motor"][0], abs=1)
    assert servos.servo5_raw == 0


def test_commands_are_slewed() -> None:
    """Between least and greatest command (0.8 apart) in a second up and two down, where they would be faster."""

    def rates(**values: float) -> np.ndarray[Any, Any]:
        copter = Copter(autopilot=values).in_the_air(5.0, 12.0)
        for name, value in values.items():
            copter.m[name] = value
        copter.m["rate_wanted"][:] = (1.0, 0.0, 0.0)
        motors = [copter.m["motor"][:4].copy()]
        for _ in range(200):
            copter.tick()
            motors.append(copter.m["motor"][:4].copy())
        return np.diff(np.array(motors), axis=0) / 0.0025

    free, slewed = rates(), rates(MOT_SLEW_UP_TIME=1.0, MOT_SLEW_DN_TIME=2.0)
    assert free.max() > 0.8
    assert free.min() < -0.4
    assert slewed.max() == pytest.approx(0.8, rel=1e-6)
    assert slewed.min() == pytest.approx(-0.4, rel=1e-6)


def test_limits_of_turning_and_leaning() -> None:
    copter = Copter(autopilot={"ATC_RATE_Y_MAX": 20.0, "PSC_ANGLE_MAX": 8.0}).in_the_air(5.0, 10.0)
    copter.command(mavlink.MAV_CMD_CONDITION_YAW, 170, 0, 0, 0)
    turned = [0.0]
    for _ in range(1200):
        copter.tick()
        turned.append(abs(float(copter.m["rate_target"][2])))
    assert np.degrees(max(turned)) == pytest.approx(20.0, rel=1e-6)
    copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=8.0)
    leans = []
    for _ in range(1200):
        copter.tick()
        leans.append(np.hypot(*copter.m["target_acceleration_neu"][:2]))
    assert max(leans) < 9.80665 * np.tan(np.radians(10.0)) + 1e-6  # no lean limit is below 10 degrees


def test_the_way_back_is_as_the_parameters_say() -> None:
    values = {"RTL_SPEED": 200.0, "RTL_CLIMB_MIN": 300.0, "RTL_ALT_FINAL": 400.0, "RTL_LOIT_TIME": 1000.0}
    copter = Copter(autopilot=values).in_the_air(20.0, 20.0)
    copter.go(15.0, 0.0, -20.0)
    copter.run(10.0)
    copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    path = copter.run(22.0)
    assert (-path[:, 3]).max() == pytest.approx(23.0, abs=0.3)
    assert np.hypot(path[:, 4], path[:, 5]).max() == pytest.approx(2.0, abs=0.25)
    copter.run(25.0)
    rest = copter.run(5.0)
    assert -rest[-1, 3] == pytest.approx(4.0, abs=0.2)
    assert copter.m["armed"]
    assert copter.m["mode"] == RTL


def test_arming_checks_can_be_left_out() -> None:
    for check, result in ((1, FAILED), (0, ACCEPTED)):
        copter = Copter(autopilot={"ARMING_CHECK": check})
        copter.run(0.05)
        assert copter.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
            "ACK",
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
            result,
        )


def test_motors_spool_down_as_slowly_as_asked_for() -> None:
    times = {}
    for down in (0.0, 2.0):
        copter = Copter(autopilot={"MOT_SPOOL_TIM_DN": down}).in_the_air(1.0, 8.0)
        copter.m["mode"] = 0  # STABILIZE with closed throttle
        began = copter.time
        while copter.m["spool_state"] > 1:
            copter.tick()
        times[down] = copter.time - began
    assert times[0.0] == pytest.approx(0.5, abs=0.01)
    assert times[2.0] == pytest.approx(2.0, abs=0.01)
