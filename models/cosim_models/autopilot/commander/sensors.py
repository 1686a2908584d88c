"""Failing sensors and motors, by ArduPilot's SIM_* parameters, and the reaction of the estimate.

The motion that the autopilot senses stands for the estimate of ArduPilot's EKF3. While a parameter says that a sensor
fails, the estimate has an error, which is added to that motion:

- GPS, barometer, and inertial sensors: `estimate.filter`. Without GPS, the position is lost after 7 s.
- Jammed GPS: `estimate.jamming`, heard by that filter.
- Vibration is added to the acceleration, behind the filter of the accelerometer.
- Compass: offsets other than the calibrated ones turn the heading of the estimate, slowly.

Kernels over the autopilot's record `m`.

Source: ArduPilot, SITL (SIM_GPS, SIM_Baro: the drift counts from the start) and NavEKF3 (posRetryTimeNoVel 7 s).
The gains of the heading are round numbers.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import deg_e7, geodetic_from_local, multiply, rotate, rotate_inverse, wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.commander.estimate.filter import (
    LANES,
    begin_filters,
    err_by_drift,
    force_error,
    ratio,
    reset_side,
    run_filters,
    stop_aiding,
)
from cosim_models.autopilot.commander.estimate.inertial import (
    drift,
    drift_rate,
    errs,
    gyro_error,
    has_two,
    imu_of,
    shake_gyro,
)
from cosim_models.autopilot.commander.estimate.lanes import change_lane, flies_by_other, must_return, wants_other
from cosim_models.autopilot.commander.wind import watch_wind, wind_is_on
from cosim_models.autopilot.control.motors import GROUND_IDLE
from cosim_models.autopilot.link.statustext import (
    CRITICAL,
    GLITCH,
    GLITCH_CLEARED,
    INFO,
    NO_NUMBER,
    STOPPED_AIDING,
    USING_GPS,
    WARNING,
    say,
)

__all__ = ["add_errors", "fail_motors", "told_by_gps", "watch_sensors"]

_PER_DEGREE = 111318.84502145034  # m of latitude, ArduPilot's LATLON_TO_M
_LOST, _UNAIDED = 7.0, 15.0  # s without GPS: the position is lost, and nothing holds the tilt
_GLITCH_BEGINS, _GLITCH_ENDS = 1.0, 10.0  # s of rejection, and without it
_GAIN_YAW = 0.2  # 1/s
_FIELD = (230.0, 51.0, -528.0)  # mGauss, magnetic field at ArduPilot's field near Canberra, NED
_CALIBRATED = (5.0, 13.0, -18.0)  # mGauss, offsets of the simulated compass
_NEVER = -1.0
_FRESH = 0.21  # s, age of a fix with a new one every 0.2 s
_SAME = 1e-3  # m, m/s, rad
_SAME_RATE = 1e-5  # rad/s
_PERIOD = 0.1  # s, of `watch_sensors`
_LEARNING_YAW = 0.01  # 1/s2, of the error of the heading


@kernel
def _compass_offset(m: Any) -> tuple[float, float, float]:
    """Returns the offset [mGauss], FRD, that is not calibrated."""
    c = _CALIBRATED
    return m.SIM_MAG1_OFS_X - c[0], m.SIM_MAG1_OFS_Y - c[1], m.SIM_MAG1_OFS_Z - c[2]


@kernel
def vibrates(m: Any) -> bool:
    """Returns whether the accelerometer vibrates while motors turn."""
    return bool(m.SIM_ACC1_RND > 0.0 and m.SIM_VIB_FREQ_X + m.SIM_VIB_FREQ_Y + m.SIM_VIB_FREQ_Z > 0.0)


@kernel
def _is_jammed(m: Any, t: float) -> bool:
    """Returns whether GPS is jammed, by its parameter or in the area of the jamming."""
    if m.SIM_GPS1_JAM != 0:
        return True
    if m.gps_jamming_radius <= 0.0 or t < m.gps_jamming_start or t >= m.gps_jamming_stop:
        return False
    n, e = m.position[0] - m.gps_jamming_north, m.position[1] - m.gps_jamming_east
    return bool(n * n + e * e <= m.gps_jamming_radius * m.gps_jamming_radius)


@kernel
def _is_left(m: Any) -> bool:
    """Returns whether a lane has an error."""
    for lane in range(LANES):
        x, b = m.lane_now[lane], m.lane_learned[lane]
        for i in range(8):
            if abs(x[i]) > _SAME:
                return True
        if abs(b[0]) + abs(b[1]) + abs(b[2]) > _SAME_RATE:
            return True
    return False


@kernel
def _estimate_errs(m: Any) -> bool:
    """Returns whether GPS, the barometer or an inertial sensor fails, or the estimate still has an error of that."""
    if m.SIM_GPS1_ENABLE == 0 or m.gps_jammed or m.SIM_BARO_DRIFT != 0.0 or m.SIM_BARO_GLITCH != 0.0:
        return True
    if m.SIM_GPS1_GLTCH_X != 0.0 or m.SIM_GPS1_GLTCH_Y != 0.0 or m.SIM_GPS1_GLTCH_Z != 0.0:
        return True
    if errs(m, imu_of(m, 0)) or (has_two(m) and errs(m, imu_of(m, 1))) or flies_by_other(m):
        return True
    return bool(m.sim_on and m.estimate_errs and (_is_left(m) or m.glitching or m.position_lost))


@kernel
def _is_on(m: Any) -> bool:
    """Returns whether a sensor or motor fails, or the estimate still has an error."""
    if m.estimate_errs or m.SIM_ENGINE_FAIL != 0 or (m.SIM_GYR1_RND != 0.0 and m.imu == 0):
        return True
    off = _compass_offset(m)
    if abs(off[0]) + abs(off[1]) + abs(off[2]) > _SAME:
        return True
    return bool(wind_is_on(m) or vibrates(m) or (m.sim_on and abs(m.yaw_error) > _SAME))


@kernel
def _watch_glitch(m: Any, t: float) -> None:
    """Tells of fixes that are rejected, or that claim to err, and of their end."""
    if m.velocity_ratio < 1.0 and m.position_ratio < 1.0:
        m.gps_rejected_at = _NEVER
    elif m.gps_rejected_at == _NEVER:
        m.gps_rejected_at = t
    if m.gps_rejected_at != _NEVER and t - m.gps_rejected_at >= _GLITCH_BEGINS:
        m.glitch_seen_at = t
        m.gps_rejected = True
    elif m.gps_rejected_at == _NEVER and t - m.glitch_seen_at >= _GLITCH_ENDS:
        m.gps_rejected = False
    glitching = m.gps_rejected or (m.estimate_errs and m.gps_doubtful)
    if glitching != m.glitching:
        m.glitching = glitching
        say(m, CRITICAL, GLITCH if glitching else GLITCH_CLEARED, NO_NUMBER)


@kernel
def _tell_lanes(m: Any, severity: int, text: int) -> None:
    """Says a text with the number of the inertial sensor, for each lane."""
    for lane in range(LANES if has_two(m) else 1):
        say(m, severity, text, imu_of(m, lane))


@kernel
def _watch_gps(m: Any, t: float) -> None:
    """Looks whether GPS is lost, and what it and the barometer tell."""
    m.told_error[2] = -m.SIM_BARO_DRIFT * t - m.SIM_BARO_GLITCH
    if not m.gps_jammed or m.jammed_at == _NEVER:
        m.told_error[0] = m.SIM_GPS1_GLTCH_X * _PER_DEGREE
        m.told_error[1] = m.SIM_GPS1_GLTCH_Y * _PER_DEGREE * math.cos(m.origin_latitude)
    if not m.gps_jammed or m.SIM_GPS1_ENABLE == 0:
        m.gps_heard = m.SIM_GPS1_ENABLE != 0
    if m.SIM_GPS1_ENABLE == 0:
        if m.gps_lost_at == _NEVER:
            m.gps_lost_at = t
            err_by_drift(m, drift_rate(m, t))
        drift(m, m.gps_lost_at, t)
        if t - m.gps_lost_at >= _LOST:
            m.position_lost = True
        if t - m.gps_lost_at >= _UNAIDED and not m.unaided:
            m.unaided = True
            for lane in range(LANES):
                stop_aiding(m, lane)
            _tell_lanes(m, WARNING, STOPPED_AIDING)
        return
    m.gps_lost_at = _NEVER
    if m.gps_jammed and m.jammed_at != _NEVER:
        drift(m, m.jammed_at, t)
    if m.position_lost:
        m.position_lost = False
        for lane in range(LANES):
            reset_side(m, lane, t)
        if m.unaided:
            m.unaided = False
            _tell_lanes(m, INFO, USING_GPS)


@kernel
def _watch_ratios(m: Any) -> None:
    """Tells how far the measurements are beyond their gates."""
    m.velocity_ratio, m.position_ratio = ratio(m, m.lane, 0), ratio(m, m.lane, 1)
    m.height_ratio = ratio(m, m.lane, 2)
    if m.SIM_GPS1_ENABLE == 0:
        m.velocity_ratio = m.position_ratio = 0.0


@kernel
def _watch_compass(m: Any) -> None:
    """Sets the rate at which the heading of the estimate moves to that of the compass."""
    w, x, y, z = m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]
    fx, fy, fz = rotate((w, -x, -y, -z), _FIELD)
    off = _compass_offset(m)
    n, e, _ = rotate((w, x, y, z), (fx + off[0], fy + off[1], fz + off[2]))
    wrong = math.atan2(_FIELD[1], _FIELD[0]) - math.atan2(e, n)
    m.yaw_error_rate = _GAIN_YAW * wrap_pi(wrong - m.yaw_error)


@kernel
def _turn(m: Any) -> None:
    """Adds to the rate of the heading's error that of the gyro, which learns from the compass."""
    b, c = gyro_error(m, m.imu), m.lane_learned[m.lane]
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    m.yaw_error_rate += rotate(q, (b[0] - c[0], b[1] - c[1], b[2] - c[2]))[2]
    learned = rotate_inverse(q, (0.0, 0.0, _PERIOD * _LEARNING_YAW * float(m.yaw_error)))
    for i in range(3):
        c[i] += learned[i]


