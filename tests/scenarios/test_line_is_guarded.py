"""The guard of the line's agents: with a gain that breaks the order, drones keep apart and inside of a fence."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.scenarios.flights import SYSTEMS, Flight, fly

FENCE = {
    "fence_corners": "4",
    **{f"fence_north[{k}]": value for k, value in enumerate(("20", "20", "-20", "-20"), 1)},
    **{f"fence_east[{k}]": value for k, value in enumerate(("-20", "60", "60", "-20"), 1)},
}


def nearest(flight: Flight) -> float:
    """The least distance of two drones that fly [m]."""
    begin = int(np.searchsorted(flight["time"], 20.0))
    axes = [[flight[f"drone{i}.vehicle.position[{k}]"][begin:] for k in (1, 2, 3)] for i in range(1, 6)]
    places = np.array(axes)
    return min(float(np.linalg.norm(places[a] - places[b], axis=0).min()) for a in range(5) for b in range(a + 1, 5))


def test_a_guarded_line_keeps_its_distance_and_stays_within_its_fence(fmus: Path, tmp_path: Path) -> None:
    """Heard is who is a neighbour on the line; both of a pair give way, the ends too."""
    starts = {
        f"drone{n}.vehicle.position_start[2]": f"{place}" for n, place in zip((2, 3, 4), (10, 40, 50), strict=True)
    }
    free = {**starts, "drone*.agent.epsilon": "0.9"}
    guard = {
        **free,
        "drone*.agent.guard_separation": "6",
        **{f"drone4.agent.{name}": value for name, value in FENCE.items()},
    }
    alone = fly(SYSTEMS / "line5", tmp_path / "free", overrides=free, until=60.0)
    kept = fly(SYSTEMS / "line5", tmp_path / "guarded", overrides=guard, until=60.0)
    assert nearest(alone) < 1.0
    assert nearest(kept) > 5.5
    assert alone.east(4).max() > 70.0
    assert kept.east(4).max() < 60.3
    assert kept["drone4.agent.target"].max() > 65.0  # its law wants to go there
