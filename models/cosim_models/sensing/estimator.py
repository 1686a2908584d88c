"""The estimator FMU, which replaces a vehicle's true motion by an estimate from simulated sensors.

It is connected between a vehicle and its autopilot. An observer with constant gains, the steady state of a Kalman
filter with constant noise, fuses noisy sensors (`sensors`). The IMU is integrated in every step; GPS, barometer and
magnetometer provide corrections. A GPS fix is compared with the estimate at the time when it was taken, one lag
earlier. Errors of the horizontal velocity correct the tilt and the gyro biases, because a tilt error causes
acceleration. Errors of the height correct the climb rate and the accelerometer bias. The direction of the magnetic
field corrects the heading. With `use_truth`, the output is the true motion, one step late.

Not here: wind, terrain, redundant sensors and their selection, and health reports: the autopilot uses its own start-up
times. The estimate is initialised with the true motion.

Source: J. A. Farrell, Aided navigation, chapter 7 (observers with constant gain); gains by pole placement.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from cosim import Input, Memory, Model, Output, Parameter, State, kernel
from cosim.frames import conjugate, multiply, normalize, rotate, rotate_inverse
from cosim.vehicle import MOTION_INPUTS, VEHICLE_OUTPUTS, Airframe
from cosim.verdict import Bound, Logged
from cosim_models.sensing.sensors import (
    begin_sensors,
    is_silent,
    sense_barometer,
    sense_gps,
    sense_imu,
    sense_magnetometer,
)

__all__ = ["Estimator"]

_STEP = 0.0025
_NOT_FINITE, _BAD_RATE = 1, 2
_GRAVITY = 9.80665  # m/s2
_SLACK = 1e-9  # s
_ASTRAY = 5.0  # m
_FIXES = 8  # maximum number of GPS fixes in transit
_FIX = 13  # measured and then estimated position and velocity, and the time of arrival
_ARRIVES = 12

Quaternion = tuple[float, float, float, float]


@kernel
def _quaternion(a: Any) -> Quaternion:
    return (float(a[0]), float(a[1]), float(a[2]), float(a[3]))


@kernel
def _motion_is_good(m: Any) -> bool:
    total = 0.0
    length = 0.0
    for i in range(3):
        total += m.true_position[i] + m.true_velocity[i] + m.true_angular_velocity[i] + m.true_specific_force[i]
    for i in range(4):
        length += m.true_attitude[i] * m.true_attitude[i]
    return math.isfinite(total) and math.isfinite(length) and length > 1e-6


@kernel
def start(m: Any) -> int:
    """Initialises the estimate with the true motion; the biases are unknown."""
    if not _motion_is_good(m):
        return _NOT_FINITE
    if m.gps_lag * m.gps_rate > _FIXES - 1 or min(m.gps_rate, m.barometer_rate, m.magnetometer_rate) <= 0.0:
        return _BAD_RATE
    m.airframe = m.true_airframe
    q = normalize(_quaternion(m.true_attitude))
    for i in range(4):
        m.q[i] = q[i]
    for i in range(3):
        m.position_ned[i] = m.true_position[i]
        m.velocity_ned[i] = m.true_velocity[i]
    begin_sensors(m)
    _hand_on_truth(m)
    return 0


@kernel
def _hand_on_truth(m: Any) -> None:
    q = normalize(_quaternion(m.true_attitude))
    for i in range(4):
        m.attitude[i] = q[i]
    for i in range(3):
        m.position[i] = m.true_position[i]
        m.velocity[i] = m.true_velocity[i]
        m.angular_velocity[i] = m.true_angular_velocity[i]
        m.specific_force[i] = m.true_specific_force[i]


# ---- prediction ----------------------------------------------------------------------------------------------------


@kernel
def _turn(m: Any, x: float, y: float, z: float) -> None:
    """Rotates the estimated attitude by the small rotation vector (x, y, z) [rad, FRD]."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    s = math.sin(half) / angle if angle > 1e-12 else 0.5
    q = normalize(multiply(_quaternion(m.q), (math.cos(half), x * s, y * s, z * s)))
    for i in range(4):
        m.q[i] = q[i]


