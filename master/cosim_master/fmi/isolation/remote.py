"""The process of an FMU on another machine, where `uav-cosim serve` runs, and the beginning of a connection to it.

A connection is for one FMU file. It begins with messages in JSON, each preceded by its length (4 bytes, big endian):

    server   protocol, version, nonce
    master   nonce, proof: the keyed digest (HMAC-SHA256) of both nonces with the token
    server   proof
    master   digest, bytes and name of the FMU file, memory limit, time limit
    server   whether it has the file; if not, the master sends its bytes
    server   the folder of its resources there, whether it exists, whether it needs Python, its limits

Either side may send `error` instead, a text, and close the connection. The token itself is never sent. Then the C
library takes over the socket (remote.h).
"""

from __future__ import annotations

import errno
import hashlib
import hmac
import json
import os
import secrets
import socket
import struct
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from cosim_master.diagnostics.errors import printable
from cosim_master.fmi.isolation.child import FIRST_BYTES, Limits, Process

__all__ = ["Address", "Conversation", "Refused", "Remote", "proof", "protocol"]

SILENCE = 10.0
"""Wall-clock time without any message after which a connection counts as lost, s; a busy process sends one a second."""
_LONGEST = 1 << 16
_BLOCK = 1 << 20


class Refused(Exception):
    """The other side does not go on; the text is its reason."""


@dataclass(frozen=True, slots=True)
class Address:
    """A machine, by name or number, and a port."""

    machine: str
    port: int

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Returns the address in MACHINE:PORT; numbers of IPv6 are in brackets.

        Raises:
            ValueError: it has no such form.
        """
        machine, colon, port = text.rpartition(":")
        if not colon or not machine or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ValueError(f'"{text}" is not MACHINE:PORT, e.g. 192.168.0.7:5600')
        return cls(machine[1:-1] if machine.startswith("[") and machine.endswith("]") else machine, int(port))

    def __str__(self) -> str:
        """Returns MACHINE:PORT."""
        return f"[{self.machine}]:{self.port}" if ":" in self.machine else f"{self.machine}:{self.port}"


@cache
def protocol() -> str:
    """Returns a text that both sides must have in common: a digest of the messages' definition, and the byte order."""
    digest = hashlib.sha256()
    for name in ("channel.h", "functions.h", "remote.h", "remote.py"):
        digest.update((Path(__file__).parent / name).read_bytes())
    return f"{digest.hexdigest()[:16]} {sys.byteorder}"


def proof(token: str, side: str, *nonces: str) -> str:
    """Returns the proof that a side ("master" or "server") knows the token."""
    return hmac.new(token.encode(), " ".join((side, *nonces)).encode(), hashlib.sha256).hexdigest()


