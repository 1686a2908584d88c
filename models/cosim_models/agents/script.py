"""The script of an agent as kernels over its record: its states, when it gives up, and when its law is due.

The law is the agent's own: `LineAgent.advance` calls `act`, applies its law where that says so, and calls `finish`.
An agent with another law does the same. What the agent is for is told in `line_agent`; its packets are in `packets`.
"""

from __future__ import annotations

from enum import IntEnum
from math import floor
from typing import Any

from cosim.kernel import kernel
from cosim.messages import EKF_STATUS_REPORT, GLOBAL_POSITION_INT, GPS_RAW_INT
from cosim_models.agents.packets import (
    ACCEPTED,
    ARM_DISARM,
    DO_SET_MODE,
    GUIDED,
    MODE_FLAG_CUSTOM,
    NAV_TAKEOFF,
    SET_MESSAGE_INTERVAL,
    SLACK,
    ask,
    go,
    heartbeat,
    receive,
)

__all__ = ["ERRORS", "NEVER", "AgentState", "Failure", "StalePolicy", "Trigger", "act", "finish", "start"]


class AgentState(IntEnum):
    """What the agent waits for, or does."""

    waiting = 1
    """for a HEARTBEAT of its autopilot"""
    streams = 2
    """for the acceptance of the streams it asked for"""
    estimate = 3
    """for GPS fix, position estimate and its own position"""
    mode = 4
    """for mode GUIDED"""
    arming = 5
    """for the motors to be armed"""
    takeoff = 6
    """to reach 95 % of the altitude"""
    ready = 7
    """hovering, for the first step"""
    formation = 8
    """stepping"""
    failed = 9
    """given up, see `failure`; it commands nothing any more"""


class Failure(IntEnum):
    """Why the agent has given up."""

    none = 0
    no_heartbeat = 1
    no_streams = 2
    no_position_estimate = 3
    not_guided = 4
    not_armed = 5
    not_at_altitude = 6
    left_guided = 7
    disarmed = 8


class Trigger(IntEnum):
    """What begins a step."""

    period = 1
    """time: every `period` seconds"""
    arrival = 2
    """arrival within `arrival_radius`, with news of every neighbour since the last step; or `period` seconds"""


class StalePolicy(IntEnum):
    """What counts for a neighbour that has not been heard for `stale_time`."""

    hold = 1
    """its last position, unless all neighbours are stale: then the agent stays (and is a fixed node to the others)"""
    drop = 2
    """nothing, as if it were not there"""
    freeze = 3
    """the agent stays as long as any neighbour is stale"""


NEVER = -1.0
"""An age or a time of what has not been heard yet [s]."""

ERRORS = {
    1: "sysid must be 1 to 255",
    2: "left_sysid and right_sysid must be 0 to 255 and not the agent's own",
    3: "period, position_rate, altitude and timeout must be positive",
}

_STATUS_INTERVAL = 1e6  # us, of EKF_STATUS_REPORT and GPS_RAW_INT
_REACHED = 0.95  # part of the altitude at which the take-off is over

_WAITING, _STREAMS, _ESTIMATE = int(AgentState.waiting), int(AgentState.streams), int(AgentState.estimate)
_MODE, _ARMING, _TAKEOFF = int(AgentState.mode), int(AgentState.arming), int(AgentState.takeoff)
_READY, _FORMATION, _FAILED = int(AgentState.ready), int(AgentState.formation), int(AgentState.failed)
_LEFT_GUIDED, _DISARMED = int(Failure.left_guided), int(Failure.disarmed)
_BY_PERIOD = int(Trigger.period)
_DROP, _FREEZE = int(StalePolicy.drop), int(StalePolicy.freeze)


@kernel
def _next(m: Any, now: float) -> None:
    """Enter the next state."""
    m.state += 1
    m.state_since = now
    m.asked = 0


@kernel
def _fail(m: Any, failure: int) -> None:
    m.state = _FAILED
    m.failure = failure


