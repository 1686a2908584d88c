"""Texts by which planes and quadplanes tell how far a return, a landing and a launch have come, as ArduPlane does.

Returns and vertical landings are those of `QuadplaneAutopilot`. Kernels over its record; for launches, that of
`PlaneAutopilot` with `LAUNCH_MEMORY` is enough.

Source: ArduPilot, ArduPlane/quadplane.cpp (poscontrol_init_approach, vtol_position_controller, verify_vtol_land),
mode_qrtl.cpp, mode_takeoff.cpp, takeoff.cpp (auto_takeoff_check).
"""

from __future__ import annotations

import math
from typing import Any

from cosim import Memory
from cosim.kernel import kernel
from cosim.messages import MAV_SEVERITY_INFO
from cosim_models.autopilot.gcs.streams import heading
from cosim_models.autopilot.gcs.words import (
    ABOVE,
    APPROACH,
    BRAKED,
    BRAKES,
    CLIMBING,
    DESCENDS,
    FINAL,
    HOLDS_COURSE,
    LEVELS_OFF,
    NEAR,
    NEAR_HOME,
    SLOWING,
    TAKES_OFF,
    TRIGGERED,
    WAITS,
    say,
    say_figures,
)
from cosim_models.autopilot.wing.flight import LAUNCH_DISTANCE

__all__ = [
    "LAUNCH_DELAY",
    "LAUNCH_MEMORY",
    "LEVEL_OFF",
    "PROGRESS_MEMORY",
    "begin_launch",
    "tell_above",
    "tell_approach",
    "tell_braking",
    "tell_descent",
    "tell_launch",
    "tell_position",
    "tell_return",
    "tell_rotors",
]

LAUNCH_DELAY = 0.2
"""Time [s] from TAKEOFF to the propeller: TKOFF_THR_DELAY of ArduPlane."""
LEVEL_OFF = 2.0
"""Time [s] before its end at which a climb begins to level off: TKOFF_PLIM_SEC of ArduPlane."""
_ON_WAY, _ABOVE, _DESCENDS, _FINAL = range(4)  # m.landing_stage
_WAITS, _TRIGGERED, _TOLD = range(3)  # m.launch_stage
_NEAR, _SLOW = 10.0, 9.0  # m and m/s, from which on it is above its place
_FLYING, _ROLLING = 3.0, 5.0  # m/s
_LEAST_HEIGHT = 10.0  # m, of the beginning of a level-off
_SLEW = 1.0  # of the throttle [1/s]: THR_SLEWRATE

LAUNCH_MEMORY = (
    Memory("launch_stage", dtype="i4", rare=True),
    Memory("launched_at", rare=True),  # s
    Memory("launched_high", dtype="?", rare=True),  # in the air
    Memory("levels_since", rare=True),  # s, since when the climb levels off; -1: it does not
)
PROGRESS_MEMORY = (Memory("landing_stage", dtype="i4", rare=True), *LAUNCH_MEMORY)


@kernel
def _speed(m: Any) -> float:
    return math.sqrt(m.velocity[0] * m.velocity[0] + m.velocity[1] * m.velocity[1])


@kernel
def _stop(m: Any, speed: float) -> float:
    """Returns the distance [m] within which it stops."""
    return float(0.5 * speed * speed / m.Q_TRANS_DECEL)


@kernel
def _height(m: Any) -> float:
    return float(m.home[2] - m.position[2])


@kernel
def tell_return(m: Any, distance: float) -> None:
    """Tells of a return that begins near home, on the rotors."""
    radius = 1.5 * m.WP_LOITER_RAD
    if m.vtol and not m.on_ground and distance < radius:
        say_figures(m, MAV_SEVERITY_INFO, NEAR_HOME, (distance, radius, 0.0, 0.0))


@kernel
def tell_approach(m: Any, distance: float) -> bool:
    """Tells of a new target, by its distance [m], if it is on the rotors or far; returns whether it is near."""
    m.landing_stage = _ON_WAY
    near = bool(distance < 1.5 * _stop(m, m.AIRSPEED_CRUISE))
    if m.vtol or not near:
        say_figures(m, MAV_SEVERITY_INFO, NEAR if near else APPROACH, (distance, 0.0, 0.0, 0.0))
    return near


