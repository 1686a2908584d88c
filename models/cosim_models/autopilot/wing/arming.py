"""Checks before planes and quadplanes are armed, and how they are told.

All that fail are told, by "Arm: " when arming is refused, by "PreArm: " when RUN_PREARM_CHECKS asks, every 30 s, and
when those that all firmwares have begin to fail. The checks are those of position, battery, mission, emergency stop,
fail-safes, limits of the flight, radio, rotors, landing sequence and mode; if arming is forced, that of the radio
alone. Once a second, m.checks_passed says whether all pass. Kernels over a record with `ARMING_MEMORY`,
`wing_parameters`, and the parameters and memory of `wing.failsafes` and `wing.sequence`.

Differences from ArduPlane: sensors are never inconsistent nor uncalibrated, there is no check of Q_ASSIST_SPEED (the
rotors help on the wing without it).

Source: ArduPilot, AP_Arming (pre_arm_checks, update), ArduPlane/AP_Arming_Plane.cpp, mode.cpp and mode_auto.cpp
(_pre_arm_checks), AP_MotorsMulticopter (arming_checks), AP_AHRS (a plane without GPS uses its DCM).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_LAND_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_TEMPORARILY_REJECTED,
    MAV_SEVERITY_CRITICAL,
)
from cosim_models.autopilot.commander.readiness import GPS_AT, HOME_AT, reached
from cosim_models.autopilot.gcs.battery import battery_permits_arming
from cosim_models.autopilot.gcs.missions import COMMAND, item_place
from cosim_models.autopilot.gcs.streams import ready
from cosim_models.autopilot.gcs.words import (
    ARM_AHRS,
    ARM_AIRSPEED,
    ARM_GPS,
    ARM_HOME,
    ARM_LANDING,
    ARM_LEAN,
    ARM_MISSION,
    ARM_NO_LANDING,
    ARM_NO_RETURN,
    ARM_NO_TAKEOFF,
    ARM_NOT_LIFTED,
    ARM_NOT_TAKEOFF,
    ARM_PITCH_MAX,
    ARM_PITCH_MIN,
    ARM_RADIO,
    ARM_RADIO_LOST,
    ARM_ROLL,
    ARM_SPIN,
    ARM_STOPPED,
    ARM_THIS_MODE,
    ARM_TIMEOUTS,
    ASKED,
    REFUSED,
    SILENT,
    say_figures,
    say_mode,
)
from cosim_models.autopilot.wing.sequence import in_landing_sequence

__all__ = ["ARMING_MEMORY", "checking", "lifted_checks", "lifted_missions", "landing_checks", "landing_missions"]

_SHORT_OFF, _ON = 3, 1  # FS_SHORT_ACTN, THR_FAILSAFE
_LEAST_ANGLE, _LEAST_SPEED = 3.0, 5.0  # degrees, m/s
_LEAST_LEAN, _MOST_LEAN = 10.0, 80.0  # degrees, of Q_ANGLE_MAX
_MOST_SPIN = 0.3  # Q_M_SPIN_MIN
_AUTO, _RTL, _GUIDED, _QSTABILIZE, _QLAND, _QRTL, _QACRO = 10, 11, 15, 17, 20, 21, 23
_ONLY_LIFTED = 1 << 18  # Q_OPTIONS
_LANDINGS = (MAV_CMD_NAV_LAND, MAV_CMD_NAV_VTOL_LAND)
_SHORTEST = 0.75  # of the distance within which it stops, before a landing
_PERIOD, _REPEATED, _AT_ONCE = 1.0, 30.0, 4.0  # s

ARMING_MEMORY = (
    Memory("checks_due"),  # s
    Memory("checks_told_at", rare=True),  # s
    Memory("sensors_passed", dtype="?", rare=True),  # the checks that all firmwares have
    Memory("checks_new", dtype="?", rare=True),  # these have begun to fail
)


@kernel
def _fail(m: Any, text: int, figure: float) -> bool:
    say_figures(m, MAV_SEVERITY_CRITICAL, text, (figure, 0.0, 0.0, 0.0))
    return False


@kernel
def _fail_mode(m: Any, text: int) -> bool:
    say_mode(m, MAV_SEVERITY_CRITICAL, text, m.mode)
    return False


@kernel
def _position(m: Any, t: float) -> bool:
    passes = True
    if not ready(m, t) or m.position_lost:
        passes = _fail(m, ARM_AHRS, 0.0)
    if not reached(m, t, GPS_AT) or m.gps_silent:
        return _fail(m, ARM_GPS, 1.0)
    return passes if reached(m, t, HOME_AT) else _fail(m, ARM_HOME, 0.0)


@kernel
def _limits(m: Any) -> bool:
    passes = True
    if m.FS_LONG_TIMEOUT < m.FS_SHORT_TIMEOUT and m.FS_SHORT_ACTN != _SHORT_OFF:
        passes = _fail(m, ARM_TIMEOUTS, 0.0)
    if m.ROLL_LIMIT_DEG < _LEAST_ANGLE:
        passes = _fail(m, ARM_ROLL, m.ROLL_LIMIT_DEG)
    if m.PTCH_LIM_MAX_DEG < _LEAST_ANGLE:
        passes = _fail(m, ARM_PITCH_MAX, m.PTCH_LIM_MAX_DEG)
    if m.PTCH_LIM_MIN_DEG > -_LEAST_ANGLE:
        passes = _fail(m, ARM_PITCH_MIN, m.PTCH_LIM_MIN_DEG)
    if m.AIRSPEED_MIN < _LEAST_SPEED:
        passes = _fail(m, ARM_AIRSPEED, m.AIRSPEED_MIN)
    return passes


@kernel
def _radio(m: Any) -> bool:
    if m.THR_FAILSAFE != _ON or m.radio_known:
        return True
    return _fail(m, ARM_RADIO, 0.0)


@kernel
def landing_checks(m: Any) -> bool:
    """Returns whether a mission does not go on with a landing; says that it does."""
    return not (m.mode == _AUTO and in_landing_sequence(m)) or _fail(m, ARM_LANDING, 0.0)


@kernel
def landing_missions(m: Any) -> bool:
    """Returns whether returns use the landing sequences of a mission; says that they do not."""
    if m.RTL_AUTOLAND == 0:
        for row in range(1, m.mission_count):
            if int(m.mission[row, COMMAND]) == MAV_CMD_DO_LAND_START:
                return _fail(m, ARM_NO_RETURN, 0.0)
    return True


# ---- quadplanes ----------------------------------------------------------------------------------------------------


@kernel
def lifted_missions(m: Any) -> bool:
    """Returns whether a quadplane can stop before the vertical landings of its mission; says why not."""
    passes = landing_missions(m)
    least = _SHORTEST * 0.5 * m.AIRSPEED_CRUISE * m.AIRSPEED_CRUISE / m.Q_TRANS_DECEL
    for row in range(2, m.mission_count):
        before = int(m.mission[row - 1, COMMAND])
        if int(m.mission[row, COMMAND]) in _LANDINGS and before == MAV_CMD_NAV_WAYPOINT:
            n, e, _ = item_place(m, row)
            from_n, from_e, _ = item_place(m, row - 1)
            if math.sqrt((n - from_n) ** 2 + (e - from_e) ** 2) < least:
                passes = _fail(m, ARM_NO_LANDING, least)
    return passes


@kernel
def _begins_with_takeoff(m: Any) -> bool:
    row = max(m.mission_current, 1)
    if row >= m.mission_count:
        return False
    return int(m.mission[row, COMMAND]) in (MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_VTOL_TAKEOFF)


@kernel
def lifted_checks(m: Any) -> bool:
    """Returns whether the rotors of a quadplane, and its mode, permit arming; says why not."""
    passes = True
    if m.Q_M_SPIN_MIN > _MOST_SPIN:
        passes = _fail(m, ARM_SPIN, m.Q_M_SPIN_MIN)
    if not _LEAST_LEAN <= m.Q_ANGLE_MAX <= _MOST_LEAN:
        passes = _fail(m, ARM_LEAN, 0.0)
    passes = landing_checks(m) and passes
    only = m.Q_OPTIONS & _ONLY_LIFTED != 0
    if m.mode == _AUTO:
        if not _begins_with_takeoff(m):
            passes = _fail_mode(m, ARM_NOT_TAKEOFF if only else ARM_NO_TAKEOFF)
    elif only and m.mode not in (_RTL, _GUIDED) and not _QSTABILIZE <= m.mode <= _QACRO:
        passes = _fail_mode(m, ARM_NOT_LIFTED)
    return passes


# ---- all of them ---------------------------------------------------------------------------------------------------


def checking(
    more: Callable[[Any], bool], missions: Callable[[Any], bool]
) -> tuple[Callable[[Any, bool, float], bool], Callable[[Any, float], int], Callable[[Any, float], None]]:
    """Returns three kernels that perform the checks.

    The first, of (record, whether forced, time [s]), returns whether arming is permitted, and says why not. The second,
    of (record, time), answers RUN_PREARM_CHECKS with a MAV_RESULT and the texts. The third, of the same, is required
    from m.checks_due on while it is not armed.

    Args:
        more: kernel of (record) that returns whether checks of the vehicle pass, and says why not.
        missions: the same for its mission.
    """

    @kernel
    def check_all_firmwares(m: Any, t: float) -> bool:
        passes = _position(m, t)
        passes = battery_permits_arming(m) and passes
        if m.radio_lost:
            passes = _fail(m, ARM_RADIO_LOST, 0.0)
        if m.mode == _AUTO and m.mission_count <= 1:
            passes = _fail(m, ARM_MISSION, 0.0)
        passes = missions(m) and passes
        if m.emergency_stop:
            passes = _fail(m, ARM_STOPPED, 0.0)
        m.checks_new = m.checks_new or (m.sensors_passed and not passes)
        m.sensors_passed = passes
        return bool(passes)

    @kernel
    def check(m: Any, t: float) -> bool:
        passes = check_all_firmwares(m, t)
        passes = _limits(m) and passes
        passes = _radio(m) and passes
        passes = more(m) and passes
        if m.mode in (_RTL, _QLAND, _QRTL):
            passes = _fail_mode(m, ARM_THIS_MODE)
        return bool(passes)

    @kernel
    def permits(m: Any, forced: bool, t: float) -> bool:
        return bool(_radio(m) if forced else check(m, t))

    @kernel
    def ask(m: Any, t: float) -> int:
        if m.armed:
            return MAV_RESULT_TEMPORARILY_REJECTED
        m.checks_told = ASKED
        check(m, t)
        m.checks_told = REFUSED
        return MAV_RESULT_ACCEPTED

    @kernel
    def watch(m: Any, t: float) -> None:
        if t - m.checks_due > _PERIOD:  # it has been armed: every 30 s goes on
            m.checks_told_at = t - (t - m.checks_told_at) % _REPEATED
        m.checks_due = t + _PERIOD - 1e-9
        since = t - m.checks_told_at
        tells = since > _REPEATED or (m.checks_new and since > _AT_ONCE)
        if tells:
            m.checks_told_at, m.checks_new = t, False
        m.checks_told = ASKED if tells else SILENT
        m.checks_passed = check(m, t)
        m.checks_told = REFUSED

    return permits, ask, watch
