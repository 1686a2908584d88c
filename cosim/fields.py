"""Kernels that access a record's fields by byte offset.

A kernel names a record's fields in its source. Lookup tables of fields (parameters that a ground station names) need
their byte offsets instead, which `cosim.model.record_layout` provides.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.kernel import PLAIN, kernel

__all__ = ["get_real", "get_whole", "set_real", "set_whole"]


def _get_real(record: Any, offset: int) -> float:
    return float(record.getfield(np.float64, int(offset)))


def _set_real(record: Any, offset: int, value: float) -> None:
    record.setfield(value, np.float64, int(offset))


def _get_whole(record: Any, offset: int) -> int:
    return int(record.getfield(np.int32, int(offset)))


def _set_whole(record: Any, offset: int, value: int) -> None:
    record.setfield(value, np.int32, int(offset))


if not PLAIN:
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic

    def _reader(kind: Any) -> Any:
        def read(typing: Any, record: Any, offset: Any) -> Any:  # noqa: ARG001 (numba prescribes the arguments)
            def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
                address = builder.bitcast(arguments[0], cgutils.voidptr_t)
                place = builder.gep(address, [arguments[1]])
                return builder.load(builder.bitcast(place, context.get_value_type(kind).as_pointer()))

            return kind(record, types.int64), lower

        return intrinsic(read)

    def _writer(kind: Any) -> Any:
        def write(typing: Any, record: Any, offset: Any, value: Any) -> Any:  # noqa: ARG001
            def lower(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
                address = builder.bitcast(arguments[0], cgutils.voidptr_t)
                place = builder.gep(address, [arguments[1]])
                builder.store(arguments[2], builder.bitcast(place, context.get_value_type(kind).as_pointer()))
                return context.get_dummy_value()

            return types.void(record, types.int64, kind), lower

        return intrinsic(write)

    _get_real, _set_real = _reader(types.float64), _writer(types.float64)
    _get_whole, _set_whole = _reader(types.int32), _writer(types.int32)


@kernel
def get_real(record: Any, offset: int) -> float:
    """Returns the float64 at byte `offset` of a record; the offset is not checked."""
    return _get_real(record, offset)


@kernel
def set_real(record: Any, offset: int, value: float) -> None:
    """Writes the float64 at byte `offset` of a record; the offset is not checked."""
    _set_real(record, offset, value)


@kernel
def get_whole(record: Any, offset: int) -> int:
    """Returns the int32 at byte `offset` of a record; the offset is not checked."""
    return _get_whole(record, offset)


@kernel
def set_whole(record: Any, offset: int, value: int) -> None:
    """Writes the int32 at byte `offset` of a record; the offset is not checked."""
    _set_whole(record, offset, value)
