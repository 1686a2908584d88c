"""Flights of ArduCopter against ours: the same commands on the same body, and how the motions differ.

Takes recorded flights (CSV, or CSV compressed by gzip, in the format of tests/data/arducopter): a first line of JSON
after "# " with the target, then columns t, n, e, d, vn, ve, vd, yaw, des_n, des_e, des_d [s, m, m/s, degrees, NED],
t = 0 when the target was taken. Take-offs have no target. Names that begin with `json` flew on the body of the preset
ardupilot_json, those that begin with `x` on ArduPilot's own (ardupilot_sitl_quad); `noyaw` in a name means
WP_YAW_BEHAVIOR 0, `3mps` WPNAV_SPEED 300; "speed" in the first line means a DO_CHANGE_SPEED before the move. Other
parameters of the autopilot: --set. `benchmarks.record` records more of them.

    python -m benchmarks.fidelity [FLIGHT.csv ...] [--set WPNAV_ACCEL=100 ...]
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import Model
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.copter import GUIDED, RECORDED_AUTOPILOT, RECORDINGS, Copter, H, preset

Columns = dict[str, NDArray[np.float64]]
SHARES = (0.1, 0.5, 0.9)
HEIGHTS = (0.05, 0.5, 5.0, 9.0)
ARMED_BEFORE = {"json": 1.8675, "x": 1.26}
"""Time in s between arming and the command of the recorded take-offs: the motors start 2 s after arming."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A recorded flight: its name, the target (NED; None: a take-off), the columns, and a speed [m/s] if it had one."""

    name: str
    target: NDArray[np.float64] | None
    real: Columns
    speed: float | None = None

    @property
    def body(self) -> str:
        return "x" if self.name.startswith("x") else "json"


def read(path: Path) -> Flight:
    """A recorded flight.

    Raises:
        ValueError: the file has no such first line or lacks columns.
    """
    data = path.read_bytes()
    lines = (gzip.decompress(data) if path.suffix == ".gz" else data).decode().splitlines()
    if not lines or not lines[0].startswith("# {"):
        raise ValueError(f"{path}:1: no flight begins without a line of JSON after '# '")
    head = json.loads(lines[0][2:])
    table = np.array([[float(x) for x in line.split(",")] for line in lines[2:]])
    real = dict(zip(lines[1].split(","), table.T, strict=True))
    if missing := {"t", "n", "e", "d", "vn", "ve", "vd", "yaw", "des_n", "des_e", "des_d"} - set(real):
        raise ValueError(f"{path}:2: columns {', '.join(sorted(missing))} are missing")
    target = np.array(head["target"]) if "target" in head else None
    return Flight(path.name.removesuffix(".gz").removesuffix(".csv"), target, real, head.get("speed"))


def parameters_of(flight: Flight) -> dict[str, Any]:
    """The autopilot's parameters of a recorded flight."""
    values: dict[str, Any] = dict(RECORDED_AUTOPILOT)
    if "noyaw" in flight.name:
        values["WP_YAW_BEHAVIOR"] = 0
    if "3mps" in flight.name:
        values["WPNAV_SPEED"] = 300.0
    return values


def preset_of(flight: Flight) -> dict[str, Any]:
    """The parameters of the `Quadrotor` that is the body of a recorded flight."""
    return preset("ardupilot_json" if flight.body == "json" else "ardupilot_sitl_quad")


def heading_of(flight: Flight) -> float:
    """The heading at the command [rad]."""
    return math.radians((float(flight.real["yaw"][0]) + 180.0) % 360.0 - 180.0)


