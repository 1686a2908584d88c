"""Groups that are ahead of each other: what is called, what they receive, and that nothing else changes."""

from __future__ import annotations

import base64
import ctypes
import dataclasses
import random
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.network.radio.build import grown, make_radio
from cosim_master.network.radio.tables import FREE_PLACE, FREE_PLACES, USED_EVENTS, USED_LOG, Radio
from cosim_master.stepping import grouping
from cosim_master.stepping.grouping import grouped
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.instances import collect_all
from cosim_master.stepping.kernels.macro_step import places_needed, run
from cosim_master.stepping.kernels.tables import (
    BLOCK_FULL,
    DONE,
    EXPECTING,
    FAILED,
    NEED_LOG,
    NEED_PLACES,
    ROWS,
    WINDOW,
    K,
    Plan,
)
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.plan import make_plan
from cosim_master.system.settings.network import Gateway, Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.system.settings.time_grid import time_grid
from tests.master.fmus.scripted import Scripted, system_of, variable

U, Y, Z = (
    variable(name, causality, reference=i)
    for i, (name, causality) in enumerate((("u", "input"), ("y", "output"), ("z", "output")))
)
RX = variable("mavlink_rx", "input", "String", 8, capacity=120)
TX = variable("mavlink_tx", "output", "String", 9, capacity=200)


@pytest.fixture(autouse=True)
def _small_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grouping, "LEAST", 2)
    monkeypatch.setattr(grouping, "LARGEST", 1)


def plan_of(
    instances: Sequence[Scripted],
    network: Network,
    until: float,
    *,
    links: Sequence[Any] = (),
    every: int = 1,
    groups: bool = True,
    steps: int = 4,
) -> tuple[Plan, Radio]:
    """A plan whose instances any thread may step, with groups or without; the outputs at the start are collected."""
    ordered = sorted(instances, key=lambda one: one.name)
    checked = system_of(ordered, links)
    observed = [(one.name, name) for one in ordered for name in one.fmu.variables if name in ("y", "z")]
    layout = make_layout(checked, network, observed=observed)
    clock = time_grid(checked, until)
    free = range(len(ordered))
    plan = make_plan(layout, clock, network, ordered, every, free=free)  # type: ignore[arg-type]
    radio = make_radio(network, layout.ports["Real"].index, keep=True)
    if groups:
        plan, radio = grouped(plan, radio, clock.periods, 1)
    block = {name: getattr(plan, name)[:steps] for name in ("ticks", "real_block", "int_block")}
    plan = plan._replace(**{name: array.copy() for name, array in block.items()})
    collect_all(plan)
    return plan, radio


def idle(name: str, log: list[str], **more: Any) -> Scripted:
    return Scripted(name, [Y], lambda self, t, h: None, {"y": 0.0}, log, **more)


def far_apart(names: Sequence[str], latency: float, **more: Any) -> Network:
    return Network(nodes=tuple(Node(name, (Endpoint(name, RX, TX),)) for name in names), latency=latency, **more)


def talker(name: str, log: list[str]) -> Scripted:
    return Scripted(name, [RX, TX], lambda self, t, h: None, {"mavlink_rx": "", "mavlink_tx": ""}, log)


@pytest.mark.parametrize(("latency", "window"), [(3.0, 4), (2.5, 4), (2.0, 3), (0.5, 2), (1e-9, 2), (100.0, 16)])
def test_a_group_makes_all_steps_of_a_window_before_the_next_group_begins(latency: float, window: int) -> None:
    """Sent at 1 s, a packet arrives at 1 s + latency: the step that begins then is the first one of the next window."""
    log: list[str] = []
    plan, radio = plan_of([talker("a", log), talker("b", log)], far_apart("ab", latency), 20.0, steps=100)
    assert plan.counters[WINDOW] == window
    assert run(plan, radio, NO_FRAMES, 20) == DONE
    steps = [line for line in log if "doStep" in line]
    assert steps[: 2 * window] == [f"{name}: doStep {k} + 1" for name in "ab" for k in range(window)]
    assert len(steps) == 40


