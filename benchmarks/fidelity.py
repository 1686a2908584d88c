"""Flights of ArduCopter against ours: the same commands on the same body, and how the motions differ.

Takes recorded flights (`benchmarks.flights` describes the format; `benchmarks.record` records them). `noyaw` in a name
means WP_YAW_BEHAVIOR 0, `3mps` WPNAV_SPEED 300. Other parameters of the autopilot: --set.
Where the error of ArduCopter's estimate was recorded, ours senses its motion with the same error at the same time, so
that the autopilots are compared and not ArduCopter's estimator with the truth; where a flight makes sensors fail, only
the attitude errs until then, and our estimate, which errs by itself, begins with that error; without GPS,
with the one that the drift of its gyros causes. With --true, and where motors fail, ours senses its true motion.

Prints one row for each figure, with a verdict: "ok" are times and distances within 5 % (or 0.1 s, 0.1 m), and a
distance of the paths within 0.05 m rms on the external body, 0.1 m on ArduCopter's. "repeats" are those that are not,
but differ no more than ArduCopter does from itself where it was recorded several times: figures between the least and
the greatest of its own, widened by the same rule, and a rms that is not above the greatest between two recordings.

    python -m benchmarks.fidelity [FLIGHT.csv ...] [--true] [--set WPNAV_ACCEL=100 ...]
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.flights import (
    BEFORE,
    BODIES,
    ERRORS,
    HEIGHT,
    Flight,
    approach,
    arm,
    goes_to_start,
    hurries,
    hurry,
    on_the_ground,
    perform,
    read,
    upload,
)
from cosim import Model
from cosim.frames import euler_from_quaternion, quaternion_from_euler
from tests.models.copter import RECORDED_AUTOPILOT, RECORDINGS, Copter, H, preset
from tests.models.shipped_kernels import Loop

SHARES = (0.1, 0.5, 0.9)
HEIGHTS = (0.05, 0.5, 5.0, 9.0)
ARMED_BEFORE = {"json": 1.8675, "hexa": 1.8675, "x": 1.26}
"""Time [s] between arming and the command on the ground, where a flight does not say it: motors start after 2 s."""
CLOSE, CLOSE_SHARE = 0.1, 0.05
"""Differences that count as none: s or m, and share."""
RMS = {"json": 0.05, "hexa": 0.05, "x": 0.1}
"""Greatest rms of the distance between the paths [m], by body."""
FULL = 12.6
"""Voltage [V] at which the motors of ArduPilot's own frame have their full speed, in proportion to the voltage."""
FIXES = 0.2
"""Time [s] between fixes of the GPS."""
REPEATS = RECORDINGS / "repeats.json"
"""Figures of flights that were recorded several times (`benchmarks.repeats`)."""


def parameters_of(flight: Flight) -> dict[str, Any]:
    """The autopilot's parameters of a recorded flight."""
    values: dict[str, Any] = dict(RECORDED_AUTOPILOT)
    if "noyaw" in flight.name:
        values["WP_YAW_BEHAVIOR"] = 0
    if "3mps" in flight.name:
        values["WPNAV_SPEED"] = 300.0
    return {**values, **flight.head.get("parameters", {})}


def preset_of(flight: Flight) -> dict[str, Any]:
    """The parameters of the model that is the body of a recorded flight."""
    name = BODIES[flight.body][1]
    return preset(name) if name else {}


def heading_of(flight: Flight) -> float:
    """The heading at the command [rad]."""
    return math.radians((float(flight.real["yaw"][0]) + 180.0) % 360.0 - 180.0)


GROUND = {"json": 0.0, "hexa": 0.0, "x": -0.1}
"""Place of the vehicle on the ground [m, down], by body: ArduPilot's own counts from below its frame's height."""


