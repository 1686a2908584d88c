"""Observers of a run: they receive its values at instants of simulated time, in chunks, or as the run proceeds.

    observer = make(view)               once, when the system has been checked and no FMU is loaded yet
    observer.initialised(seen)          once, at the start of the run, or at the checkpoint that it resumes from
    observer.stepped(seen)              at every multiple of `observer.every` base steps, and at the end of the run
    observer.rows(rows, complete)       chunks of recorded rows, if it is a `RowObserver`
    observer.packets(packets, complete) chunks of packets, if it is a `PacketObserver`
    observer.progressed(progress)       several times a second of wall-clock time, if it is a `ProgressObserver`; after
                                        the packets so far, if it is a `PacketObserver`, too
    observer.over                       after each instant, if it is a `PointObserver`: whether the run is to end there
    observer.closed()                   once after `initialised`, when the run has ended, however it did

The instants depend only on the system, not on the speed of the run. Observers do not change a run: the arrays that they
receive are read-only, and the next step overwrites them. The compiled loop returns to Python at each instant of
`stepped`; an observer with `every = 0` has none.

The compiled loop collects rows and packets in blocks. A block that is full is handed over as a complete chunk, and
emptied. About twice a second of wall-clock time, the contents of the blocks so far are handed over as chunks that are
not complete: the next chunk begins with the same rows or packets. Complete chunks therefore do not depend on the speed
of the run. The last ones precede `closed`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import RecordingFailed
from cosim_master.fmi.description.variables import Variable

if TYPE_CHECKING:  # readers of recordings need no stepping loop, whose compiler takes half a second to import
    from cosim_master.stepping.kernels.tables import Plan
    from cosim_master.stepping.layout import Layout

__all__ = [
    "Chunks",
    "Column",
    "MakeObserver",
    "Observed",
    "Observer",
    "Observers",
    "PacketObserver",
    "Packets",
    "PointObserver",
    "Progress",
    "ProgressObserver",
    "RowObserver",
    "Rows",
    "Seen",
    "View",
    "value_of",
]


@dataclass(frozen=True, slots=True)
class Seen:
    """Values at a communication point.

    Attributes:
        time: s.
        reals, integers: values of all fetched outputs, in the layout of `Plan.real_out` and `Plan.int_out`.
    """

    time: float
    reals: NDArray[np.float64]
    integers: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Rows:
    """Recorded rows in the form of the loop: one array for each kind of value.

    Attributes:
        time: (n,) s.
        reals, integers: (n, number of values); Booleans are integers after all others, 64-bit integers occupy two.
        texts: n lists.
    """

    time: NDArray[np.float64]
    reals: NDArray[np.float64]
    integers: NDArray[np.int32]
    texts: Sequence[Sequence[str]] = ()

    def between(self, first: int, end: int) -> Rows:
        """Returns the rows from `first` on, before `end`."""
        part = slice(first, end)
        return Rows(self.time[part], self.reals[part], self.integers[part], self.texts[part])


@dataclass(frozen=True, slots=True)
class Packets:
    """Packets in the form of the loop.

    Attributes:
        events: the fate of each packet for each node (`network.radio.tables.EVENT`).
        log: bytes of the packets sent and received: entries of time [ns, 8 bytes], 2 * node + 1 if the node sends the
            packet or else 2 * node [4 bytes], length [4 bytes], and the packet.
    """

    events: Any  # a table: mypy does not know its fields, and takes seconds for them
    log: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a run.

    Attributes:
        time, start, stop: simulated time reached, at the start, and at the end, s.
        wall: wall-clock time since the first step, s.
        counts: numbers of packets by radio, see `network.radio.build.packet_counts`.
        kept: whether the chunks that are not complete have just been handed over.
    """

    time: float
    start: float
    stop: float
    wall: float
    counts: Mapping[str, int]
    kept: bool = False

    @property
    def packets(self) -> int:
        """The number of packets sent by radio."""
        return self.counts["sent"]


class Observer(Protocol):
    """An observer of a run."""

    every: int
    """Base steps between two looks; 0: this observer has no values to look at in this system."""

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...


