"""Between rotors and wing: the flight of a quadplane to a place, on the wing from afar, on the rotors at its end.

From the rotors to the wing: the propeller accelerates the vehicle, which the rotors hold level at its height, up to
AIRSPEED_MIN; then, within Q_TRANSITION_MS, the wing takes over. Back: near its place it slows down to AIRSPEED_MIN, and
from a distance of v2 / (2 Q_TRANS_DECEL) on the rotors carry it. On the wing, they come to its help below 3/4 of
AIRSPEED_MIN.

Source: ArduPilot, ArduPlane/quadplane.cpp (SLT_Transition, vtol_position_controller), in its outlines.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.words import FAST_ENOUGH, ON_WING, TO_WING, say, say_figures
from cosim_models.autopilot.wing.flight import bank_for, circle, clip, cruise_speed, fly, servos
from cosim_models.autopilot.wing.hover import hover, lift_off, no_lift
from cosim_models.autopilot.wing.progress import tell_above, tell_approach, tell_rotors

__all__ = [
    "SLOW",
    "THERE",
    "TRANSITION_MEMORY",
    "TRANSITION_PARAMETERS",
    "distance_to",
    "forget_target",
    "go_round",
    "note_target",
    "on_wing",
    "on_wing_alone",
    "speed_of",
    "travel",
    "vtol_state",
]

THERE, SLOW = 2.0, 1.0
"""Distance [m] and speed [m/s] within which it is at its place."""

_GRAVITY = 9.80665
_FLYING_SPEED = 5.0  # m/s, from which on it banks
_APPROACH = 250.0  # m from its place, from which on it flies at AIRSPEED_MIN
_TOO_SLOW = 0.75  # of AIRSPEED_MIN, below which the rotors help
_GENTLE = 0.25  # rad, greatest bank while the rotors carry it
_TO_FW, _MC, _FW = 1, 3, 4  # MAV_VTOL_STATE

TRANSITION_PARAMETERS = (
    real("Q_TRANSITION_MS", "ms", 5000.0, "time within which the wing takes over from the rotors", 1.0),
)
TRANSITION_MEMORY = (
    Memory("vtol", dtype="?"),  # the rotors carry it
    Memory("seen", shape=2),  # m: the last target, north and east
    Memory("fast_since"),  # s: since when the wing takes over; -1: not yet
    Memory("told_wing", dtype="?"),  # that the transition to the wing began, and that it is done
    Memory("told_done", dtype="?"),
    Memory("lift_before"),  # mean thrust of the rotors by then
)


@kernel
def speed_of(m: Any) -> float:
    """Returns the horizontal speed [m/s]."""
    return math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])


@kernel
def distance_to(m: Any, n: float, e: float) -> float:
    """Returns the horizontal distance [m] of a place."""
    return math.sqrt((n - m.position[0]) ** 2 + (e - m.position[1]) ** 2)


@kernel
def note_target(m: Any) -> None:
    m.seen[0], m.seen[1] = m.guided_position[0], m.guided_position[1]


@kernel
def forget_target(m: Any) -> None:
    """Makes the present target a new one."""
    m.seen[0] = math.inf


@kernel
def on_wing(m: Any, bank: float, down: float, wanted: float, t: float, h: float) -> None:
    """Flies with a bank and a speed on the wing, or gets there."""
    speed = speed_of(m)
    if m.vtol or (m.fast_since >= 0.0 and speed < _TOO_SLOW * m.AIRSPEED_MIN):
        m.vtol = False
        m.fast_since = -1.0
        m.told_wing = False
    if not m.told_wing:
        m.told_wing = True
        say_figures(m, MAV_SEVERITY_INFO, TO_WING, (speed, 0.0, 0.0, 0.0))
    gentle = clip(bank, -_GENTLE, _GENTLE) if speed > _FLYING_SPEED else 0.0
    turn = _GRAVITY * math.tan(gentle) / max(speed, m.AIRSPEED_MIN)
    if m.fast_since < 0.0:
        servos(m, gentle, 0.0, 0.01 * m.THR_MAX, h)
        lift_off(m, gentle, turn, down, 1.0, h)
        if speed >= m.AIRSPEED_MIN:
            m.fast_since, m.lift_before = t, m.lift
            m.speed_before, m.acceleration, m.throttle_trim = speed, 0.0, 0.0
            say_figures(m, MAV_SEVERITY_INFO, FAST_ENOUGH, (speed, 0.0, 0.0, 0.0))
            m.told_done = False
        return
    left = 1.0 - 1000.0 * (t - m.fast_since) / m.Q_TRANSITION_MS
    if left <= 0.0:
        fly(m, bank, down, wanted, h)
        no_lift(m)
        if not m.told_done:
            m.told_done = True
            say(m, MAV_SEVERITY_INFO, ON_WING, 0)
        return
    fly(m, gentle, down, wanted, h)
    m.lift = left * m.lift_before
    lift_off(m, gentle, turn, down, left, h)


@kernel
def travel(m: Any, n: float, e: float, d: float, t: float, h: float) -> bool:
    """Flies to a place, on the wing from afar and on the rotors at its end; returns whether it hovers there."""
    distance, speed = distance_to(m, n, e), speed_of(m)
    if n != m.seen[0] or e != m.seen[1]:
        m.seen[0], m.seen[1] = n, e
        if m.vtol and distance > m.WP_LOITER_RAD:
            m.vtol = False
            m.fast_since = -1.0
            m.told_wing = False
        tell_approach(m, distance)
    if not m.vtol and distance < 0.5 * speed * speed / m.Q_TRANS_DECEL:
        m.vtol = True
        m.lift_trim = 0.0
        tell_rotors(m, distance)
    if m.vtol:
        tell_above(m, distance)
        hover(m, n, e, d, h)
        return distance < THERE and speed < SLOW
    course = math.atan2(e - m.position[1], n - m.position[0])
    on_wing(m, bank_for(m, course, 0.0), d, m.AIRSPEED_MIN if distance < _APPROACH else cruise_speed(m), t, h)
    return False


@kernel
def go_round(m: Any, n: float, e: float, d: float, t: float, h: float) -> None:
    """Circles a place on the wing."""
    on_wing(m, circle(m, n, e), d, cruise_speed(m), t, h)


@kernel
def _is_rising(m: Any, t: float) -> bool:
    """Returns whether the wing takes over from the rotors."""
    return bool(m.fast_since < 0.0 or 1000.0 * (t - m.fast_since) < m.Q_TRANSITION_MS)


@kernel
def on_wing_alone(m: Any, t: float) -> bool:
    """Returns whether the wing carries it without the rotors, and may go on to do so."""
    return not (m.vtol or _is_rising(m, t) or speed_of(m) < _TOO_SLOW * m.AIRSPEED_MIN)


@kernel
def vtol_state(m: Any, t: float) -> int:
    """Returns the MAV_VTOL_STATE."""
    return _MC if m.vtol else _TO_FW if _is_rising(m, t) else _FW
