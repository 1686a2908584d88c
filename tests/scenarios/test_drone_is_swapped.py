"""One drone gets another vehicle; everything else stays as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim_master.system.authoring.swap import swap
from tests.scenarios.flights import SYSTEMS, fly, plain_line


def test_a_hexarotor_takes_the_place_of_a_quadrotor(fmus: Path, tmp_path: Path) -> None:
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / "Hexarotor.fmu", tmp_path / "swapped")
    flight = fly(swapped, tmp_path / "out")
    plain = plain_line()
    assert [flight.east(drone)[-1] for drone in range(1, 6)] == pytest.approx([0, 25, 50, 75, 100], abs=1.0)
    motors = [np.abs(flight[f"drone3.autopilot.motor[{i}]"]).max() for i in range(1, 9)]
    assert all(m > 0.3 for m in motors[:6])
    assert motors[6:] == [0.0, 0.0]
    assert np.abs(plain["drone3.autopilot.motor[5]"]).max() == 0.0
    before = flight.row_of_step(1)
    for name in ("drone1.vehicle.position[3]", "drone5.vehicle.position[2]", "drone1.autopilot.motor[1]"):
        assert np.array_equal(flight[name][:before], plain[name][:before])  # those who do not listen to drone 3 yet


def test_the_shipped_system_with_a_hexarotor_flies_like_the_swapped_one(fmus: Path, tmp_path: Path) -> None:
    swapped = swap(SYSTEMS / "line5", "drone3.vehicle", fmus / "Hexarotor.fmu", tmp_path / "swapped")
    a = fly(swapped, tmp_path / "a", until=40.0)
    b = fly(SYSTEMS / "line5-hexa", tmp_path / "b", until=40.0)
    assert (a.folder / "signals.parquet").read_bytes() == (b.folder / "signals.parquet").read_bytes()
