"""A terminal for tests: a program at a pseudo-terminal, and the screen that its bytes make.

The program is a process of its own, or a fork of one that has imported most of what commands import, but not the
consoles, which ask at their import what they write to.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import pyte

from tests.master.forks import TO_ITS_END

COMMAND = str(Path(sys.executable).with_name("uav-cosim"))
_LAUNCHER = """
import fcntl, os, signal, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # the terminal becomes the one that Ctrl-C in it interrupts
signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored by all that a shell without job control starts with &
os.execv(sys.argv[1], sys.argv[1:])
"""
_FORKER = """
import fcntl, gc, json, os, signal, sys, termios, threading
from contextlib import suppress
from importlib import import_module

for name in ("cosim_master.execution.simulate", "cosim_master.results.figures.draw", "cosim_master.system.shipped",
             "cosim_master.system.authoring.swarm.new", "pyarrow.acero", "pydantic.functional_validators",
             "pydantic.type_adapter", "rich.live", "typer"):
    with suppress(ImportError):
        import_module(name)
assert "cosim_master.cli" not in sys.modules
assert threading.active_count() == 1
gc.collect()
gc.freeze()  # otherwise, the collection at the end of a fork copies all memory
for line in sys.stdin:
    job = json.loads(line)
    if isinstance(job, int):
        print(os.waitstatus_to_exitcode(os.waitpid(job, 0)[1]), flush=True)
        continue
    terminal = os.open(job["terminal"], os.O_RDWR | os.O_NOCTTY)
    if (child := os.fork()) == 0:
        break
    os.close(terminal)
    print(child, flush=True)
else:
    sys.exit()
os.setsid()
fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)
signal.signal(signal.SIGINT, signal.default_int_handler)
os.chdir(job["folder"])
os.environ.clear()
os.environ.update(job["environment"])
for number in (0, 1, 2):
    os.dup2(terminal, number)
os.close(terminal)
sys.argv = job["words"]
from cosim_master.cli import main
"""
_COLOUR = re.compile(rb"\x1b\[[0-9;]*[1-9][0-9;]*m")
PATIENCE = 300.0
"""Seconds that nothing takes, however slow the machine."""


class _Process:
    """A process that has a terminal."""

    def __init__(self, words: list[str], folder: Path, environment: Mapping[str, str], terminal: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCHER, *words],
            cwd=folder,
            env=environment,
            stdin=terminal,
            stdout=terminal,
            stderr=terminal,
            start_new_session=True,
        )

    def kill(self) -> None:
        self._process.kill()

    def wait(self) -> int:
        return self._process.wait()


class _Fork:
    """A fork that has a terminal.

    Args:
        forker: the process that forks.
    """

    def __init__(
        self,
        forker: subprocess.Popen[str],
        words: list[str],
        folder: Path,
        environment: Mapping[str, str],
        terminal: int,
    ) -> None:
        self._forker = forker
        self._pid = self._told(
            {"words": words, "folder": str(folder), "environment": {**environment}, "terminal": os.ttyname(terminal)}
        )
        self._code: int | None = None

    def kill(self) -> None:
        if self._code is None:
            os.kill(self._pid, signal.SIGKILL)

    def wait(self) -> int:
        if self._code is None:
            self._code = self._told(self._pid)
        return self._code

    def _told(self, job: Any) -> int:
        assert self._forker.stdin is not None and self._forker.stdout is not None
        self._forker.stdin.write(json.dumps(job) + "\n")
        self._forker.stdin.flush()
        return int(self._forker.stdout.readline())


@contextmanager
def forking_at_terminals() -> Iterator[Callable[..., Terminal]]:
    """Starts the process that forks, and ends it; yields what makes a `Terminal` with a fork of it."""
    command = [sys.executable, "-c", _FORKER + TO_ITS_END]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as forker:
        yield partial(Terminal, start=partial(_Fork, forker))
        assert forker.stdin is not None
        forker.stdin.close()
        assert forker.wait(60) == 0


class Terminal:
    """`uav-cosim` at a terminal of some size.

    Args:
        start: how the program is started.

    Attributes:
        bytes: all that was written.
        screens: what was to be seen: after each read, and before each return to the beginning of a line.
    """

    def __init__(
        self,
        *arguments: str,
        folder: Path,
        columns: int = 80,
        rows: int = 24,
        environment: Mapping[str, str] = {},
        start: Callable[[list[str], Path, Mapping[str, str], int], _Process | _Fork] = _Process,
    ) -> None:
        self.bytes = b""
        self.screens: list[list[str]] = []
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        self._end, inner = os.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        inherited = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES")}
        inherited |= {"TERM": "xterm-256color"} | dict(environment)
        self._process = start([COMMAND, *arguments], folder, inherited, inner)
        os.close(inner)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._end)

    @property
    def lines(self) -> list[str]:
        """The lines of the screen that are not empty."""
        return [line.rstrip() for line in self._screen.display if line.strip()]

    @property
    def text(self) -> str:
        """The screen without the ends of lines that its width made."""
        return "".join(line.rstrip() if len(line.rstrip()) < self._screen.columns else line for line in self.lines)

    @property
    def coloured(self) -> bool:
        """Whether anything was written in a colour or style."""
        return _COLOUR.search(self.bytes) is not None

    @property
    def cursor_hidden(self) -> bool:
        """Whether the cursor is hidden now."""
        return self._screen.cursor.hidden

    def press(self, keys: bytes) -> None:
        """Type."""
        os.write(self._end, keys)

    def wait_for(self, seen: Callable[[list[str]], bool]) -> None:
        """Read until the screen is as wanted."""
        end = time.monotonic() + PATIENCE
        while not seen(self.lines):
            assert self._read(), f"the program has ended: {self.lines}"
            assert time.monotonic() < end, self.lines

    def finish(self) -> int:
        """Read until the program has ended; its exit code."""
        end = time.monotonic() + PATIENCE
        while self._read():
            assert time.monotonic() < end, self.lines
        return self._process.wait()

    def ever(self, pattern: str) -> list[str]:
        """Lines that match, of all screens, without repetition."""
        found = (line for screen in self.screens for line in screen if re.search(pattern, line))
        return list(dict.fromkeys(found))

    def _read(self) -> bool:
        if not select.select([self._end], [], [], PATIENCE)[0]:
            return True
        try:
            data = os.read(self._end, 65536)
        except OSError:  # Linux says so when the other end is closed
            return False
        self.bytes += data
        for part in re.split(rb"(?=\r)", data):  # one read may bring a line and what erases it
            self._stream.feed(part)
            self.screens.append(self.lines)
        return bool(data)
