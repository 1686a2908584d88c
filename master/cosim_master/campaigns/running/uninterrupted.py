"""Loaded by each worker of this machine: Ctrl-C reaches all processes of a terminal; the client ends its workers."""

from __future__ import annotations

import signal

__all__ = ["dask_setup"]


def dask_setup(_: object) -> None:
    """Lets a worker ignore Ctrl-C; Dask calls this function when the worker begins."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
