"""The process of an FMU file: started, questioned about its end, and ended.

The calls of FMI go through the functions of `Child.functions`, which is a C library (proxy.c) that has them all.
"""

from __future__ import annotations

import ctypes
import json
import logging
import math
import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from cosim_master.files import temporary
from cosim_master.fmi.isolation.building import HOST, LIBRARY, binaries, connecting, shares_memory

__all__ = ["FIRST_BYTES", "TOKEN", "Child", "End", "Limits", "Process", "Restart", "loaded"]

log = logging.getLogger(__name__)

TOKEN = "UAV_COSIM_TOKEN"
"""The environment variable with the secret that masters and servers of FMUs share."""

FIRST_BYTES = 1 << 18
"""Initial size of the shared memory, which grows when a message needs more."""
_OUTPUT_BYTES = 8192
_SHARING = ("isolated_open", "isolated_reopen", "isolated_relay")
"""Functions that need memory in common."""
_ALIVE, _SIGNALLED, _EXITED, _TIMED_OUT, _BROKEN, _DIFFERENT, _LOST = range(7)
_START_ANEW = ctypes.CFUNCTYPE(ctypes.c_bool)
_PATIENCE = 6
_FULL = 0.8
"""Part of the memory limit above which a crash is likely to be due to the limit."""
_END_SECONDS = 1.0
_THROWN = re.compile(r"terminate called (after throwing|without an active)|terminating due to uncaught")
"""The words of the runtimes of C++ before they abort a process."""
_RESTRICTED_FILES, _RESTRICTED_SOCKETS = 1, 2
_INTERPRETER = """
import ctypes, json, os, sys
sys.path[:] = json.loads(os.environ.pop("UAV_COSIM_PATH"))
library, arguments = ctypes.CDLL(sys.argv[1]), [os.fsencode(x) for x in sys.argv[1:]]
sys.argv[1:] = []
sys.exit(library.isolated_host(len(arguments), (ctypes.c_char_p * len(arguments))(*arguments)))
"""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a process.

    Attributes:
        seconds: wall-clock time in which a call of Step Mode must return; other calls (instantiation, initialization,
            the end) have six times as long. 0 is no limit.
        memory: bytes; None is half of the machine's memory.
        restricted: it may write into its own folder only, and open no sockets.
        restarts: how often it is started anew after a crash or an exit.
        requests: the number of requests to it after which the states of its instances are kept for that.
    """

    seconds: float = 10.0
    memory: int | None = None
    restricted: bool = True
    restarts: int = 0
    requests: int = 256

    @property
    def of_calls(self) -> tuple[float, float]:
        """Returns the time limits of calls in Step Mode and of all others, s."""
        return self.seconds, _PATIENCE * self.seconds

    @property
    def bytes(self) -> int:
        """Returns the memory limit in bytes."""
        if self.memory is not None:
            return self.memory
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2


@dataclass(frozen=True, slots=True)
class End:
    """The unexpected end of a process.

    Attributes:
        text: the cause.
        function: the FMI function that was called; empty if none was.
        instance: its instance; empty if none was called.
    """

    text: str
    function: str
    instance: str


@dataclass(frozen=True, slots=True)
class Restart:
    """A process that was started anew.

    Attributes:
        end: of the process before.
        library: the name of the FMU's binary.
        time: simulation time of the instance that was called, s; NaN before its first step.
        number: 1 for the first one of an FMU.
        most: how many are allowed.
    """

    end: End
    library: str
    time: float
    number: int
    most: int

    def __str__(self) -> str:
        """Returns instance, function, time, cause and number."""
        what = (
            f"{self.end.instance}: {self.end.function}" if self.end.function else f"{self.library}: between two calls"
        )
        when = "before its first step" if math.isnan(self.time) else f"at t = {self.time:.9g} s"
        return f"{what} {when}: {self.end.text}; it was started anew ({self.number} of {self.most})"


@cache
def _functions() -> Any:
    return loaded(binaries() / LIBRARY if shares_memory() else connecting(""), sharing=shares_memory())


def loaded(library: Path, *, sharing: bool) -> Any:
    """Returns the C library of the master's side; without `sharing`, for processes connected by sockets."""
    functions = ctypes.CDLL(str(library))
    pointer, text, number = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int
    for name, result, arguments in (
        ("isolated_open", pointer, (*[number] * 4, ctypes.c_double, ctypes.c_double)),
        ("isolated_close", None, (pointer,)),
        ("isolated_quit", None, (pointer,)),
        ("isolated_refusal", text, (pointer,)),
        ("isolated_restrictions", ctypes.c_uint32, (pointer,)),
        ("isolated_has", ctypes.c_bool, (pointer, text)),
        ("isolated_end", number, (pointer, *[pointer] * 4)),
        ("isolated_failed_set", text, (pointer, pointer)),
        ("isolated_output", ctypes.c_size_t, (pointer, pointer, ctypes.c_size_t)),
        ("isolated_restart_by", None, (pointer, number, ctypes.c_uint, _START_ANEW)),
        ("isolated_reopen", ctypes.c_bool, (pointer, *[number] * 4)),
        ("isolated_give_up", None, (pointer,)),
        ("isolated_unkept", ctypes.c_bool, (pointer,)),
        ("isolated_time", ctypes.c_double, (pointer,)),
        ("isolated_connect", pointer, (number, number, ctypes.c_double, ctypes.c_double)),
        ("isolated_reconnect", ctypes.c_bool, (pointer, number)),
        ("isolated_relay", number, (pointer, number)),
        ("isolated_direct", None, (pointer, number)),
    ):
        if sharing or name not in _SHARING:
            function = getattr(functions, name)
            function.restype, function.argtypes = result, arguments
    return functions


