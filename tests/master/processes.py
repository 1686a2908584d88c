"""Processes as Linux lists them, for tests that wait for what a process does."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path


def children(pid: int) -> list[str]:
    """The processes that a process has started and not ended; a thread that ends meanwhile has none."""
    found = []
    for thread in Path(f"/proc/{pid}/task").iterdir():
        try:
            found += (thread / "children").read_text().split()
        except OSError:
            continue
    return found


def sleeps(pid: str) -> bool:
    """Whether a process is in sleep(); one that has ended is not."""
    try:
        return "nanosleep" in Path(f"/proc/{pid}/wchan").read_text()
    except OSError:
        return False


def signalled(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """Sends a signal, and waits until it is delivered: a second one of its kind would be lost before that."""
    process.send_signal(number)
    while process.poll() is None and _pending(process.pid) >> (number - 1) & 1:
        time.sleep(0.01)


def _pending(pid: int) -> int:
    """The set of signals that a process has not taken."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1], 16) for line in lines if line.startswith("ShdPnd:")), 0)
