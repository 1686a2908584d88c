"""The fixed wing FMU: rigid body with aerodynamic coefficients, propeller, wind, and a runway.

The default parameters are those of the Aerosonde. Source: R. W. Beard, T. W. McLain, Small Unmanned Aircraft, Princeton
2012, chapters 3 and 4 (equations) and appendix E.2 (numbers). Differences: deflections are limited to `deflection_max`,
and the landing gear is ours. Their propeller is very strong (about six times the weight at standstill).

The state is integrated by the classical fourth-order Runge-Kutta method in sub-steps of at most `substep`. Frames: NED
for position, velocity and wind, FRD for all quantities fixed to the body.
"""

from __future__ import annotations

from collections.abc import Callable
from math import asin, atan2, ceil, cos, exp, isfinite, pi, radians, sin, sqrt, tanh
from typing import Any, ClassVar

from cosim import Model, Output, Parameter
from cosim.frames import derivative, normalize, quaternion_from_euler
from cosim.kernel import kernel
from cosim.vehicle import FORCE, VEHICLE_INPUTS, Airframe, outputs_of
from cosim.verdict import Role
from cosim_models.vehicles.dynamics.rigid_body import (
    Matrix,
    Quaternion,
    Vector,
    along,
    along4,
    from_body,
    load,
    load4,
    rotation_matrix,
    to_body,
)

__all__ = ["Air", "FixedWing", "lift_coefficient", "stalled", "wing_forces", "wing_kernels"]

_GRAVITY = 9.80665
_STALL_RATE = 50.0  # M of the source: how sharply lift turns into that of a flat plate
_AILERON, _ELEVATOR, _THROTTLE, _RUDDER = 0, 1, 2, 3  # elements of `motor`
_GEAR_DEPTH = 0.02  # m of deflection under the weight
_ROLLING, _SIDEWAYS = 0.02, 0.8  # friction coefficients of the wheels
_CREEP = 0.1  # m/s, below which friction grows with speed
_TRACK = 0.5  # m: lever of the gear's levelling torques


Air = Callable[[Any, Vector, Vector], tuple[Vector, Vector]]
"""A kernel of (record, airspeed [m/s, FRD], rates [rad/s, FRD]) that returns force [N] and torque [N m], FRD."""


# ---- forces --------------------------------------------------------------------------------------------------------


@kernel
def _deflection(m: Any, i: int) -> float:
    return float(m.deflection_max * (2.0 * min(max(float(m.motor[i]), 0.0), 1.0) - 1.0))


@kernel
def stalled(m: Any, alpha: float) -> float:
    """Returns how far the wing is that of a flat plate: 0 before the stall, 1 beyond it."""
    before, after = exp(-_STALL_RATE * (alpha - m.stall_angle)), exp(_STALL_RATE * (alpha + m.stall_angle))
    return float((1.0 + before + after) / ((1.0 + before) * (1.0 + after)))


@kernel
def lift_coefficient(m: Any, alpha: float) -> float:
    """Returns the lift coefficient, blended into that of a flat plate beyond the stall."""
    blend = stalled(m, alpha)
    sign = 1.0 if alpha > 0.0 else -1.0
    plate = 2.0 * sign * sin(alpha) * sin(alpha) * cos(alpha)
    return float((1.0 - blend) * (m.lift_0 + m.lift_alpha * alpha) + blend * plate)


@kernel
def _coefficients(m: Any, alpha: float) -> tuple[float, float, float]:
    """Returns the coefficients of lift, drag and pitching moment by the angle of attack alone."""
    straight = m.lift_0 + m.lift_alpha * alpha
    induced = straight * straight * m.wing_area / (pi * m.efficiency * m.wing_span * m.wing_span)
    return lift_coefficient(m, alpha), m.drag_0 + induced, m.pitch_0 + m.pitch_alpha * alpha


