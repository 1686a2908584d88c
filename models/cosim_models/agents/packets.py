"""What `LineAgent` hears and says: its record's view of the MAVLink packets of a step, as kernels.

Nothing is decided here. Heard is only what concerns the agent: its own autopilot, and its neighbours' positions.
"""

from __future__ import annotations

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

__all__ = [
    "ACCEPTED",
    "ARM_DISARM",
    "DO_SET_MODE",
    "GUIDED",
    "MODE_FLAG_CUSTOM",
    "NAV_TAKEOFF",
    "SET_MESSAGE_INTERVAL",
    "SLACK",
    "ask",
    "go",
    "heartbeat",
    "receive",
]

# MAVLink, common.xml
NAV_TAKEOFF, DO_SET_MODE, ARM_DISARM, SET_MESSAGE_INTERVAL = 22, 176, 400, 511  # MAV_CMD
ACCEPTED = 0  # MAV_RESULT
MODE_FLAG_CUSTOM = 1  # MAV_MODE_FLAG
GUIDED = 4  # ArduCopter's mode number
_MODE_FLAG_ARMED = 128
_AUTOPILOT1, _ONBOARD_COMPUTER = 1, 191  # MAV_COMP_ID
_TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, _STATE_ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
_FRAME_RELATIVE_ALT_INT = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_ONLY_POSITION = 0x0DF8  # POSITION_TARGET_TYPEMASK: velocity, acceleration, yaw and yaw rate ignored
_EKF_POS_HORIZ_ABS, _EKF_CONST_POS_MODE, _EKF_PRED_POS_HORIZ_ABS = 16, 128, 512  # EKF_STATUS_FLAGS
_GPS_FIX_2D = 2  # GPS_FIX_TYPE

_RETRY = 1.0  # s between repetitions of a command, and between own heartbeats
SLACK = 1e-9
"""Of times that are multiples of the step size up to rounding [s]."""


# ---- receiving ---------------------------------------------------------------------------------------------------


@kernel
def _on_line(m: Any, longitude: float) -> float:
    """Position on the line of a longitude [rad], in m."""
    distance = haversine(m.origin_latitude, m.origin_longitude, m.origin_latitude, longitude, EARTH_RADIUS_ARDUPILOT)
    return distance if wrap_pi(longitude - m.origin_longitude) >= 0.0 else -distance


@kernel
def receive(m: Any, now: float) -> None:
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
    _, latitude, longitude, _, _, _, _, _, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:  # an autopilot that does not know where it is
        return
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
            m.guided = base_mode & MODE_FLAG_CUSTOM != 0 and custom_mode == GUIDED
    elif message == GLOBAL_POSITION_INT:
        _, latitude, longitude, _, relative_alt, _, _, _, _ = decode_global_position_int(m.payload)
        if latitude == 0 and longitude == 0:
            return
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
            if result != ACCEPTED:
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
def heartbeat(m: Any, now: float) -> None:
    if now < m.heartbeat_due - SLACK:
        return
    m.heartbeat_due = now + _RETRY
    encode_heartbeat(m.payload, _TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, 3)
    _send(m, int(np.int64(HEARTBEAT)))


@kernel
def ask(m: Any, now: float, command: int, p1: float, p2: float, p7: float) -> None:
    """Send a command to the own autopilot, again every second until it has been accepted."""
    if m.asked == command and (m.answer == ACCEPTED or now < m.asked_at + _RETRY - SLACK):
        return
    m.confirmation = m.confirmation + 1 if m.asked == command else 0
    m.asked = command
    m.asked_at = now
    m.answer = -1
    zero = 0.0
    encode_command_long(m.payload, m.sysid, _AUTOPILOT1, command, m.confirmation, p1, p2, zero, zero, zero, zero, p7)
    _send(m, int(np.int64(COMMAND_LONG)))


@kernel
def go(m: Any, now: float, target: float) -> None:
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
