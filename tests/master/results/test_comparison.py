"""Two runs beside each other: what is equal, what is not and where, and what cannot be compared."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fmpy.util import write_csv
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim_master.cli import app
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.results.export.csv import export_csv
from cosim_master.results.reading.comparison import SignalComparison, _compare_values, compare

MANIFEST: dict[str, Any] = {
    "outcome": "done",
    "packets": {"sent": 10, "delivered": 9, "lost": 1, "lost: channel": 1},
    "seed": 1,
    "wall_s": 1.0,
    "instances": {"a": {"fmu": "/x/a.fmu", "step": 0.1, "parameters": {"mass": 1.5}}},
    "fmus": {"/x/a.fmu": {"sha256": "00ff"}},
    "versions": {"numpy": "2.0"},
}


@pytest.fixture
def record(tmp_path: Path) -> Any:
    """Writes the folder of a run with these columns."""

    def write(
        name: str, columns: Mapping[str, Sequence[Any]], units: Mapping[str, str] | None = None, **manifest: Any
    ) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        arrays = [pa.array(values) for values in columns.values()]
        fields = [
            pa.field(column, array.type, metadata={"unit": (units or {}).get(column, "")})
            for column, array in zip(columns, arrays, strict=True)
        ]
        pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), folder / "signals.parquet")
        (folder / "manifest.json").write_text(json.dumps({**MANIFEST, **manifest}))
        return folder

    return write


TIME = [0.0, 0.1, 0.2, 0.3]
COLUMNS: dict[str, Sequence[Any]] = {
    "time": TIME,
    "a.x": [1.0, 2.0, 3.0, 4.0],
    "a.n": [1, 2, 3, 4],
    "a.on": [True, False, True, True],
    "a.text": ["", "hello", "hello", "bye"],
}


def changed(**columns: Sequence[Any]) -> dict[str, Sequence[Any]]:
    return {**COLUMNS, **{name.replace("_", "."): values for name, values in columns.items()}}


def refusal(*arguments: Any, **options: Any) -> str:
    with pytest.raises(SystemDescriptionError) as caught:
        compare(*arguments, **options)
    return str(caught.value)


def test_a_run_equals_itself_wherever_it_is(record: Any) -> None:
    one = record("one", COLUMNS)
    moved = {"/elsewhere/b.fmu": {"sha256": "00ff"}}
    instances = {"a": {**MANIFEST["instances"]["a"], "fmu": "/elsewhere/b.fmu"}}
    other = record("other", COLUMNS, fmus=moved, instances=instances, wall_s=9.0)
    found = compare(one, other)
    assert found.equal
    assert (len(found.signals), found.only, found.common, found.times) == (4, ((), ()), 4, (4, 4))
    assert (found.packets, found.causes, found.notes) == ({}, {}, ())


def test_the_worst_signal_comes_first_with_its_times(record: Any) -> None:
    one = record("one", COLUMNS)
    other = record("other", changed(a_x=[1.0, 2.5, 3.0, 3.0], a_n=[1, 2, 3, 2], a_text=["", "hello", "x", "y"]))
    found = compare(one, other)
    assert [signal.name for signal in found.signals] == ["a.n", "a.x", "a.text", "a.on"]
    assert found.signals[0] == SignalComparison("a.n", 1, 2.0, 0.5, 0.3, 0.3)
    assert found.signals[1] == SignalComparison("a.x", 2, 1.0, 0.25, 0.3, 0.1)
    text = found.signals[2]
    assert (text.differing, text.time, text.first, math.isnan(text.absolute)) == (2, 0.2, 0.2, True)
    assert not found.equal


def test_tolerances_are_for_floating_point_numbers(record: Any) -> None:
    one = record("one", COLUMNS)
    other = record("other", changed(a_x=[1.0, 2.0, 3.0, 4.1]))
    assert not compare(one, other, atol=0.09).equal
    assert compare(one, other, atol=0.11).equal
    assert not compare(one, other, rtol=0.02).equal
    assert compare(one, other, rtol=0.025).equal
    whole = record("whole", changed(a_n=[1, 2, 3, 5]))
    assert not compare(one, whole, atol=10.0).equal


@given(
    st.lists(st.tuples(*[st.floats(width=32) | st.sampled_from([0.0, -0.0, math.nan, math.inf])] * 2), min_size=1),
    st.floats(0, 10),
    st.floats(0, 1),
)
@settings(max_examples=200, deadline=None)
def test_values_agree_as_python_says(pairs: list[tuple[float, float]], atol: float, rtol: float) -> None:
    """The rule of `math.isclose`, whose tolerances do not add, so that each is tried alone."""
    a, b = (np.array(side) for side in zip(*pairs, strict=True))
    time = np.arange(len(pairs), dtype=float)
    for tolerances in ({"atol": atol, "rtol": 0.0}, {"atol": 0.0, "rtol": rtol}):
        expected = [
            not (
                math.isclose(x, y, rel_tol=tolerances["rtol"], abs_tol=tolerances["atol"])
                or (math.isnan(x) and math.isnan(y))
            )
            for x, y in pairs
        ]
        found = _compare_values("x", time, a, b, **tolerances)
        assert found.differing == sum(expected)
        assert found.first == (float(expected.index(True)) if any(expected) else None)


@pytest.mark.parametrize("kinds", [(pa.int64(), pa.int64()), (pa.uint64(), pa.uint64()), (pa.int64(), pa.uint64())])
def test_integers_are_compared_as_they_are(record: Any, kinds: tuple[Any, Any]) -> None:
    """2^53 and 2^53 + 1 are one floating-point number."""
    large = 2**53
    one = record("one", {"time": [0.0, 1.0], "a.n": pa.array([large, large], kinds[0])})
    other = record("other", {"time": [0.0, 1.0], "a.n": pa.array([large, large + 1], kinds[1])})
    found = compare(one, other, atol=10.0)
    assert found.signals == (SignalComparison("a.n", 1, 1.0, 1.0 / large, 1.0, 1.0),)
    assert compare(one, record("same", {"time": [0.0, 1.0], "a.n": pa.array([large, large], kinds[1])})).equal


def test_all_rows_of_an_event_are_compared(record: Any) -> None:
    """A row before and a row behind an event have one time; of the run with more rows, the last ones are compared."""
    one = record("one", {"time": [0.0, 1.0, 1.0, 2.0], "a.x": [0.0, 5.0, 1.0, 1.0]})
    other = record("other", {"time": [0.0, 1.0, 1.0, 2.0], "a.x": [0.0, 7.0, 1.0, 1.0]})
    found = compare(one, other)
    assert (found.common, found.signals[0].differing, found.signals[0].time) == (4, 1, 1.0)
    less = record("less", {"time": [0.0, 1.0, 2.0], "a.x": [0.0, 1.0, 1.0]})
    assert compare(one, less).equal and compare(one, less).common == 3
    more = record("more", {"time": [0.0, 1.0, 1.0, 1.0, 2.0], "a.x": [0.0, 9.0, 5.0, 1.0, 1.0]})
    assert compare(one, more).equal and compare(one, more).common == 4


def test_other_grids_are_compared_where_they_meet(record: Any) -> None:
    """0.1 * 3 is not 0.3 in floating point, and is the same instant."""
    one = record("one", {"time": [0.1 * k for k in range(7)], "x": [float(k) for k in range(7)]})
    coarse = record("coarse", {"time": [0.0, 0.3, 0.6], "x": [0.0, 3.0, 6.0]})
    found = compare(one, coarse)
    assert (found.equal, found.common, found.times) == (True, 3, (7, 3))
    short = record("short", {"time": [0.0, 0.3], "x": [0.0, 3.0]})
    found = compare(one, short)
    assert all(signal.equal for signal in found.signals) and not found.equal  # it ends earlier
    apart = record("apart", {"time": [7.0, 8.0], "x": [0.0, 3.0]})
    assert "has no time in common with" in refusal(one, apart)


def test_signals_packets_units_and_causes_that_differ(record: Any) -> None:
    one = record("one", {"time": TIME, "x": [1.0] * 4, "y": [1.0] * 4}, {"x": "m"})
    other = record(
        "other",
        {"time": TIME, "x": [1.0] * 4, "z": [1.0] * 4},
        {"x": "km"},
        packets={**MANIFEST["packets"], "lost": 2, "lost: outage": 1},
        versions={"numpy": "2.1"},
        instances={"a": {**MANIFEST["instances"]["a"], "parameters": {"mass": 2.5}}},
    )
    found = compare(one, other)
    assert found.only == (("y",), ("z",))
    assert found.packets == {"lost": (1, 2), "lost: outage": (None, 1)}
    assert found.causes == {"versions.numpy": ("2.0", "2.1"), "a.mass": (1.5, 2.5)}
    assert (found.signals[0].units, found.signals[0].equal) == (("m", "km"), False)
    assert compare(one, record("third", {"time": TIME, "y": [1.0] * 4}), signals=["y"]).equal


def test_a_run_and_its_own_export(record: Any, tmp_path: Path) -> None:
    """Text included: digits, nothing at all and several lines are text on both sides."""
    texts = {"a.hex": ["01", "1e5", "3", ""], "a.none": [""] * 4, "a.lines": ["one\ntwo", ",", '"', "é"]}
    run = record("one", {**COLUMNS, **texts})
    export_csv(run, tmp_path / "one.csv")
    for pair in ((run, tmp_path / "one.csv"), (tmp_path / "one.csv", run)):
        found = compare(*pair)
        assert found.equal and {one.name for one in found.signals} >= {*texts}
    (tmp_path / "one.csv").write_text((tmp_path / "one.csv").read_text().replace('"1e5"', '"100000"'))
    (differing,) = (one for one in compare(run, tmp_path / "one.csv").signals if not one.equal)
    assert (differing.name, differing.differing) == ("a.hex", 1)


def test_a_csv_file_of_fmpy_as_one_side(record: Any, tmp_path: Path) -> None:
    one = record("one", COLUMNS)
    rows = [(t, x, n, on) for t, x, n, on in zip(*(COLUMNS[k] for k in ("time", "a.x", "a.n", "a.on")), strict=True)]
    kinds = [("time", "f8"), ("a.x", "f8"), ("a.n", "i4"), ("a.on", "?")]
    result = np.array(rows, dtype=np.dtype(kinds))
    write_csv(str(tmp_path / "reference.csv"), result)
    for pair in ((one, tmp_path / "reference.csv"), (tmp_path / "reference.csv", one)):
        found = compare(*pair)
        assert found.equal and len(found.signals) == 3
        assert found.notes == (
            "1 signals are text, which the CSV file does not have: not compared",
            "a CSV file tells of no packets, parameters and versions: not compared",
        )
    result["a.x"][2] += 1e-9
    write_csv(str(tmp_path / "moved.csv"), result)
    assert not compare(one, tmp_path / "moved.csv").equal
    assert compare(one, tmp_path / "moved.csv", atol=1e-8).equal


def test_what_cannot_be_compared(record: Any, tmp_path: Path) -> None:
    one = record("one", COLUMNS)
    (tmp_path / "empty").mkdir()
    assert "not the folder of a run" in refusal(one, tmp_path / "empty")
    assert "not the folder of a run" in refusal(one, tmp_path / "nowhere")
    (tmp_path / "odd.csv").write_text("a,b\n1,2\n")
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "signals.parquet").write_bytes(b"PAR1")
    told = f"{tmp_path / 'cut' / 'signals.parquet'}: not a complete Parquet file; the run that wrote it was cut short ("
    assert refusal(one, tmp_path / "cut").startswith(told)
    assert 'has no column "time"' in refusal(one, tmp_path / "odd.csv")
    (tmp_path / "broken.csv").write_text("time,b\n1,2,3\n")
    assert "not a CSV file of signals" in refusal(one, tmp_path / "broken.csv")
    (tmp_path / "none.csv").write_text("time,b\n")
    assert "holds no recorded instant" in refusal(one, tmp_path / "none.csv")
    (tmp_path / "twice.csv").write_text("time,b,b\n0,1,2\n")
    assert 'has more than one column "b"' in refusal(one, tmp_path / "twice.csv")
    for text in ("noon", "nan", "", "inf"):
        (tmp_path / "times.csv").write_text(f"time,b\n0,1\n{text},2\n")
        assert 'its column "time" has values that are not finite numbers' in refusal(tmp_path / "times.csv", one)
    text = refusal(one, one, signals=["a.xx*", "a.x"])
    assert text == '--signals: a.xx* matches no signal of either run; did you mean "a.x"?'
    for text in ("{", '{"packets": true}', '{"packets": [1]}', '{"instances": 3}'):
        (one / "manifest.json").write_text(text)
        assert "not the folder of a complete run" in refusal(one, one)


class TestCommand:
    def call(self, *arguments: str) -> tuple[int, str, str]:
        result = CliRunner().invoke(app, ["compare", *arguments])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.stdout, result.stderr

    def test_exit_codes_and_last_lines(self, record: Any, tmp_path: Path) -> None:
        one, same = record("one", COLUMNS), record("same", COLUMNS)
        other = record("other", changed(a_x=[1.0, 2.5, 3.0, 4.0]), seed=2)
        code, stdout, _ = self.call(str(one), str(same))
        assert (code, stdout) == (0, "equal: 4 of 4 common signals agree\n")
        code, stdout, _ = self.call(str(one), str(other))
        lines = [re.split(r"  +", line.strip()) for line in stdout.splitlines()]
        assert code == 1
        assert lines[0] == ["signal", "largest difference", "of its size", "at s", "first at s", "differing"]
        assert lines[1] == ["a.x", "0.5", "0.125", "0.1", "0.1", "1 of 4"]
        assert lines[3] == ["seed", "1", "2"]
        assert stdout.splitlines()[-1] == "different: 3 of 4 common signals agree"
        code, stdout, _ = self.call(str(one), str(other), "--atol", "0.5")
        assert (code, stdout.splitlines()[-1]) == (0, "equal: 4 of 4 common signals agree")
        code, _, stderr = self.call(str(one), str(tmp_path / "nowhere"))
        assert code == 2 and stderr.splitlines()[-1].startswith("error: ")
        assert self.call(str(one), str(other), "--atol", "inf")[0] == 2
        assert self.call(str(one), str(other), "--rtol", "-1")[0] == 2

    def test_runs_whose_common_signals_agree_say_why_they_differ(self, record: Any) -> None:
        one = record("one", COLUMNS)
        shorter = record("shorter", {name: values[:3] for name, values in COLUMNS.items()})
        more = record("more", {**COLUMNS, "a.y": [0.0] * 4}, packets={"lost": 3})
        code, stdout, _ = self.call(str(one), str(shorter))
        assert (code, stdout.splitlines()[-1]) == (
            1,
            "different: 4 of 4 common signals agree; the runs differ in times",
        )
        code, stdout, _ = self.call(str(one), str(more))
        assert code == 1
        assert " ".join(stdout.split()).endswith(
            "4 of 4 common signals agree; the runs differ in signals that only one of them has and packets"
        )

    def test_json(self, record: Any) -> None:
        one = record("one", COLUMNS)
        other = record("other", changed(a_x=[1.0, math.nan, 3.0, 4.0]))
        code, stdout, _ = self.call(str(one), str(other), "--json")
        assert code == 1
        assert json.loads(stdout) == {
            "equal": False,
            "compared": 4,
            "signals": [
                {
                    "name": "a.x",
                    "differing": 1,
                    "absolute": "INF",
                    "relative": "INF",
                    "time": 0.1,
                    "first": 0.1,
                    "units": [],
                }
            ],
            "only": [[], []],
            "times": {"common": 4, "each": [4, 4], "spans": [[0.0, 0.3], [0.0, 0.3]]},
            "packets": {},
            "manifest": {},
            "notes": [],
        }


@pytest.mark.usefixtures("own_cache")
def test_real_runs(stricts: Any, tmp_path: Path) -> None:
    stricts.fmu()
    system = stricts.ssd(stricts.component("a", p=1.0, u=1.0), stop=2.0)
    for name, p in (("one", "1"), ("same", "1"), ("other", "1.5")):
        assert simulate(system, RunOptions(out=tmp_path / name, overrides={"a.p": p})).outcome == "done"
    assert compare(tmp_path / "one", tmp_path / "same").equal
    found = compare(tmp_path / "one", tmp_path / "other")
    assert not found.equal
    assert found.signals[0].name == "a.y" and found.signals[0].absolute == 1.0  # 2 and 3 at the end
    assert found.causes["a.p"] == (1.0, 1.5)
