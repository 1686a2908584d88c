"""Actions of fail-safes, by the numbers that BATT_FS_LOW_ACT has.

Kernels over the autopilot's record `m`.

Source: ArduPilot, ArduCopter events (do_failsafe_action).
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.commander.mode_requests import start_landing_sequence
from cosim_models.autopilot.flight.modes import set_mode
from cosim_models.autopilot.flight.state import disarm, position_ready
from cosim_models.autopilot.link.statustext import (
    NO_NUMBER,
    NO_SMART_LANDS,
    NO_SMART_RETURNS,
    TRY_LAND,
    TRY_RTL,
    WARNING,
    say,
)
from cosim_models.autopilot.record.modes import BRAKE, LAND, RTL, SMART_RTL

__all__ = [
    "AT_ONCE",
    "BRAKES",
    "LANDS",
    "LANDS_AS_PLANNED",
    "NOTHING",
    "RETURNS",
    "RETURNS_BY_PATH",
    "RETURNS_BY_PATH_OR_LANDS",
    "act",
    "land_with_pause",
]

NOTHING, LANDS, RETURNS, RETURNS_BY_PATH, RETURNS_BY_PATH_OR_LANDS, AT_ONCE, LANDS_AS_PLANNED, BRAKES = range(8)
"""Actions; AT_ONCE disarms."""
_PAUSE = 4.0  # s before the descent


@kernel
def land_with_pause(m: Any, t: float) -> None:
    """Changes to LAND, which waits before it descends."""
    set_mode(m, LAND, t)
    m.land_pause = _PAUSE


@kernel
def _return_or_land(m: Any, t: float) -> None:
    if not position_ready(m, t) or not set_mode(m, RTL, t):
        land_with_pause(m, t)


@kernel
def _follow_path(m: Any, t: float) -> bool:
    """Changes to SMART_RTL; returns whether that is possible."""
    return bool(position_ready(m, t) and set_mode(m, SMART_RTL, t))


@kernel
def act(m: Any, action: int, t: float) -> None:
    """Performs an action; on the ground, any but NOTHING disarms."""
    if action == NOTHING:
        return
    if m.on_ground or action == AT_ONCE:
        disarm(m)
    elif action == LANDS:
        land_with_pause(m, t)
    elif action == RETURNS_BY_PATH:
        if not _follow_path(m, t):
            say(m, WARNING, NO_SMART_RETURNS, NO_NUMBER)
            _return_or_land(m, t)
    elif action == RETURNS_BY_PATH_OR_LANDS:
        if not _follow_path(m, t):
            say(m, WARNING, NO_SMART_LANDS, NO_NUMBER)
            land_with_pause(m, t)
    elif action == LANDS_AS_PLANNED:
        if not position_ready(m, t) or not start_landing_sequence(m, t):
            say(m, WARNING, TRY_RTL, NO_NUMBER)
            _return_or_land(m, t)
    elif action == BRAKES:
        if not position_ready(m, t) or not set_mode(m, BRAKE, t):
            say(m, WARNING, TRY_LAND, NO_NUMBER)
            land_with_pause(m, t)
    else:
        _return_or_land(m, t)
