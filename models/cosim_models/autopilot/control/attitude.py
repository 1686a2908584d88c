"""Attitude control, from a thrust direction and a heading to torques, as in ArduCopter's AC_AttitudeControl.

The target attitude is shaped with limited angular acceleration. The body follows it with a square-root controller,
thrust direction first and heading second, and rate PIDs turn angular velocity errors into torques (-1 to 1). The amount
of thrust is determined elsewhere. Kernels over the autopilot's record `m`; FRD body axes, NED reference, quaternions
(w, x, y, z) that rotate body into NED, radians.

Source: ArduPilot, AC_AttitudeControl and AC_AttitudeControl_Multi.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import conjugate, multiply, rotate, yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.pid import INTEGRAL, pid
from cosim_models.autopilot.control.shaping import (
    clip,
    inverse_sqrt_controller,
    lowpass_alpha,
    sqrt_controller,
    wrap_pi,
)

__all__ = [
    "attitude_from_thrust",
    "demand_rates",
    "face",
    "follow_attitude",
    "follow_heading",
    "follow_rates",
    "follow_yaw_rate",
    "forget_torques",
    "hold_target",
    "lean_to",
    "relax_attitude",
    "relax_yaw",
    "run_rates",
    "shape_angle",
    "step_target",
    "tilt_and_heading_error",
]

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

_CDEG = math.radians(0.01)  # rad per centidegree
_DEG = math.radians(1.0)
_THRUST_ERROR = math.radians(30.0)  # beyond this, heading control is reduced
_YAW_ERROR_MAX = math.radians(45.0)
_TILT_ACCEL_MIN, _TILT_ACCEL_MAX = math.radians(40.0), math.radians(720.0)
_YAW_ACCEL_MIN, _YAW_ACCEL_MAX = math.radians(10.0), math.radians(120.0)
_RELAX = 0.3  # s, time constant with which integrals decay on the ground


@kernel
def attitude_from_thrust(n: float, e: float, d: float, heading: float) -> Quaternion:
    """Returns the attitude with thrust along (n, e, d) [NED, any length] and the given `heading` [rad]."""
    length = math.sqrt(n * n + e * e + d * d)
    if length == 0.0:
        n, e, d, length = 0.0, 0.0, -1.0, 1.0
    n, e, d = n / length, e / length, d / length
    w = math.sqrt(max(0.5 * (1.0 - d), 0.0))
    if w < 1e-6:  # thrust straight down: the axis is undetermined
        tilt = (0.0, 1.0, 0.0, 0.0)
    else:
        tilt = (w, e / (2.0 * w), -n / (2.0 * w), 0.0)
    return multiply(tilt, (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)))


@kernel
def tilt_and_heading_error(target: Quaternion, body: Quaternion) -> tuple[float, float, float, float]:
    """Returns the rotation from `body` to `target`: tilt about body x and y, then heading [rad], and the tilt angle."""
    w, x, y, z = multiply(conjugate(body), target)
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    c = math.sqrt(w * w + z * z)
    if c < 1e-9:  # upside down: the heading is undetermined
        return math.pi * x, math.pi * y, 0.0, math.pi
    heading = 2.0 * math.atan2(z, w)
    tx = (x * w - y * z) / c
    ty = (y * w + x * z) / c
    s = math.sqrt(tx * tx + ty * ty)
    angle = 2.0 * math.atan2(s, c)
    scale = 2.0 if s < 1e-9 else angle / s
    return tx * scale, ty * scale, heading, angle


@kernel
def _target(m: Any) -> Quaternion:
    return (
        float(m.attitude_target[0]),
        float(m.attitude_target[1]),
        float(m.attitude_target[2]),
        float(m.attitude_target[3]),
    )


@kernel
def _set_target(m: Any, q: Quaternion) -> None:
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        m.attitude_target[i] = q[i] * scale


@kernel
def _turned(q: Quaternion, x: float, y: float, z: float) -> Quaternion:
    """Returns `q` rotated by the rotation vector (x, y, z) in its own axes."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return q
    s = math.sin(0.5 * angle) / angle
    return multiply(q, (math.cos(0.5 * angle), x * s, y * s, z * s))


@kernel
def _towards_angle(
    error: float, time_constant: float, accel_max: float, rate: float, ff: float, rate_max: float, dt: float
) -> float:
    """Returns the next angular velocity of the shaped target, with limited angular acceleration."""
    wanted = ff + sqrt_controller(error, 1.0 / max(time_constant, 0.01), accel_max, dt)
    if rate_max > 0.0:
        wanted = clip(wanted, -rate_max, rate_max)
    if accel_max > 0.0:
        wanted = clip(wanted, rate - accel_max * dt, rate + accel_max * dt)
    return wanted


