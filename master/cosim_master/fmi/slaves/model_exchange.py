"""FMUs for Model Exchange: instances like those of `fmi2` and `fmi3`, whose steps are made by one of our solvers.

    doStep(t, h)    events at t (inputs may have changed), then the solver from event to event up to t + h

Between steps, an instance is in Event Mode, in which all variables may be set and read. The master's loop sets inputs
and gets outputs by the FMU's own functions, and calls `do_step` by its address, as for any FMU. Events are time events
(nextEventTime), state events (an event indicator changes its sign) and step events (completedIntegratorStep). Inputs
are constant during a step. The solver continues across steps unless inputs, tunable parameters, states or derivatives
have been changed in between. A saved state consists of the FMU's state and the time of the next event, which is
complete for a solver without memory (`Choice.can_go_back`).
"""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Sequence
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.variables import FmuDescription, ModelExchange, Variable
from cosim_master.fmi.slaves.fmi2 import Instance2, Library, set_kind
from cosim_master.fmi.slaves.fmi3 import Instance3
from cosim_master.fmi.slaves.solvers import Choice, Rejected, Solver, SolverError, make

__all__ = ["Exchanged2", "Exchanged3"]

_OK, _DISCARD, _ERROR = 0, 2, 3
_TUNABLE = ("parameter", "tunable")
_CHATTER = 1000
"""Number of events at one time after which the model is considered stuck."""
_STEP2 = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
_STEP3 = ctypes.CFUNCTYPE(
    ctypes.c_int,
    ctypes.c_void_p,
    ctypes.c_double,
    ctypes.c_double,
    ctypes.c_bool,
    *[ctypes.c_void_p] * 4,
)


class _EventInfo(ctypes.Structure):
    """fmi2EventInfo."""

    _fields_ = (
        ("newDiscreteStatesNeeded", ctypes.c_int),
        ("terminateSimulation", ctypes.c_int),
        ("nominalsOfContinuousStatesChanged", ctypes.c_int),
        ("valuesOfContinuousStatesChanged", ctypes.c_int),
        ("nextEventTimeDefined", ctypes.c_int),
        ("nextEventTime", ctypes.c_double),
    )


class _Terminated(Exception):
    """The FMU requests the end of the simulation, at the solver's time."""


class _Equations:
    """The equations of an instance, as its solver sees them."""

    def __init__(self, one: _Exchanged, exchange: ModelExchange) -> None:
        self._one, self._exchange = one, exchange
        self.states, self.indicators = one.counts()
        self.has_jacobian = exchange.directional_derivatives and len(exchange.states) == self.states > 0
        self._knowns = [(ctypes.c_uint32 * 1)(state) for state in exchange.states]
        self._unknowns = (ctypes.c_uint32 * len(exchange.derivatives))(*exchange.derivatives)
        self._seed = (ctypes.c_double * 1)(1.0)

    def _at(self, t: float, x: int) -> None:
        self._one.ask("SetTime", ctypes.c_double(t))
        if self.states:
            self._one.ask("SetContinuousStates", ctypes.c_void_p(x), ctypes.c_size_t(self.states))

    def leave(self, t: float, x: int) -> None:
        """Sets the time and the states that the solver has reached in the FMU."""
        self._at(t, x)

    def derivatives(self, t: float, x: int, dx: int) -> None:
        self._at(t, x)
        if not self.states:
            return
        try:
            self._one.ask(self._one.derivatives_function, ctypes.c_void_p(dx), ctypes.c_size_t(self.states))
        except FmuError as error:
            if error.status.endswith("Discard"):
                raise Rejected(error.status) from None
            raise

    def event_indicators(self, t: float, x: int, z: int) -> None:
        self._at(t, x)
        self._one.ask("GetEventIndicators", ctypes.c_void_p(z), ctypes.c_size_t(self.indicators))

    def nominals(self, x: int) -> None:
        self._one.ask("GetNominalsOfContinuousStates", ctypes.c_void_p(x), ctypes.c_size_t(self.states))

    def read_states(self, x: int) -> None:
        if self.states:
            self._one.ask("GetContinuousStates", ctypes.c_void_p(x), ctypes.c_size_t(self.states))

    def jacobian_column(self, t: float, x: int, number: int, column: int) -> None:
        self._at(t, x)
        n, one = ctypes.c_size_t(self.states), ctypes.c_size_t(1)
        known = self._knowns[number]
        values: list[Any] = [self._seed, ctypes.c_void_p(column)]
        if self._one.fmi == 3:
            values = [self._seed, one, ctypes.c_void_p(column), n]
        self._one.ask("GetDirectionalDerivative", self._unknowns, n, known, one, *values)


