"""The calls by which a loop in machine code sets and gets the values of FMU instances, as rows with all arguments.

    memory = CallMemory(n_calls, n_values)
    rows += slave.calls(memory).values("Set", "Real", variables, values)
    table = np.array(rows, dtype=CALL)

The loop makes these calls by address; which function a value, packet or derivative needs, and in which form, depends on
the FMI version only here. This module does not import numba, since checks of a system need it, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim_master.fmi.description.variables import Variable

__all__ = [
    "CALL",
    "FUNCTIONS",
    "KINDS",
    "PACKED",
    "TYPED",
    "WIDE_WIDTHS",
    "WIDTHS",
    "CallMemory",
    "Calls",
    "Calls2",
    "Calls3",
    "PacketPlaces",
    "Row",
    "call_of",
]

KINDS = ("Real", "Integer", "Boolean")
"""The types of numbers in the loop; reals are doubles, the others integers of 32 bits, one or two for a value."""

WIDTHS = {
    "Float64": 1,
    "Int32": 1,
    "Binary": 2,
    "Float32": 3,
    "Int8": 4,
    "UInt8": 5,
    "Int16": 6,
    "UInt16": 7,
    "UInt32": 8,
    "Int64": 9,
    "UInt64": 10,
    "Boolean": 11,
}
"""The codes by which a call converts values, by FMI 3 type; 0 is FMI 2. Values of width 1 are the loop's own."""
WIDE_WIDTHS = {"Int64": 12, "UInt64": 12, "UInt32": 13}
"""The same for types whose values have two places in the loop."""
PACKED = 14
"""For values that are the loop's own, if there are less than 65536 references and values: `values` of the row is the
address of the values, and `n` contains both numbers, that of values in the upper half.
"""

FUNCTIONS = (
    "",
    "fmi2SetReal",
    "fmi2SetInteger",
    "fmi2SetBoolean",
    "fmi2SetString",
    "fmi2DoStep",
    "fmi2GetReal",
    "fmi2GetInteger",
    "fmi2GetBoolean",
    "fmi2GetString",
    *(f"fmi3{verb}{fmi_type}" for verb in ("Set", "Get") for fmi_type in WIDTHS),
    "fmi2SetRealInputDerivatives",
)
"""FMI functions, by their numbers in rows and in failures of the loop."""
_NUMBERS = {function: number for number, function in enumerate(FUNCTIONS)}

CALL = np.dtype(
    [
        ("function", "u8"),
        ("handle", "u8"),
        ("references", "u8"),
        ("values", "u8"),  # of FMI 3: address of a TYPED record
        ("n", "u4"),
        ("number", "u2"),  # in FUNCTIONS
        ("width", "u2"),  # 0 is FMI 2; of FMI 3 see WIDTHS
    ]
)
"""A call of fmiXSetYYY or fmiXGetYYY with all its arguments. It is small, since memory traffic costs more than
computation with thousands of instances.
"""
TYPED = np.dtype(
    [
        ("values", "u8"),
        ("n_values", "u8"),
        ("sizes", "u8"),  # of a Binary
        ("plain", "u8"),  # place of the values in the loop, if `values` is a buffer of the call
        ("sets", "i8"),
    ]
)
"""The arguments of an FMI 3 call that FMI 2 lacks; they are stored separately, to keep FMI 2 calls small."""

Row = tuple[int, ...]
"""The columns of a CALL row."""


def call_of(v: Variable) -> tuple[str, bool, bool, bool]:
    """Returns a grouping key: variables of an instance with equal keys are accessed in one call."""
    return v.fmi_type, v.wide, bool(v.clocks), v.by_event


