"""RTL: climbs, returns to home or the best rally point, waits, and descends, as in ArduCopter.

Places are whole 1e-7 degrees and heights whole centimetres, cut off, as ArduCopter keeps them: the climb is slightly
askew. It is planned in the step after that in which the mode begins, when the vehicle has flown on. Kernels over the
autopilot's record `m`; the descent is in `guided`, the choice of the destination in `rally`.

Source: ArduPilot, ArduCopter 4.6/4.7-dev: mode_rtl; Location.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import EARTH_RADIUS_ARDUPILOT
from cosim.kernel import kernel
from cosim_models.autopilot.control.position import stopping_ne
from cosim_models.autopilot.flight.guided import rest_on_ground, run_arrived, start_control, start_descent
from cosim_models.autopilot.flight.returning.return_height import return_height, return_source, whole_centimetres
from cosim_models.autopilot.flight.waypoints import add_leg, fly_leg, set_leg, start_legs
from cosim_models.autopilot.flight.yaw import default_nose, hold_heading, points_there, turn_as_armed
from cosim_models.autopilot.mission.rally import best_return
from cosim_models.autopilot.mission.terrain import NO_TERRAIN
from cosim_models.autopilot.record.modes import CLIMB, DESCEND, POSITION, RETURN, WAIT

__all__ = ["run_rtl", "start_rtl"]

_BEGIN = -2  # m.rtl_stage two steps before the climb
_STEP = math.radians(1e-7) * EARTH_RADIUS_ARDUPILOT  # m
_EXACT = 1e-6  # share of a unit by which whole numbers may be too small


@kernel
def _cut(value: float, unit: float) -> float:
    """Returns the whole multiple of `unit` towards zero."""
    count = value / unit
    return float(unit * math.trunc(count + math.copysign(_EXACT, count)))


@kernel
def _kept(m: Any, n: float, e: float) -> tuple[float, float]:
    """Returns the place as ArduCopter keeps it, in whole 1e-7 degrees from the origin."""
    return _cut(n, _STEP), _cut(e, _STEP * math.cos(m.origin_latitude + 0.5 * n / EARTH_RADIUS_ARDUPILOT))


@kernel
def start_rtl(m: Any) -> None:
    """Begins RTL at the stopping point."""
    start_control(m)
    hold_heading(m)
    m.submode = POSITION
    m.rtl_stage = _BEGIN
    if m.RTL_SPEED > 0.0:
        m.speed_max = 0.01 * m.RTL_SPEED
    start_legs(m)


@kernel
def _plan(m: Any) -> None:
    """Chooses the destination and begins the climb above the present stopping point."""
    n, e, height = best_return(m)
    n, e = _kept(m, n, e)
    m.rtl_place[0], m.rtl_place[1] = n, e
    source = return_source(m)
    up, above = return_height(m, n, e, height, source), source != NO_TERRAIN
    if not above:
        up += whole_centimetres(m.home_neu[2])
    here_n, here_e = stopping_ne(m)
    here_n, here_e = _kept(m, here_n, here_e)
    set_leg(m, here_n, here_e, up, above)
    add_leg(m, n, e, up, above)


@kernel
def run_rtl(m: Any, t: float, dt: float) -> None:
    """Performs one step of RTL."""
    if m.rtl_stage >= DESCEND:
        run_arrived(m, dt)
        return
    if not m.armed or m.on_ground:
        rest_on_ground(m, dt)
        return
    if m.rtl_stage < CLIMB:
        m.rtl_stage += 1
        if m.rtl_stage == CLIMB:
            _plan(m)
    fly_leg(m, dt)
    if m.rtl_stage == CLIMB:
        if m.leg_reached:
            m.rtl_stage = RETURN
            set_leg(m, m.rtl_place[0], m.rtl_place[1], m.guided_position_neu[2], m.above_terrain)
            default_nose(m)
    elif m.rtl_stage == RETURN:
        if m.leg_reached:
            m.rtl_stage = WAIT
            m.return_since = t
            turn_as_armed(m)
    elif m.rtl_stage == WAIT and t - m.return_since >= 0.001 * m.RTL_LOIT_TIME and points_there(m):
        start_descent(m)
