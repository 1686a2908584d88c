"""The paper's second scenario: the mobile drones start at 0, 0 and 100 m, one above the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.flights import SYSTEMS, fly


def test_they_spread_evenly_from_the_ends(fmus: Path, tmp_path: Path) -> None:
    flight = fly(SYSTEMS / "line5-ends", tmp_path)
    at_17 = flight.end_of_step(17)
    ideal = [0.0, 0.0, 100.0]
    for _ in range(16):
        x = [0.0, *ideal, 100.0]
        ideal = [x[i] + (x[i - 1] - 2 * x[i] + x[i + 1]) / 3 for i in (1, 2, 3)]
    assert [flight.east(drone)[at_17] for drone in (2, 3, 4)] == pytest.approx(ideal, abs=0.6)
    assert [flight.east(drone)[-1] for drone in (2, 3, 4)] == pytest.approx([25, 50, 75], abs=1.0)
    first = flight.row_of_step(1)
    heights = [flight.up(drone)[first] for drone in range(1, 6)]
    assert heights == pytest.approx([10, 12, 14, 12, 10], abs=0.3)
    position = np.array([[flight[f"drone{d}.vehicle.position[{i}]"][first:] for i in (1, 2, 3)] for d in range(1, 6)])
    apart = [np.linalg.norm(position[a] - position[b], axis=0).min() for a in range(5) for b in range(a)]
    assert min(apart) > 1.5
