"""Modes in which a pilot flies on lifting rotors: QSTABILIZE, QHOVER, QLOITER and QACRO.

QSTABILIZE leans and thrusts as the sticks say, QHOVER leans and climbs; QLOITER moves, and brakes and stays where the
sticks are centred; QACRO asks for rates. The stick of yaw asks for a rate of turn. In air mode, the rotors hold the
attitude with the throttle closed, too. Kernels over a record that has `LIFT_PARAMETERS`, `LIFT_MEMORY` and what
`wing.hover` needs.

Differences from ArduPlane: QLOITER's limits of jerk and its delay before it brakes are missing, and so are expo and
time constant of yaw and Q_PILOT_ACCEL_Z.

Source: ArduPilot, ArduPlane/mode_q*.cpp, quadplane.cpp (get_pilot_*), AC_Loiter, AP_Math (throttle_curve).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import euler_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.sticks import PITCH, ROLL, THROTTLE, YAW, deflection, opening
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.wing.attitude import rest
from cosim_models.autopilot.wing.energy import clip
from cosim_models.autopilot.wing.hover import glide, lean_by_rates, lean_to, level_flight, no_lift

__all__ = ["LIFT_MEMORY", "LIFT_PARAMETERS", "begin_lifted", "by_rotors", "lifts_off"]

_QSTABILIZE, _QHOVER, _QLOITER, _QACRO = 17, 18, 19, 23
_BY_HAND = (0, 2, 3, 4, 5)  # MANUAL, STABILIZE, TRAINING, ACRO, FBWA
_GRAVITY = 9.80665
_LOITER_SHARE = 2.0 / 3.0  # of Q_ANGLE_MAX, with Q_LOIT_ANG_MAX 0
_LEAD = 2.0  # m by which the height of the target may be ahead
_CLEAR = 0.1  # m above the ground

LIFT_PARAMETERS = (
    real("Q_PILOT_SPD_UP", "m/s", 2.5, "rate of climb at full deflection", 0.1),
    real("Q_PILOT_SPD_DN", "m/s", 0.0, "rate of descent at full deflection, 0: as Q_PILOT_SPD_UP"),
    real("Q_PLT_Y_RATE", "1", 100.0, "rate of turn at full deflection, degrees per second"),
    real("Q_THROTTLE_EXPO", "1", 0.2, "of the throttle curve, whose middle is Q_M_THST_HOVER"),
    real("Q_LOIT_SPEED", "cm/s", 500.0, "speed of QLOITER at full deflection", 1.0),
    real("Q_LOIT_BRK_ACCEL", "cm/s2", 50.0, "deceleration of QLOITER with centred sticks, beside that of its drag"),
    real("Q_ACRO_RLL_RATE", "1", 360.0, "rate of roll of QACRO at full deflection, degrees per second"),
    real("Q_ACRO_PIT_RATE", "1", 180.0, "rate of pitch of QACRO at full deflection, degrees per second"),
    real("Q_ACRO_YAW_RATE", "1", 90.0, "rate of yaw of QACRO at full deflection, degrees per second"),
)
LIFT_MEMORY = (Memory("stick_velocity", shape=2, rare=True),)  # m/s, north and east, of QLOITER


@kernel
def begin_lifted(m: Any) -> None:
    """Begins QLOITER with the present velocity, at most Q_LOIT_SPEED; required where one of these modes begins."""
    vn, ve = m.velocity[0], m.velocity[1]
    share = min(0.01 * m.Q_LOIT_SPEED / max(math.sqrt(vn * vn + ve * ve), 1e-3), 1.0)
    m.stick_velocity[0], m.stick_velocity[1] = share * vn, share * ve


@kernel
def _expo(share: float, x: float) -> float:
    return (1.0 - share) * x + share * x * x * x


@kernel
def _curved(m: Any, stick: float) -> float:
    """Returns the mean thrust, of 1, for a stick of the throttle, 0 to 1: its middle is that of the hover."""
    middle, low = float(m.Q_M_THST_HOVER), clip(m.Q_THROTTLE_EXPO, 0.0, 1.0)
    high = clip(low + 1.25 * (1.0 - low) * (0.5 - middle) / 0.5, 0.0, 1.0)
    if stick < 0.5:
        return middle * (1.0 + _expo(low, 2.0 * stick - 1.0))
    return middle + (1.0 - middle) * _expo(high, 2.0 * stick - 1.0)


@kernel
def _climb(m: Any, t: float) -> float:
    """Returns the rate of climb [m/s] that the stick of the throttle asks for."""
    stick = deflection(m, THROTTLE, t)
    down = m.Q_PILOT_SPD_DN if m.Q_PILOT_SPD_DN > 0.0 else m.Q_PILOT_SPD_UP
    return float(stick * (m.Q_PILOT_SPD_UP if stick > 0.0 else down))


@kernel
def _move_height(m: Any, climb: float, h: float) -> None:
    """Moves the height of the target with a rate of climb [m/s]."""
    if climb != 0.0:
        d = m.guided_position[2] - climb * h
        m.guided_position[2] = clip(d, m.position[2] - _LEAD, m.position[2] + _LEAD)


@kernel
def _leans(m: Any, t: float) -> tuple[float, float]:
    """Returns roll and pitch [rad] that the sticks ask for, within the limits of the wing, too."""
    roll, pitch = deflection(m, ROLL, t), deflection(m, PITCH, t)
    least = m.PTCH_LIM_MAX_DEG if pitch > 0.0 else -m.PTCH_LIM_MIN_DEG
    return (
        math.radians(roll * min(m.ROLL_LIMIT_DEG, m.Q_ANGLE_MAX)),
        math.radians(pitch * min(least, m.Q_ANGLE_MAX)),
    )


@kernel
def _loiter(m: Any, climb: float, turn: float, t: float, h: float) -> None:
    """Accelerates as the sticks say, against a drag that leaves Q_LOIT_SPEED at full deflection."""
    ahead, right = -deflection(m, PITCH, t), deflection(m, ROLL, t)
    size = max(math.sqrt(ahead * ahead + right * right), 1.0)
    most = _GRAVITY * math.tan(math.radians(_LOITER_SHARE * m.Q_ANGLE_MAX))
    yaw = heading(m)
    c, s = math.cos(yaw), math.sin(yaw)
    vn, ve = m.stick_velocity[0], m.stick_velocity[1]
    vn += most / size * (ahead * c - right * s) * h
    ve += most / size * (ahead * s + right * c) * h
    speed = math.sqrt(vn * vn + ve * ve)
    if speed > 0.0:
        slower = most * speed / (0.01 * m.Q_LOIT_SPEED)
        if ahead == 0.0 and right == 0.0:
            slower += 0.01 * m.Q_LOIT_BRK_ACCEL
        share = max(1.0 - slower * h / speed, 0.0)
        vn, ve = share * vn, share * ve
    m.stick_velocity[0], m.stick_velocity[1] = vn, ve
    m.guided_position[0] += vn * h
    m.guided_position[1] += ve * h
    glide(m, vn, ve, climb, turn, h)


@kernel
def lifts_off(m: Any, t: float) -> bool:
    """Returns whether the pilot has the motors near the ground: on the rotors, off it, or with the throttle raised."""
    if m.mode in _BY_HAND:
        return True
    if m.mode not in (_QSTABILIZE, _QHOVER, _QLOITER, _QACRO):
        return False
    raised = opening(m, t) > 0.0 if m.mode in (_QSTABILIZE, _QACRO) else deflection(m, THROTTLE, t) > 0.0
    return raised or m.ground_down - m.position[2] > _CLEAR


@kernel
def by_rotors(m: Any, t: float, h: float) -> None:
    """Flies QSTABILIZE, QHOVER, QLOITER or QACRO."""
    m.vtol = True
    turn = deflection(m, YAW, t) * math.radians(m.Q_PLT_Y_RATE)
    if m.mode == _QHOVER or m.mode == _QLOITER:
        climb = _climb(m, t)
        _move_height(m, climb, h)
        if m.mode == _QLOITER:
            _loiter(m, climb, turn, t, h)
        else:
            roll, pitch = _leans(m, t)
            level_flight(m, roll, pitch, climb, turn, h)
        return
    stick = opening(m, t)
    if stick <= 0.0 and not (m.air_mode or m.armed_in_air_mode):  # the rotors idle
        rest(m)
        no_lift(m)
    elif m.mode == _QSTABILIZE:
        roll, pitch = _leans(m, t)
        lean_to(m, roll, pitch, turn, _curved(m, stick), h)
    else:
        rest(m)
        p = deflection(m, ROLL, t) * math.radians(m.Q_ACRO_RLL_RATE)
        q = deflection(m, PITCH, t) * math.radians(m.Q_ACRO_PIT_RATE)
        r = deflection(m, YAW, t) * math.radians(m.Q_ACRO_YAW_RATE)
        m.held_heading = heading(m)
        q4 = m.attitude
        asked = m.attitude_asked
        asked[0], asked[1], asked[2] = euler_from_quaternion((q4[0], q4[1], q4[2], q4[3]))
        lean_by_rates(m, p, q, r, _curved(m, stick), 1.0, h)
