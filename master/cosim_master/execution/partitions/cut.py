"""The cut of a system into parts, one for each process, and the reasons why a system cannot be cut.

A *unit* is never cut: a radio node with all its instances, or an instance that belongs to none. Units that an undelayed
connection joins are kept in one part.

A packet that is sent at t arrives at t + latency or later, and a value of a delayed connection likewise, so parts that
have exchanged everything up to t can step on their own until t + the least of these times, the *lookahead*. If it has
two base steps or more, a part steps half of it while the messages of the other half are under way.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import matching
from cosim_master.execution.partitions.hearing import reach_of
from cosim_master.execution.partitions.nearest import counts_nearest
from cosim_master.execution.partitions.nearness import cut_by_places, places_of
from cosim_master.execution.preparation.prepare import Prepared
from cosim_master.execution.run.opening import Share
from cosim_master.stepping.layout import Layout
from cosim_master.system.flatten.flat import CheckedSystem, FlatConnection
from cosim_master.system.settings.network import Network

__all__ = ["Assignment", "Cut", "cut", "read_assignment", "uses_positions"]

_UNLIMITED = 64
"""Base steps between two exchanges of parts that nothing connects."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """The wishes of a user for a cut: patterns of units for each part, and the machine that it needs.

    Attributes:
        patterns: of each part; empty parts take no unit.
        hosts: names of machines, empty if any will do.
        where: the file or option.
    """

    patterns: tuple[tuple[str, ...], ...]
    hosts: tuple[str, ...]
    where: Where


@dataclass(frozen=True, slots=True)
class Cut:
    """A cut that can run.

    Attributes:
        parts: their number.
        of_instance, of_node: the part of each instance and of each radio node, by number.
        window: base steps between two exchanges.
        hidden: whether the messages of a window are under way while the next one is stepped.
        lookahead: s; infinity if nothing crosses the cut.
        limit: the link or connection that limits it.
        links: listed radio links that cross; None if any node may hear any other.
        connections: delayed connections that cross.
        hosts: the machine that each part needs, empty if any will do.
    """

    parts: int
    of_instance: tuple[int, ...]
    of_node: tuple[int, ...]
    window: int
    hidden: bool
    lookahead: float
    limit: str
    links: int | None
    connections: int
    hosts: tuple[str, ...] = ()

    def elsewhere(self, part: int) -> frozenset[int]:
        """Returns the numbers of the instances of the other parts."""
        return frozenset(i for i, one in enumerate(self.of_instance) if one != part)

    def count(self, part: int) -> int:
        """Returns how many instances a part has."""
        return self.of_instance.count(part)

    def share(self, part: int, layout: Layout, network: Network) -> Share:
        """Returns the share of a part."""
        reals, ints = self.passed_on(part, layout, network)
        nodes = frozenset(n for n, one in enumerate(self.of_node) if one != part)
        if part != 0:  # gateways have their sockets in part 0
            nodes |= {len(self.of_node) + g for g in range(len(network.gateways))}
        return Share(self.elsewhere(part), nodes, tuple(reals), tuple(ints), self.window)

    def passed_on(self, part: int, layout: Layout, network: Network) -> tuple[list[int], list[int]]:
        """Returns the places of the values that a part passes on: positions of its nodes, then delayed values."""
        index = layout.ports["Real"].index
        reals: list[int] = []
        if uses_positions(network):
            for n, node in enumerate(network.nodes):
                if self.of_node[n] == part:
                    reals += [index[instance, variable.name] for instance, variable in node.position]
        ints: list[int] = []
        for _, kind, source, owner, _ in self.crossing(layout):
            if owner == part:
                (reals if kind == 0 else ints).append(source)
        return reals, ints

    def crossing(self, layout: Layout) -> Iterator[tuple[int, int, int, int, int]]:
        """Yields the delayed values that cross: row of `Plan.delays`, kind (0: real), place, parts of both ends."""
        number = {one.name: i for i, one in enumerate(layout.instances)}
        integers = len(layout.ports["Integer"].outputs)
        for row, one in enumerate(layout.delays):
            source, target = (self.of_instance[number[end[0]]] for end in (one.link.source, one.link.target))
            if source != target:
                yield row, min(one.kind, 1), one.source + (integers if one.kind == 2 else 0), source, target


def uses_positions(network: Network) -> bool:
    """Returns whether the radio depends on the positions of nodes."""
    return bool(
        network.topology == "nearest" or network.range < math.inf or network.sensitivity > -math.inf or network.jamming
    )


def cut(ready: Prepared, parts: int, assignment: Assignment | None = None) -> Cut:
    """Cuts a system into parts.

    Args:
        ready: the system.
        parts: their number.
        assignment: the part of each unit; None chooses it, so that few radio links cross.

    Raises:
        SystemDescriptionError: the system cannot be cut; all reasons are given.
    """
    where = ready.checked.structure.where
    problems = [Problem(where, f"--partitions: {text}") for text in _refusals(ready)]
    units = _units(ready.checked, ready.network)
    joined = _joined(ready, units)
    if assignment is not None:
        chosen, wrong = _assigned(units, assignment, parts)
        problems += wrong
    else:
        if parts > len(set(joined)):
            text = f"{parts} parts of {len(units.names)} units ({_few(units.names)})"
            if len(set(joined)) < len(units.names):
                text += f", of which undelayed connections join some: {len(set(joined))} can be apart"
            problems.append(Problem(where, f"--partitions: {text}; give fewer parts"))
        chosen = _chosen(ready, units, joined, min(parts, max(1, len(set(joined)))))
    of_instance = tuple(chosen[u] for u in units.of_instance)
    problems += [Problem(link, f"--partitions: {text}") for link, text in _undelayed(ready, of_instance)]
    of_node = tuple(chosen[u] for u in units.of_node)
    lookahead, limit = _lookahead(ready, of_instance)
    base = ready.clock.seconds(1)
    steps = _UNLIMITED if lookahead == math.inf else math.floor(lookahead / base * (1 + 1e-12) + 1e-9)
    if steps < 1:
        text = (
            f"{limit} takes {lookahead:g} s, less than the base step of {base:.9g} s: parts could not step on their own"
        )
        problems.append(Problem(where, f"--partitions: {text}; give it at least one step"))
    if problems:
        raise SystemDescriptionError(problems)
    links = [of_node[a] != of_node[b] for a, b in _numbered(ready.network)]
    return Cut(
        parts=parts,
        of_instance=of_instance,
        of_node=of_node,
        window=min(max(1, steps // 2), _UNLIMITED),
        hidden=steps > 1,
        lookahead=lookahead,
        limit=limit,
        links=sum(links) if ready.network.topology == "listed" else None,
        connections=sum(1 for _ in _crossing(ready, of_instance)),
        hosts=assignment.hosts if assignment is not None else (),
    )


def read_assignment(file: Path, parts: int) -> Assignment:
    """Reads the parts of a system from a JSON file: {"parts": [{"units": ["drone1", "drone2*"], "host": "a"}, ...]}.

    Raises:
        SystemDescriptionError: the file cannot be read, or has another number of parts.
    """
    where = Where(str(file))
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        found = document["parts"]
        if others := sorted({*document} - {"parts"}):
            raise ValueError(f"{others[0]} is not known; there are parts only")
        if texts := [one["units"] for one in found if not isinstance(one["units"], list)]:
            raise ValueError(f"units is {json.dumps(texts[0])}, not a list of names")
        patterns = tuple(tuple(str(pattern) for pattern in one["units"]) for one in found)
        hosts = tuple(one.get("host", "") for one in found)
        if wrong := [host for host in hosts if not isinstance(host, str)]:
            raise ValueError(f"host is {json.dumps(wrong[0])}, not the name of a machine")
        if unknown := sorted({key for one in found for key in one} - {"units", "host"}):
            raise ValueError(f"{unknown[0]} is not known; a part has units and host")
    except OSError as error:
        raise SystemDescriptionError([Problem(where, f"cannot be read: {error.strerror}")]) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        form = '{"parts": [{"units": ["drone1", "drone2*"], "host": "MACHINE"}, ...]}'
        raise SystemDescriptionError([Problem(where, f"is not a list of parts ({error}); write {form}")]) from None
    if len(patterns) != parts:
        raise SystemDescriptionError([Problem(where, f"it has {len(patterns)} parts, the run has {parts}")])
    return Assignment(patterns, hosts, where)


# ---- units -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Units:
    names: tuple[str, ...]
    of_instance: tuple[int, ...]
    of_node: tuple[int, ...]


def _units(checked: CheckedSystem, network: Network) -> _Units:
    nodes = {node.name for node in network.nodes}
    names: dict[str, int] = {}
    of_instance = []
    for one in checked.instances:
        parts = one.name.split(".")
        above = [".".join(parts[: n + 1]) for n in range(len(parts))]
        unit = next((name for name in above if name in nodes), one.name)
        of_instance.append(names.setdefault(unit, len(names)))
    of_node = tuple(names[node.name] for node in network.nodes)
    return _Units(tuple(names), tuple(of_instance), of_node)


def _joined(ready: Prepared, units: _Units) -> list[int]:
    """Returns, for each unit, the representative of the units that undelayed connections join with it."""
    parent = list(range(len(units.names)))

    def root(u: int) -> int:
        while parent[u] != u:
            parent[u] = parent[parent[u]]
            u = parent[u]
        return u

    number = {one.name: i for i, one in enumerate(ready.checked.instances)}
    for link in ready.checked.links:
        a, b = (root(units.of_instance[number[end[0]]]) for end in (link.source, link.target))
        if a != b and _immediate(ready, link):
            parent[max(a, b)] = min(a, b)
    return [root(u) for u in range(len(parent))]


def _immediate(ready: Prepared, link: FlatConnection) -> bool:
    return link.initial_only or link.term is not None or link.target not in ready.master.delays


def _crossing(ready: Prepared, of_instance: Sequence[int]) -> Iterator[tuple[FlatConnection, int, int]]:
    """Yields the connections between parts, with the parts of their ends."""
    part = dict(zip((one.name for one in ready.checked.instances), of_instance, strict=True))
    for link in ready.checked.links:
        a, b = part[link.source[0]], part[link.target[0]]
        if a != b:
            yield link, a, b


def _undelayed(ready: Prepared, of_instance: Sequence[int]) -> Iterator[tuple[Where, str]]:
    for link, a, b in _crossing(ready, of_instance):
        if _immediate(ready, link):
            ends = f"{'.'.join(link.source)} in part {a} and {'.'.join(link.target)} in part {b}"
            yield link.where, f"the connection between {ends} has no delay; give it one, or keep both in one part"


# ---- refusals and the lookahead --------------------------------------------------------------------------------------


def _refusals(ready: Prepared) -> Iterator[str]:
    master, network = ready.master, ready.network
    if master.algorithm != "jacobi" or master.sequence or master.in_python or master.variable:
        yield f"the master {master.algorithm} cannot run in parts; only jacobi can"
    if network.medium in ("aloha", "csma"):
        yield f'medium="{network.medium}" is one medium of all nodes at every instant; only none, own and shared can'
    if network.relays:
        yield "relays send packets on at once, wherever they are; a network with relays cannot run in parts"
    if network.own is not None:
        yield "an own channel decides how long packets take; a network with one cannot run in parts"
    if eventful := [one.name for one in ready.checked.instances if one.fmu.capabilities.hasEventMode]:
        yield f"FMUs with Event Mode cannot run in parts: {_few(eventful)}"


def _lookahead(ready: Prepared, of_instance: Sequence[int]) -> tuple[float, str]:
    """Returns the lookahead, s, and the link or connection that limits it."""
    network = ready.network
    found: list[tuple[float, str]] = [(math.inf, "nothing")]
    if len(network.nodes) > 1:
        found += _latencies(network)
    for link, _, _ in _crossing(ready, of_instance):
        delay = ready.master.delays.get(link.target)
        if delay is not None and not _immediate(ready, link):
            found.append((delay.ns / 1e9, f"the connection to {'.'.join(link.target)}"))
    return min(found, key=lambda one: one[0])


def _latencies(network: Network) -> Iterator[tuple[float, str]]:
    """Yields the latencies of the radio's links, of all of them: packets within a part wait for the exchange, too."""
    named = [channel for channel in network.channels if channel.latency is not None]
    if network.topology == "listed":
        for a, b in network.links:
            own = [c.latency for c in named if a in c.senders and b in c.hearers]
            yield (float(own[-1] or 0.0) if own else network.latency), f"the radio link from {a} to {b}"
    else:
        yield network.latency, "a radio link"
        for channel in named:
            yield float(channel.latency or 0.0), f"the radio link from {channel.source} to {channel.target}"
    if network.trace is not None:
        for _, a, b, delivered, delay in network.trace.rows:
            if delivered > 0.0:  # a row of losses needs no delay
                yield delay, f"the radio link from {a} to {b} in {network.trace.file}"


