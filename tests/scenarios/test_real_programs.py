"""Programs of the package index against a running swarm: MAVProxy, MAVSDK, DroneKit; each in a process of its own."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.scenarios.swarm import running

CLIENTS = Path(__file__).with_name("clients")
PACE = 4.0

pytestmark = [pytest.mark.slow, pytest.mark.alone]


def needs(*modules: str) -> pytest.MarkDecorator:
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"pip install -e '.[clients]': no {', '.join(missing)}")


def run(arguments: list[str], seconds: float, **environment: str) -> subprocess.CompletedProcess[str]:
    """A program to its end; it is killed when it takes too long."""
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


@needs("mavsdk")
def test_mavsdk_flies(tmp_path: Path, fmus: Path) -> None:
    """MAVSDK: connect, health, arm, takeoff, goto, mission upload and start and download, land."""
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE) as swarm:
        url = f"tcpout://127.0.0.1:{swarm.port('@drone2')}"
        done = run([str(CLIENTS / "mavsdk_flight.py"), url], 90)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        swarm.stop()
    last: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert last["system"] == 2
    assert abs(last["height"] - 12.0) < 0.3


MAVPROXY = """\
60 flags & 512 and fix >= 3 | mode guided
10 mode == 'GUIDED' | arm throttle
10 armed | takeoff 10
30 param_LAND_SPEED == 50 | param set LAND_SPEED 60
10 param_LAND_SPEED == 60 | param show LAND_SPEED
30 height > 9.5 | guided -35.36320 149.16530 10
30 abs(lat + 35.36320) < 5e-6 and abs(lon - 149.16530) < 5e-6 | wp load FOLDER/mission
10 MISSION_ACK and MISSION_ACK['type'] == 0 | mode auto
30 mode == 'AUTO' and abs(lat + 35.36320) < 5e-6 and abs(lon - 149.16510) < 5e-6 | rtl
10 mode == 'RTL' | mode land
10 mode == 'LAND' | status HEARTBEAT
60 not armed | end
"""

MISSION = """\
QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t-35.363262\t149.165237\t584\t1
1\t0\t3\t16\t0\t0\t0\t0\t-35.36320\t149.16510\t12\t1
"""


@needs("MAVProxy")
def test_mavproxy_flies(tmp_path: Path, fmus: Path) -> None:
    """MAVProxy: mode guided, arm throttle, takeoff 10, param set and show, guided, wp load, rtl, mode land."""
    (tmp_path / "mission").write_text(MISSION)
    (tmp_path / "script").write_text(MAVPROXY.replace("FOLDER", str(tmp_path)))
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE) as swarm:
        _mavproxy(tmp_path, f"tcp:127.0.0.1:{swarm.port('@drone1')}")
        swarm.stop()
    done = (tmp_path / "log").read_text().splitlines()
    assert [line.partition(" ")[0] for line in done] == ["done:"] * 12, done


def _mavproxy(folder: Path, master: str) -> None:
    options = ["--master", master, "--daemon", "--non-interactive", "--state-basedir", str(folder)]
    options += ["--load-module", "mavproxy_script"]
    run(
        ["-m", "MAVProxy.mavproxy", *options],
        120,
        HOME=str(folder),
        PYTHONPATH=f"{CLIENTS}:{os.environ.get('PYTHONPATH', '')}",
        MAVPROXY_SCRIPT=str(folder / "script"),
        MAVPROXY_LOG=str(folder / "log"),
    )


@needs("dronekit", "past")
def test_dronekit_goes_somewhere(tmp_path: Path, fmus: Path) -> None:
    """DroneKit: simple_takeoff, simple_goto at a speed, LAND."""
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE) as swarm:
        done = run([str(CLIENTS / "dronekit_goto.py"), f"tcp:127.0.0.1:{swarm.port('@drone4')}"], 120)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        swarm.stop()
    seen = json.loads(done.stdout.splitlines()[-1])
    assert seen["parameters"] > 50
    assert abs(seen["off"]) < 5e-6
    assert abs(seen["alt"] - 8.0) < 0.3


LINE = Path(__file__).parents[2] / "examples" / "dronekit_line.py"
STEPS = 18
GRID = 0.015
"""The autopilot's grid of 1e-7 degrees in m, and the rounding of what the script prints."""


@needs("dronekit", "past")
def test_dronekit_flies_five_vehicles_at_once_by_the_law_of_the_line(tmp_path: Path, fmus: Path) -> None:
    """DroneKit at five ports: connect with wait_ready, is_armable, GUIDED, armed, simple_takeoff(10); then the line.

    The recording is compared with the script, however long the computer takes between a reading and a command; where
    it was so slow that a reading is the one before, both commands are the same.
    """
    with running(tmp_path / "out", "--ports", "tcp:0", pace=PACE / 2) as swarm:
        addresses = [f"tcp:127.0.0.1:{swarm.port(f'@drone{i}')}" for i in range(1, 6)]
        done = run([str(LINE), *addresses, "--period", "3.1875", "--steps", str(STEPS)], 200)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        swarm.stop()
    east = np.array([json.loads(line)["east"] for line in done.stdout.splitlines()])
    assert len(east) == STEPS + 1
    assert (np.diff(east) > 0.0).all()
    assert east[-1] == pytest.approx([0.0, 25.0, 50.0, 75.0, 100.0], abs=1.5)
    recorded = pq.read_table(tmp_path / "out" / "signals.parquet")
    for drone in (2, 3, 4):
        targets = recorded[f"drone{drone}.autopilot.target[2]"].to_numpy()
        path = recorded[f"drone{drone}.vehicle.position[2]"].to_numpy()
        commanded = np.flatnonzero(np.abs(np.diff(targets)) > GRID) + 1
        law = east[:, drone - 1] + (east[:, drone - 2] + east[:, drone] - 2.0 * east[:, drone - 1]) / 3.0
        changes = np.diff(law[:STEPS], prepend=targets[commanded[0] - 1])  # drone 2 is first told to stay at 10 m
        steps = np.flatnonzero(np.abs(changes) > GRID)
        assert targets[commanded] == pytest.approx(law[steps], abs=GRID)
        for (k, start), end in zip(enumerate(commanded[:-1], 1), commanded[1:], strict=True):  # read between commands
            flown = path[start : end + 1]
            assert flown.min() - GRID < east[steps[k], drone - 1] < flown.max() + GRID, (steps[k], drone)
