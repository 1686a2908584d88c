"""Learning CRUISE_SPEED and CRUISE_THROTTLE of rovers and boats while a pilot drives at a steady speed.

A switch begins it; 2 s later, the smoothed throttle, if it is between 10 and 100 %, and speed are the new parameters.
Kernels over a record that has `LEARN_MEMORY` and what `driving` needs.

Differences from ArduRover: it looks ten times a second, not 50.

Source: ArduPilot, Rover/cruise_learn.cpp (the low-pass filters have 2 Hz).
"""

from __future__ import annotations

from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_CRITICAL
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.words import LEARN_FAILED, LEARNED, LEARNS, NOT_LEARNING, say, say_figures
from cosim_models.autopilot.surface.driving import ground_speed

__all__ = ["LEARN_MEMORY", "begin_learning", "learn"]

_SHARE = 0.1 / (0.1 + 1.0 / (2.0 * 3.141592653589793 * 2.0))  # of a new value: 2 Hz, looks of 0.1 s
_DURATION = 2.0  # s
_LEAST, _MOST = 10.0, 100.0  # %

LEARN_MEMORY = (
    Memory("learns", dtype="?", rare=True),
    Memory("learn_since", rare=True),  # s
    Memory("learned", shape=2, rare=True),  # m/s and %
)


@kernel
def _throttle(m: Any) -> float:
    """Returns the throttle [%], negative backwards."""
    return float(200.0 * m.motor[1] - 100.0)


@kernel
def begin_learning(m: Any, t: float) -> None:
    m.learns = m.armed
    m.learn_since = t
    m.learned[0], m.learned[1] = ground_speed(m, heading(m)), _throttle(m)
    say(m, MAV_SEVERITY_CRITICAL, LEARNS if m.armed else NOT_LEARNING, 0)


@kernel
def learn(m: Any, t: float) -> None:
    """Looks at speed and throttle, and ends when it is time; required ten times a second while m.learns."""
    m.learned[0] += _SHARE * (ground_speed(m, heading(m)) - m.learned[0])
    m.learned[1] += _SHARE * (_throttle(m) - m.learned[1])
    if t - m.learn_since < _DURATION - 1e-9:
        return
    m.learns = False
    if _LEAST <= m.learned[1] <= _MOST and m.learned[0] > 0.0:
        m.CRUISE_SPEED = m.learned[0]
        m.CRUISE_THROTTLE = float(int(m.learned[1]))
        say_figures(m, MAV_SEVERITY_CRITICAL, LEARNED, (m.CRUISE_THROTTLE, m.CRUISE_SPEED, 0.0, 0.0))
    else:
        say(m, MAV_SEVERITY_CRITICAL, LEARN_FAILED, 0)
