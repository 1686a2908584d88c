"""The macro step, literally: what is called, in which order, with which values."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.tables import FREE_PLACES, IN_FLIGHT
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.instances import collect_all
from cosim_master.stepping.kernels.macro_step import places_needed, run
from cosim_master.stepping.kernels.tables import DONE, FAILED, NEED_PLACES, NOT_A_NUMBER, K
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.plan import make_plan
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.system.settings.time_grid import time_grid
from tests.master.fmus.scripted import Scripted, system_of, variable

U, Y = variable("u", "input", reference=0), variable("y", "output", reference=1)


class Loop:
    """A plan over scripted instances, ready to step; what initialization would do has been done."""

    def __init__(
        self,
        instances: list[Scripted],
        links: list[Any],
        until: float,
        network: Network | None = None,
        observed: Sequence[tuple[str, str]] = (),
    ) -> None:
        by_name = sorted(instances, key=lambda one: one.name)
        self.slaves = by_name  # the plan has nothing but their addresses
        checked = system_of(instances, links)
        self.network = network or Network()
        self.layout = make_layout(checked, self.network, observed=observed)
        self.plan = make_plan(self.layout, time_grid(checked, until), self.network, by_name, 1)  # type: ignore[arg-type]
        self.radio = make_radio(self.network, self.layout.ports["Real"].index, keep=True)
        collect_all(self.plan)
        assert run(self.plan, self.radio, NO_FRAMES, 0) == DONE

    def to(self, k: int) -> int:
        return int(run(self.plan, self.radio, NO_FRAMES, k))


def adder(name: str, log: list[str], start: float, size: float = 1.0, **more: Any) -> Scripted:
    """y := y + u at every step."""

    def step(self: Scripted, t: float, h: float) -> None:
        self.values["y"] += self.values["u"]

    return Scripted(name, [U, Y], step, {"u": 0.0, "y": start}, log, size, **more)


def test_values_that_never_change_are_fetched_once() -> None:
    """An observer needs a fixed parameter and an output; only the output is asked for again."""
    log: list[str] = []
    fixed = replace(variable("size", "parameter", reference=0), variability="fixed", initial="exact")

    def step(self: Scripted, t: float, h: float) -> None:
        self.values["y"] += 1.0

    one = Scripted("a", [fixed, Y], step, {"size": 4.0, "y": 1.0}, log, 1.0)
    loop = Loop([one], [], until=2.0, observed=[("a", "size"), ("a", "y")])
    assert log == ["a: get size", "a: get y"]
    log.clear()
    assert loop.to(2) == DONE
    assert log == ["a: doStep 0 + 1", "a: get y", "a: doStep 1 + 1", "a: get y"]
    index = loop.layout.ports["Real"].index
    assert {name: loop.plan.real_out[at] for (_, name), at in index.items()} == {"size": 4.0, "y": 3.0}


def test_one_macro_step_of_two_instances() -> None:
    log: list[str] = []
    loop = Loop([adder("a", log, 1.0), adder("b", log, 10.0)], [("b.y", "a.u"), ("a.y", "b.u")], until=2.0)
    log.clear()
    assert loop.to(1) == DONE
    assert log == [
        "a: set u = 10.0",
        "a: doStep 0 + 1",
        "a: get y",
        "b: set u = 1.0",  # the output of a at t = 0, though a has stepped already: Jacobi
        "b: doStep 0 + 1",
        "b: get y",
    ]
    log.clear()
    loop.to(2)
    assert log == [
        "a: set u = 11.0",
        "a: doStep 1 + 1",
        "a: get y",
        "b: set u = 11.0",
        "b: doStep 1 + 1",
        "b: get y",
    ]


def test_a_chain_of_feed_throughs_delays_by_one_step_a_hop() -> None:
    """The coupling of pure Jacobi masters: the value of the last of N is that of step K - N."""

    def source(self: Scripted, t: float, h: float) -> None:
        self.values["y"] = t + h

    def through(self: Scripted, t: float, h: float) -> None:
        self.values["y"] = self.values["u"]

    log: list[str] = []
    first = Scripted("a", [Y], source, {"y": 0.0}, log)
    rest = [Scripted(name, [U, Y], through, {"u": 0.0, "y": 0.0}, log) for name in "bcd"]
    links = [("a.y", "b.u"), ("b.y", "c.u"), ("c.y", "d.u")]
    loop = Loop([first, *rest], links, until=10.0)
    loop.to(10)
    assert [one.values["y"] for one in (first, *rest)] == [10.0, 9.0, 8.0, 7.0]


def test_factor_and_offset_and_types() -> None:
    log: list[str] = []
    outputs = [
        variable("r", "output", "Real", 0),
        variable("i", "output", "Integer", 1),
        variable("b", "output", "Boolean", 2),
    ]
    inputs = [
        variable("x", "input", "Real", 0),
        variable("n", "input", "Real", 1),
        variable("k", "input", "Integer", 2),
        variable("flag", "input", "Boolean", 3),
    ]
    source = Scripted("s", outputs, lambda *_: None, {"r": 2.5, "i": 7, "b": 1}, log)
    sink = Scripted("t", inputs, lambda *_: None, {}, log)
    links = [("s.r", "t.x", 2.0, 1.0), ("s.i", "t.n", 10.0, 0.5), ("s.i", "t.k"), ("s.b", "t.flag")]
    Loop([source, sink], links, until=1.0).to(1)
    assert sink.values == {"x": 6.0, "n": 70.5, "k": 7, "flag": 1}


def test_different_rates_meet_at_their_common_points() -> None:
    """A slow instance takes its inputs at the start of its step; its outputs are seen at the end of it, not before."""
    log: list[str] = []
    fast = adder("fast", log, 1.0, size=1.0)
    slow = adder("slow", log, 100.0, size=3.0)
    loop = Loop([fast, slow], [("slow.y", "fast.u"), ("fast.y", "slow.u")], until=6.0)
    log.clear()
    loop.to(4)
    assert log == [
        "fast: set u = 100.0",
        "fast: doStep 0 + 1",
        "fast: get y",
        "slow: set u = 1.0",
        "slow: doStep 0 + 3",
        "fast: set u = 100.0",
        "fast: doStep 1 + 1",
        "fast: get y",
        "fast: set u = 100.0",
        "fast: doStep 2 + 1",
        "fast: get y",
        "slow: get y",  # 101 is the value at t = 3
        "fast: set u = 101.0",
        "fast: doStep 3 + 1",
        "fast: get y",
        "slow: set u = 301.0",
        "slow: doStep 3 + 3",
    ]


def test_the_last_step_of_a_slow_instance_ends_with_the_run() -> None:
    log: list[str] = []
    loop = Loop([adder("fast", log, 0.0), adder("slow", log, 5.0, size=3.0)], [], until=5.0)
    loop.to(5)
    assert [line for line in log if line.startswith("slow: doStep")] == ["slow: doStep 0 + 3", "slow: doStep 3 + 2"]
    assert log[-1] == "slow: get y"


def test_an_instance_with_a_fixed_step_is_not_made_to_take_a_shorter_one() -> None:
    log: list[str] = []
    checked = system_of([adder("fast", log, 0.0), adder("slow", log, 5.0, size=3.0, variable_step=False)])
    with pytest.raises(SystemDescriptionError, match=r"slow steps by 3 s only .* a run of 5 s is not a multiple of it"):
        time_grid(checked, 5.0)


def test_time_is_computed_not_accumulated() -> None:
    times: list[float] = []
    log: list[str] = []

    def step(self: Scripted, t: float, h: float) -> None:
        times.append(t)

    Loop([Scripted("a", [Y], step, {"y": 0.0}, log, 0.1)], [], until=100.0).to(1000)
    assert times == [k / 10 for k in range(1000)]


def test_if_one_fails_the_others_finish_and_all_failures_are_known() -> None:
    log: list[str] = []

    def failing(self: Scripted, t: float, h: float) -> int:
        return 3 if t >= 1.0 else 0

    bad = [Scripted(name, [Y], failing, {"y": 0.0}, log) for name in ("a", "c")]
    loop = Loop([*bad, adder("b", log, 0.0)], [], until=3.0)
    log.clear()
    assert loop.to(3) == FAILED
    assert log[-4:] == ["a: doStep 1 + 1", "b: doStep 1 + 1", "b: get y", "c: doStep 1 + 1"]
    assert loop.plan.counters[K] == 1
    failed = loop.plan.instances["failed"]
    assert [tuple(row[:2]) for row in failed.tolist()] == [(5, 3), (0, 0), (5, 3)]  # fmi2DoStep, fmi2Error


@pytest.mark.parametrize("status", [0, 1])
def test_a_warning_is_a_success(status: int) -> None:
    log: list[str] = []
    loop = Loop([Scripted("a", [Y], lambda *_: status, {"y": 0.0}, log)], [], until=1.0)
    assert loop.to(1) == DONE


def test_an_output_that_is_no_number_is_a_failure_that_names_it() -> None:
    log: list[str] = []

    def step(self: Scripted, t: float, h: float) -> None:
        self.values["z"] = math.nan

    z = variable("z", "output", reference=2)
    loop = Loop([Scripted("a", [Y, z], step, {"y": 0.0, "z": 0.0}, log)], [], until=1.0)
    assert loop.to(1) == FAILED
    function, status, index = loop.plan.instances["failed"][0].tolist()
    assert (function, status) == (6, NOT_A_NUMBER)
    assert loop.layout.ports["Real"].outputs[index][1].name == "z"


# ---- packets ------------------------------------------------------------------------------------------------------

RX = variable("mavlink_rx", "input", "String", 8, capacity=64)
TX = variable("mavlink_tx", "output", "String", 9, capacity=64)


def heartbeat(system: int, sequence: int) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    link.seq = sequence
    return bytes(link.heartbeat_encode(2, 3, 0, 0, 3).pack(link))


def radio_pair(
    log: list[str], sends: dict[float, bytes], latency: float
) -> tuple[Scripted, list[tuple[float, bytes]], Loop]:
    """A sender and a receiver on two nodes. The sender's packets by the start time of the step that sends them."""
    heard: list[tuple[float, bytes]] = []

    def send(self: Scripted, t: float, h: float) -> None:
        self.values["mavlink_tx"] = base64.b64encode(sends.get(round(t, 6), b"")).decode()

    def listen(self: Scripted, t: float, h: float) -> None:
        if self.values["mavlink_rx"]:
            heard.append((round(t, 6), base64.b64decode(self.values["mavlink_rx"])))

    a = Scripted("a", [TX], send, {"mavlink_tx": ""}, log, 0.01)
    b = Scripted("b", [RX], listen, {"mavlink_rx": ""}, log, 0.01)
    nodes = (Node("a", (Endpoint("a", None, TX),)), Node("b", (Endpoint("b", RX, None),)))
    return b, heard, Loop([a, b], [], until=1.0, network=Network(nodes=nodes, latency=latency))


