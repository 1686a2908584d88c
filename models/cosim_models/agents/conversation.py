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
    COMMAND_LONG,
    EKF_STATUS_REPORT,
    GPS_RAW_INT,
    HEARTBEAT,
    decode_command_ack,
    decode_ekf_status_report,
    decode_gps_raw_int,
    decode_heartbeat,
    encode_command_long,
    encode_heartbeat,
)
from cosim.packets import pack

__all__ = [
    "ACCEPTED",
    "ARM_DISARM",
    "AUTOPILOT1",
    "CONVERSATION",
    "DO_SET_MODE",
    "MODE_FLAG_CUSTOM",
    "NAV_TAKEOFF",
    "SET_MESSAGE_INTERVAL",
    "SLACK",
    "ask",
    "hear_autopilot",
    "heartbeat",
    "send",
]

# MAVLink, common.xml
NAV_TAKEOFF, DO_SET_MODE, ARM_DISARM, SET_MESSAGE_INTERVAL = 22, 176, 400, 511  # MAV_CMD
ACCEPTED = 0  # MAV_RESULT
MODE_FLAG_CUSTOM = 1  # MAV_MODE_FLAG
AUTOPILOT1 = 1  # MAV_COMP_ID
_MODE_FLAG_ARMED = 128
_ONBOARD_COMPUTER = 191  # MAV_COMP_ID
_TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, _STATE_ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
_TYPE_FIXED_WING, _TYPE_GROUND_ROVER, _TYPE_SURFACE_BOAT = 1, 10, 11  # MAV_TYPE
_COPTERS_GUIDED, _OTHERS_GUIDED = 4, 15  # mode number of ArduCopter; of ArduPlane and ArduRover
_EKF_POS_HORIZ_ABS, _EKF_CONST_POS_MODE, _EKF_PRED_POS_HORIZ_ABS = 16, 128, 512  # EKF_STATUS_FLAGS
_GPS_FIX_2D = 2  # GPS_FIX_TYPE

_RETRY = 1.0  # s between repetitions of a command, and between own heartbeats
SLACK = 1e-9
"""Tolerance for times that are multiples of the step size up to rounding [s]."""

CONVERSATION: tuple[Variable, ...] = (
    Memory("payload", dtype="u1", shape=255),
    Memory("sent", dtype="i4"),  # packets sent, modulo 256
    Memory("heartbeat_due"),  # s
    Memory("heard", dtype="?"),  # from the last heartbeat of the own autopilot:
    Memory("armed", dtype="?"),
    Memory("guided", dtype="?"),
    Memory("guided_mode", dtype="i4"),  # the number of GUIDED of its kind of vehicle
    Memory("estimate", dtype="?"),
    Memory("fix", dtype="?"),
    Memory("asked", dtype="i4"),  # command that waits for its answer
    Memory("asked_at"),  # s
    Memory("answer", dtype="i4"),  # its MAV_RESULT, -1 before
    Memory("confirmation", dtype="i4"),  # number of its repetitions
)
"""Memory of an agent for the conversation; it also needs `sysid`, `refusal` and the packet output `mavlink_tx`."""


# ---- receiving ---------------------------------------------------------------------------------------------------


@kernel
def hear_autopilot(m: Any, message: int) -> None:
    """Decodes messages of the own autopilot about its state from the payload buffer; other messages are ignored."""
    if message == HEARTBEAT:
        kind, autopilot, base_mode, custom_mode, _, _ = decode_heartbeat(m.payload)
        if autopilot != _AUTOPILOT_INVALID:
            other = kind in (_TYPE_FIXED_WING, _TYPE_GROUND_ROVER, _TYPE_SURFACE_BOAT)
            m.guided_mode = _OTHERS_GUIDED if other else _COPTERS_GUIDED
            m.heard = True
            m.armed = base_mode & _MODE_FLAG_ARMED != 0
            m.guided = base_mode & MODE_FLAG_CUSTOM != 0 and custom_mode == m.guided_mode
    elif message == EKF_STATUS_REPORT:
        flags = decode_ekf_status_report(m.payload)[0]
        absolute = flags & (_EKF_PRED_POS_HORIZ_ABS | _EKF_POS_HORIZ_ABS) != 0
        m.estimate = absolute and flags & _EKF_CONST_POS_MODE == 0
    elif message == GPS_RAW_INT:
        m.fix = decode_gps_raw_int(m.payload)[1] >= _GPS_FIX_2D
    elif message == COMMAND_ACK:
        command, result, _, _, target_system, target_component = decode_command_ack(m.payload)
        # In MAVLink 1, this message has no target; 0 means broadcast.
        mine = target_system == 0 or target_system == m.sysid
        if mine and (target_component == 0 or target_component == _ONBOARD_COMPUTER):
            if command == m.asked:
                m.answer = result
            if result != ACCEPTED:
                m.refusal = result


# ---- sending -----------------------------------------------------------------------------------------------------


@kernel
def send(m: Any, message: int) -> None:
    """Appends the message in the payload buffer; the capacity suffices for all messages of one step.

    Callers pass `message` as an int64, not as a literal: numba would compile this function again for each literal.
    """
    m.mavlink_tx_len = pack(m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sent, m.sysid, _ONBOARD_COMPUTER, 2)
    m.sent = (m.sent + 1) & 0xFF


@kernel
def heartbeat(m: Any, now: float) -> None:
    """Sends a HEARTBEAT when one is due."""
    if now < m.heartbeat_due - SLACK:
        return
    m.heartbeat_due = now + _RETRY
    encode_heartbeat(m.payload, _TYPE_ONBOARD_CONTROLLER, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, 3)
    send(m, int(np.int64(HEARTBEAT)))


@kernel
def ask(m: Any, now: float, command: int, p1: float, p2: float, p7: float) -> None:
    """Sends a command to the own autopilot, and repeats it every second until it has been accepted."""
    if m.asked == command and (m.answer == ACCEPTED or now < m.asked_at + _RETRY - SLACK):
        return
    m.confirmation = m.confirmation + 1 if m.asked == command else 0
    m.asked = command
    m.asked_at = now
    m.answer = -1
    zero = 0.0
    encode_command_long(m.payload, m.sysid, AUTOPILOT1, command, m.confirmation, p1, p2, zero, zero, zero, zero, p7)
    send(m, int(np.int64(COMMAND_LONG)))
