"""Targets of GUIDED mode: SET_POSITION_TARGET_*, DO_REPOSITION and MISSION_ITEM with current 2.

Kernels over the record that `gcs.record` declares. They write `guided_kind` and the vectors that belong to it; the
autopilots follow them. Positions are NED from the local origin.

Sources: MAVLink common.xml; ArduPilot, GCS_MAVLink_Copter and GCS_MAVLink_Rover.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.frames import deg_e7, geodetic_from_local, local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    MAV_FRAME_BODY_NED,
    MAV_FRAME_BODY_OFFSET_NED,
    MAV_FRAME_GLOBAL,
    MAV_FRAME_GLOBAL_INT,
    MAV_FRAME_GLOBAL_RELATIVE_ALT,
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    MAV_FRAME_GLOBAL_TERRAIN_ALT,
    MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    MAV_FRAME_LOCAL_NED,
    MAV_FRAME_LOCAL_OFFSET_NED,
    MAV_SEVERITY_INFO,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_set_position_target_global_int,
    decode_set_position_target_local_ned,
)
from cosim_models.autopilot.gcs.record import ACCELERATION, HOLD, POSITION, POSITION_VELOCITY, VELOCITY
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.words import HOME_SET, say_figures

__all__ = ["global_target", "go_to", "height_target", "hold_here", "home_here", "is_place", "local_target", "locate"]
__all__ += ["say_home"]

_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION = 0x0007, 0x0038, 0x01C0  # sums of POSITION_TARGET_TYPEMASK_*_IGNORE
_ONLY_HEIGHT, _NO_HEIGHT = 0x0003, 0x0004  # no latitude and longitude; no height
_FRAMES = (MAV_FRAME_LOCAL_NED, MAV_FRAME_LOCAL_OFFSET_NED, MAV_FRAME_BODY_NED, MAV_FRAME_BODY_OFFSET_NED)


@kernel
def _is_relative(frame: int) -> bool:
    """Returns whether heights in a frame refer to home."""
    return bool(frame in (MAV_FRAME_GLOBAL_RELATIVE_ALT, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT))


@kernel
def _above_terrain(frame: int) -> bool:
    """Returns whether heights in a frame refer to the terrain."""
    return bool(frame in (MAV_FRAME_GLOBAL_TERRAIN_ALT, MAV_FRAME_GLOBAL_TERRAIN_ALT_INT))


@kernel
def is_place(frame: int, lat: int, lon: int, altitude: float) -> bool:
    """Returns whether these are a place in a frame whose heights refer to the sea, to home or to the terrain."""
    known = frame in (MAV_FRAME_GLOBAL, MAV_FRAME_GLOBAL_INT) or _is_relative(frame) or _above_terrain(frame)
    return bool(known and abs(lat) <= 900000000 and abs(lon) <= 1800000000 and math.isfinite(altitude))


@kernel
def locate(m: Any, frame: int, lat: int, lon: int, altitude: float) -> tuple[float, float, float]:
    """Returns north, east and down of a place in degE7 and m. The terrain is a plane through the local origin."""
    relative = _is_relative(frame)
    n, e, d = local_from_geodetic(
        radians_from_deg_e7(lat),
        radians_from_deg_e7(lon),
        altitude,
        m.origin_latitude,
        m.origin_longitude,
        0.0 if relative or _above_terrain(frame) else m.origin_altitude,
    )
    return n, e, d + m.home[2] if relative else d


@kernel
def home_here(m: Any) -> None:
    """Makes the present position home, unless a ground station has set it, and its height that of the ground."""
    m.ground_down = m.position[2]
    if not m.home_set:
        for i in range(3):
            m.home[i] = m.position[i]


@kernel
def say_home(m: Any) -> None:
    """Says where home is, in ArduRover's words and with its single precision."""
    lat, lon, alt = geodetic_from_local(
        m.home[0], m.home[1], m.home[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    degree = np.float32(1e-7)
    x, y = np.float64(np.float32(deg_e7(lat)) * degree), np.float64(np.float32(deg_e7(lon)) * degree)
    say_figures(m, MAV_SEVERITY_INFO, HOME_SET, (x, y, alt, 0.0))


@kernel
def go_to(m: Any, n: float, e: float, d: float) -> None:
    """Makes a position the target."""
    m.taking_off = False
    m.guided_kind = POSITION
    m.guided_position[0], m.guided_position[1], m.guided_position[2] = n, e, d


@kernel
def hold_here(m: Any) -> None:
    """Stops, and makes the present position the target."""
    go_to(m, m.position[0], m.position[1], m.position[2])
    m.guided_kind = HOLD


@kernel
def _follow(m: Any, mask: int, x: Any, v: Any, a: Any, t: float) -> None:
    """Applies the parts of a target that its mask does not exclude."""
    position = (mask & _NO_POSITION) == 0
    velocity = (mask & _NO_VELOCITY) == 0
    acceleration = (mask & _NO_ACCELERATION) == 0
    total = 0.0
    for i in range(3):
        total += (x[i] if position else 0.0) + (v[i] if velocity else 0.0) + (a[i] if acceleration else 0.0)
    if not math.isfinite(total) or not (position or velocity or acceleration):
        hold_here(m)
        return
    m.taking_off = False
    m.guided_time = t
    kind = POSITION if position else VELOCITY if velocity else ACCELERATION
    m.guided_kind = POSITION_VELOCITY if position and velocity else kind
    for i in range(3):
        if position:
            m.guided_position[i] = x[i]
        m.guided_velocity[i] = v[i] if velocity else 0.0
        m.guided_acceleration[i] = a[i] if acceleration else 0.0


@kernel
def local_target(m: Any, t: float) -> None:
    """Handles SET_POSITION_TARGET_LOCAL_NED; other frames stop the vehicle."""
    _, _, _, frame, mask, x, y, z, vx, vy, vz, ax, ay, az, _, _ = decode_set_position_target_local_ned(m.received)
    if frame not in _FRAMES:
        hold_here(m)
        return
    if frame >= MAV_FRAME_BODY_NED:
        yaw = heading(m)
        c, s = math.cos(yaw), math.sin(yaw)
        x, y = x * c - y * s, x * s + y * c
        vx, vy = vx * c - vy * s, vx * s + vy * c
        ax, ay = ax * c - ay * s, ax * s + ay * c
    if frame != MAV_FRAME_LOCAL_NED:
        x, y, z = x + m.position[0], y + m.position[1], z + m.position[2]
    _follow(m, mask, (x, y, z), (vx, vy, vz), (ax, ay, az), t)


@kernel
def global_target(m: Any, t: float) -> None:
    """Handles SET_POSITION_TARGET_GLOBAL_INT; a place that is none stops the vehicle."""
    _, _, _, frame, mask, lat, lon, alt, vx, vy, vz, ax, ay, az, _, _ = decode_set_position_target_global_int(
        m.received
    )
    x, y, z = 0.0, 0.0, 0.0
    if (mask & _NO_POSITION) == 0:
        if not is_place(frame, lat, lon, alt):
            hold_here(m)
            return
        x, y, z = locate(m, frame, lat, lon, alt)
    _follow(m, mask, (x, y, z), (vx, vy, vz), (ax, ay, az), t)


@kernel
def height_target(m: Any, message: int, t: float) -> None:  # noqa: ARG001
    """Takes the height of SET_POSITION_TARGET_GLOBAL_INT; everything else is ignored."""
    if message != SET_POSITION_TARGET_GLOBAL_INT:
        return
    _, _, _, frame, mask, _, _, alt, _, _, _, _, _, _, _, _ = decode_set_position_target_global_int(m.received)
    only_height = (mask & _ONLY_HEIGHT) == _ONLY_HEIGHT and (mask & _NO_HEIGHT) == 0
    if only_height and is_place(frame, 0, 0, alt):
        m.guided_position[2] = locate(m, frame, 0, 0, alt)[2]
