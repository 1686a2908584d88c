"""Kinematic shaping: jerk-limited motion towards a target, as planned by ArduCopter.

Every law is a pure function of numbers in SI units that returns the next acceleration (one axis, or a pair for the
horizontal plane); the caller integrates. The laws are independent of vehicles, modes and estimates.

Sources: ArduPilot's AP_Math/control (square-root controller, acceleration and jerk limits). The brake constants,
half the gain and half the acceleration, are those of ArduCopter 4.6 and 4.7-dev (2025): they reproduce the recorded
desired paths of that flight stack within 3 mm (tests/models/autopilot/test_shaping.py).
"""

from __future__ import annotations

import math

from cosim.kernel import kernel

__all__ = [
    "advance_limited",
    "advance_limited_ne",
    "clip",
    "inverse_sqrt_controller",
    "kinematic_limit",
    "limit_cornering",
    "limit_length",
    "lowpass_alpha",
    "shape_position",
    "shape_position_ne",
    "shape_velocity",
    "shape_velocity_ne",
    "sqrt_controller",
    "wrap_pi",
]

Pair = tuple[float, float]

_CORNER_SHARE = math.sqrt(0.5)
BRAKE_SHARE = 0.5
"""Fraction of the acceleration and jerk limits with which the position shaper plans to brake."""


@kernel
def clip(value: float, low: float, high: float) -> float:
    """Limits `value` to [low, high]."""
    return low if value < low else high if value > high else value


@kernel
def wrap_pi(angle: float) -> float:
    """Wraps the angle [rad] to (-pi, pi]."""
    if angle > math.pi or angle <= -math.pi:
        angle = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
        if angle == -math.pi:
            angle = math.pi
    return angle


@kernel
def lowpass_alpha(dt: float, cutoff: float) -> float:
    """Returns the weight of a new sample in a first-order low-pass of `cutoff` [Hz]; 1 (no filter) if that is 0."""
    if cutoff <= 0.0:
        return 1.0
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff))


@kernel
def limit_length(x: float, y: float, longest: float) -> Pair:
    """Returns the vector (x, y), shortened to length `longest` if it is longer."""
    length = math.sqrt(x * x + y * y)
    if length > longest and length > 0.0:
        return x * (longest / length), y * (longest / length)
    return x, y


@kernel
def sqrt_controller(error: float, p: float, second_derivative_max: float, dt: float) -> float:
    """Returns the rate that brings `error` to zero: linear with gain `p` [1/s] near zero, a square root beyond.

    In the square-root part, the rate falls by `second_derivative_max` per second, so the target is approached with that
    deceleration. With dt > 0, the rate never overshoots the error within one step. A limit of 0 means no limit.
    """
    if second_derivative_max <= 0.0:
        rate = error * p
    elif p == 0.0:
        rate = math.copysign(math.sqrt(2.0 * second_derivative_max * abs(error)), error)
    else:
        linear = second_derivative_max / (p * p)
        if error > linear:
            rate = math.sqrt(2.0 * second_derivative_max * (error - 0.5 * linear))
        elif error < -linear:
            rate = -math.sqrt(2.0 * second_derivative_max * (-error - 0.5 * linear))
        else:
            rate = error * p
    if dt > 0.0:
        limit = abs(error) / dt
        rate = clip(rate, -limit, limit)
    return rate


@kernel
def inverse_sqrt_controller(rate: float, p: float, second_derivative_max: float) -> float:
    """Returns the error for which `sqrt_controller` (without dt) returns `rate`, also the stopping distance."""
    if second_derivative_max <= 0.0:
        return 0.0 if p == 0.0 else rate / p
    if p == 0.0:
        return math.copysign(rate * rate / (2.0 * second_derivative_max), rate)
    if abs(rate) < second_derivative_max / p:
        return rate / p
    distance = 0.5 * second_derivative_max / (p * p) + rate * rate / (2.0 * second_derivative_max)
    return math.copysign(distance, rate)


