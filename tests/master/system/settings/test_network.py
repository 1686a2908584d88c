"""The network annotation: nodes and endpoints found, defaults, and every way to write it wrong, with its line."""

from __future__ import annotations

import hashlib
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.execution.preparation.prepare import prepare
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.annotation import Attributes
from cosim_master.system.settings.network import Jamming, Network, Partition, network_of
from cosim_master.system.settings.radio.disturbances import read_outage
from cosim_master.system.settings.radio.obstacles import Obstacle

NAMESPACE = "https://uav-cosim.org/ns/1"
TYPE = "org.uav-cosim.network"


def packets(*ports: str, size: int = 2048) -> str:
    made = "".join(
        f'<PacketPort variable="{name}" mimeType="application/x-mavlink;version=2" maxSize="{size}"/>' for name in ports
    )
    return f'<VendorAnnotations><Tool name="uav-cosim"><PacketPorts>{made}</PacketPorts></Tool></VendorAnnotations>'


@pytest.fixture
def swarm(workshop: Any, variable: Any) -> Any:
    """Reads the network of drones d1, d2, ... of a vehicle and an agent each, with the given annotation."""
    position = [variable(f"position[{i}]", "output", unit="m") for i in (1, 2, 3)]
    workshop.fmu("vehicle.fmu", *position, variable("speed", "output"), step="0.01")
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)

    def read(
        content: str = "", drones: int = 3, after: str = "", annotation: str = "", seed: int | None = None
    ) -> Network:
        inner = workshop.component("vehicle", "vehicle.fmu") + workshop.component("agent", "agent.fmu")
        systems = "".join(workshop.system(inner, name=f"d{i}") for i in range(1, drones + 1))
        if content:
            annotation = workshop.annotation(TYPE, content)
        path = workshop.ssd("s.ssd", workshop.system(systems, after=annotation))
        return network_of(check(read_system(path)), seed)

    return read


PACKETS = packets("mavlink_rx", "mavlink_tx")


def network(attributes: str = "", inner: str = "") -> str:
    return f'\n<network xmlns="{NAMESPACE}"\n {attributes}>\n{inner}\n</network>\n'


def problems(read: Any, *arguments: Any, **options: Any) -> list[str]:
    with pytest.raises(SystemDescriptionError) as caught:
        read(*arguments, **options)
    return [str(problem) for problem in caught.value.problems]


def test_without_an_annotation_everybody_hears_everybody(swarm: Any) -> None:
    found = swarm()
    assert [node.name for node in found.nodes] == ["d1", "d2", "d3"]
    assert (found.topology, found.latency, found.jitter, found.loss, found.range) == (
        "broadcast",
        0.0,
        0.0,
        0.0,
        math.inf,
    )
    assert (found.seed, found.links, found.outages, found.axis) == (0, frozenset(), (), None)
    assert found.notes == ("no org.uav-cosim.network annotation: packets reach every node at once and without loss",)
    assert swarm(drones=1).notes == ()


def test_an_empty_annotation_means_the_same_without_a_note(swarm: Any) -> None:
    found = swarm(network())
    assert (found.topology, found.notes) == ("broadcast", ())


def test_nodes_have_endpoints_and_a_position(swarm: Any) -> None:
    node = swarm().nodes[1]
    (endpoint,) = node.endpoints
    assert (endpoint.instance, endpoint.rx.name, endpoint.tx.name) == ("d2.agent", "mavlink_rx", "mavlink_tx")
    assert [(instance, v.name) for instance, v in node.position] == [
        ("d2.vehicle", "position[1]"),
        ("d2.vehicle", "position[2]"),
        ("d2.vehicle", "position[3]"),
    ]


def test_a_position_is_declared_whatever_it_is_called(workshop: Any, variable: Any) -> None:
    """The annotation comes first, then the declaration of the only FMU that has one, then the convention of names."""
    declared = '<Tool name="org.uav-cosim.verdict"><Verdicts><Position variable="place"/></Verdicts></Tool>'
    place = [variable(f"place[{i}]", "output", unit="m") for i in (1, 2, 3)]
    position = [variable(f"position[{i}]", "output", unit="m") for i in (1, 2, 3)]
    tools = f"<VendorAnnotations>{declared}</VendorAnnotations>"
    workshop.fmu("body.fmu", *place, *position, step="0.01", extra=tools)
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)

    def found(*bodies: str, content: str = network()) -> list[str]:
        inner = "".join(workshop.component(name, "body.fmu") for name in bodies)
        inner = workshop.system(inner + workshop.component("agent", "agent.fmu"), name="d1")
        path = workshop.ssd("s.ssd", workshop.system(inner, after=workshop.annotation(TYPE, content)))
        (node,) = network_of(check(read_system(path))).nodes
        return [f"{instance}.{v.name}" for instance, v in node.position]

    assert found("frame") == [f"d1.frame.place[{i}]" for i in (1, 2, 3)]
    assert found("frame", content=network('position="frame.position"')) == [
        f"d1.frame.position[{i}]" for i in (1, 2, 3)
    ]
    assert found("frame", "load") == []
    assert found("vehicle", "load") == [f"d1.vehicle.position[{i}]" for i in (1, 2, 3)]


