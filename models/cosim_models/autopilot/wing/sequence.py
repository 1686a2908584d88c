"""Landing sequences in the missions of planes and quadplanes: from DO_LAND_START to the landing.

A sequence is begun by DO_LAND_START as a command, by a low battery, by RTL (RTL_AUTOLAND) or by the mission itself;
that of the nearest DO_LAND_START is taken, whose place is its own or, without one, that of the item behind it. Once it
is begun, fail-safes let it go on. A mode other than AUTO during the landing of a plane takes the mission back to the
nearest DO_LAND_START, or to the waypoint before the landing. Kernels over a record with `SEQUENCE_PARAMETERS`,
`SEQUENCE_MEMORY` and `gcs.record.MISSION`.

Difference from ArduPlane: an item is part of a sequence by its place in the mission, not by how the mission came there;
there is no DO_RETURN_PATH_START.

Source: ArduPilot, AP_Mission.cpp (get_landing_sequence_start, jump_to_landing_sequence, is_best_land_sequence),
AP_Landing.cpp (restart_landing_sequence), ArduPlane/mode_auto.cpp, mode_rtl.cpp, events.cpp.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_LAND_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_SEVERITY_WARNING,
)
from cosim_models.autopilot.gcs.items import tell_row
from cosim_models.autopilot.gcs.missions import COMMAND, LATITUDE, LONGITUDE, item_place, set_current, tell_reached
from cosim_models.autopilot.gcs.record import whole
from cosim_models.autopilot.gcs.words import (
    LANDS_FROM_POINT,
    LANDS_FROM_START,
    NO_LANDING,
    NO_RESTART,
    SEQUENCE_STARTS,
    say,
)

__all__ = ["SEQUENCE_MEMORY", "SEQUENCE_PARAMETERS", "in_landing_sequence", "is_landing", "jump_to_landing"]
__all__ += ["restart_landing", "seeks_landing"]

_FIRST, _AT_ONCE = 1, 2  # RTL_AUTOLAND
_CLOSE = 10.0  # m from the height of RTL

SEQUENCE_PARAMETERS = (
    whole("RTL_AUTOLAND", 0, "RTL lands by the mission: 1 after the circle at home, 2 at once; 0, 3: it does not"),
)
SEQUENCE_MEMORY = (Memory("landing_sought", dtype="?", rare=True),)  # by this RTL


@kernel
def _command(m: Any, row: int) -> int:
    return int(m.mission[row, COMMAND])


@kernel
def _has_place(m: Any, row: int) -> bool:
    return bool(m.mission[row, LATITUDE] != 0.0 or m.mission[row, LONGITUDE] != 0.0)


@kernel
def is_landing(m: Any) -> bool:
    """Returns whether AUTO carries NAV_LAND out."""
    row = m.mission_current
    runs = m.mission_active and not m.mission_done and 0 < row < m.mission_count
    return bool(runs and _command(m, row) == MAV_CMD_NAV_LAND)


@kernel
def in_landing_sequence(m: Any) -> bool:
    """Returns whether the current item is a landing, or part of the way from a DO_LAND_START to one."""
    row = m.mission_current
    if m.mission_done or not 0 < row < m.mission_count:
        return False
    if _command(m, row) in (MAV_CMD_NAV_LAND, MAV_CMD_NAV_VTOL_LAND):
        return True
    while row > 0:
        command = _command(m, row)
        if command in (MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_VTOL_TAKEOFF):
            return False
        if command == MAV_CMD_DO_LAND_START:
            return True
        row -= 1
    return False


@kernel
def _nearest_sequence(m: Any) -> int:
    """Returns the number of the nearest DO_LAND_START, 0: there is none."""
    nearest, least = 0, math.inf
    for row in range(1, m.mission_count):
        if _command(m, row) != MAV_CMD_DO_LAND_START:
            continue
        of = row
        while of < m.mission_count - 1 and not _has_place(m, of):
            of += 1
        n, e, _ = item_place(m, of)
        distance = math.sqrt((n - m.position[0]) ** 2 + (e - m.position[1]) ** 2)
        if distance < least:
            nearest, least = row, distance
    return nearest


@kernel
def jump_to_landing(m: Any) -> bool:
    """Makes the nearest landing sequence the current part of the mission, and says so; returns whether there is one."""
    if not set_current(m, float(_nearest_sequence(m))):
        say(m, MAV_SEVERITY_WARNING, NO_LANDING, 0)
        return False
    m.mission_done = False
    row = m.mission_current
    tell_row(m, row)
    if row + 1 < m.mission_count:
        tell_row(m, row + 1)
        if m.mission_active:
            m.mission_current, m.item_told, m.item_reached = row + 1, row + 1, 0
            tell_reached(m, row)
    say(m, MAV_SEVERITY_INFO, SEQUENCE_STARTS, 0)
    return True


@kernel
def seeks_landing(m: Any, there: bool) -> bool:
    """Returns whether RTL goes on with a landing sequence now, which is then the current part of the mission.

    Args:
        there: whether it is on its circle at home.
    """
    if m.landing_sought or not m.armed:
        return False
    close = there and abs(m.position[2] - m.guided_position[2]) < _CLOSE
    m.landing_sought = m.RTL_AUTOLAND == _AT_ONCE or (m.RTL_AUTOLAND == _FIRST and close)
    return bool(m.landing_sought and jump_to_landing(m))


@kernel
def restart_landing(m: Any) -> None:
    """Takes a mission that lands back to the beginning of its landing, and says so; required when AUTO ends."""
    if not is_landing(m):
        return
    row = _nearest_sequence(m)
    if set_current(m, float(row)):
        say(m, MAV_SEVERITY_NOTICE, LANDS_FROM_START, row)
        return
    row = m.mission_current - 1
    while row > 0 and not (_command(m, row) in (MAV_CMD_NAV_WAYPOINT, MAV_CMD_NAV_LOITER_UNLIM) and _has_place(m, row)):
        row -= 1
    if set_current(m, float(row)):
        say(m, MAV_SEVERITY_NOTICE, LANDS_FROM_POINT, row)
    else:
        say(m, MAV_SEVERITY_WARNING, NO_RESTART, 0)
