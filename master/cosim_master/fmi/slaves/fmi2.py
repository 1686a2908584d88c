"""FMI 2.0 instances: loading a library, calling its functions one by one, storing its log.

The caller is responsible for the legal order of calls (FMI 2.0.5, section 4.2.4); see `execution`. The stepping loop
calls the same functions by their addresses, not through this module.

    library = Library(description, folder)           one per FMU file, shared by its instances
    instance = library.instantiate("drone1.vehicle")
    instance.set(...), setup_experiment, enter_initialization_mode, set, get, exit_initialization_mode
    ... steps ...
    instance.terminate(), instance.free()

After fmi2Error or fmi2Pending, only `free` is legal. After fmi2Fatal, no call is legal for any instance of that FMU
(FMI 2.0.5, section 2.1.3). `alive`, `stepping` and `Library.corrupted` store this state, and `terminate` and `free`
make only the calls that are still legal.
"""

from __future__ import annotations

import collections
import contextlib
import ctypes
import logging
import math
import platform
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.calls import CallMemory, Calls2
from cosim_master.fmi.description.read import FmuDescription, Variable

__all__ = [
    "CALLBACK_TYPES",
    "STATUS",
    "Batch",
    "Diagnosis",
    "Instance2",
    "Library",
    "SharedHandle",
    "diagnosed",
    "pending_exception",
    "raise_end",
    "refused",
    "set_kind",
]

log = logging.getLogger(__name__)

STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")
_LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
_ALLOCATE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t)
_FREE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
CALLBACK_TYPES = (_LOGGER, _ALLOCATE, _FREE)
"""Types of logger, allocateMemory and freeMemory."""
_STEP_FINISHED = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int)

_LONGEST_STEP = "fmi2GetMaxStepSize"
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3
"""fmi2StatusKind (FMI 2.0.5, section 4.2.3)."""
_KEPT_LOG_LINES = 40
_C_TYPES: dict[str, Any] = {
    "Real": ctypes.c_double,
    "Integer": ctypes.c_int,
    "Boolean": ctypes.c_int,
    "String": ctypes.c_char_p,
}


_INITIALIZES_ANEW = ("20-sim",)
"""Prefixes of the generationTool of FMUs that are known to initialize their parameters again during start-up: values
are set again in initialization mode, as FMI 2.0.5 allows for variables with initial="exact" (section 4.2.4).
"""


class _Callbacks(ctypes.Structure):
    _fields_ = (
        ("logger", _LOGGER),
        ("allocateMemory", _ALLOCATE),
        ("freeMemory", _FREE),
        ("stepFinished", ctypes.c_void_p),
        ("componentEnvironment", ctypes.c_void_p),
    )


def set_kind(variable: Variable) -> str:
    """Returns the type in the name of the setter of a variable: fmi2SetReal, -Integer, -Boolean or -String."""
    return "Integer" if variable.type == "Enumeration" else variable.type


_raised: Any = ctypes.pythonapi.PyErr_Occurred
_raised.restype = ctypes.c_void_p


def pending_exception() -> BaseException | None:
    """Returns and clears the exception that a Python FMU has raised before a callback, as for pythonfmu's logging.

    With a pending exception, Python continues until its next call, which then fails. ctypes raises the exception after
    any call into Python's API.
    """
    try:
        _raised()
    except BaseException as raised:
        return raised
    return None


class SharedHandle(FmuError):
    """An FMU returned the handle of a living instance for another one: it stores its state in globals."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The cause of a failure that a status does not express.

    Attributes:
        function: the FMI function that has failed; empty if it is the one called last.
        text: the cause; empty if the status says it.
        status: of `function`.
        lines: the FMU's output.
    """

    function: str
    text: str
    status: int
    lines: Sequence[str] = ()


