"""A Parquet file of a run in progress: its row groups, in the file and in the segments of checkpoints."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import RecordingFailed
from cosim_master.results.recording.behind import Behind
from cosim_master.results.storage.journal import FOLDER, Journal
from cosim_master.results.storage.parquet import ROW_GROUP

__all__ = ["Faults", "TableFile"]

_AHEAD = 16
"""Calls that wait for the thread of a file."""


class Faults:
    """The files of a recording that could not be written. Any thread may note one; the run's own thread raises it.

    Attributes:
        journal: whether the journal is among them; it is not written again.
        files: whether a file of the finished run is among them; the files are not completed.
        failure: the first error of a file of the finished run; None if there is none.
    """

    def __init__(self) -> None:
        self.journal = self.files = False
        self.failure: RecordingFailed | None = None
        self._new: RecordingFailed | None = None

    @contextmanager
    def noted(self, file: Path) -> Iterator[None]:
        """Notes if the file cannot be written."""
        try:
            yield
        except OSError as error:
            failure = RecordingFailed(str(file), os.strerror(error.errno) if error.errno else str(error))
            if file.suffix == ".arrows":
                self.journal = True
            elif file.suffix != ".json":
                self.files, self.failure = True, self.failure or failure
            self._new = failure

    def check(self) -> None:
        """Raises RecordingFailed if a file could not be written since the last call."""
        failure, self._new = self._new, None
        if failure is not None:
            raise failure


class TableFile:
    """A table of a run: signals or packets.

    A thread of its own writes it: numpy and pyarrow sort and compress without the interpreter's lock, so the run goes
    on meanwhile.

    Args:
        folder: the folder of the run's results.
        what: "signals" or "packets".
        writer: writes the file.
        journal: the journal of the run.
        in_segments: also write the row groups to segments for checkpoints.

    Attributes:
        behind: the thread.
        groups: the number of row groups given.
    """

    def __init__(
        self, folder: Path, what: str, writer: Any, journal: Journal, faults: Faults, *, in_segments: bool
    ) -> None:
        self.journal, self.faults, self.groups = journal, faults, 0
        self._file = folder / FOLDER / f"{what}.parquet"
        self._what, self._writer, self._in_segments = what, writer, in_segments
        self._segment_file = folder / "checkpoints" / f"{what}.parquet"
        self._segment: Any = None
        self.behind = Behind(f"{what} of a run", _AHEAD)

    @contextmanager
    def in_journal(self) -> Iterator[Journal]:
        """Yields the journal, and notes if it cannot be written."""
        with self.faults.noted(self._file.with_suffix(".arrows")):
            yield self.journal

    def end_group(self, rows: int, make: Callable[[], pa.Table]) -> None:
        """Marks the end of a row group in the journal, and writes it to the file, as `append` does."""
        if not self.faults.journal:
            with self.in_journal() as journal:
                journal.end_group(self._what)
        self.append(rows, make)

    def append(self, rows: int, make: Callable[[], pa.Table]) -> None:
        """Writes a row group to the file alone, in its thread.

        Args:
            rows: the number of rows.
            make: makes the table, in that thread.
        """
        self.groups += -(-rows // ROW_GROUP) or 1
        self.behind.call(lambda: self._append(make))

    def _append(self, make: Callable[[], pa.Table]) -> None:
        table = make()
        if self.faults.files:
            return
        with self.faults.noted(self._file):
            self._writer.write_table(table)
            if self._in_segments:
                if self._segment is None:
                    self._segment_file.parent.mkdir(exist_ok=True)
                    self._segment = pq.ParquetWriter(self._segment_file, table.schema, compression="zstd")
                self._segment.write_table(table)

    def segment(self) -> list[Path]:
        """Returns the complete segment since the last call, if it has rows; the caller then owns it.

        The calls of the thread must have been waited for.
        """
        if self._segment is None:
            return []
        with self.faults.noted(self._file):
            self._segment.close()
        self._segment = None
        return [self._segment_file]

    def close(self) -> None:
        """Completes the file, in its thread."""
        self.behind.call(self._close)

    def _close(self) -> None:
        if self.faults.files:
            return
        with self.faults.noted(self._file):
            for segment in self.segment():
                segment.unlink()
            self._writer.close()