def wing_forces(coefficients: Callable[[Any, float], tuple[float, float, float]]) -> Air:
    """Returns a kernel for force and torque of air and propeller.

    Args:
        coefficients: a kernel of (record, angle of attack [rad]) for those of lift, drag and pitching moment.
    """

    @kernel
    def forces(m: Any, air: Vector, rates: Vector) -> tuple[Vector, Vector]:
        """Returns force [N] and torque [N m] of the air, FRD, at the airspeed `air` [m/s, FRD]."""
        throttle = min(max(float(m.motor[_THROTTLE]), 0.0), 1.0)
        speed = sqrt(air[0] * air[0] + air[1] * air[1] + air[2] * air[2])
        jet = m.motor_speed * throttle
        thrust = 0.5 * m.air_density * m.propeller_area * (jet * jet - air[0] * abs(air[0]))
        if speed < 1e-3:
            return (thrust, 0.0, 0.0), (0.0, 0.0, 0.0)
        alpha = min(max(atan2(air[2], air[0]), -0.5 * pi), 0.5 * pi)
        beta = asin(min(max(air[1] / speed, -1.0), 1.0))
        aileron, elevator, rudder = _deflection(m, _AILERON), -_deflection(m, _ELEVATOR), -_deflection(m, _RUDDER)
        area = 0.5 * m.air_density * speed * speed * m.wing_area
        p, q, r = (
            0.5 * m.wing_span * rates[0] / speed,
            0.5 * m.wing_chord * rates[1] / speed,
            0.5 * m.wing_span * rates[2] / speed,
        )
        lift_of, drag_of, pitch_of = coefficients(m, alpha)
        lift = area * (lift_of + m.lift_q * q + m.lift_elevator * elevator)
        drag = area * drag_of
        side = area * (m.side_beta * beta + m.side_rudder * rudder)
        force = (
            thrust - drag * cos(alpha) + lift * sin(alpha),
            side,
            -drag * sin(alpha) - lift * cos(alpha),
        )
        roll = m.roll_beta * beta + m.roll_p * p + m.roll_r * r + m.roll_aileron * aileron + m.roll_rudder * rudder
        pitch = pitch_of + m.pitch_q * q + m.pitch_elevator * elevator
        yaw = m.yaw_beta * beta + m.yaw_p * p + m.yaw_r * r + m.yaw_aileron * aileron + m.yaw_rudder * rudder
        return force, (area * m.wing_span * roll, area * m.wing_chord * pitch, area * m.wing_span * yaw)

    return forces


@kernel
def _gear(m: Any, depth: float, sink: float, body: Vector, r: Matrix, rates: Vector) -> tuple[Vector, Vector]:
    """Returns force [N] and torque [N m] of the wheels, FRD: they roll ahead and keep the wings level."""
    stiffness = m.mass * _GRAVITY / _GEAR_DEPTH
    normal = max(stiffness * depth + 1.4 * sqrt(stiffness * m.mass) * sink, 0.0)
    up = to_body(r, (0.0, 0.0, -normal))
    lean, nose = r[7], r[6]  # sines: right side down, and minus of the nose up
    ahead = -_ROLLING * normal * tanh(body[0] / _CREEP)
    across = -_SIDEWAYS * normal * tanh(body[1] / _CREEP)
    arm = normal * _TRACK
    torque = (
        -arm * (lean + 0.5 * rates[0]),
        arm * (max(nose, 0.0) - 0.5 * rates[1] * (1.0 if nose > 0.0 else 0.1)),
        -0.5 * arm * rates[2],
    )
    return (up[0] + ahead, up[1] + across, up[2]), torque


@kernel
def _turning(m: Any, rates: Vector, torque: Vector) -> Vector:
    """Solves Euler's equation with the product of inertia Jxz [rad/s2, FRD]."""
    jx, jy, jz, jxz = float(m.inertia[0]), float(m.inertia[1]), float(m.inertia[2]), float(m.inertia_xz)
    p, q, r = rates
    hx, hy, hz = jx * p - jxz * r, jy * q, jz * r - jxz * p
    tx, ty, tz = torque[0] - (q * hz - r * hy), torque[1] - (r * hx - p * hz), torque[2] - (p * hy - q * hx)
    gamma = jx * jz - jxz * jxz
    return (jz * tx + jxz * tz) / gamma, ty / jy, (jxz * tx + jx * tz) / gamma


def _accelerations_of(air_of: Air) -> Callable[..., tuple[Vector, Vector, Vector]]:
    """Returns a kernel for the accelerations of a vehicle on which the air acts by `air_of`."""

    @kernel
    def accelerations(m: Any, x: Vector, v: Vector, q: Quaternion, w: Vector) -> tuple[Vector, Vector, Vector]:
        """Returns acceleration [m/s2, NED], angular acceleration [rad/s2, FRD] and specific force [m/s2, FRD]."""
        r = rotation_matrix(q)
        force, torque = air_of(m, to_body(r, (v[0] - m.wind[0], v[1] - m.wind[1], v[2] - m.wind[2])), w)
        depth = x[2] - m.ground_height + _GEAR_DEPTH
        if depth > 0.0:
            push, turn = _gear(m, depth, v[2], to_body(r, v), r, w)
            force, torque = along(force, 1.0, push), along(torque, 1.0, turn)
        if m.force[0] != 0.0 or m.force[1] != 0.0 or m.force[2] != 0.0:
            force = along(force, 1.0, to_body(r, load(m.force)))
        specific = (force[0] / m.mass, force[1] / m.mass, force[2] / m.mass)
        a = from_body(r, specific)
        return (a[0], a[1], a[2] + _GRAVITY), _turning(m, w, torque), specific

    return accelerations


