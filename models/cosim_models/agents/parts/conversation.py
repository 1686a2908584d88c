"""Kernels for the messages between an agent and its own autopilot: heartbeats, commands and their answers.

Agents run on the drone's companion computer: they share the autopilot's system id and are component 191. Positions,
set-points and messages from other drones are handled elsewhere: for the line's agent in `line`, for agents made with
the kit in `kit`.

The record of an agent has `CONVERSATION` among its variables.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim import Memory, Variable
from cosim.kernel import kernel
from cosim.messages import (
    COMMAND_ACK,
    COMMAND_INT,
    COMMAND_LONG,
    COPTER_MODE_GUIDED,
    EKF_CONST_POS_MODE,
    EKF_POS_HORIZ_ABS,
    EKF_PRED_POS_HORIZ_ABS,
    EKF_STATUS_REPORT,
    GLOBAL_POSITION_INT,
    GPS_FIX_TYPE_2D_FIX,
    GPS_RAW_INT,
    HEARTBEAT,
    MAV_AUTOPILOT_INVALID,
    MAV_CMD_DO_REPOSITION,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_COMP_ID_ONBOARD_COMPUTER,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    MAV_MODE_FLAG_SAFETY_ARMED,
    MAV_RESULT_ACCEPTED,
    MAV_STATE_ACTIVE,
    MAV_TYPE_FIXED_WING,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_ONBOARD_CONTROLLER,
    MAV_TYPE_SURFACE_BOAT,
    MAV_TYPE_VTOL_DUOROTOR,
    MAV_TYPE_VTOL_RESERVED5,
    PLANE_MODE_GUIDED,
    decode_command_ack,
    decode_ekf_status_report,
    decode_gps_raw_int,
    decode_heartbeat,
    encode_command_int,
    encode_command_long,
    encode_heartbeat,
)
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, component, find, message_id, pack, system, unpack

__all__ = [
    "CONVERSATION",
    "NOBODY",
    "SLACK",
    "ask",
    "heartbeat",
    "next_number",
    "next_position",
    "reposition",
    "send",
]


_RETRY = 1.0  # s between repetitions of a command, and between own heartbeats
SLACK = 1e-9
"""Tolerance for times that are multiples of the step size up to rounding [s]."""

NOBODY = 0
"""Not the system id of a drone."""

CONVERSATION: tuple[Variable, ...] = (
    Memory("payload", dtype="u1", shape=255),
    Memory("sent", dtype="i4"),  # packets sent, modulo 256
    Memory("heartbeat_due"),  # s
    Memory("heard", dtype="?"),  # from the last heartbeat of the own autopilot:
    Memory("armed", dtype="?"),
    Memory("guided", dtype="?"),
    Memory("guided_mode", dtype="i4"),  # the number of GUIDED of its kind of vehicle
    Memory("surface", dtype="?"),  # a rover or a boat: it does not take off
    Memory("wings", dtype="?"),  # a plane, with ArduPlane's modes, which gets its positions by DO_REPOSITION
    Memory("vtol", dtype="?"),  # a plane that takes off vertically and hovers; others take off in a mode of their own
    Memory("estimate", dtype="?"),
    Memory("fix", dtype="?"),
    Memory("asked", dtype="i4"),  # command that waits for its answer
    Memory("asked_at"),  # s
    Memory("answer", dtype="i4"),  # its MAV_RESULT, -1 before
    Memory("confirmation", dtype="i4"),  # number of its repetitions
)
"""Memory of an agent for the conversation; it also needs `sysid`, `refusal` and the packet ports."""


# ---- receiving ---------------------------------------------------------------------------------------------------


@kernel
def next_position(m: Any, p: int) -> tuple[int, int]:
    """Processes the received packets from byte `p` on, up to the next GLOBAL_POSITION_INT of an autopilot.

    Messages of the own autopilot about its state are decoded. All other messages are ignored.

    Returns:
        The system id of the sender, whose message is then in the payload buffer, and the byte after the packet; NOBODY
        if there is no further position.
    """
    while True:
        begin, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
        if status in (NOTHING, TRUNCATED):
            return NOBODY, p
        if (status != GOOD and status != SIGNED) or component(m.mavlink_rx, begin) != MAV_COMP_ID_AUTOPILOT1:
            continue
        sender, message = system(m.mavlink_rx, begin), message_id(m.mavlink_rx, begin)
        if message == GLOBAL_POSITION_INT and sender != NOBODY:
            unpack(m.mavlink_rx, begin, m.payload)
            return sender, p
        if sender == m.sysid:
            unpack(m.mavlink_rx, begin, m.payload)
            _hear_autopilot(m, message)


@kernel
def _hear_autopilot(m: Any, message: int) -> None:
    """Decodes messages of the own autopilot about its state from the payload buffer; other messages are ignored."""
    if message == HEARTBEAT:
        kind, autopilot, base_mode, custom_mode, _, _ = decode_heartbeat(m.payload)
        if autopilot != MAV_AUTOPILOT_INVALID:
            m.surface = kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
            m.vtol = MAV_TYPE_VTOL_DUOROTOR <= kind <= MAV_TYPE_VTOL_RESERVED5
            m.wings = m.vtol or kind == MAV_TYPE_FIXED_WING
            # Rovers and boats have the number of planes.
            m.guided_mode = PLANE_MODE_GUIDED if m.surface or m.wings else COPTER_MODE_GUIDED
            m.heard = True
            m.armed = base_mode & MAV_MODE_FLAG_SAFETY_ARMED != 0
            m.guided = base_mode & MAV_MODE_FLAG_CUSTOM_MODE_ENABLED != 0 and custom_mode == m.guided_mode
    elif message == EKF_STATUS_REPORT:
        flags = decode_ekf_status_report(m.payload)[0]
        absolute = flags & (EKF_PRED_POS_HORIZ_ABS | EKF_POS_HORIZ_ABS) != 0
        m.estimate = absolute and flags & EKF_CONST_POS_MODE == 0
    elif message == GPS_RAW_INT:
        m.fix = decode_gps_raw_int(m.payload)[1] >= GPS_FIX_TYPE_2D_FIX
    elif message == COMMAND_ACK:
        command, result, _, _, target_system, target_component = decode_command_ack(m.payload)
        # In MAVLink 1, this message has no target; 0 means broadcast.
        mine = target_system == 0 or target_system == m.sysid
        if mine and (target_component == 0 or target_component == MAV_COMP_ID_ONBOARD_COMPUTER):
            if command == m.asked:
                m.answer = result
            if result != MAV_RESULT_ACCEPTED:
                m.refusal = result


# ---- sending -----------------------------------------------------------------------------------------------------


@kernel
def send(m: Any, message: int) -> None:
    """Appends the message in the payload buffer; the capacity suffices for all messages of one step.

    Callers pass `message` as an int64, not as a literal: numba would compile this function again for each literal.
    """
    m.mavlink_tx_len = pack(
        m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sent, m.sysid, MAV_COMP_ID_ONBOARD_COMPUTER, 2
    )
    m.sent = (m.sent + 1) & 0xFF


@kernel
def next_number(m: Any) -> int:
    """Returns the sequence number of the next packet, which the caller packs itself, and counts it."""
    number = int(m.sent)
    m.sent = (number + 1) & 0xFF
    return number


@kernel
def heartbeat(m: Any, now: float) -> None:
    """Sends a HEARTBEAT when one is due."""
    if now < m.heartbeat_due - SLACK:
        return
    m.heartbeat_due = now + _RETRY
    encode_heartbeat(m.payload, MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID, 0, 0, MAV_STATE_ACTIVE, 3)
    send(m, int(np.int64(HEARTBEAT)))


@kernel
def ask(m: Any, now: float, command: int, p1: float, p2: float, p7: float) -> None:
    """Sends a command to the own autopilot, and repeats it every second until it has been accepted."""
    if m.asked == command and (m.answer == MAV_RESULT_ACCEPTED or now < m.asked_at + _RETRY - SLACK):
        return
    m.confirmation = m.confirmation + 1 if m.asked == command else 0
    m.asked = command
    m.asked_at = now
    m.answer = -1
    zero = 0.0
    encode_command_long(
        m.payload, m.sysid, MAV_COMP_ID_AUTOPILOT1, command, m.confirmation, p1, p2, zero, zero, zero, zero, p7
    )
    send(m, int(np.int64(COMMAND_LONG)))


@kernel
def reposition(m: Any, frame: int, latitude: int, longitude: int, altitude: float) -> None:
    """Sends a fixed wing to a place, in degE7 and m: ArduPlane ignores positions in SET_POSITION_TARGET_*."""
    zero = 0.0
    encode_command_int(
        m.payload,
        m.sysid,
        MAV_COMP_ID_AUTOPILOT1,
        frame,
        MAV_CMD_DO_REPOSITION,
        0,
        0,
        -1.0,
        zero,
        zero,
        zero,
        latitude,
        longitude,
        altitude,
    )
    send(m, int(np.int64(COMMAND_INT)))