@kernel
def _reset_near_failsafe(m: Any, t: float) -> None:
    """Sets the filter of the lane that flies to GPS where the fail-safe of the estimate is near."""
    if m.reset_asked and m.gps_heard and not m.gps_jammed and m.velocity_ratio >= 1.0:
        x = m.lane_past[m.lane]
        if x[3] * x[3] + x[4] * x[4] > x[5] * x[5]:
            reset_side(m, m.lane, t)
    m.reset_asked = False


@kernel
def watch_sensors(m: Any, t: float) -> None:
    """Updates which sensors fail, and how the estimate does; called ten times a second."""
    watch_wind(m)
    m.gps_jammed = _is_jammed(m, t + m.booted_at)
    was, erred = m.sim_on, m.sim_on and m.estimate_errs
    m.estimate_errs = _estimate_errs(m)
    if m.estimate_errs and not erred:
        begin_filters(m, t)
    if must_return(m):
        change_lane(m, t)
    m.sim_on = _is_on(m)
    if not m.sim_on:
        m.position_ratio = m.velocity_ratio = m.height_ratio = 0.0
        return
    if not was:
        m.gps_lost_at = m.gps_rejected_at = _NEVER
        m.yaw_error = m.vibration_phase = m.smooth_position_ratio = m.smooth_velocity_ratio = 0.0
        for i in range(3):
            m.estimate_error[i] = m.gyro_delays[i, 0] = m.gyro_delays[i, 1] = 0.0
    _watch_compass(m)
    m.gyro_drift = 0.0
    if m.estimate_errs:
        _watch_gps(m, t)
        _turn(m)
        _reset_near_failsafe(m, t)
        _watch_ratios(m)
    else:
        m.position_ratio = m.velocity_ratio = m.height_ratio = 0.0
    if not m.gps_jammed or t - m.gps_taken_at < _FRESH:
        _watch_glitch(m, t)


