"""The two kernels shared by all multirotor FMUs, over the record that `multirotor` declares.

The rotors' lag is solved exactly. The body is integrated by the third-order method of Kutta in equal
sub-steps of at most `substep`. Frames: NED for position, velocity and wind, FRD for all quantities fixed to the body.
"""

from __future__ import annotations

from math import ceil, copysign, cos, isfinite, sin, sqrt
from typing import Any

import numpy as np

from cosim.frames import derivative, normalize
from cosim.kernel import kernel
from cosim.vehicle import MAX_MOTORS
from cosim_models.vehicles.dynamics.ground import HOLDS, contact_force, dragged, held, is_held
from cosim_models.vehicles.dynamics.rigid_body import (
    Matrix,
    Quaternion,
    Vector,
    along,
    along4,
    angular_acceleration,
    from_body,
    load,
    load4,
    rotation_matrix,
    to_body,
)
from cosim_models.vehicles.dynamics.rotor import (
    MotorCurve,
    command_share,
    decay,
    lagged,
    rotor_force,
    rotor_moment,
    speed_command,
    thrust_command,
)

__all__ = ["CONTACTS", "ERRORS", "GRAVITY", "advance", "start"]

GRAVITY = 9.80665
"""Standard gravity [m/s2]."""

_CURVE_SPEED = int(MotorCurve.speed)
_FEET = 4
CONTACTS = _FEET + MAX_MOTORS
"""Number of points that can touch the ground: the feet and the rotor hubs."""
_BEGIN, _MIDDLE, _END = 0, 1, 2
_STILL = 1e-9
"""Greatest speed, m/s and rad/s, of a vehicle and of rotors that stand still."""
_BALANCED = 1e-7
"""Its greatest acceleration, m/s2 and rad/s2: its feet are within 1e-10 m of where they carry it."""

ERRORS = {
    1: "mass and inertia must be positive",
    2: "rotor_count must be 1 to 8",
    3: "substep and ground_deflection must be positive",
    4: "command_max must be greater than command_min",
    5: "position_start is below the ground: down must not exceed ground_height",
    6: "position, velocity, attitude or force is no longer finite",
    7: "speed_max and thrust_constant must be positive for the thrust curve and moment_by_command",
}


# ---- forces ------------------------------------------------------------------------------------------------------


@kernel
def _air_forces(m: Any, stage: int, air: Vector, rates: Vector) -> tuple[Vector, Vector]:
    """Returns force [N] and torque [N m] of rotors and body drag about the centre of mass, FRD; `air` is airspeed."""
    fx = fy = fz = 0.0
    mx = my = mz = 0.0
    for i in range(m.rotor_count):
        x, y, z = float(m.rotor_x[i]), float(m.rotor_y[i]), float(m.rotor_z[i])
        hub = (
            air[0] + rates[1] * z - rates[2] * y,
            air[1] + rates[2] * x - rates[0] * z,
            air[2] + rates[0] * y - rates[1] * x,
        )
        speed = _effective_speed(m, float(m.stage_speed[stage, i]), hub[2])
        if speed == 0.0:
            continue  # its force and its moment are zero, too
        thrust = m.thrust_now * speed * speed
        turning = float(m.rotor_direction[i])
        f = rotor_force(speed, thrust, hub, m.vanishing, m.rotor_drag)
        t = rotor_moment(speed, thrust, hub, turning, m.moment_constant, m.rolling_moment)
        fx += f[0]
        fy += f[1]
        fz += f[2]
        mx += t[0] + y * f[2] - z * f[1]
        my += t[1] + z * f[0] - x * f[2]
        mz += t[2] + x * f[1] - y * f[0]
    drag = float(m.linear_drag)
    if m.drag_by_axis:
        own = float(m.quadratic_drag)
        fx -= own * abs(air[0]) * air[0]
        fy -= own * abs(air[1]) * air[1]
        fz -= own * abs(air[2]) * air[2]
        for i in range(m.rotor_count):
            x, y = float(m.rotor_x[i]), float(m.rotor_y[i])
            down = air[2] + rates[0] * y - rates[1] * x
            along = m.rotor_drag * _effective_speed(m, float(m.stage_speed[stage, i]), down) * down
            fz -= along
            mx -= y * along
            my += x * along
        if m.moment_by_command:
            mz += _moment_beyond(m, stage, air[2], rates)
    elif m.quadratic_drag > 0.0:
        drag += m.quadratic_drag * sqrt(air[0] * air[0] + air[1] * air[1] + air[2] * air[2])
    force = (fx - drag * air[0], fy - drag * air[1], fz - drag * air[2])
    damping = load(m.rotational_damping)
    return force, (mx - damping[0] * rates[0], my - damping[1] * rates[1], mz - damping[2] * rates[2])


