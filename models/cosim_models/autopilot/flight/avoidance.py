"""Slowing down before fences, as ArduCopter's AC_Avoid does in GUIDED with velocities and in LOITER (AVOID_ENABLE 1).

A velocity towards the circle about home, the maximum or the minimum height is reduced such that the vehicle comes to
rest FENCE_MARGIN before it; along the circle the vehicle slides. Polygons do not slow it down. Kernels over the
autopilot's record `m`.

Source: ArduPilot, AC_Avoid (adjust_velocity_circle_fence, adjust_velocity_z).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import inverse_sqrt_controller, sqrt_controller
from cosim_models.autopilot.mission.fences import CIRCLE, HIGHEST, LOWEST

__all__ = ["avoids", "slow_at_circle", "slow_at_heights"]

_ACCEL_MAX = 3.0  # m/s2, of the braking
_AT_FENCES = 1  # AVOID_ENABLE


@kernel
def avoids(m: Any) -> bool:
    """Returns whether fences slow the vehicle down."""
    return bool(m.FENCE_ENABLE != 0 and (m.AVOID_ENABLE & _AT_FENCES) != 0)


@kernel
def slow_at_circle(m: Any, vn: float, ve: float, dt: float) -> tuple[float, float]:
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
    if far <= radius:
        return vn, ve
    dn, de = stop_n * radius / far - n, stop_e * radius / far - e
    left = math.sqrt(dn * dn + de * de)
    if left == 0.0:
        return 0.0, 0.0
    slower = min(speed, sqrt_controller(left, m.PSC_POSXY_P, accel, dt)) / left
    return dn * slower, de * slower


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
