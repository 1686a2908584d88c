"""ArduPilot's JSON interface: the datagrams between a simulated autopilot and the physics it flies, in lock step.

ArduPilot sends its servo outputs and waits. Each reply carries the time and the true motion, moves ArduPilot's clock on
to that time, and brings the next servo outputs: one reply, one step. A reply that is withheld stops its clock.

Starts nothing and knows no MAVLink.

Source: ArduPilot, libraries/SITL/SIM_JSON and examples/JSON/readme.md.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

__all__ = ["PORT", "Link", "Servos", "decode_servos", "encode_motion"]

PORT = 9002
"""UDP port of the physics of instance 0; instance n has PORT + 10 n."""

_FORMATS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}
"""By magic number: 16 channels, or 32 with SERVO_32_ENABLE."""
_STRETCH = 1.0 + 1e-8
"""ArduPilot adds up the differences of timestamps in whole microseconds and cuts off the rest: a step that is too short
by the rounding of numbers would lose one, and its clock 0.2 ms in each second."""
_ENCODE = json.JSONEncoder(separators=(",", ":"), check_circular=False).encode
_SIZE = 65536
_POLL = 0.05
"""Seconds between looks at whether ArduPilot is still there."""
_PATIENCE = 0.5
"""Seconds of waiting from which on a servo packet that comes again says that the reply is lost. ArduPilot repeats
itself every second that it waits. What is there at once was sent while the reply was withheld; a second reply to it
would be taken for that to the next packet."""


@dataclass(frozen=True, slots=True)
class Servos:
    """What ArduPilot says: the rate in Hz at which it would like replies, number of the packet, pulses in us."""

    rate: int
    frame_count: int
    pwm: tuple[int, ...]


def decode_servos(datagram: bytes) -> Servos | None:
    """Servo outputs of 16 or 32 channels; None if the datagram is none."""
    if len(datagram) < 2:
        return None
    form = _FORMATS.get(int.from_bytes(datagram[:2], "little"))
    if form is None or len(datagram) != form.size:
        return None
    _, rate, frame_count, *pwm = form.unpack(datagram)
    return Servos(rate, frame_count, tuple(pwm))


def encode_motion(
    t: float,
    *,
    angular_velocity: Sequence[float],
    specific_force: Sequence[float],
    position: Sequence[float],
    velocity: Sequence[float],
    attitude: Sequence[float],
) -> bytes:
    """A reply.

    Args:
        t: time in s, above 0.
        angular_velocity, specific_force: FRD, rad/s and m/s2.
        position, velocity: NED from home, m and m/s.
        attitude: quaternion w, x, y, z that rotates FRD into NED.
    """
    fields: Mapping[str, object] = {
        "timestamp": t * _STRETCH,
        "imu": {"gyro": list(angular_velocity), "accel_body": list(specific_force)},
        "position": list(position),
        "quaternion": list(attitude),
        "velocity": list(velocity),
    }
    # ArduPilot searches for `"name":` and reads on from there, so no space may follow a colon.
    return b"\n" + _ENCODE(fields).encode("ascii") + b"\n"


class Link:
    """The physics' end. Call `next` once, then `reply` and `next` for every step.

    Args:
        port: UDP port on loopback; 0: any that is free.

    Attributes:
        port: the one that it has.
        repeated: servo packets that came again, since ArduPilot had to wait; they move nothing.
        lost: servo packets that never came.
        restarts: how often ArduPilot has begun anew.

    Raises:
        OSError: the port is taken.
    """

    def __init__(self, port: int) -> None:
        self.repeated = self.lost = self.restarts = 0
        self._last = -1
        self._reply = b""
        self._since = 0.0
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_POLL)
        self.port = int(self._socket.getsockname()[1])

    def reply(self, reply: bytes) -> None:
        """Send a reply to the servo outputs that came last; `next` then waits for those that it brings."""
        assert self._peer is not None, "next() comes first"
        self._reply = reply
        self._socket.sendto(reply, self._peer)

    def next(self, seconds: float, alive: Callable[[], None]) -> Servos:
        """Wait for ArduPilot's next servo outputs, at the start its first.

        Args:
            seconds: how long.
            alive: is called now and then, and raises if there is nothing to wait for.

        Raises:
            TimeoutError: nothing has come.
        """
        self._since = time.monotonic()
        end = self._since + seconds
        while True:
            try:
                datagram, peer = self._socket.recvfrom(_SIZE)
            except TimeoutError:
                alive()
                if time.monotonic() > end:
                    raise TimeoutError(f"ArduPilot has sent no servo outputs for {seconds:g} s") from None
                continue
            except ConnectionError:  # nobody listens where the last reply went
                alive()
                time.sleep(_POLL)
                continue
            servos = decode_servos(datagram)
            if servos is not None and self._is_new(servos, peer):
                return servos

    def _is_new(self, servos: Servos, peer: tuple[str, int]) -> bool:
        if servos.frame_count == self._last and peer == self._peer:
            self.repeated += 1
            if self._reply and time.monotonic() - self._since > _PATIENCE:
                self._since = time.monotonic()
                self._socket.sendto(self._reply, peer)
            return False
        if servos.frame_count < self._last or (self._peer is not None and peer != self._peer):
            self.restarts += 1
        elif self._last >= 0:
            self.lost += servos.frame_count - self._last - 1
        self._last, self._peer = servos.frame_count, peer
        return True

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
