"""Gateways: addresses read, packets cut out of what comes in (pymavlink is the oracle), routing by radio and by wire,
sockets that come and go."""

from __future__ import annotations

import random
import re
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.build.messages import Field, Message
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.network.gateways.gateways import Address, Gateways, Parser, gateways_of
from cosim_master.network.gateways.sockets import Report, Socket, TcpServer, Udp, open_socket
from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import admit, send
from cosim_master.network.radio.tables import DELIVERED, EVENT, IN_FLIGHT, OUTCOMES, USED_EVENTS, USED_LOG, Radio
from cosim_master.network.radio.topology import copies
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from tests.master.fmus.scripted import variable

RX = variable("mavlink_rx", "input", "String", 8, capacity=2048)
TX = variable("mavlink_tx", "output", "String", 9, capacity=2048)
SECOND = 1_000_000_000


def packet(system: int, to: int | None = None, sequence: int = 0, component: int = 1, version: int = 2) -> bytes:
    """A HEARTBEAT, or a COMMAND_LONG to system `to`."""
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    link.seq = sequence
    if to is None:
        message = link.heartbeat_encode(6, 8, 0, 0, 0)
    else:
        message = link.command_long_encode(to, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(link, force_mavlink1=version == 1))


def vehicle(name: str) -> Node:
    return Node(name, (Endpoint(f"{name}.autopilot", RX, TX), Endpoint(f"{name}.agent", RX, TX)))


# ---- addresses -------------------------------------------------------------------------------------------------------

LINE = Network(nodes=(vehicle("d1"), vehicle("d2"), vehicle("d3")))


def problems(*arguments: Any) -> list[str]:
    with pytest.raises(SystemDescriptionError) as caught:
        gateways_of(*arguments)
    return [str(problem) for problem in caught.value.problems]


def test_a_ground_station_is_on_the_air_and_on_loopback() -> None:
    ((gateway, address),) = gateways_of(LINE, ["udpout:14550"])
    assert gateway == Gateway("@gcs")
    assert address == Address("udpout", "127.0.0.1", 14550)


def test_several_ground_stations_have_names_and_links_of_their_own() -> None:
    first, second = gateways_of(LINE, ["tcp:5760,latency=0.1,jitter=0.02,loss=0.5", "udpin:0.0.0.0:14551"])
    assert first == (Gateway("@gcs", None, 0.1, 0.02, 0.5), Address("tcp", "127.0.0.1", 5760))
    assert second == (Gateway("@gcs2"), Address("udpin", "0.0.0.0", 14551))


def test_ports_are_numbered_as_the_vehicles_are_and_wired_to_their_autopilots() -> None:
    made = gateways_of(LINE, (), "tcp:5760+10,latency=0.01")
    assert [(gateway.name, gateway.wired, gateway.latency) for gateway, _ in made] == [
        ("@d1", "d1.autopilot", 0.01),
        ("@d2", "d2.autopilot", 0.01),
        ("@d3", "d3.autopilot", 0.01),
    ]
    assert [address.port for _, address in made] == [5760, 5770, 5780]


