"""A swarm of ideal point masses that follow a law: the kit's own table and decision, without packets and vehicles.

A point mass has the velocity (or, with `lag`, follows it like a first-order system) or the acceleration that its law
asks for, and stands where a position set-point says. Everybody is heard once per period, unless a packet is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import Model
from cosim.kernel import kernel
from cosim.model import record_layout
from cosim_models.agents.kit import ACCELERATION, POSITION, VELOCITY, decision
from cosim_models.agents.parts.neighbours import row_for

Array = NDArray[np.float64]


@kernel
def hear(swarm: Any, heard: Any, t: float) -> int:
    """Enter who is heard into the tables; returns how many found no row."""
    left_out = 0
    for i in range(swarm.shape[0]):
        m = swarm[i]
        for j in range(swarm.shape[0]):
            if not heard[i, j]:
                continue
            other, squares = swarm[j], 0.0
            for k in range(3):
                squares += (other.position[k] - m.position[k]) ** 2
            row = row_for(m, other.sysid, m.position, sqrt(squares), t)
            if row < 0:
                left_out += 1
                continue
            m.heard_id[row], m.heard_at[row] = other.sysid, t
            for k in range(3):
                m.heard_position[row, k] = other.position[k]
                m.heard_velocity[row, k] = other.velocity[k]
    return left_out


@cache
def everyone_decides(law: Callable[[Any, float, float], int]) -> Any:
    """A kernel that has all that are alive decide; returns which set-points hold."""
    decide = decision(law)

    @kernel
    def everyone(swarm: Any, alive: Any, t: float) -> int:
        which = 0
        for i in range(swarm.shape[0]):
            if alive[i]:
                which = decide(swarm[i], t)
        return which

    return everyone


class PointMasses:
    """N records of a model, stepped by its law.

    Args:
        starts: N rows of north, east [m].
        hears: N x N, whether the row's drone hears the column's; None: everybody hears everybody.
        loss: probability that a drone does not hear another one in a period.
        lag: time constant of the velocity [s].
        parameters: values for all, or arrays of one per drone.
    """

    def __init__(
        self,
        model: type[Model],
        law: Callable[[Any, float, float], int],
        starts: Array,
        *,
        hears: NDArray[np.bool_] | None = None,
        loss: float = 0.0,
        seed: int = 1,
        lag: float = 0.0,
        **parameters: Any,
    ) -> None:
        self.n, self.loss, self.lag = len(starts), loss, lag
        self.random = np.random.default_rng(seed)
        dtype, _ = record_layout(model.variables)
        self.m: Any = np.frombuffer(bytearray(model.record().tobytes() * self.n), dtype=dtype).view(np.recarray)
        self.m.sysid = 1 + np.arange(self.n)
        for name, value in parameters.items():
            self.m[name] = value
        self.m.position[:, :2] = starts
        self.m.position[:, 2] = -self.m.altitude
        self.alive = np.ones(self.n, dtype=bool)
        self.t = 0.0
        graph = np.ones((self.n, self.n), dtype=bool) if hears is None else hears.copy()
        np.fill_diagonal(graph, False)
        self.connect(graph)
        self._everyone = everyone_decides(law)

    def connect(self, graph: NDArray[np.bool_]) -> None:
        """Change who hears whom; of those that are not heard any more the table keeps what was heard last."""
        self.graph = graph

    @property
    def plane(self) -> Array:
        """North and east of all [m]."""
        return np.array(self.m.position[:, :2])

    def _hear(self) -> None:
        heard = self.graph & self.alive[None, :] & (self.random.random((self.n, self.n)) >= self.loss)
        hear(self.m, heard & self.alive[:, None], self.t)

    def turn(self) -> None:
        """One period: everybody is heard, decides and moves."""
        m = self.m
        h = float(m.period[0])
        self._hear()
        which = self._everyone(m, self.alive, self.t)
        if which & VELOCITY:
            goal = np.array(m.setpoint_velocity)
            left = np.exp(-h / self.lag) if self.lag else 0.0
            moved = goal * h + (m.velocity - goal) * (self.lag * (1.0 - left))
            velocity = goal + (m.velocity - goal) * left
        elif which & ACCELERATION:
            moved = m.velocity * h + 0.5 * h * h * m.setpoint_acceleration
            velocity = m.velocity + h * m.setpoint_acceleration
        else:
            assert which == POSITION
            moved, velocity = m.setpoint_position - m.position, np.zeros((self.n, 3))
        m.position[self.alive] += moved[self.alive]
        m.velocity[:] = np.where(self.alive[:, None], velocity, 0.0)
        self.t += h

    def run(self, seconds: float) -> Array:
        """Returns north and east of all at the end of each period."""
        return np.array([(self.turn(), self.plane)[1] for _ in range(round(seconds / float(self.m.period[0])))])
