"""Flocking: distances, matched velocities, the virtual leader, obstacles; with loss, and when drones come and go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim_models.agents.flocking import Flocking, flocking
from tests.models.agents.point_masses import Array, PointMasses

LAG = 0.5
"""Of the point masses' velocity [s], and `response`: then they accelerate as the law says."""


def masses(starts: Array, **more: Any) -> PointMasses:
    given = {"lag": LAG, "response": LAG, "speed_limit": 10.0, **more}
    return PointMasses(Flocking, flocking, starts, **given)


def scattered(n: int, apart: float, size: float, seed: int = 4) -> Array:
    """Random places at least `apart` from each other."""
    random, places = np.random.default_rng(seed), np.empty((0, 2))
    while len(places) < n:
        place = random.uniform(-0.5 * size, 0.5 * size, 2)
        if not len(places) or np.linalg.norm(places - place, axis=1).min() >= apart:
            places = np.vstack((places, place))
    return places


def separation(places: Array) -> Array:
    """Distance of each drone to the nearest other one [m]."""
    away = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(away, np.inf)
    return np.asarray(away.min(axis=1))


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_two_settle_at_the_distance_and_conserve_their_momentum(loss: float) -> None:
    """Without a virtual leader only inner forces act; the potential has its minimum at `distance`."""
    swarm = masses(np.array([[0.0, 0.0], [9.0, 3.0]]), c1=0.0, c2=0.0, loss=loss)
    path = swarm.run(60.0)
    assert np.linalg.norm(path[-1, 1] - path[-1, 0]) == pytest.approx(10.0, abs=0.02)
    assert swarm.m.velocity[0, :2] == pytest.approx(np.array(swarm.m.velocity[1, :2]), abs=0.01)
    if not loss:  # with loss, their forces are not opposite at all times
        assert path.mean(axis=1) == pytest.approx(np.tile((4.5, 1.5), (len(path), 1)), abs=1e-6)


def test_beyond_the_range_there_is_no_force() -> None:
    swarm = masses(np.array([[0.0, 0.0], [12.01, 0.0]]), c1=0.0, c2=0.0)
    assert swarm.run(5.0)[-1] == pytest.approx(np.array([[0.0, 0.0], [12.01, 0.0]]), abs=1e-12)


def test_the_acceleration_is_the_sources() -> None:
    """Written out once more, with numpy, for three drones and an obstacle, from the formulas of the paper."""
    swarm = masses(np.array([[0.0, 0.0], [9.0, 2.0], [-5.0, 7.0]]), acceleration_limit=1e3, speed_limit=1e3)
    m = swarm.m
    m.velocity[:, :2] = [[1.0, 0.5], [0.2, -0.3], [0.0, 0.8]]
    m.obstacle_north[:, 0], m.obstacle_east[:, 0], m.obstacle_radius[:, 0] = 4.0, -6.0, 3.0
    m.goal[:] = 30.0, 10.0
    q, p = m.position[:, :2].copy(), m.velocity[:, :2].copy()
    swarm.turn()

    def norm(z: Any) -> Any:
        return (np.sqrt(1.0 + 0.1 * np.square(z).sum()) - 1.0) / 0.1

    def bump(z: float, h: float) -> float:
        return float(np.select([z < h, z < 1.0], [1.0, 0.5 * (1.0 + np.cos(np.pi * (z - h) / (1.0 - h)))], 0.0))

    d, r = norm(np.array([10.0])), norm(np.array([12.0]))
    u = 0.005 * (np.array([30.0, 10.0]) - q[0]) + 0.3 * (0.0 - p[0])
    for j in (1, 2):
        way = q[j] - q[0]
        z = norm(way)
        sigma = (z - d) / np.sqrt(1.0 + (z - d) ** 2)
        u += 0.2 * bump(z / r, 0.2) * 5.0 * sigma * way / np.sqrt(1.0 + 0.1 * way @ way)
        u += 2.0 * bump(z / r, 0.2) * (p[j] - p[0])
    centre = np.array([4.0, -6.0])
    away = np.linalg.norm(q[0] - centre)
    mu, a = 3.0 / away, (q[0] - centre) / away
    q_hat, p_hat = mu * q[0] + (1.0 - mu) * centre, mu * (np.eye(2) - np.outer(a, a)) @ p[0]
    way = q_hat - q[0]
    z, b = norm(way), norm(np.array([8.0]))
    near = bump(z / b, 0.9)
    u += 2.0 * near * ((z - b) / np.sqrt(1.0 + (z - b) ** 2) - 1.0) * way / np.sqrt(1.0 + 0.1 * way @ way)
    u += 0.5 * near * (p_hat - p[0])
    assert (np.array(m.setpoint_velocity[0, :2]) - p[0]) / LAG == pytest.approx(u, rel=1e-12)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_hundred_become_one_flock_that_flies_with_its_leader(loss: float) -> None:
    swarm = masses(scattered(100, 8.0, 140.0), loss=loss, goal_velocity=(1.5, 1.0))
    path = swarm.run(120.0)
    assert min(separation(places).min() for places in path) > 7.5
    assert np.array(swarm.m.velocity[:, :2]) == pytest.approx(np.tile((1.5, 1.0), (100, 1)), abs=0.3)
    assert path[-1].mean(axis=0) == pytest.approx((180.0, 120.0), abs=1.5)
    assert np.median(separation(path[-1])) == pytest.approx(9.6, abs=0.3)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_it_flows_around_an_obstacle(loss: float) -> None:
    starts = scattered(12, 8.0, 40.0) - (50.0, 0.0)
    obstacle = {name: (value, 0.0, 0.0, 0.0) for name, value in (("north", 0.0), ("east", 3.0), ("radius", 8.0))}
    swarm = masses(
        starts,
        loss=loss,
        goal=(-50.0, 0.0),
        goal_velocity=(1.0, 0.0),
        **{f"obstacle_{k}": v for k, v in obstacle.items()},
    )
    path = swarm.run(120.0)
    clear = np.linalg.norm(path - (0.0, 3.0), axis=2) - 8.0
    assert clear.min() > 1.0
    assert (path[-1, :, 0] > 20.0).all()
    assert min(separation(places).min() for places in path) > 4.0


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_those_that_fail_are_forgotten_until_they_return_and_a_late_one_is_taken_in(loss: float) -> None:
    swarm = masses(scattered(12, 8.0, 40.0), loss=loss)
    swarm.alive[0] = False
    swarm.run(40.0)
    swarm.alive[[0, 1]] = True, False
    swarm.run(60.0)
    rest = swarm.plane[swarm.alive]
    assert separation(rest).min() > 6.0
    assert np.linalg.norm(rest - rest.mean(axis=0), axis=1).max() < 25.0
    assert np.abs(swarm.m.velocity[swarm.alive]).max() < 0.1
    swarm.alive[1] = True  # returns
    swarm.run(90.0)
    assert separation(swarm.plane).min() > 6.0
    assert np.linalg.norm(swarm.plane - swarm.plane.mean(axis=0), axis=1).max() < 25.0