@kernel
def _vibration(m: Any, frequency: float) -> float:
    """Returns the acceleration [m/s2] of a vibration behind the filter of the accelerometer, of second order."""
    if frequency <= 0.0:
        return 0.0
    left = 1.0
    if m.INS_ACCEL_FILTER > 0.0:
        left = 1.0 / math.sqrt(1.0 + (frequency / m.INS_ACCEL_FILTER) ** 4)
    return float(m.SIM_ACC1_RND * left * math.sin(2.0 * math.pi * frequency * m.vibration_phase))


@kernel
def _shake(m: Any, dt: float) -> None:
    """Adds the vibration to the sensed acceleration."""
    m.vibration_phase += dt
    x, y, z = _vibration(m, m.SIM_VIB_FREQ_X), _vibration(m, m.SIM_VIB_FREQ_Y), _vibration(m, m.SIM_VIB_FREQ_Z)
    n, e, d = rotate((float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3])), (x, y, z))
    m.acceleration_neu[0] += n
    m.acceleration_neu[1] += e
    m.acceleration_neu[2] -= d


@kernel
def _add_estimate(m: Any, t: float, dt: float) -> None:
    """Adds the errors of the lane that flies to place, velocity, acceleration, angular velocity and attitude."""
    if run_filters(m, LANES if has_two(m) else 1, dt) > 0 and wants_other(m, t):
        change_lane(m, t)
    lane = int(m.lane)
    force = force_error(m, lane)
    b, c, x = gyro_error(m, m.imu), m.lane_learned[lane], m.lane_now[lane]
    for i in range(3):
        sign = -1.0 if i == 2 else 1.0
        m.gyro[i] += b[i] - c[i]
        m.estimate_error[i] = sign * x[i]
        m.position_neu[i] += sign * x[i]
        m.velocity_neu[i] += sign * (m.lane_rate[lane, 1] if i == 2 and m.vibration_failsafe else x[3 + i])
        m.acceleration_neu[i] += sign * force[i]
    n, e = 0.5 * x[7], -0.5 * x[6]
    w = 1.0 / math.sqrt(1.0 + n * n + e * e)
    turned = multiply((w, w * n, w * e, 0.0), (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3])))
    m.q[0], m.q[1], m.q[2], m.q[3] = turned


