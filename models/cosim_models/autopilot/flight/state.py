"""The autopilot's discrete state as in ArduCopter: armed or not, on the ground or in the air, flight mode.

Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: AP_Arming_Copter, motors (auto disarm), land_detector.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED, mix_towards
from cosim_models.autopilot.control.shaping import lowpass_alpha
from cosim_models.autopilot.flight.returning.breadcrumbs import forget_path
from cosim_models.autopilot.mission.missions import forget_jumps
from cosim_models.autopilot.mission.terrain import refer_terrain
from cosim_models.autopilot.record.modes import (
    ACRO,
    AUTO,
    AUTO_RTL,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    DESCEND,
    DRIFT,
    GUIDED,
    LAND,
    LANDING,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
    STABILIZE,
    TAKEOFF,
    THROW,
    ZIGZAG,
)

__all__ = [
    "arm",
    "detect_landing",
    "disarm",
    "disarm_after_delay",
    "landed_state",
    "needs_position",
    "position_ready",
    "reported_mode",
]


_LANDED_TIME = 1.0  # s without motion until landed
_TOUCHED_TIME = 0.2  # s until possibly landed
_LANDED_ACCEL = 1.0  # m/s2, filtered at 1 Hz
_LANDED_SPEED = 1.0  # m/s
_LARGE_LEAN = math.cos(math.radians(15.0))
_LARGE_ERROR = math.radians(30.0)
_MOVING_ACCEL = 3.0  # m/s2


@kernel
def position_ready(m: Any, t: float) -> bool:
    """Returns whether the position estimate is good enough for flight (from `estimate_ready_time` on, with GPS)."""
    return bool(t >= m.estimate_ready_time and not m.position_lost and not m.ekf_failed)


@kernel
def needs_position(mode: int) -> bool:
    """Returns whether entering or arming in a mode requires a position estimate."""
    return mode in (
        AUTO,
        GUIDED,
        LOITER,
        RTL,
        CIRCLE,
        BRAKE,
        AVOID_ADSB,
        DRIFT,
        POSHOLD,
        THROW,
        SMART_RTL,
        ZIGZAG,
    )


@kernel
def arm(m: Any, t: float) -> None:
    """Arms. The current position becomes home unless a command has set it; the motors wait for two seconds."""
    m.armed = True
    m.armed_at = t
    m.arming_delay = True
    m.auto_armed = False
    m.idle_since = t
    m.armed_heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    if not m.home_locked:
        for i in range(3):
            m.home_neu[i] = m.position_neu[i]
    m.land_time = 0.0
    refer_terrain(m)
    forget_path(m, t, position_ready(m, t))


@kernel
def disarm(m: Any) -> None:
    """Disarms and stops the motors; the next mission begins with its first item."""
    m.armed = False
    m.auto_armed = False
    m.on_ground = True
    m.land_time = 0.0
    m.paused = False
    m.mission_current = 0
    m.mission_complete = False
    m.mission_changed = True
    forget_jumps(m)


@kernel
def disarm_after_delay(m: Any, t: float) -> bool:
    """Disarms after DISARM_DELAY armed on the ground; returns whether that happened in this step. Not in THROW."""
    if not m.armed or m.DISARM_DELAY <= 0.0 or m.spool_state > GROUND_IDLE or not m.on_ground or m.mode == THROW:
        m.idle_since = t
        return False
    if t - m.idle_since < m.DISARM_DELAY - 1e-9:
        return False
    disarm(m)
    return True


@kernel
def detect_landing(m: Any, dt: float) -> None:
    """Detects landing as ArduCopter: idle throttle, no motion for a second. Sets m.on_ground and the throttle mix."""
    alpha = lowpass_alpha(dt, 1.0)
    still = 0.0
    moving = 0.0
    for i in range(3):
        m.land_acceleration_neu[i] += alpha * (m.acceleration_neu[i] - m.land_acceleration_neu[i])
        still += m.land_acceleration_neu[i] * m.land_acceleration_neu[i]
        moving += m.acceleration_neu[i] * m.acceleration_neu[i]
    upright = 1.0 - 2.0 * (m.attitude_target[1] ** 2 + m.attitude_target[2] ** 2)  # cosine of the lean of the target
    rough = upright < _LARGE_LEAN or m.thrust_error > _LARGE_ERROR
    if not m.armed:
        m.on_ground = True
        m.land_time = 0.0
    elif m.on_ground:
        taking_off = m.pilot_takeoff or ((m.mode == GUIDED or m.mode == AUTO) and m.submode == TAKEOFF)
        if not taking_off and m.throttle_out > 0.5 * m.throttle_hover and m.spool_state == THROTTLE_UNLIMITED:
            m.on_ground = False
    elif (
        m.limit_throttle_lower
        and m.throttle_mix <= 1.1 * m.ATC_THR_MIX_MIN
        and not rough
        and still <= _LANDED_ACCEL * _LANDED_ACCEL
        and abs(m.velocity_neu[2]) < _LANDED_SPEED
    ):
        m.land_time += dt
        if m.land_time >= _LANDED_TIME:
            m.on_ground = True
            m.land_time = 0.0
    else:
        m.land_time = 0.0
    m.touched = m.on_ground or m.land_time >= _TOUCHED_TIME
    wanted = m.ATC_THR_MIX_MAX
    if m.mode == STABILIZE or m.mode == ACRO:
        wanted = m.ATC_THR_MIX_MAN if m.auto_armed else m.ATC_THR_MIX_MIN
    elif (
        not m.armed
        or m.on_ground
        or (not rough and moving <= _MOVING_ACCEL * _MOVING_ACCEL and m.desired_velocity_neu[2] < 0.0)
    ):
        wanted = m.ATC_THR_MIX_MIN
    mix_towards(m, wanted, dt)


@kernel
def landed_state(m: Any) -> int:
    """Returns MAV_LANDED_STATE: 1 on ground, 2 in air, 3 taking off, 4 landing."""
    if m.on_ground:
        return 1
    if m.pilot_takeoff or ((m.mode == GUIDED or m.mode == AUTO) and m.submode == TAKEOFF and not m.takeoff_done):
        return 3
    if m.mode == AUTO and m.auto_landing:
        return LANDING
    if m.mode == LAND or ((m.mode == RTL or m.mode == SMART_RTL) and m.rtl_stage == DESCEND):
        return LANDING
    return 2


@kernel
def reported_mode(m: Any) -> int:
    """Returns the number of the mode as ground stations see it: AUTO_RTL is AUTO in the landing sequence."""
    return AUTO_RTL if m.auto_rtl else int(m.mode)
