"""The filter of a lane of the estimate: which errors its sensors cause, and how GPS and barometer correct them.

It is the error model of an inertial navigation with the gains of a Kalman filter, whose noises, gates and time-outs are
EKF3's default parameters. Each lane has, in north, east and down, errors of place and velocity, the tilt towards north
and east, and what it has learned of the errors of its gyro and accelerometer. The covariance of the vertical errors is
apart from that of the horizontal ones, which north and east share: in hover they do not depend on each other. An unsure
heading makes velocities unsure where the estimate accelerates, which the gates take into account, and the gains do not.

As in EKF3, the filter works 0.1 s in the past, where GPS tells of the present. The vehicle flies by outputs that follow
the inertial sensor at once, and the filter with a lag of a quarter of a second, so that an error acts before the filter
sees it. Velocities of GPS are heard five times a second, heights of the barometer ten times.

- What is beyond its gate is rejected, and after 10 s believed: the estimate jumps to it, and the desired motion with
  it, so that the vehicle does not.
- Height and climb rate that err together say that the accelerometer is bad: for 10 s, nothing is rejected, the climb
  rate is that of GPS, and the accelerometer counts little.

The heading is not here (`sensors`), but the compass shows the tilt. Kernels over the autopilot's record `m`, in whose
tables a lane is a row.

Source: ArduPilot, NavEKF3_core (CovariancePrediction, FuseVelPosNED, calcOutputStates, ResetHeight) and its default
parameters; D. H. Titterton and J. L. Weston, Strapdown Inertial Navigation Technology, chapter 12 (error propagation).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.frames import rotate, rotate_inverse
from cosim.kernel import kernel
from cosim_models.autopilot.commander.estimate.inertial import GRAVITY, accelerometer_error, gyro_error, has_two, imu_of
from cosim_models.autopilot.commander.estimate.jamming import ACCURATE, PRECISE, begin_gps, take_fix

__all__ = [
    "DELAY",
    "FRAME",
    "LANES",
    "begin_filters",
    "err_by_drift",
    "force_error",
    "ratio",
    "reset_side",
    "run_filters",
    "stop_aiding",
]

FRAME = 0.0125
"""Period of the filter [s]."""
DELAY = 9
"""By how many periods it works in the past."""
LANES = 2

_GPS, _BAROMETER, _BETWEEN = 16, 8, 4  # periods between measurements; the compass is heard as often as the barometer
_FIX = 1  # period of a fix, of those between two
_GYRO, _ACCELEROMETER = 0.015, 0.35  # rad/s, m/s2: EK3_GYRO_P_NSE, EK3_ACC_P_NSE
_GYRO_BIAS, _ACCELEROMETER_BIAS = 1e-3, 0.02  # EK3_GBIAS_P_NSE, EK3_ABIAS_P_NSE
_BAD_ACCELEROMETER = 5.0  # m/s2
_SPEED, _CLIMB = ACCURATE**2, 0.5**2  # least variances of the velocity of GPS: EK3_VELNE_M_NSE, EK3_VELD_M_NSE
_HEIGHT, _GROUND_EFFECT = 2.0**2, 4.0  # of the barometer (EK3_ALT_M_NSE); factor while it is about to touch down
_AGE = 0.015  # s, of fixes of GPS beyond that by which the filter works in the past; fitted to recorded flights
_MANOEUVRE = 0.05  # standard deviation of the velocity for the acceleration of the estimate, s
_DIP = (0.05 / 0.528) ** 2  # rad2: EK3_MAG_M_NSE over the field that points up at the simulator, Gauss
_COMPASS_GATE = 9.0  # squared, in standard deviations: EK3_MAG_I_GATE
_GATE = 25.0  # squared, in standard deviations: EK3_VEL_I_GATE, EK3_POS_I_GATE, EK3_HGT_I_GATE
_RETRY, _RETRY_BOTH = 10.0, 7.0  # s of rejection: of the place while velocities are taken, of both
_HELD, _RESET, _CHECKED = 10.0, 1.0, 5.0  # s: for which the accelerometer is bad, of that, and for which GPS is good
_HELD_PLACE = 10.0**2  # m2, variance of a place that is held: EK3_NOAID_M_NSE
_UNSURE = 12.5**2  # m2, variance of a place that was reset: half of EK3_GLITCH_RAD
_FOLLOW, _FOLLOW_TILT = FRAME / 0.25, 0.5 / DELAY  # shares of the errors by which outputs follow: EK3_TAU_OUTPUT
_INTEGRAL, _BAD_INTEGRAL = 0.1, 0.07
_SMOOTH = 0.05  # share of a new acceleration
_SLOW_DESCENT, _SLOW, _NONE = 1.0, 1.25, 1e-3  # m/s, at which a touch-down is near
_RATE = 2.0 * math.pi * 2.0  # rad/s: EK3_HRT_FILT
_EARLY = 1e-9
_DRIFT_TILT, _DRIFT_SPEED = 74.6, 1121.0  # s2, m s: errors over the drift of the gyros that this filter learns in hover
_HEADING = 4.0 * 0.0069  # rad2, variance of the heading after a minute in hover, in ArduCopter's log

_WIDTH = 16  # of a place in the delay line: 8 outputs, 3 accelerations and 2 turns that the sensors make, 3 forces
_PLACES = DELAY * _WIDTH
POSITION_PASSED, VELOCITY_PASSED, HEIGHT_PASSED, BAD_AT, GOOD_AT = 0, 1, 2, 3, 4
"""Columns of the times."""

UP = np.array((0.263, 0.031, -0.00115, 0.031, 0.00989, -0.000471, -0.00115, -0.000471, 0.000111))
"""Covariance of height, climb rate and error of the accelerometer after a minute in hover."""
SIDE = np.array(
    (
        *(0.029, 0.0114, 0.00023, -1.1e-05, 2.86e-06),
        *(0.0114, 0.00932, 0.000267, -1.4e-05, 3.09e-06),
        *(0.00023, 0.000267, 4.3e-05, -9.66e-07, 0.000261),
        *(-1.1e-05, -1.4e-05, -9.66e-07, 2.42e-07, -5.49e-07),
        *(2.86e-06, 3.09e-06, 0.000261, -5.49e-07, 0.00256),
    )
)
"""Covariance of place, velocity, tilt, and errors of gyro and accelerometer to a side then."""


@kernel
def begin_filters(m: Any, t: float) -> None:
    """Begins without errors."""
    m.frame_count = int(t / FRAME)
    m.frame_left = 0.0
    begin_gps(m, t)
    for lane in range(LANES):
        m.lane_bad[lane] = False
        for i in range(8):
            m.lane_now[lane, i] = m.lane_past[lane, i] = 0.0
        for i in range(6):
            m.lane_learned[lane, i] = m.lane_sums[lane, i] = 0.0
        for i in range(9):
            m.lane_up[lane, i] = UP[i]
        for i in range(25):
            m.lane_side[lane, i] = SIDE[i]
        for i in range(_PLACES):
            m.lane_line[lane, i] = -GRAVITY if i % _WIDTH == _WIDTH - 1 else 0.0
        for i in range(3):
            m.lane_ratio[lane, i] = m.lane_smooth[lane, i] = m.lane_rate[lane, i] = 0.0
        for i in range(5):
            m.lane_time[lane, i] = t
        m.lane_time[lane, BAD_AT] = -1e9
        m.lane_turned[lane, 0] = m.lane_turned[lane, 1] = 0.0
        m.lane_turned[lane, 2] = _HEADING
        m.lane_dip[lane, 0] = m.lane_dip[lane, 1] = 0.0


@kernel
def err_by_drift(m: Any, rate: float) -> None:
    """Adds the errors that a drift of all gyros [rad/s2] has caused while GPS was heard: it is learned too late."""
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    n, e, _ = rotate(q, (rate, rate, rate))
    for lane in range(LANES if has_two(m) else 1):
        for x in (m.lane_now[lane], m.lane_past[lane]):
            x[3] -= _DRIFT_SPEED * e
            x[4] += _DRIFT_SPEED * n
            x[6] -= _DRIFT_TILT * e
            x[7] += _DRIFT_TILT * n
        for k in range(0, _PLACES, _WIDTH):
            for i in (3, 4, 6, 7):
                m.lane_line[lane, k + i] = m.lane_now[lane, i]


@kernel
def ratio(m: Any, lane: int, which: int) -> float:
    """Returns an innovation over its gate: of the velocity (0), the place (1) or the height (2)."""
    return math.sqrt(m.lane_ratio[lane, which])


# ---- prediction -----------------------------------------------------------------------------------------------------


@kernel
def _sensed(m: Any, lane: int, line: Any, at: int) -> None:
    """Writes into a place of a delay line which accelerations and turns the lane's sensors make, and the force."""
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    imu = imu_of(m, lane)
    line[at + 8], line[at + 9], line[at + 10] = rotate(q, accelerometer_error(m, imu))
    wn, we, _ = rotate(q, gyro_error(m, imu))
    line[at + 11], line[at + 12] = -we, wn
    line[at + 13], line[at + 14] = m.acceleration_neu[0], m.acceleration_neu[1]
    line[at + 15] = -m.acceleration_neu[2] - GRAVITY