def test_everything_written_out(swarm: Any) -> None:
    attributes = (
        'topology="nearest" axis="0 2 0" neighbours="2" latency="0.02" jitter=".005" loss="1e-1" range="300" seed="7"'
    )
    found = swarm(network(attributes, '<outage node="d3" start="10" stop="20"/><outage node="d1"/>'))
    assert (found.topology, found.neighbours, found.axis) == ("nearest", 2, (0.0, 1.0, 0.0))
    assert (found.latency, found.jitter, found.loss, found.range, found.seed) == (0.02, 0.005, 0.1, 300.0, 7)
    assert found.outages == (("d3", 10.0, 20.0), ("d1", 0.0, math.inf))
    assert swarm(network('seed="7"'), seed=9).seed == 9


def test_effects_written_out(swarm: Any) -> None:
    found = swarm(
        network(
            'burstStart="0.1" burstEnd="0.4" burstLoss="0.5" sensitivity="-95" power="10" pathLoss="40" exponent="3" '
            'shadowing="6" rayleigh="true" bitErrors="1e-5" duplicates="0.01" medium="aloha" slot="0.02" window="4" '
            'queue="0.5"',
            '<link from="d1" to="*" burstStart="0.2"/><partition nodes="d1 d2" start="3" stop="4"/>'
            '<jamming north="1" east="2" radius="3"/>',
        )
    )
    assert (found.burst_start, found.burst_end, found.burst_loss) == (0.1, 0.4, 0.5)
    assert (found.sensitivity, found.power, found.path_loss, found.exponent) == (-95.0, 10.0, 40.0, 3.0)
    assert (found.shadowing, found.rayleigh, found.bit_errors, found.duplicates) == (6.0, True, 1e-5, 0.01)
    assert (found.medium, found.slot, found.window, found.queue, found.rate) == ("aloha", 0.02, 4, 0.5, math.inf)
    assert [(one.burst_start, one.burst_end, one.loss) for one in found.channels] == [(0.2, None, None)]
    assert found.partitions == (Partition(("d1", "d2"), 3.0, 4.0),)
    assert found.jamming == (Jamming(1.0, 2.0, 3.0, 0.0, math.inf),)


def test_csma_and_obstacles_written_out(swarm: Any) -> None:
    found = swarm(
        network(
            'sensitivity="-95" medium="csma" rate="57600" backoff="0.1" sensing="0.001"',
            '<box north="1" east="2" length="3" width="4" height="5" base="-6" loss="7"/>'
            '<cylinder radius="8" height="9" attenuation="0.5"/>',
        )
    )
    assert (found.medium, found.rate, found.backoff, found.sensing, found.queue) == ("csma", 57600.0, 0.1, 0.001, 1.0)
    assert found.obstacles == (
        Obstacle(1.0, 2.0, 3.0, 4.0, 0.0, 5.0, -6.0, 7.0, 0.0),
        Obstacle(0.0, 0.0, 0.0, 0.0, 8.0, 9.0, 0.0, 0.0, 0.5),
    )


def test_links_go_both_ways(swarm: Any) -> None:
    found = swarm(
        network('topology="listed" range="INF"', '<link between="d1 d2"/><!-- and --><link between="d3 d2"/>')
    )
    assert found.links == {("d1", "d2"), ("d2", "d1"), ("d3", "d2"), ("d2", "d3")}


