"""A multirotor as a rigid body: the variables and kernels shared by all multirotor FMUs.

The model has six degrees of freedom with a quaternion, up to eight rotors with lag, body drag, wind and flat ground. It
has no sensors. Its surroundings (`cosim_models.environment`) act by the inputs `wind`, `force` and `thrust_factor`, and
wind that an autopilot asks for by `added_wind`; a battery is a model of its own (`power_system`). The equations are in
`multirotor_dynamics`, `rigid_body`, `rotor` and `ground`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cosim import Memory, Output, Parameter, Variable
from cosim.model import Start
from cosim.vehicle import (
    ADDED_WIND,
    ADDS_WIND,
    FORCE,
    MAX_MOTORS,
    THRUST_FACTOR,
    VEHICLE_INPUTS,
    Airframe,
    outputs_of,
)
from cosim.verdict import Role, Rotors
from cosim_models.vehicles.dynamics.multirotor_dynamics import CONTACTS, ERRORS, advance, start
from cosim_models.vehicles.dynamics.rigid_body import Vector
from cosim_models.vehicles.dynamics.rotor import MotorCurve

__all__ = ["ERRORS", "KERNELS", "STEP_SIZE", "multirotor_variables", "started"]

STEP_SIZE = 0.0025
"""Communication step size of the vehicles [s]: ArduCopter's 400 Hz."""

KERNELS = (start, advance)


def multirotor_variables(
    *,
    airframe: Airframe,
    mass: float,
    inertia: Vector,
    rotor_x: Sequence[float],
    rotor_y: Sequence[float],
    rotor_z: Sequence[float],
    rotor_direction: Sequence[float],
    speed_min: float,
    speed_max: float,
    thrust_constant: float,
    moment_constant: float,
    time_constant_up: float,
    time_constant_down: float,
    axial_speed_limit: float,
    rotor_drag: float,
    rolling_moment: float,
) -> tuple[Variable, ...]:
    """Returns the variables of a multirotor FMU; the arguments are start values of the parameters of the same names.

    All multirotors have the same variables, so that one can replace another; only the values differ. Rotors are
    numbered as ArduPilot numbers them for `airframe`; their positions are given in FRD [m] from the centre of mass.

    Raises:
        ValueError: arguments of rotors have different lengths, or there are more rotors than a vehicle can have.
    """
    count = len(rotor_x)
    for name, given in (("rotor_y", rotor_y), ("rotor_z", rotor_z), ("rotor_direction", rotor_direction)):
        if len(given) != count:
            raise ValueError(f"rotor_x has {count} elements, {name} {len(given)}; give one for each rotor to both")
    if not 1 <= count <= MAX_MOTORS:
        raise ValueError(f"rotor_x has {count} elements; a multirotor has 1 to {MAX_MOTORS} rotors")
    spare = (0.0,) * (MAX_MOTORS - count)
    return (
        *VEHICLE_INPUTS,
        ADDED_WIND,
        FORCE,
        THRUST_FACTOR,
        Parameter("mass", unit="kg", start=mass, minimum=1e-3, description="total mass of the vehicle"),
        Parameter(
            "inertia",
            shape=3,
            unit="kg.m2",
            start=inertia,
            minimum=1e-9,
            description="principal moments about the centre of mass: roll, pitch, yaw",
        ),
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED",
        ),
        Parameter("yaw_start", unit="rad", start=0.0, description="initial heading, clockwise from north"),
        Parameter("rotor_count", type=int, start=count, minimum=1, maximum=MAX_MOTORS, description="rotors in use"),
        Parameter("rotor_x", shape=MAX_MOTORS, unit="m", start=(*rotor_x, *spare), description="hubs, forward"),
        Parameter("rotor_y", shape=MAX_MOTORS, unit="m", start=(*rotor_y, *spare), description="hubs, right"),
        Parameter("rotor_z", shape=MAX_MOTORS, unit="m", start=(*rotor_z, *spare), description="hubs, down"),
        Parameter(
            "rotor_direction",
            shape=MAX_MOTORS,
            unit="1",
            start=(*rotor_direction, *spare),
            description="+1 turns counter-clockwise seen from above, -1 clockwise",
        ),
        *_rotor_parameters(
            speed_min=speed_min,
            speed_max=speed_max,
            thrust_constant=thrust_constant,
            moment_constant=moment_constant,
            time_constant_up=time_constant_up,
            time_constant_down=time_constant_down,
            axial_speed_limit=axial_speed_limit,
            rotor_drag=rotor_drag,
            rolling_moment=rolling_moment,
        ),
        *_BODY_PARAMETERS,
        *outputs_of(airframe),
        Output(
            "rotor_speed",
            shape=MAX_MOTORS,
            unit="rad/s",
            start=0.0,
            verdict=Rotors("rotor_count", "rotor_x", "rotor_y", "rotor_z", "rotor_direction"),
            description="speed of each rotor",
        ),
        Output(
            "on_ground",
            type=bool,
            start=False,
            verdict=Role.ON_GROUND,
            description="the ground carries some of the weight",
        ),
        ADDS_WIND,
        *_MEMORY,
    )


