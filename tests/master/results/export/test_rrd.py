"""The .rrd file, read back by Rerun's reader: values equal to the recording."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import CosimError
from cosim_master.results.export.formats import export_run, format_of
from cosim_master.results.export.options import Options
from tests.master.results.export.conftest import edited, rotation

pytestmark = pytest.mark.skipif(find_spec("rerun") is None, reason="the extra `rerun` is not installed")

DRONES = [f"drone{i}" for i in range(1, 6)]


class Read:
    """A file's contents: columns by entity and component, and the index of each; that of static ones is None."""

    def __init__(self, file: Path) -> None:
        from rerun import chunk  # takes more than half a second: only those who run these tests wait for it

        self.reader = chunk.RrdReader(file)
        found: dict[tuple[str, str], list[tuple[Any, list[Any]]]] = defaultdict(list)
        for one in self.reader.stream():
            batch = one.to_record_batch()
            time = None if one.is_static else batch.column("time").cast(pa.int64()).to_pylist()
            for name in batch.schema.names:
                if ":" in name:
                    found[one.entity_path, name].append((time, batch.column(name).to_pylist()))
        self.columns: Mapping[tuple[str, str], list[tuple[Any, list[Any]]]] = found

    def of(self, entity: str, component: str) -> tuple[list[int], list[Any]]:
        """The index [ns] and the values, of all chunks."""
        parts = sorted(self.columns[entity, component], key=lambda part: part[0][0])
        return [t for time, _ in parts for t in time], [value for _, values in parts for value in values]

    def still(self, entity: str, component: str) -> Any:
        ((time, (value,)),) = self.columns[entity, component]
        assert time is None
        return value


@pytest.fixture(scope="module")
def read(exported: Mapping[str, Path]) -> Read:
    return Read(exported["rrd"])


@pytest.fixture(scope="module")
def table(flown: Path) -> pa.Table:
    return pq.read_table(flown / "signals.parquet")


def stack(table: pa.Table, name: str, size: int) -> np.ndarray:
    return np.stack([table[f"{name}[{i + 1}]"].to_numpy() for i in range(size)], axis=1)


def test_all_signals_have_the_recorded_values_to_the_last_bit(read: Read, table: pa.Table) -> None:
    times = [round(1e9 * t) for t in table["time"].to_pylist()]
    seen = set()
    for entity, component in read.columns:
        if component != "SeriesLines:names":
            continue
        names = [name.partition(" ")[0] for name in read.still(entity, component)]
        index, values = read.of(entity, "Scalars:scalars")
        assert index == times
        expected = np.stack([table[name].to_numpy().astype(float) for name in names], axis=1)
        np.testing.assert_array_equal(np.array(values), expected, err_msg=entity)
        assert entity == "/signals/" + names[0].partition("[")[0].replace(".", "/")
        seen |= {*names}
    assert seen == {*table.column_names} - {"time"}
    names = read.still("/signals/drone3/vehicle/position", "SeriesLines:names")
    assert names == [f"drone3.vehicle.position[{i}] (m)" for i in (1, 2, 3)]


def test_poses_are_those_of_the_recording_in_32_bits(read: Read, table: pa.Table) -> None:
    to_enu, from_flu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    for drone in DRONES:
        north, east, down = stack(table, f"{drone}.vehicle.position", 3).T
        index, places = read.of(f"/world/{drone}", "Transform3D:translation")
        assert len(index) == 161 and index[1] == 100_000_000
        expected = np.stack([east, north, -down], axis=1).astype(np.float32)
        np.testing.assert_array_equal(np.array(places, dtype=np.float32)[:, 0], expected)
        _, turns = read.of(f"/world/{drone}", "Transform3D:quaternion")
        for ((x, y, z, w),), attitude in list(zip(turns, stack(table, f"{drone}.vehicle.attitude", 4), strict=True))[
            ::20
        ]:
            expected = to_enu @ rotation(attitude) @ from_flu
            np.testing.assert_allclose(rotation(np.array([w, x, y, z])), expected, atol=1e-6)
        assert read.still(f"/world/{drone}/body", "Boxes3D:labels") == [drone]
        ((strip),) = read.still(f"/paths/{drone}", "LineStrips3D:strips")
        np.testing.assert_array_equal(np.array(strip, dtype=np.float32), np.array(places, dtype=np.float32)[:, 0])
    assert read.still("/world", "ViewCoordinates:xyz")[0] == [3, 5, 1]  # right, forward, up: east, north, up


