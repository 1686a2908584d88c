"""The parameters of `Autopilot`, under ArduPilot's names and in its units, and what its record remembers.

Defaults are those of ArduCopter 4.7-dev without any parameter file. Nothing is computed here.

Source: ArduPilot's parameter documentation; the recorded list of all parameters of a simulated ArduCopter 4.7-dev.
"""

from __future__ import annotations

import math

from cosim import Memory, Output, PacketInput, PacketOutput, Parameter, Variable
from cosim.vehicle import MAX_MOTORS, MOTION_INPUTS
from cosim_models.arming import Mode
from cosim_models.copter_messages import STREAM_COUNT
from cosim_models.missions import ITEM, MISSION_CAPACITY
from cosim_models.pid import PID_STATE, PLANE_STATE

__all__ = ["PARAMETERS", "VARIABLES"]

_POSITIVE = 1e-3  # least value of what the laws divide by


def _real(name: str, unit: str, start: float, description: str, minimum: float | None = None) -> Variable:
    tunable = name.isupper()  # a ground station may set it
    return Parameter(name, unit=unit, start=start, description=description, minimum=minimum, tunable=tunable)


def _whole(name: str, start: int, description: str, minimum: int | None = None, maximum: int | None = None) -> Variable:
    return Parameter(
        name, type=int, start=start, description=description, tunable=True, minimum=minimum, maximum=maximum
    )


def _rate_parameters(axis: str, name: str, p: float, i: float, d: float, error_filter: float) -> tuple[Variable, ...]:
    """Parameters of one rate controller; its output is the share of the greatest torque."""
    prefix = f"ATC_RAT_{axis}_"
    return (
        _real(prefix + "P", "s/rad", p, f"{name} rate: proportional gain"),
        _real(prefix + "I", "1/rad", i, f"{name} rate: integral gain"),
        _real(prefix + "D", "s2/rad", d, f"{name} rate: derivative gain"),
        _real(prefix + "IMAX", "1", 0.5, f"{name} rate: limit of the integral"),
        _real(prefix + "FLTT", "Hz", 20.0, f"{name} rate: filter of the target"),
        _real(prefix + "FLTE", "Hz", error_filter, f"{name} rate: filter of the error"),
        _real(prefix + "FLTD", "Hz", 20.0, f"{name} rate: filter of the derivative"),
    )


ATTITUDE_PARAMETERS = (
    *_rate_parameters("RLL", "roll", 0.135, 0.135, 0.0036, 0.0),
    *_rate_parameters("PIT", "pitch", 0.135, 0.135, 0.0036, 0.0),
    *_rate_parameters("YAW", "yaw", 0.18, 0.018, 0.0, 2.5),
    _real("ATC_ANG_RLL_P", "1/s", 4.5, "roll angle: gain"),
    _real("ATC_ANG_PIT_P", "1/s", 4.5, "pitch angle: gain"),
    _real("ATC_ANG_YAW_P", "1/s", 4.5, "yaw angle: gain"),
    _real("ATC_ACCEL_R_MAX", "cdeg/s2", 110000.0, "roll: greatest angular acceleration"),
    _real("ATC_ACCEL_P_MAX", "cdeg/s2", 110000.0, "pitch: greatest angular acceleration"),
    _real("ATC_ACCEL_Y_MAX", "cdeg/s2", 27000.0, "yaw: greatest angular acceleration"),
    _real("ATC_SLEW_YAW", "cdeg/s", 6000.0, "greatest rate of turning the nose"),
    _real("ATC_INPUT_TC", "s", 0.15, "time constant of the attitude target"),
    _real("ATC_ANG_LIM_TC", "s", 1.0, "time constant of the lean limit that keeps height"),
    _whole("ATC_ANGLE_BOOST", 1, "1: more throttle when leaning"),
    _real("ATC_THR_MIX_MIN", "1", 0.1, "attitude over throttle, landing"),
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
    _real("PSC_POSZ_P", "1/s", 1.0, "height: gain", _POSITIVE),
    _real("PSC_VELZ_P", "1/s", 5.0, "climb rate: proportional gain"),
    _real("PSC_VELZ_I", "1/s2", 0.0, "climb rate: integral gain"),
    _real("PSC_VELZ_D", "1", 0.0, "climb rate: derivative gain"),
    _real("PSC_VELZ_IMAX", "cm/s2", 1000.0, "climb rate: limit of the integral"),
    _real("PSC_VELZ_FLTE", "Hz", 5.0, "climb rate: filter of the error"),
    _real("PSC_VELZ_FLTD", "Hz", 5.0, "climb rate: filter of the derivative"),
    _real("PSC_ACCZ_P", "1", 0.5, "vertical acceleration: proportional gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_I", "1/s", 1.0, "vertical acceleration: integral gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_D", "s", 0.0, "vertical acceleration: derivative gain, per mille of throttle per cm/s2"),
    _real("PSC_ACCZ_IMAX", "1", 800.0, "vertical acceleration: limit of the integral, per mille of throttle"),
    _real("PSC_ACCZ_FLTT", "Hz", 0.0, "vertical acceleration: filter of the target"),
    _real("PSC_ACCZ_FLTE", "Hz", 20.0, "vertical acceleration: filter of the error"),
    _real("PSC_ACCZ_FLTD", "Hz", 0.0, "vertical acceleration: filter of the derivative"),
    _real("PSC_JERK_XY", "m/s3", 5.0, "greatest horizontal jerk", _POSITIVE),
    _real("PSC_JERK_Z", "m/s3", 5.0, "greatest vertical jerk", _POSITIVE),
    _real("WPNAV_SPEED", "cm/s", 1000.0, "horizontal speed"),
    _real("WPNAV_SPEED_UP", "cm/s", 250.0, "climb rate"),
    _real("WPNAV_SPEED_DN", "cm/s", 150.0, "descent rate"),
    _real("WPNAV_ACCEL", "cm/s2", 250.0, "greatest horizontal acceleration", _POSITIVE),
    _real("WPNAV_ACCEL_Z", "cm/s2", 100.0, "greatest vertical acceleration", _POSITIVE),
    _real("WPNAV_RADIUS", "cm", 200.0, "distance at which a waypoint is reached"),
)

