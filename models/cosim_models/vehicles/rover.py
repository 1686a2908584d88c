"""The ground rover FMU: front-wheel (Ackermann) or skid steering, and speed that follows the throttle with a lag.

Source: ArduPilot's own simulation, libraries/SITL/SIM_Rover.h and SIM_Rover.cpp, frames "rover" and "rover-skid". At
full throttle the speed approaches `speed_max` with the time constant speed_max / acceleration_max. With Ackermann
steering, the radius of the turn at a wheel angle d is turning_radius sin(wheel_angle_max) / sin(d); with skid steering,
the rate of turn is proportional to the command. The equations are solved exactly for a constant command.

It is a kinematic model, as the source is: no slopes, no inertia against turning. Forces of the surroundings (and of the
wind if `windage` is not 0) act on its `mass`: along it against the lag of the drive, across it against the friction of
its wheels, beyond which it slides.
"""

from __future__ import annotations

from enum import IntEnum
from math import exp, pi, radians, sin
from typing import Any, ClassVar

from cosim import Model, Parameter
from cosim.kernel import kernel
from cosim.vehicle import Airframe
from cosim_models.vehicles.surface import (
    GRAVITY,
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

__all__ = ["Rover", "Steering", "slid"]

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
def slid(slip: float, pull: float, grip: float, h: float) -> tuple[float, float]:
    """Returns speed [m/s] and distance [m] after `h` seconds of sliding with Coulomb friction, exactly.

    Args:
        slip: speed before [m/s].
        pull, grip: acceleration by the force, and the greatest one by friction [m/s2].
        h: duration [s].
    """
    distance = 0.0
    if slip != 0.0:
        rate = pull - grip if slip > 0.0 else pull + grip
        if slip * (slip + rate * h) > 0.0:
            return slip + rate * h, (slip + 0.5 * rate * h) * h
        stop = -slip / rate  # it comes to rest within the step
        distance, h = 0.5 * slip * stop, h - stop
    if abs(pull) <= grip:
        return 0.0, distance
    rate = pull - grip if pull > 0.0 else pull + grip
    return rate * h, distance + 0.5 * rate * h * h


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step of `h` seconds."""
    lag = m.speed_max / m.acceleration_max
    wanted, across, pushed = throttle_of(m) * m.speed_max, 0.0, is_pushed(m)
    if pushed:
        ahead, across = push_of(m)
        wanted += lag * ahead / m.mass
    gone = exp(-h / lag)
    after = wanted + (m.speed - wanted) * gone
    distance = wanted * h + (m.speed - wanted) * lag * (1.0 - gone)
    steering = steering_of(m)
    if m.steering == _SKID:
        turn = steering * m.skid_turn_rate * h
    else:
        turn = distance * sin(steering * m.wheel_angle_max) / (m.turning_radius * sin(m.wheel_angle_max))
    turn = min(max(turn, -_RATE_MAX * h), _RATE_MAX * h)
    is_finite = travel(m, after, distance, turn, 0.0, 0.0, h)
    if pushed:
        slip, aside = slid(float(m.slip), across / m.mass, m.grip * GRAVITY, h)
        is_finite = slide(m, slip, aside, h)
    return 0 if is_finite else 2


class Rover(Model):
    """Ground rover with Ackermann or skid steering (default: ArduPilot's simulated rover)."""

    step_size = STEP_SIZE
    variables = surface_variables(
        Airframe.rover,
        2.0,
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
            Parameter("grip", unit="1", start=0.8, minimum=0.0, description="friction coefficient across the wheels"),
        ),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "speed_max, acceleration_max, turning_radius and wheel_angle_max must be positive",
        2: "position is no longer finite: are the commands?",
    }
