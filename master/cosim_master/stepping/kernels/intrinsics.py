"""What kernels of the loop call in compiled code only: FMI functions by address, memory, clocks, and the C library.

Addresses, handles and other pointers are unsigned pointer-sized integers. `fmi_calls` and `windows` name all of these.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic as _numba_intrinsic

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


get_or_set = intrinsic(_get_or_set)
do_step2 = intrinsic(_do_step2)
step_whole = intrinsic(_step_whole)
get_or_set3 = intrinsic(_get_or_set3)
get_or_set_binary = intrinsic(_get_or_set_binary)
do_step3 = intrinsic(_do_step3)
load_f4 = intrinsic(_load_number(ir.FloatType()))
load_f8 = intrinsic(_load_number(_F64))
load_i1 = intrinsic(_load_number(ir.IntType(8)))
load_u1 = intrinsic(_load_number(ir.IntType(8), signed=False))
load_i2 = intrinsic(_load_number(ir.IntType(16)))
load_u2 = intrinsic(_load_number(ir.IntType(16), signed=False))
load_i4 = intrinsic(_load_number(_I32))
load_u4 = intrinsic(_load_number(_I32, signed=False))
load_i8 = intrinsic(_load_number(_I64))
store_f4 = intrinsic(_store_number(ir.FloatType()))
store_f8 = intrinsic(_store_number(_F64))
store_i1 = intrinsic(_store_number(ir.IntType(8)))
store_i2 = intrinsic(_store_number(ir.IntType(16)))
store_i4 = intrinsic(_store_number(_I32))
store_i8 = intrinsic(_store_number(_I64))
note = intrinsic(_note)
expect = intrinsic(_expect)
byte_at = intrinsic(_byte_at)
atomic_load = intrinsic(_load)
atomic_add = intrinsic(_add)
exchange_if = intrinsic(_exchange_if)
nanoseconds = intrinsic(_nanoseconds)
sched_yield = types.ExternalFunction("sched_yield", types.int32())
usleep = types.ExternalFunction("usleep", types.int32(types.uint32))
malloc = types.ExternalFunction("malloc", types.uintp(types.uintp))
free = types.ExternalFunction("free", types.void(types.uintp))
memcpy = types.ExternalFunction("memcpy", types.uintp(types.uintp, types.uintp, types.uintp))
