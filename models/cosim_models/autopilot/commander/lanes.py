"""The two lanes of the estimate, one for each inertial sensor, and changes from one to the other.

ArduCopter's EKF3 runs a filter (a lane) for each of two inertial sensors (EK3_IMU_MASK), and flies by one of them.
Where that errs by more than the other, it changes: the score of a lane is the larger of the mean of its squared test
ratios of velocity and position, and of that of its height; the other must be better by EK3_ERR_THRESH, and must not
have been changed to in the last 10 s. A fail-safe of the estimate that is about to begin changes to a better lane, too.
Errors of GPS, barometer and compass are those of both.

The lane that flies is that of `sensors` and `inertial`. Of the other one, only the error is computed that its own
sensor makes, with the same constant gains, ten times a second. Kernels over the autopilot's record `m`.

Source: ArduPilot, NavEKF3 (UpdateFilter, checkLaneSwitch, errorScore), ArduCopter ekf_check (check_ekf_reset), with
default parameters; times of changes are compared with those of flights of ArduCopter 4.7-dev
(tests/data/arducopter/x_lane_*).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import multiply, rotate
from cosim.kernel import kernel
from cosim_models.autopilot.commander.inertial import (
    GRAVITY,
    LEARNING,
    LEVELLING,
    SLIP_GATE,
    SLOWING,
    accelerometer_error,
    gyro_error,
)
from cosim_models.autopilot.link.statustext import CRITICAL, LANE_SWITCH, PRIMARY_CHANGED, WARNING, say

__all__ = [
    "GAIN",
    "GAIN_CLIMB",
    "GAIN_FALL",
    "GAIN_UP",
    "GATE",
    "GATE_CLIMB",
    "GATE_SLIP",
    "GATE_UP",
    "change_lane",
    "either_errs",
    "forget_lanes",
    "prepare_lanes",
    "watch_lanes",
]

GATE, GATE_UP, GATE_CLIMB = 2.5, 10.0, 3.0
"""Of position and height [m] and climb rate [m/s]."""
GATE_SLIP = 0.65
"""Time [s] by which the gate of the position grows with an error of the velocity."""
GAIN, GAIN_UP, GAIN_CLIMB, GAIN_FALL = 1.0, 0.3, 0.15, 0.9
"""Of position and height, of climb rate, and of the height for its error [1/s]."""

_PERIOD = 0.1  # s
_KEPT, _RETRY = 10.0, 10.0  # s
_AGAIN, _GOOD = 5.0, 0.9  # s and score, of changes that avoid a fail-safe
_LEAST = 0.05  # of EK3_ERR_THRESH
_BOTH, _FIRST = 3, 1  # EK3_IMU_MASK
_BY_HAND = 2  # EK3_OPTIONS
_STILL = 1e-3


@kernel
def _imu_of(m: Any, lane: int) -> int:
    """Returns the inertial sensor, from 0, of a lane; INS_USE and INS_USE2 leave sensors out."""
    imu = lane if (m.EK3_IMU_MASK & _FIRST) != 0 else 1
    if imu == 0 and m.INS_USE == 0 and m.INS_USE2 != 0:
        return 1
    if imu == 1 and m.INS_USE2 == 0 and m.INS_USE != 0:
        return 0
    return imu


@kernel
def _has_two(m: Any) -> bool:
    return bool((m.EK3_IMU_MASK & _BOTH) == _BOTH)


@kernel
def _primary(m: Any) -> int:
    """Returns the lane that EK3_PRIMARY chooses."""
    return 1 if _has_two(m) and m.EK3_PRIMARY == 1 else 0


@kernel
def _errs(m: Any, imu: int) -> bool:
    a, b = accelerometer_error(m, imu), gyro_error(m, imu)
    return bool(abs(a[0]) + abs(a[1]) + abs(a[2]) + abs(b[0]) + abs(b[1]) + abs(b[2]) > 0.0)


@kernel
def either_errs(m: Any) -> bool:
    """Returns whether the sensor of a lane errs, the lane that flies is not that of EK3_PRIMARY, or errors are left."""
    if _errs(m, _imu_of(m, 0)) or m.lane != _primary(m):
        return True
    if not _has_two(m):
        return False
    left = abs(m.other_slip[0]) + abs(m.other_slip[1]) + abs(m.other_climb) + abs(m.other_place[2])
    return bool(_errs(m, _imu_of(m, 1)) or left > _STILL)


@kernel
def forget_lanes(m: Any) -> None:
    """Removes the errors of the lane that does not fly."""
    for i in range(2):
        m.other_tilt[i] = m.other_slip[i] = 0.0
    for i in range(3):
        m.other_learned[i] = m.other_place[i] = m.own_place[i] = 0.0
    m.other_climb = m.other_rejected = 0.0


@kernel
def prepare_lanes(m: Any) -> bool:
    """Chooses the sensor of the lane that flies; returns whether it must be that of EK3_PRIMARY: disarmed."""
    m.imu = _imu_of(m, m.lane)
    by_hand = (m.EK3_OPTIONS & _BY_HAND) != 0
    return bool((not m.armed or by_hand) and m.lane != _primary(m))


@kernel
def _move_place(place: Any, n: float, e: float, climb: float, heard: float) -> None:
    """Advances the error of the place that errors of the velocity make."""
    place[0] += _PERIOD * (n - heard * GAIN * place[0])
    place[1] += _PERIOD * (e - heard * GAIN * place[1])
    place[2] += _PERIOD * (climb - (GAIN_FALL + GAIN_UP) * place[2])


@kernel
def _reset_other(m: Any, n: float, e: float) -> None:
    """Resets velocity and place of the other lane after they have been beyond their gates for 10 s."""
    if n * n + e * e < SLIP_GATE * SLIP_GATE and abs(m.other_climb) < GATE_CLIMB:
        m.other_rejected = 0.0
        return
    m.other_rejected += _PERIOD
    if m.other_rejected >= _RETRY:
        m.other_rejected = m.other_climb = m.other_slip[0] = m.other_slip[1] = 0.0
        for i in range(3):
            m.other_place[i] = 0.0


@kernel
def _advance_other(m: Any) -> None:
    """Advances the errors that the sensor of the lane makes which does not fly."""
    imu = _imu_of(m, 1 - m.lane)
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    a, b, c = accelerometer_error(m, imu), gyro_error(m, imu), m.other_learned
    wn, we, _ = rotate(q, (b[0] + c[0], b[1] + c[1], b[2] + c[2]))
    fn, fe, _ = rotate(q, (a[0], a[1], 0.0))
    tilt, slip = m.other_tilt, m.other_slip
    n, e = float(slip[0]), float(slip[1])
    heard = 1.0 if m.SIM_GPS1_ENABLE != 0 and not m.gps_jammed else 0.0
    used = heard if math.sqrt(n * n + e * e) < SLIP_GATE else 0.0
    slip[0] += _PERIOD * (fn - GRAVITY * tilt[1] - used * SLOWING * n)
    slip[1] += _PERIOD * (fe + GRAVITY * tilt[0] - used * SLOWING * e)
    tilt[0] += _PERIOD * (wn - used * LEVELLING * e)
    tilt[1] += _PERIOD * (we + used * LEVELLING * n)
    learned = rotate((q[0], -q[1], -q[2], -q[3]), (-used * LEARNING * e, used * LEARNING * n, 0.0))
    for i in range(3):
        c[i] += _PERIOD * learned[i]
    up = -a[2] * (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]))
    m.other_climb += _PERIOD * (up - (GAIN_CLIMB * m.other_climb if abs(m.other_climb) < GATE_CLIMB else 0.0))
    _reset_other(m, n, e)
    _move_place(m.other_place, n, e, float(m.other_climb), heard)
    _move_place(m.own_place, float(m.slip_error[0]), float(m.slip_error[1]), float(m.climb_error), heard)


@kernel
def _score(n: float, e: float, climb: float, away_n: float, away_e: float, away_up: float) -> float:
    """Returns the score of a lane for its errors of velocity [m/s] and distances from GPS and barometer [m]."""
    slip = math.sqrt(n * n + e * e)
    velocity = (slip / SLIP_GATE) ** 2 + (climb / GATE_CLIMB) ** 2
    gate = GATE + GATE_SLIP * slip
    position = (away_n * away_n + away_e * away_e) / (gate * gate)
    return float(max(0.5 * (velocity + position), (away_up / GATE_UP) ** 2))


@kernel
def watch_lanes(m: Any, t: float, away_n: float, away_e: float, away_up: float) -> bool:
    """Advances the other lane by a tenth of a second; returns whether it must fly.

    Args:
        m: the record.
        t: time [s].
        away_n, away_e, away_up: by how much position and height of GPS and barometer are away from the estimate [m].
    """
    if not _has_two(m):
        return False
    _advance_other(m)
    if not m.armed or (m.EK3_OPTIONS & _BY_HAND) != 0 or m.SIM_GPS1_ENABLE == 0 or m.gps_jammed:
        return False
    own, other = m.own_place, m.other_place
    now = _score(m.slip_error[0], m.slip_error[1], m.climb_error, away_n, away_e, away_up)
    then = _score(
        m.other_slip[0],
        m.other_slip[1],
        m.other_climb,
        away_n + own[0] - other[0],
        away_e + own[1] - other[1],
        away_up + own[2] - other[2],
    )
    last = max(m.lane_since[0], m.lane_since[1])
    asked = m.lane_asked and then < min(now, _GOOD) and (last == 0.0 or t - last >= _AGAIN)
    m.lane_asked = False
    better = now - then > max(m.EK3_ERR_THRESH, _LEAST) or (now > 1.0 and then < now)
    return bool(asked or (better and t - m.lane_since[1 - m.lane] > _KEPT))


@kernel
def change_lane(m: Any, t: float) -> tuple[float, float, float]:
    """Flies by the other lane and tells it; returns by how much the error of the position changes [m, north, east, up].

    The target of the attitude turns with the estimate, and the desired velocity becomes that which
    was the target, changed as that of the estimate.
    """
    n, e = 0.5 * (m.other_tilt[0] - m.tilt_error[0]), 0.5 * (m.other_tilt[1] - m.tilt_error[1])
    w = 1.0 / math.sqrt(1.0 + n * n + e * e)
    a = m.attitude_target
    turned = multiply((w, w * n, w * e, 0.0), (float(a[0]), float(a[1]), float(a[2]), float(a[3])))
    for i in range(4):
        a[i] = turned[i]
    by = (
        float(m.other_place[0] - m.own_place[0]),
        float(m.other_place[1] - m.own_place[1]),
        float(m.other_place[2] - m.own_place[2]),
    )
    for i in range(2):
        m.desired_velocity_neu[i] = m.target_velocity_neu[i] + m.other_slip[i] - m.slip_error[i]
        m.tilt_error[i], m.other_tilt[i] = m.other_tilt[i], m.tilt_error[i]
        m.slip_error[i], m.other_slip[i] = m.other_slip[i], m.slip_error[i]
    for i in range(3):
        m.gyro_learned[i], m.other_learned[i] = m.other_learned[i], m.gyro_learned[i]
        m.own_place[i], m.other_place[i] = m.other_place[i], m.own_place[i]
    m.desired_velocity_neu[2] = m.target_velocity_neu[2] + m.other_climb - m.climb_error
    m.climb_error, m.other_climb = m.other_climb, m.climb_error
    m.lane = 1 - m.lane
    m.imu = _imu_of(m, m.lane)
    if m.armed:
        m.lane_since[m.lane] = t
        say(m, CRITICAL, LANE_SWITCH, m.lane)
    say(m, WARNING, PRIMARY_CHANGED, m.lane)
    return by