# ---- the choice ------------------------------------------------------------------------------------------------------


def _assigned(units: _Units, assignment: Assignment, parts: int) -> tuple[list[int], list[Problem]]:
    chosen: list[int | None] = [None] * len(units.names)
    problems = []
    number = {name: u for u, name in enumerate(units.names)}
    for part, patterns in enumerate(assignment.patterns):
        for pattern in patterns:
            found = matching(pattern, units.names)
            if not found:
                text = f"{pattern} is no unit of the system; there are {_few(units.names)}"
                problems.append(Problem(assignment.where, text))
            for name in found:
                before = chosen[number[name]]
                if before not in (None, part):
                    problems.append(Problem(assignment.where, f"{name} is in part {before} and in part {part}"))
                chosen[number[name]] = part
    if missing := [name for name, part in zip(units.names, chosen, strict=True) if part is None]:
        problems.append(Problem(assignment.where, f"{_few(missing)}: in no part"))
    if len(assignment.patterns) != parts:
        problems.append(Problem(assignment.where, f"it has {len(assignment.patterns)} parts, the run has {parts}"))
    return [part or 0 for part in chosen], problems


def _chosen(ready: Prepared, units: _Units, joined: Sequence[int], parts: int) -> list[int]:
    """Returns the part of each unit: connected ones in one part, about as many instances in each, few links cut.

    Without listed links, units that are near each other are in one part if only they can hear each other.
    """
    network = ready.network
    weight: dict[int, int] = dict.fromkeys(joined, 0)
    for u in units.of_instance:
        weight[joined[u]] += 1
    if counts_nearest(network) or (network.topology != "listed" and reach_of(network) < math.inf):
        places = places_of(ready.checked, [joined[u] for u in units.of_instance])
        if places:
            near = cut_by_places(weight, places, parts)
            return [near[u] for u in joined]
    edges: dict[int, dict[int, int]] = {u: {} for u in weight}
    for a, b in _numbered(network):
        one, other = joined[units.of_node[a]], joined[units.of_node[b]]
        if one != other:
            edges[one][other] = edges[one].get(other, 0) + 1
            edges[other][one] = edges[other].get(one, 0) + 1
    order = _walk(edges)
    total, done, part = sum(weight.values()), 0, 0
    found: dict[int, int] = {}
    for place, u in enumerate(order):
        left = len(order) - place
        if part < parts - 1 and found and (done >= total * (part + 1) / parts or left <= parts - 1 - part):
            part += 1
        found[u] = part
        done += weight[u]
    _refine(edges, weight, found, total / parts)
    return [found[u] for u in joined]