@pytest.mark.parametrize(
    "gcs, ports, expected",
    [
        (
            ["14550"],
            None,
            ["--gcs: 14550 is not an address: write KIND:[HOST:]PORT, its kind one of tcp, udpin, udpout"],
        ),
        (["serial:1"], None, ["--gcs: serial:1 is not an address: write KIND:[HOST:]PORT, its kind one of"]),
        (["tcp:65536"], None, ["--gcs: tcp:65536: port 65536 is above 65535"]),
        (["tcp:5760,loss=0.1,loss=0.5"], None, ["--gcs: loss=0.5: loss is given twice; leave out one of them"]),
        (["tcp:5760,loss=0_1"], None, ["--gcs: loss=0_1: must be a number from 0 to 1"]),
        (["tcp:5760+10"], None, ["--gcs: tcp:5760+10: +10 is for --ports"]),
        (["tcp:5760,loss=2"], None, ["--gcs: loss=2: must be a number from 0 to 1"]),
        (["tcp:5760,latency=x"], None, ["--gcs: latency=x: must be a number from 0 to 3600"]),
        (["tcp:5760,delay=1"], None, ["--gcs: delay=1: valid are latency=, jitter=, loss= and sign="]),
        (["tcp:5760,sign=/no/such"], None, ["--gcs: sign=/no/such: No such file or directory"]),
        ([], "tcp:5760", ["--ports: tcp:5760: 3 vehicles need different ports, such as +10"]),
        ([], "tcp:65530+10", ["--ports: tcp:65530+10: the port of vehicle 3 would be 65550, above 65535"]),
        (["tcp:5770"], "tcp:5760+10", ["--gcs, --ports: 127.0.0.1:5770 is asked for 2 times"]),
        (["x"], "y", ["--gcs: x is not an address", "--ports: y is not an address"]),
    ],
)
def test_what_an_address_may_not_be(gcs: list[str], ports: str | None, expected: list[str]) -> None:
    found = problems(LINE, gcs, ports)
    assert len(found) == len(expected)
    for text, start in zip(found, expected, strict=True):
        assert text.startswith(start)


def test_ports_need_autopilots() -> None:
    network = Network(nodes=(Node("d1", (Endpoint("d1.agent", RX, TX),)),))
    (found,) = problems(network, (), "tcp:5760")
    assert found == (
        "--ports: no autopilot has packet ports: an FMU declares to be one, or its component is called autopilot; "
        "those that have are: d1.agent"
    )


# ---- cutting packets out of what comes in ----------------------------------------------------------------------------

BLOCKS = [packet(1), packet(2, version=1), packet(3, to=9), packet(4, sequence=255, component=191)]


@settings(deadline=None)
@given(st.lists(st.sampled_from(BLOCKS), max_size=8), st.randoms(use_true_random=False))
def test_a_stream_may_be_cut_anywhere(packets: list[bytes], chance: random.Random) -> None:
    stream = b"".join(packets)
    parser = Parser(stream=True)
    found = []
    while stream:
        n = chance.randint(1, len(stream))
        found += parser.feed(stream[:n])
        stream = stream[n:]
    assert found == packets
    assert parser.feed(b"") == []
    assert parser.malformed == 0


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(st.sampled_from(BLOCKS), st.binary(max_size=40)), max_size=8))
def test_garbage_in_a_stream_is_passed_over_as_pymavlink_does(pieces: list[bytes]) -> None:
    stream = b"".join(pieces)
    oracle = mavlink.MAVLink(None)
    oracle.robust_parsing = True
    read = oracle.parse_buffer(stream) or []
    known = [bytes(m.get_msgbuf()) for m in read if not m.get_type().startswith(("BAD_DATA", "UNKNOWN"))]
    found = Parser(stream=True).feed(stream)
    assert [one for one in found if not _unknown(one)] == known


def _unknown(one: bytes) -> bool:
    number = one[5] if one[0] == 0xFE else int.from_bytes(one[7:10], "little")
    return number not in mavlink.mavlink_map


def test_a_datagram_ends_its_last_packet() -> None:
    parser = Parser(stream=False)
    assert parser.feed(BLOCKS[0] + BLOCKS[1][:-1]) == [BLOCKS[0]]
    assert parser.malformed == 1
    assert parser.feed(BLOCKS[2]) == [BLOCKS[2]]
    assert parser.malformed == 1


def test_the_rest_of_a_stream_that_ends_is_malformed() -> None:
    parser = Parser(stream=True)
    assert parser.feed(BLOCKS[0][:-1]) == []
    assert parser.malformed == 0
    assert parser.feed(b"") == []
    assert parser.feed(BLOCKS[0]) == [BLOCKS[0]]  # of the next client
    assert parser.malformed == 1


def test_wrong_crc_and_unknown_flags_are_malformed() -> None:
    parser = Parser(stream=True)
    bad, flagged = bytearray(BLOCKS[0]), bytearray(BLOCKS[0])
    bad[-1] ^= 1
    flagged[2] = 2
    assert parser.feed(bytes(bad) + bytes(flagged) + BLOCKS[1]) == [BLOCKS[1]]
    assert parser.malformed == 2


