"""Values that a part of a run passes on to other parts: copies of some outputs at the end of every base step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.kernel import kernel
from cosim_master.stepping.kernels.exchange import feed
from cosim_master.stepping.kernels.tables import K, Plan

__all__ = ["DUE", "NO_FRAMES", "USED", "Frames", "frames_of", "keep_frame"]

USED, DUE = 0, 1
"""Places in `Frames.counters`: frames in use; the base step whose frame is still to be added, -1: none."""


class Frames(NamedTuple):
    """The frames since the last exchange."""

    reals_of: NDArray[np.int64]  # in Plan.real_out
    ints_of: NDArray[np.int64]  # in Plan.int_out
    steps: NDArray[np.int64]  # base step of each frame
    reals: NDArray[np.float64]  # (frames, values)
    ints: NDArray[np.int32]
    counters: NDArray[np.int64]


def frames_of(reals: Sequence[int], ints: Sequence[int], rows: int) -> Frames:
    """Returns empty frames.

    Args:
        reals, ints: the places in `Plan.real_out` and `Plan.int_out` that they copy.
        rows: the largest number of base steps between two exchanges.
    """
    return Frames(
        np.array(reals, dtype=np.int64),
        np.array(ints, dtype=np.int64),
        np.zeros(rows, dtype=np.int64),
        np.zeros((rows, len(reals))),
        np.zeros((rows, len(ints)), dtype=np.int32),
        np.array([0, -1], dtype=np.int64),
    )


NO_FRAMES = frames_of((), (), 0)
"""Those of a run in one process, which adds none."""


@kernel
def keep_frame(p: Plan, f: Frames) -> None:
    """Adds a frame of the values at the current base step."""
    if p.delays.size > 0:
        feed(p, p.counters[K], p.feeds[:0])  # values that connections convert are computed, too
    row = f.counters[USED]
    f.steps[row] = p.counters[K]
    for j in range(f.reals_of.size):
        f.reals[row, j] = p.real_out[f.reals_of[j]]
    for j in range(f.ints_of.size):
        f.ints[row, j] = p.int_out[f.ints_of[j]]
    f.counters[USED] = row + 1
    f.counters[DUE] = -1