def test_memory_is_asked_for_once_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """What steps in each base step is near from the first one of a window on; `c` has steps of 5 s."""
    monkeypatch.setattr(grouping, "LARGEST", 3)
    log: list[str] = []
    ones = [idle(name, log, step_size=5.0 if name == "c" else 1.0) for name in "abcdefghijkl"]
    plan, radio = plan_of(ones, Network(), 20.0, steps=100)
    assert (plan.groups.size, plan.counters[WINDOW]) == (4, 16)
    names = {int(row["handle"]): one.name for row, one in zip(plan.instances, ones, strict=True)}
    expect = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda handle: log.append(f"{names[handle]}: expect"))
    plan.instances["expect"] = ctypes.cast(expect, ctypes.c_void_p).value
    plan.counters[EXPECTING] = 1
    log.clear()
    assert run(plan, radio, NO_FRAMES, 20) == DONE
    expected = [line.partition(":")[0] for line in log if line.endswith("expect")]
    assert {name: expected.count(name) for name in "abd"} == {"a": 2, "b": 2, "d": 2}  # at 0 and 16 s
    assert expected.count("c") == 8  # where its steps begin and end: 0, 4, 5, 9, 10, 14, 15, 19 s
    assert log[:5] == ["a: expect", "b: expect", "c: expect", "a: doStep 0 + 1", "a: get y"]


def test_a_window_ends_where_somebody_looks() -> None:
    log: list[str] = []
    plan, radio = plan_of([idle("a", log), idle("b", log)], Network(), 20.0, steps=100)
    log.clear()
    assert run(plan, radio, NO_FRAMES, 2) == DONE
    assert log == [f"{n}: {call}" for n in "ab" for k in (0, 1) for call in (f"doStep {k} + 1", "get y")]


def _connected(log: list[str]) -> tuple[list[Scripted], list[Any], Network]:
    return [Scripted(n, [U, Y], lambda *_: None, {"u": 0.0, "y": 0.0}, log) for n in "ab"], [("a.y", "b.u")], Network()


def _converted(log: list[str]) -> tuple[list[Scripted], list[Any], Network]:
    """An integer output that a real input takes is converted for all instances together."""
    i = variable("i", "output", "Integer", 3)
    one = Scripted("a", [U, i], lambda *_: None, {"u": 0.0, "i": 0}, log)
    return [one, idle("b", log)], [("a.i", "a.u")], Network()


def _slow(log: list[str]) -> tuple[list[Scripted], list[Any], Network]:
    """No instance steps by the base step."""
    return [idle("a", log, step_size=2.0), idle("b", log, step_size=3.0)], [], Network()


def _of_one_node(log: list[str]) -> tuple[list[Scripted], list[Any], Network]:
    both = Node("both", (Endpoint("a", RX, TX), Endpoint("b", RX, TX)))
    return [talker("a", log), talker("b", log)], [], Network(nodes=(both,), latency=1.0)


def _radio(**more: Any) -> Any:
    def made(log: list[str]) -> tuple[list[Scripted], list[Any], Network]:
        return [talker("a", log), talker("b", log)], [], far_apart("ab", **{"latency": 9.0, **more})

    return made


@pytest.mark.parametrize(
    "made",
    [
        _connected,
        _converted,
        _slow,
        _of_one_node,
        _radio(latency=0.0),
        _radio(medium="own", rate=9600.0),
        _radio(medium="csma", rate=9600.0, backoff=0.1),
        _radio(relays=("a",)),
        _radio(gateways=(Gateway("@gcs"),)),
    ],
    ids=["connected", "converted", "slow", "one node", "no latency", "own medium", "csma", "relays", "gateway"],
)
def test_instances_that_must_not_go_ahead_step_together(made: Any) -> None:
    log: list[str] = []
    instances, links, network = made(log)
    plan, _ = plan_of(instances, network, 6.0, links=links)
    assert plan.groups.size == 0
    assert plan.counters[WINDOW] == 0


