"""ArduCopter, ArduRover or ArduPlane itself as an autopilot FMU, started or attached to over its JSON interface.

Each step sends the motion at t as the reply to the pending servo outputs, which advances ArduPilot's clock to t + h and
no further, and waits for the servo outputs that follow: the motor commands at t + h. Instances stepped by the same
master therefore share its clock exactly. MAVLink packets use ArduPilot's first serial port.

ArduPilot must be installed by the user; it is not part of this package. A run often repeats bit for bit, but not always
(docs/arducopter.md). Two things depend on wall-clock time: MAVLink FTP replies, which a separate thread serves, and
SYSTEM_TIME before the GPS has a fix. Not here: sensor models (ArduPilot has its own). Firmwares, frames and servo
outputs are in `firmware`.
"""

from __future__ import annotations

import contextlib
import math
import os
import shlex
import shutil
import socket
import tempfile
import time
import weakref
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim import Model, Output, PacketInput, PacketOutput, Parameter
from cosim.packets import GOOD, NOTHING, SIGNED, TRUNCATED, component, find, message_id, payload_start
from cosim.vehicle import MAX_MOTORS, Airframe, inputs_for
from cosim.verdict import Bound, Role
from cosim_models.ardupilot.access import QuickAccess
from cosim_models.ardupilot.firmware import FRAMES, Firmware, Frame, program_of, put_commands
from cosim_models.ardupilot.json_interface import PORT, Link, Servos
from cosim_models.ardupilot.program import Program
from cosim_models.ardupilot.replies import MOTION, REPLY_SIZE, put_reply

__all__ = ["ArduPilotSITL"]

_SERIAL = 5760
"""TCP port of the first serial port of instance 0; instance n uses _SERIAL + 10 n."""
_START_TIME = 1735689600
"""Initial date of ArduPilot's clock, 2025-01-01 UTC [s since 1970]; the default is today, so that no run would repeat.
"""
_HEARTBEAT, _ARMED, _STANDBY, _AUTOPILOT = 0, 128, 3, 1
_GYRO_RATE = 1.8
"""The least rate of the gyro, thus of steps, with which ArduPilot arms: times that of its loop."""
_NO_BINARY = (
    "there is no ArduPilot to start: set the environment variable ARDUPILOT_SITL or the parameter `executable` to the "
    "path of an `arducopter`, `ardurover` or `arduplane` for SITL "
    "(https://ardupilot.org/dev/docs/sitl-simulator-software-in-the-loop.html says how to get one). Or set `attach` to "
    "true and start it yourself"
)


