"""Contact of vehicles with each other, with obstacles and with terrain.

A vehicle is a sphere. A spring and a damper act normal to the contact, and Coulomb friction along it; the damper never
pulls. The stiffness is that for which a contact lasts `contact_time` without damping. Forces are held during a step of
the airspace and reach vehicles one step late, which takes damping away: as long as `contact_time` is at least 10 steps,
a contact with the default damping does not gain energy.

Obstacles are boxes with sides to the north and east, upright cylinders, and a grid of terrain heights with linear
interpolation. Boxes and cylinders stand on the ground.

Source: P. A. Cundall and O. D. L. Strack, A discrete numerical model for granular assemblies, Geotechnique 29 (1979).
"""

from __future__ import annotations

from math import floor, pi, sqrt
from typing import Any

from cosim.kernel import kernel

__all__ = ["BOXES", "CYLINDERS", "TERRAIN", "kind_of", "obstacle_forces", "pair_force", "surface_below", "terrain_at"]

BOXES = CYLINDERS = 8
TERRAIN = 8
"""Points of the terrain's grid in each direction."""

Vector = tuple[float, float, float]


@kernel
def kind_of(m: Any, i: int) -> int:
    """Returns the index of vehicle `i` in the parameters of airframes."""
    return int(m.airframe[i]) - 1


@kernel
def _radius(m: Any, i: int) -> float:
    return float(m.radius[kind_of(m, i)])


@kernel
def _force(m: Any, mass: float, depth: float, normal: Vector, velocity: Vector) -> Vector:
    """Returns the force on the first of two bodies [N]; `normal` points to it, `velocity` is relative to the other."""
    pace = pi / m.contact_time
    approach = -(normal[0] * velocity[0] + normal[1] * velocity[1] + normal[2] * velocity[2])
    damping = 2.0 * m.contact_damping * mass * pace
    push = mass * pace * pace * depth + damping * approach
    if push <= 0.0:
        return 0.0, 0.0, 0.0
    tn = velocity[0] + approach * normal[0]
    te = velocity[1] + approach * normal[1]
    td = velocity[2] + approach * normal[2]
    slip = sqrt(tn * tn + te * te + td * td)
    rub = min(damping, m.contact_friction * push / slip) if slip > 0.0 else 0.0
    return push * normal[0] - rub * tn, push * normal[1] - rub * te, push * normal[2] - rub * td


@kernel
def pair_force(m: Any, i: int, j: int) -> Vector:
    """Returns the force of vehicle `j` on vehicle `i` [N, NED]; that of `i` on `j` is its opposite."""
    n = m.position[3 * i] - m.position[3 * j]
    e = m.position[3 * i + 1] - m.position[3 * j + 1]
    d = m.position[3 * i + 2] - m.position[3 * j + 2]
    distance = sqrt(n * n + e * e + d * d)
    depth = _radius(m, i) + _radius(m, j) - distance
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    # Vehicles at one place are pushed apart upwards and downwards, by their numbers.
    normal = (n / distance, e / distance, d / distance) if distance > 0.0 else (0.0, 0.0, 1.0 if i > j else -1.0)
    velocity = (
        m.velocity[3 * i] - m.velocity[3 * j],
        m.velocity[3 * i + 1] - m.velocity[3 * j + 1],
        m.velocity[3 * i + 2] - m.velocity[3 * j + 2],
    )
    mass, other = m.mass[kind_of(m, i)], m.mass[kind_of(m, j)]
    return _force(m, mass * other / (mass + other), depth, normal, velocity)


@kernel
def _outside(x: float, half: float) -> float:
    """Returns the signed distance by which `x` is beyond the nearer of -half and half; 0 between them."""
    return x - half if x > half else x + half if x < -half else 0.0


@kernel
def _from_prism(m: Any, i: int, n: float, e: float, d: float, inside: Vector) -> tuple[float, Vector]:
    """Returns depth [m] and normal of a sphere in contact with an upright body.

    Args:
        n, e, d: vector from the nearest point of the body to the centre [m, NED]; zero if the centre is inside.
        inside: distance to the surface [m], and its direction north and east (0, 0: up), if the centre is inside.
    """
    distance = sqrt(n * n + e * e + d * d)
    if distance > 0.0:
        return _radius(m, i) - distance, (n / distance, e / distance, d / distance)
    up = -1.0 if inside[1] == 0.0 and inside[2] == 0.0 else 0.0
    return _radius(m, i) + inside[0], (inside[1], inside[2], up)


