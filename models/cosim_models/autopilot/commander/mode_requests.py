"""Requests to change mode or arm: ArduCopter's checks, and its status texts on refusal.

Commands of ground stations (`commands`), the pilot's switches (`switches`) and fail-safes all use this module. Kernels
over the autopilot's record `m`.

Source: ArduPilot, ArduCopter mode and AP_Arming_Copter; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_CONDITION_YAW,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_NAV_TAKEOFF,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
)
from cosim_models.autopilot.commander.readiness import attitude_ready, prearm_ready
from cosim_models.autopilot.flight.modes import can_begin, set_mode
from cosim_models.autopilot.flight.plans.order import is_above_terrain, landing_sequence
from cosim_models.autopilot.flight.state import arm, disarm, needs_position, position_ready
from cosim_models.autopilot.flight.sticks import by_throttle, pilot_climb_rate, stick_throttle, throttle_open
from cosim_models.autopilot.link.statustext import (
    ACCELS_INCONSISTENT,
    ACRO_TOO_HIGH,
    AHRS_TYPE,
    ARM_BATTERY_FAILSAFE,
    ARM_CHARGE,
    ARM_CHUTE,
    ARM_CIRCLE,
    ARM_MISSION,
    ARM_NEEDS_POSITION,
    ARM_POLYGON,
    ARM_RTL_RANGE,
    ARM_RTL_RANGE_END,
    ARM_RTL_TERRAIN,
    ARM_RTL_TERRAIN_END,
    ARM_STOPPED,
    ARM_TERRAIN,
    ARM_THROTTLE,
    ARM_VOLTAGE,
    ARMING,
    ATTITUDE_BAD,
    AUTO_NOT_ARMABLE,
    AUTO_REFUSED,
    AUTO_RTL_END,
    AUTO_RTL_NOT_ARMABLE,
    AUTO_RTL_START,
    AUTOTUNE_NOT_ARMABLE,
    AUTOTUNE_REFUSED,
    AVOID_NOT_ARMABLE,
    AVOID_REFUSED,
    AVOID_REFUSED_END,
    BRAKE_NOT_ARMABLE,
    BRAKE_REFUSED,
    CIRCLE_NOT_ARMABLE,
    CIRCLE_REFUSED,
    CRITICAL,
    DRIFT_REFUSED,
    DRIFT_TOO_HIGH,
    FLIP_NOT_ARMABLE,
    FLIP_REFUSED,
    FLOWHOLD_REFUSED,
    FOLLOW_DISABLED,
    FOLLOW_REFUSED,
    GUIDED_NOT_ARMABLE,
    GUIDED_REFUSED,
    INFO,
    LAND_NOT_ARMABLE,
    LAND_SEQUENCE_NONE,
    LOITER_REFUSED,
    MISSING_TAKEOFF,
    NO_NUMBER,
    NO_SUCH_MODE,
    POSHOLD_REFUSED,
    PREARM_ACCELS,
    PREARM_AHRS_TYPE,
    PREARM_ATTITUDE,
    PREARM_BATTERY_FAILSAFE,
    PREARM_CHARGE,
    PREARM_CHUTE,
    PREARM_CIRCLE,
    PREARM_HOME,
    PREARM_MISSION,
    PREARM_NEEDS_POSITION,
    PREARM_POLYGON,
    PREARM_RTL_RANGE,
    PREARM_RTL_RANGE_END,
    PREARM_RTL_TERRAIN,
    PREARM_RTL_TERRAIN_END,
    PREARM_TERRAIN,
    PREARM_VOLTAGE,
    RTL_NOT_ARMABLE,
    RTL_REFUSED,
    SMART_RTL_NO_POSITION,
    SMART_RTL_NOT_ARMABLE,
    SMART_RTL_REFUSED,
    STABILIZE_REFUSED,
    SYSTEMID_NO_AXIS,
    SYSTEMID_REFUSED,
    THROW_REFUSED,
    TURTLE_REFUSED,
    WAITING_FOR_HOME,
    WARNING,
    ZIGZAG_REFUSED,
    say,
)
from cosim_models.autopilot.mission.fences import CIRCLE as FENCE_CIRCLE
from cosim_models.autopilot.mission.fences import POLYGON, within_polygons
from cosim_models.autopilot.mission.missions import COMMAND, mission_count
from cosim_models.autopilot.mission.terrain import BY_RANGE, NO_TERRAIN, terrain_source
from cosim_models.autopilot.record.modes import (
    ACRO,
    AUTO,
    AUTO_RTL,
    AUTOTUNE,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    DRIFT,
    FLIP,
    FLOWHOLD,
    FOLLOW,
    GUIDED,
    GUIDED_NOGPS,
    LAND,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
    STABILIZE,
    SYSTEMID,
    THROW,
    TURTLE,
    ZIGZAG,
    Mode,
)

__all__ = [
    "arm_checked",
    "arm_or_disarm",
    "change_mode",
    "check_arming",
    "request_mode",
    "start_landing_sequence",
    "start_mission",
]


_ARM_IN_AUTO, _FLY_AT_ONCE = 1, 2  # AUTO_OPTIONS
_ARM_BY_STICK = 1  # GUID_OPTIONS
_FORCE_ARM, _FORCE = 2989.0, 21196.0


_MODES = np.array([int(mode) for mode in Mode], dtype=np.int64)
# Modes, and the texts on refusal: without a position, and when their conditions are not met; 0: they always are.
_REFUSALS = np.array(
    (
        (GUIDED, GUIDED_REFUSED, 0),
        (LOITER, LOITER_REFUSED, 0),
        (RTL, RTL_REFUSED, 0),
        (AUTO, AUTO_REFUSED, 0),
        (CIRCLE, CIRCLE_REFUSED, 0),
        (BRAKE, BRAKE_REFUSED, 0),
        (AVOID_ADSB, AVOID_REFUSED, 0),
        (DRIFT, DRIFT_REFUSED, 0),
        (POSHOLD, POSHOLD_REFUSED, 0),
        (ZIGZAG, ZIGZAG_REFUSED, 0),
        (SMART_RTL, SMART_RTL_NO_POSITION, SMART_RTL_REFUSED),
        (FLIP, FLIP_REFUSED, FLIP_REFUSED),
        (THROW, THROW_REFUSED, THROW_REFUSED),
        (AUTOTUNE, AUTOTUNE_REFUSED, AUTOTUNE_REFUSED),
        (FLOWHOLD, FLOWHOLD_REFUSED, FLOWHOLD_REFUSED),
        (FOLLOW, FOLLOW_REFUSED, FOLLOW_REFUSED),
        (SYSTEMID, SYSTEMID_REFUSED, SYSTEMID_REFUSED),
        (TURTLE, TURTLE_REFUSED, TURTLE_REFUSED),
    ),
    dtype=np.int64,
)
_NOT_ARMABLE = np.array(
    (
        (LAND, LAND_NOT_ARMABLE),
        (RTL, RTL_NOT_ARMABLE),
        (BRAKE, BRAKE_NOT_ARMABLE),
        (CIRCLE, CIRCLE_NOT_ARMABLE),
        (AVOID_ADSB, AVOID_NOT_ARMABLE),
        (FLIP, FLIP_NOT_ARMABLE),
        (AUTOTUNE, AUTOTUNE_NOT_ARMABLE),
        (SMART_RTL, SMART_RTL_NOT_ARMABLE),
    ),
    dtype=np.int64,
)


@kernel
def _is_mode(mode: int) -> bool:
    found = False
    for known in _MODES:
        found = found or known == mode
    return found


@kernel
def _refuse_mode(m: Any, mode: int, met: bool) -> int:
    """Reports why a mode cannot be entered: without a position, or because its conditions are not `met`."""
    if mode == FOLLOW:
        say(m, WARNING, FOLLOW_DISABLED, NO_NUMBER)
    elif mode == SYSTEMID:
        say(m, WARNING, SYSTEMID_NO_AXIS, NO_NUMBER)
    for i in range(_REFUSALS.shape[0]):
        if _REFUSALS[i, 0] == mode:
            say(m, WARNING, int(_REFUSALS[i, 1] if met else _REFUSALS[i, 2]), NO_NUMBER)
    if mode == AVOID_ADSB:
        say(m, WARNING, AVOID_REFUSED_END, NO_NUMBER)
    return MAV_RESULT_FAILED


@kernel
def _mission_can_begin(m: Any) -> bool:
    """Returns whether AUTO can be entered: a mission exists and, armed on the ground, begins with a take-off.

    Disarmed, AUTO can always be entered.
    """
    count = mission_count(m)
    if not m.armed:
        return True
    if count <= 1:
        say(m, WARNING, AUTO_REFUSED, NO_NUMBER)
        return False
    if m.on_ground:
        row = 1
        while row < count and (
            m.mission[row, COMMAND] == MAV_CMD_CONDITION_YAW or m.mission[row, COMMAND] == MAV_CMD_DO_CHANGE_SPEED
        ):
            row += 1
        if row >= count or m.mission[row, COMMAND] != MAV_CMD_NAV_TAKEOFF:
            say(m, WARNING, MISSING_TAKEOFF, NO_NUMBER)
            return False
    return True


@kernel
def start_mission(m: Any, t: float) -> int:
    """Starts the mission on the ground; returns a MAV_RESULT."""
    if change_mode(m, AUTO, t) != MAV_RESULT_ACCEPTED:
        return MAV_RESULT_FAILED
    m.auto_armed = m.armed
    return MAV_RESULT_ACCEPTED


@kernel
def _throttle_is_high(m: Any, mode: int, t: float) -> bool:
    """Returns whether a change to a mode flown by throttle would make the vehicle leap off the ground; reports it."""
    if not (m.armed and m.on_ground and by_throttle(mode)) or m.mode == STABILIZE or m.mode == ACRO:
        return False
    middle = m.ACRO_THR_MID if mode == ACRO and m.ACRO_THR_MID > 0.0 else m.throttle_hover
    if stick_throttle(m, middle, t) <= 0.5 * m.throttle_hover:
        return False
    say(
        m,
        WARNING,
        ACRO_TOO_HIGH if mode == ACRO else DRIFT_TOO_HIGH if mode == DRIFT else STABILIZE_REFUSED,
        NO_NUMBER,
    )
    return True


@kernel
def start_landing_sequence(m: Any, t: float) -> bool:
    """Changes to AUTO at the mission's landing sequence, as AUTO_RTL; returns False without one, and reports it."""
    row = landing_sequence(m)
    if row == 0:
        say(m, WARNING, LAND_SEQUENCE_NONE, NO_NUMBER)
        return False
    if m.mode != AUTO and change_mode(m, AUTO, t) != MAV_RESULT_ACCEPTED:
        return False
    m.mission_current = row
    m.mission_complete = False
    m.mission_changed = True
    m.auto_rtl = True
    return True


