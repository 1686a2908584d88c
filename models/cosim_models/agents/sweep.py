"""The sweep of an area by several drones, which divide it among themselves by what they hear of each other.

The area is divided into cells, which are numbered lane by lane, there and back. Of n drones in the air, the one with
the r-th system id has the r-th of n equal parts of the cells. Every drone notes which cells it and the drones that it
hears have visited, flies to the first cell left in its part, and helps the next drones from the end of their parts when
its own part is done. No other messages are needed: when a drone fails, leaves or joins, the parts change, and cells
that have been visited are left out.

As long as a cell is left in the note of a drone that flies, this drone flies to one: the area is always completed. Of
c cells, without failures, a drone has at most ceil(c / n) in its part, less those that others pass on their way; the
sweep takes the time for these and for the way to the part.

Source: the parts are those of boustrophedon coverage, H. Choset, Coverage for robotics - a survey of recent results,
Annals of Mathematics and Artificial Intelligence 31 (2001).
"""

from __future__ import annotations

from math import ceil, floor, sqrt
from typing import Any

from cosim import Memory, Model, Output, Parameter
from cosim.kernel import kernel
from cosim_models.agents.kit import ERRORS, STEP_SIZE, VELOCITY, agent_kernels, agent_variables
from cosim_models.agents.parts.guard import sqrt_controller

__all__ = ["AreaSweep", "sweep"]

_CELLS = 2048
_VISITED = 0.3
"""Largest distance from the middle of a visited cell, in both axes, as a part of the cell."""
_APPROACH_P, _BRAKING = 1.0, 1.25  # 1/s, m/s2: at full speed, a vehicle might circle a cell that it never reaches


@kernel
def _divide(m: Any) -> None:
    """Divides the area into cells of at most `swath`."""
    m.columns = max(ceil((m.area_east[1] - m.area_east[0]) / m.swath - 1e-9), 1)
    m.rows = max(ceil((m.area_north[1] - m.area_north[0]) / m.swath - 1e-9), 1)
    m.cell_north = (m.area_north[1] - m.area_north[0]) / m.rows
    m.cell_east = (m.area_east[1] - m.area_east[0]) / m.columns


@kernel
def _note(m: Any, north: float, east: float) -> None:
    """Notes that the cell with this place near its middle has been visited."""
    n, e = (north - m.area_north[0]) / m.cell_north, (east - m.area_east[0]) / m.cell_east
    row, column = floor(n), floor(e)
    if not (0 <= row < m.rows and 0 <= column < m.columns):
        return
    if abs(n - row - 0.5) <= _VISITED and abs(e - column - 0.5) <= _VISITED:
        number = row * m.columns + (column if row % 2 == 0 else m.columns - 1 - column)
        if m.visited[number] == 0:
            m.visited[number] = 1
            m.done += 1


@kernel
def _choose(m: Any, rank: int, members: int) -> int:
    """Returns the next cell: the first one left of the own part, or one of the last ones of the next part; -1: none.

    The drone of the part before helps with the last one, the drone of the part before that one with the last but one.
    """
    cells = m.rows * m.columns
    for other in range(members):
        part = (rank + other) % members
        begin, end = part * cells // members, (part + 1) * cells // members
        found, skip = -1, other - 1
        for k in range(end - begin):
            number = begin + k if other == 0 else end - 1 - k
            if m.visited[number] == 0:
                found = number
                if skip <= 0:
                    return int(found)
                skip -= 1
        if found >= 0:
            return int(found)
    return -1


@kernel
def sweep(m: Any, t: float, h: float) -> int:  # noqa: ARG001
    """Sets the velocity: to the next cell, and home when none is left."""
    if not (m.area_north[0] < m.area_north[1] and m.area_east[0] < m.area_east[1]):
        return -10
    _divide(m)
    if m.rows * m.columns > m.visited.size:
        return -11
    if m.speed * h > _VISITED * min(m.cell_north, m.cell_east):
        return -12
    _note(m, m.position[0], m.position[1])
    rank = 0
    for k in range(m.neighbours):
        _note(m, m.near_position[k, 0], m.near_position[k, 1])
        if m.near_id[k] < m.sysid:
            rank += 1
    m.cell = _choose(m, rank, m.neighbours + 1)
    m.swept = m.done / (m.rows * m.columns)
    north, east = m.home[0], m.home[1]
    if m.cell >= 0:
        row, column = m.cell // m.columns, m.cell % m.columns
        column = column if row % 2 == 0 else m.columns - 1 - column
        north, east = m.area_north[0] + (row + 0.5) * m.cell_north, m.area_east[0] + (column + 0.5) * m.cell_east
    north, east = north - m.position[0], east - m.position[1]
    away = sqrt(north * north + east * east)
    speed = min(m.speed, sqrt_controller(away, _APPROACH_P, _BRAKING))
    if away > 0.0:
        m.setpoint_velocity[0], m.setpoint_velocity[1] = speed * north / away, speed * east / away
    return VELOCITY


class AreaSweep(Model):
    """Sweeps an area together with the drones that it hears."""

    step_size = STEP_SIZE
    variables = (
        *agent_variables(neighbours=100),
        Parameter("area_north", shape=2, unit="m", start=(-50.0, 50.0), description="southern and northern border"),
        Parameter("area_east", shape=2, unit="m", start=(-50.0, 50.0), description="western and eastern border"),
        Parameter("swath", unit="m", start=10.0, minimum=0.1, description="largest size of a cell"),
        Parameter("speed", unit="m/s", start=4.0, minimum=0.0, description="of the sweep"),
        Output("swept", unit="1", start=0.0, description="share of the cells that it knows to be visited"),
        Output("cell", type=int, start=-1, description="number of the cell that it flies to; -1: home"),
        Memory("rows", dtype="i4"),
        Memory("columns", dtype="i4"),
        Memory("cell_north"),  # m
        Memory("cell_east"),  # m
        Memory("done", dtype="i4"),
        Memory("visited", dtype="u1", shape=_CELLS),
    )
    kernels = agent_kernels(sweep)
    errors = ERRORS | {
        10: "area_north and area_east: the first border must be less than the second",
        11: f"the area has more than {_CELLS} cells: enlarge swath",
        12: f"at this speed a drone may miss a cell: speed * period must be at most {_VISITED} of a cell's size",
    }
