"""The ground rover FMU: front-wheel (Ackermann) or skid steering, and speed that follows the throttle with a lag.

Source: ArduPilot's own simulation, libraries/SITL/SIM_Rover.h and SIM_Rover.cpp, frames "rover" and "rover-skid". At
full throttle the speed approaches `speed_max` with the time constant speed_max / acceleration_max. With Ackermann
steering, the radius of the turn at a wheel angle d is turning_radius sin(wheel_angle_max) / sin(d); with skid steering,
the rate of turn is proportional to the command. The equations are solved exactly for a constant command.

It is a kinematic model, as the source is: no slip, no slopes, no inertia against turning. Wind has no effect.
"""

from __future__ import annotations

from enum import IntEnum
from math import exp, pi, radians, sin
from typing import Any, ClassVar

from cosim import Model, Parameter
from cosim.kernel import kernel
from cosim.vehicle import Airframe
from cosim_models.vehicles.surface import STEP_SIZE, place, steering_of, surface_variables, throttle_of, travel

__all__ = ["Rover", "Steering"]

_RATE_MAX = 2.0 * pi  # rad/s, MAX_YAW_RATE of the source


class Steering(IntEnum):
    """How a rover turns."""

    ackermann = 1
    skid = 2


_SKID = int(Steering.skid)


@kernel
def start(m: Any) -> int:
    """Places the rover at rest."""
    if not (m.speed_max > 0.0 and m.acceleration_max > 0.0 and m.turning_radius > 0.0 and m.wheel_angle_max > 0.0):
        return 1
    place(m)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step of `h` seconds."""
    lag = m.speed_max / m.acceleration_max
    wanted = throttle_of(m) * m.speed_max
    gone = exp(-h / lag)
    after = wanted + (m.speed - wanted) * gone
    distance = wanted * h + (m.speed - wanted) * lag * (1.0 - gone)
    steering = steering_of(m)
    if m.steering == _SKID:
        turn = steering * m.skid_turn_rate * h
    else:
        turn = distance * sin(steering * m.wheel_angle_max) / (m.turning_radius * sin(m.wheel_angle_max))
    turn = min(max(turn, -_RATE_MAX * h), _RATE_MAX * h)
    return 0 if travel(m, after, distance, turn, 0.0, 0.0, h) else 2


class Rover(Model):
    """Ground rover with Ackermann or skid steering (default: ArduPilot's simulated rover)."""

    step_size = STEP_SIZE
    variables = surface_variables(
        Airframe.rover,
        (
            Parameter("steering", type=Steering, start=Steering.ackermann, description="how it turns"),
            Parameter("speed_max", unit="m/s", start=20.0, minimum=1e-3, description="at full throttle"),
            Parameter(
                "acceleration_max", unit="m/s2", start=10.0, minimum=1e-3, description="at full throttle, at rest"
            ),
            Parameter("turning_radius", unit="m", start=0.9, minimum=1e-3, description="at full steering, Ackermann"),
            Parameter(
                "wheel_angle_max", unit="rad", start=radians(35.0), minimum=1e-3, maximum=1.5, description="of it"
            ),
            Parameter("skid_turn_rate", unit="rad/s", start=radians(140.0), minimum=0.0, description="skid steering"),
        ),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "speed_max, acceleration_max, turning_radius and wheel_angle_max must be positive",
        2: "position is no longer finite: are the commands?",
    }
