"""Contents of messages on attitude, sensors, memory and fences.

Each kernel over the autopilot's record `m` appends one MAVLink packet; see `messages` for the others. There is no
magnetometer, so its fields are zero. VIBRATION is the difference of one sample from the filtered ones, not a mean over
some seconds as in ArduPilot. The pressure is that of the standard atmosphere at the true height.

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common; ISO 2533 (standard atmosphere).
"""

from __future__ import annotations

from typing import Any

from cosim.frames import conjugate, deg_e7, euler_from_quaternion, geodetic_from_local, rotate
from cosim.kernel import kernel
from cosim.messages import (
    AHRS,
    AHRS2,
    FENCE_STATUS,
    MEMINFO,
    SCALED_IMU,
    SCALED_PRESSURE,
    VIBRATION,
    encode_ahrs,
    encode_ahrs2,
    encode_fence_status,
    encode_meminfo,
    encode_scaled_imu,
    encode_scaled_pressure,
    encode_vibration,
)
from cosim_models.autopilot.control.position import GRAVITY
from cosim_models.autopilot.link.links import microseconds, milliseconds, send
from cosim_models.autopilot.mission.fences import CIRCLE, HIGHEST, LOWEST, POLYGON

__all__ = [
    "fill_pressure",
    "fill_scaled_imu",
    "pressure",
    "send_ahrs",
    "send_ahrs2",
    "send_fence",
    "send_memory",
    "send_pressure",
    "send_scaled_imu",
    "send_vibration",
    "short",
]


_FREE_MEMORY = 524288  # bytes, as reported by a simulated ArduCopter
_BELOW, _ABOVE, _OUTSIDE = 1, 2, 3  # FENCE_BREACH
_SEA_LEVEL, _LAPSE, _TEMPERATURE, _EXPONENT = 1013.25, 0.0065, 288.15, 5.25588  # hPa, K/m, K
_FREEZING = 273.15


@kernel
def short(value: float) -> int:
    """Truncates `value` to an int16."""
    return int(min(max(value, -32768.0), 32767.0))


@kernel
def send_ahrs(m: Any) -> bool:
    """Sends AHRS: no gyro drift and no estimation errors."""
    encode_ahrs(m.payload, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return send(m, AHRS)


@kernel
def send_ahrs2(m: Any) -> bool:
    """Sends AHRS2, the output of a second estimator."""
    roll, pitch, yaw = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    p = m.position_neu
    lat, lon, alt = geodetic_from_local(p[0], p[1], -p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    encode_ahrs2(m.payload, roll, pitch, yaw, alt, deg_e7(lat), deg_e7(lon))
    return send(m, AHRS2)


@kernel
def send_vibration(m: Any, t: float) -> bool:
    """Sends VIBRATION: deviation of the specific force from its filtered value [m/s2, FRD]."""
    back = conjugate((float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3])))
    x, y, z = rotate(
        back, (float(m.acceleration_neu[0]), float(m.acceleration_neu[1]), -float(m.acceleration_neu[2]) - GRAVITY)
    )
    f = m.specific_force
    encode_vibration(m.payload, microseconds(t), abs(f[0] - x), abs(f[1] - y), abs(f[2] - z), 0, 0, 0)
    return send(m, VIBRATION)


@kernel
def send_memory(m: Any) -> bool:
    """Sends MEMINFO with constant free memory."""
    encode_meminfo(m.payload, 0, 65535, _FREE_MEMORY)
    return send(m, MEMINFO)


@kernel
def fill_scaled_imu(m: Any, t: float) -> None:
    """Fills SCALED_IMU, and its like for further sensors: specific force [mG] and angular velocity [mrad/s], FRD."""
    f, w = m.specific_force, m.gyro
    g = 1000.0 / GRAVITY
    encode_scaled_imu(
        m.payload,
        milliseconds(t),
        short(f[0] * g),
        short(f[1] * g),
        short(f[2] * g),
        short(w[0] * 1000.0),
        short(w[1] * 1000.0),
        short(w[2] * 1000.0),
        0,
        0,
        0,
        0,
    )


@kernel
def send_scaled_imu(m: Any, t: float) -> bool:
    """Sends SCALED_IMU."""
    fill_scaled_imu(m, t)
    return send(m, SCALED_IMU)


@kernel
def pressure(m: Any) -> tuple[float, float]:
    """Returns pressure [hPa] and temperature [degrees C] of the standard atmosphere."""
    kelvin = _TEMPERATURE - _LAPSE * (m.origin_altitude + m.position_neu[2])
    return float(_SEA_LEVEL * (kelvin / _TEMPERATURE) ** _EXPONENT), float(kelvin - _FREEZING)


@kernel
def fill_pressure(m: Any, t: float) -> None:
    """Fills SCALED_PRESSURE, and its like for a second sensor."""
    hectopascal, celsius = pressure(m)
    encode_scaled_pressure(m.payload, milliseconds(t), hectopascal, 0.0, short(100.0 * celsius), 0)


@kernel
def send_pressure(m: Any, t: float) -> bool:
    """Sends SCALED_PRESSURE."""
    fill_pressure(m, t)
    return send(m, SCALED_PRESSURE)


@kernel
def send_fence(m: Any) -> bool:
    """Sends FENCE_STATUS if fences are enabled."""
    if m.FENCE_ENABLE == 0:
        return True
    kind = 0
    if (m.fence_breach & LOWEST) != 0:
        kind = _BELOW
    elif (m.fence_breach & HIGHEST) != 0:
        kind = _ABOVE
    elif (m.fence_breach & (CIRCLE | POLYGON)) != 0:
        kind = _OUTSIDE
    encode_fence_status(
        m.payload, 1 if m.fence_breach != 0 else 0, m.breach_count % 65536, kind, milliseconds(m.breach_time), 0
    )
    return send(m, FENCE_STATUS)
