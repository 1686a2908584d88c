"""The frame of agents on a line: positions along a parallel of latitude, steps by time or arrival, set-points there.

A law on a line is a kernel, as one in space is (`kit`); `parts.assembly` tells which parts of a step the frames share.
`line_agent` describes the purpose of the agent, and `script` handles the take-off.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from math import floor
from typing import Any

import numpy as np

from cosim import Memory, Parameter, Variable
from cosim.frames import EARTH_RADIUS_ARDUPILOT, deg_e7, haversine, longitude_at, radians_from_deg_e7, wrap_pi
from cosim.kernel import kernel
from cosim.messages import (
    MAV_COMP_ID_AUTOPILOT1,
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_global_position_int,
    encode_set_position_target_global_int,
)
from cosim_models.agents.parts.assembly import NO_SUM, PERIOD_IS_SHORT, SHORT_PERIOD, Frame, Law, assembled
from cosim_models.agents.parts.conversation import SLACK, reposition, send
from cosim_models.agents.parts.guard import POSITION, fence_is_convex, guard, guard_variables, is_guarded
from cosim_models.agents.parts.neighbours import distance_from, heard_variables, row_for
from cosim_models.agents.parts.script import NEVER, AgentState, enter_next, stale

__all__ = ["ERRORS", "POSITION", "StalePolicy", "Trigger", "line_guard", "line_kernels"]

_ONLY_POSITION = 0x0DF8  # POSITION_TARGET_TYPEMASK: velocity, acceleration, yaw and yaw rate ignored
_ONLY_VELOCITY = 0x0DC7
_LOOKAHEAD = 10.0  # s: a fixed wing follows a velocity towards the point that it leads to in so long
_LOOKAHEAD_HOVERING = 2.0  # s: a quadplane, whose speed is its distance times Q_P_POSXY_P, 0.5 /s


class Trigger(IntEnum):
    """The event that begins a step."""

    period = 1
    """time: every `period` seconds"""
    arrival = 2
    """arrival within `arrival_radius`, with news of every neighbour since the last step; or `period` seconds"""


class StalePolicy(IntEnum):
    """The position used for a neighbour that has not been heard for `stale_time`."""

    hold = 1
    """its last position, unless all neighbours are stale: then the agent stays (and is a fixed node to the others)"""
    drop = 2
    """nothing, as if it were not there"""
    freeze = 3
    """the agent stays as long as any neighbour is stale"""


ERRORS = {
    1: "sysid must be 1 to 255",
    2: "left_sysid and right_sysid must be 0 to 255 and not the agent's own",
    3: "period, position_rate, altitude and timeout must be positive",
    NO_SUM: "the law returned what is not POSITION",
    5: "the fence must be a convex polygon: give 3 to 8 fence_corners in their order, no three of them on one line",
    6: "guard_p * guard_period must be more than 0 and at most 1: a drone would fly past the bounds of its guard",
    SHORT_PERIOD: PERIOD_IS_SHORT,
}


_WAITING, _READY, _FORMATION = int(AgentState.waiting), int(AgentState.ready), int(AgentState.formation)
_BY_PERIOD = int(Trigger.period)
_DROP, _FREEZE = int(StalePolicy.drop), int(StalePolicy.freeze)


def line_guard(capacity: int = 16) -> tuple[Variable, ...]:
    """Returns the variables of the guard of an agent on a line, which knows up to `capacity` other drones.

    Its frame is NED from the line's zero at sea level: east is the position on the line.
    """
    return (
        *guard_variables(capacity),
        Parameter("guard_period", unit="s", start=0.2, minimum=0.0, rare=True, description="of the guard's velocities"),
        Parameter("speed_limit", unit="m/s", start=5.0, minimum=0.0, rare=True, description="of these velocities"),
        *heard_variables(capacity, rare=True),
        Memory("place", shape=3, rare=True),  # m: own position, extrapolated
        Memory("measured_place", shape=3, rare=True),  # m, at position_heard
        Memory("velocity", shape=3, rare=True),  # m/s
        Memory("level", rare=True),  # m: down of the altitude of the flight
        Memory("setpoint_position", shape=3, rare=True),
        Memory("setpoint_velocity", shape=3, rare=True),
        Memory("setpoint_acceleration", shape=3, rare=True),
        Memory("guard_turn", dtype="i4", rare=True),  # number of the guard's current period
    )


# ---- receiving and sending ---------------------------------------------------------------------------------------


@kernel
def _on_line(m: Any, longitude: float) -> float:
    """Returns the position on the line for a longitude [rad], in m."""
    distance = haversine(m.origin_latitude, m.origin_longitude, m.origin_latitude, longitude, EARTH_RADIUS_ARDUPILOT)
    return distance if wrap_pi(longitude - m.origin_longitude) >= 0.0 else -distance


@kernel
def _north(m: Any, latitude: int) -> float:
    """Returns the distance of a latitude [degE7] from the line, north positive, in m."""
    return float(EARTH_RADIUS_ARDUPILOT * (radians_from_deg_e7(latitude) - m.origin_latitude))


@kernel
def _note(m: Any, sender: int, now: float) -> None:
    """Enters the position in the payload buffer into the guard's table."""
    _, latitude, longitude, altitude, _, vx, vy, vz, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:
        return
    north, east = _north(m, latitude), _on_line(m, radians_from_deg_e7(longitude))
    down = -0.001 * altitude
    row = row_for(m, sender, m.place, distance_from(m.place, north, east, down), now)
    if row < 0:
        return
    m.heard_id[row], m.heard_at[row] = sender, now
    m.heard_position[row, 0], m.heard_position[row, 1], m.heard_position[row, 2] = north, east, down
    m.heard_velocity[row, 0], m.heard_velocity[row, 1], m.heard_velocity[row, 2] = 0.01 * vx, 0.01 * vy, 0.01 * vz


