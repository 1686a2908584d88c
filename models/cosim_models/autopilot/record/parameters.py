"""The parameters of `Autopilot`, under ArduPilot's names and in its units.

Defaults are those of ArduCopter 4.7-dev without a parameter file. This module contains no computation. Parameters that
a step in flight does not read are declared rare.

Source: ArduPilot's parameter documentation; the recorded list of all parameters of a simulated ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cosim import Parameter, Variable
from cosim.verdict import Role
from cosim_models.autopilot.mission.terrain import TERRAIN_POINTS

__all__ = ["CRUMBS", "PARAMETERS", "STICK_CHANNELS"]

_POSITIVE = 1e-3  # lower limit of values that the control laws divide by


def _real(name: str, unit: str, start: float, description: str, minimum: float | None = None) -> Variable:
    tunable = name.isupper()  # a ground station may set it
    return Parameter(name, unit=unit, start=start, description=description, minimum=minimum, tunable=tunable)


def _signed(name: str, unit: str, start: float, description: str, most: float) -> Variable:
    """Declares a parameter between -most and most."""
    return Parameter(name, unit=unit, start=start, minimum=-most, maximum=most, tunable=True, description=description)


def _whole(name: str, start: int, description: str, minimum: int | None = None, maximum: int | None = None) -> Variable:
    return Parameter(
        name, type=int, start=start, description=description, tunable=True, minimum=minimum, maximum=maximum
    )


_IN_ALL_STEPS = frozenset({"FENCE_ENABLE", "GUID_TIMEOUT", "PILOT_THR_FILT", "PILOT_Y_RATE_TC"})
"""Parameters of rare features that all steps on the ground, in GUIDED or anywhere read nevertheless."""


def _rare(*variables: Variable) -> tuple[Variable, ...]:
    """Returns the variables, declared rare if most steps do not read them."""
    return tuple(replace(variable, rare=variable.name not in _IN_ALL_STEPS) for variable in variables)


def _rate_parameters(axis: str, name: str, p: float, i: float, d: float, error_filter: float) -> tuple[Variable, ...]:
    """Declares the parameters of one rate controller; its output is a fraction of the maximum torque."""
    prefix = f"ATC_RAT_{axis}_"
    return (
        _real(prefix + "P", "s/rad", p, f"{name} rate: proportional gain"),
        _real(prefix + "I", "1/rad", i, f"{name} rate: integral gain"),
        _real(prefix + "D", "s2/rad", d, f"{name} rate: derivative gain"),
        _real(prefix + "IMAX", "1", 0.5, f"{name} rate: limit of the integral"),
        _real(prefix + "FLTT", "Hz", 20.0, f"{name} rate: filter of the target"),
        _real(prefix + "FLTE", "Hz", error_filter, f"{name} rate: filter of the error"),
        _real(prefix + "FLTD", "Hz", 20.0, f"{name} rate: filter of the derivative"),
        _real(prefix + "FF", "s/rad", 0.0, f"{name} rate: feed-forward of the target"),
        _real(prefix + "PDMX", "1", 0.0, f"{name} rate: limit of the proportional and derivative part, 0: none"),
    )


ATTITUDE_PARAMETERS = (
    *_rate_parameters("RLL", "roll", 0.135, 0.135, 0.0036, 0.0),
    *_rate_parameters("PIT", "pitch", 0.135, 0.135, 0.0036, 0.0),
    *_rate_parameters("YAW", "yaw", 0.18, 0.018, 0.0, 2.5),
    _real("ATC_ANG_RLL_P", "1/s", 4.5, "roll angle: gain"),
    _real("ATC_ANG_PIT_P", "1/s", 4.5, "pitch angle: gain"),
    _real("ATC_ANG_YAW_P", "1/s", 4.5, "yaw angle: gain"),
    _real("ATC_ACCEL_R_MAX", "cdeg/s2", 110000.0, "roll: maximum angular acceleration"),
    _real("ATC_ACCEL_P_MAX", "cdeg/s2", 110000.0, "pitch: maximum angular acceleration"),
    _real("ATC_ACCEL_Y_MAX", "cdeg/s2", 27000.0, "yaw: maximum angular acceleration"),
    _real("ATC_RATE_R_MAX", "deg/s", 0.0, "roll: maximum rate of the attitude target, 0: no limit"),
    _real("ATC_RATE_P_MAX", "deg/s", 0.0, "pitch: maximum rate of the attitude target, 0: no limit"),
    _real("ATC_RATE_Y_MAX", "deg/s", 0.0, "yaw: maximum rate of the attitude target, 0: no limit"),
    _real("ATC_SLEW_YAW", "cdeg/s", 6000.0, "maximum yaw rate"),
    _real("ATC_INPUT_TC", "s", 0.15, "time constant of the attitude target"),
    _real("ATC_ANG_LIM_TC", "s", 1.0, "time constant of the lean limit that keeps height"),
    _whole("ATC_ANGLE_BOOST", 1, "1: more throttle when leaning"),
    _real("ATC_THR_MIX_MIN", "1", 0.1, "attitude over throttle, landing"),
    _real("ATC_THR_MIX_MAN", "1", 0.1, "attitude over throttle, flown by hand"),
    _real("ATC_THR_MIX_MAX", "1", 0.5, "attitude over throttle, flying"),
    Parameter(
        "ANGLE_MAX",
        unit="cdeg",
        start=3000.0,
        minimum=500.0,
        maximum=8000.0,
        tunable=True,
        description="greatest lean",
    ),
    _real("INS_GYRO_FILTER", "Hz", 20.0, "filter of the angular velocity"),
    _real("INS_ACCEL_FILTER", "Hz", 20.0, "filter of the specific force"),
)

POSITION_PARAMETERS = (
    _real("PSC_POSXY_P", "1/s", 1.0, "horizontal position: gain", _POSITIVE),
    _real("PSC_VELXY_P", "1/s", 2.0, "horizontal velocity: proportional gain"),
    _real("PSC_VELXY_I", "1/s2", 1.0, "horizontal velocity: integral gain"),
    _real("PSC_VELXY_D", "1", 0.25, "horizontal velocity: derivative gain"),
    _real("PSC_VELXY_IMAX", "cm/s2", 1000.0, "horizontal velocity: limit of the integral"),
    _real("PSC_VELXY_FLTE", "Hz", 5.0, "horizontal velocity: filter of the error"),
    _real("PSC_VELXY_FLTD", "Hz", 5.0, "horizontal velocity: filter of the derivative"),
    _real("PSC_VELXY_FF", "1/s", 0.0, "horizontal velocity: feed-forward of the target"),
    _real("PSC_ANGLE_MAX", "deg", 0.0, "maximum lean for position control, 0: ANGLE_MAX"),
    _real("PSC_POSZ_P", "1/s", 1.0, "height: gain", _POSITIVE),
    _real("PSC_VELZ_P", "1/s", 5.0, "climb rate: proportional gain"),
    _real("PSC_VELZ_I", "1/s2", 0.0, "climb rate: integral gain"),
    _real("PSC_VELZ_D", "1", 0.0, "climb rate: derivative gain"),
    _real("PSC_VELZ_IMAX", "cm/s2", 1000.0, "climb rate: limit of the integral"),
    _real("PSC_VELZ_FLTE", "Hz", 5.0, "climb rate: filter of the error"),
    _real("PSC_VELZ_FLTD", "Hz", 5.0, "climb rate: filter of the derivative"),
    _real("PSC_VELZ_FF", "1/s", 0.0, "climb rate: feed-forward of the target"),
    _real("PSC_ACCZ_P", "1", 0.5, "vertical acceleration: proportional gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_I", "1/s", 1.0, "vertical acceleration: integral gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_D", "s", 0.0, "vertical acceleration: derivative gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_IMAX", "1", 800.0, "vertical acceleration: limit of the integral, per mille of throttle"),
    _real("PSC_ACCZ_FLTT", "Hz", 0.0, "vertical acceleration: filter of the target"),
    _real("PSC_ACCZ_FLTE", "Hz", 20.0, "vertical acceleration: filter of the error"),
    _real("PSC_ACCZ_FLTD", "Hz", 0.0, "vertical acceleration: filter of the derivative"),
    _real("PSC_ACCZ_FF", "1", 0.0, "vertical acceleration: feed-forward, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_PDMX", "1", 0.0, "vertical acceleration: limit of P and D, per mille of throttle, 0: none"),
    _real("PSC_JERK_XY", "m/s3", 5.0, "maximum horizontal jerk", _POSITIVE),
    _real("PSC_JERK_Z", "m/s3", 5.0, "maximum vertical jerk", _POSITIVE),
    _real("WPNAV_SPEED", "cm/s", 1000.0, "horizontal speed"),
    _real("WPNAV_SPEED_UP", "cm/s", 250.0, "climb rate"),
    _real("WPNAV_SPEED_DN", "cm/s", 150.0, "descent rate"),
    _real("WPNAV_ACCEL", "cm/s2", 250.0, "maximum horizontal acceleration", _POSITIVE),
    _real("WPNAV_ACCEL_Z", "cm/s2", 100.0, "maximum vertical acceleration", _POSITIVE),
    _real("WPNAV_ACCEL_C", "cm/s2", 0.0, "maximum acceleration in corners, 0: twice WPNAV_ACCEL", 0.0),
    _real("WPNAV_JERK", "m/s3", 1.0, "maximum jerk on the way to waypoints", _POSITIVE),
    _real("WPNAV_RADIUS", "cm", 200.0, "distance at which a waypoint is reached"),
)

CRUMBS = 300
"""Points of the flown path that are kept at most."""

MODE_PARAMETERS = (
    _real("DISARM_DELAY", "s", 10.0, "time armed on the ground until disarming; 0: never"),
    *_rare(
        _whole("WP_YAW_BEHAVIOR", 2, "0: hold the heading, 1: along the path, 2: except in RTL"),
        _real("GUID_TIMEOUT", "s", 3.0, "lifetime of a velocity or acceleration target"),
        _real("LOIT_SPEED", "cm/s", 1250.0, "maximum speed in LOITER"),
        _real("LOIT_ACC_MAX", "cm/s2", 500.0, "maximum acceleration of position correction in LOITER", _POSITIVE),
        _real("LOIT_ANG_MAX", "deg", 0.0, "maximum lean in LOITER, 0: two thirds of ANGLE_MAX"),
        _real("LOIT_BRK_ACCEL", "cm/s2", 250.0, "maximum braking in LOITER"),
        _real("LOIT_BRK_JERK", "cm/s3", 500.0, "jerk of braking in LOITER"),
        _real("LOIT_BRK_DELAY", "s", 1.0, "time before braking in LOITER"),
        _real("CIRCLE_RADIUS", "cm", 1000.0, "radius of CIRCLE, 0: turn on the spot", 0.0),
        _signed("CIRCLE_RATE", "deg/s", 20.0, "rate of CIRCLE, positive clockwise", 90.0),
        _whole("CIRCLE_OPTIONS", 1, "sum of 1 sticks change circle, 2 face along it, 4 begin at its centre", 0, 7),
        _real("RTL_ALT", "cm", 1500.0, "minimum return height above home"),
        _real("RTL_CONE_SLOPE", "1", 3.0, "height over distance below which RTL need not climb"),
        _real("RTL_CLIMB_MIN", "cm", 0.0, "minimum climb before the return"),
        _real("RTL_SPEED", "cm/s", 0.0, "return speed, 0: WPNAV_SPEED"),
        _real("RTL_ALT_FINAL", "cm", 0.0, "height above home at the end of RTL, 0: land"),
        _real("RTL_LOIT_TIME", "ms", 5000.0, "time above home before landing"),
        _real("LAND_SPEED", "cm/s", 50.0, "descent rate below LAND_ALT_LOW"),
        _real("LAND_SPEED_HIGH", "cm/s", 0.0, "descent rate above LAND_ALT_LOW, 0: WPNAV_SPEED_DN"),
        _real("LAND_ALT_LOW", "cm", 1000.0, "height below which the descent is slow"),
        _whole("MIS_RESTART", 0, "AUTO: 0 resumes the mission, 1 restarts it", 0, 1),
        _whole("AUTO_OPTIONS", 0, "sum of 1 armed in AUTO, 2 takes off without throttle, 4 yaw stick ignored", 0, 7),
        _whole(
            "GUID_OPTIONS",
            0,
            "sum of 1 armed by the sticks, 4 yaw stick ignored, 8 attitudes with thrust",
            0,
            13,
        ),
        _whole("RTL_OPTIONS", 0, "4: yaw stick ignored before the landing", 0, 4),
        _whole("LAND_REPOSITION", 1, "1: roll and pitch sticks move the landing place", 0, 1),
        _real("RALLY_LIMIT_KM", "km", 0.3, "distance limit of rally points if all are beyond it, 0: none", 0.0),
        _whole("RALLY_INCL_HOME", 1, "1: return to home if it is nearer than the rally points", 0, 1),
        _real("TKOFF_SLEW_TIME", "s", 2.0, "time from no to full throttle while lifting off"),
        _real("TKOFF_THR_MAX", "1", 0.9, "throttle that counts as lifted off"),
    ),
)

ACROBATIC_PARAMETERS = _rare(
    _real("ACRO_RP_RATE", "deg/s", 360.0, "ACRO: roll and pitch rate of the full stick", _POSITIVE),
    _signed("ACRO_RP_EXPO", "1", 0.3, "ACRO: curve of the roll and pitch sticks, 0: linear", 1.0),
    _real("ACRO_Y_RATE", "deg/s", 202.5, "ACRO and DRIFT: turn rate of the full stick", _POSITIVE),
    _signed("ACRO_Y_EXPO", "1", 0.0, "ACRO: curve of the yaw stick", 1.0),
    _real("ACRO_BAL_ROLL", "1/s", 1.0, "ACRO: rate per roll angle with which the trainer levels", 0.0),
    _real("ACRO_BAL_PITCH", "1/s", 1.0, "ACRO: rate per pitch angle with which the trainer levels", 0.0),
    _whole("ACRO_TRAINER", 2, "ACRO: 0 nothing, 1 levels, 2 levels and keeps within ANGLE_MAX", 0, 2),
    _real("ACRO_THR_MID", "1", 0.0, "ACRO: throttle of the centred stick, 0: hover", 0.0),
    _real("THROW_ALT_ACSND", "m", 3.0, "THROW: climb after a throw upwards", 0.0),
    _real("THROW_ALT_DCSND", "m", 1.0, "THROW: descent after a drop", 0.0),
    _real("THROW_ALT_MIN", "m", 0.0, "THROW: minimum height above home, 0: none"),
    _real("THROW_ALT_MAX", "m", 0.0, "THROW: maximum height above home, 0: none"),
    _whole("THROW_MOT_START", 0, "THROW: motors before the throw: 0 stopped, 1 idle", 0, 1),
    _whole("THROW_NEXTMODE", 18, "THROW: mode after it: 3, 4, 5, 6, 9 or 17; others: none", 0, 28),
    _whole("THROW_TYPE", 0, "THROW: 0 upwards, 1 dropped", 0, 1),
    _real("PHLD_BRAKE_RATE", "deg/s", 8.0, "POSHOLD: rate at which braking changes the lean; at least 4"),
    _real("PHLD_BRAKE_ANGLE", "cdeg", 3000.0, "POSHOLD: maximum lean of braking", 0.0),
    _real("SRTL_ACCURACY", "m", 2.0, "SMART_RTL: minimum distance between the points that are kept, 0: off", 0.0),
    _whole("AUTOTUNE_AXES", 7, "AUTOTUNE: sum of 1 roll, 2 pitch, 4 yaw by the error filter, 8 yaw by D", 0, 15),
    _real("AUTOTUNE_AGGR", "1", 0.075, "AUTOTUNE: bounce-back per peak with which D is tuned, 0.05 to 0.2", 0.0),
    _real("AUTOTUNE_MIN_D", "s2/rad", 0.0005, "AUTOTUNE: least derivative gain", 0.0),
    _whole("SRTL_POINTS", 300, "SMART_RTL: number of points that are kept, 0: off", 0, CRUMBS),
)


def _channel(number: int, dead_zone: float) -> tuple[Variable, ...]:
    """Declares the calibration of one remote control channel: five consecutive values in the record."""
    return (
        _real(f"RC{number}_MIN", "us", 1000.0, "minimum pulse"),
        _real(f"RC{number}_TRIM", "us", 1500.0, "pulse of the centred stick"),
        _real(f"RC{number}_MAX", "us", 2000.0, "maximum pulse"),
        _real(f"RC{number}_DZ", "us", dead_zone, "dead zone about the centre, or above the minimum"),
        _real(f"RC{number}_REVERSED", "1", 0.0, "1: reversed"),
    )


STICK_CHANNELS = 8
"""Channels that can be assigned to sticks."""

PILOT_PARAMETERS = _rare(
    *(
        variable
        for number, zone in enumerate((20.0, 20.0, 30.0, 20.0, 0.0, 0.0, 0.0, 0.0), 1)
        for variable in _channel(number, zone)
    ),
    *(
        _whole(f"RCMAP_{name}", number, f"channel of the {name.lower()} stick", 1, STICK_CHANNELS)
        for number, name in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), 1)
    ),
    *(
        _whole(
            f"RC{number}_OPTION", 7 if number == 7 else 0, f"function of channel {number}'s switch, 0: none", 0, 32767
        )
        for number in range(1, 17)
    ),
    Parameter(
        "RC_OVERRIDE_TIME",
        unit="s",
        start=3.0,
        minimum=-1.0,
        maximum=120.0,
        tunable=True,
        description="lifetime of an override; 0: overrides are ignored, -1: unlimited",
    ),
    _real("RC_FS_TIMEOUT", "s", 1.0, "time without a signal after which the radio is lost", 0.5),
    _whole("SIM_RC_FAIL", 0, "receiver: 0 works, 1 gives no pulses, 2 throttle of 950 us", 0, 2),
    *(
        _whole(f"FLTMODE{position}", mode, f"mode at switch position {position}", 0, 28)
        for position, mode in enumerate((7, 9, 6, 3, 5, 0), 1)
    ),
    _whole("FLTMODE_CH", 5, "channel of the mode switch, 0: none", 0, 16),
    _whole("ARMING_RUDDER", 2, "yaw stick: 0 nothing, 1 arms, 2 arms and disarms", 0, 2),
    _real("THR_DZ", "1", 100.0, "dead band about mid throttle that holds height, per mille"),
    _real("PILOT_SPEED_UP", "cm/s", 250.0, "climb rate of the full throttle stick", _POSITIVE),
    _real("PILOT_SPEED_DN", "cm/s", 0.0, "descent rate of the closed throttle stick, 0: PILOT_SPEED_UP"),
    _real("PILOT_ACCEL_Z", "cm/s2", 250.0, "maximum vertical acceleration by the throttle stick", _POSITIVE),
    _real("PILOT_TKOFF_ALT", "cm", 0.0, "automatic climb height of the pilot's take-off", 0.0),
    _real("PILOT_THR_FILT", "Hz", 0.0, "filter of the throttle in STABILIZE"),
    _real("PILOT_Y_RATE", "deg/s", 202.5, "turn rate of the full yaw stick"),
    _signed("PILOT_Y_EXPO", "1", 0.0, "curve of the yaw stick: 0 linear, 1 soft about the centre", 1.0),
    _real("PILOT_Y_RATE_TC", "s", 0.0, "time constant of the yaw rate demanded by the stick"),
)

MOTOR_PARAMETERS = (
    *_rare(
        _real("MOT_PWM_MIN", "us", 1000.0, "pulse of a stopped motor in SERVO_OUTPUT_RAW"),
        _real("MOT_PWM_MAX", "us", 2000.0, "pulse of a motor at full command"),
        _real("MOT_BAT_VOLT_MAX", "V", 0.0, "voltage at which commands are not raised; 0: voltage does not count", 0.0),
        _real("MOT_BAT_VOLT_MIN", "V", 0.0, "voltage below which commands are not raised further", 0.0),
    ),
    _real("MOT_THST_EXPO", "1", 0.65, "curve of thrust over command: 0 linear, 1 quadratic"),
    _real("MOT_THST_HOVER", "1", 0.35, "initial hover throttle"),
    _whole("MOT_HOVER_LEARN", 2, "0: keep MOT_THST_HOVER, 1 and 2: learn it in flight"),
    _real("MOT_SPIN_ARM", "1", 0.1, "command when armed on the ground"),
    _real("MOT_SPIN_MIN", "1", 0.15, "minimum command in flight"),
    _real("MOT_SPIN_MAX", "1", 0.95, "greatest command"),
    _real("MOT_SPOOL_TIME", "s", 0.5, "time to spool up"),
    _real("MOT_SPOOL_TIM_DN", "s", 0.0, "time to spool down, 0: MOT_SPOOL_TIME"),
    _real("MOT_SLEW_UP_TIME", "s", 0.0, "time of a command from minimum to maximum, 0: at once"),
    _real("MOT_SLEW_DN_TIME", "s", 0.0, "time of a command from maximum to minimum, 0: at once"),
    _real("MOT_YAW_HEADROOM", "1", 200.0, "yaw that is always available, per mille"),
)

SAFETY_PARAMETERS = _rare(
    _whole("SYSID_MYGCS", 255, "MAVLink system id of the ground station whose HEARTBEATs are monitored"),
    _whole(
        "FS_GCS_ENABLE",
        0,
        "no ground station: 0 nothing, 1, 2 RTL, 3 SMART_RTL or RTL, 4 SMART_RTL or LAND, 5 LAND, 6 AUTO_RTL, 7 BRAKE",
        0,
        7,
    ),
    _real("FS_GCS_TIMEOUT", "s", 5.0, "time without HEARTBEAT until the ground station is lost", 0.1),
    _whole(
        "FS_THR_ENABLE",
        1,
        "no radio: 0 nothing, 1 and 2 RTL, 3 LAND, 4 SMART_RTL or RTL, 5 SMART_RTL or LAND, 6 AUTO_RTL, 7 BRAKE",
        0,
        7,
    ),
    _real("FS_THR_VALUE", "us", 975.0, "throttle pulse below which the radio is lost"),
    _whole(
        "FS_OPTIONS",
        16,
        "sum of: 1 AUTO and 4 GUIDED continue without radio, 2 AUTO and 16 pilot without ground station, 8 landing",
        0,
        31,
    ),
    _whole(
        "FS_EKF_ACTION", 1, "estimate lost: 0 report, 1 LAND, 2 ALT_HOLD, 3 LAND also from modes without position", 0, 3
    ),
    _real("FS_EKF_THRESH", "1", 0.8, "0: a lost estimate is not acted on", 0.0),
    _whole("FS_CRASH_CHECK", 1, "1: a crash disarms", 0, 1),
    _whole("ARMING_CHECK", 1, "0: check the position only", 0),
    _whole("FENCE_ENABLE", 0, "1: fences are enabled", 0, 1),
    _whole("FENCE_TYPE", 7, "sum of 1 maximum height, 2 circle, 4 polygons, 8 minimum height", 0, 15),
    _whole(
        "FENCE_ACTION", 1, "0: report only, 1: RTL, 2: LAND, 3: SMART_RTL or RTL, 4: BRAKE, 5: SMART_RTL or LAND", 0, 5
    ),
    _real("FENCE_ALT_MAX", "m", 100.0, "maximum height above home"),
    Parameter(
        "FENCE_ALT_MIN", unit="m", start=-10.0, minimum=-100.0, tunable=True, description="minimum height above home"
    ),
    _real("FENCE_RADIUS", "m", 150.0, "maximum distance from home"),
    _real("FENCE_MARGIN", "m", 2.0, "distance from a fence at which AVOID_ENABLE stops the vehicle", 0.0),
    _whole("AVOID_ENABLE", 3, "1: velocities and LOITER slow down before circle and heights of the fence", 0, 7),
)

_ACTIONS = "0 report, 1 LAND, 2 RTL, 3 SMART_RTL or RTL, 4 SMART_RTL or LAND, 5 disarm, 6 AUTO_RTL or RTL, 7 BRAKE"

BATTERY_PARAMETERS = _rare(
    _real("BATT_CAPACITY", "mAh", 3300.0, "capacity assumed by the autopilot"),
    _real("BATT_LOW_VOLT", "V", 10.5, "low voltage, 0: none"),
    _real("BATT_LOW_MAH", "mAh", 0.0, "low remaining charge, 0: none"),
    _real("BATT_CRT_VOLT", "V", 0.0, "critical voltage, 0: none"),
    _real("BATT_CRT_MAH", "mAh", 0.0, "critical remaining charge, 0: none"),
    _real("BATT_LOW_TIMER", "s", 10.0, "duration of low voltage until the alarm, 0: ignore voltages"),
    _whole("BATT_FS_LOW_ACT", 0, f"battery low: {_ACTIONS}", 0, 7),
    _whole("BATT_FS_CRT_ACT", 0, "battery critical: as for BATT_FS_LOW_ACT", 0, 7),
    _whole("BATT_FS_VOLTSRC", 0, "which voltage counts: 0 under load, 1 at rest", 0, 1),
    _real("BATT_ARM_VOLT", "V", 0.0, "voltage below which arming is refused, 0: none"),
    _real("BATT_ARM_MAH", "mAh", 0.0, "remaining charge below which arming is refused, 0: none"),
    _real("SIM_BATT_VOLTAGE", "V", 12.6, "voltage of the full battery"),
    _real("SIM_BATT_CAP_AH", "Ah", 0.0, "capacity of the simulated battery, 0: constant voltage", 0.0),
    _real("hover_current", "A", 15.0, "current in hover", 0.0),
    _real("battery_resistance", "V/A", 0.02, "internal resistance of the simulated battery", 0.0),
)

SENSOR_PARAMETERS = _rare(
    _whole("FS_VIBE_ENABLE", 1, "1: height control without the accelerometer when vibration spoils the estimate", 0, 1),
    _whole("SIM_GPS1_ENABLE", 1, "GPS: 0 gives no position", 0, 1),
    _whole("SIM_GPS1_JAM", 0, "GPS: 1 is jammed", 0, 1),
    replace(
        _real("gps_jamming_radius", "m", 0.0, "GPS: radius of an area in which it is jammed; 0: none", 0.0),
        verdict=Role.JAMMED_RADIUS,
    ),
    replace(_real("gps_jamming_north", "m", 0.0, "GPS: centre of that area"), verdict=Role.JAMMED_NORTH),
    replace(_real("gps_jamming_east", "m", 0.0, "GPS: centre of that area"), verdict=Role.JAMMED_EAST),
    replace(_real("gps_jamming_start", "s", 0.0, "GPS: beginning of the jamming there", 0.0), verdict=Role.JAMMED_FROM),
    replace(_real("gps_jamming_stop", "s", 1e9, "GPS: end of the jamming there", 0.0), verdict=Role.JAMMED_UNTIL),
    _signed("SIM_GPS1_GLTCH_X", "deg", 0.0, "GPS: error of the latitude in degrees", 90.0),
    _signed("SIM_GPS1_GLTCH_Y", "deg", 0.0, "GPS: error of the longitude in degrees", 90.0),
    _signed("SIM_GPS1_GLTCH_Z", "m", 0.0, "GPS: error of the altitude", 1e5),
    _signed("SIM_BARO_DRIFT", "m/s", 0.0, "barometer: drift of the height since the start", 100.0),
    _signed("SIM_BARO_GLITCH", "m", 0.0, "barometer: error of the height", 1e5),
    _signed("SIM_MAG1_OFS_X", "1", 5.0, "compass: offset forward in mGauss; it is calibrated for 5, 13, -18", 1e4),
    _signed("SIM_MAG1_OFS_Y", "1", 13.0, "compass: offset to the right in mGauss", 1e4),
    _signed("SIM_MAG1_OFS_Z", "1", -18.0, "compass: offset down in mGauss", 1e4),
    _signed("SIM_ACC1_BIAS_X", "m/s2", 0.0, "accelerometer: error forwards", 20.0),
    _signed("SIM_ACC1_BIAS_Y", "m/s2", 0.0, "accelerometer: error to the right", 20.0),
    _signed("SIM_ACC1_BIAS_Z", "m/s2", 0.0, "accelerometer: error downwards", 20.0),
    _real("SIM_ACC1_RND", "m/s2", 0.0, "accelerometer: amplitude of the vibration while the motors turn", 0.0),
    *(
        _real(
            f"SIM_VIB_FREQ_{axis}", "Hz", 0.0, f"accelerometer: frequency of the vibration {way}; 0 on all: none", 0.0
        )
        for axis, way in (("X", "forwards"), ("Y", "to the right"), ("Z", "downwards"))
    ),
    *(
        _signed(f"SIM_GYR1_BIAS_{axis}", "rad/s", 0.0, f"gyro: error of the {name} rate", 20.0)
        for axis, name in (("X", "roll"), ("Y", "pitch"), ("Z", "yaw"))
    ),
    *(
        _signed(f"SIM_ACC2_BIAS_{axis}", "m/s2", 0.0, f"second accelerometer: error {way}", 20.0)
        for axis, way in (("X", "forwards"), ("Y", "to the right"), ("Z", "downwards"))
    ),
    *(
        _signed(f"SIM_GYR2_BIAS_{axis}", "rad/s", 0.0, f"second gyro: error of the {name} rate", 20.0)
        for axis, name in (("X", "roll"), ("Y", "pitch"), ("Z", "yaw"))
    ),
    _whole(
        "EK3_IMU_MASK", 3, "lanes of the estimate: 1 by the first inertial sensor, 2 by the second, 3 by each", 1, 3
    ),
    _whole("EK3_PRIMARY", 0, "lane that flies before others are better, from 0", 0, 1),
    _whole("EK3_OPTIONS", 0, "2: lanes change only by EK3_PRIMARY", 0, 3),
    _real("EK3_ERR_THRESH", "1", 0.2, "by how much the score of another lane must be better", 0.05),
    _whole("INS_USE", 1, "0: the first inertial sensor is not used", 0, 1),
    _whole("INS_USE2", 1, "0: the second inertial sensor is not used", 0, 1),
    _real("SIM_GYR1_RND", "deg/s", 0.0, "gyro: greatest noise at full throttle", 0.0),
    _signed("SIM_DRIFT_SPEED", "1", 0.05, "gyros: drift without GPS in deg/s a minute", 60.0),
    _real("SIM_DRIFT_TIME", "min", 5.0, "gyros: time after which the drift turns round; 0: none", 0.0),
    _real("SIM_WIND_SPD", "m/s", 0.0, "wind: speed at the height SIM_WIND_T_ALT", 0.0),
    _signed("SIM_WIND_DIR", "deg", 180.0, "wind: direction from which it blows", 360.0),
    _signed("SIM_WIND_DIR_Z", "deg", 0.0, "wind: angle by which it rises", 90.0),
    _real("SIM_WIND_TURB", "m/s", 0.0, "wind: standard deviation of its turbulence, none on the ground", 0.0),
    _real("SIM_WIND_TC", "s", 5.0, "wind: time constant of its changes", 0.0),
    _whole("SIM_WIND_T", 0, "wind below SIM_WIND_T_ALT: 0 root of the height, 1 constant, 2 SIM_WIND_T_COEF", 0, 2),
    _real("SIM_WIND_T_ALT", "m", 60.0, "wind: height of its full speed", _POSITIVE),
    _signed("SIM_WIND_T_COEF", "1/s", 0.01, "wind: speed over height, with SIM_WIND_T 2", 100.0),
    _whole("SIM_ENGINE_FAIL", 0, "failed motors, sum of 1, 2, 4, ... for the first, second, third, ...", 0, 255),
    _signed("SIM_ENGINE_MUL", "1", 0.0, "share of their commands that failed motors obey", 1.0),
)

TERRAIN_PARAMETERS = _rare(
    _whole("TERRAIN_ENABLE", 1, "0: there is no database of terrain", 0, 1),
    _real("TERRAIN_OFS_MAX", "m", 30.0, "greatest shift of the terrain to the place of arming", 0.0),
    _real("WPNAV_TER_MARGIN", "m", 10.0, "error of the height above terrain at which the way is stopped", 0.0),
    _whole("WPNAV_RFND_USE", 1, "1: terrain is followed by the rangefinder, if there is one", 0, 1),
    _whole("RTL_ALT_TYPE", 0, "RTL_ALT is 0 above home, 1 above the terrain", 0, 1),
    _whole("RNGFND1_TYPE", 0, "rangefinder that looks down: 0 none, 100 simulated; read at the start", 0, 127),
    _real("RNGFND1_MIN", "m", 0.2, "rangefinder: least distance", 0.0),
    _real("RNGFND1_MAX", "m", 7.0, "rangefinder: greatest distance", 0.0),
    _real("RNGFND_FILT", "Hz", 0.5, "rangefinder: filter of the distance, 0: none", 0.0),
    _whole("SURFTRAK_MODE", 1, "1: a pilot's modes follow the surface below the rangefinder; 0: they do not", 0, 2),
    _real("SURFTRAK_TC", "s", 1.0, "rangefinder: time constant of the terrain's height", 0.0),
    _real("terrain_spacing", "m", 0.0, "distance of the points of the terrain's grid; 0: a plane", 0.0),
    Parameter("terrain_origin", shape=2, unit="m", start=0.0, description="the grid's first point, north and east"),
    Parameter(
        "terrain",
        shape=TERRAIN_POINTS * TERRAIN_POINTS,
        unit="m",
        start=0.0,
        description=f"heights above the local origin: {TERRAIN_POINTS} points to the east, then the next row north",
    ),
)

_PORTS = ((0, "by cable"), (1, "to ground stations by radio"), (2, "on board and to the swarm"))
_STREAMS = (
    (1, "RAW_SENS", "RAW_IMU and SCALED_PRESSURE"),
    (2, "EXT_STAT", "SYS_STATUS, POWER_STATUS, GPS_RAW_INT, NAV_CONTROLLER_OUTPUT and others"),
    (6, "POSITION", "GLOBAL_POSITION_INT and LOCAL_POSITION_NED"),
    (10, "EXTRA1", "ATTITUDE and SIMSTATE"),
    (11, "EXTRA2", "VFR_HUD"),
    (12, "EXTRA3", "EKF_STATUS_REPORT, BATTERY_STATUS and SYSTEM_TIME"),
    (3, "RC_CHAN", "SERVO_OUTPUT_RAW and RC_CHANNELS"),
)
STREAM_RATES = {(2 - port, group): f"SR{port}_{name}" for port, _ in _PORTS for group, name, _ in _STREAMS}
"""Names of the stream rate parameters by link (`link.links`) and MAV_DATA_STREAM."""

LINK_PARAMETERS = (
    _real(
        "estimate_ready_time",
        "s",
        2.0,
        "time at which the position estimate is ready; 41.5 s in simulated ArduCopter",
    ),
    *_rare(
        replace(_whole("SYSID_THISMAV", 1, "MAVLink system id"), verdict=Role.SYSTEM_ID),
        *(
            _whole(f"SR{port}_{name}", 0, f"rate of {what} {where} in Hz until a request changes it, 0: not sent")
            for port, where in _PORTS
            for _, name, what in _STREAMS
        ),
        *(
            replace(_real(name, unit, start, text), verdict=role)
            for name, unit, start, text, role in (
                (
                    "origin_latitude",
                    "rad",
                    math.radians(-35.363262),
                    "latitude of the local origin, the same for all vehicles",
                    Role.ORIGIN_LATITUDE,
                ),
                (
                    "origin_longitude",
                    "rad",
                    math.radians(149.165237),
                    "longitude of the local origin",
                    Role.ORIGIN_LONGITUDE,
                ),
                (
                    "origin_altitude",
                    "m",
                    584.0,
                    "altitude of the local origin above mean sea level",
                    Role.ORIGIN_ALTITUDE,
                ),
            )
        ),
    ),
)

PARAMETERS = tuple(
    variable
    for group in (
        LINK_PARAMETERS,
        SAFETY_PARAMETERS,
        BATTERY_PARAMETERS,
        SENSOR_PARAMETERS,
        TERRAIN_PARAMETERS,
        MODE_PARAMETERS,
        ACROBATIC_PARAMETERS,
        PILOT_PARAMETERS,
        POSITION_PARAMETERS,
        ATTITUDE_PARAMETERS,
        MOTOR_PARAMETERS,
    )
    for variable in group
)
"""All parameters. Ground stations can set those with ArduPilot's names, in capitals."""
