"""The table of a campaign: a row for each run, with the factors, the outcome, the verdict and the metrics."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from cosim_master.campaigns.study.study import Study
from cosim_master.results.storage.arrays import array_of, texts

__all__ = ["digest_of", "schema_of", "sorted_table"]


def schema_of(study: Study) -> pa.Schema:
    """Returns the columns: those of every study, a column for each factor, and one for each metric.

    Factors whose values are all numbers are numbers; others are texts. A metric without a value is null.
    """
    fixed = [
        ("run", pa.int64()),
        ("point", pa.int64()),
        ("seed", pa.int64()),
        ("outcome", pa.string()),
        ("reason", pa.string()),
        ("good", pa.bool_()),
        ("failures", pa.int32()),
        ("warnings", pa.int32()),
        ("findings", pa.string()),
        ("simulated_s", pa.float64()),
    ]
    factors = [(one.label, pa.float64() if one.numeric else pa.string()) for one in study.factors]
    metrics = [(one.name, pa.float64()) for one in study.metrics]
    told = {b"uav-cosim.study": json.dumps(study.as_json()).encode()}
    return pa.schema([pa.field(name, kind) for name, kind in [*fixed[:3], *factors, *fixed[3:], *metrics]], told)


def sorted_table(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.Table:
    """Returns rows as a table in the order of their numbers, each run once."""
    once = {int(row["run"]): row for row in rows}
    ordered = [once[number] for number in sorted(once)]
    columns = [_column([row.get(one.name) for row in ordered], one.type) for one in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def _column(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    if pa.types.is_string(kind):
        return texts(values)
    valid = np.array([value is not None for value in values], bool)
    there = np.array([0 if value is None else value for value in values], kind.to_pandas_dtype())
    return array_of(there, kind, valid=None if valid.all() else valid)


def digest_of(table: pa.Table) -> str:
    """Returns the digest of all values, whatever the order of the rows and their parts; two equal datasets have one."""
    digest = hashlib.sha256(json.dumps(table.column_names).encode())
    for row in sorted(table.to_pylist(), key=lambda one: int(one["run"])):
        digest.update(repr([*row.values()]).encode())
    return digest.hexdigest()
