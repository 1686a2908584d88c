"""Servo outputs without a function, and the relay: DO_SET_SERVO, DO_SET_RELAY and their repetitions.

Kernels over the record that `gcs.record` declares. Pulses are told by SERVO_OUTPUT_RAW, the relay by RELAY_STATUS.

Source: ArduPilot, AP_ServoRelayEvents.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim.messages import (
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_FAILED,
    MAV_SEVERITY_INFO,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
)
from cosim_models.autopilot.gcs.words import IN_USE, say

__all__ = ["continue_repetition", "repeat_relay", "repeat_servo", "set_relay", "set_servo"]

_TRIM = 1500  # us, the centre of a servo
_LONGEST = 3600.0  # s


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
