"""The interface of FMU instances, independent of the FMI version and of the party that makes their steps."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Protocol, TypeGuard

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.calls import CallMemory, Calls
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import Library

__all__ = ["EventSlave", "Slave", "has_event_mode"]


class Slave(Protocol):
    """An instance of an FMU (a co-simulation slave in FMI's terms). It must not be used from two threads at once.

    The order of calls is (FMI 2.0.5, section 4.2.4; FMI 3.0.2, section 4.2):

    slave.configure(...)                    structural parameters, if any exist
    slave.setup_experiment(start, stop)     then `set` of parameters
    slave.enter_initialization_mode()       then `set` and `get`, any number of times
    slave.exit_initialization_mode()        then steps, by the address of `step_address`, `set` and `get` between them
    slave.terminate()                       if it is legal: after a completed step, once
    slave.free()                            if it is legal: not after a fatal error

    After an error, only `free` is legal; after a fatal error, no call is legal for any instance of that FMU.
    `terminate` and `free` make only legal calls.

    Attributes:
        fmi: major version.
        time: time of the next call, s; set it before calls that may fail, for their errors.
        lines: the last lines that the FMU has logged.
        changed: values that the user has set during the run, by name; set it with them, for errors.
        event_mode: whether it has Event Mode (see `EventSlave`).
        next_event: end of the time that the loop may step it, s: its next event, or that of an instance stepping
            together with it.
        pending: BEGIN or END of the loop's tables, if the loop has left a step to Event Mode; otherwise 0.
        final: whether no state from before a step will be restored after it (an argument of fmi3DoStep).
        initializes_anew: parameters must be set again in initialization mode, since the FMU loses them.
        state_functions: the functions that save and restore its state.
        end_word: its word for the end of the simulation.
        has_answers: whether its step has answers besides the status; `use_answers` sets their address.
    """

    fmi: int
    name: str
    handle: int
    time: float | None
    lines: deque[str]
    changed: dict[str, Any]
    event_mode: bool
    next_event: float
    pending: int
    final: bool
    state_functions: tuple[str, str]
    end_word: str
    has_answers: bool

    @property
    def fmu(self) -> FmuDescription: ...
    @property
    def library(self) -> Library: ...
    @property
    def initializes_anew(self) -> bool: ...

    def configure(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets structural parameters, in Configuration Mode."""

    def setup_experiment(self, start: float, stop: float) -> None: ...
    def enter_initialization_mode(self) -> None: ...
    def exit_initialization_mode(self) -> None: ...
    def terminate(self) -> None: ...
    def free(self) -> None: ...

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Returns the values of variables of any types; strings and bytes are copied at once."""

    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets variables of any types."""

    def calls(self, memory: CallMemory) -> Calls:
        """Returns the calls by which the loop sets and gets its values."""

    def step_address(self) -> int:
        """Returns the address of the function that makes a step."""

    def use_answers(self, address: int) -> None:
        """Sets the address at which the loop stores the answers of a step besides its status (`tables.ANSWERS`)."""

    def try_step(self, t: float, h: float) -> bool:
        """Makes a step from t, or up to the next event; returns whether it is complete. Times in s."""

    def ended(self) -> bool:
        """Returns, after a discarded step, whether the FMU requests the end of the simulation."""

    def last_successful_time(self) -> float | None:
        """Returns the time reached by a discarded step, s; None if the FMU does not report it."""

    def longest_step(self) -> float | None:
        """Returns the longest step that it would make from here, s; None if it does not report it."""

    def cancel_step(self) -> None:
        """Cancels a pending step; afterwards only `free` is legal."""

    def save_state(self, state: ctypes.c_void_p) -> None:
        """Saves the state into `state`, and reuses the memory of an earlier one."""

    def restore_state(self, state: ctypes.c_void_p) -> None: ...
    def free_state(self, state: ctypes.c_void_p) -> None: ...

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        """Returns a saved state as bytes, which another instance can `deserialise`, even in another process."""

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        """Returns the state that `serialise` wrote, for `restore_state` and then `free_state`."""

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        """Returns the error for a bad status, and records which calls are still legal."""

    def function_name(self, name: str) -> str:
        """Returns the name, in this version, of a function that the loop's tables name as in FMI 2."""

    def status_word(self, status: int) -> str:
        """Returns the name of a status in this version."""


class EventSlave(Slave, Protocol):
    """A slave with Event Mode and Clocks: FMI 3.

    Attributes:
        inputs_by_event: whether the loop leaves discrete inputs to Event Mode, to be set before `calls`.
    """

    inputs_by_event: bool

    @property
    def early_return(self) -> bool: ...
    @property
    def answers(self) -> tuple[bool, bool, bool, float]:
        """Returns the last step's answers: event handling needed, terminate simulation, early return; last time, s."""

    def do_step(self, t: float, h: float) -> None: ...
    def enter_event_mode(self) -> None: ...
    def enter_step_mode(self) -> None: ...
    def update_discrete_states(self) -> tuple[bool, bool, float]:
        """Returns whether to call it again, whether the FMU requests the end, and the time of its next event, s."""

    def set_clocks(self, clocks: Sequence[Variable]) -> None: ...
    def get_clocks(self, clocks: Sequence[Variable]) -> list[bool]: ...
    def get_interval(self, clock: Variable) -> tuple[Fraction, int]: ...
    def get_shift(self, clock: Variable) -> Fraction: ...
    def set_interval(self, clock: Variable, interval: Fraction) -> None: ...


def has_event_mode(slave: Slave) -> TypeGuard[EventSlave]:
    """Returns whether a slave has Event Mode."""
    return slave.event_mode