MODE_PARAMETERS = (
    _whole("WP_YAW_BEHAVIOR", 2, "0: keep the heading, 1: nose along the path, 2: except in RTL"),
    _real("GUID_TIMEOUT", "s", 3.0, "how long a velocity or acceleration target holds"),
    _real("LOIT_SPEED", "cm/s", 1250.0, "greatest speed in LOITER"),
    _real("LOIT_BRK_ACCEL", "cm/s2", 250.0, "greatest braking in LOITER"),
    _real("LOIT_BRK_JERK", "cm/s3", 500.0, "jerk of braking in LOITER"),
    _real("LOIT_BRK_DELAY", "s", 1.0, "time before braking in LOITER"),
    _real("RTL_ALT", "cm", 1500.0, "least height above home of the way back"),
    _real("RTL_CONE_SLOPE", "1", 3.0, "height over distance below which RTL need not climb"),
    _real("RTL_LOIT_TIME", "ms", 5000.0, "time above home before landing"),
    _real("LAND_SPEED", "cm/s", 50.0, "descent rate below LAND_ALT_LOW"),
    _real("LAND_SPEED_HIGH", "cm/s", 0.0, "descent rate above LAND_ALT_LOW, 0: WPNAV_SPEED_DN"),
    _real("LAND_ALT_LOW", "cm", 1000.0, "height below which landing is slow"),
    _real("TKOFF_SLEW_TIME", "s", 2.0, "time from no to full throttle while lifting off"),
    _real("TKOFF_THR_MAX", "1", 0.9, "throttle that counts as lifted off"),
    _real("DISARM_DELAY", "s", 10.0, "armed on the ground longer than this: disarm; 0: never"),
)

MOTOR_PARAMETERS = (
    _real("MOT_THST_EXPO", "1", 0.65, "curve of thrust over command: 0 linear, 1 quadratic"),
    _real("MOT_THST_HOVER", "1", 0.35, "throttle of hovering, at the start"),
    _whole("MOT_HOVER_LEARN", 2, "0: keep MOT_THST_HOVER, 1 and 2: learn it in flight"),
    _real("MOT_SPIN_ARM", "1", 0.1, "command when armed on the ground"),
    _real("MOT_SPIN_MIN", "1", 0.15, "least command in flight"),
    _real("MOT_SPIN_MAX", "1", 0.95, "greatest command"),
    _real("MOT_SPOOL_TIME", "s", 0.5, "time to spool up"),
    _real("MOT_YAW_HEADROOM", "1", 200.0, "yaw that is always possible, per mille"),
)