@kernel
def _effective_speed(m: Any, speed: float, down: float) -> float:
    """Returns the speed [rad/s] of a rotor in still air with the thrust that this one has while its hub moves.

    Args:
        speed: its speed [rad/s].
        down: velocity of the hub relative to the air along the down axis [m/s]; upwards, the inflow costs thrust.
    """
    if m.inflow_loss == 0.0 or down >= 0.0 or m.thrust_now <= 0.0:
        return speed
    return sqrt(max(speed * speed - m.inflow_loss * down * down / m.thrust_now, 0.0))


@kernel
def _moment_beyond(m: Any, stage: int, air_down: float, rates: Vector) -> float:
    """Returns the yaw moment [N m] by which moments that grow with the command differ from those of full command."""
    moment, most = 0.0, m.speed_max * m.speed_max
    for i in range(m.rotor_count):
        own = float(m.stage_speed[stage, i])
        square = own * own
        command = command_share(square / most, m.thrust_expo) if m.motor_curve != _CURVE_SPEED else sqrt(square / most)
        speed = _effective_speed(m, own, air_down + rates[0] * float(m.rotor_y[i]) - rates[1] * float(m.rotor_x[i]))
        moment += float(m.rotor_direction[i]) * m.moment_constant * m.thrust_now * speed * speed * (command - 1.0)
    return moment


@kernel
def _spin(m: Any, stage: int) -> tuple[float, float]:
    """Returns the rotors' angular momentum about the down axis [kg m2/s] and its rate of change [N m]."""
    spin = rate = 0.0
    for i in range(m.rotor_count):
        spin -= m.rotor_direction[i] * m.stage_speed[stage, i]
        rate -= m.rotor_direction[i] * m.stage_slew[stage, i]
    return m.rotor_inertia * spin, m.rotor_inertia * rate


@kernel
def _depth(m: Any, i: int, position: Vector, r: Matrix) -> float:
    """Returns the depth of contact point `i` below the surface [m]."""
    c = load(m.contact[i])
    return float(position[2] + (r[6] * c[0] + r[7] * c[1] + r[8] * c[2]) - m.surface)


@kernel
def _contact_motion(
    m: Any, i: int, position: Vector, velocity: Vector, r: Matrix, rates: Vector
) -> tuple[Vector, Vector, Vector]:
    """Returns arm, position and velocity of contact point `i`, all in NED."""
    c = load(m.contact[i])
    arm = from_body(r, c)
    turning = (rates[1] * c[2] - rates[2] * c[1], rates[2] * c[0] - rates[0] * c[2], rates[0] * c[1] - rates[1] * c[0])
    return arm, along(position, 1.0, arm), along(velocity, 1.0, from_body(r, turning))


@kernel
def _ground_forces(m: Any, position: Vector, velocity: Vector, r: Matrix, rates: Vector) -> tuple[Vector, Vector]:
    """Returns force [N, NED] and torque about the centre of mass [N m, FRD] of the ground."""
    fn = fe = fd = 0.0
    tn = te = td = 0.0
    for i in range(_FEET + m.rotor_count):
        if _depth(m, i, position, r) <= 0.0:
            continue  # there is no force
        arm, point, v = _contact_motion(m, i, position, velocity, r, rates)
        depth = point[2] - m.surface
        sn, se = point[0] - m.anchor[i, 0], point[1] - m.anchor[i, 1]
        f = contact_force(depth, v[0], v[1], v[2], sn, se, m.ground_stiffness, m.ground_damper, m.ground_friction)
        fn += f[0]
        fe += f[1]
        fd += f[2]
        tn += arm[1] * f[2] - arm[2] * f[1]
        te += arm[2] * f[0] - arm[0] * f[2]
        td += arm[0] * f[1] - arm[1] * f[0]
    return (fn, fe, fd), to_body(r, (tn, te, td))