@kernel
def _force(m: Any, lane: int, x: Any, place: Any) -> tuple[float, float, float]:
    """Returns the error of the acceleration [m/s2, NED]: of the sensor, less that learned, and of the tilted force."""
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    b = m.lane_learned[lane]
    n, e, d = rotate(q, (float(b[3]), float(b[4]), float(b[5])))
    n, e, d = place[8] - n, place[9] - e, place[10] - d
    fn, fe, fd = place[13] + n, place[14] + e, place[15] + d
    along, squared = 0.5 * (x[7] * fn - x[6] * fe), 0.5 * (x[6] * x[6] + x[7] * x[7])  # of second order
    return (
        float(n - x[6] * fd + x[7] * along - squared * fn),
        float(e - x[7] * fd - x[6] * along - squared * fe),
        float(d + x[6] * fn + x[7] * fe - squared * fd),
    )


@kernel
def force_error(m: Any, lane: int) -> tuple[float, float, float]:
    """Returns the error of the acceleration by which a lane flies [m/s2, NED]."""
    _sensed(m, lane, m.lane_place, 0)
    return _force(m, lane, m.lane_now[lane], m.lane_place)


@kernel
def _advance(m: Any, lane: int, x: Any, place: Any, dt: float) -> None:
    """Advances errors by what a place of the delay line says, without what has been learned."""
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    b = m.lane_learned[lane]
    wn, we, _ = rotate(q, (float(b[0]), float(b[1]), float(b[2])))
    force = _force(m, lane, x, place)
    for i in range(3):
        x[i] += 0.5 * dt * x[3 + i]
        x[3 + i] += dt * force[i]
        x[i] += 0.5 * dt * x[3 + i]
    x[6] += dt * (place[11] + we)
    x[7] += dt * (place[12] - wn)


