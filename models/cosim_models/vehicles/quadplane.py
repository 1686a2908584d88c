"""The quadplane FMU: a fixed wing with four rotors that lift, and no part that tilts.

The default parameters are those of ArduPilot's simulated quadplane. Source: libraries/SITL/SIM_QuadPlane.cpp adds the
accelerations of SIM_Plane (a Skywalker 2013; see presets/ardupilot_plane.ssv) and of the rotors of SIM_Frame's X of 3
kg (see presets/ardupilot_sitl_quad.ssv). There the plane has 2 kg, and each of the two a moment of inertia of its own;
here it is one body of 3 kg with the inertia of the plane, on which both act.

The air acts as on `FixedWing`, whose lift is that of a flat plate beyond the stall; so are drag and pitching moment
here, as rotors lift the wing at any angle of attack. The normal force of the plate is in the middle of the chord. The
lag of the rotors' thrust is solved exactly; forces are those at the end of each sub-step. The wake of the rotors on the
wing is not modelled.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, sin, sqrt
from typing import Any, ClassVar

from cosim import Model, Output, Parameter
from cosim.kernel import kernel
from cosim.model import Start, Variable
from cosim.vehicle import THRUST_FACTOR, Airframe, outputs_of
from cosim_models.vehicles.dynamics.rigid_body import Vector
from cosim_models.vehicles.dynamics.rotor import decay, lagged, rotor_force, rotor_moment, thrust_command
from cosim_models.vehicles.fixed_wing import FixedWing, lift_coefficient, stalled, wing_forces, wing_kernels

__all__ = ["Quadplane"]

_FIRST, _ROTORS = 4, 4  # of the elements of `motor`; number of rotors
_SIDE = 0.35 * sqrt(0.5)  # m
_NO_ROTORS = 5


@kernel
def _coefficients(m: Any, alpha: float) -> tuple[float, float, float]:
    """Returns the coefficients of lift, drag and pitching moment at any angle of attack."""
    blend = stalled(m, alpha)
    straight = m.lift_0 + m.lift_alpha * alpha
    induced = straight * straight * m.wing_area / (pi * m.efficiency * m.wing_span * m.wing_span)
    normal = 2.0 * sin(alpha) * abs(sin(alpha))  # of a flat plate
    behind = 0.25 - m.pitch_alpha / m.lift_alpha  # chords: of the middle of the chord behind the centre of mass
    return (
        lift_coefficient(m, alpha),
        m.drag_0 + (1.0 - blend) * induced + blend * normal * sin(alpha),
        (1.0 - blend) * (m.pitch_0 + m.pitch_alpha * alpha) - blend * behind * normal,
    )


_wing = wing_forces(_coefficients)


@kernel
def _forces(m: Any, air: Vector, rates: Vector) -> tuple[Vector, Vector]:
    """Returns force [N] and torque [N m] of air, propeller and rotors, FRD."""
    force, torque = _wing(m, air, rates)
    fx, fy, fz = force
    mx, my, mz = torque
    for i in range(_ROTORS):
        speed = float(m.rotor_speed[i])
        if speed == 0.0:
            continue
        x, y = float(m.rotor_x[i]), float(m.rotor_y[i])
        hub = (air[0] - rates[2] * y, air[1] + rates[2] * x, air[2] + rates[0] * y - rates[1] * x)
        thrust = m.thrust_constant * m.thrust_factor * speed * speed
        f = rotor_force(speed, thrust, hub, 0.0, m.rotor_drag)
        t = rotor_moment(speed, thrust, hub, float(m.rotor_direction[i]), m.moment_constant, 0.0)
        fx, fy, fz = fx + f[0], fy + f[1], fz + f[2]
        mx, my, mz = mx + t[0] + y * f[2], my + t[1] - x * f[2], mz + t[2] + x * f[1] - y * f[0]
    return (fx, fy, fz), (mx, my, mz)


@kernel
def _turn_rotors(m: Any, h: float) -> None:
    """Advances the thrust of the rotors by `h` seconds of a constant command."""
    left = decay(m.rotor_time_constant, h)
    full = m.speed_max * m.speed_max
    for i in range(_ROTORS):
        part = thrust_command(float(m.motor[_FIRST + i]), m.command_min, m.command_max, m.thrust_expo)
        m.rotor_speed[i] = sqrt(lagged(float(m.rotor_speed[i]) ** 2, part * full, left))


@kernel
def _check(m: Any) -> int:
    if not (m.speed_max > 0.0 and m.thrust_constant > 0.0 and m.command_max > m.command_min and m.lift_alpha > 0.0):
        return _NO_ROTORS
    return 0


_BODY: dict[str, Start] = {
    "mass": 3.0,
    "inertia": (1.0, 1.0, 1.0),
    "inertia_xz": 0.0,
    "wing_area": 0.45,
    "wing_span": 1.88,
    "wing_chord": 0.24,
    "efficiency": 0.9,
    "propeller_area": 0.008339,
    "motor_speed": 60.0,
    "air_density": 1.225,
    "deflection_max": 1.0,
    "stall_angle": 0.4712,
    "lift_0": 0.56,
    "lift_alpha": 6.9,
    "lift_q": 0.0,
    "lift_elevator": 0.0,
    "drag_0": 0.1,
    "side_beta": -0.98,
    "side_rudder": 0.2,
    "roll_beta": -0.146064,
    "roll_p": -1.0,
    "roll_r": 0.14,
    "roll_aileron": 0.25,
    "roll_rudder": 0.042319,
    "pitch_0": -0.281225,
    "pitch_alpha": -5.127994,
    "pitch_q": -20.0,
    "pitch_elevator": -1.0,
    "yaw_beta": 0.328191,
    "yaw_p": 0.022,
    "yaw_r": -1.0,
    "yaw_aileron": 0.0,
    "yaw_rudder": -0.115957,
    "substep": 0.005,
}
"""Start values of `FixedWing`'s parameters: those of presets/ardupilot_plane.ssv, and the mass of the X."""


