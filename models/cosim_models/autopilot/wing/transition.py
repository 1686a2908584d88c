"""Between rotors and wing: the flight of a quadplane to a place, on the wing from afar, on the rotors at its end.

From the rotors to the wing: the propeller accelerates the vehicle, which the rotors hold level at its height, up to
AIRSPEED_MIN; then, within Q_TRANSITION_MS, the wing takes over. Back: near its place it slows down to AIRSPEED_MIN, and
from a distance of v2 / (2 Q_TRANS_DECEL) + 2 s v on the rotors run as air brakes while the wing still steers; after a
second at least, when it is slow, too fast for the rest of the way, or crooked by 10 degrees, the rotors alone carry it.
They fly no faster than it then is, or twice Q_WP_SPEED; if it flies away from its place, or its nose points elsewhere,
they fly with Q_WP_SPEED and turn the nose there. On the wing, they come to its help below 3/4 of AIRSPEED_MIN, unless a
switch forbids it, and at all speeds if it says so.

Source: ArduPilot, ArduPlane/quadplane.cpp (SLT_Transition, vtol_position_controller), in its outlines.
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.frames import roll_pitch_from_quaternion, wrap_pi
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.record import real
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.words import FAST_ENOUGH, ON_WING, OVERSHOT, TO_WING, say, say_figures
from cosim_models.autopilot.wing.attitude import servos
from cosim_models.autopilot.wing.energy import clip
from cosim_models.autopilot.wing.flight import bank_for, circle, cruise_speed, fly, fly_lifted
from cosim_models.autopilot.wing.functions import FORBIDDEN, FORCED
from cosim_models.autopilot.wing.hover import hover, lift_along, lift_off, no_lift
from cosim_models.autopilot.wing.progress import tell_above, tell_approach, tell_braking, tell_position, tell_rotors

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
_TOO_SLOW = 0.75  # of AIRSPEED_MIN, below which the rotors help
_GENTLE = 0.25  # rad, greatest bank while the rotors carry it
_TO_FW, _TO_MC, _MC, _FW = 1, 2, 3, 4  # MAV_VTOL_STATE
_MARGIN = 2.0  # s before the distance within which it can stop, from which on the rotors brake
_BRAKING = 1.0  # s, at least
_TOO_FAST, _FASTER = 1.2, 2.0  # of the speed from which it can stop, and m/s above it
_SLOWER = 2.0  # m/s below AIRSPEED_MIN
_ASTRAY = math.cos(math.radians(60.0))
_CROOKED = math.radians(10.0)  # error of bank or pitch with which the rotors take over
_NOSE = math.radians(60.0)
_SLOWS_FROM, _SLOWS_TO = 60.0, 20.0  # s before it stops, of an approach with the speed at which this counts
_PLACE = 10.0  # m, within which its nose may point anywhere
_TWICE = 2.0  # of Q_WP_SPEED, which it may fly on the rotors until it has once been slower than Q_WP_SPEED

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
    Memory("braking", dtype="?"),  # the rotors run as air brakes
    Memory("braking_since", rare=True),  # s
    Memory("wanted_bank", rare=True),  # rad, while it brakes
    Memory("wanted_pitch", rare=True),
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
def _needs_help(m: Any, speed: float) -> bool:
    """Returns whether the rotors come to the wing's help."""
    slow = speed < _TOO_SLOW * m.AIRSPEED_MIN and m.assistance != FORBIDDEN
    return bool(slow or m.assistance == FORCED)


@kernel
def on_wing(m: Any, bank: float, down: float, wanted: float, t: float, h: float) -> None:
    """Flies with a bank and a speed on the wing, or gets there."""
    speed = speed_of(m)
    if m.vtol or (m.fast_since >= 0.0 and _needs_help(m, speed)):
        m.vtol = False
        m.fast_since = -1.0
        m.told_wing = False
    if not m.told_wing:
        m.told_wing = True
        if m.assistance == FORCED:
            m.speed_before, m.acceleration = speed, 0.0
        say_figures(m, MAV_SEVERITY_INFO, TO_WING, (speed, 0.0, 0.0, 0.0))
    left = 1.0 - 1000.0 * (t - m.fast_since) / m.Q_TRANSITION_MS if m.fast_since >= 0.0 else 1.0
    if left <= 0.0:
        fly(m, bank, down, wanted, h)
        no_lift(m)
        if not m.told_done:
            m.told_done = True
            say(m, MAV_SEVERITY_INFO, ON_WING, 0)
        return
    gentle = clip(bank, -_GENTLE, _GENTLE) if speed > _FLYING_SPEED else 0.0
    turn = _GRAVITY * math.tan(gentle) / max(speed, m.AIRSPEED_MIN)
    if m.fast_since < 0.0 and m.assistance == FORCED and speed >= m.AIRSPEED_MIN:
        fly_lifted(m, gentle, down, wanted, h)
        lift_off(m, gentle, turn, down, 1.0, h)
        return
    if m.fast_since < 0.0:
        servos(m, gentle, 0.0, 0.01 * m.THR_MAX, h)
        lift_off(m, gentle, turn, down, 1.0, h)
        if speed >= m.AIRSPEED_MIN:
            m.fast_since, m.lift_before = t, m.lift
            m.speed_before, m.acceleration, m.throttle_trim = speed, 0.0, 0.0
            say_figures(m, MAV_SEVERITY_INFO, FAST_ENOUGH, (speed, 0.0, 0.0, 0.0))
            m.told_done = False
        return
    fly_lifted(m, gentle, down, wanted, h)
    m.lift = left * m.lift_before
    lift_off(m, gentle, turn, down, left, h)


