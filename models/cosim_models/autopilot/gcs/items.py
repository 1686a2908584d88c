"""What rovers, planes and quadplanes tell of a mission that runs: each item that begins, and those that are reached.

An item is told when it begins and when AUTO does, also on the ground. Of items that end at the same time, as a waypoint
and the DO_LAND_START behind it, the last one is told as reached. Kernels over a record with `gcs.record.MISSION`.

Source: ArduPilot, AP_Mission.cpp (start_command, type), MissionItemProtocol_Waypoints.cpp.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_SEVERITY_INFO,
)
from cosim_models.autopilot.gcs.missions import COMMAND, tell_reached
from cosim_models.autopilot.gcs.words import ITEM, say

__all__ = ["begin_items", "complete_item", "tell_item", "tell_row"]

_TOLD = np.array(
    [
        MAV_CMD_NAV_WAYPOINT,
        MAV_CMD_NAV_LOITER_UNLIM,
        MAV_CMD_NAV_RETURN_TO_LAUNCH,
        MAV_CMD_NAV_LAND,
        MAV_CMD_NAV_TAKEOFF,
        MAV_CMD_NAV_VTOL_TAKEOFF,
        MAV_CMD_NAV_VTOL_LAND,
        MAV_CMD_DO_CHANGE_SPEED,
        MAV_CMD_DO_LAND_START,
    ],
    dtype=np.int64,
)
"""Commands in the order of the texts from ITEM on."""


@kernel
def tell_row(m: Any, row: int) -> None:
    """Says that an item begins."""
    for i in range(_TOLD.shape[0]):
        if _TOLD[i] == m.mission[row, COMMAND]:
            say(m, MAV_SEVERITY_INFO, ITEM + i, row)


@kernel
def begin_items(m: Any) -> None:
    """Tells the current item anew; required when AUTO begins."""
    m.item_told, m.item_reached = 0, 0
    tell_item(m)


@kernel
def tell_item(m: Any) -> None:
    """Says that the current item begins, once, and that the one before is reached; required in each step of AUTO."""
    if m.mission_current == 0 and m.mission_count > 1:
        m.mission_current = 1  # of a new mission
    row = m.mission_current
    if row == m.item_told:
        return
    command = int(m.mission[row, COMMAND])
    ends_at_once = command in (MAV_CMD_DO_LAND_START, MAV_CMD_DO_CHANGE_SPEED)
    if m.item_reached > 0 and not (ends_at_once and row < m.mission_count):
        tell_reached(m, m.item_reached)
        m.item_reached = 0
    if 0 < row < m.mission_count and not m.mission_done:
        m.item_told = row
        m.item_since = -1.0
        tell_row(m, row)


@kernel
def complete_item(m: Any) -> None:
    """Goes on to the next item; the present one is reached."""
    m.item_reached = m.mission_current
    m.mission_current += 1