@kernel
def limit_cornering(
    vn: float,
    ve: float,
    an: float,
    ae: float,
    acceleration_max: float,
) -> Pair:
    """Limits an acceleration in length: first across the direction of travel (vn, ve), then along it."""
    if an * an + ae * ae <= acceleration_max * acceleration_max:
        return an, ae
    speed = math.sqrt(vn * vn + ve * ve)
    if speed == 0.0:
        return limit_length(an, ae, acceleration_max)
    un = vn / speed
    ue = ve / speed
    along = an * un + ae * ue
    cn = an - un * along
    ce = ae - ue * along
    across = math.sqrt(cn * cn + ce * ce)
    if across >= acceleration_max:
        return cn * (acceleration_max / across), ce * (acceleration_max / across)
    room = math.sqrt(acceleration_max * acceleration_max - across * across)
    along = clip(along, -room, room)
    return cn + un * along, ce + ue * along


@kernel
def _limit_correction(un: float, ue: float, an: float, ae: float, acceleration_max: float) -> Pair:
    """Limits a correction in length, with 1/sqrt(2) reserved for the part across the target velocity (un, ue)."""
    speed = math.sqrt(un * un + ue * ue)
    if speed == 0.0:
        return limit_length(an, ae, acceleration_max)
    un /= speed
    ue /= speed
    along = an * un + ae * ue
    cn = an - un * along
    ce = ae - ue * along
    if along * along <= cn * cn + ce * ce:
        return limit_length(an, ae, acceleration_max)
    cn, ce = limit_length(cn, ce, _CORNER_SHARE * acceleration_max)
    room = math.sqrt(max(acceleration_max * acceleration_max - cn * cn - ce * ce, 0.0))
    along = clip(along, -room, room)
    return cn + un * along, ce + ue * along


@kernel
def kinematic_limit(
    dn: float,
    de: float,
    du: float,
    horizontal: float,
    up: float,
    down: float,
) -> float:
    """Returns the largest speed along the unit vector (dn, de, du; u is up) that keeps every axis within its limit.

    `horizontal`, `up` and `down` are positive; the length of the vector need not be exactly one.
    """
    flat = math.sqrt(dn * dn + de * de)
    vertical = up if du > 0.0 else down
    if horizontal <= 0.0 or vertical <= 0.0:
        return 0.0
    if flat == 0.0:
        return 0.0 if du == 0.0 else vertical / abs(du)
    if abs(du) == 0.0:
        return horizontal / flat
    return min(horizontal / flat, vertical / abs(du))


@kernel
def shape_velocity(
    v_target: float,
    a_feedforward: float,
    v: float,
    a: float,
    a_min: float,
    a_max: float,
    jerk_max: float,
    dt: float,
    limit_total: bool,
) -> float:
    """Returns the next acceleration from speed `v` towards `v_target`, with a_min <= a <= a_max and limited jerk.

    a_min < 0 < a_max. `a_feedforward` is added to the correction; `limit_total` limits the sum again.
    """
    error = v_target - v
    gain = jerk_max / a_max if error > 0.0 else jerk_max / -a_min
    wanted = clip(sqrt_controller(error, gain, jerk_max, dt), a_min, a_max) + a_feedforward
    if limit_total:
        wanted = clip(wanted, a_min, a_max)
    return a + clip(wanted - a, -jerk_max * dt, jerk_max * dt)


@kernel
def shape_velocity_ne(
    vn_target: float,
    ve_target: float,
    an_ff: float,
    ae_ff: float,
    vn: float,
    ve: float,
    an: float,
    ae: float,
    a_max: float,
    jerk_max: float,
    dt: float,
    limit_total: bool,
) -> Pair:
    """Like `shape_velocity`, in the horizontal plane, with limits on the lengths of acceleration and jerk."""
    dn = vn_target - vn
    de = ve_target - ve
    error = math.sqrt(dn * dn + de * de)
    wn = 0.0
    we = 0.0
    if error > 0.0:
        scale = sqrt_controller(error, jerk_max / a_max, jerk_max, dt) / error
        wn, we = _limit_correction(vn_target, ve_target, dn * scale, de * scale, a_max)
    wn += an_ff
    we += ae_ff
    if limit_total:
        wn, we = limit_length(wn, we, a_max)
    jn, je = limit_length(wn - an, we - ae, jerk_max * dt)
    return an + jn, ae + je


