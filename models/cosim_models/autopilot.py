"""The autopilot FMU: ArduCopter's cascade, modes and MAVLink conversation at 400 Hz, for multirotors of 4, 6, 8 motors.

A step: filter the motion inputs as the inertial sensors would, run the rate controllers and the motors on what the
last step wanted, hear the packets, run the flight mode, detect landing, speak. The laws are in `shaping`, `pid`,
`attitude_control`, `position_control`, `mixer` and `motors`, the modes in `flight_modes`, MAVLink in `commands` and
`telemetry`. Parameters have ArduPilot's names, units and defaults.

Not here: missions, the parameter protocol, radio control, fences and fail-safes; batteries (full voltage is assumed);
and sensors with noise and an estimator: the true motion is used, so there is no lag of an estimate.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from cosim import Memory, Model, Output, PacketInput, PacketOutput, Parameter, kernel
from cosim.frames import rotate
from cosim.vehicle import MAX_MOTORS, MOTION_INPUTS
from cosim_models.attitude_control import run_rates
from cosim_models.commands import receive
from cosim_models.flight_modes import GUIDED, POSITION, RTL, Mode, detect_landing, disarm_after_delay, run_mode
from cosim_models.mixer import motor_factors
from cosim_models.motors import air_density_ratio, learn_hover_throttle, run_motors
from cosim_models.pid import PID_STATE, PLANE_STATE
from cosim_models.position_control import GRAVITY, initialise_ne, initialise_up, set_limits
from cosim_models.telemetry import STREAM_COUNT, start_streams, telemetry

__all__ = ["Autopilot"]

_STEP = 0.0025
_NO_MIXER, _BAD_SYSID, _NOT_FINITE, _BAD_GAIN = 1, 2, 3, 4


# ---- sensing -------------------------------------------------------------------------------------------------------


@kernel
def _tune_filter(c: Any, cutoff: float, dt: float) -> None:
    """Coefficients b0, a1, a2 of a second-order Butterworth low-pass; b0 = 1 and the rest 0 for no cutoff."""
    if cutoff <= 0.0 or 2.0 * cutoff * dt >= 1.0:
        c[0], c[1], c[2] = 1.0, 0.0, 0.0
        return
    w = math.tan(math.pi * cutoff * dt)
    scale = 1.0 + math.sqrt(2.0) * w + w * w
    c[0] = w * w / scale
    c[1] = 2.0 * (w * w - 1.0) / scale
    c[2] = (1.0 - math.sqrt(2.0) * w + w * w) / scale


@kernel
def _filter(s: Any, c: Any, value: float) -> float:
    """One step of the low-pass over its two delays `s`."""
    if c[0] == 1.0:
        return value
    now = value - c[1] * s[0] - c[2] * s[1]
    result = c[0] * (now + 2.0 * s[0] + s[1])
    s[1] = s[0]
    s[0] = now
    return float(result)


@kernel
def _settle_filter(s: Any, c: Any, value: float) -> None:
    """Set the delays as if `value` had been there for ever."""
    s[0] = value / (1.0 + c[1] + c[2])
    s[1] = s[0]


@kernel
def _tune(m: Any, dt: float) -> None:
    """Filter coefficients for steps of dt, settled on the present inputs."""
    m.filter_dt = dt
    _tune_filter(m.gyro_filter, m.INS_GYRO_FILTER, dt)
    _tune_filter(m.accel_filter, m.INS_ACCEL_FILTER, dt)
    for i in range(3):
        _settle_filter(m.gyro_delay[i], m.gyro_filter, m.angular_velocity[i])
        _settle_filter(m.accel_delay[i], m.accel_filter, m.specific_force[i])


@kernel
def _sense(m: Any) -> bool:
    """Take over the motion inputs; False if they are no finite numbers or the attitude has no length."""
    total = 0.0
    length = 0.0
    for i in range(3):
        total += m.position[i] + m.velocity[i] + m.angular_velocity[i] + m.specific_force[i]
    for i in range(4):
        length += m.attitude[i] * m.attitude[i]
    if not math.isfinite(total) or not math.isfinite(length) or length < 1e-6:
        return False
    scale = 1.0 / math.sqrt(length)
    for i in range(4):
        m.q[i] = m.attitude[i] * scale
    for i in range(3):
        sign = -1.0 if i == 2 else 1.0
        m.pos[i] = sign * m.position[i]
        m.vel[i] = sign * m.velocity[i]
        m.gyro[i] = _filter(m.gyro_delay[i], m.gyro_filter, m.angular_velocity[i])
    fx = _filter(m.accel_delay[0], m.accel_filter, m.specific_force[0])
    fy = _filter(m.accel_delay[1], m.accel_filter, m.specific_force[1])
    fz = _filter(m.accel_delay[2], m.accel_filter, m.specific_force[2])
    an, ae, ad = rotate((float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3])), (fx, fy, fz))
    m.acc[0], m.acc[1], m.acc[2] = an, ae, -(ad + GRAVITY)
    return True


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Choose the mixer, take the present motion, disarmed on the ground in STABILIZE."""
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.PSC_POSXY_P, m.PSC_POSZ_P, m.WPNAV_ACCEL, m.WPNAV_ACCEL_Z, m.PSC_JERK_XY, m.PSC_JERK_Z) <= 0.0:
        return _BAD_GAIN
    m.motor_count = motor_factors(m.airframe, m.factors)
    if m.motor_count == 0:
        return _NO_MIXER
    _tune(m, _STEP)
    if not _sense(m):
        return _NOT_FINITE
    for i in range(4):
        m.attitude_target[i] = m.q[i]
    m.on_ground = True
    m.touched = True
    m.throttle_hover = m.MOT_THST_HOVER
    m.throttle_mix = m.ATC_THR_MIX_MIN
    m.air_density = air_density_ratio(m.origin_altitude)
    m.link_version = 2
    set_limits(m, 0.01 * m.WPNAV_SPEED, 0.01 * m.WPNAV_SPEED_UP, 0.01 * m.WPNAV_SPEED_DN)
    initialise_ne(m)
    initialise_up(m)
    for i in range(3):
        m.home[i] = m.pos[i]
    start_streams(m)
    _publish(m)
    return 0


