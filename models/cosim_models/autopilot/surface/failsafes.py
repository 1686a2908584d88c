"""Fail-safes of rovers and boats: a lost ground station, a lost radio, a low battery, a lost position, and a crash.

Ten times a second. Ground station and radio act by FS_ACTION when a cause has lasted for FS_TIMEOUT, in HOLD only with
FS_OPTIONS 1, and never in RTL; the mode does not change back. Battery and position are in `gcs.battery` and
`surface.estimate`. A vehicle that an autonomous mode drives and that neither moves nor turns for 2 s, or leans by more
than CRASH_ANGLE, has crashed. None of these three is looked at while a motor is tested.

Source: ArduPilot, Rover/failsafe.cpp, Rover.cpp (gcs_failsafe_check), Rover.h (urgency of the battery's actions),
radio.cpp, crash_check.cpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from cosim import Memory
from cosim.frames import roll_pitch_from_quaternion
from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_SEVERITY_EMERGENCY, MAV_SEVERITY_INFO, MAV_SEVERITY_WARNING
from cosim_models.autopilot.gcs.battery import BATTERY_MEMORY, alarming, battery_parameters, drain
from cosim_models.autopilot.gcs.contact import CONTACT_MEMORY, station_is_lost
from cosim_models.autopilot.gcs.positioning import GPS_MEMORY, GPS_PARAMETERS, watch_gps
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.sticks import THROTTLE, overridden, pulse_of
from cosim_models.autopilot.gcs.words import AUTO_GOES_ON, CLEARED, CRASHED, LOST, say
from cosim_models.autopilot.surface.estimate import (
    ESTIMATE_MEMORY,
    ESTIMATE_PARAMETERS,
    watching_estimate,
)

__all__ = ["FAILSAFE_MEMORY", "FAILSAFE_PARAMETERS", "drain_battery", "failsafes"]

_PERIOD = 0.1  # s
_RADIO, _STATION = 1, 2  # bits of causes; the texts are in this order
_NONE, _RTL, _HOLD, _TRACK, _TRACK_OR_HOLD, _TERMINATE, _LOITER = range(7)  # FS_ACTION
_GOES_ON = 2  # FS_GCS_ENABLE and FS_THR_ENABLE: a mission goes on
_NO_PULSES, _NO_RADIO = 1, 0.5  # SIM_RC_FAIL; s
_CRASHED = 20  # checks
_STILL = 0.08  # m/s and rad/s
_IDLE = 0.05  # throttle
_HOLD_AND_DISARM = 2  # FS_CRASH_CHECK
_URGENCY = (_TERMINATE, _HOLD, _RTL, _TRACK_OR_HOLD, _TRACK, _NONE)

FAILSAFE_PARAMETERS = (
    whole("FS_ACTION", _HOLD, "fail-safe: 0 none, 1 RTL, 2 HOLD, 3 SMART_RTL or RTL, 4 or HOLD, 5 disarms, 6 LOITER"),
    real("FS_TIMEOUT", "s", 1.5, "time after which a fail-safe acts"),
    whole("FS_THR_ENABLE", 1, "1: a lost radio is a fail-safe; 2: but a mission goes on"),
    whole("FS_THR_VALUE", 910, "throttle pulse below which the radio is lost, us"),
    whole("FS_GCS_ENABLE", 0, "1: a lost ground station is a fail-safe; 2: but a mission goes on"),
    real("FS_GCS_TIMEOUT", "s", 5.0, "time without HEARTBEAT after which the ground station is lost"),
    whole("FS_CRASH_CHECK", 0, "after a crash: 1 HOLD, 2 HOLD and disarm"),
    real("CRASH_ANGLE", "deg", 0.0, "lean that is a crash, 0: none"),
    whole("FS_OPTIONS", 0, "1: fail-safes act in HOLD, too"),
    whole("SIM_RC_FAIL", 0, "1: the simulated receiver gives no pulses"),
    *battery_parameters("an action as of FS_ACTION"),
    *ESTIMATE_PARAMETERS,
    *GPS_PARAMETERS,
)
FAILSAFE_MEMORY = (
    Memory("failsafe_due", rare=True),  # s
    Memory("failsafe_bits", dtype="i4", rare=True),  # causes that are there
    Memory("failsafe_acted", dtype="i4", rare=True),  # causes for which it has acted
    Memory("failsafe_since", rare=True),  # s
    Memory("crash_count", dtype="i4", rare=True),
    *CONTACT_MEMORY,
    *BATTERY_MEMORY,
    *ESTIMATE_MEMORY,
    *GPS_MEMORY,
)


@kernel
def drain_battery(m: Any, t: float) -> None:
    """Drains the battery for the throttle."""
    drain(m, abs(2.0 * m.motor[1] - 1.0) if m.armed else 0.0, t)


@kernel
def _cannot_fail(m: Any) -> bool:
    """Returns whether nothing can be a cause: there has been no stick, and all else is off."""
    causes = m.FS_GCS_ENABLE | m.FS_CRASH_CHECK | m.SIM_RC_FAIL | m.failsafe_bits | m.failsafe_acted
    return bool(causes == 0 and not m.sticks_known)


@kernel
def _say(m: Any, severity: int, text: int, cause: int) -> None:
    """Says the text of a cause."""
    say(m, severity, text + (0 if cause == _RADIO else 1), 0)


@kernel
def _radio_is_lost(m: Any, t: float) -> bool:
    if m.SIM_RC_FAIL != _NO_PULSES or overridden(m, THROTTLE, t):
        m.radio_heard = t
    return bool(t - m.radio_heard > _NO_RADIO or pulse_of(m, THROTTLE, t) < m.FS_THR_VALUE)


@kernel
def _is_crashed(m: Any) -> bool:
    """Counts checks in which a driven vehicle stands; returns whether it has crashed."""
    q, v = m.attitude, m.velocity
    if m.CRASH_ANGLE > 0.0:
        roll, pitch = roll_pitch_from_quaternion((q[0], q[1], q[2], q[3]))
        if max(abs(roll), abs(pitch)) > math.radians(m.CRASH_ANGLE):
            return True
    moves = v[0] * v[0] + v[1] * v[1] >= _STILL * _STILL or abs(m.angular_velocity[2]) >= _STILL
    if moves or abs(2.0 * m.motor[1] - 1.0) < _IDLE:
        m.crash_count = 0
        return False
    m.crash_count += 1
    return bool(m.crash_count >= _CRASHED)


def failsafes(
    hold: int,
    rtl: int,
    track: int,
    loiter: int,
    auto: int,
    free: tuple[int, ...],
    enter: Callable[[Any, int, float], int],
) -> Callable[[Any, float], None]:
    """Returns a kernel of (record, time [s]) that runs the fail-safes when they are due.

    Args:
        hold, rtl, track, loiter, auto: numbers of the modes HOLD, RTL, SMART_RTL, LOITER and AUTO.
        free: modes that need no position.
        enter: kernel of (record, mode, time) that changes the mode; returns a MAV_RESULT.
    """

    watch_estimate = watching_estimate(free, hold, enter)
    new_action = alarming(_URGENCY)

    @kernel
    def act(m: Any, action: int, t: float) -> None:
        if action == _TERMINATE:
            m.armed = False
            return
        if action in (_TRACK, _TRACK_OR_HOLD) and enter(m, track, t) == MAV_RESULT_ACCEPTED:
            return
        if action in (_RTL, _TRACK) and enter(m, rtl, t) == MAV_RESULT_ACCEPTED:
            return
        if action == _LOITER and enter(m, loiter, t) == MAV_RESULT_ACCEPTED:
            return
        if action != _NONE:
            enter(m, hold, t)

    @kernel
    def trigger(m: Any, cause: int, lost: bool, goes_on: bool, t: float) -> None:
        before = m.failsafe_bits
        m.failsafe_bits = before | cause if lost else before & ~cause
        if before == 0 and lost:
            m.failsafe_since = t
        if m.failsafe_acted != 0 and m.failsafe_bits == 0:
            _say(m, MAV_SEVERITY_INFO, CLEARED, cause)
        m.failsafe_acted &= m.failsafe_bits
        held = m.mode == rtl or (m.mode == hold and (m.FS_OPTIONS & 1) == 0)
        if m.failsafe_acted != 0 or m.failsafe_bits == 0 or t - m.failsafe_since <= m.FS_TIMEOUT or held:
            return
        m.failsafe_acted = m.failsafe_bits
        _say(m, MAV_SEVERITY_WARNING, LOST, cause)
        for i in range(m.rc_override.shape[0]):
            m.rc_override[i] = 0
        if m.mode == auto and goes_on:
            say(m, MAV_SEVERITY_WARNING, AUTO_GOES_ON, 0)
        else:
            act(m, m.FS_ACTION, t)

    @kernel
    def watch(m: Any, t: float) -> None:
        m.failsafe_due = t + _PERIOD - 1e-9
        drain_battery(m, t)
        action = new_action(m, t)
        if action != _NONE:
            act(m, action, t)
        if m.SIM_GPS1_ENABLE == 0 or m.gps_off or m.position_lost or m.ekf_count > 0 or m.ekf_failed:
            watch_gps(m, t)
            watch_estimate(m, t)
        if m.test_motor > 0 or _cannot_fail(m):
            m.radio_heard = t
            return
        if m.FS_THR_ENABLE != 0:
            trigger(m, _RADIO, _radio_is_lost(m, t), m.FS_THR_ENABLE == _GOES_ON, t)
        if m.FS_GCS_ENABLE != 0 and m.station_known:
            trigger(m, _STATION, station_is_lost(m, m.FS_GCS_TIMEOUT, t), m.FS_GCS_ENABLE == _GOES_ON, t)
        if not m.armed or m.FS_CRASH_CHECK == 0 or not m.autonomous:
            m.crash_count = 0
        elif _is_crashed(m):
            m.crash_count = 0
            say(m, MAV_SEVERITY_EMERGENCY, CRASHED, 0)
            enter(m, hold, t)
            m.armed = m.FS_CRASH_CHECK != _HOLD_AND_DISARM

    return watch
