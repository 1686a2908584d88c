"""SMART_RTL: back the way that it came, without its loops.

Three times a second, from arming on, the place is recorded if it is SRTL_ACCURACY from the last one. The path is
simplified as that of `Autopilot` (`flight.returning.breadcrumbs`). Without space for a point for 15 s, it is given up
for this drive, and SMART_RTL is refused. Kernels over a record that has `TRACK_PARAMETERS`, `TRACK_MEMORY` and what
`legs` needs.

Source: ArduPilot, Rover/mode_smart_rtl.cpp, AP_SmartRTL.
"""

from __future__ import annotations

from typing import Any

from cosim import Memory, Parameter
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_WARNING
from cosim_models.autopilot.flight.returning.breadcrumbs import clean_path, keep_point, take_point
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.targets import go_to
from cosim_models.autopilot.gcs.words import TRACK_FULL, say
from cosim_models.autopilot.surface.legs import drive_legs, set_leg, start_legs

__all__ = ["TRACK_MEMORY", "TRACK_PARAMETERS", "begin_track", "go_back", "record_track", "retrace"]

_POINTS = 500
_PERIOD = 1.0 / 3.0  # s
_PATIENCE = 15.0  # s
_SPARE = 10

TRACK_PARAMETERS = (
    real("SRTL_ACCURACY", "m", 2.0, "SMART_RTL: minimum distance between the points that are kept, 0: off"),
    Parameter(
        "SRTL_POINTS",
        type=int,
        start=300,
        minimum=0,
        maximum=_POINTS,
        tunable=True,
        description="SMART_RTL: number of points that are kept, 0: off",
    ),
)
TRACK_MEMORY = (
    Memory("crumb_next", rare=True),  # s, of the next record
    Memory("crumbs", shape=(_POINTS, 3), rare=True),  # m, north, east, up
    Memory("crumb_count", dtype="i4", rare=True),
    Memory("crumbs_on", dtype="?", rare=True),
    Memory("crumbs_simple", dtype="i4", rare=True),
    Memory("crumbs_checked", dtype="i4", rare=True),
    Memory("crumb_kept", dtype="u1", shape=_POINTS, rare=True),
    Memory("crumb_todo", dtype="i4", shape=(_POINTS, 2), rare=True),
    Memory("crumb_middle", shape=3, rare=True),
    Memory("crumb_stored", rare=True),  # s
)


@kernel
def begin_track(m: Any, t: float) -> None:
    """Begins a path at the present place."""
    m.crumb_count, m.crumbs_simple, m.crumbs_checked = 0, 0, 0
    m.crumb_stored, m.crumb_next = t, t + _PERIOD - 1e-9
    m.crumbs_on = m.SRTL_POINTS > 0 and m.SRTL_ACCURACY > 0.0
    if m.crumbs_on:
        keep_point(m, m.position[0], m.position[1], -m.position[2])


@kernel
def record_track(m: Any, t: float) -> None:
    """Records the path; required from `crumb_next` on, while it is armed and not on its way back."""
    m.crumb_next = t + _PERIOD - 1e-9
    if not m.crumbs_on:
        return
    if keep_point(m, m.position[0], m.position[1], -m.position[2]):
        m.crumb_stored = t
    elif t - m.crumb_stored > _PATIENCE:
        m.crumbs_on = False
        say(m, MAV_SEVERITY_WARNING, TRACK_FULL, 0)
        return
    if min(int(m.SRTL_POINTS), _POINTS) - m.crumb_count <= _SPARE:
        clean_path(m)


@kernel
def _aim(m: Any) -> None:
    """Makes the last point of the path the target."""
    n, e, _ = take_point(m)
    go_to(m, n, e, m.position[2])
    m.arrived = False
    row = m.crumb_count - 1
    if row < 0:
        set_leg(m, n, e, (n, e), False)
    else:
        set_leg(m, n, e, (m.crumbs[row, 0], m.crumbs[row, 1]), True)


@kernel
def go_back(m: Any) -> bool:
    """Begins the way back; returns False if no path is known."""
    if not m.crumbs_on or m.crumb_count == 0:
        return False
    clean_path(m)
    start_legs(m)
    _aim(m)
    return True


@kernel
def retrace(m: Any, h: float) -> bool:
    """Drives towards the next point; returns True where the last one is the target, which is left to the caller."""
    if m.crumb_count == 0:
        return True
    if drive_legs(m, h):
        _aim(m)
    return False