SAFETY_PARAMETERS = (
    _whole("SYSID_MYGCS", 255, "MAVLink system id of the ground station whose HEARTBEATs are watched"),
    _whole("FS_GCS_ENABLE", 0, "ground station lost: 0 nothing, 1 to 3 RTL, 4 and 5 LAND, 7 BRAKE", 0, 7),
    _real("FS_GCS_TIMEOUT", "s", 5.0, "silence after which the ground station is lost", 0.1),
    _whole("FENCE_ENABLE", 0, "1: fences are watched", 0, 1),
    _whole("FENCE_TYPE", 7, "sum of 1 greatest height, 2 circle, 8 least height", 0, 15),
    _whole("FENCE_ACTION", 1, "0: tell only, 1: RTL, 2: LAND, 4: BRAKE", 0, 4),
    _real("FENCE_ALT_MAX", "m", 100.0, "greatest height above home"),
    Parameter(
        "FENCE_ALT_MIN", unit="m", start=-10.0, minimum=-100.0, tunable=True, description="least height above home"
    ),
    _real("FENCE_RADIUS", "m", 150.0, "greatest distance from home"),
)

LINK_PARAMETERS = (
    _whole("SYSID_THISMAV", 1, "MAVLink system id"),
    *(
        _whole(f"SR0_{name}", 0, f"rate of {what} in Hz until asked otherwise, 0: not sent")
        for name, what in (
            ("RAW_SENS", "RAW_IMU"),
            ("EXT_STAT", "SYS_STATUS, POWER_STATUS, GPS_RAW_INT, NAV_CONTROLLER_OUTPUT and others"),
            ("POSITION", "GLOBAL_POSITION_INT and LOCAL_POSITION_NED"),
            ("EXTRA1", "ATTITUDE and SIMSTATE"),
            ("EXTRA2", "VFR_HUD"),
            ("EXTRA3", "EKF_STATUS_REPORT, BATTERY_STATUS and SYSTEM_TIME"),
            ("RC_CHAN", "SERVO_OUTPUT_RAW"),
        )
    ),
    _real(
        "estimate_ready_time",
        "s",
        2.0,
        "time after which the position estimate is ready; 41.5 s in simulated ArduCopter",
    ),
    _real("origin_latitude", "rad", math.radians(-35.363262), "of the local origin that all vehicles share"),
    _real("origin_longitude", "rad", math.radians(149.165237), "of the local origin"),
    _real("origin_altitude", "m", 584.0, "of the local origin, above mean sea level"),
)

PARAMETERS = tuple(
    variable
    for group in (
        LINK_PARAMETERS,
        SAFETY_PARAMETERS,
        MODE_PARAMETERS,
        POSITION_PARAMETERS,
        ATTITUDE_PARAMETERS,
        MOTOR_PARAMETERS,
    )
    for variable in group
)
"""All parameters. Those with ArduPilot's names, in capitals, can be set by ground stations."""