@pytest.mark.parametrize(
    ("latency", "delivered"),
    [(0.0, 0.31), (0.01, 0.32), (0.005, 0.32), (0.1, 0.41)],
    ids=["none", "one step", "half a step", "ten steps"],
)
def test_the_delay_of_a_packet(latency: float, delivered: float) -> None:
    """A packet of the step from 0.30 s is sent at its end, 0.31 s, and read by the first step at or after arrival."""
    packet = heartbeat(1, 0)
    _, heard, loop = radio_pair([], {0.3: packet}, latency)
    assert loop.to(100) == DONE
    assert heard == [(delivered, packet)]


def test_received_packets_do_not_pass_through_the_memory_of_sent_ones() -> None:
    """They did: the receiver's row of `tx` was where they became base64."""
    packet = heartbeat(1, 0)
    _, heard, loop = radio_pair([], {0.1: packet}, 0.0)
    loop.to(100)
    assert heard == [(0.11, packet)]
    assert loop.plan.tx[1].max() == 0
    assert loop.plan.received[0, : len(packet)].tobytes() == packet


def test_packets_of_one_step_arrive_together_and_in_order() -> None:
    packets = heartbeat(1, 0) + heartbeat(1, 1) + heartbeat(1, 2)
    _, heard, loop = radio_pair([], {0.1: packets}, 0.02)
    loop.to(100)
    assert heard == [(0.13, packets)]


