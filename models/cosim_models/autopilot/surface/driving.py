"""Speed and steering of rovers and boats.

Speed control is feed-forward, proportional and integral over the throttle; steering turns the vehicle towards a heading
with a rate that the curvature at the present speed allows. Kernels over a record that has `DRIVE_PARAMETERS` and
`DRIVE_MEMORY` beside the variables of `gcs.record`. They write steering and throttle, the first elements of `motor`.

Source: ArduPilot, APM_Control/AR_AttitudeControl (gains, defaults).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import angle, real
from cosim_models.autopilot.gcs.streams import heading

__all__ = ["DRIVE_MEMORY", "DRIVE_PARAMETERS", "STANDING", "clip", "cruise", "drive", "ground_speed", "steer", "stop"]
__all__ += ["throttle_for", "turn_limit", "turn_towards"]

STANDING = 0.1
"""Speed [m/s] below which a vehicle that should stop stands."""
_GRAVITY = 9.80665

DRIVE_PARAMETERS = (
    real("CRUISE_SPEED", "m/s", 5.0, "speed at CRUISE_THROTTLE", 0.1),
    real("WP_SPEED", "m/s", 0.0, "speed of missions, GUIDED and RTL, 0: CRUISE_SPEED"),
    real("CRUISE_THROTTLE", "%", 25.0, "throttle for CRUISE_SPEED", 1.0),
    real("ATC_SPEED_P", "s/m", 0.2, "throttle over speed error"),
    real("ATC_SPEED_I", "1/m", 0.2, "throttle over integral of the speed error"),
    real("ATC_ACCEL_MAX", "m/s2", 1.0, "acceleration, also when it brakes before a target", 0.05),
    real("ATC_STR_ANG_P", "1/s", 2.0, "turn rate over heading error", 0.01),
    angle("ATC_STR_RAT_MAX", 120.0, "greatest turn rate, per second"),
    real("ATC_TURN_MAX_G", "1", 0.6, "greatest lateral acceleration over gravity", 0.01),
    real("TURN_RADIUS", "m", 0.9, "radius of the turn at full steering", 0.01),
    real("WP_RADIUS", "m", 2.0, "distance at which a target is reached", 0.01),
    real("LOIT_RADIUS", "m", 2.0, "distance from a place that is held at which it is driven to again", 0.01),
)
DRIVE_MEMORY = (
    Memory("demand"),  # m/s, after the acceleration limit
    Memory("integral"),  # throttle
    Memory("arrived", dtype="?"),
)


@kernel
def clip(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


@kernel
def ground_speed(m: Any, yaw: float) -> float:
    """Returns the speed ahead [m/s], for the heading [rad]."""
    return float(m.velocity[0] * math.cos(yaw) + m.velocity[1] * math.sin(yaw))


@kernel
def cruise(m: Any) -> float:
    """Returns the speed of DO_CHANGE_SPEED, WP_SPEED or CRUISE_SPEED [m/s]."""
    if m.cruise > 0.0:
        return float(m.cruise)
    return float(m.WP_SPEED if m.WP_SPEED > 0.0 else m.CRUISE_SPEED)


@kernel
def throttle_for(m: Any, wanted: float, speed: float, h: float) -> None:
    """Commands the throttle for a speed [m/s], within the acceleration limit, at the present one."""
    change = m.ATC_ACCEL_MAX * h
    m.demand += min(max(wanted - m.demand, -change), change)
    miss = m.demand - speed
    forward = 0.01 * m.CRUISE_THROTTLE * m.demand / m.CRUISE_SPEED
    throttle = forward + m.ATC_SPEED_P * miss + m.integral
    if -1.0 < throttle < 1.0:
        m.integral += m.ATC_SPEED_I * miss * h
    m.motor[1] = 0.5 + 0.5 * min(max(throttle, -1.0), 1.0)


@kernel
def turn_limit(m: Any, speed: float) -> float:
    """Returns the greatest turn rate [rad/s] by ATC_TURN_MAX_G at a speed [m/s]."""
    return float(_GRAVITY * m.ATC_TURN_MAX_G / max(abs(speed), 0.1))


@kernel
def steer(m: Any, rate: float, speed: float) -> None:
    """Commands the steering for a turn rate [rad/s], within ATC_STR_RAT_MAX and ATC_TURN_MAX_G, at a speed [m/s].

    Backwards, the wheels are turned the other way.
    """
    rate = min(max(rate, -math.radians(m.ATC_STR_RAT_MAX)), math.radians(m.ATC_STR_RAT_MAX))
    most = turn_limit(m, speed)
    rate = min(max(rate, -most), most)
    steering = rate * m.TURN_RADIUS / (min(speed, -0.5) if m.demand < 0.0 else max(speed, 0.5))
    m.motor[0] = 0.5 + 0.5 * min(max(steering, -1.0), 1.0)


@kernel
def turn_towards(m: Any, yaw: float, bearing: float) -> float:
    """Returns the turn rate [rad/s] towards a heading [rad]."""
    return float(m.ATC_STR_ANG_P * wrap_pi(bearing - yaw))


@kernel
def drive(m: Any, wanted: float, bearing: float, h: float) -> None:
    """Commands throttle and steering for a speed [m/s], to which it slows down in turns, and a heading [rad]."""
    yaw = heading(m)
    wanted *= max(math.cos(wrap_pi(bearing - yaw)), 0.25)
    speed = ground_speed(m, yaw)
    throttle_for(m, wanted, speed, h)
    steer(m, turn_towards(m, yaw, bearing), speed)
    m.desired_velocity[0] = m.demand * math.cos(bearing)
    m.desired_velocity[1] = m.demand * math.sin(bearing)


@kernel
def stop(m: Any, h: float) -> None:
    """Brakes; without speed, nothing is commanded."""
    yaw = heading(m)
    speed = ground_speed(m, yaw)
    if abs(speed) < STANDING and m.demand == 0.0:
        m.integral = 0.0
        m.motor[0], m.motor[1] = 0.5, 0.5
    else:
        drive(m, 0.0, yaw, h)
