"""Threads that step instances in addition to the main thread."""

from __future__ import annotations

import os
import threading
import time

from cosim_master.execution.run.state import RunState
from cosim_master.stepping.kernels.tables import PLACES, QUIT
from cosim_master.stepping.kernels.threads import work

__all__ = ["Workers", "threads_for"]

_WORTH_THREADS = 64
"""Least number of free instances for which several threads step by default."""


def threads_for(free: int, wanted: int | None) -> int:
    """Returns the number of threads that step; for few instances, handing them over costs more than it gains."""
    if wanted is None:
        wanted = (os.cpu_count() or 1) if free >= _WORTH_THREADS else 1
    return max(1, min(wanted, free))


class Workers:
    """All threads of a run except the main thread."""

    def __init__(self) -> None:
        self._state: RunState | None = None
        self._threads: list[threading.Thread] = []

    def start(self, state: RunState, threads: int) -> None:
        """Starts all but the first of `threads` threads; they then wait for steps."""
        self._state = state
        state.plan.shared[PLACES] = state.radio.places.ctypes.data
        for thread in range(1, threads):
            worker = threading.Thread(target=_serve, args=(state, thread), name=f"uav-cosim-{thread}", daemon=True)
            worker.start()
            self._threads.append(worker)

    def stop(self) -> None:
        """Ends the threads after they have finished their step."""
        if self._threads and self._state is not None:
            self._state.plan.shared[QUIT] = 1
            for worker in self._threads:
                worker.join()
            self._threads.clear()


def _serve(state: RunState, thread: int) -> None:
    """Steps until the run ends; `work` returns before that when the radio has been replaced by a larger one."""
    while not state.plan.shared[QUIT]:
        work(state.plan, state.radio, thread)
        time.sleep(1e-4)
