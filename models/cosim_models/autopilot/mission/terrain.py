"""The height of the terrain: a grid of points with bilinear interpolation between them, or a plane; and a rangefinder.

Heights are relative to the altitude of the local origin. The edge of the grid goes on outside of it. When the vehicle
is armed, the grid is raised or lowered to its place, by TERRAIN_OFS_MAX at most. The rangefinder (RNGFND1_TYPE 100, as
that of ArduPilot's SITL) looks down from the vehicle at the grid, raised to the place where the run began, 20 times a
second. Kernels over the autopilot's record `m`.

Source: ArduPilot, AP_Terrain (bilinear interpolation of a grid of heights), AP_SurfaceDistance and AC_WPNav
(get_terrain_offset_cm).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel

__all__ = [
    "BY_GRID",
    "BY_RANGE",
    "NO_TERRAIN",
    "TERRAIN_POINTS",
    "height_above_ground",
    "look_down",
    "measured_terrain",
    "range_is_healthy",
    "ranged_distance",
    "ranged_height",
    "refer_terrain",
    "start_ranging",
    "terrain_above_origin",
    "terrain_source",
]

TERRAIN_POINTS = 16
"""Points of the grid in each direction."""

NO_TERRAIN, BY_RANGE, BY_GRID = 0, 1, 2
"""Sources of the terrain's height below the vehicle."""

_SIMULATED = 100  # RNGFND1_TYPE
_PERIOD = 0.05  # s between two measurements
_STALE = 1.0  # s after the last good measurement
_GOOD, _MOST = 3, 10  # good measurements in a row, of which that many count
_GLITCH = 2.0  # m
_LEAST_UPRIGHT, _TILTED = 0.01, 0.707  # cosines of the lean


@kernel
def _grid_height(m: Any, north: float, east: float) -> float:
    """Returns the height of the grid above the local origin [m] at a place [m]."""
    last = float(TERRAIN_POINTS - 1)
    x = min(max((north - m.terrain_origin[0]) / m.terrain_spacing, 0.0), last)
    y = min(max((east - m.terrain_origin[1]) / m.terrain_spacing, 0.0), last)
    i, j = int(min(math.floor(x), last - 1.0)), int(min(math.floor(y), last - 1.0))
    x, y = x - i, y - j
    a, b = m.terrain[i * TERRAIN_POINTS + j], m.terrain[i * TERRAIN_POINTS + j + 1]
    c, d = m.terrain[(i + 1) * TERRAIN_POINTS + j], m.terrain[(i + 1) * TERRAIN_POINTS + j + 1]
    return float((1.0 - x) * ((1.0 - y) * a + y * b) + x * ((1.0 - y) * c + y * d))


@kernel
def terrain_above_origin(m: Any, north: float, east: float) -> float:
    """Returns the height of the terrain above the local origin [m] at a place [m], as the autopilot knows it."""
    if m.terrain_spacing <= 0.0:
        return 0.0
    return float(_grid_height(m, north, east) + m.terrain_reference)


@kernel
def refer_terrain(m: Any) -> None:
    """Raises or lowers the known terrain to the vehicle's place, once; by TERRAIN_OFS_MAX at most."""
    if m.terrain_spacing > 0.0 and not m.terrain_referred and m.TERRAIN_ENABLE != 0:
        p, most = m.position_neu, m.TERRAIN_OFS_MAX
        m.terrain_reference = min(max(p[2] - _grid_height(m, p[0], p[1]), -most), most)
        m.terrain_referred = True


# ---- rangefinder ---------------------------------------------------------------------------------------------------


@kernel
def start_ranging(m: Any) -> None:
    """Prepares the rangefinder, if there is one."""
    m.ranging = m.RNGFND1_TYPE == _SIMULATED
    if m.ranging:
        p = m.position_neu
        m.ground_reference = p[2]
        if m.terrain_spacing > 0.0:
            m.ground_reference = p[2] - _grid_height(m, p[0], p[1])
        m.range_good_at = -_STALE


