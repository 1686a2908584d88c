"""The take-off of an agent's drone, as kernels over its record: its states, and the conditions for giving up.

The agent waits for its autopilot, requests the streams that it needs, and commands GUIDED mode, arming and take-off.
Rovers and boats, which their heartbeats tell, do not take off; a fixed wing takes off in ArduPlane's mode TAKEOFF, a
quadplane that tells its kind as a copter does.
`line` (the line's agent) and `kit` (agents that follow a law) define the behaviour afterwards.

The record of an agent has `SCRIPT` among its variables, and the outputs `state` and `failure`. The agent measures its
`height` [m] above home, and the time at which it last heard its own position (`position_heard`).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from cosim import Memory, Variable
from cosim.kernel import kernel
from cosim.messages import (
    EKF_STATUS_REPORT,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    MAV_RESULT_ACCEPTED,
    PLANE_MODE_TAKEOFF,
)
from cosim_models.agents.parts.conversation import (
    SLACK,
    ask,
)

__all__ = [
    "NEVER",
    "SCRIPT",
    "WHY",
    "AgentState",
    "Failure",
    "enter_next",
    "fail",
    "prepare",
    "stale",
    "supervise",
]


class AgentState(IntEnum):
    """The state of the agent: the condition that it waits for, or its activity."""

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
    """The reason why the agent has given up."""

    none = 0
    no_heartbeat = 1
    no_streams = 2
    no_position_estimate = 3
    not_guided = 4
    not_armed = 5
    not_at_altitude = 6
    left_guided = 7
    disarmed = 8


WHY = {
    Failure.no_heartbeat: "no HEARTBEAT of its autopilot: both need the same system id",
    Failure.no_streams: "its autopilot has not accepted the streams that it asked for",
    Failure.no_position_estimate: "its autopilot has had no GPS fix or position estimate",
    Failure.not_guided: "its autopilot has not changed to GUIDED",
    Failure.not_armed: "its autopilot has not armed",
    Failure.not_at_altitude: "its vehicle has not reached the altitude",
    Failure.left_guided: "its autopilot has left GUIDED",
    Failure.disarmed: "its autopilot has disarmed in flight",
}
"""The failures in words."""

SCRIPT: tuple[Variable, ...] = (
    Memory("state_since"),  # s
    Memory("streams", dtype="i4"),  # number of accepted streams
    Memory("asked_mode", dtype="i4"),  # of a fixed wing during its take-off
    Memory("height"),  # m above home
    Memory("position_heard"),  # s
)

NEVER = -1.0
"""The age or the time of a message that has not been heard yet [s]."""

_STATUS_INTERVAL = 1e6  # us, of EKF_STATUS_REPORT and GPS_RAW_INT
_REACHED = 0.95  # fraction of the altitude at which the take-off ends

_WAITING, _STREAMS, _ESTIMATE = int(AgentState.waiting), int(AgentState.streams), int(AgentState.estimate)
_MODE, _ARMING, _TAKEOFF = int(AgentState.mode), int(AgentState.arming), int(AgentState.takeoff)
_FAILED = int(AgentState.failed)
_LEFT_GUIDED, _DISARMED = int(Failure.left_guided), int(Failure.disarmed)


@kernel
def enter_next(m: Any, now: float) -> None:
    """Enters the next state."""
    m.state += 1
    m.state_since = now
    m.asked = 0


@kernel
def fail(m: Any, failure: int) -> None:
    """Gives up for the given reason."""
    m.state = _FAILED
    m.failure = failure


@kernel
def prepare(m: Any, now: float) -> None:
    """Runs the states from the first heartbeat to hovering. A new state takes effect in the next step."""
    if m.state_since == NEVER:
        m.state_since = now
    if now - m.state_since >= m.timeout - SLACK:
        fail(m, m.state)  # the failures of these states have the same numbers
        return
    command, p1, p2, p7 = 0, 0.0, 0.0, 0.0
    if m.state == _WAITING:
        if m.heard:
            enter_next(m, now)
    elif m.state == _STREAMS:
        command, p1, p2 = _stream(m, now)
    elif m.state == _ESTIMATE:
        if m.fix and m.estimate and m.position_heard >= 0.0:
            enter_next(m, now)
    elif m.state == _MODE:
        command, p1, p2 = MAV_CMD_DO_SET_MODE, float(MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(m.guided_mode)
        if m.guided:
            enter_next(m, now)
            command = 0
    elif m.state == _ARMING:
        command, p1 = MAV_CMD_COMPONENT_ARM_DISARM, 1.0
        if m.armed:
            enter_next(m, now)
            command = 0
    elif m.wings and not m.vtol:
        command, p1, p2 = _launch(m, now)
    elif (m.surface or _is_up(m)) and not stale(m, m.position_heard, now):
        enter_next(m, now)
    else:
        command, p7 = MAV_CMD_NAV_TAKEOFF, float(m.altitude)
    if command != 0:
        ask(m, now, command, p1, p2, p7)


@kernel
def _is_up(m: Any) -> bool:
    """Returns whether the altitude of the flight has been reached."""
    return bool(m.altitude == 0.0 or m.height >= _REACHED * m.altitude)


@kernel
def _launch(m: Any, now: float) -> tuple[int, float, float]:
    """Returns the command and its parameters that make a fixed wing take off, and then change to GUIDED."""
    up = _is_up(m) and not stale(m, m.position_heard, now)
    if up and m.guided:
        enter_next(m, now)
        return 0, 0.0, 0.0
    mode = m.guided_mode if up else PLANE_MODE_TAKEOFF
    if m.asked_mode != mode:
        m.asked_mode = mode
        m.asked = 0
    return MAV_CMD_DO_SET_MODE, float(MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode)


@kernel
def _accepted(m: Any, command: int) -> bool:
    """Returns whether the autopilot has accepted the pending command."""
    return bool(m.asked == command and m.answer == MAV_RESULT_ACCEPTED)


@kernel
def _stream(m: Any, now: float) -> tuple[int, float, float]:
    """Returns the command and its parameters for the next required stream; command 0 when all have been accepted.

    ArduPilot sends only heartbeats on a new link. Positions, estimator status and GPS status are requested one by one,
    since the answer does not identify the message that it refers to.
    """
    if _accepted(m, MAV_CMD_SET_MESSAGE_INTERVAL):
        m.streams += 1
        m.asked = 0
        if m.streams == 3:
            enter_next(m, now)
        return 0, 0.0, 0.0
    message, interval = GLOBAL_POSITION_INT, 1e6 / m.position_rate
    if m.streams == 1:
        message, interval = EKF_STATUS_REPORT, _STATUS_INTERVAL
    elif m.streams == 2:
        message, interval = GPS_RAW_INT, _STATUS_INTERVAL
    return MAV_CMD_SET_MESSAGE_INTERVAL, float(message), interval


@kernel
def supervise(m: Any) -> None:
    """Gives up if the autopilot has left the commanded state: a pilot has taken over, or the drone has landed."""
    if m.state == _FAILED:
        return
    if m.state >= _TAKEOFF and not m.armed:
        fail(m, _DISARMED)
    elif m.state >= _ARMING and not m.guided and not (m.wings and not m.vtol and m.state == _TAKEOFF):
        fail(m, _LEFT_GUIDED)


@kernel
def stale(m: Any, heard: float, now: float) -> bool:
    """Returns whether a message was never heard, or was heard longer than `stale_time` ago."""
    return heard < 0.0 or now - heard > m.stale_time + SLACK
