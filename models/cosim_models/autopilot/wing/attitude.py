"""Attitude of flight on wings: the surfaces for a bank and a pitch.

The error of an angle, over RLL2SRV_TCONST or PTCH2SRV_TCONST, is the rate that is asked for, at most RLL2SRV_RMAX,
PTCH2SRV_RMAX_UP and PTCH2SRV_RMAX_DN; in turns, the pitch also has the rate of the turn. A rate is multiplied by the
feed-forward RLL_RATE_FF, its error by P, D and I. Gains are ArduPlane's: degrees of deflection, of 45, for degrees per
second. The rudder coordinates turns.

Kernels over a record with `ATTITUDE_PARAMETERS` and `ATTITUDE_MEMORY` beside those of `wing.energy`, `wing.piloted` and
`wing.functions`. They write the first four elements of `motor`: aileron, elevator, throttle, rudder.

Differences from ArduPlane: the start values are for the vehicles here, the gains do not change with the speed
(SCALING_SPEED), and SMAX counts only while AUTOTUNE runs.

Source: ArduPilot, AP_RollController.cpp, AP_PitchController.cpp.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory, Variable
from cosim.frames import roll_pitch_from_quaternion, wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.wing.autotune import AUTOTUNE_MEMORY, AUTOTUNE_PARAMETERS, damping, tuned
from cosim_models.autopilot.wing.energy import clip

__all__ = ["ATTITUDE_MEMORY", "ATTITUDE_PARAMETERS", "rest", "servos"]

_GRAVITY = 9.80665
_UPRIGHT, _STEEP = math.cos(1.0), math.tan(1.0)  # of the bank beyond which the turn does not become tighter
_WHOLE = math.degrees(1.0) / 45.0  # of a deflection, for one of 1 rad


def _rate_gains(axis: str, ff: float, p: float, i: float) -> tuple[Variable, ...]:
    return (
        real(f"{axis}_RATE_FF", "1", ff, "deflection over the rate that is asked for"),
        real(f"{axis}_RATE_P", "1", p, "deflection over the error of the rate"),
        real(f"{axis}_RATE_I", "1", i, "deflection over the integral of this error"),
        real(f"{axis}_RATE_D", "1", 0.0, "deflection over the change of this error"),
        real(f"{axis}_RATE_IMAX", "1", 0.666, "limit of the part of the integral, of 0.785"),
        real(f"{axis}_RATE_FLTD", "Hz", 12.0, "filter of the change of the error; 0: none"),
        real(f"{axis}_RATE_SMAX", "1", 150.0, "change of the deflection, degrees per second, that is an oscillation"),
    )


ATTITUDE_PARAMETERS = (
    real("RLL2SRV_TCONST", "s", 0.5, "time in which a bank is to be reached", 0.05),
    real("RLL2SRV_RMAX", "1", 0.0, "greatest rate of roll, degrees per second; 0: none"),
    *_rate_gains("RLL", 0.275, 0.118, 0.0),
    real("PTCH2SRV_TCONST", "s", 0.5, "time in which a pitch is to be reached", 0.05),
    real("PTCH2SRV_RMAX_UP", "1", 0.0, "greatest rate of pitch, degrees per second; 0: none"),
    real("PTCH2SRV_RMAX_DN", "1", 0.0, "greatest rate downwards, degrees per second; 0: none"),
    real("PTCH2SRV_RLL", "1", 1.0, "share of the rate of a turn that is asked for"),
    *_rate_gains("PTCH", 0.35, 0.275, 0.31),
    *AUTOTUNE_PARAMETERS,
)
ATTITUDE_MEMORY = (
    Memory("aileron_trim"),  # rad, parts of the integrals
    Memory("elevator_trim"),
    *AUTOTUNE_MEMORY,
)


@kernel
def rest(m: Any) -> None:
    m.motor[0], m.motor[1], m.motor[2], m.motor[3] = 0.5, 0.5, 0.0, 0.5


@kernel
def _sine_and_cosine_of_roll(m: Any) -> tuple[float, float]:
    """Returns both in fewer instructions than by the angle; those of 0 if vertical."""
    w, x, y, z = m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]
    side, up = 2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)
    size = math.sqrt(side * side + up * up)
    return (side / size, up / size) if size > 1e-6 else (0.0, 1.0)


@kernel
def servos(m: Any, bank: float, pitch: float, throttle: float, h: float) -> None:
    """Commands the deflections for a bank and a pitch [rad], and the throttle."""
    roll, nose = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    p, q, r = float(m.angular_velocity[0]), float(m.angular_velocity[1]), float(m.angular_velocity[2])
    speed = max(math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2), 5.0)
    across, upright = _sine_and_cosine_of_roll(m)
    up = 1.0
    if m.inverted:
        bank, up = bank + math.pi, -1.0
    slope = across / upright if up * upright > _UPRIGHT else up * math.copysign(_STEEP, across)
    turn = _GRAVITY * slope / speed  # rad/s of a level turn
    roll_error, pitch_error = wrap_pi(bank - roll), pitch - nose
    roll_rate, tilt = roll_error / m.RLL2SRV_TCONST, pitch_error / m.PTCH2SRV_TCONST
    if m.RLL2SRV_RMAX + m.PTCH2SRV_RMAX_UP + m.PTCH2SRV_RMAX_DN > 0.0:
        if m.RLL2SRV_RMAX > 0.0:
            roll_rate = clip(roll_rate, -math.radians(m.RLL2SRV_RMAX), math.radians(m.RLL2SRV_RMAX))
        if m.PTCH2SRV_RMAX_UP > 0.0:
            tilt = min(tilt, math.radians(m.PTCH2SRV_RMAX_UP))
        if m.PTCH2SRV_RMAX_DN > 0.0:
            tilt = max(tilt, -math.radians(m.PTCH2SRV_RMAX_DN))
    pitch_rate = up * tilt + m.PTCH2SRV_RLL * turn * across
    p_miss, q_miss = roll_rate - p, pitch_rate - q
    m.aileron_trim = clip(m.aileron_trim + m.RLL_RATE_I * p_miss * h, -m.RLL_RATE_IMAX, m.RLL_RATE_IMAX)
    m.elevator_trim = clip(m.elevator_trim + up * m.PTCH_RATE_I * q_miss * h, -m.PTCH_RATE_IMAX, m.PTCH_RATE_IMAX)
    aileron = m.RLL_RATE_FF * roll_rate + m.RLL_RATE_P * p_miss + m.aileron_trim
    elevator = m.PTCH_RATE_FF * pitch_rate + m.PTCH_RATE_P * q_miss + up * m.elevator_trim
    if m.tuning + m.RLL_RATE_D + m.PTCH_RATE_D > 0.0:
        if m.tuning != 0:
            m.tuning_time += h
        if m.tuning & 1 != 0:
            aileron = tuned(m, 0, roll_rate, p, roll_error, m.aileron_trim, h)
        else:
            aileron += damping(m, 0, p_miss, m.RLL_RATE_D, h)
        if m.tuning & 2 != 0:
            elevator = tuned(m, 1, pitch_rate, q, pitch_error, up * m.elevator_trim, h)
        else:
            elevator += damping(m, 1, q_miss, m.PTCH_RATE_D, h)
    rudder = 0.3 * (turn * upright - r)
    m.motor[0] = 0.5 + 0.5 * clip(_WHOLE * aileron, -1.0, 1.0)
    m.motor[1] = 0.5 + 0.5 * clip(_WHOLE * elevator, -1.0, 1.0)
    m.motor[2] = clip(throttle, 0.0, 1.0)
    m.motor[3] = 0.5 + 0.5 * clip(rudder, -1.0, 1.0)
