"""The consensus law on a line: every mobile agent moves towards its neighbours, stubborn agents stay.

With both ends stubborn and 0 < epsilon < 2 / (2 + sqrt 2), three mobile agents settle evenly spaced between them. For
any number of agents, epsilon <= 1/2 preserves their order. This module contains the arithmetic only: the caller decides
which values to use, how old they may be, and when a step is due. It also provides the law as terms for an agent's
declaration, from which a master derives where a line settles and how fast.

Source: R. Olfati-Saber and R. M. Murray, Consensus problems in networks of agents with switching topology and
time-delays, IEEE Trans. Automatic Control 49 (2004): u_i = sum of (x_j - x_i), discretised with gain epsilon.
"""

from __future__ import annotations

from cosim.kernel import kernel
from cosim.verdict import Neighbour

__all__ = ["consensus_step", "consensus_terms"]


@kernel
def consensus_step(own: float, left: float, right: float, epsilon: float) -> float:
    """Returns the next value of an agent: own + epsilon ((left - own) + (right - own)).

    Args:
        own: the agent's value, in any unit (here m along the line).
        left, right: values of its neighbours; pass `own` for a missing neighbour.
        epsilon: gain [1].
    """
    return own + epsilon * ((left - own) + (right - own))


def consensus_terms(left: str, right: str, epsilon: str) -> tuple[Neighbour, ...]:
    """Returns the law of `consensus_step` as the terms of a `Formation`, given the names of an agent's parameters.

    Args:
        left, right: Integer parameters with the system ids of the western and the eastern neighbour; 0 means none.
        epsilon: name of the Real parameter with the gain.
    """
    return Neighbour(left, epsilon), Neighbour(right, epsilon)