@kernel
def _change_to_auto_rtl(m: Any, t: float) -> int:
    if start_landing_sequence(m, t):
        return MAV_RESULT_ACCEPTED
    say(m, WARNING, AUTO_RTL_START, NO_NUMBER)
    say(m, WARNING, AUTO_RTL_END, NO_NUMBER)
    return MAV_RESULT_FAILED


@kernel
def change_mode(m: Any, mode: int, t: float) -> int:
    """Changes to a mode given by ArduCopter's number; returns a MAV_RESULT."""
    if mode == m.mode and not (mode == AUTO and m.auto_rtl):
        return MAV_RESULT_ACCEPTED
    if mode in (FLOWHOLD, FOLLOW, SYSTEMID, TURTLE):
        return _refuse_mode(m, mode, False)
    if not _is_mode(mode):
        say(m, WARNING, NO_SUCH_MODE, mode)
        return MAV_RESULT_FAILED
    if mode == AUTO:
        m.auto_rtl = False
        if m.mode != AUTO and not _mission_can_begin(m):
            return MAV_RESULT_FAILED
    if _throttle_is_high(m, mode, t):
        return MAV_RESULT_FAILED
    if m.armed and needs_position(mode) and not position_ready(m, t):
        return _refuse_mode(m, mode, True)
    if not can_begin(m, mode, t):
        return _refuse_mode(m, mode, False)
    set_mode(m, mode, t)
    if not m.armed and needs_position(mode) and not position_ready(m, t):
        say(m, CRITICAL, PREARM_NEEDS_POSITION, NO_NUMBER)
    return MAV_RESULT_ACCEPTED


