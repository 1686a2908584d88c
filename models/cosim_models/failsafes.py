"""What the autopilot does by itself when something is wrong: the ground station is silent, or a fence is crossed.

`watch` looks ten times a second. The ground station counts as lost when HEARTBEATs of SYSID_MYGCS that have been heard
stay away for FS_GCS_TIMEOUT; this is also how a lost link shows. Fences are a greatest and a least height and a circle,
all about home. Kernels over the autopilot's record `m`.

Not here: polygons, battery and estimator (the battery is full and the motion is true).

Source: ArduPilot, ArduCopter events (failsafe_gcs_check), fence, AC_Fence.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim_models.arming import BRAKE, LAND, RTL, STABILIZE, disarm, position_ready
from cosim_models.copter_messages import (
    CIRCLE_BREACHED,
    GCS_CLEARED,
    GCS_LOST,
    HIGH_BREACHED,
    LOW_BREACHED,
    NO_NUMBER,
    WARNING,
    say,
)
from cosim_models.flight_modes import set_mode

__all__ = ["hear_station", "watch"]

_PERIOD = 0.1  # s
_HIGHEST, _CIRCLE, _LOWEST = 1, 2, 8  # bits of FENCE_TYPE
_GIVE_UP = 100.0  # m beyond a fence from where the vehicle lands instead of returning
_REPORT, _RETURN, _ALWAYS_LAND, _BRAKE = 0, 1, 2, 4  # FENCE_ACTION


@kernel
def hear_station(m: Any, sender: int, t: float) -> None:
    """A HEARTBEAT has been heard."""
    if sender == m.SYSID_MYGCS:
        m.station_heard = t
        m.station_known = True


@kernel
def _change(m: Any, mode: int, t: float) -> None:
    """Switch to a mode, to LAND where it is not possible; on the ground disarm instead."""
    if m.on_ground:
        disarm(m)
    elif mode == LAND or not position_ready(m, t) or not set_mode(m, mode, t):
        set_mode(m, LAND, t)


@kernel
def _watch_station(m: Any, t: float) -> None:
    lost = m.FS_GCS_ENABLE > 0 and m.station_known and t - m.station_heard > m.FS_GCS_TIMEOUT
    if lost == m.station_lost:
        return
    m.station_lost = lost
    if not lost:
        say(m, WARNING, GCS_CLEARED, NO_NUMBER)
        return
    if not m.armed:
        return
    say(m, WARNING, GCS_LOST, NO_NUMBER)
    if m.FS_GCS_ENABLE == 7:
        _change(m, BRAKE, t)
    elif m.FS_GCS_ENABLE == 4 or m.FS_GCS_ENABLE == 5:
        _change(m, LAND, t)
    else:
        _change(m, RTL, t)


@kernel
def _beyond(m: Any) -> tuple[float, float, float]:
    """How far [m] the vehicle is above, outside and below its fences; negative within."""
    n, e, height = m.pos[0] - m.home[0], m.pos[1] - m.home[1], m.pos[2] - m.home[2]
    return height - m.FENCE_ALT_MAX, math.sqrt(n * n + e * e) - m.FENCE_RADIUS, m.FENCE_ALT_MIN - height


@kernel
def _watch_fence(m: Any, t: float) -> None:
    if m.FENCE_ENABLE == 0 or not m.armed:
        m.fence_breach = 0
        m.fence_low_armed = False
        return
    above, outside, below = _beyond(m)
    m.fence_low_armed = m.fence_low_armed or below < 0.0  # counts once it has been left behind
    now = 0
    if (m.FENCE_TYPE & _HIGHEST) != 0 and above >= 0.0:
        now += _HIGHEST
    if (m.FENCE_TYPE & _CIRCLE) != 0 and outside >= 0.0:
        now += _CIRCLE
    if (m.FENCE_TYPE & _LOWEST) != 0 and m.fence_low_armed and not m.on_ground and below >= 0.0:
        now += _LOWEST
    if m.mode == LAND or m.mode == RTL:
        now &= ~_LOWEST  # coming down is what was asked for
    new = now & ~m.fence_breach
    m.fence_breach = now
    if new == 0:
        return
    if (new & _HIGHEST) != 0:
        say(m, WARNING, HIGH_BREACHED, NO_NUMBER)
    if (new & _CIRCLE) != 0:
        say(m, WARNING, CIRCLE_BREACHED, NO_NUMBER)
    if (new & _LOWEST) != 0:
        say(m, WARNING, LOW_BREACHED, NO_NUMBER)
    if m.FENCE_ACTION == _REPORT:
        return
    if m.mode == STABILIZE and m.on_ground:
        disarm(m)
    elif m.FENCE_ACTION == _ALWAYS_LAND or max(above, outside) >= _GIVE_UP:
        _change(m, LAND, t)
    elif m.FENCE_ACTION == _BRAKE:
        _change(m, BRAKE, t)
    else:
        _change(m, RTL, t)


@kernel
def watch(m: Any, t: float) -> None:
    """Look whether something is wrong, ten times a second."""
    if t < m.next_watch - 1e-9:
        return
    m.next_watch = t + _PERIOD
    _watch_station(m, t)
    _watch_fence(m, t)
