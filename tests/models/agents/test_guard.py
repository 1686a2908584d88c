"""The guard: the nearest velocity within all bounds, separation, fence; with loss, and when drones come and go."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from cosim_models.agents.kit import ERRORS
from cosim_models.agents.parts.guard import ACCELERATION, NOTHING_NEW, POSITION, VELOCITY, fence_is_convex
from cosim_models.agents.parts.guard import guard as guard_at
from cosim_models.agents.rendezvous import Rendezvous, rendezvous
from tests.models.agents.point_masses import Array, PointMasses

APART, P = 5.0, 0.5
SQUARE = {"fence_corners": 4, "fence_north": (30.0, 30.0, -30.0, -30.0), "fence_east": (-30.0, 30.0, 30.0, -30.0)}


def guard(m: Any, now: float, which: int) -> int:
    return int(guard_at(m, now, which, m.position, m.velocity))


def corners(values: tuple[float, ...]) -> Array:
    return np.array((*values, *[0.0] * (8 - len(values))))


def fence(**given: Any) -> dict[str, Any]:
    return {name: corners(value) if isinstance(value, tuple) else value for name, value in given.items()}


def masses(starts: Array, **more: Any) -> PointMasses:
    """Drones that all fly to one another: without the guard they meet."""
    given = {"gain": 0.2, "speed_limit": 6.0, "guard_separation": APART, "guard_p": P, **more}
    return PointMasses(Rendezvous, rendezvous, starts, **given)


def scattered(n: int, apart: float, size: float, seed: int = 11) -> Array:
    random, places = np.random.default_rng(seed), np.empty((0, 2))
    while len(places) < n:
        place = random.uniform(-0.5 * size, 0.5 * size, 2)
        if not len(places) or np.linalg.norm(places - place, axis=1).min() >= apart:
            places = np.vstack((places, place))
    return places


def distances(places: Array) -> Array:
    """Of all pairs [m]."""
    away = np.linalg.norm(places[:, None] - places[None], axis=2)
    return np.asarray(away[np.triu_indices(len(places), 1)])


def test_a_hundred_that_want_to_meet_keep_their_separation() -> None:
    """Of no pair does the distance beyond the separation shrink by more than the factor 1 - p T in a period."""
    swarm = masses(scattered(100, 6.0, 120.0))
    rooms = [distances(swarm.plane) - APART]
    for _ in range(300):
        swarm.turn()
        rooms.append(distances(swarm.plane) - APART)
    falls = np.array(rooms[1:]) - (1.0 - P * 0.2) * np.array(rooms[:-1])
    assert falls.min() > -1e-7
    assert np.min(rooms) > 0.0
    away = np.linalg.norm(swarm.plane[:, None] - swarm.plane[None], axis=2) + 1e3 * np.eye(100)
    assert np.median(away.min(axis=1)) < APART + 0.1  # and they have come together
    assert (swarm.m.guard_acts > 0).all()


@pytest.mark.parametrize(("loss", "least"), [(0.0, 4.7), (0.2, 4.4)])
def test_vehicles_that_lag_come_a_little_nearer(loss: float, least: float) -> None:
    swarm = masses(scattered(60, 6.0, 100.0), loss=loss, lag=0.5)
    assert min(distances(places).min() for places in swarm.run(60.0)) > least


def test_without_the_guard_they_meet_and_where_it_need_not_act_it_changes_no_bit() -> None:
    starts = scattered(12, 6.0, 60.0)
    assert distances(masses(starts, guard_separation=0.0).run(30.0)[-1]).max() < 0.1
    free, guarded = (masses(starts, guard_separation=apart, gain=0.002) for apart in (0.0, 0.1))
    assert (guarded.run(10.0) == free.run(10.0)).all()
    assert (np.array(guarded.m.guard_acts) == 0).all()


def test_those_that_leave_fail_and_return_are_kept_away_from_while_they_are_heard() -> None:
    swarm = masses(scattered(12, 6.0, 60.0), loss=0.2)
    swarm.alive[0] = False  # has not joined yet
    swarm.run(20.0)
    swarm.alive[[0, 3]] = True, False  # joins; fails
    path = swarm.run(20.0)
    assert min(distances(places[swarm.alive]).min() for places in path[10:]) > APART - 0.5
    near = swarm.plane[np.arange(12) != 3]
    swarm.m.position[3, :2] = near.mean(axis=0)  # returns in the middle of all
    swarm.alive[3] = True
    first = distances(swarm.plane).min()
    path = swarm.run(40.0)
    assert first < 4.0
    assert distances(path[-1]).min() > APART - 0.1


def test_nobody_leaves_the_fence_and_one_outside_returns() -> None:
    starts = np.vstack((scattered(10, 6.0, 50.0), [[60.0, 5.0]]))
    far = np.array([[400.0, 300.0]])  # a stranger without a guard that draws everybody out
    swarm = masses(np.vstack((starts, far)), **fence(**SQUARE))
    swarm.m.fence_corners[-1] = 0
    swarm.m.gain[-1] = 0.0
    path = swarm.run(60.0)[:, :-1]
    assert np.abs(path[:, :10]).max() <= 30.0 + 1e-9
    assert np.abs(path[-1]).max() < 30.01
    assert path[-1].max(axis=0) == pytest.approx((30.0, 30.0), abs=1.0)
    assert distances(path[-1]).min() > APART - 1e-6


def nearest_within(want: Array, directions: Array, speeds: Array) -> Array | None:
    """The nearest velocity that keeps all bounds: the best of all vertices and projections that do."""
    lines = [want - (d @ want - s) * d for d, s in zip(directions, speeds, strict=True)]
    for i, j in combinations(range(len(speeds)), 2):
        pair = directions[[i, j]]
        if abs(np.linalg.det(pair)) > 1e-9:
            lines.append(np.linalg.solve(pair, speeds[[i, j]]))
    allowed = [v for v in (want, *lines) if (directions @ v <= speeds + 1e-9).all()]
    return min(allowed, key=lambda v: float(np.linalg.norm(v - want))) if allowed else None


def test_the_velocity_is_the_nearest_one_within_all_bounds() -> None:
    """Against all vertices, for random neighbours; some are too near already."""
    random = np.random.default_rng(2)
    found = 0
    for _ in range(300):
        count = int(random.integers(1, 9))
        angles, away = random.uniform(0.0, 2.0 * np.pi, count), random.uniform(APART - 0.4, APART + 4.0, count)
        m = Rendezvous.record()
        m.guard_separation, m.speed_limit, m.guard_p = APART, 100.0, P
        directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        m.heard_id[:count] = 2 + np.arange(count)
        m.heard_position[:count, :2] = away[:, None] * directions
        want = random.uniform(-4.0, 4.0, 2)
        m.setpoint_velocity[:2] = want
        assert guard(m, 0.0, VELOCITY) == VELOCITY
        room = 0.5 * (away - APART)
        speeds = np.where(room > 5.0, np.sqrt(2.5 * np.maximum(room - 2.5, 0.0)), P * room)
        best = nearest_within(want, directions, speeds)
        if best is None:
            low, high = 0.0, float(-speeds.min())
            for _ in range(40):
                middle = 0.5 * (low + high)
                fits = nearest_within(want, directions, speeds + middle) is not None
                low, high = (low, middle) if fits else (middle, high)
            best = nearest_within(want, directions, speeds + high)
        else:
            found += 1
        assert best is not None
        assert np.array(m.setpoint_velocity[:2]) == pytest.approx(best, abs=1e-4)
    assert 100 < found < 300


def test_two_at_one_place_part_and_those_at_other_heights_do_not_matter() -> None:
    swarm = masses(np.zeros((2, 2)), gain=0.0)
    swarm.run(20.0)
    assert swarm.plane[0] == pytest.approx((0.5 * APART, 0.0), abs=0.05)
    assert swarm.plane[1] == pytest.approx((-0.5 * APART, 0.0), abs=0.05)
    above = masses(np.zeros((2, 2)), gain=0.0)
    above.m.position[1, 2], above.m.altitude[1] = -10.0 - APART, 10.0 + APART
    above.run(2.0)
    assert (above.plane == 0.0).all()


@pytest.mark.parametrize(
    ("which", "velocity"),
    [
        (VELOCITY, (1.0, 2.0, 0.5)),
        (POSITION, (2.0, 0.0, -0.5)),
        (POSITION + VELOCITY, (3.0, 2.0, 0.0)),
        (ACCELERATION, (0.2, 0.1, 0.02)),
        (VELOCITY + ACCELERATION, (1.2, 2.1, 0.52)),
    ],
)
def test_what_a_law_gives_becomes_a_velocity_which_is_kept_until_it_gives_more(which: int, velocity: Any) -> None:
    m = Rendezvous.record()
    m.guard_separation, m.guard_p, m.speed_limit = 1.0, P, 10.0
    assert guard(m, 0.0, NOTHING_NEW) == NOTHING_NEW
    m.setpoint_position[:] = 4.0, 0.0, -1.0
    m.setpoint_velocity[:] = 1.0, 2.0, 0.5
    m.setpoint_acceleration[:] = 1.0, 0.5, 0.1
    assert guard(m, 0.0, which) == VELOCITY
    assert m.setpoint_velocity == pytest.approx(velocity)
    m.setpoint_position[:], m.setpoint_velocity[:] = 0.0, 0.0
    assert guard(m, 0.2, NOTHING_NEW) == VELOCITY
    assert m.setpoint_velocity == pytest.approx(velocity)


def test_the_codes_of_errors_pass() -> None:
    m = Rendezvous.record()
    assert [guard(m, 0.0, which) for which in (-3, 8)] == [-3, 8]


@pytest.mark.parametrize(
    ("given", "convex"),
    [
        ({}, True),
        (SQUARE, True),
        ({"fence_corners": 3, "fence_north": (0.0, 9.0, 0.0), "fence_east": (0.0, 0.0, 9.0)}, True),
        ({"fence_corners": 2, "fence_north": (0.0, 9.0), "fence_east": (0.0, 0.0)}, False),
        ({"fence_corners": 3, "fence_north": (0.0, 4.0, 9.0), "fence_east": (0.0, 0.0, 0.0)}, False),
        ({"fence_corners": 4, "fence_north": (0.0, 9.0, 2.0, 0.0), "fence_east": (0.0, 0.0, 2.0, 9.0)}, False),
        ({"fence_corners": 4, "fence_north": (0.0, 9.0, 0.0, 9.0), "fence_east": (0.0, 9.0, 9.0, 0.0)}, False),
    ],
    ids=["none", "square", "triangle", "two corners", "on a line", "dented", "crossed"],
)
def test_a_fence_is_convex(given: dict[str, Any], convex: bool) -> None:
    m = Rendezvous.record()
    for name, value in fence(**given).items():
        m[name] = value
    assert fence_is_convex(m) is convex
    start, _ = Rendezvous.kernels
    assert start(m) == (0 if convex else 5)
    assert 5 in ERRORS


@pytest.mark.parametrize("p", [0.0, 5.1])
def test_a_gain_with_which_it_flies_past_its_bounds_is_an_error(p: float) -> None:
    m = Rendezvous.record()
    start, _ = Rendezvous.kernels
    m.guard_p = p
    assert start(m) == 0
    m.guard_separation = 1.0
    assert start(m) == 6
    assert 6 in ERRORS
