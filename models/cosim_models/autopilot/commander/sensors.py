"""Failing sensors and motors, by ArduPilot's SIM_* parameters, and the reaction of the estimate.

The motion that the autopilot senses stands for the estimate of ArduPilot's EKF3. While a parameter says that a sensor
fails, the estimate has an error, which is added to that motion:

- GPS: the estimate moves to the position that GPS tells (with the time constant of its gain) as long as that is within
  the gate; beyond, GPS is rejected, and after 10 s the estimate is reset to it. Without GPS, the position is lost after
  7 s; the error stays as it is.
- Jammed GPS: its positions and velocities are nonsense and rejected.
- Barometer: the same for the height, with a wider gate and a slower gain.
- Accelerometer: its error downwards becomes one of the climb rate, which the estimate corrects slowly (0.15/s), and not
  at all beyond its gate of 3 m/s; 2.5 s later the estimate is reset, and trusts the accelerometer again after 9.4 s.
  The vibration is added to the acceleration, behind the filter.
- Accelerometer and gyro to the side: see `inertial`.
- Compass: offsets other than the calibrated ones turn the heading of the estimate, slowly.

A reset moves the desired motion, too, so that the vehicle does not jump. Kernels over the autopilot's record `m`.

Source: ArduPilot, SITL (SIM_GPS, SIM_Baro: the drift counts from the start) and NavEKF3 (FuseVelPosNED, gates of 5
standard deviations of 0.5 m and 2 m; posRetryTimeNoVel 7 s, retry times 10 s). The gains are round numbers; those of
the accelerometer are from a flight of ArduCopter's (tests/data/arducopter/x_accelerometer_bias.csv.gz).
"""

from __future__ import annotations

import math
from typing import Any

from cosim.frames import deg_e7, geodetic_from_local, rotate, wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.commander.inertial import (
    accelerometer_error,
    add_tilt,
    errs_sideways,
    forget_tilt,
    is_tilted,
    shake_gyro,
    watch_tilt,
)
from cosim_models.autopilot.commander.lanes import (
    GAIN,
    GAIN_CLIMB,
    GAIN_FALL,
    GAIN_UP,
    GATE,
    GATE_CLIMB,
    GATE_SLIP,
    GATE_UP,
    change_lane,
    either_errs,
    forget_lanes,
    prepare_lanes,
    watch_lanes,
)
from cosim_models.autopilot.commander.wind import watch_wind, wind_is_on
from cosim_models.autopilot.control.motors import GROUND_IDLE
from cosim_models.autopilot.link.statustext import CRITICAL, GLITCH, GLITCH_CLEARED, INFO, NO_NUMBER, USING_GPS, say

__all__ = ["add_errors", "fail_motors", "told_by_gps", "watch_sensors"]

_PER_DEGREE = 111318.84502145034  # m of latitude, ArduPilot's LATLON_TO_M
_RETRY = 10.0  # s after which what is rejected is believed
_LOST = 7.0  # s without GPS
_GLITCH_BEGINS, _GLITCH_ENDS = 1.0, 10.0  # s of rejection, and without it
_GAIN_YAW = 0.2  # 1/s
_FIELD = (230.0, 51.0, -528.0)  # mGauss, magnetic field at ArduPilot's field near Canberra, NED
_CALIBRATED = (5.0, 13.0, -18.0)  # mGauss, offsets of the simulated compass
_NEVER = -1.0
_NONSENSE = 10.0  # innovation over its gate
_SAME = 1e-3  # m
_IMU_RETRY, _IMU_IGNORED = 2.5, 9.4  # s
_LEFT = 0.05  # s, climb error over that of the acceleration while the accelerometer is ignored
_GAIN_IGNORED = 5.0  # 1/s


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
def _is_on(m: Any) -> bool:
    """Returns whether a sensor or motor fails, or the estimate still has an error."""
    if (
        m.SIM_GPS1_ENABLE == 0
        or m.gps_jammed
        or m.SIM_ENGINE_FAIL != 0
        or m.SIM_BARO_DRIFT != 0.0
        or m.SIM_BARO_GLITCH != 0.0
    ):
        return True
    if m.SIM_GPS1_GLTCH_X != 0.0 or m.SIM_GPS1_GLTCH_Y != 0.0 or m.SIM_GPS1_GLTCH_Z != 0.0:
        return True
    off = _compass_offset(m)
    if abs(off[0]) + abs(off[1]) + abs(off[2]) > _SAME:
        return True
    if wind_is_on(m) or errs_sideways(m) or (m.sim_on and is_tilted(m)):
        return True
    if either_errs(m) or vibrates(m) or (m.sim_on and abs(m.climb_error) > _SAME):
        return True
    e = m.estimate_error
    if m.sim_on and abs(m.yaw_error) > _SAME:
        return True
    return bool(m.sim_on and (abs(e[0]) + abs(e[1]) + abs(e[2]) > _SAME or m.glitching or m.position_lost))