class _Exchanged:
    """Steps of a Model Exchange instance, common to both versions of FMI.

    Args:
        choice: the solver.
        fmu: its description.
    """

    fmi: int
    name: str
    fmu: FmuDescription
    lines: Any
    time: float | None
    derivatives_function: str

    def _begin(self, choice: Choice) -> None:
        self._choice = choice
        self._next_event = math.inf
        self._solver: Solver | None = None
        self._cause: FmuError | None = None
        self._ends_at: float | None = None
        self._next_events: dict[int, float] = {}
        self._before: Any = None
        self._told = -math.inf

    # Functions that differ between the versions.

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        raise NotImplementedError

    def call(self, function: str, *arguments: Any) -> None:
        raise NotImplementedError

    def counts(self) -> tuple[int, int]:
        """Returns the numbers of states and of event indicators."""
        raise NotImplementedError

    def _updated(self) -> tuple[bool, bool, float]:
        """Updates discrete states; returns whether to repeat, whether the simulation ends, and the next event time."""
        raise NotImplementedError

    def _completed(self) -> tuple[bool, bool]:
        """Completes an internal step; returns whether an event is needed, and whether the simulation ends."""
        raise NotImplementedError

    # Functions common to the versions.

    def ask(self, function: str, *arguments: Any) -> None:
        """Calls an FMI function, by its name without the prefix."""
        self.call(f"fmi{self.fmi}{function}", *arguments)

    def _initialized(self) -> None:
        """Enters Event Mode after initialization mode, with the initial discrete states."""
        assert self.fmu.model_exchange is not None
        try:
            self._iterate()
        except _Terminated:
            text = "it requested the end of the run before its first step (terminateSimulation)"
            raise FmuError(self.name, self._update_function, text, self.time, self.lines) from None
        self._equations = _Equations(self, self.fmu.model_exchange)
        self._told = -math.inf if self.time is None else self.time
        variables = self.fmu.variables.values()
        given = [v for v in variables if v.causality == "input" or (v.causality, v.variability) == _TUNABLE]
        self._watched = [[v for v in given if set_kind(v) == kind] for kind in dict.fromkeys(map(set_kind, given))]
        self._slopes = (ctypes.c_double * max(1, self._equations.states))()
        step, tolerance = self.fmu.step_size, self.fmu.tolerance
        try:
            self._solver = make(self._choice, self._equations, step=step, tolerance=tolerance)
        except SolverError as error:
            raise FmuError(self.name, f"solver {self._choice.name}", str(error), self.time) from None

    @property
    def _update_function(self) -> str:
        return "fmi3UpdateDiscreteStates" if self.fmi == 3 else "fmi2NewDiscreteStates"

    def _iterate(self) -> None:
        """Updates discrete states until they no longer change, in Event Mode."""
        for _ in range(_CHATTER):
            again, ends, self._next_event = self._updated()
            if ends:
                raise _Terminated
            if not again:
                return
        text = f"the event does not settle in {_CHATTER} iterations"
        raise FmuError(self.name, self._update_function, text, self.time, self.lines)

    def _step(self, t: float, h: float) -> int:
        """Makes a step by the solver; returns an FMI status and stores an error."""
        self._cause = self._ends_at = None
        try:
            self._integrate(t, h)
        except _Terminated:
            assert self._solver is not None
            self._ends_at = self._solver.time
            return _DISCARD if self.fmi == 2 else _OK
        except FmuError as error:
            self._cause = error
        except (SolverError, Rejected) as error:
            solver = f"solver {self._choice.name}"
            text = str(error) if isinstance(error, SolverError) else f"the derivatives cannot be evaluated: {error}"
            self._cause = FmuError(self.name, solver, text, self.time, self.lines)
        except Exception as error:  # no exception may leave a function that C calls
            self._cause = FmuError(self.name, f"solver {self._choice.name}", repr(error), self.time, self.lines)
        return _OK if self._cause is None else _ERROR

    def _integrate(self, t: float, h: float) -> None:
        solver, exchange = self._solver, self.fmu.model_exchange
        assert solver is not None and exchange is not None
        self.time, stop, slack = t, t + h, 1e-12 * max(1.0, abs(t + h))
        solver.time = t
        self._tell(max(t, self._next_event) if self._next_event <= t + slack else t, slack)
        timed = self._next_event <= t + slack
        self._iterate()
        now = self._situation(solver.x)
        if now is not None and now == self._before and not timed:
            self.ask("EnterContinuousTimeMode")
            solver.resume(h)
        else:
            self._continue(solver, t, h)
        events, self._before = 0, None
        while solver.time < stop - slack:
            begin = solver.time
            target = min(stop, max(self._next_event, begin))
            found = False
            if target > begin:
                found = solver.advance(target)
                self._equations.leave(solver.time, solver.x.ctypes.data)
                self._told = solver.time
            needed = ends = False
            if exchange.completed_step:
                needed, ends = self._completed()
            if ends:
                raise _Terminated
            timed = self._next_event <= solver.time + slack
            events = events + 1 if solver.time <= begin + slack else 0
            if events > _CHATTER:
                text = f"{_CHATTER} events at t = {solver.time:.9g} s, and it does not go on"
                raise FmuError(self.name, f"solver {self._choice.name}", text, self.time, self.lines)
            if found or needed or timed:
                if timed and self._next_event > solver.time:
                    self.ask("SetTime", ctypes.c_double(self._next_event))
                    self._told = self._next_event
                self.ask("EnterEventMode")
                self._iterate()
                self._continue(solver, solver.time, h)
        if not self._choice.can_go_back:
            self._before = self._situation(solver.x)
        self.ask("EnterEventMode")

    def _tell(self, time: float, slack: float) -> None:
        """Sets the time of the FMU while it is in Event Mode.

        FMUs of Dymola accept the time in Continuous-Time Mode only. For FMI 2, differences above rounding are therefore
        set in that mode. The solver sets the remaining times.
        """
        if self.fmi != 2:
            self.ask("SetTime", ctypes.c_double(time))
        elif abs(time - self._told) > slack or self._told < time == self._next_event:
            self.ask("EnterContinuousTimeMode")
            self.ask("SetTime", ctypes.c_double(time))
            self.ask("EnterEventMode")
            self._told = time

    def _situation(self, x: Any) -> Any:
        """Returns the inputs of the solver's next step, without its memory; None for solvers without memory."""
        if self._choice.can_go_back or not self._equations.states:
            return None
        self._equations.read_states(ctypes.addressof(self._slopes))
        states = bytes(self._slopes)
        n = ctypes.c_size_t(self._equations.states)
        self.ask(self.derivatives_function, self._slopes, n)
        inputs = [self.get(variables) for variables in self._watched]
        return states, x.tobytes(), bytes(self._slopes), inputs

    def _continue(self, solver: Solver, time: float, h: float) -> None:
        """Changes from Event Mode to Continuous-Time Mode, where the solver restarts."""
        self.ask("EnterContinuousTimeMode")
        solver.reset(time, h)

    def _explained(self, error: FmuError) -> FmuError:
        """Returns the error of a step and its cause."""
        if self._cause is None or not error.function.endswith("DoStep"):
            return error
        cause, self._cause = self._cause, None
        function = cause.function if cause.function.startswith("solver") else f"{cause.function}"
        return FmuError(self.name, function, cause.status, error.time, self.lines)

    def _close(self) -> None:
        if self._solver is not None:
            self._solver.close()
            self._solver = None


