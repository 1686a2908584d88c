"""Commands that ArduPilot answers without an effect on the vehicle, or for which the vehicle lacks the part.

Source: ArduPilot, GCS_Common; the answers were heard from ArduRover and ArduPlane 4.7-dev (`benchmarks.wire_others`).
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    MAV_CMD_DO_GRIPPER,
    MAV_CMD_DO_JUMP_TAG,
    MAV_CMD_DO_MOUNT_CONFIGURE,
    MAV_CMD_DO_MOUNT_CONTROL,
    MAV_CMD_DO_SEND_BANNER,
    MAV_CMD_DO_START_MAG_CAL,
    MAV_CMD_GET_MESSAGE_INTERVAL,
    MAV_CMD_IMAGE_START_CAPTURE,
    MAV_CMD_PREFLIGHT_CALIBRATION,
    MAV_CMD_RUN_PREARM_CHECKS,
    MAV_CMD_VIDEO_START_CAPTURE,
    MAV_CMD_VIDEO_STOP_CAPTURE,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_FAILED,
    MAV_RESULT_TEMPORARILY_REJECTED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
    MESSAGE_INTERVAL,
    encode_message_interval,
)
from cosim_models.autopilot.gcs.rows import row_of
from cosim_models.autopilot.gcs.sending import can_answer, send
from cosim_models.autopilot.gcs.words import CALIBRATION_ARMED, COMPASS_ARMED, PLANE, ROVER, say

__all__ = ["NOT_HERE", "answer"]

NOT_HERE = cast(int, np.int64(-1))
"""The command is not one of these."""
_ABSENT = np.array(
    [
        MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        MAV_CMD_DO_GRIPPER,
        MAV_CMD_DO_JUMP_TAG,
        MAV_CMD_DO_MOUNT_CONFIGURE,
        MAV_CMD_DO_MOUNT_CONTROL,
        MAV_CMD_IMAGE_START_CAPTURE,
        MAV_CMD_VIDEO_START_CAPTURE,
        MAV_CMD_VIDEO_STOP_CAPTURE,
    ]
)
"""For gimbal, gripper, camera and a mission with tags, which are not on board."""
_INTERVAL = cast(int, np.int64(MESSAGE_INTERVAL))


@kernel
def _tell_interval(m: Any, message: float) -> int:
    """Sends MESSAGE_INTERVAL: in us, -1 if it is not sent, 0 if it is unknown."""
    row = row_of(message)
    if not 0.0 <= message <= 65535.0 or not can_answer(m):
        return MAV_RESULT_FAILED
    interval = 0
    if row >= 0:
        interval = int(1e6 * m.interval[row] + 0.5) if m.interval[row] > 0.0 else -1
    encode_message_interval(m.payload, int(message), interval)
    send(m, _INTERVAL)
    return MAV_RESULT_ACCEPTED if row >= 0 else MAV_RESULT_FAILED


@kernel
def answer(m: Any, command: int, p1: float) -> int:
    """Answers a command; returns its MAV_RESULT, or NOT_HERE."""
    if command == MAV_CMD_GET_MESSAGE_INTERVAL:
        return _tell_interval(m, p1)
    if command == MAV_CMD_RUN_PREARM_CHECKS:
        return MAV_RESULT_TEMPORARILY_REJECTED if m.armed else MAV_RESULT_ACCEPTED
    if command == MAV_CMD_PREFLIGHT_CALIBRATION and m.armed:
        say(m, MAV_SEVERITY_NOTICE, CALIBRATION_ARMED, 0)
        return MAV_RESULT_FAILED
    if command == MAV_CMD_DO_START_MAG_CAL and m.armed:
        say(m, MAV_SEVERITY_NOTICE, COMPASS_ARMED, 0)
        return MAV_RESULT_FAILED
    if command == MAV_CMD_DO_SEND_BANNER and m.kind != MAV_TYPE_QUADROTOR:
        say(m, MAV_SEVERITY_INFO, ROVER if m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT) else PLANE, 0)
        return MAV_RESULT_ACCEPTED
    for i in range(_ABSENT.size):
        if _ABSENT[i] == command:
            return MAV_RESULT_FAILED
    return NOT_HERE
