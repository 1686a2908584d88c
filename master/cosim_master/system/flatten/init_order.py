"""The order in which values are exchanged while the FMUs are in Initialization Mode.

An output that depends on inputs during initialization (InitialUnknowns, FMI 2.0.5, section 2.2.8) has its value only
after these inputs have theirs. Links are divided into stages: get the sources of a stage, set its targets, and continue
with the next stage. Links that form a loop (a strongly connected component of these dependencies) are a separate stage,
which is repeated until its values no longer change; see `loops`.

If an FMU does not declare the dependencies of an output, the standard's default applies: it depends on all inputs.
Loops that exist only because of this default converge at the first repetition.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

from cosim_master.fmi.description.read import FmuDescription

__all__ = ["Stage", "components", "exchange_order"]

_Node = tuple[str, str, str]  # kind ("in", "out", or "all" inputs of an instance), instance, variable
_Ends = tuple[tuple[str, str], tuple[str, str]]
_Any = TypeVar("_Any", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Stage:
    """Links that are exchanged together, as indices; `loop` is True if they depend on each other."""

    links: tuple[int, ...]
    loop: bool = False


def exchange_order(links: Sequence[_Ends], fmus: Mapping[str, FmuDescription], notes: list[str]) -> tuple[Stage, ...]:
    """Returns stages of links, as indices into `links`.

    Args:
        links: (source instance, variable), (target instance, variable).
        fmus: description of each instance.
        notes: appended to.
    """
    edges, assumed = _graph(links, fmus)
    component = components(edges)
    members: dict[int, list[_Node]] = {}
    for node, number in component.items():
        members.setdefault(number, []).append(node)
    level = _levels(edges, component, members)
    stages: dict[tuple[int, int, int], list[int]] = {}
    for index, (source, target) in enumerate(links):
        start, end = ("out", *source), ("in", *target)
        number = component[start]
        if component[end] == number:
            key = (level[number], 1, number)
        else:
            key = (level[number], 0 if len(members[number]) == 1 else 2, 0)
        stages.setdefault(key, []).append(index)
    unsaid = sorted(
        {node[1] for number, inside in members.items() if len(inside) > 1 for node in inside if node in assumed}
    )
    if unsaid:
        names = ", ".join(unsaid[:5]) + (f" and {len(unsaid) - 5} more" if len(unsaid) > 5 else "")
        notes.append(
            f"{names}: the FMU does not say what its outputs depend on while initializing, and a loop of connections "
            "runs through it: values are exchanged until they no longer change"
        )
    return tuple(Stage(tuple(stages[key]), loop=key[1] == 1) for key in sorted(stages))


def _graph(links: Sequence[_Ends], fmus: Mapping[str, FmuDescription]) -> tuple[dict[_Node, list[_Node]], set[_Node]]:
    """Returns edges from each node to the nodes that depend on it, and the outputs whose dependencies are assumed."""
    edges: dict[_Node, list[_Node]] = {}
    assumed: set[_Node] = set()
    linked: dict[str, set[str]] = {}
    for source, target in links:
        edges.setdefault(("out", *source), []).append(("in", *target))
        hub: _Node = ("all", target[0], "")
        edges.setdefault(("in", *target), []).append(hub)
        edges.setdefault(hub, [])
        linked.setdefault(target[0], set()).add(target[1])
    inputs = {instance: frozenset(names) for instance, names in linked.items()}

    @cache  # an output depends on a hundred parameters, which no link sets, in each of a thousand drones
    def linked_ones(needed: tuple[str, ...], names: frozenset[str]) -> tuple[str, ...]:
        return tuple(name for name in needed if name in names)

    for instance, variable in dict.fromkeys(source for source, _ in links):
        fmu, output = fmus[instance], ("out", instance, variable)
        if variable in fmu.initial_unknowns:
            needed = fmu.initial_unknowns[variable]
        elif fmu.variables[variable].initial == "exact":
            needed = ()
        else:
            needed = None
            assumed.add(output)
        if needed is None:
            edges.setdefault(("all", instance, ""), []).append(output)
        for name in linked_ones(needed or (), inputs.get(instance, frozenset())):
            edges[("in", instance, name)].append(output)
    return edges, assumed


def components(edges: Mapping[_Any, Sequence[_Any]]) -> dict[_Any, int]:
    """Returns the number of each node's strongly connected component, counted against the direction of the edges.

    Source: R. Tarjan, Depth-first search and linear graph algorithms, SIAM J. Comput. 1 (1972); without recursion.
    """
    index: dict[_Any, int] = {}
    low: dict[_Any, int] = {}
    component: dict[_Any, int] = {}
    open_nodes: list[_Any] = []
    count = 0
    for root in edges:
        if root in index:
            continue
        path = [(root, iter(edges[root]))]
        index[root] = low[root] = len(index)
        open_nodes.append(root)
        while path:
            node, following = path[-1]
            for target in following:
                if target not in index:
                    index[target] = low[target] = len(index)
                    open_nodes.append(target)
                    path.append((target, iter(edges[target])))
                    break
                if target not in component:
                    low[node] = min(low[node], index[target])
            else:
                path.pop()
                if path:
                    low[path[-1][0]] = min(low[path[-1][0]], low[node])
                if low[node] == index[node]:
                    while True:
                        member = open_nodes.pop()
                        component[member] = count
                        if member == node:
                            break
                    count += 1
    return component


def _levels(
    edges: Mapping[_Node, Sequence[_Node]], component: Mapping[_Node, int], members: Mapping[int, Sequence[_Node]]
) -> dict[int, int]:
    """Returns the longest distance, in links, of each component from one without dependencies."""
    level = dict.fromkeys(members, 0)
    for number in sorted(members, reverse=True):  # Tarjan numbers a component after all that depend on it
        for node in members[number]:
            for target in edges[node]:
                other = component[target]
                if other != number:
                    step = 1 if node[0] == "out" or len(members[number]) > 1 else 0
                    level[other] = max(level[other], level[number] + step)
    return level