@kernel
def shape_position(
    p_target: float,
    v_feedforward: float,
    a_feedforward: float,
    p: float,
    v: float,
    a: float,
    v_min: float,
    v_max: float,
    a_min: float,
    a_max: float,
    jerk_max: float,
    dt: float,
    limit_total: bool,
) -> float:
    """Returns the next acceleration from position `p` towards `p_target`, within speed, acceleration and jerk limits.

    v_min <= 0 <= v_max; both zero mean no limit. `v_feedforward` is the target's own speed.
    """
    error = p_target - p
    braking = -a_min if error > 0.0 else a_max
    wanted = sqrt_controller(error, BRAKE_SHARE * jerk_max / braking, BRAKE_SHARE * braking, dt)
    if v_min < 0.0:
        wanted = max(wanted, v_min)
    if v_max > 0.0:
        wanted = min(wanted, v_max)
    wanted += v_feedforward
    if limit_total:
        if v_min < 0.0:
            wanted = max(wanted, v_min)
        if v_max > 0.0:
            wanted = min(wanted, v_max)
    return shape_velocity(wanted, a_feedforward, v, a, a_min, a_max, jerk_max, dt, limit_total)


@kernel
def shape_position_ne(
    pn_target: float,
    pe_target: float,
    vn_ff: float,
    ve_ff: float,
    an_ff: float,
    ae_ff: float,
    pn: float,
    pe: float,
    vn: float,
    ve: float,
    an: float,
    ae: float,
    v_max: float,
    a_max: float,
    jerk_max: float,
    dt: float,
    limit_total: bool,
) -> Pair:
    """Like `shape_position`, in the horizontal plane, straight towards the target; limits are lengths. v_max 0: no
    limit.
    """
    dn = pn_target - pn
    de = pe_target - pe
    error = math.sqrt(dn * dn + de * de)
    wn = 0.0
    we = 0.0
    if error > 0.0:
        speed = sqrt_controller(error, BRAKE_SHARE * jerk_max / a_max, BRAKE_SHARE * a_max, dt)
        if v_max > 0.0:
            speed = min(speed, v_max)
        wn = dn * (speed / error)
        we = de * (speed / error)
    wn += vn_ff
    we += ve_ff
    if limit_total and v_max > 0.0:
        wn, we = limit_length(wn, we, v_max)
    return shape_velocity_ne(wn, we, an_ff, ae_ff, vn, ve, an, ae, a_max, jerk_max, dt, limit_total)


@kernel
def advance_limited(
    p: float,
    v: float,
    a: float,
    dt: float,
    limit: float,
    p_error: float,
    v_error: float,
) -> Pair:
    """Returns position and speed one step later; motion in a saturated direction that would enlarge an error is
    dropped.

    `limit` is the direction (sign) of actuator saturation, 0 for none.
    """
    move = v * dt + 0.5 * a * dt * dt
    if move * limit > 0.0 and p_error * limit > 0.0:
        move = 0.0
    gain = a * dt
    if gain * limit > 0.0 and v_error * limit > 0.0:
        gain = clip(gain, -abs(v), abs(v)) if v * limit < 0.0 else 0.0
    return p + move, v + gain


@kernel
def advance_limited_ne(
    pn: float,
    pe: float,
    vn: float,
    ve: float,
    an: float,
    ae: float,
    dt: float,
    ln: float,
    le: float,
    pn_error: float,
    pe_error: float,
    vn_error: float,
    ve_error: float,
) -> tuple[float, float, float, float]:
    """Like `advance_limited`, in the horizontal plane; (ln, le) points in the saturated direction."""
    mn = vn * dt + 0.5 * an * dt * dt
    me = ve * dt + 0.5 * ae * dt * dt
    gn = an * dt
    ge = ae * dt
    if ln != 0.0 or le != 0.0:
        if mn * ln + me * le > 0.0 and pn_error * ln + pe_error * le > 0.0:
            mn = 0.0
            me = 0.0
        if gn * ln + ge * le > 0.0 and vn_error * ln + ve_error * le > 0.0 and vn * ln + ve * le >= 0.0:
            gn = 0.0
            ge = 0.0
    return pn + mn, pe + me, vn + gn, ve + ge
