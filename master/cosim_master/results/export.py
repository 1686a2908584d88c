"""Exports recorded signals for other tools: CSV files as used by FMPy and the FMI cross-check.

A run's own file is Parquet (see `recorder`), which keeps units and types; CSV keeps names and values only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol, TextIO

import pyarrow as pa
import pyarrow.parquet as pq

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.journal import journal_of, read_journal

__all__ = ["Signals", "export_csv", "open_signals"]


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
        CosimError: the folder has no signals, or they cannot be read.
    """
    if (journal := journal_of(run, "signals")) is not None:
        return _Unfinished(read_journal(journal))
    file = run / "signals.parquet"
    if not file.is_file():
        raise CosimError(f"{run}: not the folder of a run: it has no signals.parquet (`uav-cosim run -o` writes it)")
    try:
        signals: Signals = pq.ParquetFile(file)
    except pa.ArrowInvalid as error:
        raise CosimError(
            f"{file}: not a complete Parquet file; the run that wrote it was cut short ({error})"
        ) from error
    if "time" not in signals.schema_arrow.names:
        signals.close()
        raise CosimError(f"{file}: no column `time`; the signals of a run begin with one")
    return signals


def export_csv(run: Path, file: Path | TextIO, *, numbers_only: bool = False) -> tuple[str, ...]:
    """Writes all recorded signals of a run as CSV, with numbers in the format of FMPy.

    One row per recorded instant below a row of quoted names, `"time","component.variable",...`. Floating-point numbers
    are written so that reading them gives the same number, Integers and enumerations as integers, Booleans as 0 and 1,
    text in quotes (RFC 4180), Binaries in hexadecimal digits.

    Args:
        run: folder of the run.
        file: the file to write; its folder is created if necessary. An open file is written to and left open.
        numbers_only: omit columns of text, which readers of numbers (FMPy's `read_csv`) refuse.

    Returns:
        The names of the columns of text, written or omitted, in the order of recording.

    Raises:
        CosimError: the run has no complete signals, or `file` cannot be written.
    """
    with open_signals(run) as signals:
        fields = list(signals.schema_arrow)
        texts = tuple(field.name for field in fields if pa.types.is_string(field.type))
        names = [field.name for field in fields if not (numbers_only and field.name in texts)]
        if isinstance(file, Path):
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                with file.open("w", encoding="utf-8", newline="\n") as out:
                    _write(out, signals, names)
            except OSError as error:
                raise CosimError(f"{file}: cannot be written: {error.strerror or error}") from error
        else:
            _write(file, signals, names)
    return texts


def _write(out: TextIO, signals: Any, names: list[str]) -> None:
    out.write(",".join(map(_quoted, names)) + "\n")
    for batch in signals.iter_batches(batch_size=4096, columns=names):
        out.writelines(_rows(batch))


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _rows(batch: Any) -> Iterator[str]:
    columns = [map(_quoted if pa.types.is_string(c.type) else repr, _python_values(c)) for c in batch.columns]
    return (",".join(row) + "\n" for row in zip(*columns, strict=True))


def _python_values(column: Any) -> list[Any]:
    """Returns Python's texts, floats and integers: their repr is the shortest text that reads back unchanged."""
    values: list[Any] = column.to_pylist()
    return [int(value) for value in values] if pa.types.is_boolean(column.type) else values
