"""Messages that the autopilot sends at an interval or on request. Tables only; `messages` fills the messages.

Source: ArduPilot, GCS_MAVLink_Copter (stream groups).
"""

from __future__ import annotations

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
    DISTANCE_SENSOR,
    EKF_STATUS_REPORT,
    EXTENDED_SYS_STATE,
    FENCE_STATUS,
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
    POSITION_TARGET_GLOBAL_INT,
    POSITION_TARGET_LOCAL_NED,
    POWER_STATUS,
    RANGEFINDER,
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

__all__ = ["HEARTBEAT_ROW", "STREAMS", "STREAM_COUNT", "is_silent", "message_of", "stream_group", "stream_of"]

_NONE = 0  # in no MAV_DATA_STREAM

_TABLE = (
    (SYS_STATUS, MAV_DATA_STREAM_EXTENDED_STATUS),
    (GPS_RAW_INT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (LOCAL_POSITION_NED, MAV_DATA_STREAM_POSITION),
    (GLOBAL_POSITION_INT, MAV_DATA_STREAM_POSITION),
    (ATTITUDE, MAV_DATA_STREAM_EXTRA1),
    (VFR_HUD, MAV_DATA_STREAM_EXTRA2),
    (EKF_STATUS_REPORT, MAV_DATA_STREAM_EXTRA3),
    (SYSTEM_TIME, MAV_DATA_STREAM_EXTRA3),
    (SERVO_OUTPUT_RAW, MAV_DATA_STREAM_RC_CHANNELS),
    (RC_CHANNELS, MAV_DATA_STREAM_RC_CHANNELS),
    (EXTENDED_SYS_STATE, _NONE),
    (HOME_POSITION, _NONE),
    (GPS_GLOBAL_ORIGIN, _NONE),
    (AUTOPILOT_VERSION, _NONE),
    (POWER_STATUS, MAV_DATA_STREAM_EXTENDED_STATUS),
    (NAV_CONTROLLER_OUTPUT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (POSITION_TARGET_GLOBAL_INT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (POSITION_TARGET_LOCAL_NED, _NONE),
    (BATTERY_STATUS, MAV_DATA_STREAM_EXTRA3),
    (RAW_IMU, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_IMU, _NONE),
    (SCALED_PRESSURE, MAV_DATA_STREAM_RAW_SENSORS),
    (SIMSTATE, MAV_DATA_STREAM_EXTRA1),
    (AHRS2, MAV_DATA_STREAM_EXTRA1),
    (AHRS, MAV_DATA_STREAM_EXTRA3),
    (VIBRATION, MAV_DATA_STREAM_EXTRA3),
    (MEMINFO, MAV_DATA_STREAM_EXTENDED_STATUS),
    (FENCE_STATUS, MAV_DATA_STREAM_EXTENDED_STATUS),
    (MISSION_CURRENT, MAV_DATA_STREAM_EXTENDED_STATUS),
    (SCALED_IMU2, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_IMU3, MAV_DATA_STREAM_RAW_SENSORS),
    (SCALED_PRESSURE2, MAV_DATA_STREAM_RAW_SENSORS),
    (WIND, MAV_DATA_STREAM_EXTRA3),
    (RANGEFINDER, MAV_DATA_STREAM_EXTRA3),
    (DISTANCE_SENSOR, MAV_DATA_STREAM_EXTRA3),
    (TERRAIN_REPORT, MAV_DATA_STREAM_EXTRA3),
    (ATTITUDE_QUATERNION, _NONE),
    (ATTITUDE_TARGET, _NONE),
    (HIGHRES_IMU, _NONE),
    (HWSTATUS, _NONE),
    (HIGH_LATENCY2, _NONE),
    (FLIGHT_INFORMATION, _NONE),
    (AUTOPILOT_STATE_FOR_GIMBAL_DEVICE, _NONE),
    (RELAY_STATUS, _NONE),
    (AVAILABLE_MODES, _NONE),
    (AVAILABLE_MODES_MONITOR, _NONE),
    (HEARTBEAT, _NONE),
)
STREAMS = tuple(message for message, _ in _TABLE)
"""Rows in the order in which they are sent."""
STREAM_COUNT = len(STREAMS)
_SILENT = np.array(
    (
        *(
            22,
            35,
            100,
            124,
            127,
            128,
            133,
            143,
            180,
            191,
            192,
            194,
            225,
            226,
            246,
            259,
            260,
            262,
            269,
            271,
            277,
        ),
        *(280, 281, 285, 295, 301, 373, 9000, 9005, 11020, 11030),
    ),
    dtype=np.int64,
)
"""Messages that ArduCopter knows and has nothing to say in, because the sensor or device is not on board."""
HEARTBEAT_ROW = STREAM_COUNT - 1
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


@kernel
def is_silent(message: int) -> bool:
    """Returns whether requests for a message id are accepted, but never followed by the message."""
    found = False
    for i in range(_SILENT.shape[0]):
        found = found or _SILENT[i] == message
    return bool(found)
