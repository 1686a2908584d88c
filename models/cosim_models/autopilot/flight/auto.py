"""AUTO: flies the mission, with the commands that `missions` accepts.

Navigation commands are flown one after the other: waypoint, take-off, land, return, loiter (for a time, for turns or
unlimited) and delay. Commands that follow a navigation command (change of speed, heading, delay) run one after the
other while the next navigation command is flown, and are dropped when that is done. Jumps are evaluated when the next
command is selected. `run_auto` is called once per step in AUTO. Ways between waypoints are in `waypoints`. Kernels over
the autopilot's record `m`; MAVLink is in `missions`.

Source: ArduPilot, ArduCopter mode_auto and AP_Mission.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_CONDITION_DELAY,
    MAV_CMD_CONDITION_DISTANCE,
    MAV_CMD_CONDITION_YAW,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_DIGICAM_CONFIGURE,
    MAV_CMD_DO_DIGICAM_CONTROL,
    MAV_CMD_DO_FENCE_ENABLE,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    MAV_CMD_DO_GRIPPER,
    MAV_CMD_DO_GUIDED_LIMITS,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_DO_MOUNT_CONTROL,
    MAV_CMD_DO_PARACHUTE,
    MAV_CMD_DO_REPEAT_RELAY,
    MAV_CMD_DO_REPEAT_SERVO,
    MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    MAV_CMD_DO_SET_HOME,
    MAV_CMD_DO_SET_RELAY,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_DO_SET_ROI_NONE,
    MAV_CMD_DO_SET_SERVO,
    MAV_CMD_DO_SPRAYER,
    MAV_CMD_DO_WINCH,
    MAV_CMD_IMAGE_START_CAPTURE,
    MAV_CMD_IMAGE_STOP_CAPTURE,
    MAV_CMD_JUMP_TAG,
    MAV_CMD_NAV_DELAY,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LAST,
    MAV_CMD_NAV_LOITER_TIME,
    MAV_CMD_NAV_LOITER_TO_ALT,
    MAV_CMD_NAV_LOITER_TURNS,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_SPLINE_WAYPOINT,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_CMD_VIDEO_START_CAPTURE,
    MAV_CMD_VIDEO_STOP_CAPTURE,
)
from cosim_models.autopilot.control.motors import THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import initialise_up, stop_ne, stopping_ne
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.circle import begin_circle, go_round, nearest_on_circle
from cosim_models.autopilot.flight.guided import (
    land_on,
    rest_on_ground,
    run_land,
    run_takeoff,
    standard_limits,
    start_takeoff,
)
from cosim_models.autopilot.flight.outputs import repeat_relay, repeat_servo, set_relay, set_servo
from cosim_models.autopilot.flight.plans.heights import height_to_land, takeoff_height
from cosim_models.autopilot.flight.plans.order import (
    following_command,
    in_landing_sequence,
    is_above_terrain,
    is_nowhere,
    leg_place,
    next_command,
    place,
    place_after,
    stays,
)
from cosim_models.autopilot.flight.returning.rtl import run_rtl, start_rtl
from cosim_models.autopilot.flight.state import disarm
from cosim_models.autopilot.flight.terrain_following import destination_up
from cosim_models.autopilot.flight.waypoints import (
    add_leg,
    add_spline,
    change_height,
    fly_leg,
    is_above,
    leave_legs,
    respeed_legs,
    set_leg,
    set_spline,
    start_legs_at,
)
from cosim_models.autopilot.flight.yaw import (
    circle_nose,
    default_nose,
    has_turned,
    hold_heading,
    keep_heading,
    look_at,
    turn_by,
)
from cosim_models.autopilot.link.statustext import (
    INFO,
    MISSION_CHANGED,
    MISSION_TEXTS,
    NO_NUMBER,
    REACHED,
    ROUND_BEGINS,
    say,
    say_with,
)
from cosim_models.autopilot.mission.missions import (
    COMMAND,
    LATITUDE,
    P1,
    P2,
    P3,
    P4,
    Z,
    mission_count,
    send_reached,
)
from cosim_models.autopilot.record.modes import AUTO, POSITION, TAKEOFF

__all__ = ["change_speed", "may_pause", "run_auto"]

_COMMANDS = np.array(
    (
        MAV_CMD_NAV_WAYPOINT,
        MAV_CMD_NAV_LOITER_UNLIM,
        MAV_CMD_NAV_LOITER_TIME,
        MAV_CMD_NAV_RETURN_TO_LAUNCH,
        MAV_CMD_NAV_LAND,
        MAV_CMD_NAV_TAKEOFF,
        MAV_CMD_NAV_DELAY,
        MAV_CMD_CONDITION_DELAY,
        MAV_CMD_CONDITION_YAW,
        MAV_CMD_DO_CHANGE_SPEED,
        MAV_CMD_NAV_LOITER_TURNS,
        MAV_CMD_CONDITION_DISTANCE,
        MAV_CMD_DO_SET_HOME,
        MAV_CMD_DO_SET_RELAY,
        MAV_CMD_DO_REPEAT_RELAY,
        MAV_CMD_DO_SET_SERVO,
        MAV_CMD_DO_REPEAT_SERVO,
        MAV_CMD_DO_LAND_START,
        MAV_CMD_DO_SET_ROI_LOCATION,
        MAV_CMD_DO_SET_ROI_NONE,
        MAV_CMD_DO_SET_ROI,
        MAV_CMD_DO_DIGICAM_CONFIGURE,
        MAV_CMD_DO_DIGICAM_CONTROL,
        MAV_CMD_DO_MOUNT_CONTROL,
        MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        MAV_CMD_DO_FENCE_ENABLE,
        MAV_CMD_DO_PARACHUTE,
        MAV_CMD_DO_GRIPPER,
        MAV_CMD_DO_SPRAYER,
        MAV_CMD_DO_GUIDED_LIMITS,
        MAV_CMD_JUMP_TAG,
        MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        MAV_CMD_IMAGE_START_CAPTURE,
        MAV_CMD_IMAGE_STOP_CAPTURE,
        MAV_CMD_VIDEO_START_CAPTURE,
        MAV_CMD_VIDEO_STOP_CAPTURE,
        MAV_CMD_DO_WINCH,
        MAV_CMD_NAV_LOITER_TO_ALT,
        MAV_CMD_NAV_SPLINE_WAYPOINT,
    ),
    dtype=np.int64,
)  # in the order of MISSION_TEXTS
_LEAST_CLIMB = 1.0  # m of a take-off from the ground
_SAME_HEIGHT = 0.05  # m
_AT_CENTRE = 3.0  # m from a circle's centre within which the circle begins at once
_LOOK_AT_EDGE = 5.0  # m from the circle beyond which the vehicle faces its edge during the approach
_FINISHED = -1  # m.auto_command when the mission is finished
_RADIUS_COARSE = 255.0  # m; larger radii are kept in steps of 10 m

# State of the current command.
_GOING, _THERE = 0, 1


@kernel
def change_speed(m: Any, kind: int, speed: float) -> None:
    """Handles DO_CHANGE_SPEED: kinds 0 and 1 along, 2 up, 3 down; speed [m/s]. The mission keeps the speed."""
    which = 1 if kind == 2 else 2 if kind == 3 else 0
    if kind == 2:
        m.speed_up = speed
    elif kind == 3:
        m.speed_down = speed
    else:
        m.speed_max = speed
    if m.mode == AUTO:
        m.auto_speed[which] = speed
    respeed_legs(m)


@kernel
def may_pause(m: Any) -> bool:
    """Returns whether the mission can be paused: it flies to a point that it has not reached, and is not paused."""
    command = m.auto_command
    to_point = command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM, MAV_CMD_NAV_LOITER_TIME)
    to_point = to_point or command == MAV_CMD_NAV_SPLINE_WAYPOINT
    return bool(m.armed and not m.on_ground and not m.paused and to_point and not m.leg_reached)


# ---- flight to a point ----------------------------------------------------------------------------------------------


@kernel
def _prepare(m: Any) -> None:
    """Prepares flight by legs at the speeds that the mission has requested."""
    if not keep_heading(m):
        default_nose(m)
    if not m.legs_active:
        standard_limits(m)
        if m.auto_speed[0] > 0.0:
            m.speed_max = m.auto_speed[0]
        if m.auto_speed[1] > 0.0:
            m.speed_up = m.auto_speed[1]
        if m.auto_speed[2] > 0.0:
            m.speed_down = m.auto_speed[2]
        if m.submode == TAKEOFF:
            start_legs_at(m, m.desired_position_neu[0], m.desired_position_neu[1], m.takeoff_to)
    m.submode = POSITION


@kernel
def _go_to(m: Any, n: float, e: float, u: float, above: bool = False) -> None:
    """Flies to a point at the speeds that the mission has requested; `above`: its height is above the terrain."""
    _prepare(m)
    set_leg(m, n, e, u, above)


# ---- LOITER_TURNS --------------------------------------------------------------------------------------------------


@kernel
def _begin_turns(m: Any, row: int) -> None:
    """Flies to the edge of the circle, or begins at once near its centre; radii are stored in whole metres."""
    r = m.mission[row]
    n, e, up = place(m, row)
    m.circle_above = is_above_terrain(m, row)
    if m.circle_above:
        up = r[Z]
    m.circle_up, m.surface_gap = up, 0.0
    wanted = abs(r[P3])
    radius = math.floor(wanted)
    if wanted > _RADIUS_COARSE:
        radius = 10.0 * min(math.floor(0.1 * wanted), _RADIUS_COARSE)
    m.circle_radius = radius if radius > 0.0 else 0.01 * m.CIRCLE_RADIUS
    rate = abs(math.radians(m.CIRCLE_RATE))
    m.circle_rate = -rate if r[P3] < 0.0 else rate
    m.circle_centre[0], m.circle_centre[1] = n, e
    m.circle_told = -1
    edge_n, edge_e, distance = nearest_on_circle(m, up)
    if distance <= _AT_CENTRE:
        _go_to(m, m.desired_position_neu[0], m.desired_position_neu[1], m.desired_position_neu[2])
        _begin_round(m)
        return
    dn, de = m.position_neu[0] - n, m.position_neu[1] - e
    from_centre = math.sqrt(dn * dn + de * de)
    _go_to(m, edge_n, edge_e, up, bool(m.circle_above))
    if from_centre <= m.circle_radius or from_centre <= _LOOK_AT_EDGE:
        hold_heading(m)


@kernel
def _begin_round(m: Any) -> None:
    m.auto_stage = _THERE
    leave_legs(m)
    stop_ne(m)
    initialise_up(m)
    begin_circle(m, False)
    circle_nose(m)


@kernel
def _turns(m: Any) -> float:
    """Returns the number of turns of the item: fractions of one, or whole numbers up to 255."""
    wanted = m.mission[m.mission_current, P1]
    return float(wanted if 0.0 < wanted < 1.0 else clip(math.floor(wanted), 0.0, 255.0))


@kernel
def _has_gone_round(m: Any) -> bool:
    """Returns whether the turns are complete; reports the beginning of each turn."""
    if m.auto_stage == _GOING:
        if m.leg_reached:
            _begin_round(m)
        return False
    done, wanted = abs(m.circle_total) / (2.0 * math.pi), _turns(m)
    if int(done) != m.circle_told:
        m.circle_told = int(done)
        say_with(m, INFO, ROUND_BEGINS, int(done) + 1, int(wanted))
    return bool(done >= wanted)


@kernel
def _pass_to(m: Any, row: int) -> None:
    """Makes the vehicle pass a waypoint without a stop if a waypoint or a place to loiter follows."""
    following = following_command(m, row)
    if following < 0:
        return
    command = m.mission[following, COMMAND]
    g = m.guided_position_neu
    n, e, u, above = leg_place(m, following, (g[0], g[1], destination_up(m)))
    if command == MAV_CMD_NAV_SPLINE_WAYPOINT:
        then, curved = place_after(m, following, (n, e, u), above)
        add_spline(m, (n, e, u), above, then, curved)
    elif command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM, MAV_CMD_NAV_LOITER_TIME):
        add_leg(m, n, e, u, above)


@kernel
def _curve_to(m: Any, row: int) -> None:
    """Flies to a waypoint on a spline."""
    n, e, u, above = leg_place(m, row, m.desired_position_neu)
    _prepare(m)
    then, curved = place_after(m, row, (n, e, u), above)
    set_spline(m, (n, e, u), above, then, curved)
    if not stays(m, row):
        _pass_to(m, row)


# ---- navigation commands -------------------------------------------------------------------------------------------


@kernel
def _tell(m: Any, command: int, row: int) -> None:
    """Sends ArduCopter's status text for a command that begins."""
    for i in range(_COMMANDS.shape[0]):
        if _COMMANDS[i] == command:
            say(m, INFO, MISSION_TEXTS + i, row)


