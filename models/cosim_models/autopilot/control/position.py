"""Position control, from a target to a thrust direction and a throttle, as in ArduCopter's AC_PosControl.

It has three layers, each made of kernels over the autopilot's record `m`: `initialise_*` (take the current motion as
desired), `seek_*` (shape the desired motion towards a target, jerk-limited) and `control_*` (make the vehicle follow
the desired motion: position P, velocity PID, and vertically an acceleration PID). Vectors are north, east, UP in m,
m/s, m/s2; the vertical limits are named by direction.

Source: ArduPilot, AC_PosControl (4.6 and 4.7-dev).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.pid import ERROR, INTEGRAL, RUNNING, pid, pid_plane
from cosim_models.autopilot.control.shaping import (
    advance_limited,
    advance_limited_ne,
    clip,
    inverse_sqrt_controller,
    kinematic_limit,
    limit_cornering,
    limit_length,
    lowpass_alpha,
    shape_position,
    shape_position_ne,
    shape_velocity,
    shape_velocity_ne,
    sqrt_controller,
)

__all__ = [
    "GRAVITY",
    "control_ne",
    "control_up",
    "initialise_ne",
    "initialise_up",
    "limit_jerks",
    "relax_ne",
    "relax_up",
    "seek_acceleration",
    "seek_position",
    "seek_position_ne",
    "seek_position_up",
    "seek_position_velocity",
    "seek_velocity_ne",
    "seek_velocity_up",
    "set_limits",
    "set_throttle",
    "soften_for_landing",
    "stop_ne",
    "stopping_ne",
]

GRAVITY = 9.80665  # m/s2, ArduPilot's GRAVITY_MSS
_RELAX = 0.16  # s, time constant of POSCONTROL_RELAX_TC
_THROTTLE_FILTER = 2.0  # Hz, on the throttle of the altitude controller
_OVERSPEED_GAIN = 2.0  # on the vertical acceleration limit beyond the speed limit
_ACCEL_DOWN_MAX = 7.5  # m/s2
_THROTTLE_SHARE = 0.8  # of full thrust that may be used for leaning
_LEAN_MIN = math.radians(10.0)
_ALWAYS = 0.85  # m/s2, below any lean limit (ANGLE_MAX and PSC_ANGLE_MAX are at least 5 degrees)
_PER_MILLE = 0.001
_VIBRATION_P, _VIBRATION_I = 0.25, 0.125  # shares of the gains while vibration spoils the estimate
_THROUGHPUT = 0.1  # throttle per (m/s2) and unit of an acceleration gain: gains are per mille per cm/s2


@kernel
def set_limits(m: Any, speed: float, up: float, down: float) -> None:
    """Sets the limits of the desired motion: speeds [m/s, positive]; accelerations and jerks come from parameters."""
    m.speed_max = speed
    m.speed_up = up
    m.speed_down = down
    m.accel_max = 0.01 * m.WPNAV_ACCEL
    m.accel_up = 0.01 * m.WPNAV_ACCEL_Z
    limit_jerks(m)


@kernel
def limit_jerks(m: Any) -> None:
    """Sets the limits of the jerks, given those of the accelerations."""
    # Limit the jerk to the rate at which the attitude controller can turn the thrust.
    turn = math.radians(0.01 * min(m.ATC_ACCEL_R_MAX, m.ATC_ACCEL_P_MAX))
    m.jerk_max = m.PSC_JERK_XY
    if turn > 0.0:
        m.jerk_max = min(m.jerk_max, 0.5 * math.sqrt(m.accel_max * turn * GRAVITY))
    # Limit it also to the bandwidth of the acceleration PID's filters.
    m.jerk_up = m.PSC_JERK_Z
    room = min(GRAVITY, m.accel_up) * 2.0 * math.pi / 5.0
    if m.PSC_ACCZ_FLTT > 0.0:
        m.jerk_up = min(m.jerk_up, room * m.PSC_ACCZ_FLTT)
    if m.PSC_ACCZ_FLTE > 0.0:
        m.jerk_up = min(m.jerk_up, room * m.PSC_ACCZ_FLTE)


# ---- initialise: take the current motion as desired ----------------------------------------------------------------


@kernel
def _leaning_acceleration(m: Any) -> tuple[float, float]:
    """Returns the north and east acceleration of the target attitude at constant height."""
    w, x, y, z = m.attitude_target[0], m.attitude_target[1], m.attitude_target[2], m.attitude_target[3]
    up = max(1.0 - 2.0 * (x * x + y * y), 0.1)
    return -GRAVITY * 2.0 * (x * z + w * y) / up, -GRAVITY * 2.0 * (y * z - w * x) / up


@kernel
def initialise_ne(m: Any) -> None:
    """Sets the desired horizontal motion to the current one, and the integral such that the lean angles stay.

    The measured acceleration is noise, so that none is desired.
    """
    m.desired_position_neu[0] = m.position_neu[0]
    m.desired_position_neu[1] = m.position_neu[1]
    m.desired_velocity_neu[0] = m.velocity_neu[0]
    m.desired_velocity_neu[1] = m.velocity_neu[1]
    m.desired_acceleration_neu[0] = 0.0
    m.desired_acceleration_neu[1] = 0.0
    tn, te = _leaning_acceleration(m)
    m.target_acceleration_neu[0] = tn
    m.target_acceleration_neu[1] = te
    m.velocity_pid[4] = tn
    m.velocity_pid[5] = te
    m.velocity_pid[6] = 0.0
    m.limit_neu[0] = 0.0
    m.limit_neu[1] = 0.0


@kernel
def stopping_ne(m: Any) -> tuple[float, float]:
    """Returns the north and east position at which the vehicle can come to rest."""
    vn, ve = m.velocity_neu[0], m.velocity_neu[1]
    speed = math.sqrt(vn * vn + ve * ve)
    way = inverse_sqrt_controller(speed, m.PSC_POSXY_P, m.accel_max) / speed if speed > 0.0 else 0.0
    return m.position_neu[0] + vn * way, m.position_neu[1] + ve * way


@kernel
def stop_ne(m: Any) -> None:
    """Like `initialise_ne`, but the desired motion is rest at the stopping point."""
    initialise_ne(m)
    m.desired_position_neu[0], m.desired_position_neu[1] = stopping_ne(m)
    for i in range(2):
        m.desired_velocity_neu[i] = 0.0


@kernel
def initialise_up(m: Any) -> None:
    """Sets the desired vertical motion to the current one, and the integral such that the throttle stays."""
    m.desired_position_neu[2] = m.position_neu[2]
    m.desired_velocity_neu[2] = m.velocity_neu[2]
    m.desired_acceleration_neu[2] = clip(m.acceleration_neu[2], -m.accel_up, m.accel_up)
    m.target_acceleration_neu[2] = m.desired_acceleration_neu[2]
    m.climb_pid[RUNNING] = 0.0
    m.climb_pid[INTEGRAL] = 0.0
    m.accel_pid[RUNNING] = 0.0
    m.accel_pid[INTEGRAL] = m.throttle_in - m.throttle_hover
    m.limit_neu[2] = 0.0
    m.terrain_on = False


@kernel
def relax_ne(m: Any, dt: float) -> None:
    """Like `initialise_ne`, but the demanded acceleration decays."""
    initialise_ne(m)
    keep = 1.0 - dt / (dt + _RELAX)
    for i in range(2):
        m.target_acceleration_neu[i] *= keep
        m.velocity_pid[4 + i] = m.target_acceleration_neu[i]


@kernel
def relax_up(m: Any, throttle: float, dt: float) -> None:
    """Like `initialise_up`, but the throttle moves to `throttle`."""
    initialise_up(m)
    soft = m.throttle_in + (throttle - m.throttle_in) * (dt / (dt + _RELAX))
    m.accel_pid[INTEGRAL] = soft - m.throttle_hover


# ---- seek: shape the desired motion --------------------------------------------------------------------------------


@kernel
def _advance_ne(m: Any, dt: float) -> None:
    p, v, a, e = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu, m.position_error_neu
    p[0], p[1], v[0], v[1] = advance_limited_ne(
        p[0],
        p[1],
        v[0],
        v[1],
        a[0],
        a[1],
        dt,
        m.limit_neu[0],
        m.limit_neu[1],
        e[0],
        e[1],
        m.velocity_pid[0],
        m.velocity_pid[1],
    )


@kernel
def _advance_up(m: Any, dt: float) -> None:
    p, v = m.desired_position_neu, m.desired_velocity_neu
    p[2], v[2] = advance_limited(
        p[2], v[2], m.desired_acceleration_neu[2], dt, m.limit_neu[2], m.position_error_neu[2], m.climb_pid[ERROR]
    )


@kernel
def _overspeed(m: Any) -> float:
    """Returns the factor on the vertical limits while the vehicle exceeds the speed limits."""
    v = m.desired_velocity_neu[2]
    if v > m.speed_up and m.speed_up > 0.0:
        return float(_OVERSPEED_GAIN * v / m.speed_up)
    if -v > m.speed_down and m.speed_down > 0.0:
        return float(_OVERSPEED_GAIN * -v / m.speed_down)
    return 1.0


@kernel
def seek_position(m: Any, n: float, e: float, u: float, share: float, dt: float) -> None:
    """Shapes the desired motion straight to the point (n, e, u), all axes within their speed limits.

    `share` is that of the horizontal limit which may be used, 0 to 1.
    """
    gain = _overspeed(m)
    _advance_ne(m, dt)
    _advance_up(m, dt)
    p, v, a = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu
    dn, de, du = n - p[0], e - p[1], u - p[2]
    distance = math.sqrt(dn * dn + de * de + du * du)
    flat_max = 0.0
    up_max = 0.0
    if distance > 0.0:
        dn, de, du = dn / distance, de / distance, du / distance
        fastest = kinematic_limit(dn, de, du, m.speed_max, m.speed_up, m.speed_down)
        flat_max = share * fastest * math.sqrt(dn * dn + de * de)
        up_max = abs(fastest * du)
    a[0], a[1] = shape_position_ne(
        n, e, 0.0, 0.0, 0.0, 0.0, p[0], p[1], v[0], v[1], a[0], a[1], flat_max, m.accel_max, m.jerk_max, dt, False
    )
    accel = m.accel_up * gain
    a[2] = shape_position(
        u, 0.0, 0.0, p[2], v[2], a[2], -up_max, up_max, -min(accel, _ACCEL_DOWN_MAX), accel, m.jerk_up * gain, dt, False
    )


@kernel
def seek_position_ne(m: Any, n: float, e: float, dt: float) -> None:
    """Shapes the desired horizontal motion to (n, e), which may change in every step."""
    _advance_ne(m, dt)
    p, v, a = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu
    a[0], a[1] = shape_position_ne(
        n, e, 0.0, 0.0, 0.0, 0.0, p[0], p[1], v[0], v[1], a[0], a[1], m.speed_max, m.accel_max, m.jerk_max, dt, False
    )


@kernel
def seek_position_up(m: Any, u: float, vu: float, dt: float) -> None:
    """Shapes the desired vertical motion to height u, passed at climb rate vu."""
    gain = _overspeed(m)
    _advance_up(m, dt)
    p, v, a = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu
    accel = m.accel_up * gain
    low = -min(accel, _ACCEL_DOWN_MAX)
    a[2] = shape_position(
        u, vu, 0.0, p[2], v[2], a[2], -m.speed_down, m.speed_up, low, accel, m.jerk_up * gain, dt, False
    )


@kernel
def seek_velocity_ne(m: Any, vn: float, ve: float, an: float, ae: float, dt: float) -> None:
    """Shapes the desired horizontal velocity to (vn, ve), with (an, ae) added to the acceleration."""
    _advance_ne(m, dt)
    v, a = m.desired_velocity_neu, m.desired_acceleration_neu
    a[0], a[1] = shape_velocity_ne(vn, ve, an, ae, v[0], v[1], a[0], a[1], m.accel_max, m.jerk_max, dt, False)


@kernel
def seek_velocity_up(m: Any, vu: float, au: float, landing: bool, dt: float) -> None:
    """Shapes the desired climb rate to vu; if `landing`, the desired height falls even if the throttle cannot."""
    if landing:
        m.limit_neu[2] = max(m.limit_neu[2], 0.0)
    gain = _overspeed(m)
    _advance_up(m, dt)
    accel = m.accel_up * gain
    m.desired_acceleration_neu[2] = shape_velocity(
        vu,
        au,
        m.desired_velocity_neu[2],
        m.desired_acceleration_neu[2],
        -min(accel, _ACCEL_DOWN_MAX),
        accel,
        m.jerk_up * gain,
        dt,
        False,
    )


@kernel
def seek_position_velocity(m: Any, p_to: Any, v_to: Any, a_to: Any, dt: float) -> None:
    """Shapes the motion onto a moving point (position, velocity, acceleration: float64[3]), which it advances by dt."""
    gain = _overspeed(m)
    _advance_ne(m, dt)
    _advance_up(m, dt)
    p, v, a = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu
    a[0], a[1] = shape_position_ne(
        p_to[0],
        p_to[1],
        v_to[0],
        v_to[1],
        a_to[0],
        a_to[1],
        p[0],
        p[1],
        v[0],
        v[1],
        a[0],
        a[1],
        m.speed_max,
        m.accel_max,
        m.jerk_max,
        dt,
        False,
    )
    accel = m.accel_up * gain
    a[2] = shape_position(
        p_to[2],
        v_to[2],
        a_to[2],
        p[2],
        v[2],
        a[2],
        -m.speed_down,
        m.speed_up,
        -min(accel, _ACCEL_DOWN_MAX),
        accel,
        m.jerk_up * gain,
        dt,
        False,
    )
    for i in range(3):
        p_to[i] += v_to[i] * dt + 0.5 * a_to[i] * dt * dt
        v_to[i] += a_to[i] * dt


@kernel
def seek_acceleration(m: Any, an: float, ae: float, au: float, dt: float) -> None:
    """Shapes the desired acceleration to (an, ae, au), jerk-limited; velocity and position follow."""
    _advance_ne(m, dt)
    _advance_up(m, dt)
    a = m.desired_acceleration_neu
    jn, je = limit_length(an - a[0], ae - a[1], m.jerk_max * dt)
    a[0] += jn
    a[1] += je
    a[2] += clip(au - a[2], -m.jerk_up * dt, m.jerk_up * dt)


@kernel
def soften_for_landing(m: Any, dt: float) -> None:
    """Reduces the horizontal position error and stops the integral from growing while the feet may touch the ground."""
    for i in range(2):
        m.desired_position_neu[i] += (m.position_neu[i] - m.desired_position_neu[i]) * (dt / (dt + _RELAX))
        m.limit_neu[i] = m.target_acceleration_neu[i]


# ---- control: make the vehicle follow the desired motion ------------------------------------------------------------


@kernel
def control_ne(m: Any, dt: float) -> None:
    """Computes the demanded horizontal acceleration m.target_acceleration_neu[0:2], within the permitted lean angle."""
    p, e = m.desired_position_neu, m.position_error_neu
    farthest = inverse_sqrt_controller(m.speed_max, m.PSC_POSXY_P, m.accel_max)
    e[0], e[1] = limit_length(p[0] - m.position_neu[0], p[1] - m.position_neu[1], farthest)
    p[0] = m.position_neu[0] + e[0]
    p[1] = m.position_neu[1] + e[1]
    distance = math.sqrt(e[0] * e[0] + e[1] * e[1])
    share = sqrt_controller(distance, m.PSC_POSXY_P, m.accel_max, 0.0) / distance if distance > 0.0 else 0.0
    m.target_velocity_neu[0] = e[0] * share + m.desired_velocity_neu[0]
    m.target_velocity_neu[1] = e[1] * share + m.desired_velocity_neu[1]
    an, ae = pid_plane(
        m.velocity_pid,
        m.target_velocity_neu[0],
        m.target_velocity_neu[1],
        m.velocity_neu[0],
        m.velocity_neu[1],
        m.PSC_VELXY_P,
        m.PSC_VELXY_I,
        m.PSC_VELXY_D,
        0.01 * m.PSC_VELXY_IMAX,
        lowpass_alpha(dt, m.PSC_VELXY_FLTE),
        lowpass_alpha(dt, m.PSC_VELXY_FLTD),
        dt,
        m.limit_neu[0],
        m.limit_neu[1],
        m.PSC_VELXY_FF,
    )
    an += m.desired_acceleration_neu[0]
    ae += m.desired_acceleration_neu[1]
    m.limit_neu[0] = 0.0
    m.limit_neu[1] = 0.0
    size = an * an + ae * ae
    if size > _ALWAYS * _ALWAYS:
        most = m.PSC_ANGLE_MAX if m.PSC_ANGLE_MAX > 0.0 else 0.01 * m.ANGLE_MAX
        lean = min(max(m.lean_max, _LEAN_MIN), math.radians(most))
        largest = GRAVITY * math.tan(lean)
        if size > largest * largest:
            m.limit_neu[0] = an
            m.limit_neu[1] = ae
            an, ae = limit_cornering(m.desired_velocity_neu[0], m.desired_velocity_neu[1], an, ae, largest)
    m.target_acceleration_neu[0] = an
    m.target_acceleration_neu[1] = ae
    _head_along_path(m)


@kernel
def _head_along_path(m: Any) -> None:
    """Sets heading and yaw rate along the desired path; holds them below 5 % of the speed limit.

    ArduCopter takes the Euler yaw of its attitude target then, which wanders while the vehicle leans to two sides: in
    2.4 s by 25 degrees with a weak motor, elsewhere by less than the noise of its heading. Ours does while a motor or
    sensor fails.
    """
    vn, ve = m.desired_velocity_neu[0], m.desired_velocity_neu[1]
    speed = math.sqrt(vn * vn + ve * ve)
    m.path_turn_rate = 0.0
    if speed > 0.05 * m.speed_max:
        an, ae = m.desired_acceleration_neu[0], m.desired_acceleration_neu[1]
        m.path_heading = math.atan2(ve, vn)
        m.path_turn_rate = (ae * vn - an * ve) / (speed * speed)
    elif m.sim_on:
        q = m.attitude_target
        m.path_heading = math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


@kernel
def _lift(m: Any, dt: float) -> float:
    """Returns the throttle beyond that of hover for m.target_acceleration_neu[2]."""
    limited = m.limit_throttle_lower or m.limit_throttle_upper
    s = m.accel_pid
    if m.vibration_failsafe:  # without the accelerometer
        each = m.throttle_hover / GRAVITY
        if not limited or s[INTEGRAL] * m.climb_pid[ERROR] < 0.0:
            s[INTEGRAL] += dt * each * m.climb_pid[ERROR] * m.PSC_VELZ_P * _VIBRATION_I
        return float(_VIBRATION_P * each * m.target_acceleration_neu[2] + s[INTEGRAL])
    return float(
        pid(
            s,
            m.target_acceleration_neu[2],
            m.acceleration_neu[2],
            m.PSC_ACCZ_P * _THROUGHPUT,
            m.PSC_ACCZ_I * _THROUGHPUT,
            m.PSC_ACCZ_D * _THROUGHPUT,
            max(0.001 * m.PSC_ACCZ_IMAX, m.throttle_hover),
            lowpass_alpha(dt, m.PSC_ACCZ_FLTT),
            lowpass_alpha(dt, m.PSC_ACCZ_FLTE),
            lowpass_alpha(dt, m.PSC_ACCZ_FLTD),
            dt,
            limited,
            m.PSC_ACCZ_FF * _THROUGHPUT,
            m.PSC_ACCZ_PDMX * _PER_MILLE,
        )
    )


@kernel
def control_up(m: Any, dt: float) -> None:
    """Sets the throttle that follows the desired vertical motion."""
    p = m.desired_position_neu
    highest = inverse_sqrt_controller(m.speed_up, m.PSC_POSZ_P, m.accel_up)
    lowest = inverse_sqrt_controller(m.speed_down, m.PSC_POSZ_P, m.accel_up)
    error = clip(p[2] - m.position_neu[2], -lowest, highest)
    p[2] = m.position_neu[2] + error
    m.position_error_neu[2] = error
    m.target_velocity_neu[2] = sqrt_controller(error, m.PSC_POSZ_P, m.accel_up, 0.0) + m.desired_velocity_neu[2]
    s = m.climb_pid
    climb_error = m.target_velocity_neu[2] - m.velocity_neu[2]
    held = (m.limit_throttle_lower and climb_error < 0.0) or (m.limit_throttle_upper and climb_error > 0.0)
    m.target_acceleration_neu[2] = m.desired_acceleration_neu[2] + pid(
        s,
        m.target_velocity_neu[2],
        m.velocity_neu[2],
        m.PSC_VELZ_P,
        m.PSC_VELZ_I,
        m.PSC_VELZ_D,
        0.01 * m.PSC_VELZ_IMAX,
        1.0,
        lowpass_alpha(dt, m.PSC_VELZ_FLTE),
        lowpass_alpha(dt, m.PSC_VELZ_FLTD),
        dt,
        held,
        m.PSC_VELZ_FF,
        0.0,
    )
    set_throttle(m, m.throttle_hover + _lift(m, dt), True, _THROTTLE_FILTER, dt)
    m.limit_neu[2] = 1.0 if m.limit_throttle_upper else -1.0 if m.limit_throttle_lower else 0.0


@kernel
def set_throttle(m: Any, throttle: float, boost: bool, cutoff: float, dt: float) -> None:
    """Passes a throttle (0 to 1) to the motors: raised when leaning if `boost`, low-pass filtered at `cutoff` [Hz]."""
    m.throttle_in = throttle
    if m.thrust_max > 0.0:
        lean = math.acos(clip(throttle / (_THROTTLE_SHARE * m.thrust_max), 0.0, 1.0))
        m.lean_max += (dt / (dt + m.ATC_ANG_LIM_TC)) * (lean - m.lean_max)
    else:
        m.lean_max = 0.0
    boosted = throttle
    if boost and m.ATC_ANGLE_BOOST > 0:
        upright = 1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2])  # cosine of the lean
        boosted = throttle * clip(10.0 * upright, 0.0, 1.0) / clip(upright, 0.1, 1.0)
    m.throttle_command = boosted
    m.throttle_cutoff = cutoff
    average = clip(max(boosted, throttle), 0.0, 1.0)
    m.throttle_average_max = max(average, average * max(0.0, 1.0 - m.throttle_mix) + m.throttle_hover * m.throttle_mix)
