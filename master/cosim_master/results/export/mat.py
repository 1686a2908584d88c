"""Exports recorded signals as MAT 4 in the layout of Modelica tools (Dymola, OpenModelica), which OMEdit plots.

Aclass        the name of the layout; "binTrans": all other matrices are transposed
name          one column of characters for each variable; the first is the time
description   likewise, with the unit at the end, as in "mass [kg]"
dataInfo      four integers for each variable: matrix (0: the abscissa, 1 or 2), row, linear interpolation, none beyond
data_1        parameters: two columns, at start and end of the run
data_2        signals: a column for each instant
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.options import Options
from cosim_master.results.reading.recorded_signals import open_signals
from cosim_master.results.reading.roles import players, read_manifest
from cosim_master.results.storage.arrays import values_of

__all__ = ["export"]

_CLASS = ("Atrajectory", "1.1", "", "binTrans")
_MOST = 2**31 - 1


def export(run: Path, file: Path, options: Options) -> list[str]:  # noqa: ARG001
    """Writes all signals that are numbers, and the parameters in the manifest; returns notes.

    Raises:
        CosimError: the recording is empty, or too large for MAT 4, whose matrices have less than 2 GiB.
    """
    from scipy.io import savemat

    with open_signals(run) as signals:
        fields = [one for one in signals.schema_arrow if not pa.types.is_string(one.type)]
        texts = [one.name for one in signals.schema_arrow if pa.types.is_string(one.type)]
        table = signals.read(columns=[one.name for one in fields])
    if table.num_rows == 0:
        raise CosimError(f"{run / 'signals.parquet'}: nothing to export: the run recorded no instant")
    if 8 * len(fields) * table.num_rows > _MOST:
        raise CosimError(
            f"{run}: {len(fields)} signals at {table.num_rows} instants do not fit into MAT 4, whose matrices have "
            "less than 2 GiB; record fewer (`uav-cosim run --record`), or export CSV"
        )
    recorded = np.stack([values_of(table.column(one.name)).astype(np.float64) for one in fields])
    names, about = [one.name for one in fields], [_about(one.metadata or {}) for one in fields]
    info = [(0 if row == 0 else 2, row + 1, 0, -1) for row in range(len(fields))]
    constant = [np.array([recorded[0, 0], recorded[0, -1]])]
    manifest = read_manifest(run)
    changed = _changed(manifest, float(recorded[0, -1]))
    for name, value in _parameters(run, manifest):
        if name not in names:
            names.append(name)
            about.append("parameter")
            constant.append(np.array([value, changed.get(name, value)]))
            info.append((1, len(constant), 0, 0))
    savemat(
        file,
        {
            "Aclass": np.array(_CLASS),
            "name": _characters(names),
            "description": _characters(about),
            "dataInfo": np.array(info, np.int32).T,
            "data_1": np.stack(constant),
            "data_2": recorded,
        },
        format="4",
        appendmat=False,
    )
    return [f"left out, MAT 4 has numbers only: {', '.join(texts[:3])}{', ...' * (len(texts) > 3)}"] if texts else []


def _about(metadata: dict[bytes, bytes]) -> str:
    unit = metadata.get(b"unit", b"").decode()
    return metadata.get(b"description", b"").decode() + (f" [{unit}]" if unit else "")


def _changed(manifest: Mapping[str, Any], until: float) -> dict[str, float]:
    """Returns the last values of the parameters that were changed during the run, up to `until` [s]."""
    numbers = (one for one in manifest.get("changes", ()) if isinstance(one["value"], (bool, int, float)))
    return {one["variable"]: float(one["value"]) for one in numbers if one["time"] <= until}


def _parameters(run: Path, manifest: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Returns the parameters of all instances that are numbers, at the start of the run."""
    return [
        (f"{name}.{parameter}", float(value))
        for name, player in players(run, manifest).items()
        for parameter, value in player.parameters.items()
        if isinstance(value, (bool, int, float))
    ]


def _characters(texts: list[str]) -> Any:
    """Returns a matrix of characters with a column for each text. MAT 4 has Latin-1; other characters become "?"."""
    coded = [text.encode("latin-1", "replace").decode("latin-1") for text in texts]
    width = max(1, *map(len, coded))
    return np.array([["".join(column)] for column in zip(*(text.ljust(width) for text in coded), strict=True)])[:, 0]
