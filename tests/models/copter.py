"""An `Autopilot` and a vehicle stepped together without a master, with a ground station made of pymavlink."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim.kernel import PLAIN
from cosim_models.autopilot.autopilot import Autopilot
from cosim_models.vehicles import quadrotor
from cosim_models.vehicles.dynamics.rotor import MotorCurve
from cosim_models.vehicles.quadrotor import Quadrotor
from tests.models.shipped_kernels import Loop, joined, kernels, part

H = 0.0025
STABILIZE, GUIDED, LOITER, RTL, LAND = (
    mavlink.COPTER_MODE_STABILIZE,
    mavlink.COPTER_MODE_GUIDED,
    mavlink.COPTER_MODE_LOITER,
    mavlink.COPTER_MODE_RTL,
    mavlink.COPTER_MODE_LAND,
)
ACCEPTED, DENIED, UNSUPPORTED, FAILED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
    mavlink.MAV_RESULT_FAILED,
)
ONLY_POSITION, ONLY_VELOCITY, ONLY_ACCELERATION = 0xDF8, 0xDC7, 0xC3F
LINES = ("telemetry", "serial")
"""Links of the autopilot besides `mavlink`."""
FEW = 10
"""Steps that Python makes in the time in which it prepares the loop."""
MOTION = ("position", "velocity", "attitude", "angular_velocity", "specific_force")
RECORDINGS = Path(__file__).parents[1] / "data" / "arducopter"
PRESETS = Path(quadrotor.__file__).parent / "presets"
RECORDED_AUTOPILOT = {
    "MOT_THST_HOVER": 0.39,
    "ATC_RAT_YAW_P": 0.3,
    "ATC_RAT_YAW_I": 0.02,
    "MOT_BAT_VOLT_MAX": 12.8,
    "MOT_BAT_VOLT_MIN": 9.6,
}
"""What differed from ArduCopter's defaults in the recorded flights."""


def set_values(record: Any, values: dict[str, Any]) -> None:
    """Set parameters by FMI names (rotor_x[1] ...)."""
    for key, value in values.items():
        array, _, index = key.partition("[")
        if index:
            record[array][int(index[:-1]) - 1] = value
        else:
            record[key] = value


def preset(name: str) -> dict[str, Any]:
    """The parameters of a vehicle preset."""
    root = etree.fromstring((PRESETS / f"{name}.ssv").read_bytes())
    found: dict[str, Any] = {}
    for (value,) in root[0]:
        kind, text = etree.QName(value).localname, value.get("value")
        key = value.getparent().get("name")
        found[key] = (
            text == "true"
            if kind == "Boolean"
            else int(text)
            if kind == "Integer"
            else MotorCurve[text]
            if kind == "Enumeration"
            else float(text)
        )
    return found


def recording(name: str) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
    """First line and columns of a recorded flight, from its command on."""
    lines = gzip.decompress((RECORDINGS / f"{name}.csv.gz").read_bytes()).decode().splitlines()
    table = np.array([[float(x) for x in line.split(",")] for line in lines[2:]])
    table = table[table[:, 0] >= 0.0]
    return json.loads(lines[0][2:]), dict(zip(lines[1].split(","), table.T, strict=True))


class Decoder:
    """Reads packets strictly: anything but whole good packets is an error."""

    def __init__(self) -> None:
        self._parser = mavlink.MAVLink(None)

    def __call__(self, data: bytes) -> list[Any]:
        return list(self._parser.parse_buffer(data) or [])


