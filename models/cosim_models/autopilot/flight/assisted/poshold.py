"""POSHOLD: the sticks lean the vehicle; when they are released, it brakes and holds its position.

Roll and pitch have a state each: flown by the pilot, braking, ready to hold. When both are ready, braking turns into
LOITER within 1.5 s. A stick that is moved takes over its axis within 0.5 s, while the other one goes on braking. While
the position is held at rest, the lean against the wind is learnt, and added to the pilot's. Kernels over the
autopilot's record `m`; index 0 is roll, 1 is pitch; velocities and angles have the signs of the axis.

Source: ArduPilot, ArduCopter 4.7-dev: mode_poshold.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import lean_to
from cosim_models.autopilot.control.position import GRAVITY, initialise_up, relax_ne, soften_for_landing, stop_ne
from cosim_models.autopilot.control.shaping import clip
from cosim_models.autopilot.flight.avoidance import avoids, slow_at_heights
from cosim_models.autopilot.flight.manual import (
    climb_by_stick,
    is_flying,
    lean_for,
    move_by_stick,
    prepare_loiter,
    reset_loiter,
    use_pilot_limits,
    wanted_yaw_rate,
)
from cosim_models.autopilot.flight.sticks import pilot_climb_rate, pilot_lean

__all__ = ["run_poshold", "start_poshold"]

_BY_PILOT, _BRAKING, _READY, _SETTLING, _HOLDING, _TAKING_OVER = range(6)
_LOOP = 0.0025  # s, of ArduCopter's loop, for which the following two are given
_RELEASE = 0.0125  # share by which a released stick's lean falls
_WIND_SHARE = 0.0025  # of a new value in the estimate of the wind
_RELEASE_MAX = math.radians(18.0)  # lean up to which a released stick's lean falls slowly
_SLOW = 0.1  # m/s
_BRAKE_TIME_MAX, _BRAKE_TIME_SLOW = 6.0, 0.5  # s
_SETTLE_TIME = 1.5  # s
_TAKE_OVER_TIME = 0.5  # s
_WIND_DELAY = 1.5  # s after which the wind is learnt
_WIND_LEAN_SHARE = 2.0 / 3.0  # of ANGLE_MAX
_RATE_MIN = 4.0  # deg/s, of PHLD_BRAKE_RATE


@kernel
def _rate(m: Any) -> float:
    """Returns the rate [rad/s] at which braking changes the lean."""
    return math.radians(max(m.PHLD_BRAKE_RATE, _RATE_MIN))


@kernel
def start_poshold(m: Any) -> None:
    """Begins with the pilot's lean in the air, with LOITER on the ground."""
    prepare_loiter(m)
    reset_loiter(m)
    initialise_up(m)
    for i in range(2):
        m.hold_stage[i] = _HOLDING if m.on_ground else _BY_PILOT
        m.hold_lean[i] = 0.0
        m.hold_pilot[i] = 0.0
    _forget_wind(m)


@kernel
def _forget_wind(m: Any) -> None:
    m.hold_wind[0], m.hold_wind[1] = 0.0, 0.0
    m.hold_wind_lean[0], m.hold_wind_lean[1] = 0.0, 0.0


@kernel
def _body(m: Any, n: float, e: float) -> tuple[float, float]:
    """Returns the parts of a horizontal vector forward and right."""
    q = m.q
    heading = yaw_from_quaternion((q[0], q[1], q[2], q[3]))
    c, s = math.cos(heading), math.sin(heading)
    return n * c + e * s, e * c - n * s


@kernel
def _follow_stick(m: Any, i: int, wanted: float, dt: float) -> None:
    """Updates the pilot's lean: at once if it grows or reverses, slowly if the stick is released."""
    lean = m.hold_pilot[i]
    if lean * wanted < 0.0 or abs(wanted) > _RELEASE_MAX:
        m.hold_pilot[i] = wanted
        return
    fall = max(abs(lean) * (1.0 - (1.0 - _RELEASE) ** (dt / _LOOP)), _rate(m) * dt)
    m.hold_pilot[i] = max(lean - fall, wanted) if lean > 0.0 else min(lean + fall, wanted)


