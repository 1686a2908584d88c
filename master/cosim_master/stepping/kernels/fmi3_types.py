"""FMI 3 get and set calls of the stepping loop: they convert between FMI 3's types and the plan's floats and integers.

In a CALL row (see `fmi.calls`) of an FMI 3 instance, `width` selects the conversion of the values, and `values` is the
address of a TYPED record. Float64 and Int32 are the plan's own types; others are converted in a buffer of the call. An
integer that does not fit is an error. A 64-bit integer or a UInt32 occupies two integers of the plan.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import kernel
from cosim_master.fmi.calls import WIDE_WIDTHS, WIDTHS
from cosim_master.stepping.kernels.fmi_calls import (
    get_or_set3,
    get_or_set_binary,
    load_f4,
    load_f8,
    load_i1,
    load_i2,
    load_i4,
    load_i8,
    load_u1,
    load_u2,
    load_u4,
    store_f4,
    store_f8,
    store_i1,
    store_i2,
    store_i4,
    store_i8,
)

__all__ = ["OUT_OF_RANGE", "call3"]

OUT_OF_RANGE = -5
"""Replaces a status: an integer does not fit into the variable's type, or into 32 bits."""

_PLAIN, _BINARY, _FLOAT32, _BOOLEAN = (WIDTHS[name] for name in ("Int32", "Binary", "Float32", "Boolean"))
_INT8, _INT16, _UINT8, _UINT16 = (WIDTHS[name] for name in ("Int8", "Int16", "UInt8", "UInt16"))
_UINT32, _UINT64 = WIDTHS["UInt32"], WIDTHS["UInt64"]
_WIDE, _WIDE_UINT32 = WIDE_WIDTHS["Int64"], WIDE_WIDTHS["UInt32"]
_VALUES, _N_VALUES, _SIZES, _PLAINLY, _SETS = range(5)
"""Fields of a TYPED record."""


@kernel
def _at(base: int, size: int, i: int) -> int:
    return np.uintp(np.uintp(base) + np.uintp(size) * np.uintp(i))  # type: ignore[return-value]


@kernel
def _to_fmu(width: int, plain: int, native: int, n: int) -> bool:
    """Converts values to be set; returns False if an integer does not fit."""
    for i in range(n):
        if width == _FLOAT32:
            store_f4(_at(native, 4, i), load_f8(_at(plain, 8, i)))
            continue
        if width in (_WIDE, _WIDE_UINT32):
            size = 8 if width == _WIDE else 4
            store_i4(_at(native, size, i), load_i4(_at(plain, 8, i)))
            if width == _WIDE:
                store_i4(_at(native, 4, 2 * i + 1), load_i4(_at(plain, 4, 2 * i + 1)))
            continue
        x = load_i4(_at(plain, 4, i))
        if width in (_INT8, _UINT8):
            low, high = (-128, 127) if width == _INT8 else (0, 255)
            store_i1(_at(native, 1, i), x)
        elif width in (_INT16, _UINT16):
            low, high = (-32768, 32767) if width == _INT16 else (0, 65535)
            store_i2(_at(native, 2, i), x)
        elif width == _UINT32:
            low, high = 0, 2147483647
            store_i4(_at(native, 4, i), x)
        elif width == _BOOLEAN:
            low, high = -2147483648, 2147483647
            store_i1(_at(native, 1, i), 1 if x != 0 else 0)
        else:
            low, high = (0 if width == _UINT64 else -2147483648), 2147483647
            store_i8(_at(native, 8, i), x)
        if x < low or x > high:
            return False
    return True


@kernel
def _from_fmu(width: int, native: int, plain: int, n: int) -> bool:
    """Converts values received; returns False if an integer has more than 32 bits."""
    for i in range(n):
        if width == _FLOAT32:
            store_f8(_at(plain, 8, i), load_f4(_at(native, 4, i)))
            continue
        if width in (_WIDE, _WIDE_UINT32):
            size = 8 if width == _WIDE else 4
            store_i4(_at(plain, 8, i), load_i4(_at(native, size, i)))
            store_i4(_at(plain, 4, 2 * i + 1), load_i4(_at(native, 4, 2 * i + 1)) if width == _WIDE else 0)
            continue
        if width == _INT8:
            x = load_i1(_at(native, 1, i))
        elif width == _UINT8:
            x = load_u1(_at(native, 1, i))
        elif width == _INT16:
            x = load_i2(_at(native, 2, i))
        elif width == _UINT16:
            x = load_u2(_at(native, 2, i))
        elif width == _UINT32:
            x = load_u4(_at(native, 4, i))
        elif width == _BOOLEAN:
            x = load_u1(_at(native, 1, i))
            x = 1 if x != 0 else 0
        else:
            x = load_i8(_at(native, 8, i))
            if width == _UINT64 and x < 0:
                return False
        if x < -2147483648 or x > 2147483647:
            return False
        store_i4(_at(plain, 4, i), x)
    return True


@kernel
def _field(typed: int, number: int) -> Any:
    return np.uintp(load_i8(_at(typed, 8, number)))


@kernel
def call3(call: Any) -> Any:
    """Makes an FMI 3 call with its conversions; returns a status, or OUT_OF_RANGE."""
    width = call.width
    function, handle, references, n = call.function, call.handle, call.references, np.uintp(call.n)
    values = _field(call.values, _VALUES)
    n_values = _field(call.values, _N_VALUES)
    if width == _BINARY:
        sizes = _field(call.values, _SIZES)
        return get_or_set_binary(function, handle, references, n, sizes, values, n_values)
    if width == _PLAIN:
        return get_or_set3(function, handle, references, n, values, n_values)
    plain, sets = _field(call.values, _PLAINLY), _field(call.values, _SETS) != 0
    if sets and not _to_fmu(width, plain, values, n_values):
        return OUT_OF_RANGE
    status = get_or_set3(function, handle, references, n, values, n_values)
    if status > 1 or sets:
        return status
    return status if _from_fmu(width, values, plain, n_values) else OUT_OF_RANGE