@pytest.mark.parametrize(
    ("attributes", "inner", "message"),
    [
        ('topology="mesh"', "", 'topology="mesh": valid are broadcast, nearest, listed'),
        ('latency="-1"', "", 'latency="-1" must be a number from 0 to 3600'),
        ('latency="soon"', "", 'latency="soon" must be a number from 0 to 3600'),
        ('jitter="INF"', "", 'jitter="INF" must be a number from 0 to 3600'),
        ('loss="1.5"', "", 'loss="1.5" must be a number from 0 to 1'),
        ('loss="nan"', "", 'loss="nan" must be a number from 0 to 1'),
        ('range="-5"', "", 'range="-5" must be a number from 0 to inf'),
        ('seed="1.5"', "", 'seed="1.5" must be a whole number from 0 to 9007199254740992'),
        ('topology="nearest" neighbours="0"', "", 'neighbours="0" must be a whole number from 1 to 1000000'),
        ('neighbours="2"', "", 'neighbours is for topology="nearest", this is "broadcast"'),
        ('topology="listed" axis="0 1 0"', "", 'axis is for topology="nearest", this is "listed"'),
        ('topology="nearest" axis="0 1"', "", 'axis="0 1" must be a vector "north east down"'),
        ('topology="nearest" axis="0 0 0"', "", 'axis="0 0 0" must be a vector "north east down"'),
        ('topology="nearest" axis="0 INF 0"', "", 'axis="0 INF 0" must be a vector "north east down"'),
        (
            'delay="1"',
            "",
            "attribute delay: valid are axis, backoff, bitErrors, burstEnd, burstLoss, burstStart, channel, diale",
        ),
        ("", '<link between="d1 d2"/>', 'a <link> without latency, jitter or loss is for topology="listed", this'),
        ('topology="listed"', '<link between="d1 d9"/>', 'there is no radio node "d9"; valid: "d1", "d2", "d3"'),
        ('topology="listed"', '<link between="d1 d1"/>', 'a link from "d1" to itself; name two nodes'),
        (
            'topology="listed"',
            '<link at="d1"/>',
            "attribute at: valid are between, burstEnd, burstLoss, burstStart, from",
        ),
        ("", '<outage node="d9"/>', 'outage of node "d9": there is no such radio node; valid: "d1", "d2", "d3"'),
        ("", '<outage node="d1" start="5" stop="5"/>', "outage from 5 s to 5 s: stop must be after start"),
        ("", '<outage node="d1" until="5"/>', "attribute until: valid are node, start, stop"),
        ("", "<burst/>", "<burst> is unknown here: valid are link, outage"),
        (
            'burstStart="0.1"',
            "",
            "bursts begin with burstStart=0.1 and end with burstEnd=1: burstEnd must be more than",
        ),
        (
            'burstStart="0.1" burstEnd="0"',
            "",
            "bursts begin with burstStart=0.1 and end with burstEnd=0: burstEnd must",
        ),
        (
            'burstStart="0.00001" burstEnd="0.00001"',
            "",
            "both together from 0.0001 to 1: a burst of 1/burstEnd packets",
        ),
        ("", '<link between="d1 d2" burstStart="0.5"/>', "bursts begin with burstStart=0.5 and end with burstEnd=1"),
        ('burstLoss="0.9"', "", "burstLoss is for bursts, and none begins: give burstStart, the probability that one"),
        ("", '<link between="d1 d2" burstEnd="0.5"/>', "burstEnd is for bursts, and none begins: give burstStart"),
        ('loss="0_1"', "", 'loss="0_1" must be a number from 0 to 1'),
        ('hops="1_0"', "", 'hops="1_0" must be a whole number from 1 to 255'),
        ('bitErrors="0.6"', "", 'bitErrors="0.6" must be a number from 0 to 0.5'),
        ('rayleigh="yes"', "", 'rayleigh="yes": valid are true, false'),
        ('shadowing="6"', "", "shadowing is for signals that can be too weak: give sensitivity, in dBm"),
        ('sensitivity="-90" position="vehicle.speed"', "", "sensitivity and jamming need positions; "),
        ("", "<box/>", "a box needs a length, a width and a height, in m"),
        ("", '<box length="1" width="1" height="0" loss="1"/>', "a box needs a length, a width and a height, in m"),
        ("", '<cylinder height="9" loss="1"/>', "a cylinder needs a radius and a height, in m"),
        ("", '<cylinder radius="1" height="9"/>', "an obstacle needs a loss, in dB, or an attenuation, in dB/m"),
        ("", '<cylinder radius="1" height="9" loss="-1"/>', 'loss="-1" must be a number from 0 to 1e+06'),
        ("", '<box radius="1"/>', "attribute radius: valid are attenuation, base, east, height, length, loss, north"),
        (
            "",
            '<box length="1" width="1" height="1" loss="1"/>',
            "<box> and <cylinder> are for signals that can be too weak: give sensitivity, in dBm",
        ),
        ('medium="ether"', "", 'medium="ether": valid are none, own, shared, aloha, csma'),
        ('medium="csma" backoff="0.1"', "", 'medium="csma" needs a rate, in baud'),
        ('medium="csma" rate="57600"', "", 'medium="csma" needs a backoff, in s'),
        (
            'medium="csma" rate="57600" backoff="0.1" sensing="0.002"',
            "",
            "sensing=0.002 s: it must be less than the time of the shortest packet on the air, 0.00139 s",
        ),
        ('backoff="0.1"', "", 'backoff is for medium="csma", this is "none"'),
        ('medium="shared" rate="9600" sensing="0.1"', "", 'sensing is for medium="csma", this is "shared"'),
        ('medium="shared"', "", 'medium="shared" needs a rate, in baud'),
        ('medium="aloha"', "", 'medium="aloha" needs a slot, in s'),
        ('rate="57600"', "", 'rate is for medium="own" or "shared" or "csma", this is "none"'),
        ('medium="own" rate="9600" window="2"', "", 'window is for medium="aloha", this is "own"'),
        ("", '<partition nodes="d9"/>', 'partition of "d9": there is no such radio node; valid: "d1", "d2", "d3"'),
        ("", '<partition nodes="d*"/>', "a partition names some of the nodes, and not all of them"),
        ("", '<partition start="1"/>', "a partition names some of the nodes, and not all of them"),
        ("", '<partition nodes="d1" start="5" stop="4"/>', "partition from 5 s to 4 s: stop must be after start"),
        ('relays="d9"', "", 'relays="d9": there is no such radio node; valid: "d1", "d2", "d3"'),
        ('relays="d1 x*"', "", 'relays="x*": there is no such radio node; '),
        ('hops="3"', "", 'hops is for relays, and no node relays; name some: relays="*"'),
        ('relays="*" hops="0"', "", 'hops="0" must be a whole number from 1 to 255'),
        ("", "<jamming/>", "jamming needs a radius, in m"),
        ('range="10" position="vehicle.speed"', "", "topology nearest and range need positions; "),
        ('topology="nearest" position="pilot.position"', "", "topology nearest and range need positions; "),
    ],
)
def test_what_is_wrong_and_where(swarm: Any, workshop: Any, attributes: str, inner: str, message: str) -> None:
    found = problems(swarm, network(attributes, inner))
    lines = (workshop.root / "s.ssd").read_text().splitlines()
    matching = [text for text in found if message in text]
    assert matching, found
    for text in found:
        place = re.match(r"(.*?):(\d+): ", text)
        assert place is not None and Path(place[1]).name == "s.ssd"
        shown = lines[int(place[2]) - 1]
        # lxml gives the line on which an element's start tag ends
        assert "<network" in shown or attributes in shown or inner in shown


