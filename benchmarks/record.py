"""Records moves of the user's ArduCopter in GUIDED, in the format that `benchmarks.fidelity` takes.

ArduCopter, which the environment variable ARDUPILOT_SITL names, flies the body of the preset ardupilot_json: up to
10 m, then one move after the other, each from where the last one ended. t = 0 is when its own log says it took the
target; where it wanted to be before is from its log too. A move is NORTH,EAST,DOWN [m] from where it hovers, and, where
it is not to be ArduCopter's own, @SPEED [m/s]: a DO_CHANGE_SPEED before the move.

    ARDUPILOT_SITL=... python -m benchmarks.record FOLDER -- 7,0,0 30,0,0@5 -6,8,-3
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import DFReader_binary

from tests.models.copter import ACCEPTED, GUIDED, preset
from tests.models.real_copter import READY, H, RealCopter

HEIGHT, HOVER, DURATION = 10.0, 25.0, 20.0
"""Height of the take-off [m]; time to come to rest in before the first move, and time of a move [s]."""
LAST = 10.0
"""Time [s] after the last move, in which its log comes to the disk."""
EVERY = round(0.02 / H)
"""Steps between rows of 50 Hz."""


@dataclass(frozen=True, slots=True)
class Move:
    """A move as it is asked for: metres NED from where the copter hovers, and its speed [m/s; None: the default]."""

    north: float
    east: float
    down: float
    speed: float | None = None

    @property
    def name(self) -> str:
        way = "_".join(f"{value:g}" for value in (self.north, self.east, self.down))
        return f"json_{way}" if self.speed is None else f"json_{way}_at_{self.speed:g}"


def parse(text: str) -> Move:
    """NORTH,EAST,DOWN or NORTH,EAST,DOWN@SPEED."""
    way, _, speed = text.partition("@")
    north, east, down = map(float, way.split(","))
    return Move(north, east, down, float(speed) if speed else None)


def logged(folder: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From ArduCopter's log: when it took targets [s], and rows of time and desired position [s, m NED]."""
    (log,) = (folder / "logs").glob("*.BIN")
    reader = DFReader_binary(str(log))
    taken: list[float] = []
    desired: dict[str, list[tuple[float, float]]] = {"PSCN": [], "PSCE": [], "PSCD": []}
    while (message := reader.recv_match(type=["GUIP", *desired])) is not None:
        kind, at = message.get_type(), message.TimeUS / 1e6
        if kind == "GUIP":
            taken.append(at)
        else:
            desired[kind].append((at, getattr(message, f"DP{kind[-1]}")))
    time = np.array([at for at, _ in desired["PSCN"]])
    columns = [np.interp(time, *np.array(desired[kind]).T) for kind in desired]
    return np.array(taken), np.column_stack([time, *columns])


def heading(attitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees from quaternions."""
    w, x, y, z = attitude.T
    found: NDArray[np.float64] = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    return found


def write(path: Path, head: dict[str, Any], rows: NDArray[np.float64], desired: NDArray[np.float64]) -> None:
    """One flight; `rows` from t = 0 on."""
    wanted = [np.interp(rows[:, 0], desired[:, 0], desired[:, i]) for i in (1, 2, 3)]
    table = np.column_stack([rows[:, 0] - rows[0, 0], rows[:, 1:7], heading(rows[:, 7:11]), *wanted])
    columns = "t,n,e,d,vn,ve,vd,yaw,des_n,des_e,des_d"
    lines = [f"# {json.dumps(head)}", columns, *(",".join(f"{x:.5f}" for x in row) for row in table)]
    path.write_text("\n".join(lines) + "\n")


def record(folder: Path, moves: Sequence[Move]) -> None:
    """Fly the moves and write a file for each."""
    copter = RealCopter(folder / "arducopter", preset("ardupilot_json"))
    try:
        copter.run(READY)
        for command in ((176, 1, GUIDED), (400, 1), (22, 0, 0, 0, 0, 0, 0, HEIGHT)):
            answers = copter.ask(*command)
            if ("ACK", command[0], ACCEPTED) not in answers:
                raise RuntimeError(f"ArduCopter has answered command {command[0]} with {answers}")
        rows = [copter.run(HOVER)]
        target = np.array([0.0, 0.0, -HEIGHT])
        heads: list[dict[str, Any]] = []
        for move in moves:
            target = target + np.array([move.north, move.east, move.down])
            if move.speed is not None:
                copter.ask(178, 1, move.speed, -1)
            heads.append({"target": target.tolist(), "sent": copter.time, "speed": move.speed})
            copter.go(*target)
            rows.append(copter.run(DURATION))
        rows.append(copter.run(LAST))
    finally:
        copter.close()
    taken, desired = logged(folder / "arducopter")
    flown = np.concatenate(rows)
    for move, head in zip(moves, heads, strict=True):
        began = taken[np.searchsorted(taken, head["sent"])]
        first = int(np.searchsorted(flown[:, 0], began))
        write(folder / f"{move.name}.csv", head, flown[first : first + round((DURATION - 0.1) / H) : EVERY], desired)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("moves", nargs="+", type=parse)
    options = parser.parse_args(arguments)
    record(options.folder, options.moves)


if __name__ == "__main__":
    main()
