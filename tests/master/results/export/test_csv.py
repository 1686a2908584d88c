"""CSV export: literal bytes, and FMPy's own reader as the judge."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fmpy.util import read_csv
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.csv import export_csv
from cosim_master.results.reading.recorded_signals import open_signals


def write_signals(run: Path, columns: dict[str, pa.Array]) -> Path:
    run.mkdir(exist_ok=True)
    pq.write_table(pa.table(columns), run / "signals.parquet", compression="zstd", row_group_size=5)
    return run


def small_run(run: Path) -> Path:
    return write_signals(
        run,
        {
            "time": pa.array([0.0, 0.0125, 0.1 + 0.2]),
            "drone1.vehicle.position[1]": pa.array([-0.0, 1e-300, 1 / 3]),
            "drone1.agent.step": pa.array([0, 1, -2147483648], pa.int32()),
            "drone1.autopilot.text": pa.array(["a,b", '"', ""]),
            "drone1.autopilot.armed": pa.array([False, True, True]),
        },
    )


def test_the_file_is_literally_this(tmp_path: Path) -> None:
    texts = export_csv(small_run(tmp_path / "run"), tmp_path / "new" / "folder" / "out.csv")
    assert texts == ("drone1.autopilot.text",)
    assert (tmp_path / "new" / "folder" / "out.csv").read_bytes() == (
        b'"time","drone1.vehicle.position[1]","drone1.agent.step","drone1.autopilot.text","drone1.autopilot.armed"\n'
        b'0.0,-0.0,0,"a,b",0\n'
        b'0.0125,1e-300,1,"""",1\n'
        b'0.30000000000000004,0.3333333333333333,-2147483648,"",1\n'
    )


def test_text_is_left_out_for_readers_of_numbers(tmp_path: Path) -> None:
    """FMPy's results have no Strings, and its reader refuses them."""
    run = small_run(tmp_path / "run")
    assert export_csv(run, tmp_path / "out.csv", numbers_only=True) == ("drone1.autopilot.text",)
    names = ("time", "drone1.vehicle.position[1]", "drone1.agent.step", "drone1.autopilot.armed")
    read = read_csv(tmp_path / "out.csv")
    assert read.dtype.names == names
    assert read["drone1.autopilot.armed"].tolist() == [0.0, 1.0, 1.0]
    export_csv(run, tmp_path / "all.csv")
    with pytest.raises(ValueError, match="could not convert string to float"):
        read_csv(tmp_path / "all.csv")


def test_other_readers_take_text(tmp_path: Path) -> None:
    """Python's own reader, with quotes, commas and lines in text."""
    texts = ["a,b", '"', "", "two\nlines", "ü"]
    columns = {"time": pa.array([0.0, 1.0, 2.0, 3.0, 4.0]), "x.s": pa.array(texts)}
    export_csv(write_signals(tmp_path / "run", columns), tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [["time", "x.s"], *([str(float(i)), text] for i, text in enumerate(texts))]


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(st.floats(), st.floats(), st.integers(-(2**31), 2**31 - 1), st.booleans()), min_size=1, max_size=12
    )
)
def test_fmpy_reads_back_the_same_numbers(tmp_path: Path, rows: list[tuple[float, float, int, bool]]) -> None:
    a, b, number, flag = (list(column) for column in zip(*rows, strict=True))
    columns = {
        "time": pa.array(np.arange(len(rows)) / 400),
        "x.a": pa.array(a, pa.float64()),
        "x.b[1]": pa.array(b, pa.float64()),
        "x.n": pa.array(number, pa.int32()),
        "x.on": pa.array(flag),
    }
    run = write_signals(tmp_path / "run", columns)
    assert export_csv(run, tmp_path / "out.csv") == ()
    read = read_csv(tmp_path / "out.csv")
    assert read.dtype.names == ("time", "x.a", "x.b[1]", "x.n", "x.on")
    for name, expected in zip(read.dtype.names, (np.arange(len(rows)) / 400, a, b, number, flag), strict=True):
        for got, want in zip(read[name], expected, strict=True):
            assert got == want or (math.isnan(got) and math.isnan(want))
            assert math.copysign(1, got) == math.copysign(1, want) or math.isnan(want)


def test_all_batches_are_written(tmp_path: Path) -> None:
    time = np.arange(10_000) * 0.0025
    run = write_signals(tmp_path / "run", {"time": pa.array(time), "x.sine": pa.array(np.sin(time))})
    export_csv(run, tmp_path / "out.csv")
    read = read_csv(tmp_path / "out.csv")
    np.testing.assert_array_equal(read["time"], time)
    np.testing.assert_array_equal(read["x.sine"], np.sin(time))


def test_a_quote_in_a_name_is_doubled(tmp_path: Path) -> None:
    run = write_signals(tmp_path / "run", {"time": pa.array([0.0]), 'x."odd", name': pa.array([1.0])})
    export_csv(run, tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == '"time","x.""odd"", name"\n0.0,1.0\n'


def test_a_run_without_rows_leaves_the_header(tmp_path: Path) -> None:
    run = write_signals(tmp_path / "run", {"time": pa.array([], pa.float64()), "x.a": pa.array([], pa.float64())})
    export_csv(run, tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == '"time","x.a"\n'


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(CosimError, match=r"not the folder of a run: it has no signals\.parquet"):
        export_csv(tmp_path, tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


def test_a_run_that_was_cut_short(tmp_path: Path) -> None:
    complete = (small_run(tmp_path) / "signals.parquet").read_bytes()
    (tmp_path / "signals.parquet").write_bytes(complete[:-20])
    with pytest.raises(CosimError, match="the run that wrote it was cut short"):
        export_csv(tmp_path, tmp_path / "out.csv")


def test_signals_without_time(tmp_path: Path) -> None:
    run = write_signals(tmp_path / "run", {"x.a": pa.array([1.0])})
    with pytest.raises(CosimError, match="no column `time`"):
        open_signals(run)


@pytest.mark.skipif(os.name == "nt", reason="the message is the system's")
def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    with pytest.raises(CosimError, match="cannot be written: Is a directory"):
        export_csv(run, tmp_path)
