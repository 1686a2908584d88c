"""Satellite navigation in the areas in which the network's annotation says that it is jammed.

An FMU knows at most one such area, by parameters with the roles JAMMED_*; they get the values of the area.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.verdict import Role
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance
from cosim_master.system.flatten.parameters import Assignment
from cosim_master.system.settings.network import Network

__all__ = ["with_jamming"]

_NEVER = 1e9  # s
_ELEMENT = '<jamming gps="true">'


def with_jamming(checked: CheckedSystem, network: Network) -> CheckedSystem:
    """Returns the system with the parameters of all FMUs whose satellite navigation can be jammed.

    Raises:
        SystemDescriptionError: there are several such areas, no such FMU, or the system sets these parameters itself.
    """
    areas = [one for one in network.jamming if one.gps]
    if not areas:
        return checked
    area, where = areas[0], checked.structure.where
    values = {
        Role.JAMMED_RADIUS: area.radius,
        Role.JAMMED_NORTH: area.north,
        Role.JAMMED_EAST: area.east,
        Role.JAMMED_FROM: area.start,
        Role.JAMMED_UNTIL: min(area.stop, _NEVER),
    }
    problems: list[Problem] = []
    if len(areas) > 1:
        text = f'{len(areas)} elements <jamming> have gps="true", and a receiver knows one area; keep it at one'
        problems.append(Problem(where, text))
    instances, assignments = [], dict(checked.assignments)
    for one in checked.instances:
        given = _given(one, values)
        for name in given:
            if (one.name, name) in checked.assignments:
                text = f"{one.name}.{name} is set by {_ELEMENT} and by the system itself; keep one of them"
                problems.append(Problem(where, text))
            assignments[one.name, name] = (Assignment(where, "", name, f"{given[name]:g} of {_ELEMENT}", given[name]),)
        instances.append(replace(one, start_values={**one.start_values, **given}) if given else one)
    if not any(_given(one, values) for one in checked.instances):
        text = f"{_ELEMENT}: no FMU has satellite navigation that can be jammed; leave gps out"
        problems.append(Problem(where, text))
    if problems:
        raise SystemDescriptionError(problems)
    return replace(checked, instances=tuple(instances), assignments=assignments)


def _given(one: ComponentInstance, values: dict[Role, float]) -> dict[str, Any]:
    """Returns the values of an instance's parameters that describe the area."""
    return {
        name: values[verdict]
        for name, verdict in one.fmu.verdicts.items()
        if isinstance(verdict, Role) and verdict in values
    }
