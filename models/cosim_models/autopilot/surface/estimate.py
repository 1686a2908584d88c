"""The fail-safe of the estimate of rovers and boats: what they do when they do not know where they are.

There is no estimator: the position is that of the inputs. It counts as lost, as that of ArduPilot's filter does, when
the simulated GPS has been silent (SIM_GPS1_ENABLE 0, or a switch) for 7 s. After a second, while it is armed,
FS_EKF_ACTION follows: HOLD, or a text alone. Modes that need no position go on. Kernels over a record with
`ESTIMATE_PARAMETERS` and `ESTIMATE_MEMORY`.

Differences from ArduRover: with the text alone, it goes on by its true position, where ArduRover reckons on.

Source: ArduPilot, Rover/ekf_check.cpp, NavEKF3 (posRetryTimeNoVel 7 s), AP_GPS (4 s without data: no fix).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_CRITICAL
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.words import EKF_CLEARED, EKF_FAILSAFE, EKF_VARIANCE, say

__all__ = ["ESTIMATE_MEMORY", "ESTIMATE_PARAMETERS", "watch_gps", "watching_estimate"]

_COUNT = 10  # of checks in a row
_SILENT, _LOST = 4.0, 7.0  # s without GPS
_WARN_AGAIN = 30.0  # s
_DISABLED, _REPORT = 0, 2  # FS_EKF_ACTION
_NEVER = -1.0

ESTIMATE_PARAMETERS = (
    whole("FS_EKF_ACTION", 1, "without a position: 0 nothing, 1 HOLD, 2 a text alone"),
    real("FS_EKF_THRESH", "1", 0.8, "0: the position is never taken as lost"),
    whole("SIM_GPS1_ENABLE", 1, "0: the simulated GPS is silent"),
)
ESTIMATE_MEMORY = (
    Memory("gps_off", dtype="?", rare=True),  # by a switch
    Memory("gps_lost_at", rare=True),  # s, -1: it is there
    Memory("ekf_count", dtype="i4", rare=True),
    Memory("ekf_failed", dtype="?", rare=True),
    Memory("ekf_warned_at", rare=True),  # s
)


@kernel
def watch_gps(m: Any, t: float) -> None:
    """Looks for how long GPS has been silent."""
    if m.SIM_GPS1_ENABLE != 0 and not m.gps_off:
        m.gps_lost_at = _NEVER
        m.gps_silent, m.position_lost = False, False
        return
    if m.gps_lost_at == _NEVER:
        m.gps_lost_at = t
    m.gps_silent = t - m.gps_lost_at >= _SILENT - 1e-9
    m.position_lost = t - m.gps_lost_at >= _LOST - 1e-9


@kernel
def _clear(m: Any) -> None:
    if m.ekf_failed:
        m.ekf_failed = False
        say(m, MAV_SEVERITY_CRITICAL, EKF_CLEARED, 0)


def watching_estimate(
    free: tuple[int, ...], hold: int, enter: Callable[[Any, int, float], int]
) -> Callable[[Any, float], None]:
    """Returns a kernel of (record, time [s]) that counts checks without a position, and acts.

    Args:
        free: modes that need no position.
        hold: the mode HOLD.
        enter: kernel of (record, mode, time) that changes the mode.
    """

    @kernel
    def fail(m: Any, t: float) -> None:
        m.ekf_failed = True
        if m.mode in free or m.FS_EKF_ACTION == _DISABLED:
            return
        if m.FS_EKF_ACTION != _REPORT:
            enter(m, hold, t)
        say(m, MAV_SEVERITY_CRITICAL, EKF_FAILSAFE, 0)

    @kernel
    def watch(m: Any, t: float) -> None:
        if not m.armed or m.FS_EKF_THRESH <= 0.0:
            m.ekf_count = 0
            _clear(m)
        elif m.position_lost:
            m.ekf_count = min(m.ekf_count + 1, _COUNT)
            if m.ekf_count == _COUNT and not m.ekf_failed:
                if m.ekf_warned_at == 0.0 or t - m.ekf_warned_at > _WARN_AGAIN:
                    m.ekf_warned_at = t
                    say(m, MAV_SEVERITY_CRITICAL, EKF_VARIANCE, 0)
                fail(m, t)
        elif m.ekf_count > 0:
            m.ekf_count -= 1
            if m.ekf_count == 0:
                _clear(m)

    return watch
