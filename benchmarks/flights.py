"""Recorded flights of ArduCopter, and their commands, for the real one and for ours.

A flight is a file of CSV (or CSV compressed by gzip): a first line of JSON after "# " with the command, then columns t,
n, e, d, vn, ve, vd, yaw, des_n, des_e, des_d [s, m, m/s, degrees, NED], t = 0 when the command was taken, and, where
they were recorded, `ERRORS`: by how much ArduCopter's estimate erred then, in the same units. Commands:

    {"target": [n, e, d]}                a move [m NED]; "speed" means a DO_CHANGE_SPEED before it
    {"type": 4, "vel": [n, e, d]}        a velocity [m/s], ten times a second for "lasts" s (default: to the end)
    {"type": 5, "accel": [n, e, d]}      an acceleration [m/s2], likewise
    {"type": 6, "attitude": [r, p, y]}   an attitude [degrees], likewise; "climb" [m/s]
    {"mode": 6}                          a change to a mode of ArduCopter, at "start" [m NED], where "vel" was flown
    {"mission": [[command, p1, n, e, up], ...]}   a mission in AUTO [m], from the ground or from "start"
    {"set": {"SIM_BATT_VOLTAGE": 9.6}}   parameters set at "start", where "vel" is flown
    {}                                   a take-off to 10 m, or to "height" [m]

"type" is that of ArduCopter's GUIP messages (2: a position), "parameters" are the autopilot's from the start, "armed"
is the time [s] from arming to a command on the ground, "before" that for which "vel" was flown before a command,
"sticks" [us] are the pilot's channels 1 to 4 from the command on, "duration" is that of the flight, "home"
[m, north, east, up] is where ArduCopter's home was, "fix" the time [s] from the last fix of GPS to the command. Rows of
negative time are before the command. Names that begin with `json` flew on the body of the preset ardupilot_json, with
`hexa` on the default `Hexarotor`, with `x` on ArduPilot's own (ardupilot_sitl_quad).
"""

from __future__ import annotations

import gzip
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim import Model
from cosim.frames import quaternion_from_euler
from cosim_models.vehicles.hexarotor import Hexarotor
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.autopilot.test_autopilot_missions import item
from tests.models.copter import GUIDED, ONLY_ACCELERATION, ONLY_VELOCITY

Columns = dict[str, NDArray[np.float64]]
SET_MODE, ARM, TAKE_OFF = (
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_NAV_TAKEOFF,
)
CHANGE_SPEED, WAYPOINT = mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_NAV_WAYPOINT
MOVE, VELOCITY, ACCELERATION, ATTITUDE = 2, 4, 5, 6
"""Commands in GUIDED, by the type of ArduCopter's GUIP."""
NEEDED = {VELOCITY: "vel", ACCELERATION: "accel", ATTITUDE: "attitude"}
BODIES: dict[str, tuple[type[Model], str]] = {
    "json": (Quadrotor, "ardupilot_json"),
    "hexa": (Hexarotor, ""),
    "x": (Quadrotor, "ardupilot_sitl_quad"),
}
"""Model and preset (none: its defaults) of each body; ArduPilot computes the motion of `x` itself."""
ERRORS = ("err_n", "err_e", "err_d", "err_vn", "err_ve", "err_vd", "err_roll", "err_pitch", "err_yaw")
"""Columns of the error of ArduCopter's estimate: estimate minus truth [m, m/s, degrees]."""
HEIGHT = 10.0
"""Height of a take-off [m] unless the flight says another."""
CLIMB, SETTLE, BEFORE = 25.0, 25.0, 8.0
"""Time [s] of the take-off before a command, of the way to its beginning, and of the velocity flown before it, unless
the flight says another."""


def kind_of(head: dict[str, Any]) -> str:
    """Returns "move", "mode", "mission", "failure" (parameters are set), "set-point" or "take-off"."""
    if "target" in head and head.get("type", MOVE) == MOVE:
        return "move"
    for name, kind in (("mode", "mode"), ("mission", "mission"), ("set", "failure"), ("type", "set-point")):
        if name in head:
            return kind
    return "take-off"


def on_the_ground(head: dict[str, Any]) -> bool:
    """Returns whether the command is given before the take-off."""
    kind = kind_of(head)
    return kind == "take-off" or (kind == "mission" and "start" not in head)


def goes_to_start(head: dict[str, Any]) -> bool:
    """Returns whether a flight begins at its "start"; moves and set-points begin above home."""
    return "start" in head and kind_of(head) in ("mode", "mission", "failure")


def body_of(name: str) -> str:
    """Returns the body, a key of `BODIES`, of the flight of this name."""
    return next((body for body in ("x", "hexa") if name.startswith(body)), "json")


