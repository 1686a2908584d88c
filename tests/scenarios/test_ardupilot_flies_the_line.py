"""line5-ardupilot: five ArduPilots on one clock; stand-ins, or ArduCopter where ARDUPILOT_SITL names it."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from cosim_master.simulation import simulate
from tests.models.test_ardupilot_sitl import STAND_IN
from tests.scenarios.flights import SYSTEMS, fly

pytestmark = pytest.mark.usefixtures("fmus")
DRONES = range(1, 6)


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
    assert clocks[0] == pytest.approx(flight["time"])
    # the agents hear their autopilots' heartbeats: system 1 to 5, of ArduPilot's serial ports
    assert flight.result.packets["on board"] + flight.result.packets["delivered"] >= 10
    assert flight.result.packets["malformed"] == 0


def test_without_an_executable_the_run_fails_and_says_how_to_get_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_SITL", raising=False)
    result = simulate(SYSTEMS / "line5-ardupilot", out=tmp_path / "out", until=0.1)
    assert result.outcome == "failed"
    assert "ARDUPILOT_SITL" in str(result.error)
    assert "ardupilot.org" in str(result.error)


@pytest.mark.slow
@pytest.mark.skipif("ARDUPILOT_SITL" not in os.environ, reason="ARDUPILOT_SITL names no arducopter")
def test_arducopter_flies_the_line(tmp_path: Path) -> None:
    flight = fly(SYSTEMS / "line5-ardupilot", tmp_path / "out")
    clocks = [flight[f"drone{i}.autopilot.clock"] for i in DRONES]
    assert all(np.array_equal(clocks[0], clock) for clock in clocks)
    for i, goal in zip(DRONES, (0.0, 25.0, 50.0, 75.0, 100.0), strict=True):
        assert abs(flight.east(i)[-1] - goal) < 1.0
        assert abs(flight.up(i)[-1] - 10.0) < 0.5