@kernel
def _brake(m: Any, i: int, speed: float, dt: float) -> None:
    """Updates the lean against a speed [m/s] along the axis."""
    gain = math.radians((15.0 * math.degrees(_rate(m)) + 95.0) * 0.01)
    wanted = -gain * speed * (1.0 + 5.0 / (abs(speed) + 0.6))
    step = _rate(m) * dt
    lean = clip(wanted, m.hold_brake[i] - step, m.hold_brake[i] + step)
    most = math.radians(0.01 * m.PHLD_BRAKE_ANGLE)
    m.hold_brake[i] = clip(lean, -most, most)


@kernel
def _begin_braking(m: Any, i: int, t: float) -> None:
    m.hold_stage[i] = _BRAKING
    m.hold_brake[i] = 0.0
    m.hold_brake_most[i] = 0.0
    m.hold_brake_since[i] = t
    m.hold_brake_falls[i] = 0


@kernel
def _watch_brake(m: Any, i: int, speed: float, t: float) -> None:
    """Ends braking after a time that follows from its greatest lean, or soon after the vehicle is slow."""
    if m.hold_brake_falls[i] == 0:
        if abs(m.hold_brake[i]) >= m.hold_brake_most[i]:
            m.hold_brake_most[i] = abs(m.hold_brake[i])
        else:
            m.hold_brake_since[i] = t
            m.hold_brake_falls[i] = 1
        return
    time = min(_BRAKE_TIME_MAX, 1.5 * m.hold_brake_most[i] / _rate(m))
    if abs(speed) <= _SLOW and t - m.hold_brake_since[i] > _BRAKE_TIME_SLOW and time > _BRAKE_TIME_SLOW:
        m.hold_brake_since[i] = t - time + _BRAKE_TIME_SLOW
    if t - m.hold_brake_since[i] > time:
        m.hold_stage[i] = _READY


@kernel
def _take_over(m: Any, i: int, t: float) -> None:
    """Begins to hand an axis over to the pilot."""
    m.hold_stage[i] = _TAKING_OVER
    m.hold_since[i] = t
    m.hold_pilot[i] = 0.0
    m.hold_last[i] = m.hold_lean[i]


@kernel
def _run_axis(m: Any, i: int, wanted: float, speed: float, t: float, dt: float) -> None:
    """Performs one step of an axis that is not held: the pilot's `wanted` lean [rad], `speed` [m/s] along the axis."""
    stage = m.hold_stage[i]
    wind = m.hold_wind_lean[i]
    if stage == _BY_PILOT:
        _follow_stick(m, i, wanted, dt)
        if wanted == 0.0 and abs(m.hold_pilot[i]) < 2.0 * _rate(m):
            _begin_braking(m, i, t)
        m.hold_lean[i] = m.hold_pilot[i] + wind
    elif stage in (_BRAKING, _READY):
        _brake(m, i, speed, dt)
        _watch_brake(m, i, speed, t)
        m.hold_lean[i] = m.hold_brake[i] + wind
        if wanted != 0.0:
            _take_over(m, i, t)
    elif stage == _TAKING_OVER:
        _follow_stick(m, i, wanted, dt)
        passed = t - m.hold_since[i]
        if passed > _TAKE_OVER_TIME:
            m.hold_stage[i] = _BY_PILOT
        share = min(passed / _TAKE_OVER_TIME, 1.0)
        m.hold_lean[i] = share * (m.hold_pilot[i] + wind) + (1.0 - share) * m.hold_last[i]


@kernel
def _learn_wind(m: Any, t: float, dt: float) -> None:
    """Learns the acceleration against the wind while the position is held at rest."""
    v, a, wind = m.velocity_neu, m.target_acceleration_neu, m.hold_wind
    if t - m.hold_wind_since < _WIND_DELAY or v[0] * v[0] + v[1] * v[1] > _SLOW * _SLOW:
        return
    share = 1.0 - (1.0 - _WIND_SHARE) ** (dt / _LOOP)
    for i in range(2):
        wind[i] = a[i] if wind[i] == 0.0 else wind[i] + share * (a[i] - wind[i])
    most = math.tan(_WIND_LEAN_SHARE * math.radians(0.01 * m.ANGLE_MAX)) * GRAVITY
    length = math.sqrt(wind[0] * wind[0] + wind[1] * wind[1])
    if length > most:
        for i in range(2):
            wind[i] *= most / length


