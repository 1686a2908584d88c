"""Messages that the autopilot sends at an interval or on request. Tables only; `messages` fills the messages.

Source: ArduPilot, GCS_MAVLink_Copter (stream groups).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    AHRS,
    AHRS2,
    ATTITUDE,
    AUTOPILOT_VERSION,
    BATTERY_STATUS,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    FENCE_STATUS,
    GLOBAL_POSITION_INT,
    GPS_GLOBAL_ORIGIN,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    LOCAL_POSITION_NED,
    MEMINFO,
    MISSION_CURRENT,
    NAV_CONTROLLER_OUTPUT,
    POSITION_TARGET_GLOBAL_INT,
    POSITION_TARGET_LOCAL_NED,
    POWER_STATUS,
    RAW_IMU,
    RC_CHANNELS,
    SCALED_IMU,
    SCALED_PRESSURE,
    SERVO_OUTPUT_RAW,
    SIMSTATE,
    SYS_STATUS,
    SYSTEM_TIME,
    VFR_HUD,
    VIBRATION,
)

__all__ = ["HEARTBEAT_ROW", "STREAMS", "STREAM_COUNT", "message_of", "stream_group", "stream_of"]

# MAV_DATA_STREAM
_NONE, _RAW, _STATUS, _RC, _POSITION, _EXTRA1, _EXTRA2, _EXTRA3 = 0, 1, 2, 3, 6, 10, 11, 12

_TABLE = (
    (SYS_STATUS, _STATUS),
    (GPS_RAW_INT, _STATUS),
    (LOCAL_POSITION_NED, _POSITION),
    (GLOBAL_POSITION_INT, _POSITION),
    (ATTITUDE, _EXTRA1),
    (VFR_HUD, _EXTRA2),
    (EKF_STATUS_REPORT, _EXTRA3),
    (SYSTEM_TIME, _EXTRA3),
    (SERVO_OUTPUT_RAW, _RC),
    (RC_CHANNELS, _RC),
    (EXTENDED_SYS_STATE, _NONE),
    (HOME_POSITION, _NONE),
    (GPS_GLOBAL_ORIGIN, _NONE),
    (AUTOPILOT_VERSION, _NONE),
    (POWER_STATUS, _STATUS),
    (NAV_CONTROLLER_OUTPUT, _STATUS),
    (POSITION_TARGET_GLOBAL_INT, _STATUS),
    (POSITION_TARGET_LOCAL_NED, _NONE),
    (BATTERY_STATUS, _EXTRA3),
    (RAW_IMU, _RAW),
    (SCALED_IMU, _NONE),
    (SCALED_PRESSURE, _RAW),
    (SIMSTATE, _EXTRA1),
    (AHRS2, _EXTRA1),
    (AHRS, _EXTRA3),
    (VIBRATION, _EXTRA3),
    (MEMINFO, _STATUS),
    (FENCE_STATUS, _STATUS),
    (MISSION_CURRENT, _STATUS),
    (HEARTBEAT, _NONE),
)
STREAMS = tuple(message for message, _ in _TABLE)
"""Rows in the order in which they are sent."""
STREAM_COUNT = len(STREAMS)
HEARTBEAT_ROW = cast(int, np.int64(STREAM_COUNT - 1))
_IDS = np.array(STREAMS, dtype=np.int64)
_GROUPS = np.array([group for _, group in _TABLE], dtype=np.int64)


@kernel
def message_of(row: int) -> int:
    """Returns the message id of a row of STREAMS."""
    return int(_IDS[row])


@kernel
def stream_group(row: int) -> int:
    """Returns the MAV_DATA_STREAM of a row of STREAMS, 0 if it belongs to none."""
    return int(_GROUPS[row])


@kernel
def stream_of(message: int) -> int:
    """Returns the row of STREAMS for a message id, -1 if it has none."""
    for row in range(STREAM_COUNT):
        if _IDS[row] == message:
            return row
    return -1
