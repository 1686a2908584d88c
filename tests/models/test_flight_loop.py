"""The loop in C flies as the steps that Python makes one by one: the same bits, the same packets at the same times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.fidelity import Misled, fly
from benchmarks.flights import read
from cosim_models.autopilot.rover_autopilot import RoverAutopilot
from cosim_models.vehicles.rover import Rover
from tests.models import copter as copter_module
from tests.models import pair as pair_module
from tests.models.copter import RECORDINGS, Copter, H
from tests.models.pair import Pair
from tests.models.shipped_kernels import Loop

STEPS = 2**60


@pytest.fixture
def step_by_step(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Lets Python make all steps that follow, and counts those of the loop before."""
    made: list[int] = []
    real = Loop.fly

    def counted(self: Loop, step: int, count: int, *table: Any) -> Any:
        found = real(self, step, count, *table)
        made.append(found[0])
        return found

    monkeypatch.setattr(Loop, "fly", counted)

    def switch() -> int:
        for module in (copter_module, pair_module):
            monkeypatch.setattr(module, "FEW", STEPS)
        count = sum(made)
        made[:] = [-STEPS]
        return count

    yield switch
    assert made == [-STEPS]


def flown(direct: bool) -> tuple[Any, ...]:
    copter = Copter(autopilot={"SR1_POSITION": 10.0}, direct=direct)
    assert copter.run(0.02).shape == (8, 10)
    copter.send(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 33, 1e5, 0, 0, 0, 0, 0), line="telemetry")
    copter.in_the_air(3.0, 5.0)
    copter.go(4.0, 2.0, -4.0)
    rows = copter.run(3.0)
    heard = [(t, message.get_msgbuf()) for t, message in copter.heard]
    at = [message.get_msgbuf() for message in copter.heard_at["telemetry"]]
    return rows.tobytes(), bytes(copter.sent), heard, at, copter.m.tobytes(), copter.v.tobytes(), copter.step


@pytest.mark.parametrize("direct", [False, True])
def test_of_a_copter(direct: bool, step_by_step: Any) -> None:
    by_loop = flown(direct)
    assert step_by_step() > 0.99 * by_loop[-1] - 20
    assert flown(direct) == by_loop
    rows = np.frombuffer(by_loop[0]).reshape(-1, 10)
    assert np.linalg.norm(rows[-1, 1:4] - rows[0, 1:4]) > 1.0
    assert rows[:, 0] == pytest.approx(by_loop[-1] * H - 3.0 + H * np.arange(1, 1201), abs=1e-9)
    assert len(by_loop[2]) > 5 and len(by_loop[3]) > 50


def driven() -> tuple[Any, ...]:
    pair = Pair(Rover, RoverAutopilot)
    pair.until(2.0)
    assert pair.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 15) == 0
    assert pair.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    pair.go(10.0, 5.0, 0.0)
    pair.until(8.0)
    return pair.m.tobytes(), pair.v.tobytes(), [message.get_msgbuf() for message in pair.heard], pair.step, pair.place


def test_of_a_vehicle_with_steps_of_its_own(step_by_step: Any) -> None:
    by_loop = driven()
    assert step_by_step() > 0.95 * by_loop[3]
    assert driven() == by_loop
    assert by_loop[4][0] > 5.0


@pytest.mark.parametrize("name", ["json_0_0_5", "json_takeoff_idling"])
def test_of_a_copter_whose_estimate_errs(name: str, step_by_step: Any) -> None:
    flight = read(RECORDINGS / f"{name}.csv.gz")
    assert flight.errors is not None
    by_loop = fly(flight, {})
    assert step_by_step() > 3000
    assert fly(flight, {}).tobytes() == by_loop.tobytes()


def test_a_copter_that_stands_vertically_is_stepped_by_python() -> None:
    copter = Misled()
    copter.run(0.1)
    copter.v["attitude"][:] = np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0
    loop = copter._loop()
    assert loop is not None and loop.errors is not None
    assert loop.fly(copter.step, 100) == (0, [])
    assert len(copter.run(0.1)) == 40


def test_packets_that_need_more_room_are_fetched_in_between(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.models.shipped_kernels._ROOM", 100)
    copter = Copter()
    loop = copter._loop()
    assert loop is not None
    made, packets = loop.fly(0, 4000)
    assert made == 1 and [line for _, line, _ in packets] == [0, 1, 2]  # a heartbeat on each
    copter.step = made
    copter.run(10.0)
    assert len(copter.messages("HEARTBEAT")) == 10
