"""Messages between the parts of a run: in order from each to each, and an error if a part is lost."""

from __future__ import annotations

import queue
import time
from collections.abc import Sequence
from typing import Protocol

from cosim_master.diagnostics.errors import CosimError

__all__ = ["LocalTransport", "PartLost", "Transport", "local_transports"]


class PartLost(CosimError):
    """A part of the run does not answer any more.

    Attributes:
        part: its number.
        why: what is known of it.
        ended: whether it has ended in order, as part 0 does after an error.
    """

    def __init__(self, part: int, why: str, *, ended: bool = False) -> None:
        self.part, self.why, self.ended = part, why, ended
        super().__init__(f"part {part}: {why}; what was recorded until then is complete")


class Transport(Protocol):
    """The messages of one part.

    Attributes:
        part: its number; part 0 records the run.
        parts: the number of parts.
        seconds: wall-clock time without an awaited message after which its sender counts as lost, s.
        host: name of the machine.
        here: the number of parts on this machine.
    """

    here: int
    part: int
    parts: int
    seconds: float
    host: str

    def send(self, to: int, message: bytes) -> None:
        """Sends a message and returns at once. Raises PartLost."""

    def receive(self, source: int, *, patient: bool = False) -> bytes:
        """Returns the next message of another part; `patient` waits as long as that part lives.

        Raises:
            PartLost: the part has ended, or sends nothing for too long.
        """

    def fail(self, reason: str) -> None:
        """Tells all parts why this one fails; they end without it."""

    def close(self, *, abort: bool) -> None:
        """Ends the exchange; `abort` ends all other parts too, because one is lost."""


class LocalTransport:
    """Messages between threads of this process."""

    host = "this process"

    def __init__(
        self, part: int, boxes: Sequence[Sequence[queue.SimpleQueue[bytes | str | None]]], seconds: float
    ) -> None:
        self.part, self.parts, self.seconds = part, len(boxes), seconds
        self.here = self.parts
        self._boxes = boxes

    def send(self, to: int, message: bytes) -> None:
        self._boxes[self.part][to].put(message)

    def receive(self, source: int, *, patient: bool = False) -> bytes:
        """Returns the next message; see `Transport`."""
        began = time.monotonic()
        try:
            message = self._boxes[source][self.part].get(timeout=None if patient else self.seconds)
        except queue.Empty:
            raise PartLost(source, f"no message for {time.monotonic() - began:.0f} s") from None
        if message is None or isinstance(message, str):
            self._boxes[source][self.part].put(message)
            raise PartLost(source, message or "it has ended", ended=message is None)
        return message

    def fail(self, reason: str) -> None:
        """Tells all parts why this one fails; see `Transport`."""
        for box in self._boxes[self.part]:
            box.put(reason)

    def close(self, *, abort: bool) -> None:  # noqa: ARG002
        for box in self._boxes[self.part]:
            box.put(None)


def local_transports(parts: int, seconds: float = 60.0) -> list[LocalTransport]:
    """Returns connected transports for the threads of one process."""
    boxes = [[queue.SimpleQueue[bytes | str | None]() for _ in range(parts)] for _ in range(parts)]
    return [LocalTransport(part, boxes, seconds) for part in range(parts)]