@kernel
def _spread(p: Any, n: int, accelerometer: float) -> None:
    """Advances a covariance of place, velocity, tilt (n = 5 only), gyro (likewise) and accelerometer by a period."""
    for way in range(2):  # rows, then columns
        a, b = (n, 1) if way == 0 else (1, n)
        for j in range(n):
            p[j * b] += FRAME * p[a + j * b]
            if n == 5:
                p[a + j * b] += FRAME * GRAVITY * p[2 * a + j * b]
                p[2 * a + j * b] -= FRAME * p[3 * a + j * b]
            p[a + j * b] -= FRAME * p[(n - 1) * a + j * b]
    p[n + 1] += (FRAME * accelerometer) ** 2
    p[n * n - 1] += (FRAME * _ACCELEROMETER_BIAS) ** 2
    if n == 5:
        p[12] += (FRAME * _GYRO) ** 2
        p[18] += (FRAME * _GYRO_BIAS) ** 2


# ---- corrections ----------------------------------------------------------------------------------------------------


@kernel
def _learn(m: Any, lane: int, gyro: tuple[float, float], accelerometer: tuple[float, float, float]) -> None:
    """Adds to what has been learned of the sensors [north, east, down]."""
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    w, a = rotate_inverse(q, (gyro[0], gyro[1], 0.0)), rotate_inverse(q, accelerometer)
    for i in range(3):
        m.lane_learned[lane, i] += w[i]
        m.lane_learned[lane, 3 + i] += a[i]


