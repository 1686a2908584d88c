"""An airspace for thousands: the forces of one for hundreds and of a search of all pairs, in linear work."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.environment.airspace import CAPACITY, LARGE, Airspace, LargeAirspace
from tests.models.shipped_kernels import kernels

H = 0.005
RADIUS = 0.35
STIFFNESS = 1.545 / 2.0 * (math.pi / 0.1) ** 2  # of two quadrotors, for a contact of 0.1 s
OUTPUTS = {"wind": 3, "force": 3, "thrust_factor": 1}
ON: dict[str, Any] = {"contact": True, "downwash": True, "ground_effect": True, "turbulence_wind": 6.0}


def airspace(model: type[Model], places: NDArray[np.float64], **parameters: Any) -> Any:
    m = model.record()
    m.count = len(places)
    m.mean_wind[:] = (3.0, 1.0, 0.0)
    for name, value in parameters.items():
        m[name] = value
    assert kernels(model)[0](m) == 0
    m.position[: places.size] = places.ravel()
    return m


def steps(model: type[Model], m: Any, count: int) -> dict[str, NDArray[np.float64]]:
    for k in range(count):
        assert kernels(model)[1](m, k * H, H) == 0
    return {name: np.array(m[name][: width * int(m.count)]) for name, width in OUTPUTS.items()}


def test_it_gives_the_same_bits_as_the_small_one() -> None:
    rng = np.random.default_rng(2)
    places = rng.uniform((-12.0, -12.0, -8.0), (12.0, 12.0, -0.2), (CAPACITY, 3))
    frames = rng.integers(1, len(Airframe) + 1, CAPACITY)
    found = []
    for model in (Airspace, LargeAirspace):
        m = airspace(model, places, **ON)
        m.airframe[:CAPACITY] = frames
        found.append(steps(model, m, 7))
    for name in OUTPUTS:
        assert found[0][name].tobytes() == found[1][name].tobytes()
    assert found[0]["force"].any() and (found[0]["thrust_factor"] > 1.0).any()


def test_it_finds_every_contact_of_four_thousand() -> None:
    """4096 vehicles in 100 m: the forces are those over the pairs that a k-d tree finds."""
    rng = np.random.default_rng(3)
    places = rng.uniform((-50.0, -50.0, -9.0), (50.0, 50.0, -3.0), (LARGE, 3))
    force = steps(LargeAirspace, airspace(LargeAirspace, places, contact=True), 1)["force"].reshape(-1, 3)
    expected = np.zeros((LARGE, 3))
    pairs = cKDTree(places).query_pairs(2.0 * RADIUS)
    assert len(pairs) > 100
    for i, j in pairs:
        d = places[i] - places[j]
        gap = float(np.linalg.norm(d))
        push = STIFFNESS * (2.0 * RADIUS - gap) * d / gap
        expected[i] += push
        expected[j] -= push
    np.testing.assert_allclose(force, expected, atol=1e-9)


@pytest.mark.parametrize("side", [16, 32, 64])
def test_the_work_for_a_vehicle_does_not_grow_with_their_number(side: int) -> None:
    """At one density, the vehicles that a search of nine cells passes in its lists stay below a bound for each."""
    north, east = np.divmod(np.arange(side * side), side)
    places = np.stack([2.0 * north, 2.0 * east, np.full(side * side, -5.0)], axis=1)
    m = airspace(LargeAirspace, places, **(ON | {"turbulence_wind": 0.0}))
    steps(LargeAirspace, m, 1)
    assert m.cell == pytest.approx(4.0, rel=0.6)
    lengths = {}
    for place in range(len(m.head)):
        i, length = int(m.head[place]), 0
        while i >= 0:
            i, length = int(m.next[i]), length + 1
        lengths[place] = length
    assert sum(lengths.values()) == side * side
    passed = 9.0 * sum(length * length for length in lengths.values()) / side**2
    in_nine_cells = 9.0 * (m.cell / 2.0) ** 2
    assert passed < in_nine_cells + 9.0 * 3.0


def test_it_tells_how_many_vehicles_it_can_have() -> None:
    (count,) = (one for one in LargeAirspace.variables if one.name == "count")
    assert (count.maximum, LARGE, CAPACITY) == (4096, 4096, 256)
