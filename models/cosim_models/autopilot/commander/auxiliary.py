"""Auxiliary functions: what DO_AUX_FUNCTION and the switches of the channels with an RCn_OPTION do.

A switch is read ten times a second while a pilot flies: low below 1200 us, high above 1800 us. A position that lasts
for 0.2 s acts, if it is not that of the simulated receiver without a pilot; the first one of a channel that has no such
position acts, too, except with the functions that arm. Kernels over the autopilot's record `m`.

Source: ArduPilot, RC_Channel (read_aux, run_aux_function) and ArduCopter (RC_Channel_Copter).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.fields import get_whole
from cosim.frames import deg_e7, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_FRAME_GLOBAL_RELATIVE_ALT,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
)
from cosim.model import record_layout
from cosim_models.autopilot.commander.mode_requests import arm_checked, request_mode
from cosim_models.autopilot.commander.positions import has_moved
from cosim_models.autopilot.commander.switches import return_to_switch
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.assisted.zigzag import return_to_pilot, store_or_go
from cosim_models.autopilot.flight.outputs import set_relay, stop_motors
from cosim_models.autopilot.flight.state import disarm, reported_mode
from cosim_models.autopilot.flight.sticks import channel, hands_on, receiver_pulse, throttle_open
from cosim_models.autopilot.flight.tuning.autotune import select_gains
from cosim_models.autopilot.link.statustext import (
    AUX_INVALID,
    INFO,
    NO_CEILING,
    NO_GROUND,
    NO_NUMBER,
    SWITCHES,
    WARNING,
    say,
)
from cosim_models.autopilot.mission.missions import (
    AUTOCONTINUE,
    COMMAND,
    FRAME,
    LATITUDE,
    MISSION_CAPACITY,
    Z,
    mission_count,
    set_current,
)
from cosim_models.autopilot.record.modes import (
    ACRO,
    ALT_HOLD,
    AUTO,
    AUTO_RTL,
    AUTOTUNE,
    BRAKE,
    CIRCLE,
    DRIFT,
    FLIP,
    FLOWHOLD,
    FOLLOW,
    GUIDED,
    LAND,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
    STABILIZE,
    THROW,
    ZIGZAG,
)
from cosim_models.autopilot.record.variables import CHANNELS, VARIABLES

__all__ = ["use_switch", "watch_auxiliary"]

_MODES = np.array(
    (
        (2, FLIP),
        (4, RTL),
        (16, AUTO),
        (18, LAND),
        (17, AUTOTUNE),
        (33, BRAKE),
        (37, THROW),
        (42, SMART_RTL),
        (52, ACRO),
        (55, GUIDED),
        (56, LOITER),
        (57, FOLLOW),
        (60, ZIGZAG),
        (68, STABILIZE),
        (69, POSHOLD),
        (70, ALT_HOLD),
        (71, FLOWHOLD),
        (72, CIRCLE),
        (73, DRIFT),
        (99, AUTO_RTL),
    ),
    dtype=np.int64,
)
_SAVE_WAYPOINT, _FENCE, _RESET_MISSION, _RELAY, _ESTOP, _CLEAR_MISSION = 7, 11, 24, 28, 31, 58
_ZIGZAG, _SURFACE, _DISARM, _ARM_DISARM, _ARM_ESTOP = 61, 75, 81, 153, 165
_TUNED_GAINS = 180
_LOW, _MIDDLE, _HIGH = 0, 1, 2
_LAST, _MORE, _LAST_MORE = 115, 150, 185  # ranges of functions that ArduCopter knows
_TOLD = np.array((_SAVE_WAYPOINT, _FENCE, _RESET_MISSION, _RELAY, _ESTOP, _CLEAR_MISSION, _SURFACE), dtype=np.int64)
"""Functions whose switches are told, in the order of the texts."""
_LOWEST = 1.0  # m, of the take-off of a saved mission

_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_OPTIONS = np.array([_FIELDS[f"RC{number}_OPTION"][1] for number in range(1, CHANNELS + 1)], dtype=np.int64)


# ---- missions ------------------------------------------------------------------------------------------------------


@kernel
def _flies_mission(m: Any) -> bool:
    return bool(m.armed and m.mode == AUTO and not m.mission_complete)


@kernel
def _append(m: Any, command: int, north: float, east: float, up: float) -> None:
    """Adds an item to the mission; places are relative to the local origin, the height is above home."""
    row = max(mission_count(m), 1)
    if row >= MISSION_CAPACITY:
        return
    r = m.mission[row]
    for i in range(r.shape[0]):
        r[i] = 0.0
    r[COMMAND], r[FRAME], r[AUTOCONTINUE], r[Z] = float(command), float(MAV_FRAME_GLOBAL_RELATIVE_ALT), 1.0, up
    if command != MAV_CMD_NAV_TAKEOFF:
        lat, lon, _ = geodetic_from_local(north, east, 0.0, m.origin_latitude, m.origin_longitude, 0.0)
        r[LATITUDE], r[LATITUDE + 1] = float(deg_e7(lat)), float(deg_e7(lon))
    m.mission_count = row + 1


@kernel
def _save_waypoint(m: Any, t: float) -> None:
    """Adds the present place to the mission, after a take-off if that is empty; with a closed throttle, a landing."""
    if m.mode == AUTO or not m.armed:
        return
    p = m.position_neu
    up = p[2] - m.home_neu[2]
    if mission_count(m) <= 1:
        if not throttle_open(m, t):
            return
        _append(m, MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, max(up, _LOWEST))
    _append(m, MAV_CMD_NAV_WAYPOINT if throttle_open(m, t) else MAV_CMD_NAV_LAND, p[0], p[1], up)


@kernel
def _change_mission(m: Any, number: int, t: float) -> None:
    """Saves a waypoint, begins the mission anew, or clears it, unless it is being flown."""
    if number == _SAVE_WAYPOINT:
        _save_waypoint(m, t)
    elif number == _RESET_MISSION:
        set_current(m, 0)
    elif not _flies_mission(m):
        m.mission_count, m.mission_current = 0, 0


# ---- the functions -------------------------------------------------------------------------------------------------


@kernel
def _track_surface(m: Any, at: int) -> None:
    """Selects the surface that a pilot's modes follow: low the ground, middle none, high the ceiling."""
    if at == _MIDDLE:
        m.SURFTRAK_MODE = 0
    elif at == _HIGH or not m.ranging:
        say(m, WARNING, NO_CEILING if at == _HIGH else NO_GROUND, NO_NUMBER)
    else:
        m.SURFTRAK_MODE = 1