@kernel
def _reset(m: Any, axis: int, value: float) -> None:
    """Sets the error of an axis; the desired position moves with the estimate."""
    m.desired_position_neu[axis] += value - m.estimate_error[axis]
    m.position_neu[axis] += value - m.estimate_error[axis]
    m.estimate_error[axis] = value
    m.error_rate[axis] = 0.0


@kernel
def _watch_glitch(m: Any, t: float) -> None:
    if m.gps_rejected_at != _NEVER and t - m.gps_rejected_at >= _GLITCH_BEGINS:
        m.glitch_seen_at = t
        if not m.glitching:
            m.glitching = True
            say(m, CRITICAL, GLITCH, NO_NUMBER)
    elif m.glitching and m.gps_rejected_at == _NEVER and t - m.glitch_seen_at >= _GLITCH_ENDS:
        m.glitching = False
        say(m, CRITICAL, GLITCH_CLEARED, NO_NUMBER)


@kernel
def _watch_gps(m: Any, t: float) -> None:
    if m.SIM_GPS1_ENABLE == 0:
        if m.gps_lost_at == _NEVER:
            m.gps_lost_at = t
        m.error_rate[0] = m.error_rate[1] = 0.0
        m.position_ratio = m.velocity_ratio = 0.0
        if t - m.gps_lost_at >= _LOST:
            m.position_lost = True
        return
    m.velocity_ratio = 0.0
    if m.gps_jammed:
        m.position_ratio = m.velocity_ratio = _NONSENSE
        m.error_rate[0] = m.error_rate[1] = 0.0
        if m.gps_rejected_at == _NEVER:
            m.gps_rejected_at = t
        return
    n = m.SIM_GPS1_GLTCH_X * _PER_DEGREE
    e = m.SIM_GPS1_GLTCH_Y * _PER_DEGREE * math.cos(m.origin_latitude)
    m.gps_lost_at = _NEVER
    if m.position_lost:
        m.position_lost = False
        _reset(m, 0, n)
        _reset(m, 1, e)
        say(m, INFO, USING_GPS, NO_NUMBER)
    away_n, away_e = n - m.estimate_error[0], e - m.estimate_error[1]
    slip = math.sqrt(m.slip_error[0] * m.slip_error[0] + m.slip_error[1] * m.slip_error[1])
    m.position_ratio = math.sqrt(away_n * away_n + away_e * away_e) / (GATE + GATE_SLIP * slip)
    if m.position_ratio < 1.0:
        if m.imu_rejected_at == _NEVER and m.slip_rejected_at == _NEVER:
            m.gps_rejected_at = _NEVER
        m.error_rate[0], m.error_rate[1] = GAIN * away_n, GAIN * away_e
        return
    m.error_rate[0] = m.error_rate[1] = 0.0
    if m.gps_rejected_at == _NEVER:
        m.gps_rejected_at = t
    if t - m.gps_rejected_at >= _RETRY:
        _reset(m, 0, n)
        _reset(m, 1, e)


