"""Access to a record's fields by byte offset in compiled code (`cosim.fields`)."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["get_real", "get_whole", "set_real", "set_whole"]


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


get_real, set_real = _reader(types.float64), _writer(types.float64)
get_whole, set_whole = _reader(types.int32), _writer(types.int32)
