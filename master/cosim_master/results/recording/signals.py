"""The recorder of signals: an observer that writes signals.parquet and its journal.

Three threads do it. The run's own copies a chunk to memory that is still in the processor's cache. The second appends
it to the journal. The third, that of the file, divides it into columns; when a row group is complete, it encodes and
writes them.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import DTypeLike, NDArray

from cosim_master.results.recording.behind import Behind, Lent
from cosim_master.results.recording.table_file import TableFile
from cosim_master.results.storage.columns import Columns
from cosim_master.stepping.observation import Rows, Seen

__all__ = ["SignalRecorder"]

_GROUP_BYTES, _WIDE_GROUP_BYTES, _GROUP_ROWS = 32 << 20, 256 << 20, 128
"""Values of a row group; more in tables so wide that they would have fewer rows, since each column of a row group takes
20 us, however short it is."""
_CHUNK_BYTES, _CHUNKS = 1 << 20, 16
"""Values of a chunk, and chunks between the threads. Encoding a row group must not take longer than a run takes to fill
these."""


class SignalRecorder:
    """Writes rows to the journal as soon as it receives them, and collects them for the file.

    Row groups have the same number of rows, except where checkpoints end them, and do not depend on the chunks.

    Args:
        file: the file of signals.
        behind: the thread that writes the journal.
    """

    every = 0

    def __init__(self, file: TableFile, columns: Columns, behind: Behind) -> None:
        self._file, self._columns, self._behind = file, columns, behind
        self._seen = 0  # rows of the chunk that are taken
        reals, integers, _ = columns.widths
        width = 8 * reals + 4 * integers + 8
        wide = min(_WIDE_GROUP_BYTES // width, _GROUP_ROWS)
        self._room, self._used = max(16, wide, min(_GROUP_BYTES // width, 1 << 18)), 0
        self._group = _Group(columns, self._room)
        self._longest = min(self._room, max(16, _CHUNK_BYTES // width))
        self._chunks = Lent(self._chunk, _CHUNKS)

    def _chunk(self) -> Rows:
        n, (reals, integers, _) = self._longest, self._columns.widths
        return Rows(np.empty(n), np.empty((n, reals)), np.empty((n, integers), np.int32))

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def rows(self, rows: Rows, *, complete: bool) -> None:
        """Writes rows.

        Raises:
            RecordingFailed: a file cannot be written; these rows or earlier ones are missing in it.
        """
        faults, n = self._file.faults, len(rows.time)
        while self._seen < n and not (faults.journal and faults.files):
            end = min(n, self._seen + min(self._longest, self._room - self._used))
            self._take(rows.between(self._seen, end))
            self._used += end - self._seen
            self._seen = end
            if self._used == self._room:
                self.end_group()
        faults.check()
        if complete:
            self._seen = 0

    def _take(self, rows: Rows) -> None:
        chunk = self._chunks.take()
        part = chunk.between(0, len(rows.time))
        part.time[:], part.reals[:], part.integers[:] = rows.time, rows.reals, rows.integers
        texts = [list(row) for row in rows.texts]
        self._behind.call(partial(self._write, chunk, Rows(part.time, part.reals, part.integers, texts)))

    def _write(self, chunk: Rows, rows: Rows) -> None:
        """Appends rows, which are in `chunk`, to the journal and the row group."""
        if not self._file.faults.journal:
            with self._file.in_journal() as journal:
                journal.rows(rows)
        self._file.behind.call(partial(self._collect, chunk, rows))

    def _collect(self, chunk: Rows, rows: Rows) -> None:
        self._group.add(rows)
        self._chunks.give_back(chunk)

    def end_group(self) -> None:
        """Writes the rows so far as a row group."""
        if self._used:
            self._behind.call(partial(self._file.end_group, self._used, self._group.table))
        self._used = 0

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table.num_rows, lambda: table)
        self._file.behind.wait()
        self._file.journal.rows(self._columns.rows(table))
        self._file.journal.end_group("signals")

    def closed(self) -> None:
        """Begins to complete the file."""
        self.end_group()
        self._behind.call(self._file.close)


class _Group:
    """The rows of a row group, in columns."""

    def __init__(self, columns: Columns, room: int) -> None:
        reals, integers, _ = columns.widths
        self._columns, self._used = columns, 0
        self._time, self._texts = _pages((room,), float), list[Sequence[str]]()
        self._reals, self._integers = _pages((reals, room), float), _pages((integers, room), np.int32)

    def add(self, rows: Rows) -> None:
        """Adds rows."""
        first, self._used = self._used, self._used + len(rows.time)
        span = slice(first, self._used)
        self._time[span], self._reals[:, span], self._integers[:, span] = rows.time, rows.reals.T, rows.integers.T
        self._texts.extend(rows.texts)

    def table(self) -> pa.Table:
        """Returns the rows as a table, which is valid until the next row is added, and begins a new group."""
        used, texts = slice(self._used), self._texts
        self._used, self._texts = 0, []
        return self._columns.table(self._time[used], self._reals[:, used], self._integers[:, used], texts)


def _pages(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Returns an array whose memory is taken page by page, where it is used: a short run has a row group for itself."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.ndarray(shape, dtype, mmap.mmap(-1, size) if size else None)