@runtime_checkable
class RowObserver(Observer, Protocol):
    """An observer that receives all recorded rows."""

    def rows(self, rows: Rows, *, complete: bool) -> None: ...


@runtime_checkable
class PacketObserver(Observer, Protocol):
    """An observer that receives all packets."""

    def packets(self, packets: Packets, *, complete: bool) -> None: ...


@runtime_checkable
class PointObserver(PacketObserver, Protocol):
    """An observer that looks at communication points, and may end the run."""

    periods: tuple[int, ...]
    """Base steps: `stepped` is called at the multiples of each of them, instead of those of `every`."""
    prompt: bool
    """Whether the packets so far are handed over before each call of `stepped`."""

    @property
    def over(self) -> bool:
        """True if the run is to end at the instant of the last call of `stepped`."""


@runtime_checkable
class ProgressObserver(Observer, Protocol):
    """An observer of the progress in wall-clock time."""

    def progressed(self, progress: Progress) -> None: ...


@dataclass(frozen=True, slots=True)
class Column:
    """A recorded signal that is not a String.

    Attributes:
        name: "component.variable".
        kind: "Real", or else "Integer" or "Boolean".
        place: index of its value among `Seen.reals` or `Seen.integers`; a wide integer occupies two places.
        variable: its description.
    """

    name: str
    kind: str
    place: int
    variable: Variable


class View:
    """The run that an observer is made for.

    Args:
        every: base steps between two rows of the recording.
        step: length of a base step, s.

    Attributes:
        every: as the argument.
        names: the recorded signals, "component.variable", in the order of the recording, without Strings.
        columns: the same signals, with the places of their values.
    """

    def __init__(self, layout: Layout, every: int, step: float) -> None:
        self.every = every
        self._step = step
        known: dict[str, tuple[str, int, Variable]] = {}
        for kind, signals in layout.signals.items():
            first = len(layout.ports["Integer"].outputs) if kind == "Boolean" else 0
            at = iter(layout.ports[kind].recorded)
            for name, variable in signals:
                known[name] = (kind, first + next(at), variable)
                if variable.wide:
                    next(at)
        names = (f"{one.name}.{name}" for one in layout.instances for name in one.fmu.variables)
        self.columns = tuple(Column(name, *known[name]) for name in names if name in known)
        self.names = tuple(column.name for column in self.columns)

    def steps(self, interval: float) -> int:
        """Returns the number of base steps in an interval [s], for `Observer.every`.

        Raises:
            ValueError: the interval is not a multiple of the base step.
        """
        steps = interval / self._step
        if not 1 <= round(steps) < 2**62 or not math.isclose(steps, round(steps), rel_tol=1e-9):
            raise ValueError(f"{interval:g} s is not a multiple of the base step {self._step:.9g} s")
        return round(steps)

    def row(self, seen: Seen) -> list[float | int | bool]:
        """Returns the values of `names`."""
        return [value_of(column, seen) for column in self.columns]


def value_of(column: Column, seen: Seen) -> float | int | bool:
    """Returns the value of a signal."""
    place, variable = column.place, column.variable
    if column.kind == "Real":
        return float(seen.reals[place])
    if variable.wide:
        halves = seen.integers[place : place + 2]
        return int(halves.view(np.uint64 if variable.fmi_type == "UInt64" else np.int64)[0])
    return bool(seen.integers[place]) if column.kind == "Boolean" else int(seen.integers[place])


MakeObserver = Callable[[View], Observer]
"""A function that returns an observer of a run; its class, if its only argument is a `View`."""


class Observed(Protocol):
    """The run that is observed, such as an `Execution`."""

    plan: Plan

    @property
    def k(self) -> int: ...
    @property
    def time(self) -> float: ...
    def advance(self, k_stop: int) -> None: ...


class Chunks(Protocol):
    """The blocks in which the loop collects rows and packets."""

    def attach(self, rows: Sequence[RowObserver], packets: Sequence[PacketObserver]) -> None:
        """Sets the observers that the blocks are handed over to."""

    def hand_over(self) -> None:
        """Hands over the contents of the blocks so far."""

    def complete(self) -> None:
        """Hands over and empties the blocks."""

    def show_packets(self, observer: PacketObserver) -> None:
        """Hands over the packets so far to one observer."""


