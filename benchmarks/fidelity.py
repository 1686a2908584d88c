"""Flights of ArduCopter against ours: the same commands on the same body, and how the motions differ.

Takes recorded flights (CSV, or CSV compressed by gzip, in the format of tests/data/arducopter): a first line of JSON
after "# " with the command, then columns t, n, e, d, vn, ve, vd, yaw, des_n, des_e, des_d [s, m, m/s, degrees, NED],
t = 0 when the command was taken. Commands:

    {"target": [n, e, d]}                a move [m NED]; "speed" means a DO_CHANGE_SPEED before it
    {"type": 4, "vel": [n, e, d]}        a velocity [m/s], ten times a second for "lasts" s (default: to the end)
    {"type": 5, "accel": [n, e, d]}      an acceleration [m/s2], likewise
    {"type": 6, "attitude": [r, p, y]}   an attitude [degrees], likewise; "climb" [m/s]
    {"mode": 6}                          a change to a mode of ArduCopter, at "start" [m NED], where "vel" was flown
    {"mission": [[command, p1, n, e, up], ...]}   a mission in AUTO [m], from the ground or from "start"
    {}                                   a take-off to 10 m

"type" is that of ArduCopter's GUIP messages (2: a position). Names that begin with `json` flew on the body of the
preset ardupilot_json, those that begin with `x` on ArduPilot's own (ardupilot_sitl_quad); `noyaw` in a name means
WP_YAW_BEHAVIOR 0, `3mps` WPNAV_SPEED 300. Other parameters of the autopilot: --set. `benchmarks.record` records moves.
Prints one row for each figure, with a verdict: times and distances within 5 % (or 0.1 s, 0.1 m), rms of the distance
between the paths within 0.05 m on the external body, 0.1 m on ArduCopter's.

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
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim.frames import quaternion_from_euler
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.autopilot.test_autopilot_missions import item, upload
from tests.models.copter import (
    GUIDED,
    ONLY_ACCELERATION,
    ONLY_VELOCITY,
    RECORDED_AUTOPILOT,
    RECORDINGS,
    Copter,
    H,
    preset,
)

Columns = dict[str, NDArray[np.float64]]
SET_MODE, ARM, TAKE_OFF = (
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_NAV_TAKEOFF,
)
CHANGE_SPEED, WAYPOINT = mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_NAV_WAYPOINT
SHARES = (0.1, 0.5, 0.9)
HEIGHTS = (0.05, 0.5, 5.0, 9.0)
ARMED_BEFORE = {"json": 1.8675, "x": 1.26}
"""Time in s between arming and the command of the recorded take-offs: the motors start 2 s after arming."""


MOVE, VELOCITY, ACCELERATION, ATTITUDE = 2, 4, 5, 6
"""Commands in GUIDED, by the type of ArduCopter's GUIP."""
NEEDED = {VELOCITY: "vel", ACCELERATION: "accel", ATTITUDE: "attitude"}
CLOSE, CLOSE_SHARE = 0.1, 0.05
"""Differences that count as none: s or m, and share."""
RMS = {"json": 0.05, "x": 0.1}
"""Greatest rms of the distance between the paths [m], by body."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A recorded flight: its name, the target (NED; None: no move), the columns, and the first line."""

    name: str
    target: NDArray[np.float64] | None
    real: Columns
    head: dict[str, Any]

    @property
    def speed(self) -> float | None:
        """The speed [m/s] that was commanded before a move."""
        return self.head.get("speed")

    @property
    def kind(self) -> str:
        if self.target is not None:
            return "move"
        if "mode" in self.head or "mission" in self.head:
            return "mode" if "mode" in self.head else "mission"
        return "set-point" if "type" in self.head else "take-off"

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
    kind = head.get("type", MOVE)
    if kind != MOVE and (kind not in NEEDED or NEEDED[kind] not in head):
        raise ValueError(f"{path}:1: type {kind}: there are 2 (target), 4 (vel), 5 (accel) and 6 (attitude)")
    target = np.array(head["target"]) if "target" in head and kind == MOVE else None
    if kind == MOVE and target is None:
        head.pop("type", None)
    return Flight(path.name.removesuffix(".gz").removesuffix(".csv"), target, real, head)


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
    copter.ask(SET_MODE, 1, GUIDED)
    copter.ask(ARM, 1)
    copter.run(ARMED_BEFORE[flight.body] - 2 * H)
    if flight.kind == "mission" and "start" not in flight.head:
        rows = _fly_mission(copter, flight)
    elif flight.kind == "take-off":
        copter.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 10.0)
        rows = copter.run(_duration(flight))
    else:
        copter.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, max(1.0, -float(flight.real["d"][0])))
        copter.run(25.0)
        rows = _command(copter, flight)
    rows[:, 0] -= rows[0, 0] - H
    return rows[:, :7]


