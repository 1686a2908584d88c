"""DO_MOTOR_TEST of rovers and boats: one output after another command, for a time, while the other keeps what it had.

A test arms, also in a mode in which the vehicle stands, and disarms at its end, as it does a vehicle that was armed
before. A further command goes on with another output or time. Fail-safes of radio, ground station and crash wait
meanwhile. Kernels over a record that has the variables of `gcs.record`.

Difference from ArduRover: a command to disarm ends the test.

Source: ArduPilot, Rover/motor_test.cpp, AR_Motors (output_test_pct, output_test_pwm).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED, MAV_SEVERITY_CRITICAL
from cosim_models.autopilot.gcs.sticks import ROLL, THROTTLE, deflection
from cosim_models.autopilot.gcs.words import TEST_KIND, TEST_MOTOR, TEST_PERCENT, TEST_PULSE, say

__all__ = ["continue_test", "testing"]

_PERCENT, _PULSE, _PILOT = range(3)  # MOTOR_TEST_THROTTLE_TYPE
_THROTTLE, _STEERING, _LAST, _NONE = 1, 2, 4, 3  # outputs; 3 and 4, of skid steering, are not there
_LONGEST = 30.0  # s
_MOST = 2200  # us
_CENTRE, _HALF = 1500.0, 500.0  # us


@kernel
def _whole(value: float, least: float, most: float) -> int:
    """Returns a number of a command without its decimals, 0 if it is none."""
    return int(min(max(value, least), most)) if math.isfinite(value) else 0


def testing(arm: Callable[[Any, bool, float], int]) -> Callable[[Any, float, float, float, float, float], int]:
    """Returns a kernel of (record, param1 to param4, time [s]) that handles DO_MOTOR_TEST; it returns a MAV_RESULT.

    Args:
        arm: kernel of (record, whether forced, time): arms if it can; returns a MAV_RESULT.
    """

    @kernel
    def begin(m: Any, output: int, kind: int, throttle: int, t: float) -> int:
        if not 0 <= output <= _LAST:
            say(m, MAV_SEVERITY_CRITICAL, TEST_MOTOR, output)
        elif kind > _PILOT:
            say(m, MAV_SEVERITY_CRITICAL, TEST_KIND, kind)
        elif kind == _PULSE and throttle > _MOST:
            say(m, MAV_SEVERITY_CRITICAL, TEST_PULSE, throttle)
        elif kind == _PERCENT and throttle > 100:
            say(m, MAV_SEVERITY_CRITICAL, TEST_PERCENT, throttle)
        else:
            return MAV_RESULT_ACCEPTED if m.armed else int(arm(m, False, t))
        return MAV_RESULT_FAILED

    @kernel
    def test(m: Any, p1: float, p2: float, p3: float, p4: float, t: float) -> int:
        output, kind, throttle = _whole(p1, -99.0, 99.0), _whole(p2, 0.0, 255.0), _whole(p3, -32768.0, 32767.0)
        if m.test_motor == 0 and begin(m, output, kind, throttle, t) != MAV_RESULT_ACCEPTED:
            return MAV_RESULT_FAILED
        m.test_motor = output if output in (_THROTTLE, _STEERING) else _NONE
        m.test_kind = kind
        m.test_command = throttle
        m.test_time = min(max(p4, 0.0), _LONGEST) if math.isfinite(p4) else 0.0
        m.test_since = t
        return MAV_RESULT_ACCEPTED

    return test


@kernel
def continue_test(m: Any, t: float) -> None:
    """Sets the tested output, or ends the test; required instead of driving while m.test_motor > 0."""
    if t - m.test_since >= m.test_time - 1e-9 or m.test_motor == _NONE or m.test_kind > _PILOT:
        m.test_motor = 0
        m.armed = False
        return
    share = 0.01 * min(max(m.test_command, -100.0), 100.0)
    if m.test_kind == _PULSE:
        share = min(max((m.test_command - _CENTRE) / _HALF, -1.0), 1.0)
    elif m.test_kind == _PILOT:
        share = deflection(m, ROLL if m.test_motor == _STEERING else THROTTLE, t)
    m.motor[0 if m.test_motor == _STEERING else 1] = 0.5 + 0.5 * share
