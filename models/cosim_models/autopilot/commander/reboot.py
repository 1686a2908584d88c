"""A reboot in the middle of a run: when it is granted. Kernel over the autopilot's record `m`.

Source: ArduPilot, GCS_Common (handle_preflight_reboot), and answers of ArduCopter 4.7-dev.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED, MAV_RESULT_UNSUPPORTED

__all__ = ["ask_to_reboot"]

_BEFORE = 0.2  # s in which the answer is sent
_FORCED = 20190226  # param 6 that reboots an armed vehicle


@kernel
def ask_to_reboot(m: Any, kind: float, force: int, t: float) -> int:
    """Handles PREFLIGHT_REBOOT_SHUTDOWN: 1 and 3 reboot, armed only by force; returns a MAV_RESULT."""
    if m.armed and force != _FORCED:
        return MAV_RESULT_FAILED
    if kind != 1.0 and kind != 3.0:
        return MAV_RESULT_UNSUPPORTED
    m.rebooting = True
    m.restart_at = t + _BEFORE
    return MAV_RESULT_ACCEPTED
