"""From roll, pitch, yaw and throttle to motor commands, with ArduCopter's priorities (AP_MotorsMatrix).

Roll and pitch come first, then throttle, then yaw, of which some is always kept. Motors are numbered as ArduPilot
numbers them; a motor that turns counter-clockwise, seen from above, pushes the nose to the right (positive yaw).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from cosim.kernel import kernel
from cosim.vehicle import Airframe
from numpy.typing import NDArray

from cosim_models.shaping import clip

__all__ = ["choose_mixer", "mix", "thrust_to_actuator"]

_QUAD_X, _HEXA_X, _OCTA_X = int(Airframe.quad_x), int(Airframe.hexa_x), int(Airframe.octa_x)

# Angle of each motor from the nose, clockwise [deg], and +1 for counter-clockwise rotation.
_LAYOUT: dict[int, tuple[tuple[float, int], ...]] = {
    _QUAD_X: ((45, 1), (-135, 1), (-45, -1), (135, -1)),
    _HEXA_X: ((90, -1), (-90, 1), (-30, -1), (150, 1), (30, 1), (-150, -1)),
    _OCTA_X: ((22.5, -1), (-157.5, -1), (67.5, 1), (157.5, 1), (-22.5, 1), (-112.5, 1), (-67.5, -1), (112.5, -1)),
}


def _factors(motors: tuple[tuple[float, int], ...]) -> NDArray[np.float64]:
    """Rows (roll, pitch, yaw) per motor, each column scaled to a largest magnitude of 0.5."""
    raw = np.array([(-math.sin(math.radians(a)), math.cos(math.radians(a)), d) for a, d in motors])
    table = np.zeros((8, 3))
    table[: len(motors)] = 0.5 * raw / np.abs(raw).max(axis=0)
    return table


_QUAD, _HEXA, _OCTA = _factors(_LAYOUT[_QUAD_X]), _factors(_LAYOUT[_HEXA_X]), _factors(_LAYOUT[_OCTA_X])
_YAW_HEADROOM = 0.2  # MOT_YAW_HEADROOM of 200 per mille


@kernel
def choose_mixer(m: Any) -> int:
    """Number of motors and factors for the vehicle's airframe; 0, or 1 for an airframe that is not known."""
    m.motors = 4 if m.airframe == _QUAD_X else 6 if m.airframe == _HEXA_X else 8 if m.airframe == _OCTA_X else 0
    for i in range(m.motors):
        for axis in range(3):
            if m.motors == 4:
                m.factor[i, axis] = _QUAD[i, axis]
            elif m.motors == 6:
                m.factor[i, axis] = _HEXA[i, axis]
            else:
                m.factor[i, axis] = _OCTA[i, axis]
    return 1 if m.motors == 0 else 0


@kernel
def thrust_to_actuator(thrust: float, expo: float, spin_min: float, spin_max: float) -> float:
    """Motor command (0 to 1) for a share of thrust (0 to 1): inverse of thrust = (1 - expo)*c + expo*c^2."""
    c = clip(thrust, 0.0, 1.0)
    if expo > 0.0:
        c = (expo - 1.0 + math.sqrt((1.0 - expo) * (1.0 - expo) + 4.0 * expo * c)) / (2.0 * expo)
    return spin_min + (spin_max - spin_min) * c


@kernel
def mix(m: Any, roll: float, pitch: float, yaw: float, throttle: float) -> None:
    """Motor commands for demands of -1 to 1 and a throttle of 0 to 1; notes what is saturated."""
    m.throttle_lower = throttle <= 0.0
    m.throttle_upper = throttle >= 1.0
    # Up to hover throttle may be added to make room for roll and pitch (half of it: throttle mix 0.5).
    average = max(throttle, 0.5 * throttle + 0.5 * m.hover)
    best = min(0.5, average)
    allowed = 1.0
    for i in range(m.motors):
        rp = roll * m.factor[i, 0] + pitch * m.factor[i, 1]
        m.thrust[i] = rp
        room = 1.0 - (best + rp) if yaw * m.factor[i, 2] > 0.0 else best + rp
        allowed = min(allowed, max(room, 0.0) / abs(m.factor[i, 2]))
    allowed = max(allowed, _YAW_HEADROOM)
    m.mixer_limited[2] = 1 if abs(yaw) > allowed else 0
    yaw = clip(yaw, -allowed, allowed)
    low, high = 0.0, 0.0
    for i in range(m.motors):
        m.thrust[i] += yaw * m.factor[i, 2]
        low = min(low, m.thrust[i])
        high = max(high, m.thrust[i])
    scale = 1.0
    if high - low > 1.0:
        scale = 1.0 / (high - low)
    if average + low < 0.0:
        scale = min(scale, -average / low)
    low, high = low * scale, high * scale
    base = -low
    more = throttle - base
    m.mixer_limited[0] = 1 if scale < 1.0 else 0
    m.mixer_limited[1] = m.mixer_limited[0]
    if scale < 1.0:
        if more > 0.0:
            m.throttle_upper = True
        more = 0.0
    elif more < 0.0:
        more = 0.0
    elif more > 1.0 - (base + high):
        more = 1.0 - (base + high)
        m.throttle_upper = True
    for i in range(m.motors):
        thrust = base + more + scale * m.thrust[i]
        m.motor[i] = thrust_to_actuator(thrust, m.MOT_THST_EXPO, m.MOT_SPIN_MIN, m.MOT_SPIN_MAX)
