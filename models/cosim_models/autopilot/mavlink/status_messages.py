"""Contents of messages on destination and measurements, the less frequent half of the telemetry.

Each kernel over the autopilot's record `m` appends one MAVLink packet; see `messages` for the others. There is no
magnetometer, so its fields in RAW_IMU are zero.

Sources: MAVLink common.xml; ArduPilot, GCS_Common and GCS_MAVLink_Copter; recorded telemetry of ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import deg_e7, euler_from_quaternion, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    BATTERY_STATUS,
    NAV_CONTROLLER_OUTPUT,
    POSITION_TARGET_GLOBAL_INT,
    POSITION_TARGET_LOCAL_NED,
    POWER_STATUS,
    RAW_IMU,
    RC_CHANNELS,
    RC_CHANNELS_CHAN1_RAW,
    RC_CHANNELS_CHANCOUNT,
    RC_CHANNELS_LENGTH,
    RC_CHANNELS_RSSI,
    RC_CHANNELS_TIME_BOOT_MS,
    SIMSTATE,
    encode_battery_status,
    encode_nav_controller_output,
    encode_position_target_global_int,
    encode_position_target_local_ned,
    encode_power_status,
    encode_raw_imu,
    encode_simstate,
    put_battery_status_voltages,
)
from cosim.packets import clear, put_u8, put_u16, put_u32
from cosim_models.autopilot.commander.battery import battery_remaining
from cosim_models.autopilot.control.position import GRAVITY
from cosim_models.autopilot.flight.sticks import channel
from cosim_models.autopilot.flight.terrain_following import destination_up
from cosim_models.autopilot.link.links import microseconds, milliseconds, send
from cosim_models.autopilot.mavlink.sensor_messages import short
from cosim_models.autopilot.record.modes import AUTO, GUIDED, POSITION, RTL, SMART_RTL
from cosim_models.autopilot.record.variables import CHANNELS

__all__ = [
    "going",
    "send_battery",
    "send_channels",
    "send_destination",
    "send_destination_ned",
    "send_imu",
    "send_navigation",
    "send_power",
    "send_simulated",
]


_ONLY_POSITION = 0xFDF8  # POSITION_TARGET_TYPEMASK, as ArduCopter fills it
_UNKNOWN = 65535
_UNKNOWN_RSSI = 255


@kernel
def going(m: Any) -> bool:
    """Returns whether the vehicle flies to a point, m.guided_position_neu."""
    flying = m.armed and not m.on_ground and m.submode == POSITION
    return bool(flying and (m.mode == GUIDED or m.mode == RTL or m.mode == AUTO or m.mode == SMART_RTL))


@kernel
def send_destination(m: Any, t: float) -> bool:
    """Sends POSITION_TARGET_GLOBAL_INT if there is a destination."""
    if not going(m):
        return True
    p = m.guided_position_neu
    lat, lon, alt = geodetic_from_local(
        p[0], p[1], -destination_up(m), m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    encode_position_target_global_int(
        m.payload,
        milliseconds(t),
        0,
        _ONLY_POSITION,
        deg_e7(lat),
        deg_e7(lon),
        alt,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    )
    return send(m, POSITION_TARGET_GLOBAL_INT)


@kernel
def send_destination_ned(m: Any, t: float) -> bool:
    """Sends POSITION_TARGET_LOCAL_NED if there is a destination."""
    if not going(m):
        return True
    p = m.guided_position_neu
    encode_position_target_local_ned(
        m.payload,
        milliseconds(t),
        1,
        _ONLY_POSITION,
        p[0],
        p[1],
        -destination_up(m),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    )
    return send(m, POSITION_TARGET_LOCAL_NED)


@kernel
def send_navigation(m: Any) -> bool:
    """Sends NAV_CONTROLLER_OUTPUT: attitude target, bearing and distance of the destination."""
    q = m.attitude_target
    roll, pitch, yaw = euler_from_quaternion((q[0], q[1], q[2], q[3]))
    bearing = math.degrees(yaw) % 360.0
    distance = 0.0
    climb = 0.0
    if going(m):
        n, e = m.guided_position_neu[0] - m.position_neu[0], m.guided_position_neu[1] - m.position_neu[1]
        distance = math.sqrt(n * n + e * e)
        bearing = math.degrees(math.atan2(e, n)) % 360.0
        climb = destination_up(m) - m.position_neu[2]
    whole = int(bearing)
    encode_nav_controller_output(
        m.payload, math.degrees(roll), math.degrees(pitch), whole, whole, int(min(distance, 65535.0)), climb, 0.0, 0.0
    )
    return send(m, NAV_CONTROLLER_OUTPUT)


@kernel
def send_imu(m: Any, t: float) -> bool:
    """Sends RAW_IMU: specific force [mG] and angular velocity [mrad/s], FRD."""
    f, w = m.specific_force, m.gyro
    g = 1000.0 / GRAVITY
    encode_raw_imu(
        m.payload,
        microseconds(t),
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
        0,
    )
    return send(m, RAW_IMU)


@kernel
def send_simulated(m: Any) -> bool:
    """Sends SIMSTATE: the true motion."""
    roll, pitch, yaw = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    f, w = m.specific_force, m.angular_velocity
    p = m.position
    lat, lon, _ = geodetic_from_local(p[0], p[1], p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    encode_simstate(m.payload, roll, pitch, yaw, f[0], f[1], f[2], w[0], w[1], w[2], deg_e7(lat), deg_e7(lon))
    return send(m, SIMSTATE)


@kernel
def send_battery(m: Any) -> bool:
    """Sends BATTERY_STATUS."""
    encode_battery_status(
        m.payload,
        0,
        0,
        0,
        32767,
        int(100.0 * m.battery_current + 0.5),
        int(m.battery_used),
        int(0.01 * m.battery_energy),
        battery_remaining(m),
        0,
        1 + m.battery_alarm,
        0,
        0,
    )
    put_battery_status_voltages(m.payload, 0, int(1000.0 * m.battery_voltage + 0.5))
    for i in range(1, 10):
        put_battery_status_voltages(m.payload, i, _UNKNOWN)
    return send(m, BATTERY_STATUS)


@kernel
def send_channels(m: Any, t: float) -> bool:
    """Sends RC_CHANNELS: the receiver's channels including overrides."""
    clear(m.payload, 0, RC_CHANNELS_LENGTH)
    put_u32(m.payload, RC_CHANNELS_TIME_BOOT_MS, milliseconds(t))
    count = 0
    for number in range(1, CHANNELS + 1):
        pulse = channel(m, number, t)
        put_u16(m.payload, RC_CHANNELS_CHAN1_RAW + 2 * (number - 1), pulse)
        if pulse != 0:
            count = number
    put_u8(m.payload, RC_CHANNELS_CHANCOUNT, count)
    put_u8(m.payload, RC_CHANNELS_RSSI, _UNKNOWN_RSSI)
    return send(m, RC_CHANNELS)


@kernel
def send_power(m: Any) -> bool:
    """Sends POWER_STATUS: the 5 V of a simulated board."""
    encode_power_status(m.payload, 5000, 0, 0)
    return send(m, POWER_STATUS)
