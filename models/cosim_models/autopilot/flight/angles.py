"""GUIDED by attitudes: SET_ATTITUDE_TARGET with a climb rate or a throttle, as in ArduCopter.

The attitude, or the angular velocity if it is left out, and the climb rate or the throttle are followed for
GUID_TIMEOUT; then the vehicle levels and holds its height. A positive climb rate or throttle lifts off. Kernels over
the autopilot's record `m`.

Source: ArduPilot, ArduCopter mode_guided (angle_control_run, set_angle).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import (
    follow_attitude,
    follow_rates,
    follow_yaw_rate,
    forget_torques,
    relax_yaw,
)
from cosim_models.autopilot.control.motors import THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import (
    GRAVITY,
    control_up,
    initialise_up,
    seek_velocity_up,
    set_limits,
    set_throttle,
)
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.record.modes import ANGLE

__all__ = ["guide_angle", "level_out", "run_angle"]

_TIMEOUT_MIN = 0.1  # s


@kernel
def level_out(m: Any) -> None:
    """Demands a level attitude with the heading of the attitude target, and no climb."""
    q = m.attitude_target
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    m.angle_q[0], m.angle_q[1], m.angle_q[2], m.angle_q[3] = math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)
    m.angle_free = False
    for i in range(3):
        m.angle_rates[i] = 0.0
    m.angle_climb = 0.0


@kernel
def guide_angle(m: Any, by_thrust: bool, t: float) -> None:
    """Begins or continues flight by attitudes; the caller then sets m.angle_q, _free, _rates and _climb.

    m.angle_climb is a throttle (-1 to 1) if `by_thrust`, else a climb rate [m/s].
    """
    if m.submode != ANGLE:
        m.submode = ANGLE
        set_limits(m, 0.01 * m.WPNAV_SPEED, 0.01 * m.WPNAV_SPEED_UP, 0.01 * m.WPNAV_SPEED_DN)
        level_out(m)
    elif m.angle_thrust and not by_thrust:
        initialise_up(m)
    m.angle_thrust = by_thrust
    m.guided_time = t


@kernel
def _lift_off(m: Any, dt: float) -> None:
    """Spools up with relaxed controllers; the vehicle then counts as flying."""
    m.spool_wanted = THROTTLE_UNLIMITED
    relax_yaw(m)
    forget_torques(m, False, dt)
    follow_yaw_rate(m, 0.0, 0.0, -GRAVITY, 0.0, dt)
    set_throttle(m, 0.0, False, 0.0, dt)
    if m.spool_state == THROTTLE_UNLIMITED:
        m.on_ground = False
        initialise_up(m)


@kernel
def run_angle(m: Any, t: float, dt: float) -> bool:
    """Performs one step of flight by attitudes; returns False if the vehicle has to rest on the ground instead."""
    if t - m.guided_time > max(m.GUID_TIMEOUT, _TIMEOUT_MIN):
        if m.angle_thrust:
            initialise_up(m)
            m.angle_thrust = False
        level_out(m)
    climb = m.angle_climb if m.angle_thrust else clip(m.angle_climb, -m.speed_down, m.speed_up)
    rises = climb > 0.0
    if m.armed and rises:
        m.auto_armed = True
    if not m.armed or not m.auto_armed or (m.on_ground and not rises):
        return False
    if m.on_ground:
        _lift_off(m, dt)
        return True
    m.spool_wanted = THROTTLE_UNLIMITED
    if m.angle_free:
        follow_rates(m, m.angle_rates, dt)
    else:
        follow_attitude(m, m.angle_q, m.angle_rates, dt)
    if m.angle_thrust:
        set_throttle(m, climb, True, m.PILOT_THR_FILT, dt)
    else:
        seek_velocity_up(m, climb, 0.0, False, dt)
        control_up(m, dt)
    return True