@kernel
def _shrink(m: Any, p: Any, n: int, row: int, variance: float, learns: bool) -> None:
    """Reduces a covariance by a measurement of `row`; without learning, the accelerometer keeps its variance."""
    known = p[row * (n + 1)] + variance
    column = m.lane_column
    for i in range(n):
        column[i] = p[i * n + row]
    for i in range(n):
        for j in range(n):
            share = 1.0
            if not learns:
                share = 0.0 if i == j == n - 1 else 0.5 if n - 1 in (i, j) else 1.0
            p[i * n + j] -= share * column[i] * column[j] / known


@kernel
def _keep_unsure(m: Any, lane: int) -> None:
    """Keeps the variances of height and climb rate above those of their sensors while the accelerometer is bad."""
    if m.lane_bad[lane]:
        p = m.lane_up[lane]
        p[0], p[4] = max(p[0], _HEIGHT), max(p[4], _CLIMB)


@kernel
def _correct_up(m: Any, lane: int, row: int, miss: float, variance: float) -> None:
    """Corrects height (row 0) or climb rate (1) by a measurement that it misses."""
    p, x = m.lane_up[lane], m.lane_past[lane]
    gain = miss / (p[row * 4] + variance)
    x[2] -= gain * p[row]
    x[5] -= gain * p[3 + row]
    if not m.lane_bad[lane]:
        _learn(m, lane, (0.0, 0.0), (0.0, 0.0, -gain * p[6 + row]))
    _shrink(m, p, 3, row, variance, not m.lane_bad[lane])
    _keep_unsure(m, lane)


@kernel
def _correct_turned(m: Any, lane: int, variance: float) -> None:
    """Reduces the covariance of velocity and heading by a measurement of the velocity."""
    c = m.lane_turned[lane]
    for i in range(2):
        moved = m.lane_side[lane, 6] + c[i] * c[i] / c[2]
        known = moved + variance
        c[2] -= c[i] * c[i] / known
        c[i] *= 1.0 - moved / known


@kernel
def _correct_side(m: Any, lane: int, row: int, n: float, e: float, variance: float) -> None:
    """Corrects the place (row 0) or the velocity (1) to north and east by measurements that they miss."""
    p, x = m.lane_side[lane], m.lane_past[lane]
    known = p[row * 6] + variance
    for part in range(3):
        x[3 * part] -= p[5 * part + row] / known * n
        x[3 * part + 1] -= p[5 * part + row] / known * e
    gyro, force = p[15 + row] / known, 0.0 if m.lane_bad[lane] else p[20 + row] / known
    _learn(m, lane, (-gyro * e, gyro * n), (-force * n, -force * e, 0.0))
    _shrink(m, p, 5, row, variance, not m.lane_bad[lane])


# ---- resets ---------------------------------------------------------------------------------------------------------


@kernel
def _jump(m: Any, lane: int, i: int, value: float) -> None:
    """Sets an error of place (i to 2) or velocity, now and in the delay line; the desired place moves with it."""
    if lane == m.lane and i < 3:
        m.desired_position_neu[i] += (value - m.lane_now[lane, i]) * (-1.0 if i == 2 else 1.0)
    m.lane_past[lane, i] = m.lane_now[lane, i] = m.lane_place[i] = value
    for k in range(i, _PLACES, _WIDTH):
        m.lane_line[lane, k] = value


@kernel
def _forget(p: Any, n: int, row: int, variance: float) -> None:
    for i in range(n):
        p[row * n + i] = p[i * n + row] = 0.0
    p[row * (n + 1)] = variance


@kernel
def _reset_place(m: Any, lane: int, t: float) -> None:
    for i in range(2):
        _jump(m, lane, i, m.told_error[i])
    _forget(m.lane_side[lane], 5, 0, _UNSURE)
    m.lane_time[lane, POSITION_PASSED] = t
    m.lane_ratio[lane, 1] = 0.0


@kernel
def _reset_velocity(m: Any, lane: int, t: float) -> None:
    for i in range(3, 5):
        _jump(m, lane, i, m.told_speed[i - 3])
    _forget(m.lane_side[lane], 5, 1, m.gps_claim[0] ** 2)
    m.lane_time[lane, VELOCITY_PASSED] = t
    m.lane_ratio[lane, 0] = 0.0


