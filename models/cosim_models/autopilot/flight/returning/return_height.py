"""The height of RTL's way home: above home, or above the terrain. Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter mode_rtl (compute_return_target).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.position import stopping_ne
from cosim_models.autopilot.link.statustext import CRITICAL, NO_NUMBER, RTL_NO_RANGE, RTL_NO_TERRAIN, say
from cosim_models.autopilot.mission.fences import HIGHEST
from cosim_models.autopilot.mission.terrain import (
    BY_RANGE,
    NO_TERRAIN,
    measured_terrain,
    range_is_healthy,
    ranged_height,
    terrain_above_origin,
    terrain_source,
)

__all__ = ["return_height", "return_source", "whole_centimetres"]

_RTL_ALT_MIN = 0.3  # m
_RTL_CONE_MIN = 0.5
_FENCE_MARGIN = 2.0  # m by which RTL stays below the highest fence
_ABOVE_TERRAIN = 1  # RTL_ALT_TYPE
_EXACT = 1e-6  # share of a centimetre by which whole numbers may be too small


@kernel
def whole_centimetres(up: float) -> float:
    """Returns a height as ArduCopter keeps it: cut off to whole centimetres."""
    return float(0.01 * math.floor(100.0 * up + _EXACT))


@kernel
def return_source(m: Any) -> int:
    """Returns the source of the terrain above which RTL flies; NO_TERRAIN with RTL_ALT_TYPE 0, or if it is missing."""
    if m.RTL_ALT_TYPE != _ABOVE_TERRAIN or m.terrain_failsafe:
        return NO_TERRAIN
    source = terrain_source(m)
    if source == NO_TERRAIN:
        say(m, CRITICAL, RTL_NO_TERRAIN, NO_NUMBER)
    elif source == BY_RANGE and not range_is_healthy(m):
        say(m, CRITICAL, RTL_NO_RANGE, NO_NUMBER)
        return NO_TERRAIN
    return source


@kernel
def return_height(m: Any, n: float, e: float, height: float, source: int) -> float:
    """Returns the height [m above home, or above the terrain] of the return flight.

    Args:
        m: the record.
        n, e, height: the place of return and its own height above home [m].
        source: that of the terrain; NO_TERRAIN for a height above home.
    """
    now = whole_centimetres(m.position_neu[2]) - whole_centimetres(m.home_neu[2])
    highest = m.FENCE_ALT_MAX - _FENCE_MARGIN
    if source != NO_TERRAIN:
        now = ranged_height(m) if source == BY_RANGE else m.position_neu[2] - measured_terrain(m)[1]
        rise = terrain_above_origin(m, n, e) - m.home_neu[2]
        highest -= rise
        height = 0.0 if source == BY_RANGE else height - rise
    least = max(_RTL_ALT_MIN, now + max(0.01 * m.RTL_CLIMB_MIN, 0.0))
    wanted = max(height, 0.01 * m.RTL_ALT, least)
    if m.RTL_CONE_SLOPE >= _RTL_CONE_MIN:  # nearby, a full climb is unnecessary
        here_n, here_e = stopping_ne(m)
        distance = math.sqrt((here_n - n) ** 2 + (here_e - e) ** 2)
        wanted = min(wanted, max(distance * m.RTL_CONE_SLOPE, least))
    if m.FENCE_ENABLE != 0 and (m.FENCE_TYPE & HIGHEST) != 0:
        wanted = min(wanted, highest)
    return float(max(wanted, now))