@kernel
def _watch_barometer(m: Any, t: float) -> None:
    away = m.SIM_BARO_DRIFT * t + m.SIM_BARO_GLITCH - m.estimate_error[2]
    m.height_ratio = abs(away) / GATE_UP
    if m.height_ratio < 1.0:
        m.barometer_rejected_at = _NEVER
        m.error_rate[2] = GAIN_UP * away
        return
    m.error_rate[2] = 0.0
    if m.barometer_rejected_at == _NEVER:
        m.barometer_rejected_at = t
    if t - m.barometer_rejected_at >= _RETRY:
        _reset(m, 2, away + m.estimate_error[2])


@kernel
def _watch_accelerometer(m: Any, t: float) -> None:
    """Sets the rate at which the climb rate of the estimate errs, and its innovation over the gate."""
    up = -accelerometer_error(m, m.imu)[2] * (1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2]))
    if t < m.imu_ignored_until:
        m.climb_error_rate = _GAIN_IGNORED * (_LEFT * up - m.climb_error)
        return
    ratio = abs(m.climb_error) / GATE_CLIMB
    m.velocity_ratio = max(m.velocity_ratio, ratio)
    if ratio < 1.0:
        m.imu_rejected_at = _NEVER
        m.climb_error_rate = up - GAIN_CLIMB * m.climb_error
        m.error_rate[2] += m.climb_error - GAIN_FALL * m.estimate_error[2]
        return
    m.climb_error_rate = up
    m.error_rate[2] = m.climb_error
    m.gps_rejected_at = t if m.gps_rejected_at == _NEVER else m.gps_rejected_at
    if m.imu_rejected_at == _NEVER:
        m.imu_rejected_at = t
    elif t - m.imu_rejected_at >= _IMU_RETRY:
        m.imu_rejected_at = _NEVER
        m.imu_ignored_until = t + _IMU_IGNORED
        m.climb_error = m.climb_error_rate = 0.0
        _reset(m, 2, 0.0)


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
def _watch_tilt(m: Any, t: float) -> None:
    """Lets errors of accelerometer and gyro to the side act on the estimate."""
    m.tilt_on = errs_sideways(m) or is_tilted(m)
    if not m.tilt_on:
        forget_tilt(m)
    elif watch_tilt(m, t):
        _reset(m, 0, m.SIM_GPS1_GLTCH_X * _PER_DEGREE)
        _reset(m, 1, m.SIM_GPS1_GLTCH_Y * _PER_DEGREE * math.cos(m.origin_latitude))


@kernel
def _away(m: Any, t: float) -> tuple[float, float, float]:
    """Returns by how much GPS and barometer are away from the estimate [m, north, east, up]."""
    n = m.SIM_GPS1_GLTCH_X * _PER_DEGREE - m.estimate_error[0]
    e = m.SIM_GPS1_GLTCH_Y * _PER_DEGREE * math.cos(m.origin_latitude) - m.estimate_error[1]
    return float(n), float(e), float(m.SIM_BARO_DRIFT * t + m.SIM_BARO_GLITCH - m.estimate_error[2])


@kernel
def _watch_all(m: Any, t: float) -> None:
    """Sets the rates at which the errors of the estimate change."""
    _watch_gps(m, t)
    _watch_barometer(m, t)
    if accelerometer_error(m, m.imu)[2] != 0.0 or m.climb_error != 0.0:
        _watch_accelerometer(m, t)
    _watch_compass(m)
    _watch_tilt(m, t)


@kernel
def _fly_by_other(m: Any, t: float) -> None:
    """Changes the lane, and what follows from its errors."""
    by = change_lane(m, t)
    for axis in range(3):
        _reset(m, axis, m.estimate_error[axis] + by[axis])
    m.slip_rejected_at = m.imu_rejected_at = _NEVER
    m.imu_ignored_until = m.climb_error_rate = 0.0
    _watch_all(m, t)


