"""A terminal for tests: a program at a pseudo-terminal, and the screen that its bytes make."""

from __future__ import annotations

import fcntl
import os
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType

import pyte

COMMAND = str(Path(sys.executable).with_name("uav-cosim"))
_LAUNCHER = """
import fcntl, os, signal, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # the terminal becomes the one that Ctrl-C in it interrupts
signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored by all that a shell without job control starts with &
os.execv(sys.argv[1], sys.argv[1:])
"""
_COLOUR = re.compile(rb"\x1b\[[0-9;]*[1-9][0-9;]*m")
PATIENCE = 300.0
"""Seconds that nothing takes, however slow the machine."""


class Terminal:
    """`uav-cosim` at a terminal of some size.

    Attributes:
        bytes: all that was written.
        screens: what was to be seen: after each read, and before each return to the beginning of a line.
    """

    def __init__(
        self, *arguments: str, folder: Path, columns: int = 80, rows: int = 24, environment: Mapping[str, str] = {}
    ) -> None:
        self.bytes = b""
        self.screens: list[list[str]] = []
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        self._end, inner = os.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        inherited = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES")}
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCHER, COMMAND, *arguments],
            cwd=folder,
            env=inherited | {"TERM": "xterm-256color"} | dict(environment),
            stdin=inner,
            stdout=inner,
            stderr=inner,
            start_new_session=True,
        )
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
