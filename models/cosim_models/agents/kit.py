"""The agent kit: all parts of an agent except its law.

    @kernel
    def law(m, t, h):
        for k in range(m.neighbours):
            for i in range(2):
                m.setpoint_velocity[i] += m.gain * (m.near_position[k, i] - m.position[i])
        return VELOCITY

    class Rendezvous(Model):
        step_size = STEP_SIZE
        variables = (*agent_variables(), Parameter("gain", unit="1/s", start=0.1))
        kernels = agent_kernels(law)
        errors = ERRORS

The agent flies one drone by MAVLink packets only. It makes the drone take off (`script`), maintains a table of the
drones that it hears (`neighbours`), calls the law at every multiple of `period`, sends the law's set-points, and lands
the drone at the end. All agents call their laws at the same instants, whenever they have joined. docs/agents.md is the
guide for authors.

Positions are NED from the origin that the agents share [m]; heights of different take-off places are comparable, since
set-points and positions use the height above mean sea level.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from math import floor, radians, sqrt
from typing import Any

import numpy as np

from cosim import Memory, Output, PacketInput, PacketOutput, Parameter, Variable
from cosim.frames import deg_e7, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    COPTER_MODE_LAND,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_DO_SET_MODE,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_FRAME_GLOBAL_INT,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    PLANE_MODE_QLAND,
    PLANE_MODE_RTL,
    ROVER_MODE_HOLD,
    SET_POSITION_TARGET_GLOBAL_INT,
    encode_set_position_target_global_int,
)
from cosim.verdict import Condition, Reason, Role
from cosim_models.agents.parts.assembly import NO_SUM, PERIOD_IS_SHORT, SHORT_PERIOD, Frame, Hear, Law, assembled
from cosim_models.agents.parts.conversation import CONVERSATION, SLACK, ask, next_number, reposition, send
from cosim_models.agents.parts.guard import (
    ACCELERATION,
    NOTHING_NEW,
    POSITION,
    VELOCITY,
    fence_is_convex,
    guard,
    guard_variables,
    is_guarded,
)
from cosim_models.agents.parts.neighbours import locate, neighbour_variables, note, select
from cosim_models.agents.parts.script import NEVER, SCRIPT, WHY, fail, stale

__all__ = [
    "ACCELERATION",
    "CONDITION",
    "ERRORS",
    "NOTHING_NEW",
    "PARAMETERS",
    "POSITION",
    "REASON",
    "SETPOINTS",
    "STEP_SIZE",
    "VELOCITY",
    "Task",
    "Trouble",
    "agent_kernels",
    "agent_variables",
    "decision",
    "next_number",
    "send",
]

STEP_SIZE = 0.0125
"""Communication step for which agents are made [s]."""


class Task(IntEnum):
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
    """hovering, until its law begins"""
    flying = 8
    """as its law says"""
    failed = 9
    """given up, see `failure`; it commands nothing any more"""
    landing = 10
    """at the end"""
    landed = 11
    """and disarmed"""


class Trouble(IntEnum):
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
    not_landed = 9


ERRORS = {
    1: "sysid must be 1 to 255",
    2: "period, position_rate and timeout must be positive",
    3: "period must be less than 3 s: ArduCopter stops when it has not been given a velocity for so long",
    NO_SUM: "the law returned what is not a sum of POSITION, VELOCITY and ACCELERATION",
    5: "the fence must be a convex polygon: give 3 to 8 fence_corners in their order, no three of them on one line",
    6: "guard_p * period must be more than 0 and at most 1: a drone would fly past the bounds of its guard",
    SHORT_PERIOD: PERIOD_IS_SHORT,
}

CONDITION = Condition(
    failed=(Task.failed,),
    working=(Task.flying,),
    commanding=(Task.arming, Task.takeoff, Task.ready, Task.flying),
    by="first_step_time",
    reason="failure",
)
REASON = Reason(
    (*((int(of), text) for of, text in WHY.items()), (int(Trouble.not_landed), "its vehicle has not landed"))
)

_WAITING, _READY, _FLYING = int(Task.waiting), int(Task.ready), int(Task.flying)
_LANDING, _LANDED = int(Task.landing), int(Task.landed)
_NOT_LANDED = int(Trouble.not_landed)
_LOOKAHEAD = 10.0  # s: a fixed wing follows a velocity towards the point that it leads to in so long
_LOOKAHEAD_HOVERING = 2.0  # s: a quadplane, whose speed is its distance times Q_P_POSXY_P, 0.5 /s
_IGNORE_ALL, _IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_ACCELERATION = 0x0DFF, 0x0007, 0x0038, 0x01C0
_LEVEL_GAIN, _LEVEL_SPEED = 0.5, 1.0  # 1/s and m/s, for the vertical velocity that keeps the altitude


def agent_variables(neighbours: int = 16, message_bytes: int = 0) -> tuple[Variable, ...]:
    """Returns the variables of an agent: ports, parameters, outputs and memory.

    Args:
        neighbours: largest number of simultaneous neighbours.
        message_bytes: of the law's own messages in one step, beyond 170.
    """
    return (
        PacketInput("mavlink_rx", capacity=16384, description="from the own autopilot and by radio"),
        Parameter(
            "sysid",
            type=int,
            start=1,
            minimum=1,
            maximum=255,
            verdict=Role.SYSTEM_ID,
            description="MAVLink system id of the drone",
        ),
        *neighbour_variables(neighbours),
        *PARAMETERS,
        *guard_variables(neighbours),
        PacketOutput(
            "mavlink_tx", capacity=256 + message_bytes, description="to the own autopilot, and a heartbeat to all"
        ),
        *_OUTPUTS,
        *CONVERSATION,
        *SCRIPT,
        Memory("home", shape=3),  # m, NED: position at which its motors were armed
        Memory("measured_position", shape=3),  # m, NED, at position_heard
        Memory("turn", dtype="i4"),  # number of the current period
    )


PARAMETERS = (
    Parameter("period", unit="s", start=0.2, minimum=0.0, description="of the law"),
    Parameter("first_step_time", unit="s", start=25.0, description="from when on it follows its law"),
    Parameter("takeoff_time", unit="s", start=0.0, description="before which it stays on the ground"),
    Parameter("land_time", unit="s", start=0.0, minimum=0.0, description="when it lands; 0: it does not"),
    Parameter("altitude", unit="m", start=10.0, minimum=0.0, description="of the flight, above home; 0: no take-off"),
    Parameter("speed_limit", unit="m/s", start=5.0, minimum=0.0, description="of horizontal velocity set-points"),
    Parameter(
        "origin_latitude",
        unit="rad",
        start=radians(-35.363262),
        verdict=Role.ORIGIN_LATITUDE,
        description="of the origin that all share",
    ),
    Parameter(
        "origin_longitude",
        unit="rad",
        start=radians(149.165237),
        verdict=Role.ORIGIN_LONGITUDE,
        description="of the origin",
    ),
    Parameter(
        "origin_altitude",
        unit="m",
        start=584.0,
        verdict=Role.ORIGIN_ALTITUDE,
        description="of the origin, above mean sea level",
    ),
    Parameter("position_rate", unit="Hz", start=5.0, minimum=0.0, description="of GLOBAL_POSITION_INT asked for"),
    Parameter("timeout", unit="s", start=60.0, minimum=0.0, description="of every state but hovering and flying"),
)
SETPOINTS = (
    Output("setpoint_position", shape=3, unit="m", start=0.0, description="what its law gave last, NED"),
    Output("setpoint_velocity", shape=3, unit="m/s", start=0.0, description="what its law gave last, NED"),
    Output("setpoint_acceleration", shape=3, unit="m/s2", start=0.0, description="what its law gave last, NED"),
)
_OUTPUTS = (
    Output("state", type=Task, start=Task.waiting, verdict=CONDITION, description="what it waits for, or does"),
    Output(
        "failure",
        type=Trouble,
        start=Trouble.none,
        verdict=REASON,
        description="why it has given up",
    ),
    Output("refusal", type=int, start=0, description="MAV_RESULT of the last command that was refused; 0: none"),
    Output("step", type=int, start=0, description="how often its law has been called"),
    Output("position", shape=3, unit="m", start=0.0, description="own measured position, NED from the origin"),
    Output("velocity", shape=3, unit="m/s", start=0.0, description="own measured velocity, NED"),
    *SETPOINTS,
)


# ---- receiving ---------------------------------------------------------------------------------------------------


@kernel
def _own_position(m: Any, now: float) -> None:
    known, north, east, down, vn, ve, vd, height = locate(m)
    if known:
        m.measured_position[0], m.measured_position[1], m.measured_position[2] = north, east, down
        m.velocity[0], m.velocity[1], m.velocity[2] = vn, ve, vd
        m.height = height
        m.position_heard = now


# ---- acting ------------------------------------------------------------------------------------------------------


@kernel
def _begins(m: Any, now: float) -> bool:
    """Estimates the own position, and returns whether a period of the law begins."""
    if m.position_heard >= 0.0:
        for i in range(3):
            m.position[i] = m.measured_position[i] + m.velocity[i] * (now - m.position_heard)
    turn = floor(now / m.period + SLACK)
    begins = turn > m.turn and now >= m.first_step_time - SLACK
    m.turn = turn
    return bool(begins)


@kernel
def _ends(m: Any, now: float) -> bool:
    if m.state < _LANDING:
        return False
    _land(m, now)
    return True


@kernel
def _rises(m: Any, now: float) -> bool:
    return bool(now >= m.takeoff_time - SLACK)


@kernel
def _armed(m: Any) -> None:
    m.home[:] = m.position


@kernel
def _follow(m: Any, now: float, begins: bool, was_ready: bool) -> bool:
    """Hovers and flies until it is time to land; returns whether the law is to be called."""
    if was_ready and m.state in (_READY, _FLYING):
        if m.land_time > 0.0 and now >= m.land_time - SLACK:
            m.state, m.state_since, m.asked = _LANDING, now, 0
            return False
        if begins:
            m.state = _FLYING
            return not stale(m, m.position_heard, now)
    return False


@kernel
def _land(m: Any, now: float) -> None:
    if m.state == _LANDED:
        return
    if not m.armed:
        m.state = _LANDED
    elif now - m.state_since >= m.timeout - SLACK:
        fail(m, _NOT_LANDED)
    elif m.surface and not m.guided:
        ask(m, now, MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 0.0, 0.0)
    else:
        mode = ROVER_MODE_HOLD if m.surface else COPTER_MODE_LAND
        if m.wings:
            mode = PLANE_MODE_QLAND if m.vtol else PLANE_MODE_RTL
        ask(m, now, MAV_CMD_DO_SET_MODE, float(MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode), 0.0)


@kernel
def _propose(m: Any, now: float) -> None:
    """Prepares the inputs of the law: the current neighbours, and set-points that keep position and altitude."""
    select(m, now)
    m.step += 1
    level = m.home[2] - m.altitude
    for i in range(3):
        m.setpoint_position[i] = m.position[i]
        m.setpoint_velocity[i] = 0.0
        m.setpoint_acceleration[i] = 0.0
    m.setpoint_position[2] = level
    m.setpoint_velocity[2] = min(max(_LEVEL_GAIN * (level - m.position[2]), -_LEVEL_SPEED), _LEVEL_SPEED)


@kernel
def _limit(m: Any) -> None:
    """Reduces the horizontal part of the velocity set-point to `speed_limit`."""
    speed = sqrt(m.setpoint_velocity[0] * m.setpoint_velocity[0] + m.setpoint_velocity[1] * m.setpoint_velocity[1])
    if speed > m.speed_limit:
        m.setpoint_velocity[0] *= m.speed_limit / speed
        m.setpoint_velocity[1] *= m.speed_limit / speed


@kernel
def _steer_wings(m: Any, which: int) -> None:
    """Sends a fixed wing to the position, or to where the velocity leads, at the height of the set-point."""
    ahead = 0.0 if which & POSITION != 0 else _LOOKAHEAD_HOVERING if m.vtol else _LOOKAHEAD
    latitude, longitude, altitude = geodetic_from_local(
        m.setpoint_position[0] + ahead * m.setpoint_velocity[0],
        m.setpoint_position[1] + ahead * m.setpoint_velocity[1],
        m.setpoint_position[2],
        m.origin_latitude,
        m.origin_longitude,
        m.origin_altitude,
    )
    reposition(m, MAV_FRAME_GLOBAL_INT, deg_e7(latitude), deg_e7(longitude), altitude)


@kernel
def _steer(m: Any, now: float, which: int) -> None:
    """Sends the valid set-points."""
    if m.wings:
        _steer_wings(m, which)
        return
    mask = _IGNORE_ALL
    if which & POSITION != 0:
        mask &= ~_IGNORE_POSITION
    if which & VELOCITY != 0:
        mask &= ~_IGNORE_VELOCITY
    if which & ACCELERATION != 0:
        mask &= ~_IGNORE_ACCELERATION
    latitude, longitude, altitude = geodetic_from_local(
        m.setpoint_position[0],
        m.setpoint_position[1],
        m.setpoint_position[2],
        m.origin_latitude,
        m.origin_longitude,
        m.origin_altitude,
    )
    zero = 0.0
    encode_set_position_target_global_int(
        m.payload,
        int(1000.0 * now + 0.5),
        m.sysid,
        MAV_COMP_ID_AUTOPILOT1,
        MAV_FRAME_GLOBAL_INT,
        mask,
        deg_e7(latitude),
        deg_e7(longitude),
        altitude,
        m.setpoint_velocity[0],
        m.setpoint_velocity[1],
        m.setpoint_velocity[2],
        m.setpoint_acceleration[0],
        m.setpoint_acceleration[1],
        m.setpoint_acceleration[2],
        zero,
        zero,
    )
    send(m, int(np.int64(SET_POSITION_TARGET_GLOBAL_INT)))


# ---- the kernels of the FMU --------------------------------------------------------------------------------------


@kernel
def _start(m: Any) -> int:
    """Checks the parameters and initializes the memory: nothing has been heard yet."""
    if m.sysid < 1 or m.sysid > 255:
        return 1
    if not (m.period > 0.0 and m.position_rate > 0.0 and m.timeout > 0.0):
        return 2
    if m.period >= 3.0:
        return 3
    if not fence_is_convex(m):
        return 5
    if is_guarded(m) and not 0.0 < m.guard_p * m.period <= 1.0:
        return 6
    m.state = _WAITING
    m.state_since = NEVER
    m.position_heard = NEVER
    m.answer = -1
    return 0


@kernel
def _finish(m: Any, now: float) -> None:
    """Has no outputs to update."""


def decision(law: Law) -> Callable[[Any, float], int]:
    """Returns a kernel of (record, time [s]) that calls `law` once, from the neighbour table to the set-points."""

    @kernel
    def decide(m: Any, t: float) -> int:
        _propose(m, t)
        which: int = law(m, t, m.period)
        _limit(m)
        if is_guarded(m):
            return guard(m, t, which, m.position, m.velocity)
        return which

    return decide


_SPACE = Frame(
    _start, _own_position, note, _begins, _ends, _rises, _armed, _follow, decision, _steer, _finish
)  # fmt: skip


def agent_kernels(law: Law, hear: Hear | None = None) -> tuple[Any, Any]:
    """Returns the kernels of a model that follows `law`.

    Args:
        law: a kernel of (record, time [s], period [s]). It reads `position`, `velocity`, `home`, the first `neighbours`
            rows of `near_id`, `near_position`, `near_velocity`, `near_age`, `near_distance`, and the model's own
            variables; writes `setpoint_position`, `setpoint_velocity`, `setpoint_acceleration`; returns which of them
            hold, or minus a key of the model's errors. The set-points initially keep position and altitude: a law in
            the plane leaves their third elements unchanged. It may send own messages (`send`, `next_number`).
        hear: a kernel of (record, first byte of a packet in `mavlink_rx`, time [s]), called for every packet received,
            at all times; the checksums of messages unknown to `cosim.messages` have not been compared. It may
            overwrite `payload`. None: the law has no own messages.
    """
    return assembled(_SPACE, law, hear)
