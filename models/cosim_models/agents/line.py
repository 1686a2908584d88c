"""The behaviour of an agent of a line as kernels over its record: the packets received, and the times of its law.

The law belongs to the agent: `LineAgent.advance` calls `act`, applies its law if `act` requests it, and calls `finish`.
An agent with another law on a line does the same. `line_agent` describes the purpose of the agent, and `script` handles
the take-off.
"""

from __future__ import annotations

from enum import IntEnum
from math import floor
from typing import Any

import numpy as np

from cosim.frames import EARTH_RADIUS_ARDUPILOT, deg_e7, haversine, longitude_at, radians_from_deg_e7, wrap_pi
from cosim.kernel import kernel
from cosim.messages import (
    MAV_COMP_ID_AUTOPILOT1,
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_global_position_int,
    encode_set_position_target_global_int,
)
from cosim_models.agents.parts.conversation import NOBODY, SLACK, heartbeat, next_position, reposition, send
from cosim_models.agents.parts.script import NEVER, AgentState, enter_next, prepare, stale, supervise

__all__ = ["ERRORS", "StalePolicy", "Trigger", "act", "finish", "go", "start"]

_ONLY_POSITION = 0x0DF8  # POSITION_TARGET_TYPEMASK: velocity, acceleration, yaw and yaw rate ignored


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
}


_WAITING, _ARMING, _TAKEOFF = int(AgentState.waiting), int(AgentState.arming), int(AgentState.takeoff)
_READY, _FORMATION = int(AgentState.ready), int(AgentState.formation)
_BY_PERIOD = int(Trigger.period)
_DROP, _FREEZE = int(StalePolicy.drop), int(StalePolicy.freeze)


# ---- receiving and sending ---------------------------------------------------------------------------------------


@kernel
def _on_line(m: Any, longitude: float) -> float:
    """Returns the position on the line for a longitude [rad], in m."""
    distance = haversine(m.origin_latitude, m.origin_longitude, m.origin_latitude, longitude, EARTH_RADIUS_ARDUPILOT)
    return distance if wrap_pi(longitude - m.origin_longitude) >= 0.0 else -distance


@kernel
def _receive(m: Any, now: float) -> None:
    """Processes the packets of the step: states of the own autopilot, the own position, and those of the neighbours."""
    sender, p = next_position(m, 0)
    while sender != NOBODY:
        if sender == m.sysid:
            _own_position(m, now)
        elif sender == m.left_sysid or sender == m.right_sysid:
            _from_neighbour(m, sender, now)
        sender, p = next_position(m, p)


@kernel
def _from_neighbour(m: Any, sender: int, now: float) -> None:
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
    _, latitude, longitude, _, relative_alt, _, _, _, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:
        return
    m.latitude = latitude
    m.height = 0.001 * relative_alt
    m.position = _on_line(m, radians_from_deg_e7(longitude))
    m.position_heard = now


@kernel
def go(m: Any, now: float, target: float) -> None:
    """Makes `target` [m on the line] the desired position and sends it, at the latitude of the start."""
    m.target = target
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


# ---- stepping ----------------------------------------------------------------------------------------------------


@kernel
def _fly(m: Any, now: float) -> tuple[bool, float, float, float]:
    """Hovers and steps, as long as the autopilot is in the expected state; returns the result of `act`."""
    period_step = 0
    if now >= m.first_step_time - SLACK:
        period_step = 1 + floor((now - m.first_step_time) / m.period + SLACK)
    begins = period_step > m.period_step
    m.period_step = period_step
    if m.state == _READY:
        if begins:
            m.step = period_step if m.trigger == _BY_PERIOD else 1
            m.step_at = now
            go(m, now, m.start_position)
            enter_next(m, now)
    elif m.state == _FORMATION and (begins if m.trigger == _BY_PERIOD else _arrived(m, now)):
        m.step = period_step if m.trigger == _BY_PERIOD else m.step + 1
        m.step_at = now
        applies, own, left, right = _positions(m, now)
        if applies:
            return True, own, left, right
        go(m, now, float(m.target))
    return False, 0.0, 0.0, 0.0


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
def _positions(m: Any, now: float) -> tuple[bool, float, float, float]:
    """Returns whether the law can be applied, and the positions for it: own, left, right [m on the line]."""
    own = float(m.position)
    if m.stubborn or stale(m, m.position_heard, now):
        return False, own, own, own
    has_left, has_right = m.left_sysid != 0, m.right_sysid != 0
    left_stale = has_left and stale(m, m.left_heard, now)
    right_stale = has_right and stale(m, m.right_heard, now)
    fresh = (has_left and not left_stale) or (has_right and not right_stale)
    if not fresh:
        return False, own, own, own
    if m.stale_policy == _FREEZE and (left_stale or right_stale):
        return False, own, own, own
    if m.stale_policy == _DROP:
        has_left = has_left and not left_stale
        has_right = has_right and not right_stale
    elif (has_left and m.left_heard < 0.0) or (has_right and m.right_heard < 0.0):
        return False, own, own, own
    left = float(m.left_position) if has_left else own
    right = float(m.right_position) if has_right else own
    return True, own, left, right


# ---- the kernels of the FMU --------------------------------------------------------------------------------------


@kernel
def start(m: Any) -> int:
    """Checks the parameters and initializes the memory: nothing has been heard yet."""
    if m.sysid < 1 or m.sysid > 255:
        return 1
    if not (0 <= m.left_sysid <= 255 and 0 <= m.right_sysid <= 255):
        return 2
    if m.left_sysid == m.sysid or m.right_sysid == m.sysid:
        return 2
    if not (m.period > 0.0 and m.position_rate > 0.0 and m.altitude > 0.0 and m.timeout > 0.0):
        return 3
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
def act(m: Any, t: float) -> tuple[bool, float, float, float]:
    """Reads the packets that have arrived at time `t` [s] and makes all parts of a step except the law.

    Returns:
        Whether a step of the law begins: the agent then sends the vehicle to its next position (`go`). Then the
        positions for the law, in m on the line: its own, its left neighbour's and its right neighbour's. For a missing
        neighbour, this is its own position.
    """
    m.mavlink_tx_len = 0
    _receive(m, t)
    heartbeat(m, t)
    supervise(m)
    if m.state < _READY:
        was_arming = m.state == _ARMING
        prepare(m, t)
        if was_arming and m.state == _TAKEOFF:
            m.start_latitude = m.latitude
            m.start_position = m.position
            m.target = m.position
    return _fly(m, t)


@kernel
def finish(m: Any, t: float) -> None:
    """Updates the outputs that depend on the time `t` [s]."""
    m.left_age = t - m.left_heard if m.left_heard >= 0.0 else NEVER
    m.right_age = t - m.right_heard if m.right_heard >= 0.0 else NEVER
