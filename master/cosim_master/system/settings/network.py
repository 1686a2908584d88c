"""The network of a system: its nodes (`nodes`), and the settings of router and channel from its annotation.

    <ssc:Annotation type="org.uav-cosim.network">
      <network xmlns="https://uav-cosim.org/ns/1" topology="nearest" axis="0 1 0" neighbours="1"
               latency="0.02" jitter="0.005" loss="0.1" range="300" seed="1" position="vehicle.position">
        <link from="drone3" to="*" loss="0.3"/>
        <outage node="drone3" start="10" stop="20"/>
        <partition nodes="drone1 drone2" start="30" stop="40"/>
        <jamming north="0" east="50" radius="20"/>
        <box north="20" east="50" length="10" width="30" height="15" loss="12"/>
        <cylinder north="80" east="0" radius="5" height="40" loss="6" attenuation="0.5"/>
      </network>
    </ssc:Annotation>

`topology`: "broadcast" (all nodes hear each other), "nearest" (the `neighbours` nearest nodes; with an `axis`, a vector
in NED, this number of nodes on each side along it), "listed" (the `link` elements). `latency` and `jitter` in s: a
packet takes latency plus a uniformly distributed part of jitter; `loss`: probability per packet and hearer; `range` in
m.
`link`: `between` two nodes (in both directions), or `from` one `to` another. With names, it creates a link of the
topology "listed". With `latency`, `jitter` or `loss`, it also sets these values for its nodes, in any topology; other
values are unchanged, and of several links that set a value for the same nodes, the last one applies. Patterns (`*`,
`?`) describe the links of all matching nodes and do not create links. Gateways have their own links.
`outage`: the node neither sends nor receives by radio from start to stop (s, by default for ever); a packet in flight
is lost if its receiver has an outage on arrival.
`partition`: nodes by name or pattern that are cut off from all others from start to stop.
`jamming`: a circle around a place (north, east, radius in m) in which no node hears from start to stop.
`burstStart`, `burstEnd`: probabilities, per packet of a sender, that a burst of losses begins and ends on the link to a
receiver; `burstLoss`: probability of a loss within a burst. A `link` may have them.
`sensitivity`: in dBm; packets received with less are lost. They are sent with `power` (dBm), lose `pathLoss` (dB) in
the first metre and 10 `exponent` dB per decade of distance after it; `shadowing`: standard deviation in dB of the
additional loss of a pair of nodes; `rayleigh`: whether packets fade.
`box`, `cylinder`: obstacles that weaken signals; `length` is the extent to the north, `width` to the east, `base` the
height of the bottom above the origin, in m; a signal whose straight way passes through loses `loss` (dB) and
`attenuation` (dB/m) for each metre inside.
`bitErrors`: probability that a bit is inverted; the packet then arrives with a wrong CRC. `duplicates`: probability
that a packet arrives a second time, up to the jitter later.
`medium`: "none" (packets take no time on the air), "own" (each node sends its packets one after the other), "shared"
(all nodes together send their packets one after the other), "aloha" (all nodes send in slots of length `slot`, in s,
each packet in one of the next `window`; packets in the same slot collide), "csma" (each packet waits for a random part
of `backoff`, in s, and goes if its sender hears nobody; others hear it after `sensing`, in s). `rate`: in baud, ten per
byte; a packet that waits longer than `queue`, in s, is lost.
`trace`: a CSV file, relative to the system's document, with recorded fates of packets (`trace`).
`relays`: nodes, by name or pattern, that send packets on as MAVLink routers do; a packet passes at most `hops` of them.
`channel`: a Python file, relative likewise, with an effect of one's own (`own_channel`).
`position`: path, below a node, of its NED position in m. By default, it is the output that the only FMU of the node
declares as its position, or else the one with the conventional name (`cosim.naming`).
`dialect`: a MAVLink XML file, relative to the system's document, with messages that ardupilotmega does not contain:
their packets are checked and routed like all others. Other tools ignore the annotation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.diagnostics.limitations import DIALECT
from cosim_master.diagnostics.names import is_pattern, near, near_pattern
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.settings.annotation import Attributes, root_annotation
from cosim_master.system.settings.radio.disturbances import (
    Jamming,
    Partition,
    matched,
    read_jamming,
    read_outage,
    read_partition,
    read_relays,
)
from cosim_master.system.settings.radio.nodes import BY_CONVENTION, TELEMETRY, Endpoint, Node, nodes_of
from cosim_master.system.settings.radio.obstacles import Obstacle, read_box, read_cylinder
from cosim_master.system.settings.radio.own_channel import OwnChannel, read_own_channel
from cosim_master.system.settings.radio.trace import Trace, read_trace

if TYPE_CHECKING:
    from cosim.build.messages import Message

__all__ = [
    "ANNOTATION",
    "Channel",
    "Gateway",
    "Jamming",
    "Network",
    "Partition",
    "network_of",
    "with_gateways",
]

ANNOTATION = "org.uav-cosim.network"
_OF_LINKS: Mapping[str, tuple[str, float]] = {
    "latency": ("latency", 3600.0),
    "jitter": ("jitter", 3600.0),
    "loss": ("loss", 1.0),
    "burst_start": ("burstStart", 1.0),
    "burst_end": ("burstEnd", 1.0),
    "burst_loss": ("burstLoss", 1.0),
}
"""Fields of `Channel` that the attributes of a link set: the attribute, and its largest value; the least is 0."""
_EFFECTS: Mapping[str, tuple[str, float, float]] = {
    "burst_start": ("burstStart", 0.0, 1.0),
    "burst_end": ("burstEnd", 0.0, 1.0),
    "burst_loss": ("burstLoss", 0.0, 1.0),
    "power": ("power", -200.0, 200.0),
    "sensitivity": ("sensitivity", -math.inf, 200.0),
    "path_loss": ("pathLoss", 0.0, 500.0),
    "exponent": ("exponent", 0.0, 20.0),
    "shadowing": ("shadowing", 0.0, 100.0),
    "bit_errors": ("bitErrors", 0.0, 0.5),
    "duplicates": ("duplicates", 0.0, 1.0),
    "rate": ("rate", 1.0, math.inf),
    "queue": ("queue", 0.0, 3600.0),
    "slot": ("slot", 0.0, 3600.0),
    "backoff": ("backoff", 0.0, 3600.0),
    "sensing": ("sensing", 0.0, 3600.0),
}
"""Fields of `Network` for effects: the attribute, its least and its largest value."""
_OF_MEDIA = {
    "rate": ("own", "shared", "csma"),
    "queue": ("own", "shared", "aloha", "csma"),
    "slot": ("aloha",),
    "window": ("aloha",),
    "backoff": ("csma",),
    "sensing": ("csma",),
}
"""Attributes of media, and the media that have them."""
_SHORTEST = 80
"""Bits on the air of the shortest packet, one of MAVLink 1 without payload."""
_OF_SIGNALS = ("power", "pathLoss", "exponent", "shadowing", "rayleigh")


@dataclass(frozen=True, slots=True)
class Gateway:
    """A node that represents real programs, and the link to it; times in s.

    `wired`: name of the endpoint that it is wired to; None: it is on the air and reaches every node, whatever the
    topology. `quiet`: it hears only packets that are addressed to a system that has sent through it, so that nothing
    is different until it sends something.
    """

    name: str
    wired: str | None = None
    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    quiet: bool = False


@dataclass(frozen=True, slots=True)
class Channel:
    """The channel between some nodes and others; None uses the network's value. Times in s.

    `source` and `target` are names or patterns as written, `senders` and `hearers` the matching nodes.
    """

    source: str
    target: str
    senders: tuple[str, ...]
    hearers: tuple[str, ...]
    latency: float | None = None
    jitter: float | None = None
    loss: float | None = None
    burst_start: float | None = None
    burst_end: float | None = None
    burst_loss: float | None = None


@dataclass(frozen=True, slots=True)
class Network:
    """Nodes by name, and the radio between them. Times in s, lengths in m. The last of several `channels` applies."""

    nodes: tuple[Node, ...] = ()
    gateways: tuple[Gateway, ...] = ()
    topology: str = "broadcast"
    neighbours: int = 1
    axis: tuple[float, float, float] | None = None
    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    range: float = math.inf
    burst_start: float = 0.0
    burst_end: float = 1.0
    burst_loss: float = 1.0
    power: float = 20.0
    sensitivity: float = -math.inf
    path_loss: float = 31.7
    exponent: float = 2.0
    shadowing: float = 0.0
    rayleigh: bool = False
    bit_errors: float = 0.0
    duplicates: float = 0.0
    medium: str = "none"
    rate: float = math.inf
    queue: float = 1.0
    slot: float = 0.0
    window: int = 1
    backoff: float = 0.0
    sensing: float = 0.0
    relays: tuple[str, ...] = ()
    hops: int = 8
    seed: int = 0
    links: frozenset[tuple[str, str]] = frozenset()
    channels: tuple[Channel, ...] = ()
    outages: tuple[tuple[str, float, float], ...] = ()
    partitions: tuple[Partition, ...] = ()
    jamming: tuple[Jamming, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    trace: Trace | None = None
    own: OwnChannel | None = None
    dialect: tuple[Message, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def senders(self) -> Iterator[tuple[str, int]]:
        """Yields name and node of each sender by radio, in the radio's order: endpoints, gateways, relays.

        A gateway is a node of its own, behind the others.
        """
        for n, node in enumerate(self.nodes):
            yield from ((endpoint.name, n) for endpoint in node.endpoints)
        yield from ((gateway.name, len(self.nodes) + g) for g, gateway in enumerate(self.gateways))
        places = {node.name: n for n, node in enumerate(self.nodes)}
        yield from ((f"{name}.relay", places[name]) for name in self.relays)


def network_of(checked: CheckedSystem, seed: int | None = None) -> Network:
    """Returns the network of a checked system. `seed` replaces the annotation's.

    Raises:
        SystemDescriptionError: the annotation is invalid; all problems are reported at once.
    """
    problems: list[Problem] = []
    reader = root_annotation(checked, ANNOTATION, "network", problems)
    nodes = nodes_of(checked, reader.text("position", ""), problems)
    dialect = _dialect(reader, checked.structure.document.parent)
    trace = _trace(reader, nodes, checked.structure.document.parent)
    own = _own_channel(reader, nodes, checked.structure.document.parent)
    network = replace(_settings(reader, nodes, seed), dialect=dialect, trace=trace, own=own)
    if trace is not None and network.topology == "listed":
        _check_listed(reader, network, trace)
    if problems:
        raise SystemDescriptionError(problems)
    return network


def with_gateways(network: Network, gateways: Sequence[Gateway]) -> Network:
    """Returns the network with these gateways, and with the lines that they use."""
    wired = {gateway.wired for gateway in gateways if not gateway.quiet}

    def endpoints(node: Node) -> Iterator[Endpoint]:
        for endpoint in node.endpoints:
            yield endpoint
            for line in node.lines:
                used = line.name in wired or (line.line == TELEMETRY and None in wired)
                if line.instance == endpoint.instance and used:
                    yield line

    nodes = tuple(replace(node, endpoints=tuple(endpoints(node))) for node in network.nodes)
    return replace(network, nodes=nodes, gateways=tuple(gateways))


def _settings(reader: Attributes, nodes: Sequence[Node], seed: int | None) -> Network:
    written_seed = reader.integer("seed", 0, 0, 2**53)
    if reader.overridden("seed") and seed not in (None, written_seed):
        reader.problem(f"the seed is given twice, as {seed} and by --set network.seed={written_seed}; give it once")
    children = reader.children("link", "outage", "partition", "jamming", "box", "cylinder")
    topology = reader.choice("topology", "broadcast", ("broadcast", "nearest", "listed"))
    axis = _axis(reader)
    made = [link for link in children["link"] if topology == "listed" or not _only_makes(reader, link)]
    links, channels = _links(made, {node.name: node for node in nodes}, topology)
    settings = Network(
        nodes=tuple(nodes),
        topology=topology,
        neighbours=reader.integer("neighbours", 1, 1, 1_000_000),
        axis=axis if topology == "nearest" or not reader.overridden("topology") else None,
        latency=reader.number("latency", 0.0, 0.0, 3600.0),
        jitter=reader.number("jitter", 0.0, 0.0, 3600.0),
        loss=reader.number("loss", 0.0, 0.0, 1.0),
        range=reader.number("range", math.inf, 0.0, math.inf),
        seed=written_seed if seed is None else seed,
        links=links,
        channels=channels,
        outages=tuple(read_outage(child, nodes) for child in children["outage"]),
        partitions=tuple(read_partition(child, nodes) for child in children["partition"]),
        jamming=tuple(map(read_jamming, children["jamming"])),
        obstacles=(*map(read_box, children["box"]), *map(read_cylinder, children["cylinder"])),
        rayleigh=reader.choice("rayleigh", "false", ("true", "false")) == "true",
        medium=reader.choice("medium", "none", ("none", "own", "shared", "aloha", "csma")),
        window=reader.integer("window", 1, 1, 1_000_000),
        relays=read_relays(reader, nodes),
        hops=reader.integer("hops", 8, 1, 255),
        **_effects(reader),
        notes=_notes(reader, nodes),
    )
    reader.finish()
    _check_effects(reader, settings)
    if settings.topology == "nearest" or settings.range < math.inf:
        _check_positions(reader, nodes, "topology nearest and range")
    elif settings.sensitivity > -math.inf or settings.jamming:
        _check_positions(reader, nodes, "sensitivity and jamming")
    for name in ("axis", "neighbours"):
        # If the run has another topology than the file, settings of the file's topology are ignored.
        meant = reader.overridden(name) or not reader.overridden("topology")
        if settings.topology != "nearest" and meant and reader.text(name, ""):
            reader.problem(f'{name} is for topology="nearest", this is "{settings.topology}"', name, "topology")
    return settings


def _check_positions(reader: Attributes, nodes: Sequence[Node], what: str) -> None:
    for node in nodes:
        if not node.position:
            path = reader.text("position", BY_CONVENTION)
            text = f'position="{path}": there are no Real outputs {path}[1] to [3] below node {node.name}'
            reader.problem(f"{what} need positions; {text}")
        elif other := [(v.name, v.unit.name) for _, v in node.position if v.unit is not None and v.unit.name != "m"]:
            text = f"{other[0][0]} of node {node.name} is in {other[0][1]}: name the outputs of its position"
            reader.problem(f"{what} need positions in m; {text}")


def _effects(reader: Attributes) -> dict[str, Any]:
    """Returns the fields of `Network` with numbers of effects."""
    plain = Network()
    return {name: reader.number(text, getattr(plain, name), low, high) for name, (text, low, high) in _EFFECTS.items()}


def _check_effects(reader: Attributes, settings: Network) -> None:
    """Reports attributes that cannot be combined."""
    ways = [(settings.burst_start, settings.burst_end)]
    for one in settings.channels:
        start = settings.burst_start if one.burst_start is None else one.burst_start
        ways.append((start, settings.burst_end if one.burst_end is None else one.burst_end))
    links = [] if reader.element is None else [*reader.element.iter("{*}link")]
    if not reader.text("burstStart", "") and all(link.get("burstStart") is None for link in links):
        for name in ("burstLoss", "burstEnd"):
            if reader.text(name, "") or any(link.get(name) is not None for link in links):
                text = f"{name} is for bursts, and none begins: give burstStart, the probability that one does"
                reader.problem(text, name)
    for start, end in dict.fromkeys(ways):
        if start > 0.0 and not (end > 0.0 and 1e-4 <= start + end <= 1.0):
            text = "burstEnd must be more than 0, and both together from 0.0001 to 1: a burst of 1/burstEnd packets"
            told = f"bursts begin with burstStart={start:g} and end with burstEnd={end:g}: {text}"
            reader.problem(told, "burstStart", "burstEnd")
    if settings.sensitivity == -math.inf:
        for name in _OF_SIGNALS:
            if reader.text(name, ""):
                reader.problem(f"{name} is for signals that can be too weak: give sensitivity, in dBm", name)
        if settings.obstacles:
            reader.problem("<box> and <cylinder> are for signals that can be too weak: give sensitivity, in dBm")
    for name, media in _OF_MEDIA.items():
        if reader.text(name, "") and settings.medium not in media:
            names = " or ".join(f'"{one}"' for one in media)
            reader.problem(f'{name} is for medium={names}, this is "{settings.medium}"', name, "medium")
    if settings.medium in ("own", "shared", "csma") and settings.rate == math.inf:
        reader.problem(f'medium="{settings.medium}" needs a rate, in baud', "medium")
    if settings.medium == "aloha" and settings.slot <= 0.0:
        reader.problem('medium="aloha" needs a slot, in s', "medium", "slot")
    if settings.medium == "csma":
        if settings.backoff <= 0.0:
            text = 'medium="csma" needs a backoff, in s: the longest wait before a packet senses the medium'
            reader.problem(text, "medium", "backoff")
        if settings.rate < math.inf and settings.sensing * settings.rate >= _SHORTEST:
            text = f"it must be less than the time of the shortest packet on the air, {_SHORTEST / settings.rate:.3g} s"
            reader.problem(f"sensing={settings.sensing:g} s: {text}", "sensing", "rate")


def _dialect(reader: Attributes, folder: Path) -> tuple[Message, ...]:
    name = reader.text("dialect", "")
    if not name:
        return ()
    from cosim.build.dialects import read_xml  # otherwise every run would import the modules that build FMUs

    try:
        return tuple(read_xml(folder / name).values())
    except OSError as error:
        reader.problem(f'dialect="{name}": {folder / name}: {error.strerror}')
    except ValueError as error:
        for line in str(error).splitlines():
            reader.problem(DIALECT.text(name, line))
    return ()


def _trace(reader: Attributes, nodes: Sequence[Node], folder: Path) -> Trace | None:
    name = reader.text("trace", "")
    if not name:
        return None
    try:
        return read_trace(folder / name, name, [node.name for node in nodes], reader.problems)
    except OSError as error:
        reader.problem(f'trace="{name}": {folder / name}: {error.strerror}')
    return None


def _own_channel(reader: Attributes, nodes: Sequence[Node], folder: Path) -> OwnChannel | None:
    name = reader.text("channel", "")
    if not name:
        return None
    path = Path(name) if reader.overridden("channel") else folder / name  # a path of the command line is the user's
    try:
        own = read_own_channel(path, name, reader.problems)
    except OSError as error:
        reader.problem(f'channel="{name}": {path}: {error.strerror}')
        return None
    if own is not None and own.places:
        _check_positions(reader, nodes, f"distance, sender and receiver in {name}")
    return own


def _check_listed(reader: Attributes, network: Network, trace: Trace) -> None:
    """Reports links of a trace that the topology does not have."""
    for source, target in sorted({(a, b) for _, a, b, _, _ in trace.rows} - network.links):
        text = f"it has a link from {source} to {target}, which no <link> creates"
        reader.problem(f'trace="{trace.file}": {text}; add the link, or remove the rows')


def _axis(reader: Attributes) -> tuple[float, float, float] | None:
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


def _links(
    children: Sequence[Attributes], nodes: Mapping[str, Node], topology: str
) -> tuple[frozenset[tuple[str, str]], tuple[Channel, ...]]:
    """Returns the links that `link` elements create, and the channels that they describe."""
    links: set[tuple[str, str]] = set()
    described: list[tuple[Attributes, Channel]] = []
    for child in children:
        ends = _ends(child)
        numbers: dict[str, Any] = {name: child.optional(text, 0.0, most) for name, (text, most) in _OF_LINKS.items()}
        child.finish()
        describes = _describes(child)
        if ends is None or not _linkable(child, ends[0], nodes, topology, describes=describes):
            continue
        for source, target in ends:
            if topology == "listed" and source in nodes and target in nodes:
                links.add((source, target))
            if describes:
                nodes_of_ends = matched(source, nodes), matched(target, nodes)
                described.append((child, Channel(source, target, *nodes_of_ends, **numbers)))
    for child, channel in described if topology == "listed" else ():
        hearers = frozenset(channel.hearers)
        if not any(a in channel.senders and b in hearers for a, b in links):
            child.problem(f'no link is listed from "{channel.source}" to "{channel.target}"; patterns make none')
    return frozenset(links), tuple(channel for _, channel in described)


def _only_makes(reader: Attributes, link: Attributes) -> bool:
    """Returns whether a link only creates a link of the file's topology, while the run has another topology."""
    return reader.overridden("topology") and not _describes(link)