def test_places_on_earth_and_messages(read: Read, flown: Path) -> None:
    _, ((place,), *_) = read.of("/earth/drone5", "GeoPoints:positions")
    east = 149.165237 + np.degrees(100.0 / (6378100.0 * np.cos(np.radians(-35.363262))))
    assert place == pytest.approx((-35.363262, east), abs=1e-9)
    times, texts = read.of("/log", "TextLog:text")
    _, levels = read.of("/log", "TextLog:level")
    said = dict(zip([text for (text,) in texts], zip(times, levels, strict=True), strict=True))
    time, level = said["drone3: Arming motors"]
    assert 0 < time < 16e9 and level == ["INFO"]
    findings = json.loads((flown / "manifest.json").read_text())["verdict"]["findings"]
    assert all(any(finding["text"] in text for text in said) for finding in findings)


def test_the_viewer_begins_with_scene_plots_and_messages(exported: Mapping[str, Path], read: Read) -> None:
    (recording,) = read.reader.recordings()
    (blueprint,) = read.reader.blueprints()
    assert recording.application_id == blueprint.application_id == "uav-cosim"
    classes, contents = set(), set()
    for one in read.reader.stream(store=blueprint):
        batch = one.to_record_batch()
        for name in batch.schema.names:
            if name.endswith(":class_identifier"):
                classes |= {value for (value,) in batch.column(name).to_pylist()}
            if name.endswith("ViewContents:query"):
                contents |= {value for values in batch.column(name).to_pylist() for value in values}
    assert classes == {"3D", "TimeSeries", "TextLog"}
    plotted = {f"/signals/{drone}/vehicle/position" for drone in DRONES}
    assert contents >= plotted | {"/world/**", "/paths/**"}
    assert all((path, "Scalars:scalars") in read.columns for path in plotted)


def test_text_is_written_where_it_changes_and_names_may_contain_anything(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    columns: dict[str, Any] = {"time": [0.0, 0.5, 1.0, 1.5]}
    fields = [pa.field("time", pa.float64())]
    for i in (1, 2, 3):
        columns[f"a b/c.position[{i}]"] = [0.0, np.nan, 1e300, float(i)]
        fields.append(pa.field(f"a b/c.position[{i}]", pa.float64(), metadata={"unit": "m"}))
    columns |= {"a b/c.phase": ["up", "up", "", "down"], "a b/c.large": [2**53 - 1, 0, -1, 7]}
    fields += [pa.field("a b/c.phase", pa.string()), pa.field("a b/c.large", pa.int64())]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), run / "signals.parquet")
    (run / "manifest.json").write_text('{"instances": {}}')
    file = tmp_path / "x.rrd"
    (note,) = export_run(run, format_of(file), file, Options())
    assert note.startswith("no GeoPoints: no FMU declares the local origin")
    found = Read(file)
    place = r"/signals/a\ b\/c"
    assert found.of(f"{place}/phase", "StateChange:state") == ([0, 10**9, 15 * 10**8], [["up"], [""], ["down"]])
    assert found.of(f"{place}/large", "Scalars:scalars")[1] == [[2.0**53 - 1], [0.0], [-1.0], [7.0]]
    north = [value[0] for value in found.of(f"{place}/position", "Scalars:scalars")[1]]
    np.testing.assert_array_equal(north, [0.0, np.nan, 1e300, 1.0])
    assert found.of(r"/world/a\ b\/c", "Transform3D:quaternion")[0] == [0, 5 * 10**8, 10**9, 15 * 10**8]


def test_a_file_that_cannot_be_written(flown: Path, tmp_path: Path) -> None:
    (tmp_path / "x.rrd").touch()
    with pytest.raises(CosimError, match=r"x\.rrd/x\.rrd: cannot be written: File exists"):
        export_run(flown, format_of(Path("x.rrd")), tmp_path / "x.rrd" / "x.rrd", Options())


def test_a_run_of_which_only_positions_are_known(flown: Path, tmp_path: Path) -> None:
    """Without declared origin and attitudes: level, pointing north, nowhere on Earth."""

    def undeclared(manifest: Any) -> None:
        for fmu in manifest["fmus"].values():
            fmu["verdicts"] = {}

    run = edited(flown, tmp_path / "run", undeclared)
    positions = [name for name in pq.read_schema(flown / "signals.parquet").names if ".vehicle.position[" in name]
    only = pq.read_table(flown / "signals.parquet", columns=["time", *positions])
    (run / "signals.parquet").unlink()
    pq.write_table(only, run / "signals.parquet")
    file = tmp_path / "x.rrd"
    export_run(run, format_of(file), file, Options())
    found = Read(file)
    assert not [entity for entity, _ in found.columns if entity.startswith("/earth")]
    _, turns = found.of("/world/drone1", "Transform3D:quaternion")
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.array(turns)[:, 0], np.tile([0.0, 0.0, -half, -half], (161, 1)), atol=1e-7)