@kernel
def _predict(m: Any, h: float) -> None:
    """Integrates the IMU over h."""
    for i in range(3):
        m.angular_velocity[i] = m.gyro_frd[i] - m.gyro_offset_frd[i]
        m.specific_force[i] = m.force_frd[i]
    m.specific_force[2] -= m.accel_offset
    w, f = m.angular_velocity, m.specific_force
    _turn(m, w[0] * h, w[1] * h, w[2] * h)
    an, ae, ad = rotate(_quaternion(m.q), (float(f[0]), float(f[1]), float(f[2])))
    ad += _GRAVITY
    m.position_ned[0] += (m.velocity_ned[0] + 0.5 * an * h) * h
    m.position_ned[1] += (m.velocity_ned[1] + 0.5 * ae * h) * h
    m.position_ned[2] += (m.velocity_ned[2] + 0.5 * ad * h) * h
    m.velocity_ned[0] += an * h
    m.velocity_ned[1] += ae * h
    m.velocity_ned[2] += ad * h


# ---- corrections ---------------------------------------------------------------------------------------------------


@kernel
def _correct_by_gps(m: Any, r: Any, dt: float) -> None:
    """Corrects horizontal position, velocity, tilt and gyro offsets by fix `r`, received dt after the previous one."""
    w = m.gps_gain
    for i in range(2):
        place, speed = r[i] - r[6 + i], r[3 + i] - r[9 + i]
        m.position_ned[i] += m.gps_position_gain * dt * place
        m.velocity_ned[i] += 3.0 * w * dt * speed
        r[3 + i] = speed
    # A tilt error about an axis causes acceleration across it, g times the angle: (s + w)^3 = 0, three poles at w.
    tilt = 3.0 * w * w / _GRAVITY * dt
    drift = w * w * w / _GRAVITY * dt
    x, y, _ = rotate_inverse(_quaternion(m.q), (float(r[4]), -float(r[3]), 0.0))
    _turn(m, tilt * x, tilt * y, 0.0)
    m.gyro_offset_frd[0] -= drift * x
    m.gyro_offset_frd[1] -= drift * y


@kernel
def _correct_by_barometer(m: Any, height: float, dt: float) -> None:
    w = m.barometer_gain
    error = -height - m.position_ned[2]
    m.position_ned[2] += 3.0 * w * dt * error
    m.velocity_ned[2] += 3.0 * w * w * dt * error
    m.accel_offset -= w * w * w * dt * error


@kernel
def _correct_by_field(m: Any, dt: float) -> None:
    """Rotates the estimate about the vertical to align the measured magnetic field with its known direction."""
    f = m.field_frd
    n, e, _ = rotate(_quaternion(m.q), (float(f[0]), float(f[1]), float(f[2])))
    if n * n + e * e < 1e-6:
        return
    error = m.field_declination - math.atan2(e, n)
    error -= 2.0 * math.pi * math.floor((error + math.pi) / (2.0 * math.pi))
    x, y, z = rotate_inverse(_quaternion(m.q), (0.0, 0.0, error))
    w = m.magnetometer_gain
    _turn(m, 2.0 * w * dt * x, 2.0 * w * dt * y, 2.0 * w * dt * z)
    m.gyro_offset_frd[2] -= w * w * dt * z


@kernel
def _take_fix(m: Any, t: float) -> None:
    """Takes a new fix, which arrives after gps_lag."""
    row = m.fixes[m.fix_next]
    sense_gps(m, m.gps_count, 1.0 / m.gps_rate, row)
    for i in range(3):
        row[6 + i] = m.position_ned[i]
        row[9 + i] = m.velocity_ned[i]
    row[_ARRIVES] = t + m.gps_lag
    m.gps_count += 1
    m.fix_next = (m.fix_next + 1) % _FIXES
    m.fix_waiting += 1


