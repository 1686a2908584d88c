"""Records flights of the user's ArduCopter, in the format that `benchmarks.fidelity` takes.

ArduCopter, which the environment variable ARDUPILOT_SITL names, flies each command in a run of its own: on the body of
the preset ardupilot_json, on a hexarotor (`--body hexa`), or on its own physics (`--body x`; the program must lie in
ArduPilot's source tree then).
t = 0 is when its own log says that it took the command; what it desired and where its estimate erred is from its log
too. A flight is either a name
and the first line of a flight (`benchmarks.flights`), or a move NORTH,EAST,DOWN [m] from 10 m above home, where it is
not to be ArduCopter's own speed with @SPEED [m/s]. `--list` is a JSON object of names and first lines.

    ARDUPILOT_SITL=... python -m benchmarks.record FOLDER -- 7,0,0 30,0,0@5 'rtl={"mode": 6, "start": [20, 0, -10]}'
    ARDUPILOT_SITL=... python -m benchmarks.record FOLDER --body x --list tests/data/arducopter/flights.json
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import DFReader_binary

from benchmarks.flights import (
    BEFORE,
    BODIES,
    ERRORS,
    HEIGHT,
    approach,
    arm,
    hurry,
    kind_of,
    on_the_ground,
    perform,
    upload,
)
from benchmarks.own_physics import OwnPhysics
from cosim.frames import EARTH_RADIUS_ARDUPILOT, euler_from_quaternion
from tests.models.copter import preset
from tests.models.real_copter import READY, RealCopter

DURATION = 20.0
"""Time [s] of a flight that says none."""
LAST = 12.0
"""Time [s] after the flight, in which its log comes to the disk."""
ARMED = 1.5
"""Time [s] between arming and a command on the ground."""
RATE = 25.0
"""Rows a second."""
COLUMNS = ",".join(("t,n,e,d,vn,ve,vd,yaw,des_n,des_e,des_d", *ERRORS))
LOGGED = 176127
"""LOG_BITMASK: ArduCopter's default, with the estimate 25 times a second instead of ten."""
EARLY = 20.0
"""Time [s] before the command of which the errors are recorded, too."""
_DEGREE = math.radians(1.0) * EARTH_RADIUS_ARDUPILOT  # m
_TYPES = ("ORGN", "XKF1", "XKQ", "SIM2", "SIM", "PSCN", "PSCE", "PSCD", "GUIP", "GUIA", "MODE", "MAVC", "PARM", "GPS")
_AUTO, _TAKE_OFF, _START, _ARM = 3, 22, 300, 400


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Name and first line of NORTH,EAST,DOWN, NORTH,EAST,DOWN@SPEED, or NAME=HEAD."""
    name, equals, given = text.partition("=")
    if equals:
        head: dict[str, Any] = json.loads(given)
        return name, head
    way, _, speed = text.partition("@")
    north, east, down = map(float, way.split(","))
    name = "_".join(f"{value:g}" for value in (north, east, down))
    head = {"target": [north, east, down - HEIGHT], "start": [0.0, 0.0, -HEIGHT]}
    return (f"{name}_at_{speed}", {**head, "speed": float(speed)}) if speed else (name, head)


@dataclass(slots=True)
class Log:
    """What ArduCopter's log says: rows by type of message, time [s] first.

    Raises:
        ValueError: there is not one log in the folder.
    """

    folder: Path
    rows: dict[str, list[tuple[Any, ...]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        logs = list((self.folder / "logs").glob("*.BIN"))
        if len(logs) != 1:
            raise ValueError(f"{self.folder}: {len(logs)} logs instead of one")
        self.rows = {name: [] for name in _TYPES}
        reader = DFReader_binary(str(logs[0]))
        while (message := reader.recv_match(type=list(_TYPES))) is not None:
            if message.get_type() in ("XKF1", "XKQ") and message.C != 0:  # only the estimator that flies
                continue
            fields = [getattr(message, name) for name in message._fieldnames]
            self.rows[message.get_type()].append((fields[0] / 1e6, *fields[1:]))

    def columns(self, kind: str, time: NDArray[np.float64], *which: int) -> NDArray[np.float64]:
        """Columns of a type of message at the given times."""
        table = np.array([[row[0], *(row[i] for i in which)] for row in self.rows[kind]], dtype=np.float64)
        return np.column_stack([np.interp(time, table[:, 0], table[:, i + 1]) for i in range(len(which))])

    def angles(self, kind: str, time: NDArray[np.float64], first: int) -> NDArray[np.float64]:
        """Roll, pitch and yaw [degrees] at the given times from a quaternion, of which `first` is the first column.

        The angles of the log itself are whole hundredths of a degree.
        """
        table = np.array([(row[0], *row[first : first + 4]) for row in self.rows[kind]], dtype=np.float64)
        found = np.unwrap([_euler(row) for row in table[:, 1:]], axis=0, period=360.0)
        return np.column_stack([np.interp(time, table[:, 0], column) for column in found.T])

    def taken(self, head: dict[str, Any], sent: float, last: bool = False) -> float:
        """When [s] it took the command that was sent at `sent`, for the first or the last time."""
        kind = kind_of(head)
        if kind == "set-point" and head["type"] == 6:
            times = [row[0] for row in self.rows["GUIA"]]
        elif kind in ("set-point", "move"):
            times = [row[0] for row in self.rows["GUIP"]]
        elif kind == "mode" or (kind == "mission" and not on_the_ground(head)):
            wanted = head.get("mode", _AUTO)
            times = [row[0] for row in self.rows["MODE"] if row[2] == wanted]
        elif kind == "failure":
            times = [row[0] for row in self.rows["PARM"] if row[1] in head["set"]]
        else:
            wanted = _TAKE_OFF if kind == "take-off" else _START
            times = [row[0] for row in self.rows["MAVC"] if row[6] == wanted]
        found = [t for t in times if t > sent - 0.3]
        if not found:
            raise ValueError(f"ArduCopter's log has no {kind} after {sent:g} s")
        return float(found[-1 if last else 0])

    def hurried(self, sent: float) -> float:
        """When [s] it took the first velocity that was sent before the command of `sent`."""
        return min(row[0] for row in self.rows["GUIP"] if row[1] == 4 and sent - 2.0 * BEFORE < row[0])

    def fix(self, time: float) -> float:
        """How long [s] before `time` the last fix of GPS came."""
        return time - max(row[0] for row in self.rows["GPS"] if row[0] <= time)

    def armed(self) -> float:
        return float(next(row[0] for row in self.rows["MAVC"] if row[6] == _ARM))

    def home(self) -> list[float]:
        """Where home was after the arming [m, north, east, up], from the origin of the estimate."""
        origin, home = ([row[2:5] for row in self.rows["ORGN"] if row[1] == which][-1] for which in (0, 1))
        scale = math.cos(math.radians(0.5 * (origin[0] + home[0])))
        north, east = (_DEGREE * round(1e7 * (home[i] - origin[i])) * 1e-7 for i in range(2))
        return [round(north, 6), round(east * scale, 6), round(home[2] - origin[2], 2)]


def _euler(attitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees from a quaternion."""
    w, x, y, z = map(float, attitude)
    return np.degrees(euler_from_quaternion((w, x, y, z)))


