"""The turbulence against the closed forms of MIL-F-8785C: intensities, scales, spectra along and across the wind."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim_models.environment.airspace import Airspace
from cosim_models.environment.turbulence import WAVES, intensity_and_scale, turbulence_at

FOOT = 0.3048


def field(seed: int = 1, **parameters: Any) -> Any:
    m = Airspace.record()
    m.seed, m.turbulence_wind, m.turbulence_height = seed, 10.0, 50.0 * FOOT
    m.mean_wind[0] = 8.0
    for name, value in parameters.items():
        m[name] = value
    assert Airspace.kernels is not None
    assert Airspace.kernels[0](m) == 0
    return m


def longitudinal(x: NDArray[Any]) -> NDArray[Any]:
    """Share of the variance below the wave number x / L: the integral of 2 L / pi / (1 + (L k)^2)."""
    return np.asarray(2.0 / np.pi * np.arctan(x))


def transverse(x: NDArray[Any]) -> NDArray[Any]:
    """The same of L / pi (1 + 3 (L k)^2) / (1 + (L k)^2)^2, integrated numerically."""
    fine = np.concatenate([[0.0], np.geomspace(1e-4, 1e5, 200_001)])
    density = (1.0 + 3.0 * fine**2) / (1.0 + fine**2) ** 2 / np.pi
    total = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(fine) * (density[1:] + density[:-1]))])
    return np.interp(x, fine, total)


@pytest.mark.parametrize(
    ("feet", "sigma_u", "length_u", "length_w"),
    [
        (1000.0, 1.0, 1000.0, 1000.0),
        (50.0, 1.8386, 310.79, 50.0),
        (10.0, 1.9630, 75.64, 10.0),
        (3.0, 1.9630, 75.64, 10.0),
    ],
)
def test_intensities_and_scales_of_the_standard(feet: float, sigma_u: float, length_u: float, length_w: float) -> None:
    """0.1 W20 / (0.177 + 0.000823 h)^0.4 and h / (0.177 + 0.000823 h)^1.2, in feet, for W20 = 10 m/s."""
    sigma, length = intensity_and_scale(0, 10.0, feet * FOOT)
    assert sigma == pytest.approx(sigma_u, rel=1e-3)
    assert length == pytest.approx(length_u * FOOT, rel=1e-3)
    assert intensity_and_scale(1, 10.0, feet * FOOT) == (sigma, length)
    assert intensity_and_scale(2, 10.0, feet * FOOT) == pytest.approx((1.0, length_w * FOOT))


def along_the_wind(m: Any, component: int, places: NDArray[Any]) -> NDArray[Any]:
    """The component at places to the north, the direction of the wind: the sum of the waves."""
    phases = np.outer(places, m.waves[component, :, 0]) + m.phase[component]
    return np.asarray(np.cos(phases).sum(axis=1) * m.amplitude[component])


@pytest.mark.parametrize("component", [0, 1, 2])
def test_a_hovering_vehicle_measures_the_dryden_spectrum(component: int) -> None:
    """The variance within 1 %, and the share below each wave number within 0.015, in the mean of 12 fields."""
    sigma, length = intensity_and_scale(component, 10.0, 50.0 * FOOT)
    places = -length / 10.0 * np.arange(1 << 14)
    power, variance = np.zeros(places.size // 2 + 1), 0.0
    for seed in range(12):
        values = along_the_wind(field(seed), component, places)
        variance += np.mean(values**2) / 12.0
        power += np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
    sample = turbulence_at(field(11), places[-1], 0.0, 0.0)[component]
    assert sample == pytest.approx(values[-1], abs=1e-9)
    assert variance == pytest.approx(sigma**2, rel=0.01)
    wave = np.fft.rfftfreq(places.size, 0.1) * 2.0 * np.pi
    limits = np.array([0.2, 0.5, 1.0, 2.0, 5.0])
    share = [power[wave <= limit].sum() / power.sum() for limit in limits]
    np.testing.assert_allclose(share, (longitudinal if component == 0 else transverse)(limits), atol=0.015)


@pytest.mark.parametrize("component", [0, 1, 2])
def test_across_the_wind_the_field_is_isotropic(component: int) -> None:
    """Batchelor: along its own axis a component has the longitudinal spectrum, along the two others the transverse."""
    waves = np.concatenate([field(seed).waves[component] for seed in range(48)])
    _, length = intensity_and_scale(component, 10.0, 50.0 * FOOT)
    for axis in range(3):
        sizes = np.sort(np.abs(waves[:, axis]) * length)
        expected = (longitudinal if axis == component else transverse)(sizes)
        found = (np.arange(sizes.size) + 0.5) / sizes.size
        assert np.abs(found - expected).max() < 1.63 / math.sqrt(sizes.size)  # Kolmogorov's bound at 1 %


def test_the_wind_carries_the_field_along_and_its_direction_turns_it() -> None:
    m = field(seed=3, mean_wind=(0.0, 8.0, 0.0))
    m.position[:3] = (20.0, 8.0 * 0.005, -10.0)
    assert Airspace.kernels is not None
    assert Airspace.kernels[1](m, 0.0, 0.005) == 0  # by then the air at the vehicle is that of the origin's east 0
    moved = np.array(m.wind[:3]) - (0.0, 8.0, 0.0)
    np.testing.assert_allclose(moved, turbulence_at(m, 20.0, 0.0, -10.0), atol=1e-12)
    north = field(seed=3, mean_wind=(8.0, 0.0, 0.0))
    along, across, down = turbulence_at(north, 0.0, -20.0, -10.0)
    np.testing.assert_allclose(moved, (-across, along, down), atol=1e-12)


def test_seeds_differ_and_vehicles_at_one_place_feel_the_same() -> None:
    assert turbulence_at(field(1), 1.0, 2.0, -3.0) != turbulence_at(field(2), 1.0, 2.0, -3.0)
    m = field(count=3)
    m.position[:9] = (1.0, 2.0, -3.0, 1.0, 2.0, -3.0, 60.0, 2.0, -3.0)
    assert Airspace.kernels is not None
    assert Airspace.kernels[1](m, 0.0, 0.005) == 0
    assert list(m.wind[:3]) == list(m.wind[3:6]) != list(m.wind[6:9])
    assert WAVES == 64