class Exchanged2(_Exchanged, Instance2):
    """An instance of FMI 2.0 for Model Exchange."""

    kind = 0
    derivatives_function = "GetDerivatives"

    def __init__(self, library: Library, name: str, fmu: FmuDescription, choice: Choice) -> None:
        self._begin(choice)
        self._do_step = _STEP2(lambda _handle, t, h, _final: self._step(t, h))
        super().__init__(library, name, *library.memory, fmu=fmu)

    def step_address(self) -> int:
        return ctypes.cast(self._do_step, ctypes.c_void_p).value or 0

    def call(self, function: str, *arguments: Any) -> None:
        if function == "fmi2DoStep":
            if (status := self._step(arguments[0].value, arguments[1].value)) > 1:
                raise self.failure(function, status)
            return
        Instance2.call(self, function, *arguments)

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        return self._explained(super().failure(function, status, detail))

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        return Instance2.get(self, variables)

    def counts(self) -> tuple[int, int]:
        exchange = self.fmu.model_exchange
        assert exchange is not None
        return len(exchange.derivatives), exchange.event_indicators

    def _updated(self) -> tuple[bool, bool, float]:
        info = _EventInfo()
        self.call("fmi2NewDiscreteStates", ctypes.byref(info))
        next_time = info.nextEventTime if info.nextEventTimeDefined else math.inf
        return bool(info.newDiscreteStatesNeeded), bool(info.terminateSimulation), next_time

    def _completed(self) -> tuple[bool, bool]:
        needed, ends = ctypes.c_int(0), ctypes.c_int(0)
        self.call("fmi2CompletedIntegratorStep", ctypes.c_int(self.final), ctypes.byref(needed), ctypes.byref(ends))
        return bool(needed.value), bool(ends.value)

    def exit_initialization_mode(self) -> None:
        super().exit_initialization_mode()
        self._initialized()

    def ended(self) -> bool:
        return self._ends_at is not None

    def last_successful_time(self) -> float | None:
        return self._ends_at

    def save_state(self, state: ctypes.c_void_p) -> None:
        super().save_state(state)
        self._next_events[state.value or 0] = self._next_event

    def restore_state(self, state: ctypes.c_void_p) -> None:
        super().restore_state(state)
        self._next_event = self._next_events[state.value or 0]

    def free_state(self, state: ctypes.c_void_p) -> None:
        self._next_events.pop(state.value or 0, None)
        super().free_state(state)

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        return super().serialise(state) + struct.pack("<d", self._next_events[state.value or 0])

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        state = super().deserialise(content[:-8])
        (self._next_events[state.value or 0],) = struct.unpack("<d", content[-8:])
        return state

    def free(self) -> None:
        super().free()
        self._close()


