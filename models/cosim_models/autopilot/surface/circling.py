"""CIRCLE: driving around the place where the mode was entered.

It drives ahead to the edge, CIRC_RADIUS away, and then follows a point that moves along the circle. The velocity of
this point and its distance give the velocity that is wanted, the error of the velocity and the centripetal acceleration
the turn rate. Kernels over a record that has `CIRCLE_PARAMETERS`, `CIRCLE_MEMORY` and what `driving` needs.

Differences from ArduRover: no S-curve on the way to the edge; it does not slow down for good when it cannot keep up.

Source: ArduPilot, Rover/mode_circle.cpp, APM_Control/AR_PosControl (gains, structure).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.surface.driving import clip, cruise, drive, ground_speed, steer, throttle_for

__all__ = ["CIRCLE_MEMORY", "CIRCLE_PARAMETERS", "begin_circle", "circle"]

_GRAVITY = 9.80665
_REACHED = 0.2  # m from the edge
_SLOW = 1.0  # m/s, AR_ATTCONTROL_STEER_SPEED_MIN

CIRCLE_PARAMETERS = (
    real("CIRC_RADIUS", "m", 20.0, "radius of CIRCLE, at least TURN_RADIUS", 0.1),
    real("CIRC_SPEED", "m/s", 0.0, "speed of CIRCLE, 0: CRUISE_SPEED"),
    whole("CIRC_DIR", 0, "direction of CIRCLE, 0: clockwise, 1: counter-clockwise"),
)
CIRCLE_MEMORY = (
    Memory("centre", shape=2, rare=True),  # m, north and east
    Memory("circle_angle", rare=True),  # rad, of the point from the centre
    Memory("circle_speed", rare=True),  # m/s, of the point
    Memory("on_edge", dtype="?", rare=True),
)


@kernel
def begin_circle(m: Any) -> None:
    """Makes the present place the centre."""
    m.centre[0], m.centre[1] = m.position[0], m.position[1]
    m.circle_angle, m.circle_speed = heading(m), 0.0
    m.on_edge = False


@kernel
def circle(m: Any, h: float) -> None:
    """Drives to the circle, or along it, no faster than ATC_TURN_MAX_G permits."""
    radius = max(m.CIRC_RADIUS, m.TURN_RADIUS)
    most = math.sqrt(_GRAVITY * m.ATC_TURN_MAX_G * radius)
    fast = min(m.CIRC_SPEED if m.CIRC_SPEED > 0.0 else cruise(m), most)
    dn, de = m.position[0] - m.centre[0], m.position[1] - m.centre[1]
    off = abs(math.sqrt(dn * dn + de * de) - radius)
    m.on_edge = m.on_edge or off <= max(m.TURN_RADIUS, _REACHED)
    if not m.on_edge:
        n, e = radius * math.cos(m.circle_angle) - dn, radius * math.sin(m.circle_angle) - de
        drive(m, min(fast, math.sqrt(2.0 * m.ATC_ACCEL_MAX * math.sqrt(n * n + e * e))), math.atan2(e, n), h)
        return
    side = -1.0 if m.CIRC_DIR == 1 else 1.0
    change = 0.5 * m.ATC_ACCEL_MAX * h
    m.circle_speed += clip(fast - m.circle_speed, -change, change)
    m.circle_angle = wrap_pi(m.circle_angle + side * m.circle_speed / radius * h)
    c, s = math.cos(m.circle_angle), math.sin(m.circle_angle)
    vn = m.PSC_POS_P * (radius * c - dn) - side * m.circle_speed * s
    ve = m.PSC_POS_P * (radius * s - de) + side * m.circle_speed * c
    length = math.sqrt(vn * vn + ve * ve)
    if length > fast:
        vn, ve = vn * fast / length, ve * fast / length
    inwards = m.circle_speed * m.circle_speed / radius
    an = m.PSC_VEL_P * (vn - m.velocity[0]) - inwards * c
    ae = m.PSC_VEL_P * (ve - m.velocity[1]) - inwards * s
    yaw = heading(m)
    cy, sy = math.cos(yaw), math.sin(yaw)
    turning = math.sqrt(0.5 * _GRAVITY * m.ATC_TURN_MAX_G * m.TURN_RADIUS)  # m/s, not slower in a turn
    ahead = max(vn * cy + ve * sy, min(math.sqrt(vn * vn + ve * ve), turning))
    speed = ground_speed(m, yaw)
    throttle_for(m, ahead, speed, h)
    steer(m, (ae * cy - an * sy) / max(abs(m.demand), _SLOW), speed)
    m.desired_velocity[0], m.desired_velocity[1] = vn, ve
