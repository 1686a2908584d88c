"""The interface of FMU instances, whatever version of FMI they are of, and whoever makes their steps."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Protocol, TypeGuard

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import Library

__all__ = ["EventSlave", "Slave", "has_event_mode"]


class Slave(Protocol):
    """An instance of an FMU (a co-simulation slave, in FMI's word). Not to be used from two threads at once.

    In this order (FMI 2.0.5, section 4.2.4; FMI 3.0.2, section 4.2):

    slave.configure(...)                    structural parameters, where there are any
    slave.setup_experiment(start, stop)     then `set` of parameters
    slave.enter_initialization_mode()       then `set` and `get`, as often as it takes
    slave.exit_initialization_mode()        then steps, by the address of `step_address`, `set` and `get` between them
    slave.terminate()                       where it is legal: after a completed step, once
    slave.free()                            where it is legal: not after a fatal error

    After an error only `free` is legal; after a fatal one nothing is, for any instance of that FMU. `terminate` and
    `free` know that, and do nothing where they must not.

    Attributes:
        fmi: major version.
        time: of the next call, s: set it before calls that may fail, for their errors.
        lines: the last lines that the FMU has logged.
        event_mode: whether there is Event Mode (see `EventSlave`).
        next_event: until when the loop may step it, s: its next event, or that of one that steps together with it.
        pending: BEGIN or END of the loop's tables, if the loop has left a step to Event Mode; else 0.
        final: whether no state of before a step will be restored after it (an argument of fmi3DoStep).
        initializes_anew: parameters are to be set once more in initialization mode, since the FMU loses them.
        state_functions: those that save and restore its state.
        end_word: its word for the end of the simulation.
        has_answers: whether its step answers more than a status: `use_answers` says where.
    """

    fmi: int
    name: str
    handle: int
    time: float | None
    lines: deque[str]
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
        """Values of variables, of whatever types; strings and bytes are copied at once."""

    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets variables, of whatever types."""

    def step_address(self) -> int:
        """The address of the function that makes a step."""

    def use_answers(self, address: int) -> None:
        """Takes the address at which the loop keeps the answers of a step beyond its status (`tables.ANSWERS`)."""

    def try_step(self, t: float, h: float) -> bool:
        """Makes a step from t, or up to the next event; returns whether it is complete. Times in s."""

    def ended(self) -> bool:
        """After a discarded step: whether the FMU wants the simulation to end."""

    def last_successful_time(self) -> float | None:
        """Returns the time reached by a discarded step, s; None if the FMU does not tell."""

    def longest_step(self) -> float | None:
        """The longest step that it would make from here, s; None if it does not say."""

    def cancel_step(self) -> None:
        """Stops a step that is pending; only `free` may follow."""

    def save_state(self, state: ctypes.c_void_p) -> None:
        """Saves the state into `state`, and reuses its memory, if it has some."""

    def restore_state(self, state: ctypes.c_void_p) -> None: ...
    def free_state(self, state: ctypes.c_void_p) -> None: ...

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        """A saved state as bytes, which another instance of the FMU can `deserialise`, in another process too."""

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        """The state that `serialise` wrote, for `restore_state` and then `free_state`."""

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        """Returns the error for a bad status, and notes which calls are still legal."""

    def function_name(self, name: str) -> str:
        """The function that the loop's tables name in FMI 2's words, in those of this version."""

    def status_word(self, status: int) -> str:
        """A status in the words of this version."""


class EventSlave(Slave, Protocol):
    """A slave with Event Mode and Clocks: FMI 3."""

    @property
    def early_return(self) -> bool: ...
    @property
    def answers(self) -> tuple[bool, bool, bool, float]:
        """Answers of the last step: event handling needed, terminate simulation, early return; last time, s."""

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
