"""Flight above terrain: destinations whose heights refer to the terrain, and the height by which their path is raised.

While m.above_terrain, the height of m.guided_position_neu is above the terrain, and so are those of the legs. The
shaped path is planned above the terrain, too, and raised by m.terrain_shift (height, speed, acceleration), which moves
to the terrain's height below the vehicle within the limits of the vertical speed, acceleration and jerk. So m.desired_*
are always relative to the local origin; `lower` and `raise_up` enclose the code that plans the path. Kernels over the
autopilot's record `m`.

Source: ArduPilot, AC_WPNav and AC_PosControl (update_terrain, pos_terrain_U_scaler_m), ArduCopter 4.7-dev.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.control.pid import ERROR
from cosim_models.autopilot.control.shaping import advance_limited, clip, shape_position
from cosim_models.autopilot.mission.terrain import measured_terrain, terrain_above_origin

__all__ = [
    "destination_up",
    "lower",
    "margin_share",
    "note_terrain",
    "raise_up",
    "refer_heights",
    "see_terrain",
]

_LEAST_SHARE = 0.01
_GOOD = 0.1  # s after which a gap has ended


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