class Process:
    """The process of an FMU file, of which the C library knows by a channel.

    Args:
        limits: of the process.
        name: of the FMU's binary.

    Attributes:
        functions: the C library, which has all functions of FMI.
        channel: the address of the channel.
        refusal: the reason why the FMU could not be loaded; empty if it is loaded.
        restarts: the processes that were started anew after a crash.
    """

    def __init__(self, limits: Limits, name: str) -> None:
        self.functions = _functions()
        self.channel: int | None = None
        self.limits, self.restarts = limits, list[Restart]()
        self.refusal = ""
        self._name = name
        self._closed = self._unkept = False
        self._start_anew = _START_ANEW(self._restarted)  # which must live as long as the channel

    def _open(self, channel: int | None) -> None:
        """Takes a channel.

        Raises:
            MemoryError: there is none.
        """
        if not channel:
            self._stop()
            raise MemoryError("no memory for the messages of an FMU's process")
        self.channel = channel
        refusal = self.functions.isolated_refusal(channel)
        self.refusal = "" if refusal is None else refusal.decode("utf-8", "replace")
        if self.limits.restarts:
            self.functions.isolated_restart_by(channel, self.limits.restarts, self.limits.requests, self._start_anew)

    def _renew(self) -> bool:
        """Replaces the process by a new one; returns whether that has loaded the FMU.

        Raises:
            OSError: it cannot be started.
        """
        raise NotImplementedError

    def _stop(self) -> None:
        """Frees all resources, after the end of the process or before."""
        raise NotImplementedError

    def _restarted(self) -> bool:
        """Starts a new process after a crash, called by the C library; returns whether it has loaded the FMU."""
        end = self._end()
        assert end is not None
        time = float(self.functions.isolated_time(self.channel))
        restart = Restart(end, self._name, time, len(self.restarts) + 1, self.limits.restarts)
        try:
            well = self._renew()
        except OSError as error:
            log.warning("note: %s, but its process cannot be started: %s", end.text, error.strerror or error)
            return False
        if well:
            self.restarts.append(restart)
            log.warning("note: %s", restart)
        return well

    def has(self, function: str) -> bool:
        """Returns whether the FMU exports a function."""
        return bool(self.functions.isolated_has(self.channel, function.encode()))

    @property
    def unrestricted(self) -> str:
        """Returns the restrictions that this kernel does not know; empty if there are none."""
        if not self.limits.restricted:
            return ""
        held = self.functions.isolated_restrictions(self.channel)
        missing = {_RESTRICTED_FILES: "write outside of their folders", _RESTRICTED_SOCKETS: "open sockets"}
        return " and ".join(text for bit, text in missing.items() if not held & bit)

    def end(self) -> End | None:
        """Returns how the process has ended, for good; None if it has not."""
        end = self._end()
        if end is None or not (n := len(self.restarts)):
            return end
        return replace(end, text=f"{end.text}, after {n} restart{'s' if n > 1 else ''} of the process")

    def _end(self) -> End | None:
        number, function, owner, memory = ctypes.c_int(), ctypes.c_char_p(), ctypes.c_char_p(), ctypes.c_uint64()
        places = [ctypes.byref(place) for place in (number, function, owner, memory)]
        cause = self.functions.isolated_end(self.channel, *places)
        if cause == _ALIVE:
            return None
        words = [(name.value or b"").decode("utf-8", "replace") for name in (function, owner)]
        return End(self._cause(cause, number.value, memory.value, words[0]), *words)

    def _cause(self, cause: int, number: int, memory: int, function: str) -> str:
        if cause == _SIGNALLED:
            try:
                name = f" ({signal.Signals(number).name})"
            except ValueError:
                name = ""
            full = memory > 0 and memory > _FULL * self.limits.bytes
            if number == signal.SIGABRT and _THROWN.search(self.output()):
                thrown = "it has thrown a C++ exception, which nobody catches"
                return f"{thrown}: its process was ended by signal {number}{name}"
            used = f", with {memory >> 20} of {self.limits.bytes >> 20} MiB of memory in use" if full else ""
            return f"its process was ended by signal {number}{name}{used}"
        if cause == _EXITED:
            return f"it has ended its process with exit code {number}"
        if cause == _TIMED_OUT:
            stepping = function.endswith(("DoStep",)) or "Set" in function or "Get" in function
            limit = self.limits.seconds if stepping else _PATIENCE * self.limits.seconds
            return f"it did not return within {limit:g} s, and its process was killed"
        if cause == _LOST:
            return self._loss(number)
        if cause == _DIFFERENT:
            return "after a restart it does not answer as before: the state that it has serialised is incomplete"
        return "its process has sent a malformed answer, and was killed"

    def _loss(self, number: int) -> str:
        """Returns why the connection to the process was lost, from its errno."""
        raise NotImplementedError

    @property
    def unkept(self) -> bool:
        """Returns whether the states of its instances could not be kept for a restart."""
        if not self._closed:
            self._unkept = bool(self.functions.isolated_unkept(self.channel))
        return self._unkept

    def failed_set(self, handle: int) -> tuple[str, int] | None:
        """Returns the function and the status of a deferred call of an instance that has failed; None if none has."""
        status = ctypes.c_int()
        name = self.functions.isolated_failed_set(handle, ctypes.byref(status))
        return None if name is None else (name.decode(), status.value)

    def output(self) -> str:
        """Returns the last text that the process has written to stdout and stderr."""
        place = ctypes.create_string_buffer(_OUTPUT_BYTES)
        n = self.functions.isolated_output(self.channel, place, _OUTPUT_BYTES)
        return place.raw[:n].decode("utf-8", "replace")

    def quit(self) -> None:
        """Tells the process to end; `close` waits for it."""
        if not self._closed:
            self.functions.isolated_quit(self.channel)

    def close(self) -> None:
        """Ends the process and everything that it has started."""
        if self._closed:
            return
        self._unkept, self._closed = self.unkept, True
        self._wait()
        self._stop()
        self.functions.isolated_close(self.channel)

    def _wait(self) -> None:
        """Waits a short time for the process to end."""

    def kill(self) -> None:
        """Ends the process while it is called, from another thread."""
        raise NotImplementedError


