"""Arrow arrays of numpy arrays and texts, and the way back.

pyarrow's own `array` and `to_numpy` import pandas, where it is installed, to tell its types from others: a fifth of a
second of each run that is recorded. These functions copy nothing but texts, truth values and columns with nulls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

__all__ = ["array_of", "numbers", "text_of", "texts", "values_of"]


def array_of(values: NDArray[Any], type: pa.DataType, *, valid: NDArray[np.bool_] | None = None) -> pa.Array:
    """Returns numbers or truth values as an array of this type.

    Args:
        values: (n,); it must not change while the array is used.
        type: of the array, which has the size of the values, or `bool`.
        valid: (n,); the other elements are null.
    """
    if pa.types.is_boolean(type):
        content = np.packbits(values.astype(bool, copy=False), bitorder="little")
    else:
        content = np.ascontiguousarray(values)
    absent = None if valid is None else pa.py_buffer(np.packbits(valid, bitorder="little"))
    return pa.Array.from_buffers(type, len(values), [absent, pa.py_buffer(content)])


def texts(values: Sequence[str | None]) -> pa.Array:
    """Returns texts as an array; None is null."""
    content = [(value or "").encode() for value in values]
    ends = np.zeros(len(content) + 1, np.int32)
    np.cumsum([len(one) for one in content], out=ends[1:], dtype=np.int32)
    valid = np.array([value is not None for value in values], bool)
    absent = None if valid.all() else pa.py_buffer(np.packbits(valid, bitorder="little"))
    return pa.StringArray.from_buffers(len(content), pa.py_buffer(ends), pa.py_buffer(b"".join(content)), absent)


def text_of(numbers: NDArray[np.integer[Any]], names: pa.Array) -> pa.Array:
    """Returns the texts with these numbers, (n,), as an array."""
    return names.take(array_of(np.asarray(numbers, np.int32), pa.int32()))


def numbers(column: pa.Array | pa.ChunkedArray, dtype: type[np.generic]) -> NDArray[Any]:
    """Returns the numbers of a column, (n,), which has this type; NaN for null."""
    one = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if not len(one):
        return np.empty(0, dtype)
    valid, content = one.buffers()
    end = one.offset + len(one)
    found = np.frombuffer(content, dtype, end)[one.offset :]
    if one.null_count:
        bits = np.unpackbits(np.frombuffer(valid, np.uint8), count=end, bitorder="little")[one.offset :]
        return np.where(bits, found, np.nan)
    return found


def values_of(column: pa.Array | pa.ChunkedArray) -> NDArray[Any]:
    """Returns the values of a column, (n,): numbers in the type of the column, truth values as `bool`.

    Null is NaN; columns of other types, and truth values with nulls, are left to pyarrow.
    """
    kind = column.type
    if pa.types.is_boolean(kind) and not column.null_count:
        one = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
        if not len(one):
            return np.empty(0, bool)
        end = one.offset + len(one)
        bits = np.frombuffer(one.buffers()[1], np.uint8)
        return np.unpackbits(bits, count=end, bitorder="little")[one.offset :].view(bool)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        letter = "f" if pa.types.is_floating(kind) else "i" if pa.types.is_signed_integer(kind) else "u"
        return numbers(column, np.dtype(f"{letter}{kind.bit_width // 8}").type)
    found: NDArray[Any] = column.to_numpy(zero_copy_only=False) if isinstance(column, pa.Array) else column.to_numpy()
    return found
