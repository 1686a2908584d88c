"""The script of `LineAgent` as kernels over its record: receive, wait or step, send.

What the agent is for is told there; here are its states, why it gives up, and the packets of each.
"""

from __future__ import annotations

from enum import IntEnum
from math import floor
from typing import Any

import numpy as np

from cosim.frames import EARTH_RADIUS_ARDUPILOT, deg_e7, haversine, longitude_at, radians_from_deg_e7, wrap_pi
from cosim.kernel import kernel
from cosim.messages import (
    COMMAND_ACK,
    COMMAND_LONG,
    EKF_STATUS_REPORT,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_command_ack,
    decode_ekf_status_report,
    decode_global_position_int,
    decode_gps_raw_int,
    decode_heartbeat,
    encode_command_long,
    encode_heartbeat,
    encode_set_position_target_global_int,
)
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, component, find, message_id, pack, system, unpack
from cosim_models.consensus import consensus_step

__all__ = ["ERRORS", "NEVER", "AgentState", "Failure", "StalePolicy", "Trigger", "advance", "start"]


class AgentState(IntEnum):
    """What the agent waits for, or does."""

    waiting = 1
    """for a HEARTBEAT of its autopilot"""
    streams = 2
    """for the acceptance of the streams it asked for"""
    estimate = 3
    """for GPS fix, position estimate and its own position"""
    mode = 4
    """for mode GUIDED"""
    arming = 5
    """for the motors to be armed"""
    takeoff = 6
    """to reach 95 % of the altitude"""
    ready = 7
    """hovering, for the first step"""
    formation = 8
    """stepping"""
    failed = 9
    """given up, see `failure`; it commands nothing any more"""


class Failure(IntEnum):
    """Why the agent has given up."""

    none = 0
    no_heartbeat = 1
    no_streams = 2
    no_position_estimate = 3
    not_guided = 4
    not_armed = 5
    not_at_altitude = 6
    left_guided = 7
    disarmed = 8


class Trigger(IntEnum):
    """What begins a step."""

    period = 1
    """time: every `period` seconds"""
    arrival = 2
    """arrival within `arrival_radius`, with news of every neighbour since the last step; or `period` seconds"""


class StalePolicy(IntEnum):
    """What counts for a neighbour that has not been heard for `stale_time`."""

    hold = 1
    """its last position, unless all neighbours are stale: then the agent stays (and is a fixed node to the others)"""
    drop = 2
    """nothing, as if it were not there"""
    freeze = 3
    """the agent stays as long as any neighbour is stale"""


# MAVLink, common.xml
_AUTOPILOT1, _ONBOARD_COMPUTER = 1, 191  # MAV_COMP_ID
_TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, _STATE_ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
_MODE_FLAG_ARMED, _MODE_FLAG_CUSTOM = 128, 1  # MAV_MODE_FLAG
_NAV_TAKEOFF, _DO_SET_MODE, _ARM_DISARM, _SET_MESSAGE_INTERVAL = 22, 176, 400, 511  # MAV_CMD
_ACCEPTED = 0  # MAV_RESULT
_FRAME_RELATIVE_ALT_INT = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_ONLY_POSITION = 0x0DF8  # POSITION_TARGET_TYPEMASK: velocity, acceleration, yaw and yaw rate ignored
_EKF_POS_HORIZ_ABS, _EKF_CONST_POS_MODE, _EKF_PRED_POS_HORIZ_ABS = 16, 128, 512  # EKF_STATUS_FLAGS
_GPS_FIX_2D = 2  # GPS_FIX_TYPE
_GUIDED = 4  # ArduCopter's mode number

_RETRY = 1.0  # s between repetitions of a command, and between own heartbeats
_STATUS_INTERVAL = 1e6  # us, of EKF_STATUS_REPORT and GPS_RAW_INT
_REACHED = 0.95  # part of the altitude at which the take-off is over
_SLACK = 1e-9  # of times that are multiples of the step size up to rounding
NEVER = -1.0
"""An age or a time of what has not been heard yet [s]."""

ERRORS = {
    1: "sysid must be 1 to 255",
    2: "left_sysid and right_sysid must be 0 to 255 and not the agent's own",
    3: "period, position_rate, altitude and timeout must be positive",
}