def test_the_first_failure_counts_and_later_ones_do_not_exist() -> None:
    """Alone, a would fail at 3 s and b at 1 s; both are ahead of the row at which the run ends."""
    log: list[str] = []

    def failing(at: float) -> Any:
        return lambda self, t, h: 3 if t >= at else 0

    bad = [Scripted(name, [Y], failing(at), {"y": 0.0}, log) for name, at in (("a", 3.0), ("b", 1.0), ("c", 1.0))]
    plan, radio = plan_of([*bad, idle("d", log)], Network(), 6.0, steps=100)
    assert run(plan, radio, NO_FRAMES, 6) == FAILED
    assert (plan.counters[K], plan.counters[ROWS]) == (1, 2)
    assert [(row[0], row[0] and row[1]) for row in plan.instances["failed"].tolist()] == [
        (0, 0),
        (5, 3),
        (5, 3),
        (0, 0),
    ]


# ---- the same as without groups --------------------------------------------------------------------------------------


@dataclasses.dataclass
class Case:
    """A system of nodes with two endpoints each, which send packets of all kinds at random."""

    nodes: int
    steps: int
    network: dict[str, Any]
    every: int
    rows: int
    stops: list[int]
    sends: dict[tuple[str, int], bytes]
    periods: dict[str, int]
    paths: dict[str, list[float]]


def _packet(r: random.Random, system: int, nodes: int) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    link.seq = r.randrange(256)
    kind = r.randrange(5)
    if kind == 0:
        return bytes(link.heartbeat_encode(2, 3, 0, 0, 3).pack(link))
    to = r.randrange(nodes + 3)
    packet = bytes(link.param_request_list_encode(to, 0).pack(link))
    if kind == 1:
        return packet[:-1] + bytes([packet[-1] ^ 1])
    if kind == 2:
        return bytes(r.randrange(256) for _ in range(3)) + packet
    return packet


def case_of(seed: int) -> Case:
    r = random.Random(seed)
    nodes, steps = r.randint(2, 5), r.randint(5, 40)
    names = [f"n{i}{which}" for i in range(nodes) for which in "ab"]
    sends = {}
    for name in names:
        for k in range(-1, steps):
            if r.random() < 0.3:
                systems = [int(name[1]) + 1] * 3 + [9]
                sends[name, k] = b"".join(_packet(r, r.choice(systems), nodes) for _ in range(r.randint(1, 4)))
    topology = r.choice(["broadcast", "nearest", "nearest-on-axis", "listed"])
    network: dict[str, Any] = {"topology": "nearest" if "nearest" in topology else topology}
    if topology == "nearest-on-axis":
        network["axis"] = (1.0, 0.5, 0.0)
    if topology == "listed":
        pairs = [(f"n{i}", f"n{j}") for i in range(nodes) for j in range(nodes) if i != j]
        network["links"] = frozenset(r.sample(pairs, r.randint(1, len(pairs))))
    network |= {"latency": r.choice([0.3, 1.0, 2.0, 3.7]), "seed": seed, "neighbours": r.randint(1, 2)}
    network |= r.choice(
        [{}, {"jitter": 1.5}, {"loss": 0.3, "duplicates": 0.3}, {"range": 12.0}, {"sensitivity": -60.0}]
    )
    return Case(
        nodes,
        steps,
        network,
        r.randint(1, 3),
        r.randint(1, 9),
        sorted({*r.sample(range(1, steps + 1), r.randint(0, 4)), steps}),
        sends,
        {name: r.choice([1, 1, 2, 3]) if i else 1 for i, name in enumerate(names)},
        {f"n{i}{axis}": [r.uniform(-20, 20) for _ in range(steps + 7)] for i in range(nodes) for axis in "xyz"},
    )


