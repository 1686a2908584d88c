"""Requests to change mode or arm: ArduCopter's checks, and its status texts on refusal.

Commands of ground stations (`commands`), the pilot's switches (`switches`) and fail-safes all use this module. Kernels
over the autopilot's record `m`.

Source: ArduPilot, ArduCopter mode and AP_Arming_Copter; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

from typing import Any

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
from cosim_models.autopilot.flight.modes import set_mode
from cosim_models.autopilot.flight.state import arm, disarm, needs_position, position_ready
from cosim_models.autopilot.flight.sticks import pilot_climb_rate, pilot_throttle, throttle_open
from cosim_models.autopilot.link.statustext import (
    ACCELS_INCONSISTENT,
    AHRS_TYPE,
    ARM_BATTERY_FAILSAFE,
    ARM_CHARGE,
    ARM_CIRCLE,
    ARM_MISSION,
    ARM_NEEDS_POSITION,
    ARM_POLYGON,
    ARM_THROTTLE,
    ARM_VOLTAGE,
    ARMING,
    ATTITUDE_BAD,
    AUTO_NOT_ARMABLE,
    AUTO_REFUSED,
    AUTOTUNE_REFUSED,
    AVOID_NOT_ARMABLE,
    AVOID_REFUSED,
    AVOID_REFUSED_END,
    BRAKE_NOT_ARMABLE,
    BRAKE_REFUSED,
    CIRCLE_NOT_ARMABLE,
    CIRCLE_REFUSED,
    CRITICAL,
    FLIP_REFUSED,
    GUIDED_NOT_ARMABLE,
    GUIDED_REFUSED,
    INFO,
    LAND_NOT_ARMABLE,
    LOITER_REFUSED,
    MISSING_TAKEOFF,
    NO_NUMBER,
    NO_SUCH_MODE,
    PREARM_ACCELS,
    PREARM_AHRS_TYPE,
    PREARM_ATTITUDE,
    PREARM_BATTERY_FAILSAFE,
    PREARM_CHARGE,
    PREARM_CIRCLE,
    PREARM_HOME,
    PREARM_MISSION,
    PREARM_NEEDS_POSITION,
    PREARM_POLYGON,
    PREARM_VOLTAGE,
    RTL_NOT_ARMABLE,
    RTL_REFUSED,
    STABILIZE_REFUSED,
    THROW_REFUSED,
    WAITING_FOR_HOME,
    WARNING,
    say,
)
from cosim_models.autopilot.mission.fences import CIRCLE as FENCE_CIRCLE
from cosim_models.autopilot.mission.fences import POLYGON, within_polygons
from cosim_models.autopilot.mission.missions import COMMAND, mission_count
from cosim_models.autopilot.record.modes import (
    ALT_HOLD,
    AUTO,
    AUTOTUNE,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    FLIP,
    GUIDED,
    GUIDED_NOGPS,
    LAND,
    LOITER,
    RTL,
    STABILIZE,
    THROW,
)

__all__ = [
    "arm_checked",
    "arm_or_disarm",
    "change_mode",
    "check_arming",
    "start_mission",
]


_ARM_IN_AUTO, _FLY_AT_ONCE = 1, 2  # AUTO_OPTIONS
_ARM_BY_STICK = 1  # GUID_OPTIONS
_FORCE_ARM, _FORCE = 2989.0, 21196.0


@kernel
def _is_mode(mode: int) -> bool:
    return mode in (STABILIZE, ALT_HOLD, BRAKE, CIRCLE, AUTO, GUIDED, LOITER, RTL, LAND, AVOID_ADSB, GUIDED_NOGPS)


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
def change_mode(m: Any, mode: int, t: float) -> int:
    """Changes to a mode given by ArduCopter's number; returns a MAV_RESULT."""
    if mode in (FLIP, AUTOTUNE, THROW):
        say(
            m,
            WARNING,
            FLIP_REFUSED if mode == FLIP else THROW_REFUSED if mode == THROW else AUTOTUNE_REFUSED,
            NO_NUMBER,
        )
        return MAV_RESULT_FAILED
    if not _is_mode(mode):
        say(m, WARNING, NO_SUCH_MODE, mode)
        return MAV_RESULT_FAILED
    if mode == AUTO and m.mode != AUTO and not _mission_can_begin(m):
        return MAV_RESULT_FAILED
    if mode == STABILIZE and m.mode != STABILIZE and m.on_ground and pilot_throttle(m, t) > 0.5 * m.throttle_hover:
        say(m, WARNING, STABILIZE_REFUSED, NO_NUMBER)
        return MAV_RESULT_FAILED
    if not set_mode(m, mode, t):
        text = GUIDED_REFUSED if mode == GUIDED else LOITER_REFUSED if mode == LOITER else RTL_REFUSED
        if mode == AUTO:
            text = AUTO_REFUSED
        elif mode == CIRCLE:
            text = CIRCLE_REFUSED
        elif mode == BRAKE:
            text = BRAKE_REFUSED
        elif mode == AVOID_ADSB:
            text = AVOID_REFUSED
        say(m, WARNING, text, NO_NUMBER)
        if text == AVOID_REFUSED:
            say(m, WARNING, AVOID_REFUSED_END, NO_NUMBER)
        return MAV_RESULT_FAILED
    if not m.armed and needs_position(mode) and not position_ready(m, t):
        say(m, CRITICAL, PREARM_NEEDS_POSITION, NO_NUMBER)
    return MAV_RESULT_ACCEPTED


