"""How a twitch changes the gains: five kinds of twitches, each repeated until four of them have succeeded.

The derivative gain (for YAW, the filter of the error) grows until the rate bounces back after its peak, then falls
until it does not; the proportional gain keeps the peak just below the target meanwhile, and then grows until the target
is passed. The gain of the angle falls until the angle does not overshoot, then grows until it does. Kernels over the
autopilot's record `m`; rates in rad/s, angles in rad.

Source: ArduPilot, AC_AutoTune_Multi.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.flight.tuning.gains import ACCEL, ANGLE, ERROR_FILTER, YAW, D, P, row_of
from cosim_models.autopilot.link.statustext import (
    CRITICAL,
    INFO,
    NO_NUMBER,
    TUNE_ANGLE_FAILED,
    TUNE_D_FAILED,
    TUNE_D_LEAST,
    TUNE_P_FAILED,
    say,
)

__all__ = [
    "ANGLE_DOWN",
    "ANGLE_UP",
    "D_DOWN",
    "D_UP",
    "FAILED",
    "KINDS",
    "P_UP",
    "PEAK",
    "SUCCESSES",
    "TARGET_ANGLE",
    "TARGET_RATE",
    "TROUGH",
    "change_gains",
    "ease_found",
]

D_UP, D_DOWN, P_UP, ANGLE_DOWN, ANGLE_UP = range(5)
"""Kinds of twitches, in their order."""
KINDS = 5
SUCCESSES = 4
"""Twitches that must succeed before the next kind."""
FAILED = 3
"""Value of m.tune_stage after a failure."""
TARGET_RATE, TARGET_ANGLE = 0, 1
"""Columns of m.tune_target."""
PEAK, TROUGH = 0, 1
"""Columns of m.tune_rates and m.tune_angles."""

_STEP = 0.05  # share by which a gain changes
_MARGIN = 0.2  # below the target rate, within which D is tuned
_P_MIN, _P_MAX = 0.01, 2.0
_D_MAX = 0.2
_FILTER_MIN, _FILTER_MAX = 1.0, 5.0  # Hz, that YAW tunes as it were D
_ANGLE_MIN, _ANGLE_MAX = 0.5, 40.0
_ANGLE_EASED = 0.9
_ACCEL_MIN, _YAW_ACCEL_MIN = 4000.0, 1000.0  # cdeg/s2


@kernel
def _d_column(m: Any) -> int:
    """Returns the column of the gain that is tuned as D."""
    return ERROR_FILTER if m.tune_axis == YAW else D


@kernel
def _d_least(m: Any) -> float:
    return _FILTER_MIN if m.tune_axis == YAW else float(m.AUTOTUNE_MIN_D)


@kernel
def _succeed(m: Any) -> None:
    m.tune_successes += 1


@kernel
def _fall_back(m: Any) -> None:
    if m.tune_successes > 0:
        m.tune_successes -= 1


@kernel
def _fail(m: Any, text: int) -> None:
    say(m, CRITICAL, text, NO_NUMBER)
    m.tune_stage = FAILED


@kernel
def _lower_d(m: Any) -> None:
    """Lowers D; at its least value, this kind of twitch ends."""
    row, d = row_of(m.tune_axis), _d_column(m)
    m.tune_found[row, d] *= 1.0 - _STEP
    if m.tune_found[row, d] <= _d_least(m):
        m.tune_found[row, d] = _d_least(m)
        m.tune_successes = SUCCESSES
        say(m, INFO, TUNE_D_LEAST, NO_NUMBER)


@kernel
def _bring_to_target(m: Any, peak: float) -> bool:
    """Changes P, at its least value D, unless the peak is within the margin below the target; returns whether."""
    row = row_of(m.tune_axis)
    found, target = m.tune_found, m.tune_target[TARGET_RATE]
    if peak > target:
        found[row, P] *= 1.0 - _STEP
        if found[row, P] < _P_MIN:
            found[row, P] = _P_MIN
            _lower_d(m)
        return True
    if peak < target * (1.0 - _MARGIN) and found[row, P] <= _P_MAX:
        found[row, P] = min(found[row, P] * (1.0 + _STEP), _P_MAX)
        return True
    return False


@kernel
def _tune_d_up(m: Any, peak: float, trough: float) -> None:
    if _bring_to_target(m, peak):
        return
    row, d = row_of(m.tune_axis), _d_column(m)
    if peak - trough > peak * m.AUTOTUNE_AGGR:
        m.tune_skips = True
        _succeed(m)
    elif m.tune_skips:
        m.tune_skips = False
    else:
        _fall_back(m)
        most = _FILTER_MAX if m.tune_axis == YAW else _D_MAX
        m.tune_found[row, d] *= 1.0 + 2.0 * _STEP
        if m.tune_found[row, d] >= most:
            m.tune_found[row, d] = most
            m.tune_successes = SUCCESSES


@kernel
def _tune_d_down(m: Any, peak: float, trough: float) -> None:
    if _bring_to_target(m, peak):
        return
    if peak - trough >= peak * m.AUTOTUNE_AGGR:
        m.tune_skips = True
        _fall_back(m)
        _lower_d(m)
    elif m.tune_skips:
        m.tune_skips = False
    else:
        _succeed(m)


@kernel
def _tune_p_up(m: Any, peak: float, trough: float) -> None:
    row, d = row_of(m.tune_axis), _d_column(m)
    found, target, least = m.tune_found, m.tune_target[TARGET_RATE], _d_least(m)
    bounces = peak - trough > peak * m.AUTOTUNE_AGGR
    if peak > target * (1.0 + 0.5 * m.AUTOTUNE_AGGR):
        m.tune_skips = True
        _succeed(m)
    elif target * (1.0 - _MARGIN) < peak < target and bounces and found[row, d] > least:
        _fall_back(m)
        found[row, d] *= 1.0 - _STEP
        if found[row, d] <= least:
            found[row, d] = least
            if m.tune_axis != YAW:
                _fail(m, TUNE_D_FAILED)
        found[row, P] *= 1.0 - _STEP
        if found[row, P] <= _P_MIN:
            found[row, P] = _P_MIN
            _fail(m, TUNE_P_FAILED)
    elif m.tune_skips:
        m.tune_skips = False
    else:
        _fall_back(m)
        found[row, P] *= 1.0 + _STEP
        if found[row, P] >= _P_MAX:
            found[row, P] = _P_MAX
            m.tune_successes = SUCCESSES


@kernel
def _tune_angle_down(m: Any, angle: float) -> None:
    row = row_of(m.tune_axis)
    if angle >= m.tune_target[TARGET_ANGLE] * (1.0 + 0.5 * m.AUTOTUNE_AGGR):
        m.tune_skips = True
        _fall_back(m)
        m.tune_found[row, ANGLE] *= 1.0 - _STEP
        if m.tune_found[row, ANGLE] <= _ANGLE_MIN:
            m.tune_found[row, ANGLE] = _ANGLE_MIN
            _fail(m, TUNE_ANGLE_FAILED)
    elif m.tune_skips:
        m.tune_skips = False
    else:
        _succeed(m)


@kernel
def _tune_angle_up(m: Any, angle: float, peak: float, trough: float) -> None:
    row, target = row_of(m.tune_axis), m.tune_target[TARGET_ANGLE]
    returns = angle > target and trough < -peak * m.AUTOTUNE_AGGR
    if angle > target * (1.0 + 0.5 * m.AUTOTUNE_AGGR) or returns:
        m.tune_skips = True
        _succeed(m)
    elif m.tune_skips:
        m.tune_skips = False
    else:
        _fall_back(m)
        m.tune_found[row, ANGLE] *= 1.0 + _STEP
        if m.tune_found[row, ANGLE] >= _ANGLE_MAX:
            m.tune_found[row, ANGLE] = _ANGLE_MAX
            m.tune_successes = SUCCESSES


@kernel
def change_gains(m: Any) -> None:
    """Changes the gains, or counts a success, by the measurements of the last twitch; a gain at its end may fail."""
    peak, trough, angle = m.tune_rates[PEAK], m.tune_rates[TROUGH], m.tune_angles[PEAK]
    if m.tune_kind == D_UP:
        _tune_d_up(m, peak, trough)
    elif m.tune_kind == D_DOWN:
        _tune_d_down(m, peak, trough)
    elif m.tune_kind == P_UP:
        _tune_p_up(m, peak, trough)
    elif m.tune_kind == ANGLE_DOWN:
        _tune_angle_down(m, angle)
    else:
        _tune_angle_up(m, angle, peak, trough)


@kernel
def ease_found(m: Any) -> None:
    """Keeps the gains of a finished kind of twitch within their limits; the gain of the angle is reduced at last."""
    row, found = row_of(m.tune_axis), m.tune_found
    if m.tune_kind == D_DOWN:
        d = _d_column(m)
        found[row, d] = max(_d_least(m), found[row, d])
    if m.tune_kind == D_DOWN or m.tune_kind == P_UP:
        found[row, P] = max(_P_MIN, found[row, P])
    elif m.tune_kind == ANGLE_UP:
        found[row, ANGLE] = max(_ANGLE_MIN, found[row, ANGLE] * _ANGLE_EASED)
        least = _ACCEL_MIN if row < 2 else _YAW_ACCEL_MIN
        found[row, ACCEL] = max(least, 100.0 * math.degrees(m.tune_accel))
