"""The execution of one part of a run: it steps window by window, and exchanges with the other parts between them.

    part = PartExecution(transport, cut, ...)    as an `Execution` of the part's own instances, up to the first row
    part.agree(...)                              part 0 tells all parts at which instants somebody looks at the run
    part.serve()                                 every other part: windows until part 0 ends the run

A window ends after `Cut.window` base steps, and at every *instant*: where an observer of the run looks at values, at
the end of the run, and one window after part 0 has asked for it. At an instant everything that was sent has been
replayed, and part 0 has the outputs of all instances, so that its state is that of a run in one process.

A part that fails goes on exchanging empty windows until part 0, which has its error, ends the run.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import CosimError, FmuError, RunFailed, RunTerminated
from cosim_master.execution.execution import Execution
from cosim_master.execution.partitions.checkpoints import PartState, confine, part_state
from cosim_master.execution.partitions.cut import Cut
from cosim_master.execution.partitions.exchange import Exchange, Given
from cosim_master.execution.partitions.starting import all_ready
from cosim_master.execution.partitions.transport import Transport
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.checkpoint import Saved
from cosim_master.execution.run.opening import Setup
from cosim_master.network.radio.build import packet_counts
from cosim_master.results.storage.checkpoint_folder import Checkpoint
from cosim_master.stepping.confining import outputs_of_part
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import Packets, Rows, Seen
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["Collected", "Message", "PartExecution", "Report", "failure_data"]


def _reduced(self: Any) -> tuple[Any, ...]:
    """Pickles a message by its slots: dataclasses look their fields up each time, which takes as long as the rest."""
    return type(self), tuple(getattr(self, name) for name in self.__slots__)


@dataclass(slots=True)
class Collected:
    """What a part records: rows of its own columns, and packets of its own nodes; chunks in the order of time."""

    every = 0
    ticks: list[np.ndarray[Any, Any]] = field(default_factory=list)
    reals: list[np.ndarray[Any, Any]] = field(default_factory=list)
    ints: list[np.ndarray[Any, Any]] = field(default_factory=list)
    texts: list[list[str]] = field(default_factory=list)
    events: list[np.ndarray[Any, Any]] = field(default_factory=list)
    log: list[bytes] = field(default_factory=list)

    __reduce__ = _reduced

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...
    def closed(self) -> None: ...

    def rows(self, rows: Rows, *, complete: bool) -> None:
        """Keeps complete chunks of rows."""
        if complete:
            self.ticks.append(rows.time.copy())
            self.reals.append(rows.reals.copy())
            self.ints.append(rows.integers.copy())
            self.texts += [list(row) for row in rows.texts]

    def packets(self, packets: Packets, *, complete: bool) -> None:
        """Keeps complete chunks of packets."""
        if complete:
            self.events.append(packets.events.copy())
            self.log.append(packets.log.tobytes())


@dataclass(frozen=True, slots=True)
class Report:
    """What a part tells part 0 at the end of a window, or at an instant.

    Attributes:
        k: the boundary, in base steps.
        replayed: the boundary up to which packets have been replayed.
        collected: rows and packets since the last report.
        counters: of the radio.
        failed: the base step at which the part has failed, and its errors as (instance, function, status, time, log);
            None if it has not.
        outputs: at an instant, the values of all its outputs (reals, integers).
        state: at an instant with a checkpoint, what the part alone knows.
        leaving: packets that have arrived at each gateway.
        unread: of each gateway, packets of real programs that have not been read yet.
    """

    k: int
    replayed: int
    collected: Collected
    counters: np.ndarray[Any, Any]
    failed: tuple[int, tuple[tuple[Any, ...], ...]] | None
    outputs: tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]] | None = None
    state: PartState | None = None
    leaving: tuple[bytes, ...] = ()
    unread: tuple[int, ...] = ()

    __reduce__ = _reduced


@dataclass(slots=True)
class Requests:
    """What users ask for while a run goes on; all parts learn it at the same base step.

    Attributes:
        entering: packets of real programs, with the numbers of their gateways.
        changes: values to be set, with the base step from which they are set.
    """

    entering: list[tuple[int, Sequence[bytes]]] = field(default_factory=list)
    changes: list[tuple[Change, int]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Message:
    """A message to another part at the end of a window; the attributes after `report` come from part 0 only.

    Attributes:
        requests: what users ask for, of all parts.
        ending: the window after this one is the last; its end is an instant.
        over: the run is over: there is no such window.
    """

    given: Given | None
    report: Report | None = None
    ending: bool = False
    over: bool = False
    requests: Requests | None = None

    __reduce__ = _reduced


class PartExecution(Execution):
    """One part of a run.

    Args:
        transport: its messages.
        cut: the parts of the system.
        checked, clock, layout, network: the whole system, as of a run in one process.
        setup: how it runs; its share is that of the part.

    Raises:
        PartLost: another part has ended, or does not answer.
    """

    def __init__(
        self,
        transport: Transport,
        cut: Cut,
        checked: CheckedSystem,
        clock: TimeGrid,
        layout: Layout,
        network: Network,
        setup: Setup,
    ) -> None:
        self.transport, self.cut = transport, cut
        self.part, self._others = transport.part, [p for p in range(cut.parts) if p != transport.part]
        self._collected = Collected()
        self._at, self._replayed, self._saving = -1, -1, 0
        self._first = 0 if setup.checkpoint is None else setup.checkpoint.k
        self._saved: Saved | None = None
        self._open: list[tuple[int, list[Given | None], Requests]] = []
        self._requests = Requests()
        self._early: dict[int, deque[Message]] = {p: deque() for p in range(cut.parts)}
        self._periods: tuple[int, ...] = ()
        self._ending = self._last_window = self._dismissed = self._begun = self.over = False
        self._failure: tuple[int, tuple[tuple[Any, ...], ...]] | None = None
        self._exchange: Exchange | None = None
        self._own_reals, self._own_ints = outputs_of_part(layout, cut.elsewhere(self.part))
        super().__init__(checked, clock, layout, network, setup)

    @property
    def _mine(self) -> Blocks:
        """The blocks of the part's own rows and packets."""
        return self.blocks

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        super()._begin(checkpoint)
        if checkpoint is not None:
            self._window(checkpoint.k)

    def _resume(self, checkpoint: Checkpoint) -> None:
        super()._resume(checkpoint)
        confine(self.state, self.cut, self.part)

    # ---- windows -----------------------------------------------------------------------------------------------------

    def agree(self, periods: Sequence[int], saving: int = 0) -> None:
        """Tells all parts the instants of the run; the arguments are those of part 0.

        Args:
            periods: their multiples are instants, in base steps.
            saving: at its multiples, there is a checkpoint; 0: there are none.
        """
        if self.part == 0:
            self._periods, self._saving = (*periods, saving) if saving else tuple(periods), saving
            for other in self._others:
                self.transport.send(other, pickle.dumps((self._periods, self._saving)))
        else:
            told = pickle.loads(self.transport.receive(0, patient=True))
            if isinstance(told, Message):
                self.over = self._dismissed = True
            else:
                self._periods, self._saving = told

    def advance(self, k_stop: int) -> None:
        """Makes windows until base step `k_stop`, or slightly further: a window is not divided.

        Raises:
            RunFailed: instances failed, in any part; the recording ends at the start of the macro step.
            PartLost: another part has ended, or does not answer.
        """
        stop = min(k_stop, self.clock.steps)
        if self._at < 0:
            self._window(self._first)
        while self._at < stop and not self.over:
            self._window(self._boundary())

    def _boundary(self, k: int | None = None) -> int:
        """Returns the end of the window that begins at base step `k`; None: the next one."""
        k = self._at if k is None else k
        instants = [(k // period + 1) * period for period in self._periods]
        return min([k + self.cut.window, self.clock.steps, *instants])

    def is_instant(self, k: int) -> bool:
        """Returns whether somebody looks at the run at base step k."""
        return k in (self._first, self.clock.steps) or any(k % period == 0 for period in self._periods)

    def _window(self, end: int) -> None:
        """Steps a window and exchanges; the end of the exchange of a hidden window is that of the next one."""
        if self._failure is None:
            try:
                super().advance(end)
            except (RunFailed, RunTerminated, FmuError) as error:
                self._failure = (max(self._algorithm_k, 0), failure_data(error))
        if self._exchange is None:
            self._mine.attach([self._collected], [self._collected])
            self._exchange = Exchange(self.state, self._mine, self.cut, self.part, self._first)
            all_ready(self.transport, ())
            self._begun = True
        self._at = end
        last = self._last_window
        self._post()
        instant = last or self.is_instant(end)
        while len(self._open) > (0 if instant or not self.cut.hidden else 1):
            self._take()
        if self._last_window and not last and len(self._open) and not self.over:
            # part 0 has asked for the end in the window before this one: this one is the last
            last = instant = True
            while self._open:
                self._take()
        if instant and not self.over:
            self._meet(last=last)

    @property
    def _algorithm_k(self) -> int:
        return self._algorithm.k

    def _post(self) -> None:
        assert self._exchange is not None
        given: list[Given | None] = [*self._exchange.outgoing()]
        report = self._report()
        pickled: dict[tuple[int, bool], bytes] = {}  # several parts may get the same
        for other in self._others:
            which = id(given[other]), other == 0
            if which not in pickled:
                asked = self._requests if self.part == 0 else None
                message = Message(given[other], report if other == 0 else None, self._ending, requests=asked)
                pickled[which] = pickle.dumps(message, protocol=5)
            self.transport.send(other, pickled[which])
        own = [given[self.part] if p == self.part else None for p in range(self.cut.parts)]
        self._open.append((self._at, own, self._requests))
        self._requests = Requests()
        if self.part == 0:
            self.reported(0, report)

    def _report(self) -> Report:
        gateways = range(len(self.network.gateways))
        leaving = tuple(self._port.take(g) for g in gateways)
        unread = tuple(self._port.waiting(g) for g in gateways)
        self._mine.rows()
        self._mine.packets()
        collected = self._collected
        kept = Collected(
            collected.ticks, collected.reals, collected.ints, collected.texts, collected.events, collected.log
        )
        for name in ("ticks", "reals", "ints", "texts", "events", "log"):
            setattr(collected, name, [])
        counters = np.array(self.state.radio.counters)
        return Report(self._at, self._replayed, kept, counters, self._failure, leaving=leaving, unread=unread)

    def _take(self) -> None:
        """Takes the messages of the oldest window that is open, and replays its packets."""
        assert self._exchange is not None
        end, given, requests = self._open[0]
        for other in self._others:
            message = self._next(other)
            if message.over:
                self.over = self._dismissed = True
                self._open.clear()
                return
            given[other] = message.given
            requests = message.requests or requests
            self._last_window = self._last_window or message.ending
            if message.report is not None:
                self.reported(other, message.report)
        self._open.pop(0)
        broken = [p for p, one in enumerate(given) if one is not None and one.broken]
        for other in self._others:
            if self._exchange.needs(other, broken):
                self.transport.send(other, pickle.dumps(self._exchange.kept_from(other), protocol=5))
        if self._exchange.needs(self.part, broken):
            given = [one if p == self.part else self._with_missing(p, one) for p, one in enumerate(given)]
        self._exchange.take([one for one in given if one is not None])
        self._replayed = end
        for gateway, packets in requests.entering:
            self._port.admit(gateway, packets)
        if self.part != 0:
            for change, k in requests.changes:
                self.agenda.request(change, k, self.clock)

    def _next(self, other: int) -> Message:
        """Returns the next message of a window from another part."""
        if self._early[other]:
            return self._early[other].popleft()
        message: Message = pickle.loads(self.transport.receive(other))
        return message

    def _with_missing(self, other: int, given: Given | None) -> Given:
        """Returns what another part has given for a window, with the packets that it had kept from this one."""
        assert given is not None
        while not isinstance(found := pickle.loads(self.transport.receive(other)), Given):
            self._early[other].append(found)
        return given.with_packets(found)

    def _meet(self, *, last: bool) -> None:
        """Reports the values of an instant to part 0, where the packets sent until then have been replayed."""
        self._replayed = self._at
        report = self._report()
        plan = self.plan
        outputs = (plan.real_out[self._own_reals], plan.int_out[self._own_ints])
        state = self._captured() if self._saving and self._at % self._saving == 0 else None
        whole = replace(report, outputs=outputs, state=state, failed=self._failure)
        if self.part != 0:
            self.transport.send(0, pickle.dumps(Message(None, whole), protocol=5))
        else:
            self.reported(0, whole)
            for other in self._others:
                message = self._next(other)
                assert message.report is not None
                self.reported(other, message.report)
        if last or self._at >= self.clock.steps:
            self.over = self.part != 0

    def _captured(self) -> PartState | None:
        """Returns what the part knows for a checkpoint; None if an FMU fails to save its state, or has failed."""
        if self._failure is not None or self._at in (self._first, self.clock.steps):
            return None
        try:
            found, self._saved = part_state(self.state, self.cut, self.part)
        except FmuError as error:
            self._failure = (self._at, failure_data(error))
            return None
        return found

    def reported(self, part: int, report: Report) -> None:
        """Receives what a part reports; only part 0 is told."""

    # ---- parts other than 0 ------------------------------------------------------------------------------------------

    def serve(self) -> None:
        """Steps until part 0 ends the run, and tells it how the instances ended.

        Raises:
            PartLost: another part has ended, or does not answer.
        """
        while not self.over:
            self._window(self._boundary())
        while not self._dismissed:
            self._dismissed = pickle.loads(self.transport.receive(0, patient=True)).over
        told = {"notes": self._notes, "restarts": self.restarts, "failures": [_data_of(one) for one in self.end()]}
        self.transport.send(0, pickle.dumps(told))

    def packet_counts(self) -> dict[str, int]:
        """Returns the numbers of packets by radio of this part."""
        return packet_counts(self.state.radio)


def failure_data(error: CosimError) -> tuple[tuple[Any, ...], ...]:
    if isinstance(error, RunTerminated):
        text = f"{error}; a run in parts cannot end early: run it in one process"
        return ((error.instance, "the end of the run", text, error.time, ()),)
    failures = error.failures if isinstance(error, RunFailed) else [error]
    return tuple(_data_of(one) for one in failures if isinstance(one, FmuError))


def _data_of(one: FmuError) -> tuple[Any, ...]:
    return (one.instance, one.function, one.status, one.time, one.log)
