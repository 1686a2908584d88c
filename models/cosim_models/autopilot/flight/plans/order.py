"""The order of a mission's commands: jumps, the landing sequence, and the places of items.

Kernels over the autopilot's record `m`.

Source: ArduPilot, AP_Mission.
"""

from __future__ import annotations

from typing import Any

from cosim.frames import local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_JUMP,
    MAV_CMD_DO_JUMP_TAG,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_JUMP_TAG,
    MAV_CMD_NAV_LAST,
    MAV_CMD_NAV_SPLINE_WAYPOINT,
    MAV_CMD_NAV_WAYPOINT,
)
from cosim_models.autopilot.control.position import stopping_ne
from cosim_models.autopilot.mission.missions import COMMAND, DONE, FRAME, LATITUDE, P1, P2, Z, mission_count
from cosim_models.autopilot.mission.terrain import terrain_above_origin

__all__ = [
    "following_command",
    "in_landing_sequence",
    "is_above_terrain",
    "is_nowhere",
    "landing_sequence",
    "leg_place",
    "next_command",
    "place",
    "place_after",
    "place_from",
    "stays",
]

_JUMPS_AT_ONCE = 64


@kernel
def place(m: Any, row: int) -> tuple[float, float, float]:
    """Returns north, east and up of an item; a missing position (0, 0) or height is replaced by the desired one."""
    return place_from(m, row, m.desired_position_neu)


@kernel
def place_from(m: Any, row: int, p: Any) -> tuple[float, float, float]:
    """Like `place`, but a missing position or height is replaced by that of `p` (float64[3])."""
    r = m.mission[row]
    n, e, u = p[0], p[1], p[2]
    if r[LATITUDE] != 0.0 or r[LATITUDE + 1] != 0.0:
        n, e, _ = local_from_geodetic(
            radians_from_deg_e7(int(r[LATITUDE])),
            radians_from_deg_e7(int(r[LATITUDE + 1])),
            0.0,
            m.origin_latitude,
            m.origin_longitude,
            0.0,
        )
    if r[FRAME] == 0.0 or r[FRAME] == 5.0:
        u = r[Z] - m.origin_altitude
    elif r[FRAME] == 10.0 or r[FRAME] == 11.0:
        u = r[Z] + terrain_above_origin(m, n, e)
    elif r[Z] != 0.0 or r[COMMAND] == MAV_CMD_NAV_WAYPOINT:
        u = r[Z] + m.home_neu[2]
    return n, e, u


@kernel
def is_above_terrain(m: Any, row: int) -> bool:
    """Returns whether the height of an item is above the terrain."""
    return bool(m.mission[row, FRAME] == 10.0 or m.mission[row, FRAME] == 11.0)


@kernel
def leg_place(m: Any, row: int, p: Any) -> tuple[float, float, float, bool]:
    """Like `place_from`, but a height above the terrain remains one; returns also whether it is one."""
    n, e, u = place_from(m, row, p)
    if is_above_terrain(m, row):
        return n, e, m.mission[row, Z], True
    return n, e, u, False


@kernel
def is_nowhere(m: Any, row: int) -> bool:
    r = m.mission[row]
    return bool(r[LATITUDE] == 0.0 and r[LATITUDE + 1] == 0.0 and r[Z] == 0.0)


@kernel
def _aim(m: Any, row: int) -> int:
    """Returns the row that a jump at `row` leads to: by its number, or by its tag; -1 if there is none."""
    wanted = m.mission[row, P1]
    if m.mission[row, COMMAND] == MAV_CMD_DO_JUMP:
        return int(wanted) if 1.0 <= wanted < mission_count(m) else -1
    for i in range(1, mission_count(m)):
        if m.mission[i, COMMAND] == MAV_CMD_JUMP_TAG and m.mission[i, P1] == wanted:
            return i
    return -1


@kernel
def next_command(m: Any, row: int, taking: bool) -> int:
    """Returns the command at `row`, or the target of the jumps there; -1 at the end. `taking`: count the jumps."""
    first_jump = -1
    for _ in range(_JUMPS_AT_ONCE + m.mission.shape[0]):
        if row >= mission_count(m):
            return -1
        r = m.mission[row]
        if r[COMMAND] != MAV_CMD_DO_JUMP and r[COMMAND] != MAV_CMD_DO_JUMP_TAG:
            return row
        aim = _aim(m, row)
        if aim < 0 or (not taking and first_jump == row):
            return -1
        if first_jump < 0:
            first_jump = row
        if r[P2] < 0.0 or r[DONE] < r[P2]:
            if taking:
                r[DONE] += 1.0
            row = aim
        else:
            if taking:
                r[DONE] = 0.0
            row += 1
    return -1


@kernel
def following_command(m: Any, row: int) -> int:
    """Returns the navigation command after `row`; -1 if there is none."""
    for _ in range(m.mission.shape[0]):
        row = next_command(m, row + 1, False)
        if row < 0 or m.mission[row, COMMAND] <= MAV_CMD_NAV_LAST:
            return int(row)
    return -1


@kernel
def stays(m: Any, row: int) -> bool:
    """Returns whether a waypoint has a delay, in whole seconds."""
    return bool(m.mission[row, P1] >= 1.0)


@kernel
def place_after(
    m: Any, row: int, here: tuple[float, float, float], above: bool
) -> tuple[tuple[float, float, float], bool]:
    """Returns the place after a spline's, which is `here`, and whether a spline leads there.

    A place whose height is of the other kind, above the terrain or not, is no such place.
    """
    following = -1 if stays(m, row) else following_command(m, row)
    if following < 0:
        return here, False
    n, e, u, also = leg_place(m, following, here)
    if also != above:
        return here, False
    return (n, e, u), bool(m.mission[following, COMMAND] == MAV_CMD_NAV_SPLINE_WAYPOINT)


@kernel
def landing_sequence(m: Any) -> int:
    """Returns the row of the DO_LAND_START whose place is nearest to the stopping point; 0 if there is none.

    Without a place of its own, it has that of the next command with a place.
    """
    here_n, here_e = stopping_ne(m)
    best, nearest = 0, 0.0
    for row in range(1, mission_count(m)):
        if m.mission[row, COMMAND] != MAV_CMD_DO_LAND_START:
            continue
        at = row
        while at < mission_count(m) and (m.mission[at, LATITUDE] == 0.0 and m.mission[at, LATITUDE + 1] == 0.0):
            at += 1
        if at >= mission_count(m):
            continue
        n, e, u = place(m, at)
        gap = (n - here_n) ** 2 + (e - here_e) ** 2 + (u - m.position_neu[2]) ** 2
        if best == 0 or gap < nearest:
            best, nearest = row, gap
    return best


@kernel
def in_landing_sequence(m: Any) -> bool:
    """Returns whether the current command follows a DO_LAND_START."""
    found = 0
    for row in range(1, int(m.mission_current) + 1):
        if m.mission[row, COMMAND] == MAV_CMD_DO_LAND_START:
            found += 1
    return found > 0