_WAITING, _STREAMS, _ESTIMATE = int(AgentState.waiting), int(AgentState.streams), int(AgentState.estimate)
_MODE, _ARMING, _TAKEOFF = int(AgentState.mode), int(AgentState.arming), int(AgentState.takeoff)
_READY, _FORMATION, _FAILED = int(AgentState.ready), int(AgentState.formation), int(AgentState.failed)
_LEFT_GUIDED, _DISARMED = int(Failure.left_guided), int(Failure.disarmed)
_BY_PERIOD = int(Trigger.period)
_DROP, _FREEZE = int(StalePolicy.drop), int(StalePolicy.freeze)


# ---- receiving ---------------------------------------------------------------------------------------------------


@kernel
def _on_line(m: Any, longitude: float) -> float:
    """Position on the line of a longitude [rad], in m."""
    distance = haversine(m.origin_latitude, m.origin_longitude, m.origin_latitude, longitude, EARTH_RADIUS_ARDUPILOT)
    return distance if wrap_pi(longitude - m.origin_longitude) >= 0.0 else -distance


@kernel
def _receive(m: Any, now: float) -> None:
    """Take what concerns this agent out of the packets of the step; anything else is passed over."""
    p = 0
    while True:
        begin, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
        if status in (NOTHING, TRUNCATED):
            return
        if (status != GOOD and status != SIGNED) or component(m.mavlink_rx, begin) != _AUTOPILOT1:
            continue
        sender = system(m.mavlink_rx, begin)
        message = message_id(m.mavlink_rx, begin)
        if sender == m.sysid:
            unpack(m.mavlink_rx, begin, m.payload)
            _from_autopilot(m, message, now)
        elif message == GLOBAL_POSITION_INT and sender != 0 and (sender == m.left_sysid or sender == m.right_sysid):
            unpack(m.mavlink_rx, begin, m.payload)
            _from_neighbour(m, sender, now)


@kernel
def _from_neighbour(m: Any, sender: int, now: float) -> None:
    _, _, longitude, _, _, _, _, _, _ = decode_global_position_int(m.payload)
    place = _on_line(m, radians_from_deg_e7(longitude))
    if sender == m.left_sysid:
        m.left_position = place
        m.left_heard = now
    if sender == m.right_sysid:
        m.right_position = place
        m.right_heard = now


@kernel
def _from_autopilot(m: Any, message: int, now: float) -> None:
    if message == HEARTBEAT:
        _, autopilot, base_mode, custom_mode, _, _ = decode_heartbeat(m.payload)
        if autopilot != _AUTOPILOT_INVALID:
            m.heard = True
            m.armed = base_mode & _MODE_FLAG_ARMED != 0
            m.guided = base_mode & _MODE_FLAG_CUSTOM != 0 and custom_mode == _GUIDED
    elif message == GLOBAL_POSITION_INT:
        _, latitude, longitude, _, relative_alt, _, _, _, _ = decode_global_position_int(m.payload)
        m.latitude = latitude
        m.height = 0.001 * relative_alt
        m.position = _on_line(m, radians_from_deg_e7(longitude))
        m.position_heard = now
    elif message == EKF_STATUS_REPORT:
        flags = decode_ekf_status_report(m.payload)[0]
        absolute = flags & (_EKF_PRED_POS_HORIZ_ABS | _EKF_POS_HORIZ_ABS) != 0
        m.estimate = absolute and flags & _EKF_CONST_POS_MODE == 0
    elif message == GPS_RAW_INT:
        m.fix = decode_gps_raw_int(m.payload)[1] >= _GPS_FIX_2D
    elif message == COMMAND_ACK:
        command, result, _, _, target_system, target_component = decode_command_ack(m.payload)
        # MAVLink 1 has no target in this message; 0 is everybody.
        mine = target_system == 0 or target_system == m.sysid
        if mine and (target_component == 0 or target_component == _ONBOARD_COMPUTER):
            if command == m.asked:
                m.answer = result
            if result != _ACCEPTED:
                m.refusal = result


# ---- sending -----------------------------------------------------------------------------------------------------


@kernel
def _send(m: Any, message: int) -> None:
    """Append the message in the payload buffer; the capacity is enough for all that one step can send.

    Callers pass `message` as an int64, not as a literal, for each of which numba would compile this anew.
    """
    m.mavlink_tx_len = pack(m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sent, m.sysid, _ONBOARD_COMPUTER, 2)
    m.sent = (m.sent + 1) & 0xFF


