"""The recording of a run in progress, in a form that is readable at any moment, even if the process is killed.

    RUN/unfinished/signals.arrows   rows; an Arrow IPC stream, which a reader may stop reading anywhere
    RUN/unfinished/packets.arrows   packets, the same
    RUN/unfinished/*.parquet        the files of the finished run as far as they are: unreadable, since Parquet's footer
                                    comes last
    RUN/unfinished/lock             locked while the process is alive

`Journal` appends new rows and packets about once a second, straight from the loop's block. A batch without rows marks
the end of a row group of the finished file, so that `repair` makes the same row groups as the run. When the run has
completed its files, the folder is removed.

Rows are stored in the form of the loop, with one list for each kind of value. Arrow needs a fifth of a second to write
thousands of columns, however few rows they have. `read_journal` converts the lists to columns.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.results.storage.arrays import array_of, texts, values_of
from cosim_master.results.storage.columns import Columns
from cosim_master.results.storage.parquet import packets_schema
from cosim_master.stepping.observation import Rows

try:
    import fcntl
except ImportError:  # Windows: an open file cannot be removed there anyway
    fcntl = None  # type: ignore[assignment]

__all__ = ["FOLDER", "Journal", "goes_on", "groups_of", "journal_of", "read_journal", "schema_of"]

FOLDER = "unfinished"
_KINDS = ("Real", "Integer", "String")
_SCHEMA, _PLACES = b"uav-cosim.schema", b"uav-cosim.places"


class Journal:
    """Writes the journal of one run.

    Args:
        folder: the folder of the run's results.
        columns: the columns of the signals.
        packets: the columns of packets; None if packets are not recorded.

    Raises:
        OSError: the journal cannot be written. All methods raise it, too.
    """

    def __init__(self, folder: Path, columns: Columns, packets: pa.Schema | None) -> None:
        self.folder = folder / FOLDER
        self._widths = columns.widths
        self._schemas = {"signals": _schema_of_rows(columns)} | ({} if packets is None else {"packets": packets})
        self._streams: dict[str, Any] = {}
        self.folder.mkdir()
        with ExitStack() as opened:
            lock = opened.enter_context((self.folder / "lock").open("wb"))
            if fcntl is not None:
                with suppress(OSError):  # a file system without locks
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for what, schema in self._schemas.items():
                file = opened.enter_context(pa.OSFile(str(self.folder / f"{what}.arrows"), "wb"))
                self._streams[what] = pa.ipc.new_stream(file, schema)
            for what in self._streams:
                self.end_group(what)  # writes the columns, without which nothing is readable
            self._opened = opened.pop_all()

    def rows(self, rows: Rows) -> None:
        """Appends rows."""
        arrays: list[pa.Array] = [array_of(rows.time, pa.float64())]
        reals, integers, width = self._widths
        if reals:
            arrays.append(pa.FixedSizeListArray.from_arrays(array_of(rows.reals.reshape(-1), pa.float64()), reals))
        if integers:
            arrays.append(pa.FixedSizeListArray.from_arrays(array_of(rows.integers.reshape(-1), pa.int32()), integers))
        if width:
            flat = texts([text for row in rows.texts for text in row])
            arrays.append(pa.FixedSizeListArray.from_arrays(flat, width))
        batch = pa.RecordBatch.from_arrays(arrays, schema=self._schemas["signals"])
        self._streams["signals"].write(batch)

    def packets(self, table: pa.Table) -> None:
        """Appends packets."""
        for batch in table.to_batches():
            self._streams["packets"].write(batch)

    def end_group(self, what: str) -> None:
        """Marks the end of a row group of signals or packets."""
        schema = self._schemas[what]
        self._streams[what].write(pa.RecordBatch.from_arrays([pa.nulls(0, one.type) for one in schema], schema=schema))

    def close(self) -> None:
        """Closes the files."""
        self._opened.close()


def _schema_of_rows(columns: Columns) -> pa.Schema:
    types = (pa.float64(), pa.int32(), pa.string())
    lists = [
        pa.field(kind, pa.list_(type, width))
        for kind, type, width in zip(_KINDS, types, columns.widths, strict=True)
        if width
    ]
    own = {_SCHEMA: columns.schema.serialize().to_pybytes(), _PLACES: json.dumps(columns.places).encode()}
    return pa.schema([pa.field("time", pa.float64(), metadata={"unit": "s"}), *lists], metadata=own)


# ---- reading ---------------------------------------------------------------------------------------------------------


def journal_of(run: Path, what: str) -> Path | None:
    """Returns the journal of signals or packets of a run, if its own file is not finished."""
    file = run / FOLDER / f"{what}.arrows"
    return file if file.is_file() and not (run / f"{what}.parquet").is_file() else None


def goes_on(run: Path) -> bool:
    """Returns whether the process that records a run is still alive."""
    lock = run / FOLDER / "lock"
    if fcntl is None or not lock.is_file():
        return False
    descriptor = os.open(lock, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def groups_of(file: Path) -> Iterator[pa.Table]:
    """Returns the row groups of a journal, in the columns of the finished file, up to the last complete batch."""
    with pa.memory_map(str(file)) as source:
        try:
            reader = pa.ipc.open_stream(source)
        except (pa.ArrowException, OSError):
            return  # even the columns are missing
        columns = _columns(reader.schema, file)
        group: list[pa.RecordBatch] = []
        for batch in _batches(reader, file):
            if batch.num_rows:
                group.append(batch)
            elif group:
                yield _table(group, columns, file)
                group = []
        if group:
            yield _table(group, columns, file)


def _damaged(file: Path, what: str, error: Exception) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(str(file)), f"the {what} of the journal are damaged: {error}")])


def _batches(reader: Any, file: Path) -> Iterator[pa.RecordBatch]:
    while True:
        try:
            batch = reader.read_next_batch()
        except (StopIteration, pa.ArrowException, OSError):  # the end, or the middle of the last batch
            return
        try:
            batch.validate(full=True)  # pyarrow reads beyond an array whose offsets are wrong
        except pa.ArrowException as error:
            raise _damaged(file, "rows", error) from None
        yield batch


def _columns(schema: pa.Schema, file: Path) -> Columns | None:
    own = schema.metadata or {}
    try:
        if _SCHEMA not in own:
            if lacking := [name for name in packets_schema().names if name not in schema.names]:
                raise ValueError(f"there is no column {lacking[0]}")
            return None
        found = Columns(pa.ipc.read_schema(pa.py_buffer(own[_SCHEMA])), tuple(json.loads(own[_PLACES])))
        if found.schema.names[:1] != ["time"] or len(found.places) != len(found.schema.names) - 1:
            raise ValueError(f"{len(found.places)} places of {len(found.schema.names)} columns")
        return found
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise _damaged(file, "columns", error) from None


def _table(batches: Sequence[pa.RecordBatch], columns: Columns | None, file: Path) -> pa.Table:
    """Returns batches of packets unchanged, and batches of rows as columns."""
    table = pa.Table.from_batches(batches)
    if columns is None:
        return table
    try:
        return _as_columns(table, columns)
    except (pa.ArrowException, ValueError, KeyError, TypeError, IndexError) as error:
        raise _damaged(file, "rows", error) from None


def _as_columns(table: pa.Table, columns: Columns) -> pa.Table:
    values: dict[str, Any] = dict.fromkeys(_KINDS)
    values |= {name: table[name].combine_chunks() for name in table.schema.names}
    rows, (reals, integers, texts) = table.num_rows, columns.widths
    return columns.table(
        values_of(values["time"]),
        np.ascontiguousarray(_matrix(values["Real"], rows, reals, np.float64).T),
        np.ascontiguousarray(_matrix(values["Integer"], rows, integers, np.int32).T),
        values["String"].to_pylist() if texts else (),
    )


def _matrix(lists: Any, rows: int, width: int, dtype: Any) -> Any:
    return values_of(lists.flatten()).reshape(rows, width) if width else np.zeros((rows, 0), dtype)


def schema_of(file: Path) -> pa.Schema:
    """Returns the columns of the finished file.

    Raises:
        CosimError: the process ended before it had written the columns.
    """
    with pa.memory_map(str(file)) as source:
        try:
            schema = pa.ipc.open_stream(source).schema
        except (pa.ArrowException, OSError):
            raise CosimError(f"{file}: nothing was recorded before the process was ended") from None
    columns = _columns(schema, file)
    return schema if columns is None else columns.schema


def read_journal(file: Path) -> pa.Table:
    """Returns the contents of a journal, in the columns of the finished file.

    Raises:
        CosimError: the process ended before it had written the columns.
    """
    schema, groups = schema_of(file), [*groups_of(file)]
    return pa.concat_tables(groups) if groups else pa.Table.from_batches([], schema)
