"""Elements of a network that refer to some of its nodes or places: relays, outages, partitions, jamming."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern
from cosim_master.system.settings.annotation import Attributes
from cosim_master.system.settings.radio.nodes import Node

__all__ = ["Jamming", "Partition", "matched", "read_jamming", "read_outage", "read_partition", "read_relays"]


@dataclass(frozen=True, slots=True)
class Partition:
    """The nodes with these names are cut off from all others between start and stop [s]."""

    nodes: tuple[str, ...]
    start: float
    stop: float


@dataclass(frozen=True, slots=True)
class Jamming:
    """Nodes within `radius` of a place [m], at any height, do not hear anything between start and stop [s].

    With `gps`, satellite navigation is jammed there, too.
    """

    north: float
    east: float
    radius: float
    start: float
    stop: float
    gps: bool = False


def read_partition(child: Attributes, nodes: Sequence[Node]) -> Partition:
    """Reads a `partition`. Problems are reported to the reader."""
    names = {node.name: node for node in nodes}
    ends = child.text("nodes", "").split()
    start, stop = _span(child, "partition")
    child.finish()
    found = {name: None for end in ends for name in matched(end, names)}
    for end in ends:
        if not matched(end, names):
            hint = near_pattern(end, names) if is_pattern(end) else near(end, names)
            child.problem(f'partition of "{end}": there is no such radio node; {hint}')
    if not ends or len(found) == len(names):
        child.problem('a partition names some of the nodes, and not all of them: nodes="A B", or patterns')
    return Partition(tuple(found), start, stop)


def read_relays(reader: Attributes, nodes: Sequence[Node]) -> tuple[str, ...]:
    """Returns the nodes that relay, in their order. Problems are reported to the reader."""
    names = {node.name: node for node in nodes}
    ends = reader.text("relays", "").split()
    for end in ends:
        if not matched(end, names):
            hint = near_pattern(end, names) if is_pattern(end) else near(end, names)
            reader.problem(f'relays="{end}": there is no such radio node; {hint}')
    if not ends and reader.text("hops", ""):
        reader.problem('hops is for relays, and no node relays; name some: relays="*"', "hops")
    found = {name for end in ends for name in matched(end, names)}
    return tuple(name for name in names if name in found)


def read_jamming(child: Attributes) -> Jamming:
    """Reads a `jamming`. Problems are reported to the reader."""
    north, east = (child.number(name, 0.0, -1e9, 1e9) for name in ("north", "east"))
    radius = child.number("radius", 0.0, 0.0, 1e9)
    start, stop = _span(child, "jamming")
    gps = child.choice("gps", "false", ("true", "false")) == "true"
    child.finish()
    if radius <= 0.0:
        child.problem("jamming needs a radius, in m")
    return Jamming(north, east, radius, start, stop, gps)


def _span(child: Attributes, what: str) -> tuple[float, float]:
    """Returns start and stop, s."""
    start = child.number("start", 0.0, 0.0, 1e9)
    stop = child.number("stop", math.inf, 0.0, math.inf)
    if stop <= start:
        child.problem(f"{what} from {start:g} s to {stop:g} s: stop must be after start")
    return start, stop


def read_outage(child: Attributes, nodes: Sequence[Node]) -> tuple[str, float, float]:
    """Reads an `outage`: node, start and stop [s]. Problems are reported to the reader."""
    names = [node.name for node in nodes]
    name = child.text("node", "")
    start, stop = _span(child, "outage")
    child.finish()
    if name not in names:
        child.problem(f'outage of node "{name}": there is no such radio node; {near(name, names)}')
    return (name, start, stop)


def matched(end: str, nodes: Mapping[str, Node]) -> tuple[str, ...]:
    """Returns the nodes that a name or a pattern means."""
    return (end,) if end in nodes else tuple(matching(end, nodes))