@kernel
def _land_here(m: Any) -> None:
    leave_legs(m)
    m.auto_stage = _THERE
    m.auto_landing = True
    land_on(m)


@kernel
def _fly_to(m: Any, row: int) -> None:
    """Flies to the place of an item; a landing begins at the present height."""
    n, e, u, above = leg_place(m, row, m.desired_position_neu)
    command = m.mission[row, COMMAND]
    if command == MAV_CMD_NAV_LAND:
        u, above = height_to_land(m, row)
    elif command == MAV_CMD_NAV_LOITER_TO_ALT and above:
        n, e, u = place(m, row)
        above = False
    _prepare(m)
    set_leg(m, n, e, u, above)
    if command == MAV_CMD_NAV_WAYPOINT and m.mission[row, P1] <= 0.0:
        _pass_to(m, row)


@kernel
def _begin(m: Any, row: int, t: float) -> None:
    """Begins a navigation command."""
    command = int(m.mission[row, COMMAND])
    _tell(m, command, row)
    m.mission_current = row
    m.auto_command = command
    m.auto_stage = _GOING
    m.auto_landing = False
    m.auto_since = t
    p = m.desired_position_neu
    if command == MAV_CMD_NAV_TAKEOFF and m.on_ground:
        leave_legs(m)
        start_takeoff(m, max(takeoff_height(m, row), m.position_neu[2] + _LEAST_CLIMB))
    elif command == MAV_CMD_NAV_TAKEOFF:
        _, _, up = place(m, row)
        _go_to(m, p[0], p[1], max(up, m.position_neu[2]))  # it never descends
    elif command == MAV_CMD_NAV_RETURN_TO_LAUNCH:
        start_rtl(m)
    elif command == MAV_CMD_NAV_DELAY:
        _go_to(m, p[0], p[1], p[2])
    elif command == MAV_CMD_NAV_LOITER_TURNS:
        _begin_turns(m, row)
    elif command == MAV_CMD_NAV_SPLINE_WAYPOINT:
        _curve_to(m, row)
    elif command == MAV_CMD_NAV_LAND and m.mission[row, LATITUDE] == 0.0 and m.mission[row, LATITUDE + 1] == 0.0:
        _land_here(m)
    else:
        _fly_to(m, row)