@kernel
def add_errors(m: Any, t: float, dt: float) -> None:
    """Adds the errors of the estimate to the sensed motion."""
    if m.estimate_errs:
        _add_estimate(m, t, dt)
    if vibrates(m) and m.armed and m.spool_state > GROUND_IDLE:
        _shake(m, dt)
    m.yaw_error = wrap_pi(m.yaw_error + m.yaw_error_rate * dt)
    c, s = math.cos(0.5 * m.yaw_error), math.sin(0.5 * m.yaw_error)
    w, x, y, z = m.q[0], m.q[1], m.q[2], m.q[3]
    m.q[0], m.q[1], m.q[2], m.q[3] = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
    c, s = math.cos(m.yaw_error), math.sin(m.yaw_error)
    n, e = m.acceleration_neu[0], m.acceleration_neu[1]
    m.acceleration_neu[0], m.acceleration_neu[1] = c * n - s * e, s * n + c * e
    if m.SIM_GYR1_RND != 0.0 and m.imu == 0:
        shake_gyro(m, dt)


@kernel
def told_by_gps(m: Any) -> tuple[int, int, float]:
    """Returns latitude and longitude [degE7] and altitude [m] as GPS tells them: the true place, and its errors."""
    e = m.estimate_error
    n, east, d = m.position_neu[0] - e[0], m.position_neu[1] - e[1], e[2] - m.position_neu[2]
    if m.gps_jammed and m.jammed_at != _NEVER:
        lat, lon, alt = geodetic_from_local(
            m.jam_place[0], m.jam_place[1], d, m.origin_latitude, m.origin_longitude, m.origin_altitude
        )
        return deg_e7(lat), deg_e7(lon), alt + m.SIM_GPS1_GLTCH_Z
    lat, lon, alt = geodetic_from_local(n, east, d, m.origin_latitude, m.origin_longitude, m.origin_altitude)
    lat, lon = lat + math.radians(m.SIM_GPS1_GLTCH_X), lon + math.radians(m.SIM_GPS1_GLTCH_Y)
    return deg_e7(lat), deg_e7(lon), alt + m.SIM_GPS1_GLTCH_Z


@kernel
def fail_motors(m: Any) -> None:
    """Multiplies the commands of the motors in SIM_ENGINE_FAIL by SIM_ENGINE_MUL."""
    for i in range(m.motor_count):
        if (m.SIM_ENGINE_FAIL >> i) & 1 != 0:
            m.motor[i] *= m.SIM_ENGINE_MUL
