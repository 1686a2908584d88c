"""Autonomous flight: GUIDED, take-off, landing, the end of RTL, and BRAKE, as in ArduCopter.

Kernels over the autopilot's record `m`, called once per step; they call the position and attitude controllers. Commands
use `take_off` and the `guide_*` functions. Vectors are north, east, UP from the local origin, SI units. Modes flown by
hand are in `manual`, the mode switching is in `modes`, the heading in `yaw`, the way of RTL in `returning.rtl`.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: mode_guided, mode_brake, mode_land, mode_rtl, takeoff.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_yaw_rate, forget_torques, relax_yaw
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import (
    GRAVITY,
    control_ne,
    control_up,
    initialise_ne,
    initialise_up,
    limit_jerks,
    relax_ne,
    relax_up,
    seek_acceleration,
    seek_position,
    seek_position_up,
    seek_position_velocity,
    seek_velocity_ne,
    seek_velocity_up,
    set_limits,
    set_throttle,
    soften_for_landing,
)
from cosim_models.autopilot.control.shaping import clip, sqrt_controller
from cosim_models.autopilot.flight.angles import run_angle
from cosim_models.autopilot.flight.avoidance import avoid_fences, avoids
from cosim_models.autopilot.flight.state import disarm
from cosim_models.autopilot.flight.terrain_following import lower, margin_share, raise_up, refer_heights, see_terrain
from cosim_models.autopilot.flight.yaw import (
    default_nose,
    hold_heading,
    lean,
    stop_turning,
)
from cosim_models.autopilot.mission.terrain import (
    BY_RANGE,
    height_above_ground,
    measured_terrain,
    range_is_healthy,
    terrain_source,
)
from cosim_models.autopilot.record.modes import (
    ACCELERATION,
    ANGLE,
    DESCEND,
    FINAL,
    GUIDED,
    LAND,
    POSITION,
    POSITION_VELOCITY,
    TAKEOFF,
    VELOCITY,
)

__all__ = [
    "braking_limits",
    "run_arrived",
    "run_guided",
    "standard_limits",
    "guide_acceleration",
    "guide_position",
    "guide_position_velocity",
    "guide_stop",
    "guide_velocity",
    "land_on",
    "rest_on_ground",
    "run_land",
    "run_paused",
    "run_takeoff",
    "start_brake",
    "start_control",
    "start_descent",
    "start_land",
    "start_takeoff",
    "take_off",
]


_TAKEOFF_THROTTLE = 0.9
_TAKEOFF_SLOW = 0.1  # of the climb rate, below which a take-off may end; and within its stopping distance
_BRAKE_ACCEL = 7.5  # m/s2
_BRAKE_CLIMB = 2.5  # m/s


# ---- GUIDED: commands ----------------------------------------------------------------------------------------------


@kernel
def standard_limits(m: Any) -> None:
    set_limits(m, 0.01 * m.WPNAV_SPEED, 0.01 * m.WPNAV_SPEED_UP, 0.01 * m.WPNAV_SPEED_DN)


@kernel
def braking_limits(m: Any, speed: float) -> None:
    """Sets the limits of BRAKE and THROW: `speed` [m/s], hard braking in all directions."""
    set_limits(m, speed, _BRAKE_CLIMB, _BRAKE_CLIMB)
    m.accel_max = _BRAKE_ACCEL
    m.accel_up = _BRAKE_ACCEL
    limit_jerks(m)


@kernel
def start_brake(m: Any, t: float) -> None:
    """Stops hard, and holds position, height and heading."""
    guide_stop(m, t)
    v = m.velocity_neu
    braking_limits(m, math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
    initialise_ne(m)
    initialise_up(m)
    hold_heading(m)


@kernel
def start_control(m: Any) -> None:
    """Sets standard limits, initialises the controllers from the current motion, and the heading by WP_YAW_BEHAVIOR."""
    standard_limits(m)
    initialise_ne(m)
    initialise_up(m)
    m.above_terrain = False
    default_nose(m)


@kernel
def guide_stop(m: Any, t: float) -> None:
    """Stops in GUIDED and waits for targets."""
    start_control(m)
    m.paused = False
    m.submode = VELOCITY
    m.guided_time = t
    for i in range(3):
        m.guided_velocity_neu[i] = 0.0
        m.guided_acceleration_neu[i] = 0.0


@kernel
def _enter_submode(m: Any, submode: int) -> None:
    if m.submode != submode:
        start_control(m)
        m.submode = submode


@kernel
def guide_position(m: Any, n: float, e: float, u: float, above: bool, t: float) -> bool:
    """Flies to a point in GUIDED; `above`: its height is above the terrain, whose height must be known.

    Returns whether it is; otherwise, the vehicle stops.
    """
    _enter_submode(m, POSITION)
    if above and not measured_terrain(m)[0]:
        guide_stop(m, t)
        return False
    if above != m.above_terrain:
        if above:
            refer_heights(m, True)
        else:
            m.terrain_on = m.above_terrain = False
    default_nose(m)
    m.guided_position_neu[0], m.guided_position_neu[1], m.guided_position_neu[2] = n, e, u
    m.guided_time = t
    return True


@kernel
def guide_velocity(m: Any, vn: float, ve: float, vu: float, t: float) -> None:
    """Flies at a velocity in GUIDED, for GUID_TIMEOUT."""
    _enter_submode(m, VELOCITY)
    default_nose(m)
    m.guided_velocity_neu[0], m.guided_velocity_neu[1], m.guided_velocity_neu[2] = vn, ve, vu
    for i in range(3):
        m.guided_acceleration_neu[i] = 0.0
    m.guided_time = t


@kernel
def guide_position_velocity(m: Any, t: float) -> None:
    """Follows a moving point in GUIDED; the caller has set m.guided_position_neu, velocity and acceleration."""
    _enter_submode(m, POSITION_VELOCITY)
    default_nose(m)
    m.guided_time = t


@kernel
def guide_acceleration(m: Any, an: float, ae: float, au: float, t: float) -> None:
    """Accelerates in GUIDED, for GUID_TIMEOUT."""
    _enter_submode(m, ACCELERATION)
    default_nose(m)
    m.guided_acceleration_neu[0], m.guided_acceleration_neu[1], m.guided_acceleration_neu[2] = an, ae, au
    m.guided_time = t


@kernel
def take_off(m: Any, height: float) -> bool:
    """Takes off in GUIDED to `height` [m above home]; returns False if that is not possible."""
    if not m.armed or not m.on_ground or m.mode != GUIDED:
        return False
    if range_is_healthy(m) and terrain_source(m) == BY_RANGE and height < m.RNGFND1_MAX:
        up = m.range_terrain + height
    else:
        up = m.home_neu[2] + height
    if up <= m.position_neu[2]:
        return False
    start_takeoff(m, up)
    m.auto_armed = True
    return True


@kernel
def start_takeoff(m: Any, up: float) -> None:
    """Begins a take-off to `up` [m]."""
    standard_limits(m)
    m.submode = TAKEOFF
    hold_heading(m)
    m.takeoff_to = up
    m.above_terrain = False
    m.takeoff_done = False


# ---- modes ---------------------------------------------------------------------------------------------------------


@kernel
def start_land(m: Any) -> None:
    """Begins a landing from any motion."""
    land_on(m)
    initialise_ne(m)
    initialise_up(m)


@kernel
def land_on(m: Any) -> None:
    """Begins a landing where the position controllers run already: they keep their desired motion."""
    m.terrain_on = False
    m.land_pause = 0.0
    standard_limits(m)
    hold_heading(m)


@kernel
def rest_on_ground(m: Any, dt: float) -> None:
    """Idles the motors; the controllers follow the vehicle so that nothing winds up."""
    m.spool_wanted = GROUND_IDLE
    forget_torques(m, True, dt)
    if m.spool_state <= GROUND_IDLE:
        relax_yaw(m)
    relax_ne(m, dt)
    control_ne(m, dt)
    relax_up(m, 0.0, dt)
    control_up(m, dt)
    follow_yaw_rate(m, 0.0, 0.0, -GRAVITY, 0.0, dt)


@kernel
def run_takeoff(m: Any, dt: float) -> None:
    if not m.armed or not m.auto_armed:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    if m.spool_state != THROTTLE_UNLIMITED:
        relax_ne(m, dt)
        control_ne(m, dt)
        relax_up(m, 0.0, dt)
        control_up(m, dt)
        relax_yaw(m)
        forget_torques(m, False, dt)
        follow_yaw_rate(m, m.target_acceleration_neu[0], m.target_acceleration_neu[1], -GRAVITY, 0.0, dt)
        return
    if m.on_ground:
        throttle = clip(m.throttle_in + dt / max(m.TKOFF_SLEW_TIME, 0.01), 0.0, 1.0)
        initialise_up(m)
        set_throttle(m, throttle, True, 0.0, dt)
        relax_ne(m, dt)
        control_ne(m, dt)
        forget_torques(m, False, dt)
        follow_yaw_rate(m, m.target_acceleration_neu[0], m.target_acceleration_neu[1], -GRAVITY, 0.0, dt)
        if (
            throttle >= min(m.TKOFF_THR_MAX, _TAKEOFF_THROTTLE)
            or m.acceleration_neu[2] >= 0.5 * m.accel_up
            or m.desired_velocity_neu[2] >= 0.1 * m.speed_up
        ):
            m.on_ground = False
        return
    seek_velocity_ne(m, 0.0, 0.0, 0.0, 0.0, dt)
    control_ne(m, dt)
    seek_position_up(m, m.takeoff_to, 0.0, dt)
    control_up(m, dt)
    lean(m, dt)
    slow = _TAKEOFF_SLOW * m.speed_up
    left = m.takeoff_to - m.desired_position_neu[2]
    if left <= 0.5 * slow * slow / m.accel_up and m.desired_velocity_neu[2] < slow:
        m.takeoff_done = True


@kernel
def run_paused(m: Any, dt: float) -> None:
    """Stops, and holds position and heading while the flight is paused."""
    if not m.armed or not m.auto_armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    seek_velocity_ne(m, 0.0, 0.0, 0.0, 0.0, dt)
    seek_velocity_up(m, 0.0, 0.0, False, dt)
    control_ne(m, dt)
    control_up(m, dt)
    follow_yaw_rate(m, m.target_acceleration_neu[0], m.target_acceleration_neu[1], -GRAVITY, 0.0, dt)


@kernel
def _seek_above_terrain(m: Any, dt: float) -> None:
    """Shapes the desired motion to the destination, along the terrain."""
    p = m.guided_position_neu
    lower(m)
    if see_terrain(m):
        share = margin_share(m, min(m.WPNAV_TER_MARGIN, 0.5 * abs(p[2])))
        seek_position(m, p[0], p[1], p[2], share, dt)
    else:
        m.terrain_missing = True
    raise_up(m, dt)


@kernel
def run_guided(m: Any, t: float, dt: float) -> None:
    if m.paused:
        run_paused(m, dt)
        return
    if m.submode == TAKEOFF:
        run_takeoff(m, dt)
        return
    if m.submode == ANGLE:
        if not run_angle(m, t, dt):
            rest_on_ground(m, dt)
        return
    if not m.armed or not m.auto_armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    late = t - m.guided_time > m.GUID_TIMEOUT
    if late:
        stop_turning(m)
        if m.submode != POSITION:
            for i in range(3):
                m.guided_velocity_neu[i] = 0.0
                m.guided_acceleration_neu[i] = 0.0
    p, v, a = m.guided_position_neu, m.guided_velocity_neu, m.guided_acceleration_neu
    if m.submode == POSITION and m.terrain_on:
        _seek_above_terrain(m, dt)
    elif m.submode == POSITION:
        seek_position(m, p[0], p[1], p[2], 1.0, dt)
    elif m.submode == VELOCITY:
        if avoids(m):
            avoid_fences(m, v, dt)
        seek_velocity_ne(m, v[0], v[1], a[0], a[1], dt)
        seek_velocity_up(m, v[2], a[2], False, dt)
    elif m.submode == POSITION_VELOCITY:
        seek_position_velocity(m, p, v, a, dt)
    elif late:  # after accelerations, the velocity is brought to zero
        seek_velocity_ne(m, 0.0, 0.0, 0.0, 0.0, dt)
        seek_velocity_up(m, 0.0, 0.0, False, dt)
    else:
        seek_acceleration(m, a[0], a[1], a[2], dt)
    control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)


@kernel
def _reposition(m: Any) -> tuple[float, float]:
    """Returns the north and east velocity [m/s] by which the pilot's roll and pitch sticks move the landing point."""
    forward, right = m.pilot_stick[0], m.pilot_stick[1]
    if not m.rc_known or m.LAND_REPOSITION == 0 or (forward == 0.0 and right == 0.0):
        return 0.0, 0.0
    heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    c, s = math.cos(heading), math.sin(heading)
    n, e = forward * c - right * s, forward * s + right * c
    edge = math.sqrt(n * n + e * e) / max(abs(n), abs(e))  # edge of the square of stick positions in this direction
    speed = 0.5 * 0.01 * m.WPNAV_ACCEL / edge
    return n * speed, e * speed


