"""Polygon and circle fences: their items in the mission protocol, and the check of positions against them.

A vehicle is within the fence if it is inside every inclusion circle, inside one of the inclusion polygons if there are
any, and outside all exclusions. Kernels over the autopilot's record `m`; the protocol is in `missions`, the response to
a breach in `failsafes`.

Sources: the MAVLink guide, "Mission Protocol" (geofences); ArduPilot, AC_PolyFence_loader.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
    MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    MAV_CMD_NAV_FENCE_RETURN_POINT,
    MAV_MISSION_ACCEPTED,
    MAV_MISSION_INVALID_PARAM1,
    MAV_MISSION_INVALID_PARAM5_X,
    MAV_MISSION_INVALID_PARAM6_Y,
    MAV_MISSION_UNSUPPORTED,
    MAV_MISSION_UNSUPPORTED_FRAME,
    MISSION_ITEM,
    MISSION_ITEM_INT,
    encode_mission_item,
    encode_mission_item_int,
)
from cosim_models.autopilot.link.links import send

__all__ = [
    "CIRCLE",
    "HIGHEST",
    "LOWEST",
    "POLYGON",
    "FENCE_CAPACITY",
    "FENCE_ITEM",
    "check_fence_item",
    "edge",
    "fence_is_whole",
    "fence_shape",
    "is_inside",
    "keep_fence_item",
    "permits",
    "place_fence",
    "send_fence_item",
    "within_polygons",
]

HIGHEST, CIRCLE, POLYGON, LOWEST = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""

FENCE_CAPACITY = 70
_COMMAND, _SIZE, _LATITUDE, _LONGITUDE, _NORTH, _EAST = range(6)
FENCE_ITEM = 6
"""Columns of the table of fence items: as uploaded, positions in 1e-7 degrees and, from the local origin, in m."""

_LEAST_VERTICES = 3


@kernel
def check_fence_item(command: int, frame: int, size: float, latitude: float, longitude: float) -> int:
    """Returns the MAV_MISSION_RESULT for an item; `size` is its param 1: number of vertices, or radius [m]."""
    if not MAV_CMD_NAV_FENCE_RETURN_POINT <= command <= MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION:
        return MAV_MISSION_UNSUPPORTED
    if frame not in (0, 2, 3, 5, 6):
        return MAV_MISSION_UNSUPPORTED_FRAME
    polygon = command in (MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
    circle = command in (MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
    if (polygon and not _LEAST_VERTICES <= size <= FENCE_CAPACITY) or (circle and not 0.0 < size < 1e7):
        return MAV_MISSION_INVALID_PARAM1
    if not abs(latitude) <= 9e8:
        return MAV_MISSION_INVALID_PARAM5_X
    return MAV_MISSION_ACCEPTED if abs(longitude) <= 1.8e9 else MAV_MISSION_INVALID_PARAM6_Y


@kernel
def keep_fence_item(m: Any, sequence: int, command: int, size: float, latitude: float, longitude: float) -> None:
    """Stores an item in the table."""
    r = m.fence[sequence]
    r[_COMMAND], r[_SIZE], r[_LATITUDE], r[_LONGITUDE] = float(command), size, latitude, longitude


@kernel
def fence_is_whole(m: Any, count: int) -> bool:
    """Returns whether the vertices of every polygon are contiguous and as many as declared."""
    i = 0
    while i < count:
        command = m.fence[i, _COMMAND]
        vertices = 1
        if command in (MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION):
            vertices = int(m.fence[i, _SIZE])
            if i + vertices > count:
                return False
            for k in range(i, i + vertices):
                if m.fence[k, _COMMAND] != command or m.fence[k, _SIZE] != m.fence[i, _SIZE]:
                    return False
        i += vertices
    return True


@kernel
def place_fence(m: Any, count: int) -> None:
    """Activates a fence of `count` items."""
    for i in range(count):
        r = m.fence[i]
        r[_NORTH], r[_EAST], _ = local_from_geodetic(
            radians_from_deg_e7(int(r[_LATITUDE])),
            radians_from_deg_e7(int(r[_LONGITUDE])),
            0.0,
            m.origin_latitude,
            m.origin_longitude,
            0.0,
        )
    m.fence_count = count


@kernel
def send_fence_item(m: Any, sequence: int, system: int, component: int, whole: bool) -> None:
    """Answers the request for an item, in integer degrees if `whole`, otherwise in floats."""
    r = m.fence[sequence]
    command, size, lat, lon = int(r[_COMMAND]), r[_SIZE], int(r[_LATITUDE]), int(r[_LONGITUDE])
    if whole:
        encode_mission_item_int(
            m.payload, system, component, sequence, 0, command, 0, 1, size, 0.0, 0.0, 0.0, lat, lon, 0.0, 1
        )
        send(m, MISSION_ITEM_INT)
    else:
        encode_mission_item(
            m.payload,
            system,
            component,
            sequence,
            0,
            command,
            0,
            1,
            r[_SIZE],
            0.0,
            0.0,
            0.0,
            lat * 1e-7,
            lon * 1e-7,
            0.0,
            1,
        )
        send(m, MISSION_ITEM)


@kernel
def is_inside(m: Any, first: int, vertices: int, n: float, e: float) -> bool:
    """Returns whether (n, e) is inside a polygon: a ray to the east crosses it an odd number of times."""
    inside = False
    k = first + vertices - 1
    for i in range(first, first + vertices):
        ni, ei, nk, ek = m.fence[i, _NORTH], m.fence[i, _EAST], m.fence[k, _NORTH], m.fence[k, _EAST]
        if (ni > n) != (nk > n) and e < (ek - ei) * (n - ni) / (nk - ni) + ei:
            inside = not inside
        k = i
    return inside


@kernel
def edge(m: Any, begin: int, end: int) -> tuple[float, float, float, float]:
    """Returns north and east of a vertex, and the way from there to another one [m]."""
    n, e = m.fence[begin, _NORTH], m.fence[begin, _EAST]
    return n, e, m.fence[end, _NORTH] - n, m.fence[end, _EAST] - e


@kernel
def fence_shape(m: Any, row: int) -> tuple[bool, bool, float, float, float]:
    """Returns whether the shape at a row is an inclusion and a polygon, its vertices or radius [m], north and east."""
    command = int(m.fence[row, _COMMAND])
    polygon = command in (MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
    inclusion = command in (MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)
    return inclusion, polygon, m.fence[row, _SIZE], m.fence[row, _NORTH], m.fence[row, _EAST]


@kernel
def within_polygons(m: Any, n: float, e: float) -> bool:
    """Returns whether the uploaded fence permits (n, e) [m]."""
    wanted = False  # there are inclusion polygons
    found = False
    i = 0
    while i < m.fence_count:
        command, size = int(m.fence[i, _COMMAND]), m.fence[i, _SIZE]
        if command in (MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION):
            inside = is_inside(m, i, int(size), n, e)
            if command == MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION and inside:
                return False
            wanted = wanted or command == MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
            found = found or (command == MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION and inside)
            i += int(size)
            continue
        dn, de = n - m.fence[i, _NORTH], e - m.fence[i, _EAST]
        near = dn * dn + de * de < size * size
        if (command == MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION and not near) or (
            command == MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION and near
        ):
            return False
        i += 1
    return found or not wanted


@kernel
def permits(m: Any, n: float, e: float, height: float) -> bool:
    """Returns whether the enabled fences permit (n, e) [m] at a height [m above home]."""
    if m.FENCE_ENABLE == 0:
        return True
    if (m.FENCE_TYPE & HIGHEST) != 0 and height > m.FENCE_ALT_MAX:
        return False
    if (m.FENCE_TYPE & LOWEST) != 0 and height < m.FENCE_ALT_MIN:
        return False
    hn, he = n - m.home_neu[0], e - m.home_neu[1]
    if (m.FENCE_TYPE & CIRCLE) != 0 and math.sqrt(hn * hn + he * he) > m.FENCE_RADIUS:
        return False
    return (m.FENCE_TYPE & POLYGON) == 0 or m.fence_count == 0 or within_polygons(m, n, e)