@kernel
def _box(m: Any, k: int, i: int) -> tuple[float, Vector]:
    """Returns depth [m] and normal of vehicle `i` in contact with box `k`; the depth is negative without contact."""
    n, e = m.position[3 * i] - m.box_north[k], m.position[3 * i + 1] - m.box_east[k]
    height = m.ground_height - m.position[3 * i + 2]
    half_n, half_e, top = 0.5 * m.box_length[k], 0.5 * m.box_width[k], m.box_height[k]
    to_n, to_e, to_top = half_n - abs(n), half_e - abs(e), top - height
    inside = (to_top, 0.0, 0.0)
    if to_n < min(to_e, to_top):
        inside = (to_n, 1.0 if n > 0.0 else -1.0, 0.0)
    elif to_e < to_top:
        inside = (to_e, 0.0, 1.0 if e > 0.0 else -1.0)
    return _from_prism(m, i, _outside(n, half_n), _outside(e, half_e), -max(height - top, 0.0), inside)


@kernel
def _cylinder(m: Any, k: int, i: int) -> tuple[float, Vector]:
    """Returns depth [m] and normal of vehicle `i` in contact with cylinder `k`, as `_box` does."""
    n, e = m.position[3 * i] - m.cylinder_north[k], m.position[3 * i + 1] - m.cylinder_east[k]
    height, top = m.ground_height - m.position[3 * i + 2], m.cylinder_height[k]
    off = sqrt(n * n + e * e)
    beyond = max(off - m.cylinder_radius[k], 0.0)
    un, ue = (n / off, e / off) if off > 0.0 else (1.0, 0.0)
    to_side, to_top = m.cylinder_radius[k] - off, top - height
    inside = (to_side, un, ue) if to_side < to_top else (to_top, 0.0, 0.0)
    return _from_prism(m, i, beyond * un, beyond * ue, -max(height - top, 0.0), inside)


@kernel
def terrain_at(m: Any, north: float, east: float) -> Vector:
    """Returns the terrain's height above `ground_height` [m] and its slopes to north and east; its edge goes on."""
    if m.terrain_spacing <= 0.0:
        return 0.0, 0.0, 0.0
    last = float(TERRAIN - 1)
    x = (north - m.terrain_origin[0]) / m.terrain_spacing
    y = (east - m.terrain_origin[1]) / m.terrain_spacing
    x, y = min(max(x, 0.0), last), min(max(y, 0.0), last)
    i, j = int(min(floor(x), last - 1.0)), int(min(floor(y), last - 1.0))
    x, y = x - i, y - j
    a, b = m.terrain[i * TERRAIN + j], m.terrain[i * TERRAIN + j + 1]
    c, d = m.terrain[(i + 1) * TERRAIN + j], m.terrain[(i + 1) * TERRAIN + j + 1]
    height = (1.0 - x) * ((1.0 - y) * a + y * b) + x * ((1.0 - y) * c + y * d)
    slope_n = ((1.0 - y) * (c - a) + y * (d - b)) / m.terrain_spacing
    slope_e = ((1.0 - x) * (b - a) + x * (d - c)) / m.terrain_spacing
    return height, slope_n, slope_e


@kernel
def surface_below(m: Any, i: int) -> float:
    """Returns the height above `ground_height` [m] of whatever is under the centre of vehicle `i`."""
    n, e = m.position[3 * i], m.position[3 * i + 1]
    height = m.ground_height - m.position[3 * i + 2]
    surface = terrain_at(m, n, e)[0]
    for k in range(m.boxes):
        dn, de = abs(n - m.box_north[k]), abs(e - m.box_east[k])
        if 2.0 * dn <= m.box_length[k] and 2.0 * de <= m.box_width[k] and height >= m.box_height[k]:
            surface = max(surface, m.box_height[k])
    for k in range(m.cylinders):
        dn, de = n - m.cylinder_north[k], e - m.cylinder_east[k]
        if dn * dn + de * de <= m.cylinder_radius[k] * m.cylinder_radius[k] and height >= m.cylinder_height[k]:
            surface = max(surface, m.cylinder_height[k])
    return float(surface)


@kernel
def obstacle_forces(m: Any, i: int) -> Vector:
    """Returns the force of obstacles and terrain on vehicle `i` [N, NED]."""
    fn = fe = fd = 0.0
    mass = m.mass[kind_of(m, i)]
    velocity = (float(m.velocity[3 * i]), float(m.velocity[3 * i + 1]), float(m.velocity[3 * i + 2]))
    for k in range(m.boxes + m.cylinders):
        depth, normal = _box(m, k, i) if k < m.boxes else _cylinder(m, k - m.boxes, i)
        if depth > 0.0:
            f = _force(m, mass, depth, normal, velocity)
            fn, fe, fd = fn + f[0], fe + f[1], fd + f[2]
    if m.terrain_spacing > 0.0:
        height, slope_n, slope_e = terrain_at(m, m.position[3 * i], m.position[3 * i + 1])
        length = sqrt(1.0 + slope_n * slope_n + slope_e * slope_e)
        depth = _radius(m, i) - (m.ground_height - m.position[3 * i + 2] - height) / length
        if depth > 0.0:
            normal = (-slope_n / length, -slope_e / length, -1.0 / length)
            f = _force(m, mass, depth, normal, velocity)
            fn, fe, fd = fn + f[0], fe + f[1], fd + f[2]
    return fn, fe, fd
