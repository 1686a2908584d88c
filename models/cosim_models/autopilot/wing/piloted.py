"""Modes in which a pilot flies on wings: MANUAL, STABILIZE, TRAINING, ACRO, FBWA, FBWB and CRUISE; and CIRCLE.

The sticks are those of `gcs.sticks`. MANUAL passes them on; STABILIZE levels the wings beneath them; TRAINING does so
beyond the limits of bank and pitch only. ACRO asks for rates, FBWA for bank and pitch, with the throttle of the pilot;
FBWB for a bank, a rate of climb and a speed, CRUISE for the same and, half a second after the stick of roll is centred,
for the line along the course of that moment. CIRCLE banks by a third of its limit. Kernels over a record that has
`PILOT_PARAMETERS`, `PILOT_MEMORY` and what `wing.flight` needs.

In modes that fly by themselves, and in CIRCLE, the sticks are added to bank, pitch and rudder (STICK_MIXING).

Differences from ArduPlane: no expo, no automatic trim, ACRO_LOCKING 0 only, no taildragger take-off; sticks are not
mixed into take-offs, nor into the rotors of a quadplane.

Source: ArduPilot, ArduPlane/mode_*.cpp, Attitude.cpp (update_load_factor, stick mixing), navigation.cpp (FBWB).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import roll_pitch_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import angle, real, whole
from cosim_models.autopilot.gcs.sticks import PITCH, ROLL, YAW, deflection, opening, overridden, tilt
from cosim_models.autopilot.wing.attitude import servos
from cosim_models.autopilot.wing.energy import CLIMB_P, clip
from cosim_models.autopilot.wing.flight import bank_for, permitted

__all__ = ["PILOT_MEMORY", "PILOT_PARAMETERS", "begin_pilot", "by_hand", "circling_bank", "demand", "mix_sticks"]
__all__ += ["line_bank", "roll_stick"]

_MANUAL, _CIRCLE, _STABILIZE, _TRAINING, _ACRO, _CRUISE = 0, 1, 2, 3, 4, 7
_FIRST_AUTO, _LAST_AUTO, _QRTL, _LOITER_ALT_QLAND, _AUTOLAND = 10, 15, 21, 25, 26  # modes that fly by themselves
_FBW, _NO_PITCH = 1, 4  # STICK_MIXING
_LOCKING_TIME, _LOCKING_SPEED = 0.5, 5.0  # s, m/s
_LOOK_AHEAD = 3.0  # s, in which CRUISE returns to its line
_RATE_P, _RATE_I = (0.15, 0.35), (1.0, 3.0)  # of roll and pitch: s/rad, 1/rad

PILOT_PARAMETERS = (
    real("ACRO_ROLL_RATE", "1", 180.0, "rate of roll of ACRO at full deflection, degrees per second"),
    real("ACRO_PITCH_RATE", "1", 180.0, "rate of pitch of ACRO at full deflection, degrees per second"),
    real("FBWB_CLIMB_RATE", "m/s", 2.0, "rate of climb of FBWB and CRUISE at full deflection"),
    angle("STAB_PITCH_DOWN", 2.0, "pitch by which FBWA lowers the nose with the throttle closed"),
    whole(
        "STICK_MIXING", 1, "1: sticks change modes that fly by themselves; 4: but not their pitch; 0, 3: they do not"
    ),
    whole("STALL_PREVENTION", 1, "1: the bank is limited by the speed; 0: it is not"),
)
PILOT_MEMORY = (
    Memory("rate_trim", shape=2, rare=True),  # integrals of the errors of the rates of roll and pitch
    Memory("climb_stick", rare=True),  # of FBWB and CRUISE, in the step before
    Memory("centred_since", rare=True),  # s: since when CRUISE finds the stick of roll centred; -1: it is not
    Memory("on_line", dtype="?", rare=True),
    Memory("line", shape=3, rare=True),  # m, m, rad: a point of the line of CRUISE, north and east, and its course
)


@kernel
def begin_pilot(m: Any) -> None:
    """Forgets the last time in these modes; required where one of them begins."""
    m.rate_trim[0], m.rate_trim[1] = 0.0, 0.0
    m.climb_stick, m.centred_since = 0.0, -1.0
    m.on_line = False


@kernel
def _speed(m: Any) -> float:
    return math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2)


@kernel
def roll_stick(m: Any, t: float) -> float:
    """Returns the bank [rad] that the stick of roll asks for."""
    return permitted(m, tilt(m, ROLL, t) * math.radians(m.ROLL_LIMIT_DEG))


@kernel
def _pitch_stick(m: Any, throttle: float, t: float) -> float:
    """Returns the pitch [rad] that the stick of pitch asks for, lower with a throttle below TRIM_THROTTLE."""
    stick = tilt(m, PITCH, t)
    pitch = stick * (m.PTCH_LIM_MAX_DEG if stick > 0.0 else -m.PTCH_LIM_MIN_DEG)
    share = 100.0 * throttle / m.TRIM_THROTTLE if m.TRIM_THROTTLE > 0.0 else 1.0
    pitch -= m.STAB_PITCH_DOWN * max(1.0 - share, 0.0)
    return math.radians(clip(pitch, m.PTCH_LIM_MIN_DEG, m.PTCH_LIM_MAX_DEG))


@kernel
def _set(m: Any, i: int, command: float) -> None:
    """Commands a surface, -1 to 1."""
    m.motor[i] = 0.5 + 0.5 * clip(command, -1.0, 1.0)


@kernel
def _add(m: Any, i: int, command: float, share: float) -> None:
    """Adds the command of a stick to a share of that of the autopilot."""
    _set(m, i, share * (2.0 * float(m.motor[i]) - 1.0) + command)


@kernel
def _rates(m: Any, roll: float, pitch: float, h: float) -> None:
    """Commands aileron and elevator for rates of roll and pitch [rad/s]."""
    wanted = (roll, pitch)
    for i in range(2):
        miss = wanted[i] - m.angular_velocity[i]
        m.rate_trim[i] = clip(m.rate_trim[i] + _RATE_I[i] * miss * h, -1.0, 1.0)
        _set(m, i, _RATE_P[i] * miss + m.rate_trim[i])


@kernel
def _train(m: Any, throttle: float, t: float, h: float) -> None:
    """Passes the sticks on within the limits of bank and pitch, and holds these limits beyond them."""
    roll, pitch = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    bank = math.radians(m.ROLL_LIMIT_DEG)
    low, high = math.radians(m.PTCH_LIM_MIN_DEG), math.radians(m.PTCH_LIM_MAX_DEG)
    servos(m, clip(roll, -bank, bank), clip(pitch, low, high), throttle, h)
    right, up = tilt(m, ROLL, t), tilt(m, PITCH, t)
    back, fore = 2.0 * float(m.motor[0]) - 1.0, 2.0 * float(m.motor[1]) - 1.0
    if abs(roll) < bank or (right < back if roll > 0.0 else right > back):
        _set(m, 0, right)
    if low < pitch < high or (up < fore if pitch > 0.0 else up > fore):
        _set(m, 1, up)


@kernel
def by_hand(m: Any, t: float, h: float) -> None:
    """Flies MANUAL, STABILIZE, TRAINING, ACRO or FBWA: the throttle is the pilot's."""
    rudder, open_ = deflection(m, YAW, t), opening(m, t)
    throttle = open_ if m.mode == _MANUAL else min(open_, 0.01 * m.THR_MAX)
    m.speed_before, m.acceleration = _speed(m), 0.0
    if m.mode == _MANUAL:
        _set(m, 0, tilt(m, ROLL, t))
        _set(m, 1, tilt(m, PITCH, t))
        m.motor[2] = throttle
        _set(m, 3, rudder)
    elif m.mode == _STABILIZE:
        servos(m, 0.0, 0.0, throttle, h)
        for i in range(2):
            _add(m, i, deflection(m, i, t), 1.0 - min(abs(tilt(m, i, t)), 1.0))
        _add(m, 3, rudder, 1.0)
    elif m.mode == _TRAINING:
        _train(m, throttle, t, h)
        _set(m, 3, rudder)
    elif m.mode == _ACRO:
        roll, pitch = deflection(m, ROLL, t), deflection(m, PITCH, t)
        _rates(m, roll * math.radians(m.ACRO_ROLL_RATE), pitch * math.radians(m.ACRO_PITCH_RATE), h)
        m.motor[2] = throttle
        _set(m, 3, rudder)
    else:
        servos(m, roll_stick(m, t), _pitch_stick(m, throttle, t), throttle, h)
        _add(m, 3, rudder, 1.0)


