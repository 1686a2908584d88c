"""The simulated GPS of rovers, planes and quadplanes, and for how long it has been silent.

There is no estimator: the position is that of the inputs. GPS has no fix when it has been silent for 4 s
(SIM_GPS1_ENABLE 0, or a switch); the position counts as lost, as that of ArduPilot's filter does, after 7 s. Kernels
over a record with `GPS_PARAMETERS` and `GPS_MEMORY` beside the variables of `gcs.record`.

Source: ArduPilot, AP_GPS (4 s without data: no fix), NavEKF3 (posRetryTimeNoVel 7 s).
"""

from __future__ import annotations

from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import whole

__all__ = ["GPS_MEMORY", "GPS_PARAMETERS", "start_gps", "watch_gps"]

_SILENT, _LOST = 4.0, 7.0  # s without GPS
_NEVER = -1.0

GPS_PARAMETERS = (whole("SIM_GPS1_ENABLE", 1, "0: the simulated GPS is silent"),)
GPS_MEMORY = (
    Memory("gps_off", dtype="?", rare=True),  # by a switch
    Memory("gps_lost_at", rare=True),  # s, -1: it is there
)


@kernel
def start_gps(m: Any) -> None:
    """Takes GPS to be there; required at the start."""
    m.gps_lost_at = _NEVER


@kernel
def watch_gps(m: Any, t: float) -> None:
    """Looks for how long GPS has been silent; required ten times a second while it is, and once afterwards."""
    if m.SIM_GPS1_ENABLE != 0 and not m.gps_off:
        m.gps_lost_at = _NEVER
        m.gps_silent, m.position_lost = False, False
        return
    if m.gps_lost_at == _NEVER:
        m.gps_lost_at = t
    m.gps_silent = t - m.gps_lost_at >= _SILENT - 1e-9
    m.position_lost = t - m.gps_lost_at >= _LOST - 1e-9