def _duration(flight: Flight) -> float:
    return float(flight.real["t"][-1])


def _command(copter: Copter, flight: Flight) -> NDArray[np.float64]:
    """The command of a flight that begins in the air."""
    if flight.target is not None:
        if flight.speed is not None:  # it holds from the first target on, not from the take-off
            copter.go(*(float(x) for x in copter.m["desired_position"]))
            copter.run(1.0)
            copter.ask(CHANGE_SPEED, 1, flight.speed, -1)
        desired = np.array([flight.real[f"des_{axis}"][0] for axis in "ned"])
        n, e, d = copter.m["desired_position"] + flight.target - desired
        copter.go(float(n), float(e), float(d))
        return copter.run(_duration(flight))
    if flight.kind == "set-point":
        return _repeat(copter, flight, _duration(flight))
    copter.go(*(float(x) for x in flight.head["start"]))
    copter.run(25.0)
    if flight.kind == "mission":
        return _fly_mission(copter, flight)
    if "vel" in flight.head:
        _repeat(copter, flight, 8.0)
    copter.command(SET_MODE, 1, flight.head["mode"])
    return copter.run(_duration(flight))


def _repeat(copter: Copter, flight: Flight, duration: float) -> NDArray[np.float64]:
    """Sends a set-point ten times a second for as long as the flight says."""
    head, rows = flight.head, []
    lasts = float(head.get("lasts", duration))
    for i in range(round(10 * duration)):
        if 0.1 * i < lasts:
            _set_point(copter, head)
        rows.append(copter.run(0.1))
    return np.concatenate(rows)


def _set_point(copter: Copter, head: dict[str, Any]) -> None:
    kind = head.get("type", VELOCITY)
    if kind == VELOCITY:
        vn, ve, vd = head["vel"]
        copter.go(0.0, 0.0, 0.0, ONLY_VELOCITY, vx=vn, vy=ve, vz=vd)
    elif kind == ACCELERATION:
        an, ae, ad = head["accel"]
        copter.go(0.0, 0.0, 0.0, ONLY_ACCELERATION, afx=an, afy=ae, afz=ad)
    else:
        q = quaternion_from_euler(*(math.radians(x) for x in head["attitude"]))
        climb = float(head.get("climb", 0.0))
        thrust = 0.5 + 0.5 * climb / (2.5 if climb > 0.0 else 1.5)  # of WPNAV_SPEED_UP and WPNAV_SPEED_DN
        copter.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, list(q), 0, 0, 0, thrust))


def _fly_mission(copter: Copter, flight: Flight) -> NDArray[np.float64]:
    items = [item(0, WAYPOINT)]
    for i, (command, p1, n, e, up) in enumerate(flight.head["mission"], 1):
        items.append(item(i, int(command), p1, north=n, east=e, z=up))
    if upload(copter, *items)[0].type != mavlink.MAV_MISSION_ACCEPTED:
        raise ValueError(f"{flight.name}: the mission is refused")
    copter.command(SET_MODE, 1, mavlink.COPTER_MODE_AUTO)
    copter.command(mavlink.MAV_CMD_MISSION_START)
    return copter.run(_duration(flight))


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


