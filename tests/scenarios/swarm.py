"""A swarm that runs in a process of its own, for real programs to connect to."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.scenarios.flights import SYSTEMS

START_UP = 300.0
"""Seconds that a swarm may take until its sockets are open and it steps: kernels may have to be compiled."""


class Swarm:
    """A running `uav-cosim run`; what it says is in `lines`."""

    def __init__(self, process: subprocess.Popen[str], out: Path) -> None:
        self.process, self.out = process, out
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line.rstrip())

    def port(self, gateway: str) -> int:
        """The port that a gateway listens on."""
        end = time.monotonic() + START_UP
        pattern = re.compile(rf"note: {gateway}: listens on [\d.]+:(\d+)")
        while time.monotonic() < end:
            for line in list(self.lines):
                if found := pattern.fullmatch(line):
                    return int(found[1])
            if self.process.poll() is not None:
                break
            time.sleep(0.05)
        raise AssertionError(f"{gateway} is not open: {self.lines}")

    def stop(self) -> dict[str, Any]:
        """End the run as Ctrl-C does; its manifest."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(300)
        self._reader.join(60)
        assert code == 130, self.lines
        manifest: dict[str, Any] = json.loads((self.out / "manifest.json").read_text())
        return manifest


@contextmanager
def running(out: Path, *options: str, system: str = "line5-script", pace: float = 1.0) -> Iterator[Swarm]:
    """Run a system we ship with the given options of `uav-cosim run`."""
    command = [sys.executable, "-c", "from cosim_master.cli import main; main()", "run", str(SYSTEMS / system)]
    command += ["-o", str(out), "--pace", str(pace), *options]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    swarm = Swarm(process, out)
    try:
        yield swarm
    finally:
        if process.poll() is None:
            process.kill()
        process.wait(10)
        assert process.stderr is not None
        swarm._reader.join(60)
        process.stderr.close()
