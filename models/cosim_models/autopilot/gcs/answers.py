"""Commands that ArduPilot answers without an effect on the vehicle, or for which the vehicle lacks the part.

Source: ArduPilot, GCS_Common; the answers were heard from ArduRover and ArduPlane 4.7-dev (`benchmarks.wire_others`).
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_BATTERY_RESET,
    MAV_CMD_CONTROL_HIGH_LATENCY,
    MAV_CMD_DO_CANCEL_MAG_CAL,
    MAV_CMD_DO_DIGICAM_CONFIGURE,
    MAV_CMD_DO_DIGICAM_CONTROL,
    MAV_CMD_DO_FENCE_ENABLE,
    MAV_CMD_DO_FLIGHTTERMINATION,
    MAV_CMD_DO_FOLLOW,
    MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    MAV_CMD_DO_GO_AROUND,
    MAV_CMD_DO_GRIPPER,
    MAV_CMD_DO_JUMP_TAG,
    MAV_CMD_DO_MOTOR_TEST,
    MAV_CMD_DO_MOUNT_CONFIGURE,
    MAV_CMD_DO_MOUNT_CONTROL,
    MAV_CMD_DO_PARACHUTE,
    MAV_CMD_DO_REPEAT_RELAY,
    MAV_CMD_DO_REPEAT_SERVO,
    MAV_CMD_DO_SEND_BANNER,
    MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    MAV_CMD_DO_SET_RELAY,
    MAV_CMD_DO_SET_REVERSE,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_DO_SET_ROI_NONE,
    MAV_CMD_DO_SET_ROI_SYSID,
    MAV_CMD_DO_SET_SERVO,
    MAV_CMD_DO_SPRAYER,
    MAV_CMD_DO_START_MAG_CAL,
    MAV_CMD_FIXED_MAG_CAL_YAW,
    MAV_CMD_GET_MESSAGE_INTERVAL,
    MAV_CMD_IMAGE_START_CAPTURE,
    MAV_CMD_PREFLIGHT_CALIBRATION,
    MAV_CMD_PREFLIGHT_STORAGE,
    MAV_CMD_RUN_PREARM_CHECKS,
    MAV_CMD_SET_EKF_SOURCE_SET,
    MAV_CMD_START_RX_PAIR,
    MAV_CMD_VIDEO_START_CAPTURE,
    MAV_CMD_VIDEO_STOP_CAPTURE,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_TEMPORARILY_REJECTED,
    MAV_SEVERITY_INFO,
    MAV_SEVERITY_NOTICE,
    MAV_SEVERITY_WARNING,
    MAV_TYPE_GROUND_ROVER,
    MAV_TYPE_QUADROTOR,
    MAV_TYPE_SURFACE_BOAT,
    MESSAGE_INTERVAL,
    encode_message_interval,
)
from cosim_models.autopilot.gcs.devices import repeat_relay, repeat_servo, set_relay, set_servo
from cosim_models.autopilot.gcs.rows import row_of
from cosim_models.autopilot.gcs.sending import can_answer, send
from cosim_models.autopilot.gcs.words import (
    AFS_OFF,
    CALIBRATION_ARMED,
    COMPASS_ARMED,
    INITIALISING,
    LATENCY_OFF,
    LATENCY_ON,
    PLANE,
    RESET,
    ROVER,
    say,
)

__all__ = ["NOT_HERE", "answer", "is_surface"]

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
_IDLE = np.array(
    [
        MAV_CMD_BATTERY_RESET,
        MAV_CMD_DO_CANCEL_MAG_CAL,
        MAV_CMD_DO_DIGICAM_CONFIGURE,
        MAV_CMD_DO_DIGICAM_CONTROL,
        MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        MAV_CMD_DO_SET_ROI,
        MAV_CMD_DO_SET_ROI_LOCATION,
        MAV_CMD_DO_SET_ROI_NONE,
        MAV_CMD_DO_SET_ROI_SYSID,
        MAV_CMD_START_RX_PAIR,
    ]
)
"""Accepted without an effect: for battery, camera, mount and receiver, which are not on board."""
_EXTERNAL_WIND = 43004  # MAV_CMD_EXTERNAL_WIND_ESTIMATE, which pymavlink does not have
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
def is_surface(m: Any) -> bool:
    return bool(m.kind in (MAV_TYPE_GROUND_ROVER, MAV_TYPE_SURFACE_BOAT))


@kernel
def _accept(accepted: bool, otherwise: int) -> int:
    return MAV_RESULT_ACCEPTED if accepted else otherwise


@kernel
def _calibrate(m: Any, command: int, p1: float) -> int:
    """Answers calibrations: on the ground they are accepted, and nothing is calibrated."""
    if command == MAV_CMD_PREFLIGHT_CALIBRATION:
        if m.armed:
            say(m, MAV_SEVERITY_NOTICE, CALIBRATION_ARMED, 0)
            return MAV_RESULT_FAILED
        if p1 != 1.0:  # not that of the gyros
            return NOT_HERE
        say(m, MAV_SEVERITY_INFO, INITIALISING, 0)
    elif command == MAV_CMD_DO_START_MAG_CAL and m.armed:
        say(m, MAV_SEVERITY_NOTICE, COMPASS_ARMED, 0)
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED


@kernel
def _of_wings(m: Any, command: int, p1: float) -> int:
    """Answers commands that ArduPlane knows and ArduRover does not, and those that the two answer differently."""
    surface = is_surface(m)
    if command == MAV_CMD_DO_SPRAYER:
        return _accept(surface, MAV_RESULT_FAILED)
    if command == MAV_CMD_DO_FENCE_ENABLE:  # without fences, a plane does not enable them
        return _accept(p1 == 0.0 or (p1 == 1.0 and surface), MAV_RESULT_FAILED)
    if command == MAV_CMD_DO_SET_REVERSE and surface:
        return _accept(p1 == 0.0, MAV_RESULT_FAILED)  # forwards only
    if surface:
        return NOT_HERE
    if command == MAV_CMD_DO_FLIGHTTERMINATION:
        say(m, MAV_SEVERITY_INFO, AFS_OFF, 0)
        return MAV_RESULT_FAILED
    if command == MAV_CMD_DO_PARACHUTE:  # none is on board
        return _accept(p1 == 0.0 or p1 == 1.0, MAV_RESULT_FAILED)
    return MAV_RESULT_FAILED if command in (MAV_CMD_DO_GO_AROUND, MAV_CMD_DO_MOTOR_TEST) else NOT_HERE


@kernel
def _of_settings(m: Any, command: int, p: tuple[float, float, float, float]) -> int:
    """Answers commands that change settings of parts that are not simulated."""
    if command == MAV_CMD_PREFLIGHT_STORAGE:
        if p[0] != 2.0:
            return NOT_HERE
        say(m, MAV_SEVERITY_WARNING, RESET, 0)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_CONTROL_HIGH_LATENCY:
        if p[0] != 0.0 and p[0] != 1.0:
            return MAV_RESULT_FAILED
        say(m, MAV_SEVERITY_NOTICE, LATENCY_ON if p[0] == 1.0 else LATENCY_OFF, 0)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_DO_FOLLOW:
        return _accept(p[0] > 0.0 and p[0] <= 255.0, MAV_RESULT_DENIED)
    if command == MAV_CMD_SET_EKF_SOURCE_SET:
        return _accept(p[0] in (1.0, 2.0, 3.0), MAV_RESULT_DENIED)
    if command == _EXTERNAL_WIND:
        return _accept(p[0] >= 0.0 and 0.0 <= p[2] <= 360.0, MAV_RESULT_DENIED)
    return NOT_HERE


@kernel
def _of_outputs(m: Any, command: int, p: tuple[float, float, float, float], t: float) -> int:
    if command == MAV_CMD_DO_SET_SERVO:
        return int(set_servo(m, p[0], p[1]))
    if command == MAV_CMD_DO_REPEAT_SERVO:
        return int(repeat_servo(m, p[0], p[1], p[2], p[3], t))
    if command == MAV_CMD_DO_SET_RELAY:
        return int(set_relay(m, p[0], p[1]))
    if command == MAV_CMD_DO_REPEAT_RELAY:
        return int(repeat_relay(m, p[0], p[1], p[2], t))
    return NOT_HERE


@kernel
def answer(m: Any, command: int, p: tuple[float, float, float, float], t: float) -> int:
    """Answers a command with its first four parameters; returns its MAV_RESULT, or NOT_HERE."""
    if command == MAV_CMD_GET_MESSAGE_INTERVAL:
        return _tell_interval(m, p[0])
    if command == MAV_CMD_RUN_PREARM_CHECKS:
        if m.kind != MAV_TYPE_QUADROTOR and not is_surface(m):
            return NOT_HERE
        return MAV_RESULT_TEMPORARILY_REJECTED if m.armed else MAV_RESULT_ACCEPTED
    for i in range(_ABSENT.size):
        if _ABSENT[i] == command:
            return MAV_RESULT_FAILED
    if m.kind == MAV_TYPE_QUADROTOR:
        return NOT_HERE
    if command == MAV_CMD_DO_SEND_BANNER:
        say(m, MAV_SEVERITY_INFO, ROVER if is_surface(m) else PLANE, 0)
        return MAV_RESULT_ACCEPTED
    for i in range(_IDLE.size):
        if _IDLE[i] == command and not (command == MAV_CMD_BATTERY_RESET and m.battery_voltage > 0.0):
            return MAV_RESULT_ACCEPTED
    if command in (MAV_CMD_PREFLIGHT_CALIBRATION, MAV_CMD_DO_START_MAG_CAL, MAV_CMD_FIXED_MAG_CAL_YAW):
        return _calibrate(m, command, p[0])
    result = _of_outputs(m, command, p, t)
    if result == NOT_HERE:
        result = _of_settings(m, command, p)
    return int(_of_wings(m, command, p[0]) if result == NOT_HERE else result)
