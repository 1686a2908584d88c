"""The drone kit: a drone in one FMU, around the law of an agent.

    class FlockingDrone(Model):
        step_size = STEP_SIZE
        variables = (*drone_variables(), *FLOCK)
        kernels = drone_kernels(flocking)
        errors = ERRORS

The law is that of an agent of the kit (`cosim_models.agents.kit`), unchanged. The vehicle is a point mass that the
guidance of `IdealAutopilot` moves. Nothing is sent between the parts of the drone, so that it takes a fraction of the
time of three FMUs. Between drones nothing changes: each sends HEARTBEAT once a second, and GLOBAL_POSITION_INT at
`position_rate`, as an autopilot (component 1), and hears those of others. Both kinds of drones can fly in one swarm.

Differences from `PointMass`, `IdealAutopilot` and an agent:
- The drone knows its own position and velocity exactly and without a delay, not from packets.
- It takes off as soon as `estimate_ready_time` and the delay of arming have passed; nothing has to be asked for.
- It obeys nobody: a command that is addressed to it is answered by COMMAND_ACK with MAV_RESULT_UNSUPPORTED. It has no
  parameters for ground stations, and no modes but GUIDED and LAND.
- There is neither wind nor drag.
- All calls of the law are `first_step_time` and whole periods after it.

Positions are NED from the origin that all drones share [m].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import floor
from typing import Any

import numpy as np

from cosim import Memory, Output, PacketInput, PacketOutput, Parameter, Variable
from cosim.frames import deg_e7, geodetic_from_local
from cosim.kernel import kernel
from cosim.messages import (
    COMMAND_ACK,
    COMMAND_INT,
    COMMAND_LONG,
    COPTER_MODE_GUIDED,
    COPTER_MODE_LAND,
    GLOBAL_POSITION_INT,
    HEARTBEAT,
    MAV_AUTOPILOT_ARDUPILOTMEGA,
    MAV_COMP_ID_AUTOPILOT1,
    MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    MAV_MODE_FLAG_GUIDED_ENABLED,
    MAV_MODE_FLAG_SAFETY_ARMED,
    MAV_RESULT_UNSUPPORTED,
    MAV_STATE_ACTIVE,
    MAV_STATE_STANDBY,
    MAV_TYPE_QUADROTOR,
    decode_command_int,
    decode_command_long,
    encode_command_ack,
    encode_global_position_int,
    encode_heartbeat,
)
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, component, find, message_id, pack, system, unpack
from cosim.verdict import Role
from cosim_models.agents.kit import (
    ACCELERATION,
    CONDITION,
    NOTHING_NEW,
    PARAMETERS,
    POSITION,
    REASON,
    SETPOINTS,
    STEP_SIZE,
    VELOCITY,
    Task,
    Trouble,
    decision,
)
from cosim_models.agents.parts.assembly import ALL, NO_SUM, PERIOD_IS_SHORT, SHORT_PERIOD, Law
from cosim_models.agents.parts.guard import fence_is_convex, guard_variables, is_guarded
from cosim_models.agents.parts.neighbours import neighbour_variables, note
from cosim_models.autopilot.guidance import GUIDANCE, acceleration_to, approach, climb_to

__all__ = ["ERRORS", "STEP_SIZE", "drone_kernels", "drone_variables"]

_WAITING, _ARMING, _TAKEOFF, _READY = int(Task.waiting), int(Task.arming), int(Task.takeoff), int(Task.ready)
_FLYING, _FAILED, _LANDING, _LANDED = int(Task.flying), int(Task.failed), int(Task.landing), int(Task.landed)
_NOT_AT_ALTITUDE, _NOT_LANDED = int(Trouble.not_at_altitude), int(Trouble.not_landed)
_ARMING_DELAY = 2.0  # s between arming and the motors, as in ArduCopter
_REACHED = 0.95  # fraction of the altitude at which the take-off ends
_LAND_LOW, _LAND_SPEED = 10.0, 0.5  # m and m/s: LAND_ALT_LOW and LAND_SPEED, ArduCopter's defaults
_HEARTBEAT_INTERVAL = 1.0  # s
_OFTEN = ("period", "first_step_time", "takeoff_time", "land_time", "altitude", "timeout", "position_rate")
"""Parameters that most steps need: their memory is apart from that of the others."""
_UNSTABLE = 2.0  # gain times step, from which on velocities oscillate
_SLACK = 1e-9  # s: tolerance for times that are multiples of the step size up to rounding

ERRORS = {
    1: "sysid must be 1 to 255",
    2: "period, position_rate, altitude and timeout must be positive",
    3: "position_start is below the ground: down must not exceed ground_height",
    NO_SUM: "the law returned what is not a sum of POSITION, VELOCITY and ACCELERATION",
    5: "the fence must be a convex polygon: give 3 to 8 fence_corners in their order, no three of them on one line",
    6: "guard_p * period must be more than 0 and at most 1: a drone would fly past the bounds of its guard",
    7: "PSC_POSXY_P, PSC_POSZ_P, WPNAV_ACCEL and WPNAV_ACCEL_Z must be positive",
    8: "position is no longer finite: are all set-points of the law?",
    9: "PSC_VELXY_P and PSC_VELZ_P times the step must be less than 2, or velocities oscillate: take shorter steps",
    SHORT_PERIOD: PERIOD_IS_SHORT,
}


def drone_variables(neighbours: int = 16, heard_bytes: int = 16384, **starts: float) -> tuple[Variable, ...]:
    """Returns the variables of a drone: ports, parameters, outputs and memory.

    Args:
        neighbours: largest number of simultaneous neighbours.
        heard_bytes: that a drone can receive in a step; a position takes 40.
        starts: start values of parameters of the agent kit and its guard, where they differ.

    Raises:
        ValueError: `starts` names none of these.
    """
    guard = guard_variables(neighbours)
    if unknown := starts.keys() - {one.name for one in (*PARAMETERS, *guard)}:
        raise ValueError(f"{', '.join(sorted(unknown))}: no parameter of the agent kit or its guard")
    return (
        PacketInput("mavlink_rx", capacity=heard_bytes, description="from other drones, and commands, by radio"),
        Parameter(
            "sysid",
            type=int,
            start=1,
            minimum=1,
            maximum=255,
            verdict=Role.SYSTEM_ID,
            description="MAVLink system id of the drone",
        ),
        Parameter(
            "position_start",
            shape=3,
            unit="m",
            start=0.0,
            verdict=Role.START_POSITION,
            description="initial position, NED from the origin",
        ),
        Parameter("ground_height", unit="m", start=0.0, description="down coordinate at which the drone stands"),
        Parameter("estimate_ready_time", unit="s", start=2.0, minimum=0.0, description="from when on it arms"),
        *GUIDANCE,
        *(replace(one, start=starts.get(one.name, one.start), rare=one.name not in _OFTEN) for one in PARAMETERS),
        *(replace(one, rare=one.rare or one.role == "memory") for one in neighbour_variables(neighbours)),
        *(replace(one, start=starts.get(one.name, one.start)) for one in guard),
        PacketOutput("mavlink_tx", capacity=256, description="HEARTBEAT, positions and answers, to all"),
        *_OUTPUTS,
        Memory("payload", dtype="u1", shape=255),
        Memory("sent", dtype="i4"),  # packets sent, modulo 256
        Memory("heartbeat_due"),  # s
        Memory("position_due"),  # s
        Memory("told", dtype="i4"),  # state in the last HEARTBEAT
        Memory("state_since"),  # s
        Memory("turn", dtype="i4"),  # number of the current period; -1: before the first
        Memory("holds", dtype="i4"),  # which of these set-points hold:
        Memory("guided_position", shape=3),  # m, NED
        Memory("guided_velocity", shape=3),  # m/s, NED
        Memory("guided_acceleration", shape=3),  # m/s2, NED
        Memory("home", shape=3),  # m, NED: position at which its motors were armed
        Memory("desired_velocity", shape=3),  # m/s, NED
        Memory("cruise"),  # m/s, 0: WPNAV_SPEED
    )


_OUTPUTS = (
    Output("state", type=Task, start=Task.waiting, verdict=CONDITION, description="what it waits for, or does"),
    Output("failure", type=Trouble, start=Trouble.none, verdict=REASON, description="why it has given up"),
    Output("step", type=int, start=0, description="how often its law has been called"),
    Output(
        "position", shape=3, unit="m", start=0.0, verdict=Role.POSITION, description="of the drone, NED from the origin"
    ),
    Output(
        "velocity", shape=3, unit="m/s", start=0.0, verdict=Role.VELOCITY, description="of the drone over ground, NED"
    ),
    Output("armed", type=bool, start=False, verdict=Role.ARMED, description="whether it may fly"),
    Output("on_ground", type=bool, start=True, verdict=Role.ON_GROUND, description="the ground carries the weight"),
    *SETPOINTS,
)


# ---- messages ----------------------------------------------------------------------------------------------------


@kernel
def _send(m: Any, message: int) -> None:
    """Appends the message in the payload buffer. A packet that finds no room is left out."""
    end = pack(m.mavlink_tx, m.mavlink_tx_len, m.payload, message, m.sent, m.sysid, MAV_COMP_ID_AUTOPILOT1, 2)
    if end >= 0:
        m.mavlink_tx_len = end
        m.sent = (m.sent + 1) & 0xFF


@kernel
def _decline(m: Any, command: int, system_id: int, target: int, sender: int, part: int) -> None:
    """Answers a command to this drone: it takes none."""
    if system_id == m.sysid and target in (0, MAV_COMP_ID_AUTOPILOT1):
        encode_command_ack(m.payload, command, MAV_RESULT_UNSUPPORTED, 0, 0, sender, part)
        _send(m, int(np.int64(COMMAND_ACK)))


@kernel
def _listen(m: Any, now: float) -> None:
    """Enters the positions of others into the table of neighbours, and declines commands."""
    p = 0
    while True:
        begin, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
        if status in (NOTHING, TRUNCATED):
            return
        if status != GOOD and status != SIGNED:
            continue
        message, sender, part = message_id(m.mavlink_rx, begin), system(m.mavlink_rx, begin), 0
        if message == GLOBAL_POSITION_INT:
            if component(m.mavlink_rx, begin) == MAV_COMP_ID_AUTOPILOT1 and sender != 0 and sender != m.sysid:
                unpack(m.mavlink_rx, begin, m.payload)
                note(m, sender, now)
        elif message in (COMMAND_LONG, COMMAND_INT):
            part = component(m.mavlink_rx, begin)
            unpack(m.mavlink_rx, begin, m.payload)
            if message == COMMAND_LONG:
                to, target, command, _, _, _, _, _, _, _, _ = decode_command_long(m.payload)
                _decline(m, command, to, target, sender, part)
            else:
                to, target, _, command, _, _, _, _, _, _, _, _, _ = decode_command_int(m.payload)
                _decline(m, command, to, target, sender, part)


@kernel
def _tell(m: Any, now: float) -> None:
    """Sends what is due: HEARTBEAT once a second and at changes of the state, and the position."""
    if now >= m.heartbeat_due - _SLACK or m.state != m.told:
        m.told = m.state
        m.heartbeat_due = now + _HEARTBEAT_INTERVAL
        mode = COPTER_MODE_LAND if m.state == _LANDING or m.state == _LANDED else COPTER_MODE_GUIDED
        flags = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED + MAV_MODE_FLAG_GUIDED_ENABLED
        if m.armed:
            flags += MAV_MODE_FLAG_SAFETY_ARMED
        activity = MAV_STATE_STANDBY if m.on_ground else MAV_STATE_ACTIVE
        encode_heartbeat(m.payload, MAV_TYPE_QUADROTOR, MAV_AUTOPILOT_ARDUPILOTMEGA, flags, mode, activity, 3)
        _send(m, int(np.int64(HEARTBEAT)))
    if now >= m.position_due - _SLACK:
        m.position_due += 1.0 / m.position_rate
        if m.position_due <= now:  # the step is longer than an interval
            m.position_due = now + 1.0 / m.position_rate
        latitude, longitude, altitude = geodetic_from_local(
            m.position[0], m.position[1], m.position[2], m.origin_latitude, m.origin_longitude, m.origin_altitude
        )
        encode_global_position_int(
            m.payload,
            int(1e3 * now + 0.5),
            deg_e7(latitude),
            deg_e7(longitude),
            int(np.int64(floor(1e3 * altitude + 0.5))),
            int(np.int64(floor(1e3 * (m.home[2] - m.position[2]) + 0.5))),
            int(1e2 * m.velocity[0]),
            int(1e2 * m.velocity[1]),
            int(1e2 * m.velocity[2]),
            0,
        )
        _send(m, int(np.int64(GLOBAL_POSITION_INT)))


# ---- what it does ------------------------------------------------------------------------------------------------


@kernel
def _enter(m: Any, state: int, now: float) -> None:
    m.state = state
    m.state_since = now


@kernel
def _hold(m: Any, down: float) -> None:
    """Makes the present place, at a down coordinate, the set-point."""
    m.holds = POSITION
    m.guided_position[0], m.guided_position[1], m.guided_position[2] = m.position[0], m.position[1], down


@kernel
def _follow(m: Any, which: int) -> None:
    """Makes the set-points of the law valid."""
    m.holds = which
    for i in range(3):
        m.guided_position[i] = m.setpoint_position[i]
        m.guided_velocity[i] = m.setpoint_velocity[i]
        m.guided_acceleration[i] = m.setpoint_acceleration[i]


@kernel
def _prepare(m: Any, now: float) -> None:
    """Arms and takes off."""
    if m.state == _WAITING:
        if now >= max(m.estimate_ready_time, m.takeoff_time) - _SLACK:
            _enter(m, _ARMING, now)
            m.armed = True
            for i in range(3):
                m.home[i] = m.position[i]
    elif m.state == _ARMING:
        if now - m.state_since >= _ARMING_DELAY - _SLACK:
            _enter(m, _TAKEOFF, now)
            m.on_ground = False
            _hold(m, m.home[2] - m.altitude)
    elif m.state == _TAKEOFF:
        if m.home[2] - m.position[2] >= _REACHED * m.altitude:
            _enter(m, _READY, now)
        elif now - m.state_since >= m.timeout - _SLACK:
            _enter(m, _FAILED, now)
            m.failure = _NOT_AT_ALTITUDE


@kernel
def _is_due(m: Any, now: float) -> bool:
    """Returns whether a period begins in which the law is to be called; begins the landing when it is time."""
    turn = -1
    if now >= m.first_step_time - _SLACK:
        turn = floor((now - m.first_step_time) / m.period + _SLACK)
    begins = turn > m.turn
    m.turn = turn
    if m.state != _READY and m.state != _FLYING:
        return False
    if m.land_time > 0.0 and now >= m.land_time - _SLACK:
        _enter(m, _LANDING, now)
        return False
    if begins and m.state == _READY:
        _enter(m, _FLYING, now)
    return bool(begins)


@kernel
def _accelerate(m: Any) -> tuple[float, float, float]:
    """Returns the acceleration that leads to the set-points, NED [m/s2]."""
    for i in range(3):
        m.desired_velocity[i] = 0.0
    which = m.holds
    if m.state == _LANDING:
        low = m.home[2] - m.position[2] < _LAND_LOW
        m.desired_velocity[2] = _LAND_SPEED if low else 0.01 * m.WPNAV_SPEED_DN
        which = 0
    elif which & POSITION != 0:
        approach(m, m.guided_position[0], m.guided_position[1])
        climb_to(m, m.guided_position[2])
    if which & VELOCITY != 0:
        for i in range(3):
            m.desired_velocity[i] += m.guided_velocity[i]
    elif which == ACCELERATION:
        for i in range(3):
            m.desired_velocity[i] = m.velocity[i]
    given = which & ACCELERATION != 0 and which & POSITION == 0
    return acceleration_to(m, m.guided_acceleration, given)


@kernel
def _move(m: Any, h: float, now: float) -> None:
    """Moves for `h` seconds, with a constant acceleration."""
    if m.on_ground:
        return
    pull = _accelerate(m)
    for i in range(3):
        m.position[i] += (m.velocity[i] + 0.5 * pull[i] * h) * h
        m.velocity[i] += pull[i] * h
    if m.position[2] >= m.ground_height and m.velocity[2] > 0.0:
        m.position[2] = m.ground_height
        for i in range(3):
            m.velocity[i] = 0.0
        if m.state == _LANDING:
            _enter(m, _LANDED, now)
            m.armed = False
            m.on_ground = True
    elif m.state == _LANDING and now - m.state_since >= m.timeout - _SLACK:
        _enter(m, _FAILED, now)
        m.failure = _NOT_LANDED
        _hold(m, float(m.position[2]))


# ---- the kernels of the FMU --------------------------------------------------------------------------------------


@kernel
def _start(m: Any) -> int:
    """Checks the parameters, and places the drone at rest on the ground or at its height."""
    if m.sysid < 1 or m.sysid > 255:
        return 1
    if not (m.period > 0.0 and m.position_rate > 0.0 and m.altitude > 0.0 and m.timeout > 0.0):
        return 2
    if m.position_start[2] > m.ground_height:
        return 3
    if not fence_is_convex(m):
        return 5
    if is_guarded(m) and not 0.0 < m.guard_p * m.period <= 1.0:
        return 6
    if min(m.PSC_POSXY_P, m.PSC_POSZ_P, m.WPNAV_ACCEL, m.WPNAV_ACCEL_Z) <= 0.0:
        return 7
    m.state = _WAITING
    m.told = 0
    m.turn = -1
    m.on_ground = True
    for i in range(3):
        m.position[i] = m.position_start[i]
        m.home[i] = m.position_start[i]
    return 0


def drone_kernels(law: Law) -> tuple[Any, Any]:
    """Returns the kernels of a drone that follows `law`: that of an agent, as `agents.kit.agent_kernels` takes it.

    Laws that send messages of their own are not possible.
    """
    decide: Callable[[Any, float], int] = decision(law)

    @kernel
    def advance(m: Any, t: float, h: float) -> int:
        if h * max(m.PSC_VELXY_P, m.PSC_VELZ_P) >= _UNSTABLE:
            return 9
        if h > m.period + _SLACK:
            return SHORT_PERIOD
        m.mavlink_tx_len = 0
        if m.mavlink_rx_len > 0:
            _listen(m, t)
        if m.state < _READY:
            _prepare(m, t)
        if _is_due(m, t):
            which = decide(m, t)
            if which < 0:
                return -which
            if which > ALL:
                return NO_SUM
            if which != NOTHING_NEW:
                _follow(m, which)
        _tell(m, t)
        _move(m, h, t)
        if not abs(m.position[0] + m.position[1] + m.position[2]) < np.inf:
            return 8
        return 0

    return _start, advance
