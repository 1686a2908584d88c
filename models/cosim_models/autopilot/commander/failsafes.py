"""Fail-safes: responses to a lost ground station, a lost radio and a breached fence.

The fail-safes run ten times a second. The ground station is lost if, after the first HEARTBEAT of SYSID_MYGCS, none
arrives for FS_GCS_TIMEOUT; this also detects a lost link. Fences are a maximum and a minimum height, a circle, all
relative to home, and the uploaded polygons and circles. Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter events (failsafe_gcs_check), fence, AC_Fence.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim_models.autopilot.commander.actions import (
    BRAKES,
    LANDS,
    LANDS_AS_PLANNED,
    NOTHING,
    RETURNS,
    RETURNS_BY_PATH,
    RETURNS_BY_PATH_OR_LANDS,
    act,
)
from cosim_models.autopilot.commander.auxiliary import watch_auxiliary
from cosim_models.autopilot.commander.battery import CRITICAL_CHARGE, drain, new_alarm
from cosim_models.autopilot.commander.checks import watch_flight
from cosim_models.autopilot.commander.sensors import watch_sensors
from cosim_models.autopilot.commander.switches import watch_switches
from cosim_models.autopilot.commander.terrain import watch_terrain
from cosim_models.autopilot.control.motors import update_lift
from cosim_models.autopilot.flight.modes import set_mode
from cosim_models.autopilot.flight.returning.breadcrumbs import forget_path, record_path
from cosim_models.autopilot.flight.state import disarm, landed_state, position_ready
from cosim_models.autopilot.flight.sticks import NO_PULSES, channel, hands_on, throttle_zero
from cosim_models.autopilot.link.statustext import (
    BATTERY_DISARMING,
    BATTERY_LANDING,
    BATTERY_LOST,
    CIRCLE_BREACHED,
    FENCE_CLEARED,
    GCS_AUTO,
    GCS_CLEARED,
    GCS_DISARMING,
    GCS_LANDING,
    GCS_LOST,
    GCS_PILOT,
    HIGH_BREACHED,
    LOW_BREACHED,
    NO_NUMBER,
    POLYGON_BREACHED,
    RADIO_AUTO,
    RADIO_CLEARED,
    RADIO_DISARMING,
    RADIO_GUIDED,
    RADIO_LANDING,
    RADIO_LOST,
    WARNING,
    say,
)
from cosim_models.autopilot.mission.fences import CIRCLE, HIGHEST, LOWEST, POLYGON, within_polygons
from cosim_models.autopilot.record.modes import (
    ACRO,
    ALT_HOLD,
    AUTO,
    BRAKE,
    DRIFT,
    FLIP,
    GUIDED,
    LAND,
    LANDING,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
    STABILIZE,
    THROW,
)

__all__ = ["hear_station", "watch"]

_PERIOD = 0.1  # s
_FENCE_PERIOD = 0.04  # s
_GIVE_UP = 100.0  # m beyond a fence at which the vehicle lands instead of returning
# FS_OPTIONS
_AUTO_GOES_ON, _AUTO_GOES_ON_ALONE, _GUIDED_GOES_ON, _LANDING_GOES_ON, _PILOT_GOES_ON_ALONE = 1, 2, 4, 8, 16
_REPORT, _ALWAYS_LAND, _PATH, _BRAKE, _PATH_OR_LAND = 0, 2, 3, 4, 5  # FENCE_ACTION
_FURTHER = 20.0  # m beyond a breach at which it is another one
_OF_THROTTLE = np.array(
    (NOTHING, RETURNS, RETURNS, LANDS, RETURNS_BY_PATH, RETURNS_BY_PATH_OR_LANDS, LANDS_AS_PLANNED, BRAKES),
    dtype=np.int64,
)
"""The action of each FS_THR_ENABLE."""


@kernel
def hear_station(m: Any, sender: int, t: float) -> None:
    """Records a HEARTBEAT of the ground station."""
    if sender == m.SYSID_MYGCS:
        m.station_heard = t
        m.station_known = True


@kernel
def _change(m: Any, mode: int, t: float) -> None:
    """Changes to a mode, or to LAND if that is not possible; on the ground, disarms instead."""
    if m.on_ground:
        disarm(m)
    elif mode == LAND or not position_ready(m, t) or not set_mode(m, mode, t):
        set_mode(m, LAND, t)


@kernel
def _flown_by_hand(mode: int) -> bool:
    """Returns whether a mode is none of an autopilot, in ArduCopter's sense."""
    return mode in (STABILIZE, ACRO, ALT_HOLD, LOITER, DRIFT, FLIP, POSHOLD, BRAKE, THROW)


@kernel
def _has_no_throttle(m: Any, t: float) -> bool:
    """Returns whether the vehicle is on the ground or flown with closed throttle."""
    return bool(m.on_ground or ((m.mode == STABILIZE or m.mode == ACRO) and throttle_zero(m, t)))


