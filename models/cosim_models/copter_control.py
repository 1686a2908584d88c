"""The control cascade of a multirotor as ArduCopter has it: position to motor commands, as kernels over the record.

    desired path (jerk-limited) -> position P -> velocity PID -> lean angles and throttle
    -> attitude (square-root controller, feed-forward) -> rate PIDs -> mixer -> thrust linearisation -> motors

Which path is desired is decided in `copter_modes`. All states are those of the record `m` of `Autopilot`; positions
and velocities NED in m and m/s, angles in rad. Parameters have ArduPilot's names and units.

Sources: ArduPilot's AC_PosControl, AC_AttitudeControl, AC_PID, AP_MotorsMatrix (behaviour and default values).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import conjugate, euler_from_quaternion, multiply, normalize, quaternion_from_euler, rotate
from cosim.kernel import kernel

from cosim_models.copter_mixer import mix
from cosim_models.shaping import clip, limit_length, lowpass_alpha, sqrt_controller, wrap_pi

__all__ = ["GRAVITY", "attitude_and_motors", "hold_here", "horizontal", "relax", "vertical"]

GRAVITY = 9.80665
_YAW_SLEW = math.radians(60.0)  # ATC_SLEW_YAW


@kernel
def relax(m: Any) -> None:
    """Forget what the controllers have accumulated, as on the ground: zero throttle, no integrals."""
    for i in range(3):
        m.velocity_i[i] = 0.0
        m.velocity_error[i] = 0.0
        m.velocity_d[i] = 0.0
        m.rate_i[i] = 0.0
    m.throttle_i = -m.hover
    m.acceleration_error = 0.0
    m.lean_n = 0.0
    m.lean_e = 0.0


@kernel
def hold_here(m: Any) -> None:
    """The desired path starts from where the vehicle is, as it moves."""
    for i in range(3):
        m.desired_position[i] = m.position[i]
        m.desired_velocity[i] = m.velocity[i]
        m.desired_acceleration[i] = 0.0


@kernel
def horizontal(m: Any, h: float) -> None:
    """Position and velocity loops in the plane: an acceleration, limited to the largest lean, into lean_n, lean_e."""
    acceleration_max = m.WPNAV_ACCEL * 0.01
    en = m.desired_position[0] - m.position[0]
    ee = m.desired_position[1] - m.position[1]
    error = math.sqrt(en * en + ee * ee)
    scale = 0.0
    if error > 0.0:
        scale = sqrt_controller(error, m.PSC_POSXY_P, acceleration_max, 0.0) / error
    wn = m.desired_velocity[0] + en * scale - m.velocity[0]
    we = m.desired_velocity[1] + ee * scale - m.velocity[1]
    weight = lowpass_alpha(h, m.PSC_VELXY_FLTE)
    weight_d = lowpass_alpha(h, m.PSC_VELXY_FLTD)
    saturated = m.lean_limited
    for i in range(2):
        raw = wn if i == 0 else we
        before = m.velocity_error[i]
        m.velocity_error[i] = before + weight * (raw - before)
        slope = (m.velocity_error[i] - before) / h
        m.velocity_d[i] += weight_d * (slope - m.velocity_d[i])
        grown = m.velocity_i[i] + m.PSC_VELXY_I * m.velocity_error[i] * h
        if not saturated or abs(grown) < abs(m.velocity_i[i]):
            m.velocity_i[i] = grown
    m.velocity_i[0], m.velocity_i[1] = limit_length(m.velocity_i[0], m.velocity_i[1], m.PSC_VELXY_IMAX * 0.01)
    an = (
        m.desired_acceleration[0]
        + m.PSC_VELXY_P * m.velocity_error[0]
        + m.velocity_i[0]
        + m.PSC_VELXY_D * m.velocity_d[0]
    )
    ae = (
        m.desired_acceleration[1]
        + m.PSC_VELXY_P * m.velocity_error[1]
        + m.velocity_i[1]
        + m.PSC_VELXY_D * m.velocity_d[1]
    )
    largest = GRAVITY * math.tan(m.ANGLE_MAX * 0.01 * math.pi / 180.0)
    m.lean_limited = an * an + ae * ae > largest * largest
    m.lean_n, m.lean_e = limit_length(an, ae, largest)


@kernel
def vertical(m: Any, h: float) -> None:
    """Height, climb rate and acceleration loops: throttle (0 to 1, of thrust) before tilt compensation."""
    error = m.desired_position[2] - m.position[2]
    wanted = m.desired_velocity[2] + sqrt_controller(error, m.PSC_POSZ_P, m.WPNAV_ACCEL_Z * 0.01, 0.0)
    wanted_acceleration = m.desired_acceleration[2] + m.PSC_VELZ_P * (wanted - m.velocity[2])
    q = (m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3])
    _, _, force = rotate(q, (m.specific_force[0], m.specific_force[1], m.specific_force[2]))
    raw = wanted_acceleration - (force + GRAVITY)
    m.acceleration_error += lowpass_alpha(h, m.PSC_ACCZ_FLTE) * (raw - m.acceleration_error)
    # ArduPilot's gains give per mille of throttle per cm/s2, for an acceleration upwards.
    p = -0.1 * m.PSC_ACCZ_P * m.acceleration_error
    step = -0.1 * m.PSC_ACCZ_I * m.acceleration_error * h
    if not (step > 0.0 and m.throttle_upper) and not (step < 0.0 and m.throttle_lower):
        limit = m.PSC_ACCZ_IMAX * 0.001
        m.throttle_i = clip(m.throttle_i + step, -limit, limit)
    m.throttle = clip(m.hover + p + m.throttle_i, 0.0, 1.0)


@kernel
def _learn_hover(m: Any, h: float) -> None:
    """MOT_HOVER_LEARN: the average throttle of level, steady flight (time constant 10 s)."""
    steady = abs(m.velocity[2]) < 0.6 and abs(m.lean_n) < 1.0 and abs(m.lean_e) < 1.0
    if m.MOT_HOVER_LEARN > 0 and not m.on_ground and m.throttle > 0.0 and steady:
        learned = m.hover + h / (h + 10.0) * (m.throttle - m.hover)
        m.throttle_i -= learned - m.hover  # what moves into the feed-forward leaves the integral
        m.hover = clip(learned, 0.125, 0.6875)


@kernel
def _wanted_attitude(m: Any, h: float) -> tuple[float, float, float, float]:
    """The attitude that gives the wanted acceleration at the wanted heading, which turns at a limited rate."""
    turn = clip(wrap_pi(m.wanted_yaw - m.yaw_target), -_YAW_SLEW * h, _YAW_SLEW * h)
    m.yaw_target = wrap_pi(m.yaw_target + turn)
    sin_yaw, cos_yaw = math.sin(m.yaw_target), math.cos(m.yaw_target)
    forward = m.lean_n * cos_yaw + m.lean_e * sin_yaw
    right = -m.lean_n * sin_yaw + m.lean_e * cos_yaw
    pitch = math.atan(-forward / GRAVITY)
    roll = math.atan(right * math.cos(pitch) / GRAVITY)
    return quaternion_from_euler(roll, pitch, m.yaw_target)


@kernel
def _rotation_vector(q: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Axis times angle of a unit quaternion, the short way round."""
    w, x, y, z = q
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    s = math.sqrt(x * x + y * y + z * z)
    if s < 1e-9:
        return 2.0 * x, 2.0 * y, 2.0 * z
    angle = 2.0 * math.atan2(s, w) / s
    return x * angle, y * angle, z * angle


