"""Part 0 of a run: it records the whole run, in the order and the chunks of a run in one process."""

from __future__ import annotations

import pickle
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim_master.diagnostics.errors import FmuError, RunFailed
from cosim_master.execution.partitions.checkpoints import together
from cosim_master.execution.partitions.cut import Cut
from cosim_master.execution.partitions.part import Message, PartExecution, Report
from cosim_master.execution.partitions.transport import PartLost, Transport
from cosim_master.execution.run.blocks import Blocks
from cosim_master.execution.run.checkpoint import Saved
from cosim_master.execution.run.opening import Setup
from cosim_master.fmi.calls import KINDS
from cosim_master.network.radio.build import packet_counts
from cosim_master.network.radio.queues import LOG_HEAD
from cosim_master.network.radio.tables import EVENT
from cosim_master.stepping.confining import columns_of_part, outputs_of_part
from cosim_master.stepping.layout import Layout
from cosim_master.stepping.observation import PacketObserver, Packets, RowObserver, Rows
from cosim_master.stepping.plan import rows_of_block
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.changes import Change
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.time_grid import TimeGrid

__all__ = ["WholeBlocks", "WholeExecution"]

_EVENTS, _LOG = 4096, 1 << 20
"""Events, and bytes of the log, of a full chunk of packets."""


class _Columns:
    """The rows that a part has reported and that are not in the block yet."""

    def __init__(self, reals: np.ndarray[Any, Any], ints: np.ndarray[Any, Any], texts: Sequence[int]) -> None:
        self.real_columns, self.int_columns, self.text_columns = reals, ints, texts
        self.time = np.zeros(0)
        self.reals, self.ints = np.zeros((0, reals.size)), np.zeros((0, ints.size), dtype=np.int32)
        self.texts: list[list[str]] = []

    def add(self, report: Report) -> None:
        kept = report.collected
        if kept.ticks:
            self.time = np.concatenate([self.time, *kept.ticks])
            self.reals = np.concatenate([self.reals, *kept.reals])
            self.ints = np.concatenate([self.ints, *kept.ints])
            self.texts += kept.texts

    def drop(self, n: int) -> None:
        self.time, self.reals, self.ints = self.time[n:], self.reals[n:], self.ints[n:]
        del self.texts[:n]


