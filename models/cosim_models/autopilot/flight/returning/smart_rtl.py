"""SMART_RTL: returns along the flown path, 2 m higher at its beginning, and lands (or descends to RTL_ALT_FINAL).

The path is that of `breadcrumbs`. A point that has not been reached when the mode ends goes back to the path. Kernels
over the autopilot's record `m`.

Source: ArduPilot, ArduCopter 4.6: mode_smart_rtl.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.flight.guided import (
    guide_stop,
    rest_on_ground,
    run_arrived,
    start_descent,
)
from cosim_models.autopilot.flight.returning.breadcrumbs import clean_path, keep_point, take_point
from cosim_models.autopilot.flight.waypoints import add_leg, fly_leg, set_leg, start_legs
from cosim_models.autopilot.flight.yaw import default_nose
from cosim_models.autopilot.record.modes import CLIMB, DESCEND, POSITION, RETURN, WAIT

__all__ = ["leave_smart_rtl", "run_smart_rtl", "start_smart_rtl"]

_HIGHER = 2.0  # m above the first point at which the descent begins


@kernel
def start_smart_rtl(m: Any, t: float) -> None:
    """Stops, and prepares the path; there must be one."""
    guide_stop(m, t)
    m.submode = POSITION
    default_nose(m)
    m.rtl_stage = CLIMB
    m.crumb_taken = False
    if m.RTL_SPEED > 0.0:
        m.speed_max = 0.01 * m.RTL_SPEED
    start_legs(m)


@kernel
def leave_smart_rtl(m: Any) -> None:
    """Gives a point that has not been reached back to the path."""
    if m.rtl_stage == RETURN and m.crumb_taken:
        p = m.crumb_place
        keep_point(m, p[0], p[1], p[2])
    m.crumb_taken = False


@kernel
def _go_on(m: Any) -> None:
    """Takes the next point of the path, or begins to land at its end."""
    m.crumb_taken = False
    if m.crumb_count == 0:
        m.rtl_stage = WAIT
        return
    n, e, u = take_point(m)
    m.crumb_place[0], m.crumb_place[1], m.crumb_place[2] = n, e, u
    m.crumb_taken = True
    if m.crumb_count == 0:
        m.crumb_taken = False
        m.rtl_stage = WAIT
        u += _HIGHER
    set_leg(m, n, e, u, False)
    if m.crumb_count > 0:
        then = m.crumbs[m.crumb_count - 1]
        add_leg(m, then[0], then[1], then[2] + (_HIGHER if m.crumb_count == 1 else 0.0), False)


@kernel
def run_smart_rtl(m: Any, dt: float) -> None:
    """Performs one step of SMART_RTL."""
    if m.rtl_stage >= DESCEND:
        run_arrived(m, dt)
        return
    if not m.armed or not m.auto_armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    fly_leg(m, dt)
    if m.rtl_stage == CLIMB:
        clean_path(m)
        m.rtl_stage = RETURN
        _go_on(m)
    elif m.rtl_stage == RETURN and m.leg_reached:
        _go_on(m)
    elif m.rtl_stage == WAIT and m.leg_reached:
        start_descent(m)