MEMORY = (
    # what is sensed: north, east, up and FRD
    Memory("pos", shape=3),
    Memory("vel", shape=3),
    Memory("acc", shape=3),  # without gravity
    Memory("gyro", shape=3),
    Memory("q", shape=4),
    Memory("filter_dt"),
    Memory("gyro_filter", shape=3),
    Memory("accel_filter", shape=3),
    Memory("gyro_delay", shape=(3, 2)),
    Memory("accel_delay", shape=(3, 2)),
    # attitude control
    Memory("attitude_target", shape=4),
    Memory("rate_target", shape=3),  # of the target attitude, in its own axes
    Memory("rate_wanted", shape=3),  # of the body
    Memory("rate_pid", shape=(3, PID_STATE)),
    Memory("torque", shape=3),
    Memory("thrust_error"),  # angle of the thrust from the target's
    # position control: north, east, up
    Memory("speed_max"),
    Memory("speed_up"),
    Memory("speed_down"),
    Memory("accel_max"),
    Memory("accel_up"),
    Memory("jerk_max"),
    Memory("jerk_up"),
    Memory("position_desired", shape=3),
    Memory("velocity_desired", shape=3),
    Memory("acceleration_desired", shape=3),
    Memory("position_error", shape=3),
    Memory("velocity_target", shape=3),
    Memory("acceleration_target", shape=3),
    Memory("velocity_pid", shape=PLANE_STATE),
    Memory("climb_pid", shape=PID_STATE),
    Memory("accel_pid", shape=PID_STATE),
    Memory("limit", shape=3),  # direction in which the actuators are saturated
    Memory("path_heading"),
    Memory("path_turn_rate"),
    Memory("lean_max"),  # that keeps height
    # motors
    Memory("motor_count", dtype="i4"),
    Memory("factors", shape=(MAX_MOTORS, 3)),
    Memory("thrust", shape=MAX_MOTORS),
    Memory("air_density"),  # over that at sea level
    Memory("spool_state", dtype="i4"),
    Memory("spool_wanted", dtype="i4"),
    Memory("spin_up"),
    Memory("thrust_max"),
    Memory("throttle_in"),
    Memory("throttle_command"),
    Memory("throttle_cutoff"),
    Memory("throttle_filtered"),
    Memory("throttle_average_max"),
    Memory("throttle_out"),
    Memory("throttle_hover"),
    Memory("throttle_mix"),
    Memory("limit_roll_pitch", dtype="?"),
    Memory("limit_yaw", dtype="?"),
    Memory("limit_throttle_lower", dtype="?"),
    Memory("limit_throttle_upper", dtype="?"),
    # modes
    Memory("home", shape=3),
    Memory("armed_at"),
    Memory("idle_since"),
    Memory("arming_delay", dtype="?"),
    Memory("auto_armed", dtype="?"),
    Memory("touched", dtype="?"),
    Memory("land_time"),
    Memory("land_accel", shape=3),
    Memory("submode", dtype="i4"),
    Memory("guided_position", shape=3),
    Memory("guided_velocity", shape=3),
    Memory("guided_acceleration", shape=3),
    Memory("guided_time"),
    Memory("takeoff_from"),
    Memory("takeoff_to"),
    Memory("takeoff_done", dtype="?"),
    Memory("yaw_mode", dtype="i4"),
    Memory("yaw_fixed"),
    Memory("yaw_rate"),
    Memory("loiter_brake"),
    Memory("loiter_since"),
    Memory("rtl_stage", dtype="i4"),
    # link
    Memory("payload", dtype="u1", shape=255),
    Memory("received", dtype="u1", shape=255),
    Memory("sequence", dtype="i4"),
    Memory("text_queue", dtype="i8", shape=(8, 3)),  # severity, text, number
    Memory("text_count", dtype="i4"),
    Memory("ack_room", dtype="i4"),  # bytes to keep for acknowledgements of what was received
    Memory("link_version", dtype="i4"),
    Memory("interval", shape=STREAM_COUNT),
    Memory("due", shape=STREAM_COUNT),
    Memory("next_due"),
    Memory("told_armed", dtype="?"),
    Memory("told_mode", dtype="i4"),
    Memory("told_home", dtype="?"),
    Memory("parameter_next", dtype="i4"),  # of the list being sent
    Memory("parameter_due"),
    # fail-safes
    Memory("next_watch"),
    Memory("station_heard"),
    Memory("station_known", dtype="?"),
    Memory("station_lost", dtype="?"),
    Memory("fence_breach", dtype="i4"),  # bits of FENCE_TYPE
    Memory("fence_low_armed", dtype="?"),
    # mission
    Memory("mission_count", dtype="i4"),  # items, home among them
    Memory("mission_current", dtype="i4"),
    Memory("mission_complete", dtype="?"),
    Memory("mission_changed", dtype="?"),  # the current item is to be begun
    Memory("auto_command", dtype="i4"),  # MAV_CMD that is flown
    Memory("auto_stage", dtype="i4"),
    Memory("auto_since"),
    Memory("auto_speed"),  # that the mission asked for, 0: WPNAV_SPEED
    Memory("auto_landing", dtype="?"),
    Memory("uploading", dtype="?"),
    Memory("upload_count", dtype="i4"),
    Memory("upload_next", dtype="i4"),
    Memory("upload_system", dtype="i4"),
    Memory("upload_component", dtype="i4"),
    Memory("upload_heard"),
    Memory("upload_asked"),
    Memory("mission", shape=(MISSION_CAPACITY, ITEM)),
)

VARIABLES = (
    *MOTION_INPUTS,
    PacketInput("mavlink_rx", capacity=2048, description="packets received"),
    *PARAMETERS,
    Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="commands, (pwm - 1000) / 1000"),
    Output("armed", type=bool, start=False, description="whether the motors may turn"),
    Output("mode", type=Mode, start=Mode.STABILIZE, description="flight mode, by ArduCopter's number"),
    Output("on_ground", type=bool, start=True, description="whether the vehicle is taken to be on the ground"),
    Output("target", shape=3, unit="m", start=0.0, description="position it flies to, NED from the local origin"),
    Output("desired_position", shape=3, unit="m", start=0.0, description="of the shaped path, NED"),
    Output("desired_velocity", shape=3, unit="m/s", start=0.0, description="of the shaped path, NED"),
    PacketOutput("mavlink_tx", capacity=4096, description="packets sent"),
    *MEMORY,
)
"""All that an Autopilot declares."""