def free(time: NDArray[np.float64], position: NDArray[np.float64], velocity: NDArray[np.float64]) -> dict[str, float]:
    """Figures of any other flight: when most of its speed and way is reached, its greatest speeds, and its end."""
    fast = np.linalg.norm(velocity, axis=1)
    gone = np.linalg.norm(position - position[0], axis=1)
    resting = np.flatnonzero(fast > 0.1)
    return {
        **{f"v{round(100 * share)}": _first(time, fast >= share * fast.max()) for share in SHARES[1:]},
        **{f"s{round(100 * share)}": _first(time, gone >= share * gone.max()) for share in SHARES[1:]},
        "vmax": float(fast.max()),
        "climb": float(-velocity[:, 2].min()),
        "sink": float(velocity[:, 2].max()),
        "farthest away": float(gone.max()),
        "end away": float(gone[-1]),
        "end up": float(position[0, 2] - position[-1, 2]),
        "at rest": float(time[resting[-1]]) if len(resting) else 0.0,
    }


def compare(flight: Flight, rows: NDArray[np.float64]) -> dict[str, tuple[float, float]]:
    """Each figure as ArduCopter's and ours; `rms` and `farthest` are the distance [m] between the two."""
    real = flight.real
    true = np.column_stack([real[axis] - real[axis][0] for axis in "ned"])
    ours = rows[:, 1:4] - rows[0, 1:4]
    if flight.kind == "take-off":
        theirs, mine = upwards(real["t"], true), upwards(rows[:, 0], ours)
    elif flight.target is None:
        flown = np.column_stack([real[f"v{axis}"] for axis in "ned"])
        theirs, mine = free(real["t"], true, flown), free(rows[:, 0], ours, rows[:, 4:7])
    else:
        begin = np.array([real[axis][0] for axis in "ned"])
        desired = np.array([real[f"des_{axis}"][0] for axis in "ned"])
        theirs = along(real["t"], true, flight.target - begin)
        mine = along(rows[:, 0], ours, flight.target - desired)
    there = np.column_stack([np.interp(real["t"], rows[:, 0], ours[:, i]) for i in range(3)])
    gap = np.linalg.norm(there - true, axis=1)
    found = {name: (theirs[name], mine[name]) for name in theirs}
    return {**found, "rms": (0.0, float(np.sqrt(np.mean(gap**2)))), "farthest": (0.0, float(gap.max()))}


def verdict(flight: Flight, name: str, theirs: float, mine: float) -> str:
    """Whether a figure of ours is ArduCopter's: "ok", "differs", or "missing" where one of them never came."""
    if name == "farthest":
        return ""
    if name == "rms":
        return "ok" if mine <= RMS[flight.body] else "differs"
    if math.isnan(theirs) and math.isnan(mine):
        return "ok"
    if math.isnan(theirs) or math.isnan(mine):
        return "missing"
    return "ok" if abs(mine - theirs) <= max(CLOSE, CLOSE_SHARE * abs(theirs)) else "differs"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("flights", nargs="*", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args(arguments)
    parameters = {name: float(value) for name, _, value in (pair.partition("=") for pair in options.set)}
    print(f"{'flight':24} {'kind':9} {'figure':13} {'ArduCopter':>10} {'ours':>8} {'':>8} verdict")
    rows = good = 0
    for path in options.flights or sorted(RECORDINGS.glob("*.csv.gz")):
        flight = read(path)
        for name, (theirs, mine) in compare(flight, fly(flight, parameters)).items():
            share = f"{100 * (mine / theirs - 1):+.1f} %" if theirs else ""
            found = verdict(flight, name, theirs, mine)
            rows, good = rows + bool(found), good + (found == "ok")
            print(f"{flight.name:24} {flight.kind:9} {name:13} {theirs:10.3f} {mine:8.3f} {share:>8} {found}")
    print(f"{good} of {rows} rows ok")


if __name__ == "__main__":
    main()
