"""Coordinate frames: attitude as quaternions, NED and ENU, geodetic and local positions, great-circle distance.

Conventions: NED = north, east, down; ENU = east, north, up; body = FRD (forward, right, down). A quaternion is
(w, x, y, z) of unit length and rotates body FRD into NED. Euler angles are roll, pitch, yaw (first yaw about down, then
pitch, then roll). Metres and radians throughout, latitude and longitude too; altitude is positive upwards.

Every function is a kernel. Its vectors are tuples or arrays, which it only indexes; it returns scalars and tuples. The
local frame is ArduPilot's flat Earth, so that positions mean the same to our models and to a real autopilot. It is not
geodesy: metres per degree differ from the WGS-84 ellipsoid by up to 0.7 %. Rotation matrices and time integration are
elsewhere.

Source of the local frame: ArduPilot, libraries/AP_Common/Location.cpp. Haversine: R. W. Sinnott, "Virtues of the
Haversine", Sky and Telescope 68 (2), 1984.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel

__all__ = [
    "EARTH_RADIUS_ARDUPILOT",
    "EARTH_RADIUS_MEAN",
    "Quaternion",
    "Vector",
    "conjugate",
    "deg_e7",
    "derivative",
    "enu_from_ned",
    "euler_from_quaternion",
    "geodetic_from_local",
    "haversine",
    "local_from_geodetic",
    "longitude_at",
    "multiply",
    "ned_from_enu",
    "normalize",
    "quaternion_from_euler",
    "radians_from_deg_e7",
    "roll_pitch_from_quaternion",
    "rotate",
    "rotate_inverse",
    "wrap_pi",
    "yaw_from_quaternion",
]

Vector: TypeAlias = tuple[float, float, float] | NDArray[np.float64]
"""Three numbers."""
Quaternion: TypeAlias = tuple[float, float, float, float] | NDArray[np.float64]
"""Four numbers: w, x, y, z."""

EARTH_RADIUS_MEAN = 6371000.0
"""Mean Earth radius in m, the usual one for the haversine formula; 100 m in ArduPilot's frame then read 99.889 m."""
EARTH_RADIUS_ARDUPILOT = 6378100.0
"""Earth radius in m of ArduPilot's local frame; with this radius, haversine distances agree with ArduPilot's metres."""

_TWO_PI = 2.0 * math.pi
_DEG_E7 = 1.0e7 * 180.0 / math.pi
_SMALLEST_LONGITUDE_SCALE = 0.01
# Within 1.4e-6 rad of the vertical, roll and yaw share an axis and only their sum or difference is determined.
_GIMBAL_LOCK = 1.0 - 1.0e-12


# -- rotation -------------------------------------------------------------------------------------------------------


@kernel
def multiply(p: Quaternion, q: Quaternion) -> tuple[float, float, float, float]:
    """Returns the Hamilton product p q; as rotations, q is applied first, then p."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@kernel
def conjugate(q: Quaternion) -> tuple[float, float, float, float]:
    """Returns the inverse rotation of the unit quaternion `q`."""
    return q[0], -q[1], -q[2], -q[3]


@kernel
def normalize(q: Quaternion) -> tuple[float, float, float, float]:
    """Returns `q` scaled to unit length; four NaN if its length is zero."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 1.0 / length if length > 0.0 else math.nan
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@kernel
def derivative(q: Quaternion, angular_velocity: Vector) -> tuple[float, float, float, float]:
    """Returns the time derivative in 1/s of the attitude `q` at the given angular velocity (body FRD, rad/s)."""
    p = 0.5 * angular_velocity[0]
    r = 0.5 * angular_velocity[1]
    s = 0.5 * angular_velocity[2]
    return (
        -q[1] * p - q[2] * r - q[3] * s,
        q[0] * p + q[2] * s - q[3] * r,
        q[0] * r - q[1] * s + q[3] * p,
        q[0] * s + q[1] * r - q[2] * p,
    )


@kernel
def rotate(q: Quaternion, v: Vector) -> tuple[float, float, float]:
    """Transforms the vector `v` from the body frame to NED; `q` is the body's attitude."""
    # v + 2 u x (u x v + w v) with u the vector part of q
    x = q[2] * v[2] - q[3] * v[1] + q[0] * v[0]
    y = q[3] * v[0] - q[1] * v[2] + q[0] * v[1]
    z = q[1] * v[1] - q[2] * v[0] + q[0] * v[2]
    return (
        v[0] + 2.0 * (q[2] * z - q[3] * y),
        v[1] + 2.0 * (q[3] * x - q[1] * z),
        v[2] + 2.0 * (q[1] * y - q[2] * x),
    )


@kernel
def rotate_inverse(q: Quaternion, v: Vector) -> tuple[float, float, float]:
    """Transforms the vector `v` from NED to the body frame; `q` is the body's attitude."""
    return rotate(conjugate(q), v)


