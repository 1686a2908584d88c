"""Flight mode selection: changing modes, and one step of the current mode.

Kernels over the autopilot's record `m`. The modes are in `guided`, `manual` and `auto`; `commander.mode_requests`
reports refused mode changes to ground stations.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: mode.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.motors import SHUT_DOWN
from cosim_models.autopilot.control.position import initialise_up
from cosim_models.autopilot.flight.angles import guide_angle, level_out, run_angle
from cosim_models.autopilot.flight.guided import (
    guide_stop,
    rest_on_ground,
    run_guided,
    run_land,
    run_rtl,
    start_land,
    start_rtl,
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
from cosim_models.autopilot.flight.state import needs_position, position_ready
from cosim_models.autopilot.flight.yaw import hold_heading
from cosim_models.autopilot.mission.missions import forget_jumps
from cosim_models.autopilot.record.modes import (
    ALT_HOLD,
    AUTO,
    AVOID_ADSB,
    BRAKE,
    CIRCLE,
    GUIDED,
    GUIDED_NOGPS,
    LAND,
    LOITER,
    RTL,
    STABILIZE,
)

__all__ = ["run_mode", "set_mode"]

_ARMING_DELAY = 2.0  # s between arming and the motors


@kernel
def set_mode(m: Any, mode: int, t: float) -> bool:
    """Changes the mode; returns False if armed and the mode needs a missing position. The mode must be one of `Mode`.

    The caller must check that there is a mission for AUTO.
    """
    if mode == m.mode:
        return True
    if m.armed and needs_position(mode) and not position_ready(m, t):
        return False
    m.mode = mode
    m.pilot_takeoff = False
    if mode in (GUIDED, AVOID_ADSB):
        guide_stop(m, t)
    elif mode == GUIDED_NOGPS:
        initialise_up(m)
        level_out(m)
        guide_angle(m, False, t)
    elif mode == BRAKE:
        guide_stop(m, t)
        hold_heading(m)
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
        start_loiter(m, t)
    elif mode == CIRCLE:
        start_circle(m)
    elif mode == LAND:
        start_land(m)
    elif mode == RTL:
        start_rtl(m)
    if mode != STABILIZE and not m.on_ground:
        m.auto_armed = True
    return True


@kernel
def run_mode(m: Any, t: float, dt: float) -> None:
    """Performs one step of the current mode, except AUTO, which runs earlier (`auto`)."""
    if m.arming_delay and (not m.armed or t - m.armed_at >= _ARMING_DELAY - 1e-9):
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
    elif m.mode == GUIDED_NOGPS and not run_angle(m, t, dt):
        rest_on_ground(m, dt)
    if not m.armed:
        m.spool_wanted = SHUT_DOWN