class Observers:
    """Steps a run and calls each of its observers at its instants.

    As a context, it closes the observers, even if the run or one of them raises an exception.

    Args:
        run: the run, initialized and with all outputs collected.
        observers: the observers of the run.
        last: the base step at which the run ends.
        chunks: the blocks of the run; None if no observer receives chunks.
    """

    def __init__(self, run: Observed, observers: Sequence[Observer], last: int, chunks: Chunks | None = None) -> None:
        self._run, self._last, self._chunks = run, last, chunks
        # Python takes 20 us to look for all attributes of a protocol.
        rows = [one for one in observers if hasattr(one, "rows") and isinstance(one, RowObserver)]
        packets = [one for one in observers if hasattr(one, "packets") and isinstance(one, PacketObserver)]
        self._reporting = [one for one in observers if hasattr(one, "progressed") and isinstance(one, ProgressObserver)]
        self._shown = {id(one): one for one in packets}
        self._looking = [one for one in observers if one.every > 0]
        self._points = [one for one in observers if hasattr(one, "periods") and isinstance(one, PointObserver)]
        self._periods = {id(one): (one.every,) for one in self._looking} | {
            id(one): one.periods for one in self._points
        }
        self._reals, self._integers = run.plan.real_out.view(), run.plan.int_out.view()
        self._reals.flags.writeable = self._integers.flags.writeable = False
        self._next = {id(one): self._after(one) for one in self._looking}
        self._closed = False
        with ExitStack() as begun:
            for observer in observers:
                if any(observer in some for some in (self._looking, rows, packets, self._reporting)):
                    observer.initialised(self._seen())
                    begun.callback(observer.closed)
            if chunks is not None:
                chunks.attach(rows, packets)
            self._begun = begun.pop_all()

    def _after(self, observer: Observer) -> int:
        k = self._run.k
        return min((k // period + 1) * period for period in self._periods[id(observer)])

    @property
    def over(self) -> bool:
        """True if an observer ends the run."""
        return any(one.over for one in self._points)

    def _seen(self) -> Seen:
        return Seen(self._run.time, self._reals, self._integers)

    def advance(self, k_stop: int) -> None:
        """Steps like `Execution.advance`, and calls the observers at their instants, until one of them ends the run."""
        stop = min(k_stop, self._last)
        while self._run.k < stop and not (self._points and self.over):
            self._run.advance(min([stop, *self._next.values()]))
            seen = None
            if self._chunks is not None:
                for point in self._points:
                    if point.prompt and self._run.k >= min(self._next[id(point)], self._last):
                        self._chunks.show_packets(point)
            for observer in self._looking:
                if self._run.k >= min(self._next[id(observer)], self._last):
                    seen = seen or self._seen()
                    observer.stepped(seen)
                    self._next[id(observer)] = self._after(observer)

    def progressed(self, progress: Progress) -> None:
        """Reports the progress; if it is to be kept, after handing over the chunks so far.

        Raises:
            RecordingFailed: an observer cannot write a file.
        """
        if progress.kept and self._chunks is not None:
            self._chunks.hand_over()
        for observer in self._reporting:
            if self._chunks is not None and (shown := self._shown.get(id(observer))) is not None:
                self._chunks.show_packets(shown)
            observer.progressed(progress)

    def close(self) -> RecordingFailed | None:
        """Hands over the last chunks and closes all observers, even if one of them raises an exception.

        Returns:
            The reason why an observer could not complete a file.
        """
        failure = None
        self._closed = True
        try:
            if self._chunks is not None:
                with self._begun:  # a failing observer does not prevent the others from being closed
                    self._chunks.complete()
            self._begun.close()
        except RecordingFailed as error:
            failure = error
        return failure

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._closed:
            return
        if kind is None:
            if (failure := self.close()) is not None:
                raise failure
            return
        self._closed = True
        with self._begun, suppress(RecordingFailed):
            if self._chunks is not None:
                self._chunks.hand_over()
