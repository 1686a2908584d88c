"""Commands that need few words: home, regions of interest, outputs, switches, calibrations, and what is not on board.

`obey` answers them with ArduCopter's results. Cameras, mounts, winches and grippers are not on board, as in a simulated
ArduCopter by default; the results say so in ArduCopter's way. Sensors need no calibration here: its commands are
answered and have no effect. Kernels over the autopilot's record `m`.

Sources: MAVLink common.xml and ardupilotmega.xml; ArduPilot, GCS_Common, GCS_MAVLink_Copter, RC_Channel_Copter,
AP_Camera and AP_Mount; answers recorded from ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import (
    MAV_CMD_AIRFRAME_CONFIGURATION,
    MAV_CMD_BATTERY_RESET,
    MAV_CMD_CONTROL_HIGH_LATENCY,
    MAV_CMD_DO_ACCEPT_MAG_CAL,
    MAV_CMD_DO_AUX_FUNCTION,
    MAV_CMD_DO_CANCEL_MAG_CAL,
    MAV_CMD_DO_DIGICAM_CONFIGURE,
    MAV_CMD_DO_DIGICAM_CONTROL,
    MAV_CMD_DO_FLIGHTTERMINATION,
    MAV_CMD_DO_FOLLOW,
    MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    MAV_CMD_DO_GRIPPER,
    MAV_CMD_DO_JUMP_TAG,
    MAV_CMD_DO_LAND_START,
    MAV_CMD_DO_MOTOR_TEST,
    MAV_CMD_DO_MOUNT_CONFIGURE,
    MAV_CMD_DO_MOUNT_CONTROL,
    MAV_CMD_DO_PARACHUTE,
    MAV_CMD_DO_PAUSE_CONTINUE,
    MAV_CMD_DO_REPEAT_RELAY,
    MAV_CMD_DO_REPEAT_SERVO,
    MAV_CMD_DO_RETURN_PATH_START,
    MAV_CMD_DO_SEND_BANNER,
    MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    MAV_CMD_DO_SET_HOME,
    MAV_CMD_DO_SET_RELAY,
    MAV_CMD_DO_SET_ROI,
    MAV_CMD_DO_SET_ROI_LOCATION,
    MAV_CMD_DO_SET_ROI_NONE,
    MAV_CMD_DO_SET_ROI_SYSID,
    MAV_CMD_DO_SET_SERVO,
    MAV_CMD_DO_SPRAYER,
    MAV_CMD_DO_START_MAG_CAL,
    MAV_CMD_DO_WINCH,
    MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
    MAV_CMD_FIXED_MAG_CAL_YAW,
    MAV_CMD_IMAGE_START_CAPTURE,
    MAV_CMD_IMAGE_STOP_CAPTURE,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_PREFLIGHT_CALIBRATION,
    MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
    MAV_CMD_PREFLIGHT_STORAGE,
    MAV_CMD_RUN_PREARM_CHECKS,
    MAV_CMD_SCRIPTING,
    MAV_CMD_SET_CAMERA_FOCUS,
    MAV_CMD_SET_EKF_SOURCE_SET,
    MAV_CMD_SOLO_BTN_FLY_CLICK,
    MAV_CMD_SOLO_BTN_FLY_HOLD,
    MAV_CMD_SOLO_BTN_PAUSE_CLICK,
    MAV_CMD_START_RX_PAIR,
    MAV_CMD_STORAGE_FORMAT,
    MAV_CMD_VIDEO_START_CAPTURE,
    MAV_CMD_VIDEO_STOP_CAPTURE,
    MAV_RESULT_ACCEPTED,
    MAV_RESULT_DENIED,
    MAV_RESULT_FAILED,
    MAV_RESULT_TEMPORARILY_REJECTED,
    MAV_RESULT_UNSUPPORTED,
)
from cosim_models.autopilot.commander.auxiliary import use_switch
from cosim_models.autopilot.commander.battery import reset_battery
from cosim_models.autopilot.commander.mode_requests import (
    arm_checked,
    change_mode,
    check_arming,
    start_landing_sequence,
)
from cosim_models.autopilot.commander.readiness import home_ready
from cosim_models.autopilot.commander.reboot import ask_to_reboot
from cosim_models.autopilot.flight.auto import may_pause
from cosim_models.autopilot.flight.outputs import repeat_relay, repeat_servo, set_relay, set_servo, test_motors
from cosim_models.autopilot.flight.state import disarm
from cosim_models.autopilot.flight.yaw import default_nose, look_at
from cosim_models.autopilot.link.statustext import (
    BANNER,
    BAROMETER_BEGINS,
    BAROMETER_DONE,
    CALIBRATION_ARMED,
    COMPASS_ARMED,
    FRAMES,
    HIGH_LATENCY_OFF,
    HIGH_LATENCY_ON,
    INFO,
    INITIALISING,
    LAND_SEQUENCE_END,
    LAND_SEQUENCE_START,
    NO_NUMBER,
    NOTICE,
    PARACHUTE_LANDED,
    PARAMETERS_RESET,
    PAUSE_FAILED,
    PLACE_LEVEL,
    RESUME_FAILED,
    WARNING,
    say,
    say_here,
)
from cosim_models.autopilot.mavlink.targets import altitude_reference, is_place, locate
from cosim_models.autopilot.record.modes import (
    ALT_HOLD,
    AUTO,
    BRAKE,
    GUIDED,
    LAND,
    LOITER,
)

__all__ = ["obey", "send_banner"]

_BETWEEN_LEVELS = 5.0  # s between calibrations of the accelerometer
_FARTHEST = 50000.0  # m between home and the origin, vertically
_EXTERNAL_WIND = 43004  # MAV_CMD_EXTERNAL_WIND_ESTIMATE, which pymavlink does not have
_FAILED_WITHOUT = np.array(
    (
        MAV_CMD_DO_MOUNT_CONFIGURE,
        MAV_CMD_DO_MOUNT_CONTROL,
        MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        MAV_CMD_IMAGE_START_CAPTURE,
        MAV_CMD_VIDEO_START_CAPTURE,
        MAV_CMD_VIDEO_STOP_CAPTURE,
        MAV_CMD_SET_CAMERA_FOCUS,
        MAV_CMD_DO_WINCH,
        MAV_CMD_DO_GRIPPER,
        MAV_CMD_DO_JUMP_TAG,
        MAV_CMD_DO_RETURN_PATH_START,
        MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
    ),
    dtype=np.int64,
)
"""Commands that fail without the device, tag or sensor that they concern."""
_ACCEPTED_WITHOUT = np.array(
    (
        MAV_CMD_DO_DIGICAM_CONFIGURE,
        MAV_CMD_DO_DIGICAM_CONTROL,
        MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        MAV_CMD_DO_SET_ROI_SYSID,
        MAV_CMD_FIXED_MAG_CAL_YAW,
        MAV_CMD_START_RX_PAIR,
        MAV_CMD_AIRFRAME_CONFIGURATION,
    ),
    dtype=np.int64,
)
"""Commands that ArduCopter accepts without the device that they concern; they have no effect."""

# Auxiliary functions (RCn_OPTION) that change the mode, and the modes.


# ---- home and regions of interest ----------------------------------------------------------------------------------


@kernel
def _set_home(m: Any, here: float, frame: int, x: int, y: int, z: float, t: float) -> int:
    """Handles DO_SET_HOME: the current position (here 1, or no position), or x, y [degE7] and z [m] in a frame."""
    n, e, u = m.position_neu[0], m.position_neu[1], m.position_neu[2]
    if here != 1.0 and not (x == 0 and y == 0):
        if here != 0.0:
            return MAV_RESULT_FAILED
        reference = altitude_reference(m, frame)
        if reference < 0 or not math.isfinite(z):
            return MAV_RESULT_DENIED
        if not is_place(x, y):
            return MAV_RESULT_FAILED
        n, e, u = locate(m, x, y, z, reference)
    if not home_ready(m, t) or abs(u) >= _FARTHEST:
        return MAV_RESULT_FAILED
    m.home_neu[0], m.home_neu[1], m.home_neu[2] = n, e, u
    m.home_locked = True
    m.told_home = False
    return MAV_RESULT_ACCEPTED


@kernel
def _look(m: Any, frame: int, x: int, y: int, z: float) -> int:
    """Handles DO_SET_ROI and DO_SET_ROI_LOCATION: the nose points there; 0, 0, 0 ends it."""
    reference = altitude_reference(m, frame)
    if reference < 0 or not math.isfinite(z):
        return MAV_RESULT_DENIED
    if not is_place(x, y):
        return MAV_RESULT_FAILED
    if x == 0 and y == 0 and z == 0.0:
        default_nose(m)
    else:
        n, e, _ = locate(m, x, y, z, reference)
        look_at(m, n, e)
    return MAV_RESULT_ACCEPTED


# ---- flight --------------------------------------------------------------------------------------------------------


@kernel
def _pause(m: Any, what: float) -> int:
    """Handles DO_PAUSE_CONTINUE: 0 pauses, 1 continues."""
    if not 0.0 <= what < 2.0:
        return MAV_RESULT_DENIED
    pauses = what < 1.0
    if m.mode == GUIDED or (m.mode == AUTO and (not pauses or may_pause(m))):
        m.paused = pauses
        return MAV_RESULT_ACCEPTED
    say_here(m, INFO, PAUSE_FAILED if pauses else RESUME_FAILED, NO_NUMBER)
    return MAV_RESULT_FAILED


@kernel
def _press(m: Any, command: int, height: float, t: float) -> int:
    """Handles the buttons of the Solo: click "fly" for LOITER, hold it to arm, take off or land, click "pause"."""
    if m.radio_lost:
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_SOLO_BTN_FLY_CLICK:
        if change_mode(m, LOITER, t) != MAV_RESULT_ACCEPTED:
            change_mode(m, ALT_HOLD, t)
    elif command == MAV_CMD_SOLO_BTN_FLY_HOLD:
        if not m.armed:
            arm_checked(m, False, False, t)
        elif not m.on_ground:
            change_mode(m, LAND, t)
        elif change_mode(m, LOITER, t) == MAV_RESULT_ACCEPTED:
            take_off_by_pilot(m, height)
    elif m.armed:
        if m.on_ground:
            disarm(m)
        elif (height == 0.0 or m.mode != GUIDED) and change_mode(m, BRAKE, t) != MAV_RESULT_ACCEPTED:
            change_mode(m, ALT_HOLD, t)
    return MAV_RESULT_ACCEPTED


@kernel
def take_off_by_pilot(m: Any, height: float) -> bool:
    """Takes off in LOITER or ALT_HOLD to `height` [m above home]; returns False if that is not possible."""
    if not m.armed or not m.on_ground or not m.home_neu[2] + height > m.position_neu[2]:
        return False
    m.pilot_takeoff = True
    m.takeoff_from = m.desired_position_neu[2]
    m.takeoff_to = m.home_neu[2] + height
    m.auto_armed = True
    return True


# ---- the station ---------------------------------------------------------------------------------------------------


@kernel
def send_banner(m: Any) -> None:
    """Sends the firmware's name and the frame on the link of the request."""
    say_here(m, INFO, BANNER, NO_NUMBER)
    frame = m.airframe if 1 <= m.airframe <= 4 else 0
    say_here(m, INFO, FRAMES + frame, NO_NUMBER)


