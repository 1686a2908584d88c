"""Waypoints as ArduCopter flies them: legs with S-curves, of which one ends while the next begins, and splines.

A destination begins a leg, from rest at the last destination, or at the stopping point if the vehicle was not on a leg.
If the next destination is known, the next leg begins before this one has ended, provided that the vehicle passes within
WPNAV_RADIUS, not faster than on either leg, and that cornering stays within WPNAV_ACCEL_C. Time along the legs goes
slower while the vehicle lags behind and while the flight is paused. When a limit of the speed changes, a leg that has
begun is planned anew; the vehicle goes on at its place with its speed, which then moves to that of the plan (ArduCopter
inserts S-curves there). A leg that is a spline is passed at the speed that its curvature and that of its neighbours
permit; a straight one before or after it ends or begins at that speed. Heights of a leg are above the local origin, or
above the terrain (`terrain_following`); a leg of the other kind begins from rest. Kernels over the autopilot's record
`m`; rows of m.legs are the last leg, this one, and the next, those of m.splines this one and the next.

Source: ArduPilot, AC_WPNav, SplineCurve and SCurve (advance_target_along_track), 4.5 to 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.motors import THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import (
    control_ne,
    control_up,
    initialise_up,
    seek_velocity_ne,
    seek_velocity_up,
    stop_ne,
    stopping_ne,
)
from cosim_models.autopilot.control.scurve import (
    BEGIN,
    CLIMB_ACCEL,
    CLOCK,
    CONSTANT,
    DURATION,
    EARLY,
    END,
    LEG,
    LENGTH,
    NORTH,
    RISE,
    SHARE,
    SHARE_RATE,
    SPEED,
    along_leg,
    begin_leg_at,
    clear_leg,
    end_leg_at,
    plan_leg,
    time_at,
    top_speed,
)
from cosim_models.autopilot.control.shaping import clip, inverse_sqrt_controller, shape_velocity, sqrt_controller
from cosim_models.autopilot.control.spline import DIRECTION, FIRST_SPEED, LAST_SPEED, follow_spline, plan_spline
from cosim_models.autopilot.flight.terrain_following import (
    lower,
    margin_share,
    note_terrain,
    raise_up,
    refer_heights,
    see_terrain,
)
from cosim_models.autopilot.flight.yaw import lean

__all__ = [
    "add_leg",
    "add_spline",
    "advance_legs",
    "change_height",
    "fly_leg",
    "is_above",
    "leave_legs",
    "respeed_legs",
    "set_leg",
    "set_spline",
    "start_legs",
    "start_legs_at",
]

_LAST, _THIS, _NEXT = 0, 1, 2
_SAME = 1e-6  # difference of destinations [m] or speeds [1] that counts as none
_SLACK = 0.05  # of the speed that may be missing before time goes slower
_STILL = 3.45e-6  # m/s; ArduCopter takes the square of a slower target for zero
_BELOW = 1.0 - 1e-6  # an acceleration at its limit is mostly not below it, by ArduCopter's 32-bit numbers
_STOP_UP, _STOP_DOWN = 3.0, 2.0  # m, greatest stopping distances


@kernel
def start_legs(m: Any) -> None:
    """Begins at the stopping point, which is the first destination; the caller has set the limits of speed."""
    n, e = stopping_ne(m)
    way = inverse_sqrt_controller(m.velocity_neu[2], m.PSC_POSZ_P, m.accel_up)
    start_legs_at(m, n, e, m.position_neu[2] + clip(way, -_STOP_DOWN, _STOP_UP))


@kernel
def start_legs_at(m: Any, n: float, e: float, u: float) -> None:
    """Begins at a place."""
    stop_ne(m)
    initialise_up(m)
    for i in range(3):
        clear_leg(m.legs[i])
    m.leg_origin[0], m.leg_origin[1], m.leg_origin[2] = n, e, u
    g = m.guided_position_neu
    g[0], g[1], g[2] = n, e, u
    m.above_terrain = False
    m.legs_active = True
    m.leg_reached = True
    m.leg_fast = False
    m.leg_curved = False
    m.next_curved = False
    m.leg_rate = 1.0
    m.leg_speed = m.speed_max
    m.leg_speed_full = m.speed_max
    m.leg_accel = 0.0


@kernel
def leave_legs(m: Any) -> None:
    """Ends flight by legs: the next destination begins one at the stopping point."""
    m.legs_active = False


@kernel
def _plan(m: Any, which: int, n: float, e: float, u: float) -> None:
    jerk = m.WPNAV_JERK
    turn = math.radians(min(m.ATC_RATE_R_MAX, m.ATC_RATE_P_MAX)) * 9.80665  # 0: not limited
    if turn > 0.0:
        jerk = min(jerk, turn)
    snap = 0.5 * jerk * math.pi / (2.0 * max(m.ATC_INPUT_TC, 0.1))
    speeds = (float(m.speed_max), float(m.speed_up), float(m.speed_down))
    plan_leg(m.legs[which], n, e, u, speeds, (float(m.accel_max), float(m.accel_up)), jerk, snap)


@kernel
def _begin_leg(m: Any, above: bool) -> bool:
    """Begins a leg at the last destination; returns False if its height above the terrain is unknown."""
    g, begin = m.guided_position_neu, m.leg_origin
    begin[0], begin[1], begin[2] = g[0], g[1], g[2]
    if above == m.above_terrain:
        for i in range(LEG):
            m.legs[_LAST, i] = m.legs[_THIS, i]
        return True
    known, up = refer_heights(m, above)
    if known:
        begin[2] += -up if above else up
        clear_leg(m.legs[_LAST])
    return known


@kernel
def set_leg(m: Any, n: float, e: float, u: float, above: bool) -> None:
    """Flies to a place, where the vehicle stops unless `add_leg` follows; `above`: the height is above the terrain."""
    follows = bool(m.leg_curved)
    if m.leg_fast and not follows:
        follows = abs(n - m.leg_next[0]) + abs(e - m.leg_next[1]) + abs(u - m.leg_next[2]) < _SAME
    if not m.legs_active or not m.leg_reached or (m.leg_fast and not follows):
        start_legs(m)
    g, begin = m.guided_position_neu, m.leg_origin
    if not _begin_leg(m, above):
        return
    g[0], g[1], g[2] = n, e, u
    following = m.legs[_NEXT]
    if m.leg_curved:
        clear_leg(m.legs[_LAST])
        _plan(m, _THIS, n - begin[0], e - begin[1], u - begin[2])
        begin_leg_at(m.legs[_THIS], _desired_speed(m))
        m.leg_curved = False
    elif m.leg_fast and following[CLOCK] < following[DURATION]:
        for i in range(LEG):
            m.legs[_THIS, i] = following[i]
    else:
        _plan(m, _THIS, n - begin[0], e - begin[1], u - begin[2])
    clear_leg(following)
    m.leg_fast = False
    m.leg_reached = False


@kernel
def add_leg(m: Any, n: float, e: float, u: float, above: bool) -> None:
    """Makes the vehicle pass the destination on its way to the next one, if both heights are of one kind."""
    if above != m.above_terrain:
        return
    g = m.guided_position_neu
    _plan(m, _NEXT, n - g[0], e - g[1], u - g[2])
    m.leg_next[0], m.leg_next[1], m.leg_next[2] = n, e, u
    m.leg_fast = True
    m.next_curved = False
    if m.leg_curved:
        this = m.splines[0]
        this[LAST_SPEED] = begin_leg_at(m.legs[_NEXT], this[LAST_SPEED])


# ---- splines -------------------------------------------------------------------------------------------------------


@kernel
def _desired_speed(m: Any) -> float:
    v = m.desired_velocity_neu
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _limits(m: Any) -> tuple[float, float, float, float, float]:
    """Returns the limits of splines."""
    return float(m.speed_max), float(m.speed_up), float(m.speed_down), float(m.accel_max), float(m.accel_up)


@kernel
def _put_direction(m: Any, row: int, begin: Any, to: tuple[float, float, float]) -> bool:
    """Sets the direction in which a spline ends; returns whether it has one."""
    end = m.spline_ends[row, 1]
    for i in range(3):
        end[i] = to[i] - begin[i]
    return bool(end[0] != 0.0 or end[1] != 0.0 or end[2] != 0.0)


@kernel
def _put_begin(m: Any) -> None:
    """Sets the direction in which the next spline begins: that in which this leg ends."""
    begin = m.spline_ends[0, 0]
    for i in range(3):
        begin[i] = m.guided_position_neu[i] - m.leg_origin[i]
        if m.leg_curved:
            begin[i] = m.splines[0, DIRECTION + i]


@kernel
def set_spline(
    m: Any, place: tuple[float, float, float], above: bool, then: tuple[float, float, float], curved: bool
) -> None:
    """Flies to a place on a spline, and passes it if there is a place after it.

    Args:
        m: the record.
        place: north, east and up.
        above: whether the height is above the terrain.
        then: the place after it, of the same kind, or the same place to stop there.
        curved: whether a spline leads to that.
    """
    if not m.legs_active or not m.leg_reached:
        start_legs(m)
    ends = m.spline_ends[0]
    if m.leg_fast and above == m.above_terrain:
        _put_begin(m)
    else:
        ends[0, 0], ends[0, 1], ends[0, 2] = 0.0, 0.0, 0.0
    g, origin = m.guided_position_neu, m.leg_origin
    if not _begin_leg(m, above):
        return
    for i in range(3):
        g[i] = place[i]
        clear_leg(m.legs[i])
    m.leg_fast = _put_direction(m, 0, origin if curved else g, then)
    m.leg_curved = True
    m.next_curved = False
    m.leg_reached = False
    plan_spline(m.splines[0], origin, ends[0], g, ends[1], _limits(m))


@kernel
def add_spline(
    m: Any, place: tuple[float, float, float], above: bool, then: tuple[float, float, float], curved: bool
) -> None:
    """Makes the vehicle pass the destination on its way to the next one, on a spline; arguments as for `set_spline`."""
    if above != m.above_terrain:
        return
    _put_begin(m)
    for i in range(3):
        m.leg_next[i] = place[i]
    g = m.guided_position_neu
    _put_direction(m, 1, g if curved else m.leg_next, then)
    plan_spline(m.splines[1], g, m.spline_ends[0, 0], m.leg_next, m.spline_ends[1, 1], _limits(m))
    speed = m.splines[1, FIRST_SPEED]
    if m.leg_curved:
        m.splines[0, LAST_SPEED] = speed
    else:
        end_leg_at(m.legs[_THIS], speed)
    m.leg_fast = True
    m.next_curved = True


# ---- changes of speed ----------------------------------------------------------------------------------------------


@kernel
def _replan(m: Any, which: int, n: float, e: float, u: float) -> None:
    """Plans a leg by the vector (n, e, u) anew with the present limits, unless it decelerates already."""
    leg = m.legs[which]
    if leg[CLOCK] > 0.0 and leg[CLOCK] >= leg[RISE] + leg[CONSTANT]:
        return
    a, v, s = along_leg(leg, leg[CLOCK])
    share, rate = leg[SHARE], leg[SHARE_RATE]
    begin, end = leg[BEGIN], leg[END]
    _plan(m, which, n, e, u)
    if begin > 0.0:
        begin_leg_at(leg, begin)
    if end > 0.0:
        end_leg_at(leg, end)
    if s <= 0.0:
        return
    leg[CLOCK] = time_at(leg, s)
    a_now, v_now, _ = along_leg(leg, leg[CLOCK])
    if v_now > 0.0:
        leg[SHARE] = share * v / v_now
        leg[SHARE_RATE] = share * share * a + rate - leg[SHARE] ** 2 * a_now


@kernel
def respeed_legs(m: Any) -> None:
    """Applies changed limits of speed to this leg and the next."""
    g, begin = m.guided_position_neu, m.leg_origin
    if not m.legs_active:
        return
    if m.leg_speed_full > 0.0:
        m.leg_speed *= m.speed_max / m.leg_speed_full
    m.leg_speed_full = m.speed_max
    if m.leg_curved:
        return
    if not m.leg_reached:
        _replan(m, _THIS, g[0] - begin[0], g[1] - begin[1], g[2] - begin[2])
    if m.leg_fast and not m.next_curved:
        _replan(m, _NEXT, m.leg_next[0] - g[0], m.leg_next[1] - g[1], m.leg_next[2] - g[2])


# ---- targets -------------------------------------------------------------------------------------------------------


@kernel
def _lag(m: Any) -> float:
    """Returns the rate of time, 0 to 1, at which the vehicle can follow the target along its direction."""
    v, e = m.desired_velocity_neu, m.position_error_neu
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if speed <= _STILL:
        return 1.0
    ahead = 0.0
    moved = 0.0
    for i in range(3):
        ahead += e[i] * v[i] / speed
        moved += m.velocity_neu[i] * v[i] / speed
    return clip(_SLACK + (moved - m.PSC_POSXY_P * ahead) / speed, 0.0, 1.0)


@kernel
def _regain(m: Any, which: int, dt: float) -> None:
    """Moves the leg's share of its planned speeds to 1."""
    leg = m.legs[which]
    top = top_speed(leg)
    if top <= 0.0 or (leg[SHARE] == 1.0 and leg[SHARE_RATE] == 0.0):
        return
    leg[SHARE] = max(leg[SHARE] + leg[SHARE_RATE] / top * dt, 0.0)
    a, v = m.accel_max, leg[SHARE] * top
    leg[SHARE_RATE] = shape_velocity(top, 0.0, v, leg[SHARE_RATE], -a, a, m.jerk_max, dt, True)
    if abs(leg[SHARE] - 1.0) < _SAME and abs(leg[SHARE_RATE]) < _SAME:
        leg[SHARE], leg[SHARE_RATE] = 1.0, 0.0


