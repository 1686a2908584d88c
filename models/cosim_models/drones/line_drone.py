"""The drone of a line in one FMU: a point mass that the consensus law of `LineAgent` spreads along a line.

The line runs east from the origin; a position on it is the distance east of the origin. As in `LineAgent`, step #1 is
the start (k = 0), and #2 begins with the law's first set-point (k = 1). The law uses the last position that was heard
of each neighbour. A neighbour that has not been heard for `stale_time` keeps its last position, unless no neighbour is
heard: then the drone stays. A guard acts once in a step, so that it has to be slow (`guard_p`). `kit` has what differs
from three FMUs.
"""

from __future__ import annotations

from typing import Any

from cosim import Model, Output, Parameter
from cosim.kernel import kernel
from cosim.verdict import Bound, Formation
from cosim_models.agents.kit import POSITION
from cosim_models.agents.parts.consensus import consensus_step, consensus_terms
from cosim_models.agents.parts.script import NEVER
from cosim_models.drones.kit import ERRORS, STEP_SIZE, drone_kernels, drone_variables

__all__ = ["LineDrone", "consensus"]

_NEIGHBOURS = 4
_NOBODY = -1
_FORMATION = Formation(
    step="step",
    stays="stubborn",
    neighbours=consensus_terms("left_sysid", "right_sysid", "epsilon"),
    begin="first_step_time",
    period="period",
)


@kernel
def _row_of(m: Any, sysid: int) -> int:
    """Returns the row of a drone in the table of those heard; -1: it is not there."""
    for row in range(m.heard_id.size):
        if sysid != 0 and m.heard_id[row] == sysid:
            return row
    return _NOBODY


@kernel
def _age(m: Any, row: int, t: float) -> float:
    return float(t - m.heard_at[row]) if row != _NOBODY else NEVER


@kernel
def consensus(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the position: the own one, and epsilon times the sum of the ways to the neighbours."""
    own = float(m.position[1])
    if m.step == 1:
        m.target = own
    left, right = _row_of(m, m.left_sysid), _row_of(m, m.right_sysid)
    m.left_age, m.right_age = _age(m, left, t), _age(m, right, t)
    heard = (m.left_sysid == 0 or left != _NOBODY) and (m.right_sysid == 0 or right != _NOBODY)
    fresh = 0.0 <= m.left_age <= m.stale_time or 0.0 <= m.right_age <= m.stale_time
    if m.step > 1 and not m.stubborn and heard and fresh:
        west = float(m.heard_position[left, 1]) if left != _NOBODY else own
        east = float(m.heard_position[right, 1]) if right != _NOBODY else own
        m.target = consensus_step(own, west, east, m.epsilon)
    m.setpoint_position[0], m.setpoint_position[1] = m.home[0], m.target
    return POSITION


def _bound(side: str) -> Bound:
    """Returns whether the neighbour on a side, if it has one, has been heard within `stale_time`."""
    text = f"its {side} neighbour is not heard: is it in reach, and is {side}_sysid its system id?"
    return Bound(least=0.0, most="stale_time", of=f"{side}_sysid", text=text)


class LineDrone(Model):
    """Is one drone of a line: a point mass that flies by consensus with its neighbours."""

    step_size = STEP_SIZE
    variables = (
        *drone_variables(_NEIGHBOURS, 8192, period=3.1875, position_rate=4.0, guard_p=0.25),
        Parameter("left_sysid", type=int, start=0, minimum=0, maximum=255, description="western neighbour; 0: none"),
        Parameter("right_sysid", type=int, start=0, minimum=0, maximum=255, description="eastern neighbour; 0: none"),
        Parameter("stubborn", type=bool, start=False, description="stay at the start position"),
        Parameter("epsilon", unit="1", start=1.0 / 3.0, description="gain of the consensus law"),
        Output("target", unit="m", start=0.0, verdict=_FORMATION, description="desired position, east of the origin"),
        Output(
            "left_age",
            unit="s",
            start=NEVER,
            verdict=_bound("left"),
            description="of the left neighbour's position when the law was called last; -1: never heard",
        ),
        Output(
            "right_age",
            unit="s",
            start=NEVER,
            verdict=_bound("right"),
            description="of the right neighbour's position when the law was called last; -1: never heard",
        ),
    )
    kernels = drone_kernels(consensus)
    errors = ERRORS
