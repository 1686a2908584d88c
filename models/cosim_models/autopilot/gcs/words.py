"""STATUSTEXTs of the small autopilots, in the words of ArduRover and ArduPlane.

A text is sent at once. Those of failed checks begin with "Arm: ", or with "PreArm: " while m.checks_told is ASKED; they
are not sent while it is SILENT. Source: the texts of ArduPilot 4.7-dev, as heard from its programs.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cosim.kernel import kernel
from cosim.messages import STATUSTEXT, encode_statustext, put_statustext_text
from cosim_models.autopilot.gcs.modes import firmware_of
from cosim_models.autopilot.gcs.sending import send
from cosim_models.autopilot.link.available_modes import letter_of_mode, row_of_mode

__all__ = [
    "ABOVE",
    "ABOVE_TAKEOFF",
    "AFS_OFF",
    "AIRSPEED_STARTED",
    "APPROACH",
    "ARMED",
    "ARM_AIRSPEED",
    "ARM_AHRS",
    "ARM_BATTERY",
    "ARM_GPS",
    "ARM_HOME",
    "ARM_LANDING",
    "ARM_LEAN",
    "ARM_MISSION",
    "ARM_MODE",
    "ARM_NO_LANDING",
    "ARM_NO_RETURN",
    "ARM_NO_TAKEOFF",
    "ARM_NOT_LIFTED",
    "ARM_NOT_TAKEOFF",
    "ARM_PITCH_MAX",
    "ARM_PITCH_MIN",
    "ARM_RADIO",
    "ARM_RADIO_LOST",
    "ARM_ROLL",
    "ARM_SPIN",
    "ARM_STOPPED",
    "ARM_THIS_MODE",
    "ARM_TIMEOUTS",
    "ASKED",
    "ASSISTANCE",
    "AUTO_DISARMED",
    "AUTO_GOES_ON",
    "BAROMETER",
    "BATTERY_ALARM",
    "BRAKED",
    "BRAKES",
    "CALIBRATION_ARMED",
    "CIRCLED",
    "CLEARED",
    "CLIMBING",
    "COMPASS_ARMED",
    "CRASHED",
    "DESCENDS",
    "DESTINATION",
    "DIRECTION",
    "DISARMED",
    "EKF_CLEARED",
    "EKF_FAILSAFE",
    "EKF_SOURCE",
    "EKF_VARIANCE",
    "FAST_ENOUGH",
    "FENCE_FETCH_BAD",
    "FENCE_FETCH_OLD",
    "FINAL",
    "FLARES",
    "FLYING",
    "GCS_BACK",
    "GCS_MODE",
    "GROUNDSPEED",
    "GYROS_STARTED",
    "HOLDS_COURSE",
    "HOME_SET",
    "INITIALISING",
    "IN_USE",
    "ITEM",
    "LANDED",
    "LANDED_AT",
    "LANDING_BEGINS",
    "LANDS_FROM_POINT",
    "LANDS_FROM_START",
    "LATENCY_OFF",
    "LATENCY_ON",
    "LEARNED",
    "LEARNS",
    "LEARN_FAILED",
    "LEVELS_OFF",
    "LOG_DISARM",
    "LONG_CLEARED",
    "LONG_MODE",
    "LOST",
    "MISSION_COMPLETE",
    "MISSION_DONE",
    "MODE_FAILED",
    "MOTOR_TEST_ARMED",
    "NEAR",
    "NEAR_HOME",
    "NOT_ARMED",
    "NOT_FLYING",
    "NOT_LEARNING",
    "NO_AUTOLAND",
    "NO_AXIS",
    "NO_DIRECTION",
    "NO_DOCK",
    "NO_EFFECT",
    "NO_LANDING",
    "NO_MESSAGE",
    "NO_MISSION",
    "NO_MODE",
    "NO_OPTION",
    "NO_Q_MODES",
    "NO_RESTART",
    "NO_TUNING",
    "NO_VTOL",
    "ON_WING",
    "OVERSHOT",
    "PARACHUTE",
    "PASSED",
    "PLANE",
    "PLAN_RECEIVED",
    "RALLY_FETCH_BAD",
    "RALLY_FETCH_OLD",
    "REACHED",
    "REACHED_DISTANCE",
    "REACHED_WAITS",
    "READY",
    "REFUSED",
    "RESET",
    "RESTORED",
    "ROVER",
    "SAVED_NONE",
    "SEQUENCE_STARTS",
    "SHORT_CLEARED",
    "SHORT_MODE",
    "SHORT_ON",
    "SILENT",
    "SLOPE",
    "SLOWING",
    "SWITCHES",
    "TAKEOFF_COMPLETE",
    "TAKEOFF_GUIDED",
    "TAKES_OFF",
    "TEST_KIND",
    "TEST_MOTOR",
    "TEST_PERCENT",
    "TEST_PULSE",
    "THROTTLE_BACK",
    "THROTTLE_LOST",
    "TOLD",
    "TO_WING",
    "TRACK_FULL",
    "TRANSITION_AUTO",
    "TRIGGERED",
    "TUNED_D",
    "TUNED_P",
    "TUNES",
    "TUNING_DONE",
    "TUNING_STARTS",
    "TUNING_STOPS",
    "UNKNOWN_FRAME",
    "USE_INT",
    "WAITS",
    "say",
    "say_figures",
    "say_mode",
]

_FUNCTIONS = {
    7: "SaveWaypoint",
    9: "CameraTrigger",
    11: "Fence",
    24: "MissionReset",
    28: "Relay1",
    31: "MotorEStop",
    34: "Relay2",
    35: "Relay3",
    36: "Relay4",
    40: "AvoidProximity",
    58: "ClearWaypoint",
    62: "CompassLearn",
    65: "GPSDisable",
    66: "Relay5",
    67: "Relay6",
}
TOLD = np.array(list(_FUNCTIONS), dtype=np.int64)
"""Auxiliary functions whose switches are told."""
_WORDS = (
    "Throttle armed",
    "Throttle disarmed",
    "No such mode %",
    "Flight mode change failed",
    "No Mission. Can't set AUTO.",
    "Reached waypoint #%",
    "Reached destination",
    "Reached waypoint #%. Loiter for % seconds",
    "Reached waypoint #% dist %m",
    "Passed waypoint #% dist %m",
    "Flight plan received",
    "Mission: % WP",
    "Mission: % LoitUnlim",
    "Mission: % RTL",
    "Mission: % Land",
    "Mission: % Takeoff",
    "Mission: % VTOLTakeoff",
    "Mission: % VTOLLand",
    "Mission: % ChangeSpeed",
    "Mission: % LandStart",
    "Disarm to allow calibration",
    "Disarm to allow compass calibration",
    "got MISSION_REQUEST; use MISSION_REQUEST_INT!",
    "Unknown mavlink coordinate frame %",
    "No ap_message for mavlink id (%)",
    "Q_ENABLE 0",
    "Mission Complete",
    "Mission complete, changing mode to RTL",
    "VTOL not available",
    "ArduRover V4.7.0-dev (90700977)",
    "ArduPlane V4.7.0-dev (90700977)",
    "AFS not enabled, can't terminate the vehicle",
    "Climbing to TKOFF alt then loitering",
    "Invalid fence point, index past total(% >= 0)",
    "Received message (FENCE_FETCH_POINT) is deprecated",
    "Set groundspeed %",
    "Initialising ArduPilot",
    "ServoRelayEvent: Channel % is already in use",
    "High Latency disabled",
    "High Latency enabled",
    "Disarm for log download",
    "Must be disarmed for motor test",
    "Unable to start landing sequence",
    "Failed to get rally point",
    "Received message (RALLY_FETCH_POINT) is deprecated",
    "All parameters reset, reboot board",
    "User Takeoff only in GUIDED mode",
    "VTOL transition only in AUTO",
    "SmartRTL deactivated: buffer full",
    "Dock: target not acquired",
    "Transition started airspeed ~",
    "Transition airspeed reached ~",
    "Transition done",
    "Must be armed for takeoff",
    "Already flying - no takeoff",
    "Must already be flying!",
    "autoland not available",
    "VTOL Position1 d=~",
    "VTOL approach d=~",
    "VTOL position1 d=~ r=~",
    "VTOL position1 v=~ d=% sd=% h=~",
    "VTOL position2 started v=~ d=~ h=~",
    "Land descend started",
    "Land final started",
    "Land complete",
    "Armed AUTO, xaccel = ~ m/s/s, waiting ~ sec",
    "Triggered AUTO. GPS speed = ~",
    "Holding course % at ~m/s (~)",
    "Takeoff level-off starting at %m",
    "Takeoff complete at $m",
    "Above TKOFF alt - loitering",
    "Takeoff to %m for ~m heading ~ deg",
    "Barometer % calibration complete",
    "Airspeed % calibration started",
    "Beginning INS calibration. Do not move vehicle",
    "ArduPilot Ready",
    "Radio Failsafe",
    "GCS Failsafe",
    "Radio Failsafe Cleared",
    "GCS Failsafe Cleared",
    "Failsafe - Continuing Auto Mode",
    "Crash: Going to HOLD",
    "EKF variance",
    "EKF failsafe",
    "EKF failsafe cleared",
    "Battery 1 is low $V used % mAh",
    "Battery 1 is critical $V used % mAh",
    "Arm: Battery 1 below minimum arming voltage",
    "Arm: Battery 1 below minimum arming capacity",
    "Arm: Battery 1 low voltage failsafe",
    "Arm: Battery 1 low capacity failsafe",
    "Arm: Battery 1 critical voltage failsafe",
    "Arm: Battery 1 critical capacity failsafe",
    "Arm: Battery 1 capacity failsafe critical >= low",
    "Arm: Battery 1 voltage failsafe critical >= low",
    "Arm: Motors Emergency Stopped",
    "Invalid channel option (%)",
    "Using EKF Source Set %",
    "SaveWP: Mission cleared!",
    "VTOL airbrake v=~ d=% sd=% h=~",
    "VTOL position1 v=~ d=~ h=~ dc=~",
    "VTOL Overshoot d=~ cs=~ yerr=~",
    "Set HOME to ^ ^ at $m",
    "Cruise Learning NOT started",
    "Cruise Learning started",
    "Cruise Learning failed",
    "Cruise Learned: Thr:% Speed:~",
    "Arm: GPS %: Bad fix",
    "Arm: Mode not armable",
    "Arm: @ mode not armable",
    "Arm: FS_LONG_TIMEOUT < FS_SHORT_TIMEOUT",
    "Arm: Waiting for RC",
    "Arm: Radio failsafe on",
    "Arm: ROLL_LIMIT_DEG too small (~)",
    "Arm: PTCH_LIM_MAX_DEG too small (~)",
    "Arm: PTCH_LIM_MIN_DEG too large (~)",
    "Arm: AIRSPEED_MIN too low (% < 5)",
    "Arm: Check Q_ANGLE_MAX",
    "Arm: AHRS: not using configured AHRS type",
    "Arm: AHRS: waiting for home",
    "Arm: Mode requires mission",
    "Arm: VTOL land too short, min %m",
    "Arm: Motors: Q_M_SPIN_MIN too high $ > 0.3",
    "Arm: @ not Q mode",
    "Arm: @ not in VTOL takeoff",
    "Arm: @ missing takeoff waypoint",
    "Gains are fixed here, none is tuned",
    "Started autotune",
    "Stopped autotune",
    "No axis selected for tuning!",
    "Autotuning roll ",
    "Autotuning pitch ",
    "Autotuning roll pitch ",
    "Autotuning yaw",
    "Autotuning roll yaw",
    "Autotuning pitch yaw",
    "Autotuning roll pitch yaw",
    "RollD: &",
    "PitchD: &",
    "RollP: &",
    "PitchP: &",
    "Roll: Finished",
    "Pitch: Finished",
    "Takeoff initial direction not set",
    "Autoland direction= %",
    "Loiter to alt complete",
    "Landing approach start at ~m",
    "Landing glide slope ~ degrees",
    "Flare ~m sink=$ speed=~ dist=~",
    "Auto disarmed",
    "Distance from LAND point=$m",
    "Landing sequence start",
    "Restarted landing via DO_LAND_START: %",
    "Restarted landing sequence at waypoint %",
    "Unable to restart landing sequence",
    "Arm: In landing sequence",
    "Arm: DO_LAND_START set and RTL_AUTOLAND disabled",
    "Throttle failsafe on",
    "Throttle failsafe off",
    "RC Short Failsafe On",
    "RC Short Failsafe: switched to @",
    "Short Failsafe Cleared",
    "RC Long Failsafe On: @",
    "RC Long Failsafe Cleared",
    "GCS Failsafe On: @",
    "GCS Failsafe Off",
    "Flight mode @ restored",
    "Parachute: Released",
    "Function % does nothing on this vehicle",
    "QAssist: Disabled",
    "QAssist: Enabled",
    "QAssist: Force enabled",
    "Motor Test: invalid motor (%)",
    "Motor Test: invalid throttle type: %",
    "Motor Test: pwm (%) too high",
    "Motor Test: percentage (%) too high",
    *(f"RC%: {name} {at}" for name in _FUNCTIONS.values() for at in ("LOW", "MIDDLE", "HIGH")),
)
(
    ARMED,
    DISARMED,
    NO_MODE,
    MODE_FAILED,
    NO_MISSION,
    REACHED,
    DESTINATION,
    REACHED_WAITS,
    REACHED_DISTANCE,
    PASSED,
    PLAN_RECEIVED,
    ITEM,
    _,
    _,
    _,
    _,
    _,
    _,
    _,
    _,
    CALIBRATION_ARMED,
    COMPASS_ARMED,
    USE_INT,
    UNKNOWN_FRAME,
    NO_MESSAGE,
    NO_Q_MODES,
    MISSION_DONE,
    MISSION_COMPLETE,
    NO_VTOL,
    ROVER,
    PLANE,
    AFS_OFF,
    CLIMBING,
    FENCE_FETCH_BAD,
    FENCE_FETCH_OLD,
    GROUNDSPEED,
    INITIALISING,
    IN_USE,
    LATENCY_OFF,
    LATENCY_ON,
    LOG_DISARM,
    MOTOR_TEST_ARMED,
    NO_LANDING,
    RALLY_FETCH_BAD,
    RALLY_FETCH_OLD,
    RESET,
    TAKEOFF_GUIDED,
    TRANSITION_AUTO,
    TRACK_FULL,
    NO_DOCK,
    TO_WING,
    FAST_ENOUGH,
    ON_WING,
    NOT_ARMED,
    FLYING,
    NOT_FLYING,
    NO_AUTOLAND,
    NEAR,
    APPROACH,
    NEAR_HOME,
    SLOWING,
    ABOVE,
    DESCENDS,
    FINAL,
    LANDED,
    WAITS,
    TRIGGERED,
    HOLDS_COURSE,
    LEVELS_OFF,
    TAKEOFF_COMPLETE,
    ABOVE_TAKEOFF,
    TAKES_OFF,
    BAROMETER,
    AIRSPEED_STARTED,
    GYROS_STARTED,
    READY,
    LOST,
    _,
    CLEARED,
    _,
    AUTO_GOES_ON,
    CRASHED,
    EKF_VARIANCE,
    EKF_FAILSAFE,
    EKF_CLEARED,
    BATTERY_ALARM,
    _,
    ARM_BATTERY,
    _,
    _,
    _,
    _,
    _,
    _,
    _,
    ARM_STOPPED,
    NO_OPTION,
    EKF_SOURCE,
    SAVED_NONE,
    BRAKES,
    BRAKED,
    OVERSHOT,
    HOME_SET,
    NOT_LEARNING,
    LEARNS,
    LEARN_FAILED,
    LEARNED,
    ARM_GPS,
    ARM_MODE,
    ARM_THIS_MODE,
    ARM_TIMEOUTS,
    ARM_RADIO,
    ARM_RADIO_LOST,
    ARM_ROLL,
    ARM_PITCH_MAX,
    ARM_PITCH_MIN,
    ARM_AIRSPEED,
    ARM_LEAN,
    ARM_AHRS,
    ARM_HOME,
    ARM_MISSION,
    ARM_NO_LANDING,
    ARM_SPIN,
    ARM_NOT_LIFTED,
    ARM_NOT_TAKEOFF,
    ARM_NO_TAKEOFF,
    NO_TUNING,
    TUNING_STARTS,
    TUNING_STOPS,
    NO_AXIS,
    TUNES,
    _,
    _,
    _,
    _,
    _,
    _,
    TUNED_D,
    _,
    TUNED_P,
    _,
    TUNING_DONE,
    _,
    NO_DIRECTION,
    DIRECTION,
    CIRCLED,
    LANDING_BEGINS,
    SLOPE,
    FLARES,
    AUTO_DISARMED,
    LANDED_AT,
    SEQUENCE_STARTS,
    LANDS_FROM_START,
    LANDS_FROM_POINT,
    NO_RESTART,
    ARM_LANDING,
    ARM_NO_RETURN,
    THROTTLE_LOST,
    THROTTLE_BACK,
    SHORT_ON,
    SHORT_MODE,
    SHORT_CLEARED,
    LONG_MODE,
    LONG_CLEARED,
    GCS_MODE,
    GCS_BACK,
    RESTORED,
    PARACHUTE,
    NO_EFFECT,
    ASSISTANCE,
    _,
    _,
    TEST_MOTOR,
    TEST_KIND,
    TEST_PULSE,
    TEST_PERCENT,
    SWITCHES,
    *_SWITCHES_MORE,
) = (cast(int, np.int64(i)) for i in range(len(_WORDS)))
"""LOST and CLEARED: the texts of the radio, followed by those of the ground station; BATTERY_ALARM: low, then critical;
ARM_BATTERY: the first of eight; ITEM: the first of nine, in the order of `gcs.items`; ASSISTANCE and, for each of TOLD,
SWITCHES: of the positions low, middle and high; TUNES: of the bits of AUTOTUNE_AXES from 1 on; TUNED_D, TUNED_P and
TUNING_DONE: roll, then pitch."""
REFUSED, ASKED, SILENT = (cast(int, np.int64(i)) for i in range(3))
"""How failed checks are told, `checks_told`."""
_SIZE = 50
_TEXT = np.zeros((len(_WORDS), _SIZE), np.uint8)
for _row, _words in enumerate(_WORDS):
    _TEXT[_row, : len(_words)] = np.frombuffer(_words.encode(), np.uint8)
_PRE = np.frombuffer(b"Pre", np.uint8)  # before "Arm: "
_STATUSTEXT = cast(int, np.int64(STATUSTEXT))
_PERCENT, _TENTHS, _HUNDREDTHS, _FOUR, _MILLIONTHS, _POINT, _MINUS, _ZERO, _NAME = b"%~$&^.-0@"


@kernel
def _put_figure(m: Any, at: int, value: float, decimals: int) -> int:
    """Writes a number at a place of the text, with so many decimals; returns the place behind it."""
    one = 1
    for _ in range(decimals):
        one *= 10
    size = int(one * abs(value) + 0.5)
    if value < 0.0 and size > 0:
        put_statustext_text(m.payload, at, _MINUS)
        at += 1
    unit = one
    while unit * 10 <= size:
        unit *= 10
    while unit > 0:
        put_statustext_text(m.payload, at, _ZERO + size // unit % 10)
        at += 1
        if decimals > 0 and unit == one:
            put_statustext_text(m.payload, at, _POINT)
            at += 1
        unit //= 10
    return at


@kernel
def _decimals(byte: int) -> int:
    """Returns the decimals of the figure in the place of a byte of a text, -1 if that is no such place."""
    if byte == _PERCENT:
        return 0
    if byte == _FOUR:
        return 4
    return 1 if byte == _TENTHS else 2 if byte == _HUNDREDTHS else 6 if byte == _MILLIONTHS else -1


@kernel
def _put_name(m: Any, at: int, mode: int) -> int:
    """Writes the name of a mode at a place of the text; returns the place behind it."""
    row = row_of_mode(firmware_of(m), mode)
    for i in range(_SIZE - at):
        byte = letter_of_mode(row, i)
        if byte == 0:
            break
        put_statustext_text(m.payload, at, byte)
        at += 1
    return at


@kernel
def _say(m: Any, severity: int, text: int, figures: tuple[float, float, float, float], mode: int) -> None:
    if m.checks_told == SILENT:
        return
    encode_statustext(m.payload, severity, 0, 0)
    at, used = 0, 0
    for i in range(_SIZE):
        put_statustext_text(m.payload, i, 0)
    if m.checks_told == ASKED:
        for i in range(_PRE.size):
            put_statustext_text(m.payload, i, int(_PRE[i]))
        at = int(_PRE.size)
    for i in range(_SIZE):
        byte = int(_TEXT[text, i])
        if byte == 0 or at == _SIZE:
            break
        decimals = _decimals(byte)
        if decimals >= 0:
            at = _put_figure(m, at, figures[used], decimals)
            used += 1
        elif byte == _NAME:
            at = _put_name(m, at, mode)
        else:
            put_statustext_text(m.payload, at, byte)
            at += 1
    send(m, _STATUSTEXT)


@kernel
def say_figures(m: Any, severity: int, text: int, figures: tuple[float, float, float, float]) -> None:
    """Sends a STATUSTEXT with figures in the places of its "%", "~", "$", "&" and "^".

    They have no decimals, one, two, four and six. If there is no room, it is left out; of its bytes, 50 are sent.
    """
    _say(m, severity, text, figures, 0)


@kernel
def say_mode(m: Any, severity: int, text: int, mode: int) -> None:
    """Sends a STATUSTEXT with the name of a mode in the place of its "@"; if there is no room, it is left out."""
    _say(m, severity, text, (0.0, 0.0, 0.0, 0.0), mode)


@kernel
def say(m: Any, severity: int, text: int, number: int) -> None:
    """Sends a STATUSTEXT with `number` in the place of its "%"; if there is no room, it is left out."""
    say_figures(m, severity, text, (float(number), 0.0, 0.0, 0.0))
