"""Manual flight: STABILIZE, ALT_HOLD, LOITER and CIRCLE, as in ArduCopter.

Kernels over the autopilot's record `m`, called once per step. Without input from a pilot (`sticks`), the sticks are
neutral: LOITER and ALT_HOLD keep the height, and on the ground the motors idle. In STABILIZE, however, the throttle is
then closed both on the ground and in the air, where the vehicle falls. Vectors are north, east, UP from the local
origin, SI units.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: mode_stabilize, mode_althold, mode_loiter, mode_circle, takeoff; AC_Loiter
and AC_Circle.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_yaw_rate, forget_torques, relax_yaw, shape_angle
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import (
    GRAVITY,
    control_ne,
    control_up,
    initialise_ne,
    initialise_up,
    relax_ne,
    seek_position_up,
    set_throttle,
    soften_for_landing,
    stop_ne,
)
from cosim_models.autopilot.control.shaping import clip, sqrt_controller
from cosim_models.autopilot.flight.avoidance import avoids, slow_at_fences, slow_at_heights
from cosim_models.autopilot.flight.circle import begin_circle, go_round
from cosim_models.autopilot.flight.guided import rest_on_ground, standard_limits
from cosim_models.autopilot.flight.sticks import (
    deflection,
    hands_on,
    pilot_climb_rate,
    pilot_climbs,
    pilot_lean,
    pilot_throttle,
    pilot_tilt,
    pilot_yaw_rate,
    throttle_zero,
)
from cosim_models.autopilot.flight.terrain_following import climb_over_surface
from cosim_models.autopilot.flight.yaw import circle_nose, look_round
from cosim_models.autopilot.record.modes import STABILIZE

__all__ = [
    "climb_by_stick",
    "is_flying",
    "lean_for",
    "move_by_stick",
    "prepare_loiter",
    "reset_loiter",
    "run_alt_hold",
    "run_circle",
    "run_loiter",
    "run_stabilize",
    "start_alt_hold",
    "start_circle",
    "start_loiter",
    "use_pilot_limits",
    "wanted_yaw_rate",
]

_TAKEOFF_THROTTLE = 0.9
_LOITER_SHARE = 2.0 / 3.0  # of ANGLE_MAX that LOITER uses by default
_LOITER_CORRECTION = 2.0  # m/s and m, maximum correction in LOITER
_LOITER_SPEED_MIN = 0.2  # m/s
_CIRCLE_RATE_MAX = math.radians(90.0)
_STICKS, _AT_CENTRE = 1, 4  # CIRCLE_OPTIONS


@kernel
def _lean_by_stick(m: Any, t: float, dt: float) -> None:
    """Computes the attitude demanded by the sticks."""
    most = math.radians(0.01 * m.ANGLE_MAX)
    n, e = pilot_tilt(m, most, m.lean_max if m.mode != STABILIZE else most, t)
    follow_yaw_rate(m, GRAVITY * n, GRAVITY * e, -GRAVITY, wanted_yaw_rate(m, t, dt), dt)


@kernel
def wanted_yaw_rate(m: Any, t: float, dt: float) -> float:
    """Returns the yaw rate demanded by the yaw stick, filtered with PILOT_Y_RATE_TC."""
    rate = pilot_yaw_rate(m, t)
    if m.PILOT_Y_RATE_TC > 0.0:
        rate = m.rate_target[2] + (rate - m.rate_target[2]) * min(dt / max(m.PILOT_Y_RATE_TC, 0.01), 1.0)
    return rate


@kernel
def run_stabilize(m: Any, t: float, dt: float) -> None:
    """Runs STABILIZE: the sticks set lean, yaw rate and throttle."""
    m.spool_wanted = GROUND_IDLE if throttle_zero(m, t) else THROTTLE_UNLIMITED
    throttle = pilot_throttle(m, t)
    if m.spool_state <= GROUND_IDLE:
        relax_yaw(m)
        forget_torques(m, m.spool_state == GROUND_IDLE, dt)
        throttle = 0.0
    elif m.spool_state == THROTTLE_UNLIMITED and not m.limit_throttle_lower:
        m.on_ground = False
    _lean_by_stick(m, t, dt)
    set_throttle(m, throttle, True, m.PILOT_THR_FILT, dt)


# ---- modes that hold height ----------------------------------------------------------------------------------------


@kernel
def use_pilot_limits(m: Any) -> None:
    m.speed_up = 0.01 * m.PILOT_SPEED_UP
    m.speed_down = 0.01 * m.PILOT_SPEED_DN if m.PILOT_SPEED_DN > 0.0 else m.speed_up
    m.accel_up = 0.01 * m.PILOT_ACCEL_Z


@kernel
def is_flying(m: Any, climb: float, t: float, dt: float) -> bool:
    """Returns whether the vehicle flies or takes off by the throttle stick; if not, the vehicle rests on the ground."""
    if m.armed and (m.pilot_takeoff or (m.on_ground and climb > 0.0 and m.spool_state == THROTTLE_UNLIMITED)):
        if not m.pilot_takeoff:
            m.pilot_takeoff = True
            m.takeoff_from = m.desired_position_neu[2]
            m.takeoff_to = m.takeoff_from + 0.01 * m.PILOT_TKOFF_ALT
        return True
    if m.armed and m.auto_armed and not m.on_ground:
        m.spool_wanted = THROTTLE_UNLIMITED
        return True
    m.pilot_takeoff = False
    rest_on_ground(m, dt)
    if m.armed and pilot_climbs(m, t):
        m.spool_wanted = THROTTLE_UNLIMITED
    return False


@kernel
def climb_by_stick(m: Any, climb: float, dt: float) -> None:
    """Runs height control at the demanded climb rate, or the pilot's take-off."""
    if not m.pilot_takeoff:
        climb_over_surface(m, climb, dt)
        control_up(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    rise = m.takeoff_to - m.takeoff_from
    if not m.on_ground:
        seek_position_up(m, m.takeoff_to, climb, dt)
        control_up(m, dt)
        if climb < 0.0 or 0.999 * rise < m.desired_position_neu[2] - m.takeoff_from:
            m.pilot_takeoff = False
        return
    throttle = clip(m.throttle_in + dt / max(m.TKOFF_SLEW_TIME, 0.01), 0.0, 1.0)
    initialise_up(m)
    set_throttle(m, throttle, True, 0.0, dt)
    if (
        throttle >= min(m.TKOFF_THR_MAX, _TAKEOFF_THROTTLE)
        or m.acceleration_neu[2] >= 0.5 * m.accel_up
        or m.desired_velocity_neu[2] >= clip(climb, 0.1 * m.speed_up, 0.5 * m.speed_up)
        or (rise > 0.0 and m.desired_position_neu[2] - m.takeoff_from > 0.5 * rise)
    ):
        m.on_ground = False


@kernel
def start_alt_hold(m: Any) -> None:
    """Holds the current height."""
    standard_limits(m)
    use_pilot_limits(m)
    initialise_up(m)


@kernel
def run_alt_hold(m: Any, t: float, dt: float) -> None:
    """Runs ALT_HOLD: the sticks set lean, yaw rate and climb rate; the vehicle drifts with the wind."""
    use_pilot_limits(m)
    climb = pilot_climb_rate(m, t)
    if not is_flying(m, climb, t, dt):
        return
    climb_by_stick(m, climb, dt)
    relax_ne(m, dt)
    _lean_by_stick(m, t, dt)


# ---- LOITER --------------------------------------------------------------------------------------------------------


@kernel
def start_loiter(m: Any) -> None:
    """Stops the vehicle, then holds its position."""
    prepare_loiter(m)
    reset_loiter(m)
    initialise_up(m)


@kernel
def prepare_loiter(m: Any) -> None:
    """Sets the limits of LOITER and of the pilot's climb."""
    standard_limits(m)
    use_pilot_limits(m)
    m.speed_max = _LOITER_CORRECTION
    m.accel_max = 0.01 * m.LOIT_ACC_MAX


@kernel
def reset_loiter(m: Any) -> None:
    """Begins with the current motion and lean, which returns to that of the sticks.

    As in ArduCopter, the time without sticks, after which the vehicle brakes, does not begin anew.
    """
    initialise_ne(m)
    m.loiter_brake = 0.0
    m.loiter_tilt[0], m.loiter_tilt[1] = lean_for(m, m.target_acceleration_neu[0], m.target_acceleration_neu[1])
    for i in range(2):
        m.loiter_tilt_rate[i] = 0.0


@kernel
def lean_for(m: Any, n: float, e: float) -> tuple[float, float]:
    """Returns the roll and pitch [rad] of an acceleration at constant height, with the current heading."""
    if n == 0.0 and e == 0.0:
        return 0.0, 0.0
    q = m.q
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    c, s = math.cos(heading), math.sin(heading)
    pitch = -math.atan((n * c + e * s) / GRAVITY)
    return math.atan((e * c - n * s) * math.cos(pitch) / GRAVITY), pitch


@kernel
def _acceleration_of(m: Any, roll: float, pitch: float) -> tuple[float, float]:
    """Returns the north and east acceleration at constant height for a lean [rad] with the current heading."""
    q = m.q
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    up = max(math.cos(roll) * math.cos(pitch), 0.1)
    forward = -GRAVITY * math.sin(pitch) * math.cos(roll) / up
    right = GRAVITY * math.sin(roll) / up
    c, s = math.cos(heading), math.sin(heading)
    return forward * c - right * s, forward * s + right * c


@kernel
def _predict(m: Any, roll: float, pitch: float, dt: float) -> tuple[float, float]:
    """Returns the acceleration of the attitude as it will follow the sticks."""
    tilt, rate = m.loiter_tilt, m.loiter_tilt_rate
    rate[0] = shape_angle(m, roll - tilt[0], m.ATC_ACCEL_R_MAX, rate[0], dt)
    rate[1] = shape_angle(m, pitch - tilt[1], m.ATC_ACCEL_P_MAX, rate[1], dt)
    tilt[0] += rate[0] * dt
    tilt[1] += rate[1] * dt
    if tilt[0] == 0.0 and tilt[1] == 0.0:
        return 0.0, 0.0
    return _acceleration_of(m, tilt[0], tilt[1])


@kernel
def move_by_stick(m: Any, by_pilot: bool, t: float, dt: float) -> None:
    """Shapes the horizontal motion and controls it: acceleration by the sticks less drag; centred sticks brake.

    Without `by_pilot`, the sticks count as centred, and fences do not slow the vehicle down.
    """
    lean_max = (
        math.radians(m.LOIT_ANG_MAX) if m.LOIT_ANG_MAX > 0.0 else _LOITER_SHARE * math.radians(0.01 * m.ANGLE_MAX)
    )
    roll, pitch = 0.0, 0.0
    if by_pilot:
        roll, pitch = pilot_lean(m, lean_max, m.lean_max, t)
    wn, we = 0.0, 0.0
    moved = roll != 0.0 or pitch != 0.0
    if moved:
        wn, we = _acceleration_of(m, roll, pitch)
    p, v, a = m.desired_position_neu, m.desired_velocity_neu, m.desired_acceleration_neu
    an, ae = _predict(m, roll, pitch, dt)
    v[0] += an * dt
    v[1] += ae * dt
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1])
    brake = 0.0
    if moved:
        m.loiter_since = t
    elif t - m.loiter_since > m.LOIT_BRK_DELAY:
        gain = 0.5 * m.PSC_VELXY_P
        brake = clip(sqrt_controller(speed, gain, 0.01 * m.LOIT_BRK_JERK, dt), 0.0, 0.01 * m.LOIT_BRK_ACCEL)
    step = 0.01 * m.LOIT_BRK_JERK * dt
    m.loiter_brake += clip(brake - m.loiter_brake, -step, step)
    drag = GRAVITY * math.tan(lean_max) * speed / max(0.01 * m.LOIT_SPEED, _LOITER_SPEED_MIN)
    slower = max(speed - (drag + m.loiter_brake) * dt, 0.0)
    share = slower / speed if speed > 0.0 else 0.0
    a[0], a[1] = wn, we
    for i in range(2):
        if speed > 0.0:
            a[i] -= m.loiter_brake * v[i] / speed
        v[i] *= share
    if by_pilot and avoids(m):
        v[0], v[1] = slow_at_fences(m, v[0], v[1], dt)
    for i in range(2):
        p[i] += v[i] * dt
    control_ne(m, dt)


