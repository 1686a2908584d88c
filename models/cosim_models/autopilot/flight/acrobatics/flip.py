"""FLIP: one turn about roll or pitch at 400 deg/s, after which the previous mode continues.

The sticks choose the direction: right unless roll is to the left or pitch is deflected. Up to a lean of 45 degrees, the
throttle is raised above the pilot's, then it is lowered, and raised again while the vehicle returns to its earlier
attitude. A stick beyond 40/45 of its way, or 2.5 s, end the flip. Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.6: mode_flip.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import euler_from_quaternion, quaternion_from_euler, roll_pitch_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_attitude, follow_rates
from cosim_models.autopilot.control.motors import THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import set_throttle
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.sticks import deflection, hands_on, pilot_throttle, throttle_zero
from cosim_models.autopilot.record.modes import ACRO, ALT_HOLD, STABILIZE

__all__ = ["flip_is_possible", "run_flip", "start_flip"]

_RATE = math.radians(400.0)
_MORE, _LESS = 0.20, 0.24  # throttle added while beginning and recovering, taken while turning
_TIME_MAX = 2.5  # s
_RECOVERED = math.radians(5.0)
_STICK_MAX = 40.0 / 45.0
_STICK_MIN = 3.0 / 45.0  # pitch deflection that chooses a turn about pitch
_BEGINNING, _ROLLING, _PITCHING, _INVERTED, _RECOVERING = range(5)
_45, _90 = math.radians(45.0), math.radians(90.0)


@kernel
def _stick(m: Any, number: int, t: float) -> float:
    return deflection(m, number, t) if hands_on(m, t) else 0.0


@kernel
def flip_is_possible(m: Any, t: float) -> bool:
    """Returns whether FLIP can be entered: in the air, from ACRO, STABILIZE or ALT_HOLD, with throttle and little roll.

    ALT_HOLD needs no throttle.
    """
    if m.mode not in (ACRO, STABILIZE, ALT_HOLD) or not m.armed or m.on_ground:
        return False
    if m.mode != ALT_HOLD and throttle_zero(m, t):
        return False
    return abs(_stick(m, m.RCMAP_ROLL, t)) < _STICK_MAX


@kernel
def start_flip(m: Any, previous: int, t: float) -> None:
    """Begins a flip, after which the mode `previous` continues."""
    m.flip_from = previous
    m.flip_stage = _BEGINNING
    m.flip_since = t
    roll, pitch = _stick(m, m.RCMAP_ROLL, t), _stick(m, m.RCMAP_PITCH, t)
    m.flip_turn[0], m.flip_turn[1] = 0, 0
    if abs(pitch) > _STICK_MIN:
        m.flip_turn[1] = 1 if pitch > 0.0 else -1
    else:
        m.flip_turn[0] = 1 if roll >= 0.0 else -1
    phi, theta, psi = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    most = math.radians(0.01 * m.ANGLE_MAX)
    m.flip_angles[0], m.flip_angles[1] = clip(phi, -most, most), clip(theta, -most, most)
    m.flip_angles[2] = psi


@kernel
def _next_stage(m: Any, phi: float, theta: float) -> int:
    """Returns the stage after this step; roll phi and pitch theta [rad]."""
    angle = phi * m.flip_turn[0] if m.flip_turn[0] != 0 else theta * m.flip_turn[1]
    stage = int(m.flip_stage)
    if stage == _BEGINNING and angle >= _45:
        return _ROLLING if m.flip_turn[0] != 0 else _PITCHING
    if stage == _ROLLING and -_90 < angle < _45:
        return _RECOVERING
    if stage == _PITCHING and abs(phi) > _90 and angle > _45:
        return _INVERTED
    if stage == _INVERTED and abs(phi) < _90 and angle > -_45:
        return _RECOVERING
    return stage


@kernel
def run_flip(m: Any, t: float, dt: float) -> int:
    """Performs one step of FLIP; returns the mode that continues when it has ended, else -1."""
    far = max(abs(_stick(m, m.RCMAP_ROLL, t)), abs(_stick(m, m.RCMAP_PITCH, t))) >= _STICK_MAX
    if not m.armed or far or t - m.flip_since > _TIME_MAX:
        return int(m.flip_from)
    m.spool_wanted = THROTTLE_UNLIMITED
    throttle = pilot_throttle(m, t)
    phi, theta = roll_pitch_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    if m.flip_stage == _RECOVERING:
        w = quaternion_from_euler(m.flip_angles[0], m.flip_angles[1], m.flip_angles[2])
        m.angle_q[0], m.angle_q[1], m.angle_q[2], m.angle_q[3] = w
        for i in range(3):
            m.angle_rates[i] = 0.0
        follow_attitude(m, m.angle_q, m.angle_rates, dt)
        set_throttle(m, throttle + _MORE, False, m.PILOT_THR_FILT, dt)
        gap = m.flip_angles[0] - phi if m.flip_turn[0] != 0 else m.flip_angles[1] - theta
        return int(m.flip_from) if abs(gap) <= _RECOVERED else -1
    m.angle_rates[0], m.angle_rates[1], m.angle_rates[2] = _RATE * m.flip_turn[0], _RATE * m.flip_turn[1], 0.0
    follow_rates(m, m.angle_rates, dt)
    throttle = throttle + _MORE if m.flip_stage == _BEGINNING else max(throttle - _LESS, 0.0)
    set_throttle(m, throttle, False, m.PILOT_THR_FILT, dt)
    m.flip_stage = _next_stage(m, phi, theta)
    return -1
