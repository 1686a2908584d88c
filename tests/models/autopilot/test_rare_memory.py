"""Steps of the autopilot leave rare memory alone, on the ground and in flight.

A line of memory that each step of thousands of drones reads, and that is not fetched with the others, costs as much as
a tenth of the step.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.pair import ACCEPTED, Pair

SET_MODE, ARM, TAKEOFF, GUIDED, STABILIZE = 176, 400, 22, 4, 0
RARE = {variable.name.partition("[")[0] for variable in Autopilot.variables if variable.rare}
STEPS = 40
"""0.1 s: a task that runs ten times a second is due in one of these steps, one of 50 Hz in five."""


class Watched:
    """A record that counts the fields that are used."""

    def __init__(self, record: Any) -> None:
        self.__dict__.update(record=record, used=set())

    def __getattr__(self, name: str) -> Any:
        self.used.add(name)
        return getattr(self.record, name)

    def __setattr__(self, name: str, value: Any) -> None:
        self.used.add(name)
        setattr(self.record, name, value)

    def __getitem__(self, name: str) -> Any:
        return self.record[name]

    def __setitem__(self, name: str, value: Any) -> None:
        self.record[name] = value


def used_often(pair: Pair) -> list[str]:
    """Makes some steps; returns the rare variables that a quarter of them used."""
    counts = Counter[str]()
    for _ in range(STEPS):
        pair.m.used.clear()
        pair.one_step()
        counts.update(pair.m.used & RARE)
    return sorted(name for name, count in counts.items() if count > STEPS / 4)


def flight() -> dict[str, list[str]]:
    """Flies with interpreted kernels; returns what is used often in each phase."""
    pair = Pair(Quadrotor, Autopilot, pilot={"estimate_ready_time": 0.1, "TKOFF_SLEW_TIME": 0.1, "MOT_SPOOL_TIME": 0.1})
    pair.m = Watched(pair.m)
    found = {"on the ground": used_often(pair)}
    pair.until(1.0)
    for command in ((SET_MODE, 1, GUIDED), (ARM, 1), (TAKEOFF, 0, 0, 0, 0, 0, 0, 1.0)):
        assert pair.ask(*command) == ACCEPTED
    while -pair.place[2] < 0.3:
        assert pair.time < 10.0, "it does not take off"
        pair.one_step()
    found["climbing"] = used_often(pair)
    pair.until(pair.time + 1.0)
    north, east, _ = pair.place
    pair.go(north, east + 3.0, 2.0)
    pair.until(pair.time + 0.5)
    found["on the way"] = used_often(pair)
    return found


def test_most_steps_use_no_rare_variable() -> None:
    """Compiled kernels do not tell; so this runs in a process that compiles nothing."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.models.autopilot.test_rare_memory"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {"on the ground": [], "climbing": [], "on the way": []}


if __name__ == "__main__":
    print(json.dumps(flight()))
