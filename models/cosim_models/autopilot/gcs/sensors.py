"""Messages on sensors, supplies and outputs that the small autopilots send on request.

Accelerometer and gyro are the inputs; the second and third sensors measure the same. There is no magnetometer, and
`IdealAutopilot` has no battery: these fields are zero, or unknown. The pressure is that of the standard atmosphere.

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common; ISO 2533 (standard atmosphere).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import deg_e7, euler_from_quaternion, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    AHRS,
    AHRS2,
    AUTOPILOT_STATE_FOR_GIMBAL_DEVICE,
    BATTERY_STATUS,
    FLIGHT_INFORMATION,
    HIGH_LATENCY2,
    HIGHRES_IMU,
    HWSTATUS,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
    MEMINFO,
    NAV_CONTROLLER_OUTPUT,
    POWER_STATUS,
    RAW_IMU,
    RC_CHANNELS,
    RELAY_STATUS,
    SCALED_IMU,
    SCALED_IMU2,
    SCALED_IMU3,
    SCALED_PRESSURE,
    SCALED_PRESSURE2,
    SIMSTATE,
    TERRAIN_REPORT,
    VIBRATION,
    WIND,
    encode_ahrs,
    encode_ahrs2,
    encode_autopilot_state_for_gimbal_device,
    encode_battery_status,
    encode_flight_information,
    encode_high_latency2,
    encode_highres_imu,
    encode_hwstatus,
    encode_meminfo,
    encode_nav_controller_output,
    encode_power_status,
    encode_raw_imu,
    encode_rc_channels,
    encode_relay_status,
    encode_scaled_imu,
    encode_scaled_pressure,
    encode_simstate,
    encode_terrain_report,
    encode_vibration,
    encode_wind,
    put_autopilot_state_for_gimbal_device_q,
    put_battery_status_voltages,
)
from cosim.packets import put_f32, put_i16, put_u8
from cosim_models.autopilot.gcs.rows import AIRSPEED
from cosim_models.autopilot.gcs.sending import send_defined
from cosim_models.autopilot.gcs.sticks import pulse_of

__all__ = ["put_sensed", "put_terrain", "send_airspeed"]

_GRAVITY = 9.80665
_SEA_LEVEL, _LAPSE, _TEMPERATURE, _EXPONENT = 1013.25, 0.0065, 288.15, 5.25588  # hPa, K/m, K
_FREEZING = 273.15
_FREE_MEMORY = 524288  # bytes, as of a simulated ArduPilot
_SUPPLY = 5000  # mV
_UNKNOWN = 65535  # of a voltage
_SPACING = 100  # m between the points of a terrain grid
_FIELDS = 0x3F + 0x200 + 0x800 + 0x1000  # HIGHRES_IMU_UPDATED_FLAGS: acceleration, rates, pressure, height, temperature
_GOOD = 831  # EKF_STATUS_FLAGS with a position
_AIRSPEED_CRC, _AIRSPEED_LENGTH = 234, 12
_PITOT = 1.9936  # m2/(s2 Pa), ARSPD_RATIO
_USED = 2  # AIRSPEED_SENSOR_FLAGS
_SENSED = 5.0  # HIGH_LATENCY2 carries speeds in 0.2 m/s


@kernel
def _short(value: float) -> int:
    """Truncates `value` to an int16."""
    return int(min(max(value, -32768.0), 32767.0))


@kernel
def _byte(value: float) -> int:
    return int(min(max(value, 0.0), 255.0))


@kernel
def _milliseconds(t: float) -> int:
    return int(1e3 * t + 0.5)


@kernel
def _microseconds(t: float) -> int:
    return int(1e6 * t + 0.5)


@kernel
def _air(m: Any) -> tuple[float, float]:
    """Returns pressure [hPa] and temperature [degrees C]."""
    kelvin = _TEMPERATURE - _LAPSE * (m.origin_altitude - m.position[2])
    return float(_SEA_LEVEL * (kelvin / _TEMPERATURE) ** _EXPONENT), float(kelvin - _FREEZING)


@kernel
def _place(m: Any) -> tuple[int, int, float]:
    p = m.position
    lat, lon, alt = geodetic_from_local(p[0], p[1], p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    return deg_e7(lat), deg_e7(lon), alt


@kernel
def _angles(m: Any) -> tuple[float, float, float]:
    q = m.attitude
    return euler_from_quaternion((q[0], q[1], q[2], q[3]))


@kernel
def _way(m: Any) -> tuple[float, float, float]:
    """Returns bearing [deg] and distance [m] of the target, and how much higher it is [m]."""
    n, e = m.target[0] - m.position[0], m.target[1] - m.position[1]
    bearing = math.degrees(math.atan2(e, n)) % 360.0
    return bearing, math.sqrt(n * n + e * e), m.position[2] - m.target[2]


@kernel
def _put_inertial(m: Any, message: int, t: float) -> None:
    """Fills a message of accelerometer and gyro."""
    f, w = m.specific_force, m.angular_velocity
    if message == HIGHRES_IMU:
        hectopascal, celsius = _air(m)
        encode_highres_imu(
            m.payload, _microseconds(t), f[0], f[1], f[2], w[0], w[1], w[2], 0.0, 0.0, 0.0,
            hectopascal, 0.0, -m.position[2], celsius, _FIELDS, 0,
        )  # fmt: skip
        return
    g = 1000.0 / _GRAVITY
    x, y, z = _short(f[0] * g), _short(f[1] * g), _short(f[2] * g)
    p, q, r = _short(w[0] * 1000.0), _short(w[1] * 1000.0), _short(w[2] * 1000.0)
    if message == RAW_IMU:
        encode_raw_imu(m.payload, _microseconds(t), x, y, z, p, q, r, 0, 0, 0, 0, 0)
    else:
        encode_scaled_imu(m.payload, _milliseconds(t), x, y, z, p, q, r, 0, 0, 0, 0)


@kernel
def put_terrain(m: Any, lat: int, lon: int) -> None:
    """Fills TERRAIN_REPORT for a place [degE7]: the terrain is a plane at the altitude of the local origin."""
    encode_terrain_report(m.payload, lat, lon, _SPACING, m.origin_altitude, -m.position[2], 0, 0)


@kernel
def _put_summary(m: Any, t: float) -> None:
    """Fills HIGH_LATENCY2."""
    lat, lon, alt = _place(m)
    v = m.velocity
    speed = _byte(_SENSED * math.sqrt(v[0] * v[0] + v[1] * v[1]))
    yaw = math.degrees(_angles(m)[2]) % 360.0
    bearing, distance, higher = _way(m)
    celsius = _short(_air(m)[1])
    base = 1 + (128 - 256 if m.armed else 0) + (8 if m.autonomous else 64)
    encode_high_latency2(
        m.payload, _milliseconds(t), m.kind, 3, m.mode, lat, lon, _short(alt), _short(alt + higher),
        _byte(0.5 * yaw), _byte(0.5 * bearing), int(min(0.1 * distance, 65535.0)), 0, speed, 0, speed, 0, 0, 0, 0,
        celsius, int(min(max(-10.0 * v[2], -128.0), 127.0)), -1, m.mission_current, 0, base, 0, 0,
    )  # fmt: skip


@kernel
def _put_motion(m: Any, message: int, t: float) -> bool:
    """Fills a message derived from the motion; returns whether it is one of these."""
    roll, pitch, yaw = _angles(m)
    f, w, v = m.specific_force, m.angular_velocity, m.velocity
    lat, lon, alt = _place(m)
    if message == AHRS2:
        encode_ahrs2(m.payload, roll, pitch, yaw, alt, lat, lon)
    elif message == SIMSTATE:
        encode_simstate(m.payload, roll, pitch, yaw, f[0], f[1], f[2], w[0], w[1], w[2], lat, lon)
    elif message == TERRAIN_REPORT:
        put_terrain(m, lat, lon)
    elif message == NAV_CONTROLLER_OUTPUT:
        bearing, distance, higher = _way(m)
        whole = int(bearing)
        far = int(min(distance, 65535.0))
        encode_nav_controller_output(
            m.payload, math.degrees(roll), math.degrees(pitch), whole, whole, far, higher, 0.0, 0.0
        )
    elif message == AUTOPILOT_STATE_FOR_GIMBAL_DEVICE:
        good = _GOOD if t >= m.estimate_ready_time else 0
        landed = 1 if m.on_ground else 2
        encode_autopilot_state_for_gimbal_device(
            m.payload, 0, 0, _microseconds(t), 0, v[0], v[1], v[2], 0, w[2], good, landed, w[2]
        )
        for i in range(4):
            put_autopilot_state_for_gimbal_device_q(m.payload, i, m.attitude[i])
    elif message == HIGH_LATENCY2:
        _put_summary(m, t)
    else:
        return False
    return True


@kernel
def _put_battery(m: Any) -> None:
    """Fills BATTERY_STATUS; without a battery to measure, with unknown values."""
    volts = _UNKNOWN
    if m.battery_voltage > 0.0:
        volts = int(1e3 * m.battery_voltage + 0.5)
        amperes, used, left = int(1e2 * m.battery_current + 0.5), int(m.battery_used + 0.5), int(m.battery_left)
        charge = 1 + m.battery_alarm  # MAV_BATTERY_CHARGE_STATE
        encode_battery_status(m.payload, 0, 0, 0, 32767, amperes, used, -1, left, 0, charge, 0, 0)
    else:
        encode_battery_status(m.payload, 0, 0, 0, 32767, -1, -1, -1, -1, 0, 0, 0, 0)
    for i in range(10):
        put_battery_status_voltages(m.payload, i, volts if i == 0 else _UNKNOWN)


@kernel
def _put_channels(m: Any, t: float) -> None:
    """Fills RC_CHANNELS; a point mass has no receiver."""
    a, b, c, d, e, f, g, h, count = 0, 0, 0, 0, 0, 0, 0, 0, 0
    if m.kind != MAV_TYPE_QUADROTOR:
        a, b, c, d = pulse_of(m, 0, t), pulse_of(m, 1, t), pulse_of(m, 2, t), pulse_of(m, 3, t)
        e, f, g, h = pulse_of(m, 4, t), pulse_of(m, 5, t), pulse_of(m, 6, t), pulse_of(m, 7, t)
        count = 8
    encode_rc_channels(
        m.payload, _milliseconds(t), count, a, b, c, d, e, f, g, h, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255
    )  # fmt: skip


@kernel
def put_sensed(m: Any, message: int, t: float) -> bool:
    """Fills m.payload with one of these messages; returns whether `message` is one of them."""
    if message in (SCALED_IMU, SCALED_IMU2, SCALED_IMU3, RAW_IMU, HIGHRES_IMU):
        _put_inertial(m, message, t)
    elif message in (SCALED_PRESSURE, SCALED_PRESSURE2):
        hectopascal, celsius = _air(m)
        encode_scaled_pressure(m.payload, _milliseconds(t), hectopascal, 0.0, _short(100.0 * celsius), 0)
    elif message == RC_CHANNELS:
        _put_channels(m, t)
    elif message == POWER_STATUS:
        encode_power_status(m.payload, _SUPPLY, 0, 0)
    elif message == BATTERY_STATUS:
        _put_battery(m)
    elif message == MEMINFO:
        encode_meminfo(m.payload, 0, 65535, _FREE_MEMORY)
    elif message == AHRS:
        encode_ahrs(m.payload, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif message == HWSTATUS:
        encode_hwstatus(m.payload, _SUPPLY, 0)
    elif message == VIBRATION:
        encode_vibration(m.payload, _microseconds(t), 0.0, 0.0, 0.0, 0, 0, 0)
    elif message == FLIGHT_INFORMATION:
        armed_at = _microseconds(m.armed_at) if m.armed else 0
        encode_flight_information(m.payload, _milliseconds(t), armed_at, 0, 0, 0)
    elif message == WIND:
        n, e, d = m.wind_estimate[0], m.wind_estimate[1], m.wind_estimate[2]
        encode_wind(m.payload, math.degrees(math.atan2(-e, -n)), math.sqrt(n * n + e * e + d * d), d)
    elif message == RELAY_STATUS:
        encode_relay_status(m.payload, _milliseconds(t), 1 if m.relay_on else 0, 1)
    else:
        return _put_motion(m, message, t)
    return True


@kernel
def send_airspeed(m: Any) -> bool:
    """Sends AIRSPEED of a plane; true, too, if the vehicle has no such sensor.

    It is the velocity less the estimated wind, as a sensor calibrated for the sea level has it.
    """
    if m.kind in (MAV_TYPE_QUADROTOR, MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT):
        return True
    v, w = m.velocity, m.wind_estimate
    n, e, d = v[0] - w[0], v[1] - w[1], v[2] - w[2]
    hectopascal, celsius = _air(m)
    thin = hectopascal / _SEA_LEVEL * _TEMPERATURE / (celsius + _FREEZING)
    square = thin * (n * n + e * e + d * d)
    put_f32(m.payload, 0, math.sqrt(square))
    put_f32(m.payload, 4, 0.01 * square / _PITOT)
    put_i16(m.payload, 8, _short(100.0 * celsius))
    put_u8(m.payload, 10, 0)
    put_u8(m.payload, 11, _USED)
    return send_defined(m, AIRSPEED, _AIRSPEED_CRC, _AIRSPEED_LENGTH)
