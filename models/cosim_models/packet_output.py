"""The autopilot's send buffer: one packet more, and the times that messages carry.

Kernels over the autopilot's record `m`. What the packets say is in `copter_messages` and `status_messages`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.packets import MAX_PACKET, pack

__all__ = ["can_answer", "microseconds", "milliseconds", "send"]

_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1


@kernel
def send(m: Any, message: int) -> bool:
    """Append m.payload as a packet; False if it does not fit or the version in use cannot carry it."""
    n = pack(
        m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sequence, m.SYSID_THISMAV, _COMPONENT, m.link_version
    )
    if n < 0:
        return False
    m.mavlink_tx_len = n
    m.sequence = (m.sequence + 1) % 256
    return True


@kernel
def can_answer(m: Any) -> bool:
    """Whether there is room for a packet that is no acknowledgement."""
    return bool(m.mavlink_tx_len + MAX_PACKET + m.ack_room <= m.mavlink_tx.shape[0])


@kernel
def milliseconds(t: float) -> int:
    return int(np.int64(math.floor(t * 1e3 + 1e-6)))


@kernel
def microseconds(t: float) -> int:
    return int(np.int64(math.floor(t * 1e6 + 0.5)))
