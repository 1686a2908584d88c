"""The gains of a tune: those before it, those of a twitch, those between twitches, and those that were found.

They are the parameters ATC_RAT_*, ATC_ANG_*_P and ATC_ACCEL_*_MAX themselves, by which the controllers fly and which
ground stations read. Kernels over the autopilot's record `m`.

Source: ArduPilot, AC_AutoTune_Multi.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.fields import get_real, set_real
from cosim.kernel import kernel
from cosim.model import record_layout
from cosim_models.autopilot.record.tuning import GAINS
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = [
    "ACCEL",
    "ANGLE",
    "BEFORE",
    "BETWEEN",
    "D",
    "ERROR_FILTER",
    "FOUND",
    "P",
    "PITCH",
    "ROLL",
    "TRIED",
    "YAW",
    "YAW_D",
    "integral_found",
    "is_tuned",
    "load_gains",
    "remember_gains",
    "row_of",
    "save_found",
]

ROLL, PITCH, YAW, YAW_D = range(4)
"""Axes, by the bits of AUTOTUNE_AXES: YAW tunes the filter of the error, YAW_D the derivative gain."""
P, INTEGRAL, D, FF, TARGET_FILTER, ERROR_FILTER, ANGLE, ACCEL = range(GAINS)
"""Columns of the gains of an axis."""
BEFORE, TRIED, BETWEEN, FOUND = range(4)
"""Sets of gains."""

_INTEGRAL_BETWEEN, _INTEGRAL_TRIED = 0.1, 0.01  # of P
_INTEGRAL_FOUND = np.array((1.0, 1.0, 0.1))
_ERROR_FILTER_MIN = 2.5  # Hz

_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_OFFSETS = np.array(
    [
        [_FIELDS[f"ATC_RAT_{axis}_{gain}"][1] for gain in ("P", "I", "D", "FF", "FLTT", "FLTE")]
        + [_FIELDS[f"ATC_ANG_{axis}_P"][1], _FIELDS[f"ATC_ACCEL_{axis[0]}_MAX"][1]]
        for axis in ("RLL", "PIT", "YAW")
    ],
    dtype=np.int64,
)


@kernel
def row_of(axis: int) -> int:
    """Returns the row of an axis in the tables of gains: both yaw axes have the same."""
    return min(axis, 2)


@kernel
def integral_found(row: int) -> float:
    """Returns the integral gain of a row per proportional gain, after a tune."""
    return float(_INTEGRAL_FOUND[row])


@kernel
def is_tuned(m: Any, axis: int) -> bool:
    """Returns whether AUTOTUNE_AXES contains an axis."""
    return bool((m.AUTOTUNE_AXES >> axis) & 1 != 0)


@kernel
def _set(m: Any, row: int, gain: int, value: float) -> None:
    set_real(m, _OFFSETS[row, gain], value)


@kernel
def remember_gains(m: Any) -> None:
    """Keeps the current gains as those before the tune, from which it starts."""
    for row in range(3):
        for gain in range(GAINS):
            value = get_real(m, _OFFSETS[row, gain])
            m.tune_before[row, gain] = value
            m.tune_found[row, gain] = value
    if is_tuned(m, YAW_D) and m.tune_found[2, D] == 0.0:
        m.tune_found[2, D] = m.AUTOTUNE_MIN_D
    if is_tuned(m, YAW) and m.tune_found[2, ERROR_FILTER] == 0.0:
        m.tune_found[2, ERROR_FILTER] = _ERROR_FILTER_MIN


@kernel
def _restore(m: Any, row: int, between: bool) -> None:
    """Sets the gains before the tune; `between` twitches, the integral is small and the acceleration stays."""
    for gain in range(GAINS):
        if gain != ACCEL or not between:
            _set(m, row, gain, m.tune_before[row, gain])
    if between:
        _set(m, row, INTEGRAL, m.tune_before[row, P] * _INTEGRAL_BETWEEN)


@kernel
def _try(m: Any) -> None:
    """Sets the gains of a twitch: no feed-forward, no filter of the target, nearly no integral."""
    row = row_of(m.tune_axis)
    found = m.tune_found
    _set(m, row, P, found[row, P])
    _set(m, row, INTEGRAL, found[row, P] * _INTEGRAL_TRIED)
    _set(m, row, D, 0.0 if m.tune_axis == YAW else found[row, D])
    if m.tune_axis == YAW:
        _set(m, row, ERROR_FILTER, found[row, ERROR_FILTER])
    _set(m, row, FF, 0.0)
    _set(m, row, TARGET_FILTER, 0.0)
    _set(m, row, ANGLE, found[row, ANGLE])


@kernel
def _may_change(m: Any, row: int) -> bool:
    """Returns whether AUTOTUNE_AXES contains an axis of a row."""
    return bool(is_tuned(m, row) or (row == 2 and is_tuned(m, YAW_D)))


@kernel
def _is_complete(m: Any, row: int) -> bool:
    """Returns whether gains have been found for a row, for one of the yaw axes at least."""
    done = m.tune_completed & m.AUTOTUNE_AXES
    bits = (1 << row) if row < 2 else (1 << YAW) | (1 << YAW_D)
    return bool(done & bits != 0 and m.tune_found[row, P] != 0.0)


@kernel
def _use_found(m: Any, row: int) -> None:
    found = m.tune_found
    _set(m, row, P, found[row, P])
    _set(m, row, INTEGRAL, found[row, P] * integral_found(row))
    if row < 2 or is_tuned(m, YAW_D):
        _set(m, row, D, found[row, D])
    if row == 2 and is_tuned(m, YAW):
        _set(m, row, ERROR_FILTER, found[row, ERROR_FILTER])
    _set(m, row, FF, m.tune_before[row, FF])
    _set(m, row, ANGLE, found[row, ANGLE])
    _set(m, row, ACCEL, found[row, ACCEL])


@kernel
def load_gains(m: Any, which: int) -> None:
    """Sets the parameters to a set of gains, unless it is loaded. Only axes in AUTOTUNE_AXES change."""
    if m.tune_gains == which:
        return
    m.tune_gains = which
    if which == TRIED:
        _try(m)
        return
    for row in range(3):
        if which == FOUND:
            if _is_complete(m, row):
                _use_found(m, row)
        elif _may_change(m, row) and (which == BETWEEN or m.tune_before[row, P] != 0.0):
            _restore(m, row, which == BETWEEN)


@kernel
def save_found(m: Any) -> None:
    """Makes the gains that were found those before the tune; all parameters of their axes will be reported."""
    for row in range(3):
        if not _is_complete(m, row):
            continue
        _use_found(m, row)
        _set(m, row, TARGET_FILTER, m.tune_before[row, TARGET_FILTER])
        for gain in range(GAINS):
            m.tune_before[row, gain] = get_real(m, _OFFSETS[row, gain])
        m.tune_unsent |= 511 << (9 * row)
