"""The steps of a law in figures: on axes over time, and as moments of snapshots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim_master.results.reading.flight import Flight

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SNAPSHOTS", "moments", "time_axis"]

SNAPSHOTS = (1, 9, 17)
"""Steps whose ends are shown in space, if the run reached them; otherwise its first, middle and last step."""


def moments(flight: Flight) -> list[tuple[str, float]]:
    """Returns the title and the time of the three snapshots."""
    if not flight.steps:
        first, last = float(flight.time[0]), float(flight.time[-1])
        return [(f"t = {t:.1f} s", t) for t in (first, 0.5 * (first + last), last)]
    numbers = sorted(flight.steps)
    chosen = (
        SNAPSHOTS if set(SNAPSHOTS) <= set(numbers) else (numbers[0], numbers[(len(numbers) - 1) // 2], numbers[-1])
    )
    ends = {k: _end_of_step(flight, k) for k in chosen}
    return [(f"step #{k}, t = {ends[k]:.1f} s", ends[k]) for k in chosen]


def _end_of_step(flight: Flight, k: int) -> float:
    """Returns the last instant of a step, when drones have reached its targets and the next step has not begun."""
    if k + 1 not in flight.steps:
        return float(flight.time[-1])
    return float(flight.time[max(0, int(np.searchsorted(flight.time, flight.steps[k + 1])) - 1)])


def time_axis(all_axes: Sequence[Axes], flight: Flight, *, whole: bool = False) -> None:
    """Draws time in s below, and steps above; begins shortly before the first step unless the whole run is shown."""
    first, last = float(flight.time[0]), float(flight.time[-1])
    if flight.steps and not whole:
        begin = min(flight.steps.values())
        first = max(first, begin - 0.02 * (last - begin))
    all_axes[-1].set_xlabel("time (s)")
    if last > first:
        all_axes[-1].set_xlim(first, last)
    if flight.steps:
        numbers = sorted(flight.steps)
        every = 1
        while len(numbers) > 20 * every:
            every *= 2
        shown = [k for k in numbers if (k - 1) % every == 0]
        top = all_axes[0].secondary_xaxis("top")
        top.set_xticks([flight.steps[k] for k in shown], [str(k) for k in shown])
        top.set_xlabel("step")
