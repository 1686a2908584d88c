"""The step that all agents share, around their law: an agent is assembled from a law and a frame.

A step reads the packets, sends the heartbeat, watches the own autopilot, takes off (`script`), and calls the law when
it is due. A *frame* has the parts in which agents in space (`kit`) and on a line (`line`) differ: how positions are
measured, at which instants laws are called, what they are given, and which set-points the vehicle gets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cosim.kernel import kernel
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, UNKNOWN, find
from cosim_models.agents.parts.conversation import NOBODY, SLACK, heartbeat, next_position
from cosim_models.agents.parts.guard import ACCELERATION, NOTHING_NEW, POSITION, VELOCITY
from cosim_models.agents.parts.script import AgentState, prepare, supervise

__all__ = ["ALL", "NO_SUM", "PERIOD_IS_SHORT", "SHORT_PERIOD", "Frame", "Hear", "Law", "assembled"]

NO_SUM = 4
"""Code of the error of a law that returns no sum of POSITION, VELOCITY and ACCELERATION."""
SHORT_PERIOD = 99
"""Code of the error of a period that is less than the communication step: its law would be given a false `h`."""
PERIOD_IS_SHORT = "period is less than the step, in which a law is called once at most: take shorter steps"

Law = Callable[[Any, float, float], int]
"""A kernel of (record, time [s], period [s]); returns which set-points hold, or minus the code of an error."""

Hear = Callable[[Any, int, float], None]
"""A kernel of (record, first byte of a packet in `mavlink_rx`, time [s]) that takes own messages."""

_ARMING, _TAKEOFF, _READY = int(AgentState.arming), int(AgentState.takeoff), int(AgentState.ready)
ALL = POSITION + VELOCITY + ACCELERATION
"""The largest result of a law."""


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


def _with_own_messages(receive: Callable[[Any, float], None], hear: Hear) -> Callable[[Any, float], None]:
    """Returns a kernel of (m, now) that receives, and then hands every packet to `hear`."""

    @kernel
    def receive_all(m: Any, now: float) -> None:
        receive(m, now)
        p = 0
        while True:
            begin, p, status = find(m.mavlink_rx, p, m.mavlink_rx_len)
            if status in (NOTHING, TRUNCATED):
                return
            if status in (GOOD, SIGNED, UNKNOWN):
                hear(m, begin, now)

    return receive_all


def assembled(frame: Frame, law: Law, hear: Hear | None = None) -> tuple[Any, Any]:
    """Returns the kernels of a model that follows `law` in `frame`, and takes own messages by `hear`."""
    own, other, begins, ends, rises, armed = frame[1:7]
    follow, steer, finish, decide = frame.follow, frame.steer, frame.finish, frame.decide(law)

    @kernel
    def positions(m: Any, now: float) -> None:
        sender, p = next_position(m, 0)
        while sender != NOBODY:
            if sender == m.sysid:
                own(m, now)
            else:
                other(m, sender, now)
            sender, p = next_position(m, p)

    receive = positions if hear is None else _with_own_messages(positions, hear)

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
    def advance(m: Any, t: float, h: float) -> int:
        if h > m.period + SLACK:
            return SHORT_PERIOD
        if is_due(m, t):
            which = decide(m, t)
            if which < 0:
                return -which
            if which > ALL:
                return NO_SUM
            if which != NOTHING_NEW:
                steer(m, t, which)
        finish(m, t)
        return 0

    return frame.start, advance
