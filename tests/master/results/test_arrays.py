"""Values of columns as numpy arrays: the same as pyarrow's own, whatever the type, the parts and the beginning."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cosim_master.results.storage.arrays import values_of

TYPES = [
    pa.bool_(),
    pa.float32(),
    pa.float64(),
    *(getattr(pa, f"{u}int{n}")() for u in ("", "u") for n in (8, 16, 32, 64)),
]


@pytest.mark.parametrize("kind", TYPES, ids=str)
@pytest.mark.parametrize("parts", [(), (0,), (21,), (3, 0, 13)])
def test_numbers_and_truth_values(kind: Any, parts: tuple[int, ...]) -> None:
    chosen = np.random.default_rng(3)
    chunks = [pa.array(chosen.integers(0, 2 if kind == pa.bool_() else 100, n)).cast(kind) for n in parts]
    column = pa.chunked_array(chunks, kind)
    for one in (column, column.slice(2), *chunks, *(chunk.slice(5) for chunk in chunks)):
        expected = one.to_numpy(zero_copy_only=False)
        found = values_of(one)
        assert found.dtype == expected.dtype
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("kind", [pa.float32(), pa.float64()], ids=str)
def test_null_is_nan(kind: Any) -> None:
    column = pa.chunked_array([[1.0, None], [None, 2.0, 3.0]], kind).slice(1)
    assert values_of(column).dtype == column.to_numpy().dtype
    assert np.array_equal(values_of(column), column.to_numpy(), equal_nan=True)


def test_other_types_are_pyarrows() -> None:
    for column in (pa.array(["a", None]), pa.chunked_array([["a"], ["b"]]), pa.array([True, None])):
        assert values_of(column).tolist() == column.to_pylist()
