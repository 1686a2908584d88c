"""The fail-safe of missing terrain: RTL, or LAND, if the height of the terrain below is unknown while it is needed.

Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter events (failsafe_terrain_check, failsafe_terrain_on_event).
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.commander.actions import RETURNS, act
from cosim_models.autopilot.flight.returning.rtl import start_rtl
from cosim_models.autopilot.link.statustext import CRITICAL, NO_NUMBER, RTL_RESTARTS, TERRAIN_LOST, say
from cosim_models.autopilot.record.modes import AUTO, GUIDED, RTL

__all__ = ["watch_terrain"]

_LONG = 5.0  # s without the height, on legs


@kernel
def watch_terrain(m: Any, t: float) -> None:
    """Acts at once on a destination that cannot be flown to, and on legs after 5 s."""
    lost = m.terrain_missing
    m.terrain_missing = False
    if not m.terrain_on:
        m.terrain_gap = 0.0
    needed = m.mode == AUTO or m.mode == GUIDED or m.mode == RTL
    late = needed and m.terrain_gap > _LONG
    if not lost and late == m.terrain_failsafe:
        return
    m.terrain_failsafe = lost or late
    if not m.terrain_failsafe:
        return
    say(m, CRITICAL, TERRAIN_LOST, NO_NUMBER)
    if m.mode == RTL and not m.on_ground:
        say(m, CRITICAL, RTL_RESTARTS, NO_NUMBER)
        start_rtl(m)
    else:
        act(m, RETURNS, t)