# ---- modes that fly by themselves ----------------------------------------------------------------------------------


@kernel
def _stretched(stick: float) -> float:
    """Returns the deflection of a stick, which beyond a half grows to twice the greatest."""
    return 3.0 * stick - 1.0 if stick > 0.5 else 3.0 * stick + 1.0 if stick < -0.5 else stick


@kernel
def mix_sticks(m: Any, t: float) -> None:
    """Notes by how much the sticks change bank, pitch and rudder; required in every step while m.sticks_known."""
    m.sticks_known = False
    for i in range(4):
        m.sticks_known = m.sticks_known or overridden(m, i, t)
    flies = m.STICK_MIXING in (_FBW, _NO_PITCH) and (
        _FIRST_AUTO <= m.mode <= _LAST_AUTO or m.mode in (_QRTL, _LOITER_ALT_QLAND, _AUTOLAND)
    )
    m.mixes = m.sticks_known and (flies or m.mode == _CIRCLE)
    if not m.mixes:
        return
    m.mixed[0] = math.radians(m.ROLL_LIMIT_DEG) * _stretched(deflection(m, ROLL, t))
    pitch = 0.0 if m.STICK_MIXING == _NO_PITCH else _stretched(deflection(m, PITCH, t))
    m.mixed[1] = math.radians(m.PTCH_LIM_MAX_DEG if pitch > 0.0 else -m.PTCH_LIM_MIN_DEG) * pitch
    m.mixed[2] = deflection(m, YAW, t)