@kernel
def _watch_station(m: Any, t: float) -> None:
    lost = m.FS_GCS_ENABLE > 0 and m.station_known and t - m.station_heard > m.FS_GCS_TIMEOUT
    if lost == m.station_lost:
        return
    m.station_lost = lost
    if not lost:
        say(m, WARNING, GCS_CLEARED, NO_NUMBER)
        return
    if not m.armed:
        return
    if m.on_ground:
        say(m, WARNING, GCS_DISARMING, NO_NUMBER)
        disarm(m)
        return
    if (m.FS_OPTIONS & _LANDING_GOES_ON) != 0 and _is_landing(m):
        say(m, WARNING, GCS_LANDING, NO_NUMBER)
        return
    if m.mode == AUTO and (m.FS_OPTIONS & _AUTO_GOES_ON_ALONE) != 0:
        say(m, WARNING, GCS_AUTO, NO_NUMBER)
        return
    if _flown_by_hand(m.mode) and (m.FS_OPTIONS & _PILOT_GOES_ON_ALONE) != 0:
        say(m, WARNING, GCS_PILOT, NO_NUMBER)
        return
    say(m, WARNING, GCS_LOST, NO_NUMBER)
    action = int(m.FS_GCS_ENABLE)
    if action == 1 or action == 2:
        action = RETURNS
    elif action == 5:
        action = LANDS
    act(m, action, t)


@kernel
def _beyond(m: Any) -> tuple[float, float, float]:
    """Returns the distances [m] by which the vehicle is above, outside and below its fences; negative within."""
    p, home = m.position_neu, m.home_neu
    n, e, height = p[0] - home[0], p[1] - home[1], p[2] - home[2]
    return height - m.FENCE_ALT_MAX, math.sqrt(n * n + e * e) - m.FENCE_RADIUS, m.FENCE_ALT_MIN - height


@kernel
def _watch_battery(m: Any, t: float) -> None:
    drain(m, _PERIOD)
    update_lift(m, _PERIOD)
    alarm = new_alarm(m, t)
    if alarm == 0:
        return
    action = m.BATT_FS_CRT_ACT if alarm == CRITICAL_CHARGE else m.BATT_FS_LOW_ACT
    if _has_no_throttle(m, t):
        say(m, WARNING, BATTERY_DISARMING, NO_NUMBER)
        disarm(m)
    elif action != 0 and (m.FS_OPTIONS & _LANDING_GOES_ON) != 0 and _is_landing(m):
        say(m, WARNING, BATTERY_LANDING, NO_NUMBER)
    else:
        say(m, WARNING, BATTERY_LOST, NO_NUMBER)
        act(m, action, t)


@kernel
def _is_landing(m: Any) -> bool:
    return landed_state(m) == LANDING


@kernel
def _watch_radio(m: Any, t: float) -> None:
    """Detects a lost radio: no signal, or a throttle below FS_THR_VALUE."""
    if hands_on(m, t) or m.SIM_RC_FAIL != NO_PULSES:
        m.radio_heard = t
    pulse = channel(m, m.RCMAP_THROTTLE, t)
    lost = m.FS_THR_ENABLE > 0 and (t - m.radio_heard >= m.RC_FS_TIMEOUT or (pulse != 0 and pulse < m.FS_THR_VALUE))
    if lost == m.radio_lost:
        return
    m.radio_lost = lost
    if not lost:
        say(m, WARNING, RADIO_CLEARED, NO_NUMBER)
    elif _has_no_throttle(m, t):
        say(m, WARNING, RADIO_DISARMING, NO_NUMBER)
        disarm(m)
    elif (m.FS_OPTIONS & _LANDING_GOES_ON) != 0 and _is_landing(m):
        say(m, WARNING, RADIO_LANDING, NO_NUMBER)
    elif m.mode == AUTO and ((m.FS_OPTIONS & _AUTO_GOES_ON) != 0 or m.FS_THR_ENABLE == 2):
        say(m, WARNING, RADIO_AUTO, NO_NUMBER)
    elif m.mode == GUIDED and (m.FS_OPTIONS & _GUIDED_GOES_ON) != 0:
        say(m, WARNING, RADIO_GUIDED, NO_NUMBER)
    else:
        say(m, WARNING, RADIO_LOST, NO_NUMBER)
        act(m, int(_OF_THROTTLE[m.FS_THR_ENABLE]), t)


@kernel
def _breached_again(m: Any, row: int, known: bool, beyond: float) -> bool:
    """Returns whether a breach by `beyond` [m] is new, or 20 m further than the last one that was told."""
    if known and beyond < m.fence_backup[row]:
        return False
    m.fence_backup[row] = beyond + _FURTHER
    return True