@kernel
def reset_side(m: Any, lane: int, t: float) -> None:
    """Sets place and velocity to north and east to those of GPS."""
    _reset_place(m, lane, t)
    _reset_velocity(m, lane, t)


@kernel
def _reset_height(m: Any, lane: int, variance: float, t: float) -> None:
    _jump(m, lane, 2, m.told_error[2])
    _forget(m.lane_up[lane], 3, 0, variance)
    if m.gps_heard:
        _jump(m, lane, 5, m.told_speed[2])
    _forget(m.lane_up[lane], 3, 1, _CLIMB)
    m.lane_rate[lane, 0], m.lane_rate[lane, 1] = m.lane_now[lane, 2], m.lane_now[lane, 5]
    m.lane_time[lane, HEIGHT_PASSED] = t


# ---- measurements ---------------------------------------------------------------------------------------------------


@kernel
def _height_variance(m: Any) -> float:
    """Returns the variance of the barometer [m2], greater while it might touch down: it descends slowly, or hovers.

    In hover, ArduCopter's desired climb rate keeps up to 1e-3 m/s that 32-bit numbers cannot remove, mostly downwards:
    seen in recorded flights, and not derived.
    """
    vn, ve, up = m.target_velocity_neu[0], m.target_velocity_neu[1], m.desired_velocity_neu[2]
    near = -_SLOW_DESCENT <= up < _NONE and vn * vn + ve * ve <= _SLOW * _SLOW
    return _HEIGHT * (_GROUND_EFFECT if near else 1.0)


@kernel
def _check_accelerometer(m: Any, lane: int, height: float, t: float) -> None:
    """Looks whether height and climb rate err together, by 1 to 3 standard deviations, the longer it was good."""
    x, times = m.lane_past[lane], m.lane_time[lane]
    miss, climb, since = x[2] - m.told_error[2], x[5] - m.told_speed[2], t - times[BAD_AT]
    most = 9.0 if since > 2.0 * _HELD else 4.0 if since > 1.5 * _HELD else 1.0
    if miss * climb > 0.0 and miss * miss > most * height and climb * climb > most * max(_CLIMB, m.gps_claim[0] ** 2):
        times[BAD_AT] = t
    else:
        times[GOOD_AT] = t
    m.lane_bad[lane] = since < _HELD
    if m.lane_bad[lane]:
        x[5] = m.told_speed[2]


@kernel
def _lost_place(m: Any, lane: int, t: float) -> bool:
    """Returns whether places have been rejected for too long."""
    placed, moved = t - m.lane_time[lane, POSITION_PASSED], t - m.lane_time[lane, VELOCITY_PASSED]
    return bool(placed > _RETRY or (placed > _RETRY_BOTH and moved > _RETRY_BOTH))


@kernel
def _may_reset(m: Any, lane: int, t: float) -> bool:
    """Returns whether the place may be set to that of GPS: if that is good, or nothing else holds the velocity."""
    times = m.lane_time[lane]
    unaided = min(t - times[POSITION_PASSED], t - times[VELOCITY_PASSED]) > _RETRY_BOTH
    return bool(unaided or t - m.gps_good_at <= _CHECKED)