@kernel
def tell_rotors(m: Any, distance: float) -> None:
    """Tells that the rotors, which run already, take over before a place, by its distance [m]."""
    speed = _speed(m)
    figures = speed, distance, _stop(m, speed) + 2.0 * speed, _height(m)
    say_figures(m, MAV_SEVERITY_INFO, SLOWING, figures)


@kernel
def tell_braking(m: Any, distance: float) -> None:
    """Tells that the rotors run as air brakes before a place, by its distance [m]."""
    speed = _speed(m)
    figures = speed, distance, _stop(m, speed) + 2.0 * speed, _height(m)
    say_figures(m, MAV_SEVERITY_INFO, BRAKES, figures)


@kernel
def tell_position(m: Any, distance: float, wanted: float) -> None:
    """Tells that the rotors take over after that, by the distance [m] and the speed that is wanted [m/s]."""
    say_figures(m, MAV_SEVERITY_INFO, BRAKED, (_speed(m), distance, _height(m), wanted))


@kernel
def tell_above(m: Any, distance: float) -> None:
    """Tells once that it is above its place, by the distance from it [m]."""
    if m.landing_stage == _ON_WAY and distance < _NEAR and _speed(m) < _SLOW:
        m.landing_stage = _ABOVE
        say_figures(m, MAV_SEVERITY_INFO, ABOVE, (_speed(m), distance, _height(m), 0.0))


@kernel
def tell_descent(m: Any) -> None:
    """Tells once that the descent begins, and once that it becomes slow."""
    if m.landing_stage < _DESCENDS:
        m.landing_stage = _DESCENDS
        say(m, MAV_SEVERITY_INFO, DESCENDS, 0)
    if m.landing_stage == _DESCENDS and _height(m) < m.Q_LAND_FINAL_ALT:
        m.landing_stage = _FINAL
        say(m, MAV_SEVERITY_INFO, FINAL, 0)


@kernel
def begin_launch(m: Any, told: bool) -> None:
    """Begins a launch, of which nothing more is to be told if `told`."""
    m.launched_at, m.launch_stage, m.launched_high = -1.0, _TOLD if told else _WAITS, not m.on_ground
    m.levels_since = -1.0


@kernel
def _tell_course(m: Any, speed: float) -> None:
    course = math.degrees(heading(m)) % 360.0
    if m.mission_active:
        figures = float(math.floor(100.0 * course + 0.5) % 36000), speed, 0.0, 0.0
        say_figures(m, MAV_SEVERITY_INFO, HOLDS_COURSE, figures)
    else:
        say_figures(m, MAV_SEVERITY_INFO, TAKES_OFF, (m.TKOFF_ALT, LAUNCH_DISTANCE, course, 0.0))


@kernel
def tell_launch(m: Any, t: float) -> float:
    """Tells how far a launch by TAKEOFF or a mission has come; returns the greatest throttle."""
    climb, left = float(-m.velocity[2]), float(m.position[2] - m.guided_position[2])
    if m.levels_since < 0.0 and climb > 0.1 and 0.0 < left <= LEVEL_OFF * climb and _height(m) >= _LEAST_HEIGHT:
        m.levels_since = t
        say(m, MAV_SEVERITY_INFO, LEVELS_OFF, int(left))
    speed = _speed(m)
    if m.launched_at < 0.0:
        if m.launch_stage == _TOLD:
            return 1.0
        if not m.told_armed:  # this comes first
            return 0.0
        m.launched_at = t
        say_figures(m, MAV_SEVERITY_INFO, WAITS, (0.0, LAUNCH_DELAY, 0.0, 0.0))
    if m.launch_stage == _WAITS:
        if t - m.launched_at < LAUNCH_DELAY - 1e-9:
            return 0.0
        m.launch_stage = _TRIGGERED
        say_figures(m, MAV_SEVERITY_INFO, TRIGGERED, (speed, 0.0, 0.0, 0.0))
    if m.launch_stage == _TRIGGERED and speed > (_FLYING if m.launched_high else _ROLLING):
        m.launch_stage = _TOLD
        if m.launched_high:
            say(m, MAV_SEVERITY_INFO, CLIMBING, 0)
        else:
            _tell_course(m, speed)
    return 1.0 if m.launched_high else min(_SLEW * (t - m.launched_at - LAUNCH_DELAY), 1.0)
