"""Fields of a record read and written by their offset, compiled and interpreted."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from cosim import Memory, Model, Parameter
from cosim.fields import get_real, get_whole, set_real, set_whole
from cosim.model import record_layout


class Fields(Model):
    """Two parameters between others."""

    variables = (
        Parameter("first", unit="1", start=1.5, description="a number"),
        Parameter("count", type=int, start=-7, description="a whole number"),
        Parameter("last", unit="1", start=2.5, description="a number"),
        Memory("rest", shape=4),
    )


def test_fields_are_read_and_written_where_the_layout_says() -> None:
    fields = record_layout(Fields.variables)[0].fields
    assert fields is not None
    m = Fields.record()
    first, count, last = (int(fields[name][1]) for name in ("first", "count", "last"))
    assert (get_real(m, first), get_whole(m, count), get_real(m, last)) == (1.5, -7, 2.5)
    set_real(m, last, 9.25)
    set_whole(m, count, 12)
    assert (m["first"], m["count"], m["last"]) == (1.5, 12, 9.25)
    assert np.array_equal(m["rest"], np.zeros(4))


def test_the_same_without_numba() -> None:
    code = (
        "from tests.cosim import test_fields_by_offset as t; t.test_fields_are_read_and_written_where_the_layout_says()"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