def test_what_does_not_fit_into_a_port_waits_for_the_next_step() -> None:
    three = heartbeat(1, 0) + heartbeat(1, 1) + heartbeat(1, 2)
    assert len(three) == 63
    more = heartbeat(1, 3)
    _, heard, loop = radio_pair([], {0.1: three, 0.11: more}, 0.0)
    loop.radio.endpoints[1]["capacity"] = 50
    loop.to(100)
    assert heard == [(0.11, three[:42]), (0.12, three[42:] + more)]


def test_an_input_port_is_emptied_when_nothing_more_comes() -> None:
    receiver, heard, loop = radio_pair([], {0.1: heartbeat(1, 0)}, 0.0)
    loop.to(100)
    assert len(heard) == 1
    assert receiver.values["mavlink_rx"] == ""


@pytest.mark.parametrize("text", ["no base64!", "A" * 200])
def test_a_port_that_gives_no_packets_is_a_failure(text: str) -> None:
    log: list[str] = []
    a = Scripted("a", [TX], lambda self, t, h: self.values.update(mavlink_tx=text), {"mavlink_tx": ""}, log)
    network = Network(nodes=(Node("a", (Endpoint("a", None, TX),)),))
    assert Loop([a], [], until=1.0, network=network).to(1) == FAILED