# ---- routing ---------------------------------------------------------------------------------------------------------


class Air:
    """A radio with gateways; endpoints and gateways by name."""

    def __init__(self, *gateways: Gateway, nodes: tuple[Node, ...] = LINE.nodes, **network: Any) -> None:
        made = Network(nodes=nodes, gateways=gateways, topology="listed", **network)
        places: Any = SimpleNamespace(ports={"Real": SimpleNamespace(index={})})
        self.radio: Radio = grown(make_radio(made, places.ports["Real"].index, keep=True), 4096)
        self.names = [e.instance for node in nodes for e in node.endpoints] + [g.name for g in gateways]
        self.gateways = [g.name for g in gateways]
        self._buffer = np.zeros(1 << 16, np.uint8)

    def send(self, endpoint: str, packets: bytes, t: int = 0) -> None:
        buf = np.frombuffer(packets, np.uint8).copy()
        send(self.radio, np.zeros(0), t, self.names.index(endpoint), buf, len(packets))

    def admit(self, gateway: str, packets: bytes, t: int = 0) -> None:
        buf = np.frombuffer(packets, np.uint8)
        admit(self.radio, np.zeros(0), t, self.gateways.index(gateway), buf, len(packets))

    def deliver(self, endpoint: str, t: int = 0) -> bytes:
        return self._buffer[: deliver(self.radio, t, self.names.index(endpoint), self._buffer)].tobytes()

    def got(self, t: int = 0) -> dict[str, bytes]:
        return {name: block for name in self.names if (block := self.deliver(name, t))}

    def outcomes(self) -> dict[str, int]:
        return {name: int(self.radio.counters[i]) for i, name in enumerate(OUTCOMES) if self.radio.counters[i]}


GCS, D1, D2 = Gateway("@gcs"), Gateway("@d1", "d1.autopilot"), Gateway("@d2", "d2.autopilot")


def introduce(air: Air) -> None:
    """Every endpoint of the line says who it is."""
    for i in (1, 2, 3):
        air.send(f"d{i}.autopilot", packet(i))
        air.send(f"d{i}.agent", packet(i, component=191))
    air.got()
    air.radio.counters[:DELIVERED] = 0


def test_a_ground_station_hears_every_node_and_only_its_own_addressed_packets() -> None:
    air = Air(GCS)
    air.send("d1.autopilot", packet(1))
    air.send("d3.agent", packet(3, component=191))
    assert air.deliver("@gcs") == packet(1) + packet(3, component=191)
    air.send("d2.autopilot", packet(2, to=255))
    assert air.deliver("@gcs") == b""
    air.admit("@gcs", packet(255))
    air.send("d2.autopilot", packet(2, to=255))
    assert air.deliver("@gcs") == packet(2, to=255)


def test_a_ground_station_remembers_every_system_behind_it() -> None:
    air = Air(GCS)
    air.admit("@gcs", packet(255) + packet(254))
    for system in (254, 255):
        air.send("d1.autopilot", packet(1, to=system))
    assert air.deliver("@gcs") == packet(1, to=254) + packet(1, to=255)


def test_a_ground_station_reaches_all_by_broadcast_and_those_it_means_by_address() -> None:
    air = Air(GCS)
    introduce(air)
    air.admit("@gcs", packet(255))
    assert sorted(air.got()) == sorted(name for name in air.names if name != "@gcs")
    air.admit("@gcs", packet(255, to=2))
    assert air.got() == {"d2.autopilot": packet(255, to=2), "d2.agent": packet(255, to=2)}
    assert air.outcomes() == {"radio": 4}
    air.admit("@gcs", packet(255, to=77))
    assert air.got() == {}
    assert air.outcomes() == {"radio": 4, "lost: no route": 1}


