"""Flight modes of the autopilot: what is desired, and when motors may run. Kernels over the record of `Autopilot`.

STABILIZE, GUIDED, LOITER, RTL and LAND as ArduCopter flies them, with its numbers. There is no pilot: sticks are
centred and the throttle stick is down, so STABILIZE holds the drone level without thrust, and LOITER holds a place.

Sources: ArduCopter's mode_guided, mode_land, mode_rtl, mode_loiter, takeoff and land_detector (behaviour, defaults).
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

from cosim.frames import euler_from_quaternion
from cosim.kernel import kernel

from cosim_models.copter_control import attitude_and_motors, hold_here, horizontal, relax, vertical
from cosim_models.shaping import (
    advance_limited,
    advance_limited_ne,
    limit_length,
    shape_position,
    shape_position_ne,
    shape_velocity,
    shape_velocity_ne,
)

__all__ = ["CopterMode", "GuidedTarget", "arm", "change_mode", "disarm", "fly", "go_to", "go_with", "ready", "take_off"]


class CopterMode(IntEnum):
    """Flight modes by ArduCopter's numbers."""

    STABILIZE = 0
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


class GuidedTarget(IntEnum):
    """What GUIDED follows."""

    none = 0
    takeoff = 1
    position = 2
    velocity = 3
    path = 4


STABILIZE, GUIDED, LOITER, RTL, LAND = 0, 4, 5, 6, 9
_NONE, _TAKEOFF, _POSITION, _VELOCITY, _PATH = 0, 1, 2, 3, 4
_CLIMB, _RETURN, _WAIT, _DESCEND = 0, 1, 2, 3
_RTL_LOITER = 5.0  # s, RTL_LOIT_TIME
_LAND_SLOW_BELOW = 10.0  # m, LAND_ALT_LOW
_LANDED_AFTER = 1.0  # s without thrust and motion
_NEAR = 2.0  # m, WPNAV_RADIUS


@kernel
def ready(m: Any, t: float) -> bool:
    """Whether the estimate is good enough for position modes."""
    return bool(t >= m.estimate_ready_time - 1e-9)


@kernel
def arm(m: Any) -> None:
    m.armed = True
    m.armed_for = 0.0
    m.landed_for = 0.0
    m.idle_for = 0.0
    if not m.home_set:
        m.home_set = True
        for i in range(3):
            m.home[i] = m.position[i]
    relax(m)


@kernel
def disarm(m: Any) -> None:
    m.armed = False
    m.guided = _NONE


@kernel
def change_mode(m: Any, mode: int) -> None:
    """Enter a mode from where the vehicle is, as it moves."""
    m.mode = mode
    m.guided = _NONE
    m.rtl_state = _CLIMB
    if not m.on_ground:
        hold_here(m)
        _aim_at_stop(m)


@kernel
def _aim_at_stop(m: Any) -> None:
    """The target is where braking ends (v^2/2a away in the plane)."""
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    reach = 0.5 * speed / (m.WPNAV_ACCEL * 0.01)
    m.target[0] = m.position[0] + m.velocity[0] * reach
    m.target[1] = m.position[1] + m.velocity[1] * reach
    m.target[2] = m.position[2]


@kernel
def take_off(m: Any, height: float) -> None:
    """Climb to `height` [m] above home from where the drone stands."""
    m.guided = _TAKEOFF
    m.target[0], m.target[1] = m.position[0], m.position[1]
    m.target[2] = m.home[2] - height


@kernel
def go_to(m: Any, north: float, east: float, down: float) -> None:
    """A position target [m, NED from the local origin]: the nose turns towards it."""
    m.guided = _POSITION
    m.target[0], m.target[1], m.target[2] = north, east, down
    m.yaw_fixed = False
    dn, de = north - m.position[0], east - m.position[1]
    if m.WP_YAW_BEHAVIOR > 0 and dn * dn + de * de > _NEAR * _NEAR:
        m.wanted_yaw = math.atan2(de, dn)


@kernel
def go_with(m: Any, t: float, path: bool, vn: float, ve: float, vd: float, an: float, ae: float, ad: float) -> None:
    """A velocity target [m/s], on a `path` (with a position that moves along, m.target) or free; accelerations m/s2."""
    m.guided = _PATH if path else _VELOCITY
    m.target_velocity[0], m.target_velocity[1], m.target_velocity[2] = vn, ve, vd
    m.target_acceleration[0], m.target_acceleration[1], m.target_acceleration[2] = an, ae, ad
    m.target_time = t


