"""The end of a gateway within the process of the run: packets are posted and answered by calls instead of a socket."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import takewhile
from threading import Lock

__all__ = ["Mailbox"]


class Mailbox:
    """A `Socket` in memory.

    Attributes:
        admitted: the packets that have entered the network, as (k, packet): before the step that begins at base step k.
        refusal: the reason why this run takes no packets; empty if it does. The run sets it.
        answered: called in the thread of the run with packets addressed to a system that has posted some.
    """

    stream = False
    port = 0

    def __init__(self) -> None:
        self.refusal = "the run has not begun"
        self.answered: Callable[[Sequence[bytes]], None] = lambda _: None
        self._lock = Lock()
        self._posted: list[bytes] = []
        self._known: list[tuple[int, bytes]] = []
        self.admitted: list[tuple[int, bytes]] = []

    def __str__(self) -> str:
        return "in this process"

    def post(self, packet: bytes) -> None:
        """Sends a packet from any thread; it enters the network before the next step."""
        with self._lock:
            self._posted.append(packet)

    def repeat(self, known: Sequence[tuple[int, bytes]]) -> None:
        """Lets packets of an earlier run enter at the same base steps: (k, packet), in the order of k."""
        self._known = list(known)

    def reach(self, k: int) -> None:
        """Posts the known packets up to base step `k`."""
        due = list(takewhile(lambda one: one[0] <= k, self._known))
        del self._known[: len(due)]
        with self._lock:
            self._posted += [packet for _, packet in due]

    def before(self, stop: int) -> int:
        """Returns the base step up to which the run may go on: `stop`, or that of the next known packet."""
        return min(stop, self._known[0][0]) if self._known else stop

    def start(self) -> None: ...

    def receive(self) -> list[bytes]:
        with self._lock:
            posted, self._posted = self._posted, []
        return posted

    def send(self, packets: Sequence[bytes]) -> int:
        if packets:
            self.answered(packets)
        return len(packets)

    def close(self) -> None:
        self.refusal = "the run has ended"
