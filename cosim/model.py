"""A model: declared variables, one record that holds all memory of an instance, and two kernels that operate on it.

The numpy record, the FMI value references and the pythonfmu slave of this module are derived from the declaration;
`cosim.build` also derives modelDescription.xml and the compiled FMU from it. A model that cannot be written as kernels,
for example because it talks to another program, overrides `do_step` and is an ordinary pythonfmu slave with the same
ports.

This module does not depend on files, XML or C.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, wraps
from itertools import dropwhile
from keyword import iskeyword
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pythonfmu import Boolean, Fmi2Slave, Integer, Real, String
from pythonfmu.enums import Fmi2Causality, Fmi2Initial, Fmi2Status, Fmi2Variability

from cosim.verdict import Verdict, complaints

__all__ = [
    "FlatVariable",
    "Input",
    "Memory",
    "Model",
    "Output",
    "PacketInput",
    "PacketOutput",
    "Parameter",
    "State",
    "Variable",
    "flat_variables",
    "busy_part",
    "record_layout",
]

Role = Literal["input", "output", "parameter", "state", "memory", "packet input", "packet output"]
Kind = Literal["Real", "Integer", "Boolean", "Enumeration", "String", "Packets", "Memory"]
Start = float | int | bool | str | tuple[float, ...] | tuple[int, ...] | tuple[bool, ...]

_FIELD_TYPE = {"Real": "f8", "Integer": "i4", "Boolean": "?", "Enumeration": "i4"}
_MEMORY_TYPES = ("f8", "f4", "i8", "i4", "i2", "i1", "u8", "u4", "u2", "u1", "?")
_KEPT: tuple[Role, ...] = ("parameter", "input", "packet input")
"""Roles of the variables that keep their values when `start` runs again: the environment sets them."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A declared variable, scalar or one-dimensional array. Created by `Input`, `Output`, `Parameter`, ..."""

    name: str
    role: Role
    kind: Kind
    shape: tuple[int, ...] = ()
    unit: str | None = None
    start: Start = 0.0
    description: str = ""
    minimum: float | None = None
    maximum: float | None = None
    tunable: bool = False
    depends: tuple[str, ...] = ()
    enumeration: type[IntEnum] | None = None
    dtype: str = ""
    capacity: int = 0
    rare: bool = False
    verdict: Verdict | None = None

    def __post_init__(self) -> None:
        name = self.name
        if element := re.fullmatch(r"(\w+)\[(\d*)\]", name):
            declared = {"memory": "Memory", "state": "State", "output": "Output", "parameter": "Parameter"}
            made = f'{declared.get(self.role, "Input")}("{element[1]}", shape={max(int(element[2] or 1), 3)})'
            raise ValueError(f"variable {name}: declare the whole array with shape=, as in {made}")
        if not (name.isidentifier() and name.isascii()) or iskeyword(name):
            raise ValueError(f"variable {name!r}: a name must be an ASCII Python identifier other than a keyword")
        if hasattr(np.record, name):
            raise ValueError(f"variable {name}: numpy records have an attribute of this name; choose another")
        if self.kind == "Memory" and any(not _is_count(n) for n in self.shape):
            shape = self.shape[0] if len(self.shape) == 1 else self.shape
            raise ValueError(f"variable {name}: shape {shape!r}; it is an int of 1 or more, or a tuple of such")
        if (len(self.shape) > 1 and self.kind != "Memory") or any(not _is_count(n) for n in self.shape):
            raise ValueError(
                f"variable {name}: shape {self.shape}; a variable is a scalar or has a length of 1 or more"
            )
        if self.kind == "String" and self.shape:
            raise ValueError(f"variable {name}: String variables are scalars")
        if self.unit is not None and self.kind != "Real":
            raise ValueError(f"variable {name}: unit {self.unit}; only variables of type float have a unit")
        if self.kind == "Packets" and not _is_count(self.capacity):
            raise ValueError(f"variable {name}: capacity {self.capacity}; it is 1 byte or more")
        if self.kind == "Memory" and self.dtype not in _MEMORY_TYPES:
            raise ValueError(f"variable {name}: dtype {self.dtype!r}; there are {', '.join(_MEMORY_TYPES)}")
        if self.dtype == "?" and self.shape:
            raise ValueError(f"variable {name}: an array of dtype '?'; numba does not support it in a record; use 'u1'")
        self._check_limits()
        self._check_start()

    def _check_limits(self) -> None:
        low, high = self.limits()
        if not low <= high:
            raise ValueError(
                f"variable {self.name}: minimum {self.minimum} and maximum {self.maximum} exclude every value"
            )
        if (self.minimum, self.maximum) != (None, None) and self.kind not in ("Real", "Integer"):
            raise ValueError(f"variable {self.name}: only variables of type float and int have a minimum and a maximum")

    def _check_start(self) -> None:
        if self.kind in ("Packets", "Memory"):
            return
        if isinstance(self.start, tuple) and self.shape != (len(self.start),):
            raise ValueError(f"variable {self.name}: {len(self.start)} start values for shape {self.shape}")
        for start in self.start if isinstance(self.start, tuple) else (self.start,):
            valid, what = _fits(start, self)
            if not valid:
                raise ValueError(f"variable {self.name}: start {start!r} is {what}")

    def limits(self) -> tuple[float, float]:
        """Returns the smallest and largest value that can be set, for numbers and enumerations."""
        if self.enumeration:
            return min(self.enumeration), max(self.enumeration)
        low = -math.inf if self.minimum is None else self.minimum
        return low, math.inf if self.maximum is None else self.maximum


