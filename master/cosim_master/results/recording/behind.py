"""A thread that makes calls one after the other, behind the run, and the memory that is lent to these calls."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from queue import Empty, LifoQueue
from typing import Generic, TypeVar

__all__ = ["Behind", "Lent"]

_T = TypeVar("_T")


class Behind:
    """Makes calls one after the other in a thread of its own.

    Args:
        name: of the thread.
        most: calls that may wait; a further one is accepted when the first of them is made.
    """

    def __init__(self, name: str, most: int) -> None:
        self._thread, self._most = ThreadPoolExecutor(1, name), most
        self._calls: deque[Future[None]] = deque()

    def call(self, function: Callable[[], None]) -> None:
        """Makes a call after all earlier ones. Raises the exception of an earlier one."""
        while self._calls and (len(self._calls) >= self._most or self._calls[0].done()):
            self._finish_first()
        self._calls.append(self._thread.submit(function))

    def wait(self) -> None:
        """Returns when all calls are made. Raises the exception of one."""
        while self._calls:
            self._finish_first()

    def _finish_first(self) -> None:
        self._calls[0].exception()  # waits; if a signal interrupts that, the call still counts as waiting
        self._calls.popleft().result()

    def stop(self) -> None:
        """Ends the thread when all calls are made."""
        self._thread.shutdown()


class Lent(Generic[_T]):
    """Objects that are taken and given back, by any thread: the one given back last first, as it is still cached.

    Args:
        make: makes an object when none is there.
        most: number of objects that are made; then `take` waits for one.
    """

    def __init__(self, make: Callable[[], _T], most: int) -> None:
        self._make, self._left = make, most
        self._free: LifoQueue[_T] = LifoQueue()

    def take(self) -> _T:
        """Returns an object that nobody else has."""
        try:
            return self._free.get(block=not self._left)
        except Empty:
            self._left -= 1
            return self._make()

    def give_back(self, one: _T) -> None:
        """Gives an object back."""
        self._free.put(one)