@kernel
def _is_done(m: Any, t: float) -> bool:
    """Returns whether the current navigation command is complete."""
    command = m.auto_command
    hold = m.mission[m.mission_current, P1]
    if command == MAV_CMD_NAV_TAKEOFF:
        return bool(m.takeoff_done if m.submode == TAKEOFF else m.leg_reached)
    if command == MAV_CMD_NAV_WAYPOINT and hold <= 0.0:
        return bool(m.leg_reached)
    if command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_TIME, MAV_CMD_NAV_SPLINE_WAYPOINT):
        if m.auto_stage == _GOING and m.leg_reached:
            m.auto_stage = _THERE
            m.auto_since = t
        return bool(m.auto_stage == _THERE and t - m.auto_since >= hold)
    if command == MAV_CMD_NAV_LOITER_TURNS:
        return _has_gone_round(m)
    if command == MAV_CMD_NAV_LOITER_TO_ALT:
        return bool(m.auto_stage == _THERE and abs(m.guided_position_neu[2] - m.position_neu[2]) < _SAME_HEIGHT)
    if command == MAV_CMD_NAV_DELAY:
        return bool(t - m.auto_since >= hold)
    if command == MAV_CMD_NAV_LAND:
        return bool(m.auto_stage == _THERE and m.on_ground)
    return False