def _is_count(n: object) -> bool:
    return isinstance(n, int) and not isinstance(n, bool) and n >= 1


def _fits(value: object, variable: Variable) -> tuple[bool, str]:
    """Returns whether `value` can be the start value of `variable`; if not, also what is wrong with it."""
    low, high = variable.limits()
    within = f"not within {low:g} to {high:g}" if variable.kind in ("Real", "Integer") else ""
    match variable.kind:
        case "Boolean":
            return isinstance(value, bool), "not a bool"
        case "String":
            return isinstance(value, str), "not a str"
        case "Enumeration":
            members = variable.enumeration or ()
            return value in tuple(members), f"not one of {', '.join(m.name for m in members)}"
        case "Integer":
            if isinstance(value, bool) or not isinstance(value, int) or not -(2**31) <= value < 2**31:
                return False, "not an int of 32 bits"
            return low <= value <= high, within
        case _:
            if isinstance(value, bool) or not isinstance(value, int | float):
                return False, "not a float"
            return low <= value <= high, within


def _kind(of: type) -> tuple[Kind, type[IntEnum] | None]:
    if of is float:
        return "Real", None
    if of is int:
        return "Integer", None
    if of is bool:
        return "Boolean", None
    if of is str:
        return "String", None
    if isinstance(of, type) and issubclass(of, IntEnum) and len(of):
        return "Enumeration", of
    raise TypeError(f"type {of!r}: a variable is float, int, bool, str or an IntEnum with members")


def _declare(role: Role, name: str, of: type, shape: int | None, start: Start | None, **attributes: Any) -> Variable:
    kind, enumeration = _kind(of)
    zero: Start = "" if of is str else next(iter(enumeration)) if enumeration else of()
    return Variable(
        name,
        role,
        kind,
        shape=() if shape is None else (shape,),
        start=zero if start is None else start,
        enumeration=enumeration,
        **attributes,
    )


def Input(
    name: str,
    *,
    type: type = float,
    shape: int | None = None,
    unit: str | None = None,
    start: Start | None = None,
    verdict: Verdict | None = None,
    description: str = "",
) -> Variable:
    """Declares an input, held constant over a step. `type`: float, int, bool or an IntEnum; `unit`: SI, FMI notation.

    `verdict`: Role.OPTIONAL for an input that may stay unconnected.
    """
    return _declare("input", name, type, shape, start, unit=unit, verdict=verdict, description=description)


