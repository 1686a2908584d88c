"""The wind, estimated on the wing without an airspeed sensor.

In coordinated flight, the air comes from ahead: across the nose, the velocity over ground is that of the wind, and in a
turn a slip beside it that grows with the bank. Each look corrects the estimates of both; turns show both components of
the wind. Kernels over a record with the variables of `gcs.record` and `WIND_MEMORY`. (ArduPlane's estimator also uses
how the velocity changes in a turn, at an airspeed that is constant meanwhile; here it is the speed over ground that is
held.)

Source: the triangle of velocities; the method of Kaczmarz for its linear equations.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import euler_from_quaternion
from cosim.kernel import kernel

__all__ = ["WIND_MEMORY", "estimate_wind"]

_PERIOD = 0.5  # s
_SHARE = 0.05  # of the error across the nose by which each look corrects the estimate

WIND_MEMORY = (
    Memory("wind_next"),  # s, of the next look
    Memory("wind_slip", rare=True),  # m/s to the right, over the sine of the bank
)


@kernel
def estimate_wind(m: Any, t: float) -> None:
    """Improves m.wind_estimate [m/s, NED, its down component 0]; required on the wing from m.wind_next on."""
    m.wind_next = t + _PERIOD - 1e-9
    roll, _, yaw = euler_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    bank = math.sin(roll)
    n, e = -math.sin(yaw), math.cos(yaw)  # to the right of the nose
    wind = m.wind_estimate
    miss = n * (m.velocity[0] - wind[0]) + e * (m.velocity[1] - wind[1]) - m.wind_slip * bank
    wind[0] += _SHARE * miss * n
    wind[1] += _SHARE * miss * e
    m.wind_slip += _SHARE * miss * bank