@kernel
def _hear_gps(m: Any, lane: int, place: Any, height: float, t: float) -> None:
    """Corrects by place and velocity of GPS, which is older than the filter takes it for."""
    _check_accelerometer(m, lane, height, t)
    x, side, times, ratios = m.lane_past[lane], m.lane_side[lane], m.lane_time[lane], m.lane_ratio[lane]
    s, told, claim = m.lane_smooth[lane], m.told_speed, m.gps_claim
    check = _SPEED + _MANOEUVRE**2 * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    n = x[0] - m.told_error[0] + _AGE * m.velocity[0]
    e = x[1] - m.told_error[1] + _AGE * m.velocity[1]
    vn, ve = x[3] - told[0] + _AGE * place[13], x[4] - told[1] + _AGE * place[14]
    vd = x[5] - told[2] + _AGE * (place[15] + GRAVITY)
    lost = _lost_place(m, lane, t)
    ratios[1] = (n * n + e * e) / (_GATE * 2.0 * (side[0] + claim[1] ** 2))
    c = m.lane_turned[lane]
    turned = (c[0] * c[0] + c[1] * c[1]) / c[2]
    gate = _GATE * (2.0 * (side[6] + check) + turned + m.lane_up[lane, 4] + check)
    ratios[0] = (vn * vn + ve * ve + vd * vd) / gate
    placed, moves = ratios[1] < 1.0, ratios[0] < 1.0
    if placed:
        times[POSITION_PASSED] = t
    if (lost or (placed and 2.0 * side[0] > 4.0 * _UNSURE)) and _may_reset(m, lane, t):
        if lost and t - times[VELOCITY_PASSED] > _RETRY_BOTH:
            _reset_velocity(m, lane, t)
        _reset_place(m, lane, t)
        return
    if moves:
        times[VELOCITY_PASSED] = t
    noise = m.gps_noise * m.gps_noise
    if moves or m.lane_bad[lane]:
        n, e = n - x[0], e - x[1]
        speed = claim[0] ** 2
        _correct_turned(m, lane, noise * speed)
        _correct_side(m, lane, 1, vn, ve, noise * speed)
        _correct_up(m, lane, 1, vd, noise * max(_CLIMB, speed))
        n, e = n + x[0], e + x[1]
    if placed or lost or m.lane_bad[lane]:
        _correct_side(m, lane, 0, n, e, noise * claim[1] ** 2)


@kernel
def _hear_barometer(m: Any, lane: int, height: float, t: float) -> None:
    """Corrects by the height of the barometer."""
    times, miss = m.lane_time[lane], float(m.lane_past[lane, 2] - m.told_error[2])
    m.lane_ratio[lane, 2] = miss * miss / (_GATE * (m.lane_up[lane, 0] + height))
    if m.lane_ratio[lane, 2] < 1.0:
        times[HEIGHT_PASSED] = t
    if t - times[HEIGHT_PASSED] > _RETRY or (m.lane_bad[lane] and t - times[GOOD_AT] > _RESET):
        _reset_height(m, lane, height, t)
    elif m.lane_ratio[lane, 2] < 1.0 or m.lane_bad[lane]:
        _correct_up(m, lane, 0, miss, height)


# ---- outputs --------------------------------------------------------------------------------------------------------


@kernel
def _follow(m: Any, lane: int, place: Any) -> None:
    """Lets the outputs follow the filter, by how far they were from it when it is now; `place` is of that time."""
    x, now, sums = m.lane_past[lane], m.lane_now[lane], m.lane_sums[lane]
    for i in range(6):
        miss = x[i] - place[i]
        share = _INTEGRAL
        if i == 5 and m.lane_bad[lane]:
            sums[i] += x[i] - now[i]
            share = _BAD_INTEGRAL
        else:
            sums[i] += miss
        change = miss * _FOLLOW + sums[i] * _FOLLOW * _FOLLOW * share
        now[i] += change
        for k in range(i, _PLACES, _WIDTH):
            m.lane_line[lane, k] += change
    for i in range(6, 8):
        now[i] += (x[i] - place[i]) * _FOLLOW_TILT


@kernel
def _follow_height(m: Any, lane: int, dt: float) -> None:
    """Advances the climb rate that is the derivative of the height by which it flies, and its integral.

    A complementary filter of third order: columns are its height, climb rate and acceleration.
    """
    rate = m.lane_rate[lane]
    miss = m.lane_now[lane, 2] - rate[0]
    rate[2] += dt * miss * _RATE**3
    rate[1] += dt * (_force(m, lane, m.lane_now[lane], m.lane_place)[2] + rate[2] + 3.0 * miss * _RATE**2)
    rate[0] += dt * (rate[1] + 3.0 * miss * _RATE)


