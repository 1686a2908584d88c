"""The Y6 FMU: three arms with one rotor above and one below each. The physics is in `multirotor`.

Source: the parts are those of `Hexarotor`, the AscTec Firefly of RotorS, on three of its arms: mass and moments of
inertia are equal to those of the Firefly, because both arrangements of six rotors have the same moments. Motors are
numbered and turn as in ArduPilot's Y6B (AP_MotorsMatrix): all upper rotors clockwise, all lower ones counter-clockwise.
Not modelled: the lower rotor works in the wake of the upper one and loses some of its thrust.
"""

from __future__ import annotations

from math import sqrt

from cosim import Model
from cosim.vehicle import Airframe
from cosim_models.vehicles.hexarotor import Hexarotor
from cosim_models.vehicles.multirotor import ERRORS, KERNELS, STEP_SIZE, started

__all__ = ["Y6"]

_ARM, _HUB = 0.215, 0.037
_X, _Y = 0.5 * _ARM, _ARM * sqrt(0.75)


class Y6(Model):
    """Y6: rigid body, six rotors on three arms, with lag, drag, wind and ground (parts of the AscTec Firefly)."""

    step_size = STEP_SIZE
    variables = started(
        Hexarotor.variables,
        Airframe.y6,
        rotor_x=(_X, _X, -_ARM, -_ARM, _X, _X, 0.0, 0.0),
        rotor_y=(_Y, _Y, 0.0, 0.0, -_Y, -_Y, 0.0, 0.0),
        rotor_z=(-_HUB, _HUB, -_HUB, _HUB, -_HUB, _HUB, 0.0, 0.0),
        rotor_direction=(-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0, 0.0),
    )
    kernels = KERNELS
    errors = ERRORS
