"""Lines: packet ports of an instance that gateways alone use, so that what a ground station asks for stays off the
swarm's radio; from the ports of an FMU to the calls of the loop."""

from __future__ import annotations

import base64
import ctypes
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cosim.verdict import Role
from cosim_master.network.gateways.gateways import gateways_of
from cosim_master.network.radio.queues import deliver
from cosim_master.network.radio.router import admit
from cosim_master.stepping.kernels.tables import DONE, FAILED, NOT_BASE64
from cosim_master.system.settings.network import Gateway, Network, network_of, with_gateways
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from tests.master.fmus.scripted import Scripted, system_of, variable
from tests.master.network.test_gateways import Air, packet
from tests.master.stepping.test_macro_step import Loop

RX = {line: variable(f"{line}_rx", "input", "String", 10 + i, capacity=2048) for i, line in enumerate("mts")}
TX = {line: variable(f"{line}_tx", "output", "String", 20 + i, capacity=2048) for i, line in enumerate("mts")}


def ends(node: str) -> tuple[Endpoint, Endpoint, Endpoint]:
    """All endpoints of the autopilot of a node."""
    return (
        Endpoint(f"{node}.autopilot", RX["m"], TX["m"]),
        Endpoint(f"{node}.autopilot", RX["t"], TX["t"], "telemetry"),
        Endpoint(f"{node}.autopilot", RX["s"], TX["s"], "serial"),
    )


def vehicle(node: str) -> Node:
    """An autopilot with lines, and an agent without."""
    main, *lines = ends(node)
    return Node(node, (main, Endpoint(f"{node}.agent", RX["m"], TX["m"])), lines=tuple(lines))


PAIR = Network(nodes=(vehicle("d1"), vehicle("d2")))
GCS, D1, D2 = Gateway("@gcs"), Gateway("@d1", "d1.autopilot.serial"), Gateway("@d2", "d2.autopilot.serial")


# ---- from the ports of FMUs ------------------------------------------------------------------------------------------


def packets(name: str, reference: int) -> Any:
    return variable(name, "input" if name.endswith("rx") else "output", "String", reference, capacity=2048)


def network(*names: str) -> Network:
    """The network of one instance with these packet ports."""
    one = Scripted("d1.autopilot", [packets(name, i) for i, name in enumerate(names)], lambda *_: 0, {}, [])
    return network_of(system_of([one]))


def test_an_instance_may_have_lines_besides_its_ports() -> None:
    names = [f"{line}_{end}" for line in ("serial", "mavlink", "telemetry") for end in ("rx", "tx")]
    (node,) = network(*names).nodes
    assert [(e.name, e.rx.name, e.tx.name) for e in node.endpoints if e.rx and e.tx] == [
        ("d1.autopilot", "mavlink_rx", "mavlink_tx")
    ]
    assert [(e.name, e.rx.name, e.tx.name) for e in node.lines if e.rx and e.tx] == [
        ("d1.autopilot.telemetry", "telemetry_rx", "telemetry_tx"),
        ("d1.autopilot.serial", "serial_rx", "serial_tx"),
    ]


def test_lines_are_declared_whatever_their_names_are() -> None:
    ports = ("mavlink_rx", "mavlink_tx", "sky_rx", "sky_tx", "uart_rx", "uart_tx")
    one = Scripted("d1.copter", [packets(name, i) for i, name in enumerate(ports)], lambda *_: 0, {}, [])
    roles = dict.fromkeys(ports[2:4], Role.TELEMETRY) | dict.fromkeys(ports[4:], Role.SERIAL)
    one.instance = replace(one.instance, fmu=replace(one.instance.fmu, verdicts=roles))
    (node,) = network_of(system_of([one])).nodes
    assert [(e.name, e.rx.name, e.tx.name) for e in node.endpoints if e.rx and e.tx] == [
        ("d1.copter", "mavlink_rx", "mavlink_tx")
    ]
    assert [(e.name, e.rx.name, e.tx.name) for e in node.lines if e.rx and e.tx] == [
        ("d1.copter.telemetry", "sky_rx", "sky_tx"),
        ("d1.copter.serial", "uart_rx", "uart_tx"),
    ]


