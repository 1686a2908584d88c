"""What the autopilot hears and says: MAVLink packets of a step, as ArduCopter answers them.

One COMMAND_ACK per command, addressed to whom it came from; refusals with ArduCopter's results and texts. Streams are
off until asked for, as ArduCopter's are; HEARTBEAT comes once a second and at every change of mode or arming.

Sources: ArduCopter's GCS_Mavlink (behaviour), its recorded answers; MAVLink common.xml and ardupilotmega.xml.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from cosim.frames import deg_e7, euler_from_quaternion, geodetic_from_local, local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    ATTITUDE,
    COMMAND_ACK,
    COMMAND_INT,
    COMMAND_LONG,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    LOCAL_POSITION_NED,
    REQUEST_DATA_STREAM,
    SET_MODE,
    SET_POSITION_TARGET_GLOBAL_INT,
    SET_POSITION_TARGET_LOCAL_NED,
    STATUSTEXT,
    STATUSTEXT_TEXT,
    SYS_STATUS,
    decode_command_int,
    decode_command_long,
    decode_request_data_stream,
    decode_set_mode,
    decode_set_position_target_global_int,
    decode_set_position_target_local_ned,
    encode_attitude,
    encode_command_ack,
    encode_ekf_status_report,
    encode_extended_sys_state,
    encode_global_position_int,
    encode_gps_raw_int,
    encode_heartbeat,
    encode_home_position,
    encode_local_position_ned,
    encode_statustext,
    encode_sys_status,
)
from cosim.packets import (
    GOOD,
    NOTHING,
    SIGNED,
    TRUNCATED,
    component,
    find,
    message_id,
    pack,
    put_text,
    system,
    target,
    unpack,
    version,
)
from numpy.typing import NDArray

from cosim_models.copter_modes import arm, change_mode, disarm, go_to, go_with, ready, take_off

__all__ = ["STREAMS", "answer", "report"]

STREAMS = np.array(
    [
        HEARTBEAT,
        GLOBAL_POSITION_INT,
        LOCAL_POSITION_NED,
        ATTITUDE,
        SYS_STATUS,
        GPS_RAW_INT,
        EKF_STATUS_REPORT,
        EXTENDED_SYS_STATE,
        HOME_POSITION,
    ],
    np.int64,
)
"""Messages that are sent at a rate; the record has an interval and a due time for each."""
_GROUP = np.array([-1, 6, 6, 10, 2, 2, 12, -1, -1], np.int64)
"""MAV_DATA_STREAM group of each, for REQUEST_DATA_STREAM."""

_ACCEPTED, _DENIED, _UNSUPPORTED, _FAILED = 0, 2, 3, 4  # MAV_RESULT
_CRITICAL, _WARNING, _INFO = 2, 4, 6  # MAV_SEVERITY
_STABILIZE, _GUIDED, _LOITER, _RTL, _LAND = 0, 4, 5, 6, 9
_FORCE = 21196.0
_TAKEOFF = 1


def _text(words: str) -> NDArray[np.uint8]:
    return np.frombuffer(words.encode("ascii"), np.uint8).copy()


_TEXTS = (
    _text("Arming motors"),
    _text("Disarming motors"),
    _text("Arm: Need Position Estimate"),
    _text("PreArm: Need Position Estimate"),
    _text("Mode change to GUIDED failed: requires position"),
    _text("Mode change to LOITER failed: requires position"),
    _text("Mode change to RTL failed: requires position"),
    _text("Arm: LAND mode not armable"),
    _text("Arm: RTL mode not armable"),
)
_T_ARMING, _T_DISARMING, _T_ARM_POSITION, _T_PREARM_POSITION, _T_GUIDED, _T_LOITER, _T_RTL, _T_ARM_LAND, _T_ARM_RTL = range(9)


@kernel
def _send(m: Any, message: int) -> None:
    """The payload as a packet, if the port has room (it has for everything one step can cause)."""
    n = pack(m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sequence, m.SYSID_THISMAV, 1, m.peer_version)
    if n > 0:
        m.mavlink_tx_len = n
        m.sequence = (m.sequence + 1) & 255


@kernel
def _say(m: Any, severity: int, text: NDArray[np.uint8]) -> None:
    if m.mavlink_tx_len > 3072:  # answers come before texts
        return
    encode_statustext(m.payload, severity, 0, 0)
    put_text(m.payload, STATUSTEXT_TEXT, 50, text)
    _send(m, STATUSTEXT)


@kernel
def _acknowledge(m: Any, command: int, result: int, to_system: int, to_component: int) -> None:
    encode_command_ack(m.payload, command, result, 0, 0, to_system, to_component)
    _send(m, COMMAND_ACK)


# ---- commands -----------------------------------------------------------------------------------------------------


@kernel
def _try_mode(m: Any, t: float, mode: int) -> int:
    """Change the mode if ArduCopter would; a MAV_RESULT."""
    known = mode == _STABILIZE or mode == _GUIDED or mode == _LOITER or mode == _RTL or mode == _LAND
    if not known:
        _say_no_such_mode(m, mode)
        return _FAILED
    if mode == m.mode:
        return _ACCEPTED
    needs_position = mode == _GUIDED or mode == _LOITER or mode == _RTL
    if needs_position and not ready(m, t):
        if m.armed:
            _say(m, _WARNING, _TEXTS[_T_GUIDED] if mode == _GUIDED else _TEXTS[_T_LOITER] if mode == _LOITER else _TEXTS[_T_RTL])
            return _FAILED
        _say(m, _CRITICAL, _TEXTS[_T_PREARM_POSITION])
    change_mode(m, mode)
    return _ACCEPTED


@kernel
def _say_no_such_mode(m: Any, mode: int) -> None:
    if m.mavlink_tx_len > 3072:
        return
    encode_statustext(m.payload, _WARNING, 0, 0)
    put_text(m.payload, STATUSTEXT_TEXT, 50, _NO_SUCH_MODE)
    at = STATUSTEXT_TEXT + _NO_SUCH_MODE.size
    digits = 1
    while digits < 9 and mode >= 10**digits:
        digits += 1
    for i in range(digits):
        m.payload[at + i] = 48 + (mode // 10 ** (digits - 1 - i)) % 10
    _send(m, STATUSTEXT)


_NO_SUCH_MODE = _text("No such mode ")


@kernel
def _try_arm(m: Any, t: float, force: bool) -> int:
    if m.armed:
        return _ACCEPTED
    if not force:
        if m.mode == _LAND or m.mode == _RTL:
            _say(m, _CRITICAL, _TEXTS[_T_ARM_LAND] if m.mode == _LAND else _TEXTS[_T_ARM_RTL])
            return _FAILED
        if (m.mode == _GUIDED or m.mode == _LOITER) and not ready(m, t):
            _say(m, _CRITICAL, _TEXTS[_T_ARM_POSITION])
            return _FAILED
    arm(m)
    _say(m, _INFO, _TEXTS[_T_ARMING])
    return _ACCEPTED


@kernel
def _try_disarm(m: Any, force: bool) -> int:
    if not m.armed:
        return _ACCEPTED
    if not m.on_ground and not force:
        return _FAILED
    disarm(m)
    _say(m, _INFO, _TEXTS[_T_DISARMING])
    return _ACCEPTED


@kernel
def _try_take_off(m: Any, height: float) -> int:
    if not m.armed or m.mode != _GUIDED or not m.on_ground or m.guided == _TAKEOFF or not height > 0.0:
        return _FAILED
    take_off(m, height)
    return _ACCEPTED


@kernel
def _stream(message: int) -> int:
    """The place of a message among the streams, -1 if it is none."""
    for i in range(STREAMS.size):
        if STREAMS[i] == message:
            return i
    return -1


@kernel
def _set_interval(m: Any, t: float, message: int, interval: float) -> int:
    """SET_MESSAGE_INTERVAL in us: -1 stops, 0 is the default rate."""
    i = _stream(message)
    if i < 0:
        return _DENIED
    if interval < 0.0:
        m.stream_interval[i] = 0.0
    else:
        default = 1.0 if i == 0 else 0.0
        m.stream_interval[i] = default if interval == 0.0 else max(interval * 1e-6, 0.0025)
        m.stream_due[i] = t
    return _ACCEPTED


@kernel
def _target_here(m: Any, frame: int, latitude: int, longitude: int, altitude: float) -> tuple[bool, float, float, float]:
    """A geodetic target as NED [m] from the local origin; False for a frame that is none of the global ones."""
    known = frame == 0 or frame == 5 or frame == 3 or frame == 6 or frame == 10 or frame == 11
    north, east, down = local_from_geodetic(
        radians_from_deg_e7(latitude), radians_from_deg_e7(longitude), altitude,
        m.origin_latitude, m.origin_longitude, m.origin_altitude,
    )  # fmt: skip
    if frame != 0 and frame != 5:
        down = m.home[2] - altitude
    return known, north, east, down


@kernel
def _reposition(m: Any, t: float, frame: int, p1: float, p2: float, x: int, y: int, z: float) -> int:
    known, north, east, down = _target_here(m, frame, x, y, z)
    if not known:
        return _DENIED
    if m.mode != _GUIDED:
        if (int(np.int64(p2)) & 1) == 0:
            return _DENIED
        if _try_mode(m, t, _GUIDED) != _ACCEPTED:
            return _FAILED
    if p1 > 0.0:
        m.WPNAV_SPEED = p1 * 100.0
    if m.armed and not m.on_ground:
        go_to(m, north, east, down)
    return _ACCEPTED


@kernel
def _command(m: Any, t: float, command: int, p1: float, p2: float, p7: float) -> int:
    """A command that COMMAND_LONG and COMMAND_INT have in common; a MAV_RESULT."""
    if command == 400:
        if p1 == 1.0:
            return _try_arm(m, t, p2 == _FORCE)
        return _try_disarm(m, p2 == _FORCE) if p1 == 0.0 else _UNSUPPORTED
    if command == 176:
        return _try_mode(m, t, int(np.int64(p2))) if int(np.int64(p1)) & 1 else _DENIED
    if command == 22:
        return _try_take_off(m, p7)
    if command == 21:
        return _try_mode(m, t, _LAND)
    if command == 20:
        return _try_mode(m, t, _RTL)
    if command == 511:
        return _set_interval(m, t, int(np.int64(p1)), p2)
    if command == 512:
        return _request_message(m, t, int(np.int64(p1)))
    if command == 410:
        return _request_message(m, t, HOME_POSITION)
    if command == 178:
        return _change_speed(m, p1, p2)
    return _UNSUPPORTED


@kernel
def _change_speed(m: Any, kind: float, speed: float) -> int:
    if not speed > 0.0:
        return _FAILED
    if kind == 2.0:
        m.WPNAV_SPEED_UP = speed * 100.0
    elif kind == 3.0:
        m.WPNAV_SPEED_DN = speed * 100.0
    else:
        m.WPNAV_SPEED = speed * 100.0
    return _ACCEPTED


@kernel
def _request_message(m: Any, t: float, message: int) -> int:
    i = _stream(message)
    if i < 0 or (message == HOME_POSITION and not m.home_set):
        return _FAILED
    _report(m, t, message)
    return _ACCEPTED


@kernel
def _velocity_frame(m: Any, frame: int, x: float, y: float) -> tuple[float, float]:
    """A vector of a body frame (8, 9) into north and east."""
    if frame != 8 and frame != 9:
        return x, y
    _, _, yaw = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    return x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)


@kernel
def _position_target(
    m: Any, t: float, mask: int, known: bool, north: float, east: float, down: float,
    vn: float, ve: float, vd: float, an: float, ae: float, ad: float, yaw: float,
) -> None:  # fmt: skip
    """SET_POSITION_TARGET_*: never answered, ignored outside GUIDED and on the ground."""
    if not known or m.mode != _GUIDED or not m.armed or m.on_ground:
        return
    position, velocity, acceleration = mask & 7 == 0, mask & 56 == 0, mask & 448 == 0
    if not position and not velocity:
        return
    if not acceleration:
        an, ae, ad = 0.0, 0.0, 0.0
    if position and not velocity:
        go_to(m, north, east, down)
    else:
        if position:
            m.target[0], m.target[1], m.target[2] = north, east, down
        go_with(m, t, position, vn, ve, vd, an, ae, ad)
    if mask & 1024 == 0:
        m.wanted_yaw = yaw


@kernel
def _handle(m: Any, t: float, start: int) -> None:
    """One packet that is for this autopilot."""
    message = message_id(m.mavlink_rx, start)
    from_system, from_component = system(m.mavlink_rx, start), component(m.mavlink_rx, start)
    if message == COMMAND_LONG:
        unpack(m.mavlink_rx, start, m.received)
        _, _, command, _, p1, p2, _, _, _, _, p7 = decode_command_long(m.received)
        _acknowledge(m, command, _command(m, t, command, p1, p2, p7), from_system, from_component)
    elif message == COMMAND_INT:
        unpack(m.mavlink_rx, start, m.received)
        _, _, frame, command, _, _, p1, p2, _, _, x, y, z = decode_command_int(m.received)
        result = _reposition(m, t, frame, p1, p2, x, y, z) if command == 192 else _command(m, t, command, p1, p2, z)
        _acknowledge(m, command, result, from_system, from_component)
    elif message == SET_MODE:
        unpack(m.mavlink_rx, start, m.received)
        _, base_mode, custom_mode = decode_set_mode(m.received)
        result = _try_mode(m, t, custom_mode) if base_mode & 1 else _DENIED
        _acknowledge(m, SET_MODE, result, from_system, from_component)
    elif message == SET_POSITION_TARGET_GLOBAL_INT:
        unpack(m.mavlink_rx, start, m.received)
        _, _, _, frame, mask, x, y, z, vn, ve, vd, an, ae, ad, yaw, _ = decode_set_position_target_global_int(m.received)
        known, north, east, down = _target_here(m, frame, x, y, z)
        _position_target(m, t, mask, known, north, east, down, vn, ve, vd, an, ae, ad, yaw)
    elif message == SET_POSITION_TARGET_LOCAL_NED:
        unpack(m.mavlink_rx, start, m.received)
        _, _, _, frame, mask, x, y, z, vx, vy, vz, ax, ay, az, yaw, _ = decode_set_position_target_local_ned(m.received)
        known = frame == 1 or frame == 7 or frame == 8 or frame == 9
        dn, de = _velocity_frame(m, frame, x, y)
        vn, ve = _velocity_frame(m, frame, vx, vy)
        an, ae = _velocity_frame(m, frame, ax, ay)
        # LOCAL_NED counts from the estimator's origin; the others are offsets from where the vehicle is.
        north, east, down = (dn, de, z) if frame == 1 else (m.position[0] + dn, m.position[1] + de, m.position[2] + z)
        _position_target(m, t, mask, known, north, east, down, vn, ve, vz, an, ae, az, yaw)
    elif message == REQUEST_DATA_STREAM:
        unpack(m.mavlink_rx, start, m.received)
        _, _, group, rate, on = decode_request_data_stream(m.received)
        for i in range(STREAMS.size):
            if _GROUP[i] >= 0 and (group == 0 or group == _GROUP[i]):
                m.stream_interval[i] = 1.0 / rate if on == 1 and rate > 0 else 0.0
                m.stream_due[i] = t


@kernel
def answer(m: Any, t: float) -> None:
    """Take in the packets of this step. What is addressed to another system is not for us."""
    p = 0
    while True:
        start, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
        if status == NOTHING or status == TRUNCATED:
            return
        if status != GOOD and status != SIGNED:
            continue
        to_system, to_component = target(m.mavlink_rx, start)
        if (to_system == 0 or to_system == m.SYSID_THISMAV) and (to_component == 0 or to_component == 1):
            message = message_id(m.mavlink_rx, start)
            if message != HEARTBEAT and message != GLOBAL_POSITION_INT:
                m.peer_version = version(m.mavlink_rx, start)
            _handle(m, t, start)


# ---- telemetry ----------------------------------------------------------------------------------------------------


@kernel
def _milliseconds(t: float) -> int:
    return int(np.int64(math.floor(t * 1000.0 + 0.5))) & 0xFFFFFFFF


@kernel
def _round(x: float) -> int:
    return int(np.int64(math.floor(x + 0.5)))


@kernel
def _heading(m: Any) -> tuple[float, float, float]:
    return euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))


@kernel
def _report_heartbeat(m: Any) -> None:
    base = 1 | 16 | 64
    if m.mode != _STABILIZE:
        base |= 8
    if m.armed:
        base |= 128
    kind = 2 if m.motors == 4 else 13 if m.motors == 6 else 14
    encode_heartbeat(m.payload, kind, 3, base, m.mode, 3 if m.on_ground else 4, 3)
    m.told_mode, m.told_armed = m.mode, m.armed


@kernel
def _report_position(m: Any, t: float) -> None:
    lat, lon, alt = geodetic_from_local(
        m.position[0], m.position[1], m.position[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    _, _, yaw = _heading(m)
    degrees = yaw * 180.0 / math.pi
    heading = _round((degrees if degrees >= 0.0 else degrees + 360.0) * 100.0) % 36000
    encode_global_position_int(
        m.payload, _milliseconds(t), deg_e7(lat), deg_e7(lon), _round(alt * 1000.0),
        _round((m.home[2] - m.position[2]) * 1000.0),
        _round(m.velocity[0] * 100.0), _round(m.velocity[1] * 100.0), _round(m.velocity[2] * 100.0), heading,
    )  # fmt: skip


@kernel
def _report_gps(m: Any, t: float) -> None:
    lat, lon, alt = geodetic_from_local(
        m.position[0], m.position[1], m.position[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    speed = math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2)
    course = math.atan2(m.velocity[1], m.velocity[0]) * 180.0 / math.pi
    fix = 6 if t >= 0.25 * m.estimate_ready_time else 0
    encode_gps_raw_int(
        m.payload, _round(t * 1e6), fix, deg_e7(lat), deg_e7(lon), _round(alt * 1000.0), 121, 200,
        _round(speed * 100.0), _round((course if course >= 0.0 else course + 360.0) * 100.0) % 36000,
        10 if fix > 0 else 0, _round(alt * 1000.0), 300, 300, 200, 0, 0,
    )  # fmt: skip


@kernel
def _report_home(m: Any, t: float) -> None:
    lat, lon, alt = geodetic_from_local(
        m.home[0], m.home[1], m.home[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
    )
    encode_home_position(
        m.payload, deg_e7(lat), deg_e7(lon), _round(alt * 1000.0), m.home[0], m.home[1], m.home[2],
        0.0, 0.0, 0.0, _round(t * 1e6),
    )  # fmt: skip


@kernel
def _report(m: Any, t: float, message: int) -> None:
    """One telemetry message, now."""
    if message == HEARTBEAT:
        _report_heartbeat(m)
    elif message == GLOBAL_POSITION_INT:
        _report_position(m, t)
    elif message == LOCAL_POSITION_NED:
        if not ready(m, t):
            return
        p, v = m.position, m.velocity
        encode_local_position_ned(m.payload, _milliseconds(t), p[0], p[1], p[2], v[0], v[1], v[2])
    elif message == ATTITUDE:
        roll, pitch, yaw = _heading(m)
        w = m.angular_velocity
        encode_attitude(m.payload, _milliseconds(t), roll, pitch, yaw, w[0], w[1], w[2])
    elif message == SYS_STATUS:
        health = 0x4771FC2F if not ready(m, t) else 0x5771FC2F
        encode_sys_status(
            m.payload, 0x5371FC2F, 0x5361FC2F, health, 0, 12600, 0, 100, 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
    elif message == GPS_RAW_INT:
        _report_gps(m, t)
    elif message == EKF_STATUS_REPORT:
        flags = 831 if ready(m, t) else 167 if t >= 0.25 * m.estimate_ready_time else 1024
        encode_ekf_status_report(m.payload, flags, 0.05, 0.02, 0.02, 0.02, 0.0, 0.0)
    elif message == EXTENDED_SYS_STATE:
        landed = 1 if m.on_ground else 3 if m.guided == _TAKEOFF else 4 if m.mode == _LAND else 2
        encode_extended_sys_state(m.payload, 0, landed)
    else:
        if not m.home_set:
            return
        _report_home(m, t)
    _send(m, message)


@kernel
def report(m: Any, t: float) -> None:
    """Telemetry that is due at time t [s], and a HEARTBEAT at once when mode or arming has changed."""
    if m.said_disarming:
        m.said_disarming = False
        _say(m, _INFO, _TEXTS[_T_DISARMING])
    if m.told_mode != m.mode or m.told_armed != m.armed:
        m.stream_due[0] = min(m.stream_due[0], t)
    for i in range(STREAMS.size):
        interval = m.stream_interval[i]
        if interval > 0.0 and t >= m.stream_due[i] - 1e-9:
            _report(m, t, STREAMS[i])
            m.stream_due[i] += interval
            if m.stream_due[i] < t:
                m.stream_due[i] = t + interval