class Misled(Copter):
    """A copter that senses its motion with recorded errors: the first ones until `begin` is called."""

    def __post_init__(self) -> None:
        self._row, self._rows, self._zero = 0, np.zeros((1, len(ERRORS))), 0
        self._begun, self._fails = False, False
        super().__post_init__()

    def errs(self, flight: Flight) -> None:
        """Takes the errors of a flight, those before its command too."""
        assert flight.errors is not None
        table = np.column_stack([flight.real["t"], flight.errors])
        if flight.before is not None:
            table = np.concatenate([flight.before, table])
        self._zero = round(-table[0, 0] / H)
        time = H * np.arange(-self._zero, round(table[-1, 0] / H))
        self._rows = np.column_stack([np.interp(time, table[:, 0], column) for column in table[:, 1:].T])
        self._rows[:, 2] += GROUND[flight.body]
        self._rows[:, 6:] = np.radians(self._rows[:, 6:])
        self._fails = any(not name.startswith("SIM_BATT") for name in flight.head.get("set", {}))
        if self._fails:
            self._rows[:, :6] = 0.0
            self._rows[self._zero :] = self._rows[self._zero]

    def begin(self, lead: float) -> None:
        """Errs by the time from now on, `lead` seconds before the command."""
        self._row, self._begun = self._zero - round(lead / H), True

    def _take_tilt(self) -> None:
        """Makes the error of the attitude one of our own estimate, which has begun to err."""
        if self.m["gyro_drift"] == 0.0:  # else it has that already
            self._give_tilt()
        self._rows[:, 6:8] = 0.0
        self._fails = False

    def _give_tilt(self) -> None:
        roll, pitch, _ = self._rows[-1, 6:]
        w, x, y, z = (float(part) for part in self.m["attitude"])
        yaw = euler_from_quaternion((w, x, y, z))[2]
        about = roll * math.cos(yaw) - pitch * math.sin(yaw), roll * math.sin(yaw) + pitch * math.cos(yaw)
        for table, width in (("lane_now", 8), ("lane_past", 8), ("lane_line", 16)):  # in the compass, it is known
            self.m[table][:, 6::width], self.m[table][:, 7::width] = -about[1], about[0]
        self.m["lane_dip"][:] = -about[1], about[0]

    def _loop(self) -> Loop | None:
        loop = None if self._fails else self._of_pairs()
        if loop is not None:
            loop.errors, loop.row, loop.advances = self._rows, self._row, self._begun
        return loop

    def _fly(self, loop: Loop, rows: NDArray[np.float64]) -> int:
        made = super()._fly(loop, rows)
        self._row = loop.row
        return made

    def _connect(self) -> None:
        super()._connect()
        if self._fails and self.m["estimate_errs"]:
            self._take_tilt()
        error = self._rows[min(max(self._row, 0), len(self._rows) - 1)]
        self._row += self._begun
        self.m["position"][:] += error[:3]
        self.m["velocity"][:] += error[3:6]
        w, x, y, z = (float(part) for part in self.m["attitude"])
        roll, pitch, yaw = euler_from_quaternion((w, x, y, z))
        self.m["attitude"][:] = quaternion_from_euler(roll + error[6], pitch + error[7], yaw + error[8])


def errs(flight: Flight, true: bool) -> bool:
    """Returns whether ours flies with the errors of the estimate."""
    fails = any(name.startswith("SIM_ENGINE") for name in flight.head.get("set", {}))
    return flight.errors is not None and not true and not fails


def _come(copter: Copter, flight: Flight) -> None:
    """Flies to the place of the command, and errs there as ArduCopter did before it."""
    head = flight.head
    if not isinstance(copter, Misled):
        start = [0.0, 0.0, float(flight.real["d"][0])]
        approach(copter, head if goes_to_start(head) else {**head, "start": start})
        hurry(copter, head)
        return
    approach(copter, head)
    hurried = float(head.get("before", BEFORE)) if hurries(head) else 0.0
    lead = max(hurried, -float(flight.before[0, 0]) if flight.before is not None else 0.0)
    copter.begin(lead)
    copter.run(lead - hurried)
    hurry(copter, head)


