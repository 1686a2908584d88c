"""Simulated sensors of a vehicle: IMU, GPS receiver, barometer and magnetometer.

Each sensor has a rate and white noise. In addition, the IMU has constant biases, GPS and barometer have slowly varying
errors (Gauss-Markov), and the GPS has a lag. Noise is a function of seed, identity, sensor and sample number
(`random_numbers`). Kernels over the record `m` of an `Estimator`; NED, FRD, SI.

On a schedule, GPS, barometer and magnetometer give no samples (`is_silent`), and from `failure_time` on, the samples of
IMU, GPS and barometer have an additional error.

Not here: temperature, vibration, magnetic disturbances, and offsets between sensors and centre of mass.

Source: P. D. Groves, Principles of GNSS, inertial and multisensor integrated navigation systems, chapters 4 and 14.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import rotate_inverse
from cosim.kernel import kernel
from cosim.random_numbers import normal_pair

__all__ = [
    "ACCEL",
    "BARO",
    "GPS",
    "GYRO",
    "MAG",
    "begin_sensors",
    "is_silent",
    "sense_barometer",
    "sense_gps",
    "sense_imu",
    "sense_magnetometer",
]

GYRO, ACCEL, GPS, GPS_VELOCITY, BARO, MAG = range(6)
"""Streams of random numbers, four triples each."""

_IMU_STEP = 1e-5
"""Minimum time between samples of the IMU, s; in shorter steps it holds the last sample. The noise of a sample is
inversely proportional to the square root of the time since the previous one, and would diverge in steps of 1e-13 s,
which some engines take."""
_SLACK = 1e-9  # s
_WANDER = 100  # added to the stream: random numbers of the bias processes
_START = 200  # added to the stream: random numbers of the initial biases


@kernel
def _triple(m: Any, stream: int, number: int, out: Any) -> None:
    """Writes three standard normal numbers, the `number`th triple of a stream, to `out`."""
    out[0], out[1] = normal_pair(m.seed, m.identity, 2 * number, stream)
    out[2], _ = normal_pair(m.seed, m.identity, 2 * number + 1, stream)


@kernel
def _wander(m: Any, stream: int, number: int, bias: Any, size: float, time: float, dt: float) -> None:
    """Advances a bias by dt: a Gauss-Markov process of standard deviation `size` and correlation time `time`."""
    if size <= 0.0:
        return
    keep = math.exp(-dt / time)
    fresh = size * math.sqrt(1.0 - keep * keep)
    _triple(m, stream + _WANDER, number, m.normal)
    for i in range(3):
        bias[i] = keep * bias[i] + fresh * m.normal[i]


@kernel
def begin_sensors(m: Any) -> None:
    """Draws the biases at power-on."""
    for stream in range(6):
        _triple(m, stream + _START, 0, m.normal)
        size = m.gyro_bias if stream == GYRO else m.accel_bias if stream == ACCEL else 0.0
        size = m.gps_drift if stream == GPS else m.barometer_drift if stream == BARO else size
        for i in range(3):
            m.bias[stream, i] = size * m.normal[i]


@kernel
def is_silent(outage: Any, t: float) -> bool:
    """Returns whether a sensor gives no samples at `t` [s]: from outage[0] up to, but not at, outage[1]."""
    return bool(outage[0] - _SLACK <= t < outage[1] - _SLACK)


@kernel
def _has_failed(m: Any) -> bool:
    return bool(m.failure_time > 0.0 and m.clock >= m.failure_time - _SLACK)


@kernel
def sense_imu(m: Any, number: int, dt: float) -> None:
    """Sets m.gyro_frd [rad/s] and m.force_frd [m/s2] to the `number`th sample of the IMU, dt after the previous one.

    In a step shorter than the minimum, the previous sample is kept.
    """
    if dt < _IMU_STEP and number > 0:
        return
    scale = 1.0 / math.sqrt(max(dt, _IMU_STEP))
    _triple(m, GYRO, number, m.normal)
    for i in range(3):
        m.gyro_frd[i] = m.true_angular_velocity[i] + m.bias[GYRO, i] + m.gyro_noise * scale * m.normal[i]
    _triple(m, ACCEL, number, m.normal)
    for i in range(3):
        m.force_frd[i] = m.true_specific_force[i] + m.bias[ACCEL, i] + m.accel_noise * scale * m.normal[i]
    if _has_failed(m):
        for i in range(3):
            m.gyro_frd[i] += m.gyro_failure[i]
            m.force_frd[i] += m.accel_failure[i]


@kernel
def sense_gps(m: Any, number: int, dt: float, out: Any) -> None:
    """Writes the `number`th fix: out[0:3] position [m], out[3:6] velocity [m/s]."""
    _wander(m, GPS, number, m.bias[GPS], m.gps_drift, m.gps_drift_time, dt)
    _triple(m, GPS, number, m.normal)
    for i in range(3):
        out[i] = m.true_position[i] + m.bias[GPS, i] + m.gps_position_noise * m.normal[i]
        if _has_failed(m):
            out[i] += m.gps_failure[i]
    _triple(m, GPS_VELOCITY, number, m.normal)
    for i in range(3):
        out[3 + i] = m.true_velocity[i] + m.gps_velocity_noise * m.normal[i]


@kernel
def sense_barometer(m: Any, number: int, dt: float) -> float:
    """Returns the measured height above the local origin [m]."""
    _wander(m, BARO, number, m.bias[BARO], m.barometer_drift, m.barometer_drift_time, dt)
    _triple(m, BARO, number, m.normal)
    height = float(-m.true_position[2] + m.bias[BARO, 0] + m.barometer_noise * m.normal[0])
    return height + m.barometer_failure if _has_failed(m) else height


@kernel
def sense_magnetometer(m: Any, number: int, out: Any) -> None:
    """Writes the measured direction of the field [FRD] to out[0:3]; its length is 1 except for noise."""
    q = m.true_attitude
    c = math.cos(m.field_inclination)
    field = (
        c * math.cos(m.field_declination),
        c * math.sin(m.field_declination),
        math.sin(m.field_inclination),
    )
    x, y, z = rotate_inverse((float(q[0]), float(q[1]), float(q[2]), float(q[3])), field)
    _triple(m, MAG, number, m.normal)
    out[0] = x + m.magnetometer_noise * m.normal[0]
    out[1] = y + m.magnetometer_noise * m.normal[1]
    out[2] = z + m.magnetometer_noise * m.normal[2]