@kernel
def _from_neighbour(m: Any, sender: int, now: float) -> None:
    if m.guard_separation > 0.0:
        _note(m, sender, now)
    if sender != m.left_sysid and sender != m.right_sysid:
        return
    _, latitude, longitude, _, _, _, _, _, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:  # an autopilot that does not know its position
        return
    place = _on_line(m, radians_from_deg_e7(longitude))
    if sender == m.left_sysid:
        m.left_position = place
        m.left_heard = now
    if sender == m.right_sysid:
        m.right_position = place
        m.right_heard = now


@kernel
def _own_position(m: Any, now: float) -> None:
    _, latitude, longitude, altitude, relative_alt, vx, vy, vz, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:
        return
    m.latitude = latitude
    m.height = 0.001 * relative_alt
    m.position = _on_line(m, radians_from_deg_e7(longitude))
    m.position_heard = now
    if is_guarded(m):
        m.measured_place[0], m.measured_place[1], m.measured_place[2] = (
            _north(m, latitude),
            m.position,
            -0.001 * altitude,
        )
        m.velocity[0], m.velocity[1], m.velocity[2] = 0.01 * vx, 0.01 * vy, 0.01 * vz
        m.level = m.measured_place[2] + m.height - m.altitude


@kernel
def _go(m: Any, now: float, target: float) -> None:
    """Makes `target` [m on the line] the desired position and sends it, at the latitude of the start.

    If there is a guard, that sends velocities towards it.
    """
    m.target = target
    if m.state == _FORMATION and is_guarded(m):
        return
    longitude = longitude_at(m.origin_latitude, m.origin_longitude, target, EARTH_RADIUS_ARDUPILOT)
    if m.wings:
        reposition(m, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, m.start_latitude, deg_e7(longitude), float(m.altitude))
        return
    zero = 0.0
    encode_set_position_target_global_int(
        m.payload,
        int(1000.0 * now + 0.5),
        m.sysid,
        MAV_COMP_ID_AUTOPILOT1,
        MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        _ONLY_POSITION,
        m.start_latitude,
        deg_e7(longitude),
        m.altitude,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
    )
    send(m, int(np.int64(SET_POSITION_TARGET_GLOBAL_INT)))


@kernel
def _guarded(m: Any, now: float) -> None:
    """Sends, once in a period of the guard, the velocity towards the target that the guard allows."""
    turn = floor(now / m.guard_period + SLACK)
    begins = turn > m.guard_turn
    m.guard_turn = turn
    if not begins or m.state != _FORMATION or stale(m, m.position_heard, now):
        return
    for i in range(3):
        m.place[i] = m.measured_place[i] + m.velocity[i] * (now - m.position_heard)
    m.setpoint_position[0], m.setpoint_position[1] = _north(m, m.start_latitude), m.target
    m.setpoint_position[2] = m.level
    guard(m, now, POSITION, m.place, m.velocity)
    zero = 0.0
    if m.wings:
        ahead = _LOOKAHEAD_HOVERING if m.vtol else _LOOKAHEAD
        north = m.place[0] + ahead * m.setpoint_velocity[0]
        east = m.place[1] + ahead * m.setpoint_velocity[1]
        latitude = m.origin_latitude + north / EARTH_RADIUS_ARDUPILOT
        longitude = longitude_at(m.origin_latitude, m.origin_longitude, east, EARTH_RADIUS_ARDUPILOT)
        reposition(m, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, deg_e7(latitude), deg_e7(longitude), float(m.altitude))
        return
    encode_set_position_target_global_int(
        m.payload,
        int(1000.0 * now + 0.5),
        m.sysid,
        MAV_COMP_ID_AUTOPILOT1,
        MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        _ONLY_VELOCITY,
        m.start_latitude,
        deg_e7(longitude_at(m.origin_latitude, m.origin_longitude, m.place[1], EARTH_RADIUS_ARDUPILOT)),
        m.altitude,
        m.setpoint_velocity[0],
        m.setpoint_velocity[1],
        m.setpoint_velocity[2],
        zero,
        zero,
        zero,
        zero,
        zero,
    )
    send(m, int(np.int64(SET_POSITION_TARGET_GLOBAL_INT)))


# ---- stepping ----------------------------------------------------------------------------------------------------