def fly(
    flight: Flight, parameters: dict[str, float], model: type[Model] = Quadrotor, body: dict[str, Any] | None = None
) -> NDArray[np.float64]:
    """Ours: rows of time, position and velocity [NED] from the command on.

    Args:
        parameters: of the autopilot, beside those of the flight.
        model, body: vehicle and its parameters; by default the body of the flight.
    """
    vehicle = {**(preset_of(flight) if body is None else body), "yaw_start": heading_of(flight)}
    copter = Copter(model, autopilot={**parameters_of(flight), **parameters}, vehicle=vehicle)
    copter.run(3.0)
    copter.ask(176, 1, GUIDED)
    copter.ask(400, 1)
    copter.run(ARMED_BEFORE[flight.body] - 2 * H)
    duration = float(flight.real["t"][-1])
    if flight.target is None:
        copter.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    else:
        copter.command(22, 0, 0, 0, 0, 0, 0, max(1.0, -float(flight.real["d"][0])))
        copter.run(25.0)
        if flight.speed is not None:  # it holds from the first target on, not from the take-off
            copter.go(*(float(x) for x in copter.m["desired_position"]))
            copter.run(1.0)
            copter.ask(178, 1, flight.speed, -1)
        desired = np.array([flight.real[f"des_{axis}"][0] for axis in "ned"])
        n, e, d = copter.m["desired_position"] + flight.target - desired
        copter.go(float(n), float(e), float(d))
    rows = copter.run(duration)
    rows[:, 0] -= rows[0, 0] - H
    return rows[:, :7]


def _first(time: NDArray[np.float64], reached: NDArray[np.bool_]) -> float:
    return float(time[np.argmax(reached)]) if reached.any() else math.nan


def along(time: NDArray[np.float64], position: NDArray[np.float64], target: NDArray[np.float64]) -> dict[str, float]:
    """Figures of one move: `position` [n x 3, m] from where it began, `target` [3, m] from there too."""
    way = float(np.linalg.norm(target))
    gone = position @ (target / way)
    off = np.linalg.norm(position - target, axis=1)
    away = np.flatnonzero(off > 0.2)
    speed = np.gradient(gone, time)
    figures = {f"t{round(100 * share)}": _first(time, gone >= share * way) for share in SHARES}
    return {
        **figures,
        "overshoot": float(gone.max() - way),
        "settled": float(time[away[-1]]) if len(away) else 0.0,
        "vmax": float(speed.max()),
        "end": float(off[-1]),
    }


def upwards(time: NDArray[np.float64], position: NDArray[np.float64]) -> dict[str, float]:
    """Figures of a take-off."""
    up = -position[:, 2]
    figures = {f"to {height:g} m": _first(time, up >= height) for height in HEIGHTS}
    return {**figures, "highest": float(up.max()), "vmax": float(np.gradient(up, time).max())}


def compare(flight: Flight, rows: NDArray[np.float64]) -> dict[str, tuple[float, float]]:
    """Each figure as ArduCopter's and ours; `rms` and `farthest` are the distance [m] between the two."""
    real = flight.real
    true = np.column_stack([real[axis] - real[axis][0] for axis in "ned"])
    ours = rows[:, 1:4] - rows[0, 1:4]
    if flight.target is None:
        theirs, mine = upwards(real["t"], true), upwards(rows[:, 0], ours)
    else:
        begin = np.array([real[axis][0] for axis in "ned"])
        desired = np.array([real[f"des_{axis}"][0] for axis in "ned"])
        theirs = along(real["t"], true, flight.target - begin)
        mine = along(rows[:, 0], ours, flight.target - desired)
    there = np.column_stack([np.interp(real["t"], rows[:, 0], ours[:, i]) for i in range(3)])
    gap = np.linalg.norm(there - true, axis=1)
    found = {name: (theirs[name], mine[name]) for name in theirs}
    return {**found, "rms": (0.0, float(np.sqrt(np.mean(gap**2)))), "farthest": (0.0, float(gap.max()))}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("flights", nargs="*", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args(arguments)
    parameters = {name: float(value) for name, _, value in (pair.partition("=") for pair in options.set)}
    for path in options.flights or sorted(RECORDINGS.glob("*.csv.gz")):
        flight = read(path)
        print(f"{flight.name}: ArduCopter | ours")
        for name, (theirs, mine) in compare(flight, fly(flight, parameters)).items():
            share = f"  {100 * (mine / theirs - 1):+5.1f} %" if theirs else ""
            print(f"  {name:10} {theirs:8.3f} {mine:8.3f}{share}")


if __name__ == "__main__":
    main()
