"""Steps in one call: what the loop then calls, what it calls where that fails, and that no bit changes."""

from __future__ import annotations

import ctypes
from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from cosim_master import RunOptions, simulate
from cosim_master.network.radio.build import make_radio
from cosim_master.stepping import plan as plans
from cosim_master.stepping.kernels.frames import NO_FRAMES
from cosim_master.stepping.kernels.instances import collect_all, step_chosen
from cosim_master.stepping.kernels.macro_step import run
from cosim_master.stepping.kernels.tables import DO_STEP, DONE, FAILED, GET_STRING, NOT_BEGUN, NOT_READ, TOO_LONG, Plan
from cosim_master.stepping.layout import make_layout
from cosim_master.stepping.plan import make_plan
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.system.settings.time_grid import time_grid
from tests.master.fmus.scripted import Scripted, system_of, variable

LINE5 = Path(__file__).parents[3] / "master" / "systems" / "line5"
U, Y = variable("u", "input", reference=0), variable("y", "output", reference=1)
N, ON = variable("n", "input", "Integer", 2), variable("on", "output", "Boolean", 3)
RX = variable("mavlink_rx", "input", "String", 8, capacity=200)
TX = variable("mavlink_tx", "output", "String", 9, capacity=200)
HEARTBEAT = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 7, 1)))


class Packets(ctypes.Structure):
    """Packets as bytes."""

    _fields_ = [("bytes", ctypes.c_void_p), ("size", ctypes.c_uint64)]


class WholeRow(ctypes.Structure):
    """What the loop passes to `uav_cosim_make_step`."""

    _fields_ = [("handle", ctypes.c_void_p), ("moves", ctypes.c_void_p), ("values", ctypes.c_void_p * 8)]


class Whole(Scripted):
    """A scripted instance that makes steps in one call, which answers `answer(k)`; u is copied to y, n > 0 to on."""

    def __init__(self, log: list[str], answer: Callable[[int], int], *, refuses: bool = False, **more: Any) -> None:
        def do_step(self: Scripted, t: float, h: float) -> None:
            self.values["y"], self.values["on"] = self.values["u"], self.values["n"] > 0

        values = {"u": 0.0, "y": 0.0, "n": 0, "on": False, "mavlink_rx": "", "mavlink_tx": ""}
        super().__init__("b", [U, Y, N, ON, RX, TX], do_step, values, log, **more)
        self.noted: list[list[int]] = []
        sent: list[Any] = []

        def note(numbers: Any, references: Any, _: int) -> int:
            own = iter(references[: sum(numbers[:8])])
            self.noted += [[next(own) for _ in range(n)] for n in numbers[:8]]
            return int(refuses)

        def step(at: Any, t: float, h: float, packets: int) -> int:
            row, k = at[0], round(t)
            if (answered := answer(k)) == NOT_BEGUN:
                return NOT_BEGUN
            assert row.handle == self.handle
            self.values["u"] = ctypes.c_double.from_address(row.values[0]).value
            self.values["n"] = ctypes.c_int.from_address(row.values[1]).value
            given = Packets.from_address(row.values[3])
            received = f" with {ctypes.string_at(given.bytes, given.size).hex()}" if packets else ""
            do_step(self, t, h)
            self.log.append(f"b: whole step {t:g} + {h:g}{received}")
            if answered == 0:
                ctypes.c_double.from_address(row.values[4]).value = self.values["y"]
                ctypes.c_int.from_address(row.values[6]).value = self.values["on"]
                bytes_ = b64decode(self.values["mavlink_tx"])
                sent[:] = [ctypes.create_string_buffer(bytes_)]
                place = Packets.from_address(row.values[7])
                place.bytes, place.size = ctypes.addressof(sent[0]), len(bytes_)
            return answered

        pointer = ctypes.POINTER
        self._define("uav_cosim_note_step", note, pointer(ctypes.c_uint), pointer(ctypes.c_uint), ctypes.c_void_p)
        self._define("uav_cosim_make_step", step, pointer(WholeRow), ctypes.c_double, ctypes.c_double, ctypes.c_int)


def source(log: list[str]) -> Scripted:
    """An instance with y = t + h and n = the number of its steps."""

    def do_step(self: Scripted, t: float, h: float) -> None:
        self.values["y"] = t + h
        self.values["n"] += 1

    outputs = [variable("y", "output", reference=1), variable("n", "output", "Integer", 2)]
    return Scripted("a", outputs, do_step, {"y": 0.5, "n": 0}, log)


