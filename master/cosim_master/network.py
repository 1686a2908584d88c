"""The network of a system: its nodes and endpoints, and the settings of router and channel from its annotation.

    <ssc:Annotation type="org.uav-cosim.network">
      <network xmlns="https://uav-cosim.org/ns/1" topology="nearest" axis="0 1 0" neighbours="1"
               latency="0.02" jitter="0.005" loss="0.1" range="300" seed="1" position="vehicle.position">
        <link between="drone1 drone2"/>
        <outage node="drone3" start="10" stop="20"/>
      </network>
    </ssc:Annotation>

`topology`: "broadcast" (everybody hears everybody), "nearest" (the `neighbours` nearest nodes; with an `axis`, a
vector in NED, that many on each side along it), "listed" (the `link` elements, both ways). `latency` and `jitter` in
s: a packet takes latency plus a uniformly distributed part of jitter; `loss`: probability per packet and hearer;
`range` in m. `outage`: the node neither sends nor hears by radio from start to stop (s, default for ever).
`position`: where below a node its NED position is, in m. Tools that do not know the annotation ignore it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cosim_master.check import CheckedSystem, Instance
from cosim_master.errors import Problem, SystemDescriptionError, Where
from cosim_master.fmu import Variable
from lxml import etree

__all__ = ["ANNOTATION", "NAMESPACE", "Endpoint", "Network", "Node", "network_of"]

ANNOTATION = "org.uav-cosim.network"
NAMESPACE = "https://uav-cosim.org/ns/1"

_TOPOLOGIES = ("broadcast", "nearest", "listed")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The packet ports of one instance; either may be missing."""

    instance: str
    rx: Variable | None
    tx: Variable | None


@dataclass(frozen=True, slots=True)
class Node:
    """What shares an antenna: an instance's parent system (an instance of the root system is a node itself).

    `position`: instance and variables of its NED position [m], where it has one.
    """

    name: str
    endpoints: tuple[Endpoint, ...]
    position: tuple[tuple[str, Variable], ...] = ()


@dataclass(frozen=True, slots=True)
class Network:
    """Nodes by name, and the radio between them. Times in s, lengths in m."""

    nodes: tuple[Node, ...] = ()
    topology: str = "broadcast"
    neighbours: int = 1
    axis: tuple[float, float, float] | None = None
    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    range: float = math.inf
    seed: int = 0
    links: frozenset[tuple[str, str]] = frozenset()
    outages: tuple[tuple[str, float, float], ...] = ()
    notes: tuple[str, ...] = field(default=())


def network_of(checked: CheckedSystem, seed: int | None = None) -> Network:
    """The network of a checked system. `seed` replaces the annotation's.

    Raises:
        SystemDescriptionError: the annotation is wrong; all problems at once.
    """
    annotations = [
        a for a in (*checked.structure.annotations, *checked.structure.system.annotations) if a.type == ANNOTATION
    ]
    problems: list[Problem] = []
    for extra in annotations[1:]:
        problems.append(Problem(extra.where, f"a second {ANNOTATION}; the first is at {annotations[0].where}"))
    element = _content(annotations[0].element, annotations[0].where, problems) if annotations else None
    reader = _Reader(element, annotations[0].where if annotations else Where(""), problems)
    nodes = _nodes(checked, reader.text("position", "vehicle.position"))
    network = _settings(reader, nodes, seed)
    if problems:
        raise SystemDescriptionError(problems)
    return network


def _content(annotation: etree._Element, where: Where, problems: list[Problem]) -> etree._Element | None:
    children = [c for c in annotation if isinstance(c.tag, str)]
    if len(children) == 1 and children[0].tag == f"{{{NAMESPACE}}}network":
        return children[0]
    problems.append(Problem(where, f'this annotation must hold one <network xmlns="{NAMESPACE}">'))
    return None


def _nodes(checked: CheckedSystem, position: str) -> tuple[Node, ...]:
    wired = {link.target for link in checked.links} | {link.source for link in checked.links}
    grouped: dict[str, list[Endpoint]] = {}
    instances = {instance.name: instance for instance in checked.instances}
    for instance in checked.instances:
        ports = [
            v
            for v in instance.fmu.variables.values()
            if v.packet_capacity is not None and (instance.name, v.name) not in wired
        ]
        rx = next((v for v in ports if v.causality == "input"), None)
        tx = next((v for v in ports if v.causality == "output"), None)
        if rx is None and tx is None:
            continue
        node = instance.name.rpartition(".")[0] or instance.name
        grouped.setdefault(node, []).append(Endpoint(instance.name, rx, tx))
    return tuple(
        Node(name, tuple(endpoints), _position(name, position, instances)) for name, endpoints in grouped.items()
    )


def _position(node: str, path: str, instances: Mapping[str, Instance]) -> tuple[tuple[str, Variable], ...]:
    component, _, name = path.rpartition(".")
    instance = instances.get(f"{node}.{component}" if component else node)
    if instance is None:
        return ()
    variables = [instance.fmu.variables.get(f"{name}[{i}]") for i in (1, 2, 3)]
    if any(v is None or v.type != "Real" or v.causality != "output" for v in variables):
        return ()
    return tuple((instance.name, v) for v in variables if v is not None)


