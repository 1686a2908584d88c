"""The observer that keeps the newest values and packets of a run for its live page.

It copies values when the run reports its progress, twenty to fifty times a second of wall-clock time, and never makes
the stepping loop return or wait. A value that nobody has fetched is replaced by the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim_master.stepping.observation import Column, Packets, Progress, Seen, View
from cosim_master.view.live.traffic import LiveTraffic

__all__ = ["Feed"]


class Feed:
    """A `ProgressObserver` and `PacketObserver` with one frame.

    A frame has float64 numbers: simulated time [s], wall-clock time [s], value of each column.

    Args:
        view: the run; its columns are the signals of a frame unless `show` selects some of them.

    Attributes:
        columns: the recorded signals.
        traffic: takes the packets of the run; None: nobody does.
        verdict: the findings so far, for the page; None: there are none yet.
        newest: number and bytes (little-endian) of the newest frame; number 0: there is none yet.
        changed: called in the thread of the run when there is a new frame.
    """

    every = 0

    def __init__(self, view: View) -> None:
        self.newest: tuple[int, bytes] = (0, b"")
        self.changed: Callable[[], None] = lambda: None
        self.columns = view.columns
        self.traffic: LiveTraffic | None = None
        self.verdict: dict[str, Any] | None = None
        self._seen: Seen | None = None
        self.show(view.columns)

    def show(self, columns: Sequence[Column]) -> None:
        """Selects the signals of a frame, before the run begins."""
        self._size = 2 + len(columns)
        real = [(2 + i, column.place) for i, column in enumerate(columns) if column.kind == "Real"]
        other = [(2 + i, column.place) for i, column in enumerate(columns) if column.kind != "Real"]
        self._reals = np.array(real, dtype=np.int64).reshape(-1, 2).T
        self._integers = np.array(other, dtype=np.int64).reshape(-1, 2).T

    def initialised(self, seen: Seen) -> None:
        self._seen = seen  # its arrays are those of the loop: they have the values of each later moment, too
        self._take(seen.time, 0.0)

    def stepped(self, seen: Seen) -> None: ...

    def packets(self, packets: Packets, *, complete: bool) -> None:
        if self.traffic is not None:
            self.traffic.packets(packets, complete=complete)

    def progressed(self, progress: Progress) -> None:
        if self.traffic is not None:
            self.traffic.counts, self.traffic.wall = dict(progress.counts), progress.wall
        self._take(progress.time, progress.wall)

    def closed(self) -> None:
        self._seen = None

    def _take(self, time: float, wall: float) -> None:
        if self._seen is None:
            return
        frame = np.empty(self._size, dtype="<f8")
        frame[0], frame[1] = time, wall
        frame[self._reals[0]] = self._seen.reals[self._reals[1]]
        frame[self._integers[0]] = self._seen.integers[self._integers[1]]
        self.newest = (self.newest[0] + 1, frame.tobytes())
        self.changed()
