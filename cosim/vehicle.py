"""The interface that all vehicle FMUs share, so that vehicles are interchangeable without changes to the autopilot.

A vehicle takes actuator commands and the wind. It outputs its true motion and its `airframe`, from which an autopilot
selects mixer and control laws during initialization. This module declares those ports; it contains no physics.

**Naming convention.** Models declare the meaning of their variables (`cosim.verdict`). FMUs of other tools usually do
not. For these, a master infers the meaning from the following names, and from no others:

    AUTOPILOT      the component of a vehicle's system to which a cable connects
    VEHICLE        the component of a vehicle's system whose POSITION is the position of the vehicle
    POSITION       Real output with 3 elements: position of the vehicle, NED from the local origin [m]
    ATTITUDE       Real output with 4 elements: unit quaternion w, x, y, z that rotates body FRD into NED
    STEP, TARGET   outputs of an agent: number of the current step, and desired position in m east of the origin
    LINES          packet ports for ground stations by radio, and for a cable, and for nothing else
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from cosim.model import Input, Output, Variable
from cosim.verdict import Role

__all__ = [
    "AIRFRAME",
    "ATTITUDE",
    "AUTOPILOT",
    "LINES",
    "MAX_MOTORS",
    "MOTION_INPUTS",
    "POSITION",
    "STEP",
    "TARGET",
    "VEHICLE",
    "VEHICLE_INPUTS",
    "VEHICLE_OUTPUTS",
    "Airframe",
]

AUTOPILOT, VEHICLE = "autopilot", "vehicle"
POSITION, ATTITUDE = "position", "attitude"
STEP, TARGET = "step", "target"
LINES: Mapping[Role, tuple[str, str]] = {
    Role.TELEMETRY: ("telemetry_rx", "telemetry_tx"),
    Role.SERIAL: ("serial_rx", "serial_tx"),
}
"""Names of the input and of the output."""

MAX_MOTORS = 8
"""Length of the `motor` port of every vehicle and autopilot; a vehicle with fewer motors ignores the rest."""


class Airframe(IntEnum):
    """Mixer and control family that a vehicle needs. Motors are numbered as in ArduPilot."""

    quad_x = 1
    hexa_x = 2
    octa_x = 3


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

_MOTION = (
    (POSITION, 3, "m", (0.0, 0.0, 0.0), "position relative to the local origin, NED (north, east, down)"),
    ("velocity", 3, "m/s", (0.0, 0.0, 0.0), "velocity over ground, NED"),
    (ATTITUDE, 4, "1", (1.0, 0.0, 0.0, 0.0), "unit quaternion w, x, y, z that rotates body FRD into NED"),
    ("angular_velocity", 3, "rad/s", (0.0, 0.0, 0.0), "angular velocity of the body, FRD"),
    ("specific_force", 3, "m/s2", (0.0, 0.0, -9.80665), "what an accelerometer measures at the centre of mass, FRD"),
)

AIRFRAME = Output("airframe", type=Airframe, start=Airframe.quad_x, description="which mixer the vehicle needs")

_ROLES = {POSITION: Role.POSITION, ATTITUDE: Role.ATTITUDE}

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
