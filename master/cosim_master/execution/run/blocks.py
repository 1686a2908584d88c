"""The blocks in which the loop collects rows and packets: handed over to observers before they are full."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.packets import MAX_PACKET
from cosim_master.diagnostics.errors import RecordingFailed, RunFailed
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.tables import IN_FLIGHT, USED_EVENTS, USED_LOG, Radio
from cosim_master.stepping.kernels.macro_step import places_needed, record, sent_bytes
from cosim_master.stepping.kernels.tables import EVERY, PER_NS, ROWS, K
from cosim_master.stepping.observation import PacketObserver, Packets, RowObserver, Rows

__all__ = ["Blocks", "Recorded"]


@dataclass(frozen=True, slots=True)
class Recorded:
    """The rows that were not yet handed over as a complete chunk when a run went back to repeat steps."""

    k: int
    radio: Radio
    blocks: tuple[np.ndarray[Any, Any], ...]
    texts: Sequence[list[str]]


class Blocks:
    """The `Chunks` of a run; until observers are attached, the blocks are only emptied.

    Args:
        phase: measures the time of a phase.

    Attributes:
        emptied: how many times blocks have been emptied; rows and packets before that cannot be taken back.
    """

    def __init__(self, state: RunState, phase: Callable[[str], AbstractContextManager[Any]]) -> None:
        self._state, self._phase, self.emptied = state, phase, 0
        self._row_observers: Sequence[RowObserver] = ()
        self._packet_observers: Sequence[PacketObserver] = ()
        self._texts: list[list[str]] = []
        self._shown: dict[int, int] = {}  # events that observers have seen, by id of the observer

    def attach(self, rows: Sequence[RowObserver], packets: Sequence[PacketObserver]) -> None:
        self._row_observers, self._packet_observers = rows, packets

    def hand_over(self) -> None:
        self._hand_over_rows(complete=False)
        self._hand_over_packets(complete=False)

    def complete(self) -> None:
        with suppress(RecordingFailed):  # a file may be able to hold values that a journal cannot, and vice versa
            self.hand_over()
        try:
            self.rows()
        finally:
            self.packets()

    # ---- rows --------------------------------------------------------------------------------------------------------

    def rows(self) -> None:
        """Hands over and empties the block of rows."""
        self._hand_over_rows(complete=True)
        self._state.plan.counters[ROWS] = 0
        self._texts.clear()
        self.emptied += 1

    def record_end(self) -> None:
        """Records a row of the current communication point, with which the run ends, unless it has one."""
        plan = self._state.plan
        if int(plan.counters[K]) % int(plan.counters[EVERY]):
            if int(plan.counters[ROWS]) == plan.ticks.size:
                self.rows()
            record(plan)
            if self._state.texts:
                self.read_texts(recorded=True)

    def _hand_over_rows(self, *, complete: bool) -> None:
        plan, n = self._state.plan, int(self._state.plan.counters[ROWS])
        if self._state.layout.string_signals:
            n = min(n, len(self._texts))  # after an interruption, the last row may lack its Strings
        if not n or not self._row_observers:
            return
        time = plan.ticks[:n] / (1e9 * plan.counters[PER_NS])
        rows = Rows(time, _read_only(plan.real_block[:n]), _read_only(plan.int_block[:n]), self._texts[:n])
        with self._phase("write results"):
            for observer in self._row_observers:
                observer.rows(rows, complete=complete)

    def read_texts(self, *, recorded: bool) -> None:
        """Reads the Strings at the end of a macro step; `recorded`: the block has a row of this time.

        Raises:
            RunFailed: an instance refuses.
        """
        state = self._state
        try:
            state.texts.get_outputs(state.plan, state.event_mode.events.kept)
        except RunFailed:
            state.plan.counters[ROWS] -= int(recorded)  # a row without its strings is incomplete
            raise
        if recorded and state.layout.string_signals:
            self._texts.append(state.texts.row)

    def by_signal(self) -> dict[str, np.ndarray[Any, Any]]:
        """Returns the rows in the block, by signal."""
        plan, signals = self._state.plan, self._state.layout.signals
        n = int(plan.counters[ROWS])
        blocks = (
            (signals["Real"], plan.real_block),
            ((*signals["Integer"], *signals["Boolean"]), plan.int_block),
        )
        found = {}
        for columns, block in blocks:
            first = 0
            for name, variable in columns:
                found[name] = block[:n, first : first + 1 + variable.wide].copy()
                first += 1 + variable.wide
        return found

    def recorded(self) -> Recorded:
        """Returns a copy of the rows in the block, and the radio, for `put_back`."""
        plan, n = self._state.plan, int(self._state.plan.counters[ROWS])
        blocks = tuple(block[:n].copy() for block in (plan.ticks, plan.real_block, plan.int_block))
        return Recorded(int(plan.counters[K]), self._state.radio, blocks, list(self._texts))

    def put_back(self, done: Recorded) -> None:
        """Restores the block to its contents before a repetition that failed."""
        plan, n = self._state.plan, len(done.blocks[0])
        plan.ticks[:n], plan.real_block[:n], plan.int_block[:n] = done.blocks
        plan.counters[ROWS], plan.counters[K], self._state.radio = n, done.k, done.radio
        self._texts[:] = done.texts

    def take_back(self) -> None:
        """Discards the Strings of rows that are not in the block, because the run has gone back to an earlier time."""
        del self._texts[int(self._state.plan.counters[ROWS]) :]

    # ---- packets -----------------------------------------------------------------------------------------------------

    def packets(self) -> None:
        """Hands over and empties the blocks of packets."""
        self._hand_over_packets(complete=True)
        self._state.radio.counters[[USED_EVENTS, USED_LOG]] = 0
        self._shown.clear()
        self.emptied += 1

    def _hand_over_packets(self, *, complete: bool) -> None:
        radio = self._state.radio
        events, log = int(radio.counters[USED_EVENTS]), int(radio.counters[USED_LOG])
        if not (events or log) or not self._packet_observers:
            return
        packets = Packets(_read_only(radio.events[:events]), _read_only(radio.log[:log]))
        with self._phase("write results"):
            for observer in self._packet_observers:
                observer.packets(packets, complete=complete)

    def show_packets(self, observer: PacketObserver) -> None:
        radio = self._state.radio
        events = int(radio.counters[USED_EVENTS])
        if events > self._shown.get(id(observer), 0):
            self._shown[id(observer)] = events
            log = int(radio.counters[USED_LOG])
            observer.packets(Packets(_read_only(radio.events[:events]), _read_only(radio.log[:log])), complete=False)

    def make_room(self, events: int, log: int) -> None:
        """Ensures that at least this many rows of events and bytes of the log are free."""
        radio = self._state.radio
        if not radio.settings[0]["keep"]:
            return
        used = radio.counters
        if used[USED_EVENTS] + events <= radio.events.size and used[USED_LOG] + log <= radio.log.size:
            return
        self.packets()
        if events > radio.events.size:
            radio = radio._replace(events=np.zeros(2 * events, dtype=radio.events.dtype))
        if log > radio.log.size:
            radio = radio._replace(log=np.zeros(2 * log, dtype=np.uint8))
        self._state.radio = radio

    def make_room_for_a_step(self) -> None:
        """Hands over the blocks of packets, and makes them large enough for the next macro step."""
        state = self._state
        self.packets()
        sending = 3 * int(sent_bytes(state.plan))
        delivering = (int(state.radio.counters[IN_FLIGHT]) + 64) * (MAX_PACKET + 16)
        self.make_room(int(places_needed(state.plan, state.radio)), max(sending, delivering))


def _read_only(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    view = values.view()
    view.flags.writeable = False
    return view
