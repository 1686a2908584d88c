"""Kernels that Python calls by their address: the same results as plain Python, and no numba where the code is kept."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cosim.entry import entry, forget_tables, signature_of
from cosim.kernel import PLAIN

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")

ROW = np.dtype([("weight", np.float64), ("count", np.int32)], align=True)


class Inner(NamedTuple):
    """A tuple within a table."""

    scale: NDArray[np.int64]
    plus: int


class Table(NamedTuple):
    """What the kernels of this test are given."""

    rows: Any
    grid: NDArray[np.uint8]
    inner: Inner
    out: NDArray[np.float64]


@entry
def weighed(t: Table, first: int, port: NDArray[np.int64]) -> int:
    """Sums up all that it is given, so that the order of each argument counts."""
    total = t.inner.plus * t.inner.scale[0] + first
    for i in range(t.grid.shape[0]):
        for j in range(t.grid.shape[1]):
            total += (i + 1) * (j + 3) * int(t.grid[i, j])
    for k in range(port.size):
        total += (k + 1) * port[k]
    for row in t.rows:
        t.out[0] += row.weight * row.count
    return total


@entry
def is_large(x: NDArray[np.float64]) -> bool:
    return bool(x.size > 2)


@entry
def doubled(x: NDArray[np.float64]) -> None:
    for i in range(x.size):
        x[i] *= 2.0


@entry
def half(x: NDArray[np.float64]) -> float:
    return x[0] / 2.0


@entry
def added(x: NDArray[np.float64], n: int) -> int:
    return n + x.size


whole = st.integers(-(2**40), 2**40)


@given(
    first=whole,
    plus=whole,
    scale=whole.map(lambda x: x % 1000),
    grid=st.lists(st.lists(st.integers(0, 255), min_size=4, max_size=4), min_size=1, max_size=5),
    port=st.lists(whole, max_size=6),
    step=st.sampled_from([1, 2, -1]),
    weights=st.lists(st.floats(-1e6, 1e6), max_size=4),
)
def test_results_are_those_of_plain_python(
    first: int, plus: int, scale: int, grid: list[list[int]], port: list[int], step: int, weights: list[float]
) -> None:
    """Arrays of one and two dimensions, strided, of records, within tuples, and integers of either sign."""
    outs = []
    for call in (weighed, weighed.py_func):  # type: ignore[attr-defined]
        rows = np.array([(w, i - 1) for i, w in enumerate(weights)], ROW)
        if call is not weighed:
            rows = rows.view(np.recarray)  # type: ignore[assignment]
        table = Table(rows, np.array(grid, np.uint8)[:, ::step], Inner(np.array([scale], np.int64), plus), np.zeros(1))
        given_port = np.repeat(np.array(port, np.int64), 2)[::2]
        outs.append((int(call(table, first, given_port)), table.out[0]))
    assert outs[0] == outs[1]


def test_kinds_of_results() -> None:
    x = np.array([1.0, 2.0, 3.0])
    assert is_large(x) is True and is_large(x[:2]) is False
    assert doubled(x) is None  # type: ignore[func-returns-value]
    assert x.tolist() == [2.0, 4.0, 6.0]
    assert added(x, -5) == -2
    assert added(x, np.int64(7)) == 10  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"returns an integer, a bool or nothing, not float64"):
        half(x)


def test_what_is_no_integer_is_refused() -> None:
    for wrong in (1.5, "1", None):
        with pytest.raises(TypeError):
            added(np.zeros(1), wrong)  # type: ignore[arg-type]


def test_types_are_told_apart() -> None:
    x = np.zeros((2, 2))
    locked = np.zeros((2, 2))
    locked.flags.writeable = False
    odd = np.frombuffer(bytearray(33), np.uint8)[1:].view(np.float64).reshape(2, 2)
    every = [
        x,
        np.asfortranarray(x),
        np.zeros(2),
        x.astype(np.float32),
        locked,
        odd,
        np.zeros(2, ROW),
        np.zeros((4, 4))[::2, ::2],
    ]
    assert len({signature_of((one,)) for one in every}) == len(every)
    assert signature_of((x, 1)) == signature_of((np.ones((5, 7)), 2**40))
    assert signature_of((Inner(np.zeros(1, np.int64), 1),)) != signature_of((Inner(np.zeros(1, np.int32), 1),))  # type: ignore[arg-type]


def test_a_table_is_released() -> None:
    gc.freeze()  # to look through all that thousands of tests have left takes seconds
    memory = np.zeros(1, np.int64)
    seen = weakref.ref(memory)
    signature_of((Inner(memory, 1),))
    del memory
    gc.collect()
    gc.unfreeze()
    assert seen() is not None  # its address is known, and could otherwise be that of another table
    forget_tables()
    assert seen() is None


PROGRAM = """
import json, sys
import numpy as np
from garden.bed import watered
x = np.arange(4.0)
found = watered(x, 3)
print(json.dumps([found, x.tolist(), "numba" in sys.modules]))
"""

BED = """
from cosim.entry import entry
from cosim.kernel import kernel

@kernel
def poured(x):
    return 2.0 * x + FLOW

FLOW = 1.0

@entry
def watered(x, n):
    for i in range(x.size):
        x[i] = poured(x[i])
    return n * x.size
"""


@pytest.fixture
def garden(tmp_path: Path) -> Any:
    """Runs a program of a package with an entry; returns what it prints, and the files of its code."""
    (tmp_path / "garden").mkdir()
    (tmp_path / "garden" / "__init__.py").touch()
    (tmp_path / "garden" / "bed.py").write_text(BED)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}

    def run(**more: str) -> tuple[Any, str, list[Path]]:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env={**environment, **more}, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout), done.stderr, sorted((tmp_path / "cache").rglob("watered-*.kernel"))

    return run


def test_kept_code_needs_no_numba(garden: Any, tmp_path: Path) -> None:
    right = [12, [1.0, 3.0, 5.0, 7.0]]
    first, _, [file] = garden()
    assert first == [*right, True]
    again, noted, files = garden()
    assert (again, noted, files) == ([*right, False], "", [file])
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    damaged, noted, files = garden()
    assert damaged == [*right, True] and "has been changed since it was made" in noted and files == [file]
    (tmp_path / "garden" / "bed.py").write_text(BED.replace("FLOW = 1.0", "FLOW = 4.0"))
    changed, _, files = garden()
    assert changed == [12, [4.0, 6.0, 8.0, 10.0], True] and len(files) == 2


def test_code_is_kept_for_each_processor(garden: Any) -> None:
    (_, _, [file]), (other, _, files) = garden(), garden(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    assert other[2] and len(files) == 2 and file in files


def test_a_process_that_checks_indices_has_exceptions(garden: Any, tmp_path: Path) -> None:
    (tmp_path / "garden" / "bed.py").write_text(BED.replace("range(x.size)", "range(9)"))
    with pytest.raises(subprocess.CalledProcessError) as raised:
        garden(NUMBA_BOUNDSCHECK="1")
    assert "IndexError: index is out of bounds" in raised.value.stderr