@pytest.mark.parametrize("setting", ['range="10"', 'topology="nearest"', 'sensitivity="-90"'])
def test_a_position_is_in_metres(workshop: Any, variable: Any, swarm: Any, setting: str) -> None:
    velocity = [variable(f"velocity[{i}]", "output", unit="m/s") for i in (1, 2, 3)]
    workshop.fmu("vehicle.fmu", *velocity, step="0.01")
    found = problems(swarm, network(f'{setting} position="vehicle.velocity"'))
    assert "need positions in m; velocity[1] of node d1 is in m/s: name the outputs of its position" in found[0]
    assert len(found) == 3


def test_all_problems_come_at_once(swarm: Any) -> None:
    assert len(problems(swarm, network('latency="x" loss="y" more="z"', '<outage node="d9"/>'))) == 4


@pytest.mark.parametrize(
    "content",
    ["", "<network/>", f'<net xmlns="{NAMESPACE}"/>', f'<network xmlns="{NAMESPACE}"/><network xmlns="{NAMESPACE}"/>'],
    ids=["nothing", "no namespace", "another element", "two"],
)
def test_an_annotation_holds_one_network(swarm: Any, workshop: Any, content: str) -> None:
    annotation = workshop.annotation(TYPE, content)
    (found,) = problems(swarm, annotation=annotation)
    ours = f'this annotation must hold one <network xmlns="{NAMESPACE}">'
    of_the_schema = f"against the schema: Element '{{{NAMESPACE}}}network': This element is not expected."
    assert (of_the_schema if content.count("<network") == 2 else ours) in found


def test_a_second_annotation_and_one_of_a_part(swarm: Any, workshop: Any) -> None:
    one = workshop.annotation(TYPE, network())
    twice = one.replace("</ssd:Annotations>\n", "") + one.replace("<ssd:Annotations>", "")
    (found,) = problems(swarm, annotation=twice)
    assert f"a second {TYPE}; the first is at " in found


