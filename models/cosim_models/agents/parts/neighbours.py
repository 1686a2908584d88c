"""The neighbour table of an agent, as kernels over its record: the drones heard, their positions and ages.

A row is filled from GLOBAL_POSITION_INT of each drone heard, not from LOCAL_POSITION_NED, whose origin differs between
autopilots. The table has rows for `capacity` system ids; if more are heard, the nearest ones keep their rows. A law
sees the *neighbours* among them: those that were heard recently, are in the air, in the list (if one exists) and within
the radius, and of these the nearest. They are in the order of their system ids, so the result does not depend on the
order in which packets arrive.

The position of a neighbour is extrapolated from its last message at constant velocity: at 4 Hz and 5 m/s, the last
reported position is off by up to 1.25 m.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

from cosim import Memory, Output, Parameter, Variable
from cosim.frames import Vector, local_from_geodetic, radians_from_deg_e7
from cosim.kernel import kernel
from cosim.messages import decode_global_position_int
from cosim.verdict import Bound

__all__ = ["distance_from", "heard_variables", "locate", "neighbour_variables", "note", "row_for", "select"]


def neighbour_variables(capacity: int) -> tuple[Variable, ...]:
    """Returns the variables of an agent with a neighbour table of `capacity` rows."""
    return (
        Parameter(
            "neighbour_ids",
            type=int,
            shape=capacity,
            start=0,
            minimum=0,
            maximum=255,
            description="system ids that may be neighbours, 0: none; all 0: whoever is heard",
        ),
        Parameter("nearest", type=int, start=0, minimum=0, description="so many of them, the nearest; 0: all"),
        Parameter("radius", unit="m", start=1e6, minimum=0.0, description="within which they are"),
        Parameter("stale_time", unit="s", start=1.0, minimum=0.0, description="age at which they no longer are"),
        Parameter(
            "airborne_height",
            unit="m",
            start=1.0,
            description="above their homes, below which they are not; negative: on the ground they are",
        ),
        Parameter("social", type=bool, start=False, description="to fly without a neighbour is a finding"),
        Output(
            "neighbours",
            type=int,
            start=0,
            verdict=Bound(least=1.0, of="social", text="it has no neighbours: is anybody in reach, and in the air?"),
            description="how many it has",
        ),
        Memory("near_id", dtype="i4", shape=capacity),
        Memory("near_position", shape=(capacity, 3)),  # m, NED
        Memory("near_velocity", shape=(capacity, 3)),  # m/s, NED
        Memory("near_age", shape=capacity),  # s
        Memory("near_distance", shape=capacity),  # m
        *heard_variables(capacity),
    )


def heard_variables(capacity: int, *, rare: bool = False) -> tuple[Variable, ...]:
    """Returns the memory of the drones heard, with `capacity` rows."""
    return (
        Memory("heard_id", dtype="i4", shape=capacity, rare=rare),  # 0: a free row
        Memory("heard_at", shape=capacity, rare=rare),  # s
        Memory("heard_position", shape=(capacity, 3), rare=rare),  # m, NED
        Memory("heard_velocity", shape=(capacity, 3), rare=rare),  # m/s, NED
    )


@kernel
def locate(m: Any) -> tuple[bool, float, float, float, float, float, float, float]:
    """Returns the contents of the GLOBAL_POSITION_INT in the payload buffer.

    They are: whether its sender knows its position; north, east, down [m]; velocity, NED [m/s]; height above home [m].
    """
    _, latitude, longitude, altitude, relative_alt, vx, vy, vz, _ = decode_global_position_int(m.payload)
    north, east, down = local_from_geodetic(
        radians_from_deg_e7(latitude),
        radians_from_deg_e7(longitude),
        0.001 * altitude,
        m.origin_latitude,
        m.origin_longitude,
        m.origin_altitude,
    )
    known = latitude != 0 or longitude != 0
    return known, north, east, down, 0.01 * vx, 0.01 * vy, 0.01 * vz, 0.001 * relative_alt


@kernel
def note(m: Any, sender: int, now: float) -> None:
    """Enters the message of `sender` in the payload buffer into the table, if it may be a neighbour and finds a row.

    An agent that keeps a separation enters all drones that it hears.
    """
    if m.guard_separation == 0.0 and not _may_be(m, sender):
        return
    known, north, east, down, vn, ve, vd, height = locate(m)
    if not known:
        return
    row = row_for(m, sender, m.position, distance_from(m.position, north, east, down), now)
    if row < 0:
        return
    if height < m.airborne_height:
        if m.heard_id[row] == sender:
            m.heard_id[row] = 0
        return
    m.heard_id[row] = sender
    m.heard_at[row] = now
    m.heard_position[row, 0], m.heard_position[row, 1], m.heard_position[row, 2] = north, east, down
    m.heard_velocity[row, 0], m.heard_velocity[row, 1], m.heard_velocity[row, 2] = vn, ve, vd


@kernel
def _may_be(m: Any, sender: int) -> bool:
    listed = False
    for i in range(m.neighbour_ids.size):
        if m.neighbour_ids[i] == sender:
            return True
        listed = listed or m.neighbour_ids[i] != 0
    return not listed


@kernel
def distance_from(place: Vector, north: float, east: float, down: float) -> float:
    """Returns the distance of a point from a place [m]."""
    n, e, d = north - place[0], east - place[1], down - place[2]
    return sqrt(n * n + e * e + d * d)


@kernel
def row_for(m: Any, sender: int, place: Vector, distance: float, now: float) -> int:
    """Returns the row for `sender`, which is at a `distance` [m] from the own place; -1 if none exists.

    It is its own row, a free one, a stale one, or that of a farther drone.
    """
    free, farthest, far = -1, -1, distance
    for row in range(m.heard_id.size):
        if m.heard_id[row] == sender:
            return row
        if m.heard_id[row] == 0 or now - m.heard_at[row] > m.stale_time:
            if free < 0:
                free = row
            continue
        away = distance_from(place, m.heard_position[row, 0], m.heard_position[row, 1], m.heard_position[row, 2])
        if away > far:
            farthest, far = row, away
    return free if free >= 0 else farthest


@kernel
def select(m: Any, now: float) -> None:
    """Fills `near_*` with the current neighbours."""
    m.neighbours = 0
    for row in range(m.heard_id.size):
        age = now - m.heard_at[row]
        if m.heard_id[row] == 0 or age > m.stale_time:
            continue
        if m.guard_separation > 0.0 and not _may_be(m, m.heard_id[row]):
            continue
        north = m.heard_position[row, 0] + age * m.heard_velocity[row, 0]
        east = m.heard_position[row, 1] + age * m.heard_velocity[row, 1]
        down = m.heard_position[row, 2] + age * m.heard_velocity[row, 2]
        distance = distance_from(m.position, north, east, down)
        if distance <= m.radius:
            k = _place(m, m.heard_id[row])
            m.near_id[k], m.near_age[k], m.near_distance[k] = m.heard_id[row], age, distance
            m.near_position[k, 0], m.near_position[k, 1], m.near_position[k, 2] = north, east, down
            for i in range(3):
                m.near_velocity[k, i] = m.heard_velocity[row, i]
    while 0 < m.nearest < m.neighbours:
        _leave_out_farthest(m)


@kernel
def _place(m: Any, sender: int) -> int:
    """Makes room for a neighbour, in the order of system ids; returns its index."""
    k = m.neighbours
    while k > 0 and m.near_id[k - 1] > sender:
        _move(m, k - 1, k)
        k -= 1
    m.neighbours += 1
    return int(k)


@kernel
def _leave_out_farthest(m: Any) -> None:
    farthest, far = 0, -inf
    for k in range(m.neighbours):
        if m.near_distance[k] > far:
            farthest, far = k, m.near_distance[k]
    for k in range(farthest, m.neighbours - 1):
        _move(m, k + 1, k)
    m.neighbours -= 1


@kernel
def _move(m: Any, k: int, to: int) -> None:
    m.near_id[to], m.near_age[to], m.near_distance[to] = m.near_id[k], m.near_age[k], m.near_distance[k]
    for i in range(3):
        m.near_position[to, i] = m.near_position[k, i]
        m.near_velocity[to, i] = m.near_velocity[k, i]
