"""The autopilot FMU: ArduCopter's control cascade, flight modes and MAVLink behaviour at 400 Hz, for 4, 6 or 8 motors.

Each step filters the motion inputs as the inertial sensors would, runs the rate controllers and the motors with the
targets of the previous step, processes received packets, runs the fail-safes and the flight mode, detects landing, and
sends telemetry.

    mavlink/     commands received, telemetry sent, parameters, file transfer, the messages themselves
        commander/   mode requests, arming checks, pilot's switches, fail-safes, battery
        flight/      each flight mode, yaw, the pilot's sticks, armed and landed state
        record/      ports, parameters (ArduPilot's names, units and defaults) and memory of the FMU
    control/     position and attitude controllers, shaping, PID, mixer, motors
    mission/     missions, fences, rally points
        link/        packets and status texts on their links

Not here: sensor noise and estimation. The inputs are taken as the truth; an `Estimator` can be connected upstream.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from cosim import Model, kernel
from cosim.frames import rotate
from cosim_models.autopilot.commander.battery import drain
from cosim_models.autopilot.commander.checks import watch_crash, watch_thrust
from cosim_models.autopilot.commander.failsafes import watch
from cosim_models.autopilot.commander.positions import LAST_POSITION
from cosim_models.autopilot.commander.sensors import add_errors, fail_motors
from cosim_models.autopilot.commander.wind import blow, start_wind
from cosim_models.autopilot.control.attitude import run_rates
from cosim_models.autopilot.control.low_pass import low_pass, settle_low_pass, tune_low_pass
from cosim_models.autopilot.control.mixer import motor_factors
from cosim_models.autopilot.control.motors import air_density_ratio, learn_hover_throttle, run_motors
from cosim_models.autopilot.control.position import GRAVITY, initialise_ne, initialise_up, set_limits
from cosim_models.autopilot.flight.auto import run_auto
from cosim_models.autopilot.flight.modes import run_mode
from cosim_models.autopilot.flight.outputs import run_outputs
from cosim_models.autopilot.flight.state import detect_landing, disarm_after_delay
from cosim_models.autopilot.flight.sticks import read_sticks
from cosim_models.autopilot.flight.terrain_following import destination_up
from cosim_models.autopilot.flight.tuning.gains import BEFORE, load_gains
from cosim_models.autopilot.link.links import MAVLINK, SERIAL, TELEMETRY
from cosim_models.autopilot.link.statustext import BAROMETER_CALIBRATED, INFO, NO_NUMBER, READY, say
from cosim_models.autopilot.mavlink.commands import receive
from cosim_models.autopilot.mavlink.status_messages import going
from cosim_models.autopilot.mavlink.telemetry import start_streams, telemetry
from cosim_models.autopilot.mission.missions import forget_jumps
from cosim_models.autopilot.mission.terrain import look_down, start_ranging
from cosim_models.autopilot.record.memory import forgetting
from cosim_models.autopilot.record.modes import AUTO
from cosim_models.autopilot.record.variables import VARIABLES

__all__ = ["Autopilot"]

_STEP = 0.0025
_forget = forgetting(VARIABLES, ("mission", "mission_count", "fence", "fence_count", "rally", "rally_count"))
_BOOT_TIME = 1.0  # s from a reboot to the first HEARTBEAT
_NO_MIXER, _BAD_SYSID, _NOT_FINITE, _BAD_GAIN, _BAD_LEAN = 1, 2, 3, 4, 5


# ---- sensing -------------------------------------------------------------------------------------------------------


@kernel
def _tune(m: Any, dt: float) -> None:
    """Sets the filter coefficients for steps of dt and settles the filters on the current inputs."""
    m.filter_dt = dt
    tune_low_pass(m.gyro_filter, m.INS_GYRO_FILTER, dt)
    tune_low_pass(m.accel_filter, m.INS_ACCEL_FILTER, dt)
    for i in range(3):
        settle_low_pass(m.gyro_delay[i], m.gyro_filter, m.angular_velocity[i])
        settle_low_pass(m.accel_delay[i], m.accel_filter, m.specific_force[i])


@kernel
def _sense(m: Any) -> bool:
    """Reads the motion inputs; False if they are not finite numbers or the attitude has length zero."""
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
        m.position_neu[i] = sign * m.position[i]
        m.velocity_neu[i] = sign * m.velocity[i]
        m.gyro[i] = low_pass(m.gyro_delay[i], m.gyro_filter, m.angular_velocity[i])
    fx = low_pass(m.accel_delay[0], m.accel_filter, m.specific_force[0])
    fy = low_pass(m.accel_delay[1], m.accel_filter, m.specific_force[1])
    fz = low_pass(m.accel_delay[2], m.accel_filter, m.specific_force[2])
    an, ae, ad = rotate((float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3])), (fx, fy, fz))
    m.acceleration_neu[0], m.acceleration_neu[1], m.acceleration_neu[2] = an, ae, -(ad + GRAVITY)
    return True


# ---- the model -----------------------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Selects the mixer, reads the initial motion, and starts disarmed on the ground in STABILIZE."""
    if not 1 <= m.SYSID_THISMAV <= 255:
        return _BAD_SYSID
    if min(m.PSC_POSXY_P, m.PSC_POSZ_P, m.WPNAV_ACCEL, m.WPNAV_ACCEL_Z, m.PSC_JERK_XY, m.PSC_JERK_Z) <= 0.0:
        return _BAD_GAIN
    if not 500.0 <= m.ANGLE_MAX <= 8000.0:
        return _BAD_LEAN
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
    m.lift = m.air_density
    m.voltage_share = 1.0
    m.mission_count = max(m.mission_count, 1)  # a reboot keeps it
    set_limits(m, 0.01 * m.WPNAV_SPEED, 0.01 * m.WPNAV_SPEED_UP, 0.01 * m.WPNAV_SPEED_DN)
    initialise_ne(m)
    initialise_up(m)
    for i in range(3):
        m.home_neu[i] = m.position_neu[i]
    m.throttle_open_at = -1.0
    m.switch_position = LAST_POSITION
    m.switch_seen = LAST_POSITION
    start_wind(m)
    drain(m, 0.0)
    for i in range(2):
        m.battery_since[i] = -1.0
    start_ranging(m)
    start_streams(m)
    _publish(m)
    return 0


