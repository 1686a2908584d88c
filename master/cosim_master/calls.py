"""FMI functions called by their address, from compiled loops.

Each is a numba intrinsic: an indirect call in the machine code of the loop, with no Python in between. Where
kernels run as plain Python (NUMBA_DISABLE_JIT=1, for debugging) the same names call through ctypes, slowly.

An address is an unsigned pointer-sized integer, and so is everything that points.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import config as _numba_config
from numba import types
from numba.extending import intrinsic as _numba_intrinsic

__all__ = [
    "PLAIN",
    "atomic_add",
    "atomic_load",
    "byte_at",
    "do_step2",
    "exchange_if",
    "get_or_set",
    "nanoseconds",
    "rest",
]

intrinsic: Any = _numba_intrinsic
_config: Any = _numba_config
_I32, _I64, _F64 = ir.IntType(32), ir.IntType(64), ir.DoubleType()


def _get_or_set(typing: Any, function: Any, instance: Any, references: Any, n: Any, values: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64] * 4).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(*[types.uintp] * 5), codegen


def _do_step2(typing: Any, function: Any, instance: Any, t: Any, h: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64, _F64, _F64, _I32]).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), [*arguments[1:], ir.Constant(_I32, 1)])

    return types.int32(types.uintp, types.uintp, types.double, types.double), codegen


def _byte_at(typing: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], ir.IntType(8).as_pointer()))

    return types.uint8(types.uintp), codegen


def _load(typing: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(builder.inttoptr(arguments[0], _I64.as_pointer()), "seq_cst", 8)

    return types.int64(types.uintp), codegen


def _add(typing: Any, address: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.atomic_rmw("add", builder.inttoptr(arguments[0], _I64.as_pointer()), arguments[1], "seq_cst")

    return types.int64(types.uintp, types.int64), codegen


def _exchange_if(typing: Any, address: Any, expected: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], _I64.as_pointer())
        pair = builder.cmpxchg(place, arguments[1], arguments[2], "seq_cst", "seq_cst")
        return builder.extract_value(pair, 1)

    return types.boolean(types.uintp, types.int64, types.int64), codegen


def _nanoseconds(typing: Any) -> Any:
    """The monotonic clock of POSIX."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I32, _I64.as_pointer()])
        function = builder.module.globals.get("clock_gettime") or ir.Function(builder.module, kind, "clock_gettime")
        place = builder.alloca(_I64, 2)
        builder.call(function, [ir.Constant(_I32, 1), place])
        seconds = builder.load(place)
        rest = builder.load(builder.gep(place, [ir.Constant(_I32, 1)]))
        return builder.add(builder.mul(seconds, ir.Constant(_I64, 1_000_000_000)), rest)

    return types.int64(), codegen


_sched_yield: Any = types.ExternalFunction("sched_yield", types.int32())
_usleep: Any = types.ExternalFunction("usleep", types.int32(types.uint32))


def _rest(spins: int) -> None:
    """Wait a moment: not at all at first, then let others run, then sleep."""
    if spins > 20000:
        _usleep(np.uint32(50))
    elif spins > 200:
        _sched_yield()


def _plain_get_or_set(function: int, instance: int, references: int, n: int, values: int) -> int:
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
    return int(call(int(function))(int(instance), int(references), int(n), int(values)))


def _plain_do_step2(function: int, instance: int, t: float, h: float) -> int:
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
    return int(call(int(function))(int(instance), t, h, 1))


def _plain_byte_at(address: int) -> int:
    return ctypes.c_ubyte.from_address(int(address)).value


def _no_threads(*_: int) -> int:
    raise RuntimeError("threads need compiled kernels; NUMBA_DISABLE_JIT is set")


PLAIN = bool(_config.DISABLE_JIT)
"""Whether kernels run as plain Python."""
get_or_set: Any = _plain_get_or_set if PLAIN else intrinsic(_get_or_set)
"""fmi2GetXXX or fmi2SetXXX(instance, references, n, values) -> status"""
do_step2: Any = _plain_do_step2 if PLAIN else intrinsic(_do_step2)
"""fmi2DoStep(instance, t, h, fmi2True) -> status; t and h in s"""
byte_at: Any = _plain_byte_at if PLAIN else intrinsic(_byte_at)
"""The byte at an address."""
atomic_load: Any = _no_threads if PLAIN else intrinsic(_load)
"""The int64 at an address, as every thread sees it."""
atomic_add: Any = _no_threads if PLAIN else intrinsic(_add)
"""Add to the int64 at an address; returns what it was."""
exchange_if: Any = _no_threads if PLAIN else intrinsic(_exchange_if)
"""exchange_if(address, expected, value): replace the int64 if it is still `expected`; returns whether it was."""
nanoseconds: Any = _no_threads if PLAIN else intrinsic(_nanoseconds)
"""Monotonic time."""
rest: Any = _no_threads if PLAIN else numba.njit(_rest)
"""Wait for other threads, the longer the more `spins` have passed."""
