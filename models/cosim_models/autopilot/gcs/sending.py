"""Sending of one packet of the small autopilots.

Kernels over the record that `gcs.record` declares.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_COMP_ID_AUTOPILOT1
from cosim.packets import MAX_PACKET, pack, pack_defined

__all__ = ["can_answer", "send", "send_defined"]


@kernel
def send(m: Any, message: int) -> bool:
    """Appends m.payload as a packet; returns False if it does not fit."""
    sender, used = m.SYSID_THISMAV, m.mavlink_tx_len
    n = pack(m.mavlink_tx, used, m.payload, message, m.sequence, sender, MAV_COMP_ID_AUTOPILOT1, m.version)
    if n < 0:
        return False
    m.mavlink_tx_len = n
    m.sequence = (m.sequence + 1) & 0xFF
    return True


@kernel
def send_defined(m: Any, message: int, crc_extra: int, length: int) -> bool:
    """Like `send`, for a message of another dialect, given its CRC_EXTRA and its length."""
    sender, used, part = m.SYSID_THISMAV, m.mavlink_tx_len, MAV_COMP_ID_AUTOPILOT1
    n = pack_defined(
        m.mavlink_tx, used, m.payload, message, crc_extra, length, length, m.sequence, sender, part, m.version
    )
    if n < 0:
        return False
    m.mavlink_tx_len = n
    m.sequence = (m.sequence + 1) & 0xFF
    return True


@kernel
def can_answer(m: Any) -> bool:
    """Returns whether there is room for a packet of any size."""
    return bool(m.mavlink_tx_len + MAX_PACKET <= m.mavlink_tx.shape[0])