def Output(
    name: str,
    *,
    type: type = float,
    shape: int | None = None,
    unit: str | None = None,
    start: Start | None = None,
    depends: tuple[str, ...] = (),
    verdict: Verdict | None = None,
    description: str = "",
) -> Variable:
    """Declares an output. `depends`: inputs on which it depends directly in `start` (feed-through); default: none.

    `verdict`: the meaning of the output to a master; see `cosim.verdict`.
    """
    more = {"unit": unit, "depends": depends, "verdict": verdict, "description": description}
    return _declare("output", name, type, shape, start, **more)


def Parameter(
    name: str,
    *,
    type: type = float,
    shape: int | None = None,
    unit: str | None = None,
    start: Start | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    tunable: bool = False,
    rare: bool = False,
    verdict: Verdict | None = None,
    description: str = "",
) -> Variable:
    """Declares a parameter, fixed after initialization unless `tunable`. `rare`: most steps do not read it.

    `verdict`: Role.SYSTEM_ID for a MAVLink system id, Role.START_POSITION for the initial position of a body.
    """
    limits = {"minimum": minimum, "maximum": maximum, "tunable": tunable, "rare": rare, "verdict": verdict}
    return _declare("parameter", name, type, shape, start, unit=unit, description=description, **limits)


def State(
    name: str,
    *,
    type: type = float,
    shape: int | None = None,
    unit: str | None = None,
    start: Start | None = None,
    description: str = "",
) -> Variable:
    """Declares a state, visible to tools as an FMI local variable."""
    return _declare("state", name, type, shape, start, unit=unit, description=description)


def Memory(name: str, *, dtype: str = "f8", shape: int | Sequence[int] | None = None, rare: bool = False) -> Variable:
    """Declares private memory: part of the saved state, not an FMI variable, initially zero.

    `dtype`: a numpy type code such as "u1"; `rare`: most steps do not access it.
    """
    dimensions = () if shape is None else tuple(shape) if isinstance(shape, tuple | list) else (shape,)
    return Variable(name, "memory", "Memory", shape=dimensions, start=0, dtype=dtype, rare=rare)


def PacketInput(name: str, *, capacity: int, verdict: Verdict | None = None, description: str = "") -> Variable:
    """Declares MAVLink packets received in one step: fields `name` (u1[capacity]) and `name_len` (bytes used).

    `verdict`: Role.TELEMETRY or Role.SERIAL for a port that connects to ground stations or to a cable only.
    """
    more: dict[str, Any] = {"verdict": verdict, "description": description}
    return Variable(name, "packet input", "Packets", start="", capacity=capacity, **more)


def PacketOutput(name: str, *, capacity: int, verdict: Verdict | None = None, description: str = "") -> Variable:
    """Declares MAVLink packets sent during one step: fields `name` (u1[capacity]) and `name_len` (bytes used).

    `verdict`: as for `PacketInput`.
    """
    more: dict[str, Any] = {"verdict": verdict, "description": description}
    return Variable(name, "packet output", "Packets", start="", capacity=capacity, **more)


@dataclass(frozen=True, slots=True)
class FlatVariable:
    """An FMI 2 scalar variable; its value reference is its index in `flat_variables`."""

    name: str
    variable: Variable
    index: int | None
    start: float | int | bool | str


def flat_variables(variables: Sequence[Variable]) -> tuple[FlatVariable, ...]:
    """Returns the FMI scalar variables of a declaration, in order; arrays become name[1], name[2], ..."""
    flat: list[FlatVariable] = []
    for variable in variables:
        if variable.kind == "Memory":
            continue
        if not variable.shape:
            assert not isinstance(variable.start, tuple)
            flat.append(FlatVariable(variable.name, variable, None, variable.start))
            continue
        for i in range(variable.shape[0]):
            start = variable.start[i] if isinstance(variable.start, tuple) else variable.start
            flat.append(FlatVariable(f"{variable.name}[{i + 1}]", variable, i, start))
    return tuple(flat)


_LARGE = 1024
"""Bytes."""


def _is_buffer(variable: Variable) -> bool:
    """Returns whether most steps do not touch a variable: packet buffers, large tables, variables declared `rare`."""
    if variable.rare or variable.kind == "Packets" or variable.dtype in ("u1", "uint8"):
        return True
    return variable.kind == "Memory" and np.dtype([_field(variable)]).itemsize >= _LARGE