@kernel
def _arm_or_stop(m: Any, number: int, at: int, t: float) -> None:
    """Performs the functions that arm, disarm, or stop the motors."""
    if number == _ESTOP:
        if at != _MIDDLE:
            stop_motors(m, at == _HIGH)
    elif number == _ARM_ESTOP:
        stop_motors(m, at == _LOW)
    if number in (_ARM_DISARM, _ARM_ESTOP) and at == _HIGH:
        arm_checked(m, False, False, t)
    elif (number == _ARM_DISARM and at == _LOW) or (number == _DISARM and at == _HIGH):
        disarm(m)


@kernel
def use_switch(m: Any, function: float, position: float, t: float) -> int:
    """Does what a switch of the remote control would do; position 0 low, 1 middle, 2 high. Returns a MAV_RESULT."""
    if not 0.0 <= position < 3.0:
        return MAV_RESULT_DENIED
    at = int(position)
    number = int(clip(function, 0.0, 65535.0)) if function == function else 65535
    for i in range(_MODES.shape[0]):
        if _MODES[i, 0] == number:
            if at == _HIGH:
                request_mode(m, int(_MODES[i, 1]), t)
            elif _MODES[i, 1] == reported_mode(m) and m.mode != FLIP:
                return_to_switch(m)
            return MAV_RESULT_ACCEPTED
    if number == _FENCE:
        m.FENCE_ENABLE = 1 if at == _HIGH else 0
    elif number == _ZIGZAG and m.mode == ZIGZAG:
        if at == _MIDDLE:
            return_to_pilot(m, False)
        else:
            store_or_go(m, 0 if at == _LOW else 1)
    elif number == _TUNED_GAINS:
        select_gains(m, at)
    elif number == _RELAY:
        set_relay(m, 0.0, 1.0 if at == _HIGH else 0.0)
    elif number == _SURFACE:
        _track_surface(m, at)
    elif number in (_SAVE_WAYPOINT, _RESET_MISSION, _CLEAR_MISSION):
        if at == _HIGH:
            _change_mission(m, number, t)
    elif number in (_ESTOP, _DISARM, _ARM_DISARM, _ARM_ESTOP):
        _arm_or_stop(m, number, at, t)
    elif not (0 < number <= _LAST or _MORE <= number <= _LAST_MORE):
        say(m, INFO, AUX_INVALID, number)
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED


# ---- channels ------------------------------------------------------------------------------------------------------


@kernel
def _watch(m: Any, i: int, option: int, t: float) -> None:
    """Reads the switch of channel i (from 0), and acts if it has moved."""
    arms = option in (_ARM_DISARM, _ARM_ESTOP)
    if not has_moved(m, i, channel(m, i + 1, t), receiver_pulse(m, i + 1), arms, t):
        return
    position = int(m.aux_position[i])
    for k in range(_TOLD.shape[0]):
        if _TOLD[k] == option:
            say(m, INFO, SWITCHES + 3 * k + position - 1, i + 1)
    use_switch(m, float(option), float(position - 1), t)


@kernel
def watch_auxiliary(m: Any, t: float) -> None:
    """Responds to the switches of the channels that have a function, while a pilot flies."""
    if not hands_on(m, t):
        return
    for i in range(CHANNELS):
        option = get_whole(m, _OPTIONS[i])
        if option != 0:
            _watch(m, i, option, t)
