"""FMI 3.0 instances, with the same interface as those of FMI 2 in `fmi2`.

    instance = Instance(library, "drone1.vehicle")
    instance.set(...), setup_experiment, enter_initialization_mode, set, get, exit_initialization_mode
    ... steps ...
    instance.terminate(), instance.free()

If the FMU has Event Mode, it is used, and so is early return, provided that the FMU can then make the rest of the step;
see `execution.events`. Intermediate update is not used: fmi3InstantiateCoSimulation gets no callback, and no required
intermediate variables, which would be undefined behaviour without one (FMI 3.0.2, section 2.3.1). A Binary is
hexadecimal text here, as in the files of SSP. An array is set as a whole: elements that are not given keep their last
values.

After fmi3Error, only `free` is legal. After fmi3Fatal, no call is legal for any instance of that FMU.
"""

from __future__ import annotations

import collections
import contextlib
import ctypes
import logging
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.calls import CallMemory, Calls3
from cosim_master.fmi.description.read import FmuDescription, Variable
from cosim_master.fmi.slaves.fmi2 import Library, SharedHandle, diagnosed, pending_exception, raise_end, refused

__all__ = ["INTERVAL_CHANGED", "INTERVAL_NOT_YET_KNOWN", "STATUS3", "Instance3", "whole_nanoseconds"]

log = logging.getLogger(__name__)

STATUS3 = ("fmi3OK", "fmi3Warning", "fmi3Discard", "fmi3Error", "fmi3Fatal")
_LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
INTERVAL_NOT_YET_KNOWN, _INTERVAL_UNCHANGED, INTERVAL_CHANGED = range(3)
"""fmi3IntervalQualifier (FMI 3.0.2, section 2.2.8.3)."""
_KEPT_LOG_LINES = 40
_ANSWERS = 32
_C_TYPES: dict[str, Any] = {
    "Float32": ctypes.c_float,
    "Float64": ctypes.c_double,
    "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8,
    "Int16": ctypes.c_int16,
    "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32,
    "Int64": ctypes.c_int64,
    "UInt64": ctypes.c_uint64,
    "Boolean": ctypes.c_bool,
    "String": ctypes.c_char_p,
}

_OF_FMI2 = {"fmi2DoStep": "fmi3DoStep", "fmi2GetReal": "fmi3GetFloat64", "fmi2GetString": "fmi3GetBinary"}
"""Functions of FMI 2 that the loop's tables name, and the functions of FMI 3 that are called instead."""