def test_a_wired_port_hears_and_reaches_its_autopilot_alone() -> None:
    air = Air(D1, D2)
    introduce(air)
    air.send("d1.agent", packet(1, component=191))
    assert "@d1" not in air.got()
    air.send("d1.autopilot", packet(1))
    assert air.deliver("@d1") == packet(1)
    assert air.deliver("@d2") == b""
    air.got()
    air.admit("@d1", packet(255))
    air.admit("@d1", packet(255, to=1))
    air.admit("@d2", packet(255, to=0))
    assert air.got() == {"d1.autopilot": packet(255) + packet(255, to=1), "d2.autopilot": packet(255, to=0)}
    air.admit("@d1", packet(255, to=2))  # is at another port
    assert air.got() == {}
    assert air.outcomes()["lost: no route"] == 1


def test_a_wired_port_reaches_an_autopilot_that_has_not_spoken() -> None:
    air = Air(D1)
    air.admit("@d1", packet(255, to=1))
    assert air.got() == {"d1.autopilot": packet(255, to=1)}


def test_counts_by_radio_and_by_wire() -> None:
    air = Air(GCS, D1)
    air.send("d1.autopilot", packet(1))  # to the agent on board, the station by radio, the port by wire
    air.admit("@d1", packet(255))
    assert air.outcomes() == {"on board": 3, "radio": 1}
    air.got()
    assert air.radio.counters[DELIVERED] == 1
    assert air.radio.counters[IN_FLIGHT] == 0


def test_packets_that_wait_are_counted_at_the_gateway_they_came_by() -> None:
    air = Air(GCS, D1)
    introduce(air)
    air.admit("@gcs", packet(255, to=1))
    air.admit("@d1", packet(255))
    assert list(air.radio.gateways["waiting"]) == [2, 1]
    air.deliver("d1.agent")
    assert list(air.radio.gateways["waiting"]) == [1, 1]
    air.deliver("d1.autopilot")
    assert list(air.radio.gateways["waiting"]) == [0, 0]


