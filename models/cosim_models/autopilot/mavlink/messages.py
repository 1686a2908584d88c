"""Contents of the autopilot's messages: HEARTBEAT, streams, status texts and acknowledgements, as in ArduCopter.

Each kernel over the autopilot's record `m` appends one MAVLink packet to the send buffer of `m.link`. A buffer cannot
overflow: acknowledgements always fit, texts and answers leave room for the acknowledgements still to come, and streamed
messages that do not fit wait. The timing is in `telemetry` and `commands`.

Start-up follows ArduCopter's sequence, with times scaled so that the position estimate is ready at
`estimate_ready_time` (41.5 s in ArduCopter).

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common and GCS_MAVLink_Copter; recorded
conversations with ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.frames import deg_e7, euler_from_quaternion, geodetic_from_local, yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import (
    AHRS,
    AHRS2,
    ATTITUDE,
    AUTOPILOT_VERSION,
    BATTERY_STATUS,
    COMMAND_ACK,
    EKF_GPS_GLITCHING,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    FENCE_STATUS,
    GLOBAL_POSITION_INT,
    GPS_GLOBAL_ORIGIN,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    LOCAL_POSITION_NED,
    MAV_PROTOCOL_CAPABILITY_COMMAND_INT,
    MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION,
    MAV_PROTOCOL_CAPABILITY_FTP,
    MAV_PROTOCOL_CAPABILITY_MAVLINK2,
    MAV_PROTOCOL_CAPABILITY_MISSION_FENCE,
    MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT,
    MAV_PROTOCOL_CAPABILITY_MISSION_INT,
    MAV_PROTOCOL_CAPABILITY_MISSION_RALLY,
    MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT,
    MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET,
    MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT,
    MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED,
    MAV_SYS_STATUS_AHRS,
    MAV_SYS_STATUS_GEOFENCE,
    MAV_SYS_STATUS_PREARM_CHECK,
    MAV_SYS_STATUS_SENSOR_BATTERY,
    MAV_SYS_STATUS_SENSOR_GPS,
    MAV_SYS_STATUS_SENSOR_LASER_POSITION,
    MAV_SYS_STATUS_SENSOR_PROPULSION,
    MEMINFO,
    MESSAGE_INTERVAL,
    MISSION_CURRENT,
    NAV_CONTROLLER_OUTPUT,
    POSITION_TARGET_GLOBAL_INT,
    POSITION_TARGET_LOCAL_NED,
    POWER_STATUS,
    RAW_IMU,
    RC_CHANNELS,
    SCALED_IMU,
    SCALED_PRESSURE,
    SERVO_OUTPUT_RAW,
    SERVO_OUTPUT_RAW_SERVO1_RAW,
    SERVO_OUTPUT_RAW_SERVO9_RAW,
    SERVO_OUTPUT_RAW_TIME_USEC,
    SIMSTATE,
    SYS_STATUS,
    SYSTEM_TIME,
    TIMESYNC,
    VFR_HUD,
    VIBRATION,
    encode_attitude,
    encode_autopilot_version,
    encode_command_ack,
    encode_ekf_status_report,
    encode_extended_sys_state,
    encode_global_position_int,
    encode_gps_global_origin,
    encode_gps_raw_int,
    encode_heartbeat,
    encode_home_position,
    encode_local_position_ned,
    encode_message_interval,
    encode_sys_status,
    encode_system_time,
    encode_timesync,
    encode_vfr_hud,
    put_home_position_q,
)
from cosim.packets import clear, put_u16, put_u32
from cosim_models.autopilot.commander.battery import battery_remaining
from cosim_models.autopilot.commander.readiness import (
    AHRS_AT,
    EKF_AT,
    GPS_AT,
    HEARD_AT,
    attitude_ready,
    home_ready,
    prearm_ready,
    reached,
)
from cosim_models.autopilot.commander.sensors import told_by_gps
from cosim_models.autopilot.control.motors import GROUND_IDLE
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.state import landed_state, position_ready, reported_mode
from cosim_models.autopilot.link.links import microseconds, milliseconds, send
from cosim_models.autopilot.mavlink.requested_messages import send_requested
from cosim_models.autopilot.mavlink.sensor_messages import (
    send_ahrs,
    send_ahrs2,
    send_fence,
    send_memory,
    send_pressure,
    send_scaled_imu,
    send_vibration,
)
from cosim_models.autopilot.mavlink.status_messages import (
    send_battery,
    send_channels,
    send_destination,
    send_destination_ned,
    send_imu,
    send_navigation,
    send_power,
    send_simulated,
)
from cosim_models.autopilot.mission.missions import send_mission_current
from cosim_models.autopilot.record.modes import (
    AUTO,
    AUTO_RTL,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    GUIDED,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
)
from cosim_models.autopilot.record.streams import is_silent, message_of

__all__ = [
    "acknowledge",
    "answer_timesync",
    "send_heartbeat",
    "send_home",
    "send_message",
    "send_origin",
    "tell_interval",
]

_MULTICOPTER = 3  # MAV_VTOL_STATE_MC
_RAW_SERVOS = 16  # outputs in a SERVO_OUTPUT_RAW

_EKF_UNINITIALISED, _EKF_CONSTANT, _EKF_GOOD = 1024, 167, 831  # EKF_STATUS_FLAGS, as ArduCopter sets them
_PRESENT, _SENSORS, _HEALTHY = 0x5371FC0F, 0x52419C0F, 0x47519C0F  # as ArduCopter sets them, without GPS and AHRS
_POSITION_CONTROL = 0x6000  # altitude and position control: healthy, and enabled, when armed
_ENABLED_ARMED = _POSITION_CONTROL + 0x1000000  # and logging
_CAPABILITIES = (
    MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    + MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    + MAV_PROTOCOL_CAPABILITY_MISSION_INT
    + MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    + MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    + MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    + MAV_PROTOCOL_CAPABILITY_MAVLINK2
    + MAV_PROTOCOL_CAPABILITY_FTP
    + MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    + MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    + MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    + MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
)
_SOFTWARE = 0x04070000  # the emulated ArduCopter: 4.7-dev


# ---- answers and texts ---------------------------------------------------------------------------------------------


@kernel
def acknowledge(m: Any, command: int, result: int, system: int, component: int) -> None:
    """Sends COMMAND_ACK to the requester."""
    encode_command_ack(m.payload, command, result, 0, 0, system, component)
    send(m, COMMAND_ACK)


@kernel
def answer_timesync(m: Any, sent: int, t: float) -> None:
    """Sends TIMESYNC with the local time, for a request that was sent at `sent` [ns]."""
    encode_timesync(m.payload, microseconds(t) * 1000, sent)
    send(m, TIMESYNC)


@kernel
def tell_interval(m: Any, message: int, row: int) -> None:
    """Sends MESSAGE_INTERVAL: microseconds between messages, -1 if not sent, 0 if unknown."""
    interval = -1 if is_silent(message) else 0
    if row >= 0:
        seconds = m.interval[m.link, row]
        interval = int(seconds * 1e6 + 0.5) if seconds > 0.0 else -1
    encode_message_interval(m.payload, message, interval)
    send(m, MESSAGE_INTERVAL)


# ---- streamed messages ---------------------------------------------------------------------------------------------


@kernel
def send_heartbeat(m: Any, t: float) -> bool:
    mode = reported_mode(m)
    base_mode = 1 + 16 + 64
    if mode in (AUTO, AUTO_RTL, GUIDED, LOITER, RTL, CIRCLE, BRAKE, AVOID_ADSB, POSHOLD, SMART_RTL):
        base_mode += 8
    if m.armed or m.test_motor > 0:
        base_mode += 128
    state = (
        5
        if m.station_lost or m.radio_lost or m.fence_breach != 0 or m.battery_alarm != 0 or m.ekf_failed
        else 4
        if not m.on_ground
        else 3
        if reached(m, t, HEARD_AT)
        else 1
    )
    kind = 2 if m.motor_count == 4 else 13 if m.motor_count == 6 else 14
    encode_heartbeat(m.payload, kind, 3, base_mode, mode, state, 3)
    return send(m, HEARTBEAT)


@kernel
def _send_sys_status(m: Any, t: float) -> bool:
    present = _PRESENT
    more = 0
    if reached(m, t, GPS_AT):
        present += MAV_SYS_STATUS_SENSOR_GPS
        more += MAV_SYS_STATUS_SENSOR_GPS
    if reached(m, t, AHRS_AT):
        more += MAV_SYS_STATUS_AHRS
    enabled = _SENSORS + more
    health = _HEALTHY + more
    if m.armed:
        enabled += _ENABLED_ARMED
        health += _POSITION_CONTROL
    if m.ranging:
        present += MAV_SYS_STATUS_SENSOR_LASER_POSITION
        enabled += MAV_SYS_STATUS_SENSOR_LASER_POSITION
        health += MAV_SYS_STATUS_SENSOR_LASER_POSITION
    if m.armed or prearm_ready(m, t):
        health += MAV_SYS_STATUS_PREARM_CHECK
    if m.battery_alarm != 0:
        health -= MAV_SYS_STATUS_SENSOR_BATTERY
    if m.SIM_GPS1_ENABLE == 0 and reached(m, t, GPS_AT):
        health -= MAV_SYS_STATUS_SENSOR_GPS
    if m.position_lost and reached(m, t, AHRS_AT):
        health -= MAV_SYS_STATUS_AHRS
    if m.boosted:
        health -= MAV_SYS_STATUS_SENSOR_PROPULSION
    if m.FENCE_ENABLE != 0:
        enabled += MAV_SYS_STATUS_GEOFENCE
        if m.fence_breach != 0:
            health -= MAV_SYS_STATUS_GEOFENCE
    encode_sys_status(
        m.payload,
        present,
        enabled,
        health,
        0,
        int(1000.0 * m.battery_voltage + 0.5),
        int(100.0 * m.battery_current + 0.5),
        battery_remaining(m),
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    )
    return send(m, SYS_STATUS)


@kernel
def _place(m: Any) -> tuple[int, int, float]:
    """Returns latitude and longitude in 1e-7 degrees, altitude AMSL in m."""
    p = m.position_neu
    lat, lon, alt = geodetic_from_local(p[0], p[1], -p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    return deg_e7(lat), deg_e7(lon), alt


_NO_FIX, _RTK_FIXED, _SATELLITES = 1, 6, 10


@kernel
def _send_gps_raw(m: Any, t: float) -> bool:
    if not reached(m, t, GPS_AT) or m.SIM_GPS1_ENABLE == 0:
        encode_gps_raw_int(m.payload, 0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        return send(m, GPS_RAW_INT)
    lat, lon, alt = _place(m)
    fix, satellites = _RTK_FIXED, _SATELLITES
    vn, ve = m.velocity_neu[0], m.velocity_neu[1]
    if m.sim_on:
        lat, lon, alt = told_by_gps(m)
        vn, ve = m.velocity[0] + m.told_speed[0], m.velocity[1] + m.told_speed[1]
        if m.gps_jammed:
            satellites = int(m.gps_satellites)
            fix = _RTK_FIXED if m.gps_heard else _NO_FIX
    course = math.degrees(math.atan2(ve, vn)) % 360.0
    speed = math.sqrt(vn * vn + ve * ve)
    micros = microseconds(t)
    height = int(np.int64(math.floor(alt * 1e3 + 0.5)))
    encode_gps_raw_int(
        m.payload,
        micros,
        fix,
        lat,
        lon,
        height,
        121,
        200,
        int(speed * 100.0),
        int(course * 100.0) % 36000,
        satellites,
        height,
        300,
        300,
        0,
        0,
        0,
    )
    return send(m, GPS_RAW_INT)


@kernel
def _send_attitude(m: Any, t: float) -> bool:
    roll, pitch, yaw = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    encode_attitude(m.payload, milliseconds(t), roll, pitch, yaw, m.gyro[0], m.gyro[1], m.gyro[2])
    return send(m, ATTITUDE)


@kernel
def _send_local_position(m: Any, t: float) -> bool:
    if not position_ready(m, t):
        return True
    p, v = m.position_neu, m.velocity_neu
    encode_local_position_ned(m.payload, milliseconds(t), p[0], p[1], -p[2], v[0], v[1], -v[2])
    return send(m, LOCAL_POSITION_NED)


@kernel
def _send_global_position(m: Any, t: float) -> bool:
    lat, lon, alt = 0, 0, 0.0
    if home_ready(m, t):
        lat, lon, alt = _place(m)
    heading = math.degrees(yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))) % 360.0
    encode_global_position_int(
        m.payload,
        milliseconds(t),
        lat,
        lon,
        int(np.int64(math.floor(alt * 1e3 + 0.5))),
        int(np.int64(math.floor((m.position_neu[2] - m.home_neu[2]) * 1e3 + 0.5))),
        int(m.velocity_neu[0] * 100.0),
        int(m.velocity_neu[1] * 100.0),
        int(-m.velocity_neu[2] * 100.0),
        int(heading * 100.0) % 36000,
    )
    return send(m, GLOBAL_POSITION_INT)


@kernel
def _send_vfr_hud(m: Any) -> bool:
    speed = math.sqrt(m.velocity_neu[0] * m.velocity_neu[0] + m.velocity_neu[1] * m.velocity_neu[1])
    heading = int(math.degrees(yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))) % 360.0)
    throttle = 0 if m.spool_state <= GROUND_IDLE else int(m.throttle_out * 100.0)
    encode_vfr_hud(m.payload, speed, speed, heading, throttle, m.origin_altitude + m.position_neu[2], m.velocity_neu[2])
    return send(m, VFR_HUD)


@kernel
def _send_ekf_status(m: Any, t: float) -> bool:
    flags = 0 if reached(m, t, EKF_AT) else _EKF_UNINITIALISED
    if position_ready(m, t):
        flags = _EKF_GOOD
    elif attitude_ready(m, t):
        flags = _EKF_CONSTANT
    if m.glitching:
        flags += EKF_GPS_GLITCHING
    encode_ekf_status_report(m.payload, flags, m.velocity_ratio, m.position_ratio, m.height_ratio, 0.0, 0.0, 0.0)
    return send(m, EKF_STATUS_REPORT)


@kernel
def send_home(m: Any, t: float) -> bool:
    if not home_ready(m, t):
        return True
    lat, lon, alt = geodetic_from_local(
        m.home_neu[0], m.home_neu[1], -m.home_neu[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    micros = microseconds(t)
    height = int(np.int64(math.floor(alt * 1e3 + 0.5)))
    encode_home_position(
        m.payload, deg_e7(lat), deg_e7(lon), height, m.home_neu[0], m.home_neu[1], -m.home_neu[2], 0.0, 0.0, 0.0, micros
    )
    for i in range(4):
        put_home_position_q(m.payload, i, math.nan)
    return send(m, HOME_POSITION)


@kernel
def send_origin(m: Any, t: float) -> bool:
    if not home_ready(m, t):
        return True
    height = int(np.int64(math.floor(m.origin_altitude * 1e3 + 0.5)))
    micros = microseconds(t)
    encode_gps_global_origin(m.payload, deg_e7(m.origin_latitude), deg_e7(m.origin_longitude), height, micros)
    return send(m, GPS_GLOBAL_ORIGIN)


@kernel
def _send_version(m: Any) -> bool:
    clear(m.payload, 0, 78)
    encode_autopilot_version(m.payload, _CAPABILITIES, _SOFTWARE, 0, 0, 0, 0, 0, m.SYSID_THISMAV)
    return send(m, AUTOPILOT_VERSION)


@kernel
def _send_servos(m: Any, t: float) -> bool:
    clear(m.payload, 0, 37)
    put_u32(m.payload, SERVO_OUTPUT_RAW_TIME_USEC, microseconds(t) % 4294967296)
    least, most = clip(m.MOT_PWM_MIN, 0.0, 65535.0), clip(m.MOT_PWM_MAX, 0.0, 65535.0)
    for i in range(m.motor_count):
        put_u16(m.payload, SERVO_OUTPUT_RAW_SERVO1_RAW + 2 * i, int(least + m.motor[i] * (most - least) + 0.5))
    for i in range(m.motor_count, _RAW_SERVOS):
        more = 2 * (i - 8) + SERVO_OUTPUT_RAW_SERVO9_RAW if i >= 8 else 2 * i + SERVO_OUTPUT_RAW_SERVO1_RAW
        put_u16(m.payload, more, m.servo[i])
    return send(m, SERVO_OUTPUT_RAW)


@kernel
def send_message(m: Any, row: int, t: float) -> bool:
    """Sends the message of a row of STREAMS; True if it was sent, or if there is nothing to report yet."""
    message = message_of(row)
    if message == GLOBAL_POSITION_INT:
        return _send_global_position(m, t)
    if message == ATTITUDE:
        return _send_attitude(m, t)
    if message == LOCAL_POSITION_NED:
        return _send_local_position(m, t)
    if message == SYS_STATUS:
        return _send_sys_status(m, t)
    if message == GPS_RAW_INT:
        return _send_gps_raw(m, t)
    if message == VFR_HUD:
        return _send_vfr_hud(m)
    if message == EKF_STATUS_REPORT:
        return _send_ekf_status(m, t)
    if message == SYSTEM_TIME:
        encode_system_time(m.payload, 0, milliseconds(t))
        return send(m, SYSTEM_TIME)
    if message == SERVO_OUTPUT_RAW:
        return _send_servos(m, t)
    if message == AHRS2:
        return send_ahrs2(m)
    if message == AHRS:
        return send_ahrs(m)
    if message == VIBRATION:
        return send_vibration(m, t)
    if message == MEMINFO:
        return send_memory(m)
    if message == SCALED_IMU:
        return send_scaled_imu(m, t)
    if message == SCALED_PRESSURE:
        return send_pressure(m, t)
    if message == FENCE_STATUS:
        return send_fence(m)
    if message == RC_CHANNELS:
        return send_channels(m, t)
    if message == EXTENDED_SYS_STATE:
        encode_extended_sys_state(m.payload, _MULTICOPTER, landed_state(m))
        return send(m, EXTENDED_SYS_STATE)
    if message == HOME_POSITION:
        return send_home(m, t)
    if message == GPS_GLOBAL_ORIGIN:
        return send_origin(m, t)
    if message == AUTOPILOT_VERSION:
        return _send_version(m)
    if message == POWER_STATUS:
        return send_power(m)
    if message == NAV_CONTROLLER_OUTPUT:
        return send_navigation(m)
    if message == POSITION_TARGET_GLOBAL_INT:
        return send_destination(m, t)
    if message == POSITION_TARGET_LOCAL_NED:
        return send_destination_ned(m, t)
    if message == BATTERY_STATUS:
        return send_battery(m)
    if message == RAW_IMU:
        return send_imu(m, t)
    if message == SIMSTATE:
        return send_simulated(m)
    if message == MISSION_CURRENT:
        return send_mission_current(m)
    if message == HEARTBEAT:
        return send_heartbeat(m, t)
    return send_requested(m, message, t)