@dataclass(frozen=True, slots=True)
class Flight:
    """A recorded flight: its name, the target (NED; None: no move), the columns, and the first line."""

    name: str
    target: NDArray[np.float64] | None
    real: Columns
    head: dict[str, Any]
    before: NDArray[np.float64] | None = None
    """Rows of time [s], negative, and the columns `ERRORS` before the command; None if they were not recorded."""

    @property
    def speed(self) -> float | None:
        """The speed [m/s] that was commanded before a move."""
        return self.head.get("speed")

    @property
    def kind(self) -> str:
        return kind_of(self.head)

    @property
    def errors(self) -> NDArray[np.float64] | None:
        """The columns `ERRORS`, n x 9; None if they were not recorded."""
        return np.column_stack([self.real[name] for name in ERRORS]) if ERRORS[0] in self.real else None

    @property
    def body(self) -> str:
        return body_of(self.name)


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
    names = lines[1].split(",")
    early = table[table[:, 0] < 0.0] if names[0] == "t" else table[:0]
    real = dict(zip(names, table[len(early) :].T, strict=True))
    before = early[:, [0, *(names.index(name) for name in ERRORS)]] if len(early) and ERRORS[0] in names else None
    if missing := {"t", "n", "e", "d", "vn", "ve", "vd", "yaw", "des_n", "des_e", "des_d"} - set(real):
        raise ValueError(f"{path}:2: columns {', '.join(sorted(missing))} are missing")
    kind = head.get("type", MOVE)
    if kind != MOVE and (kind not in NEEDED or NEEDED[kind] not in head):
        raise ValueError(f"{path}:1: type {kind}: there are 2 (target), 4 (vel), 5 (accel) and 6 (attitude)")
    target = np.array(head["target"]) if "target" in head and kind == MOVE else None
    if kind == MOVE and target is None:
        head.pop("type", None)
    return Flight(path.name.removesuffix(".gz").removesuffix(".csv"), target, real, head, before)


# ---- commands ------------------------------------------------------------------------------------------------------


def upload(copter: Any, items: list[list[float]]) -> None:
    """Uploads a mission: rows of command, param 1, north, east and height [m].

    Raises:
        ValueError: it is refused.
    """
    messages = [item(0, WAYPOINT)]
    for i, (command, p1, n, e, up) in enumerate(items, 1):
        messages.append(item(i, int(command), p1, north=n, east=e, z=up))
    copter.heard.clear()
    copter.send(mavlink.MAVLink_mission_count_message(1, 1, len(messages), 0))
    for _ in range(20 * len(messages)):
        copter.run(0.1)
        said = [m for _, m in copter.heard if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")]
        copter.heard.clear()
        if said and said[-1].get_type() == "MISSION_ACK":
            if said[-1].type == mavlink.MAV_MISSION_ACCEPTED:
                return
            break
        if said:
            copter.send(messages[said[-1].seq])
    raise ValueError("the mission is refused")


def approach(copter: Any, head: dict[str, Any]) -> None:
    """Flies from GUIDED and armed, on the ground, to the place where the command is given; then comes `hurry`."""
    n, e, d = map(float, head.get("start", [0.0, 0.0, -head.get("height", HEIGHT)]))
    copter.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, max(1.0, -d))
    copter.run(CLIMB)
    if goes_to_start(head):
        copter.go(n, e, d)
        copter.run(SETTLE)
    if "mission" in head:
        upload(copter, head["mission"])
    if head.get("speed") is not None:  # it holds from the first target on, not from the take-off
        copter.go(0.0, 0.0, d)
        copter.run(1.0)
        copter.ask(CHANGE_SPEED, 1, head["speed"], -1)


def hurries(head: dict[str, Any]) -> bool:
    """Returns whether a velocity is flown before the command."""
    return kind_of(head) != "set-point" and "vel" in head


def hurry(copter: Any, head: dict[str, Any]) -> None:
    """Flies the velocity that is flown before the command, if there is one."""
    if hurries(head):
        _repeat(copter, {"vel": head["vel"]}, head.get("before", BEFORE))


def perform(copter: Any, head: dict[str, Any], duration: float) -> Any:
    """Gives the command and flies on; returns what the copter's `run` returns."""
    kind = kind_of(head)
    if kind == "set-point":
        return _repeat(copter, head, duration)
    if kind == "take-off":
        copter.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, float(head.get("height", HEIGHT)))
    elif kind == "move":
        copter.go(*(float(x) for x in head["target"]))
    elif kind == "mode":
        copter.command(SET_MODE, 1, head["mode"])
    elif kind == "mission":
        copter.command(SET_MODE, 1, mavlink.COPTER_MODE_AUTO)
        if on_the_ground(head):
            copter.command(mavlink.MAV_CMD_MISSION_START)
    elif kind == "failure":
        for name, value in head["set"].items():
            copter.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))
        if "vel" in head:
            return _repeat(copter, {"vel": head["vel"]}, duration)
    return _hold(copter, head["sticks"], duration) if "sticks" in head else copter.run(duration)


def _repeat(copter: Any, head: dict[str, Any], duration: float) -> Any:
    """Sends a set-point ten times a second for as long as the flight says, the last one at that time."""
    lasts = min(float(head.get("lasts", duration)), duration)
    count = max(round(10.0 * lasts), 1)
    rows = []
    begin = copter.time
    for i in range(1, count + 1):
        _set_point(copter, head)
        rows.append(copter.run(begin + i * lasts / count - copter.time))
    if lasts < duration:
        _set_point(copter, head)
        rows.append(copter.run(duration - lasts))
    return None if rows[0] is None else np.concatenate(rows)


def _hold(copter: Any, sticks: list[int], duration: float) -> Any:
    """Holds the pilot's sticks: channels 1 to 4 [us], told twice a second."""
    rows = []
    for _ in range(math.ceil(2.0 * duration)):
        copter.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *sticks, 0, 0, 0, 0))
        rows.append(copter.run(min(0.5, duration)))
    return None if rows[0] is None else np.concatenate(rows)


def _set_point(copter: Any, head: dict[str, Any]) -> None:
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


def arm(copter: Any) -> None:
    """Changes to GUIDED and arms.

    Raises:
        ValueError: it is refused.
    """
    for command in ((SET_MODE, 1, GUIDED), (ARM, 1)):
        answers = copter.ask(*command)
        if ("ACK", command[0], 0) not in answers:
            raise ValueError(f"command {command[0]} is answered with {answers}")
