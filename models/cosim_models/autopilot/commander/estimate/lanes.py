"""Which lane of the estimate flies: that of the better inertial sensor.

ArduCopter's EKF3 runs a filter (a lane) for each of two inertial sensors (EK3_IMU_MASK), and flies by one of them.
Where that errs by more than the other, it changes: the score of a lane is the larger of the mean of its squared test
ratios of velocity and position, and of that of its height; the other must be better by EK3_ERR_THRESH, and must not
have been changed to in the last 10 s. A fail-safe of the estimate that is about to begin changes to a better lane, too.
Kernels over the autopilot's record `m`.

Source: ArduPilot, NavEKF3 (UpdateFilter, checkLaneSwitch, errorScore), ArduCopter ekf_check (check_ekf_reset), with
default parameters; times of changes are compared with those of flights of ArduCopter 4.7-dev
(tests/data/arducopter/x_lane_*).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import multiply
from cosim.kernel import kernel
from cosim_models.autopilot.commander.estimate.inertial import has_two, imu_of
from cosim_models.autopilot.link.statustext import CRITICAL, LANE_SWITCH, PRIMARY_CHANGED, WARNING, say

__all__ = ["change_lane", "flies_by_other", "must_return", "wants_other"]

_KEPT = 10.0  # s
_AGAIN, _GOOD = 5.0, 0.9  # s and score, of changes that avoid a fail-safe
_LEAST = 0.05  # of EK3_ERR_THRESH
_BY_HAND = 2  # EK3_OPTIONS


@kernel
def _primary(m: Any) -> int:
    """Returns the lane that EK3_PRIMARY chooses."""
    return 1 if has_two(m) and m.EK3_PRIMARY == 1 else 0


@kernel
def flies_by_other(m: Any) -> bool:
    """Returns whether the lane that flies is not that of EK3_PRIMARY."""
    return bool(m.lane != _primary(m))


@kernel
def must_return(m: Any) -> bool:
    """Chooses the sensor of the lane that flies; returns whether it must be that of EK3_PRIMARY: disarmed."""
    m.imu = imu_of(m, m.lane)
    by_hand = (m.EK3_OPTIONS & _BY_HAND) != 0
    return bool((not m.armed or by_hand) and m.lane != _primary(m))


@kernel
def _score(m: Any, lane: int) -> float:
    r = m.lane_ratio[lane]
    return float(max(0.5 * (r[0] + r[1]), r[2]))


@kernel
def wants_other(m: Any, t: float) -> bool:
    """Returns whether the other lane must fly."""
    asked = bool(m.lane_asked)
    m.lane_asked = False
    if not has_two(m) or not m.armed or (m.EK3_OPTIONS & _BY_HAND) != 0 or not m.gps_heard:
        return False
    now, then = _score(m, m.lane), _score(m, 1 - m.lane)
    last = max(m.lane_since[0], m.lane_since[1])
    asked = asked and then < min(now, _GOOD) and (last == 0.0 or t - last >= _AGAIN)
    better = now - then > max(m.EK3_ERR_THRESH, _LEAST) or (now > 1.0 and then < now)
    return bool(asked or (better and t - m.lane_since[1 - m.lane] > _KEPT))


@kernel
def change_lane(m: Any, t: float) -> None:
    """Flies by the other lane and tells it.

    The target of the attitude turns with the estimate, the desired place moves with it, and the desired velocity
    becomes that which was the target, changed as that of the estimate.
    """
    now, then = m.lane_now[m.lane], m.lane_now[1 - m.lane]
    n, e = 0.5 * (then[7] - now[7]), -0.5 * (then[6] - now[6])
    w = 1.0 / math.sqrt(1.0 + n * n + e * e)
    a = m.attitude_target
    turned = multiply((w, w * n, w * e, 0.0), (float(a[0]), float(a[1]), float(a[2]), float(a[3])))
    for i in range(4):
        a[i] = turned[i]
    for i in range(3):
        sign = -1.0 if i == 2 else 1.0
        m.desired_position_neu[i] += sign * (then[i] - now[i])
        m.desired_velocity_neu[i] = m.target_velocity_neu[i] + sign * (then[3 + i] - now[3 + i])
    m.lane = 1 - m.lane
    m.imu = imu_of(m, m.lane)
    if m.armed:
        m.lane_since[m.lane] = t
        say(m, CRITICAL, LANE_SWITCH, m.lane)
    say(m, WARNING, PRIMARY_CHANGED, m.lane)
