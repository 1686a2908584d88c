"""Wake and ground effect against momentum theory, the jets of the literature, and Cheeseman and Bennett."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cosim_models.environment.rotors import (
    AIR_DENSITY,
    ground_effect,
    induced_velocity,
    wake_velocity,
    wake_width,
)

THRUST, AREA = 15.15, 0.2027  # an Iris
RADIUS = math.sqrt(AREA / math.pi)


@pytest.mark.parametrize(
    ("height", "ratio"), [(0.2, 4 / 3), (0.5, 4 / 3), (1.0, 16 / 15), (2.0, 64 / 63), (4.0, 256 / 255)]
)
def test_cheeseman_and_bennett_in_hover(height: float, ratio: float) -> None:
    """1 / (1 - (R / 4 z)^2) at heights in rotor radii; below half a radius, where it is not valid, it stays."""
    assert ground_effect(height * RADIUS, 0.0, THRUST, AREA) == pytest.approx(ratio, rel=1e-14)


def test_ground_effect_fades_with_speed() -> None:
    """1 / (1 - (R / 4 z)^2 / (1 + (V / v)^2)) at z = R: half of the part at V = v, a tenth at V = 3 v."""
    v = induced_velocity(THRUST, AREA)
    assert ground_effect(RADIUS, v, THRUST, AREA) == pytest.approx(32 / 31, rel=1e-14)
    assert ground_effect(RADIUS, 3.0 * v, THRUST, AREA) == pytest.approx(160 / 159, rel=1e-14)
    assert ground_effect(RADIUS, 0.0, THRUST, 0.0) == 1.0


def test_the_induced_velocity_is_that_of_momentum_theory() -> None:
    """Thrust is the change of momentum of the air through the disc: T = 2 rho A v^2."""
    v = induced_velocity(THRUST, AREA)
    assert 2.0 * AIR_DENSITY * AREA * v * v == pytest.approx(THRUST, rel=1e-14)
    assert v == pytest.approx(5.523, abs=1e-3)
    assert wake_velocity(1e-9, 0.0, THRUST, AREA) == pytest.approx(v, rel=1e-6)
    assert wake_velocity(8.4 * RADIUS, 0.0, THRUST, AREA) == pytest.approx(2.0 * v, rel=0.01)
    assert wake_velocity(RADIUS, 0.0, THRUST, AREA) == pytest.approx(v * (1.0 + math.sqrt(0.5)), rel=1e-14)


@pytest.mark.parametrize("depth", [3.0, 8.0, 20.0, 50.0])
def test_the_wake_carries_the_thrust_away(depth: float) -> None:
    """The flux of momentum through a plane, rho u^2 dA, is the thrust times (1 + z / sqrt(z^2 + R^2))^2 / 4."""
    r = np.linspace(0.0, 400.0 * RADIUS, 40_001)
    u = np.array([wake_velocity(depth * RADIUS, x, THRUST, AREA) for x in r])
    flux = AIR_DENSITY * np.trapezoid(u * u * 2.0 * np.pi * r, r)
    near = (1.0 + depth / math.sqrt(depth * depth + 1.0)) ** 2 / 4.0
    assert flux == pytest.approx(THRUST * near, rel=1e-4)


def test_far_below_it_is_a_round_jet() -> None:
    """Velocity falls with 1 / z; the half width grows as measured: 0.094 (Hussein et al. 1994), 0.096 (P. and L.)."""
    one, two = (wake_velocity(z, 0.0, THRUST, AREA) for z in (20.0, 40.0))
    assert one / two == pytest.approx(2.0, rel=1e-3)
    half = wake_width(20.0, AREA) * math.sqrt(math.sqrt(2.0) - 1.0)
    assert wake_velocity(20.0, half, THRUST, AREA) == pytest.approx(0.5 * one, rel=1e-12)
    assert half / 20.0 == pytest.approx(0.095, abs=0.003)
    assert wake_velocity(-0.1, 0.0, THRUST, AREA) == wake_velocity(1.0, 0.0, THRUST, 0.0) == 0.0
