"""Radio reachability of nodes, and nodes in reach of each other with the same MAVLink system id."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from cosim.verdict import Role
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.network import Network

__all__ = ["Twice", "depends_on_places", "heard_by_relays", "repeated", "system_ids", "twice"]

Array: TypeAlias = np.ndarray[Any, Any]


@dataclass(frozen=True, slots=True)
class Twice:
    """Nodes with the same system id, and a listener that hears all of them or, as one of them, the others."""

    system_id: int
    nodes: tuple[str, ...]
    listener: str


def system_ids(checked: CheckedSystem, network: Network) -> tuple[dict[str, int], ...]:
    """Returns, for each node, the system ids that its FMUs declare, by the hierarchical name of the parameter."""
    instances = {instance.name: instance for instance in checked.instances}
    found = []
    for node in network.nodes:
        own: dict[str, int] = {}
        for name in dict.fromkeys(endpoint.instance for endpoint in node.endpoints):
            instance = instances[name]
            of = [v for v, verdict in instance.fmu.verdicts.items() if verdict is Role.SYSTEM_ID]
            values = instance.effective_values() if of else {}
            own |= {f"{name}.{v}": int(values[v]) for v in of if v in values}
        found.append(own)
    return tuple(found)


def repeated(ids: Sequence[dict[str, int]]) -> dict[int, list[int]]:
    """Returns the system ids that more than one node uses, with the numbers of these nodes."""
    by_id: dict[int, list[int]] = {}
    for n, own in enumerate(ids):
        for value in dict.fromkeys(own.values()):
            by_id.setdefault(value, []).append(n)
    return {value: nodes for value, nodes in by_id.items() if len(nodes) > 1}


def depends_on_places(network: Network) -> bool:
    """Returns whether radio reachability depends on positions."""
    return network.topology == "nearest" or math.isfinite(network.range)


def twice(network: Network, ids: Sequence[dict[str, int]], places: Array | None = None) -> list[Twice]:
    """Returns the system ids that are used twice within earshot.

    Args:
        ids: system ids of each node.
        places: (nodes, 3), positions of the nodes [m]; needed if `depends_on_places`.
    """
    groups = repeated(ids)
    if not groups:
        return []
    heard = heard_by_relays(network, places) | np.eye(len(network.nodes), dtype=bool)
    found = []
    for value, nodes in groups.items():
        hears = heard[nodes].sum(axis=0)
        listener = int(hears.argmax())
        if hears[listener] > 1:
            names = tuple(network.nodes[n].name for n in nodes if heard[n, listener])
            found.append(Twice(value, names, network.nodes[listener].name))
    return found


def heard_by_relays(network: Network, places: Array | None = None) -> Array:
    """Returns a matrix: row a, column b is True if node b hears node a, directly or by relays.

    Args:
        places: (nodes, 3), positions of the nodes [m]; without them, only listed links limit who hears whom.
    """
    direct = heard = _heard(network, places)
    relays = np.isin([node.name for node in network.nodes], network.relays)
    for _ in range(network.hops if relays.any() else 0):
        farther = heard | (heard[:, relays].astype(np.float32) @ direct[relays].astype(np.float32) > 0.0)
        if (farther == heard).all():
            break
        heard = farther
    return heard


def _heard(network: Network, places: Array | None) -> Array:
    """Returns a matrix: row a, column b is True if node b is in reach of node a's transmissions."""
    count = len(network.nodes)
    heard = np.ones((count, count), dtype=bool)
    if network.topology == "listed":
        number = {node.name: n for n, node in enumerate(network.nodes)}
        heard[:] = False
        for a, b in network.links:
            heard[number[a], number[b]] = True
    if places is None:
        return heard
    if network.topology == "nearest":
        heard[:] = False
        nearest = min(network.neighbours, count - 1)
        if network.axis is not None:
            order = np.argsort(places @ np.array(network.axis), kind="stable")
            for shift in range(1, nearest + 1):
                heard[order[:-shift], order[shift:]] = heard[order[shift:], order[:-shift]] = True
        else:
            for n in range(count):
                distance = np.linalg.norm(places - places[n], axis=1)
                distance[n] = math.inf
                heard[n, np.argsort(distance, kind="stable")[:nearest]] = True
    if math.isfinite(network.range):
        for n in range(count):
            heard[n] &= np.linalg.norm(places - places[n], axis=1) <= network.range
    return heard