@kernel
def _calibrate(m: Any, p1: float, p3: float, x: int, t: float) -> int:
    """Handles PREFLIGHT_CALIBRATION: the sensors are perfect."""
    if m.armed:
        say_here(m, NOTICE, CALIBRATION_ARMED, NO_NUMBER)
        return MAV_RESULT_FAILED
    if p3 == 1.0 and p1 != 1.0:
        say(m, INFO, BAROMETER_BEGINS, NO_NUMBER)
        say(m, INFO, BAROMETER_DONE, NO_NUMBER)
    elif p1 != 1.0 and x in (2, 4):
        if t < m.levelled_at + _BETWEEN_LEVELS:
            return MAV_RESULT_TEMPORARILY_REJECTED
        m.levelled_at = t
    if p1 == 1.0:
        say(m, INFO, INITIALISING, NO_NUMBER)  # while the gyros are calibrated, ArduCopter's main loop waits
    if p1 == 1.0 or p3 == 1.0 or x in (2, 4, 76):
        return MAV_RESULT_ACCEPTED
    if x == 1:
        say(m, WARNING, PLACE_LEVEL, NO_NUMBER)
        return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED


@kernel
def _calibrate_compass(m: Any, command: int, mask: float) -> int:
    if command == MAV_CMD_DO_START_MAG_CAL and m.armed:
        say(m, NOTICE, COMPASS_ARMED, NO_NUMBER)
        return MAV_RESULT_FAILED
    if not 0.0 <= mask <= 255.0 or command == MAV_CMD_DO_ACCEPT_MAG_CAL:
        return MAV_RESULT_FAILED
    return MAV_RESULT_ACCEPTED


