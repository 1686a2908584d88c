"""Legs of the missions of planes and quadplanes: where a waypoint counts as reached, and what is told then.

It is reached at WP_RADIUS, or the distance that the L1 control of ArduPlane looks ahead if that is less; where the turn
to the next item is less than 90 degrees, at less in proportion. Beyond the waypoint, the leg is over, too. Kernels over
a record with `LEG_MEMORY` and what `wing.flight` needs.

Source: ArduPilot, ArduPlane/commands_logic.cpp (verify_nav_wp), navigation.cpp (setup_turn_angle), AP_L1_Control.cpp
(turn_distance).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import wrap_pi
from cosim.kernel import kernel
from cosim.messages import MAV_CMD_DO_LAND_START, MAV_CMD_NAV_WAYPOINT, MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.missions import COMMAND, LATITUDE, LONGITUDE, item_place
from cosim_models.autopilot.gcs.words import PASSED, REACHED_DISTANCE, say_figures
from cosim_models.autopilot.wing.circling import look_ahead

__all__ = ["LEG_MEMORY", "begin_leg", "ends_leg"]

_RIGHT_ANGLE = 0.5 * math.pi

LEG_MEMORY = (Memory("leg", rare=True),)  # rad, its direction


@kernel
def begin_leg(m: Any, row: int, n: float, e: float, t: float) -> None:
    """Notes the direction of the leg to an item's place; required once.

    It leads from the waypoint before, or, if there is none and beyond the item's place, from here.
    """
    m.item_since = t
    dn, de = n - m.position[0], e - m.position[1]
    m.leg = math.atan2(de, dn)
    if row > 1 and int(m.mission[row - 1, COMMAND]) == MAV_CMD_NAV_WAYPOINT:
        a, b, _ = item_place(m, row - 1)
        if dn * (n - a) + de * (e - b) > 0.0:
            m.leg = math.atan2(e - b, n - a)


@kernel
def _turn(m: Any, row: int, n: float, e: float) -> float:
    """Returns the angle [rad] from the leg to the one behind it, which is a right angle where that is not known."""
    row += 1
    while row < m.mission_count and int(m.mission[row, COMMAND]) == MAV_CMD_DO_LAND_START:
        row += 1
    if row >= m.mission_count or (m.mission[row, LATITUDE] == 0.0 and m.mission[row, LONGITUDE] == 0.0):
        return _RIGHT_ANGLE
    after_n, after_e, _ = item_place(m, row)
    return abs(wrap_pi(math.atan2(after_e - e, after_n - n) - m.leg))


@kernel
def ends_leg(m: Any, row: int, n: float, e: float) -> bool:
    """Returns whether the leg to an item's place is over, and says so."""
    dn, de = n - m.position[0], e - m.position[1]
    distance = math.sqrt(dn * dn + de * de)
    passed = dn * math.cos(m.leg) + de * math.sin(m.leg) <= 0.0
    if distance >= m.WP_RADIUS and not passed:
        return False
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    near = min(float(m.WP_RADIUS), look_ahead(m) * speed) * min(_turn(m, row, n, e) / _RIGHT_ANGLE, 1.0)
    if distance > near and not passed:
        return False
    text = REACHED_DISTANCE if distance <= near else PASSED
    say_figures(m, MAV_SEVERITY_INFO, text, (float(row), math.floor(distance) * 1.0, 0.0, 0.0))
    return True