class WholeBlocks:
    """The `Chunks` of a run in parts.

    Args:
        cut: the parts.
    """

    def __init__(self, layout: Layout, cut: Cut) -> None:
        kinds = [layout.ports[kind] for kind in KINDS]
        self._all_reals = np.array(kinds[0].recorded, dtype=np.int64)
        integers = len(kinds[1].outputs)
        self._all_ints = np.array([*kinds[1].recorded, *(integers + i for i in kinds[2].recorded)], dtype=np.int64)
        n = rows_of_block(layout)
        self._time, self._real_block = np.zeros(n), np.zeros((n, self._all_reals.size))
        self._int_block = np.zeros((n, self._all_ints.size), dtype=np.int32)
        self._texts: list[list[str]] = []
        self._used = 0
        number = {one.name: i for i, one in enumerate(layout.instances)}
        owners = [cut.of_instance[number[instance.name]] for _, instance, _ in layout.string_signals]
        self._parts = [
            _Columns(*columns_of_part(layout, cut.elsewhere(p)), [c for c, one in enumerate(owners) if one == p])
            for p in range(cut.parts)
        ]
        self._strings = len(owners)
        self._events, self._log, self._pending = [np.zeros(0, dtype=EVENT)], bytearray(), 0
        self._waiting: list[np.ndarray[Any, Any]] = []
        self._entries: list[tuple[int, int, int, bytes]] = []
        self._row_observers: Sequence[RowObserver] = ()
        self._packet_observers: Sequence[PacketObserver] = ()
        self._shown: dict[int, int] = {}
        self.limit: int | None = None
        """The time of the last communication point to be recorded, ns; None: all are."""
        self.last_row = np.inf
        """The same, s."""

    def attach(self, rows: Sequence[RowObserver], packets: Sequence[PacketObserver]) -> None:
        self._row_observers, self._packet_observers = rows, packets

    # ---- what the parts report ---------------------------------------------------------------------------------------

    def add(self, part: int, report: Report) -> None:
        """Keeps what a part reports until the others have reported the same time."""
        self._parts[part].add(report)
        self._waiting += [chunk for chunk in report.collected.events if chunk.size]
        for block in report.collected.log:
            self._entries += _entries(block)

    def flush(self, sent: int, logged: int) -> None:
        """Orders what all parts have reported: rows, packets sent by `sent` [ns], log entries by `logged` [ns]."""
        self._flush_rows()
        if self._waiting:
            events = np.concatenate(self._waiting)
            done = events["sent"] <= sent
            self._waiting = [events[~done]]
            events = events[done]
            if self.limit is not None:
                events = events[events["sent"] <= self.limit]
            if events.size:
                self._events.append(events[np.lexsort((events["order"], events["source"], events["sent"]))])
                self._pending += events.size
        due = [entry for entry in self._entries if entry[0] <= logged]
        self._entries = [entry for entry in self._entries if entry[0] > logged]
        due.sort(key=lambda entry: entry[:3])
        self._log += b"".join(entry[3] for entry in due if self.limit is None or entry[0] <= self.limit)
        if self._pending > _EVENTS or len(self._log) > _LOG:
            self.packets()

    def _flush_rows(self) -> None:
        ready = min(len(part.time) for part in self._parts)
        ready = int(np.searchsorted(self._parts[0].time[:ready], self.last_row, side="right"))
        while ready:
            n = min(ready, len(self._time) - self._used)
            span = slice(self._used, self._used + n)
            self._time[span] = self._parts[0].time[:n]
            texts = [[""] * self._strings for _ in range(n)] if self._strings else []
            for part in self._parts:
                self._real_block[span, part.real_columns] = part.reals[:n]
                self._int_block[span, part.int_columns] = part.ints[:n]
                for row, given in zip(texts, part.texts[:n], strict=False):
                    for column in part.text_columns:
                        row[column] = given[column]
                part.drop(n)
            self._texts += texts
            self._used += n
            ready -= n
            if self._used == len(self._time):
                self.rows()

    def record_end(self, time: float, reals: np.ndarray[Any, Any], ints: np.ndarray[Any, Any]) -> None:
        """Adds a row of values at the end of a run, s, unless it has one."""
        if self._used and self._time[self._used - 1] == time:
            return
        self._time[self._used] = time
        self._real_block[self._used], self._int_block[self._used] = reals[self._all_reals], ints[self._all_ints]
        self._texts += [self._texts[-1]] if self._texts else []
        self._used += 1
        if self._used == len(self._time):
            self.rows()

    # ---- Chunks ------------------------------------------------------------------------------------------------------

    def hand_over(self) -> None:
        self._rows(complete=False)
        self._packets(complete=False)

    def complete(self) -> None:
        self.rows()
        self.packets()

    def rows(self) -> None:
        """Hands over and empties the block of rows."""
        self._rows(complete=True)
        self._used = 0
        self._texts = []

    def packets(self) -> None:
        """Hands over and empties the packets."""
        self._packets(complete=True)
        self._events, self._log, self._pending = [np.zeros(0, dtype=EVENT)], bytearray(), 0
        self._shown.clear()

    def _rows(self, *, complete: bool) -> None:
        n = self._used
        if n:
            rows = Rows(self._time[:n], self._real_block[:n], self._int_block[:n], self._texts)
            for observer in self._row_observers:
                observer.rows(rows, complete=complete)

    def _together(self) -> Packets:
        self._events = [np.concatenate(self._events)]
        return Packets(self._events[0], np.frombuffer(bytes(self._log), dtype=np.uint8))

    def _packets(self, *, complete: bool) -> None:
        packets = self._together()
        if packets.events.size or packets.log.size:
            for observer in self._packet_observers:
                observer.packets(packets, complete=complete)

    def show_packets(self, observer: PacketObserver) -> None:
        """Hands over the packets so far to one observer."""
        packets = self._together()
        if packets.events.size > self._shown.get(id(observer), 0):
            self._shown[id(observer)] = packets.events.size
            observer.packets(packets, complete=False)