@kernel
def _heartbeat(m: Any, now: float) -> None:
    if now < m.heartbeat_due - _SLACK:
        return
    m.heartbeat_due = now + _RETRY
    encode_heartbeat(m.payload, _TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, 3)
    _send(m, int(np.int64(HEARTBEAT)))


@kernel
def _accepted(m: Any, command: int) -> bool:
    """Whether the autopilot has accepted the command that waits for its answer."""
    return bool(m.asked == command and m.answer == _ACCEPTED)


@kernel
def _ask(m: Any, now: float, command: int, p1: float, p2: float, p7: float) -> None:
    """Send a command to the own autopilot, again every second until it has been accepted."""
    if m.asked == command and (m.answer == _ACCEPTED or now < m.asked_at + _RETRY - _SLACK):
        return
    m.confirmation = m.confirmation + 1 if m.asked == command else 0
    m.asked = command
    m.asked_at = now
    m.answer = -1
    zero = 0.0
    encode_command_long(m.payload, m.sysid, _AUTOPILOT1, command, m.confirmation, p1, p2, zero, zero, zero, zero, p7)
    _send(m, int(np.int64(COMMAND_LONG)))


@kernel
def _go(m: Any, now: float, target: float) -> None:
    """Make `target` [m on the line] the desired position and send it, at the latitude of the start."""
    m.target = target
    longitude = longitude_at(m.origin_latitude, m.origin_longitude, target, EARTH_RADIUS_ARDUPILOT)
    zero = 0.0
    encode_set_position_target_global_int(
        m.payload,
        int(1000.0 * now + 0.5),
        m.sysid,
        _AUTOPILOT1,
        _FRAME_RELATIVE_ALT_INT,
        _ONLY_POSITION,
        m.start_latitude,
        deg_e7(longitude),
        m.altitude,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
    )
    _send(m, int(np.int64(SET_POSITION_TARGET_GLOBAL_INT)))


# ---- the state machine -------------------------------------------------------------------------------------------


@kernel
def _next(m: Any, now: float) -> None:
    """Enter the next state."""
    m.state += 1
    m.state_since = now
    m.asked = 0


@kernel
def _fail(m: Any, failure: int) -> None:
    m.state = _FAILED
    m.failure = failure


@kernel
def _prepare(m: Any, now: float) -> None:
    """From the first heartbeat to hovering. A state left in this step begins its successor's work in the next."""
    if now - m.state_since >= m.timeout - _SLACK:
        _fail(m, m.state)  # the failures of these states have their numbers
        return
    command, p1, p2, p7 = 0, 0.0, 0.0, 0.0
    if m.state == _WAITING:
        if m.heard:
            _next(m, now)
    elif m.state == _STREAMS:
        command, p1, p2 = _stream(m, now)
    elif m.state == _ESTIMATE:
        if m.fix and m.estimate and m.position_heard >= 0.0:
            _next(m, now)
    elif m.state == _MODE:
        command, p1, p2 = _DO_SET_MODE, float(_MODE_FLAG_CUSTOM), float(_GUIDED)
        if m.guided:
            _next(m, now)
            command = 0
    elif m.state == _ARMING:
        command, p1 = _ARM_DISARM, 1.0
        if m.armed:
            m.start_latitude = m.latitude
            m.start_position = m.position
            m.target = m.position
            _next(m, now)
            command = 0
    elif m.height >= _REACHED * m.altitude and not _stale(m, m.position_heard, now):
        _next(m, now)
    else:
        command, p7 = _NAV_TAKEOFF, float(m.altitude)
    if command != 0:
        _ask(m, now, command, p1, p2, p7)


@kernel
def _stream(m: Any, now: float) -> tuple[int, float, float]:
    """The command and its parameters for the next stream that is wanted; command 0 when all have been accepted.

    ArduPilot sends a new link only heartbeats. Positions, estimator and GPS status are asked for one by one: the
    answer does not say to which message it belongs.
    """
    if _accepted(m, _SET_MESSAGE_INTERVAL):
        m.streams += 1
        m.asked = 0
        if m.streams == 3:
            _next(m, now)
        return 0, 0.0, 0.0
    message, interval = GLOBAL_POSITION_INT, 1e6 / m.position_rate
    if m.streams == 1:
        message, interval = EKF_STATUS_REPORT, _STATUS_INTERVAL
    elif m.streams == 2:
        message, interval = GPS_RAW_INT, _STATUS_INTERVAL
    return _SET_MESSAGE_INTERVAL, float(message), interval


