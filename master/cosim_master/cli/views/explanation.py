"""The origin of a variable's value: the parameter sets, connections and defaults that apply or are overridden."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern
from cosim_master.fmi.description.read import Variable
from cosim_master.system.flatten.flat import Alias, CheckedSystem, ComponentInstance, FlatConnection
from cosim_master.system.flatten.parameters import Assignment

__all__ = ["explain"]


def explain(checked: CheckedSystem, name: str) -> list[str]:
    """Returns lines of text about the origin of the value of one variable of a component, or of several.

    Args:
        checked: the system.
        name: hierarchical name of the variable ("drone3.agent.epsilon") or of a system's connector, or a pattern
            ("drone*.agent.epsilon") of such names.

    Raises:
        SystemDescriptionError: the variable does not exist, or nothing matches.
    """
    variables = {
        f"{instance.name}.{variable.name}": (instance, variable)
        for instance in checked.instances
        for variable in instance.fmu.variables.values()
    }
    connectors = {one.name: one for one in checked.aliases if one.name not in variables}
    if name in variables or name in connectors:
        names = [name]
    elif not is_pattern(name):
        inside = [known for known, (owner, _) in variables.items() if name.startswith(f"{owner.name}.")]
        text = f'there is no variable "{name}"; {near(name, inside or variables)}'
        raise SystemDescriptionError([Problem(checked.structure.where, text)])
    elif not (names := matching(name, [*variables, *connectors])):
        text = f'"{name}" matches no variable; {near_pattern(name, [*variables, *connectors])}'
        raise SystemDescriptionError([Problem(checked.structure.where, text)])
    driving: dict[str, list[FlatConnection]] = {one: [] for one in names}
    for link in checked.links:
        if (target := ".".join(link.target)) in driving:
            driving[target].append(link)
    return [
        line
        for one in names
        for line in (
            _lines(checked, *variables[one], driving[one]) if one in variables else _connector(connectors[one])
        )
    ]


def _lines(
    checked: CheckedSystem, instance: ComponentInstance, variable: Variable, links: Sequence[FlatConnection]
) -> Iterator[str]:
    """Yields lines about a variable; `links`: the connections that drive it."""
    unit = "" if variable.unit is None else f", {variable.unit.name}"
    yield f"{instance.name}.{variable.name}: {variable.causality} of {instance.fmu.path.name}, {variable.type}{unit}"
    if variable.description:
        yield f"  {variable.description}"
    given = checked.assignments.get((instance.name, variable.name), ())
    if given:
        yield f"  start value {_value(variable, given[-1].value)}, set by {_by(given[-1])}"
    elif variable.start is not None:
        yield f"  start value {_value(variable, variable.start)}, of the FMU: not set elsewhere"
    else:
        yield "  no start value: the FMU computes it"
    for one in reversed(given[:-1]):
        yield f"  overridden: {_value(variable, one.value)}, set by {_by(one)}"
    if given and variable.start is not None:
        yield f"  overridden: {_value(variable, variable.start)}, of the FMU"
    yield from (f"  {line}" for link in links for line in _driven(link))
    for item in checked.unmatched:
        if item.name.startswith(f"{instance.name}."):
            yield f"  ignored nearby: {item.where}: {item.name}; {item.hint}"


def _connector(alias: Alias) -> Iterator[str]:
    unit = "" if alias.unit is None else f", {alias.unit.name}"
    yield f"{alias.name}: connector of a system{unit}"
    yield f"  driven by {'.'.join(alias.source)}"
    yield from (f"  {line}" for line in _conversion(alias))


def _conversion(one: Alias | FlatConnection) -> Iterator[str]:
    if (one.factor, one.offset) != (1.0, 0.0):
        yield f"  value = {one.factor:g} * source + {one.offset:g}"
    if one.mapping:
        yield "  mapped: " + ", ".join(f"{key} -> {value}" for key, value in one.mapping)


def _value(variable: Variable, value: object) -> str:
    items = [name for name, number in (variable.items or {}).items() if number == value]
    if items:
        return f"{items[0]} ({value})"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if variable.unit is None else f"{text} {variable.unit.name}"


def _by(one: Assignment) -> str:
    if one.where.path == "--set":
        return f"{one.where} {one.name}={one.text}"
    owner = f'"{one.owner}"' if one.owner else "the root system"
    return f"{one.where}: {one.name} = {one.text}, bound to {owner}"


def _driven(link: FlatConnection) -> Iterator[str]:
    until = "while initializing" if link.initial_only else "from the start on"
    yield f"driven {until} by {'.'.join(link.source)}, at {link.where}"
    yield from _conversion(link)