@cache
def record_layout(variables: tuple[Variable, ...]) -> tuple[np.dtype[np.void], int]:
    """Returns the aligned record type of a declaration and the size of the record's head.

    The head holds the variables that the environment sets (parameters, inputs, received packets); everything after it
    is reset before each run of `start`. Variables that most steps do not touch are placed at both ends of the record,
    so that the others are contiguous (`busy_part`). Strings are not in the record, because only models without kernels
    have them. Arrays of bool are arrays of uint8, 0 or 1.
    """
    present = [v for v in variables if v.kind != "String"]
    head = sorted((v for v in present if v.role in _KEPT), key=lambda v: not _is_buffer(v))
    rest = sorted((v for v in present if v.role not in _KEPT), key=_is_buffer)
    fields: list[tuple[Any, ...]] = []
    for part in (head, rest):
        bulk = [_field(v) for v in part if _is_buffer(v)]
        others = [_field(v) for v in part if not _is_buffer(v)]
        lengths = [(f"{v.name}_len", "i4") for v in part if v.kind == "Packets"]
        fields += [*bulk, *lengths, *others] if part is head else [*lengths, *others, *bulk]
    if not fields:
        fields.append(("_", "u1"))  # numpy cannot view memory as a record without fields
    dtype = np.dtype((np.record, np.dtype(fields, align=True)))
    assert dtype.fields is not None
    first = next((name for name, *_ in fields[_count(head) :]), None)
    return dtype, dtype.fields[first][1] if rest and first is not None else dtype.itemsize


def _count(part: list[Variable]) -> int:
    """Returns the number of record fields for these variables."""
    return len(part) + sum(v.kind == "Packets" for v in part)


def _field(variable: Variable) -> tuple[Any, ...]:
    if variable.kind == "Packets":
        return variable.name, "u1", (variable.capacity,)
    field_type = variable.dtype or _FIELD_TYPE[variable.kind]
    if field_type == "?" and variable.shape:
        field_type = "u1"  # numba does not support arrays of bool in a record
    return (variable.name, field_type, variable.shape) if variable.shape else (variable.name, field_type)


def busy_part(variables: tuple[Variable, ...]) -> tuple[int, int]:
    """Returns the byte range of the record that any step may touch: everything except the buffers."""
    dtype, _ = record_layout(variables)
    assert dtype.fields is not None
    buffers = {v.name for v in variables if _is_buffer(v)}
    assert dtype.names is not None
    busy = [dtype.fields[name] for name in dtype.names if name not in buffers]
    return (busy[0][1], busy[-1][1] + busy[-1][0].itemsize) if busy else (0, 0)


