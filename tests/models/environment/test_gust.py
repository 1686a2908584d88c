"""The discrete gust against the profile of MIL-F-8785C."""

from __future__ import annotations

from typing import Any

import pytest

from cosim_models.environment.airspace import Airspace
from cosim_models.environment.gust import one_minus_cosine


def test_the_profile() -> None:
    shares = [one_minus_cosine(x, 20.0) for x in (-1.0, 0.0, 5.0, 10.0, 15.0, 20.0, 99.0)]
    assert shares == pytest.approx([0.0, 0.0, 0.14644660940672624, 0.5, 0.8535533905932737, 1.0, 1.0], abs=1e-15)


def wind_at(t: float, north: float, **parameters: Any) -> list[float]:
    m = Airspace.record()
    m.mean_wind[0], m.gust_time, m.gust_speed, m.gust_length = 2.0, 3.0, 10.0, 20.0
    m.gust[:] = (4.0, 0.0, -6.0)
    m.position[0] = north
    for name, value in parameters.items():
        m[name] = value
    assert Airspace.kernels is not None
    assert Airspace.kernels[0](m) == 0
    assert list(m.wind[:3]) == [2.0, 0.0, 0.0]
    assert Airspace.kernels[1](m, t - 0.005, 0.005) == 0
    return [float(x) for x in m.wind[:3]]


def test_the_front_travels_with_the_wind() -> None:
    assert wind_at(3.0, 0.0) == [2.0, 0.0, 0.0]
    assert wind_at(4.0, 0.0) == pytest.approx([4.0, 0.0, -3.0], abs=1e-12)  # half of it after half of its length
    assert wind_at(9.0, 0.0) == pytest.approx([6.0, 0.0, -6.0])
    assert wind_at(9.0, 50.0) == pytest.approx([4.0, 0.0, -3.0], abs=1e-12)  # 50 m downwind 5 s later
    assert wind_at(9.0, 100.0) == [2.0, 0.0, 0.0]


def test_it_ends_as_it_began() -> None:
    assert wind_at(5.0, 0.0, gust_hold=1.0) == pytest.approx([6.0, 0.0, -6.0])
    assert wind_at(7.0, 0.0, gust_hold=1.0) == pytest.approx([4.0, 0.0, -3.0], abs=1e-12)
    assert wind_at(8.5, 0.0, gust_hold=1.0) == pytest.approx([2.0, 0.0, 0.0], abs=1e-12)
