"""AUTOTUNE of planes: gains of the rates of roll and pitch, found while a pilot flies as in FBWA.

A stick that is moved far and back makes an event. Each one tells the feed-forward, the deflection over the rate (the
median of five); after four of them, D grows by 30 % with each event until the deflection oscillates (its rate of change
is above SMAX), and is reduced to 30 % then; then P, and after three more events the axis is finished. The time constant
and the greatest rate move to those of AUTOTUNE_LEVEL. What is found at the end of the mode is kept if both have been
found or else forgotten. While it lasts, P and D count the less the more the deflection oscillates.

Kernels over a record with `AUTOTUNE_PARAMETERS` and `AUTOTUNE_MEMORY` beside those of `wing.attitude`; angles in rad,
deflections in rad of 45 degrees, as ArduPlane's gains have them.

Differences from ArduPlane: the yaw is not tuned (there YAW_RATE_ENABLE permits it), the speed does not scale, nothing
filters what is asked for, gains are not saved every ten seconds (older firmware).

Source: ArduPilot, AP_AutoTune.cpp, SlewLimiter.cpp, ArduPlane/Attitude.cpp and system.cpp (texts).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim import Memory, Parameter
from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_SEVERITY_ERROR, MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.record import whole
from cosim_models.autopilot.gcs.words import (
    NO_AXIS,
    TUNED_D,
    TUNED_P,
    TUNES,
    TUNING_DONE,
    TUNING_STARTS,
    TUNING_STOPS,
    say,
    say_figures,
)

__all__ = ["AUTOTUNE_MEMORY", "AUTOTUNE_PARAMETERS", "damping", "enable_tuning", "end_tuning", "start_tuning", "tuned"]

_TAU = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.3, 0.2, 0.15, 0.1, 0.1])  # s, by AUTOTUNE_LEVEL from 1
_RATE_MAX = np.array([20.0, 30.0, 40.0, 50.0, 60.0, 75.0, 90.0, 120.0, 160.0, 210.0, 300.0])  # degrees per second
_PITCH_SLOWER = 1.5
_ALL_AXES = 7
_FULL = 45.0  # degrees of deflection
_SLOW, _QUICK = 0.75, 4.0  # Hz, of the filters of rate and deflection, and of the rate that is asked for
_IDLE, _UP, _DOWN = 0, 1, -1  # state
_FIRST, _LAST = 0.4, 0.25  # of the greatest rate: an event begins; of that: it ends
_FAR = 0.3  # of the greatest angle, by which it must be wrong
_SHORTEST, _SETTLES, _AFTER_P, _QUIET = 0.1, 2.0, 2.5, 0.5  # s
_ENOUGH = 4  # events that tell the feed-forward
_FINISHED = 3  # events without a change
_FF_UP, _FF_DOWN = 1.12, 0.85
_MORE = 1.3
_WINDOW, _EVENTS = 0.3, 2  # s, and number of changes of direction that are an oscillation
_SLEW_CUT = 10.0  # Hz

(
    _STATE,
    _SINCE,
    _DEFLECTION,
    _RATE,
    _TARGET,
    _MOST_DEFLECTION,
    _LEAST_DEFLECTION,
    _MOST_RATE,
    _LEAST_RATE,
    _MOST_P,
    _MOST_D,
    _LEAST_SHARE,
    _MOST_SHARE,
    _SLEW_P,
    _SLEW_D,
    _COUNT,
    _LIMIT_D,
    _LIMIT_P,
    _D_AT,
    _P_AT,
    _DONE,
    _OLD,  # the first of seven gains before it began
) = range(22)
_FOUND = _OLD + 7  # the first of five feed-forwards
_COLUMNS = _FOUND + 5
_LAST_SAMPLE, _SLEW, _PEAK_UP, _UP_AT, _PEAK_DOWN, _DOWN_AT, _SWINGS, _SIDE = range(8)
_EVENT = 8  # the first of two times up, two down
_ROWS = _EVENT + 2 * _EVENTS

AUTOTUNE_PARAMETERS = (
    Parameter(
        "AUTOTUNE_LEVEL",
        type=int,
        start=6,
        minimum=0,
        maximum=11,
        tunable=True,
        description="how fast AUTOTUNE makes the plane, 1 to 11; 0: as RLL2SRV_* and PTCH2SRV_* say",
    ),
    whole("AUTOTUNE_AXES", _ALL_AXES, "axes that AUTOTUNE tunes: bit 0 roll, 1 pitch; 2 yaw, which is not tuned here"),
)
AUTOTUNE_MEMORY = (
    Memory("tuning", dtype="i4"),  # axes: bit 0 roll, 1 pitch
    Memory("tuning_told", dtype="?", rare=True),  # it has begun
    Memory("tuning_time", rare=True),  # s
    Memory("miss_before", shape=2, rare=True),  # rad/s, errors of the rates
    Memory("miss_slope", shape=2, rare=True),  # rad/s2, filtered
    Memory("tune", shape=(2, _COLUMNS), rare=True),
    Memory("slews", shape=(2, 3, _ROWS), rare=True),  # of P and D together, of P, of D
)


# ---- gains of an axis: 0 roll, 1 pitch -----------------------------------------------------------------------------


@kernel
def _gains(m: Any, axis: int) -> tuple[float, float, float, float]:
    """Returns feed-forward, P, I and D."""
    if axis == 0:
        return float(m.RLL_RATE_FF), float(m.RLL_RATE_P), float(m.RLL_RATE_I), float(m.RLL_RATE_D)
    return float(m.PTCH_RATE_FF), float(m.PTCH_RATE_P), float(m.PTCH_RATE_I), float(m.PTCH_RATE_D)


@kernel
def _set_gains(m: Any, axis: int, ff: float, p: float, i: float, d: float) -> None:
    if axis == 0:
        m.RLL_RATE_FF, m.RLL_RATE_P, m.RLL_RATE_I, m.RLL_RATE_D = ff, p, i, d
    else:
        m.PTCH_RATE_FF, m.PTCH_RATE_P, m.PTCH_RATE_I, m.PTCH_RATE_D = ff, p, i, d


@kernel
def _shape(m: Any, axis: int) -> tuple[float, float, float]:
    """Returns time constant [s], greatest rate [degrees per second] and limit of the integral."""
    if axis == 0:
        return float(m.RLL2SRV_TCONST), float(m.RLL2SRV_RMAX), float(m.RLL_RATE_IMAX)
    return float(m.PTCH2SRV_TCONST), float(m.PTCH2SRV_RMAX_UP), float(m.PTCH_RATE_IMAX)


@kernel
def _set_shape(m: Any, axis: int, tau: float, most: float, limit: float) -> None:
    if axis == 0:
        m.RLL2SRV_TCONST, m.RLL2SRV_RMAX, m.RLL_RATE_IMAX = tau, most, limit
    else:
        m.PTCH2SRV_TCONST, m.PTCH2SRV_RMAX_UP, m.PTCH_RATE_IMAX = tau, most, limit


@kernel
def _slew_limit(m: Any, axis: int) -> float:
    """Returns SMAX, degrees per second."""
    return float(m.RLL_RATE_SMAX if axis == 0 else m.PTCH_RATE_SMAX)


@kernel
def _approach(m: Any, axis: int) -> None:
    """Moves time constant and greatest rate a little towards those of AUTOTUNE_LEVEL."""
    ff, _, i, _ = _gains(m, axis)
    tau, most, limit = _shape(m, axis)
    goal_tau, goal_most = min(max(tau, 0.1), 2.0), min(max(most, 20.0), 720.0)
    if m.AUTOTUNE_LEVEL > 0:
        goal_tau = float(_TAU[m.AUTOTUNE_LEVEL - 1]) * (_PITCH_SLOWER if axis == 1 else 1.0)
        goal_most = float(_RATE_MAX[m.AUTOTUNE_LEVEL - 1])
        if ff > 0.0:
            goal_tau = max(goal_tau, 1.0 / (1.0 / goal_tau + i / ff))
    if most == 0.0:
        most = 75.0
    most = min(max(goal_most, most - 20.0), most + 20.0)
    if axis == 1 and (m.AUTOTUNE_LEVEL != 0 or m.PTCH2SRV_RMAX_DN == 0.0):
        m.PTCH2SRV_RMAX_DN = most
    _set_shape(m, axis, min(max(goal_tau, 0.85 * tau), 1.15 * tau), most, limit)


# ---- oscillation ---------------------------------------------------------------------------------------------------


@kernel
def _slew_share(m: Any, axis: int, row: int, sample: float, h: float) -> float:
    """Follows how fast a deflection [degrees] changes; returns the share of P and D that its oscillation leaves.

    It oscillates while the change has gone beyond SMAX twice each way, all within three windows.
    """
    s = m.slews[axis, row]
    t, most = float(m.tuning_time), _slew_limit(m, axis)
    decay = min(h, 1.0)  # of a second
    s[_SLEW] += h / (h + 0.5 / (math.pi * _SLEW_CUT)) * ((sample - s[_LAST_SAMPLE]) / h - s[_SLEW])
    s[_LAST_SAMPLE] = sample
    for side in range(2):
        slew = float(s[_SLEW]) if side == 0 else -float(s[_SLEW])
        if slew > most and s[_SIDE] != side + 1:
            s[_SIDE] = side + 1
            first = _EVENT + side * _EVENTS
            s[first + 1] = s[first]
            s[first] = t
        peak = _PEAK_UP + 2 * side
        if slew > s[peak]:
            s[peak] = min(slew, 10.0 * most)
            s[peak + 1] = t
        elif t - s[peak + 1] > _WINDOW:
            s[peak] *= 1.0 - decay
    oldest = t
    for k in range(2 * _EVENTS):
        oldest = min(oldest, float(s[_EVENT + k]))
    swings = 0.5 * float(s[_PEAK_UP] + s[_PEAK_DOWN])
    late = t - oldest - (_EVENTS + 1) * _WINDOW
    if late > 0.0:
        swings *= math.exp(-late)
    s[_SWINGS] = min(s[_SWINGS] + min(2.0 * decay, 1.0) * (swings - s[_SWINGS]), swings)
    return float(most / s[_SWINGS]) if s[_SWINGS] > most else 1.0


@kernel
def damping(m: Any, axis: int, miss: float, gain: float, h: float) -> float:
    """Returns the part of D for an error of the rate [rad/s]."""
    cut = m.RLL_RATE_FLTD if axis == 0 else m.PTCH_RATE_FLTD
    share = h / (h + 0.5 / (math.pi * cut)) if cut > 0.0 else 1.0
    m.miss_slope[axis] += share * ((miss - m.miss_before[axis]) / h - m.miss_slope[axis])
    m.miss_before[axis] = miss
    return float(gain * m.miss_slope[axis])


# ---- events --------------------------------------------------------------------------------------------------------


@kernel
def _begin_state(m: Any, axis: int, state: int) -> None:
    a = m.tune[axis]
    a[_LEAST_SHARE], a[_MOST_SHARE] = 1.0, 0.0
    a[_SLEW_P], a[_SLEW_D] = 1.0, 1.0
    a[_MOST_P], a[_MOST_D] = 0.0, 0.0
    a[_STATE], a[_SINCE] = state, m.tuning_time


@kernel
def _median(m: Any, axis: int, found: float) -> float:
    """Returns the median of a feed-forward and those of the four events before it."""
    a = m.tune[axis]
    for k in range(4, 0, -1):
        a[_FOUND + k] = a[_FOUND + k - 1]
    a[_FOUND] = found
    count = min(int(a[_COUNT]) + 1, 5)
    for k in range(count):
        below, same = 0, 0
        for j in range(count):
            below += 1 if a[_FOUND + j] < a[_FOUND + k] else 0
            same += 1 if a[_FOUND + j] == a[_FOUND + k] else 0
        if below <= count // 2 < below + same:
            return float(a[_FOUND + k])
    return found


@kernel
def _say_gain(m: Any, text: int, axis: int, gain: float) -> None:
    say_figures(m, MAV_SEVERITY_ERROR, text + axis, (gain, 0.0, 0.0, 0.0))


@kernel
def _adapt(m: Any, axis: int, ff: float) -> None:
    """Changes the gains after an event that tells a feed-forward."""
    a = m.tune[axis]
    t = float(m.tuning_time)
    old, p, _, d = _gains(m, axis)
    ff = min(max(ff, _FF_DOWN * old), _FF_UP * old)
    count = int(a[_COUNT])
    if count == 1:
        p, d = max(p, 0.01), max(d, 0.0005)
    elif count == _ENOUGH:
        p *= 0.5
    if a[_LEAST_SHARE] < 1.0 and a[_LIMIT_D] == 0.0:
        if a[_MOST_P] > 0.5 * a[_MOST_D]:
            p, d = 0.35 * p, 0.75 * d
        else:
            d *= 0.3
            a[_LIMIT_D], a[_D_AT] = d, t
            _say_gain(m, TUNED_D, axis, d)
    elif a[_LEAST_SHARE] < 1.0:
        if t - a[_D_AT] > _SETTLES:
            if a[_MOST_D] > 0.8 * a[_MOST_P]:
                d *= 0.35
                a[_LIMIT_D], a[_D_AT], a[_DONE] = d, t, 0.0
                _say_gain(m, TUNED_D, axis, d)
            elif t - a[_P_AT] > _AFTER_P:
                p *= 0.7 if a[_LIMIT_P] > 0.0 else 0.35
                a[_LIMIT_P], a[_P_AT], a[_DONE] = p, t, 0.0
                _say_gain(m, TUNED_P, axis, p)
    elif count < _ENOUGH:
        pass
    elif a[_LIMIT_D] == 0.0:
        d *= _MORE
    elif a[_LIMIT_P] == 0.0:
        p *= _MORE
    elif a[_DONE] < _FINISHED:
        a[_DONE] += 1.0
        if a[_DONE] == _FINISHED:
            say(m, MAV_SEVERITY_ERROR, TUNING_DONE + axis, 0)
    _set_gains(m, axis, ff, p, min(p, ff) if axis == 0 else max(0.75 * p, ff), d)
    _approach(m, axis)


@kernel
def _watch_idle(m: Any, axis: int) -> None:
    """Lowers P and D that oscillate without an event."""
    a = m.tune[axis]
    if not (m.tuning_time - a[_SINCE] > _QUIET and a[_MOST_SHARE] < 0.9):
        return
    ff, p, i, d = _gains(m, axis)
    both = float(a[_SLEW_P] + a[_SLEW_D])
    p *= 1.0 - 0.5 * float(a[_SLEW_P]) / both
    d *= 1.0 - 0.5 * float(a[_SLEW_D]) / both
    _set_gains(m, axis, ff, p, i, d)
    a[_LIMIT_P], a[_LIMIT_D] = min(a[_LIMIT_P], p), min(a[_LIMIT_D], d)
    _begin_state(m, axis, _IDLE)


@kernel
def _follow(m: Any, axis: int, error: float) -> None:
    """Finds events by the rate that is asked for and the error of the angle [degrees], and makes use of them."""
    a = m.tune[axis]
    tau, most, _ = _shape(m, axis)
    angle = float(m.ROLL_LIMIT_DEG if axis == 0 else min(m.PTCH_LIM_MAX_DEG, -m.PTCH_LIM_MIN_DEG))
    first = _FIRST * min(angle / tau, most)
    state, asked = int(a[_STATE]), float(a[_TARGET])
    if state == _IDLE:
        if abs(asked) <= first or abs(error) < _FAR * angle:
            _watch_idle(m, axis)
            return
        a[_MOST_DEFLECTION], a[_LEAST_DEFLECTION], a[_MOST_RATE], a[_LEAST_RATE] = 0.0, 0.0, 0.0, 0.0
        a[_STATE], a[_SINCE] = (_UP if asked > 0.0 else _DOWN), m.tuning_time
        return
    if state * asked >= _LAST * first:
        return
    rate = float(a[_MOST_RATE]) if state == _UP else -float(a[_LEAST_RATE])
    deflection = float(a[_MOST_DEFLECTION]) if state == _UP else -float(a[_LEAST_DEFLECTION])
    if rate >= 0.01 * most and rate > 0.0 and m.tuning_time - a[_SINCE] >= _SHORTEST:
        ff = _median(m, axis, deflection / rate)
        a[_COUNT] += 1.0
        _adapt(m, axis, ff)
    _begin_state(m, axis, _IDLE)


@kernel
def tuned(m: Any, axis: int, desired: float, actual: float, error: float, trim: float, h: float) -> float:
    """Returns the deflection [rad] for a rate [rad/s], and follows what it does.

    Args:
        desired, actual: the rate that is asked for, and the one that it has.
        error: of the angle [rad].
        trim: the part of the integral.
    """
    ff, gain, _, gain_d = _gains(m, axis)
    miss = desired - actual
    p, d = gain * miss, damping(m, axis, miss, gain_d, h)
    share = _slew_share(m, axis, 0, _FULL * (p + d), h)
    _slew_share(m, axis, 1, _FULL * p, h)
    _slew_share(m, axis, 2, _FULL * d, h)
    p, d = share * p, share * d
    out = ff * desired + p + d + trim
    speed = math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2)
    if speed <= m.AIRSPEED_MIN:
        return out
    a = m.tune[axis]
    slow, quick = h / (h + 0.5 / (math.pi * _SLOW)), h / (h + 0.5 / (math.pi * _QUICK))
    deflection = min(max(math.degrees(out), -_FULL), _FULL) - math.degrees(trim)
    a[_DEFLECTION] += slow * (deflection - a[_DEFLECTION])
    a[_RATE] += slow * (math.degrees(actual) - a[_RATE])
    a[_TARGET] += quick * (math.degrees(desired) - a[_TARGET])
    a[_MOST_DEFLECTION] = max(a[_MOST_DEFLECTION], a[_DEFLECTION])
    a[_LEAST_DEFLECTION] = min(a[_LEAST_DEFLECTION], a[_DEFLECTION])
    a[_MOST_RATE], a[_LEAST_RATE] = max(a[_MOST_RATE], a[_RATE]), min(a[_LEAST_RATE], a[_RATE])
    a[_MOST_P], a[_MOST_D] = max(a[_MOST_P], abs(p)), max(a[_MOST_D], abs(d))
    a[_LEAST_SHARE], a[_MOST_SHARE] = min(a[_LEAST_SHARE], share), max(a[_MOST_SHARE], share)
    a[_SLEW_P] = max(a[_SLEW_P], m.slews[axis, 1, _SWINGS])
    a[_SLEW_D] = max(a[_SLEW_D], m.slews[axis, 2, _SWINGS])
    _follow(m, axis, math.degrees(error))
    return out


# ---- the mode ------------------------------------------------------------------------------------------------------


@kernel
def _keep(m: Any, axis: int) -> None:
    """Notes the gains with which it begins."""
    ff, p, i, d = _gains(m, axis)
    tau, most, limit = _shape(m, axis)
    old = (ff, p, i, d, tau, most, limit)
    for k in range(7):
        m.tune[axis, _OLD + k] = old[k]


@kernel
def _begin_axis(m: Any, axis: int) -> None:
    for k in range(_COLUMNS):
        m.tune[axis, k] = 0.0
    for row in range(3):
        for k in range(_ROWS):
            m.slews[axis, row, k] = -1e3 if k >= _EVENT else 0.0
    _keep(m, axis)
    _begin_state(m, axis, _IDLE)
    _approach(m, axis)
    tau, most, limit = _shape(m, axis)
    _set_shape(m, axis, tau, most, min(max(limit, 0.4), 0.9))
    ff, p, i, d = _gains(m, axis)
    _set_gains(m, axis, max(ff, 0.01), p, i, d)
    if axis == 0 and m.RLL_RATE_SMAX <= 0.0:
        m.RLL_RATE_SMAX = 150.0
    if axis == 1 and m.PTCH_RATE_SMAX <= 0.0:
        m.PTCH_RATE_SMAX = 150.0


@kernel
def start_tuning(m: Any) -> None:
    """Begins to tune the axes of AUTOTUNE_AXES."""
    axes = m.AUTOTUNE_AXES & _ALL_AXES
    if axes == 0:
        say(m, MAV_SEVERITY_INFO, NO_AXIS, 0)
        return
    say(m, MAV_SEVERITY_INFO, TUNING_STARTS, 0)
    say(m, MAV_SEVERITY_INFO, TUNES + axes - 1, 0)
    m.tuning_told = True
    m.tuning = axes & 3
    m.tuning_time = 0.0
    for axis in range(2):
        if m.tuning & (1 << axis) != 0:
            _begin_axis(m, axis)


@kernel
def end_tuning(m: Any) -> None:
    """Ends it; gains of an axis of which D and P have not been found are those of before."""
    for axis in range(2):
        a = m.tune[axis]
        if m.tuning & (1 << axis) != 0 and not (a[_LIMIT_D] > 0.0 and a[_LIMIT_P] > 0.0):
            _set_gains(m, axis, float(a[_OLD]), float(a[_OLD + 1]), float(a[_OLD + 2]), float(a[_OLD + 3]))
            _set_shape(m, axis, float(a[_OLD + 4]), float(a[_OLD + 5]), float(a[_OLD + 6]))
            if axis == 1:
                m.PTCH2SRV_RMAX_DN = a[_OLD + 5]
    m.tuning = 0
    if m.tuning_told:
        m.tuning_told = False
        say(m, MAV_SEVERITY_INFO, TUNING_STOPS, 0)


@kernel
def enable_tuning(m: Any, enabled: float) -> int:
    """Handles DO_AUTOTUNE_ENABLE, for modes that fly by themselves, too; returns a MAV_RESULT."""
    if enabled != 0.0:
        start_tuning(m)
    else:
        end_tuning(m)
    return MAV_RESULT_ACCEPTED