@kernel
def request_mode(m: Any, mode: int, t: float) -> int:
    """Like `change_mode`, and AUTO_RTL as well."""
    return _change_to_auto_rtl(m, t) if mode == AUTO_RTL else change_mode(m, mode, t)


@kernel
def _refuse(m: Any, before: bool, arming: int, prearm: int) -> bool:
    """Reports a failed check of arming, or of the time before it; returns False."""
    say(m, CRITICAL, prearm if before else arming, NO_NUMBER)
    return False


@kernel
def _check_terrain(m: Any, before: bool) -> bool:
    """Returns whether there is the terrain that RTL_ALT_TYPE and the mission need, and reports if not."""
    source = terrain_source(m)
    if m.RTL_ALT_TYPE == 1 and source == NO_TERRAIN:
        _refuse(m, before, ARM_RTL_TERRAIN, PREARM_RTL_TERRAIN)
        return _refuse(m, before, ARM_RTL_TERRAIN_END, PREARM_RTL_TERRAIN_END)
    if m.RTL_ALT_TYPE == 1 and source == BY_RANGE and m.RTL_ALT > 100.0 * m.RNGFND1_MAX:
        _refuse(m, before, ARM_RTL_RANGE, PREARM_RTL_RANGE)
        return _refuse(m, before, ARM_RTL_RANGE_END, PREARM_RTL_RANGE_END)
    if source == NO_TERRAIN:
        for row in range(1, mission_count(m)):
            if is_above_terrain(m, row):
                return _refuse(m, before, ARM_TERRAIN, PREARM_TERRAIN)
    return True