@kernel
def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Returns the attitude with the given roll, pitch and yaw in rad."""
    cr = math.cos(0.5 * roll)
    sr = math.sin(0.5 * roll)
    cp = math.cos(0.5 * pitch)
    sp = math.sin(0.5 * pitch)
    cy = math.cos(0.5 * yaw)
    sy = math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@kernel
def roll_pitch_from_quaternion(q: Quaternion) -> tuple[float, float]:
    """Returns roll in [-pi, pi] and pitch in [-pi/2, pi/2] of `q`, in rad; roll is 0 if vertical."""
    sine = 2.0 * (q[0] * q[2] - q[3] * q[1])
    if abs(sine) > _GIMBAL_LOCK:
        return 0.0, math.copysign(0.5 * math.pi, sine)
    roll = math.atan2(2.0 * (q[0] * q[1] + q[2] * q[3]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]))
    return roll, math.asin(sine)


@kernel
def yaw_from_quaternion(q: Quaternion) -> float:
    """Returns yaw in [-pi, pi] of `q`, in rad, with a roll of 0 if vertical."""
    sine = 2.0 * (q[0] * q[2] - q[3] * q[1])
    if abs(sine) > _GIMBAL_LOCK:
        return wrap_pi(math.copysign(2.0, -sine) * math.atan2(q[1], q[0]))
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


@kernel
def euler_from_quaternion(q: Quaternion) -> tuple[float, float, float]:
    """Returns roll and yaw in [-pi, pi] and pitch in [-pi/2, pi/2] of `q`, in rad; roll is 0 if vertical."""
    roll, pitch = roll_pitch_from_quaternion(q)
    return roll, pitch, yaw_from_quaternion(q)


@kernel
def wrap_pi(angle: float) -> float:
    """Wraps the finite `angle` in rad to [-pi, pi)."""
    if -math.pi <= angle < math.pi:
        return angle
    wrapped = angle - _TWO_PI * math.floor((angle + math.pi) / _TWO_PI)
    # Rounding can leave the half-open interval by an ulp.
    return wrapped if -math.pi <= wrapped < math.pi else -math.pi


# -- positions ------------------------------------------------------------------------------------------------------


@kernel
def enu_from_ned(v: Vector) -> tuple[float, float, float]:
    """Transforms the NED vector `v` to ENU."""
    return v[1], v[0], -v[2]


@kernel
def ned_from_enu(v: Vector) -> tuple[float, float, float]:
    """Transforms the ENU vector `v` to NED."""
    return v[1], v[0], -v[2]


@kernel
def deg_e7(angle: float) -> int:
    """Converts the finite `angle` in rad to MAVLink's degE7: the nearest integer multiple of 1e-7 degrees."""
    return int(np.int64(math.floor(angle * _DEG_E7 + 0.5)))


@kernel
def radians_from_deg_e7(angle: int) -> float:
    """Converts `angle`, an integer multiple of 1e-7 degrees, to rad."""
    return angle / _DEG_E7


@kernel
def _longitude_scale(lat: float) -> float:
    return max(math.cos(lat), _SMALLEST_LONGITUDE_SCALE)


@kernel
def local_from_geodetic(
    lat: float, lon: float, alt: float, lat0: float, lon0: float, alt0: float
) -> tuple[float, float, float]:
    """Converts a geodetic position to a position relative to an origin, on ArduPilot's flat Earth.

    North-south, one radian is EARTH_RADIUS_ARDUPILOT metres; east-west this is multiplied by the cosine of the mean
    latitude (at least 0.01). The difference in longitude takes the shorter way round.

    Args:
        lat: latitude in rad.
        lon: longitude in rad.
        alt: altitude in m.
        lat0: latitude of the origin in rad.
        lon0: longitude of the origin in rad.
        alt0: altitude of the origin in m, above the same datum.

    Returns:
        north, east, down in m.
    """
    north = (lat - lat0) * EARTH_RADIUS_ARDUPILOT
    east = wrap_pi(lon - lon0) * EARTH_RADIUS_ARDUPILOT * _longitude_scale(0.5 * (lat + lat0))
    return north, east, alt0 - alt


@kernel
def geodetic_from_local(
    north: float, east: float, down: float, lat0: float, lon0: float, alt0: float
) -> tuple[float, float, float]:
    """Converts a position relative to an origin to a geodetic position: the inverse of `local_from_geodetic`.

    Args:
        north: distance north of the origin in m.
        east: distance east of the origin in m.
        down: distance below the origin in m.
        lat0: latitude of the origin in rad.
        lon0: longitude of the origin in rad.
        alt0: altitude of the origin in m.

    Returns:
        latitude in rad, longitude in rad within [-pi, pi), altitude in m.
    """
    lat = lat0 + north / EARTH_RADIUS_ARDUPILOT
    scale = _longitude_scale(0.5 * (lat + lat0))
    lon = wrap_pi(lon0 + east / (EARTH_RADIUS_ARDUPILOT * scale))
    return lat, lon, alt0 - down


@kernel
def haversine(lat1: float, lon1: float, lat2: float, lon2: float, radius: float) -> float:
    """Returns the great-circle distance in m between two points on a sphere of `radius` in m; angles in rad."""
    sine_lat = math.sin(0.5 * (lat2 - lat1))
    sine_lon = math.sin(0.5 * (lon2 - lon1))
    a = sine_lat * sine_lat + math.cos(lat1) * math.cos(lat2) * sine_lon * sine_lon
    return 2.0 * radius * math.atan2(math.sqrt(max(a, 0.0)), math.sqrt(max(1.0 - a, 0.0)))


@kernel
def longitude_at(lat: float, lon0: float, distance_east: float, radius: float) -> float:
    """Returns the longitude on the parallel `lat` at a given haversine distance from `lon0`: the inverse of haversine.

    Args:
        lat: latitude of both points in rad.
        lon0: longitude of the starting point in rad.
        distance_east: great-circle distance in m, negative to the west. A distance beyond the antipodal meridian gives
            the farthest point, opposite to lon0.
        radius: radius of the sphere in m.

    Returns:
        The longitude in rad, within [-pi, pi).
    """
    sine = math.sin(0.5 * distance_east / radius) / math.cos(lat)
    return wrap_pi(lon0 + 2.0 * math.asin(min(max(sine, -1.0), 1.0)))