class Exchanged3(_Exchanged, Instance3):
    """An instance of FMI 3.0 for Model Exchange."""

    derivatives_function = "GetContinuousStateDerivatives"
    _instantiates = "fmi3InstantiateModelExchange"

    def __init__(self, library: Library, name: str, fmu: FmuDescription, choice: Choice) -> None:
        self._begin(choice)
        self._do_step = _STEP3(self._called)
        super().__init__(library, name, fmu, early_return=False)

    def _instantiate(self) -> int | None:
        instantiate = self.library.function("fmi3InstantiateModelExchange", self.name)
        instantiate.restype = ctypes.c_void_p
        handle: int | None = instantiate(
            ctypes.c_char_p(self.name.encode()),
            ctypes.c_char_p(self.fmu.guid.encode()),
            ctypes.c_char_p(self.library.resources_path),
            ctypes.c_bool(False),
            ctypes.c_bool(False),
            None,
            self._logger,
        )
        return handle

    def step_address(self) -> int:
        return ctypes.cast(self._do_step, ctypes.c_void_p).value or 0

    def _called(self, _h: Any, t: float, h: float, _final: bool, event: int, ends: int, early: int, last: int) -> int:
        """Implements fmi3DoStep for the loop: its answers are written to the arguments `event` to `last`."""
        status = self._step(t, h)
        for place, flag in ((event, False), (ends, self._ends_at is not None), (early, False)):
            ctypes.c_bool.from_address(place).value = flag
        ctypes.c_double.from_address(last).value = t + h if self._ends_at is None else self._ends_at
        return status

    def do_step(self, t: float, h: float) -> None:
        at = ctypes.addressof(self._answers)
        if (status := self._called(0, t, h, self.final, at, at + 1, at + 2, at + 8)) > 1:
            raise self.failure("fmi3DoStep", status)

    def call(self, function: str, *arguments: Any) -> None:
        Instance3.call(self, function, *arguments)

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        return self._explained(super().failure(function, status, detail))

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        return Instance3.get(self, variables)

    def counts(self) -> tuple[int, int]:
        states, indicators = ctypes.c_size_t(0), ctypes.c_size_t(0)
        self.call("fmi3GetNumberOfContinuousStates", ctypes.byref(states))
        self.call("fmi3GetNumberOfEventIndicators", ctypes.byref(indicators))
        return states.value, indicators.value

    def _updated(self) -> tuple[bool, bool, float]:
        return self.update_discrete_states()

    def _completed(self) -> tuple[bool, bool]:
        needed, ends = ctypes.c_bool(False), ctypes.c_bool(False)
        self.call("fmi3CompletedIntegratorStep", ctypes.c_bool(self.final), ctypes.byref(needed), ctypes.byref(ends))
        return needed.value, ends.value

    def exit_initialization_mode(self) -> None:
        super().exit_initialization_mode()
        self._initialized()

    def save_state(self, state: ctypes.c_void_p) -> None:
        super().save_state(state)
        self._next_events[state.value or 0] = self._next_event

    def restore_state(self, state: ctypes.c_void_p) -> None:
        super().restore_state(state)
        self._next_event = self._next_events[state.value or 0]

    def free_state(self, state: ctypes.c_void_p) -> None:
        self._next_events.pop(state.value or 0, None)
        super().free_state(state)

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        return super().serialise(state) + struct.pack("<d", self._next_events[state.value or 0])

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        state = super().deserialise(content[:-8])
        (self._next_events[state.value or 0],) = struct.unpack("<d", content[-8:])
        return state

    def free(self) -> None:
        super().free()
        self._close()