@dataclass
class Copter:
    """A flight in the making."""

    vehicle_model: Any = Quadrotor
    autopilot: dict[str, Any] = field(default_factory=dict)
    vehicle: dict[str, Any] = field(default_factory=dict)
    system: int = 1
    direct: bool = False
    """Whether the motors obey in the step in which the autopilot commands them, as with the master "gauss-seidel"."""

    def __post_init__(self) -> None:
        self.v, self.m = self.vehicle_model.record(), Autopilot.record()
        set_values(self.v, self.vehicle)
        set_values(self.m, {"SYSID_THISMAV": self.system, **self.autopilot})
        self.start_vehicle, self.advance_vehicle = kernels(self.vehicle_model)
        start, self.advance_autopilot = kernels(Autopilot)
        assert self.start_vehicle(self.v) == 0
        self._pairs: list[tuple[NDArray[Any], NDArray[Any]]] = [*joined(self.m, self.v, MOTION)]
        self._commands, self._motor = self.v["motor"], self.m["motor"]
        self._before = self._motor.copy()
        lines = ("mavlink", *LINES)
        self._given, got = ([part(self.m, f"{line}_{way}_len") for line in lines] for way in ("rx", "tx"))
        self._got_at = [*zip(lines, got, strict=True)]
        self._connect()
        self.m["airframe"] = self.v["airframe"]
        assert start(self.m) == 0
        self.step = 0
        self.waiting = b""
        self.heard: list[tuple[float, Any]] = []
        self.sent = bytearray()
        self._decoder = Decoder()
        self.waiting_at = dict.fromkeys(LINES, b"")
        self.heard_at: dict[str, list[Any]] = {line: [] for line in LINES}
        self._decoders = {line: Decoder() for line in LINES}
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def _connect(self) -> None:
        for to, of in self._pairs:
            to[:] = of

    @property
    def time(self) -> float:
        return self.step * H

    def send(self, *messages: Any, version: int = 2, line: str = "mavlink") -> None:
        """Deliver messages in the next step."""
        for message in messages:
            packet = message.pack(self.station, force_mavlink1=version == 1)
            if line == "mavlink":
                self.waiting += packet
            else:
                self.waiting_at[line] += packet

    def command(self, number: int, *parameters: float, target: tuple[int, int] | None = None, version: int = 2) -> None:
        """COMMAND_LONG."""
        system, component = (self.system, 1) if target is None else target
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *values), version=version)

    def go(self, n: float, e: float, d: float, mask: int = ONLY_POSITION, frame: int = 1, **other: float) -> None:
        """SET_POSITION_TARGET_LOCAL_NED."""
        names = ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self.system, 1, frame, mask, n, e, d, *(other.get(name, 0.0) for name in names)
            )
        )

    def tick(self) -> None:
        """One step of both, as the master steps them: each sees what the other gave at the begin of the step."""
        m, t = self.m, self.step * H
        self._before[:] = self._motor
        self._connect()
        if self.waiting:
            data, self.waiting = self.waiting, b""
            m["mavlink_rx"][: len(data)] = np.frombuffer(data, dtype=np.uint8)
            m["mavlink_rx_len"] = len(data)
        for line, data in self.waiting_at.items():
            if data:
                m[f"{line}_rx"][: len(data)] = np.frombuffer(data, dtype=np.uint8)
                m[f"{line}_rx_len"] = len(data)
                self.waiting_at[line] = b""
        assert self.advance_autopilot(m, t, H) == 0
        for size in self._given:
            size[0] = 0
        self._commands[:] = self._motor if self.direct else self._before
        assert self.advance_vehicle(self.v, t, H) == 0
        for line, size in self._got_at:
            if used := size[0]:
                self._hear(t, line, m[f"{line}_tx"][:used].tobytes())
        self.step += 1

    def _hear(self, t: float, line: str, data: bytes) -> None:
        """Reads the packets of the step at `t`."""
        if line == "mavlink":
            self.sent += data
            self.heard += [(t, message) for message in self._decoder(data)]
        else:
            self.heard_at[line] += self._decoders[line](data)

    def _loop(self) -> Loop | None:
        """What makes many steps at a time, until somebody sends something; None if a step is not that of `tick`."""
        own = type(self)._connect is Copter._connect and type(self).tick is Copter.tick
        return self._of_pairs() if own else None

    def _of_pairs(self) -> Loop | None:
        if PLAIN or self.advance_vehicle is not kernels(self.vehicle_model)[1]:
            return None
        lines = ("mavlink", *LINES)
        return Loop(Autopilot, self.vehicle_model, self.m, self.v, self._pairs, lines, direct=self.direct)

    def run(self, duration: float) -> NDArray[np.float64]:
        """Fly on; rows of time [s], position [m, NED], velocity [m/s, NED], desired position [m, NED]."""
        rows = np.empty((round(duration / H), 10))
        position, velocity, desired = self.v["position"], self.v["velocity"], self.m["desired_position"]
        made = 0
        while made < len(rows):
            silent = not self.waiting and not any(self.waiting_at.values())
            if silent and len(rows) - made >= FEW and (loop := self._loop()) is not None:
                made += self._fly(loop, rows[made:])
            if made < len(rows):
                self.tick()
                row = rows[made]
                row[0] = self.step * H
                row[1:4], row[4:7], row[7:10] = position, velocity, desired
                made += 1
        return rows

    def _fly(self, loop: Loop, rows: NDArray[np.float64]) -> int:
        """Makes steps without what a subclass adds to `tick`; returns how many."""
        made, packets = loop.fly(self.step, len(rows), rows)
        for step, line, data in packets:
            self._hear(step * H, loop.lines[line], data)
        self.step += made
        return made

    def messages(self, name: str) -> list[Any]:
        return [message for _, message in self.heard if message.get_type() == name]

    def answers(self) -> list[tuple[str, Any, Any]]:
        """COMMAND_ACKs and STATUSTEXTs since the last call: ("ACK", command, result) and ("TEXT", severity, text)."""
        found: list[tuple[str, Any, Any]] = []
        for _, message in self.heard:
            if message.get_type() == "COMMAND_ACK":
                if message.get_msgbuf()[0] == 0xFD:  # MAVLink 1 leaves the addressee out
                    assert (message.target_system, message.target_component) == (255, 190)
                found.append(("ACK", message.command, message.result))
            elif message.get_type() == "STATUSTEXT":
                found.append(("TEXT", message.severity, message.text))
        self.heard.clear()
        return found

    def ask(self, number: int, *parameters: float, **options: Any) -> list[tuple[str, Any, Any]]:
        """Send a COMMAND_LONG and say what came back at once."""
        self.answers()
        self.command(number, *parameters, **options)
        self.tick()
        self.tick()
        return self.answers()

    def in_the_air(self, height: float = 10.0, settle: float = 14.0) -> Copter:
        """In GUIDED, armed, hovering at `height`."""
        self.run(2.1)
        assert self.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)[0] == ("ACK", mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
        assert self.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)[0] == (
            "ACK",
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
            ACCEPTED,
        )
        assert self.ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height)[0] == (
            "ACK",
            mavlink.MAV_CMD_NAV_TAKEOFF,
            ACCEPTED,
        )
        self.run(settle)
        return self
