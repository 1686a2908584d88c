"""Errors of the inertial sensors, by SIM_ACC1_BIAS_*, SIM_ACC2_BIAS_*, SIM_GYR1_*, SIM_GYR2_* and SIM_DRIFT_*.

Kernels over the autopilot's record `m`. Sensors are counted from 0.

Source: ArduPilot, AP_InertialSensor_SITL (noise and drift of the gyro) and NavEKF3 (EK3_IMU_MASK).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.kernel import kernel
from cosim.random_numbers import threefry
from cosim_models.autopilot.control.low_pass import low_pass

__all__ = [
    "GRAVITY",
    "accelerometer_error",
    "drift",
    "drift_rate",
    "errs",
    "gyro_error",
    "has_two",
    "imu_of",
    "shake_gyro",
]

GRAVITY = 9.80665  # m/s2
_FRAMES = 1200.0  # Hz of ArduPilot's simulator, in each of which it draws a number
_KEY = 0x4759524F  # of the random numbers
_UNIT = 2.0 / 4294967296.0
_BOTH, _FIRST = 3, 1  # EK3_IMU_MASK
_LAG = 19.4  # s, by which what the filter of `filter` has learned of a drift is late in hover, after two minutes


@kernel
def imu_of(m: Any, lane: int) -> int:
    """Returns the inertial sensor, from 0, of a lane; INS_USE and INS_USE2 leave sensors out."""
    imu = lane if (m.EK3_IMU_MASK & _FIRST) != 0 else 1
    if imu == 0 and m.INS_USE == 0 and m.INS_USE2 != 0:
        return 1
    if imu == 1 and m.INS_USE2 == 0 and m.INS_USE != 0:
        return 0
    return imu


@kernel
def has_two(m: Any) -> bool:
    """Returns whether the estimate has two lanes."""
    return bool((m.EK3_IMU_MASK & _BOTH) == _BOTH)


@kernel
def accelerometer_error(m: Any, imu: int) -> tuple[float, float, float]:
    """Returns the error of an accelerometer, from 0 [m/s2, FRD]."""
    if imu == 0:
        return float(m.SIM_ACC1_BIAS_X), float(m.SIM_ACC1_BIAS_Y), float(m.SIM_ACC1_BIAS_Z)
    return float(m.SIM_ACC2_BIAS_X), float(m.SIM_ACC2_BIAS_Y), float(m.SIM_ACC2_BIAS_Z)


@kernel
def gyro_error(m: Any, imu: int) -> tuple[float, float, float]:
    """Returns the error of a gyro, from 0 [rad/s, FRD]."""
    d = float(m.gyro_drift)
    if imu == 0:
        return m.SIM_GYR1_BIAS_X + d, m.SIM_GYR1_BIAS_Y + d, m.SIM_GYR1_BIAS_Z + d
    return m.SIM_GYR2_BIAS_X + d, m.SIM_GYR2_BIAS_Y + d, m.SIM_GYR2_BIAS_Z + d


@kernel
def drift(m: Any, since: float, t: float) -> None:
    """Lets the gyros drift from a time on [s], on all axes alike: what the estimate does not learn, without GPS."""
    m.gyro_drift = drift_rate(m, t) * (t - since + _LAG)


@kernel
def drift_rate(m: Any, t: float) -> float:
    """Returns the rate at which the gyros drift [rad/s2]."""
    if m.SIM_DRIFT_TIME <= 0.0:
        return 0.0
    way = 1.0 if t % (120.0 * m.SIM_DRIFT_TIME) < 60.0 * m.SIM_DRIFT_TIME else -1.0
    return float(way * math.radians(m.SIM_DRIFT_SPEED) / 60.0)


@kernel
def errs(m: Any, imu: int) -> bool:
    """Returns whether the parameters let an inertial sensor err."""
    a, b = accelerometer_error(m, imu), gyro_error(m, imu)
    return bool(abs(a[0]) + abs(a[1]) + abs(a[2]) + abs(b[0]) + abs(b[1]) + abs(b[2]) > 0.0)


@kernel
def shake_gyro(m: Any, h: float) -> None:
    """Adds the noise SIM_GYR1_RND, behind the filter of the gyro, to the angular velocity.

    Evenly distributed up to the parameter times the mean throttle. It is weaker by the root of the ratio of the steps,
    so that the filter lets as much of it through as of ArduPilot's.
    """
    throttle = 0.0
    for i in range(m.motor_count):
        throttle += m.motor[i] / m.motor_count
    most = math.radians(m.SIM_GYR1_RND) * throttle / math.sqrt(max(1.0, _FRAMES * h))
    a, b = threefry(_KEY, m.SYSID_THISMAV, m.gyro_draws, 0)
    c, _ = threefry(_KEY, m.SYSID_THISMAV, m.gyro_draws, 1)
    m.gyro_draws += 1
    m.gyro[0] += low_pass(m.gyro_delays[0], m.gyro_filter, most * (a * _UNIT - 1.0))
    m.gyro[1] += low_pass(m.gyro_delays[1], m.gyro_filter, most * (b * _UNIT - 1.0))
    m.gyro[2] += low_pass(m.gyro_delays[2], m.gyro_filter, most * (c * _UNIT - 1.0))