class CallMemory:
    """Memory that calls point to, allocated piece by piece.

    Args:
        calls: the largest number of calls with a TYPED record.
        values: the number of values that they set and get.
        further: bytes to be taken besides.

    Attributes:
        memory: (n,), uint8; it must live as long as the calls.
    """

    def __init__(self, calls: int, values: int, further: int = 0) -> None:
        self.memory: NDArray[np.uint8] = np.zeros(further + 32 * values + TYPED.itemsize * calls + 256, dtype=np.uint8)
        self._used = -self.memory.ctypes.data % 16
        self._known: dict[tuple[int, ...], int] = {}

    def take(self, size: int) -> int:
        """Returns the address of `size` newly allocated bytes, a multiple of 8."""
        first = self._used
        self._used += -(-size // 8) * 8
        assert self._used <= self.memory.size
        return int(self.memory.ctypes.data) + first

    def put(self, numbers: Sequence[int]) -> int:
        """Returns the address of value references, which instances of the same FMU share."""
        key = tuple(numbers)
        if (known := self._known.get(key)) is not None:
            return known
        address = self._known[key] = self.take(4 * len(numbers))
        first = address - self.memory.ctypes.data
        self.memory[first : first + 4 * len(numbers)] = np.array(numbers, np.uint32).view(np.uint8)
        return address

    def typed(self, *, values: int, n_values: int, sizes: int = 0, plain: int = 0, sets: bool) -> int:
        """Returns the address of a new TYPED record."""
        address = self.take(TYPED.itemsize)
        first = address - self.memory.ctypes.data
        self.memory[first : first + TYPED.itemsize].view(TYPED)[0] = (values, n_values, sizes, plain, int(sets))
        return address


class PacketPlaces(NamedTuple):
    """Addresses of the arguments of a call for packets; `size`, their number of bytes, is not needed for text."""

    reference: int
    value: int
    size: int


class Calls(Protocol):
    """The calls of one instance, one implementation per FMI version. `verb` is Set or Get; addresses are integers.

    Attributes:
        binary: whether packets are bytes; otherwise they are base64 text.
    """

    binary: bool

    def values(self, verb: str, kind: str, variables: Sequence[Variable], values: int) -> list[Row]:
        """Returns the calls that set or get variables of one of KINDS.

        Args:
            variables: in the order of `call_of`; a variable of two places appears twice.
            values: address of their values in the loop.
        """

    def packets(self, verb: str, places: PacketPlaces) -> Row:
        """Returns the call that sets or gets packets."""

    def input_derivatives(self, variables: Sequence[Variable], derivatives: int) -> Row:
        """Returns the call that sets first derivatives of Real inputs, which are at an address.

        Raises:
            TypeError: the version has no such function; `FmuDescription.no_input_derivatives` tells beforehand.
        """


class Calls2:
    """The calls of an instance of FMI 2, or of one with its functions.

    Args:
        address: returns the address of a function by its name.
        handle: of the instance, the first argument of every call.
        memory: for arguments.
    """

    binary = False

    def __init__(self, address: Callable[[str], int], handle: int, memory: CallMemory) -> None:
        self._address, self._handle, self._memory = address, handle, memory

    def values(self, verb: str, kind: str, variables: Sequence[Variable], values: int) -> list[Row]:
        references = self._memory.put([v.value_reference for v in variables])
        return [self._row(f"fmi2{verb}{kind}", references, values, len(variables))]

    def packets(self, verb: str, places: PacketPlaces) -> Row:
        return self._row(f"fmi2{verb}String", places.reference, places.value, 1)

    def input_derivatives(self, variables: Sequence[Variable], derivatives: int) -> Row:
        # Like FMI 3 calls, it has five arguments; the last two are orders and derivatives.
        memory, n = self._memory, len(variables)
        typed = memory.typed(values=memory.put([1] * n), n_values=derivatives, sets=True)
        references = memory.put([v.value_reference for v in variables])
        return self._row("fmi2SetRealInputDerivatives", references, typed, n, WIDTHS["Float64"])

    def _row(self, function: str, references: int, values: int, n: int, width: int = 0) -> Row:
        return (self._address(function), self._handle, references, values, n, _NUMBERS[function], width)


class Calls3:
    """The calls of an instance of FMI 3, with the conversions of its types; arguments as of `Calls2`.

    Args:
        inputs_by_event: whether discrete inputs are set in Event Mode, and not by these calls.
    """

    binary = True

    def __init__(
        self, address: Callable[[str], int], handle: int, memory: CallMemory, *, inputs_by_event: bool = False
    ) -> None:
        self._address, self._handle, self._memory = address, handle, memory
        self._inputs_by_event = inputs_by_event

    def values(self, verb: str, kind: str, variables: Sequence[Variable], values: int) -> list[Row]:
        rows: list[Row] = []
        size, first = 8 if kind == "Real" else 4, 0
        while first < len(variables):
            fmi_type, wide, clocked, by_event = key = call_of(variables[first])
            last = first
            references: list[int] = []
            while last < len(variables) and call_of(variables[last]) == key:
                if not variables[last].element:  # a scalar, or the first element of an array
                    references.append(variables[last].value_reference)
                last += 1 + wide
            # Variables of Clocks are set and read in Event Mode.
            if not clocked and not (by_event and self._inputs_by_event):
                n = (last - first) // (1 + wide)
                rows.append(self._converted(f"fmi3{verb}{fmi_type}", references, n, values + size * first, wide=wide))
            first = last
        return rows

    def _converted(self, function: str, references: Sequence[int], n: int, plain: int, *, wide: bool) -> Row:
        """Returns the call for n values of one FMI 3 type at `plain`, in a buffer of its own if they are converted."""
        fmi_type, memory = function[7:], self._memory
        buffer = plain if fmi_type in ("Float64", "Int32") else memory.take(8 * n)
        if buffer == plain and n < 1 << 16:
            return self._row(function, references, plain, len(references) | n << 16, PACKED)
        typed = memory.typed(values=buffer, n_values=n, plain=plain, sets=function[4:7] == "Set")
        width = (WIDE_WIDTHS if wide else WIDTHS)[fmi_type]
        return self._row(function, references, typed, len(references), width)

    def packets(self, verb: str, places: PacketPlaces) -> Row:
        function = f"fmi3{verb}Binary"
        typed = self._memory.typed(values=places.value, n_values=1, sizes=places.size, sets=verb == "Set")
        number = _NUMBERS[function]
        return (self._address(function), self._handle, places.reference, typed, 1, number, WIDTHS["Binary"])

    def input_derivatives(self, variables: Sequence[Variable], derivatives: int) -> Row:  # noqa: ARG002
        raise TypeError("FMI 3 has no derivatives of inputs")

    def _row(self, function: str, references: Sequence[int], values: int, n: int, width: int) -> Row:
        number = _NUMBERS[function]
        return (self._address(function), self._handle, self._memory.put(references), values, n, number, width)
