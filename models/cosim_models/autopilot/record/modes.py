"""Numbers of flight modes and of their sub-modes, as ArduCopter has them."""

from __future__ import annotations

from enum import IntEnum
from typing import cast

import numpy as np

__all__ = [
    "ACCELERATION",
    "ALT_HOLD",
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
    cast(int, np.int64(0)),
    cast(int, np.int64(2)),
    cast(int, np.int64(3)),
    cast(int, np.int64(4)),
    cast(int, np.int64(5)),
    cast(int, np.int64(6)),
    cast(int, np.int64(7)),
    cast(int, np.int64(9)),
    cast(int, np.int64(17)),
)

# Sub-modes of GUIDED.
TAKEOFF, POSITION, VELOCITY, POSITION_VELOCITY, ACCELERATION = (cast(int, np.int64(i)) for i in range(5))
# Sub-modes of RTL.
CLIMB, RETURN, WAIT, DESCEND, FINAL = range(5)

LANDING = 4
"""MAV_LANDED_STATE."""
