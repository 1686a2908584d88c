"""Rotors near others and near the ground: the wake below a hovering vehicle, and ground effect.

All rotors of a vehicle count as one rotor of the same total disc area.

**Wake.** At the rotor, the air moves down with the induced velocity of momentum theory, v = sqrt(T / (2 rho A)); on the
axis it approaches 2 v as it does below a vortex cylinder, v (1 + z / sqrt(z^2 + R^2)). At the depth z = 6 d, where d is
the diameter of the contracted wake, it becomes a turbulent round jet, whose velocity falls with 1 / z. Across the jet,
it is that of a jet with constant eddy viscosity, (1 + r^2 / b^2)^-2, with the width b for which its momentum is the
thrust at any depth: b^2 = 3 T / (pi rho u^2). The half width then grows by 0.093 z; measured are 0.094 to 0.096. The
thrust is taken as the weight. Wind and motion do not bend the wake.

**Ground effect.** T / T_free = 1 / (1 - (R / 4 z)^2 / (1 + (V / v)^2)), with the height z of the rotor above ground and
the airspeed V along it.

Sources: J. G. Leishman, Principles of Helicopter Aerodynamics, 2nd edition, sections 2.2 and 10.3; S. B. Pope,
Turbulent Flows, section 5.1 with table 5.1 (velocity decay 5.8 to 6.1, here 6) and equation 5.82; I. C. Cheeseman and
W. E. Bennett, The effect of the ground on a helicopter rotor in forward flight, ARC R&M 3021 (1955).
"""

from __future__ import annotations

from math import pi, sqrt

from cosim.kernel import kernel

__all__ = ["AIR_DENSITY", "GRAVITY", "ground_effect", "induced_velocity", "wake_velocity", "wake_width"]

GRAVITY = 9.80665
"""Standard gravity [m/s2]."""

AIR_DENSITY = 1.225
"""Of the standard atmosphere at sea level [kg/m3]."""

_DECAY = 6.0  # velocity-decay constant of a round jet
_LOWEST = 0.5  # rotor radii; the formula of ground effect is not valid below


@kernel
def induced_velocity(thrust: float, area: float) -> float:
    """Returns the velocity of the air through a hovering rotor [m/s]; 0 without a rotor."""
    return sqrt(thrust / (2.0 * AIR_DENSITY * area)) if area > 0.0 else 0.0


@kernel
def wake_width(depth: float, area: float) -> float:
    """Returns the width b of the wake [m] at `depth` [m] below a rotor of `area` [m2]."""
    radius = sqrt(area / pi)
    return sqrt(1.5) * radius * max(1.0, depth / (_DECAY * sqrt(2.0) * radius))


@kernel
def wake_velocity(depth: float, off: float, thrust: float, area: float) -> float:
    """Returns the downward velocity of the air [m/s] at `depth` below a rotor and `off` its axis [m]; 0 above it."""
    if depth <= 0.0 or area <= 0.0:
        return 0.0
    radius = sqrt(area / pi)
    axis = induced_velocity(thrust, area) * (1.0 + depth / sqrt(depth * depth + radius * radius))
    axis *= min(1.0, _DECAY * sqrt(2.0) * radius / depth)
    ratio = off / wake_width(depth, area)
    across = 1.0 + ratio * ratio
    return axis / (across * across)


@kernel
def ground_effect(height: float, speed: float, thrust: float, area: float) -> float:
    """Returns thrust over that far from the ground, for a rotor at `height` [m] and `speed` [m/s] along the ground."""
    if area <= 0.0:
        return 1.0
    radius = sqrt(area / pi)
    part = 0.25 * radius / max(height, _LOWEST * radius)
    advance = speed / induced_velocity(thrust, area)
    return 1.0 / (1.0 - part * part / (1.0 + advance * advance))