@kernel
def _use_parachute(m: Any, what: float) -> int:
    """Handles DO_PARACHUTE: 0 off, 1 on, 2 release; there is none, but releases on the ground are refused in words."""
    if not 0.0 <= what < 3.0:
        return MAV_RESULT_FAILED
    if what >= 2.0:
        if m.parachute_on and m.on_ground:
            say(m, INFO, PARACHUTE_LANDED, NO_NUMBER)
    else:
        m.parachute_on = what >= 1.0
    return MAV_RESULT_ACCEPTED


@kernel
def _tell_wind(m: Any, speed: float, direction: float) -> int:
    """Handles EXTERNAL_WIND_ESTIMATE: speed [m/s] and direction from which it blows [deg]."""
    if not (0.0 <= speed < math.inf and 0.0 <= direction <= 360.0):
        return MAV_RESULT_DENIED
    m.wind_ne[0] = -speed * math.cos(math.radians(direction))
    m.wind_ne[1] = -speed * math.sin(math.radians(direction))
    return MAV_RESULT_ACCEPTED


@kernel
def _obey_station(m: Any, command: int, p1: float, p2: float, p3: float, x: int, y: int, t: float) -> int:
    """Handles commands on the vehicle's equipment; returns a MAV_RESULT."""
    if command == MAV_CMD_DO_SEND_BANNER:
        send_banner(m)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_RUN_PREARM_CHECKS:
        if m.armed:
            return MAV_RESULT_TEMPORARILY_REJECTED
        check_arming(m, True, t)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_BATTERY_RESET:
        return MAV_RESULT_ACCEPTED if reset_battery(m, p1, p2, t) else MAV_RESULT_FAILED
    if command == MAV_CMD_CONTROL_HIGH_LATENCY:
        say(m, NOTICE, HIGH_LATENCY_ON if p1 == 1.0 else HIGH_LATENCY_OFF, NO_NUMBER)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
        return ask_to_reboot(m, p1, y, t)
    if command == MAV_CMD_PREFLIGHT_STORAGE:
        if p1 != 2.0:
            return MAV_RESULT_UNSUPPORTED
        say_here(m, WARNING, PARAMETERS_RESET, NO_NUMBER)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_PREFLIGHT_CALIBRATION:
        return _calibrate(m, p1, p3, x, t)
    if command in (MAV_CMD_DO_START_MAG_CAL, MAV_CMD_DO_ACCEPT_MAG_CAL, MAV_CMD_DO_CANCEL_MAG_CAL):
        return _calibrate_compass(m, command, p1)
    if command == MAV_CMD_SET_EKF_SOURCE_SET:
        return MAV_RESULT_ACCEPTED if 1.0 <= p1 < 4.0 else MAV_RESULT_DENIED
    if command == _EXTERNAL_WIND:
        return _tell_wind(m, p1, p3)
    if command == MAV_CMD_DO_FOLLOW:
        return MAV_RESULT_ACCEPTED if 0.0 < p1 <= 255.0 else MAV_RESULT_DENIED
    if command == MAV_CMD_DO_PARACHUTE:
        return _use_parachute(m, p1)
    if command == MAV_CMD_SCRIPTING:
        return (
            MAV_RESULT_ACCEPTED if 2.0 <= p1 < 4.0 else MAV_RESULT_DENIED if 0.0 <= p1 < 2.0 else MAV_RESULT_UNSUPPORTED
        )
    if command == MAV_CMD_STORAGE_FORMAT:
        return MAV_RESULT_FAILED if p1 == 1.0 and p2 == 1.0 else MAV_RESULT_UNSUPPORTED
    if command == MAV_CMD_DO_SPRAYER:
        return MAV_RESULT_ACCEPTED if p1 == 0.0 or p1 == 1.0 else MAV_RESULT_FAILED
    if command == MAV_CMD_IMAGE_STOP_CAPTURE and p1 == 0.0:
        return MAV_RESULT_ACCEPTED
    for i in range(_FAILED_WITHOUT.shape[0]):
        if _FAILED_WITHOUT[i] == command:
            return MAV_RESULT_FAILED
    for i in range(_ACCEPTED_WITHOUT.shape[0]):
        if _ACCEPTED_WITHOUT[i] == command:
            return MAV_RESULT_ACCEPTED
    return MAV_RESULT_UNSUPPORTED


