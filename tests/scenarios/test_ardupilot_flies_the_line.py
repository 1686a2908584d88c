"""line5-ardupilot: five ArduPilots on one clock; stand-ins, or ArduCopter where ARDUPILOT_SITL names it."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.system.authoring.swap import swap
from tests.models.ardupilot.test_ardupilot_sitl import STAND_IN
from tests.scenarios.flights import SYSTEMS, Flight, fly
from tests.scenarios.test_line_spreads_evenly import EAST_AT_STEP

pytestmark = pytest.mark.usefixtures("fmus")
DRONES = range(1, 6)
EPOCH = 1735689600.0
"""Of the packet logs: 2025-01-01."""


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    program = tmp_path / "arducopter"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {STAND_IN} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("ARDUPILOT_SITL", str(program))
    monkeypatch.setenv("STAND_IN", json.dumps({"log": str(tmp_path)}))
    return tmp_path


@pytest.mark.slow
def test_five_instances_share_one_clock(stand_in: Path, tmp_path: Path) -> None:
    flight = fly(SYSTEMS / "line5-ardupilot", tmp_path / "out", until=0.3)
    starts = (0.0, 10.0, 20.0, 50.0, 100.0)
    for i, east in enumerate(starts):
        given, *taken = map(json.loads, (stand_in / f"{i}.jsonl").read_text().splitlines())
        assert given["sysid"] == i + 1
        assert [line["timestamp"] for line in taken] == pytest.approx([(k + 1) / 1000 for k in range(300)])
        assert taken[-1]["position"][1] == pytest.approx(east, abs=1e-6)
    clocks = [flight[f"drone{i}.autopilot.clock"] for i in DRONES]
    assert all(np.array_equal(clocks[0], clock) for clock in clocks)
    assert clocks[0] == pytest.approx(flight["time"], abs=1e-9)
    # the agents hear their autopilots' heartbeats: system 1 to 5, of ArduPilot's serial ports
    assert flight.result.packets["on board"] + flight.result.packets["delivered"] >= 10
    assert flight.result.packets["malformed"] == 0


def test_without_an_executable_the_run_fails_and_says_how_to_get_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_SITL", raising=False)
    result = simulate(SYSTEMS / "line5-ardupilot", RunOptions(out=tmp_path / "out", until=0.1))
    assert result.outcome == "failed"
    assert "ARDUPILOT_SITL" in str(result.error)
    assert "ardupilot.org" in str(result.error)


real = pytest.mark.skipif("ARDUPILOT_SITL" not in os.environ, reason="ARDUPILOT_SITL names no arducopter")


@pytest.fixture(scope="module")
def flight(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Flight:
    assert fmus.is_dir()
    return fly(SYSTEMS / "line5-ardupilot", tmp_path_factory.mktemp("line5-ardupilot"))


def its_own_clock(tlog: Path, system: int) -> list[tuple[float, float]]:
    """When each GLOBAL_POSITION_INT of a system arrived by the master's clock, and what ArduCopter's says in it [s]."""
    log = mavutil.mavlink_connection(str(tlog))
    found = []
    while (message := log.recv_match(type="GLOBAL_POSITION_INT")) is not None:
        if message.get_srcSystem() == system:
            found.append((message._timestamp - EPOCH, message.time_boot_ms / 1000))
    log.close()
    assert len(found) > 200
    return found


@pytest.mark.alone
@pytest.mark.slow
@real
def test_arducopters_clocks_are_one(flight: Flight) -> None:
    clocks = [flight[f"drone{i}.autopilot.clock"] for i in DRONES]
    assert all(np.array_equal(clocks[0], clock) for clock in clocks)
    assert clocks[0] == pytest.approx(flight["time"], abs=1e-9)
    for i in DRONES:
        assert not flight[f"drone{i}.autopilot.lost"].any()
        assert not flight[f"drone{i}.autopilot.restarts"].any()
    for sent, time_boot in its_own_clock(flight.folder / "packets" / "drone3.tlog", system=3):
        assert 0.0 <= sent - time_boot < 0.05  # its serial port has its turn each 10 ms


@pytest.mark.alone
@pytest.mark.slow
@real
def test_arducopters_spread_evenly(flight: Flight) -> None:
    """As in the paper, and as ours do."""
    assert [flight.east(i)[-1] for i in DRONES] == pytest.approx([0, 25, 50, 75, 100], abs=0.5)
    for step, east in EAST_AT_STEP.items():
        row = flight.end_of_step(step)
        assert [flight.east(i)[row] for i in (2, 3, 4)] == pytest.approx(east, abs=0.3)
    first = flight.row_of_step(1)
    for i in DRONES:
        assert flight[f"drone{i}.autopilot.armed"][first:].all()
        assert np.abs(flight.up(i)[first:] - 10.0).max() < 0.6  # 4.7 is within 0.02 m; 4.5's own estimate is 0.45 m off
        assert np.ptp(flight.up(i)[first:]) < 0.2
        assert np.abs(flight[f"drone{i}.vehicle.position[1]"]).max() < 0.2
    assert flight.result.packets["lost"] == flight.result.packets["malformed"] == 0


@pytest.mark.alone
@pytest.mark.slow
@real
def test_one_arducopter_flies_among_ours(fmus: Path, tmp_path: Path) -> None:
    """One FMU swapped; the others wait for it, as it needs 42 s until it knows where it is."""
    swapped = swap(SYSTEMS / "line5", "drone3.autopilot", fmus / "ArduPilotSITL.fmu", tmp_path / "swapped")
    later = {f"drone{i}.agent.first_step_time": "55" for i in DRONES}
    flight = fly(swapped, tmp_path / "out", until=84.0, overrides=later)
    assert [bool(flight[f"drone{i}.autopilot.armed"][flight.row_of_step(1)]) for i in DRONES] == [True] * 5
    row = flight.end_of_step(9)
    assert [flight.east(i)[row] for i in (2, 3, 4)] == pytest.approx(EAST_AT_STEP[9], abs=0.4)
    assert [flight.east(i)[row] for i in (1, 5)] == pytest.approx([0.0, 100.0], abs=0.1)
    assert np.abs(flight.up(3)[flight.row_of_step(1) :] - 10.0).max() < 0.6
    assert flight["drone3.autopilot.clock"][-1] == pytest.approx(84.0)