def play(case: Case, *, groups: bool) -> tuple[Any, ...]:
    """All that can be observed: rows, packets, logs, counts, and what each instance is given, in its own order."""
    heard: dict[str, list[Any]] = {}

    def instance(name: str) -> Scripted:
        heard[name] = []

        def step(self: Scripted, t: float, h: float) -> None:
            k = round(t + h) - 1
            given = self.values["mavlink_rx"]
            heard[name].append((t, base64.b64decode(given), self.values.get("u")))
            self.values["mavlink_tx"] = base64.b64encode(case.sends.get((name, k), b"")).decode()
            self.values["y"] = self.values["y"] + 1.0 + self.values.get("u", 0.0) + len(given)
            if name.endswith("a"):
                for axis in "xyz":
                    self.values[axis] = case.paths[name[:2] + axis][k + 1]

        start = base64.b64encode(case.sends.get((name, -1), b"")).decode()
        values = {"y": 0.0, "mavlink_rx": "", "mavlink_tx": start}
        if name.endswith("b"):
            return Scripted(name, [U, Y, RX, TX], step, {**values, "u": 0.0}, [], float(case.periods[name]))
        place = {axis: case.paths[name[:2] + axis][0] for axis in "xyz"}
        return Scripted(name, [Y, *AXES, RX, TX], step, {**values, **place}, [], float(case.periods[name]))

    made = [instance(f"n{i}{which}") for i in range(case.nodes) for which in "ab"]
    nodes = tuple(
        Node(
            f"n{i}",
            (Endpoint(f"n{i}a", RX, TX), Endpoint(f"n{i}b", RX, TX)),
            tuple((f"n{i}a", axis) for axis in AXES),
        )
        for i in range(case.nodes)
    )
    links = [(f"n{i}a.y", f"n{i}b.u") for i in range(case.nodes)]
    network = Network(nodes=nodes, **case.network)
    least = -(-case.steps // 6) * 6  # a multiple of all periods
    plan, radio = plan_of(made, network, float(least), links=links, every=case.every, groups=groups, steps=case.rows)
    assert (plan.groups.size > 1) == groups
    rows: list[bytes] = []
    packets: list[bytes] = []
    for stop in [0, *case.stops]:
        while (reason := int(run(plan, radio, NO_FRAMES, stop))) != DONE:
            if reason == NEED_PLACES:
                radio = grown(radio, int(places_needed(plan, radio)))
            elif reason == NEED_LOG:
                packets.append(_packets(radio))
                radio = radio._replace(events=np.zeros(4096, radio.events.dtype), log=np.zeros(1 << 20, np.uint8))
            else:
                assert reason == BLOCK_FULL
                rows.append(_rows(plan))
    rows.append(_rows(plan))
    packets.append(_packets(radio))
    counts = [c for i, c in enumerate(radio.counters.tolist()) if i not in (FREE_PLACE, FREE_PLACES)]
    return b"".join(rows), b"".join(packets), counts, heard, plan.real_out.tolist(), radio.endpoints["heard"].tolist()


AXES = tuple(variable(name, "output", reference=20 + i) for i, name in enumerate("xyz"))


def _rows(plan: Plan) -> bytes:
    n = int(plan.counters[ROWS])
    plan.counters[ROWS] = 0
    return b"".join(
        plan.ticks[i].tobytes() + plan.real_block[i].tobytes() + plan.int_block[i].tobytes() for i in range(n)
    )


def _packets(radio: Radio) -> bytes:
    """The bytes of all events, then those of the log, of which each node has its own part."""
    events = radio.events[: radio.counters[USED_EVENTS]].tobytes()
    log = radio.log[: radio.counters[USED_LOG]].tobytes()
    radio.counters[[USED_EVENTS, USED_LOG]] = 0
    return events + log


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9))
def test_groups_change_nothing_that_can_be_observed(seed: int) -> None:
    case = case_of(seed)
    assert play(case, groups=True) == play(case, groups=False)
