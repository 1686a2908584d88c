"""Calls of FMI functions by their address, from compiled loops.

Each is a numba intrinsic (`intrinsics`): an indirect call in the machine code of the loop, with no Python in between.
If kernels run as plain Python (NUMBA_DISABLE_JIT=1, for debugging), the same names call through ctypes, which is slow.

Addresses, handles and other pointers are unsigned pointer-sized integers.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from cosim.deferred import InModule
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


def _intrinsics() -> Any:
    from cosim_master.stepping.kernels import intrinsics

    return intrinsics


def _compiled(name: str) -> InModule:
    return InModule(_intrinsics, name)


_sched_yield: Any = _compiled("sched_yield")
_usleep: Any = _compiled("usleep")


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


get_or_set: Any = _plain_get_or_set if PLAIN else _compiled("get_or_set")
"""fmi2GetXXX or fmi2SetXXX(instance, references, n, values) -> status"""
do_step2: Any = _plain_do_step2 if PLAIN else _compiled("do_step2")
"""fmi2DoStep(instance, t, h, final) -> status; t and h in s; `final`: no state from before t will be restored"""
step_whole: Any = _plain_step_whole if PLAIN else _compiled("step_whole")
"""uav_cosim_make_step(exchange, t, h, packets) of our FMUs -> a status, NOT_BEGUN or NOT_READ"""
get_or_set3: Any = _plain_get_or_set3 if PLAIN else _compiled("get_or_set3")
"""fmi3GetXXX or fmi3SetXXX(instance, references, n, values, n_values) -> status"""
get_or_set_binary: Any = _plain_get_or_set_binary if PLAIN else _compiled("get_or_set_binary")
"""fmi3GetBinary or fmi3SetBinary(instance, references, n, sizes, values, n_values) -> status"""
do_step3: Any = _plain_do_step3 if PLAIN else _compiled("do_step3")
"""fmi3DoStep(instance, t, h, final, answers...) -> status; 16 bytes of answers: event handling needed, terminate
simulation, early return (a byte each), at 8 the last successful time"""
load_f4: Any = _plain_load(ctypes.c_float) if PLAIN else _compiled("load_f4")
load_f8: Any = _plain_load(ctypes.c_double) if PLAIN else _compiled("load_f8")
load_i1: Any = _plain_load(ctypes.c_int8) if PLAIN else _compiled("load_i1")
load_u1: Any = _plain_load(ctypes.c_uint8) if PLAIN else _compiled("load_u1")
load_i2: Any = _plain_load(ctypes.c_int16) if PLAIN else _compiled("load_i2")
load_u2: Any = _plain_load(ctypes.c_uint16) if PLAIN else _compiled("load_u2")
load_i4: Any = _plain_load(ctypes.c_int32) if PLAIN else _compiled("load_i4")
load_u4: Any = _plain_load(ctypes.c_uint32) if PLAIN else _compiled("load_u4")
load_i8: Any = _plain_load(ctypes.c_int64) if PLAIN else _compiled("load_i8")
store_f4: Any = _plain_store(ctypes.c_float) if PLAIN else _compiled("store_f4")
store_f8: Any = _plain_store(ctypes.c_double) if PLAIN else _compiled("store_f8")
store_i1: Any = _plain_store(ctypes.c_int8) if PLAIN else _compiled("store_i1")
store_i2: Any = _plain_store(ctypes.c_int16) if PLAIN else _compiled("store_i2")
store_i4: Any = _plain_store(ctypes.c_int32) if PLAIN else _compiled("store_i4")
store_i8: Any = _plain_store(ctypes.c_int64) if PLAIN else _compiled("store_i8")
note: Any = _plain_note if PLAIN else _compiled("note")
"""note(address, row) stores the address of a row of a table at an address; nothing, and free, if that is False."""
expect: Any = _plain_expect if PLAIN else _compiled("expect")
"""uav_cosim_expect(instance), a function of our FMUs: brings the instance's memory nearer."""
byte_at: Any = _plain_byte_at if PLAIN else _compiled("byte_at")
"""The byte at an address."""
atomic_load: Any = _no_threads if PLAIN else _compiled("atomic_load")
"""The int64 at an address, as every thread sees it."""
atomic_add: Any = _no_threads if PLAIN else _compiled("atomic_add")
"""Adds to the int64 at an address; returns its previous value."""
exchange_if: Any = _no_threads if PLAIN else _compiled("exchange_if")
"""exchange_if(address, expected, value): replaces the int64 if it still equals `expected`; returns whether it did."""
nanoseconds: Any = _no_threads if PLAIN else _compiled("nanoseconds")
"""Monotonic time."""
rest: Any = _no_threads if PLAIN else kernel(_rest)
"""Waits for other threads; the wait becomes longer as `spins` increases."""
