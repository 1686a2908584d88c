"""QRTL of quadplanes: the climb before the return, and its heights.

On its rotors, it first climbs straight up: to a cone around home that has the height Q_RTL_ALT at 1.5 times
WP_LOITER_RAD and beyond, and at least to Q_RTL_ALT_MIN. Within this radius, it then returns at the height that it has,
at most Q_RTL_ALT. On the wing, from afar, it approaches at RTL_ALTITUDE, and sinks on the way to Q_RTL_ALT, which it
has two radii from home. Kernels over the record of `QuadplaneAutopilot`.

Source: ArduPilot, ArduPlane/mode_qrtl.cpp.
"""

from __future__ import annotations

from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.targets import go_to
from cosim_models.autopilot.wing.energy import clip
from cosim_models.autopilot.wing.hover import rise
from cosim_models.autopilot.wing.progress import tell_return
from cosim_models.autopilot.wing.transition import distance_to, forget_target

__all__ = ["RETURN_MEMORY", "RETURN_PARAMETERS", "approach_height", "begin_return", "climb_before_return"]

_NEAR = 1.5  # of WP_LOITER_RAD: within it, it returns on its rotors at its height
_SINK = 0.6  # of TECS_SINK_MAX
_NEAREST, _FARTHEST = 2.0, 20.0  # of WP_LOITER_RAD: where it has sunk to Q_RTL_ALT, and where it begins at the latest

RETURN_PARAMETERS = (
    real("Q_RTL_ALT", "m", 15.0, "height above home from which QRTL descends", 1.0),
    real("Q_RTL_ALT_MIN", "m", 10.0, "height above home to which QRTL climbs at least before it returns"),
)
RETURN_MEMORY = (Memory("return_climbs", dtype="?", rare=True),)


@kernel
def _height(m: Any) -> float:
    return float(m.home[2] - m.position[2])


@kernel
def _head_home(m: Any) -> None:
    distance = distance_to(m, m.home[0], m.home[1])
    height = float(m.Q_RTL_ALT)
    if m.lift > 0.0 and distance < _NEAR * m.WP_LOITER_RAD:
        height = min(height, _height(m))
    go_to(m, m.home[0], m.home[1], m.home[2] - height)
    forget_target(m)
    tell_return(m, distance)


@kernel
def begin_return(m: Any) -> None:
    """Begins QRTL: with the climb, if it is on its rotors and too low."""
    distance = distance_to(m, m.home[0], m.home[1])
    least = clip(float(m.Q_RTL_ALT_MIN), min(m.Q_LAND_FINAL_ALT, m.Q_RTL_ALT), float(m.Q_RTL_ALT))
    height = max(m.Q_RTL_ALT * distance / max(_NEAR * m.WP_LOITER_RAD, distance), least)
    m.return_climbs = m.lift > 0.0 and height > _height(m)
    if m.return_climbs:
        m.vtol = True
        go_to(m, m.position[0], m.position[1], m.home[2] - height)
    else:
        _head_home(m)


@kernel
def climb_before_return(m: Any, h: float) -> None:
    """Climbs, and heads for home when it is high enough; required while m.return_climbs."""
    rise(m, h)
    if m.position[2] < m.guided_position[2]:
        m.return_climbs = False
        _head_home(m)


@kernel
def approach_height(m: Any, distance: float) -> float:
    """Returns how far above Q_RTL_ALT it flies on the wing, by its distance from home [m]."""
    higher = max(m.RTL_ALTITUDE - m.Q_RTL_ALT, 0.0)
    way = m.AIRSPEED_CRUISE * higher / max(_SINK * m.TECS_SINK_MAX, 1.0)
    near = _NEAREST * m.WP_LOITER_RAD
    far = max(near, min(_FARTHEST * m.WP_LOITER_RAD, near + way))
    if distance <= near or far <= near:
        return 0.0 if distance <= near else higher
    return float(higher * min((distance - near) / (far - near), 1.0))
