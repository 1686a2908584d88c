"""The sweep: all cells are visited, by equal parts; with loss, and when drones join, leave, fail and return."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_models.agents.sweep import AreaSweep, sweep
from tests.models.agents.point_masses import Array, PointMasses

SPEED = 4.0


def masses(n: int, side: float = 100.0, **more: Any) -> PointMasses:
    """Drones that start in a row at the southern border."""
    starts = np.stack((np.full(n, -0.5 * side), np.linspace(-0.5 * side, 0.5 * side, n)), axis=1)
    area = np.array((-0.5 * side, 0.5 * side))
    given = {"area_north": area, "area_east": area, "speed": SPEED, "speed_limit": 10.0, **more}
    swarm = PointMasses(AreaSweep, sweep, starts, **given)
    swarm.m.home[:] = swarm.m.position
    return swarm


def firsts(path: Array, cells: int, side: float = 100.0) -> Array:
    """The drone that first came within 0.3 of each cell to its middle, -1: none; path: time, drone, north and east."""
    size = side / cells
    places = (path + 0.5 * side) / size
    index = np.floor(places).astype(int)
    near = (np.abs(places - index - 0.5) <= 0.3).all(axis=2) & (index >= 0).all(axis=2) & (index < cells).all(axis=2)
    found = np.full((cells, cells), -1)
    for k, drone in zip(*np.nonzero(near), strict=True):
        cell = tuple(index[k, drone])
        if found[cell] < 0:
            found[cell] = drone
    return found


def finished(swarm: PointMasses, path: Array) -> float:
    """When the last cell was visited [s]."""
    for k in range(1, len(path) + 1, 5):
        if (firsts(path[:k], 10) >= 0).all():
            return k * float(swarm.m.period[0])
    raise AssertionError("not all cells have been visited")


@pytest.mark.parametrize("n", [1, 2, 5])
def test_all_cells_are_visited_by_equal_parts(n: int) -> None:
    """The time is that of 100 / n cells and the way to the part: at most a side and a half."""
    swarm = masses(n)
    path = swarm.run(1200.0 / n / SPEED + 45.0)
    shares = np.bincount(firsts(path, 10).ravel(), minlength=n)
    assert shares.sum() == 100
    assert shares == pytest.approx(np.full(n, 100 / n), abs=10 if n > 1 else 0)
    assert finished(swarm, path) <= (1000.0 / n + 150.0) / SPEED
    assert (np.array(swarm.m.swept) == 1.0).all()
    assert (np.array(swarm.m.cell) == -1).all()
    assert swarm.plane == pytest.approx(np.array(swarm.m.home[:, :2]), abs=1.0)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_hundred_are_faster_than_ten(loss: float) -> None:
    """900 cells of 10 m: 90 or 9 of them each, and the way there."""
    times = []
    for n in (10, 100):
        swarm = masses(n, side=300.0, loss=loss)
        while swarm.m.swept.max() < 1.0:
            swarm.turn()
            assert swarm.t < 400.0
        times.append(swarm.t)
    assert times[0] < (90 * 10.0 + 450.0) / SPEED
    assert times[1] < (9 * 10.0 + 450.0) / SPEED


@pytest.mark.parametrize(("loss", "lag"), [(0.2, 0.0), (0.2, 0.5)])
def test_with_loss_all_cells_are_visited_all_the_same(loss: float, lag: float) -> None:
    swarm = masses(5, loss=loss, lag=lag)
    path = swarm.run(130.0)
    assert (firsts(path, 10) >= 0).all()
    assert finished(swarm, path) <= (1000.0 / 5 + 150.0 + 60.0) / SPEED


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_the_parts_of_those_that_fail_are_taken_over_until_they_return(loss: float) -> None:
    swarm = masses(5, loss=loss, lag=0.3)
    swarm.alive[4] = False  # joins later
    paths = [swarm.run(20.0)]
    swarm.alive[[1, 4]] = False, True
    paths.append(swarm.run(30.0))
    swarm.alive[[0, 1]] = False, True
    paths.append(swarm.run(150.0))
    path = np.concatenate(paths)
    assert (firsts(path, 10) >= 0).all()
    assert (np.array(swarm.m.swept)[[2, 3]] == 1.0).all()


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"area_north": (50.0, -50.0)}, 10),
        ({"area_east": (3.0, 3.0)}, 10),
        ({"swath": 1.0}, 11),
        ({"swath": 2.5}, 12),
    ],
)
def test_an_area_that_cannot_be_swept_is_an_error(given: dict[str, Any], code: int) -> None:
    m = AreaSweep.record()
    for name, value in given.items():
        m[name] = value
    assert sweep(m, 0.0, 0.2) == -code
    assert code in AreaSweep.errors
