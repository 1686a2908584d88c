"""ArduCopter's status texts (STATUSTEXT), queued and sent after the acknowledgements.

Kernels over the autopilot's record `m`.

Source: ArduPilot's texts, as recorded from ArduCopter 4.7-dev or read in its source.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim.messages import STATUSTEXT, encode_statustext, put_statustext_text
from cosim_models.autopilot.link.links import LINKS, send

__all__ = [
    "TUNE_STARTED",
    "TUNE_STOPPED",
    "TUNE_SUCCESS",
    "TUNE_OVERRIDDEN",
    "TUNE_RESTORED",
    "TUNE_INCOMPLETE",
    "TUNE_UNLEVEL",
    "TUNE_SIZE_FAILED",
    "TUNE_D_FAILED",
    "TUNE_P_FAILED",
    "TUNE_ANGLE_FAILED",
    "TUNE_D_LEAST",
    "TUNE_PROGRESS",
    "TUNE_COMPLETE",
    "TUNE_RATES",
    "TUNE_ANGLES",
    "TUNE_SAVED",
    "TUNE_TESTING",
    "TUNE_TESTING_END",
    "say_all",
    "say_rest",
    "BAROMETER_CALIBRATED",
    "READY",
    "ELEVATION",
    "ACCELS_INCONSISTENT",
    "ACRO_TOO_HIGH",
    "AHRS_TYPE",
    "ARMING",
    "ARM_BATTERY_FAILSAFE",
    "ARM_CHARGE",
    "ARM_CHUTE",
    "ARM_CIRCLE",
    "ARM_MISSION",
    "ARM_NEEDS_POSITION",
    "ARM_POLYGON",
    "ARM_THROTTLE",
    "ARM_VOLTAGE",
    "ATTITUDE_BAD",
    "AUTOTUNE_NOT_ARMABLE",
    "AUTOTUNE_REFUSED",
    "AUTO_NOT_ARMABLE",
    "AUTO_REFUSED",
    "AUTO_RTL_END",
    "AUTO_RTL_NOT_ARMABLE",
    "AUTO_RTL_START",
    "ARM_STOPPED",
    "AUX_INVALID",
    "NO_CEILING",
    "NO_GROUND",
    "SWITCHES",
    "AVOID_NOT_ARMABLE",
    "AVOID_REFUSED",
    "AVOID_REFUSED_END",
    "BANNER",
    "BAROMETER_BEGINS",
    "BAROMETER_DONE",
    "BATTERY_CRITICAL",
    "BATTERY_DISARMING",
    "BATTERY_LANDING",
    "BATTERY_LOST",
    "BATTERY_LOW",
    "BRAKE_NOT_ARMABLE",
    "BRAKE_REFUSED",
    "CALIBRATION_ARMED",
    "CIRCLE_BREACHED",
    "CIRCLE_NOT_ARMABLE",
    "CIRCLE_REFUSED",
    "COMPASS_ARMED",
    "CRASHED",
    "CRITICAL",
    "DEBUG",
    "DISARMING",
    "DRIFT_REFUSED",
    "DRIFT_TOO_HIGH",
    "EKF_ALT_HOLD",
    "EKF_CLEARED",
    "EKF_FAILSAFE",
    "EKF_LANDS",
    "EKF_VARIANCE",
    "EMERGENCY",
    "ERROR",
    "FENCE_CLEARED",
    "FENCE_FETCH_INVALID",
    "FENCE_FETCH_OLD",
    "FENCE_INDEXED",
    "FLIP_NOT_ARMABLE",
    "FLIP_REFUSED",
    "FLOWHOLD_REFUSED",
    "FOLLOW_DISABLED",
    "FOLLOW_REFUSED",
    "FRAMES",
    "FRAME_UNKNOWN",
    "FTP_UNSUPPORTED",
    "GCS_AUTO",
    "GCS_CLEARED",
    "GCS_DISARMING",
    "GCS_LANDING",
    "GCS_LOST",
    "GCS_PILOT",
    "GLITCH",
    "GLITCH_CLEARED",
    "GUIDED_NOT_ARMABLE",
    "GUIDED_REFUSED",
    "HIGH_BREACHED",
    "HIGH_LATENCY_OFF",
    "HIGH_LATENCY_ON",
    "INFO",
    "INITIALISING",
    "LAND_NOT_ARMABLE",
    "LAND_SEQUENCE_END",
    "LAND_SEQUENCE_NONE",
    "LAND_SEQUENCE_START",
    "LOG_DISARM",
    "LOITER_REFUSED",
    "LOW_BREACHED",
    "MISSING_TAKEOFF",
    "MISSION_CHANGED",
    "MISSION_TEXTS",
    "MOTOR_TEST_DONE",
    "MOTOR_TEST_FLYING",
    "MOTOR_TEST_STARTS",
    "NOTICE",
    "NO_NUMBER",
    "NO_SMART_LANDS",
    "NO_SMART_RETURNS",
    "NO_SUCH_MESSAGE",
    "NO_SUCH_MODE",
    "PARACHUTE_LANDED",
    "PARAMETERS_RESET",
    "PAUSE_FAILED",
    "PLACE_LEVEL",
    "PLAN_RECEIVED",
    "PLAN_REJECTED",
    "POLYGON_BREACHED",
    "POSHOLD_REFUSED",
    "PREARM_ACCELS",
    "PREARM_AHRS_TYPE",
    "PREARM_ATTITUDE",
    "PREARM_BATTERY_FAILSAFE",
    "PREARM_CHARGE",
    "PREARM_CHUTE",
    "PREARM_CIRCLE",
    "PREARM_HOME",
    "PREARM_MISSION",
    "PREARM_NEEDS_POSITION",
    "PREARM_POLYGON",
    "PREARM_VOLTAGE",
    "RADIO_AUTO",
    "RADIO_CLEARED",
    "RADIO_DISARMING",
    "RADIO_GUIDED",
    "RADIO_LANDING",
    "RADIO_LOST",
    "RALLY_FETCH_FAILED",
    "RALLY_FETCH_OLD",
    "REACHED",
    "RECOVERY",
    "RESUME_FAILED",
    "ROUND_BEGINS",
    "RTL_NOT_ARMABLE",
    "RTL_REFUSED",
    "SERVO_IN_USE",
    "SMART_RTL_FULL",
    "SMART_RTL_LOST",
    "SMART_RTL_NOT_ARMABLE",
    "SMART_RTL_NO_POSITION",
    "SMART_RTL_REFUSED",
    "STABILIZE_REFUSED",
    "SYSTEMID_NO_AXIS",
    "SYSTEMID_REFUSED",
    "THROW_DETECTED",
    "THROW_HEIGHT",
    "THROW_REFUSED",
    "THROW_UNLIMITED",
    "THROW_UPRIGHT",
    "THROW_WAITING",
    "THRUST_LOST",
    "TRY_LAND",
    "TRY_RTL",
    "TURTLE_REFUSED",
    "USE_REQUEST_INT",
    "STOPPED_AIDING",
    "USING_GPS",
    "WAITING_FOR_HOME",
    "VIBRATION_OFF",
    "VIBRATION_ON",
    "WARNING",
    "WIND_UNCONNECTED",
    "ZIGZAG_MANUAL",
    "ZIGZAG_MOVING_A",
    "ZIGZAG_MOVING_B",
    "ZIGZAG_REFUSED",
    "ZIGZAG_STORED_A",
    "ZIGZAG_STORED_B",
    "YAW_IMBALANCE",
    "LANE_SWITCH",
    "PRIMARY_CHANGED",
    "say",
    "say_here",
    "say_with",
    "send_texts",
    "TERRAIN_LOST",
    "RTL_RESTARTS",
    "RTL_NO_TERRAIN",
    "RTL_NO_RANGE",
    "LAND_NO_TERRAIN",
    "ARM_TERRAIN",
    "PREARM_TERRAIN",
    "ARM_RTL_TERRAIN",
    "ARM_RTL_TERRAIN_END",
    "PREARM_RTL_TERRAIN",
    "PREARM_RTL_TERRAIN_END",
    "ARM_RTL_RANGE",
    "ARM_RTL_RANGE_END",
    "PREARM_RTL_RANGE",
    "PREARM_RTL_RANGE_END",
]

EMERGENCY, CRITICAL, ERROR, WARNING, NOTICE, INFO, DEBUG = 0, 2, 3, 4, 5, 6, 7  # MAV_SEVERITY
_EVERY_LINK = 2**LINKS - 1
NO_NUMBER = -1
"""Number argument of `say` for texts without a number."""

_TEXTS: list[bytes] = []
_CHUNKS: list[int] = []


def _text(text: bytes) -> int:
    _TEXTS.append(text)
    _CHUNKS.append(-1)
    return len(_TEXTS) - 1


def _texts(texts: Iterable[bytes]) -> int:
    """Registers several texts with consecutive numbers; returns the first."""
    return [_text(text) for text in texts][0]  # noqa: RUF015 - all of them


def _part(text: bytes, chunk: int) -> int:
    """Registers a part of a text that is longer than one STATUSTEXT."""
    number = _text(text)
    _CHUNKS[number] = chunk
    return number


ARMING = _text(b"Arming motors")
DISARMING = _text(b"Disarming motors")
ACCELS_INCONSISTENT = _text(b"Arm: Accels inconsistent")
ATTITUDE_BAD = _text(b"Arm: EKF attitude is bad")
AHRS_TYPE = _text(b"Arm: AHRS: not using configured AHRS type")
WAITING_FOR_HOME = _text(b"Arm: AHRS: waiting for home")
ARM_NEEDS_POSITION = _text(b"Arm: Need Position Estimate")
PREARM_NEEDS_POSITION = _text(b"PreArm: Need Position Estimate")
GUIDED_REFUSED = _text(b"Mode change to GUIDED failed: requires position")
LOITER_REFUSED = _text(b"Mode change to LOITER failed: requires position")
RTL_REFUSED = _text(b"Mode change to RTL failed: requires position")
NO_SUCH_MODE = _text(b"No such mode %")
NO_SUCH_MESSAGE = _text(b"No ap_message for mavlink id (%)")
AUTO_REFUSED = _text(b"Mode change to AUTO failed: init failed")
MISSING_TAKEOFF = _text(b"Auto: Missing Takeoff Cmd")
PLAN_RECEIVED = _text(b"Flight plan received")
REACHED = _text(b"Reached command #%")
BRAKE_REFUSED = _text(b"Mode change to BRAKE failed: requires position")
GCS_LOST = _text(b"GCS Failsafe")
GCS_CLEARED = _text(b"GCS Failsafe Cleared")
HIGH_BREACHED = _text(b"Max Alt fence breached")
CIRCLE_BREACHED = _text(b"Circle fence breached")
LOW_BREACHED = _text(b"Min Alt fence breached")
BATTERY_LOST = _text(b"Battery Failsafe")
BATTERY_DISARMING = _text(b"Battery Failsafe - Disarming")
BATTERY_LANDING = _text(b"Battery Failsafe - Continuing Landing")
BATTERY_LOW = _text(b"Battery 1 is low $V used % mAh")
BATTERY_CRITICAL = _text(b"Battery 1 is critical $V used % mAh")
ARM_VOLTAGE = _text(b"Arm: Battery 1 below minimum arming voltage")
ARM_CHARGE = _text(b"Arm: Battery 1 below minimum arming capacity")
POLYGON_BREACHED = _text(b"Polygon fence breached")
CIRCLE_REFUSED = _text(b"Mode change to CIRCLE failed: requires position")
STABILIZE_REFUSED = _text(b"Mode change to STABILIZE failed: throttle too high")
ARM_THROTTLE = _text(b"Arm: Throttle too high")
RADIO_LOST = _text(b"Radio Failsafe")
RADIO_CLEARED = _text(b"Radio Failsafe Cleared")
RADIO_DISARMING = _text(b"Radio Failsafe - Disarming")
RADIO_LANDING = _text(b"Radio Failsafe - Continuing Landing")
RADIO_AUTO = _text(b"Radio Failsafe - Continuing Auto")
RADIO_GUIDED = _text(b"Radio Failsafe - Continuing Guided Mode")
GCS_DISARMING = _text(b"GCS Failsafe - Disarming")
GCS_LANDING = _text(b"GCS Failsafe - Continuing Landing")
GCS_AUTO = _text(b"GCS Failsafe - Continuing Auto Mode")
GCS_PILOT = _text(b"GCS Failsafe - Continuing Pilot Control")
ARM_BATTERY_FAILSAFE = _text(b"Arm: Battery failsafe")
ARM_CIRCLE = _text(b"Arm: Vehicle breaching Circle fence")
ARM_POLYGON = _text(b"Arm: Vehicle breaching Polygon fence")
PREARM_CIRCLE = _text(b"PreArm: Vehicle breaching Circle fence")
PREARM_POLYGON = _text(b"PreArm: Vehicle breaching Polygon fence")
ARM_MISSION = _text(b"Arm: Mode requires mission")
AUTO_NOT_ARMABLE = _text(b"Arm: AUTO mode not armable")
BRAKE_NOT_ARMABLE = _text(b"Arm: BRAKE mode not armable")
CIRCLE_NOT_ARMABLE = _text(b"Arm: CIRCLE mode not armable")
GUIDED_NOT_ARMABLE = _text(b"Arm: GUIDED mode not armable")
LAND_NOT_ARMABLE = _text(b"Arm: LAND mode not armable")
RTL_NOT_ARMABLE = _text(b"Arm: RTL mode not armable")
# The same checks before arming, in the same order.
PREARM_ACCELS = _text(b"PreArm: Accels inconsistent")
PREARM_ATTITUDE = _text(b"PreArm: EKF attitude is bad")
PREARM_AHRS_TYPE = _text(b"PreArm: AHRS: not using configured AHRS type")
PREARM_HOME = _text(b"PreArm: AHRS: waiting for home")
PREARM_VOLTAGE = _text(b"PreArm: Battery 1 below minimum arming voltage")
PREARM_CHARGE = _text(b"PreArm: Battery 1 below minimum arming capacity")
PREARM_BATTERY_FAILSAFE = _text(b"PreArm: Battery failsafe")
PREARM_MISSION = _text(b"PreArm: Mode requires mission")
PAUSE_FAILED = _text(b"Failed to pause")
RESUME_FAILED = _text(b"Failed to resume")
LAND_SEQUENCE_NONE = _text(b"Unable to start landing sequence")
LAND_SEQUENCE_START = _part(b"Mode change to AUTO RTL failed: No landing sequenc", 0)
LAND_SEQUENCE_END = _part(b"e found", 1)
INITIALISING = _text(b"Initialising ArduPilot")
HIGH_LATENCY_ON = _text(b"High Latency enabled")
HIGH_LATENCY_OFF = _text(b"High Latency disabled")
PARAMETERS_RESET = _text(b"All parameters reset, reboot board")
SERVO_IN_USE = _text(b"ServoRelayEvent: Channel % is already in use")
MOTOR_TEST_STARTS = _text(b"starting motor test")
MOTOR_TEST_DONE = _text(b"finished motor test")
MOTOR_TEST_FLYING = _text(b"Motor Test: vehicle not landed")
CALIBRATION_ARMED = _text(b"Disarm to allow calibration")
COMPASS_ARMED = _text(b"Disarm to allow compass calibration")
PLACE_LEVEL = _text(b"Place vehicle level and press any key.")
AUX_INVALID = _text(b"Invalid channel option (%)")
NO_GROUND = _text(b"SurfaceTracking: no downward rangefinder")
NO_CEILING = _text(b"SurfaceTracking: no upward rangefinder")
ARM_STOPPED = _text(b"Arm: Motors Emergency Stopped")
_AUXILIARY = (
    b"SaveWaypoint",
    b"Fence",
    b"MissionReset",
    b"Relay1",
    b"MotorEStop",
    b"ClearWaypoint",
    b"SurfaceTracking",
)
SWITCHES = _texts(b"RC%: " + name + at for name in _AUXILIARY for at in (b" LOW", b" MIDDLE", b" HIGH"))
"""Three texts, of the positions low, middle and high, for each function."""
BANNER = _text(b"ArduCopter V4.7.0-dev (90700977)")
# Texts of frames: quad_plus, then by airframe.
FRAMES = _text(b"Frame: QUAD/PLUS")
_text(b"Frame: QUAD/X")
_text(b"Frame: HEXA/X")
_text(b"Frame: OCTA/X")
_text(b"Frame: Y6/Y6B")
FLIP_REFUSED = _text(b"Mode change to FLIP failed: init failed")
AUTOTUNE_NOT_ARMABLE = _text(b"Arm: AUTOTUNE mode not armable")
AUTOTUNE_REFUSED = _text(b"Mode change to AUTOTUNE failed: init failed")
THROW_REFUSED = _text(b"Mode change to THROW failed: init failed")
FLOWHOLD_REFUSED = _text(b"Mode change to FLOWHOLD failed: init failed")
FOLLOW_REFUSED = _text(b"Mode change to FOLLOW failed: init failed")
FOLLOW_DISABLED = _text(b"Set FOLL_ENABLE = 1")
SYSTEMID_REFUSED = _text(b"Mode change to SYSTEMID failed: init failed")
SYSTEMID_NO_AXIS = _text(b"No axis selected, SID_AXIS = 0")
TURTLE_REFUSED = _text(b"Mode change to TURTLE failed: init failed")
SMART_RTL_REFUSED = _text(b"Mode change to SMART_RTL failed: init failed")
SMART_RTL_NO_POSITION = _text(b"Mode change to SMART_RTL failed: requires position")
DRIFT_REFUSED = _text(b"Mode change to DRIFT failed: requires position")
POSHOLD_REFUSED = _text(b"Mode change to POSHOLD failed: requires position")
ZIGZAG_REFUSED = _text(b"Mode change to ZIGZAG failed: requires position")
ACRO_TOO_HIGH = _text(b"Mode change to ACRO failed: throttle too high")
DRIFT_TOO_HIGH = _text(b"Mode change to DRIFT failed: throttle too high")
FLIP_NOT_ARMABLE = _text(b"Arm: FLIP mode not armable")
SMART_RTL_NOT_ARMABLE = _text(b"Arm: SMART_RTL mode not armable")
AUTO_RTL_NOT_ARMABLE = _text(b"Arm: AUTO RTL mode not armable")
SMART_RTL_FULL = _text(b"SmartRTL deactivated: buffer full")
SMART_RTL_LOST = _text(b"SmartRTL deactivated: bad position")
THROW_WAITING = _text(b"waiting for throw")
THROW_DETECTED = _text(b"throw detected - spooling motors")
THROW_UNLIMITED = _text(b"throttle is unlimited - uprighting")
THROW_UPRIGHT = _text(b"uprighted - controlling height")
THROW_HEIGHT = _text(b"height achieved - controlling position")
ZIGZAG_STORED_A = _text(b"ZIGZAG: point A stored")
ZIGZAG_STORED_B = _text(b"ZIGZAG: point B stored")
ZIGZAG_MOVING_A = _text(b"ZIGZAG: moving to A")
ZIGZAG_MOVING_B = _text(b"ZIGZAG: moving to B")
ZIGZAG_MANUAL = _text(b"ZIGZAG: manual control")
AUTO_RTL_START = _part(b"Mode change to AUTO RTL failed: No return path or ", 0)
AUTO_RTL_END = _part(b"landing sequence found", 1)
AVOID_REFUSED = _part(b"Mode change to AVOID_ADSB failed: requires positio", 0)
AVOID_REFUSED_END = _part(b"n", 1)
AVOID_NOT_ARMABLE = _text(b"Arm: AVOID_ADSB mode not armable")
FRAME_UNKNOWN = _text(b"Unknown mavlink coordinate frame %")
FTP_UNSUPPORTED = _text(b"Unsupported FTP: %")
FENCE_INDEXED = _text(b"Fence Indexed OK")
PARACHUTE_LANDED = _text(b"Parachute: Landed")
BAROMETER_BEGINS = _text(b"Updating barometer calibration")
BAROMETER_DONE = _text(b"Barometer calibration complete")
ARM_CHUTE = _text(b"Arm: Chute has no relay")
PREARM_CHUTE = _text(b"PreArm: Chute has no relay")
LOG_DISARM = _text(b"Disarm for log download")
FENCE_CLEARED = _text(b"Fence breach cleared")
BAROMETER_CALIBRATED = _text(b"Barometer % calibration complete")
READY = _text(b"ArduPilot Ready")
ELEVATION = _text(b"Field Elevation Set: %m")
TERRAIN_LOST = _text(b"Failsafe: Terrain data missing")
RTL_RESTARTS = _text(b"Restarting RTL - Terrain data missing")
RTL_NO_TERRAIN = _text(b"RTL: no terrain data, using alt-above-home")
RTL_NO_RANGE = _text(b"RTL: rangefinder unhealthy, using alt-above-home")
LAND_NO_TERRAIN = _text(b"Land: no terrain data, using alt-above-home")
ARM_TERRAIN = _text(b"Arm: terrain disabled")
PREARM_TERRAIN = _text(b"PreArm: terrain disabled")
ARM_RTL_TERRAIN = _part(b"Arm: RTL_ALT_TYPE is above-terrain but no terrain ", 0)
ARM_RTL_TERRAIN_END = _part(b"data", 1)
PREARM_RTL_TERRAIN = _part(b"PreArm: RTL_ALT_TYPE is above-terrain but no terra", 0)
PREARM_RTL_TERRAIN_END = _part(b"in data", 1)
ARM_RTL_RANGE = _part(b"Arm: RTL_ALT_TYPE is above-terrain but RTL_ALT (in", 0)
ARM_RTL_RANGE_END = _part(b" cm) above RNGFND_MAX (in metres)", 1)
PREARM_RTL_RANGE = _part(b"PreArm: RTL_ALT_TYPE is above-terrain but RTL_ALT ", 0)
PREARM_RTL_RANGE_END = _part(b"(in cm) above RNGFND_MAX (in metres)", 1)
CRASHED = _text(b"Crash: Disarming: AngErr=%>30, Accel=~<3.0")
EKF_ALT_HOLD = _text(b"EKF Failsafe: changed to ALT_HOLD Mode")
EKF_FAILSAFE = _text(b"EKF Failsafe")
EKF_CLEARED = _text(b"EKF Failsafe Cleared")
EKF_LANDS = _text(b"EKF Failsafe: changed to LAND Mode")
EKF_VARIANCE = _text(b"EKF variance")
GLITCH = _text(b"GPS Glitch or Compass error")
GLITCH_CLEARED = _text(b"Glitch cleared")
VIBRATION_ON = _text(b"Vibration compensation ON")
VIBRATION_OFF = _text(b"Vibration compensation OFF")
NO_SMART_LANDS = _text(b"SmartRTL Unavailable, Using Land Mode")
NO_SMART_RETURNS = _text(b"SmartRTL Unavailable, Trying RTL Mode")
RECOVERY = _text(b"Manual recovery started")
WIND_UNCONNECTED = _text(b"SIM_WIND: added_wind is not connected")
THRUST_LOST = _text(b"Potential Thrust Loss (%)")
LANE_SWITCH = _text(b"EKF3 lane switch %")
PRIMARY_CHANGED = _text(b"EKF primary changed:%")
YAW_IMBALANCE = _text(b"Yaw Imbalance %|")
TRY_LAND = _text(b"Trying Land Mode")
TRY_RTL = _text(b"Trying RTL Mode")
USING_GPS = _text(b"EKF3 IMU% is using GPS")
STOPPED_AIDING = _text(b"EKF3 IMU% stopped aiding")
MISSION_CHANGED = _text(b"Auto mission changed, restarted command")
USE_REQUEST_INT = _text(b"got MISSION_REQUEST; use MISSION_REQUEST_INT!")
PLAN_REJECTED = _text(b"Flight plan update rejected")
FENCE_FETCH_OLD = _text(b"Received message (FENCE_FETCH_POINT) is deprecated")
FENCE_FETCH_INVALID = _text(b"Invalid fence point, index past total(% >= &)")
RALLY_FETCH_OLD = _text(b"Received message (RALLY_FETCH_POINT) is deprecated")
RALLY_FETCH_FAILED = _text(b"Failed to get rally point")
# Texts of mission commands that begin, in the order of commands.
MISSION_TEXTS = _text(b"Mission: % WP")
_text(b"Mission: % LoitUnlim")
_text(b"Mission: % LoitTime")
_text(b"Mission: % RTL")
_text(b"Mission: % Land")
_text(b"Mission: % Takeoff")
_text(b"Mission: % Delay")
_text(b"Mission: % CondDelay")
_text(b"Mission: % CondYaw")
_text(b"Mission: % ChangeSpeed")
_text(b"Mission: % LoitTurns")
_text(b"Mission: % CondDist")
_text(b"Mission: % SetHome")
_text(b"Mission: % SetRelay")
_text(b"Mission: % RepeatRelay")
_text(b"Mission: % SetServo")
_text(b"Mission: % RepeatServo")
_text(b"Mission: % LandStart")
_text(b"Mission: % SetROI")
_text(b"Mission: % SetROI")
_text(b"Mission: % SetROI")
_text(b"Mission: % DigiCamCfg")
_text(b"Mission: % DigiCamCtrl")
_text(b"Mission: % MountControl")
_text(b"Mission: % SetCamTrigDst")
_text(b"Mission: % FenceEnable")
_text(b"Mission: % Parachute")
_text(b"Mission: % Gripper")
_text(b"Mission: % Sprayer")
_text(b"Mission: % GuidedLimits")
_text(b"Mission: % Tag")
_text(b"Mission: % PitchYaw")
_text(b"Mission: % ImageStartCapture")
_text(b"Mission: % ImageStopCapture")
_text(b"Mission: % VideoStartCapture")
_text(b"Mission: % VideoStopCapture")
_text(b"Mission: % Winch")
_text(b"Mission: % LoitAltitude")
_text(b"Mission: % SplineWP")
ROUND_BEGINS = _text(b"Mission: starting circle %/&")

TUNE_STARTED = _text(b"AutoTune: Started")
TUNE_STOPPED = _text(b"AutoTune: Stopped")
TUNE_SUCCESS = _text(b"AutoTune: Success")
TUNE_OVERRIDDEN = _text(b"AutoTune: pilot overrides active")
TUNE_RESTORED = _text(b"AutoTune: original gains restored")
TUNE_INCOMPLETE = _text(b"AutoTune: must be complete to test gains")
TUNE_UNLEVEL = _text(b"AutoTune: Failed to level, please tune manually")
TUNE_SIZE_FAILED = _text(b"AutoTune: Twitch Size Determination Failed")
TUNE_D_FAILED = _text(b"AutoTune: Rate D Gain Determination Failed")
TUNE_P_FAILED = _text(b"AutoTune: Rate P Gain Determination Failed")
TUNE_ANGLE_FAILED = _text(b"AutoTune: Angle P Gain Determination Failed")
TUNE_D_LEAST = _text(b"AutoTune: Min Rate D limit reached")
# Texts by axis, and of the progress by kind of twitch.
_AXES = (b"Roll", b"Pitch", b"Yaw(E)", b"Yaw(D)")
_KINDS = (b"Rate D Up", b"Rate D Down", b"Rate P Up", b"Angle P Down", b"Angle P Up")
TUNE_PROGRESS = _texts(b"AutoTune: " + axis + b" " + kind + b" %|" for axis in _AXES for kind in _KINDS)
TUNE_COMPLETE = _texts(b"AutoTune: " + axis + b" complete" for axis in _AXES)
TUNE_RATES = _texts(b"AutoTune: " + axis + b" Rate: P:^, I:`, D:@" for axis in _AXES)
TUNE_ANGLES = _texts(b"AutoTune: " + axis + b" Angle P:^, Max Accel:&" for axis in _AXES)
# Texts that name axes, by their bits; the second may be longer than one STATUSTEXT.
_NAMED = [
    b"".join(name for i, name in enumerate((b"Roll ", b"Pitch ", b"Yaw(E)", b"Yaw(D)")) if bits >> i & 1)
    for bits in range(1 << len(_AXES))
]
TUNE_SAVED = _texts(b"AutoTune: Saved gains for " + names for names in _NAMED)
_TESTED = [b"AutoTune: Pilot Testing gains for " + names for names in _NAMED]
TUNE_TESTING = _texts(text[:50] for text in _TESTED)
TUNE_TESTING_END = _texts(text[50:] for text in _TESTED)
for _i, _content in enumerate(_TESTED):
    if len(_content) > 50:
        _CHUNKS[TUNE_TESTING + _i], _CHUNKS[TUNE_TESTING_END + _i] = 0, 1

_TEXT_BYTES = np.zeros((len(_TEXTS), 50), dtype=np.uint8)
for _i, _content in enumerate(_TEXTS):
    _TEXT_BYTES[_i, : len(_content)] = np.frombuffer(_content, dtype=np.uint8)
_TEXT_LENGTHS = np.array([len(text) for text in _TEXTS], dtype=np.int64)
_CHUNK_OF = np.array(_CHUNKS, dtype=np.int64)
_CHUNK_ID = 1

_PLACE, _PLACE_OF_HUNDREDTHS, _PLACE_OF_SECOND, _PLACE_OF_TENTHS, _POINT = 37, 36, 38, 126, 46  # % $ & ~ .
_PLACE_OF_THOUSANDTHS, _SECOND_OF_THOUSANDTHS, _THIRD_OF_MYRIADTHS, _PERCENT = 94, 96, 64, 124  # ^ ` @ |


@kernel
def say(m: Any, severity: int, text: int, number: int) -> None:
    """Queues a STATUSTEXT, with `number` substituted for its "%". A full queue drops it."""
    say_with(m, severity, text, number, 0)


@kernel
def say_with(m: Any, severity: int, text: int, number: int, second: int) -> None:
    """Like `say`, with a second value substituted for "&" (integer) or "$" (two decimals)."""
    n = m.text_count
    if n < m.text_queue.shape[0]:
        m.text_queue[n, 0] = severity
        m.text_queue[n, 1] = text
        m.text_queue[n, 2] = number
        m.text_queue[n, 3] = second
        m.text_queue[n, 4] = _EVERY_LINK
        m.text_count = n + 1


@kernel
def say_all(m: Any, severity: int, text: int, number: int, second: int, third: int) -> None:
    """Like `say_with`, for texts with "^" (number, 1/1000), "`" (second, 1/1000) and "@" (third, 1/10000)."""
    n = m.text_count
    say_with(m, severity, text, number, second)
    if m.text_count > n:
        m.text_queue[n, 5] = third


@kernel
def say_rest(m: Any, severity: int, text: int) -> None:
    """Like `say` for the rest of a text that is too long for one STATUSTEXT, if there is any."""
    if _TEXT_LENGTHS[text] > 0:
        say(m, severity, text, NO_NUMBER)


@kernel
def say_here(m: Any, severity: int, text: int, number: int) -> None:
    """Like `say`, but only on m.link."""
    n = m.text_count
    say_with(m, severity, text, number, 0)
    if m.text_count > n:
        m.text_queue[n, 4] = 1 << m.link


@kernel
def send_texts(m: Any) -> None:
    """Sends the queued texts after the acknowledgements, as ArduCopter does; texts that do not fit wait."""
    for link in range(LINKS):
        m.link = link
        for row in range(m.text_count):
            waiting = m.text_queue[row, 4]
            if (waiting >> link) & 1 != 0:
                if not _send_text(m, row):
                    break
                m.text_queue[row, 4] = waiting - (1 << link)
    sent = 0
    while sent < m.text_count and m.text_queue[sent, 4] == 0:
        sent += 1
    if sent > 0:
        for i in range(sent, m.text_count):
            for k in range(m.text_queue.shape[1]):
                m.text_queue[i - sent, k] = m.text_queue[i, k]
        m.text_count -= sent


@kernel
def _put_number(m: Any, at: int, number: int, least: int) -> int:
    """Writes a number with at least `least` digits at `at`; returns the number of characters."""
    digits = 1
    rest = number
    while rest >= 10:
        rest //= 10
        digits += 1
    digits = max(digits, least)
    rest = number
    for k in range(digits):
        put_statustext_text(m.payload, at + digits - 1 - k, 48 + rest % 10)
        rest //= 10
    return digits


@kernel
def _put_decimals(m: Any, at: int, value: int, scale: int, digits: int) -> int:
    """Writes `value` / `scale` with `digits` decimals at `at`; returns the number of characters."""
    whole = _put_number(m, at, value // scale, 1)
    put_statustext_text(m.payload, at + whole, _POINT)
    return whole + 1 + _put_number(m, at + whole + 1, value % scale, digits)


@kernel
def _send_text(m: Any, row: int) -> bool:
    """Sends the text of a row of the queue, with its numbers."""
    text = m.text_queue[row, 1]
    chunk = int(_CHUNK_OF[text])
    encode_statustext(m.payload, m.text_queue[row, 0], _CHUNK_ID if chunk >= 0 else 0, max(chunk, 0))
    at = 0
    for i in range(_TEXT_LENGTHS[text]):
        byte = _TEXT_BYTES[text, i]
        if byte == _PLACE:
            at += _put_number(m, at, m.text_queue[row, 2], 1)
        elif byte == _PLACE_OF_SECOND:
            at += _put_number(m, at, m.text_queue[row, 3], 1)
        elif byte == _PLACE_OF_HUNDREDTHS:
            at += _put_decimals(m, at, m.text_queue[row, 3], 100, 2)
        elif byte == _PLACE_OF_TENTHS:
            at += _put_decimals(m, at, m.text_queue[row, 3], 10, 1)
        elif byte == _PLACE_OF_THOUSANDTHS:
            at += _put_decimals(m, at, m.text_queue[row, 2], 1000, 3)
        elif byte == _SECOND_OF_THOUSANDTHS:
            at += _put_decimals(m, at, m.text_queue[row, 3], 1000, 3)
        elif byte == _THIRD_OF_MYRIADTHS:
            at += _put_decimals(m, at, m.text_queue[row, 5], 10000, 4)
        else:
            put_statustext_text(m.payload, at, _PLACE if byte == _PERCENT else byte)
            at += 1
    return send(m, STATUSTEXT)