def test_ports_lead_to_what_declares_to_be_an_autopilot() -> None:
    """Whatever it is called; a component called autopilot that declares nothing is one where no other does."""
    ports = [packets(name, i) for i, name in enumerate(("mavlink_rx", "mavlink_tx"))]
    names = ("d1.copter", "d1.agent", "d2.autopilot", "d3.left", "d3.right")
    made = {
        name: Scripted(name, [*ports, variable("armed", "output", "Boolean", 5)], lambda *_: 0, {}, [])
        for name in names
    }
    for name in ("d1.copter", "d3.left", "d3.right"):
        one = made[name]
        one.instance = replace(one.instance, fmu=replace(one.instance.fmu, verdicts={"armed": Role.ARMED}))
    gateways = gateways_of(network_of(system_of(list(made.values()))), (), "tcp:5760+10")
    assert [(gateway.name, gateway.wired) for gateway, _ in gateways] == [
        ("@d1", "d1.copter"),
        ("@d2", "d2.autopilot"),
        ("@d3.left", "d3.left"),
        ("@d3.right", "d3.right"),
    ]


def test_a_line_alone_is_what_leads_to_the_swarm() -> None:
    (node,) = network("serial_rx", "serial_tx").nodes
    assert [e.name for e in node.endpoints] == ["d1.autopilot"]
    assert node.lines == ()


@pytest.mark.parametrize("names", [("serial_rx",), ("radio2_rx", "radio2_tx")])
def test_other_second_ports_are_refused_as_ever(names: tuple[str, ...]) -> None:
    with pytest.raises(Exception, match="has several packet inputs for the radio"):
        network("mavlink_rx", "mavlink_tx", *names)


# ---- which of them take part -----------------------------------------------------------------------------------------


def names(gateways: list[Gateway]) -> list[str]:
    return [e.name for node in with_gateways(PAIR, gateways).nodes for e in node.endpoints]


def test_without_gateways_there_are_no_lines() -> None:
    assert with_gateways(PAIR, []) == PAIR


def test_ground_stations_use_telemetry_and_ports_use_serial() -> None:
    air, wired = "d{}.autopilot.telemetry", "d{}.autopilot.serial"
    plain = ["d{}.autopilot", "d{}.agent"]
    assert names([GCS]) == [name.format(i) for i in (1, 2) for name in (plain[0], air, plain[1])]
    assert names([D1, D2]) == [name.format(i) for i in (1, 2) for name in (plain[0], wired, plain[1])]
    assert names([D1]) == ["d1.autopilot", wired.format(1), "d1.agent", "d2.autopilot", "d2.agent"]


def test_ports_are_wired_to_the_serial_line_where_there_is_one() -> None:
    mixed = Network(nodes=(vehicle("d1"), Node("d2", (ends("d2")[0],))))
    made = gateways_of(mixed, (), "tcp:5760+10")
    assert [(gateway.name, gateway.wired) for gateway, _ in made] == [
        ("@d1", "d1.autopilot.serial"),
        ("@d2", "d2.autopilot"),
    ]


# ---- routing ---------------------------------------------------------------------------------------------------------


def air(*gateways: Gateway) -> Air:
    made = with_gateways(PAIR, gateways)
    found = Air(*gateways, nodes=made.nodes, links=frozenset({("d1", "d2"), ("d2", "d1")}))
    found.names = [e.name for node in made.nodes for e in node.endpoints] + [g.name for g in gateways]
    return found


def test_what_goes_by_a_line_is_heard_by_its_gateway_alone() -> None:
    medium = air(GCS, D1, D2)
    medium.send("d1.autopilot.telemetry", packet(1))
    assert medium.got() == {"@gcs": packet(1)}
    medium.send("d1.autopilot.serial", packet(1))
    assert medium.got() == {"@d1": packet(1)}


def test_what_goes_to_the_swarm_is_not_heard_by_gateways() -> None:
    medium = air(GCS, D1, D2)
    medium.send("d1.autopilot", packet(1))
    assert medium.got() == dict.fromkeys(("d1.agent", "d2.autopilot", "d2.agent"), packet(1))
    medium.send("d1.agent", packet(1, component=191))  # has no lines: ground stations hear it as ever
    assert sorted(medium.got()) == ["@gcs", "d1.autopilot", "d2.agent", "d2.autopilot"]


def test_what_a_gateway_sends_comes_by_its_line_alone() -> None:
    medium = air(GCS, D1, D2)
    medium.admit("@gcs", packet(255))
    assert sorted(medium.got()) == ["d1.agent", "d1.autopilot.telemetry", "d2.agent", "d2.autopilot.telemetry"]
    medium.admit("@d2", packet(254))
    assert medium.got() == {"d2.autopilot.serial": packet(254)}


