"""The radio nodes of a system: the vehicles whose FMUs have packet ports, with their endpoints and positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cosim.naming import LINES, POSITION, VEHICLE
from cosim.verdict import Role
from cosim_master.diagnostics.errors import Problem
from cosim_master.diagnostics.limitations import SEVERAL_PORTS, SMALL_PORT
from cosim_master.fmi.description.declarations import elements_of
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.system.flatten.flat import CheckedSystem, ComponentInstance

__all__ = ["BY_CONVENTION", "SERIAL", "TELEMETRY", "Endpoint", "Node", "nodes_of"]

MAX_PACKET = 280
"""`cosim.packets.MAX_PACKET`: that module has kernels, whose compiler takes half a second to import."""

BY_CONVENTION = f"{VEHICLE}.{POSITION}"
"""Path of a node's position, if neither the annotation nor an FMU specifies it."""
TELEMETRY, SERIAL = "telemetry", "serial"
"""Lines for gateways only: for ground stations by radio, and for the wired gateway. FMUs declare their ports, or name
them by convention (`cosim.naming`).
"""
_LINES = {TELEMETRY: Role.TELEMETRY, SERIAL: Role.SERIAL}


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A pair of packet ports of one instance; either may be missing.

    `line`: TELEMETRY or SERIAL, if the pair is for gateways only.
    """

    instance: str
    rx: Variable | None
    tx: Variable | None
    line: str = ""

    @property
    def name(self) -> str:
        """The name in recordings: instance and line."""
        return f"{self.instance}.{self.line}" if self.line else self.instance


@dataclass(frozen=True, slots=True)
class Node:
    """A radio node with one antenna: an instance's parent system (an instance of the root system is its own node).

    `position`: instance and variables of its NED position [m], if it has one. `lines`: endpoints that gateways may use;
    those in use are also among `endpoints`. `autopilots`: names of the instances that declare to be autopilots.
    """

    name: str
    endpoints: tuple[Endpoint, ...]
    position: tuple[tuple[str, Variable], ...] = ()
    lines: tuple[Endpoint, ...] = ()
    autopilots: tuple[str, ...] = ()


def nodes_of(checked: CheckedSystem, position: str, problems: list[Problem]) -> tuple[Node, ...]:
    """Returns the nodes of a checked system, by its FMUs with packet ports that are not connected.

    Args:
        position: path, below a node, of its position; empty: declared by its FMUs, or by convention.
    """
    wired = {link.target for link in checked.links} | {link.source for link in checked.links}
    grouped: dict[str, list[Endpoint]] = {}
    lines: dict[str, list[Endpoint]] = {}
    instances = {instance.name: instance for instance in checked.instances}
    declared = _declared_positions(checked.instances)
    files = {id(one.fmu): one.fmu for one in checked.instances}
    packets = {key: [v for v in fmu.variables.values() if v.packet_capacity is not None] for key, fmu in files.items()}
    for instance in checked.instances:
        ports = [v for v in packets[id(instance.fmu)] if (instance.name, v.name) not in wired]
        own = _lines(instance, ports)
        ports = [v for v in ports if not any(v in (line.rx, line.tx) for line in own)]
        rx = [v for v in ports if v.causality == "input"]
        tx = [v for v in ports if v.causality == "output"]
        if not rx and not tx:
            continue
        for found in (rx, tx):
            if len(found) > 1:
                names = ", ".join(v.name for v in found)
                text = SEVERAL_PORTS.text(instance.name, found[0].causality, names)
                problems.append(Problem(instance.where, text))
        for v in (*rx, *(line.rx for line in own if line.rx is not None)):
            if (v.packet_capacity or 0) < MAX_PACKET:
                text = SMALL_PORT.text(f"{instance.name}.{v.name}", v.packet_capacity, MAX_PACKET)
                problems.append(Problem(instance.where, text))
        node = instance.name.rpartition(".")[0] or instance.name
        ends = Endpoint(instance.name, rx[0] if rx else None, tx[0] if tx else None)
        grouped.setdefault(node, []).append(ends)
        lines.setdefault(node, []).extend(own)
    return tuple(
        Node(
            name,
            tuple(endpoints),
            (() if position else declared.get(name, ())) or _position(name, position or BY_CONVENTION, instances),
            tuple(lines[name]),
            tuple(e.instance for e in endpoints if Role.ARMED in instances[e.instance].fmu.verdicts.values()),
        )
        for name, endpoints in grouped.items()
    )


def _lines(instance: ComponentInstance, ports: Sequence[Variable]) -> list[Endpoint]:
    """Returns the lines to gateways of an instance that also has other packet ports."""
    by_name = {v.name: v for v in ports}
    found = []
    for line in (TELEMETRY, SERIAL):
        rx, tx = (by_name.get(name) for name in _ends_of_line(instance.fmu, _LINES[line]))
        if rx is not None and tx is not None and (rx.causality, tx.causality) == ("input", "output"):
            found.append(Endpoint(instance.name, rx, tx, line))
    return found if len(ports) > 2 * len(found) else []


def _ends_of_line(fmu: FmuDescription, role: Role) -> tuple[str, str]:
    """Returns the names of the input and the output that an FMU declares as a line, or of the conventional ones."""
    declared = [fmu.variables[name] for name, verdict in fmu.verdicts.items() if verdict is role]
    inputs = [v.name for v in declared if v.causality == "input"]
    outputs = [v.name for v in declared if v.causality == "output"]
    return (inputs[0], outputs[0]) if inputs and outputs else LINES[role]


def _declared_positions(instances: Sequence[ComponentInstance]) -> dict[str, tuple[tuple[str, Variable], ...]]:
    """Returns, by node, the variables that its only FMU with a position declares as the position."""
    found: dict[str, list[tuple[tuple[str, Variable], ...]]] = {}
    for instance in instances:
        node = instance.name.rpartition(".")[0] or instance.name
        variables = instance.fmu.variables
        for name, verdict in instance.fmu.verdicts.items():
            if verdict is Role.POSITION:
                elements = elements_of(name, variables)
                found.setdefault(node, []).append(tuple((instance.name, variables[one]) for one in elements))
    return {node: positions[0] for node, positions in found.items() if len(positions) == 1}


def _position(node: str, path: str, instances: Mapping[str, ComponentInstance]) -> tuple[tuple[str, Variable], ...]:
    component, _, name = path.rpartition(".")
    instance = instances.get(f"{node}.{component}" if component else node)
    if instance is None:
        return ()
    variables = [instance.fmu.variables.get(f"{name}[{i}]") for i in (1, 2, 3)]
    if any(v is None or v.type != "Real" or v.causality != "output" for v in variables):
        return ()
    return tuple((instance.name, v) for v in variables if v is not None)