@kernel
def _hold(m: Any, roll: float, pitch: float, forward: float, right: float, t: float, dt: float) -> None:
    """Performs one step of both axes in LOITER, or on the way to it; a stick takes its axis over."""
    holding = m.hold_stage[0] == _HOLDING
    move_by_stick(m, False, t, dt)
    held_roll, held_pitch = lean_for(m, m.target_acceleration_neu[0], m.target_acceleration_neu[1])
    if holding:
        m.hold_lean[0], m.hold_lean[1] = held_roll, held_pitch
        _learn_wind(m, t, dt)
    else:
        _brake(m, 0, right, dt)
        _brake(m, 1, -forward, dt)
        share = max(1.0 - (t - m.hold_settling_since) / _SETTLE_TIME, 0.0)  # of braking
        m.hold_lean[0] = share * (m.hold_brake[0] + m.hold_wind_lean[0]) + (1.0 - share) * held_roll
        m.hold_lean[1] = share * (m.hold_brake[1] + m.hold_wind_lean[1]) + (1.0 - share) * held_pitch
        if share == 0.0:
            m.hold_stage[0], m.hold_stage[1] = _HOLDING, _HOLDING
    if roll == 0.0 and pitch == 0.0:
        return
    for i in range(2):
        if (roll if i == 0 else pitch) != 0.0:
            _take_over(m, i, t)
        else:
            m.hold_stage[i] = _READY
            if holding:
                m.hold_brake[i] = 0.0


@kernel
def _rest(m: Any) -> None:
    """Follows the vehicle on the ground and during the pilot's take-off; the pilot leans it."""
    reset_loiter(m)
    m.hold_stage[0], m.hold_stage[1] = _BY_PILOT, _BY_PILOT
    m.hold_pilot[0], m.hold_pilot[1] = 0.0, 0.0


@kernel
def run_poshold(m: Any, t: float, dt: float) -> None:
    """Performs one step of POSHOLD."""
    use_pilot_limits(m)
    climb = pilot_climb_rate(m, t)
    if avoids(m):
        climb = slow_at_heights(m, climb, dt)
    if not is_flying(m, climb, t, dt):
        _rest(m)
        _forget_wind(m)
        return
    if m.touched:
        soften_for_landing(m, dt)
    most = math.radians(0.01 * m.ANGLE_MAX)
    roll, pitch = pilot_lean(m, most, m.lean_max, t)
    if m.pilot_takeoff:
        _rest(m)
    forward, right = _body(m, m.velocity_neu[0], m.velocity_neu[1])
    if m.hold_stage[0] != _HOLDING:
        m.hold_wind_lean[0], m.hold_wind_lean[1] = lean_for(m, m.hold_wind[0], m.hold_wind[1])
    held = m.hold_stage[0] == _SETTLING or m.hold_stage[0] == _HOLDING
    if not held:
        relax_ne(m, dt)
        _run_axis(m, 0, roll, right, t, dt)
        _run_axis(m, 1, pitch, -forward, t, dt)
        if m.hold_stage[0] == _READY and m.hold_stage[1] == _READY:
            m.hold_stage[0], m.hold_stage[1] = _SETTLING, _SETTLING
            m.hold_settling_since = t
            m.hold_wind_since = t
            reset_loiter(m)
            stop_ne(m)
            m.loiter_tilt[0], m.loiter_tilt[1] = 0.0, 0.0
            m.desired_position_neu[0], m.desired_position_neu[1] = m.position_neu[0], m.position_neu[1]
    else:
        _hold(m, roll, pitch, forward, right, t, dt)
    climb_by_stick(m, climb, dt)
    lean_to(m, clip(m.hold_lean[0], -most, most), clip(m.hold_lean[1], -most, most), wanted_yaw_rate(m, t, dt), dt)
