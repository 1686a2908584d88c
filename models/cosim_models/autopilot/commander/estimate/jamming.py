"""What a jammed GPS tells at each of its fixes, and what the estimate makes of the accuracy that a GPS claims.

As in ArduPilot's simulation, a jammed receiver has no fix for a second, and then, by chance, until six seconds have
passed. With a fix, its place jumps by up to 200 m to each side, about once a second, and stays there. Satellites come
and go, and with fewer than four, or by chance, the fix. Velocities of up to 400 m/s, and claims of an accuracy of up to
300 m and 5 m/s, come with single fixes; between these, its velocity is true. What the estimate expects of a fix is the
worst claim of the last seconds.

Kernels over the autopilot's record `m`.

Source: ArduPilot, SITL (SIM_GPS, simulate_jamming) and NavEKF3 (readGpsData).
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel
from cosim.random_numbers import threefry

__all__ = ["ACCURATE", "PRECISE", "begin_gps", "take_fix"]

ACCURATE, PRECISE = 0.3, 0.5
"""The least errors of the velocity [m/s] and of the place [m] that are expected: EK3_VELNE_M_NSE, EK3_POSNE_M_NSE."""

_KEY, _UNIT = 0x4A414D47, 1.0 / 4294967296.0
_SILENT, _SILENT_AT_MOST = 1.0, 5.0  # s after the begin of jamming, and more by chance
_OFTEN = (3.0, 0.5, 0.8, 1.1, 3.0)  # changes a second of satellites, climb rate, velocity, place, accuracy
_FEWEST, _MANY, _KINDS = 2, 10, 15  # satellites: at least, without a change, and how many numbers there are
_NEEDED, _KNOWN = 4, 3  # for a fix, and those that are told without one
_FAST, _FAR = 400.0, 200.0  # m/s, m
_CLAIM_SPEED, _CLAIM_PLACE, _MOST_PLACE = 5.0, 300.0, 100.0  # m/s, m
_FORGETS, _DOUBTS = 5.0, 10.0  # s, of the worst claim, and of its mean
_NEW, _DOUBTFUL = 0.2, 1.5  # share of a new claim in their mean; m/s
_GOOD_SPEED = 1.0  # m/s, claimed by a GPS that is good enough to begin with
_NEVER = -1.0


@kernel
def _drawn(m: Any, fix: int, which: int) -> tuple[float, float]:
    """Returns two random numbers from 0 to 1 that belong to a fix."""
    a, b = threefry(_KEY, m.SYSID_THISMAV, fix, which)
    return a * _UNIT, b * _UNIT


@kernel
def begin_gps(m: Any, t: float) -> None:
    """Begins with a GPS that tells the truth."""
    m.jammed_at = _NEVER
    m.gps_taken_at = m.gps_good_at = t
    m.gps_noise = 1.0
    m.gps_satellites = _MANY
    m.gps_claim[0], m.gps_claim[1] = ACCURATE, PRECISE
    m.gps_doubt[0] = m.gps_doubt[1] = 0.0
    m.gps_doubtful = False
    for i in range(3):
        m.told_speed[i] = 0.0


@kernel
def _jam(m: Any, t: float, fix: int) -> tuple[float, float]:
    """Draws what a jammed receiver tells; returns the errors of velocity and place that it claims."""
    m.told_speed[0] = m.told_speed[1] = m.told_speed[2] = 0.0
    if m.jammed_at == _NEVER:
        m.jammed_at = t
        for i in range(2):
            m.jam_place[i] = m.position[i] + m.told_error[i]
        for i in range(len(_OFTEN)):
            m.jam_changed[i] = -1e9
    silent, kind = _drawn(m, fix, 0)
    m.gps_heard = m.SIM_GPS1_ENABLE != 0 and t - m.jammed_at >= _SILENT + _SILENT_AT_MOST * silent
    m.gps_satellites = _MANY
    if not m.gps_heard:
        m.gps_satellites = _KNOWN
        return 0.0, 0.0
    speed, place = 0.0, 0.0
    for i in range(len(_OFTEN)):
        often, coin = _drawn(m, fix, 1 + i)
        if t - m.jam_changed[i] <= 2.0 * often / _OFTEN[i]:
            continue
        m.jam_changed[i] = t
        a, b = _drawn(m, fix, 11 + i)
        if i == 0:
            m.gps_satellites = _FEWEST + int(_KINDS * kind)
            m.gps_heard = m.gps_satellites >= _NEEDED and coin < 0.5
        elif i == 1:
            m.told_speed[2] = _FAST * (2.0 * a - 1.0)
        elif i == 2:
            m.told_speed[0], m.told_speed[1] = _FAST * (2.0 * a - 1.0), _FAST * (2.0 * b - 1.0)
        elif i == 3:
            m.jam_place[0] += _FAR * (2.0 * a - 1.0)
            m.jam_place[1] += _FAR * (2.0 * b - 1.0)
        else:
            speed, place = _CLAIM_SPEED * a, _CLAIM_PLACE * b
    if not m.gps_heard:
        m.gps_satellites = _KNOWN
    return speed, place


@kernel
def take_fix(m: Any, t: float, fix: int, age: float) -> None:
    """Draws what a jammed GPS tells, and takes the accuracy that a GPS claims; `age` [s] is that of the fix."""
    speed, place = 0.0, 0.0
    if m.gps_jammed:
        speed, place = _jam(m, t, fix)
        for i in range(2):
            m.told_error[i] = m.jam_place[i] - m.position[i] + age * m.velocity[i]
    elif m.jammed_at != _NEVER:
        m.jammed_at = _NEVER
        m.gps_satellites = _MANY
        m.told_speed[0] = m.told_speed[1] = m.told_speed[2] = 0.0
    if not m.gps_heard:
        return
    before = m.gps_taken_at
    kept = max(1.0 - (t - before) / _FORGETS, 0.0)
    m.gps_taken_at = t
    m.gps_doubt[0] += _NEW * (speed - m.gps_doubt[0])
    m.gps_doubt[1] = max(m.gps_doubt[0], m.gps_doubt[1] * max(1.0 - (t - before) / _DOUBTS, 0.0))
    if m.gps_doubt[1] > _DOUBTFUL:
        m.gps_doubtful = True
    elif m.gps_doubt[1] < _GOOD_SPEED:
        m.gps_doubtful = False
    m.gps_claim[0] = max(m.gps_claim[0] * kept, speed, ACCURATE)
    m.gps_claim[1] = max(min(max(m.gps_claim[1] * kept, place), _MOST_PLACE), PRECISE)
    m.gps_noise = 1.0 if m.gps_satellites > 5 else 1.4 if m.gps_satellites == 5 else 2.0
    if m.gps_claim[0] <= _GOOD_SPEED:
        m.gps_good_at = t
