"""Olfati-Saber's flocking: drones keep a distance to each other, match velocities and follow a virtual leader.

Algorithm 2 of the source and, for cylinders as obstacles, algorithm 3. The acceleration of a drone is the sum of

    the gradients of a potential whose minimum is at `distance` from each neighbour (within 1.2 times of it),
    a damping of the velocities relative to them,
    a pull towards the virtual leader's place and velocity (the gamma agent), gains `c1` and `c2`,
    the same as the first two with respect to the nearest point of each obstacle (the beta agents).

Distances enter by the sigma norm, (sqrt(1 + epsilon |z|^2) - 1) / epsilon, which is smooth where |z| = 0. Constants
that are not parameters are the source's: epsilon 0.1, a = b = 5, h = 0.2 (0.9 for obstacles).

The autopilot receives velocities: the current velocity plus `response` times the acceleration. A vehicle whose velocity
follows with this time constant then accelerates as the law requires.

Source: R. Olfati-Saber, Flocking for multi-agent dynamic systems: algorithms and theory, IEEE Trans. Automatic Control
51 (2006).
"""

from __future__ import annotations

from math import cos, pi, sqrt
from typing import Any

from cosim import Model, Parameter, Variable
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables

__all__ = ["FLOCK", "Flocking", "flocking"]

_EPSILON, _A, _H, _H_OBSTACLE, _RANGE = 0.1, 5.0, 0.2, 0.9, 1.2
_OBSTACLES = 4


def _obstacle(name: str, description: str) -> Any:
    return Parameter(name, shape=_OBSTACLES, unit="m", start=0.0, description=description)


FLOCK: tuple[Variable, ...] = (
    Parameter("distance", unit="m", start=10.0, minimum=0.1, description="between neighbours of the flock"),
    Parameter("c_alpha", unit="1/s2", start=0.2, minimum=0.0, description="gain of the gradients"),
    Parameter("damping", unit="1/s", start=2.0, minimum=0.0, description="of velocities relative to neighbours"),
    Parameter("c1", unit="1/s2", start=0.005, minimum=0.0, description="gain of the way to the virtual leader"),
    Parameter("c2", unit="1/s", start=0.3, minimum=0.0, description="gain of its velocity"),
    Parameter("goal", shape=2, unit="m", start=0.0, description="the virtual leader's place, north and east"),
    Parameter("goal_velocity", shape=2, unit="m/s", start=0.0, description="its velocity, north and east"),
    Parameter("goal_time", unit="s", start=0.0, description="when it is at `goal`"),
    _obstacle("obstacle_north", "centre of each cylinder"),
    _obstacle("obstacle_east", "centre of each cylinder"),
    _obstacle("obstacle_radius", "of each cylinder; 0: there is none"),
    Parameter("clearance", unit="m", start=8.0, minimum=0.1, description="within which an obstacle pushes"),
    Parameter("c_obstacle", unit="1/s2", start=2.0, minimum=0.0, description="gain of its push"),
    Parameter("damping_obstacle", unit="1/s", start=0.5, minimum=0.0, description="of velocities towards it"),
    Parameter("acceleration_limit", unit="m/s2", start=2.5, minimum=0.0, description="of the law"),
    Parameter("response", unit="s", start=0.5, minimum=0.0, description="time constant of the vehicle's velocity"),
)
"""The parameters of the law."""


@kernel
def _sigma_norm(length: float) -> float:
    return (sqrt(1.0 + _EPSILON * length * length) - 1.0) / _EPSILON


@kernel
def _bump(z: float, h: float) -> float:
    """Returns 1 up to h, then a smooth transition to 0 at 1."""
    if z < h:
        return 1.0
    return 0.5 * (1.0 + cos(pi * (z - h) / (1.0 - h))) if z < 1.0 else 0.0


@kernel
def _sigma_1(z: float) -> float:
    return z / sqrt(1.0 + z * z)


@kernel
def _neighbours_pull(m: Any) -> tuple[float, float]:
    """Returns the acceleration due to the neighbours: gradients of the potential, damping of relative velocities."""
    north, east = 0.0, 0.0
    reach, wanted = _sigma_norm(_RANGE * m.distance), _sigma_norm(m.distance)
    for k in range(m.neighbours):
        n, e = m.near_position[k, 0] - m.position[0], m.near_position[k, 1] - m.position[1]
        away = sqrt(n * n + e * e)
        z = _sigma_norm(away)
        near = _bump(z / reach, _H)
        pull = near * _A * _sigma_1(z - wanted) / sqrt(1.0 + _EPSILON * away * away)
        north += m.c_alpha * pull * n + m.damping * near * (m.near_velocity[k, 0] - m.velocity[0])
        east += m.c_alpha * pull * e + m.damping * near * (m.near_velocity[k, 1] - m.velocity[1])
    return north, east


@kernel
def _obstacles_push(m: Any) -> tuple[float, float]:
    """Returns the acceleration due to the obstacles: each has a beta agent at its nearest point."""
    north, east = 0.0, 0.0
    clear = _sigma_norm(m.clearance)
    for k in range(m.obstacle_radius.size):
        if m.obstacle_radius[k] <= 0.0:
            continue
        n, e = m.position[0] - m.obstacle_north[k], m.position[1] - m.obstacle_east[k]
        away = max(sqrt(n * n + e * e), 1e-6)
        n, e = n / away, e / away
        part = m.obstacle_radius[k] / away
        gap = m.obstacle_radius[k] - away  # along (n, e), to the beta agent; negative outside
        z = _sigma_norm(gap)
        near = _bump(z / clear, _H_OBSTACLE)
        push = near * (_sigma_1(z - clear) - 1.0) * gap / sqrt(1.0 + _EPSILON * gap * gap)
        along = m.velocity[0] * n + m.velocity[1] * e
        north += m.c_obstacle * push * n + m.damping_obstacle * near * (
            part * (m.velocity[0] - along * n) - m.velocity[0]
        )
        east += m.c_obstacle * push * e + m.damping_obstacle * near * (
            part * (m.velocity[1] - along * e) - m.velocity[1]
        )
    return north, east


@kernel
def flocking(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: the current velocity plus `response` times the acceleration of the flocking law."""
    a_n, a_e = _neighbours_pull(m)
    b_n, b_e = _obstacles_push(m)
    since = t - m.goal_time
    north = m.goal[0] + since * m.goal_velocity[0] - m.position[0]
    east = m.goal[1] + since * m.goal_velocity[1] - m.position[1]
    north = a_n + b_n + m.c1 * north + m.c2 * (m.goal_velocity[0] - m.velocity[0])
    east = a_e + b_e + m.c1 * east + m.c2 * (m.goal_velocity[1] - m.velocity[1])
    size = sqrt(north * north + east * east)
    if size > m.acceleration_limit:
        north, east = north * m.acceleration_limit / size, east * m.acceleration_limit / size
    m.setpoint_velocity[0] = m.velocity[0] + m.response * north
    m.setpoint_velocity[1] = m.velocity[1] + m.response * east
    return VELOCITY


class Flocking(Model):
    """Flies one drone of a flock."""

    step_size = STEP_SIZE
    variables = (*agent_variables(), *FLOCK)
    kernels = agent_kernels(flocking)
    errors = ERRORS
