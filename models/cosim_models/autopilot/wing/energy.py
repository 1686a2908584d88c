"""Total energy: the pitch and the throttle of flight on wings, for a height and a speed.

The throttle follows the sum of the errors of climb and acceleration (total energy), the pitch their difference (balance
of energy), in which a metre of height is worth as much as the speed that it would give, or more or less of it by
TECS_SPDWEIGHT. The speed that is asked for stays between AIRSPEED_MIN, in turns times the root of the load
(STALL_PREVENTION), and AIRSPEED_MAX. While the throttle is at its limit, AIRSPEED_MAX sinks, not below AIRSPEED_CRUISE,
and the climb that is asked for is at most the one that the engine gives, and a little more, so that height and speed
share what is missing. If the speed falls below 0.9 of the least all the same, the height does not count until the speed
is back.

Kernels over a record with `ENERGY_PARAMETERS` and `ENERGY_MEMORY` beside those of `wing.flight` and `wing.piloted`.

Sources: A. A. Lambregts, Vertical flight path and speed control autopilot design using total energy principles, AIAA
83-2239; ArduPilot, AP_TECS.cpp (limits of the speed, underspeed, weights).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory, Parameter
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import real

__all__ = ["CLIMB_P", "ENERGY_MEMORY", "ENERGY_PARAMETERS", "clip", "energy"]

CLIMB_P = 0.3
"""Rate of climb over the error of the height [1/s]."""
_GRAVITY = 9.80665
_SPEED_P = 0.5  # acceleration over the error of the speed [1/s]
_FASTEST = 2.0  # m/s2, of that
_MARGIN = 0.5  # of the greatest change of energy, with which the limit of the speed moves
_MORE = _FASTEST * CLIMB_P / _SPEED_P / _GRAVITY  # path beyond that of the engine: as much as a speed may ask for
_SLOW, _RECOVERED, _SLOW_TIME = 0.9, 1.15, 3.0  # of the least speed, and s
_FULL = 0.95  # of THR_MAX

ENERGY_PARAMETERS = (
    real("TECS_CLMB_MAX", "m/s", 5.0, "greatest rate of climb", 0.1),
    real("TECS_SINK_MAX", "m/s", 5.0, "greatest rate of descent", 0.1),
    real("TECS_SINK_MIN", "m/s", 2.0, "rate of descent with the throttle closed", 0.1),
    Parameter(
        "TECS_SPDWEIGHT",
        unit="1",
        start=1.0,
        minimum=0.0,
        maximum=2.0,
        tunable=True,
        description="1: speed and height count alike for the pitch; 0: the height alone; 2: the speed alone",
    ),
)
ENERGY_MEMORY = (
    Memory("asked_bank"),  # rad, before STALL_PREVENTION limits it
    Memory("throttle_trim"),  # integral of the total energy
    Memory("pitch_trim"),  # rad, integral of the energy balance
    Memory("speed_before"),  # m/s
    Memory("acceleration"),  # m/s2, filtered
    Memory("strained", dtype="?"),  # the throttle is at its limit, or what follows from it lasts
    Memory("at_limit", dtype="?"),  # the throttle is
    Memory("slower"),  # m/s by which the greatest speed is below AIRSPEED_MAX
    Memory("slow_for"),  # s that it counts as too slow at least; 0: it is not
)


@kernel
def clip(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


@kernel
def _least_speed(m: Any) -> float:
    """Returns the speed [m/s] that the wing needs with the bank that is asked for."""
    least = float(m.AIRSPEED_MIN)
    if m.STALL_PREVENTION == 0 or m.inverted:
        return least
    return least / math.sqrt(max(math.cos(m.asked_bank), 0.1))


@kernel
def _strain(m: Any, climb: float, speed: float, least: float, h: float) -> None:
    """Follows the throttle at its limit."""
    pace = _MARGIN * _GRAVITY * h / max(speed, m.AIRSPEED_MIN)
    if m.at_limit:
        m.slower = min(m.slower + pace * m.TECS_SINK_MIN, max(m.AIRSPEED_MAX - m.AIRSPEED_CRUISE, 0.0))
    else:
        m.slower = max(m.slower - pace * m.TECS_CLMB_MAX, 0.0)
    if speed < _SLOW * least and m.motor[2] >= _FULL * 0.01 * m.THR_MAX:
        m.slow_for = _SLOW_TIME
    elif m.slow_for > 0.0:
        left = max(m.slow_for - h, 0.0)
        ends = climb <= 0.0 or (left == 0.0 and speed >= _RECOVERED * least)
        m.slow_for = 0.0 if ends else max(left, h)
    m.strained = m.at_limit or m.slower > 0.0 or m.slow_for > 0.0


@kernel
def energy(m: Any, down: float, wanted: float, weight: float, h: float) -> tuple[float, float]:
    """Returns pitch [rad] and throttle that lead to a down coordinate with a speed [m/s].

    Args:
        weight: of the speed in the balance, 0 to 2.
    """
    speed = max(math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2), 5.0)
    m.acceleration += min(2.0 * h, 1.0) * ((speed - m.speed_before) / h - m.acceleration)
    m.speed_before = speed
    climb = clip(CLIMB_P * (m.position[2] - down), -m.TECS_SINK_MAX, m.TECS_CLMB_MAX)
    path, gain = -m.velocity[2] / speed, m.acceleration / _GRAVITY
    slow = False
    if m.strained:
        least = _least_speed(m)
        _strain(m, climb, speed, least, h)
        if m.at_limit:
            climb = min(climb, speed * max(path + gain, min(path + gain, 0.0) + _MORE))
        slow = m.slow_for > 0.0
        if slow:
            wanted, weight = least, 2.0
    wanted = min(wanted, m.AIRSPEED_MAX - m.slower)
    if wanted * wanted * (1.0 - 0.5 * m.asked_bank * m.asked_bank) < m.AIRSPEED_MIN * m.AIRSPEED_MIN:  # cos is more
        wanted = max(wanted, _least_speed(m))
    path_error = climb / speed - path
    faster = clip(_SPEED_P * (wanted - speed), -_FASTEST, _FASTEST) / _GRAVITY
    total = path_error + faster - gain
    of_path, of_speed = min(2.0 - weight, 1.0), min(weight, 1.0)
    balance = of_path * path_error - of_speed * (CLIMB_P / _SPEED_P * faster - gain)
    top = 0.01 * m.THR_MAX
    throttle = 0.01 * m.TRIM_THROTTLE + m.throttle_trim + 0.5 * total
    if 0.0 < throttle < top or (throttle >= top) != (total > 0.0):
        m.throttle_trim += 0.15 * total * h
    m.at_limit = throttle > top
    if m.at_limit:
        m.strained = True
    if slow:
        throttle = top
    m.pitch_trim = clip(m.pitch_trim + 0.3 * balance * h, -0.2, 0.3)
    pitch = of_path * climb / speed + m.pitch_trim + 0.4 * balance
    low, high = math.radians(m.PTCH_LIM_MIN_DEG), math.radians(m.PTCH_LIM_MAX_DEG)
    return clip(pitch, low, high), clip(throttle, 0.0, top)
