"""The consensus law on a line: every mobile agent moves towards its neighbours, stubborn ones stay.

With both ends stubborn and 0 < epsilon < 2 / (2 + sqrt 2) three mobile agents settle evenly spaced between them; for
any number, epsilon <= 1/2 keeps the agents' order. Whose values these are, how old, and when a step is due is the
caller's affair: here is the arithmetic only, and the same law as the terms that an agent declares, from which a master
knows where a line settles and how fast.

Source: R. Olfati-Saber and R. M. Murray, Consensus problems in networks of agents with switching topology and
time-delays, IEEE Trans. Automatic Control 49 (2004): u_i = sum of (x_j - x_i), discretised with gain epsilon.
"""

from __future__ import annotations

from cosim.kernel import kernel
from cosim.verdict import Neighbour

__all__ = ["consensus_step", "consensus_terms"]


@kernel
def consensus_step(own: float, left: float, right: float, epsilon: float) -> float:
    """The next value of an agent: own + epsilon ((left - own) + (right - own)).

    Args:
        own: the agent's value, in any unit (here m along the line).
        left, right: its neighbours' values; pass `own` for a neighbour that it does not have.
        epsilon: gain [1].
    """
    return own + epsilon * ((left - own) + (right - own))


def consensus_terms(left: str, right: str, epsilon: str) -> tuple[Neighbour, ...]:
    """Returns the law of `consensus_step` as the terms of a `Formation`, given the names of an agent's parameters.

    Args:
        left, right: Integer parameters, the system ids of the western and the eastern neighbour; 0: none.
        epsilon: the Real parameter that is the gain.
    """
    return Neighbour(left, epsilon), Neighbour(right, epsilon)
