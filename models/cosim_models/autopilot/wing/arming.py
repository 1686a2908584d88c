"""Checks before planes and quadplanes are armed: battery, fail-safes, limits of the flight, and the radio.

All that fail are told. Kernels over a record with `wing_parameters`, and the parameters and memory of `wing.failsafes`.

Source: ArduPilot, ArduPlane/AP_Arming_Plane.cpp.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_CRITICAL
from cosim_models.autopilot.gcs.battery import battery_permits_arming
from cosim_models.autopilot.gcs.words import (
    ARM_AIRSPEED,
    ARM_PITCH_MAX,
    ARM_PITCH_MIN,
    ARM_RADIO,
    ARM_ROLL,
    ARM_TIMEOUTS,
    say,
    say_figures,
)

__all__ = ["permits_arming"]

_SHORT_OFF, _ON = 3, 1  # FS_SHORT_ACTN, THR_FAILSAFE
_LEAST_ANGLE, _LEAST_SPEED = 3.0, 5.0  # degrees, m/s


@kernel
def _refuse(m: Any, text: int, figure: float) -> bool:
    say_figures(m, MAV_SEVERITY_CRITICAL, text, (figure, 0.0, 0.0, 0.0))
    return False


@kernel
def _checks(m: Any) -> bool:
    """Returns whether battery, fail-safes and limits permit arming; says why not."""
    permits = battery_permits_arming(m)
    if m.FS_LONG_TIMEOUT < m.FS_SHORT_TIMEOUT and m.FS_SHORT_ACTN != _SHORT_OFF:
        permits = _refuse(m, ARM_TIMEOUTS, 0.0)
    if m.ROLL_LIMIT_DEG < _LEAST_ANGLE:
        permits = _refuse(m, ARM_ROLL, m.ROLL_LIMIT_DEG)
    if m.PTCH_LIM_MAX_DEG < _LEAST_ANGLE:
        permits = _refuse(m, ARM_PITCH_MAX, m.PTCH_LIM_MAX_DEG)
    if m.PTCH_LIM_MIN_DEG > -_LEAST_ANGLE:
        permits = _refuse(m, ARM_PITCH_MIN, m.PTCH_LIM_MIN_DEG)
    if m.AIRSPEED_MIN < _LEAST_SPEED:
        permits = _refuse(m, ARM_AIRSPEED, m.AIRSPEED_MIN)
    return bool(permits)


@kernel
def permits_arming(m: Any, forced: bool) -> bool:
    """Returns whether these checks permit arming, that of the radio alone if it is forced; says why not."""
    permits = forced or _checks(m)
    if m.THR_FAILSAFE == _ON and not m.radio_known:
        say(m, MAV_SEVERITY_CRITICAL, ARM_RADIO, 0)
        permits = False
    return bool(permits)
