"""THROW: armed in the hand, the motors stay off until the vehicle has been thrown; then it rights itself and stops.

A throw is detected by a fall of the climb rate of 2.5 m/s within half a second after it was released: in free fall or
faster than 5 m/s, rising (THROW_TYPE 1: dropping) at more than 0.5 m/s, between THROW_ALT_MIN and THROW_ALT_MAX. The
vehicle then spools up, levels at half throttle, stops at THROW_ALT_ACSND above (THROW_ALT_DCSND below) the place where
it was upright, holds the position and changes to THROW_NEXTMODE. Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.7-dev: mode_throw.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_yaw_rate, forget_torques, relax_yaw
from cosim_models.autopilot.control.motors import GROUND_IDLE, SHUT_DOWN, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import (
    GRAVITY,
    control_ne,
    control_up,
    initialise_ne,
    initialise_up,
    relax_ne,
    seek_velocity_ne,
    seek_velocity_up,
    set_throttle,
)
from cosim_models.autopilot.flight.guided import braking_limits
from cosim_models.autopilot.flight.state import position_ready
from cosim_models.autopilot.link.statustext import (
    INFO,
    NO_NUMBER,
    THROW_DETECTED,
    THROW_HEIGHT,
    THROW_UNLIMITED,
    THROW_UPRIGHT,
    THROW_WAITING,
    say,
)
from cosim_models.autopilot.record.modes import AUTO, BRAKE, GUIDED, LAND, LOITER, RTL

__all__ = ["run_throw", "start_throw"]

_DISARMED, _DETECTING, _SPOOLING, _RIGHTING, _CLIMBING, _HOLDING = range(6)
_FAST = 5.0  # m/s
_RISING = 0.5  # m/s
_FALL = 2.5  # m/s, lost within _FALL_TIME
_FALL_TIME = 0.5  # s
_UPRIGHT = 0.866  # cosine of the lean
_NEAR = 0.5  # m
_DROP = 1  # THROW_TYPE


@kernel
def start_throw(m: Any, t: float) -> None:
    """Begins to wait for a throw."""
    m.throw_stage = _DISARMED
    m.throw_done = False
    m.throw_since = t - 2.0 * _FALL_TIME
    braking_limits(m, 0.01 * m.WPNAV_SPEED)


@kernel
def _is_thrown(m: Any, t: float) -> bool:
    """Returns whether the vehicle has left the hand."""
    if not position_ready(m, t):
        return False
    v, a = m.velocity_neu, m.acceleration_neu
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    moves = -v[2] > _RISING if m.THROW_TYPE == _DROP else v[2] > _RISING
    force = math.sqrt(a[0] * a[0] + a[1] * a[1] + (a[2] + GRAVITY) ** 2)  # specific force
    height = m.position_neu[2] - m.home_neu[2]
    high = m.THROW_ALT_MIN == 0.0 or height > m.THROW_ALT_MIN
    low = m.THROW_ALT_MAX == 0.0 or height < m.THROW_ALT_MAX
    falls = a[2] < -0.75 * GRAVITY or speed > _FAST
    if falls and moves and force < GRAVITY and high and low and t - m.throw_since > _FALL_TIME:
        m.throw_since = t
        m.throw_climb = v[2]
    return bool(t - m.throw_since < _FALL_TIME and v[2] - m.throw_climb < -_FALL)


@kernel
def _next_stage(m: Any, t: float) -> None:
    """Changes the stage when its condition is met."""
    if not m.armed:
        m.throw_stage = _DISARMED
    elif m.throw_stage == _DISARMED:
        say(m, INFO, THROW_WAITING, NO_NUMBER)
        m.throw_stage = _DETECTING
    elif m.throw_stage == _DETECTING and _is_thrown(m, t):
        say(m, INFO, THROW_DETECTED, NO_NUMBER)
        m.on_ground = False
        m.throw_stage = _SPOOLING
    elif m.throw_stage == _SPOOLING and m.spool_state == THROTTLE_UNLIMITED:
        say(m, INFO, THROW_UNLIMITED, NO_NUMBER)
        m.throw_stage = _RIGHTING
    elif m.throw_stage == _RIGHTING and 1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2]) > _UPRIGHT:
        say(m, INFO, THROW_UPRIGHT, NO_NUMBER)
        m.throw_stage = _CLIMBING
        initialise_up(m)
        m.desired_velocity_neu[2] = max(m.desired_velocity_neu[2], 0.0)
        m.desired_acceleration_neu[2] = max(m.desired_acceleration_neu[2], 0.0)
        rise = -m.THROW_ALT_DCSND if m.THROW_TYPE == _DROP else m.THROW_ALT_ACSND
        m.desired_position_neu[2] = m.position_neu[2] + rise
        m.auto_armed = True
    elif m.throw_stage == _CLIMBING and m.position_error_neu[2] < _NEAR:
        say(m, INFO, THROW_HEIGHT, NO_NUMBER)
        m.throw_stage = _HOLDING
        initialise_ne(m)
        m.auto_armed = True


@kernel
def _next_mode(m: Any) -> int:
    """Returns the mode that follows once the position is held, -1: none."""
    e = m.position_error_neu
    if m.throw_stage != _HOLDING or m.throw_done or math.sqrt(e[0] * e[0] + e[1] * e[1]) >= _NEAR:
        return -1
    m.throw_done = True
    follows = int(m.THROW_NEXTMODE)
    return follows if follows in (AUTO, GUIDED, RTL, LAND, BRAKE, LOITER) else -1


@kernel
def run_throw(m: Any, t: float, dt: float) -> int:
    """Performs one step of THROW; returns the mode that follows when it has ended, else -1."""
    _next_stage(m, t)
    if m.throw_stage <= _DETECTING:
        m.spool_wanted = GROUND_IDLE if m.THROW_MOT_START == 1 else SHUT_DOWN
        relax_yaw(m)
        forget_torques(m, False, dt)
        relax_ne(m, dt)
        initialise_up(m)
        set_throttle(m, 0.0, True, m.PILOT_THR_FILT, dt)
        return -1
    m.spool_wanted = THROTTLE_UNLIMITED
    if m.throw_stage == _SPOOLING:
        return -1
    if m.throw_stage == _RIGHTING:
        relax_ne(m, dt)
        follow_yaw_rate(m, 0.0, 0.0, -GRAVITY, 0.0, dt)
        set_throttle(m, 0.5, False, m.PILOT_THR_FILT, dt)
        return -1
    an, ae = 0.0, 0.0
    if m.throw_stage == _HOLDING:
        seek_velocity_ne(m, 0.0, 0.0, 0.0, 0.0, dt)
        control_ne(m, dt)
        an, ae = m.target_acceleration_neu[0], m.target_acceleration_neu[1]
    else:
        relax_ne(m, dt)
    follow_yaw_rate(m, an, ae, -GRAVITY, 0.0, dt)
    seek_velocity_up(m, 0.0, 0.0, False, dt)
    control_up(m, dt)
    return _next_mode(m)
