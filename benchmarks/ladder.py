"""The fidelity ladder: how far the point mass is from the 6-DoF drone, and that from ArduCopter, on the same moves.

Four rungs fly each recorded move of ArduCopter (tests/data/arducopter, or files in that format):

    ArduCopter  as recorded, on a rigid body
    6-DoF       `Autopilot` with `Quadrotor`, whose preset is that body (as `benchmarks.fidelity`)
    linear      `Autopilot` with `LinearQuadrotor`, the same body linearised at hover
    point mass  `IdealAutopilot` with `PointMass`

For each rung: times to half and to 90 % of the way, greatest speed along it, overshoot, and the distances of its path
from that of the 6-DoF drone and from ArduCopter's (root mean square over the move, and greatest). Take-offs have no
target and are left out.

    python -m benchmarks.ladder [FLIGHT.csv ...] [--json FILE]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity import along, fly, heading_of, parameters_of, preset_of
from benchmarks.flights import Flight, read
from benchmarks.report import machine, show, write
from cosim_models.autopilot.ideal_autopilot import IdealAutopilot
from cosim_models.vehicles.linear_quadrotor import LinearQuadrotor
from cosim_models.vehicles.point_mass import PointMass
from tests.models.copter import GUIDED, RECORDINGS
from tests.models.pair import ACCEPTED, Pair

Path3 = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times [s] since the command, and positions [n x 3, m, NED] from the first one."""
RUNGS = ("ArduCopter", "6-DoF", "linear", "point mass")
FROM = {"drone": "6-DoF", "arducopter": "ArduCopter"}
FIGURES = ("t50", "t90", "vmax", "overshoot")
SET_MODE, ARM, TAKEOFF, SPEED = 176, 400, 22, 178


def linearised(body: dict[str, Any]) -> dict[str, Any]:
    """The parameters of `LinearQuadrotor` for those of a `Quadrotor`: its rotors at the same distance, on the axes."""
    same = ("mass", "inertia[1]", "inertia[2]", "inertia[3]", "thrust_constant", "moment_constant")
    arm = float(np.mean([math.hypot(body[f"rotor_x[{i}]"], body[f"rotor_y[{i}]"]) for i in range(1, 5)]))
    return {**{name: body[name] for name in same}, "arm": arm, "speed_min": 0.0, "speed_max": body["speed_max"]}


def fly_point(flight: Flight) -> NDArray[np.float64]:
    """The point mass: rows of time and position [NED] from the command on."""
    pilot = {name: value for name, value in parameters_of(flight).items() if name == "WPNAV_SPEED"}
    p = Pair(PointMass, IdealAutopilot, values={"yaw_start": heading_of(flight)}, pilot=pilot)
    p.until(2.5)
    height = max(1.0, -float(flight.real["d"][0]))
    for command in ((SET_MODE, 1, GUIDED), (ARM, 1), (TAKEOFF, 0, 0, 0, 0, 0, 0, height)):
        assert p.ask(*command) == ACCEPTED
    p.until(p.time + 25.0)
    assert flight.target is not None
    if flight.speed is not None:
        assert p.ask(SPEED, 1, flight.speed, -1) == ACCEPTED
    n, e, d = np.array(p.place) + flight.target - [flight.real[f"des_{axis}"][0] for axis in "ned"]
    begin, rows = p.time, []
    p.go(float(n), float(e), -float(d))
    while p.time < begin + float(flight.real["t"][-1]):
        p.one_step()
        rows.append([p.time - begin, *p.place])
    return np.array(rows)


def paths(flight: Flight) -> dict[str, Path3]:
    """The path of each rung."""
    real = flight.real
    recorded = np.column_stack([real["t"], *(real[axis] for axis in "ned")])
    linear = fly(flight, {}, LinearQuadrotor, linearised(preset_of(flight)), true=True)
    flown = (recorded, fly(flight, {}, true=True), linear, fly_point(flight))
    return {rung: (rows[:, 0], rows[:, 1:4] - rows[0, 1:4]) for rung, rows in zip(RUNGS, flown, strict=True)}


def gap(of: Path3, to: Path3, times: NDArray[np.float64]) -> tuple[float, float]:
    """Root mean square and greatest distance [m] of two paths at these times."""
    a, b = (np.column_stack([np.interp(times, time, place[:, i]) for i in range(3)]) for time, place in (of, to))
    distance = np.linalg.norm(a - b, axis=1)
    return float(np.sqrt(np.mean(distance**2))), float(distance.max())


def climb(flight: Flight) -> list[dict[str, Any]]:
    """One row per rung of a move: its figures and its distances."""
    assert flight.target is not None
    real, found = flight.real, paths(flight)
    way = flight.target - np.array([real[axis][0] for axis in "ned"])
    ideal = flight.target - np.array([real[f"des_{axis}"][0] for axis in "ned"])
    rows: list[dict[str, Any]] = []
    for i, (rung, (time, place)) in enumerate(found.items()):
        figures = along(time, place, way if i == 0 else ideal)
        row: dict[str, Any] = {"move": flight.name, "rung": rung, **{name: figures[name] for name in FIGURES}}
        for name, other in FROM.items():
            row[f"rms_{name}"], row[f"farthest_{name}"] = gap(found[rung], found[other], real["t"])
        rows.append(row)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("flights", nargs="*", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    flights = [read(path) for path in options.flights or sorted(RECORDINGS.glob("*.csv.gz"))]
    rows = [row for flight in flights if flight.target is not None for row in climb(flight)]
    distances = tuple(f"{kind}_{name}" for name in FROM for kind in ("rms", "farthest"))
    names = (*FIGURES, *distances)
    table = [[f"{row['move']}: {row['rung']}", *(f"{row[name]:.2f}" for name in names)] for row in rows]
    for rung in RUNGS[1:] if rows else ():
        own = [[row[name] for name in distances] for row in rows if row["rung"] == rung]
        table.append([f"mean: {rung}", *("",) * len(FIGURES), *(f"{x:.2f}" for x in np.mean(own, axis=0))])
    host = machine()
    note = "t50, t90 in s, vmax in m/s; drone, arducopter: distance from the path of 6-DoF and of ArduCopter in m"
    show("Fidelity ladder", host, ("move: rung", *(name.replace("_", " ") for name in names)), table, note)
    write(options.json, host, {"benchmark": "ladder", "rows": rows})


if __name__ == "__main__":
    main()
