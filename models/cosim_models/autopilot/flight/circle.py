"""Flight on a circle, shared by CIRCLE and the mission command LOITER_TURNS.

A point moves along the circle as fast as the acceleration limits allow, and the vehicle follows it. Kernels over the
autopilot's record `m`; vectors are north, east from the local origin, SI units.

Source: ArduPilot, AC_Circle.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.position import (
    control_ne,
    control_up,
    seek_position_ne,
    seek_position_up,
    stopping_ne,
)
from cosim_models.autopilot.control.shaping import clip, wrap_pi
from cosim_models.autopilot.flight.terrain_following import climb_over_surface
from cosim_models.autopilot.flight.yaw import lean, look_round
from cosim_models.autopilot.mission.terrain import measured_terrain

__all__ = ["begin_circle", "go_round", "nearest_on_circle"]

_ACCEL_MIN = math.radians(2.0)  # rad/s2
_ALONG = 2  # CIRCLE_OPTIONS
_UNKNOWN = 5.0  # s without the terrain's height


@kernel
def begin_circle(m: Any, by_heading: bool) -> None:
    """Begins at the desired position, at rest; `by_heading`: the vehicle's heading gives the direction of the centre.

    Requires m.circle_centre, _radius and _rate.
    """
    heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    c, p = m.circle_centre, m.desired_position_neu
    if m.circle_radius <= 0.0:
        m.circle_angle = heading
    elif by_heading or (p[0] == c[0] and p[1] == c[1]):
        m.circle_angle = wrap_pi(heading - math.pi)
    else:
        m.circle_angle = math.atan2(p[1] - c[1], p[0] - c[0])
    m.circle_turning = 0.0
    m.circle_total = 0.0


@kernel
def nearest_on_circle(m: Any, up: float) -> tuple[float, float, float]:
    """Returns the circle's point nearest to the stopping point, and the latter's distance from the centre at `up`."""
    c = m.circle_centre
    rest_n, rest_e = stopping_ne(m)
    n, e, u = rest_n - c[0], rest_e - c[1], m.desired_position_neu[2] - up
    distance = math.sqrt(n * n + e * e + u * u)
    if m.circle_radius <= 0.0:
        return c[0], c[1], distance
    if distance == 0.0:
        heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
        return c[0] - m.circle_radius * math.cos(heading), c[1] - m.circle_radius * math.sin(heading), distance
    return c[0] + n / distance * m.circle_radius, c[1] + e / distance * m.circle_radius, distance


@kernel
def _turn(m: Any, dt: float) -> None:
    """Advances the point on the circle."""
    rate = m.circle_rate
    accel = max(abs(rate), _ACCEL_MIN)
    if m.circle_radius > 0.0:
        fastest = min(m.speed_max, math.sqrt(0.5 * m.accel_max * m.circle_radius)) / m.circle_radius
        rate = clip(rate, -fastest, fastest)
        accel = max(m.accel_max / m.circle_radius, _ACCEL_MIN)
    m.circle_turning += clip(rate - m.circle_turning, -accel * dt, accel * dt)
    m.circle_angle = wrap_pi(m.circle_angle + m.circle_turning * dt)
    m.circle_total += m.circle_turning * dt


@kernel
def _follow_terrain(m: Any, dt: float) -> None:
    """Keeps the height of the circle above the terrain; 5 s without the terrain's height begin the fail-safe."""
    known, up = measured_terrain(m)
    if known:
        m.terrain_target = up
        m.surface_gap = 0.0
    else:
        m.surface_gap += dt
        m.terrain_missing = m.surface_gap > _UNKNOWN
    seek_position_up(m, m.circle_up + m.terrain_target, 0.0, dt)


@kernel
def go_round(m: Any, climb: float, dt: float) -> None:
    """Performs one step around the centre, facing it, with a climb rate [m/s], or above the terrain."""
    _turn(m, dt)
    c = m.circle_centre
    seek_position_ne(
        m,
        c[0] + m.circle_radius * math.cos(m.circle_angle),
        c[1] + m.circle_radius * math.sin(m.circle_angle),
        dt,
    )
    if m.circle_above:
        _follow_terrain(m, dt)
    else:
        climb_over_surface(m, climb, dt)
    nose = m.circle_angle
    if m.circle_radius > 0.0:
        nose = math.atan2(c[1] - m.desired_position_neu[1], c[0] - m.desired_position_neu[0])
        if (m.CIRCLE_OPTIONS & _ALONG) != 0:
            nose += -0.5 * math.pi if m.circle_rate > 0.0 else 0.5 * math.pi
    look_round(m, wrap_pi(nose))
    control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)