@kernel
def _publish(m: Any) -> None:
    going = m.armed and not m.on_ground and (m.mode == GUIDED or m.mode == RTL) and m.submode == POSITION
    for i in range(3):
        sign = -1.0 if i == 2 else 1.0
        m.desired_position[i] = sign * m.position_desired[i]
        m.desired_velocity[i] = sign * m.velocity_desired[i]
        m.target[i] = sign * (m.guided_position[i] if going else m.position_desired[i])


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """One loop of the autopilot: inputs at t, motor commands for t + h."""
    m.mavlink_tx_len = 0
    if h != m.filter_dt:
        _tune(m, h)
    if not _sense(m):
        return _NOT_FINITE
    run_rates(m, h)
    run_motors(m, h)
    if m.mavlink_rx_len > 0:
        receive(m, t)
    run_mode(m, t, h)
    detect_landing(m, h)
    learn_hover_throttle(m, h)
    disarm_after_delay(m, t)
    telemetry(m, t)
    _publish(m)
    return 0


def _real(name: str, unit: str, start: float, description: str) -> Any:
    return Parameter(name, unit=unit, start=start, description=description)


def _whole(name: str, start: int, description: str) -> Any:
    return Parameter(name, type=int, start=start, description=description)


def _rate_parameters(axis: str, name: str, p: float, i: float, d: float, error_filter: float) -> tuple[Any, ...]:
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


_ATTITUDE_PARAMETERS = (
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
    _real("ANGLE_MAX", "cdeg", 3000.0, "greatest lean"),
    _real("INS_GYRO_FILTER", "Hz", 20.0, "filter of the angular velocity"),
    _real("INS_ACCEL_FILTER", "Hz", 20.0, "filter of the specific force"),
)

_POSITION_PARAMETERS = (
    _real("PSC_POSXY_P", "1/s", 1.0, "horizontal position: gain"),
    _real("PSC_VELXY_P", "1/s", 2.0, "horizontal velocity: proportional gain"),
    _real("PSC_VELXY_I", "1/s2", 1.0, "horizontal velocity: integral gain"),
    _real("PSC_VELXY_D", "1", 0.25, "horizontal velocity: derivative gain"),
    _real("PSC_VELXY_IMAX", "cm/s2", 1000.0, "horizontal velocity: limit of the integral"),
    _real("PSC_VELXY_FLTE", "Hz", 5.0, "horizontal velocity: filter of the error"),
    _real("PSC_VELXY_FLTD", "Hz", 5.0, "horizontal velocity: filter of the derivative"),
    _real("PSC_POSZ_P", "1/s", 1.0, "height: gain"),
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
    _real("PSC_JERK_XY", "m/s3", 5.0, "greatest horizontal jerk"),
    _real("PSC_JERK_Z", "m/s3", 5.0, "greatest vertical jerk"),
    _real("WPNAV_SPEED", "cm/s", 1000.0, "horizontal speed"),
    _real("WPNAV_SPEED_UP", "cm/s", 250.0, "climb rate"),
    _real("WPNAV_SPEED_DN", "cm/s", 150.0, "descent rate"),
    _real("WPNAV_ACCEL", "cm/s2", 250.0, "greatest horizontal acceleration"),
    _real("WPNAV_ACCEL_Z", "cm/s2", 100.0, "greatest vertical acceleration"),
    _real("WPNAV_RADIUS", "cm", 200.0, "distance at which a waypoint is reached"),
)