@kernel
def obey(
    m: Any, command: int, frame: int, p1: float, p2: float, p3: float, p4: float, x: int, y: int, z: float, t: float
) -> int:
    """Obeys a command with the fields of COMMAND_INT; returns a MAV_RESULT, MAV_RESULT_UNSUPPORTED if it is none of
    these.
    """
    if command == MAV_CMD_DO_SET_HOME:
        return _set_home(m, p1, frame, x, y, z, t)
    if command in (MAV_CMD_DO_SET_ROI_LOCATION, MAV_CMD_DO_SET_ROI):
        return _look(m, frame, x, y, z)
    if command == MAV_CMD_DO_SET_ROI_NONE:
        default_nose(m)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_DO_PAUSE_CONTINUE:
        return _pause(m, p1)
    if command == MAV_CMD_DO_SET_SERVO:
        return set_servo(m, p1, p2)
    if command == MAV_CMD_DO_SET_RELAY:
        return set_relay(m, p1, p2)
    if command == MAV_CMD_DO_REPEAT_SERVO:
        return repeat_servo(m, p1, p2, p3, p4, t)
    if command == MAV_CMD_DO_REPEAT_RELAY:
        return repeat_relay(m, p1, p2, p3, t)
    if command == MAV_CMD_DO_MOTOR_TEST:
        return test_motors(m, p1, p2, p3, p4, float(x), t)
    if command == MAV_CMD_DO_AUX_FUNCTION:
        return use_switch(m, p1, p2, t)
    if command == MAV_CMD_DO_FLIGHTTERMINATION:
        if not p1 > 0.5:
            return MAV_RESULT_FAILED
        disarm(m)
        return MAV_RESULT_ACCEPTED
    if command == MAV_CMD_NAV_LOITER_UNLIM:
        return change_mode(m, LOITER, t)
    if command == MAV_CMD_DO_LAND_START:
        if start_landing_sequence(m, t):
            return MAV_RESULT_ACCEPTED
        say(m, WARNING, LAND_SEQUENCE_START, NO_NUMBER)
        say(m, WARNING, LAND_SEQUENCE_END, NO_NUMBER)
        return MAV_RESULT_FAILED
    if command in (MAV_CMD_SOLO_BTN_FLY_CLICK, MAV_CMD_SOLO_BTN_FLY_HOLD, MAV_CMD_SOLO_BTN_PAUSE_CLICK):
        return _press(m, command, p1, t)
    return _obey_station(m, command, p1, p2, p3, x, y, t)