@kernel
def _add(m: Any, which: int, time: float, back: float, share: float) -> None:
    """Adds the motion of a leg to m.leg_target (position, velocity, acceleration).

    `back` of its length is subtracted from its way; `share` scales time, thus velocity and (twice) acceleration.
    """
    leg, target = m.legs[which], m.leg_target
    a, v, s = along_leg(leg, time)
    s -= back * leg[LENGTH]
    v *= share
    a *= share * share
    for i in range(3):
        unit = leg[NORTH + i]
        target[0, i] += unit * s
        target[1, i] += unit * v
        target[2, i] += unit * a


@kernel
def _turns_well(m: Any) -> bool:
    """Returns whether the vehicle may begin the next leg now: half of the remaining time later, it is in the corner."""
    this, following, target = m.legs[_THIS], m.legs[_NEXT], m.leg_target
    left = this[DURATION] - this[CLOCK]
    if this[CLOCK] < this[RISE] + this[CONSTANT] or left > following[RISE]:
        return False
    for k in range(3):
        for i in range(3):
            target[k, i] = 0.0
    _add(m, _THIS, this[CLOCK] + 0.5 * left, 1.0, 1.0)
    _add(m, _NEXT, 0.5 * left, 0.0, 1.0)
    away, speed = 0.0, 0.0
    for i in range(3):
        away += target[0, i] ** 2
        speed += target[1, i] ** 2
    corner = 0.01 * m.WPNAV_ACCEL_C if m.WPNAV_ACCEL_C > 0.0 else 2.0 * m.accel_max
    return bool(
        away < (0.01 * m.WPNAV_RADIUS) ** 2
        and speed < min(this[SPEED], following[SPEED]) ** 2
        and target[2, 0] ** 2 + target[2, 1] ** 2 < corner * corner
        and abs(target[2, 2]) < _BELOW * min(this[CLIMB_ACCEL], following[CLIMB_ACCEL])
    )


