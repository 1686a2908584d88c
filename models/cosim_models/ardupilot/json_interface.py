"""ArduPilot's JSON interface: lock-step datagrams between a simulated autopilot and its physics.

ArduPilot sends its servo outputs and waits. Each reply contains the time and the true motion, advances ArduPilot's
clock to that time, and is answered by the next servo outputs: one reply, one step. A withheld reply stops the clock.

This module starts no processes and does not use MAVLink.

Source: ArduPilot, libraries/SITL/SIM_JSON and examples/JSON/readme.md.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PORT", "Link", "Servos", "decode_servos"]

PORT = 9002
"""UDP port of the physics of instance 0; instance n uses PORT + 10 n."""

_HEADER = struct.Struct("<HHI")
_SIZES = {18458: 40, 29569: 72}
"""Bytes by magic number: 16 channels, or 32 with SERVO_32_ENABLE."""
_MOST = 128
"""Bytes read of a datagram: more than any servo packet has."""
_POLL = 0.05
"""Interval in seconds at which the link checks that ArduPilot is still running."""
_POLL_OPTION = struct.pack("I", 50) if sys.platform == "win32" else struct.pack("@ll", 0, 50_000)
"""The same for the operating system: a socket with a timeout of Python's would ask twice for each datagram."""
_PATIENCE = 0.5
"""Waiting time in seconds after which a repeated servo packet means that the reply was lost. ArduPilot repeats its
packet every second while it waits. A packet that is available at once was sent while the reply was withheld; a second
reply to it would be taken as the reply to the next packet."""


class Servos(NamedTuple):
    """Servo packet of ArduPilot: desired reply rate in Hz, packet number, pulses in us of 16 or 32 channels."""

    rate: int
    frame_count: int
    pwm: NDArray[np.uint16]


def decode_servos(datagram: bytes) -> Servos | None:
    """Decodes a servo datagram (16 or 32 channels); returns None if it is malformed."""
    if len(datagram) < _HEADER.size:
        return None
    magic, rate, frame_count = _HEADER.unpack_from(datagram)
    if len(datagram) != _SIZES.get(magic):
        return None
    return Servos(rate, frame_count, np.frombuffer(datagram, "<u2", offset=_HEADER.size))


class Link:
    """The physics side of the link. Call `next` once, then `reply` and `next` for every step.

    Args:
        port: UDP port on loopback; 0: any that is free.

    Attributes:
        port: the port in use.
        repeated: repeated servo packets, sent because ArduPilot had to wait; they have no effect.
        lost: servo packets that never arrived.
        restarts: number of restarts of ArduPilot.

    Raises:
        OSError: the port is in use.
    """

    def __init__(self, port: int) -> None:
        self.repeated = self.lost = self.restarts = 0
        self._last = -1
        self._reply: bytes | memoryview = b""
        self._since = 0.0
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError:
            self._socket.close()
            raise
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _POLL_OPTION)
        self.port = int(self._socket.getsockname()[1])

    def reply(self, reply: bytes | memoryview) -> None:
        """Sends a reply to the latest servo outputs; `next` then waits for the following ones.

        The bytes are sent again if they are lost: they must stay as they are until the next reply.
        """
        assert self._peer is not None, "call next() first"
        self._reply = reply
        self._socket.sendto(reply, self._peer)

    def next(self, seconds: float, alive: Callable[[], None]) -> Servos:
        """Waits for ArduPilot's next servo outputs, or initially for the first.

        Args:
            seconds: maximum waiting time.
            alive: called regularly; raises an exception if waiting is pointless.

        Raises:
            TimeoutError: no packet arrived.
        """
        self._since = time.monotonic()
        end = self._since + seconds
        while True:
            try:
                datagram, peer = self._socket.recvfrom(_MOST)
            except (BlockingIOError, TimeoutError):
                alive()
                if time.monotonic() > end:
                    raise TimeoutError(f"ArduPilot has sent no servo outputs for {seconds:g} s") from None
                continue
            except ConnectionError:  # no process listens at the address of the last reply
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
        """Releases the port."""
        self._socket.close()
