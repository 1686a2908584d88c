"""Sockets of gateways: they send and receive without blocking, and report each peer that connects or disconnects.

`TcpServer` serves one client at a time, as a serial port does; a stream does not delimit packets. `Udp` exchanges
datagrams with one given peer (udpout), or with all peers that have sent one within the last minute (udpin). This module
does not interpret packets.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

__all__ = ["KINDS", "Report", "Socket", "TcpServer", "Udp", "open_socket"]

KINDS = ("tcp", "udpin", "udpout")

Report: TypeAlias = Callable[[str], None]
"""A callback for messages about a socket."""

_PIECE = 65536
_BACKLOG = 1 << 20
"""Bytes that may wait for a TCP client that does not read."""
_SILENCE = 60.0
"""Seconds without packets after which a UDP peer is removed."""
_FAREWELL = 0.5
"""Seconds for which closing waits for a TCP client to take the remaining bytes."""


class Socket(Protocol):
    """One end of a link to real programs."""

    stream: bool
    """Whether packets may be cut and joined: TCP."""
    port: int
    """The port that it is bound to."""

    def start(self) -> None:
        """Accepts connections from now on. Earlier clients are refused, since they expect answers."""

    def receive(self) -> list[bytes]:
        """Returns the bytes received since the last call; b"" between the streams of two clients."""

    def send(self, packets: Sequence[bytes]) -> int:
        """Sends packets to the listeners; returns the number of packets that reached one."""

    def close(self) -> None:
        """Sends the remaining bytes to the listeners and closes the connections."""


class TcpServer:
    """A server for one client at a time. Further clients are rejected.

    Raises:
        OSError: the address cannot be bound.
    """

    stream = True

    def __init__(self, host: str, port: int, report: Report) -> None:
        self._report = report
        self._client: socket.socket | None = None
        self._peer = ""
        self._unsent = bytearray()
        self._listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listening.bind((host, port))
        except OSError:
            self._listening.close()
            raise
        self._listening.setblocking(False)
        self._host, self.port = self._listening.getsockname()[:2]

    def start(self) -> None:
        self._listening.listen(4)
        self._report(f"listens on {self._host}:{self.port}")

    def _accept(self) -> None:
        while True:
            try:
                client, (host, port, *_) = self._listening.accept()
            except BlockingIOError:
                return
            except OSError as error:
                self._report(f"a client cannot be accepted: {error.strerror}")
                return
            if self._client is not None:
                self._report(f"client {host}:{port} is turned away: {self._peer} is connected")
                client.close()
                continue
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client, self._peer = client, f"{host}:{port}"
            self._report(f"client {self._peer} has connected")

    def receive(self) -> list[bytes]:
        pieces: list[bytes] = []
        if self._client is not None:
            try:
                while len(pieces) < 16:
                    piece = self._client.recv(_PIECE)
                    if not piece:
                        pieces.append(b"")
                        self._hang_up("has disconnected")
                        break
                    pieces.append(piece)
            except BlockingIOError:
                pass
            except OSError as error:
                pieces.append(b"")
                self._hang_up(f"is gone: {error.strerror}")
        self._accept()
        return pieces

    def _hang_up(self, what: str) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
            lost = f", {len(self._unsent)} bytes for it are lost" if self._unsent else ""
            self._unsent.clear()
            self._report(f"client {self._peer} {what}{lost}")

    def send(self, packets: Sequence[bytes]) -> int:
        if self._client is None:
            return 0
        taken = 0
        for packet in packets:
            if len(self._unsent) + len(packet) <= _BACKLOG:
                self._unsent += packet
                taken += 1
        self._flush()
        return taken

    def _flush(self) -> None:
        try:
            while self._client is not None and self._unsent:
                del self._unsent[: self._client.send(self._unsent)]
        except BlockingIOError:
            pass
        except OSError as error:
            self._hang_up(f"is gone: {error.strerror}")

    def close(self) -> None:
        self._listening.close()
        if self._client is not None and self._unsent:
            self._client.settimeout(_FAREWELL)
            self._flush_all()
        self._hang_up("is hung up on: the run is over")

    def _flush_all(self) -> None:
        try:
            if self._client is not None:
                self._client.sendall(self._unsent)
                self._unsent.clear()
        except OSError:
            pass  # _hang_up reports the remaining bytes


class Udp:
    """Exchanges datagrams with one peer, or with all peers that are heard.

    Args:
        host, port: the address of the peer if `outward`, otherwise the address to bind to.

    Raises:
        OSError: the address is invalid or cannot be bound.
    """

    stream = False

    def __init__(self, host: str, port: int, report: Report, *, outward: bool) -> None:
        self._report = report
        self._peers: dict[tuple[str, int], float] = {}
        self._deaf: set[tuple[str, int]] = set()
        self._fixed: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BACKLOG)
            self._socket.setblocking(False)
            if outward:
                self._socket.connect((host, port))
                self._fixed = self._socket.getpeername()[:2]
            else:
                self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self._host, self.port = self._socket.getsockname()[:2]

    def start(self) -> None:
        if self._fixed is not None:
            self._report(f"sends to {self._fixed[0]}:{self._fixed[1]}")
        else:
            self._report(f"listens on {self._host}:{self.port}")

    def receive(self) -> list[bytes]:
        pieces = []
        for _ in range(1024):
            try:
                datagram, peer = self._socket.recvfrom(_PIECE)
            except BlockingIOError:
                break
            except OSError as error:
                if self._fixed is not None:
                    self._cannot_reach(self._fixed, error)
                continue
            if datagram:
                self._heard((peer[0], peer[1]))
                pieces.append(datagram)
        return pieces

    def _heard(self, peer: tuple[str, int]) -> None:
        if peer not in self._peers:
            self._report(f"{peer[0]}:{peer[1]} is heard")
        self._peers[peer] = time.monotonic()
        self._deaf.discard(peer)

    def send(self, packets: Sequence[bytes]) -> int:
        oldest = time.monotonic() - _SILENCE
        for peer in [peer for peer, heard in self._peers.items() if heard < oldest]:
            del self._peers[peer]
            self._report(f"{peer[0]}:{peer[1]} has been silent for {_SILENCE:g} s")
        peers = [self._fixed] if self._fixed is not None else list(self._peers)
        return sum(max([self._send(packet, peer) for peer in peers], default=False) for packet in packets)

    def _send(self, packet: bytes, peer: tuple[str, int]) -> bool:
        try:
            if self._fixed is not None:
                self._socket.send(packet)
            else:
                self._socket.sendto(packet, peer)
        except BlockingIOError:
            return False
        except OSError as error:
            self._cannot_reach(peer, error)
            return False
        return True

    def _cannot_reach(self, peer: tuple[str, int], error: OSError) -> None:
        self._peers.pop(peer, None)
        if peer not in self._deaf:
            self._deaf.add(peer)
            self._report(f"{peer[0]}:{peer[1]} cannot be reached: {error.strerror}")

    def close(self) -> None:
        self._socket.close()


def open_socket(kind: str, host: str, port: int, report: Report) -> Socket:
    """Opens a socket of one of `KINDS`.

    Raises:
        OSError: the address is invalid or cannot be bound.
    """
    if kind == "tcp":
        return TcpServer(host, port, report)
    return Udp(host, port, report, outward=kind == "udpout")