# ---- commands that run beside navigation ---------------------------------------------------------------------------


@kernel
def _do_at_once(m: Any, row: int, t: float) -> None:
    """Obeys a command that is done at once; those on devices that are not on board do nothing."""
    r = m.mission[row]
    command = int(r[COMMAND])
    if command in (MAV_CMD_DO_SET_ROI, MAV_CMD_DO_SET_ROI_LOCATION) and not is_nowhere(m, row):
        n, e, _ = place(m, row)
        look_at(m, n, e)
    elif command in (MAV_CMD_DO_SET_ROI, MAV_CMD_DO_SET_ROI_LOCATION, MAV_CMD_DO_SET_ROI_NONE):
        default_nose(m)
    elif command == MAV_CMD_DO_SET_SERVO:
        set_servo(m, r[P1], r[P2])
    elif command == MAV_CMD_DO_SET_RELAY:
        set_relay(m, r[P1], r[P2])
    elif command == MAV_CMD_DO_REPEAT_SERVO:
        repeat_servo(m, r[P1], r[P2], r[P3], r[P4], t)
    elif command == MAV_CMD_DO_REPEAT_RELAY:
        repeat_relay(m, r[P1], r[P2], r[P3], t)
    elif command == MAV_CMD_DO_FENCE_ENABLE and (r[P1] == 0.0 or r[P1] == 1.0):
        m.FENCE_ENABLE = int(r[P1])
    elif command == MAV_CMD_DO_SET_HOME:
        n, e, u = m.position_neu[0], m.position_neu[1], m.position_neu[2]
        if r[P1] != 1.0 and not is_nowhere(m, row):
            n, e, u = place(m, row)
        m.home_neu[0], m.home_neu[1], m.home_neu[2] = n, e, u
        m.told_home = False