@kernel
def _advance_clocks(m: Any, dt: float) -> bool:
    """Advances the legs; returns whether this one has ended, or half of the corner is passed."""
    last, this, following = m.legs[_LAST], m.legs[_THIS], m.legs[_NEXT]
    last[CLOCK] = min(last[CLOCK] + last[SHARE] * dt, last[DURATION])
    this[CLOCK] = min(this[CLOCK] + this[SHARE] * dt, this[DURATION])
    ended = bool(this[CLOCK] >= this[DURATION] - this[EARLY])
    if m.leg_fast and following[CLOCK] == 0.0:
        if _turns_well(m):
            following[CLOCK] = min(following[SHARE] * dt, following[DURATION])
    elif following[CLOCK] > 0.0:
        following[CLOCK] = min(following[CLOCK] + following[SHARE] * dt, following[DURATION])
        ended = ended or following[CLOCK] >= this[DURATION] - this[CLOCK]
    return bool(ended)


@kernel
def _pause_share(m: Any, most: float, dt: float) -> float:
    """Returns the factor on all speeds, which falls to 0 while the flight is paused, and to `most` otherwise."""
    if not m.paused and m.leg_speed == m.leg_speed_full and m.leg_accel == 0.0 and most == 1.0:
        return 1.0
    accel = m.accel_max
    wanted = 0.0 if m.paused else most * m.leg_speed_full
    m.leg_speed += m.leg_accel * dt
    m.leg_accel = shape_velocity(wanted, 0.0, m.leg_speed, m.leg_accel, -accel, accel, m.jerk_max, dt, True)
    return clip(m.leg_speed / m.leg_speed_full, 0.0, 1.0) if m.leg_speed_full > 0.0 else 1.0