@kernel
def _supervise(m: Any) -> None:
    """Give up when the autopilot no longer is what the agent made it: a pilot has taken over, or it has landed."""
    if m.state == _FAILED:
        return
    if m.state >= _TAKEOFF and not m.armed:
        _fail(m, _DISARMED)
    elif m.state >= _ARMING and not m.guided:
        _fail(m, _LEFT_GUIDED)


@kernel
def _fly(m: Any, now: float) -> None:
    """Hovering and stepping, as long as the autopilot does what the agent believes."""
    period_step = 0
    if now >= m.first_step_time - _SLACK:
        period_step = 1 + floor((now - m.first_step_time) / m.period + _SLACK)
    begins = period_step > m.period_step
    m.period_step = period_step
    if m.state == _READY:
        if begins:
            m.step = period_step if m.trigger == _BY_PERIOD else 1
            m.step_at = now
            _go(m, now, m.start_position)
            _next(m, now)
    elif m.state == _FORMATION and (begins if m.trigger == _BY_PERIOD else _arrived(m, now)):
        m.step = period_step if m.trigger == _BY_PERIOD else m.step + 1
        m.step_at = now
        _go(m, now, _desired(m, now))


@kernel
def _arrived(m: Any, now: float) -> bool:
    if now >= m.step_at + m.period - _SLACK:
        return True
    news = m.position_heard > m.step_at
    if m.left_sysid != 0:
        news = news and m.left_heard > m.step_at
    if m.right_sysid != 0:
        news = news and m.right_heard > m.step_at
    return bool(news and abs(m.position - m.target) <= m.arrival_radius)


@kernel
def _stale(m: Any, heard: float, now: float) -> bool:
    return heard < 0.0 or now - heard > m.stale_time + _SLACK


@kernel
def _desired(m: Any, now: float) -> float:
    """The law's next position, or the present target where it cannot be applied."""
    if m.stubborn or _stale(m, m.position_heard, now):
        return float(m.target)
    has_left, has_right = m.left_sysid != 0, m.right_sysid != 0
    left_stale = has_left and _stale(m, m.left_heard, now)
    right_stale = has_right and _stale(m, m.right_heard, now)
    fresh = (has_left and not left_stale) or (has_right and not right_stale)
    if not fresh:
        return float(m.target)
    if m.stale_policy == _FREEZE and (left_stale or right_stale):
        return float(m.target)
    if m.stale_policy == _DROP:
        has_left = has_left and not left_stale
        has_right = has_right and not right_stale
    elif (has_left and m.left_heard < 0.0) or (has_right and m.right_heard < 0.0):
        return float(m.target)
    own = float(m.position)
    left = float(m.left_position) if has_left else own
    right = float(m.right_position) if has_right else own
    return consensus_step(own, left, right, m.epsilon)


# ---- the kernels of the FMU --------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Check the parameters; nothing has been heard yet."""
    if m.sysid < 1 or m.sysid > 255:
        return 1
    if not (0 <= m.left_sysid <= 255 and 0 <= m.right_sysid <= 255):
        return 2
    if m.left_sysid == m.sysid or m.right_sysid == m.sysid:
        return 2
    if not (m.period > 0.0 and m.position_rate > 0.0 and m.altitude > 0.0 and m.timeout > 0.0):
        return 3
    m.state = _WAITING
    m.position_heard = NEVER
    m.left_heard = NEVER
    m.right_heard = NEVER
    m.left_age = NEVER
    m.right_age = NEVER
    m.answer = -1
    m.refusal = 0
    return 0


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """One step of the script at time `t` [s]: read what has arrived, act, send."""
    m.mavlink_tx_len = 0
    _receive(m, t)
    _heartbeat(m, t)
    _supervise(m)
    if m.state < _READY:
        _prepare(m, t)
    _fly(m, t)
    m.left_age = t - m.left_heard if m.left_heard >= 0.0 else NEVER
    m.right_age = t - m.right_heard if m.right_heard >= 0.0 else NEVER
    return 0
