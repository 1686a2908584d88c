"""Contents of messages that ground stations ask for: targets, further sensors, terrain, and summaries.

Each kernel over the autopilot's record `m` appends one MAVLink packet; see `messages` for the others. The second and
third sensors measure the same as the first. The wind is the one given by EXTERNAL_WIND_ESTIMATE, since there is no
estimate.

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common and GCS_MAVLink_Copter.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import deg_e7, geodetic_from_local, local_from_geodetic, radians_from_deg_e7, yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import (
    ATTITUDE_QUATERNION,
    ATTITUDE_TARGET,
    AUTOPILOT_STATE_FOR_GIMBAL_DEVICE,
    DISTANCE_SENSOR,
    FLIGHT_INFORMATION,
    HIGH_LATENCY2,
    HIGHRES_IMU,
    HWSTATUS,
    LOG_ENTRY,
    LOG_REQUEST_LIST,
    RANGEFINDER,
    RELAY_STATUS,
    SCALED_IMU2,
    SCALED_IMU3,
    SCALED_PRESSURE2,
    TERRAIN_REPORT,
    WIND,
    encode_attitude_quaternion,
    encode_attitude_target,
    encode_autopilot_state_for_gimbal_device,
    encode_distance_sensor,
    encode_flight_information,
    encode_high_latency2,
    encode_highres_imu,
    encode_hwstatus,
    encode_log_entry,
    encode_rangefinder,
    encode_relay_status,
    encode_terrain_report,
    encode_wind,
    put_attitude_target_q,
    put_autopilot_state_for_gimbal_device_q,
)
from cosim_models.autopilot.commander.battery import battery_remaining
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.state import landed_state, position_ready, reported_mode
from cosim_models.autopilot.flight.terrain_following import destination_up
from cosim_models.autopilot.link.available_modes import (
    AVAILABLE_MODES,
    AVAILABLE_MODES_MONITOR,
    COPTER_MODES,
    MODES_CRC,
    MODES_LENGTH,
    MONITOR_CRC,
    MONITOR_LENGTH,
    next_mode,
    put_mode,
)
from cosim_models.autopilot.link.links import can_answer, microseconds, milliseconds, send, send_defined
from cosim_models.autopilot.link.statustext import ERROR, LOG_DISARM, NO_NUMBER, say_here
from cosim_models.autopilot.mavlink.sensor_messages import fill_pressure, fill_scaled_imu, pressure
from cosim_models.autopilot.mavlink.status_messages import going
from cosim_models.autopilot.mission.terrain import ranged_distance, terrain_above_origin

__all__ = ["answer_log_request", "send_requested", "send_terrain"]

# HIGHRES_IMU_UPDATED_FLAGS: accelerations and rates, pressure, height, temperature.
_FIELDS = 0x3F + 0x200 + 0x800 + 0x1000
_SPACING = 100  # m between the points of a terrain grid
_SUPPLY = 5000  # mV
_GOOD = 831  # EKF_STATUS_FLAGS with a position
_DOWN = 25  # MAV_SENSOR_ROTATION_PITCH_270
_UNKNOWN_SENSOR = 4  # MAV_DISTANCE_SENSOR_UNKNOWN
_SENSED = 5.0  # HIGH_LATENCY2 carries speeds in 0.2 m/s


@kernel
def send_terrain(m: Any, lat: int, lon: int) -> bool:
    """Sends TERRAIN_REPORT for a place [degE7]."""
    n, e, _ = local_from_geodetic(
        radians_from_deg_e7(lat), radians_from_deg_e7(lon), 0.0, m.origin_latitude, m.origin_longitude, 0.0
    )
    altitude = m.origin_altitude + terrain_above_origin(m, n, e)
    p = m.position_neu
    spacing = int(m.terrain_spacing) if m.terrain_spacing >= 1.0 else _SPACING
    encode_terrain_report(
        m.payload, lat, lon, min(spacing, 65535), altitude, p[2] - terrain_above_origin(m, p[0], p[1]), 0, 0
    )
    return send(m, TERRAIN_REPORT)


@kernel
def answer_log_request(m: Any, message: int) -> None:
    """Answers LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_ERASE and LOG_REQUEST_END, with no logs on board.

    While it is armed, it says once that logs are for later. A run with `--dataflash` answers in its place.
    """
    if m.armed:
        if not m.log_told:
            say_here(m, ERROR, LOG_DISARM, NO_NUMBER)
        m.log_told = True
        return
    m.log_told = False
    if message == LOG_REQUEST_LIST and can_answer(m):
        encode_log_entry(m.payload, 0, 0, 0, 0, 0)
        send(m, LOG_ENTRY)


@kernel
def _place(m: Any) -> tuple[int, int, float]:
    p = m.position_neu
    lat, lon, alt = geodetic_from_local(p[0], p[1], -p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    return deg_e7(lat), deg_e7(lon), alt


@kernel
def _heading(m: Any) -> float:
    """Returns the heading [deg], 0 to 360."""
    return float(math.degrees(yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))) % 360.0)


@kernel
def _send_attitude_target(m: Any, t: float) -> bool:
    w = m.rate_target
    encode_attitude_target(m.payload, milliseconds(t), 0, w[0], w[1], w[2], m.throttle_in)
    for i in range(4):
        put_attitude_target_q(m.payload, i, m.attitude_target[i])
    return send(m, ATTITUDE_TARGET)


@kernel
def _send_quaternion(m: Any, t: float) -> bool:
    q, w = m.q, m.gyro
    encode_attitude_quaternion(m.payload, milliseconds(t), q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    return send(m, ATTITUDE_QUATERNION)


@kernel
def _send_highres(m: Any, t: float) -> bool:
    f, w = m.specific_force, m.gyro
    hectopascal, celsius = pressure(m)
    up = m.position_neu[2]
    encode_highres_imu(
        m.payload,
        microseconds(t),
        f[0],
        f[1],
        f[2],
        w[0],
        w[1],
        w[2],
        0.0,
        0.0,
        0.0,
        hectopascal,
        0.0,
        up,
        celsius,
        _FIELDS,
        0,
    )
    return send(m, HIGHRES_IMU)


@kernel
def _send_wind(m: Any) -> bool:
    """Sends WIND: the direction from which it blows [deg], and its speed."""
    n, e = m.wind_ne[0], m.wind_ne[1]
    encode_wind(m.payload, math.degrees(math.atan2(-e, -n)), math.sqrt(n * n + e * e), 0.0)
    return send(m, WIND)


@kernel
def _byte(value: float) -> int:
    return int(clip(value, 0.0, 255.0))


@kernel
def _send_summary(m: Any, t: float) -> bool:
    """Sends HIGH_LATENCY2."""
    lat, lon, alt = _place(m)
    v = m.velocity_neu
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
    bearing, distance, higher = _heading(m), 0.0, 0.0
    if going(m):
        n, e = m.guided_position_neu[0] - m.position_neu[0], m.guided_position_neu[1] - m.position_neu[1]
        bearing, distance = math.degrees(math.atan2(e, n)) % 360.0, math.sqrt(n * n + e * e)
        higher = destination_up(m) - m.position_neu[2]
    wind = math.sqrt(m.wind_ne[0] ** 2 + m.wind_ne[1] ** 2)
    blows = math.degrees(math.atan2(-m.wind_ne[1], -m.wind_ne[0])) % 360.0
    celsius = pressure(m)[1]
    kind = 2 if m.motor_count == 4 else 13 if m.motor_count == 6 else 14
    base = 1 + 16 + 64 + (128 if m.armed else 0)
    encode_high_latency2(
        m.payload,
        milliseconds(t),
        kind,
        3,
        reported_mode(m),
        lat,
        lon,
        int(clip(alt, -32768.0, 32767.0)),
        int(clip(alt + higher, -32768.0, 32767.0)),
        _byte(0.5 * _heading(m)),
        _byte(0.5 * bearing),
        int(clip(0.1 * distance, 0.0, 65535.0)),
        _byte(100.0 * m.throttle_out),
        _byte(_SENSED * speed),
        _byte(_SENSED * math.sqrt(m.target_velocity_neu[0] ** 2 + m.target_velocity_neu[1] ** 2)),
        _byte(_SENSED * speed),
        _byte(_SENSED * wind),
        _byte(0.5 * blows),
        0,
        0,
        int(clip(celsius, -128.0, 127.0)),
        int(clip(10.0 * v[2], -128.0, 127.0)),
        battery_remaining(m),
        m.mission_current,
        0,
        base - 256 if base > 127 else base,
        0,
        0,
    )
    return send(m, HIGH_LATENCY2)


@kernel
def _send_flight(m: Any, t: float) -> bool:
    """Sends FLIGHT_INFORMATION: times since start-up, and the number of flights."""
    armed_at = microseconds(m.armed_at) if m.armed else 0
    flown_since = microseconds(m.flown_since) if m.armed and not m.on_ground else 0
    encode_flight_information(m.payload, milliseconds(t), armed_at, flown_since, m.flights, 0)
    return send(m, FLIGHT_INFORMATION)


@kernel
def _send_state(m: Any, t: float) -> bool:
    """Sends AUTOPILOT_STATE_FOR_GIMBAL_DEVICE."""
    v = m.velocity_neu
    status = _GOOD if position_ready(m, t) else 0
    encode_autopilot_state_for_gimbal_device(
        m.payload,
        0,
        0,
        microseconds(t),
        0,
        v[0],
        v[1],
        -v[2],
        0,
        m.rate_target[2],
        status,
        landed_state(m),
        m.gyro[2],
    )
    for i in range(4):
        put_autopilot_state_for_gimbal_device_q(m.payload, i, m.q[i])
    return send(m, AUTOPILOT_STATE_FOR_GIMBAL_DEVICE)


@kernel
def _send_mode(m: Any) -> bool:
    """Sends AVAILABLE_MODES, if one has been asked for."""
    if not can_answer(m):
        return False
    index = next_mode(m, COPTER_MODES)
    if index == 0:
        return True
    put_mode(m.payload, COPTER_MODES, index)
    return send_defined(m, AVAILABLE_MODES, MODES_CRC, MODES_LENGTH)


@kernel
def _send_distance(m: Any, message: int, t: float) -> bool:
    """Sends RANGEFINDER or DISTANCE_SENSOR, if there is a rangefinder."""
    if not m.ranging:
        return True
    distance = ranged_distance(m)
    if message == RANGEFINDER:
        encode_rangefinder(m.payload, distance, 0.0)
        return send(m, RANGEFINDER)
    least, most = int(min(100.0 * m.RNGFND1_MIN, 65535.0)), int(min(100.0 * m.RNGFND1_MAX, 65535.0))
    here = int(min(100.0 * distance, 65535.0))
    encode_distance_sensor(m.payload, milliseconds(t), least, most, here, _UNKNOWN_SENSOR, 0, _DOWN, 0, 0.0, 0.0, 0)
    return send(m, DISTANCE_SENSOR)


@kernel
def send_requested(m: Any, message: int, t: float) -> bool:
    """Sends one of these messages, given by its id; returns whether it fitted."""
    if message in (SCALED_IMU2, SCALED_IMU3):
        fill_scaled_imu(m, t)
        return send(m, message)
    if message == SCALED_PRESSURE2:
        fill_pressure(m, t)
        return send(m, message)
    if message == WIND:
        return _send_wind(m)
    if message == TERRAIN_REPORT:
        lat, lon, _ = _place(m)
        return send_terrain(m, lat, lon)
    if message in (RANGEFINDER, DISTANCE_SENSOR):
        return _send_distance(m, message, t)
    if message == ATTITUDE_QUATERNION:
        return _send_quaternion(m, t)
    if message == ATTITUDE_TARGET:
        return _send_attitude_target(m, t)
    if message == HIGHRES_IMU:
        return _send_highres(m, t)
    if message == HIGH_LATENCY2:
        return _send_summary(m, t)
    if message == FLIGHT_INFORMATION:
        return _send_flight(m, t)
    if message == AUTOPILOT_STATE_FOR_GIMBAL_DEVICE:
        return _send_state(m, t)
    if message == AVAILABLE_MODES:
        return _send_mode(m)
    if message == AVAILABLE_MODES_MONITOR:
        m.payload[0] = 0  # the modes never change
        return send_defined(m, AVAILABLE_MODES_MONITOR, MONITOR_CRC, MONITOR_LENGTH)
    if message == RELAY_STATUS:
        encode_relay_status(m.payload, milliseconds(t), 1 if m.relay_on else 0, 1)
        return send(m, RELAY_STATUS)
    encode_hwstatus(m.payload, _SUPPLY, 0)
    return send(m, HWSTATUS)