@kernel
def range_is_healthy(m: Any) -> bool:
    """Returns whether the last measurements of the rangefinder were within its range."""
    return bool(m.ranging and m.range_count >= _GOOD)


@kernel
def ranged_distance(m: Any) -> float:
    """Returns the distance to the ground below the vehicle's body [m], not less than 0."""
    p = m.position_neu
    ground = m.ground_reference
    if m.terrain_spacing > 0.0:
        ground += _grid_height(m, p[0], p[1])
    upright = 1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2])
    return float(max(p[2] - ground, 0.0) / max(upright, _LEAST_UPRIGHT))


@kernel
def ranged_height(m: Any) -> float:
    """Returns the height above the ground [m] by the filtered measurements of the rangefinder."""
    return float(m.range_filtered + m.position_neu[2] - m.range_from)


@kernel
def _measure(m: Any, t: float) -> None:
    """Takes a measurement. Three in a row that jump by 2 m are believed."""
    p = m.position_neu
    distance = ranged_distance(m)
    upright = 1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2])
    good = m.RNGFND1_MIN <= distance <= m.RNGFND1_MAX
    m.range_count = min(m.range_count + 1, _MOST) if good else 0
    height = max(upright, _TILTED) * distance
    jump = height - m.range_height
    if jump >= _GLITCH:
        m.range_jumps = max(m.range_jumps + 1, 1)
    elif jump <= -_GLITCH:
        m.range_jumps = min(m.range_jumps - 1, -1)
    else:
        m.range_jumps = 0
        m.range_height = height
    begins = abs(m.range_jumps) >= _GOOD
    if begins:
        m.range_jumps = 0
        m.range_height = height
        m.range_cleared += 1
    if m.range_count >= _GOOD:
        if t - m.range_good_at > _STALE:
            m.range_filtered = height
            begins = True
        elif m.RNGFND_FILT > 0.0:
            share = _PERIOD / (_PERIOD + 1.0 / (2.0 * math.pi * m.RNGFND_FILT))
            m.range_filtered += share * (height - m.range_filtered)
        else:
            m.range_filtered = height
        m.range_good_at = t
    m.range_from = p[2]
    if begins:
        m.range_terrain = p[2] - height


@kernel
def look_down(m: Any, t: float, dt: float) -> None:
    """Performs one step of the rangefinder: a measurement when due, and the filtered height of the terrain."""
    if t >= m.range_due - 1e-9:
        m.range_due = t + _PERIOD
        _measure(m, t)
    m.range_terrain += (m.range_from - m.range_height - m.range_terrain) * (dt / max(m.SURFTRAK_TC, dt))
    if m.range_count >= _GOOD:
        m.range_trusted = True
    elif t - m.range_good_at > _STALE:
        m.range_trusted = False


# ---- below the vehicle ---------------------------------------------------------------------------------------------


@kernel
def terrain_source(m: Any) -> int:
    """Returns which source gives the terrain's height below the vehicle."""
    if m.ranging and m.WPNAV_RFND_USE != 0:
        return BY_RANGE
    return BY_GRID if m.TERRAIN_ENABLE != 0 else NO_TERRAIN


@kernel
def measured_terrain(m: Any) -> tuple[bool, float]:
    """Returns whether the terrain's height below the vehicle is known, and that height above the local origin [m]."""
    source = terrain_source(m)
    if source == BY_RANGE:
        return bool(m.range_trusted), float(m.range_terrain)
    if source == NO_TERRAIN:
        return False, 0.0
    return True, terrain_above_origin(m, m.position_neu[0], m.position_neu[1])


@kernel
def height_above_ground(m: Any) -> float:
    """Returns the height above the ground [m] by which a landing slows down."""
    p = m.position_neu
    if range_is_healthy(m):
        return ranged_height(m)
    if m.terrain_spacing > 0.0 and m.TERRAIN_ENABLE != 0:
        return float(p[2] - terrain_above_origin(m, p[0], p[1]))
    return float(p[2] - m.home_neu[2])
