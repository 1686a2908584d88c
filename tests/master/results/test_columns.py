"""Rows of the loop as a table: each signal gets its own values, however the matrices lie in memory."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from cosim_master.results.storage.columns import Columns

TYPES = {"a": pa.float64(), "n": pa.int32(), "b": pa.bool_(), "w": pa.uint64(), "s": pa.string(), "c": pa.float64()}
COLUMNS = Columns(pa.schema([("time", pa.float64()), *TYPES.items()]), (1, 3, 2, 0, 0, 0))
REALS = np.array([[10.0, 11.0, 12.0, 13.0, 14.0], [20.0, 21.0, 22.0, 23.0, 24.0]])
INTEGERS = np.array([[-1, 1, 2, 3, 4], [1, 0, 1, 0, 1], [1, 0, 0, 1, 0], [30, 31, 32, 33, -34]], np.int32)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("used", [0, 1, 3, 5])
def test_each_signal_has_its_own_values(order: str, used: int) -> None:
    reals, integers = (np.array(one, order=order)[:, :used] for one in (REALS, INTEGERS))  # type: ignore[call-overload]
    time, texts = np.arange(5.0)[:used], [[f"t{i}"] for i in range(used)]
    table = COLUMNS.table(time, reals, integers, texts)
    assert table.column("c").to_pylist() == [10.0, 11.0, 12.0, 13.0, 14.0][:used]
    assert table.column("a").to_pylist() == [20.0, 21.0, 22.0, 23.0, 24.0][:used]
    assert table.column("n").to_pylist() == [30, 31, 32, 33, -34][:used]
    assert table.column("b").to_pylist() == [True, False, False, True, False][:used]
    assert table.column("w").to_pylist() == [2**33 - 1, 1, 2**32 + 2, 3, 2**32 + 4][:used]
    assert table.column("s").to_pylist() == ["t0", "t1", "t2", "t3", "t4"][:used]