@kernel
def shape_angle(m: Any, error: float, accel_max: float, rate: float, dt: float) -> float:
    """Returns the next angular velocity towards a target angle `error` [rad] away, limited by `accel_max` [cdeg/s2]."""
    return _towards_angle(error, m.ATC_INPUT_TC, accel_max * _CDEG, rate, 0.0, 0.0, dt)


@kernel
def _advance_target(m: Any, dt: float) -> None:
    """Rotates the target attitude by its angular velocity."""
    w = m.rate_target
    _set_target(m, _turned(_target(m), w[0] * dt, w[1] * dt, w[2] * dt))


@kernel
def _shape_tilt(m: Any, wanted: Quaternion, dt: float) -> float:
    """Shapes the target's roll and pitch rates towards `wanted`; returns the heading error of the target."""
    x, y, z, _ = tilt_and_heading_error(wanted, _target(m))
    w = m.rate_target
    w[0] = _towards_angle(x, m.ATC_INPUT_TC, m.ATC_ACCEL_R_MAX * _CDEG, w[0], 0.0, m.ATC_RATE_R_MAX * _DEG, dt)
    w[1] = _towards_angle(y, m.ATC_INPUT_TC, m.ATC_ACCEL_P_MAX * _CDEG, w[1], 0.0, m.ATC_RATE_P_MAX * _DEG, dt)
    return z


@kernel
def follow_heading(m: Any, n: float, e: float, d: float, heading: float, heading_rate: float, dt: float) -> None:
    """Performs one step towards thrust along (n, e, d) [NED] and `heading` [rad], which turns at `heading_rate`
    [rad/s].
    """
    slew = m.ATC_SLEW_YAW * _CDEG
    if m.ATC_RATE_Y_MAX > 0.0:
        slew = min(slew, m.ATC_RATE_Y_MAX * _DEG)
    _advance_target(m, dt)
    error = _shape_tilt(m, attitude_from_thrust(n, e, d, heading), dt)
    ff = clip(heading_rate, -slew, slew)
    w = m.rate_target
    w[2] = _towards_angle(error, m.ATC_INPUT_TC, m.ATC_ACCEL_Y_MAX * _CDEG, w[2], ff, slew, dt)
    _follow_target(m, False, dt)


@kernel
def follow_yaw_rate(m: Any, n: float, e: float, d: float, rate: float, dt: float) -> None:
    """Performs one step towards thrust along (n, e, d) [NED] with yaw rate `rate` [rad/s]."""
    _advance_target(m, dt)
    heading = yaw_from_quaternion(_target(m))
    _shape_tilt(m, attitude_from_thrust(n, e, d, heading), dt)
    step = m.ATC_ACCEL_Y_MAX * _CDEG * dt
    if m.ATC_RATE_Y_MAX > 0.0:
        rate = clip(rate, -m.ATC_RATE_Y_MAX * _DEG, m.ATC_RATE_Y_MAX * _DEG)
    m.rate_target[2] += clip(rate - m.rate_target[2], -step, step)
    _follow_target(m, False, dt)


@kernel
def lean_to(m: Any, roll: float, pitch: float, rate: float, dt: float) -> None:
    """Performs one step towards Euler angles `roll` and `pitch` [rad] with yaw rate `rate` [rad/s]."""
    heading = yaw_from_quaternion(_target(m))
    c, s = math.cos(heading), math.sin(heading)
    forward = -math.sin(pitch) * math.cos(roll)
    right = math.sin(roll)
    follow_yaw_rate(m, forward * c - right * s, forward * s + right * c, -math.cos(pitch) * math.cos(roll), rate, dt)


@kernel
def face(m: Any, roll: float, pitch: float, heading: float, dt: float) -> None:
    """Performs one step towards Euler angles `roll`, `pitch` and `heading` [rad]."""
    c, s = math.cos(heading), math.sin(heading)
    forward = -math.sin(pitch) * math.cos(roll)
    right = math.sin(roll)
    down = -math.cos(pitch) * math.cos(roll)
    follow_heading(m, forward * c - right * s, forward * s + right * c, down, heading, 0.0, dt)


@kernel
def _limited(rate: float, most: float) -> float:
    """Returns an angular velocity within `most` [deg/s]; 0: not limited."""
    return clip(rate, -most * _DEG, most * _DEG) if most > 0.0 else rate