@kernel
def _path_to_target(m: Any, h: float, climb: float, sink: float, speed: float) -> None:
    """One step of the desired path towards the target; speeds are limits in m/s."""
    _advance_path(m, h)
    accel, jerk = m.WPNAV_ACCEL * 0.01, m.PSC_JERK_XY
    v, a, d = m.target_velocity, m.target_acceleration, m.desired_acceleration
    d[0], d[1] = shape_position_ne(
        m.target[0], m.target[1], v[0], v[1], a[0], a[1],
        m.desired_position[0], m.desired_position[1], m.desired_velocity[0], m.desired_velocity[1], d[0], d[1],
        speed, accel, jerk, h, False,
    )  # fmt: skip
    lift = m.WPNAV_ACCEL_Z * 0.01
    d[2] = shape_position(
        m.target[2], v[2], a[2], m.desired_position[2], m.desired_velocity[2], d[2],
        -climb, sink, -lift, lift, m.PSC_JERK_Z, h, False,
    )  # fmt: skip


@kernel
def _path_with_velocity(m: Any, h: float, vn: float, ve: float, vd: float) -> None:
    """One step of the desired path towards a velocity."""
    _advance_path(m, h)
    d, v = m.desired_acceleration, m.desired_velocity
    d[0], d[1] = shape_velocity_ne(
        vn, ve, 0.0, 0.0, v[0], v[1], d[0], d[1], m.WPNAV_ACCEL * 0.01, m.PSC_JERK_XY, h, True
    )
    lift = m.WPNAV_ACCEL_Z * 0.01
    d[2] = shape_velocity(vd, 0.0, v[2], d[2], -lift, lift, m.PSC_JERK_Z, h, True)


@kernel
def _advance_path(m: Any, h: float) -> None:
    p, v, a = m.desired_position, m.desired_velocity, m.desired_acceleration
    ln, le = 0.0, 0.0
    if m.lean_limited:
        ln, le = m.lean_n, m.lean_e
    pe_n, pe_e = p[0] - m.position[0], p[1] - m.position[1]
    ve_n, ve_e = v[0] - m.velocity[0], v[1] - m.velocity[1]
    p[0], p[1], v[0], v[1] = advance_limited_ne(
        p[0], p[1], v[0], v[1], a[0], a[1], h, ln, le, pe_n, pe_e, ve_n, ve_e
    )
    limit = -1.0 if m.throttle_upper else 1.0 if m.throttle_lower else 0.0
    p[2], v[2] = advance_limited(p[2], v[2], a[2], h, limit, p[2] - m.position[2], v[2] - m.velocity[2])


@kernel
def _stand_still(m: Any) -> None:
    """No velocity and acceleration beside the position target."""
    for i in range(3):
        m.target_velocity[i] = 0.0
        m.target_acceleration[i] = 0.0


@kernel
def _guided(m: Any, t: float, h: float) -> None:
    up, down, speed = m.WPNAV_SPEED_UP * 0.01, m.WPNAV_SPEED_DN * 0.01, m.WPNAV_SPEED * 0.01
    if m.guided == _VELOCITY or m.guided == _PATH:
        old = t - m.target_time > m.GUID_TIMEOUT
        if old and m.guided == _PATH:
            _stand_still(m)
        if m.guided == _PATH:
            for i in range(3):
                m.target[i] += m.target_velocity[i] * h
            _path_to_target(m, h, up, down, speed)
            return
        wanted = m.target_velocity
        flat_n, flat_e = limit_length(wanted[0], wanted[1], speed)
        sink = min(max(wanted[2], -up), down)
        _path_with_velocity(m, h, 0.0 if old else flat_n, 0.0 if old else flat_e, 0.0 if old else sink)
        return
    _stand_still(m)
    _path_to_target(m, h, up, down, speed)
    if m.guided == _TAKEOFF and abs(m.position[2] - m.target[2]) < 0.1:
        m.guided = _POSITION


