"""What kernels of the radio call in compiled code only: prefetching, and a user's own function by its address."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic as _numba_intrinsic

_intrinsic: Any = _numba_intrinsic


def _prefetch(typing: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch.p0i8", (), kind)
        hints = [ir.Constant(number, one) for one in (0, 3, 1)]  # to be read, into all caches, data
        builder.call(function, [builder.inttoptr(arguments[0], pointer), *hints])
        return context.get_dummy_value()

    return types.none(types.uintp), codegen


def _delay_of(typing: Any, function: Any, packet: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.DoubleType(), [ir.IntType(64)]).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.double(types.uintp, types.uintp), codegen


prefetch = _intrinsic(_prefetch)
delay_of = _intrinsic(_delay_of)