@kernel
def follow_attitude(m: Any, wanted: Any, rates: Any, dt: float) -> None:
    """Performs one step towards the attitude `wanted` (float64[4], unit quaternion), which it turns by `rates`.

    `rates` (float64[3]) is the angular velocity of `wanted` [rad/s, body axes]. As in ArduCopter, its feed-forward is
    rotated by the attitude.
    """
    _advance_target(m, dt)
    q = (float(wanted[0]), float(wanted[1]), float(wanted[2]), float(wanted[3]))
    x = _limited(rates[0], m.ATC_RATE_R_MAX)
    y = _limited(rates[1], m.ATC_RATE_P_MAX)
    z = _limited(rates[2], m.ATC_RATE_Y_MAX)
    fx, fy, fz = rotate(q, (x, y, z))
    ew, ex, ey, ez = multiply(conjugate(_target(m)), q)
    if ew < 0.0:
        ew, ex, ey, ez = -ew, -ex, -ey, -ez
    s = math.sqrt(ex * ex + ey * ey + ez * ez)
    scale = 2.0 if s < 1e-9 else 2.0 * math.atan2(s, ew) / s
    w, tc = m.rate_target, m.ATC_INPUT_TC
    w[0] = _towards_angle(ex * scale, tc, m.ATC_ACCEL_R_MAX * _CDEG, w[0], fx, m.ATC_RATE_R_MAX * _DEG, dt)
    w[1] = _towards_angle(ey * scale, tc, m.ATC_ACCEL_P_MAX * _CDEG, w[1], fy, m.ATC_RATE_P_MAX * _DEG, dt)
    w[2] = _towards_angle(ez * scale, tc, m.ATC_ACCEL_Y_MAX * _CDEG, w[2], fz, m.ATC_RATE_Y_MAX * _DEG, dt)
    q = _turned(q, fx * dt, fy * dt, fz * dt)
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        wanted[i] = q[i] / length
    _follow_target(m, False, dt)


@kernel
def follow_rates(m: Any, rates: Any, dt: float) -> None:
    """Performs one step towards angular velocities `rates` (float64[3]) of the target [rad/s, its own axes]."""
    _advance_target(m, dt)
    w = m.rate_target
    step = m.ATC_ACCEL_R_MAX * _CDEG * dt
    w[0] += clip(_limited(rates[0], m.ATC_RATE_R_MAX) - w[0], -step, step)
    step = m.ATC_ACCEL_P_MAX * _CDEG * dt
    w[1] += clip(_limited(rates[1], m.ATC_RATE_P_MAX) - w[1], -step, step)
    step = m.ATC_ACCEL_Y_MAX * _CDEG * dt
    w[2] += clip(_limited(rates[2], m.ATC_RATE_Y_MAX) - w[2], -step, step)
    _follow_target(m, False, dt)


@kernel
def demand_rates(m: Any, x: float, y: float, z: float) -> None:
    """Demands angular velocities [rad/s, body axes] of the rate controllers alone; the target is the body, at rest."""
    relax_attitude(m)
    m.rate_wanted[0], m.rate_wanted[1], m.rate_wanted[2] = x, y, z


@kernel
def step_target(m: Any, x: float, y: float, z: float, dt: float) -> None:
    """Turns the target by the rotation vector (x, y, z) [rad, its own axes], and performs one step of `hold_target`."""
    _set_target(m, _turned(_target(m), x, y, z))
    hold_target(m, dt)


@kernel
def hold_target(m: Any, dt: float) -> None:
    """Performs one step towards the target at rest, with rates proportional to the error."""
    for i in range(3):
        m.rate_target[i] = 0.0
    _follow_target(m, True, dt)


