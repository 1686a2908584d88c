"""Exports recorded signals as CSV files, as used by FMPy and the FMI cross-check.

A run's own file is Parquet (see `recording`), which keeps units and types; CSV keeps names and values only.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TextIO

import pyarrow as pa

from cosim_master.files.whole import replacing, writing
from cosim_master.results.export.options import Options
from cosim_master.results.reading.recorded_signals import open_signals

__all__ = ["export", "export_csv"]


def export(run: Path, file: Path, options: Options) -> list[str]:
    """Writes a CSV file, or to standard output if `file` is "-"; returns notes."""
    with nullcontext(sys.stdout) if str(file) == "-" else file.open("w", encoding="utf-8", newline="\n") as out:
        texts = export_csv(run, out, numbers_only=options.numbers_only)
    if not texts:
        return []
    some = ", ".join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")
    if options.numbers_only:
        return [f"left out, as text: {some}"]
    return [f"written as text in quotes: {some}; FMPy reads numbers only, which --numbers writes"]


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
        CosimError: the run has no complete signals.
        WriteFailed: `file` cannot be written.
    """
    with open_signals(run) as signals:
        fields = list(signals.schema_arrow)
        texts = tuple(field.name for field in fields if pa.types.is_string(field.type))
        names = [field.name for field in fields if not (numbers_only and field.name in texts)]
        if isinstance(file, Path):
            with writing(file):
                file.parent.mkdir(parents=True, exist_ok=True)
                with replacing(file) as part, part.open("w", encoding="utf-8", newline="\n") as out:
                    _write(out, signals, names)
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
