"""Rendezvous: the hull shrinks at the rate of the graph and the mean stays; with loss, and when drones come and go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.tri import Triangulation

from cosim_models.agents.rendezvous import Rendezvous, rendezvous
from tests.models.agents.point_masses import Array, PointMasses

GAIN = 0.1


def ring(n: int, each_side: int = 1) -> Any:
    """Who hears whom on a ring."""
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return (np.minimum(apart, n - apart) <= each_side) & (apart > 0)


def scattered(n: int, seed: int = 3) -> Array:
    return np.random.default_rng(seed).uniform(-50.0, 50.0, (n, 2))


def area(places: Array) -> float:
    """Of the convex hull [m2], by qhull."""
    a, b, c = (places[corner] for corner in Triangulation(*places.T).triangles.T)
    (u, v), (w, x) = (b - a).T, (c - a).T
    return float(0.5 * np.abs(u * x - v * w).sum())


def masses(starts: Array, graph: Any, **more: Any) -> PointMasses:
    return PointMasses(Rendezvous, rendezvous, starts, hears=graph, gain=GAIN, speed_limit=1e3, **more)


def test_the_distance_shrinks_at_the_second_eigenvalue_of_the_laplacian() -> None:
    """Discrete with period T: (1 - T gain lambda_2) per period, exactly so in the mode of that eigenvalue."""
    n = 12
    graph = ring(n)
    laplacian = np.diag(graph.sum(axis=1)) - graph
    values, modes = np.linalg.eigh(laplacian)
    assert values[1] == pytest.approx(2.0 - 2.0 * np.cos(2.0 * np.pi / n))
    starts = 40.0 * modes[:, 1:3]
    swarm = masses(starts, graph)
    swarm.m.velocity[:] = 0.0
    t = float(swarm.m.period[0])
    swarm.turn()
    assert swarm.plane == pytest.approx(starts * (1.0 - t * GAIN * values[1]), abs=1e-9)


@pytest.mark.parametrize(("loss", "off", "rel"), [(0.0, 1e-6, 0.05), (0.2, 1.0, 0.08)])
def test_a_hundred_meet_at_the_mean_of_their_starts(loss: float, off: float, rel: float) -> None:
    """With loss, a drone may see another one where that no longer is: the mean moves a little."""
    starts = scattered(100)
    graph = ring(100, each_side=8)
    slowest = np.linalg.eigvalsh(np.diag(graph.sum(axis=1)) - graph)[1]
    swarm = masses(starts, graph, loss=loss)
    path = swarm.run(60.0)
    away = np.linalg.norm(path - path[-1].mean(axis=0), axis=2).max(axis=1)
    assert path[-1].mean(axis=0) == pytest.approx(starts.mean(axis=0), abs=off)
    late = slice(150, 290)
    rate = np.polyfit(0.2 * np.arange(300)[late], np.log(away[late]), 1)[0]
    assert rate == pytest.approx(-GAIN * slowest, rel=rel)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_nobody_leaves_the_hull_of_the_starts(loss: float) -> None:
    starts = scattered(20)
    path = masses(starts, ring(20, each_side=2), loss=loss, lag=0.5).run(40.0)
    within = Triangulation(*starts.T).get_trifinder()
    centre = starts.mean(axis=0)
    assert all((within(*(centre + 0.999 * (places - centre)).T) >= 0).all() for places in path)
    areas = [area(places) for places in path[::25]]
    assert (np.diff(areas) < 0.0).all()
    assert areas[-1] < 0.05 * areas[0]


def test_with_loss_they_meet_all_the_same() -> None:
    path = masses(scattered(20), ring(20, each_side=4), loss=0.2, lag=0.5).run(60.0)
    assert np.ptp(path[-1], axis=0).max() < 1.0


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_one_that_fails_is_forgotten_and_one_that_returns_is_met(loss: float) -> None:
    starts = scattered(8)
    everybody = ~np.eye(8, dtype=bool)
    swarm = masses(starts, everybody, lag=0.5, loss=loss)
    swarm.alive[0] = False  # has not joined yet
    swarm.run(10.0)
    assert (swarm.m.neighbours[1:] == 6).all()
    assert np.linalg.norm(swarm.plane[0] - starts[0]) == 0.0
    swarm.alive[0] = True
    swarm.alive[7] = False  # fails where it is
    swarm.run(0.8)
    assert (swarm.m.neighbours[1:7] == 7).all()  # not yet stale
    swarm.run(1.0)
    assert (swarm.m.neighbours[:7] == 6).all()
    swarm.run(30.0)
    assert np.ptp(swarm.plane[:7], axis=0).max() < 0.1
    met, lonely = swarm.plane[0], swarm.plane[7]
    swarm.alive[7] = True
    swarm.run(40.0)
    assert np.ptp(swarm.plane, axis=0).max() < 0.1
    assert swarm.plane[0] == pytest.approx(met + (lonely - met) / 8.0, abs=0.5)