def started(variables: Sequence[Variable], airframe: Airframe, **start: Start) -> tuple[Variable, ...]:
    """Returns the variables of a multirotor for another airframe, with other start values, by name of the variable.

    Raises:
        KeyError: there is no variable of a name.
    """
    for name in start.keys() - {v.name for v in variables}:
        raise KeyError(name)
    own = {v.name: v for v in outputs_of(airframe)}
    changed = (own.get(v.name, v) for v in variables)
    return tuple(replace(v, start=start[v.name]) if v.name in start else v for v in changed)


def _rotor_parameters(**start: float) -> tuple[Variable, ...]:
    """Declares the parameters shared by all rotors of a vehicle."""

    def parameter(name: str, unit: str, description: str) -> Variable:
        return Parameter(name, unit=unit, start=start[name], minimum=0.0, description=description)

    return (
        Parameter(
            "motor_curve",
            type=MotorCurve,
            start=MotorCurve.speed,
            description="speed: speed linear in the command, lag on speed; thrust: see thrust_expo, lag on thrust",
        ),
        Parameter("command_min", unit="1", start=0.0, description="command up to which a rotor is stopped"),
        Parameter("command_max", unit="1", start=1.0, description="command for full speed"),
        parameter("speed_min", "rad/s", "curve speed: rotor speed just above command_min"),
        parameter("speed_max", "rad/s", "rotor speed at command_max"),
        Parameter(
            "thrust_expo",
            unit="1",
            start=0.65,
            description="curve thrust: thrust / greatest = (1 - thrust_expo) c + thrust_expo c^2",
        ),
        parameter("thrust_constant", "N.s2/rad2", "thrust over speed squared"),
        parameter("moment_constant", "m", "drag torque over thrust"),
        parameter("time_constant_up", "s", "lag while speeding up"),
        parameter("time_constant_down", "s", "lag while slowing down"),
        parameter("axial_speed_limit", "m/s", "axial air speed at which thrust falls linearly to zero; 0: no loss"),
        parameter("rotor_drag", "N.s2/(rad.m)", "force against air flow across the axis, over rotor and air speed"),
        parameter("rolling_moment", "N.s2/rad", "moment against air flow across the axis, over rotor and air speed"),
        Parameter(
            "rotor_inertia",
            unit="kg.m2",
            start=0.0,
            minimum=0.0,
            description="inertia of one rotor about its axis, for gyroscopic and spin-up torque; 0: none",
        ),
    )


