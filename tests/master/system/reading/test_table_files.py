"""Components of a system that are CSV or Parquet files: their columns drive others like outputs of any FMU."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.convert import convert
from cosim_master.system.authoring.pack import pack
from cosim_master.system.authoring.swap import swap
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

pytestmark = pytest.mark.usefixtures("own_cache")
ROWS = """"time","v","n","on","other"
0,0,1,false,x
1,4,2,true,x
1,-2,2,true,x
2,0,5,0,x
"""
COLUMNS = "v:output:Real n:output:Integer on:output:Boolean"


def run(file: Path, **options: Any) -> dict[str, list[Any]]:
    out = file.parent / "out" / file.suffix[1:]
    options.setdefault("until", 2.5)
    result = simulate(file, RunOptions(out=out, **options))
    assert result.outcome == "done", result.error
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def drive(dynamics: Any, workshop: Any, table: str, wires: str, **options: Any) -> Path:
    """A table "t" beside x' = u + m (+ 10 where on)."""
    dynamics.fmu("DRIVE", 2, "CS", name="d.fmu", step=0.5)
    parts = table + workshop.component("d", "d.fmu", "u:input x:output y:output m:input on:input latched:output")
    file: Path = workshop.ssd("s.ssd", workshop.system(parts, wires, **options))
    return file


def test_columns_drive_inputs(dynamics: Any, workshop: Any, tmp_path: Path) -> None:
    """Reals are linear between rows, Integers and Booleans held; of a jump the last row counts."""
    (tmp_path / "in.csv").write_text(ROWS)
    table = workshop.component("t", "in.csv", COLUMNS, type="text/csv")
    wires = workshop.connection("t/v", "d/u") + workshop.connection("t/n", "d/m") + workshop.connection("t/on", "d/on")
    file = drive(dynamics, workshop, table, wires)
    got = run(file)
    assert got["time"] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    assert got["t.v"] == [0.0, 2.0, -2.0, -1.0, 0.0, 0.0]
    assert got["t.n"] == [1, 1, 2, 2, 5, 5]
    assert got["t.on"] == [False, False, True, True, False, False]
    x = [0.0]
    for u, m, on in zip(got["t.v"], got["t.n"], got["t.on"], strict=True):
        x.append(x[-1] + 0.5 * (u + m + (10 if on else 0)))
    assert got["d.x"] == pytest.approx(x[:-1], abs=1e-12)
    manifest = json.loads((tmp_path / "out" / "ssd" / "manifest.json").read_text())
    assert "t" in manifest["instances"]


