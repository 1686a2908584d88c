"""The calls of the loop: functions, arguments and conversions by FMI version."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest

from cosim_master.fmi.calls import (
    CALL,
    FUNCTIONS,
    PACKED,
    TYPED,
    WIDE_WIDTHS,
    WIDTHS,
    CallMemory,
    Calls2,
    Calls3,
    PacketPlaces,
)
from cosim_master.fmi.description.variables import Variable

HANDLE, VALUES = 77, 4096


def address(function: str) -> int:
    """A different address for each function, as of a library."""
    return 1000 + FUNCTIONS.index(function)


def variables(*types: tuple[str, str]) -> list[Variable]:
    return [
        Variable(f"v{i}", 10 + i, kind, "input", "continuous", None, fmi_type=t) for i, (kind, t) in enumerate(types)
    ]


def table(rows: list[Any]) -> np.ndarray[Any, Any]:
    return np.array(rows, dtype=CALL)


def references(row: Any, n: int) -> list[int]:
    return list((ctypes.c_uint32 * n).from_address(int(row["references"])))


def typed(row: Any) -> dict[str, int]:
    content = (ctypes.c_uint64 * 5).from_address(int(row["values"]))
    return dict(zip(TYPED.names or (), content, strict=True))


@pytest.mark.parametrize("kind", ["Real", "Integer", "Boolean"])
@pytest.mark.parametrize("verb", ["Set", "Get"])
def test_fmi_2_has_one_call_per_kind(verb: str, kind: str) -> None:
    memory = CallMemory(4, 16)
    row = table(Calls2(address, HANDLE, memory).values(verb, kind, variables((kind, ""), (kind, "")), VALUES))[0]
    assert FUNCTIONS[row["number"]] == f"fmi2{verb}{kind}"
    assert (row["function"], row["handle"], row["values"], row["n"], row["width"]) == (
        address(f"fmi2{verb}{kind}"),
        HANDLE,
        VALUES,
        2,
        0,
    )
    assert references(row, 2) == [10, 11]


def test_instances_of_one_fmu_share_value_references() -> None:
    memory = CallMemory(4, 16)
    rows = [Calls2(address, i, memory).values("Get", "Real", variables(("Real", "")), VALUES)[0] for i in range(3)]
    assert len({row[2] for row in rows}) == 1


def test_fmi_3_has_one_call_per_type_and_converts_into_a_buffer() -> None:
    memory = CallMemory(4, 16)
    some = variables(("Real", "Float32"), ("Real", "Float64"), ("Real", "Float64"))
    first, second = table(Calls3(address, HANDLE, memory).values("Set", "Real", some, VALUES))
    assert [FUNCTIONS[row["number"]] for row in (first, second)] == ["fmi3SetFloat32", "fmi3SetFloat64"]
    assert (first["width"], first["n"]) == (WIDTHS["Float32"], 1)
    own = typed(first)
    assert (own["plain"], own["n_values"], own["sets"]) == (VALUES, 1, 1)
    begin = memory.memory.ctypes.data
    assert begin <= own["values"] < begin + memory.memory.size
    # Doubles are the loop's own: without a buffer, both numbers in `n`.
    assert (second["width"], second["n"], second["values"]) == (PACKED, 2 | 2 << 16, VALUES + 8)
    assert references(second, 2) == [11, 12]


def test_integers_of_64_bits_have_two_places_in_the_loop() -> None:
    memory, one = CallMemory(4, 16), variables(("Integer", "Int64"))
    (row,) = table(Calls3(address, HANDLE, memory).values("Get", "Integer", [*one, *one], VALUES))
    assert (FUNCTIONS[row["number"]], row["width"], row["n"]) == ("fmi3GetInt64", WIDE_WIDTHS["Int64"], 1)
    assert (typed(row)["n_values"], typed(row)["plain"]) == (1, VALUES)


def test_packets_are_text_in_fmi_2_and_bytes_in_fmi_3() -> None:
    places, memory = PacketPlaces(8, 16, 24), CallMemory(4, 16)
    two, three = Calls2(address, HANDLE, memory), Calls3(address, HANDLE, memory)
    assert (two.binary, three.binary) == (False, True)
    first, second = table([two.packets("Get", places), three.packets("Set", places)])
    assert (FUNCTIONS[first["number"]], first["references"], first["values"]) == ("fmi2GetString", 8, 16)
    assert (FUNCTIONS[second["number"]], second["references"], second["width"]) == (
        "fmi3SetBinary",
        8,
        WIDTHS["Binary"],
    )
    own = typed(second)
    assert (own["values"], own["sizes"], own["n_values"], own["sets"]) == (16, 24, 1, 1)


def test_only_fmi_2_has_derivatives_of_inputs() -> None:
    memory, some = CallMemory(4, 16), variables(("Real", ""), ("Real", ""))
    (row,) = table([Calls2(address, HANDLE, memory).input_derivatives(some, VALUES)])
    assert (FUNCTIONS[row["number"]], row["n"]) == ("fmi2SetRealInputDerivatives", 2)
    orders = (ctypes.c_uint32 * 2).from_address(typed(row)["values"])
    assert (list(orders), typed(row)["n_values"], references(row, 2)) == ([1, 1], VALUES, [10, 11])
    with pytest.raises(TypeError, match="FMI 3 has no derivatives of inputs"):
        Calls3(address, HANDLE, memory).input_derivatives(some, VALUES)