@kernel
def _accelerations(
    m: Any, stage: int, position: Vector, velocity: Vector, q: Quaternion, rates: Vector
) -> tuple[Vector, Vector, Vector]:
    """Returns acceleration [m/s2, NED], angular acceleration [rad/s2, FRD] and specific force [m/s2, FRD]."""
    r = rotation_matrix(q)
    wind = load(m.wind)
    if m.is_blown:
        wind = along(wind, 1.0, load(m.added_wind))
    air = to_body(r, (velocity[0] - wind[0], velocity[1] - wind[1], velocity[2] - wind[2]))
    force, torque = _air_forces(m, stage, air, rates)
    carried = False
    if position[2] + m.reach > m.surface and m.held_by_ground:
        carried = position[2] >= m.ground_height - HOLDS
    elif position[2] + m.reach > m.surface:
        push, tip = _ground_forces(m, position, velocity, r, rates)
        force = along(force, 1.0, to_body(r, push))
        torque = along(torque, 1.0, tip)
    if m.is_pushed:
        force = along(force, 1.0, to_body(r, load(m.force)))
    spin = 0.0
    if m.rotor_inertia > 0.0:
        spin, rate = _spin(m, stage)
        torque = (torque[0], torque[1], torque[2] - rate)
    specific = (force[0] * m.per_mass, force[1] * m.per_mass, force[2] * m.per_mass)
    acceleration = from_body(r, specific)
    if carried and acceleration[2] + GRAVITY > 0.0:
        acceleration = (acceleration[0], acceleration[1], -GRAVITY)
        specific = to_body(r, acceleration)
    return (
        (acceleration[0], acceleration[1], acceleration[2] + GRAVITY),
        angular_acceleration(load(m.inertia), load(m.per_inertia), rates, torque, spin),
        specific,
    )


# ---- one sub-step ------------------------------------------------------------------------------------------------


@kernel
def _aim(m: Any) -> None:
    """Converts the motor commands to the targets of the rotors' lags."""
    for i in range(m.rotor_count):
        command = float(m.motor[i])
        if m.motor_curve == _CURVE_SPEED:
            m.target[i] = speed_command(command, m.command_min, m.command_max, m.speed_min, m.speed_max)
        else:
            part = thrust_command(command, m.command_min, m.command_max, m.thrust_expo)
            m.target[i] = part * m.speed_max * m.speed_max


@kernel
def _same(a: float, b: float) -> bool:
    """Returns whether two numbers are the same, in the sign of zero as well."""
    return a == b and copysign(1.0, a) == copysign(1.0, b)


@kernel
def _meet_surroundings(m: Any) -> bool:
    """Reads the inputs by which the surroundings act; returns whether they are those of the step before."""
    thrust = m.thrust_constant * m.thrust_factor
    same = _same(thrust, m.thrust_now)
    for i in range(3):
        same = same and _same(m.wind[i], m.wind_before[i]) and _same(m.added_wind[i], m.added_wind_before[i])
        same = same and _same(m.force[i], m.force_before[i])
    if not same:
        m.thrust_now = thrust
        for i in range(3):
            m.wind_before[i] = m.wind[i]
            m.added_wind_before[i] = m.added_wind[i]
            m.force_before[i] = m.force[i]
        m.is_pushed = m.force[0] != 0.0 or m.force[1] != 0.0 or m.force[2] != 0.0
        m.is_blown = m.added_wind[0] != 0.0 or m.added_wind[1] != 0.0 or m.added_wind[2] != 0.0
    return bool(same)


