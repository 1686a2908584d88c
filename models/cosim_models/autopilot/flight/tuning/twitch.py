"""One twitch of AUTOTUNE: a step of the rate or of the angle, and the measurement of the response.

A rate of up to 180 deg/s (yaw: 90) is demanded of the rate controller alone, or an angle of a third to a half of
ANGLE_MAX (yaw: a sixth to the whole) of the angle controller without its limit of acceleration. Peak and bounce-back of
the filtered rate, or of the angle, are measured until the response is decided, or three times as long as it took to
63 % of the target. Kernels over the autopilot's record `m`.

Source: ArduPilot, AC_AutoTune and AC_AutoTune_Multi; AC_AttitudeControl for the largest step.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import euler_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import demand_rates, hold_target, step_target
from cosim_models.autopilot.control.shaping import clip, lowpass_alpha, wrap_pi
from cosim_models.autopilot.flight.tuning.gains import ANGLE, ERROR_FILTER, YAW, YAW_D, D, P, row_of
from cosim_models.autopilot.flight.tuning.rules import (
    ANGLE_DOWN,
    FAILED,
    P_UP,
    PEAK,
    TARGET_ANGLE,
    TARGET_RATE,
    TROUGH,
)
from cosim_models.autopilot.link.statustext import CRITICAL, NO_NUMBER, TUNE_SIZE_FAILED, say

__all__ = ["ABORTING", "JUDGING", "LEVELLING", "TWITCHING", "begin_twitch", "note_twitch", "run_twitch"]

LEVELLING, TWITCHING, JUDGING, ABORTING = range(4)
"""Steps of a tune: levelling, the twitch, the change of the gains, and what remains without one."""

_BEGIN_ANGLE, _BEGIN_RATE = 0, 1
_RATE_MOST, _RATE_LEAST = math.radians(180.0), math.radians(45.0)
_YAW_RATE_MOST, _YAW_RATE_LEAST = math.radians(90.0), math.radians(15.0)
_YAW_SHARE = 0.75  # of the largest step
_ANGLE_MOST, _ANGLE_LEAST = 1.0 / 2.0, 1.0 / 3.0  # of ANGLE_MAX
_YAW_ANGLE_MOST, _YAW_ANGLE_LEAST = 1.0, 1.0 / 6.0
_ABORT, _ABORT_BACKWARD = 2.5 / 3.0, 1.0 / 5.0
_YAW_FILTER = 10.0  # Hz
_TIME_MAX = 2.0  # s
_TIMES = 3.0  # the time to _RISEN, until a twitch ends
_RISEN = 0.6321
_BOUNCES = 0.25  # of the target that the peak must have for a bounce-back
_SCALE_STEP, _SCALE_MIN = 0.9, 0.2
_NEAR = 0.95


@kernel
def _largest_rate(m: Any, row: int, dt: float) -> float:
    """Returns the step of a rate [rad/s] for which the output is largest after four steps."""
    if row == 0:
        p, d, most = m.ATC_RAT_RLL_P, m.ATC_RAT_RLL_D, m.ATC_RATE_R_MAX
        error_filter, derivative_filter = m.ATC_RAT_RLL_FLTE, m.ATC_RAT_RLL_FLTD
    elif row == 1:
        p, d, most = m.ATC_RAT_PIT_P, m.ATC_RAT_PIT_D, m.ATC_RATE_P_MAX
        error_filter, derivative_filter = m.ATC_RAT_PIT_FLTE, m.ATC_RAT_PIT_FLTD
    else:
        p, d, most = m.ATC_RAT_YAW_P, m.ATC_RAT_YAW_D, m.ATC_RATE_Y_MAX
        error_filter, derivative_filter = m.ATC_RAT_YAW_FLTE, m.ATC_RAT_YAW_FLTD
    alpha = min(lowpass_alpha(dt, error_filter), lowpass_alpha(dt, derivative_filter))
    rest = 1.0 - alpha
    rate = 2.0 * clip(m.throttle_hover, 0.1, 0.5) / (rest * rest * rest * alpha * d / dt + p)
    return float(min(rate, math.radians(most)) if most > 0.0 else rate)


@kernel
def _angle_gain(m: Any, row: int) -> float:
    return float(m.ATC_ANG_RLL_P if row == 0 else m.ATC_ANG_PIT_P if row == 1 else m.ATC_ANG_YAW_P)


@kernel
def _turns(m: Any) -> bool:
    """Returns whether a yaw axis is being tuned."""
    return bool(m.tune_axis == YAW or m.tune_axis == YAW_D)


@kernel
def _by_angle(m: Any) -> bool:
    """Returns whether the twitch is a step of the angle."""
    return bool(m.tune_kind >= ANGLE_DOWN)


@kernel
def _lean_max(m: Any) -> float:
    return math.radians(0.01 * m.ANGLE_MAX)


@kernel
def begin_twitch(m: Any, dt: float) -> None:
    """Notes angle and rate of the axis, sets the targets, and empties the measurements."""
    row = row_of(m.tune_axis)
    angles = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    m.tune_begin[_BEGIN_ANGLE] = angles[0] if row == 0 else angles[1] if row == 1 else angles[2]
    m.tune_begin[_BEGIN_RATE] = m.gyro[row]
    rate = _largest_rate(m, row, dt)
    most = _lean_max(m)
    if _turns(m):
        rate *= _YAW_SHARE
        angle = clip(rate / _angle_gain(m, row), _YAW_ANGLE_LEAST * most, _YAW_ANGLE_MOST * most)
        rate = clip(rate, _YAW_RATE_LEAST, max(_YAW_RATE_LEAST, m.tune_scale * _YAW_RATE_MOST))
    else:
        angle = clip(rate / _angle_gain(m, row), _ANGLE_LEAST * most, _ANGLE_MOST * most)
        rate = clip(rate, _RATE_LEAST, max(_RATE_LEAST, m.tune_scale * _RATE_MOST))
    m.tune_target[TARGET_RATE], m.tune_target[TARGET_ANGLE] = rate, angle
    m.tune_rate = m.tune_begin[_BEGIN_RATE] if _by_angle(m) else 0.0
    for i in range(2):
        m.tune_rates[i] = 0.0
        m.tune_angles[i] = 0.0
    m.tune_stepped = False
    m.tune_accel_rate = 0.0
    m.tune_limit = _TIME_MAX


@kernel
def _demand(m: Any, row: int, sign: float, dt: float) -> None:
    """Demands the rate, or the angle and then its keeping."""
    size = sign * m.tune_target[TARGET_ANGLE if _by_angle(m) else TARGET_RATE]
    if not _by_angle(m):
        size += m.tune_begin[_BEGIN_RATE]
        demand_rates(m, size if row == 0 else 0.0, size if row == 1 else 0.0, size if row == 2 else 0.0)
    elif m.tune_stepped:
        hold_target(m, dt)
    else:
        m.tune_stepped = True
        step_target(m, size if row == 0 else 0.0, size if row == 1 else 0.0, size if row == 2 else 0.0, dt)


@kernel
def _note(measured: Any, value: float) -> None:
    """Takes a value beyond the peak as the peak, and as the least value after it."""
    if value > measured[PEAK]:
        measured[PEAK] = value
        measured[TROUGH] = value


@kernel
def _decided(m: Any, measured: Any, most: float, t: float) -> bool:
    """Returns whether a response towards `most` has ended: past it, bouncing back, or in time."""
    if measured[PEAK] < _RISEN * most:
        m.tune_limit = min(_TIMES * (t - m.tune_since), _TIME_MAX)
    bounces = measured[PEAK] - measured[TROUGH] > measured[PEAK] * m.AUTOTUNE_AGGR
    return bool(measured[PEAK] > most or bounces or t - m.tune_since >= m.tune_limit - 1e-9)


@kernel
def _measure_rate(m: Any, angle: float, t: float) -> None:
    """Measures peak and bounce-back of the rate; an angle that becomes too large ends the twitch."""
    rates, rate = m.tune_rates, m.tune_rate
    most = m.tune_target[TARGET_RATE] * (1.0 + (0.5 * m.AUTOTUNE_AGGR if m.tune_kind == P_UP else 0.0))
    if rate > rates[PEAK] or (rate < rates[TROUGH] and rates[PEAK] > _BOUNCES * most):
        rates[PEAK] = max(rates[PEAK], rate)
        rates[TROUGH] = rate
        m.tune_angles[TROUGH] = angle
    if _decided(m, rates, most, t):
        m.tune_step = JUDGING
    _measure_acceleration(m, rate, t)
    largest = _lean_max(m) * (_YAW_ANGLE_MOST if _turns(m) else _ANGLE_MOST)
    if angle < largest:
        return
    if rate != rates[TROUGH] and m.tune_angles[TROUGH] <= _NEAR * largest:
        m.tune_step = JUDGING
        return
    m.tune_step = ABORTING
    if m.tune_scale > _SCALE_MIN:
        m.tune_scale *= _SCALE_STEP
    else:
        say(m, CRITICAL, TUNE_SIZE_FAILED, NO_NUMBER)
        m.tune_stage = FAILED


@kernel
def _measure_angle(m: Any, angle: float, sign: float, t: float) -> None:
    """Measures peaks and bounce-back of angle and rate."""
    rates, rate, angles = m.tune_rates, m.tune_rate, m.tune_angles
    most = m.tune_target[TARGET_ANGLE] * (1.0 + 0.5 * m.AUTOTUNE_AGGR)
    _note(angles, angle)
    if angle < angles[TROUGH] and angles[PEAK] > _BOUNCES * most:
        angles[TROUGH] = angle
    _note(rates, rate)
    rates[TROUGH] = min(rates[TROUGH], rate)
    if _decided(m, angles, most, t):
        m.tune_step = JUDGING
    _measure_acceleration(m, rate - sign * m.tune_begin[_BEGIN_RATE], t)


@kernel
def _measure_acceleration(m: Any, rate: float, t: float) -> None:
    if rate > m.tune_accel_rate:
        m.tune_accel_rate = rate
        m.tune_accel = rate / (t - m.tune_since)


@kernel
def run_twitch(m: Any, t: float, dt: float) -> None:
    """Performs one step of the twitch: demands, measures, and sets m.tune_step at its end."""
    row = row_of(m.tune_axis)
    sign = 1.0 if m.tune_right else -1.0
    _demand(m, row, sign, dt)
    angles = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    angle = angles[0] if row == 0 else angles[1] if row == 1 else angles[2]
    angle = sign * wrap_pi(angle - m.tune_begin[_BEGIN_ANGLE])
    rate = sign * (m.gyro[row] - (0.0 if _by_angle(m) else m.tune_begin[_BEGIN_RATE]))
    cutoff = _YAW_FILTER
    if m.tune_axis != YAW:
        cutoff = 2.0 * (m.ATC_RAT_RLL_FLTD if row == 0 else m.ATC_RAT_PIT_FLTD if row == 1 else m.ATC_RAT_YAW_FLTD)
    m.tune_rate += lowpass_alpha(dt, cutoff) * (rate - m.tune_rate)
    m.tuning[0], m.tuning[1], m.tuning[2] = 1.0, angle, m.tune_rate
    if _by_angle(m):
        _measure_angle(m, angle, sign, t)
        upright = 1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2])
        if upright < math.cos(_ABORT * _lean_max(m)):
            m.tune_step = ABORTING
    else:
        _measure_rate(m, angle, t)
    if angle <= -_ABORT_BACKWARD * _lean_max(m):
        m.tune_step = ABORTING
    if _turns(m):
        m.tune_lean[2] = angles[2]


@kernel
def note_twitch(m: Any) -> None:
    """Notes what a log tells of a twitch, with the gains by which it was flown: the number of twitches first."""
    of, found = m.tuned, m.tune_found[row_of(m.tune_axis)]
    measured = m.tune_angles if _by_angle(m) else m.tune_rates
    of[0] += 1.0
    of[1], of[2] = float(m.tune_axis), float(m.tune_kind)
    of[3] = m.tune_target[TARGET_ANGLE if _by_angle(m) else TARGET_RATE]
    of[4], of[5] = measured[TROUGH], measured[PEAK]
    of[6], of[7], of[8] = found[P], found[ERROR_FILTER if m.tune_axis == YAW else D], found[ANGLE]
    of[9] = m.tune_accel
