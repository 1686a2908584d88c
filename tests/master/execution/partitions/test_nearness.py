"""Parts of units that are near each other, against grids whose cuts are known, and places that systems declare."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.execution.partitions.cut import cut
from cosim_master.execution.partitions.nearness import cut_by_places
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.system.authoring.swarm.new import fleet_of, new_system
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system

GRID = {8 * row + column: (8.0 * row, 7.0 * column, 0.0) for row in range(8) for column in range(8)}


def test_a_square_is_cut_into_quarters_wherever_its_units_stand_in_the_list() -> None:
    order = np.random.default_rng(1).permutation(64).tolist()
    found = cut_by_places(dict.fromkeys(order, 3), GRID, 4)
    quarters = {unit: (unit // 8 >= 4, unit % 8 >= 4) for unit in GRID}
    assert len({(found[unit], quarters[unit]) for unit in GRID}) == 4


def test_three_parts_of_a_line_are_thirds_by_weight() -> None:
    line = {unit: (0.0, 5.0 * unit, 0.0) for unit in range(9)}
    assert [cut_by_places(dict.fromkeys(line, 2), line, 3)[u] for u in line] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    heavy = dict.fromkeys(line, 2) | {0: 20}
    assert [cut_by_places(heavy, line, 3)[u] for u in line] == [0, 1, 1, 1, 1, 2, 2, 2, 2]


@given(
    st.lists(st.tuples(*[st.floats(-1e3, 1e3)] * 3), min_size=4, max_size=20),
    st.lists(st.integers(1, 30), min_size=20, max_size=20),
    st.integers(1, 4),
    st.integers(0, 3),
)
def test_no_part_is_empty(places: list[tuple[float, ...]], weights: list[int], parts: int, missing: int) -> None:
    weight = dict(enumerate(weights[: len(places)]))
    known = {unit: place for unit, place in enumerate(places) if unit >= missing}
    found = cut_by_places(weight, known, parts)
    assert set(found) == set(weight)
    assert set(found.values()) == set(range(parts))


@pytest.mark.parametrize(("reach", "blocks"), [("20", True), ("INF", False)])
def test_a_swarm_with_a_range_is_cut_by_places(fmus: Path, tmp_path: Path, reach: str, blocks: bool) -> None:
    """A grid of sixteen, row by row: quarters with a range, and otherwise rows."""
    fleet = {"vehicle": fleet_of("PointMass"), "autopilot": fleet_of("IdealAutopilot")}
    system = new_system("flocking", 16, tmp_path / "grid", fmus=fmus, spacing=8.0, until=1.0, fleet=fleet)
    with read_system(system) as structure:
        found = cut(prepare(check(structure, {"network.range": reach})), 4)
    quarters = [(n // 4 >= 2, n % 4 >= 2) for n in range(16)]
    rows = [n // 4 for n in range(16)]
    assert len({*zip(found.of_node, quarters if blocks else rows, strict=True)}) == 4
    assert [found.count(part) for part in range(4)] == [4 * 3] * 4