@kernel
def _hear_compass(m: Any, lane: int) -> None:
    """Corrects by the tilt that the dip of the magnetic field shows.

    Not by the part that an error of the accelerometer balances: the filter has learned it as one of the field, too.
    """
    p, x, share = m.lane_side[lane], m.lane_past[lane], m.lane_column
    n, e = float(x[6] - m.lane_dip[lane, 0]), float(x[7] - m.lane_dip[lane, 1])
    for i in range(5):
        share[i] = p[5 * i + 2] - p[5 * i + 4] * p[14] / p[24]
    known = share[2] + _DIP
    if max(n * n, e * e) >= _COMPASS_GATE * known:
        return
    for part in range(3):
        x[3 * part] -= share[part] / known * n
        x[3 * part + 1] -= share[part] / known * e
    _learn(m, lane, (-share[3] / known * e, share[3] / known * n), (0.0, 0.0, 0.0))
    for i in range(5):
        for j in range(5):
            p[5 * i + j] -= share[i] * share[j] / known


@kernel
def stop_aiding(m: Any, lane: int) -> None:
    """Begins to hold the place that a lane has, without a velocity, where nothing else holds the tilt."""
    for i in range(2):
        m.lane_held[lane, i] = m.position[i] + m.lane_now[lane, i]
        _jump(m, lane, i, float(m.lane_now[lane, i]))
        _jump(m, lane, 3 + i, -float(m.velocity[i]))
    _forget(m.lane_side[lane], 5, 0, PRECISE**2)
    _forget(m.lane_side[lane], 5, 1, _SPEED)


@kernel
def _hold(m: Any, lane: int) -> None:
    """Corrects by a place that is assumed not to change."""
    x, age = m.lane_past[lane], DELAY * FRAME
    n = x[0] + m.position[0] - age * m.velocity[0] - m.lane_held[lane, 0]
    e = x[1] + m.position[1] - age * m.velocity[1] - m.lane_held[lane, 1]
    _correct_side(m, lane, 0, n, e, _HELD_PLACE)


@kernel
def _run_filter(m: Any, lane: int, t: float) -> None:
    """Performs one period of a lane."""
    start = m.frame_count % DELAY * _WIDTH
    line = m.lane_line[lane]
    place = m.lane_place
    for i in range(_WIDTH):
        place[i] = line[start + i]
        if i < 8:
            line[start + i] = m.lane_now[lane, i]
    _sensed(m, lane, line, start)
    x = m.lane_past[lane]
    _advance(m, lane, x, place, FRAME)
    accelerometer = _BAD_ACCELEROMETER if m.lane_bad[lane] else _ACCELEROMETER
    _spread(m.lane_up[lane], 3, accelerometer)
    _keep_unsure(m, lane)
    _spread(m.lane_side[lane], 5, accelerometer)
    wrong, smooth, turned = _force(m, lane, x, place), m.lane_smooth[lane], m.lane_turned[lane]
    for i in range(3):
        smooth[i] += _SMOOTH * (place[13 + i] + wrong[i] + (GRAVITY if i == 2 else 0.0) - smooth[i])
    turned[0] -= FRAME * (place[14] + wrong[1]) * turned[2]
    turned[1] += FRAME * (place[13] + wrong[0]) * turned[2]
    height = _height_variance(m)
    if m.gps_heard and m.frame_count % _GPS == _FIX:  # the filter has reached the time of the fix
        _hear_gps(m, lane, place, height, t)
    if m.frame_count % _BAROMETER == 0:
        if m.unaided:
            _hold(m, lane)
        _hear_barometer(m, lane, height, t)
    if m.frame_count % _BAROMETER == _BETWEEN:
        _hear_compass(m, lane)
    _follow(m, lane, place)


@kernel
def run_filters(m: Any, lanes: int, dt: float) -> int:
    """Advances the lanes by a step; returns how many periods of the filters have ended."""
    for lane in range(lanes):
        _sensed(m, lane, m.lane_place, 0)
        _advance(m, lane, m.lane_now[lane], m.lane_place, dt)
        _follow_height(m, lane, dt)
    m.frame_left += dt
    ended = 0
    while m.frame_left >= FRAME - _EARLY:
        m.frame_left -= FRAME
        m.frame_count += 1
        ended += 1
        if m.frame_count % _GPS == _FIX:
            take_fix(m, m.frame_count * FRAME, m.frame_count // _GPS, DELAY * FRAME)
        for lane in range(lanes):
            _run_filter(m, lane, m.frame_count * FRAME)
    return ended
