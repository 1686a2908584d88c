"""Formations by displacement consensus: a line, a ring, a grid, a V or any other shape, with or without a leader.

Member number n of a formation has a place d_n in it, which follows from its system id and the shape. Every member
controls its displacement from each neighbour to the displacement of their places. With e_i = x_i - d_i, this is
rendezvous of the e_i: it converges as exp(-gain lambda_2(L) t), and the mean of the e_i is constant. A leader flies at
its commanded velocity. The other members then add the mean velocity of their neighbours, so that they do not lag behind
a leader that flies straight on.

Source: W. Ren and R. W. Beard, Distributed Consensus in Multi-vehicle Cooperative Control, Springer (2008), chapter 8
(consensus of x_i - d_i); K.-K. Oh, M.-C. Park, H.-S. Ahn, A survey of multi-agent formation control, Automatica 53
(2015), section 4 (displacement-based control).
"""

from __future__ import annotations

from enum import IntEnum
from math import ceil, cos, pi, sin, sqrt
from typing import Any

from cosim import Model, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables

__all__ = ["FormationFlight", "Shape", "formation", "place_of"]

_PLACES = 32
"""Largest number of places in a table."""


class Shape(IntEnum):
    """The shape of the formation; north is ahead, unless it is turned by `heading`."""

    line = 1
    """abreast, `spacing` apart, to the east"""
    ring = 2
    """around its middle, `spacing` from one to the next"""
    grid = 3
    """rows from west to east, as many as a square has, one behind the other"""
    v = 4
    """number 0 ahead, two arms at right angles, left and right in turn"""
    table = 5
    """`place_north` and `place_east`"""


_LINE, _RING, _GRID, _V, _TABLE = (int(shape) for shape in Shape)


@kernel
def place_of(m: Any, number: int) -> tuple[float, float]:
    """Returns the place of a member in the formation, north and east [m]."""
    ahead, right = 0.0, 0.0
    if m.form == _LINE:
        right = m.spacing * number
    elif m.form == _RING:
        radius = 0.5 * m.spacing / sin(pi / max(m.members, 2))
        ahead, right = radius * cos(2.0 * pi * number / m.members), radius * sin(2.0 * pi * number / m.members)
    elif m.form == _GRID:
        columns = ceil(sqrt(float(m.members)))
        ahead, right = -m.spacing * (number // columns), m.spacing * (number % columns)
    elif m.form == _V:
        back = m.spacing * sqrt(0.5) * ((number + 1) // 2)
        ahead, right = -back, back if number % 2 == 0 else -back
    else:
        ahead, right = m.place_north[number], m.place_east[number]
    return ahead * cos(m.heading) - right * sin(m.heading), ahead * sin(m.heading) + right * cos(m.heading)


@kernel
def formation(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: gain times the sum of the missing displacements from the neighbours; a leader's is given."""
    if m.sysid == m.leader:
        m.setpoint_velocity[0], m.setpoint_velocity[1] = m.leader_velocity[0], m.leader_velocity[1]
        return VELOCITY
    own = m.sysid - m.first_id
    if own < 0 or own >= m.members:
        return -10
    if m.form == _TABLE and m.members > m.place_north.size:
        return -11
    north, east = place_of(m, own)
    others = 0
    for k in range(m.neighbours):
        number = m.near_id[k] - m.first_id
        if number < 0 or number >= m.members:
            continue
        other_north, other_east = place_of(m, number)
        m.setpoint_velocity[0] += m.gain * (m.near_position[k, 0] - other_north - m.position[0] + north)
        m.setpoint_velocity[1] += m.gain * (m.near_position[k, 1] - other_east - m.position[1] + east)
        others += 1
    if m.leader != 0 and others > 0:
        for k in range(m.neighbours):
            if 0 <= m.near_id[k] - m.first_id < m.members:
                m.setpoint_velocity[0] += m.near_velocity[k, 0] / others
                m.setpoint_velocity[1] += m.near_velocity[k, 1] / others
    return VELOCITY


class FormationFlight(Model):
    """Flies one drone in a formation."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(),
        Parameter("form", type=Shape, start=Shape.line, description="the shape of the formation"),
        Parameter("members", type=int, start=5, minimum=1, maximum=255, description="how many drones it has"),
        Parameter("first_id", type=int, start=1, minimum=1, maximum=255, description="system id of number 0"),
        Parameter("spacing", unit="m", start=10.0, minimum=0.0, description="between those side by side"),
        Parameter("heading", unit="rad", start=0.0, description="by which it is turned, clockwise from north"),
        Parameter("place_north", shape=_PLACES, unit="m", start=0.0, description="of a table, by number"),
        Parameter("place_east", shape=_PLACES, unit="m", start=0.0, description="of a table, by number"),
        Parameter("gain", unit="1/s", start=0.1, minimum=0.0, description="velocity per missing displacement"),
        Parameter("leader", type=int, start=0, minimum=0, maximum=255, description="system id; 0: there is none"),
        Parameter("leader_velocity", shape=2, unit="m/s", start=0.0, description="of the leader, north and east"),
    )
    kernels = agent_kernels(formation)
    errors = ERRORS | {
        10: "sysid does not lie among the members of the formation: first_id to first_id + members - 1",
        11: f"a table has {_PLACES} places; members must not be more",
    }
