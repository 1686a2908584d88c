"""Errors of accelerometer and gyro to the side, by SIM_ACC1_BIAS_X and _Y and SIM_GYR1_*, and the estimate with them.

A gyro that errs tilts the estimate, and the tilted weight, like an accelerometer that errs, becomes an acceleration and
then a velocity that are not there. The difference to the velocity of GPS levels the estimate, slows it down, and slowly
teaches it the error of the gyro; the heading is held by the compass. This is the linear error model of a navigation
filter with constant gains, of which EKF3 computes better ones while it flies. Without GPS, nothing corrects it.

The errors are those of the sensor by whose lane the vehicle flies (`lanes`).

Kernels over the autopilot's record `m`. Source: D. H. Titterton and J. L. Weston, Strapdown Inertial Navigation
Technology, chapter 12 (error propagation); the gains are from flights of ArduCopter 4.7-dev on its own physics with an
error of 1 m/s2, and with one of 0.05 rad/s.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import rotate
from cosim.kernel import kernel
from cosim.random_numbers import threefry
from cosim_models.autopilot.control.low_pass import low_pass

__all__ = [
    "GRAVITY",
    "LEARNING",
    "LEVELLING",
    "SLIP_GATE",
    "SLOWING",
    "accelerometer_error",
    "add_tilt",
    "errs_sideways",
    "forget_tilt",
    "gyro_error",
    "is_tilted",
    "shake_gyro",
    "watch_tilt",
]

GRAVITY = 9.80665  # m/s2
SLOWING, LEVELLING, LEARNING = 0.5, 0.02, 0.001
"""Gains for an error of the velocity: of the velocity [1/s], of the tilt [rad/s for 1 m/s] and of the gyro [rad/s2]."""
SLIP_GATE = 3.0
"""Of the horizontal velocity [m/s]."""
_LEARNING_YAW = 0.01  # 1/s2, of the error of the heading
_RETRY = 1.6  # s after which a velocity that is rejected is reset
_NEVER = -1.0
_SAME, _SAME_RATE = 1e-3, 1e-5  # rad and m/s; rad/s
_FRAMES = 1200.0  # Hz of ArduPilot's simulator, in each of which it draws a number
_KEY = 0x4759524F  # of the random numbers
_UNIT = 2.0 / 4294967296.0


@kernel
def accelerometer_error(m: Any, imu: int) -> tuple[float, float, float]:
    """Returns the error of an accelerometer, from 0 [m/s2, FRD]."""
    if imu == 0:
        return float(m.SIM_ACC1_BIAS_X), float(m.SIM_ACC1_BIAS_Y), float(m.SIM_ACC1_BIAS_Z)
    return float(m.SIM_ACC2_BIAS_X), float(m.SIM_ACC2_BIAS_Y), float(m.SIM_ACC2_BIAS_Z)


@kernel
def gyro_error(m: Any, imu: int) -> tuple[float, float, float]:
    """Returns the error of a gyro, from 0 [rad/s, FRD]."""
    if imu == 0:
        return float(m.SIM_GYR1_BIAS_X), float(m.SIM_GYR1_BIAS_Y), float(m.SIM_GYR1_BIAS_Z)
    return float(m.SIM_GYR2_BIAS_X), float(m.SIM_GYR2_BIAS_Y), float(m.SIM_GYR2_BIAS_Z)


@kernel
def errs_sideways(m: Any) -> bool:
    """Returns whether the parameters let accelerometer or gyro err so that the estimate tilts or shakes."""
    a, b = accelerometer_error(m, m.imu), gyro_error(m, m.imu)
    return bool(
        a[0] != 0.0
        or a[1] != 0.0
        or b[0] != 0.0
        or b[1] != 0.0
        or b[2] != 0.0
        or (m.SIM_GYR1_RND != 0.0 and m.imu == 0)
    )


@kernel
def is_tilted(m: Any) -> bool:
    """Returns whether an error of the estimate is left."""
    a, b = abs(m.tilt_error[0]) + abs(m.tilt_error[1]), abs(m.slip_error[0]) + abs(m.slip_error[1])
    c = m.gyro_learned
    return bool(a > _SAME or b > _SAME or abs(c[0]) + abs(c[1]) + abs(c[2]) > _SAME_RATE)


@kernel
def forget_tilt(m: Any) -> None:
    """Removes the errors of the estimate."""
    for i in range(2):
        m.tilt_error[i] = m.tilt_rate[i] = m.slip_error[i] = m.slip_rate[i] = m.slip_force[i] = 0.0
    for i in range(3):
        m.gyro_learned[i] = m.learning[i] = m.gyro_delays[i, 0] = m.gyro_delays[i, 1] = 0.0
    m.tilt_on = False
    m.slip_rejected_at = _NEVER


@kernel
def watch_tilt(m: Any, t: float) -> bool:
    """Sets the rates at which tilt, velocity and learned error of the gyro change; ten times a second.

    The rate of the heading's error, which must be that by the compass, is increased by that of the gyro. Returns
    whether the velocity has been rejected for so long that the position must be reset.
    """
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    a, b, c = accelerometer_error(m, m.imu), gyro_error(m, m.imu), m.gyro_learned
    wn, we, wd = rotate(q, (b[0] + c[0], b[1] + c[1], b[2] + c[2]))
    fn, fe, _ = rotate(q, (a[0], a[1], 0.0))
    m.slip_force[0] = fn - GRAVITY * m.tilt_error[1]
    m.slip_force[1] = fe + GRAVITY * m.tilt_error[0]
    n, e = float(m.slip_error[0]), float(m.slip_error[1])
    ratio = math.sqrt(n * n + e * e) / SLIP_GATE
    heard = m.SIM_GPS1_ENABLE != 0 and not m.gps_jammed
    used = 1.0 if heard and ratio < 1.0 else 0.0
    m.tilt_rate[0] = wn - used * LEVELLING * e
    m.tilt_rate[1] = we + used * LEVELLING * n
    m.slip_rate[0] = m.slip_force[0] - used * SLOWING * n
    m.slip_rate[1] = m.slip_force[1] - used * SLOWING * e
    back = (q[0], -q[1], -q[2], -q[3])
    learned = rotate(back, (-used * LEARNING * e, used * LEARNING * n, -_LEARNING_YAW * float(m.yaw_error)))
    for i in range(3):
        m.learning[i] = learned[i]
    m.yaw_error_rate += wd
    m.error_rate[0] += n
    m.error_rate[1] += e
    if heard:
        m.velocity_ratio = max(m.velocity_ratio, ratio)
    if not heard or ratio < 1.0:
        m.slip_rejected_at = _NEVER
        return False
    if m.slip_rejected_at == _NEVER:
        m.slip_rejected_at = t
    if m.gps_rejected_at == _NEVER:
        m.gps_rejected_at = t
    if t - m.slip_rejected_at < _RETRY:
        return False
    m.slip_rejected_at = _NEVER
    for i in range(2):
        m.slip_error[i] = m.slip_rate[i] = 0.0
    return True


@kernel
def shake_gyro(m: Any, h: float) -> None:
    """Adds the noise SIM_GYR1_RND, behind the filter of the gyro, to the angular velocity.

    Evenly distributed up to the parameter times the mean throttle. It is weaker by the root of the ratio of the steps,
    so that the filter lets as much of it through as of ArduPilot's.
    """
    throttle = 0.0
    for i in range(m.motor_count):
        throttle += m.motor[i] / m.motor_count
    most = math.radians(m.SIM_GYR1_RND) * throttle / math.sqrt(max(1.0, _FRAMES * h))
    a, b = threefry(_KEY, m.SYSID_THISMAV, m.gyro_draws, 0)
    c, _ = threefry(_KEY, m.SYSID_THISMAV, m.gyro_draws, 1)
    m.gyro_draws += 1
    m.gyro[0] += low_pass(m.gyro_delays[0], m.gyro_filter, most * (a * _UNIT - 1.0))
    m.gyro[1] += low_pass(m.gyro_delays[1], m.gyro_filter, most * (b * _UNIT - 1.0))
    m.gyro[2] += low_pass(m.gyro_delays[2], m.gyro_filter, most * (c * _UNIT - 1.0))


@kernel
def add_tilt(m: Any, h: float) -> None:
    """Adds the errors to angular velocity, acceleration, velocity and attitude of the estimate."""
    b = gyro_error(m, m.imu)
    m.gyro[0] += b[0] + m.gyro_learned[0]
    m.gyro[1] += b[1] + m.gyro_learned[1]
    m.gyro[2] += b[2] + m.gyro_learned[2]
    for i in range(3):
        m.gyro_learned[i] += m.learning[i] * h
    for i in range(2):
        m.tilt_error[i] += m.tilt_rate[i] * h
        m.slip_error[i] += m.slip_rate[i] * h
        m.velocity_neu[i] += m.slip_error[i]
        m.acceleration_neu[i] += m.slip_force[i]
    n, e = 0.5 * m.tilt_error[0], 0.5 * m.tilt_error[1]
    w = 1.0 / math.sqrt(1.0 + n * n + e * e)
    x, y = w * n, w * e
    q0, q1, q2, q3 = m.q[0], m.q[1], m.q[2], m.q[3]
    m.q[0] = w * q0 - x * q1 - y * q2
    m.q[1] = w * q1 + x * q0 + y * q3
    m.q[2] = w * q2 + y * q0 - x * q3
    m.q[3] = w * q3 + x * q2 - y * q1