def test_addressed_packets_come_and_go_by_the_lines() -> None:
    medium = air(GCS, D1)
    for i in (1, 2):
        for end in ("autopilot", "autopilot.telemetry", "agent"):
            medium.send(f"d{i}.{end}", packet(i))
    medium.admit("@gcs", packet(255))
    medium.got()
    medium.admit("@gcs", packet(255, to=2))
    assert sorted(medium.got()) == ["d2.agent", "d2.autopilot.telemetry"]
    medium.send("d2.autopilot.telemetry", packet(2, to=255))
    assert medium.got() == {"@gcs": packet(2, to=255)}
    medium.send("d2.autopilot", packet(2, to=255))  # by the swarm's radio nobody of that name is reached
    assert medium.got() == {}
    medium.admit("@d1", packet(254, to=1))  # by a cable to who has not spoken there
    assert medium.got() == {"d1.autopilot.serial": packet(254, to=1)}


# ---- in the loop -----------------------------------------------------------------------------------------------------


class Speaker(Scripted):
    """Says in every step by each of its ports which it is. What it returns lasts until its next function is called."""

    def __init__(self, log: list[str]) -> None:
        self.heard: list[tuple[float, str, bytes]] = []
        self.garbled = False
        values = {v.name: "" for v in (*RX.values(), *TX.values())}
        super().__init__("d1.autopilot", [*RX.values(), *TX.values()], Speaker.step, values, log, 0.01)
        self._text = ctypes.create_string_buffer(100)
        types = (ctypes.c_void_p, ctypes.POINTER(ctypes.c_uint), ctypes.c_size_t, ctypes.POINTER(ctypes.c_char_p))
        self._define("fmi2GetString", self.get, *types)

    def step(self, t: float, h: float) -> None:
        for i, line in enumerate("mts"):
            self.values[f"{line}_tx"] = base64.b64encode(packet(1, sequence=i)).decode()
            if self.garbled and line == "t":
                self.values["t_tx"] = "no base64!"
            if self.values[f"{line}_rx"]:
                self.heard.append((round(t, 6), line, base64.b64decode(self.values[f"{line}_rx"])))

    def get(self, _: int, references: Any, n: int, out: Any) -> int:
        assert n == 1
        name = {v.value_reference: v.name for v in TX.values()}[references[0]]
        self._text.value = self.values[name].encode()
        out[0] = ctypes.cast(self._text, ctypes.c_char_p)
        ctypes.cast(out, ctypes.POINTER(ctypes.c_void_p))[0] = ctypes.addressof(self._text)
        self.log.append(f"get {name}")
        return 0


def running(*gateways: Gateway) -> tuple[Speaker, list[str], Loop]:
    log: list[str] = []
    one = Speaker(log)
    main, *lines = ends("d1")
    loop = Loop([one], [], 1.0, with_gateways(Network(nodes=(Node("d1", (main,), lines=tuple(lines)),)), gateways))
    log.clear()
    return one, log, loop


def test_the_loop_sets_and_gets_the_lines_in_use_and_no_others() -> None:
    _, log, loop = running(D1)
    assert loop.to(1) == DONE
    assert log == ["d1.autopilot: doStep 0 + 0.01", "get m_tx", "get s_tx"]
    _, log, loop = running()
    assert loop.to(1) == DONE
    assert log == ["d1.autopilot: doStep 0 + 0.01", "get m_tx"]


def test_packets_cross_by_every_line_in_use() -> None:
    one, _, loop = running(GCS, D1)
    loop.to(2)
    for g, block in enumerate((packet(255), packet(254))):
        admit(loop.radio, np.zeros(0), 20_000_000, g, np.frombuffer(block, np.uint8), len(block))
    loop.to(5)
    assert one.heard == [(0.02, "t", packet(255)), (0.02, "s", packet(254))]
    assert one.values["t_rx"] == one.values["s_rx"] == ""
    buffer = np.zeros(4096, np.uint8)
    crossed = [buffer[: deliver(loop.radio, 50_000_000, e, buffer)].tobytes() for e in (3, 4)]
    assert crossed == [5 * packet(1, sequence=1), 5 * packet(1, sequence=2)]


def test_a_line_that_gives_no_packets_is_a_failure() -> None:
    one, _, loop = running(GCS)
    one.garbled = True
    assert loop.to(1) == FAILED
    assert list(loop.plan.instances[0]["failed"][1:]) == [NOT_BASE64, 0]