def _describes(link: Attributes) -> bool:
    """Returns whether a link sets properties of transmission."""
    return any(link.text(text, "") for text, _ in _OF_LINKS.values())


def _ends(child: Attributes) -> tuple[tuple[str, str], ...] | None:
    """Returns the ends of a `link`, in both directions if it is two-way; None if they are missing."""
    between = child.text("between", "").split()
    source, target = child.text("from", "").strip(), child.text("to", "").strip()
    if between and not source and not target and len(between) == 2:
        return ((between[0], between[1]), (between[1], between[0]))
    if source and target and not between:
        return ((source, target),)
    child.problem('a link is between="A B", both ways, or from="A" to="B", one way; "*" is every node')
    return None


def _linkable(
    child: Attributes, ends: tuple[str, str], nodes: Mapping[str, Node], topology: str, *, describes: bool
) -> bool:
    """Returns whether a link has nodes at its ends, and creates or describes a connection."""
    known = True
    for end in ends:
        if not matched(end, nodes):
            known = False
            hint = near_pattern(end, nodes) if is_pattern(end) else near(end, nodes)
            child.problem(f'there is no radio node "{end}"; {hint}')
    if known and len({*matched(ends[0], nodes), *matched(ends[1], nodes)}) < 2:
        known = False
        child.problem(f'a link from "{ends[0]}" to itself; name two nodes')
    pattern = not all(end in nodes for end in ends)
    if known and not describes and topology != "listed":
        text = 'a <link> without latency, jitter or loss is for topology="listed"'
        child.problem(f'{text}, this is "{topology}"')
    elif known and not describes and pattern:
        child.problem("patterns make no links, they describe them: give names, or latency, jitter or loss")
    return known and (describes or (topology == "listed" and not pattern))


def _notes(reader: Attributes, nodes: Sequence[Node]) -> tuple[str, ...]:
    if reader.absent and len(nodes) > 1:
        return (f"no {ANNOTATION} annotation: packets reach every node at once and without loss",)
    return ()
