"""The drone of docs/large-swarms.md, as printed: its own law is built, and its drones meet."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cosim.build import build, load_models
from cosim_master.system.authoring.swarm.new import new_system
from tests.scenarios.flights import fly

PAGE = Path(__file__).parents[3] / "docs" / "large-swarms.md"


def test_a_drone_with_an_own_law(fmus: Path, tmp_path: Path) -> None:
    (source,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (tmp_path / "meeting.py").write_text(source, encoding="utf-8")
    (model,) = load_models(str(tmp_path / "meeting.py"))
    fmu = build(model, tmp_path).file
    system = new_system("flocking-points", 4, tmp_path / "system", fleet={"vehicle": (str(fmu),)})
    flight = fly(system, tmp_path / "out", until=60.0)
    ways = np.array([[flight[f"drone{i}.vehicle.position[{k}]"] for k in (1, 2)] for i in range(1, 5)])
    spread = np.linalg.norm(ways - ways.mean(axis=0), axis=1).max(axis=0)
    assert spread[0] > 5.0
    assert spread[-1] < 0.1 * spread[0]
