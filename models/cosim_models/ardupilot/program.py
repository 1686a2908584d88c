"""ArduPilot's program in a process group of its own, which ends with its parent process, however that ends."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

__all__ = ["Program"]

_GUARD = 'trap "" HUP INT TERM; read -r _ || kill -s KILL -- "-$1"'
"""Kills the process group $1 when its standard input ends without a line.

ArduPilot waits for replies forever; a run that is killed cannot end it any more, but the kernel closes its pipes.
"""


class Program:
    """A started program.

    Args:
        command: path and arguments.
        folder: where it runs.
        log: file of its output.

    Attributes:
        command: path and arguments.
        pid: number of its process.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, command: Sequence[str], folder: Path, log: Path) -> None:
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                process_group=0,  # Ctrl-C in a terminal is for the run, which then ends ArduPilot
            )
        self.command, self.pid, self._log = (*command,), self._process.pid, log
        try:
            self._guard = subprocess.Popen(
                ["/bin/sh", "-c", _GUARD, "sh", str(self._process.pid)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                process_group=0,
            )
        except BaseException:
            self._process.kill()
            self._process.wait()
            raise

    def ended(self) -> str:
        """Returns its code and its last output if it has ended by itself, else an empty text."""
        if self._process.poll() is None:
            return ""
        last = " / ".join(self._log.read_text(errors="replace").splitlines()[-5:])
        return f"code {self._process.returncode}; its last output: {last}"

    def end(self) -> None:
        """Ends it and waits for its end. Without replies ArduPilot does not process milder signals than SIGKILL."""
        self._process.kill()
        self._process.wait(10)
        self._guard.communicate(b"\n")