class Conversation:
    """The messages at the beginning of a connection.

    Every method raises OSError if the connection is lost, and Refused if the other side says so or breaks the protocol.
    """

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection

    def say(self, **content: Any) -> None:
        """Sends a message."""
        data = json.dumps(content).encode()
        self.socket.sendall(struct.pack(">I", len(data)) + data)

    def hear(self) -> dict[str, Any]:
        """Returns the next message."""
        (size,) = struct.unpack(">I", self._exactly(4))
        if size > _LONGEST:
            raise Refused("it does not speak the protocol of uav-cosim serve")
        try:
            content = json.loads(self._exactly(size))
        except ValueError:
            content = None
        if not isinstance(content, dict):
            raise Refused("it does not speak the protocol of uav-cosim serve")
        if "error" in content:
            raise Refused(printable(str(content["error"])[:2000]))
        return content

    def _exactly(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            block = self.socket.recv(min(size - len(data), _BLOCK))
            if not block:
                raise ConnectionResetError("it has closed the connection")
            data += block
        return bytes(data)

    def introduce(self, token: str) -> None:
        """Begins a conversation as the master, and checks that the server knows the token."""
        hello = self.hear()
        if hello.get("protocol") != protocol():
            theirs, ours = printable(str(hello.get("version"))[:40]), version("uav-cosim")
            raise Refused(
                f"it runs uav-cosim {theirs} with another protocol than uav-cosim {ours} here; "
                "install the same version on both machines"
            )
        nonces = str(hello.get("nonce")), secrets.token_hex(16)
        self.say(nonce=nonces[1], proof=proof(token, "master", *nonces))
        if not hmac.compare_digest(str(self.hear().get("proof")), proof(token, "server", *nonces)):
            raise Refused("it does not know the token")

    def send_file(self, path: Path) -> None:
        """Sends the bytes of a file."""
        with path.open("rb") as file:
            self.socket.sendfile(file)

    def blocks(self, size: int) -> Any:
        """Yields `size` bytes in blocks."""
        while size:
            block = self._exactly(min(size, _BLOCK))
            size -= len(block)
            yield block


def keep_alive(connection: socket.socket) -> None:
    """Sets a socket up for many small messages, and for the loss of the other machine."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 4)):
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


class Remote(Process):
    """The process of an FMU file on another machine.

    Args:
        fmu: the FMU file.
        digest: its SHA-256.
        token: the secret of the server.

    Attributes:
        folder: that of the FMU's resources there.
        has_resources: the folder exists.
        python: the FMU needs a Python interpreter.

    Raises:
        CannotIsolate: the C library is not available here.
        OSError: nobody listens there, or the connection is lost.
        Refused: the server refuses, e.g. the token, or cannot load the FMU.
    """

    def __init__(self, fmu: Path, digest: str, address: Address, token: str, limits: Limits) -> None:
        super().__init__(limits, fmu.stem)
        self._address, self._token, self._fmu, self._digest = address, token, fmu, digest
        self._silence, self._killed = SILENCE, False
        self._memory = os.memfd_create("uav-cosim")
        try:
            os.ftruncate(self._memory, FIRST_BYTES)
            self._socket, answer = self._connected()
        except BaseException:
            os.close(self._memory)
            raise
        self.folder, self.python = Path(answer["resources"]), bool(answer["python"])
        self.has_resources = bool(answer["resourceful"])
        self.limits = Limits(
            limits.seconds, int(answer["memory"]), bool(answer["restricted"]), limits.restarts, limits.requests
        )
        self._open(self.functions.isolated_connect(self._memory, self._socket.fileno(), *limits.of_calls))

    def _connected(self) -> tuple[socket.socket, dict[str, Any]]:
        connection = socket.create_connection((self._address.machine, self._address.port), self._silence)
        try:
            keep_alive(connection)
            talk = Conversation(connection)
            talk.introduce(self._token)
            size = self._fmu.stat().st_size
            limits = {"memory": self.limits.memory, "seconds": self.limits.seconds}
            talk.say(digest=self._digest, bytes=size, name=self._fmu.name, **limits)
            if not talk.hear().get("present"):
                talk.send_file(self._fmu)
            connection.settimeout(self.limits.of_calls[1] or None)  # it unpacks and loads the FMU
            answer = talk.hear()
            if not {"resources", "resourceful", "python", "memory", "restricted"} <= answer.keys():
                raise Refused("it does not speak the protocol of uav-cosim serve")
            connection.setblocking(True)
            limit = struct.pack("ll", int(self._silence), int(self._silence % 1 * 1e6))
            for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
                connection.setsockopt(socket.SOL_SOCKET, option, limit)
        except BaseException:
            connection.close()
            raise
        return connection, answer

    def _renew(self) -> bool:
        old = self._socket
        try:
            self._socket, _ = self._connected()
        except Refused as error:
            raise OSError(str(error)) from None
        old.close()
        return bool(self.functions.isolated_reconnect(self.channel, self._socket.fileno()))

    def _loss(self, number: int) -> str:
        if self._killed:
            return f"the connection to {self._address} was closed here"
        if number in (0, errno.ECONNRESET, errno.EPIPE):
            cause = f"{self._address} has closed it"
        elif number == errno.EAGAIN:
            cause = f"nothing was heard of {self._address} for {self._silence:g} s"
        else:
            cause = f"{self._address}: {os.strerror(number)}"
        return f"the connection to its process was lost: {cause}"

    def kill(self) -> None:
        if not self._closed:
            self._killed = True
            self.functions.isolated_give_up(self.channel)
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)

    def _stop(self) -> None:
        self._socket.close()
        os.close(self._memory)
