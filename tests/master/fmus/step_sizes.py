"""The constraints of var-step on signals that are given as functions of time: which steps they make."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cosim_master.execution.algorithms.constraints import StepSizes
from cosim_master.system.settings.constraints import Constraint, memory_of

Signal = Callable[[float], float]
S = 1_000_000_000


def steps_made(
    constraints: Sequence[Constraint],
    *signals: Signal,
    first: float = 0.1,
    shortest: float = 1e-6,
    longest: float = 1.0,
    count: int = 10,
    room: Sequence[float] = (),
    returns: bool = True,
) -> tuple[list[int], list[int]]:
    """The steps that count, and those that were repeated shorter, ns. The signals are those of all ports in turn.

    Args:
        room: where steps must end, s, as at rows of a recording.
        returns: whether steps can be repeated.
    """
    memory = np.zeros(memory_of(constraints))
    sizes = StepSizes(constraints, memory, first=ns(first), shortest=ns(shortest), longest=ns(longest))
    t, counted, repeated = 0, [], []
    while len(counted) < count:
        left = min((ns(end) - t for end in room if ns(end) > t), default=1000 * S)
        h = sizes.proposed(t, [signal(t / 1e9) for signal in signals], left)
        saved = memory.copy()
        while sizes.violated([signal((t + h) / 1e9) for signal in signals]) and returns and h > ns(shortest):
            repeated.append(h)
            memory[:] = saved
            h = sizes.tightened()
        counted.append(h)
        t += h
    return counted, repeated


def ns(seconds: float) -> int:
    return round(seconds * 1e9)
