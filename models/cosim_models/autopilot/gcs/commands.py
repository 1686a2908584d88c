"""Reception of commands by the small autopilots, and their answers, as ArduPilot's GCS_MAVLink gives them.

Each COMMAND_LONG and COMMAND_INT is answered by exactly one COMMAND_ACK; SET_MODE and targets are not answered. The
firmwares differ in modes, commands and targets: `receiver` returns a kernel for one of them.

Sources: MAVLink common.xml; ArduPilot, GCS_Common and GCS_MAVLink of Copter, Rover and Plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    AUTOPILOT_VERSION,
    COMMAND_ACK,
    COMMAND_INT,
    COMMAND_LONG,
    FENCE_FETCH_POINT,
    GPS_GLOBAL_ORIGIN,
    HOME_POSITION,
    LOG_ENTRY,
    LOG_ERASE,
    LOG_REQUEST_DATA,
    LOG_REQUEST_LIST,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_DO_MOTOR_TEST,
    MAV_CMD_DO_REPOSITION,
    MAV_CMD_DO_SET_HOME,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_GET_HOME_POSITION,
    MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
    MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    MAV_CMD_REQUEST_MESSAGE,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_DO_REPOSITION_FLAGS_CHANGE_MODE,
    MAV_MISSION_ACCEPTED,
    MAV_MISSION_ERROR,
    MAV_MISSION_TYPE_MISSION,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_UNSUPPORTED,
    MAV_SEVERITY_ERROR,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_WARNING,
    MAV_TYPE_FIXED_WING,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
    MISSION_ACK,
    MISSION_ITEM,
    MISSION_ITEM_INT,
    RALLY_FETCH_POINT,
    REQUEST_DATA_STREAM,
    SET_MODE,
    SET_POSITION_TARGET_GLOBAL_INT,
    SET_POSITION_TARGET_LOCAL_NED,
    TERRAIN_CHECK,
    TERRAIN_REPORT,
    TIMESYNC,
    decode_command_int,
    decode_command_long,
    decode_fence_fetch_point,
    decode_mission_item,
    decode_mission_item_int,
    decode_request_data_stream,
    decode_set_mode,
    decode_terrain_check,
    decode_timesync,
    encode_command_ack,
    encode_log_entry,
    encode_mission_ack,
    encode_timesync,
)
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, component, find, message_id, system, target, unpack, version
from cosim_models.autopilot.commander.reboot import ask_to_reboot
from cosim_models.autopilot.gcs.answers import NOT_HERE, answer, is_surface
from cosim_models.autopilot.gcs.devices import test_motors
from cosim_models.autopilot.gcs.rows import ROWS, group_of, is_absent, row_of
from cosim_models.autopilot.gcs.sending import can_answer, send
from cosim_models.autopilot.gcs.sensors import put_terrain
from cosim_models.autopilot.gcs.streams import ready, send_message, set_interval
from cosim_models.autopilot.gcs.targets import go_to, is_place, locate, say_home
from cosim_models.autopilot.gcs.words import (
    FENCE_FETCH_BAD,
    FENCE_FETCH_OLD,
    LOG_DISARM,
    MODE_FAILED,
    NO_MESSAGE,
    NO_MODE,
    NO_Q_MODES,
    RALLY_FETCH_BAD,
    RALLY_FETCH_OLD,
    UNKNOWN_FRAME,
    say,
)
from cosim_models.autopilot.link.available_modes import AVAILABLE_MODES, AVAILABLE_MODES_MONITOR, ask_for_modes

__all__ = ["Firmware", "firmware", "receiver", "repeat_home", "told"]

_FORCE = 21196.0  # param2 of COMPONENT_ARM_DISARM
_WHOLE = 2147483647.0
_FRAMES = (0, 3, 5, 6, 10, 11)  # MAV_FRAMEs whose heights refer to the sea, home or terrain
_COMMAND_ACK = cast(int, np.int64(COMMAND_ACK))
_MISSION_ACK = cast(int, np.int64(MISSION_ACK))
_LOG_ENTRY = cast(int, np.int64(LOG_ENTRY))
_HOME_AGAIN = 6.0  # s
_MONITORED = 5.0  # s between AVAILABLE_MODES_MONITORs after the first request for modes
_TERRAIN = cast(int, np.int64(TERRAIN_REPORT))
_ABOVE_HOME = (3, 6)  # MAV_FRAMEs
_TIMESYNC = cast(int, np.int64(TIMESYNC))

Firmware = tuple[Any, ...]


def firmware(
    guided: int,
    rtl: int,
    change_mode: Callable[[Any, int, float], int],
    arm: Callable[[Any, bool, float], int],
    command: Callable[[Any, int, float, float, float, float], int],
    hear: Callable[[Any, int, float], None],
    other: Callable[[Any, int, int, int, float], None],
    test: Callable[[Any, float, float, float, float, float], int] | None = None,
) -> Firmware:
    """Returns the properties of a firmware for `receiver`.

    Args:
        guided, rtl: numbers of these modes.
        change_mode: kernel of (record, mode, time): changes the mode if it can; returns a MAV_RESULT.
        arm: kernel of (record, whether forced, time): arms if it can; returns a MAV_RESULT.
        command: kernel of (record, MAV_CMD, param1, param2, param7, time) for commands that are not handled here;
            returns a MAV_RESULT.
        hear: kernel of (record, message id, time) for SET_POSITION_TARGET_* received in GUIDED.
        other: kernel of (record, message id, sender, its component, time) for all other messages.
        test: kernel of (record, param1 to param4, time) for DO_MOTOR_TEST of rovers and boats; returns a MAV_RESULT.
    """
    return guided, rtl, change_mode, arm, command, hear, other, _no_test if test is None else test


@kernel
def _no_test(m: Any, p1: float, p2: float, p3: float, p4: float, t: float) -> int:  # noqa: ARG001
    return MAV_RESULT_UNSUPPORTED


def told(change_mode: Callable[[Any, int, float], int], modes: Sequence[int]) -> Callable[[Any, int, float], int]:
    """Returns the kernel `change_mode` with ArduPilot's texts for a mode that is not entered.

    Args:
        change_mode: as for `firmware`.
        modes: numbers of the modes of ArduPilot's firmware, also of those that are not flown here.
    """
    known = np.array(modes, dtype=np.int64)

    @kernel
    def change(m: Any, mode: int, t: float) -> int:
        result = change_mode(m, mode, t)
        if result == MAV_RESULT_FAILED:
            text = NO_MODE
            for i in range(known.size):
                if known[i] == mode:
                    text = MODE_FAILED
            if m.kind == MAV_TYPE_FIXED_WING and not m.lifts and 17 <= mode <= 23:  # QSTABILIZE to QACRO
                text = NO_Q_MODES
            say(m, MAV_SEVERITY_WARNING, text, mode)
        return int(result)

    return change


@kernel
def _set_message_interval(m: Any, message: float, microseconds: float, t: float) -> int:
    row = row_of(message)
    if microseconds < -1.0 or not math.isfinite(microseconds):
        return MAV_RESULT_DENIED
    if row < 0:
        if is_absent(message):
            return MAV_RESULT_ACCEPTED
        if 0.0 <= message < 16777216.0:
            say(m, MAV_SEVERITY_INFO, NO_MESSAGE, int(message))
        return MAV_RESULT_DENIED
    interval = 0.0
    if microseconds > 0.0:
        interval = max(math.floor(min(microseconds, 6e7) / 1000.0), 1.0) * 1e-3
    set_interval(m, row, interval, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _request_message(m: Any, message: float, argument: float, t: float) -> int:
    row = row_of(message)
    if is_absent(message):
        return MAV_RESULT_ACCEPTED
    if row < 0 or not can_answer(m):
        return MAV_RESULT_FAILED
    if message == AVAILABLE_MODES:
        ask_for_modes(m, argument)
        m.due[row] = t + m.interval[row]
        m.next_due = min(m.next_due, m.due[row])
        set_interval(m, row_of(float(AVAILABLE_MODES_MONITOR)), _MONITORED, t)
    return MAV_RESULT_ACCEPTED if send_message(m, row, t) else MAV_RESULT_FAILED


@kernel
def _tell_home(m: Any, t: float) -> int:
    """Sends HOME_POSITION and GPS_GLOBAL_ORIGIN."""
    if not ready(m, t):
        return MAV_RESULT_FAILED
    result = _request_message(m, float(HOME_POSITION), 0.0, t)
    _request_message(m, float(GPS_GLOBAL_ORIGIN), 0.0, t)
    return result


@kernel
def repeat_home(m: Any, t: float) -> None:
    """Tells home again, as ArduPlane does while it is disarmed and home follows it; required from m.home_due on."""
    m.home_due = m.estimate_ready_time
    if ready(m, t):
        m.home_due = t + _HOME_AGAIN - 1e-9
        if not m.home_set:
            _tell_home(m, t)


@kernel
def _set_home(m: Any, p1: float, frame: int, lat: int, lon: int, z: float, t: float) -> int:
    """Makes the present place home (param1 is 1, or there is no place), or a given one, until it is set again."""
    if p1 == 1.0 or (lat == 0 and lon == 0 and z == 0.0):
        if not ready(m, t):
            return MAV_RESULT_FAILED
        n, e, d = m.position[0], m.position[1], m.position[2]
    elif p1 != 0.0:
        return MAV_RESULT_FAILED
    elif frame not in _FRAMES:
        say(m, MAV_SEVERITY_INFO, UNKNOWN_FRAME, frame)
        return MAV_RESULT_DENIED
    elif not is_place(frame, lat, lon, z):
        return MAV_RESULT_FAILED
    else:
        n, e, d = locate(m, frame, lat, lon, z)
    m.home[0], m.home[1], m.home[2] = n, e, d
    m.home_set = True
    if m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT):
        say_home(m)
    _tell_home(m, t)
    return MAV_RESULT_ACCEPTED


@kernel
def _place_refused(m: Any, command: int, frame: int, lat: int, lon: int, z: float) -> int:
    """Returns ACCEPTED, or the MAV_RESULT for a command whose place or frame is refused."""
    if command in (MAV_CMD_DO_SET_ROI, MAV_CMD_DO_SET_ROI_LOCATION):
        if frame not in _FRAMES:
            say(m, MAV_SEVERITY_INFO, UNKNOWN_FRAME, frame)
            return MAV_RESULT_DENIED
        return MAV_RESULT_ACCEPTED if is_place(frame, lat, lon, z) else MAV_RESULT_FAILED
    flies = m.kind not in (MAV_TYPE_QUADROTOR, MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
    if command == MAV_CMD_NAV_TAKEOFF and flies and frame not in _ABOVE_HOME:
        return MAV_RESULT_DENIED
    return MAV_RESULT_ACCEPTED


@kernel
def _answer_others(m: Any, message: int) -> bool:
    """Answers deprecated requests, and those for logs and terrain; returns whether `message` is one of these."""
    if message == FENCE_FETCH_POINT:
        _, _, number = decode_fence_fetch_point(m.received)
        say(m, MAV_SEVERITY_INFO, FENCE_FETCH_OLD, 0)
        say(m, MAV_SEVERITY_WARNING, FENCE_FETCH_BAD, number)
    elif message == RALLY_FETCH_POINT:
        say(m, MAV_SEVERITY_INFO, RALLY_FETCH_OLD, 0)
        say(m, MAV_SEVERITY_WARNING, RALLY_FETCH_BAD, 0)
    elif message in (LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_ERASE):
        if m.armed and not m.logs_told:
            say(m, MAV_SEVERITY_ERROR, LOG_DISARM, 0)
        m.logs_told = m.armed
        if message == LOG_REQUEST_LIST and not m.armed and can_answer(m):
            encode_log_entry(m.payload, 0, 0, 0, 0, 0)  # none is on board
            send(m, _LOG_ENTRY)
    elif message == TERRAIN_CHECK and m.kind not in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT):
        lat, lon = decode_terrain_check(m.received)
        put_terrain(m, lat, lon)
        send(m, _TERRAIN)
    else:
        return False
    return True


@kernel
def _request_stream(m: Any, t: float) -> None:
    _, _, stream, rate, start = decode_request_data_stream(m.received)
    interval = 1.0 / rate if start != 0 and rate > 0 else 0.0
    for row in range(ROWS):
        group = group_of(row)
        if group != 0 and (stream == 0 or stream == group):
            set_interval(m, row, interval, t)


def _commands(of: Firmware) -> Callable[[Any, int, tuple[float, float, float, float], float, float], int]:
    """Returns a kernel of (record, MAV_CMD, params 1 to 4, param7, time) that obeys a command: its MAV_RESULT."""
    _, rtl, change_mode, arm, command_of, _, _, _ = of

    @kernel
    def arm_or_disarm(m: Any, p1: float, p2: float, t: float) -> int:
        if p1 == 1.0:
            return MAV_RESULT_ACCEPTED if m.armed else arm(m, p2 == _FORCE, t)
        if p1 != 0.0:
            return MAV_RESULT_UNSUPPORTED
        if not (m.on_ground or not m.armed or p2 == _FORCE):
            return MAV_RESULT_FAILED
        m.armed = False
        return MAV_RESULT_ACCEPTED

    @kernel
    def command(m: Any, command: int, p: tuple[float, float, float, float], p7: float, t: float) -> int:
        p1, p2 = p[0], p[1]
        if command == MAV_CMD_COMPONENT_ARM_DISARM:
            return int(arm_or_disarm(m, p1, p2, t))
        if command == MAV_CMD_DO_SET_MODE:
            if (
                not 0.0 <= p1 <= 255.0
                or (int(p1) & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) == 0
                or not 0.0 <= p2 < 16777216.0
            ):
                return MAV_RESULT_DENIED
            return int(change_mode(m, int(p2), t))
        if command == MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return int(change_mode(m, rtl, t))
        if command == MAV_CMD_SET_MESSAGE_INTERVAL:
            return _set_message_interval(m, p1, p2, t)
        if command == MAV_CMD_REQUEST_MESSAGE:
            return _request_message(m, p1, p2, t)
        if command == MAV_CMD_GET_HOME_POSITION:
            return _tell_home(m, t)
        if command == MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return _request_message(m, float(AUTOPILOT_VERSION), 0.0, t) if p1 == 1.0 else MAV_RESULT_FAILED
        result = answer(m, command, p, t)
        return int(command_of(m, command, p1, p2, p7, t)) if result == NOT_HERE else int(result)

    return command


def _places(of: Firmware) -> tuple[Callable[..., int], Callable[[Any, int, int, int, float], None]]:
    """Returns the kernels for places to fly to in GUIDED: of DO_REPOSITION, and of mission items with current 2."""
    guided, _, change_mode, _, _, _, other, _ = of

    @kernel
    def reposition(m: Any, frame: int, flags: float, lat: int, lon: int, z: float, t: float) -> int:
        change = 0.0 <= flags < 16777216.0 and (int(flags) & MAV_DO_REPOSITION_FLAGS_CHANGE_MODE) != 0
        if m.mode != guided and not change:
            return MAV_RESULT_DENIED
        if not is_place(frame, lat, lon, z) or (lat == 0 and lon == 0):
            if frame not in _FRAMES:
                say(m, MAV_SEVERITY_INFO, UNKNOWN_FRAME, frame)
            return MAV_RESULT_DENIED
        if m.mode != guided and change_mode(m, guided, t) != MAV_RESULT_ACCEPTED:
            return MAV_RESULT_FAILED
        n, e, d = locate(m, frame, lat, lon, z)
        go_to(m, n, e, d)
        return MAV_RESULT_ACCEPTED

    @kernel
    def guided_item(m: Any, frame: int, lat: int, lon: int, z: float, sender: int, part: int) -> None:
        done = m.mode == guided and is_place(frame, lat, lon, z)
        if done:
            n, e, d = locate(m, frame, lat, lon, z)
            go_to(m, n, e, d)
        encode_mission_ack(
            m.payload, sender, part, MAV_MISSION_ACCEPTED if done else MAV_MISSION_ERROR, MAV_MISSION_TYPE_MISSION
        )
        send(m, _MISSION_ACK)

    @kernel
    def item(m: Any, message: int, sender: int, part: int, t: float) -> None:
        if message == MISSION_ITEM_INT:
            r = decode_mission_item_int(m.received)
            if r[5] == 2 and r[14] == 0:
                guided_item(m, r[3], r[11], r[12], r[13], sender, part)
                return
        else:
            q = decode_mission_item(m.received)
            if q[5] == 2 and q[14] == 0 and abs(q[11]) <= 90.0 and abs(q[12]) <= 180.0:
                guided_item(m, q[3], int(q[11] * 1e7), int(q[12] * 1e7), q[13], sender, part)
                return
        other(m, message, sender, part, t)

    return reposition, item


def _dispatcher(of: Firmware) -> Callable[[Any, int, int, int, float], None]:
    """Returns a kernel of (record, message id, sender, its component, time) that processes the received message."""
    guided, _, change_mode, _, _, hear, other, test = of
    command = _commands(of)
    reposition, item = _places(of)

    @kernel
    def dispatch(m: Any, message: int, sender: int, part: int, t: float) -> None:
        if message == COMMAND_LONG:
            _, _, command_id, _, p1, p2, p3, p4, p5, p6, p7 = decode_command_long(m.received)
            if command_id == MAV_CMD_DO_SET_HOME:
                place = abs(p5) <= 90.0 and abs(p6) <= 180.0  # else no number, or off the globe
                x, y = (int(p5 * 1e7), int(p6 * 1e7)) if place else (910000000, 0)
                result = _set_home(m, p1, 0, x, y, p7, t)
            elif command_id == MAV_CMD_DO_MOTOR_TEST and m.lifts:
                result = test_motors(m, p1, p2, p3, p4, p5, t)
            elif command_id == MAV_CMD_DO_MOTOR_TEST and is_surface(m):
                result = test(m, p1, p2, p3, p4, t)
            elif command_id == MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN and m.kind != MAV_TYPE_QUADROTOR:
                result = ask_to_reboot(m, p1, int(p6) if abs(p6) < _WHOLE else 0, t)
            else:
                result = command(m, command_id, (p1, p2, p3, p4), p7, t)
            encode_command_ack(m.payload, command_id, result, 0, 0, sender, part)
            send(m, _COMMAND_ACK)
        elif message == COMMAND_INT:
            _, _, frame, command_id, _, _, p1, p2, p3, p4, x, y, z = decode_command_int(m.received)
            if command_id == MAV_CMD_DO_REPOSITION:
                result = reposition(m, frame, p2, x, y, z, t)
            elif command_id == MAV_CMD_DO_SET_HOME:
                result = _set_home(m, p1, frame, x, y, z, t)
            elif command_id == MAV_CMD_DO_MOTOR_TEST and m.lifts:
                result = test_motors(m, p1, p2, p3, p4, float(x), t)
            elif command_id == MAV_CMD_DO_MOTOR_TEST and is_surface(m):
                result = test(m, p1, p2, p3, p4, t)
            elif command_id == MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN and m.kind != MAV_TYPE_QUADROTOR:
                result = ask_to_reboot(m, p1, y, t)
            else:
                result = _place_refused(m, command_id, frame, x, y, z)
                if result == MAV_RESULT_ACCEPTED:
                    result = command(m, command_id, (p1, p2, p3, p4), z, t)
            encode_command_ack(m.payload, command_id, result, 0, 0, sender, part)
            send(m, _COMMAND_ACK)
        elif message == SET_MODE:
            _, base_mode, mode = decode_set_mode(m.received)
            if (base_mode & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED) != 0:
                change_mode(m, mode, t)
        elif message in (SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT):
            if m.mode == guided:
                hear(m, message, t)
        elif message == REQUEST_DATA_STREAM:
            _request_stream(m, t)
        elif message == TIMESYNC:
            theirs, sent = decode_timesync(m.received)
            if theirs == 0 and can_answer(m):
                encode_timesync(m.payload, int(1e6 * t + 0.5) * 1000, sent)
                send(m, _TIMESYNC)
        elif message in (MISSION_ITEM, MISSION_ITEM_INT):
            item(m, message, sender, part, t)
        elif m.kind == MAV_TYPE_QUADROTOR or not _answer_others(m, message):
            other(m, message, sender, part, t)

    return dispatch


def receiver(of: Firmware) -> Callable[[Any, float], None]:
    """Returns a kernel of (record, time [s]) that processes the packets received in a step, and answers them."""
    dispatch = _dispatcher(of)

    @kernel
    def receive(m: Any, t: float) -> None:
        p = 0
        while True:
            start, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
            if status in (NOTHING, TRUNCATED):
                return
            if status != GOOD and status != SIGNED:
                continue
            sender = system(m.mavlink_rx, start)
            to_system, to_component = target(m.mavlink_rx, start)
            for_vehicle = to_system == 0 or to_system == m.SYSID_THISMAV
            if sender == m.SYSID_THISMAV:
                m.component_known[component(m.mavlink_rx, start)] = 1
            absent = m.kind != MAV_TYPE_QUADROTOR and m.component_known[to_component] == 0
            if not for_vehicle or not (to_component in (0, MAV_COMP_ID_AUTOPILOT1) or absent):
                continue
            if sender == m.SYSID_THISMAV and component(m.mavlink_rx, start) == MAV_COMP_ID_AUTOPILOT1:
                continue
            m.version = version(m.mavlink_rx, start)
            unpack(m.mavlink_rx, start, m.received)
            dispatch(m, message_id(m.mavlink_rx, start), sender, component(m.mavlink_rx, start), t)

    return receive