@kernel
def _straight(m: Any, share: float, dt: float) -> bool:
    """Sets m.leg_target on a straight leg; returns whether it has ended."""
    for which in range(_THIS, _NEXT + 1):
        _regain(m, which, dt)
    ended = _advance_clocks(m, m.leg_rate * share * dt)
    target = m.leg_target
    for i in range(3):
        target[0, i] = m.leg_origin[i]
        target[1, i], target[2, i] = 0.0, 0.0
    for which in range(3):
        leg = m.legs[which]
        if which != _NEXT or leg[CLOCK] > 0.0:
            _add(m, which, leg[CLOCK], 1.0 if which == _LAST else 0.0, share * leg[SHARE])
    return bool(ended)


@kernel
def _is_near(m: Any) -> bool:
    g, p = m.guided_position_neu, m.position_neu
    up = p[2] - m.terrain_target if m.terrain_on else p[2]
    away = (g[0] - p[0]) ** 2 + (g[1] - p[1]) ** 2 + (g[2] - up) ** 2
    return bool(away <= (0.01 * m.WPNAV_RADIUS) ** 2)


@kernel
def _advance(m: Any, most: float, dt: float) -> None:
    """Sets the desired motion one step further along the legs, at the share `most` of the speed."""
    m.leg_rate += (_lag(m) - m.leg_rate) * min(dt * m.WPNAV_JERK / m.accel_max, 1.0)
    share = _pause_share(m, most, dt)
    target = m.leg_target
    if m.leg_curved:
        ended = follow_spline(m.splines[0], target, _desired_speed(m), m.leg_rate * share * dt, _limits(m))
        for i in range(3):
            target[1, i] *= share
    else:
        ended = _straight(m, share, dt)
    for i in range(3):
        m.desired_position_neu[i] = target[0, i]
        m.desired_velocity_neu[i] = target[1, i]
        m.desired_acceleration_neu[i] = target[2, i]
    if ended and not m.leg_reached:
        m.leg_reached = m.leg_fast or _is_near(m)


