"""Numbers of flight modes and of their sub-modes, as ArduCopter has them."""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "ACCELERATION",
    "ALT_HOLD",
    "ANGLE",
    "AUTO",
    "BRAKE",
    "CIRCLE",
    "CLIMB",
    "DESCEND",
    "FINAL",
    "GUIDED",
    "LAND",
    "LANDING",
    "LOITER",
    "POSITION",
    "POSITION_VELOCITY",
    "RETURN",
    "RTL",
    "STABILIZE",
    "TAKEOFF",
    "VELOCITY",
    "WAIT",
    "Mode",
]


class Mode(IntEnum):
    """Flight modes, by ArduCopter's numbers."""

    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    BRAKE = 17


# Numpy integers, because numba recompiles a kernel for every Python integer passed as a constant.
STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, CIRCLE, LAND, BRAKE = (
    0,
    2,
    3,
    4,
    5,
    6,
    7,
    9,
    17,
)

# Sub-modes of GUIDED.
TAKEOFF, POSITION, VELOCITY, POSITION_VELOCITY, ACCELERATION, ANGLE = range(6)
# Sub-modes of RTL.
CLIMB, RETURN, WAIT, DESCEND, FINAL = range(5)

LANDING = 4
"""MAV_LANDED_STATE."""