class Child(Process):
    """The process of an FMU file on this machine.

    Args:
        library: the binary of the FMU.
        folder: the unpacked FMU, into which the process may write; it is its working directory.
        python: the FMU needs a Python interpreter.
        writable: further folders into which it may write.

    Raises:
        CannotIsolate: FMUs cannot have processes here.
        OSError: the process cannot be started.
    """

    def __init__(
        self, library: Path, folder: Path, limits: Limits, *, python: bool = False, writable: Sequence[Path] = ()
    ) -> None:
        super().__init__(limits, Path(library).stem)
        self._temporary = temporary.made()
        self._program: list[str] = [str(binaries() / HOST)]
        self._environment: dict[str, str] = {**os.environ, "TMPDIR": str(self._temporary)}
        self._environment.pop(TOKEN, None)  # which is not for FMUs
        if python:
            self._program = [sys.executable, "-u", "-c", _INTERPRETER, str(binaries() / LIBRARY)]
            self._environment["UAV_COSIM_PATH"] = json.dumps([str(Path(place).absolute()) for place in sys.path])
        self._file = str(library)
        self._folders = [str(place) for place in (folder, self._temporary, *writable)]
        try:
            self._start()
        except BaseException:
            temporary.remove(self._temporary)
            raise
        self._open(
            self.functions.isolated_open(self._memory, self._handle, self._process.pid, self._output, *limits.of_calls)
        )

    def _start(self) -> None:
        """Starts the process.

        Raises:
            OSError: it cannot be started; nothing has changed.
        """
        memory = os.memfd_create("uav-cosim")
        reading, writing = os.pipe()
        try:
            os.ftruncate(memory, FIRST_BYTES)
            numbers = [str(n) for n in (os.getpid(), self.limits.bytes, int(self.limits.restricted))]
            self._process = subprocess.Popen(
                [*self._program, str(memory), self._file, *numbers, *self._folders],
                stdin=subprocess.DEVNULL,
                stdout=writing,
                stderr=writing,
                cwd=self._folders[0],
                env=self._environment,
                pass_fds=(memory,),
                start_new_session=True,
            )
        except BaseException:
            os.close(memory)
            os.close(reading)
            raise
        finally:
            os.close(writing)
        self._memory, self._output = memory, reading
        self._handle = os.pidfd_open(self._process.pid)

    def _renew(self) -> bool:
        old = self._process, (self._memory, self._output, self._handle)
        self._start()
        well = self.functions.isolated_reopen(self.channel, self._memory, self._handle, self._process.pid, self._output)
        _discard(*old)
        return bool(well)

    def kill(self) -> None:
        if not self._closed:
            self.functions.isolated_give_up(self.channel)
            signal.pidfd_send_signal(self._handle, signal.SIGKILL)

    def _wait(self) -> None:
        if self.end() is None:
            poll = select.poll()
            poll.register(self._handle, select.POLLIN)
            poll.poll(1000 * _END_SECONDS)

    def _stop(self) -> None:
        _discard(self._process, (self._memory, self._output, self._handle))
        temporary.remove(self._temporary)


def _discard(process: subprocess.Popen[bytes], descriptors: Sequence[int]) -> None:
    """Ends a process and everything that it has started, and closes the descriptors that belong to it."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for descriptor in descriptors:
        os.close(descriptor)
