"""The shipped models that the tests of builds go through."""

from __future__ import annotations

from cosim import Model
from cosim.build import models_of_package

_LAWS_LIKE_RENDEZVOUS = {"Coverage", "Flocking", "Follower", "FormationFlight"}


def models_with_kernels() -> dict[str, type[Model]]:
    """Returns the models of cosim_models that have kernels, but of the laws over the agent kit only Rendezvous.

    These laws share all of their kernels but one, and their own tests run them compiled, as kernels and as FMUs.
    """
    known = {model.__name__: model for model in models_of_package("cosim_models") if model.kernels is not None}
    assert known.keys() > _LAWS_LIKE_RENDEZVOUS
    return {name: model for name, model in known.items() if name not in _LAWS_LIKE_RENDEZVOUS}