class Library:
    """The loaded binary of one FMU file."""

    def __init__(self, fmu: FmuDescription, library: Path, resources: Path) -> None:
        self.fmu = fmu
        self.resources = resources
        self.file = str(library)
        self.handles: dict[int, str] = {}
        self.corrupted = False
        # pythonfmu suppresses even errors unless logging is on. Others do not need logging, and some log too much.
        self.python = (resources / "slavemodule.txt").is_file()
        # Our compiled FMUs store all state in their instances, never discard a step, and change no parameter.
        self.own = fmu.generation_tool == "uav-cosim" and not fmu.capabilities.needsExecutionTool
        self.thread_safe = self.own
        self.isolated = False
        self.calling = ("", "")
        """Instance and FMI function that Python has called last."""
        self.on_call: Callable[[str, str], None] | None = None
        """Called with them before the call."""
        self.watch: Callable[[str, Any], Any] | None = None
        """Replaces functions that Python calls, by name; None: they are called as they are."""
        self.resources_path: bytes | None = f"{resources}/".encode() if resources.is_dir() else None
        """The resourcePath of FMI 3; None if the FMU has no resources."""
        self._dll = self._load(library)
        self._addresses: dict[str, int] = {}
        libc = ctypes.CDLL("msvcrt" if platform.system() == "Windows" else None)
        self.memory: tuple[Any, Any] = (
            _ALLOCATE(ctypes.cast(libc.calloc, ctypes.c_void_p).value or 0),
            _FREE(ctypes.cast(libc.free, ctypes.c_void_p).value or 0),
        )
        """The callbacks allocateMemory and freeMemory."""

    @cached_property
    def resources_uri(self) -> bytes:
        """The fmuResourceLocation of FMI 2."""
        return self.resources.as_uri().encode()

    def _load(self, library: Path) -> Any:
        try:
            return ctypes.CDLL(str(library))
        except OSError as error:
            raise FmuError(self.fmu.model_name, f"loading {self.fmu.path}", str(error)) from None

    def ahead(self, _step: int) -> tuple[int, int] | None:
        """Returns the functions that begin and post a step before its call (see proxy.c), by address.

        Args:
            _step: address of the function that makes a step.

        Returns:
            None if a step is one call.
        """
        return None

    def diagnosis(self, _handle: int, _name: str) -> Diagnosis | None:
        """Returns what a status does not say about the failure of an instance, by handle and name; None if nothing."""
        return None

    def restarts(self) -> Sequence[str]:
        """Returns what happened when the process of an isolated FMU was started anew, each time."""
        return ()

    def kill(self) -> None:
        """Ends the process of an isolated FMU, which then fails."""

    def quit(self) -> None:
        """Begins to close the library, after its instances have been freed."""

    def close(self) -> None:
        """Closes the library; a library of this process stays loaded."""

    def address(self, function: str) -> int:
        """Returns the address of an FMI function.

        Raises:
            FmuError: the binary does not export it.
        """
        if function not in self._addresses:
            self._addresses[function] = ctypes.cast(self._function(function), ctypes.c_void_p).value or 0
        return self._addresses[function]

    def address_if(self, function: str) -> int:
        """Returns the address of a function that the binary may lack; 0 without it."""
        return self.address(function) if self.has(function) else 0

    def function(self, name: str, instance: str) -> Any:
        """Returns the FMI function `name`, which returns a status, for a call of an instance that follows at once."""
        self.calling = instance, name
        if self.on_call is not None:
            self.on_call(instance, name)
        return self._function(name) if self.watch is None else self.watch(name, self._function(name))

    def _function(self, name: str) -> Any:
        try:
            function = getattr(self._dll, name)
        except AttributeError:
            raise FmuError(self.fmu.model_name, name, f"the binary of {self.fmu.path} does not have it") from None
        return function

    def has(self, *functions: str) -> bool:
        """Returns whether the binary exports all of these functions; declared optional ones may be missing."""
        return all(hasattr(self._dll, name) for name in functions)

    def instantiate(self, name: str) -> Instance2:
        """Returns a new instance, in the state "instantiated".

        Raises:
            SharedHandle: the FMU supports only one instance.
            FmuError: the FMU refused (a wrong GUID, a stale interpreted FMU); its log lines give the reason.
        """
        return Instance2(self, name, *self.memory)