@kernel
def circling_bank(m: Any) -> float:
    """Returns the bank [rad] of CIRCLE."""
    return permitted(m, math.radians(m.ROLL_LIMIT_DEG) / 3.0)


@kernel
def _climb(m: Any, t: float, h: float) -> float:
    """Moves the target's height with the stick of pitch, and returns the rate of climb [m/s].

    When the stick is centred, the present height is kept.
    """
    stick = deflection(m, PITCH, t)
    if (stick <= 0.0 and m.climb_stick > 0.0) or (stick >= 0.0 and m.climb_stick < 0.0):
        m.guided_position[2] = m.position[2]
    m.climb_stick = stick
    rate = clip(m.FBWB_CLIMB_RATE * stick, -m.TECS_SINK_MAX, m.TECS_CLMB_MAX)
    m.guided_position[2] -= rate * h
    return rate


@kernel
def line_bank(m: Any) -> float:
    """Returns the bank [rad] that leads to the line `m.line` and along it."""
    c, s = math.cos(m.line[2]), math.sin(m.line[2])
    right = (m.position[1] - m.line[1]) * c - (m.position[0] - m.line[0]) * s
    return bank_for(m, m.line[2] - math.atan(right / (_LOOK_AHEAD * max(_speed(m), _LOCKING_SPEED))))


@kernel
def _cruising_bank(m: Any, t: float) -> float:
    vn, ve = m.velocity[0], m.velocity[1]
    if deflection(m, ROLL, t) != 0.0 or deflection(m, YAW, t) != 0.0:
        m.on_line, m.centred_since = False, -1.0
    elif not m.on_line:
        if m.centred_since < 0.0 and vn * vn + ve * ve >= _LOCKING_SPEED * _LOCKING_SPEED:
            m.centred_since = t
        if m.centred_since >= 0.0 and t - m.centred_since > _LOCKING_TIME:
            m.on_line = True
            m.line[0], m.line[1], m.line[2] = m.position[0], m.position[1], math.atan2(ve, vn)
    return line_bank(m) if m.on_line else roll_stick(m, t)


@kernel
def demand(m: Any, t: float, h: float) -> tuple[float, float, float]:
    """Returns bank [rad], down coordinate and speed [m/s] of FBWB and CRUISE, and moves the target's height."""
    down = m.guided_position[2] - _climb(m, t, h) / CLIMB_P
    bank = _cruising_bank(m, t) if m.mode == _CRUISE else roll_stick(m, t)
    return bank, down, float(m.AIRSPEED_MIN + (m.AIRSPEED_MAX - m.AIRSPEED_MIN) * opening(m, t))