@kernel
def _is_kept(m: Any, position: Vector, velocity: Vector, q: Quaternion, rates: Vector) -> bool:
    """Returns whether `_publish` has computed the accelerations of this motion and of these rotor speeds."""
    before = m.motion_before
    same = before[9] == q[0] and before[10] == q[1] and before[11] == q[2] and before[12] == q[3]
    for i in range(3):
        same = same and before[i] == position[i] and before[3 + i] == velocity[i] and before[6 + i] == rates[i]
    for i in range(m.rotor_count):
        same = same and m.stage_speed[_END, i] == m.rotor_speed[i]
    return bool(same and m.rotor_inertia <= 0.0)


@kernel
def _first_accelerations(
    m: Any, kept: bool, position: Vector, velocity: Vector, q: Quaternion, rates: Vector
) -> tuple[Vector, Vector]:
    """Returns acceleration and angular acceleration at the begin of a sub-step.

    In most steps, `_publish` has computed them at the end of the step before (`kept`): motion, rotor speeds and
    surroundings are the same. Not so with inertia of the rotors, whose rate of change depends on the new commands.
    """
    if kept:
        return load(m.kept_acceleration), load(m.kept_turning)
    acceleration, turning, _ = _accelerations(m, int(np.int64(_BEGIN)), position, velocity, q, rates)
    return acceleration, turning


@kernel
def _turn_rotors(m: Any, h: float) -> None:
    """Computes rotor speeds at the stages of a sub-step of `h` seconds: the exact solution for a constant command."""
    if h != m.decay_step:
        m.decay_step = h
        m.decay_up = decay(m.time_constant_up, 0.5 * h)
        m.decay_down = decay(m.time_constant_down, 0.5 * h)
    for i in range(m.rotor_count):
        begin = float(m.rotor_speed[i])
        target = float(m.target[i])
        if m.motor_curve == _CURVE_SPEED:
            half = m.decay_up if target > begin else m.decay_down
            middle = lagged(begin, target, half)
            end = lagged(begin, target, half * half)
        else:
            squared = begin * begin
            half = m.decay_up if target > squared else m.decay_down
            middle = sqrt(lagged(squared, target, half))
            end = sqrt(lagged(squared, target, half * half))
        m.stage_speed[_BEGIN, i] = begin
        m.stage_speed[_MIDDLE, i] = middle
        m.stage_speed[_END, i] = end
        m.rotor_speed[i] = end
    if m.rotor_inertia > 0.0:
        _slew(m)


@kernel
def _slew(m: Any) -> None:
    """Computes the rotors' accelerations at the stages; zero without lag, when the speed jumps."""
    for stage in range(3):
        for i in range(m.rotor_count):
            speed = float(m.stage_speed[stage, i])
            target = float(m.target[i])
            is_speed = m.motor_curve == _CURVE_SPEED
            distance = target - (speed if is_speed else speed * speed)
            time_constant = m.time_constant_up if distance > 0.0 else m.time_constant_down
            slew = 0.0
            if time_constant > 0.0:
                slew = distance / time_constant
                if not is_speed:
                    slew = slew / (2.0 * speed) if speed > 0.0 else 0.0
            m.stage_slew[stage, i] = slew


@kernel
def _runge_kutta(
    m: Any, h: float, kept: bool, p: Vector, v: Vector, q: Quaternion, w: Vector
) -> tuple[Vector, Vector, Quaternion, Vector]:
    """Performs one step of Kutta's third-order method; the rotor speeds are already computed."""
    half, twice, sixth = 0.5 * h, 2.0 * h, h / 6.0
    middle = int(np.int64(_MIDDLE))  # not a literal, because numba would recompile the forces for each
    end = middle + 1
    a1, b1 = _first_accelerations(m, kept, p, v, q, w)
    c1 = derivative(q, w)
    v2, q2, w2 = along(v, half, a1), along4(q, half, c1), along(w, half, b1)
    a2, b2, _ = _accelerations(m, middle, along(p, half, v), v2, q2, w2)
    c2 = derivative(q2, w2)
    p3, v3 = along(along(p, -h, v), twice, v2), along(along(v, -h, a1), twice, a2)
    q3, w3 = along4(along4(q, -h, c1), twice, c2), along(along(w, -h, b1), twice, b2)
    a3, b3, _ = _accelerations(m, end, p3, v3, q3, w3)
    c3 = derivative(q3, w3)
    return (
        _weighted(p, sixth, v, v2, v3),
        _weighted(v, sixth, a1, a2, a3),
        normalize(along4(along4(along4(q, sixth, c1), 4.0 * sixth, c2), sixth, c3)),
        _weighted(w, sixth, b1, b2, b3),
    )


