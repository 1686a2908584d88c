"""AUTOTUNE: finds the gains of roll, pitch and yaw by twitches, and flies with the old or the new ones.

Entered in flight from STABILIZE, ALT_HOLD, LOITER or POSHOLD with the throttle open; from the last two, it leans up to
10 degrees back towards its place. The vehicle levels before each twitch (`twitch`), and the gains change after it
(`rules`). The sticks interrupt it: the pilot flies with the gains before the tune until half a second after they have
been centred. When the mode is entered again after the end, the pilot flies with the new gains. Disarming in the mode
saves them; otherwise they are lost. Kernels over the autopilot's record `m`.

Source: ArduPilot, AC_AutoTune, AC_AutoTune_Multi and ArduCopter 4.7-dev: mode_autotune.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import euler_from_quaternion, yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import face, lean_to
from cosim_models.autopilot.control.motors import GROUND_IDLE, THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import relax_ne
from cosim_models.autopilot.control.shaping import clip, wrap_pi
from cosim_models.autopilot.flight.avoidance import avoids, slow_at_heights
from cosim_models.autopilot.flight.guided import rest_on_ground
from cosim_models.autopilot.flight.manual import climb_by_stick, start_alt_hold, use_pilot_limits, wanted_yaw_rate
from cosim_models.autopilot.flight.state import disarm, position_ready
from cosim_models.autopilot.flight.sticks import pilot_climb_rate, pilot_lean, pilot_yaw_rate, throttle_zero
from cosim_models.autopilot.flight.tuning.gains import (
    ACCEL,
    ANGLE,
    BEFORE,
    BETWEEN,
    FOUND,
    PITCH,
    ROLL,
    TRIED,
    YAW,
    YAW_D,
    D,
    P,
    integral_found,
    is_tuned,
    load_gains,
    remember_gains,
    row_of,
    save_found,
)
from cosim_models.autopilot.flight.tuning.rules import FAILED, KINDS, SUCCESSES, change_gains, ease_found
from cosim_models.autopilot.flight.tuning.twitch import (
    ABORTING,
    LEVELLING,
    TWITCHING,
    begin_twitch,
    note_twitch,
    run_twitch,
)
from cosim_models.autopilot.link.statustext import (
    CRITICAL,
    INFO,
    NO_NUMBER,
    NOTICE,
    TUNE_ANGLES,
    TUNE_COMPLETE,
    TUNE_INCOMPLETE,
    TUNE_OVERRIDDEN,
    TUNE_PROGRESS,
    TUNE_RATES,
    TUNE_RESTORED,
    TUNE_SAVED,
    TUNE_STARTED,
    TUNE_STOPPED,
    TUNE_SUCCESS,
    TUNE_TESTING,
    TUNE_TESTING_END,
    TUNE_UNLEVEL,
    say,
    say_all,
    say_rest,
)
from cosim_models.autopilot.record.modes import ALT_HOLD, LOITER, POSHOLD, STABILIZE

__all__ = ["leave_autotune", "run_autotune", "settle_tune", "start_autotune", "select_gains", "tune_is_possible"]

_NONE, _TUNING, _FINISHED, _TESTING = 0, 1, 2, 4  # stages, besides FAILED
_LEVEL_ANGLE = math.radians(2.5)
_LEVEL_RATE, _LEVEL_YAW_RATE = math.radians(5.0), math.radians(7.5)
_LEVEL_TIME = 0.25  # s level before a twitch
_LEVEL_PATIENCE = 2.0  # s until the limits of levelling are those above; they grow to twice as much
_PATIENCES = 3.0  # after which the tune fails
_OVERRIDE_TIME = 0.5  # s with centred sticks until the tune goes on
_WARN_EVERY, _ANNOUNCE_EVERY = 1.0, 2.0  # s
_LEAN_MAX, _FAR = math.radians(10.0), 20.0  # lean back to the place, from this distance [m] on
_NEAR, _TURNS_FROM = 0.1, 5.0  # m: leans from the first, turns across the wind from the second
_TURN_SLACK = math.radians(95.0)
_LOW, _HIGH = 0, 2


# ---- entering and leaving ------------------------------------------------------------------------------------------


@kernel
def tune_is_possible(m: Any, t: float) -> bool:
    """Returns whether AUTOTUNE can be entered: in the air, from a mode that allows it, with the throttle open."""
    if m.mode not in (STABILIZE, ALT_HOLD, LOITER, POSHOLD) or throttle_zero(m, t):
        return False
    return bool(m.armed and m.auto_armed and not m.on_ground)


@kernel
def start_autotune(m: Any, previous: int, t: float) -> None:
    """Begins a tune, goes on with one, or flies with the gains of a finished one."""
    start_alt_hold(m)
    m.tune_holds = previous in (LOITER, POSHOLD)
    m.tune_placed = False
    if m.tune_stage in (_FINISHED, _TESTING):
        m.tune_stage = _TESTING
        _say_axes(m, TUNE_TESTING)
        return
    if m.tune_stage != _TUNING:
        _begin(m)
    _level(m, t)
    say(m, INFO, TUNE_STARTED, NO_NUMBER)


@kernel
def _begin(m: Any) -> None:
    """Begins a tune with the first axis."""
    m.tune_stage = _TUNING
    m.tune_axis = _next_axis(m, -1)
    m.tune_completed = 0
    m.tune_kind = 0
    m.tune_right = False
    m.tune_scale = 1.0
    m.AUTOTUNE_AGGR = clip(m.AUTOTUNE_AGGR, 0.05, 0.2)
    m.tune_lean[2] = _heading(m)
    remember_gains(m)


@kernel
def _next_axis(m: Any, last: int) -> int:
    """Returns the first axis in AUTOTUNE_AXES after `last`; beyond YAW_D without one, but ROLL if there is none."""
    axis = last + 1
    while axis <= YAW_D and not is_tuned(m, axis):
        axis += 1
    return ROLL if last < 0 and axis > YAW_D else axis


@kernel
def leave_autotune(m: Any) -> None:
    """Flies with the gains before the tune; its state stays until the vehicle disarms."""
    load_gains(m, BEFORE)
    say(m, INFO, TUNE_STOPPED, NO_NUMBER)


@kernel
def settle_tune(m: Any, in_mode: bool) -> None:
    """Saves the gains that were found or forgets them, when the vehicle has disarmed.

    Saved are those of an AUTOTUNE that the vehicle is in, or after the use of the switch, those that it selects.
    """
    if m.tune_stage == _NONE:
        return
    if in_mode if not m.tune_tested else m.tune_gains == FOUND:
        if m.tune_completed == 0:
            return
        save_found(m)
        _say_axes(m, TUNE_SAVED)
    m.tune_stage = _NONE
    m.tune_completed = 0
    m.tune_tested = False


@kernel
def select_gains(m: Any, position: int) -> None:
    """Handles the switch of the gains of a finished tune: 0 (low) selects those before it, 2 (high) the new ones."""
    if m.tune_stage != _FINISHED:
        if position == _HIGH:
            say(m, NOTICE, TUNE_INCOMPLETE, NO_NUMBER)
        return
    if position == _LOW:
        load_gains(m, BEFORE)
        say(m, NOTICE, TUNE_RESTORED, NO_NUMBER)
    elif position == _HIGH:
        load_gains(m, FOUND)
        _say_axes(m, TUNE_TESTING)
    m.tune_tested = True


@kernel
def _say_axes(m: Any, text: int) -> None:
    """Says one of the texts that name the completed axes."""
    say(m, NOTICE, text + m.tune_completed, NO_NUMBER)
    if text == TUNE_TESTING:
        say_rest(m, NOTICE, TUNE_TESTING_END + m.tune_completed)


# ---- flight --------------------------------------------------------------------------------------------------------


@kernel
def _heading(m: Any) -> float:
    return yaw_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))


@kernel
def run_autotune(m: Any, t: float, dt: float) -> None:
    """Performs one step of AUTOTUNE; on the ground, the vehicle disarms."""
    use_pilot_limits(m)
    if m.armed and m.on_ground and m.spool_state == GROUND_IDLE:
        disarm(m)
    if not m.armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    climb = pilot_climb_rate(m, t)
    if avoids(m):
        climb = slow_at_heights(m, climb, dt)
    climb_by_stick(m, climb, dt)
    relax_ne(m, dt)
    roll, pitch = pilot_lean(m, math.radians(0.01 * m.ANGLE_MAX), m.lean_max, t)
    centred = roll == 0.0 and pitch == 0.0
    m.tune_lean[0], m.tune_lean[1] = roll, pitch
    if centred:
        _return_to_place(m, t)
    if m.tune_stage != _TUNING:
        load_gains(m, FOUND if m.tune_stage == _TESTING else BEFORE)
    else:
        _hear_pilot(m, centred, pilot_yaw_rate(m, t) != 0.0 or climb != 0.0, t)
        if not m.tune_overridden:
            _tune(m, t, dt)
            return
    lean_to(m, m.tune_lean[0], m.tune_lean[1], wanted_yaw_rate(m, t, dt), dt)


@kernel
def _hear_pilot(m: Any, centred: bool, moved: bool, t: float) -> None:
    """Interrupts the tune while roll and pitch are not `centred`, or the other sticks are `moved`."""
    if not centred or moved:
        m.tune_overridden = True
        m.tune_overridden_at = t
        if not centred:
            m.tune_placed = False
    elif m.tune_overridden and t - m.tune_overridden_at > _OVERRIDE_TIME + 1e-9:
        m.tune_overridden = False
        _level(m, t)
        m.tune_lean[2] = _heading(m)
    if m.tune_overridden:
        if t - m.tune_warned_at > _WARN_EVERY:
            say(m, INFO, TUNE_OVERRIDDEN, NO_NUMBER)
            m.tune_warned_at = t
        load_gains(m, BEFORE)


@kernel
def _return_to_place(m: Any, t: float) -> None:
    """Sets the lean back to the place where the sticks were centred, and far from it the heading across the wind."""
    if not m.tune_holds or not position_ready(m, t):
        return
    if not m.tune_placed:
        m.tune_placed = True
        m.tune_place[0], m.tune_place[1] = m.position_neu[0], m.position_neu[1]
    n, e = m.position_neu[0] - m.tune_place[0], m.position_neu[1] - m.tune_place[1]
    distance = math.sqrt(n * n + e * e)
    if distance < _NEAR:
        return
    lean = min(_LEAN_MAX * distance / _FAR, _LEAN_MAX) / distance
    heading = _heading(m)
    c, s = math.cos(heading), math.sin(heading)
    m.tune_lean[1] = lean * (n * c + e * s)
    m.tune_lean[0] = lean * (n * s - e * c)
    if distance < _TURNS_FROM:
        return
    wanted = math.atan2(e, n) + (math.radians(90.0) if m.tune_axis == PITCH else 0.0)
    if abs(m.tune_lean[2] - wanted) > _TURN_SLACK:
        wanted += math.pi
    m.tune_lean[2] = wanted


# ---- the tune ------------------------------------------------------------------------------------------------------


@kernel
def _level(m: Any, t: float) -> None:
    """Begins to level for the next twitch."""
    m.tune_step = LEVELLING
    m.tuning[0] = 0.0
    m.tune_since = t
    m.tune_levelling_since = t


@kernel
def _is_level(m: Any, t: float) -> bool:
    """Returns whether angles and rates are small enough for a twitch; after 6 s of levelling, the tune fails.

    As in ArduCopter, only positive rates count.
    """
    waited = t - m.tune_levelling_since
    if waited > _PATIENCES * _LEVEL_PATIENCE:
        say(m, CRITICAL, TUNE_UNLEVEL, NO_NUMBER)
        m.tune_stage = FAILED
    share = clip(waited / _LEVEL_PATIENCE, 0.0, 2.0)
    phi, theta, psi = euler_from_quaternion((m.q[0], m.q[1], m.q[2], m.q[3]))
    angle = max(abs(phi - m.tune_lean[0]), abs(theta - m.tune_lean[1]), abs(wrap_pi(psi - m.tune_lean[2])))
    if angle > share * _LEVEL_ANGLE or max(m.gyro[0], m.gyro[1]) > share * _LEVEL_RATE:
        return False
    return bool(m.gyro[2] <= share * _LEVEL_YAW_RATE)


@kernel
def _tune(m: Any, t: float, dt: float) -> None:
    """Performs one step of the tune, and tells how far it is."""
    if m.tune_step == LEVELLING:
        load_gains(m, BETWEEN)
        face(m, m.tune_lean[0], m.tune_lean[1], m.tune_lean[2], dt)
        if not _is_level(m, t):
            m.tune_since = t
        elif t - m.tune_since > _LEVEL_TIME:
            m.tune_step = TWITCHING
            m.tune_since = t
            load_gains(m, TRIED)
            begin_twitch(m, dt)
    elif m.tune_step == TWITCHING:
        load_gains(m, TRIED)
        run_twitch(m, t, dt)
    else:
        if m.tune_step != ABORTING:
            note_twitch(m)
            change_gains(m)
            if m.tune_successes >= SUCCESSES:
                _go_on(m)
        face(m, m.tune_lean[0], m.tune_lean[1], m.tune_lean[2], dt)
        load_gains(m, BETWEEN)
        m.tune_right = not m.tune_right
        _level(m, t)
    if t - m.tune_announced_at >= _ANNOUNCE_EVERY - 1e-9:
        m.tune_announced_at = t
        percent = 100 // SUCCESSES * int(m.tune_successes)
        say(m, INFO, TUNE_PROGRESS + KINDS * m.tune_axis + m.tune_kind, percent)


@kernel
def _go_on(m: Any) -> None:
    """Goes on to the next kind of twitch, after the last one to the next axis."""
    ease_found(m)
    m.tune_successes = 0
    m.tune_scale = 1.0
    m.tune_kind += 1
    if m.tune_kind < KINDS:
        return
    m.tune_kind = 0
    axis = int(m.tune_axis)
    _report(m, axis)
    m.tune_completed |= 1 << axis
    following = _next_axis(m, axis)
    if following <= YAW_D:
        m.tune_axis = following
        return
    m.tune_stage = _FINISHED
    say(m, NOTICE, TUNE_SUCCESS, NO_NUMBER)


@kernel
def _decimals(value: float, scale: float) -> int:
    """Returns `value` times `scale` as ArduPilot prints it: rounded from 1 on, below nearly cut off."""
    half, rest = 0.5, value
    while 0.0 < rest < 1.0:
        rest *= 10.0
        half *= 0.1
    return int(scale * value + half)


@kernel
def _report(m: Any, axis: int) -> None:
    """Tells the gains of a completed axis."""
    row, found = row_of(axis), m.tune_found
    p = found[row, P]
    d = 0.0 if axis == YAW else found[row, D]
    say(m, NOTICE, TUNE_COMPLETE + axis, NO_NUMBER)
    say_all(
        m,
        NOTICE,
        TUNE_RATES + axis,
        _decimals(p, 1000.0),
        _decimals(p * integral_found(row), 1000.0),
        _decimals(d, 10000.0),
    )
    say_all(m, NOTICE, TUNE_ANGLES + axis, _decimals(found[row, ANGLE], 1000.0), int(found[row, ACCEL] + 0.5), 0)
