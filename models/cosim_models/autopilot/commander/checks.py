"""Checks in flight: crash and lost thrust in each step; lost estimate, vibration, unbalanced yaw ten times a second.

Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter ekf_check and crash_check.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import roll_pitch_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.commander.actions import land_with_pause
from cosim_models.autopilot.control.motors import boost_thrust
from cosim_models.autopilot.control.pid import INTEGRAL
from cosim_models.autopilot.control.shaping import lowpass_alpha
from cosim_models.autopilot.flight.modes import set_mode
from cosim_models.autopilot.flight.state import disarm, needs_position
from cosim_models.autopilot.link.statustext import (
    CRASHED,
    CRITICAL,
    EKF_ALT_HOLD,
    EKF_CLEARED,
    EKF_FAILSAFE,
    EKF_LANDS,
    EKF_VARIANCE,
    EMERGENCY,
    NO_NUMBER,
    THRUST_LOST,
    VIBRATION_OFF,
    VIBRATION_ON,
    YAW_IMBALANCE,
    say,
    say_with,
)
from cosim_models.autopilot.record.modes import ACRO, ALT_HOLD, FLIP, LAND, STABILIZE

__all__ = ["watch_crash", "watch_flight", "watch_thrust"]

_COUNT = 10  # of checks in a row
_SMOOTH = 5.0  # Hz, FS_EKF_FILT
_WARN_AGAIN = 30.0  # s
_VIBRATES, _VIBRATED = 1.0, 15.0  # s
_REPORT, _ALT_HOLD, _ALWAYS = 0, 2, 3  # FS_EKF_ACTION
_CRASHED = 2.0  # s
_PERIOD, _EARLY = 0.1, 1e-9  # s
_THRUST_LOST = 1.0  # s
_LEVEL = math.radians(15.0)
_YAW_CUTOFF, _YAW_SHARE, _WARN_YAW = 0.05, 0.75, 10.0  # Hz; of ATC_RAT_YAW_IMAX; s
_STILL, _FAST = 3.0, 10.0  # m/s2, m/s
_WRONG, _LEANS = math.radians(30.0), math.cos(math.radians(15.0))
_FULL, _LITTLE = 0.9, 0.25  # throttle


@kernel
def _fail_estimate(m: Any, t: float) -> None:
    """Acts on a lost position by FS_EKF_ACTION; LAND, and modes that need none, go on without a position."""
    m.ekf_failed = True
    if m.mode == LAND and m.FS_EKF_ACTION != _REPORT:
        m.land_blind = True
    idle = not needs_position(m.mode) and m.FS_EKF_ACTION != _ALWAYS
    if idle or m.mode == LAND or m.FS_EKF_ACTION == _REPORT:
        say(m, CRITICAL, EKF_FAILSAFE, NO_NUMBER)
        return
    if m.FS_EKF_ACTION == _ALT_HOLD and not m.radio_lost and set_mode(m, ALT_HOLD, t):
        say(m, CRITICAL, EKF_ALT_HOLD, NO_NUMBER)
    else:
        land_with_pause(m, t)
        say(m, CRITICAL, EKF_LANDS, NO_NUMBER)


@kernel
def _varies(m: Any) -> bool:
    """Returns whether position and velocity are beyond FS_EKF_THRESH, or the velocity beyond twice that: smoothed."""
    share = lowpass_alpha(_PERIOD, _SMOOTH)
    m.smooth_position_ratio += share * (m.position_ratio - m.smooth_position_ratio)
    m.smooth_velocity_ratio += share * (m.velocity_ratio - m.smooth_velocity_ratio)
    position, velocity = m.smooth_position_ratio, m.smooth_velocity_ratio
    return bool(min(position, velocity) >= m.FS_EKF_THRESH or velocity >= 2.0 * m.FS_EKF_THRESH)


@kernel
def _watch_estimate(m: Any, t: float) -> None:
    if not m.armed or m.FS_EKF_THRESH <= 0.0:
        m.ekf_count = 0
        m.ekf_failed = False
    elif (m.sim_on and _varies(m)) or m.position_lost:
        if m.ekf_failed:
            return
        m.ekf_count += 1
        if m.ekf_count == _COUNT - 2:
            m.reset_asked = True
        elif m.ekf_count == _COUNT - 1:
            m.lane_asked = True
        if m.ekf_count >= _COUNT:
            m.ekf_count = _COUNT
            if m.ekf_warned_at == 0.0 or t - m.ekf_warned_at > _WARN_AGAIN:
                m.ekf_warned_at = t
                say(m, CRITICAL, EKF_VARIANCE, NO_NUMBER)
            _fail_estimate(m, t)
    elif m.ekf_count > 0:
        m.ekf_count -= 1
        if m.ekf_count == 0 and m.ekf_failed:
            say(m, CRITICAL, EKF_CLEARED, NO_NUMBER)
            m.ekf_failed = False


@kernel
def _upright(q: Any) -> float:
    """Returns the cosine of the lean of an attitude."""
    return float(1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]))


@kernel
def watch_crash(m: Any, t: float, dt: float) -> None:
    """Disarms a vehicle that has been tilted, still and slow for 2 s; called in each step."""
    if m.thrust_error <= _WRONG or m.on_ground or m.FS_CRASH_CHECK == 0 or m.mode == ACRO or m.mode == FLIP:
        return
    a, v = m.land_acceleration_neu, m.velocity_neu
    still = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    fast = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if still >= _STILL or fast >= _FAST or _upright(m.q) >= _LEANS or not m.armed:
        return
    if t - m.crash_seen > 1.5 * dt:
        m.crash_since = t - dt
    m.crash_seen = t
    if t - m.crash_since >= _CRASHED - _EARLY:
        m.crash_seen = 0.0
        error = int(math.degrees(m.thrust_error) + 0.5)
        say_with(m, EMERGENCY, CRASHED, error, int(10.0 * still + 0.5))
        disarm(m)


@kernel
def watch_thrust(m: Any, t: float, dt: float) -> None:
    """Tells of a vehicle that descends level with full throttle for 1 s, and boosts the thrust; called in each step.

    The motor that does most is named, and left out of the limits of the others.
    """
    if m.on_ground or m.boosted or not (m.limit_throttle_upper or m.throttle_in >= _FULL):
        return
    q = m.attitude_target
    roll, pitch = roll_pitch_from_quaternion((float(q[0]), float(q[1]), float(q[2]), float(q[3])))
    if roll * roll + pitch * pitch > _LEVEL * _LEVEL or m.throttle_in < _LITTLE:
        return
    if m.velocity_neu[2] >= 0.0 or m.thrust_error >= _WRONG or not m.armed:
        return
    if t - m.thrust_loss_seen > 1.5 * dt:
        m.thrust_loss_since = t - dt
    m.thrust_loss_seen = t
    if t - m.thrust_loss_since >= _THRUST_LOST - _EARLY:
        m.thrust_loss_seen = 0.0
        say(m, EMERGENCY, THRUST_LOST, boost_thrust(m) + 1)


@kernel
def _watch_yaw(m: Any, t: float) -> None:
    """Tells, every 10 s, of a vehicle that needs much of its yaw torque all the time, by the integral of its rate."""
    now = float(m.rate_pid[2, INTEGRAL])
    if m.on_ground or m.boosted or m.ATC_RAT_YAW_I <= 0.0:
        m.yaw_integral = 0.0
        return
    m.yaw_integral += lowpass_alpha(_PERIOD, _YAW_CUTOFF) * (now - m.yaw_integral)
    needed = abs(m.yaw_integral)
    if needed > abs(now):
        m.yaw_integral = now
    most = m.ATC_RAT_YAW_IMAX
    if most <= 0.0 or (needed <= _YAW_SHARE * most and now != most) or t - m.yaw_warned_at <= _WARN_YAW:
        return
    m.yaw_warned_at = t
    say(m, EMERGENCY, YAW_IMBALANCE, int(100.0 * needed + 0.5))


@kernel
def _watch_vibration(m: Any, t: float) -> None:
    """Controls the height without the accelerometer while its errors spoil the estimate: for a second, 15 s longer."""
    x, told = m.lane_past[m.lane], m.told_speed
    spoiled = m.smooth_velocity_ratio > 1.0 and x[5] > told[2] and x[2] > m.told_error[2]
    spoiled = spoiled or (m.estimate_errs and m.lane_bad[m.lane])
    bad = spoiled and m.FS_VIBE_ENABLE == 1 and m.armed and m.mode != STABILIZE and m.mode != ACRO
    if m.vibration_failsafe:
        if bad:
            m.vibrated_at = t
        elif t - m.vibrated_at > _VIBRATED:
            m.vibration_failsafe = False
            say(m, CRITICAL, VIBRATION_OFF, NO_NUMBER)
    elif not bad:
        m.vibrates_since = t
    elif t - m.vibrates_since > _VIBRATES:
        m.vibration_failsafe = True
        m.vibrated_at = t
        say(m, CRITICAL, VIBRATION_ON, NO_NUMBER)


@kernel
def watch_flight(m: Any, t: float) -> None:
    """Performs the checks."""
    _watch_estimate(m, t)
    if m.sim_on or m.vibration_failsafe:
        _watch_vibration(m, t)
    if not m.armed:
        m.yaw_integral = 0.0
        return
    _watch_yaw(m, t)
