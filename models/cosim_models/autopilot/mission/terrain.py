"""The height of the terrain: a grid of points with bilinear interpolation between them, or a plane.

Heights are relative to the altitude of the local origin. The edge of the grid goes on outside of it. Kernels over the
autopilot's record `m`.

Source: ArduPilot, AP_Terrain (bilinear interpolation of a grid of heights).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel

__all__ = ["TERRAIN_POINTS", "terrain_above_origin"]

TERRAIN_POINTS = 16
"""Points of the grid in each direction."""


@kernel
def terrain_above_origin(m: Any, north: float, east: float) -> float:
    """Returns the height of the terrain above the local origin [m] at a place [m]."""
    if m.terrain_spacing <= 0.0:
        return 0.0
    last = float(TERRAIN_POINTS - 1)
    x = min(max((north - m.terrain_origin[0]) / m.terrain_spacing, 0.0), last)
    y = min(max((east - m.terrain_origin[1]) / m.terrain_spacing, 0.0), last)
    i, j = int(min(math.floor(x), last - 1.0)), int(min(math.floor(y), last - 1.0))
    x, y = x - i, y - j
    a, b = m.terrain[i * TERRAIN_POINTS + j], m.terrain[i * TERRAIN_POINTS + j + 1]
    c, d = m.terrain[(i + 1) * TERRAIN_POINTS + j], m.terrain[(i + 1) * TERRAIN_POINTS + j + 1]
    return float((1.0 - x) * ((1.0 - y) * a + y * b) + x * ((1.0 - y) * c + y * d))
