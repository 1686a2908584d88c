"""Modes in which a pilot drives, MANUAL, ACRO, STEERING and SIMPLE, and LOITER.

The first channel steers, the third is the throttle, forwards and backwards from its centre. Backwards, the wheels
stand as the stick says, so that the nose turns the other way (PILOT_STEER_TYPE 0). Full throttle asks for CRUISE_SPEED
over CRUISE_THROTTLE, at most 30 m/s. Kernels over a record that has `PILOT_PARAMETERS`, `PILOT_MEMORY` and what
`driving` needs.

Differences from ArduRover: no limit to the angular acceleration (ATC_STR_ACC_MAX), no expo, no lateral channel.

Source: ArduPilot, Rover/mode.cpp (get_pilot_*), mode_manual, mode_acro, mode_steering, mode_simple, mode_loiter.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import wrap_pi
from cosim.kernel import kernel
from cosim_models.autopilot.gcs.record import angle, real
from cosim_models.autopilot.gcs.sticks import ROLL, THROTTLE, deflection
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.targets import go_to
from cosim_models.autopilot.surface.driving import (
    STANDING,
    clip,
    cruise,
    ground_speed,
    steer,
    stop,
    throttle_for,
    turn_limit,
    turn_towards,
)

__all__ = ["PILOT_MEMORY", "PILOT_PARAMETERS", "acro", "coast", "loiter", "manual", "note_heading", "simple"]
__all__ += ["stay", "steering"]

_GRAVITY = 9.80665
_FASTEST = 30.0  # m/s that the throttle stick asks for
_SLOW = 1.0  # m/s, AR_ATTCONTROL_STEER_SPEED_MIN
_RATE_I = 1.0  # 1/s
_LEAST = 0.1  # m/s2, lateral acceleration of STEERING at full deflection

PILOT_PARAMETERS = (
    angle("ACRO_TURN_RATE", 180.0, "turn rate of ACRO at full deflection, per second"),
    real("MOT_SLEWRATE", "%", 100.0, "greatest change of the throttle of MANUAL and HOLD in a second, 0: any"),
    real("LOIT_SPEED_GAIN", "1/s", 0.5, "speed of LOITER over the distance beyond LOIT_RADIUS"),
)
PILOT_MEMORY = (
    Memory("first_heading", rare=True),  # rad, of SIMPLE
    Memory("held_heading", rare=True),  # rad, of SIMPLE and LOITER
    Memory("rate_trim", rare=True),  # rad/s, integral of the error of the turn rate
)


@kernel
def note_heading(m: Any) -> None:
    """Makes the present heading that to which the sticks of SIMPLE refer."""
    m.first_heading = heading(m)
    m.held_heading = m.first_heading


@kernel
def _slew(m: Any, throttle: float, steering: float, h: float) -> None:
    """Commands throttle and steering, -1 to 1, the throttle no faster than MOT_SLEWRATE."""
    now = 2.0 * float(m.motor[1]) - 1.0
    slewed = throttle
    if m.MOT_SLEWRATE > 0.0:
        most = 0.01 * m.MOT_SLEWRATE * h
        slewed = clip(throttle, now - most, now + most)
    if (throttle < 0.0) != (slewed < 0.0):
        steering = -steering
    m.motor[0] = 0.5 + 0.5 * steering
    m.motor[1] = 0.5 + 0.5 * slewed
    speed = ground_speed(m, heading(m))
    m.demand = speed if abs(speed) > STANDING else 0.0
    m.integral = 0.0


@kernel
def manual(m: Any, t: float, h: float) -> None:
    """Passes the sticks on."""
    throttle = deflection(m, THROTTLE, t)
    wheel = deflection(m, ROLL, t)
    _slew(m, throttle, -wheel if throttle < 0.0 else wheel, h)


@kernel
def coast(m: Any, h: float) -> None:
    """Commands nothing: HOLD."""
    _slew(m, 0.0, 0.0, h)


@kernel
def _fastest(m: Any) -> float:
    """Returns the speed [m/s] that full throttle asks for."""
    share = 0.01 * m.CRUISE_THROTTLE
    return float(clip(m.CRUISE_SPEED / share if 0.05 <= share <= 1.0 else m.CRUISE_SPEED, 0.0, _FASTEST))


@kernel
def _sticks(m: Any, t: float) -> tuple[float, float]:
    """Returns the steering, -1 to 1, and the speed [m/s] that the pilot asks for."""
    throttle = deflection(m, THROTTLE, t)
    wheel = deflection(m, ROLL, t)
    backs = (m.demand if m.demand != 0.0 else throttle) < 0.0
    return -wheel if backs else wheel, throttle * _fastest(m)


@kernel
def _keep(m: Any, wanted: float, rate: float, h: float) -> None:
    """Commands throttle and steering for a speed [m/s] and a turn rate [rad/s]; without both, it stops."""
    yaw = heading(m)
    speed = ground_speed(m, yaw)
    if wanted == 0.0 and abs(speed) < STANDING and abs(m.demand) < STANDING:
        m.rate_trim = 0.0
        stop(m, h)
        return
    throttle_for(m, wanted, speed, h)
    most = min(math.radians(m.ATC_STR_RAT_MAX), turn_limit(m, speed))
    rate = clip(rate, -most, most)
    if abs(speed) <= _SLOW:
        m.rate_trim = 0.0
    elif 0.0 < m.motor[0] < 1.0:
        m.rate_trim = clip(m.rate_trim + _RATE_I * (rate - m.angular_velocity[2]) * h, -0.5, 0.5)
    steer(m, rate + m.rate_trim, speed)
    m.desired_velocity[0] = m.demand * math.cos(yaw)
    m.desired_velocity[1] = m.demand * math.sin(yaw)


@kernel
def acro(m: Any, t: float, h: float) -> None:
    """Drives with the speed and the turn rate of the sticks."""
    wheel, wanted = _sticks(m, t)
    _keep(m, wanted, wheel * math.radians(m.ACRO_TURN_RATE), h)


@kernel
def steering(m: Any, t: float, h: float) -> None:
    """Drives with the speed and the lateral acceleration of the sticks.

    Full deflection is the turn of TURN_RADIUS, or ATC_TURN_MAX_G, whichever is less.
    """
    wheel, wanted = _sticks(m, t)
    speed = ground_speed(m, heading(m))
    most = clip(speed * speed / max(m.TURN_RADIUS, 0.1), _LEAST, _GRAVITY * m.ATC_TURN_MAX_G)
    _keep(m, wanted, wheel * most / max(abs(speed), _SLOW), h)


@kernel
def simple(m: Any, t: float, h: float) -> None:
    """Drives where the two sticks point, seen along the heading in which the mode was entered, with their length."""
    x, y = deflection(m, THROTTLE, t), deflection(m, ROLL, t)
    wanted = min(math.sqrt(x * x + y * y), 1.0) * _fastest(m)
    if wanted > 0.0:
        m.held_heading = wrap_pi(m.first_heading + math.atan2(y, x))
    _keep(m, wanted, turn_towards(m, heading(m), m.held_heading), h)


@kernel
def stay(m: Any) -> None:
    """Makes the place where it can stop that of LOITER."""
    vn, ve = m.velocity[0], m.velocity[1]
    ahead = 0.5 * math.sqrt(vn * vn + ve * ve) / m.ATC_ACCEL_MAX
    go_to(m, m.position[0] + ahead * vn, m.position[1] + ahead * ve, m.position[2])
    m.held_heading = heading(m)


@kernel
def loiter(m: Any, h: float) -> None:
    """Stays within LOIT_RADIUS of its place: beyond, it drives to it, backwards if that is behind."""
    dn, de = m.guided_position[0] - m.position[0], m.guided_position[1] - m.position[1]
    beyond = math.sqrt(dn * dn + de * de) - m.LOIT_RADIUS
    wanted = 0.0
    if beyond > 0.0:
        wanted = min(beyond * m.LOIT_SPEED_GAIN, cruise(m))
        m.held_heading = math.atan2(de, dn)
        error = abs(wrap_pi(m.held_heading - heading(m)))
        if error > 0.5 * math.pi:
            m.held_heading = wrap_pi(m.held_heading + math.pi)
            wanted, error = -wanted, math.pi - error
        wanted *= 1.0 - error / math.pi
    _keep(m, wanted, turn_towards(m, heading(m), m.held_heading), h)
