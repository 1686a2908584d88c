"""PREFLIGHT_REBOOT_SHUTDOWN of the small autopilots: they start anew in the middle of a run.

As in ArduRover and ArduPlane, the answer is sent first; then the autopilot is silent and deaf for a second, and tells
the last of the texts of a boot. Missions and parameters are kept.

Source: ArduPilot, GCS_Common (handle_preflight_reboot), and what ArduRover and ArduPlane 4.7-dev were heard to say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from cosim import Memory, Variable
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_INFO, MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT
from cosim_models.autopilot.gcs.words import AIRSPEED_STARTED, BAROMETER, GYROS_STARTED, READY, say
from cosim_models.autopilot.record.memory import forgetting

__all__ = ["REBOOT_MEMORY", "rebooting"]

_BOOT_TIME = 1.0  # s from a reboot to the first HEARTBEAT
_KEPT = ("mission", "mission_count")

REBOOT_MEMORY = (
    Memory("booted_at"),  # s
    Memory("rebooting", dtype="?"),  # a reboot is due, or its silence
    Memory("restart_at", rare=True),  # s; -1: the restart has been
)


def rebooting(
    variables: Sequence[Variable], start: Callable[[Any], int]
) -> Callable[[Any, float], tuple[int, float, bool]]:
    """Returns a kernel of (record, time since the start) that starts anew when that is due.

    It returns an error of `start`, the time since the last start, and whether the autopilot is silent. It is required
    in every step while m.rebooting.
    """
    forget = forgetting(variables, _KEPT)

    @kernel
    def reboot(m: Any, t: float) -> tuple[int, float, bool]:
        if m.restart_at < 0.0:
            if t < _BOOT_TIME - 1e-9:
                return 0, t, True
            m.rebooting = False
            say(m, MAV_SEVERITY_INFO, BAROMETER, 1)
            say(m, MAV_SEVERITY_INFO, BAROMETER, 2)
            surface = m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT)
            say(m, MAV_SEVERITY_INFO, GYROS_STARTED if surface else AIRSPEED_STARTED, 1)
            say(m, MAV_SEVERITY_INFO, READY, 0)
            return 0, t, False
        if t < m.restart_at - 1e-9:
            return 0, t, False
        began = m.booted_at + t
        forget(m)
        error = start(m)
        m.booted_at = began
        m.rebooting = True
        m.restart_at = -1.0
        return error, 0.0, True

    return reboot
