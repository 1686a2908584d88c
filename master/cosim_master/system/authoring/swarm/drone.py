"""A drone and its parts, which are connected by the names of their ports, or taken from a system.

A new swarm describes each kind of drone once. Its FMUs declare (`cosim.verdict`) the parameters for its start position,
its system id and those of its neighbours, and for staying at its place.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from cosim.verdict import Formation, Role
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import near
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription, Variable, describe
from cosim_master.system.authoring.fitting import model_fmu, models
from cosim_master.system.formation import formation_of
from cosim_master.system.reading.read import FMU_TYPE
from cosim_master.system.structure import Component, Connection, Connector, Parameter, ParameterBinding, System, Value

__all__ = [
    "Declared",
    "Drone",
    "bound",
    "component",
    "declared",
    "described",
    "exchanged",
    "exposed",
    "found_fmu",
    "parameters_of",
    "wired",
    "wired_by_name",
    "without",
]

_HERE = Where("")
"""The place of descriptions that are not in a file."""


@dataclass(frozen=True, slots=True)
class Drone:
    """A kind of drone: its system, whose components have the FMUs as sources, and these FMUs by component name."""

    system: System
    fmus: Mapping[str, FmuDescription]


@dataclass(frozen=True, slots=True)
class Declared:
    """The declarations of the parts of a drone, as paths below the drone.

    Attributes:
        start: its start position, three elements; empty if no part or several parts declare it.
        system_ids: its MAVLink system id, one for each part that has it.
        part, formation: the only part that steers by a law on a line with a western and an eastern neighbour.
    """

    start: tuple[str, ...]
    system_ids: tuple[str, ...]
    part: str = ""
    formation: Formation | None = None


def declared(fmus: Mapping[str, FmuDescription]) -> Declared:
    """Returns the declarations of parts, by name of part."""
    start: list[str] = []
    ids: list[str] = []
    laws: list[tuple[str, Formation]] = []
    for part, fmu in fmus.items():
        for name, verdict in fmu.verdicts.items():
            if verdict is Role.START_POSITION:
                start += [_path(part, element) for element in elements_of(name, fmu.variables)]
            elif verdict is Role.SYSTEM_ID:
                ids.append(_path(part, name))
        formation = formation_of(fmu.verdicts)
        if formation is not None and len(formation[1].neighbours) == 2:
            laws.append((part, formation[1]))
    part, law = laws[0] if len(laws) == 1 else ("", None)
    return Declared(tuple(start) if len(start) == 3 else (), tuple(ids), part, law)


def _path(part: str, name: str) -> str:
    return f"{part}.{name}" if part else name


def found_fmu(given: str | Path, folder: Path | None = None) -> Path:
    """Returns an FMU that is given as a file, or by the name of a model.

    Args:
        folder: the folder in which FMUs of models are searched before those of this project.

    Raises:
        SystemDescriptionError: the file does not exist.
    """
    if not isinstance(given, str | os.PathLike):
        text = f"is neither a file nor the name of a model, but {type(given).__name__}; give one of these"
        raise SystemDescriptionError([Problem(Where(repr(given)), text)])
    path = Path(given)
    if path.is_file():
        return path
    if (known := model_fmu(str(given), folder)) is not None:
        return known
    text = f"is neither a file nor a model that has been built; {near(str(given), models(folder))}"
    raise SystemDescriptionError([Problem(Where(str(given)), text)])


# ---- parts ---------------------------------------------------------------------------------------------------------


def wired_by_name(fmus: Mapping[str, FmuDescription]) -> Drone:
    """Returns the drone of these parts: a part's output drives the inputs of the same name in other parts.

    Raises:
        SystemDescriptionError: several parts have an output for the same input.
    """
    wires = _unambiguous(_wires(fmus))
    components = []
    for part, fmu in fmus.items():
        ends = [(part, name) for source, _, name in wires if source == part]
        ends += [(part, name) for _, target, name in wires if target == part]
        components.append(component(part, fmu, dict.fromkeys(ends)))
    connections = tuple(Connection(source, name, target, name, _HERE) for source, target, name in wires)
    return Drone(System("drone", (), (), tuple(components), connections, (), Path(), _HERE), dict(fmus))


def component(name: str, fmu: FmuDescription, ports: Iterable[tuple[str, str]]) -> Component:
    """Returns the component of an FMU, with connectors for ports (part, port) of its own."""
    connectors = tuple(_connector(fmu.variables[port], port) for _, port in ports)
    return Component(name, FMU_TYPE, fmu.path, "any", connectors, (), (), _HERE)


def _wires(fmus: Mapping[str, FmuDescription]) -> list[tuple[str, str, str]]:
    """Yields (source, target, name) of every input for which another part has an output; packets use the network."""
    found: list[tuple[str, str, str]] = []
    for part, other in permutations(fmus, 2):
        offered = set(_ports(fmus[other], "output"))
        found += [(other, part, name) for name in _ports(fmus[part], "input") if name in offered]
    return found


def _unambiguous(wires: list[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Returns the wires, if each input has only one.

    Raises:
        SystemDescriptionError: several wires lead to the same input.
    """
    sources: dict[tuple[str, str], list[str]] = {}
    for source, target, name in wires:
        sources.setdefault((target, name), []).append(source)
    problems = [
        Problem(Where(target), f"its input {name} is offered by {' and '.join(several)}: take one of these parts out")
        for (target, name), several in sources.items()
        if len(several) > 1
    ]
    if problems:
        raise SystemDescriptionError(problems)
    return wires


