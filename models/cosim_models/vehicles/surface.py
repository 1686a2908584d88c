"""Kernels and variables that rovers and boats share: motion on a level surface along the arc of a circle.

The heading changes with the distance travelled through the surface (steering) or with time (skid steering). Position is
integrated exactly for a constant curvature during a step.
"""

from __future__ import annotations

from math import cos, isfinite, sin
from typing import Any

from cosim import Memory, Output, Parameter, Variable
from cosim.kernel import kernel
from cosim.vehicle import VEHICLE_INPUTS, Airframe, outputs_of
from cosim.verdict import Role

__all__ = ["STEP_SIZE", "place", "steering_of", "surface_variables", "throttle_of", "travel"]

STEP_SIZE = 0.0125
_GRAVITY = 9.80665
_STEERING, _THROTTLE = 0, 1  # elements of `motor`


def surface_variables(airframe: Airframe, parameters: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Returns the variables of a vehicle on a surface, with its own parameters."""
    return (
        *VEHICLE_INPUTS,
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED; it stays at its down coordinate",
        ),
        Parameter("yaw_start", unit="rad", start=0.0, description="initial heading, clockwise from north"),
        *parameters,
        *outputs_of(airframe),
        Output("speed", unit="m/s", start=0.0, description="ahead, through the surface"),
        Output("on_ground", type=bool, start=True, verdict=Role.ON_GROUND, description="always true: it cannot fly"),
        Memory("heading"),  # rad
    )


@kernel
def steering_of(m: Any) -> float:
    """Returns the commanded steering, -1 (left) to 1 (right)."""
    return 2.0 * min(max(float(m.motor[_STEERING]), 0.0), 1.0) - 1.0


@kernel
def throttle_of(m: Any) -> float:
    """Returns the commanded throttle, -1 (reverse) to 1 (ahead)."""
    return 2.0 * min(max(float(m.motor[_THROTTLE]), 0.0), 1.0) - 1.0


@kernel
def _turn_to(m: Any, heading: float) -> None:
    m.heading = heading
    m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3] = cos(0.5 * heading), 0.0, 0.0, sin(0.5 * heading)


@kernel
def place(m: Any) -> None:
    """Places the vehicle at rest."""
    for i in range(3):
        m.position[i] = m.position_start[i]
        m.velocity[i] = 0.0
        m.angular_velocity[i] = 0.0
        m.specific_force[i] = 0.0
    m.specific_force[2] = -_GRAVITY
    m.speed = 0.0
    m.on_ground = True
    _turn_to(m, float(m.yaw_start))


@kernel
def travel(m: Any, after: float, distance: float, turn: float, north: float, east: float, h: float) -> bool:
    """Moves the vehicle for `h` seconds; returns whether it still is at a finite place.

    Args:
        after: speed at the end of the step [m/s].
        distance: distance travelled ahead [m].
        turn: change of the heading [rad].
        north, east: velocity of the surface [m/s].
    """
    half = 0.5 * turn
    chord = distance * (sin(half) / half if abs(half) > 1e-9 else 1.0)
    m.position[0] += chord * cos(m.heading + half) + north * h
    m.position[1] += chord * sin(m.heading + half) + east * h
    _turn_to(m, m.heading + turn)
    rate = turn / h
    m.specific_force[0], m.specific_force[1] = (after - m.speed) / h, rate * after
    m.angular_velocity[2] = rate
    m.speed = after
    m.velocity[0] = after * cos(m.heading) + north
    m.velocity[1] = after * sin(m.heading) + east
    return isfinite(m.position[0] + m.position[1])
