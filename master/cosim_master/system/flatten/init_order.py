"""The order in which values are exchanged while the FMUs are in Initialization Mode.

An output that depends on inputs during initialization (InitialUnknowns, FMI 2.0.5, section 2.2.8) has its value only
after these inputs have theirs. Links are divided into stages: get the sources of a stage, set its targets, and continue
with the next stage. Links that form a loop (a strongly connected component of these dependencies) are a separate stage,
which is repeated until its values no longer change; see `loops`.

If an FMU does not declare the dependencies of an output, the standard's default applies: it depends on all inputs.
Loops that exist only because of this default converge at the first repetition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cosim_master.fmi.description.read import FmuDescription

__all__ = ["Stage", "components", "exchange_order"]

_End = tuple[str, str]  # instance, variable


@dataclass(frozen=True, slots=True)
class Stage:
    """Links that are exchanged together, as indices; `loop` is True if they depend on each other."""

    links: tuple[int, ...]
    loop: bool = False


def exchange_order(
    links: Sequence[tuple[_End, _End]], fmus: Mapping[str, FmuDescription], notes: list[str]
) -> tuple[Stage, ...]:
    """Returns stages of links, as indices into `links`.

    Args:
        links: (source instance, variable), (target instance, variable).
        fmus: description of each instance.
        notes: appended to.
    """
    graph = _graph(links, fmus)
    component = components(graph.edges)
    sizes = [0] * len(graph.edges)
    for number in component:
        sizes[number] += 1
    level = _levels(graph, component, sizes)
    stages: dict[tuple[int, int, int], list[int]] = {}
    for index, (source, (instance, variable)) in enumerate(links):
        number = component[graph.outputs[source]]
        if component[graph.inputs[instance][variable]] == number:
            key = (level[number], 1, number)
        else:
            key = (level[number], 0 if sizes[number] == 1 else 2, 0)
        stages.setdefault(key, []).append(index)
    unsaid = sorted({instance for node, instance in graph.assumed.items() if sizes[component[node]] > 1})
    if unsaid:
        names = ", ".join(unsaid[:5]) + (f" and {len(unsaid) - 5} more" if len(unsaid) > 5 else "")
        notes.append(
            f"{names}: the FMU does not say what its outputs depend on while initializing, and a loop of connections "
            "runs through it: values are exchanged until they no longer change"
        )
    return tuple(Stage(tuple(stages[key]), loop=key[1] == 1) for key in sorted(stages))


@dataclass(slots=True)
class _Graph:
    """The dependencies between linked variables.

    Attributes:
        edges: of each node, the nodes that depend on it.
        outputs: nodes of sources.
        inputs: nodes of targets, by instance and variable.
        hubs: nodes that depend on all linked inputs of an instance.
        assumed: outputs whose dependencies their FMU does not declare, with their instance.
    """

    edges: list[list[int]] = field(default_factory=list)
    outputs: dict[_End, int] = field(default_factory=dict)
    inputs: dict[str, dict[str, int]] = field(default_factory=dict)
    hubs: dict[str, int] = field(default_factory=dict)
    assumed: dict[int, str] = field(default_factory=dict)

    def node(self) -> int:
        """Returns a new node."""
        self.edges.append([])
        return len(self.edges) - 1


def _graph(links: Sequence[tuple[_End, _End]], fmus: Mapping[str, FmuDescription]) -> _Graph:
    graph = _Graph()
    edges, outputs, inputs, hubs = graph.edges, graph.outputs, graph.inputs, graph.hubs
    for source, (instance, variable) in links:
        if (start := outputs.get(source)) is None:
            start = outputs[source] = graph.node()
        targets = inputs.setdefault(instance, {})
        if (end := targets.get(variable)) is None:
            end = targets[variable] = graph.node()
        if (hub := hubs.get(instance)) is None:
            hub = hubs[instance] = graph.node()
        edges[start].append(end)
        edges[end].append(hub)
    # An output depends on a hundred parameters, which no link sets, in each of a thousand drones.
    known: dict[tuple[int, str, int], tuple[str, ...]] = {}
    sets: dict[tuple[str, ...], int] = {}
    linked = {instance: sets.setdefault(tuple(own), len(sets)) for instance, own in inputs.items()}
    for (instance, variable), output in outputs.items():
        fmu = fmus[instance]
        if variable in fmu.initial_unknowns:
            needed = fmu.initial_unknowns[variable]
        else:
            needed = () if fmu.variables[variable].initial == "exact" else None
        if needed is None:
            if variable not in fmu.initial_unknowns:
                graph.assumed[output] = instance
            if instance in hubs:
                edges[hubs[instance]].append(output)
            continue
        if (own := inputs.get(instance)) is None:
            continue
        key = id(fmu), variable, linked[instance]
        if key not in known:
            known[key] = tuple(name for name in needed if name in own)
        for name in known[key]:
            edges[own[name]].append(output)
    return graph


def components(edges: Sequence[Sequence[int]]) -> list[int]:
    """Returns the number of each node's strongly connected component, counted against the direction of the edges.

    Args:
        edges: of each node, the nodes to which its edges lead.

    Source: R. Tarjan, Depth-first search and linear graph algorithms, SIAM J. Comput. 1 (1972); without recursion.
    """
    index, low, component = [-1] * len(edges), [0] * len(edges), [-1] * len(edges)
    open_nodes: list[int] = []
    visited = count = 0
    for root in range(len(edges)):
        if index[root] >= 0:
            continue
        path = [(root, iter(edges[root]))]
        index[root] = low[root] = visited
        visited += 1
        open_nodes.append(root)
        while path:
            node, following = path[-1]
            for target in following:
                if index[target] < 0:
                    index[target] = low[target] = visited
                    visited += 1
                    open_nodes.append(target)
                    path.append((target, iter(edges[target])))
                    break
                if component[target] < 0 and index[target] < low[node]:
                    low[node] = index[target]
            else:
                path.pop()
                if path and low[node] < low[path[-1][0]]:
                    low[path[-1][0]] = low[node]
                if low[node] == index[node]:
                    while True:
                        member = open_nodes.pop()
                        component[member] = count
                        if member == node:
                            break
                    count += 1
    return component


def _levels(graph: _Graph, component: Sequence[int], sizes: Sequence[int]) -> list[int]:
    """Returns the longest distance, in links, of each component from one without dependencies.

    Args:
        sizes: numbers of nodes of the components.
    """
    level = [0] * len(sizes)
    is_output = bytearray(len(component))
    for node in graph.outputs.values():
        is_output[node] = True
    # Tarjan numbers a component after all that depend on it.
    for node in sorted(range(len(component)), key=component.__getitem__, reverse=True):
        number = component[node]
        reached = level[number] + (1 if is_output[node] or sizes[number] > 1 else 0)
        for target in graph.edges[node]:
            other = component[target]
            if other != number and level[other] < reached:
                level[other] = reached
    return level