@kernel
def check_arming(m: Any, before: bool, t: float) -> bool:
    """Returns whether those of ArduCopter's checks pass that can fail here, and reports the first failure.

    `before`: the checks before arming, whose texts begin with "PreArm:".
    """
    checked = m.ARMING_CHECK != 0
    if checked and not attitude_ready(m, t):
        _refuse(m, before, ACCELS_INCONSISTENT, PREARM_ACCELS)
        _refuse(m, before, ATTITUDE_BAD, PREARM_ATTITUDE)
        return _refuse(m, before, AHRS_TYPE, PREARM_AHRS_TYPE)
    if needs_position(m.mode) and not position_ready(m, t):
        return _refuse(m, before, ARM_NEEDS_POSITION, PREARM_NEEDS_POSITION)
    if not checked:
        return True
    if not prearm_ready(m, t):
        return _refuse(m, before, WAITING_FOR_HOME, PREARM_HOME)
    if 0.0 < m.battery_voltage < m.BATT_ARM_VOLT:
        return _refuse(m, before, ARM_VOLTAGE, PREARM_VOLTAGE)
    if m.BATT_ARM_MAH > 0.0 and m.BATT_CAPACITY - m.battery_used < m.BATT_ARM_MAH:
        return _refuse(m, before, ARM_CHARGE, PREARM_CHARGE)
    if m.battery_alarm != 0:
        return _refuse(m, before, ARM_BATTERY_FAILSAFE, PREARM_BATTERY_FAILSAFE)
    if m.parachute_on:
        return _refuse(m, before, ARM_CHUTE, PREARM_CHUTE)
    if m.FENCE_ENABLE != 0 and position_ready(m, t):
        n, e = m.position_neu[0], m.position_neu[1]
        hn, he = n - m.home_neu[0], e - m.home_neu[1]
        if (m.FENCE_TYPE & FENCE_CIRCLE) != 0 and hn * hn + he * he > m.FENCE_RADIUS**2:
            return _refuse(m, before, ARM_CIRCLE, PREARM_CIRCLE)
        if (m.FENCE_TYPE & POLYGON) != 0 and m.fence_count > 0 and not within_polygons(m, n, e):
            return _refuse(m, before, ARM_POLYGON, PREARM_POLYGON)
    if m.mode == AUTO and mission_count(m) <= 1:
        return _refuse(m, before, ARM_MISSION, PREARM_MISSION)
    return _check_terrain(m, before)


@kernel
def _is_armable(m: Any, by_stick: bool, t: float) -> bool:
    """Returns whether mode and throttle permit arming; reports if not."""
    text = 0
    for i in range(_NOT_ARMABLE.shape[0]):
        if _NOT_ARMABLE[i, 0] == m.mode:
            text = int(_NOT_ARMABLE[i, 1])
    if m.mode == AUTO and m.auto_rtl:
        text = AUTO_RTL_NOT_ARMABLE
    elif m.mode == AUTO and (m.AUTO_OPTIONS & _ARM_IN_AUTO) == 0:
        text = AUTO_NOT_ARMABLE
    elif m.mode == GUIDED and by_stick and (m.GUID_OPTIONS & _ARM_BY_STICK) == 0:
        text = GUIDED_NOT_ARMABLE
    if text != 0:
        say(m, CRITICAL, text, NO_NUMBER)
        return False
    checked = m.ARMING_CHECK != 0 and m.mode not in (GUIDED, GUIDED_NOGPS, AUTO)
    if checked and (pilot_climb_rate(m, t) > 0.0 or (by_throttle(m.mode) and throttle_open(m, t))):
        say(m, CRITICAL, ARM_THROTTLE, NO_NUMBER)
        return False
    return True


@kernel
def arm_checked(m: Any, forced: bool, by_stick: bool, t: float) -> int:
    """Arms after ArduCopter's checks, or without them if `forced`; returns a MAV_RESULT."""
    if m.armed:
        return MAV_RESULT_ACCEPTED
    if m.emergency_stop and not forced:
        say(m, CRITICAL, ARM_STOPPED, NO_NUMBER)
        return MAV_RESULT_FAILED
    if not forced and not (check_arming(m, False, t) and _is_armable(m, by_stick, t)):
        return MAV_RESULT_FAILED
    arm(m, t)
    if m.mode == AUTO and (m.AUTO_OPTIONS & _FLY_AT_ONCE) != 0:
        m.auto_armed = True
    say(m, INFO, ARMING, NO_NUMBER)
    return MAV_RESULT_ACCEPTED


@kernel
def arm_or_disarm(m: Any, p1: float, p2: float, t: float) -> int:
    """Handles COMPONENT_ARM_DISARM; returns a MAV_RESULT."""
    if p1 == 1.0:
        return arm_checked(m, p2 in (_FORCE_ARM, _FORCE), False, t)
    if p1 == 0.0:
        if m.armed and not m.on_ground and p2 != _FORCE:
            return MAV_RESULT_FAILED
        disarm(m)
        return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED
