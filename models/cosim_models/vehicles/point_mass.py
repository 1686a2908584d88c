"""The point mass FMU: three degrees of freedom for swarms of tens of thousands.

It accelerates as it is commanded, without any lag: the counterpart of a multirotor whose attitude loop is ideal. With
the `IdealAutopilot` its answer to a position target is that of a linear system of second order within limits. It stays
level and keeps its heading. The equations are solved exactly for commands and wind that are constant during a step, so
the length of a step does not matter to the physics.

Source of the vehicle: none; it is an idealisation. docs/models.md compares it with the 6-DoF quadrotor.
"""

from __future__ import annotations

from math import cos, exp, isfinite, sin
from typing import Any, ClassVar

from cosim import Model, Output, Parameter
from cosim.frames import rotate_inverse
from cosim.kernel import kernel
from cosim.vehicle import FORCE, POINT_MASS_ACCELERATION, VEHICLE_INPUTS, Airframe, outputs_of
from cosim.verdict import Role

__all__ = ["PointMass"]

_GRAVITY = 9.80665
_SHORTEST = 1e-6
"""Shortest step, s, whose mean acceleration is determined. Over shorter ones, which some engines make (OMSimulator:
1e-13 s at the end), the last one is held: differences of velocities divided by such a step are rounding."""
_NORTH, _EAST, _DOWN, _LIFT = 0, 1, 2, 3  # elements of `motor`


@kernel
def start(m: Any) -> int:
    """Places the point at rest."""
    if m.drag_time < 0.0:
        return 1
    if m.position_start[2] > m.ground_height:
        return 2
    for i in range(3):
        m.position[i] = m.position_start[i]
        m.velocity[i] = 0.0
        m.angular_velocity[i] = 0.0
    m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3] = (
        cos(0.5 * m.yaw_start),
        0.0,
        0.0,
        sin(0.5 * m.yaw_start),
    )
    m.on_ground = m.position[2] >= m.ground_height
    m.specific_force[0], m.specific_force[1], m.specific_force[2] = 0.0, 0.0, -_GRAVITY if m.on_ground else 0.0
    return 0


@kernel
def _move(m: Any, i: int, pull: float, h: float) -> None:
    """Moves along axis `i` for `h` seconds under the acceleration `pull` [m/s2] and the drag of the air."""
    v, tau = float(m.velocity[i]), float(m.drag_time)
    if tau > 0.0:
        final = m.wind[i] + pull * tau
        gone = exp(-h / tau)
        m.velocity[i] = final + (v - final) * gone
        m.position[i] += final * h + (v - final) * tau * (1.0 - gone)
    else:
        m.velocity[i] = v + pull * h
        m.position[i] += (v + 0.5 * pull * h) * h


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step of `h` seconds."""
    scale = 2.0 * POINT_MASS_ACCELERATION
    weight = _GRAVITY * (1.0 - min(max(m.motor[_LIFT], 0.0), 1.0))
    powered = m.motor[_LIFT] > 0.0
    north = scale * (m.motor[_NORTH] - 0.5) if powered else 0.0
    east = scale * (m.motor[_EAST] - 0.5) if powered else 0.0
    down = (scale * (m.motor[_DOWN] - 0.5) if powered else 0.0) + weight
    if m.force[0] != 0.0 or m.force[1] != 0.0 or m.force[2] != 0.0:
        north, east, down = north + m.force[0] / m.mass, east + m.force[1] / m.mass, down + m.force[2] / m.mass
    if m.on_ground and down >= 0.0:  # it stands
        north, east, down = 0.0, 0.0, 0.0
        for i in range(3):
            m.velocity[i] = 0.0
    else:
        before = m.velocity[0], m.velocity[1], m.velocity[2]
        _move(m, _NORTH, north, h)
        _move(m, _EAST, east, h)
        _move(m, _DOWN, down, h)
        north, east = (m.velocity[0] - before[0]) / h, (m.velocity[1] - before[1]) / h
        down = (m.velocity[2] - before[2]) / h
        m.on_ground = m.position[2] >= m.ground_height
        if m.on_ground:
            m.position[2] = m.ground_height
            for i in range(3):
                m.velocity[i] = 0.0
    if not isfinite(m.position[0] + m.position[1] + m.position[2]):
        return 3
    if h < _SHORTEST:
        return 0
    q = float(m.attitude[0]), float(m.attitude[1]), float(m.attitude[2]), float(m.attitude[3])
    m.specific_force[0], m.specific_force[1], m.specific_force[2] = rotate_inverse(q, (north, east, down - _GRAVITY))
    return 0


class PointMass(Model):
    """Point that accelerates as commanded, for large swarms."""

    step_size = 0.0125
    variables = (
        *VEHICLE_INPUTS,
        FORCE,
        Parameter("mass", unit="kg", start=1.5, minimum=1e-3, description="on which forces of others act"),
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED",
        ),
        Parameter("yaw_start", unit="rad", start=0.0, description="heading, clockwise from north"),
        Parameter("ground_height", unit="m", start=0.0, description="down coordinate at which the vehicle stands"),
        Parameter(
            "drag_time",
            unit="s",
            start=0.0,
            minimum=0.0,
            description="time constant with which it takes on the velocity of the air; 0: no drag, no wind",
        ),
        *outputs_of(Airframe.point_mass),
        Output(
            "on_ground", type=bool, start=False, verdict=Role.ON_GROUND, description="the ground carries the weight"
        ),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "drag_time must not be negative",
        2: "position_start is below the ground: down must not exceed ground_height",
        3: "position is no longer finite: are all commands and the wind?",
    }
