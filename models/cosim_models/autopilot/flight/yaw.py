"""Heading control in autonomous flight: hold, along the path, to a heading, at a rate, or by the pilot.

Kernels over the autopilot's record `m`. Modes and commands select the behaviour. The pilot's yaw stick overrides it
until the next selection, unless an option forbids it. `lean` passes heading and acceleration to the attitude
controller.

Source: ArduPilot, ArduCopter autoyaw and mode (use_pilot_yaw).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
)
from cosim_models.autopilot.control.attitude import follow_heading, follow_yaw_rate
from cosim_models.autopilot.control.position import GRAVITY
from cosim_models.autopilot.control.shaping import clip, wrap_pi
from cosim_models.autopilot.record.modes import AUTO, BRAKE, DESCEND, FINAL, GUIDED, RTL, SMART_RTL

__all__ = [
    "circle_nose",
    "default_nose",
    "has_turned",
    "hold_heading",
    "keep_heading",
    "lean",
    "look_at",
    "look_round",
    "points_there",
    "stop_turning",
    "turn_as_armed",
    "turn_at",
    "turn_by",
    "turn_from",
    "turn_to",
]

_HOLD, _ALONG_PATH, _FIXED, _TURN, _PILOT, _ROUND, _FROM, _LOOK = range(8)
_IGNORE_STICK = 4  # GUID_OPTIONS, AUTO_OPTIONS and RTL_OPTIONS
_TURNED = math.radians(2.0)


@kernel
def _heading(q: Any) -> float:
    return float(yaw_from_quaternion((q[0], q[1], q[2], q[3])))


# ---- selection by modes and commands -------------------------------------------------------------------------------


@kernel
def default_nose(m: Any) -> None:
    """Applies WP_YAW_BEHAVIOR: 0 holds the heading; 1, 2 and 3 point along the path (2: not in RTL, SMART_RTL)."""
    if m.WP_YAW_BEHAVIOR == 0 or (m.WP_YAW_BEHAVIOR == 2 and m.mode in (RTL, SMART_RTL)):
        m.yaw_mode = _HOLD
    elif m.yaw_mode != _ALONG_PATH:
        m.yaw_mode = _ALONG_PATH
        m.path_heading = _heading(m.attitude_target)
        m.path_turn_rate = 0.0


@kernel
def hold_heading(m: Any) -> None:
    """Holds the current heading."""
    m.yaw_mode = _HOLD


@kernel
def turn_to(m: Any, heading: float) -> None:
    """Turns to `heading` [rad]."""
    m.yaw_mode = _FIXED
    m.yaw_fixed = heading
    m.yaw_left = 0.0


@kernel
def turn_at(m: Any, rate: float) -> None:
    """Turns at `rate` [rad/s]."""
    m.yaw_mode = _TURN
    m.yaw_rate = rate


@kernel
def turn_from(m: Any, heading: float, rate: float) -> None:
    """Turns to `heading` [rad], which itself turns at `rate` [rad/s]."""
    m.yaw_mode = _FROM
    m.yaw_fixed = heading
    m.yaw_rate = rate


@kernel
def stop_turning(m: Any) -> None:
    """Ends the rotation begun by `turn_at` or `turn_from`."""
    if m.yaw_mode == _TURN or m.yaw_mode == _FROM:
        m.yaw_mode = _HOLD


@kernel
def look_at(m: Any, n: float, e: float) -> None:
    """Points to (n, e) [m] until another heading is selected."""
    m.yaw_mode = _LOOK
    m.region[0], m.region[1] = n, e


@kernel
def turn_by(m: Any, angle: float, rate: float, direction: float, relative: bool) -> None:
    """Handles CONDITION_YAW: turns to or by `angle` [rad] at up to `rate` [rad/s], ATC_SLEW_YAW if that is not
    positive.

    Args:
        m: the record.
        angle: heading, or angle to turn by.
        rate: maximum rate.
        direction: positive clockwise, negative counter-clockwise; 0: the shorter way to a heading.
        relative: turn by the angle, starting at the current heading.
    """
    slew = math.radians(0.01 * m.ATC_SLEW_YAW)
    m.yaw_slew = min(slew, rate) if rate > 0.0 else slew
    if m.yaw_mode == _ALONG_PATH:
        m.yaw_fixed = m.path_heading
    elif m.yaw_mode == _HOLD and relative:
        m.yaw_fixed = _heading(m.q)
    elif m.yaw_mode != _FIXED and m.yaw_mode != _FROM and m.yaw_mode != _LOOK:
        m.yaw_fixed = _heading(m.attitude_target)
    if relative:
        m.yaw_left = -angle if direction < 0.0 else angle
    else:
        left = wrap_pi(angle - m.yaw_fixed)
        if direction < 0.0 and left > 0.0:
            left -= 2.0 * math.pi
        elif direction > 0.0 and left < 0.0:
            left += 2.0 * math.pi
        m.yaw_left = left
    m.yaw_mode = _FIXED


@kernel
def keep_heading(m: Any) -> bool:
    """Returns whether the heading outlasts the next waypoint: that to a region of interest, or a commanded one while
    WP_YAW_BEHAVIOR is 0.
    """
    return bool(m.yaw_mode == _LOOK or (m.WP_YAW_BEHAVIOR == 0 and m.yaw_mode == _FIXED))


@kernel
def has_turned(m: Any) -> bool:
    """Returns whether the heading of `turn_by` is reached; selects that heading again, as ArduCopter does."""
    m.yaw_mode = _FIXED
    return bool(m.yaw_left == 0.0 and abs(wrap_pi(m.yaw_fixed - _heading(m.q))) <= _TURNED)


@kernel
def turn_as_armed(m: Any) -> None:
    """Turns to the heading at arming (above home), unless WP_YAW_BEHAVIOR holds the heading in RTL."""
    if m.WP_YAW_BEHAVIOR == 0 or m.WP_YAW_BEHAVIOR == 2:
        hold_heading(m)
    else:
        turn_to(m, m.armed_heading)


@kernel
def points_there(m: Any) -> bool:
    """Returns whether the heading of `turn_to` is reached or no longer selected."""
    return bool(m.yaw_mode != _FIXED or abs(wrap_pi(m.yaw_fixed - _heading(m.q))) <= _TURNED)


@kernel
def circle_nose(m: Any) -> None:
    """Selects the heading given by `look_round`, for circles."""
    m.yaw_mode = _ROUND
    m.yaw_left = 0.0


@kernel
def look_round(m: Any, heading: float) -> None:
    """Sets the heading [rad] while `circle_nose` is selected."""
    if m.yaw_mode == _ROUND:
        m.yaw_fixed = heading


# ---- execution -----------------------------------------------------------------------------------------------------


@kernel
def _is_returning_free(m: Any) -> bool:
    """Returns whether the pilot may yaw in RTL."""
    if (m.RTL_OPTIONS & _IGNORE_STICK) == 0 or m.rtl_stage == DESCEND:
        return True
    return bool(m.rtl_stage == FINAL and m.LAND_REPOSITION != 0)


@kernel
def _is_free(m: Any) -> bool:
    """Returns whether the pilot may yaw."""
    if m.mode == GUIDED:
        return bool((m.GUID_OPTIONS & _IGNORE_STICK) == 0)
    if m.mode == AUTO:
        if (m.AUTO_OPTIONS & _IGNORE_STICK) == 0 or m.auto_landing:
            return True
        return bool(m.auto_command == MAV_CMD_NAV_RETURN_TO_LAUNCH and _is_returning_free(m))
    if m.mode == RTL:
        return _is_returning_free(m)
    return bool(m.mode != BRAKE)


@kernel
def _follow_pilot(m: Any) -> None:
    """Gives control of the heading to the yaw stick."""
    if m.pilot_flies and _is_free(m):
        if m.pilot_turn != 0.0:
            m.yaw_mode = _PILOT
    elif m.yaw_mode == _PILOT:
        m.yaw_mode = _HOLD


@kernel
def lean(m: Any, dt: float) -> None:
    """Passes the demanded acceleration and heading to the attitude controller."""
    if m.rc_known:
        _follow_pilot(m)
    an, ae = m.target_acceleration_neu[0], m.target_acceleration_neu[1]
    if m.yaw_mode == _ALONG_PATH:
        follow_heading(m, an, ae, -GRAVITY, m.path_heading, m.path_turn_rate, dt)
    elif m.yaw_mode == _FIXED or m.yaw_mode == _ROUND:
        if m.yaw_left != 0.0:
            step = clip(m.yaw_left, -m.yaw_slew * dt, m.yaw_slew * dt)
            m.yaw_left -= step
            m.yaw_fixed = wrap_pi(m.yaw_fixed + step)
        follow_heading(m, an, ae, -GRAVITY, m.yaw_fixed, 0.0, dt)
    elif m.yaw_mode == _FROM:
        m.yaw_fixed = wrap_pi(m.yaw_fixed + m.yaw_rate * dt)
        follow_heading(m, an, ae, -GRAVITY, m.yaw_fixed, m.yaw_rate, dt)
    elif m.yaw_mode == _LOOK:
        m.yaw_fixed = math.atan2(m.region[1] - m.position_neu[1], m.region[0] - m.position_neu[0])
        follow_heading(m, an, ae, -GRAVITY, m.yaw_fixed, 0.0, dt)
    else:
        rate = m.yaw_rate if m.yaw_mode == _TURN else m.pilot_turn if m.yaw_mode == _PILOT else 0.0
        if rate != 0.0:
            slew = math.radians(0.01 * m.ATC_SLEW_YAW)
            rate = clip(rate, -slew, slew)
        follow_yaw_rate(m, an, ae, -GRAVITY, rate, dt)
