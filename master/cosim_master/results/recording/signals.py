"""The recorder of signals: an observer that writes signals.parquet and its journal."""

from __future__ import annotations

import pyarrow as pa

from cosim_master.results.recording.table_file import TableFile
from cosim_master.results.storage.columns import Columns
from cosim_master.stepping.observation import Rows, Seen

__all__ = ["SignalRecorder"]


class SignalRecorder:
    """Writes rows to the journal as soon as it receives them, and complete chunks as row groups of the file."""

    every = 0

    def __init__(self, file: TableFile, columns: Columns) -> None:
        self._file, self._columns = file, columns
        self._in_journal = 0

    def initialised(self, seen: Seen) -> None: ...
    def stepped(self, seen: Seen) -> None: ...

    def rows(self, rows: Rows, *, complete: bool) -> None:
        """Writes rows.

        Raises:
            RecordingFailed: a file cannot be written.
        """
        file, n = self._file, len(rows.time)
        if n > self._in_journal and not file.faults.journal:
            with file.faults.noted(file.journal_file):
                file.journal.rows(rows.after(self._in_journal))
            self._in_journal = n
        if complete and not file.faults.files:
            file.write(self._columns.table(rows))
            self._in_journal = 0

    def take_over(self, table: pa.Table) -> None:
        """Appends a row group of an earlier recording. Raises OSError."""
        self._file.append(table)
        self._file.journal.rows(self._columns.rows(table))
        self._file.journal.end_group("signals")

    def closed(self) -> None:
        """Completes the file.

        Raises:
            RecordingFailed: it cannot be completed; the journal remains.
        """
        self._file.close()
