"""The step that all agents share, around their law: an agent is assembled from a law and a frame.

A step reads the packets, sends the heartbeat, watches the own autopilot, takes off (`script`), and calls the law when
it is due. A *frame* has the parts in which agents in space (`kit`) and on a line (`line`) differ: how positions are
measured, at which instants laws are called, what they are given, and which set-points the vehicle gets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cosim.kernel import kernel
from cosim_models.agents.parts.conversation import NOBODY, heartbeat, next_position
from cosim_models.agents.parts.guard import ACCELERATION, NOTHING_NEW, POSITION, VELOCITY
from cosim_models.agents.parts.script import AgentState, prepare, supervise

__all__ = ["NO_SUM", "Frame", "Law", "assembled"]

NO_SUM = 4
"""Code of the error of a law that returns no sum of POSITION, VELOCITY and ACCELERATION."""

Law = Callable[[Any, float, float], int]
"""A kernel of (record, time [s], period [s]); returns which set-points hold, or minus the code of an error."""

_ARMING, _TAKEOFF, _READY = int(AgentState.arming), int(AgentState.takeoff), int(AgentState.ready)
_ALL = POSITION + VELOCITY + ACCELERATION


class Frame(NamedTuple):
    """The kernels in which agents differ; `m` is the record, `now` the time [s]."""

    start: Callable[[Any], int]
    """(m): checks the parameters and initializes the memory; returns 0 or the code of an error"""
    own: Callable[[Any, float], None]
    """(m, now): takes the own position from the packet in `payload`"""
    other: Callable[[Any, int, float], None]
    """(m, sender, now): takes the position of another drone from the packet in `payload`"""
    begins: Callable[[Any, float], bool]
    """(m, now): counts the instants of laws; returns whether one of them begins"""
    ends: Callable[[Any, float], bool]
    """(m, now): ends the flight; returns whether the agent does nothing else"""
    rises: Callable[[Any, float], bool]
    """(m, now): returns whether it is time to take off"""
    armed: Callable[[Any], None]
    """(m): notes the place at which the motors have been armed"""
    follow: Callable[[Any, float, bool, bool], bool]
    """(m, now, begins, was_ready): hovers and flies; returns whether the law is to be called"""
    decide: Callable[[Law], Callable[[Any, float], int]]
    """(law): returns a kernel of (m, now) that prepares the law's inputs, calls it, and limits its set-points"""
    steer: Callable[[Any, float, int], None]
    """(m, now, which): sends the set-points that hold"""
    finish: Callable[[Any, float], None]
    """(m, now): updates outputs at the end of a step"""


def assembled(frame: Frame, law: Law) -> tuple[Any, Any]:
    """Returns the kernels of a model that follows `law` in `frame`."""
    own, other, begins, ends, rises, armed = frame[1:7]
    follow, steer, finish, decide = frame.follow, frame.steer, frame.finish, frame.decide(law)

    @kernel
    def receive(m: Any, now: float) -> None:
        sender, p = next_position(m, 0)
        while sender != NOBODY:
            if sender == m.sysid:
                own(m, now)
            else:
                other(m, sender, now)
            sender, p = next_position(m, p)

    @kernel
    def is_due(m: Any, now: float) -> bool:
        m.mavlink_tx_len = 0
        receive(m, now)
        heartbeat(m, now)
        begin = begins(m, now)
        if ends(m, now):
            return False
        supervise(m)
        was_ready = m.state >= _READY
        if not was_ready and rises(m, now):
            was_arming = m.state == _ARMING
            prepare(m, now)
            if was_arming and m.state == _TAKEOFF:
                armed(m)
        return follow(m, now, begin, was_ready)

    @kernel
    def advance(m: Any, t: float, h: float) -> int:  # noqa: ARG001
        if is_due(m, t):
            which = decide(m, t)
            if which < 0:
                return -which
            if which > _ALL:
                return NO_SUM
            if which != NOTHING_NEW:
                steer(m, t, which)
        finish(m, t)
        return 0

    return frame.start, advance
