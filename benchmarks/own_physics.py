"""The user's ArduCopter on its own physics, flown over MAVLink by its own clock."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_models.ardupilot.sitl import _START_TIME
from tests.models.copter import ONLY_POSITION

__all__ = ["OwnPhysics"]

_CLOCK = 20_000  # us between two messages that tell the time
_PATIENCE = 120.0  # s of wall-clock time without a message
_SPEED = 4.0


class OwnPhysics:
    """A flight of the program that ARDUPILOT_SITL names on its frame `x`, in `folder`: as `Copter`, without motion.

    Its time goes on by itself, at most `_SPEED` times as fast as the wall clock: commands come within some 0.1 s of
    when they are meant; the log tells when they came.

    Attributes:
        time: its clock [s] when it was last heard.
        heard: messages with the time at which they came.
    """

    def __init__(self, folder: Path, parameters: dict[str, float]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "test.parm").write_text("".join(f"{name} {value}\n" for name, value in parameters.items()))
        program = Path(os.environ["ARDUPILOT_SITL"]).resolve()
        own = program.parents[3] / "Tools" / "autotest" / "default_params" / "copter-X.parm"
        if not own.is_file():
            raise FileNotFoundError(f"{own}: the frame `x` needs this file of ArduPilot's sources")
        firmware_defaults = program.parents[3] / "Tools" / "autotest" / "default_params" / "copter.parm"
        files = [firmware_defaults, own, folder / "test.parm"]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(_PATIENCE)
        self._peer: Any = None
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True  # it begins with a greeting in plain text
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.time, self.heard = 0.0, list[tuple[float, Any]]()
        port = self._socket.getsockname()[1]
        command = [str(program), "-I230", "--model", "x", "--defaults", ",".join(map(str, files))]
        command += ["--home", "-35.363262,149.165237,584,0", "--start-time", str(_START_TIME)]
        command += ["--speedup", f"{_SPEED:g}", "--serial0", f"udpclient:127.0.0.1:{port}"]
        command += ["--serial1", "none", "--serial2", "none"]
        with (folder / "ardupilot.log").open("wb") as log:
            self._process = subprocess.Popen(
                ["nice", *command], cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
            )
        self._beat = 0.0
        while self.time == 0.0:  # what is sent in its first second is lost
            self._hear()
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, _CLOCK)

    def _hear(self) -> None:
        data, self._peer = self._socket.recvfrom(65536)
        for message in self._parser.parse_buffer(data) or []:
            if message.get_type() == "ATTITUDE":
                self.time = message.time_boot_ms / 1000
            self.heard.append((self.time, message))

    def send(self, *messages: Any) -> None:
        for message in messages:
            self._socket.sendto(message.pack(self.station), self._peer)

    def command(self, number: int, *parameters: float) -> None:
        """COMMAND_LONG."""
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))

    def go(self, n: float, e: float, d: float, mask: int = ONLY_POSITION, frame: int = 1, **other: float) -> None:
        """SET_POSITION_TARGET_LOCAL_NED."""
        names = ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        rest = (other.get(name, 0.0) for name in names)
        self.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, n, e, d, *rest))

    def run(self, duration: float) -> None:
        """Waits until its clock has gone on by so many seconds."""
        end = self.time + duration
        while self.time < end - 1e-9:
            self._hear()
            if self.time - self._beat > 1.0:
                self._beat = self.time
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))

    def ask(self, number: int, *parameters: float) -> list[tuple[str, Any, Any]]:
        """Sends a COMMAND_LONG and returns what it was answered with within 0.3 s, as `Copter.answers`."""
        self.heard.clear()
        self.command(number, *parameters)
        self.run(0.3)
        found: list[tuple[str, Any, Any]] = []
        for _, message in self.heard:
            if message.get_type() == "COMMAND_ACK":
                found.append(("ACK", message.command, message.result))
            elif message.get_type() == "STATUSTEXT":
                found.append(("TEXT", message.severity, message.text))
        return found

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(20.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()
