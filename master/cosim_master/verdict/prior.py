"""Findings about a swarm before it flies.

Findings are not errors: the system can still be run. Each finding names the probable consequence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence

from cosim.verdict import Role, Values
from cosim_master.fmi.description.read import FmuDescription, Start, Variable
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance
from cosim_master.system.settings.network import Network
from cosim_master.verdict.earshot import depends_on_places, repeated, system_ids, twice
from cosim_master.verdict.findings import Finding

__all__ = ["DOUBLE_ID", "known_before", "same_id"]

DOUBLE_ID = "system id used twice"
_OWN_TOOL = "uav-cosim"
_SHOWN = 3
_FULL_TURN = 2.0 * math.pi


def known_before(
    checked: CheckedSystem,
    network: Network,
    changed: Sequence[tuple[str, Variable, float | int | bool | str]] = (),
    span: tuple[float, float] = (0.0, math.inf),
) -> list[Finding]:
    """Returns all findings that are known before the run.

    Args:
        changed: the values set during the run: instance, variable and value.
        span: start and end of the run, s.
    """
    set_later = {(instance, variable.name) for instance, variable, _ in changed}
    return [
        *_open_inputs(checked, set_later),
        *_not_accepted(checked),
        *_misspelt(checked),
        *_different_ids(checked, network),
        *_double_ids(checked, network),
        *_out_of_range(checked),
        *_degrees(checked, changed),
        *_cut_off(network, span),
    ]


# ---- inputs --------------------------------------------------------------------------------------------------------


_INDEX = re.compile(r"\[[\d, ]+\]$")
"""The end of the name of an element; `body[1].force` of other tools is no element."""


def _open_inputs(checked: CheckedSystem, set_later: Collection[tuple[str, str]]) -> Iterator[Finding]:
    """Yields inputs that have neither a source nor a value: one finding per input of an FMU, not per instance.

    The open inputs of an FMU that runs alone are intended.
    """
    if len(checked.instances) == 1 and not checked.links:
        return
    driven = {link.target for link in checked.links}
    found: dict[tuple[str, str], list[tuple[ComponentInstance, list[Variable]]]] = {}
    wanted: dict[int, list[tuple[str, Variable]]] = {}
    for instance in checked.instances:
        fmu = instance.fmu
        if id(fmu) not in wanted:
            wanted[id(fmu)] = _inputs_to_drive(fmu)
        for base, v in wanted[id(fmu)]:
            end = (instance.name, v.name)
            if v.name in instance.start_values or end in driven or end in set_later:
                continue
            of = found.setdefault((str(instance.fmu.path), base), [])
            if not of or of[-1][0] is not instance:
                of.append((instance, []))
            of[-1][1].append(v)
    for (_, base), of in found.items():
        instance, variables = of[0]
        names = _names([f"{one.name}.{base}" for one, _ in of])
        elements = f" ({len(variables)} elements)" if len(variables) > 1 else ""
        values = list(dict.fromkeys(map(_value, variables)))
        stays = f"it stays at its start value {values[0]}"
        if len(values) > 1:
            stays = f"they stay at their start values {_names(values)}"
        yield Finding(
            "open input",
            "warning" if instance.fmu.generation_tool == _OWN_TOOL else "note",
            tuple(f"{one.name}.{v.name}" for one, vs in of for v in vs),
            f"nothing drives {names}{elements}, and the system does not set it: {stays}; connect it or set a value",
            numbers={"inputs": sum(len(vs) for _, vs in of)},
        )


def _inputs_to_drive(fmu: FmuDescription) -> list[tuple[str, Variable]]:
    """Returns the inputs of an FMU that a source or the system should give a value, with their names without index."""
    optional = {name for name, verdict in fmu.verdicts.items() if verdict is Role.OPTIONAL}
    inputs = (
        (_INDEX.sub("", v.name), v)
        for v in fmu.variables.values()
        if v.causality == "input" and v.packet_capacity is None and v.clock is None and not v.clocks
    )
    return [(base, v) for base, v in inputs if not {v.name, base} & optional]


def _value(variable: Variable) -> str:
    return (
        "0"
        if variable.start is None
        else f"{variable.start:g}"
        if isinstance(variable.start, float)
        else str(variable.start)
    )


def _names(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def _not_accepted(checked: CheckedSystem) -> Iterator[Finding]:
    """Yields connections whose input does not accept all values that its source declares."""
    instances = {instance.name: instance for instance in checked.instances}
    for link in checked.links:
        (source, output), (target, name) = link.source, link.target
        offered = instances[source].fmu.verdicts.get(output)
        accepted = instances[target].fmu.verdicts.get(name)
        if not isinstance(offered, Values) or not isinstance(accepted, Values):
            continue
        if not set(offered.values) <= set(accepted.values):
            has, takes = (
                _items(instances[owner].fmu.variables[variable], values.values)
                for owner, variable, values in ((source, output, offered), (target, name, accepted))
            )
            text = f"{target}.{name} accepts {takes}, and {source}.{output} is {has}: swap one of the two FMUs"
            yield Finding("not accepted", "warning", (f"{target}.{name}", f"{source}.{output}"), text)


def _items(variable: Variable, values: Sequence[int]) -> str:
    """Returns the names of an enumeration's values."""
    names = {value: name for name, value in (variable.items or {}).items()}
    return ", ".join(names.get(value, str(value)) for value in values)


# ---- system ids ----------------------------------------------------------------------------------------------------


