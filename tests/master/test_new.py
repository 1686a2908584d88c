"""Generated systems: what is written checks, is linear in the number of drones, and flies."""

from __future__ import annotations

import gc
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim_master.check import check
from cosim_master.errors import SystemDescriptionError
from cosim_master.layout import layout
from cosim_master.network import network_of
from cosim_master.new import new_system
from cosim_master.simulation import prepare, simulate
from cosim_master.ssp import read_system


def test_a_line_is_wired_and_numbered(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 5, tmp_path / "line", fmus=fmus, spacing=10.0)
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
    assert [i.name for i in checked.instances][:3] == ["drone1.agent", "drone1.autopilot", "drone1.vehicle"]
    assert len(checked.instances) == 15
    starts = {i.name: i.start_values for i in checked.instances}
    east = [starts[f"drone{n}.vehicle"]["position_start[2]"] for n in range(1, 6)]
    assert east == [0.0, 5.0, 10.0, 30.0, 40.0]
    assert [starts[f"drone{n}.agent"]["stubborn"] for n in range(1, 6)] == [True, False, False, False, True]
    neighbours = [
        (starts[f"drone{n}.agent"]["left_sysid"], starts[f"drone{n}.agent"]["right_sysid"]) for n in range(1, 6)
    ]
    assert neighbours == [(0, 2), (1, 3), (2, 4), (3, 5), (4, 0)]
    assert ("drone2", "drone3") in network.links
    assert ("drone1", "drone3") not in network.links


def test_a_grid_is_lines_beside_each_other(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("grid", 11, tmp_path / "grid", fmus=fmus, spacing=20.0)
    with read_system(folder) as structure:
        checked = check(structure)
        network = network_of(checked)
    starts = {i.name: i.start_values for i in checked.instances}
    north = [starts[f"drone{n}.vehicle"]["position_start[1]"] for n in range(1, 12)]
    assert north == [0.0] * 4 + [20.0] * 4 + [40.0] * 3
    stubborn = [n for n in range(1, 12) if starts[f"drone{n}.agent"]["stubborn"]]
    assert stubborn == [1, 4, 5, 8, 9, 11]
    assert ("drone4", "drone5") not in network.links


def test_ids_repeat_where_mavlink_has_no_more_and_neighbours_still_differ(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 252, tmp_path / "long", fmus=fmus)
    with read_system(folder) as structure:
        checked = check(structure)
    agents = [i.start_values for i in checked.instances if i.name.endswith(".agent")]
    assert [a["sysid"] for a in agents[248:]] == [249, 250, 1, 2]
    assert (agents[249]["left_sysid"], agents[249]["right_sysid"]) == (249, 1)
    assert len(checked.instances) == 756


def _processor_time_to_check(folder: Path) -> float:
    gc.collect()
    began = time.process_time()
    with read_system(folder) as structure:
        ready = prepare(check(structure))
        layout(ready.checked, ready.network, ready.recording.signals, ready.coupling)
    return time.process_time() - began


def test_checking_is_linear_in_the_number_of_drones(fmus: Path, tmp_path: Path) -> None:
    """Eight times the drones take about eight times the work; with one pass over all per instance it was 46 times."""
    few = new_system("line", 100, tmp_path / "few", fmus=fmus)
    many = new_system("line", 800, tmp_path / "many", fmus=fmus)
    small = min(_processor_time_to_check(few) for _ in range(3))
    large = min(_processor_time_to_check(many) for _ in range(2))
    assert large / small < 16.0


def test_a_new_line_flies_and_spreads(fmus: Path, tmp_path: Path) -> None:
    folder = new_system("line", 4, tmp_path / "line", fmus=fmus, spacing=12.0)
    result = simulate(folder, out=tmp_path / "out", until=60.0, record=["*.vehicle.position*"])
    assert result.outcome == "done"
    table = pq.read_table(tmp_path / "out" / "signals.parquet")
    assert table.num_columns == 1 + 4 * 3
    east = np.array([table[f"drone{n}.vehicle.position[2]"].to_numpy()[-1] for n in range(1, 5)])
    assert east == pytest.approx([0.0, 12.0, 24.0, 36.0], abs=0.6)


def test_all_problems_of_a_request_at_once(tmp_path: Path) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        new_system("ring", 2, tmp_path, fmus=tmp_path / "nowhere", spacing=0.0)
    text = str(caught.value)
    assert "ring: is no shape: there are line, grid" in text
    assert "--drones: 2: two that stay and one that moves are the least" in text
    assert "exists already" in text
    assert "--spacing: 0 m: must be positive" in text
    for name in ("Quadrotor", "Autopilot", "LineAgent"):
        assert f"{name}.fmu" in text
