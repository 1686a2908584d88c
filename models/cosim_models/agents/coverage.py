"""Decentralised coverage of an area: every drone flies to the centroid of its own cell (Lloyd's algorithm).

A drone's Voronoi cell is the part of the area that is nearer to it than to any neighbour. Each drone cuts its own cell
out of the area, one neighbour after the other. A neighbour farther away than twice the cell's farthest corner does not
affect the cell, so the cell is correct as soon as all closer neighbours are heard. With velocities towards the
centroids, the cost never increases; it is the integral of density times squared distance to the nearest drone. The
drones come to rest when each of them is at its centroid.

The area is a rectangle. Its density is uniform, or a Gaussian hill around `peak`; masses are then sums over triangles:
each triangle of a cell is divided into 64 parts.

Source: J. Cortes, S. Martinez, T. Karatas, F. Bullo, Coverage control for mobile sensing networks, IEEE Trans. Robotics
and Automation 20 (2004).
"""

from __future__ import annotations

from math import exp
from typing import Any

from cosim import Memory, Model, Output, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables

__all__ = ["Coverage", "coverage"]

_NEIGHBOURS = 24
_CORNERS = _NEIGHBOURS + 4
_PARTS = 8  # of each side of a triangle


@kernel
def _keep(m: Any, north: float, east: float) -> None:
    """Removes the part of the cell that is nearer to a given place than to the drone (Sutherland-Hodgman clipping)."""
    way_n, way_e = north - m.position[0], east - m.position[1]
    middle = 0.5 * (way_n * (north + m.position[0]) + way_e * (east + m.position[1]))
    count = m.corners
    m.old_north[:] = m.corner_north
    m.old_east[:] = m.corner_east
    m.corners = 0
    for a in range(count):
        b = (a + 1) % count
        beyond_a = way_n * m.old_north[a] + way_e * m.old_east[a] - middle
        beyond_b = way_n * m.old_north[b] + way_e * m.old_east[b] - middle
        if beyond_a <= 0.0:
            _add_corner(m, m.old_north[a], m.old_east[a])
        if (beyond_a < 0.0 < beyond_b) or (beyond_b < 0.0 < beyond_a):
            part = beyond_a / (beyond_a - beyond_b)
            _add_corner(
                m,
                m.old_north[a] + part * (m.old_north[b] - m.old_north[a]),
                m.old_east[a] + part * (m.old_east[b] - m.old_east[a]),
            )


@kernel
def _add_corner(m: Any, north: float, east: float) -> None:
    if m.corners < m.corner_north.size:
        m.corner_north[m.corners], m.corner_east[m.corners] = north, east
        m.corners += 1


@kernel
def _add_triangle(m: Any, an: float, ae: float, bn: float, be: float, cn: float, ce: float) -> None:
    """Adds a triangle, with corners relative to the drone, to the mass, the moments and the cost of the cell."""
    area = 0.5 * abs((bn - an) * (ce - ae) - (cn - an) * (be - ae))
    n, e = (an + bn + cn) / 3.0, (ae + be + ce) / 3.0
    weight = area
    if m.peak_width > 0.0:
        dn, de = m.position[0] + n - m.peak[0], m.position[1] + e - m.peak[1]
        weight *= exp(-0.5 * (dn * dn + de * de) / (m.peak_width * m.peak_width))
    m.mass += weight
    m.centroid[0] += weight * n
    m.centroid[1] += weight * e
    squares = an * an + ae * ae + bn * bn + be * be + cn * cn + ce * ce
    m.cost += weight * (squares + 9.0 * (n * n + e * e)) / 12.0


@kernel
def _weigh(m: Any) -> None:
    """Calculates the mass, the centroid and the cost of the cell, a fan of triangles around its first corner."""
    m.mass, m.cost, m.centroid[0], m.centroid[1] = 0.0, 0.0, 0.0, 0.0
    parts = _PARTS if m.peak_width > 0.0 else 1
    an, ae = m.corner_north[0] - m.position[0], m.corner_east[0] - m.position[1]
    for k in range(1, m.corners - 1):
        un, ue = (m.corner_north[k] - m.position[0] - an) / parts, (m.corner_east[k] - m.position[1] - ae) / parts
        vn, ve = m.corner_north[k + 1] - m.position[0] - an, m.corner_east[k + 1] - m.position[1] - ae
        vn, ve = vn / parts, ve / parts
        for i in range(parts):
            for j in range(parts - i):
                n, e = an + i * un + j * vn, ae + i * ue + j * ve
                _add_triangle(m, n, e, n + un, e + ue, n + vn, e + ve)
                if i + j < parts - 1:
                    _add_triangle(m, n + un, e + ue, n + vn, e + ve, n + un + vn, e + ue + ve)
    if m.mass > 0.0:
        m.centroid[0], m.centroid[1] = m.centroid[0] / m.mass, m.centroid[1] / m.mass
    m.centroid[0] += m.position[0]
    m.centroid[1] += m.position[1]


@kernel
def coverage(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: gain times the vector to the centroid of the own cell, or, from outside, to the area."""
    south, north = m.area_north[0], m.area_north[1]
    west, east = m.area_east[0], m.area_east[1]
    if not (south < north and west < east):
        return -10
    m.corners = 4
    m.corner_north[0], m.corner_north[1], m.corner_north[2], m.corner_north[3] = south, north, north, south
    m.corner_east[0], m.corner_east[1], m.corner_east[2], m.corner_east[3] = west, west, east, east
    for k in range(m.neighbours):
        if m.near_position[k, 0] != m.position[0] or m.near_position[k, 1] != m.position[1]:
            _keep(m, m.near_position[k, 0], m.near_position[k, 1])
    if m.corners < 3:  # outside, and other drones are nearer to the whole area
        m.mass, m.cost = 0.0, 0.0
        m.centroid[0] = min(max(m.position[0], south), north)
        m.centroid[1] = min(max(m.position[1], west), east)
    else:
        _weigh(m)
    for i in range(2):
        m.setpoint_velocity[i] = m.gain * (m.centroid[i] - m.position[i])
    return VELOCITY


class Coverage(Model):
    """Flies one drone so that together they cover an area."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=_NEIGHBOURS),
        Parameter("area_north", shape=2, unit="m", start=(-50.0, 50.0), description="southern and northern border"),
        Parameter("area_east", shape=2, unit="m", start=(-50.0, 50.0), description="western and eastern border"),
        Parameter("peak", shape=2, unit="m", start=0.0, description="where the density is greatest, north and east"),
        Parameter("peak_width", unit="m", start=0.0, minimum=0.0, description="standard deviation; 0: uniform"),
        Parameter("gain", unit="1/s", start=0.5, minimum=0.0, description="velocity per way to the centroid"),
        Output("centroid", shape=2, unit="m", start=0.0, description="of the own cell, north and east"),
        Output("mass", unit="m2", start=0.0, description="of the own cell: integral of the density"),
        Output("cost", unit="m4", start=0.0, description="of the own cell: integral of density and squared distance"),
        Memory("corners", dtype="i4"),
        Memory("corner_north", shape=_CORNERS),
        Memory("corner_east", shape=_CORNERS),
        Memory("old_north", shape=_CORNERS),
        Memory("old_east", shape=_CORNERS),
    )
    kernels = agent_kernels(coverage)
    errors = ERRORS | {10: "area_north and area_east: the first border must be less than the second"}
