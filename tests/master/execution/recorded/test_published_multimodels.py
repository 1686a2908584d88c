"""Published multi-models give what Maestro recorded of them.

They are not part of this project. Clone github.com/mapalmieri/IEEEAccessDrones and github.com/mapalmieri/Platoon and
name their folders in the environment variables IEEE_ACCESS_DRONES and PLATOON. Some FMUs need liblapack.so.3. Where
Voronoi.fmu is not there (it is larger than some mirrors keep), its recorded outputs take its place; quadrotors and
controllers are computed either way.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from tests.master.recorded import recording, stand_in

FOLDER = os.environ.get("IEEE_ACCESS_DRONES", "")
PLATOON = os.environ.get("PLATOON", "")
pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.mark.skipif(not FOLDER, reason="IEEE_ACCESS_DRONES names no folder with the published multi-model")
def test_ten_drones_as_maestro_flew_them(tmp_path: Path) -> None:
    try:
        ctypes.CDLL("liblapack.so.3")
    except OSError as error:
        pytest.skip(f"the FMUs cannot be loaded here: {error}")
    project = tmp_path / "project"
    shutil.copytree(FOLDER, project, ignore=shutil.ignore_patterns(".git", "*.mp4"))
    (run,) = project.glob("Multi-models/*/co-sim/R_*")
    rows = recording(run / "outputs.csv")
    computed = ("{Control", "{Plant}", "{Parameters}")
    if not (project / "FMUs" / "Voronoi.fmu").is_file():
        connections = json.loads((run / "config.json").read_text())["connections"]
        ends = [end for targets in connections.values() for end in targets if end.startswith("{Voronoi}")]
        inputs = sorted({end.split(".", 2)[2] for end in ends})
        made = stand_in(tmp_path / "stand_in", "Voronoi", rows, "{Voronoi}.VoronoiInstance.", inputs, 0.05)
        shutil.copy(made, project / "FMUs" / "Voronoi.fmu")
    else:
        computed = (*computed, "{Voronoi}")
    result = simulate(run / "config.json", RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert len(got["time"]) == len(rows) == 961
    names = [name for name in rows[0] if name.startswith(computed)]
    assert len(names) >= 162
    moved = 0
    for name in names:
        expected = [row[name] for row in rows]
        assert max(abs(a - b) for a, b in zip(got[name], expected, strict=True)) <= 1e-9, name
        moved += len(set(expected)) > 10
    assert moved > 100


@pytest.mark.skipif(not PLATOON, reason="PLATOON names no folder with the published multi-models")
def test_platoons_as_maestro_drove_them(tmp_path: Path) -> None:
    """All recorded runs, but for those whose FMUs need a program that is not here (MATLAB)."""
    project = tmp_path / "project"
    shutil.copytree(PLATOON, project, ignore=shutil.ignore_patterns(".git"))
    compared, missing = 0, []
    for file in sorted(project.glob("*/Multi-models/*/*/R_*/outputs.csv")):
        result = simulate(file.with_name("config.json"), RunOptions(out=tmp_path / "out"))
        if "cannot open shared object file" in str(result.error):
            missing.append(str(result.error))
            continue
        assert result.outcome == "done", result.error
        rows = recording(file)
        got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
        assert 0 <= len(got["time"]) - len(rows) <= 1  # Maestro adds its steps up, and may miss the last one
        names = [name for name in rows[0] if name.startswith("{")]
        assert names
        for name in names:
            expected = [row[name] for row in rows]
            assert max(abs(a - b) for a, b in zip(got[name], expected, strict=False)) <= 1e-9, (file, name)
        compared += 1
    if not compared:
        pytest.skip(f"no FMU can be loaded here: {missing[:1]}")
