"""Positions of switches of the remote control: from pulses, and when they count.

Kernels over a record with the switch_* and aux_* memory that `record.variables` and `gcs.switches` declare.

Source: ArduPilot, RC_Channel (read_3pos_switch, read_6pos_switch, debounce_completed).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel

__all__ = ["LAST_POSITION", "UNKNOWN", "has_moved", "new_mode_position"]

LAST_POSITION = 6
"""Of a mode switch; its positions begin with 1."""
UNKNOWN = 0
"""Instead of a position."""
_LIMITS = np.array((1230, 1360, 1490, 1620, 1749), dtype=np.int64)  # us, of a mode switch: upper ones of 1 to 5
_MODE_LEAST, _MODE_GREATEST = 900, 2200  # us, valid pulses of a mode switch
_LEAST, _GREATEST = 800, 2200  # us, valid pulses of another
_BELOW, _ABOVE = 1200, 1800  # us
_SETTLED = 0.2  # s


@kernel
def new_mode_position(m: Any, pulse: int, t: float) -> int:
    """Returns the position 1 to 6 to which the mode switch has been moved now, by its pulse [us], else UNKNOWN."""
    if not _MODE_LEAST < pulse < _MODE_GREATEST:
        return UNKNOWN
    position = 1
    for i in range(_LIMITS.shape[0]):
        if pulse > _LIMITS[i]:
            position = i + 2
    if position != m.switch_seen:
        m.switch_seen = position
        m.switch_since = t
    elif position != m.switch_position and t - m.switch_since >= _SETTLED - 1e-9:
        m.switch_position = position
        return position
    return UNKNOWN


@kernel
def _position(pulse: int) -> int:
    """Returns the position of a switch: 1 low to 3 high, UNKNOWN if there is no signal."""
    if not _LEAST < pulse < _GREATEST:
        return UNKNOWN
    return 1 if pulse < _BELOW else 3 if pulse > _ABOVE else 2


@kernel
def has_moved(m: Any, i: int, pulse: int, receiver: int, ignored: bool, t: float) -> bool:
    """Returns whether the switch of channel i (from 0) has been moved now, to m.aux_position[i]: 1 low to 3 high.

    Args:
        m: the record.
        i: channel.
        pulse: of the channel [us].
        receiver: that of the simulated receiver without a pilot [us], whose position is the first one.
        ignored: whether the first position of a channel without such a pulse is ignored.
        t: time [s].
    """
    position = _position(pulse)
    if position == UNKNOWN:
        return False
    if m.aux_seen[i] == UNKNOWN:
        m.aux_position[i] = _position(receiver)
        if m.aux_position[i] == UNKNOWN and ignored:
            m.aux_position[i] = position
    if position == m.aux_position[i]:
        m.aux_seen[i] = position
    elif position != m.aux_seen[i]:
        m.aux_seen[i] = position
        m.aux_since[i] = t
    elif t - m.aux_since[i] >= _SETTLED - 1e-9:
        m.aux_position[i] = position
        return True
    return False