@kernel
def _follow_target(m: Any, proportional: bool, dt: float) -> None:
    """Computes the body's angular velocity towards the target: error correction plus feed-forward.

    The correction is `proportional` to the error, or limited by the deceleration that it takes.
    """
    body = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    x, y, z, tilt_error = tilt_and_heading_error(_target(m), body)
    m.thrust_error = tilt_error
    yaw_accel = clip(0.5 * m.ATC_ACCEL_Y_MAX * _CDEG, _YAW_ACCEL_MIN, _YAW_ACCEL_MAX)
    if m.ATC_RAT_YAW_P > 0.0:
        z_max = min(inverse_sqrt_controller(1.0 / m.ATC_RAT_YAW_P, m.ATC_ANG_YAW_P, yaw_accel), _YAW_ERROR_MAX)
        if abs(z) > z_max:  # the target waits for a heading that cannot follow
            limited = clip(wrap_pi(z), -z_max, z_max)
            _set_target(m, _turned(_turned(body, x, y, 0.0), 0.0, 0.0, limited))
            z = limited
    roll_accel = clip(0.5 * m.ATC_ACCEL_R_MAX * _CDEG, _TILT_ACCEL_MIN, _TILT_ACCEL_MAX)
    pitch_accel = clip(0.5 * m.ATC_ACCEL_P_MAX * _CDEG, _TILT_ACCEL_MIN, _TILT_ACCEL_MAX)
    if proportional:
        roll_accel, pitch_accel, yaw_accel = 0.0, 0.0, 0.0
    rx = sqrt_controller(x, m.ATC_ANG_RLL_P, roll_accel, dt)
    ry = sqrt_controller(y, m.ATC_ANG_PIT_P, pitch_accel, dt)
    rz = sqrt_controller(z, m.ATC_ANG_YAW_P, yaw_accel, dt)
    w = m.rate_target
    fx, fy, fz = rotate(multiply(conjugate(body), _target(m)), (float(w[0]), float(w[1]), float(w[2])))
    if tilt_error > 2.0 * _THRUST_ERROR:
        rz = float(m.gyro[2])
    elif tilt_error > _THRUST_ERROR:
        share = 1.0 - (tilt_error - _THRUST_ERROR) / _THRUST_ERROR
        rx += fx * share
        ry += fy * share
        rz = m.gyro[2] * (1.0 - share) + (rz + fz) * share
    else:
        rx, ry, rz = rx + fx, ry + fy, rz + fz
    m.rate_wanted[0] = rx
    m.rate_wanted[1] = ry
    m.rate_wanted[2] = rz


@kernel
def run_rates(m: Any, dt: float) -> None:
    """Runs the rate PIDs: computes m.torque (roll, pitch, yaw; -1 to 1) from m.rate_wanted and m.gyro [rad/s]."""
    m.torque[0] = pid(
        m.rate_pid[0],
        m.rate_wanted[0],
        m.gyro[0],
        m.ATC_RAT_RLL_P,
        m.ATC_RAT_RLL_I,
        m.ATC_RAT_RLL_D,
        m.ATC_RAT_RLL_IMAX,
        lowpass_alpha(dt, m.ATC_RAT_RLL_FLTT),
        lowpass_alpha(dt, m.ATC_RAT_RLL_FLTE),
        lowpass_alpha(dt, m.ATC_RAT_RLL_FLTD),
        dt,
        m.limit_roll_pitch,
        m.ATC_RAT_RLL_FF,
        m.ATC_RAT_RLL_PDMX,
    )
    m.torque[1] = pid(
        m.rate_pid[1],
        m.rate_wanted[1],
        m.gyro[1],
        m.ATC_RAT_PIT_P,
        m.ATC_RAT_PIT_I,
        m.ATC_RAT_PIT_D,
        m.ATC_RAT_PIT_IMAX,
        lowpass_alpha(dt, m.ATC_RAT_PIT_FLTT),
        lowpass_alpha(dt, m.ATC_RAT_PIT_FLTE),
        lowpass_alpha(dt, m.ATC_RAT_PIT_FLTD),
        dt,
        m.limit_roll_pitch,
        m.ATC_RAT_PIT_FF,
        m.ATC_RAT_PIT_PDMX,
    )
    m.torque[2] = pid(
        m.rate_pid[2],
        m.rate_wanted[2],
        m.gyro[2],
        m.ATC_RAT_YAW_P,
        m.ATC_RAT_YAW_I,
        m.ATC_RAT_YAW_D,
        m.ATC_RAT_YAW_IMAX,
        lowpass_alpha(dt, m.ATC_RAT_YAW_FLTT),
        lowpass_alpha(dt, m.ATC_RAT_YAW_FLTE),
        lowpass_alpha(dt, m.ATC_RAT_YAW_FLTD),
        dt,
        m.limit_yaw,
        m.ATC_RAT_YAW_FF,
        m.ATC_RAT_YAW_PDMX,
    )


@kernel
def relax_yaw(m: Any) -> None:
    """Sets the target's heading to the body's and its yaw rate to zero."""
    target = _target(m)
    body = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    turn = 0.5 * (yaw_from_quaternion(body) - yaw_from_quaternion(target))
    _set_target(m, multiply((math.cos(turn), 0.0, 0.0, math.sin(turn)), target))
    m.rate_target[2] = 0.0


@kernel
def relax_attitude(m: Any) -> None:
    """Sets the target to the body's attitude, at rest."""
    for i in range(4):
        m.attitude_target[i] = m.q[i]
    for i in range(3):
        m.rate_target[i] = 0.0


@kernel
def forget_torques(m: Any, gradually: bool, dt: float) -> None:
    """Resets the integrals of the rate PIDs, at once or over some tenths of a second."""
    keep = 1.0 - dt / (dt + _RELAX) if gradually else 0.0
    for i in range(3):
        m.rate_pid[i, INTEGRAL] *= keep