@kernel
def _refuse(m: Any, before: bool, arming: int, prearm: int) -> bool:
    """Reports a failed check of arming, or of the time before it; returns False."""
    say(m, CRITICAL, prearm if before else arming, NO_NUMBER)
    return False


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
    if m.FENCE_ENABLE != 0 and position_ready(m, t):
        n, e = m.position_neu[0], m.position_neu[1]
        hn, he = n - m.home_neu[0], e - m.home_neu[1]
        if (m.FENCE_TYPE & FENCE_CIRCLE) != 0 and hn * hn + he * he > m.FENCE_RADIUS**2:
            return _refuse(m, before, ARM_CIRCLE, PREARM_CIRCLE)
        if (m.FENCE_TYPE & POLYGON) != 0 and m.fence_count > 0 and not within_polygons(m, n, e):
            return _refuse(m, before, ARM_POLYGON, PREARM_POLYGON)
    if m.mode == AUTO and mission_count(m) <= 1:
        return _refuse(m, before, ARM_MISSION, PREARM_MISSION)
    return True


@kernel
def _is_armable(m: Any, by_stick: bool, t: float) -> bool:
    """Returns whether mode and throttle permit arming; reports if not."""
    text = 0
    if m.mode == LAND:
        text = LAND_NOT_ARMABLE
    elif m.mode == RTL:
        text = RTL_NOT_ARMABLE
    elif m.mode == BRAKE:
        text = BRAKE_NOT_ARMABLE
    elif m.mode == CIRCLE:
        text = CIRCLE_NOT_ARMABLE
    elif m.mode == AVOID_ADSB:
        text = AVOID_NOT_ARMABLE
    elif m.mode == AUTO and (m.AUTO_OPTIONS & _ARM_IN_AUTO) == 0:
        text = AUTO_NOT_ARMABLE
    elif m.mode == GUIDED and by_stick and (m.GUID_OPTIONS & _ARM_BY_STICK) == 0:
        text = GUIDED_NOT_ARMABLE
    if text != 0:
        say(m, CRITICAL, text, NO_NUMBER)
        return False
    by_throttle = m.ARMING_CHECK != 0 and m.mode not in (GUIDED, GUIDED_NOGPS, AUTO)
    if by_throttle and (pilot_climb_rate(m, t) > 0.0 or (m.mode == STABILIZE and throttle_open(m, t))):
        say(m, CRITICAL, ARM_THROTTLE, NO_NUMBER)
        return False
    return True


@kernel
def arm_checked(m: Any, forced: bool, by_stick: bool, t: float) -> int:
    """Arms after ArduCopter's checks, or without them if `forced`; returns a MAV_RESULT."""
    if m.armed:
        return MAV_RESULT_ACCEPTED
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
