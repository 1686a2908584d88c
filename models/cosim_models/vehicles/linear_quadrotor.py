"""The linear quadrotor FMU: the hover linearisation with which the authors of the line simulate their quadrotors.

Source: Models/plant/quadcopter.mo of github.com/mapalmieri/Drones (Co-simulation and Formal Verification of
Co-operative Drone Control With Logic-Based Specifications, The Computer Journal 66, 2023, doi 10.1093/comjnl/bxab161):
a plus quadrotor whose inputs w are the deviations of the rotors' speeds from hover. x points ahead, y to the left, z
up; w1 is the front rotor, w2 the left, w3 the rear, w4 the right one; psi is positive to the left:

    x'' = g (cos(psi) theta + sin(psi) phi)        phi''   = l sqrt(m g Kf) / Ixx (w2 - w4)
    y'' = g (sin(psi) theta - cos(psi) phi)        theta'' = l sqrt(m g Kf) / Iyy (w3 - w1)
    z'' = 2 sqrt(Kf g / m) (w1 + w2 + w3 + w4)     psi''   = Km sqrt(m g Kf) / Izz (w1 - w2 + w3 - w4)

The default parameters are those of `Quadrotor`, PX4's Iris, its four arms of equal length turned into the axes, so that
one shows what the other neglects. The authors' numbers are the presets `authors_line` (that file: units of 1, no real
vehicle) and `authors_voronoi` (Parameters of the multi-models of github.com/mapalmieri/IEEEAccessDrones: nearly
RotorS's Iris, with its thrust constant for speeds divided by 10). Both need other gains than ArduCopter's defaults
(docs/vehicles.md). `lift_factor` is the 2 of z'', which the authors' presets have: the derivative of the thrust 4 Kf
w^2 at hover gives 1, the default.

Additions, for the ports of all vehicles: rotors turn at speeds that are linear in the command, and w is that speed
less the hover speed sqrt(m g / (4 Kf)); motors are numbered as in ArduPilot's quad plus; level ground, on which it
stands upright until the lift exceeds the weight. Differences: quadcopter.mo has a constant heading psi in x'' and y'',
here it is the current one, because autopilots turn the nose; the angles are Euler angles in the output `attitude`.
Outside small angles it is wrong, as a linear model is: no lift is lost by leaning. No lag. Its surroundings act by
`force`, `thrust_factor` and, if `linear_drag` is not 0, `wind`; the drag of four rotors of the Iris at hover is 0.56 N
s/m.

The equations are solved exactly for inputs that are constant during a step, the heading taken at the middle of it.
"""

from __future__ import annotations

from math import cos, expm1, isfinite, sin, sqrt
from typing import Any, ClassVar

from cosim import Memory, Model, Output, Parameter
from cosim.frames import quaternion_from_euler, rotate_inverse
from cosim.kernel import kernel
from cosim.vehicle import FORCE, THRUST_FACTOR, VEHICLE_INPUTS, Airframe, outputs_of
from cosim.verdict import Role
from cosim_models.vehicles.multirotor import STEP_SIZE

__all__ = ["LinearQuadrotor"]

_RIGHT, _LEFT, _FRONT, _REAR = 0, 1, 2, 3  # elements of `motor`
_ROLL, _PITCH, _YAW = 0, 1, 2


@kernel
def _publish(m: Any, north: float, east: float, down: float) -> None:
    """Writes attitude, angular velocity, and the specific force of an acceleration [m/s2, NED]."""
    q = quaternion_from_euler(float(m.angle[_ROLL]), float(m.angle[_PITCH]), float(m.angle[_YAW]))
    for i in range(4):
        m.attitude[i] = q[i]
    for i in range(3):
        m.angular_velocity[i] = m.rate[i]
    f = rotate_inverse(q, (north, east, down - m.gravity))
    m.specific_force[0], m.specific_force[1], m.specific_force[2] = f


@kernel
def _deviation(m: Any, i: int) -> float:
    """Returns the speed of the rotor of motor `i` less the hover speed [rad/s]."""
    command = min(max(float(m.motor[i]), 0.0), 1.0)
    speed = m.speed_min + (m.speed_max - m.speed_min) * command if command > 0.0 else 0.0
    return float(speed - m.hover_speed)


@kernel
def _thrust_slope(m: Any) -> float:
    """Returns the derivative of a rotor's thrust with respect to its speed at hover [N s/rad]."""
    return sqrt(float(m.mass * m.gravity * m.thrust_constant))


@kernel
def _fall(m: Any) -> float:
    """Returns the acceleration down [m/s2]."""
    total = _deviation(m, _FRONT) + _deviation(m, _LEFT) + _deviation(m, _REAR) + _deviation(m, _RIGHT)
    down = float(-m.lift_factor * _thrust_slope(m) / m.mass * total)
    if m.thrust_factor != 1.0:
        down = float(m.gravity - m.thrust_factor * (m.gravity - down))
    if m.force[2] != 0.0:
        down += float(m.force[2] / m.mass)
    return down


@kernel
def start(m: Any) -> int:
    """Places the quadrotor at rest and upright."""
    if not (m.mass > 0.0 and m.inertia[0] > 0.0 and m.inertia[1] > 0.0 and m.inertia[2] > 0.0):
        return 1
    if not (m.thrust_constant > 0.0 and m.gravity > 0.0):
        return 2
    if m.position_start[2] > m.ground_height:
        return 3
    m.hover_speed = sqrt(m.mass * m.gravity / (4.0 * m.thrust_constant))
    if not m.speed_max > m.hover_speed:
        return 4
    for i in range(3):
        m.position[i] = m.position_start[i]
        m.velocity[i] = 0.0
        m.angle[i] = 0.0
        m.rate[i] = 0.0
    m.angle[_YAW] = m.yaw_start
    m.on_ground = m.position[2] >= m.ground_height
    _publish(m, 0.0, 0.0, 0.0 if m.on_ground else _fall(m))
    return 0


@kernel
def _stand(m: Any) -> None:
    """Rests on the ground, level, at its heading."""
    m.on_ground = True
    m.position[2] = m.ground_height
    m.angle[_ROLL] = m.angle[_PITCH] = 0.0
    for i in range(3):
        m.velocity[i] = 0.0
        m.rate[i] = 0.0
    _publish(m, 0.0, 0.0, 0.0)


@kernel
def _pull(m: Any, h: float, moment: float, axis: int) -> tuple[float, float, float]:
    """Turns about an axis under `moment` [rad/s2]; returns the mean angle of acceleration, velocity and position.

    These are the angle at the end of the step, its mean over the step (h), and twice the mean of its integral (h^2/2).
    """
    angle, rate = float(m.angle[axis]), float(m.rate[axis])
    m.angle[axis] = angle + (rate + 0.5 * moment * h) * h
    m.rate[axis] = rate + moment * h
    return (
        float(m.angle[axis]),
        angle + (0.5 * rate + moment * h / 6.0) * h,
        angle + (rate / 3.0 + moment * h / 12.0) * h,
    )


@kernel
def _integrals(tau: float, h: float) -> tuple[float, float, float]:
    """Returns the integrals of exp((s - h) / tau), times s, and times s^2, over s from 0 to `h` [s, s2, s3]."""
    i0 = -tau * expm1(-h / tau)
    i1 = tau * (h - i0)
    return i0, i1, tau * (h * h - 2.0 * i1)


@kernel
def _drift(m: Any, axis: int, start: float, slope: float, bend: float, h: float) -> None:
    """Moves along an axis against the air, under the acceleration start + slope s + bend s^2 [m/s2] at s seconds."""
    tau, wind, v = m.mass / m.linear_drag, float(m.wind[axis]), float(m.velocity[axis])
    i0, i1, i2 = _integrals(tau, h)
    gone = i0 / tau
    after = v + gone * (wind - v) + start * i0 + slope * i1 + bend * i2
    push = (start + (slope / 2.0 + bend / 3.0 * h) * h) * h
    m.position[axis] += wind * h + tau * (push - (after - v))
    m.velocity[axis] = after


@kernel
def _move(m: Any, axis: int, pull: float, velocity: float, place: float, h: float) -> None:
    """Moves along an axis: acceleration whose mean is `velocity` for velocity and `place` for position, and `pull`."""
    m.position[axis] += (m.velocity[axis] + 0.5 * (place + pull) * h) * h
    m.velocity[axis] += (velocity + pull) * h


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Makes one step of `h` seconds."""
    right, left, front, rear = _deviation(m, _RIGHT), _deviation(m, _LEFT), _deviation(m, _FRONT), _deviation(m, _REAR)
    slope, down = _thrust_slope(m), _fall(m)
    if m.on_ground and down >= 0.0:
        _stand(m)
        return 0
    rolling, pitching = m.arm * slope / m.inertia[0] * (left - right), m.arm * slope / m.inertia[1] * (front - rear)
    before = float(m.angle[_ROLL]), float(m.rate[_ROLL]), float(m.angle[_PITCH]), float(m.rate[_PITCH])
    roll = _pull(m, h, rolling, _ROLL)
    pitch = _pull(m, h, pitching, _PITCH)
    heading = float(m.angle[_YAW]) + 0.5 * h * m.rate[_YAW]
    _pull(m, h, m.moment_constant * slope / m.inertia[2] * (left + right - front - rear), _YAW)
    c, s = m.gravity * cos(heading), m.gravity * sin(heading)
    north, east = float(m.force[0] / m.mass), float(m.force[1] / m.mass)
    an, ae, ad = north - c * pitch[0] - s * roll[0], east + c * roll[0] - s * pitch[0], down
    if m.linear_drag > 0.0:
        x, y = 0.5 * rolling, 0.5 * pitching
        _drift(m, 0, north - c * before[2] - s * before[0], -c * before[3] - s * before[1], -c * y - s * x, h)
        _drift(m, 1, east + c * before[0] - s * before[2], c * before[1] - s * before[3], c * x - s * y, h)
        _drift(m, 2, down, 0.0, 0.0, h)
        over = m.linear_drag / m.mass
        an += over * (m.wind[0] - m.velocity[0])
        ae += over * (m.wind[1] - m.velocity[1])
        ad += over * (m.wind[2] - m.velocity[2])
    else:
        _move(m, 0, north, -c * pitch[1] - s * roll[1], -c * pitch[2] - s * roll[2], h)
        _move(m, 1, east, c * roll[1] - s * pitch[1], c * roll[2] - s * pitch[2], h)
        _move(m, 2, 0.0, down, down, h)
    if not isfinite(m.position[0] + m.position[1] + m.position[2] + m.angle[_ROLL] + m.angle[_PITCH] + m.angle[_YAW]):
        return 5
    m.on_ground = m.position[2] >= m.ground_height
    if m.on_ground:
        _stand(m)
    else:
        _publish(m, an, ae, ad)
    return 0


class LinearQuadrotor(Model):
    """Quadrotor plus, linearised at hover (default: PX4 Iris; presets: the plants of the authors of the line)."""

    step_size = STEP_SIZE
    variables = (
        *VEHICLE_INPUTS,
        FORCE,
        THRUST_FACTOR,
        Parameter("mass", unit="kg", start=1.545, minimum=1e-3, description="total mass, m"),
        Parameter(
            "inertia",
            shape=3,
            unit="kg.m2",
            start=(0.03002, 0.03057, 0.05754),
            minimum=1e-9,
            description="roll, pitch, yaw: Ixx, Iyy, Izz",
        ),
        Parameter("arm", unit="m", start=0.247, minimum=0.0, description="from the centre to each rotor, l"),
        Parameter("thrust_constant", unit="N.s2/rad2", start=5.84e-6, description="thrust over speed squared, Kf"),
        Parameter("moment_constant", unit="m", start=0.06, minimum=0.0, description="drag torque over thrust, Km"),
        Parameter("lift_factor", unit="1", start=1.0, minimum=0.0, description="of the lift; the source has 2"),
        Parameter(
            "linear_drag", unit="N.s/m", start=0.0, minimum=0.0, description="force of the air over its speed; 0: none"
        ),
        Parameter("gravity", unit="m/s2", start=9.80665, description="g"),
        Parameter("speed_min", unit="rad/s", start=100.0, minimum=0.0, description="rotor speed just above command 0"),
        Parameter("speed_max", unit="rad/s", start=1100.0, description="rotor speed at full command"),
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED",
        ),
        Parameter("yaw_start", unit="rad", start=0.0, description="initial heading, clockwise from north"),
        Parameter("ground_height", unit="m", start=0.0, description="down coordinate at which the vehicle stands"),
        *outputs_of(Airframe.quad_plus),
        Output(
            "on_ground", type=bool, start=False, verdict=Role.ON_GROUND, description="the ground carries the weight"
        ),
        Memory("angle", shape=3),  # roll, pitch, yaw, rad
        Memory("rate", shape=3),  # rad/s
        Memory("hover_speed"),  # rad/s
    )
    kernels = (start, advance)
    errors: ClassVar = {
        1: "mass and inertia must be positive",
        2: "thrust_constant and gravity must be positive",
        3: "position_start is below the ground: down must not exceed ground_height",
        4: "speed_max is not above the hover speed sqrt(mass gravity / (4 thrust_constant)): it would never take off",
        5: "position or attitude is no longer finite: are all commands?",
    }
