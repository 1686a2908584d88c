"""Circles of planes and quadplanes on their wing: the lateral acceleration that leads onto one and along it.

From afar, it turns towards the centre. On the circle, the distance from it and its rate of change are the state of an
oscillator with the period NAVL1_PERIOD and the damping NAVL1_DAMPING, to which the acceleration of the circle is added.
It changes over where the circle asks for less. There is no integral: a body that slips, and so turns less than its bank
should make it, circles farther out, where the distance makes up for it.

Kernels over a record that has `CIRCLE_PARAMETERS` and `CIRCLE_MEMORY` beside position, velocity and attitude.

Source: ArduPilot, AP_L1_Control.cpp (update_loiter, nav_roll_cd). S. Park, J. Deyst, J. P. How, A New Nonlinear
Guidance Logic for Trajectory Tracking, AIAA 2004-4900.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory, Parameter
from cosim.frames import wrap_pi, yaw_from_quaternion
from cosim.kernel import kernel

__all__ = ["CIRCLE_MEMORY", "CIRCLE_PARAMETERS", "is_on_circle", "leave_circle", "look_ahead", "towards_circle"]

_BEHIND = math.tan(math.radians(18.0))  # its course within this angle of away from the centre: it keeps its turn
_AWAY = math.radians(120.0)  # of the nose from the centre, for that
_SLOWEST = 1.0  # m/s
_CENTRE = 0.1  # m

CIRCLE_PARAMETERS = (
    Parameter(
        "NAVL1_PERIOD",
        unit="s",
        start=17.0,
        minimum=1.0,
        maximum=60.0,
        tunable=True,
        description="period with which it comes onto circles",
    ),
    Parameter(
        "NAVL1_DAMPING",
        start=0.75,
        minimum=0.1,
        maximum=1.0,
        tunable=True,
        description="damping with which it comes onto circles",
    ),
)
CIRCLE_MEMORY = (
    Memory("circled", shape=3),  # centre and radius of the circle that it is on [m]; 0: none; negative: anticlockwise
    Memory("turns_back", dtype="i4"),  # 1 clockwise, -1 anticlockwise, while the centre is behind it
)


@kernel
def look_ahead(m: Any) -> float:
    """Returns the time [s] in which it flies as far as it looks ahead."""
    return float(m.NAVL1_DAMPING * m.NAVL1_PERIOD / math.pi)


@kernel
def is_on_circle(m: Any, n: float, e: float) -> bool:
    """Returns whether it has come onto the circle around a place and stayed on it."""
    return bool(m.circled[2] != 0.0 and m.circled[0] == n and m.circled[1] == e)


@kernel
def leave_circle(m: Any) -> None:
    """Notes that it circles no longer."""
    m.circled[2] = 0.0


@kernel
def _way_back(m: Any, way: int, out_n: float, out_e: float) -> int:
    """Returns the way to turn to a centre behind it, which is that of before while it looks away from it."""
    if way * m.turns_back < 0:
        nose = yaw_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
        if abs(wrap_pi(math.atan2(-out_e, -out_n) - nose)) > _AWAY:
            way = m.turns_back
    m.turns_back = way
    return way


@kernel
def towards_circle(m: Any, n: float, e: float, radius: float) -> float:
    """Returns the acceleration to the right [m/s2] for a circle around a place; a negative radius: anticlockwise."""
    turn = 1.0 if radius > 0.0 else -1.0
    size = abs(radius)
    north, east = m.velocity[0], m.velocity[1]
    out_n, out_e = m.position[0] - n, m.position[1] - e
    distance = math.sqrt(out_n * out_n + out_e * out_e)
    speed = math.sqrt(north * north + east * east)
    if distance > _CENTRE:
        out_n, out_e = out_n / distance, out_e / distance
    else:
        out_n, out_e = north / max(speed, _SLOWEST), east / max(speed, _SLOWEST)
    outwards = north * out_n + east * out_e
    around = out_n * east - out_e * north  # clockwise
    omega = 2.0 * math.pi / m.NAVL1_PERIOD
    damped = 2.0 * m.NAVL1_DAMPING * omega
    miss = distance - size

    to_centre = damped * around
    if outwards > 0.0:
        way = 1 if around >= 0.0 else -1
        if abs(around) < _BEHIND * outwards:
            way = _way_back(m, way, out_n, out_e)
        else:
            m.turns_back = 0
        to_centre = damped * max(speed, _SLOWEST) * way
    else:
        m.turns_back = 0

    inwards = omega * omega * miss + damped * outwards
    along = turn * around
    if outwards > 0.0 and along < 0.0:  # the wrong way round
        inwards = max(inwards, 0.0)
    on_circle = turn * (inwards + along * along / max(0.5 * size, distance))
    if miss > 0.0 and turn * to_centre < turn * on_circle:
        if not is_on_circle(m, n, e) or m.circled[2] != radius:
            m.circled[2] = 0.0
        return float(to_centre)
    m.circled[0], m.circled[1], m.circled[2] = n, e, radius
    return float(on_circle)