class _Serial:
    """Byte stream of ArduPilot's first serial port, split into packets.

    It uses TCP to a listening ArduPilot, and UDP from an ArduPilot started here, which then does not listen anywhere.
    """

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._out = bytearray()
        self._in = b""
        self._datagrams = False
        self._peer: tuple[str, int] | None = None
        self._port = 0

    def listen(self) -> int:
        """Opens a UDP socket on loopback; returns its port."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._datagrams = True
        return int(self._socket.getsockname()[1])

    def connect(self, port: int, seconds: float) -> None:
        """Connects to a running ArduPilot.

        Raises:
            TimeoutError: no answer.
        """
        self._port = port
        end = time.monotonic() + seconds
        while (problem := self.reconnect()) is not None:
            if time.monotonic() > end:
                raise TimeoutError(f"no ArduPilot at tcp:127.0.0.1:{port} within {seconds:g} s ({problem})")
            time.sleep(0.05)

    def reconnect(self) -> str | None:
        """Reconnects after ArduPilot has closed the connection, as it does on restart; returns the error, if any."""
        if self._socket is not None or not self._port:
            return None
        try:
            self._socket = socket.create_connection(("127.0.0.1", self._port), timeout=1.0)
        except OSError as error:
            return error.strerror or str(error)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        return None

    def write(self, packets: NDArray[np.uint8]) -> None:
        """Sends packets and pending data without blocking."""
        if packets.size:
            self._out += packets.tobytes()
        if not self._out or self._socket is None or (self._datagrams and self._peer is None):
            return
        with contextlib.suppress(BlockingIOError, ConnectionError):  # data is kept; `read` reports a missing peer
            while self._out:
                if self._peer is not None:
                    del self._out[: self._socket.sendto(self._out[:1024], self._peer)]
                else:
                    del self._out[: self._socket.send(self._out)]

    def read(self, limit: int) -> bytes:
        """Returns complete received packets, at most `limit` bytes; the rest is returned by the next call."""
        self.receive(limit)
        if not self._in:
            return b""
        packets, used = _packets(self._in, limit)
        self._in = self._in[used:]
        return packets

    def receive(self, limit: int) -> None:
        """Receives data until `limit` bytes are available; reconnects after ArduPilot has closed the connection."""
        self.reconnect()
        while self._socket is not None and len(self._in) < limit:
            try:
                if self._datagrams:
                    piece, self._peer = self._socket.recvfrom(65536)
                else:
                    piece = self._socket.recv(65536)
                    if not piece:
                        self._hang_up()
            except BlockingIOError:
                break
            except ConnectionError:
                if not self._datagrams:
                    self._hang_up()
                continue  # about an earlier datagram
            self._in += piece

    def _hang_up(self) -> None:
        """Closes the connection and discards incomplete packets in both directions."""
        self.close()
        self._socket, self._in = None, b""
        self._out.clear()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()


def _packets(data: bytes, limit: int) -> tuple[bytes, int]:
    """Returns complete packets, at most `limit` bytes of them, and the number of bytes of `data` consumed.

    Data between packets is dropped: before its first packet, ArduPilot sends a greeting in plain text.
    """
    buffer = np.frombuffer(data, np.uint8)
    packets = bytearray()
    used = 0
    while used < len(data):
        start, stop, status = find(buffer, used, len(data))
        if status in (NOTHING, TRUNCATED):
            return bytes(packets), start
        if len(packets) + stop - start > limit:
            break
        packets += data[start:stop]
        used = stop
    return bytes(packets), used


class ArduPilotSITL(QuickAccess, Model):
    """The original ArduPilot over its JSON interface: an autopilot with the ports of Autopilot. Steps of 1 ms."""

    step_size = 0.001
    _end: weakref.finalize[..., ArduPilotSITL] | None = None
    _waits = False
    _frame: Frame
    variables = (
        *inputs_for(*FRAMES),
        PacketInput("mavlink_rx", capacity=2048, description="packets received"),
        Parameter(
            "SYSID_THISMAV",
            type=int,
            start=1,
            minimum=1,
            maximum=250,
            verdict=Role.SYSTEM_ID,
            description="MAVLink system id",
        ),
        Parameter(
            "instance",
            type=int,
            start=-1,
            minimum=-1,
            maximum=255,
            description="ArduPilot's instance number; -1: SYSID_THISMAV - 1",
        ),
        Parameter("attach", type=bool, start=False, description="attach to an ArduPilot started by the user"),
        Parameter(
            "executable",
            type=str,
            start="",
            description="program to start; default: the environment variable ARDUPILOT_SITL",
        ),
        Parameter("defaults", type=str, start="", description="parameter files, separated by commas"),
        Parameter(
            "folder",
            type=str,
            start="",
            description="working folder with parameters and logs; default: a temporary one",
        ),
        Parameter("speedup", unit="1", start=100.0, minimum=1.0, description="maximum speed relative to real time"),
        Parameter(
            "start_timeout", unit="s", start=60.0, minimum=0.0, description="limit of its start-up in wall-clock time"
        ),
        Parameter("step_timeout", unit="s", start=20.0, minimum=0.0, description="limit of a step in wall-clock time"),
        Parameter(
            "origin_latitude",
            unit="rad",
            start=math.radians(-35.363262),
            verdict=Role.ORIGIN_LATITUDE,
            description="latitude of the local origin",
        ),
        Parameter(
            "origin_longitude",
            unit="rad",
            start=math.radians(149.165237),
            verdict=Role.ORIGIN_LONGITUDE,
            description="longitude of the local origin",
        ),
        Parameter(
            "origin_altitude",
            unit="m",
            start=584.0,
            verdict=Role.ORIGIN_ALTITUDE,
            description="altitude of the local origin above mean sea level",
        ),
        Output("motor", shape=MAX_MOTORS, unit="1", start=0.0, description="commands, (pwm - 1000) / 1000"),
        Output(
            "armed",
            type=bool,
            start=False,
            verdict=Role.ARMED,
            description="the motors may turn, according to the last HEARTBEAT",
        ),
        Output("mode", type=int, start=0, description="mode, by the firmware's number"),
        Output("on_ground", type=bool, start=True, description="on the ground, according to ArduPilot"),
        Output("clock", unit="s", start=0.0, description="ArduPilot's clock: the time of the last reply"),
        Output(
            "lost",
            type=int,
            start=0,
            verdict=Bound(most=0, text="servo packets of ArduPilot were lost: the computer may be too slow"),
            description="number of lost servo packets",
        ),
        Output(
            "restarts",
            type=int,
            start=0,
            verdict=Bound(most=0, text="ArduPilot has restarted"),
            description="number of restarts of ArduPilot",
        ),
        PacketOutput("mavlink_tx", capacity=4096, description="packets sent"),
    )

    def initialize(self) -> None:
        """Checks the airframe; ArduPilot starts only when all inputs are known."""
        if int(self.m.airframe) not in FRAMES:
            frames = ", ".join(frame.name for frame in FRAMES)
            raise ValueError(f"airframe {int(self.m.airframe)}: ArduPilot has frames for {frames}")
        self._frame = FRAMES[Airframe(int(self.m.airframe))]

    def exit_initialization_mode(self) -> None:
        """Starts or finds ArduPilot and waits for its first servo outputs."""
        super().exit_initialization_mode()
        try:
            self._begin()
        except (RuntimeError, TimeoutError) as error:  # errors that the user can fix need no traceback
            self.log(str(error))
            raise
        except BaseException:
            with self._logged():
                raise

    def _begin(self) -> None:
        m = self.m
        number = int(m.instance) if m.instance >= 0 else int(m.SYSID_THISMAV) - 1
        self._program: Program | None = None
        self._prepare()
        self._serial = _Serial()
        port = PORT + 10 * number if m.attach else 0  # an ArduPilot started here is told the port
        try:
            self._link = Link(port)
        except OSError as error:
            raise RuntimeError(f"UDP port {port} of instance {number} cannot be opened: {error.strerror}") from None
        programs: list[Program] = []
        folder = Path(self.strings["folder"] or tempfile.mkdtemp(prefix=f"ardupilot-{number}-")).resolve()
        passing = None if self.strings["folder"] else folder
        self._end = weakref.finalize(self, _end, self._link, self._serial, programs, passing)
        try:
            if m.attach:
                self._serial.connect(_SERIAL + 10 * number, float(m.start_timeout))
            else:
                programs.append(self._start(number, folder))
            self._set_motors(self._link.next(float(m.start_timeout), self._alive))
        except BaseException:
            self._end()
            raise

    def _prepare(self) -> None:
        """Finds the values that each step reads and sets."""
        m, firmware = self.m, self._frame.firmware
        offsets = [m.dtype.fields[name][1] + 8 * i for name in MOTION for i in range(m[name].size)]
        self._motion = np.array(offsets) // 8
        reply = bytearray(REPLY_SIZE)
        self._reply, self._reply_bytes = np.frombuffer(reply, np.uint8), memoryview(reply)
        self._motor, (self._channels, self._rests) = m["motor"], firmware.outputs()
        self._received, self._received_len = m["mavlink_rx"], self.one("mavlink_rx_len")
        self._sent, self._sent_len = m["mavlink_tx"], self.one("mavlink_tx_len")
        self._clock, self._lost, self._restarts = self.one("clock"), self.one("lost"), self.one("restarts")
        self._limit = float(m["step_timeout"])

    def _start(self, number: int, folder: Path) -> Program:
        strings = self.strings
        executable = strings["executable"] or os.environ.get("ARDUPILOT_SITL", "")
        if not executable:
            raise RuntimeError(_NO_BINARY)
        path = program_of(self._frame.firmware, Path(executable).resolve())
        if not os.access(path, os.X_OK) or not path.is_file():
            raise RuntimeError(f"{path} is not an executable program; {_NO_BINARY}")
        folder.mkdir(parents=True, exist_ok=True)
        frame = folder / "frame.parm"
        frame.write_text(self._frame.parameters)
        command = [
            str(path),
            *self._arguments(number, [*_defaults(strings["defaults"], path, self._frame.firmware), frame]),
        ]
        self._program = Program(command, folder, folder / "ardupilot.log")
        self.log(f"started: {shlex.join(command)} in {folder}")
        return self._program

    def _arguments(self, number: int, defaults: list[Path]) -> list[str]:
        m = self.m
        home = (math.degrees(m.origin_latitude), math.degrees(m.origin_longitude), float(m.origin_altitude), 0)
        return [
            f"-I{number}",
            *("--model", "JSON:127.0.0.1"),
            *("--sim-port-out", str(self._link.port)),
            *("--start-time", str(_START_TIME)),
            *("--defaults", ",".join(map(str, defaults))),
            *("--sysid", str(int(m.SYSID_THISMAV))),
            *("--home", ",".join(f"{x:.9g}" for x in home)),
            *("--speedup", f"{float(m.speedup):g}"),
            *("--serial0", f"udpclient:127.0.0.1:{self._serial.listen()}", "--serial1", "none", "--serial2", "none"),
        ]

    def _alive(self) -> None:
        self._serial.receive(self._sent.size)  # a restarted ArduPilot may wait for a connection
        if self._program is not None and (how := self._program.ended()):
            raise RuntimeError(f"ArduPilot exited with {how}")

    def do_step(self, t: float, h: float) -> bool:
        """Lets ArduPilot's clock advance to t + h. The resulting servo outputs are read when outputs are requested.

        ArduPilots stepped by one master therefore run in parallel, each in its own process. No reply may have time 0:
        until ArduPilot's clock has a time, it follows the wall clock, and then waits for simulated time to catch up.
        """
        if self._waits:
            self._finish()
        firmware = self._frame.firmware
        if h * _GYRO_RATE * firmware.loop > 1.0 and self._clock[0] == 0.0:
            most = 1000.0 / (_GYRO_RATE * firmware.loop)
            self.log(
                f"steps of {h:g} s are too long for {firmware.name}'s loop of {firmware.loop:g} Hz: it will not arm "
                f"above {math.floor(100.0 * most) / 100.0:g} ms"
            )
        self._serial.write(self._received[: self._received_len[0]])
        size = put_reply(self._reply, t + h, self._reals, self._motion)
        self._link.reply(self._reply_bytes[:size])
        self._waits = True
        self._clock[0] = t + h
        return True

    def _before_get(self) -> None:
        if self._waits:
            try:
                self._finish()
            except Exception:
                with self._logged():
                    raise
        elif self._initialising:
            super()._before_get()

    def _finish(self) -> None:
        """Waits for the servo outputs that follow the last reply, and reads the serial port."""
        self._waits = False
        link = self._link
        servos = link.next(self._limit, self._alive)
        self._lost[0], self._restarts[0] = link.lost, link.restarts
        self._set_motors(servos)
        self._hear()

    def _set_motors(self, servos: Servos) -> None:
        put_commands(self._motor, servos.pwm, self._channels, self._rests)

    def _hear(self) -> None:
        """Passes packets of the serial port to the output; the heartbeat sets ArduPilot's status."""
        m = self.m
        packets = self._serial.read(self._sent.size)
        self._sent_len[0] = len(packets)
        if not packets:
            return
        buffer = np.frombuffer(packets, np.uint8)
        self._sent[: len(packets)] = buffer
        p = 0
        while p < len(packets):
            start, p, status = find(buffer, p, len(packets))
            if status not in (GOOD, SIGNED) or message_id(buffer, start) != _HEARTBEAT:
                continue
            if component(buffer, start) != _AUTOPILOT:
                continue
            first = payload_start(buffer, start)
            payload = packets[first : first + 9].ljust(9, b"\0")
            m["mode"] = int.from_bytes(payload[:4], "little", signed=True)
            m["armed"] = bool(payload[6] & _ARMED)
            m["on_ground"] = payload[7] <= _STANDBY or not self._frame.firmware.flies

    def terminate(self) -> None:
        """Ends ArduPilot if it was started here."""
        if self._end is not None:
            self._end()


def _end(link: Link, serial: _Serial, programs: list[Program], passing: Path | None) -> None:
    link.close()
    serial.close()
    for program in programs:
        program.end()
    if passing is not None:
        shutil.rmtree(passing, ignore_errors=True)


def _defaults(given: str, executable: Path, firmware: Firmware) -> list[Path]:
    """Returns the parameter files: those given, else ArduPilot's own for the firmware if the program lies in its source
    tree.
    """
    files = [Path(name.strip()).resolve() for name in given.split(",") if name.strip()]
    for file in files:
        if not file.is_file():
            raise RuntimeError(f"defaults: no such file: {file}")
    if not files and len(executable.parents) > 3:
        folder = executable.parents[3] / "Tools" / "autotest"
        files = [own for name in firmware.defaults if (own := folder / name).is_file()][:1]
    return files
