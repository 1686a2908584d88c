"""Functions of switches that planes have and rovers have not, and the modes that switches change to.

Inverted flight is that of the wing, in all modes but MANUAL and ACRO; while rotors run, it is upright. On quadplanes,
the rotors' help on the wing can be forbidden and forced, and air mode lets them turn with the throttle closed in
QSTABILIZE and QACRO. The emergency landing makes fail-safes glide (FBWA). Of functions of parts that are not on board,
a text says so.

Kernels over a record that has `SWITCH_MEMORY` of `gcs.switches` and `FUNCTION_MEMORY`.

Source: ArduPilot, ArduPlane/RC_Channel_Plane.cpp, config.h (modes of the mode switch), VTOL_Assist.h.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.switches import ARM_AIR_MODE, HIGH, return_to_switch
from cosim_models.autopilot.gcs.words import ASSISTANCE, NO_EFFECT, say
from cosim_models.autopilot.wing.autotune import end_tuning, start_tuning

__all__ = ["ASSISTS", "FORBIDDEN", "FORCED", "FUNCTION_MEMORY", "MODE_FUNCTIONS", "SWITCHED_MODES", "own_functions"]

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
ASSISTS, FORCED, FORBIDDEN = (cast(int, np.int64(i)) for i in range(3))
"""The rotors' help on the wing, `assistance`."""
_INVERTED, _ASSIST, _AIR_MODE, _RESET, _EMERGENCY_LANDING = 43, 82, 84, 96, 157
_LOW, _MIDDLE = 0, 1
_GPS = 65
_IDLE = (22, 64, 86, 87, 88, 89, 91, 95, 106, 155, 160, 173, 176, 180, 208, 209, 210)
"""For parachute, reverse thrust, terrain, crow flaps, soaring, flare, airspeed sensor, tail wheel, tests of gains,
trims, landings, weather vane, forward throttle, flaps and air brakes."""
_AUTOTUNE = 107

FUNCTION_MEMORY = (
    Memory("inverted_asked", dtype="?"),
    Memory("inverted", dtype="?"),
    Memory("assistance", dtype="i4"),
    Memory("air_mode", dtype="?", rare=True),  # by its switch
    Memory("armed_in_air_mode", dtype="?", rare=True),
    Memory("emergency_landing", dtype="?", rare=True),
)


@kernel
def _set(m: Any, function: int, at: int) -> bool:
    """Does what needs no kernel of the vehicle; returns whether a function is one of these."""
    if function == _INVERTED:
        m.inverted_asked = at == HIGH
        m.inverted = m.inverted_asked and not m.lifts
    elif function == _ASSIST and m.lifts:
        m.assistance = FORCED if at == HIGH else FORBIDDEN if at == _LOW else ASSISTS
        say(m, MAV_SEVERITY_INFO, ASSISTANCE + at, 0)
    elif function == _AIR_MODE and m.lifts:
        if at != _MIDDLE:
            m.air_mode = at == HIGH
    elif function == _EMERGENCY_LANDING:
        if at != _MIDDLE:
            m.emergency_landing = at == HIGH
    elif function == _AUTOTUNE:
        if at == HIGH:
            start_tuning(m)
        else:
            end_tuning(m)
    elif function in _IDLE or function in (_ASSIST, _AIR_MODE):
        say(m, MAV_SEVERITY_INFO, NO_EFFECT, function)
    else:
        return False
    return True


def own_functions(arm: Callable[[Any, bool, float], int]) -> Callable[[Any, int, int, float], bool]:
    """Returns a kernel of (record, function, position, time [s]) for functions of ArduPlane alone.

    It does what a switch with such a function does, and returns whether it is one.

    Args:
        arm: kernel of (record, whether forced, time) that arms.
    """

    @kernel
    def use_own(m: Any, function: int, at: int, t: float) -> bool:
        if function == _GPS:
            m.gps_off = at == HIGH
        elif function == _RESET:
            return_to_switch(m, t)
        elif function == ARM_AIR_MODE:
            if at == HIGH and not m.armed:
                arm(m, False, t)
                m.armed_in_air_mode = m.armed
            elif at == _LOW:
                m.armed = False
        else:
            return bool(_set(m, function, at))
        return True

    return use_own