@kernel
def advance_legs(m: Any, dt: float) -> None:
    """Sets the desired motion one step further along the legs, and m.leg_reached."""
    if not m.terrain_on:
        _advance(m, 1.0, dt)
        return
    lower(m)
    known = see_terrain(m)
    note_terrain(m, known, dt)
    if known:
        _advance(m, margin_share(m, m.WPNAV_TER_MARGIN), dt)
    raise_up(m, dt)


@kernel
def fly_leg(m: Any, dt: float) -> None:
    """Performs one step along the legs."""
    m.spool_wanted = THROTTLE_UNLIMITED
    advance_legs(m, dt)
    control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)


@kernel
def is_above(m: Any) -> bool:
    """Returns whether the destination is within WPNAV_RADIUS, whatever the height."""
    n, e = m.guided_position_neu[0] - m.position_neu[0], m.guided_position_neu[1] - m.position_neu[1]
    return bool(n * n + e * e <= (0.01 * m.WPNAV_RADIUS) ** 2)


@kernel
def change_height(m: Any, dt: float) -> None:
    """Stops, and moves to the height of the destination."""
    m.spool_wanted = THROTTLE_UNLIMITED
    left = m.guided_position_neu[2] - m.position_neu[2]
    rate = clip(sqrt_controller(left, m.PSC_POSZ_P, m.accel_up, dt), -m.speed_down, m.speed_up)
    seek_velocity_ne(m, 0.0, 0.0, 0.0, 0.0, dt)
    seek_velocity_up(m, rate, 0.0, False, dt)
    control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)
