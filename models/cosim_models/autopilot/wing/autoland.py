"""Landings of planes on their wheels: AUTOLAND, at home in the direction of the take-off, and NAV_LAND of missions.

That direction is the course over ground of the first flight after arming in TAKEOFF, AUTO, or a mode of a pilot without
the autopilot's throttle, plus AUTOLAND_DIR_OFF; with AUTOLAND_OPTIONS 1, it is the heading at arming. The plane circles
beside the final's beginning, which is AUTOLAND_WP_DIST before home and AUTOLAND_WP_ALT high, on the side where it is,
until it has this height (within 5 m) and heads for home (within 10 degrees, 10 more for each circle). On the final it
follows a slope to the point where the flare begins, at LAND_FLARE_ALT or LAND_FLARE_SEC before the ground; then the
throttle is closed, the bank is within LEVEL_ROLL_LIMIT, and it is disarmed when it has stood for LAND_DISARMDELAY.
NAV_LAND of a mission has the same final without a circle: from the place to which it flew before, or, after a take-off
and beyond the landing point, from where it is; AUTOLAND_WP_DIST and AUTOLAND_WP_ALT are then what lies between the two.

Kernels over a record with `AUTOLAND_PARAMETERS` and `AUTOLAND_MEMORY` beside what `wing.flight` and `wing.piloted`
need.

Differences from ArduPlane: slope and flare are flown by the loops of `wing.flight` instead of TECS; no compensation of
a head wind, no speed before the flare (LAND_PF_ARSPD), no rangefinder, no abort.

Source: ArduPilot, ArduPlane/mode_autoland.cpp, commands_logic.cpp (verify_loiter_to_alt), mode_loiter.cpp
(isHeadingLinedUp), mode.h (modes whose course counts), AP_Landing_Slope.cpp, Plane.cpp (disarm_if_autoland_complete),
commands.cpp (set_next_WP).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory, Parameter
from cosim.frames import roll_pitch_from_quaternion, wrap_pi
from cosim.kernel import kernel
from cosim.messages import MAV_CMD_NAV_TAKEOFF, MAV_SEVERITY_INFO, MAV_SEVERITY_WARNING
from cosim_models.autopilot.gcs.missions import COMMAND, item_place
from cosim_models.autopilot.gcs.record import angle, real, whole
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.targets import go_to
from cosim_models.autopilot.gcs.words import (
    AUTO_DISARMED,
    CIRCLED,
    DIRECTION,
    FLARES,
    LANDED_AT,
    LANDING_BEGINS,
    NO_DIRECTION,
    NOT_FLYING,
    SLOPE,
    say,
    say_figures,
)
from cosim_models.autopilot.wing.attitude import rest, servos
from cosim_models.autopilot.wing.circling import is_on_circle
from cosim_models.autopilot.wing.energy import CLIMB_P, clip
from cosim_models.autopilot.wing.flight import circle_around, cruise_speed, fly
from cosim_models.autopilot.wing.piloted import line_bank
from cosim_models.autopilot.wing.sequence import is_landing

__all__ = ["AUTOLAND_MEMORY", "AUTOLAND_PARAMETERS", "begin_autoland", "land_in_mission", "land_on_wheels"]
__all__ += ["note_arming", "watch_autoland"]

_NONE, _CIRCLES, _FINAL, _APPROACH, _FLARE, _DISARMED = range(6)  # m.landing_stage
_ON_ARMING = 1  # AUTOLAND_OPTIONS
_COUNTS = (0, 2, 3, 4, 5, 8, 10, 13)  # MANUAL, STABILIZE, TRAINING, ACRO, FBWA, AUTOTUNE, AUTO, TAKEOFF
_AUTOLAND = 26
_COURSE_SPEED = 5.0  # m/s, from which on the course is known
_SHARE = 0.333  # of AUTOLAND_WP_DIST, at most for the radius of the circle
_CLOSE = 5.0  # m, from the height
_AHEAD = math.radians(10.0)
_ON_LINE = 5.0  # m
_EARLY, _HALF = 0.15, 0.5  # of the final
_FLARE_SHARE = 0.5  # of the sink rate in the flare that it takes away: LAND_FLARE_EFF
_HOLD_OFF = 1.0  # m above the ground, where it sinks with TECS_LAND_SINK: TECS_FLARE_HGT
_FLARE_HEIGHT, _FLARE_GAIN = 0.5, 1.0  # 1/s, of the error of the height in the flare; of the error of the path
_SLEW = 1.0  # of the throttle [1/s]: THR_SLEWRATE
_MOVES, _DOUBT = 1.5, 3.0  # m/s, from which on it flies; s after which it counts as standing

AUTOLAND_PARAMETERS = (
    real("AUTOLAND_WP_ALT", "m", 55.0, "height above home at which the final of AUTOLAND begins"),
    real("AUTOLAND_WP_DIST", "m", 400.0, "distance from home at which the final of AUTOLAND begins", 1.0),
    Parameter(
        "AUTOLAND_DIR_OFF",
        unit="deg",
        start=0.0,
        minimum=-360.0,
        maximum=360.0,
        tunable=True,
        description="direction of the landing beside that of the take-off",
    ),
    whole("AUTOLAND_OPTIONS", 0, "1: the direction of the take-off is the heading at arming"),
    real("LAND_FLARE_ALT", "m", 3.0, "height above the landing point at which the flare begins"),
    real("LAND_FLARE_SEC", "s", 2.0, "time before the ground at which the flare begins"),
    real("LAND_DISARMDELAY", "s", 20.0, "time on the ground after which it is disarmed, 0: it stays armed"),
    Parameter(
        "TECS_LAND_ARSPD",
        unit="m/s",
        start=-1.0,
        minimum=-1.0,
        maximum=127.0,
        tunable=True,
        description="speed of the final; -1: between AIRSPEED_MIN and AIRSPEED_CRUISE",
    ),
    real("TECS_LAND_SINK", "m/s", 0.25, "rate of descent at the touch-down"),
    angle("LEVEL_ROLL_LIMIT", 5.0, "greatest bank in the flare"),
)
AUTOLAND_MEMORY = (
    Memory("direction_known", dtype="?", rare=True),  # of the take-off
    Memory("direction", rare=True),  # rad
    Memory("landing_stage", dtype="i4", rare=True),
    Memory("landing_circle", shape=3, rare=True),  # m, m, m: north, east, radius; to the left: negative
    Memory("landing_turned", rare=True),  # rad, on the circle since the height is there; -1: it is not there yet
    Memory("landing_point", shape=3, rare=True),  # m, NED
    Memory("final", shape=2, rare=True),  # m: its length, and how high above that point it begins
    Memory("flare", shape=3, rare=True),  # m, m/s, m: height and sink at its beginning, height that is wanted now
    Memory("stands_since", rare=True),  # s
)


@kernel
def _note_direction(m: Any, direction: float) -> None:
    m.direction_known = True
    m.direction = direction % (2.0 * math.pi)
    say(m, MAV_SEVERITY_INFO, DIRECTION, int(math.degrees(m.direction) + 1e-9))


@kernel
def note_arming(m: Any) -> None:
    """Takes the heading for the direction of the take-off, if AUTOLAND_OPTIONS says so; required when it is armed."""
    m.direction_known = False
    if m.AUTOLAND_OPTIONS & _ON_ARMING != 0:
        _note_direction(m, heading(m))


@kernel
def begin_autoland(m: Any) -> bool:
    """Begins AUTOLAND; returns False, and says why, if it cannot."""
    if m.on_ground or not m.direction_known:
        say(m, MAV_SEVERITY_WARNING, NOT_FLYING if m.on_ground else NO_DIRECTION, 0)
        return False
    c, s = math.cos(m.direction), math.sin(m.direction)
    n, e = m.home[0] - m.AUTOLAND_WP_DIST * c, m.home[1] - m.AUTOLAND_WP_DIST * s
    right = (m.position[1] - e) * c - (m.position[0] - n) * s
    radius = float(int(min(_SHARE * m.AUTOLAND_WP_DIST, m.WP_LOITER_RAD)))
    side = radius if right >= 0.0 else -radius
    m.landing_stage = _CIRCLES
    m.landing_turned = -1.0
    m.line[0], m.line[1], m.line[2] = n, e, m.direction
    for i in range(3):
        m.landing_point[i] = m.home[i]
    m.final[0], m.final[1] = m.AUTOLAND_WP_DIST, m.AUTOLAND_WP_ALT
    m.landing_circle[0], m.landing_circle[1], m.landing_circle[2] = n - side * s, e + side * c, side
    go_to(m, m.landing_circle[0], m.landing_circle[1], m.home[2] - m.AUTOLAND_WP_ALT)
    return True


@kernel
def _speed(m: Any) -> float:
    return math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])


@kernel
def _left(m: Any) -> float:
    """Returns how far the landing point is along the final [m], negative beyond it."""
    c, s = math.cos(m.line[2]), math.sin(m.line[2])
    return float((m.landing_point[0] - m.position[0]) * c + (m.landing_point[1] - m.position[1]) * s)


@kernel
def _target_distance(m: Any) -> float:
    n, e = m.guided_position[0] - m.position[0], m.guided_position[1] - m.position[1]
    return math.sqrt(n * n + e * e)


@kernel
def _circle(m: Any, h: float) -> None:
    n, e, side = m.landing_circle[0], m.landing_circle[1], m.landing_circle[2]
    fly(m, circle_around(m, n, e, side), m.guided_position[2], cruise_speed(m), h)
    if m.landing_turned >= 0.0:
        m.landing_turned += _speed(m) / max(_target_distance(m), 1.0) * h
    elif is_on_circle(m, n, e) and abs(m.position[2] - m.guided_position[2]) < _CLOSE:
        m.landing_turned = 0.0
    if m.landing_turned < 0.0:
        return
    course = math.atan2(m.velocity[1], m.velocity[0])
    bearing = math.atan2(m.home[1] - m.position[1], m.home[0] - m.position[0])
    margin = _AHEAD * (1.0 + math.floor(m.landing_turned / (2.0 * math.pi)))
    if abs(wrap_pi(course - bearing)) <= margin:
        say(m, MAV_SEVERITY_INFO, CIRCLED, 0)
        _begin_final(m)


@kernel
def _begin_final(m: Any) -> None:
    m.landing_stage = _FINAL
    say_figures(m, MAV_SEVERITY_INFO, LANDING_BEGINS, (m.home[2] - m.position[2], 0.0, 0.0, 0.0))
    go_to(m, m.landing_point[0], m.landing_point[1], m.landing_point[2])


@kernel
def _begin_landing(m: Any, n: float, e: float, d: float, climbed: bool) -> None:
    """Begins the landing of a mission at a place, from the former target or, after a climb or beyond it, from here."""
    a, b, c = m.guided_position[0], m.guided_position[1], m.guided_position[2]
    if climbed or (n - m.position[0]) * (n - a) + (e - m.position[1]) * (e - b) <= 0.0:
        a, b, c = m.position[0], m.position[1], m.position[2]
    m.line[0], m.line[1], m.line[2] = a, b, math.atan2(e - b, n - a)
    m.landing_point[0], m.landing_point[1], m.landing_point[2] = n, e, d
    m.final[0], m.final[1] = max(math.sqrt((n - a) ** 2 + (e - b) ** 2), 1.0), d - c
    _begin_final(m)


@kernel
def _slope(m: Any) -> tuple[float, float, float]:
    """Returns the slope of the final, and how far before and above its end [m] the flare begins."""
    total, speed = float(m.final[0]), max(_speed(m), 0.5)
    sink = m.final[1] / max(total / speed, 0.5)
    aim = m.LAND_FLARE_SEC * sink
    if aim <= 0.0:
        aim = m.LAND_FLARE_ALT
    if m.LAND_FLARE_ALT > 0.0:
        aim = min(aim, 2.0 * m.LAND_FLARE_ALT)
    mean = max(_FLARE_SHARE * m.TECS_LAND_SINK + (1.0 - _FLARE_SHARE) * sink, 0.1)
    distance = min(speed * aim / mean, 0.5 * total)
    return float((m.final[1] - aim) / (total - distance)), float(distance), float(aim)


@kernel
def _final_speed(m: Any) -> float:
    if m.TECS_LAND_ARSPD >= 0.0:
        return float(min(m.TECS_LAND_ARSPD, m.AIRSPEED_CRUISE))
    return 0.5 * float(m.AIRSPEED_CRUISE + m.AIRSPEED_MIN)


@kernel
def _is_on_approach(m: Any, done: float) -> bool:
    """Returns whether the approach begins, by the share of the final that is done."""
    c, s = math.cos(m.line[2]), math.sin(m.line[2])
    right = (m.position[1] - m.line[1]) * c - (m.position[0] - m.line[0]) * s
    ahead = abs(wrap_pi(math.atan2(m.velocity[1], m.velocity[0]) - m.line[2])) < _AHEAD
    below = m.landing_point[2] - m.position[2] < m.final[1]
    return bool(
        (done >= 0.0 and ahead and abs(right) < _ON_LINE) or (done > _EARLY and ahead and below) or done > _HALF
    )


@kernel
def _descend(m: Any, h: float) -> None:
    """Follows the final down to the flare."""
    left = _left(m)
    top = float(m.final[1])
    done = 1.0 - left / m.final[0]
    slope, before, aim = _slope(m)
    if m.landing_stage == _FINAL:
        if _is_on_approach(m, done):
            m.landing_stage = _APPROACH
            say_figures(m, MAV_SEVERITY_INFO, SLOPE, (math.degrees(math.atan(slope)), 0.0, 0.0, 0.0))
        else:
            slope, before, aim = top / m.final[0], 0.0, 0.0
    height = clip(aim + slope * (left - before), min(top, 0.0), max(top, 0.0))
    sink = slope * _speed(m) if 0.0 < height < top else 0.0
    speed = _final_speed(m) if m.landing_stage == _APPROACH else cruise_speed(m)
    ground = float(m.landing_point[2])
    fly(m, line_bank(m), ground - height + sink / CLIMB_P, speed, h)
    above, falls = ground - m.position[2], float(m.velocity[2])
    low = above <= m.LAND_FLARE_ALT or (m.LAND_FLARE_SEC > 0.0 and above <= falls * m.LAND_FLARE_SEC and done > _HALF)
    if (m.landing_stage == _APPROACH and low) or done >= 1.0:
        m.landing_stage = _FLARE
        m.ground_down = min(m.ground_down, ground)
        m.flare[0], m.flare[1], m.flare[2] = above, falls, above
        say_figures(m, MAV_SEVERITY_INFO, FLARES, (above, falls, _speed(m), _target_distance(m)))


@kernel
def _flare(m: Any, h: float) -> None:
    """Lets it settle with the throttle closed."""
    most = math.radians(m.LEVEL_ROLL_LIMIT)
    _, nose = roll_pitch_from_quaternion((m.attitude[0], m.attitude[1], m.attitude[2], m.attitude[3]))
    speed, above, begun = max(_speed(m), 5.0), float(m.landing_point[2] - m.position[2]), float(m.flare[0])
    settled, level = 1.0, 1.0
    if begun > _HOLD_OFF:
        settled = clip((begun - above) / (begun - _HOLD_OFF), 0.0, 1.0)
        level = clip((begun - above) / begun, 0.0, 1.0)
    sink = float(m.flare[1]) * (1.0 - settled) + float(m.TECS_LAND_SINK) * settled
    m.flare[2] = max(m.flare[2] - sink * h, 0.0)
    path = -m.velocity[2] / speed
    wanted = (_FLARE_HEIGHT * (m.flare[2] - above) - sink) / speed
    least = (1.0 - level) * math.radians(m.PTCH_LIM_MIN_DEG)
    pitch = clip(nose - path + wanted + _FLARE_GAIN * (wanted - path), least, math.radians(m.PTCH_LIM_MAX_DEG))
    servos(m, clip(line_bank(m), -most, most), pitch, max(m.motor[2] - _SLEW * h, 0.0), h)


@kernel
def land_on_wheels(m: Any, h: float) -> None:
    """Flies AUTOLAND, or the landing of a mission that has begun."""
    if m.landing_stage == _CIRCLES:
        _circle(m, h)
    elif m.landing_stage < _FLARE:
        _descend(m, h)
    else:
        _flare(m, h)


@kernel
def land_in_mission(m: Any, row: int, t: float, h: float) -> None:
    """Carries out NAV_LAND, an item of the mission."""
    if m.on_ground:
        rest(m)
        return
    if m.item_since < 0.0 or m.landing_stage == _NONE:
        m.item_since = t
        n, e, d = item_place(m, row)
        _begin_landing(m, n, e, d, int(m.mission[row - 1, COMMAND]) == MAV_CMD_NAV_TAKEOFF)
    land_on_wheels(m, h)


@kernel
def watch_autoland(m: Any, t: float) -> None:
    """Notes the direction of the take-off, and disarms after the landing; required ten times a second."""
    if not m.armed:
        if m.landing_stage == _DISARMED:
            say(m, MAV_SEVERITY_INFO, AUTO_DISARMED, 0)
            say_figures(m, MAV_SEVERITY_INFO, LANDED_AT, (_target_distance(m), 0.0, 0.0, 0.0))
        m.landing_stage, m.direction_known = _NONE, False
    elif not m.direction_known:
        if not m.on_ground and m.mode in _COUNTS and _speed(m) > _COURSE_SPEED:
            _note_direction(m, math.atan2(m.velocity[1], m.velocity[0]) + math.radians(m.AUTOLAND_DIR_OFF))
    elif m.mode != _AUTOLAND and not is_landing(m):
        m.landing_stage = _NONE
    elif not m.on_ground or _speed(m) >= _MOVES:
        m.stands_since = t + _DOUBT
    elif m.landing_stage >= _FLARE and m.LAND_DISARMDELAY > 0.0 and t - m.stands_since >= m.LAND_DISARMDELAY - 1e-9:
        m.armed = False
        m.landing_stage = _DISARMED
    m.lands_on_wheels = m.landing_stage >= _FINAL