def _ports(fmu: FmuDescription, causality: str) -> list[str]:
    return [v.name for v in fmu.variables.values() if v.causality == causality and v.packet_capacity is None]


def _connector(variable: Variable, name: str) -> Connector:
    """Returns the connector for an input or output."""
    kind: Any = variable.causality
    enumeration = variable.type == "Enumeration"
    return Connector(
        name,
        kind,
        _HERE,
        variable.type,
        variable.unit,
        variable.name if enumeration else None,
        variable.items if enumeration else None,
        variable.mime_type,
    )


def exchanged(drone: Drone, parts: Mapping[str, FmuDescription]) -> Drone:
    """Returns the drone with other FMUs in some parts.

    Existing connections are kept, except those between two optional ports, one of which a new part lacks. Other ports
    of a new part are connected by name. A part that the drone does not have yet is added. Values of parameters that a
    new part lacks are left out (`without`).

    Raises:
        SystemDescriptionError: several parts have an output for the same input.
    """
    fmus = {**drone.fmus, **parts}
    lost = {end for one in drone.system.connections if _needless(one, drone.fmus, parts) for end in _ends(one)}
    kept = [one for one in drone.system.connections if not lost.issuperset(_ends(one))]
    elements = [
        replace(one, connectors=tuple(c for c in one.connectors if (one.name, c.name) not in lost))
        for one in drone.system.elements
    ]
    elements = [
        replace(one, source=parts[one.name].path) if isinstance(one, Component) and one.name in parts else one
        for one in elements
    ]
    elements += [component(part, fmu, ()) for part, fmu in parts.items() if part not in drone.fmus]
    driven = {end for one in kept for end in _ends(one)}
    wires = _unambiguous(
        [wire for wire in _wires(fmus) if (wire[1], wire[2]) not in driven and (wire[0] in parts or wire[1] in parts)]
    )
    made = tuple(Connection(source, name, target, name, _HERE) for source, target, name in wires)
    lacking = {path for path, _ in without(drone, parts)}
    bindings = bound(
        replace(p, name=path)
        for one in drone.system.parameter_bindings
        for p in one.parameters
        if (path := one.prefix + p.name) not in lacking
    )
    system = replace(drone.system, elements=tuple(elements), connections=(*kept, *made), parameter_bindings=bindings)
    ends = [(end, name) for source, target, name in wires for end in (source, target)]
    return Drone(_with_connectors(system, fmus, ends), fmus)


def without(drone: Drone, parts: Mapping[str, FmuDescription]) -> list[tuple[str, FmuDescription]]:
    """Returns the values of a drone, by path, that other FMUs in some parts lack as a parameter or input, and these."""
    found = []
    for path in (one.prefix + p.name for one in drone.system.parameter_bindings for p in one.parameters):
        part, _, name = path.partition(".")
        if part in parts and part in drone.fmus:
            variable = parts[part].variables.get(name)
            if variable is None or not variable.settable:
                found.append((path, parts[part]))
    return found


def _ends(one: Connection) -> tuple[tuple[str | None, str], tuple[str | None, str]]:
    return (one.start_element, one.start_connector), (one.end_element, one.end_connector)


def _needless(one: Connection, fmus: Mapping[str, FmuDescription], parts: Mapping[str, FmuDescription]) -> bool:
    """Returns whether both ends of a connection are optional, and one is at a new part that lacks it."""
    ends = [(part, port) for part, port in _ends(one) if part is not None and part in fmus]
    return (
        len(ends) == 2
        and all(fmus[part].verdicts.get(port.partition("[")[0]) is Role.OPTIONAL for part, port in ends)
        and any(part in parts and port not in parts[part].variables for part, port in ends)
    )


def wired(drone: Drone, wires: Sequence[tuple[tuple[str, str], tuple[str, str]]]) -> Drone:
    """Returns the drone with connections from outputs to inputs (part, port) of its parts.

    They replace those which the inputs have.
    """
    made = tuple(Connection(*source, *target, _HERE) for source, target in wires)
    driven = {(one.end_element, one.end_connector) for one in made}
    kept = tuple(one for one in drone.system.connections if driven.isdisjoint(_ends(one)))
    system = replace(drone.system, connections=(*kept, *made))
    return Drone(_with_connectors(system, drone.fmus, [end for wire in wires for end in wire]), drone.fmus)


