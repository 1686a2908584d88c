"""One rotor: from command to speed with lag, and from speed and airflow to force and moment.

Rotor axes are parallel to the body's down axis; thrust points up. The position of the rotor is not used here.

Sources: the force and moment are those of gazebo_motor_model in PX4-SITL_gazebo-classic and RotorS (F. Furrer et al.,
RotorS - A Modular Gazebo MAV Simulator Framework, 2016), rotor drag after P. Martin and E. Salaun, The True Role of
Accelerometer Feedback in Quadrotor Control, ICRA 2010; the thrust curve is the one that ArduPilot's MOT_THST_EXPO,
MOT_SPIN_MIN and MOT_SPIN_MAX linearise.
"""

from __future__ import annotations

from enum import IntEnum
from math import exp, sqrt

from cosim.kernel import kernel
from cosim_models.vehicles.dynamics.rigid_body import Vector

__all__ = [
    "MotorCurve",
    "command_share",
    "decay",
    "lagged",
    "rotor_force",
    "rotor_moment",
    "speed_command",
    "thrust_command",
]


class MotorCurve(IntEnum):
    """The quantity that is proportional to the command, and to which the lag applies."""

    speed = 1
    """Speed is linear in the command and follows with a lag (Gazebo's motor models)."""
    thrust = 2
    """Thrust is a quadratic function of the command and follows with a lag (ArduPilot's thrust curve)."""


@kernel
def _effective(command: float, command_min: float, command_max: float) -> float:
    part = (command - command_min) / (command_max - command_min)
    return 1.0 if part > 1.0 else part


@kernel
def speed_command(command: float, command_min: float, command_max: float, speed_min: float, speed_max: float) -> float:
    """Returns the commanded speed [rad/s]: 0 up to `command_min`, then linear from `speed_min` to `speed_max`."""
    if command <= command_min:
        return 0.0
    return speed_min + _effective(command, command_min, command_max) * (speed_max - speed_min)


@kernel
def thrust_command(command: float, command_min: float, command_max: float, expo: float) -> float:
    """Returns commanded thrust over maximum thrust: (1 - expo) c + expo c^2, c from command_min to command_max."""
    if command <= command_min:
        return 0.0
    c = _effective(command, command_min, command_max)
    return (1.0 - expo) * c + expo * c * c


@kernel
def command_share(thrust: float, expo: float) -> float:
    """Returns the command, 0 to 1 of its range, for a share of the greatest thrust: the inverse of `thrust_command`."""
    linear = 1.0 - expo
    root = linear + sqrt(max(linear * linear + 4.0 * expo * thrust, 0.0))
    return 2.0 * thrust / root if root > 0.0 else 0.0


@kernel
def decay(time_constant: float, h: float) -> float:
    """Returns the remaining fraction, after `h` seconds, of a decay with `time_constant` [s]; 0 if that is 0."""
    if time_constant <= 0.0:
        return 0.0
    return exp(-h / time_constant)


@kernel
def lagged(value: float, target: float, remaining: float) -> float:
    """Returns the exact solution of a first-order lag after the time for which `decay` returned `remaining`."""
    return target + (value - target) * remaining


@kernel
def rotor_force(speed: float, thrust: float, air: Vector, vanishing: float, drag: float) -> Vector:
    """Returns the force of one rotor [N, FRD].

    Args:
        speed: [rad/s], >= 0.
        thrust: static thrust at that speed [N].
        air: velocity of the hub relative to the air [m/s, FRD].
        vanishing: 1 / axial speed at which the thrust vanishes [s/m]; 0: thrust does not depend on it.
        drag: rotor drag coefficient lambda_1 [N s2/(rad m)]; the force opposes the velocity across the axis.
    """
    left = max(1.0 - abs(air[2]) * vanishing, 0.0)
    return (-speed * drag * air[0], -speed * drag * air[1], -thrust * left)


@kernel
def rotor_moment(speed: float, thrust: float, air: Vector, turning: float, moment: float, rolling: float) -> Vector:
    """Returns the moment of one rotor about its hub [N m, FRD].

    Args:
        speed, thrust, air: as for `rotor_force`; the drag torque follows the static thrust.
        turning: +1 counter-clockwise seen from above (turns the body clockwise, yaw > 0), -1 clockwise.
        moment: drag torque over thrust [m].
        rolling: rolling moment coefficient mu_1 [N s2/rad]; the moment opposes the velocity across the axis.
    """
    roll = turning * speed * rolling
    return (-roll * air[0], -roll * air[1], turning * moment * thrust)
