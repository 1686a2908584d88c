"""Contact with flat ground: of one point, by a spring and a damper normal to it, stick and slip along it.

Along the ground, a spring connects the point to an anchor. The anchor stays in place until the force exceeds Coulomb's
limit and is then dragged along. A body at rest therefore stays in place, even in side wind, whereas a friction law that
depends only on velocity creeps. Source: P. A. Cundall and O. D. L. Strack, A discrete numerical model for granular
assemblies, Geotechnique 29 (1979).

`held` is another ground, that of ArduPilot's simulation (libraries/SITL/SIM_Aircraft.cpp, update_dynamics): in each of
its 1200 steps a second, it puts a vehicle within 1 mm of it back on it, upright and at rest but for a climb rate, which
grows from step to step. The vehicle leaves it when a step takes it further than 1 mm: at 1.2 m/s.
"""

from __future__ import annotations

from math import cos, sin, sqrt

from cosim.frames import yaw_from_quaternion
from cosim.kernel import kernel
from cosim_models.vehicles.dynamics.rigid_body import Quaternion, Vector

__all__ = ["HOLDS", "contact_force", "dragged", "held", "is_held"]

HOLDS = 0.001
"""Height [m] up to which `held` holds a vehicle."""

_LEAVES = 1200.0 * HOLDS  # m/s


@kernel
def contact_force(
    depth: float,
    vn: float,
    ve: float,
    vd: float,
    sn: float,
    se: float,
    stiffness: float,
    damping: float,
    friction: float,
) -> tuple[float, float, float]:
    """Returns the force of the ground on a point [N, NED].

    Args:
        depth: depth of the point below the surface [m]; the force is zero unless it is positive.
        vn, ve, vd: velocity of the point [m/s, NED].
        sn, se: vector from the anchor to the point [m].
        stiffness: normal to and along the ground [N/m].
        damping: normal to and along the ground [N s/m].
        friction: Coulomb friction coefficient [1].
    """
    if depth <= 0.0:
        return (0.0, 0.0, 0.0)
    normal = max(stiffness * depth + damping * vd, 0.0)
    fn = -stiffness * sn - damping * vn
    fe = -stiffness * se - damping * ve
    limit = friction * normal
    size = sqrt(fn * fn + fe * fe)
    if size > limit:
        fn *= limit / size
        fe *= limit / size
    return (fn, fe, -normal)


@kernel
def dragged(
    depth: float, vd: float, sn: float, se: float, stiffness: float, damping: float, friction: float
) -> tuple[float, float]:
    """Returns the stretch (sn, se) [m] that friction holds; the rest has slipped. Arguments as for `contact_force`."""
    if depth <= 0.0:
        return (0.0, 0.0)
    limit = friction * max(stiffness * depth + damping * vd, 0.0) / stiffness
    stretch = sqrt(sn * sn + se * se)
    if stretch <= limit:
        return (sn, se)
    return (sn * limit / stretch, se * limit / stretch)


@kernel
def is_held(before: float, down: float, sink: float, ground: float) -> bool:
    """Returns whether the ground of ArduPilot's simulation holds a vehicle at the end of a step.

    Args:
        before, down: its down coordinate at the begin and at the end of the step [m].
        sink: its velocity downwards [m/s].
        ground: down coordinate at which it stands [m].
    """
    return down >= ground - HOLDS or (before >= ground - HOLDS and sink >= -_LEAVES)


@kernel
def held(position: Vector, velocity: Vector, q: Quaternion, ground: float) -> tuple[Vector, Vector, Quaternion]:
    """Returns position, velocity and attitude of a vehicle that `is_held`; its angular velocity is zero.

    Args:
        position: [m, NED].
        velocity: [m/s, NED].
        q: attitude.
        ground: down coordinate at which the vehicle stands [m].
    """
    half = 0.5 * yaw_from_quaternion(q)
    place, climb = (position[0], position[1], ground), (0.0, 0.0, min(velocity[2], 0.0))
    return place, climb, (cos(half), 0.0, 0.0, sin(half))
