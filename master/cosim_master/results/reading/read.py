"""A recorded run as tables, for other programs."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from cosim_master.diagnostics.errors import CosimError, Problem, SystemDescriptionError, Where
from cosim_master.results.reading.recorded_signals import Recorded, open_signals
from cosim_master.results.storage.journal import journal_of, read_journal
from cosim_master.results.storage.parquet import packets_schema

__all__ = ["has_packets", "packets", "signals"]


def signals(run: Path | str, names: list[str] | None = None) -> pa.Table:
    """Returns the recorded signals of a run: column ``time`` [s], then one for each ``component.variable``.

    Units and descriptions are in the metadata of the fields. ``.to_pandas()`` and ``polars.from_arrow`` make data
    frames of it.

    Args:
        run: folder of the run.
        names: of the columns to read; None reads all.

    Raises:
        CosimError: the folder has no signals, or lacks a column.
    """
    with open_signals(Path(run)) as file:
        if names is not None and (lacking := sorted({*names} - {*file.schema_arrow.names})):
            raise CosimError(f"{run}: nothing was recorded of {', '.join(lacking[:5])}")
        return file.read(columns=names)


def has_packets(run: Path) -> bool:
    """Returns whether the packets of a run were recorded."""
    return journal_of(run, "packets") is not None or (run / "packets.parquet").is_file()


def packets(run: Path | str, names: list[str] | None = None) -> pa.Table:
    """Returns the packets of a run, one row for each packet and each of its target nodes; times in s.

    Args:
        run: folder of the run.
        names: of the columns to read; None reads all.

    Raises:
        CosimError: the run has no record of packets, or an incomplete one.
    """
    if (journal := journal_of(Path(run), "packets")) is not None:
        table = read_journal(journal)
        return table if names is None else table.select(names)
    file = Path(run) / "packets.parquet"
    if not file.is_file():
        raise CosimError(f"{run}: no packets were recorded (there is no packets.parquet)")
    with Recorded(file) as found:
        recorded = found.schema_arrow.names
        if lacking := [name for name in packets_schema().names if name not in recorded]:
            text = f"no column {lacking[0]}; packets of a run have {', '.join(packets_schema().names)}"
            raise SystemDescriptionError([Problem(Where(str(file)), text)])
        table = found.read(columns=names)
    return table if names is None else table.select(names)
