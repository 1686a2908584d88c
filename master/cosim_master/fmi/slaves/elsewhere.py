"""Instances of a system that run in another part of the run: they keep their places, and nothing is called."""

from __future__ import annotations

import ctypes
import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.calls import CALL, CallMemory, Calls, PacketPlaces, Row
from cosim_master.fmi.description.read import FmuDescription, Variable

__all__ = ["Elsewhere"]

_EMPTY = {"String": "", "Binary": ""}


class _NoLibrary:
    """The library of an instance that is elsewhere: no file and no functions."""

    file = ""
    own = True
    thread_safe = isolated = corrupted = python = False

    def __init__(self, fmu: FmuDescription) -> None:
        self.fmu = fmu

    def address(self, _function: str) -> int:
        return 0

    def has(self, *_functions: str) -> bool:
        return True

    def restarts(self) -> Sequence[str]:
        return ()

    def kill(self) -> None: ...


class _NoCalls:
    """The calls of an instance that is elsewhere: none."""

    binary = False

    def values(self, verb: str, kind: str, variables: Sequence[Variable], values: int) -> list[Row]:  # noqa: ARG002
        return []

    def packets(self, verb: str, places: PacketPlaces) -> Row:  # noqa: ARG002
        return (0,) * len(CALL.names or ())

    def input_derivatives(self, variables: Sequence[Variable], derivatives: int) -> Row:  # noqa: ARG002
        return (0,) * len(CALL.names or ())


class Elsewhere:  # the arguments have the names of `Slave`
    """A `Slave` that stands for an instance in another part of the run."""

    handle, event_mode, next_event, pending, final = 0, False, math.inf, 0, True
    time: float | None = None
    initializes_anew = has_answers = False
    state_functions, end_word = ("", ""), ""

    def __init__(self, name: str, fmu: FmuDescription) -> None:
        self.name, self.fmu = name, fmu
        self.fmi = int(fmu.fmi_version[0])
        self.library: Any = _NoLibrary(fmu)
        self.lines: deque[str] = deque()
        self.changed: dict[str, Any] = {}

    def configure(self, variables: Sequence[Variable], values: Sequence[Any]) -> None: ...
    def setup_experiment(self, start: float, stop: float) -> None: ...
    def enter_initialization_mode(self) -> None: ...
    def exit_initialization_mode(self) -> None: ...
    def terminate(self) -> None: ...
    def free(self) -> None: ...
    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None: ...
    def use_answers(self, address: int) -> None: ...
    def cancel_step(self) -> None: ...
    def save_state(self, state: ctypes.c_void_p) -> None: ...
    def restore_state(self, state: ctypes.c_void_p) -> None: ...
    def free_state(self, state: ctypes.c_void_p) -> None: ...

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Returns empty values."""
        return [_EMPTY.get(one.type, 0) for one in variables]

    def step_address(self) -> int:
        return 0

    def calls(self, memory: CallMemory) -> Calls:  # noqa: ARG002
        """Returns no calls."""
        return _NoCalls()

    def try_step(self, t: float, h: float) -> bool:  # noqa: ARG002
        raise self.failure("fmi2DoStep", 3)

    def ended(self) -> bool:
        return False

    def last_successful_time(self) -> float | None:
        return None

    def longest_step(self) -> float | None:
        return None

    def serialise(self, state: ctypes.c_void_p) -> bytes:  # noqa: ARG002
        """Returns nothing: its part saves it."""
        return b""

    def deserialise(self, content: bytes) -> ctypes.c_void_p:  # noqa: ARG002
        """Returns no state: its part restores it."""
        return ctypes.c_void_p()

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        return FmuError(self.name, function, f"it is in another part of the run ({status}) {detail}".rstrip())

    def function_name(self, name: str) -> str:
        return name

    def status_word(self, status: int) -> str:
        return str(status)
