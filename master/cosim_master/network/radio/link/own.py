"""A user's own effect of the radio (`cosim.channel`), compiled and called by address.

The function is compiled when a radio is made, in the same way as kernels, and the compiled loop calls it like an FMI
function. Its argument is a record, which the loop fills for each packet and receiver. If kernels run as plain Python,
so does the function.
"""

from __future__ import annotations

import ast
import ctypes
import math
import re
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cosim.channel
from cosim.channel import LONGEST_DELAY, PACKET
from cosim.deferred import InModule
from cosim.kernel import PLAIN, compiler, kernel, table
from cosim.packets import message_id, system
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.network.radio.link.effects import distance2
from cosim_master.network.radio.tables import Radio
from cosim_master.system.settings.radio.own_channel import FUNCTION, GIVEN, OwnChannel

__all__ = ["address_of", "over_own"]


def _intrinsics() -> Any:
    from cosim_master.network.radio import intrinsics

    return intrinsics


_LINE = re.compile(r'File "(?:[^"]*/)?([^"/]+)", line (\d+)')
_HEADS = ("Failed in", "During", "File", "[")
_CALLBACK: Any = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)


def _plain_delay_of(function: int, packet: int) -> float:
    return float(_CALLBACK(int(function))(int(packet)))


delay_of: Any = _plain_delay_of if PLAIN else InModule(_intrinsics, "delay_of")
"""The function at an address, for the record at another: the delay in s."""


@kernel
def over_own(
    r: Radio,
    reals: NDArray[np.float64],
    t: int,
    arrival: int,
    e: int,
    other: int,
    number: int,
    buf: NDArray[np.uint8],
    start: int,
    stop: int,
) -> int:
    """Returns the arrival [ns] of a packet that endpoint `e` sends at t to node `other`, by the own channel; or -1.

    `arrival`: without the own channel.
    """
    s, n, packet = r.settings[0], r.endpoints[e].node, r.packet[0]
    packet["time"] = t * 1e-9
    packet["delay"] = (arrival - t) * 1e-9
    packet["distance"] = np.nan
    if r.nodes[n].place[0] >= 0 and r.nodes[other].place[0] >= 0:
        packet["distance"] = np.sqrt(distance2(r, reals, n, other))
        for i in range(3):
            packet.sender[i] = reals[r.nodes[n].place[i]]
            packet.receiver[i] = reals[r.nodes[other].place[i]]
    packet["length"] = stop - start
    packet["message"] = message_id(buf, start)
    packet["system"] = system(buf, start)
    packet["number"] = number
    packet.key[0] = s.seed
    packet.key[1] = r.endpoints[e].identity
    packet.key[2] = r.nodes[other].identity
    delay = delay_of(s.own, r.packet.ctypes.data)
    if 0.0 <= delay <= LONGEST_DELAY:
        return int(t + np.int64(np.floor(delay * 1e9 + 0.5)))
    return -1


def address_of(own: OwnChannel) -> int:
    """Returns the address of the compiled function of an own channel, which exists as long as the process.

    Raises:
        SystemDescriptionError: it cannot be compiled.
    """
    if PLAIN:
        return int(ctypes.cast(_plain(own), ctypes.c_void_p).value or 0)
    return int(_compiled(own).address)


@cache
def _compiled(own: OwnChannel) -> Any:
    """Returns the C function of an own channel; it must be kept, since the loop has its address."""
    numba = compiler()
    function, carray = _function(own), numba.carray

    def entry(place: Any) -> float:
        return float(function(carray(place, 1)[0]))

    try:
        pointer: Any = numba.types.CPointer(numba.from_dtype(PACKET))
        return numba.cfunc(numba.float64(pointer))(entry)
    except numba.core.errors.NumbaError as error:
        raise SystemDescriptionError([_problem(own, str(error))]) from None


@cache
def _plain(own: OwnChannel) -> Any:
    """Returns a C function that calls the Python function of an own channel."""
    function = _function(own)

    def entry(place: int) -> float:
        memory: Any = (ctypes.c_char * PACKET.itemsize).from_address(place)
        row = np.frombuffer(memory, dtype=PACKET)
        try:
            return float(function(table(row)[0]))
        except (ArithmeticError, ValueError):  # compiled, 1.0 / 0.0 and sqrt(-1.0) are not exceptions
            return math.nan

    return _CALLBACK(entry)


def _function(own: OwnChannel) -> Any:
    """Returns the function of an own channel as a kernel. Only functions are executed, without their annotations."""
    tree = ast.parse(own.code)
    tree.body = [one for one in tree.body if isinstance(one, ast.FunctionDef)]
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
    names = {name: getattr(cosim.channel, name) for name in GIVEN}
    names |= {"math": math, **dict(own.constants)}
    exec(compile(tree, str(own.path.resolve()), "exec"), names)  # `read_own_channel` has checked it
    for one in tree.body:
        if isinstance(one, ast.FunctionDef):
            names[one.name] = kernel(names[one.name])
    return names[FUNCTION]


def _problem(own: OwnChannel, text: str) -> Problem:
    """Returns a message of numba's with the last line that it names in the file."""
    if "Function(<class 'float'>)" in text:  # of the value that the function returns
        functions = [one for one in ast.parse(own.code).body if isinstance(one, ast.FunctionDef)]
        line = next(one.lineno for one in functions if one.name == FUNCTION)
        wanted = "returns no number: return the delay in s as a float, such as packet.delay, or -1.0 to lose the packet"
        return Problem(Where(str(own.path), line), f"{FUNCTION} {wanted}")
    lines = [int(line) for file, line in _LINE.findall(text) if file == own.path.name]
    plain = [one.strip() for one in text.splitlines() if one.strip()]
    first = next((one for one in plain if not one.startswith(_HEADS)), plain[0] if plain else "")
    return Problem(Where(str(own.path), lines[-1] if lines else None), f"cannot be compiled: {first}")
