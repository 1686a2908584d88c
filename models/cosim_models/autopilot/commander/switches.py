"""The pilot's switches: mode changes by the mode switch, arming by the yaw stick.

The switches are read ten times a second. When the override of the mode switch ends, its position is again that of the
simulated receiver, and the mode changes to that position's, as with ArduPilot's. Kernels over the autopilot's record
`m`.

Source: ArduPilot, RC_Channel (read_mode_switch) and ArduCopter motors (arm_motors_check).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.fields import get_whole
from cosim.kernel import kernel
from cosim.model import record_layout
from cosim_models.autopilot.commander.mode_requests import arm_checked, request_mode
from cosim_models.autopilot.commander.positions import LAST_POSITION, UNKNOWN, new_mode_position
from cosim_models.autopilot.flight.state import disarm
from cosim_models.autopilot.flight.sticks import channel, deflection, hands_on, override_active, throttle_open
from cosim_models.autopilot.record.modes import ACRO, STABILIZE
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = ["return_to_switch", "watch_switches"]

_FULL = 4000.0 / 4500.0  # yaw stick
_ARMED_AFTER = 20  # readings

_FIELDS = record_layout(VARIABLES)[0].fields
assert _FIELDS is not None
_MODES = np.array([_FIELDS[f"FLTMODE{i}"][1] for i in range(1, LAST_POSITION + 1)], dtype=np.int64)


@kernel
def _watch_mode(m: Any, t: float) -> None:
    number = m.FLTMODE_CH
    moved = override_active(m, number, t) if number != 0 else False
    if number == 0 or not (m.switch_position == UNKNOWN or moved or m.switch_moved):
        return
    m.switch_moved = m.switch_moved or moved
    position = new_mode_position(m, channel(m, number, t), t)
    if position != UNKNOWN:
        request_mode(m, get_whole(m, _MODES[position - 1]), t)


@kernel
def return_to_switch(m: Any) -> None:
    """Makes the mode that of the mode switch, 0.2 s later, as if it had been moved there; without an override, too."""
    m.switch_position = UNKNOWN
    m.switch_seen = UNKNOWN


@kernel
def _watch_rudder(m: Any, t: float) -> None:
    """Arms after two seconds of full right yaw with closed throttle, disarms after full left yaw."""
    yaw = deflection(m, m.RCMAP_YAW, t)
    right, left = yaw > _FULL, yaw < -_FULL and m.ARMING_RUDDER == 2
    if (
        m.ARMING_RUDDER == 0
        or throttle_open(m, t)
        or not (right or left)
        or (left and m.mode != STABILIZE and m.mode != ACRO and not m.on_ground)
    ):
        m.rudder_count = 0
    else:
        m.rudder_count = min(m.rudder_count + 1, _ARMED_AFTER + 1)
        if m.rudder_count == _ARMED_AFTER:
            if right and not m.armed:
                arm_checked(m, False, True, t)
            elif left and m.armed:
                disarm(m)


@kernel
def watch_switches(m: Any, t: float) -> None:
    """Responds to the mode switch and the yaw stick."""
    flies = hands_on(m, t)
    if flies or m.switch_moved or m.switch_position == UNKNOWN:
        _watch_mode(m, t)
    if flies:
        _watch_rudder(m, t)