@kernel
def _weighted(x: Vector, sixth: float, k1: Vector, k2: Vector, k3: Vector) -> Vector:
    """Returns x + sixth (k1 + 4 k2 + k3)."""
    return (
        x[0] + sixth * (k1[0] + 4.0 * k2[0] + k3[0]),
        x[1] + sixth * (k1[1] + 4.0 * k2[1] + k3[1]),
        x[2] + sixth * (k1[2] + 4.0 * k2[2] + k3[2]),
    )


@kernel
def _slip(m: Any, position: Vector, velocity: Vector, q: Quaternion, rates: Vector) -> None:
    """Moves the anchors of contact points that friction does not hold, and records whether any touches the ground."""
    m.on_ground = False
    if position[2] + m.reach + 1.0 < m.surface:
        return
    if m.held_by_ground:
        m.on_ground = position[2] >= m.ground_height - HOLDS
        return
    r = rotation_matrix(q)
    for i in range(_FEET + m.rotor_count):
        if _depth(m, i, position, r) <= 0.0:
            arm = from_body(r, load(m.contact[i]))
            m.anchor[i, 0] = position[0] + arm[0]
            m.anchor[i, 1] = position[1] + arm[1]
            continue
        _, point, v = _contact_motion(m, i, position, velocity, r, rates)
        depth = point[2] - m.surface
        sn, se = point[0] - m.anchor[i, 0], point[1] - m.anchor[i, 1]
        sn, se = dragged(depth, v[2], sn, se, m.ground_stiffness, m.ground_damper, m.ground_friction)
        m.anchor[i, 0] = point[0] - sn
        m.anchor[i, 1] = point[1] - se
        if depth > 0.0:
            m.on_ground = True


# ---- the kernels of the FMUs -------------------------------------------------------------------------------------


@kernel
def _check(m: Any) -> int:
    """Returns a key of ERRORS, or 0."""
    if not (m.mass > 0.0 and m.inertia[0] > 0.0 and m.inertia[1] > 0.0 and m.inertia[2] > 0.0):
        return 1
    if m.rotor_count < 1 or m.rotor_count > MAX_MOTORS:
        return 2
    if not (m.substep > 0.0 and m.ground_deflection > 0.0):
        return 3
    if not m.command_max > m.command_min:
        return 4
    if m.position_start[2] > m.ground_height:
        return 5
    if (m.motor_curve != _CURVE_SPEED or m.moment_by_command) and not (m.speed_max > 0.0 and m.thrust_constant > 0.0):
        return 7
    return 0


@kernel
def _stand(m: Any) -> None:
    """Sets contact points and ground: the feet carry the weight at `ground_deflection`, with damping."""
    side = m.foot_radius * sqrt(0.5)
    for i in range(_FEET):
        m.contact[i, 0] = side if i < 2 else -side
        m.contact[i, 1] = side if i % 2 == 0 else -side
        m.contact[i, 2] = m.foot_height
    for i in range(m.rotor_count):
        m.contact[_FEET + i, 0] = m.rotor_x[i]
        m.contact[_FEET + i, 1] = m.rotor_y[i]
        m.contact[_FEET + i, 2] = m.rotor_z[i]
    m.reach = 0.0
    for i in range(_FEET + m.rotor_count):
        c = load(m.contact[i])
        m.reach = max(m.reach, sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]))
    stiffness = m.mass * GRAVITY / m.ground_deflection
    m.ground_stiffness = stiffness / _FEET
    m.ground_damper = 2.0 * m.ground_damping * sqrt(stiffness * m.mass) / _FEET
    m.surface = m.ground_height + m.foot_height - m.ground_deflection