@kernel
def _correct(m: Any, t: float) -> None:
    """Applies the corrections due at t."""
    if t >= m.gps_count / m.gps_rate - _SLACK:
        if is_silent(m.gps_outage, t):
            m.gps_count += 1
        else:
            _take_fix(m, t)
    if m.fix_waiting > 0:
        row = m.fixes[(m.fix_next - m.fix_waiting) % _FIXES]
        if t >= row[_ARRIVES] - _SLACK:
            m.fix_waiting -= 1
            _correct_by_gps(m, row, 1.0 / m.gps_rate)
    if t >= m.barometer_count / m.barometer_rate - _SLACK:
        height = sense_barometer(m, m.barometer_count, 1.0 / m.barometer_rate)
        if not is_silent(m.barometer_outage, t):
            _correct_by_barometer(m, height, 1.0 / m.barometer_rate)
        m.barometer_count += 1
    if t >= m.magnetometer_count / m.magnetometer_rate - _SLACK:
        sense_magnetometer(m, m.magnetometer_count, m.field_frd)
        m.magnetometer_count += 1
        if not is_silent(m.magnetometer_outage, t):
            _correct_by_field(m, 1.0 / m.magnetometer_rate)


@kernel
def _note_errors(m: Any) -> None:
    distance = 0.0
    for i in range(3):
        distance += (m.position_ned[i] - m.true_position[i]) ** 2
    m.position_error = math.sqrt(distance)
    off = multiply(conjugate(normalize(_quaternion(m.true_attitude))), _quaternion(m.q))
    m.attitude_error = 2.0 * math.atan2(math.sqrt(off[1] * off[1] + off[2] * off[2] + off[3] * off[3]), abs(off[0]))


@kernel
def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Computes the estimate at t + h: the sensors' samples of the true motion at t, integrated over h."""
    if not _motion_is_good(m):
        return _NOT_FINITE
    if m.use_truth:
        _hand_on_truth(m)
        m.position_error = 0.0
        m.attitude_error = 0.0
        return 0
    sense_imu(m, m.imu_count, h)
    m.imu_count += 1
    _correct(m, m.clock)
    _note_errors(m)
    _predict(m, h)
    m.clock += h
    for i in range(3):
        m.position[i] = m.position_ned[i]
        m.velocity[i] = m.velocity_ned[i]
    for i in range(4):
        m.attitude[i] = m.q[i]
    return 0


_TRUE_MOTION = tuple(
    Input(f"true_{v.name}", type=Airframe, start=Airframe.quad_x, description=v.description)
    if v.name == "airframe"
    else Input(f"true_{v.name}", shape=v.shape[0], unit=v.unit, start=v.start, description=f"true {v.description}")
    for v in MOTION_INPUTS
)
_ESTIMATE = tuple(
    Output(v.name, type=Airframe, start=Airframe.quad_x, depends=("true_airframe",), description=v.description)
    if v.name == "airframe"
    else Output(
        v.name,
        shape=v.shape[0],
        unit=v.unit,
        start=v.start,
        depends=tuple(f"true_{w.name}" for w in MOTION_INPUTS if w.name != "airframe"),
        description=f"estimated {v.description}",
    )
    for v in VEHICLE_OUTPUTS
)


def _size(name: str, unit: str, start: float, description: str, minimum: float = 0.0) -> Any:
    return Parameter(name, unit=unit, start=start, minimum=minimum, description=description)


def _outage(sensor: str) -> Any:
    text = f"the {sensor} gives no samples from the first to the second time; equal times: no outage"
    return Parameter(f"{sensor}_outage", shape=2, unit="s", start=0.0, rare=True, description=text)


def _failure(sensor: str, unit: str, what: str) -> Any:
    text = f"error of a failed sensor: {what}"
    return Parameter(f"{sensor}_failure", shape=3, unit=unit, start=0.0, rare=True, description=text)