_BODY_PARAMETERS = (
    Parameter("linear_drag", unit="N.s/m", start=0.0, minimum=0.0, description="body drag over air speed"),
    Parameter("quadratic_drag", unit="N.s2/m2", start=0.0, minimum=0.0, description="body drag over air speed squared"),
    Parameter(
        "drag_by_axis",
        type=bool,
        start=False,
        description="quadratic_drag acts by the air speed of each axis, rotor_drag also along the rotors' axis, as in "
        "ArduPilot's simulation",
    ),
    Parameter(
        "inflow_loss",
        unit="N.s2/m2",
        start=0.0,
        minimum=0.0,
        description="thrust that each rotor loses over the square of the speed at which it moves through the air along "
        "its thrust",
    ),
    Parameter(
        "moment_by_command",
        type=bool,
        start=False,
        description="with drag_by_axis, moment_constant is that of full command and falls with the command, as in "
        "ArduPilot's simulation",
    ),
    Parameter(
        "rotational_damping",
        shape=3,
        unit="N.m.s/rad",
        start=0.0,
        minimum=0.0,
        description="torque against angular velocity: roll, pitch, yaw",
    ),
    Parameter("ground_height", unit="m", start=0.0, description="down coordinate at which the vehicle stands"),
    Parameter(
        "ground_deflection", unit="m", start=0.005, minimum=1e-6, description="deflection of the feet under the weight"
    ),
    Parameter("ground_damping", unit="1", start=0.7, minimum=0.0, description="damping ratio of the feet"),
    Parameter("ground_friction", unit="1", start=0.6, minimum=0.0, description="Coulomb friction coefficient"),
    Parameter(
        "held_by_ground",
        type=bool,
        start=False,
        description="the ground is that of ArduPilot's simulation: it holds a vehicle upright until this climbs at "
        "1.2 m/s",
    ),
    Parameter("foot_radius", unit="m", start=0.2, minimum=0.0, description="four feet, this far from the down axis"),
    Parameter(
        "foot_height", unit="m", start=0.1, minimum=0.0, description="height of the centre of mass above the feet"
    ),
    Parameter("substep", unit="s", start=STEP_SIZE, minimum=1e-6, description="longest integration step"),
)

_MEMORY = (
    Memory("stage_speed", shape=(3, MAX_MOTORS)),  # rad/s at the start, middle and end of a sub-step
    Memory("stage_slew", shape=(3, MAX_MOTORS)),  # its derivative, rad/s2
    Memory("target", shape=MAX_MOTORS),  # target of the lag: rad/s, or rad2/s2 for the thrust curve
    Memory("decay_step"),  # sub-step for which the next two values are valid, s
    Memory("decay_up"),
    Memory("decay_down"),
    Memory("contact", shape=(CONTACTS, 3)),  # feet, then hubs, FRD, m
    Memory("anchor", shape=(CONTACTS, 2)),  # anchors of friction, north and east, m
    Memory("reach"),  # longest distance of a contact from the centre of mass, m
    Memory("ground_stiffness"),  # of one contact, N/m
    Memory("ground_damper"),  # of one contact, N s/m
    Memory("surface"),  # down coordinate of the ground, m
    Memory("thrust_now"),  # thrust over speed squared in the surroundings, N s2/rad2
    Memory("wind_before", shape=3),  # m/s, that of the step before
    Memory("added_wind_before", shape=3),  # m/s
    Memory("force_before", shape=3),  # N
    Memory("motion_before", shape=13),  # position, velocity, angular velocity, attitude at the end of the step before
    Memory("kept_acceleration", shape=3),  # at the end of the step before, m/s2, NED
    Memory("kept_turning", shape=3),  # angular acceleration at the end of the step before, rad/s2, FRD
    Memory("rests", dtype="?"),  # whether it stands still on the ground, and would go on to
    Memory("is_pushed", dtype="?"),  # whether the force of the surroundings is not zero
    Memory("is_blown", dtype="?"),  # whether there is added wind
    Memory("vanishing"),  # 1 / axial_speed_limit, s/m
    Memory("per_mass"),  # 1 / mass, 1/kg
    Memory("per_inertia", shape=3),  # 1 / inertia, 1/(kg m2)
)
