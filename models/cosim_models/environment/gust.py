"""A discrete gust: a front that the wind carries across the area, with the profile 1 - cosine.

Source: MIL-F-8785C, section 3.7.1.3: v = V / 2 (1 - cos(pi x / d)) for a penetration x from 0 to d, and V beyond. Here
the gust ends after `gust_hold` as it began, with the mirrored profile.
"""

from __future__ import annotations

from math import cos, pi
from typing import Any

from cosim.kernel import kernel

__all__ = ["gust_share", "one_minus_cosine"]


@kernel
def one_minus_cosine(x: float, length: float) -> float:
    """Returns the share of the gust after the penetration `x` [m] of a front of `length` [m]."""
    if x <= 0.0:
        return 0.0
    if x >= length:
        return 1.0
    return 0.5 * (1.0 - cos(pi * x / length))


@kernel
def gust_share(m: Any, t: float, along: float) -> float:
    """Returns the share of the gust at time `t` [s], `along` metres from the origin in the direction of the wind."""
    x = m.gust_speed * (t - m.gust_time) - along
    end = m.gust_length + m.gust_speed * m.gust_hold
    return one_minus_cosine(x, m.gust_length) - one_minus_cosine(x - end, m.gust_length)
