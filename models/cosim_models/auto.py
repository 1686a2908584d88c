"""AUTO: the mission is flown, as far as `missions` accepts its commands.

Waypoint, take-off, land, return, loiter for a time or without end, delay; change of speed, heading, condition delay and
jumps in between. `run_auto` is called once a step in AUTO. Paths between waypoints are shaped as in GUIDED, not
ArduCopter's S-curves: a waypoint without delay is passed when it is nearer than WPNAV_RADIUS, the others when the path
has come to rest there. A delay between two waypoints (CONDITION_DELAY) holds the vehicle at the first.
Kernels over the autopilot's record `m`; MAVLink is in `missions`.

Source: ArduPilot, ArduCopter mode_auto and AP_Mission.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.frames import local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim_models.arming import TAKEOFF, disarm
from cosim_models.flight_modes import (
    fly_to_point,
    guide_position,
    rest_on_ground,
    run_land,
    run_rtl,
    run_takeoff,
    start_land,
    start_rtl,
    start_takeoff,
    turn_to,
)
from cosim_models.missions import COMMAND, DONE, FRAME, LATITUDE, P1, P2, Z, mission_count, send_reached
from cosim_models.shaping import wrap_pi
from cosim_models.texts import INFO, MISSION_TEXTS, REACHED, say

__all__ = ["run_auto"]

_WAYPOINT, _LOITER, _LOITER_TIME, _RTL, _LAND, _TAKEOFF, _DELAY = 16, 17, 19, 20, 21, 22, 93  # MAV_CMD
_WAIT, _YAW, _JUMP, _SPEED = 112, 115, 177, 178
_COMMANDS = np.array((16, 17, 19, 20, 21, 22, 93, 112, 115, 178), dtype=np.int64)  # in the order of MISSION_TEXTS
_AT_REST = 0.1  # m between the shaped path and a waypoint at which the vehicle has come to rest
_JUMPS_AT_ONCE = 100
_FINISHED = -1  # m.auto_command when the mission has come to its end

# What is happening to the command.
_GOING, _THERE = 0, 1


@kernel
def _place(m: Any, row: int) -> tuple[float, float, float]:
    """North, east and up of an item; without a place (0, 0) the desired position, without a height the desired one."""
    r = m.mission[row]
    p = m.position_desired
    n, e, u = p[0], p[1], p[2]
    if r[LATITUDE] != 0.0 or r[LATITUDE + 1] != 0.0:
        n, e, _ = local_from_geodetic(
            radians_from_deg_e7(int(r[LATITUDE])),
            radians_from_deg_e7(int(r[LATITUDE + 1])),
            0.0,
            m.origin_latitude,
            m.origin_longitude,
            0.0,
        )
    if r[FRAME] == 0.0 or r[FRAME] == 5.0:
        u = r[Z] - m.origin_altitude
    elif r[Z] != 0.0 or r[COMMAND] == _WAYPOINT:
        u = r[Z] + m.home[2]
    return n, e, u


@kernel
def _act(m: Any, row: int) -> None:
    """A command that is done at once: speed or heading."""
    r = m.mission[row]
    if r[COMMAND] == _SPEED and r[P2] > 0.0:
        if r[P1] == 2.0:
            m.speed_up = r[P2]
        elif r[P1] == 3.0:
            m.speed_down = r[P2]
        else:
            m.speed_max = r[P2]
            m.auto_speed = r[P2]
    elif r[COMMAND] == _YAW:
        turn_to(m, wrap_pi(math.radians(r[P1])), 0.0, False)


@kernel
def _tell(m: Any, command: int, row: int) -> None:
    """ArduCopter's text on a command that begins."""
    for i in range(_COMMANDS.shape[0]):
        if _COMMANDS[i] == command:
            say(m, INFO, MISSION_TEXTS + i, row)


@kernel
def _begin(m: Any, row: int, t: float) -> None:
    """Begin a command that is flown."""
    command = int(m.mission[row, COMMAND])
    m.auto_command = command
    m.auto_stage = _GOING
    m.auto_landing = False
    m.auto_since = t
    if command == _TAKEOFF:
        if m.on_ground:
            start_takeoff(m, m.home[2] + m.mission[row, Z])
            return
        _, _, up = _place(m, row)
        guide_position(m, m.position_desired[0], m.position_desired[1], up, t)
    elif command == _RTL:
        start_rtl(m)
    elif command != _DELAY and command != _WAIT:
        n, e, u = _place(m, row)
        if command == _LAND:
            u = m.position_desired[2]
        guide_position(m, n, e, u, t)
        if m.auto_speed > 0.0:
            m.speed_max = m.auto_speed
    else:
        p = m.position_desired
        guide_position(m, p[0], p[1], p[2], t)


