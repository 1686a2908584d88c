"""Numbers of flight modes and of their sub-modes, as ArduCopter has them."""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "ACCELERATION",
    "ACRO",
    "ALT_HOLD",
    "ANGLE",
    "AUTO",
    "AUTOTUNE",
    "AUTO_RTL",
    "AVOID_ADSB",
    "BRAKE",
    "CIRCLE",
    "CLIMB",
    "DESCEND",
    "DRIFT",
    "FINAL",
    "FLIP",
    "FLOWHOLD",
    "FOLLOW",
    "GUIDED",
    "GUIDED_NOGPS",
    "LAND",
    "LANDING",
    "LOITER",
    "POSHOLD",
    "POSITION",
    "POSITION_VELOCITY",
    "RETURN",
    "RTL",
    "SMART_RTL",
    "STABILIZE",
    "SYSTEMID",
    "TAKEOFF",
    "THROW",
    "TURTLE",
    "VELOCITY",
    "WAIT",
    "ZIGZAG",
    "Mode",
]


class Mode(IntEnum):
    """Flight modes, by ArduCopter's numbers."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    DRIFT = 11
    FLIP = 14
    AUTOTUNE = 15
    POSHOLD = 16
    BRAKE = 17
    THROW = 18
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20
    SMART_RTL = 21
    ZIGZAG = 24


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
ACRO, DRIFT, FLIP, AUTOTUNE, POSHOLD, THROW, SMART_RTL, ZIGZAG = 1, 11, 14, 15, 16, 18, 21, 24
AUTO_RTL = 27
"""AUTO that flies the landing sequence: HEARTBEAT reports it, `Mode` does not have it."""
FLOWHOLD, FOLLOW, SYSTEMID, TURTLE = 22, 23, 25, 28
"""Modes that are refused as if their conditions were not met."""

# Sub-modes of GUIDED.
TAKEOFF, POSITION, VELOCITY, POSITION_VELOCITY, ACCELERATION, ANGLE = range(6)
# Sub-modes of RTL.
CLIMB, RETURN, WAIT, DESCEND, FINAL = range(5)

LANDING = 4
"""MAV_LANDED_STATE."""
