"""In which order values are exchanged while the FMUs are in initialization mode.

An output that depends on inputs while initializing (InitialUnknowns, FMI 2.0.5, section 2.2.8) has its value only
after those inputs have theirs. Links are put into stages: get the sources of a stage, set its targets, go on to the
next. A cycle cannot be ordered. If the FMUs in it say so themselves it is a problem (solving it by iteration is not
supported yet); if it is only there because an FMU does not say what its outputs depend on, they are taken to depend
on nothing, with a note: the first exchange then uses the values of their own start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cosim_master.errors import Problem, Where
from cosim_master.fmu import FmuDescription

__all__ = ["exchange_order"]

_Node = tuple[str, str, str]  # what ("in", "out", "all" inputs of an instance), instance, variable
_Ends = tuple[tuple[str, str], tuple[str, str]]


def exchange_order(
    links: Sequence[_Ends],
    places: Sequence[Where],
    fmus: Mapping[str, FmuDescription],
    problems: list[Problem],
    notes: list[str],
) -> tuple[tuple[int, ...], ...]:
    """Stages of links, as indices into `links`.

    Args:
        links: (source instance, variable), (target instance, variable).
        places: where each link was described.
        fmus: description of each instance.
        problems, notes: appended to.
    """
    edges, assumed = _graph(links, fmus)
    stage, rest = _levels(edges)
    if rest:
        unsaid = sorted({instance for what, instance, _ in rest if what == "all" and instance in assumed})
        if unsaid:
            kept = {
                node: [target for target in targets if not (node[0] == "all" and target in assumed[node[1]])]
                if node[0] == "all" and node[1] in unsaid
                else targets
                for node, targets in edges.items()
            }
            stage, rest = _levels(kept)
            if not rest:
                names = ", ".join(unsaid[:5]) + (f" and {len(unsaid) - 5} more" if len(unsaid) > 5 else "")
                notes.append(
                    f"{names}: the FMU does not say what its outputs depend on while initializing, and a cycle runs "
                    "through it; its outputs are taken to depend on nothing then"
                )
    if rest:
        _report(links, places, edges, rest, problems)
        return ()
    stages: dict[int, list[int]] = {}
    for index, (source, _) in enumerate(links):
        stages.setdefault(stage[("out", *source)], []).append(index)
    return tuple(tuple(stages[level]) for level in sorted(stages))


def _graph(
    links: Sequence[_Ends], fmus: Mapping[str, FmuDescription]
) -> tuple[dict[_Node, list[_Node]], dict[str, set[_Node]]]:
    """Edges from each node to those that need it, and per instance the outputs whose dependencies are assumed."""
    edges: dict[_Node, list[_Node]] = {}
    assumed: dict[str, set[_Node]] = {}
    for source, target in links:
        edges.setdefault(("out", *source), []).append(("in", *target))
        edges.setdefault(("in", *target), [])
        hub: _Node = ("all", target[0], "")
        edges[("in", *target)].append(hub)
        edges.setdefault(hub, [])
    for instance, variable in dict.fromkeys(source for source, _ in links):
        fmu, output = fmus[instance], ("out", instance, variable)
        if variable in fmu.initial_unknowns:
            needed = fmu.initial_unknowns[variable]
        elif fmu.variables[variable].initial == "exact":
            needed = ()
        else:
            needed = None
            assumed.setdefault(instance, set()).add(output)
        if needed is None:
            edges.setdefault(("all", instance, ""), []).append(output)
        for name in needed or ():
            if ("in", instance, name) in edges:
                edges[("in", instance, name)].append(output)
    return edges, assumed


def _levels(edges: Mapping[_Node, Sequence[_Node]]) -> tuple[dict[_Node, int], list[_Node]]:
    """Longest distance in links from a node without predecessors, and the nodes that are in or behind a cycle."""
    waiting = dict.fromkeys(edges, 0)
    for targets in edges.values():
        for target in targets:
            waiting[target] += 1
    level = dict.fromkeys(edges, 0)
    ready = [node for node, count in waiting.items() if count == 0]
    for node in ready:
        for target in edges[node]:
            step = 1 if node[0] == "out" else 0
            level[target] = max(level[target], level[node] + step)
            waiting[target] -= 1
            if waiting[target] == 0:
                ready.append(target)
    return level, [node for node, count in waiting.items() if count > 0]


def _report(
    links: Sequence[_Ends],
    places: Sequence[Where],
    edges: Mapping[_Node, Sequence[_Node]],
    rest: Sequence[_Node],
    problems: list[Problem],
) -> None:
    """One problem per cycle among `rest`, naming its connections."""
    cause: dict[_Node, _Node] = {}
    left = set(rest)
    for node in rest:
        for target in edges[node]:
            if target in left:
                cause.setdefault(target, node)
    reported: set[_Node] = set()
    index = {(("out", *source), ("in", *target)): number for number, (source, target) in enumerate(links)}
    for start in rest:
        seen: dict[_Node, None] = {}
        node = start
        while node not in seen and node not in reported:
            seen[node] = None
            node = cause[node]
        if node in seen:
            path = list(seen)
            cycle = path[path.index(node) :][::-1]
            pairs = zip(cycle, [*cycle[1:], cycle[0]], strict=True)
            numbers = [index[pair] for pair in pairs if pair in index]
            ends = [f"{'.'.join(links[n][0])} -> {'.'.join(links[n][1])} ({places[n]})" for n in numbers]
            text = "these connections form a cycle without delay at initialization: " + ", ".join(ends)
            problems.append(Problem(places[numbers[0]], text))
        reported.update(seen)