def _different_ids(checked: CheckedSystem, network: Network) -> Iterator[Finding]:
    for own in system_ids(checked, network):
        if len(set(own.values())) > 1:
            given = ", ".join(f"{name} = {value}" for name, value in own.items())
            text = f"{given}: on board of one vehicle they hear each other only with one system id; give them the same"
            yield Finding("different system ids", "warning", tuple(own), text, numbers=dict(own))


def _double_ids(checked: CheckedSystem, network: Network) -> Iterator[Finding]:
    ids = system_ids(checked, network)
    if not depends_on_places(network):
        for one in twice(network, ids):
            yield same_id(one.system_id, one.nodes, one.listener)
        return
    for value, nodes in repeated(ids).items():
        names = tuple(network.nodes[n].name for n in nodes)
        text = f"{_names(names)} have system id {value}: whether one hears two of them depends on where they fly"
        yield Finding(DOUBLE_ID, "note", names, text, numbers={"system id": value})


def same_id(system_id: int, nodes: tuple[str, ...], listener: str, time: float | None = None) -> Finding:
    """Returns the finding that a node hears two other nodes with the same system id, or another node with its own."""
    others = tuple(node for node in nodes if node != listener)
    if listener in nodes:
        text = f"{listener} hears {_names(others)}, and all have system id {system_id}; give each an id of its own"
    else:
        text = f"{listener} hears {_names(others)}, all with system id {system_id}; give each an id of its own"
    return Finding(DOUBLE_ID, "warning", nodes, text, time, {"system id": system_id})


def _misspelt(checked: CheckedSystem) -> Iterator[Finding]:
    """Yields values without effect whose name resembles that of a variable."""
    for item in checked.unmatched:
        if item.hint.startswith("did you mean"):
            text = f'{item.where}: parameter "{item.name}" sets nothing; {item.hint}'
            yield Finding("sets nothing", "warning", (item.name,), text)


# ---- values --------------------------------------------------------------------------------------------------------


def _out_of_range(checked: CheckedSystem) -> Iterator[Finding]:
    """Yields parameters whose own start value is out of range. Values from the system are already checked when read."""
    told: set[tuple[str, str]] = set()
    defaults: dict[int, set[str]] = {}
    for instance in checked.instances:
        fmu, given = instance.fmu, instance.start_values
        if id(fmu) not in defaults:
            defaults[id(fmu)] = {n for n, x in fmu.defaults.items() if not _in_range(fmu.variables[n], x)}
        outside = {n for n, x in given.items() if not _in_range(fmu.variables[n], x)}
        outside |= {n for n in defaults[id(fmu)] if n not in given}
        for name, value in instance.effective_values().items() if outside else ():
            if name not in outside or (str(fmu.path), name) in told:
                continue
            told.add((str(fmu.path), name))
            low, high = _range(fmu.variables[name])
            text = f"{instance.name}.{name} is {float(value):g}, outside of its range; valid: {low:g} to {high:g}"
            yield Finding("out of range", "note", (f"{instance.name}.{name}",), text, numbers={"value": float(value)})


def _range(variable: Variable) -> tuple[float, float]:
    low, high = variable.minimum, variable.maximum
    return -math.inf if low is None else low, math.inf if high is None else high


def _in_range(variable: Variable, value: Start) -> bool:
    """Returns whether a value is no number, or within the range of its variable."""
    if not isinstance(value, int | float) or isinstance(value, bool) or variable.type == "Enumeration":
        return True
    low, high = _range(variable)
    return low <= float(value) <= high


def _is_angle(variable: Variable) -> bool:
    unit = variable.unit
    if unit is None or variable.type != "Real":
        return False
    if unit.base is None:
        return unit.name == "rad"
    *others, radians = unit.base.exponents
    return not any(others) and radians == 1 and unit.base.factor == 1.0


def _degrees(
    checked: CheckedSystem, changed: Sequence[tuple[str, Variable, float | int | bool | str]]
) -> Iterator[Finding]:
    """Yields angles in rad that are set to more than a full turn; such values can only be degrees."""
    given = [
        (instance.name, instance.fmu.variables[name], value)
        for instance in checked.instances
        for name, value in instance.start_values.items()
    ]
    for name, variable, value in [*given, *changed]:
        if not _is_angle(variable) or not _FULL_TURN < abs(float(value)) <= 360.0:
            continue
        made = checked.assignments.get((name, variable.name), ())
        where = f"{made[-1].where}: " if made else ""
        meant = f"did you mean {math.radians(float(value)):.6g} (= {float(value):g} degrees)?"
        text = f"{where}{name}.{variable.name} is {float(value):g} rad, more than a full turn; {meant}"
        numbers = {"value": float(value), "in rad": math.radians(float(value))}
        yield Finding("degrees for radians", "warning", (f"{name}.{variable.name}",), text, numbers=numbers)


# ---- radio ---------------------------------------------------------------------------------------------------------


def _cut_off(network: Network, span: tuple[float, float]) -> Iterator[Finding]:
    """Yields nodes that cannot hear any other node during the whole run."""
    if len(network.nodes) < 2:
        return
    linked = {name for link in network.links for name in link}
    for node in network.nodes:
        if network.topology == "listed" and node.name not in linked:
            text = f'no <link> leads to {node.name}, and topology="listed": it can neither hear nor reach another node'
            yield Finding("cut off", "warning", (node.name,), text)
    for name, start, stop in network.outages:
        if start <= span[0] and stop >= span[1]:
            text = f"the outage of {name} lasts all the run: it can neither hear nor reach another node"
            yield Finding("cut off", "warning", (name,), text)