def _body() -> tuple[Variable, ...]:
    own = {v.name: v for v in outputs_of(Airframe.quadplane)}
    changed = (own.get(v.name, v) for v in FixedWing.variables)
    return tuple(replace(v, start=_BODY[v.name]) if v.name in _BODY else v for v in changed)


def _rotor(name: str, unit: str, start: float, description: str) -> Variable:
    return Parameter(name, unit=unit, start=start, minimum=0.0, description=description)


class Quadplane(Model):
    """Fixed wing with four lifting rotors (default: ArduPilot's simulated quadplane)."""

    step_size = 0.005
    variables = (
        *_body(),
        THRUST_FACTOR,
        Parameter(
            "rotor_x", shape=_ROTORS, unit="m", start=(_SIDE, -_SIDE, _SIDE, -_SIDE), description="hubs, forward"
        ),
        Parameter("rotor_y", shape=_ROTORS, unit="m", start=(_SIDE, -_SIDE, -_SIDE, _SIDE), description="hubs, right"),
        Parameter(
            "rotor_direction",
            shape=_ROTORS,
            unit="1",
            start=(1.0, 1.0, -1.0, -1.0),
            description="+1 turns counter-clockwise seen from above, -1 clockwise",
        ),
        _rotor("command_min", "1", 0.15, "command up to which a rotor is stopped"),
        _rotor("command_max", "1", 0.95, "command for full speed"),
        _rotor("speed_max", "rad/s", 1000.0, "rotor speed at command_max"),
        _rotor("thrust_expo", "1", 0.65, "thrust / greatest = (1 - thrust_expo) c + thrust_expo c^2"),
        _rotor("thrust_constant", "N.s2/rad2", 1.88589e-05, "thrust over speed squared"),
        _rotor("moment_constant", "m", 0.0096, "drag torque over thrust"),
        _rotor("rotor_drag", "N.s2/(rad.m)", 0.0002898, "force against air flow across the axis"),
        _rotor("rotor_time_constant", "s", 0.003, "lag of the thrust"),
        Output("rotor_speed", shape=_ROTORS, unit="rad/s", start=0.0, description="speed of each lifting rotor"),
    )
    kernels = wing_kernels(_forces, _check, _turn_rotors)
    errors: ClassVar = {
        **FixedWing.errors,
        _NO_ROTORS: "speed_max, thrust_constant and lift_alpha must be positive, and command_max more than command_min",
    }