def test_the_link_of_a_gateway_has_latency_both_ways() -> None:
    air = Air(Gateway("@gcs", latency=0.5), latency=7.0)
    air.send("d1.autopilot", packet(1))
    air.admit("@gcs", packet(255))
    assert air.deliver("@gcs", SECOND // 2 - 1) == b""
    assert air.deliver("d2.agent", SECOND // 2 - 1) == b""
    assert air.deliver("@gcs", SECOND // 2) == packet(1)
    assert air.deliver("d2.agent", SECOND // 2) == packet(255)


def test_the_link_of_a_gateway_loses_and_scatters_by_chance() -> None:
    air = Air(Gateway("@gcs", latency=1.0, jitter=1.0, loss=0.25))
    for _ in range(400):
        air.send("d1.autopilot", packet(1))
    events = air.radio.events[: air.radio.counters[USED_EVENTS]]
    events = events[events["target"] == 3]
    assert len(events) == 400
    lost = int((events["arrival"] < 0).sum())
    assert 60 < lost < 140  # 100 +- 4.6 standard deviations of 8.7
    arrivals = events["arrival"][events["arrival"] >= 0]
    assert SECOND <= arrivals.min() < 1.1 * SECOND < 1.9 * SECOND < arrivals.max() < 2 * SECOND


def test_an_outage_of_a_vehicle_silences_it_by_radio_but_not_at_its_port() -> None:
    air = Air(GCS, D1, outages=(("d1", 1.0, 2.0),))
    t = 3 * SECOND // 2
    air.send("d1.autopilot", packet(1), t)
    air.send("d2.autopilot", packet(2), t)
    assert air.deliver("@gcs", t) == packet(2)
    assert air.deliver("@d1", t) == packet(1)
    air.admit("@gcs", packet(255), t)
    air.admit("@d1", packet(254), t)
    assert packet(255) not in air.deliver("d1.autopilot", t)
    assert packet(255) in air.deliver("d2.autopilot", t)
    assert air.outcomes()["lost: outage"] == 2


def test_nobody_else_notices_a_gateway_that_listens() -> None:
    chance = random.Random(3)
    network: dict[str, Any] = {
        "loss": 0.3,
        "latency": 0.1,
        "jitter": 0.2,
        "links": frozenset({("d1", "d2"), ("d2", "d1"), ("d3", "d2")}),
    }
    alone, heard = Air(**network), Air(GCS, D1, D2, **network)
    for k in range(200):
        i, part = chance.choice((1, 2, 3)), chance.choice(("autopilot", "agent"))
        one = packet(i, to=chance.choice((None, 1, 2, 3)), sequence=k & 255)
        for air in (alone, heard):
            air.send(f"d{i}.{part}", one, k * SECOND // 100)
    both = []
    for air in (alone, heard):
        events = air.radio.events[: air.radio.counters[USED_EVENTS]]
        both.append((events[events["target"] < 3].tobytes(), {n: air.deliver(n, 9 * SECOND) for n in alone.names}))
    assert both[0] == both[1]
    assert len(both[0][0]) > 100 * EVENT.itemsize


def test_routing_to_gateways_stays_within_the_room_that_is_asked_for() -> None:
    air = Air(GCS, *(Gateway(f"@{i}", "d1.autopilot") for i in range(20)))
    before = int(air.radio.counters[IN_FLIGHT])
    air.send("d1.autopilot", packet(1))
    assert air.radio.counters[IN_FLIGHT] - before == 22 <= copies(air.radio)


def test_what_crosses_is_in_the_log_of_the_gateway() -> None:
    air = Air(GCS)
    air.send("d1.autopilot", packet(1), 5)
    air.deliver("@gcs", 7)
    air.admit("@gcs", packet(255), 9)
    log = air.radio.log[: air.radio.counters[USED_LOG]].tobytes()
    gateway = 3
    head = (7).to_bytes(8, "little") + (2 * gateway).to_bytes(4, "little")
    assert head + len(packet(1)).to_bytes(4, "little") + packet(1) in log
    head = (9).to_bytes(8, "little") + (2 * gateway + 1).to_bytes(4, "little")
    assert head + len(packet(255)).to_bytes(4, "little") + packet(255) in log


# ---- sockets ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def opened() -> Iterator[Callable[..., tuple[Socket, list[str]]]]:
    """Opens sockets on loopback that are closed in the end: (socket, what has been reported)."""
    made: list[Socket] = []

    def open_one(kind: str, port: int = 0) -> tuple[Socket, list[str]]:
        told: list[str] = []
        made.append(open_socket(kind, "127.0.0.1", port, told.append))
        made[-1].start()
        return made[-1], told

    yield open_one
    for one in made:
        one.close()


def until(condition: Callable[[], Any], seconds: float = 60.0) -> Any:
    """What `condition` says once it is true; loopback is fast but not instant."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.001)
    raise AssertionError("it has not become true")


def collect(one: Socket, n: int) -> bytes:
    block = b""

    def enough() -> bool:
        nonlocal block
        block += b"".join(one.receive())
        return len(block) >= n

    until(enough)
    return block


def test_a_tcp_server_serves_one_client_after_the_other(opened: Any) -> None:
    server, told = opened("tcp")
    assert told.pop() == f"listens on 127.0.0.1:{server.port}"
    assert server.send([b"nobody"]) == 0
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.sendall(b"one")
        assert collect(server, 3) == b"one"
        assert re.fullmatch(r"client 127\.0\.0\.1:\d+ has connected", told.pop())
        assert server.send([b"two", b"three"]) == 2
        assert until(lambda: client.recv(8, socket.MSG_PEEK) == b"twothree" and client.recv(8)) == b"twothree"
        with socket.create_connection(("127.0.0.1", server.port)) as second:
            until(lambda: server.receive() == [] and told)
            assert "is turned away: 127.0.0.1:" in told.pop()
            assert second.recv(1) == b""
        client.sendall(b"last")
    assert until(lambda: server.receive()) in ([b"last", b""], [b"last"])
    until(lambda: server.receive() is not None and told)
    assert re.fullmatch(r"client 127\.0\.0\.1:\d+ has disconnected", told.pop())
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.sendall(b"again")
        assert collect(server, 5) == b"again"


def test_a_tcp_client_that_breaks_off_is_reported(opened: Any) -> None:
    server, told = opened("tcp")
    client = socket.create_connection(("127.0.0.1", server.port))
    until(lambda: server.receive() == [] and len(told) == 2)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # close sends RST
    client.close()
    until(lambda: server.receive() is not None and len(told) == 3)
    assert "is gone: " in told[-1]


def test_what_a_client_does_not_read_is_kept_up_to_a_bound_and_then_refused(opened: Any) -> None:
    server, told = opened("tcp")
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        until(lambda: server.receive() == [] and len(told) == 2)
        sent = [bytes([i % 256]) * 4096 for i in range(4000)]
        taken = [one for one in sent if server.send([one])]
        assert 256 <= len(taken) < len(sent)
        read = bytearray()
        client.settimeout(60)
        while len(read) < len(taken) * 4096:
            read += client.recv(1 << 20)
            server.send([])
        assert bytes(read) == b"".join(taken)


def test_a_server_refuses_before_it_starts_and_gives_the_rest_when_it_closes() -> None:
    told: list[str] = []
    server = TcpServer("127.0.0.1", 0, told.append)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", server.port))
    server.start()
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        until(lambda: server.receive() == [] and len(told) == 2)
        server.send([b"rest"])
        server.close()
        assert client.recv(10) == b"rest"
        assert client.recv(10) == b""
    assert told[-1].endswith("is hung up on: the run is over")


def test_udpin_answers_whoever_it_has_heard(opened: Any) -> None:
    inward, told = opened("udpin")
    assert inward.send([b"nobody"]) == 0
    clients = [Udp("127.0.0.1", inward.port, lambda _: None, outward=True) for _ in range(2)]
    for i, client in enumerate(clients):
        client.send([bytes([i])])
    assert sorted(collect(inward, 2)) == [0, 1]
    assert sum(line.endswith("is heard") for line in told) == 2
    assert inward.send([b"all"]) == 1
    for client in clients:
        assert until(client.receive) == [b"all"]
        client.close()


def test_udp_keeps_the_borders_of_datagrams(opened: Any) -> None:
    inward, _ = opened("udpin")
    outward, told = opened("udpout", inward.port)
    assert told == [f"sends to 127.0.0.1:{inward.port}"]
    outward.send([b"a", b"bc"])
    pieces = until(inward.receive)
    while len(pieces) < 2:
        pieces += inward.receive()
    assert pieces == [b"a", b"bc"]


def test_udpout_to_nobody_is_reported_once_and_goes_on(opened: Any) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    outward, told = opened("udpout", port)
    for _ in range(50):
        outward.send([b"x"])
        outward.receive()
    assert [line for line in told if "cannot be reached" in line] == [
        f"127.0.0.1:{port} cannot be reached: Connection refused"
    ]
    there, _ = opened("udpin", port)
    until(lambda: outward.send([b"y"]) and there.receive())
    there.send([b"z"])
    assert until(outward.receive) == [b"z"]
    assert told[-1].endswith("is heard")


def test_an_address_in_use_is_an_error_that_names_it(opened: Any) -> None:
    server, _ = opened("tcp")
    asked = [(Gateway("@gcs"), Address("tcp", "127.0.0.1", server.port))]
    asked.append((Gateway("@d1", "d1.autopilot"), Address("udpout", "no host of this name.invalid", 1)))
    report: Report = print
    with pytest.raises(SystemDescriptionError) as caught:
        Gateways(asked, report)
    first, second = map(str, caught.value.problems)
    assert first == f"--gcs: tcp:127.0.0.1:{server.port} cannot be opened: Address already in use"
    assert second.startswith("--ports: udpout:no host of this name.invalid:1 cannot be opened: ")


# ---- a gateway in a run ----------------------------------------------------------------------------------------------


class Loop:
    """The part of an execution that gateways use: a list of packets each way."""

    def __init__(self) -> None:
        self.network = LINE
        self.admitted: list[bytes] = []
        self.leaving = b""
        self.behind = 0

    def admit(self, gateway: int, packets: list[bytes]) -> None:
        self.admitted += packets

    def take(self, gateway: int) -> bytes:
        block, self.leaving = self.leaving, b""
        return block

    def waiting(self, gateway: int) -> int:
        return self.behind


@pytest.fixture
def crossing(tmp_path: Path) -> Iterator[Any]:
    """Opens a UDP gateway and a peer of it: (gateways, loop, peer)."""
    made: list[Any] = []

    def open_one(key: bytes | None = None) -> tuple[Gateways, Any, Udp]:
        peer = Udp("127.0.0.1", 0, lambda _: None, outward=False)
        gateways = Gateways([(Gateway("@gcs"), Address("udpout", "127.0.0.1", peer.port, key))], lambda _: None)
        loop: Any = Loop()
        loop.leaving = packet(1) if key is None else b""
        gateways.exchange(loop)
        if key is None:
            assert until(peer.receive) == [packet(1)]  # now the peer knows it
        made.extend((peer, gateways))
        return gateways, loop, peer

    yield open_one
    for one in made:
        one.close()


def test_exchange_moves_packets_both_ways_and_counts_what_is_none(crossing: Any) -> None:
    gateways, loop, peer = crossing()
    bad = bytearray(packet(255))
    bad[-1] ^= 255
    peer.send([packet(255) + packet(254), bytes(bad), b"garbage"])
    until(lambda: gateways.exchange(loop) or gateways.counts()["@gcs"].get("malformed") == 2)
    assert loop.admitted == [packet(255), packet(254)]
    counts = gateways.counts()["@gcs"]
    assert counts.pop("address").startswith("udpout:127.0.0.1:")
    assert counts == {"received": 2, "sent": 1, "malformed": 2, "connections": 1}


def test_nothing_is_read_while_vehicles_have_too_much_to_read(crossing: Any) -> None:
    gateways, loop, peer = crossing()
    loop.behind = 10_000
    peer.send([packet(255)])
    for _ in range(20):
        gateways.exchange(loop)
        time.sleep(0.001)
    assert loop.admitted == []
    loop.behind = 0
    until(lambda: gateways.exchange(loop) or loop.admitted)
    assert loop.admitted == [packet(255)]
    assert gateways.counts()["@gcs"]["held back"] == 20


# ---- messages of one's own -------------------------------------------------------------------------------------------

OWN = Message(
    "SWARM_BID",
    42101,
    77,
    (
        Field("price", "float", 0, 0, "", False),
        Field("target_system", "uint8_t", 0, 4, "", False),
    ),
)


def own_packet(to: int, crc_extra: int = 77) -> bytes:
    """A SWARM_BID of system 1."""
    body = bytes((5, 0, 0, 0, 1, 1)) + (42101).to_bytes(3, "little") + b"\0\0\x80\x3f" + bytes([to])
    return b"\xfd" + body + int(mavlink.x25crc(body + bytes([crc_extra])).crc).to_bytes(2, "little")


def test_messages_of_the_systems_dialect_are_checked_and_routed_as_any_others() -> None:
    air = Air(GCS, dialect=(OWN,), links=frozenset({("d1", "d2"), ("d1", "d3")}))
    introduce(air)
    air.send("d1.autopilot", own_packet(2))
    assert sorted(air.got()) == ["d2.agent", "d2.autopilot"]
    air.send("d1.autopilot", own_packet(0, crc_extra=78))
    assert air.got() == {}
    assert air.outcomes()["malformed"] == 1
    air.admit("@gcs", own_packet(3))
    assert sorted(air.got()) == ["d3.agent", "d3.autopilot"]


def test_without_the_dialect_they_are_for_everybody() -> None:
    air = Air(GCS, links=frozenset({("d1", "d2"), ("d1", "d3")}))
    introduce(air)
    air.send("d1.autopilot", own_packet(2))
    assert sorted(air.got()) == ["@gcs", "d1.agent", "d2.agent", "d2.autopilot", "d3.agent", "d3.autopilot"]


def test_a_gateway_checks_them_too() -> None:
    good, bad = own_packet(2), own_packet(2, crc_extra=78)
    knowing, ignorant = Parser(True, (OWN,)), Parser(True)
    assert (knowing.feed(bad + good), knowing.malformed) == ([good], 1)
    assert (ignorant.feed(bad + good), ignorant.malformed) == ([bad, good], 0)