def test_values_are_held(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text(ROWS)
    table = workshop.component("t", "in.csv", COLUMNS, type="text/csv; interpolation=hold")
    file = drive(dynamics, workshop, table, workshop.connection("t/v", "d/u"))
    assert run(file)["t.v"] == [0.0, 0.0, -2.0, -2.0, 0.0, 0.0]


def test_parquet(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    columns = {"time": [0.0, 1.0, 1.0, 2.0], "v": [0.0, 4.0, -2.0, 0.0], "n": [1, 2, 2, 5], "on": [0, 1, 1, 0]}
    pq.write_table(pa.table({**columns, "on": [bool(x) for x in columns["on"]]}), tmp_path / "in.parquet")
    table = workshop.component("t", "in.parquet", COLUMNS, type="application/vnd.apache.parquet")
    got = run(drive(dynamics, workshop, table, workshop.connection("t/v", "d/u")))
    assert got["t.v"] == [0.0, 2.0, -2.0, -1.0, 0.0, 0.0]
    assert got["t.n"] == [1, 1, 2, 2, 5, 5]
    assert got["t.on"] == [False, False, True, True, False, False]


def test_units_and_transformations_through_outputs_of_systems(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    """A column in km inside of a system whose output is in m, and from there by a linear transformation to an FMU."""
    (tmp_path / "in.csv").write_text("time,v\n0,0\n2,4\n")
    table = workshop.component("t", "in.csv", "v:output:Real:km", type="text/csv")
    inner = workshop.connection("t/v", "out")
    inside = workshop.system(table, inner, name="s", connectors="out:output:Real:m")
    dynamics.fmu("DRIVE", 2, "CS", name="d.fmu", step=0.5)
    linear = '<ssc:LinearTransformation factor="3" offset="1"/>'
    outer = workshop.connection("s/out", "d/u", linear)
    parts = inside + workshop.component("d", "d.fmu", "u:input x:output")
    file = workshop.ssd("s.ssd", workshop.system(parts, outer), workshop.units("km", "m"))
    with read_system(file) as structure:
        (alias,) = check(structure).aliases
    assert (alias.name, alias.source, alias.factor) == ("s.out", ("s.t", "v"), 1000.0)
    got = run(file, step=0.25)
    assert got["time"][:3] == [0.0, 0.25, 0.5]
    assert got["s.t.v"] == [min(2 * t, 4.0) for t in got["time"]]
    assert pq.read_schema(tmp_path / "out" / "ssd" / "signals.parquet").field("s.t.v").metadata[b"unit"] == b"km"
    x = [0.0]
    for v in got["s.t.v"]:
        x.append(x[-1] + 0.25 * (3 * 1000 * v + 1))
    assert got["d.x"] == pytest.approx(x[:-1], rel=1e-12)


def test_rows_are_met_though_steps_add_up_to_other_numbers(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    """0.1 s thirty times is not 3 s, as doubles go."""
    rows = "".join(f"{k / 10},{k}\n" for k in range(31))
    (tmp_path / "in.csv").write_text(f"time,n\n{rows}")
    table = workshop.component("t", "in.csv", "n:output:Integer", type="text/csv")
    file = drive(dynamics, workshop, table, "")
    assert run(file, step=0.1)["t.n"] == list(range(26))


def test_a_run_goes_on_from_a_checkpoint(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text(ROWS)
    dynamics.fmu("DRIVE", 2, "ME", name="d.fmu", step=0.5)
    parts = workshop.component("t", "in.csv", COLUMNS, type="text/csv")
    parts += workshop.component("d", "d.fmu", "u:input x:output")
    file = workshop.ssd("s.ssd", workshop.system(parts, workshop.connection("t/v", "d/u")))
    first, second = tmp_path / "first", tmp_path / "second"
    simulate(file, RunOptions(out=first, until=2.5, checkpoint_every=1.0, solver="rk4:0.1"))
    result = simulate(file, RunOptions(out=second, until=2.5, origin=f"{first}@1", solver="rk4:0.1"))
    assert result.outcome == "done", result.error
    assert pq.read_table(first / "signals.parquet") == pq.read_table(second / "signals.parquet")


def test_pack_carries_the_file(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "in.csv").write_text(ROWS)
    table = workshop.component("t", "data/in.csv", COLUMNS, type="text/csv")
    file = drive(dynamics, workshop, table, workshop.connection("t/v", "d/u"))
    packed = pack(file, tmp_path / "s.ssp")
    assert "resources/data/in.csv" in packed.members
    before = run(file)
    (tmp_path / "data" / "in.csv").unlink()
    assert run(tmp_path / "s.ssp") == before


def test_omsimulator_gets_the_file(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text(ROWS)
    table = workshop.component("t", "in.csv", COLUMNS, type="text/csv")
    file = drive(dynamics, workshop, table, workshop.connection("t/v", "d/u"))
    converted = convert(file, tmp_path / "oms", "omsimulator").file
    assert 'type="text/csv" source="resources/in.csv"' in converted.read_text()
    assert run(converted) == run(file)


def test_a_file_is_no_fmu_to_be_swapped(workshop: Any, dynamics: Any, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text(ROWS)
    file = drive(dynamics, workshop, workshop.component("t", "in.csv", COLUMNS, type="text/csv"), "")
    with pytest.raises(SystemDescriptionError) as caught:
        swap(file, "t", tmp_path / "d.fmu", tmp_path / "new.ssd")
    said = '"t" is the file in.csv, not an FMU; change its source in the .ssd; valid: "d"'
    assert str(caught.value).endswith(said)


def refused(workshop: Any, tmp_path: Path, content: str, columns: str = COLUMNS, **options: str) -> list[str]:
    (tmp_path / "in.csv").write_text(content)
    parts = workshop.component("t", "in.csv", columns, **{"type": "text/csv", **options})
    file = workshop.ssd("s.ssd", workshop.system(parts))
    with pytest.raises(SystemDescriptionError) as caught, read_system(file) as structure:
        check(structure)
    return [str(problem).replace(f"{tmp_path}/", "") for problem in caught.value.problems]


def test_everything_wrong_with_a_file(workshop: Any, tmp_path: Path) -> None:
    wrong = "time,v,n,on\n0,zwei,1.5,maybe\n1,inf,1,1\n0.5,0,3000000000,1\n\n2,0\nx,0,0,0\n"
    assert refused(workshop, tmp_path, wrong) == [
        'in.csv:2: column "v" has "zwei"; valid: a finite number',
        'in.csv:2: column "n" has "1.5"; valid: an integer of 32 bits',
        'in.csv:2: column "on" has "maybe"; valid: true, false, 1 or 0',
        'in.csv:3: column "v" has "inf"; valid: a finite number',
        "in.csv:4: time 0.5 s lies before that of the row above, 1 s",
        'in.csv:4: column "n" has "3000000000"; valid: an integer of 32 bits',
        "in.csv:6: has 2 cells; the row of names has 4",
        'in.csv:7: column "time" has "x"; valid: a finite number of seconds',
    ]
    assert refused(workshop, tmp_path, "t,v,n,on\n0,1,1,1\n") == [
        'in.csv:1: its first column is "t"; it must be "time"'
    ]
    assert refused(workshop, tmp_path, "time,v\n", "v:output:Real") == [
        'in.csv: needs a row of names ("time", then columns) and one row of values at least'
    ]
    assert refused(workshop, tmp_path, "time,v,v\n0,1,1\n", "v:output:Real") == ['in.csv:1: column "v" is there twice']


def test_connectors_that_are_no_columns(workshop: Any, tmp_path: Path) -> None:
    (said,) = refused(workshop, tmp_path, "time,voltage,n\n0,1,1\n", "voltages:output:Real")
    assert said.endswith('in.csv has no column "voltages"; did you mean "voltage"?') and said.startswith("s.ssd:")
    (said,) = refused(workshop, tmp_path, "time,v\n0,1\n", "v:input:Real")
    assert said.endswith('connector "v" is input: columns of a file can only be output')
    (said,) = refused(workshop, tmp_path, "time,v\n0,1\n", "v:output:String")
    assert said.endswith('connector "v" is String: columns of a file can be Real, Integer, Boolean')
    (said,) = refused(workshop, tmp_path, "time,v\n0,1\n", "v:output:Real", type="text/csv; header=absent")
    assert said.endswith('type "text/csv; header=absent": after ";" valid is: interpolation=linear, interpolation=hold')


def test_files_that_are_no_parquet(workshop: Any, tmp_path: Path) -> None:
    (said,) = refused(workshop, tmp_path, ROWS, type="application/vnd.apache.parquet")
    assert said.startswith("in.csv: is not a Parquet file: ")


def test_a_system_of_tables_needs_a_step(workshop: Any, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text(ROWS)
    file = workshop.ssd("s.ssd", workshop.system(workshop.component("t", "in.csv", COLUMNS, type="text/csv")))
    with pytest.raises(SystemDescriptionError, match="t: no step size: neither the system nor the FMU names one"):
        simulate(file, RunOptions(until=1.0))
    assert run(file, step=1.0, until=2.0)["t.n"] == [1, 2, 5]