@kernel
def _begins(m: Any, now: float) -> bool:
    """Counts the periods since `first_step_time`; returns whether one begins."""
    period_step = 0
    if now >= m.first_step_time - SLACK:
        period_step = 1 + floor((now - m.first_step_time) / m.period + SLACK)
    begins = period_step > m.period_step
    m.period_step = period_step
    return bool(begins)


@kernel
def _ends(m: Any, now: float) -> bool:  # noqa: ARG001
    """Returns False: it does not land."""
    return False


@kernel
def _rises(m: Any, now: float) -> bool:  # noqa: ARG001
    """Returns True: it takes off as soon as it can."""
    return True


@kernel
def _armed(m: Any) -> None:
    m.start_latitude = m.latitude
    m.start_position = m.position
    m.target = m.position


@kernel
def _follow(m: Any, now: float, begins: bool, was_ready: bool) -> bool:  # noqa: ARG001
    """Hovers and steps, as long as the autopilot is in the expected state; returns whether the law applies."""
    by_period = m.trigger == _BY_PERIOD
    if m.state == _READY:
        if begins:
            m.step = m.period_step if by_period else 1
            m.step_at = now
            _go(m, now, m.start_position)
            enter_next(m, now)
    elif m.state == _FORMATION and (begins if by_period else _arrived(m, now)):
        m.step = m.period_step if by_period else m.step + 1
        m.step_at = now
        if _can_apply(m, now):
            return True
        _go(m, now, float(m.target))
    return False


@kernel
def _arrived(m: Any, now: float) -> bool:
    if now >= m.step_at + m.period - SLACK:
        return True
    news = m.position_heard > m.step_at
    if m.left_sysid != 0:
        news = news and m.left_heard > m.step_at
    if m.right_sysid != 0:
        news = news and m.right_heard > m.step_at
    return bool(news and abs(m.position - m.target) <= m.arrival_radius)


@kernel
def _can_apply(m: Any, now: float) -> bool:
    """Returns whether the law can be applied, with `left` and `right` as the positions for it [m on the line]."""
    own = float(m.position)
    if m.stubborn or stale(m, m.position_heard, now):
        return False
    has_left, has_right = m.left_sysid != 0, m.right_sysid != 0
    left_stale = has_left and stale(m, m.left_heard, now)
    right_stale = has_right and stale(m, m.right_heard, now)
    fresh = (has_left and not left_stale) or (has_right and not right_stale)
    if not fresh:
        return False
    if m.stale_policy == _FREEZE and (left_stale or right_stale):
        return False
    if m.stale_policy == _DROP:
        has_left = has_left and not left_stale
        has_right = has_right and not right_stale
    elif (has_left and m.left_heard < 0.0) or (has_right and m.right_heard < 0.0):
        return False
    m.left = float(m.left_position) if has_left else own
    m.right = float(m.right_position) if has_right else own
    return True


# ---- the kernels of the FMU --------------------------------------------------------------------------------------


@kernel
def _start(m: Any) -> int:
    """Checks the parameters and initializes the memory: nothing has been heard yet."""
    if m.sysid < 1 or m.sysid > 255:
        return 1
    if not (0 <= m.left_sysid <= 255 and 0 <= m.right_sysid <= 255):
        return 2
    if m.left_sysid == m.sysid or m.right_sysid == m.sysid:
        return 2
    if not (m.period > 0.0 and m.position_rate > 0.0 and m.altitude > 0.0 and m.timeout > 0.0):
        return 3
    if not fence_is_convex(m):
        return 5
    if is_guarded(m) and not 0.0 < m.guard_p * m.guard_period <= 1.0:
        return 6
    m.state = _WAITING
    m.state_since = NEVER
    m.position_heard = NEVER
    m.left_heard = NEVER
    m.right_heard = NEVER
    m.left_age = NEVER
    m.right_age = NEVER
    m.answer = -1
    m.refusal = 0
    return 0


@kernel
def _finish(m: Any, now: float) -> None:
    """Updates the ages of the neighbours' positions, and has the guard act."""
    m.left_age = now - m.left_heard if m.left_heard >= 0.0 else NEVER
    m.right_age = now - m.right_heard if m.right_heard >= 0.0 else NEVER
    if is_guarded(m):
        _guarded(m, now)


@kernel
def _steer(m: Any, now: float, which: int) -> None:  # noqa: ARG001
    _go(m, now, float(m.target))


def _decision(law: Law) -> Callable[[Any, float], int]:
    @kernel
    def decide(m: Any, now: float) -> int:
        return law(m, now, m.period)

    return decide


_LINE = Frame(
    _start, _own_position, _from_neighbour, _begins, _ends, _rises, _armed, _follow, _decision, _steer, _finish
)  # fmt: skip


def line_kernels(law: Law) -> tuple[Any, Any]:
    """Returns the kernels of a model that follows `law` on a line.

    Args:
        law: a kernel of (record, time [s], period [s]), called when a step of the law begins. It reads `position`,
            `left` and `right`, in m on the line (a missing neighbour has the own position), and the model's own
            variables; writes `target`, in m on the line; returns POSITION, or minus a key of the model's errors.
    """
    return assembled(_LINE, law)
