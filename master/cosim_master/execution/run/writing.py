"""Writes the blocks of rows and packets of a run to the recording before they are full."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.packets import MAX_PACKET
from cosim_master.diagnostics.errors import RunFailed
from cosim_master.execution.run.state import RunState
from cosim_master.network.radio.tables import IN_FLIGHT, USED_EVENTS, USED_LOG, Radio
from cosim_master.results.checkpoint_folder import Position
from cosim_master.results.recorder import Recorder
from cosim_master.stepping.kernels.macro_step import places_needed, sent_bytes
from cosim_master.stepping.kernels.tables import ROWS, K

__all__ = ["Recorded", "Writing"]


@dataclass(frozen=True, slots=True)
class Recorded:
    """The part of the recording that was not yet written out when a run went back to repeat steps."""

    k: int
    radio: Radio
    blocks: tuple[np.ndarray[Any, Any], ...]
    texts: Sequence[list[str]]


class Writing:
    """Writes the rows and packets of a run; until it has a recorder it only empties their blocks.

    Args:
        phase: measures the time of a phase.
    """

    def __init__(self, state: RunState, phase: Callable[[str], AbstractContextManager[Any]]) -> None:
        self._state, self._phase = state, phase
        self._recorder: Recorder | None = None
        self._finished = False

    def open(self, recorder: Recorder) -> None:
        """Sets the recorder, when the start of the run can no longer fail."""
        self._recorder = recorder

    # ---- rows --------------------------------------------------------------------------------------------------------

    def rows(self) -> None:
        """Writes the rows of the block and empties it."""
        if self._recorder is not None:
            with self._phase("write results"):
                self._recorder.rows(self._state.plan)
        self._state.plan.clock[ROWS] = 0

    def read_texts(self, *, recorded: bool) -> None:
        """Reads the Strings at the end of a macro step; `recorded`: the block has a row of this time.

        Raises:
            RunFailed: an instance refuses.
        """
        state = self._state
        try:
            state.texts.get_outputs(state.plan, state.event_mode.events.kept)
        except RunFailed:
            state.plan.clock[ROWS] -= int(recorded)  # a row without its strings is incomplete
            raise
        if recorded and self._recorder is not None and state.layout.string_signals:
            self._recorder.texts(state.texts.row)

    def by_signal(self) -> dict[str, np.ndarray[Any, Any]]:
        """Returns the rows that have not been written out, by signal."""
        plan, signals = self._state.plan, self._state.layout.signals
        n = int(plan.clock[ROWS])
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
        """Returns a copy of the rows that have not been written out, and the radio, for `put_back`."""
        plan, n = self._state.plan, int(self._state.plan.clock[ROWS])
        blocks = tuple(block[:n].copy() for block in (plan.ticks, plan.real_block, plan.int_block))
        texts = [] if self._recorder is None else self._recorder.unwritten_texts()
        return Recorded(int(plan.clock[K]), self._state.radio, blocks, texts)

    def put_back(self, done: Recorded) -> None:
        """Restores the recording to its state before a repetition that failed."""
        plan, n = self._state.plan, len(done.blocks[0])
        plan.ticks[:n], plan.real_block[:n], plan.int_block[:n] = done.blocks
        plan.clock[ROWS], plan.clock[K], self._state.radio = n, done.k, done.radio
        if self._recorder is not None:
            self._recorder.take_back()
            for row in done.texts:
                self._recorder.texts(row)

    def take_back(self) -> None:
        """Discards the rows that have not been written out, because the run has gone back to an earlier time."""
        if self._recorder is not None:
            self._recorder.take_back()

    # ---- packets -----------------------------------------------------------------------------------------------------

    def packets(self) -> None:
        """Writes packet events and logs and empties their blocks."""
        if self._recorder is not None:
            with self._phase("write results"):
                self._recorder.packets(self._state.radio)
        self._state.radio.counters[[USED_EVENTS, USED_LOG]] = 0

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
        """Writes the packet blocks out, and makes them large enough for the next macro step."""
        state = self._state
        self.packets()
        sending = 3 * int(sent_bytes(state.plan))
        delivering = (int(state.radio.counters[IN_FLIGHT]) + 64) * (MAX_PACKET + 16)
        self.make_room(int(places_needed(state.plan, state.radio)), max(sending, delivering))

    # ---- the files ---------------------------------------------------------------------------------------------------

    def position(self) -> Position:
        """Returns the position reached in the recording."""
        return Position() if self._recorder is None else self._recorder.position()

    def segments(self) -> Sequence[Path]:
        """Returns the files with the recording since the last checkpoint."""
        return () if self._recorder is None else self._recorder.segments()

    def keep(self, progress: Mapping[str, Any]) -> None:
        """Makes all values recorded so far readable, even if the process is killed; only between macro steps.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        if self._recorder is not None:
            with self._phase("write results"):
                self._recorder.keep(self._state.plan, self._state.radio, progress)

    def finish(self) -> None:
        """Completes the recording except for its manifest.

        Raises:
            RecordingFailed: it cannot be completed.
        """
        self._finished = True
        if self._recorder is not None:
            self._recorder.finish(self._state.plan, self._state.radio)

    def break_off(self, progress: Mapping[str, Any]) -> None:
        """Leaves the recording in the state of a killed process, without losing any of it."""
        if self._recorder is not None and not self._finished:
            self._recorder.break_off(self._state.plan, self._state.radio, progress)

    def abandon(self) -> None:
        """Ends the recording of a run that has not begun."""
        if self._recorder is not None:
            self._recorder.abandon()

    def write_manifest(self, manifest: Callable[[], Mapping[str, Any]]) -> None:
        """Writes the manifest, in place of an earlier one.

        Raises:
            RecordingFailed: it cannot be written.
        """
        if self._recorder is not None:
            self._recorder.write_manifest(manifest())
