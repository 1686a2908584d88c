"""The interface that all vehicle FMUs share, so that vehicles are interchangeable without changes to the autopilot.

A vehicle takes actuator commands and the wind. It outputs its true motion and its `airframe`, from which an autopilot
selects mixer and control laws during initialization. This module declares those ports; it contains no physics. Names
that a master knows are in `cosim.naming`.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum

from cosim.model import Input, Output, Variable
from cosim.naming import ATTITUDE, POSITION
from cosim.verdict import Role, Values

__all__ = [
    "ADDED_WIND",
    "ADDS_WIND",
    "AIRFRAME",
    "FORCE",
    "MAX_MOTORS",
    "MOTION_INPUTS",
    "POINT_MASS_ACCELERATION",
    "THRUST_FACTOR",
    "VEHICLE_INPUTS",
    "VEHICLE_OUTPUTS",
    "Airframe",
    "inputs_for",
    "outputs_of",
]

MAX_MOTORS = 8
"""Length of the `motor` port of every vehicle and autopilot; a vehicle with fewer motors ignores the rest."""

POINT_MASS_ACCELERATION = 20.0
"""Acceleration that the command 1 means to a point mass, and minus which 0 means [m/s2]."""


class Airframe(IntEnum):
    """Mixer and control family that a vehicle needs, and so the meaning of the elements of `motor`.

    Multirotors have one motor per element, numbered as in ArduPilot. The docstrings of the others are their meanings;
    elements that they do not name are ignored.
    """

    quad_x = 1
    hexa_x = 2
    octa_x = 3
    y6 = 4
    """ArduPilot's Y6B: three arms, one motor above and one below each"""
    point_mass = 5
    """acceleration north, east and down (0.5: none); the share of the weight that is carried (0: it falls)"""
    rover = 6
    """steering (0: full left, 0.5: straight, 1: full right); throttle (0: full reverse, 0.5: none, 1: full ahead)"""
    boat = 7
    """as for a rover"""
    plane = 8
    """aileron (1: roll right), elevator (1: nose up), throttle (0: none), rudder (1: nose right); servos rest at 0.5"""
    quad_plus = 9
    quadplane = 10
    """as for a plane, then four motors that lift, in ArduPilot's order of an X"""


VEHICLE_INPUTS: tuple[Variable, ...] = (
    Input("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="actuator commands, 0 (stopped) to 1 (full)"),
    Input(
        "wind",
        shape=3,
        unit="m/s",
        start=0.0,
        verdict=Role.OPTIONAL,
        description="velocity of the air over ground, NED",
    ),
)

FORCE = Input(
    "force",
    shape=3,
    unit="N",
    start=0.0,
    verdict=Role.OPTIONAL,
    description="force of other vehicles and obstacles at the centre of mass, NED",
)
"""Input of the vehicles that others can push."""

THRUST_FACTOR = Input(
    "thrust_factor",
    unit="1",
    start=1.0,
    verdict=Role.OPTIONAL,
    description="thrust over that far from the ground, at the same rotor speed",
)
"""Input of the vehicles whose thrust depends on the ground below."""

ADDED_WIND = Input(
    "added_wind",
    shape=3,
    unit="m/s",
    start=0.0,
    verdict=Role.OPTIONAL,
    description="velocity of the air that is added to `wind`, NED",
)
"""Input of the vehicles whose autopilot can ask for wind."""

ADDS_WIND = Output(
    "adds_wind", type=bool, start=True, verdict=Role.OPTIONAL, description="true: `added_wind` acts on the vehicle"
)
"""Output of the same vehicles, by which the autopilot knows that its wind arrives."""

_MOTION = (
    (POSITION, 3, "m", (0.0, 0.0, 0.0), "position relative to the local origin, NED (north, east, down)"),
    ("velocity", 3, "m/s", (0.0, 0.0, 0.0), "velocity over ground, NED"),
    (ATTITUDE, 4, "1", (1.0, 0.0, 0.0, 0.0), "unit quaternion w, x, y, z that rotates body FRD into NED"),
    ("angular_velocity", 3, "rad/s", (0.0, 0.0, 0.0), "angular velocity of the body, FRD"),
    ("specific_force", 3, "m/s2", (0.0, 0.0, -9.80665), "what an accelerometer measures at the centre of mass, FRD"),
)

AIRFRAME = Output("airframe", type=Airframe, start=Airframe.quad_x, description="which mixer the vehicle needs")

_ROLES = {
    POSITION: Role.POSITION,
    "velocity": Role.VELOCITY,
    ATTITUDE: Role.ATTITUDE,
    "angular_velocity": Role.ANGULAR_VELOCITY,
}

VEHICLE_OUTPUTS: tuple[Variable, ...] = (
    *(
        Output(
            name,
            shape=shape,
            unit=unit,
            start=start,
            verdict=_ROLES.get(name),
            description=description,
        )
        for name, shape, unit, start, description in _MOTION
    ),
    AIRFRAME,
)

MOTION_INPUTS: tuple[Variable, ...] = (
    *(
        Input(name, shape=shape, unit=unit, start=start, description=description)
        for name, shape, unit, start, description in _MOTION
    ),
    Input("airframe", type=Airframe, start=Airframe.quad_x, description="which mixer the vehicle needs"),
)


def outputs_of(airframe: Airframe) -> tuple[Variable, ...]:
    """Returns the outputs of every vehicle, for a vehicle of this airframe."""
    return tuple(
        replace(v, start=airframe, verdict=Values((airframe,))) if v.name == AIRFRAME.name else v
        for v in VEHICLE_OUTPUTS
    )


def inputs_for(*airframes: Airframe) -> tuple[Variable, ...]:
    """Returns the inputs of every autopilot, for one that flies these airframes."""
    return tuple(
        replace(v, start=airframes[0], verdict=Values(airframes)) if v.name == AIRFRAME.name else v
        for v in MOTION_INPUTS
    )