@kernel
def _begin_braking(m: Any, distance: float, t: float) -> None:
    m.braking, m.braking_since = True, t
    m.lift_trim = 0.0
    tell_braking(m, distance)


@kernel
def _has_braked(m: Any, n: float, e: float, distance: float, speed: float, t: float) -> bool:
    """Returns whether the rotors alone take over; tells it."""
    if t - m.braking_since <= _BRAKING - 1e-9:
        return False
    wanted = min(math.sqrt(2.0 * m.Q_TRANS_DECEL * distance), float(m.AIRSPEED_CRUISE)) if distance >= 1.0 else 0.0
    ahead = (m.velocity[0] * (n - m.position[0]) + m.velocity[1] * (e - m.position[1])) / max(distance, 1e-3)
    roll, nose = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    if not (
        speed < m.AIRSPEED_MIN - _SLOWER
        or speed > max(_TOO_FAST * wanted, wanted + _FASTER)
        or ahead < _ASTRAY * speed
        or abs(roll - m.wanted_bank) > _CROOKED
        or abs(nose - m.wanted_pitch) > _CROOKED
    ):
        return False
    tell_position(m, distance, wanted)
    return True


@kernel
def _take_over(m: Any) -> None:
    m.vtol, m.braking = True, False
    m.lift_trim = 0.0
    m.arrival_speed = max(speed_of(m), _TWICE * 0.01 * m.Q_WP_SPEED)


@kernel
def _arrive(m: Any, n: float, e: float, distance: float, speed: float) -> None:
    """Limits the speed on the rotors after a flight on the wing; required while `arrival_speed` is not 0."""
    walk = 0.01 * m.Q_WP_SPEED
    bearing = math.atan2(e - m.position[1], n - m.position[0])
    closing = (m.velocity[0] * (n - m.position[0]) + m.velocity[1] * (e - m.position[1])) / max(distance, 1e-3)
    off = wrap_pi(bearing - heading(m))
    if distance > _PLACE and (closing < 0.0 or abs(off) > _NOSE):
        m.arrival_speed = 0.0
        m.turns_to_place = True
        say_figures(m, MAV_SEVERITY_INFO, OVERSHOT, (distance, closing, math.degrees(off), 0.0))
    elif speed < walk:
        m.arrival_speed = 0.0
    elif speed > _TWICE * walk and m.attitude_asked[1] < 0.0:
        m.arrival_speed = min(m.arrival_speed, speed)


@kernel
def _approach_speed(m: Any, distance: float) -> float:
    """Returns the speed [m/s] of the approach to a place: it sinks to half-way between cruise and AIRSPEED_MIN."""
    cruise = cruise_speed(m)
    slow = 0.5 * (cruise + float(m.AIRSPEED_MIN))
    left = (distance - 0.5 * slow * slow / m.Q_TRANS_DECEL) / max(slow, 5.0)
    return slow + (cruise - slow) * clip((left - _SLOWS_TO) / (_SLOWS_FROM - _SLOWS_TO), 0.0, 1.0)


@kernel
def _brake(m: Any, bank: float, d: float, h: float) -> None:
    """Flies on the wing with the rotors running."""
    gentle = clip(bank, -_GENTLE, _GENTLE)
    turn = _GRAVITY * math.tan(gentle) / max(speed_of(m), m.AIRSPEED_MIN)
    m.wanted_bank, m.wanted_pitch = fly_lifted(m, gentle, d, float(m.AIRSPEED_MIN), h)
    lift_along(m, gentle, m.wanted_pitch, turn, d, h)


@kernel
def travel(m: Any, n: float, e: float, d: float, t: float, h: float) -> bool:
    """Flies to a place, on the wing from afar and on the rotors at its end; returns whether it hovers there."""
    distance, speed = distance_to(m, n, e), speed_of(m)
    runs = m.lift > 0.0
    if n != m.seen[0] or e != m.seen[1]:
        m.seen[0], m.seen[1] = n, e
        m.braking, m.arrival_speed, m.turns_to_place = False, 0.0, False
        if m.vtol and distance > m.WP_LOITER_RAD:
            m.vtol = False
            m.fast_since = -1.0
            m.told_wing = False
        if tell_approach(m, distance) and not m.vtol and not runs:
            _begin_braking(m, distance, t)
    if m.braking:
        if _has_braked(m, n, e, distance, speed, t):
            _take_over(m)
    elif not m.vtol and runs and distance < 0.5 * speed * speed / m.Q_TRANS_DECEL:
        _take_over(m)
        tell_rotors(m, distance)
    elif not m.vtol and not runs and distance < 0.5 * speed * speed / m.Q_TRANS_DECEL + _MARGIN * speed:
        _begin_braking(m, distance, t)
    if m.vtol:
        if m.arrival_speed > 0.0:
            _arrive(m, n, e, distance, speed)
        if m.turns_to_place:
            m.held_heading = math.atan2(e - m.position[1], n - m.position[0])
            m.turns_to_place = distance > _PLACE
        tell_above(m, distance)
        hover(m, n, e, d, h)
        return distance < THERE and speed < SLOW
    course = bank_for(m, math.atan2(e - m.position[1], n - m.position[0]))
    if m.braking:
        _brake(m, course, d, h)
    else:
        on_wing(m, course, d, _approach_speed(m, distance), t, h)
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
    return not (m.vtol or _is_rising(m, t) or _needs_help(m, speed_of(m)))


@kernel
def vtol_state(m: Any, t: float) -> int:
    """Returns the MAV_VTOL_STATE."""
    if m.braking:
        return _TO_MC
    return _MC if m.vtol else _TO_FW if _is_rising(m, t) else _FW
