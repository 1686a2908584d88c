"""Failing motors: lost thrust, the boost of the others, the yaw that is needed all the time, and recorded flights."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.fidelity import compare, fly, verdict
from benchmarks.flights import read
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.autopilot.commander import checks
from cosim_models.autopilot.link.statustext import YAW_IMBALANCE
from cosim_models.autopilot.record.modes import ACRO
from cosim_models.vehicles.hexarotor import Hexarotor
from tests.models.copter import GUIDED, RECORDED_AUTOPILOT, RECORDINGS, Copter


def put(copter: Copter, name: str, value: float) -> None:
    copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))


def told(copter: Copter) -> list[tuple[float, str]]:
    return [(t, m.text) for t, m in copter.heard if m.get_type() == "STATUSTEXT" and m.severity == 0]


def propulsion(copter: Copter) -> bool:
    """Whether SYS_STATUS says that the motors give the thrust that they should."""
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    copter.run(0.1)
    bit = mavlink.MAV_SYS_STATUS_SENSOR_PROPULSION
    message = copter.messages("SYS_STATUS")[-1]
    assert message.onboard_control_sensors_present & bit and message.onboard_control_sensors_enabled & bit
    return bool(message.onboard_control_sensors_health & bit)


# ---- recorded flights -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "rms"),
    [
        ("x_weak_motor", 0.1),
        ("json_weak_motor_3mps", 0.05),
        ("hexa_weak_motor", 0.05),
        pytest.param("json_weak_motor", 0.05, marks=pytest.mark.slow),
        pytest.param("json_motor_lost", 0.1, marks=pytest.mark.slow),
        pytest.param("hexa_motor_lost_5mps", 0.1, marks=pytest.mark.slow),
        pytest.param("hexa_motor_lost", 0.15, marks=pytest.mark.slow),
    ],
)
def test_it_flies_on_as_the_real_one_did(name: str, rms: float) -> None:
    flight = read(RECORDINGS / f"{name}.csv.gz")
    found = compare(flight, fly(flight, {}))
    assert [key for key, pair in found.items() if key != "rms" and verdict(flight, key, *pair) == "differs"] == []
    assert found["rms"][1] < rms


# ---- lost thrust ----------------------------------------------------------------------------------------------------


def test_lost_thrust_is_told_and_the_other_motors_are_no_longer_held_back() -> None:
    """The flight hexa_weak_motor: after 2.88 s, as motor 3 gives half. With its thrust again, all is as before."""
    copter = Copter(Hexarotor, autopilot=dict(RECORDED_AUTOPILOT), direct=True)
    copter.in_the_air(20.0, 20.0)
    copter.go(0.0, 0.0, -20.0)
    copter.run(10.0)
    put(copter, "SIM_ENGINE_MUL", 0.5)
    put(copter, "SIM_ENGINE_FAIL", 4)
    begin = copter.time
    copter.heard.clear()
    copter.run(2.5)
    assert told(copter) == [] and not copter.m["boosting"] and propulsion(copter)
    copter.run(2.0)
    ((t, text),) = told(copter)
    assert text == "Potential Thrust Loss (3)"
    assert t - begin == pytest.approx(2.88, abs=0.05)
    assert copter.m["lost_motor"] == 2 and copter.m["boosted"] and not propulsion(copter)
    put(copter, "SIM_ENGINE_FAIL", 0)
    copter.run(8.0)
    assert not copter.m["boosting"] and copter.m["boost_share"] == 0.0 and propulsion(copter)
    assert len(told(copter)) == 1
    assert np.abs(copter.v["velocity"]).max() < 0.2


def test_the_boost_ends_with_disarming() -> None:
    copter = Copter(Hexarotor, autopilot=dict(RECORDED_AUTOPILOT), direct=True)
    copter.in_the_air(20.0, 20.0)
    copter.go(0.0, 0.0, -20.0)
    copter.run(10.0)
    put(copter, "SIM_ENGINE_MUL", 0.5)
    put(copter, "SIM_ENGINE_FAIL", 4)
    copter.run(4.5)
    assert copter.m["boosted"] and copter.m["boost_share"] > 0.0
    copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
    copter.run(0.1)
    assert not copter.m["boosting"] and copter.m["boost_share"] == 0.0


def test_one_good_step_begins_the_second_anew() -> None:
    """Thrust that is lost for 0.9 s, not in one step, and for 0.9 s again is not told; 1 s is."""
    m: Any = Autopilot.record()
    m.attitude_target[0] = 1.0
    m.armed, m.on_ground, m.motor_count = True, False, 6
    m.throttle_in, m.velocity_neu[2] = 0.95, -1.0
    m.thrust_mean[:6] = (0.5, 0.6, 0.5, 0.5, 0.7, 0.5)
    h = 0.0025
    for k in range(1, 720):
        m.velocity_neu[2] = 1.0 if k == 360 else -1.0
        checks.watch_thrust(m, 10.0 + k * h, h)
    assert (m.text_count, m.boosted) == (0, False)
    for k in range(720, 761):
        checks.watch_thrust(m, 10.0 + k * h, h)
    assert (m.text_count, m.boosted, m.lost_motor) == (1, True, 4)


@pytest.mark.parametrize(
    "change",
    [
        {"throttle_in": 0.85},
        {"throttle_in": 0.2, "limit_throttle_upper": True},
        {"thrust_error": math.radians(31.0)},
        {"armed": False},
        {"on_ground": True},
        {"lean": math.radians(16.0)},
    ],
)
def test_no_thrust_is_lost(change: dict[str, Any]) -> None:
    """Throttle below 90 %, or 25 % at a limit; an attitude that is wrong by 30 degrees, or to be 15 degrees."""
    m: Any = Autopilot.record()
    half = 0.5 * change.pop("lean", math.radians(14.0))
    m.attitude_target[0], m.attitude_target[1] = math.cos(half), math.sin(half)
    m.armed, m.on_ground, m.motor_count = True, False, 4
    m.throttle_in, m.velocity_neu[2] = 0.95, -1.0
    for key, value in change.items():
        m[key] = value
    for k in range(800):
        checks.watch_thrust(m, 10.0 + 0.0025 * k, 0.0025)
    assert m.text_count == 0


# ---- crashes --------------------------------------------------------------------------------------------------------


def tumbling(**change: Any) -> Any:
    """Returns the record of a vehicle that leans by 40 degrees where it should be level, and falls at 5 m/s."""
    m: Any = Autopilot.record()
    half = 0.5 * math.radians(40.0)
    m.q[0], m.q[1] = math.cos(half), math.sin(half)
    m.thrust_error, m.armed, m.on_ground, m.FS_CRASH_CHECK, m.mode = half * 2.0, True, False, 1, GUIDED
    m.velocity_neu[2], m.land_acceleration_neu[2] = -5.0, -2.0
    for key, value in change.items():
        m[key] = value
    return m


def test_one_good_step_begins_the_two_seconds_of_a_crash_anew() -> None:
    """ArduCopter looks in each step of its main loop, 400 times a second: 799 bad ones are no crash, 800 are."""
    m, h = tumbling(), 0.0025
    for k in range(1, 1560):
        m.thrust_error = math.radians(29.0 if k == 760 else 40.0)
        checks.watch_crash(m, 10.0 + k * h, h)
    assert m.armed and m.text_count == 0
    checks.watch_crash(m, 10.0 + 1560 * h, h)
    assert not m.armed and m.text_count > 0


@pytest.mark.parametrize(
    "change",
    [
        {"thrust_error": math.radians(30.0)},
        {"on_ground": True},
        {"armed": False},
        {"FS_CRASH_CHECK": 0},
        {"mode": ACRO},
        {"velocity_neu": (0.0, 0.0, -10.0)},
        {"land_acceleration_neu": (0.0, 0.0, -3.0)},
        {"q": (math.cos(math.radians(7.0)), math.sin(math.radians(7.0)), 0.0, 0.0)},
    ],
)
def test_no_crash(change: dict[str, Any]) -> None:
    m = tumbling(**change)
    for k in range(1200):
        checks.watch_crash(m, 10.0 + 0.0025 * k, 0.0025)
    assert m.text_count == 0


# ---- yaw ------------------------------------------------------------------------------------------------------------


def yaw_watched(integral: float, steps: int) -> tuple[list[float], Any]:
    """When [s] it is told with an integral that lasts, looked at ten times a second, and the record."""
    m: Any = Autopilot.record()
    m.on_ground, m.ATC_RAT_YAW_I, m.ATC_RAT_YAW_IMAX, m.yaw_warned_at = False, 0.018, 0.5, -100.0
    m.rate_pid[2, 3] = integral
    times = []
    for k in range(1, steps + 1):
        before = m.text_count
        checks._watch_yaw(m, 0.1 * k)
        times += [0.1 * k] if m.text_count > before else []
    return times, m


def test_a_yaw_that_is_needed_all_the_time_is_told_every_ten_seconds() -> None:
    """0.4 (1 - exp(-2 pi 0.05 Hz t)) reaches three quarters of 0.5 at t = ln(0.4 / 0.025) / 0.314 = 8.8 s."""
    times, m = yaw_watched(0.4, 250)
    assert times[0] == pytest.approx(math.log(0.4 / 0.025) / (2.0 * math.pi * 0.05), abs=0.2)
    assert np.diff(times) == pytest.approx([10.1], abs=0.02)
    assert m.text_queue[0, :3].tolist() == [0, YAW_IMBALANCE, 38]
    assert yaw_watched(0.37, 600)[0] == []
    assert yaw_watched(0.5, 5)[0] == [0.1]  # its limit is told at once


def test_the_text_of_the_yaw_has_a_percent_sign() -> None:
    copter = Copter()
    copter.in_the_air(6.0, 10.0)
    copter.heard.clear()
    copter.m["rate_pid"][2, 3] = 0.5
    copter.m["yaw_integral"] = 0.5
    copter.run(0.2)
    assert [text for _, text in told(copter)] == [f"Yaw Imbalance {round(100 * float(copter.m['yaw_integral']))}%"]