@kernel
def _shape_attitude(m: Any, wanted: tuple[float, float, float, float], h: float) -> None:
    """The target attitude follows the wanted one with limited acceleration (ATC_INPUT_TC)."""
    q = (m.attitude_target[0], m.attitude_target[1], m.attitude_target[2], m.attitude_target[3])
    ex, ey, ez = _rotation_vector(multiply(conjugate(q), wanted))
    for i in range(3):
        e = ex if i == 0 else ey if i == 1 else ez
        largest = _acceleration_max(m, i)
        rate = sqrt_controller(e, 1.0 / m.ATC_INPUT_TC, largest, h)
        m.rate_target[i] += clip(rate - m.rate_target[i], -largest * h, largest * h)
    turned = _turned(q, m.rate_target[0] * h, m.rate_target[1] * h, m.rate_target[2] * h)
    for i in range(4):
        m.attitude_target[i] = turned[i]


@kernel
def _turned(q: tuple[float, float, float, float], x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """`q` turned by a rotation vector in its own frame."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return normalize(multiply(q, (math.cos(0.5 * angle), x * s, y * s, z * s)))


@kernel
def _acceleration_max(m: Any, axis: int) -> float:
    cdeg = m.ATC_ACCEL_R_MAX if axis == 0 else m.ATC_ACCEL_P_MAX if axis == 1 else m.ATC_ACCEL_Y_MAX
    return float(cdeg * 0.01 * math.pi / 180.0)


@kernel
def _rates(m: Any, h: float, roll: float, pitch: float, yaw: float) -> tuple[float, float, float]:
    """Rate PIDs of the three axes on filtered targets; integrals stop where the mixer is saturated."""
    result = (0.0, 0.0, 0.0)
    for i in range(3):
        p = m.ATC_RAT_RLL_P if i == 0 else m.ATC_RAT_PIT_P if i == 1 else m.ATC_RAT_YAW_P
        gain_i = m.ATC_RAT_RLL_I if i == 0 else m.ATC_RAT_PIT_I if i == 1 else m.ATC_RAT_YAW_I
        d = m.ATC_RAT_RLL_D if i == 0 else m.ATC_RAT_PIT_D if i == 1 else m.ATC_RAT_YAW_D
        wanted = roll if i == 0 else pitch if i == 1 else yaw
        m.rate_filtered[i] += lowpass_alpha(h, 20.0) * (wanted - m.rate_filtered[i])
        raw = m.rate_filtered[i] - m.angular_velocity[i]
        error = raw
        if i == 2:
            m.yaw_error += lowpass_alpha(h, m.ATC_RAT_YAW_FLTE) * (raw - m.yaw_error)
            error = m.yaw_error
        m.rate_d[i] += lowpass_alpha(h, 20.0) * ((error - m.rate_error[i]) / h - m.rate_d[i])
        m.rate_error[i] = error
        grown = clip(m.rate_i[i] + gain_i * error * h, -0.5, 0.5)
        if m.mixer_limited[i] == 0 or abs(grown) < abs(m.rate_i[i]):
            m.rate_i[i] = grown
        out = clip(p * error + m.rate_i[i] + d * m.rate_d[i], -1.0, 1.0)
        result = (out if i == 0 else result[0], out if i == 1 else result[1], out if i == 2 else result[2])
    return result


@kernel
def _spool(m: Any, h: float, fly: bool) -> None:
    """Motors start to idle ARMING_DELAY after arming, and open up within MOT_SPOOL_TIME once there is cause to fly."""
    m.armed_for += h
    rate = h / max(m.MOT_SPOOL_TIME, h)
    if m.armed_for < m.ARMING_DELAY - 1e-9:
        m.idle = 0.0
        m.opened = 0.0
    elif m.idle < 1.0:
        m.idle = min(m.idle + rate, 1.0)
    elif fly:
        m.opened = min(m.opened + rate, 1.0)
    else:
        m.opened = max(m.opened - rate, 0.0)


@kernel
def attitude_and_motors(m: Any, h: float, fly: bool) -> None:
    """From lean and throttle to motor commands; `fly`: more than idling is wanted."""
    for i in range(8):
        m.motor[i] = 0.0
    if not m.armed:
        m.idle, m.opened, m.armed_for = 0.0, 0.0, 0.0
        _rest(m)
        return
    _spool(m, h, fly)
    if m.opened <= 0.0:
        for i in range(m.motors):
            m.motor[i] = m.idle * m.MOT_SPIN_ARM
        _rest(m)
        return
    _learn_hover(m, h)
    _shape_attitude(m, _wanted_attitude(m, h), h)
    q = (m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3])
    target = (m.attitude_target[0], m.attitude_target[1], m.attitude_target[2], m.attitude_target[3])
    difference = multiply(conjugate(q), target)
    ex, ey, ez = _rotation_vector(difference)
    fx, fy, fz = rotate(difference, (m.rate_target[0], m.rate_target[1], m.rate_target[2]))
    roll = fx + sqrt_controller(ex, m.ATC_ANG_RLL_P, 0.5 * _acceleration_max(m, 0), 0.0)
    pitch = fy + sqrt_controller(ey, m.ATC_ANG_PIT_P, 0.5 * _acceleration_max(m, 1), 0.0)
    yaw = fz + sqrt_controller(ez, m.ATC_ANG_YAW_P, 0.5 * _acceleration_max(m, 2), 0.0)
    u_roll, u_pitch, u_yaw = _rates(m, h, roll, pitch, yaw)
    tilt_roll, tilt_pitch, _ = euler_from_quaternion(q)
    cos_tilt = math.cos(tilt_roll) * math.cos(tilt_pitch)
    boosted = clip(10.0 * cos_tilt, 0.0, 1.0) * m.throttle / clip(cos_tilt, 0.1, 1.0)
    mix(m, u_roll, u_pitch, u_yaw, clip(boosted, 0.0, 1.0) * m.opened)


@kernel
def _rest(m: Any) -> None:
    """Not flying: targets are what is, nothing accumulates."""
    for i in range(3):
        m.rate_target[i] = 0.0
        m.rate_filtered[i] = 0.0
        m.rate_i[i] = 0.0
        m.rate_d[i] = 0.0
        m.rate_error[i] = 0.0
        m.mixer_limited[i] = 0
    m.yaw_error = 0.0
    for i in range(4):
        m.attitude_target[i] = m.attitude[i]
    _, _, yaw = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    m.yaw_target = yaw
    m.wanted_yaw = yaw
    m.throttle_upper = False
    m.throttle_lower = True