def station(log: list[str]) -> Scripted:
    """An instance that sends a heartbeat in each step, and receives."""
    values = {"mavlink_tx": b64encode(HEARTBEAT).decode(), "mavlink_rx": ""}
    return Scripted("c", [RX, TX], lambda self, t, h: None, values, log)


def plan_of(whole: Whole, until: float = 6.0, others: Sequence[Scripted] = ()) -> tuple[Plan, Any]:
    ordered = [source(whole.log), whole, *others]
    checked = system_of(ordered, [("a.y", "b.u"), ("a.n", "b.n")])
    network = Network(nodes=tuple(Node(name, (Endpoint(name, RX, TX),)) for name in ("b", "c")[: 1 + len(others)]))
    layout = make_layout(checked, network, observed=[("b", "y"), ("b", "on")])
    clock = time_grid(checked, until)
    plan = make_plan(layout, clock, network, ordered, 1, free=[0, 1])  # type: ignore[arg-type]
    collect_all(plan)
    whole.log.clear()
    return plan, make_radio(network, layout.ports["Real"].index, keep=True)


STEP_OF_FMI = ["b: set u = 0.5", "b: set n = 0", "b: doStep 0 + 1", "b: get y", "b: get on", "b: get mavlink_tx"]


def calls_of(log: list[str]) -> list[str]:
    return [line for line in log if line.startswith("b:")]


def test_a_step_in_one_call_replaces_all_others() -> None:
    whole = Whole([], lambda k: 0)
    plan, radio = plan_of(whole)
    assert whole.noted == [[0], [2], [], [8], [1], [], [3], [9]]
    assert run(plan, radio, NO_FRAMES, 2) == DONE
    assert calls_of(whole.log) == ["b: whole step 0 + 1", "b: whole step 1 + 1"]
    at = {name: place for place, name in enumerate(("a.y", "b.y"))}
    assert plan.real_out[at["a.y"]] == 2.0
    assert plan.real_out[at["b.y"]] == 1.0  # the inputs of the second step: y and n of a at 1 s


def test_packets_pass_as_bytes() -> None:
    """What is sent in a step has arrived when the next one begins; without any, they are set to none once."""
    whole = Whole([], lambda k: 0)
    other = station(whole.log)
    plan, radio = plan_of(whole, others=[other])
    assert run(plan, radio, NO_FRAMES, 1) == DONE
    whole.values["mavlink_tx"] = b64encode(HEARTBEAT).decode()
    assert run(plan, radio, NO_FRAMES, 2) == DONE
    whole.values["mavlink_tx"] = other.values["mavlink_tx"] = ""
    assert run(plan, radio, NO_FRAMES, 5) == DONE
    assert calls_of(whole.log) == [
        f"b: whole step 0 + 1 with {HEARTBEAT.hex()}",
        f"b: whole step 1 + 1 with {HEARTBEAT.hex()}",
        f"b: whole step 2 + 1 with {HEARTBEAT.hex()}",
        "b: whole step 3 + 1 with ",
        "b: whole step 4 + 1",
    ]
    received = [line for line in whole.log if line.startswith("c: set mavlink_rx")]
    assert received == [f"c: set mavlink_rx = {b64encode(HEARTBEAT).decode()}", "c: set mavlink_rx = "]


def test_packets_are_text_to_the_calls_of_fmi() -> None:
    """In a step that the FMU has not begun; and in one whose outputs it has not got, what it sends."""
    whole = Whole([], lambda k: (0, NOT_BEGUN, NOT_READ)[k % 3])
    other = station(whole.log)
    plan, radio = plan_of(whole, others=[other])
    whole.values["mavlink_tx"] = b64encode(HEARTBEAT).decode()
    assert run(plan, radio, NO_FRAMES, 3) == DONE
    text = b64encode(HEARTBEAT).decode()
    assert calls_of(whole.log) == [
        f"b: whole step 0 + 1 with {HEARTBEAT.hex()}",
        f"b: set mavlink_rx = {text}",
        *("b: set u = 1.0", "b: set n = 1", "b: doStep 1 + 1", "b: get y", "b: get on", "b: get mavlink_tx"),
        f"b: whole step 2 + 1 with {HEARTBEAT.hex()}",
        *("b: get y", "b: get on", "b: get mavlink_tx"),
    ]
    received = [line for line in whole.log if line.startswith("c: set mavlink_rx")]
    assert received == [f"c: set mavlink_rx = {text}"] * 2