@kernel
def watch_sensors(m: Any, t: float) -> None:
    """Updates the errors of the estimate; called ten times a second."""
    watch_wind(m)
    m.gps_jammed = _is_jammed(m, t + m.booted_at)
    was = m.sim_on
    if prepare_lanes(m):
        if was:
            _fly_by_other(m, t)
        else:
            change_lane(m, t)
    m.sim_on = _is_on(m)
    if not m.sim_on:
        m.position_ratio = m.velocity_ratio = m.height_ratio = 0.0
        return
    if not was:
        m.gps_lost_at = m.gps_rejected_at = m.barometer_rejected_at = _NEVER
        for i in range(3):
            m.estimate_error[i] = m.error_rate[i] = 0.0
        m.yaw_error = 0.0
        m.climb_error = m.vibration_phase = m.imu_ignored_until = 0.0
        m.imu_rejected_at = _NEVER
        forget_tilt(m)
        forget_lanes(m)
    _watch_all(m, t)
    if either_errs(m):
        away = _away(m, t)
        if watch_lanes(m, t, away[0], away[1], away[2]):
            _fly_by_other(m, t)
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
def add_errors(m: Any, dt: float) -> None:
    """Adds the errors of the estimate to the sensed motion."""
    down = accelerometer_error(m, m.imu)[2]
    if down != 0.0 or m.climb_error != 0.0:
        m.climb_error += m.climb_error_rate * dt
        m.velocity_neu[2] += m.climb_error
        m.acceleration_neu[2] -= down * (1.0 - 2.0 * (m.q[1] * m.q[1] + m.q[2] * m.q[2]))
    if vibrates(m) and m.armed and m.spool_state > GROUND_IDLE:
        _shake(m, dt)
    for i in range(3):
        m.estimate_error[i] += m.error_rate[i] * dt
        m.position_neu[i] += m.estimate_error[i]
    m.yaw_error = wrap_pi(m.yaw_error + m.yaw_error_rate * dt)
    c, s = math.cos(0.5 * m.yaw_error), math.sin(0.5 * m.yaw_error)
    w, x, y, z = m.q[0], m.q[1], m.q[2], m.q[3]
    m.q[0], m.q[1], m.q[2], m.q[3] = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
    c, s = math.cos(m.yaw_error), math.sin(m.yaw_error)
    n, e = m.acceleration_neu[0], m.acceleration_neu[1]
    m.acceleration_neu[0], m.acceleration_neu[1] = c * n - s * e, s * n + c * e
    if m.tilt_on:
        add_tilt(m, dt)
        if m.SIM_GYR1_RND != 0.0:
            shake_gyro(m, dt)


@kernel
def told_by_gps(m: Any) -> tuple[int, int, float]:
    """Returns latitude and longitude [degE7] and altitude [m] as GPS tells them: the true place, and its errors."""
    e = m.estimate_error
    n, east, d = m.position_neu[0] - e[0], m.position_neu[1] - e[1], e[2] - m.position_neu[2]
    lat, lon, alt = geodetic_from_local(n, east, d, m.origin_latitude, m.origin_longitude, m.origin_altitude)
    lat, lon = lat + math.radians(m.SIM_GPS1_GLTCH_X), lon + math.radians(m.SIM_GPS1_GLTCH_Y)
    return deg_e7(lat), deg_e7(lon), alt + m.SIM_GPS1_GLTCH_Z


@kernel
def fail_motors(m: Any) -> None:
    """Multiplies the commands of the motors in SIM_ENGINE_FAIL by SIM_ENGINE_MUL."""
    for i in range(m.motor_count):
        if (m.SIM_ENGINE_FAIL >> i) & 1 != 0:
            m.motor[i] *= m.SIM_ENGINE_MUL
