"""Dryden turbulence as one frozen field in space, which the mean wind carries along.

Each component of the velocity is a sum of plane waves of equal amplitude. Wave numbers along the wind are the quantiles
of the component's Dryden spectrum, so that a hovering vehicle measures this spectrum, and so does one that flies
through the field at any airspeed. Across the wind, wave numbers follow the isotropic spectrum whose one-dimensional
spectra the Dryden spectra are: vehicles at one place feel the same turbulence, and distant ones a different one.
Phases and positions within the quantiles are random numbers of the seed, the component and the wave.

Sources: MIL-F-8785C, section 3.7 (spectra; intensities and scales below 1000 ft); M. Shinozuka and C.-M. Jan, Digital
simulation of random processes and its applications, Journal of Sound and Vibration 25 (1972) (sum of waves); G. K.
Batchelor, The theory of homogeneous turbulence, section 3.4 (one-dimensional spectra of an isotropic field).
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt, tan
from typing import Any

from cosim.kernel import kernel
from cosim.random_numbers import threefry

__all__ = ["ALONG", "WAVES", "intensity_and_scale", "raise_field", "turbulence_at"]

WAVES = 64
"""Plane waves of each component."""

ALONG, ACROSS, DOWN = 0, 1, 2
_FOOT = 0.3048
_LOWEST, _HIGHEST = 10.0, 1000.0  # ft
_UNIT = 1.0 / 4294967296.0
_HALVINGS = 60


@kernel
def intensity_and_scale(component: int, wind: float, height: float) -> tuple[float, float]:
    """Returns standard deviation [m/s] and scale length [m] of a component at low altitude.

    Args:
        component: 0 along the mean wind, 1 across it, 2 down.
        wind: mean wind at 20 ft [m/s].
        height: above ground [m]; the source covers 3.048 to 304.8 m, heights beyond are taken as the nearest limit.
    """
    feet = min(max(height / _FOOT, _LOWEST), _HIGHEST)
    part = 0.177 + 0.000823 * feet
    if component == DOWN:
        return 0.1 * wind, feet * _FOOT
    return 0.1 * wind / part**0.4, feet / part**1.2 * _FOOT


@kernel
def _uniform(seed: int, component: int, wave: int, draw: int) -> tuple[float, float]:
    """Returns two uniform numbers in (0, 1)."""
    x, y = threefry(seed, component, wave, draw)
    return (x + 0.5) * _UNIT, (y + 0.5) * _UNIT


@kernel
def _quantile_across(p: float) -> float:
    """Returns the wave number times the scale length up to which a share `p` of the transverse spectrum lies."""
    low, high = 0.0, 0.5 * pi
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if (2.0 * middle - sin(middle) * cos(middle)) / pi < p:
            low = middle
        else:
            high = middle
    return tan(0.5 * (low + high))


@kernel
def _angle_of_squared_cosine(p: float) -> float:
    """Returns the angle [rad] up to which a share `p` of the density cos^2 / pi over one turn lies."""
    low, high = 0.0, 2.0 * pi
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if (middle + sin(middle) * cos(middle)) / (2.0 * pi) < p:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _wave(component: int, length: float, p: float, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Returns a wave vector [rad/m]: along the wind, across it, down.

    Along the wind, it is the quantile `p` of the spectrum; the rest follows the energy spectrum
    E(k) ~ (k L)^4 / (1 + (k L)^2)^3, given that part, by the uniform numbers `a`, `b` and `c`. With k1 along the wind
    and s the square of the rest, the density is s / (1 + L^2 (k1^2 + s))^3 for the component along the wind, and
    (k1^2 + s cos^2) / (1 + L^2 (k1^2 + s))^3 for another, where the angle is that from the third axis.
    """
    if component == ALONG:
        first = tan(0.5 * pi * p)
        root = sqrt(a)
        y, angle = root / (1.0 - root), 2.0 * pi * b
    else:
        first = _quantile_across(p)
        flat = 2.0 * first * first
        if c * (flat + 1.0 + first * first) < flat:
            y, angle = 1.0 / sqrt(1.0 - a) - 1.0, 2.0 * pi * b
        else:
            root = sqrt(a)
            y, angle = root / (1.0 - root), _angle_of_squared_cosine(b)
    side = sqrt(y * (1.0 + first * first)) / length
    own, other = side * sin(angle), side * cos(angle)
    return (first / length, other, own) if component == DOWN else (first / length, own, other)


@kernel
def raise_field(m: Any) -> None:
    """Draws the waves of the field: m.waves [rad/m, NED], m.phase [rad], m.amplitude [m/s], m.axis (wind's, NED)."""
    heading = atan2(m.mean_wind[1], m.mean_wind[0])
    m.axis[0], m.axis[1] = cos(heading), sin(heading)
    for component in range(3):
        sigma, length = intensity_and_scale(component, m.turbulence_wind, m.turbulence_height)
        m.amplitude[component] = sigma * sqrt(2.0 / WAVES)
        for i in range(WAVES):
            within, phase = _uniform(m.seed, component, i, 0)
            a, b = _uniform(m.seed, component, i, 1)
            c, _ = _uniform(m.seed, component, i, 2)
            along, across, down = _wave(component, length, (i + within) / WAVES, a, b, c)
            m.waves[component, i, 0] = along * m.axis[0] - across * m.axis[1]
            m.waves[component, i, 1] = along * m.axis[1] + across * m.axis[0]
            m.waves[component, i, 2] = down
            m.phase[component, i] = 2.0 * pi * phase


@kernel
def turbulence_at(m: Any, north: float, east: float, down: float) -> tuple[float, float, float]:
    """Returns the turbulent velocity [m/s, NED] at a place of the frozen field [m, NED]."""
    along = across = vertical = 0.0
    for i in range(WAVES):
        w = m.waves[0, i]
        along += cos(w[0] * north + w[1] * east + w[2] * down + m.phase[0, i])
        w = m.waves[1, i]
        across += cos(w[0] * north + w[1] * east + w[2] * down + m.phase[1, i])
        w = m.waves[2, i]
        vertical += cos(w[0] * north + w[1] * east + w[2] * down + m.phase[2, i])
    along *= m.amplitude[0]
    across *= m.amplitude[1]
    return (
        along * m.axis[0] - across * m.axis[1],
        along * m.axis[1] + across * m.axis[0],
        vertical * m.amplitude[2],
    )
