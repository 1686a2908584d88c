"""The processes that make the runs: a cluster of this machine, or that of a Dask scheduler that is already there.

The cluster of this machine has one process for each core, each with one thread. Its connections are encrypted, with
certificates that exist in memory only, since everybody who can connect to a scheduler can execute code.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim_master.campaigns.refusal import refusal

__all__ = ["Cluster", "cluster"]


_PATIENCE = {
    "distributed.deploy.lost-worker-timeout": "3650 days",  # else a worker that dies twice in 15 s is given up
    "distributed.scheduler.allowed-failures": 1,  # a run that was there at two deaths is made again, alone
}


@dataclass(frozen=True, slots=True)
class Cluster:
    """A connection to a scheduler.

    Attributes:
        client: Dask's.
        dashboard: the address of its pages; empty if it has none.
    """

    client: Any
    dashboard: str

    def workers(self) -> int:
        """Returns the number of workers at this moment."""
        return len(self.client.scheduler_info(n_workers=-1)["workers"])


@contextmanager
def cluster(scheduler: str | None, workers: int | None) -> Iterator[Cluster]:
    """Yields a connection to a scheduler.

    Args:
        scheduler: its address ("tcp://10.0.0.1:8786"), or the file that it writes (--scheduler-file); None starts
            a cluster on this machine, which ends with the context.
        workers: number of processes on this machine; None: one for each core that this process may use.

    Raises:
        SystemDescriptionError: the scheduler cannot be reached.
        ModuleNotFoundError: the extra `sweep` is not installed.
    """
    import dask
    from distributed import Client

    # Lost workers, and a scheduler that goes, are told in words; their logs would disturb the progress.
    quiet = {"distributed.logging": {"distributed": "critical", "bokeh": "critical", "tornado": "critical"}}
    for name in ("distributed", "tornado.application", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set({"distributed.admin.tick.limit": "60s", **_PATIENCE, **quiet}):
        if scheduler is None:
            with _program_stays_here(), _started(workers or _cores()) as made, Client(made) as client:
                yield Cluster(client, made.dashboard_link or "")
            return
        where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
        try:
            client = Client(**where, timeout="30s")
        except (OSError, ValueError, TimeoutError) as error:
            text = f"no scheduler answers: {error}; start one with `dask scheduler`, and give its address"
            raise refusal(f"--scheduler {scheduler}", text) from None
        with client:
            yield Cluster(client, client.dashboard_link or "")


@contextmanager
def _program_stays_here() -> Iterator[None]:
    """Keeps workers, which are spawned now and after each death, from importing the program that runs.

    They need nothing of it, and it would be executed again where it has no `if __name__ == "__main__"`.
    """
    program = sys.modules["__main__"]
    names = ("__file__", "__spec__")
    held = {name: getattr(program, name) for name in names if hasattr(program, name)}
    program.__spec__ = None
    if "__file__" in held:
        del program.__file__
    try:
        yield
    finally:
        for name, value in held.items():
            setattr(program, name, value)


def _started(workers: int) -> Any:
    """Returns a cluster of this machine whose workers do not hear Ctrl-C, not even before they have read a line.

    Threads and processes inherit the mask. Workers that are started later are started by these threads.
    """
    if not hasattr(signal, "pthread_sigmask"):
        return _local(workers)
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, in the thread that starts workers, would unblock signals there
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return _local(workers)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _local(workers: int) -> Any:
    from distributed import LocalCluster
    from distributed.security import Security

    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        security=Security.temporary(),
        silence_logs=logging.CRITICAL,
        preload=["cosim_master.campaigns.running.uninterrupted"],
    )


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