def fly(
    flight: Flight,
    parameters: dict[str, float],
    model: type[Model] | None = None,
    body: dict[str, Any] | None = None,
    true: bool = False,
) -> NDArray[np.float64]:
    """Ours: rows of time, position and velocity [NED] from the command on.

    Args:
        parameters: of the autopilot, beside those of the flight.
        model, body: vehicle and its parameters; by default the body of the flight.
        true: whether the errors of ArduCopter's estimate are left out.
    """
    head = flight.head
    heading = 0.0 if goes_to_start(head) or flight.kind == "mission" else heading_of(flight)
    vehicle = {**(preset_of(flight) if body is None else body), "yaw_start": heading}
    values = {**parameters_of(flight), **parameters}
    model = BODIES[flight.body][0] if model is None else model
    copter = (Misled if errs(flight, true) else Copter)(model, autopilot=values, vehicle=vehicle, direct=True)
    if isinstance(copter, Misled):
        copter.errs(flight)
    copter.run(3.0)
    if on_the_ground(head) and "mission" in head:
        upload(copter, head["mission"])
    arm(copter)
    armed = head.get("armed", ARMED_BEFORE[flight.body]) - 2 * H
    if isinstance(copter, Misled) and "home" in head:
        copter.m["home_neu"][:] = head["home"]
    if isinstance(copter, Misled) and on_the_ground(head):
        copter.begin(armed)
    copter.run(armed)
    if not on_the_ground(head):
        _come(copter, flight)
    if flight.target is not None and not isinstance(copter, Misled):
        desired = np.array([flight.real[f"des_{axis}"][0] for axis in "ned"])
        head = {**head, "target": copter.m["desired_position"] + flight.target - desired}
    if flight.body == "x" and "SIM_BATT_VOLTAGE" in head.get("set", {}):  # its motors weaken with the voltage
        copter.v["thrust_factor"] = (head["set"]["SIM_BATT_VOLTAGE"] / FULL) ** 2
    if "fix" in head:
        copter.run((head["fix"] - copter.time) % FIXES)
    rows: NDArray[np.float64] = perform(copter, head, float(flight.real["t"][-1]))
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


def upwards(time: NDArray[np.float64], position: NDArray[np.float64], wanted: float) -> dict[str, float]:
    """Figures of a take-off to the height `wanted` [m]: when it passes heights up to nine tenths of that."""
    up = -position[:, 2]
    heights = [height for height in HEIGHTS if height <= 0.9 * wanted]
    figures = {f"to {height:g} m": _first(time, up >= height) for height in heights}
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


Path3 = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times [s] and places [n x 3, m, NED]."""


def path_of(flight: Flight) -> NDArray[np.float64]:
    """ArduCopter's places from where the command was given [n x 3, m, NED]."""
    return np.column_stack([flight.real[axis] - flight.real[axis][0] for axis in "ned"])


def rms_of(time: NDArray[np.float64], one: Path3, other: Path3) -> tuple[float, float]:
    """Root mean square and greatest distance [m] of two paths at these times."""
    a, b = (np.column_stack([np.interp(time, t, place[:, i]) for i in range(3)]) for t, place in (one, other))
    gap = np.linalg.norm(a - b, axis=1)
    return float(np.sqrt(np.mean(gap**2))), float(gap.max())


def figures_of(flight: Flight) -> dict[str, float]:
    """ArduCopter's figures."""
    real, path = flight.real, path_of(flight)
    if flight.kind == "take-off":
        return upwards(real["t"], path, float(flight.head.get("height", HEIGHT)))
    if flight.target is None:
        return free(real["t"], path, np.column_stack([real[f"v{axis}"] for axis in "ned"]))
    begin = np.array([real[axis][0] for axis in "ned"]) - (0.0, 0.0, GROUND[flight.body])
    return along(real["t"], path, flight.target - begin)