_MODE_PARAMETERS = (
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

_MOTOR_PARAMETERS = (
    _real("MOT_THST_EXPO", "1", 0.65, "curve of thrust over command: 0 linear, 1 quadratic"),
    _real("MOT_THST_HOVER", "1", 0.35, "throttle of hovering, at the start"),
    _whole("MOT_HOVER_LEARN", 2, "0: keep MOT_THST_HOVER, 1 and 2: learn it in flight"),
    _real("MOT_SPIN_ARM", "1", 0.1, "command when armed on the ground"),
    _real("MOT_SPIN_MIN", "1", 0.15, "least command in flight"),
    _real("MOT_SPIN_MAX", "1", 0.95, "greatest command"),
    _real("MOT_SPOOL_TIME", "s", 0.5, "time to spool up"),
    _real("MOT_YAW_HEADROOM", "1", 200.0, "yaw that is always possible, per mille"),
)

_LINK_PARAMETERS = (
    _whole("SYSID_THISMAV", 1, "MAVLink system id"),
    *(
        _whole(f"SR0_{name}", 0, f"rate of {what} in Hz until asked otherwise, 0: not sent")
        for name, what in (
            ("EXT_STAT", "SYS_STATUS and GPS_RAW_INT"),
            ("POSITION", "GLOBAL_POSITION_INT and LOCAL_POSITION_NED"),
            ("EXTRA1", "ATTITUDE"),
            ("EXTRA2", "VFR_HUD"),
            ("EXTRA3", "EKF_STATUS_REPORT and SYSTEM_TIME"),
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

_MEMORY = (
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
    Memory("thrust_angle"),  # of the body from the vertical
    Memory("thrust_error"),  # from the target's
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
    Memory("link_version", dtype="i4"),
    Memory("interval", shape=STREAM_COUNT),
    Memory("due", shape=STREAM_COUNT),
    Memory("next_due"),
    Memory("told_armed", dtype="?"),
    Memory("told_mode", dtype="i4"),
    Memory("told_home", dtype="?"),
)


class Autopilot(Model):
    """Multirotor autopilot that flies and speaks MAVLink as ArduCopter does."""

    step_size = _STEP
    variables = (
        *MOTION_INPUTS,
        PacketInput("mavlink_rx", capacity=2048, description="packets received"),
        *_LINK_PARAMETERS,
        *_MODE_PARAMETERS,
        *_POSITION_PARAMETERS,
        *_ATTITUDE_PARAMETERS,
        *_MOTOR_PARAMETERS,
        Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="commands, (pwm - 1000) / 1000"),
        Output("armed", type=bool, start=False, description="whether the motors may turn"),
        Output("mode", type=Mode, start=Mode.STABILIZE, description="flight mode, by ArduCopter's number"),
        Output("on_ground", type=bool, start=True, description="whether the vehicle is taken to be on the ground"),
        Output("target", shape=3, unit="m", start=0.0, description="position it flies to, NED from the local origin"),
        Output("desired_position", shape=3, unit="m", start=0.0, description="of the shaped path, NED"),
        Output("desired_velocity", shape=3, unit="m/s", start=0.0, description="of the shaped path, NED"),
        PacketOutput("mavlink_tx", capacity=4096, description="packets sent"),
        *_MEMORY,
    )
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_MIXER: "the vehicle's airframe has no mixer: quad_x (1), hexa_x (2) and octa_x (3) have",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _NOT_FINITE: "a motion input is not a finite number, or the attitude is no quaternion",
        _BAD_GAIN: "PSC_POSXY_P, PSC_POSZ_P, PSC_JERK_XY, PSC_JERK_Z, WPNAV_ACCEL and WPNAV_ACCEL_Z must be positive",
    }