@kernel
def _tilt(m: Any) -> tuple[float, float]:
    """Returns the north and east acceleration [m/s2] of the lean that the pilot's roll and pitch sticks ask for."""
    if not m.rc_known or m.LAND_REPOSITION == 0:
        return 0.0, 0.0
    most = math.radians(0.01 * m.ANGLE_MAX)
    forward, right = GRAVITY * math.tan(most * m.pilot_stick[0]), GRAVITY * math.tan(most * m.pilot_stick[1])
    heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    c, s = math.cos(heading), math.sin(heading)
    return forward * c - right * s, forward * s + right * c


@kernel
def _descend(m: Any, dt: float) -> None:
    """Descends at the speed limit to LAND_ALT_LOW, then at LAND_SPEED; the pilot may move the landing point.

    Without a position, the vehicle is level and drifts, or leans as the pilot asks.
    """
    slow = 0.01 * m.LAND_SPEED
    fast = 0.01 * m.LAND_SPEED_HIGH if m.LAND_SPEED_HIGH > 0.0 else m.speed_down
    height = height_above_ground(m)
    low = 0.01 * max(m.LAND_ALT_LOW, 100.0)
    rate = sqrt_controller(low - height, m.PSC_POSZ_P, m.accel_up, dt)
    if m.land_pause > 0.0:
        m.land_pause -= dt
        seek_velocity_up(m, 0.0, 0.0, False, dt)
    else:
        seek_velocity_up(m, clip(rate, min(-fast, -slow), -slow), 0.0, True, dt)
    if m.touched:
        soften_for_landing(m, dt)
    if m.mode == LAND and m.land_blind:
        relax_ne(m, dt)
        m.target_acceleration_neu[0], m.target_acceleration_neu[1] = _tilt(m)
    elif m.mode != LAND and (m.position_lost or m.ekf_failed):
        relax_ne(m, dt)
    else:
        vn, ve = _reposition(m)
        seek_velocity_ne(m, vn, ve, 0.0, 0.0, dt)
        control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)


