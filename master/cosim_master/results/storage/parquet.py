"""The Parquet files of a finished run, and the encoding of their values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

__all__ = ["ROW_GROUP", "packets_schema", "packets_writer", "signals_writer"]

ROW_GROUP = 1024 * 1024
"""Rows; pyarrow divides longer tables."""
_PLAIN = ("message", "system", "component", "sequence", "length")


def signals_writer(file: Path, schema: pa.Schema) -> Any:
    """Opens a file of signals; each table written is a row group."""
    # Values in floating-point time series hardly repeat, so dictionaries are useless; byte stream splitting compresses
    # better. Smallest and largest values are of no use to readers, who select by time or name.
    floats = [f.name for f in schema if pa.types.is_floating(f.type)]
    return pq.ParquetWriter(
        file,
        schema,
        compression="zstd",
        use_dictionary=False,
        column_encoding=dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
        write_statistics=False,
        write_batch_size=1 << 16,
    )


def packets_writer(file: Path) -> Any:
    """Opens a file of packets; each table written is a row group."""
    return pq.ParquetWriter(file, packets_schema(), compression="zstd")


def packets_schema() -> pa.Schema:
    """Returns the columns of packets."""
    seconds = {"unit": "s"}
    return pa.schema(
        [
            pa.field("sent", pa.float64(), metadata=seconds),
            pa.field("arrival", pa.float64(), metadata=seconds),
            pa.field("source", pa.string(), metadata={"description": "instance that sent it"}),
            pa.field("target", pa.string(), metadata={"description": "node it was for"}),
            *(pa.field(name, pa.int32()) for name in _PLAIN),
            pa.field("outcome", pa.string()),
        ]
    )
