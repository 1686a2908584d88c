"""FMUs for masters on other machines: `uav-cosim serve`.

    with Server("127.0.0.1", 5600, token) as server:
        server.serve()          until `close` is called, from another thread or a signal handler

Every connection has a thread of its own and is for one FMU file, which runs in a process of its own, as isolated FMUs
do (`fmi.isolation`). A file that the master sends is kept by its digest. `fmi.isolation.remote` describes the messages.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import secrets
import socket
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from cosim.kernel import forget_unused
from cosim_master.diagnostics.errors import CosimError, printable
from cosim_master.files.kept import private_cache
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.isolation.building import CannotIsolate, binaries
from cosim_master.fmi.isolation.child import Limits
from cosim_master.fmi.isolation.remote import Conversation, Refused, keep_alive, proof, protocol
from cosim_master.fmi.slaves.isolated import IsolatedLibrary, Isolation, isolable
from cosim_master.fmi.slaves.libraries import Libraries

__all__ = ["Server"]

log = logging.getLogger(__name__)

_INTRODUCTION = 10.0
"""Wall-clock time in which a master must introduce itself, s."""
_LARGEST_FMU = 4 << 30
_MOST = 256
"""Connections at a time."""


class Server:
    """Listens for masters, and runs FMUs for those that know the token.

    Args:
        bind: the address to listen at.
        port: 0 selects a free one.
        token: a text that the master must know.
        limits: of the processes of FMUs; a lower memory limit and the time limits of a master precede them.
        told: called with a text when an FMU begins or ends, and about connections that are refused.

    Attributes:
        port: the port.

    Raises:
        OSError: the port cannot be used.
        CannotIsolate: FMUs cannot have processes here.
    """

    def __init__(
        self, bind: str, port: int, token: str, limits: Limits | None = None, told: Callable[[str], None] = log.info
    ) -> None:
        binaries()
        if not token:
            raise ValueError("a server of FMUs needs a token")
        self._token, self._limits, self._told = token, limits or Limits(), told
        family = socket.AF_INET6 if ":" in bind else socket.AF_INET
        self._listening = socket.create_server((bind, port), family=family)
        self.port = int(self._listening.getsockname()[1])
        self._lock = threading.Lock()
        self._open: dict[socket.socket, threading.Thread] = {}
        self._closed = False

    def serve(self) -> None:
        """Accepts connections until `close`."""
        while not self._closed:
            try:
                connection, (machine, port, *_) = self._listening.accept()
            except OSError:
                if self._closed:
                    return
                raise
            who = f"{machine}:{port}"
            thread = threading.Thread(target=self._served, args=(connection, who), name=who, daemon=True)
            with self._lock:
                if self._closed or len(self._open) >= _MOST:
                    connection.close()
                    continue
                self._open[connection] = thread
            thread.start()

    def close(self) -> None:
        """Ends all FMUs and the connections to their masters."""
        self._closed = True
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        with self._lock:
            waiting = list(self._open.items())
        for connection, _ in waiting:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        for _, thread in waiting:
            thread.join()

    def _served(self, connection: socket.socket, who: str) -> None:
        talk = Conversation(connection)
        try:
            keep_alive(connection)
            connection.settimeout(_INTRODUCTION)
            self._introduced(talk)
            connection.settimeout(None)
            self._run(talk, who)
        except (Refused, CosimError, CannotIsolate) as error:
            self._told(printable(f"{who}: {error}"))
            with suppress(OSError):
                talk.say(error=str(error))
        except OSError as error:
            self._told(f"{who}: the connection was lost: {error.strerror or error}")
        finally:
            with self._lock:
                connection.close()
                self._open.pop(connection, None)

    def _introduced(self, talk: Conversation) -> None:
        """Checks that a master knows the token, and proves that this side does."""
        nonce = secrets.token_hex(16)
        talk.say(protocol=protocol(), version=version("uav-cosim"), nonce=nonce)
        answer = talk.hear()
        nonces = nonce, str(answer.get("nonce"))
        if not hmac.compare_digest(str(answer.get("proof")).encode(), proof(self._token, "master", *nonces).encode()):
            raise Refused("the token is not that of this server; set UAV_COSIM_TOKEN to the one that it shows")
        talk.say(proof=proof(self._token, "server", *nonces))

    def _run(self, talk: Conversation, who: str) -> None:
        """Loads the FMU that a master asks for, and makes its calls until the connection ends."""
        request = talk.hear()
        fmu = describe(self._file(talk, request))
        if not isolable(fmu):
            raise Refused(f"{request.get('name')} is a table or of FMI 1, which do not run on other machines")
        memory, seconds = request.get("memory"), request.get("seconds")
        limits = self._limits if not isinstance(memory, int) else replace(self._limits, memory=memory)
        limits = replace(limits, memory=min(limits.bytes, self._limits.bytes))
        if isinstance(seconds, (int, float)):
            limits = replace(limits, seconds=float(seconds))
        with Libraries(Isolation("all", limits)) as libraries:
            library = libraries.load(fmu)
            assert isinstance(library, IsolatedLibrary)
            resources = library.resources
            talk.say(
                resources=str(resources),
                resourceful=resources.is_dir(),
                python=library.python,
                memory=library.child.limits.bytes,
                restricted=library.child.limits.restricted,
            )
            name = printable(str(request.get("name")))
            self._told(f"{who}: {name} begins")
            talk.socket.setblocking(True)
            library.child.functions.isolated_relay(library.child.channel, talk.socket.fileno())
            end = library.child.end()
            self._told(f"{who}: {name} ends{'' if end is None else ': ' + end.text}")

    def _file(self, talk: Conversation, request: dict[str, Any]) -> Path:
        """Returns the FMU file with the digest that a master names, which sends it if it is not here yet."""
        digest, size = str(request.get("digest")), request.get("bytes")
        if len(digest) != 64 or set(digest) - set("0123456789abcdef"):
            raise Refused("it names no FMU file")
        if not isinstance(size, int) or not 0 < size <= _LARGEST_FMU:
            raise Refused(f"an FMU file has at most {_LARGEST_FMU >> 30} GiB")
        folder = private_cache() / "hosted"
        folder.mkdir(exist_ok=True)
        forget_unused(folder)
        file = folder / f"{digest}.fmu"
        present = file.is_file() and file.stat().st_size == size and _digest(file) == digest
        talk.say(present=present)
        if present:
            os.utime(file)
            return file
        number, name = tempfile.mkstemp(dir=folder, prefix="part-")
        try:
            found = hashlib.sha256()
            with open(number, "wb") as part:  # noqa: PTH123
                for block in talk.blocks(size):
                    part.write(block)
                    found.update(block)
            if found.hexdigest() != digest:
                raise Refused("the FMU file has changed while it was sent")
            Path(name).replace(file)
        finally:
            Path(name).unlink(missing_ok=True)
        return file

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _digest(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
