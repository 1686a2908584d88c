"""DRIFT: flies like a plane: the roll stick turns it, it rolls so that it does not slip, and the pitch stick leans it.

Without pitch stick, the vehicle brakes, more and more. About the centre of the throttle stick, the throttle also damps
the climb rate. Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.6: mode_drift.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import forget_torques, lean_to, relax_yaw
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import set_throttle
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.sticks import (
    deflection,
    hands_on,
    pilot_lean,
    pilot_throttle,
    throttle_zero,
)

__all__ = ["run_drift", "start_drift"]

_LOOP = 0.0025  # s, of ArduCopter's loop, for which the following two are given
_KEPT = 0.96  # of the filtered yaw stick
_BRAKING = 0.03  # deg/(m/s), by which braking grows
_GAIN = 8.0  # deg/(m/s)
_STICK = 45.0 / _GAIN  # m/s, sideways speed of the full yaw stick
_SPEED_MAX = 5.6  # m/s, that counts
_TURN_SPEED_MAX = 20.0  # m/s, up to which speed makes turns slower
_ROLL_MAX = 45.0  # deg
_ASSIST_LOW, _ASSIST_HIGH = 0.213, 0.787  # throttle between which the climb rate is damped
_ASSIST = 0.18  # throttle per m/s
_ASSIST_MAX = 0.3


@kernel
def start_drift(m: Any) -> None:
    """Begins without braking."""
    m.drift_brake = 0.0
    m.drift_stick = 0.0


@kernel
def _throttle(m: Any, t: float) -> float:
    """Returns the pilot's throttle, with which the climb rate is damped."""
    throttle = pilot_throttle(m, t)
    if not _ASSIST_LOW < throttle < _ASSIST_HIGH:
        return throttle
    share = clip(1.2 - abs(throttle - 0.5) / 0.24, 0.0, 1.0)
    return clip(throttle + clip(-share * _ASSIST * m.velocity_neu[2], -_ASSIST_MAX, _ASSIST_MAX), 0.0, 1.0)


@kernel
def run_drift(m: Any, t: float, dt: float) -> None:
    """Performs one step of DRIFT."""
    most = math.radians(0.01 * m.ANGLE_MAX)
    roll, pitch = pilot_lean(m, most, most, t)
    q = m.q
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    c, s = math.cos(heading), math.sin(heading)
    vn, ve = m.velocity_neu[0], m.velocity_neu[1]
    forward, right = vn * c + ve * s, ve * c - vn * s
    slower = 1.0 - min(abs(forward), _TURN_SPEED_MAX) / 50.0
    turn = math.degrees(roll) / 45.0 * slower * math.radians(m.ACRO_Y_RATE)
    stick = deflection(m, m.RCMAP_YAW, t) if hands_on(m, t) and not m.radio_lost else 0.0
    kept = _KEPT ** (dt / _LOOP)
    m.drift_stick = m.drift_stick * kept + stick * (1.0 - kept)
    slip = clip(right, -_SPEED_MAX, _SPEED_MAX) - _STICK * m.drift_stick
    roll = math.radians(clip(-_GAIN * slip, -_ROLL_MAX, _ROLL_MAX))
    if pitch == 0.0:
        m.drift_brake = min(m.drift_brake + _BRAKING * dt / _LOOP, _GAIN)
        pitch = math.radians(clip(forward, -_SPEED_MAX, _SPEED_MAX) * m.drift_brake)
    else:
        m.drift_brake = 0.0
    m.spool_wanted = GROUND_IDLE if throttle_zero(m, t) else THROTTLE_UNLIMITED
    if m.spool_state <= GROUND_IDLE:
        relax_yaw(m)
        forget_torques(m, m.spool_state == GROUND_IDLE, dt)
    elif m.spool_state == THROTTLE_UNLIMITED and not m.limit_throttle_lower:
        m.on_ground = False
    lean_to(m, roll, pitch, turn, dt)
    set_throttle(m, _throttle(m, t), True, m.PILOT_THR_FILT, dt)
