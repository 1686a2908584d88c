"""A Parquet file of a run in progress: its row groups, in the file and in the segments of checkpoints."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import RecordingFailed
from cosim_master.results.storage.journal import FOLDER, Journal
from cosim_master.results.storage.parquet import ROW_GROUP

__all__ = ["Faults", "TableFile"]


class Faults:
    """The files of a recording that could not be written.

    Attributes:
        journal: whether the journal is among them; it is not written again.
        files: whether a file of the finished run is among them; the files are not completed.
        failure: the first error of a file of the finished run; None if there is none.
    """

    def __init__(self) -> None:
        self.journal = self.files = False
        self.failure: RecordingFailed | None = None

    @contextmanager
    def noted(self, file: Path) -> Iterator[None]:
        """Raises RecordingFailed if the file cannot be written."""
        try:
            yield
        except OSError as error:
            failure = RecordingFailed(str(file), os.strerror(error.errno) if error.errno else str(error))
            if file.suffix == ".arrows":
                self.journal = True
            else:
                self.files, self.failure = True, self.failure or failure
            raise failure from None


class TableFile:
    """A table of a run: signals or packets.

    Args:
        folder: the folder of the run's results.
        what: "signals" or "packets".
        writer: writes the file.
        journal: the journal of the run.
        in_segments: also write the row groups to segments for checkpoints.

    Attributes:
        groups: the number of row groups written.
    """

    def __init__(
        self, folder: Path, what: str, writer: Any, journal: Journal, faults: Faults, *, in_segments: bool
    ) -> None:
        self.journal, self.faults, self.groups = journal, faults, 0
        self._file = folder / FOLDER / f"{what}.parquet"
        self._what, self._writer, self._in_segments = what, writer, in_segments
        self._segment_file = folder / "checkpoints" / f"{what}.parquet"
        self._segment: Any = None
        self._thread = ThreadPoolExecutor(1, f"{what} of a run")
        self._pending: Future[None] | None = None

    @property
    def journal_file(self) -> Path:
        return self._file.with_suffix(".arrows")

    def write(self, rows: int, make: Callable[[], pa.Table]) -> None:
        """Marks the end of a row group in the journal, and writes it to the file.

        Args:
            rows: the number of rows.
            make: makes the table, in another thread; its data must not change until the next call.

        Raises:
            RecordingFailed: a file cannot be written; the same row group may then be given again.
        """
        if not self.faults.journal:
            with self.faults.noted(self.journal_file):
                self.journal.end_group(self._what)
        with self.faults.noted(self._file):
            self.append(rows, make)

    def append(self, rows: int, make: Callable[[], pa.Table]) -> None:
        """Writes a row group to the file alone, as `write` does; the one before is complete then.

        numpy and pyarrow sort and compress without the interpreter's lock, so the run goes on meanwhile.

        Raises:
            OSError: this row group or the one before cannot be written.
        """
        self._wait()
        self.groups += -(-rows // ROW_GROUP) or 1
        self._pending = self._thread.submit(self._append, make)

    def _wait(self) -> None:
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.result()

    def _append(self, make: Callable[[], pa.Table]) -> None:
        table = make()
        self._writer.write_table(table)
        if self._in_segments:
            if self._segment is None:
                self._segment_file.parent.mkdir(exist_ok=True)
                self._segment = pq.ParquetWriter(self._segment_file, table.schema, compression="zstd")
            self._segment.write_table(table)

    def segment(self) -> list[Path]:
        """Returns the complete segment since the last call, if it has rows; the caller then owns it.

        Raises:
            RecordingFailed: a row group cannot be written.
        """
        with self.faults.noted(self._file):
            self._wait()
        if self._segment is None:
            return []
        self._segment.close()
        self._segment = None
        return [self._segment_file]

    def close(self) -> None:
        """Completes the file.

        Raises:
            RecordingFailed: it cannot be completed.
        """
        if not self.faults.files:
            with self.faults.noted(self._file):
                for segment in self.segment():
                    segment.unlink()
                self._writer.close()

    def stop(self) -> None:
        """Ends the thread, after the row group that it is writing."""
        self._thread.shutdown()