@kernel
def _do(m: Any, row: int, t: float) -> None:
    """Begins a command that runs beside navigation."""
    r = m.mission[row]
    _tell(m, int(r[COMMAND]), row)
    m.auto_do = row
    m.auto_doing = True
    m.auto_do_since = t
    if r[COMMAND] == MAV_CMD_DO_CHANGE_SPEED and r[P2] > 0.0:
        change_speed(m, int(clip(r[P1], 0.0, 3.0)), r[P2])
    elif r[COMMAND] == MAV_CMD_CONDITION_YAW:
        turn_by(m, math.radians(r[P1]), math.radians(r[P2]), r[P3], r[P4] > 0.0)
    else:
        _do_at_once(m, row, t)


@kernel
def _has_done(m: Any, t: float) -> bool:
    r = m.mission[m.auto_do]
    if r[COMMAND] == MAV_CMD_CONDITION_DELAY:
        return bool(t - m.auto_do_since >= r[P1])
    if r[COMMAND] == MAV_CMD_CONDITION_DISTANCE:
        n, e = m.guided_position_neu[0] - m.position_neu[0], m.guided_position_neu[1] - m.position_neu[1]
        return bool(n * n + e * e < r[P1] * r[P1])
    return has_turned(m) if r[COMMAND] == MAV_CMD_CONDITION_YAW else True


