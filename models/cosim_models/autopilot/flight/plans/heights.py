"""Heights of a mission's take-off and landing, above home or above the terrain.

Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter mode_auto (takeoff_start, shift_alt_to_current_alt).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.flight.plans.order import is_above_terrain
from cosim_models.autopilot.link.statustext import CRITICAL, LAND_NO_TERRAIN, NO_NUMBER, say
from cosim_models.autopilot.mission.missions import Z
from cosim_models.autopilot.mission.terrain import BY_RANGE, measured_terrain, ranged_height, terrain_source

__all__ = ["height_to_land", "takeoff_height"]

_LEAST_RANGED = 2.0  # m above the terrain, on the way to a landing by rangefinder


@kernel
def height_to_land(m: Any, row: int) -> tuple[float, bool]:
    """Returns the present height, of the kind of an item, and whether it is above the terrain."""
    p = m.position_neu[2]
    if is_above_terrain(m, row):
        known, up = measured_terrain(m)
        if known and terrain_source(m) == BY_RANGE:
            return max(ranged_height(m), _LEAST_RANGED), True
        if known:
            return p - up, True
        say(m, CRITICAL, LAND_NO_TERRAIN, NO_NUMBER)
    return m.home_neu[2] + 0.01 * math.floor(100.0 * (p - m.home_neu[2])), False  # whole centimetres


@kernel
def takeoff_height(m: Any, row: int) -> float:
    """Returns the height to which a take-off climbs: above home, or above the terrain here."""
    if is_above_terrain(m, row):
        known, up = measured_terrain(m)
        return float((up if known else m.position_neu[2]) + m.mission[row, Z])
    return float(m.home_neu[2] + m.mission[row, Z])