# ---- the kernels of the FMU ----------------------------------------------------------------------------------------


@kernel
def _place(m: Any) -> int:
    """Checks the parameters and places the vehicle; returns the code of an error, or 0."""
    if not (m.mass > 0.0 and m.wing_area > 0.0 and m.wing_span > 0.0 and m.substep > 0.0):
        return 1
    if m.position_start[2] > m.ground_height:
        return 2
    if m.inertia[0] * m.inertia[2] <= m.inertia_xz * m.inertia_xz or m.inertia[1] <= 0.0:
        return 4
    q = quaternion_from_euler(0.0, 0.0, float(m.yaw_start))
    for i in range(4):
        m.attitude[i] = q[i]
    for i in range(3):
        m.position[i] = m.position_start[i]
        m.angular_velocity[i] = 0.0
    m.velocity[0], m.velocity[1], m.velocity[2] = (
        m.speed_start * cos(m.yaw_start),
        m.speed_start * sin(m.yaw_start),
        0.0,
    )
    return 0


def _step_of(accelerations: Callable[..., tuple[Vector, Vector, Vector]]) -> Callable[[Any, float], None]:
    """Returns a kernel for one step of integration."""

    @kernel
    def step(m: Any, h: float) -> None:
        """Makes one Runge-Kutta step of `h` seconds."""
        x, v, q, w = load(m.position), load(m.velocity), load4(m.attitude), load(m.angular_velocity)
        a1, b1, _ = accelerations(m, x, v, q, w)
        q1 = derivative(q, w)
        v2, w2 = along(v, 0.5 * h, a1), along(w, 0.5 * h, b1)
        q2 = along4(q, 0.5 * h, q1)
        a2, b2, _ = accelerations(m, along(x, 0.5 * h, v), v2, q2, w2)
        d2 = derivative(q2, w2)
        v3, w3 = along(v, 0.5 * h, a2), along(w, 0.5 * h, b2)
        q3 = along4(q, 0.5 * h, d2)
        a3, b3, _ = accelerations(m, along(x, 0.5 * h, v2), v3, q3, w3)
        d3 = derivative(q3, w3)
        v4, w4 = along(v, h, a3), along(w, h, b3)
        q4 = along4(q, h, d3)
        a4, b4, _ = accelerations(m, along(x, h, v3), v4, q4, w4)
        d4 = derivative(q4, w4)
        sixth = h / 6.0
        for i in range(3):
            m.position[i] = x[i] + sixth * (v[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i])
            m.velocity[i] = v[i] + sixth * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i])
            m.angular_velocity[i] = w[i] + sixth * (b1[i] + 2.0 * b2[i] + 2.0 * b3[i] + b4[i])
        turned = (
            q[0] + sixth * (q1[0] + 2.0 * d2[0] + 2.0 * d3[0] + d4[0]),
            q[1] + sixth * (q1[1] + 2.0 * d2[1] + 2.0 * d3[1] + d4[1]),
            q[2] + sixth * (q1[2] + 2.0 * d2[2] + 2.0 * d3[2] + d4[2]),
            q[3] + sixth * (q1[3] + 2.0 * d2[3] + 2.0 * d3[3] + d4[3]),
        )
        unit = normalize(turned)
        for i in range(4):
            m.attitude[i] = unit[i]

    return step


@kernel
def _fine(m: Any) -> int:  # noqa: ARG001
    return 0


@kernel
def _nothing(m: Any, h: float) -> None:
    pass