@kernel
def _land(m: Any, h: float) -> None:
    """Down at WPNAV_SPEED_DN, below ten metres at LAND_SPEED, over the place."""
    height = m.home[2] - m.position[2]
    speed = m.LAND_SPEED * 0.01 if height < _LAND_SLOW_BELOW else m.WPNAV_SPEED_DN * 0.01
    _stand_still(m)
    accel_d, p2, v2 = m.desired_acceleration[2], m.desired_position[2], m.desired_velocity[2]
    _path_to_target(m, h, m.WPNAV_SPEED_UP * 0.01, m.WPNAV_SPEED_DN * 0.01, m.WPNAV_SPEED * 0.01)
    lift = m.WPNAV_ACCEL_Z * 0.01
    # The plane follows the target; height follows a speed instead.
    limit = 1.0 if m.throttle_lower else 0.0
    m.desired_position[2], m.desired_velocity[2] = advance_limited(
        p2, v2, accel_d, h, limit, p2 - m.position[2], v2 - m.velocity[2]
    )
    m.desired_acceleration[2] = shape_velocity(
        speed, 0.0, m.desired_velocity[2], accel_d, -lift, lift, m.PSC_JERK_Z, h, True
    )


@kernel
def _rtl(m: Any, t: float, h: float) -> None:
    """Climb to RTL_ALT at least, fly home, wait, land."""
    up, down, speed = m.WPNAV_SPEED_UP * 0.01, m.WPNAV_SPEED_DN * 0.01, m.WPNAV_SPEED * 0.01
    if m.rtl_state == _DESCEND:
        _land(m, h)
        return
    _stand_still(m)
    top = min(m.home[2] - m.RTL_ALT * 0.01, m.target[2])
    if m.rtl_state == _CLIMB:
        m.target[2] = top
        if abs(m.position[2] - top) < 0.5:
            m.rtl_state = _RETURN
            dn, de = m.home[0] - m.position[0], m.home[1] - m.position[1]
            if m.WP_YAW_BEHAVIOR == 1 and dn * dn + de * de > _NEAR * _NEAR:
                m.wanted_yaw = math.atan2(de, dn)
    if m.rtl_state == _RETURN:
        m.target[0], m.target[1] = m.home[0], m.home[1]
        dn, de = m.home[0] - m.position[0], m.home[1] - m.position[1]
        if dn * dn + de * de < _NEAR * _NEAR:
            m.rtl_state = _WAIT
            m.target_time = t
    if m.rtl_state == _WAIT and t - m.target_time >= _RTL_LOITER:
        m.rtl_state = _DESCEND
    _path_to_target(m, h, up, down, speed)


@kernel
def _detect_landing(m: Any, h: float) -> None:
    """On the ground after a second of hardly any thrust and hardly any motion."""
    speed = math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2)
    still = m.throttle < 0.25 * m.hover and speed < 1.0
    m.landed_for = m.landed_for + h if still else 0.0
    if m.landed_for >= _LANDED_AFTER:
        m.on_ground = True


@kernel
def _on_the_ground(m: Any, t: float, h: float) -> bool:
    """Armed and not flying: idle, wait for a take-off, or be disarmed. Returns whether motors are to open up."""
    relax(m)
    hold_here(m)
    m.throttle = 0.0
    if m.mode == LAND or m.mode == RTL:
        disarm(m)
        return False
    starting = m.mode == GUIDED and m.guided == _TAKEOFF
    if not starting:
        m.idle_for += h
        if m.DISARM_DELAY > 0 and m.idle_for >= m.DISARM_DELAY:
            disarm(m)
            m.said_disarming = True
        return False
    m.idle_for = 0.0
    if m.opened >= 1.0:
        m.on_ground = False
        m.landed_for = 0.0
        for i in range(3):
            m.desired_velocity[i] = 0.0
    return True


@kernel
def fly(m: Any, t: float, h: float) -> None:
    """One step of whatever mode is on: desired path, control loops, motors."""
    if not m.armed:
        m.on_ground = True
        relax(m)
        hold_here(m)
        m.throttle = 0.0
        attitude_and_motors(m, h, False)
        return
    if m.on_ground:
        wanted = _on_the_ground(m, t, h)
        attitude_and_motors(m, h, wanted)
        return
    if m.mode == STABILIZE:
        relax(m)
        hold_here(m)
        m.throttle = 0.0
        _, _, yaw = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
        m.wanted_yaw = m.yaw_target
    else:
        if m.mode == GUIDED:
            _guided(m, t, h)
        elif m.mode == LAND:
            _land(m, h)
        elif m.mode == RTL:
            _rtl(m, t, h)
        else:
            _stand_still(m)
            _path_to_target(
                m, h, m.WPNAV_SPEED_UP * 0.01, m.WPNAV_SPEED_DN * 0.01, m.WPNAV_SPEED * 0.01
            )
        horizontal(m, h)
        vertical(m, h)
    if not (m.mode == GUIDED and m.guided == _TAKEOFF):
        _detect_landing(m, h)
    attitude_and_motors(m, h, True)