def test_a_network_belongs_to_the_root(workshop: Any, variable: Any) -> None:
    workshop.fmu("agent.fmu", variable("mavlink_tx", "output", kind="String"), step="0.01", extra=packets("mavlink_tx"))
    part = workshop.system(
        workshop.component("agent", "agent.fmu"), name="d1", after=workshop.annotation(TYPE, network())
    )
    path = workshop.ssd("s.ssd", workshop.system(part))
    (found,) = problems(lambda: network_of(check(read_system(path))))
    assert found.endswith(f"{TYPE} belongs to the root system, not to d1")


@pytest.mark.parametrize(
    ("ports", "size", "message"),
    [
        (
            ("mavlink_rx", "other_rx"),
            2048,
            "several packet inputs for the radio, mavlink_rx, other_rx: one is valid",
        ),
        (("mavlink_rx",), 279, "agent.mavlink_rx holds 279 bytes, and a MAVLink packet may have 280"),
    ],
)
def test_ports_that_the_radio_cannot_serve(
    workshop: Any, variable: Any, ports: tuple[str, ...], size: int, message: str
) -> None:
    workshop.fmu(
        "agent.fmu", *(variable(p, kind="String") for p in ports), step="0.01", extra=packets(*ports, size=size)
    )
    path = workshop.ssd("s.ssd", workshop.system(workshop.component("agent", "agent.fmu")))
    (found,) = problems(lambda: network_of(check(read_system(path))))
    assert found.endswith(message)


def test_ports_that_are_wired_are_not_for_the_radio(workshop: Any, variable: Any) -> None:
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)
    names = "mavlink_rx:input mavlink_tx:output"
    parts = "".join(workshop.component(name, "agent.fmu", names) for name in ("a", "b"))
    wires = workshop.connection("a/mavlink_tx", "b/mavlink_rx")
    found = network_of(check(read_system(workshop.ssd("s.ssd", workshop.system(parts, wires)))))
    ends = {node.name: [(e.rx and e.rx.name, e.tx and e.tx.name) for e in node.endpoints] for node in found.nodes}
    assert ends == {"a": [("mavlink_rx", None)], "b": [(None, "mavlink_tx")]}


def test_a_dialect_of_ones_own(swarm: Any, tmp_path: Path) -> None:
    message = '<message id="42100" name="HELLO"><field type="float" name="x"/></message>'
    xml = f"<mavlink><messages>{message}</messages></mavlink>"
    (tmp_path / "swarm.xml").write_text(xml)
    found = swarm(network('dialect="swarm.xml"'))
    assert [(m.name, m.id) for m in found.dialect] == [("HELLO", 42100)]
    assert swarm(network()).dialect == ()


def test_a_dialect_that_is_none(swarm: Any, tmp_path: Path) -> None:
    (found,) = problems(swarm, network('dialect="none.xml"'))
    assert found.endswith(f'dialect="none.xml": {tmp_path / "none.xml"}: No such file or directory')
    assert "s.ssd:" in found
    (tmp_path / "bad.xml").write_text("<swarm/>")
    (found,) = problems(swarm, network('dialect="bad.xml"'))
    assert found.endswith("the root of a dialect is <mavlink>, not <swarm>")


TRACE = "delay, time,from,to,delivered\n0.02,0,d1,d2,1\n\n,1.5,d1,d2,0\n0.5,0,d3,d1,0.25\n"


