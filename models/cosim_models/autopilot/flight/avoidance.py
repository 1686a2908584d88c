"""Slowing down before fences, as ArduCopter's AC_Avoid does in GUIDED with velocities and in LOITER (AVOID_ENABLE 1).

A velocity towards the circle about home, an edge of an uploaded polygon, an uploaded circle, the maximum or the minimum
height is reduced such that the vehicle comes to rest FENCE_MARGIN before it; along it, the vehicle slides. Kernels over
the autopilot's record `m`.

Source: ArduPilot, AC_Avoid (adjust_velocity_circle_fence, adjust_velocity_polygon, limit_velocity_2D,
adjust_velocity_z).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import Pair, clip, inverse_sqrt_controller, sqrt_controller
from cosim_models.autopilot.mission.fences import (
    CIRCLE,
    HIGHEST,
    LOWEST,
    POLYGON,
    edge,
    fence_shape,
    is_inside,
    within_polygons,
)

__all__ = ["avoid_fences", "avoids", "slow_at_fences", "slow_at_heights"]

_ACCEL_MAX = 1.0  # m/s2, of the braking
_BACK_SHARE, _BACK_SPEED = (
    0.4,
    0.75,
)  # of that acceleration, and m/s (AVOID_BACKUP_SPD), on the way back into the margin
_CHANGE = 3.0  # m/s2 (AVOID_ACCEL_MAX)
_RECENT = 0.2  # s for which the last reduced velocity counts
_AT_FENCES = 1  # AVOID_ENABLE


@kernel
def avoids(m: Any) -> bool:
    """Returns whether fences slow the vehicle down."""
    return bool(m.FENCE_ENABLE != 0 and (m.AVOID_ENABLE & _AT_FENCES) != 0)


@kernel
def _at_least(v: float, back: float) -> float:
    """Returns a part of a velocity that is at least `back` in its direction."""
    if back == 0.0:
        return v
    return max(v, back) if back > 0.0 else min(v, back)


@kernel
def _slow_at_circle(m: Any, vn: float, ve: float, dt: float) -> tuple[float, float]:
    """Returns a horizontal velocity [m/s] with which the vehicle does not leave the circle."""
    speed = math.sqrt(vn * vn + ve * ve)
    if (m.FENCE_TYPE & CIRCLE) == 0 or speed == 0.0:
        return vn, ve
    n, e = m.position_neu[0] - m.home_neu[0], m.position_neu[1] - m.home_neu[1]
    radius = m.FENCE_RADIUS - m.FENCE_MARGIN
    if n * n + e * e > m.FENCE_RADIUS * m.FENCE_RADIUS or radius <= 0.0:
        return vn, ve
    accel = min(0.01 * m.WPNAV_ACCEL, _ACCEL_MAX)
    way = inverse_sqrt_controller(speed, m.PSC_POSXY_P, accel) / speed
    stop_n, stop_e = n + vn * way, e + ve * way
    far = math.sqrt(stop_n * stop_n + stop_e * stop_e)
    if far > radius:
        dn, de = stop_n * radius / far - n, stop_e * radius / far - e
        left = math.sqrt(dn * dn + de * de)
        slower = min(speed, sqrt_controller(left, m.PSC_POSXY_P, accel, dt)) / left if left > 0.0 else 0.0
        vn, ve = dn * slower, de * slower
    gone = math.sqrt(n * n + e * e)
    if gone <= radius:
        return vn, ve
    back = min(sqrt_controller(gone - radius, m.PSC_POSXY_P, _BACK_SHARE * accel, dt), _BACK_SPEED) / gone
    return _at_least(vn, -back * n), _at_least(ve, -back * e)


@kernel
def _limited(m: Any, v: Pair, dn: float, de: float, left: float, dt: float) -> Pair:
    """Returns a velocity whose part along the unit vector (dn, de) comes to rest FENCE_MARGIN before `left` [m]."""
    accel = min(0.01 * m.WPNAV_ACCEL, _ACCEL_MAX)
    most = sqrt_controller(max(left - m.FENCE_MARGIN, 0.0), m.PSC_POSXY_P, accel, dt)
    excess = max(v[0] * dn + v[1] * de - most, 0.0)
    return v[0] - excess * dn, v[1] - excess * de


@kernel
def _slow_at_edges(m: Any, first: int, vertices: int, v: Pair, dt: float) -> Pair:
    """Slows down before each edge of a polygon, towards its point that is nearest to the vehicle."""
    n, e = m.position_neu[0], m.position_neu[1]
    k = first + vertices - 1
    for i in range(first, first + vertices):
        begin_n, begin_e, n_way, e_way = edge(m, k, i)
        k = i
        length = n_way * n_way + e_way * e_way
        share = 0.0 if length == 0.0 else clip(((n - begin_n) * n_way + (e - begin_e) * e_way) / length, 0.0, 1.0)
        dn, de = begin_n + share * n_way - n, begin_e + share * e_way - e
        away = math.sqrt(dn * dn + de * de)
        if away > 0.0:
            v = _limited(m, v, dn / away, de / away, away, dt)
    return v


@kernel
def _slow_at_items(m: Any, v: Pair, dt: float) -> Pair:
    """Slows down before the uploaded polygons and circles."""
    n, e = m.position_neu[0], m.position_neu[1]
    i = 0
    while i < m.fence_count:
        inclusion, polygon, size, centre_n, centre_e = fence_shape(m, i)
        if polygon:
            if is_inside(m, i, int(size), n, e) == inclusion:
                v = _slow_at_edges(m, i, int(size), v, dt)
            i += int(size)
            continue
        i += 1
        dn, de = n - centre_n, e - centre_e
        away = math.sqrt(dn * dn + de * de)
        if away > 0.0:
            sign = 1.0 if inclusion else -1.0
            v = _limited(m, v, sign * dn / away, sign * de / away, sign * (size - away), dt)
    return v


@kernel
def slow_at_fences(m: Any, vn: float, ve: float, dt: float) -> Pair:
    """Returns a horizontal velocity [m/s] with which the vehicle stays within the fences."""
    v = _slow_at_circle(m, vn, ve, dt)
    if (m.FENCE_TYPE & POLYGON) == 0 or m.fence_count == 0 or (v[0] == 0.0 and v[1] == 0.0):
        return v
    return _slow_at_items(m, v, dt) if within_polygons(m, m.position_neu[0], m.position_neu[1]) else v


@kernel
def slow_at_heights(m: Any, vu: float, dt: float) -> float:
    """Returns a climb rate [m/s] with which the vehicle does not leave the heights of the fence."""
    height = m.position_neu[2] - m.home_neu[2]
    if (m.FENCE_TYPE & HIGHEST) != 0 and vu > 0.0:
        room = m.FENCE_ALT_MAX - m.FENCE_MARGIN - height
        vu = min(vu, sqrt_controller(room, m.PSC_POSZ_P, m.accel_up, dt) if room > 0.0 else 0.0)
    if (m.FENCE_TYPE & LOWEST) != 0 and vu < 0.0 and m.fence_low_armed:
        room = height - m.FENCE_ALT_MIN - m.FENCE_MARGIN
        vu = -min(-vu, sqrt_controller(room, m.PSC_POSZ_P, m.accel_up, dt) if room > 0.0 else 0.0)
    return vu


@kernel
def avoid_fences(m: Any, v: Any, dt: float) -> None:
    """Reduces a wanted velocity (float64[3], NEU) until the next command: ArduCopter changes the command itself.

    The velocity changes by at most 3 m/s2 in the steps in which it is reduced; since it stays as it was reduced to, it
    rises again by one such step for each command.
    """
    vn, ve = slow_at_fences(m, v[0], v[1], dt)
    vu = slow_at_heights(m, v[2], dt)
    if vn == v[0] and ve == v[1] and vu == v[2]:
        m.avoiding -= dt
        return
    last = m.avoid_velocity
    if m.avoiding <= 0.0:
        last[0], last[1], last[2] = v[0], v[1], v[2]
    m.avoiding = _RECENT
    dn, de, du = vn - last[0], ve - last[1], vu - last[2]
    change = math.sqrt(dn * dn + de * de + du * du)
    share = min(_CHANGE * dt / change, 1.0) if change > 0.0 else 1.0
    for i in range(3):
        last[i] += share * (dn if i == 0 else de if i == 1 else du)
        v[i] = last[i]