@kernel
def _advance(m: Any, t: float) -> None:
    """Do what is done at once, from the current item on, and begin the next command that is flown."""
    for _ in range(_JUMPS_AT_ONCE):
        row = m.mission_current
        if row >= mission_count(m):
            break
        command = int(m.mission[row, COMMAND])
        if command == _JUMP:
            r = m.mission[row]
            if r[P2] < 0.0 or r[DONE] < r[P2]:
                r[DONE] += 1.0
                target = int(min(max(r[P1], 1.0), float(mission_count(m))))
                m.mission_current = target
            else:
                r[DONE] = 0.0
                m.mission_current = row + 1
        elif command in (_SPEED, _YAW):
            _tell(m, command, row)
            _act(m, row)
            m.mission_current = row + 1
        else:
            _tell(m, command, row)
            _begin(m, row, t)
            return
    m.mission_complete = True
    m.mission_current = max(mission_count(m) - 1, 0)
    m.auto_command = _FINISHED
    p = m.position_desired
    guide_position(m, p[0], p[1], p[2], t)


@kernel
def _arrived(m: Any, passing: bool) -> bool:
    p, g = m.position_desired, m.guided_position
    if passing:
        n, e, u = g[0] - m.pos[0], g[1] - m.pos[1], g[2] - m.pos[2]
        return bool(n * n + e * e + u * u < (0.01 * m.WPNAV_RADIUS) ** 2)
    n, e, u = g[0] - p[0], g[1] - p[1], g[2] - p[2]
    return bool(n * n + e * e + u * u < _AT_REST * _AT_REST)


@kernel
def _is_done(m: Any, t: float) -> bool:
    """Whether the command that is flown has come to its end."""
    command = m.auto_command
    hold = m.mission[m.mission_current, P1]
    if command == _TAKEOFF:
        return bool(m.takeoff_done if m.submode == TAKEOFF else _arrived(m, False))
    if command == _WAYPOINT:
        if hold <= 0.0:
            last = m.mission_current + 1 >= mission_count(m)
            return _arrived(m, not last)
        if m.auto_stage == _GOING and _arrived(m, False):
            m.auto_stage = _THERE
            m.auto_since = t
        return bool(m.auto_stage == _THERE and t - m.auto_since >= hold)
    if command == _LOITER_TIME:
        if m.auto_stage == _GOING and _arrived(m, False):
            m.auto_stage = _THERE
            m.auto_since = t
        return bool(m.auto_stage == _THERE and t - m.auto_since >= hold)
    if command in (_DELAY, _WAIT):
        return bool(t - m.auto_since >= hold)
    if command == _LAND:
        return bool(m.auto_stage == _THERE and m.on_ground)
    return False


@kernel
def run_auto(m: Any, t: float, dt: float) -> None:
    """One step of AUTO."""
    if m.mission_changed and m.armed and m.auto_armed:
        m.mission_changed = False
        _advance(m, t)
    elif m.auto_command != _FINISHED and m.armed and m.auto_armed and _is_done(m, t):
        send_reached(m, m.mission_current)
        say(m, INFO, REACHED, m.mission_current)
        m.mission_current += 1
        _advance(m, t)
    if not m.armed or not m.auto_armed:
        rest_on_ground(m, dt)
    elif m.auto_command == _TAKEOFF and m.submode == TAKEOFF:
        run_takeoff(m, dt)
    elif m.auto_command == _RTL:
        run_rtl(m, t, dt)
    elif m.auto_command == _LAND and m.auto_stage == _THERE:
        run_land(m, dt)
    elif m.on_ground:
        rest_on_ground(m, dt)
        if m.auto_command == _FINISHED:
            disarm(m)
    else:
        fly_to_point(m, dt)
        if m.auto_command == _LAND and _arrived(m, False):
            m.auto_stage = _THERE
            m.auto_landing = True
            start_land(m)