def _entries(block: bytes) -> list[tuple[int, int, int, bytes]]:
    """Returns the entries of a log with their order: time [ns], whether received, node."""
    found, at = [], 0
    while at < len(block):
        time, entry, length = struct.unpack_from("<qii", block, at)
        end = at + LOG_HEAD + length
        found.append((time, 1 - (entry & 1), entry >> 1, block[at:end]))
        at = end
    return found


class WholeExecution(PartExecution):
    """Part 0, with the interface of an `Execution` of the whole system."""

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
        self._whole = WholeBlocks(layout, cut)
        self._places = [outputs_of_part(layout, cut.elsewhere(p)) for p in range(cut.parts)]
        self._reports: list[Report | None] = [None] * cut.parts
        self._own_blocks: Blocks | None = None
        self._meeting = -1
        self._stopped: int | None = None
        self._ended = False
        self._late: list[FmuError] = []
        self._said: tuple[str, ...] = ()
        self._lost: set[int] = set()
        self._leaving: dict[int, bytes] = {}
        super().__init__(transport, cut, checked, clock, layout, network, setup)
        self._own_blocks, self.blocks = self.blocks, _Recorded(self)  # type: ignore[assignment]
        self.admit, self.take, self.waiting = self._admit, self._left, self._unread

    @property
    def _mine(self) -> Blocks:
        return self._own_blocks or self.blocks

    @property
    def whole(self) -> WholeBlocks:
        """The rows and packets of the whole run."""
        return self._whole

    @property
    def k(self) -> int:
        """The number of base steps that all parts have completed."""
        return self._at if self._stopped is None else self._stopped

    @property
    def time(self) -> float:
        """Simulation time reached by all parts, s."""
        return self.clock.time(max(self.k, 0))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of all parts; those of the others are known at the end."""
        return (*super().notes, *self._said)

    def _ns(self, k: int) -> int:
        ticks, per_ns = self.clock.start + k * self.clock.base, self.clock.per_ns
        return (ticks + per_ns // 2) // per_ns

    def reported(self, part: int, report: Report) -> None:
        self._reports[part] = report
        self._whole.add(part, report)
        for g, packets in enumerate(report.leaving):
            self._leaving[g] = self._leaving.get(g, b"") + packets
        if report.outputs is not None:
            self._meeting = report.k
            reals, ints = self._places[part]
            self.plan.real_out[reals], self.plan.int_out[ints] = report.outputs

    # ---- users: gateways and requests --------------------------------------------------------------------------------

    @property
    def entry(self) -> int:
        """The base step at which all parts have the packets that are admitted now."""
        if self._at < 0:
            return self._first
        k = self._boundary()
        return k if self.is_instant(k) or not self.cut.hidden else self._boundary(k)

    def _admit(self, gateway: int, packets: Sequence[bytes]) -> None:
        """Lets packets enter all parts at the same time: where they replay the packets of the present window."""
        if packets:
            self._requests.entering.append((gateway, list(packets)))

    def _left(self, gateway: int) -> bytes:
        return self._leaving.pop(gateway, b"")

    def _unread(self, gateway: int) -> int:
        known = [one for one in self._reports if one is not None and one.unread]
        return sum(one.unread[gateway] for one in known)

    def request(self, change: Change) -> float | None:
        """Adds a value to be set when all parts know of it: two windows later."""
        k = max(self._at, 0) + 2 * self.cut.window
        self._requests.changes.append((change, k))
        return self.agenda.request(change, k, self.clock)

    # ---- windows -----------------------------------------------------------------------------------------------------

    def _window(self, end: int) -> None:
        try:
            super()._window(end)
        except PartLost as error:
            self._lost.add(error.part)
            known = [one for one in self._reports if one is not None]
            self._stop_at(min((one.k for one in known), default=0))
            self._whole.flush(self._ns(min((one.replayed for one in known), default=0)), self._ns(self.k))
            raise
        known = [one for one in self._reports if one is not None]
        if len(known) < self.cut.parts:
            return
        if self._stopped is None and any(one.failed is not None for one in known):
            self._fail(known)
        self._whole.flush(self._ns(min(one.replayed for one in known)), self._ns(min(one.k for one in known)))

    def _fail(self, known: Sequence[Report]) -> None:
        """Ends the run at the start of the first macro step that failed, once all packets sent until then are known."""
        self._stop_at(self._first_failure(known))
        self._conclude()
        latest = [one for one in self._reports if one is not None]
        self._stop_at(stopped := self._first_failure(latest))
        self._whole.flush(self._ns(self._at), self._ns(self._at))
        failures = [
            FmuError(*data) for one in latest if one.failed and one.failed[0] == stopped for data in one.failed[1]
        ]
        order = {one.name: i for i, one in enumerate(self.checked.instances)}
        raise RunFailed(sorted(failures, key=lambda one: order.get(one.instance, -1)))

    def _stop_at(self, k: int) -> None:
        self._stopped = k
        self._whole.limit, self._whole.last_row = self._ns(k), self.clock.time(k)

    def _first_failure(self, known: Sequence[Report]) -> int:
        return min(one.failed[0] for one in known if one.failed is not None)

    def settle(self) -> Saved:
        """Returns the state of the whole system at a checkpoint; see `Execution.settle`."""
        self.blocks.rows()
        self.blocks.packets()
        states = [one.state for one in self._reports if one is not None and one.state is not None]
        assert self._saved is not None
        assert len(states) == self.cut.parts
        return together(self.state, self.cut, self._saved, states)

    def conclude(self) -> None:
        """Goes on to an instant, so that everything that was sent until then is known; for the end of a run."""
        if self._stopped is None and not self._lost:
            self._conclude()

    def _conclude(self) -> None:
        if self._meeting == self._at or self._last_window:
            return
        self._ending = True
        self._window(self._boundary())
        self._ending = False
        if self._meeting != self._at:
            self._last_window = True
            self._window(self._boundary())

    def record_end(self) -> None:
        """Records a row of the present instant, with which the run ends."""
        self._whole.record_end(self.time, self.plan.real_out, self.plan.int_out)

    def packet_counts(self) -> dict[str, int]:
        """Returns the numbers of packets by radio, of all parts."""
        counters = np.sum([one.counters for one in self._reports if one is not None], axis=0)
        radio = self.state.radio
        return packet_counts(radio._replace(counters=counters if np.ndim(counters) else radio.counters))

    def end(self) -> list[FmuError]:
        """Ends all parts and frees the own instances; returns the errors."""
        if not self._ended:
            self._ended = True
            for other in self._others:
                if self._begun and not self._lost:
                    self._dismiss(other)
        failures = [*super().end(), *self._late]
        self._late = []
        return failures

    def _dismiss(self, other: int) -> None:
        try:
            self.transport.send(other, pickle.dumps(Message(None, over=True)))
            while not isinstance(told := pickle.loads(self.transport.receive(other)), dict):
                pass
        except PartLost as error:
            self._lost.add(error.part)
            self._said += (str(error),)
            return
        self._late += [FmuError(*data) for data in told["failures"]]
        self._said += (*told["notes"], *told["restarts"])


class _Recorded:
    """The blocks of a `WholeExecution`, for its observers and the pacing of the run."""

    def __init__(self, execution: WholeExecution) -> None:
        self._execution, whole = execution, execution.whole
        self.attach, self.hand_over, self.complete = whole.attach, whole.hand_over, whole.complete
        self.show_packets, self.rows, self.packets = whole.show_packets, whole.rows, whole.packets
        self.record_end = execution.record_end
