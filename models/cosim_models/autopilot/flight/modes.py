"""Flight mode selection: changing modes, and one step of the current mode.

Kernels over the autopilot's record `m`. The modes are in `guided`, `manual`, `auto`, and the packages `acrobatics`,
`assisted`, `returning` and `tuning`; `commander.mode_requests` reports refused mode changes to ground stations.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: mode.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.motors import SHUT_DOWN
from cosim_models.autopilot.control.position import initialise_up
from cosim_models.autopilot.flight.acrobatics.acro import run_acro
from cosim_models.autopilot.flight.acrobatics.flip import flip_is_possible, run_flip, start_flip
from cosim_models.autopilot.flight.acrobatics.throw import run_throw, start_throw
from cosim_models.autopilot.flight.angles import guide_angle, level_out, run_angle
from cosim_models.autopilot.flight.assisted.drift import run_drift, start_drift
from cosim_models.autopilot.flight.assisted.poshold import run_poshold, start_poshold
from cosim_models.autopilot.flight.assisted.zigzag import run_zigzag, start_zigzag
from cosim_models.autopilot.flight.guided import (
    guide_stop,
    rest_on_ground,
    run_guided,
    run_land,
    start_brake,
    start_land,
)
from cosim_models.autopilot.flight.manual import (
    run_alt_hold,
    run_circle,
    run_loiter,
    run_stabilize,
    start_alt_hold,
    start_circle,
    start_loiter,
)
from cosim_models.autopilot.flight.returning.rtl import run_rtl, start_rtl
from cosim_models.autopilot.flight.returning.smart_rtl import leave_smart_rtl, run_smart_rtl, start_smart_rtl
from cosim_models.autopilot.flight.state import needs_position, position_ready
from cosim_models.autopilot.flight.terrain_following import leave_surface
from cosim_models.autopilot.flight.tuning.autotune import (
    leave_autotune,
    run_autotune,
    start_autotune,
    tune_is_possible,
)
from cosim_models.autopilot.link.statustext import INFO, NO_NUMBER, RECOVERY, say
from cosim_models.autopilot.mission.missions import forget_jumps
from cosim_models.autopilot.record.modes import (
    ACRO,
    ALT_HOLD,
    AUTO,
    AUTOTUNE,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    DRIFT,
    FLIP,
    GUIDED,
    GUIDED_NOGPS,
    LAND,
    LOITER,
    POSHOLD,
    RTL,
    SMART_RTL,
    STABILIZE,
    THROW,
    ZIGZAG,
)

__all__ = ["can_begin", "run_mode", "set_mode"]

_ARMING_DELAY = 2.0  # s between arming and the motors
_RECOVERY = 10.0  # s after a change of mode beyond a fence in which breaches are not looked at


@kernel
def can_begin(m: Any, mode: int, t: float) -> bool:
    """Returns whether the conditions of FLIP, AUTOTUNE, THROW and SMART_RTL are met, if the mode is one of these.

    Disarmed, THROW can always be entered; SMART_RTL needs a path.
    """
    if mode == FLIP:
        return flip_is_possible(m, t)
    if mode == AUTOTUNE:
        return tune_is_possible(m, t)
    if mode == SMART_RTL:
        return bool(m.crumbs_on)
    return bool(mode != THROW or not m.armed)


@kernel
def set_mode(m: Any, mode: int, t: float) -> bool:
    """Changes the mode; returns False if it cannot begin, or if armed and it needs a missing position.

    The mode must be one of `Mode`. The caller must check that there is a mission for AUTO.
    """
    if mode == m.mode:
        return True
    if m.armed and needs_position(mode) and not position_ready(m, t):
        return False
    if not can_begin(m, mode, t):
        return False
    if m.fence_breach != 0:
        m.fence_recovery = t + _RECOVERY
        say(m, INFO, RECOVERY, NO_NUMBER)
    previous = int(m.mode)
    if previous == SMART_RTL:
        leave_smart_rtl(m)
    elif previous == AUTOTUNE:
        leave_autotune(m)
    leave_surface(m)
    m.mode = mode
    m.auto_rtl = False
    m.legs_active = False
    m.pilot_takeoff = False
    if mode in (GUIDED, AVOID_ADSB):
        guide_stop(m, t)
    elif mode == GUIDED_NOGPS:
        initialise_up(m)
        level_out(m)
        guide_angle(m, False, t)
    elif mode == BRAKE:
        start_brake(m, t)
    elif mode == ALT_HOLD:
        start_alt_hold(m)
    elif mode == AUTO:
        guide_stop(m, t)
        if m.mission_complete or m.mission_current == 0 or m.MIS_RESTART == 1:
            m.mission_current = 1
            forget_jumps(m)
        for i in range(3):
            m.auto_speed[i] = 0.0
        m.mission_complete = False
        m.mission_changed = True
        m.mission_replaced = False
        m.auto_landing = False
    elif mode == LOITER:
        start_loiter(m)
    elif mode == CIRCLE:
        start_circle(m)
    elif mode == LAND:
        m.land_blind = not position_ready(m, t)
        start_land(m)
    elif mode == RTL:
        start_rtl(m)
    else:
        _start_rarer(m, mode, previous, t)
    if mode != STABILIZE and not m.on_ground:
        m.auto_armed = True
    return True


@kernel
def _start_rarer(m: Any, mode: int, previous: int, t: float) -> None:
    """Begins one of the modes that are flown less often."""
    if mode == POSHOLD:
        start_poshold(m)
    elif mode == ZIGZAG:
        start_zigzag(m)
    elif mode == DRIFT:
        start_drift(m)
    elif mode == FLIP:
        start_flip(m, previous, t)
    elif mode == THROW:
        start_throw(m, t)
    elif mode == SMART_RTL:
        start_smart_rtl(m, t)
    elif mode == AUTOTUNE:
        start_autotune(m, previous, t)


@kernel
def run_mode(m: Any, t: float, dt: float) -> None:
    """Performs one step of the current mode, except AUTO, which runs earlier (`auto`)."""
    if m.arming_delay and (not m.armed or m.mode == THROW or t - m.armed_at >= _ARMING_DELAY - 1e-9):
        m.arming_delay = False
    if m.mode == GUIDED or m.mode == BRAKE:
        run_guided(m, t, dt)
    elif m.mode == ALT_HOLD:
        run_alt_hold(m, t, dt)
    elif m.mode == LOITER:
        run_loiter(m, t, dt)
    elif m.mode == CIRCLE:
        run_circle(m, t, dt)
    elif m.mode == LAND:
        run_land(m, dt)
    elif m.mode == RTL:
        run_rtl(m, t, dt)
    elif m.mode == STABILIZE:
        run_stabilize(m, t, dt)
    elif m.mode == AVOID_ADSB:
        run_guided(m, t, dt)
    elif m.mode == GUIDED_NOGPS:
        if not run_angle(m, t, dt):
            rest_on_ground(m, dt)
    elif m.mode != AUTO:
        _run_rarer(m, t, dt)
    if not m.armed:
        m.spool_wanted = SHUT_DOWN


@kernel
def _run_rarer(m: Any, t: float, dt: float) -> None:
    """Performs one step of one of the modes that are flown less often."""
    follows = -1
    if m.mode == POSHOLD:
        run_poshold(m, t, dt)
    elif m.mode == ACRO:
        run_acro(m, t, dt)
    elif m.mode == DRIFT:
        run_drift(m, t, dt)
    elif m.mode == ZIGZAG:
        run_zigzag(m, t, dt)
    elif m.mode == SMART_RTL:
        run_smart_rtl(m, dt)
    elif m.mode == FLIP:
        follows = run_flip(m, t, dt)
    elif m.mode == THROW:
        follows = run_throw(m, t, dt)
    elif m.mode == AUTOTUNE:
        run_autotune(m, t, dt)
    if follows >= 0 and not set_mode(m, follows, t) and m.mode == FLIP:
        set_mode(m, STABILIZE, t)