@kernel
def _publish(m: Any) -> None:
    there = going(m)
    for i in range(3):
        sign = -1.0 if i == 2 else 1.0
        m.desired_position[i] = sign * m.desired_position_neu[i]
        m.desired_velocity[i] = sign * m.desired_velocity_neu[i]
        m.target[i] = sign * (m.guided_position_neu[i] if there else m.desired_position_neu[i])
    if there and m.above_terrain:
        m.target[2] = -destination_up(m)


@kernel
def _reboot(m: Any, t: float) -> tuple[int, float]:
    """Starts anew when that is due, and ends the silence after it; returns an error, and the time since the start."""
    if m.restart_at < 0.0:
        if t >= _BOOT_TIME - 1e-9:
            m.rebooting = False
            say(m, INFO, BAROMETER_CALIBRATED, 1)
            say(m, INFO, BAROMETER_CALIBRATED, 2)
            say(m, INFO, READY, NO_NUMBER)
        return 0, t
    if t < m.restart_at - 1e-9:
        return 0, t
    began = m.booted_at + t
    load_gains(m, BEFORE)  # those of a tune are not stored
    _forget(m)
    forget_jumps(m)
    error = start(m)
    m.booted_at = began
    m.tells_elevation = True
    m.rebooting = True
    m.restart_at = -1.0
    return error, 0.0


@kernel
def advance(m: Any, t: float, h: float) -> int:
    """Performs one loop of the autopilot: inputs at t, motor commands for t + h."""
    m.mavlink_tx_len = 0
    m.telemetry_tx_len = 0
    m.serial_tx_len = 0
    t -= m.booted_at
    silent = False
    if m.rebooting:
        error, t = _reboot(m, t)
        if error != 0:
            return error
        silent = m.rebooting and m.restart_at < 0.0
    if h != m.filter_dt:
        _tune(m, h)
    if not _sense(m):
        return _NOT_FINITE
    if m.sim_on:
        add_errors(m, t, h)
    run_rates(m, h)
    run_motors(m, h)
    if m.outputs_busy:
        run_outputs(m, t, h)
    if m.sim_on:
        fail_motors(m)
        blow(m, h)
    if m.mavlink_rx_len > 0 and not silent:
        m.link = MAVLINK
        receive(m, m.mavlink_rx, m.mavlink_rx_len, t)
    if m.telemetry_rx_len > 0 and not silent:
        m.link = TELEMETRY
        receive(m, m.telemetry_rx, m.telemetry_rx_len, t)
    if m.serial_rx_len > 0 and not silent:
        m.link = SERIAL
        receive(m, m.serial_rx, m.serial_rx_len, t)
    if m.rc_known:
        read_sticks(m, t)
    if m.ranging:
        look_down(m, t, h)
    watch(m, t)
    if m.mode == AUTO:
        run_auto(m, t, h)
    run_mode(m, t, h)
    detect_landing(m, h)
    watch_crash(m, t, h)
    watch_thrust(m, t, h)
    learn_hover_throttle(m, h)
    disarm_after_delay(m, t)
    if not silent:
        telemetry(m, t)
    _publish(m)
    return 0


class Autopilot(Model):
    """Multirotor autopilot with ArduCopter's flight behaviour and MAVLink behaviour."""

    step_size = _STEP
    variables = VARIABLES
    kernels = (start, advance)
    errors: ClassVar = {
        _NO_MIXER: "no mixer for the vehicle's airframe; valid: quad_x (1), hexa_x (2), octa_x (3), y6 (4), "
        "quad_plus (9)",
        _BAD_SYSID: "SYSID_THISMAV is not within 1 to 255",
        _NOT_FINITE: "a motion input is not a finite number, or the attitude is not a quaternion",
        _BAD_LEAN: "ANGLE_MAX is not within 500 to 8000 (5 to 80 degrees)",
        _BAD_GAIN: "PSC_POSXY_P, PSC_POSZ_P, PSC_JERK_XY, PSC_JERK_Z, WPNAV_ACCEL and WPNAV_ACCEL_Z must be positive",
    }