class Instance2:
    """An instance of FMI 2.0. It must not be used from two threads at once."""

    fmi = 2
    _instantiates = "fmi2Instantiate"
    kind = 1
    """fmi2CoSimulation."""
    state_functions = ("fmi2GetFMUstate", "fmi2SetFMUstate")
    end_word = "fmi2Terminated"
    has_answers = False
    event_mode = False
    next_event = math.inf
    pending = 0
    final = True

    def __init__(
        self, library: Library, name: str, allocate: Any, free: Any, fmu: FmuDescription | None = None
    ) -> None:
        self.library = library
        self.name = name
        self.alive = False
        self.stepping = False
        self.canceled = False
        self.time: float | None = None
        self.changed: dict[str, Any] = {}
        self.lines: collections.deque[str] = collections.deque(maxlen=_KEPT_LOG_LINES)
        # ctypes objects that the FMU refers to must live as long as the instance.
        self._logger = _LOGGER(self._log)
        self.fmu = fmu or library.fmu
        handle = self._instantiate(allocate, free)
        if not handle:
            raise refused(self, self._instantiates, "GUID")
        self.handle = handle
        if (other := library.handles.setdefault(self.handle, name)) != name:
            text = (
                f"it returned the handle of {other}: the FMU keeps everything in globals, it is good for one instance"
            )
            raise SharedHandle(name, self._instantiates, text, log=self.lines)
        self.alive = True

    def _instantiate(self, allocate: Any, free: Any) -> int:
        """Returns the handle of a new instance; 0 if the FMU refuses."""
        self._callbacks = _Callbacks(self._logger, allocate, free, None, None)
        instantiate = self.library.function("fmi2Instantiate", self.name)
        instantiate.restype = ctypes.c_void_p
        handle = instantiate(
            ctypes.c_char_p(self.name.encode()),
            ctypes.c_int(self.kind),
            ctypes.c_char_p(self.fmu.guid.encode()),
            ctypes.c_char_p(self.library.resources_uri),
            ctypes.byref(self._callbacks),
            ctypes.c_int(0),
            ctypes.c_int(self.library.python),
        )
        return int(handle or 0)

    @property
    def initializes_anew(self) -> bool:
        """True if parameters must be set again in initialization mode, because the FMU loses them."""
        return self.fmu.generation_tool.startswith(_INITIALIZES_ANEW)

    def configure(self, _variables: Sequence[Variable], _values: Sequence[Any]) -> None:
        """Raises ValueError: FMI 2 has no structural parameters."""
        raise ValueError(f"{self.name} is of FMI {self.fmi}, which has no structural parameters")

    def calls(self, memory: CallMemory) -> Calls2:
        """Returns the calls by which the loop sets and gets its values."""
        return Calls2(self.library.address, self.handle, memory)

    def step_address(self) -> int:
        """Returns the address of the function that makes a step."""
        return self.library.address("fmi2DoStep")

    def use_answers(self, _address: int) -> None:
        """Does nothing: the only answer of an FMI 2 step is its status."""

    def try_step(self, t: float, h: float) -> bool:
        """Makes a step from t; returns True. Times in s."""
        self.call("fmi2DoStep", ctypes.c_double(t), ctypes.c_double(h), ctypes.c_int(0))
        return True

    def function_name(self, name: str) -> str:
        """Returns the name unchanged: the loop's tables contain FMI 2 names."""
        return name

    def status_word(self, status: int) -> str:
        """Returns the name of a status in the standard."""
        return STATUS[status]

    def _log(self, _environment: Any, _name: bytes, status: int, _category: bytes, message: bytes) -> None:
        raised = pending_exception()
        text = (message or b"").decode("utf-8", "replace").replace("%%", "%").rstrip()
        self.lines.extend(text.splitlines())
        if raised is not None and str(raised) not in text:
            self.lines.append(f"{type(raised).__name__}: {raised}")
        word = STATUS[status] if 0 <= status < len(STATUS) else str(status)
        log.debug("%s: %s: %s", self.name, word, text)

    def call(self, function: str, *arguments: Any) -> None:
        """Calls an FMI function that returns a status.

        Raises:
            FmuError: the status is worse than fmi2Warning.
        """
        status = int(self.library.function(function, self.name)(ctypes.c_void_p(self.handle), *arguments))
        if status > 1:
            raise self.failure(function, status)

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        """Returns the error for a bad status; afterwards only `free` is legal (after fmi2Fatal, no call is)."""
        function, status, detail = diagnosed(self, function, status, detail)
        if status in (3, 4, 5):
            self.stepping = False
        if status == 4:
            self.alive = False
            self.library.corrupted = True
        word = STATUS[status] if 0 <= status < len(STATUS) else f"unknown status {status}"
        return FmuError(self.name, function, detail or word, self.time, self.lines)

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Returns the values of variables that share one FMI type; strings are copied at once."""
        if not variables:
            return []
        kind = set_kind(variables[0])
        n = len(variables)
        values = (_C_TYPES[kind] * n)()
        self.call(f"fmi2Get{kind}", _references(variables), ctypes.c_size_t(n), values)
        if kind == "Boolean":
            return [bool(value) for value in values]
        if kind == "String":
            return [(value or b"").decode("utf-8", "replace") for value in values]
        return list(values)

    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets variables that share one FMI type."""
        if not variables:
            return
        kind = set_kind(variables[0])
        n = len(variables)
        c_array = _C_TYPES[kind] * n
        if kind == "String":
            content = c_array(*(str(value).encode() for value in values))
        elif kind == "Real":  # by way of `array`, which takes values ten times as fast as ctypes
            content = c_array.from_buffer(array("d", map(float, values)))
        else:
            content = c_array.from_buffer(array("I", [int(value) & 0xFFFFFFFF for value in values]))
        self.call(f"fmi2Set{kind}", _references(variables), ctypes.c_size_t(n), content)

    def ended(self) -> bool:
        """Returns, after a discarded step, whether the FMU requests the end of the simulation."""
        answer = ctypes.c_int(0)
        return self._answers("fmi2GetBooleanStatus", _TERMINATED, answer) and answer.value != 0

    def last_successful_time(self) -> float | None:
        """Returns the time reached by a discarded step, s; None if the FMU does not report it."""
        answer = ctypes.c_double(0.0)
        return answer.value if self._answers("fmi2GetRealStatus", _LAST_SUCCESSFUL_TIME, answer) else None

    def longest_step(self) -> float | None:
        """Returns the answer of fmi2GetMaxStepSize, an extension of FMI 2 by INTO-CPS; None without this function."""
        if not self.library.has(_LONGEST_STEP):
            return None
        size = ctypes.c_double(math.nan)
        status = int(self.library.function(_LONGEST_STEP, self.name)(ctypes.c_void_p(self.handle), ctypes.byref(size)))
        return None if status > 1 or math.isnan(size.value) else size.value

    def _answers(self, function: str, kind: int, answer: Any) -> bool:
        """Gets a status; FMUs may lack the function or the answer."""
        try:
            self.call(function, ctypes.c_int(kind), ctypes.byref(answer))
        except FmuError:
            return False
        return True

    def save_state(self, state: ctypes.c_void_p) -> None:
        """Calls fmi2GetFMUstate; reuses the memory of `state`, if it has some."""
        self.call("fmi2GetFMUstate", ctypes.byref(state))

    def restore_state(self, state: ctypes.c_void_p) -> None:
        self.call("fmi2SetFMUstate", state)

    def free_state(self, state: ctypes.c_void_p) -> None:
        """Calls fmi2FreeFMUstate if it is legal, that is, unless a step was cancelled."""
        usable = self.alive and not self.canceled and not self.library.corrupted
        if usable and state and self.library.has("fmi2FreeFMUstate"):
            with contextlib.suppress(FmuError):
                self.call("fmi2FreeFMUstate", ctypes.byref(state))

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        """Returns a saved state as bytes, which another instance can `deserialise`, even in another process."""
        size = ctypes.c_size_t(0)
        self.call("fmi2SerializedFMUstateSize", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.call("fmi2SerializeFMUstate", state, buffer, size)
        return buffer.raw

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        """Returns the state that `serialise` wrote, for `restore_state` and then `free_state`."""
        state = ctypes.c_void_p()
        self.call("fmi2DeSerializeFMUstate", content, ctypes.c_size_t(len(content)), ctypes.byref(state))
        return state

    def cancel_step(self) -> None:
        """Cancels a pending step; afterwards only `free` is legal."""
        self.stepping, self.canceled = False, True
        with contextlib.suppress(FmuError):
            self.call("fmi2CancelStep")

    def setup_experiment(self, start: float, stop: float) -> None:
        self.time = start
        no, yes = ctypes.c_int(0), ctypes.c_int(1)
        self.call("fmi2SetupExperiment", no, ctypes.c_double(0), ctypes.c_double(start), yes, ctypes.c_double(stop))

    def enter_initialization_mode(self) -> None:
        self.call("fmi2EnterInitializationMode")

    def exit_initialization_mode(self) -> None:
        self.call("fmi2ExitInitializationMode")
        self.stepping = True

    def terminate(self) -> None:
        """Calls fmi2Terminate if it is legal: after a completed step, once."""
        if self.alive and self.stepping and not self.library.corrupted:
            self.stepping = False
            if self.library.has("fmi2Terminate"):
                self.call("fmi2Terminate")

    def free(self) -> None:
        """Calls fmi2FreeInstance if it is legal, that is, unless fmi2Fatal was returned."""
        if self.alive and not self.library.corrupted:
            self.alive = False
            free = self.library.function("fmi2FreeInstance", self.name)
            free.restype = None
            del self.library.handles[self.handle]
            free(ctypes.c_void_p(self.handle))
            raise_end(self, "fmi2FreeInstance")


def refused(one: Any, function: str, token: str) -> FmuError:
    """Returns the error of an instance that could not be created; `token` is the name of its GUID."""
    found = one.library.diagnosis(0, one.name)
    if found is not None:
        return FmuError(one.name, found.function or function, found.text, log=[*one.lines, *found.lines])
    hint = "" if one.lines else f"; it logged nothing (is the {token} of its modelDescription.xml the binary's?)"
    return FmuError(one.name, function, f"it returned NULL{hint}", log=one.lines)


def diagnosed(one: Any, function: str, status: int, detail: str) -> tuple[str, int, str]:
    """Returns function, status and detail of an instance's failure, replaced by the library's diagnosis, if any."""
    found = one.library.diagnosis(one.handle, one.name) if status > 1 or status < 0 else None
    if found is None:
        return function, status, detail
    one.lines.extend(found.lines)
    _, given, inputs = detail.partition("; its inputs: ")
    word = found.text or one.status_word(found.status)
    return found.function or function, found.status, f"{word}{given}{inputs}"


def raise_end(one: Any, function: str) -> None:
    """Raises FmuError if the process of an isolated instance has ended while it was freed."""
    if (found := one.library.diagnosis(0, one.name)) is not None:
        one.library.corrupted = True
        raise FmuError(one.name, found.function or function, found.text, one.time, [*one.lines, *found.lines])


class Batch(tuple[Variable, ...]):
    """Variables that share one FMI type and are set or got together, in many instances of their FMU."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(v.name for v in self)

    @cached_property
    def references(self) -> Any:
        """Their value references, as the argument of a call."""
        return _references([*self])


def _references(variables: Sequence[Variable]) -> Any:
    if isinstance(variables, Batch):
        return variables.references
    return (ctypes.c_uint * len(variables))(*(v.value_reference for v in variables))
