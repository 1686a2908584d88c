"""The coordination agent FMU: the script that flies one drone of a line by consensus.

The agent runs on the drone's companion computer: it shares the autopilot's system id and is component 191. It waits for
its autopilot, requests the streams that it needs, commands GUIDED mode, arming and take-off, and then sends the
position computed by the consensus law at every step. All its information comes from packets: its own position and those
of its neighbours from GLOBAL_POSITION_INT of their autopilots. The neighbours' ids are parameters. The agent does not
land the drone, and avoids collisions only if its guard is switched on (`guard_separation`).

The line runs east from the origin. A position on it is the haversine distance along the origin's parallel, west
negative, with ArduPilot's radius of the Earth, so that 100 m flown read 100 m. Latitude and height do not change.

The law uses measured positions, including its own, so deviations due to wind or a slow vehicle are corrected later.
Step #1 is the start (k = 0); #2 begins with the law's first set-point (k = 1), which the vehicle reaches in the course
of that step. Step #1 begins for all agents at `first_step_time`, and the steps of the period trigger are simultaneous
for all agents: a late agent joins at the next of these steps, with the same number.
"""

from __future__ import annotations

from math import radians
from typing import Any

from cosim import Memory, Model, Output, PacketInput, PacketOutput, Parameter
from cosim.kernel import kernel
from cosim.verdict import Bound, Condition, Formation, Reason, Role
from cosim_models.agents.line import ERRORS, POSITION, StalePolicy, Trigger, line_guard, line_kernels
from cosim_models.agents.parts.consensus import consensus_step, consensus_terms
from cosim_models.agents.parts.conversation import CONVERSATION
from cosim_models.agents.parts.script import NEVER, SCRIPT, WHY, AgentState, Failure

__all__ = ["LineAgent", "consensus"]

_CONDITION = Condition(
    failed=(AgentState.failed,),
    working=(AgentState.formation,),
    commanding=(AgentState.arming, AgentState.takeoff, AgentState.ready, AgentState.formation),
    by="first_step_time",
    reason="failure",
)
_FORMATION = Formation(
    step="step",
    stays="stubborn",
    neighbours=consensus_terms("left_sysid", "right_sysid", "epsilon"),
    begin="first_step_time",
    period="period",
)


def _heard(side: str) -> Bound:
    """Returns whether the neighbour on a side, if it has one, has been heard within `stale_time`."""
    text = f"its {side} neighbour is not heard: is it in reach, and is {side}_sysid its system id?"
    return Bound(least=0.0, most="stale_time", of=f"{side}_sysid", text=text)


@kernel
def consensus(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the target: the own position, and epsilon times the sum of the ways to the neighbours."""
    m.target = consensus_step(float(m.position), float(m.left), float(m.right), m.epsilon)
    return POSITION


class LineAgent(Model):
    """Flies one drone of a line by consensus with its neighbours, through MAVLink packets alone."""

    step_size = 0.0125
    variables = (
        PacketInput("mavlink_rx", capacity=8192, description="from the own autopilot and by radio"),
        Parameter(
            "sysid",
            type=int,
            start=1,
            minimum=1,
            maximum=255,
            verdict=Role.SYSTEM_ID,
            description="MAVLink system id of the drone",
        ),
        Parameter("left_sysid", type=int, start=0, minimum=0, maximum=255, description="western neighbour; 0: none"),
        Parameter("right_sysid", type=int, start=0, minimum=0, maximum=255, description="eastern neighbour; 0: none"),
        Parameter("stubborn", type=bool, start=False, description="stay at the start position"),
        Parameter("epsilon", unit="1", start=1.0 / 3.0, description="gain of the consensus law"),
        Parameter("trigger", type=Trigger, start=Trigger.period, description="what begins a step"),
        Parameter("period", unit="s", start=3.1875, minimum=0.0, description="of the steps; longest for arrival"),
        Parameter("arrival_radius", unit="m", start=0.5, minimum=0.0, description="for the arrival trigger"),
        Parameter("first_step_time", unit="s", start=25.0, description="when step 1 begins; the same for all agents"),
        Parameter("altitude", unit="m", start=10.0, minimum=0.0, description="of the flight, above home"),
        Parameter(
            "origin_latitude",
            unit="rad",
            start=radians(-35.363262),
            verdict=Role.ORIGIN_LATITUDE,
            description="of the line's zero",
        ),
        Parameter(
            "origin_longitude",
            unit="rad",
            start=radians(149.165237),
            verdict=Role.ORIGIN_LONGITUDE,
            description="of the line's zero",
        ),
        Parameter("position_rate", unit="Hz", start=4.0, minimum=0.0, description="of GLOBAL_POSITION_INT asked for"),
        Parameter("stale_time", unit="s", start=1.0, minimum=0.0, description="age at which a position is stale"),
        Parameter("stale_policy", type=StalePolicy, start=StalePolicy.hold, description="what then counts"),
        Parameter("timeout", unit="s", start=60.0, minimum=0.0, description="of every state before the first step"),
        PacketOutput("mavlink_tx", capacity=256, description="to the own autopilot, and a heartbeat to all"),
        Output(
            "state",
            type=AgentState,
            start=AgentState.waiting,
            verdict=_CONDITION,
            description="what the agent waits for, or does",
        ),
        Output(
            "failure",
            type=Failure,
            start=Failure.none,
            verdict=Reason(tuple(WHY.items())),
            description="why the agent has given up",
        ),
        Output("refusal", type=int, start=0, description="MAV_RESULT of the last command that was refused; 0: none"),
        Output("step", type=int, start=0, description="number of the present step; 0 before the first"),
        Output(
            "target",
            unit="m",
            start=0.0,
            verdict=_FORMATION,
            description="desired position on the line, east of the origin",
        ),
        Output("position", unit="m", start=0.0, description="own measured position on the line"),
        Output(
            "left_age",
            unit="s",
            start=NEVER,
            verdict=_heard("left"),
            description="of the left neighbour's position; -1: never heard",
        ),
        Output(
            "right_age",
            unit="s",
            start=NEVER,
            verdict=_heard("right"),
            description="of the right neighbour's position; -1: never heard",
        ),
        *CONVERSATION,
        *SCRIPT,
        Memory("latitude", dtype="i4"),  # degE7
        Memory("left_position"),  # m on the line
        Memory("left_heard"),  # s
        Memory("right_position"),
        Memory("right_heard"),
        Memory("left"),  # m on the line: the neighbours' positions for the law
        Memory("right"),
        Memory("start_latitude", dtype="i4"),  # degE7
        Memory("start_position"),  # m on the line
        Memory("period_step", dtype="i4"),  # number of the current period
        Memory("step_at"),  # s, start of the current step
        *line_guard(),
    )
    kernels = line_kernels(consensus)
    errors = ERRORS
