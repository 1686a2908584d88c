"""The rendezvous law: every drone moves towards the drones that it hears, until all have met.

The drones meet at the mean of their starts if hearing is mutual. With the Laplacian L of the graph of hearing, the
distance to the meeting point shrinks as exp(-gain lambda_2(L) t), and no drone leaves the convex hull of the drones.
They meet above one point on the ground: give them different heights.

Source: R. Olfati-Saber and R. M. Murray, Consensus problems in networks of agents with switching topology and
time-delays, IEEE Trans. Automatic Control 49 (2004): u_i = sum of (x_j - x_i), in the plane.
"""

from __future__ import annotations

from typing import Any

from cosim import Model, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables

__all__ = ["Rendezvous", "rendezvous"]


@kernel
def rendezvous(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: gain times the sum of the vectors to the neighbours."""
    for k in range(m.neighbours):
        for i in range(2):
            m.setpoint_velocity[i] += m.gain * (m.near_position[k, i] - m.position[i])
    return VELOCITY


class Rendezvous(Model):
    """Flies one drone to where it meets those that it hears."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(),
        Parameter("gain", unit="1/s", start=0.1, minimum=0.0, description="velocity per way to a neighbour"),
    )
    kernels = agent_kernels(rendezvous)
    errors = ERRORS
