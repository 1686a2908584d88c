"""Motion along a straight leg, within limits of speed, acceleration, jerk and snap.

The speed rises and falls by S-curves: jerk follows raised cosines of duration `tj`, is constant for `t2`, and the
acceleration is constant for `t4`. The second half of an acceleration mirrors the first. A leg is planned from rest to
rest, and its end mirrors its beginning; a speed at its beginning or end changes that half. A leg is a row
float64[LEG] with the indices below; SI units, directions north, east, up.

Source: ArduPilot, SCurve (the profile and its limits). The times are derived from the symmetry.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import kinematic_limit

__all__ = [
    "CLIMB_ACCEL",
    "CLOCK",
    "CONSTANT",
    "DURATION",
    "EARLY",
    "LEG",
    "LENGTH",
    "RISE",
    "SHARE",
    "SHARE_RATE",
    "SPEED",
    "along_leg",
    "begin_leg_at",
    "clear_leg",
    "end_leg_at",
    "plan_leg",
    "time_at",
    "top_speed",
]

NORTH, EAST, UP, LENGTH, JERK, TJ, T2, T4, RISE, CONSTANT, DURATION, CLOCK = range(12)
"""Unit direction, length, profile (greatest jerk, times), duration of the acceleration, of constant speed, of the leg;
time since its beginning."""
SPEED, CLIMB_ACCEL, SHARE, SHARE_RATE = range(12, 16)
"""Limits of the speed along the leg and of the vertical acceleration; share of the speed that is flown, and its rate
[m/s2]."""
BEGIN, END, FALL_JERK, FALL_TJ, FALL_T2, FALL_T4, FALL, MAX_SNAP, MAX_JERK, MAX_ACCEL = range(16, 26)
"""Speeds at the beginning and the end; profile and duration of the deceleration, in the order of those of the
acceleration; limits."""
OVER, FALL_END, FALL_SPEED = 26, 27, 28
"""Way of the profiles beyond the end of the leg, if they do not fit, and time and speed at which the deceleration
ends."""
EARLY = 29
"""Time before the end of the leg at which ArduCopter takes it for ended."""
LEG = 30
_REST = 1e-6  # m/s
_RESOLUTION = 4.0 * 2.0**-23  # of the length of a leg: some units in the last place of ArduCopter's 32-bit numbers


@kernel
def clear_leg(leg: Any) -> None:
    """Makes a leg of no length, which has ended."""
    for i in range(LEG):
        leg[i] = 0.0


@kernel
def _root_of_length(jerk: float, tj: float, length: float) -> float:
    """Returns the time tau of a rise of the acceleration with jerk * (tau - tj) * tau**2 = length."""
    tau = tj + (length / jerk) ** (1.0 / 3.0)  # beyond the root: Newton's steps fall to it
    for _ in range(40):
        step = (jerk * (tau - tj) * tau * tau - length) / (jerk * tau * (3.0 * tau - 2.0 * tj))
        tau -= step
        if abs(step) < 1e-12 * tau:
            break
    return float(tau)


@kernel
def profile(snap: float, jerk: float, accel: float, speed: float, half: float) -> tuple[float, float, float, float]:
    """Returns the greatest jerk, and tj, t2 and t4 [s], of an acceleration from rest within `half` of a leg [m]."""
    tj = jerk * math.pi / (2.0 * snap)
    if min(accel, speed / (2.0 * tj), half / (4.0 * tj * tj)) < jerk * tj:  # the jerk does not reach its limit
        tj = min(tj, (half * math.pi / (8.0 * snap)) ** 0.25)
        tj = min(tj, (speed * math.pi / (4.0 * snap)) ** (1.0 / 3.0))
        tj = min(tj, math.sqrt(accel * math.pi / (2.0 * snap)))
        jerk = 2.0 * snap * tj / math.pi
        accel = jerk * tj
        rise = 2.0 * tj
    else:
        rise = accel / jerk + tj
        if speed < accel * rise or half < accel * rise * rise:  # the acceleration does not reach its limit
            by_speed = 0.5 * (tj + math.sqrt(tj * tj + 4.0 * speed / jerk))
            rise = min(rise, min(by_speed, _root_of_length(jerk, tj, half)))
            accel = jerk * (rise - tj)
    t4 = min(speed / accel - rise, 0.5 * (math.sqrt(rise * rise + 8.0 * half / accel) - 3.0 * rise))
    return jerk, tj, max(rise - 2.0 * tj, 0.0), max(t4, 0.0)


@kernel
def _profile_from(
    snap: float, jerk: float, accel: float, begin: float, speed: float, half: float
) -> tuple[float, float, float, float]:
    """Returns the same from the speed `begin`; all are 0 if there is no room for an acceleration."""
    if begin <= 0.0:
        return profile(snap, jerk, accel, speed, half)
    change = speed - begin
    none = (0.0, 0.0, 0.0, 0.0)
    if change <= 0.0:
        return none
    tj = jerk * math.pi / (2.0 * snap)
    top = min(accel, change / (2.0 * tj), (half - 4.0 * begin * tj) / (4.0 * tj * tj))
    if top <= 0.0:
        return none
    if top < jerk * tj:  # small changes take as long, with less jerk
        jerk = top / tj
        rise = 2.0 * tj
    else:
        top = accel
        rise = top / jerk + tj
        if change < top * rise or half < (top * rise + 2.0 * begin) * rise:
            by_speed = 0.5 * (tj + math.sqrt(tj * tj + 4.0 * change / jerk))
            rise = min(rise, by_speed)
            for _ in range(60):  # jerk * (rise - tj) * rise**2 + 2 * begin * rise = half, by Newton from above
                over = (jerk * (rise - tj) * rise + 2.0 * begin) * rise - half
                if over <= 0.0:
                    break
                rise -= over / (jerk * rise * (3.0 * rise - 2.0 * tj) + 2.0 * begin)
            top = jerk * (rise - tj)
    if rise < 2.0 * tj * (1.0 - 1e-9) or (top * rise + 2.0 * begin) * rise > half * (1.0 + 1e-9):
        return none
    slope = 1.5 * top * rise + begin
    room = max(half - (top * rise + 2.0 * begin) * rise, 0.0)
    t4 = min(change / top - rise, (math.sqrt(slope * slope + 2.0 * top * room) - slope) / top)
    return jerk, tj, max(rise - 2.0 * tj, 0.0), max(t4, 0.0)


@kernel
def plan_leg(
    leg: Any,
    n: float,
    e: float,
    u: float,
    speeds: tuple[float, float, float],
    accels: tuple[float, float],
    jerk: float,
    snap: float,
) -> None:
    """Plans a leg by the vector (n, e, u).

    Args:
        leg: the row.
        n: way north.
        e: way east.
        u: way up.
        speeds: limits horizontally, up and down.
        accels: limits horizontally and vertically.
        jerk: limit.
        snap: limit of the rate of the jerk.
    """
    clear_leg(leg)
    length = math.sqrt(n * n + e * e + u * u)
    if length <= 0.0:
        return
    n, e, u = n / length, e / length, u / length
    speed = kinematic_limit(n, e, u, speeds[0], speeds[1], speeds[2])
    accel = kinematic_limit(n, e, u, accels[0], accels[1], accels[1])
    if speed <= 0.0 or accel <= 0.0:
        return
    leg[NORTH], leg[EAST], leg[UP], leg[LENGTH] = n, e, u, length
    leg[JERK], leg[TJ], leg[T2], leg[T4] = profile(snap, jerk, accel, speed, 0.5 * length)
    leg[SPEED], leg[CLIMB_ACCEL], leg[SHARE] = speed, accels[1], 1.0
    leg[MAX_SNAP], leg[MAX_JERK], leg[MAX_ACCEL] = snap, jerk, accel
    leg[RISE] = _span(leg, JERK)
    for i in range(JERK, RISE + 1):
        leg[FALL_JERK + i - JERK] = leg[i]
    reached = top_speed(leg)
    leg[CONSTANT] = max(length / reached - leg[RISE], 0.0)
    leg[DURATION] = 2.0 * leg[RISE] + leg[CONSTANT]
    leg[FALL_END] = leg[DURATION]
    leg[EARLY] = _unseen(leg)


@kernel
def _unseen(leg: Any) -> float:
    """Returns the time before the end, at rest, in which the rest of the way is below the resolution of 32 bits.

    Its jerk begins with pi**2 t**2 / (4 tj**2), of which the way is the third integral.
    """
    tj, way = leg[FALL_TJ], _RESOLUTION * leg[LENGTH]
    return float(min((240.0 * way * tj * tj / (math.pi * math.pi * leg[FALL_JERK])) ** 0.2, tj))


@kernel
def _span(leg: Any, at: int) -> float:
    """Returns the duration of the profile at the index `at`."""
    rise = 2.0 * leg[at + 1] + leg[at + 2]
    return float(2.0 * rise + leg[at + 3])


@kernel
def _change(leg: Any, at: int) -> float:
    """Returns the change of speed of the profile at the index `at`."""
    return float(leg[at] * (leg[at + 1] + leg[at + 2]) * (2.0 * leg[at + 1] + leg[at + 2] + leg[at + 3]))


@kernel
def top_speed(leg: Any) -> float:
    """Returns the greatest speed of the leg."""
    return float(leg[BEGIN] + _change(leg, JERK))


@kernel
def _cosine(jerk: float, tj: float, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way while the jerk rises as a raised cosine."""
    w = math.pi / tj
    half = 0.5 * jerk
    return (
        half * (t - math.sin(w * t) / w),
        half * (0.5 * t * t + (math.cos(w * t) - 1.0) / (w * w)),
        half * (t * t * t / 6.0 - t / (w * w) + math.sin(w * t) / (w * w * w)),
    )


