"""The drone of a flock in one FMU: a point mass that follows the flocking law of `Flocking`.

`kit` has what differs from three FMUs.
"""

from __future__ import annotations

from cosim import Model
from cosim_models.agents.flocking import FLOCK, flocking
from cosim_models.drones.kit import ERRORS, STEP_SIZE, drone_kernels, drone_variables

__all__ = ["FlockingDrone"]


class FlockingDrone(Model):
    """Is one drone of a flock: a point mass that keeps its distance, matches velocities and follows a leader."""

    step_size = STEP_SIZE
    variables = (*drone_variables(), *FLOCK)
    kernels = drone_kernels(flocking)
    errors = ERRORS