class Model(Fmi2Slave):
    """Base class of all models. A subclass declares `variables`, `kernels` and, optionally, `errors`.

    ``kernels = (start, advance)``. `start(m)` computes states and outputs from parameters and inputs. It runs in
    initialization mode, possibly several times, each time from the declared start values. `advance(m, t, h)` advances
    the record from t to t + h [s]. Both return 0, or a key of `errors`. A subclass without kernels overrides
    `do_step(t, h)` and, if needed, `initialize()`; its values are attributes of `self.m`, its strings are entries of
    `self.strings`.
    """

    variables: ClassVar[tuple[Variable, ...]] = ()
    kernels: ClassVar[tuple[Callable[[Any], int], Callable[[Any, float, float], int]] | None] = None
    errors: ClassVar[dict[int, str]] = {}
    step_size: ClassVar[float] = 0.0
    entry: ClassVar[Any] = None
    """Function that returns modelDescription.xml; set by the generated entry module of an interpreted FMU."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "do_step" in cls.__dict__:
            setattr(cls, "do_step", cls._own_step(cls.__dict__["do_step"]))  # noqa: B010 (mypy)
        model = cls.__name__
        if not model.isascii():
            raise ValueError(f"model {model}: its name becomes a C identifier and must be ASCII")
        lengths = [
            (f"{v.name}_len", f"the field {v.name}_len of packets") for v in cls.variables if v.kind == "Packets"
        ]
        declared: dict[str, str] = {}
        for name, what in [*((v.name, v.role) for v in cls.variables), *lengths]:
            if name in declared:
                text = f"model {model} declares {name} twice, as {declared[name]} and as {what}"
                raise ValueError(f"{text}; those of a kit count too, so give yours another name")
            declared[name] = what
        inputs = [v.name for v in cls.variables if v.role in ("input", "packet input")]
        for variable in cls.variables:
            if unknown := sorted(set(variable.depends) - set(inputs)):
                there = ", ".join(inputs) or "none"
                raise ValueError(f"{model}.{variable.name} depends on {', '.join(unknown)}; valid inputs: {there}")
            if cls.kernels is not None and variable.kind == "String":
                raise ValueError(f"{model}.{variable.name}: a model with kernels has no String variables")
        if wrong := complaints(cls.variables):
            raise ValueError("\n".join(f"{model}.{text}" for text in wrong))
        if cls.kernels is not None and [*map(_arity, cls.kernels)] != [1, 3]:
            raise TypeError(f"{model}: kernels must be (start, advance), the functions start(m) and advance(m, t, h)")
        for code, message in cls.errors.items():
            if not isinstance(code, int) or not code or not -(2**31) <= code < 2**31 or not isinstance(message, str):
                raise ValueError(
                    f"{model}: errors has {code!r}: {message!r}; it maps integers other than 0 to messages"
                )

    @classmethod
    def record(cls) -> Any:
        """Returns a new record (numpy.record) with all declared start values."""
        dtype, _ = record_layout(cls.variables)
        record = np.zeros(1, dtype=dtype).view(np.recarray)[0]
        for variable in cls.variables:
            if variable.kind not in ("Packets", "Memory", "String"):
                record[variable.name] = variable.start
        return record

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        cls = type(self)
        dtype, self._head = record_layout(cls.variables)
        self._initial_bytes = cls.record().tobytes()
        memory = np.frombuffer(bytearray(self._initial_bytes), dtype=np.uint8)
        self._bytes = memory
        self.m: Any = memory.view(dtype).view(np.recarray)[0]
        self.strings = {v.name: str(v.start) for v in cls.variables if v.kind == "String"}
        calculated = {v.name for v in cls.variables if v.role not in _KEPT}
        self._calculated_strings = {name: text for name, text in self.strings.items() if name in calculated}
        self._reals = memory[: dtype.itemsize - dtype.itemsize % 8].view(np.float64)
        self._places: list[tuple[Variable, int]] = []
        self._initialising = True
        self._started = False
        self._register(dtype)

    def _register(self, dtype: np.dtype[np.void]) -> None:
        types = {"Real": Real, "Integer": Integer, "Enumeration": Integer, "Boolean": Boolean}
        for flat in flat_variables(type(self).variables):
            variable = flat.variable
            offset = -1
            if variable.kind != "String":
                assert dtype.fields is not None
                offset = dtype.fields[variable.name][1]
                if flat.index is not None:
                    offset += flat.index * np.dtype(_FIELD_TYPE[variable.kind]).itemsize
            self._places.append((variable, offset))
            self.register_variable(types.get(variable.kind, String)(flat.name, **_fmi_attributes(variable)))

    # ---- life cycle, called by pythonfmu's wrapper -------------------------------------------------------------

    def enter_initialization_mode(self) -> None:
        self._initialising = True

    def exit_initialization_mode(self) -> None:
        self._ensure_started()
        self._initialising = False

    def initialize(self) -> None:
        """Computes states and outputs from parameters and inputs; models without kernels override this."""

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Performs one step by the kernel; models without kernels override this and return True."""
        if self.kernels is None:
            raise TypeError(f"{type(self).__name__} has neither kernels nor a do_step of its own")
        self._run("advance", lambda: type(self).kernels[1](self.m, current_time, step_size))  # type: ignore[index]
        return True

    @staticmethod
    def _own_step(do_step: Callable[[Any, float, float], bool]) -> Callable[[Any, float, float], bool]:
        """Wraps a `do_step` override: logs its exceptions, and treats a missing return value as an error."""

        @wraps(do_step)
        def logged(self: Any, current_time: float, step_size: float) -> bool:
            with self._logged():
                done = do_step(self, current_time, step_size)
                if not isinstance(done, bool):
                    raise TypeError(f"do_step returned {done!r}; it returns True, or False if it could not finish")
            return done

        return logged

    def _ensure_started(self) -> None:
        if self._started:
            return
        self._started = True
        self._bytes[self._head :] = np.frombuffer(self._initial_bytes, dtype=np.uint8)[self._head :]
        self.strings |= self._calculated_strings
        if self.kernels is None:
            self._run("initialize", lambda: self.initialize() or 0)  # type: ignore[func-returns-value]
        else:
            self._run("start", lambda: type(self).kernels[0](self.m))  # type: ignore[index]

    def _run(self, what: str, call: Callable[[], int]) -> None:
        """Calls a kernel and raises an exception for any code other than 0."""
        with self._logged():
            with np.errstate(all="ignore"):  # inf and NaN, as in a compiled kernel
                code = call()
            if not isinstance(code, int | np.integer):
                raise TypeError(f"{what} returned {code!r}; it returns 0, or a key of errors")
            if code and int(code) not in self.errors:
                keys = ", ".join(map(str, sorted(self.errors))) or "it has none"
                raise RuntimeError(f"{what} returned {code}; it returns 0, or a key of errors ({keys})")
            if code:
                raise RuntimeError(f"{what}: {self.errors[int(code)]} (code {code})")

    @contextmanager
    def _logged(self) -> Iterator[None]:
        """Logs exceptions raised within to the FMI logger, with their place, and passes them on to the caller."""
        try:
            yield
        except Exception as error:
            self.log(f"{type(self).__name__}: {_told(error)}", Fmi2Status.error)
            raise

    # ---- access by value reference ---------------------------------------------------------------------------------

    def _place(self, vr: int, *kinds: str) -> tuple[Variable, int]:
        if not 0 <= vr < len(self._places):
            raise ValueError(f"value reference {vr}: {type(self).__name__} has 0 to {len(self._places) - 1}")
        variable, offset = self._places[vr]
        if variable.kind not in kinds:
            raise TypeError(f"value reference {vr} is {variable.name}, a {variable.kind}, not {' or '.join(kinds)}")
        return variable, offset

    def _before_get(self) -> None:
        if self._initialising:
            self._ensure_started()

    def _before_set(self, variable: Variable, value: float | None = None) -> None:
        if variable.role not in _KEPT:
            raise ValueError(f"{variable.name} is calculated by the FMU ({variable.role}) and cannot be set")
        if not self._initialising and variable.role == "parameter" and not variable.tunable:
            raise ValueError(f"{variable.name} is a fixed parameter: it cannot be set after initialization")
        if value is not None:
            low, high = variable.limits()
            if not low <= value <= high:
                raise ValueError(f"{variable.name} = {value} is not within {low:g} to {high:g}")
        self._started = self._started and not self._initialising

    def get_real(self, vrs: list[int]) -> list[float]:
        self._before_get()
        return [float(self._reals[self._place(vr, "Real")[1] // 8]) for vr in vrs]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        for vr, value in zip(vrs, values, strict=True):
            variable, offset = self._place(vr, "Real")
            self._before_set(variable, value)
            self._reals[offset // 8] = value

    def get_integer(self, vrs: list[int]) -> list[int]:
        self._before_get()
        places = [self._place(vr, "Integer", "Enumeration")[1] for vr in vrs]
        return [int(self._bytes[o : o + 4].view(np.int32)[0]) for o in places]

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        for vr, value in zip(vrs, values, strict=True):
            variable, offset = self._place(vr, "Integer", "Enumeration")
            self._before_set(variable, value)
            self._bytes[offset : offset + 4].view(np.int32)[0] = value

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        self._before_get()
        return [bool(self._bytes[self._place(vr, "Boolean")[1]]) for vr in vrs]

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        for vr, value in zip(vrs, values, strict=True):
            variable, offset = self._place(vr, "Boolean")
            self._before_set(variable)
            self._bytes[offset] = bool(value)

    def get_string(self, vrs: list[int]) -> list[str]:
        self._before_get()
        return [self._get_text(self._place(vr, "String", "Packets")[0]) for vr in vrs]

    def _get_text(self, variable: Variable) -> str:
        if variable.kind == "String":
            return self.strings[variable.name]
        used = int(self.m[f"{variable.name}_len"])
        if used == -1:
            raise ValueError(
                f"{variable.name}: a packet does not fit into its {variable.capacity} bytes, or its message is not in "
                "the dialect; send less in a step, or give it a larger capacity"
            )
        if not 0 <= used <= variable.capacity:
            raise ValueError(f"{variable.name}: the kernel reports {used} bytes, its capacity is {variable.capacity}")
        return base64.b64encode(self.m[variable.name][:used].tobytes()).decode("ascii")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        for vr, value in zip(vrs, values, strict=True):
            variable, _ = self._place(vr, "String", "Packets")
            self._before_set(variable)
            if variable.kind == "String":
                self.strings[variable.name] = value
                continue
            try:
                packets = base64.b64decode(value, validate=True)
            except (binascii.Error, ValueError) as error:
                raise ValueError(f"{variable.name}: not base64 text ({error})") from None
            if len(packets) > variable.capacity:
                raise ValueError(f"{variable.name} holds {variable.capacity} bytes, not {len(packets)}")
            self.m[variable.name][: len(packets)] = np.frombuffer(packets, dtype=np.uint8)
            self.m[f"{variable.name}_len"] = len(packets)

    # ---- FMU state: the record is the complete state -----------------------------------------------------------------

    def _get_fmu_state(self) -> dict[str, Any]:
        modes = {"initialising": self._initialising, "started": self._started}
        return {"record": base64.b64encode(self._bytes.tobytes()).decode("ascii"), **modes}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._bytes[:] = np.frombuffer(base64.b64decode(state["record"]), dtype=np.uint8)
        self._initialising, self._started = state["initialising"], state["started"]

    def to_xml(self, model_options: dict[str, str] | None = None) -> Any:  # noqa: ARG002
        """Returns modelDescription.xml as written by the build of this FMU."""
        if self.entry is None:
            raise RuntimeError(f"{type(self).__name__}: no model description; build the FMU with `uav-cosim build`")
        return self.entry()


def _arity(kernel: Any) -> int:
    """Returns the number of arguments of a kernel; -1 for an object that is not a function."""
    code = getattr(getattr(kernel, "py_func", kernel), "__code__", None)
    return -1 if code is None else int(code.co_argcount)


def _fmi_attributes(variable: Variable) -> dict[str, Any]:
    """Returns causality, variability and initial of a declared variable in pythonfmu's types."""
    if variable.role == "parameter":
        variability = Fmi2Variability.tunable if variable.tunable else Fmi2Variability.fixed
        return {"causality": Fmi2Causality.parameter, "variability": variability, "initial": Fmi2Initial.exact}
    variability = Fmi2Variability.continuous if variable.kind == "Real" else Fmi2Variability.discrete
    if variable.role in ("input", "packet input"):
        return {"causality": Fmi2Causality.input, "variability": variability}
    causality = Fmi2Causality.local if variable.role == "state" else Fmi2Causality.output
    return {"causality": causality, "variability": variability, "initial": Fmi2Initial.calculated}


def _told(error: Exception) -> str:
    """Returns the text of an exception, with its file and line and the traceback from the author's code on.

    Exceptions raised by this file, as for a code that a kernel returns, have neither.
    """
    whole = traceback.TracebackException.from_exception(error)
    here = str(Path(__file__).parent)
    frames = [*dropwhile(lambda frame: frame.filename.startswith(here), whole.stack)]
    if not frames:
        return str(error)
    own = [frame for frame in frames if not frame.filename.startswith(here) and "site-packages" not in frame.filename]
    text = "".join(whole.format_exception_only()).rstrip()
    whole.stack = traceback.StackSummary.from_list(frames)
    last = (own or frames)[-1]
    return f"{Path(last.filename).name}:{last.lineno}: {text}\n{''.join(whole.format())}"
