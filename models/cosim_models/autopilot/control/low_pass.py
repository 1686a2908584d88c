"""A second-order Butterworth low-pass of inertial sensors, as kernels over its coefficients `c` and delays `s`.

Source: A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, chapter 7 (bilinear transform); ArduPilot's
LowPassFilter2p has the same coefficients.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel

__all__ = ["low_pass", "settle_low_pass", "tune_low_pass"]


@kernel
def tune_low_pass(c: Any, cutoff: float, dt: float) -> None:
    """Sets the coefficients b0, a1, a2 of a second-order Butterworth low-pass; b0 = 1, the rest 0 without a cutoff."""
    if cutoff <= 0.0 or 2.0 * cutoff * dt >= 1.0:
        c[0], c[1], c[2] = 1.0, 0.0, 0.0
        return
    w = math.tan(math.pi * cutoff * dt)
    scale = 1.0 + math.sqrt(2.0) * w + w * w
    c[0] = w * w / scale
    c[1] = 2.0 * (w * w - 1.0) / scale
    c[2] = (1.0 - math.sqrt(2.0) * w + w * w) / scale


@kernel
def low_pass(s: Any, c: Any, value: float) -> float:
    """Performs one step of the low-pass over its two delays `s`."""
    if c[0] == 1.0:
        return value
    now = value - c[1] * s[0] - c[2] * s[1]
    result = c[0] * (now + 2.0 * s[0] + s[1])
    s[1] = s[0]
    s[0] = now
    return float(result)


@kernel
def settle_low_pass(s: Any, c: Any, value: float) -> None:
    """Sets the delays as if `value` had been the input forever."""
    s[0] = value / (1.0 + c[1] + c[2])
    s[1] = s[0]
