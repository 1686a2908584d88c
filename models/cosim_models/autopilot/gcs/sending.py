"""Sending of one packet of the small autopilots.

Kernels over the record that `gcs.record` declares.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_COMP_ID_AUTOPILOT1
from cosim.packets import MAX_PACKET, pack

__all__ = ["can_answer", "send"]


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
def can_answer(m: Any) -> bool:
    """Returns whether there is room for a packet of any size."""
    return bool(m.mavlink_tx_len + MAX_PACKET <= m.mavlink_tx.shape[0])
