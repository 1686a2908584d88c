"""Motion along a straight leg, from rest to rest, within limits of speed, acceleration, jerk and snap.

The speed rises and falls by S-curves: jerk follows raised cosines of duration `tj`, is constant for `t2`, and the
acceleration is constant for `t4`. Everything is symmetric: the second half of an acceleration mirrors the first, and
the end of the leg its beginning. A leg is a row float64[LEG] with the indices below; SI units, directions north, east,
up.

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
    "LEG",
    "LENGTH",
    "RISE",
    "SHARE",
    "SHARE_RATE",
    "SPEED",
    "along_leg",
    "clear_leg",
    "plan_leg",
    "top_speed",
]

NORTH, EAST, UP, LENGTH, JERK, TJ, T2, T4, RISE, CONSTANT, DURATION, CLOCK = range(12)
"""Unit direction, length, profile (greatest jerk, times), duration of the acceleration, of constant speed, of the leg;
time since its beginning."""
SPEED, CLIMB_ACCEL, SHARE, SHARE_RATE = range(12, 16)
"""Limits of the speed along the leg and of the vertical acceleration; share of the speed that is flown, and its rate
[m/s2]."""
LEG = 16


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
    rise = 2.0 * leg[TJ] + leg[T2]
    leg[RISE] = 2.0 * rise + leg[T4]
    reached = top_speed(leg)
    leg[CONSTANT] = max(length / reached - leg[RISE], 0.0)
    leg[DURATION] = 2.0 * leg[RISE] + leg[CONSTANT]


@kernel
def top_speed(leg: Any) -> float:
    """Returns the greatest speed of the leg."""
    return float(leg[JERK] * (leg[TJ] + leg[T2]) * (2.0 * leg[TJ] + leg[T2] + leg[T4]))


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
def _first_half(leg: Any, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way in the first half of the acceleration."""
    jerk, tj, t2 = leg[JERK], leg[TJ], leg[T2]
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
def _rising(leg: Any, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way while the speed rises."""
    whole = leg[RISE]
    if t <= 0.5 * whole:
        return _first_half(leg, t)
    left = whole - t
    a, v, s = _first_half(leg, left)
    top = top_speed(leg)
    return a, top - v, 0.5 * top * whole - (top * left - s)


@kernel
def along_leg(leg: Any, t: float) -> tuple[float, float, float]:
    """Returns acceleration, speed and way along a leg at the time t [s] since its beginning."""
    if t <= 0.0 or leg[DURATION] <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= leg[DURATION]:
        return 0.0, 0.0, float(leg[LENGTH])
    if t < leg[RISE]:
        return _rising(leg, t)
    left = leg[DURATION] - t
    if left < leg[RISE]:
        a, v, s = _rising(leg, left)
        return -a, v, leg[LENGTH] - s
    top = top_speed(leg)
    return 0.0, top, 0.5 * top * leg[RISE] + top * (t - leg[RISE])