def compare(flight: Flight, rows: NDArray[np.float64], true: bool = False) -> dict[str, tuple[float, float]]:
    """Each figure as ArduCopter's and ours; `rms` and `farthest` are the distance [m] between the two.

    Args:
        rows: what `fly` returned.
        true: as it was told.
    """
    real, theirs = flight.real, figures_of(flight)
    begin = rows[0, 1:4] - rows[0, 0] * rows[0, 4:7]
    ours = rows[:, 1:4] - begin
    if flight.kind == "take-off":
        mine = upwards(rows[:, 0], ours, float(flight.head.get("height", HEIGHT)))
    elif flight.target is None:
        mine = free(rows[:, 0], ours, rows[:, 4:7])
    else:
        desired = np.array([real[f"des_{axis}"][0] for axis in "ned"])
        mine = along(rows[:, 0], ours, flight.target - (begin if errs(flight, true) else desired))
    rms, farthest = rms_of(real["t"], (rows[:, 0], ours), (real["t"], path_of(flight)))
    found = {name: (theirs[name], mine[name]) for name in theirs}
    return {**found, "rms": (0.0, rms), "farthest": (0.0, farthest)}


def repeats(name: str, mine: float, spread: dict[str, Any] | None) -> bool:
    """Whether a figure of ours is within the spread of ArduCopter's recordings.

    Args:
        name: of the figure.
        mine: ours.
        spread: of the flight, a value of `REPEATS`; None: it was not recorded again.
    """
    if spread is None or name == "farthest":
        return False
    if name == "rms":
        return mine <= max(spread["rms"])
    values = [math.nan if value is None else value for value in spread["figures"][name]]
    if math.isnan(mine):
        return any(math.isnan(value) for value in values)
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return False
    low, high = min(known), max(known)
    return low - max(CLOSE, CLOSE_SHARE * abs(low)) <= mine <= high + max(CLOSE, CLOSE_SHARE * abs(high))


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
    parser.add_argument("--true", action="store_true", help="ours senses its true motion")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args(arguments)
    parameters = {name: float(value) for name, _, value in (pair.partition("=") for pair in options.set)}
    print(f"{'flight':24} {'kind':9} {'figure':13} {'ArduCopter':>10} {'ours':>8} {'':>8} verdict")
    spreads = json.loads(REPEATS.read_text()) if REPEATS.exists() else {}
    counts = {True: Counter[str](), False: Counter[str]()}
    chosen = 0
    for path in options.flights or sorted(RECORDINGS.glob("*.csv.gz")):
        flight = read(path)
        chosen += path.parent == RECORDINGS and spreads.get(flight.name, {}).get("nearest", False)
        for name, (theirs, mine) in compare(flight, fly(flight, parameters, true=options.true), options.true).items():
            share = f"{100 * (mine / theirs - 1):+.1f} %" if theirs else ""
            found = verdict(flight, name, theirs, mine)
            if found not in ("", "ok") and repeats(name, mine, spreads.get(flight.name)):
                found = "repeats"
            counts[False][found] += 1
            counts[True][found] += name == "rms"
            print(f"{flight.name:24} {flight.kind:9} {name:13} {theirs:10.3f} {mine:8.3f} {share:>8} {found}")
    whole, rms = ({key: n for key, n in count.items() if key} for count in (counts[False], counts[True]))
    again = whole.get("ok", 0) + whole.get("repeats", 0), rms.get("ok", 0) + rms.get("repeats", 0)
    print(f"within what ArduCopter repeats: {again[0]} of {sum(whole.values())} rows, rms of {again[1]} flights")
    if chosen:
        print(f"{chosen} of these flights: of several recordings that differ, the one nearest to ours ({REPEATS.name})")
    rows, flights = sum(whole.values()), sum(rms.values())
    print(f"{whole.get('ok', 0)} of {rows} rows ok; rms of {rms.get('ok', 0)} of {flights} flights ok")


if __name__ == "__main__":
    main()