def heading(attitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees from quaternions."""
    w, x, y, z = attitude.T
    found: NDArray[np.float64] = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    return found


def write(path: Path, head: dict[str, Any], rows: NDArray[np.float64]) -> None:
    """One flight; `rows` have the columns of `COLUMNS`."""
    lines = [f"# {json.dumps(head)}", COLUMNS, *(",".join(f"{x:.6f}" for x in row) for row in rows)]
    path.write_bytes(gzip.compress(("\n".join(lines) + "\n").encode(), mtime=0))


def errors(log: Log) -> NDArray[np.float64]:
    """Rows of time [s] and the errors of the estimate: position and velocity [m, m/s, NED], Euler angles [degrees]."""
    time = np.array([row[0] for row in log.rows["XKF1"]])
    motion = log.columns("XKF1", time, 9, 10, 11, 5, 6, 7) - log.columns("SIM2", time, 1, 2, 3, 4, 5, 6)
    estimate, truth = (log.angles(kind, time, first) for kind, first in (("XKQ", 2), ("SIM", 7)))
    return np.column_stack([time, motion, (estimate - truth + 180.0) % 360.0 - 180.0])


def flown(
    log: Log, truth: NDArray[np.float64] | None, begin: float, duration: float, early: float = 0.0
) -> NDArray[np.float64]:
    """Rows from `early` seconds before `begin` on.

    From `begin` on, they are those of the motion (time, position, velocity, attitude); before it, and where that is
    None, those of the log.
    """
    time = begin + np.arange(-round(RATE * early), round(RATE * duration)) / RATE
    motion = log.columns("SIM2", time, 1, 2, 3, 4, 5, 6)
    turned = np.array([(row[0], row[3]) for row in log.rows["SIM"]])
    yaw = np.interp(time, turned[:, 0], np.unwrap(turned[:, 1], period=360.0))
    if truth is not None:
        known = time >= begin
        for i in range(6):
            motion[known, i] = np.interp(time[known], truth[:, 0], truth[:, i + 1])
        yaw[known] = np.interp(time[known], truth[:, 0], np.unwrap(heading(truth[:, 7:11]), period=360.0))
    desired = [log.columns(kind, time, 2)[:, 0] for kind in ("PSCN", "PSCE", "PSCD")]
    erring = errors(log)
    erred = [np.interp(time, erring[:, 0], erring[:, i]) for i in range(1, 10)]
    return np.column_stack([time - begin, motion, yaw, *desired, *erred])


def record(folder: Path, name: str, body: str, head: dict[str, Any], later: float = 0.0) -> Path:
    """Flies one command, `later` seconds after it could, and writes its file; returns it."""
    place = folder / f"{body}_{name}"
    given = {"LOG_BITMASK": LOGGED, **head.get("parameters", {})}
    model, values = BODIES[body]
    copter: Any = (
        OwnPhysics(place, given)
        if body == "x"
        else RealCopter(place, preset(values) if values else {}, given, instance=231, model=model)
    )
    duration = float(head.get("duration", DURATION))
    try:
        copter.run(READY + later)
        if on_the_ground(head) and "mission" in head:
            upload(copter, head["mission"])
        arm(copter)
        copter.run(head.get("armed", ARMED))
        if not on_the_ground(head):
            approach(copter, head)
            hurry(copter, head)
        sent = copter.time
        truth = perform(copter, head, duration)
        copter.run(LAST)
    finally:
        copter.close()
    log = Log(place)
    begin = log.taken(head, sent)
    head = {**head, **({"armed": round(begin - log.armed(), 4)} if on_the_ground(head) else {})}
    if "vel" in head and kind_of(head) not in ("set-point", "take-off"):
        head = {**head, "before": round(begin - log.hurried(sent), 4)}
    if "lasts" in head:
        head = {**head, "lasts": round(log.taken(head, sent, last=True) - begin, 4)}
    file = folder / f"{body}_{name}.csv.gz"
    head["home"] = log.home()
    if kind_of(head) == "failure":
        head["fix"] = round(log.fix(begin), 3)
    write(file, head, flown(log, truth, begin, duration - 0.5, EARLY))
    return file


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("flights", nargs="*", type=parse)
    parser.add_argument("--body", choices=BODIES, default="json")
    parser.add_argument("--list", type=Path)
    parser.add_argument("--later", type=float, default=0.0, help="s, for another recording of the same flights")
    options = parser.parse_intermixed_args(arguments)
    flights = dict(options.flights) if options.list is None else json.loads(options.list.read_text())
    for name, head in flights.items():
        print(record(options.folder, name, options.body, head, options.later))


if __name__ == "__main__":
    main()
