"""Steps of the autopilot leave rare memory alone, on the ground and in flight.

A line of memory that each step of thousands of drones reads, and that is not fetched with the others, costs as much as
a tenth of the step.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

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


def pair() -> Pair:
    return Pair(Quadrotor, Autopilot, pilot={"estimate_ready_time": 0.1, "TKOFF_SLEW_TIME": 0.1, "MOT_SPOOL_TIME": 0.1})


def flight() -> dict[str, tuple[int, bytes, bytes]]:
    """Flies with compiled kernels; returns the step and both records at the begin of each phase."""
    flying = pair()
    found: dict[str, tuple[int, bytes, bytes]] = {}

    def keep(phase: str) -> None:
        found[phase] = flying.step, flying.m.tobytes(), flying.v.tobytes()

    keep("on the ground")
    flying.until(1.0)
    for command in ((SET_MODE, 1, GUIDED), (ARM, 1), (TAKEOFF, 0, 0, 0, 0, 0, 0, 1.0)):
        assert flying.ask(*command) == ACCEPTED
    while -flying.place[2] < 0.3:
        assert flying.time < 10.0, "it does not take off"
        flying.one_step()
    keep("climbing")
    flying.until(flying.time + 1.0)
    north, east, _ = flying.place
    flying.go(north, east + 3.0, 2.0)
    flying.until(flying.time + 0.5)
    keep("on the way")
    return found


def watched(step: int, m: bytes, v: bytes) -> list[str]:
    """Goes on from a state with interpreted kernels; returns what is used often."""
    flying = pair()
    flying.step = step
    for record, state in ((flying.m, m), (flying.v, v)):
        record.base.view(np.uint8)[:] = np.frombuffer(state, np.uint8)
    flying.m = Watched(flying.m)
    return used_often(flying)


def test_most_steps_use_no_rare_variable(tmp_path: Path) -> None:
    """Compiled kernels do not tell; so the steps that count are made in a process that compiles nothing."""
    (tmp_path / "states").write_bytes(pickle.dumps(flight()))
    run = subprocess.run(
        [sys.executable, "-m", "tests.models.autopilot.test_rare_memory", str(tmp_path / "states")],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {"on the ground": [], "climbing": [], "on the way": []}


if __name__ == "__main__":
    states = pickle.loads(Path(sys.argv[1]).read_bytes())
    print(json.dumps({phase: watched(*state) for phase, state in states.items()}))