class Estimator(Model):
    """Estimates the motion from simulated sensors with noise, lag and drift."""

    step_size = _STEP
    variables = (
        *_TRUE_MOTION,
        Parameter("use_truth", type=bool, start=False, tunable=True, description="output the true motion"),
        Parameter("seed", type=int, start=1, description="seed of the noise of all sensors"),
        Parameter(
            "identity",
            type=int,
            start=1,
            description="identity of the vehicle; different identities have different noise",
        ),
        _size("gyro_noise", "1", 1.7e-4, "noise density in rad/s per square root of Hz"),
        _size("gyro_bias", "rad/s", 2e-3, "standard deviation of the bias"),
        _size("accel_noise", "1", 2e-3, "noise density in m/s2 per square root of Hz"),
        _size("accel_bias", "m/s2", 0.02, "standard deviation of the bias"),
        _size("gps_rate", "Hz", 5.0, "rate of GPS fixes"),
        _size("gps_lag", "s", 0.1, "delay from a fix to its arrival"),
        _size("gps_position_noise", "m", 0.15, "standard deviation of a fix"),
        _size("gps_velocity_noise", "m/s", 0.08, "standard deviation of a fix's velocity"),
        _size("gps_drift", "m", 0.4, "standard deviation of the slow error"),
        _size("gps_drift_time", "s", 200.0, "correlation time of the slow error", 1e-3),
        _size("barometer_rate", "Hz", 50.0, "rate of barometer samples"),
        _size("barometer_noise", "m", 0.1, "standard deviation"),
        _size("barometer_drift", "m", 0.2, "standard deviation of the slow error"),
        _size("barometer_drift_time", "s", 300.0, "correlation time of the slow error", 1e-3),
        _size("magnetometer_rate", "Hz", 50.0, "rate of magnetometer samples"),
        _size("magnetometer_noise", "1", 0.01, "standard deviation over the field's strength"),
        Parameter("field_inclination", unit="rad", start=-1.147, description="inclination of the magnetic field, down"),
        Parameter("field_declination", unit="rad", start=0.203, description="declination of the magnetic field, east"),
        _size("gps_gain", "1/s", 0.4, "poles of velocity, tilt and gyro offsets"),
        _size("gps_position_gain", "1/s", 0.6, "pole of position"),
        _size("barometer_gain", "1/s", 0.7, "poles of height, climb rate and accelerometer offset"),
        _size("magnetometer_gain", "1/s", 0.2, "poles of heading and gyro offset"),
        *(_outage(name) for name in ("gps", "barometer", "magnetometer")),
        Parameter(
            "failure_time",
            unit="s",
            start=0.0,
            minimum=0.0,
            rare=True,
            description="time from which samples have the following errors; 0: never",
        ),
        _failure("gyro", "rad/s", "angular velocity, FRD"),
        _failure("accel", "m/s2", "specific force, FRD"),
        _failure("gps", "m", "position, NED"),
        Parameter("barometer_failure", unit="m", start=0.0, rare=True, description="error of a failed sensor: height"),
        *_ESTIMATE,
        Output(
            "position_error",
            unit="m",
            verdict=Bound(most=_ASTRAY, text="its estimate is far from the true position"),
            description="distance of the estimate from the true position",
        ),
        Output(
            "attitude_error",
            unit="rad",
            verdict=Logged(
                (("XKF1.P", "position"), ("XKF1.V", "velocity"), ("XKF1", "attitude"), ("XKF1.G", "gyro_offset_frd"))
            ),
            description="angle of the estimate from the true attitude",
        ),
        Memory("position_ned", shape=3),
        Memory("velocity_ned", shape=3),
        Memory("q", shape=4),
        Memory("gyro_frd", shape=3),
        Memory("force_frd", shape=3),
        Memory("field_frd", shape=3),
        State("gyro_offset_frd", shape=3, unit="rad/s", description="estimated bias of the gyro, FRD"),
        Memory("accel_offset"),
        Memory("bias", shape=(6, 3)),
        Memory("normal", shape=3),
        Memory("fixes", shape=(_FIXES, _FIX)),
        Memory("fix_next", dtype="i4"),
        Memory("fix_waiting", dtype="i4"),
        Memory("clock"),  # s since the start
        Memory("imu_count", dtype="i4"),
        Memory("gps_count", dtype="i4"),
        Memory("barometer_count", dtype="i4"),
        Memory("magnetometer_count", dtype="i4"),
    )
    kernels = (start, advance)
    errors: ClassVar = {
        _NOT_FINITE: "a motion input is not a finite number, or the attitude is not a quaternion",
        _BAD_RATE: "a sensor's rate is not positive, or more than 7 GPS fixes are under way (gps_lag times gps_rate)",
    }
