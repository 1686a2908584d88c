"""The recorder of signals: an observer that writes signals.parquet and its journal."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cosim_master.diagnostics.errors import RecordingFailed
from cosim_master.results.recording.table_file import TableFile
from cosim_master.results.storage.columns import Columns
from cosim_master.stepping.observation import Rows, Seen

__all__ = ["SignalRecorder"]

_GROUP_BYTES = 32 << 20
"""Values of a row group. Each column of a row group takes 20 us, however short it is."""


class SignalRecorder:
    """Writes rows to the journal as soon as it receives them, and collects them for the file.

    Row groups have the same number of rows, except where checkpoints end them, and do not depend on the chunks.
    """

    every = 0

    def __init__(self, file: TableFile, columns: Columns) -> None:
        self._file, self._columns = file, columns
        self._seen = 0  # rows of the chunk that are in the journal and the row group
        reals, integers, _ = columns.widths
        self._room = max(16, min(_GROUP_BYTES // (8 * reals + 4 * integers + 8), 1 << 18))
        self._texts, self._used = list[list[str]](), 0
        # two, since one is written by another thread while the next one is collected
        self._both = [self._buffers(reals, integers) for _ in range(2)]

    def _buffers(self, reals: int, integers: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Returns buffers for times, real and integer values of a row group."""
        return np.empty(self._room), np.empty((self._room, reals)), np.empty((self._room, integers), np.int32)

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def rows(self, rows: Rows, *, complete: bool) -> None:
        """Writes rows.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        file, n = self._file, len(rows.time)
        while self._seen < n and not (file.faults.journal and file.faults.files):
            end = n if file.faults.files else min(n, self._seen + self._room - self._used)
            part = rows.between(self._seen, end)
            if not file.faults.journal:
                with file.faults.noted(file.journal_file):
                    file.journal.rows(part)
            self._seen = end
            if not file.faults.files:
                self._collect(part)
                if self._used == self._room:
                    self.end_group()
        if complete:
            self._seen = 0

    def _collect(self, rows: Rows) -> None:
        first, self._used = self._used, self._used + len(rows.time)
        for buffer, values in zip(self._both[0], (rows.time, rows.reals, rows.integers), strict=True):
            buffer[first : self._used] = values
        self._texts += map(list, rows.texts)

    def end_group(self) -> None:
        """Writes the rows collected as a row group.

        Raises:
            RecordingFailed: a file cannot be written. If it is the journal, the row group may be written again.
        """
        used = self._used
        if used and not self._file.faults.files:
            time, reals, integers = self._both[0]
            rows = Rows(time[:used], reals[:used], integers[:used], list(self._texts))
            self._file.write(used, partial(self._columns.table, rows))
            self._both.reverse()
        self._used = 0
        self._texts.clear()

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table.num_rows, lambda: table)
        self._file.journal.rows(self._columns.rows(table))
        self._file.journal.end_group("signals")

    def closed(self) -> None:
        """Completes the file.

        Raises:
            RecordingFailed: it cannot be completed; the journal remains.
        """
        with suppress(RecordingFailed):  # of the journal alone: the file can do without the end of a group in it
            self.end_group()
        self.end_group()
        self._file.close()
