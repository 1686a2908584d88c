"""Outputs other than flight: servos, relays and their repetitions, and the test of single motors.

Servo outputs appear in SERVO_OUTPUT_RAW. Outputs of motors cannot be set. As in a simulated ArduCopter, there is one
relay. A motor test runs on the ground, disarmed, one motor after the other in ArduPilot's order: clockwise from the
front. Kernels over the autopilot's record `m`.

Source: ArduPilot, AP_ServoRelayEvents, AP_Relay and ArduCopter motor_test.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.state import disarm
from cosim_models.autopilot.flight.sticks import channel
from cosim_models.autopilot.link.statustext import (
    CRITICAL,
    INFO,
    MOTOR_TEST_DONE,
    MOTOR_TEST_FLYING,
    MOTOR_TEST_STARTS,
    NO_NUMBER,
    SERVO_IN_USE,
    say,
)
from cosim_models.autopilot.record.variables import SERVOS

__all__ = ["repeat_relay", "repeat_servo", "run_outputs", "set_relay", "set_servo", "stop_motors", "test_motors"]

_SERVO, _RELAY = 1, 2  # m.repeat_kind
_TRIM = 1500  # us, the centre of a servo
_PERCENT, _PULSE, _PILOT = 0, 1, 2  # MOTOR_TEST_THROTTLE_TYPE
_SHORTEST, _LONGEST = 800.0, 2200.0  # us
_TEST_MAX = 600.0  # s


# ---- servos and relays ---------------------------------------------------------------------------------------------


@kernel
def _is_free(m: Any, number: float) -> bool:
    """Returns whether an output (from 1) exists and is not that of a motor."""
    if not 1.0 <= number < SERVOS + 1.0:
        return False
    if int(number) <= m.motor_count:
        say(m, INFO, SERVO_IN_USE, int(number))
        return False
    return True


@kernel
def _pulse(value: float) -> int:
    return int(clip(value, 0.0, 65535.0)) if math.isfinite(value) else 0


@kernel
def set_servo(m: Any, number: float, pulse: float) -> int:
    """Handles DO_SET_SERVO: output `number` (from 1), pulse [us]; returns a MAV_RESULT."""
    if not _is_free(m, number):
        return MAV_RESULT_FAILED
    if m.repeat_kind == _SERVO and m.repeat_number == int(number):
        m.repeat_left = 0
    m.servo[int(number) - 1] = _pulse(pulse)
    return MAV_RESULT_ACCEPTED


@kernel
def set_relay(m: Any, number: float, state: float) -> int:
    """Handles DO_SET_RELAY: 1 on, 0 off, otherwise toggled; returns a MAV_RESULT."""
    if not 0.0 <= number < 1.0:
        return MAV_RESULT_FAILED
    if m.repeat_kind == _RELAY:
        m.repeat_left = 0
    m.relay_on = state == 1.0 or (state != 0.0 and not m.relay_on)
    return MAV_RESULT_ACCEPTED


@kernel
def _repeat(m: Any, kind: int, number: int, pulse: int, count: float, period: float, t: float) -> None:
    m.repeat_kind = kind
    m.repeat_number = number
    m.repeat_pulse = pulse
    m.repeat_left = 2 * int(clip(count, 0.0, 16383.0)) if count == count else 0
    m.repeat_every = 0.5 * clip(period, 0.0, 3600.0) if period == period else 0.0
    m.repeat_at = t
    m.outputs_busy = True


@kernel
def repeat_servo(m: Any, number: float, pulse: float, count: float, period: float, t: float) -> int:
    """Handles DO_REPEAT_SERVO: `count` cycles of `period` [s] between the pulse and the centre."""
    if not _is_free(m, number):
        return MAV_RESULT_FAILED
    _repeat(m, _SERVO, int(number), _pulse(pulse), count, period, t)
    return MAV_RESULT_ACCEPTED


@kernel
def repeat_relay(m: Any, number: float, count: float, period: float, t: float) -> int:
    """Handles DO_REPEAT_RELAY: `count` cycles of `period` [s]."""
    if not 0.0 <= number < 1.0:
        return MAV_RESULT_FAILED
    _repeat(m, _RELAY, 0, 0, count, period, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _run_repetition(m: Any, t: float) -> None:
    if m.repeat_left == 0 or t < m.repeat_at - 1e-9:
        return
    m.repeat_at = t + m.repeat_every
    if m.repeat_kind == _RELAY:
        m.relay_on = not m.relay_on
    else:
        m.servo[m.repeat_number - 1] = m.repeat_pulse if m.repeat_left % 2 == 0 else _TRIM
    m.repeat_left -= 1


# ---- emergency stop ------------------------------------------------------------------------------------------------


@kernel
def stop_motors(m: Any, stops: bool) -> None:
    """Begins or ends the emergency stop, in which no motor turns; half of DISARM_DELAY later, the vehicle disarms."""
    m.emergency_stop = stops
    m.stopped_for = 0.0
    m.outputs_busy = m.outputs_busy or stops


@kernel
def _hold_still(m: Any, dt: float) -> None:
    for i in range(m.motor_count):
        m.motor[i] = 0.0
    m.stopped_for = m.stopped_for + dt if m.armed else 0.0
    if m.DISARM_DELAY > 0.0 and m.stopped_for >= 0.5 * m.DISARM_DELAY - 1e-9:
        disarm(m)


# ---- motor test ----------------------------------------------------------------------------------------------------


@kernel
def test_motors(m: Any, first: float, kind: float, throttle: float, duration: float, count: float, t: float) -> int:
    """Handles DO_MOTOR_TEST; returns a MAV_RESULT.

    Args:
        m: the record.
        first: number of the first motor in the order of the test, from 1.
        kind: of the throttle: 0 per cent, 1 pulse [us], 2 that of the pilot.
        throttle: in this unit.
        duration: time of each motor [s].
        count: number of motors.
        t: time [s].
    """
    if m.test_motor == 0:
        if not m.on_ground:
            say(m, CRITICAL, MOTOR_TEST_FLYING, NO_NUMBER)
            return MAV_RESULT_FAILED
        say(m, INFO, MOTOR_TEST_STARTS, NO_NUMBER)
    m.test_motor = int(clip(first, 1.0, 255.0)) if first == first else 1
    m.test_kind = int(clip(kind, 0.0, 255.0)) if kind == kind else 255
    m.test_throttle = clip(throttle, 0.0, 65535.0) if throttle == throttle else 0.0
    m.test_time = clip(duration, 0.0, _TEST_MAX) if duration == duration else 0.0
    m.test_count = max(int(clip(count, 0.0, 255.0)), 1) if count == count else 1
    m.test_since = t
    m.outputs_busy = True
    return MAV_RESULT_ACCEPTED


@kernel
def _motor_of(m: Any, place: int) -> int:
    """Returns the motor (from 0) at a place (from 1) of the order: clockwise from the front, -1 if there is none."""
    for i in range(m.motor_count):
        angle = math.atan2(-m.factors[i, 0], m.factors[i, 1]) % (2.0 * math.pi)
        before = 0
        for k in range(m.motor_count):
            other = math.atan2(-m.factors[k, 0], m.factors[k, 1]) % (2.0 * math.pi)
            if other < angle - 1e-6 or (k < i and abs(other - angle) <= 1e-6):
                before += 1
        if before == place - 1:
            return i
    return -1


@kernel
def _end_test(m: Any) -> None:
    m.test_motor = 0
    say(m, INFO, MOTOR_TEST_DONE, NO_NUMBER)


@kernel
def _run_test(m: Any, t: float) -> None:
    passed = t - m.test_since
    if passed >= m.test_time - 1e-9:
        if m.test_count <= 1:
            _end_test(m)
        elif passed >= 1.5 * m.test_time:
            m.test_motor += 1
            m.test_count -= 1
            m.test_since = t
        return
    pulse = 0.0
    if m.test_kind == _PERCENT and m.test_throttle <= 100.0:
        pulse = m.MOT_PWM_MIN + (m.MOT_PWM_MAX - m.MOT_PWM_MIN) * 0.01 * m.test_throttle
    elif m.test_kind == _PULSE:
        pulse = m.test_throttle
    elif m.test_kind == _PILOT:
        pulse = float(channel(m, m.RCMAP_THROTTLE, t))
    if not _SHORTEST <= pulse <= _LONGEST:
        _end_test(m)
        return
    motor = _motor_of(m, m.test_motor)
    if motor >= 0 and m.MOT_PWM_MAX > m.MOT_PWM_MIN:
        m.motor[motor] = clip((pulse - m.MOT_PWM_MIN) / (m.MOT_PWM_MAX - m.MOT_PWM_MIN), 0.0, 1.0)


@kernel
def run_outputs(m: Any, t: float, dt: float) -> None:
    """Continues repetitions, a motor test and a stop; required in every step while m.outputs_busy, after the motors."""
    _run_repetition(m, t)
    if m.emergency_stop:
        _hold_still(m, dt)
    if m.test_motor > 0:
        if m.armed:
            _end_test(m)
        else:
            _run_test(m, t)
    m.outputs_busy = m.repeat_left > 0 or m.test_motor > 0 or m.emergency_stop
