"""Flight on wings: speeds, courses and circles of the autopilots of fixed wings and quadplanes.

Height and speed are controlled together (`wing.energy`), bank and pitch by `wing.attitude`, circles by
`wing.circling`. With STALL_PREVENTION, the bank stays within the load that the wing carries at the present speed, which
is the square of its ratio to AIRSPEED_MIN; 25 degrees are always permitted.

Kernels over a record that has `wing_parameters` and `WING_MEMORY` beside the variables of `gcs.record`, `wing.piloted`
and `wing.functions`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from cosim import Memory, Parameter, Variable
from cosim.frames import roll_pitch_from_quaternion, wrap_pi, yaw_from_quaternion
from cosim.kernel import kernel
from cosim.messages import MAV_RESULT_ACCEPTED, MAV_RESULT_DENIED, MAV_RESULT_FAILED, MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.record import angle, real
from cosim_models.autopilot.gcs.targets import go_to
from cosim_models.autopilot.gcs.words import GROUNDSPEED, say
from cosim_models.autopilot.wing.attitude import ATTITUDE_MEMORY, ATTITUDE_PARAMETERS, servos
from cosim_models.autopilot.wing.circling import CIRCLE_MEMORY, CIRCLE_PARAMETERS, leave_circle, towards_circle
from cosim_models.autopilot.wing.energy import ENERGY_MEMORY, ENERGY_PARAMETERS, clip, energy

__all__ = [
    "LAUNCH_DISTANCE",
    "WING_MEMORY",
    "bank_for",
    "change_speed",
    "circle",
    "circle_around",
    "cruise_speed",
    "fly",
    "fly_lifted",
    "launch",
    "permitted",
    "take_off",
    "wing_parameters",
]

LAUNCH_DISTANCE = 200.0
"""Distance [m] from the beginning of a take-off to the place that is circled after it: TKOFF_DIST of ArduPlane."""
_GRAVITY = 9.80665
_GENTLE = math.radians(25.0)  # bank that is always permitted
_STEEPEST = math.radians(85.0)
_TURN = 0.7  # 1/s, rate of turn by the error of the course
_LEAST_LEVEL = 0.25  # square of the cosine of the greatest pitch that counts
_FASTEST = 1000.0  # m/s, of a speed that may be asked for
_ROTATION = 5.0  # m/s, at which it steers and raises its nose

_PARAMETERS = (
    real("AIRSPEED_CRUISE", "m/s", 22.0, "speed of flight", 1.0),
    real("AIRSPEED_MIN", "m/s", 18.0, "least speed that may be asked for", 1.0),
    real("AIRSPEED_MAX", "m/s", 35.0, "greatest speed that may be asked for", 1.0),
    real("WP_LOITER_RAD", "m", 80.0, "radius of circles, clockwise", 20.0),
    *CIRCLE_PARAMETERS,
    real("WP_RADIUS", "m", 90.0, "distance at which a waypoint is reached", 1.0),
    angle("ROLL_LIMIT_DEG", 45.0, "greatest bank"),
    angle("PTCH_LIM_MAX_DEG", 20.0, "greatest pitch"),
    Parameter(
        "PTCH_LIM_MIN_DEG",
        unit="deg",
        start=-25.0,
        minimum=-90.0,
        maximum=0.0,
        tunable=True,
        description="least pitch: nose down is negative",
    ),
    real("TRIM_THROTTLE", "%", 40.0, "throttle of level flight"),
    real("THR_MAX", "%", 75.0, "greatest throttle", 1.0),
    *ENERGY_PARAMETERS,
    *ATTITUDE_PARAMETERS,
    real("TKOFF_ALT", "m", 50.0, "height above home at which mode TAKEOFF ends", 1.0),
    real("TKOFF_THR_MAX", "%", 40.0, "throttle of the take-off", 1.0),
    angle("TKOFF_LVL_PITCH", 15.0, "pitch of the take-off"),
    real("RTL_ALTITUDE", "m", 100.0, "height above home of the return", 0.0),
)
WING_MEMORY = (
    Memory("home_due"),  # s, when home is told again
    *ENERGY_MEMORY,
    *ATTITUDE_MEMORY,
    *CIRCLE_MEMORY,
    Memory("runway"),  # rad, course of the take-off
    Memory("rotated", dtype="?"),
    Memory("least_speed"),  # m/s over ground, of DO_CHANGE_SPEED
    Memory("mixes", dtype="?"),  # a pilot's sticks are added
    Memory("mixed", shape=3, rare=True),  # to bank and pitch [rad], and to the rudder
)


def wing_parameters(**start: float) -> tuple[Variable, ...]:
    """Returns the parameters of flight on wings, those of the Aerosonde except for the start values given by name.

    Raises:
        KeyError: there is no parameter of a name.
    """
    for name in start.keys() - {v.name for v in _PARAMETERS}:
        raise KeyError(name)
    return tuple(replace(v, start=start[v.name]) if v.name in start else v for v in _PARAMETERS)


@kernel
def launch(m: Any, down: float) -> None:
    """Begins the take-off along the present heading, in the air the course, up to a down coordinate."""
    m.runway = yaw_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    if not m.on_ground:
        m.runway = math.atan2(m.velocity[1], m.velocity[0])
    ahead, right = math.cos(m.runway), math.sin(m.runway)
    go_to(m, m.position[0] + LAUNCH_DISTANCE * ahead, m.position[1] + LAUNCH_DISTANCE * right, down)
    m.taking_off = True


@kernel
def _mix(m: Any, bank: float, pitch: float) -> tuple[float, float]:
    """Returns bank and pitch [rad] with a pilot's sticks added: stick mixing."""
    most = math.radians(m.ROLL_LIMIT_DEG)
    low, high = math.radians(m.PTCH_LIM_MIN_DEG), math.radians(m.PTCH_LIM_MAX_DEG)
    return clip(bank + m.mixed[0], -most, most), clip(pitch + m.mixed[1], low, high)


