"""Coverage: cells are those of a fine grid, the cost never increases, and everybody ends at its centroid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cosim_models.agents.coverage import Coverage, coverage
from tests.models.agents.point_masses import Array, PointMasses

HALF = 50.0
CELL = 0.25


def grid(places: Array, peak: tuple[float, float] = (0.0, 0.0), width: float = 0.0) -> tuple[Array, Array, float]:
    """Masses and centroids of the cells, and the cost, by a sum over a fine grid."""
    axis = np.arange(-HALF + 0.5 * CELL, HALF, CELL)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    distances, owner = cKDTree(places).query(points)
    weight = np.full(len(points), CELL * CELL)
    if width:
        weight *= np.exp(-0.5 * ((points - peak) ** 2).sum(axis=1) / width**2)
    mass = np.bincount(owner, weight, len(places))
    moments = [np.bincount(owner, weight * points[:, i], len(places)) for i in range(2)]
    return mass, np.stack(moments, axis=1) / mass[:, None], float((weight * distances**2).sum())


def masses(n: int, **more: Any) -> PointMasses:
    starts = np.random.default_rng(8).uniform(-HALF, HALF, (n, 2)) * more.pop("within", 0.95)
    return PointMasses(Coverage, coverage, starts, speed_limit=1e3, **more)


@pytest.mark.parametrize(("peak", "width"), [((0.0, 0.0), 0.0), ((20.0, -10.0), 25.0)])
def test_cells_are_those_of_a_fine_grid(peak: tuple[float, float], width: float) -> None:
    swarm = masses(20, gain=0.0, peak=peak, peak_width=width)
    mass, centroids, cost = grid(swarm.plane, peak, width)
    swarm.turn()
    assert np.array(swarm.m.mass) == pytest.approx(mass, rel=0.02, abs=0.3)
    assert np.array(swarm.m.centroid) == pytest.approx(centroids, abs=0.12)
    assert swarm.m.cost.sum() == pytest.approx(cost, rel=1e-2)
    if not width:
        assert swarm.m.mass.sum() == pytest.approx(4.0 * HALF * HALF, rel=1e-12)


def test_with_loss_the_cost_falls_all_the_same() -> None:
    """By the true positions, once a second: what others have moved since they were heard is less than they gain."""
    swarm = masses(25, within=0.3, loss=0.2)
    costs = []
    for _ in range(20):
        costs.append(grid(swarm.plane)[2])
        swarm.run(1.0)
    assert (np.diff(costs) < 0.0).all()
    assert costs[-1] < 0.2 * costs[0]


def test_the_cost_never_increases() -> None:
    swarm = masses(25, within=0.3)  # in the middle, so that all cells change
    costs = [(swarm.turn(), float(swarm.m.cost.sum()))[1] for _ in range(300)]
    assert (np.diff(costs) < 0.0).all()
    assert costs[-1] < 0.15 * costs[0]
    assert costs[-1] == pytest.approx(grid(swarm.plane)[2], rel=1e-2)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_hundred_spread_knowing_the_24_nearest(loss: float) -> None:
    """Where they stand close, some do not hear all whose cells touch theirs: there a cell is too large for a while."""
    swarm = masses(100, within=0.3, loss=loss)
    costs = []
    for turn in range(300):
        if turn % 60 == 0:
            costs.append(grid(swarm.plane)[2])
        swarm.turn()
    assert (np.diff(costs) < 0.0).all()
    assert swarm.m.mass.sum() == pytest.approx(4.0 * HALF * HALF, rel=1e-2 if loss else 1e-9)
    ideal = 100 * (5.0 / (18.0 * np.sqrt(3.0))) * 100.0**2  # hexagons of 100 m2, the least that any cells have
    assert ideal < grid(swarm.plane)[2] < 1.25 * ideal


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_they_come_to_rest_at_their_centroids(loss: float) -> None:
    swarm = masses(8, loss=loss, lag=0.5)
    first = grid(swarm.plane)[2]
    swarm.run(80.0)
    assert np.linalg.norm(swarm.plane - grid(swarm.plane)[1], axis=1).max() < 0.5
    assert grid(swarm.plane)[2] < 0.8 * first


def test_the_hill_draws_them_together() -> None:
    swarm = masses(9, lag=0.5, peak=(20.0, 20.0), peak_width=15.0)
    swarm.run(160.0)
    _, centroids, _ = grid(swarm.plane, (20.0, 20.0), 15.0)
    assert np.linalg.norm(swarm.plane - centroids, axis=1).max() < 0.5
    assert swarm.plane.mean(axis=0) == pytest.approx((18.5, 18.5), abs=2.5)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_cells_of_those_that_fail_are_taken_over_until_they_return(loss: float) -> None:
    swarm = masses(6, lag=0.5, loss=loss)
    swarm.alive[0] = False
    swarm.run(40.0)
    assert swarm.m.mass[1:].sum() == pytest.approx(4.0 * HALF * HALF, rel=1e-3)
    swarm.alive[[0, 5]] = True, False
    swarm.run(60.0)
    assert swarm.m.mass[:5].sum() == pytest.approx(4.0 * HALF * HALF, rel=1e-3)
    assert np.linalg.norm(swarm.plane[:5] - grid(swarm.plane[:5])[1], axis=1).max() < 0.5
    swarm.alive[5] = True
    swarm.run(60.0)
    assert np.linalg.norm(swarm.plane - grid(swarm.plane)[1], axis=1).max() < 0.5


def test_one_outside_flies_to_the_area_first() -> None:
    starts = np.array([[200.0, 0.0], [100.0, 10.0], [-20.0, 0.0], [20.0, 0.0], [0.0, 30.0], [0.0, -30.0]])
    swarm = PointMasses(Coverage, coverage, starts, speed_limit=10.0, lag=0.5)
    swarm.run(100.0)
    assert np.abs(swarm.plane).max() < HALF
    assert np.linalg.norm(swarm.plane - grid(swarm.plane)[1], axis=1).max() < 0.5


def test_an_area_of_no_size_is_an_error() -> None:
    m = Coverage.record()
    m.area_north[:] = 50.0, -50.0
    assert coverage(m, 0.0, 0.2) == -10
    assert 10 in Coverage.errors
