"""ZIGZAG: flown as LOITER until two places A and B are stored; then the vehicle can be sent to their lines.

A switch (auxiliary function 61, low for A, high for B) stores the current position; once both are stored, it sends the
vehicle along A-B to the line through A or B that is perpendicular to A-B. The middle position, or the arrival, returns
control to the pilot, who keeps the heading in any case. Kernels over the autopilot's record `m`; index 0 is A, 1 is B.

Source: ArduPilot, ArduCopter 4.7-dev: mode_zigzag. Not here: ZIGZ_AUTO_ENABLE.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.attitude import follow_yaw_rate
from cosim_models.autopilot.control.motors import THROTTLE_UNLIMITED
from cosim_models.autopilot.control.position import GRAVITY, control_ne, control_up
from cosim_models.autopilot.flight.guided import standard_limits
from cosim_models.autopilot.flight.manual import prepare_loiter, run_loiter, start_loiter, wanted_yaw_rate
from cosim_models.autopilot.flight.waypoints import advance_legs, set_leg, start_legs
from cosim_models.autopilot.link.statustext import (
    INFO,
    NO_NUMBER,
    ZIGZAG_MANUAL,
    ZIGZAG_MOVING_A,
    ZIGZAG_MOVING_B,
    ZIGZAG_STORED_A,
    ZIGZAG_STORED_B,
    say,
)

__all__ = ["return_to_pilot", "run_zigzag", "start_zigzag", "store_or_go"]

_NEAR = 3.0  # m


@kernel
def start_zigzag(m: Any) -> None:
    """Begins without stored places."""
    start_loiter(m)
    m.zigzag_moving = False
    m.zigzag_stored[0], m.zigzag_stored[1] = 0, 0


@kernel
def _has_both(m: Any) -> bool:
    n, e = m.zigzag_places[1, 0] - m.zigzag_places[0, 0], m.zigzag_places[1, 1] - m.zigzag_places[0, 1]
    return bool(m.zigzag_stored[0] + m.zigzag_stored[1] == 2 and (n != 0.0 or e != 0.0))


@kernel
def store_or_go(m: Any, which: int) -> None:
    """Stores the position as A (0) or B (1), or flies to the line through A or B if both are stored."""
    places, p = m.zigzag_places, m.desired_position_neu
    if not _has_both(m):
        places[which, 0], places[which, 1] = p[0], p[1]
        m.zigzag_stored[which] = 1
        say(m, INFO, ZIGZAG_STORED_A if which == 0 else ZIGZAG_STORED_B, NO_NUMBER)
        return
    n, e = places[1, 0] - places[0, 0], places[1, 1] - places[0, 1]
    length = math.sqrt(n * n + e * e)
    n, e = n / length, e / length
    along = (places[which, 0] - p[0]) * n + (places[which, 1] - p[1]) * e
    up = m.guided_position_neu[2] if m.zigzag_moving else p[2]
    to_n, to_e = p[0] + along * n, p[1] + along * e
    standard_limits(m)
    start_legs(m)
    set_leg(m, to_n, to_e, up, False)
    m.zigzag_moving = True
    say(m, INFO, ZIGZAG_MOVING_A if which == 0 else ZIGZAG_MOVING_B, NO_NUMBER)


@kernel
def return_to_pilot(m: Any, stays: bool) -> None:
    """Returns control to the pilot; `stays`: the destination is held, else the current position."""
    if not m.zigzag_moving:
        return
    m.zigzag_moving = False
    if stays:
        prepare_loiter(m)
        m.loiter_brake = 0.0
        for i in range(2):
            m.loiter_tilt[i] = 0.0
            m.loiter_tilt_rate[i] = 0.0
            m.desired_position_neu[i] = m.guided_position_neu[i]
            m.desired_velocity_neu[i] = 0.0
            m.desired_acceleration_neu[i] = 0.0
    else:
        start_loiter(m)
    say(m, INFO, ZIGZAG_MANUAL, NO_NUMBER)


@kernel
def run_zigzag(m: Any, t: float, dt: float) -> None:
    """Performs one step of ZIGZAG."""
    if m.zigzag_moving and (not m.armed or m.on_ground):
        return_to_pilot(m, False)
    if not m.zigzag_moving:
        run_loiter(m, t, dt)
        return
    m.spool_wanted = THROTTLE_UNLIMITED
    g, p = m.guided_position_neu, m.position_neu
    advance_legs(m, dt)
    control_ne(m, dt)
    control_up(m, dt)
    a = m.target_acceleration_neu
    follow_yaw_rate(m, a[0], a[1], -GRAVITY, wanted_yaw_rate(m, t, dt), dt)
    if m.leg_reached and math.sqrt((g[0] - p[0]) ** 2 + (g[1] - p[1]) ** 2) <= _NEAR:
        return_to_pilot(m, True)