def exposed(drone: Drone, ports: Sequence[tuple[str, str]]) -> Drone:
    """Returns the drone with its own connectors PART_PORT, which lead to ports (part, port) of its parts."""
    connectors, connections = [*drone.system.connectors], [*drone.system.connections]
    for part, port in ports:
        variable = drone.fmus[part].variables[port]
        name = f"{part}_{port}"
        connectors.append(_connector(variable, name))
        if variable.causality == "output":
            connections.append(Connection(part, port, None, name, _HERE))
        else:
            connections.append(Connection(None, name, part, port, _HERE))
    system = replace(drone.system, connectors=tuple(connectors), connections=tuple(connections))
    return Drone(_with_connectors(system, drone.fmus, ports), drone.fmus)


def _with_connectors(system: System, fmus: Mapping[str, FmuDescription], ends: Iterable[tuple[str, str]]) -> System:
    """Returns the system with additional connectors for these ends (part, port) at its components."""
    wanted: dict[str, dict[str, None]] = {}
    for part, port in ends:
        wanted.setdefault(part, {})[port] = None
    elements = []
    for one in system.elements:
        has = {connector.name for connector in one.connectors}
        missing = [port for port in wanted.get(one.name, ()) if port not in has]
        made = tuple(_connector(fmus[one.name].variables[port], port) for port in missing)
        elements.append(replace(one, connectors=(*one.connectors, *made)))
    return replace(system, elements=tuple(elements))


# ---- values --------------------------------------------------------------------------------------------------------


def parameters_of(fmus: Mapping[str, FmuDescription], path: str, value: Any) -> tuple[Parameter, ...]:
    """Returns the parameters that set PART.VARIABLE to a value, one per element of an array.

    Raises:
        SystemDescriptionError: the variable does not exist, or the value is not of its type.
    """
    part, _, name = path.rpartition(".")
    if part not in fmus:
        raise _wrong(path, f"there is no part {part!r}; {near(part, fmus)}" if part else f"write PART.{name}")
    variables = fmus[part].variables
    elements = elements_of(name, variables)
    if not elements:
        known = dict.fromkeys(v.name.partition("[")[0] for v in variables.values() if v.settable)
        raise _wrong(path, f"{fmus[part].path.name} has no {name}; {near(name, known)}")
    if isinstance(value, np.ndarray):
        value = value.ravel() if value.ndim else value[()]
    single = elements == (name,)
    several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    values = [value] if single else list(value) if several else []
    if len(values) != len(elements):
        raise _wrong(path, f"has {len(elements)} elements: give as many values, not {value!r}")
    made = []
    for element, one in zip(elements, values, strict=True):
        variable = variables[element]
        try:
            made.append(Parameter(_path(part, element), variable.type, _typed(variable, one), _HERE))
        except (TypeError, ValueError) as error:
            raise _wrong(_path(part, element), str(error)) from None
    return tuple(made)


def _wrong(path: str, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(path), text)])


def _typed(variable: Variable, value: Any) -> Value:
    """Returns a value in SSP's representation.

    Raises:
        ValueError: the value is not of the variable's type.
    """
    given = value.value if isinstance(value, Enum) else value
    is_bool = isinstance(given, bool | np.bool_)
    if variable.type == "Boolean" and not is_bool:
        raise ValueError(f"is of type Boolean, {value!r} is not")
    text = str(given).lower() if is_bool else repr(float(given)) if isinstance(given, float) else str(given)
    parsed = variable.parsed(text)
    if variable.type == "Enumeration":
        return next(item for item, number in (variable.items or {}).items() if number == int(parsed))
    if variable.type == "Real":
        return float(parsed)
    assert isinstance(parsed, (int, bool, str))
    return parsed


def bound(values: Iterable[Parameter]) -> tuple[ParameterBinding, ...]:
    """Returns a binding of inline parameters for the document of their system; none without parameters."""
    parameters = tuple(values)
    return (ParameterBinding(parameters, "", _HERE),) if parameters else ()


def described(files: Mapping[str, Path]) -> dict[str, FmuDescription]:
    """Returns FMUs by name of part.

    Raises:
        SystemDescriptionError: FMUs cannot be read; all of them are reported at once.
    """
    found: dict[str, FmuDescription] = {}
    problems: list[Problem] = []
    for part, file in files.items():
        try:
            found[part] = describe(file)
        except SystemDescriptionError as error:
            problems += error.problems
    if problems:
        raise SystemDescriptionError(problems)
    return found