class _Reader:
    """Attributes of one element, with their problems."""

    def __init__(self, element: etree._Element | None, where: Where, problems: list[Problem]) -> None:
        self.element = element
        self.where = where
        self.problems = problems
        self.read: set[str] = set()

    def problem(self, message: str) -> None:
        line = self.element.sourceline if self.element is not None else self.where.line
        self.problems.append(Problem(Where(self.where.path, line), message))

    def text(self, name: str, default: str) -> str:
        self.read.add(name)
        return default if self.element is None else self.element.get(name, default)

    def number(self, name: str, default: float, low: float, high: float) -> float:
        text = self.text(name, "")
        if not text:
            return default
        try:
            value = math.inf if text.strip() == "INF" else float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            self.problem(f'{name}="{text}" must be a number from {low:g} to {high:g}')
            return default
        return value

    def finish(self) -> None:
        unknown = [] if self.element is None else sorted(set(self.element.attrib) - self.read)
        if unknown:
            self.problem(f"attribute {', '.join(map(str, unknown))}: valid are {', '.join(sorted(self.read))}")


def _settings(reader: _Reader, nodes: Sequence[Node], seed: int | None) -> Network:
    topology = reader.text("topology", "broadcast")
    if topology not in _TOPOLOGIES:
        reader.problem(f'topology="{topology}": valid are {", ".join(_TOPOLOGIES)}')
    written_seed = int(reader.number("seed", 0, 0, 2**53))
    settings = Network(
        nodes=tuple(nodes),
        topology=topology,
        neighbours=int(reader.number("neighbours", 1, 1, 1e6)),
        axis=_axis(reader),
        latency=reader.number("latency", 0.0, 0.0, 3600.0),
        jitter=reader.number("jitter", 0.0, 0.0, 3600.0),
        loss=reader.number("loss", 0.0, 0.0, 1.0),
        range=reader.number("range", math.inf, 0.0, math.inf),
        seed=written_seed if seed is None else seed,
        links=_links(reader, nodes),
        outages=_outages(reader, nodes),
        notes=_notes(reader, nodes),
    )
    reader.finish()
    if topology == "nearest" or settings.range < math.inf:
        for node in nodes:
            if not node.position:
                reader.problem(
                    f"topology nearest and range need positions; node {node.name} has none at "
                    f'position="{reader.text("position", "vehicle.position")}" (three Real outputs [1] to [3])'
                )
    if settings.links and topology != "listed":
        reader.problem(f'<link> is for topology="listed", this is "{topology}"')
    return settings


def _axis(reader: _Reader) -> tuple[float, float, float] | None:
    text = reader.text("axis", "")
    if not text:
        return None
    try:
        north, east, down = (float(part) for part in text.split())
        length = math.sqrt(north * north + east * east + down * down)
    except ValueError:
        length = 0.0
    if not 0.0 < length < math.inf:
        reader.problem(f'axis="{text}" must be a vector "north east down"')
        return None
    return (north / length, east / length, down / length)


def _child_readers(reader: _Reader, tag: str) -> list[_Reader]:
    if reader.element is None:
        return []
    known = {f"{{{NAMESPACE}}}link", f"{{{NAMESPACE}}}outage"}
    if tag == "link":
        for child in reader.element:
            if isinstance(child.tag, str) and child.tag not in known:
                reader.problem(f"<{etree.QName(child).localname}> is unknown here: valid are link, outage")
    children = reader.element.findall(f"{{{NAMESPACE}}}{tag}")
    return [_Reader(child, reader.where, reader.problems) for child in children]


def _links(reader: _Reader, nodes: Sequence[Node]) -> frozenset[tuple[str, str]]:
    names = {node.name for node in nodes}
    links: set[tuple[str, str]] = set()
    for child in _child_readers(reader, "link"):
        ends = child.text("between", "").split()
        child.finish()
        if len(ends) != 2 or len(set(ends)) != 2 or not set(ends) <= names:
            child.problem(f'between="{" ".join(ends)}" must name two of the nodes {", ".join(sorted(names))}')
            continue
        links |= {(ends[0], ends[1]), (ends[1], ends[0])}
    return frozenset(links)


def _outages(reader: _Reader, nodes: Sequence[Node]) -> tuple[tuple[str, float, float], ...]:
    names = {node.name for node in nodes}
    outages = []
    for child in _child_readers(reader, "outage"):
        name = child.text("node", "")
        start = child.number("start", 0.0, 0.0, 1e9)
        stop = child.number("stop", math.inf, 0.0, math.inf)
        child.finish()
        if name not in names:
            child.problem(f'outage of node "{name}": the nodes are {", ".join(sorted(names))}')
        if stop <= start:
            child.problem(f"outage from {start:g} s to {stop:g} s: stop must lie behind start")
        outages.append((name, start, stop))
    return tuple(outages)


def _notes(reader: _Reader, nodes: Sequence[Node]) -> tuple[str, ...]:
    if reader.element is None and len(nodes) > 1:
        return (f"no {ANNOTATION} annotation: packets reach every node at once and without loss",)
    return ()
