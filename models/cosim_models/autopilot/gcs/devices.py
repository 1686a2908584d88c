"""Servo outputs without a function, the relay, and the test of single lifting motors.

Kernels over the record that `gcs.record` declares. Pulses are told by SERVO_OUTPUT_RAW, the relay by RELAY_STATUS. A
motor test runs disarmed, one motor after the other in ArduPilot's order: clockwise from the front.

Source: ArduPilot, AP_ServoRelayEvents, ArduPlane/motor_test.cpp.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_FAILED,
    MAV_SEVERITY_INFO,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
)
from cosim_models.autopilot.gcs.sticks import opening
from cosim_models.autopilot.gcs.words import IN_USE, MOTOR_TEST_ARMED, say

__all__ = [
    "continue_motor_test",
    "continue_repetition",
    "repeat_relay",
    "repeat_servo",
    "set_relay",
    "set_servo",
    "test_motors",
]

_TRIM = 1500  # us, the centre of a servo
_LONGEST = 3600.0  # s
_PERCENT, _PULSE, _PILOT = 0.0, 1.0, 2.0  # MOTOR_TEST_THROTTLE_TYPE
_SHORTEST_PULSE, _LONGEST_PULSE = 800.0, 2200.0  # us
_TEST_MAX = 30.0  # s
_FIRST = 4  # of the elements of `motor` that lift
_IN_ORDER = np.array((0, 3, 1, 2), dtype=np.int64)
"""Motors of an X, clockwise from the front: front right, rear right, rear left, front left."""


@kernel
def _is_free(m: Any, number: float) -> bool:
    """Returns whether an output (from 1) exists and has no function; says so if it has one."""
    if not 1.0 <= number < 33.0:
        return False
    output = int(number)
    if m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT):
        used = output in (1, 3)
    else:
        used = output <= (8 if m.lifts or m.kind == MAV_TYPE_QUADROTOR else 4)
    if used:
        say(m, MAV_SEVERITY_INFO, IN_USE, output)
    return not used


@kernel
def _pulse(value: float) -> int:
    return int(min(max(value, 0.0), 65535.0)) if math.isfinite(value) else 0


@kernel
def set_servo(m: Any, number: float, pulse: float) -> int:
    """Sets an output (from 1) to a pulse [us]; returns a MAV_RESULT."""
    if not _is_free(m, number):
        return MAV_RESULT_FAILED
    if m.repeat_number == int(number):
        m.repeat_left = 0
    m.servo[int(number) - 1] = _pulse(pulse)
    return MAV_RESULT_ACCEPTED


@kernel
def set_relay(m: Any, number: float, state: float) -> int:
    """Switches relay 0: 1 on, 0 off, otherwise the other state; returns a MAV_RESULT."""
    if not 0.0 <= number < 1.0:
        return MAV_RESULT_FAILED
    if m.repeat_number == 0:
        m.repeat_left = 0
    m.relay_on = state == 1.0 or (state != 0.0 and not m.relay_on)
    return MAV_RESULT_ACCEPTED


@kernel
def _repeat(m: Any, number: int, pulse: int, count: float, period: float, t: float) -> None:
    m.repeat_number, m.repeat_pulse = number, pulse
    m.repeat_left = 2 * int(min(max(count, 0.0), 16383.0)) if math.isfinite(count) else 0
    m.repeat_every = 0.5 * min(max(period, 0.0), _LONGEST) if math.isfinite(period) else 0.0
    m.repeat_at = t


@kernel
def repeat_servo(m: Any, number: float, pulse: float, count: float, period: float, t: float) -> int:
    """Begins `count` cycles of `period` [s] of an output between a pulse and its centre; returns a MAV_RESULT."""
    if not _is_free(m, number):
        return MAV_RESULT_FAILED
    _repeat(m, int(number), _pulse(pulse), count, period, t)
    return MAV_RESULT_ACCEPTED


@kernel
def repeat_relay(m: Any, number: float, count: float, period: float, t: float) -> int:
    """Begins `count` cycles of `period` [s] of relay 0; returns a MAV_RESULT."""
    if not 0.0 <= number < 1.0:
        return MAV_RESULT_FAILED
    _repeat(m, 0, 0, count, period, t)
    return MAV_RESULT_ACCEPTED


@kernel
def test_motors(m: Any, first: float, kind: float, throttle: float, duration: float, count: float, t: float) -> int:
    """Handles DO_MOTOR_TEST; returns a MAV_RESULT.

    Args:
        m: the record.
        first: place of the first motor in the order of the test, from 1.
        kind: of the throttle: 0 per cent, 1 pulse [us], 2 that of the pilot.
        throttle: in this unit.
        duration: time of each motor [s].
        count: number of motors.
        t: time [s].
    """
    if not m.lifts:
        return MAV_RESULT_FAILED
    if m.armed:
        say(m, MAV_SEVERITY_INFO, MOTOR_TEST_ARMED, 0)
        return MAV_RESULT_FAILED
    pulse = 0.0
    if kind == _PERCENT and 0.0 <= throttle <= 100.0:
        pulse = 1000.0 + 10.0 * throttle
    elif kind == _PULSE:
        pulse = throttle
    elif kind == _PILOT:
        pulse = 1000.0 + 1000.0 * opening(m, t)
    valid = _SHORTEST_PULSE <= pulse <= _LONGEST_PULSE and first == first and duration == duration and count == count
    m.test_motor = int(min(max(first, 1.0), 255.0)) if valid else 0
    m.test_command = min(max(1e-3 * (pulse - 1000.0), 0.0), 1.0) if valid else 0.0
    m.test_time = min(max(duration, 0.0), _TEST_MAX) if valid else 0.0
    m.test_count = int(min(max(count, 0.0), 8.0)) if valid else 0
    m.test_since = t
    return MAV_RESULT_ACCEPTED


@kernel
def continue_motor_test(m: Any, t: float) -> None:
    """Turns the tested motor; required in every step while m.test_motor > 0, after all other outputs."""
    passed = t - m.test_since
    if m.armed or m.test_motor > _IN_ORDER.size or (passed >= m.test_time - 1e-9 and m.test_count <= 1):
        m.test_motor = 0
    elif passed < m.test_time - 1e-9:
        m.motor[_FIRST + _IN_ORDER[m.test_motor - 1]] = m.test_command
    elif passed >= 1.5 * m.test_time:  # half of the time is a pause
        m.test_motor += 1
        m.test_count -= 1
        m.test_since = t


@kernel
def continue_repetition(m: Any, t: float) -> None:
    """Makes the next change when it is due; required in every step while m.repeat_left > 0."""
    if t < m.repeat_at - 1e-9:
        return
    m.repeat_at = t + m.repeat_every
    if m.repeat_number == 0:
        m.relay_on = not m.relay_on
    else:
        m.servo[m.repeat_number - 1] = m.repeat_pulse if m.repeat_left % 2 == 0 else _TRIM
    m.repeat_left -= 1
