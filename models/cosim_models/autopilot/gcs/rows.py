"""The messages that the small autopilots send at an interval or on request: a table, in the order of sending.

Source: ArduPilot, GCS_MAVLink (stream groups).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    AHRS,
    AHRS2,
    ATTITUDE,
    ATTITUDE_QUATERNION,
    ATTITUDE_TARGET,
    AUTOPILOT_STATE_FOR_GIMBAL_DEVICE,
    AUTOPILOT_VERSION,
    BATTERY_STATUS,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    FLIGHT_INFORMATION,
    GLOBAL_POSITION_INT,
    GPS_GLOBAL_ORIGIN,
    GPS_RAW_INT,
    HEARTBEAT,
    HIGH_LATENCY2,
    HIGHRES_IMU,
    HOME_POSITION,
    HWSTATUS,
    LOCAL_POSITION_NED,
    MAV_DATA_STREAM_EXTENDED_STATUS,
    MAV_DATA_STREAM_EXTRA1,
    MAV_DATA_STREAM_EXTRA2,
    MAV_DATA_STREAM_EXTRA3,
    MAV_DATA_STREAM_POSITION,
    MAV_DATA_STREAM_RAW_SENSORS,
    MAV_DATA_STREAM_RC_CHANNELS,
    MEMINFO,
    MISSION_CURRENT,
    NAV_CONTROLLER_OUTPUT,
    POWER_STATUS,
    RAW_IMU,
    RC_CHANNELS,
    RELAY_STATUS,
    SCALED_IMU,
    SCALED_IMU2,
    SCALED_IMU3,
    SCALED_PRESSURE,
    SCALED_PRESSURE2,
    SERVO_OUTPUT_RAW,
    SIMSTATE,
    SYS_STATUS,
    SYSTEM_TIME,
    TERRAIN_REPORT,
    VFR_HUD,
    VIBRATION,
    WIND,
)
from cosim_models.autopilot.link.available_modes import AVAILABLE_MODES, AVAILABLE_MODES_MONITOR

__all__ = ["AIRSPEED", "MODES_ROW", "ROWS", "group_of", "is_absent", "message_of", "row_of"]

AIRSPEED = cast(int, np.int64(295))
"""A message that `cosim.messages` does not have."""
_NONE = 0  # in no MAV_DATA_STREAM
_TABLE = (
    (HEARTBEAT, _NONE),
    (SYS_STATUS, MAV_DATA_STREAM_EXTENDED_STATUS),
    (GPS_RAW_INT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (GLOBAL_POSITION_INT, MAV_DATA_STREAM_POSITION),
    (LOCAL_POSITION_NED, MAV_DATA_STREAM_POSITION),
    (ATTITUDE, MAV_DATA_STREAM_EXTRA1),
    (VFR_HUD, MAV_DATA_STREAM_EXTRA2),
    (EKF_STATUS_REPORT, MAV_DATA_STREAM_EXTRA3),
    (SYSTEM_TIME, MAV_DATA_STREAM_EXTRA3),
    (EXTENDED_SYS_STATE, _NONE),
    (HOME_POSITION, _NONE),
    (AUTOPILOT_VERSION, _NONE),
    (MISSION_CURRENT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (SERVO_OUTPUT_RAW, MAV_DATA_STREAM_RC_CHANNELS),
    (ATTITUDE_QUATERNION, _NONE),
    (GPS_GLOBAL_ORIGIN, _NONE),
    (RAW_IMU, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_IMU2, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_IMU3, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_PRESSURE, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_PRESSURE2, MAV_DATA_STREAM_RAW_SENSORS),
    (POWER_STATUS, MAV_DATA_STREAM_EXTENDED_STATUS),
    (MEMINFO, MAV_DATA_STREAM_EXTENDED_STATUS),
    (NAV_CONTROLLER_OUTPUT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (RC_CHANNELS, MAV_DATA_STREAM_RC_CHANNELS),
    (SIMSTATE, MAV_DATA_STREAM_EXTRA1),
    (AHRS2, MAV_DATA_STREAM_EXTRA1),
    (AHRS, MAV_DATA_STREAM_EXTRA3),
    (VIBRATION, MAV_DATA_STREAM_EXTRA3),
    (BATTERY_STATUS, MAV_DATA_STREAM_EXTRA3),
    (TERRAIN_REPORT, MAV_DATA_STREAM_EXTRA3),
    (WIND, MAV_DATA_STREAM_EXTRA3),
    (HWSTATUS, _NONE),
    (SCALED_IMU, _NONE),
    (HIGHRES_IMU, _NONE),
    (HIGH_LATENCY2, _NONE),
    (FLIGHT_INFORMATION, _NONE),
    (AUTOPILOT_STATE_FOR_GIMBAL_DEVICE, _NONE),
    (RELAY_STATUS, _NONE),
    (ATTITUDE_TARGET, _NONE),
    (AVAILABLE_MODES, _NONE),
    (AVAILABLE_MODES_MONITOR, _NONE),
    (AIRSPEED, MAV_DATA_STREAM_RAW_SENSORS),
)
ROWS = len(_TABLE)
MODES_ROW = cast(int, np.int64([message for message, _ in _TABLE].index(AVAILABLE_MODES)))
_IDS = np.array([message for message, _ in _TABLE], dtype=np.int64)
_GROUPS = np.array([group for _, group in _TABLE], dtype=np.int64)


_ABSENT_IDS = (
    22,
    35,
    100,
    124,
    127,
    128,
    132,
    143,
    162,
    173,
    180,
    191,
    192,
    194,
    225,
    226,
    246,
    259,
    260,
)
_ABSENT = np.array((*_ABSENT_IDS, 262, 269, 271, 280, 281, 285, 301, 373))
"""Ids of messages that ArduPilot knows and does not send, as that of which they tell is not on board."""


@kernel
def is_absent(message: float) -> bool:
    """Returns whether ArduPilot accepts a request for a message and sends nothing."""
    for i in range(_ABSENT.size):  # noqa: SIM110, a kernel
        if _ABSENT[i] == message:
            return True
    return False


@kernel
def message_of(row: int) -> int:
    """Returns the message id of a row; row 0 is HEARTBEAT."""
    return int(_IDS[row])


@kernel
def group_of(row: int) -> int:
    """Returns the MAV_DATA_STREAM of a row, 0 if it belongs to none."""
    return int(_GROUPS[row])


@kernel
def row_of(message: float) -> int:
    """Returns the row of a message id, -1 if it has none."""
    for row in range(ROWS):
        if _IDS[row] == message:
            return row
    return -1
