"""The fail-safe of the estimate of rovers and boats: what they do when they do not know where they are.

The position counts as lost when the simulated GPS has been silent for 7 s (`gcs.positioning`). After a second, while
it is armed, FS_EKF_ACTION follows: HOLD, or a text alone. Modes that need no position go on. Kernels over a record with
`ESTIMATE_PARAMETERS` and `ESTIMATE_MEMORY`.

Differences from ArduRover: with the text alone, it goes on by its true position, where ArduRover reckons on.

Source: ArduPilot, Rover/ekf_check.cpp.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_CRITICAL
from cosim_models.autopilot.gcs.record import real, whole
from cosim_models.autopilot.gcs.words import EKF_CLEARED, EKF_FAILSAFE, EKF_VARIANCE, say

__all__ = ["ESTIMATE_MEMORY", "ESTIMATE_PARAMETERS", "watching_estimate"]

_COUNT = 10  # of checks in a row
_WARN_AGAIN = 30.0  # s
_DISABLED, _REPORT = 0, 2  # FS_EKF_ACTION

ESTIMATE_PARAMETERS = (
    whole("FS_EKF_ACTION", 1, "without a position: 0 nothing, 1 HOLD, 2 a text alone"),
    real("FS_EKF_THRESH", "1", 0.8, "0: the position is never taken as lost"),
)
ESTIMATE_MEMORY = (
    Memory("ekf_count", dtype="i4", rare=True),
    Memory("ekf_failed", dtype="?", rare=True),
    Memory("ekf_warned_at", rare=True),  # s
)


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
