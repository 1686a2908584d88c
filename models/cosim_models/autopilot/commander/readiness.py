"""Readiness of the autopilot: the stages of ArduCopter's start-up, and the pre-arm checks.

Kernels over the autopilot's record `m`.

Source: recorded start-ups of ArduCopter 4.7-dev under SITL; the stages scale with `estimate_ready_time`.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.flight.state import needs_position, position_ready

__all__ = [
    "AHRS_AT",
    "ATTITUDE_AT",
    "EKF_AT",
    "GPS_AT",
    "HEARD_AT",
    "HOME_AT",
    "PREARM_AT",
    "attitude_ready",
    "home_ready",
    "prearm_ready",
    "reached",
]

_SLACK = 1e-9  # s

# Start-up of ArduCopter [s]: first known, estimator, attitude, GPS fix, home, AHRS, pre-arm checks. All of them precede
# _STARTUP, the position estimate.
_STARTUP, HEARD_AT, EKF_AT, ATTITUDE_AT = 41.5, 2.9, 5.4, 5.9
GPS_AT, HOME_AT, AHRS_AT, PREARM_AT = 9.8, 19.8, 22.4, 23.4


@kernel
def reached(m: Any, t: float, at: float) -> bool:
    """Returns whether a stage of ArduCopter's start-up has been reached; times scale with `estimate_ready_time`."""
    return bool(t >= at * (m.estimate_ready_time / _STARTUP) - _SLACK)


@kernel
def attitude_ready(m: Any, t: float) -> bool:
    """Returns whether the attitude estimate is good."""
    return reached(m, t, ATTITUDE_AT)


@kernel
def home_ready(m: Any, t: float) -> bool:
    """Returns whether the origin and home are known."""
    return reached(m, t, HOME_AT)


@kernel
def prearm_ready(m: Any, t: float) -> bool:
    """Returns whether the pre-arm checks of the current mode pass."""
    return reached(m, t, PREARM_AT) and (not needs_position(m.mode) or position_ready(m, t))
