"""Contacts and obstacles: geometry, Newton's third law, and energy that never grows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cosim.vehicle import Airframe
from cosim_models.environment.airspace import CAPACITY, Airspace
from cosim_models.environment.contact import terrain_at

H = 0.005
MASS, RADIUS = 1.545, 0.35  # of a quadrotor


def airspace(*places: tuple[float, float, float], **parameters: Any) -> Any:
    m = Airspace.record()
    m.count, m.contact = len(places), True
    for name, value in parameters.items():
        if isinstance(value, tuple):
            m[name][: len(value)] = value
        else:
            m[name] = value
    assert Airspace.kernels is not None
    assert Airspace.kernels[0](m) == 0
    m.position[: 3 * len(places)] = np.ravel(places)
    return m


def forces(m: Any, t: float = 0.0) -> np.ndarray:
    assert Airspace.kernels is not None
    assert Airspace.kernels[1](m, t, H) == 0
    return np.array(m.force[: 3 * int(m.count)]).reshape(-1, 3)


def stiffness(mass: float) -> float:
    """That for which an undamped contact, half an oscillation, lasts 0.1 s."""
    return mass * (math.pi / 0.1) ** 2


def test_spheres_that_touch_push_each_other_apart() -> None:
    first, second = forces(airspace((0.0, 0.0, -5.0), (0.0, 0.6, -5.0)))
    assert first == pytest.approx([0.0, -stiffness(MASS / 2) * 0.1, 0.0])
    assert list(second) == list(-first)
    apart = forces(airspace((0.0, 0.0, -5.0), (0.0, 0.71, -5.0)))
    assert not apart.any()
    same = forces(airspace((0.0, 0.0, -5.0), (0.0, 0.0, -5.0)))
    assert same[0, 2] < 0.0 < same[1, 2] == -same[0, 2]


@pytest.mark.parametrize("h", [0.0025, 0.005, 0.01])
@pytest.mark.parametrize(("speed", "off"), [(0.2, 0.0), (2.0, 0.3), (8.0, 0.0), (8.0, 0.5)])
def test_a_collision_does_not_gain_energy(h: float, speed: float, off: float) -> None:
    """Two bodies, moved exactly under forces that are held for a step and one step late, as vehicles get them."""
    m = airspace((0.0, 0.0, -50.0), (1.0, off, -50.0))
    x = np.array([[0.0, 0.0, -50.0], [1.0, off, -50.0]])
    v = np.array([[speed, 0.0, 0.0], [-speed, 0.0, 0.0]])
    before = MASS * speed**2
    held = np.zeros((2, 3))
    for k in range(round(3.0 / speed / h)):
        m.position[:6], m.velocity[:6] = x.ravel(), v.ravel()
        assert Airspace.kernels is not None
        assert Airspace.kernels[1](m, k * h, h) == 0
        x = x + h * v + 0.5 * h * h * held / MASS
        v = v + h * held / MASS
        held = np.array(m.force[:6]).reshape(2, 3)
    assert not held.any()
    energy = 0.5 * MASS * float((v**2).sum())
    assert energy < before
    np.testing.assert_allclose(v.sum(axis=0), 0.0, atol=1e-12)
    assert (x[1] - x[0]) @ (v[1] - v[0]) > 0.0  # they move apart


def test_boxes_push_away_from_the_nearest_face() -> None:
    box = {"boxes": 1, "box_north": (10.0,), "box_length": (4.0,), "box_width": (2.0,), "box_height": (6.0,)}
    k = stiffness(MASS)

    def push(n: float, e: float, d: float) -> list[float]:
        return [float(x) for x in forces(airspace((n, e, d), **box))[0]]

    assert push(7.75, 0.5, -3.0) == pytest.approx([-0.1 * k, 0.0, 0.0])
    assert push(10.5, 1.25, -3.0) == pytest.approx([0.0, 0.1 * k, 0.0])
    assert push(10.0, 0.0, -6.25) == pytest.approx([0.0, 0.0, -0.1 * k])
    corner = 0.25 / math.sqrt(2.0)
    assert push(8.0 - corner, -1.0 - corner, -3.0) == pytest.approx([-0.1 * k * math.sqrt(0.5)] * 2 + [0.0])
    assert push(8.1, 0.2, -3.0) == pytest.approx([-0.45 * k, 0.0, 0.0])  # inside: out by the nearest face
    assert push(9.5, 0.0, -5.9) == pytest.approx([0.0, 0.0, -0.45 * k])
    assert push(7.6, 0.0, -3.0) == [0.0, 0.0, 0.0]


def test_cylinders_push_outwards_and_up() -> None:
    tree = {"cylinders": 1, "cylinder_north": (3.0,), "cylinder_east": (4.0,), "cylinder_height": (5.0,)}
    k = stiffness(MASS)

    def push(n: float, e: float, d: float) -> list[float]:
        return [float(x) for x in forces(airspace((n, e, d), **tree))[0]]

    assert push(3.0 - 0.6 * 1.25, 4.0 - 0.8 * 1.25, -2.0) == pytest.approx([-0.06 * k, -0.08 * k, 0.0])
    assert push(3.2, 4.1, -5.3) == pytest.approx([0.0, 0.0, -0.05 * k])
    assert push(3.8, 4.0, -2.0) == pytest.approx([0.55 * k, 0.0, 0.0])
    assert push(3.0, 4.0, -2.0) == pytest.approx([1.35 * k, 0.0, 0.0])


def test_terrain_is_linear_between_its_points() -> None:
    heights = [0.0] * 64
    heights[0], heights[1], heights[8], heights[9] = 1.0, 3.0, 5.0, 9.0
    m = airspace((0.0, 0.0, -5.0), terrain_spacing=10.0, terrain_origin=(100.0, 200.0), terrain=tuple(heights))
    assert terrain_at(m, 100.0, 200.0) == (1.0, 0.4, 0.2)
    assert terrain_at(m, 105.0, 205.0) == pytest.approx((4.5, 0.5, 0.3))
    assert terrain_at(m, 60.0, 200.0)[0] == 1.0
    slope = tuple(float(i) for i in range(8) for _ in range(8))  # 1 m up for 10 m to the north
    m = airspace((35.0, 35.0, -3.75), terrain_spacing=10.0, terrain=slope)
    (force,) = forces(m)
    depth = RADIUS - 0.25 / math.sqrt(1.01)
    assert force == pytest.approx(np.array([-0.1, 0.0, -1.0]) / math.sqrt(1.01) * depth * stiffness(MASS))


def test_friction_opposes_the_slip_within_coulombs_limit() -> None:
    box = {"boxes": 1, "box_length": (40.0,), "box_width": (40.0,), "box_height": (2.0,)}
    m = airspace((0.0, 0.0, -2.25), **box)
    m.velocity[:3] = (3.0, 4.0, 0.0)
    (force,) = forces(m)
    normal = -force[2]
    assert normal == pytest.approx(0.1 * stiffness(MASS))
    assert force[:2] == pytest.approx([-0.3 * normal * 0.6, -0.3 * normal * 0.8])


def test_roofs_have_ground_effect_and_rovers_have_no_rotors() -> None:
    box = {"boxes": 1, "box_length": (4.0,), "box_width": (4.0,), "box_height": (6.0,)}
    m = airspace((0.0, 0.0, -7.0), (50.0, 0.0, -1.0), (0.0, 30.0, -1.0), ground_effect=True, **box)
    m.airframe[2] = Airframe.rover
    forces(m)
    assert m.thrust_factor[0] == m.thrust_factor[1] == pytest.approx(1.0040, abs=1e-4)
    assert m.thrust_factor[2] == 1.0


def test_the_grid_finds_what_a_search_of_all_pairs_finds() -> None:
    """200 vehicles in 30 m: the sums over cells are those over all pairs, and the order of vehicles does not matter."""
    rng = np.random.default_rng(1)
    places = rng.uniform((-15.0, -15.0, -8.0), (15.0, 15.0, -2.0), (200, 3))
    m = airspace(*[tuple(one) for one in places], downwash=True)
    force = forces(m)
    wind = np.array(m.wind[:600]).reshape(-1, 3)
    expected, down = np.zeros((200, 3)), np.zeros(200)
    v, radius = math.sqrt(MASS * 9.80665 / (2.0 * 1.225 * 0.2027)), math.sqrt(0.2027 / math.pi)
    for i in range(200):
        for j in range(200):
            d = places[i] - places[j]
            gap = float(np.linalg.norm(d))
            if i != j and gap < 2.0 * RADIUS:
                expected[i] += stiffness(MASS / 2) * (2.0 * RADIUS - gap) * d / gap
            if d[2] > 0.0:
                far = max(1.0, d[2] / (6.0 * math.sqrt(2.0) * radius))
                axis = v * (1.0 + d[2] / math.hypot(d[2], radius)) / far
                down[i] += axis / (1.0 + (d[0] ** 2 + d[1] ** 2) / (1.5 * radius**2 * far**2)) ** 2
    np.testing.assert_allclose(force, expected, atol=1e-9)
    assert np.count_nonzero(expected.any(axis=1)) > 5
    # those farther off than three widths are left out: each less than a hundredth of the velocity on its axis
    assert np.abs(wind[:, 2] - down).max() < 0.9
    assert np.corrcoef(wind[:, 2], down)[0, 1] > 0.999
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-9)
    order = rng.permutation(200)
    other = airspace(*[tuple(one) for one in places[order]], downwash=True)
    np.testing.assert_allclose(forces(other), force[order], atol=1e-9)


def test_positions_must_be_numbers() -> None:
    m = airspace((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0))
    assert Airspace.kernels is not None
    assert Airspace.kernels[1](m, 0.0, H) == 1
    assert Airspace.errors[1] == "a position or a velocity is not a finite number"
    assert CAPACITY == 256