def wing_kernels(
    air_of: Air, check: Callable[[Any], int] = _fine, turn: Callable[[Any, float], None] = _nothing
) -> tuple[Any, Any]:
    """Returns the kernels of a vehicle with wings and wheels.

    Args:
        air_of: gives the forces of the air.
        check: a kernel of the record that returns the code of an error in further parameters, or 0.
        turn: a kernel of (record, seconds) that advances the state of rotors.
    """
    accelerations = _accelerations_of(air_of)
    step = _step_of(accelerations)

    @kernel
    def publish(m: Any) -> None:
        """Updates the outputs that depend on the state."""
        m.on_ground = m.position[2] > m.ground_height - _GEAR_DEPTH
        _, _, specific = accelerations(
            m, load(m.position), load(m.velocity), load4(m.attitude), load(m.angular_velocity)
        )
        for i in range(3):
            m.specific_force[i] = specific[i]

    @kernel
    def start(m: Any) -> int:
        """Places the vehicle at rest on its wheels, or in flight if `speed_start` is not 0."""
        code = _place(m)
        if code == 0:
            code = check(m)
        if code == 0:
            publish(m)
        return int(code)

    @kernel
    def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
        """Makes one step of `h` seconds."""
        count = max(ceil(h / m.substep - 1e-9), 1)
        for _ in range(count):
            turn(m, h / count)
            step(m, h / count)
        if not isfinite(m.position[0] + m.velocity[0] + m.attitude[0] + m.angular_velocity[0] + m.position[2]):
            return 3
        publish(m)
        return 0

    return start, advance


def _number(name: str, unit: str, start: float, description: str) -> Any:
    return Parameter(name, unit=unit, start=start, description=description)


class FixedWing(Model):
    """Fixed wing with propeller, ailerons, elevator and rudder (default: Aerosonde)."""

    step_size = 0.0125
    variables = (
        *VEHICLE_INPUTS,
        FORCE,
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED",
        ),
        _number("yaw_start", "rad", 0.0, "initial heading, clockwise from north"),
        _number("speed_start", "m/s", 0.0, "initial speed ahead"),
        _number("ground_height", "m", 0.0, "down coordinate at which the vehicle stands"),
        _number("mass", "kg", 13.5, "total mass"),
        Parameter("inertia", shape=3, unit="kg.m2", start=(0.8244, 1.135, 1.759), description="Jx, Jy, Jz"),
        _number("inertia_xz", "kg.m2", 0.1204, "product of inertia Jxz"),
        _number("wing_area", "m2", 0.55, "S"),
        _number("wing_span", "m", 2.8956, "b"),
        _number("wing_chord", "m", 0.18994, "c"),
        _number("efficiency", "1", 0.9, "Oswald's factor e"),
        _number("propeller_area", "m2", 0.2027, "S_prop"),
        _number("motor_speed", "m/s", 80.0, "k_motor: speed of the propeller's jet at full throttle"),
        _number("air_density", "kg/m3", 1.2682, "rho"),
        _number("deflection_max", "rad", radians(25.0), "of aileron, elevator and rudder"),
        _number("stall_angle", "rad", 0.4712, "alpha_0"),
        _number("lift_0", "1", 0.28, "C_L0"),
        _number("lift_alpha", "1", 3.45, "C_L alpha"),
        _number("lift_q", "1", 0.0, "C_L q"),
        _number("lift_elevator", "1", -0.36, "C_L delta_e; positive deflections lower the nose"),
        _number("drag_0", "1", 0.0437, "C_D p"),
        _number("side_beta", "1", -0.98, "C_Y beta"),
        _number("side_rudder", "1", -0.17, "C_Y delta_r"),
        _number("roll_beta", "1", -0.12, "C_l beta"),
        _number("roll_p", "1", -0.26, "C_l p"),
        _number("roll_r", "1", 0.14, "C_l r"),
        _number("roll_aileron", "1", 0.08, "C_l delta_a"),
        _number("roll_rudder", "1", 0.105, "C_l delta_r"),
        _number("pitch_0", "1", -0.02338, "C_m0"),
        _number("pitch_alpha", "1", -0.38, "C_m alpha"),
        _number("pitch_q", "1", -3.6, "C_m q"),
        _number("pitch_elevator", "1", -0.5, "C_m delta_e"),
        _number("yaw_beta", "1", 0.25, "C_n beta"),
        _number("yaw_p", "1", 0.022, "C_n p"),
        _number("yaw_r", "1", -0.35, "C_n r"),
        _number("yaw_aileron", "1", 0.06, "C_n delta_a"),
        _number("yaw_rudder", "1", -0.032, "C_n delta_r"),
        Parameter("substep", unit="s", start=0.00625, minimum=1e-6, description="longest integration step"),
        *outputs_of(Airframe.plane),
        Output("on_ground", type=bool, start=False, verdict=Role.ON_GROUND, description="the wheels touch the ground"),
    )
    kernels = wing_kernels(wing_forces(_coefficients))
    errors: ClassVar = {
        1: "mass, wing_area, wing_span and substep must be positive",
        2: "position_start is below the ground: down must not exceed ground_height",
        3: "position, velocity or attitude is no longer finite",
        4: "inertia and inertia_xz are not those of a body",
    }
