"""The process of an FMU file that another program runs, such as Wine for an FMU of Windows: connected by TCP.

The program is `portable` (portable.c), which is also the form of an isolated process on macOS and Windows. It is
neither restricted nor limited in memory, because Wine itself needs sockets, files and memory.
"""

from __future__ import annotations

import hmac
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cosim_master.files import temporary
from cosim_master.fmi.isolation.building import shares_memory
from cosim_master.fmi.isolation.child import FIRST_BYTES, TOKEN, Limits, Process
from cosim_master.fmi.isolation.remote import keep_alive

__all__ = ["Runner"]

_SECRET = "UAV_COSIM_SECRET"
_START = 600.0
"""Wall-clock time in which the program must connect, s. The first start of Wine for a user takes a minute."""
_TICK = 0.1
_END_SECONDS = 2.0


class Runner(Process):
    """The process of an FMU file that a program runs.

    Args:
        command: the program and its arguments; empty if the system runs `program` itself.
        program: `portable`, for the system of the library.
        library: the binary of the FMU.
        folder: the unpacked FMU, its working directory.

    Raises:
        OSError: the program cannot be started, or does not connect.
    """

    def __init__(self, command: Sequence[str], program: Path, library: Path, folder: Path, limits: Limits) -> None:
        super().__init__(limits, Path(library).stem)
        self._command = [*command, str(program)]
        self._file, self._folder = str(library), folder
        self._temporary = temporary.made()
        self._connection: socket.socket | None = None
        self._memory = _memory()
        try:
            self._start()
        except BaseException:
            _close(self._memory)
            temporary.remove(self._temporary)
            raise
        assert self._connection is not None
        self._open(self.functions.isolated_connect(self._memory, self._connection.fileno(), *limits.of_calls))
        self.functions.isolated_direct(self.channel, _of_system(self._output))

    def _start(self) -> None:
        secret = secrets.token_hex(16)
        environment = {**os.environ, "TMPDIR": str(self._temporary), _SECRET: secret}
        environment.pop(TOKEN, None)
        reading, writing = os.pipe()
        with socket.create_server(("127.0.0.1", 0)) as listening:
            try:
                self._process = subprocess.Popen(
                    [*self._command, str(listening.getsockname()[1]), self._file],
                    stdin=subprocess.DEVNULL,
                    stdout=writing,
                    stderr=writing,
                    cwd=self._folder,
                    env=environment,
                    start_new_session=True,
                )
            except BaseException:
                os.close(reading)
                raise
            finally:
                os.close(writing)
            try:
                self._connection = self._connected(listening, secret)
            except BaseException:
                self._discard()
                os.close(reading)
                raise
        self._output = reading

    def _connected(self, listening: socket.socket, secret: str) -> socket.socket:
        """Returns the connection of the program, which proves that it is the one that was started."""
        listening.settimeout(_TICK)
        until = time.monotonic() + _START
        while time.monotonic() < until:
            try:
                connection, _ = listening.accept()
            except TimeoutError:
                if (code := self._process.poll()) is not None:
                    raise OSError(0, f"{self._command[0]} has ended with exit code {code}") from None
                continue
            connection.settimeout(_START)
            said = connection.recv(len(secret), socket.MSG_WAITALL)
            if hmac.compare_digest(said, secret.encode()):
                connection.settimeout(None)
                keep_alive(connection)
                return connection
            connection.close()
        raise OSError(0, f"{self._command[0]} has not connected within {_START:g} s")

    def _renew(self) -> bool:
        assert self._connection is not None
        old = self._connection, self._output
        self._discard()
        self._start()
        old[0].close()
        os.close(old[1])
        well = bool(self.functions.isolated_reconnect(self.channel, self._connection.fileno()))
        self.functions.isolated_direct(self.channel, _of_system(self._output))
        return well

    def _loss(self, number: int) -> str:
        with suppress(subprocess.TimeoutExpired):
            return f"it has ended its process with exit code {self._process.wait(_END_SECONDS)}"
        return f"the connection to its process was lost: {os.strerror(number) if number else 'it has closed it'}"

    def kill(self) -> None:
        if not self._closed:
            self.functions.isolated_give_up(self.channel)
            self._discard()

    def _wait(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_SECONDS)

    def _discard(self) -> None:
        with suppress(ProcessLookupError, PermissionError):
            if sys.platform == "win32":  # which has no groups; what the program has started ends without its master
                self._process.kill()
            else:
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _stop(self) -> None:
        self._discard()
        assert self._connection is not None
        self._connection.close()
        _close(self._memory)
        os.close(self._output)
        temporary.remove(self._temporary)


def _memory() -> int:
    """Returns a file in memory for messages; -1 where the C library needs none (system.h)."""
    if not shares_memory():
        return -1
    memory = os.memfd_create("uav-cosim")
    os.ftruncate(memory, FIRST_BYTES)
    return memory


def _close(descriptor: int) -> None:
    if descriptor >= 0:
        os.close(descriptor)


def _of_system(pipe: int) -> int:
    """Returns the number by which the system knows a pipe: on Windows, descriptors are of the C library of Python."""
    if sys.platform == "win32":
        import msvcrt

        return msvcrt.get_osfhandle(pipe)
    return pipe
