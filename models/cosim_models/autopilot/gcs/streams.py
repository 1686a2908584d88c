"""Messages of the small autopilots: HEARTBEAT once a second and at every change, streams at the requested rates.

Kernels over the record that `gcs.record` declares. The contents are those of `Autopilot`; a new link gets only
HEARTBEAT, as in ArduCopter. (ArduRover and ArduPlane send all streams at 1 Hz, which would fill the radio of a swarm.)

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from cosim.frames import (
    deg_e7,
    geodetic_from_local,
    quaternion_from_euler,
    roll_pitch_from_quaternion,
    yaw_from_quaternion,
)
from cosim.kernel import kernel
from cosim.messages import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    ATTITUDE_TARGET,
    AUTOPILOT_VERSION,
    BATTERY_STATUS,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_GLOBAL_ORIGIN,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    LOCAL_POSITION_NED,
    MAV_PROTOCOL_CAPABILITY_COMMAND_INT,
    MAV_PROTOCOL_CAPABILITY_MAVLINK2,
    MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT,
    MAV_PROTOCOL_CAPABILITY_MISSION_INT,
    MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT,
    MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT,
    MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED,
    MAV_SEVERITY_INFO,
    MAV_STATE_ACTIVE,
    MAV_STATE_CRITICAL,
    MAV_STATE_STANDBY,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
    MISSION_CURRENT,
    SERVO_OUTPUT_RAW,
    SYS_STATUS,
    TERRAIN_REPORT,
    VFR_HUD,
    WIND,
    encode_attitude,
    encode_attitude_quaternion,
    encode_attitude_target,
    encode_autopilot_version,
    encode_ekf_status_report,
    encode_extended_sys_state,
    encode_global_position_int,
    encode_gps_global_origin,
    encode_gps_raw_int,
    encode_heartbeat,
    encode_home_position,
    encode_local_position_ned,
    encode_mission_current,
    encode_servo_output_raw,
    encode_sys_status,
    encode_system_time,
    encode_vfr_hud,
    put_attitude_target_q,
    put_home_position_q,
)
from cosim.packets import clear
from cosim_models.autopilot.gcs.devices import continue_repetition
from cosim_models.autopilot.gcs.modes import MODES_INTERVAL, NEVER, send_modes
from cosim_models.autopilot.gcs.rows import AIRSPEED, MODES_ROW, ROWS, message_of
from cosim_models.autopilot.gcs.sending import send
from cosim_models.autopilot.gcs.sensors import put_sensed, send_airspeed
from cosim_models.autopilot.gcs.words import ARMED, DISARMED, say
from cosim_models.autopilot.link.available_modes import AVAILABLE_MODES, AVAILABLE_MODES_MONITOR

__all__ = ["heading", "put_mission_current", "ready", "send_message", "set_interval", "start_streams", "stream"]

_SLACK = 1e-9  # s
_SENSORS = 0x20002F  # MAV_SYS_STATUS_SENSOR: gyroscope, accelerometer, compass, barometer, GPS, AHRS
_BATTERY = 0x2000000
_PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_EKF_GOOD, _EKF_CONSTANT = 831, 167  # EKF_STATUS_FLAGS, as ArduPilot sets them
_CAPABILITIES = (
    MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    + MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    + MAV_PROTOCOL_CAPABILITY_MISSION_INT
    + MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    + MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    + MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    + MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_SOFTWARE = 0x04070000

# numba recompiles a kernel for every Python integer passed as a constant, but only once for all numpy integers.
_HEARTBEAT = cast(int, np.int64(HEARTBEAT))
_ATTITUDE_TARGET = cast(int, np.int64(ATTITUDE_TARGET))


@kernel
def ready(m: Any, t: float) -> bool:
    """Returns whether the position is known."""
    return bool(t >= m.estimate_ready_time - _SLACK)


@kernel
def heading(m: Any) -> float:
    """Returns the heading [rad], clockwise from north."""
    return yaw_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))


@kernel
def _place(m: Any, p: Any) -> tuple[int, int, int]:
    """Returns latitude and longitude in degE7 and altitude above sea [mm] of a position in NED."""
    lat, lon, alt = geodetic_from_local(p[0], p[1], p[2], m.origin_latitude, m.origin_longitude, m.origin_altitude)
    return deg_e7(lat), deg_e7(lon), int(np.int64(math.floor(alt * 1e3 + 0.5)))


@kernel
def put_mission_current(m: Any) -> None:
    """Fills m.payload with a MISSION_CURRENT: the item and its state, as ArduPilot tells them."""
    count = max(m.mission_count, 1) - 1
    state = 1 if count == 0 else 5 if m.mission_done else 3 if m.mission_active else 2
    encode_mission_current(m.payload, m.mission_current, count, state, 1 if m.mission_active else 2)


@kernel
def _pulse(command: float) -> int:
    return int(1000.0 + 1000.0 * command + 0.5)


@kernel
def _put_servos(m: Any, surface: bool, t: float) -> None:
    """Fills m.payload with a SERVO_OUTPUT_RAW by the default outputs of ArduRover and ArduPlane."""
    s = m.servo
    a, b, c, d = _pulse(m.motor[0]), _pulse(m.motor[1]), _pulse(m.motor[2]), _pulse(m.motor[3])
    e, f, g, h = _pulse(m.motor[4]), _pulse(m.motor[5]), _pulse(m.motor[6]), _pulse(m.motor[7])
    if surface:
        a, b, c, d, e, f, g, h = a, s[1], b, s[3], s[4], s[5], s[6], s[7]
    elif m.kind != MAV_TYPE_QUADROTOR and not m.lifts:
        e, f, g, h = s[4], s[5], s[6], s[7]
    microseconds = int(1e6 * t + 0.5)
    encode_servo_output_raw(
        m.payload, microseconds, 0, a, b, c, d, e, f, g, h, s[8], s[9], s[10], s[11], s[12], s[13], s[14], s[15]
    )


@kernel
def _put_status(m: Any, t: float) -> None:
    """Fills m.payload with a SYS_STATUS."""
    flies = m.kind not in (MAV_TYPE_QUADROTOR, MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
    passes = (m.armed or m.checks_passed) if flies else ready(m, t)
    health = _SENSORS + (_PREARM if passes else 0)
    present = _SENSORS + _PREARM
    volts, amperes, left = 65535, -1, -1
    if m.battery_voltage > 0.0:
        volts, amperes = int(1e3 * m.battery_voltage + 0.5), int(1e2 * m.battery_current + 0.5)
        left = int(m.battery_left)
        present += _BATTERY
        health += _BATTERY if m.battery_alarm == 0 else 0
    encode_sys_status(m.payload, present, present, health, 0, volts, amperes, left, 0, 0, 0, 0, 0, 0, 0, 0, 0)


@kernel
def _send_attitude_target(m: Any, t: float) -> bool:
    """Sends the attitude that the lifting rotors hold; true, too, if there are none that turn."""
    roll, pitch, yaw, thrust = m.attitude_asked[0], m.attitude_asked[1], m.attitude_asked[2], m.attitude_asked[3]
    if thrust <= 0.0:
        return True
    encode_attitude_target(m.payload, int(1e3 * t + 0.5), 0, 0.0, 0.0, 0.0, thrust)
    q = quaternion_from_euler(roll, pitch, yaw)
    for i in range(4):
        put_attitude_target_q(m.payload, i, q[i])
    return send(m, _ATTITUDE_TARGET)


@kernel
def _send_state(m: Any, row: int, t: float) -> bool:
    """Sends the messages on the autopilot itself."""
    message = message_of(row)
    surface = m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
    if message == ATTITUDE_TARGET:
        return _send_attitude_target(m, t)
    if message == HEARTBEAT:
        base_mode = 1 + (128 if m.armed else 0) + (8 if m.autonomous else 64)
        active = m.armed if surface else not m.on_ground
        state = MAV_STATE_CRITICAL if m.critical else MAV_STATE_ACTIVE if active else MAV_STATE_STANDBY
        encode_heartbeat(m.payload, m.kind, 3, base_mode, m.mode, state, 3)
    elif message == SYS_STATUS:
        _put_status(m, t)
    elif message == EKF_STATUS_REPORT:
        good = ready(m, t) and not m.position_lost
        encode_ekf_status_report(m.payload, _EKF_GOOD if good else _EKF_CONSTANT, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif message == EXTENDED_SYS_STATE:
        landed = 0 if surface else 1 if m.on_ground else 3 if m.taking_off else 2
        encode_extended_sys_state(m.payload, m.vtol_state, landed)
    elif message == AUTOPILOT_VERSION:
        clear(m.payload, 0, 78)
        encode_autopilot_version(m.payload, _CAPABILITIES, _SOFTWARE, 0, 0, 0, 0, 0, m.SYSID_THISMAV)
    elif message == MISSION_CURRENT:
        put_mission_current(m)
    elif message == SERVO_OUTPUT_RAW:
        _put_servos(m, surface, t)
    elif (surface and message == TERRAIN_REPORT) or (
        m.lifts and message == BATTERY_STATUS and m.battery_voltage == 0.0
    ):
        return True  # a rover needs no terrain; without a battery monitor, ArduPilot's quadplane says nothing
    elif message == WIND and (surface or m.kind == MAV_TYPE_QUADROTOR):
        return True
    elif not put_sensed(m, message, t):
        encode_system_time(m.payload, 0, int(1e3 * t + 0.5))
    return send(m, message)


@kernel
def _send_motion(m: Any, row: int, t: float) -> bool:
    """Sends the messages on the motion of the vehicle; true, too, if there is nothing to report yet."""
    message = message_of(row)
    known = ready(m, t)
    if not known and message in (LOCAL_POSITION_NED, HOME_POSITION, GPS_GLOBAL_ORIGIN):
        return True
    p, v = m.position, m.velocity
    lat, lon, alt = _place(m, m.home if message == HOME_POSITION else p)
    if not known:
        lat, lon, alt = 0, 0, 0
    yaw = math.degrees(heading(m)) % 360.0
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
    milliseconds = int(1e3 * t + 0.5)
    if message == GLOBAL_POSITION_INT:
        above_home = int(np.int64(math.floor((m.home[2] - p[2]) * 1e3 + 0.5)))
        vx, vy, vz = int(v[0] * 100.0), int(v[1] * 100.0), int(v[2] * 100.0)
        encode_global_position_int(m.payload, milliseconds, lat, lon, alt, above_home, vx, vy, vz, int(yaw * 100.0))
    elif message == GPS_RAW_INT:
        course = int(math.degrees(math.atan2(v[1], v[0])) % 360.0 * 100.0) % 36000
        fix = 6 if known and not m.gps_silent else 0
        speed_cm = int(speed * 100.0)
        encode_gps_raw_int(
            m.payload, int(1e6 * t + 0.5), fix, lat, lon, alt, 121, 200, speed_cm, course, 10, alt, 300, 300, 0, 0, 0
        )
    elif message == LOCAL_POSITION_NED:
        encode_local_position_ned(m.payload, milliseconds, p[0], p[1], p[2], v[0], v[1], v[2])
    elif message == ATTITUDE:
        roll, pitch = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
        w = m.angular_velocity
        encode_attitude(m.payload, milliseconds, roll, pitch, heading(m), w[0], w[1], w[2])
    elif message == ATTITUDE_QUATERNION:
        q, w = m.attitude, m.angular_velocity
        encode_attitude_quaternion(m.payload, milliseconds, q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    elif message == GPS_GLOBAL_ORIGIN:
        lat, lon = deg_e7(m.origin_latitude), deg_e7(m.origin_longitude)
        altitude = int(np.int64(math.floor(m.origin_altitude * 1e3 + 0.5)))
        encode_gps_global_origin(m.payload, lat, lon, altitude, int(1e6 * t + 0.5))
    elif message == VFR_HUD:
        encode_vfr_hud(m.payload, speed, speed, int(yaw), 0, m.origin_altitude - p[2], -v[2])
    else:
        encode_home_position(
            m.payload, lat, lon, alt, m.home[0], m.home[1], m.home[2], 0.0, 0.0, 0.0, int(1e6 * t + 0.5)
        )
        for i in range(4):
            put_home_position_q(m.payload, i, math.nan)
    return send(m, message)


@kernel
def send_message(m: Any, row: int, t: float) -> bool:
    """Sends the message of a row; true, too, if there is nothing to report yet."""
    if message_of(row) in (AVAILABLE_MODES, AVAILABLE_MODES_MONITOR):
        return send_modes(m, message_of(row))
    if message_of(row) == AIRSPEED:
        return send_airspeed(m)
    if message_of(row) in (
        GLOBAL_POSITION_INT,
        GPS_RAW_INT,
        LOCAL_POSITION_NED,
        ATTITUDE,
        ATTITUDE_QUATERNION,
        GPS_GLOBAL_ORIGIN,
        VFR_HUD,
        HOME_POSITION,
    ):
        return _send_motion(m, row, t)
    return _send_state(m, row, t)


@kernel
def start_streams(m: Any) -> None:
    """Sends HEARTBEAT at once and nothing else."""
    m.version = 2
    m.listed = -1
    m.told_mode = m.mode
    m.interval[0] = 1.0
    m.interval[MODES_ROW] = 0.0 if m.kind == MAV_TYPE_QUADROTOR else MODES_INTERVAL
    m.due[MODES_ROW] = NEVER


@kernel
def set_interval(m: Any, row: int, interval: float, t: float) -> None:
    """Sends a row every `interval` s from now on, first after one interval; 0 stops it, HEARTBEAT excepted."""
    if row == 0:
        interval = interval if interval > 0.0 else 1.0
    if interval != m.interval[row]:
        m.interval[row] = interval
        m.due[row] = t + interval
        m.next_due = min(m.next_due, m.due[row])


@kernel
def _tell_change(m: Any, t: float) -> None:
    """Tells that it was armed or disarmed, or changed its mode."""
    if m.armed != m.told_armed and m.kind != MAV_TYPE_QUADROTOR:
        say(m, MAV_SEVERITY_INFO, ARMED if m.armed else DISARMED, 0)
    m.told_armed = m.armed
    m.told_mode = m.mode
    send_message(m, 0, t)


@kernel
def stream(m: Any, t: float) -> None:
    """Sends the messages due at t."""
    if m.armed != m.told_armed or m.mode != m.told_mode:
        _tell_change(m, t)
    if m.repeat_left > 0:
        continue_repetition(m, t)
    if t < m.next_due - _SLACK:
        return
    soonest = t + 1.0
    for row in range(ROWS):
        interval = m.interval[row]
        if interval <= 0.0:
            continue
        if t >= m.due[row] - _SLACK and send_message(m, row, t):
            m.due[row] += interval
            if m.due[row] <= t:  # late by more than an interval: the missed ones are left out
                m.due[row] = t + interval
        soonest = min(soonest, m.due[row])
    m.next_due = soonest
