"""Hovering on four lifting rotors: the control of position, attitude and thrust of quadplanes.

A position is approached by ArduPilot's square root controller; the velocity that it demands leads to an acceleration,
that to a lean and a thrust, and the lean, by rates, to differences of thrust. The nose is not turned to the target, and
above a walking speed it is left to the wind. At speed, the nose may rise only as far as the wing does not lift the
vehicle away: not at all at AIRSPEED_MIN.

Kernels over a record that has `HOVER_PARAMETERS`, `HOVER_MEMORY` and what `wing.flight` needs. They write the last four
elements of `motor`, in ArduPilot's order of an X: front right, rear left, front left, rear right.

Sources: ArduPilot, ArduPlane/quadplane.cpp, AC_PosControl, AP_MotorsMulticopter (names, structure, thrust curve). The
gains are ours, for the inertia of `Quadplane`.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import euler_from_quaternion, roll_pitch_from_quaternion, wrap_pi, yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import angle, real
from cosim_models.autopilot.wing.attitude import rest, servos
from cosim_models.autopilot.wing.circling import leave_circle
from cosim_models.autopilot.wing.energy import clip

__all__ = ["HOVER_MEMORY", "HOVER_PARAMETERS", "glide", "hover", "lean_by_rates", "lean_to", "level_flight"]
__all__ += ["lift_along", "lift_off", "no_lift", "rise", "sink", "square_root_speed"]

_GRAVITY = 9.80665
_TURNING = 0.05  # rad/s
_WALKING = 2.0  # m/s, above which the nose is left to the wind
_SURFACES = 5.0  # m/s, from which on the surfaces help
_LEAN, _TURN = 0.25, 0.15  # greatest differences of thrust, of 1
_LIFT = 2.0  # m/s2, greatest vertical acceleration
_FIRST = 4  # of the elements of `motor`
_SLOWS = 6.0  # m above Q_LAND_FINAL_ALT, over which a descent becomes slower

HOVER_PARAMETERS = (
    angle("Q_ANGLE_MAX", 30.0, "greatest lean; ArduPlane has it in centidegrees"),
    real("Q_P_POSXY_P", "1/s", 0.5, "horizontal speed over position error", 1e-3),
    real("Q_P_POSZ_P", "1/s", 1.0, "vertical speed over position error", 1e-3),
    real("Q_P_VELXY_P", "1/s", 1.0, "horizontal acceleration over velocity error", 1e-3),
    real("Q_P_VELXY_I", "1/s2", 0.2, "its integral"),
    real("Q_P_VELZ_P", "1/s", 2.0, "vertical acceleration over velocity error", 1e-3),
    real("Q_WP_SPEED", "cm/s", 500.0, "greatest horizontal speed", 1.0),
    real("Q_WP_SPEED_UP", "cm/s", 250.0, "greatest speed of climb", 1.0),
    real("Q_WP_SPEED_DN", "cm/s", 150.0, "greatest speed of descent", 1.0),
    real("Q_TRANS_DECEL", "m/s2", 1.0, "deceleration before a place", 0.1),
    real("Q_A_ANG_RLL_P", "1/s", 3.5, "rate over error of roll and pitch", 1e-3),
    real("Q_A_ANG_YAW_P", "1/s", 0.6, "rate over error of the heading"),
    real("Q_A_RAT_RLL_P", "s/rad", 0.5, "difference of thrust over error of the rates of roll and pitch", 1e-3),
    real("Q_A_RAT_RLL_I", "1/rad", 0.25, "its integral"),
    real("Q_A_RAT_YAW_P", "s/rad", 1.5, "difference of thrust over error of the rate of yaw"),
    real("Q_M_THST_EXPO", "1", 0.65, "of the thrust curve", 1e-3),
    real("Q_M_THST_HOVER", "1", 0.39, "thrust in hover over the greatest", 1e-3),
    real("Q_M_SPIN_MIN", "1", 0.15, "command below which there is no thrust"),
    real("Q_M_SPIN_MAX", "1", 0.95, "command of the greatest thrust"),
    real("Q_LAND_FINAL_ALT", "m", 6.0, "height above home below which it descends slowly"),
    real("Q_LAND_FINAL_SPD", "m/s", 0.5, "of the descent to the ground", 0.1),
)
HOVER_MEMORY = (
    Memory("held_heading"),  # rad
    Memory("drift", shape=2),  # m/s2, integral of the velocity error, north and east
    Memory("lean_trim", shape=2),  # integrals of the rates of roll and pitch
    Memory("lift_trim"),  # integral of the vertical velocity error, share of the greatest thrust
    Memory("turned", dtype="?", rare=True),  # it still turns, as a pilot asked
    Memory("lift"),  # mean of the thrusts, of 1
    Memory("turns_to_place", dtype="?", rare=True),  # `held_heading` is that to its place
    Memory("arrival_speed"),  # m/s that it may still have after its flight on the wing; 0: Q_WP_SPEED
)


@kernel
def square_root_speed(error: float, gain: float, deceleration: float) -> float:
    """Returns the speed [m/s] with which to approach a target `error` [m] away: ArduPilot's sqrt_controller."""
    linear = deceleration / (gain * gain)
    if error <= linear:
        return gain * error
    return math.sqrt(2.0 * deceleration * (error - 0.5 * linear))