@kernel
def run_land(m: Any, dt: float) -> None:
    if m.on_ground and m.armed and m.spool_state == GROUND_IDLE:
        disarm(m)
    if not m.armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    _descend(m, dt)


@kernel
def _come_down(m: Any, dt: float) -> None:
    """Descends to RTL_ALT_FINAL and holds that height; the pilot may move the landing point."""
    m.spool_wanted = THROTTLE_UNLIMITED
    vn, ve = _reposition(m)
    p = m.guided_position_neu
    seek_velocity_ne(m, vn, ve, 0.0, 0.0, dt)
    seek_position_up(m, p[2], 0.0, dt)
    p[0], p[1] = m.desired_position_neu[0], m.desired_position_neu[1]
    control_ne(m, dt)
    control_up(m, dt)
    lean(m, dt)


@kernel
def start_descent(m: Any) -> None:
    """Begins the descent at the end of RTL: to RTL_ALT_FINAL, or to the ground if that is 0 or the radio is lost."""
    if m.RTL_ALT_FINAL > 0.0 and not m.radio_lost:
        m.rtl_stage = FINAL
        m.above_terrain = False
        hold_heading(m)
        m.guided_position_neu[2] = m.home_neu[2] + 0.01 * m.RTL_ALT_FINAL
        return
    m.rtl_stage = DESCEND
    land_on(m)


@kernel
def run_arrived(m: Any, dt: float) -> None:
    """Performs one step of the descent that `start_descent` has begun."""
    if m.rtl_stage == DESCEND:
        run_land(m, dt)
    elif not m.armed or m.on_ground:
        rest_on_ground(m, dt)
    else:
        _come_down(m, dt)
