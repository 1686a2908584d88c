"""Contact of one point with flat ground: a spring and a damper normal to it, stick and slip along it.

Along the ground, a spring connects the point to an anchor. The anchor stays in place until the force exceeds Coulomb's
limit and is then dragged along. A body at rest therefore stays in place, even in side wind, whereas a friction law that
depends only on velocity creeps. Source: P. A. Cundall and O. D. L. Strack, A discrete numerical model for granular
assemblies, Geotechnique 29 (1979).
"""

from __future__ import annotations

from math import sqrt

from cosim.kernel import kernel

__all__ = ["contact_force", "dragged"]


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