class Instance3:
    """An instance of FMI 3.0. It must not be used from two threads at once.

    Args:
        fmu: its description, if it differs from that of the library in the sizes of arrays.
        early_return: it may return early from fmi3DoStep, if it has Event Mode and variable steps.
    """

    fmi = 3
    _instantiates = "fmi3InstantiateCoSimulation"
    state_functions = ("fmi3GetFMUState", "fmi3SetFMUState")
    end_word = "terminateSimulation"
    has_answers = True
    initializes_anew = False

    def __init__(
        self, library: Library, name: str, fmu: FmuDescription | None = None, *, early_return: bool = True
    ) -> None:
        self.library = library
        self.fmu = fmu or library.fmu
        self.early_return = early_return and self.fmu.capabilities.canHandleVariableCommunicationStepSize
        clocked = any(v.clock is not None for v in self.fmu.variables.values())
        self.name = name
        self.alive = False
        self.stepping = False
        self.time: float | None = None
        self.changed: dict[str, Any] = {}
        self.lines: collections.deque[str] = collections.deque(maxlen=_KEPT_LOG_LINES)
        self._span = (0.0, 0.0)
        self.event_mode = self.fmu.capabilities.hasEventMode
        self.final = True  # no state from before a step is restored after it
        self._answers = (ctypes.c_ubyte * _ANSWERS)()
        self.next_event = math.inf
        self.inputs_by_event = False
        # Objects that the FMU refers to must live as long as the instance.
        self._logger = _LOGGER(self._log)
        self._arrays: dict[int, list[Variable]] = {}
        for variable in self.fmu.variables.values():
            known = self._arrays.setdefault(variable.value_reference, [])
            if variable.element is not None and variable.element == len(known):
                known.append(variable)
        self._given: dict[int, list[Any]] = {}
        handle = self._instantiate()
        if not handle and self.event_mode and not clocked:
            # Some FMUs declare an Event Mode that they do not have. Only FMUs with Clocks require it.
            log.warning("%s: it has refused Event Mode, though it declares it: it is used without", name)
            self.event_mode = False
            handle = self._instantiate()
        if not handle:
            raise refused(self, self._instantiates, "token")
        self.handle = int(handle)
        if (other := library.handles.setdefault(self.handle, name)) != name:
            text = (
                f"it returned the handle of {other}: the FMU keeps everything in globals, it is good for one instance"
            )
            raise SharedHandle(name, self._instantiates, text, log=self.lines)
        self.alive = True

    def _instantiate(self) -> int | None:
        instantiate = self.library.function("fmi3InstantiateCoSimulation", self.name)
        instantiate.restype = ctypes.c_void_p
        fmu = self.fmu
        no, yes = ctypes.c_bool(False), ctypes.c_bool(True)
        handle: int | None = instantiate(
            ctypes.c_char_p(self.name.encode()),
            ctypes.c_char_p(fmu.guid.encode()),
            ctypes.c_char_p(self.library.resources_path),
            no,  # visible
            yes if self.library.python else no,  # logging
            yes if self.event_mode else no,
            yes if self.event_mode and self.early_return else no,
            None,
            ctypes.c_size_t(0),
            None,
            self._logger,
            None,
        )
        return handle

    def _log(self, _environment: Any, status: int, _category: bytes, message: bytes) -> None:
        raised = pending_exception()
        text = (message or b"").decode("utf-8", "replace").rstrip()
        self.lines.extend(text.splitlines())
        if raised is not None and str(raised) not in text:
            self.lines.append(f"{type(raised).__name__}: {raised}")
        word = STATUS3[status] if 0 <= status < len(STATUS3) else str(status)
        log.debug("%s: %s: %s", self.name, word, text)

    def call(self, function: str, *arguments: Any) -> None:
        """Calls an FMI function that returns a status.

        Raises:
            FmuError: the status is worse than fmi3Warning.
        """
        status = int(self.library.function(function, self.name)(ctypes.c_void_p(self.handle), *arguments))
        if status > 1:
            raise self.failure(function, status)

    def failure(self, function: str, status: int, detail: str = "") -> FmuError:
        """Returns the error for a bad status; afterwards only `free` is legal (after fmi3Fatal, no call is)."""
        function, status, detail = diagnosed(self, function, status, detail)
        if status in (3, 4):
            self.stepping = False
        if status == 4:
            self.alive = False
            self.library.corrupted = True
        word = STATUS3[status] if 0 <= status < len(STATUS3) else f"unknown status {status}"
        return FmuError(self.name, function, detail or word, self.time, self.lines)

    # ---- values ------------------------------------------------------------------------------------------------------

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Returns the values of variables of any types; strings and bytes are copied at once."""
        read: dict[int, list[Any]] = {}
        for fmi_type in dict.fromkeys(v.fmi_type for v in variables):
            references = list(dict.fromkeys(v.value_reference for v in variables if v.fmi_type == fmi_type))
            counts = [max(1, len(self._arrays[reference])) for reference in references]
            values = self._get(fmi_type, references, sum(counts))
            for reference, count in zip(references, counts, strict=True):
                read[reference], values = values[:count], values[count:]
        return [read[v.value_reference][v.element or 0] for v in variables]

    def _get(self, fmi_type: str, references: Sequence[int], n: int) -> list[Any]:
        listed = ((ctypes.c_uint32 * len(references))(*references), ctypes.c_size_t(len(references)))
        if fmi_type == "Binary":
            sizes, places = (ctypes.c_size_t * n)(), (ctypes.c_void_p * n)()
            self.call("fmi3GetBinary", *listed, sizes, places, ctypes.c_size_t(n))
            return [ctypes.string_at(places[i] or 0, sizes[i]).hex() if sizes[i] else "" for i in range(n)]
        values = (_C_TYPES[fmi_type] * n)()
        self.call(f"fmi3Get{fmi_type}", *listed, values, ctypes.c_size_t(n))
        if fmi_type == "String":
            return [(value or b"").decode("utf-8", "replace") for value in values]
        return list(values)

    def set(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets variables of any types.

        Raises:
            FmuError: the FMU refused, or a value does not fit into the variable's type.
        """
        for fmi_type in dict.fromkeys(v.fmi_type for v in variables):
            given: dict[int, list[Any]] = {}
            for v, value in zip(variables, values, strict=True):
                if v.fmi_type != fmi_type:
                    continue
                self._check(v, value)
                if v.element is None:
                    given[v.value_reference] = [value]
                else:
                    given[v.value_reference] = self._whole(v.value_reference)
                    given[v.value_reference][v.element] = value
            self._set(fmi_type, list(given), [x for whole in given.values() for x in whole])

    def _whole(self, reference: int) -> list[Any]:
        """Returns the last value set for an array, initially its start value."""
        if reference not in self._given:
            missing = {"String": "", "Binary": ""}
            self._given[reference] = [
                missing.get(v.fmi_type, 0) if v.start is None else v.start for v in self._arrays[reference]
            ]
        return self._given[reference]

    def _check(self, variable: Variable, value: Any) -> None:
        if variable.type in ("Integer", "Enumeration"):
            kind = _C_TYPES[variable.fmi_type]
            if kind(int(value)).value != int(value):
                text = f"{variable.name} = {value} does not fit into {variable.fmi_type}"
                raise FmuError(self.name, f"fmi3Set{variable.fmi_type}", text, self.time, self.lines)

    def _set(self, fmi_type: str, references: Sequence[int], values: Sequence[Any]) -> None:
        n = ctypes.c_size_t(len(values))
        listed = ((ctypes.c_uint32 * len(references))(*references), ctypes.c_size_t(len(references)))
        if fmi_type == "Binary":
            data = [bytes.fromhex(value) for value in values]
            sizes = (ctypes.c_size_t * len(data))(*map(len, data))
            self.call("fmi3SetBinary", *listed, sizes, (ctypes.c_char_p * len(data))(*data), n)
            return
        convert: Any = {"String": lambda x: str(x).encode(), "Float32": float, "Float64": float, "Boolean": bool}
        array = (_C_TYPES[fmi_type] * len(values))(*map(convert.get(fmi_type, int), values))
        self.call(f"fmi3Set{fmi_type}", *listed, array, n)

    # ---- clocks ------------------------------------------------------------------------------------------------------

    def set_clocks(self, clocks: Sequence[Variable]) -> None:
        """Activates Clocks, in Event Mode."""
        n = len(clocks)
        self.call("fmi3SetClock", _references(clocks), ctypes.c_size_t(n), (ctypes.c_bool * n)(*[True] * n))

    def get_clocks(self, clocks: Sequence[Variable]) -> list[bool]:
        """Returns whether output Clocks are active, in Event Mode."""
        values = (ctypes.c_bool * len(clocks))()
        self.call("fmi3GetClock", _references(clocks), ctypes.c_size_t(len(clocks)), values)
        return list(values)

    def get_interval(self, clock: Variable) -> tuple[Fraction, int]:
        """Returns the interval of a Clock in ns, and its qualifier (INTERVAL_...); exact if the FMU has fractions."""
        one, qualifier = _references([clock]), ctypes.c_int(INTERVAL_CHANGED)
        if clock.clock is not None and clock.clock.supports_fraction:
            counter, resolution = ctypes.c_uint64(0), ctypes.c_uint64(1)
            places = [ctypes.byref(place) for place in (counter, resolution, qualifier)]
            self.call("fmi3GetIntervalFraction", one, ctypes.c_size_t(1), *places)
            if qualifier.value == INTERVAL_NOT_YET_KNOWN:
                return Fraction(0), qualifier.value
            return self._ratio(clock, counter.value, resolution.value), qualifier.value
        interval = ctypes.c_double(0.0)
        self.call("fmi3GetIntervalDecimal", one, ctypes.c_size_t(1), ctypes.byref(interval), ctypes.byref(qualifier))
        known = qualifier.value != INTERVAL_NOT_YET_KNOWN
        return self._nanoseconds(clock, interval.value) if known else Fraction(0), qualifier.value

    def get_shift(self, clock: Variable) -> Fraction:
        """Returns the time from the start of the run to a periodic Clock's first tick, ns."""
        one = _references([clock])
        if clock.clock is not None and clock.clock.supports_fraction:
            counter, resolution = ctypes.c_uint64(0), ctypes.c_uint64(1)
            places = [ctypes.byref(place) for place in (counter, resolution)]
            self.call("fmi3GetShiftFraction", one, ctypes.c_size_t(1), *places)
            return self._ratio(clock, counter.value, resolution.value)
        shift = ctypes.c_double(0.0)
        self.call("fmi3GetShiftDecimal", one, ctypes.c_size_t(1), ctypes.byref(shift))
        return self._nanoseconds(clock, shift.value)

    def set_interval(self, clock: Variable, interval: Fraction) -> None:
        """Sets the interval of a fixed or tunable Clock in the FMU, in s."""
        one = _references([clock])
        exact = clock.clock is not None and clock.clock.supports_fraction
        if exact and max(interval.numerator, interval.denominator) < 2**64:
            values: list[Any] = [ctypes.c_uint64(interval.numerator), ctypes.c_uint64(interval.denominator)]
            self.call("fmi3SetIntervalFraction", one, ctypes.c_size_t(1), *map(ctypes.byref, values))
            return
        seconds = ctypes.c_double(float(interval))
        self.call("fmi3SetIntervalDecimal", one, ctypes.c_size_t(1), ctypes.byref(seconds))

    def _ratio(self, clock: Variable, counter: int, resolution: int) -> Fraction:
        if resolution == 0:
            text = f"the resolution of its Clock {clock.name} is 0"
            raise FmuError(self.name, "fmi3GetIntervalFraction", text, self.time, self.lines)
        return Fraction(counter * 10**9, resolution)

    def _nanoseconds(self, clock: Variable, seconds: float) -> Fraction:
        if not math.isfinite(seconds):
            text = f"it says {seconds} s for its Clock {clock.name}"
            raise FmuError(self.name, "fmi3GetIntervalDecimal", text, self.time, self.lines)
        return whole_nanoseconds(seconds)

    # ---- steps and states --------------------------------------------------------------------------------------------

    def calls(self, memory: CallMemory) -> Calls3:
        """Returns the calls by which the loop sets and gets its values."""
        return Calls3(self.library.address, self.handle, memory, inputs_by_event=self.inputs_by_event)

    def step_address(self) -> int:
        """Returns the address of the function that makes a step."""
        return self.library.address("fmi3DoStep")

    def use_answers(self, address: int) -> None:
        """Sets the address at which the stepping loop stores the answers of fmi3DoStep (`tables.ANSWERS`)."""
        own, next_event = (ctypes.c_ubyte * _ANSWERS).from_address(address), self.next_event
        self._answers = own
        self.next_event, own[24], own[26] = next_event, int(self.event_mode), int(self.inputs_by_event)

    @property
    def next_event(self) -> float:
        """The end of the time that the loop may step, s: the next event of it or of one that steps together with it."""
        return ctypes.c_double.from_buffer(self._answers, 16).value

    @next_event.setter
    def next_event(self, time: float) -> None:
        ctypes.c_double.from_buffer(self._answers, 16).value = time

    @property
    def pending(self) -> int:
        """BEGIN or END of the loop's tables, if the loop has left a step to Event Mode; otherwise 0."""
        return int(self._answers[25])

    @pending.setter
    def pending(self, what: int) -> None:
        self._answers[25] = what

    @property
    def answers(self) -> tuple[bool, bool, bool, float]:
        """Returns the last step's answers: event handling needed, terminate simulation, early return; last time, s."""
        event, ends, early = (bool(flag) for flag in self._answers[:3])
        return event, ends, early, ctypes.c_double.from_buffer(self._answers, 8).value

    def do_step(self, t: float, h: float) -> None:
        """Calls fmi3DoStep; its answers are in `answers`."""
        at = ctypes.addressof(self._answers)
        places = [ctypes.c_void_p(at + offset) for offset in (0, 1, 2, 8)]
        self.call("fmi3DoStep", ctypes.c_double(t), ctypes.c_double(h), ctypes.c_bool(self.final), *places)

    def try_step(self, t: float, h: float) -> bool:
        """Makes a step from t, or up to the next event; returns whether it is complete. Times in s."""
        until = min(t + h, self.next_event)
        if until <= t:
            return False
        self.do_step(t, until - t)
        event, ends, early, _ = self.answers
        return not (event or ends or early or until < t + h)

    def function_name(self, name: str) -> str:
        """Returns the FMI 3 name of a function that the loop's tables name as in FMI 2."""
        return _OF_FMI2.get(name, name)

    def status_word(self, status: int) -> str:
        """Returns the name of a status in the standard."""
        return STATUS3[status]

    def enter_event_mode(self) -> None:
        self.call("fmi3EnterEventMode")

    def enter_step_mode(self) -> None:
        self.call("fmi3EnterStepMode")

    def update_discrete_states(self) -> tuple[bool, bool, float]:
        """Calls fmi3UpdateDiscreteStates.

        Returns:
            Whether it must be called again, whether the FMU requests the end of the simulation, and the time of its
            next event in s (infinity if it does not know one).
        """
        flags, time = [ctypes.c_bool(False) for _ in range(5)], ctypes.c_double(0.0)
        self.call("fmi3UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(time))
        again, ends, _, _, has_next = (flag.value for flag in flags)
        return again, ends, time.value if has_next else math.inf

    def ended(self) -> bool:
        """Returns False after a discarded step, which in FMI 3 never requests the end of the simulation."""
        return False

    def last_successful_time(self) -> float | None:
        """Returns None: FMI 3 does not report the time reached by a discarded step (FMI 3.0.2, section 4.2.1)."""
        return None

    def longest_step(self) -> float | None:
        """Returns None: FMI 3 has no function for it."""
        return None

    def save_state(self, state: ctypes.c_void_p) -> None:
        """Calls fmi3GetFMUState; reuses the memory of `state`, if it has some."""
        self.call("fmi3GetFMUState", ctypes.byref(state))

    def restore_state(self, state: ctypes.c_void_p) -> None:
        self.call("fmi3SetFMUState", state)

    def free_state(self, state: ctypes.c_void_p) -> None:
        """Calls fmi3FreeFMUState if it is legal."""
        if self.alive and state and not self.library.corrupted:
            self.call("fmi3FreeFMUState", ctypes.byref(state))

    def serialise(self, state: ctypes.c_void_p) -> bytes:
        """Returns a saved state as bytes, which another instance can `deserialise`, even in another process."""
        size = ctypes.c_size_t(0)
        self.call("fmi3SerializedFMUStateSize", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.call("fmi3SerializeFMUState", state, buffer, size)
        return buffer.raw

    def deserialise(self, content: bytes) -> ctypes.c_void_p:
        """Returns the state that `serialise` wrote, for `restore_state` and then `free_state`."""
        state = ctypes.c_void_p()
        self.call("fmi3DeserializeFMUState", content, ctypes.c_size_t(len(content)), ctypes.byref(state))
        return state

    def cancel_step(self) -> None:
        """Stops stepping the instance; FMI 3 has no pending steps that could be cancelled."""
        self.stepping = False

    def configure(self, variables: Sequence[Variable], values: Sequence[Any]) -> None:
        """Sets structural parameters, in Configuration Mode.

        Raises:
            FmuError: the FMU refused.
        """
        self.call("fmi3EnterConfigurationMode")
        self.set(variables, values)
        self.call("fmi3ExitConfigurationMode")

    def setup_experiment(self, start: float, stop: float) -> None:
        """Stores the times for `enter_initialization_mode`, which passes them on in FMI 3."""
        self.time = start
        self._span = (start, stop)

    def enter_initialization_mode(self) -> None:
        start, stop = self._span
        no, yes = ctypes.c_bool(False), ctypes.c_bool(True)
        arguments = (no, ctypes.c_double(0.0), ctypes.c_double(start), yes, ctypes.c_double(stop))
        self.call("fmi3EnterInitializationMode", *arguments)

    def exit_initialization_mode(self) -> None:
        self.call("fmi3ExitInitializationMode")
        self.stepping = True

    def terminate(self) -> None:
        """Calls fmi3Terminate if it is legal: after a completed step, once."""
        if self.alive and self.stepping and not self.library.corrupted:
            self.stepping = False
            self.call("fmi3Terminate")

    def free(self) -> None:
        """Calls fmi3FreeInstance if it is legal, that is, unless fmi3Fatal was returned."""
        if self.alive and not self.library.corrupted:
            self.alive = False
            free = self.library.function("fmi3FreeInstance", self.name)
            free.restype = None
            with contextlib.suppress(KeyError):
                del self.library.handles[self.handle]
            free(ctypes.c_void_p(self.handle))
            raise_end(self, "fmi3FreeInstance")


def whole_nanoseconds(seconds: float) -> Fraction:
    """Returns a time in ns; a double that represents whole nanoseconds, such as 0.1 s, is converted exactly."""
    nearest = round(seconds * 1e9)
    return Fraction(nearest) if abs(seconds * 1e9 - nearest) <= 1e-3 else Fraction(seconds) * 10**9


def _references(variables: Sequence[Variable]) -> Any:
    return (ctypes.c_uint32 * len(variables))(*(v.value_reference for v in variables))