def test_places_in_flight_grow_and_come_back() -> None:
    sends = {round(0.01 * k, 6): heartbeat(1, k) for k in range(90)}
    _, heard, loop = radio_pair([], sends, 0.5)
    loop.to(20)
    loop.radio = grown(loop.radio, 300)
    assert loop.to(100) == DONE
    assert [b for _, b in heard] == [sends[round(0.01 * k, 6)] for k in range(49)]
    assert loop.radio.counters[IN_FLIGHT] == 90 - 49
    assert loop.radio.counters[IN_FLIGHT] + loop.radio.counters[FREE_PLACES] == loop.radio.places.size


def test_the_loop_asks_for_places_before_it_sends() -> None:
    sends = {round(0.01 * k, 6): heartbeat(1, k) for k in range(90)}
    _, heard, loop = radio_pair([], sends, 0.0)
    loop.radio.counters[FREE_PLACES] = 0
    assert loop.to(100) == NEED_PLACES
    assert loop.plan.counters[K] == 0
    loop.radio = grown(loop.radio, int(places_needed(loop.plan, loop.radio)))
    loop.to(100)
    assert [b for _, b in heard] == list(sends.values())


def test_mapped_integers_and_booleans() -> None:
    """What no entry names stays as it is; one source may go to several inputs, mapped differently or not at all."""
    sender = [variable("m", "output", "Integer", 1), variable("c", "output", "Boolean", 2)]
    names = {"i": "Integer", "j": "Integer", "k": "Integer", "b": "Boolean", "d": "Boolean", "x": "Real"}
    receiver = [variable(name, "input", kind, number) for number, (name, kind) in enumerate(names.items())]
    log: list[str] = []

    def count(self: Scripted, t: float, h: float) -> None:
        self.values["m"] += 1
        self.values["c"] = not self.values["c"]

    table = ((1, 10), (2, 1), (3, -(2**31)))
    links = [
        ("a.m", "b.i"),
        ("a.m", "b.j", 1.0, 0.0, table),
        ("a.m", "b.k", 1.0, 0.0, ((2, 7),)),
        ("a.c", "b.b", 1.0, 0.0, ((0, 1),)),
        ("a.c", "b.d"),
        ("a.m", "b.x", 2.0, 0.5, table),
    ]
    values = dict.fromkeys(names, 0)
    a = Scripted("a", sender, count, {"m": 1, "c": 0}, log)
    b = Scripted("b", receiver, lambda self, t, h: None, values, log)
    loop = Loop([a, b], links, until=4.0)
    seen = []
    for k in range(1, 5):
        assert loop.to(k) == DONE
        seen.append([b.values[name] for name in names])
    assert seen == [
        [1, 10, 1, 1, 0, 20.5],
        [2, 1, 7, 1, 1, 2.5],
        [3, -(2**31), 3, 1, 0, 2.0 * -(2**31) + 0.5],
        [4, 4, 4, 1, 1, 8.5],
    ]