def test_a_trace_file(swarm: Any, tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(TRACE)
    found = swarm(network('trace="x.csv"')).trace
    assert found.rows == ((0.0, "d1", "d2", 1.0, 0.02), (1.5, "d1", "d2", 0.0, 0.0), (0.0, "d3", "d1", 0.25, 0.5))
    assert (found.file, found.sha256) == ("x.csv", hashlib.sha256(TRACE.encode()).hexdigest())
    assert swarm(network()).trace is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: it is empty; valid are time,from,to,delivered,delay, in any order"),
        ("time,from,to\n0,d1,d2\n", ":1: its columns are time,from,to; valid are time,from,to,delivered,delay, in any"),
        ("time,from,to,delivered,delay\n", ": no rows follow the line time,from,to,delivered,delay"),
        ("time,from,to,delivered,delay\n0,d1,d2,1\n", ":2: a row has 5 values: time,from,to,delivered,delay"),
        ("time,from,to,delivered,delay\n0,d1,d2,1,0,0\n", ":2: a row has 5 values: time,from,to,delivered,delay"),
        (TRACE + "0,0,d9,d1,1\n", ':6: from="d9": there is no such radio node; valid: "d1", "d2", "d3"'),
        (TRACE + "0,0,d1,d9,1\n", ':6: to="d9": there is no such radio node; valid: "d1", "d2", "d3"'),
        (TRACE + "0,0,d1,d1,1\n", ':6: from "d1" to itself; name two nodes'),
        (TRACE + "0,soon,d1,d3,1\n", ':6: time="soon" must be a number from 0 to 9e+09'),
        (TRACE + "0,-1,d1,d3,1\n", ':6: time="-1" must be a number from 0 to 9e+09'),
        (TRACE + "0,0,d1,d3,yes\n", ':6: delivered="yes" must be a number from 0 to 1'),
        (TRACE + "0,0,d1,d3,2\n", ':6: delivered="2" must be a number from 0 to 1'),
        (TRACE + ",0,d1,d3,1\n", ':6: delay="" must be a number from 0 to 3600'),
        (TRACE + "nan,0,d1,d3,1\n", ':6: delay="nan" must be a number from 0 to 3600'),
        (TRACE + "0,1.5,d1,d2,1\n", ":6: 1.5 s from d1 to d2 is also in line 4; keep one of them"),
    ],
)
def test_a_wrong_trace_file(swarm: Any, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.csv").write_text(text)
    (found,) = problems(swarm, network('trace="x.csv"'))
    assert found.startswith(f"{tmp_path / 'x.csv'}{message}")


def test_a_trace_file_that_cannot_be_used(swarm: Any, tmp_path: Path) -> None:
    (found,) = problems(swarm, network('trace="none.csv"'))
    assert found.endswith(f'trace="none.csv": {tmp_path / "none.csv"}: No such file or directory') and "s.ssd:" in found
    (tmp_path / "x.csv").write_text(TRACE)
    (found,) = problems(swarm, network('topology="listed" trace="x.csv"', '<link between="d1 d2"/>'))
    assert found.endswith("it has a link from d3 to d1, which no <link> creates; add the link, or remove the rows")
    (tmp_path / "x.csv").write_text("time,from,to,delivered,delay\n" + "x,d1,d2,1,0\n" * 50)
    found = problems(swarm, network('trace="x.csv"'))
    assert len(found) == 11 and found[-1].endswith("x.csv: and 40 more problems of this kind")


# ---- links that differ --------------------------------------------------------------------------------------------


def test_a_link_one_way_and_a_pattern(swarm: Any) -> None:
    found = swarm(network('loss="0.1"', '<link from="d3" to="*" loss="0.3"/><link between="d? d1" latency=".5"/>'))
    assert found.links == frozenset()
    assert [(c.source, c.target, c.latency, c.jitter, c.loss) for c in found.channels] == [
        ("d3", "*", None, None, 0.3),
        ("d?", "d1", 0.5, None, None),
        ("d1", "d?", 0.5, None, None),
    ]
    assert [(c.senders, c.hearers) for c in found.channels] == [
        (("d3",), ("d1", "d2", "d3")),
        (("d1", "d2", "d3"), ("d1",)),
        (("d1",), ("d1", "d2", "d3")),
    ]


def test_names_make_links_and_patterns_describe_them(swarm: Any) -> None:
    inner = '<link between="d1 d2" jitter="0.1"/><link from="d2" to="d3"/><link from="d1" to="*" loss="1"/>'
    found = swarm(network('topology="listed"', inner))
    assert found.links == {("d1", "d2"), ("d2", "d1"), ("d2", "d3")}
    assert [(c.source, c.target) for c in found.channels] == [("d1", "d2"), ("d2", "d1"), ("d1", "*")]


@pytest.mark.parametrize(
    ("attributes", "inner", "message"),
    [
        ("", '<link from="d7" to="*" loss="1"/>', 'there is no radio node "d7"; valid: "d1", "d2", "d3"'),
        ("", '<link from="d1" to="e*" loss="1"/>', 'there is no radio node "e*"; valid: "d*"'),
        ("", '<link from="d1" loss="1"/>', 'a link is between="A B", both ways, or from="A" to="B", one way'),
        ("", '<link between="d1 d2" to="d3" loss="1"/>', 'a link is between="A B", both ways, or from="A" to="B"'),
        ("", '<link from="d1" to="d1" loss="1"/>', 'a link from "d1" to itself; name two nodes'),
        ("", '<link from="d1" to="?1" loss="1"/>', 'a link from "d1" to itself; name two nodes'),
        ("", '<link from="d1" to="d2" loss="2"/>', 'loss="2" must be a number from 0 to 1'),
        ("", '<link from="d1" to="d2" range="2"/>', "attribute range: valid are between, burstEnd, burstLoss"),
        ('topology="listed"', '<link between="d1 *"/>', "patterns make no links, they describe them"),
        (
            'topology="listed"',
            '<link between="d1 d2"/><link from="d3" to="*" loss="1"/>',
            'no link is listed from "d3" to "*"; patterns make none',
        ),
    ],
)
def test_links_that_are_wrong(swarm: Any, workshop: Any, attributes: str, inner: str, message: str) -> None:
    found = problems(swarm, network(attributes, inner))
    assert [text for text in found if message in text], found
    assert all(text.startswith(f"{workshop.root / 's.ssd'}:") for text in found)


# ---- settings that a run overrides --------------------------------------------------------------------------------


@pytest.fixture
def overridden(workshop: Any, variable: Any) -> Any:
    """The network of two agents under overrides; `name` is that of the first agent."""
    ports = (variable("mavlink_rx", kind="String"), variable("mavlink_tx", "output", kind="String"))
    workshop.fmu("agent.fmu", *ports, step="0.01", extra=PACKETS)

    def read(overrides: dict[str, str], content: str = "", name: str = "a", seed: int | None = None) -> Network:
        annotation = workshop.annotation(TYPE, content) if content else ""
        inner = workshop.component(name, "agent.fmu") + workshop.component("b", "agent.fmu")
        path = workshop.ssd("s.ssd", workshop.system(inner, after=annotation))
        return network_of(check(read_system(path), overrides), seed)

    return read


def test_a_run_overrides_the_annotation(overridden: Any) -> None:
    written = network('loss="0.5" latency="0.1" seed="4"', '<link from="a" to="b" jitter="1"/>')
    given = {"network.loss": "0.2", "network.seed": "9", "network.topology": "listed"}
    found = overridden(given, written)
    assert (found.loss, found.latency, found.seed, found.topology) == (0.2, 0.1, 9, "listed")
    assert found.links == {("a", "b")}


def test_another_topology_leaves_out_what_was_for_the_first(overridden: Any) -> None:
    listed = network('topology="listed"', '<link between="a b"/><link from="a" to="b" loss="1"/>')
    found = overridden({"network.topology": "broadcast"}, listed)
    assert (found.topology, found.links, [c.loss for c in found.channels]) == ("broadcast", frozenset(), [1.0])
    nearest = network('topology="nearest" axis="0 1 0" neighbours="2"')
    found = overridden({"network.topology": "broadcast"}, nearest)
    assert (found.topology, found.axis, found.notes) == ("broadcast", None, ())
    (text,) = problems(overridden, {"network.topology": "broadcast", "network.neighbours": "3"}, nearest)
    assert text.endswith('neighbours is for topology="nearest", this is "broadcast"')
    (text,) = problems(overridden, {"network.topology": "mesh"}, nearest)
    assert text == "--set: network.topology=mesh: valid are broadcast, nearest, listed"


def test_a_run_needs_no_annotation(overridden: Any) -> None:
    found = overridden({"network.latency": " 0.25", "network.range": "INF"})
    assert (found.latency, found.range, found.notes) == (0.25, math.inf, ())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"network.los": "0.2"}, '--set: there is no setting "network.los"; did you mean "network.loss"?'),
        ({"network.loss": "2"}, "--set: network.loss=2 must be a number from 0 to 1"),
        ({"network.seed": "x"}, "--set: network.seed=x must be a whole number from 0 to"),
        ({"network.topology": "mesh"}, "network.topology=mesh: valid are broadcast, nearest"),
        ({"network.range": "5"}, "--set: topology nearest and range need positions; "),
        ({"networks.loss": "5"}, 'there is no variable "networks.loss"'),
    ],
)
def test_settings_that_are_wrong(overridden: Any, given: dict[str, str], message: str) -> None:
    assert [text for text in problems(overridden, given) if message in text], problems(overridden, given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"queue": "1"}, 'queue is for medium="own" or "shared" or "aloha" or "csma", this is "none"'),
        ({"medium": "shared"}, 'medium="shared" needs a rate, in baud'),
        ({"medium": "aloha"}, 'medium="aloha" needs a slot, in s'),
        ({"medium": "csma", "rate": "9600"}, 'medium="csma" needs a backoff, in s: '),
        ({"medium": "csma", "rate": "9600", "backoff": "1", "sensing": "1"}, "sensing=1 s: it must be less than "),
        ({"burstLoss": "1"}, "burstLoss is for bursts, and none begins: "),
        ({"burstStart": "1"}, "bursts begin with burstStart=1 and end with burstEnd=1: "),
        ({"power": "20"}, "power is for signals that can be too weak: "),
        ({"hops": "3"}, "hops is for relays, and no node relays; "),
        ({"neighbours": "3"}, 'neighbours is for topology="nearest", this is "broadcast"'),
    ],
)
def test_settings_of_a_run_that_do_not_fit_are_not_blamed_on_the_file(
    overridden: Any, given: dict[str, str], message: str
) -> None:
    names = {f"network.{name}": value for name, value in given.items()}
    (text,) = problems(overridden, names, network('loss="0.1"'))
    assert text.startswith(f"--set: {message}")
    written = " ".join(f'{name}="{value}"' for name, value in given.items())
    (text,) = problems(overridden, {"network.loss": "0.1"}, network(written))
    assert re.match(rf".*s\.ssd:\d+: {re.escape(message)}", text)


