"""A battery: charge, voltage at rest, voltage under load, and the power that rotors take from it.

The voltage at rest is a function of the charge. An internal resistance lowers it under load. Motors with speed
controllers take power, not current: a lower voltage means more current.

Sources: the discharge curve is a typical one of lithium-polymer cells at rest, the one of the autopilot's simulated
battery; the voltage of a source with internal resistance under a load of constant power is the greater root of
V (E - V) / R = P; the power of a rotor is that of momentum theory (J. G. Leishman, Principles of Helicopter
Aerodynamics, 2nd edition, section 2.2), divided by an efficiency that covers profile drag, motor and controller.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from cosim.kernel import kernel

__all__ = ["AIR_DENSITY", "FULL_CELL", "loaded_voltage", "rest_voltage", "rotor_power"]

AIR_DENSITY = 1.225
"""Of the standard atmosphere at sea level [kg/m3]."""

FULL_CELL = 4.2
"""Voltage of a full cell at rest [V]."""

_CHARGE = np.array((0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0))
_AT_REST = np.array((3.0, 3.45, 3.68, 3.74, 3.77, 3.79, 3.82, 3.87, 3.92, 3.98, 4.06, 4.2))


@kernel
def rest_voltage(charge: float) -> float:
    """Returns the voltage of a cell at rest [V] at `charge` (0 to 1), linear between the points of the curve."""
    if charge <= 0.0:
        return float(_AT_REST[0])
    i = 1
    while i < _CHARGE.shape[0] - 1 and charge > _CHARGE[i]:
        i += 1
    part = (charge - _CHARGE[i - 1]) / (_CHARGE[i] - _CHARGE[i - 1])
    return float(_AT_REST[i - 1] + part * (_AT_REST[i] - _AT_REST[i - 1]))


@kernel
def loaded_voltage(rest: float, resistance: float, power: float) -> float:
    """Returns the voltage [V] of a source of `rest` [V] and `resistance` [V/A] that gives `power` [W].

    A load of more than rest^2 / (4 resistance) cannot be fed: the voltage is then half of that at rest, where the
    source gives most.
    """
    square = rest * rest - 4.0 * resistance * power
    return 0.5 * (rest + sqrt(square)) if square > 0.0 else 0.5 * rest


@kernel
def rotor_power(speed: float, thrust_constant: float, radius: float, efficiency: float) -> float:
    """Returns the electric power of a hovering rotor [W]: T^1.5 / sqrt(2 rho A) / efficiency, T = constant speed^2."""
    thrust = thrust_constant * speed * speed
    return thrust * sqrt(thrust / (2.0 * AIR_DENSITY * pi)) / (radius * efficiency)
