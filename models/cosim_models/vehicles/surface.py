"""Kernels and variables that rovers and boats share: motion on a level surface along the arc of a circle.

The heading changes with the distance travelled through the surface (steering) or with time (skid steering). Position is
integrated exactly for a constant curvature during a step.

Forces of the surroundings (`cosim_models.environment`) and of the wind act at the centre of mass: they do not turn the
vehicle. The part along it changes its speed, the part across makes it slide; turning does not couple the two.
"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import Any

from cosim import Memory, Output, Parameter, Variable
from cosim.kernel import kernel
from cosim.vehicle import FORCE, VEHICLE_INPUTS, Airframe, outputs_of
from cosim.verdict import Role

__all__ = [
    "GRAVITY",
    "STEP_SIZE",
    "is_pushed",
    "place",
    "push_of",
    "slide",
    "steering_of",
    "surface_variables",
    "throttle_of",
    "travel",
]

STEP_SIZE = 0.0125
GRAVITY = 9.80665
_SHORTEST = 1e-6
"""Shortest step, s, whose mean acceleration and turn rate are determined. Over shorter ones, which some engines make
(OMSimulator: 1e-13 s at the end), the last ones are held: differences divided by such a step are rounding."""
"""Standard gravity [m/s2]."""

_STEERING, _THROTTLE = 0, 1  # elements of `motor`


def surface_variables(airframe: Airframe, mass: float, parameters: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Returns the variables of a vehicle on a surface, with its mass [kg] and its own parameters."""
    return (
        *VEHICLE_INPUTS,
        FORCE,
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED; it stays at its down coordinate",
        ),
        Parameter("yaw_start", unit="rad", start=0.0, description="initial heading, clockwise from north"),
        Parameter("mass", unit="kg", start=mass, minimum=1e-3, description="total mass"),
        Parameter(
            "windage",
            unit="N.s2/m2",
            start=0.0,
            minimum=0.0,
            description="force of the wind over the square of the air's relative speed; 0: none",
        ),
        *parameters,
        *outputs_of(airframe),
        Output("speed", unit="m/s", start=0.0, description="ahead, through the surface"),
        Output("on_ground", type=bool, start=True, verdict=Role.ON_GROUND, description="always true: it cannot fly"),
        Memory("heading"),  # rad
        Memory("slip"),  # m/s, to the right
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
    m.specific_force[2] = -GRAVITY
    m.speed = m.slip = 0.0
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
    if h >= _SHORTEST:
        rate = turn / h
        m.specific_force[0], m.specific_force[1] = (after - m.speed) / h, rate * after
        m.angular_velocity[2] = rate
    m.speed = after
    m.velocity[0] = after * cos(m.heading) + north
    m.velocity[1] = after * sin(m.heading) + east
    return isfinite(m.position[0] + m.position[1])


@kernel
def is_pushed(m: Any) -> bool:
    """Returns whether forces act on the vehicle, or it still slides from those that did."""
    return bool(m.force[0] != 0.0 or m.force[1] != 0.0 or m.windage > 0.0 or m.slip != 0.0)


@kernel
def push_of(m: Any) -> tuple[float, float]:
    """Returns the force of surroundings and wind on the vehicle: ahead and to the right [N]."""
    north, east = float(m.force[0]), float(m.force[1])
    if m.windage > 0.0:
        n, e = m.wind[0] - m.velocity[0], m.wind[1] - m.velocity[1]
        over = m.windage * sqrt(n * n + e * e)
        north, east = north + over * n, east + over * e
    c, s = cos(m.heading), sin(m.heading)
    return c * north + s * east, c * east - s * north


@kernel
def slide(m: Any, after: float, distance: float, h: float) -> bool:
    """Moves the vehicle sideways after `travel`; returns whether it still is at a finite place.

    Args:
        after: speed to the right at the end of the step [m/s].
        distance: distance to the right [m].
        h: duration of the step [s].
    """
    north, east = -sin(m.heading), cos(m.heading)
    m.position[0] += distance * north
    m.position[1] += distance * east
    m.velocity[0] += after * north
    m.velocity[1] += after * east
    if h >= _SHORTEST:
        m.specific_force[1] += (after - m.slip) / h
    m.slip = after
    return isfinite(m.position[0] + m.position[1])
