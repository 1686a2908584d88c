"""Reception of MAVLink commands and targets, and their answers, as in ArduCopter.

`receive` processes the packets of a step. Only good packets addressed to this system (or to all) count. Each
COMMAND_LONG and COMMAND_INT is answered by exactly one COMMAND_ACK to the requester, with ArduCopter's texts on
refusal; SET_MODE is not answered. Kernels over the autopilot's record `m`.

Sources: MAVLink common.xml; ArduPilot, GCS_Common and GCS_MAVLink_Copter; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import euler_from_quaternion, local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import (
    AUTOPILOT_VERSION,
    COMMAND_INT,
    COMMAND_LONG,
    FILE_TRANSFER_PROTOCOL,
    HEARTBEAT,
    HOME_POSITION,
    MANUAL_CONTROL,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_CONDITION_YAW,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_FENCE_ENABLE,
    MAV_CMD_DO_REPOSITION,
    MAV_CMD_DO_SET_MISSION_CURRENT,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_GET_HOME_POSITION,
    MAV_CMD_GET_MESSAGE_INTERVAL,
    MAV_CMD_MISSION_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    MAV_CMD_REQUEST_MESSAGE,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_DO_REPOSITION_FLAGS_CHANGE_MODE,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MESSAGE_INTERVAL,
    MISSION_CLEAR_ALL,
    MISSION_COUNT,
    MISSION_ITEM,
    MISSION_ITEM_INT,
    MISSION_REQUEST,
    MISSION_REQUEST_INT,
    MISSION_REQUEST_LIST,
    MISSION_SET_CURRENT,
    PARAM_REQUEST_LIST,
    PARAM_REQUEST_READ,
    PARAM_SET,
    POSITION_TARGET_TYPEMASK_FORCE_SET,
    POSITION_TARGET_TYPEMASK_YAW_IGNORE,
    POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
    RC_CHANNELS_OVERRIDE,
    REQUEST_DATA_STREAM,
    SET_MODE,
    SET_POSITION_TARGET_GLOBAL_INT,
    SET_POSITION_TARGET_LOCAL_NED,
    TIMESYNC,
    decode_command_int,
    decode_command_long,
    decode_mission_clear_all,
    decode_mission_count,
    decode_mission_item,
    decode_mission_item_int,
    decode_mission_request,
    decode_mission_request_list,
    decode_mission_set_current,
    decode_request_data_stream,
    decode_set_mode,
    decode_set_position_target_global_int,
    decode_set_position_target_local_ned,
    decode_timesync,
)
from cosim.packets import (
    GOOD,
    NOTHING,
    SIGNED,
    TRUNCATED,
    component,
    find,
    message_id,
    system,
    target,
    unpack,
    version,
)
from cosim_models.autopilot.commander.failsafes import hear_station
from cosim_models.autopilot.commander.mode_requests import (
    arm_or_disarm,
    change_mode,
    start_mission,
)
from cosim_models.autopilot.commander.readiness import home_ready
from cosim_models.autopilot.control.shaping import wrap_pi
from cosim_models.autopilot.flight.auto import change_speed
from cosim_models.autopilot.flight.guided import (
    guide_acceleration,
    guide_position,
    guide_position_velocity,
    guide_stop,
    guide_velocity,
    take_off,
)
from cosim_models.autopilot.flight.sticks import hear_manual_control, hear_override
from cosim_models.autopilot.flight.yaw import turn_at, turn_by, turn_to
from cosim_models.autopilot.link.links import can_answer
from cosim_models.autopilot.link.statustext import (
    INFO,
    NO_NUMBER,
    NO_SUCH_MESSAGE,
    PLAN_RECEIVED,
    say,
)
from cosim_models.autopilot.mavlink.file_transfer import answer_file_transfer
from cosim_models.autopilot.mavlink.messages import acknowledge, answer_timesync, send_message, tell_interval
from cosim_models.autopilot.mavlink.parameters import list_parameters, read_parameter, set_parameter
from cosim_models.autopilot.mavlink.telemetry import default_interval, set_interval
from cosim_models.autopilot.mission.missions import (
    RALLY,
    ack_mission,
    begin_upload,
    clear_mission,
    is_uploading,
    receive_item,
    send_count,
    send_item,
    send_mission_current,
    set_current,
)
from cosim_models.autopilot.record.modes import AUTO, GUIDED, LAND, POSITION, RTL
from cosim_models.autopilot.record.streams import STREAM_COUNT, stream_group, stream_of

__all__ = ["receive"]


_SHORTEST, _ACK = 13, 22  # bytes of a COMMAND_LONG that contains only zeros, and of its COMMAND_ACK
# Sums of POSITION_TARGET_TYPEMASK_X_IGNORE and the like.
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION = 0x007, 0x038, 0x1C0
_ABSOLUTE, _RELATIVE = 0, 1


# ---- other commands ------------------------------------------------------------------------------------------------


@kernel
def _turn(m: Any, angle: float, rate: float, direction: float, relative: float) -> int:
    """Handles CONDITION_YAW: angle [deg], rate [deg/s]; relative 1 turns by the angle in `direction`, 0 turns to it."""
    if not 0.0 <= angle <= 360.0 or not (relative == 0.0 or relative == 1.0) or not math.isfinite(rate + direction):
        return MAV_RESULT_FAILED
    turn_by(m, math.radians(angle), math.radians(rate), direction, relative == 1.0)
    return MAV_RESULT_ACCEPTED


@kernel
def _change_speed(m: Any, kind: float, speed: float) -> int:
    if not 0.0 < speed < math.inf or 4.0 <= kind < 5.0:  # 4 follows MAVLink's last kind
        return MAV_RESULT_DENIED
    if not 0.0 <= kind < 4.0 or m.mode not in (AUTO, GUIDED, RTL):
        return MAV_RESULT_FAILED
    change_speed(m, 3 if kind >= 3.0 else 2 if kind >= 2.0 else 1, speed)
    return MAV_RESULT_ACCEPTED


@kernel
def _set_message_interval(m: Any, message: float, microseconds: float, t: float) -> int:
    row = -1
    number = 0
    if 0.0 <= message < 16777216.0:
        number = int(message)
        row = stream_of(number)
    if row < 0:
        say(m, INFO, NO_SUCH_MESSAGE, number)
        return MAV_RESULT_DENIED
    interval = default_interval(m, row)
    if microseconds == -1.0:
        interval = 0.0
    elif microseconds < 0.0:
        return MAV_RESULT_DENIED
    elif microseconds > 0.0:
        interval = max(math.floor(min(microseconds, 6e7) / 1000.0), 1.0) * 1e-3
    set_interval(m, row, interval, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _tell_interval(m: Any, message: float) -> int:
    if not 0.0 <= message < 65536.0 or not can_answer(m):
        return MAV_RESULT_FAILED
    tell_interval(m, int(message), stream_of(int(message)))
    return MAV_RESULT_ACCEPTED


@kernel
def _request_message(m: Any, message: float, argument: float, t: float) -> int:
    if message == MESSAGE_INTERVAL:
        return _tell_interval(m, argument)
    row = -1
    if 0.0 <= message < 16777216.0:
        row = stream_of(int(message))
    if row < 0 or not can_answer(m):
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED if send_message(m, row, t) else MAV_RESULT_FAILED


@kernel
def _command(m: Any, command: int, p1: float, p2: float, p3: float, p4: float, height: float, t: float) -> int:
    """Handles commands shared by COMMAND_LONG and COMMAND_INT; `height` is param7 or z. Returns a MAV_RESULT."""
    if command == MAV_CMD_COMPONENT_ARM_DISARM:
        return arm_or_disarm(m, p1, p2, t)
    if command == MAV_CMD_NAV_TAKEOFF:
        return MAV_RESULT_ACCEPTED if height > 0.0 and take_off(m, height) else MAV_RESULT_FAILED
    if command == MAV_CMD_DO_SET_MODE:
        if not 0.0 <= p1 <= 255.0 or (int(p1) & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) == 0 or not 0.0 <= p2 < 16777216.0:
            return MAV_RESULT_DENIED
        return change_mode(m, int(p2), t)
    if command == MAV_CMD_NAV_LAND:
        return change_mode(m, LAND, t)
    if command == MAV_CMD_NAV_RETURN_TO_LAUNCH:
        return change_mode(m, RTL, t)
    if command == MAV_CMD_SET_MESSAGE_INTERVAL:
        return _set_message_interval(m, p1, p2, t)
    if command == MAV_CMD_MISSION_START:
        return start_mission(m, t)
    if command == MAV_CMD_DO_SET_MISSION_CURRENT:
        return MAV_RESULT_ACCEPTED if 0.0 <= p1 < 65536.0 and set_current(m, int(p1)) else MAV_RESULT_FAILED
    if command == MAV_CMD_GET_MESSAGE_INTERVAL:
        return _tell_interval(m, p1)
    if command == MAV_CMD_REQUEST_MESSAGE:
        return _request_message(m, p1, p2, t)
    if command == MAV_CMD_GET_HOME_POSITION:
        return _request_message(m, float(HOME_POSITION), 0.0, t) if home_ready(m, t) else MAV_RESULT_FAILED
    if command == MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
        if p1 != 1.0:
            return MAV_RESULT_FAILED
        return _request_message(m, float(AUTOPILOT_VERSION), 0.0, t)
    if command == MAV_CMD_DO_CHANGE_SPEED:
        return _change_speed(m, p1, p2)
    if command == MAV_CMD_DO_FENCE_ENABLE:
        if p1 != 0.0 and p1 != 1.0:
            return MAV_RESULT_FAILED
        m.FENCE_ENABLE = int(p1)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_CONDITION_YAW:
        return _turn(m, p1, p2, p3, p4)
    return MAV_RESULT_UNSUPPORTED


# ---- targets -------------------------------------------------------------------------------------------------------


@kernel
def _altitude_reference(frame: int) -> int:
    """Returns the reference of altitudes in a MAV_FRAME: _ABSOLUTE (sea), _RELATIVE (home), -1 if not supported."""
    if frame == 0 or frame == 5:
        return _ABSOLUTE
    if frame == 3 or frame == 6:
        return _RELATIVE
    return -1


@kernel
def _locate(m: Any, lat: int, lon: int, altitude: float, reference: int) -> tuple[float, float, float]:
    """Returns north, east and up of a position in degE7 and m."""
    n, e, d = local_from_geodetic(
        radians_from_deg_e7(lat), radians_from_deg_e7(lon), altitude, m.origin_latitude, m.origin_longitude, 0.0
    )
    if reference == _ABSOLUTE:
        return n, e, -d - m.origin_altitude
    return n, e, m.home_neu[2] - d


@kernel
def _is_place(lat: int, lon: int) -> bool:
    return abs(lat) <= 900000000 and abs(lon) <= 1800000000


@kernel
def _reposition(m: Any, frame: int, flags: float, lat: int, lon: int, altitude: float, t: float) -> int:
    change = 0.0 <= flags < 16777216.0 and (int(flags) & MAV_DO_REPOSITION_FLAGS_CHANGE_MODE) != 0
    if m.mode != GUIDED and not change:
        return MAV_RESULT_DENIED
    reference = _altitude_reference(frame)
    if reference < 0 or not _is_place(lat, lon) or (lat == 0 and lon == 0) or not math.isfinite(altitude):
        return MAV_RESULT_DENIED
    if m.mode != GUIDED and change_mode(m, GUIDED, t) != MAV_RESULT_ACCEPTED:
        return MAV_RESULT_FAILED
    n, e, u = _locate(m, lat, lon, altitude, reference)
    guide_position(m, n, e, u, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _set_nose(m: Any, mask: int, yaw: float, yaw_rate: float, relative: bool) -> None:
    if (mask & POSITION_TARGET_TYPEMASK_YAW_IGNORE) == 0 and math.isfinite(yaw):
        offset = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))[2] if relative else 0.0
        turn_to(m, wrap_pi(yaw + offset))
    elif (mask & POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE) == 0 and math.isfinite(yaw_rate):
        turn_at(m, yaw_rate)


@kernel
def _guide(
    m: Any,
    mask: int,
    n: float,
    e: float,
    u: float,
    vn: float,
    ve: float,
    vu: float,
    an: float,
    ae: float,
    au: float,
    yaw: float,
    yaw_rate: float,
    relative: bool,
    t: float,
) -> None:
    """Applies a target of SET_POSITION_TARGET_*, in local axes; unsupported combinations stop the vehicle."""
    position = (mask & _NO_POSITION) == 0
    velocity = (mask & _NO_VELOCITY) == 0
    acceleration = (mask & _NO_ACCELERATION) == 0
    total = 0.0
    if position:
        total += n + e + u
    if velocity:
        total += vn + ve + vu
    if acceleration:
        total += an + ae + au
    if not math.isfinite(total) or (acceleration and (mask & POSITION_TARGET_TYPEMASK_FORCE_SET) != 0):
        guide_stop(m, t)
        return
    if not acceleration:
        an, ae, au = 0.0, 0.0, 0.0
    if position and velocity:
        guide_position_velocity(m, t)
        m.guided_position_neu[0], m.guided_position_neu[1], m.guided_position_neu[2] = n, e, u
    elif velocity:
        guide_velocity(m, vn, ve, vu, t)
    elif acceleration and not position:
        guide_acceleration(m, an, ae, au, t)
    elif position and not acceleration:
        guide_position(m, n, e, u, t)
    else:
        guide_stop(m, t)
        return
    if velocity:
        m.guided_velocity_neu[0], m.guided_velocity_neu[1], m.guided_velocity_neu[2] = vn, ve, vu
        m.guided_acceleration_neu[0], m.guided_acceleration_neu[1], m.guided_acceleration_neu[2] = an, ae, au
    _set_nose(m, mask, yaw, yaw_rate, relative)


@kernel
def _local_target(m: Any, t: float) -> None:
    _, _, _, frame, mask, x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate = decode_set_position_target_local_ned(
        m.received
    )
    if m.mode != GUIDED:
        return
    if not (frame == 1 or 7 <= frame <= 9):
        guide_stop(m, t)
        return
    body = frame >= 8
    if body:
        heading = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))[2]
        c, s = math.cos(heading), math.sin(heading)
        x, y = x * c - y * s, x * s + y * c
        vx, vy = vx * c - vy * s, vx * s + vy * c
        ax, ay = ax * c - ay * s, ax * s + ay * c
    up = -z
    if frame != 1:
        x, y, up = x + m.position_neu[0], y + m.position_neu[1], up + m.position_neu[2]
    _guide(m, mask, x, y, up, vx, vy, -vz, ax, ay, -az, yaw, yaw_rate, body, t)


@kernel
def _global_target(m: Any, t: float) -> None:
    _, _, _, frame, mask, lat, lon, alt, vx, vy, vz, ax, ay, az, yaw, yaw_rate = decode_set_position_target_global_int(
        m.received
    )
    if m.mode != GUIDED:
        return
    n, e, u = 0.0, 0.0, 0.0
    if (mask & _NO_POSITION) == 0:
        reference = _altitude_reference(frame)
        if reference < 0 or not _is_place(lat, lon):
            guide_stop(m, t)
            return
        n, e, u = _locate(m, lat, lon, alt, reference)
    _guide(m, mask, n, e, u, vx, vy, -vz, ax, ay, -az, yaw, yaw_rate, False, t)


# ---- missions -----------------------------------------------------------------------------------------------------


@kernel
def _guided_item(m: Any, current: int, frame: int, lat: float, lon: float, z: float, t: float) -> bool:
    """Handles MISSION_ITEM with current 2, a GUIDED target, or 3, a height; positions in 1e-7 degrees."""
    reference = _altitude_reference(frame)
    if m.mode != GUIDED or reference < 0 or not math.isfinite(z):
        return False
    if current == 3:
        n, e = m.desired_position_neu[0], m.desired_position_neu[1]
        if m.submode == POSITION:
            n, e = m.guided_position_neu[0], m.guided_position_neu[1]
        u = z - m.origin_altitude if reference == _ABSOLUTE else z + m.home_neu[2]
    else:
        if not (abs(lat) <= 9e8 and abs(lon) <= 1.8e9):
            return False
        n, e, u = _locate(m, int(lat), int(lon), z, reference)
    guide_position(m, n, e, u, t)
    return True


@kernel
def _mission_item(m: Any, whole: bool, sender: int, part: int, t: float) -> None:
    lat, lon = 0.0, 0.0
    if whole:
        r = decode_mission_item_int(m.received)
        lat, lon = float(r[11]), float(r[12])
        seq, frame, command, current, carry_on, z, kind = r[2], r[3], r[4], r[5], r[6], r[13], r[14]
        p1, p2, p3, p4 = r[7], r[8], r[9], r[10]
    else:
        q = decode_mission_item(m.received)
        lat, lon = q[11] * 1e7, q[12] * 1e7
        seq, frame, command, current, carry_on, z, kind = q[2], q[3], q[4], q[5], q[6], q[13], q[14]
        p1, p2, p3, p4 = q[7], q[8], q[9], q[10]
    if kind > RALLY:
        ack_mission(m, 3, kind, sender, part)
    elif kind == 0 and (current == 2 or current == 3):
        ack_mission(m, 0 if _guided_item(m, current, frame, lat, lon, z, t) else 1, 0, sender, part)
    elif m.uploading and kind == m.upload_kind and not is_uploading(m, sender, part):
        ack_mission(m, 14, kind, sender, part)
    elif m.uploading and kind == m.upload_kind:
        receive_item(m, seq, frame, command, carry_on, (p1, p2, p3, p4), lat, lon, z, t)
        if kind == 0 and not m.uploading and m.mission_count > 1:
            say(m, INFO, PLAN_RECEIVED, NO_NUMBER)


@kernel
def _mission(m: Any, message: int, sender: int, part: int, t: float) -> None:
    """Handles mission messages; an answer that does not fit is omitted, and the ground station asks again."""
    if not can_answer(m):
        return
    if message in (MISSION_ITEM_INT, MISSION_ITEM):
        _mission_item(m, message == MISSION_ITEM_INT, sender, part, t)
    elif message == MISSION_COUNT:
        _, _, count, kind = decode_mission_count(m.received)
        begin_upload(m, count, kind, sender, part, t)
    elif message == MISSION_REQUEST_LIST:
        _, _, kind = decode_mission_request_list(m.received)
        send_count(m, kind, sender, part)
    elif message in (MISSION_REQUEST_INT, MISSION_REQUEST):
        _, _, sequence, kind = decode_mission_request(m.received)
        send_item(m, sequence, kind, sender, part, message == MISSION_REQUEST_INT)
    elif message == MISSION_CLEAR_ALL:
        _, _, kind = decode_mission_clear_all(m.received)
        clear_mission(m, kind, sender, part)
    elif message == MISSION_SET_CURRENT:
        _, _, sequence = decode_mission_set_current(m.received)
        if set_current(m, sequence):
            send_mission_current(m)


# ---- packets -------------------------------------------------------------------------------------------------------


@kernel
def _request_stream(m: Any, t: float) -> None:
    _, _, stream, rate, start = decode_request_data_stream(m.received)
    interval = 1.0 / rate if start != 0 and rate > 0 else 0.0
    for row in range(STREAM_COUNT):
        group = stream_group(row)
        if group != 0 and (stream == 0 or stream == group):
            set_interval(m, row, interval, t)


@kernel
def _dispatch(m: Any, message: int, sender: int, part: int, t: float) -> None:
    if message == COMMAND_LONG:
        _, _, command, _, p1, p2, p3, p4, _, _, p7 = decode_command_long(m.received)
        result = _command(m, command, p1, p2, p3, p4, p7, t)
        acknowledge(m, command, result, sender, part)
    elif message == COMMAND_INT:
        _, _, frame, command, _, _, p1, p2, p3, p4, x, y, z = decode_command_int(m.received)
        if command == MAV_CMD_DO_REPOSITION:
            result = _reposition(m, frame, p2, x, y, z, t)
        else:
            result = _command(m, command, p1, p2, p3, p4, z, t)
        acknowledge(m, command, result, sender, part)
    elif message == SET_MODE:
        _, base_mode, mode = decode_set_mode(m.received)
        if (base_mode & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) != 0:
            change_mode(m, mode, t)
    elif message == SET_POSITION_TARGET_LOCAL_NED:
        _local_target(m, t)
    elif message == SET_POSITION_TARGET_GLOBAL_INT:
        _global_target(m, t)
    elif message == REQUEST_DATA_STREAM:
        _request_stream(m, t)
    elif message == RC_CHANNELS_OVERRIDE:
        hear_override(m, sender, t)
    elif message == MANUAL_CONTROL:
        hear_manual_control(m, sender, t)
    elif message == HEARTBEAT:
        hear_station(m, sender, t)
    elif message == TIMESYNC:
        theirs, sent = decode_timesync(m.received)
        if theirs == 0 and can_answer(m):
            answer_timesync(m, sent, t)
    elif message == FILE_TRANSFER_PROTOCOL:
        answer_file_transfer(m, sender, part, t)
    elif message == PARAM_REQUEST_READ:
        read_parameter(m)
    elif message == PARAM_SET:
        set_parameter(m)
    elif message == PARAM_REQUEST_LIST:
        list_parameters(m, t)
    elif MISSION_ITEM <= message <= MISSION_REQUEST_INT or message == MISSION_ITEM_INT:
        _mission(m, message, sender, part, t)


@kernel
def receive(m: Any, packets: Any, n: int, t: float) -> None:
    """Processes the n bytes of packets received on m.link in this step, and answers on the same link."""
    p = 0
    m.ack_room = (n // _SHORTEST + 1) * _ACK
    while True:
        start, p, status = find(packets, p, n)
        if status in (NOTHING, TRUNCATED):
            break
        if status != GOOD and status != SIGNED:
            continue
        sender = system(packets, start)
        to_system, to_component = target(packets, start)
        if sender == m.SYSID_THISMAV and component(packets, start) == MAV_COMP_ID_AUTOPILOT1:
            continue
        m.link_version[m.link] = version(packets, start)
        for_vehicle = to_system == 0 or to_system == m.SYSID_THISMAV
        if for_vehicle and to_component in (0, MAV_COMP_ID_AUTOPILOT1):
            unpack(packets, start, m.received)
            _dispatch(m, message_id(packets, start), sender, component(packets, start), t)
    m.ack_room = 0
