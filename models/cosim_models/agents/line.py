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

from cosim.frames import EARTH_RADIUS_ARDUPILOT, deg_e7, haversine, longitude_at, radians_from_deg_e7, wrap_pi
from cosim.kernel import kernel
from cosim.messages import (
    MAV_COMP_ID_AUTOPILOT1,
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    SET_POSITION_TARGET_GLOBAL_INT,
    decode_global_position_int,
    encode_set_position_target_global_int,
)
from cosim_models.agents.parts.assembly import NO_SUM, Frame, Law, assembled
from cosim_models.agents.parts.conversation import SLACK, reposition, send
from cosim_models.agents.parts.guard import POSITION
from cosim_models.agents.parts.script import NEVER, AgentState, enter_next, stale

__all__ = ["ERRORS", "POSITION", "StalePolicy", "Trigger", "line_kernels"]

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
    NO_SUM: "the law returned what is not POSITION",
}


_WAITING, _READY, _FORMATION = int(AgentState.waiting), int(AgentState.ready), int(AgentState.formation)
_BY_PERIOD = int(Trigger.period)
_DROP, _FREEZE = int(StalePolicy.drop), int(StalePolicy.freeze)


# ---- receiving and sending ---------------------------------------------------------------------------------------


@kernel
def _on_line(m: Any, longitude: float) -> float:
    """Returns the position on the line for a longitude [rad], in m."""
    distance = haversine(m.origin_latitude, m.origin_longitude, m.origin_latitude, longitude, EARTH_RADIUS_ARDUPILOT)
    return distance if wrap_pi(longitude - m.origin_longitude) >= 0.0 else -distance


@kernel
def _from_neighbour(m: Any, sender: int, now: float) -> None:
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
    _, latitude, longitude, _, relative_alt, _, _, _, _ = decode_global_position_int(m.payload)
    if latitude == 0 and longitude == 0:
        return
    m.latitude = latitude
    m.height = 0.001 * relative_alt
    m.position = _on_line(m, radians_from_deg_e7(longitude))
    m.position_heard = now


@kernel
def _go(m: Any, now: float, target: float) -> None:
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
    """Updates the ages of the neighbours' positions."""
    m.left_age = now - m.left_heard if m.left_heard >= 0.0 else NEVER
    m.right_age = now - m.right_heard if m.right_heard >= 0.0 else NEVER


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