@kernel
def run_loiter(m: Any, t: float, dt: float) -> None:
    """Runs LOITER: sticks set acceleration, yaw rate and climb rate; centred sticks brake and hold position."""
    use_pilot_limits(m)
    climb = pilot_climb_rate(m, t)
    if avoids(m):
        climb = slow_at_heights(m, climb, dt)
    if not is_flying(m, climb, t, dt):
        reset_loiter(m)
        return
    if m.touched:
        soften_for_landing(m, dt)
    move_by_stick(m, True, t, dt)
    climb_by_stick(m, climb, dt)
    a = m.target_acceleration_neu
    follow_yaw_rate(m, a[0], a[1], -GRAVITY, wanted_yaw_rate(m, t, dt), dt)


# ---- CIRCLE --------------------------------------------------------------------------------------------------------


@kernel
def _take_circle(m: Any) -> None:
    """Sets radius and rate from the parameters."""
    m.circle_asked[0], m.circle_asked[1] = m.CIRCLE_RADIUS, m.CIRCLE_RATE
    m.circle_radius = 0.01 * m.CIRCLE_RADIUS
    m.circle_rate = math.radians(m.CIRCLE_RATE)


@kernel
def start_circle(m: Any) -> None:
    """Begins a circle whose centre is CIRCLE_RADIUS ahead of the stopping point."""
    standard_limits(m)
    use_pilot_limits(m)
    heading = yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    stop_ne(m)
    initialise_up(m)
    _take_circle(m)
    ahead = 0.0 if (m.CIRCLE_OPTIONS & _AT_CENTRE) != 0 else m.circle_radius
    m.circle_above = False
    m.circle_centre[0] = m.desired_position_neu[0] + ahead * math.cos(heading)
    m.circle_centre[1] = m.desired_position_neu[1] + ahead * math.sin(heading)
    begin_circle(m, True)
    circle_nose(m)
    look_round(m, heading)


@kernel
def _change_circle(m: Any, t: float, dt: float) -> None:
    """Applies changed parameters; the pitch stick changes the radius, the roll stick the rate."""
    if m.circle_asked[0] != m.CIRCLE_RADIUS or m.circle_asked[1] != m.CIRCLE_RATE:
        _take_circle(m)
    if (m.CIRCLE_OPTIONS & _STICKS) == 0 or not hands_on(m, t) or m.radio_lost:
        return
    wider = deflection(m, m.RCMAP_PITCH, t) * m.speed_max * dt
    m.circle_radius = max(m.circle_radius + wider, 0.0)
    faster = deflection(m, m.RCMAP_ROLL, t) * dt
    m.circle_rate = clip(m.circle_rate + faster, -_CIRCLE_RATE_MAX, _CIRCLE_RATE_MAX)


@kernel
def run_circle(m: Any, t: float, dt: float) -> None:
    """Runs CIRCLE: faces the centre until the pilot yaws; the throttle stick sets the climb rate."""
    if not m.armed or not m.auto_armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    use_pilot_limits(m)
    _change_circle(m, t, dt)
    go_round(m, pilot_climb_rate(m, t), dt)