@kernel
def _constant_jerk(jerk: float, tj: float, t: float) -> tuple[float, float, float]:
    """Returns the same while the jerk is constant; t [s] since the beginning of the leg."""
    a, v, s = _cosine(jerk, tj, tj)
    d = t - tj
    return a + jerk * d, v + a * d + 0.5 * jerk * d * d, s + v * d + 0.5 * a * d * d + jerk * d * d * d / 6.0


@kernel
def _first_half(leg: Any, at: int, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way in the first half of a profile, from rest."""
    jerk, tj, t2 = leg[at], leg[at + 1], leg[at + 2]
    if t < tj:
        return _cosine(jerk, tj, t)
    if t < tj + t2:
        return _constant_jerk(jerk, tj, t)
    rise = 2.0 * tj + t2
    top = jerk * (tj + t2)  # acceleration
    v_rise = 0.5 * top * rise
    _, _, s_begin = _constant_jerk(jerk, tj, tj + t2)
    _, _, s_last = _cosine(jerk, tj, tj)
    s_rise = s_begin + v_rise * tj - 0.5 * top * tj * tj + s_last
    if t < rise:  # the jerk falls as it rose
        left = rise - t
        a, v, s = _cosine(jerk, tj, left)
        return top - a, v_rise - top * left + v, s_rise - (v_rise * left - 0.5 * top * left * left + s)
    d = t - rise
    return top, v_rise + top * d, s_rise + v_rise * d + 0.5 * top * d * d


@kernel
def _rising(leg: Any, at: int, whole: float, begin: float, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way while the speed rises from `begin`, by a profile that lasts `whole`."""
    if t <= 0.5 * whole:
        a, v, s = _first_half(leg, at, t)
        return a, begin + v, begin * t + s
    left = whole - t
    a, v, s = _first_half(leg, at, left)
    top = _change(leg, at)
    return a, begin + (top - v), begin * t + (0.5 * top * whole - (top * left - s))


@kernel
def along_leg(leg: Any, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way along a leg at the time t [s] since its beginning."""
    if leg[DURATION] <= 0.0:
        return 0.0, 0.0, 0.0
    if t <= 0.0:
        return 0.0, float(leg[BEGIN]), 0.0
    if t >= leg[DURATION]:
        return 0.0, float(leg[END]), float(leg[LENGTH])
    if t < leg[RISE]:
        return _rising(leg, JERK, leg[RISE], leg[BEGIN], t)
    left = leg[FALL_END] - t
    if left < leg[FALL]:
        a, v, s = _rising(leg, FALL_JERK, leg[FALL], leg[FALL_SPEED], left)
        return -a, v, leg[LENGTH] + leg[OVER] - s
    top = top_speed(leg)
    return 0.0, top, 0.5 * (leg[BEGIN] + top) * leg[RISE] + top * (t - leg[RISE])


# ---- speeds at the ends ----------------------------------------------------------------------------------------------


@kernel
def _fit(leg: Any) -> None:
    """Sets the time at constant speed, and the duration, for the profiles of the leg."""
    top = top_speed(leg)
    leg[END] = leg[FALL_SPEED]
    way = 0.5 * (leg[BEGIN] + top) * leg[RISE] + 0.5 * (top + leg[END]) * leg[FALL]
    leg[CONSTANT] = max((leg[LENGTH] - way) / top, 0.0)
    leg[OVER] = max(way - leg[LENGTH], 0.0)
    leg[EARLY] = _unseen(leg) if leg[END] < _REST else 0.0
    leg[FALL_END] = leg[RISE] + leg[CONSTANT] + leg[FALL]
    leg[DURATION] = leg[FALL_END]
    if leg[OVER] > 0.0:
        leg[DURATION] = time_at(leg, leg[LENGTH])
        leg[END] = along_leg(leg, leg[DURATION] * (1.0 - 1e-12))[1]


@kernel
def time_at(leg: Any, way: float) -> float:
    """Returns the time since the beginning of a leg at which its way is `way` [m], by bisection."""
    low, high = 0.0, float(leg[DURATION])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if along_leg(leg, middle)[2] < way:
            low = middle
        else:
            high = middle
    return high


@kernel
def begin_leg_at(leg: Any, speed: float) -> float:
    """Makes a planned leg begin at `speed` [m/s], and end at rest; returns the speed, which is at most its greatest."""
    if leg[DURATION] <= 0.0:
        return 0.0
    limits = leg[MAX_SNAP], leg[MAX_JERK], leg[MAX_ACCEL]
    top, half = top_speed(leg), 0.5 * leg[LENGTH]
    speed = min(speed, top)
    if speed == leg[BEGIN]:
        return float(speed)
    leg[BEGIN] = speed
    leg[JERK], leg[TJ], leg[T2], leg[T4] = _profile_from(limits[0], limits[1], limits[2], speed, top, half)
    leg[RISE] = _span(leg, JERK)
    top = top_speed(leg)
    fall = profile(limits[0], limits[1], limits[2], top, half)
    leg[FALL_JERK], leg[FALL_TJ], leg[FALL_T2], leg[FALL_T4] = fall
    leg[FALL] = _span(leg, FALL_JERK)
    leg[FALL_SPEED] = max(top - _change(leg, FALL_JERK), 0.0)
    _fit(leg)
    return float(speed)


@kernel
def end_leg_at(leg: Any, speed: float) -> None:
    """Makes a planned leg end at `speed` [m/s], or at the speed that half of the leg permits."""
    if leg[DURATION] <= 0.0 or speed == leg[END]:
        return
    top, half = top_speed(leg), 0.5 * leg[LENGTH]
    fall = _profile_from(leg[MAX_SNAP], leg[MAX_JERK], leg[MAX_ACCEL], min(speed, top), top, half)
    leg[FALL_JERK], leg[FALL_TJ], leg[FALL_T2], leg[FALL_T4] = fall
    leg[FALL] = _span(leg, FALL_JERK)
    leg[FALL_SPEED] = max(top - _change(leg, FALL_JERK), 0.0)
    _fit(leg)