def _walk(edges: Mapping[int, Mapping[int, int]]) -> list[int]:
    """Returns the units with neighbours close together (Cuthill and McKee 1969); without links, in their order."""
    left = dict.fromkeys(edges)
    order: list[int] = []
    for start in sorted(edges, key=lambda u: len(edges[u])):
        if start not in left:
            continue
        for _ in range(2):  # an end of the graph: the unit that a walk from anywhere reaches last
            start = _breadth_first(edges, start, left)[-1] if edges[start] else start
        walked = _breadth_first(edges, start, left)
        order += walked
        for u in walked:
            del left[u]
    return order


def _breadth_first(edges: Mapping[int, Mapping[int, int]], start: int, left: Mapping[int, None]) -> list[int]:
    seen, order = {start}, [start]
    for u in order:
        for v in sorted(edges[u], key=lambda v: (len(edges[v]), v)):
            if v not in seen and v in left:
                seen.add(v)
                order.append(v)
    return order


def _refine(
    edges: Mapping[int, Mapping[int, int]], weight: Mapping[int, int], found: dict[int, int], ideal: float
) -> None:
    """Moves units to the part of most of their neighbours, while parts stay about equally large."""
    sizes: dict[int, int] = {}
    for u, part in found.items():
        sizes[part] = sizes.get(part, 0) + weight[u]
    for _ in range(4):
        moved = False
        for u, part in found.items():
            pull: dict[int, int] = {}
            for v, links in edges[u].items():
                pull[found[v]] = pull.get(found[v], 0) + links
            best = max(pull, key=lambda p: (pull[p], -p), default=part)
            fits = sizes.get(best, 0) + weight[u] <= 1.05 * ideal and sizes[part] - weight[u] >= 0.95 * ideal
            if best != part and pull[best] > pull.get(part, 0) and fits:
                sizes[part] -= weight[u]
                sizes[best] += weight[u]
                found[u], moved = best, True
        if not moved:
            return


def _numbered(network: Network) -> list[tuple[int, int]]:
    number = {node.name: n for n, node in enumerate(network.nodes)}
    return [(number[a], number[b]) for a, b in network.links]


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
