"""The guard of an agent: it changes the velocity that a law asks for as little as separation and a fence need.

Any agent may have it: `guard_separation` and `fence_corners` are 0 unless a system sets them. Of all
velocities that keep every bound, the guard takes the one nearest to that of the law (a quadratic programme in the
plane). The bounds are on the speed towards each drone heard and towards each side of the fence:

    speed <= s(room)        s: the speed from which `guard_braking` stops in the room, and at most guard_p * room

The room is the distance to the fence, or half of the distance beyond `guard_separation`: the other drone has the other
half. For vehicles that fly exactly at their set-points, r(t) - separation then never falls faster than by the factor
(1 - guard_p * period) in a period, whatever the laws are: it stays positive. A drone that is too near is left.

Source: L. Wang, A. D. Ames, M. Egerstedt, Safety barrier certificates for collisions-free multirobot systems, IEEE
Trans. Robotics 33 (2017); the braking speed is that of ArduPilot's AC_Avoid. The programme is solved as in J. van den
Berg et al., Reciprocal n-body collision avoidance (2011): bounds are added one by one.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

from cosim import Memory, Parameter, State, Variable
from cosim.frames import Vector
from cosim.kernel import kernel

__all__ = [
    "ACCELERATION",
    "NOTHING_NEW",
    "POSITION",
    "VELOCITY",
    "fence_is_convex",
    "guard",
    "guard_variables",
    "is_guarded",
    "sqrt_controller",
]

NOTHING_NEW, POSITION, VELOCITY, ACCELERATION = 0, 1, 2, 4
"""Results of a law: the set-points that are valid, added; NOTHING_NEW: none is sent."""

_CORNERS = 8
_TINY = 1e-9
_HALVINGS = 20


def guard_variables(capacity: int) -> tuple[Variable, ...]:
    """Returns the variables of the guard of an agent with a neighbour table of `capacity` rows."""
    return (
        Parameter(
            "guard_separation",
            unit="m",
            start=0.0,
            minimum=0.0,
            description="kept from every drone heard that flies less than this above or below; 0: none",
        ),
        Parameter("guard_p", unit="1/s", start=0.5, minimum=0.0, rare=True, description="largest speed per room"),
        Parameter("guard_braking", unit="m/s2", start=1.25, minimum=1e-3, rare=True, description="in which it stops"),
        Parameter("fence_corners", type=int, start=0, minimum=0, maximum=_CORNERS, description="of the fence; 0: none"),
        Parameter("fence_north", shape=_CORNERS, unit="m", start=0.0, rare=True, description="its convex polygon"),
        Parameter("fence_east", shape=_CORNERS, unit="m", start=0.0, rare=True, description="its convex polygon"),
        State("guard_acts", type=int, start=0, description="how often the guard has changed what the law asked for"),
        Memory("law_result", dtype="i4", rare=True),
        Memory("law_gave", shape=(3, 3), rare=True),  # position, velocity, acceleration
        Memory("bound_north", shape=capacity + _CORNERS, rare=True),
        Memory("bound_east", shape=capacity + _CORNERS, rare=True),
        Memory("bound_speed", shape=capacity + _CORNERS, rare=True),
    )


@kernel
def sqrt_controller(error: float, p: float, acceleration: float) -> float:
    """Returns p times a small error; for a large one, the speed from which `acceleration` can stop (as ArduPilot)."""
    linear = acceleration / (p * p)
    return sqrt(2.0 * acceleration * (error - 0.5 * linear)) if error > linear else p * error


@kernel
def is_guarded(m: Any) -> bool:
    """Returns whether the agent has a guard."""
    return bool(m.guard_separation > 0.0 or m.fence_corners > 0)


@kernel
def _turn(m: Any, a: int, b: int, c: int) -> float:
    """Returns twice the area of the triangle of three corners of the fence, positive if they turn clockwise."""
    n, e = m.fence_north[b] - m.fence_north[a], m.fence_east[b] - m.fence_east[a]
    return float(n * (m.fence_east[c] - m.fence_east[a]) - e * (m.fence_north[c] - m.fence_north[a]))


@kernel
def fence_is_convex(m: Any) -> bool:
    """Returns whether the fence is a convex polygon, or there is none."""
    count, least, most = m.fence_corners, inf, -inf
    for k in range(count):
        for other in range(count):
            if other != k and other != (k + 1) % count:
                turn = _turn(m, k, (k + 1) % count, other)
                least, most = min(least, turn), max(most, turn)
    return bool(count == 0 or (count > 2 and (least > 0.0 or most < 0.0)))


@kernel
def _add(m: Any, count: int, north: float, east: float, room: float) -> int:
    """Adds the bound in a direction with so much room; returns the number of bounds."""
    m.bound_north[count], m.bound_east[count] = north, east
    m.bound_speed[count] = max(sqrt_controller(room, m.guard_p, m.guard_braking), -m.speed_limit)
    return count + 1


@kernel
def _bounds(m: Any, now: float, place: Vector) -> int:
    """Lists the bounds at a place, those of other drones first; returns their number."""
    count = 0
    for row in range(m.heard_id.size if m.guard_separation > 0.0 else 0):
        age = now - m.heard_at[row]
        if m.heard_id[row] == 0 or age > m.stale_time:
            continue
        north = m.heard_position[row, 0] + age * m.heard_velocity[row, 0] - place[0]
        east = m.heard_position[row, 1] + age * m.heard_velocity[row, 1] - place[1]
        down = m.heard_position[row, 2] + age * m.heard_velocity[row, 2] - place[2]
        away = sqrt(north * north + east * east)
        if abs(down) >= m.guard_separation:
            continue
        if away < _TINY:  # at one place: the one with the smaller id leaves it to the north
            north, east, away = 1.0 if m.heard_id[row] > m.sysid else -1.0, 0.0, 0.0
            count = _add(m, count, -north, east, -0.5 * m.guard_separation)
        else:
            count = _add(m, count, north / away, east / away, 0.5 * (away - m.guard_separation))
    for a in range(m.fence_corners):
        b = (a + 1) % m.fence_corners
        side = 1.0 if _turn(m, a, b, (a + 2) % m.fence_corners) > 0.0 else -1.0
        north, east = m.fence_north[b] - m.fence_north[a], m.fence_east[b] - m.fence_east[a]
        length = sqrt(north * north + east * east)
        out_n, out_e = side * east / length, -side * north / length
        room = out_n * (m.fence_north[a] - place[0]) + out_e * (m.fence_east[a] - place[1])
        count = _add(m, count, out_n, out_e, room)
    return count


@kernel
def _keep(m: Any, count: int, slack: float) -> bool:
    """Changes the velocity to the nearest one that keeps all bounds plus `slack`; returns whether one exists."""
    want_n, want_e = m.setpoint_velocity[0], m.setpoint_velocity[1]
    n, e = want_n, want_e
    for i in range(count):
        out_n, out_e, most = m.bound_north[i], m.bound_east[i], m.bound_speed[i] + slack
        if out_n * n + out_e * e <= most + _TINY:
            continue
        # The velocity is on the line where this bound is reached; the earlier bounds leave a part of that line.
        on_n, on_e = out_n * most, out_e * most
        low, high = -inf, inf
        for j in range(i):
            along = m.bound_east[j] * out_n - m.bound_north[j] * out_e
            left = m.bound_speed[j] + slack - m.bound_north[j] * on_n - m.bound_east[j] * on_e
            if along > _TINY:
                high = min(high, left / along)
            elif along < -_TINY:
                low = max(low, left / along)
            elif left < -_TINY:
                return False
        if low > high + _TINY:
            return False
        s = min(max(want_e * out_n - want_n * out_e, low), high)
        n, e = on_n - s * out_e, on_e + s * out_n
    m.setpoint_velocity[0], m.setpoint_velocity[1] = n, e
    return True


@kernel
def _relax(m: Any, count: int) -> None:
    """Changes the velocity to the nearest one that keeps all bounds plus the same speed, the least that is possible."""
    low, high = 0.0, 0.0
    for i in range(count):
        high = max(high, -m.bound_speed[i])  # then all bounds allow to stay
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _keep(m, count, middle):
            high = middle
        else:
            low = middle
    _keep(m, count, high)


@kernel
def _as_velocity(m: Any, which: int, place: Vector, velocity: Vector) -> None:
    """Makes a velocity of the set-points that hold: towards the position, and after a period of the acceleration."""
    north, east = m.setpoint_position[0] - place[0], m.setpoint_position[1] - place[1]
    if which & VELOCITY == 0:
        start = 1.0 if which & ACCELERATION != 0 and which & POSITION == 0 else 0.0
        for i in range(3):
            m.setpoint_velocity[i] = start * velocity[i]
    if which & POSITION != 0:
        away = sqrt(north * north + east * east)
        if away > 0.0:
            speed = sqrt_controller(away, m.guard_p, m.guard_braking)
            m.setpoint_velocity[0] += speed * north / away
            m.setpoint_velocity[1] += speed * east / away
        m.setpoint_velocity[2] += m.guard_p * (m.setpoint_position[2] - place[2])
    if which & ACCELERATION != 0:
        for i in range(3):
            m.setpoint_velocity[i] += m.period * m.setpoint_acceleration[i]


@kernel
def guard(m: Any, now: float, which: int, place: Vector, velocity: Vector) -> int:
    """Guards the set-points that a law gave, or its last ones; returns which hold afterwards: the velocity.

    If no velocity keeps all bounds, all of them are raised by the same speed.

    Args:
        m: the record.
        now: time [s].
        which: the set-points that the law gave.
        place, velocity: of the own drone, NED in the frame of `heard_position` and of the fence [m, m/s].
    """
    if which < 0 or which > POSITION + VELOCITY + ACCELERATION:
        return which
    if which == NOTHING_NEW:
        which = m.law_result
        if which == NOTHING_NEW:
            return which
        for i in range(3):
            m.setpoint_position[i], m.setpoint_velocity[i] = m.law_gave[0, i], m.law_gave[1, i]
            m.setpoint_acceleration[i] = m.law_gave[2, i]
    else:
        m.law_result = which
        for i in range(3):
            m.law_gave[0, i], m.law_gave[1, i] = m.setpoint_position[i], m.setpoint_velocity[i]
            m.law_gave[2, i] = m.setpoint_acceleration[i]
    _as_velocity(m, which, place, velocity)
    speed = sqrt(m.setpoint_velocity[0] * m.setpoint_velocity[0] + m.setpoint_velocity[1] * m.setpoint_velocity[1])
    if speed > m.speed_limit:
        m.setpoint_velocity[0] *= m.speed_limit / speed
        m.setpoint_velocity[1] *= m.speed_limit / speed
    north, east = m.setpoint_velocity[0], m.setpoint_velocity[1]
    count = _bounds(m, now, place)
    if not _keep(m, count, 0.0):
        _relax(m, count)
    if m.setpoint_velocity[0] != north or m.setpoint_velocity[1] != east:
        m.guard_acts += 1
    return VELOCITY
