"""Contact of one point with flat ground: a spring and damper across it, stick and slip along it.

Along the ground the point hangs on a spring from an anchor that stays where it is until the force exceeds Coulomb's
limit, then is dragged along: a body at rest stays where it is, under a side wind too (a friction law that depends on
velocity alone creeps). Source: P. A. Cundall and O. D. L. Strack, A discrete numerical model for granular
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
    """Force of the ground on a point [N, NED].

    Args:
        depth: how far the point is below the surface [m]; no force when it is not.
        vn, ve, vd: velocity of the point [m/s, NED].
        sn, se: from the anchor to the point [m].
        stiffness: across and along the ground [N/m].
        damping: across and along the ground [N s/m].
        friction: Coulomb's coefficient [1].
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
    """The stretch (sn, se) [m] that friction holds; the rest has slipped. Arguments as for `contact_force`."""
    if depth <= 0.0:
        return (0.0, 0.0)
    limit = friction * max(stiffness * depth + damping * vd, 0.0) / stiffness
    stretch = sqrt(sn * sn + se * se)
    if stretch <= limit:
        return (sn, se)
    return (sn * limit / stretch, se * limit / stretch)
