"""The cost of an airspace per vehicle: one step of `LargeAirspace` with each of its effects, by number of vehicles.

Vehicles stand on a grid of 5 m, 6 m above the ground, so that their density does not depend on their number. A step is
that of the airspace, 5 ms of simulated time; the fastest of several blocks of steps counts.

    python benchmarks/airspace.py [--vehicles 64 256 1024 4096] [--json FILE]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from report import machine, show, write

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cosim_models.environment.airspace import LARGE, LargeAirspace
from tests.models.shipped_kernels import kernels

STEP = 0.005
EFFECTS: dict[str, dict[str, Any]] = {
    "off": {},
    "turbulence": {"turbulence_wind": 6.0},
    "wakes": {"downwash": True},
    "ground effect": {"ground_effect": True},
    "contact": {"contact": True},
    "all": {"turbulence_wind": 6.0, "downwash": True, "ground_effect": True, "contact": True},
}
BLOCKS = 7


def cost(count: int, effects: dict[str, Any]) -> float:
    """Wall-clock time of a step per vehicle [us]."""
    start, advance = kernels(LargeAirspace)
    m = LargeAirspace.record()
    m.count, m.mean_wind[0] = count, 3.0
    for name, value in effects.items():
        m[name] = value
    if start(m) != 0:
        raise RuntimeError("the airspace does not start")
    side = int(np.ceil(np.sqrt(count)))
    north, east = np.divmod(np.arange(count), side)
    m.position[: 3 * count] = np.stack([5.0 * north, 5.0 * east, np.full(count, -6.0)], axis=1).ravel()
    steps = max(8 * LARGE // count, 8)
    found = []
    for block in range(BLOCKS):
        begin = time.perf_counter()
        for k in range(steps):
            if advance(m, (block * steps + k) * STEP, STEP) != 0:
                raise RuntimeError("the airspace does not step")
        found.append((time.perf_counter() - begin) / steps / count * 1e6)
    return min(found)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[64, 256, 1024, LARGE])
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    rows = {name: [cost(count, effects) for count in options.vehicles] for name, effects in EFFECTS.items()}
    host = machine()
    cells = [[name, *(f"{one:.3f}" for one in row)] for name, row in rows.items()]
    show("Airspace", host, ["effects", *map(str, options.vehicles)], cells, "us per vehicle and step of 5 ms")
    write(options.json, host, {"vehicles": options.vehicles, "rows": rows})


if __name__ == "__main__":
    main()
