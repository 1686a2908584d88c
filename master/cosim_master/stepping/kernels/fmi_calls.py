"""Calls of FMI functions by their address, from compiled loops.

Each is a numba intrinsic: an indirect call in the machine code of the loop, with no Python in between. If kernels run
as plain Python (NUMBA_DISABLE_JIT=1, for debugging), the same names call through ctypes, which is slow.

Addresses, handles and other pointers are unsigned pointer-sized integers.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic as _numba_intrinsic

from cosim.kernel import PLAIN, kernel

__all__ = [
    "atomic_add",
    "atomic_load",
    "byte_at",
    "do_step2",
    "do_step3",
    "exchange_if",
    "expect",
    "get_or_set",
    "get_or_set3",
    "get_or_set_binary",
    "load_f4",
    "load_f8",
    "load_i1",
    "load_i2",
    "load_i4",
    "load_i8",
    "load_u1",
    "load_u2",
    "load_u4",
    "nanoseconds",
    "note",
    "rest",
    "step_whole",
    "store_f4",
    "store_f8",
    "store_i1",
    "store_i2",
    "store_i4",
    "store_i8",
]

intrinsic: Any = _numba_intrinsic
_I32, _I64, _F64 = ir.IntType(32), ir.IntType(64), ir.DoubleType()


def _get_or_set(typing: Any, function: Any, instance: Any, references: Any, n: Any, values: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64] * 4).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(*[types.uintp] * 5), codegen


def _do_step2(typing: Any, function: Any, instance: Any, t: Any, h: Any, final: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64, _F64, _F64, _I32]).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(types.uintp, types.uintp, types.double, types.double, types.int32), codegen


def _step_whole(typing: Any, function: Any, exchange: Any, t: Any, h: Any, packets: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64, _F64, _F64, _I32]).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(types.uintp, types.uintp, types.double, types.double, types.int32), codegen


def _get_or_set3(typing: Any, function: Any, instance: Any, references: Any, n: Any, values: Any, n_values: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64] * 5).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(*[types.uintp] * 6), codegen


def _get_or_set_binary(
    typing: Any, function: Any, instance: Any, references: Any, n: Any, sizes: Any, values: Any, n_values: Any
) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64] * 6).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])

    return types.int32(*[types.uintp] * 7), codegen


def _do_step3(typing: Any, function: Any, instance: Any, t: Any, h: Any, final: Any, answers: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I64, _F64, _F64, _I32, *[_I64] * 4]).as_pointer()
        answers = [builder.add(arguments[5], ir.Constant(_I64, offset)) for offset in (0, 1, 2, 8)]
        return builder.call(builder.inttoptr(arguments[0], kind), [*arguments[1:5], *answers])

    return types.int32(types.uintp, types.uintp, types.double, types.double, types.int32, types.uintp), codegen


def _load_number(stored: ir.Type, *, signed: bool = True) -> Any:
    """Returns an intrinsic that loads a number from an address, as a double or an int64."""

    def load(typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            value = builder.load(builder.inttoptr(arguments[0], stored.as_pointer()))
            if isinstance(stored, ir.DoubleType) or stored == _I64:
                return value
            if isinstance(stored, ir.FloatType):
                return builder.fpext(value, _F64)
            return builder.sext(value, _I64) if signed else builder.zext(value, _I64)

        floating = isinstance(stored, ir.DoubleType | ir.FloatType)
        return (types.double if floating else types.int64)(types.uintp), codegen

    return load


def _store_number(stored: ir.Type) -> Any:
    """Returns an intrinsic that stores a double or an int64 to an address; of an integer, the low bits are stored."""

    def store(typing: Any, address: Any, value: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            value = arguments[1]
            if isinstance(stored, ir.FloatType):
                value = builder.fptrunc(value, stored)
            elif isinstance(stored, ir.IntType) and stored != _I64:
                value = builder.trunc(value, stored)
            builder.store(value, builder.inttoptr(arguments[0], stored.as_pointer()))
            return context.get_dummy_value()

        floating = isinstance(stored, ir.DoubleType | ir.FloatType)
        return types.void(types.uintp, types.double if floating else types.int64), codegen

    return store


def _note(typing: Any, address: Any, record: Any) -> Any:
    silent = isinstance(address, types.Boolean)

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not silent:
            number = builder.ptrtoint(arguments[1], _I64)  # which the call that follows needs in any case
            builder.store(number, builder.inttoptr(arguments[0], _I64.as_pointer()))
        return context.get_dummy_value()

    return types.void(address if silent else types.uintp, record), codegen


def _expect(typing: Any, function: Any, instance: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [_I64]).as_pointer()
        builder.call(builder.inttoptr(arguments[0], kind), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.uintp, types.uintp), codegen


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
    """Returns the time of the POSIX monotonic clock."""

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
    """Waits for a moment: first busily, then yielding to other threads, then sleeping."""
    if spins > 20000:
        _usleep(np.uint32(50))
    elif spins > 200:
        _sched_yield()


def _plain_get_or_set(function: int, instance: int, references: int, n: int, values: int) -> int:
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
    return int(call(int(function))(int(instance), int(references), int(n), int(values)))


def _plain_do_step2(function: int, instance: int, t: float, h: float, final: int) -> int:
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
    return int(call(int(function))(int(instance), t, h, int(final)))


def _plain_step_whole(function: int, exchange: int, t: float, h: float, packets: int) -> int:
    call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
    return int(call(int(function))(int(exchange), t, h, int(packets)))


def _plain_get_or_set3(function: int, *arguments: int) -> int:
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    call = ctypes.CFUNCTYPE(ctypes.c_int, pointer, pointer, size, pointer, size)
    return int(call(int(function))(*map(int, arguments)))


def _plain_get_or_set_binary(function: int, *arguments: int) -> int:
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    call = ctypes.CFUNCTYPE(ctypes.c_int, pointer, pointer, size, pointer, pointer, size)
    return int(call(int(function))(*map(int, arguments)))


def _plain_do_step3(function: int, instance: int, t: float, h: float, final: int, answers: int) -> int:
    pointer, real = ctypes.c_void_p, ctypes.c_double
    call = ctypes.CFUNCTYPE(ctypes.c_int, pointer, real, real, ctypes.c_bool, *[pointer] * 4)
    places = [int(answers) + offset for offset in (0, 1, 2, 8)]
    return int(call(int(function))(int(instance), t, h, bool(final), *places))


def _plain_load(kind: Any) -> Any:
    return lambda address: kind.from_address(int(address)).value


def _plain_store(kind: Any) -> Any:
    def store(address: int, value: float) -> None:
        kind.from_address(int(address)).value = value

    return store


def _plain_note(address: int, record: Any) -> None:
    if address is not False:
        ctypes.c_int64.from_address(int(address)).value = record.__array_interface__["data"][0]


def _plain_expect(_function: int, _instance: int) -> None:
    """Does nothing: the call is a hint."""


def _plain_byte_at(address: int) -> int:
    return ctypes.c_ubyte.from_address(int(address)).value


def _no_threads(*_: int) -> int:
    raise RuntimeError("threads need compiled kernels; NUMBA_DISABLE_JIT is set")


get_or_set: Any = _plain_get_or_set if PLAIN else intrinsic(_get_or_set)
"""fmi2GetXXX or fmi2SetXXX(instance, references, n, values) -> status"""
do_step2: Any = _plain_do_step2 if PLAIN else intrinsic(_do_step2)
"""fmi2DoStep(instance, t, h, final) -> status; t and h in s; `final`: no state from before t will be restored"""
step_whole: Any = _plain_step_whole if PLAIN else intrinsic(_step_whole)
"""uav_cosim_make_step(exchange, t, h, packets) of our FMUs -> a status, NOT_BEGUN or NOT_READ"""
get_or_set3: Any = _plain_get_or_set3 if PLAIN else intrinsic(_get_or_set3)
"""fmi3GetXXX or fmi3SetXXX(instance, references, n, values, n_values) -> status"""
get_or_set_binary: Any = _plain_get_or_set_binary if PLAIN else intrinsic(_get_or_set_binary)
"""fmi3GetBinary or fmi3SetBinary(instance, references, n, sizes, values, n_values) -> status"""
do_step3: Any = _plain_do_step3 if PLAIN else intrinsic(_do_step3)
"""fmi3DoStep(instance, t, h, final, answers...) -> status; 16 bytes of answers: event handling needed, terminate
simulation, early return (a byte each), at 8 the last successful time"""
load_f4: Any = _plain_load(ctypes.c_float) if PLAIN else intrinsic(_load_number(ir.FloatType()))
load_f8: Any = _plain_load(ctypes.c_double) if PLAIN else intrinsic(_load_number(_F64))
load_i1: Any = _plain_load(ctypes.c_int8) if PLAIN else intrinsic(_load_number(ir.IntType(8)))
load_u1: Any = _plain_load(ctypes.c_uint8) if PLAIN else intrinsic(_load_number(ir.IntType(8), signed=False))
load_i2: Any = _plain_load(ctypes.c_int16) if PLAIN else intrinsic(_load_number(ir.IntType(16)))
load_u2: Any = _plain_load(ctypes.c_uint16) if PLAIN else intrinsic(_load_number(ir.IntType(16), signed=False))
load_i4: Any = _plain_load(ctypes.c_int32) if PLAIN else intrinsic(_load_number(_I32))
load_u4: Any = _plain_load(ctypes.c_uint32) if PLAIN else intrinsic(_load_number(_I32, signed=False))
load_i8: Any = _plain_load(ctypes.c_int64) if PLAIN else intrinsic(_load_number(_I64))
store_f4: Any = _plain_store(ctypes.c_float) if PLAIN else intrinsic(_store_number(ir.FloatType()))
store_f8: Any = _plain_store(ctypes.c_double) if PLAIN else intrinsic(_store_number(_F64))
store_i1: Any = _plain_store(ctypes.c_int8) if PLAIN else intrinsic(_store_number(ir.IntType(8)))
store_i2: Any = _plain_store(ctypes.c_int16) if PLAIN else intrinsic(_store_number(ir.IntType(16)))
store_i4: Any = _plain_store(ctypes.c_int32) if PLAIN else intrinsic(_store_number(_I32))
store_i8: Any = _plain_store(ctypes.c_int64) if PLAIN else intrinsic(_store_number(_I64))
note: Any = _plain_note if PLAIN else intrinsic(_note)
"""note(address, row) stores the address of a row of a table at an address; nothing, and free, if that is False."""
expect: Any = _plain_expect if PLAIN else intrinsic(_expect)
"""uav_cosim_expect(instance), a function of our FMUs: brings the instance's memory nearer."""
byte_at: Any = _plain_byte_at if PLAIN else intrinsic(_byte_at)
"""The byte at an address."""
atomic_load: Any = _no_threads if PLAIN else intrinsic(_load)
"""The int64 at an address, as every thread sees it."""
atomic_add: Any = _no_threads if PLAIN else intrinsic(_add)
"""Adds to the int64 at an address; returns its previous value."""
exchange_if: Any = _no_threads if PLAIN else intrinsic(_exchange_if)
"""exchange_if(address, expected, value): replaces the int64 if it still equals `expected`; returns whether it did."""
nanoseconds: Any = _no_threads if PLAIN else intrinsic(_nanoseconds)
"""Monotonic time."""
rest: Any = _no_threads if PLAIN else kernel(_rest)
"""Waits for other threads; the wait becomes longer as `spins` increases."""
