"""Numbers of flight modes and of their sub-modes, as ArduCopter has them."""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "ACCELERATION",
    "ALT_HOLD",
    "ANGLE",
    "AUTO",
    "AUTOTUNE",
    "AVOID_ADSB",
    "BRAKE",
    "CIRCLE",
    "CLIMB",
    "DESCEND",
    "FINAL",
    "FLIP",
    "GUIDED",
    "GUIDED_NOGPS",
    "LAND",
    "LANDING",
    "LOITER",
    "POSITION",
    "POSITION_VELOCITY",
    "RETURN",
    "RTL",
    "STABILIZE",
    "TAKEOFF",
    "THROW",
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
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20


# Numpy integers, because numba recompiles a kernel for every Python integer passed as a constant.
STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, CIRCLE, LAND, BRAKE, AVOID_ADSB, GUIDED_NOGPS = (
    0,
    2,
    3,
    4,
    5,
    6,
    7,
    9,
    17,
    19,
    20,
)
FLIP, AUTOTUNE, THROW = 14, 15, 18
"""Modes that are refused as if their conditions were not met."""

# Sub-modes of GUIDED.
TAKEOFF, POSITION, VELOCITY, POSITION_VELOCITY, ACCELERATION, ANGLE = range(6)
# Sub-modes of RTL.
CLIMB, RETURN, WAIT, DESCEND, FINAL = range(5)

LANDING = 4
"""MAV_LANDED_STATE."""
