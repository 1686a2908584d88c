"""Ways of rovers and boats to their places: targets that move within limits, and the control that follows them.

In GUIDED, the target moves from where the vehicle is to the place, within limits of speed, acceleration and jerk, so
the place may change at any time. In missions, RTL and SMART_RTL, it moves along legs with S-curves; if the place behind
the next one is known, that leg begins before this one has ended, provided that half of the turn is within WP_RADIUS.
Time along the legs goes slower while the vehicle lags behind. The velocity of the target and its distance give the
velocity that is wanted, the error of the velocity and the acceleration of the target the turn rate. Kernels over a
record that has `LEG_PARAMETERS`, `LEG_MEMORY` and what `driving` needs.

Differences from ArduRover: a leg whose speed is changed is planned anew from where its target is.

Source: ArduPilot, AR_WPNav, APM_Control/AR_PosControl (structure, defaults), SCurve (turns).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim_models.autopilot.control.scurve import (
    CLOCK,
    CONSTANT,
    DURATION,
    EARLY,
    EAST,
    LEG,
    LENGTH,
    NORTH,
    RISE,
    SPEED,
    along_leg,
    begin_leg_at,
    clear_leg,
    plan_leg,
)
from cosim_models.autopilot.control.shaping import (
    clip,
    limit_length,
    lowpass_alpha,
    shape_position_ne,
    sqrt_controller,
)
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.surface.driving import cruise, ground_speed, steer, throttle_for

__all__ = ["LEG_MEMORY", "LEG_PARAMETERS", "approach", "drive_legs", "is_new", "set_leg", "start_legs"]

_GRAVITY = 9.80665
_LAST, _THIS, _NEXT = 0, 1, 2
_SNAP = 15.0  # m/s4
_SLACK = 0.05  # of the speed, by which the vehicle may lag
_SLOW = 1.0  # m/s, AR_ATTCONTROL_STEER_SPEED_MIN
_NUDGE = 0.1  # m/s2, lateral acceleration at least, by which a vehicle begins to turn about
_FILTER = 5.0  # Hz, of the velocity error
_IDLE = 0.1  # s after which a target that was not followed begins at the vehicle
_SAME = 0.01  # m

LEG_PARAMETERS = (
    real("WP_ACCEL", "m/s2", 0.0, "acceleration of targets, 0 or more than ATC_ACCEL_MAX: that"),
    real("WP_JERK", "m/s3", 0.0, "jerk of targets, 0: as many m/s3 as the acceleration has m/s2"),
    real("PSC_POS_P", "1/s", 0.2, "speed over position error"),
    real("PSC_VEL_P", "1/s", 1.0, "acceleration over velocity error"),
)
LEG_MEMORY = (
    Memory("legs", shape=(3, LEG), rare=True),  # the last one, this and the next
    Memory("leg_origin", shape=2, rare=True),  # m, north and east
    Memory("leg_destination", shape=2, rare=True),
    Memory("leg_next", shape=2, rare=True),
    Memory("leg_fast", dtype="?", rare=True),  # the destination is passed
    Memory("leg_reached", dtype="?", rare=True),
    Memory("leg_rate", rare=True),  # of time
    Memory("leg_speed", rare=True),  # m/s, of the plan
    Memory("leg_target", shape=(3, 2), rare=True),  # position, velocity and acceleration
    Memory("leg_error", shape=2, rare=True),  # m/s, of the velocity, filtered
    Memory("leg_idle"),  # s since a target was followed
)


@kernel
def _limits(m: Any) -> tuple[float, float]:
    """Returns acceleration [m/s2] and jerk [m/s3] of targets."""
    accel = m.ATC_ACCEL_MAX
    if m.WP_ACCEL > 0.0:
        accel = min(accel, m.WP_ACCEL)
    return float(accel), float(m.WP_JERK if m.WP_JERK > 0.0 else accel)


@kernel
def _lateral(m: Any) -> float:
    """Returns the greatest lateral acceleration [m/s2]."""
    return float(_GRAVITY * m.ATC_TURN_MAX_G)


# ---- the control of the position -----------------------------------------------------------------------------------


@kernel
def _attend(m: Any) -> None:
    """Puts the target to the vehicle, with its velocity, if none was followed lately."""
    if m.leg_idle >= _IDLE:
        for i in range(2):
            m.leg_target[0, i] = m.position[i]
            m.leg_target[1, i] = m.velocity[i]
            m.leg_target[2, i] = 0.0
            m.leg_error[i] = 0.0
    m.leg_idle = 0.0


@kernel
def _follow(m: Any, h: float) -> None:
    """Commands throttle and steering by the target."""
    target = m.leg_target
    accel, _ = _limits(m)
    fast = cruise(m)
    dn, de = target[0, 0] - m.position[0], target[0, 1] - m.position[1]
    distance = math.sqrt(dn * dn + de * de)
    vn, ve = target[1, 0], target[1, 1]
    stopping = vn == 0.0 and ve == 0.0
    if distance > 0.0:
        more = min(sqrt_controller(distance, m.PSC_POS_P, min(accel, _lateral(m)), 0.0), fast) / distance
        vn, ve = vn + dn * more, ve + de * more
    vn, ve = limit_length(vn, ve, fast)
    share = lowpass_alpha(h, _FILTER)
    error = m.leg_error
    error[0] += (vn - m.velocity[0] - error[0]) * share
    error[1] += (ve - m.velocity[1] - error[1]) * share
    an = m.PSC_VEL_P * error[0] + target[2, 0]
    ae = m.PSC_VEL_P * error[1] + target[2, 1]
    yaw = heading(m)
    cy, sy = math.cos(yaw), math.sin(yaw)
    ahead = vn * cy + ve * sy
    behind = ahead < 0.0
    aside = 0.0
    if not stopping:
        turning = math.sqrt(0.5 * _lateral(m) * m.TURN_RADIUS)  # m/s, not slower in a turn
        ahead = max(ahead, min(math.sqrt(vn * vn + ve * ve), turning))
        aside = ae * cy - an * sy
        if behind and abs(aside) < _NUDGE:
            aside = math.copysign(_NUDGE, aside)
    speed = ground_speed(m, yaw)
    throttle_for(m, ahead, speed, h)
    steer(m, aside / (min(m.demand, -_SLOW) if m.demand < 0.0 else max(m.demand, _SLOW)), speed)
    m.desired_velocity[0], m.desired_velocity[1] = vn, ve


@kernel
def is_new(m: Any, n: float, e: float) -> bool:
    """Returns whether a place is another destination than the last one, which it becomes."""
    end = m.leg_destination
    if end[0] == n and end[1] == e:
        return False
    end[0], end[1] = n, e
    return True


@kernel
def approach(m: Any, n: float, e: float, h: float) -> bool:
    """Drives to a place [m] that may change at any time; returns whether it has arrived."""
    _attend(m)
    p, v, a = m.leg_target[0], m.leg_target[1], m.leg_target[2]
    for i in range(2):
        p[i] += v[i] * h + 0.5 * a[i] * h * h
        v[i] += a[i] * h
    accel, jerk = _limits(m)
    accel = min(accel, _lateral(m))
    a[0], a[1] = shape_position_ne(
        n, e, 0.0, 0.0, 0.0, 0.0, p[0], p[1], v[0], v[1], a[0], a[1], cruise(m), accel, jerk, h, False
    )
    _follow(m, h)
    near = (n - p[0]) ** 2 + (e - p[1]) ** 2 < _SAME * _SAME
    behind = (p[0] - m.position[0]) ** 2 + (p[1] - m.position[1]) ** 2
    return bool(near and behind < m.WP_RADIUS * m.WP_RADIUS)


# ---- legs ----------------------------------------------------------------------------------------------------------


@kernel
def start_legs(m: Any) -> None:
    """Makes the place where the vehicle can stop the beginning of the next leg."""
    vn, ve = m.velocity[0], m.velocity[1]
    ahead = 0.5 * math.sqrt(vn * vn + ve * ve) / m.ATC_ACCEL_MAX
    m.leg_destination[0], m.leg_destination[1] = m.position[0] + vn * ahead, m.position[1] + ve * ahead
    for i in range(2):
        m.leg_origin[i] = m.leg_destination[i]
    for which in range(3):
        clear_leg(m.legs[which])
    m.leg_fast = False
    m.leg_reached = True
    m.leg_rate = 1.0
    m.leg_speed = cruise(m)


@kernel
def _plan(m: Any, which: int, n: float, e: float) -> None:
    accel, jerk = _limits(m)
    fast = float(m.leg_speed)
    plan_leg(m.legs[which], n, e, 0.0, (fast, fast, fast), (accel, accel), jerk, _SNAP)


@kernel
def set_leg(m: Any, n: float, e: float, then: tuple[float, float], passes: bool) -> None:
    """Drives to a place: from where it can stop, if the last one was not reached, or another one was behind it.

    Args:
        m: the record.
        n, e: north and east of the place [m].
        then: north and east of the place behind it [m].
        passes: whether there is one, so that the vehicle does not stop.
    """
    other = m.leg_fast and (m.leg_next[0] != n or m.leg_next[1] != e)
    if not m.leg_reached or m.leg_idle >= _IDLE or other:
        start_legs(m)
    begin, end = m.leg_origin, m.leg_destination
    begin[0], begin[1] = end[0], end[1]
    end[0], end[1] = n, e
    last, this, following = m.legs[_LAST], m.legs[_THIS], m.legs[_NEXT]
    for i in range(LEG):
        last[i] = this[i]
    if m.leg_fast and following[CLOCK] < following[DURATION]:
        for i in range(LEG):
            this[i] = following[i]
    else:
        _plan(m, _THIS, n - begin[0], e - begin[1])
    clear_leg(following)
    m.leg_next[0], m.leg_next[1] = then
    m.leg_fast = passes
    if passes:
        _plan(m, _NEXT, then[0] - n, then[1] - e)
    m.leg_reached = False


@kernel
def _respeed(m: Any) -> None:
    """Plans this leg and the next anew after a change of speed."""
    if m.leg_speed == cruise(m):
        return
    m.leg_speed = cruise(m)
    this, following = m.legs[_THIS], m.legs[_NEXT]
    if this[CLOCK] < this[DURATION]:
        _, speed, way = along_leg(this, this[CLOCK])
        for i in range(2):
            m.leg_origin[i] += this[NORTH + i] * way
        clear_leg(m.legs[_LAST])
        _plan(m, _THIS, m.leg_destination[0] - m.leg_origin[0], m.leg_destination[1] - m.leg_origin[1])
        if speed > 0.0:
            begin_leg_at(this, speed)
    if m.leg_fast and following[CLOCK] == 0.0:
        _plan(m, _NEXT, m.leg_next[0] - m.leg_destination[0], m.leg_next[1] - m.leg_destination[1])


@kernel
def _turns_well(m: Any) -> bool:
    """Returns whether the next leg may begin now: half of the remaining time later, it is in the turn."""
    this, following = m.legs[_THIS], m.legs[_NEXT]
    left = this[DURATION] - this[CLOCK]
    if this[CLOCK] < this[RISE] + this[CONSTANT] or left > following[RISE]:
        return False
    a, v, s = along_leg(this, this[CLOCK] + 0.5 * left)
    a_next, v_next, s_next = along_leg(following, 0.5 * left)
    away, speed, turn = 0.0, 0.0, 0.0
    for i in range(NORTH, EAST + 1):
        away += (this[i] * (s - this[LENGTH]) + following[i] * s_next) ** 2
        speed += (this[i] * v + following[i] * v_next) ** 2
        turn += (this[i] * a + following[i] * a_next) ** 2
    return bool(
        away < max(m.WP_RADIUS, m.TURN_RADIUS) ** 2
        and speed < min(this[SPEED], following[SPEED]) ** 2
        and turn < _lateral(m) ** 2
    )


@kernel
def _advance_clocks(m: Any, dt: float) -> bool:
    """Advances the legs; returns whether this one has ended, or half of the turn is passed."""
    last, this, following = m.legs[_LAST], m.legs[_THIS], m.legs[_NEXT]
    last[CLOCK] = min(last[CLOCK] + dt, last[DURATION])
    this[CLOCK] = min(this[CLOCK] + dt, this[DURATION])
    ended = bool(this[CLOCK] >= this[DURATION] - this[EARLY])
    if m.leg_fast and following[CLOCK] == 0.0:
        if _turns_well(m):
            following[CLOCK] = dt
    elif following[CLOCK] > 0.0:
        following[CLOCK] = min(following[CLOCK] + dt, following[DURATION])
        ended = ended or following[CLOCK] >= this[DURATION] - this[CLOCK]
    return ended


@kernel
def _lag(m: Any) -> float:
    """Returns the rate of time, 0 to 1, at which the vehicle can follow the target along its direction."""
    p, v = m.leg_target[0], m.leg_target[1]
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
    if speed <= 0.0:
        return 1.0
    ahead, moved = 0.0, 0.0
    for i in range(2):
        ahead += (p[i] - m.position[i]) * v[i] / speed
        moved += m.velocity[i] * v[i] / speed
    return float(clip(_SLACK + (moved - m.PSC_POS_P * ahead) / speed, 0.0, 1.0))


@kernel
def _is_there(m: Any) -> bool:
    """Returns whether the vehicle is near the destination or beyond it."""
    begin, end = m.leg_origin, m.leg_destination
    wn, we = end[0] - begin[0], end[1] - begin[1]
    dn, de = end[0] - m.position[0], end[1] - m.position[1]
    return bool(dn * dn + de * de <= m.WP_RADIUS * m.WP_RADIUS or dn * wn + de * we <= 0.0)


@kernel
def drive_legs(m: Any, h: float) -> bool:
    """Drives along the leg; returns whether its destination is reached."""
    _attend(m)
    _respeed(m)
    accel, jerk = _limits(m)
    m.leg_rate += (_lag(m) - m.leg_rate) * min(h * jerk / accel, 1.0)
    ended = _advance_clocks(m, m.leg_rate * h)
    target = m.leg_target
    for i in range(2):
        target[0, i] = m.leg_origin[i]
        target[1, i], target[2, i] = 0.0, 0.0
    for which in range(3):
        leg = m.legs[which]
        if which == _NEXT and leg[CLOCK] == 0.0:
            continue
        a, v, s = along_leg(leg, leg[CLOCK])
        if which == _LAST:
            s -= leg[LENGTH]
        for i in range(2):
            target[0, i] += leg[NORTH + i] * s
            target[1, i] += leg[NORTH + i] * v
            target[2, i] += leg[NORTH + i] * a
    _follow(m, h)
    if ended and not m.leg_reached:
        m.leg_reached = m.leg_fast or _is_there(m)
    return bool(m.leg_reached)