@kernel
def no_lift(m: Any) -> None:
    """Stops the lifting rotors."""
    for i in range(4):
        m.motor[_FIRST + i] = 0.0
    m.lift = 0.0
    m.attitude_asked[3] = 0.0
    m.lift_trim = 0.0
    m.lean_trim[0], m.lean_trim[1] = 0.0, 0.0
    m.drift[0], m.drift[1] = 0.0, 0.0


@kernel
def _command(m: Any, thrust: float) -> float:
    """Returns the command for a share of the greatest thrust: the inverse of the thrust curve."""
    expo = float(m.Q_M_THST_EXPO)
    straight = 1.0 - expo
    c = (math.sqrt(straight * straight + 4.0 * expo * clip(thrust, 0.0, 1.0)) - straight) / (2.0 * expo)
    return float(m.Q_M_SPIN_MIN + c * (m.Q_M_SPIN_MAX - m.Q_M_SPIN_MIN))


@kernel
def _lean(m: Any, roll: float, pitch: float, turn: float, lift: float, share: float, h: float) -> None:
    """Commands the rotors: roll and pitch [rad], rate of yaw [rad/s], mean thrust, and the share of the torques."""
    now_roll, now_pitch = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    m.attitude_asked[0], m.attitude_asked[1], m.attitude_asked[2] = roll, pitch, m.held_heading
    lean_by_rates(m, m.Q_A_ANG_RLL_P * (roll - now_roll), m.Q_A_ANG_RLL_P * (pitch - now_pitch), turn, lift, share, h)


@kernel
def lean_by_rates(m: Any, p: float, q: float, turn: float, lift: float, share: float, h: float) -> None:
    """Commands the rotors for rates of roll, pitch and yaw [rad/s], a mean thrust, and the share of the torques."""
    w = m.angular_velocity
    p_error = p - w[0]
    q_error = q - w[1]
    m.lean_trim[0] = clip(m.lean_trim[0] + m.Q_A_RAT_RLL_I * p_error * h, -0.5 * _LEAN, 0.5 * _LEAN)
    m.lean_trim[1] = clip(m.lean_trim[1] + m.Q_A_RAT_RLL_I * q_error * h, -0.5 * _LEAN, 0.5 * _LEAN)
    u = share * clip(m.Q_A_RAT_RLL_P * p_error + m.lean_trim[0], -_LEAN, _LEAN)
    v = share * clip(m.Q_A_RAT_RLL_P * q_error + m.lean_trim[1], -_LEAN, _LEAN)
    z = share * clip(m.Q_A_RAT_YAW_P * (turn - w[2]), -_TURN, _TURN)
    m.lift = lift
    m.attitude_asked[3] = lift
    m.motor[_FIRST] = _command(m, lift - u + v + z)
    m.motor[_FIRST + 1] = _command(m, lift + u - v + z)
    m.motor[_FIRST + 2] = _command(m, lift + u + v - z)
    m.motor[_FIRST + 3] = _command(m, lift - u - v - z)