@kernel
def permitted(m: Any, bank: float) -> float:
    """Returns a bank [rad] within the load that the wing carries, and notes the one that is asked for."""
    m.asked_bank = bank
    if m.STALL_PREVENTION == 0 or abs(bank) <= _GENTLE or m.inverted:
        return bank
    speed = math.sqrt(m.velocity[0] ** 2 + m.velocity[1] ** 2 + m.velocity[2] ** 2)
    load = (speed / max(m.AIRSPEED_MIN, 1.0)) ** 2
    if load * math.cos(min(abs(bank), _STEEPEST)) >= 1.0:
        return bank
    most = max(math.acos(1.0 / load), _GENTLE) if load > 1.0 else _GENTLE
    return clip(bank, -most, most)


@kernel
def _limited(m: Any, slope: float, square: float) -> float:
    """Returns the bank [rad] of a slope within its limits at a square of the speed, and notes the one asked for."""
    most = math.radians(m.ROLL_LIMIT_DEG)
    bank = clip(math.atan(slope), -most, most)
    least = m.AIRSPEED_MIN * m.AIRSPEED_MIN
    if square * square < least * least * (1.0 + slope * slope):
        return permitted(m, bank)
    m.asked_bank = bank
    return bank


@kernel
def bank_for(m: Any, course: float) -> float:
    """Returns the bank [rad] that turns to a course."""
    leave_circle(m)
    square = m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1]
    error = wrap_pi(course - math.atan2(m.velocity[1], m.velocity[0]))
    return _limited(m, math.sqrt(square) / _GRAVITY * (_TURN * error), square)


@kernel
def circle_around(m: Any, n: float, e: float, radius: float) -> float:
    """Returns the bank [rad] for a circle around a place; a negative radius: anticlockwise."""
    nose = 2.0 * (m.attitude[0] * m.attitude[2] - m.attitude[3] * m.attitude[1])  # sine of the pitch
    level = math.sqrt(max(1.0 - nose * nose, _LEAST_LEVEL))
    square = m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1]
    return _limited(m, towards_circle(m, n, e, radius) / (_GRAVITY * level), square)


@kernel
def circle(m: Any, n: float, e: float) -> float:
    """Returns the bank [rad] that leads onto the circle around a place, clockwise, and along it."""
    return circle_around(m, n, e, float(m.WP_LOITER_RAD))


@kernel
def cruise_speed(m: Any) -> float:
    """Returns the speed of flight [m/s]: that of DO_CHANGE_SPEED, or AIRSPEED_CRUISE, at least that over ground."""
    return float(max(m.cruise if m.cruise > 0.0 else m.AIRSPEED_CRUISE, min(m.least_speed, m.AIRSPEED_MAX)))


@kernel
def change_speed(m: Any, kind: float, speed: float) -> int:
    """Handles DO_CHANGE_SPEED; returns a MAV_RESULT. A speed over ground is one that flight does not fall below."""
    if kind == 0.0:
        if not m.AIRSPEED_MIN <= speed <= m.AIRSPEED_MAX:
            return MAV_RESULT_DENIED
        m.cruise = speed
        return MAV_RESULT_ACCEPTED
    if kind != 1.0:
        return MAV_RESULT_FAILED
    if not 0.0 <= speed <= _FASTEST:
        return MAV_RESULT_DENIED
    m.least_speed = speed
    say(m, MAV_SEVERITY_INFO, GROUNDSPEED, int(speed))
    return MAV_RESULT_ACCEPTED


@kernel
def _fly(m: Any, bank: float, down: float, speed: float, weight: float, h: float) -> tuple[float, float]:
    """Returns the bank and the pitch [rad] that it asks for."""
    pitch, throttle = energy(m, down, speed, weight, h)
    if m.mixes:
        bank, pitch = _mix(m, bank, pitch)
    servos(m, bank, pitch, throttle, h)
    if m.mixes:
        m.motor[3] = clip(m.motor[3] + 0.5 * m.mixed[2], 0.0, 1.0)
    return bank, pitch


@kernel
def fly(m: Any, bank: float, down: float, speed: float, h: float) -> None:
    """Flies with a bank and a speed [m/s] towards a down coordinate."""
    _fly(m, bank, down, speed, float(m.TECS_SPDWEIGHT), h)


@kernel
def fly_lifted(m: Any, bank: float, down: float, speed: float, h: float) -> tuple[float, float]:
    """Flies as `fly` does while rotors lift it: the pitch is for the height alone.

    Returns the bank and the pitch [rad] that it asks for.
    """
    return _fly(m, bank, down, speed, 0.0, h)


@kernel
def take_off(m: Any, h: float) -> None:
    """Accelerates along the runway, rotates and climbs straight ahead, nearly up to the target's height."""
    speed = math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])
    m.rotated = m.rotated or speed > _ROTATION
    bank = bank_for(m, m.runway) if m.rotated else 0.0
    pitch = math.radians(m.TKOFF_LVL_PITCH) if m.rotated else 0.0
    if m.mission_active and m.rotated:  # climbs within TECS_CLMB_MAX
        _, nose = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
        pitch = min(pitch, nose + (m.velocity[2] + m.TECS_CLMB_MAX) / max(speed, _ROTATION))
    servos(m, clip(bank, -0.3, 0.3), pitch, 0.01 * m.TKOFF_THR_MAX, h)
    if m.position[2] <= m.guided_position[2] + 0.5 * m.TECS_CLMB_MAX:
        m.taking_off = False
        m.speed_before = speed
        m.acceleration = 0.0