@kernel
def _do_next(m: Any, t: float) -> None:
    """Continues the commands beside navigation, up to the next navigation command."""
    if m.auto_do == 0:
        return
    if m.auto_doing:
        if _has_done(m, t):
            send_reached(m, m.auto_do)
            m.auto_doing = False
        return
    row = next_command(m, m.auto_do + 1, False)
    if row < 0 or m.mission[row, COMMAND] <= MAV_CMD_NAV_LAST:
        m.auto_do = 0
    else:
        _do(m, row, t)


# ---- order of commands ---------------------------------------------------------------------------------------------


@kernel
def _advance(m: Any, row: int, t: float) -> None:
    """Begins the first navigation command from `row` on, and before it the first command that runs beside it."""
    m.auto_do = 0
    m.auto_doing = False
    for _ in range(m.mission.shape[0]):
        row = next_command(m, row, True)
        if row < 0:
            break
        if m.mission[row, COMMAND] <= MAV_CMD_NAV_LAST:
            _begin(m, row, t)
            return
        if m.auto_do == 0:
            _do(m, row, t)
        row += 1
    m.auto_do = 0
    m.mission_complete = True
    m.mission_current = max(mission_count(m) - 1, 0)
    m.auto_command = _FINISHED
    n, e = stopping_ne(m)
    _go_to(m, n, e, m.desired_position_neu[2])
    hold_heading(m)


@kernel
def _follow(m: Any, t: float) -> None:
    """Updates the current command and advances the mission."""
    if m.mission_replaced:
        m.mission_replaced = False
        if not m.mission_changed and m.auto_command != _FINISHED and m.mission_current < mission_count(m):
            m.mission_changed = True
            say(m, INFO, MISSION_CHANGED, NO_NUMBER)
    if m.mission_changed:
        m.mission_changed = False
        _advance(m, max(m.mission_current, 1), t)
        return
    if m.auto_command == _FINISHED or m.terrain_missing:
        return
    if _is_done(m, t):
        send_reached(m, m.mission_current)
        if m.auto_command in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_TIME, MAV_CMD_NAV_SPLINE_WAYPOINT):
            say(m, INFO, REACHED, m.mission_current)
        _advance(m, m.mission_current + 1, t)
    _do_next(m, t)


@kernel
def run_auto(m: Any, t: float, dt: float) -> None:
    """Performs one step of AUTO."""
    if not m.armed or not m.auto_armed:
        rest_on_ground(m, dt)
        return
    _follow(m, t)
    if m.auto_rtl and not (m.mission_complete or in_landing_sequence(m)):
        m.auto_rtl = False
    if m.auto_command == MAV_CMD_NAV_TAKEOFF and m.submode == TAKEOFF:
        run_takeoff(m, dt)
    elif m.auto_command == MAV_CMD_NAV_RETURN_TO_LAUNCH:
        run_rtl(m, t, dt)
    elif m.auto_command == MAV_CMD_NAV_LAND and m.auto_stage == _THERE:
        run_land(m, dt)
    elif m.on_ground:
        rest_on_ground(m, dt)
        if m.auto_command == _FINISHED:
            disarm(m)
    elif m.auto_command == MAV_CMD_NAV_LOITER_TURNS and m.auto_stage == _THERE:
        m.spool_wanted = THROTTLE_UNLIMITED
        go_round(m, 0.0, dt)
    elif m.auto_command == MAV_CMD_NAV_LOITER_TO_ALT and m.auto_stage == _THERE:
        change_height(m, dt)
    else:
        fly_leg(m, dt)
        if m.auto_command == MAV_CMD_NAV_LOITER_TO_ALT and is_above(m):
            leave_legs(m)
            m.auto_stage = _THERE
        if m.auto_command == MAV_CMD_NAV_LAND and m.leg_reached:
            _land_here(m)
