"""Reception of MAVLink commands and targets, and their answers, as in ArduCopter.

`receive` processes the packets of a step. Only good packets addressed to this system (or to all) count. Each
COMMAND_LONG and COMMAND_INT is answered by exactly one COMMAND_ACK to the requester, with ArduCopter's texts on
refusal; SET_MODE is not answered. Kernels over the autopilot's record `m`.

Sources: MAVLink common.xml; ArduPilot, GCS_Common and GCS_MAVLink_Copter; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim.messages import (
    AUTOPILOT_VERSION,
    COMMAND_INT,
    COMMAND_LONG,
    FENCE_FETCH_POINT,
    FILE_TRANSFER_PROTOCOL,
    GPS_GLOBAL_ORIGIN,
    HEARTBEAT,
    HOME_POSITION,
    LOG_DATA,
    LOG_REQUEST_END,
    LOG_REQUEST_LIST,
    MANUAL_CONTROL,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_CONDITION_YAW,
    MAV_CMD_DO_CHANGE_SPEED,
    MAV_CMD_DO_FENCE_ENABLE,
    MAV_CMD_DO_REPOSITION,
    MAV_CMD_DO_SET_HOME,
    MAV_CMD_DO_SET_MISSION_CURRENT,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_GET_HOME_POSITION,
    MAV_CMD_GET_MESSAGE_INTERVAL,
    MAV_CMD_MISSION_START,
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_VTOL_LAND,
    MAV_CMD_NAV_VTOL_TAKEOFF,
    MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    MAV_CMD_REQUEST_MESSAGE,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_FRAME_GLOBAL,
    MAV_FRAME_GLOBAL_RELATIVE_ALT,
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
    MISSION_WRITE_PARTIAL_LIST,
    PARAM_REQUEST_LIST,
    PARAM_REQUEST_READ,
    PARAM_SET,
    RALLY_FETCH_POINT,
    RC_CHANNELS_OVERRIDE,
    REQUEST_DATA_STREAM,
    SET_ATTITUDE_TARGET,
    SET_MODE,
    SET_POSITION_TARGET_GLOBAL_INT,
    SET_POSITION_TARGET_LOCAL_NED,
    TERRAIN_CHECK,
    TIMESYNC,
    decode_command_int,
    decode_command_long,
    decode_fence_fetch_point,
    decode_mission_clear_all,
    decode_mission_count,
    decode_mission_item,
    decode_mission_item_int,
    decode_mission_request,
    decode_mission_request_list,
    decode_mission_set_current,
    decode_mission_write_partial_list,
    decode_request_data_stream,
    decode_set_mode,
    decode_terrain_check,
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
    request_mode,
    start_mission,
)
from cosim_models.autopilot.commander.readiness import home_ready
from cosim_models.autopilot.flight.auto import change_speed
from cosim_models.autopilot.flight.guided import take_off
from cosim_models.autopilot.flight.sticks import hear_manual_control, hear_override
from cosim_models.autopilot.flight.yaw import turn_by
from cosim_models.autopilot.link.available_modes import AVAILABLE_MODES, AVAILABLE_MODES_MONITOR, ask_for_modes
from cosim_models.autopilot.link.links import can_answer
from cosim_models.autopilot.link.statustext import (
    DEBUG,
    FENCE_FETCH_INVALID,
    FENCE_FETCH_OLD,
    FENCE_INDEXED,
    INFO,
    NO_NUMBER,
    NO_SUCH_MESSAGE,
    PLAN_RECEIVED,
    PLAN_REJECTED,
    RALLY_FETCH_FAILED,
    RALLY_FETCH_OLD,
    USE_REQUEST_INT,
    WARNING,
    say,
    say_here,
    say_with,
)
from cosim_models.autopilot.mavlink.file_transfer import answer_file_transfer
from cosim_models.autopilot.mavlink.messages import acknowledge, answer_timesync, send_message, tell_interval
from cosim_models.autopilot.mavlink.parameters import list_parameters, read_parameter, set_parameter
from cosim_models.autopilot.mavlink.requested_messages import answer_log_request, send_terrain
from cosim_models.autopilot.mavlink.requests import obey, send_banner, take_off_by_pilot
from cosim_models.autopilot.mavlink.targets import (
    hear_attitude_target,
    hear_global_target,
    hear_guided_item,
    hear_local_target,
    reposition,
)
from cosim_models.autopilot.mavlink.telemetry import default_interval, set_interval
from cosim_models.autopilot.mission.missions import (
    FENCE,
    RALLY,
    ack_mission,
    begin_partial_upload,
    begin_upload,
    clear_mission,
    forget_jumps,
    is_uploading,
    mission_count,
    receive_item,
    send_count,
    send_item,
    send_mission_current,
    set_current,
)
from cosim_models.autopilot.record.modes import ALT_HOLD, AUTO, GUIDED, LAND, LOITER, RTL
from cosim_models.autopilot.record.streams import STREAM_COUNT, is_silent, stream_group, stream_of

__all__ = ["receive"]


_MONITORED = 5.0  # s between AVAILABLE_MODES_MONITORs after the first request for modes
_SHORTEST, _ACK = 13, 22  # bytes of a COMMAND_LONG that contains only zeros, and of its COMMAND_ACK


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
    if row < 0 and is_silent(number):
        return MAV_RESULT_ACCEPTED
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
    if row < 0 and 0.0 <= message < 16777216.0 and is_silent(int(message)):
        return MAV_RESULT_ACCEPTED
    if row < 0 or not can_answer(m):
        return MAV_RESULT_FAILED
    if message == AVAILABLE_MODES:
        ask_for_modes(m, argument)
        set_interval(m, stream_of(AVAILABLE_MODES_MONITOR), _MONITORED, t)
    return MAV_RESULT_ACCEPTED if send_message(m, row, t) else MAV_RESULT_FAILED


@kernel
def _take_off(m: Any, frame: int, by_pilot: bool, height: float) -> int:
    """Handles NAV_TAKEOFF to a height above home; `by_pilot`: a mode in which the pilot moves the vehicle will do."""
    if frame != MAV_FRAME_GLOBAL_RELATIVE_ALT:
        return MAV_RESULT_DENIED
    if m.mode == LOITER or (m.mode == ALT_HOLD and by_pilot):
        return MAV_RESULT_ACCEPTED if take_off_by_pilot(m, height) else MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED if height > 0.0 and take_off(m, height) else MAV_RESULT_FAILED


@kernel
def _set_current(m: Any, sequence: float, reset: bool) -> int:
    """Handles DO_SET_MISSION_CURRENT."""
    if not 0.0 <= sequence < 65536.0:
        return MAV_RESULT_DENIED
    if reset:
        forget_jumps(m)
    if mission_count(m) <= 1:
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED if set_current(m, int(sequence)) else MAV_RESULT_DENIED


@kernel
def _enable_fence(m: Any, what: float) -> int:
    """Handles DO_FENCE_ENABLE: 0 off, 1 on; ArduCopter accepts any number."""
    if not math.isfinite(what):
        return MAV_RESULT_FAILED
    if what == 0.0 or what == 1.0:
        m.FENCE_ENABLE = int(what)
    return MAV_RESULT_ACCEPTED


@kernel
def _fly(m: Any, command: int, frame: int, p1: float, p2: float, p3: float, p4: float, height: float, t: float) -> int:
    """Handles commands that fly, arm or change the mode; MAV_RESULT_UNSUPPORTED: none of these."""
    if command == MAV_CMD_COMPONENT_ARM_DISARM:
        return arm_or_disarm(m, p1, p2, t)
    if command in (MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_VTOL_TAKEOFF):
        return _take_off(m, frame, p3 != 0.0, height)
    if command == MAV_CMD_DO_SET_MODE:
        if not 0.0 <= p1 <= 255.0 or (int(p1) & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) == 0 or not 0.0 <= p2 < 16777216.0:
            return MAV_RESULT_DENIED
        return request_mode(m, int(p2), t)
    if command in (MAV_CMD_NAV_LAND, MAV_CMD_NAV_VTOL_LAND):
        return change_mode(m, LAND, t)
    if command == MAV_CMD_NAV_RETURN_TO_LAUNCH:
        return change_mode(m, RTL, t)
    if command == MAV_CMD_MISSION_START:
        return start_mission(m, t) if p1 == 0.0 and p2 == 0.0 else MAV_RESULT_DENIED
    if command == MAV_CMD_DO_SET_MISSION_CURRENT:
        return _set_current(m, p1, p2 == 1.0)
    if command == MAV_CMD_DO_CHANGE_SPEED:
        return _change_speed(m, p1, p2)
    if command == MAV_CMD_DO_FENCE_ENABLE:
        return _enable_fence(m, p1)
    if command == MAV_CMD_CONDITION_YAW:
        return _turn(m, p1, p2, p3, p4)
    return MAV_RESULT_UNSUPPORTED


@kernel
def _command(
    m: Any, command: int, frame: int, p1: float, p2: float, p3: float, p4: float, x: int, y: int, z: float, t: float
) -> int:
    """Handles a command with the fields of COMMAND_INT; returns a MAV_RESULT."""
    if command == MAV_CMD_SET_MESSAGE_INTERVAL:
        return _set_message_interval(m, p1, p2, t)
    if command == MAV_CMD_GET_MESSAGE_INTERVAL:
        return _tell_interval(m, p1)
    if command == MAV_CMD_REQUEST_MESSAGE:
        return _request_message(m, p1, p2, t)
    if command == MAV_CMD_GET_HOME_POSITION:
        if not home_ready(m, t):
            return MAV_RESULT_FAILED
        _request_message(m, float(HOME_POSITION), 0.0, t)
        return _request_message(m, float(GPS_GLOBAL_ORIGIN), 0.0, t)
    if command == MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
        if p1 != 1.0:
            return MAV_RESULT_FAILED
        return _request_message(m, float(AUTOPILOT_VERSION), 0.0, t)
    result = _fly(m, command, frame, p1, p2, p3, p4, z, t)
    return obey(m, command, frame, p1, p2, p3, p4, x, y, z, t) if result == MAV_RESULT_UNSUPPORTED else result


@kernel
def _whole(value: float, scale: float) -> int:
    """Returns a parameter of COMMAND_LONG as the integer of COMMAND_INT; NaN gives 0."""
    return int(min(max(value * scale, -2147483648.0), 2147483647.0)) if value == value else 0


@kernel
def _long_command(m: Any, t: float) -> tuple[int, int]:
    """Handles COMMAND_LONG: places in degrees, heights above the sea for home, else above home.

    Returns the command and a MAV_RESULT.
    """
    _, _, command, _, p1, p2, p3, p4, p5, p6, p7 = decode_command_long(m.received)
    place = command in (MAV_CMD_DO_SET_HOME, MAV_CMD_DO_SET_ROI, MAV_CMD_DO_SET_ROI_LOCATION)
    scale = 1e7 if place else 1.0
    frame = MAV_FRAME_GLOBAL if command == MAV_CMD_DO_SET_HOME else MAV_FRAME_GLOBAL_RELATIVE_ALT
    return command, _command(m, command, frame, p1, p2, p3, p4, _whole(p5, scale), _whole(p6, scale), p7, t)


@kernel
def _int_command(m: Any, t: float) -> tuple[int, int]:
    """Handles COMMAND_INT; returns the command and a MAV_RESULT."""
    _, _, frame, command, _, _, p1, p2, p3, p4, x, y, z = decode_command_int(m.received)
    if command == MAV_CMD_DO_REPOSITION:
        return command, reposition(m, frame, p2, x, y, z, t)
    return command, _command(m, command, frame, p1, p2, p3, p4, x, y, z, t)


# ---- missions -----------------------------------------------------------------------------------------------------


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
        ack_mission(m, 0 if hear_guided_item(m, current, frame, lat, lon, z, t) else 1, 0, sender, part)
    elif m.uploading and kind == m.upload_kind and not is_uploading(m, sender, part):
        ack_mission(m, 14, kind, sender, part)
    elif m.uploading and kind == m.upload_kind:
        receive_item(m, seq, frame, command, carry_on, (p1, p2, p3, p4), lat, lon, z, t)
        if kind == 0 and not m.uploading and m.mission_count > 1:
            say(m, INFO, PLAN_RECEIVED, NO_NUMBER)
        if kind == FENCE and not m.uploading and m.fence_count > 0:
            say(m, DEBUG, FENCE_INDEXED, NO_NUMBER)


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
    elif message == MISSION_WRITE_PARTIAL_LIST:
        _, _, first, last, kind = decode_mission_write_partial_list(m.received)
        if not begin_partial_upload(m, first, last, kind, sender, part, t):
            say_here(m, WARNING, PLAN_REJECTED, NO_NUMBER)
    elif message == MISSION_REQUEST_LIST:
        _, _, kind = decode_mission_request_list(m.received)
        send_count(m, kind, sender, part)
    elif message in (MISSION_REQUEST_INT, MISSION_REQUEST):
        _, _, sequence, kind = decode_mission_request(m.received)
        if message == MISSION_REQUEST and not m.deprecation_told:
            m.deprecation_told = True
            say_here(m, WARNING, USE_REQUEST_INT, NO_NUMBER)
        send_item(m, sequence, kind, sender, part, message == MISSION_REQUEST_INT)
    elif message == MISSION_CLEAR_ALL:
        _, _, kind = decode_mission_clear_all(m.received)
        clear_mission(m, kind, sender, part)
        if kind == FENCE and m.fence_count == 0:
            say(m, DEBUG, FENCE_INDEXED, NO_NUMBER)
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
        command, result = _long_command(m, t)
        acknowledge(m, command, result, sender, part)
    elif message == COMMAND_INT:
        command, result = _int_command(m, t)
        acknowledge(m, command, result, sender, part)
    elif message == SET_MODE:
        _, base_mode, mode = decode_set_mode(m.received)
        if (base_mode & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) != 0:
            request_mode(m, mode, t)
    elif message == SET_POSITION_TARGET_LOCAL_NED:
        hear_local_target(m, t)
    elif message == SET_POSITION_TARGET_GLOBAL_INT:
        hear_global_target(m, t)
    elif message == SET_ATTITUDE_TARGET:
        hear_attitude_target(m, t)
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
        if answer_file_transfer(m, sender, part, t):
            send_banner(m)
    elif message == PARAM_REQUEST_READ:
        read_parameter(m)
    elif LOG_REQUEST_LIST <= message <= LOG_REQUEST_END and message != LOG_DATA:
        answer_log_request(m, message)
    elif message == TERRAIN_CHECK:
        lat, lon = decode_terrain_check(m.received)
        if can_answer(m):
            send_terrain(m, lat, lon)
    elif message == FENCE_FETCH_POINT:
        _, _, index = decode_fence_fetch_point(m.received)
        say_here(m, INFO, FENCE_FETCH_OLD, NO_NUMBER)
        say_with(m, WARNING, FENCE_FETCH_INVALID, index, m.fence_count)
    elif message == RALLY_FETCH_POINT:
        say_here(m, INFO, RALLY_FETCH_OLD, NO_NUMBER)
        say_here(m, WARNING, RALLY_FETCH_FAILED, NO_NUMBER)
    elif message == PARAM_SET:
        set_parameter(m, t)
    elif message == PARAM_REQUEST_LIST:
        list_parameters(m, t)
        send_banner(m)
    elif MISSION_WRITE_PARTIAL_LIST <= message <= MISSION_REQUEST_INT or message == MISSION_ITEM_INT:
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
        if sender == m.SYSID_THISMAV:
            m.component_known[component(packets, start)] = 1
            if component(packets, start) == MAV_COMP_ID_AUTOPILOT1:
                continue
        m.link_version[m.link] = version(packets, start)
        for_us = to_component in (0, MAV_COMP_ID_AUTOPILOT1)
        if to_system == m.SYSID_THISMAV and to_component > 0:
            # As in ArduPilot's routing: also packets to components that it does not know.
            for_us = for_us or m.component_known[to_component] == 0
        if for_us and (to_system == 0 or to_system == m.SYSID_THISMAV):
            unpack(packets, start, m.received)
            _dispatch(m, message_id(packets, start), sender, component(packets, start), t)
    m.ack_room = 0