@kernel
def _thrust(m: Any, climb: float, h: float) -> float:
    """Returns the mean thrust, of 1, for a rate of climb [m/s]."""
    error = climb + m.velocity[2]  # upwards
    m.lift_trim = clip(m.lift_trim + 0.05 * error * h, -m.Q_M_THST_HOVER, 0.3)
    upright = 1.0 - 2.0 * (m.attitude[1] * m.attitude[1] + m.attitude[2] * m.attitude[2])
    wanted = m.Q_M_THST_HOVER * (1.0 + clip(m.Q_P_VELZ_P * error, -_LIFT, _LIFT) / _GRAVITY) + m.lift_trim
    return clip(wanted / max(upright, 0.5), 0.02, 0.9)


@kernel
def _climb_to(m: Any, d: float) -> float:
    """Returns the rate of climb [m/s] towards a down coordinate."""
    error = m.position[2] - d
    speed = square_root_speed(abs(error), m.Q_P_POSZ_P, 0.5 * _LIFT)
    return float(min(speed, 0.01 * m.Q_WP_SPEED_UP) if error > 0.0 else -min(speed, 0.01 * m.Q_WP_SPEED_DN))


@kernel
def _heading(m: Any) -> float:
    return float(yaw_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3])))


@kernel
def _turn(m: Any) -> float:
    """Returns the rate of yaw [rad/s] that holds the heading, or follows the wind."""
    heading = _heading(m)
    if m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1] > _WALKING * _WALKING and not m.turns_to_place:
        m.held_heading = heading
    return float(m.Q_A_ANG_YAW_P * wrap_pi(m.held_heading - heading))


@kernel
def _turning(m: Any, asked: float) -> float:
    """Returns the rate of yaw [rad/s] that a pilot asks for, or that of `_turn`."""
    if asked == 0.0 and not (m.turned and abs(m.angular_velocity[2]) > _TURNING):
        m.turned = False
        return _turn(m)
    m.turned = True
    m.held_heading = _heading(m)
    return asked


@kernel
def _move(m: Any, vn: float, ve: float, climb: float, turn: float, h: float) -> None:
    """Leans and lifts towards a velocity, and turns with a rate of yaw [rad/s]."""
    most = math.radians(m.Q_ANGLE_MAX)
    en, ee = vn - m.velocity[0], ve - m.velocity[1]
    m.drift[0] = clip(m.drift[0] + m.Q_P_VELXY_I * clip(en, -1.0, 1.0) * h, -3.0, 3.0)
    m.drift[1] = clip(m.drift[1] + m.Q_P_VELXY_I * clip(ee, -1.0, 1.0) * h, -3.0, 3.0)
    an, ae = m.Q_P_VELXY_P * en + m.drift[0], m.Q_P_VELXY_P * ee + m.drift[1]
    heading = _heading(m)
    c, s = math.cos(heading), math.sin(heading)
    ahead, right = an * c + ae * s, ae * c - an * s
    speed = m.velocity[0] * c + m.velocity[1] * s
    rise = most * clip(1.0 - speed / m.AIRSPEED_MIN, 0.0, 1.0)
    pitch = clip(-math.atan(ahead / _GRAVITY), -most, rise)
    roll = clip(math.atan(right * math.cos(pitch) / _GRAVITY), -most, most)
    if speed > _SURFACES:
        servos(m, roll, pitch, 0.0, h)
    else:
        rest(m)
    _lean(m, roll, pitch, turn, _thrust(m, climb, h), 1.0, h)
    m.desired_velocity[0], m.desired_velocity[1], m.desired_velocity[2] = vn, ve, -climb


