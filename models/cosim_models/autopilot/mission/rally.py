"""Rally points: alternative return points to home, and the choice of RTL's destination.

RTL flies to the nearest rally point, unless home is nearer (RALLY_INCL_HOME) or all points are beyond RALLY_LIMIT_KM.
Points outside the fences do not count. Kernels over the autopilot's record `m`; the protocol is in `missions`.

Sources: the MAVLink guide, "Mission Protocol" (rally points); ArduPilot, AP_Rally, MissionItemProtocol_Rally and
AC_Fence (check_destination_within_fence).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_NAV_RALLY_POINT,
    MAV_MISSION_ACCEPTED,
    MAV_MISSION_INVALID_PARAM5_X,
    MAV_MISSION_INVALID_PARAM6_Y,
    MAV_MISSION_INVALID_PARAM7,
    MAV_MISSION_UNSUPPORTED,
    MAV_MISSION_UNSUPPORTED_FRAME,
)
from cosim_models.autopilot.mission.fences import permits

__all__ = [
    "RALLY_CAPACITY",
    "RALLY_ITEM",
    "RALLY_FRAME",
    "RALLY_PLACE",
    "best_return",
    "check_rally_item",
    "keep_rally_item",
]

RALLY_CAPACITY = 20
_FRAME, _LATITUDE, _LONGITUDE, _Z, _NORTH, _EAST = range(6)
RALLY_FRAME, RALLY_PLACE = _FRAME, _LATITUDE
RALLY_ITEM = 6
"""Columns of the table of rally points: MAV_FRAME (0 or 3), position in 1e-7 degrees, altitude in whole m, position in
m."""

_MOST = 32767.0  # m


@kernel
def check_rally_item(command: int, frame: int, latitude: float, longitude: float, z: float) -> int:
    """Returns the MAV_MISSION_RESULT for an item."""
    if command != MAV_CMD_NAV_RALLY_POINT:
        return MAV_MISSION_UNSUPPORTED
    if not abs(latitude) <= 9e8:
        return MAV_MISSION_INVALID_PARAM5_X
    if not abs(longitude) <= 1.8e9:
        return MAV_MISSION_INVALID_PARAM6_Y
    if not -_MOST - 1.0 <= z <= _MOST:
        return MAV_MISSION_INVALID_PARAM7
    return MAV_MISSION_ACCEPTED if frame in (0, 3, 5, 6) else MAV_MISSION_UNSUPPORTED_FRAME


@kernel
def keep_rally_item(m: Any, sequence: int, frame: int, latitude: float, longitude: float, z: float) -> None:
    """Stores a point in the table; heights are stored in whole metres, as in ArduPilot."""
    r = m.rally[sequence]
    r[_FRAME] = 0.0 if frame == 0 or frame == 5 else 3.0
    r[_LATITUDE], r[_LONGITUDE], r[_Z] = latitude, longitude, float(math.trunc(z))
    r[_NORTH], r[_EAST], _ = local_from_geodetic(
        radians_from_deg_e7(int(latitude)),
        radians_from_deg_e7(int(longitude)),
        0.0,
        m.origin_latitude,
        m.origin_longitude,
        0.0,
    )


@kernel
def best_return(m: Any) -> tuple[float, float, float]:
    """Returns north and east of RTL's destination, and its height [m] above home, which is 0 for home."""
    best, nearest = -1, math.inf
    for i in range(m.rally_count):
        r = m.rally[i]
        if r[_LATITUDE] == 0.0 and r[_LONGITUDE] == 0.0:
            continue
        dn, de = r[_NORTH] - m.position_neu[0], r[_EAST] - m.position_neu[1]
        distance = math.sqrt(dn * dn + de * de)
        if distance < nearest and permits(m, r[_NORTH], r[_EAST], _height(m, i)):
            best, nearest = i, distance
    hn, he = m.home_neu[0] - m.position_neu[0], m.home_neu[1] - m.position_neu[1]
    beyond = m.RALLY_LIMIT_KM > 0.0 and nearest > 1000.0 * m.RALLY_LIMIT_KM
    if best < 0 or beyond or (m.RALLY_INCL_HOME != 0 and nearest >= math.sqrt(hn * hn + he * he)):
        return m.home_neu[0], m.home_neu[1], 0.0
    return m.rally[best, _NORTH], m.rally[best, _EAST], _height(m, best)


@kernel
def _height(m: Any, i: int) -> float:
    """Returns the height [m] of a point above home."""
    z = m.rally[i, _Z]
    return float(z if m.rally[i, _FRAME] == 3.0 else z - m.origin_altitude - m.home_neu[2])
