"""The flown path as points at least SRTL_ACCURACY apart, for SMART_RTL: recorded, simplified and without loops.

Points are recorded three times a second while armed, from the place of arming on. When 50 points are new, or space is
short, points within half of SRTL_ACCURACY of the line between their neighbours are removed (Ramer, Douglas, Peucker);
when space is short or the return begins, so are loops: parts of the path between two places less than 0.99 of
SRTL_ACCURACY apart. If a position is not known, or no point could be stored, for 15 s, SMART_RTL is given up for this
flight. Kernels over the autopilot's record `m`; points are north, east, up [m].

ArduCopter does this in the background, in slices of time; here each step is complete at once. Loops are removed one
after the other, the longest first, instead of from a list of loops without overlaps.

Source: ArduPilot, AP_SmartRTL.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.link.statustext import NO_NUMBER, SMART_RTL_FULL, SMART_RTL_LOST, WARNING, say

__all__ = ["clean_path", "forget_path", "keep_point", "record_path", "take_point"]

_PERIOD = 1.0 / 3.0  # s
_PATIENCE = 15.0  # s
_NEW_POINTS, _SPARE, _FEW = 50, 10, 10
_LOOP_SHARE = 0.99  # of SRTL_ACCURACY


@kernel
def forget_path(m: Any, t: float, known: bool) -> None:
    """Begins a path at the current position; `known`: whether that is known, without which there is none."""
    m.crumb_count = 0
    m.crumbs_simple = 0
    m.crumbs_checked = 0
    m.crumb_stored = t
    m.crumb_known = t
    m.crumb_next = t + _PERIOD
    m.crumbs_begun = m.crumbs_begun or known
    m.crumbs_on = bool(known and m.SRTL_POINTS > 0 and m.SRTL_ACCURACY > 0.0)
    if m.crumbs_on:
        keep_point(m, m.position_neu[0], m.position_neu[1], m.position_neu[2])


@kernel
def keep_point(m: Any, n: float, e: float, u: float) -> bool:
    """Adds a point if it is SRTL_ACCURACY from the last one; returns False if there is no space for it."""
    path, count = m.crumbs, int(m.crumb_count)
    if count > 0:
        dn, de, du = n - path[count - 1, 0], e - path[count - 1, 1], u - path[count - 1, 2]
        if dn * dn + de * de + du * du < m.SRTL_ACCURACY * m.SRTL_ACCURACY:
            return True
    if count >= min(int(m.SRTL_POINTS), path.shape[0]):
        return False
    path[count, 0], path[count, 1], path[count, 2] = n, e, u
    m.crumb_count = count + 1
    return True


@kernel
def take_point(m: Any) -> tuple[float, float, float]:
    """Removes the last point and returns it; the caller has made sure that there is one."""
    last = int(m.crumb_count) - 1
    m.crumb_count = last
    m.crumbs_simple = min(int(m.crumbs_simple), last)
    m.crumbs_checked = min(int(m.crumbs_checked), last)
    return m.crumbs[last, 0], m.crumbs[last, 1], m.crumbs[last, 2]


@kernel
def record_path(m: Any, known: bool, t: float) -> None:
    """Records the path, three times a second; `known`: whether the position is known."""
    if t < m.crumb_next - 1e-9:
        return
    m.crumb_next = t + _PERIOD
    if not known:
        if t - m.crumb_known > _PATIENCE:
            m.crumbs_on = False
            say(m, WARNING, SMART_RTL_LOST, NO_NUMBER)
        return
    m.crumb_known = t
    p = m.position_neu
    if keep_point(m, p[0], p[1], p[2]):
        m.crumb_stored = t
    elif t - m.crumb_stored > _PATIENCE:
        m.crumbs_on = False
        say(m, WARNING, SMART_RTL_FULL, NO_NUMBER)
        return
    new = m.crumb_count - m.crumbs_simple
    short = min(int(m.SRTL_POINTS), m.crumbs.shape[0]) - m.crumb_count <= _SPARE
    if new >= _NEW_POINTS or (short and new >= _FEW):
        _simplify(m)
    elif short:
        _remove_loops(m, _FEW)


@kernel
def clean_path(m: Any) -> None:
    """Removes all points that the return does not need."""
    if m.crumb_count != m.crumbs_simple:
        _simplify(m)
    _remove_loops(m, m.crumbs.shape[0])


# ---- simplification ------------------------------------------------------------------------------------------------


@kernel
def _off_segment(path: Any, i: int, begin: int, end: int) -> float:
    """Returns the distance [m] of point i from the segment between two others."""
    length = 0.0
    along = 0.0
    for k in range(3):
        d = path[end, k] - path[begin, k]
        length += d * d
        along += d * (path[i, k] - path[begin, k])
    share = clip(along / length, 0.0, 1.0) if length > 0.0 else 0.0
    total = 0.0
    for k in range(3):
        d = path[i, k] - (path[begin, k] + share * (path[end, k] - path[begin, k]))
        total += d * d
    return math.sqrt(total)


@kernel
def _simplify(m: Any) -> None:
    """Removes points near the line between their neighbours, from the last simplified point on."""
    path, kept, todo = m.crumbs, m.crumb_kept, m.crumb_todo
    count = int(m.crumb_count)
    first = max(int(m.crumbs_simple) - 1, 0)
    if count - first >= 3:
        for i in range(count):
            kept[i] = 1
        todo[0, 0], todo[0, 1] = first, count - 1
        waiting = 1
        while waiting > 0:
            waiting -= 1
            begin, end = int(todo[waiting, 0]), int(todo[waiting, 1])
            farthest, distance = begin, 0.0
            for i in range(begin + 1, end):
                off = _off_segment(path, i, begin, end)
                if off > distance:
                    farthest, distance = i, off
            if distance > 0.5 * m.SRTL_ACCURACY:
                todo[waiting, 0], todo[waiting, 1] = begin, farthest
                todo[waiting + 1, 0], todo[waiting + 1, 1] = farthest, end
                waiting += 2
            else:
                for i in range(begin + 1, end):
                    kept[i] = 0
        left = 0
        for i in range(count):
            if kept[i] != 0:
                for k in range(3):
                    path[left, k] = path[i, k]
                left += 1
        m.crumb_count = left
        m.crumbs_checked = min(int(m.crumbs_checked), first)
    m.crumbs_simple = m.crumb_count


# ---- loops ---------------------------------------------------------------------------------------------------------


@kernel
def _approach(path: Any, i: int, j: int, middle: Any) -> float:
    """Returns the distance [m] of segments (i, i + 1) and (j, j + 1), and sets the point in the middle between them.

    Parallel segments count as far apart; a neighbouring segment shows their loop.
    """
    a, b, c, d, e = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v, w = path[i + 1, k] - path[i, k], path[j + 1, k] - path[j, k], path[i, k] - path[j, k]
        a += u * u
        b += u * v
        c += v * v
        d += u * w
        e += v * w
    volume = a * c - b * b
    if volume <= 1e-9 * a * c:
        return math.inf
    s = clip((b * e - c * d) / volume, 0.0, 1.0)
    r = clip((a * e - b * d) / volume, 0.0, 1.0)
    total = 0.0
    for k in range(3):
        x = path[i, k] + s * (path[i + 1, k] - path[i, k])
        y = path[j, k] + r * (path[j + 1, k] - path[j, k])
        middle[k] = 0.5 * (x + y)
        total += (x - y) ** 2
    return math.sqrt(total)


@kernel
def _remove_loops(m: Any, enough: int) -> None:
    """Removes loops, the longest of each segment first, until `enough` points have been removed."""
    path, middle = m.crumbs, m.crumb_middle
    removed = 0
    i = int(m.crumb_count) - 2
    first = max(int(m.crumbs_checked) - 1, 2)
    while i >= first and removed < enough:
        for j in range(i - 1):
            if _approach(path, j, i, middle) < _LOOP_SHARE * m.SRTL_ACCURACY:
                for k in range(3):
                    path[j + 1, k] = middle[k]
                fewer = i - (j + 1)
                for at in range(j + 2, int(m.crumb_count) - fewer):
                    for k in range(3):
                        path[at, k] = path[at + fewer, k]
                m.crumb_count -= fewer
                removed += fewer
                i = min(j + 2, int(m.crumb_count) - 1)
                break
        i -= 1
    if removed < enough:
        m.crumbs_checked = m.crumb_count
    m.crumbs_simple = min(int(m.crumbs_simple), int(m.crumb_count))
