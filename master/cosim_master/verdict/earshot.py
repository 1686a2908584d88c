"""Radio reachability of nodes, and nodes in reach of each other with the same MAVLink system id."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
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
    names = [node.name for node in network.nodes]
    if network.topology != "listed" and (places is None or not depends_on_places(network)):  # all hear all
        return [Twice(value, tuple(names[n] for n in nodes), names[0]) for value, nodes in groups.items()]
    hearers = _hearers_by_relays(network, places) if network.relays else _hearers(network, places)
    found = []
    for value, nodes in groups.items():
        rows = [np.append(one := hearers(n), [n] * (n not in one)) for n in nodes]
        hears = np.bincount(np.concatenate(rows))
        listener = int(hears.argmax())
        if hears[listener] > 1:
            heard = tuple(names[n] for n, row in zip(nodes, rows, strict=True) if listener in row)
            found.append(Twice(value, heard, names[listener]))
    return found


def _hearers_by_relays(network: Network, places: Array | None) -> Callable[[int], Array]:
    heard = heard_by_relays(network, places)
    return lambda n: np.flatnonzero(heard[n])


def heard_by_relays(network: Network, places: Array | None = None) -> Array:
    """Returns a matrix: row a, column b is True if node b hears node a, directly or by relays.

    Args:
        places: (nodes, 3), positions of the nodes [m]; without them, only listed links limit who hears whom.
    """
    count, hearers = len(network.nodes), _hearers(network, places)
    direct = np.zeros((count, count), dtype=bool)
    for n in range(count):
        direct[n, hearers(n)] = True
    heard = direct
    relays = np.isin([node.name for node in network.nodes], network.relays)
    for _ in range(network.hops if relays.any() else 0):
        farther = heard | (heard[:, relays].astype(np.float32) @ direct[relays].astype(np.float32) > 0.0)
        if (farther == heard).all():
            break
        heard = farther
    return heard


def _hearers(network: Network, places: Array | None) -> Callable[[int], Array]:
    """Returns a function of a node: the other nodes that are in reach of its transmissions."""
    count = len(network.nodes)
    all_nodes = np.arange(count)
    hearers: Callable[[int], Array] = lambda n: np.delete(all_nodes, n)  # noqa: E731
    if network.topology == "listed":
        number = {node.name: n for n, node in enumerate(network.nodes)}
        listed: list[list[int]] = [[] for _ in range(count)]
        for a, b in network.links:
            listed[number[a]].append(number[b])
        hearers = lambda n: np.array(listed[n], dtype=np.intp)  # noqa: E731
    if places is None:
        return hearers
    if network.topology == "nearest":
        hearers = _nearest(network, places)
    if not math.isfinite(network.range):
        return hearers
    some = _neighbourhoods(places, network.range) if network.topology == "broadcast" else hearers

    def within(n: int) -> Array:
        others = some(n)
        near: Array = others[(np.linalg.norm(places[others] - places[n], axis=1) <= network.range) & (others != n)]
        return near

    return within


def _nearest(network: Network, places: Array) -> Callable[[int], Array]:
    """Returns a function of a node: the nodes nearest to it."""
    count = len(network.nodes)
    nearest = min(network.neighbours, count - 1)
    if network.axis is not None:
        order = np.argsort(places @ np.array(network.axis), kind="stable")
        rank = np.argsort(order)
        return lambda n: np.delete(order[max(0, rank[n] - nearest) : rank[n] + nearest + 1], min(nearest, rank[n]))

    def of(n: int) -> Array:
        distance = np.linalg.norm(places - places[n], axis=1)
        distance[n] = math.inf
        return np.argsort(distance, kind="stable")[:nearest]

    return of


def _neighbourhoods(places: Array, reach: float) -> Callable[[int], Array]:
    """Returns a function of a node: some nodes, among them all that are within reach [m] of it."""
    cells = np.floor(places / max(reach * (1.0 + 1e-9), 1e-3))
    inside: dict[tuple[float, ...], list[int]] = {}
    for n, cell in enumerate(map(tuple, cells.tolist())):
        inside.setdefault(cell, []).append(n)

    @cache
    def around(cell: tuple[float, ...]) -> Array:
        near = set(product(*((c - 1.0, c, c + 1.0) for c in cell)))
        return np.array(sorted(n for one in near for n in inside.get(one, ())), dtype=np.intp)

    return lambda n: around(tuple(cells[n].tolist()))
