"""DO_MOTOR_TEST of rovers, as a real ArduRover 4.7-dev (90700977) with steps of 1 ms answered and drove."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.autopilot.rover_autopilot import RoverAutopilot
from cosim_models.vehicles.rover import Rover
from tests.models.autopilot.test_small_autopilots import SET_MODE, started
from tests.models.pair import ACCEPTED, FAILED, Pair

TEST, ARM = mavlink.MAV_CMD_DO_MOTOR_TEST, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
THROTTLE, STEERING = 1, 2
PERCENT, PULSE, PILOT = 0, 1, 2
CRITICAL, INFO = mavlink.MAV_SEVERITY_CRITICAL, mavlink.MAV_SEVERITY_INFO
RTL = 11


def texts(p: Pair) -> list[tuple[int, str]]:
    found = [(m.severity, m.text) for m in p.heard if m.get_type() == "STATUSTEXT"]
    p.heard.clear()
    return found


def pulses(p: Pair) -> tuple[int, int]:
    """Steering and throttle [us], of SERVO_OUTPUT_RAW."""
    p.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    found = p.last("SERVO_OUTPUT_RAW")
    return found.servo1_raw, found.servo3_raw


@pytest.fixture
def standing() -> Pair:
    p = Pair(Rover, RoverAutopilot)
    p.until(3.0)
    p.heard.clear()
    return p


@pytest.mark.parametrize(
    ("output", "kind", "value", "pulse"),
    [
        (THROTTLE, PERCENT, 30, (1500, 1650)),
        (STEERING, PERCENT, 50, (1750, 1500)),
        (THROTTLE, PULSE, 1600, (1500, 1600)),
        (THROTTLE, PILOT, 0, (1500, 1500)),
    ],
)
def test_an_output_is_tested_for_its_time(
    standing: Pair, output: int, kind: int, value: float, pulse: tuple[int, int]
) -> None:
    p = standing
    assert p.ask(TEST, output, kind, value, 1.5) == ACCEPTED
    p.until(p.time + 1.0)
    assert p.m.armed
    assert pulses(p) == pulse
    assert texts(p) == [(INFO, "Throttle armed")]
    p.until(p.time + 0.6)
    assert not p.m.armed
    assert pulses(p) == (1500, 1500)
    assert texts(p) == [(INFO, "Throttle disarmed")]


def test_the_throttle_drives_it(standing: Pair) -> None:
    """With 30 %, the real one on the same body was at 1.43 m/s after 0.6 s, and at 2.62 m/s after 1.2 s."""
    begin = standing.time
    assert standing.ask(TEST, THROTTLE, PERCENT, 30, 1.5) == ACCEPTED
    for time, speed in ((0.6, 1.43), (1.2, 2.62)):
        standing.until(begin + time)
        assert math.hypot(*standing.v["velocity"][:2]) == pytest.approx(speed, abs=0.15)


@pytest.mark.parametrize("output", [0, 3, 4])
def test_an_output_that_is_not_there_ends_the_test(standing: Pair, output: int) -> None:
    assert standing.ask(TEST, output, PERCENT, 50, 1.0) == ACCEPTED
    standing.until(standing.time + 0.1)
    assert not standing.m.armed
    assert standing.place[0] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ((5, PERCENT, 50), "Motor Test: invalid motor (5)"),
        ((1, PERCENT, 101), "Motor Test: percentage (101) too high"),
        ((1, PULSE, 2300), "Motor Test: pwm (2300) too high"),
        ((1, 4, 0), "Motor Test: invalid throttle type: 4"),
    ],
)
def test_what_is_refused(standing: Pair, question: tuple[int, int, int], text: str) -> None:
    assert standing.ask(TEST, *question, 1.0) == FAILED
    assert texts(standing) == [(CRITICAL, text)]
    assert not standing.m.armed


def test_a_test_disarms_a_vehicle_that_was_armed() -> None:
    p = started("rover")
    p.until(p.time + 1.0)
    p.heard.clear()
    assert p.ask(TEST, THROTTLE, PERCENT, 10, 1.0) == ACCEPTED
    p.until(p.time + 0.5)
    assert pulses(p) == (1500, 1550)
    p.until(p.time + 0.6)
    assert texts(p) == [(INFO, "Throttle disarmed")]


def test_a_further_command_goes_on_with_another_output_and_the_other_keeps_what_it_had(standing: Pair) -> None:
    p = standing
    assert p.ask(TEST, THROTTLE, PERCENT, 30, 60.0) == ACCEPTED  # 30 s at most
    p.until(p.time + 2.0)
    assert p.ask(TEST, STEERING, PERCENT, 40, 0.5) == ACCEPTED
    p.until(p.time + 0.3)
    assert pulses(p) == (1700, 1650)
    p.until(p.time + 0.3)
    assert pulses(p) == (1500, 1500)
    assert not p.m.armed


def test_a_long_test_ends_after_half_a_minute(standing: Pair) -> None:
    standing.ask(TEST, STEERING, PERCENT, 10, 60.0)
    standing.until(standing.time + 29.9)
    assert standing.m.armed
    standing.until(standing.time + 0.3)
    assert not standing.m.armed


def test_arming_may_refuse_the_test(standing: Pair) -> None:
    assert standing.ask(SET_MODE, 1, RTL) == ACCEPTED
    standing.heard.clear()
    assert standing.ask(TEST, THROTTLE, PERCENT, 30, 1.0) == FAILED
    assert texts(standing) == [(CRITICAL, "Arm: Mode not armable")]


def test_disarming_ends_the_test_and_failsafes_wait_meanwhile() -> None:
    p = Pair(Rover, RoverAutopilot, pilot={"SIM_RC_FAIL": 1, "FS_ACTION": 2})
    p.until(3.0)
    p.heard.clear()
    p.ask(TEST, STEERING, PERCENT, 10, 20.0)
    p.until(p.time + 5.0)
    assert texts(p) == [(INFO, "Throttle armed")]  # and no "Radio Failsafe"
    assert p.ask(ARM, 0) == ACCEPTED
    p.one_step()
    assert p.m.motor[0] == 0.5
    assert p.ask(ARM, 1) == ACCEPTED
    p.until(p.time + 0.5)
    assert p.m.armed