@kernel
def _prepare(m: Any, now: float) -> None:
    """From the first heartbeat to hovering. A state left in this step begins its successor's work in the next."""
    if m.state_since == NEVER:
        m.state_since = now
    if now - m.state_since >= m.timeout - SLACK:
        _fail(m, m.state)  # the failures of these states have their numbers
        return
    command, p1, p2, p7 = 0, 0.0, 0.0, 0.0
    if m.state == _WAITING:
        if m.heard:
            _next(m, now)
    elif m.state == _STREAMS:
        command, p1, p2 = _stream(m, now)
    elif m.state == _ESTIMATE:
        if m.fix and m.estimate and m.position_heard >= 0.0:
            _next(m, now)
    elif m.state == _MODE:
        command, p1, p2 = DO_SET_MODE, float(MODE_FLAG_CUSTOM), float(GUIDED)
        if m.guided:
            _next(m, now)
            command = 0
    elif m.state == _ARMING:
        command, p1 = ARM_DISARM, 1.0
        if m.armed:
            m.start_latitude = m.latitude
            m.start_position = m.position
            m.target = m.position
            _next(m, now)
            command = 0
    elif m.height >= _REACHED * m.altitude and not _stale(m, m.position_heard, now):
        _next(m, now)
    else:
        command, p7 = NAV_TAKEOFF, float(m.altitude)
    if command != 0:
        ask(m, now, command, p1, p2, p7)


@kernel
def _accepted(m: Any, command: int) -> bool:
    """Whether the autopilot has accepted the command that waits for its answer."""
    return bool(m.asked == command and m.answer == ACCEPTED)


@kernel
def _stream(m: Any, now: float) -> tuple[int, float, float]:
    """The command and its parameters for the next stream that is wanted; command 0 when all have been accepted.

    ArduPilot sends a new link only heartbeats. Positions, estimator and GPS status are asked for one by one: the
    answer does not say to which message it belongs.
    """
    if _accepted(m, SET_MESSAGE_INTERVAL):
        m.streams += 1
        m.asked = 0
        if m.streams == 3:
            _next(m, now)
        return 0, 0.0, 0.0
    message, interval = GLOBAL_POSITION_INT, 1e6 / m.position_rate
    if m.streams == 1:
        message, interval = EKF_STATUS_REPORT, _STATUS_INTERVAL
    elif m.streams == 2:
        message, interval = GPS_RAW_INT, _STATUS_INTERVAL
    return SET_MESSAGE_INTERVAL, float(message), interval


@kernel
def _supervise(m: Any) -> None:
    """Give up when the autopilot no longer is what the agent made it: a pilot has taken over, or it has landed."""
    if m.state == _FAILED:
        return
    if m.state >= _TAKEOFF and not m.armed:
        _fail(m, _DISARMED)
    elif m.state >= _ARMING and not m.guided:
        _fail(m, _LEFT_GUIDED)


@kernel
def _fly(m: Any, now: float) -> tuple[bool, float, float, float]:
    """Hovers and steps, as long as the autopilot does what the agent believes; returns what `act` does."""
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
            _next(m, now)
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
def _stale(m: Any, heard: float, now: float) -> bool:
    return heard < 0.0 or now - heard > m.stale_time + SLACK


@kernel
def _positions(m: Any, now: float) -> tuple[bool, float, float, float]:
    """Whether the law can be applied, and to which positions: own, left, right [m on the line]."""
    own = float(m.position)
    if m.stubborn or _stale(m, m.position_heard, now):
        return False, own, own, own
    has_left, has_right = m.left_sysid != 0, m.right_sysid != 0
    left_stale = has_left and _stale(m, m.left_heard, now)
    right_stale = has_right and _stale(m, m.right_heard, now)
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
    """Check the parameters; nothing has been heard yet."""
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
    """Reads the packets that have arrived at time `t` [s] and does all of a step but the law.

    Returns:
        Whether a step of the law begins: the agent then sends the vehicle to its next position (`packets.go`). Then
        the positions that the law applies to, in m on the line: its own, and its left and right neighbour's; its own
        in place of those of a neighbour that it does not have.
    """
    m.mavlink_tx_len = 0
    receive(m, t)
    heartbeat(m, t)
    _supervise(m)
    if m.state < _READY:
        _prepare(m, t)
    return _fly(m, t)


@kernel
def finish(m: Any, t: float) -> None:
    """Updates the outputs that follow from the time `t` [s]."""
    m.left_age = t - m.left_heard if m.left_heard >= 0.0 else NEVER
    m.right_age = t - m.right_heard if m.right_heard >= 0.0 else NEVER
