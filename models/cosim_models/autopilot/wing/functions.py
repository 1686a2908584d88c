"""Functions of switches that planes have and rovers have not, and the modes that switches change to.

Kernels over a record that has `SWITCH_MEMORY` of `gcs.switches`.

Source: ArduPilot, ArduPlane/RC_Channel_Plane.cpp, config.h (modes of the mode switch).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cosim.kernel import kernel
from cosim_models.autopilot.gcs.switches import ARM_AIR_MODE, HIGH, return_to_switch

__all__ = ["MODE_FUNCTIONS", "SWITCHED_MODES", "own_functions"]

_MANUAL, _CIRCLE, _TRAINING, _ACRO, _FBWA, _CRUISE = 0, 1, 3, 4, 5, 7
_AUTO, _RTL, _LOITER, _TAKEOFF, _GUIDED, _QSTABILIZE, _QRTL, _AUTOLAND = 10, 11, 12, 13, 15, 17, 21, 26

MODE_FUNCTIONS = (
    (4, _RTL),
    (16, _AUTO),
    (51, _MANUAL),
    (52, _ACRO),
    (55, _GUIDED),
    (56, _LOITER),
    (72, _CIRCLE),
    (77, _TAKEOFF),
    (92, _FBWA),
    (98, _TRAINING),
    (108, _QRTL),
    (150, _CRUISE),
    (170, _QSTABILIZE),
    (183, _AUTOLAND),
)
"""Auxiliary functions and the modes to which they change."""
SWITCHED_MODES = (_RTL, _RTL, _FBWA, _FBWA, _MANUAL, _MANUAL)
"""Modes of the positions of the mode switch."""
_RESET = 96
_LOW = 0
_IDLE = (22, 43, 64, 82, 84, 86, 87, 88, 89, 91, 95, 106, 107, 155, 157, 160, 173, 176, 180, 208, 209, 210)
"""For parachute, inverted flight, reverse thrust, help of the rotors, air mode, terrain, crow flaps, soaring, flare,
airspeed sensor, tail wheel, tuning, trims, landings, weather vane, forward throttle, flaps and air brakes."""


def own_functions(arm: Callable[[Any, bool, float], int]) -> Callable[[Any, int, int, float], bool]:
    """Returns a kernel of (record, function, position, time [s]) for functions of ArduPlane alone.

    It does what a switch with such a function does, and returns whether it is one.

    Args:
        arm: kernel of (record, whether forced, time) that arms.
    """

    @kernel
    def use_own(m: Any, function: int, at: int, t: float) -> bool:
        if function == _RESET:
            return_to_switch(m, t)
        elif function == ARM_AIR_MODE:
            if at == HIGH and not m.armed:
                arm(m, False, t)
            elif at == _LOW:
                m.armed = False
        else:
            return function in _IDLE
        return True

    return use_own