def test_the_seed_is_given_once(overridden: Any) -> None:
    assert overridden({"network.seed": "3"}, seed=3).seed == 3
    (text,) = problems(overridden, {"network.seed": "4"}, seed=3)
    assert text == "--set: the seed is given twice, as 3 and by --set network.seed=4; give it once"


def test_a_component_called_network_wins(overridden: Any) -> None:
    (text,) = problems(overridden, {"network.loss": "0.2"}, name="network")
    assert 'there is no variable "network.loss"' in text
    assert text.endswith('; "network" is an element of this system here, not the annotation')
    assert overridden({}, network('loss="0.5"'), name="network").loss == 0.5


def test_relays(swarm: Any) -> None:
    assert (swarm(network()).relays, swarm(network()).hops) == ((), 8)
    found = swarm(network('relays="d3 d[12] d1" hops="2"').replace("d[12] ", ""))
    assert (found.relays, found.hops) == (("d1", "d3"), 2)
    assert swarm(network('relays="*"')).relays == ("d1", "d2", "d3")
    assert [*found.senders()] == [("d1.agent", 0), ("d2.agent", 1), ("d3.agent", 2), ("d1.relay", 0), ("d3.relay", 2)]


def test_an_own_channel(swarm: Any, tmp_path: Path) -> None:
    text = "def channel(packet):\n    return packet.delay\n"
    (tmp_path / "rain.py").write_text(text)
    found = swarm(network('channel="rain.py"')).own
    assert (found.file, found.path, found.places) == ("rain.py", tmp_path / "rain.py", False)
    assert found.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert swarm(network()).own is None


