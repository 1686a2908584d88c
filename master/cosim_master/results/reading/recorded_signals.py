"""The recorded signals of a run folder, whether the run is complete, in progress, or was killed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.results.storage.journal import journal_of, read_journal
from cosim_master.results.storage.manifest_file import no_run

__all__ = ["Recorded", "Signals", "open_signals"]


class Signals(AbstractContextManager["Signals"], Protocol):
    """Recorded signals that are open. Its methods raise `SystemDescriptionError` where the recording is damaged."""

    @property
    def schema_arrow(self) -> pa.Schema: ...
    def read(self, columns: list[str] | None = None) -> pa.Table: ...
    def iter_batches(self, batch_size: int, columns: list[str] | None = None) -> Iterator[pa.RecordBatch]: ...
    def close(self) -> None: ...


class Recorded:
    """The signals or the packets of a run that has ended: a Parquet file, whose damage is told as such.

    Raises:
        SystemDescriptionError: the file cannot be read. All methods raise it, too.
    """

    def __init__(self, file: Path) -> None:
        self._path = file
        with self._read("not a complete Parquet file; the run that wrote it was cut short"):
            self._file = pq.ParquetFile(file)
            self.schema_arrow = self._file.schema_arrow
            self.schema_arrow.names  # noqa: B018 (are decoded)

    def read(self, columns: list[str] | None = None) -> pa.Table:
        with self._read():
            return _with_valid_texts(self._file.read(columns=columns))

    def iter_batches(self, batch_size: int, columns: list[str] | None = None) -> Iterator[pa.RecordBatch]:
        batches = self._file.iter_batches(batch_size=batch_size, columns=columns)
        while True:
            with self._read():
                batch = next(batches, None)
                if batch is None:
                    return
                checked = _with_valid_texts(batch)
            yield checked

    @contextmanager
    def _read(self, otherwise: str = "damaged since it was written; run the system again") -> Iterator[None]:
        try:
            yield
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            told = " ".join(str(error).split())
            raise SystemDescriptionError([Problem(Where(str(self._path)), f"{otherwise} ({told})")]) from error

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Recorded:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_Table = TypeVar("_Table", pa.Table, pa.RecordBatch)


def _with_valid_texts(read: _Table) -> _Table:
    """Returns a table or a batch whose texts are UTF-8, which pyarrow does not check as it reads them.

    Raises:
        pyarrow.ArrowInvalid: a text is not.
    """
    for column in read.columns:
        if pa.types.is_string(column.type):
            column.validate(full=True)
    return read


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
    signals = Recorded(file)
    if "time" not in signals.schema_arrow.names:
        signals.close()
        text = "no column `time`; the signals of a run begin with one"
        raise SystemDescriptionError([Problem(Where(str(file)), text)])
    return signals