def test_packets_stay_the_same_when_a_step_is_repeated() -> None:
    """As text and as bytes; a master that repeats a step delivers nothing in between."""
    answers = [0, NOT_BEGUN, NOT_BEGUN, 0]
    whole = Whole([], lambda k: answers.pop(0))
    plan, radio = plan_of(whole, others=[station(whole.log)])
    assert run(plan, radio, NO_FRAMES, 1) == DONE
    whole.log.clear()
    assert plan.ports["filled"][0] == 2
    place, size = plan.ports["given"][0], plan.ports["given_size"][0]
    for _ in answers[:]:
        assert step_chosen(plan, np.array([1])) == 0
    text = f"b: set mavlink_rx = {b64encode(HEARTBEAT).decode()}"
    received = [line for line in whole.log if "mavlink_rx" in line or "whole" in line]
    assert received == [text, text, f"b: whole step 1 + 1 with {HEARTBEAT.hex()}"]
    assert (plan.ports["given"][0], plan.ports["given_size"][0]) == (place, size)


def test_more_packets_than_fit_are_a_failure() -> None:
    whole = Whole([], lambda k: 0)
    plan, radio = plan_of(whole)
    whole.values["mavlink_tx"] = b64encode(bytes(201)).decode()
    assert run(plan, radio, NO_FRAMES, 1) == FAILED
    assert list(plan.instances[1]["failed"][:2]) == [GET_STRING, TOO_LONG]


def test_an_instance_of_several_endpoints_is_called_by_the_calls_of_fmi() -> None:
    """Each of them has its own calls."""
    whole = Whole([], lambda k: 0)
    ordered = [source(whole.log), whole]
    checked = system_of(ordered, [("a.y", "b.u"), ("a.n", "b.n")])
    network = Network(nodes=(Node("b", (Endpoint("b", RX, TX), Endpoint("b", None, TX))),))
    layout = make_layout(checked, network, observed=[("b", "y"), ("b", "on")])
    plan = make_plan(layout, time_grid(checked, 6.0), network, ordered, 1, free=[0, 1])  # type: ignore[arg-type]
    assert not plan.instances["whole"].any()
    assert not plan.ports["raw"].any()


def test_what_no_single_call_can_do_the_calls_of_fmi_do() -> None:
    whole = Whole([], lambda k: NOT_BEGUN)
    plan, radio = plan_of(whole)
    assert run(plan, radio, NO_FRAMES, 1) == DONE
    assert calls_of(whole.log) == STEP_OF_FMI


def test_outputs_that_a_step_has_not_read_are_got_by_the_calls_of_fmi() -> None:
    whole = Whole([], lambda k: NOT_READ)
    plan, radio = plan_of(whole)
    assert run(plan, radio, NO_FRAMES, 1) == DONE
    assert calls_of(whole.log) == ["b: whole step 0 + 1", *STEP_OF_FMI[3:]]


@pytest.mark.parametrize("status", [2, 3, 4])
def test_a_step_that_fails_is_a_failed_step_of_fmi(status: int) -> None:
    whole = Whole([], lambda k: status if k == 1 else 0)
    plan, radio = plan_of(whole)
    assert run(plan, radio, NO_FRAMES, 6) == FAILED
    assert list(plan.instances[1]["failed"][:2]) == [DO_STEP, status]
    assert list(plan.instances[0]["failed"][:2]) == [0, 0]


def test_an_fmu_that_refuses_is_called_as_any_other() -> None:
    whole = Whole([], lambda k: 0, refuses=True)
    plan, radio = plan_of(whole)
    assert not plan.instances["whole"].any()
    assert run(plan, radio, NO_FRAMES, 1) == DONE
    assert calls_of(whole.log) == STEP_OF_FMI


def test_a_step_of_several_base_steps_ends_later() -> None:
    """Its outputs are those of its end, so it is begun and ended by the calls of FMI; the last step is a short one."""
    whole = Whole([], lambda k: 0, step_size=2.0)
    plan, radio = plan_of(whole, until=5.0)
    assert run(plan, radio, NO_FRAMES, 5) == DONE
    steps = [line for line in calls_of(whole.log) if "tep" in line]
    assert steps == ["b: doStep 0 + 2", "b: doStep 2 + 2", "b: whole step 4 + 1"]


def test_a_swarm_records_the_same_bits_either_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def recorded(name: str, threads: int) -> dict[str, bytes]:
        out = tmp_path / name
        assert simulate(LINE5, RunOptions(out=out, until=4.0, threads=threads)).outcome == "done"
        return {one: (out / one).read_bytes() for one in ("signals.parquet", "packets.parquet", "packets.tlog")}

    whole = recorded("whole", 1)
    assert recorded("two", 2) == whole
    monkeypatch.setattr(plans, "enter_whole_steps", lambda *_: None)
    assert recorded("calls", 1) == whole