def test_an_own_channel_that_cannot_be_used(swarm: Any, tmp_path: Path) -> None:
    (found,) = problems(swarm, network('channel="none.py"'))
    assert "s.ssd:" in found
    assert found.endswith(f'channel="none.py": {tmp_path / "none.py"}: No such file or directory')
    (tmp_path / "rain.py").write_text("def channel(packet):\n    return packet.distance / 3e8\n")
    found = problems(swarm, network('channel="rain.py" position="nowhere"'))
    assert any("distance, sender and receiver in rain.py need positions; " in one for one in found)
    (tmp_path / "rain.py").write_text("def channel(packet):\n    return 1.0 +\n")
    (found,) = problems(swarm, network('channel="rain.py"'))
    assert found == f"{tmp_path / 'rain.py'}:2: is not Python: invalid syntax"


@pytest.mark.parametrize(
    ("inner", "note"),
    [
        (
            '<outage node="d2" start="200" stop="300"/>',
            "the outage of d2 from 200 s to 300 s has no effect: the run goes",
        ),
        (
            '<outage node="d2" start="10"/>',
            "the outage of d2 from 10 s on has no effect: the run goes from 0 s to 10 s",
        ),
        ('<partition nodes="d1 d2" start="3000"/>', "the partition of d1, d2 from 3000 s on has no effect"),
        ('<jamming radius="5" start="11"/>', "the jamming from 11 s on has no effect: the run goes from 0 s to 10 s"),
        ('<outage node="d2" start="9"/><jamming radius="5"/><partition nodes="d1" stop="1"/>', ""),
    ],
)
def test_disturbances_outside_of_the_run_are_noted(swarm: Any, workshop: Any, inner: str, note: str) -> None:
    swarm(network("", inner))
    with read_system(workshop.root / "s.ssd") as structure:
        ready = prepare(check(structure), until=10.0)
    found = [one for one in map(str, ready.notes) if "has no effect" in one]
    assert len(found) == bool(note) and all(one.startswith(note) for one in found)


def test_names_that_may_be_meant_come_in_the_order_of_the_nodes() -> None:
    """Not in that of a set, which is another one in each process."""
    found: list[Problem] = []
    nodes: Any = [SimpleNamespace(name=f"drone{i}") for i in range(1, 9)]
    read_outage(Attributes(etree.fromstring('<outage node="drone*"/>'), Where("s.ssd", 1), found), nodes)
    assert found[0].message.endswith('there is no such radio node; did you mean "drone1" or "drone2" or "drone3"?')