@kernel
def _breaches(m: Any) -> tuple[int, int]:
    """Returns the fences that are breached, and those of which that must be told."""
    before = int(m.fence_breach)
    above, outside, below = _beyond(m)
    m.fence_low_armed = m.fence_low_armed or below < 0.0  # active only after it has been exceeded once
    low = m.fence_low_armed and not m.on_ground and m.mode != LAND and m.mode != RTL  # whose descent is intended
    now, new = 0, 0
    if (m.FENCE_TYPE & HIGHEST) != 0 and above >= 0.0:
        now += HIGHEST
        new += HIGHEST if _breached_again(m, 0, (before & HIGHEST) != 0, above) else 0
    if (m.FENCE_TYPE & CIRCLE) != 0 and outside >= 0.0:
        now += CIRCLE
        new += CIRCLE if _breached_again(m, 1, (before & CIRCLE) != 0, outside) else 0
    if (m.FENCE_TYPE & LOWEST) != 0 and low and below >= 0.0:
        now += LOWEST
        new += LOWEST if _breached_again(m, 2, (before & LOWEST) != 0, below) else 0
    n, e = m.position_neu[0], m.position_neu[1]
    if (m.FENCE_TYPE & POLYGON) != 0 and m.fence_count > 0 and not within_polygons(m, n, e):
        now += POLYGON
        new += POLYGON & ~before
    return now, new


@kernel
def _watch_fence(m: Any, t: float) -> None:
    """Acts on the breaches found last, and looks for others, 25 times a second as ArduCopter's main loop does.

    ArduCopter looks in another thread, just after its main loop has taken the breaches found before.
    """
    m.next_fence = t + _FENCE_PERIOD
    if m.FENCE_ENABLE == 0 or not m.armed:
        m.fence_breach = 0
        m.fence_new = 0
        m.fence_low_armed = False
        m.fence_recovery = 0.0
        return
    if m.fence_new != 0:
        _act_on_breach(m, t)
    if m.fence_recovery > 0.0:
        if t < m.fence_recovery - 1e-9:
            return
        m.fence_recovery = 0.0
    before = m.fence_breach
    now, new = _breaches(m)
    if now == 0 and before != 0:
        say(m, WARNING, FENCE_CLEARED, NO_NUMBER)
    m.fence_breach = now
    if new != 0:
        m.fence_new = new
        m.breach_count += 1
        m.breach_time = t


@kernel
def _act_on_breach(m: Any, t: float) -> None:
    """Tells of the breaches found last, and performs FENCE_ACTION."""
    new = int(m.fence_new)
    m.fence_new = 0
    if (new & HIGHEST) != 0:
        say(m, WARNING, HIGH_BREACHED, NO_NUMBER)
    if (new & CIRCLE) != 0:
        say(m, WARNING, CIRCLE_BREACHED, NO_NUMBER)
    if (new & POLYGON) != 0:
        say(m, WARNING, POLYGON_BREACHED, NO_NUMBER)
    if (new & LOWEST) != 0:
        say(m, WARNING, LOW_BREACHED, NO_NUMBER)
    if m.FENCE_ACTION != _REPORT:
        _leave_fence(m, t)


@kernel
def _leave_fence(m: Any, t: float) -> None:
    """Performs FENCE_ACTION; far beyond a fence, the vehicle lands."""
    above, outside, _ = _beyond(m)
    if m.mode == STABILIZE and m.on_ground:
        disarm(m)
    elif m.FENCE_ACTION == _ALWAYS_LAND or max(above, outside) >= _GIVE_UP:
        _change(m, LAND, t)
    elif m.FENCE_ACTION == _BRAKE:
        _change(m, BRAKE, t)
    elif m.FENCE_ACTION == _PATH and not m.on_ground and position_ready(m, t) and set_mode(m, SMART_RTL, t):
        return
    elif m.FENCE_ACTION == _PATH_OR_LAND:
        _change(m, SMART_RTL, t)
    else:
        _change(m, RTL, t)


@kernel
def _count_flights(m: Any, t: float) -> None:
    flies = m.armed and not m.on_ground
    if flies and m.flown_since == 0.0:
        m.flown_since = t
        m.flights += 1
    elif not flies:
        m.flown_since = 0.0


@kernel
def watch(m: Any, t: float) -> None:
    """Runs the fail-safes, ten times a second, and the fences, 25 times a second."""
    if m.FENCE_ENABLE != 0 and t >= m.next_fence - 1e-9:
        _watch_fence(m, t)
    if t < m.next_watch - 1e-9:
        return
    m.next_watch = t + _PERIOD
    _count_flights(m, t)
    if not m.crumbs_begun and position_ready(m, t):
        forget_path(m, t, True)
    elif m.crumbs_on and m.armed and m.mode != SMART_RTL:
        record_path(m, position_ready(m, t), t)
    watch_sensors(m, t)
    watch_flight(m, t)
    _watch_battery(m, t)
    _watch_station(m, t)
    _watch_radio(m, t)
    watch_switches(m, t)
    watch_auxiliary(m, t)
    if m.terrain_on or m.terrain_missing or m.terrain_failsafe:
        watch_terrain(m, t)
    if m.FENCE_ENABLE == 0:
        _watch_fence(m, t)
