"""AVAILABLE_MODES of the small autopilots: by the kind of vehicle, those of a firmware of ArduPilot.

Kernels over the record that `gcs.record` declares.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_TYPE_GROUND_ROVER, MAV_TYPE_QUADROTOR, MAV_TYPE_SURFACE_BOAT
from cosim_models.autopilot.gcs.rows import MODES_ROW
from cosim_models.autopilot.gcs.sending import can_answer, send_defined
from cosim_models.autopilot.link.available_modes import (
    AVAILABLE_MODES,
    AVAILABLE_MODES_MONITOR,
    COPTER_MODES,
    MODES_CRC,
    MODES_LENGTH,
    MONITOR_CRC,
    MONITOR_LENGTH,
    PLANE_MODES,
    QUADPLANE_MODES,
    ROVER_MODES,
    next_mode,
    put_mode,
)

__all__ = ["MODES_INTERVAL", "NEVER", "firmware_of", "send_modes"]

NEVER = 1e300
"""When [s] modes are due that nobody has asked for."""
MODES_INTERVAL = 0.1
"""Time [s] between modes that are told one after the other."""


@kernel
def firmware_of(m: Any) -> int:
    """Returns the firmware whose modes these are, by `link.available_modes`."""
    if m.kind == MAV_TYPE_QUADROTOR:
        return COPTER_MODES
    if m.kind == MAV_TYPE_GROUND_ROVER or m.kind == MAV_TYPE_SURFACE_BOAT:
        return ROVER_MODES
    return QUADPLANE_MODES if m.lifts else PLANE_MODES


@kernel
def send_modes(m: Any, message: int) -> bool:
    """Sends AVAILABLE_MODES, if one has been asked for, or its monitor: the modes never change."""
    if message != AVAILABLE_MODES:
        m.payload[0] = 0
        return send_defined(m, AVAILABLE_MODES_MONITOR, MONITOR_CRC, MONITOR_LENGTH)
    if not m.modes_asked:
        m.due[MODES_ROW] = NEVER
        return True
    if not can_answer(m):
        return False
    index = next_mode(m, firmware_of(m))
    if index == 0:
        return True
    put_mode(m.payload, firmware_of(m), index)
    return send_defined(m, AVAILABLE_MODES, MODES_CRC, MODES_LENGTH)
