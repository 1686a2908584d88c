"""The surface boat FMU: a motor that can reverse, a rudder, quadratic drag of the hull, and a current.

Source: ArduPilot's own simulation, libraries/SITL/SIM_Sailboat.h and SIM_Sailboat.cpp, frame "motorboat" (a sailboat
without a sail): 2 kg, 50 N of thrust, drag 0.5 N s2/m2, turning circle 1.8 m at 35 degrees of rudder; the radius of the
turn does not depend on the speed. Differences: no waves; it can be pushed aside by forces (and by the wind if `windage`
is not 0), against a resistance to sway that is ours, ten times that ahead. Speeds are integrated by the midpoint
method, the path exactly for a constant curvature. `linear_drag` and `sway_linear_drag` are for other sources.
"""

from __future__ import annotations

from math import radians, sin
from typing import Any, ClassVar

from cosim import Model, Parameter
from cosim.kernel import kernel
from cosim.vehicle import Airframe
from cosim_models.vehicles.surface import (
    STEP_SIZE,
    is_pushed,
    place,
    push_of,
    slide,
    steering_of,
    surface_variables,
    throttle_of,
    travel,
)

__all__ = ["Boat"]


@kernel
def start(m: Any) -> int:
    """Places the boat at rest in the water."""
    if not (m.mass > 0.0 and m.turning_radius > 0.0 and m.rudder_angle_max > 0.0):
        return 1
    place(m)
    m.velocity[0], m.velocity[1] = m.current[0], m.current[1]
    return 0


@kernel
def _acceleration(m: Any, thrust: float, speed: float) -> float:
    return float((thrust - m.hull_drag * speed * abs(speed) - m.linear_drag * speed) / m.mass)


@kernel
def _sway(m: Any, force: float, slip: float) -> float:
    """Returns the acceleration to the right [m/s2]."""
    return float((force - m.sway_drag * slip * abs(slip) - m.sway_linear_drag * slip) / m.mass)


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step of `h` seconds."""
    thrust, across, pushed = throttle_of(m) * m.thrust_max, 0.0, is_pushed(m)
    if pushed:
        ahead, across = push_of(m)
        thrust += ahead
    speed = float(m.speed)
    middle = speed + 0.5 * h * _acceleration(m, thrust, speed)
    after = speed + h * _acceleration(m, thrust, middle)
    distance = middle * h
    turn = distance * sin(steering_of(m) * m.rudder_angle_max) / (m.turning_radius * sin(m.rudder_angle_max))
    is_finite = travel(m, after, distance, turn, float(m.current[0]), float(m.current[1]), h)
    if pushed:
        slip = float(m.slip)
        middle = slip + 0.5 * h * _sway(m, across, slip)
        is_finite = slide(m, slip + h * _sway(m, across, middle), middle * h, h)
    return 0 if is_finite else 2


class Boat(Model):
    """Surface boat with motor and rudder (default: ArduPilot's simulated motor boat)."""

    step_size = STEP_SIZE
    variables = surface_variables(
        Airframe.boat,
        2.0,
        (
            Parameter("thrust_max", unit="N", start=50.0, minimum=0.0, description="at full throttle, also in reverse"),
            Parameter("hull_drag", unit="N.s2/m2", start=0.5, minimum=0.0, description="ahead, over speed squared"),
            Parameter("linear_drag", unit="N.s/m", start=0.0, minimum=0.0, description="ahead, over speed"),
            Parameter("sway_drag", unit="N.s2/m2", start=5.0, minimum=0.0, description="across, over speed squared"),
            Parameter("sway_linear_drag", unit="N.s/m", start=0.0, minimum=0.0, description="across, over speed"),
            Parameter("turning_radius", unit="m", start=0.9, minimum=1e-3, description="at full rudder"),
            Parameter(
                "rudder_angle_max", unit="rad", start=radians(35.0), minimum=1e-3, maximum=1.5, description="of it"
            ),
            Parameter("current", shape=2, unit="m/s", start=0.0, description="velocity of the water, north and east"),
        ),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "mass, turning_radius and rudder_angle_max must be positive",
        2: "position is no longer finite: are the commands?",
    }
