"""Flight above terrain: destinations whose heights refer to the terrain, and the height by which their path is raised.

The modes of a pilot follow the surface below the rangefinder in the same way, relative to their height when it is first
seen: by SURFTRAK_MODE 1, ALT_HOLD, LOITER, POSHOLD, ZIGZAG and CIRCLE.

While m.above_terrain, the height of m.guided_position_neu is above the terrain, and so are those of the legs. The
shaped path is planned above the terrain, too, and raised by m.terrain_shift (height, speed, acceleration), which moves
to the terrain's height below the vehicle within the limits of the vertical speed, acceleration and jerk. So m.desired_*
are always relative to the local origin; `lower` and `raise_up` enclose the code that plans the path. Kernels over the
autopilot's record `m`.

Source: ArduPilot, AC_WPNav and AC_PosControl (update_terrain, pos_terrain_U_scaler_m), ArduCopter 4.7-dev
(surface_tracking).
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.pid import ERROR
from cosim_models.autopilot.control.position import seek_velocity_up
from cosim_models.autopilot.control.shaping import advance_limited, clip, shape_position
from cosim_models.autopilot.mission.terrain import measured_terrain, range_is_healthy, terrain_above_origin
from cosim_models.autopilot.record.modes import ALT_HOLD, CIRCLE, LOITER, POSHOLD, ZIGZAG

__all__ = [
    "climb_over_surface",
    "destination_up",
    "leave_surface",
    "lower",
    "margin_share",
    "note_terrain",
    "raise_up",
    "refer_heights",
    "see_terrain",
]

_LEAST_SHARE = 0.01
_GOOD = 0.1  # s after which a gap has ended
_GROUND = 1  # SURFTRAK_MODE
_LOST = 1.0  # s without the surface, after which it is not followed


@kernel
def refer_heights(m: Any, above: bool) -> tuple[bool, float]:
    """Makes the heights of destinations refer to the terrain, or to the local origin; the desired motion stays.

    Returns whether that is possible, and the terrain's height below the vehicle [m]. If it is unknown, the fail-safe
    begins.
    """
    known, up = measured_terrain(m)
    if not known:
        m.terrain_missing = True
        return False, 0.0
    s = m.terrain_shift
    if not m.terrain_on:
        s[1], s[2] = 0.0, 0.0
        m.terrain_gap = m.terrain_good = 0.0
    s[0] = up if above else 0.0
    m.terrain_target = s[0]
    m.above_terrain = above
    m.terrain_on = True
    return True, up


@kernel
def destination_up(m: Any) -> float:
    """Returns the height of the destination above the local origin [m]."""
    g = m.guided_position_neu
    if m.above_terrain:
        return float(g[2] + terrain_above_origin(m, g[0], g[1]))
    return float(g[2])


@kernel
def lower(m: Any) -> None:
    """Makes the desired motion relative to the terrain."""
    s = m.terrain_shift
    m.desired_position_neu[2] -= s[0]
    m.desired_velocity_neu[2] -= s[1]
    m.desired_acceleration_neu[2] -= s[2]


@kernel
def raise_up(m: Any, dt: float) -> None:
    """Moves the shift to the terrain's height, and makes the desired motion relative to the local origin again."""
    s = m.terrain_shift
    low = min(m.limit_neu[2], 0.0)
    s[0], s[1] = advance_limited(s[0], s[1], s[2], dt, low, m.position_error_neu[2], m.climb_pid[ERROR])
    a, j = m.accel_up, m.jerk_up
    s[2] = shape_position(m.terrain_target, 0.0, 0.0, s[0], s[1], s[2], -m.speed_down, m.speed_up, -a, a, j, dt, False)
    m.desired_position_neu[2] += s[0]
    m.desired_velocity_neu[2] += s[1]
    m.desired_acceleration_neu[2] += s[2]


@kernel
def see_terrain(m: Any) -> bool:
    """Takes the terrain's height below the vehicle for that of the path; returns whether it is known, or not needed."""
    if not m.above_terrain:
        m.terrain_target = 0.0
        return True
    known, up = measured_terrain(m)
    if known:
        m.terrain_target = up
    return known


@kernel
def note_terrain(m: Any, known: bool, dt: float) -> None:
    """Measures how long the terrain's height has been missing."""
    if not known:
        m.terrain_gap += dt
        m.terrain_good = 0.0
    elif m.terrain_gap > 0.0:
        m.terrain_good += dt
        if m.terrain_good > _GOOD:
            m.terrain_gap = 0.0


@kernel
def margin_share(m: Any, margin: float) -> float:
    """Returns the share of the horizontal speed that the error of the height permits; the desired motion is lowered.

    Within half of `margin` [m], all of it; at the margin, nearly nothing.
    """
    if margin <= 0.0 or not m.above_terrain:
        return 1.0
    half = 0.5 * margin
    error = abs(m.position_neu[2] - m.desired_position_neu[2] - m.terrain_target)
    return clip(1.0 - (error - half) / half, _LEAST_SHARE, 1.0)


# ---- the surface below a pilot's modes -----------------------------------------------------------------------------


@kernel
def _follows(m: Any) -> bool:
    """Returns whether the mode follows the surface below the rangefinder."""
    return bool(m.SURFTRAK_MODE == _GROUND and m.mode in (ALT_HOLD, LOITER, POSHOLD, ZIGZAG, CIRCLE))


@kernel
def _see_surface(m: Any, dt: float) -> None:
    """Takes the measured height of the surface for that of the path, or leaves it after a second without one."""
    if not range_is_healthy(m) or m.range_jumps != 0:
        m.surface_gap += dt
        if m.surface_gap > _LOST:
            m.terrain_on = False
        return
    s = m.terrain_shift
    if not m.terrain_on:
        s[1], s[2] = 0.0, 0.0
    if not m.terrain_on or m.surface_gap > _LOST or m.surface_cleared != m.range_cleared:
        s[0] = m.range_terrain
    m.terrain_on = True
    m.terrain_target = m.range_terrain
    m.surface_cleared = m.range_cleared
    m.surface_gap = 0.0


@kernel
def climb_over_surface(m: Any, rate: float, dt: float) -> None:
    """Shapes the desired climb rate; with a rangefinder, relative to the surface if the mode follows it."""
    if m.ranging and _follows(m):
        _see_surface(m, dt)
        if m.terrain_on:
            lower(m)
            seek_velocity_up(m, rate, 0.0, False, dt)
            raise_up(m, dt)
            return
    seek_velocity_up(m, rate, 0.0, False, dt)


@kernel
def leave_surface(m: Any) -> None:
    """Ends the following of the surface; the desired motion stays."""
    if m.ranging and _follows(m):
        m.terrain_on = False
