"""The autopilot's links and their send buffers: appending packets, and timestamps of messages.

A link is a pair of packet ports, corresponding to a serial port of ArduPilot. `mavlink` connects to other components on
board and to the swarm's radio, `telemetry` to the ground stations' radio, `serial` to a cable. Each link has its own
sequence, MAVLink version and streams. Packets are sent on `m.link`, the link that is being served. Kernels over the
autopilot's record `m`. The contents of packets are in `mavlink.messages` and `mavlink.status_messages`.

Source: ArduPilot, GCS_MAVLINK (one for each channel).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import MAV_COMP_ID_AUTOPILOT1
from cosim.packets import MAX_PACKET, pack, pack_defined

__all__ = [
    "LINKS",
    "MAVLINK",
    "SERIAL",
    "TELEMETRY",
    "can_answer",
    "microseconds",
    "milliseconds",
    "send",
    "send_defined",
    "send_to_all",
]

MAVLINK, TELEMETRY, SERIAL = range(3)
"""Links, in the order in which they are served."""
LINKS = 3


@kernel
def _append(m: Any, buffer: Any, used: int, message: int) -> int:
    """Appends m.payload to the `used` bytes of a buffer; returns the new number of bytes, negative on failure."""
    link, sender = m.link, m.SYSID_THISMAV
    n = pack(buffer, used, m.payload, message, m.sequence[link], sender, MAV_COMP_ID_AUTOPILOT1, m.link_version[link])
    if n >= 0:
        m.sequence[link] = (m.sequence[link] + 1) % 256
    return n


@kernel
def send(m: Any, message: int) -> bool:
    """Appends m.payload as a packet; False if it does not fit or the MAVLink version in use cannot carry it."""
    if m.link == MAVLINK:
        n = _append(m, m.mavlink_tx, m.mavlink_tx_len, message)
        if n >= 0:
            m.mavlink_tx_len = n
    elif m.link == TELEMETRY:
        n = _append(m, m.telemetry_tx, m.telemetry_tx_len, message)
        if n >= 0:
            m.telemetry_tx_len = n
    else:
        n = _append(m, m.serial_tx, m.serial_tx_len, message)
        if n >= 0:
            m.serial_tx_len = n
    return bool(n >= 0)


@kernel
def send_defined(m: Any, message: int, crc_extra: int, length: int) -> bool:
    """Like `send`, for a message of another dialect, given its CRC_EXTRA and its length."""
    link, sender, version = m.link, m.SYSID_THISMAV, m.link_version[m.link]
    used = m.mavlink_tx_len if link == MAVLINK else m.telemetry_tx_len if link == TELEMETRY else m.serial_tx_len
    buffer = m.mavlink_tx if link == MAVLINK else m.telemetry_tx if link == TELEMETRY else m.serial_tx
    number, part = m.sequence[link], MAV_COMP_ID_AUTOPILOT1
    n = pack_defined(buffer, used, m.payload, message, crc_extra, length, length, number, sender, part, version)
    if n < 0:
        return False
    m.sequence[link] = (number + 1) % 256
    if link == MAVLINK:
        m.mavlink_tx_len = n
    elif link == TELEMETRY:
        m.telemetry_tx_len = n
    else:
        m.serial_tx_len = n
    return True


@kernel
def send_to_all(m: Any, message: int) -> None:
    """Appends m.payload on every link that has room for an answer."""
    here = m.link
    for link in range(LINKS):
        m.link = link
        if can_answer(m):
            send(m, message)
    m.link = here


@kernel
def can_answer(m: Any) -> bool:
    """Returns whether there is room for a packet other than an acknowledgement."""
    used = m.mavlink_tx_len if m.link == MAVLINK else m.telemetry_tx_len if m.link == TELEMETRY else m.serial_tx_len
    return bool(used + MAX_PACKET + m.ack_room <= m.mavlink_tx.shape[0])


@kernel
def milliseconds(t: float) -> int:
    return int(np.int64(math.floor(t * 1e3 + 1e-6)))


@kernel
def microseconds(t: float) -> int:
    return int(np.int64(math.floor(t * 1e6 + 0.5)))
