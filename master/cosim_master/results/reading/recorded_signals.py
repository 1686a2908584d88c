"""The recorded signals of a run folder, whether the run is complete, in progress, or was killed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.results.storage.journal import journal_of, read_journal
from cosim_master.results.storage.manifest_file import no_run

__all__ = ["Signals", "open_signals"]


class Signals(AbstractContextManager["Signals"], Protocol):
    """Recorded signals that are open: a `pyarrow.parquet.ParquetFile`, for example."""

    @property
    def schema_arrow(self) -> pa.Schema: ...
    def read(self, columns: list[str] | None = None) -> pa.Table: ...
    def iter_batches(self, batch_size: int, columns: list[str] | None = None) -> Iterator[pa.RecordBatch]: ...
    def close(self) -> None: ...


class _Unfinished:
    """The signals of a run that is in progress, or whose process was killed."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self.schema_arrow = table.schema

    def read(self, columns: Sequence[str] | None = None) -> pa.Table:
        return self._table if columns is None else self._table.select(list(columns))

    def iter_batches(self, batch_size: int, columns: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        yield from self.read(columns).to_batches(max_chunksize=batch_size)

    def close(self) -> None:
        pass

    def __enter__(self) -> _Unfinished:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def open_signals(run: Path) -> Signals:
    """Opens the signals that a run folder contains so far; the caller closes them.

    Raises:
        SystemDescriptionError: the folder has no signals, or they cannot be read.
    """
    if (journal := journal_of(run, "signals")) is not None:
        return _Unfinished(read_journal(journal))
    file = run / "signals.parquet"
    if not file.is_file():
        raise SystemDescriptionError([Problem(Where(str(run)), no_run(run, file.name))])
    try:
        signals: Signals = pq.ParquetFile(file)
    except (pa.ArrowException, OSError) as error:
        text = f"not a complete Parquet file; the run that wrote it was cut short ({error})"
        raise SystemDescriptionError([Problem(Where(str(file)), text)]) from error
    if "time" not in signals.schema_arrow.names:
        signals.close()
        text = "no column `time`; the signals of a run begin with one"
        raise SystemDescriptionError([Problem(Where(str(file)), text)])
    return signals
