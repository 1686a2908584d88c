"""The shipped models that the tests of builds go through."""

from __future__ import annotations

from cosim import Model
from cosim.build import models_of_package

_LAWS_LIKE_RENDEZVOUS = {"AreaSweep", "Coverage", "Flocking", "Follower", "FormationFlight", "TargetTracking"}
_LIKE_OTHERS = {
    "Octorotor",
    "Y6",
    "Boat",
    "IdealAutopilot",
    "PlaneAutopilot",
    "RoverAutopilot",
    "Quadplane",
    "QuadplaneAutopilot",
}
_FLOWN = {"Airspace", "LargeAirspace", "PowerSystem"}


def models_with_kernels() -> dict[str, type[Model]]:
    """Returns the models of cosim_models that have kernels, but of the laws over the agent kit only Rendezvous.

    These laws share all of their kernels but one, and their own tests run them compiled, as kernels and as FMUs. So do
    vehicles with the kernels of others, and the small autopilots, which speak and hear with the functions of `gcs`. The
    airspaces have thousands of variables, and their flights and those of the power system run them as FMUs.
    """
    known = {model.__name__: model for model in models_of_package("cosim_models") if model.kernels is not None}
    left_out = _LAWS_LIKE_RENDEZVOUS | _LIKE_OTHERS | _FLOWN
    assert known.keys() > left_out
    return {name: model for name, model in known.items() if name not in left_out}