@kernel
def _have_stopped(m: Any) -> bool:
    """Returns whether all rotors stand still, and are commanded to."""
    stopped = True
    for i in range(m.rotor_count):
        stopped = stopped and m.rotor_speed[i] <= _STILL and m.target[i] == 0.0
    return bool(stopped)


@kernel
def _is_balanced(m: Any, velocity: Vector, rates: Vector, acceleration: Vector, turning: Vector) -> bool:
    """Returns whether the vehicle stands still on the ground, and stays there until something else acts on it."""
    if not m.on_ground:
        return False
    speed = change = 0.0
    for i in range(3):
        speed = max(speed, abs(velocity[i]), abs(rates[i]))
        change = max(change, abs(acceleration[i]), abs(turning[i]))
    return speed <= _STILL and change <= _BALANCED


@kernel
def _publish(m: Any, position: Vector, velocity: Vector, q: Quaternion, rates: Vector) -> None:
    """Writes the motion and the quantities derived from it to the outputs."""
    acceleration, turning, specific = _accelerations(m, int(np.int64(_END)), position, velocity, q, rates)
    for i in range(3):
        m.kept_acceleration[i] = acceleration[i]
        m.kept_turning[i] = turning[i]
        m.motion_before[i] = position[i]
        m.motion_before[3 + i] = velocity[i]
        m.motion_before[6 + i] = rates[i]
        m.position[i] = position[i]
        m.velocity[i] = velocity[i]
        m.angular_velocity[i] = rates[i]
        m.specific_force[i] = specific[i]
    for i in range(4):
        m.motion_before[9 + i] = q[i]
        m.attitude[i] = q[i]
    m.rests = _is_balanced(m, velocity, rates, acceleration, turning)


@kernel
def start(m: Any) -> int:
    """Checks the parameters and places the vehicle at its initial position, at rest, with stopped rotors."""
    code = _check(m)
    if code != 0:
        return code
    _stand(m)
    m.vanishing = 1.0 / m.axial_speed_limit if m.axial_speed_limit > 0.0 else 0.0
    m.per_mass = 1.0 / m.mass
    for i in range(3):
        m.per_inertia[i] = 1.0 / m.inertia[i]
    position = load(m.position_start)
    q = (cos(0.5 * m.yaw_start), 0.0, 0.0, sin(0.5 * m.yaw_start))
    rest = (0.0, 0.0, 0.0)
    r = rotation_matrix(q)
    for i in range(_FEET + m.rotor_count):
        _, point, _ = _contact_motion(m, i, position, rest, r, rest)
        m.anchor[i, 0] = point[0]
        m.anchor[i, 1] = point[1]
    _slip(m, position, rest, q, rest)
    _meet_surroundings(m)
    _publish(m, position, rest, q, rest)
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Advances the vehicle from `t` to `t + h` [s] in equal sub-steps of at most `substep`; inputs are constant.

    A vehicle that stands still with stopped rotors remains as it is until a command or its surroundings change.
    """
    # A step that is a multiple of the sub-step up to rounding must not get an additional sub-step.
    steps = max(ceil(h / m.substep - 1e-6), 1)
    part = h / steps
    _aim(m)
    kept = _meet_surroundings(m)
    position, velocity = load(m.position), load(m.velocity)
    q, rates = load4(m.attitude), load(m.angular_velocity)
    kept = kept and _is_kept(m, position, velocity, q, rates)
    if kept and m.rests and _have_stopped(m):
        return 0
    for _ in range(steps):
        _turn_rotors(m, part)
        down = position[2]
        position, velocity, q, rates = _runge_kutta(m, part, kept, position, velocity, q, rates)
        kept = False
        if m.held_by_ground and is_held(down, position[2], velocity[2], m.ground_height):
            position, velocity, q = held(position, velocity, q, m.ground_height)
            rates = (0.0, 0.0, 0.0)
        _slip(m, position, velocity, q, rates)
    total = position[0] + position[1] + position[2] + velocity[0] + velocity[1] + velocity[2] + q[0] + rates[0]
    if not isfinite(total):
        return 6
    _publish(m, position, velocity, q, rates)
    if not isfinite(m.specific_force[0] + m.specific_force[1] + m.specific_force[2]):
        return 6
    return 0
