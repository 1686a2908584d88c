"""Durations, counts and extents of violations ("spells") of many conditions at once."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

__all__ = ["Spells"]

Array: TypeAlias = np.ndarray[Any, Any]


class Spells:
    """The spells in which each of `count` conditions held.

    Attributes:
        first: start of the first spell, s; NaN without any.
        longest: length of the longest spell, s; a spell that was seen at one instant only is 0 s long.
        total: total length of all spells, s.
        open: whether the condition holds at the last instant.
        worst, worst_time: the greatest value seen in a spell, and its time; -inf without any.
        since: start of the last spell, s.
        last: the last instant, s.
    """

    def __init__(self, count: int) -> None:
        self.first = np.full(count, np.nan)
        self.longest, self.total = np.full(count, -1.0), np.zeros(count)
        self.open = np.zeros(count, dtype=bool)
        self.worst, self.worst_time = np.full(count, -np.inf), np.full(count, np.nan)
        self.since = np.full(count, np.nan)
        self.last = np.nan

    def look(self, times: Array, holds: Array, values: Array) -> None:
        """Adds instants.

        Args:
            times: (n,) s, rising.
            holds: (n, count) whether each condition holds.
            values: (n, count) the extent of each violation, for `worst`.
        """
        if not holds.any() and not self.open.any():
            self.last = float(times[-1])
            return
        for time, now, value in zip(times, holds, values, strict=True):
            goes_on, begins = now & self.open, now & ~self.open
            self.total[goes_on] += time - self.last
            self.since[begins] = time
            self.first[begins & np.isnan(self.first)] = time
            self.longest[now] = np.maximum(self.longest, time - self.since)[now]
            worse = now & (value > self.worst)
            self.worst[worse], self.worst_time[worse] = value[worse], time
            self.open, self.last = now.copy(), float(time)
