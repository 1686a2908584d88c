"""Motion along a curve from one place to the next, which passes both in given directions.

The curve is the cubic polynomial of a parameter, 0 to 1, with given places and derivatives at its ends (Hermite). The
speed along it rises and falls with half of the greatest acceleration, and half of it is left to corners; ahead of the
end, it falls to the speed that both curves permit there. A curve is a row float64[SPLINE] with the indices below; SI
units, axes north, east, up.

Source: ArduPilot, SplineCurve.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import clip, kinematic_limit

__all__ = ["AT", "DIRECTION", "FIRST_SPEED", "LAST_SPEED", "SPLINE", "follow_spline", "plan_spline"]

POLYNOMIAL, AT, FIRST_SPEED, LAST_SPEED, DIRECTION, PLACE = 0, 12, 13, 14, 15, 18
"""Coefficients of powers 0 to 3, each for three axes; parameter; speeds [m/s] that curvature permits at the ends;
derivative wanted at the end, and the end."""
SPLINE = 21
_LONGEST = 4.0  # of its chord: sum of the derivatives at the ends
_SHARE = 0.5  # of the acceleration, along the curve and across it
_NONE = 1e-9  # m

Limits = tuple[float, float, float, float, float]


@kernel
def _length(a: float, b: float, c: float) -> float:
    return math.sqrt(a * a + b * b + c * c)


@kernel
def plan_spline(row: Any, begin: Any, begin_direction: Any, end: Any, end_direction: Any, limits: Limits) -> None:
    """Plans a curve.

    As in ArduCopter, its speed at the end is at most that of the curve which was in the row before (0 at first), until
    the caller sets row[LAST_SPEED].

    Args:
        row: the curve.
        begin: place, float64[3], m.
        begin_direction: derivative there, float64[3], m; zero: from rest.
        end: place.
        end_direction: derivative there; zero: to rest.
        limits: speeds horizontally, up and down, accelerations horizontally and vertically.
    """
    chord = _length(end[0] - begin[0], end[1] - begin[1], end[2] - begin[2])
    first = _length(begin_direction[0], begin_direction[1], begin_direction[2])
    last = _length(end_direction[0], end_direction[1], end_direction[2])
    scale = 1.0
    if first + last > _LONGEST * chord:
        scale = _LONGEST * chord / (first + last)
    for i in range(3):
        p, q, v, w = begin[i], end[i], scale * begin_direction[i], scale * end_direction[i]
        row[POLYNOMIAL + i], row[POLYNOMIAL + 3 + i] = p, v
        row[POLYNOMIAL + 6 + i] = 3.0 * (q - p) - 2.0 * v - w
        row[POLYNOMIAL + 9 + i] = 2.0 * (p - q) + v + w
        row[DIRECTION + i], row[PLACE + i] = end_direction[i], q
    row[AT], row[FIRST_SPEED] = 0.0, 0.0
    if chord <= _NONE:
        row[AT], row[LAST_SPEED] = 1.0, 0.0
        for i in range(3):
            row[DIRECTION + i] = 0.0
        return
    row[FIRST_SPEED] = _at(row, 0.0, 0.0, limits)[1]
    row[LAST_SPEED] = _at(row, 1.0, 0.0, limits)[1] if last > 0.0 else 0.0


@kernel
def _derivatives(row: Any, x: float, i: int) -> tuple[float, float, float]:
    """Returns the first, second and third derivative of one axis."""
    b, c, d = row[POLYNOMIAL + 3 + i], row[POLYNOMIAL + 6 + i], row[POLYNOMIAL + 9 + i]
    return b + (2.0 * c + 3.0 * d * x) * x, 2.0 * c + 6.0 * d * x, 6.0 * d


@kernel
def _place(row: Any, x: float, i: int) -> float:
    """Returns the place on one axis."""
    b, c, d = row[POLYNOMIAL + 3 + i], row[POLYNOMIAL + 6 + i], row[POLYNOMIAL + 9 + i]
    return float(row[POLYNOMIAL + i] + (b + (c + d * x) * x) * x)


@kernel
def _at(row: Any, x: float, way: float, limits: Limits) -> tuple[float, float, float, tuple[float, float, float]]:
    """Returns the rise of the parameter over `way` [m], greatest speed and acceleration there, and the direction."""
    vn, an, jn = _derivatives(row, x, 0)
    ve, ae, je = _derivatives(row, x, 1)
    vu, au, ju = _derivatives(row, x, 2)
    pace, bend, twist = _length(vn, ve, vu), _length(an, ae, au), _length(jn, je, ju)
    if pace > _NONE:
        ahead, rise = (vn / pace, ve / pace, vu / pace), way / pace
    elif bend > _NONE:  # the direction of a curve from rest is that of its second derivative
        ahead, rise = (an / bend, ae / bend, au / bend), math.sqrt(2.0 * way / bend)
    else:
        ahead, rise = (jn / twist, je / twist, ju / twist), (6.0 * way / twist) ** (1.0 / 3.0)
    along = an * ahead[0] + ae * ahead[1] + au * ahead[2]
    cn, ce, cu = an - along * ahead[0], ae - along * ahead[1], au - along * ahead[2]
    across = _length(cn, ce, cu)
    speed = kinematic_limit(ahead[0], ahead[1], ahead[2], limits[0], limits[1], limits[2])
    accel = _SHARE * kinematic_limit(ahead[0], ahead[1], ahead[2], limits[3], limits[4], limits[4])
    if across > _NONE and pace > _NONE:
        corner = _SHARE * kinematic_limit(cn / across, ce / across, cu / across, limits[3], limits[4], limits[4])
        speed = min(speed, pace * math.sqrt(corner / across))
    dn, de, du = row[PLACE] - _place(row, x, 0), row[PLACE + 1] - _place(row, x, 1), row[PLACE + 2] - _place(row, x, 2)
    last = row[LAST_SPEED]
    return rise, min(speed, math.sqrt(2.0 * accel * _length(dn, de, du) + last * last)), accel, ahead


@kernel
def follow_spline(row: Any, target: Any, speed: float, dt: float, limits: Limits) -> bool:
    """Advances along the curve; returns whether its end has been reached.

    Args:
        row: the curve.
        target: float64[3, 3]; rows 0 and 1 become place and velocity, row 2 zero.
        speed: at present, m/s.
        dt: time, s.
        limits: as in `plan_spline`.
    """
    x = row[AT]
    for i in range(3):
        target[0, i] = _place(row, x, i)
        target[1, i], target[2, i] = 0.0, 0.0
    if _length(row[PLACE] - row[0], row[PLACE + 1] - row[1], row[PLACE + 2] - row[2]) <= _NONE:
        return True
    rise, most, accel, ahead = _at(row, x, speed * dt, limits)
    speed = clip(most, speed - accel * dt, speed + accel * dt)
    for i in range(3):
        target[1, i] = ahead[i] * speed
    row[AT] = min(x + rise, 1.0)
    return bool(row[AT] >= 1.0)