@kernel
def _towards(m: Any, n: float, e: float) -> tuple[float, float]:
    """Returns the velocity north and east [m/s] towards a place."""
    dn, de = n - m.position[0], e - m.position[1]
    distance = math.sqrt(dn * dn + de * de)
    if distance == 0.0:
        return 0.0, 0.0
    most = max(0.01 * m.Q_WP_SPEED, m.arrival_speed)
    speed = min(square_root_speed(distance, m.Q_P_POSXY_P, m.Q_TRANS_DECEL), most) / distance
    return speed * dn, speed * de


@kernel
def hover(m: Any, n: float, e: float, d: float, h: float) -> None:
    """Flies to a place on the rotors, and hovers there."""
    leave_circle(m)
    vn, ve = _towards(m, n, e)
    _move(m, vn, ve, _climb_to(m, d), _turn(m), h)


@kernel
def glide(m: Any, vn: float, ve: float, climb: float, turn: float, h: float) -> None:
    """Follows the target, which moves with a velocity [m/s, north, east, up], and turns with a rate [rad/s]."""
    n, e = _towards(m, m.guided_position[0], m.guided_position[1])
    _move(m, n + vn, e + ve, _climb_to(m, m.guided_position[2]) + climb, _turning(m, turn), h)


@kernel
def sink(m: Any, n: float, e: float, h: float) -> None:
    """Descends to the ground above a place, the slower the nearer to Q_LAND_FINAL_ALT."""
    vn, ve = _towards(m, n, e)
    share = clip((m.home[2] - m.position[2] - m.Q_LAND_FINAL_ALT) / _SLOWS, 0.0, 1.0)
    _move(m, vn, ve, -float(m.Q_LAND_FINAL_SPD * (1.0 - share) + 0.01 * m.Q_WP_SPEED_DN * share), _turn(m), h)


@kernel
def rise(m: Any, h: float) -> None:
    """Climbs straight up with Q_WP_SPEED_UP."""
    _move(m, 0.0, 0.0, 0.01 * float(m.Q_WP_SPEED_UP), _turn(m), h)


@kernel
def level_flight(m: Any, roll: float, pitch: float, climb: float, turn: float, h: float) -> None:
    """Leans by roll and pitch [rad] at the height of the target, which moves with a rate of climb [m/s]."""
    rest(m)
    lift = _thrust(m, _climb_to(m, m.guided_position[2]) + climb, h)
    _lean(m, roll, pitch, _turning(m, turn), lift, 1.0, h)


@kernel
def lean_to(m: Any, roll: float, pitch: float, turn: float, lift: float, h: float) -> None:
    """Leans by roll and pitch [rad] with a mean thrust, of 1, in level flight."""
    rest(m)
    upright = 1.0 - 2.0 * (m.attitude[1] * m.attitude[1] + m.attitude[2] * m.attitude[2])
    _lean(m, roll, pitch, _turning(m, turn), clip(lift / max(upright, 0.5), 0.0, 0.95), 1.0, h)


@kernel
def lift_off(m: Any, roll: float, turn: float, d: float, share: float, h: float) -> None:
    """Carries a share of the weight, with a roll [rad] and a rate of yaw [rad/s], while the wing takes it over."""
    now_pitch = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))[1]
    pitch = 0.0 if share == 1.0 else now_pitch
    lift = _thrust(m, _climb_to(m, d), h) if share == 1.0 else m.lift
    _lean(m, roll, pitch, turn, lift, share, h)


@kernel
def lift_along(m: Any, roll: float, pitch: float, turn: float, d: float, h: float) -> None:
    """Carries the weight that the wing does not, with its roll and pitch [rad] and a rate of yaw [rad/s]."""
    _lean(m, roll, pitch, turn, _thrust(m, _climb_to(m, d), h), 1.0, h)
